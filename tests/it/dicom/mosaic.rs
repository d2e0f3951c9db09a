//! Siemens mosaics, many slices tiled into one picture, become volumes: every pixel lies where the scanner
//! put it, every picture is a volume of its own, and what does not fit together is refused in a sentence.
//! If one fails, a functional study is mirrored, shifted or mixed up without a word.

use crate::prelude::*;
use std::ops::Deref;

use infobyte::discovery::open_unprepared as open;

use crate::common::dicom::csa;

const TILE: [u16; 2] = [4, 3];
const FLAT: &str = "1\\0\\0\\0\\1\\0";
/// Rows along (0.8, 0.6, 0), columns down (-0.36, 0.48, 0.8): the normal is (0.48, -0.64, 0.6).
const OBLIQUE: &str = "0.8\\0.6\\0\\-0.36\\0.48\\0.8";
const UP: [&str; 3] = ["0.48000000", "-0.64000000", "0.60000000"];
const DOWN: [&str; 3] = ["-0.48000000", "0.64000000", "-0.60000000"];

/// Tells tile, row and column.
fn label(k: u16, j: u16, i: u16) -> u16 {
    1000 + 100 * k + 10 * j + i
}

fn oblique(slices: u16, normal: &[&str; 3]) -> Elements {
    mosaic(slices, TILE, OBLIQUE, normal, &label)
}

fn put(folder: &Path, files: &[Vec<u8>]) {
    for (n, bytes) in files.iter().enumerate() {
        fs::write(folder.join(format!("{n}.dcm")), bytes).unwrap();
    }
}

/// A volume and the folder of its file.
#[derive(Debug)]
struct Opened(Box<dyn VolumeSource>, #[expect(dead_code, reason = "kept until the volume is read")] TempDir);

impl Deref for Opened {
    type Target = dyn VolumeSource;

    fn deref(&self) -> &Self::Target {
        self.0.as_ref()
    }
}

/// The only volume of a file, ready to be read.
fn opened(file: &[u8]) -> Result<Opened, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    put(folder.path(), &[file.to_vec()]);
    let mut source = open(&[folder.path().to_path_buf()], &OpenOptions::default())?;
    source
        .prepare(&Workspace { scratch: folder.path(), memory: Budget::new(1 << 20), progress: &Silent })
        .unwrap();
    Ok(Opened(source, folder))
}

fn refused(image: &Elements) -> String {
    opened(&image.bytes()).unwrap_err().to_string()
}

fn findings(files: &[Elements]) -> (Vec<Finding>, TempDir) {
    let folder = tempfile::tempdir().unwrap();
    put(folder.path(), &files.iter().map(Elements::bytes).collect::<Vec<_>>());
    let inputs = [folder.path().to_path_buf()];
    let found = Catalogue::survey(&inputs, &OpenOptions::default(), folder.path()).unwrap();
    ((0..found.len()).flat_map(|i| found.open(i)).collect(), folder)
}

fn slice(source: &dyn VolumeSource, z: u32) -> Vec<u16> {
    let dims = source.info().dims;
    let mut out = vec![0; (dims.nx() * dims.ny() * 2) as usize];
    source.read_rows(z, 0..dims.ny(), 0..dims.nx(), &mut out).unwrap();
    out.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b)).collect()
}

/// The first sample of each slice.
fn firsts(source: &dyn VolumeSource) -> Vec<u16> {
    (0..source.info().dims.nz()).map(|z| slice(source, z)[0]).collect()
}

fn said(source: &dyn VolumeSource) -> String {
    sentences(&source.info().notes).join("\n")
}

/// Where the scanner put column i, row j of tile k: the centre of the picture is that of the first slice.
fn world([k, j, i]: [u16; 3], across: f64, sign: f64) -> [f64; 3] {
    let (row, down, normal) = ([0.8, 0.6, 0.0], [-0.36, 0.48, 0.8], [0.48, -0.64, 0.6]);
    let [columns, rows] = TILE.map(f64::from);
    let (dx, dy, dz) = (1.25, 1.5, 3.0);
    let right = ((across * columns - 1.0) / 2.0 + f64::from(i) - (columns - 1.0) / 2.0) * dx;
    let below = ((across * rows - 1.0) / 2.0 + f64::from(j) - (rows - 1.0) / 2.0) * dy;
    let up = sign * f64::from(k) * dz;
    let corner = [-805.0, -825.5, -75.25];
    [0, 1, 2].map(|a| corner[a] + right * row[a] + below * down[a] + up * normal[a])
}

