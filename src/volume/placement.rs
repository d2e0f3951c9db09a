//! Spacing and directions that come from outside the file: from the command line, or from a side-car.
//!
//! Pictures and arrays state neither, and some headers state less than they could. What a format then assumes it
//! tells in a warning of one of the forms made here; the warning itself is the record of it, and goes when
//! somebody states what was missing.

use super::noted::Noted;
use super::{SourceError, Treatment, VolumeInfo, VolumeSource};
use crate::geom::Orientation;

/// Spacing and directions that are stated outside the file; what is stated comes before what the file says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Placement {
    /// Distance in mm between neighbours along x, y, z; finite and positive.
    pub spacing_mm: Option<[f64; 3]>,
    /// Directions of the index axes in the patient.
    pub orientation: Option<Orientation>,
}

/// End of a warning that tells of an assumed spacing.
const NO_SPACING: &str = "; 1 mm is assumed";

/// Ends of warnings that tell of assumed directions.
const NO_DIRECTIONS: [&str; 2] = [" taken as LPS", " so left and right may be swapped"];

/// End of a warning that tells of axes that run backwards.
const PLACED_SO: &str = " (Orientation), and are placed so";

/// Relative difference of spacings that are the same; headers print six digits.
const TOLERANCE: f64 = 1e-5;

/// The warning of a format whose files, or one of whose headers, state no spacing: `PNG`, `the header`, ...
pub(crate) fn no_spacing(what: &str) -> String {
    format!("{what} states no spacing{NO_SPACING}")
}

/// The warning of a format whose files state no directions.
pub(crate) fn no_directions(what: &str) -> String {
    format!("{what} states no directions; its axes are{}", NO_DIRECTIONS[0])
}

/// The warning of a format that states from which end columns or rows are stored, which is heeded.
pub(crate) fn placed_so(what: &str) -> String {
    format!("{what}{PLACED_SO}")
}

fn assumes_spacing(warning: &str) -> bool {
    warning.ends_with(NO_SPACING)
}

fn assumes_directions(warning: &str) -> bool {
    NO_DIRECTIONS.iter().any(|end| warning.ends_with(end))
}

impl Placement {
    /// Is nothing stated?
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// What is stated here, and where nothing is, what `other` states.
    pub(crate) fn or(self, other: Self) -> Self {
        Self {
            spacing_mm: self.spacing_mm.or(other.spacing_mm),
            orientation: self.orientation.or(other.orientation),
        }
    }
}

/// A volume with the spacing and directions that were stated for it by `who` (`--spacing`, `the side-car`).
///
/// The affine's columns are scaled, so that oblique axes and gantry tilt stay; only where the letters of the
/// axes differ are they laid along the patient's. Voxel (0, 0, 0) stays where it is. What the file stated
/// otherwise is told in a warning, and noted behind the name of the source.
///
/// # Errors
/// [`SourceError::Usage`] for a spacing that makes no sound affine, such as 1e-300 mm.
pub(crate) fn place(
    source: Box<dyn VolumeSource>,
    asked: Placement,
    who: [&str; 2],
) -> Result<Box<dyn VolumeSource>, SourceError> {
    if asked.is_empty() {
        return Ok(source);
    }
    let mut info = source.info().clone();
    if let Some(spacing) = asked.spacing_mm {
        scale(&mut info, spacing, who[0]);
    }
    if let Some(orientation) = asked.orientation {
        turn(&mut info, orientation, who[1]);
    }
    if info.affine.inverse().is_none() {
        return Err(SourceError::Usage {
            path: info.description.name.into(),
            reason: format!("{} is out of range; give the distance of voxels in mm", who[0]),
        });
    }
    Ok(Box::new(Noted { source, info }))
}

fn scale(info: &mut VolumeInfo, spacing_mm: [f64; 3], who: &str) {
    let assumed = info.warnings.iter().any(|w| assumes_spacing(w));
    info.warnings.retain(|w| !assumes_spacing(w));
    let old = info.spacing_mm;
    // Of a header that lacks the spacing of one axis, 1 mm is what was assumed.
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
        info.warnings.push(format!(
            "{who} gives {}; the file states {}, which is not used",
            mm(spacing_mm),
            mm(old)
        ));
    }
}

fn turn(info: &mut VolumeInfo, orientation: Orientation, who: &str) {
    let assumed = info.warnings.iter().any(|w| assumes_directions(w));
    info.warnings.retain(|w| !assumes_directions(w));
    let (old, new) = (info.affine.orientation_letters(), orientation.to_string());
    if old == new {
        return;
    }
    let backwards = info.warnings.iter().any(|w| w.ends_with(PLACED_SO));
    info.warnings.retain(|w| !w.ends_with(PLACED_SO));
    let origin = info.affine.origin();
    info.affine = orientation.affine(info.spacing_mm);
    for (row, at) in info.affine.rows.iter_mut().zip(origin) {
        row[3] = at;
    }
    if !assumed || backwards {
        info.description.treatments.push(Treatment::DirectionsReplaced);
        info.warnings.push(format!(
            "{who} gives {new}; the directions that the file states, about {old}, are not used"
        ));
    }
}

