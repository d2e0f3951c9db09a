//! A patch of the surface, with fewer triangles.
//!
//! Edges are collapsed by meshoptimizer (quadric error metrics, Garland and Heckbert 1997) among the corners that are
//! there; its metric is no bound of the distance. Here the bound is checked: middles and corners of the fine triangles
//! lie within it of the new ones, and points of these, half a voxel apart, within it of the fine ones. A patch that
//! fails is made again with less of the metric, at last not at all. So is one whose edges no longer have two triangles, or
//! whose border is another. New edges between two corners of the border get a corner in their middle, since the patch
//! behind the border might have the same edge.

use std::collections::HashMap;

use meshopt::{SimplifyOptions, VertexDataAdapter};

use super::near::Near;
use crate::geom::{add_scaled, cross, dot};

/// What is asked of the metric, as parts of the bound, one after the other: seven in ten patches keep it at first.
const TRIES: [f64; 4] = [0.6, 0.4, 0.2, 0.1];
/// Rows of points on a new triangle, and points in a row, at most.
const MAX_POINTS: f64 = 256.0;

/// How far the new surface may be from the fine one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bound {
    pub(super) mm: f64,
    /// Least distance of two samples in mm.
    pub(super) voxel_mm: f64,
}

/// Triangles and their corners.
#[derive(Debug, Default)]
pub(super) struct Patch {
    pub(super) at: Vec<[f32; 3]>,
    pub(super) faces: Vec<[u32; 3]>,
}

/// A patch with fewer triangles, if there are any.
#[derive(Debug, Default)]
pub(super) struct Fewer {
    pub(super) faces: Option<Vec<[u32; 3]>>,
    /// Corners behind the patch's own: middles of two of these.
    pub(super) middles: Vec<[u32; 2]>,
    /// Which of the patch's own corners other patches may have, too.
    pub(super) shared: Vec<bool>,
}

/// An edge in the order of its triangle: its first corner in the high half.
type Edge = u64;

fn edge(a: u32, b: u32) -> Edge {
    u64::from(a) << 32 | u64::from(b)
}

/// All edges in order.
pub(super) fn edges(faces: &[[u32; 3]]) -> Vec<Edge> {
    let mut edges = Vec::with_capacity(3 * faces.len());
    for [a, b, c] in faces {
        edges.extend([edge(*a, *b), edge(*b, *c), edge(*c, *a)]);
    }
    edges.sort_unstable();
    edges
}

/// The edges of one triangle, in order; `None` if there are edges of more than two, or two that disagree.
fn border(faces: &[[u32; 3]]) -> Option<Vec<Edge>> {
    let edges = edges(faces);
    if edges.windows(2).any(|pair| pair[0] == pair[1]) {
        return None;
    }
    let is_open = |edge: &&Edge| edges.binary_search(&edge.rotate_left(32)).is_err();
    Some(edges.iter().filter(is_open).copied().collect())
}

impl Patch {
    /// Fewer triangles of the same corners, within the bound, and with the same border.
    pub(super) fn decimated(&self, bound: Bound) -> Fewer {
        let Some(border) = border(&self.faces) else {
            return Fewer { shared: vec![true; self.at.len()], ..Fewer::default() };
        };
        let mut shared = vec![false; self.at.len()];
        border.iter().for_each(|edge| shared[(edge >> 32) as usize] = true);
        let mut fewer = Fewer { faces: self.within(bound, &border), middles: Vec::new(), shared };
        self.split(&mut fewer);
        fewer
    }

