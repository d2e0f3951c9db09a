//! Paths and sentences as they are reported: relative to what was searched, words of patients masked.

use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::catalogue::{Catalogue, LeftOut, PatientWords};

/// Paths as they are reported: relative to what was searched, words of patients masked.
///
/// The words of all patients of the search are masked in every part of every path. In sentences a word is left
/// where it stands alone and is one of our own, as `series` is, or a short number: a patient called Series does
/// not make reports illegible.
pub(super) struct Masked<'a> {
    keep: bool,
    inputs: &'a [PathBuf],
    /// The inputs as they are called: `.` and `..` have a name, too.
    names: Vec<PathBuf>,
    words: &'a PatientWords,
}

/// What stands in the place of a patient's name.
const MASK: &str = "[name]";

/// Words of our own sentences, each on a line of its own.
const VOCABULARY: &str = include_str!("vocabulary.txt");

/// Digits of the longest number that is left in sentences: sizes, counts and tags are shorter than identifiers.
const LONGEST_NUMBER: usize = 5;

impl<'a> Masked<'a> {
    pub(super) fn new(keep: bool, inputs: &'a [PathBuf], words: &'a PatientWords) -> Self {
        let name = |input: &PathBuf| match input.file_name() {
            Some(_) => input.clone(),
            None => input.canonicalize().unwrap_or_else(|_| input.clone()),
        };
        Self { keep, inputs, names: inputs.iter().map(name).collect(), words }
    }

    /// A path for a report.
    pub(super) fn path(&self, path: &Path, secrets: &[String]) -> String {
        let text = self.relative(path).display().to_string();
        let text = if text.is_empty() { ".".into() } else { text };
        self.masked(text.trim_end_matches('/'), secrets)
    }

    /// A path relative to what was searched, as it is.
    pub(super) fn relative(&self, path: &Path) -> PathBuf {
        let inside = self.inputs.iter().enumerate().find_map(|(at, input)| {
            let rest = path.strip_prefix(input).ok()?;
            // The name of a single searched folder says nothing; that of one of several does.
            let own = self.name_of(at).filter(|_| self.inputs.len() > 1 || rest.as_os_str().is_empty());
            Some(own.map_or_else(|| rest.to_path_buf(), |own| own.join(rest)))
        });
        inside.unwrap_or_else(|| path.to_path_buf())
    }

    /// A path that tells a file from all others, whatever else is searched: never for a report.
    ///
    /// It begins with the name of the searched folder, and not with where that lies: a folder may be moved, and
    /// folders that are searched one after the other, into one folder of results, may hold files of one name.
    pub(super) fn identity(&self, path: &Path) -> PathBuf {
        let inside = self.inputs.iter().enumerate().find_map(|(at, input)| {
            Some(self.name_of(at).unwrap_or_default().join(path.strip_prefix(input).ok()?))
        });
        inside.unwrap_or_else(|| path.to_path_buf())
    }

    /// The end of a searched path, as long as it takes to tell it from the others.
    fn name_of(&self, at: usize) -> Option<PathBuf> {
        let input = self.names.get(at)?;
        input.file_name()?;
        let alike =
            |other: &Path, n: usize| other.components().rev().take(n).eq(input.components().rev().take(n));
        let alone = |n: &usize| !self.names.iter().any(|other| other != input && alike(other, *n));
        let all = input.components().count();
        let n = (1..all).find(alone).unwrap_or(all);
        Some(input.components().skip(all - n).collect())
    }

    /// A sentence for a report: sentences begin with a path, whose searched folder is cut off too.
    pub(super) fn text(&self, text: String, secrets: &[String]) -> String {
        let inside = self.inputs.iter().enumerate().find_map(|(at, input)| {
            let rest = text.strip_prefix(input.to_str()?.trim_end_matches('/'))?;
            let own = self.name_of(at).map(|name| name.display().to_string()).unwrap_or_default();
            match rest.strip_prefix('/') {
                Some(rest) if self.inputs.len() == 1 => Some(rest.to_owned()),
                _ if rest.starts_with([':', '/']) && !own.is_empty() => Some(own + rest),
                _ => None,
            }
        });
        match &inside {
            _ if self.keep => inside.unwrap_or(text),
            // The path is over where the reason begins.
            Some(inside) => match inside.split_once(": ") {
                Some((path, reason)) => {
                    format!("{}: {}", self.masked(path, secrets), self.sentence(reason, secrets))
                }
                None => self.masked(inside, secrets),
            },
            None => self.sentence(&text, secrets),
        }
    }

    fn masked(&self, path: &str, secrets: &[String]) -> String {
        if self.keep { path.to_owned() } else { self.words.masked(path, secrets, MASK, &|_, _| false) }
    }

    fn sentence(&self, text: &str, secrets: &[String]) -> String {
        self.words.masked(text, secrets, MASK, &is_our_own)
    }
}

/// Does one of our own words, or a short number, stand alone at a place of a sentence?
fn is_our_own(text: &str, at: Range<usize>) -> bool {
    let (Some(before), Some(found), Some(behind)) =
        (text.get(..at.start), text.get(at.clone()), text.get(at.end..))
    else {
        return false;
    };
    // A name may be a part of a word: Head of `header`.
    let is_word = found.chars().all(char::is_alphabetic);
    let letter = |c: char| is_word && c.is_alphabetic();
    let (before, behind) = (before.trim_end_matches(letter), behind.trim_start_matches(letter));
    let Some(word) = text.get(before.len()..text.len() - behind.len()) else { return false };
    let before = before.strip_suffix("--").unwrap_or(before).chars().next_back();
    let mut behind = behind.chars();
    let (next, then) = (behind.next(), behind.next());
    let is_number = word.len() <= LONGEST_NUMBER && word.bytes().all(|b| b.is_ascii_digit());
    // `512x512`, `(0020,0012)`; a full stop ends a sentence, or begins the ending of a file's name.
    let sign = |c: char| c.is_whitespace() || "(),:;=".contains(c) || (is_number && "x.".contains(c));
    let ends = |c: char| sign(c) || (c == '.' && then.is_none_or(char::is_whitespace));
    before.is_none_or(sign)
        && next.is_none_or(ends)
        && (is_number || VOCABULARY.lines().any(|own| own == word))
}

