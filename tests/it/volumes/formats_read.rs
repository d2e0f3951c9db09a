//! A volume is the same in whatever format it comes: every sample, the place of its corners, and so the model
//! made of it. If this fails, what a lab sees depends on the program that wrote its files.

use crate::prelude::*;
use infobyte::discovery::open_unprepared as open;

/// Opens and unrolls within 3 MiB.
fn ready(inputs: &[PathBuf], scratch: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut source = open(inputs, &OpenOptions::default())?;
    let workspace = Workspace { scratch, memory: Budget::new(3 << 20), progress: &Silent };
    source.prepare(&workspace)?;
    Ok(source)
}

/// Holds random blocks of a source, tight and pitched, to the object; and its axes, if they are known.
fn same(inputs: &[PathBuf], object: &Object, axes: bool, what: &str) {
    let folder = tempfile::tempdir().unwrap();
    let source = ready(inputs, folder.path()).unwrap_or_else(|e| panic!("{what}: {e}"));
    let info = source.info();
    assert_eq!((info.dims.to_array(), info.scalar), (object.dims, object.scalar), "{what}");
    if axes {
        for axis in 0..3 {
            let mut step = [0.0; 3];
            step[axis] = object.step[axis];
            for (got, want) in info.affine.column(axis).into_iter().zip(step) {
                assert!((got - want).abs() < 1e-9, "{what}: {:?}", info.affine);
            }
        }
        assert_eq!(info.affine.origin(), [0.0; 3], "{what}");
    }
    let [nx, ny, nz] = object.dims;
    let width = object.scalar.bytes();
    let mut random = Random(7);
    for round in 0..60 {
        let z = random.below(nz);
        let y = random.below(ny);
        let rows = y..y + 1 + random.below(ny - y);
        let x = if round % 2 == 0 { 0 } else { random.below(nx) };
        let cols = if round % 2 == 0 { 0..nx } else { x..x + 1 + random.below(nx - x) };
        let piece = cols.len() * width;
        let mut expected = Vec::new();
        for row in rows.clone() {
            let at = ((z * ny + row) * nx + cols.start) as usize * width;
            let mut bytes = object.bytes[at..at + piece].to_vec();
            if cfg!(target_endian = "big") {
                bytes.chunks_exact_mut(width).for_each(<[u8]>::reverse);
            }
            expected.extend(bytes);
        }
        let mut out = vec![0xaa; expected.len()];
        source.read_rows(z, rows.clone(), cols.clone(), &mut out).unwrap();
        assert!(out == expected, "{what}: {rows:?} {cols:?} of slice {z}");
        let pitch = piece + 24;
        let mut wide = vec![0xaa; pitch * (rows.len() - 1) + piece];
        source.read_pitched(z, rows.clone(), cols, pitch, &mut wide).unwrap();
        for (row, want) in wide.chunks(pitch).zip(expected.chunks(piece)) {
            assert!(&row[..piece] == want, "{what}: pitched");
            assert!(row[piece..].iter().all(|b| *b == 0xaa), "{what}: between rows");
        }
    }
}

const DIMS: [u32; 3] = [23, 14, 11];
const STEP: [f64; 3] = [0.5, -0.75, 2.0];

