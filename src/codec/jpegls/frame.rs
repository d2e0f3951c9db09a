//! Marker segments before a scan: the frame, its preset parameters, and the components of each scan.

use super::parameters::Preset;
use super::stream::Stream;
use crate::codec::{CodecError, damaged, unsupported};

/// Most components that are decoded.
pub(super) const MAX_COMPONENTS: usize = 4;

/// Start of the image.
pub(super) const SOI: u8 = 0xD8;
/// End of the image.
const EOI: u8 = 0xD9;
/// Start of a scan.
const SOS: u8 = 0xDA;
/// Number of lines, after the first scan.
const DNL: u8 = 0xDC;
/// Restart interval.
const DRI: u8 = 0xDD;
/// The frame of a JPEG-LS image.
const SOF_55: u8 = 0xF7;
/// Preset parameters of JPEG-LS.
const LSE: u8 = 0xF8;
/// The application segment that vendors keep colour transforms in.
const APP8: u8 = 0xE8;

/// Interleave mode of a scan's components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Interleave {
    /// One component, or one line of each component in turn.
    Line,
    /// One sample of each component in turn.
    Sample,
}

#[derive(Clone, Debug)]
pub(super) struct Frame {
    pub(super) precision: u8,
    pub(super) columns: u32,
    pub(super) rows: u32,
    pub(super) components: Vec<u8>,
}

#[derive(Clone, Debug)]
pub(super) struct Scan {
    /// Places in [`Frame::components`], in the order of coding.
    pub(super) components: Vec<usize>,
    pub(super) near: u8,
    pub(super) interleave: Interleave,
}

/// The content of the marker segments so far.
#[derive(Debug, Default)]
pub(super) struct Header {
    pub(super) frame: Option<Frame>,
    pub(super) preset: Preset,
    /// Lines between restart markers; 0 without restart markers.
    pub(super) restart_lines: u32,
    /// Columns and rows too large for the frame header.
    oversize: Option<(u32, u32)>,
}

/// The marker segment that is being read, with the number of its bytes left.
struct Segment<'s, 'a> {
    stream: &'s mut Stream<'a>,
    left: u32,
    kind: &'static str,
}

impl<'s, 'a> Segment<'s, 'a> {
    fn begin(stream: &'s mut Stream<'a>, kind: &'static str) -> Result<Segment<'s, 'a>, CodecError> {
        let length = stream.word()?;
        let left = u32::from(length).checked_sub(2).ok_or_else(|| wrong_length(kind))?;
        Ok(Segment { stream, left, kind })
    }

    fn byte(&mut self) -> Result<u8, CodecError> {
        self.left = self.left.checked_sub(1).ok_or_else(|| wrong_length(self.kind))?;
        self.stream.byte()
    }

    /// A number of `bytes` bytes, at most 4.
    fn number(&mut self, bytes: u32) -> Result<u32, CodecError> {
        (0..bytes).try_fold(0_u32, |value, _| Ok(value << 8 | u32::from(self.byte()?)))
    }

    fn skip(&mut self) -> Result<(), CodecError> {
        while self.left > 0 {
            self.byte()?;
        }
        Ok(())
    }

    fn end(&self) -> Result<(), CodecError> {
        if self.left == 0 { Ok(()) } else { Err(wrong_length(self.kind)) }
    }
}

fn wrong_length(segment: &'static str) -> CodecError {
    damaged(format!("the segment of {segment} has a wrong length"))
}

impl Header {
    /// Reads marker segments up to the next scan, from the marker `code` on.
    pub(super) fn next_scan(&mut self, stream: &mut Stream<'_>, mut code: u8) -> Result<Scan, CodecError> {
        loop {
            match code {
                SOS => return self.scan(stream),
                EOI => return Err(damaged("it ends before all its components came")),
                SOF_55 => self.frame(stream)?,
                LSE => self.preset(stream)?,
                DRI => {
                    let mut segment = Segment::begin(stream, "the restart interval")?;
                    if !(2..=4).contains(&segment.left) {
                        return Err(wrong_length(segment.kind));
                    }
                    self.restart_lines = segment.number(segment.left)?;
                }
                DNL => return Err(unsupported("a number of lines after the first scan")),
                0xC4 => Segment::begin(stream, "Huffman tables")?.skip()?,
                0xCC => Segment::begin(stream, "arithmetic conditioning")?.skip()?,
                0xF9 => return Err(unsupported("the extensions of JPEG-LS part 2")),
                0xC0..=0xCF => return Err(unsupported(format!("the JPEG process SOF{}", code - 0xC0))),
                APP8 => colour_transform(stream)?,
                0xE0..=0xEF | 0xFE => Segment::begin(stream, "application data")?.skip()?,
                _ => return Err(damaged(format!("the marker {code:#04x} is out of place"))),
            }
            code = stream.marker()?;
        }
    }

