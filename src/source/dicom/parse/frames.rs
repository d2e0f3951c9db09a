//! Position and meaning of every frame of a file (PS3.3 C.7.6.16, functional groups).

use super::Result;
use super::deflated::InflateReader;
use super::element::{Element, ItemReader, Parser, damaged};
use super::header::{DicomHeader, Encoding, numeric};
use super::value::{
    Judgement, Stated, Tag, WrongNumbers, double, long_of, number, numbers, raw_double, text, time_of,
    word_of,
};
use super::window::ReadAt;
use crate::source::dicom::attribute::Attribute;
use crate::source::dicom::parse::error::ScanError;
use crate::source::dicom::parse::syntax::TransferSyntax;
use crate::volume::Endian;

/// Bytes read at a time from the Grid Frame Offset Vector; no number is as long.
const PIECE: usize = 1024;

/// Source of a frame's position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Origin {
    /// The frame, or the file of one frame, states it; or nothing does.
    #[default]
    Stated,
    /// The file's position and the Grid Frame Offset Vector (RT dose).
    Grid,
    /// The file's position, Spacing Between Slices and the order of frames.
    Stepped,
    /// Like [`Origin::Stepped`], with Slice Thickness as the distance.
    StackedByThickness,
    /// Like [`Origin::Stepped`], 1 mm apart, as no distance is stated.
    StackedBlindly,
}

/// Attributes of one frame: from its own functional groups, else the shared ones, else the file's own
/// elements.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameGeometry {
    /// Number of the frame, from 0.
    pub index: u32,
    /// Image Position (Patient): centre of the first pixel in LPS mm.
    pub position: Option<[f64; 3]>,
    /// Source of the position.
    pub origin: Origin,
    /// Image Orientation (Patient): direction along a row, then down a column.
    pub orientation: Option<[f64; 6]>,
    /// Pixel Spacing in mm: between rows, then between columns.
    pub pixel_spacing: Option<[f64; 2]>,
    /// Slice Thickness in mm.
    pub slice_thickness: Option<f64>,
    /// Spacing Between Slices in mm.
    pub spacing_between: Option<f64>,
    /// Rescale Slope.
    pub slope: Option<f64>,
    /// Rescale Intercept.
    pub intercept: Option<f64>,
    /// Slope and intercept of the first Real World Value Mapping, if it is linear.
    pub mapping: Option<(f64, f64)>,
    /// Frame Type, or the file's Image Type; values joined by backslashes.
    pub frame_type: String,
    /// Complex Image Component: `MAGNITUDE`, `PHASE`, ...
    pub complex_component: String,
    /// Stack ID.
    pub stack_id: String,
    /// In-Stack Position Number.
    pub in_stack_position: Option<u32>,
    /// Temporal Position Index (or Identifier).
    pub temporal_position: Option<i32>,
    /// Frame Acquisition Number, or the file's Acquisition Number.
    pub acquisition: Option<i32>,
    /// Effective Echo Time, or the file's Echo Time, in ms.
    pub echo_time: Option<f64>,
    /// Diffusion b-value in s/mm2.
    pub b_value: Option<f64>,
    /// Nominal Cardiac Trigger Delay Time, or the file's Trigger Time, in ms.
    pub trigger_time: Option<f64>,
    /// Referenced Segment Number of a segmentation.
    pub segment: Option<u32>,
    /// Diffusion Gradient Orientation, a unit vector in patient coordinates.
    pub gradient: Option<[f64; 3]>,
    /// Time of Frame Acquisition DateTime, or the file's, as the number HHMMSS.FFFFFF.
    pub acquisition_time: Option<f64>,
    /// The first of the Dimension Index Values; 0 where absent.
    pub dimensions: [u32; 5],
    /// Numbers of the frame in the vectors of nuclear medicine, other than its slice, in the order of
    /// [`super::header::ElementOffsets::frame_vectors`]; 0 where they are absent.
    pub vectors: [u16; 8],
    /// The first attribute with wrong numbers, among those that place the frame, scale its values or distinguish it.
    pub wrong: Option<WrongNumbers>,
    /// The first such attribute with a decimal comma.
    pub comma: Option<Attribute>,
}

