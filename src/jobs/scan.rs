//! `oct scan`: what would be converted, and why the rest would be refused, without converting anything.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::build::without_repeats;
use crate::budget::peak_rss_bytes;
use crate::error::Error;
use crate::source::{Catalogue, Finding, LeftOut, OpenOptions};

/// Paths as they are reported: relative to what was searched, patient names masked.
pub(super) struct Masked<'a> {
    keep: bool,
    inputs: &'a [PathBuf],
}

/// What stands in the place of a patient's name.
const MASK: &str = "[name]";

impl<'a> Masked<'a> {
    pub(super) fn new(keep: bool, inputs: &'a [PathBuf]) -> Self {
        Self { keep, inputs }
    }

    /// A path for a report.
    pub(super) fn path(&self, path: &Path, secrets: &[String]) -> String {
        let text = self.relative(path).display().to_string();
        let text = if text.is_empty() { ".".into() } else { text };
        self.masked(text.trim_end_matches('/').to_owned(), secrets)
    }

    /// A path relative to what was searched, as it is.
    pub(super) fn relative(&self, path: &Path) -> PathBuf {
        let inside = self.inputs.iter().find_map(|input| {
            let rest = path.strip_prefix(input).ok()?;
            // The name of a single searched folder says nothing; that of one of several does.
            let own = self.name_of(input).filter(|_| self.inputs.len() > 1 || rest.as_os_str().is_empty());
            Some(own.map_or_else(|| rest.to_path_buf(), |own| own.join(rest)))
        });
        inside.unwrap_or_else(|| path.to_path_buf())
    }

    /// A path that tells a file from all others, whatever else is searched: never for a report.
    pub(super) fn identity(&self, path: &Path) -> PathBuf {
        let inside = self.inputs.iter().find_map(|input| {
            Some(self.name_of(input).unwrap_or_default().join(path.strip_prefix(input).ok()?))
        });
        inside.unwrap_or_else(|| path.to_path_buf())
    }

    /// The end of a searched path, as long as it takes to tell it from the others.
    fn name_of(&self, input: &Path) -> Option<PathBuf> {
        input.file_name()?;
        let alike =
            |other: &Path, n: usize| other.components().rev().take(n).eq(input.components().rev().take(n));
        let alone = |n: &usize| !self.inputs.iter().any(|other| other.as_path() != input && alike(other, *n));
        let all = input.components().count();
        let n = (1..all).find(alone).unwrap_or(all);
        Some(input.components().skip(all - n).collect())
    }

    /// A sentence for a report: sentences begin with a path, whose searched folder is cut off too.
    pub(super) fn text(&self, text: String, secrets: &[String]) -> String {
        let inside = self.inputs.iter().find_map(|input| {
            let rest = text.strip_prefix(input.to_str()?)?;
            let own = self.name_of(input).map(|name| name.display().to_string()).unwrap_or_default();
            match rest.strip_prefix('/') {
                Some(rest) if self.inputs.len() == 1 => Some(rest.to_owned()),
                _ if rest.starts_with([':', '/']) && !own.is_empty() => Some(own + rest),
                _ => None,
            }
        });
        self.masked(inside.unwrap_or(text), secrets)
    }

    fn masked(&self, text: String, secrets: &[String]) -> String {
        if self.keep { text } else { secrets.iter().fold(text, |text, secret| without(&text, secret)) }
    }
}

/// Files that are no volume, for a report: reason, how many, the first.
///
/// They belong to no series, but lie in the same folders: what the series tell of patients is masked in them too.
pub(super) struct LeftOuts(Vec<(String, u64, String)>);

impl LeftOuts {
    pub(super) fn new(masked: &Masked<'_>, catalogue: &Catalogue) -> Self {
        let line = |l: &LeftOut| (l.reason.clone(), l.count, masked.path(&l.first, &[]));
        Self(catalogue.left_out().iter().map(line).collect())
    }

    /// Takes note of a patient's names.
    pub(super) fn hide(&mut self, masked: &Masked<'_>, secrets: &[String]) {
        for (_, _, first) in &mut self.0 {
            *first = masked.masked(std::mem::take(first), secrets);
        }
    }

    pub(super) fn into_lines(self) -> Vec<(String, u64, String)> {
        self.0
    }
}

/// `text` with every occurrence of `secret` masked, in whatever case it is written.
fn without(text: &str, secret: &str) -> String {
    if secret.is_empty() {
        return text.to_owned();
    }
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let step = match length_of(rest, secret) {
            Some(length) => {
                out.push_str(MASK);
                length
            }
            None => {
                out.push(first);
                first.len_utf8()
            }
        };
        rest = rest.get(step..).unwrap_or_default();
    }
    out
}

/// Bytes of `secret` at the beginning of `text`, if it stands there in some case.
fn length_of(text: &str, secret: &str) -> Option<usize> {
    let mut chars = text.chars();
    for wanted in secret.chars() {
        let found = chars.next()?;
        if found != wanted && !found.to_lowercase().eq(wanted.to_lowercase()) {
            return None;
        }
    }
    Some(text.len() - chars.as_str().len())
}

/// One volume that was found.
#[derive(Clone, Debug)]
pub struct Listed {
    /// Where it is, relative to what was searched.
    pub input: String,
    /// Which volume of its input, counted from 1.
    pub number: usize,
    /// Kind of source.
    pub format: String,
    /// Which part of its input it is, or empty.
    pub part: String,
    /// Suggested name.
    pub name: String,
    /// Files, and their bytes.
    pub files: (u64, u64),
    /// Facts, or why it is refused.
    pub facts: Result<ListedFacts, String>,
}

