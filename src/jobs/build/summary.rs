//! Result and cost of a build, in a few lines for people.

use std::path::PathBuf;

use super::LabelModel;
use crate::budget::{Bytes, MemoryCap, peak_rss_bytes};
use crate::builder::BuildReport;
use crate::clean::CleanReport;
use crate::jobs::info::{self, Info};
use crate::text::names::MEMORY;
use crate::text::{Count, Rounded, Short, shown};

/// Input, output, figures and warnings of a build.
#[derive(Clone, Debug)]
pub struct BuildSummary {
    /// The inputs, as given.
    pub input: String,
    /// The model, as given.
    pub output: PathBuf,
    /// The cap.
    pub memory_bytes: u64,
    /// Figures of the build.
    pub report: BuildReport,
    /// Facts of the finished file.
    pub info: Info,
    /// The models of single labels, if they were asked for.
    pub each: Vec<LabelModel>,
    /// Operations of cleaning, and its figures if it touched the occupancy.
    pub cleaning: Option<(Vec<String>, Option<CleanReport>)>,
    /// Sentences about the input.
    pub warnings: Vec<String>,
    /// Sentences that suggest other options.
    pub hints: Vec<String>,
    /// Seconds from opening the input to the model's name on disk.
    pub wall_s: f64,
}

impl BuildSummary {
    /// A few lines for people.
    pub fn text(&self) -> String {
        let r = &self.report;
        let metadata = &self.info.frame.metadata;
        let range = if !info::has_values(metadata) {
            metadata.source.kind.clone()
        } else if r.selection.hi.is_finite() {
            format!("values {}..{}", Short(r.selection.lo), Short(r.selection.hi))
        } else {
            format!("values {} and more ({})", Short(r.selection.lo), info::kind_name(r.selection.kind))
        };
        let per_voxel = r.file_bytes as f64 / info::surface_boxes(&self.info.frame).max(1) as f64;
        let one = info::one_of(&self.info.frame);
        let kept = info::noun(self.info.frame.surface());
        let leaves = info::leaves(&self.info.frame);
        let larger =
            if leaves > 0 { format!(" and {}", Count(leaves, "larger leaf")) } else { String::new() };
        let [x, y, z] = self.info.frame.metadata.dims;
        let mut text = format!(
            "{}: {}{larger} of {x}x{y}x{z}, {range}\n  {} ({per_voxel:.3} bytes per {one}), {}\n  {:.2} s with {}, peak resident memory {} of {} allowed\n",
            shown(&self.output),
            Count(r.skin_voxels, kept),
            Bytes(r.file_bytes),
            Count(r.nodes, "node"),
            self.wall_s,
            Count(r.threads, "thread"),
            Bytes(peak_rss_bytes()),
            Bytes(self.memory_bytes),
        );
        if !self.each.is_empty() {
            let bytes = Bytes(self.each.iter().map(|model| model.bytes).sum());
            text += &format!("  a model of each label: {}, {bytes} together\n", self.each.len());
        }
        if let Some(hidden) = r.hidden {
            let (boxes, bytes) = (Count(hidden, kept), Bytes(r.bytes_saved_about()));
            text += &format!("  left out: {boxes} that cannot be seen from there, about {bytes}\n");
        }
        if let Some((operations, report)) = &self.cleaning {
            text += &format!("  cleaned: {}", operations.join(", "));
            if let Some(r) = report {
                let added = Count(r.voxels_added, "voxel");
                text += &format!("; {added} added, {} removed", r.voxels_removed);
                if r.components > 0 {
                    text += &format!(", {} of {} components kept", r.kept, r.components);
                }
                if r.largest_dropped > 0 {
                    let voxels = Count(r.largest_dropped, "voxel");
                    let mm3 = r.largest_dropped as f64
                        * self.info.frame.metadata.spacing_mm.iter().product::<f64>();
                    text += &format!(", the largest of the others with {voxels} ({} mm³)", Rounded(mm3));
                }
            }
            text += "\n";
        }
        text.extend(self.warnings.iter().map(|warning| format!("  note: {warning}\n")));
        text.extend(self.hints.iter().map(|hint| format!("  hint: {hint}\n")));
        text
    }
}

/// The sentence of a report on a process whose peak is above its cap.
pub(in crate::jobs) fn above_cap(cap: MemoryCap) -> Option<String> {
    let MemoryCap::Process(cap) = cap else { return None };
    let peak = peak_rss_bytes();
    let text = |[peak, cap]: [Bytes; 2]| {
        format!(
            "the peak of resident memory, {peak}, is above the {cap} allowed: the system counted more than was planned; allow more with {MEMORY}, and report it"
        )
    };
    (peak > cap).then(|| text([peak, cap].map(Bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_above_the_cap_is_reported() {
        let said = above_cap(MemoryCap::Process(1 << 10)).unwrap();
        assert!(said.contains("above the 1.00 KiB allowed"), "{said}");
        assert_eq!(above_cap(MemoryCap::Process(u64::MAX)), None);
        assert_eq!(above_cap(MemoryCap::Share(1)), None);
    }
}
