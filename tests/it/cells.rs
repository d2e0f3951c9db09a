//! Cells hold what they promise: every inside sample lies behind its cell's surface, no ray passes from outside to
//! an inside sample, every form of the traversal finds what plain exact arithmetic over all cells finds, packing
//! is lossless, and damaged files are refused. If this fails, models have holes or differ between machines.
#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use crate::prelude::*;
use infobyte::format::cell::{CORNERS, at_corner};
use infobyte::load::CellShape;
use infobyte::render::reference::walk;

/// Builds a model of cells, or of skin, of values of 128 and more.
pub(crate) fn built(folder: &Path, voxels: &Voxels<u8>, surface: SurfaceKind) -> Model {
    let path = folder.join(surface.name());
    let options =
        BuildOptions { threshold: Threshold::Iso(128.0), surface: Some(surface), ..BuildOptions::default() };
    infobyte::build(voxels, &options, &path).unwrap();
    let model = Model::open(&path).unwrap();
    verify(&model).unwrap();
    model
}

/// The finest boxes of a model by their number.
fn boxes(model: &Model) -> HashMap<[u32; 3], u64> {
    finest(model).into_iter().map(|(at, cell)| (at, cell.get())).collect()
}

pub(crate) fn ball(n: u32, seed: u64) -> Voxels<u8> {
    let mut random = Random(seed);
    let c = [0; 3].map(|_: i32| f64::from(n) / 2.0 + random.unit() - 0.5);
    Voxels::from_fn(Dims::new(n, n, n).unwrap(), |p| {
        let d = (0..3).map(|a| (f64::from(p[a]) - c[a]).powi(2)).sum::<f64>().sqrt();
        (128.0 + 40.0 * (f64::from(n) * 0.36 - d)).clamp(0.0, 255.0) as u8
    })
}

pub(crate) fn noise(n: [u32; 3], seed: u64) -> Voxels<u8> {
    let mut random = Random(seed);
    Voxels::from_fn(Dims::new(n[0], n[1], n[2]).unwrap(), |p| {
        let border = (0..3).any(|a| p[a] == 0 || p[a] + 1 == n[a]);
        if border { 0 } else { random.byte() }
    })
}

/// All patterns of so many samples, each in the middle of its own block of outside samples.
fn patterns(shape: [u32; 3], seed: u64) -> Voxels<u8> {
    let mut random = Random(seed);
    let count = 1_u32 << (shape[0] * shape[1] * shape[2]);
    let across = (f64::from(count).sqrt().ceil()) as u32;
    let block = shape.map(|n| n + 2);
    let dims = Dims::new(across * block[0], across * block[1], block[2]).unwrap();
    Voxels::from_fn(dims, |[x, y, z]| {
        let pattern = x / block[0] + y / block[1] * across;
        let at = [x % block[0], y % block[1], z];
        let within = (0..3).all(|a| (1..=shape[a]).contains(&at[a]));
        let bit = within.then(|| at[0] - 1 + shape[0] * (at[1] - 1 + shape[1] * (at[2] - 1)));
        match bit {
            Some(bit) if pattern < count && pattern >> bit & 1 == 1 => 128 + random.below(128_u8),
            _ => random.below(128_u8),
        }
    })
}

