//! What the fuzzer begins with: small sound inputs of every kind, by target.

use std::fs;

use infobyte::builder::{LabelChoice, Silent, Tolerance};
use infobyte::format::{Channels, SurfaceKind};
use infobyte::jobs::build::BuildJob;
use infobyte::jobs::pack;
use infobyte::jobs::parts::{PartsInput, Plan, part, plan};
use infobyte::source::{OpenOptions, SubjectKind};
use infobyte::volume::ScalarType;
use infobyte::{BuildOptions, CleanOptions, Dims, GridOptions, Threshold, Voxels};

use crate::common::compress::blosc;
use crate::common::containers::{buffer, description, glb, gltf, threemf};
use crate::common::dicom::{Elements, Image, Syntax, csa, mosaic};
use crate::common::formats::{
    Object, Tiff, amira, bzip2, gzip, metaimage, mrc, nifti, npy, nrrd, pngs, vgi, vtk, zlib,
};
use crate::common::frames::{DEFLATED, ENCAPSULATED, RLE, Spec, deflated, encapsulated, rle, rle16};
use crate::common::meshes::Body;
use crate::common::models::skin_options;
use crate::common::{FULL, NORMALS, corner, shell};

/// Target and content of each.
pub(crate) fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let mut all = Vec::new();
    models(&mut all);
    dicoms(&mut all);
    volumes(&mut all);
    bodies(&mut all);
    scenes(&mut all);
    arrays(&mut all);
    parts(&mut all);
    plain_meshes(&mut all);
    tables(&mut all);
    all
}

