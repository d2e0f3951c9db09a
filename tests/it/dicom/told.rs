//! What a series says and what it lacks reaches the user: doses are scaled, images that were set apart are
//! named beside the gap that they leave, slices that were made are counted, and floating-point padding is replaced. If one fails, a model has wrong
//! values, or a user looks for a file that is there.

use crate::prelude::*;
use infobyte::discovery::open_unprepared as open;

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

fn refusal(images: &[Elements]) -> String {
    opened(images, GapPolicy::Error).1.unwrap_err().to_string()
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
    assert!(sentences(&bare.notes).iter().any(|w| w.contains("no dose grid scaling")), "{:?}", bare.notes);
}

#[test]
fn images_that_were_set_apart_are_named_beside_the_gap_they_leave() {
    for (tag, vr, value, words) in [
        (0x0020_0037, "DS", "1\\0\\0\\0\\0.8\\0.6", "Image Orientation (0020,0037)"),
        (0x0028_0030, "DS", "0.9\\0.5", "Pixel Spacing (0028,0030)"),
        (0x0008_0008, "CS", "DERIVED\\SECONDARY", "Image Type (0008,0008)"),
    ] {
        let mut all = images(6);
        all[3].set(tag, vr, value);
        let sentence = refusal(&all);
        let expected = format!(
            "; 1 other image of the series was set apart because of a different {words} (first: 4.dcm)"
        );
        assert!(
            sentence.contains("probably missing: 1 slice in") && sentence.contains(&expected),
            "{sentence}"
        );
    }
    // Without one, nothing is said; an overview fills no gap.
    let mut all = images(6);
    all[3].set(0x0008_0008, "CS", "ORIGINAL\\PRIMARY\\LOCALIZER");
    assert!(!refusal(&all).contains("set apart"));
}

#[test]
fn slices_that_were_made_are_counted_and_placed() {
    let mut all = images(6);
    all.remove(3);
    let (_keep, volume) = opened(&all, GapPolicy::Fill);
    let warnings = sentences(&volume.unwrap().info().notes);
    let expected = "gaps between slices were filled: 1 of 6 were made by interpolation between neighbours \
                    (1 between 3.dcm and 4.dcm)";
    assert!(warnings.iter().any(|w| w.starts_with(expected)), "{warnings:?}");
}

#[test]
fn pixels_without_any_description_are_refused_as_such() {
    let mut image = Elements::ct(0.0, 1, [1, 2, 3, 4]);
    for tag in [0x0028_0010, 0x0028_0011, 0x0028_0100] {
        image.without(tag);
    }
    let sentence = refusal(&[image]);
    assert!(sentence.contains("8 bytes of pixel data, but no image description"), "{sentence}");
}

#[test]
fn floating_point_padding_becomes_the_background() {
    for (modality, background) in [("CT", -1000.0_f32), ("MR", 0.0)] {
        for padding in [f32::NAN, -3.4e38] {
            let mut all = images(2);
            for image in &mut all {
                let pixels = [padding, 1.5, -2.5, padding];
                let bytes: Vec<u8> = pixels.iter().flat_map(|v| v.to_le_bytes()).collect();
                image.set(0x0008_0060, "CS", modality).us(0x0028_0100, 32).without(0x7fe0_0010);
                image.raw(0x0028_0122, "FL", &padding.to_le_bytes()).raw(0x7fe0_0008, "OF", &bytes);
            }
            let (_keep, volume) = opened(&all, GapPolicy::Error);
            let mut out = [0; 16];
            volume.unwrap().read_rows(1, 0..2, 0..2, &mut out).unwrap();
            let got: Vec<f32> = out.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
            assert_eq!(got, [background, 1.5, -2.5, background], "{modality} {padding}");
        }
    }
}