/// Facts of a usable volume.
#[derive(Clone, Debug)]
pub struct ListedFacts {
    /// Size in voxels.
    pub dims: [u32; 3],
    /// Distance of neighbours in mm.
    pub spacing_mm: [f64; 3],
    /// Type of the samples.
    pub dtype: &'static str,
    /// Scratch space for unrolling it.
    pub scratch_bytes: u64,
    /// Sentences about it.
    pub warnings: Vec<String>,
}

/// Lists the volumes below some inputs; calls `each` for one after the other, and returns what was left out,
/// with the number of usable and of refused volumes.
///
/// # Errors
/// An input cannot be read at all, or `each` fails.
pub fn scan(
    inputs: &[PathBuf],
    how: &OpenOptions,
    keep_names: bool,
    each: &mut dyn FnMut(&Listed) -> Result<(), Error>,
) -> Result<ScanReport, Error> {
    let catalogue = Catalogue::survey(inputs, how, &std::env::temp_dir())?;
    let masked = Masked::new(keep_names, inputs);
    let mut report = ScanReport { usable: 0, refused: 0, left_out: Vec::new() };
    let mut left_outs = LeftOuts::new(&masked, &catalogue);
    let mut number = 0;
    for at in 0..catalogue.len() {
        for finding in catalogue.open(at) {
            number += 1;
            left_outs.hide(&masked, &finding.secrets);
            let listed = list(&masked, number, &finding);
            match listed.facts {
                Ok(_) => report.usable += 1,
                Err(_) => report.refused += 1,
            }
            each(&listed)?;
        }
    }
    report.left_out = left_outs.into_lines();
    Ok(report)
}

fn list(masked: &Masked<'_>, number: usize, finding: &Finding) -> Listed {
    let mask = |text: String| masked.text(text, &finding.secrets);
    Listed {
        input: masked.path(&finding.path, &finding.secrets),
        number,
        format: finding.format.to_owned(),
        part: finding.part.clone().unwrap_or_default(),
        name: finding.stem.clone(),
        files: (finding.files.count, finding.files.bytes),
        facts: match &finding.volume {
            Err(e) => Err(mask(e.to_string())),
            Ok(source) => {
                let info = source.info();
                Ok(ListedFacts {
                    dims: info.dims.to_array(),
                    spacing_mm: info.spacing_mm,
                    dtype: info.scalar.name(),
                    scratch_bytes: source.preparation().scratch_bytes,
                    warnings: without_repeats(&info.warnings).into_iter().map(mask).collect(),
                })
            }
        },
    }
}

/// What a scan found.
#[derive(Clone, Debug)]
pub struct ScanReport {
    /// Volumes that would be converted.
    pub usable: u64,
    /// Volumes that would be refused.
    pub refused: u64,
    /// Files that are no volume: reason, how many, the first.
    pub left_out: Vec<(String, u64, String)>,
}

impl ScanReport {
    /// The closing part of the JSON object; the items stand before it.
    pub fn json(&self) -> Value {
        json!({
            "usable": self.usable,
            "refused": self.refused,
            "left_out": self.left_out.iter().map(|(reason, count, first)| json!({
                "reason": reason, "count": count, "first": first
            })).collect::<Vec<_>>(),
            "peak_rss_bytes": peak_rss_bytes(),
        })
    }
}

impl Listed {
    /// One JSON object.
    pub fn json(&self) -> Value {
        let mut value = json!({
            "input": self.input, "number": self.number, "format": self.format, "part": self.part, "name": self.name,
            "files": self.files.0, "input_bytes": self.files.1,
        });
        let more = match &self.facts {
            Ok(f) => json!({
                "usable": true, "dims": f.dims, "spacing_mm": f.spacing_mm, "dtype": f.dtype,
                "scratch_bytes": f.scratch_bytes, "warnings": f.warnings,
            }),
            Err(reason) => json!({ "usable": false, "reason": reason }),
        };
        if let (Value::Object(all), Value::Object(more)) = (&mut value, more) {
            all.extend(more);
        }
        value
    }

    /// A few lines for people.
    pub fn text(&self) -> String {
        let part = if self.part.is_empty() { String::new() } else { format!(", {}", self.part) };
        let head =
            format!("{:>3}. {} ({}{part}, {} file(s))", self.number, self.input, self.format, self.files.0);
        match &self.facts {
            Ok(f) => {
                let [x, y, z] = f.dims;
                let [a, b, c] = f.spacing_mm;
                let mut text = format!(
                    "{head}\n  {x}x{y}x{z} {}, {a:.4} x {b:.4} x {c:.4} mm -> {}\n",
                    f.dtype, self.name
                );
                for warning in &f.warnings {
                    text += &format!("  note: {warning}\n");
                }
                text
            }
            Err(reason) => format!("{head}\n  refused: {reason}\n"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_relative_and_names_masked_in_any_case() {
        let inputs = [PathBuf::from("/data/in")];
        let masked = Masked::new(false, &inputs);
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
        let several = Masked::new(false, &inputs);
        assert_eq!(several.path(Path::new("/x/data/a.nii"), &[]), "x/data/a.nii");
        assert_eq!(several.path(Path::new("/y/more/a.nii"), &[]), "more/a.nii");
        assert_eq!(several.text("/y/data/a.nii: no".into(), &[]), "y/data/a.nii: no");
        let inputs = [PathBuf::from("/data/in")];
        let kept = Masked::new(true, &inputs);
        assert_eq!(kept.path(Path::new("/data/in/Anna"), &secrets), "Anna");
        assert_eq!(kept.path(Path::new("/else/Anna"), &secrets), "/else/Anna");
    }
}
