//! How far points of a larger leaf's plane are from the surface within the fine cells.

use super::plane::Fit;
use super::{BETWEEN, FineBrick, PARTS};
use crate::builder::cells::corner::EDGES;
use crate::geom::{add_scaled, dot, morton};

/// Cells of a box from which on only those around a point are looked at.
const MANY: usize = 48;

/// The greatest distance, in parts of a voxel of the finest spacing, from the points where the plane cuts the box's
/// edges, and from their middle, to the nearest fine polygon; `None` if one is too far, or the plane does not cut it.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most one and a half voxels")]
pub(super) fn between(fit: &Fit<'_>, code: u16, offset: i8) -> Option<u32> {
    let (mut middle, mut count, mut worst) = ([0.0; 3], 0_u32, 0.0_f64);
    for point in fit.cuts(code, offset) {
        middle = add_scaled(middle, 1.0, point);
        count += 1;
        worst = worst.max(distance(fit, point)?);
    }
    if count < 3 {
        return None;
    }
    worst = worst.max(distance(fit, middle.map(|c| c / f64::from(count)))?);
    Some((worst * f64::from(PARTS) + 0.5).floor() as u32)
}

/// Distance of a point, in cells of the brick, to the nearest fine polygon; `None` if it is too far.
fn distance(fit: &Fit<'_>, point: [f64; 3]) -> Option<f64> {
    let limit = BETWEEN * fit.bound.error;
    let sides = fit.bound.sides;
    let mut nearest = f64::INFINITY;
    let mut look_at = |cell: usize| {
        let place = fit.places[cell].map(f64::from);
        let is_near = (0..3).all(|a| {
            let off = (point[a] - place[a] - 0.5).abs() - 0.5;
            off * sides[a] <= limit
        });
        if is_near {
            let from_place = std::array::from_fn(|a| (point[a] - place[a]) * sides[a]);
            nearest = nearest.min(to_cell(fit.brick, cell, sides, from_place));
        }
    };
    if fit.cells.len() < MANY {
        fit.cells.clone().for_each(look_at);
    } else {
        for_each_around(fit, point, limit, &mut look_at);
    }
    (nearest <= limit).then_some(nearest)
}

/// Calls `found` with the cells of the box whose places may be as near to a point as the limit, and some more.
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
                let code = morton::encode(x, y, z) as usize;
                let (word, bit) = (code / 64, code % 64);
                if fit.brick.words[word] >> bit & 1 == 1 {
                    let below = fit.brick.words[word] & ((1 << bit) - 1);
                    found(fit.before[word] + below.count_ones() as usize);
                }
            }
        }
    }
}

/// Distance of a point from the polygon in a cell, both from its lowest corner in voxels of the finest spacing.
fn to_cell(brick: &FineBrick<'_>, cell: usize, sides: [f64; 3], point: [f64; 3]) -> f64 {
    let mut corners = [([0.0; 3], (0, 0)); 12];
    let mut count = 0;
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
        corners[count % EDGES.len()] = (at, (p, q));
        count += 1;
        middle = add_scaled(middle, 1.0, at);
    });
    let corners = &corners[..count.min(EDGES.len())];
    let mut nearest = f64::INFINITY;
    // Its edges lie in the faces of the cell.
    for (i, (a, (p, q))) in corners.iter().enumerate() {
        for (b, (r, s)) in &corners[i + 1..] {
            let low_face = !(p | q | r | s) & 7;
            let high_face = p & q & r & s & 7;
            if low_face | high_face != 0 {
                nearest = nearest.min(to_segment(point, *a, *b));
            }
        }
    }
    // Its inner points: the foot of the perpendicular, if that is in the cell.
    let n = brick.normal(cell).map(f64::from);
    let normal: [f64; 3] = std::array::from_fn(|a| n[a] / sides[a]);
    let square = dot(normal, normal);
    let offset = f64::from(brick.offsets[cell].cast_signed());
    let on_plane = if brick.offsets[cell].cast_signed() == crate::format::cell::HAS_CORNERS {
        #[expect(clippy::cast_precision_loss, reason = "at most 12")]
        let mean = middle.map(|c| c / count.max(1) as f64);
        dot(normal, mean)
    } else {
        // N . (2 p - 1) = offset.
        0.5 * (offset + n[0] + n[1] + n[2])
    };
    let ahead = dot(normal, point) - on_plane;
    let foot = add_scaled(point, -ahead / square, normal);
    if (0..3).all(|a| foot[a] >= 0.0 && foot[a] <= sides[a]) {
        nearest = nearest.min(ahead.abs() / square.sqrt());
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