#[test]
fn every_pixel_of_an_oblique_mosaic_lies_where_it_was_measured() {
    for (slices, across) in [(1, 1.0), (4, 2.0), (5, 3.0), (7, 3.0), (9, 3.0)] {
        for (normal, sign) in [(UP, 1.0), (DOWN, -1.0)] {
            let source = opened(&oblique(slices, &normal).bytes()).unwrap();
            let info = source.info();
            assert_eq!(info.dims.to_array(), [4, 3, u32::from(slices)]);
            assert_eq!(info.spacing_mm.map(|s| (s * 1e9).round() / 1e9), [1.25, 1.5, 3.0]);
            let mut seen = 0;
            for z in 0..info.dims.nz() {
                for (at, value) in slice(&*source, z).into_iter().enumerate() {
                    let (x, y) = (u16::try_from(at % 4).unwrap(), u16::try_from(at / 4).unwrap());
                    let of = value - 1000;
                    assert_eq!([of / 10 % 10, of % 10], [y, x], "{value} at {x}, {y}, {z}");
                    let got = info.affine.apply([f64::from(x), f64::from(y), f64::from(z)]);
                    let want = world([of / 100, y, x], across, sign);
                    let off = (0..3).map(|a| (got[a] - want[a]).abs()).fold(0.0, f64::max);
                    assert!(off < 1e-9, "{slices} slices, {value}: {got:?}, not {want:?}");
                    seen += 1;
                }
            }
            assert_eq!(seen, 12 * u32::from(slices));
            // Indices are right-handed, whichever way the slices follow each other.
            let [a, b, c] = [0, 1, 2].map(|axis| info.affine.rows.map(|row| row[axis]));
            let volume = a[0] * (b[1] * c[2] - b[2] * c[1]) - b[0] * (a[1] * c[2] - a[2] * c[1])
                + c[0] * (a[1] * b[2] - a[2] * b[1]);
            assert!((volume - 1.25 * 1.5 * 3.0).abs() < 1e-9, "{volume}");
            let first = if sign > 0.0 { 1000 } else { 1000 + 100 * (slices - 1) };
            assert_eq!(firsts(&*source)[0], first);
            assert_eq!(said(&*source), "");
        }
    }
}

#[test]
fn parts_of_rows_are_read_from_inside_their_tile() {
    let source = opened(&oblique(7, &UP).bytes()).unwrap();
    for z in 0..7 {
        let mut out = [0; 8];
        source.read_rows(z, 1..3, 1..3, &mut out).unwrap();
        let got = out.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b)).collect::<Vec<_>>();
        let k = u16::try_from(z).unwrap();
        assert_eq!(got, [label(k, 1, 1), label(k, 1, 2), label(k, 2, 1), label(k, 2, 2)]);
    }
}

#[test]
fn packed_mosaics_hold_the_same_slices() {
    for normal in [UP, DOWN] {
        let image = oblique(7, &normal);
        let native = opened(&image.bytes()).unwrap();
        let mut pixels = vec![0; 12 * 9];
        for (at, pixel) in pixels.iter_mut().enumerate() {
            let (y, x) = (u16::try_from(at / 12).unwrap(), u16::try_from(at % 12).unwrap());
            let k = y / 3 * 3 + x / 4;
            *pixel = if k < 7 { label(k, y % 3, x % 4) } else { 0 };
        }
        for file in [
            image.encapsulated(RLE, &[rle16(&pixels)]),
            deflated(&image.bytes(), false),
            deflated(&image.bytes(), true),
        ] {
            let packed = opened(&file).unwrap();
            assert_eq!(format!("{:?}", packed.info().affine), format!("{:?}", native.info().affine));
            for z in 0..7 {
                assert_eq!(slice(&*packed, z), slice(&*native, z), "slice {z}");
            }
        }
    }
}

/// A point in time of a series of five slices, all of whose samples are its number and that of the slice.
fn point(time: u16) -> Elements {
    let value = move |k: u16, _: u16, _: u16| 100 * time + k;
    let mut image = mosaic(5, TILE, OBLIQUE, &UP, &value);
    image.set(0x0008_0018, "UI", &format!("1.2.3.4.{time}")).set(0x0020_0013, "IS", &time.to_string());
    image.set(0x0020_0012, "IS", &time.to_string());
    image.set(0x0008_0032, "TM", &format!("1000{time:02}.5"));
    image
}

