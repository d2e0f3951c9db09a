//! Volumes of other programs: one volume by every route gives one model; kinds that are not read are named with the
//! way out; pipes, sockets and devices are refused at once. If this fails, a file is read wrongly, or a program waits
//! for ever.

use crate::prelude::*;

/// Everything of a model but its metadata, which names the format.
pub(super) fn sections(path: &Path) -> Vec<Vec<u8>> {
    let bytes = fs::read(path).unwrap();
    let model = Model::from_bytes(bytes.clone()).unwrap();
    let own = |e: &&infobyte::format::SectionEntry| e.kind != Some(SectionKind::Meta);
    let part =
        |at: u64, end: u64| bytes[usize::try_from(at).unwrap()..usize::try_from(end).unwrap()].to_vec();
    model.sections().iter().filter(own).map(|e| part(e.offset, e.end())).collect()
}

#[test]
fn a_random_volume_gives_the_same_model_by_every_route() {
    for seed in 0..4 * u64::from(long()) {
        let folder = tempfile::tempdir().unwrap();
        let (at, mut random) = (folder.path(), Random(seed));
        let scalar = random.pick(&[ScalarType::U8, ScalarType::U16, ScalarType::I16, ScalarType::F32]);
        let dims: [u32; 3] = std::array::from_fn(|_| 8 + random.below(24_u32));
        let mut object = Object::new(dims, scalar, [1.0; 3]);
        let level = if scalar == ScalarType::U8 { 128.0 } else { 1000.0 };
        // Noise on the waves, in whole numbers.
        let samples: Vec<f64> = object
            .bytes
            .chunks(scalar.bytes())
            .map(|sample| (volume::decode(scalar, sample) + 30.0 * random.unit()).floor())
            .collect();
        object.bytes.clear();
        samples.iter().for_each(|v| volume::encode(scalar, *v, &mut object.bytes));
        let raw = file(at, "a.raw", &object.bytes);
        let spaced = ["--spacing", "1x1x1"];
        let [x, y, z] = dims;
        let layout = [format!("{x}x{y}x{z}"), scalar.to_string()];
        let stated = ["--dims", &layout[0], "--dtype", &layout[1], "--spacing", "1x1x1"];
        let slices = at.join("slices");
        fs::create_dir(&slices).unwrap();
        for (number, slice) in object.bytes.chunks(object.slice_bytes()).enumerate() {
            file(&slices, &format!("s{number}.raw"), slice);
        }
        let packed = Tiff { compression: 8, ..Tiff::default() };
        let mut routes: Vec<(PathBuf, &[&str])> = vec![
            (raw.clone(), &stated),
            (slices, &stated),
            (file(at, "a.npy", &npy(&object, 1, false, false)), &spaced),
            (file(at, "f.npy", &npy(&object, 2, true, true)), &spaced),
            (file(at, "r.nrrd", &nrrd(&object, "raw", false, "")), &[]),
            (file(at, "b.nrrd", &nrrd(&object, "raw", true, "")), &[]),
            (file(at, "g.nrrd", &nrrd(&object, "gzip", false, "")), &[]),
            (file(at, "t.nrrd", &nrrd(&object, "ascii", false, "")), &[]),
            (file(at, "a.nii", &[nifti(&object, 1, false, true, 1), object.bytes.clone()].concat()), &[]),
            (
                file(
                    at,
                    "z.nii.gz",
                    &gzip(&[nifti(&object, 2, true, true, 1), object.big_endian()].concat()),
                ),
                &[],
            ),
            (file(at, "a.mhd", &metaimage(&object, false, false, "a.raw")), &[]),
            (
                file(at, "c.mha", &[metaimage(&object, false, true, "LOCAL"), zlib(&object.bytes)].concat()),
                &[],
            ),
            (file(at, "a.tif", &Tiff::default().write(&object)), &spaced),
            (file(at, "d.tif", &packed.write(&object)), &spaced),
            (file(at, "a.mrc", &mrc(&object, false)), &[]),
            (file(at, "b.map", &mrc(&object, true)), &[]),
            (file(at, "a.vtk", &vtk(&object)), &[]),
            (file(at, "a.am", &amira(&object, false)), &[]),
            (file(at, "b.am", &amira(&object, true)), &[]),
            (file(at, "a.vgi", &vgi(&object, "a.vol")), &[]),
            (file(at, "a.vol", &object.bytes), &[]),
        ];
        if matches!(scalar, ScalarType::U8 | ScalarType::U16) {
            pngs(&object, &at.join("pngs"));
            routes.push((at.join("pngs"), &spaced));
        }
        let model = at.join("m.oct");
        let iso = level.to_string();
        let mut wanted = None;
        for (input, extra) in routes {
            let run = command::build(&[&input], &model, &[&["--iso", &iso], extra].concat());
            assert_eq!(run.code, 0, "seed {seed}: {run:?}");
            let got = sections(&model);
            assert!(*wanted.get_or_insert_with(|| got.clone()) == got, "seed {seed}: {}", input.display());
        }
    }
}