/// Calls `each` for every frame of a file, in the order of the file, in constant memory and in one pass
/// over the functional groups. `each` returns false to end early.
///
/// Frames without a functional group get the attributes of the whole file. The number of frames is believed: only
/// [`crate::source::dicom::Image::of`] compares it with the pixels.
///
/// # Errors
/// The functional groups are damaged, or the file cannot be read.
pub fn visit<R: ReadAt + ?Sized>(
    input: &R,
    header: &DicomHeader,
    each: &mut dyn FnMut(&FrameGeometry) -> bool,
) -> Result {
    if header.transfer_syntax == TransferSyntax::Deflated {
        return walk(&InflateReader::new(input, header.dataset)?, header, each);
    }
    walk(input, header, each)
}

fn walk<R: ReadAt + ?Sized>(
    input: &R,
    header: &DicomHeader,
    each: &mut dyn FnMut(&FrameGeometry) -> bool,
) -> Result {
    let mut parser = Parser::new(input)?;
    let frames = header.frames.as_ref().and_then(|frames| frames.as_ref().ok()).map_or(1, |frames| *frames);
    let mut base = FrameGeometry::of_file(header);
    if let Some(at) = header.offsets.detectors.filter(|_| base.position.is_none()) {
        first_item(&mut parser, at, header.encoding, &mut |parser, at, end, encoding| {
            parser.elements(at, end, encoding, &mut |parser, element, _| {
                if matches!(element.tag, 0x0020_0032 | 0x0020_0037) {
                    base.keep(element.tag, parser.value(element)?, encoding.endian);
                }
                Ok(None)
            })
        })?;
    }
    if let Some(at) = header.offsets.shared_groups {
        first_item(&mut parser, at, header.encoding, &mut |parser, at, end, encoding| {
            base.groups(parser, at, end, encoding)
        })?;
    }
    let mut visited = 0;
    if let Some(at) = header.offsets.frame_groups {
        visited = of_groups(&mut parser, at, header.encoding, frames, &base, each)?;
    } else if let Some(at) = header.offsets.grid_offsets.filter(|_| frames > 1) {
        visited = of_grid(&mut parser, at, header.encoding, frames, &mut base, each)?;
    }
    let numbers = if visited == 0 { Numbers::of(&mut parser, header, frames)? } else { Numbers::default() };
    // Slices may state only their thickness, or nothing; frames of a film are not slices.
    let is_film = header.is_film() && numbers.slices.is_none();
    let is_nuclear = header.offsets.detectors.is_some() || numbers.slices.is_some();
    let steps = [
        // In nuclear medicine alone a distance may run against the normal.
        (base.spacing_between.filter(|mm| *mm > 0.0 || is_nuclear), Origin::Stepped),
        (base.slice_thickness.filter(|mm| *mm > 0.0 && !is_film), Origin::StackedByThickness),
        (Some(1.0).filter(|_| !is_film && numbers.slices.is_none()), Origin::StackedBlindly),
    ];
    let step = steps.into_iter().find_map(|(mm, origin)| mm.filter(|mm| *mm != 0.0).map(|mm| (mm, origin)));
    let step = step.filter(|_| visited == 0 && frames > 1);
    let along = step.zip(base.position).zip(base.normal());
    for index in visited..frames {
        base.index = index;
        let steps = numbers.read(&mut parser, &mut base)?;
        if let Some((((step, origin), position), normal)) = along
            && header.offsets.frame_groups.is_none()
        {
            // Nuclear medicine states the distance as thickness.
            let is_numbered = numbers.slices.is_some();
            base.origin = if is_numbered { Origin::Stepped } else { origin };
            base.position = Some([0, 1, 2].map(|i| position[i] + steps * step * normal[i]));
        }
        if !each(&base) {
            break;
        }
    }
    Ok(())
}

