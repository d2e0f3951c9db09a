//! The first hit of a ray, found by intersecting it with every skin voxel in exact rationals.

use infobyte::render::ray::{FRACTION_BITS, Face, Ray};
use infobyte::render::reference::ReferenceHit;

/// Units of an origin coordinate per cell.
const CELL: i128 = 1 << FRACTION_BITS;

/// First hit by intersecting the ray with each of `cells` and taking the earliest.
pub(crate) fn nearest_by_slabs(cells: impl Iterator<Item = [u32; 3]>, ray: &Ray) -> Option<ReferenceHit> {
    let (origin, direction) = (ray.origin().map(i128::from), ray.direction().map(i128::from));
    nearest_ideal(cells, origin, direction, CELL, ray.entry())
}

/// [`nearest_by_slabs`] for a ray of any integers: `cell_units` units of the origin make a cell, and the
/// origin may lie outside the grid; `entry` is what is reported when the ray starts in the hit.
///
/// Separates the error of quantising a ray from that of traversing it. The product of an
/// origin difference and a direction must fit an i128.
pub(crate) fn nearest_ideal(
    cells: impl Iterator<Item = [u32; 3]>,
    origin: [i128; 3],
    direction: [i128; 3],
    cell_units: i128,
    entry: Option<Face>,
) -> Option<ReferenceHit> {
    let mut best: Option<((i128, i128), ReferenceHit)> = None;
    'cells: for cell in cells {
        // The ray is in the cell for enter <= t < leave; times are fractions n / d with d > 0.
        let mut enter = (0, 1);
        let mut leave: Option<(i128, i128)> = None;
        let mut face = entry;
        for a in 0..3 {
            let (low, high) = (i128::from(cell[a]) * cell_units, (i128::from(cell[a]) + 1) * cell_units);
            let d = direction[a];
            if d == 0 {
                if origin[a] < low || origin[a] >= high {
                    continue 'cells;
                }
                continue;
            }
            let (near, far) = if d > 0 { (low, high) } else { (high, low) };
            let t_near = ((near - origin[a]) * d.signum(), d.abs());
            let t_far = ((far - origin[a]) * d.signum(), d.abs());
            if t_near.0 * enter.1 > enter.0 * t_near.1 {
                enter = t_near;
                face = Some(Face::new(a, d < 0));
            }
            if leave.is_none_or(|l| t_far.0 * l.1 < l.0 * t_far.1) {
                leave = Some(t_far);
            }
        }
        if leave.is_none_or(|l| enter.0 * l.1 >= l.0 * enter.1) {
            continue;
        }
        if best.is_none_or(|(b, _)| enter.0 * b.1 < b.0 * enter.1) {
            best = Some((enter, ReferenceHit { cell, face }));
        }
    }
    best.map(|(_, hit)| hit)
}
