//! Many rays at once, on threads.

use std::ops::{Deref, Range};

use rayon::prelude::*;

use crate::error::Error;
use crate::load::Model;
use crate::progress::Progress;
use crate::render::picture::pool;
use crate::render::{Layout, RayCaster, RenderError, RenderFault};

/// Approximate number of rays that a thread takes at a time, rounded to whole tiles. A thread, or a check for a stop,
/// does not pay for fewer.
pub(super) const PART: usize = 1 << 14;

/// Arrays of hits with an item, or three, for each ray.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub(super) t: Vec<f64>,
    pub(super) position: Vec<[f64; 3]>,
    pub(super) normal: Vec<[f64; 3]>,
    pub(super) voxel: Vec<i64>,
}

/// Source of rays, made on demand or given.
pub(super) trait Rays: Sync {
    /// Number of rays.
    fn count(&self) -> usize;
    /// Arrangement of the rays.
    fn layout(&self) -> Layout;
    /// Origins and directions of a part of them; `room` may hold them.
    fn of<'a>(&'a self, part: Range<usize>, room: &'a mut Room) -> (&'a [[f64; 3]], &'a [[f64; 3]]);
}

/// Given rays: origins and directions.
pub(super) struct Given<'a>(pub(super) &'a [[f64; 3]], pub(super) &'a [[f64; 3]]);

impl Rays for Given<'_> {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn layout(&self) -> Layout {
        Layout::of(self.0, self.1, None)
    }

    fn of<'a>(&'a self, part: Range<usize>, _: &'a mut Room) -> (&'a [[f64; 3]], &'a [[f64; 3]]) {
        (&self.0[part.clone()], &self.1[part])
    }
}

/// Buffer for the rays of a part, reused for the next one.
#[derive(Default)]
pub(super) struct Room {
    pub(super) origins: Vec<[f64; 3]>,
    pub(super) directions: Vec<[f64; 3]>,
}

/// The error of a part, with the faulty ray's number counted from the first ray of all.
fn from_start(mut error: RenderError, first: usize) -> RenderError {
    if let RenderFault::RayAt { index, .. } = error.fault_mut() {
        *index += first;
    }
    error
}

/// An array in parts of whole tiles.
fn cut<T>(items: &mut [T], [part, least]: [usize; 2]) -> Vec<&mut [T]> {
    let rest = items.len() % part;
    // A remainder that is too short for a tile belongs to the part before.
    let even = items.len() - if rest < least && items.len() > part { part + rest } else { rest };
    let (even, last) = items.split_at_mut(even);
    even.chunks_mut(part).chain((!last.is_empty()).then_some(last)).collect()
}

/// Runs `each` on every part, with the number of its first ray; returns the error of the first part that has one, or
/// [`Error::Stopped`].
fn in_parts<T: Send>(
    parts: Vec<T>,
    part: usize,
    (threads, progress): (usize, &dyn Progress),
    each: impl Fn(&mut Room, usize, T) -> Result<(), RenderError> + Sync,
) -> Result<(), Error> {
    let run = |room: &mut Room, (number, of_part): (usize, T)| {
        if progress.stopped() {
            return None;
        }
        let first = number * part;
        each(room, first, of_part).err().map(|error| (number, from_start(error, first)))
    };
    let wrong = if threads <= 1 || parts.len() == 1 {
        let mut room = Room::default();
        parts.into_iter().enumerate().find_map(|part| run(&mut room, part))
    } else {
        let all = || {
            let wrong = parts.into_par_iter().enumerate().map_init(Room::default, run).flatten();
            wrong.min_by_key(|(number, _)| *number)
        };
        pool(threads)?.install(all)
    };
    wrong.map_or_else(|| progress.check().map_err(|_| Error::Stopped), |(_, error)| Err(error.into()))
}

/// First hits of rays; `means` are the number of threads, and the watcher that may stop them.
pub(super) fn first_hits<P, D>(
    caster: &RayCaster<P>,
    rays: &impl Rays,
    means: (usize, &dyn Progress),
) -> Result<Found, Error>
where
    P: Deref<Target = Model<D>> + Sync,
    D: AsRef<[u8]> + Sync,
{
    let count = rays.count();
    let mut found = Found {
        t: vec![f64::INFINITY; count],
        position: vec![[f64::NAN; 3]; count],
        normal: vec![[f64::NAN; 3]; count],
        voxel: vec![-1; count],
    };
    let layout = rays.layout();
    let part = layout.part(PART);
    let parts = cut(&mut found.t, part).into_iter().zip(cut(&mut found.position, part));
    let parts = parts.zip(cut(&mut found.normal, part)).zip(cut(&mut found.voxel, part)).collect();
    in_parts(parts, part[0], means, |room, first, (((t, position), normal), voxel)| {
        let (origins, directions) = rays.of(first..first + t.len(), room);
        caster.points(layout, origins, directions, |ray, point| {
            t[ray] = point.t;
            position[ray] = point.position_mm;
            normal[ray] = point.normal.unwrap_or([f64::NAN; 3]);
            voxel[ray] = i64::try_from(point.number).unwrap_or(-1);
        })
    })?;
    Ok(found)
}

/// True for each ray that meets anything.
pub(super) fn any_hit<P, D>(
    caster: &RayCaster<P>,
    rays: &impl Rays,
    t_max: f64,
    means: (usize, &dyn Progress),
) -> Result<Vec<bool>, Error>
where
    P: Deref<Target = Model<D>> + Sync,
    D: AsRef<[u8]> + Sync,
{
    let (mut met, layout) = (vec![false; rays.count()], rays.layout());
    let part = layout.part(PART);
    in_parts(cut(&mut met, part), part[0], means, |room, first, met| {
        caster.met(layout, rays.of(first..first + met.len(), room), t_max, met)
    })?;
    Ok(met)
}
