//! The wall between labels in a cell: a plane by sums over the 8^3 samples around it, weighted by a Gaussian.
//!
//! The first moments of a label's samples give the wall's direction. Its place is the place of a half-space with the
//! same sum of the weights `w (4.5 - r^2/s^2)`, which over a half-space up to `s x` is `1.5 (1 + erf(x/sqrt 2)) / 2 + x
//! phi(x)`. With 4, balls would not shrink at all in the first order (with 5 they do by `s^2 / 3R`), and steps of the
//! samples would show more. Root mean square from balls of 36 and 8 voxels, and normals of the former: with 4, .087,
//! .086; with 4.25 .082, .090; with 4.5 .079, .099; with 5 .076, .118; 1.7 degrees with all. With s = 1.4 and 5 .079,
//! .106, 1.9 degrees. Sums run over rows: the samples of a row that have a label are 8 bits, and their part of each sum
//! comes from a table of 256. Results are the same on every machine: the weights are literals.

use std::f32::consts::TAU;

use crate::cpu::{Kernel, Lanes, Octet, Portable, movemask};
use crate::format::CornerLabels;

/// Largest distance of a wall from the middle between two samples that it separates, in voxels: samples keep their
/// labels.
pub const MAX_SMOOTH: f64 = 0.5;

/// Samples along a side of the window.
pub(super) const WINDOW: usize = 8;
/// Standard deviation of the Gaussian, in voxels.
const SIGMA: f32 = 1.5;
/// Values of the Gaussian at half a voxel from the middle, 3/2 and so on.
const GAUSSIAN: [f32; WINDOW / 2] = [0.945_959_45, 0.606_530_67, 0.249_352_2, 0.065_728_53];
/// First sample of a row, from the cell's middle: they run from -3.5 to 3.5.
const FIRST: f32 = -3.5;
/// Distance from a rough wall within which samples count by their labels, in voxels.
const BAND: f32 = 1.0;
/// Part of a half-space's moment below which a label may be a thin sheet, of up to three voxels.
const THIN: f32 = 0.85;
/// Steps of Newton's method; the last changes less than 10^-6 voxel.
const STEPS: usize = 3;

/// The samples of each row of the window, as bits.
pub(in crate::builder) type Members = [u8; WINDOW * WINDOW];

/// A plane: `normal` leads out of the first label, `along` is its distance along it from the cell's middle, in voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Wall {
    pub(super) normal: [f32; 3],
    pub(super) along: f32,
}

impl Wall {
    /// Range of a cell's corners along the wall's normal: the last corner of the first label, and the first corner of
    /// the other (with `None`: of all others).
    #[inline(always)]
    fn gap(&self, corners: &CornerLabels, one: u16, other: Option<u16>) -> [f32; 2] {
        let (mut behind, mut before) = (f32::NEG_INFINITY, f32::INFINITY);
        for (i, label) in corners.iter().enumerate() {
            let part = |a: usize| if i >> a & 1 == 1 { self.normal[a] } else { -self.normal[a] };
            let at = 0.5 * (part(0) + part(1) + part(2));
            if *label == one {
                behind = behind.max(at);
            } else if other.is_none_or(|other| *label == other) {
                before = before.min(at);
            }
        }
        [behind, before]
    }

    /// The wall half-way in a gap.
    fn half_way(self, [behind, before]: [f32; 2]) -> Self {
        Self { along: f32::midpoint(behind, before), ..self }
    }
}

/// Samples around a cell: eight slices with rows `stride` apart; the window begins at `first`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window<'a> {
    pub(super) slices: [&'a [u16]; WINDOW],
    pub(super) first: usize,
    pub(super) stride: usize,
}

impl Window<'_> {
    /// Members of a label, and members of another (with `None`: of all others), row by row.
    #[inline(always)]
    pub(super) fn members(&self, isa: impl Lanes, one: u16, other: Option<u16>) -> [Members; 2] {
        let mut both = [[0; WINDOW * WINDOW]; 2];
        let end = self.first + (WINDOW - 1) * self.stride + WINDOW;
        for (z, slice) in self.slices.iter().enumerate() {
            let Some(block) = slice.get(self.first..end) else { continue };
            let mut rows = block.chunks(self.stride);
            for half in 0..2 {
                let mut samples = [0; FOUR_ROWS];
                for to in samples.as_chunks_mut::<WINDOW>().0 {
                    if let Some(row) = rows.next().and_then(|row| row.first_chunk()) {
                        *to = *row;
                    }
                }
                let at = 2 * z + half;
                both[0].as_chunks_mut::<4>().0[at] = bits(isa, &samples, |label| label == one);
                if let Some(other) = other {
                    both[1].as_chunks_mut::<4>().0[at] = bits(isa, &samples, |label| label == other);
                }
            }
        }
        if other.is_none() {
            let [own, others] = &mut both;
            own.iter().zip(others).for_each(|(own, others)| *others = !own);
        }
        both
    }
}

