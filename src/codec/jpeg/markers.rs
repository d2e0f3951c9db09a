//! Marker segments (T.81, annex B): tables, the frame, and the scans.

use super::super::{CodecError, FrameFormat};
use super::bytes::{Bytes, ends_early};
use super::dct::{Steps, ZIGZAG};
use super::huffman::Huffman;
use crate::codec::{damaged, unsupported};

/// T.81 B.2.3: an interleaved scan has at most this many data units in one MCU.
const MAX_UNITS_IN_MCU: u32 = 10;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Process {
    /// Baseline and extended sequential DCT (SOF0, SOF1).
    Sequential,
    /// Progressive DCT (SOF2).
    Progressive,
    /// Lossless prediction (SOF3).
    Lossless,
}

#[derive(Clone, Debug)]
pub(super) struct Component {
    id: u8,
    /// Samples for each `h_max` columns of the image.
    pub(super) h: u32,
    /// Samples for each `v_max` rows of the image.
    pub(super) v: u32,
    /// Slot of its quantisation table.
    pub(super) steps: usize,
}

#[derive(Clone, Debug)]
pub(super) struct Frame {
    pub(super) process: Process,
    pub(super) precision: u8,
    pub(super) rows: u32,
    pub(super) columns: u32,
    /// One to four components.
    pub(super) components: Vec<Component>,
    pub(super) h_max: u32,
    pub(super) v_max: u32,
}

/// One component of a scan, with the slots of its Huffman tables.
#[derive(Clone, Copy, Debug)]
pub(super) struct ScanComponent {
    pub(super) index: usize,
    pub(super) dc: usize,
    pub(super) ac: usize,
}

#[derive(Clone, Debug)]
pub(super) struct Scan {
    /// One to four components, all different.
    pub(super) components: Vec<ScanComponent>,
    /// First coefficient of the band; the predictor of a lossless scan.
    pub(super) start: u8,
    /// Last coefficient of the band.
    pub(super) end: u8,
    /// Bit position of the previous scan, for a refinement; else 0.
    pub(super) high: u8,
    /// Bit position of this scan; the point transform of a lossless one.
    pub(super) low: u8,
}

#[derive(Default)]
pub(super) struct Tables {
    steps: [Option<Box<Steps>>; 4],
    dc: [Option<Box<Huffman>>; 4],
    ac: [Option<Box<Huffman>>; 4],
    /// MCUs between two restart markers, or 0.
    pub(super) restart_interval: u32,
}

/// Content of a segment that the decoder must act upon.
pub(super) enum Event {
    Frame(Frame),
    Scan(Scan),
    /// End of the image; `marked` if a marker states it, not only the end of the input.
    End {
        marked: bool,
    },
}

impl Frame {
    /// The format for the receiver.
    pub(super) fn format(&self) -> FrameFormat {
        FrameFormat {
            columns: self.columns,
            rows: self.rows,
            // Four at most.
            components: self.components.len().to_le_bytes()[0],
            precision: self.precision,
            signed: false,
        }
    }

    fn read(bytes: &mut Bytes<'_>, process: Process, baseline: bool) -> Result<Self, CodecError> {
        let mut segment = bytes.segment()?;
        let precision = segment.byte()?;
        let legal = match process {
            Process::Lossless => (2..=16).contains(&precision),
            _ => precision == 8 || (precision == 12 && !baseline),
        };
        if !legal {
            return Err(unsupported(format!("JPEG with {precision} bits in a sample")));
        }
        let (rows, columns) = (u32::from(segment.pair()?), u32::from(segment.pair()?));
        if columns == 0 {
            return Err(damaged("its width is 0"));
        }
        if rows == 0 {
            return Err(unsupported("a JPEG height given only after the pixels (DNL)"));
        }
        let count = segment.byte()?;
        match count {
            0 => return Err(damaged("it has no components")),
            1..=4 => {}
            _ => return Err(unsupported(format!("JPEG with {count} components"))),
        }
        let mut components: Vec<Component> = Vec::with_capacity(4);
        for _ in 0..count {
            let id = segment.byte()?;
            let (h, v) = segment.nibbles()?;
            let steps = usize::from(segment.byte()?);
            if !(1..=4).contains(&h) || !(1..=4).contains(&v) {
                return Err(damaged(format!("component {id} of the frame makes no sense")));
            }
            if components.iter().any(|other| other.id == id) {
                return Err(damaged(format!("component {id} comes twice in the frame")));
            }
            components.push(Component { id, h: h.into(), v: v.into(), steps });
        }
        segment.skip()?;
        if let [only] = &mut components[..] {
            // A single component's factors have no effect: it is coded row by row of units for all factors (A.2.2).
            (only.h, only.v) = (1, 1);
        }
        let h_max = components.iter().map(|c| c.h).max().unwrap_or(1);
        let v_max = components.iter().map(|c| c.v).max().unwrap_or(1);
        Ok(Self { process, precision, rows, columns, components, h_max, v_max })
    }
}

impl Scan {
    fn read(bytes: &mut Bytes<'_>, frame: &Frame) -> Result<Self, CodecError> {
        let mut segment = bytes.segment()?;
        let count = segment.byte()?;
        if !(1..=4).contains(&count) {
            return Err(damaged(format!("a scan has {count} components")));
        }
        let mut components: Vec<ScanComponent> = Vec::with_capacity(4);
        for _ in 0..count {
            let id = segment.byte()?;
            let (dc, ac) = segment.nibbles()?;
            let index =
                frame.components.iter().position(|c| c.id == id).ok_or_else(|| {
                    damaged(format!("a scan names component {id}, which the frame has not"))
                })?;
            if components.iter().any(|other| other.index == index) {
                return Err(damaged(format!("a scan names component {id} twice")));
            }
            components.push(ScanComponent { index, dc: dc.into(), ac: ac.into() });
        }
        let (start, end) = (segment.byte()?, segment.byte()?);
        let (high, low) = segment.nibbles()?;
        segment.skip()?;
        let units = |c: &ScanComponent| frame.components.get(c.index).map_or(0, |c| c.h * c.v);
        if count > 1 && components.iter().map(units).sum::<u32>() > MAX_UNITS_IN_MCU {
            return Err(damaged(format!("a scan has more than {MAX_UNITS_IN_MCU} units in an MCU")));
        }
        Ok(Self { components, start, end, high, low })
    }
}

