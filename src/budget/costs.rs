//! Measured memory costs of every job, other than the buffers that code asks for. Decoders, cleaning, merging and batches
//! have theirs where they are used.
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
pub(crate) const CODE_BYTES: u64 = if cfg!(debug_assertions) { 6 << 20 } else { 4 << 20 };

/// By how much the peak differs between two runs that open the same input, code included: which pages are mapped
/// with those that run depends on where the program lies in memory.
pub(crate) const OPENING_SPREAD: u64 = 384 << 10;

/// The smallest cap is stated in steps of this: less than the spread, and a number that people can read.
pub const STATED_STEP: u64 = 64 << 10;

pub(crate) use crate::platform::{HELD_SPREAD, MAPPED_FROM};

// ---- Workers.

/// Stack of a worker; only what is touched becomes resident, and that is part of [`WORKER_OVERHEAD`].
pub(crate) const WORKER_STACK: usize = 512 << 10;

/// A worker's stack as far as it is touched, its allocator arena and small change: anonymous memory of a build
/// with two threads, less that with one, less the buffers of one worker.
pub(crate) const WORKER_OVERHEAD: u64 = (192 << 10) + crate::platform::THREAD_BYTES;

/// Memory that a job holds outside its workers, and that the allocator wastes, in a process that does other things too:
/// the census, the output's buffer, the walk over the bricks, and the rounding of some twenty buffers.
pub(crate) const SHARE_OVERHEAD: u64 = 256 << 10;

/// Least buffers that a worker of a build is counted with, however few channels are stored: what merging normals and
/// values of 16 bits took when it was measured. The histograms of a threshold that is to be found fit in it, so that
/// the smallest cap that is stated does for every threshold.
pub(crate) const MIN_WORKER: u64 = 1124 << 10;

// ---- Opening.

/// Putting the images of a series in order may always take this: some 2,600 images.
pub(crate) const MIN_OPENING: u64 = 1 << 20;

/// Memory of a frame of a DICOM image while the images of its series are put in order: heap of opening a
/// series of 10,000 images, by image (`tests/it/catalogue_memory.rs` counts it).
pub(crate) const OPENING_FRAME: u64 = 400;

const _: () = assert!(HELD_SPREAD.is_multiple_of(STATED_STEP) && OPENING_SPREAD.is_multiple_of(STATED_STEP));
