//! Volumes described, or only placed, by a small text file next to them.
//!
//! `head.json` or `head.toml` (or `head.raw.json`) describes `head.raw`, with any ending of the data,
//! or a folder `head` of slice files. The same keys in both languages:
//!
//! | key | value | if missing |
//! |---|---|---|
//! | `dims` | `[256, 256, 113]` or `"256x256x113"`, x fastest | it is not a side-car |
//! | `dtype` | `"u8"`, `"i16le"`, `"i16be"`, `"f32"`, ... | it is not a side-car |
//! | `spacing`, `spacing_mm` | `[0.5, 0.5, 1.2]` or `"0.5x0.5x1.2"`, mm | 1 mm |
//! | `skip` | bytes at the head of every file | 0 |
//! | `orientation` | three letters such as `"LPS"` | `LPS` |
//! | `file` | name of the data, in the same folder | the file or folder of the same stem, of several the one of the
//! described length |
//!
//! Files that state their content, but not their place, need less: `stack.json` with `spacing` or `orientation` (and
//! without `dims` and `dtype`) states these for `stack.npy`, `stack.tif`, or a folder `stack` of PNG or TIFF files;
//! `file` may name the data again, and other keys mean nothing. For pictures it may also lie in their folder, under the
//! folder's name or as `stack.json`. Spacing that a TIFF states itself is replaced, with a warning; formats that always
//! state theirs have no side-cars.
//!
//! Other keys are named in a warning, in case one is misspelt. Of several side-cars of the same data the one with the
//! longer name counts, then JSON before TOML. TOML is read up to the first table, with strings, numbers and lists as
//! values; that needs no parser of the whole language, whose code would count as memory.

mod keys;

use std::ffi::OsStr;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::placing;
use crate::fault::{Fault, bad};
use crate::geom::Orientation;
use crate::platform::PositionalFile;
use crate::source::{OpenOptions, RawOptions, RawVolume, stays};
use crate::text::names::FOLLOW_LINKS;
use crate::text::{mark_bytes, plain_head};
use crate::volume::{InfoOverride, Note, Placement, Result, SourceError, VolumeSource};
pub(super) use keys::Keys;

/// Longest text that is looked at.
const MAX_BYTES: u64 = 64 << 10;

/// The contents of a side-car of raw data.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sidecar {
    /// Options for reading the data.
    pub(super) options: RawOptions,
    /// Name of the data in the same folder, where it is stated.
    pub(super) file: Option<String>,
    /// Keys without a meaning, as many as are named.
    unknown: Vec<String>,
    /// The options that are stated, and not the default.
    stated: Placement,
}

/// Keys with a meaning.
const KEYS: [&str; 7] = ["dims", "dtype", "spacing", "spacing_mm", "skip", "orientation", "file"];

/// True if a name ends like a side-car's.
pub(super) fn is_named_so(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "json" || e == "toml")
}

/// Reads a side-car; `None` for any other file (no `dims` and `dtype`), the reason for one whose
/// values are wrong.
pub(super) fn read(path: &Path) -> Option<Result<Sidecar>> {
    let keys = keys_of(path)?;
    keys.describe_raw().then(|| Sidecar::of(&keys).map_err(|fault| unusable(path, fault)))
}

fn unusable(path: &Path, fault: Fault) -> SourceError {
    fault.at(path).into()
}

/// The keys of a text, if it can be parsed.
pub(super) fn keys_of(path: &Path) -> Option<Keys> {
    parse(path, &text_of(path)?.ok()?).ok()
}

/// The keys of a text, or the reason why it cannot be parsed.
fn parse(path: &Path, bytes: &[u8]) -> Result<Keys, String> {
    let mark = mark_bytes(bytes).map_err(|wide| wide.to_string())?;
    let text = String::from_utf8_lossy(bytes.get(mark..).unwrap_or_default());
    let is_toml = path.extension().is_some_and(|e| e == "toml");
    if is_toml { Keys::of_toml(&text) } else { Keys::of_json(&text) }
}

/// The bytes of a text that is short enough for a side-car, or the error of reading it.
fn text_of(path: &Path) -> Option<io::Result<Vec<u8>>> {
    // Opening a pipe could wait forever.
    fs::metadata(path).ok().filter(|meta| meta.is_file() && meta.len() <= MAX_BYTES)?;
    let mut text = Vec::new();
    let read =
        PositionalFile::open(path).and_then(|file| file.onwards(0).take(MAX_BYTES).read_to_end(&mut text));
    Some(read.map(|_| text))
}

