//! Spacing and directions that come from outside the file: from the command line, or from a side-car.
//!
//! Pictures and arrays state neither, and some headers are incomplete. A format states its assumptions in notes; such a
//! note is dropped when the caller states the missing value.

use super::{InfoOverride, Note, Result, Treatment, VolumeInfo, VolumeSource};
use crate::fault::usage;
use crate::geom::Orientation;
use crate::text::Name;
use crate::text::names::{ORIENTATION, SPACING};
use crate::volume::NoteKind;

/// Spacing and directions that are stated outside the file, and replace the file's.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Placement {
    /// Distance in mm between neighbours along x, y, z; finite and positive.
    pub spacing_mm: Option<[f64; 3]>,
    /// Directions of the index axes in the patient.
    pub orientation: Option<Orientation>,
}

/// Relative difference below which spacings are the same; headers print six digits.
const TOLERANCE: f64 = 1e-5;

impl Placement {
    /// True if neither is stated.
    pub(crate) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The values stated here, with those of `other` in place of missing ones.
    pub(crate) fn or(self, other: Self) -> Self {
        Self {
            spacing_mm: self.spacing_mm.or(other.spacing_mm),
            orientation: self.orientation.or(other.orientation),
        }
    }
}

/// A volume with spacing and directions stated outside the file.
///
/// The affine's columns are scaled, so that oblique axes and gantry tilt stay; only where the letters of the
/// axes differ are they laid along the patient's. Voxel (0, 0, 0) stays where it is. Values of the
/// file that are replaced are reported in a note, and recorded among the treatments.
///
/// # Errors
/// [`SourceError`](super::SourceError) for a spacing that makes no sound affine, such as 1e-300 mm.
pub(crate) fn place(
    source: Box<dyn VolumeSource>,
    asked: Placement,
    by: StatedBy,
) -> Result<Box<dyn VolumeSource>> {
    if asked.is_empty() {
        return Ok(source);
    }
    let mut info = source.info().clone();
    if let Some(spacing) = asked.spacing_mm {
        scale(&mut info, spacing, by);
    }
    if let Some(orientation) = asked.orientation {
        turn(&mut info, orientation, by);
    }
    if info.affine.inverse().is_none() {
        return Err(usage!(
            "{} is out of range; give the distance of voxels in mm",
            by.named(SPACING, "spacing")
        )
        .at(&info.description.name)
        .into());
    }
    Ok(InfoOverride::boxed(source, info))
}

/// Origin of a placement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StatedBy {
    /// The user who opens the volume.
    Caller,
    /// A side-car beside the file.
    SideCar,
}

impl StatedBy {
    /// Name of the stated value: an option of the caller, or a key of the side-car.
    pub(crate) fn named(self, option: Name, key: &str) -> String {
        match self {
            Self::Caller => option.to_string(),
            Self::SideCar => format!("{key} of the side-car"),
        }
    }
}

fn scale(info: &mut VolumeInfo, spacing_mm: [f64; 3], by: StatedBy) {
    let assumed = info.notes.iter().any(|note| note.kind == NoteKind::AssumedSpacing);
    info.notes.retain(|note| note.kind != NoteKind::AssumedSpacing);
    let old = info.spacing_mm;
    // A header that lacks the spacing of one axis has an assumed 1 mm there.
    let stated = |mm: f64| !(assumed && (mm - 1.0).abs() < TOLERANCE);
    let differs = old.iter().zip(spacing_mm).any(|(a, b)| stated(*a) && (a - b).abs() > TOLERANCE * a.abs());
    for (axis, (new, old)) in spacing_mm.into_iter().zip(old).enumerate() {
        for row in &mut info.affine.rows {
            if let Some(value) = row.get_mut(axis) {
                *value *= new / old;
            }
        }
    }
    info.spacing_mm = spacing_mm;
    if differs {
        info.description.treatments.push(Treatment::SpacingReplaced);
        info.notes.push(Note::new(format!(
            "{} gives {}; the file states {}, which is not used",
            by.named(SPACING, "spacing"),
            mm(spacing_mm),
            mm(old)
        )));
    }
}

/// Text of a spacing: six digits, as headers print it.
fn mm(spacing_mm: [f64; 3]) -> String {
    let [x, y, z] = spacing_mm.map(|mm| format!("{mm:.5e}").parse().unwrap_or(mm));
    format!("{x} x {y} x {z} mm")
}

