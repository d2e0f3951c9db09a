//! Judges the stored normals of a tile's pixels, all at once.
//!
//! For normals of 16 bits in cubic boxes: most pictures. Each pixel gets the result of [`super::shown`] for it alone,
//! by the same arithmetic. Cost: some 5 ns a pixel.

use crate::format::normal;

use super::{MAX_BY_CHANCE, NEAR_FACE, NEAR_FACE_MIXED, Neighbourhood, nearness, settled};
use crate::cpu::{Kernel, Lanes};
use crate::render::ray::Face;
use crate::render::tile::RAYS;

/// Length of a row of codes: nine are used, and sixteen are processed together.
pub(super) const PLACES: usize = 16;
/// Index of the hit box; the four before and after it lie on either side.
const OWN: usize = 4;

/// Normals of the boxes that a tile's pixels hit, and of their neighbours in file order.
pub(in crate::render) struct Stored {
    codes: [[u16; PLACES]; RAYS],
    /// Axis of the face that was hit, and its outward direction.
    axes: [u8; RAYS],
    outward: [f64; RAYS],
}

impl Stored {
    pub(in crate::render) const NOTHING: Self =
        Self { codes: [[0; PLACES]; RAYS], axes: [0; RAYS], outward: [1.0; RAYS] };

    /// Sets the hit of a pixel.
    #[inline]
    pub(in crate::render) fn set(&mut self, pixel: usize, codes: &[u16; 9], face: Face) {
        let pixel = pixel % RAYS;
        self.codes[pixel][..9].copy_from_slice(codes);
        self.axes[pixel] = face.axis;
        self.outward[pixel] = if face.high { 1.0 } else { -1.0 };
    }
}

/// The results of judging a tile.
pub(in crate::render) struct Verdicts {
    /// Displayed normals in the frame of the boxes, of any length, where they are not doubtful.
    pub(in crate::render) normals: [[f64; RAYS]; 3],
    /// Mask of pixels whose normals need a comparison with the skin around.
    pub(in crate::render) doubts: u64,
    calm: [u16; RAYS],
    noise: [u16; RAYS],
}

impl Verdicts {
    pub(in crate::render) const NOTHING: Self =
        Self { normals: [[1.0; RAYS]; 3], doubts: 0, calm: [0; RAYS], noise: [0; RAYS] };

    /// Agreement of a hit's normal with the normals of the boxes around.
    #[inline]
    pub(in crate::render) fn neighbourhood(&self, pixel: usize) -> Neighbourhood {
        Neighbourhood::of_flags(self.calm[pixel % RAYS], self.noise[pixel % RAYS])
    }
}

/// Doubtful normals settled together: two vectors of doubles with AVX2.
const TOGETHER: usize = 8;

/// Doubtful normals, and the scatter of the boxes around them.
#[derive(Clone, Copy)]
struct Group {
    scatter: [[f64; TOGETHER]; 6],
    face: [[f64; TOGETHER]; 3],
    /// Stored normals in the frame of the boxes.
    own: [[f64; TOGETHER]; 3],
    near: [f64; TOGETHER],
    /// 1 in a neighbourhood of noise.
    noise: [f64; TOGETHER],
}

/// The doubtful normals of a tile, to be settled together.
pub(in crate::render) struct Doubts {
    groups: [Group; RAYS / TOGETHER],
    count: usize,
}

impl Doubts {
    pub(in crate::render) const NOTHING: Self = {
        let face = [[1.0; TOGETHER], [0.0; TOGETHER], [0.0; TOGETHER]];
        let (scatter, one) = ([[0.0; TOGETHER]; 6], [1.0; TOGETHER]);
        Self {
            groups: [Group { scatter, face, own: face, near: one, noise: one }; RAYS / TOGETHER],
            count: 0,
        }
    };

