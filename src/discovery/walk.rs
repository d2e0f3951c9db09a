//! Folders searched, entry by entry; nothing is collected and nothing sorted.

use std::collections::HashSet;
use std::fs::{self, Metadata};
use std::io;
use std::path::{Path, PathBuf};

use crate::discovery::NotVolume;
use crate::discovery::left_out::said;
use crate::fault::bad;
use crate::platform::{self, below, file_id};
use crate::synthetic::is_synthetic;
use crate::text::names::FOLLOW_LINKS;
use crate::volume::{Result, SourceError, SourceFault};

const UNREADABLE: &str = "folder that cannot be read";

/// Receives the entries of a walk.
pub(super) trait Visitor {
    /// A file, by its path below the input (empty when the input itself is the file).
    ///
    /// # Errors
    /// An error ends the walk.
    fn file(&mut self, input: u32, path: &Path, meta: &Metadata) -> Result;

    /// Returns true for a folder that is one item and must not be entered; the visitor has then dealt with it.
    ///
    /// # Errors
    /// An error ends the walk.
    fn takes_folder(&mut self, input: u32, path: &Path) -> Result<bool>;

    /// The file that makes a folder a volume in chunks; the chunks are not visited one by one.
    fn chunks(&self, input: u32, path: &Path) -> Option<PathBuf>;

    /// A volume that an input describes, without a file.
    ///
    /// # Errors
    /// An error ends the walk.
    fn synthetic(&mut self, input: u32) -> Result;

    /// A folder that may not be read, or that lies too deep.
    fn not_entered(&mut self, path: &Path, why: NotVolume);
}

/// Walks the inputs. Hidden entries are left out; links to files are followed, links to folders below an input are
/// counted and not entered, unless `follow` says so: then all but those that lead back to where the walk came from.
///
/// # Errors
/// [`SourceError`] for a missing input, and the errors of the visitor.
pub(super) fn walk(inputs: &[PathBuf], depth: u32, follow: bool, visitor: &mut dyn Visitor) -> Result {
    for (at, input) in inputs.iter().enumerate() {
        let unreadable = |cause| SourceError::from(SourceFault::Unreadable { path: input.clone(), cause });
        let at = u32::try_from(at).unwrap_or(u32::MAX);
        if is_synthetic(input) {
            visitor.synthetic(at)?;
            continue;
        }
        let not_regular = || bad!("is neither a file nor a folder; name one of these").at(input).into();
        if platform::is_device(input) {
            return Err(not_regular());
        }
        let meta = fs::metadata(input).map_err(unreadable)?;
        if meta.is_dir() {
            if let Some((path, meta)) = chunks(at, Path::new(""), visitor) {
                visitor.file(at, &path, &meta)?;
                continue;
            }
            let entries = fs::read_dir(input).map_err(unreadable)?;
            let mut way = WalkState { follow, entered: vec![file_id(input).map_err(unreadable)?] };
            folder(at, entries, Path::new(""), depth, &mut way, visitor)?;
        } else if meta.is_file() {
            visitor.file(at, Path::new(""), &meta)?;
        } else {
            // Opening a pipe could wait forever.
            return Err(not_regular());
        }
    }
    Ok(())
}

/// The file that makes a folder a volume in chunks.
fn chunks(input: u32, path: &Path, visitor: &dyn Visitor) -> Option<(PathBuf, Metadata)> {
    let head = visitor.chunks(input, path)?;
    let meta = fs::metadata(&head).ok()?;
    Some((below(path, head.file_name()?.as_ref()), meta))
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
    visitor: &mut dyn Visitor,
) -> Result {
    for entry in entries {
        // A folder that fails half-way (a disk on its way out) is reported, and the rest goes on.
        let Ok(entry) = entry else {
            visitor.not_entered(prefix, said(UNREADABLE));
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
            visitor.not_entered(&path, said(reason));
        } else if kind.is_dir() || linked.is_some() {
            if depth == 0 {
                visitor.not_entered(&path, said("folder that lies too deep to be searched"));
            } else if let Some((head, meta)) = chunks(input, &path, visitor) {
                visitor.file(input, &head, &meta)?;
            } else if !visitor.takes_folder(input, &path)? {
                match fs::read_dir(entry.path()) {
                    Ok(inside) => {
                        let own = file_id(&entry.path());
                        way.entered.push(own.unwrap_or_default());
                        folder(input, inside, &path, depth - 1, way, visitor)?;
                        way.entered.pop();
                    }
                    Err(_) => visitor.not_entered(&path, said(UNREADABLE)),
                }
            }
        } else if (kind.is_file() || kind.is_symlink())
            && let Ok(meta) = fs::metadata(entry.path())
            && meta.is_file()
        {
            visitor.file(input, &path, &meta)?;
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
        let unreadable =
            |cause: io::Error| SourceError::from(SourceFault::Unreadable { path: input.clone(), cause });
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

/// Time of change of a file, as bits that differ when the time does.
pub(super) fn changed(meta: &Metadata) -> u64 {
    const NANOSECONDS: i64 = 1_000_000_000;
    let (seconds, nanoseconds) = platform::changed(meta);
    seconds.wrapping_mul(NANOSECONDS).wrapping_add(nanoseconds).cast_unsigned()
}
