//! Fewer rays where neighbours look alike (the paper, 5.2: coherence of colours).
//!
//! ```text
//! tile of 8 x 8 pixels: its corners, and the points half way --> all hit, and as the corners foretell? --> between
//!                                 |                                    no: the four quarters, the same again
//!                                 '-- one of them misses: every pixel of the tile
//! ```
//!
//! A tile through which a silhouette may pass is traced pixel by pixel, and by the tile's beam, so that nothing before the
//! background is overlooked; a hole or an edge within the model that is smaller than four pixels may be. What it costs is
//! told by `oct report`. A picture depends on neither threads nor bands.

use rayon::prelude::*;

use super::picture::Counts;
use super::tile::TILE;

/// What is seen in a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    pub(super) color: [u8; 3],
    /// Depth in mm; NaN for background.
    pub(super) depth: f32,
    pub(super) normal: [u8; 3],
}

impl Sample {
    pub(super) const NOTHING: Self = Self { color: [0; 3], depth: f32::NAN, normal: [0; 3] };

    pub(super) fn is_hit(&self) -> bool {
        !self.depth.is_nan()
    }
}

/// Looks through pixels; an answer depends on the pixel only.
pub(super) trait Look: Sync {
    /// What a worker keeps from one pixel to the next.
    type Kept: Send;

    /// That of a worker who begins.
    fn begin(&self) -> Self::Kept;

    /// What is seen in one pixel, and what that took.
    fn pixel(&self, kept: &mut Self::Kept, at: [usize; 2]) -> (Sample, Counts);

    /// The same for a tile of pixels from `corner` on, rows of [`TILE`].
    fn tile(&self, kept: &mut Self::Kept, corner: [usize; 2], out: &mut [Sample; TILE * TILE]) -> Counts;
}

/// What counts as alike.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerance {
    /// Greatest difference of a colour from what its neighbours foretell, of 255.
    pub(super) color: u8,
    /// The same of depths in mm.
    pub(super) depth_mm: f32,
}

/// Some rows of a picture.
pub(super) struct Band {
    width: usize,
    /// Rows of the picture.
    height: usize,
    top: usize,
    rows: usize,
    /// Samples of the band's rows, and of the row below.
    samples: Vec<Sample>,
    known: Vec<bool>,
}

/// A square of pixels with its corners, those of its right and lower side included.
#[derive(Clone, Copy, Debug)]
struct Block {
    low: [usize; 2],
    high: [usize; 2],
}

impl Block {
    fn middle(self) -> [usize; 2] {
        [0, 1].map(|a| usize::midpoint(self.low[a], self.high[a]))
    }

    /// Can it be divided?
    fn has_inside(self) -> bool {
        (0..2).any(|a| self.high[a] > self.low[a] + 1)
    }

    fn corners(self) -> [[usize; 2]; 4] {
        let ([x0, y0], [x1, y1]) = (self.low, self.high);
        [[x0, y0], [x1, y0], [x0, y1], [x1, y1]]
    }

    /// Half way between the corners.
    fn halves(self) -> [[usize; 2]; 5] {
        let ([x0, y0], [x, y], [x1, y1]) = (self.low, self.middle(), self.high);
        [[x, y0], [x0, y], [x, y], [x1, y], [x, y1]]
    }

    fn quarters(self) -> impl Iterator<Item = Self> {
        let ([x0, y0], [x, y], [x1, y1]) = (self.low, self.middle(), self.high);
        [([x0, y0], [x, y]), ([x, y0], [x1, y]), ([x0, y], [x, y1]), ([x, y], [x1, y1])]
            .into_iter()
            .filter(|(low, high)| low[0] < high[0] && low[1] < high[1])
            .map(|(low, high)| Self { low, high })
    }

