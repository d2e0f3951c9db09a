//! The keys of a side-car, whichever language it is written in.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path};

use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::KEYS;
use crate::fault::{Fault, bad};
use crate::geom::{Dims, Orientation};
use crate::volume::{Endian, Placement, ScalarType};

/// Unknown keys that are named, and the letters of each.
const NAMED: (usize, usize) = (4, 40);

/// The contents of a side-car, key by key; values are judged when they are asked for.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(in crate::discovery) struct Keys {
    dims: Entry<Numbers>,
    dtype: Entry<String>,
    spacing: Entry<Numbers>,
    spacing_mm: Entry<Numbers>,
    skip: Entry<u64>,
    orientation: Entry<String>,
    file: Entry<String>,
    #[serde(flatten)]
    others: BTreeMap<String, IgnoredAny>,
}

/// The value of a key. One of a wrong type does not make the text unreadable: the key is named then.
#[derive(Debug, Default, Deserialize)]
#[serde(untagged)]
enum Entry<T> {
    #[default]
    #[serde(skip)]
    Missing,
    Value(T),
    Wrong(Value),
}

impl<T: Serialize> Entry<T> {
    fn is_stated(&self) -> bool {
        !matches!(self, Self::Missing)
    }

    /// Meaning of the value, nothing where the key is missing, or the fault of the key and its text.
    fn meaning<M>(&self, key: &str, mean: impl Fn(&T) -> Option<M>, due: &str) -> Result<Option<M>, Fault> {
        let text = match self {
            Self::Missing => return Ok(None),
            Self::Value(value) => match mean(value) {
                Some(meaning) => return Ok(Some(meaning)),
                None => serde_json::to_string(value),
            },
            Self::Wrong(value) => serde_json::to_string(value),
        };
        let text: String = text.unwrap_or_default().chars().take(NAMED.1).collect();
        Err(bad!("its {key} `{}` is not {due}", text.trim_matches('"').escape_debug()))
    }
}

/// Numbers as a list, or joined by `x`.
#[derive(Debug, Deserialize, Serialize)]
#[serde(untagged)]
enum Numbers {
    List(Vec<f64>),
    Joined(String),
}

impl Numbers {
    /// The list, if it has three finite numbers.
    fn three(&self) -> Option<[f64; 3]> {
        let parts = match self {
            Self::List(list) => list.clone(),
            Self::Joined(text) => {
                text.split('x').map(|part| part.trim().parse().ok()).collect::<Option<_>>()?
            }
        };
        <[f64; 3]>::try_from(parts).ok().filter(|v| v.iter().all(|n| n.is_finite()))
    }
}

impl Keys {
    /// Keys of a JSON object, or the error of the parser.
    pub(super) fn of_json(text: &str) -> Result<Self, String> {
        serde_json::from_slice(text.as_bytes()).map_err(|e| e.to_string())
    }

    /// Keys of a TOML text, as far as [`flat_toml`] reads it, or the reason why they cannot be parsed.
    pub(super) fn of_toml(text: &str) -> Result<Self, String> {
        let keys = flat_toml(text)?;
        match lost_in_toml(text, &keys) {
            Some((key, value)) => Err(format!(
                "the value of {key}, `{}`, is neither a string nor a number nor a list of these",
                value.escape_debug()
            )),
            None => serde_json::from_value(Value::Object(keys)).map_err(|e| e.to_string()),
        }
    }

    /// True if the keys describe raw data.
    pub(in crate::discovery) fn describe_raw(&self) -> bool {
        self.dims.is_stated() && self.dtype.is_stated()
    }