/// Files that are no volume, for a report: reason, how many, the first.
///
/// They belong to no series, but lie in the same folders: what the series tell of patients is masked in them too.
pub(super) struct LeftOuts(Vec<(String, u64, String)>);

impl LeftOuts {
    pub(super) fn new(masked: &Masked<'_>, catalogue: &Catalogue) -> Self {
        let line = |l: &LeftOut| (l.why.to_string(), l.count, masked.path(&l.first, &[]));
        Self(catalogue.left_out().iter().map(line).collect())
    }

    /// Takes note of a patient's names.
    pub(super) fn hide(&mut self, masked: &Masked<'_>, secrets: &[String]) {
        for (_, _, first) in &mut self.0 {
            *first = masked.masked(first, secrets);
        }
    }

    pub(super) fn into_lines(self) -> Vec<(String, u64, String)> {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_relative_and_names_masked_in_any_case() {
        let inputs = [PathBuf::from("/data/in")];
        let none = PatientWords::default();
        let masked = Masked::new(false, &inputs, &none);
        let secrets = ["Müller".to_owned(), "ANNA".to_owned()];
        assert_eq!(masked.path(Path::new("/data/in/Anna_x/ct"), &secrets), "[name]_x/ct");
        assert_eq!(masked.path(Path::new("/data/in"), &secrets), "in");
        assert_eq!(
            masked.text("/data/in/annA/1.dcm: bad Müller".into(), &secrets),
            "[name]/1.dcm: bad [name]"
        );
        assert_eq!(masked.path(Path::new("/data/in/MÜLLER.nii"), &secrets), "[name].nii");
        assert_eq!(masked.text("/data/in: nothing".into(), &secrets), "in: nothing");
        assert_eq!(masked.text("/data/inner/x: no".into(), &secrets), "/data/inner/x: no");
        let inputs = ["/x/data", "/y/data", "/y/more"].map(PathBuf::from);
        let several = Masked::new(false, &inputs, &none);
        assert_eq!(several.path(Path::new("/x/data/a.nii"), &[]), "x/data/a.nii");
        assert_eq!(several.path(Path::new("/y/more/a.nii"), &[]), "more/a.nii");
        assert_eq!(several.text("/y/data/a.nii: no".into(), &[]), "y/data/a.nii: no");
        let inputs = [PathBuf::from("/data/in")];
        let kept = Masked::new(true, &inputs, &none);
        assert_eq!(kept.path(Path::new("/data/in/Anna"), &secrets), "Anna");
        assert_eq!(kept.path(Path::new("/else/Anna"), &secrets), "/else/Anna");
    }

    #[test]
    fn sentences_keep_our_own_words_and_paths_do_not() {
        let inputs = [PathBuf::from("/data/in/")];
        let none = PatientWords::default();
        let masked = Masked::new(false, &inputs, &none);
        let own = ["slices", "long", "Image", "512", "0020", "4711"].map(str::to_owned);
        let text = |text: &str| masked.text(text.into(), &own);
        assert_eq!(
            text("/data/in/long/512: too long, 512x512 slices."),
            "[name]/[name]: too long, 512x512 slices."
        );
        assert_eq!(text("Image Type (0020,0012) differs"), "Image Type (0020,0012) differs");
        assert_eq!(
            text("the Slices of long.dcm, long_1 and IM4711"),
            "the [name] of [name].dcm, [name]_1 and IM[name]"
        );
        assert_eq!(text("it has 1.512 mm: long"), "it has 1.512 mm: long");
        let parts = ["slice", "head", "memory"].map(str::to_owned);
        let text = |text: &str| masked.text(text.into(), &parts);
        assert_eq!(text("the header of slices; --memory 8MiB"), "the header of slices; --memory 8MiB");
        assert_eq!(text("headless, slice_1, -memory"), "[name]less, [name]_1, -[name]");
        assert_eq!(masked.path(Path::new("/data/in/slices/x"), &own), "[name]/x");
    }

    #[test]
    fn a_folder_has_one_name_however_it_is_given_and_wherever_it_lies() {
        let here = std::env::current_dir().unwrap();
        let none = PatientWords::default();
        let identity = |input: &Path| {
            let inputs = [input.to_path_buf()];
            Masked::new(false, &inputs, &none).identity(&input.join("a/b.nrrd"))
        };
        let expected = Path::new(here.file_name().unwrap()).join("a/b.nrrd");
        assert_eq!(identity(&here), expected);
        assert_eq!(identity(Path::new(".")), expected);
        assert_eq!(identity(Path::new("src/..")), expected);
        assert_eq!(identity(&Path::new("/elsewhere").join(here.file_name().unwrap())), expected);
    }

    #[test]
    fn the_vocabulary_is_in_order_and_holds_words() {
        let words: Vec<&str> = VOCABULARY.lines().collect();
        assert!(words.len() > 300 && words.is_sorted_by(|a, b| a < b));
        assert!(words.iter().all(|w| w.len() >= 3 && w.chars().all(|c| c.is_ascii_alphabetic())));
    }
}
