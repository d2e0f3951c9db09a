//! Normals of skin voxels, taken from the leaf whose surface makes the voxel skin.
//!
//! A leaf is a candidate if a voxel is inside it and an exposed neighbour is not, or the other way round, and the tree
//! turns to outside when that leaf alone does; without such a leaf, the tree at the neighbour turns to inside when that
//! leaf alone does (two equal spheres). Other leaves of a program do not change this. Of several candidates the one
//! counts whose surface is nearest to the voxel's middle, then the first in the tree. Its normal points out of it where
//! the voxel is inside it, and into it where it was taken away. Voxels that only the wall of the grid makes skin face
//! that wall.
//!
//! Where faces meet in a voxel, its normal is their mean, weighted by the nearness of their planes: taken from one of
//! them only, normals would change from voxel to voxel along an edge. A face that looks back from the nearest one
//! belongs to the other side of a thin wall, and does not count.
//!
//! For a union of balls the candidates of a voxel are all that hold it, whichever exposed neighbour is asked: a single
//! one turns the tree, and several do not turn it alone. Of ten thousand in nearly one place the first few faces count,
//! and the nearest surface; where all of them hold the voxel, that is the surface of one of the innermost.

use super::leaf::Leaf;
use super::place::centre;
use super::program::{self, Step};
use super::sampled::Sampler;
use super::solid::{CsgSolid, Keep, Remainder};
use crate::builder::{Cover, Exposed, SkinSlice, VoxelBox};
use crate::format::{Channel, normal};
use crate::geom::dot;
use crate::mesh::from_faces;
use crate::volume::SourceError;

const BRICK: usize = 32;
/// The six neighbours, as the faces of [`Exposed`].
const FACES: [[i32; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];
/// Distance of a sampled leaf's surface, which it does not state: half a voxel, in lattice steps.
const HALF_A_VOXEL: f64 = 2048.0;
/// Most leaves that are tried together, one bit each; for more, the tree is gone through forwards and backwards.
const AT_ONCE: usize = 63;
/// Leaves next to the voxels of a brick's slice, above which these are described by blocks of `BLOCK` rows and columns,
/// each with the leaves next to it.
const FEW: usize = 2;
/// Balls joined into one body next to a brick's slice, above which only the innermost are looked at, if these are an
/// eighth of them at most.
const MANY_BALLS: usize = 64;
const BLOCK: usize = 8;

/// Buffers of the descriptions, and their results.
pub(super) struct Description {
    codes: Vec<u8>,
    /// The codes by row and column.
    by_place: Vec<u16>,
    /// The rest of the program around the voxels of a slice, and of one of its blocks.
    near: Vec<Step>,
    nearer: Vec<Step>,
    /// State of leaves at the voxel and at its neighbour, true for inside, by their place among the program's leaves.
    here: Vec<bool>,
    leaves: Vec<u32>,
    turned: Vec<u32>,
    /// State of each step.
    marks: Vec<u8>,
    /// The sampled leaf that describes each voxel: its number plus one, or 0 for none.
    sampled: Vec<u32>,
}

/// Most different faces that meet in a voxel.
const MAX_FACES: usize = 8;
/// Faces whose normals have at least this cosine with the nearest one's count along with it.
const WITH_NEAREST: f64 = -0.5;
/// Normals with at least this cosine are of the same face.
const SAME: f64 = 1.0 - 1e-9;

#[derive(Clone, Copy)]
struct Candidates {
    best: Option<Best>,
    /// Unit normals in lattice coordinates, and their weights.
    faces: [([f64; 3], f64); MAX_FACES],
    count: usize,
}

impl Candidates {
    const NONE: Self = Self { best: None, faces: [([0.0; 3], 0.0); MAX_FACES], count: 0 };

    /// Adds a face, `distance` lattice steps from the middle.
    fn note(&mut self, outwards: [f64; 3], distance: f64) {
        let length = dot(outwards, outwards).sqrt();
        let unit = outwards.map(|c| c / length);
        // Faces between a voxel's middle and a neighbour's are nearer than that: weights never jump.
        let reach = unit.iter().map(|c| c.abs()).sum::<f64>();
        let weight = reach - distance / (2.0 * HALF_A_VOXEL);
        if self.count == MAX_FACES {
            return;
        }
        let known = &self.faces[..self.count];
        let is_new = known.iter().all(|(other, _)| dot(*other, unit) < SAME);
        if length.is_normal() && weight > 0.0 && is_new {
            self.faces[self.count] = (unit, weight);
            self.count += 1;
        }
    }

    /// The mean of the faces that meet in the voxel, among them `nearest`.
    fn mean(&self, nearest: [f64; 3]) -> [f64; 3] {
        let along = dot(nearest, nearest).sqrt();
        let mut sum = [0.0; 3];
        for (unit, weight) in &self.faces[..self.count] {
            if dot(*unit, nearest) > WITH_NEAREST * along {
                sum = std::array::from_fn(|k| sum[k] + weight * unit[k]);
            }
        }
        if self.count < 2 || sum == [0.0; 3] { nearest } else { sum }
    }
}

/// A part of the tree: the rest of its program there, and the samplers of its leaves.
#[derive(Clone, Copy)]
struct Around<'s> {
    solid: &'s CsgSolid<'s>,
    steps: &'s [Step],
    samplers: &'s [Sampler<'s>],
    /// The balls of a large union that contain no other ball.
    innermost: Option<&'s [Step]>,
}