/// Where the skin lies, and its normals.
fn skin_of(model: &Path) -> std::collections::BTreeMap<[u32; 3], [f64; 3]> {
    let model = Model::open(model).unwrap();
    model.voxels().map(|found| (found.voxel, found.normal.unwrap())).collect()
}

/// A volume whose axes run in another order, and some of them backwards, is the same model, turned and mirrored.
#[test]
fn mirrored_and_turned_volumes_give_mirrored_and_turned_models() {
    for seed in 0..3 * u64::from(long()) {
        let folder = tempfile::tempdir().unwrap();
        let (at, mut random) = (folder.path(), Random(seed));
        let any: [u32; 3] = std::array::from_fn(|_| 30 + random.below(20_u32));
        let model = at.join("m.oct");
        // The automatic estimator decides for 32 x 32 voxels of a slice, which are the same ones in multiples of them.
        for (surface, gradient, dims) in
            [("skin", None, any), ("cells", None, any), ("skin", Some("auto"), [64, 32, 32])]
        {
            let mut object = Object::new(dims, ScalarType::I16, [1.0; 3]);
            if gradient.is_some() {
                for (high, noise) in
                    object.bytes.iter_mut().skip(1).step_by(2).map(|b| (b, random.below(3_u32)))
                {
                    *high = high.wrapping_add(u8::try_from(noise).unwrap()).min(7);
                }
            }
            let samples: Vec<i16> =
                object.bytes.as_chunks::<2>().0.iter().map(|b| i16::from_le_bytes(*b)).collect();
            let build = |name: &str, [x, y, z]: [u32; 3], bytes: &[u8]| {
                let size = format!("{x}x{y}x{z}");
                let how = ["--dims", &size, "--dtype", "i16", "--spacing", "1x1x1", "--iso", "1000.5"];
                let run = command::build(
                    &[&file(at, name, bytes)],
                    &model,
                    &[
                        &how[..],
                        &["--surface", surface],
                        &gradient.map_or(vec![], |name| vec!["--gradient", name]),
                    ]
                    .concat(),
                );
                assert_eq!(run.code, 0, "{run:?}");
                skin_of(&model)
            };
            let plain = build("a.raw", dims, &object.bytes);
            assert!(plain.len() > 1000);
            // Cells lie between samples: one more along every axis, from half a voxel before the first.
            let sides = dims.map(|side| side - u32::from(surface == "skin"));
            for (order, backwards) in [
                ([0, 1, 2], [true, false, false]),
                ([0, 1, 2], [false, true, true]),
                ([2, 0, 1], [false; 3]),
                ([1, 0, 2], [false, false, true]),
            ] {
                if gradient.is_some() && order[2] != 2 {
                    continue;
                }
                let turned = order.map(|axis: usize| dims[axis]);
                let [nx, ny, nz] = turned.map(|side| side as usize);
                let mut bytes = vec![0; object.bytes.len()];
                let there = |p: [u32; 3], sides: [u32; 3]| -> [u32; 3] {
                    std::array::from_fn(|k| {
                        let at = p[order[k]];
                        if backwards[k] { sides[order[k]] - at } else { at }
                    })
                };
                for (number, sample) in (0_u32..).zip(&samples) {
                    let p = [number % dims[0], number / dims[0] % dims[1], number / dims[0] / dims[1]];
                    let [x, y, z] = there(p, dims.map(|side| side - 1)).map(|c| c as usize);
                    assert!(x < nx && y < ny && z < nz);
                    let slot = 2 * (x + nx * (y + ny * z));
                    bytes[slot..slot + 2].copy_from_slice(&sample.to_le_bytes());
                }
                let found = build("b.raw", turned, &bytes);
                let name = format!("seed {seed}: {surface} {gradient:?} {order:?} {backwards:?}");
                assert_eq!(found.len(), plain.len(), "{name}");
                let mut furthest = 1.0_f64;
                for (p, normal) in &plain {
                    let own = found.get(&there(*p, sides)).unwrap_or_else(|| panic!("{name}: {p:?}"));
                    let wanted: [f64; 3] =
                        std::array::from_fn(
                            |k| if backwards[k] { -normal[order[k]] } else { normal[order[k]] },
                        );
                    furthest = furthest.min((0..3).map(|k| own[k] * wanted[k]).sum());
                }
                // Within what 16 bits of a normal are off by; planes of cells that are met near a corner differ by more.
                let least = if surface == "skin" { 0.9995 } else { 0.99 };
                assert!(furthest > least, "{name}: {furthest}");
            }
        }
    }
}

