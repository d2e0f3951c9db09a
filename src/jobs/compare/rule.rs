//! The deviation of a cell of one model from the surface of the other.

use crate::geom::{Affine, VoxelIndex};
use crate::interior::extent;
use crate::jobs::info::has_values;
use crate::load::Model;
use crate::measure::nearest::{BLOCK, Found, OctreeBox, Query, Sample, Search, Surface};
use crate::measure::places::PlaceOut;
use crate::measure::uncertainty::{SURE, Uncertainty};

/// Area below which a plane meets its cell in a corner or an edge only, as a part of the finest spacing's square.
const SLIVER: f64 = 1e-9;

/// How deviations are measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    /// From the mm of the measured model to those of the other.
    pub(super) placement: Affine,
    pub(super) radius_mm: f64,
    /// Least cosine of the angle between the normals of a cell and its counterpart.
    pub(super) cosine: f64,
    /// Distance from all surfaces at which a place deviates for certain; above the radius none does.
    pub(super) far_mm: f64,
    /// True if the other surface ends within its volume, so that nothing lies beyond it.
    pub(super) is_whole: bool,
}

/// A cell that was measured.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Row {
    pub(super) number: u64,
    pub(super) cell: [u32; 3],
    /// Its place, in the mm of the other model.
    pub(super) at_mm: [f64; 3],
    /// Area of its surface; 0 where that is a corner or an edge of the cell only.
    pub(super) area_mm2: f64,
    /// True at the border of the volume, where the surface may be a cap of the build.
    pub(super) is_border: bool,
    /// Distance of the nearest point, however it is turned: infinite beyond the radius; `None` at a border, and outside the
    /// other's volume.
    pub(super) distance: Option<f64>,
    /// True if the surface within [`Rule::far_mm`] is not known: it would be beyond the other's volume.
    pub(super) is_unknown: bool,
    /// Positive outside; `None` without counterpart, and at the border.
    pub(super) value: Option<f64>,
    /// True at a sharp edge, which cells cut off, so that it is less certain.
    pub(super) is_edge: bool,
    /// Squares of the standard deviations of the value by noise and by the models, in mm2; `None` if they are not known.
    pub(super) squares: Option<[f64; 2]>,
}

impl Row {
    /// Half the 95 % interval of the value, in mm.
    pub(super) fn u95_mm(&self) -> Option<f64> {
        self.squares.map(|[noise, model]| SURE * (noise + model).sqrt())
    }

    /// The cell as a place that stands out by a value.
    pub(super) fn place(&self, value: f64) -> PlaceOut {
        PlaceOut::of_cell(self.number, value, self.at_mm, self.area_mm2)
    }

    /// What is kept of it: the deviation and half its 95 % interval, and without a counterpart the distance of the nearest
    /// surface in place of the latter; NaN for none.
    pub(super) fn kept(&self) -> [f64; 2] {
        let second = if self.value.is_some() { self.u95_mm() } else { self.distance };
        [self.value, second].map(|value| value.unwrap_or(f64::NAN))
    }
}

/// How uncertain the places of a model's cells are.
#[derive(Clone, Copy, Debug)]
pub(super) enum Doubt<'a> {
    /// By the noise of its volume.
    Volume(Uncertainty<'a>),
    /// By the voxels of its grid, whose longest edge is so many mm, for a mesh or a tree.
    Grid(f64),
    Unknown,
}

/// Error of a mesh's or a tree's cells against it, in voxels of its grid: RMS of the bunny's.
const GRID_ERROR: f64 = 0.015;

/// The same at sharp edges, which cells cut off. In turned cubes, cones and wedges of 10 to 150 degrees 99 of 100 such cells
/// are off by at most 0.39 voxel, all but two by 0.46, and these at tips by 0.6 and 0.93.
const EDGE_ERROR: f64 = 0.25;

/// Deviation in voxels of the grid below which edges are not asked for.
const AT_ONCE: f64 = 0.05;

impl<'a> Doubt<'a> {
    pub(super) fn of(model: &'a Model) -> Self {
        if !has_values(model.metadata()) && !model.header().leaves {
            return Self::Grid(model.metadata().spacing_mm.into_iter().fold(0.0, f64::max));
        }
        Uncertainty::of(model).map_or(Self::Unknown, Self::Volume)
    }

