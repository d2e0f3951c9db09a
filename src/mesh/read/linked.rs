//! Files that a mesh names: they lie in its folder, and links do not lead out of it.

use std::fs::File;
use std::path::{Component, Path, PathBuf};

use super::stop::Stop;
use crate::facts::MeshFault;
use crate::platform::{is_not_regular, open_file};
use crate::source::stays;

/// A file that the mesh at `mesh` names, its whole path and its length.
///
/// # Errors
/// It lies elsewhere, or links lead elsewhere and may not be followed, or it cannot be read.
pub(super) fn open_linked(mesh: &Path, name: &str, follow: bool) -> Result<(File, PathBuf, u64), Stop> {
    let relative = Path::new(name);
    let inside = relative.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if name.is_empty() {
        return Err(MeshFault::NoName.into());
    }
    if !inside {
        return Err(MeshFault::Outside { name: name.to_owned() }.into());
    }
    let path = mesh.parent().unwrap_or(Path::new("")).join(relative);
    if !follow && !stays(mesh, &path) {
        return Err(MeshFault::Linked { name: name.to_owned() }.into());
    }
    match open_file(&path).and_then(|file| Ok((file.metadata()?.len(), file))) {
        Ok((bytes, file)) => Ok((file, path, bytes)),
        Err(cause) if is_not_regular(&cause) => Err(MeshFault::NotRegular { name: name.to_owned() }.into()),
        Err(cause) => Err(MeshFault::Missing { name: name.to_owned(), why: cause.kind() }.into()),
    }
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