#[test]
fn kinds_that_are_not_read_are_named_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::create_dir_all(at.join("a.zarr/0/0")).unwrap();
    file(at, "a.zarr/.zgroup", b"{}");
    file(at, "a.zarr/0/0/0", &[1; 100]);
    for (name, bytes, words) in [
        ("a.h5", &b"\x89HDF\r\n\x1a\n\0\0\0\0"[..], ["an HDF5 file", "as .npy or NRRD first"]),
        ("a.nc", b"CDF\x01\0\0\0\0", ["a NetCDF file", "as .npy or NRRD first"]),
        (
            "a.vti",
            b"<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\">",
            ["in XML (.vti)", "as MetaImage or NRRD first"],
        ),
        ("b.vti", b"<VTKFile type=\"ImageData\">", ["in XML (.vti)", "as MetaImage or NRRD first"]),
        ("a.zarr", b"", ["a Zarr group", "no array"]),
    ] {
        let path = if name == "a.zarr" { at.join(name) } else { file(at, name, bytes) };
        command::build(&[&path], &at.join("m.oct"), &["--iso", "1"]).refused(3, &words);
    }
}

/// A text with a part of it replaced, which it has.
fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|part| part == from).unwrap();
    [&bytes[..at], to, &bytes[at + from.len()..]].concat()
}

