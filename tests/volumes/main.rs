//! Volumes in files other than DICOM. One program for all of it, as linking costs more than most of these tests.
//!
//! | file | promise |
//! |---|---|
//! | `formats_read` | every format gives the values, type and place of what was written |
//! | `formats_hostile` | no bytes make a reader panic, loop, or allocate much |
//! | `headerless` | raw files, whole or one for each slice |
//! | `placement` | spacing and directions, stated by the file, beside it, or by the caller |
//! | `thresholds` | labels are all inside, padding is left out, and all else is as Otsu has it |

#[path = "../support/command.rs"]
mod command;
#[path = "../support/data.rs"]
mod data;
#[path = "../support/dicom.rs"]
mod dicom;
#[path = "../support/formats.rs"]
mod formats;
#[path = "../support/random.rs"]
mod random;
#[path = "../support/volume.rs"]
mod volume;

mod formats_hostile;
mod formats_read;
mod headerless;
mod placement;
mod thresholds;