/// Vectors that number the frames of nuclear medicine (PS3.3 C.8.4.8) by slice, time, energy window, ...
#[derive(Default)]
struct Numbers {
    vectors: [Option<Vector>; 8],
    slices: Option<Vector>,
    /// Number of the first frame's slice, which lies at the stated position.
    first: u16,
    /// True if numbers of slices fall from there.
    falling: bool,
}

/// One of these vectors.
#[derive(Clone, Copy)]
struct Vector {
    value_at: u64,
    entries: u32,
    endian: Endian,
}

impl Vector {
    fn of<R: ReadAt + ?Sized>(
        parser: &mut Parser<'_, R>,
        at: Option<u64>,
        encoding: Encoding,
    ) -> Result<Option<Self>> {
        let Some(at) = at else { return Ok(None) };
        let element = parser.element(at, encoding)?;
        parser.skip(&element, at, encoding)?;
        let entries = element.length.unwrap_or(0) / 2;
        Ok(Some(Self { value_at: element.value_at, entries, endian: encoding.endian }))
    }

    /// Number of a frame; 0 if absent.
    fn number<R: ReadAt + ?Sized>(self, parser: &mut Parser<'_, R>, frame: u32) -> Result<u16> {
        if frame >= self.entries {
            return Ok(0);
        }
        let bytes = parser.window.array::<2>(self.value_at + 2 * u64::from(frame))?.unwrap_or_default();
        Ok(word_of(&bytes, self.endian).unwrap_or_default())
    }
}

impl Numbers {
    fn of<R: ReadAt + ?Sized>(parser: &mut Parser<'_, R>, header: &DicomHeader, frames: u32) -> Result<Self> {
        let mut own = Self {
            slices: Vector::of(parser, header.offsets.slice_vector, header.encoding)?,
            ..Self::default()
        };
        for (vector, place) in own.vectors.iter_mut().zip(header.offsets.frame_vectors) {
            *vector = Vector::of(parser, place, header.encoding)?;
        }
        if let Some(slices) = own.slices {
            if slices.entries < frames {
                let damage =
                    format!("the Slice Vector (0054,0080) numbers {} of {frames} frames", slices.entries);
                return Err(damaged(slices.value_at, damage));
            }
            own.first = slices.number(parser, 0)?;
            for frame in 1..frames.min(slices.entries) {
                let number = slices.number(parser, frame)?;
                if number != own.first {
                    own.falling = number < own.first;
                    break;
                }
            }
        }
        Ok(own)
    }

    /// Stores a frame's numbers from the vectors; returns its distance from the first slice, in slices.
    fn read<R: ReadAt + ?Sized>(&self, parser: &mut Parser<'_, R>, frame: &mut FrameGeometry) -> Result<f64> {
        for (number, vector) in frame.vectors.iter_mut().zip(self.vectors) {
            *number = vector.map_or(Ok(0), |vector| vector.number(parser, frame.index))?;
        }
        let Some(slices) = self.slices else { return Ok(frame.index.into()) };
        let number = slices.number(parser, frame.index)?;
        let away = f64::from(number) - f64::from(self.first);
        Ok(if self.falling { -away } else { away })
    }
}

