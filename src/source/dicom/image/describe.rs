//! Kind of a file's pixels, and the way to them: by position, or by decoding
//! (PS3.3 C.7.6.3; PS3.5 section 8 and annex A).

use std::borrow::Cow;
use std::fmt;

use super::pixels::{CellFormat, PixelLayout};
use crate::source::dicom::attribute::Attribute;
use crate::source::dicom::parse::header::{DicomHeader, PixelElement};
use crate::source::dicom::parse::syntax::{Codec, TransferSyntax};
use crate::text::{Count, shown};
use crate::volume::{Endian, Note, ScalarType};

/// Reason why an image cannot be a slice of a volume.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Obstacle {
    /// True if a part of the pixels is missing from a file that was once whole.
    pub(crate) cut_short: bool,
    text: Cow<'static, str>,
}

impl Obstacle {
    pub(crate) fn new(text: impl Into<Cow<'static, str>>) -> Self {
        Self { cut_short: false, text: text.into() }
    }
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Access to the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Row r of frame f begins at byte `offset + f * frame_bytes + r * columns * width` of the file and
    /// becomes samples by [`PixelLayout::decode`].
    Native {
        /// Offset of the first frame.
        offset: u64,
        /// Distance of frames.
        frame_bytes: u64,
    },
    /// Frames must be decoded from front to back: see [`fn@super::unroll::unroll`].
    Unrolled,
}

/// Arrangement of cells in the pixel element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Storage {
    /// Whole bytes, one frame right after the other.
    Plain,
    /// One bit a pixel, no gap between frames.
    Bits,
    /// Fragments of compressed frames.
    Coded(Codec),
}

/// Conversion of cells into delivered samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mapping {
    /// Values are delivered unchanged.
    Values,
    /// Values go through the Modality LUT.
    ModalityLut,
    /// Values go through the palette, then become luminance.
    Palette,
    /// Luminance of red, green and blue.
    Rgb,
    /// The first of three components is luminance.
    Luma,
    /// Like `Luma`, in the native order Y Y Cb Cr of two pixels.
    Luma422,
    /// All components side by side, as stored.
    Components,
}

/// The image (one frame or many) of one file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Image {
    /// Size of a frame and type of the delivered samples.
    pub layout: PixelLayout,
    /// Access by position, or by decoding.
    pub access: Access,
    /// Number of frames, at least 1.
    pub frames: u32,
    /// Bytes of the pixel element that the file has, for all frames.
    pub(crate) held_bytes: u64,
    pub(crate) storage: Storage,
    pub(crate) mapping: Mapping,
    /// Cells a pixel.
    pub(crate) samples: u8,
    /// True if components are stored one plane after another.
    pub(crate) planar: bool,
    /// True if neighbouring bytes are swapped (8-bit cells in big-endian words).
    pub(crate) swapped: bool,
}

impl Image {
    /// Describes the pixels of a file.
    ///
    /// # Errors
    /// The [`Obstacle`] to using it.
    pub fn of(header: &DicomHeader) -> Result<Self, Obstacle> {
        let syntax = &header.transfer_syntax;
        let Some(pixels) = header.pixels else {
            return Err(Obstacle::new(format!("{} without pixels", header.kind())));
        };
        if header.rows.is_none() && header.columns.is_none() && header.bits_allocated.is_none() {
            return Err(Obstacle::new(format!(
                "there are {} bytes of pixel data, but no image description: rows, columns and bits allocated are missing",
                pixels.available
            )));
        }
        let codec = match syntax {
            TransferSyntax::Unknown(_) => {
                return Err(Obstacle::new(format!("pixels in an {syntax} cannot be read")));
            }
            TransferSyntax::Encapsulated(_) => Some(syntax.codec().ok_or_else(|| {
                Obstacle::new(format!("compressed pixels ({syntax}) cannot be read{}", syntax.remedy()))
            })?),
            _ if pixels.declared.is_none() => {
                return Err(Obstacle::new(format!(
                    "the pixels have no length, though {syntax} pixels must have one"
                )));
            }
            _ => None,
        };
        let frames = match &header.frames {
            None => 1,
            Some(Ok(n)) if *n > 0 => *n,
            Some(stated) => {
                let text = stated.as_ref().map_or_else(Clone::clone, u32::to_string);
                return Err(Obstacle::new(format!(
                    "its {} is `{}`, which is not a positive number; correct the header",
                    Attribute::NumberOfFrames,
                    shown(&text)
                )));
            }
        };
        let side = |side: Option<u16>, what| {
            side.filter(|n| *n > 0)
                .ok_or_else(|| Obstacle::new(format!("the image does not state its {what}")))
        };
        let (rows, columns) = (side(header.rows, "rows")?, side(header.columns, "columns")?);
        let allocated = header
            .bits_allocated
            .ok_or_else(|| Obstacle::new("the image does not state its bits allocated"))?;
        let samples = header.samples.unwrap_or(1);
        let mapping = mapping_of(header, samples, codec)?;
        let stored = stored_of(header, allocated, samples)?;
        let storage = match codec {
            Some(_) if stored.is_float() => {
                return Err(Obstacle::new("compressed floating-point pixels cannot be read"));
            }
            Some(_) if allocated == 1 => {
                return Err(Obstacle::new("compressed pixels of one bit cannot be read"));
            }
            Some(codec) => Storage::Coded(codec),
            None if allocated == 1 => Storage::Bits,
            None => Storage::Plain,
        };
        let mut image = Self {
            layout: PixelLayout::new(columns.into(), rows.into(), delivered(mapping, stored), stored),
            access: Access::Unrolled,
            frames,
            held_bytes: pixels.available,
            storage,
            mapping,
            // 1 or 3, see `mapping_of`.
            samples: u8::try_from(samples).unwrap_or(1),
            planar: samples > 1 && header.planar == Some(1) && mapping != Mapping::Luma422,
            swapped: *syntax == TransferSyntax::ExplicitBe && allocated == 8 && pixels.words,
        };
        image.check_length(pixels.available, *syntax == TransferSyntax::Deflated)?;
        let by_position = syntax.is_native()
            && image.storage == Storage::Plain
            && mapping == Mapping::Values
            && !image.swapped;
        if by_position {
            let frame_bytes = image.frame_bytes();
            image.access = Access::Native { offset: pixels.offset, frame_bytes };
        }
        Ok(image)
    }

