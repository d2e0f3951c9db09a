//! JPEG-LS, lossless and near-lossless (ISO/IEC 14495-1, ITU-T T.87).
//!
//! Decoded are 2 to 16 bits a sample, 1 to 4 components of one size in any interleave mode and in any split
//! into scans, preset coding parameters, restart intervals in lines, and sizes beyond 65535. Refused by name
//! are mapping tables, point transforms, subsampled components, colour transforms of vendors, a height that
//! comes after the image, and part 2 of the standard.
//!
//! Overview: `stream` reads bytes and coded bits, `frame` the marker segments, `parameters` derives the coding
//! parameters; `scan` turns coded bits into lines of one scan, and this file puts scans together into rows.

#[cfg(test)]
#[path = "../../../tests/it/common/codec/jpegls.rs"]
mod encoder;
mod frame;
mod parameters;
mod scan;
mod stream;
#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "samples of small test images")]
mod tests;
#[cfg(test)]
#[path = "../../../tests/it/common/codec/jpegls_vectors.rs"]
mod vectors;

use std::io::Read;

use super::{CodecError, FrameFormat, RowSink};
use crate::codec::{damaged, unsupported};
use frame::{Frame, Header, Interleave, SOI, Scan};
use parameters::Parameters;
use scan::{Coder, Lines, line_bytes};
use stream::Stream;

/// The read buffer, the contexts of a scan, and small lists.
const FIXED_BYTES: u64 = 16 << 10;

/// Decodes one JPEG-LS image; samples are unsigned.
///
/// One pass over the input; what follows the last coded sample is not read. Held are a buffer of 8 KiB, the
/// contexts of a scan (6 KiB), two lines of each component of a scan (5 bytes a sample) and one row (4 bytes
/// a sample). Where components come in several scans, all but those of the last scan are held whole, 2 bytes
/// a sample.
///
/// # Errors
/// The codestream is damaged or of a kind named above, it needs more than `memory_bytes`, or the input or
/// `sink` fails. Rows already handed over were sound as far as the format can tell: JPEG-LS has no checksum.
pub(crate) fn decode(
    input: &mut dyn Read,
    memory_bytes: u64,
    sink: &mut dyn RowSink,
) -> Result<(), CodecError> {
    let mut stream = Stream::new(input);
    if stream.marker()? != SOI {
        return Err(damaged("it does not begin as a JPEG image"));
    }
    let mut header = Header::default();
    let code = stream.marker()?;
    let mut scan = header.next_scan(&mut stream, code)?;
    let Some(frame) = header.frame.clone() else {
        return Err(damaged("its scan has no frame header"));
    };
    sink.begin(&FrameFormat {
        columns: frame.columns,
        rows: frame.rows,
        components: u8::try_from(frame.components.len()).unwrap_or(u8::MAX),
        precision: frame.precision,
        signed: false,
    })?;
    let mut image = Image::new(frame, memory_bytes)?;
    loop {
        let parameters = Parameters::new(image.frame.precision, scan.near, &header.preset)?;
        if image.scan(&mut stream, &scan, &parameters, header.restart_lines, sink)? {
            return Ok(());
        }
        let code = stream.end_bits()?;
        scan = header.next_scan(&mut stream, code)?;
    }
}

/// The components decoded so far.
struct Image {
    frame: Frame,
    columns: usize,
    memory_bytes: u64,
    /// Samples of the components that are decoded, while others are to come.
    planes: Vec<Option<Vec<u16>>>,
}

impl Image {
    fn new(frame: Frame, memory_bytes: u64) -> Result<Image, CodecError> {
        let columns = usize::try_from(frame.columns)
            .map_err(|_| unsupported(format!("lines of {} samples", frame.columns)))?;
        let planes = frame.components.iter().map(|_| None).collect();
        Ok(Image { frame, columns, memory_bytes, planes })
    }

