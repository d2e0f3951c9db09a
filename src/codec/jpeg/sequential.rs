//! Sequential DCT images in one scan, streamed: one row of MCUs is held (T.81, annex F).

use super::super::{CodecError, RowSink};
use super::bits::{Bits, Restarts};
use super::bytes::Bytes;
use super::dct::{self, Block, ZIGZAG};
use super::huffman::Huffman;
use super::markers::{Frame, Scan, Tables};
use super::reserve;
use super::strip::{Layout, Strip};
use crate::codec::damaged;

/// Decodes the only scan of a frame.
pub(super) fn decode(
    bytes: &mut Bytes<'_>,
    tables: &Tables,
    frame: &Frame,
    scan: &Scan,
    memory_bytes: u64,
    sink: &mut dyn RowSink,
) -> Result<(), CodecError> {
    reserve(Strip::bytes(frame), memory_bytes)?;
    let layout = Layout::new(frame);
    let mut strip = Strip::new(frame);
    let mut parts = Vec::with_capacity(4);
    for part in &scan.components {
        if let Some(component) = frame.components.get(part.index) {
            let steps = tables.steps(component.steps)?;
            parts.push((part.index, component, tables.dc(part.dc)?, tables.ac(part.ac)?, steps));
        }
    }
    let mut bits = Bits::new(bytes);
    let mut restarts = Restarts::new(tables.restart_interval);
    let mut predicted = [0; 4];
    for _ in 0..layout.mcus_y {
        for mcu in 0..layout.mcus_x as usize {
            if restarts.unit(&mut bits)? {
                predicted = [0; 4];
            }
            for (&(index, component, dc, ac, steps), predicted) in parts.iter().zip(&mut predicted) {
                for y in 0..component.v as usize {
                    for x in 0..component.h as usize {
                        let block = decode_block(&mut bits, dc, ac, predicted)?;
                        let samples = dct::samples(&block, steps, frame.precision);
                        strip.put(index, mcu * component.h as usize + x, y, &samples);
                    }
                }
            }
        }
        strip.emit(frame, sink)?;
    }
    bits.finish().map(drop)
}

/// One block of quantised coefficients (F.2.2).
#[inline]
pub(super) fn decode_block(
    bits: &mut Bits<'_, '_>,
    dc: &Huffman,
    ac: &Huffman,
    predicted: &mut i16,
) -> Result<Block, CodecError> {
    let mut block = [0; 64];
    block[0] = decode_dc(bits, dc, predicted)?;
    let mut at = 1;
    while at < 64 {
        let symbol = bits.symbol(ac)?;
        let (zeros, size) = (usize::from(symbol >> 4), u32::from(symbol & 15));
        if size == 0 {
            match zeros {
                0 => break,
                15 => at += 16,
                _ => return Err(damaged("it holds a code of progressive images")),
            }
            continue;
        }
        at += zeros;
        let place = *ZIGZAG.get(at).ok_or_else(too_long)?;
        block[usize::from(place)] = small(bits.signed(size)?)?;
        at += 1;
    }
    if at > 64 { Err(too_long()) } else { Ok(block) }
}

/// Error for a run of zeros that leads out of its block.
pub(super) fn too_long() -> CodecError {
    damaged("a block has more than 64 coefficients")
}

/// The DC coefficient: the sum of all differences up to here (F.2.2.1).
#[inline]
pub(super) fn decode_dc(
    bits: &mut Bits<'_, '_>,
    table: &Huffman,
    predicted: &mut i16,
) -> Result<i16, CodecError> {
    let size = bits.symbol(table)?;
    if size > 15 {
        return Err(damaged(format!("a difference has {size} bits")));
    }
    *predicted = small(i32::from(*predicted) + bits.signed(size.into())?)?;
    Ok(*predicted)
}

/// A coefficient, which never takes more than 16 bits.
#[inline]
pub(super) fn small(value: i32) -> Result<i16, CodecError> {
    i16::try_from(value).map_err(|_| damaged("a coefficient is out of range"))
}
