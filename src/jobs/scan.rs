//! `oct scan`: what would be converted, and why the rest would be refused, without converting anything.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::batch::{Claim, Claims, NOTICE, copy_of, numbered};
use super::wording::foreign::{data, shown};
use super::wording::sentences;
use crate::budget::peak_rss_bytes;
use crate::catalogue::{Catalogue, LeftOut};
use crate::error::Error;
use crate::source::{BurnedIn, Finding, OpenOptions, Subject, SubjectKind};

/// One volume that was found.
#[derive(Clone, Debug)]
pub struct Listed {
    /// Where it is, as it was reached from what was searched.
    pub input: String,
    /// Which volume of its input, counted from 1.
    pub number: usize,
    /// Kind of source.
    pub format: String,
    /// Which part of its input it is, or empty.
    pub part: String,
    /// Its id: the name that a batch gives to its model.
    pub name: String,
    /// What it is: `CT image`, ...; the kind of source again where nothing more is known.
    pub kind: String,
    /// Why its pixels may carry text, if there is a reason to think so.
    pub burned_in: Option<BurnedIn>,
    /// Files, and their bytes.
    pub files: (u64, u64),
    /// The volume that it is a copy of, byte for byte; a batch takes that one alone.
    pub copy_of: Option<String>,
    /// Facts, or why it is refused.
    pub facts: Result<ListedFacts, String>,
    /// What it is; the size of a mesh and of a tree follows from the grid that is asked for.
    pub subject: SubjectKind,
}

/// Facts of a usable volume; those of a mesh or a tree follow from its grid.
#[derive(Clone, Debug, Default)]
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
    each: &mut dyn FnMut(&Listed) -> Result<(), Error>,
) -> Result<ScanReport, Error> {
    let catalogue = Catalogue::survey(inputs, how, &std::env::temp_dir())?;
    let mut report = ScanReport::default();
    let claims = Claims::default();
    let mut number = 0;
    for at in 0..catalogue.len() {
        let turn = claims.turn(at);
        let before = number;
        for (part, finding) in catalogue.open(at).into_iter().enumerate() {
            // Those that are passed over have numbers, too.
            number += 1 + finding.more;
            let mut listed = list(before + finding.at + 1, &finding);
            if listed.facts.is_ok() {
                // As a batch names it.
                match turn.claim(&finding, (at, part), &|finding, owner| catalogue.is_copy(finding, owner)) {
                    Claim::CopyOf(name) => {
                        listed.facts = Err(copy_of(&name));
                        listed.copy_of = Some(name);
                    }
                    Claim::Own(name, others) => {
                        if let (Ok(facts), Some(others)) = (&mut listed.facts, others) {
                            facts.warnings.push(numbered(others));
                        }
                        listed.name = name;
                    }
                }
            }
            match (&listed.facts, &listed.copy_of) {
                (Ok(_), _) => report.usable += 1,
                (Err(_), Some(_)) => report.copies += 1,
                (Err(_), None) => report.refused += 1,
            }
            each(&listed)?;
        }
    }
    catalogue.for_each_left_out::<Error>(&mut |why, path| {
        if report.left_out_files.len() < MOST_NAMED {
            report.left_out_files.push((data(path), why.to_string()));
        }
        Ok(())
    })?;
    let line = |l: &LeftOut| (l.why.to_string(), l.count, data(&l.first));
    report.left_out = catalogue.left_out().iter().map(line).collect();
    Ok(report)
}

fn list(number: usize, finding: &Finding) -> Listed {
    Listed {
        input: data(&finding.path),
        number,
        format: finding.format.to_owned(),
        part: finding.part.clone().unwrap_or_default(),
        name: finding.id.clone(),
        kind: finding.kind.clone(),
        burned_in: finding.burned_in,
        copy_of: None,
        files: (finding.files.count, finding.files.bytes),
        subject: finding.subject.as_ref().map_or(SubjectKind::Volume, Subject::kind),
        facts: match &finding.subject {
            Err(e) => Err(e.to_string()),
            Ok(Subject::Mesh(_) | Subject::Tree(_)) => Ok(ListedFacts::default()),
            Ok(Subject::Volume(source)) => {
                let info = source.info();
                Ok(ListedFacts {
                    dims: info.dims.to_array(),
                    spacing_mm: info.spacing_mm,
                    dtype: info.scalar.name(),
                    scratch_bytes: source.preparation().scratch_bytes,
                    warnings: sentences(&info.notes),
                })
            }
        },
    }
}

/// Most files that are left out of which a list has the names.
const MOST_NAMED: usize = 10_000;

/// What a scan found.
#[derive(Clone, Debug, Default)]
pub struct ScanReport {
    /// Volumes that would be converted.
    pub usable: u64,
    /// Volumes that would be refused.
    pub refused: u64,
    /// Volumes that are copies of others, which a batch skips.
    pub copies: u64,
    /// Files that are no volume: reason, how many, the first.
    pub left_out: Vec<(String, u64, String)>,
    /// The same one by one, as many as are named: path and reason.
    pub left_out_files: Vec<(String, String)>,
}

impl ScanReport {
    /// What a list says at its top.
    pub fn notice() -> String {
        format!("this list {NOTICE}")
    }

    /// The closing part of the JSON object; the items stand before it.
    pub fn json(&self) -> Value {
        json!({
            "usable": self.usable,
            "refused": self.refused,
            "copies": self.copies,
            "pixels_looked_at": false,
            "left_out_files": self.left_out_files.iter().map(|(path, reason)| json!({
                "path": path, "reason": reason
            })).collect::<Vec<_>>(),
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
            "input": self.input, "number": self.number, "format": self.format, "kind": self.kind, "part": self.part,
            "name": self.name, "burned_in": self.burned_in, "copy_of": self.copy_of,
            "files": self.files.0, "input_bytes": self.files.1,
        });
        let more = match &self.facts {
            Ok(f) if self.subject != SubjectKind::Volume => json!({ "usable": true, "warnings": f.warnings }),
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
        let part = if self.part.is_empty() { String::new() } else { format!(", {}", shown(&self.part)) };
        let (input, format) = (shown(&self.input), &self.format);
        let head = format!("{:>3}. {input} ({format}{part}, {} file(s))", self.number, self.files.0);
        match &self.facts {
            Ok(f) => {
                let [x, y, z] = f.dims;
                let [a, b, c] = f.spacing_mm;
                let what = match self.subject {
                    SubjectKind::Volume => {
                        format!("{x}x{y}x{z} {}, {a:.4} x {b:.4} x {c:.4} mm", f.dtype)
                    }
                    SubjectKind::Mesh => "a mesh, on the grid that is asked for".to_owned(),
                    SubjectKind::Tree => "a tree of solids, on the grid that is asked for".to_owned(),
                };
                let mut text = format!("{head}\n  {what} -> {}\n", self.name);
                for warning in &f.warnings {
                    text += &format!("  note: {warning}\n");
                }
                text
            }
            Err(reason) if self.copy_of.is_some() => format!("{head}\n  skipped: {}\n", shown(reason)),
            Err(reason) => format!("{head}\n  refused: {}\n", shown(reason)),
        }
    }
}
