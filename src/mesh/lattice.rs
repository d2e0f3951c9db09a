//! The lattice on which everything about a mesh is decided: 2^-12 voxel, whole numbers.
//!
//! ```text
//!   model units --x unit--> mm --(x - origin) / voxel--> voxels --x 4096, rounded once--> i32
//! ```
//!
//! Voxel i spans `[4096 i, 4096 (i + 1))` along each axis; its centre is at `4096 i + 2048`. After the one rounding
//! all decisions are made in integers, so that they do not depend on order, memory or threads.

use crate::fault::{Fault, FaultKind, bad};
use crate::geom::{Affine, Dims};
use crate::text::Short;
use crate::text::names::{GRID, VOXEL};

/// Lattice steps of a voxel.
pub(crate) const STEPS: i32 = 1 << 12;
/// Steps from the corner of a voxel to its centre.
pub(super) const HALF: i32 = STEPS / 2;
/// Coordinates beyond this are refused: products of two differences, and sums of two products, stay within i64.
const LIMIT: f64 = (1 << 29) as f64;
/// Most voxels of a coordinate from the grid's corner.
pub(crate) const MAX_VOXELS: u64 = 1 << 17;
/// 1.5 x 2^52: added and taken away again, it rounds to a whole number, halves to the even one.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// A triangle on the lattice: x, y, z of its three vertices, the smallest first.
pub(crate) type Triangle = [i32; 9];

/// Fineness and position of a grid.
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GridChoice {
    /// A number of voxels along the longest side of the mesh, margins included.
    Side {
        /// Voxels.
        voxels: u32,
        /// Voxels left free at every side.
        margin: u32,
    },
    /// Voxels of a given edge around the mesh.
    Voxel {
        /// Edge in mm.
        edge_mm: f64,
        /// Voxels left free at every side.
        margin: u32,
    },
    /// The grid in full: nothing is moved or scaled.
    Exact {
        /// Edge in mm.
        edge_mm: f64,
        /// Low corner of voxel (0, 0, 0) in mm.
        origin_mm: [f64; 3],
        /// Size in voxels.
        dims: Dims,
    },
}

impl GridChoice {
    /// Default: fine enough that a picture of usual size shows no steps.
    pub(crate) const USUAL: Self = Self::Side { voxels: 512, margin: 1 };
}

/// Lowest and highest coordinates, in units of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) low: [f64; 3],
    pub(crate) high: [f64; 3],
}

impl Bounds {
    pub(crate) const EMPTY: Self = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    #[inline]
    pub(crate) fn add(&mut self, point: [f64; 3]) {
        for ((low, high), c) in self.low.iter_mut().zip(&mut self.high).zip(point) {
            *low = if c < *low { c } else { *low };
            *high = if c > *high { c } else { *high };
        }
    }

    fn extent(&self) -> f64 {
        (0..3).map(|a| self.high[a] - self.low[a]).fold(0.0, f64::max)
    }
}

/// A grid in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Size in voxels.
    pub dims: Dims,
    /// Edge of a voxel in mm.
    pub voxel_mm: f64,
    /// Low corner of voxel (0, 0, 0) in mm.
    pub origin_mm: [f64; 3],
    /// Lattice steps of a unit of the file, and of the corner.
    scale: f64,
    shift: [f64; 3],
}

/// Longest side of a grid.
const MAX_SIDE: f64 = 16384.0;

/// The fault of a grid of a side of so many voxels.
fn too_long(voxels: f64) -> Fault {
    Fault::new(
        FaultKind::LongGrid,
        format!("its grid would be {voxels} voxels long; choose 1 to 16384 with {GRID} or {VOXEL}"),
    )
}

impl Grid {
    /// The grid of a choice around a mesh of these bounds, in units of `unit_mm` mm.
    ///
    /// # Errors
    /// The mesh is a point, or the grid would be too large.
    pub(crate) fn new(choice: GridChoice, bounds: &Bounds, unit_mm: f64) -> Result<Self, Fault> {
        if let GridChoice::Exact { edge_mm, origin_mm, dims } = choice {
            return Self::checked(dims, edge_mm, origin_mm, unit_mm);
        }
        let extent_mm = bounds.extent() * unit_mm;
        if extent_mm.is_infinite() {
            return Err(bad!(
                "is {} mm long with its grid; voxels are 1e-15 to 1e15 mm long: scale it, or give the unit of its numbers",
                Short(f64::MAX)
            ));
        }
        if extent_mm <= 0.0 || extent_mm.is_nan() {
            return Err(bad!("lies in one point; give a mesh with an extent"));
        }
        let (edge_mm, margin) = match choice {
            GridChoice::Side { voxels, margin } => {
                let within = f64::from(voxels) - 2.0 * f64::from(margin);
                (extent_mm / within.max(1.0), margin)
            }
            GridChoice::Voxel { edge_mm, margin } => (edge_mm, margin),
            GridChoice::Exact { edge_mm, .. } => (edge_mm, 0),
        };
        let mut sides = [0; 3];
        let mut origin_mm = [0.0; 3];
        for axis in 0..3 {
            let length = (bounds.high[axis] - bounds.low[axis]) * unit_mm;
            // A side that divides evenly but for rounding does not get a voxel more.
            let voxels = (length / edge_mm - 1e-9).ceil().max(1.0) + 2.0 * f64::from(margin);
            if voxels > MAX_SIDE || voxels.is_nan() {
                return Err(too_long(voxels));
            }
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked above")]
            let side = voxels as u32;
            sides[axis] = side;
            let middle = (bounds.high[axis] / 2.0 + bounds.low[axis] / 2.0) * unit_mm;
            origin_mm[axis] = middle - voxels / 2.0 * edge_mm;
        }
        let dims = Dims::new(sides[0], sides[1], sides[2]).ok_or_else(|| too_long(MAX_SIDE))?;
        Self::checked(dims, edge_mm, origin_mm, unit_mm)
    }