/// Visits the frames that have a group of their own; returns their number, all frames if `each` ended the walk.
fn of_groups<R: ReadAt + ?Sized>(
    parser: &mut Parser<'_, R>,
    at: u64,
    encoding: Encoding,
    frames: u32,
    base: &FrameGeometry,
    each: &mut dyn FnMut(&FrameGeometry) -> bool,
) -> Result<u32> {
    let sequence = parser.element(at, encoding)?;
    let mut visited = 0;
    let mut frame = base.clone();
    let walked = parser.items(&sequence, at, encoding, &mut |parser, at, end, encoding| {
        if visited == frames {
            return Err(ENOUGH);
        }
        frame.clone_from(base);
        frame.index = visited;
        let after = frame.groups(parser, at, end, encoding)?;
        visited += 1;
        if each(&frame) {
            return Ok(after);
        }
        visited = frames;
        Err(ENOUGH)
    });
    match walked {
        Err(ScanError::NotDicom) | Ok(_) => Ok(visited),
        Err(e) => Err(e),
    }
}

/// Ends a walk early; never leaves this file. Nothing that is walked here can raise it.
const ENOUGH: ScanError = ScanError::NotDicom;

/// Frames of an RT dose, by the Grid Frame Offset Vector (PS3.3 C.8.8.3.2): offsets along the normal if
/// the first is 0, else coordinates along z. The first frame lies at the stated position, also where its
/// coordinate says otherwise, and where z is not a normal of the frames. A wrong vector visits none, and is noted in
/// `base`.
fn of_grid<R: ReadAt + ?Sized>(
    parser: &mut Parser<'_, R>,
    at: u64,
    encoding: Encoding,
    frames: u32,
    base: &mut FrameGeometry,
    each: &mut dyn FnMut(&FrameGeometry) -> bool,
) -> Result<u32> {
    let element = parser.element(at, encoding)?;
    let end = parser.skip(&element, at, encoding)?;
    let count = usize::try_from(frames).unwrap_or(usize::MAX);
    let stated = Stated { attribute: Attribute::GridOffsets, count: Some(count), whole: false };
    let (mut at, mut found, mut wrong) = (element.value_at, 0, None);
    while at <= end && found <= frames && wrong.is_none() {
        let (value, next) = next_value(parser, at, end)?;
        wrong = number(value.as_bytes()).is_none().then(|| stated.wrong(&value));
        base.comma = base.comma.or(value.contains(',').then_some(Attribute::GridOffsets));
        (at, found) = (next, found + 1);
    }
    if wrong.is_none() && found != frames {
        let most = PIECE.min(usize::try_from(end - element.value_at).unwrap_or(PIECE));
        wrong = Some(stated.wrong(&text(parser.window.upto(element.value_at, most)?)));
    }
    if wrong.is_some() {
        base.wrong = base.wrong.take().or(wrong);
        return Ok(0);
    }
    let Some((position, normal)) = base.position.zip(base.normal()) else { return Ok(0) };
    let mut frame = base.clone();
    frame.origin = Origin::Grid;
    let axial = normal[2].abs() > 1.0 - 1e-6;
    let mut at = element.value_at;
    let mut first = None;
    for index in 0..frames {
        let (value, next) = next_value(parser, at, end)?;
        let Some(offset) = number(value.as_bytes()) else { return Ok(0) };
        at = next;
        frame.index = index;
        let first = *first.get_or_insert(offset);
        let direction = if first != 0.0 && axial { [0.0, 0.0, 1.0] } else { normal };
        frame.position = Some([0, 1, 2].map(|i| position[i] + (offset - first) * direction[i]));
        if !each(&frame) {
            return Ok(frames);
        }
    }
    Ok(frames)
}

/// The value at `at` in a list of them that ends at `end`, and the place of the next one.
fn next_value<R: ReadAt + ?Sized>(parser: &mut Parser<'_, R>, at: u64, end: u64) -> Result<(String, u64)> {
    let most = PIECE.min(usize::try_from(end.saturating_sub(at)).unwrap_or(PIECE));
    let piece = parser.window.upto(at, most)?;
    let length = piece.iter().position(|b| *b == b'\\').unwrap_or(piece.len());
    Ok((text(&piece[..length]), at + length as u64 + 1))
}

