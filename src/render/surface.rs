//! The last decision of a traversal: whether a ray that passes through a box hits its content.
//!
//! A traversal finds the boxes that a ray passes through, in order, and asks a [`Surface`] about each until one is hit.
//! With skin voxels every box entered is a hit, and a tile may put off its proof until the end ([`Surface::SOLID`]). A
//! surface within the boxes, such as a plane in a cell between samples, is asked at once, and a ray that misses it goes
//! on to the next box.

use crate::load::{CellItems, ModelView};

use super::ray::{Face, Ray};
use super::traverse::Hit;

/// Time when a ray crosses a plane of cells: after `distance / component` along the quantised direction.
///
/// Both are integers in the units of [`Ray::origin`] and [`Ray::direction`], `component > 0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crossing {
    /// Axis that the plane is perpendicular to.
    pub axis: usize,
    /// Distance from the origin to the plane, along the direction of travel.
    pub distance: i64,
    /// Size of the direction's component.
    pub component: i64,
}

/// A ray's way through a box: proved by integers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passage {
    /// Breadth-first number of the box.
    pub box_number: u64,
    /// Lowest cell of the box, in grid cells.
    pub cell: [u32; 3],
    /// Base-2 logarithm of the box's edge.
    pub edge_log2: u32,
    /// The last of the crossings into the box, of tied axes the first; `None` when the ray starts in it.
    pub enter: Option<Crossing>,
    /// The first of the crossings out of it, of tied axes the first.
    pub leave: Crossing,
}

impl Passage {
    /// The hit at the point of entry.
    #[inline]
    pub fn entry_hit(&self, ray: &Ray) -> Hit {
        let (face, t) = match self.enter {
            Some(at) => {
                let high = ray.direction()[at.axis % 3] < 0;
                (Some(Face::new(at.axis, high)), ray.t_after(at.distance, at.component))
            }
            None => (ray.entry(), ray.t_start()),
        };
        Hit { box_number: self.box_number, cell: self.cell, edge_log2: self.edge_log2, face, t }
    }
}

/// A ray and a box of the finest level that it may pass through or miss: the input of [`Surface::predict`]. Coordinates
/// are mirrored so that the ray runs forwards along every axis; integers.
#[derive(Clone, Copy, Debug)]
pub struct Approach {
    /// Breadth-first number of the box.
    pub box_number: u64,
    /// Mask of the mirrored axes.
    pub mirror: u32,
    /// Vector from the middle of the box to the ray's origin, in units of [`Ray::origin`].
    pub from_middle: [f64; 3],
    /// Direction in units of [`Ray::direction`].
    pub direction: [f64; 3],
}

/// A ray's estimated way through a box: the input of [`Surface::look`].
#[derive(Clone, Copy, Debug)]
pub struct Glance {
    /// The ray and the box.
    pub approach: Approach,
    /// Times of entry and exit, distance by component: to within 2^-40.
    pub enter: f64,
    /// See [`Glance::enter`].
    pub leave: f64,
}

/// A quick result for a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Estimate {
    /// The ray certainly goes on.
    Past,
    /// The ray certainly hits the surface as it enters.
    Entry,
    /// The ray certainly hits the surface within, after `distance / component`: integers.
    Within {
        /// Distance from the origin, along the direction of travel.
        distance: f64,
        /// Component of the direction, positive.
        component: f64,
    },
    /// Uncertain: [`Surface::meet`] decides.
    Unsure,
}

/// The surface within the boxes of an octree.
pub trait Surface: Send + Sync {
    /// True if every box that a ray enters is a hit, at its point of entry.
    ///
    /// Then [`Surface::meet`] must be [`Passage::entry_hit`]; kernels need not call it.
    const SOLID: bool;

    /// The result of [`Surface::meet`] for a ray and a box of the finest level, where it is certain without the time of
    /// passage; [`Estimate::Past`] also where the ray misses the box. Never [`Estimate::Entry`].
    #[inline(always)]
    fn predict(&self, view: &ModelView<'_>, approach: &Approach) -> Estimate {
        let _ = (view, approach);
        Estimate::Unsure
    }

    /// The cells, if every box of the finest level is one and [`Surface::meet`] tests the surface within it: then
    /// planes may be met without it.
    #[inline(always)]
    fn planes(&self) -> Option<CellItems<'_>> {
        None
    }

    /// The result of [`Surface::meet`] for a box of the finest level, if the estimate makes it certain.
    #[inline(always)]
    fn look(&self, view: &ModelView<'_>, glance: &Glance) -> Estimate {
        let _ = (view, glance);
        Estimate::Unsure
    }

    /// Hit of the ray with the surface, on its way through a box; `None` when it misses, and goes on.
    fn meet(&self, view: &ModelView<'_>, ray: &Ray, passage: &Passage) -> Option<Hit>;
}

/// The skin: its boxes themselves.
#[derive(Clone, Copy, Debug, Default)]
pub struct Skin;

impl Surface for Skin {
    const SOLID: bool = true;

    #[inline]
    fn meet(&self, _: &ModelView<'_>, ray: &Ray, passage: &Passage) -> Option<Hit> {
        Some(passage.entry_hit(ray))
    }
}
