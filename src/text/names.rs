//! Names of options and jobs in sentences: fields and functions for a Rust caller, flags and commands for the user of a
//! program that sets its own spelling.

use std::fmt;
use std::sync::OnceLock;

/// The name of an option or a job in a sentence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Name(&'static str);

static SPELLER: OnceLock<fn(&str) -> String> = OnceLock::new();

/// Sets the spelling of names in all sentences of this process; the first call counts. The default are the library's
/// names.
pub fn spell(speller: fn(&str) -> String) {
    let _ = SPELLER.set(speller);
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match SPELLER.get() {
            Some(speller) => f.write_str(&speller(self.0)),
            None => f.write_str(self.0),
        }
    }
}

macro_rules! names {
    ($($constant:ident = $name:literal),* $(,)?) => {
        $(pub(crate) const $constant: Name = Name($name);)*

        impl Name {
            /// The library's names of everything that sentences name.
            pub const ALL: &[&str] = &[$($name),*];
        }
    };
}

names! {
    // Options: fields of the types of options, or values of such a field.
    ALL_VOLUMES = "all_volumes",
    BOTH_WAYS = "both_ways",
    CHANNELS = "channels",
    DIMS = "dims",
    DOWNSAMPLE = "downsample",
    DROP_BELOW = "drop_below",
    DTYPE = "scalar",
    EACH = "jobs::export::export_each",
    ERROR = "error",
    EYE = "eye",
    FILL = "fill",
    FOLLOW_LINKS = "follow_links",
    FORCE = "replace",
    FORM = "form",
    GAPS = "gaps",
    GRADIENT = "gradient",
    GRID = "grid",
    INDEX = "index",
    ISO = "Threshold::Iso",
    KEEP_LARGEST = "keep_largest",
    FILL_CAVITIES = "fill_cavities",
    KEEP_NAMES = "keep_names",
    KEEP_THIN = "keep_thin",
    LABELS = "labels",
    LEGEND = "legend",
    LEVELS = "levels",
    LOD = "lod",
    LOOK_AT = "look_at",
    MEASURE = "anyway",
    MEMORY = "memory",
    MIN_SLICES = "min_slices",
    NAMES = "label_names",
    ORIENTATION = "orientation",
    ORIGIN = "origin_mm",
    OUT = "out",
    OUTPUT = "output",
    OVERLAP = "overlap",
    PORT = "port",
    PRESET = "preset",
    RANGE = "Threshold::Range",
    ROI = "roi",
    SCRATCH = "scratch",
    SECTION = "section",
    SKIN = "skin_only",
    SKIP = "skip",
    SMOOTH = "smooth",
    SPACING = "spacing_mm",
    STAGE = "jobs::parts::Stage",
    SURFACE = "surface",
    THREADS = "threads",
    THUMBNAILS_OF_ALL = "thumbnails_of_all",
    TRAVERSAL = "traversal",
    TRIANGLES = "triangles",
    UNCERTAINTY = "uncertainty",
    UNIT = "unit_mm",
    UP = "up",
    VISIBLE_FROM = "visible_from",
    VOLUME = "volume",
    VOXEL = "GridChoice::Voxel",
    // Jobs.
    BUILD = "build",
    BUILD_INPUT = "jobs::build(INPUT)",
    COMPARE = "jobs::compare",
    INFO = "jobs::info",
    MERGE = "jobs::parts::merge",
    PART = "jobs::parts::part",
    PLAN = "jobs::parts::plan",
    RENDER = "jobs::picture",
    SCAN = "jobs::scan",
    STRIP = "jobs::pack::strip",
    THICKNESS = "jobs::thickness",
    UNPACK = "jobs::pack::unpack",
    VERIFY = "jobs::verify",
    VIEW = "jobs::view",
}
