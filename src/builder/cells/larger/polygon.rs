//! Distances of points of a larger leaf's plane from the surface within the fine cells.

use super::plane::Fit;
use super::{BETWEEN, FineBrick, PARTS};
use crate::builder::cells::corner::EDGES;
use crate::format::cell::HAS_CORNERS;
use crate::geom::{add_scaled, dot};

/// Number of cells of a box from which only those around a point are tested.
const MANY: usize = 48;

/// Greatest distance of the plane's cuts with the box's edges, and of their middle, from the nearest fine polygon, in
/// parts of a voxel of the finest spacing; `None` if one is too far, or the plane does not cut the box.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most one and a half voxels")]
pub(super) fn between(fit: &Fit<'_>, code: u16, offset: i8) -> Option<u32> {
    let limit = BETWEEN * fit.bound.error;
    let (mut middle, mut count, mut worst) = ([0.0; 3], 0_u32, 0.0_f64);
    let (mut left, ahead) = fit.cut_edges(code, offset);
    while left != 0 {
        let cut = fit.cut(left.trailing_zeros() as usize, &ahead);
        left &= left - 1;
        middle = add_scaled(middle, 1.0, cut.point);
        count += 1;
        let along = fit.along_edge(&cut);
        worst = worst.max(if along <= limit { along } else { distance(fit, cut.point, limit)? });
    }
    if count < 3 {
        return None;
    }
    let middle = middle.map(|c| c / f64::from(count));
    let inner = fit.cell_at(middle).map_or(f64::INFINITY, |cell| within_cell(fit, cell, middle));
    worst = worst.max(if inner <= limit { inner } else { distance(fit, middle, limit)? });
    Some((worst * f64::from(PARTS) + 0.5).floor() as u32)
}

/// Distance of a point, in cells of the brick, from the plane of a cell, if its foot on the plane is in the cell; else
/// infinity.
#[inline(always)]
fn within_cell(fit: &Fit<'_>, cell: usize, point: [f64; 3]) -> f64 {
    let sides = fit.bound.sides;
    let place = fit.places[cell].map(f64::from);
    let from = |a: usize| (point[a] - place[a]) * sides[a];
    let from_place = [from(0), from(1), from(2)];
    let Some((normal, on_plane)) = plane_of(fit.brick, cell, sides) else { return f64::INFINITY };
    foot(normal, on_plane, sides, from_place)
}

/// Distance of a point from a plane, if its foot on the plane is in the cell; else infinity.
#[inline(always)]
fn foot(normal: [f64; 3], on_plane: f64, sides: [f64; 3], point: [f64; 3]) -> f64 {
    let (square, ahead) = (dot(normal, normal), dot(normal, point) - on_plane);
    let foot = add_scaled(point, -ahead / square, normal);
    let is_in = (0..3).all(|a| foot[a] >= 0.0 && foot[a] <= sides[a]);
    if is_in { ahead.abs() / square.sqrt() } else { f64::INFINITY }
}

/// The plane of a cell as a normal and its product with points of the plane, from the cell's lowest corner in voxels of
/// the finest spacing; `None` for cells with corners.
#[inline(always)]
fn plane_of(brick: &FineBrick<'_>, cell: usize, sides: [f64; 3]) -> Option<([f64; 3], f64)> {
    let offset = brick.offsets[cell].cast_signed();
    let n = brick.normal(cell).map(f64::from);
    // N . (2 p - 1) = offset.
    let on_plane = 0.5 * (f64::from(offset) + n[0] + n[1] + n[2]);
    (offset != HAS_CORNERS).then_some(([n[0] / sides[0], n[1] / sides[1], n[2] / sides[2]], on_plane))
}

/// Distance of a point, in cells of the brick, from the nearest fine polygon; `None` if all are too far.
fn distance(fit: &Fit<'_>, point: [f64; 3], limit: f64) -> Option<f64> {
    let sides = fit.bound.sides;
    let mut nearest = f64::INFINITY;
    let mut look_at = |cell: usize| {
        let place = fit.places[cell].map(f64::from);
        let is_near = (0..3).all(|a| {
            let off = (point[a] - place[a] - 0.5).abs() - 0.5;
            off * sides[a] <= limit
        });
        if is_near && nearest > limit {
            let from_place = std::array::from_fn(|a| (point[a] - place[a]) * sides[a]);
            nearest = nearest.min(to_cell(fit.brick, cell, sides, from_place, limit));
        }
    };
    if fit.cells.len() < MANY {
        fit.cells.clone().for_each(look_at);
    } else {
        for_each_around(fit, point, limit, &mut look_at);
    }
    (nearest <= limit).then_some(nearest)
}

