//! `oct scan`: what would be converted, and why the rest would be refused, without converting anything.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::masked::{LeftOuts, Masked};
use super::wording::sentences;
use crate::budget::peak_rss_bytes;
use crate::catalogue::Catalogue;
use crate::error::Error;
use crate::source::{Finding, OpenOptions};

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
    let masked = Masked::new(keep_names, inputs, catalogue.patient_words());
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
                    warnings: sentences(&info.notes).into_iter().map(mask).collect(),
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
