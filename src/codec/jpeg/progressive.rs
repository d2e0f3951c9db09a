//! DCT images in several scans: progressive ones (T.81, annex G), and sequential ones whose components
//! come one after the other. All coefficients are held, two bytes each.

use super::super::{CodecError, RowSink};
use super::bits::{Bits, Restarts};
use super::bytes::Bytes;
use super::dct::{self, Block, Steps, ZIGZAG};
use super::huffman::Huffman;
use super::markers::{Event, Frame, Process, Scan, ScanComponent, Tables};
use super::reserve;
use super::sequential::{decode_block, decode_dc, small, too_long};
use super::strip::{Layout, Strip};
use crate::codec::damaged;

/// Marks a coefficient that no scan has touched.
const UNSEEN: u8 = u8::MAX;

struct Coefficients {
    h: usize,
    v: usize,
    /// Blocks in a row of `blocks`, those that fill up the last MCU included.
    stride: usize,
    blocks: Vec<Block>,
    /// Blocks across and down in a scan of this component alone.
    alone: (u32, u32),
    /// For each coefficient in zigzag order, the lowest bit position decoded.
    seen: [u8; 64],
    /// Taken at the component's first scan: later segments may change the slot (B.2.4.1).
    steps: Option<Box<Steps>>,
}

/// Decodes from the first scan on.
pub(super) fn decode(
    bytes: &mut Bytes<'_>,
    tables: &mut Tables,
    frame: &Frame,
    scan: Scan,
    memory_bytes: u64,
    sink: &mut dyn RowSink,
) -> Result<(), CodecError> {
    let layout = Layout::new(frame);
    let mcus = u64::from(layout.mcus_x) * u64::from(layout.mcus_y);
    let blocks: u64 = frame.components.iter().map(|c| u64::from(c.h * c.v)).sum();
    reserve(Strip::bytes(frame) + mcus * blocks * size_of::<Block>() as u64, memory_bytes)?;
    let mut image: Vec<Coefficients> = frame
        .components
        .iter()
        .map(|c| {
            let (h, v) = (c.h as usize, c.v as usize);
            let stride = layout.mcus_x as usize * h;
            let blocks = vec![[0; 64]; stride * layout.mcus_y as usize * v];
            let alone = Layout::alone(frame, c.h, c.v);
            Coefficients { h, v, stride, blocks, alone, seen: [UNSEEN; 64], steps: None }
        })
        .collect();
    let mut event = Event::Scan(scan);
    let marked = loop {
        let scan = match event {
            Event::Scan(scan) => scan,
            Event::End { marked } => break marked,
            Event::Frame(_) => return Err(damaged("it has two frame headers")),
        };
        progress(&mut image, frame, &scan)?;
        for part in &scan.components {
            if let (Some(coefficients), Some(component)) =
                (image.get_mut(part.index), frame.components.get(part.index))
                && coefficients.steps.is_none()
            {
                coefficients.steps = Some(Box::new(*tables.steps(component.steps)?));
            }
        }
        let marker = decode_scan(bytes, tables, frame, layout, &scan, &mut image)?;
        if image.iter().all(|c| c.seen == [0; 64]) {
            break true;
        }
        event = tables.next(bytes, marker, Some(frame))?;
    };
    // An encoder may omit the finest scans if it marks the end of the image; an image without the marker is incomplete.
    if !marked || image.iter().any(|c| c.seen[0] == UNSEEN) {
        return Err(damaged("it ends before its last scan"));
    }
    let mut strip = Strip::new(frame);
    for mcu_y in 0..layout.mcus_y as usize {
        for (index, component) in image.iter().enumerate() {
            let Some(steps) = component.steps.as_deref() else { continue };
            let rows = component.blocks.chunks_exact(component.stride).skip(mcu_y * component.v);
            for (y, row) in rows.take(component.v).enumerate() {
                for (x, block) in row.iter().enumerate() {
                    strip.put(index, x, y, &dct::samples(block, steps, frame.precision));
                }
            }
        }
        strip.emit(frame, sink)?;
    }
    Ok(())
}

