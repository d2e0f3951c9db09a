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

/// The code of the opposite vector, which exists for every code.
pub(crate) fn negated(code: u16) -> u16 {
    let [x, y, z] = decode_l1(code).map(|c| -c);
    let fold = |across: i32, sign: i32| if sign < 0 { across.abs() - SCALE } else { SCALE - across.abs() };
    let [u, v] = if z < 0 { [fold(y, x), fold(x, y)] } else { [x, y] };
    #[expect(clippy::cast_possible_truncation, reason = "within the scale")]
    u16::from_le_bytes([u as i8, v as i8].map(i8::cast_unsigned))
}

/// The unit vector of a code.
pub fn decode(code: u16) -> [f32; 3] {
    let v = decode_l1(code).map(|c| c as f32);
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    v.map(|c| c / length)
}

/// Nearest code of a direction (any length, not zero, finite): the one with the closest direction among the four codes
/// around the exact point.
///
/// Written without branches, so that loops over it vectorise.
#[inline(always)]
pub fn encode(direction: [f32; 3]) -> u16 {
    let (unit, u, v) = chart(direction);
    let (u0, v0) = (u.floor(), v.floor());
    nearest(unit, [u0, next_step(u0)], [v0, next_step(v0)])
}

/// A direction scaled to L1 length 1, and its coordinates in the map, within [`SCALE`].
#[inline(always)]
fn chart(direction: [f32; 3]) -> ([f32; 3], f32, f32) {
    let [x, y, z] = direction;
    let l1 = x.abs() + y.abs() + z.abs();
    let unit = [x / l1, y / l1, z / l1];
    let (fold_u, fold_v) = ((1.0 - unit[1].abs()).copysign(unit[0]), (1.0 - unit[0].abs()).copysign(unit[1]));
    let below = unit[2] < 0.0;
    // Both are at most SCALE: l1 is at least as large as each of its terms.
    let u = if below { fold_u } else { unit[0] } * SCALE_F32;
    let v = if below { fold_v } else { unit[1] } * SCALE_F32;
    (unit, u, v)
}

/// The code with the closest direction of four.
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

/// Code of a mean: encodes the sum of [`decode_l1`] of some codes, or returns their first code where the sum is zero.
#[inline]
pub fn mean(sum: [i64; 3], first: u16) -> u16 {
    if sum == [0; 3] {
        return first;
    }
    encode(sum.map(|c| c as f32))
}

const SCALE_F32: f32 = SCALE as f32;

/// The next code component, within the range.
#[inline(always)]
fn next_step(c: f32) -> f32 {
    if c < SCALE_F32 { c + 1.0 } else { SCALE_F32 }
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
            // Fibonacci sphere: even coverage without a random generator.
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
