//! Sentences on compressed images.

use std::fmt::{self, Display, Formatter};

use crate::codec::{CodecError, Damage, Feature, Mismatch, jpeg, jpeg2000, jpegls, rle};

impl Display for CodecError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged(damage) => write!(f, "the compressed image is damaged: {damage}"),
            Self::Unsupported(feature) => {
                write!(f, "the compressed image uses {feature}, which is not supported")
            }
            Self::Memory { needed_bytes, allowed_bytes } => write!(
                f,
                "decoding the image needs {needed_bytes} bytes of memory, and {allowed_bytes} are allowed"
            ),
            Self::Io(error) => error.fmt(f),
        }
    }
}

impl Display for Damage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frame(mismatch) => mismatch.fmt(f),
            Self::Jpeg(damage) => damage.fmt(f),
            Self::JpegLs(damage) => damage.fmt(f),
            Self::Jpeg2000(damage) => damage.fmt(f),
            Self::Rle(damage) => damage.fmt(f),
        }
    }
}

impl Display for Feature {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Jpeg(feature) => feature.fmt(f),
            Self::JpegLs(feature) => feature.fmt(f),
            Self::Jpeg2000(feature) => feature.fmt(f),
            Self::Rle(feature) => feature.fmt(f),
        }
    }
}

impl Display for Mismatch {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Size { size: [columns, rows], stated: [x, y] } => {
                write!(f, "it is {columns}x{rows}, and the header says {x}x{y}")
            }
            Self::Samples { samples, stated } => {
                write!(f, "it has {samples} samples a pixel, and the header says {stated}")
            }
            Self::Bits { bits, allocated } => {
                write!(f, "it has {bits} bits a sample, and the header allocates {allocated}")
            }
            Self::ManyRows => f.write_str("it has more rows than it says"),
            Self::FewRows { rows, stated } => write!(f, "it has {rows} rows of {stated}"),
        }
    }
}

impl Display for jpeg::Damage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::ShortLength { length } => write!(f, "a marker segment claims a length of {length} bytes"),
            Self::ShortSegment => f.write_str("a marker segment is shorter than its contents"),
            Self::EndsEarly => f.write_str("it ends early"),
            Self::EndsBeforeImage => f.write_str("it ends before its image begins"),
            Self::EndsBeforePixels => f.write_str("it ends before its pixels begin"),
            Self::EndsBeforeLastScan => f.write_str("it ends before its last scan"),
            Self::GoesOn => f.write_str("its data go on after the last pixel"),
            Self::NoRestart { number } => write!(f, "restart marker {number} is missing"),
            Self::UnknownCode => f.write_str("it holds a code that its Huffman table does not have"),
            Self::ProgressiveCode => f.write_str("it holds a code of progressive images"),
            Self::LongBlock => f.write_str("a block has more than 64 coefficients"),
            Self::DifferenceBits { bits } => write!(f, "a difference has {bits} bits"),
            Self::CoefficientRange => f.write_str("a coefficient is out of range"),
            Self::NoWidth => f.write_str("its width is 0"),
            Self::NoComponents => f.write_str("it has no components"),
            Self::Component { id } => write!(f, "component {id} of the frame makes no sense"),
            Self::ComponentTwice { id } => write!(f, "component {id} comes twice in the frame"),
            Self::ScanComponents { count } => write!(f, "a scan has {count} components"),
            Self::ScanOfUnknown { id } => write!(f, "a scan names component {id}, which the frame has not"),
            Self::ScanOfTwice { id } => write!(f, "a scan names component {id} twice"),
            Self::ScanUnits { most } => write!(f, "a scan has more than {most} units in an MCU"),
            Self::ScanBeforeFrame => f.write_str("a scan comes before the frame header"),
            Self::ScanOutOfTurn => f.write_str("a scan comes out of its turn"),
            Self::ScanAgain => f.write_str("two scans hold the same component"),
            Self::NoScan => f.write_str("a component has no scan"),
            Self::SecondImage => f.write_str("another image begins before it is complete"),
            Self::UnknownMarker { code } => write!(f, "it holds the unknown marker 0x{code:02X}"),
            Self::SecondFrame => f.write_str("it has two frame headers"),
            Self::TableClass { class } => write!(f, "a Huffman table has the class {class}"),
            Self::TableNumber { number } => write!(f, "a Huffman table has the number {number}"),
            Self::TableCodes { codes } => {
                write!(f, "a Huffman table has {codes} codes, and 256 are the most there can be")
            }
            Self::TableCodesOfLength { bits } => {
                write!(f, "a Huffman table has too many codes of {bits} bits")
            }
            Self::Quantisation => f.write_str("a quantisation table makes no sense"),
            Self::NoHuffmanTable => f.write_str("a Huffman table that it needs is missing"),
            Self::NoQuantisationTable => f.write_str("a quantisation table that it needs is missing"),
            Self::NoStart => f.write_str("it does not begin as a JPEG image does"),
            Self::SampleRange => f.write_str("a sample is out of the range that its header gives"),
            Self::Predictor { predictor } => write!(f, "a lossless scan has the predictor {predictor}"),
            Self::PointTransform => f.write_str("the point transform leaves nothing of the samples"),
            Self::RestartWithinLine => f.write_str("restart markers stand within a line of a lossless image"),
            Self::RefinedBits => f.write_str("a refined coefficient has more than one bit"),
        }
    }
}

