//! Findings: a subject or the reason why it cannot be used, and the files behind it.

use crate::platform::OsStrExt;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{StableHash, Subject};
use crate::volume::Result;

/// One volume, mesh or tree that was found, or the reason why it cannot be used.
#[derive(Debug)]
pub struct Finding {
    /// The file, or the folder of the files, as it was reached from the searched input.
    pub path: PathBuf,
    /// Name for a model of it, without an extension: the same for the same input, wherever it lies and whatever its
    /// name, and free of names of files and patients.
    ///
    /// For DICOM: modality, series number, eight hex digits of a hash of the Series Instance UID, and the part, as in
    /// `mr-012-1a2b3c4d-echo2`. For others the format and twelve hex digits of a hash of their content, as in
    /// `nrrd-1a2b3c4d5e6f`, and the number of the volume where the input holds several. Different inputs may have one
    /// id, where they differ in places that the hash leaves out.
    pub id: String,
    /// Kind of source: `dicom`, `nrrd`, `raw`, ...
    pub format: &'static str,
    /// Kind of image, for people: `CT image`, `localizer`, ...; the format again where the kind is unknown.
    pub kind: String,
    /// Body part examined, as DICOM states it; else empty.
    pub body_part: String,
    /// Part of its input, for example `echo 2`, where the input holds several volumes.
    pub part: Option<String>,
    /// Size in voxels, as far as the headers state it, also for refused volumes.
    pub size: Option<[u32; 3]>,
    /// The input files, to see whether they changed.
    pub files: InputFiles,
    /// Reason why its pixels may carry text, such as the patient's name, if there is one.
    pub burned_in: Option<BurnedIn>,
    /// Number of the volume in its input, from 0, with volumes that are passed over counted.
    pub at: usize,
    /// Number of similar volumes of the same input that are passed over in its favour.
    pub more: usize,
    /// Subject of the model.
    pub subject: Result<Subject>,
}

impl Finding {
    /// A subject of one file or folder, without further facts.
    pub(crate) fn new(
        path: &Path,
        format: &'static str,
        id: String,
        files: InputFiles,
        subject: Result<Subject>,
    ) -> Self {
        let volume = subject.as_ref().ok().and_then(Subject::volume);
        Self {
            path: path.to_path_buf(),
            id,
            format,
            kind: format.into(),
            body_part: String::new(),
            part: None,
            size: volume.map(|v| v.info().dims.to_array()),
            files,
            burned_in: None,
            at: 0,
            more: 0,
            subject,
        }
    }
}

/// Why the pixels of an image may carry text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum BurnedIn {
    /// Burned In Annotation (0028,0301) says so.
    Stated,
    /// Ultrasound, whose devices write into the picture.
    Ultrasound,
    /// An image that was not made by the device itself: by its SOP class, or because a Conversion Type (0008,0064) is
    /// stated.
    SecondaryCapture,
    /// A picture of a screen, by its Image Type (0008,0008).
    ScreenCapture,
}

impl BurnedIn {
    /// Every reason.
    pub(crate) const ALL: [Self; 4] =
        [Self::Stated, Self::Ultrasound, Self::SecondaryCapture, Self::ScreenCapture];
}

/// The files behind a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputFiles {
    /// Number of files.
    pub count: u64,
    /// Total size of the files in bytes.
    pub bytes: u64,
    /// Hash of every name (without its folder), size and time of change; independent of their order.
    pub fingerprint: u64,
}

impl InputFiles {
    /// Takes in one more file; `changed` are bits that differ when its time of change does.
    pub(crate) fn add(&mut self, path: &Path, size: u64, changed: u64) {
        let name = path.file_name().map(OsStrExt::as_bytes).unwrap_or_default();
        let hash = StableHash::new().part(name).number(size).number(changed).finish();
        self.count += 1;
        self.bytes = self.bytes.saturating_add(size);
        self.fingerprint = self.fingerprint.wrapping_add(hash);
    }
}

/// Letters, digits, and `-_.` of a name; everything else becomes `_`. Never empty, never hidden, no option.
pub(crate) fn safe_name(name: &str) -> String {
    const LONGEST: usize = 100;
    let plain: String = name
        .chars()
        .take(LONGEST)
        .map(|c| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' })
        .collect();
    let plain = plain.trim_start_matches(['.', '-']);
    if plain.is_empty() { "volume".into() } else { plain.into() }
}