/// Calls `found` with all cells of the box that may be within the limit of a point, and some more.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places within a brick")]
fn for_each_around(fit: &Fit<'_>, point: [f64; 3], limit: f64, found: &mut impl FnMut(usize)) {
    let range: [std::ops::RangeInclusive<u32>; 3] = std::array::from_fn(|a| {
        let (low, high) = (f64::from(fit.low[a]), f64::from(fit.low[a] + fit.edge - 1));
        let reach = limit / fit.bound.sides[a] + 1e-6;
        let [first, last] = [(point[a] - 1.0 - reach).ceil(), (point[a] + reach).floor()];
        first.clamp(low, high) as u32..=last.clamp(low, high) as u32
    });
    for z in range[2].clone() {
        for y in range[1].clone() {
            for x in range[0].clone() {
                if let Some(cell) = fit.cell_of([x, y, z]) {
                    found(cell);
                }
            }
        }
    }
}

/// Distance of a point from the polygon in a cell, both from its lowest corner in voxels of the finest spacing; any
/// value above the limit if the distance exceeds it.
fn to_cell(brick: &FineBrick<'_>, cell: usize, sides: [f64; 3], point: [f64; 3], limit: f64) -> f64 {
    let plane = plane_of(brick, cell, sides);
    if let Some((normal, on_plane)) = plane {
        let (square, ahead) = (dot(normal, normal), dot(normal, point) - on_plane);
        // Corners of polygons are rounded to PARTS.
        let beyond = limit + 8.0 / f64::from(PARTS);
        if ahead * ahead > square * beyond * beyond {
            return f64::INFINITY;
        }
        let distance = foot(normal, on_plane, sides, point);
        if distance <= limit {
            return distance;
        }
    }
    let mut corners = [([0.0; 3], (0, 0)); 12];
    let mut count = 0_u32;
    let mut middle = [0.0; 3];
    brick.for_each_crossing(cell, |(p, q), along| {
        let axis = (p ^ q).trailing_zeros() as usize;
        let at: [f64; 3] = std::array::from_fn(|a| {
            let part = if a == axis {
                f64::from(along) / f64::from(PARTS)
            } else {
                f64::from(u8::from(p >> a & 1 == 1))
            };
            part * sides[a]
        });
        corners[count as usize % EDGES.len()] = (at, (p, q));
        count += 1;
        middle = add_scaled(middle, 1.0, at);
    });
    let corners = &corners[..(count as usize).min(EDGES.len())];
    let mut nearest = f64::INFINITY;
    // Edges of the polygon lie in the faces of the cell.
    for (i, (a, (p, q))) in corners.iter().enumerate() {
        for (b, (r, s)) in &corners[i + 1..] {
            let low_face = !(p | q | r | s) & 7;
            let high_face = p & q & r & s & 7;
            if low_face | high_face != 0 {
                nearest = nearest.min(to_segment(point, *a, *b));
            }
        }
    }
    if plane.is_none() {
        // Inner points of the polygon lie near the plane of its normal through the middle of its corners.
        let n = brick.normal(cell).map(f64::from);
        let normal: [f64; 3] = std::array::from_fn(|a| n[a] / sides[a]);
        let mean = middle.map(|c| c / f64::from(count.max(1)));
        nearest = nearest.min(foot(normal, dot(normal, mean), sides, point));
    }
    nearest
}

fn to_segment(point: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let (along, from) = (add_scaled(b, -1.0, a), add_scaled(point, -1.0, a));
    let square = dot(along, along);
    let part = if square > 0.0 { (dot(from, along) / square).clamp(0.0, 1.0) } else { 0.0 };
    let off = add_scaled(from, -part, along);
    dot(off, off).sqrt()
}