impl Display for jpeg::Feature {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Precision { bits } => write!(f, "JPEG with {bits} bits in a sample"),
            Self::LateHeight => f.write_str("a JPEG height given only after the pixels (DNL)"),
            Self::Components { count } => write!(f, "JPEG with {count} components"),
            Self::Arithmetic => f.write_str("arithmetic coding (JPEG)"),
            Self::Hierarchical => f.write_str("hierarchical JPEG"),
            Self::JpegLs => f.write_str("JPEG-LS inside a JPEG transfer syntax"),
            Self::SubsampledLossless => f.write_str("lossless JPEG with subsampled components"),
        }
    }
}

impl Display for jpegls::Damage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoStart => f.write_str("it does not begin as a JPEG image"),
            Self::NoFrame => f.write_str("its scan has no frame header"),
            Self::SecondFrame => f.write_str("it has two frame headers"),
            Self::ScanAgain => f.write_str("a component comes in two scans"),
            Self::NoRestart { code } => write!(f, "the marker {code:#04x} instead of a restart marker"),
            Self::SegmentLength { segment } => write!(f, "the segment of {segment} has a wrong length"),
            Self::MissingComponents => f.write_str("it ends before all its components came"),
            Self::Marker { code } => write!(f, "the marker {code:#04x} is out of place"),
            Self::Precision { bits } => write!(f, "{bits} bits per sample, where 2 to 16 are possible"),
            Self::NoComponents => f.write_str("it has no components"),
            Self::ComponentTwice => f.write_str("two components have the same identifier"),
            Self::SizeBytes { bytes } => write!(f, "image sizes of {bytes} bytes"),
            Self::ScanComponents { count } => write!(f, "a scan of {count} components"),
            Self::ScanOfUnknown { id } => write!(f, "a scan of the unknown component {id}"),
            Self::ScanOfTwice { id } => write!(f, "a scan has the component {id} twice"),
            Self::Interleave { mode, count } => write!(f, "the interleave mode {mode} of {count} components"),
            Self::NoColumns => f.write_str("it has no columns"),
            Self::PredictionError { code } => {
                write!(f, "a prediction error of {code} is larger than any at this precision")
            }
            Self::LongRun => f.write_str("a run goes past the end of its line"),
            Self::NoMarker { byte } => write!(f, "a marker was expected, not the byte {byte:#04x}"),
            Self::StuffedByte => f.write_str("a marker was expected, not the bytes 0xff 0x00"),
            Self::LongCode => f.write_str("a code word is longer than any that JPEG-LS has"),
            Self::EndsEarly => f.write_str("it ends early"),
            Self::Parameter { parameter, value, bits } => {
                write!(f, "{parameter} {value} is not possible at {bits} bits")
            }
        }
    }
}

impl Display for jpegls::Feature {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::LineSamples { columns } => write!(f, "lines of {columns} samples"),
            Self::LateLines => f.write_str("a number of lines after the first scan"),
            Self::Part2 => f.write_str("the extensions of JPEG-LS part 2"),
            Self::Process { number } => write!(f, "the JPEG process SOF{number}"),
            Self::Components { count } => write!(f, "{count} components"),
            Self::Subsampling => f.write_str("components of different sizes"),
            Self::Palettes => f.write_str("mapping tables (palettes)"),
            Self::Presets { kind } => write!(f, "preset parameters of type {kind}"),
            Self::InterleaveOfOne => f.write_str("sample interleaving of one component"),
            Self::PointTransform => f.write_str("a point transform"),
            Self::ColourTransform { number } => write!(f, "the colour transform {number}"),
        }
    }
}