/// A spacing for people: six digits, as headers print it.
fn mm(spacing_mm: [f64; 3]) -> String {
    let [x, y, z] = spacing_mm.map(|mm| format!("{mm:.5e}").parse().unwrap_or(mm));
    format!("{x} x {y} x {z} mm")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Affine, Dims};
    use crate::source::{RawOptions, RawVolume};
    use crate::volume::{Endian, ScalarType};

    const WHO: [&str; 2] = ["--spacing", "--orientation"];

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
        ) -> Result<(), SourceError> {
            Ok(())
        }
    }

    /// Info of some volume with an affine and warnings.
    fn with(affine: Affine, warnings: &[String]) -> Box<dyn VolumeSource> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, [0; 8]).unwrap();
        let options = RawOptions {
            dims: Dims::new(2, 2, 2).unwrap(),
            scalar: ScalarType::U8,
            endian: Endian::Little,
            spacing_mm: [1.0; 3],
            skip: 0,
            orientation: Orientation::LPS,
        };
        let mut info = RawVolume::open(&[path], &options).unwrap().info().clone();
        (info.affine, info.spacing_mm, info.warnings) = (affine, affine.spacing_mm(), warnings.to_vec());
        Box::new(Fake(info))
    }

    fn spacing(mm: [f64; 3]) -> Placement {
        Placement { spacing_mm: Some(mm), orientation: None }
    }

    #[test]
    fn what_was_assumed_is_replaced_in_silence() {
        let notes = [no_spacing("PNG"), no_directions("PNG"), "12 bits".into()];
        let source = with(Affine::from_spacing([1.0; 3]), &notes);
        let placed = place(source, spacing([0.5, 0.25, 2.0]), WHO).unwrap();
        let info = placed.info();
        assert_eq!(
            (info.spacing_mm, info.affine),
            ([0.5, 0.25, 2.0], Affine::from_spacing([0.5, 0.25, 2.0]))
        );
        assert_eq!(info.warnings, notes[1..]);
        let asked = Placement { spacing_mm: None, orientation: Orientation::parse("LPI") };
        let placed = place(placed, asked, WHO).unwrap();
        assert_eq!(placed.info().affine.orientation_letters(), "LPI");
        assert_eq!(placed.info().warnings, notes[2..]);
        assert_eq!(placed.info().description.name, "a.raw");
    }

    #[test]
    fn what_was_stated_is_replaced_with_a_warning_and_oblique_axes_stay() {
        let rows = [[0.6, 0.1, 0.0, -20.0], [0.0, 0.8, -0.9, 30.0], [0.1, 0.0, 2.9, 7.0]];
        let old = Affine { rows };
        let placed = place(with(old, &[]), spacing([1.0, 2.0, 3.0]), WHO).unwrap();
        let info = placed.info();
        assert_eq!((info.spacing_mm, info.affine.origin()), ([1.0, 2.0, 3.0], old.origin()));
        for (axis, want) in [1.0, 2.0, 3.0].into_iter().enumerate() {
            let (a, b) = (old.column(axis), info.affine.column(axis));
            assert!((info.affine.spacing_mm()[axis] - want).abs() < 1e-12);
            for (from, to) in a.iter().zip(b) {
                assert!((from / old.spacing_mm()[axis] - to / want).abs() < 1e-12, "directions stay");
            }
        }
        let [warning] = info.warnings.as_slice() else { panic!("{:?}", info.warnings) };
        assert!(warning.contains("1 x 2 x 3 mm") && warning.contains("states 0.608"), "{warning}");
        assert_eq!(info.description.treatments, [Treatment::SpacingReplaced]);
        // The letters that the file states already change nothing, others lay the axes along the patient's.
        let asked = |letters: &str| Placement { spacing_mm: None, orientation: Orientation::parse(letters) };
        assert_eq!(place(with(old, &[]), asked("lps"), WHO).unwrap().info().affine, old);
        let placed = place(with(old, &[]), asked("RAS"), WHO).unwrap();
        let info = placed.info();
        assert_eq!((info.affine.orientation_letters(), info.affine.origin()), ("RAS".into(), old.origin()));
        assert!(info.warnings[0].contains("RAS") && info.warnings[0].contains("LPS"), "{:?}", info.warnings);
    }

    #[test]
    fn axes_that_run_backwards_are_not_told_of_where_others_were_asked_for() {
        let old = Affine { rows: [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 5.0], [0.0, 0.0, 1.0, 0.0]] };
        let notes = [no_directions("TIFF"), placed_so("rows are stored from the bottom up")];
        let asked = |letters: &str| Placement { spacing_mm: None, orientation: Orientation::parse(letters) };
        let letters = old.orientation_letters();
        let placed = place(with(old, &notes), asked(&letters), WHO).unwrap();
        assert_eq!((placed.info().affine, &placed.info().warnings[..]), (old, &notes[1..]));
        let placed = place(with(old, &notes), asked("LPS"), WHO).unwrap();
        let [warning] = placed.info().warnings.as_slice() else { panic!("{:?}", placed.info().warnings) };
        assert!(warning.contains("LPS") && warning.contains(&letters), "{warning}");
    }

    #[test]
    fn the_same_spacing_is_no_news_and_an_impossible_one_is_refused() {
        let stated = Affine::from_spacing([0.5, 0.5, 1.2]);
        let placed = place(with(stated, &[]), spacing([0.5, 0.5, 1.200_001]), WHO).unwrap();
        assert!(placed.info().warnings.is_empty());
        // Assumed along x only.
        let partly = Affine::from_spacing([1.0, 0.5, 1.2]);
        let notes = [no_spacing("the header")];
        let placed = place(with(partly, &notes), spacing([0.5, 0.5, 1.2]), WHO).unwrap();
        assert!(placed.info().warnings.is_empty());
        let placed = place(with(partly, &notes), spacing([0.5, 0.5, 2.0]), WHO).unwrap();
        assert!(placed.info().warnings[0].contains("1.2 mm"), "{:?}", placed.info().warnings);
        let refused = place(with(stated, &[]), spacing([1e-300, 1e-300, 1.0]), WHO).err().unwrap();
        assert!(matches!(refused, SourceError::Usage { .. }) && refused.to_string().contains("out of range"));
        assert!(place(with(stated, &[]), Placement::default(), WHO).unwrap().info().warnings.is_empty());
    }
}
