//! Many rays at once, on threads.

use std::ops::Deref;

use rayon::prelude::*;

use crate::error::Error;
use crate::load::Model;
use crate::render::picture::pool;
use crate::render::{Hits, RayCaster, RenderError, RenderFault};

/// Rays that a thread takes at a time: 1.4 MiB of hits.
const PART: usize = 1 << 14;

/// Arrays of hits with an item, or three, for each ray.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub(super) t: Vec<f64>,
    pub(super) position: Vec<[f64; 3]>,
    pub(super) normal: Vec<[f64; 3]>,
    pub(super) voxel: Vec<i64>,
}

/// Makes the ray of a number from 0 on: origin, direction.
pub(super) trait Rays: Sync {
    fn of(&self, first: usize, origins: &mut Vec<[f64; 3]>, directions: &mut Vec<[f64; 3]>, count: usize);
}

/// Rays as they are given.
pub(super) struct Given<'a>(pub(super) &'a [[f64; 3]], pub(super) &'a [[f64; 3]]);

impl Rays for Given<'_> {
    fn of(&self, first: usize, origins: &mut Vec<[f64; 3]>, directions: &mut Vec<[f64; 3]>, count: usize) {
        origins.extend_from_slice(&self.0[first..first + count]);
        directions.extend_from_slice(&self.1[first..first + count]);
    }
}

/// What a thread uses again for its next part.
#[derive(Default)]
struct Room {
    origins: Vec<[f64; 3]>,
    directions: Vec<[f64; 3]>,
    hits: Hits,
}

/// The number of a wrong ray is that in its part.
fn from_start(mut error: RenderError, first: usize) -> RenderError {
    if let RenderFault::RayAt { index, .. } = error.fault_mut() {
        *index += first;
    }
    error
}

/// Runs `each` on every part; the error of the first part that has one.
fn in_parts<T: Send>(
    parts: Vec<T>,
    threads: usize,
    each: impl Fn(&mut Room, usize, T) -> Result<(), RenderError> + Sync,
) -> Result<(), Error> {
    let run = |room: &mut Room, (number, part): (usize, T)| {
        each(room, number * PART, part).err().map(|error| (number, from_start(error, number * PART)))
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
    wrong.map_or(Ok(()), |(_, error)| Err(error.into()))
}

/// First hits of `count` rays.
pub(super) fn first_hits<P, D>(
    caster: &RayCaster<P>,
    rays: &impl Rays,
    count: usize,
    threads: usize,
) -> Result<Found, Error>
where
    P: Deref<Target = Model<D>> + Sync,
    D: AsRef<[u8]> + Sync,
{
    let mut found = Found {
        t: vec![f64::INFINITY; count],
        position: vec![[f64::NAN; 3]; count],
        normal: vec![[f64::NAN; 3]; count],
        voxel: vec![-1; count],
    };
    let parts = found.t.chunks_mut(PART).zip(found.position.chunks_mut(PART));
    let parts = parts.zip(found.normal.chunks_mut(PART)).zip(found.voxel.chunks_mut(PART)).collect();
    in_parts(parts, threads, |room, first, (((t, position), normal), voxel)| {
        room.origins.clear();
        room.directions.clear();
        rays.of(first, &mut room.origins, &mut room.directions, t.len());
        caster.first_hits(&room.origins, &room.directions, &mut room.hits)?;
        t.copy_from_slice(&room.hits.t);
        position.copy_from_slice(&room.hits.position_mm);
        normal.copy_from_slice(&room.hits.normal);
        for (voxel, number) in voxel.iter_mut().zip(&room.hits.number) {
            *voxel = i64::try_from(*number).unwrap_or(-1);
        }
        Ok(())
    })?;
    Ok(found)
}

/// Does each ray meet anything?
pub(super) fn any_hit<P, D>(
    caster: &RayCaster<P>,
    (origins, directions): (&[[f64; 3]], &[[f64; 3]]),
    t_max: f64,
    threads: usize,
) -> Result<Vec<bool>, Error>
where
    P: Deref<Target = Model<D>> + Sync,
    D: AsRef<[u8]> + Sync,
{
    let mut met = vec![false; origins.len()];
    in_parts(met.chunks_mut(PART).collect(), threads, |_, first, met| {
        let part = first..first + met.len();
        caster.any_hit(&origins[part.clone()], &directions[part], t_max, met)
    })?;
    Ok(met)
}
