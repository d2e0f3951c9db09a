//! Voxel index to patient millimetres, and the letters that name axis directions.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Affine map from a voxel index (centres at integers) to LPS millimetres: `world = m * [x, y, z, 1]`.
///
/// Includes anisotropic spacing, gantry tilt and oblique axes; voxels are never resampled for them (the paper, section
/// 3.4: transforms touch only the box).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// Rows of the 3 x 4 matrix; the last column is the position of voxel (0, 0, 0) in mm.
    pub rows: [[f64; 4]; 3],
}

/// Shortest and longest step in mm of an affine that has an inverse: well beyond any real volume, and narrow enough for
/// products of three to be exact to the last digits.
const STEPS: RangeInclusive<f64> = 1e-15..=1e15;

/// Largest ratio of two steps: beyond that no ray meets voxels of both.
const MAX_UNEVEN: f64 = 1e9;

impl Affine {
    /// Axes parallel to the world's, `spacing_mm` apart, with voxel (0, 0, 0) at the origin.
    pub fn from_spacing(spacing_mm: [f64; 3]) -> Self {
        let mut rows = [[0.0; 4]; 3];
        for axis in 0..3 {
            rows[axis][axis] = spacing_mm[axis];
        }
        Self { rows }
    }

    /// Column `axis`: the step in mm from a voxel to its next neighbour along that index axis.
    pub fn column(&self, axis: usize) -> [f64; 3] {
        [self.rows[0][axis], self.rows[1][axis], self.rows[2][axis]]
    }

    /// Position of voxel (0, 0, 0) in mm.
    pub fn origin(&self) -> [f64; 3] {
        self.column(3)
    }

    /// Length in mm of the step along each index axis.
    pub fn spacing_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.column(axis).iter().map(|c| c * c).sum::<f64>().sqrt())
    }

    /// World position of a (fractional) voxel index.
    pub fn apply(&self, index: [f64; 3]) -> [f64; 3] {
        self.rows.map(|r| r[0] * index[0] + r[1] * index[1] + r[2] * index[2] + r[3])
    }

    /// The same steps, with index (0, 0, 0) at the place of `index`.
    pub(crate) fn starting_at(&self, index: [f64; 3]) -> Self {
        let mut moved = *self;
        moved.rows.iter_mut().zip(self.apply(index)).for_each(|(row, at)| row[3] = at);
        moved
    }

    /// The linear part applied to a vector, without translation.
    pub fn apply_vector(&self, v: [f64; 3]) -> [f64; 3] {
        self.rows.map(|r| r[0] * v[0] + r[1] * v[1] + r[2] * v[2])
    }

    /// Determinant of the linear part, in mm^3 per voxel; negative for a left-handed volume.
    pub fn determinant(&self) -> f64 {
        let [a, b, c] = [self.column(0), self.column(1), self.column(2)];
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    }

    /// This affine after another one: the other is applied first.
    pub fn after(&self, first: &Self) -> Self {
        let mut rows = [[0.0; 4]; 3];
        for axis in 0..3 {
            let column = self.apply_vector(first.column(axis));
            rows.iter_mut().zip(column).for_each(|(row, v)| row[axis] = v);
        }
        rows.iter_mut().zip(self.apply(first.origin())).for_each(|(row, v)| row[3] = v);
        Self { rows }
    }

    /// World to index, or `None` when the linear part is singular, nearly so, or not finite.
    ///
    /// "Nearly" is relative to the columns' lengths (volume of the unit-edge cell under 1e-9), so
    /// tiny and huge scales are fine: steps of 1e-15 to 1e15 mm, none 1e9 times as long as another.
    pub fn inverse(&self) -> Option<Self> {
        let lengths = self.spacing_mm();
        let det = self.determinant();
        let cell = lengths[0] * lengths[1] * lengths[2];
        let [least, most] = lengths.iter().fold([f64::INFINITY, 0.0], |[a, b], v| [v.min(a), v.max(b)]);
        if !self.rows.iter().flatten().all(|v| v.is_finite())
            || !STEPS.contains(&least)
            || !STEPS.contains(&most)
            || most > MAX_UNEVEN * least
            || !cell.is_normal()
            || (det / cell).abs() < 1e-9
        {
            return None;
        }
        let m = &self.rows;
        let cofactor =
            |r0: usize, c0: usize, r1: usize, c1: usize| m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0];
        let mut rows = [[0.0; 4]; 3];
        for (i, row) in rows.iter_mut().enumerate() {
            let (c1, c2) = ((i + 1) % 3, (i + 2) % 3);
            for (j, out) in row.iter_mut().take(3).enumerate() {
                let (r1, r2) = ((j + 1) % 3, (j + 2) % 3);
                *out = cofactor(r1, c1, r2, c2) / det;
            }
        }
        let o = self.origin();
        for row in &mut rows {
            row[3] = -(row[0] * o[0] + row[1] * o[1] + row[2] * o[2]);
        }
        Some(Self { rows })
    }

    /// Rows of `B^-T` (SPEC 4.6), B being this affine with columns divided by `frame_mm`: they map normals along the
    /// volume's axes to the world's. `None` as [`Affine::inverse`].
    pub(crate) fn normal_rows(&self, frame_mm: [f64; 3]) -> Option<[[f64; 3]; 3]> {
        let mut unit = *self;
        for row in &mut unit.rows {
            row.iter_mut().zip(frame_mm).for_each(|(v, spacing)| *v /= spacing);
        }
        let inverse = unit.inverse()?;
        Some(std::array::from_fn(|i| inverse.column(i)))
    }

    /// The world direction that each index axis runs along most, as letters such as `LPS`.
    pub(crate) fn orientation_letters(&self) -> String {
        (0..3)
            .map(|axis| {
                let c = self.column(axis);
                let main = (0..3).fold(0, |best, i| if c[i].abs() > c[best].abs() { i } else { best });
                b"LRPASI"[2 * main + usize::from(c[main] < 0.0)] as char
            })
            .collect()
    }
}