/// A copy of a window's samples.
pub(super) struct Samples([[u16; WINDOW * WINDOW]; WINDOW]);

impl Window<'_> {
    /// A copy in which a label's samples keep it where they are connected to its first corner, by faces and within the
    /// window; all others have `far`. `None` if all are connected.
    #[cold]
    pub(super) fn apart(&self, corners: &CornerLabels, label: u16, far: u16) -> Option<Samples> {
        let mut slices = [[0; WINDOW * WINDOW]; WINDOW];
        for (to, from) in slices.iter_mut().zip(self.slices) {
            let rows = from.get(self.first..)?.chunks(self.stride);
            for (to, from) in to.as_chunks_mut::<WINDOW>().0.iter_mut().zip(rows) {
                *to = *from.first_chunk()?;
            }
        }
        let mut own = [0; WINDOW * WINDOW];
        for (row, samples) in own.iter_mut().zip(slices.as_flattened().as_chunks::<WINDOW>().0) {
            *row = (0..WINDOW).fold(0, |bits, x| bits | u8::from(samples[x] == label) << x);
        }
        let near = connected(&own, corners, label)?;
        for (at, sample) in slices.as_flattened_mut().iter_mut().enumerate() {
            let is_far = (own[at / WINDOW] & !near[at / WINDOW]) >> (at % WINDOW) & 1 == 1;
            *sample = if is_far { far } else { *sample };
        }
        (near != own).then_some(Samples(slices))
    }

    /// A number that occurs in no sample.
    pub(super) fn unused(&self) -> u16 {
        let end = self.first + (WINDOW - 1) * (self.stride + 1) + 1;
        let samples = self.slices.map(|slice| slice.get(self.first..end).unwrap_or_default());
        let has = |number: &u16| samples.iter().any(|slice| slice.contains(number));
        (0..=u16::MAX).rev().find(|number| !has(number)).unwrap_or(u16::MAX)
    }
}

impl Samples {
    pub(super) fn window(&self) -> Window<'_> {
        Window { slices: self.0.each_ref().map(|slice| &slice[..]), first: 0, stride: WINDOW }
    }

    pub(super) fn corners(&self) -> CornerLabels {
        std::array::from_fn(|corner| {
            let [z, at] = corner_at(corner);
            self.0[z][at]
        })
    }
}

/// Position of a corner's sample in a window: slice, and index in it.
fn corner_at(corner: usize) -> [usize; 2] {
    let [x, y, z] = [0, 1, 2].map(|a| WINDOW / 2 - 1 + (corner >> a & 1));
    [z, y * WINDOW + x]
}

/// The samples of a label that are connected to its first corner, by faces and within the window.
fn connected(own: &Members, corners: &CornerLabels, label: u16) -> Option<Members> {
    let (mut slices, mut near, mut before) = ([0_u64; WINDOW], [0_u64; WINDOW], [0; WINDOW]);
    for (slice, rows) in slices.iter_mut().zip(own.as_chunks::<WINDOW>().0) {
        *slice = u64::from_le_bytes(*rows);
    }
    let [z, at] = corner_at(corners.iter().position(|corner| *corner == label)?);
    near[z] = 1 << at;
    while near != before {
        before = near;
        for z in 0..WINDOW {
            let below = if z > 0 { near[z - 1] } else { 0 };
            let above = if z + 1 < WINDOW { near[z + 1] } else { 0 };
            near[z] |= (spread(near[z]) | below | above) & slices[z];
        }
    }
    let mut members = [0; WINDOW * WINDOW];
    for (rows, slice) in members.as_chunks_mut::<WINDOW>().0.iter_mut().zip(near) {
        *rows = slice.to_le_bytes();
    }
    Some(members)
}

/// The samples of a slice, row by row, and their neighbours.
fn spread(slice: u64) -> u64 {
    const FIRST_OF_ROWS: u64 = 0x0101_0101_0101_0101;
    let along = (slice & !(FIRST_OF_ROWS << 7)) << 1 | (slice & !FIRST_OF_ROWS) >> 1;
    slice | along | slice << 8 | slice >> 8
}

/// Samples that are compared at once.
const FOUR_ROWS: usize = 4 * WINDOW;

