//! Lossless images: each sample predicted from its neighbours (T.81, annex H).
//!
//! A frame in one scan is handed on line by line, with two lines held. One in several scans (each
//! component by itself) is gathered whole, checked against the memory first.

use super::super::{CodecError, RowSink};
use super::bits::{Bits, Restarts};
use super::bytes::Bytes;
use super::huffman::Huffman;
use super::markers::{Event, Frame, Scan, Tables};
use super::reserve;
use crate::codec::{damaged, unsupported};

/// Decodes from the first scan on.
pub(super) fn decode(
    bytes: &mut Bytes<'_>,
    tables: &mut Tables,
    frame: &Frame,
    scan: &Scan,
    memory_bytes: u64,
    sink: &mut dyn RowSink,
) -> Result<(), CodecError> {
    if frame.components.len() > 1 && (frame.h_max, frame.v_max) != (1, 1) {
        return Err(unsupported("lossless JPEG with subsampled components"));
    }
    let count = frame.components.len();
    let samples_in_row = frame.columns as usize * count;
    // Two lines of 16 bits, one row of 32.
    let lines_bytes = samples_in_row as u64 * 8 + count as u64 * Differences::BYTES;
    if scan.components.len() == count {
        reserve(lines_bytes, memory_bytes)?;
        let mut row = vec![0; samples_in_row];
        // The components of the scan may come in another order than in the frame.
        let order: Vec<usize> = scan.components.iter().map(|c| c.index).collect();
        lines(bytes, tables, frame, scan, |_, line, finish| {
            for (row, line) in row.chunks_exact_mut(count).zip(line.chunks_exact(count)) {
                for (&component, &sample) in order.iter().zip(line) {
                    row[component] = finish.sample(sample)?.into();
                }
            }
            sink.row(&row)
        })?;
        return Ok(());
    }
    reserve(lines_bytes + samples_in_row as u64 * 2 * u64::from(frame.rows), memory_bytes)?;
    let mut image = vec![0_u16; samples_in_row * frame.rows as usize];
    let mut seen = vec![false; count];
    let mut scan = scan.clone();
    loop {
        for component in &scan.components {
            if std::mem::replace(&mut seen[component.index], true) {
                return Err(damaged("two scans hold the same component"));
            }
        }
        let marker = lines(bytes, tables, frame, &scan, |y, line, finish| {
            let row = image.chunks_exact_mut(samples_in_row).nth(y as usize).unwrap_or(&mut []);
            for (row, line) in row.chunks_exact_mut(count).zip(line.chunks_exact(scan.components.len())) {
                for (component, &sample) in scan.components.iter().zip(line) {
                    row[component.index] = finish.sample(sample)?;
                }
            }
            Ok(())
        })?;
        if !seen.contains(&false) {
            break;
        }
        scan = match tables.next(bytes, marker, Some(frame))? {
            Event::Scan(scan) => scan,
            _ => return Err(damaged("a component has no scan")),
        };
    }
    let mut row = vec![0; samples_in_row];
    for line in image.chunks_exact(samples_in_row) {
        for (row, &sample) in row.iter_mut().zip(line) {
            *row = sample.into();
        }
        sink.row(&row)?;
    }
    Ok(())
}

/// Final step from a predicted sample to a sample of the image.
struct Finish {
    point_transform: u8,
    /// Bits of a predicted sample.
    bits: u8,
}

impl Finish {
    /// Undoes the point transform.
    ///
    /// Arithmetic is modulo 2^16 at every precision, and some encoders hand signed samples of fewer
    /// bits to it as they are: the bits above the precision are then copies of the sign, and fall off here.
    ///
    /// # Errors
    /// The sample has more bits than the frame header states.
    #[inline]
    fn sample(&self, predicted: u16) -> Result<u16, CodecError> {
        let above = u32::from(predicted) >> self.bits;
        if above != 0 {
            let sign_and_above = predicted >> (self.bits - 1);
            if sign_and_above != u16::MAX >> (self.bits - 1) {
                return Err(damaged("a sample is out of the range that its header gives"));
            }
        }
        let mask = u16::MAX >> (16 - self.bits);
        Ok((predicted & mask) << self.point_transform)
    }
}

/// Decodes one scan line by line, the components of a pixel side by side; returns the marker behind it.
fn lines(
    bytes: &mut Bytes<'_>,
    tables: &Tables,
    frame: &Frame,
    scan: &Scan,
    mut receive: impl FnMut(u32, &[u16], &Finish) -> Result<(), CodecError>,
) -> Result<Option<u8>, CodecError> {
    if !(1..=7).contains(&scan.start) {
        return Err(damaged(format!("a lossless scan has the predictor {}", scan.start)));
    }
    let bits_left = frame.precision.checked_sub(scan.low).filter(|&bits| bits > 0);
    let finish = match bits_left {
        Some(bits) => Finish { point_transform: scan.low, bits },
        None => return Err(damaged("the point transform leaves nothing of the samples")),
    };
    let restarts_come = u64::from(tables.restart_interval) < u64::from(frame.columns) * u64::from(frame.rows);
    if restarts_come && !tables.restart_interval.is_multiple_of(frame.columns) {
        return Err(damaged("restart markers stand within a line of a lossless image"));
    }
    let mut differences = Vec::with_capacity(4);
    for component in &scan.components {
        differences.push(Differences::new(tables.dc(component.dc)?));
    }
    let mut bits = Bits::new(bytes);
    let mut restarts = Restarts::new(tables.restart_interval.div_ceil(frame.columns));
    let samples = frame.columns as usize * differences.len();
    let (mut above, mut line) = (vec![0; samples], vec![0; samples]);
    for y in 0..frame.rows {
        let first = restarts.unit(&mut bits)? || y == 0;
        if first {
            // The first sample of all is predicted by the middle of the range, by way of the line above.
            above.fill(1 << (finish.bits - 1));
        }
        decode_line(&mut bits, &differences, if first { 1 } else { scan.start }, &above, &mut line)?;
        receive(y, &line, &finish)?;
        std::mem::swap(&mut above, &mut line);
    }
    bits.finish()
}