#[test]
fn nrrd_in_every_encoding_type_and_order_is_the_volume() {
    let folder = tempfile::tempdir().unwrap();
    for scalar in ScalarType::ALL {
        let object = Object::new(DIMS, scalar, STEP);
        for encoding in ["raw", "gzip", "bzip2", "ascii", "hex"] {
            for big in [false, true] {
                let name = format!("{scalar}-{encoding}-{big}.nrrd");
                let path = file(folder.path(), &name, &nrrd(&object, encoding, big, ""));
                same(&[path], &object, true, &name);
            }
        }
    }
    // Detached: one file, a list out of order, a pattern; packed or not.
    let object = Object::new(DIMS, ScalarType::I16, STEP);
    let at = folder.path();
    file(at, "whole.raw", &[&[9; 31][..], &object.bytes].concat());
    file(at, "sub/whole.gz", &gzip(&object.bytes));
    let mut list = String::from("data file: LIST\n");
    for (z, slice) in object.bytes.chunks(object.slice_bytes()).enumerate() {
        file(at, &format!("s{}.raw", 50 - z), slice);
        file(at, &format!("p{:03}.gz", 2 * z + 1), &gzip(slice));
        list += &format!("s{}.raw\n", 50 - z);
    }
    for (name, encoding, data) in [
        ("one.nhdr", "raw", "data file: whole.raw\nbyte skip: 31\n"),
        ("end.nhdr", "raw", "byte skip: -1\ndatafile: ./whole.raw\n"),
        ("packed.nhdr", "gz", "data file: sub/whole.gz\n"),
        ("list.nhdr", "raw", list.as_str()),
        ("pattern.nhdr", "gzip", "data file: p%03d.gz 1 21 2 2\n"),
    ] {
        let path = file(at, name, &nrrd(&object, encoding, false, data));
        same(&[path], &object, true, name);
    }
    for (name, data, words) in [
        ("up.nhdr", "data file: ../whole.raw\n", "not in the folder"),
        ("device.nhdr", "data file: /dev/zero\n", "not in the folder"),
        ("few.nhdr", "data file: p%03d.gz 1 21 4\n", "cannot be shared out"),
        ("endless.nhdr", "data file: p%03d.gz 1 21 0\n", "have no end"),
        ("folder.nhdr", "data file: sub\n", "not a regular file"),
    ] {
        let path = file(at, name, &nrrd(&object, "gzip", false, data));
        let refused = ready(&[path], at).err().unwrap().to_string();
        assert!(refused.contains(words), "{name}: {refused}");
    }
}

#[test]
fn nifti_of_both_versions_packed_and_paired_is_the_volume() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for scalar in ScalarType::ALL {
        let object = Object::new(DIMS, scalar, STEP);
        for version in [1, 2] {
            for big in [false, true] {
                let name = format!("{scalar}-{version}-{big}");
                let whole = [nifti(&object, version, big, true, 1), object.ordered(big)].concat();
                same(&[file(at, &format!("{name}.nii"), &whole)], &object, true, &name);
                same(&[file(at, &format!("{name}.nii.gz"), &gzip(&whole))], &object, true, &name);
                let header = file(at, &format!("{name}.hdr"), &nifti(&object, version, big, false, 1));
                let image = file(at, &format!("{name}.img"), &object.ordered(big));
                same(&[header], &object, true, &name);
                same(&[image], &object, true, &name);
            }
        }
    }
    let object = Object::new(DIMS, ScalarType::I16, STEP);
    let header = file(at, "p.hdr", &nifti(&object, 1, false, false, 1));
    file(at, "p.img.gz", &gzip(&object.bytes));
    same(&[header], &object, true, "a packed .img");
    // Of several volumes the first is taken, and it is said.
    let four =
        [nifti(&object, 1, false, true, 2), object.bytes.clone(), vec![1; object.bytes.len()]].concat();
    let path = file(at, "four.nii.gz", &gzip(&four));
    same(std::slice::from_ref(&path), &object, true, "four dimensions");
    let warnings = sentences(&ready(&[path], at).unwrap().info().notes).join(" ");
    assert!(warnings.contains("volume 1 of 2"), "{warnings}");
}

