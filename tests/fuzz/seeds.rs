//! What the fuzzer begins with: small sound inputs of every kind, by target.

use std::fs;

use infobyte::format::{Channels, SurfaceKind};
use infobyte::jobs::pack;
use infobyte::volume::ScalarType;
use infobyte::{BuildOptions, Dims, Threshold, Voxels};

use crate::common::containers::{buffer, description, glb, gltf, threemf};
use crate::common::dicom::{Elements, Image, Syntax, csa, mosaic};
use crate::common::formats::{
    Object, Tiff, amira, bzip2, gzip, metaimage, mrc, nifti, npy, nrrd, pngs, vgi, vtk, zlib,
};
use crate::common::frames::{DEFLATED, ENCAPSULATED, RLE, Spec, deflated, encapsulated, rle, rle16};
use crate::common::meshes::Body;
use crate::common::{FULL, NORMALS, corner, shell};

/// Target and content of each.
pub(crate) fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let mut all = Vec::new();
    models(&mut all);
    dicoms(&mut all);
    volumes(&mut all);
    bodies(&mut all);
    scenes(&mut all);
    all
}

/// Two scenes: all that a body can be, and all that stands around it.
fn scenes(all: &mut Seeds) {
    let body = r##"bounces = 2
samples = 2
[[model]]
file = "m.oct"
material = "a"
scale = [1, -2.5, 1]
turn = [10, 0, 7]
pivot = "origin"
at = [1, 2, 3]
[[model]]
file = "m.oct"
material = "ct-bone"
place = [[1, 0, 0, 9], [0, 2, 0, 0], [0, 0.5, 1, 0]]
[material.a]
preset = "glass"
channel = "value"
colors = [[-1, "#102030"], [0.5, "#ffffff"]]
index = 1.3
mirror = 0.2
"##;
    let around = r##"size = [9, 8]
background = "#8aa4b8"
bounces = 1
model = [{ file = "m.oct", material = "metal", framed = true, clip = { planes = [[1, 0, 1, 4]] } }]
[camera]
projection = "perspective"
eye = [3, -9, 4]
look_at = [3, 3, 2]
near = 0.5
[[light]]
kind = "point"
at = [-5, -5, 9]
[[light]]
kind = "directional"
from = [1, -1, 1]
strength = 0.3
shadows = false
[ambient]
rays = 4
reach = 5
[clip]
box = [[0, 0, 0], [6, 5, 3]]
cap = "#e8d8b0"
"##;
    all.extend([body, around].map(|text| ("scene", text.as_bytes().to_vec())));
}

type Seeds = Vec<(&'static str, Vec<u8>)>;

fn models(all: &mut Seeds) {
    let folder = tempfile::tempdir().unwrap();
    let [path, packed] = ["m.oct", "p.oct"].map(|name| folder.path().join(name));
    let mut mapped = vec![
        shell([12, 9, 10], FULL, 5),
        shell([9, 12, 7], NORMALS, 6),
        corner([3, 2, 1], NORMALS),
        corner([1, 1, 1], FULL),
        corner([70, 2, 65], FULL),
    ];
    let ball = Voxels::from_fn(Dims::new(11, 10, 9).unwrap(), |p| {
        let square = |c: u32, m: f32| (f32::from(u16::try_from(c).unwrap()) - m).powi(2);
        3.6 - (square(p[0], 5.1) + square(p[1], 4.4) + square(p[2], 4.2)).sqrt()
    });
    for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
        let options = BuildOptions { threshold: Threshold::Iso(0.0), surface, ..BuildOptions::default() };
        infobyte::build(&ball, &options, &path).unwrap();
        mapped.push(fs::read(&path).unwrap());
    }
    let plain = BuildOptions {
        threshold: Threshold::Iso(0.0),
        channels: Channels::NONE,
        lod: false,
        ..BuildOptions::default()
    };
    infobyte::build(&ball, &plain, &path).unwrap();
    mapped.push(fs::read(&path).unwrap());
    for bytes in mapped {
        fs::write(&path, &bytes).unwrap();
        pack::pack(&path, &packed).unwrap();
        all.push(("packed", fs::read(&packed).unwrap()));
        all.push(("oct", bytes));
    }
}

