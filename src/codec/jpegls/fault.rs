//! What can be wrong with a JPEG-LS image.

/// What is damaged in a JPEG-LS image.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// It does not begin as a JPEG image.
    NoStart,
    /// Its scan has no frame header.
    NoFrame,
    /// It has two frame headers.
    SecondFrame,
    /// A component comes in two scans.
    ScanAgain,
    /// The marker `code` instead of a restart marker.
    NoRestart {
        /// Second byte of the marker that is there.
        code: u8,
    },
    /// The segment of `segment` has a wrong length.
    SegmentLength {
        /// Which one.
        segment: SegmentKind,
    },
    /// It ends before all its components came.
    MissingComponents,
    /// The marker `code` is out of place.
    Marker {
        /// Second byte of the marker.
        code: u8,
    },
    /// `bits` bits per sample, where 2 to 16 are possible.
    Precision {
        /// Bits of a sample.
        bits: u8,
    },
    /// It has no components.
    NoComponents,
    /// Two components have the same identifier.
    ComponentTwice,
    /// Image sizes of `bytes` bytes.
    SizeBytes {
        /// Bytes of a size.
        bytes: u32,
    },
    /// A scan of `count` components.
    ScanComponents {
        /// How many.
        count: usize,
    },
    /// A scan of the unknown component `id`.
    ScanOfUnknown {
        /// Identifier of the component.
        id: u8,
    },
    /// A scan has the component `id` twice.
    ScanOfTwice {
        /// Identifier of the component.
        id: u8,
    },
    /// The interleave mode `mode` of `count` components.
    Interleave {
        /// Interleave mode.
        mode: u8,
        /// Components of the scan.
        count: usize,
    },
    /// It has no columns.
    NoColumns,
    /// A prediction error of `code` is larger than any at this precision.
    PredictionError {
        /// The error as it is coded.
        code: u64,
    },
    /// A run goes past the end of its line.
    LongRun,
    /// A marker was expected, not the byte `byte`.
    NoMarker {
        /// The byte that is there.
        byte: u8,
    },
    /// A marker was expected, not the bytes 0xff 0x00.
    StuffedByte,
    /// A code word is longer than any that JPEG-LS has.
    LongCode,
    /// It ends early.
    EndsEarly,
    /// `parameter` `value` is not possible at `bits` bits.
    Parameter {
        /// Which one.
        parameter: Parameter,
        /// Its value.
        value: u32,
        /// Bits of a sample.
        bits: u8,
    },
}

/// What a JPEG-LS image may use that is not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// Lines of `columns` samples.
    LineSamples {
        /// Samples of a line.
        columns: u32,
    },
    /// A number of lines after the first scan.
    LateLines,
    /// The extensions of JPEG-LS part 2.
    Part2,
    /// The JPEG process SOF`number`.
    Process {
        /// Number of the frame header.
        number: u8,
    },
    /// `count` components.
    Components {
        /// How many.
        count: usize,
    },
    /// Components of different sizes.
    Subsampling,
    /// Mapping tables (palettes).
    Palettes,
    /// Preset parameters of type `kind`.
    Presets {
        /// Type of the parameters.
        kind: u8,
    },
    /// Sample interleaving of one component.
    InterleaveOfOne,
    /// A point transform.
    PointTransform,
    /// The colour transform `number`.
    ColourTransform {
        /// Number of the transform.
        number: u8,
    },
}

/// A kind of marker segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SegmentKind {
    /// Frame header.
    Frame,
    /// Scan header.
    Scan,
    /// Preset parameters.
    Presets,
    /// Restart interval.
    RestartInterval,
    /// Huffman tables, which mean nothing here.
    HuffmanTables,
    /// Conditioning of arithmetic coding, which means nothing here.
    ArithmeticConditioning,
    /// Application data.
    ApplicationData,
}

/// A coding parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// MAXVAL.
    LargestSample,
    /// NEAR.
    ErrorBound,
    /// T1, T2 or T3.
    GradientThreshold,
    /// RESET.
    ResetInterval,
}
