//! Rays that start at a surface: their exit from the boxes around the one that was hit.
//!
//! That border lies between boxes, so it is exact in the ray's integers, and a ray never hits the box that it comes
//! from. A surface of boxes is a staircase, whose own steps are not obstacles: where nothing else identifies them, a
//! few boxes on every side are left as well ([`REACH`]), without a small length that would be too long in one place and
//! too short in another.

use super::ray::Ray;
use super::space::GridSpace;
use super::traverse::Hit;

/// Boxes on every side of a hit box that do not stop rays from it.
pub(crate) const REACH: u32 = 2;

/// The part of the world line `origin + t * direction` from its exit from a hit's box and `reach` boxes on every side
/// of it, and t there; the ray's own parameter counts from that point. `None` if it is outside the grid.
///
/// The line should pass through those boxes, or near them.
pub(crate) fn leaving(
    space: &GridSpace,
    (hit, reach): (&Hit, u32),
    origin: [f64; 3],
    direction: [f64; 3],
    least: f64,
) -> Option<(Ray, f64)> {
    let direction = space.world_to_grid().apply_vector(direction);
    let edge = 1_u32 << hit.edge_log2.min(31);
    let (low, high): ([f64; 3], [f64; 3]) = (
        hit.cell.map(|c| f64::from(c) - f64::from(reach * edge)),
        hit.cell.map(|c| f64::from(c) + f64::from(edge) + f64::from(reach * edge)),
    );
    let from = space.to_grid(origin);
    let (mut time, mut axis) = (f64::INFINITY, 0);
    let border = |a: usize| if direction[a] > 0.0 { high[a] } else { low[a] };
    for a in 0..3 {
        let after = (border(a) - from[a]) / direction[a];
        if direction[a] != 0.0 && after < time {
            (time, axis) = (after, a);
        }
    }
    let mut start: [f64; 3] = std::array::from_fn(|a| (from[a] + direction[a] * time).clamp(low[a], high[a]));
    start[axis] = border(axis);
    let side = f64::from(1_u32 << space.dims().depth().min(31));
    if !start.iter().all(|c| (0.0..=side).contains(c)) {
        return None;
    }
    let ray = Ray::new(space.dims().depth(), start, direction, least - time).ok().flatten()?;
    Some((ray, time))
}