/// Directions of the three index axes of a headerless volume, as three letters: `LPS` means x increases to the
/// patient's Left, y to the Posterior, z to the Superior; `RAI` is the opposite of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(try_from = "String")]
pub struct Orientation {
    /// World axis (0 = L/R, 1 = P/A, 2 = S/I) of each index axis, and whether it runs backwards.
    axes: [(usize, bool); 3],
}

impl Orientation {
    /// DICOM's own directions: index axes along +L, +P, +S.
    pub const LPS: Self = Self { axes: [(0, false), (1, false), (2, false)] };

    /// Parses letters such as `LPS` or `lpi`; each of the pairs L/R, P/A, S/I must occur once.
    pub fn parse(text: &str) -> Option<Self> {
        let mut axes = [(0, false); 3];
        let mut seen = [false; 3];
        let letters: Vec<char> = text.chars().map(|c| c.to_ascii_uppercase()).collect();
        if letters.len() != 3 {
            return None;
        }
        for (slot, letter) in axes.iter_mut().zip(letters) {
            let at = "LRPASI".find(letter)?;
            *slot = (at / 2, at % 2 == 1);
            seen[at / 2] = true;
        }
        seen.iter().all(|s| *s).then_some(Self { axes })
    }

    /// Affine with these directions and this spacing, voxel (0, 0, 0) at the origin.
    pub fn affine(self, spacing_mm: [f64; 3]) -> Affine {
        let mut rows = [[0.0; 4]; 3];
        for (index_axis, (world_axis, backwards)) in self.axes.into_iter().enumerate() {
            rows[world_axis][index_axis] =
                if backwards { -spacing_mm[index_axis] } else { spacing_mm[index_axis] };
        }
        Affine { rows }
    }
}

impl FromStr for Orientation {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::parse(text).ok_or_else(|| {
            format!(
                "'{text}' is not an orientation; write three letters, one each of L/R, P/A and S/I, such as LPS"
            )
        })
    }
}

impl TryFrom<String> for Orientation {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl fmt::Display for Orientation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.affine([1.0; 3]).orientation_letters())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes_an_oblique_affine_at_tiny_and_huge_scales() {
        for scale in [1e-12, 1.0, 1e12] {
            let a = Affine {
                rows: [
                    [0.5 * scale, 0.1 * scale, 0.0, 3.0 * scale],
                    [0.0, 0.6 * scale, -0.2 * scale, -7.0 * scale],
                    [0.05 * scale, 0.0, 2.0 * scale, 11.0 * scale],
                ],
            };
            let back = a.inverse().unwrap().apply(a.apply([12.5, -3.0, 7.25]));
            for (got, want) in back.iter().zip([12.5, -3.0, 7.25]) {
                assert!((got - want).abs() < 1e-9, "{got} {want}");
            }
        }
        for absurd in
            [[1.0, 0.0, 1.0], [1e300, 1e-300, 1.0], [1e-6, 1.0, 1e4], [1e-16; 3], [f64::INFINITY; 3]]
        {
            assert!(Affine::from_spacing(absurd).inverse().is_none(), "{absurd:?}");
        }
        let flat = Affine { rows: [[1.0, 1.0, 0.0, 0.0], [0.0, 1e-12, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };
        assert!(flat.inverse().is_none());
    }

    #[test]
    fn orientation_letters_round_trip() {
        for text in ["LPS", "RAI", "PIR", "SLA"] {
            let o = Orientation::parse(text).unwrap();
            assert_eq!(o.to_string(), text);
        }
        assert!(Orientation::parse("LRS").is_none());
        assert!(Orientation::parse("LP").is_none());
        assert!(Orientation::parse("LPX").is_none());
    }
}
