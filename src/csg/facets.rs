//! Solids with plane faces: boxes, prisms, and spheres and cylinders of a given number of facets.
//!
//! Faces with more than three corners are cut into fans from their first corner. The fans of a hollow outline overlap,
//! and cancel each other where rows are counted.

use std::f64::consts::PI;

use super::tree::Faces;

pub(super) fn fan(triangles: &mut Vec<[u32; 3]>, face: &[u32]) {
    if let [first, rest @ ..] = face {
        triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
    }
}

fn number(at: usize) -> u32 {
    u32::try_from(at).unwrap_or(u32::MAX)
}

/// Joins rings of corners, each as long as the others, by walls; the first and the last ring are closed.
fn stacked(rings: &[Vec<[f64; 3]>]) -> Faces {
    let count = rings.first().map_or(0, Vec::len);
    let mut faces = Faces::default();
    faces.points.reserve_exact(rings.len() * count);
    faces.triangles.reserve_exact((2 * rings.len() * count).saturating_sub(4));
    for (at, ring) in rings.iter().enumerate() {
        faces.points.extend(ring);
        if at == 0 {
            continue;
        }
        let (below, above) = ((at - 1) * count, at * count);
        for k in 0..count {
            let next = (k + 1) % count;
            let [a, b, c, d] = [below + k, below + next, above + next, above + k].map(number);
            faces.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let bottom: Vec<u32> = (0..count).rev().map(number).collect();
    let last = faces.points.len().saturating_sub(count);
    let top: Vec<u32> = (last..last + count).map(number).collect();
    fan(&mut faces.triangles, &bottom);
    fan(&mut faces.triangles, &top);
    faces
}

fn circle(radius: f64, z: f64, count: usize) -> Vec<[f64; 3]> {
    // Quarter turns are whole numbers, so that they meet neighbouring shapes exactly.
    let turn = |k: usize| match 4 * k {
        0 => (1.0, 0.0),
        n if n == count => (0.0, 1.0),
        n if n == 2 * count => (-1.0, 0.0),
        n if n == 3 * count => (0.0, -1.0),
        _ => {
            let angle = 2.0 * PI * k as f64 / count as f64;
            (angle.cos(), angle.sin())
        }
    };
    (0..count).map(turn).map(|(x, y)| [radius * x, radius * y, z]).collect()
}

pub(super) fn cuboid(low: [f64; 3], high: [f64; 3]) -> Faces {
    let ring =
        |z: f64| vec![[low[0], low[1], z], [high[0], low[1], z], [high[0], high[1], z], [low[0], high[1], z]];
    stacked(&[ring(low[2]), ring(high[2])])
}

/// A cylinder or cone of `sides` sides.
pub(super) fn cylinder(z: [f64; 2], radii: [f64; 2], sides: usize) -> Faces {
    stacked(&[circle(radii[0], z[0], sides), circle(radii[1], z[1], sides)])
}

/// A sphere with half as many rings as sides, the outer ones half a ring from the poles, as in OpenSCAD.
pub(super) fn sphere(radius: f64, sides: usize) -> Faces {
    let rings = sides.div_ceil(2);
    let ring = |at: usize| {
        let polar = PI * (at as f64 + 0.5) / rings as f64;
        circle(radius * polar.sin(), -radius * polar.cos(), sides)
    };
    let rings: Vec<Vec<[f64; 3]>> = (0..rings).map(ring).collect();
    stacked(&rings)
}

/// Outlines between two heights; points from which a ray meets them an odd number of times are inside.
pub(super) fn prism(outlines: &[Vec<[f64; 2]>], z: [f64; 2]) -> Faces {
    let mut all = Faces { odd: true, ..Faces::default() };
    for outline in outlines.iter().filter(|outline| outline.len() >= 3) {
        let ring = |z: f64| outline.iter().map(|[x, y]| [*x, *y, z]).collect();
        let one = stacked(&[ring(z[0]), ring(z[1])]);
        let before = number(all.points.len());
        all.points.reserve_exact(one.points.len());
        all.points.extend(one.points);
        all.triangles.reserve_exact(one.triangles.len());
        all.triangles.extend(one.triangles.iter().map(|t| t.map(|at| at + before)));
    }
    all
}