    /// Bytes that one component takes as a whole.
    fn plane_bytes(&self) -> u64 {
        (u64::from(self.frame.columns) * u64::from(self.frame.rows)).saturating_mul(2)
    }

    /// Decodes one scan. True after the last: its rows went to the sink, joined with those held.
    fn scan(
        &mut self,
        stream: &mut Stream<'_>,
        scan: &Scan,
        parameters: &Parameters,
        restart_lines: u32,
        sink: &mut dyn RowSink,
    ) -> Result<bool, CodecError> {
        if scan.components.iter().any(|&place| self.planes.get(place).is_none_or(Option::is_some)) {
            return Err(damaged("a component comes in two scans"));
        }
        let held = self.planes.iter().flatten().count();
        let last = held + scan.components.len() == self.planes.len();
        let holds = held + if last { 0 } else { scan.components.len() };
        let line_bytes = line_bytes(self.frame.columns) * scan.components.len() as u64;
        let row_bytes = if last { 4 * u64::from(self.frame.columns) * self.planes.len() as u64 } else { 0 };
        let needed_bytes = self
            .plane_bytes()
            .saturating_mul(holds as u64)
            .saturating_add(FIXED_BYTES + line_bytes + row_bytes);
        if needed_bytes > self.memory_bytes {
            return Err(CodecError::Memory { needed_bytes, allowed_bytes: self.memory_bytes });
        }
        let new_planes: Vec<usize> = if last { Vec::new() } else { scan.components.clone() };
        for &place in &new_planes {
            if let Some(plane) = self.planes.get_mut(place) {
                *plane = Some(Vec::with_capacity(self.columns * self.frame.rows as usize));
            }
        }
        let mut row = vec![0; if last { self.columns * self.planes.len() } else { 0 }];
        let mut lines: Vec<Lines> = scan.components.iter().map(|_| Lines::new(self.columns)).collect();
        let mut coder = Coder::new(parameters);
        stream.begin_bits();
        for y in 0..self.frame.rows {
            if restart_lines > 0 && y > 0 && y % restart_lines == 0 {
                restart(stream, y / restart_lines)?;
                coder.reset(&mut lines);
            }
            match scan.interleave {
                Interleave::Line => {
                    lines.iter_mut().try_for_each(|component| coder.line(stream, component))?;
                }
                Interleave::Sample => coder.pixels(stream, &mut lines)?,
            }
            if last {
                self.join(y, scan, &lines, &mut row);
                sink.row(&row)?;
            } else {
                for (&place, component) in new_planes.iter().zip(&lines) {
                    if let Some(Some(plane)) = self.planes.get_mut(place) {
                        plane.extend_from_slice(component.samples());
                    }
                }
            }
        }
        Ok(last)
    }

    /// Puts the samples of row `y` side by side: the scan's from its lines, the others from the held planes.
    fn join(&self, y: u32, scan: &Scan, lines: &[Lines], row: &mut [i32]) {
        let count = self.planes.len();
        for (component, plane) in self.planes.iter().enumerate() {
            let samples = match plane {
                Some(plane) => plane.chunks_exact(self.columns).nth(y as usize),
                None => {
                    let coded = scan.components.iter().position(|&place| place == component);
                    coded.and_then(|coded| lines.get(coded)).map(Lines::samples)
                }
            };
            let to = row.iter_mut().skip(component).step_by(count);
            for (to, &from) in to.zip(samples.unwrap_or_default()) {
                *to = i32::from(from);
            }
        }
    }
}

/// Passes the restart marker before interval `interval`, counted from 0.
fn restart(stream: &mut Stream<'_>, interval: u32) -> Result<(), CodecError> {
    // RST0 comes before the second interval; the numbers wrap after RST7.
    let expected = 0xD0 | u8::try_from((interval - 1) % 8).unwrap_or_default();
    let code = stream.end_bits()?;
    if code != expected {
        return Err(damaged(format!("the marker {code:#04x} instead of a restart marker")));
    }
    stream.begin_bits();
    Ok(())
}
