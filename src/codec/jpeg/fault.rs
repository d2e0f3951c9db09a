//! What can be wrong with a JPEG image.

/// What is damaged in a JPEG image.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// A marker segment claims a length of `length` bytes.
    ShortLength {
        /// Length that it claims.
        length: u16,
    },
    /// A marker segment is shorter than its contents.
    ShortSegment,
    /// It ends early.
    EndsEarly,
    /// It ends before its image begins.
    EndsBeforeImage,
    /// It ends before its pixels begin.
    EndsBeforePixels,
    /// It ends before its last scan.
    EndsBeforeLastScan,
    /// Its data go on after the last pixel.
    GoesOn,
    /// Restart marker `number` is missing.
    NoRestart {
        /// Number of the marker.
        number: u8,
    },
    /// It holds a code that its Huffman table does not have.
    UnknownCode,
    /// It holds a code of progressive images.
    ProgressiveCode,
    /// A block has more than 64 coefficients.
    LongBlock,
    /// A difference has `bits` bits.
    DifferenceBits {
        /// Bits of the difference.
        bits: u8,
    },
    /// A coefficient is out of range.
    CoefficientRange,
    /// Its width is 0.
    NoWidth,
    /// It has no components.
    NoComponents,
    /// Component `id` of the frame makes no sense.
    Component {
        /// Identifier of the component.
        id: u8,
    },
    /// Component `id` comes twice in the frame.
    ComponentTwice {
        /// Identifier of the component.
        id: u8,
    },
    /// A scan has `count` components.
    ScanComponents {
        /// How many.
        count: u8,
    },
    /// A scan names component `id`, which the frame has not.
    ScanOfUnknown {
        /// Identifier of the component.
        id: u8,
    },
    /// A scan names component `id` twice.
    ScanOfTwice {
        /// Identifier of the component.
        id: u8,
    },
    /// A scan has more than `most` units in an MCU.
    ScanUnits {
        /// As many as a scan may have.
        most: u32,
    },
    /// A scan comes before the frame header.
    ScanBeforeFrame,
    /// A scan comes out of its turn.
    ScanOutOfTurn,
    /// Two scans hold the same component.
    ScanAgain,
    /// A component has no scan.
    NoScan,
    /// Another image begins before it is complete.
    SecondImage,
    /// It holds the unknown marker 0x`code`.
    UnknownMarker {
        /// Second byte of the marker.
        code: u8,
    },
    /// It has two frame headers.
    SecondFrame,
    /// A Huffman table has the class `class`.
    TableClass {
        /// Class of the table.
        class: u8,
    },
    /// A Huffman table has the number `number`.
    TableNumber {
        /// Number of the table.
        number: u8,
    },
    /// A Huffman table has `codes` codes, and 256 are the most there can be.
    TableCodes {
        /// Codes of the table.
        codes: usize,
    },
    /// A Huffman table has too many codes of `bits` bits.
    TableCodesOfLength {
        /// Bits of the codes.
        bits: u32,
    },
    /// A quantisation table makes no sense.
    Quantisation,
    /// A Huffman table that it needs is missing.
    NoHuffmanTable,
    /// A quantisation table that it needs is missing.
    NoQuantisationTable,
    /// It does not begin as a JPEG image does.
    NoStart,
    /// A sample is out of the range that its header gives.
    SampleRange,
    /// A lossless scan has the predictor `predictor`.
    Predictor {
        /// Number of the predictor.
        predictor: u8,
    },
    /// The point transform leaves nothing of the samples.
    PointTransform,
    /// Restart markers stand within a line of a lossless image.
    RestartWithinLine,
    /// A refined coefficient has more than one bit.
    RefinedBits,
}

/// What a JPEG image may use that is not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// JPEG with `bits` bits in a sample.
    Precision {
        /// Bits of a sample.
        bits: u8,
    },
    /// A JPEG height given only after the pixels (DNL).
    LateHeight,
    /// JPEG with `count` components.
    Components {
        /// How many.
        count: u8,
    },
    /// Arithmetic coding (JPEG).
    Arithmetic,
    /// Hierarchical JPEG.
    Hierarchical,
    /// JPEG-LS inside a JPEG transfer syntax.
    JpegLs,
    /// Lossless JPEG with subsampled components.
    SubsampledLossless,
}