impl Around<'_> {
    fn contains(&self, leaf: u32, voxel: [i32; 3]) -> bool {
        match &self.solid.leaves[leaf as usize] {
            Leaf::Sampled(at) => self.samplers[*at as usize].contains(voxel),
            _ => self.solid.contains(leaf, voxel),
        }
    }
}

/// The best candidate so far.
#[derive(Clone, Copy)]
struct Best {
    distance: f64,
    leaf: u32,
    found: Surface,
}

#[derive(Clone, Copy)]
enum Surface {
    /// Normal out of the tree, in lattice coordinates.
    Known([f64; 3]),
    /// The normal of a sampled leaf, and whether the voxel is inside it.
    Sampled(u32, bool),
}

impl Description {
    /// Memory of a description, for these numbers of leaves and steps of box programs.
    pub(super) const fn bytes(leaves: usize, steps: usize) -> u64 {
        (SkinSlice::MAX_VOXELS * 8 + leaves * 11 + steps * 8) as u64
    }

    pub(super) fn new(leaves: usize, steps: usize) -> Self {
        Self {
            codes: Vec::with_capacity(2 * SkinSlice::MAX_VOXELS),
            by_place: vec![0; SkinSlice::MAX_VOXELS],
            near: Vec::with_capacity(steps),
            nearer: Vec::with_capacity(steps),
            here: Vec::with_capacity(leaves),
            leaves: Vec::with_capacity(leaves),
            turned: Vec::with_capacity(leaves),
            marks: Vec::with_capacity(2 * leaves),
            sampled: vec![0; SkinSlice::MAX_VOXELS],
        }
    }

    pub(super) fn codes(&self) -> &[u8] {
        &self.codes
    }

