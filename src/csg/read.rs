//! Trees from files of text.

use std::ffi::OsStr;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use super::text::{self, Stop};
use super::tree::{NodeId, Shape, Tree};
use crate::budget::costs::{MIN_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, MemoryCap};
use crate::builder::BuildError;
use crate::csg::fault::nothing;
use crate::fault::{Fault, bad};
use crate::platform::{PositionalFile, is_not_regular};
use crate::source::stays;
use crate::text::names::FOLLOW_LINKS;
use crate::text::{plain_head, shown};
use crate::volume::{SourceError, SourceFault};

/// Bytes of a text that are read at a time.
const READ_BYTES: usize = 16 << 10;

/// True for the beginning of a tree's text; the file's name counts as well.
pub(crate) fn is_tree(head: &[u8], path: &Path) -> bool {
    let head = plain_head(head);
    let first = String::from_utf8_lossy(&head);
    let is_named = |e: &OsStr| ["csg", "scad"].iter().any(|name| e.eq_ignore_ascii_case(name));
    path.extension().is_some_and(is_named) || begins_with_module(&first)
}

fn begins_with_module(text: &str) -> bool {
    let mut rest = text.trim_start();
    while let Some((_, behind)) = match rest {
        line if line.starts_with("//") => line.split_once('\n'),
        block if block.starts_with("/*") => block.split_once("*/"),
        _ => None,
    } {
        rest = behind.trim_start();
    }
    let rest = rest.trim_start_matches(['%', '#', '*', '!']);
    let Some((name, _)) = rest.split_once('(') else { return false };
    text::is_module(name.trim())
}

/// Reads a tree from a text in OpenSCAD's evaluated form.
///
/// Memory: at most the part of the cap that a build does not need. Files that it names are not opened.
///
/// # Errors
/// A fault of the text, with its line; the file cannot be read; the tree does not fit.
pub fn read_tree(path: &Path, memory: MemoryCap) -> Result<(Tree, NodeId), BuildError> {
    let least = MIN_WORKER + WORKER_OVERHEAD;
    let most = Budget::of_job(memory).left_bytes().saturating_sub(least);
    let parsed = parse_file(path, most)?;
    parsed.map_err(|bytes| too_small(path, memory, bytes + least))
}

/// The files that a tree names, except its text; the tree may take `allowed_bytes` meanwhile.
///
/// # Errors
/// The errors of [`read_tree`]; links lead out of its folder, and are not to be followed.
pub(crate) fn named_files(
    path: &Path,
    allowed_bytes: u64,
    follow_links: bool,
) -> Result<Vec<PathBuf>, SourceError> {
    let needed = |needed_bytes| {
        SourceError::from(SourceFault::Memory { path: path.to_path_buf(), needed_bytes, allowed_bytes })
    };
    let (tree, _) = parse_file(path, allowed_bytes)?.map_err(needed)?;
    if !follow_links {
        check_links(&tree, path)?;
    }
    let mut files: Vec<PathBuf> = tree.files().filter_map(file_of).cloned().collect();
    crate::order::by(&mut files, Ord::cmp);
    files.dedup();
    Ok(files)
}

/// A tree that takes at most `most` bytes, or the bytes that it took when reading stopped.
fn parse_file(path: &Path, most: u64) -> Result<Result<(Tree, NodeId), u64>, SourceError> {
    let unreadable = |cause| SourceError::from(SourceFault::Unreadable { path: path.to_path_buf(), cause });
    let file = PositionalFile::open(path).map_err(|cause| {
        if is_not_regular(&cause) {
            return bad!("is neither a file nor a folder; name one of these").at(path).into();
        }
        unreadable(cause)
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut input = BufReader::with_capacity(READ_BYTES, file.onwards(0));
    match text::parse(&mut input, folder, most) {
        Ok(tree) => Ok(Ok(tree)),
        Err(Stop::Memory { bytes }) => Ok(Err(bytes)),
        Err(Stop::Text(fault)) => Err(unusable(path, fault)),
        Err(Stop::Read(cause)) => Err(unreadable(cause)),
    }
}

/// Bytes in which the tree of a file fits in every stage, and the number of files that it names; `None` if the file
/// cannot be read.
pub(crate) fn memory_bound(path: &Path) -> Option<(u64, u64)> {
    let file = PositionalFile::open(path).ok()?;
    text::memory_bound(&mut BufReader::with_capacity(READ_BYTES, file.onwards(0))).ok()
}

/// Reads a tree from text in memory; files that it names lie in `folder`.
///
/// # Errors
/// A fault of the text, with its line.
pub fn parse_tree(text: &[u8], folder: &Path) -> Result<(Tree, NodeId), Fault> {
    text::parse(&mut { text }, folder, u64::MAX).map_err(|stop| match stop {
        Stop::Text(fault) => fault,
        // Text in memory can be read, and its tree has no bound on memory.
        Stop::Read(_) | Stop::Memory { .. } => nothing(),
    })
}

/// The file of a leaf, if it has one.
fn file_of(shape: &Shape) -> Option<&PathBuf> {
    match shape {
        Shape::Mesh { path } | Shape::Volume { path, .. } => Some(path),
        _ => None,
    }
}

/// Refuses a tree if links lead its files out of the folder of its text: a text of foreign origin must not make the
/// program read any file that a link leads to.
pub(crate) fn check_links(tree: &Tree, text: &Path) -> Result<(), SourceError> {
    match tree.files().filter_map(file_of).find(|path| !stays(text, path)) {
        None => Ok(()),
        Some(path) => {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Err(unusable(
                text,
                bad!(
                    "names `{}`, a link that leads out of its folder; put the file there, or add {FOLLOW_LINKS}",
                    shown(&name)
                ),
            ))
        }
    }
}

pub(super) fn unusable(path: &Path, fault: Fault) -> SourceError {
    SourceError::from(fault.at(path))
}

pub(super) fn too_small(path: &Path, memory: MemoryCap, bytes: u64) -> BuildError {
    crate::mesh::too_small(path.display().to_string(), memory, 2 * bytes)
}
