//! Volumes in files other than DICOM. One program for all of it, as linking costs more than most of these tests.
//!
//! | file | promise |
//! |---|---|
//! | `chunked` | Zarr arrays and OME-Zarr images give the model of their samples; damage is named with its chunk |
//! | `foreign` | other programs' volumes: one model by every route, kinds that are not read, pipes |
//! | `formats_read` | every format gives the values, type and place of what was written |
//! | `headerless` | raw files, whole or one for each slice |
//! | `placement` | spacing and directions, stated by the file, beside it, or by the caller |
//! | `thresholds` | labels are all inside, padding is left out, and all else is as Otsu has it |

mod chunked;
mod foreign;
mod formats_read;
mod headerless;
mod placement;
mod thresholds;