    /// What the corners foretell of a pixel of the block.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between two bytes")]
    fn between(self, corners: [Sample; 4], [x, y]: [usize; 2]) -> Sample {
        let part =
            |a: usize, at: usize| (at - self.low[a]) as f32 / (self.high[a] - self.low[a]).max(1) as f32;
        let (u, v) = (part(0, x), part(1, y));
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let mean = |of: &dyn Fn(&Sample) -> f32| {
            corners.iter().zip(weights).map(|(sample, weight)| of(sample) * weight).sum::<f32>()
        };
        let byte = |of: &dyn Fn(&Sample) -> u8| (mean(&|s| f32::from(of(s))) + 0.5) as u8;
        Sample {
            color: std::array::from_fn(|c| byte(&|s| s.color[c])),
            depth: mean(&|s| s.depth),
            normal: std::array::from_fn(|c| byte(&|s| s.normal[c])),
        }
    }
}

/// Pixels that are looked through before what was seen is put in its place, and those of one task.
const LOOKS: usize = 1 << 14;
const LOOKS_EACH: usize = 32;

impl Band {
    /// Most bytes that a pixel of a band takes while it is filled: its sample, and lists of the blocks that it is in.
    pub(super) const PIXEL_BYTES: u64 = 64;

    /// Samples from `top` on, of `rows` rows of a picture; a whole number of tiles, or the picture's last rows.
    pub(super) fn new(width: usize, height: usize, top: usize, rows: usize) -> Self {
        let pixels = width * (rows + 1);
        Self { width, height, top, rows, samples: vec![Sample::NOTHING; pixels], known: vec![false; pixels] }
    }

    /// The samples of a row of the picture.
    pub(super) fn row(&self, y: usize) -> &[Sample] {
        let from = (y - self.top) * self.width;
        self.samples.get(from..from + self.width).unwrap_or_default()
    }

    fn at(&self, [x, y]: [usize; 2]) -> usize {
        (y - self.top) * self.width + x
    }

    fn sample(&self, pixel: [usize; 2]) -> Sample {
        self.samples.get(self.at(pixel)).copied().unwrap_or(Sample::NOTHING)
    }

    /// Looks through the pixels of a list that are not known yet.
    fn look(&mut self, look: &impl Look, pixels: impl Iterator<Item = [usize; 2]>) -> Counts {
        // Numbers of pixels of the band: their order is that of rows.
        #[expect(clippy::cast_possible_truncation, reason = "a picture has fewer than 2^32 pixels")]
        let mut pixels: Vec<u32> = pixels.map(|pixel| self.at(pixel) as u32).collect();
        pixels.sort_unstable();
        pixels.dedup();
        pixels.retain(|at| self.known.get(*at as usize) == Some(&false));
        let (width, top) = (self.width, self.top);
        let mut seen = Vec::new();
        let mut all = Counts::default();
        for pixels in pixels.chunks(LOOKS) {
            seen.clear();
            seen.resize(pixels.len(), Sample::NOTHING);
            let parts = pixels.par_chunks(LOOKS_EACH).zip(seen.par_chunks_mut(LOOKS_EACH));
            let counts = parts.map_init(
                || look.begin(),
                |kept, (pixels, seen)| {
                    pixels.iter().zip(seen).fold(Counts::default(), |all, (at, out)| {
                        let at = *at as usize;
                        let (sample, counts) = look.pixel(kept, [at % width, top + at / width]);
                        *out = sample;
                        all.plus(counts)
                    })
                },
            );
            all = all.plus(counts.reduce(Counts::default, Counts::plus));
            for (at, sample) in pixels.iter().zip(&seen) {
                let at = *at as usize;
                if let (Some(out), Some(known)) = (self.samples.get_mut(at), self.known.get_mut(at)) {
                    (*out, *known) = (*sample, true);
                }
            }
        }
        all
    }

    /// Does every one of these pixels show the model?
    fn all_hit(&self, pixels: impl IntoIterator<Item = [usize; 2]>) -> bool {
        pixels.into_iter().all(|pixel| self.sample(pixel).is_hit())
    }

