//! Errors in a JPEG image.

use thiserror::Error;

/// Damage in a JPEG image.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Damage {
    #[error("a marker segment claims a length of {length} bytes")]
    ShortLength { length: u16 },
    #[error("a marker segment is shorter than its contents")]
    ShortSegment,
    #[error("it ends early")]
    EndsEarly,
    #[error("it ends before its image begins")]
    EndsBeforeImage,
    #[error("it ends before its pixels begin")]
    EndsBeforePixels,
    #[error("it ends before its last scan")]
    EndsBeforeLastScan,
    #[error("its data go on after the last pixel")]
    GoesOn,
    #[error("restart marker {number} is missing")]
    NoRestart { number: u8 },
    #[error("it holds a code that its Huffman table does not have")]
    UnknownCode,
    #[error("it holds a code of progressive images")]
    ProgressiveCode,
    #[error("a block has more than 64 coefficients")]
    LongBlock,
    #[error("a difference has {bits} bits")]
    DifferenceBits { bits: u8 },
    #[error("a coefficient is out of range")]
    CoefficientRange,
    #[error("its width is 0")]
    NoWidth,
    #[error("it has no components")]
    NoComponents,
    #[error("component {id} of the frame makes no sense")]
    Component { id: u8 },
    #[error("component {id} comes twice in the frame")]
    ComponentTwice { id: u8 },
    #[error("a scan has {count} components")]
    ScanComponents { count: u8 },
    #[error("a scan names component {id}, which the frame has not")]
    ScanOfUnknown { id: u8 },
    #[error("a scan names component {id} twice")]
    ScanOfTwice { id: u8 },
    #[error("a scan has more than {most} units in an MCU")]
    ScanUnits { most: u32 },
    #[error("a scan comes before the frame header")]
    ScanBeforeFrame,
    #[error("a scan comes out of its turn")]
    ScanOutOfTurn,
    #[error("two scans hold the same component")]
    ScanAgain,
    #[error("a component has no scan")]
    NoScan,
    #[error("another image begins before it is complete")]
    SecondImage,
    #[error("it holds the unknown marker 0x{code:02X}")]
    UnknownMarker { code: u8 },
    #[error("it has two frame headers")]
    SecondFrame,
    #[error("a Huffman table has the class {class}")]
    TableClass { class: u8 },
    #[error("a Huffman table has the number {number}")]
    TableNumber { number: u8 },
    #[error("a Huffman table has {codes} codes, and 256 are the most there can be")]
    TableCodes { codes: usize },
    #[error("a Huffman table has too many codes of {bits} bits")]
    TableCodesOfLength { bits: u32 },
    #[error("a quantisation table makes no sense")]
    Quantisation,
    #[error("a Huffman table that it needs is missing")]
    NoHuffmanTable,
    #[error("a quantisation table that it needs is missing")]
    NoQuantisationTable,
    #[error("it does not begin as a JPEG image does")]
    NoStart,
    #[error("a sample is out of the range that its header gives")]
    SampleRange,
    #[error("a lossless scan has the predictor {predictor}")]
    Predictor { predictor: u8 },
    #[error("the point transform leaves nothing of the samples")]
    PointTransform,
    #[error("restart markers stand within a line of a lossless image")]
    RestartWithinLine,
    #[error("a refined coefficient has more than one bit")]
    RefinedBits,
}

/// Features of JPEG images that are not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Feature {
    #[error("JPEG with {bits} bits in a sample")]
    Precision { bits: u8 },
    #[error("a JPEG height given only after the pixels (DNL)")]
    LateHeight,
    #[error("JPEG with {count} components")]
    Components { count: u8 },
    #[error("arithmetic coding (JPEG)")]
    Arithmetic,
    #[error("hierarchical JPEG")]
    Hierarchical,
    #[error("JPEG-LS inside a JPEG transfer syntax")]
    JpegLs,
    #[error("lossless JPEG with subsampled components")]
    SubsampledLossless,
}