/// Arrays of one chunk in every packing, shards, and images of one level.
fn arrays(all: &mut Seeds) {
    let samples: Vec<u8> = (0..24).map(|n| 20 + 9 * (n % 7)).collect();
    let mut put = |kind: u8, metadata: String, chunk: &[u8]| {
        let length = u16::try_from(metadata.len()).unwrap().to_le_bytes();
        all.push(("zarr", [&[kind], &length[..], metadata.as_bytes(), chunk].concat()));
    };
    let old = |compressor: &str| {
        format!(
            r#"{{"zarr_format":2,"shape":[2,3,4],"chunks":[2,3,4],"dtype":"|u1","compressor":{compressor},"fill_value":0,"order":"C","filters":null}}"#
        )
    };
    put(0, old("null"), &samples);
    put(0, old(r#"{"id":"zlib","level":1}"#), &zlib(&samples));
    put(0, old(r#"{"id":"gzip","level":1}"#), &gzip(&samples));
    put(0, old(r#"{"id":"zstd","level":1}"#), &zstd::bulk::compress(&samples, 1).unwrap());
    let lz4 = [&24_u32.to_le_bytes()[..], &lz4_flex::block::compress(&samples)].concat();
    put(0, old(r#"{"id":"lz4","acceleration":1}"#), &lz4);
    for (bits, split) in [(false, false), (true, false), (false, true)] {
        let packed = blosc(&samples, 1, bits, split);
        put(0, old(r#"{"id":"blosc","cname":"lz4","clevel":5,"shuffle":1,"blocksize":0}"#), &packed);
    }
    let new = |chunk: [u32; 3], codecs: &str| {
        format!(
            r#"{{"zarr_format":3,"node_type":"array","shape":[2,3,4],"data_type":"uint8","fill_value":0,"chunk_grid":{{"name":"regular","configuration":{{"chunk_shape":{chunk:?}}}}},"chunk_key_encoding":{{"name":"default","configuration":{{"separator":"/"}}}},"codecs":[{codecs}]}}"#
        )
    };
    let raw = r#"{"name":"bytes","configuration":{"endian":"little"}}"#;
    let summed = |bytes: &[u8]| [bytes, &crc32c::crc32c(bytes).to_le_bytes()].concat();
    put(1, new([2, 3, 4], raw), &samples);
    put(1, new([2, 3, 4], &format!(r#"{raw},{{"name":"crc32c"}}"#)), &summed(&samples));
    put(
        1,
        new([2, 3, 4], &format!(r#"{raw},{{"name":"gzip","configuration":{{"level":1}}}}"#)),
        &gzip(&samples),
    );
    let shard = format!(
        r#"{{"name":"sharding_indexed","configuration":{{"chunk_shape":[2,3,2],"codecs":[{raw}],"index_codecs":[{raw},{{"name":"crc32c"}}],"index_location":"end"}}}}"#
    );
    let index: Vec<u8> = [0_u64, 12, 12, 12].iter().flat_map(|n| n.to_le_bytes()).collect();
    put(1, new([2, 3, 4], &shard), &[&samples[..], &summed(&index)].concat());
    let scales = r#""axes":[{"name":"z","type":"space","unit":"micrometer"},{"name":"y","type":"space"},{"name":"x","type":"space"}],"datasets":[{"path":"0","coordinateTransformations":[{"type":"scale","scale":[2,1,0.5]}]}]"#;
    put(2, format!(r#"{{"multiscales":[{{"version":"0.4",{scales}}}]}}"#), &samples);
    put(
        3,
        format!(
            r#"{{"zarr_format":3,"node_type":"group","attributes":{{"ome":{{"version":"0.5","multiscales":[{{{scales}}}]}}}}}}"#
        ),
        &samples,
    );
}

/// The only part of plans of small volumes.
fn parts(all: &mut Seeds) {
    let folder = tempfile::tempdir().unwrap();
    let object = Object::new([19, 11, 9], ScalarType::U8, [1.0; 3]);
    let path = folder.path().join("v.nrrd");
    fs::write(&path, nrrd(&object, "raw", false, "")).unwrap();
    let inputs = [path];
    for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
        let options = BuildOptions {
            threshold: Threshold::Iso(128.0),
            surface: Some(surface),
            ..BuildOptions::default()
        };
        let (how, clean, grid) = (OpenOptions::default(), CleanOptions::default(), GridOptions::default());
        let job = BuildJob {
            output: folder.path(),
            clean: &clean,
            grid: &grid,
            options: &options,
            progress: &Silent,
        };
        let input = PartsInput { kind: SubjectKind::Volume, inputs: &inputs, how: &how, job };
        let out = folder.path().join(format!("{surface:?}"));
        plan(&input, 1, &out, Vec::new(), "/").unwrap();
        let plan = Plan::read(&out.join("plan.json")).unwrap();
        part(&plan, 0, &input).unwrap();
        all.push(("part", fs::read(plan.part_path(0).unwrap()).unwrap()));
    }
}

/// A body with a face of four corners in the plain forms that a second reading knows.
fn plain_meshes(all: &mut Seeds) {
    let points = ["0 0 0", "12.5 0 -1e-1", "12.5 7 0.25", "0 7 .5", "3 2 9.75"];
    let faces =
        ["0 3 2 1", "0 1 4", "1 2 4", "2 3 4", "3 0 4"].map(|face| face.split(' ').collect::<Vec<_>>());
    let counted = |face: &Vec<&str>| format!("{} {}\n", face.len(), face.join(" "));
    let faces_counted: String = faces.iter().map(counted).collect();
    let points_alone: String = points.iter().map(|point| format!("{point}\n")).collect();
    all.push(("off", format!("OFF\n5 5 0\n{points_alone}{faces_counted}").into_bytes()));
    let head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                element face 5\nproperty list uchar int vertex_indices\nend_header\n";
    all.push(("ply", format!("{head}{points_alone}{faces_counted}").into_bytes()));
    let number = |at: &str| at.parse::<usize>().unwrap();
    let mut obj: String = points.iter().map(|point| format!("v {point}\n")).collect();
    let mut stl = "solid\n".to_owned();
    for face in &faces {
        let corners: Vec<String> = face.iter().map(|at| (number(at) + 1).to_string()).collect();
        obj += &format!("f {}\n", corners.join(" "));
        for pair in face[1..].windows(2) {
            stl += "facet normal 0 0 0\nouter loop\n";
            stl.extend([face[0], pair[0], pair[1]].map(|at| format!("vertex {}\n", points[number(at)])));
            stl += "endloop\nendfacet\n";
        }
    }
    all.push(("obj", obj.into_bytes()));
    all.push(("stl", (stl + "endsolid\n").into_bytes()));
}

/// Labels and tables of their names, looks of a body, and an image.
fn tables(all: &mut Seeds) {
    let blocks: Vec<u8> = (0..144).map(|n| n / 7 % 4).collect();
    for wide in [0, 8] {
        all.push(("labels", [&[5, 4, 5, wide], &blocks[..]].concat()));
    }
    for table in [
        "index\tname\tabbreviation\tcolor\n0\tbackground\tB\t\n7\trib\tR\t#0000fe\n",
        "LabelValue,Name,Color_R,Color_G,Color_B,Color_A\n1,left lung,255,0,0,255\n",
        "# ITK-SNAP\n 1 255 0 0 1 1 1 \"left lung\"\n 7 0 0 254 0.5 1 0 \"rib\"\n",
        "# Color table\n1 left_lung 255 0 0 255\n",
        r#"{"segmentAttributes":[[{"labelID":1,"SegmentLabel":"a","recommendedDisplayRGBValue":[255,0,0]}]]}"#,
    ] {
        all.push(("names", table.as_bytes().to_vec()));
    }
    let library = "newmtl other\nKd 1 0 0\nnewmtl m\nKd 1 0.5 0\nd 0.5\nmap_Kd -s 1 1 1 -o 0 0 case.img\n";
    for library in [library, "newmtl m\nKd 1 0.5 0\nd 0.5\n"] {
        all.push(("mtl", library.as_bytes().to_vec()));
    }
    let folder = tempfile::tempdir().unwrap();
    let object = Object::new([9, 7, 1], ScalarType::U8, [1.0; 3]);
    let picture = pngs(&object, folder.path()).swap_remove(0);
    all.push(("texture", fs::read(picture).unwrap()));
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
        let options = BuildOptions {
            threshold: Threshold::Iso(0.0),
            surface: Some(surface),
            ..BuildOptions::default()
        };
        infobyte::build(&ball, &options, &path).unwrap();
        mapped.push(fs::read(&path).unwrap());
    }
    let plain = BuildOptions {
        threshold: Threshold::Iso(0.0),
        channels: Some(Channels::NONE),
        lod: false,
        ..skin_options()
    };
    infobyte::build(&ball, &plain, &path).unwrap();
    mapped.push(fs::read(&path).unwrap());
    let cells = |error| BuildOptions {
        threshold: Threshold::Iso(0.0),
        surface: Some(SurfaceKind::Cells),
        error,
        ..BuildOptions::default()
    };
    infobyte::build(&ball, &cells(Some(Tolerance::Voxels(0.2))), &path).unwrap();
    mapped.push(fs::read(&path).unwrap());
    let organs =
        Voxels::from_fn(Dims::new(9, 8, 7).unwrap(), |p| u16::try_from(p[0] / 3 + p[1] / 4).unwrap());
    let options = BuildOptions { labels: Some(LabelChoice::All), ..BuildOptions::default() };
    infobyte::build(&organs, &options, &path).unwrap();
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