    /// How far a cell moves where the threshold rises by one unit, in mm.
    pub(super) fn shift_mm(&self, cell: u64) -> Option<f64> {
        match self {
            Self::Volume(uncertainty) => uncertainty.shift_mm(VoxelIndex::new(cell)),
            _ => None,
        }
    }

    /// True if most cells have an interval.
    pub(super) fn is_known(&self) -> bool {
        !matches!(self, Self::Unknown)
    }

    /// Squares of the standard deviations of a place by noise and by the model, in mm2, where the deviation is so many mm;
    /// true for a sharp edge.
    fn squares_mm2(&self, surface: &Surface<'_>, place: OctreeBox, value: f64) -> (Option<[f64; 2]>, bool) {
        match self {
            Self::Volume(uncertainty) => {
                let cell = VoxelIndex::new(surface.cell(place.number));
                (uncertainty.squares_mm2(surface.view, cell), false)
            }
            Self::Grid(edge) => {
                let is_cut = value.abs() > AT_ONCE * edge && surface.is_at_edge(place);
                let error = if is_cut { EDGE_ERROR } else { GRID_ERROR };
                (Some([0.0, (error * edge).powi(2)]), is_cut)
            }
            Self::Unknown => (None, false),
        }
    }
}

/// A model of cells with its surface.
#[derive(Clone, Copy)]
pub(super) struct Measured<'a> {
    pub(super) model: &'a Model,
    pub(super) surface: Surface<'a>,
    pub(super) doubt: Doubt<'a>,
}

impl Measured<'_> {
    /// True if the surface ends within its volume: for a mesh or a tree that is clear of the border.
    pub(super) fn is_whole(&self) -> bool {
        let dims = self.surface.dims;
        let clear = |[low, end]: [[u32; 3]; 2]| (0..3).all(|a| low[a] > 0 && end[a] < dims[a]);
        matches!(self.doubt, Doubt::Grid(_)) && extent(self.surface.view).is_none_or(clear)
    }

    /// The cell's row but for its deviation, and its normal in the world.
    pub(super) fn row(&self, number: u64, cell: [u32; 3], placement: &Affine) -> (Row, [f64; 3]) {
        let sample = self.surface.sample(self.surface.cell_place(number, cell));
        self.row_of(&sample, (number, cell), placement)
    }

    /// The same where its sample is known.
    #[inline(always)]
    fn row_of(
        &self,
        sample: &Sample,
        (number, cell): (u64, [u32; 3]),
        placement: &Affine,
    ) -> (Row, [f64; 3]) {
        let Surface { space, .. } = self.surface;
        let at_mm = placement.apply(space.to_world(sample.point));
        let normal = placement.apply_vector(space.direction_to_world(sample.normal));
        let is_border = self.surface.touches_border(cell);
        let area_mm2 = if sample.area < SLIVER * space.finest.powi(2) { 0.0 } else { sample.area };
        (Row { number, cell, at_mm, area_mm2, is_border, ..Row::default() }, normal)
    }
}

impl Rule {
    /// The nearest point of the other surface within the radius, and its distance as a [`Row`] has it, with true if none
    /// is known.
    #[inline(always)]
    pub(super) fn nearest(
        &self,
        search: &mut Search<'_>,
        point: [f64; 3],
    ) -> (Option<Found>, (Option<f64>, bool)) {
        let found = search.nearest(point, &Query::within(self.radius_mm));
        let distance = match &found {
            Some(found) if search.surface.is_border(found.point) => {
                (None, self.is_far(Some(found.distance())))
            }
            Some(found) => (Some(found.distance()), false),
            None if self.is_covered(&search.surface, point) => (Some(f64::INFINITY), false),
            None => (None, true),
        };
        (found, distance)
    }

    /// True for a distance at which a place deviates for certain.
    pub(super) fn is_far(&self, distance: Option<f64>) -> bool {
        distance.is_some_and(|distance| distance.min(self.radius_mm) >= self.far_mm)
    }

    /// True for a place whose surroundings are in the other's volume.
    fn is_covered(&self, surface: &Surface<'_>, point: [f64; 3]) -> bool {
        let margin = self.far_mm.min(self.radius_mm);
        let inside = |a: usize| {
            let end = f64::from(surface.dims[a]) * surface.space.spacing[a];
            (margin..=end - margin).contains(&point[a])
        };
        self.is_whole || (0..3).all(inside)
    }