#[test]
fn every_mosaic_of_a_series_is_a_volume_in_the_order_of_time() {
    let numbered = [3, 1, 2].map(point);
    let mut untimed = numbered.clone();
    for image in &mut untimed {
        image.without(0x0020_0012);
    }
    let mut bare = untimed.clone();
    for image in &mut bare {
        image.without(0x0008_0032);
    }
    let mut nameless = bare.clone();
    for image in &mut nameless {
        image.without(0x0020_0013);
    }
    for (images, labels) in [
        (&numbered, ["acquisition 1", "acquisition 2", "acquisition 3"]),
        (&untimed, ["acquired 1", "acquired 2", "acquired 3"]),
        (&bare, ["set 1 of 3", "set 2 of 3", "set 3 of 3"]),
        (&nameless, ["set 1", "set 2", "set 3"]),
    ] {
        let (found, _folder) = findings(images);
        let parts: Vec<_> = found.iter().map(|f| f.part.as_deref().unwrap_or_default()).collect();
        assert_eq!(parts, labels);
        let mut seen = Vec::new();
        for finding in &found {
            assert_eq!((finding.files.count, finding.size), (1, Some([4, 3, 5])));
            let source = finding.subject.as_ref().unwrap().volume().unwrap();
            let first = firsts(source);
            let time = first[0] / 100;
            assert_eq!(first, [0, 1, 2, 3, 4].map(|k| 100 * time + k));
            assert!(said(source).contains("the series holds 3 volumes"), "{}", said(source));
            seen.push(time);
        }
        // Nothing tells in which order nameless ones were measured.
        if labels[0] == "set 1" {
            seen.sort_unstable();
        }
        assert_eq!(seen, [1, 2, 3], "{labels:?}");
    }
}

#[test]
fn volumes_are_chosen_by_number_and_echoes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for time in 1..=3 {
        for echo in 1..=2_u16 {
            let mut image = point(time);
            image.set(0x0018_0086, "IS", &echo.to_string());
            image.set(0x0008_0018, "UI", &format!("1.2.3.5.{time}.{echo}"));
            files.push(image.bytes());
        }
    }
    put(folder.path(), &files);
    let inputs = [folder.path().to_path_buf()];
    let found = Catalogue::survey(&inputs, &OpenOptions::default(), folder.path()).unwrap();
    let parts: Vec<_> = found.open(0).into_iter().map(|f| f.part.unwrap()).collect();
    let expected: Vec<String> =
        (1..=3).flat_map(|t| (1..=2).map(move |e| format!("acquisition {t} echo {e}"))).collect();
    assert_eq!(parts, expected);
    let options = OpenOptions { volume: Some(3), ..OpenOptions::default() };
    assert_eq!(firsts(open(&inputs, &options).unwrap().as_ref())[0], 200);
}

#[test]
fn a_head_that_moves_keeps_its_place_at_every_time() {
    let moved = [0.0, 0.2, 0.4].map(|mm| {
        let mut image = point(1 + if mm > 0.3 { 2 } else { u16::from(mm > 0.1) });
        image.set(0x0020_0032, "DS", &format!("-805\\-825.5\\{}", -75.25 + mm));
        image
    });
    let turned = {
        let mut image = point(4);
        image.set(0x0020_0037, "DS", "0.80003\\0.59996\\0\\-0.35998\\0.48002\\0.8");
        image
    };
    let mut images = moved.to_vec();
    images.push(turned);
    let (found, _folder) = findings(&images);
    assert_eq!(found.len(), 4);
    let corner = |f: &Finding| f.subject.as_ref().unwrap().volume().unwrap().info().affine.apply([0.0; 3])[2];
    let corners: Vec<f64> = found.iter().map(corner).collect();
    for (n, mm) in [0.0, 0.2, 0.4].into_iter().enumerate() {
        assert!((corners[n] - corners[0] - mm).abs() < 1e-9, "{corners:?}");
    }
    let turned = found[3].subject.as_ref().unwrap().volume().unwrap().info().affine;
    assert!((turned.rows[0][0] - 1.25 * 0.80003).abs() < 1e-12, "{turned:?}");
}

#[test]
fn both_forms_of_the_private_header_count_wherever_its_block_is() {
    let tags: [(&str, &[&str]); 3] = [
        ("EchoLinePosition", &["64", "", ""]),
        ("NumberOfImagesInMosaic", &["7       ", "", ""]),
        ("SliceNormalVector", &DOWN),
    ];
    for newer in [true, false] {
        let mut image = oblique(7, &UP);
        image.without(0x0019_100a).without(0x0029_0010).without(0x0029_1010);
        image.set(0x0029_0010, "LO", "SOMEBODY ELSE").raw(0x0029_1010, "OB", b"none of it");
        image.set(0x0029_0042, "LO", "SIEMENS CSA HEADER").raw(0x0029_4210, "UN", &csa(newer, &tags));
        let source = opened(&image.bytes()).unwrap();
        assert_eq!(firsts(&*source)[0], 1600);
        assert_eq!(said(&*source), "");
    }
}