    /// Fills the band; tells what that took.
    pub(super) fn fill(&mut self, look: &impl Look, tolerance: Tolerance) -> Counts {
        let last = [self.width - 1, self.height - 1];
        let bottom = self.top + self.rows;
        let tiles: Vec<Block> = (self.top..bottom)
            .step_by(TILE)
            .flat_map(|y| (0..self.width).step_by(TILE).map(move |x| [x, y]))
            .map(|low| Block { low, high: std::array::from_fn(|a| (low[a] + TILE).min(last[a])) })
            .collect();
        let points = tiles.iter().flat_map(|tile| tile.corners().into_iter().chain(tile.halves()));
        let mut counts = self.look(look, points);
        // A tile of one row or column has nothing between its corners.
        let is_wide = |tile: &Block| (0..2).all(|a| tile.high[a] > tile.low[a]);
        let (mut blocks, whole): (Vec<_>, Vec<_>) = tiles
            .into_iter()
            .partition(|tile| is_wide(tile) && self.all_hit(tile.corners().into_iter().chain(tile.halves())));
        counts = counts.plus(self.trace_tiles(look, &whole));
        while !blocks.is_empty() {
            let (alike, others): (Vec<_>, Vec<_>) =
                blocks.into_iter().partition(|block| self.is_alike(*block, tolerance));
            for block in alike {
                self.interpolate(block);
            }
            blocks = others.into_iter().flat_map(Block::quarters).filter(|b| b.has_inside()).collect();
            counts = counts.plus(self.look(look, blocks.iter().flat_map(|block| block.halves())));
        }
        counts
    }

    /// Traces every pixel of some tiles.
    fn trace_tiles(&mut self, look: &impl Look, tiles: &[Block]) -> Counts {
        let parts = tiles.chunks(LOOKS / (TILE * TILE));
        parts.fold(Counts::default(), |all, tiles| all.plus(self.trace_some(look, tiles)))
    }

    fn trace_some(&mut self, look: &impl Look, tiles: &[Block]) -> Counts {
        let seen: Vec<_> = tiles
            .par_iter()
            .map_init(
                || look.begin(),
                |kept, tile| {
                    let mut samples = [Sample::NOTHING; TILE * TILE];
                    let counts = look.tile(kept, tile.low, &mut samples);
                    (counts, samples)
                },
            )
            .collect();
        let mut all = Counts::default();
        for (tile, (counts, samples)) in tiles.iter().zip(seen) {
            all = all.plus(counts);
            for (i, sample) in samples.into_iter().enumerate() {
                let [x, y] = [tile.low[0] + i % TILE, tile.low[1] + i / TILE];
                if x < self.width && y < self.top + self.rows {
                    let at = self.at([x, y]);
                    if let (Some(out), Some(known)) = (self.samples.get_mut(at), self.known.get_mut(at)) {
                        (*out, *known) = (sample, true);
                    }
                }
            }
        }
        all
    }

    /// Do the corners of a block foretell what is seen half way between them?
    fn is_alike(&self, block: Block, tolerance: Tolerance) -> bool {
        let corners = block.corners().map(|pixel| self.sample(pixel));
        let alike = |pixel: [usize; 2]| {
            let (seen, foretold) = (self.sample(pixel), block.between(corners, pixel));
            let color = (0..3).all(|c| seen.color[c].abs_diff(foretold.color[c]) <= tolerance.color);
            color && (seen.depth - foretold.depth).abs() <= tolerance.depth_mm
        };
        corners.iter().all(Sample::is_hit) && block.halves().into_iter().all(alike)
    }

