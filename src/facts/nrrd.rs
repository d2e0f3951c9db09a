//! What can be wrong with NRRD headers.

use thiserror::Error;

/// Why an NRRD header is refused.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Error)]
pub(crate) enum NrrdFault {
    #[error("`{}` is not a version of NRRD that is read (1 to 5)", .magic.escape_debug())]
    Version { magic: String },
    #[error("its field `{field}: {}` makes no sense", .value.escape_debug())]
    Field { field: String, value: String },
    #[error("its header states no sample type")]
    NoType,
    #[error("its sample type `{}` is not read", .name.escape_debug())]
    Type { name: String },
    #[error("its header states no encoding")]
    NoEncoding,
    #[error("its encoding `{}` is not read", .name.escape_debug())]
    Encoding { name: String },
    #[error("its byte order `{}` is unknown", .name.escape_debug())]
    ByteOrder { name: String },
    #[error("its header states {sizes} sizes for {dimensions} dimensions")]
    Sizes { sizes: usize, dimensions: usize },
    #[error("its header has {entries} {field} for {axes} axes")]
    Entries { field: &'static str, entries: usize, axes: usize },
    #[error("{name} ends within its header, before the blank line")]
    NoBlankLine { name: String },
    #[error("lines are to be skipped in several data files, which is not read")]
    LinesOfSeveral,
    #[error("there are fewer than the {skip} lines to skip")]
    FewLines { skip: u64 },
    #[error("a byte skip of -1 is for raw samples only")]
    SkipAllButSamples,
    #[error("its data files `{}` make no sense", .value.escape_debug())]
    DataFiles { value: String },
    #[error("axis {axis} of its {axes} is {} and runs faster than space, so a voxel has several values; extract one component into a file of its own", quoted(.kind))]
    Components { axis: usize, axes: usize, kind: String },
    #[error("it has {count} axes in space, and a volume needs two or three")]
    SpatialAxes { count: usize },
    #[error(
        "is an empty segmentation: 3D Slicer writes a single voxel where no segment has any; there is nothing to build"
    )]
    EmptySegmentation,
    #[error("layer {layer} of the segmentation holds the value {value}, which no segment of its header has")]
    NoSegment { layer: u64, value: f64 },
    #[error("an axis has no direction")]
    NoDirection,
}

fn quoted(kind: &str) -> String {
    if kind.is_empty() { "no direction in space".to_owned() } else { format!("`{kind}`") }
}