    pub(super) fn describe(
        &mut self,
        skin: &SkinSlice<'_>,
        solid: &CsgSolid<'_>,
        left: Remainder<'_>,
        samplers: &mut [Sampler<'_>],
    ) -> Result<(), SourceError> {
        // Around these voxels often only one leaf matters.
        let (mut near, mut nearer) = (std::mem::take(&mut self.near), std::mem::take(&mut self.nearer));
        let steps = match left {
            Remainder::Steps(steps) => {
                left_around(steps, skin.corner(), [BRICK; 2], solid, Keep::All, &mut near)
            }
            Remainder::Uniform(_) => &[],
        };
        let mut insides = [0_u32; BRICK];
        let mut any_sampled = false;
        let innermost = innermost(steps, skin.corner(), solid, &mut nearer);
        if steps.len() < 2 * FEW || innermost.is_some() {
            let around = Around { solid, steps, samplers, innermost };
            any_sampled = self.describe_block(skin, [0, 0], BRICK, around, &mut insides);
        } else {
            for block in 0..(BRICK / BLOCK).pow(2) {
                let from = [block % (BRICK / BLOCK) * BLOCK, block / (BRICK / BLOCK) * BLOCK];
                if skin.rows()[from[1]..][..BLOCK].iter().all(|row| row & columns(from[0], BLOCK) == 0) {
                    continue;
                }
                let [x, y, z] = skin.corner();
                let [from_x, from_y] = from.map(|at| u32::try_from(at).unwrap_or(0));
                let corner = [x + from_x, y + from_y, z];
                let steps = left_around(steps, corner, [BLOCK; 2], solid, Keep::All, &mut nearer);
                let around = Around { solid, steps, samplers, innermost: None };
                any_sampled |= self.describe_block(skin, from, BLOCK, around, &mut insides);
            }
        }
        (self.near, self.nearer) = (near, nearer);
        self.codes.clear();
        for (row, codes) in skin.rows().iter().zip(self.by_place.chunks_exact(BRICK)) {
            let mut rest = *row;
            while rest != 0 {
                self.codes.extend(codes[rest.trailing_zeros() as usize].to_le_bytes());
                rest &= rest - 1;
            }
        }
        if any_sampled { self.ask_sampled(skin, solid, samplers, &insides) } else { Ok(()) }
    }

    /// The rest of the program around a brick's slice, for finding crossed edges: often one leaf.
    pub(super) fn look<'s>(
        &'s mut self,
        skin: &SkinSlice<'_>,
        solid: &CsgSolid<'_>,
        left: Remainder<'s>,
    ) -> &'s [Step] {
        match left {
            Remainder::Steps(steps) => {
                left_around(steps, skin.corner(), [BRICK; 2], solid, Keep::Outermost, &mut self.near)
            }
            Remainder::Uniform(_) => &[],
        }
    }

    /// Describes the skin voxels of a block of `side` rows and columns; `true` if sampled leaves describe some of them.
    fn describe_block(
        &mut self,
        skin: &SkinSlice<'_>,
        from: [usize; 2],
        side: usize,
        around: Around<'_>,
        insides: &mut [u32; BRICK],
    ) -> bool {
        self.leaves.clear();
        self.leaves
            .extend(around.steps.iter().filter_map(|step| program::leaf_of(*step)).map(|(leaf, _)| leaf));
        let [x0, y0, z] = skin.corner().map(|c| i32::try_from(c).unwrap_or(i32::MAX));
        let mut any_sampled = false;
        for (y, insides) in insides.iter_mut().enumerate().skip(from[1]).take(side) {
            let mut rest = skin.rows()[y] & columns(from[0], side);
            if rest == 0 {
                continue;
            }
            let exposed = skin.exposed(y);
            while rest != 0 {
                let x = rest.trailing_zeros() as usize;
                rest &= rest - 1;
                #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "below 32")]
                let voxel = [x0 + x as i32, y0 + y as i32, z];
                let candidates = self.candidates(voxel, x, &exposed, around);
                let direction = match candidates.best.map(|best| best.found) {
                    Some(Surface::Known(outwards)) => physical(candidates.mean(outwards), around.solid),
                    Some(Surface::Sampled(at, inside)) => {
                        any_sampled = true;
                        self.sampled[BRICK * y + x] = at + 1;
                        *insides |= u32::from(inside) << x;
                        from_faces(&exposed, x)
                    }
                    None => from_faces(&exposed, x),
                };
                self.by_place[BRICK * y + x] = normal::encode(direction);
            }
        }
        any_sampled
    }

    /// The surfaces that make a voxel skin.
    fn candidates(&mut self, voxel: [i32; 3], x: usize, exposed: &Exposed, around: Around<'_>) -> Candidates {
        let dims = around.solid.place.dims.to_array();
        let exists = |p: [i32; 3]| (0..3).all(|k| u32::try_from(p[k]).is_ok_and(|v| v < dims[k]));
        let mut best = Candidates::NONE;
        self.here.clear();
        let mut any_exposed = false;
        for (face, way) in FACES.iter().enumerate() {
            if exposed.faces[face] >> x & 1 == 0 {
                continue;
            }
            any_exposed = true;
            let beside = [voxel[0] + way[0], voxel[1] + way[1], voxel[2] + way[2]];
            if exists(beside) {
                if let Some(innermost) = around.innermost {
                    self.offer_balls(&mut best, voxel, beside, around.solid, innermost);
                    break;
                }
                self.offer(&mut best, voxel, beside, around, true);
            }
        }
        if !any_exposed {
            // Skin may touch the outside with an edge or a corner only.
            for at in (0..27).filter(|at| *at != 13) {
                let beside = [voxel[0] + at % 3 - 1, voxel[1] + at / 3 % 3 - 1, voxel[2] + at / 9 - 1];
                if exists(beside) {
                    self.offer(&mut best, voxel, beside, around, false);
                }
            }
        }
        best
    }

    /// Takes the candidates between a voxel and one neighbour.
    fn offer(
        &mut self,
        best: &mut Candidates,
        voxel: [i32; 3],
        beside: [i32; 3],
        around: Around<'_>,
        is_exposed: bool,
    ) {
        let Around { solid, steps, .. } = around;
        if let [leaf] = self.leaves[..] {
            // A single leaf decides here: where the neighbour is outside, it has turned.
            let inside = program::leaf_of(steps[0]).is_some_and(|(_, negated)| !negated);
            let known = best.best.is_some() && solid.leaves[leaf as usize].has_one_face();
            if !known && (is_exposed || around.contains(leaf, beside) != inside) {
                take(best, leaf, voxel, beside, inside, solid);
            }
            return;
        }
        if self.here.is_empty() {
            self.here.extend(self.leaves.iter().map(|leaf| around.contains(*leaf, voxel)));
        }
        self.turned.clear();
        for (at, leaf) in (0_u32..).zip(&self.leaves) {
            if around.contains(*leaf, beside) != self.here[at as usize] {
                self.turned.push(at);
            }
        }
        // Leaves that turn the tree alone: from their state at the voxel or, if none does, at its neighbour.
        for from_beside in [false, true] {
            let mut any = false;
            if self.turned.len() > AT_ONCE {
                if self.turned_of_many(best, [voxel, beside], around, from_beside) {
                    break;
                }
                continue;
            }
            let value = self.turned_alone(steps, from_beside);
            for (bit, at) in self.turned.iter().enumerate() {
                if (value >> bit & 1 == 1) == from_beside {
                    any = true;
                    let at = *at as usize;
                    take(best, self.leaves[at], voxel, beside, self.here[at], solid);
                }
            }
            if any {
                break;
            }
        }
    }

    /// Takes the balls of a union that contain a voxel with an empty neighbour.
    fn offer_balls(
        &self,
        best: &mut Candidates,
        voxel: [i32; 3],
        beside: [i32; 3],
        solid: &CsgSolid<'_>,
        innermost: &[Step],
    ) {
        let mut rest = self.leaves.iter();
        while best.count < MAX_FACES
            && let Some(leaf) = rest.next()
        {
            if solid.contains(*leaf, voxel) {
                take(best, *leaf, voxel, beside, true, solid);
            }
        }
        // Faces are not taken any more. Nested balls are compared in the grid only.
        let dims = solid.place.dims.to_array();
        let is_amid = (0..3).all(|k| (1..dims[k].max(1) - 1).contains(&voxel[k].cast_unsigned()));
        let leaves = || innermost.iter().filter_map(|step| program::leaf_of(*step)).map(|(leaf, _)| leaf);
        if is_amid && leaves().all(|leaf| solid.contains(leaf, voxel)) {
            leaves().for_each(|leaf| take(best, leaf, voxel, beside, true, solid));
            return;
        }
        let middle = voxel.map(centre);
        for leaf in rest {
            let nearest = best.best.map_or(f64::INFINITY, |best| best.distance);
            if let Leaf::Ball(ball) = &solid.leaves[*leaf as usize]
                && ball.contains_within(middle, nearest)
            {
                take(best, *leaf, voxel, beside, true, solid);
            }
        }
    }

    /// Takes the leaves that turn the tree alone, if they are more than a word has bits; returns `true` if there are
    /// some.
    fn turned_of_many(
        &mut self,
        best: &mut Candidates,
        [voxel, beside]: [[i32; 3]; 2],
        Around { solid, steps, .. }: Around<'_>,
        from_beside: bool,
    ) -> bool {
        let mut next = self.turned.iter().peekable();
        let value = program::turns(
            steps,
            |at| {
                let turns = next.next_if(|turned| **turned as usize == at).is_some();
                self.here[at] != (turns && from_beside)
            },
            &mut self.marks,
        );
        let mut next = self.turned.iter().peekable();
        let leaves = steps.iter().zip(&self.marks).filter(|(step, _)| program::leaf_of(**step).is_some());
        let mut any = false;
        for (at, (_, mark)) in leaves.enumerate() {
            let turns = next.next_if(|turned| **turned as usize == at).is_some();
            if turns && (value != (*mark != 0)) == from_beside {
                any = true;
                take(best, self.leaves[at], voxel, beside, self.here[at], solid);
            }
        }
        any
    }

    /// The tree's value, bit by bit, with one of the turning leaves turned alone; all others are as at the voxel, or as
    /// at its neighbour.
    fn turned_alone(&self, steps: &[Step], from_beside: bool) -> u64 {
        let (mut at, mut next) = (0_usize, 0_usize);
        program::value(steps, |_| {
            let turns = self.turned.get(next).is_some_and(|turned| *turned as usize == at);
            let own = self.here[at] != (turns && from_beside);
            let bit = if turns { 1 << next } else { 0 };
            next += usize::from(turns);
            at += 1;
            bit ^ if own { u64::MAX } else { 0 }
        })
    }

    /// Lets sampled leaves describe their voxels.
    fn ask_sampled(
        &mut self,
        skin: &SkinSlice<'_>,
        solid: &CsgSolid<'_>,
        samplers: &mut [Sampler<'_>],
        insides: &[u32; BRICK],
    ) -> Result<(), SourceError> {
        for (number, sampler) in (1..).zip(samplers.iter_mut()) {
            let mut wanted = [0_u32; BRICK];
            for (y, row) in skin.rows().iter().enumerate() {
                for x in 0..BRICK {
                    if row >> x & 1 == 1 && self.sampled[BRICK * y + x] == number {
                        wanted[y] |= 1 << x;
                    }
                }
            }
            if wanted.iter().all(|row| *row == 0) {
                continue;
            }
            sampler.worker.describe(&skin.only(&wanted))?;
            let mut own = sampler.worker.items(Channel::Normal).as_chunks::<2>().0.iter();
            let gives_outwards = solid.sampled[number as usize - 1].gives_outwards;
            let mut at = 0;
            for (y, row) in skin.rows().iter().enumerate() {
                for x in (0..BRICK).filter(|x| row >> x & 1 == 1) {
                    if wanted[y] >> x & 1 == 1
                        && let Some(code) = own.next()
                    {
                        let turn = gives_outwards && insides[y] >> x & 1 == 0;
                        let code = stored(u16::from_le_bytes(*code), turn, gives_outwards, solid);
                        self.codes[at..at + 2].copy_from_slice(&code.to_le_bytes());
                        self.sampled[BRICK * y + x] = 0;
                    }
                    at += 2;
                }
            }
        }
        self.sampled.fill(0);
        Ok(())
    }
}

