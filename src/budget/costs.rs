//! Measured memory costs of every job, other than the buffers that code asks for. Decoders, cleaning, merging and
//! batches define theirs where they are used.
//!
//! A buffer's size is chosen where the buffer is, and is exact. The figures here have other causes (the system that
//! maps code, the C library's allocator, stacks, decoders of other crates) or bound costs that cannot be known
//! beforehand, and hold for the machines that they were measured on: x86-64 Linux, pages of 4 KiB, glibc 2.36.
//! `scripts/costs.py` measures them again with a release build and prints each next to its constant; run it after the
//! compiler, a large dependency or the allocator's settings have changed.
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
//! `tests/it/memory.rs` and `scripts/memory.py` check their sum against the cap, and `tests/it/budget.rs` the
//! allocations of a build or a reader against its reservations.

// ---- The process.

/// Most resident code and constants of one stage of a job, the program's and its libraries', if the stages before it
/// gave theirs back; larger in builds without optimisation.
///
/// Measured over every reader, cleaning and range as the largest `RssFile` while a job holds most, with a margin for
/// the place in memory: sixteen pages are mapped around each one that runs, or more where the page cache holds the file
/// in larger pieces. A fresh copy of the program takes 0.5 MiB more than one that was read in bit by bit, so compare
/// two programs as copies that were made together. Such a copy exceeds this figure by up to 0.6 MiB where a build
/// counts a histogram or decodes; memory that workers reserve and never touch covers that, as `tests/it/memory.rs` and
/// `scripts/memory.py` show.
pub(crate) const CODE_BYTES: u64 = if cfg!(debug_assertions) { 6 << 20 } else { 4 << 20 };

/// Difference of the peak between two runs that open the same input, code included: the program's place in memory
/// decides which pages are mapped with those that run.
pub(crate) const OPENING_SPREAD: u64 = 384 << 10;

/// Step of the stated smallest cap: less than the spread, and a readable number.
pub const STATED_STEP: u64 = 64 << 10;

pub(crate) use crate::platform::{HELD_SPREAD, MAPPED_FROM};

// ---- Workers.

/// Stack of a worker; only touched pages become resident, and these are part of [`WORKER_OVERHEAD`].
pub(crate) const WORKER_STACK: usize = 512 << 10;

/// Touched stack of a worker, its allocator arena and small allocations: anonymous memory of a build with two threads,
/// less the memory of a build with one, less the buffers of one worker.
pub(crate) const WORKER_OVERHEAD: u64 = (192 << 10) + crate::platform::THREAD_BYTES;

/// Memory that a job holds outside its workers, and that the allocator wastes, in a process with other work: the
/// census, the output's buffer, the walk over the bricks, and the rounding of some twenty buffers.
pub(crate) const SHARE_OVERHEAD: u64 = 256 << 10;

/// Least buffers that a worker of a build is counted with, however few channels are stored: the measured need of
/// merging normals and values of 16 bits. The histograms of an unknown threshold fit in it, so that the stated smallest
/// cap holds for every threshold.
pub(crate) const MIN_WORKER: u64 = 1124 << 10;

// ---- Opening.

/// Memory that is always allowed for ordering the images of a series: some 2,600 images.
pub(crate) const MIN_OPENING: u64 = 1 << 20;

/// Memory of a frame of a DICOM image while the images of its series are ordered: heap of opening a series of 10,000
/// images, by image (`tests/it/catalogue_memory.rs` counts it).
pub(crate) const OPENING_FRAME: u64 = 400;

const _: () = assert!(HELD_SPREAD.is_multiple_of(STATED_STEP) && OPENING_SPREAD.is_multiple_of(STATED_STEP));