    fn checked(dims: Dims, voxel_mm: f64, origin_mm: [f64; 3], unit_mm: f64) -> Result<Self, Fault> {
        let side = dims.to_array().into_iter().max().map_or(0.0, f64::from);
        let scale = unit_mm / voxel_mm * f64::from(STEPS);
        let shift = origin_mm.map(|o| o / voxel_mm * f64::from(STEPS));
        let sound = scale.is_finite() && scale > 0.0 && shift.iter().all(|s| s.is_finite());
        if side > MAX_SIDE || !sound {
            return Err(too_long(side));
        }
        if Affine::from_spacing([voxel_mm; 3]).inverse().is_none() {
            return Err(bad!(
                "is {} mm long with its grid; voxels are 1e-15 to 1e15 mm long: scale it, or give the unit of its numbers",
                Short(side * voxel_mm)
            ));
        }
        Ok(Self { dims, voxel_mm, origin_mm, scale, shift })
    }

    /// True if the centre of a voxel lies within bounds in units of the file. Otherwise no voxel is inside a mesh of
    /// these bounds.
    pub(crate) fn has_centre(&self, bounds: &Bounds) -> bool {
        self.centres(bounds).iter().all(|[first, last]| first <= last)
    }

    /// First and last voxel along each axis whose centre lies within bounds in units of the file.
    pub(crate) fn centres(&self, bounds: &Bounds) -> [[i32; 2]; 3] {
        [0, 1, 2].map(|axis| {
            let at = |c: f64| (c * self.scale - self.shift[axis]).round() / f64::from(STEPS) - 0.5;
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            let range = [at(bounds.low[axis]).ceil() as i32, at(bounds.high[axis]).floor() as i32];
            range
        })
    }

    /// Nearest lattice point; `None` beyond the lattice.
    #[inline]
    pub(crate) fn point(&self, p: [f64; 3]) -> Option<[i32; 3]> {
        let mut out = [0; 3];
        for ((out, c), shift) in out.iter_mut().zip(p).zip(self.shift) {
            let at = c * self.scale - shift;
            if !(at > -LIMIT && at < LIMIT) {
                return None;
            }
            #[expect(clippy::cast_possible_truncation, reason = "checked above")]
            let whole = ((at + ROUNDER) - ROUNDER) as i32;
            *out = whole;
        }
        Some(out)
    }
}

/// The triangle of three points, its smallest vertex first: results do not depend on the vertex with which the file
/// begins.
#[inline]
pub(crate) fn smallest_first([a, b, c]: [[i32; 3]; 3]) -> Triangle {
    let [a, b, c] = if a <= b && a <= c {
        [a, b, c]
    } else if b <= c {
        [b, c, a]
    } else {
        [c, a, b]
    };
    [a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]
}

/// The first corner, and the edges from it to the others.
#[inline]
pub(super) fn edges(t: &Triangle) -> [[f64; 3]; 3] {
    let f = t.map(f64::from);
    let edge = |k: usize| [f[k] - f[0], f[k + 1] - f[1], f[k + 2] - f[2]];
    [[f[0], f[1], f[2]], edge(3), edge(6)]
}

/// First slice (row, column) whose centre is at or beyond a coordinate. (Coordinates are below 2^29: nothing is checked
/// where it would only keep the compiler from working on several at once.)
#[inline]
pub(super) fn first_centre(at: i32) -> i32 {
    at.wrapping_add(STEPS - HALF - 1) >> 12
}

/// Last slice (row, column) whose centre is at or before a coordinate.
#[inline]
pub(super) fn last_centre(at: i32) -> i32 {
    at.wrapping_sub(HALF) >> 12
}

/// Lowest and highest coordinate along an axis.
#[inline]
pub(crate) fn span(t: &Triangle, axis: usize) -> (i32, i32) {
    let (a, b, c) = (t[axis], t[axis + 3], t[axis + 6]);
    (a.min(b).min(c), a.max(b).max(c))
}

/// Slices (rows, columns) whose centres lie between the ends of a triangle: empty if the second is less.
#[inline]
pub(super) fn centres(t: &Triangle, axis: usize) -> (i32, i32) {
    let (low, high) = span(t, axis);
    (first_centre(low), last_centre(high))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centres_are_between_the_ends_of_a_triangle() {
        assert_eq!((first_centre(2048), last_centre(2048)), (0, 0));
        assert_eq!((first_centre(2049), last_centre(2047)), (1, -1));
        assert_eq!((first_centre(-2048), last_centre(-2049)), (-1, -2));
    }

    #[test]
    fn the_longest_side_fills_the_grid_but_for_the_margin() {
        let bounds = Bounds { low: [-1.0, 0.0, 0.0], high: [1.0, 0.5, 0.1] };
        let grid = Grid::new(GridChoice::Side { voxels: 12, margin: 1 }, &bounds, 10.0).unwrap();
        assert_eq!(grid.dims.to_array(), [12, 5, 3]);
        assert_eq!(grid.voxel_mm, 2.0);
        assert_eq!(grid.point([-1.0, 0.0, 0.05]).unwrap(), [4096, 4096 + 1024, 6144]);
        assert_eq!(grid.point([1e9, 0.0, 0.0]), None);
        assert_eq!(grid.point([f64::NAN, 0.0, 0.0]), None);
        let point = Bounds { low: [1.0; 3], high: [1.0; 3] };
        assert_eq!(
            Grid::new(GridChoice::Side { voxels: 9, margin: 1 }, &point, 1.0).unwrap_err(),
            bad!("lies in one point; give a mesh with an extent")
        );
    }
}