/// The stored normal of a sampled leaf's own one.
fn stored(code: u16, turn: bool, is_physical: bool, solid: &CsgSolid<'_>) -> u16 {
    let [a, b, c] = solid.place.spacing_mm;
    if !turn && (is_physical || (a == b && b == c)) {
        return code;
    }
    let sign = if turn { -1.0 } else { 1.0 };
    let direction = normal::decode(code).map(|c| sign * c);
    normal::encode(if is_physical { direction } else { physical(direction.map(f64::from), solid) })
}

/// Offers one leaf's surface.
fn take(
    candidates: &mut Candidates,
    leaf: u32,
    voxel: [i32; 3],
    beside: [i32; 3],
    inside: bool,
    solid: &CsgSolid<'_>,
) {
    let (distance, found) = match &solid.leaves[leaf as usize] {
        Leaf::Sampled(at) => (HALF_A_VOXEL, Surface::Sampled(*at, inside)),
        own => match own.face(voxel, beside, inside) {
            None => return,
            Some(face) => {
                let outwards = if inside { face.outwards } else { face.outwards.map(|c| -c) };
                candidates.note(outwards, face.distance);
                (face.distance, Surface::Known(outwards))
            }
        },
    };
    let is_better = candidates.best.is_none_or(|best| (distance, leaf) < (best.distance, best.leaf));
    if is_better {
        candidates.best = Some(Best { distance, leaf, found });
    }
}

