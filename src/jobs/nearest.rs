//! Nearest points of a model's surface, for many points at once.

use std::num::NonZero;
use std::thread;

use super::pass::on_threads;
use crate::error::Error;
use crate::fault::usage;
use crate::load::{Model, NodeView};
use crate::measure::nearest::{Query, Search, Side, Surface};
use crate::progress::{Progress, Silent};

/// Fewest points of a thread.
const PART: usize = 1 << 10;

/// Nearest points of a surface: arrays with an item for each point.
///
/// The search of distances in octrees by bounds follows Samet, *Foundations of Multidimensional and Metric Data
/// Structures* (2006), section 4.1; the surface in a cell is SPEC 4.8's.
#[non_exhaustive]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NearestPoints {
    /// Signed distances in mm: positive outside, negative inside; infinity where the model is empty.
    pub distance_mm: Vec<f64>,
    /// Nearest points, x, y, z in LPS mm; NaN where the model is empty.
    pub position_mm: Vec<[f64; 3]>,
    /// Unit vectors out of the surface there, in LPS; NaN where the model is empty.
    pub normal: Vec<[f64; 3]>,
    /// 1 outside, -1 inside, 0 on the surface (nearer than a thousand-millionth of a voxel).
    pub side: Vec<i8>,
    /// Numbers of the cells, as [`Model::voxels`] counts them; `None` in a larger leaf, and where the model is empty.
    pub cell: Vec<Option<u64>>,
}

/// The answer for one point.
#[derive(Clone, Copy)]
struct Answer {
    distance_mm: f64,
    position_mm: [f64; 3],
    normal: [f64; 3],
    side: i8,
    cell: Option<u64>,
}

impl Answer {
    const NONE: Self = Self {
        distance_mm: f64::INFINITY,
        position_mm: [f64::NAN; 3],
        normal: [f64::NAN; 3],
        side: 1,
        cell: None,
    };

    fn of(search: &mut Search<'_>, world: [f64; 3]) -> Self {
        let surface = search.surface;
        let point = surface.space.to_frame(world);
        let Some(found) = search.nearest(point, &Query::ANY) else { return Self::NONE };
        let (side, sign) = match search.side(point, &found) {
            Side::On => (0, 0.0),
            Side::Inside => (-1, -1.0),
            Side::Outside => (1, 1.0),
        };
        Self {
            distance_mm: if side == 0 { 0.0 } else { sign * found.distance() },
            position_mm: surface.space.to_world(found.point),
            normal: surface.space.direction_to_world(found.normal),
            side,
            cell: found.place.number.get().checked_sub(surface.view.node_count()),
        }
    }
}

impl<D: AsRef<[u8]> + Sync> Model<D> {
    /// The nearest point of the surface to each of some points (x, y, z in LPS mm), with its signed distance, side, normal
    /// and cell. Answers do not depend on the order of the points.
    ///
    /// Cost: a microsecond or two for a point near the surface, more in proportion to its distance in cells; all cores.
    /// Memory: the answers, 80 bytes a point.
    ///
    /// ```
    /// use infobyte::{BuildOptions, Dims, Model, Threshold, Voxels};
    ///
    /// # fn main() -> Result<(), infobyte::Error> {
    /// # let folder = tempfile::tempdir().expect("a temporary folder");
    /// # let path = folder.path().join("ball.oct");
    /// let dims = Dims::new(48, 48, 48).expect("sides of 1 to 65536");
    /// let ball = Voxels::from_fn(dims, |p| 20.0 - p.map(|c| (c as f32 - 23.5).powi(2)).iter().sum::<f32>().sqrt());
    /// infobyte::build(&ball, &BuildOptions { threshold: Threshold::Iso(0.0), ..Default::default() }, &path)?;
    /// let found = Model::open(&path)?.nearest(&[[23.5, 23.5, 0.0], [23.5, 23.5, 23.5]])?;
    /// assert!((found.distance_mm[0] - 3.5).abs() < 0.05 && found.normal[0][2] < -0.99);
    /// assert!((found.distance_mm[1] + 20.0).abs() < 0.1 && found.side == [1, -1]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// The model is a skin of voxels, has several labels, or axes that are not at right angles; a point is not finite; the file
    /// changes during the call.
    pub fn nearest(&self, points: &[[f64; 3]]) -> Result<NearestPoints, Error> {
        let threads = thread::available_parallelism().map_or(1, NonZero::get);
        self.unchanged_during(|| nearest_points(self, points, threads, &Silent))
    }
}

/// [`Model::nearest`] on so many threads; [`Error::Stopped`] if `progress` is stopped.
pub(crate) fn nearest_points<D: AsRef<[u8]> + Sync>(
    model: &Model<D>,
    points: &[[f64; 3]],
    threads: usize,
    progress: &dyn Progress,
) -> Result<NearestPoints, Error> {
    if let Some(at) = points.iter().position(|point| !point.iter().all(|c| c.is_finite())) {
        return Err(usage!("point {at} is not finite").into());
    }
    let view = model.solid_view();
    let surface = Surface::open(&view, &model.affine(), model.dims())?;
    let mut answers = vec![Answer::NONE; points.len()];
    let work = |points: &[[f64; 3]], answers: &mut [Answer]| {
        let mut search = surface.search();
        let wanted = points.iter().zip(answers).take_while(|_| !progress.stopped());
        wanted.for_each(|(point, answer)| *answer = Answer::of(&mut search, *point));
    };
    let part = points.len().div_ceil(threads.max(1)).max(PART);
    let parts = points.chunks(part).zip(answers.chunks_mut(part));
    on_threads(parts.len(), parts, |(points, answers)| work(points, answers));
    progress.check().map_err(|_| Error::Stopped)?;
    Ok(NearestPoints {
        distance_mm: answers.iter().map(|answer| answer.distance_mm).collect(),
        position_mm: answers.iter().map(|answer| answer.position_mm).collect(),
        normal: answers.iter().map(|answer| answer.normal).collect(),
        side: answers.iter().map(|answer| answer.side).collect(),
        cell: answers.iter().map(|answer| answer.cell).collect(),
    })
}
