//! Pictures within a cap of the process's resident memory.
//!
//! The memory of the picture itself is known in advance: bands of rows, as many as fit. The pages of the model that
//! rays look at belong to the system, which has them in its cache in any case; but they count as the process's. So work
//! is done in small steps (a tile of rays, some rays of ambient occlusion), of which the largest growth is known. A
//! look at the resident memory tells how many steps may be taken before the next look; near the cap, all pages of the
//! model are given back, and come back from the cache when they are needed. The picture does not depend on any of this.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};

use crate::budget::{costs, mapped_rss_bytes, own_rss_bytes, resident_bytes};
use crate::platform;
use crate::render::{RenderError, RenderFault};
use crate::scene::PictureSettings;

/// Largest growth in a step: pages of the model, of which the system maps 16 at a time. It rises with the distance
/// between the boxes that neighbouring pixels show. Measured on cells at 1024^3 and skin at 4096^3, in MiB: 1.3 at 16
/// boxes to a pixel, 2.4 at 32, 4 at 80. No step looks at more than [`MAX_STEP`].
const STEP: u64 = 3 << 19;
/// Largest growth in a step of cells, of which more sections are read: in noise of 384^3 at two boxes to a pixel 2.1
/// MiB.
const STEP_OF_CELLS: u64 = 5 << 19;
const STEP_A_BOX: f64 = 50.0 * 1024.0;
const MAX_STEP: u64 = 20 << 20;

/// Pages of the model that are kept in any case; with fewer, they would be evicted all the time.
const KEPT_PAGES: u64 = 3 << 20;

/// Bytes of a file that the system maps together.
const MAPPED_AT_A_TIME: u64 = 64 << 10;

/// Pixels along a tile of rays.
const TILE: u32 = 8;

/// Fewest pixels of a band, unless its 8 rows are more.
const MIN_BAND: u32 = 1 << 13;

/// Bytes of a pixel of a whole picture.
const WHOLE_PIXEL: u64 = 4;

/// Keeps the process's memory to a cap while a picture is made.
pub(super) struct PictureMemory<'a> {
    limit_bytes: Option<u64>,
    give_back: &'a (dyn Fn() + Sync),
    gave: AtomicBool,
    /// Steps before the next look at the memory.
    steps: AtomicI64,
    /// Largest growth in a step.
    step_bytes: AtomicU64,
    threads: u64,
    /// Pixels of whole pictures that are held beyond the bands.
    held_pixels: u64,
    /// Size of the model's pages.
    model_bytes: u64,
    /// True if all pages fit, so that the memory need not be looked at.
    fits_whole: AtomicBool,
    /// Memory of the process without pages of the model: known before the first picture is made.
    base_bytes: OnceLock<u64>,
    /// The mapped model, if only its pages are capped.
    mapped: Option<&'a [u8]>,
}