/// Mask of the samples for which `holds` is true, row by row.
#[inline(always)]
fn bits<T: Copy>(isa: impl Lanes, samples: &[T; FOUR_ROWS], holds: impl Fn(T) -> bool) -> [u8; 4] {
    let mut found = [0_u8; FOUR_ROWS];
    for i in 0..FOUR_ROWS {
        found[i] = if holds(samples[i]) { 0xff } else { 0 };
    }
    if let Some(avx2) = isa.avx2() {
        return movemask(avx2, found).to_le_bytes();
    }
    // Each byte's bit becomes a bit of the highest byte.
    found.as_chunks::<8>().0.iter().fold([0; 4], |[_, b, c, d], row| {
        let bits = u64::from_le_bytes(*row) & 0x0101_0101_0101_0101;
        [b, c, d, (bits.wrapping_mul(0x0102_0408_1020_4080) >> 56).to_le_bytes()[0]]
    })
}

/// Sums that a row adds, for every set of its samples, and the factors of each row: in lanes, the first three of which
/// add up to the moment, and the fourth and the last to the place.
pub(super) struct Fit {
    /// Sums of the weight times x, three times of the weight, and of the weight times x^2.
    of_row: Box<[Row; 256]>,
    /// Weight of the row, its product with y and z, and two factors for the place of a wall: without x and with x.
    rows: Box<[Row; WINDOW * WINDOW]>,
    /// The sum of all samples for the place of a wall.
    whole: f32,
    /// The moment of a half-space through the middle.
    moment: f32,
}

type Row = [f32; 8];

/// Sums over samples: weighted places, and the weight for the place of a wall.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    moment: [f32; 3],
    place: f32,
}

#[inline(always)]
fn from_middle(at: usize) -> f32 {
    let at = at as f32;
    FIRST + at
}

impl Fit {
    pub(super) fn new() -> Self {
        let weights: [f32; WINDOW] = std::array::from_fn(|i| GAUSSIAN[i.max(WINDOW - 1 - i) - WINDOW / 2]);
        let mut of_row = Box::new([[0.0; 8]; 256]);
        for (members, sums) in of_row.iter_mut().enumerate() {
            for (i, weight) in weights.iter().enumerate().filter(|(i, _)| members >> i & 1 == 1) {
                let x = from_middle(i);
                let factors = [x, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, x * x];
                factors.iter().zip(&mut *sums).for_each(|(factor, sum)| *sum += weight * factor);
            }
        }
        let mut rows = Box::new([[0.0; 8]; WINDOW * WINDOW]);
        for (at, row) in rows.iter_mut().enumerate() {
            let (weight, [y, z]) =
                (weights[at % WINDOW] * weights[at / WINDOW], [at % WINDOW, at / WINDOW].map(from_middle));
            let scale = 1.0 / (SIGMA * SIGMA);
            let place = 4.5 - (y * y + z * z) * scale;
            *row = [1.0, y, z, place, 0.0, 0.0, 0.0, -scale].map(|factor| weight * factor);
        }
        let mut fit = Self { of_row, rows, whole: 0.0, moment: 0.0 };
        fit.whole = fit.sums(Portable, &[u8::MAX; WINDOW * WINDOW]).place;
        fit.moment = fit.sums(Portable, &[0xf0; WINDOW * WINDOW]).moment[0];
        fit
    }

    #[inline(always)]
    fn sums(&self, isa: impl Lanes, members: &Members) -> Sums {
        // Every fourth row by itself, so that additions do not wait for each other.
        let mut sums = [isa.s_load(&[0.0; 8]); 4];
        for (rows, members) in self.rows.as_chunks::<4>().0.iter().zip(members.as_chunks::<4>().0) {
            for i in 0..4 {
                sums[i] = sums[i] + isa.s_load(&rows[i]) * isa.s_load(&self.of_row[usize::from(members[i])]);
            }
        }
        let sum = ((sums[0] + sums[1]) + (sums[2] + sums[3])).store();
        Sums { moment: [sum[0], sum[1], sum[2]], place: sum[3] + sum[7] }
    }

