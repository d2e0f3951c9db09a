//! The report of `oct scan`.

use serde::Serialize;

use crate::jobs::batch::{LeftOutCount, LeftOutFile, NOTICE};
use crate::source::{BurnedIn, SubjectKind};
use crate::text::{Count, shown};

/// One volume that was found.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Listed {
    /// Number of the volume, for `oct build --volume`.
    pub number: usize,
    /// File, or folder of the files, as reached from the paths searched.
    pub input: String,
    /// Kind of source: dicom, raw, nrrd, mesh, csg, synthetic, ...
    pub format: String,
    /// Kind of image, such as CT image; the format if unknown.
    pub kind: String,
    /// Part of an input that holds several volumes; else empty.
    pub part: String,
    /// Name of the model, without .oct.
    pub name: String,
    /// Reason to think that the pixels carry text; null without one.
    pub burned_in: Option<BurnedIn>,
    /// Files read.
    pub files: u64,
    /// Size of these files.
    pub input_bytes: u64,
    /// Name of the volume that has the same bytes; a batch skips the copy.
    pub copy_of: Option<String>,
    /// True if it would be converted, judging by the headers.
    pub usable: bool,
    /// Reason why it would be refused or skipped, in one sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Its size; the size of a mesh or a tree follows from the requested grid.
    #[serde(flatten)]
    pub size: Option<ListedSize>,
    /// Number of labels that its header states, or that its values suggest if they were read; null if it is not known
    /// to be a label map.
    pub label_count: Option<usize>,
    /// Sentences about the input: assumptions, parts left out, oddities.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warnings: Option<Vec<String>>,
    /// Body part that DICOM states, else empty.
    #[serde(skip)]
    pub body_part: String,
    /// Further numbers of segments that it joins, or of similar volumes that are passed over.
    #[serde(skip)]
    pub more: usize,
    /// Kind of input: a volume, a mesh or a tree of solids.
    #[serde(skip)]
    pub subject: SubjectKind,
    /// Size in voxels as stated by the headers; also for refused volumes.
    #[serde(skip)]
    pub stated: Option<[u32; 3]>,
}

/// Size of a usable volume.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ListedSize {
    /// Size of the volume in voxels along x, y, z.
    pub dims: [u32; 3],
    /// Distance of neighbouring voxels along x, y, z, in mm.
    pub spacing_mm: [f64; 3],
    /// Type of the source's samples: u8, i8, u16, i16, u32, i32, f32 or f64.
    pub dtype: &'static str,
    /// Size of the scratch files.
    pub scratch_bytes: u64,
}

/// The report of a scan, without the volumes.
#[derive(Clone, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ScanReport {
    /// Volumes that would be converted.
    pub usable: u64,
    /// Volumes that would be refused.
    pub refused: u64,
    /// Volumes that are copies of others; a batch skips them.
    pub copies: u64,
    /// Further numbers of segments that maps join, and of similar volumes that are passed over.
    #[serde(skip)]
    pub passed_over: u64,
    /// True if values were read, not headers alone; only with `--values`.
    pub pixels_looked_at: bool,
    /// Files that are not volumes, by reason.
    pub left_out: Vec<LeftOutCount>,
    /// The same files one by one; at most 10,000 of a scan and 1,000 of a batch.
    pub left_out_files: Vec<LeftOutFile>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
}

impl ScanReport {
    /// First line of a list.
    pub fn notice() -> String {
        format!("this list {NOTICE}")
    }
}

impl Listed {
    /// Marks the volume as refused, for this reason.
    pub(super) fn refuse(&mut self, reason: String) {
        (self.usable, self.reason, self.size, self.warnings) = (false, Some(reason), None, None);
    }

    /// A few lines for people.
    pub fn text(&self) -> String {
        let part = if self.part.is_empty() { String::new() } else { format!(", {}", shown(&self.part)) };
        let (input, format) = (shown(&self.input), &self.format);
        let kind = [&self.kind, &self.body_part].into_iter();
        let kind = kind.filter(|kind| !kind.is_empty() && **kind != self.format);
        let kind: String = kind.map(|kind| format!(", {}", shown(kind))).collect();
        let more = match self.more {
            0 => String::new(),
            more => format!(" to {}", self.number + more),
        };
        let (number, files) = (self.number, Count(self.files, "file"));
        let head = format!("{number:>3}{more}. {input} ({format}{kind}{part}, {files})");
        if let Some(reason) = &self.reason {
            let end = if self.copy_of.is_some() { "skipped" } else { "refused" };
            // The name has the series' number, which the folder does not show.
            let size = self.stated.map_or(String::new(), |[x, y, z]| format!("{x}x{y}x{z}, "));
            return format!("{head}\n  {size}{}\n  {end}: {}\n", self.name, shown(reason));
        }
        let mut text = match &self.size {
            None => {
                let what = if self.subject == SubjectKind::Tree { "a tree of solids" } else { "a mesh" };
                format!("{head}\n  {what}, on the grid that is asked for -> {}\n", self.name)
            }
            Some(size) => {
                let ([x, y, z], [a, b, c]) = (size.dims, size.spacing_mm);
                let labels = self
                    .label_count
                    .map_or_else(String::new, |labels| format!(", a map of {}", Count(labels, "label")));
                let size = format!("{x}x{y}x{z} {}{labels}, {a:.4} x {b:.4} x {c:.4} mm", size.dtype);
                format!("{head}\n  {size} -> {}\n", self.name)
            }
        };
        for warning in self.warnings.iter().flatten() {
            text += &format!("  note: {warning}\n");
        }
        text
    }
}
