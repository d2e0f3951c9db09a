//! Unit normals in 16 bits: the octahedral map with precise rounding (SPEC 4.6).
//!
//! Map and rounding: Cigolle et al. 2014, *A Survey of Efficient Representations for Independent Unit
//! Vectors*. Mean error 0.31 degrees, worst 0.64 over the sphere. Every operation is IEEE single
//! addition, multiplication, division or square root in a fixed order, so codes are the same on every
//! machine.

/// Largest component of a code.
pub(crate) const SCALE: i32 = 127;

/// The L1-127 integer vector of a code; also defined for the illegal component -128, which reads as -127.
#[inline(always)]
pub fn decode_l1(code: u16) -> [i32; 3] {
    let [lo, hi] = code.to_le_bytes();
    let (u, v) = (i32::from(lo as i8).max(-SCALE), i32::from(hi as i8).max(-SCALE));
    let z = SCALE - u.abs() - v.abs();
    let fold_u = if u < 0 { v.abs() - SCALE } else { SCALE - v.abs() };
    let fold_v = if v < 0 { u.abs() - SCALE } else { SCALE - u.abs() };
    if z < 0 { [fold_u, fold_v, z] } else { [u, v, z] }
}

/// The code of the opposite vector, which there is for every code.
pub(crate) fn negated(code: u16) -> u16 {
    let [x, y, z] = decode_l1(code).map(|c| -c);
    let fold = |across: i32, sign: i32| if sign < 0 { across.abs() - SCALE } else { SCALE - across.abs() };
    let [u, v] = if z < 0 { [fold(y, x), fold(x, y)] } else { [x, y] };
    #[expect(clippy::cast_possible_truncation, reason = "within the scale")]
    u16::from_le_bytes([u as i8, v as i8].map(i8::cast_unsigned))
}

/// Steps of a fine part to one of the code.
pub(crate) const FINE_STEPS: i32 = 8;

/// Largest component of a code with its fine part.
pub(crate) const FINE_SCALE: i32 = SCALE * FINE_STEPS;

/// The fine part that adds nothing.
pub(crate) const FINE_NONE: u8 = 0x88;

/// The vector of a code and its fine part, of L1 length 1016: the same map on steps of an eighth (SPEC 4.6).
#[inline(always)]
pub(crate) fn decode_fine(code: u16, fine: u8) -> [i32; 3] {
    let [lo, hi] = code.to_le_bytes();
    let at = |coarse: u8, fine: u8| {
        (FINE_STEPS * i32::from(coarse as i8) + i32::from(fine) - FINE_STEPS).clamp(-FINE_SCALE, FINE_SCALE)
    };
    let (u, v) = (at(lo, fine & 15), at(hi, fine >> 4));
    let z = FINE_SCALE - u.abs() - v.abs();
    let fold_u = if u < 0 { v.abs() - FINE_SCALE } else { FINE_SCALE - v.abs() };
    let fold_v = if v < 0 { u.abs() - FINE_SCALE } else { FINE_SCALE - u.abs() };
    if z < 0 { [fold_u, fold_v, z] } else { [u, v, z] }
}

/// The unit vector of a code.
pub fn decode(code: u16) -> [f32; 3] {
    let v = decode_l1(code).map(|c| c as f32);
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|c| c / length)
}

/// Nearest code of a direction (any length, not zero, finite): of the four codes around the exact
/// point, the one whose direction is closest.
///
/// Written without branches, so that loops over it vectorise.
#[inline(always)]
pub fn encode(direction: [f32; 3]) -> u16 {
    let (unit, u, v) = chart(direction);
    let (u0, v0) = (u.floor(), v.floor());
    nearest(unit, [u0, next_step(u0)], [v0, next_step(v0)])
}

/// The code of 12 bits near a direction: of the four around its place in the map the one that is closest. Mean error
/// 1.34 degrees, worst 3.1.
///
/// Its components are of the 64 that [`coarse_number`] knows.
#[inline(always)]
pub(crate) fn encode_coarse(direction: [f32; 3]) -> u16 {
    let (unit, u, v) = chart(direction);
    let ([u0, u1], [v0, v1]) = (coarse_around(u), coarse_around(v));
    nearest(unit, [u0, u1], [v0, v1])
}