    /// Fills the pixels of a block between the four points of each quarter.
    fn interpolate(&mut self, block: Block) {
        for quarter in block.quarters() {
            let corners = quarter.corners().map(|pixel| self.sample(pixel));
            for y in quarter.low[1]..=quarter.high[1] {
                for x in quarter.low[0]..=quarter.high[0] {
                    let at = self.at([x, y]);
                    if self.known.get(at) == Some(&false)
                        && let Some(out) = self.samples.get_mut(at)
                    {
                        *out = quarter.between(corners, [x, y]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    /// A picture by formula that counts what is asked of it.
    struct Formula<F> {
        of: F,
        asked: AtomicU64,
    }

    impl<F: Fn(usize, usize) -> Option<u8> + Sync> Look for Formula<F> {
        type Kept = ();

        fn begin(&self) {}

        fn pixel(&self, (): &mut (), [x, y]: [usize; 2]) -> (Sample, Counts) {
            self.asked.fetch_add(1, Ordering::Relaxed);
            let seen = |c| Sample { color: [c; 3], depth: 5.0, normal: [1; 3] };
            let counts = Counts { rays: 1, ..Counts::default() };
            ((self.of)(x, y).map_or(Sample::NOTHING, seen), counts)
        }

        fn tile(&self, kept: &mut (), corner: [usize; 2], out: &mut [Sample; TILE * TILE]) -> Counts {
            let mut all = Counts::default();
            for (i, out) in out.iter_mut().enumerate() {
                let (sample, counts) = self.pixel(kept, [corner[0] + i % TILE, corner[1] + i / TILE]);
                (*out, all) = (sample, all.plus(counts));
            }
            all
        }
    }

    fn filled(
        size: [usize; 2],
        tolerance: u8,
        of: impl Fn(usize, usize) -> Option<u8> + Sync,
    ) -> (Vec<Option<u8>>, u64) {
        let look = Formula { of, asked: AtomicU64::new(0) };
        let mut all = Vec::new();
        let mut rays = 0;
        for top in (0..size[1]).step_by(16) {
            let mut band = Band::new(size[0], size[1], top, 16.min(size[1] - top));
            rays += band.fill(&look, Tolerance { color: tolerance, depth_mm: 1.0 }).rays;
            for y in top..(top + 16).min(size[1]) {
                all.extend(band.row(y).iter().map(|s| s.is_hit().then_some(s.color[0])));
            }
        }
        assert_eq!(rays, look.asked.into_inner());
        (all, rays)
    }

    #[test]
    fn smooth_pictures_need_few_rays_and_edges_need_all() {
        for size in [[64, 48], [61, 33], [8, 8], [1, 1], [3, 70], [9, 9]] {
            let [w, h] = size;
            let pixels = (w * h) as u64;
            let ramp = |x: usize, y: usize| Some(u8::try_from(x + 2 * y).unwrap());
            let (got, rays) = filled(size, 1, ramp);
            for (i, c) in got.iter().enumerate() {
                assert!(c.unwrap().abs_diff(ramp(i % w, i / w).unwrap()) <= 1);
            }
            if w > 30 && h > 30 {
                // A last row of tiles with one row of pixels is traced whole.
                let parts = if h % TILE == 1 { 2 } else { 8 };
                assert!(rays * parts < pixels, "{rays} of {pixels}");
            }
            // Noise: every pixel, and each as it is.
            let noise = |x: usize, y: usize| {
                let mut random = crate::render::selfcheck::Random::new((x * 8191 + y) as u64);
                Some(u8::try_from(random.bits() % 251).unwrap())
            };
            let (got, _) = filled(size, 0, noise);
            assert!(got.iter().enumerate().all(|(i, c)| *c == noise(i % w, i / w)), "{size:?}");
            // A silhouette is as it is.
            let disc = |x: usize, y: usize| ((x * x + y * y) < 900).then_some(7);
            let (got, _) = filled(size, 255, disc);
            for (i, c) in got.iter().enumerate() {
                assert_eq!(*c, disc(i % w, i / w), "{i} of {size:?}");
            }
        }
    }
}