#[test]
fn headers_before_raw_samples_are_placed_or_refused_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new([12, 10, 8], ScalarType::I16, [0.5, 0.25, 2.0]);
    let float = Object::new([12, 10, 8], ScalarType::F32, [1.0; 3]);
    let model = at.join("m.oct");
    let build = |name: &str, bytes: &[u8]| {
        file(at, "a.vol", &object.bytes);
        command::build(&[&file(at, name, bytes)], &model, &["--iso", "1000"])
    };
    let text = |bytes: &[u8], from: &str, to: &str| replaced(bytes, from.as_bytes(), to.as_bytes());
    let [am, vtk, vgi] = [amira(&object, false), vtk(&object), vgi(&object, "a.vol")];
    let word = |bytes: &[u8], words: &[(usize, u32)]| {
        let mut bytes = bytes.to_vec();
        for (at, value) in words {
            bytes[4 * at - 4..4 * at].copy_from_slice(&value.to_le_bytes());
        }
        bytes
    };
    let map = mrc(&object, false);
    // Columns, rows and sections along z, x and y of the cell, from another first section.
    let turned = word(&map, &[(17, 3), (18, 1), (19, 2), (7, 5)]);
    let placed = word(&map, &[(50, 1e7_f32.to_bits()), (52, (-2e7_f32).to_bits())]);
    let slanted = word(&map, &[(16, 60_f32.to_bits())]);
    let unsigned = [("datatype = signed", "datatype = unsigned"), ("unit = mm", "unit = um")];
    let unsigned = unsigned.iter().fold(vgi.clone(), |all, (from, to)| text(&all, from, to));
    let diagonal = |x: f64, y: f64, z: f64| [[x, 0.0, 0.0, 0.0], [0.0, y, 0.0, 0.0], [0.0, 0.0, z, 0.0]];
    let plain = diagonal(0.5, 0.25, 2.0);
    let mut moved = plain;
    (moved[0][3], moved[2][3]) = (1.0, -2.0);
    let cell = [12.0 * 0.5, 10.0 * 0.25, 8.0 * 2.0];
    // The intervals stay those of x, y and z.
    let [x, y, z] = [cell[0] / 12.0, cell[1] / 10.0, cell[2] / 8.0];
    let axes = [[0.0, x, 0.0, 0.0], [0.0, 0.0, y, 5.0 * y], [z, 0.0, 0.0, 0.0]];
    let half = 60_f64.to_radians();
    let mut leaning = plain;
    (leaning[0][1], leaning[1][1]) = (0.25 * half.cos(), 0.25 * half.sin());
    let mut shifted = plain;
    (shifted[0][3], shifted[1][3]) = (-3.0, 7.5);
    for (name, bytes, wanted) in [
        ("a.mrc", map.clone(), plain),
        ("b.mrc", turned, axes),
        ("c.mrc", placed, moved),
        ("d.ccp4", slanted, leaning),
        ("a.vtk", text(&vtk, "ORIGIN 0 0 0", "ORIGIN -3 7.5 0"), shifted),
        ("b.vtk", text(&vtk, "SPACING", "ASPECT_RATIO"), plain),
        ("a.am", text(&am, "\"mm\"", "\"cm\""), diagonal(5.0, 2.5, 20.0)),
        ("b.am", text(&am, "AmiraMesh", "Avizo"), plain),
        ("a.vgi", unsigned, diagonal(5e-4, 2.5e-4, 2e-3)),
    ] {
        let run = build(name, &bytes);
        assert_eq!(run.code, 0, "{name}: {run:?}");
        assert!(run.stdout.contains("its axes are taken as LPS"), "{name}: {run:?}");
        let info = oct(&["info", &model.display().to_string(), "--json"]).json();
        for (row, numbers) in wanted.iter().enumerate() {
            for (column, wanted) in numbers.iter().enumerate() {
                let got = info["affine"][row][column].as_f64().unwrap();
                assert!((got - wanted).abs() < 1e-6, "{name}: {row} {column} {got} for {wanted}");
            }
        }
    }
    let stack = word(&map, &[(10, 1), (23, 0)]);
    for (name, bytes, words) in [
        ("a.vtk", text(&vtk, "BINARY", "ASCII"), ["holds text (ASCII)", "write it as BINARY"]),
        (
            "a.vtk",
            text(&vtk, "STRUCTURED_POINTS", "POLYDATA"),
            ["a DATASET POLYDATA", "as structured points"],
        ),
        ("a.vtk", text(&vtk, "values short 1", "values short 3"), ["several values a voxel", "one of them"]),
        ("a.vtk", text(&vtk, "values short", "values bit"), ["of the type `bit`", "whole numbers or floats"]),
        ("a.vtk", text(&vtk, "POINT_DATA", "CELL_DATA"), ["values of cells", "as structured points"]),
        ("a.vtk", text(&vtk, "ORIGIN", "ORIGINS"), ["does not state ORIGIN", "damaged"]),
        ("a.am", text(&am, "@1\n\n", "@1(HxByteRLE,123)\n\n"), ["packed by HxByteRLE", "as raw binary"]),
        ("a.am", text(&am, "@1\n\n", "@1(HxZip,99)\n\n"), ["packed by HxZip", "as raw binary"]),
        ("a.am", text(&am, "BINARY-LITTLE-ENDIAN", "3D ASCII"), ["holds text (ASCII)", "as raw binary"]),
        ("a.am", text(&am, "\"uniform\"", "\"curvilinear\""), ["CoordType curvilinear", "resample"]),
        ("a.am", text(&am, "{ short Data", "{ short[3] Data"), ["type `short[3]`", "one value a voxel"]),
        ("a.am", text(&am, "define Lattice", "define VERTEX"), ["does not state", "a lattice"]),
        ("a.am", am[..am.len() - 9].to_vec(), ["promises 1920 bytes", "the file has 1911"]),
        ("a.mrc", word(&mrc(&float, false), &[(4, 4)]), ["complex numbers", "as MODE 2"]),
        ("a.mrc", word(&map, &[(4, 101)]), ["samples of MODE 101", "as MODE 0"]),
        ("a.mrc", word(&map, &[(17, 2)]), ["does not state MAPC", "damaged"]),
        ("a.mrc", word(&map, &[(17, 1 << 31)]), ["does not state MAPC", "damaged"]),
        ("a.mrc", stack, ["a stack of 8 pictures", "reconstruct a volume"]),
        ("a.vgi", text(&vgi, "= raw", "= tiff"), ["the format `tiff`", "export it as raw"]),
        ("a.vgi", text(&vgi, "Name = a.vol", "Name = /etc/passwd"), ["not in the folder", "/etc/passwd"]),
        ("a.vgi", text(&vgi, "size =", "sizes ="), ["does not state size", "damaged"]),
    ] {
        build(name, &bytes).refused(3, &words);
    }
    let bare = file(at, "bare.vol", &object.bytes);
    let words = ["headerless voxels, judging by its name (.vol)", ".vgi", "--dims NXxNYxNZ and --dtype"];
    command::build(&[&bare], &model, &["--iso", "1"]).refused(2, &words);
}

