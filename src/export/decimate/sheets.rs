//! A surface in memory, and its repair after edges were collapsed.
//!
//! Where edges are collapsed, sheets come to touch: an edge has four triangles or more, or a corner several fans. Such
//! triangles are paired anew, two for each edge, so that both of a pair bound the same piece of the solid; a corner then
//! becomes one for each fan, and those at one place are moved apart, into the solid.

use std::collections::{HashMap, HashSet};

use super::number;
use crate::export::bodies::root;
use crate::geom::{add_scaled, cross, dot};

/// How often pairs are exchanged, or corners moved.
const ROUNDS: u32 = 64;

/// Part of its body's volume below which a cavity that closed is left out.
const SMALL: f64 = 1e-3;

/// The partner of an edge that has none.
const NONE: u32 = u32::MAX;

/// Corners, and triangles by their numbers.
#[derive(Clone)]
pub(in crate::export) struct Surface {
    pub(in crate::export) at: Vec<[f32; 3]>,
    pub(in crate::export) faces: Vec<[u32; 3]>,
    /// The number that each corner had at first.
    pub(in crate::export) olds: Vec<u32>,
}

/// Numbers in sets, each named by its least number.
struct UnionFind(Vec<u32>);

impl UnionFind {
    fn new(count: usize) -> Self {
        Self((0..).take(count).collect())
    }

    fn join(&mut self, a: u32, b: u32) {
        let [a, b] = [a, b].map(|number| root(&mut self.0, number));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// The set of each number, from 0 on in the order of their names, and how many there are.
    fn numbered(mut self) -> (Vec<u32>, usize) {
        let mut count = 0;
        for number in 0..self.0.len() {
            // The name is less, and so has its number already.
            let name = self.0[number] as usize;
            self.0[number] = if name == number { count } else { self.0[name] };
            count += u32::from(name == number);
        }
        (self.0, count as usize)
    }
}

/// A place as a key: zeros of both signs are one.
fn key_of(at: &[f32; 3]) -> [u32; 3] {
    at.map(|c| (c + 0.0).to_bits())
}

/// The edge of a triangle that follows one: the three of triangle `i` have the numbers from `3 * i` on.
fn next(edge: u32) -> u32 {
    if edge % 3 == 2 { edge - 2 } else { edge + 1 }
}

impl Surface {
    /// The triangles with three places, and the corners that they have, one for each place, in the order in which they have
    /// them.
    pub(in crate::export) fn new(at: Vec<[f32; 3]>, faces: Vec<[u32; 3]>) -> Self {
        let olds = (0..).take(at.len()).collect();
        let mut surface = Self { at, faces, olds };
        let mut firsts = HashMap::new();
        let firsts: Vec<u32> =
            (0..).zip(&surface.at).map(|(corner, at)| *firsts.entry(key_of(at)).or_insert(corner)).collect();
        surface.faces.as_flattened_mut().iter_mut().for_each(|corner| *corner = firsts[*corner as usize]);
        surface.faces.retain(|[a, b, c]| a != b && b != c && c != a);
        surface.compact();
        surface
    }

    pub(super) fn compact(&mut self) {
        let (mut news, mut kept) = (vec![None; self.at.len()], Vec::new());
        for corner in self.faces.as_flattened_mut() {
            let old = *corner;
            *corner = *news[old as usize].get_or_insert_with(|| {
                kept.push(old as usize);
                number(kept.len() - 1)
            });
        }
        self.at = kept.iter().map(|old| self.at[*old]).collect();
        self.olds = kept.iter().map(|old| self.olds[*old]).collect();
    }

    pub(super) fn corners(&self, [a, b, c]: &[u32; 3]) -> [[f64; 3]; 3] {
        [self.place(*a), self.place(*b), self.place(*c)]
    }

    fn place(&self, corner: u32) -> [f64; 3] {
        let [x, y, z] = self.at[corner as usize];
        [x, y, z].map(f64::from)
    }

    /// Twice the area of a triangle, as a vector out of the solid.
    fn normal(&self, face: &[u32; 3]) -> [f64; 3] {
        let [a, b, c] = self.corners(face);
        cross(add_scaled(b, -1.0, a), add_scaled(c, -1.0, a))
    }