/// The fault of a text that cannot be parsed and seems a side-car, as it mentions `dims` or `dtype` and lies next to
/// data of its stem; an unreadable text may mention them.
pub(super) fn unparsed(path: &Path) -> Option<String> {
    let text = text_of(path)?;
    let plain = text.as_deref().map(plain_head).unwrap_or_default();
    let mentions =
        |word: &str| text.is_err() || plain.windows(word.len()).any(|part| part == word.as_bytes());
    let raw = (mentions("dims") || mentions("dtype")) && data_of(path).is_some();
    if !raw && !((mentions("spacing") || mentions("orientation")) && placing::may_place(path)) {
        return None;
    }
    let what = if raw { "side-car of raw data" } else { "side-car" };
    match text.map(|text| parse(path, &text)) {
        Ok(Ok(_)) => None,
        Ok(Err(at)) => Some(format!("{what} that cannot be parsed: {at}")),
        Err(cause) => Some(format!("{what} that cannot be read: {cause}")),
    }
}

/// The missing key of a text that seems a side-car of raw data and lies next to data of its stem.
pub(super) fn incomplete(path: &Path) -> Option<String> {
    let key = keys_of(path)?.lacks()?;
    data_of(path).map(|_| {
        format!("side-car of raw data without the key {key}; add it, and check how the others are spelt")
    })
}

/// The fault of a side-car next to a file of samples, if there is one: a correct side-car would have been read.
pub(super) fn wrong_beside(data: &Path) -> Option<SourceError> {
    let plain = data.with_file_name(data.file_name().unwrap_or_default());
    let mut named =
        ["json", "toml"].into_iter().flat_map(|ending| [data.with_extension(ending), longer(&plain, ending)]);
    named.find_map(|path| match read(&path) {
        Some(Err(error)) => Some(error),
        Some(Ok(_)) => None,
        None => {
            let at = unparsed(&path).or_else(|| incomplete(&path))?;
            Some(unusable(&path, bad!("{at}")))
        }
    })
}

impl Sidecar {
    fn of(keys: &Keys) -> Result<Self, Fault> {
        let dims = keys.dims()?;
        let (scalar, endian) = keys.dtype()?;
        let stated = keys.placement()?;
        let skip = keys.skip()?;
        let spacing_mm = stated.spacing_mm.unwrap_or([1.0; 3]);
        let orientation = stated.orientation.unwrap_or(Orientation::LPS);
        let file = keys.file()?;
        let options = RawOptions { dims, scalar, endian, spacing_mm, skip, orientation };
        Ok(Self { options, file, unknown: keys.unknown(&KEYS), stated })
    }

    /// The data of the stem; of several files the one of the described length.
    ///
    /// # Errors
    /// Several files have that length.
    fn only_data(&self, path: &Path) -> Result<Option<PathBuf>> {
        let all = all_data_of(path);
        let is_due =
            |data: &&PathBuf| RawVolume::described(&[(*data).clone()], &self.options, Some(path)).is_ok();
        let due: Vec<&PathBuf> = if all.len() > 1 { all.iter().filter(is_due).collect() } else { Vec::new() };
        if let [first, second, ..] = due.as_slice() {
            let [first, second] = [first, second].map(|data| {
                data.file_name().unwrap_or_default().to_string_lossy().escape_debug().to_string()
            });
            return Err(unusable(
                path,
                bad!("describes {first} as well as {second}; name one of them with the key file"),
            ));
        }
        Ok(due.first().copied().or(all.first()).cloned())
    }
}

/// A volume whose notes name keys that are not known.
pub(super) fn with_unknown(
    volume: Box<dyn VolumeSource>,
    unknown: &[String],
    known: &'static [&'static str],
) -> Box<dyn VolumeSource> {
    if unknown.is_empty() {
        return volume;
    }
    InfoOverride::with_note(
        volume,
        Note::new(format!(
            "the side-car has keys that are not known: {}; known are {}",
            unknown.join(", "),
            known.join(", ")
        )),
    )
}

/// A path with one more ending.
pub(super) fn longer(path: &Path, ending: &str) -> PathBuf {
    let mut longer = path.as_os_str().to_owned();
    longer.push(".");
    longer.push(ending);
    longer.into()
}