    /// The key that they lack to describe raw data, if they have the other one.
    pub(in crate::discovery) fn lacks(&self) -> Option<&'static str> {
        match (self.dims.is_stated(), self.dtype.is_stated()) {
            (true, false) => Some("dtype"),
            (false, true) => Some("dims"),
            _ => None,
        }
    }

    /// True if the keys state the place of data.
    pub(in crate::discovery) fn place(&self) -> bool {
        self.spacing.is_stated() || self.spacing_mm.is_stated() || self.orientation.is_stated()
    }

    /// Size in voxels.
    pub(super) fn dims(&self) -> Result<Dims, Fault> {
        let whole = |v: f64| -> Option<u32> {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "a whole number within u32, as has been checked"
            )]
            let side = (v.fract() == 0.0 && v >= 1.0 && v <= f64::from(u32::MAX)).then_some(v as u32);
            side
        };
        let sides = |numbers: &Numbers| {
            let [x, y, z] = numbers.three()?;
            Dims::new(whole(x)?, whole(y)?, whole(z)?)
        };
        let due = "three sizes in range; write for example [256, 256, 113]";
        self.dims.meaning("dims", sides, due)?.ok_or_else(|| bad!("it has no dims"))
    }

    /// Type and byte order of the samples.
    pub(super) fn dtype(&self) -> Result<(ScalarType, Endian), Fault> {
        let due = "known; write u8, i8, u16, i16, u32, i32, f32 or f64, with le or be";
        let samples = self.dtype.meaning("dtype", |name| ScalarType::parse(name), due)?;
        samples.ok_or_else(|| bad!("it has no dtype"))
    }

    /// Bytes at the head of every file.
    pub(super) fn skip(&self) -> Result<u64, Fault> {
        Ok(self.skip.meaning("skip", |skip| Some(*skip), "a number of bytes")?.unwrap_or(0))
    }

    /// Name of the data, where it is stated: one that cannot lead out of the folder.
    pub(in crate::discovery) fn file(&self) -> Result<Option<String>, Fault> {
        self.file.meaning("file", |name| is_plain(name).then(|| name.clone()), "a plain name")
    }

    /// Spacing and orientation, as far as they are stated.
    pub(in crate::discovery) fn placement(&self) -> Result<Placement, Fault> {
        let positive = |numbers: &Numbers| numbers.three().filter(|s| s.iter().all(|v| *v > 0.0));
        let due = "three positive numbers of mm; write for example [0.5, 0.5, 1.2]";
        let three = |entry: &Entry<Numbers>| match entry {
            Entry::Value(numbers) => numbers.three(),
            Entry::Missing | Entry::Wrong(_) => None,
        };
        let (one, other) = (&self.spacing, &self.spacing_mm);
        if one.is_stated() && other.is_stated() && three(one) != three(other) {
            return Err(bad!("its spacing and its spacing_mm differ; keep one of them"));
        }
        let (key, spacing) = if one.is_stated() { ("spacing", one) } else { ("spacing_mm", other) };
        let spacing_mm = spacing.meaning(key, positive, due)?;
        let letters = |letters: &String| Orientation::parse(letters);
        let orientation =
            self.orientation.meaning("orientation", letters, "three letters such as LPS or RAI")?;
        Ok(Placement { spacing_mm, orientation })
    }

    /// The first keys that are not known.
    pub(in crate::discovery) fn unknown(&self, known: &[&str]) -> Vec<String> {
        let raw = [
            ("dims", self.dims.is_stated()),
            ("dtype", self.dtype.is_stated()),
            ("skip", self.skip.is_stated()),
        ];
        let raw = raw.into_iter().filter(|(_, stated)| *stated).map(|(key, _)| key);
        let all: BTreeSet<&str> = self.others.keys().map(String::as_str).chain(raw).collect();
        let unknown = all.into_iter().filter(|key| !known.contains(key)).take(NAMED.0);
        unknown.map(|key| key.chars().take(NAMED.1).flat_map(char::escape_debug).collect()).collect()
    }
}

/// A name that cannot lead out of the folder.
fn is_plain(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None))
}