/// Reads the first item of the sequence at `at`, steps over the others, and returns the offset after it.
fn first_item<'a, R: ReadAt + ?Sized>(
    parser: &mut Parser<'a, R>,
    at: u64,
    encoding: Encoding,
    read: &mut ItemReader<'_, 'a, R>,
) -> Result<u64> {
    let sequence = parser.element(at, encoding)?;
    first_item_of(parser, &sequence, at, encoding, read)
}

fn first_item_of<'a, R: ReadAt + ?Sized>(
    parser: &mut Parser<'a, R>,
    sequence: &Element,
    at: u64,
    encoding: Encoding,
    read: &mut ItemReader<'_, 'a, R>,
) -> Result<u64> {
    let mut first = true;
    parser.items(sequence, at, encoding, &mut |parser, at, end, encoding| {
        if std::mem::take(&mut first) {
            return read(parser, at, end, encoding);
        }
        parser.elements(at, end, encoding, &mut |_, _, _| Ok(None))
    })
}

/// Diffusion Gradient Direction Sequence, inside the MR Diffusion Sequence.
const DIFFUSION_DIRECTION: Tag = 0x0018_9076;

/// True for a functional group that tells the position or content of a frame.
fn is_group(tag: Tag) -> bool {
    matches!(
        tag,
        0x0018_9114 // MR Echo
            | 0x0018_9117 // MR Diffusion
            | 0x0018_9118 // Cardiac Synchronization
            | 0x0018_9226 // MR Image Frame Type
            | 0x0018_9329 // CT Image Frame Type
            | 0x0018_9504 // X-Ray 3D Frame Type
            | 0x0018_9751 // PET Frame Type
            | 0x0020_930e // Plane Position (Volume)
            | 0x0020_930f // Plane Orientation (Volume)
            | 0x0020_9111 // Frame Content
            | 0x0020_9113 // Plane Position
            | 0x0020_9116 // Plane Orientation
            | 0x0028_9110 // Pixel Measures
            | 0x0028_9145 // Pixel Value Transformation
            | 0x0040_9096 // Real World Value Mapping
            | 0x0062_000a // Segment Identification
    )
}

impl FrameGeometry {
    /// Attributes that the file states for all frames, or for its only one.
    pub(crate) fn of_file(header: &DicomHeader) -> Self {
        Self {
            position: header.position,
            orientation: header.orientation,
            pixel_spacing: header.pixel_spacing,
            slice_thickness: header.slice_thickness,
            spacing_between: header.spacing_between,
            slope: header.slope,
            intercept: header.intercept,
            frame_type: header.image_type.clone(),
            complex_component: header.complex_component.clone(),
            temporal_position: header.temporal_position,
            acquisition: header.acquisition,
            echo_time: header.echo_time,
            b_value: header.b_value,
            trigger_time: header.trigger_time,
            gradient: header.gradient,
            acquisition_time: header.acquisition_time,
            wrong: header.wrong.clone(),
            comma: header.comma,
            ..Self::default()
        }
    }

    /// Unit vector along rows x columns.
    fn normal(&self) -> Option<[f64; 3]> {
        let [a, b, c, d, e, f] = self.orientation?;
        let cross = [b * f - c * e, c * d - a * f, a * e - b * d];
        let length = cross.iter().map(|v| v * v).sum::<f64>().sqrt();
        (length > 0.5).then(|| cross.map(|v| v / length))
    }

