//! Triangles in memory: polyhedra, prisms, facetted spheres, boxes at an angle.
//!
//! Exact like meshes: rows cross triangles in whole numbers, voxel middles moved by (-e, e^2, e^3).

use super::near::Near;
use super::{Face, Rows};
use crate::builder::{Cover, VoxelBox};
use crate::csg::fault::{At, bad_size, too_far};
use crate::csg::place::{centre, point};
use crate::csg::tree::Faces;
use crate::fault::{Fault, bad};
use crate::geom::{Affine, cross, dot};
use crate::mesh::{
    Closed, Crossings, EdgeParity, Facet, Nearest, Rule, STEPS, Triangle, cross_slice, smallest_first, span,
};

/// Squared distance from a voxel within which its nearest triangle is sought: two voxels.
const NEAR: f64 = 4.0 * (STEPS as f64) * (STEPS as f64) + 1.0;

/// Fewest triangles of a body that goes through bins.
pub(in crate::csg) const BINNED: usize = 256;

#[derive(Debug)]
pub(in crate::csg) struct Body {
    triangles: Vec<Triangle>,
    near: Near,
    rule: Rule,
    low: [i32; 3],
    high: [i32; 3],
}

/// The rule of a closed surface.
///
/// # Errors
/// The surface is open.
fn closed(census: &EdgeParity, odd: bool, line: u64) -> Result<Rule, Fault> {
    match census.closed() {
        Closed::No => Err(bad!(
            "{}the faces of the polyhedron leave holes; close it, or write it as a mesh and import that",
            At(line)
        )),
        Closed::Mixed => Ok(Rule::Odd),
        Closed::Oriented => Ok(if odd { Rule::Odd } else { Rule::NonZero }),
    }
}

impl Body {
    /// # Errors
    /// The surface is open, or reaches beyond the lattice.
    pub(in crate::csg) fn new(faces: &Faces, to_lattice: &Affine, line: u64) -> Result<Self, Fault> {
        let mut points = Vec::with_capacity(faces.points.len());
        for p in &faces.points {
            points.push(point(to_lattice.apply(*p), line)?);
        }
        Self::of_points(&points, faces, line)
    }

    /// The triangles of faces whose corners have been placed.
    ///
    /// # Errors
    /// The surface is open, or reaches beyond the lattice.
    pub(super) fn of_points(points: &[[i64; 3]], faces: &Faces, line: u64) -> Result<Self, Fault> {
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        let mut placed = Vec::with_capacity(points.len());
        for p in points {
            let mut narrow = [0; 3];
            for k in 0..3 {
                let far = |_| too_far(line);
                narrow[k] = i32::try_from(p[k]).ok().filter(|c| c.abs() < 1 << 29).ok_or(()).map_err(far)?;
                low[k] = low[k].min(narrow[k]);
                high[k] = high[k].max(narrow[k]);
            }
            placed.push(narrow);
        }
        let mut census = EdgeParity::default();
        let mut triangles = Vec::with_capacity(faces.triangles.len());
        for [a, b, c] in &faces.triangles {
            let corner = |at: &u32| placed.get(*at as usize).copied().ok_or(bad_size(line));
            let t = smallest_first([corner(a)?, corner(b)?, corner(c)?]);
            census.add(&t);
            triangles.push(t);
        }
        let rule = closed(&census, faces.odd, line)?;
        let near = Near::new(&triangles, low, high);
        Ok(Self { triangles, near, rule, low, high })
    }

    /// Calls `each` with every triangle that may reach within `around` steps of places between two middles.
    pub(super) fn each_near(&self, [a, b]: [[i32; 3]; 2], around: i64, mut each: impl FnMut(&Triangle)) {
        let region = std::array::from_fn(|k| (centre(a[k]) - around, centre(b[k]) + around));
        self.near.each(&self.triangles, region, &mut each);
    }

    /// Calls `each` with every triangle that rows of a slice may cross up to a column.
    fn each_before(&self, column: i64, [from, to]: [i32; 2], z: i32, mut each: impl FnMut(&Triangle)) {
        let columns = (i64::from(self.low[0]), column * i64::from(STEPS) + i64::from(STEPS));
        let region = [columns, (centre(from) - 1, centre(to) + 1), (centre(z), centre(z))];
        self.near.each(&self.triangles, region, |t| {
            if is_met(t, z) {
                each(t);
            }
        });
    }