    /// The wall between a label and another, or all others, by the members of both. It separates the cell's corners that
    /// have them if a plane in its direction can; `None` where the samples give no direction.
    #[inline(always)]
    pub(super) fn between(
        &self,
        isa: impl Lanes,
        members: [Members; 2],
        corners: &CornerLabels,
        one: u16,
        other: Option<u16>,
    ) -> Option<Wall> {
        let [mut a, mut b] = members;
        let (mut wall, is_thin) = self.wall(isa, &mut a, &mut b)?;
        if is_thin
            && let Some(other) = other
            && let Some(near) = near(&members, corners, [one, other])
        {
            [a, b] = near;
            wall = isa.call(Again { fit: self, rough: None, one: &mut a, other: &mut b })?;
        }
        let gap = wall.gap(corners, one, other);
        if gap[0] < wall.along && wall.along < gap[1] {
            return Some(wall);
        }
        // Other walls nearby have drawn it.
        let wall =
            isa.call(Again { fit: self, rough: Some(&wall.half_way(gap)), one: &mut a, other: &mut b })?;
        let gap = wall.gap(corners, one, other);
        Some(if gap[0] < gap[1] {
            Wall { along: wall.along.clamp(gap[0], gap[1]), ..wall }
        } else {
            wall.half_way(gap)
        })
    }

    /// The wall between two labels by the samples of each, and whether one of them seems to be a thin sheet. Samples of
    /// other labels count for the label on whose side of the rough wall they lie. `None` where the samples give no
    /// direction.
    #[inline(always)]
    fn wall(&self, isa: impl Lanes, one: &mut Members, other: &mut Members) -> Option<(Wall, bool)> {
        let mut all = u8::MAX;
        for at in 0..WINDOW * WINDOW {
            all &= one[at] | other[at];
        }
        let mut first = self.sums(isa, one);
        if all != u8::MAX {
            let second = self.sums(isa, other);
            let toward = direction(std::array::from_fn(|a| first.moment[a] - second.moment[a]))?;
            share_out(isa, one, other, toward);
            first = self.sums(isa, one);
        }
        // All samples have one of the labels, and the moment of all is 0.
        let toward = direction(first.moment)?;
        let share = 2.0 * first.place / self.whole - 1.0;
        let along = place(share);
        let [x, y, z] = first.moment;
        let half_space = self.moment * (1.0 - 0.5 * along * along);
        let is_thin = x * x + y * y + z * z < THIN * THIN * half_space * half_space;
        Some((Wall { normal: toward.map(|c| -c), along: SIGMA * along }, is_thin))
    }
}

#[inline(always)]
fn direction(toward: [f32; 3]) -> Option<[f32; 3]> {
    let [x, y, z] = toward;
    let length = (x * x + y * y + z * z).sqrt();
    (length > 1e-3).then(|| [x / length, y / length, z / length])
}

/// A second fit of the wall, by the remaining samples; with a rough one, by those within [`BAND`] of it: samples
/// farther away count for the label on whose side they lie, so that other walls nearby do not draw it to them.
struct Again<'a> {
    fit: &'a Fit,
    rough: Option<&'a Wall>,
    one: &'a mut Members,
    other: &'a mut Members,
}

impl Kernel for Again<'_> {
    type Output = Option<Wall>;

    #[inline(always)]
    fn run(self, isa: impl Lanes) -> Option<Wall> {
        let Self { fit, rough, one, other } = self;
        let parts = one.as_chunks_mut::<4>().0.iter_mut().zip(other.as_chunks_mut::<4>().0);
        for (at, (one, other)) in parts.enumerate() {
            let Some(Wall { normal, along }) = rough else { break };
            let beyond = along_rows(*normal, 4 * at, *along);
            let (behind, before) = (bits(isa, &beyond, |at| at < -BAND), bits(isa, &beyond, |at| at > BAND));
            for row in 0..4 {
                one[row] = one[row] & !before[row] | behind[row];
                other[row] = other[row] & !behind[row] | before[row];
            }
        }
        fit.wall(isa, one, other).map(|(wall, _)| wall)
    }
}

/// The members of two labels without those that are not connected to their corners: samples beyond a thin sheet do not
/// bear on this side. `None` if all are connected.
#[cold]
fn near(members: &[Members; 2], corners: &CornerLabels, labels: [u16; 2]) -> Option<[Members; 2]> {
    let near = [connected(&members[0], corners, labels[0])?, connected(&members[1], corners, labels[1])?];
    (near != *members).then_some(near)
}

/// Gives samples of other labels the label on whose side they lie.
#[inline(always)]
fn share_out(isa: impl Lanes, one: &mut Members, other: &mut Members, toward: [f32; 3]) {
    let parts = one.as_chunks_mut::<4>().0.iter_mut().zip(other.as_chunks_mut::<4>().0);
    for (at, (one, other)) in parts.enumerate() {
        let side = bits(isa, &along_rows(toward, 4 * at, 0.0), |at| at > 0.0);
        for row in 0..4 {
            let left = !(one[row] | other[row]);
            one[row] |= left & side[row];
            other[row] |= left & !side[row];
        }
    }
}