    /// The part of each corner, and how many parts there are.
    pub(super) fn parts(&self) -> (Vec<u32>, usize) {
        let mut sets = UnionFind::new(self.at.len());
        for [a, b, c] in &self.faces {
            sets.join(*a, *b);
            sets.join(*b, *c);
        }
        sets.numbered()
    }

    /// Six times the volume that each part encloses; below 0 for a cavity.
    pub(super) fn volumes(&self, parts: &[u32], count: usize) -> Vec<f64> {
        let mut volumes = vec![0.0; count];
        for face in &self.faces {
            let [a, b, c] = self.corners(face).map(|at| add_scaled(at, -1.0, self.place(0)));
            volumes[parts[face[0] as usize] as usize] += dot(a, cross(b, c));
        }
        volumes
    }

    /// Leaves out pieces that came apart from a part and are at most `thick` in the mean, and cavities in it that closed and
    /// are small; returns their corners. `parts`: of the corners by their old numbers. The largest piece of a part stays.
    pub(super) fn drop_fragments(&mut self, parts: &[u32], thick: f64) -> Vec<[f32; 3]> {
        let (pieces, count) = self.parts();
        let volumes = self.volumes(&pieces, count);
        let (mut areas, mut of) = (vec![0.0; count], vec![0; count]);
        for face in &self.faces {
            let (piece, normal) = (pieces[face[0] as usize] as usize, self.normal(face));
            areas[piece] += dot(normal, normal).sqrt();
            of[piece] = parts[self.olds[face[0] as usize] as usize];
        }
        let mut largest = HashMap::new();
        for (part, volume) in of.iter().zip(&volumes) {
            let most = largest.entry(part).or_insert(0.0_f64);
            if volume.abs() > most.abs() {
                *most = *volume;
            }
        }
        // `areas` are of both sides and twice as large, `volumes` six times as large.
        let is_fragment = |piece: usize| {
            let (volume, most) = (volumes[piece], largest[&of[piece]]);
            let is_small = volume * most < 0.0 && volume.abs() < SMALL * most.abs();
            volume.abs() < most.abs() && (is_small || volume.abs() <= 1.5 * areas[piece] * thick)
        };
        let is_fragment: Vec<bool> = (0..count).map(is_fragment).collect();
        self.drop(&pieces, &is_fragment)
    }

    /// Leaves out some pieces, and returns their corners.
    fn drop(&mut self, pieces: &[u32], is_gone: &[bool]) -> Vec<[f32; 3]> {
        let is_left_out = |corner: u32| is_gone[pieces[corner as usize] as usize];
        let corners = (0..).zip(&self.at).filter(|(corner, _)| is_left_out(*corner));
        let places = corners.map(|(_, at)| *at).collect();
        self.faces.retain(|face| !is_left_out(face[0]));
        self.compact();
        places
    }

    /// Leaves out all bodies but the largest, and cavities in them; returns how many bodies, and their corners.
    pub(super) fn keep_body(&mut self) -> (u64, Vec<[f32; 3]>) {
        let (parts, count) = self.parts();
        let volumes = self.volumes(&parts, count);
        let most = volumes.iter().copied().fold(0.0, f64::max);
        let mut gone: HashMap<u32, Vec<[[f64; 3]; 3]>> = HashMap::new();
        for face in &self.faces {
            let part = parts[face[0] as usize];
            if (0.0..most).contains(&volumes[part as usize]) {
                gone.entry(part).or_default().push(self.corners(face));
            }
        }
        let mut is_gone: Vec<bool> = (0_u32..).take(count).map(|part| gone.contains_key(&part)).collect();
        let bodies = gone.len() as u64;
        let boxes: Vec<_> = gone.into_values().map(|faces| (bounds(&faces), faces)).collect();
        let mut corners = vec![None; count];
        (0..).zip(&parts).for_each(|(corner, part)| _ = corners[*part as usize].get_or_insert(corner));
        for (part, corner) in corners.into_iter().enumerate().filter(|(part, _)| volumes[*part] < 0.0) {
            let Some(at) = corner.map(|corner| self.place(corner)) else { continue };
            let is_near = |[low, high]: &[[f64; 3]; 2]| (0..3).all(|a| low[a] <= at[a] && at[a] <= high[a]);
            is_gone[part] = boxes.iter().any(|(bounds, faces)| is_near(bounds) && is_around(faces, at));
        }
        (bodies, self.drop(&parts, &is_gone))
    }