/// Are the eight samples of every cell not all on one side, does every inside corner lie behind its plane, and
/// is no other cell kept?
fn check_cells(voxels: &Voxels<u8>, model: &Model) -> (u64, u64) {
    let dims = voxels_dims(voxels);
    let inside = |p: [i64; 3]| {
        let at = |a: usize| (0..i64::from(dims[a])).contains(&p[a]);
        (0..3).all(at) && {
            let [x, y, z] = p.map(|c| c as usize);
            voxels.samples()[(z * dims[1] as usize + y) * dims[0] as usize + x] >= 128
        }
    };
    let (found, view) = (boxes(model), model.view());
    let items = view.cells().unwrap();
    let (mut planes, mut with_corners) = (0, 0);
    for z in 0..=dims[2] {
        for y in 0..=dims[1] {
            for x in 0..=dims[0] {
                let cell = [x, y, z];
                let is_in =
                    |c: usize| inside(std::array::from_fn(|a| i64::from(cell[a]) - 1 + (c >> a & 1) as i64));
                let mask = (0..CORNERS).filter(|c| is_in(*c)).fold(0_u8, |m, c| m | 1 << c);
                assert_eq!(found.contains_key(&cell), mask != 0 && mask != 255, "{cell:?} {mask:08b}");
                let Some(number) = found.get(&cell) else { continue };
                match items.shape(*number) {
                    CellShape::Plane(plane) => {
                        assert_eq!(plane.inside() & mask, mask, "{cell:?}");
                        planes += 1;
                    }
                    CellShape::Corners(corners) => {
                        for (c, corner) in corners.into_iter().enumerate() {
                            assert_eq!(corner > 0, mask >> c & 1 == 1, "{cell:?}");
                        }
                        with_corners += 1;
                    }
                }
            }
        }
    }
    (planes, with_corners)
}

fn voxels_dims(voxels: &Voxels<u8>) -> [u32; 3] {
    use infobyte::VolumeSource;
    voxels.info().dims.to_array()
}

#[test]
fn all_patterns_of_a_cell_and_of_pairs_of_neighbours_cover_their_inside_samples() {
    let folder = tempfile::tempdir().unwrap();
    for shape in [[2, 2, 2], [3, 2, 2], [2, 3, 2], [2, 2, 3]] {
        let voxels = patterns(shape, 7);
        let model = built(folder.path(), &voxels, SurfaceKind::Cells);
        let (planes, with_corners) = check_cells(&voxels, &model);
        assert!(planes > 100 && with_corners > 50, "{planes} {with_corners}");
    }
}

/// Where a ray is as it crosses a plane: numerators over a common denominator, in units of 2^-16 cell.
type Place = ([i128; 3], i128);

/// Entry and exit of a cell that a ray visits, by slabs.
fn passage(ray: &Ray, cell: [u32; 3]) -> (Place, Place) {
    let (o, d) = (ray.origin().map(i128::from), ray.direction().map(i128::from));
    let (mut enter, mut leave): ((i128, i128), Option<(i128, i128)>) = ((0, 1), None);
    for a in 0..3 {
        if d[a] == 0 {
            continue;
        }
        let planes = [i128::from(cell[a]) << 16, i128::from(cell[a] + 1) << 16];
        let times = planes.map(|p| ((p - o[a]) * d[a].signum(), d[a].abs()));
        let (first, last) = if d[a] > 0 { (times[0], times[1]) } else { (times[1], times[0]) };
        if first.0 * enter.1 > enter.0 * first.1 {
            enter = first;
        }
        if leave.is_none_or(|l| last.0 * l.1 < l.0 * last.1) {
            leave = Some(last);
        }
    }
    let leave = leave.unwrap();
    let place = |(n, c): (i128, i128)| (std::array::from_fn(|a| o[a] * c + d[a] * n), c);
    (place(enter), place(leave))
}

/// True if a point is behind the surface of a cell; `None` where corners leave it open within rounding.
fn is_behind(shape: CellShape, cell: [u32; 3], (numerators, c): Place) -> Option<bool> {
    let middle = |a: usize| (2 * i128::from(cell[a]) + 1) << 15;
    match shape {
        CellShape::Plane(plane) => {
            let sum: i128 =
                (0..3).map(|a| i128::from(plane.normal[a]) * (numerators[a] - middle(a) * c)).sum();
            Some(sum <= (i128::from(plane.offset) << 15) * c)
        }
        CellShape::Corners(corners) => {
            let u: [f64; 3] =
                std::array::from_fn(|a| (numerators[a] - middle(a) * c) as f64 / (c << 15) as f64);
            let value: f64 = (0..CORNERS)
                .map(|i| {
                    let part = |a: usize| 0.5 * (1.0 + if i >> a & 1 == 1 { u[a] } else { -u[a] });
                    f64::from(corners[i]) * part(0) * part(1) * part(2)
                })
                .sum();
            (value.abs() > 1e-9).then_some(value > 0.0)
        }
    }
}