/// Side-cars that could describe a file or folder, by their names; the first that does counts.
pub(super) fn candidates(data: &Path) -> [PathBuf; 4] {
    let exact = |ending| longer(data, ending);
    let by_stem = |ending| data.with_extension(ending);
    [exact("json"), exact("toml"), by_stem("json"), by_stem("toml")]
}

/// The side-car of a file or folder.
pub(super) fn of(data: &Path) -> Option<PathBuf> {
    candidates(data).into_iter().find(|sidecar| match read(sidecar) {
        Some(Ok(found)) => found.file.is_none_or(|name| data.file_name() == Some(OsStr::new(&name))),
        Some(Err(_)) => true,
        None => false,
    })
}

/// True if another side-car of the same data takes precedence.
pub(super) fn is_outdone(path: &Path) -> bool {
    let data = match read(path) {
        Some(Ok(Sidecar { file: Some(name), .. })) => Some(path.with_file_name(name)),
        _ => data_of(path),
    };
    // One of another name that states its data does not replace that next to the data: both count.
    data.is_some_and(|data| {
        candidates(&data).iter().any(|candidate| candidate == path)
            && of(&data).is_some_and(|first| first != path)
    })
}

/// True if a file or folder is the data of a side-car next to it.
pub(super) fn describes(data: &Path) -> bool {
    of(data).is_some()
}

/// Opens the volume that a side-car describes, placed by the options where the side-car does not say; `asked` is the file
/// of samples where the side-car names none.
///
/// # Errors
/// The side-car is faulty, or its data is missing, of another length, or one of several.
pub(super) fn open(path: &Path, asked: Option<&Path>, how: &OpenOptions) -> Result<Box<dyn VolumeSource>> {
    let sidecar =
        read(path).ok_or_else(|| unusable(path, bad!("is not a description of a raw volume any more")))??;
    let data = match (&sidecar.file, asked) {
        (Some(name), _) => path.with_file_name(name),
        (None, Some(asked)) => asked.to_path_buf(),
        (None, None) => sidecar.only_data(path)?.ok_or_else(|| unusable(path, bad!("describes a raw volume, but no data file with the same stem is in its folder; name it with the key file")))?,
    };
    if !how.follow_links && !stays(path, &data) {
        let data = data.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        return Err(unusable(
            path,
            bad!(
                "its data `{}` is a link that leads out of the folder of the side-car; put the data there, or add {FOLLOW_LINKS}",
                data.escape_debug()
            ),
        ));
    }
    let placement = sidecar.stated.or(how.placement);
    let options = &RawOptions {
        spacing_mm: placement.spacing_mm.unwrap_or(sidecar.options.spacing_mm),
        orientation: placement.orientation.unwrap_or(sidecar.options.orientation),
        ..sidecar.options
    };
    let volume = RawVolume::described(&[data], options, Some(path))?;
    Ok(with_unknown(Box::new(volume), &sidecar.unknown, &KEYS))
}

/// The file or folder of the same stem; of several the first by name.
pub(super) fn data_of(sidecar: &Path) -> Option<PathBuf> {
    all_data_of(sidecar).into_iter().next()
}