impl<'a> PictureMemory<'a> {
    /// Keeps to a cap, if there is one, by giving pages of a model of so many bytes back; `held_pixels` of whole
    /// pictures are in memory at a time.
    pub(super) fn new(
        limit_bytes: Option<u64>,
        threads: usize,
        held_pixels: u64,
        (model_bytes, give_back): (u64, &'a (dyn Fn() + Sync)),
    ) -> Self {
        if limit_bytes.is_some() {
            // Code of the program's start and of opening the model.
            platform::give_back();
        }
        Self {
            limit_bytes,
            give_back,
            gave: AtomicBool::new(false),
            steps: AtomicI64::new(0),
            step_bytes: AtomicU64::new(STEP),
            threads: threads.max(1) as u64,
            held_pixels,
            model_bytes: model_bytes.next_multiple_of(MAPPED_AT_A_TIME),
            fits_whole: AtomicBool::new(false),
            base_bytes: OnceLock::new(),
            mapped: None,
        }
    }

    /// Keeps the pages of a mapped model to a cap, in a process that does other things too.
    pub(super) fn of_pages(
        limit_bytes: u64,
        threads: usize,
        (mapped, give_back): (&'a [u8], &'a (dyn Fn() + Sync)),
    ) -> Self {
        let model_bytes = mapped.len() as u64;
        let limit_bytes = Some(limit_bytes).filter(|limit| *limit < model_bytes);
        let relief = Self::new(None, threads, 0, (model_bytes, give_back));
        Self { limit_bytes, mapped: Some(mapped), ..relief }
    }

    /// Relief without a cap.
    pub(super) fn none() -> Self {
        Self::new(None, 1, 0, (0, &|| {}))
    }

    /// Pixels of a band that fit, `None` for the usual number; a pixel is so many boxes, or cells, wide.
    ///
    /// # Errors
    /// [`RenderError`] when the fewest do not fit.
    pub(super) fn band_pixels(
        &self,
        look: &PictureSettings,
        files: usize,
        boxes_wide: f64,
        cells: bool,
    ) -> Result<Option<u32>, RenderError> {
        let Some(limit_bytes) = self.limit_bytes else { return Ok(None) };
        // A flat picture has fewer rays to a tile.
        let side = |pixels: u32| f64::from(pixels.min(TILE)) / f64::from(TILE);
        let wide = boxes_wide.max(0.0) * side(look.width) * side(look.height);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "held to a limit")]
        let step_bytes =
            (if cells { STEP_OF_CELLS } else { STEP } + (STEP_A_BOX * wide) as u64).min(MAX_STEP);
        self.step_bytes.store(step_bytes, Ordering::Relaxed);
        if self.mapped.is_some() {
            return Ok(None);
        }
        // No picture touches more than the model's pages.
        let pages = KEPT_PAGES + self.under_way();
        self.fits_whole.store(self.model_bytes <= pages, Ordering::Relaxed);
        let base = *self.base_bytes.get_or_init(|| self.base()) + pages.min(self.model_bytes);
        let mut most = None;
        loop {
            let minimum_bytes = base + look.parts_bytes(files, most);
            if minimum_bytes <= limit_bytes {
                return Ok(most);
            }
            match most {
                Some(MIN_BAND) => return Err(too_small(limit_bytes, minimum_bytes)),
                Some(pixels) => most = Some(pixels / 2),
                None => most = Some(1 << 17),
            }
        }
    }

    /// True if pages were given back.
    pub(super) fn gave_back(&self) -> bool {
        self.gave.load(Ordering::Relaxed)
    }

    /// To be called after each step: looks at the resident memory when it may have come near the cap, and gives back
    /// the pages in excess.
    ///
    /// Cost: without a cap none; a look reads a file of the system, some microseconds.
    pub(super) fn look(&self) {
        if self.limit_bytes.is_none() || self.fits_whole.load(Ordering::Relaxed) {
            return;
        }
        if self.steps.fetch_sub(1, Ordering::Relaxed) <= 0 {
            self.look_now();
        }
    }

    /// [`PictureMemory::look`] where the steps so far cannot be counted.
    pub(super) fn look_now(&self) {
        let Some(limit_bytes) = self.limit_bytes else { return };
        let room = limit_bytes.saturating_sub(self.resident_bytes());
        match room.checked_sub(self.under_way()) {
            Some(free) => {
                let steps = free / self.step_bytes.load(Ordering::Relaxed);
                self.steps.store(steps.cast_signed(), Ordering::Relaxed);
            }
            None => {
                self.gave.store(true, Ordering::Relaxed);
                (self.give_back)();
                if self.mapped.is_none() && resident_bytes().saturating_add(self.under_way()) > limit_bytes {
                    // Code that runs only once, and is larger than its estimate in builds without optimisation.
                    platform::give_back();
                }
            }
        }
    }

    /// The present size of the capped memory.
    fn resident_bytes(&self) -> u64 {
        match self.mapped {
            Some(mapped) => mapped_rss_bytes(mapped).unwrap_or(0),
            None => resident_bytes(),
        }
    }

    /// Memory of the process without pages of the model, whole pictures included.
    fn base(&self) -> u64 {
        let held = WHOLE_PIXEL * self.held_pixels;
        own_rss_bytes() + costs::CODE_BYTES + held
    }

    /// Room for the present steps of all threads, and for one more.
    fn under_way(&self) -> u64 {
        (self.threads + 1).saturating_mul(self.step_bytes.load(Ordering::Relaxed))
    }
}

/// The stated minimum is a little higher than needed, as no two runs are the same; that of a packed model, whose
/// threads leave heaps behind, differs by up to 256 KiB.
fn too_small(limit_bytes: u64, minimum_bytes: u64) -> RenderError {
    let minimum_bytes = (minimum_bytes + 2 * costs::HELD_SPREAD).next_multiple_of(costs::STATED_STEP);
    RenderError::from(RenderFault::Memory { limit_bytes, minimum_bytes })
}
