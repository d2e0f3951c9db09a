//! Meshes and trees of solids, recognised by content.

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::csg;
use crate::mesh;
use crate::platform::PositionalFile;
use crate::source::dicom::{Recognition, recognise};
use crate::source::{FORMATS, HEAD_BYTES, STACKS, SubjectKind};
use crate::synthetic::is_synthetic;
use crate::text::plain_head;

/// Kind of a file that is built on a grid of the caller's choice, by its first bytes and its length; by its name where
/// these leave it open.
pub(super) fn solid_kind(head: &[u8], bytes: u64, path: &Path) -> Option<SubjectKind> {
    let mesh = mesh::format_of(head, bytes, path).map(|_| SubjectKind::Mesh);
    mesh.or_else(|| csg::is_tree(head, path).then_some(SubjectKind::Tree))
}

/// Opens a file, and reads its first bytes.
///
/// # Errors
/// It cannot be read.
pub(super) fn open_with_head(path: &Path) -> io::Result<(PositionalFile, Vec<u8>)> {
    let file = PositionalFile::open(path)?;
    let mut head = Vec::with_capacity(HEAD_BYTES);
    file.onwards(0).take(HEAD_BYTES as u64).read_to_end(&mut head)?;
    Ok((file, head))
}

/// True if the name of a file has one of these extensions, in any case.
pub(super) fn ends_in(path: &Path, extensions: &[&str]) -> bool {
    path.extension().is_some_and(|own| extensions.iter().any(|e| own.eq_ignore_ascii_case(e)))
}

impl SubjectKind {
    /// Kind of some inputs: a mesh where all are files of meshes, a tree where one of them is one, a volume otherwise.
    /// The name of an unreadable file decides.
    pub fn of(inputs: &[PathBuf]) -> Self {
        match inputs {
            [] => Self::Volume,
            [only] => Self::of_file(only),
            several if several.iter().all(|path| Self::of_file(path) == Self::Mesh) => Self::Mesh,
            several if several.iter().any(|path| Self::of_file(path) == Self::Tree) => Self::Tree,
            _ => Self::Volume,
        }
    }

    fn of_file(path: &Path) -> Self {
        if is_synthetic(path) {
            return Self::Volume;
        }
        let opened = match fs::metadata(path) {
            // Opening a pipe could wait forever.
            Ok(meta) if !meta.is_file() => return Self::Volume,
            Ok(meta) => open_with_head(path).ok().map(|(file, head)| (meta.len(), file, head)),
            Err(_) => None,
        };
        let (bytes, head) = opened.as_ref().map_or((0, &[][..]), |(bytes, _, head)| (*bytes, head));
        let kind = solid_kind(head, bytes, path).or_else(|| mesh::is_named(path).then_some(Self::Mesh));
        let is_volume = |(_, file, head): &(u64, PositionalFile, Vec<u8>)| {
            !matches!(recognise(file), Recognition::Foreign)
                || FORMATS.iter().any(|format| (format.recognise)(&plain_head(head), path))
                || STACKS.iter().any(|format| (format.recognise)(head, path))
        };
        kind.filter(|_| !opened.as_ref().is_some_and(is_volume)).unwrap_or(Self::Volume)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{OpenOptions, Subject};

    #[test]
    fn content_comes_before_names_and_names_count_where_it_is_silent() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            fs::write(&path, bytes).unwrap();
            path
        };
        let kind = |name: &str, bytes: &[u8]| SubjectKind::of(&[put(name, bytes)]);
        let nrrd = b"NRRD0004\ntype: uint8\n";
        for (name, bytes, expected) in [
            ("a.stl", &b"solid a\nfacet normal 0 0 1\n"[..], SubjectKind::Mesh),
            ("part.dat", b"solid a\nfacet normal 0 0 1\n", SubjectKind::Mesh),
            ("part", b"OFF\n0 0 0\n", SubjectKind::Mesh),
            ("junk.stl", b"anything", SubjectKind::Mesh),
            ("junk.ply", b"anything", SubjectKind::Mesh),
            ("b.stl", nrrd, SubjectKind::Volume),
            ("a.csg", b"sphere(r = 3);", SubjectKind::Tree),
            ("tree.txt", b"// by hand\n/* two */ %difference() { cube(3); }", SubjectKind::Tree),
            ("junk.csg", b"\xff\xfe\x00", SubjectKind::Tree),
            ("program.scad", b"w = 5; cube(w);", SubjectKind::Tree),
            ("b.csg", nrrd, SubjectKind::Volume),
            ("code.js", b"call(3);", SubjectKind::Volume),
            ("cube.raw", b"cube", SubjectKind::Volume),
        ] {
            assert_eq!(kind(name, bytes), expected, "{name}");
        }
        let at = |names: &[&str]| names.iter().map(|name| folder.path().join(name)).collect::<Vec<_>>();
        assert_eq!(SubjectKind::of(&at(&["a.stl", "part"])), SubjectKind::Mesh);
        assert_eq!(SubjectKind::of(&at(&["a.stl", "b.stl"])), SubjectKind::Volume);
        assert_eq!(SubjectKind::of(&at(&["a.stl", "a.csg"])), SubjectKind::Tree);
        // Missing files, and folders.
        let missing = ["x.stl", "x.csg", "x.nrrd"].map(|name| SubjectKind::of(&at(&[name])));
        assert_eq!(missing, [SubjectKind::Mesh, SubjectKind::Tree, SubjectKind::Volume]);
        fs::create_dir(folder.path().join("d.stl")).unwrap();
        assert_eq!(SubjectKind::of(&at(&["d.stl"])), SubjectKind::Volume);
        let several = Subject::open(&at(&["a.csg", "tree.txt"]), &OpenOptions::default());
        assert!(several.err().unwrap().to_string().contains("built by itself"));
    }
}
