//! What a series says and what it lacks reaches the user: doses are scaled, images that were set apart are
//! named beside the gap that they leave, and slices that were made are counted. If one fails, a model has wrong
//! values, or a user looks for a file that is there.

use std::fs;

use infobyte::source::{GapPolicy, OpenOptions, SourceError, VolumeSource, open};

#[path = "support/dicom.rs"]
mod dicom;
use dicom::Elements;

/// Opens images written as 1.dcm, 2.dcm, ...; the folder lives as long as the volume.
fn opened(
    images: &[Elements],
    gaps: GapPolicy,
) -> (tempfile::TempDir, Result<Box<dyn VolumeSource>, SourceError>) {
    let folder = tempfile::tempdir().unwrap();
    for (i, image) in images.iter().enumerate() {
        fs::write(folder.path().join(format!("{}.dcm", i + 1)), image.bytes()).unwrap();
    }
    let options = OpenOptions { gaps, ..OpenOptions::default() };
    let volume = open(&[folder.path().to_path_buf()], &options);
    (folder, volume)
}

fn images(count: i32) -> Vec<Elements> {
    (0..count).map(|i| Elements::ct(f64::from(i), i + 1, [1, 2, 3, 4])).collect()
}

#[test]
fn a_dose_is_scaled_by_its_grid_scaling_alone() {
    let dose = |scaling: Option<&str>| {
        let mut all = images(2);
        for image in &mut all {
            image.set(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.481.2").set(0x0008_0060, "CS", "RTDOSE");
            if let Some(scaling) = scaling {
                image.set(0x3004_000e, "DS", scaling);
            }
        }
        let (_keep, volume) = opened(&all, GapPolicy::Error);
        volume.unwrap().info().clone()
    };
    let scaled = dose(Some("0.00025"));
    assert_eq!((scaled.rescale.slope, scaled.rescale.intercept), (0.00025, 0.0));
    let bare = dose(None);
    assert_eq!((bare.rescale.slope, bare.rescale.intercept), (1.0, 0.0));
    assert!(bare.warnings.iter().any(|w| w.contains("no dose grid scaling")), "{:?}", bare.warnings);
}