    /// Like [`Image::of`], but delivers stored values: no table, no luminance. A row then has [`Image::row_samples`]
    /// samples, the components of a pixel side by side, whichever way they were stored.
    ///
    /// # Errors
    /// The errors of [`Image::of`], and subsampled colour.
    pub fn of_components(header: &DicomHeader) -> Result<Self, Obstacle> {
        let mut image = Self::of(header)?;
        if image.mapping == Mapping::Luma422 && image.storage == Storage::Plain {
            return Err(Obstacle::new("subsampled colour as components cannot be read"));
        }
        if image.mapping != Mapping::Values {
            image.mapping = Mapping::Components;
            let stored = *image.layout.stored();
            image.layout = PixelLayout::new(image.layout.columns, image.layout.rows, stored.scalar(), stored);
        }
        Ok(image)
    }

    /// Samples of a delivered row.
    pub fn row_samples(&self) -> usize {
        let each = if self.mapping == Mapping::Components { usize::from(self.samples) } else { 1 };
        self.layout.columns as usize * each
    }

    /// True if rescale slope and intercept apply to the delivered samples: not where a table or luminance made them,
    /// nor to floating-point pixels, which are physical.
    pub fn rescales(&self) -> bool {
        self.mapping == Mapping::Values && !self.layout.stored().is_float() && self.storage != Storage::Bits
    }

    /// Notes on the delivered samples, where they are not plain.
    pub fn note(&self) -> Option<Note> {
        match self.mapping {
            Mapping::Rgb | Mapping::Luma | Mapping::Luma422 => {
                Some(Note::new("colour is reduced to luminance (ITU-R BT.601)"))
            }
            Mapping::Palette => Some(Note::new("palette colours are reduced to luminance (ITU-R BT.601)")),
            Mapping::ModalityLut => {
                Some(Note::new("values went through the modality LUT, and its output is taken as physical"))
            }
            Mapping::Values | Mapping::Components => None,
        }
    }

    /// Bytes of one frame where frames are [`Storage::Plain`].
    pub(crate) fn frame_bytes(&self) -> u64 {
        let pixels = u64::from(self.layout.columns) * u64::from(self.layout.rows);
        let cell = self.layout.stored().bytes() as u64;
        match self.mapping {
            Mapping::Luma422 => 2 * pixels * cell,
            _ => pixels * cell * u64::from(self.samples),
        }
    }