/// Checks that a scan comes in its turn, and notes it. Every coefficient is begun once, and then refined
/// bit by bit (G.1.1.1): so the number of scans is bounded, however short they are.
fn progress(image: &mut [Coefficients], frame: &Frame, scan: &Scan) -> Result<(), CodecError> {
    let out_of_turn = || damaged("a scan comes out of its turn");
    let (start, end) = (usize::from(scan.start), usize::from(scan.end));
    let (start, end, high, low) = match frame.process {
        Process::Progressive => (start, end, scan.high, scan.low),
        // Some encoders write zeros in the header of a sequential scan, whose fields have no use.
        _ => (0, 63, 0, 0),
    };
    let sequential = frame.process != Process::Progressive;
    let dc_or_one_band = if start == 0 { sequential || end == 0 } else { scan.components.len() == 1 };
    let bit_by_bit = high == 0 || high == low + 1;
    if end > 63 || start > end || low > 13 || !dc_or_one_band || !bit_by_bit {
        return Err(out_of_turn());
    }
    for part in &scan.components {
        let component = image.get_mut(part.index).ok_or_else(out_of_turn)?;
        if start > 0 && component.seen[0] == UNSEEN {
            return Err(out_of_turn());
        }
        for seen in &mut component.seen[start..=end] {
            let expected = if high == 0 { UNSEEN } else { high };
            if *seen != expected {
                return Err(out_of_turn());
            }
            *seen = low;
        }
    }
    Ok(())
}

