//! Folders searched, entry by entry; nothing is collected and nothing sorted.

use std::collections::HashSet;
use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};

use super::left_out::said;
use super::surveyor::Surveyor;
use crate::fault::bad;
use crate::platform::{self, below, file_id};
use crate::synthetic::is_synthetic;
use crate::text::names::FOLLOW_LINKS;
use crate::volume::{Result, SourceError};

const UNREADABLE: &str = "folder that cannot be read";

/// Walks the inputs. Hidden entries are left out; links to files are followed, links to folders below an input are
/// counted and not entered, unless `follow` says so: then all but those that lead back to where the walk came from.
///
/// # Errors
/// [`SourceError`] for a missing input, and the errors of the surveyor.
pub(super) fn walk(inputs: &[PathBuf], depth: u32, follow: bool, surveyor: &mut Surveyor<'_>) -> Result {
    for (at, input) in inputs.iter().enumerate() {
        let unreadable = |cause| SourceError::unreadable(input, cause);
        let at = u32::try_from(at).unwrap_or(u32::MAX);
        if is_synthetic(input) {
            surveyor.synthetic(at)?;
            continue;
        }
        let not_regular = || bad!("is neither a file nor a folder; name one of these").at(input).into();
        if platform::is_device(input) {
            return Err(not_regular());
        }
        let meta = fs::metadata(input).map_err(unreadable)?;
        if meta.is_dir() {
            if let Some((path, meta)) = surveyor.chunks(at, Path::new("")) {
                surveyor.file(at, &path, &meta)?;
                continue;
            }
            let entries = fs::read_dir(input).map_err(unreadable)?;
            let mut way = WalkState { follow, entered: vec![file_id(input).map_err(unreadable)?] };
            folder(at, entries, Path::new(""), depth, &mut way, surveyor)?;
        } else if meta.is_file() {
            surveyor.file(at, Path::new(""), &meta)?;
        } else {
            // Opening a pipe could wait forever.
            return Err(not_regular());
        }
    }
    Ok(())
}

/// State of a walk.
struct WalkState {
    /// True if links to folders are entered.
    follow: bool,
    /// The folders from the input to here, which no link may lead to.
    entered: Vec<(u64, u64)>,
}

fn folder(
    input: u32,
    entries: fs::ReadDir,
    prefix: &Path,
    depth: u32,
    way: &mut WalkState,
    surveyor: &mut Surveyor<'_>,
) -> Result {
    for entry in entries {
        // A folder that fails half-way (a disk on its way out) is reported, and the rest goes on.
        let Ok(entry) = entry else {
            surveyor.not_entered(prefix, said(UNREADABLE));
            break;
        };
        let name = entry.file_name();
        if name.as_encoded_bytes().starts_with(b".") {
            continue;
        }
        let path = below(prefix, name.as_ref());
        let Ok(kind) = entry.file_type() else { continue };
        let linked = kind.is_symlink().then(|| fs::metadata(entry.path()).ok()).flatten();
        let linked = linked.filter(Metadata::is_dir).and_then(|_| file_id(&entry.path()).ok());
        if linked.is_some_and(|folder| !way.follow || way.entered.contains(&folder)) {
            let reason = format!("folder that a link leads to, which is searched with {FOLLOW_LINKS} only");
            surveyor.not_entered(&path, said(reason));
        } else if kind.is_dir() || linked.is_some() {
            if depth == 0 {
                surveyor.not_entered(&path, said("folder that lies too deep to be searched"));
            } else if let Some((head, meta)) = surveyor.chunks(input, &path) {
                surveyor.file(input, &head, &meta)?;
            } else if !surveyor.takes_folder(input, &path) {
                match fs::read_dir(entry.path()) {
                    Ok(inside) => {
                        let own = file_id(&entry.path());
                        way.entered.push(own.unwrap_or_default());
                        folder(input, inside, &path, depth - 1, way, surveyor)?;
                        way.entered.pop();
                    }
                    Err(_) => surveyor.not_entered(&path, said(UNREADABLE)),
                }
            }
        } else if (kind.is_file() || kind.is_symlink())
            && let Ok(meta) = fs::metadata(entry.path())
            && meta.is_file()
        {
            surveyor.file(input, &path, &meta)?;
        }
    }
    Ok(())
}

/// The inputs without repetitions, and without those below another one that is searched anyway.
///
/// # Errors
/// [`SourceError`] for a missing input.
pub(super) fn without_repeats(inputs: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let real = |input: &PathBuf| {
        let unreadable = |cause| SourceError::unreadable(input, cause);
        if is_synthetic(input) { Ok(input.clone()) } else { fs::canonicalize(input).map_err(unreadable) }
    };
    let all: Vec<PathBuf> = inputs.iter().map(real).collect::<Result<_, _>>()?;
    let known: HashSet<&Path> = all.iter().map(PathBuf::as_path).collect();
    let mut taken: HashSet<&Path> = HashSet::new();
    let alone = all.iter().map(|path| {
        let below = path.ancestors().skip(1).any(|folder| known.contains(folder));
        !below && taken.insert(path)
    });
    Ok(inputs.iter().zip(alone).filter(|(_, alone)| *alone).map(|(input, _)| input.clone()).collect())
}