    /// Begins a tile.
    pub(in crate::render) fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds the doubtful normal of a pixel; returns its number.
    #[inline]
    pub(in crate::render) fn add(
        &mut self,
        judged: &Verdicts,
        stored: &Stored,
        pixel: usize,
        scatter: [f64; 6],
    ) -> u8 {
        let (number, pixel) = (self.count % RAYS, pixel % RAYS);
        self.count += 1;
        let (group, at) = (&mut self.groups[number / TOGETHER], number % TOGETHER);
        for (out, part) in group.scatter.iter_mut().zip(scatter) {
            out[at] = part;
        }
        let neighbourhood = judged.neighbourhood(pixel);
        for a in 0..3 {
            group.face[a][at] =
                if usize::from(stored.axes[pixel]) == a { stored.outward[pixel] } else { 0.0 };
            group.own[a][at] = judged.normals[a][pixel];
        }
        group.near[at] = nearness(neighbourhood);
        group.noise[at] = f64::from(u8::from(neighbourhood == Neighbourhood::Noise));
        #[expect(clippy::cast_possible_truncation, reason = "fewer than a tile's pixels")]
        let number = number as u8;
        number
    }

    /// The displayed normal, once it is settled.
    #[inline]
    pub(in crate::render) fn normal(&self, number: u8) -> [f64; 3] {
        let number = usize::from(number) % RAYS;
        let [x, y, z] = &self.groups[number / TOGETHER].own;
        [x[number % TOGETHER], y[number % TOGETHER], z[number % TOGETHER]]
    }
}

/// Settles the doubtful normals of a tile.
pub(in crate::render) struct Settle<'a> {
    pub(in crate::render) doubts: &'a mut Doubts,
    /// Edge of a box in mm.
    pub(in crate::render) edge_mm: f64,
}

impl Kernel for Settle<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self { doubts, edge_mm } = self;
        for group in doubts.groups.iter_mut().take(doubts.count.div_ceil(TOGETHER)) {
            for i in 0..TOGETHER {
                let s = &group.scatter;
                let scatter = [s[0][i], s[1][i], s[2][i], s[3][i], s[4][i], s[5][i]];
                let face = [group.face[0][i], group.face[1][i], group.face[2][i]];
                let own = [group.own[0][i], group.own[1][i], group.own[2][i]];
                let stored = [own[0] * edge_mm, own[1] * edge_mm, own[2] * edge_mm];
                let (share, shown) = settled(scatter, face, stored, group.near[i], group.noise[i] > 0.0);
                for a in 0..3 {
                    group.own[a][i] = if share > 0.0 { shown[a] / edge_mm } else { own[a] };
                }
            }
        }
    }
}

/// Judges a tile.
pub(in crate::render) struct Judge<'a> {
    pub(in crate::render) stored: &'a Stored,
    /// Edge of a box in mm.
    pub(in crate::render) edge_mm: f64,
    pub(in crate::render) out: &'a mut Verdicts,
}

impl Kernel for Judge<'_> {
    type Output = ();

    // Loops over arrays instead of lanes or closures: they are vectorised for the form that runs them.
    #[inline(always)]
    fn run(self, _: impl Lanes) {
        let Self { stored, edge_mm, out } = self;
        for (i, codes) in stored.codes.iter().enumerate() {
            (out.calm[i], out.noise[i]) = neighbourhood_of(codes);
        }
        let mut doubts = [0_u8; RAYS];
        for (i, doubt) in doubts.iter_mut().enumerate() {
            let own = normal::decode_l1(stored.codes[i][OWN]);
            let own = [f64::from(own[0]), f64::from(own[1]), f64::from(own[2])];
            let scaled = [own[0] * edge_mm, own[1] * edge_mm, own[2] * edge_mm];
            let axis = stored.axes[i];
            let part = if axis == 0 {
                scaled[0]
            } else if axis == 1 {
                scaled[1]
            } else {
                scaled[2]
            };
            let length = (scaled[0] * scaled[0] + scaled[1] * scaled[1] + scaled[2] * scaled[2]).sqrt();
            let along = part * stored.outward[i] / length;
            let near = if out.calm[i] != 0 { NEAR_FACE } else { NEAR_FACE_MIXED };
            let noise = out.noise[i] != 0;
            let turn = (along <= -near) & !noise;
            for a in 0..3 {
                out.normals[a][i] = if turn { -scaled[a] / edge_mm } else { own[a] };
            }
            *doubt = u8::from(!(turn | (along >= near)) | noise);
        }
        out.doubts = 0;
        for (i, doubt) in doubts.iter().enumerate() {
            out.doubts |= u64::from(*doubt) << i;
        }
    }
}