#[test]
fn what_headers_say_twice_or_of_axes_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new([12, 10, 8], ScalarType::I16, [1.0; 3]);
    let model = at.join("m.oct");
    let build =
        |name: &str, bytes: &[u8]| command::build(&[&file(at, name, bytes)], &model, &["--iso", "1000"]);
    let text = |bytes: &[u8], from: &str, to: &str| replaced(bytes, from.as_bytes(), to.as_bytes());
    let whole = nrrd(&object, "raw", false, "");
    let twice = text(&whole, "kinds:", "sizes: 10 12 8\nkinds:");
    build("a.nrrd", &twice).refused(3, &["states `sizes` twice"]);
    for (from, to, words) in [
        ("kinds:", "centers: cell cell cell\ncenters: node node node\nkinds:", "states `centers` twice"),
        ("kinds:", "data file: LIST x\na.raw\nkinds:", "`x` for data file"),
        ("kinds:", "data file: a.raw\ndatafile: b.raw\nkinds:", "states `data file` twice"),
        ("kinds:", "Segment0_Layer:=0\nSegment0_Layer:=1\nkinds:", "states `segment0_layer` twice"),
    ] {
        build("b.nrrd", &text(&whole, from, to)).refused(3, &[words]);
    }
    let listed = metaimage(&object, false, false, "LIST x");
    build("d.mhd", &listed).refused(3, &["`x` for ElementDataFile"]);
    let plain = [metaimage(&object, false, false, "LOCAL"), object.bytes.clone()].concat();
    let twice = text(&plain, "DimSize", "DimSize = 10 12 8\nDimSize");
    build("a.mha", &twice).refused(3, &["states `dimsize` twice"]);
    // Volumes that were reconstructed of pictures still name their last axis a list; sequences have fields of frames.
    let listed = text(&plain, "DimSize", "Kinds = domain domain list\nDimSize");
    assert_eq!(build("b.mha", &listed).code, 0);
    let frames = text(&listed, "DimSize", "Seq_Frame0000_Timestamp = 1\nDimSize");
    build("c.mha", &frames).refused(3, &["free-hand sweep"]);
}

#[test]
fn infinite_samples_inside_are_said_in_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut object = Object::new([20, 12, 10], ScalarType::F32, [1.0; 3]);
    for (number, sample) in [(777, f32::INFINITY), (900, f32::NEG_INFINITY)] {
        object.bytes[4 * number..4 * number + 4].copy_from_slice(&sample.to_le_bytes());
    }
    let input = file(at, "a.npy", &npy(&object, 1, false, false));
    let words = "some samples are infinite; these voxels are inside";
    for (extra, is_said) in [(["--iso", "1000"], true), (["--range", "900..5000"], false)] {
        for surface in ["skin", "cells"] {
            let args = [&extra[..], &["--spacing", "1x1x1", "--surface", surface]].concat();
            let run = command::build(&[&input], &at.join("m.oct"), &args);
            assert_eq!((run.code, run.stdout.contains(words)), (0, is_said), "{run:?}");
        }
    }
}

