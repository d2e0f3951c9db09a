//! A series is the volume that its positions describe, whatever the files are called and however they
//! are encoded: the samples delivered equal those of a raw volume, block by block.

use crate::prelude::*;
use infobyte::discovery::open_unprepared as open;

fn read(source: &dyn VolumeSource, z: u32, rows: (u32, u32), cols: (u32, u32)) -> Vec<u8> {
    let samples = (rows.1 - rows.0) as usize * (cols.1 - cols.0) as usize;
    let mut out = vec![0xaa; samples * source.info().scalar.bytes()];
    source.read_rows(z, rows.0..rows.1, cols.0..cols.1, &mut out).unwrap();
    out
}

/// Writes images as 1.dcm, 2.dcm, ... and returns the folder.
fn folder_of(images: &[Image<'_>]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("series");
    fs::create_dir(&inner).unwrap();
    for (i, image) in images.iter().enumerate() {
        fs::write(inner.join(format!("{}.dcm", i + 1)), image.bytes()).unwrap();
    }
    (folder, inner)
}

fn refusal(images: &[Image<'_>]) -> String {
    let (_keep, folder) = folder_of(images);
    open(&[folder], &OpenOptions::default()).unwrap_err().to_string()
}

fn at(z: f64) -> Image<'static> {
    Image { position: [0.0, 0.0, z], ..Image::default() }
}

#[test]
fn raw_file_slice_files_and_series_in_every_encoding_deliver_the_same_bytes() {
    let mut random = Random(7);
    let (nx, ny, nz) = (7_u16, 5_u16, 6_usize);
    for (syntax, meta, clutter) in
        Syntax::ALL.into_iter().flat_map(|s| [(s, true, true), (s, false, false), (s, false, true)])
    {
        for (bits, signed, scalar) in [
            (8, false, ScalarType::U8),
            (8, true, ScalarType::I8),
            (16, false, ScalarType::U16),
            (16, true, ScalarType::I16),
            (32, false, ScalarType::U32),
            (32, true, ScalarType::I32),
        ] {
            let area = usize::from(nx) * usize::from(ny);
            let w = scalar.bytes();
            let slices: Vec<Vec<u32>> =
                (0..nz).map(|_| (0..area).map(|_| random.below(u32::MAX)).collect()).collect();
            // Files in a scrambled order of positions.
            let order = [3, 0, 5, 1, 4, 2];
            let images: Vec<Image<'_>> = order
                .iter()
                .map(|z| Image {
                    syntax,
                    meta,
                    clutter,
                    size: [nx, ny],
                    bits: [bits, bits],
                    signed,
                    position: [1.0, 2.0, 10.0 + 1.5 * *z as f64],
                    values: &slices[*z],
                    ..Image::default()
                })
                .collect();
            let (keep, folder) = folder_of(&images);
            let raw: Vec<Vec<u8>> = slices
                .iter()
                .map(|s| s.iter().flat_map(|v| v.to_le_bytes()[..w].to_vec()).collect())
                .collect();
            let whole = keep.path().join("whole");
            fs::write(&whole, raw.concat()).unwrap();
            let split: Vec<PathBuf> = (0..nz).map(|z| keep.path().join(format!("z{z}"))).collect();
            split.iter().zip(&raw).for_each(|(path, bytes)| fs::write(path, bytes).unwrap());
            let options = RawOptions {
                dims: Dims::new(nx.into(), ny.into(), 6).unwrap(),
                scalar,
                endian: Endian::Little,
                spacing_mm: [0.5, 0.75, 1.5],
                skip: 0,
                orientation: Orientation::LPS,
            };
            let series = open(std::slice::from_ref(&folder), &OpenOptions::default()).unwrap();
            let info = series.info();
            assert_eq!((info.dims, info.scalar), (options.dims, scalar));
            assert_eq!(info.spacing_mm, options.spacing_mm);
            assert_eq!(info.affine.origin(), [1.0, 2.0, 10.0]);
            assert_eq!(info.rescale.intercept, -1024.0);
            let raws =
                [RawVolume::open(&[whole], &options).unwrap(), RawVolume::open(&split, &options).unwrap()];
            for _ in 0..20 {
                let (z, y, x) = (random.below(6), random.below(5), random.below(7));
                let rows = (y, y + 1 + random.below(5 - y));
                let cols = if z % 2 == 0 { (0, 7) } else { (x, x + 1 + random.below(7 - x)) };
                let expected = read(&raws[0], z, rows, cols);
                assert_eq!(read(&raws[1], z, rows, cols), expected);
                assert_eq!(
                    read(&*series, z, rows, cols),
                    expected,
                    "{syntax:?} {scalar} {z} {rows:?} {cols:?}"
                );
            }
        }
    }
}

#[test]
fn a_tilted_gantry_is_kept_in_the_affine() {
    // Rows tilted about x by asin(0.6); slices stacked along world z.
    let images: Vec<Image<'_>> = (0..4)
        .map(|i| Image {
            position: [0.0, 0.0, 4.0 * f64::from(i)],
            orientation: "1\\0\\0\\0\\0.8\\0.6",
            ..Image::default()
        })
        .collect();
    let (_keep, folder) = folder_of(&images);
    let series = open(&[folder], &OpenOptions::default()).unwrap();
    let info = series.info();
    assert_eq!(info.affine.column(2), [0.0, 0.0, 4.0]);
    assert_eq!(info.affine.column(0), [0.5, 0.0, 0.0]);
    assert!(
        (info.affine.column(1)[1] - 0.6).abs() < 1e-12 && (info.affine.column(1)[2] - 0.45).abs() < 1e-12
    );
    assert!(info.affine.determinant() > 0.0);
    assert!(sentences(&info.notes).iter().any(|w| w.contains("36.87 degrees")), "{:?}", info.notes);
}

#[test]
fn slices_that_differ_in_rescale_become_physical_values() {
    let mut images: Vec<Image<'_>> = (0..3).map(|i| at(f64::from(i))).collect();
    images[1].rescale = Some(["0.5", "10"]);
    let (_keep, folder) = folder_of(&images);
    let series = open(&[folder], &OpenOptions::default()).unwrap();
    assert_eq!((series.info().scalar, series.info().rescale.slope), (ScalarType::F32, 1.0));
    let values = |z, cols| -> Vec<f32> {
        read(&*series, z, (0, 2), cols).chunks_exact(4).map(bytemuck::pod_read_unaligned).collect()
    };
    assert_eq!(values(0, (0, 2)), [-1023.0, -1022.0, -1021.0, -1020.0]);
    assert_eq!(values(1, (0, 2)), [10.5, 11.0, 11.5, 12.0]);
    assert_eq!(values(1, (1, 2)), [11.0, 12.0]);
    images[2].rescale = None;
    assert!(refusal(&images).contains("1 of 3 slices state no rescale"));
}

#[test]
fn padding_becomes_air_and_overlay_bits_are_cut() {
    let values = [63_536, 0xf123, 24, 4095];
    let images: Vec<Image<'_>> = (0..2)
        .map(|i| Image { bits: [16, 12], padding: Some(63_536), values: &values, ..at(f64::from(i)) })
        .collect();
    let (_keep, folder) = folder_of(&images);
    let series = open(&[folder], &OpenOptions::default()).unwrap();
    let got: Vec<u16> =
        read(&*series, 1, (0, 2), (0, 2)).chunks_exact(2).map(bytemuck::pod_read_unaligned).collect();
    // -1000 HU is stored as 24.
    assert_eq!(got, [24, 0x123, 24, 4095]);
}

#[test]
fn gaps_repeats_and_cut_slices_are_refused_and_named() {
    let error = refusal(&[at(0.0), at(2.0), at(4.0), at(8.0)]);
    assert!(error.contains("probably missing: 1 slice in 1 place, first between 3.dcm and 4.dcm"), "{error}");
    let other = |z| Image { values: &[4, 3, 2, 1], ..at(z) };
    let third = |z| Image { values: &[1, 1, 1, 1], ..at(z) };
    let error = refusal(&[at(1.0), other(1.0), third(1.0)]);
    assert!(error.contains("all 3 images are at one position"), "{error}");
    let error = refusal(&[at(0.0), at(2.0), other(2.0), at(4.0)]);
    assert!(error.contains("first: 2.dcm and 3.dcm"), "{error}");
    let cut = Image { values: &[1, 2, 3], ..at(4.0) };
    let (_keep, folder) = folder_of(&[at(0.0), at(2.0), cut]);
    // Elements after the pixels do not make up for missing ones.
    let error = open(&[folder], &OpenOptions::default()).unwrap_err().to_string();
    assert!(error.contains("3.dcm: the pixels are cut short: 6 bytes of 8"), "{error}");
}

#[test]
fn the_largest_series_is_taken_and_foreign_files_are_reported() {
    let other = |z| Image { series: "1.2.9", ..at(z) };
    let (_keep, folder) = folder_of(&[at(0.0), other(0.0), other(1.0), at(1.0), other(2.0)]);
    fs::write(folder.join("notes.txt"), "no image").unwrap();
    fs::write(folder.join(".DS_Store"), "hidden").unwrap();
    let deep = folder.join("a/b/c/d/e");
    fs::create_dir_all(deep.join("f")).unwrap();
    fs::write(deep.join("deepest.dcm"), other(3.0).bytes()).unwrap();
    fs::write(deep.join("f/too-deep.dcm"), other(4.0).bytes()).unwrap();
    let series = open(&[folder], &OpenOptions::default()).unwrap();
    assert_eq!(series.info().dims.to_array(), [2, 2, 4]);
    let warned = sentences(&series.info().notes).join("\n");
    assert!(
        warned.contains("not used: CT image 2x2x2")
            && warned.contains("1 file left out: not a volume (first: notes.txt)"),
        "{warned}"
    );
    assert!(!format!("{:?}", series.info()).contains("Nobody"));
}

#[test]
fn a_scout_beside_a_broken_series_is_not_mistaken_for_the_volume() {
    let scout = Image { series: "1.2.9", ..at(0.0) };
    let error = refusal(&[at(0.0), at(1.0), at(3.0), scout]);
    assert!(error.contains("probably missing"), "{error}");
}

#[test]
fn many_slices_are_read_with_few_descriptors() {
    let values = [0; 4];
    let images: Vec<Image<'_>> = (0..1500).map(|i| Image { values: &values, ..at(f64::from(i)) }).collect();
    let (_keep, folder) = folder_of(&images);
    let series = open(&[folder], &OpenOptions::default()).unwrap();
    for z in (0..1500).rev() {
        assert_eq!(read(&*series, z, (1, 2), (0, 2)), [0; 4]);
    }
    let open = fs::read_dir("/proc/self/fd").map_or(0, Iterator::count);
    // Other tests of this process hold a few of their own.
    assert!(open < 1200, "{open} descriptors are open");
}