/// [`super::neighbourhood`] for normals of 16 bits in cubic boxes: the codes of the box at [`OWN`], and of the four
/// before and after it, all compared at once. Returns 1 or 0 for calm, and for noise.
#[inline(always)]
pub(super) fn neighbourhood_of(codes: &[u16; PLACES]) -> (u16, u16) {
    #[expect(clippy::cast_possible_truncation, reason = "a byte")]
    const SCALE: i16 = normal::SCALE as i16;
    let mut parts = [[0_i16; PLACES]; 3];
    for i in 0..PLACES {
        // The two bytes as signed numbers.
        let code = codes[i].cast_signed();
        let (low, high) = (code.wrapping_shl(8) >> 8, code >> 8);
        let u = if low < -SCALE { -SCALE } else { low };
        let v = if high < -SCALE { -SCALE } else { high };
        let (size_u, size_v) = (u.wrapping_abs(), v.wrapping_abs());
        let z = SCALE.wrapping_sub(size_u).wrapping_sub(size_v);
        let (fold_u, fold_v) = (SCALE.wrapping_sub(size_v), SCALE.wrapping_sub(size_u));
        let fold_u = if u < 0 { fold_u.wrapping_neg() } else { fold_u };
        let fold_v = if v < 0 { fold_v.wrapping_neg() } else { fold_v };
        let folded = z < 0;
        parts[0][i] = if folded { fold_u } else { u };
        parts[1][i] = if folded { fold_v } else { v };
        parts[2][i] = z;
    }
    let [x, y, z] = [parts[0][OWN], parts[1][OWN], parts[2][OWN]];
    let mut agrees = [0_u16; PLACES];
    for i in 0..PLACES {
        let [a, b, c] = [parts[0][i], parts[1][i], parts[2][i]];
        let to = (x.wrapping_sub(a).wrapping_abs())
            .wrapping_add(y.wrapping_sub(b).wrapping_abs())
            .wrapping_add(z.wrapping_sub(c).wrapping_abs());
        let fro = (x.wrapping_add(a).wrapping_abs())
            .wrapping_add(y.wrapping_add(b).wrapping_abs())
            .wrapping_add(z.wrapping_add(c).wrapping_abs());
        let less = if to < fro { to } else { fro };
        agrees[i] = if less < SCALE / 2 + 1 { BIT[i] } else { 0 };
    }
    let mut bits = 0_u16;
    for agreeing in agrees {
        bits |= agreeing;
    }
    let agreeing = |at: usize| bits >> at & 1;
    let calm = agreeing(5) & agreeing(3) & (agreeing(6) | agreeing(2));
    // The middle one agrees with itself.
    let noise = (1 - calm) & u16::from(bits.count_ones() <= MAX_BY_CHANCE + 1);
    (calm, noise)
}

/// A bit for every index that is used.
const BIT: [u16; PLACES] = {
    let mut bits = [0; PLACES];
    let mut place = 0;
    while place < 9 {
        bits[place] = 1 << place;
        place += 1;
    }
    bits
};

#[cfg(test)]
mod tests {
    use super::super::{Around, Verdict, along, judge, neighbourhood};
    use super::*;
    use crate::cpu::Form;
    use crate::random::Random;

    /// Codes near a direction, or anywhere.
    fn codes(random: &mut Random, spread: u32) -> [u16; 9] {
        let middle: [f32; 3] = std::array::from_fn(|_| random.below(2001_u32) as f32 - 1000.5);
        std::array::from_fn(|_| {
            let part = |c: f32, random: &mut Random| c + random.below(2 * spread + 1) as f32 - spread as f32;
            normal::encode(middle.map(|c| part(c, random)))
        })
    }