fn directions_replaced(by: StatedBy, given: Orientation, stated: &str) -> Note {
    Note::new(format!(
        "{} gives {given}; the directions that the file states, about {stated}, are not used",
        by.named(ORIENTATION, "orientation")
    ))
}

fn turn(info: &mut VolumeInfo, orientation: Orientation, by: StatedBy) {
    let assumed = info.notes.iter().any(|note| note.kind == NoteKind::AssumedDirections);
    info.notes.retain(|note| note.kind != NoteKind::AssumedDirections);
    let old = info.affine.orientation_letters();
    if Orientation::parse(&old) == Some(orientation) {
        return;
    }
    let is_backwards = |note: &Note| note.kind == NoteKind::Backwards;
    let backwards = info.notes.iter().any(is_backwards);
    info.notes.retain(|note| !is_backwards(note));
    let origin = info.affine.origin();
    info.affine = orientation.affine(info.spacing_mm);
    for (row, at) in info.affine.rows.iter_mut().zip(origin) {
        row[3] = at;
    }
    if !assumed || backwards {
        info.description.treatments.push(Treatment::DirectionsReplaced);
        info.notes.push(directions_replaced(by, orientation, &old));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ExitKind;
    use crate::geom::Affine;
    use crate::source::{RawOptions, RawVolume};

    const WHO: StatedBy = StatedBy::Caller;

    struct Fake(VolumeInfo);

    impl VolumeSource for Fake {
        fn info(&self) -> &VolumeInfo {
            &self.0
        }
        fn read_rows(
            &self,
            _: u32,
            _: std::ops::Range<u32>,
            _: std::ops::Range<u32>,
            _: &mut [u8],
        ) -> Result {
            Ok(())
        }
    }

    /// Info of some volume with an affine and notes.
    fn with(affine: Affine, notes: &[Note]) -> Box<dyn VolumeSource> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, [0; 8]).unwrap();
        let mut info = RawVolume::open(&[path], &RawOptions::small()).unwrap().info().clone();
        (info.affine, info.spacing_mm, info.notes) = (affine, affine.spacing_mm(), notes.to_vec());
        Box::new(Fake(info))
    }

    fn spacing(mm: [f64; 3]) -> Placement {
        Placement { spacing_mm: Some(mm), orientation: None }
    }

    #[test]
    fn axes_that_run_backwards_are_not_told_of_where_others_were_asked_for() {
        let old = Affine { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 5.0], [0.0, 0.0, 1.0, 0.0]] };
        let notes = [Note::no_directions("TIFF"), Note::backwards(1)];
        let asked = |letters: &str| Placement { spacing_mm: None, orientation: Orientation::parse(letters) };
        let letters = old.orientation_letters();
        let placed = place(with(old, &notes), asked(&letters), WHO).unwrap();
        assert_eq!((placed.info().affine, &placed.info().notes[..]), (old, &notes[1..]));
        let placed = place(with(old, &notes), asked("LPS"), WHO).unwrap();
        assert_eq!(placed.info().notes, [directions_replaced(WHO, Orientation::LPS, &letters)]);
    }

    #[test]
    fn the_same_spacing_is_no_news_and_an_impossible_one_is_refused() {
        let stated = Affine::from_spacing([0.5, 0.5, 1.2]);
        let placed = place(with(stated, &[]), spacing([0.5, 0.5, 1.200_001]), WHO).unwrap();
        assert!(placed.info().notes.is_empty());
        // Assumed along x only.
        let partly = Affine::from_spacing([1.0, 0.5, 1.2]);
        let notes = [Note::no_spacing("the header")];
        let placed = place(with(partly, &notes), spacing([0.5, 0.5, 1.2]), WHO).unwrap();
        assert!(placed.info().notes.is_empty());
        let placed = place(with(partly, &notes), spacing([0.5, 0.5, 2.0]), WHO).unwrap();
        let text = placed.info().notes[0].to_string();
        assert!(text.contains("1.2 mm"), "{text}");
        let refused = place(with(stated, &[]), spacing([1e-300, 1e-300, 1.0]), WHO).err().unwrap();
        assert!(refused.kind() == ExitKind::Usage && refused.to_string().contains("out of range"));
        assert!(place(with(stated, &[]), Placement::default(), WHO).unwrap().info().notes.is_empty());
    }
}