/// A key of a TOML text that matters and begins a line before the first table, and the rest of the line, where its
/// value cannot be read.
fn lost_in_toml<'a>(text: &'a str, keys: &Map<String, Value>) -> Option<(&'a str, String)> {
    let mut lines = text.lines().map(str::trim_start).take_while(|line| !line.starts_with('['));
    lines.find_map(|line| {
        let (key, value) = line.split_once('=')?;
        let key = key.trim().trim_matches('"');
        let lost = KEYS.contains(&key) && keys.get(key).is_none();
        lost.then(|| (key, value.trim().chars().take(NAMED.1).collect()))
    })
}

/// The keys of a TOML text before its first table. Strings, numbers and lists of these are read as JSON, from which
/// they differ in quotes and commas only; other values are left out.
fn flat_toml(text: &str) -> Result<Map<String, Value>, String> {
    let plain = |line: &str| {
        let mut quoted = false;
        let comment = line.char_indices().find(|(_, c)| {
            quoted ^= matches!(c, '"' | '\'');
            *c == '#' && !quoted
        });
        line.get(..comment.map_or(line.len(), |(at, _)| at)).unwrap_or_default().trim().to_owned()
    };
    let mut keys = Map::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let line = plain(line);
        if line.starts_with('[') {
            break;
        }
        let Some((key, value)) = line.split_once('=') else { continue };
        let mut value = value.trim().to_owned();
        while value.starts_with('[')
            && !value.ends_with(']')
            && let Some(more) = lines.next()
        {
            value.push_str(&plain(more));
        }
        let value = value.replace('\'', "\"").replace(" ]", "]").replace(",]", "]");
        if let Ok(value) = serde_json::from_slice(value.as_bytes()) {
            let key = key.trim().trim_matches('"');
            if keys.insert(key.to_owned(), value).is_some() {
                return Err(format!("`{}` is stated twice", key.escape_debug()));
            }
        }
    }
    Ok(keys)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn toml_is_read_as_far_as_side_cars_need_it() {
        let text = "# a head\n dims = [ # x first\n  2, 3,\n  4,\n ]\ndtype = 'u8' # \"#\"\nnote = \"a # b\"\n\
                    date = 2026-11-21\nskip = 7\n[table]\nskip = 9\n";
        let expected = serde_json::json!({"dims": [2, 3, 4], "dtype": "u8", "note": "a # b", "skip": 7});
        assert_eq!(Value::Object(flat_toml(text).unwrap()), expected);
        assert!(flat_toml("a = [1,\n\n= = =\n'").unwrap().is_empty());
        // Comment signs in an endless text: each is looked at once.
        let started = std::time::Instant::now();
        assert!(flat_toml(&format!("a = \"{}", "#".repeat(1 << 20))).unwrap().is_empty());
        assert!(flat_toml("skip = 1\n\"skip\" = 2\n").unwrap_err().contains("twice"));
        assert!(started.elapsed() < std::time::Duration::from_secs(2));
    }

    #[test]
    fn a_wrong_value_is_named_and_does_not_hide_the_others() {
        let keys =
            Keys::of_json(r#"{"dims": null, "dtype": 7, "skip": 7.5, "file": ["a"], "note": {"x": 1}}"#)
                .unwrap();
        assert!(keys.describe_raw() && !keys.place());
        assert_eq!(
            keys.dims().err(),
            Some(bad!("its dims `null` is not three sizes in range; write for example [256, 256, 113]"))
        );
        assert_eq!(
            keys.dtype().err(),
            Some(bad!(
                "its dtype `7` is not known; write u8, i8, u16, i16, u32, i32, f32 or f64, with le or be"
            ))
        );
        assert_eq!(keys.skip().err(), Some(bad!("its skip `7.5` is not a number of bytes")));
        assert_eq!(keys.file().err(), Some(bad!("its file `[\\\"a\\\"]` is not a plain name")));
        assert_eq!(keys.unknown(&["dims", "dtype", "skip", "file"]), ["note"]);
        assert_eq!(keys.unknown(&["file"]), ["dims", "dtype", "note", "skip"]);
        assert!(Keys::of_json("[]").is_err() && Keys::of_json("{} x").is_err());
        assert!(!Keys::of_json("{}").unwrap().describe_raw());
    }
}
