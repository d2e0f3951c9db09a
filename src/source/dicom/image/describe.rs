//! What a file's pixels are, and how they are reached: by position, or by decoding
//! (PS3.3 C.7.6.3; PS3.5 section 8 and annex A).

use thiserror::Error;

use super::pixels::{PixelLayout, Stored};
use crate::source::dicom::parse::header::{DicomHeader, PixelElement};
use crate::source::dicom::parse::syntax::{Codec, TransferSyntax};
use crate::volume::{Endian, ScalarType};

/// Why an object cannot be a slice of a volume; the sentence names what it is.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Obstacle {
    /// A report, a plan, a directory, ...
    #[error("{0} without pixels")]
    NoPixels(String),
    /// Compressed in a way that is not decoded here.
    #[error("compressed pixels ({0}) cannot be read{remedy}", remedy = .0.remedy())]
    Codec(TransferSyntax),
    /// A transfer syntax that is not known here.
    #[error("pixels in an {0} cannot be read")]
    UnknownSyntax(TransferSyntax),
    /// Pixels, but no word on what they are.
    #[error(
        "there are {0} bytes of pixel data, but no image description: rows, columns and bits allocated are missing"
    )]
    NoDescription(u64),
    /// Native syntax, but no length.
    #[error("the pixels have no length, though {0} pixels must have one")]
    NoLength(TransferSyntax),
    /// Number of Frames is illegible or 0. It is not guessed from the length of the pixels: what else the
    /// header says may be as wrong.
    #[error("the number of frames is not a positive number")]
    BadFrames,
    /// More frames than could lie in the file.
    #[error("{stated} frames are stated, and the file is too short for more than {room}")]
    TooManyFrames {
        /// Number of Frames.
        stated: u32,
        /// Frames that the file could hold at most.
        room: u64,
    },
    /// A photometric interpretation that cannot be reduced to one number a pixel.
    #[error("colour images ({photometric}, {samples} samples a pixel) of this kind cannot be read")]
    Colour {
        /// Photometric Interpretation.
        photometric: String,
        /// Samples per Pixel.
        samples: u16,
    },
    /// A palette image without a palette that can be used.
    #[error("the palette is missing, or of a kind that cannot be read")]
    Palette,
    /// A width other than 1, 8, 16 or 32.
    #[error("pixels of {0} bits allocated cannot be read")]
    BitsAllocated(u16),
    /// Bits stored and high bit do not fit the bits allocated.
    #[error("{stored} bits stored with high bit {high} do not fit {allocated} bits allocated")]
    BadBits {
        /// Bits Allocated.
        allocated: u16,
        /// Bits Stored.
        stored: u16,
        /// High Bit.
        high: u16,
    },
    /// A combination that the standard does not have.
    #[error("{0} cannot be read")]
    Combination(&'static str),
    /// An attribute that every image must have.
    #[error("the image does not state its {0}")]
    Missing(&'static str),
    /// The file ends, or its pixel element ends, before the last row.
    #[error("the pixels are cut short: {got} bytes of {needed}")]
    Truncated {
        /// Bytes that the size of the image needs.
        needed: u64,
        /// Bytes that are there.
        got: u64,
    },
    /// Not a single plain frame; only for readers that know no other.
    #[error("{0} cannot be read yet")]
    NotPlain(String),
}

/// How a volume gets at the samples.
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
    /// Frames have to be decoded from front to back: see [`fn@super::unroll::unroll`].
    Unrolled,
}

/// How cells lie in the pixel element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Storage {
    /// Whole bytes, one frame right after the other.
    Plain,
    /// One bit a pixel, no gap between frames.
    Bits,
    /// Fragments of compressed frames.
    Coded(Codec),
}

/// How cells become delivered samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mapping {
    /// As they are.
    Values,
    /// Through the Modality LUT.
    ModalityLut,
    /// Through the palette, then luminance.
    Palette,
    /// Luminance of red, green and blue.
    Rgb,
    /// The first of three components is luminance.
    Luma,
    /// As Luma, in the native order Y Y Cb Cr of two pixels.
    Luma422,
    /// All components side by side, as stored.
    Components,
}

/// The image (one frame or many) of one file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Image {
    /// Size of a frame and type of the delivered samples.
    pub layout: PixelLayout,
    /// By position, or by decoding.
    pub access: Access,
    /// Number of frames, at least 1.
    pub frames: u32,
    pub(crate) storage: Storage,
    pub(crate) mapping: Mapping,
    /// Cells a pixel.
    pub(crate) samples: u8,
    /// Are components stored one plane after another?
    pub(crate) planar: bool,
    /// Are neighbouring bytes swapped (8-bit cells in big-endian words)?
    pub(crate) swapped: bool,
}