    /// The deviation of a place in the other model's frame, by its nearest point, which decides. Where its normal is
    /// turned away it is no counterpart, and the nearest one that is not is asked for. Its own normal says the sign if the
    /// way to it runs along it: on the far side of a wall that was moved by more than its thickness the solid's side would
    /// be the wrong one.
    #[inline(always)]
    fn deviation(
        &self,
        search: &mut Search<'_>,
        (point, normal): ([f64; 3], [f64; 3]),
        found: &Found,
    ) -> Option<(f64, OctreeBox)> {
        let facing = Query { facing: Some((normal, self.cosine)), ..Query::within(self.radius_mm) };
        let is_turned = !facing.accepts(found.normal);
        let turned = if is_turned { Some(search.nearest(point, &facing)?) } else { None };
        let found = turned.as_ref().unwrap_or(found);
        if search.surface.is_border(found.point) {
            return None;
        }
        let signed = match found.along() {
            Some(signed) if is_turned => signed,
            _ => search.signed(point, found),
        };
        Some((signed, found.place))
    }

    /// Measures the cells of rows that hold their numbers and indices.
    pub(super) fn fill(&self, [one, other]: [&Measured<'_>; 2], search: &mut Search<'_>, rows: &mut [Row]) {
        let mut samples = [Sample::default(); BLOCK];
        one.surface.samples(rows.iter().map(|row| (row.number, row.cell)), &mut samples);
        for (row, sample) in rows.iter_mut().zip(&samples) {
            self.fill_row([one, other], search, sample, row);
        }
    }

    #[inline(always)]
    fn fill_row(
        &self,
        [one, other]: [&Measured<'_>; 2],
        search: &mut Search<'_>,
        sample: &Sample,
        row: &mut Row,
    ) {
        let (made, normal) = one.row_of(sample, (row.number, row.cell), &self.placement);
        *row = made;
        if row.is_border {
            return;
        }
        let space = other.surface.space;
        let place = (space.to_frame(row.at_mm), space.direction_to_frame(normal));
        let (nearest, distance) = self.nearest(search, place.0);
        (row.distance, row.is_unknown) = distance;
        let Some((value, others_place)) =
            nearest.as_ref().and_then(|found| self.deviation(search, place, found))
        else {
            return;
        };
        row.value = Some(value);
        let own_place = one.surface.cell_place(row.number, row.cell);
        let (own, is_own_edge) = one.doubt.squares_mm2(&one.surface, own_place, value);
        let (others, is_edge) = other.doubt.squares_mm2(&other.surface, others_place, value);
        row.squares = own.zip(others).map(|(a, b)| [a[0] + b[0], a[1] + b[1]]);
        row.is_edge = is_own_edge || is_edge;
    }
}

/// How far places are from a surface that have none within the radius. Some are asked for, the more seldom the more there
/// are.
pub(super) struct Apart<'a> {
    search: Search<'a>,
    radius_mm: f64,
    seen: u64,
    /// One place in so many is asked for.
    step: u64,
    /// Sign of the last distance.
    sign: f64,
}

/// Places that are asked for before every second one is.
const ASKED: u64 = 2048;

impl<'a> Apart<'a> {
    pub(super) fn new(surface: &Surface<'a>, radius_mm: f64) -> Self {
        Self { search: surface.search(), radius_mm, seen: 0, step: 1, sign: 1.0 }
    }

    /// The distance of a row's place in mm, positive outside the solid; of one that is not asked for the radius, with the
    /// sign of the place before.
    pub(super) fn signed_mm(&mut self, at_mm: [f64; 3]) -> f64 {
        self.seen += 1;
        if !self.seen.is_multiple_of(self.step) {
            return self.radius_mm * self.sign;
        }
        if self.seen / self.step == ASKED {
            (self.seen, self.step) = (0, 2 * self.step);
        }
        let point = self.search.surface.space.to_frame(at_mm);
        let Some(found) = self.search.nearest(point, &Query::within(f64::INFINITY)) else {
            return self.radius_mm * self.sign;
        };
        let signed = self.search.signed(point, &found);
        self.sign = signed.signum();
        signed
    }
}