    /// Four corners of each part that lie far apart, and how far the first two do.
    pub(super) fn spans(&self, parts: &[u32], count: usize) -> Vec<(f64, [u32; 4])> {
        let mut spans = vec![(0.0, [0; 4]); count];
        for pick in 0..4 {
            let mut most = vec![f64::NEG_INFINITY; count];
            for (corner, part) in (0..).zip(parts) {
                let (longest, picked) = &mut spans[*part as usize];
                let [a, b, c] = [0, 1, 2].map(|k| self.place(picked[k]));
                let ways = [self.place(corner), b, c].map(|p| add_scaled(p, -1.0, a));
                let apart = match pick {
                    0 => self.place(corner)[0],
                    1 => dot(ways[0], ways[0]).sqrt(),
                    2 => dot(cross(ways[1], ways[0]), cross(ways[1], ways[0])),
                    _ => dot(cross(ways[1], ways[2]), ways[0]).abs(),
                };
                if apart > most[*part as usize] {
                    (most[*part as usize], picked[pick]) = (apart, corner);
                    if pick == 1 {
                        *longest = apart;
                    }
                }
            }
        }
        spans
    }

    /// Gives each edge two triangles, each corner one fan and a place of its own, and each triangle an area; corners move
    /// by some `step`s. True where that succeeds.
    pub(super) fn repair(&mut self, step: f64) -> bool {
        let is_paired = self.unzip();
        self.compact();
        is_paired && !self.faces.is_empty() && self.move_apart(step)
    }

    /// Adds a tetrahedron of four corners of another surface, unless they lie in a plane.
    pub(super) fn add(&mut self, other: &Self, mut corners: [u32; 4]) {
        let [a, b, c, d] = corners;
        let up = add_scaled(other.place(d), -1.0, other.place(a));
        let height = dot(other.normal(&[a, b, c]), up);
        if height == 0.0 {
            return;
        }
        if height > 0.0 {
            corners.swap(0, 1);
        }
        let first = number(self.at.len());
        self.at.extend(corners.map(|corner| other.at[corner as usize]));
        self.olds.extend(corners);
        let faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
        self.faces.extend(faces.map(|face| face.map(|corner| first + corner)));
    }

    /// Removes pairs of triangles that have the same corners and opposite sides.
    pub(super) fn cancel(&mut self) {
        let key = |(number, face): (usize, &[u32; 3])| {
            let mut sorted = *face;
            sorted.sort_unstable();
            let start = face.iter().position(|corner| *corner == sorted[0]).unwrap_or(0);
            (sorted, face[(start + 1) % 3] == sorted[1], number)
        };
        let mut keys: Vec<_> = self.faces.iter().enumerate().map(key).collect();
        keys.sort_unstable();
        let mut gone = HashSet::new();
        for same in keys.chunk_by(|a, b| a.0 == b.0) {
            let (left, right) = same.split_at(same.partition_point(|(_, side, _)| !side));
            left.iter().zip(right).for_each(|(a, b)| gone.extend([a.2, b.2]));
        }
        let mut number = 0..;
        self.faces.retain(|_| number.next().is_none_or(|number| !gone.contains(&number)));
    }

    /// Makes a corner of each fan; true where all edges have two triangles then.
    fn unzip(&mut self) -> bool {
        let (mut partners, crowded) = self.partners();
        let mut is_paired = false;
        let mut fans = Vec::new();
        for _ in 0..ROUNDS {
            let mut sets = UnionFind::new(partners.len());
            for (edge, partner) in (0..).zip(&partners).filter(|(_, partner)| **partner != NONE) {
                sets.join(edge, next(*partner));
                sets.join(next(edge), *partner);
            }
            fans = sets.numbered().0;
            if !exchange(&mut partners, &crowded, &fans) {
                is_paired = true;
                break;
            }
        }
        let mut corners = vec![NONE; fans.len()];
        let mut is_taken = vec![false; self.at.len()];
        for (corner, fan) in self.faces.as_flattened_mut().iter_mut().zip(fans) {
            let new = &mut corners[fan as usize];
            if *new == NONE {
                *new = *corner;
                if std::mem::replace(&mut is_taken[*corner as usize], true) {
                    *new = number(self.at.len());
                    self.at.push(self.at[*corner as usize]);
                    self.olds.push(self.olds[*corner as usize]);
                }
            }
            *corner = *new;
        }
        is_paired
    }

