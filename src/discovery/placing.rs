//! Side-cars of data that states its content, but not its place: `spacing` and `orientation` for PNG, TIFF and `.npy`.
//! See [`sidecar`](super::sidecar) for the language.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::InputFiles;
use super::item::Volumes;
use super::kind::ends_in;
use super::log::add_file;
use super::sidecar::{candidates, is_named_so, keys_of, longer, unparsed, with_unknown};
use crate::fault::{Fault, bad};
use crate::volume::{FileWatch, Placement, Result, SourceError, StatedBy, place};

/// A side-car of data that states the rest itself.
pub(super) struct PlacementSidecar {
    /// The side-car.
    pub(super) path: PathBuf,
    /// Its contents, or its fault.
    said: Result<(Placement, Vec<String>), Fault>,
}

/// Keys of a side-car that only places data.
const PLACING_KEYS: [&str; 4] = ["spacing", "spacing_mm", "orientation", "file"];

/// Endings of files that can be placed.
const PLACED: [&str; 4] = ["npy", "tif", "tiff", "png"];

/// Name of a side-car in the folder of the pictures, of any name.
const INSIDE: &str = "stack";

/// Reads a side-car that only places its data; `None` for any other text.
fn read_placing(path: &Path) -> Option<(PlacementSidecar, Option<String>)> {
    let keys = keys_of(path)?;
    if keys.describe_raw() || !keys.place() {
        return None;
    }
    let file = keys.file().ok().flatten();
    let said = keys.file().and_then(|_| Ok((keys.placement()?, keys.unknown(&PLACING_KEYS))));
    Some((PlacementSidecar { path: path.to_path_buf(), said }, file))
}

/// The side-car that places data: the first that does for the first of the paths, a file before its folder.
pub(super) fn placing_of(data: &[&Path]) -> Option<PlacementSidecar> {
    let of = |data: &&Path| {
        let mut inside = Vec::new();
        let whole = data.file_name().is_none().then(|| data.canonicalize().ok()).flatten();
        let data = whole.as_deref().unwrap_or(data);
        let name = data.file_name()?;
        if data.is_dir() {
            inside.extend(candidates(&data.join(name)));
            inside.extend(candidates(&data.join(INSIDE)));
        }
        candidates(data).into_iter().chain(inside).find_map(|path| {
            // An unreadable side-car with the name of the data counts, since it would have placed it.
            if let Some(unparsed) = unparsed(&path) {
                return Some(PlacementSidecar { path, said: Err(bad!("{unparsed}")) });
            }
            let (placing, file) = read_placing(&path)?;
            // Inside, the data is the folder, even if a file is stated.
            file.is_none_or(|file| name == OsStr::new(&file)).then_some(placing)
        })
    };
    data.iter().find_map(of)
}

/// True for a side-car that places existing data.
pub(super) fn places(path: &Path) -> bool {
    is_named_so(path) && read_placing(path).is_some() && may_place(path)
}

/// True if data that a side-car of this name may place lies next to it, or around it.
pub(super) fn may_place(path: &Path) -> bool {
    let has_pictures = |folder: &Path| {
        let is_picture = |entry: fs::DirEntry| ends_in(entry.file_name().as_ref(), &PLACED[1..]);
        fs::read_dir(folder).is_ok_and(|all| all.flatten().any(is_picture))
    };
    let (folder, stem) = (path.parent().unwrap_or(Path::new("")), path.file_stem());
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let inside = stem == Some(OsStr::new(INSIDE)) || (stem.is_some() && stem == folder.file_name());
    let beside = path.with_extension("");
    // `a.npy.json`, `a.json`; the stem may have dots of its own.
    (inside && has_pictures(folder))
        || has_pictures(&beside)
        || (ends_in(&beside, &PLACED) && beside.is_file())
        || PLACED.iter().any(|ending| longer(&beside, ending).is_file())
}

