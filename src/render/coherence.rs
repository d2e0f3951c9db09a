//! Fewer rays where neighbours look alike (the paper, 5.2: coherence of colours).
//!
//! ```text
//! tile of 8 x 8 pixels: nine of them --> between four: they hit, on one surface, in nearly one colour? --> their mean
//!                                            |                                                              |
//!                                            '-- no: a ray <-- the next pixels, between those that are known '
//! ```
//!
//! A pixel is foretold by the known pixels around it, traced or foretold themselves, at a distance of 4, 2 and 1 pixels,
//! first on the diagonals, then on the lines. It gets a ray of its own where one of them is background, where their
//! colours differ by more than is borne, or where their depths do not lie on one smooth surface. So a silhouette is
//! traced: so is every pixel next to background, and the border of its tile, and nothing before the background is
//! overlooked that is seen by one of the nine or next to one; a hole or an edge within the model that is smaller than
//! four pixels may be. What it costs is told by `oct report`. Tiles know nothing of each other: a picture depends on
//! neither threads nor bands. Along its border, where background may reach in from the next tile, a tile bears a
//! quarter of the difference in colour.
//!
//! Pictures of 1024^2, `oct demo` at 256^3, from the front, part of the picture's pixels that are traced, and of those
//! that are off by more than 2 of 255:
//!
//! | how | coherence 2 | coherence 4 |
//! |---|---|---|
//! | blocks of 8 x 8 pixels divided in four where the points half way are not as the corners foretell | 38 %, .51 % | 30 %, 2.1 % |
//! | as above, without what is traced along the border and beside background besides | 28 %, .000 % | 23 %, .26 % |
//! | the same on a grid of every fourth pixel of the picture, over the borders of tiles | 27 %, .000 % | 23 %, .15 %; rows of other bands are needed |
//! | the same with depths borne to a fifth | 30 %, .000 % | |

use super::picture::Counts;
use super::tile::{RAYS, TILE};

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

/// What counts as alike.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tolerance {
    /// Greatest difference between the colours around a pixel, of 255.
    pub(super) color: u8,
    /// The same of the depths that foretell its depth, in mm.
    pub(super) depth_mm: f32,
}

/// Columns and rows of a tile that are traced in any case.
const FIRST: [usize; 3] = [0, 4, 7];

/// Those that are half way between known ones, one after the other.
const HALVES: [&[usize]; 2] = [&[2, 5], &[1, 3, 6]];

/// A pixel, and the known ones that foretell it.
struct Foretold {
    pixel: usize,
    /// On opposite sides of it, two and two; the second two may be one that only has to look alike.
    around: [usize; 4],
    weights: [f32; 4],
    /// Parts of the first and the third in the depth where the two pairs cross on a smooth surface; `None` where the
    /// second pair is no pair.
    crossing: Option<[f32; 2]>,
}

/// In which order the pixels of a tile are found.
pub(super) struct Plan {
    /// Those that are traced in any case, as bits.
    first: u64,
    /// No pixel of a round is foretold by another of it.
    rounds: Vec<Vec<Foretold>>,
}

fn number(x: usize, y: usize) -> usize {
    y * TILE + x
}

