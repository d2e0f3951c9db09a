//! Files that a mesh names: they lie in its folder, and links do not lead out of it.

use std::io;
use std::path::{Component, Path, PathBuf};

use super::stop::Stop;
use crate::fault::{Fault, FaultKind, bad};
use crate::mesh::read::stop::outside;
use crate::platform::{PositionalFile, is_not_regular};
use crate::source::stays;
use crate::text::names::FOLLOW_LINKS;
use crate::text::shown;

/// A file that the mesh at `mesh` names, its whole path and its length.
///
/// # Errors
/// The file lies outside the mesh's folder, or links lead there and may not be followed, or it cannot be read.
pub(super) fn open_linked(
    mesh: &Path,
    name: &str,
    follow: bool,
) -> Result<(PositionalFile, PathBuf, u64), Stop> {
    let relative = Path::new(name);
    let inside = relative.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if name.is_empty() {
        return Err(bad!("names a file by an empty name; repair the file").into());
    }
    if !inside {
        return Err(outside(name).into());
    }
    let path = mesh.parent().unwrap_or(Path::new("")).join(relative);
    if !follow && !stays(mesh, &path) {
        return Err(bad!(
            "names {}, from which a link leads out of its folder; {FOLLOW_LINKS} reads it",
            shown(name)
        )
        .into());
    }
    let absent = |text| Stop::Mesh(Fault::new(FaultKind::Absent, text));
    match PositionalFile::open(&path).and_then(|file| Ok((file.metadata()?.len(), file))) {
        Ok((bytes, file)) => Ok((file, path, bytes)),
        Err(cause) if is_not_regular(&cause) => Err(absent(format!(
            "names {}, which is a folder, a pipe, a socket or a device; put the file in its place",
            shown(name)
        ))),
        Err(cause) => Err(missing(name, &cause).into()),
    }
}

/// A named file that cannot be read.
pub(in crate::mesh) fn missing(name: &str, cause: &io::Error) -> Fault {
    let why = match cause.kind() {
        io::ErrorKind::InvalidInput => "it is not a regular file".to_owned(),
        why => why.to_string(),
    };
    Fault::new(
        FaultKind::Absent,
        format!("names {}, which cannot be read: {why}; put it beside the file", shown(name)),
    )
}

/// The name in a URI: `%20` and the like stand for bytes.
pub(super) fn unescaped(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((first, behind)) = rest.split_first() {
        let hex = |at: usize| behind.get(at).and_then(|b| char::from(*b).to_digit(16));
        if let (b'%', Some(high), Some(low)) = (first, hex(0), hex(1)) {
            bytes.push(u8::try_from(16 * high + low).unwrap_or(b'%'));
            rest = behind.get(2..).unwrap_or_default();
        } else {
            bytes.push(*first);
            rest = behind;
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::unescaped;

    #[test]
    fn escapes_stand_for_bytes() {
        for (uri, name) in
            [("a%20b.bin", "a b.bin"), ("%c3%A4", "ä"), ("5%", "5%"), ("%zz%4", "%zz%4"), ("", "")]
        {
            assert_eq!(unescaped(uri), name);
        }
    }
}
