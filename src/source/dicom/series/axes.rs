//! Directions of rows and columns, and the normal on both.

use crate::geom::{cross, dot};

/// `axial`, `coronal` or `sagittal`, by the nearest axis of the patient.
pub(crate) fn plane(orientation: [f64; 6]) -> Option<&'static str> {
    let (_, _, normal) = directions(orientation)?;
    let [x, y, z] = normal.map(f64::abs);
    Some(if z >= x && z >= y {
        "axial"
    } else if y >= x {
        "coronal"
    } else {
        "sagittal"
    })
}

/// The directions along a row and down a column as stated, and their normal of unit length; `None` if they
/// are not nearly unit vectors and perpendicular.
///
/// Scanners round cosines to a few digits. The equation that places pixels (PS3.3 C.7.6.2.1.1) takes them
/// as they are, and so does every other reader; corners would be some micrometres off if they were mended.
pub(crate) fn directions(axes: [f64; 6]) -> Option<([f64; 3], [f64; 3], [f64; 3])> {
    let [a, b, c, d, e, f] = axes;
    let (row, column) = ([a, b, c], [d, e, f]);
    let is_unit = |v: [f64; 3]| (dot(v, v).sqrt() - 1.0).abs() < 0.01;
    if !is_unit(row) || !is_unit(column) || dot(row, column).abs() >= 0.01 {
        return None;
    }
    let normal = cross(row, column);
    let length = dot(normal, normal).sqrt();
    Some((row, column, normal.map(|c| c / length)))
}

pub(crate) fn count(n: usize) -> f64 {
    n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_nearly_perpendicular_units_and_kept_as_stated() {
        let stated = [0.999_97, 0.007_18, 0.0, -0.007_18, 0.999_9, 0.0];
        let (row, column, normal) = directions(stated).unwrap();
        assert_eq!((row, column), ([0.999_97, 0.007_18, 0.0], [-0.007_18, 0.999_9, 0.0]));
        assert_eq!(normal, [0.0, 0.0, 1.0]);
        for bad in [[0.0; 6], [1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0, 1.0, 0.0]] {
            assert!(directions(bad).is_none());
        }
    }
}
