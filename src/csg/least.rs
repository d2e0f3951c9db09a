//! The smallest memory cap within which the model of a tree can be built.

use std::cell::Cell;
use std::path::Path;

use super::front::Front;
use super::leaf::{Curved, Leaf};
use super::read::{count_file, parse_file};
use super::text::{OPEN_BYTES, ParsedTree, TextCounts};
use super::tree::{BOXED, Shape};
use super::{CsgOptions, solid_of};
use crate::budget::costs::{MIN_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, MemoryCap};
use crate::builder::{BuildOptions, Silent, reserve_least_of};
use crate::geom::Affine;

/// The largest tree that is made to find out what it takes.
const MADE_BYTES: u64 = 1 << 20;

/// The smallest cap, found on a budget without a limit that was made before the tree was read: a small tree is made for it,
/// of a larger one what its text may become at most is counted. `None` for a tree that cannot be read, or with files, whose
/// own readers name what they take.
pub(crate) fn least_cap(path: &Path, csg: &CsgOptions, options: &BuildOptions, dry: &Budget) -> Option<u64> {
    match parse_file(path, MADE_BYTES).ok()? {
        Ok(parsed) => made(path, &parsed, csg, options, dry)?,
        Err(_) => counted(&count_file(path)?, dry),
    }
    Some(dry.smallest_limit(1))
}

/// Reserves what a tree takes in every stage.
fn made(
    path: &Path,
    ParsedTree { tree, root, peak_bytes }: &ParsedTree,
    csg: &CsgOptions,
    options: &BuildOptions,
    dry: &Budget,
) -> Option<()> {
    if tree.files().next().is_some() {
        return None;
    }
    drop(dry.reserve(peak_bytes + MIN_WORKER + WORKER_OVERHEAD));
    let options = BuildOptions { memory: MemoryCap::Share(u64::MAX / 2), ..options.clone() };
    let (peak, scratch) = (Cell::new(0), std::path::PathBuf::new());
    let front = Front {
        tree,
        root: *root,
        volumes: &[],
        name: path,
        csg,
        options: &options,
        scratch,
        progress: &Silent,
        peak,
    };
    let placed = front.placed().ok()?;
    let (solid, _) = front.solid(&placed).ok()?;
    drop(dry.reserve(tree.bytes() + front.peak.get()));
    let _leaves = dry.reserve(solid.bytes());
    drop(reserve_least_of(&*solid_of(solid, path, &options).ok()?, &options, dry).ok()?);
    Some(())
}

/// Reserves the most that a text of so many modules and numbers may take.
fn counted(counts: &TextCounts, dry: &Budget) {
    let TextCounts { leaves, blocks, depth, numbers, longest } = *counts;
    let bytes = |size: usize| size as u64;
    // A block is a node of its own, and the union of its children. Lists grow by an eighth.
    let nodes = leaves + 2 * blocks;
    let boxes =
        leaves * bytes(size_of::<Shape>() + BOXED) + blocks * bytes(size_of::<(Affine, u32)>() + BOXED);
    let tree = nodes * 20 * 9 / 8 + boxes + 12 * numbers;
    let open = depth * bytes(OPEN_BYTES);
    let worker = MIN_WORKER + WORKER_OVERHEAD;
    drop(dry.reserve(tree + open + 24 * longest + worker));
    let placed = leaves * bytes(size_of::<Leaf>() + size_of::<Curved>() + BOXED + 8) * 9 / 8 + 12 * numbers;
    let lists = (leaves + 2 * blocks) * 24 * 9 / 8 + depth * bytes(size_of::<Affine>() + 16) * 9 / 8;
    drop(dry.reserve(tree + placed + lists + 12 * longest));
    // Programs, extents and what a worker holds of each leaf, of cells too.
    drop(dry.reserve(placed + leaves * 128 + worker + (768 << 10)));
}