/// One line of 1 to 4 components; a loop for each number of them, since grey images are many.
fn decode_line(
    bits: &mut Bits<'_, '_>,
    tables: &[Differences<'_>],
    predictor: u8,
    above: &[u16],
    line: &mut [u16],
) -> Result<(), CodecError> {
    match tables {
        [a] => choose(bits, [a], predictor, above, line),
        [a, b] => choose(bits, [a, b], predictor, above, line),
        [a, b, c] => choose(bits, [a, b, c], predictor, above, line),
        [a, b, c, d] => choose(bits, [a, b, c, d], predictor, above, line),
        _ => Ok(()),
    }
}

/// The predictors of table H.1; they see the samples to the left, above, and above left.
fn choose<const N: usize>(
    bits: &mut Bits<'_, '_>,
    tables: [&Differences<'_>; N],
    predictor: u8,
    above: &[u16],
    line: &mut [u16],
) -> Result<(), CodecError> {
    let (above, line) = (above.as_chunks().0, line.as_chunks_mut().0);
    match predictor {
        1 => predict(bits, tables, above, line, |a, _, _| a),
        2 => predict(bits, tables, above, line, |_, b, _| b),
        3 => predict(bits, tables, above, line, |_, _, c| c),
        4 => predict(bits, tables, above, line, |a, b, c| a + b - c),
        5 => predict(bits, tables, above, line, |a, b, c| a + ((b - c) >> 1)),
        6 => predict(bits, tables, above, line, |a, b, c| b + ((a - c) >> 1)),
        _ => predict(bits, tables, above, line, |a, b, _| (a + b) >> 1),
    }
}

#[inline]
fn predict<const N: usize>(
    bits: &mut Bits<'_, '_>,
    tables: [&Differences<'_>; N],
    above: &[[u16; N]],
    line: &mut [[u16; N]],
    rule: impl Fn(i32, i32, i32) -> i32,
) -> Result<(), CodecError> {
    let (Some((first, line)), Some((first_above, above))) = (line.split_first_mut(), above.split_first())
    else {
        return Ok(());
    };
    // The first pixel of a line is predicted by the one above under every rule.
    for n in 0..N {
        first[n] = modulo(i32::from(first_above[n]) + tables[n].next(bits)?);
    }
    let (mut left, mut above_left) = (*first, *first_above);
    for (pixel, above) in line.iter_mut().zip(above) {
        for n in 0..N {
            let predicted = rule(left[n].into(), above[n].into(), above_left[n].into());
            left[n] = modulo(predicted + tables[n].next(bits)?);
        }
        (*pixel, above_left) = (left, *above);
    }
    Ok(())
}

/// Codes that fit into this many bits together with the difference behind them are found at once.
const FUSED_BITS: u32 = 10;

struct Differences<'t> {
    table: &'t Huffman,
    /// Indexed by the next bits: length of a code with its difference, and the difference; (0, 0) where more bits are
    /// needed.
    fused: Box<[(u8, i16); 1 << FUSED_BITS]>,
}

impl<'t> Differences<'t> {
    const BYTES: u64 = size_of::<[(u8, i16); 1 << FUSED_BITS]>() as u64;

    fn new(table: &'t Huffman) -> Self {
        let mut fused = Box::new([(0, 0); 1 << FUSED_BITS]);
        for (bits, entry) in (0_u16..).zip(fused.iter_mut()) {
            let bits = bits << (16 - FUSED_BITS);
            let (length, size) = table.find(bits);
            let whole = length + u32::from(size);
            if length > 0 && whole <= FUSED_BITS {
                let value = i32::from(bits << length) >> (16 - size);
                // The same as `Bits::signed`; sizes up to 9 bits fit for every table.
                let value = if value < (1 << size) >> 1 { value - (1 << size) + 1 } else { value };
                *entry = (whole.to_le_bytes()[0], i16::try_from(value).unwrap_or(0));
            }
        }
        Self { table, fused }
    }

    /// The next difference (H.1.2.2); size 16 stands alone, for 32768.
    #[inline]
    fn next(&self, bits: &mut Bits<'_, '_>) -> Result<i32, CodecError> {
        let (length, value) = self.fused[usize::from(bits.peek()? >> (16 - FUSED_BITS))];
        if length > 0 {
            bits.consume(length.into())?;
            return Ok(value.into());
        }
        match bits.symbol(self.table)? {
            size @ 0..=15 => bits.signed(size.into()),
            16 => Ok(1 << 15),
            bits => Err(damaged(format!("a difference has {bits} bits"))),
        }
    }
}

/// Modulo 2^16 (H.1.2.1).
#[inline]
fn modulo(value: i32) -> u16 {
    let [low, high, ..] = value.to_le_bytes();
    u16::from_le_bytes([low, high])
}