/// The first cell in which a ray meets the inside, by walking over all cells; `None` in the second place where
/// rounding could decide.
fn oracle(model: &Model, found: &HashMap<[u32; 3], u64>, ray: &Ray) -> Option<Option<[u32; 3]>> {
    let empty = BitVolume::new(ray.depth()).unwrap();
    let mut visited = Vec::new();
    walk(&empty, ray, true, |cell| visited.push(cell));
    let view = model.view();
    let items = view.cells().unwrap();
    for cell in visited {
        let Some(number) = found.get(&cell) else { continue };
        let (enter, leave) = passage(ray, cell);
        let shape = items.shape(*number);
        if is_behind(shape, cell, enter)? || is_behind(shape, cell, leave)? {
            return Some(Some(cell));
        }
        if let CellShape::Corners(_) = shape {
            // Between entry and exit the value may rise above 0 and fall again.
            let steps = 256;
            for k in 1..steps {
                let at = |p: &Place, a: usize| p.0[a] as f64 / p.1 as f64;
                let s = f64::from(k) / f64::from(steps);
                let place = std::array::from_fn(|a| {
                    ((at(&enter, a) * (1.0 - s) + at(&leave, a) * s) * 1024.0).round() as i128
                });
                match is_behind(shape, cell, (place, 1024)) {
                    Some(true) => return Some(Some(cell)),
                    Some(false) => {}
                    None => return None,
                }
            }
        }
    }
    Some(None)
}

#[test]
fn every_form_finds_what_plain_arithmetic_over_all_cells_finds() {
    let folder = tempfile::tempdir().unwrap();
    for (seed, voxels, most_open) in [
        (1, ball(28, 5), 0),
        (2, noise([20, 20, 20], 6), 60),
        (3, noise([5, 30, 9], 7), 60),
        (4, noise([1, 1, 1], 8), 0),
    ] {
        let voxels =
            if seed == 4 { Voxels::from_fn(Dims::new(1, 1, 1).unwrap(), |_| 200_u8) } else { voxels };
        let model = built(folder.path(), &voxels, SurfaceKind::Cells);
        let (view, found) = (model.view(), boxes(&model));
        let surface = Cells::new(view.cells().unwrap());
        let mut random = infobyte::render::selfcheck::Random::new(seed);
        let (mut hits, mut open) = (0, 0);
        for _ in 0..6000 {
            let Some(ray) = random_ray(&mut random, view.depth()) else { continue };
            let got: Vec<Option<Hit>> =
                Form::available().map(|form| single::trace(form, &view, &surface, &ray, 0).hit).collect();
            assert!(got.iter().all(|hit| *hit == got[0]), "{ray:?}");
            match oracle(&model, &found, &ray) {
                Some(want) => {
                    hits += u32::from(want.is_some());
                    // A touch between two steps of the walk through corners is open, too.
                    if got[0].map(|h| h.cell) != want {
                        assert!(most_open > 0, "{ray:?} {got:?} {want:?}");
                        open += 1;
                    }
                }
                None => open += 1,
            }
        }
        assert!(hits > 20 && open <= most_open, "{seed}: {hits} {open}");
    }
}

