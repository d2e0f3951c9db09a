//! Visibility from a viewpoint: boxes of the surface that rays from there never reach are dropped.
//!
//! ```text
//!   solid --bits--> occupancy (scratch file) --sweeps--> boxes that can be seen (scratch file) --AND--> skin, cells
//! ```
//!
//! Rays are followed box by box. Along each axis a ray goes up, down or not at all: so there are eight ways, and a box
//! that a ray of one way enters has its previous box next to it, on the side that the ray comes from. Each way is one
//! sweep over the occupancy ([`mod@row`] has the rule). The result never lacks a box: every box that a straight ray
//! meets first is kept, and so are some that only a bent one would meet. Voxels that share an edge or a corner do not
//! stop a ray.
//!
//! Memory: [`sweep::Pass::bytes`] for each way, for volumes of any size. Scratch: two bits a voxel, with two
//! workers three. Cost: the volume is read once more; a sweep goes through some 10^9 voxels a second.

mod row;
mod sweep;

use std::fmt;

use super::bits::BitVolume;
use super::error::BuildError;
use crate::geom::{Affine, Dims};
use crate::progress::Progress;
use sweep::{Pass, SweepDirection};

/// Viewpoint of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewedFrom {
    /// Anywhere beyond the box of the volume.
    Outside,
    /// A parallel view along this world direction, from beyond the box.
    Along([f64; 3]),
    /// A point in world millimetres.
    Point([f64; 3]),
}

impl fmt::Display for ViewedFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Outside => f.write_str("outside"),
            Self::Along([x, y, z]) => write!(f, "along:{x},{y},{z}"),
            Self::Point([x, y, z]) => write!(f, "{x},{y},{z}"),
        }
    }
}

/// Ratio to its largest component below which a component of a direction counts as zero, as for the rays of pictures.
const NOTHING: f64 = 1.0 / 4_294_967_296.0;

/// The ways of all rays from these viewpoints, through a grid of boxes of this size.
///
/// `boxes_from_world` maps a world position to a fractional box position: box i is `i .. i + 1`.
fn ways(from: &[ViewedFrom], boxes_from_world: &Affine, dims: Dims) -> Vec<SweepDirection> {
    let sides = dims.to_array();
    let mut all = Vec::new();
    let mut add = |way: SweepDirection| {
        if way.meets(sides) && !all.contains(&way) {
            all.push(way);
        }
    };
    let corners = || (0..8_u32).map(|c| [c & 1 == 1, c & 2 == 2, c & 4 == 4]);
    for place in from {
        match place {
            ViewedFrom::Outside => {
                corners().for_each(|back| {
                    add(SweepDirection { moves: [true; 3], back, eye: None, within: false })
                });
            }
            ViewedFrom::Along(direction) => {
                let along = boxes_from_world.apply_vector(*direction);
                let largest = along.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
                let moves = along.map(|c| c.abs() > NOTHING * largest);
                let back = [0, 1, 2].map(|a| moves[a] && along[a] < 0.0);
                add(SweepDirection { moves, back, eye: None, within: false });
            }
            ViewedFrom::Point(point) => {
                // Far positions outside are clamped.
                let eye = [0, 1, 2].map(|a| {
                    let at = boxes_from_world.apply(*point)[a].floor();
                    #[expect(clippy::cast_possible_truncation, reason = "clamped before")]
                    let at = at.clamp(-4.0, f64::from(sides[a]) + 4.0) as i64;
                    at
                });
                let within = (0..3).all(|a| (0..i64::from(sides[a])).contains(&eye[a]));
                corners()
                    .for_each(|back| add(SweepDirection { moves: [true; 3], back, eye: Some(eye), within }));
            }
        }
    }
    all
}

pub(super) struct Search<'a> {
    pub(super) occupancy: &'a BitVolume,
    pub(super) is_cells: bool,
    ways: Vec<SweepDirection>,
}