impl Tables {
    /// Memory of all tables together.
    pub(super) const MAX_BYTES: u64 = 8 * size_of::<Huffman>() as u64 + 4 * size_of::<Steps>() as u64;

    /// Reads segments up to the next one that is more than a table; the first marker may be read already.
    pub(super) fn next(
        &mut self,
        bytes: &mut Bytes<'_>,
        mut marker: Option<u8>,
        frame: Option<&Frame>,
    ) -> Result<Event, CodecError> {
        loop {
            let code = match marker.take() {
                Some(code) => code,
                None => match bytes.marker()? {
                    Some(code) => code,
                    None => return Ok(Event::End { marked: false }),
                },
            };
            let process = match code {
                0xC0 | 0xC1 => Process::Sequential,
                0xC2 => Process::Progressive,
                0xC3 => Process::Lossless,
                0xC4 => {
                    self.read_huffman(bytes)?;
                    continue;
                }
                0xDB => {
                    self.read_steps(bytes)?;
                    continue;
                }
                0xDD => {
                    let mut segment = bytes.segment()?;
                    self.restart_interval = segment.pair()?.into();
                    segment.skip()?;
                    continue;
                }
                0xD9 => return Ok(Event::End { marked: true }),
                0xDA => {
                    let frame = frame.ok_or_else(|| damaged("a scan comes before the frame header"))?;
                    return Scan::read(bytes, frame).map(Event::Scan);
                }
                0xC9..=0xCB => return Err(unsupported("arithmetic coding (JPEG)")),
                0xC5..=0xC7 | 0xCD..=0xCF | 0xDE | 0xDF => return Err(unsupported("hierarchical JPEG")),
                0xF7 => return Err(unsupported("JPEG-LS inside a JPEG transfer syntax")),
                0xD8 => return Err(damaged("another image begins before it is complete")),
                // Restart markers behind a scan, and TEM, stand alone.
                0x01 | 0xD0..=0xD7 => continue,
                // Application data, comments, conditioning of arithmetic coding, a height that is already known.
                0xCC | 0xDC | 0xE0..=0xEF | 0xFE => {
                    bytes.segment()?.skip()?;
                    continue;
                }
                _ => return Err(damaged(format!("it holds the unknown marker 0x{code:02X}"))),
            };
            if frame.is_some() {
                return Err(damaged("it has two frame headers"));
            }
            return Frame::read(bytes, process, code == 0xC0).map(Event::Frame);
        }
    }

    fn read_huffman(&mut self, bytes: &mut Bytes<'_>) -> Result<(), CodecError> {
        let mut segment = bytes.segment()?;
        while segment.left() > 0 {
            let (class, slot) = segment.nibbles()?;
            let tables = match class {
                0 => &mut self.dc,
                1 => &mut self.ac,
                _ => return Err(damaged(format!("a Huffman table has the class {class}"))),
            };
            let place = tables
                .get_mut(usize::from(slot))
                .ok_or_else(|| damaged(format!("a Huffman table has the number {slot}")))?;
            *place = Some(Box::new(Huffman::read(&mut segment)?));
        }
        Ok(())
    }

    fn read_steps(&mut self, bytes: &mut Bytes<'_>) -> Result<(), CodecError> {
        let mut segment = bytes.segment()?;
        while segment.left() > 0 {
            let (wide, slot) = segment.nibbles()?;
            let mut steps = [0; 64];
            for at in ZIGZAG {
                let step = if wide == 0 { segment.byte()?.into() } else { segment.pair()? };
                steps[usize::from(at)] = step;
            }
            let place = self.steps.get_mut(usize::from(slot));
            match place {
                Some(place) if wide < 2 && !steps.contains(&0) => *place = Some(Box::new(steps)),
                _ => return Err(damaged("a quantisation table makes no sense")),
            }
        }
        Ok(())
    }

    /// The Huffman table of DC differences (or lossless ones) that a scan names.
    pub(super) fn dc(&self, slot: usize) -> Result<&Huffman, CodecError> {
        self.dc
            .get(slot)
            .and_then(Option::as_deref)
            .ok_or_else(|| damaged("a Huffman table that it needs is missing"))
    }

    /// The Huffman table of AC coefficients that a scan names.
    pub(super) fn ac(&self, slot: usize) -> Result<&Huffman, CodecError> {
        self.ac
            .get(slot)
            .and_then(Option::as_deref)
            .ok_or_else(|| damaged("a Huffman table that it needs is missing"))
    }

    /// The quantisation table that a component names.
    pub(super) fn steps(&self, slot: usize) -> Result<&Steps, CodecError> {
        self.steps
            .get(slot)
            .and_then(Option::as_deref)
            .ok_or_else(|| damaged("a quantisation table that it needs is missing"))
    }
}

/// Passes over the marker that every image begins with.
pub(super) fn start(bytes: &mut Bytes<'_>) -> Result<(), CodecError> {
    match (bytes.next()?, bytes.next()?) {
        (Some(0xFF), Some(0xD8)) => Ok(()),
        (_, None) => Err(ends_early()),
        _ => Err(damaged("it does not begin as a JPEG image does")),
    }
}