#[test]
fn without_the_private_header_the_number_alone_is_enough_with_a_warning() {
    let mut image = oblique(7, &DOWN);
    let source = opened(&image.without(0x0029_1010).bytes()).unwrap();
    assert_eq!(firsts(&*source)[0], 1000);
    let words = "does not state in which direction its slices follow each other; rows x columns is assumed";
    assert!(said(&*source).contains(words), "{}", said(&*source));
    let damaged = image.raw(0x0029_1010, "OB", b"SV10\x04\x03\x02\x01\xff\xff\xff\xff\x4d\0\0\0").bytes();
    let said = said(&*opened(&damaged).unwrap());
    assert!(said.contains("(its private header cannot be read: it states 4294967295 tags)"), "{said}");
    let error = refused(image.without(0x0019_100a));
    assert!(error.contains("does not state the number of its slices"), "{error}");
    assert!(error.contains("(it cannot be read: it states 4294967295 tags)"), "{error}");
    let error = refused(image.without(0x0029_1010));
    assert!(
        error.contains("which only the private header (0029,1010) has; give the original files"),
        "{error}"
    );
    // Of somebody else's block nothing is believed.
    let foreign = oblique(7, &UP).with(0x0019_0010, "LO", "SOMEBODY").without(0x0029_1010).clone();
    assert!(refused(&foreign).contains("does not state the number"), "{}", refused(&foreign));
}

#[test]
fn distances_fall_back_to_the_thickness_and_then_to_a_millimetre() {
    let mut image = oblique(5, &UP);
    for (words, mm) in [("", 3.0), ("their thickness, 2.5 mm, is taken", 2.5), ("1 mm is assumed", 1.0)] {
        let source = opened(&image.bytes()).unwrap();
        assert!((source.info().spacing_mm[2] - mm).abs() < 1e-12);
        assert!(said(&*source).contains(words), "{}", said(&*source));
        image.without(if words.is_empty() { 0x0018_0088 } else { 0x0018_0050 });
    }
    let mut nowhere = oblique(5, &UP);
    nowhere.without(0x0020_0032);
    let source = opened(&nowhere.bytes()).unwrap();
    assert_eq!(source.info().affine.apply([0.0; 3]), [0.0; 3]);
    assert_eq!(firsts(&*source), [1000, 1100, 1200, 1300, 1400]);
    assert!(said(&*source).contains("the mosaic states no position"), "{}", said(&*source));
}

#[test]
fn numbers_that_do_not_fit_together_are_refused_in_a_sentence() {
    let stated = |csa_slices: &str, slices: u16, normal: &[&str; 3]| {
        let mut image = oblique(7, normal);
        let tags: [(&str, &[&str]); 2] =
            [("NumberOfImagesInMosaic", &[csa_slices]), ("SliceNormalVector", normal)];
        image.us(0x0019_100a, slices).raw(0x0029_1010, "OB", &csa(true, &tags));
        image
    };
    let mut two = oblique(7, &UP);
    two.set(0x0028_0008, "IS", "2").raw(0x7fe0_0010, "OW", &[0; 432]);
    for (image, words) in [
        (stated("7", 30, &UP), "whose private elements state 7 slices, and 30 in another place"),
        (stated("20", 20, &UP), "of 20 slices has 5 x 5 tiles, and its 12 x 9 pixels cannot be divided so"),
        (stated("60000", 0, &UP), "of 60000 slices has 245 x 245 tiles"),
        (stated("4294967295", 0, &UP), "of 4294967295 slices has 65536 x 65536 tiles"),
        (stated("7", 7, &["1", "0", "0"]), "not perpendicular to its rows and columns"),
        (stated("0", 0, &UP), "does not state the number of its slices"),
        (two.clone(), "of several frames cannot be read"),
    ] {
        let error = refused(&image);
        assert!(error.contains("a Siemens mosaic") && error.contains(words), "{error}");
    }
    let cut = oblique(7, &UP).raw(0x7fe0_0010, "OW", &[0; 214]).clone();
    assert!(refused(&cut).contains("the pixels are cut short: 214 bytes of 216"), "{}", refused(&cut));
}

#[test]
fn an_enhanced_image_is_no_mosaic_whatever_it_says() {
    let mut image = mosaic(4, [2, 2], FLAT, &["0", "0", "1"], &label);
    image.us(0x0028_0010, 2).us(0x0028_0011, 2).set(0x0028_0008, "IS", "4");
    image.raw(0x5200_9229, "SQ", &[]);
    let source = opened(&image.bytes()).unwrap();
    assert_eq!(source.info().dims.to_array(), [2, 2, 4]);
}

#[test]
fn one_bad_mosaic_stands_in_the_way_of_no_other() {
    let mut images = [1, 2, 3].map(point).to_vec();
    images[1].raw(0x7fe0_0010, "OW", &[0; 20]);
    let (found, _folder) = findings(&images);
    let fates: Vec<_> = found.iter().map(|f| (f.size.unwrap(), f.subject.is_ok())).collect();
    assert_eq!(fates, [([4, 3, 5], true), ([4, 3, 5], false), ([4, 3, 5], true)]);
    // A copy of a picture is not a volume of its own.
    let twice = [point(1), point(2), point(2)];
    assert_eq!(findings(&twice).0.len(), 2);
}