    #[test]
    fn doubts_are_settled_as_one_by_one() {
        let mut random = Random(9);
        let mut changed = 0;
        for round in 0..200 {
            let edge_mm = [1.0, 0.3, 7.25][round % 3];
            let (mut stored, mut judged) = (Stored::NOTHING, Verdicts::NOTHING);
            let wanted: Vec<_> = (0..random.below(65_usize))
                .map(|pixel| {
                    let face = Face::new(random.below(3_u32) as usize, random.below(2_u32) == 1);
                    stored.set(pixel, &codes(&mut random, 500), face);
                    judged.calm[pixel] = random.below(2_u16);
                    judged.noise[pixel] = (1 - judged.calm[pixel]) * random.below(2_u16);
                    let own = normal::decode_l1(stored.codes[pixel][OWN]).map(f64::from);
                    for (parts, own) in judged.normals.iter_mut().zip(own) {
                        parts[pixel] = own;
                    }
                    // Boxes near a plane, and occasionally one elsewhere.
                    let tilt: [f64; 3] = std::array::from_fn(|_| f64::from(random.below(2001_u32)) - 1000.5);
                    let size = tilt.iter().map(|c| c * c).sum::<f64>().sqrt();
                    let boxes = (0..125_u32).fold(1 << 62, |boxes, bit| {
                        let place = [bit % 5, bit / 5 % 5, bit / 25].map(|c| f64::from(c) - 2.0);
                        let away: f64 = (0..3).map(|k| tilt[k] * place[k]).sum::<f64>() / size;
                        let there = away.abs() < 0.7 || random.below(40_u32) == 0;
                        boxes | u128::from(there) << bit
                    });
                    (pixel, face, own, Around(boxes).scatter())
                })
                .collect();
            for form in Form::available() {
                let mut doubts = Doubts::NOTHING;
                let numbers: Vec<_> = wanted.iter().map(|w| doubts.add(&judged, &stored, w.0, w.3)).collect();
                form.run(Settle { doubts: &mut doubts, edge_mm });
                for ((pixel, face, own, scatter), number) in wanted.iter().zip(numbers) {
                    let mut out = [0.0; 3];
                    out[usize::from(face.axis)] = if face.high { 1.0 } else { -1.0 };
                    let neighbourhood = judged.neighbourhood(*pixel);
                    let scaled = own.map(|c| c * edge_mm);
                    let (share, shown) = settled(
                        *scatter,
                        out,
                        scaled,
                        nearness(neighbourhood),
                        neighbourhood == Neighbourhood::Noise,
                    );
                    let want = if share > 0.0 { shown.map(|c| c / edge_mm) } else { *own };
                    assert_eq!(doubts.normal(number), want, "{form:?}");
                    changed += usize::from(share > 0.0);
                }
            }
        }
        assert!(changed > 1000, "{changed}");
    }

    #[test]
    fn a_tile_is_judged_as_its_pixels_are_one_by_one() {
        let mut random = Random(5);
        let mut counts = [0; 6];
        for round in 0..400 {
            let edge_mm = [1.0, 0.3, 7.25][round % 3];
            let mut stored = Stored::NOTHING;
            let rows: [[u16; 9]; RAYS] = std::array::from_fn(|_| {
                let spread = [0, 200, 500, 900, 4000][random.below(5_u32) as usize];
                codes(&mut random, spread)
            });
            let faces: [Face; RAYS] =
                std::array::from_fn(|_| Face::new(random.below(3_u32) as usize, random.below(2_u32) == 1));
            for (at, (row, face)) in rows.iter().zip(faces).enumerate() {
                stored.set(at, row, face);
            }
            for form in Form::available() {
                let mut out = Verdicts::NOTHING;
                form.run(Judge { stored: &stored, edge_mm, out: &mut out });
                for (at, (row, face)) in rows.iter().zip(faces).enumerate() {
                    let whole = row.map(normal::decode_l1);
                    let want = neighbourhood(|distance| {
                        let other = whole[usize::try_from(4 + distance).unwrap()];
                        super::super::alike_whole(whole[4], other, normal::SCALE)
                    });
                    assert_eq!(out.neighbourhood(at), want, "{row:?}");
                    let own = normal::decode_l1(row[4]).map(f64::from);
                    let scaled = own.map(|c| c * edge_mm);
                    let verdict = judge(along(face, scaled), want);
                    assert_eq!(out.doubts >> at & 1 == 1, verdict == Verdict::Doubt, "{form:?} {row:?}");
                    let turned = scaled.map(|c| -c / edge_mm);
                    let shown = if verdict == Verdict::Turn { turned } else { own };
                    assert_eq!(out.normals.map(|parts| parts[at]), shown, "{form:?} {row:?} {face:?}");
                    counts[want as usize] += 1;
                    counts[3 + verdict as usize] += 1;
                }
            }
        }
        assert!(counts.iter().all(|count| *count > 1000), "{counts:?}");
    }
}