#[test]
fn packed_files_come_back_byte_for_byte_and_facts_are_those_of_the_volume() {
    let folder = tempfile::tempdir().unwrap();
    for voxels in [ball(40, 1), noise([40, 33, 21], 2)] {
        let model = built(folder.path(), &voxels, SurfaceKind::Cells);
        let at = |name: &str| folder.path().join(name);
        pack::pack(&at("cells"), &at("packed")).unwrap();
        pack::unpack(&at("packed"), &at("back")).unwrap();
        assert!(std::fs::read(at("back")).unwrap() == std::fs::read(at("cells")).unwrap());
        for name in ["cells", "packed"] {
            let shown = serde_json::to_value(info::read_info(&at(name)).unwrap().json()).unwrap();
            assert_eq!(shown["dims"], serde_json::json!(voxels_dims(&voxels)));
            assert_eq!((&shown["surface"], &shown["format_version"]), (&"cells".into(), &"1.0".into()));
        }
        assert_eq!(model.dims().to_array(), voxels_dims(&voxels).map(|n| n + 1));
        assert_eq!(model.affine().apply([0.5; 3]), [0.0; 3]);
    }
}

#[test]
fn a_picture_of_cells_does_not_depend_on_threads_and_coarse_boxes_are_solid() {
    let folder = tempfile::tempdir().unwrap();
    let model = built(folder.path(), &noise([40, 40, 40], 5), SurfaceKind::Cells);
    let picture = |threads: usize, lod: bool| {
        let request = RenderRequest {
            size: Some([96; 2]),
            threads,
            lod,
            depth: true,
            normals: true,
            ..Default::default()
        };
        infobyte::render(&model, &request).unwrap().0
    };
    let first = picture(1, false);
    assert!(first.rgba.iter().any(|c| *c > 0));
    for threads in [2, 3] {
        let again = picture(threads, false);
        assert!(again.rgba == first.rgba && again.depth == first.depth && again.normals == first.normals);
    }
    assert!(picture(1, true).rgba.iter().any(|c| *c > 0));
}

/// I18, and what of I4 and I14 is about cells.
#[test]
fn i18_corners_and_their_directory() {
    let folder = tempfile::tempdir().unwrap();
    let model = built(folder.path(), &noise([20, 20, 20], 3), SurfaceKind::Cells);
    let whole = model.bytes().to_vec();
    let items = model.items(Channel::Offset).unwrap();
    let announced = items.bytes().iter().filter(|o| **o == 0x80).count() as u64;
    assert!(announced > 10);
    let changed = |kind, change: &dyn Fn(&mut [u8])| fault_of(&with_section(&whole, kind, change));
    let offsets = SectionKind::Voxels(Channel::Offset);
    let first = items.bytes().iter().position(|o| *o == 0x80).unwrap();
    let fault = changed(offsets, &|bytes| bytes[first] = 5);
    assert!(fault.to_string().contains("(SPEC I18)"), "{fault}");
    let last = items.bytes().iter().rposition(|o| *o != 0x80).unwrap();
    let fault = changed(offsets, &|bytes| bytes[last] = 0x80);
    assert!(fault.to_string().contains("(SPEC I18)"), "{fault}");
    let fault = changed(SectionKind::CornerRank, &|bytes| bytes[0] ^= 1);
    assert_eq!(fault, FormatError::CornerRank { block: 0, due: 0 });
    let corners = SectionKind::Voxels(Channel::Corners);
    for change in [|bytes: &mut [u8]| bytes[0] = 0, |bytes: &mut [u8]| bytes[..CORNERS].fill(1)] {
        let fault = changed(corners, &change);
        assert!(matches!(fault, FormatError::IllegalItem { channel: Channel::Corners, .. }), "{fault:?}");
    }
    // A model of skin voxels does not have them.
    let skin = forged(&whole, |frame, _| frame.header.surface = SurfaceKind::Skin);
    let fault = fault_of(&skin);
    assert!(fault.to_string().contains("a model of skin voxels has the corners section"), "{fault}");
}

#[test]
fn a_corner_is_behind_its_own_plane() {
    for corner in 0..CORNERS {
        assert!(at_corner([42, -43, 42], corner).abs() <= 127);
    }
}