    /// The edge of another triangle with which each edge of a triangle is one, and the edges of more than two triangles.
    fn partners(&self) -> (Vec<u32>, Vec<Vec<u32>>) {
        let corners = self.faces.as_flattened();
        let ends = |edge: u32| [edge, next(edge)].map(|edge| corners[edge as usize]);
        let mut edges: Vec<([u32; 2], u32)> = (0..)
            .take(corners.len())
            .map(|edge| {
                let [a, b] = ends(edge);
                ([a.min(b), a.max(b)], edge)
            })
            .collect();
        edges.sort_unstable();
        let (mut partners, mut crowded) = (vec![NONE; corners.len()], Vec::new());
        for group in edges.chunk_by(|a, b| a.0 == b.0) {
            let mut around: Vec<u32> = group.iter().map(|(_, edge)| *edge).collect();
            if around.len() > 2 {
                self.sort_around(group[0].0, &mut around);
            }
            // Behind a triangle that runs back, the solid begins; it ends at one that runs forth.
            let is_forth = |edge: &u32| ends(*edge)[0] == group[0].0[0];
            let mut open = Vec::new();
            for turn in 0..2 {
                for edge in &around {
                    if !is_forth(edge) && turn == 0 {
                        open.push(*edge);
                    } else if is_forth(edge)
                        && partners[*edge as usize] == NONE
                        && let Some(back) = open.pop()
                    {
                        (partners[*edge as usize], partners[back as usize]) = (back, *edge);
                    }
                }
            }
            around.retain(is_forth);
            if around.len() > 1 {
                crowded.push(around);
            }
        }
        (partners, crowded)
    }

    /// Sorts edges from one corner to another, or back, by the angle of their triangles.
    fn sort_around(&self, [from, to]: [u32; 2], edges: &mut [u32]) {
        let from = self.place(from);
        let axis = add_scaled(self.place(to), -1.0, from);
        let least = (0..3).min_by(|a, b| axis[*a].abs().total_cmp(&axis[*b].abs())).unwrap_or(0);
        let mut other = [0.0; 3];
        other[least] = dot(axis, axis).sqrt();
        let right = cross(axis, other);
        let up = cross(axis, right).map(|c| c / other[least]);
        let angle = |edge: &u32| {
            let apex = self.faces.as_flattened()[next(next(*edge)) as usize];
            let way = add_scaled(self.place(apex), -1.0, from);
            dot(way, up).atan2(dot(way, right))
        };
        edges.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    }

    /// Moves corners at one place apart, and triangles without area until they have one.
    fn move_apart(&mut self, step: f64) -> bool {
        for _ in 0..ROUNDS {
            let steps = self.steps();
            if steps.is_empty() {
                return true;
            }
            let mut ways: HashMap<u32, [f64; 3]> = steps.keys().map(|corner| (*corner, [0.0; 3])).collect();
            for face in &self.faces {
                for corner in face {
                    if let Some(way) = ways.get_mut(corner) {
                        *way = add_scaled(*way, -1.0, self.normal(face));
                    }
                }
            }
            for (corner, mut way) in ways {
                let count = steps[&corner];
                // Normals may cancel each other out.
                way[count as usize % 3] += f64::MIN_POSITIVE;
                let most = way.into_iter().map(f64::abs).fold(0.0, f64::max);
                let way = way.map(|c| c / most);
                let scale = step * f64::from(count) / dot(way, way).sqrt();
                let place = add_scaled(self.place(corner), scale, way);
                #[expect(clippy::cast_possible_truncation, reason = "back to single precision")]
                let place = place.map(|c| c as f32);
                self.at[corner as usize] = place;
            }
        }
        false
    }

    /// How many steps each corner is to move that lies where another does, or at which a triangle has no area.
    fn steps(&self) -> HashMap<u32, u32> {
        let (mut counts, mut steps) = (HashMap::new(), HashMap::new());
        for (corner, at) in (0..).zip(&self.at) {
            let count = counts.entry(key_of(at)).or_insert(0);
            if *count > 0 {
                steps.insert(corner, *count);
            }
            *count += 1;
        }
        for face in &self.faces {
            let normal = self.normal(face);
            if dot(normal, normal) <= 0.0 && !face.iter().any(|corner| steps.contains_key(corner)) {
                let [a, b, c] = self.corners(face);
                let lengths = [[b, c], [c, a], [a, b]].map(|[p, q]| {
                    let way = add_scaled(q, -1.0, p);
                    dot(way, way)
                });
                let apex = (0..3).max_by(|i, j| lengths[*i].total_cmp(&lengths[*j])).unwrap_or(0);
                steps.insert(face[apex], 1);
            }
        }
        steps
    }
}

/// Least and greatest coordinates of triangles.
fn bounds(faces: &[[[f64; 3]; 3]]) -> [[f64; 3]; 2] {
    faces.as_flattened().iter().fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], at| {
        [std::array::from_fn(|a| low[a].min(at[a])), std::array::from_fn(|a| high[a].max(at[a]))]
    })
}