/// The components of normals of 12 bits just below and above a place in the map: sizes of 2 or 5 more than a multiple
/// of 8, so that the map's fold, k to 127 - k, leads from one to another.
#[inline(always)]
fn coarse_around(place: f32) -> [f32; 2] {
    let size = place.abs();
    let octet = (size * 0.125).floor() * 8.0;
    let rest = size - octet;
    let below = if octet > 0.0 { octet - 3.0 } else { -2.0 };
    let above = if octet < 120.0 { octet + 10.0 } else { octet + 5.0 };
    let low = if rest < 2.0 { below } else { octet + if rest < 5.0 { 2.0 } else { 5.0 } };
    let high = if rest < 2.0 {
        octet + 2.0
    } else if rest < 5.0 {
        octet + 5.0
    } else {
        above
    };
    [low * 1.0_f32.copysign(place), high * 1.0_f32.copysign(place)]
}

/// The number of a component among the 64 of normals of 12 bits, -32..=31 as they rise; `None` for others.
#[inline]
pub(crate) fn coarse_number(component: i32) -> Option<i32> {
    let size = component.abs();
    let number = match size % 8 {
        2 => size / 8 * 2,
        5 => size / 8 * 2 + 1,
        _ => return None,
    };
    (size < SCALE).then_some(if component < 0 { -1 - number } else { number })
}

/// The component of a number, -32..=31.
#[inline]
pub(crate) fn coarse_component(number: i32) -> i32 {
    let at = if number < 0 { -1 - number } else { number };
    let size = at / 2 * 8 + if at % 2 == 0 { 2 } else { 5 };
    if number < 0 { -size } else { size }
}

/// Has a code only components of normals of 12 bits?
#[inline]
pub fn is_coarse(code: u16) -> bool {
    code.to_le_bytes().iter().all(|c| coarse_number(i32::from(c.cast_signed())).is_some())
}

/// The fine part of a direction whose code is known: how far it is from that in the map, in eighths.
#[inline(always)]
pub(crate) fn encode_fine(direction: [f32; 3], code: u16) -> u8 {
    let (_, u, v) = chart(direction);
    let [lo, hi] = code.to_le_bytes();
    let part = |exact: f32, coarse: u8| {
        let eighths = (exact - f32::from(coarse as i8)) * FINE_STEPS as f32 + (FINE_STEPS as f32 + 0.5);
        let low = if eighths > 0.0 { eighths } else { 0.0 };
        let held = if low < 15.0 { low } else { 15.0 };
        low_byte(held.floor())
    };
    (part(u, lo) | part(v, hi) << 4).to_le_bytes()[0]
}

/// A direction scaled to L1 length 1, and where it lies in the map, within [`SCALE`].
#[inline(always)]
fn chart(direction: [f32; 3]) -> ([f32; 3], f32, f32) {
    let [x, y, z] = direction;
    let l1 = x.abs() + y.abs() + z.abs();
    let unit = [x / l1, y / l1, z / l1];
    let (fold_u, fold_v) = ((1.0 - unit[1].abs()).copysign(unit[0]), (1.0 - unit[0].abs()).copysign(unit[1]));
    let below = unit[2] < 0.0;
    // Neither exceeds SCALE: l1 is at least as large as each of its terms.
    let u = if below { fold_u } else { unit[0] } * SCALE_F32;
    let v = if below { fold_v } else { unit[1] } * SCALE_F32;
    (unit, u, v)
}

/// The code of four whose direction is closest.
#[inline(always)]
fn nearest(unit: [f32; 3], [u0, u1]: [f32; 2], [v0, v1]: [f32; 2]) -> u16 {
    let mut best = Candidate::new(unit, u0, v0);
    for candidate in
        [Candidate::new(unit, u1, v0), Candidate::new(unit, u0, v1), Candidate::new(unit, u1, v1)]
    {
        best = best.or_closer(candidate);
    }
    low_byte(best.u) | low_byte(best.v) << 8
}

/// Code of a mean: of the sum of [`decode_l1`] of some codes, or their first code where that is zero.
#[inline]
pub fn mean(sum: [i64; 3], first: u16) -> u16 {
    if sum == [0; 3] {
        return first;
    }
    #[expect(clippy::cast_precision_loss, reason = "SPEC 4.6 rounds the sums to single precision")]
    encode(sum.map(|c| c as f32))
}