    /// Checks that the pixel element has room for all frames. The length of a deflated file is an upper bound; missing
    /// pixels are noticed when it is unrolled.
    fn check_length(&self, got: u64, is_deflated: bool) -> Result<(), Obstacle> {
        let needed = match self.storage {
            Storage::Coded(_) => {
                // Every frame has at least the head of one item.
                let room = (got / 8).max(1);
                if u64::from(self.frames) > room {
                    return Err(Obstacle::new(format!(
                        "{} frames are stated, and the file is too short for more than {room}",
                        self.frames
                    )));
                }
                return Ok(());
            }
            Storage::Plain => self.frame_bytes().saturating_mul(self.frames.into()),
            Storage::Bits => {
                let frame = u64::from(self.layout.columns) * u64::from(self.layout.rows);
                frame.saturating_mul(self.frames.into()).div_ceil(8)
            }
        };
        let more = got.saturating_sub(needed);
        // One byte is padding, also of a frame of one.
        if more >= self.frame_bytes().max(2) && !is_deflated && self.storage == Storage::Plain {
            return Err(Obstacle::new(format!(
                "{} {} stated, and the pixels of more are there: {got} bytes of {needed}",
                Count(self.frames, "frame"),
                if self.frames == 1 { "is" } else { "are" }
            )));
        }
        if got >= needed {
            return Ok(());
        }
        let text = format!("the pixels are cut short: {got} bytes of {needed}");
        Err(Obstacle { cut_short: true, text: text.into() })
    }
}

/// Type of the delivered samples. Entries of tables have up to 16 bits and are unsigned (PS3.3 C.11.1.1.1,
/// C.7.6.3.1.6).
fn delivered(mapping: Mapping, stored: CellFormat) -> ScalarType {
    match mapping {
        Mapping::ModalityLut | Mapping::Palette => ScalarType::U16,
        _ => stored.scalar(),
    }
}

/// Mapping of the samples of a pixel to one, by photometric interpretation (PS3.3 C.7.6.3.1.2).
fn mapping_of(header: &DicomHeader, samples: u16, codec: Option<Codec>) -> Result<Mapping, Obstacle> {
    let photometric = header.photometric.as_str();
    match (photometric, samples) {
        ("" | "MONOCHROME1" | "MONOCHROME2", 1) if header.modality_lut => Ok(Mapping::ModalityLut),
        ("" | "MONOCHROME1" | "MONOCHROME2", 1) => Ok(Mapping::Values),
        // The palette only colours the labels (PS3.3 C.8.20.2).
        ("PALETTE COLOR", 1) if header.is_segmentation() => Ok(Mapping::Values),
        ("PALETTE COLOR", 1) => {
            let places = &header.offsets;
            let all = places.palettes.iter().chain(&places.palette_descriptors).all(Option::is_some);
            if all {
                Ok(Mapping::Palette)
            } else {
                Err(Obstacle::new("the palette is missing, or of a kind that cannot be read"))
            }
        }
        ("RGB", 3) => Ok(Mapping::Rgb),
        // The transform into these is part of the codestream and undone by its decoder.
        ("YBR_RCT" | "YBR_ICT", 3) if codec.is_some_and(Codec::is_jpeg2000) => Ok(Mapping::Rgb),
        ("YBR_FULL", 3) => Ok(Mapping::Luma),
        // Decoders deliver every component of every pixel.
        ("YBR_FULL_422", 3) if codec.is_some_and(|codec| codec != Codec::None) => Ok(Mapping::Luma),
        ("YBR_FULL_422", 3) => Ok(Mapping::Luma422),
        _ => Err(Obstacle::new(format!(
            "colour images ({photometric}, {samples} samples a pixel) of this kind cannot be read"
        ))),
    }
}

/// Format of a cell.
fn stored_of(header: &DicomHeader, allocated: u16, samples: u16) -> Result<CellFormat, Obstacle> {
    let big = header.transfer_syntax == TransferSyntax::ExplicitBe;
    let endian = if big { Endian::Big } else { Endian::Little };
    let element = header.pixels.map_or(PixelElement::Integer, |p| p.element);
    match element {
        PixelElement::Float if allocated == 32 && samples == 1 => return Ok(CellFormat::float(endian)),
        PixelElement::Double if allocated == 64 && samples == 1 => return Ok(CellFormat::double(endian)),
        PixelElement::Integer => {}
        _ => return Err(Obstacle::new(format!("pixels of {allocated} bits allocated cannot be read"))),
    }
    let signed = header.pixel_representation.unwrap_or(0) & 1 == 1;
    match (allocated, samples) {
        (1, 1) => return Ok(CellFormat::integer(8, 1, 0, false, Endian::Little)),
        (8 | 16, _) | (32, 1) => {}
        _ => return Err(Obstacle::new(format!("pixels of {allocated} bits allocated cannot be read"))),
    }
    if samples > 1 && signed {
        return Err(Obstacle::new("colour with signed samples cannot be read"));
    }
    let stored = header.bits_stored.unwrap_or(allocated);
    let high = header.high_bit.unwrap_or(stored.saturating_sub(1));
    if stored == 0 || high >= allocated || stored > high + 1 {
        return Err(Obstacle::new(format!(
            "{stored} bits stored with high bit {high} do not fit {allocated} bits allocated"
        )));
    }
    Ok(CellFormat::integer(allocated.into(), stored.into(), u32::from(high + 1 - stored), signed, endian))
}
