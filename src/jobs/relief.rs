//! Pictures within a cap of the process's resident memory.
//!
//! What a picture needs of its own is known before: bands of rows, as many as fit. The pages of the model that rays look
//! at are the system's, which has them in its cache in any case; but they count as the process's. Workers look after a
//! few tiles how much the process has, and give all pages of the model back when that is near the cap: what is looked at
//! again comes back from the cache. A picture does not depend on any of this.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::budget::{costs, own_rss_bytes, resident_bytes};
use crate::render::RenderError;
use crate::render::picture::{Canvas, parts_bytes};

/// Room for the pages of the model: half of it for those that are kept, half for those that a few tiles on each thread look
/// at before the next look at how many there are; 64 KiB come with each. Measured: 3 MiB.
const MODEL_PAGES: u64 = 8 << 20;

/// Fewest pixels of a band, if its 8 rows are not more.
const LEAST_BAND: u32 = 1 << 13;

/// Bytes of a pixel of a whole picture, and of what is known of the pixels of a band while it is painted.
const WHOLE_PIXEL: u64 = 4;
const BAND: u64 = 4 << 20;

/// Looks after the process's memory while a picture is made.
pub(super) struct Relief<'a> {
    limit_bytes: Option<u64>,
    give_back: &'a (dyn Fn() + Sync),
    gave: AtomicBool,
    /// From here on pages are given back.
    high: u64,
}

impl<'a> Relief<'a> {
    /// Keeps to a cap, if there is one, by giving pages back.
    pub(super) fn new(limit_bytes: Option<u64>, give_back: &'a (dyn Fn() + Sync)) -> Self {
        let high = limit_bytes.map_or(u64::MAX, |limit| limit.saturating_sub(MODEL_PAGES / 2));
        Self { limit_bytes, give_back, gave: AtomicBool::new(false), high }
    }

    /// Pixels of a band that fit, `None` for as many as usual.
    ///
    /// # Errors
    /// [`RenderError::Memory`] when the fewest do not fit.
    pub(super) fn band_pixels(&self, canvas: &Canvas) -> Result<Option<u32>, RenderError> {
        let Some(limit_bytes) = self.limit_bytes else { return Ok(None) };
        let base = base_bytes();
        let mut most = None;
        loop {
            let minimum_bytes = base + parts_bytes(&Canvas { most_band_pixels: most, ..*canvas });
            if minimum_bytes <= limit_bytes {
                return Ok(most);
            }
            match most {
                Some(LEAST_BAND) => return Err(too_small(limit_bytes, minimum_bytes)),
                Some(pixels) => most = Some(pixels / 2),
                None => most = Some(1 << 17),
            }
        }
    }

    /// Checks that pictures of so many pixels can be held as a whole.
    ///
    /// # Errors
    /// [`RenderError::Memory`] when they cannot.
    pub(super) fn hold_whole(&self, pixels: u64) -> Result<(), RenderError> {
        let minimum_bytes = base_bytes() + WHOLE_PIXEL * pixels + BAND;
        match self.limit_bytes {
            Some(limit_bytes) if minimum_bytes > limit_bytes => Err(too_small(limit_bytes, minimum_bytes)),
            _ => Ok(()),
        }
    }

    /// Were pages given back?
    pub(super) fn gave_back(&self) -> bool {
        self.gave.load(Ordering::Relaxed)
    }

    /// Looks how much the process has, and gives back what is too much.
    ///
    /// Cost: without a cap none, else a file of the system is read, some microseconds.
    pub(super) fn look(&self) {
        if self.limit_bytes.is_some() && resident_bytes() > self.high {
            self.gave.store(true, Ordering::Relaxed);
            (self.give_back)();
        }
    }
}

/// What the process has in any case, and room for pages of the model.
fn base_bytes() -> u64 {
    own_rss_bytes() + costs::CODE_BYTES + MODEL_PAGES
}

/// The least that is said to do is a little more, as no two runs are the same.
fn too_small(limit_bytes: u64, minimum_bytes: u64) -> RenderError {
    let minimum_bytes = (minimum_bytes + costs::HELD_SPREAD).next_multiple_of(costs::STATED_STEP);
    RenderError::Memory { limit_bytes, minimum_bytes }
}