/// The effect of a scan on a block.
#[derive(Clone, Copy)]
enum Step<'t> {
    Whole { dc: &'t Huffman, ac: &'t Huffman },
    DcFirst { dc: &'t Huffman },
    DcRefine,
    AcFirst { ac: &'t Huffman },
    AcRefine { ac: &'t Huffman },
}

impl<'t> Step<'t> {
    fn new(tables: &'t Tables, frame: &Frame, scan: &Scan, part: ScanComponent) -> Result<Self, CodecError> {
        Ok(match (frame.process, scan.start, scan.high) {
            (Process::Progressive, 0, 0) => Self::DcFirst { dc: tables.dc(part.dc)? },
            (Process::Progressive, 0, _) => Self::DcRefine,
            (Process::Progressive, _, 0) => Self::AcFirst { ac: tables.ac(part.ac)? },
            (Process::Progressive, ..) => Self::AcRefine { ac: tables.ac(part.ac)? },
            _ => Self::Whole { dc: tables.dc(part.dc)?, ac: tables.ac(part.ac)? },
        })
    }
}

/// State that lasts from block to block, up to a restart.
#[derive(Default)]
struct Running {
    /// Previous DC coefficient, for each component of the scan.
    predicted: [i16; 4],
    /// Blocks that have no more coefficients in this band.
    ended_blocks: u32,
}

/// Decodes one scan; returns the marker behind it.
fn decode_scan(
    bytes: &mut Bytes<'_>,
    tables: &Tables,
    frame: &Frame,
    layout: Layout,
    scan: &Scan,
    image: &mut [Coefficients],
) -> Result<Option<u8>, CodecError> {
    let mut steps = Vec::with_capacity(4);
    for &part in &scan.components {
        steps.push((part.index, Step::new(tables, frame, scan, part)?));
    }
    let mut bits = Bits::new(bytes);
    let mut restarts = Restarts::new(tables.restart_interval);
    let mut running = Running::default();
    if let [(index, step)] = steps[..] {
        let Some(component) = image.get_mut(index) else { return Ok(None) };
        let (across, down) = component.alone;
        for row in component.blocks.chunks_exact_mut(component.stride).take(down as usize) {
            for block in row.iter_mut().take(across as usize) {
                if restarts.unit(&mut bits)? {
                    running = Running::default();
                }
                decode_part(&mut bits, step, scan, &mut running, 0, block)?;
            }
        }
        return bits.finish();
    }
    for mcu_y in 0..layout.mcus_y as usize {
        for mcu_x in 0..layout.mcus_x as usize {
            if restarts.unit(&mut bits)? {
                running = Running::default();
            }
            for (slot, &(index, step)) in steps.iter().enumerate() {
                let Some(component) = image.get_mut(index) else { continue };
                for y in 0..component.v {
                    let row = (mcu_y * component.v + y) * component.stride + mcu_x * component.h;
                    for block in component.blocks.iter_mut().skip(row).take(component.h) {
                        decode_part(&mut bits, step, scan, &mut running, slot, block)?;
                    }
                }
            }
        }
    }
    bits.finish()
}

/// One block's share of a scan; `slot` counts the components of the scan.
fn decode_part(
    bits: &mut Bits<'_, '_>,
    step: Step<'_>,
    scan: &Scan,
    running: &mut Running,
    slot: usize,
    block: &mut Block,
) -> Result<(), CodecError> {
    match step {
        Step::Whole { dc, ac } => *block = decode_block(bits, dc, ac, &mut running.predicted[slot])?,
        Step::DcFirst { dc } => {
            let value = decode_dc(bits, dc, &mut running.predicted[slot])?;
            block[0] = small(i32::from(value) << scan.low)?;
        }
        Step::DcRefine => {
            if bits.bit()? {
                block[0] |= 1 << scan.low;
            }
        }
        Step::AcFirst { ac } => ac_first(bits, ac, scan, &mut running.ended_blocks, block)?,
        Step::AcRefine { ac } => ac_refine(bits, ac, scan, &mut running.ended_blocks, block)?,
    }
    Ok(())
}

/// Number of blocks, this one included, that an end-of-band code of the given class ends (G.1.2.2).
fn ended(bits: &mut Bits<'_, '_>, class: u8) -> Result<u32, CodecError> {
    let extra = bits.number(class.into())?.unsigned_abs();
    Ok((1 << class) + extra)
}

/// The first scan of a band of AC coefficients (G.1.2.2).
fn ac_first(
    bits: &mut Bits<'_, '_>,
    table: &Huffman,
    scan: &Scan,
    ended_blocks: &mut u32,
    block: &mut Block,
) -> Result<(), CodecError> {
    if *ended_blocks > 0 {
        *ended_blocks -= 1;
        return Ok(());
    }
    let mut at = usize::from(scan.start);
    let end = usize::from(scan.end);
    while at <= end {
        let symbol = bits.symbol(table)?;
        let (zeros, size) = (symbol >> 4, symbol & 15);
        if size == 0 && zeros < 15 {
            *ended_blocks = ended(bits, zeros)? - 1;
            return Ok(());
        }
        at += usize::from(zeros);
        if size > 0 {
            let place = ZIGZAG.get(at).filter(|_| at <= end).ok_or_else(too_long)?;
            block[usize::from(*place)] = small(bits.signed(size.into())? << scan.low)?;
        }
        at += 1;
    }
    if at > end + 1 { Err(too_long()) } else { Ok(()) }
}

/// A scan that adds one bit to a band of AC coefficients (G.1.2.3): those known get a bit each as they are
/// passed, and runs count only those that are still zero.
fn ac_refine(
    bits: &mut Bits<'_, '_>,
    table: &Huffman,
    scan: &Scan,
    ended_blocks: &mut u32,
    block: &mut Block,
) -> Result<(), CodecError> {
    let bit = 1_i32 << scan.low;
    let mut band = ZIGZAG[usize::from(scan.start)..=usize::from(scan.end)].iter();
    while *ended_blocks == 0 && !band.as_slice().is_empty() {
        let symbol = bits.symbol(table)?;
        let (mut zeros, size) = (symbol >> 4, symbol & 15);
        let fresh = match size {
            0 if zeros < 15 => {
                *ended_blocks = ended(bits, zeros)?;
                break;
            }
            0 => 0,
            1 => {
                if bits.bit()? {
                    bit
                } else {
                    -bit
                }
            }
            _ => return Err(damaged("a refined coefficient has more than one bit")),
        };
        loop {
            let value = &mut block[usize::from(*band.next().ok_or_else(too_long)?)];
            if *value != 0 {
                refine(bits, value, bit)?;
            } else if zeros > 0 {
                zeros -= 1;
            } else {
                *value = small(fresh)?;
                break;
            }
        }
    }
    if *ended_blocks > 0 {
        *ended_blocks -= 1;
        for &place in band {
            let value = &mut block[usize::from(place)];
            if *value != 0 {
                refine(bits, value, bit)?;
            }
        }
    }
    Ok(())
}

/// Adds the next bit to the amount of a coefficient.
#[inline]
fn refine(bits: &mut Bits<'_, '_>, value: &mut i16, bit: i32) -> Result<(), CodecError> {
    if bits.bit()? {
        *value = small(i32::from(*value) + if *value > 0 { bit } else { -bit })?;
    }
    Ok(())
}
