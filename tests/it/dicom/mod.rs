//! DICOM, from bytes to volumes. One program for all of it, as linking costs more than most of these tests.
//!
//! | file | promise |
//! |---|---|
//! | `behaviours_pixels`, `behaviours_series` | what users expect of pixels and frames, and of series, by number |
//! | `expected` | the stored values of every real file are those of another reader |
//! | `frame_files` | fragments find their frames, and cost no memory |
//! | `hostile` | no bytes make the scanner panic, loop, or allocate much |
//! | `mosaic` | Siemens mosaics become volumes |
//! | `objects` | nuclear medicine, dose, segmentations, parametric maps |
//! | `real` | every folder of real data: which volumes are found |
//! | `series_files` | a series is what its positions describe |
//! | `told` | what a series lacks reaches the user |

mod behaviours_pixels;
mod behaviours_series;
mod expected;
mod frame_files;
mod hostile;
mod mosaic;
mod objects;
mod real;
mod series_files;
mod told;