#[test]
fn metaimage_local_detached_and_packed_is_the_volume() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for scalar in ScalarType::ALL {
        let object = Object::new(DIMS, scalar, STEP);
        for big in [false, true] {
            let name = format!("{scalar}-{big}");
            let samples = object.ordered(big);
            let local =
                |compressed, body: &[u8]| [&metaimage(&object, big, compressed, "LOCAL")[..], body].concat();
            same(&[file(at, &format!("{name}.mha"), &local(false, &samples))], &object, true, &name);
            same(&[file(at, &format!("{name}z.mha"), &local(true, &zlib(&samples)))], &object, true, &name);
            same(&[file(at, &format!("{name}g.mha"), &local(true, &gzip(&samples)))], &object, true, &name);
            file(at, &format!("{name}.raw"), &samples);
            let header = metaimage(&object, big, false, &format!("{name}.raw"));
            same(&[file(at, &format!("{name}.mhd"), &header)], &object, true, &name);
        }
    }
    let object = Object::new(DIMS, ScalarType::U16, STEP);
    let mut list = "LIST\n".to_owned();
    for (z, slice) in object.bytes.chunks(object.slice_bytes()).enumerate() {
        file(at, &format!("z{z:02}.raw"), slice);
        list += &format!("z{z:02}.raw\n");
    }
    for data in [list.as_str(), "z%02d.raw 0 10 1", "z%02d.raw 0 10"] {
        same(&[file(at, "l.mhd", &metaimage(&object, false, false, data))], &object, true, data);
    }
    let channels =
        [b"ElementNumberOfChannels = 3\n", &metaimage(&object, false, false, "LOCAL")[..]].concat();
    let swapped = [b"ObjectType = Image\n", &channels[..]].concat();
    let refused = ready(&[file(at, "c.mha", &swapped)], at).err().unwrap().to_string();
    assert!(refused.contains("3 channels"), "{refused}");
}

#[test]
fn npy_of_every_version_type_and_order_is_the_volume() {
    let folder = tempfile::tempdir().unwrap();
    for scalar in ScalarType::ALL {
        let object = Object::new(DIMS, scalar, [1.0; 3]);
        for (version, big, fortran) in
            [(1, false, false), (1, true, true), (2, true, false), (3, false, true)]
        {
            let name = format!("{scalar}-{version}-{big}-{fortran}.npy");
            let path = file(folder.path(), &name, &npy(&object, version, big, fortran));
            same(&[path], &object, true, &name);
        }
    }
}

#[test]
fn tiff_in_strips_and_tiles_packed_and_not_is_the_volume() {
    let folder = tempfile::tempdir().unwrap();
    for scalar in ScalarType::ALL {
        let object = Object::new(DIMS, scalar, [1.0; 3]);
        let float = matches!(scalar, ScalarType::F32 | ScalarType::F64);
        for compression in [1, 5, 8, 32773] {
            for predictor in [1, 2, 3] {
                if (compression == 1 && predictor > 1) || (predictor == 3 && !float) {
                    continue;
                }
                for (strip, tile) in [(u32::MAX, None), (5, None), (1, Some([16, 16])), (1, Some([64, 4]))] {
                    for (big_endian, big_tiff) in [(false, false), (true, false), (true, true)] {
                        let how = Tiff {
                            big_endian,
                            big_tiff,
                            compression,
                            predictor,
                            strip,
                            tile,
                            ..Tiff::default()
                        };
                        let path = file(folder.path(), "v.tif", &how.write(&object));
                        same(&[path], &object, true, &format!("{scalar} {how:?}"));
                    }
                }
            }
        }
    }
}

