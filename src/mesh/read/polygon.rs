//! Polygons of more than three corners, cut into triangles: those that are not convex by ear clipping.
//!
//! A fan from the first corner is right wherever all its triangles face one way, and stays as it is. Otherwise the
//! polygon is cut as it lies in its mean plane. Whatever the corners, collinear ones included, each side belongs to one
//! triangle and every other edge to two, so that a closed mesh stays closed.

use std::collections::BTreeSet;

use earcut::Earcut;

use crate::geom::{cross, dot};

/// Most corners of a polygon that is cut; larger ones are fans. (Some 200 bytes a corner.)
pub(crate) const MAX_CORNERS: usize = 4096;
/// Largest part of an area that may be rounding.
const ROUNDING: f64 = 1e-9;

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// The triangles of a polygon by the places of their corners, as many as in a fan; `None` where a fan from the first
/// corner is right, or no cut is, as for polygons that cross themselves.
pub(crate) fn cut(corners: &[[f64; 3]]) -> Option<Vec<[u32; 3]>> {
    let count = corners.len();
    let first = *corners.first().filter(|_| (4..=MAX_CORNERS).contains(&count))?;
    // Newell: twice the area, across the mean plane.
    let areas = || corners[1..].windows(2).map(|pair| cross(sub(pair[0], first), sub(pair[1], first)));
    let normal = areas().fold([0.0; 3], |sum, area| std::array::from_fn(|k| sum[k] + area[k]));
    let squared = dot(normal, normal);
    if !squared.is_normal() || areas().all(|area| dot(area, normal) >= -ROUNDING * squared) {
        return None;
    }
    // Corners at the place of the one before are left out, each with a triangle without area.
    let (mut kept, mut flattened): (Vec<u32>, Vec<[u32; 3]>) = (Vec::with_capacity(count), Vec::new());
    let last = u32::try_from(count).ok()? - 1;
    for at in 0..=last {
        match kept.last() {
            Some(before) if corners[*before as usize] == corners[at as usize] => {
                flattened.push([*before, at, if at == last { 0 } else { at + 1 }]);
            }
            _ => kept.push(at),
        }
    }
    if let Some(end) = kept.pop_if(|end| *end > 0 && corners[*end as usize] == first) {
        flattened.push([*kept.last()?, end, 0]);
    }
    let axis = (0..3).max_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs()))?;
    let plane = kept
        .iter()
        .map(|at| corners[*at as usize])
        .map(|p| [p[(axis + 1) % 3] - first[(axis + 1) % 3], p[(axis + 2) % 3] - first[(axis + 2) % 3]]);
    let flat: Vec<[f64; 2]> = plane.collect();
    let mut numbers: Vec<u32> = Vec::new();
    Earcut::new().earcut(flat.iter().copied(), &[] as &[u32], &mut numbers);
    let mut triangles = numbers.as_chunks::<3>().0.to_vec();
    closed(&mut triangles, u32::try_from(kept.len()).ok()?)?;
    // The triangles cover the same area as the polygon, unless it crosses itself.
    let area = |[a, b, c]: [u32; 3]| {
        let [a, b, c] = [a, b, c].map(|at| flat[at as usize]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    let covered: f64 = triangles.iter().map(|t| area(*t).abs()).sum();
    let whole = normal[axis].abs();
    let all = triangles.iter().map(|t| t.map(|at| kept[at as usize])).chain(flattened);
    ((covered - whole).abs() <= 1e-6 * whole).then(|| all.collect())
}

/// Turns triangles the way of the polygon, and adds those without area that make each side and each edge meet its
/// like; `None` where that is not possible.
fn closed(triangles: &mut Vec<[u32; 3]>, count: u32) -> Option<()> {
    let next = |at: u32| (at + 1) % count;
    let edges = |t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let backwards = triangles.iter().flat_map(edges).any(|[a, b]| a == next(b));
    if backwards {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    // Edges that still want one the other way.
    let mut open: BTreeSet<[u32; 2]> = (0..count).map(|at| [next(at), at]).collect();
    for [a, b] in triangles.iter().flat_map(edges) {
        if !open.remove(&[b, a]) && !open.insert([a, b]) {
            return None;
        }
    }
    // Gaps along lines, each a loop of such edges.
    while let Some([mut at, first]) = open.pop_first() {
        let mut last = None;
        while at != first {
            let [next, _] = *open.iter().find(|edge| edge[1] == at)?;
            open.remove(&[next, at]);
            if let Some(last) = last {
                triangles.push([first, last, at]);
            }
            (last, at) = (Some(at), next);
        }
    }
    (triangles.len() + 2 == count as usize).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the first corner, the plane and the way around: every side once, no overlap, the right area.
    #[test]
    fn polygons_are_cut_into_triangles_that_cover_them_once() {
        let u = [
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [9.0, 10.0],
            [9.0, 2.0],
            [1.0, 2.0],
            [1.0, 10.0],
            [0.0, 10.0],
        ];
        let lined = [
            [0.0, 0.0],
            [5.0, 0.0],
            [10.0, 0.0],
            [10.0, 5.0],
            [10.0, 10.0],
            [9.0, 10.0],
            [9.0, 6.0],
            [9.0, 2.0],
            [5.0, 2.0],
            [1.0, 2.0],
            [1.0, 10.0],
            [0.0, 10.0],
            [0.0, 5.0],
        ];
        let twice: Vec<[f64; 2]> = u.iter().flat_map(|corner| [*corner; 2]).collect();
        let star: Vec<[f64; 2]> = (0..40)
            .map(|at| {
                let (radius, angle) =
                    (if at % 2 == 0 { 10.0 } else { 3.0 }, f64::from(at) * std::f64::consts::PI / 20.0);
                [radius * angle.cos(), radius * angle.sin()]
            })
            .collect();
        let square = [[0.0, 0.0], [4.0, 0.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]];
        let arrow = [[0.0, 0.0], [10.0, 5.0], [0.0, 10.0], [2.0, 5.0]];
        let mut cut_up = 0;
        for flat in [&u[..], &lined, &twice, &star, &square, &arrow] {
            let shoelace = |at: usize| {
                let ([a, b], [c, d]) = (flat[at], flat[(at + 1) % flat.len()]);
                a * d - b * c
            };
            let whole = (0..flat.len()).map(shoelace).sum::<f64>().abs() / 2.0;
            for round in 0..4 * flat.len() {
                let mut corners: Vec<[f64; 3]> = flat
                    .iter()
                    .map(|[x, y]| match round % 4 {
                        0 => [*x, *y, 3.0],
                        1 => [*y, -1.0, *x],
                        2 => [*x + y / 2.0, y - x / 3.0, 0.7 * x + y],
                        // Corners outside a plane.
                        _ => [*x, *y, 0.01 * x * y],
                    })
                    .collect();
                corners.rotate_left(round / 4);
                if round % 8 > 3 {
                    corners.reverse();
                }
                let count = u32::try_from(corners.len()).unwrap();
                let fan = || (1..count - 1).map(|at| [0, at, at + 1]).collect();
                let made = cut(&corners);
                cut_up += usize::from(made.is_some());
                let triangles: Vec<[u32; 3]> = made.unwrap_or_else(fan);
                assert_eq!(triangles.len() + 2, corners.len());
                let mut edges: Vec<[u32; 2]> =
                    triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
                edges.extend((0..count).map(|at| [(at + 1) % count, at]));
                let paired =
                    |edge: &[u32; 2]| edges.iter().filter(|other| **other == [edge[1], edge[0]]).count() == 1;
                assert!(edges.iter().all(paired), "{triangles:?}");
                if round % 4 < 2 {
                    let area = |t: &[u32; 3]| {
                        let [a, b, c] = t.map(|at| corners[at as usize]);
                        let n = cross(sub(b, a), sub(c, a));
                        dot(n, n).sqrt() / 2.0
                    };
                    let covered: f64 = triangles.iter().map(area).sum();
                    assert!((covered - whole).abs() < 1e-9 * whole, "{covered} of {whole}");
                }
            }
        }
        assert!(cut_up > 100);
        // Convex ones stay fans, and so do those that cross themselves.
        for fan in [&square[..], &[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]]] {
            let corners: Vec<[f64; 3]> = fan.iter().map(|[x, y]| [*x, *y, 1.0]).collect();
            assert_eq!(cut(&corners), None);
        }
    }
}
