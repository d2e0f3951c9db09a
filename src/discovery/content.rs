//! Names and copies of volumes by their content, independent of file names and places.

use std::io;
use std::path::{Path, PathBuf};

use crate::csg::named_files;
use crate::platform::PositionalFile;
use crate::source::{Finding, StableHash, Subject};
use crate::volume::VolumeInfo;

/// Bytes of a volume of one file that are hashed; several files share them.
const SAMPLE_BYTES: u64 = 256 << 10;
/// Least bytes of a file that are hashed: of its head, middle and end.
const MIN_BYTES: u64 = 3 * PIECE;
/// Bytes of a sample that are read at a time.
const PIECE: u64 = 4 << 10;
const LONG: u64 = 64 << 10;

/// Names files one after the other, in an order that is always the same.
pub(super) type EachFile<'a> = &'a dyn Fn(&mut dyn FnMut(&Path));

/// A hash of the lengths of files and of samples of their bytes, in twelve hex digits.
///
/// Samples are the head of each file, and pieces at even distances up to the end, where compressed files have their
/// checksums; 256 KiB of a single file, 12 KiB of each of many. Files that differ elsewhere only have one hash:
/// [`is_copy`] compares all of them.
///
/// # Errors
/// A file cannot be read.
pub(super) fn hash_of(files: EachFile<'_>) -> io::Result<String> {
    let mut count = 0_u64;
    files(&mut |_| count += 1);
    let room = (SAMPLE_BYTES / count.max(1)).max(MIN_BYTES);
    let mut hash = Ok(StableHash::new());
    files(&mut |path| {
        if let Ok(before) = hash.as_ref().copied() {
            hash = sampled(before, path, room);
        }
    });
    Ok(format!("{:012x}", hash?.finish() >> 16))
}

fn sampled(mut hash: StableHash, path: &Path, room: u64) -> io::Result<StableHash> {
    let file = PositionalFile::open(path)?;
    let length = file.metadata()?.len();
    hash = hash.number(length);
    let mut piece = [0; 4 << 10];
    let mut take = |hash: StableHash, at: u64| {
        let wanted = usize::try_from((length - at).min(PIECE)).unwrap_or(0);
        let part = piece.get_mut(..wanted).unwrap_or_default();
        file.read_exact_at(part, at)?;
        io::Result::Ok(hash.part(part))
    };
    let head = if length <= room { length } else { (room / 4).next_multiple_of(PIECE) };
    for k in 0..head.div_ceil(PIECE) {
        hash = take(hash, k * PIECE)?;
    }
    let pieces = if length <= room { 0 } else { (room - head) / PIECE };
    for k in 1..=pieces {
        // The last piece ends with the file.
        let span = u128::from(length - PIECE - head) * u128::from(k) / u128::from(pieces);
        hash = take(hash, head + u64::try_from(span).unwrap_or(0))?;
    }
    Ok(hash)
}

/// True if a subject is made of the same bytes as another, and placed alike. Two unusable ones are not copies.
/// Cost: all files of both are read, up to the first difference.
///
/// # Errors
/// A file cannot be read.
pub(super) fn is_copy(a: &Finding, b: &Finding) -> io::Result<bool> {
    let alike = match (&a.subject, &b.subject) {
        (Ok(Subject::Volume(one)), Ok(Subject::Volume(other))) => alike(one.info(), other.info()),
        (Ok(Subject::Mesh(_)), Ok(Subject::Mesh(_))) => a.format == b.format,
        (Ok(Subject::Tree(_)), Ok(Subject::Tree(_))) => true,
        _ => false,
    };
    if !alike {
        return Ok(false);
    }
    let (mine, others) = (listed(a)?, listed(b)?);
    if mine.len() != others.len() {
        return Ok(false);
    }
    for (one, other) in mine.iter().zip(&others) {
        if !same_bytes(one, other)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The files of a subject.
fn listed(finding: &Finding) -> io::Result<Vec<PathBuf>> {
    let mut files: Vec<PathBuf> = Vec::new();
    if finding.path.is_file() {
        files.push(finding.path.clone());
    }
    match &finding.subject {
        Ok(Subject::Volume(volume)) => volume.for_each_file(&mut |path| files.push(path.to_path_buf())),
        Ok(Subject::Tree(path)) => {
            // The tree was read already, within its bound on memory.
            files.extend(named_files(path, u64::MAX, true).map_err(io::Error::other)?);
        }
        Ok(Subject::Mesh(_)) | Err(_) => {}
    }
    Ok(files)
}

/// True if two volumes have the same size, type and place.
fn alike(a: &VolumeInfo, b: &VolumeInfo) -> bool {
    let facts = |i: &VolumeInfo| {
        (i.dims.to_array(), i.scalar.code(), [i.rescale.slope, i.rescale.intercept], i.affine.rows)
    };
    facts(a) == facts(b) && a.spacing_mm == b.spacing_mm && a.description.kind == b.description.kind
}

fn same_bytes(a: &Path, b: &Path) -> io::Result<bool> {
    let (a, b) = (PositionalFile::open(a)?, PositionalFile::open(b)?);
    let length = a.metadata()?.len();
    if b.metadata()?.len() != length {
        return Ok(false);
    }
    let (mut one, mut other) = (vec![0; 64 << 10], vec![0; 64 << 10]);
    let mut at = 0;
    while at < length {
        let n = usize::try_from((length - at).min(LONG)).unwrap_or(0);
        let (one, other) = (one.get_mut(..n).unwrap_or_default(), other.get_mut(..n).unwrap_or_default());
        a.read_exact_at(one, at)?;
        b.read_exact_at(other, at)?;
        if one != other {
            return Ok(false);
        }
        at += n as u64;
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_follow_content_and_order_and_no_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let put = |name: &str, bytes: &[u8]| std::fs::write(at(name), bytes).unwrap();
        let hash = |names: &[&str]| {
            let files: Vec<PathBuf> = names.iter().map(|name| at(name)).collect();
            hash_of(&|each| files.iter().for_each(|path| each(path))).unwrap()
        };
        let mut long: Vec<u8> = (0..3_000_000_u32).map(|i| (i / 7).to_le_bytes()[0]).collect();
        put("a", &long);
        put("b", &long);
        assert_eq!(hash(&["a"]), hash(&["b"]));
        assert!(same_bytes(&at("a"), &at("b")).unwrap());
        assert_eq!(hash(&["a"]).len(), 12);
        // The head, the end and the length count.
        for place in [0, 60_000, long.len() - 1] {
            long[place] ^= 1;
            put("b", &long);
            assert_ne!(hash(&["a"]), hash(&["b"]), "{place}");
            assert!(!same_bytes(&at("a"), &at("b")).unwrap());
            long[place] ^= 1;
        }
        put("b", &long[1..]);
        assert_ne!(hash(&["a"]), hash(&["b"]));
        // A single bit elsewhere does not count: only the comparison finds it.
        long[1_500_000] ^= 1;
        put("b", &long);
        assert_eq!(hash(&["a"]), hash(&["b"]));
        assert!(!same_bytes(&at("a"), &at("b")).unwrap());
        for (name, bytes) in [("x", &b"12"[..]), ("y", b"3"), ("none", b"")] {
            put(name, bytes);
        }
        let all = [hash(&["x", "y"]), hash(&["y", "x"]), hash(&["x"]), hash(&["none"]), hash(&[])];
        assert!(all.iter().enumerate().all(|(i, a)| all.iter().skip(i + 1).all(|b| a != b)), "{all:?}");
        assert!(hash_of(&|each| each(&at("missing"))).is_err());
    }
}