#[test]
fn stacks_of_tiff_and_png_files_are_in_natural_order() {
    let folder = tempfile::tempdir().unwrap();
    let object = Object::new(DIMS, ScalarType::U16, [1.0; 3]);
    for compression in [1, 8] {
        let stack = folder.path().join(format!("tiff{compression}"));
        let mut given = Vec::new();
        for (z, slice) in object.bytes.chunks(object.slice_bytes()).enumerate() {
            let one = Object { dims: [DIMS[0], DIMS[1], 1], bytes: slice.to_vec(), ..object.clone() };
            // Files differ in byte order.
            let how = Tiff { compression, big_endian: z % 2 == 1, ..Tiff::default() };
            given.push(file(&stack, &format!("slice{}.tif", z + 1), &how.write(&one)));
        }
        file(&stack, "notes.txt", b"not a slice");
        same(&[stack], &object, true, "a folder of TIFF files");
        same(&given, &object, true, "TIFF files");
    }
    for scalar in [ScalarType::U8, ScalarType::U16] {
        let object = Object::new(DIMS, scalar, [1.0; 3]);
        let stack = folder.path().join(format!("png-{scalar}"));
        let given = pngs(&object, &stack);
        same(&[stack], &object, true, "a folder of PNG files");
        same(&given, &object, true, "PNG files");
        let one = Object { dims: [DIMS[0], DIMS[1], 1], ..object };
        same(&given[..1], &one, true, "one PNG file");
    }
    let odd = folder.path().join("png-u8/s3.png");
    let smaller = Object::new([9, 9, 1], ScalarType::U8, [1.0; 3]);
    fs::copy(&pngs(&smaller, &folder.path().join("other"))[0], odd).unwrap();
    let refused = ready(&[folder.path().join("png-u8")], folder.path()).err().unwrap().to_string();
    assert!(refused.contains("s3.png") && refused.contains("9x9"), "{refused}");
}

#[test]
fn files_with_several_pages_are_volumes_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let object = Object::new(DIMS, ScalarType::U16, [1.0; 3]);
    let whole = Tiff::default().write(&object);
    let slices: Vec<Vec<u8>> = object
        .bytes
        .chunks(object.slice_bytes())
        .map(|slice| {
            let one = Object { dims: [DIMS[0], DIMS[1], 1], bytes: slice.to_vec(), ..object.clone() };
            Tiff::default().write(&one)
        })
        .collect();
    let found = |name: &str| {
        let inputs = [folder.path().join(name)];
        let catalogue = Catalogue::survey(&inputs, &OpenOptions::default(), folder.path()).unwrap();
        (0..catalogue.len()).flat_map(|i| catalogue.open(i)).collect::<Vec<Finding>>()
    };
    let names = |found: &[Finding]| {
        let name = |f: &Finding| {
            let end = f.path.file_name().unwrap().to_string_lossy().into_owned();
            (end, f.files.count, f.part.is_none(), f.subject.is_ok())
        };
        found.iter().map(name).collect::<Vec<_>>()
    };
    let is = |path: &str, files: u64, good: bool| (path.to_owned(), files, true, good);

    // One is cut short, one is damaged in its first directory, one is of colours.
    let several = folder.path().join("several");
    file(&several, "a.tif", &whole);
    file(&several, "b.tif", &whole[..whole.len() / 2]);
    file(&several, "c.tif", &whole);
    file(&several, "d.tif", b"II*\0\xff\xff\xff\x7f");
    file(&several, "e.tif", &Tiff { photometric: 2, ..Tiff::default() }.write(&object));
    let all = found("several");
    let expected = [("a", true), ("b", false), ("c", true), ("d", false), ("e", false)];
    let expected = expected.map(|(name, good)| is(&format!("{name}.tif"), 1, good));
    assert_eq!(names(&all), expected);
    for (finding, name) in all.iter().zip(["a", "b", "c", "d", "e"]) {
        if let Err(error) = &finding.subject {
            assert!(error.to_string().contains(&format!("{name}.tif")), "{error}");
        }
    }
    assert_ne!(all[0].files.fingerprint, all[2].files.fingerprint);
    // Names follow the content: two copies have one.
    assert!(all[0].id == all[2].id && all[0].id != all[1].id && all[0].id.starts_with("tiff-"), "{all:?}");
    same(&[several.join("c.tif")], &object, true, "one of several");

    // Alone in its folder it is not a lost slice.
    file(&folder.path().join("alone"), "only.tif", &whole);
    file(&folder.path().join("slice"), "only.tif", &slices[0]);
    assert_eq!(names(&found("alone")), [is("only.tif", 1, true)]);
    assert!(found("slice").is_empty());

    // Slices beside a volume make theirs; a damaged slice refuses these alone, by its name.
    let mixed = folder.path().join("mixed");
    for (z, slice) in slices.iter().enumerate() {
        file(&mixed, &format!("s{z:02}.tif"), slice);
    }
    file(&mixed, "volume.tif", &whole);
    let count = slices.len() as u64;
    assert_eq!(names(&found("mixed")), [is("mixed", count, true), is("volume.tif", 1, true)]);
    for damaged in [&slices[1][..slices[1].len() / 2], b"II*\0\xff\xff\xff\x7f"] {
        file(&mixed, "s01.tif", damaged);
        let all = found("mixed");
        assert_eq!(names(&all), [is("mixed", count, false), is("volume.tif", 1, true)]);
        let error = all[0].subject.as_ref().err().unwrap().to_string();
        assert!(error.contains("s01.tif"), "{error}");
    }
}

