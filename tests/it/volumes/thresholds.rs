//! Thresholds that the program chooses: of labels, of padded slices, and else by Otsu's method.

use std::ops::Range;

use infobyte::builder::{BuildNote, BuildReport, Silent, build_volume};
use infobyte::format::{Selection, SelectionKind};
use infobyte::volume::{SourceError, VolumeInfo};
use infobyte::{BuildOptions, Dims, Threshold, VolumeSource, Voxels};

use crate::common::models::skin_options;
use crate::common::random::Random;

const SIDE: u32 = 64;

fn dims() -> Dims {
    Dims::new(SIDE, SIDE, 24).unwrap()
}

fn chosen(volume: &dyn VolumeSource) -> Selection {
    report(volume).selection
}

fn report(volume: &dyn VolumeSource) -> BuildReport {
    let folder = tempfile::tempdir().unwrap();
    let options = BuildOptions { threshold: Threshold::Otsu, threads: 2, ..skin_options() };
    build_volume(volume, &options, &folder.path().join("m.oct"), &Silent).unwrap()
}

/// From the middle of a slice, as a part of the circle that it has room for.
fn away([x, y, _]: [u32; 3]) -> f64 {
    let [x, y] = [x, y].map(|c| (f64::from(c) + 0.5) / f64::from(SIDE) * 2.0 - 1.0);
    (x * x + y * y).sqrt()
}

/// Organs: blobs with a label each, by their distance to seeds.
fn label(p: [u32; 3], labels: &[u8]) -> u8 {
    let mut random = Random(5);
    for label in labels {
        let seed = [random.below(SIDE), random.below(SIDE), random.below(24)].map(f64::from);
        let r = 6.0 + 5.0 * random.unit();
        let away: f64 = (0..3).map(|a| (f64::from(p[a]) - seed[a]).powi(2)).sum();
        if away < r * r {
            return *label;
        }
    }
    0
}

#[test]
fn every_label_is_inside_and_a_note_says_so() {
    let many: Vec<u8> = (1..=40).map(|n| n * 3).collect();
    for labels in [&many[..], &[1, 2, 3, 4, 5], &[7, 200, 255]] {
        let volume = Voxels::from_fn(dims(), |p| label(p, labels));
        let selection = chosen(&volume);
        assert_eq!((selection.kind, selection.hi), (SelectionKind::Iso, f64::INFINITY), "{labels:?}");
        assert!(selection.lo > 0.0 && selection.lo <= f64::from(labels[0]), "{selection:?}");
        let report = report(&volume);
        assert!(matches!(report.notes[..], [BuildNote::Labels { count }] if count <= labels.len()));
        // As other types hold them.
        let wide = Voxels::from_fn(dims(), |p| i32::from(label(p, labels)));
        let float = Voxels::from_fn(dims(), |p| f32::from(label(p, labels)));
        assert!([chosen(&wide), chosen(&float)].iter().all(|other| other == &selection));
    }
    // A mask has one label: any threshold is right.
    let mask = Voxels::from_fn(dims(), |p| 255 * u8::from(label(p, &many) > 0));
    assert_eq!((chosen(&mask).kind, report(&mask).notes.len()), (SelectionKind::Otsu, 0));
}

/// A head with a bright skull in noise, as air, tissue and bone.
#[expect(clippy::cast_possible_truncation, reason = "below 2^11")]
fn head(p: [u32; 3], noise: f64) -> f64 {
    let seed = u64::from(p[0]) | u64::from(p[1]) << 16 | u64::from(p[2]) << 32;
    let mut random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let wobble = (0..4).map(|_| random.unit() - 0.5).sum::<f64>() * noise;
    let smooth = |edge: f64| ((edge - away(p)) * 16.0).clamp(0.0, 1.0);
    let value = -1000.0 + 1040.0 * smooth(0.7) + 900.0 * (smooth(0.7) - smooth(0.6));
    ((value + wobble) as i32).into()
}

/// Pictures in few greys have as wide regions as labels, but one after the other.
#[test]
fn pictures_in_few_greys_are_not_taken_for_labels() {
    for (levels, noise) in [(4.0, 0.0), (8.0, 0.0), (16.0, 0.0), (16.0, 100.0), (64.0, 30.0), (256.0, 5.0)] {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
        let grey = |p: [u32; 3]| {
            let part = ((head(p, noise) + 1100.0) / 2100.0).clamp(0.0, 0.999);
            (part * levels) as u8
        };
        let volume = Voxels::from_fn(dims(), grey);
        assert_eq!(chosen(&volume).kind, SelectionKind::Otsu, "{levels} {noise}");
        assert!(report(&volume).notes.is_empty());
    }
}

#[test]
fn padding_is_left_out() {
    #[expect(clippy::cast_possible_truncation, reason = "below 2^15")]
    let of = |padding: Option<i16>| {
        Voxels::from_fn(dims(), move |p| match padding {
            Some(padding) if away(p) > 1.0 => padding,
            _ => head(p, 60.0) as i16,
        })
    };
    let plain = of(None);
    let want = chosen(&plain).lo;
    assert!((-700.0..-300.0).contains(&want) && report(&plain).notes.is_empty(), "{want}");
    for padding in [-3024, -2048, -2000, -32768, 32767, 4095] {
        let volume = of(Some(padding));
        let lo = chosen(&volume).lo;
        assert!((lo - want).abs() < 60.0, "{padding}: {lo} {want}");
        let notes = report(&volume).notes;
        assert!(
            matches!(notes[..], [BuildNote::Padding { value }] if value == f64::from(padding)),
            "{notes:?}"
        );
    }
    // What is as air does no harm, and a body that was cut out of its picture stays as it is.
    let cut = Voxels::from_fn(dims(), |p| if away(p) < 0.65 { head(p, 60.0) } else { -3024.0 });
    assert!(report(&of(Some(-1024))).notes.is_empty() && report(&cut).notes.is_empty());
}

/// A picture that a device has taken, in a few flat greys.
struct Taken(Voxels<u8>, &'static str);

impl VolumeSource for Taken {
    fn info(&self) -> &VolumeInfo {
        self.0.info()
    }

    fn read_rows(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        self.0.read_rows(z, rows, cols, out)
    }

    fn modality(&self) -> Option<&str> {
        Some(self.1)
    }
}

#[test]
fn pictures_of_a_device_are_not_taken_for_labels() {
    let labels: Vec<u8> = (1..=40).map(|n| n * 3).collect();
    for (modality, kind) in
        [("US", SelectionKind::Otsu), ("CT", SelectionKind::Otsu), ("SEG", SelectionKind::Iso)]
    {
        let volume = Taken(Voxels::from_fn(dims(), |p| label(p, &labels)), modality);
        assert_eq!(chosen(&volume).kind, kind, "{modality}");
    }
}
