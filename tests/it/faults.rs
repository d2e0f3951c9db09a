//! Inputs that were once misread, refused or slow, where the folder of real data is there.

use std::path::Path;

use infobyte::Model;
use infobyte::format::Channel;
use infobyte::jobs::measure::measure;

use crate::common::command::oct;
use crate::common::data::real_data;

/// Builds cells of an input, and returns what the program said.
fn build(input: &Path, options: &str, model: &Path) -> String {
    let words =
        ["build", input.to_str().unwrap(), "-o", model.to_str().unwrap(), "--force", "--surface", "cells"];
    let run = oct(&words.into_iter().chain(options.split_whitespace()).collect::<Vec<_>>());
    assert_eq!(run.code, 0, "{input:?}: {run:?}");
    run.stdout + &run.stderr
}

#[test]
fn volumes_have_the_right_size_and_voxels() {
    let Some(root) = real_data("faults") else { return };
    let folder = tempfile::tempdir().unwrap();
    let [model, mask] = ["m.oct", "m.nii"].map(|name| folder.path().join(name));
    for (input, options, dims, inside, note) in [
        ("nested-labels/a.npy", "", [16, 16, 16], 912, "taken for labels"),
        ("nested-labels/brats.npy", "", [16, 16, 16], 1088, "taken for labels"),
        ("dicom-mixed-bits/s", "--iso 500", [4, 4, 6], 24, ""),
        ("dicom-mixed-sign/s", "--iso 500", [4, 4, 4], 16, ""),
        ("dicom-comma-intercept/s", "--iso 500", [4, 4, 4], 16, "decimal commas"),
        ("dicom-comma-spacing/s", "--iso 500", [4, 4, 4], 16, "decimal commas"),
        ("dicom-comma-position/s", "--iso 500", [4, 4, 4], 16, "decimal commas"),
        ("dicom-multiframe-thickness/a.dcm", "--iso 500 --spacing 0.5x0.5x2", [4, 4, 4], 16, ""),
        ("bom/a.mhd", "--iso 500", [4, 4, 4], 8, ""),
        ("bom/a.nhdr", "--iso 500", [4, 4, 4], 8, ""),
        ("bom/t.raw", "--iso 500", [4, 4, 4], 8, ""),
        ("bom/j.raw", "--iso 500", [4, 4, 4], 8, ""),
        ("tiff-shaped-4d/a.tif", "--iso 100", [8, 6, 5], 24, "volume 1 of 2"),
        ("mrc-no-map/a.mrc", "--iso 500", [4, 4, 4], 8, ""),
        ("mrc-no-map/good.map.gz", "--iso 500", [4, 4, 4], 8, ""),
        ("nrrd-gzip-skip-1/a.nhdr", "--iso 500", [4, 4, 4], 8, ""),
        ("zarr-nested-undeclared/a.zarr", "--iso 500", [4, 4, 4], 8, ""),
        ("vtk-field-first/a.vtk", "--iso 500", [4, 4, 4], 8, ""),
    ] {
        let said = build(&root.join(input), options, &model);
        assert!(said.contains(note), "{input}: {said}");
        let of = |path: &Path| path.to_str().unwrap().to_owned();
        assert_eq!(oct(&["export", &of(&model), "-o", &of(&mask), "--force"]).code, 0, "{input}");
        let bytes = std::fs::read(&mask).unwrap();
        let found = bytes[352..].iter().filter(|sample| **sample > 0).count();
        let sides = [0, 1, 2].map(|a| u16::from_le_bytes([bytes[42 + 2 * a], bytes[43 + 2 * a]]));
        assert_eq!((sides, found), (dims, inside), "{input}");
    }
    let volume = |name: &str| {
        build(&root.join("nan-outside").join(name), "--iso 500", &model);
        volume_mm3(&model)
    };
    let [nan, zero] = ["a.npy", "zero.npy"].map(volume);
    assert!((nan - zero).abs() < 1e-6 && (nan - 520.0).abs() < 10.0, "{nan} {zero}");
}

fn volume_mm3(model: &Path) -> f64 {
    let model = Model::open(model).unwrap();
    measure(&model.view(), model.dims(), &model.affine(), false).unwrap().volume_mm3.unwrap().0
}

#[test]
fn meshes_and_trees_are_the_bodies_that_they_state() {
    let Some(root) = real_data("faults") else { return };
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("m.oct");
    for (input, due, is_coloured) in [
        ("stl-one-byte-more/a.stl", 1000.0, false),
        ("off-modelnet/a.off", 1000.0, false),
        ("off-modelnet/comment-first.off", 1000.0, false),
        ("bom/v-first.obj", 1000.0, false),
        ("bom/a.stl", 1000.0, false),
        ("bom/a.ply", 1000.0, false),
        ("bom/a.off", 1000.0, false),
        ("bom/shift.obj", 1000.0, false),
        ("bom/mtllib-first.obj", 1000.0, true),
        ("bom/bom-in-mtl.obj", 1000.0, true),
        ("parts-note/a.obj", 1000.0, false),
        ("csg-two-modifiers/a.csg", 1.0, false),
        ("ply-lists/vertex-list.ply", 1000.0, false),
        ("ply-lists/other-list-before.ply", 1000.0, false),
        ("ply-lists/faces-first.ply", 1000.0, false),
        ("3mf-support/type-support.3mf", 1000.0, false),
        ("3mf-support/prusa-blocker.3mf", 1000.0, false),
    ] {
        let said = build(&root.join(input), "--grid 32", &model);
        assert!(!said.contains("not in the model"), "{input}: {said}");
        let found = volume_mm3(&model);
        assert!((found / due - 1.0).abs() < 0.01, "{input}: {found}");
        assert_eq!(Model::open(&model).unwrap().items(Channel::Color).is_some(), is_coloured, "{input}");
    }
    let refused = |input: &str, words: &[&str]| {
        let input = root.join(input);
        let words_of = ["build", input.to_str().unwrap(), "-o", model.to_str().unwrap(), "--force"];
        oct(&words_of).refused(3, words);
    };
    refused("ply-lists/points.ply", &["no faces"]);
    refused("mhd-comma/a.mhd", &["elementspacing", "1,5"]);
}