#[test]
fn image_j_tells_its_spacing_and_has_one_directory_for_a_long_stack() {
    let folder = tempfile::tempdir().unwrap();
    let object = Object::new(DIMS, ScalarType::U16, [0.5, 0.25, 2.0]);
    let stacked = "ImageJ=1.54f\nimages=11\nslices=11\nunit=mm\nspacing=2.0\n";
    let how = Tiff {
        description: stacked.into(),
        contiguous: true,
        big_endian: true,
        resolution: Some([2, 4]),
        ..Tiff::default()
    };
    let bytes = how.write(&object);
    same(&[file(folder.path(), "one.tif", &bytes)], &object, true, "one directory");
    let pages = Tiff { contiguous: false, ..how.clone() };
    same(&[file(folder.path(), "pages.tif", &pages.write(&object))], &object, true, "a directory each");
    let folder_of_two = folder.path().join("two");
    file(&folder_of_two, "a.tif", &pages.write(&object));
    file(&folder_of_two, "b.tif", &pages.write(&object));
    // Each is a volume of its own; one is taken, and the other is named.
    same(std::slice::from_ref(&folder_of_two), &object, true, "two stacks in a folder");
    let warnings = sentences(&ready(&[folder_of_two], folder.path()).unwrap().info().notes).join(" ");
    assert!(warnings.contains("2 sets of images"), "{warnings}");
    // Slices that state other voxels, or none.
    let flat = Object::new([DIMS[0], DIMS[1], 1], ScalarType::U16, [0.5, 0.25, 2.0]);
    for (second, words) in [
        ("ImageJ=1.54f\nunit=mm\nspacing=2.0\n", ""),
        (
            "ImageJ=1.54f\nunit=micron\nspacing=2.0\n",
            "s1.tif: states voxels of 0.0005x0.00025x0.002 mm, and s0.tif",
        ),
        ("ImageJ=1.54f\nunit=mm\nspacing=3.0\n", "0.5x0.25x3 mm, and s0.tif states 0.5x0.25x2 mm"),
        ("ImageJ=1.54f\n", "1 of 2 files state no size of voxels; it is taken from s0.tif"),
    ] {
        let slices = folder.path().join("slices");
        for (name, text) in [("s0.tif", "ImageJ=1.54f\nunit=mm\nspacing=2.0\n"), ("s1.tif", second)] {
            let slice = Tiff { description: text.into(), contiguous: false, ..how.clone() };
            file(&slices, name, &slice.write(&flat));
        }
        let told = match ready(&[slices], folder.path()) {
            Ok(ready) => sentences(&ready.info().notes).join(" "),
            Err(error) => error.to_string(),
        };
        assert!(told.contains(words) && words.is_empty() != told.contains("s0.tif"), "{told}");
    }
    let more = Tiff { description: stacked.replace("images=11", "images=900"), ..how.clone() };
    let refused = ready(&[file(folder.path(), "more.tif", &more.write(&object))], folder.path());
    assert!(refused.err().unwrap().to_string().contains("promises 900 images"));
    // Numbers over 0 are no resolution; 0 over 0 is how an unknown one is written.
    let over_0 = |resolution| Tiff { resolution: Some(resolution), divisor: 0, ..how.clone() }.write(&object);
    let refused = ready(&[file(folder.path(), "over.tif", &over_0([2, 4]))], folder.path());
    assert!(refused.err().unwrap().to_string().contains("a number over 0"));
    let unknown = ready(&[file(folder.path(), "unknown.tif", &over_0([0, 0]))], folder.path()).unwrap();
    assert!(sentences(&unknown.info().notes).join(" ").contains("states no spacing"));
    // Signed values, as ImageJ stores them.
    let signed = Tiff { description: format!("{stacked}cf=0\nc0=-32768.0\nc1=1.0\n"), ..how.clone() };
    let signed = file(folder.path(), "signed.tif", &signed.write(&object));
    let signed = ready(&[signed], folder.path()).unwrap();
    assert_eq!(signed.info().rescale, infobyte::Rescale { slope: 1.0, intercept: -32768.0 });
    let channels = Tiff { description: stacked.replace("slices=11", "channels=11"), ..how };
    let refused = ready(&[file(folder.path(), "channels.tif", &channels.write(&object))], folder.path());
    assert!(refused.err().unwrap().to_string().contains("hyperstack of 11 channels"));
    let white = Tiff { photometric: 0, ..Tiff::default() };
    let path = file(folder.path(), "white.tif", &white.write(&object));
    same(std::slice::from_ref(&path), &object, false, "0 is white");
    assert!(sentences(&ready(&[path], folder.path()).unwrap().info().notes).join(" ").contains("0 is white"));
    let colours = Tiff { photometric: 2, ..Tiff::default() };
    let path = file(folder.path(), "rgb.tif", &colours.write(&object));
    assert!(ready(&[path], folder.path()).err().unwrap().to_string().contains("RGB"));
}