/// Distances of the samples of four rows along a direction, less `less`.
#[inline(always)]
fn along_rows([x, y, z]: [f32; 3], first: usize, less: f32) -> [f32; FOUR_ROWS] {
    let mut at = [0.0; FOUR_ROWS];
    for (row, samples) in at.as_chunks_mut::<WINDOW>().0.iter_mut().enumerate() {
        let row = first + row;
        let across = y * from_middle(row % WINDOW) + z * from_middle(row / WINDOW) - less;
        for (i, sample) in samples.iter_mut().enumerate() {
            *sample = across + x * from_middle(i);
        }
    }
    at
}

/// The `x` with `erf(x / sqrt 2) + 4/3 x phi(x) = share`, at most 1 in size.
#[inline(always)]
fn place(share: f32) -> f32 {
    // The series of the left side's derivative, (10 - 4 x^2) / 3 phi(x), and its integral.
    const TERMS: [f32; 8] = [
        10.0 / 3.0,
        -6.0 / 2.0,
        26.0 / 24.0,
        -34.0 / 144.0,
        14.0 / 384.0,
        -50.0 / 11_520.0,
        58.0 / 138_240.0,
        -22.0 / 645_120.0,
    ];
    let scale = 1.0 / TAU.sqrt();
    let wanted = share / scale;
    let mut x = (0.3 * wanted).clamp(-1.0, 1.0);
    for _ in 0..STEPS {
        let square = x * x;
        let (mut slope, mut sum) = (0.0, 0.0);
        for (k, term) in TERMS.iter().enumerate().rev() {
            let odd = (2 * k + 1) as f32;
            slope = slope * square + term;
            sum = sum * square + term / odd;
        }
        x = (x - (sum * x - wanted) / slope).clamp(-1.0, 1.0);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The samples with `side(u) < 0`, and the others.
    fn members(side: impl Fn([f32; 3]) -> f32) -> [Members; 2] {
        let mut both = [[0; WINDOW * WINDOW]; 2];
        for at in 0..WINDOW.pow(3) {
            let u = [at % WINDOW, at / WINDOW % WINDOW, at / WINDOW / WINDOW].map(from_middle);
            both[usize::from(side(u) >= 0.0)][at / WINDOW] |= 1 << (at % WINDOW);
        }
        both
    }

    #[test]
    fn planes_are_found_where_they_are() {
        let fit = Fit::new();
        let (mut squares, mut turned) = (0.0, 0.0);
        // Directions on a spiral around the sphere, none of them along the grid.
        for i in 0..400_u16 {
            let (height, turn) = ((f32::from(i) + 0.5) / 200.0 - 1.0, 2.399_963 * f32::from(i));
            let across = (1.0 - height * height).sqrt();
            let direction = [across * turn.cos(), across * turn.sin(), height];
            let dot = |u: [f32; 3]| (0..3).map(|a| u[a] * direction[a]).sum::<f32>();
            let along = f32::from(i % 9) / 10.0 - 0.4;
            let [mut one, mut other] = members(|u| dot(u) - along);
            let (wall, is_thin) = fit.wall(Portable, &mut one, &mut other).unwrap();
            assert!(!is_thin, "{direction:?} {along}");
            squares += (wall.along - along).powi(2);
            turned += dot(wall.normal).min(1.0).acos();
        }
        let (rms, turned) = ((squares / 400.0).sqrt(), (turned / 400.0).to_degrees());
        assert!(rms < 0.09 && turned < 2.0, "{rms} {turned}");
    }

    #[test]
    #[expect(clippy::cast_possible_truncation, reason = "to single precision, as the sums have it")]
    fn a_sum_is_inverted() {
        for x in [-0.99_f64, -0.5, 0.0, 0.1, 0.77] {
            // Simpson's rule on (10 - 4 t^2) / 3 phi(t).
            let slope =
                |t: f64| (10.0 - 4.0 * t * t) / 3.0 * (-t * t / 2.0).exp() / std::f64::consts::TAU.sqrt();
            let (n, h) = (200, x / 200.0);
            let odd = |i: usize| if i % 2 == 1 { 4.0 } else { 2.0 };
            let inner: f64 = (1..n).map(|i| odd(i) * slope(i as f64 * h)).sum();
            let share = (slope(0.0) + inner + slope(x)) * h / 3.0;
            assert!((f64::from(place(share as f32)) - x).abs() < 1e-4, "{x} {share}");
        }
    }
}