fn dicoms(all: &mut Seeds) {
    for (n, syntax) in Syntax::ALL.into_iter().enumerate() {
        all.push(("dicom", Image { syntax, meta: n != 0, ..Image::default() }.bytes()));
    }
    let object = Elements::ct(2.5, 3, [1, 20, 300, 4000]);
    all.push(("dicom", object.bytes()));
    all.push(("dicom", object.with(0x0028_0008, "IS", "1").bytes()));
    all.push(("dicom", deflated(&object.bytes(), false)));
    all.push(("dicom", deflated(&object.bytes(), true)));
    all.push((
        "dicom",
        mosaic(5, [4, 3], "1\\0\\0\\0\\1\\0", &["0", "0", "1"], &|k, j, i| 100 * k + 10 * j + i).bytes(),
    ));
    all.push((
        "dicom",
        object
            .with(0x0029_0010, "LO", "SIEMENS CSA HEADER")
            .raw(0x0029_1010, "OB", &csa(true, &[("B_value", &["1000"])]))
            .bytes(),
    ));
    let frames = Spec { frames: "3", ..Spec::default() };
    let parts: Vec<Vec<u8>> = (0..3).map(|n| rle16(&[n, 2, 3, 4])).collect();
    all.push(("dicom", encapsulated(RLE, frames, &[], &parts)));
    all.push((
        "dicom",
        encapsulated(ENCAPSULATED, frames, &[0, 16, 32], &vec![vec![1, 0, 2, 0, 3, 0, 4, 0]; 3]),
    ));
    let _ = DEFLATED;
    let plane = |n: u8| (0..108).map(|i: u8| if i < 50 { n } else { i.wrapping_mul(n) }).collect::<Vec<u8>>();
    for (choice, planes) in [(0, 1), (0, 2), (6, 2), (0, 3), (0, 4)] {
        let planes: Vec<Vec<u8>> = (1..=planes).map(plane).collect();
        all.push(("rle", [&[choice], &rle(&planes)[..]].concat()));
    }
}

fn volumes(all: &mut Seeds) {
    let folder = tempfile::tempdir().unwrap();
    for (dims, scalar) in
        [([7, 5, 4], ScalarType::I16), ([3, 4, 2], ScalarType::U8), ([4, 3, 2], ScalarType::F32)]
    {
        let object = Object::new(dims, scalar, [0.5, 1.0, 2.0]);
        for encoding in ["raw", "gzip", "bzip2", "ascii", "hex"] {
            all.push(("nrrd", nrrd(&object, encoding, false, "")));
        }
        for version in [1, 2] {
            let whole =
                [nifti(&object, version, version == 2, true, 1), object.ordered(version == 2)].concat();
            all.push(("nifti", gzip(&whole)));
            all.push(("nifti", whole));
        }
        let local = |packed, body: &[u8]| [&metaimage(&object, false, packed, "LOCAL")[..], body].concat();
        all.push(("metaimage", local(false, &object.bytes)));
        all.push(("metaimage", local(true, &zlib(&object.bytes))));
        all.push(("metaimage", local(true, &bzip2(&object.bytes))));
        all.push(("mrc", mrc(&object, true)));
        all.push(("vgi", vgi(&object, "case.vol")));
        all.push(("vtk", vtk(&object)));
        all.push(("amira", amira(&object, false)));
        for version in [1, 2, 3] {
            all.push(("npy", npy(&object, version, false, version == 3)));
        }
        for (compression, predictor, tile, big_tiff) in [
            (1, 1, None, false),
            (1, 1, Some([16, 16]), true),
            (5, 2, None, true),
            (8, 2, Some([16, 16]), false),
            (32773, 1, None, false),
        ] {
            let how = Tiff { compression, predictor, tile, big_tiff, strip: 4, ..Tiff::default() };
            all.push(("tiff", how.write(&object)));
        }
        let described = "ImageJ=1.53\nimages=2\nslices=2\nunit=mm\nspacing=2.0\n".to_string();
        let how = Tiff {
            big_endian: true,
            contiguous: true,
            description: described,
            resolution: Some([2, 1]),
            ..Tiff::default()
        };
        all.push(("tiff", how.write(&object)));
    }
    for scalar in [ScalarType::U8, ScalarType::U16] {
        let object = Object::new([9, 7, 1], scalar, [1.0; 3]);
        let picture = pngs(&object, &folder.path().join("png")).swap_remove(0);
        all.push(("png", fs::read(picture).unwrap()));
    }
}

fn bodies(all: &mut Seeds) {
    let cuboid = Body::cuboid([0.0; 3], [3.0, 2.0, 1.0]);
    for body in [cuboid.with(&Body::octahedron([9.0, 0.0, 0.0], 2.0)), Body::sphere([1.0; 3], 4.0, 3)] {
        all.push(("stl", body.stl()));
        all.push(("stl", body.stl_text()));
        for form in ["ascii", "binary_little_endian", "binary_big_endian"] {
            all.push(("ply", body.ply(form)));
        }
        all.push(("obj", body.obj()));
        all.push(("off", body.off()));
        all.push(("glb", glb(&description(&body), &buffer(&body))));
        all.push(("gltf", gltf(&body)));
        all.push(("threemf", threemf(&body)));
    }
    for text in TREES {
        all.push(("csg", text.as_bytes().to_vec()));
    }
}

/// Trees of solids that together have every operation and most shapes.
const TREES: [&str; 3] = [
    "difference() { cube(size = [9, 8, 7], center = true); sphere($fn = 0, $fa = 12, $fs = 2, r = 3.5);\n\
     multmatrix([[0.8, 0, 0.6, 1], [0, 1, 0, 2], [-0.6, 0, 0.8, 0], [0, 0, 0, 1]]) cylinder(h = 9, r1 = 2, r2 = 1); }",
    "union() { torus(major = 5, minor = 2); linear_extrude(height = 4) polygon(points = [[0, 0], [6, 0], [0, 5]]); }",
    "intersection() { ellipsoid(radii = [5, 4, 3]); halfspace(normal = [0, 1, 1], offset = 1); }",
];