/// A gradient in lattice coordinates as a direction in mm along the axes of the grid.
fn physical(gradient: [f64; 3], solid: &CsgSolid<'_>) -> [f32; 3] {
    let [a, b, c] = solid.place.spacing_mm;
    let scaled =
        if a == b && b == c { gradient } else { [gradient[0] / a, gradient[1] / b, gradient[2] / c] };
    #[expect(clippy::cast_possible_truncation, reason = "a direction in single precision")]
    let direction = scaled.map(|c| c as f32);
    if direction == [0.0; 3] { [0.0, 0.0, 1.0] } else { direction }
}

/// Bits of `count` columns of a row of a brick.
fn columns(from: usize, count: usize) -> u32 {
    u32::MAX >> (BRICK - count) << from
}

/// The rest of a program in some columns and rows of a slice, with one voxel around them.
fn left_around<'p>(
    steps: &'p [Step],
    corner: [u32; 3],
    [columns, rows]: [usize; 2],
    solid: &CsgSolid<'_>,
    keep: Keep,
    out: &'p mut Vec<Step>,
) -> &'p [Step] {
    let dims = solid.place.dims.to_array();
    let side = |k: usize, length: usize| {
        let length = u32::try_from(length).unwrap_or(u32::MAX);
        corner[k].saturating_sub(1)..(corner[k] + length + 1).min(dims[k])
    };
    let around = VoxelBox { x: side(0, columns), y: side(1, rows), z: side(2, 1) };
    match solid.prune(steps, &around, keep, out) {
        Some(Cover::Mixed) => out,
        Some(_) => &[],
        None => steps,
    }
}

/// The balls of a large union next to a brick's slice that contain no other ball; `None` where they are few,
/// or nearly all would be left.
fn innermost<'p>(
    steps: &'p [Step],
    corner: [u32; 3],
    solid: &CsgSolid<'_>,
    out: &'p mut Vec<Step>,
) -> Option<&'p [Step]> {
    let is_ball = |step: &Step| {
        program::leaf_of(*step).is_none_or(|(leaf, _)| matches!(solid.leaves[leaf as usize], Leaf::Ball(_)))
    };
    if steps.len() < 2 * MANY_BALLS || !program::is_union(steps) || !steps.iter().all(is_ball) {
        return None;
    }
    let innermost = left_around(steps, corner, [BRICK; 2], solid, Keep::Innermost, out);
    (!innermost.is_empty() && 8 * innermost.len() <= steps.len()).then_some(innermost)
}