const SCALE_F32: f32 = SCALE as f32;

/// The next code component, within the range.
#[inline(always)]
fn next_step(c: f32) -> f32 {
    if c < SCALE_F32 { c + 1.0 } else { SCALE_F32 }
}

/// In how many bits normals are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, serde::Deserialize)]
pub enum NormalBits {
    /// 12: every 16th code, in the place of 16 bits; packed models shrink. 1.3 degrees.
    #[serde(rename = "12")]
    Twelve,
    /// 16: 0.31 degrees.
    #[default]
    #[serde(rename = "16")]
    Sixteen,
    /// 24: a byte more ([`super::Channel::Fine`]). 0.04 degrees.
    #[serde(rename = "24")]
    TwentyFour,
}

impl NormalBits {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Twelve, Self::Sixteen, Self::TwentyFour];

    /// The number.
    pub const fn number(self) -> u32 {
        match self {
            Self::Twelve => 12,
            Self::Sixteen => 16,
            Self::TwentyFour => 24,
        }
    }
}

/// Two's complement low byte of an integer-valued float of small magnitude: adding 1.5 x 2^23 leaves the
/// integer in the low bits of the pattern.
#[inline(always)]
fn low_byte(c: f32) -> u16 {
    ((c + 12_582_912.0).to_bits() & 0xff) as u16
}

/// A code near the wanted direction: cosine squared (times the direction's length squared) as a fraction.
#[derive(Clone, Copy)]
struct Candidate {
    u: f32,
    v: f32,
    dot_squared: f32,
    length_squared: f32,
}

impl Candidate {
    #[inline(always)]
    fn new(d: [f32; 3], u: f32, v: f32) -> Self {
        let z = SCALE_F32 - u.abs() - v.abs();
        let below = z < 0.0;
        let a = if below { (SCALE_F32 - v.abs()).copysign(u) } else { u };
        let b = if below { (SCALE_F32 - u.abs()).copysign(v) } else { v };
        let dot = d[0] * a + d[1] * b + d[2] * z;
        Self { u, v, dot_squared: dot * dot, length_squared: a * a + b * b + z * z }
    }

    #[inline(always)]
    fn or_closer(self, other: Self) -> Self {
        let closer = other.dot_squared * self.length_squared > self.dot_squared * other.length_squared;
        let pick = |theirs, ours| if closer { theirs } else { ours };
        Self {
            u: pick(other.u, self.u),
            v: pick(other.v, self.v),
            dot_squared: pick(other.dot_squared, self.dot_squared),
            length_squared: pick(other.length_squared, self.length_squared),
        }
    }
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "directions in single precision")]
mod tests {
    use super::*;

    fn angle_deg(a: [f32; 3], b: [f32; 3]) -> f64 {
        let a = a.map(f64::from);
        let b = b.map(f64::from);
        let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let sin = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
        let cos: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
        sin.atan2(cos).to_degrees()
    }

    #[test]
    fn the_opposite_of_every_code_is_exact() {
        for code in 0..=u16::MAX {
            assert_eq!(decode_l1(negated(code)), decode_l1(code).map(|c| -c), "{code}");
        }
    }

    /// Mean and greatest error over the sphere, in degrees.
    fn errors(stored: impl Fn([f32; 3]) -> [f32; 3]) -> (f64, f64) {
        let n = 200_000;
        let (mut sum, mut worst) = (0.0, 0.0_f64);
        for i in 0..n {
            // Fibonacci sphere: even cover without a random generator.
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            let phi = f64::from(i) * 2.399_963_229_728_653;
            let r = (1.0 - z * z).sqrt();
            let d = [r * phi.cos(), r * phi.sin(), z].map(|c| c as f32);
            let e = angle_deg(stored(d), d);
            sum += e;
            worst = worst.max(e);
        }
        (sum / f64::from(n), worst)
    }

    #[test]
    fn error_over_the_sphere_is_that_of_the_literature() {
        let (mean, worst) = errors(|d| decode(encode(d)));
        assert!(mean < 0.316 && worst < 0.64, "mean {mean} worst {worst}");
    }