    /// Splits new edges between corners that other patches may have, which might have the same edge.
    fn split(&self, fewer: &mut Fewer) {
        let Some(faces) = &mut fewer.faces else { return };
        let old = edges(&self.faces);
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            let is_new = || [edge(a, b), edge(b, a)].iter().all(|edge| old.binary_search(edge).is_err());
            if !(fewer.shared[a as usize] && fewer.shared[b as usize] && is_new()) {
                return None;
            }
            Some(*middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                fewer.middles.push([a.min(b), a.max(b)]);
                u32::try_from(self.at.len() + fewer.middles.len() - 1).unwrap_or(u32::MAX)
            }))
        };
        let mut all = Vec::with_capacity(faces.len());
        for [a, b, c] in faces.iter().copied() {
            match [middle(a, b), middle(b, c), middle(c, a)] {
                [None, None, None] => all.push([a, b, c]),
                [Some(p), None, None] => all.extend([[p, b, c], [p, c, a]]),
                [None, Some(q), None] => all.extend([[q, c, a], [q, a, b]]),
                [None, None, Some(r)] => all.extend([[r, a, b], [r, b, c]]),
                [Some(p), Some(q), None] => all.extend([[p, b, q], [p, q, c], [p, c, a]]),
                [None, Some(q), Some(r)] => all.extend([[q, c, r], [q, r, a], [q, a, b]]),
                [Some(p), None, Some(r)] => all.extend([[r, a, p], [r, p, b], [r, b, c]]),
                [Some(p), Some(q), Some(r)] => all.extend([[a, p, r], [p, b, q], [q, c, r], [p, q, r]]),
            }
        }
        *faces = all;
    }

    fn within(&self, bound: Bound, outline: &[Edge]) -> Option<Vec<[u32; 3]>> {
        let first = *self.at.first()?;
        // Near the origin, where 32 bits tell more places apart.
        let local: Vec<[f32; 3]> =
            self.at.iter().map(|at| std::array::from_fn(|a| at[a] - first[a])).collect();
        for part in TRIES {
            #[expect(clippy::cast_possible_truncation, reason = "what it gives is checked")]
            let faces = collapsed(&local, &self.faces, (part * bound.mm) as f32)?;
            if faces.len() == self.faces.len() {
                return None;
            }
            if border(&faces).as_deref() == Some(outline) && self.is_near(&local, &faces, bound) {
                return Some(faces);
            }
        }
        None
    }

    fn is_near(&self, local: &[[f32; 3]], faces: &[[u32; 3]], bound: Bound) -> bool {
        let at = |number: u32| local[number as usize].map(f64::from);
        let corners = |face: &[u32; 3]| face.map(at);
        let mut span = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for (p, a) in local.iter().flat_map(|p| (0..3).map(move |a| (f64::from(p[a]), a))) {
            span = [(0, f64::min as fn(f64, f64) -> f64), (1, f64::max)].map(|(side, of)| {
                let mut whole = span[side];
                whole[a] = of(whole[a], p);
                whole
            });
        }
        // Between the points that are looked at, distances are a little larger.
        let within = bound.mm - (bound.voxel_mm / 64.0).min(0.25 * bound.mm);
        let mut coarse = Near::new(span, within, faces.iter().map(corners));
        let is_kept = {
            let mut kept = vec![false; local.len()];
            faces.iter().flatten().for_each(|number| kept[*number as usize] = true);
            kept
        };
        let gone = (0_u32..).zip(&is_kept).filter(|(_, kept)| !**kept);
        if !gone.map(|(number, _)| at(number)).all(|p| coarse.holds(p)) {
            return false;
        }
        let middle = |[a, b, c]: [[f64; 3]; 3]| std::array::from_fn(|k| (a[k] + b[k] + c[k]) / 3.0);
        if !self.faces.iter().map(|face| middle(corners(face))).all(|p| coarse.holds(p)) {
            return false;
        }
        let mut fine = Near::new(span, within, self.faces.iter().map(corners));
        faces.iter().all(|face| lattice(corners(face), 0.5 * bound.voxel_mm, |p| fine.holds(p)))
    }
}

/// Do all points of a triangle hold, in rows `step` mm apart or less, and as far from each other?
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded")]
pub(super) fn lattice(corners: [[f64; 3]; 3], step: f64, mut holds: impl FnMut([f64; 3]) -> bool) -> bool {
    let ways = [0, 1, 2].map(|k| add_scaled(corners[(k + 1) % 3], -1.0, corners[k]));
    let squares = ways.map(|way| dot(way, way));
    let longest = (0..3).max_by(|i, j| squares[*i].total_cmp(&squares[*j])).unwrap_or(0);
    let [a, along, aside] = [corners[longest], ways[longest], ways[(longest + 2) % 3].map(|c| -c)];
    let [length, area] = [along, cross(along, aside)].map(|v| dot(v, v).sqrt());
    let parts = |length: f64| (length / step).ceil().clamp(1.0, MAX_POINTS) as u32;
    let rows = parts(area / length);
    (0..=rows).all(|row| {
        let up = f64::from(row) / f64::from(rows);
        let points = parts((1.0 - up) * length);
        (0..=points).all(|point| {
            let right = (1.0 - up) * f64::from(point) / f64::from(points);
            holds(add_scaled(add_scaled(a, up, aside), right, along))
        })
    })
}

