//! The smallest memory cap within which the model of a tree can be built.

use std::cell::{Cell, RefCell};
use std::path::{Path, PathBuf};

use super::front::Front;
use super::leaf::{Extent, Leaf};
use super::place::LatticeGrid;
use super::read::{count_file, parse_file};
use super::solid::CsgSolid;
use super::text::{ParsedTree, TextCounts};
use super::tree::{Shape, room};
use super::{CsgOptions, solid_of};
use crate::budget::costs::{MIN_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, MemoryCap, current_rss_bytes};
use crate::builder::{BuildOptions, Progress, reserve_least_of};
use crate::geom::Affine;
use crate::mesh::{Bounds, GridChoice};

/// A tree that is made to find out what it takes, however small the cap.
const MADE_BYTES: u64 = 1 << 20;

/// The smallest cap, found on a budget without a limit that was made before the tree was read: a small tree is made for it,
/// of a larger one what its text becomes is counted. `None` for a tree that cannot be read, or that has volumes, or
/// is large and has files: their own readers name what they take.
pub(crate) fn least_cap(
    path: &Path,
    (csg, options): (&CsgOptions, &BuildOptions),
    scratch: PathBuf,
    progress: &dyn Progress,
    dry: &Budget,
) -> Option<u64> {
    // What the process really holds leaves room, as more code is counted than runs before a build.
    let room = match options.memory {
        MemoryCap::Process(limit_bytes) => limit_bytes.saturating_sub(current_rss_bytes()),
        MemoryCap::Share(bytes) => bytes,
    };
    match parse_file(path, MADE_BYTES.max(room / 4)).ok()? {
        Ok(parsed) => made(path, &parsed, (csg, options), scratch, (progress, dry))?,
        Err(_) => counted(path, &count_file(path)?, csg, options, dry)?,
    }
    Some(dry.smallest_limit(1))
}

/// Reserves what a tree takes in every stage.
fn made(
    path: &Path,
    ParsedTree { tree, root, peak_bytes }: &ParsedTree,
    (csg, options): (&CsgOptions, &BuildOptions),
    scratch: PathBuf,
    (progress, dry): (&dyn Progress, &Budget),
) -> Option<()> {
    if tree.files().any(|shape| matches!(shape, Shape::Volume { .. })) {
        return None;
    }
    drop(dry.reserve(peak_bytes + MIN_WORKER + WORKER_OVERHEAD));
    let options = BuildOptions { memory: MemoryCap::Share(u64::MAX / 2), ..options.clone() };
    let peak = Cell::new(0);
    // Its meshes are read while it is held.
    let held = dry.reserve(tree.bytes()).ok()?;
    let front = Front {
        tree,
        root: *root,
        volumes: &[],
        name: path,
        csg,
        options: &options,
        scratch,
        progress,
        peak,
        dry: Some((dry, RefCell::default())),
    };
    let placed = front.placed().ok()?;
    let (solid, _) = front.solid(&placed).ok()?;
    drop(held);
    drop(dry.reserve(tree.bytes() + front.peak.get()));
    let _leaves = dry.reserve(solid.bytes());
    drop(reserve_least_of(&*solid_of(solid, path, &options).ok()?, &options, dry).ok()?);
    Some(())
}

/// Reserves what a tree takes whose text has so many modules; its grid as if it were as long along every side.
fn counted(
    path: &Path,
    counts: &TextCounts,
    csg: &CsgOptions,
    options: &BuildOptions,
    dry: &Budget,
) -> Option<()> {
    let TextCounts { files: 0, joins, children, depth, held, making, peak_bytes, .. } = *counts else {
        return None;
    };
    let bytes = |size: usize| size as u64;
    drop(dry.reserve(peak_bytes + MIN_WORKER + WORKER_OVERHEAD));
    // As `Flat` counts: its lists, and what is still to be visited.
    let leaves = counts.leaves + counts.empty;
    let open = room(depth) * bytes(size_of::<Affine>()) + room(children) * 16;
    let parts = (room(joins) + room(leaves + joins)) * 24;
    let lists = |made: usize| leaves * bytes(made + 8) * 9 / 8 + parts + open;
    let flat = (lists(size_of::<Leaf>()) + held).max(lists(size_of::<Bounds>())).max(making);
    drop(dry.reserve(counts.tree_bytes() + flat));
    let count = usize::try_from(leaves).ok()?;
    let placed = room(leaves) * bytes(size_of::<Leaf>()) + leaves * bytes(size_of::<Extent>() + 8);
    let _leaves = dry.reserve(held + placed);
    let choice = match csg.grid? {
        GridChoice::Voxel { margin, .. } => GridChoice::Side { voxels: 1024, margin },
        choice => choice,
    };
    let place = LatticeGrid::around(choice, &Bounds { low: [0.0; 3], high: [1.0; 3] }).ok()?;
    let solid = CsgSolid {
        name: path.display().to_string(),
        place,
        leaves: Vec::new(),
        extents: Vec::new(),
        program: Vec::new(),
        sampled: Vec::new(),
        counts: [count, 2 * count],
        text: None,
    };
    drop(reserve_least_of(&*solid_of(solid, path, options).ok()?, options, dry).ok()?);
    Some(())
}