/// True if closed triangles turn around a place: their solid angles (Van Oosterom and Strackee 1983) sum up to 4 pi, else
/// to 0.
fn is_around(faces: &[[[f64; 3]; 3]], at: [f64; 3]) -> bool {
    let half = |face: &[[f64; 3]; 3]| {
        let [a, b, c] = face.map(|corner| add_scaled(corner, -1.0, at));
        let [la, lb, lc] = [a, b, c].map(|way| dot(way, way).sqrt());
        let along = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
        dot(a, cross(b, c)).atan2(along)
    };
    faces.iter().map(half).sum::<f64>().abs() > std::f64::consts::PI
}

/// Exchanges partners at edges that have more than two triangles still, where fans have the same corners at both ends; true
/// if there were any. The fans of both ends come apart by it.
fn exchange(partners: &mut [u32], crowded: &[Vec<u32>], fans: &[u32]) -> bool {
    let (mut is_changed, mut touched) = (false, HashSet::new());
    for edges in crowded {
        let mut firsts = HashMap::new();
        for edge in edges {
            let ends = [*edge, next(*edge)].map(|edge| fans[edge as usize]);
            let first = *firsts.entry(ends).or_insert(*edge);
            if first == *edge {
                continue;
            }
            is_changed = true;
            if ends.iter().any(|end| touched.contains(end)) {
                continue;
            }
            touched.extend(ends);
            let [one, other] = [first, *edge].map(|edge| edge as usize);
            partners.swap(one, other);
            for edge in [one, other] {
                if let Some(back) = partners.get_mut(partners[edge] as usize) {
                    *back = number(edge);
                }
            }
        }
    }
    is_changed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slabs have the corners on their borders twice; these would be moved apart.
    #[test]
    fn corners_at_one_place_are_one_and_triangles_with_two_of_them_go() {
        let places = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let solid: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let mut at: Vec<[f32; 3]> = solid.as_flattened().iter().map(|corner| places[*corner]).collect();
        at[3] = [-0.0; 3];
        let mut faces: Vec<[u32; 3]> = (0..4).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect();
        faces.push([0, 3, 1]);
        let mut surface = Surface::new(at, faces);
        assert_eq!((surface.at.len(), surface.faces.len()), (4, 4));
        let before = surface.at.clone();
        assert!(surface.repair(0.01));
        assert_eq!(surface.at, before);
    }

    #[test]
    fn thin_pieces_and_small_cavities_that_came_apart_are_left_out() {
        let solid: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let mut surface = Surface { at: Vec::new(), faces: Vec::new(), olds: Vec::new() };
        // The part, size and height of tetrahedra; below 0 of a cavity.
        let tetrahedra: [(u32, f32, f32); 6] =
            [(0, 10.0, 10.0), (0, 3.0, 0.01), (0, 3.0, 3.0), (0, 0.5, -0.5), (0, 5.0, -5.0), (1, 3.0, 0.01)];
        for (number, (part, size, height)) in (0_u16..).zip(tetrahedra) {
            let first = u32::try_from(surface.at.len()).unwrap();
            let x = 100.0 * f32::from(number);
            surface.at.extend([[x, 0.0, 0.0], [x + size, 0.0, 0.0], [x, size, 0.0], [x, 0.0, height]]);
            surface.olds.extend([part; 4]);
            surface.faces.extend(solid.map(|face| face.map(|corner| first + corner)));
        }
        let gone = surface.drop_fragments(&[0, 1], 0.02);
        let left: Vec<f32> = surface.at.chunks_exact(4).map(|piece| piece[0][0]).collect();
        assert_eq!((gone.len(), left), (8, vec![0.0, 200.0, 400.0, 500.0]));
    }
}