impl Display for jpeg2000::Damage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PassesWithoutPlanes => "a code-block without bit planes has passes",
            Self::MorePassesThanPlanes => "a code-block has more passes than bit planes",
            Self::HighThroughputBlock => "a high-throughput code-block is impossible",
            Self::ManyBlocks => "too many code-blocks",
            Self::ShortPacketHeader => "a packet header ends early",
            Self::MissingPackets => "packets are missing",
            Self::ShortPacket => "a packet ends early",
            Self::EndlessPackets => "its packets lead nowhere",
            Self::BitPlanes => "a code-block has impossible bit planes",
            Self::BlockLength => "the length of a code-block is impossible",
            Self::ShortHeader => "a header ends early",
            Self::NoMarker => "a marker is expected in a header, and there is none",
            Self::NoSegmentLength => "a marker segment has no length",
            Self::NoStart => "it starts like neither a JPEG 2000 codestream nor a JP2 file",
            Self::ShortBox => "a JP2 box is shorter than its head",
            Self::NoCodestream => "the JP2 file holds no codestream",
            Self::NoSize => "the codestream does not begin with its size",
            Self::EmptyImage => "the image is empty",
            Self::EmptyTile => "the first tile holds nothing of the image",
            Self::Precision => "a precision of more than 38 bits",
            Self::ManyTiles => "more than 65535 tiles",
            Self::NoStep => "a sub-band has no quantisation step",
            Self::ManyLevels => "more than 32 decomposition levels",
            Self::LargeBlocks => "code-blocks of more than 4096 samples",
            Self::SmallPrecinct => "a precinct is smaller than a sample",
            Self::ManyPrecincts => "too many precincts",
            Self::QuantisationStyle => "an unknown quantisation style",
            Self::NoTile => "the main header is followed by no tile",
            Self::IncompleteHeader => "the main header lacks the coding style or the quantisation",
            Self::ComponentUndescribed => "a component is not described",
            Self::ComponentUnknown => "a header is for a component that is not there",
            Self::Progression => "an unknown progression order, or no layer",
            Self::ProgressionChanges => "an unknown progression order, or more than 32 changes of it",
            Self::NoTilePart => "a tile-part is expected, and there is none",
            Self::TileOutside => "a tile is outside the image",
            Self::EmptyTilePart => "a tile-part has no data",
            Self::ShortTilePart => "a tile-part is shorter than its header",
            Self::MixedWavelets => "components transformed together are of different wavelets",
        })
    }
}

impl Display for jpeg2000::Feature {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::CodingPasses => "that many coding passes of a code-block",
            Self::Palette => "a palette",
            Self::LongSide => "a side of more than 2147483647 pixels",
            Self::Components => "more than 255 components",
            Self::Subsampling => "subsampled components",
            Self::MixedComponents => "components of different precision or sign",
            Self::MixedBlockCoders => "code-blocks of both block coders",
            Self::Wavelet => "a wavelet transform of Part 2",
            Self::ComponentTransform => "a component transform of Part 2",
            Self::PackedHeaders => "packed packet headers",
            Self::LongCodestream => "a codestream of more than 4 GiB",
            Self::Precision => "samples of more than 28 bits",
            Self::BitPlanes => "that many bit planes",
        })
    }
}

impl Display for rle::Damage {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::ShortHeader { bytes } => write!(f, "{bytes} bytes are too few for an RLE header"),
            Self::Segments { count, wanted } => {
                write!(f, "its RLE header has {count} segments, where the pixels need {wanted}")
            }
            Self::SegmentPlace { segment, start, end, bytes } => {
                write!(f, "its RLE segment {segment} lies at {start} to {end} in a frame of {bytes} bytes")
            }
            Self::ShortSegment { segment } => write!(f, "its RLE segment {segment} ends early"),
        }
    }
}

impl Display for rle::Feature {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match *self {
            Self::SampleBytes { bytes } => write!(f, "RLE samples of {bytes} bytes"),
            Self::PixelBytes { bytes } => write!(f, "RLE pixels of {bytes} bytes"),
            Self::LineSamples { columns } => write!(f, "lines of {columns} samples"),
        }
    }
}

impl Display for jpegls::SegmentKind {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Frame => "the frame",
            Self::Scan => "the scan",
            Self::Presets => "preset parameters",
            Self::RestartInterval => "the restart interval",
            Self::HuffmanTables => "Huffman tables",
            Self::ArithmeticConditioning => "arithmetic conditioning",
            Self::ApplicationData => "application data",
        })
    }
}

impl Display for jpegls::Parameter {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::LargestSample => "the largest sample",
            Self::ErrorBound => "the error bound",
            Self::GradientThreshold => "the gradient threshold",
            Self::ResetInterval => "the reset interval",
        })
    }
}