impl PlacementSidecar {
    /// Volumes where the side-car says. It counts among their files, so that a change of it is noticed.
    ///
    /// # Errors
    /// The side-car is faulty.
    pub(super) fn place(self, volumes: Volumes, files: &mut InputFiles) -> Volumes {
        let _missing = add_file(files, &self.path);
        let volumes = volumes?;
        let (placement, unknown) = self.said.map_err(|fault| SourceError::from(fault.at(&self.path)))?;
        let placed = |volume| {
            let volume = place(volume, placement, StatedBy::SideCar)?;
            Ok(with_unknown(FileWatch::description(volume, &self.path), &unknown, &PLACING_KEYS))
        };
        volumes.into_iter().map(placed).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn a_file_comes_before_its_folder_and_a_raw_side_car_is_another_thing() {
        let folder = tempfile::tempdir().unwrap();
        let pictures = folder.path().join("pictures");
        fs::create_dir(&pictures).unwrap();
        let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
        write("pictures/a.tif", "x");
        let file = pictures.join("a.tif");
        let found = || {
            placing_of(&[&file, &pictures]).map(|p| p.path.strip_prefix(folder.path()).unwrap().to_owned())
        };
        assert_eq!(found(), None);
        let says = r#"{"spacing": [1, 2, 3]}"#;
        // Names in rising precedence.
        for name in [
            "pictures/stack.toml",
            "pictures/stack.json",
            "pictures/pictures.json",
            "pictures.json",
            "pictures/a.json",
            "pictures/a.tif.json",
        ] {
            write(name, if name.ends_with("toml") { "spacing = [1, 2, 3]" } else { says });
            assert_eq!(found().as_deref(), Some(Path::new(name)));
            assert!(places(&folder.path().join(name)), "{name}");
        }
        write("pictures/a.tif.json", r#"{"spacing": [1, 2, 3], "file": "b.tif"}"#);
        assert_eq!(found().unwrap(), Path::new("pictures/a.json"));
        write("pictures/a.json", r#"{"dims": [1, 1, 1], "dtype": "u8", "spacing": [1, 2, 3]}"#);
        assert_eq!(found().unwrap(), Path::new("pictures.json"));
        write("pictures.json", r#"{"Modality": "CT"}"#);
        assert_eq!(found().unwrap(), Path::new("pictures/pictures.json"));
        write("lonely.json", says);
        assert!(!places(&folder.path().join("lonely.json")) && !places(&file));
    }

    #[test]
    fn damaged_texts_are_refused_or_no_side_cars() {
        let folder = tempfile::tempdir().unwrap();
        let good = [
            ("a.json", r#"{"spacing": [0.5, 0.5, 2], "orientation": "RAI", "file": "a.npy", "x": [{}]}"#),
            ("a.toml", "spacing = [0.5,\n 0.5, 2]\norientation = 'RAI'\nfile = \"a.npy\"\nx = 1\n"),
        ];
        let mut random = Random(7);
        let (mut sound, mut wrong) = (0, 0);
        for (name, text) in good {
            let path = folder.path().join(name);
            let mut look = |bytes: &[u8]| {
                fs::write(&path, bytes).unwrap();
                let Some((placing, _)) = read_placing(&path) else { return };
                match placing.said {
                    Ok((said, _)) => {
                        sound += 1;
                        assert!(
                            said.spacing_mm.is_none_or(|mm| mm.iter().all(|v| v.is_finite() && *v > 0.0))
                        );
                    }
                    Err(_) => wrong += 1,
                }
            };
            (0..=text.len()).for_each(|end| look(&text.as_bytes()[..end]));
            for _ in 0..1000 {
                let mut bytes = text.as_bytes().to_vec();
                for _ in 0..=random.below(3) {
                    let at = random.below(bytes.len());
                    bytes[at] = u8::try_from(random.below(256)).unwrap();
                }
                look(&bytes);
            }
        }
        assert!(sound > 100 && wrong > 10, "{sound} sound, {wrong} wrong");
    }
}