impl<'a> Search<'a> {
    /// A search in a grid whose affine maps the centres of voxels.
    pub(super) fn new(from: &[ViewedFrom], voxels: Affine, is_cells: bool, occupancy: &'a BitVolume) -> Self {
        // Voxel i is box i; its centre is the centre of its box, or for cells the point where cells i and i + 1 meet.
        let shift = if is_cells { 1.0 } else { 0.5 };
        let ways = match voxels.inverse() {
            Some(mut inverse) => {
                inverse.rows.iter_mut().for_each(|row| row[3] += shift);
                ways(from, &inverse, occupancy.dims())
            }
            // Without world positions, from everywhere.
            None => ways(&[ViewedFrom::Outside], &Affine::from_spacing([1.0; 3]), occupancy.dims()),
        };
        Self { occupancy, is_cells, ways }
    }

    /// The ways up the slices, or down; ways of a group can be followed at the same time.
    fn group(&self, back: bool) -> impl Iterator<Item = SweepDirection> {
        self.ways.iter().copied().filter(move |way| way.back[2] == back)
    }

    /// Memory for following a group.
    pub(super) fn group_bytes(&self) -> u64 {
        let most = [false, true].map(|back| self.group(back).count()).into_iter().max().unwrap_or(0);
        let dims = self.occupancy.dims();
        most as u64 * Pass::bytes(self.occupancy.row_words, dims.ny())
    }

    /// True if the eye of a way lies in the solid; its rays then meet the surface from within.
    fn is_in_solid(&self, way: &SweepDirection) -> Result<bool, BuildError> {
        let Some(eye) = way.eye.filter(|_| way.within) else { return Ok(false) };
        let dims = self.occupancy.dims().to_array();
        // Cell i lies between samples i - 1 and i.
        let before = i64::from(self.is_cells);
        for corner in 0..8_i64 {
            let at = [0, 1, 2].map(|a| eye[a] - before * (corner >> a & 1));
            let [Ok(x), Ok(y), Ok(z)] = at.map(u32::try_from) else { return Ok(false) };
            if x >= dims[0] || y >= dims[1] || z >= dims[2] {
                return Ok(false);
            }
            let mut word = [0];
            let row = self.occupancy.row(y, z);
            self.occupancy.read(row, x as usize / 64, &mut word).map_err(|e| self.occupancy.failed(e))?;
            if word[0] >> (x % 64) & 1 == 0 {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Follows the ways of a group, and sets the boxes that can be seen: all boxes if the eye is within the solid.
    pub(super) fn follow(
        &self,
        back: bool,
        seen: &BitVolume,
        progress: &dyn Progress,
    ) -> Result<(), BuildError> {
        let ways: Vec<SweepDirection> = self.group(back).collect();
        let dims = self.occupancy.dims();
        let Some(slots) = u32::try_from(ways.len()).ok().and_then(|n| Dims::new(dims.nx(), dims.ny(), n))
        else {
            return Ok(());
        };
        for way in &ways {
            if self.is_in_solid(way)? {
                let row = vec![u64::MAX; seen.row_words];
                return (0..seen.rows()).try_for_each(|number| seen.write(number, 0, &row));
            }
        }
        let slices = BitVolume::create(seen.folder(), slots)?;
        let pass = |(slot, way)| Pass::new(way, self.occupancy, self.is_cells, (&slices, slot), seen);
        let mut passes: Vec<Pass<'_>> = (0..).zip(ways).map(pass).collect();
        for z in 0..dims.nz() {
            let z = if back { dims.nz() - 1 - z } else { z };
            passes.iter_mut().try_for_each(|pass| pass.slice(z))?;
            progress.step(1)?;
        }
        Ok(())
    }
}

pub(super) fn join(all: &BitVolume, more: &BitVolume) -> Result<(), BuildError> {
    let width = all.row_words;
    let at_once = (JOIN_BYTES / 8 / width).max(1);
    let (mut a, mut b) = (vec![0; at_once * width], vec![0; at_once * width]);
    let mut row = 0;
    while row < all.rows() {
        let count = (at_once as u64).min(all.rows() - row);
        let len = usize::try_from(count).unwrap_or(0) * width;
        all.read(row, 0, &mut a[..len])
            .and_then(|()| more.read(row, 0, &mut b[..len]))
            .map_err(|e| all.failed(e))?;
        a[..len].iter_mut().zip(&b).for_each(|(a, b)| *a |= b);
        all.write(row, 0, &a[..len])?;
        row += count;
    }
    Ok(())
}

/// Bytes of rows that are joined at a time.
const JOIN_BYTES: usize = 16 << 10;

#[cfg(test)]
mod tests;
