//! The images of one series, and the volumes that they are.
//!
//! | file | what it does |
//! |---|---|
//! | `survey` | recognises images among other files, and loads the images of one series |
//! | `group` | groups them by what must be equal, drops copies |
//! | `split` | separates images that repeat positions: echoes, phases, ... |
//! | `axes` | directions of rows and columns |
//! | `layer` | where a slice of a volume comes from |
//! | `gaps` | uneven and missing slices |
//! | `mosaic` | slices tiled into one picture |
//! | `assemble` | orders a group by position, judges and fills its gaps |
//! | `volume` | [`volume::DicomVolume`], the source itself |
//! | `findings` | the volumes of a series, named without patient data |

pub(super) mod assemble;
pub(super) mod axes;
pub(super) mod findings;
pub(super) mod gaps;
pub(super) mod group;
pub(super) mod layer;
pub(super) mod mosaic;
pub(super) mod split;
pub(super) mod survey;
pub(super) mod volume;