    /// Reads SOF55 (T.87 section C.2.2).
    fn frame(&mut self, stream: &mut Stream<'_>) -> Result<(), CodecError> {
        if self.frame.is_some() {
            return Err(damaged("it has two frame headers"));
        }
        let mut segment = Segment::begin(stream, "the frame")?;
        let precision = segment.byte()?;
        let rows = segment.number(2)?;
        let columns = segment.number(2)?;
        let count = usize::from(segment.byte()?);
        if !(2..=16).contains(&precision) {
            return Err(damaged(format!("{precision} bits per sample, where 2 to 16 are possible")));
        }
        if count == 0 {
            return Err(damaged("it has no components"));
        }
        if count > MAX_COMPONENTS {
            return Err(unsupported(format!("{count} components")));
        }
        let mut components = Vec::with_capacity(count);
        for _ in 0..count {
            let identifier = segment.byte()?;
            let sampling = segment.byte()?;
            segment.byte()?;
            // The sampling factors of a single component have no effect.
            if count > 1 && sampling != 0x11 {
                return Err(unsupported("components of different sizes"));
            }
            if components.contains(&identifier) {
                return Err(damaged("two components have the same identifier"));
            }
            components.push(identifier);
        }
        segment.end()?;
        self.frame = Some(Frame { precision, columns, rows, components });
        Ok(())
    }

    /// Reads LSE (T.87 section C.2.4).
    fn preset(&mut self, stream: &mut Stream<'_>) -> Result<(), CodecError> {
        let mut segment = Segment::begin(stream, "preset parameters")?;
        match segment.byte()? {
            1 => {
                self.preset = Preset {
                    maximum: segment.number(2)?,
                    thresholds: [segment.number(2)?, segment.number(2)?, segment.number(2)?],
                    reset: segment.number(2)?,
                };
            }
            2 | 3 => return Err(unsupported("mapping tables (palettes)")),
            4 => {
                let bytes = u32::from(segment.byte()?);
                if !(2..=4).contains(&bytes) {
                    return Err(damaged(format!("image sizes of {bytes} bytes")));
                }
                let rows = segment.number(bytes)?;
                self.oversize = Some((segment.number(bytes)?, rows));
            }
            kind => return Err(unsupported(format!("preset parameters of type {kind}"))),
        }
        segment.end()
    }

    /// Reads SOS (T.87 section C.2.3).
    fn scan(&mut self, stream: &mut Stream<'_>) -> Result<Scan, CodecError> {
        let Some(frame) = &mut self.frame else { return Err(damaged("its scan has no frame header")) };
        let mut segment = Segment::begin(stream, "the scan")?;
        let count = usize::from(segment.byte()?);
        if count == 0 || count > frame.components.len() {
            return Err(damaged(format!("a scan of {count} components")));
        }
        let mut components = Vec::with_capacity(count);
        for _ in 0..count {
            let identifier = segment.byte()?;
            let Some(place) = frame.components.iter().position(|&other| other == identifier) else {
                return Err(damaged(format!("a scan of the unknown component {identifier}")));
            };
            if components.contains(&place) {
                return Err(damaged(format!("a scan has the component {identifier} twice")));
            }
            components.push(place);
            if segment.byte()? != 0 {
                return Err(unsupported("mapping tables (palettes)"));
            }
        }
        let near = segment.byte()?;
        let interleave = match segment.byte()? {
            0 if count == 1 => Interleave::Line,
            // One component is coded alike in every mode but for the ends of runs.
            1 => Interleave::Line,
            2 if count == 1 => return Err(unsupported("sample interleaving of one component")),
            2 => Interleave::Sample,
            mode => return Err(damaged(format!("the interleave mode {mode} of {count} components"))),
        };
        if segment.byte()? & 0x0F != 0 {
            return Err(unsupported("a point transform"));
        }
        segment.end()?;
        if let Some((columns, rows)) = self.oversize {
            frame.columns = if frame.columns == 0 { columns } else { frame.columns };
            frame.rows = if frame.rows == 0 { rows } else { frame.rows };
        }
        if frame.rows == 0 {
            return Err(unsupported("a number of lines after the first scan"));
        }
        if frame.columns == 0 {
            return Err(damaged("it has no columns"));
        }
        Ok(Scan { components, near, interleave })
    }
}

/// Refuses the colour transforms of one vendor, which are not part of the standard.
fn colour_transform(stream: &mut Stream<'_>) -> Result<(), CodecError> {
    let mut segment = Segment::begin(stream, "application data")?;
    if segment.left == 5 && segment.number(4)? == u32::from_be_bytes(*b"mrfx") {
        let transform = segment.byte()?;
        if transform != 0 {
            return Err(unsupported(format!("the colour transform {transform}")));
        }
    }
    segment.skip()
}
