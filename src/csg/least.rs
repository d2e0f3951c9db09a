//! The smallest memory cap within which the model of a tree can be built.

use std::cell::Cell;
use std::path::Path;

use super::front::Front;
use super::leaf::{Curved, Leaf};
use super::read::{count_file, parse_file};
use super::text::{ParsedTree, TextCounts};
use super::tree::BOXED;
use super::{CsgOptions, solid_of};
use crate::budget::costs::{MIN_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, MemoryCap, current_rss_bytes};
use crate::builder::{BuildOptions, Silent, reserve_least_of};
use crate::geom::Affine;

/// A tree that is made to find out what it takes, however small the cap.
const MADE_BYTES: u64 = 1 << 20;

/// The smallest cap, found on a budget without a limit that was made before the tree was read: a small tree is made for it,
/// of a larger one what its text may become at most is counted. `None` for a tree that cannot be read, or with files, whose
/// own readers name what they take.
pub(crate) fn least_cap(path: &Path, csg: &CsgOptions, options: &BuildOptions, dry: &Budget) -> Option<u64> {
    // What the process really holds leaves room, as more code is counted than runs before a build.
    let room = match options.memory {
        MemoryCap::Process(limit_bytes) => limit_bytes.saturating_sub(current_rss_bytes()),
        MemoryCap::Share(bytes) => bytes,
    };
    match parse_file(path, MADE_BYTES.max(room / 2)).ok()? {
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
    let TextCounts { leaves, spheres, joins, placed, depth, numbers, longest, peak_bytes, .. } = *counts;
    let bytes = |size: usize| size as u64;
    let (tree, worker) = (counts.tree_bytes() + (16 << 10), MIN_WORKER + WORKER_OVERHEAD);
    drop(dry.reserve(peak_bytes + (16 << 10) + 20 * longest + worker));
    // A sphere that is only moved has no box; nor is anything known of the others' sizes.
    let boxed = if placed == 0 { leaves - spheres } else { leaves };
    let held = boxed * bytes(size_of::<Curved>() + BOXED) + 12 * numbers;
    let lists = leaves * bytes(size_of::<Leaf>() + 8) + (leaves + joins) * 24 + joins * 24;
    let open = depth * bytes(size_of::<Affine>() + 16);
    drop(dry.reserve(tree + held + (lists + open) * 9 / 8 + 12 * longest));
    // Leaves, extents and programs; and what a worker holds of each leaf, of cells too.
    drop(dry.reserve(held + leaves * bytes(size_of::<Leaf>() + 96) + worker + (512 << 10)));
}