#[test]
fn tiff_pictures_that_begin_at_another_corner_are_not_mirrored() {
    let folder = tempfile::tempdir().unwrap();
    let object = Object::new(DIMS, ScalarType::U16, [1.0; 3]);
    let write = |name: &str, orientation| {
        file(folder.path(), name, &Tiff { orientation, ..Tiff::default() }.write(&object))
    };
    let [nx, ny, _] = DIMS.map(f64::from);
    for (orientation, x, y) in [
        (1, [1.0, 0.0], [1.0, 0.0]),
        (2, [-1.0, nx - 1.0], [1.0, 0.0]),
        (3, [-1.0, nx - 1.0], [-1.0, ny - 1.0]),
        (4, [1.0, 0.0], [-1.0, ny - 1.0]),
        (9, [1.0, 0.0], [1.0, 0.0]),
    ] {
        let path = write(&format!("{orientation}.tif"), orientation);
        let volume = ready(std::slice::from_ref(&path), folder.path()).unwrap();
        let rows = volume.info().affine.rows;
        assert_eq!(rows[0], [x[0], 0.0, 0.0, x[1]], "{orientation}");
        assert_eq!(rows[1], [0.0, y[0], 0.0, y[1]], "{orientation}");
        let told = sentences(&volume.info().notes).join(" ").contains("(Orientation)");
        assert_eq!(told, (2..=4).contains(&orientation), "{orientation}");
    }
    let error = |paths: &[PathBuf]| ready(paths, folder.path()).err().unwrap().to_string();
    assert!(error(&[write("6.tif", 6)]).contains("turned by 90 degrees (Orientation 6)"));
    let mixed = folder.path().join("mixed");
    let one = |orientation| {
        let [x, y, _] = DIMS;
        let slice = Object::new([x, y, 1], ScalarType::U16, [1.0; 3]);
        Tiff { orientation, ..Tiff::default() }.write(&slice)
    };
    file(&mixed, "1.tif", &one(1));
    file(&mixed, "2.tif", &one(4));
    assert!(error(&[mixed]).contains("another corner"));
}