impl Image {
    /// What the pixels of a file are.
    ///
    /// # Errors
    /// The [`Obstacle`] that is in the way.
    pub fn of(header: &DicomHeader) -> Result<Self, Obstacle> {
        let syntax = &header.transfer_syntax;
        let Some(pixels) = header.pixels else { return Err(Obstacle::NoPixels(header.kind())) };
        if header.rows.is_none() && header.columns.is_none() && header.bits_allocated.is_none() {
            return Err(Obstacle::NoDescription(pixels.available));
        }
        let codec = match syntax {
            TransferSyntax::Unknown(_) => return Err(Obstacle::UnknownSyntax(syntax.clone())),
            TransferSyntax::Encapsulated(_) => {
                Some(syntax.codec().ok_or_else(|| Obstacle::Codec(syntax.clone()))?)
            }
            _ if pixels.declared.is_none() => return Err(Obstacle::NoLength(syntax.clone())),
            _ => None,
        };
        let frames = match header.frames {
            None => 1,
            Some(Ok(n)) if n > 0 => n,
            Some(_) => return Err(Obstacle::BadFrames),
        };
        let side = |side: Option<u16>, what| side.filter(|n| *n > 0).ok_or(Obstacle::Missing(what));
        let (rows, columns) = (side(header.rows, "rows")?, side(header.columns, "columns")?);
        let allocated = header.bits_allocated.ok_or(Obstacle::Missing("bits allocated"))?;
        let samples = header.samples.unwrap_or(1);
        let mapping = mapping_of(header, samples, codec)?;
        let stored = stored_of(header, allocated, samples)?;
        let storage = match codec {
            Some(_) if stored.is_float() => {
                return Err(Obstacle::Combination("compressed floating-point pixels"));
            }
            Some(_) if allocated == 1 => return Err(Obstacle::Combination("compressed pixels of one bit")),
            Some(codec) => Storage::Coded(codec),
            None if allocated == 1 => Storage::Bits,
            None => Storage::Plain,
        };
        let mut image = Self {
            layout: PixelLayout::new(columns.into(), rows.into(), delivered(mapping, stored), stored),
            access: Access::Unrolled,
            frames,
            storage,
            mapping,
            // 1 or 3, see `mapping_of`.
            samples: u8::try_from(samples).unwrap_or(1),
            planar: samples > 1 && header.planar == Some(1) && mapping != Mapping::Luma422,
            swapped: *syntax == TransferSyntax::ExplicitBe && allocated == 8 && pixels.words,
        };
        image.check_length(pixels.available)?;
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

    /// As [`Image::of`], but delivers what is stored: no table, no luminance. A row then has
    /// [`Image::row_samples`] samples, those of a pixel side by side, whichever way they were stored.
    ///
    /// # Errors
    /// As [`Image::of`].
    pub fn of_components(header: &DicomHeader) -> Result<Self, Obstacle> {
        let mut image = Self::of(header)?;
        if image.mapping == Mapping::Luma422 && image.storage == Storage::Plain {
            return Err(Obstacle::Combination("subsampled colour as components"));
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

    /// Do rescale slope and intercept apply to the delivered samples? Not where a table or luminance made
    /// them, nor to floating-point pixels, which are physical.
    pub fn rescales(&self) -> bool {
        self.mapping == Mapping::Values && !self.layout.stored().is_float() && self.storage != Storage::Bits
    }

    /// A sentence for the user on what the delivered samples are, where that is not plain.
    pub fn warning(&self) -> Option<&'static str> {
        match self.mapping {
            Mapping::Rgb | Mapping::Luma | Mapping::Luma422 => {
                Some("colour is reduced to luminance (ITU-R BT.601)")
            }
            Mapping::Palette => Some("palette colours are reduced to luminance (ITU-R BT.601)"),
            Mapping::ModalityLut => {
                Some("values went through the modality LUT, and its output is taken as physical")
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

    /// Is there room for all frames in the pixel element? Of a deflated file only an upper bound is known;
    /// what it lacks is noticed when it is unrolled.
    fn check_length(&self, got: u64) -> Result<(), Obstacle> {
        let needed = match self.storage {
            Storage::Coded(_) => {
                // Every frame has at least the head of one item.
                let room = (got / 8).max(1);
                if u64::from(self.frames) > room {
                    return Err(Obstacle::TooManyFrames { stated: self.frames, room });
                }
                return Ok(());
            }
            Storage::Plain => self.frame_bytes().saturating_mul(self.frames.into()),
            Storage::Bits => {
                let frame = u64::from(self.layout.columns) * u64::from(self.layout.rows);
                frame.saturating_mul(self.frames.into()).div_ceil(8)
            }
        };
        if got < needed { Err(Obstacle::Truncated { needed, got }) } else { Ok(()) }
    }
}

impl PixelLayout {
    /// Layout of an image of one uncompressed grey frame, all of whose bytes are in the file.
    ///
    /// # Errors
    /// The [`Obstacle`] that is in the way; [`Obstacle::NotPlain`] for all that only [`Image::of`] knows.
    pub fn of(header: &DicomHeader) -> Result<Self, Obstacle> {
        let image = Image::of(header)?;
        let syntax = &header.transfer_syntax;
        let what = match (image.storage, image.mapping) {
            (Storage::Coded(_), _) => format!("compressed pixels ({syntax})"),
            _ if !syntax.is_native() => "deflated files".into(),
            _ if image.frames > 1 => format!("multi-frame images ({} frames in one file)", image.frames),
            (_, Mapping::ModalityLut) => "values that go through a modality LUT".into(),
            (Storage::Bits, _) => "pixels of 1 bits allocated".into(),
            (_, Mapping::Values) if image.swapped => "8-bit pixels in big-endian words".into(),
            (_, Mapping::Values) if image.layout.stored().is_float() => "floating-point pixels".into(),
            (_, Mapping::Values) => return Ok(image.layout),
            _ => format!("colour images ({}, {} samples a pixel)", header.photometric, image.samples),
        };
        Err(Obstacle::NotPlain(what))
    }
}

/// Type of what is delivered. Entries of tables have up to 16 bits and are unsigned (PS3.3 C.11.1.1.1,
/// C.7.6.3.1.6).
fn delivered(mapping: Mapping, stored: Stored) -> ScalarType {
    match mapping {
        Mapping::ModalityLut | Mapping::Palette => ScalarType::U16,
        _ => stored.scalar(),
    }
}

/// How the samples of a pixel become one, by photometric interpretation (PS3.3 C.7.6.3.1.2).
fn mapping_of(header: &DicomHeader, samples: u16, codec: Option<Codec>) -> Result<Mapping, Obstacle> {
    let photometric = header.photometric.as_str();
    match (photometric, samples) {
        ("" | "MONOCHROME1" | "MONOCHROME2", 1) if header.modality_lut => Ok(Mapping::ModalityLut),
        ("" | "MONOCHROME1" | "MONOCHROME2", 1) => Ok(Mapping::Values),
        // The palette only colours the labels (PS3.3 C.8.20.2).
        ("PALETTE COLOR", 1) if header.is_segmentation() => Ok(Mapping::Values),
        ("PALETTE COLOR", 1) => {
            let places = &header.places;
            let all = places.palettes.iter().chain(&places.palette_descriptors).all(Option::is_some);
            if all { Ok(Mapping::Palette) } else { Err(Obstacle::Palette) }
        }
        ("RGB", 3) => Ok(Mapping::Rgb),
        // The transform into these is part of the codestream and undone by its decoder.
        ("YBR_RCT" | "YBR_ICT", 3) if codec.is_some_and(Codec::is_jpeg2000) => Ok(Mapping::Rgb),
        ("YBR_FULL", 3) => Ok(Mapping::Luma),
        // Decoders deliver every component of every pixel.
        ("YBR_FULL_422", 3) if codec.is_some_and(|codec| codec != Codec::None) => Ok(Mapping::Luma),
        ("YBR_FULL_422", 3) => Ok(Mapping::Luma422),
        _ => Err(Obstacle::Colour { photometric: photometric.into(), samples }),
    }
}

/// How a cell holds its value.
fn stored_of(header: &DicomHeader, allocated: u16, samples: u16) -> Result<Stored, Obstacle> {
    let big = header.transfer_syntax == TransferSyntax::ExplicitBe;
    let endian = if big { Endian::Big } else { Endian::Little };
    let element = header.pixels.map_or(PixelElement::Integer, |p| p.element);
    match element {
        PixelElement::Float if allocated == 32 && samples == 1 => return Ok(Stored::float(endian)),
        PixelElement::Double if allocated == 64 && samples == 1 => return Ok(Stored::double(endian)),
        PixelElement::Integer => {}
        _ => return Err(Obstacle::BitsAllocated(allocated)),
    }
    let signed = header.pixel_representation.unwrap_or(0) & 1 == 1;
    match (allocated, samples) {
        (1, 1) => return Ok(Stored::integer(8, 1, 0, false, Endian::Little)),
        (8 | 16, _) | (32, 1) => {}
        _ => return Err(Obstacle::BitsAllocated(allocated)),
    }
    if samples > 1 && signed {
        return Err(Obstacle::Combination("colour with signed samples"));
    }
    let stored = header.bits_stored.unwrap_or(allocated);
    let high = header.high_bit.unwrap_or(stored.saturating_sub(1));
    if stored == 0 || high >= allocated || stored > high + 1 {
        return Err(Obstacle::BadBits { allocated, stored, high });
    }
    Ok(Stored::integer(allocated.into(), stored.into(), u32::from(high + 1 - stored), signed, endian))
}