    /// Takes over the functional groups of one item.
    fn groups<R: ReadAt + ?Sized>(
        &mut self,
        parser: &mut Parser<'_, R>,
        at: u64,
        end: Option<u64>,
        encoding: Encoding,
    ) -> Result<u64> {
        parser.elements(at, end, encoding, &mut |parser, group, at| {
            if !is_group(group.tag) {
                return Ok(None);
            }
            let mut read = |parser: &mut Parser<'_, R>, at, end, encoding: Encoding| {
                parser.elements(at, end, encoding, &mut |parser, element, at| {
                    if element.tag == DIFFUSION_DIRECTION {
                        let mut inner = |parser: &mut Parser<'_, R>, at, end, encoding: Encoding| {
                            parser.elements(at, end, encoding, &mut |parser, element, _| {
                                self.keep(element.tag, parser.value(element)?, encoding.endian);
                                Ok(None)
                            })
                        };
                        return first_item_of(parser, element, at, encoding, &mut inner).map(Some);
                    }
                    self.keep(element.tag, parser.value(element)?, encoding.endian);
                    Ok(None)
                })
            };
            first_item_of(parser, group, at, encoding, &mut read).map(Some)
        })
    }

    /// Takes over one element of a functional group.
    fn keep(&mut self, tag: Tag, value: &[u8], endian: Endian) {
        let doubles_of = |attribute, count| {
            Stated { attribute, count: Some(count), whole: false }.judge_doubles(value, endian)
        };
        let judgement = match tag {
            0x0020_9301 => doubles_of(Attribute::Position, 3),
            0x0020_9302 => doubles_of(Attribute::Orientation, 6),
            _ => numeric(tag).map_or(Judgement::Sound, |numbers| numbers.judge(value)),
        };
        match judgement {
            Judgement::Sound => {}
            Judgement::Comma(attribute) => self.comma = self.comma.or(Some(attribute)),
            Judgement::Wrong(wrong) => _ = self.wrong.get_or_insert(wrong),
        }
        let word = || word_of(value, endian);
        let long = || long_of(value, endian);
        match tag {
            0x0008_9007 => self.frame_type = text(value),
            0x0008_9208 => self.complex_component = text(value),
            0x0018_0050 => self.slice_thickness = number(value),
            0x0018_0088 => self.spacing_between = number(value),
            0x0018_9082 => self.echo_time = double(value, endian),
            0x0018_9074 => self.acquisition_time = time_of(value),
            0x0018_9087 => self.b_value = double(value, endian),
            0x0018_9089 => self.gradient = doubles(value, endian),
            0x0020_0032 => self.position = numbers(value),
            0x0020_0037 => self.orientation = numbers(value),
            0x0020_9056 => self.stack_id = text(value),
            0x0020_9057 => self.in_stack_position = long(),
            0x0020_9128 => self.temporal_position = long().and_then(|n| i32::try_from(n).ok()),
            0x0020_9153 => self.trigger_time = double(value, endian),
            0x0020_9156 => self.acquisition = word().map(i32::from),
            0x0020_9157 => {
                for (slot, bytes) in self.dimensions.iter_mut().zip(value.as_chunks::<4>().0) {
                    *slot = long_of(bytes, endian).unwrap_or_default();
                }
            }
            0x0020_9301 => self.position = doubles(value, endian),
            0x0020_9302 => self.orientation = doubles(value, endian),
            0x0028_0030 => self.pixel_spacing = numbers(value),
            0x0028_1052 => self.intercept = number(value),
            0x0028_1053 => self.slope = number(value),
            0x0040_9224 => {
                let slope = self.mapping.map_or(1.0, |(slope, _)| slope);
                self.mapping = raw_double(value, endian).map(|intercept| (slope, intercept));
            }
            0x0040_9225 => {
                let intercept = self.mapping.map_or(0.0, |(_, intercept)| intercept);
                self.mapping = raw_double(value, endian).map(|slope| (slope, intercept));
            }
            0x0062_000b => self.segment = word().map(u32::from),
            _ => {}
        }
    }
}

/// Exactly `N` finite binary doubles.
fn doubles<const N: usize>(value: &[u8], endian: Endian) -> Option<[f64; N]> {
    let mut out = [0.0; N];
    for (slot, bytes) in out.iter_mut().zip(value.chunks(8)) {
        *slot = double(bytes, endian)?;
    }
    (value.len() == 8 * N).then_some(out)
}