    /// True if it may go through the bins of a mesh.
    pub(in crate::csg) fn is_large(&self) -> bool {
        self.triangles.len() >= BINNED
    }

    pub(in crate::csg) fn surface(&self) -> (&[Triangle], Rule) {
        (&self.triangles, self.rule)
    }

    pub(super) fn bounds(&self) -> [[i32; 3]; 2] {
        [self.low, self.high]
    }

    pub(super) fn held_bytes(&self) -> usize {
        self.triangles.capacity() * size_of::<Triangle>() + self.near.held_bytes()
    }

    pub(super) fn cover(&self, region: &VoxelBox) -> Cover {
        let middles = super::middles(region);
        let apart = |k: usize| middles[k].0 > self.high[k].into() || middles[k].1 < self.low[k].into();
        if (0..3).any(apart) {
            return Cover::Outside;
        }
        let mut meets = false;
        // The shift of a middle that lies on a surface may lead a step further.
        let around = middles.map(|(low, high)| (low - 1, high + 1));
        self.near.each(&self.triangles, around, |t| meets = meets || may_meet(t, &middles));
        if meets {
            return Cover::Mixed;
        }
        let corner = [region.x.start, region.y.start, region.z.start];
        let inside = self.contains(corner.map(|c| i32::try_from(c).unwrap_or(i32::MAX)));
        if inside { Cover::Inside } else { Cover::Outside }
    }

    pub(super) fn fill(&self, at: Rows, out: &mut [u64], crossings: &mut Crossings) {
        let rows = i32::try_from(out.len()).unwrap_or(0);
        let first = i64::from(at.x);
        self.each_before(first + 63, [at.y, at.y + rows - 1], at.z, |t| {
            cross_slice(t, at.z, at.y, at.y + rows, &mut |row, column, sign| {
                crossings.add((row - at.y) as usize, column - first, sign);
            });
        });
        crossings.settle(self.rule);
        for (row, word) in out.iter_mut().enumerate() {
            *word = crossings.row(row)[0];
        }
    }

    pub(super) fn contains(&self, [x, y, z]: [i32; 3]) -> bool {
        let mut sum = 0_i64;
        self.each_before(x.into(), [y, y], z, |t| {
            cross_slice(t, z, y, y + 1, &mut |_, column, sign| {
                sum += if column <= i64::from(x) { i64::from(sign) } else { 0 };
            });
        });
        if self.rule == Rule::Odd { sum % 2 != 0 } else { sum != 0 }
    }

    /// The triangle between two middles; where they are not neighbours along an axis, or none is found there, the
    /// nearest one, as for the skin of a mesh.
    #[expect(clippy::cast_precision_loss, reason = "below 2^31")]
    pub(super) fn face(&self, voxel: [i32; 3], beside: [i32; 3], is_inside: bool) -> Option<Face> {
        if let Some(face) = self.crossed(voxel, beside) {
            return Some(face);
        }
        let p = voxel.map(|c| centre(c) as f64);
        let mut best = Nearest::within(NEAR);
        self.each_near([voxel; 2], i64::from(2 * STEPS), |t| {
            if let Some(facet) = Facet::new(t) {
                best.offer(&facet, p);
            }
        });
        if !best.found() {
            return None;
        }
        let towards = best.normal.map(f64::from);
        // From a voxel outside, the way to the triangle leads inwards.
        let outwards = if is_inside { towards } else { towards.map(|c| -c) };
        Some(Face { outwards, distance: best.distance() })
    }

    /// The face between two neighbours along an axis, and the distance of its plane from the first.
    fn crossed(&self, voxel: [i32; 3], beside: [i32; 3]) -> Option<Face> {
        let mut differ = (0..3).filter(|k| voxel[*k] != beside[*k]);
        let (axis, None) = (differ.next()?, differ.next()) else { return None };
        let low = if voxel[axis] < beside[axis] { voxel } else { beside };
        let found = super::cross::of_body(self, low, axis, self.contains(low))?;
        let away = if low == voxel { found.along } else { 1.0 - found.along };
        let length = dot(found.normal, found.normal).sqrt();
        let distance = away * f64::from(STEPS) * (found.normal[axis] / length).abs();
        Some(Face { outwards: found.normal, distance })
    }
}

