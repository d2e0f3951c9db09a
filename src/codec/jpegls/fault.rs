//! Errors in a JPEG-LS image.

use thiserror::Error;

/// Damage in a JPEG-LS image.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Damage {
    #[error("it does not begin as a JPEG image")]
    NoStart,
    #[error("its scan has no frame header")]
    NoFrame,
    #[error("it has two frame headers")]
    SecondFrame,
    #[error("a component comes in two scans")]
    ScanAgain,
    #[error("the marker {code:#04x} instead of a restart marker")]
    NoRestart { code: u8 },
    #[error("the segment of {segment} has a wrong length")]
    SegmentLength { segment: SegmentKind },
    #[error("it ends before all its components came")]
    MissingComponents,
    #[error("the marker {code:#04x} is out of place")]
    Marker { code: u8 },
    #[error("{bits} bits per sample, where 2 to 16 are possible")]
    Precision { bits: u8 },
    #[error("it has no components")]
    NoComponents,
    #[error("two components have the same identifier")]
    ComponentTwice,
    #[error("image sizes of {bytes} bytes")]
    SizeBytes { bytes: u32 },
    #[error("a scan of {count} components")]
    ScanComponents { count: usize },
    #[error("a scan of the unknown component {id}")]
    ScanOfUnknown { id: u8 },
    #[error("a scan has the component {id} twice")]
    ScanOfTwice { id: u8 },
    #[error("the interleave mode {mode} of {count} components")]
    Interleave { mode: u8, count: usize },
    #[error("it has no columns")]
    NoColumns,
    #[error("a prediction error of {code} is larger than any at this precision")]
    PredictionError { code: u64 },
    #[error("a run goes past the end of its line")]
    LongRun,
    #[error("a marker was expected, not the byte {byte:#04x}")]
    NoMarker { byte: u8 },
    #[error("a marker was expected, not the bytes 0xff 0x00")]
    StuffedByte,
    #[error("a code word is longer than any that JPEG-LS has")]
    LongCode,
    #[error("it ends early")]
    EndsEarly,
    #[error("{parameter} {value} is not possible at {bits} bits")]
    Parameter { parameter: Parameter, value: u32, bits: u8 },
}

/// Features of JPEG-LS images that are not decoded.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Feature {
    #[error("lines of {columns} samples")]
    LineSamples { columns: u32 },
    #[error("a number of lines after the first scan")]
    LateLines,
    #[error("the extensions of JPEG-LS part 2")]
    Part2,
    #[error("the JPEG process SOF{number}")]
    Process { number: u8 },
    #[error("{count} components")]
    Components { count: usize },
    #[error("components of different sizes")]
    Subsampling,
    #[error("mapping tables (palettes)")]
    Palettes,
    #[error("preset parameters of type {kind}")]
    Presets { kind: u8 },
    #[error("sample interleaving of one component")]
    InterleaveOfOne,
    #[error("a point transform")]
    PointTransform,
    #[error("the colour transform {number}")]
    ColourTransform { number: u8 },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum SegmentKind {
    #[error("the frame")]
    Frame,
    #[error("the scan")]
    Scan,
    #[error("preset parameters")]
    Presets,
    #[error("the restart interval")]
    RestartInterval,
    #[error("Huffman tables")]
    HuffmanTables,
    #[error("arithmetic conditioning")]
    ArithmeticConditioning,
    #[error("application data")]
    ApplicationData,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Parameter {
    #[error("the largest sample")]
    LargestSample,
    #[error("the error bound")]
    ErrorBound,
    #[error("the gradient threshold")]
    GradientThreshold,
    #[error("the reset interval")]
    ResetInterval,
}
