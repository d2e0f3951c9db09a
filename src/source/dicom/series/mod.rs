//! The images of one series, and their volumes.
//!
//! | file | content |
//! |---|---|
//! | `survey` | recognition of images among other files, and loading of one series |
//! | `group` | groups of images with equal attributes; copies are dropped |
//! | `split` | separation of images that repeat positions: echoes, phases, ... |
//! | `axes` | directions of rows and columns |
//! | `gaps` | uneven and missing slices |
//! | `mosaic` | slices tiled into one picture |
//! | `assemble` | order of a group by position, with its gaps judged and filled; source of each slice |
//! | `volume` | [`volume::DicomVolume`], the source itself |
//! | `findings` | the volumes of a series, named without patient data |

pub(super) mod assemble;
pub(super) mod axes;
pub(super) mod findings;
pub(super) mod gaps;
pub(super) mod group;
pub(super) mod mosaic;
pub(super) mod split;
pub(super) mod survey;
pub(super) mod volume;