impl Plan {
    pub(super) fn new() -> Self {
        let mut known = FIRST.to_vec();
        let mut first = 0;
        for y in FIRST {
            first |= FIRST.iter().fold(0, |row, x| row | 1_u64 << number(*x, y));
        }
        let mut rounds = Vec::new();
        for halves in HALVES {
            let between = |at: usize| {
                let low = known.iter().copied().filter(|k| *k < at).max().unwrap_or(0);
                let high = known.iter().copied().filter(|k| *k > at).min().unwrap_or(TILE - 1);
                (low, high, (at - low) as f32 / (high - low) as f32)
            };
            let mut diagonals = Vec::new();
            for y in halves {
                for x in halves {
                    let ((x0, x1, u), (y0, y1, v)) = (between(*x), between(*y));
                    diagonals.push(Foretold {
                        pixel: number(*x, *y),
                        around: [number(x0, y0), number(x1, y1), number(x1, y0), number(x0, y1)],
                        weights: [(1.0 - u) * (1.0 - v), u * v, u * (1.0 - v), (1.0 - u) * v],
                        crossing: Some([0.5; 2]),
                    });
                }
            }
            let mut lines = Vec::new();
            for at in halves {
                let (low, high, u) = between(*at);
                for across in &known {
                    let before = halves.iter().copied().filter(|half| half < across).max();
                    let after = halves.iter().copied().filter(|half| half > across).min();
                    for turned in [false, true] {
                        let place =
                            |along: usize, a: usize| if turned { number(a, along) } else { number(along, a) };
                        let (beside, crossed) = match (before, after) {
                            (Some(before), Some(after)) => ([before, after], true),
                            (Some(one), None) | (None, Some(one)) => ([one; 2], false),
                            (None, None) => ([*across; 2], false),
                        };
                        let half = if crossed { 0.5 } else { 1.0 };
                        let v = (*across as f32 - beside[0] as f32)
                            / (beside[1] as f32 - beside[0] as f32).max(1.0);
                        lines.push(Foretold {
                            pixel: place(*at, *across),
                            around: [
                                place(low, *across),
                                place(high, *across),
                                place(*at, beside[0]),
                                place(*at, beside[1]),
                            ],
                            weights: [half * (1.0 - u), half * u, (1.0 - half) * (1.0 - v), (1.0 - half) * v],
                            crossing: crossed.then_some([1.0 - u, 1.0 - v]),
                        });
                    }
                }
            }
            rounds.extend([diagonals, lines]);
            known.extend_from_slice(halves);
        }
        Self { first, rounds }
    }

    /// Finds what the pixels of a tile show; `rays` are those that lie in the picture, `look` traces some and puts what
    /// they see in its place.
    pub(super) fn fill(
        &self,
        tolerance: Tolerance,
        rays: u64,
        samples: &mut [Sample; RAYS],
        mut look: impl FnMut(u64, &mut [Sample; RAYS]) -> Counts,
    ) -> Counts {
        // Tiles at the border of the picture are traced whole.
        if rays != u64::MAX {
            return look(rays, samples);
        }
        // Beyond the border may be background that reaches in between two pixels that hit.
        let strict = Tolerance { color: tolerance.color.min(2.max(tolerance.color / 4)), ..tolerance };
        let mut counts = look(self.first, samples);
        let mut traced = self.first;
        for round in &self.rounds {
            let mut missing = 0;
            for foretold in round {
                let at_border = BORDER >> foretold.pixel & 1 == 1;
                match foretold.sample(samples, if at_border { strict } else { tolerance }) {
                    Some(sample) => samples[foretold.pixel % RAYS] = sample,
                    None => missing |= 1 << foretold.pixel,
                }
            }
            if missing != 0 {
                counts = counts.plus(look(missing, samples));
                traced |= missing;
            }
        }
        // Along a silhouette nothing is foretold: background reaches as far as rays find it from pixel to pixel, and into
        // a tile from all sides.
        loop {
            let open = background(samples);
            let missing = (beside(open) | if open == 0 { 0 } else { BORDER }) & !traced;
            if missing == 0 {
                return counts;
            }
            counts = counts.plus(look(missing, samples));
            traced |= missing;
        }
    }
}

/// The outermost pixels of a tile.
const BORDER: u64 = 0xff81_8181_8181_81ff;

/// The pixels of a tile that show background.
fn background(samples: &[Sample; RAYS]) -> u64 {
    samples.iter().enumerate().fold(0, |bits, (i, sample)| bits | u64::from(!sample.is_hit()) << i)
}

/// These pixels of a tile and the eight around each.
fn beside(pixels: u64) -> u64 {
    const LEFT: u64 = 0x0101_0101_0101_0101;
    let rows = pixels | (pixels & !LEFT) >> 1 | (pixels & !(LEFT << (TILE - 1))) << 1;
    rows | rows << TILE | rows >> TILE
}