/// Triangles after all collapses below an error of meshoptimizer's metric; the border stays.
fn collapsed(at: &[[f32; 3]], faces: &[[u32; 3]], error: f32) -> Option<Vec<[u32; 3]>> {
    let corners = VertexDataAdapter::new(bytemuck::cast_slice(at), size_of::<[f32; 3]>(), 0).ok()?;
    let options = SimplifyOptions::LockBorder | SimplifyOptions::ErrorAbsolute;
    let numbers = meshopt::simplify(faces.as_flattened(), &corners, 0, error, options, None);
    Some(numbers.as_chunks().0.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of `n`^2 samples whose height is a function of its place.
    fn sheet(n: u32, height: impl Fn(f32, f32) -> f32) -> Patch {
        let place = |i: u32| ((i % n) as f32, (i / n) as f32);
        let at = (0..n * n).map(place).map(|(x, y)| [x, y, height(x, y)]).collect();
        let square = |i: u32| [[i, i + 1, i + n], [i + 1, i + n + 1, i + n]];
        let faces = (0..n * (n - 1)).filter(|i| i % n < n - 1).flat_map(square).collect();
        Patch { at, faces }
    }

    #[test]
    fn a_flat_sheet_keeps_its_border_and_little_more() {
        let patch = sheet(33, |_, _| 2.0);
        let Fewer { faces, middles, shared } = patch.decimated(Bound { mm: 0.01, voxel_mm: 1.0 });
        let faces = faces.unwrap();
        // No new edge joins two corners of the border.
        let old = edges(&patch.faces);
        let is_border = |corner: u64| usize::try_from(corner).is_ok_and(|at| shared.get(at) == Some(&true));
        let joins = |edge: &Edge| is_border(edge >> 32) && is_border(edge & u64::from(u32::MAX));
        let joined = |edge: &Edge| !joins(edge) || old.binary_search(edge).is_ok();
        assert!(!middles.is_empty() && edges(&faces).iter().all(joined));
        assert_eq!(border(&faces), border(&patch.faces));
        // A polygon of 128 corners has at least 126 triangles.
        assert!((126..600).contains(&faces.len()), "{}", faces.len());
        assert_eq!(shared.iter().filter(|shared| **shared).count(), 128);
    }

    #[test]
    fn a_curved_sheet_stays_within_its_bound() {
        let patch = sheet(33, |x, y| ((x - 16.0).powi(2) + (y - 16.0).powi(2)) / 200.0);
        let counts = [0.3, 0.1, 0.03].map(|mm| {
            let Fewer { faces, middles, .. } = patch.decimated(Bound { mm, voxel_mm: 1.0 });
            let faces = faces.unwrap();
            let mut at = patch.at.clone();
            at.extend(middles.iter().map(|[a, b]| {
                let (a, b) = (patch.at[*a as usize], patch.at[*b as usize]);
                [0, 1, 2].map(|k| f32::midpoint(a[k], b[k]))
            }));
            let mut exact = 0.0_f64;
            for number in 0..patch.at.len() {
                let p = patch.at[number].map(f64::from);
                let distance = |mm: f64| {
                    let corners = faces.iter().map(|f| f.map(|n| at[n as usize].map(f64::from)));
                    Near::new([[0.0; 3], [32.0; 3]], mm, corners).holds(p)
                };
                if !distance(exact) {
                    exact += 0.005;
                    while !distance(exact) {
                        exact += 0.005;
                    }
                }
            }
            assert!(exact <= mm + 0.005, "{exact} of {mm}");
            faces.len()
        });
        assert!(counts.is_sorted() && counts[2] < patch.faces.len() / 2, "{counts:?}");
    }

    #[test]
    fn spikes_that_would_vanish_stay() {
        let patch = sheet(17, |x, y| if (x, y) == (8.0, 8.0) { 3.0 } else { 0.0 });
        let faces = patch.decimated(Bound { mm: 0.2, voxel_mm: 1.0 }).faces.unwrap();
        assert!(
            faces
                .iter()
                .flatten()
                .any(|number| patch.at.get(*number as usize).is_some_and(|at| at[2] == 3.0))
        );
    }

    #[test]
    fn edges_of_three_triangles_are_left_alone() {
        let patch = Patch {
            at: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]],
            faces: vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]],
        };
        let fewer = patch.decimated(Bound { mm: 1.0, voxel_mm: 1.0 });
        assert!(fewer.faces.is_none() && fewer.shared == [true; 5]);
    }
}
