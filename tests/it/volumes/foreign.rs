//! Volumes of other programs: one volume by every route gives one model; kinds that are not read are named with the
//! way out; pipes, sockets and devices are refused at once. If this fails, a file is read wrongly, or a program waits
//! for ever.

use crate::prelude::*;

/// Everything of a model but its metadata, which names the format.
fn sections(path: &Path) -> Vec<Vec<u8>> {
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

#[test]
fn kinds_that_are_not_read_are_named_with_the_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let mut map = vec![0; 1100];
    map[208..212].copy_from_slice(b"MAP ");
    fs::create_dir_all(at.join("a.zarr/0/0")).unwrap();
    file(at, "a.zarr/.zgroup", b"{}");
    file(at, "a.zarr/0/0/0", &[1; 100]);
    for (name, bytes, words) in [
        ("a.h5", &b"\x89HDF\r\n\x1a\n\0\0\0\0"[..], ["an HDF5 file", "as .npy or NRRD first"]),
        ("a.nc", b"CDF\x01\0\0\0\0", ["a NetCDF file", "as .npy or NRRD first"]),
        ("a.vtk", b"# vtk DataFile Version 3.0\n", ["a VTK file", "as MetaImage or NRRD first"]),
        (
            "a.vti",
            b"<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\">",
            ["in XML (.vti)", "as MetaImage or NRRD first"],
        ),
        ("b.vti", b"<VTKFile type=\"ImageData\">", ["in XML (.vti)", "as MetaImage or NRRD first"]),
        (
            "a.vgi",
            b"{volume1}\n[representation]\n",
            ["a VGStudio header", "whose .vol holds headerless voxels"],
        ),
        (
            "a.am",
            b"# AmiraMesh BINARY-LITTLE-ENDIAN 2.1\n",
            ["an Amira or Avizo file", "as NRRD or MetaImage first"],
        ),
        (
            "b.am",
            b"# Avizo BINARY-LITTLE-ENDIAN 2.1\n",
            ["an Amira or Avizo file", "as NRRD or MetaImage first"],
        ),
        ("a.mrc", &map, ["an MRC or CCP4 map", "as TIFF or NRRD first"]),
        ("a.zarr", b"", ["a Zarr folder", "as TIFF or NRRD first"]),
    ] {
        let path = if name == "a.zarr" { at.join(name) } else { file(at, name, bytes) };
        command::build(&[&path], &at.join("m.oct"), &["--iso", "1"]).refused(3, &words);
    }
}

#[test]
fn what_headers_say_twice_or_of_axes_alone() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new([12, 10, 8], ScalarType::I16, [1.0; 3]);
    let model = at.join("m.oct");
    let build =
        |name: &str, bytes: &[u8]| command::build(&[&file(at, name, bytes)], &model, &["--iso", "1000"]);
    let text = |bytes: &[u8], from: &str, to: &str| {
        let at = bytes.windows(from.len()).position(|part| part == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let whole = nrrd(&object, "raw", false, "");
    let twice = text(&whole, "kinds:", "sizes: 10 12 8\nkinds:");
    build("a.nrrd", &twice).refused(3, &["states `sizes` twice"]);
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

/// A pipe waits for a writer that never comes; the run is ended after ten seconds.
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
        for command in ["render", "thumbnail", "export", "pack", "strip", "unpack"] {
            assert_ne!(quick(&format!("$OCT {command} {input} -o out.png")).code, 0);
        }
    }
    assert_ne!(quick("$OCT render p.toml -o out.png").code, 0);
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