/// Smallest and largest sample, and their sum.
fn summary(source: &dyn VolumeSource) -> (f64, f64, f64) {
    let dims = source.info().dims;
    let scalar = source.info().scalar;
    let mut row = vec![0; dims.nx() as usize * scalar.bytes()];
    let (mut low, mut high, mut sum) = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
    for z in 0..dims.nz() {
        for y in 0..dims.ny() {
            source.read_rows(z, y..y + 1, 0..dims.nx(), &mut row).unwrap();
            for sample in row.chunks_exact(scalar.bytes()) {
                let mut little = sample.to_vec();
                if cfg!(target_endian = "big") {
                    little.reverse();
                }
                let value = volume::decode(scalar, &little);
                (low, high, sum) = (low.min(value), high.max(value), sum + value);
            }
        }
    }
    (low, high, sum)
}

/// Figures of nibabel and pynrrd, the affine turned to LPS.
#[test]
fn real_nifti_and_nrrd_files_agree_with_other_readers() {
    let scratch = tempfile::tempdir().unwrap();
    for (item, dims, scalar, range, rows) in [
        (
            "nifti-ct-i32/example_ct.nii.gz",
            [122, 101, 112],
            ScalarType::I32,
            (-1207.0, 3382.0, -496_851_173.0),
            [
                [-3.0, 0.0, 0.0, 177.956_329_346],
                [0.0, -3.0, 0.0, -11.319_000_244],
                [0.0, 0.0, 3.0, 94.301_757_812],
            ],
        ),
        (
            "nifti-ct-oblique/CT_pitch.nii.gz",
            [175, 248, 58],
            ScalarType::U8,
            (0.0, 255.0, 95_678_796.0),
            [
                [-0.8125, 0.0, 0.0, 69.020_759_583],
                [0.0, -0.779_041_052, -0.680_798_769, 134.385_604_858],
                [0.0, -0.230_762_482, 2.298_338_413, -13.568_820_953],
            ],
        ),
        (
            "nifti-iguana/Iguana.nii.gz",
            [210, 256, 179],
            ScalarType::U8,
            (0.0, 229.0, 317_230_873.0),
            [
                [-0.101_800_025, 0.0, 0.0, 10.315_587_044],
                [0.0, -0.101_800_025, 0.0, 11.506_097_794],
                [0.0, 0.0, 0.101_800_025, -15.180_282_593],
            ],
        ),
        (
            "nrrd-brain/brain1_image.nrrd",
            [256, 256, 25],
            ScalarType::I16,
            (0.0, 3057.0, 631_859_459.0),
            [
                [0.781_249_999_999_999_9, 0.0, 0.0, -99.609_374_999_999_99],
                [0.0, -0.781_249_999_999_999_9, 0.0, 99.609_374_999_999_99],
                [0.0, 0.0, 6.499_999_999_999_998, -77.999_999_999_999_96],
            ],
        ),
    ] {
        let Some(path) = real_data(item) else { continue };
        let source = ready(&[path], scratch.path()).unwrap_or_else(|e| panic!("{e}"));
        let info = source.info();
        assert_eq!((info.dims.to_array(), info.scalar), (dims, scalar), "{item}");
        for (got, want) in info.affine.rows.iter().flatten().zip(rows.as_flattened()) {
            assert!((got - want).abs() < 1e-6, "{item}: {:?}", info.affine);
        }
        assert_eq!(summary(source.as_ref()), range, "{item}");
    }
    let Some(path) = real_data("nrrd-bad-gzip/I.nrrd") else { return };
    let refused = ready(&[path], scratch.path()).err().unwrap().to_string();
    assert!(
        refused.contains("the header promises 14811136 bytes, the gzip stream ends after 6863088"),
        "{refused}"
    );
}
