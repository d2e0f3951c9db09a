//! The walls of a cell between labels as polygons.

use super::cell::Plane;
use super::walls::Walls;
use crate::geom::dot;

/// The labels behind and in front of a wall, and its polygon in the cell's own coordinates, -1 to 1.
pub(crate) type Face = ([u16; 2], Vec<[f64; 3]>);

impl Walls {
    /// Corners of the part of a cell that has such labels, in its own coordinates.
    pub(crate) fn labelled(&self, faces: &[Face], is_such: impl Fn(u16) -> bool) -> Vec<[f64; 3]> {
        let corners = (0..8).filter(|corner| is_such(self.corner(*corner)));
        let at = |corner: usize| std::array::from_fn(|a| if corner >> a & 1 == 1 { 1.0 } else { -1.0 });
        let ends = faces.iter().filter(|([one, other], _)| is_such(*one) != is_such(*other));
        let ends = ends.flat_map(|(_, face)| face);
        corners.map(at).chain(ends.copied()).collect()
    }

    /// The walls of a cell: the labels behind and in front, and the polygon in the cell's own coordinates.
    pub(crate) fn faces(&self) -> Vec<Face> {
        let planes = self.planes();
        let mut found = Vec::new();
        for (i, plane) in planes.iter().enumerate() {
            // The other planes cut it into parts.
            for others in (0..1_usize << planes.len()).filter(|bits| bits >> i & 1 == 0) {
                let labels = [others, others | 1 << i].map(|fronts| self.label(fronts));
                if labels[0] == labels[1] {
                    continue;
                }
                let mut face = square(plane);
                for (j, other) in planes.iter().enumerate().filter(|(j, _)| *j != i) {
                    face = clipped(&face, other, others >> j & 1 == 1);
                }
                for side in [0, 1, 2, 3, 4, 5] {
                    let mut normal = [0; 3];
                    normal[side / 2] = if side % 2 == 0 { 1 } else { -1 };
                    face = clipped(&face, &Plane { normal, offset: 1 }, false);
                }
                found.push((labels, face));
            }
        }
        found
    }
}

/// A part of a plane that covers the cell.
fn square(plane: &Plane) -> Vec<[f64; 3]> {
    let n = plane.normal.map(f64::from);
    let longest = (0..3).fold(0, |best, a| if n[a].abs() > n[best].abs() { a } else { best });
    let (u, v) = ((longest + 1) % 3, (longest + 2) % 3);
    let corner = |[p, q]: [f64; 2]| {
        let mut at = [0.0; 3];
        (at[u], at[v]) = (p, q);
        at[longest] = (f64::from(plane.offset) - n[u] * p - n[v] * q) / n[longest];
        at
    };
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner).to_vec()
}

/// The part of a polygon behind a plane, or in front of it (Sutherland and Hodgman 1974).
fn clipped(face: &[[f64; 3]], plane: &Plane, front: bool) -> Vec<[f64; 3]> {
    let sign = if front { 1.0 } else { -1.0 };
    let kept = |at: &[f64; 3]| sign * (dot(plane.normal.map(f64::from), *at) - f64::from(plane.offset));
    let mut left = Vec::with_capacity(face.len() + 1);
    for (at, next) in face.iter().zip(face.iter().cycle().skip(1)) {
        let (here, there) = (kept(at), kept(next));
        if here >= 0.0 {
            left.push(*at);
        }
        if (here >= 0.0) != (there >= 0.0) {
            let t = here / (here - there);
            left.push(std::array::from_fn(|a| at[a] + t * (next[a] - at[a])));
        }
    }
    left
}