    #[test]
    fn fine_parts_are_an_eighth_of_the_error_and_coarse_codes_four_times() {
        let (mean, worst) = errors(|d| {
            let code = encode(d);
            decode_fine(code, encode_fine(d, code)).map(|c| c as f32)
        });
        assert!(mean < 0.045 && worst < 0.12, "mean {mean} worst {worst}");
        let (mean, worst) = errors(|d| decode(encode_coarse(d)));
        assert!(mean < 1.35 && worst < 3.2, "mean {mean} worst {worst}");
    }

    #[test]
    fn coarse_components_are_64_and_the_fold_keeps_them() {
        let known: Vec<i32> = (-SCALE..=SCALE).filter(|c| coarse_number(*c).is_some()).collect();
        assert_eq!(known.len(), 64);
        for (number, c) in (-32..).zip(&known) {
            assert_eq!((coarse_number(*c), coarse_component(number)), (Some(number), *c));
            assert!(coarse_number(SCALE - c.abs()).is_some());
        }
        // Those just around any place.
        for eighth in -127 * 8..=127 * 8 {
            let place = f64::from(eighth) / 8.0;
            let [a, b] = coarse_around(place as f32).map(f64::from);
            let (low, high) = (a.min(b), a.max(b));
            let below = known.iter().rfind(|c| f64::from(**c) <= place);
            let above = known.iter().find(|c| f64::from(**c) >= place);
            assert!(
                below.is_none_or(|c| f64::from(*c) >= low) && below.is_none_or(|c| f64::from(*c) <= place)
            );
            assert!(above.is_none_or(|c| f64::from(*c) <= high.max(place)), "{place}: {low} {high}");
            assert!([a, b].iter().all(|c| known.contains(&(*c as i32))), "{place}: {a} {b}");
            assert!(low <= place.max(-125.0) && high >= place.min(125.0), "{place}: {low} {high}");
        }
    }

    #[test]
    fn a_fine_part_of_nothing_is_the_code_and_any_is_a_direction() {
        for code in 0..=u16::MAX {
            let whole = decode_l1(code).map(|c| c * FINE_STEPS);
            assert_eq!(decode_fine(code, FINE_NONE), whole, "{code:04x}");
            for fine in [0, 0x0f, 0xf0, 0xff, 0x37] {
                let size = decode_fine(code, fine).map(i32::abs).iter().sum::<i32>();
                assert_eq!(size, FINE_SCALE, "{code:04x} {fine:02x}");
            }
        }
    }

    #[test]
    fn every_code_is_a_fixed_point_of_decode_then_encode() {
        for code in 0..=u16::MAX {
            let d = decode(code);
            let again = decode(encode(d));
            assert!(angle_deg(d, again) < 1e-3, "{code:04x}: {d:?} {again:?}");
            assert_eq!(decode_l1(code).map(i32::abs).iter().sum::<i32>(), SCALE);
        }
    }

    #[test]
    fn a_mean_is_the_code_of_the_sum_and_opposites_leave_the_first() {
        let [x, y, back] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]].map(encode);
        let sum = |codes: &[u16]| {
            let vectors = codes.iter().map(|code| decode_l1(*code).map(i64::from));
            vectors.fold([0; 3], |sum, v| [sum[0] + v[0], sum[1] + v[1], sum[2] + v[2]])
        };
        assert_eq!(sum(&[x, y]), [127, 127, 0]);
        assert_eq!(mean(sum(&[x, y]), x), encode([1.0, 1.0, 0.0]));
        assert_eq!(mean(sum(&[y, y, y]), x), y);
        assert_eq!(mean(sum(&[x, back]), x), x);
        assert_eq!(mean(sum(&[back, x]), back), back);
    }

    #[test]
    fn tiny_and_huge_gradients_keep_their_direction() {
        for scale in [1e-38_f32, 1e-12, 1.0, 1e12, 1e37] {
            let d = decode(encode([scale, -2.0 * scale, 2.0 * scale]));
            assert!(angle_deg(d, [1.0 / 3.0, -2.0 / 3.0, 2.0 / 3.0]) < 0.64, "{scale}");
        }
    }
}