/// A pipe waits for a writer that never comes; the run is ended after ten seconds. Windows has no pipes and sockets in folders.
#[cfg(unix)]
#[test]
fn pipes_sockets_and_devices_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let _socket = std::os::unix::net::UnixListener::bind(at.join("socket")).unwrap();
    let quick = |script: &str| {
        let run = shell(&format!("cd \"$1\" && timeout 10 {script}"), &[at]);
        assert!(![124, -1].contains(&run.code), "{script}: {run:?}");
        run
    };
    let body = Body::cuboid([2.0; 3], [14.0; 3]);
    let colored = [b"mtllib p.mtl\n".to_vec(), body.obj()].concat();
    file(at, "a.obj", &colored);
    file(at, "b.obj", &[b"mtllib t.mtl\nusemtl a\n".to_vec(), body.obj()].concat());
    file(at, "t.mtl", b"newmtl a\nKd 1 0 0\nmap_Kd p.png\n");
    let mut described = containers::description(&body);
    described["buffers"][0]["uri"] = json!("p.bin");
    file(at, "a.gltf", described.to_string().as_bytes());
    let object = Object::new([8, 8, 8], ScalarType::U8, [1.0; 3]);
    file(at, "a.nhdr", &nrrd(&object, "raw", false, "data file: p.raw\n"));
    file(at, "a.mhd", &metaimage(&object, false, false, "p.raw"));
    file(at, "c.mhd", &metaimage(&object, false, true, "p.raw"));
    file(at, "a.csg", b"import(file = \"p.stl\");\n");
    for name in [
        "p", "p.mtl", "p.png", "p.bin", "p.raw", "p.stl", "p.ply", "p.csg", "p.nrrd", "p.oct", "p.toml",
        "p.json",
    ] {
        assert!(Command::new("mkfifo").arg(at.join(name)).status().unwrap().success());
    }
    for input in ["p", "p.stl", "p.ply", "p.csg", "p.nrrd", "p.oct", "socket", "/dev/zero"] {
        quick(&format!("$OCT build {input} -o m.oct")).refused(3, &["neither a file nor a folder"]);
        quick(&format!("$OCT scan {input}"));
        quick(&format!("$OCT batch {input} --out out"));
    }
    quick("$OCT build p -o m.oct --dims 8x8x8 --dtype u8").refused(3, &[]);
    for input in ["p.oct", "p", "socket", "/dev/zero"] {
        for command in ["info", "verify"] {
            quick(&format!("$OCT {command} {input}")).refused(3, &["it is not a regular file"]);
        }
    }
    // Files that others name: without their colours, which cells have not in any case, or refused.
    for input in ["a.obj", "b.obj"] {
        let run = quick(&format!("$OCT build {input} -o m.oct --grid 8 --surface skin"));
        assert_eq!((run.code, run.stdout.contains("which is not there")), (0, true), "{run:?}");
    }
    for (input, extra) in
        [("a.gltf", "--grid 8"), ("a.csg", "--grid 8"), ("a.nhdr", ""), ("a.mhd", ""), ("c.mhd", "")]
    {
        quick(&format!("$OCT build {input} -o m.oct {extra}")).refused(3, &[]);
    }
    quick("$OCT build a.gltf -o m.oct --grid 8")
        .refused(3, &["names p.bin, which is a folder, a pipe, a socket or a device"]);
    assert_eq!(quick("$OCT scan .").code, 0);
    quick("$OCT batch . --out out --grid 8");
    // A pipe for the output is refused by what it is.
    let run = quick("$OCT build a.obj -o /dev/stdout --grid 8 | cat");
    assert!(run.stderr.contains("not a regular file); name a file"), "{run:?}");
}
