//! `oct scan`: the volumes that would be converted, and reasons against the rest, without converting anything.

mod report;

pub use report::{Listed, ListedSize, ScanReport};

use std::path::PathBuf;

use super::batch::{Claim, Claims, LeftOutCount, LeftOutFile, copy_of, numbered};
use super::labels::{Values, look, stated};
use crate::budget::peak_rss_bytes;
use crate::builder::BuildOptions;
use crate::clean::CleanOptions;
use crate::discovery::Catalogue;
use crate::error::Error;
use crate::progress::Silent;
use crate::source::{Finding, OpenOptions, Subject, SubjectKind};
use crate::text::data;
use crate::volume::{Overlap, VolumeSource, sentences};

/// Lists the volumes below some inputs; calls `each` for one after the other, and returns the files left out, with the
/// numbers of usable and of refused volumes.
///
/// The segments of a segmentation are one volume, with the number of the first. Headers state labels; with `values` all
/// other volumes are read, too, to recognise labels that no header states: as slow as reading all volumes.
///
/// # Errors
/// An input cannot be read at all, or `each` fails.
pub fn scan(
    inputs: &[PathBuf],
    how: &OpenOptions,
    values: bool,
    each: &mut dyn FnMut(&Listed) -> Result<(), Error>,
) -> Result<ScanReport, Error> {
    let how = OpenOptions { masks: Some(Overlap::default()), ..how.clone() };
    let catalogue = Catalogue::survey(inputs, &how, &std::env::temp_dir())?;
    let mut report = ScanReport { pixels_looked_at: values, ..ScanReport::default() };
    let claims = Claims::default();
    let mut number = 0;
    for at in 0..catalogue.len() {
        let turn = claims.turn(at);
        let before = number;
        let findings = catalogue.open(at);
        let is_only = findings.len() == 1;
        for (part, mut finding) in findings.into_iter().enumerate() {
            // Volumes that are passed over have numbers, too.
            number += 1 + finding.more;
            let mut listed = list(before + finding.at + 1, &finding);
            report.passed_over += finding.more as u64;
            // Numbers of one subject follow each other where it is alone.
            listed.more = if is_only { finding.more } else { 0 };
            if let (true, Ok(Subject::Volume(source))) =
                (values && listed.label_count.is_none(), &mut finding.subject)
            {
                listed.look(&mut **source);
            }
            if listed.usable {
                // The same name as in a batch.
                match turn.claim(&finding, (at, part), &|finding, owner| catalogue.is_copy(finding, owner)) {
                    Claim::CopyOf(name) => {
                        listed.refuse(copy_of(&name));
                        listed.copy_of = Some(name);
                    }
                    Claim::Own(name, others) => {
                        if let (Some(warnings), Some(others)) = (&mut listed.warnings, others) {
                            warnings.push(numbered(others));
                        }
                        listed.name = name;
                    }
                }
            }
            match (listed.usable, &listed.copy_of) {
                (true, _) => report.usable += 1,
                (false, Some(_)) => report.copies += 1,
                (false, None) => report.refused += 1,
            }
            each(&listed)?;
        }
    }
    report.left_out_files = LeftOutFile::first(&catalogue, MAX_NAMED)?;
    report.left_out = catalogue.left_out().iter().map(LeftOutCount::from).collect();
    report.peak_rss_bytes = peak_rss_bytes();
    Ok(report)
}

fn list(number: usize, finding: &Finding) -> Listed {
    let mut listed = Listed {
        number,
        input: data(&finding.path),
        format: finding.format.to_owned(),
        kind: finding.kind.clone(),
        part: finding.part.clone().unwrap_or_default(),
        name: finding.id.clone(),
        burned_in: finding.burned_in,
        files: finding.files.count,
        input_bytes: finding.files.bytes,
        copy_of: None,
        more: 0,
        body_part: finding.body_part.clone(),
        usable: true,
        reason: None,
        size: None,
        warnings: Some(Vec::new()),
        label_count: None,
        subject: finding.subject.as_ref().map_or(SubjectKind::Volume, Subject::kind),
        stated: finding.size,
    };
    match &finding.subject {
        Ok(Subject::Mesh(_) | Subject::Tree(_)) => {}
        Err(e) => listed.refuse(e.to_string()),
        Ok(Subject::Volume(source)) => {
            let info = source.info();
            listed.label_count = Some(stated(&**source)).filter(|labels| *labels > 0);
            listed.size = Some(ListedSize {
                dims: info.dims.to_array(),
                spacing_mm: info.spacing_mm,
                dtype: info.scalar.name(),
                scratch_bytes: source.preparation().scratch_bytes,
            });
            listed.warnings = Some(sentences(&info.notes));
        }
    }
    listed
}

impl Listed {
    /// Reads the values of a volume, to recognise labels or unreadable files.
    fn look(&mut self, source: &mut dyn VolumeSource) {
        let options = BuildOptions::default();
        let output = std::env::temp_dir().join("x");
        match look(source, &CleanOptions::default(), &options, &output, &Silent) {
            Ok(Values::Labels(count)) => self.label_count = Some(count),
            Err(Error::Source(error)) => self.refuse(error.to_string()),
            // Values that are all alike do not refuse a volume here.
            Ok(Values::Mixed(..)) | Err(_) => {}
        }
    }
}

/// Most left-out files that a list names.
const MAX_NAMED: usize = 10_000;
