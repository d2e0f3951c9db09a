//! Sentences about TIFF and PNG pictures.

use std::fmt;

use crate::facts::png::{PngFault, PngHead};
use crate::facts::tiff::{TiffFault, TiffShape};

impl fmt::Display for TiffFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotTiff => f.write_str("it is no TIFF"),
            Self::BigHead => f.write_str("its BigTIFF head is damaged"),
            Self::Version { version } => write!(f, "it is TIFF of the unknown version {version}"),
            Self::Entries { count } => write!(f, "a directory of {count} entries is none"),
            Self::FieldType { code } => write!(f, "a field of the unknown type {code}"),
            Self::FieldValues { count } => {
                write!(f, "a field has {count} values where more are needed")
            }
            Self::Circle => f.write_str("its pages follow each other in a circle"),
            Self::NoPage => f.write_str("it has no page"),
            Self::NoSlice => f.write_str("has no page"),
            Self::Hyperstack { count, of } => {
                write!(f, "is an ImageJ hyperstack of {count} {of}; save one of them as a stack of its own")
            }
            Self::Ome { count, of } => {
                write!(f, "is an OME file of {count} {of}; save one of them as a stack of its own")
            }
            Self::PageBytes { page, bytes, at, length } => write!(
                f,
                "page {page} needs {bytes} bytes from byte {at} on, and the file has {length}; copy it again"
            ),
            Self::Pages { most } => write!(f, "it has more than {most} pages"),
            Self::PagesOutOfRange { count } => write!(f, "{count} pages are out of range"),
            Self::Images { count } => write!(f, "its {count} images are out of range"),
            Self::ImagesBytes { count, end, length } => write!(
                f,
                "its description promises {count} images up to byte {end}, and the file has {length}; copy it again"
            ),
            Self::Unlike { page, first } => write!(
                f,
                "a page is {page} where the first is {first}; slices of a volume are alike in size and type, move the other away"
            ),
            Self::Corner => f.write_str(
                "a page is stored from another corner than the first (Orientation); save all of them alike",
            ),
            Self::Turned { orientation } => write!(
                f,
                "its pictures are stored turned by 90 degrees (Orientation {orientation}); save them upright"
            ),
            Self::Promise { bytes, file_bytes } => {
                write!(f, "its pages promise {bytes} bytes, more than {file_bytes} bytes of file can hold")
            }
            Self::Changed => f.write_str("it is not the page that it was a moment ago"),
            Self::PageEnds { page } => {
                write!(f, "page {page} ends early; the file was cut short, copy it again")
            }
            Self::PageDamaged { page, damage } => {
                write!(f, "page {page} is damaged ({damage}); copy the file again")
            }
            Self::PageSize { size: [x, y] } => {
                write!(f, "a page of {x}x{y} pixels is out of range")
            }
            Self::Colours { photometric, samples } => {
                f.write_str("it has ")?;
                match photometric {
                    2 => f.write_str("RGB colours")?,
                    3 => f.write_str("colours of a palette")?,
                    0 | 1 => write!(f, "{samples} samples a pixel")?,
                    other => write!(f, "pixels of the photometric interpretation {other}")?,
                }
                f.write_str(", and grey values are needed; convert it to grey")
            }
            Self::Samples { bits, format } => write!(
                f,
                "samples of {bits} bits in format {format} are not read; convert it to 8, 16 or 32 bits"
            ),
            Self::Compression { code } => {
                let name = match code {
                    2..=4 => "fax",
                    6 | 7 => "JPEG",
                    33003 | 33005 | 34712 => "JPEG 2000",
                    50000 | 34926 => "Zstandard",
                    50001 | 34927 => "WebP",
                    34925 => "LZMA",
                    _ => "unknown",
                };
                write!(f, "its compression {code} ({name}) is not read; save it with LZW, deflate or none")
            }
            Self::FillOrder => f.write_str("its compressed bits are in reversed order, which is not read"),
            Self::Predictor { code } => {
                write!(f, "its predictor {code} does not fit its samples")
            }
            Self::Tiles { size: [x, y] } => write!(f, "tiles of {x}x{y} are out of range"),
            Self::NoStrips => f.write_str("a page names no strips"),
            Self::NoStripLengths => f.write_str("a page does not state the lengths of its strips"),
            Self::FewStrips { count, needed } => {
                write!(f, "a page names {count} strips or tiles where it needs {needed}")
            }
            Self::Lzw { decoder } => write!(f, "LZW: {decoder}"),
        }
    }
}

impl fmt::Display for TiffShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { size: [x, y], dtype } = self;
        write!(f, "{x}x{y} {dtype}")
    }
}

impl fmt::Display for PngFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unlike { picture, first } => write!(
                f,
                "is {picture} where the first slice is {first}; slices of a volume are alike in size and type, move the other away"
            ),
            Self::NoPicture => f.write_str("holds no picture"),
            Self::OutOfRange { picture, slices } => {
                write!(f, "{picture} in {slices} slices are out of range")
            }
            Self::Promise { bytes, file_bytes } => {
                write!(f, "its header promises {bytes} bytes, more than {file_bytes} bytes of PNG can hold")
            }
            Self::Header => f.write_str("its PNG header is damaged"),
            Self::Colour { code } => {
                let kind = match code {
                    2 => "RGB colours",
                    3 => "colours of a palette",
                    4 => "grey values with transparency",
                    6 => "RGB colours with transparency",
                    _ => "an unknown kind of colour",
                };
                write!(f, "has {kind}, and grey values are needed; convert it to grey")
            }
            Self::Depth { bits } => write!(f, "its PNG header is damaged: samples of {bits} bits"),
            Self::Interlaced => f.write_str("is interlaced, which is not read; save it without"),
            Self::Short => f.write_str("the PNG picture ends early; the file was cut short, copy it again"),
            Self::Damaged { decoder } => {
                write!(f, "the PNG picture is damaged ({decoder}); copy the file again")
            }
            Self::Changed => f.write_str("is not the picture that it was a moment ago"),
            Self::FewRows => f.write_str("the PNG picture has too few rows"),
        }
    }
}

impl fmt::Display for PngHead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { size: [x, y], bits } = self;
        write!(f, "{x}x{y} of {bits} bits")
    }
}
