//! Memory costs other than the buffers that code asks for: one place for every measured figure.
//!
//! A buffer's size is chosen where the buffer is, and is exact. What stands here is caused by others (the
//! system that maps code, the C library's allocator, stacks, the insides of decoders) or bounds what cannot
//! be known beforehand, and holds for the machines that it was measured on: x86-64 Linux, pages of 4 KiB,
//! glibc 2.36. `scripts/costs.py` measures them again with a release build and prints each next to the figure
//! that stands here; run it after the compiler, a large dependency or the allocator's settings have changed.
//!
//! | figures of | measured by |
//! |---|---|
//! | code | `scripts/costs.py code` |
//! | spreads | `scripts/costs.py spreads` |
//! | workers | `scripts/costs.py workers` |
//! | shares, merging, readers and decoders | `cargo test --test it -- --nocapture budget::` counts allocations |
//! | cleaning | `scripts/costs.py cleaning` |
//! | opening | `cargo test --test it -- --nocapture catalogue_memory::` |
//! | a batch | `scripts/costs.py batch` |
//!
//! `tests/it/memory.rs` and `scripts/memory.py` hold their sum to the cap, and `tests/it/budget.rs` what a build or a
//! reader allocates to what it has reserved.

// ---- The process.

/// Code and constants of the program, and of the libraries it uses, that one stage of a job has resident at
/// most, if the stages before it gave theirs back; larger where they are not optimised.
///
/// Measured over every reader, cleaning and range as the largest `RssFile` while a job holds most, with room for
/// where the system happens to place them: sixteen pages are mapped around each one that runs, or more where the
/// page cache holds the file in larger pieces. A fresh copy of the program takes 0.5 MiB more than one that was
/// read in bit by bit, so compare two programs as copies that were made together. Such a copy
/// passes this figure by up to 0.6 MiB where a build counts a histogram or decodes; what workers reserve and never
/// touch covers that, as `tests/it/memory.rs` and `scripts/memory.py` show.
pub const CODE_BYTES: u64 = if cfg!(debug_assertions) { 6 << 20 } else { 4 << 20 };

/// By how much [`super::MemoryCap::held`] differs between two runs of the same job: largest less smallest
/// `RssAnon` at the same place. Added where the smallest cap is stated, so that it does work.
pub const HELD_SPREAD: u64 = 192 << 10;

/// By how much the peak differs between two runs that open the same input, code included: which pages are mapped
/// with those that run depends on where the program lies in memory.
pub const OPENING_SPREAD: u64 = 384 << 10;

/// The smallest cap is stated in steps of this: less than the spread, and a number that people can read.
pub const STATED_STEP: u64 = 64 << 10;

pub use crate::platform::MAPPED_FROM;

// ---- Workers.

/// Stack of a worker; only what is touched becomes resident, and that is part of [`WORKER_OVERHEAD`].
pub const WORKER_STACK: usize = 512 << 10;

/// A worker's stack as far as it is touched, its allocator arena and small change: anonymous memory of a build
/// with two threads, less that with one, less the buffers of one worker.
pub const WORKER_OVERHEAD: u64 = 192 << 10;

/// Memory that a job holds outside its workers, and that the allocator wastes, in a process that does other things too:
/// the census, the output's buffer, the walk over the bricks, and the rounding of some twenty buffers.
pub const SHARE_OVERHEAD: u64 = 256 << 10;

/// Least buffers that a worker of a build is counted with, however few channels are stored: what merging normals and
/// values of 16 bits took when it was measured. The histograms of a threshold that is to be found fit in it, so that
/// the smallest cap that is stated does for every threshold.
pub const MIN_WORKER: u64 = 1124 << 10;

/// Small lists of a merging worker (chains of fragments, groups of bricks, summaries) at their longest: a column
/// of bricks that are all skin, `noise` in `scripts/memory.py`.
pub const MERGE_LISTS: u64 = 64 << 10;

// ---- Cleaning.

/// Memory that cleaning leaves resident in a process of its own, because the allocator keeps it: anonymous memory after
/// [`crate::clean::CleanOptions::clean`], less that before.
pub const CLEANING_LEFT_OVER: u64 = 640 << 10;

// ---- Opening.

/// Putting the images of a series in order may always take this: some 2,600 images.
pub const MIN_OPENING: u64 = 1 << 20;

/// Memory of a frame of a DICOM image while the images of its series are put in order: heap of opening a
/// series of 10,000 images, by image (`tests/it/catalogue_memory.rs` counts it).
pub const OPENING_FRAME: u64 = 400;

/// The same of a tiled (mosaic) image, whose tables hold every tile.
pub const OPENING_MOSAIC: u64 = 2600;

// ---- Readers: memory of their decoders without the rows, which are counted exactly.

/// Read buffers, tables of decoders and small change of any DICOM codec but JPEG 2000, which counts its own.
pub const DICOM_DECODER: u64 = 256 << 10;

/// The tables of a palette, read as it is turned into grey.
pub const DICOM_PALETTE: u64 = 384 << 10;

/// The table of a modality look-up, 2^16 entries of 16 bits.
pub const DICOM_LOOKUP: u64 = 128 << 10;

/// The state of an inflater without its input and output buffers: its window, twice, and tables.
pub const INFLATER: u64 = 64 << 10;

/// The state of a bzip2 decoder without its block, which is 2.5 times as long as its level says.
pub const BZIP2: u64 = 128 << 10;

/// The decoder of a compressed TIFF page: an inflater's window or a table of LZW codes, and the directory.
pub const TIFF_DECODER: u64 = 160 << 10;

/// The decoder of a PNG file: the inflater, its window, and two rows.
pub const PNG_DECODER: u64 = 512 << 10;

// ---- A batch.

/// Code that is resident on top of that of one stage of one job: other jobs are at other stages.
pub const BATCH_CODE: u64 = 1 << 20;

/// Memory for opening a small input and watching a job, for each job.
pub const JOB_OVERHEAD: u64 = 704 << 10;

/// Least memory that a job is of use with: a build of small slices.
pub const MIN_JOB: u64 = 1536 << 10;

/// Series that take more to be opened, of some 40,000 images, are left aside where the least memory for a batch
/// is stated.
pub const USUAL_OPENING: u64 = 16 << 20;

/// Most pages of a model that a thumbnail touches: coarse levels of however large a model.
pub const THUMBNAIL_PAGES: u64 = 5 << 20;

const _: () = assert!(HELD_SPREAD.is_multiple_of(STATED_STEP) && OPENING_SPREAD.is_multiple_of(STATED_STEP));
