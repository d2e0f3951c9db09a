//! Places of voxels, by the three methods of the NIfTI standard.

use crate::geom::Affine;
use crate::volume::Note;

/// The fields of a header that place its voxels, in the file's unit and RAS.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    /// Handedness of the qform, then the spacing.
    pub(super) pixdim: [f64; 4],
    /// Unit of length in the low three bits.
    pub(super) units: i32,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    /// Components b, c, d of the quaternion.
    pub(super) quaternion: [f64; 3],
    /// Position of voxel (0, 0, 0) by the qform.
    pub(super) offset: [f64; 3],
    /// The sform.
    pub(super) rows: [[f64; 4]; 3],
}

impl Placement {
    /// Voxel index to LPS mm.
    pub(super) fn affine(&self, notes: &mut Vec<Note>) -> Affine {
        let mm = match self.units & 7 {
            1 => 1000.0,
            3 => 1e-3,
            2 => 1.0,
            _ => {
                notes.push(Note::new("the header states no unit of length; mm is assumed"));
                1.0
            }
        };
        let ras = self.ras(notes);
        let mut rows = ras.map(|row| row.map(|v| v * mm));
        for row in rows.iter_mut().take(2) {
            row.iter_mut().for_each(|v| *v = 0.0 - *v);
        }
        Affine { rows }
    }

    /// Voxel index to RAS in the file's unit.
    fn ras(&self, notes: &mut Vec<Note>) -> [[f64; 4]; 3] {
        if self.sform_code > 0 {
            if (Affine { rows: self.rows }).inverse().is_some() {
                if self.qform_code > 0 && differ(&self.rows, &self.qform(self.spacing())) {
                    notes.push(Note::new("sform and qform of the header place the volume differently; the sform is used, and other programs may use the qform"));
                }
                return self.rows;
            }
            notes.push(unused(&self.rows, "sform"));
        }
        let spacing = self.spacing();
        for (axis, stated) in self.pixdim.iter().skip(1).enumerate().filter(|(_, step)| !step.is_finite()) {
            notes.push(Note::spacing(format!(
                "the header states a spacing of {} along axis {}; 1 mm is assumed there",
                *stated,
                axis + 1
            )));
        }
        if self.pixdim.iter().skip(1).any(|step| *step == 0.0) {
            notes.push(Note::spacing("the header states no spacing along some axis; 1 mm is assumed"));
        }
        if self.qform_code > 0 {
            let rows = self.qform(spacing);
            if (Affine { rows }).inverse().is_some() {
                return rows;
            }
            notes.push(unused(&rows, "qform"));
        }
        notes.push(Note::directions(
"the header states no orientation; its axes are taken as right, anterior, superior, so left and right may be swapped"));
        let mut rows = [[0.0; 4]; 3];
        for (axis, (row, step)) in rows.iter_mut().zip(spacing).enumerate() {
            row[axis] = step;
        }
        rows
    }

    /// The spacing by `pixdim`; 1 where it makes no sense.
    fn spacing(&self) -> [f64; 3] {
        [1, 2, 3].map(|i: usize| {
            let step = self.pixdim.get(i).copied().unwrap_or(1.0).abs();
            if step > 0.0 && step.is_finite() { step } else { 1.0 }
        })
    }

    /// Rotation by the unit quaternion (a, b, c, d), with the third axis reversed where `pixdim[0]` < 0.
    fn qform(&self, spacing: [f64; 3]) -> [[f64; 4]; 3] {
        let [mut b, mut c, mut d] = self.quaternion;
        let rest = 1.0 - (b * b + c * c + d * d);
        let a = if rest < 1e-7 {
            // A half turn, within single precision: (b, c, d) is made a unit vector.
            let norm = 1.0 / (b * b + c * c + d * d).sqrt();
            (b, c, d) = (b * norm, c * norm, d * norm);
            0.0
        } else {
            rest.sqrt()
        };
        let rotation = [
            [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
            [2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)],
            [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - b * b - c * c],
        ];
        let third = if self.pixdim[0] < 0.0 { -spacing[2] } else { spacing[2] };
        let steps = [spacing[0], spacing[1], third];
        let mut rows = [[0.0; 4]; 3];
        for ((row, turned), offset) in rows.iter_mut().zip(rotation).zip(self.offset) {
            *row = [turned[0] * steps[0], turned[1] * steps[1], turned[2] * steps[2], offset];
        }
        rows
    }
}

/// The note on an affine that is not used.
fn unused(rows: &[[f64; 4]; 3], form: &str) -> Note {
    if rows.iter().flatten().all(|v| v.is_finite()) {
        Note::new(format!("the {form} of the header is singular and is not used"))
    } else {
        Note::new(format!("the {form} of the header has numbers that are not finite, and is not used"))
    }
}

/// True if two placements differ by more than singles and rounded quaternions do: by a hundredth of a step in
/// directions or spacing, or half a step in position.
fn differ(a: &[[f64; 4]; 3], b: &[[f64; 4]; 3]) -> bool {
    let step = |column: usize| a.iter().map(|row| row[column] * row[column]).sum::<f64>().sqrt();
    let smallest = (0..3).map(step).fold(f64::INFINITY, f64::min);
    (0..4).any(|column| {
        let most = if column == 3 { smallest / 2.0 } else { step(column) / 100.0 };
        a.iter().zip(b).any(|(a, b)| (a[column] - b[column]).abs() > most)
    })
}