/// The files or the folder of the same stem, by name.
fn all_data_of(sidecar: &Path) -> Vec<PathBuf> {
    let Some(stem) = sidecar.file_stem() else { return Vec::new() };
    let exact = sidecar.with_file_name(stem);
    // `head.raw.json` means `head.raw`, `head.json` a folder `head`.
    if exact.exists() {
        return vec![exact];
    }
    let folder = sidecar.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = PathBuf::from(entry.file_name());
        let path = sidecar.with_file_name(&name);
        if name.file_stem() == Some(stem)
            && !is_named_so(&name)
            && !name.extension().is_some_and(|e| e == "oct" || e == "png")
            && path.is_file()
        {
            found.push(path);
        }
    }
    found.sort_unstable();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::discovery::Catalogue;
    use crate::discovery::NotVolume;
    use crate::source::{Finding, OpenOptions};
    use crate::volume::{Endian, ScalarType};

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_no_side_car() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("a.json");
        crate::platform::make_pipe(&pipe);
        assert!(read(&pipe).is_none() && !describes(&folder.path().join("a.raw")));
    }

    #[test]
    fn both_languages_and_both_forms_say_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let of = |name: &str, text: &str| {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            read(&path)
        };
        let json = r#"{"dims": [2, 3, 4], "dtype": "i16be", "spacing": "0.5x0.5x2", "skip": 7, "orientation": "RAI",
                      "note": [1]}"#;
        let toml = "dims = \"2x3x4\"\ndtype = \"i16be\"\nspacing = [0.5, 0.5, 2]\nskip = 7\norientation = \"RAI\"\nnote = [1]\n";
        let (a, b) = (of("a.json", json).unwrap().unwrap(), of("a.toml", toml).unwrap().unwrap());
        assert_eq!(a, b);
        assert_eq!(a.unknown, ["note"]);
        assert_eq!(
            (a.options.dims.to_array(), a.options.endian, a.options.skip),
            ([2, 3, 4], Endian::Big, 7)
        );
        assert_eq!((a.options.spacing_mm, a.options.scalar), ([0.5, 0.5, 2.0], ScalarType::I16));
        for other in ["{}", "[]", "no json", r#"{"dims": [1, 1, 1]}"#, ""] {
            assert!(of("b.json", other).is_none(), "{other}");
        }
        for (wrong, word) in [
            (r#"{"dims": [1, 1], "dtype": "u8"}"#, "dims"),
            (r#"{"dims": [1, 1.5, 1], "dtype": "u8"}"#, "dims"),
            (r#"{"dims": [1, 1, 1e30], "dtype": "u8"}"#, "dims"),
            (r#"{"dims": [1, 1, 1], "dtype": "u7"}"#, "dtype"),
            (r#"{"dims": [1, 1, 1], "dtype": "u8", "spacing": [1, 0, 1]}"#, "spacing"),
            (r#"{"dims": [1, 1, 1], "dtype": "u8", "skip": -1}"#, "skip"),
            (r#"{"dims": [1, 1, 1], "dtype": "u8", "file": "../x"}"#, "file"),
        ] {
            let error = of("c.json", wrong).unwrap().unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn spacing_has_two_names_and_unknown_keys_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a.raw"), [1; 8]).unwrap();
        let opened = |more: &str| {
            let text = format!(r#"{{"dims": [2, 2, 2], "dtype": "u8"{more}}}"#);
            fs::write(at("a.json"), text).unwrap();
            open(&at("a.json"), None, &OpenOptions::default()).map(|v| v.info().clone())
        };
        let info = opened(r#", "spacing_mm": [1, 2, 3]"#).unwrap();
        assert_eq!((info.spacing_mm, info.notes.len()), ([1.0, 2.0, 3.0], 0));
        let twice = opened(r#", "spacing_mm": [1, 2, 3], "spacing": "1x2x3""#).unwrap();
        assert_eq!(twice.spacing_mm, [1.0, 2.0, 3.0]);
        let differ = opened(r#", "spacing_mm": [1, 2, 3], "spacing": [1, 1, 1]"#).unwrap_err().to_string();
        assert!(differ.contains("spacing_mm differ"), "{differ}");
        let misspelt = opened(r#", "spaceing": [1, 2, 3], "no\nte": 1"#).unwrap();
        let [note] = misspelt.notes.as_slice() else { panic!("{:?}", misspelt.notes) };
        let text = note.to_string();
        for words in ["spaceing", "no\\nte", "spacing_mm", "orientation"] {
            assert!(text.contains(words), "{text}");
        }
    }

    #[test]
    fn a_wrong_size_names_the_side_car_and_the_key() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a.json"), r#"{"dims": [2, 2, 3], "dtype": "u16", "skip": 5}"#).unwrap();
        for (bytes, key) in [(12 + 5, "dtype"), (24 + 5 + 3, "skip"), (100, "dims"), (7, "dims")] {
            fs::write(at("a.raw"), vec![1; bytes]).unwrap();
            let text = open(&at("a.json"), None, &OpenOptions::default()).err().unwrap().to_string();
            let good = text.contains("a.json") && text.contains("a.raw") && !text.contains("--");
            assert!(good && text.contains(&format!("correct the key {key},")), "{text}");
        }
        fs::create_dir(at("s")).unwrap();
        fs::write(at("s/1"), [1; 4]).unwrap();
        fs::write(at("s.json"), r#"{"dims": [2, 2, 2], "dtype": "u8"}"#).unwrap();
        let text = open(&at("s.json"), None, &OpenOptions::default()).err().unwrap().to_string();
        assert!(text.contains("s.json") && text.contains("the key dims") && !text.contains("--"), "{text}");
    }

    #[test]
    fn of_two_side_cars_the_longer_name_counts_and_broken_ones_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let text = r#"{"dims": [2, 2, 2], "dtype": "u8"}"#;
        for name in ["a.raw", "b.raw", "c.raw"] {
            fs::write(at(name), [1; 8]).unwrap();
        }
        for name in ["a.json", "a.raw.json"] {
            fs::write(at(name), text).unwrap();
        }
        fs::write(at("b.json"), r#"{"dims": [2, 2, 2] "dtype": "u8"}"#).unwrap();
        fs::write(at("c.toml"), "dims = [2, 2\ndtype = 'u8'\n").unwrap();
        // Neither has anything to do with volumes.
        fs::write(at("d.json"), r#"{"dims": "#).unwrap();
        fs::write(at("notes.json"), "{").unwrap();
        let options = OpenOptions::default();
        let found = Catalogue::survey(&[folder.path().to_path_buf()], &options, folder.path()).unwrap();
        let findings: Vec<Finding> = (0..found.len()).flat_map(|i| found.open(i)).collect();
        let [only] = findings.as_slice() else { panic!("{findings:?}") };
        assert!(only.path.ends_with("a.raw.json") && only.subject.is_ok(), "{only:?}");
        for (name, words) in [
            ("a.json", "another side-car"),
            ("b.json", "cannot be parsed: expected"),
            ("c.toml", "cannot be parsed: the value of dims"),
        ] {
            let left = found.left_out().iter().find(|l| l.first.ends_with(name));
            assert!(
                left.is_some_and(|l| l.why.to_string().contains(words)),
                "{name}: {:?}",
                found.left_out()
            );
        }
        let others: Vec<_> = found
            .left_out()
            .iter()
            .filter(|l| matches!(l.why, NotVolume::Unknown | NotVolume::Headerless))
            .collect();
        assert_eq!(others.iter().map(|l| l.count).sum::<u64>(), 4, "b.raw, c.raw, d.json, notes.json");
    }

    #[test]
    fn the_data_is_found_by_stem_or_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let text = r#"{"dims": [2, 2, 2], "dtype": "u8"}"#;
        fs::write(at("a.json"), text).unwrap();
        assert!(
            open(&at("a.json"), None, &OpenOptions::default())
                .err()
                .unwrap()
                .to_string()
                .contains("no data file with the same stem")
        );
        fs::write(at("a.raw"), [1; 8]).unwrap();
        fs::write(at("a.oct"), [1; 9]).unwrap();
        assert!(describes(&at("a.raw")) && !describes(&at("b.raw")));
        assert_eq!(open(&at("a.json"), None, &OpenOptions::default()).unwrap().info().dims.voxels(), 8);
        fs::write(at("b.json"), r#"{"dims": [2, 2, 2], "dtype": "u8", "file": "other"}"#).unwrap();
        fs::write(at("b.raw"), [1; 8]).unwrap();
        assert!(!describes(&at("b.raw")));
        assert!(
            open(&at("b.json"), None, &OpenOptions::default()).err().unwrap().to_string().contains("other")
        );
        fs::create_dir(at("s")).unwrap();
        fs::write(at("s/1"), [1; 4]).unwrap();
        fs::write(at("s/2"), [1; 4]).unwrap();
        fs::write(at("s.toml"), "dims = [2, 2, 2]\ndtype = \"u8\"").unwrap();
        assert!(describes(&at("s")) && open(&at("s.toml"), None, &OpenOptions::default()).is_ok());
        // Several files of the stem: the described length decides, or the given name.
        fs::write(at("a.dat"), [0; 9]).unwrap();
        assert!(open(&at("a.json"), None, &OpenOptions::default()).is_ok());
        fs::write(at("a.dat"), [0; 8]).unwrap();
        let told = open(&at("a.json"), None, &OpenOptions::default()).err().unwrap().to_string();
        assert!(told.contains("a.dat as well as a.raw"), "{told}");
        for (name, due) in [("a.raw", 1), ("a.dat", 0)] {
            let asked = at(name);
            let volume = open(&at("a.json"), Some(&asked), &OpenOptions::default()).unwrap();
            let mut row = [7; 2];
            volume.read_rows(0, 0..1, 0..2, &mut row).unwrap();
            assert_eq!(row, [due; 2], "{name}");
        }
    }
}
