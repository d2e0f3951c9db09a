//! What can be wrong with TIFF files.

use super::samples::Damage;

/// Why TIFF files are refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum TiffFault {
    /// Not a TIFF.
    NotTiff,
    /// The head of a BigTIFF is damaged.
    BigHead,
    /// A version that is not known.
    Version {
        /// Its number.
        version: u64,
    },
    /// Too many entries for a directory.
    Entries {
        /// How many.
        count: u64,
    },
    /// A field of an unknown type.
    FieldType {
        /// Its code.
        code: u16,
    },
    /// A field has too few values.
    FieldValues {
        /// How many.
        count: u64,
    },
    /// The pages follow each other in a circle.
    Circle,
    /// No page.
    NoPage,
    /// No page that is a slice.
    NoSlice,
    /// An ImageJ hyperstack.
    Hyperstack {
        /// How many.
        count: u64,
        /// Of what: `channels`, `frames`.
        of: &'static str,
    },
    /// An OME file of several volumes.
    Ome {
        /// How many.
        count: u64,
        /// Of what: `channels`, `time points`.
        of: &'static str,
    },
    /// A page reaches beyond the file.
    PageBytes {
        /// Its number, from 1.
        page: usize,
        /// Bytes that it takes.
        bytes: u64,
        /// Where it begins.
        at: u64,
        /// Bytes of the file.
        length: u64,
    },
    /// Too many pages in a file.
    Pages {
        /// The most.
        most: u32,
    },
    /// Too many pages in a volume.
    PagesOutOfRange {
        /// How many.
        count: u32,
    },
    /// A number of images that is out of range.
    Images {
        /// How many.
        count: u64,
    },
    /// The images that the description promises reach beyond the file.
    ImagesBytes {
        /// How many.
        count: u64,
        /// Where they end.
        end: u64,
        /// Bytes of the file.
        length: u64,
    },
    /// A page differs from the first in size or type.
    Unlike {
        /// The page.
        page: TiffShape,
        /// The first one.
        first: TiffShape,
    },
    /// A page is stored from another corner than the first.
    Corner,
    /// Pages are turned by 90 degrees.
    Turned {
        /// The tag's value.
        orientation: u64,
    },
    /// The pages promise more than the files can hold.
    Promise {
        /// Bytes of samples.
        bytes: u64,
        /// Bytes of files.
        file_bytes: u64,
    },
    /// A page was changed after it was found.
    Changed,
    /// A page ends early.
    PageEnds {
        /// Its number, from 1.
        page: u32,
    },
    /// A page cannot be decoded.
    PageDamaged {
        /// Its number, from 1.
        page: u32,
        /// What is wrong.
        damage: Damage,
    },
    /// The size of a page is out of range.
    PageSize {
        /// Columns and rows.
        size: [u64; 2],
    },
    /// Not one grey value a pixel.
    Colours {
        /// The photometric interpretation.
        photometric: u64,
        /// Samples a pixel.
        samples: u64,
    },
    /// Samples of a type that is not read.
    Samples {
        /// Bits.
        bits: u64,
        /// Sample format.
        format: u64,
    },
    /// A compression that is not read.
    Compression {
        /// Its code.
        code: u64,
    },
    /// Compressed bits are reversed.
    FillOrder,
    /// A predictor that does not fit the samples.
    Predictor {
        /// Its code.
        code: u64,
    },
    /// The size of tiles is out of range.
    Tiles {
        /// Columns and rows.
        size: [u64; 2],
    },
    /// A page does not say where its strips are.
    NoStrips,
    /// A page does not say how long its strips are.
    NoStripLengths,
    /// A page has too few strips or tiles.
    FewStrips {
        /// How many.
        count: u64,
        /// How many it needs.
        needed: u64,
    },
    /// LZW codes are wrong.
    Lzw {
        /// In words of the decoder.
        decoder: String,
    },
}

/// Size and type of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TiffShape {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Name of the samples' type, as they are delivered.
    pub dtype: &'static str,
}
