//! What can be wrong with TIFF files.

use std::fmt;

use thiserror::Error;

use super::samples::Damage;

/// Why TIFF files are refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum TiffFault {
    #[error("it is not a TIFF")]
    NotTiff,
    #[error("its BigTIFF head is damaged")]
    BigHead,
    #[error("it is TIFF of the unknown version {version}")]
    Version { version: u64 },
    #[error("a directory of {count} entries is not valid")]
    Entries { count: u64 },
    #[error("a field of the unknown type {code}")]
    FieldType { code: u16 },
    #[error("a field has {count} values where more are needed")]
    FieldValues { count: u64 },
    #[error("its pages follow each other in a circle")]
    Circle,
    #[error("it has no page")]
    NoPage,
    #[error("has no page")]
    NoSlice,
    #[error("is an ImageJ hyperstack of {count} {of}; save one of them as a stack of its own")]
    Hyperstack { count: u64, of: &'static str },
    #[error("is an OME file of {count} {of}; save one of them as a stack of its own")]
    Ome { count: u64, of: &'static str },
    #[error("page {page} needs {bytes} bytes from byte {at} on, and the file has {length}; copy it again")]
    PageBytes { page: usize, bytes: u64, at: u64, length: u64 },
    #[error("it has more than {most} pages")]
    Pages { most: u32 },
    #[error("{count} pages are out of range")]
    PagesOutOfRange { count: u32 },
    #[error("its {count} images are out of range")]
    Images { count: u64 },
    #[error(
        "its description promises {count} images up to byte {end}, and the file has {length}; copy it again"
    )]
    ImagesBytes { count: u64, end: u64, length: u64 },
    #[error(
        "a page is {page} where the first is {first}; slices of a volume are alike in size and type, move the other away"
    )]
    Unlike { page: TiffShape, first: TiffShape },
    #[error("a page is stored from another corner than the first (Orientation); save all of them alike")]
    Corner,
    #[error("its pictures are stored turned by 90 degrees (Orientation {orientation}); save them upright")]
    Turned { orientation: u64 },
    #[error("its pages promise {bytes} bytes, more than {file_bytes} bytes of file can hold")]
    Promise { bytes: u64, file_bytes: u64 },
    #[error("it is not the page that it was a moment ago")]
    Changed,
    #[error("page {page} ends early; the file was cut short, copy it again")]
    PageEnds { page: u32 },
    #[error("page {page} is damaged ({damage}); copy the file again")]
    PageDamaged { page: u32, damage: Damage },
    #[error("a page of {x}x{y} pixels is out of range", x = .size[0], y = .size[1])]
    PageSize { size: [u64; 2] },
    #[error("it has {}, and grey values are needed; convert it to grey", colours(*.photometric, *.samples))]
    Colours { photometric: u64, samples: u64 },
    #[error("samples of {bits} bits in format {format} are not read; convert it to 8, 16 or 32 bits")]
    Samples { bits: u64, format: u64 },
    #[error("its compression {code} ({}) is not read; save it with LZW, deflate or none", compression(*.code))]
    Compression { code: u64 },
    #[error("its compressed bits are in reversed order, which is not read")]
    FillOrder,
    #[error("its predictor {code} does not fit its samples")]
    Predictor { code: u64 },
    #[error("tiles of {x}x{y} are out of range", x = .size[0], y = .size[1])]
    Tiles { size: [u64; 2] },
    #[error("a page names no strips")]
    NoStrips,
    #[error("a page does not state the lengths of its strips")]
    NoStripLengths,
    #[error("a page names {count} strips or tiles where it needs {needed}")]
    FewStrips { count: u64, needed: u64 },
    #[error("LZW: {decoder}")]
    Lzw { decoder: String },
}

fn colours(photometric: u64, samples: u64) -> String {
    match photometric {
        2 => "RGB colours".to_owned(),
        3 => "colours of a palette".to_owned(),
        0 | 1 => format!("{samples} samples a pixel"),
        other => format!("pixels of the photometric interpretation {other}"),
    }
}

fn compression(code: u64) -> &'static str {
    match code {
        2..=4 => "fax",
        6 | 7 => "JPEG",
        33003 | 33005 | 34712 => "JPEG 2000",
        50000 | 34926 => "Zstandard",
        50001 | 34927 => "WebP",
        34925 => "LZMA",
        _ => "unknown",
    }
}

/// Size and type of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TiffShape {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Name of the samples' type, as they are delivered.
    pub dtype: &'static str,
}

impl fmt::Display for TiffShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { size: [x, y], dtype } = self;
        write!(f, "{x}x{y} {dtype}")
    }
}