impl Foretold {
    /// The mean of the pixels around, if they are alike.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between bytes")]
    fn sample(&self, samples: &[Sample; RAYS], tolerance: Tolerance) -> Option<Sample> {
        let around = self.around.map(|pixel| samples[pixel % RAYS]);
        if !around.iter().all(Sample::is_hit) {
            return None;
        }
        for c in 0..3 {
            let colors = around.map(|sample| sample.color[c]);
            let (least, most) = colors.iter().fold((255, 0), |(l, m), c| (*c.min(&l), *c.max(&m)));
            if most - least > tolerance.color {
                return None;
            }
        }
        let mean = |of: &dyn Fn(&Sample) -> f32| {
            around.iter().zip(self.weights).map(|(sample, weight)| of(sample) * weight).sum::<f32>()
        };
        if let Some([first, third]) = self.crossing {
            let [d0, d1, d2, d3] = around.map(|sample| sample.depth);
            let one = d0 * first + d1 * (1.0 - first);
            let other = d2 * third + d3 * (1.0 - third);
            let apart = (one - other).abs();
            // Not a number is not alike.
            if apart.is_nan() || apart > tolerance.depth_mm {
                return None;
            }
        }
        let byte = |of: &dyn Fn(&Sample) -> u8| (mean(&|s| f32::from(of(s))) + 0.5) as u8;
        Some(Sample {
            color: std::array::from_fn(|c| byte(&|s| s.color[c])),
            depth: mean(&|s| s.depth),
            normal: std::array::from_fn(|c| byte(&|s| s.normal[c])),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tile by formula; what of it was asked for, and what was made of it.
    fn filled(tolerance: u8, of: impl Fn(usize, usize) -> Option<u8>) -> (u64, [Sample; RAYS]) {
        let mut samples = [Sample::NOTHING; RAYS];
        let mut asked = 0;
        let depth = |x: usize, y: usize| 5.0 + x as f32 - 2.0 * y as f32;
        let tolerance = Tolerance { color: tolerance, depth_mm: 0.01 };
        let counts = Plan::new().fill(tolerance, u64::MAX, &mut samples, |rays, samples| {
            assert_eq!(asked & rays, 0, "asked twice");
            asked |= rays;
            for i in (0..RAYS).filter(|i| rays >> i & 1 == 1) {
                let (x, y) = (i % TILE, i / TILE);
                let seen = |c| Sample { color: [c; 3], depth: depth(x, y), normal: [1; 3] };
                samples[i] = of(x, y).map_or(Sample::NOTHING, seen);
            }
            Counts { rays: rays.count_ones().into(), ..Counts::default() }
        });
        assert_eq!(counts.rays, u64::from(asked.count_ones()));
        (asked, samples)
    }

    #[test]
    fn every_pixel_is_found_once_by_neighbours_that_are_known() {
        let plan = Plan::new();
        let mut known = plan.first;
        for round in &plan.rounds {
            let mut found = 0_u64;
            for foretold in round {
                assert!(foretold.around.iter().all(|pixel| known >> pixel & 1 == 1));
                assert!((foretold.weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                assert_eq!((known | found) >> foretold.pixel & 1, 0);
                found |= 1 << foretold.pixel;
            }
            known |= found;
        }
        assert_eq!(known, u64::MAX);
    }

    #[test]
    fn smooth_tiles_need_nine_rays_and_noise_needs_all() {
        let ramp = |x: usize, y: usize| Some(u8::try_from(x + 2 * y).unwrap());
        // Along the border a quarter of it is borne.
        let (asked, got) = filled(32, ramp);
        assert_eq!(asked.count_ones(), 9);
        for (i, sample) in got.iter().enumerate() {
            assert!(sample.color[0].abs_diff(ramp(i % TILE, i / TILE).unwrap()) <= 1, "{i}: {sample:?}");
            let depth = 5.0 + (i % TILE) as f32 - 2.0 * (i / TILE) as f32;
            assert!((sample.depth - depth).abs() < 1e-3, "{i}: {sample:?}");
        }
        let noise = |x: usize, y: usize| u8::try_from((x * 37 + y * 101 + x * y * 13) % 251).ok();
        let (_, got) = filled(0, noise);
        assert!(got.iter().enumerate().all(|(i, sample)| Some(sample.color[0]) == noise(i % TILE, i / TILE)));
        // A silhouette is as it is.
        let disc = |x: usize, y: usize| (x * x + y * y < 30).then_some(7);
        let (_, got) = filled(255, disc);
        for (i, sample) in got.iter().enumerate() {
            assert_eq!(sample.is_hit().then_some(7), disc(i % TILE, i / TILE), "{i}");
        }
    }
}