/// True if the middles of a slice lie between the ends of a triangle.
#[inline]
fn is_met(t: &Triangle, z: i32) -> bool {
    let (low, high) = span(t, 2);
    (i64::from(low)..=i64::from(high)).contains(&centre(z))
}

/// True if a triangle may meet a box; false only if it does not.
#[expect(clippy::cast_precision_loss, reason = "below 2^31")]
fn may_meet(t: &Triangle, region: &[(i64, i64); 3]) -> bool {
    let beyond = |k: usize| {
        let (low, high) = span(t, k);
        // The shift of a middle that lies on a surface may lead a step further.
        i64::from(low) > region[k].1 + 1 || i64::from(high) < region[k].0 - 1
    };
    if (0..3).any(beyond) {
        return false;
    }
    let f = t.map(f64::from);
    let way = |at: usize| [0, 1, 2].map(|k| f[at + k] - f[k]);
    let (b, c) = (way(3), way(6));
    let middle = [0, 1, 2].map(|k| (region[k].0 + region[k].1) as f64 / 2.0 - f[k]);
    let half = [0, 1, 2].map(|k| (region[k].1 - region[k].0) as f64 / 2.0 + 2.0);
    let apart = |along: [f64; 3]| {
        let size = along.map(f64::abs);
        let ends = [dot(along, b), dot(along, c)];
        // Rounding of products of 2^60 and 2^31: far below one part of a million of their sum.
        let sum = [0, 1, 2].map(|k| middle[k].abs() + b[k].abs() + c[k].abs());
        let (at, reach) = (dot(along, middle), dot(size, half) + 1e-9 * dot(size, sum));
        at - reach > ends[0].max(ends[1]).max(0.0) || at + reach < ends[0].min(ends[1]).min(0.0)
    };
    // The planes of tilted strips around a tube leave no box beside it, but their long edges do.
    let across = |[x, y, z]: [f64; 3]| [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]];
    let edges = [b, c, [0, 1, 2].map(|k| c[k] - b[k])];
    !apart(cross(b, c)) && !edges.into_iter().flat_map(across).any(apart)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::csg::facets;

    /// Boxes beside a tilted tube are no part of its surface, though the planes of its strips meet them.
    #[test]
    fn few_boxes_meet_a_tilted_tube() {
        const SIDE: u32 = 8;
        let outline: Vec<[f64; 2]> = (0..100)
            .map(|at| f64::from(at) * std::f64::consts::TAU / 100.0)
            .map(|a| [a.cos(), a.sin()])
            .collect();
        let axes = [[3.0, -2.0, 25.0, 32.0], [1.0, 3.5, 27.0, 30.0], [-2.0, -1.0, 29.0, 31.0]];
        let rows = axes.map(|row| row.map(|c| c * f64::from(STEPS)));
        let tube = Body::new(&facets::prism(&[outline], [-1.0, 1.0]), &Affine { rows }, 1).unwrap();
        let (mut met, mut apart) = (0, 0);
        for at in 0..512 {
            let corner = [at % 8, at / 8 % 8, at / 64].map(|c| c * SIDE);
            let [x, y, z] = corner.map(|c| c..c + SIDE);
            let cover = tube.cover(&VoxelBox { x: x.clone(), y: y.clone(), z: z.clone() });
            if cover == Cover::Mixed {
                met += 1;
                continue;
            }
            apart += 1;
            for place in z.flat_map(|z| y.clone().map(move |y| [y, z])) {
                for x in x.clone() {
                    let voxel = [x, place[0], place[1]].map(u32::cast_signed);
                    assert_eq!(tube.contains(voxel), cover == Cover::Inside, "{voxel:?}");
                }
            }
        }
        assert!(met > 10 && met < 60, "{met} of {}", met + apart);
    }
}
