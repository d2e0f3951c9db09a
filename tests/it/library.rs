//! What a program does with data of its own: borrowed arrays, slices in order, models in memory, many rays, triangles,
//! voxels. If this fails, a program gets another model, or other answers, than the command.
#![expect(clippy::cast_possible_truncation, reason = "small volumes")]

#[allow(dead_code, reason = "a program of its own")]
#[path = "../../examples/function.rs"]
mod function;

use crate::prelude::*;
use std::error::Error as _;
use std::io;
use std::sync::Arc;

use infobyte::load::LoadError;
use infobyte::{Hits, VolumeView, builder};

const SIDES: [u32; 3] = [37, 41, 45];

fn dims() -> Dims {
    let [nx, ny, nz] = SIDES;
    Dims::new(nx, ny, nz).unwrap()
}

/// A gyroid in a ball with specks, inside from 1000 on.
fn sample([x, y, z]: [u32; 3]) -> u16 {
    let [a, b, c] = [x, y, z].map(|v| f64::from(v) * 0.35);
    let gyroid = a.sin() * b.cos() + b.sin() * c.cos() + c.sin() * a.cos();
    let from_middle =
        [x, y, z].iter().zip(SIDES).map(|(v, n)| (f64::from(*v) - f64::from(n) / 2.0).powi(2)).sum::<f64>();
    let speck = if (x * 7 + y * 11 + z * 13) % 331 == 0 { 900.0 } else { 0.0 };
    let depth = (300.0 * gyroid).min(20.0 * (17.0 - from_middle.sqrt()));
    (1000.0 + depth + speck).clamp(0.0, 65535.0) as u16
}

fn sheared() -> Affine {
    Affine { rows: [[0.5, 0.1, 0.0, -8.0], [0.0, -0.7, 0.1, 20.0], [0.2, 0.0, 0.9, 5.0]] }
}

fn voxels() -> Voxels<u16> {
    Voxels::from_fn(dims(), sample).placed(sheared())
}

fn options(surface: SurfaceKind) -> BuildOptions {
    let channels = match surface {
        SurfaceKind::Skin => Channels::default().with(Channel::Value),
        SurfaceKind::Cells => Channels::default(),
    };
    BuildOptions {
        threshold: Threshold::Iso(1000.0),
        surface: Some(surface),
        channels: Some(channels),
        ..BuildOptions::default()
    }
}

fn built(source: &dyn VolumeSource, options: &BuildOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    infobyte::build(source, options, &path).unwrap();
    fs::read(path).unwrap()
}

fn cleaned(source: &mut dyn VolumeSource, cleaning: &CleanOptions, options: &BuildOptions) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    infobyte::clean_and_build(source, cleaning, options, &path, &Silent).unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    fs::read(path).unwrap()
}

fn model(surface: SurfaceKind) -> Model<Vec<u8>> {
    Model::from_bytes(built(&voxels(), &options(surface))).unwrap()
}

const BOTH: [SurfaceKind; 2] = [SurfaceKind::Skin, SurfaceKind::Cells];

#[test]
fn a_view_of_any_strides_gives_the_model_of_a_copy() {
    let [nx, ny, nz] = SIDES.map(|n| n as usize);
    let c_order = voxels();
    let wanted = BOTH.map(|surface| built(&c_order, &options(surface)));
    let mut fortran = vec![0_u16; nx * ny * nz];
    let mut backwards = vec![0_u16; nx * ny * nz];
    let mut sparse = vec![7_u16; 2 * nx * (ny + 1) * nz + 5];
    for (x, y, z) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (x, y, z)))) {
        let value = sample([x as u32, y as u32, z as u32]);
        fortran[(x * ny + y) * nz + z] = value;
        backwards[nx * ny * nz - 1 - ((z * ny + y) * nx + x)] = value;
        sparse[5 + 2 * ((z * (ny + 1) + y) * nx + x)] = value;
    }
    let [x, y, z] = [nx, ny, nz].map(usize::cast_signed);
    let last = nx * ny * nz - 1;
    let views = [
        VolumeView::new(dims(), c_order.samples()),
        VolumeView::strided(dims(), &fortran, 0, [y * z, z, 1]),
        VolumeView::strided(dims(), &backwards, last, [-1, -x, -x * y]),
        VolumeView::strided(dims(), &sparse, 5, [2, 2 * x, 2 * x * (y + 1)]),
    ];
    for view in views {
        let view = view.unwrap().placed(sheared());
        for (surface, wanted) in BOTH.into_iter().zip(&wanted) {
            assert!(built(&view, &options(surface)) == *wanted, "{surface:?}");
        }
    }
    // Values ten times as high, a threshold ten times as high: the same skin.
    let rescale = Rescale { slope: 10.0, intercept: 0.0 };
    let view = VolumeView::new(dims(), c_order.samples()).unwrap().placed(sheared()).rescaled(rescale);
    let tenfold = BuildOptions { threshold: Threshold::Iso(10_000.0), ..options(SurfaceKind::Skin) };
    let (a, b) = (Model::from_bytes(built(&view, &tenfold)).unwrap(), model(SurfaceKind::Skin));
    assert!(a.voxels().map(|v| v.voxel).eq(b.voxels().map(|v| v.voxel)));
    assert!(a.voxels().zip(b.voxels()).all(|(a, b)| a.value == b.value.map(|v| 10.0 * v)));
}

#[test]
fn borrowed_volumes_are_cleaned_as_owned_ones() {
    let samples = voxels();
    let cleanings = [
        CleanOptions { roi: Some([3..30, 0..41, 5..40]), ..CleanOptions::default() },
        CleanOptions { downsample: Some(2), ..CleanOptions::default() },
        CleanOptions { preset: infobyte::clean::Preset::parse("teeth"), ..CleanOptions::default() },
        CleanOptions {
            roi: Some([3..30, 0..41, 5..40]),
            close: 1,
            fill_cavities: true,
            keep_largest: Some(1),
            ..CleanOptions::default()
        },
    ];
    let build = options(SurfaceKind::Skin);
    let mut seen = vec![built(&samples, &build)];
    for cleaning in cleanings {
        let mut view = VolumeView::new(dims(), samples.samples()).unwrap().placed(sheared());
        let borrowed = cleaned(&mut view, &cleaning, &build);
        // The steps one by one, on a box that owns.
        let source = cleaning.reshape(Box::new(samples.clone())).unwrap();
        let mut own = build.clone();
        if let Some(preset) = cleaning.preset {
            own.threshold = preset.threshold();
        }
        let done = cleaning.clean(&*source, &own, Path::new("m.oct"), &Silent).unwrap();
        let owned = match &done {
            Some(done) => {
                own.threshold = Threshold::Chosen(done.selection);
                built(done.source(), &own)
            }
            None => built(&*source, &own),
        };
        assert!(borrowed == owned, "{cleaning:?}");
        assert!(!seen.contains(&borrowed), "{cleaning:?} did nothing");
        seen.push(borrowed);
    }
    let nothing = cleaned(&mut voxels(), &CleanOptions::default(), &build);
    assert!(nothing == seen[0]);
}

#[test]
fn slices_in_order_give_the_model_of_the_whole() {
    let build = options(SurfaceKind::Skin);
    let [nx, ny, nz] = SIDES;
    let fill = |z: u32, slice: &mut [u16]| {
        let places = (0..ny).flat_map(|y| (0..nx).map(move |x| [x, y, z]));
        slice.iter_mut().zip(places).for_each(|(out, place)| *out = sample(place));
    };
    let mut asked = Vec::new();
    let mut slices = Slices::new(dims(), |z, slice: &mut [u16]| {
        asked.push(z);
        fill(z, slice);
        Ok(())
    })
    .placed(sheared());
    assert_eq!(slices.preparation().memory_bytes, u64::from(nx * ny * 2));
    let none = CleanOptions::default();
    assert!(cleaned(&mut slices, &none, &build) == built(&voxels(), &build));
    // They were read once, and stay: another build takes them from where they are.
    assert!(cleaned(&mut slices, &none, &build) == built(&voxels(), &build));
    drop(slices);
    assert!(asked.into_iter().eq(0..nz));

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let mut failing = Slices::new(dims(), |z, slice: &mut [u16]| {
        fill(z, slice);
        if z == 7 { Err(io::Error::other("the scanner was unplugged")) } else { Ok(()) }
    });
    let error = infobyte::clean_and_build(&mut failing, &none, &build, &path, &Silent).unwrap_err();
    assert_eq!(error.kind(), ExitKind::Input);
    assert!(error.to_string().contains("slice 7") && error.to_string().contains("unplugged"), "{error}");
    // Its slices are gone.
    assert!(infobyte::clean_and_build(&mut failing, &none, &build, &path, &Silent).is_err());
    let mut whole = Slices::new(dims(), |z, slice: &mut [u16]| {
        fill(z, slice);
        Ok(())
    });
    // Without a place to write them to, and with less memory than a slice.
    assert!(infobyte::build(&whole, &build, &path).unwrap_err().to_string().contains("unrolled"));
    let little = BuildOptions { memory: MemoryCap::Share(1000), ..build.clone() };
    let error = infobyte::clean_and_build(&mut whole, &none, &little, &path, &Silent).unwrap_err();
    assert_eq!(error.kind(), ExitKind::Budget);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    infobyte::clean_and_build(&mut whole, &none, &build, &path, &Silent).unwrap();
}

#[test]
fn a_model_in_memory_does_not_care_what_becomes_of_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    infobyte::build(&voxels(), &options(SurfaceKind::Skin), &path).unwrap();
    let bytes = fs::read(&path).unwrap();
    let model = Arc::new(Model::read(&path).unwrap());
    assert!(model.bytes() == bytes && Model::open(&path).unwrap().bytes() == bytes);
    // A caster that owns the model goes to another thread, and outlives every name of it here.
    let caster = RayCaster::new(Arc::clone(&model)).unwrap();
    drop(model);
    fs::write(&path, b"cut short").unwrap();
    let middle = sheared().apply([18.0, 20.0, 22.0]);
    let cast = move || caster.first_hit([middle[0], middle[1], -500.0], [0.0, 0.0, 1.0]).unwrap();
    assert!(std::thread::spawn(cast).join().unwrap().is_some());

    let refused = |path: &Path| Model::read(path).err().unwrap();
    let of_format = |error: LoadError| error.source().is_some_and(|cause| cause.is::<FormatError>());
    assert!(of_format(refused(&path)));
    for unreadable in [folder.path().join("none.oct"), folder.path().to_path_buf()] {
        let error = refused(&unreadable);
        assert_eq!(error.path(), Some(&*unreadable));
        assert!(error.to_string().contains("cannot be read"), "{error}");
    }
    fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    assert!(of_format(refused(&path)));
}

/// Rays from outside, from within, along axes, and beside the model.
fn rays(count: usize, random: &mut Random) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let number = |random: &mut Random, size: f64| (f64::from(random.below(2001_u32)) / 1000.0 - 1.0) * size;
    (0..count)
        .map(|i| {
            let far = if i % 3 == 0 { 15.0 } else { 120.0 };
            let grid: [f64; 3] = std::array::from_fn(|a| f64::from(SIDES[a]) / 2.0 + number(random, far));
            let target: [f64; 3] = std::array::from_fn(|a| f64::from(SIDES[a]) / 2.0 + number(random, 25.0));
            let (from, to) = (sheared().apply(grid), sheared().apply(target));
            let towards = std::array::from_fn(|a| to[a] - from[a]);
            let along = std::array::from_fn(|a| if a == i % 3 { 1.0 } else { 0.0 });
            (from, if i % 7 == 0 { along } else { towards })
        })
        .unzip()
}

/// The rays of an image, row by row: from one eye with directions of length 1, or parallel ones.
fn image([columns, rows]: [u32; 2], eye: [f64; 3], is_parallel: bool) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let middle = SIDES.map(|side| f64::from(side) / 2.0);
    (0..rows * columns)
        .map(|i| {
            let across = f64::from(i % columns) / f64::from(columns) - 0.5;
            let along = f64::from(i / columns) / f64::from(rows) - 0.5;
            let at = |from: [f64; 3]| {
                sheared().apply([from[0] + 50.0 * across, from[1] + 10.0 * along, from[2] - 40.0 * along])
            };
            let (from, to) = (if is_parallel { at(eye) } else { sheared().apply(eye) }, at(middle));
            let towards: [f64; 3] = std::array::from_fn(|a| to[a] - from[a]);
            let length = towards.iter().map(|c| c * c).sum::<f64>().sqrt();
            (from, if is_parallel { towards } else { towards.map(|c| c / length) })
        })
        .unzip()
}

/// A scanner's rays, by ring or by azimuth.
fn fan(columns: u32, rows: u32, by_ring: bool) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let eye = sheared().apply([18.0, -40.0, 22.0]);
    let line = |i: u32| {
        let at = [f64::from(i % columns), f64::from(i / columns)];
        let (turn, up) = if by_ring { (at[0], at[1]) } else { (at[1], at[0]) };
        let (turn, up) = (turn * 0.01 + 1.0, up * 0.08 - 0.3);
        (eye, [turn.cos() * up.cos(), turn.sin() * up.cos(), up.sin()])
    };
    (0..columns * rows).map(line).unzip()
}

#[test]
fn many_rays_meet_what_each_of_them_meets() {
    let mut random = Random(2026);
    let (mut origins, mut directions) = rays(5000, &mut random);
    let sets = [
        image([64, 40], [9.0, -70.0, 12.0], false),
        image([61, 43], [-50.0, -70.0, 90.0], false),
        image([33, 9], [12.0, 10.0, 8.0], false),
        image([50, 50], [30.0, 80.0, -40.0], true),
        image([200, 7], [30.0, 80.0, -40.0], true),
        fan(100, 9, true),
        fan(9, 100, false),
        fan(130, 1, true),
    ];
    let scattered = origins.len();
    for (from, along) in &sets {
        origins.extend(from);
        directions.extend(along);
    }
    let one = Voxels::from_fn(Dims::new(1, 1, 1).unwrap(), |_| 2000_u16).placed(sheared());
    let point = Model::from_bytes(built(&one, &options(SurfaceKind::Skin))).unwrap();
    let mut hits = Hits::default();
    for model in [model(SurfaceKind::Skin), model(SurfaceKind::Cells), point] {
        let caster = RayCaster::new(&model).unwrap();
        caster.first_hits(&origins, &directions, &mut hits).unwrap();
        let wanted: Vec<_> =
            origins.iter().zip(&directions).map(|(o, d)| caster.first_hit(*o, *d).unwrap()).collect();
        assert_eq!(hits.len(), wanted.len());
        // Images by themselves go in tiles, and among others in turns.
        let mut alone = Hits::default();
        let mut first = scattered;
        for (from, along) in &sets {
            caster.first_hits(from, along, &mut alone).unwrap();
            let mut met = vec![false; from.len()];
            caster.any_hit(from, along, 0.9, &mut met).unwrap();
            for (ray, wanted) in wanted[first..first + from.len()].iter().enumerate() {
                assert_eq!(alone.get(ray), *wanted, "{ray} of {}", from.len());
                assert_eq!(met[ray], wanted.is_some_and(|hit| hit.t <= 0.9));
            }
            first += from.len();
        }
        let found = wanted[..scattered].iter().flatten().count();
        assert!(model.header().voxels == 1 || (1000..4900).contains(&found), "{found}");
        for (ray, wanted) in wanted.iter().enumerate() {
            assert_eq!(hits.get(ray), *wanted, "{ray}");
            if wanted.is_none() {
                assert!(hits.t[ray] == f64::INFINITY && hits.number[ray] == Hits::NOTHING);
                assert!(hits.position_mm[ray][0].is_nan() && hits.normal[ray][0].is_nan());
            }
        }
        for t_max in [f64::INFINITY, 1.0, 0.8, 0.0, -1.0, f64::NAN] {
            let mut met = vec![true; origins.len()];
            caster.any_hit(&origins, &directions, t_max, &mut met).unwrap();
            for (met, wanted) in met.iter().zip(&wanted) {
                assert_eq!(*met, wanted.is_some_and(|hit| hit.t <= t_max), "{t_max}");
            }
        }
        // A batch of another length in the same arrays.
        caster.first_hits(&origins[..3], &directions[..3], &mut hits).unwrap();
        assert_eq!((hits.len(), hits.get(1), hits.get(3)), (3, wanted[1], None));
        caster.first_hits(&[], &[], &mut hits).unwrap();
        assert!(hits.is_empty());
    }
}

#[test]
fn a_bad_ray_among_many_is_named() {
    let model = model(SurfaceKind::Skin);
    let caster = RayCaster::new(&model).unwrap();
    let (mut hits, mut met) = (Hits::default(), vec![false; 2000]);
    let origins = vec![[0.0, 0.0, -99.0]; 2000];
    for (bad, why) in [([0.0; 3], BadRay::NoDirection), ([0.0, f64::NAN, 1.0], BadRay::NotFinite)] {
        let mut directions = vec![[0.0, 0.0, 1.0]; 2000];
        directions[1500] = bad;
        directions[1600] = bad;
        let named = |error: RenderError| {
            error.to_string() == format!("ray 1500 (from 0): {why}") && error.kind() == ExitKind::Usage
        };
        assert!(named(caster.first_hits(&origins, &directions, &mut hits).unwrap_err()) && hits.is_empty());
        assert!(named(caster.any_hit(&origins, &directions, 1.0, &mut met).unwrap_err()));
    }
    let few = [[0.0, 0.0, 1.0]; 3];
    let counts = |error: RenderError| error.to_string().starts_with("2000 origins and 3 directions");
    assert!(counts(caster.first_hits(&origins, &few, &mut hits).unwrap_err()));
    assert!(counts(caster.any_hit(&origins, &few, 1.0, &mut met).unwrap_err()));
    assert!(counts(caster.any_hit(&origins, &origins, 1.0, &mut met[..3]).unwrap_err()));
}

#[test]
fn the_example_of_a_function_works() {
    let folder = tempfile::tempdir().unwrap();
    function::make(folder.path()).unwrap();
    assert!(Model::open(folder.path().join("gyroid.oct")).unwrap().header().voxels > 100_000);
    assert!(fs::metadata(folder.path().join("gyroid.png")).unwrap().len() > 10_000);
}

#[test]
fn voxels_come_in_the_order_of_the_file() {
    for surface in BOTH {
        let model = model(surface);
        let all: Vec<_> = model.voxels().collect();
        assert_eq!(all.len() as u64, model.header().voxels);
        assert_eq!(model.voxels().size_hint().1, Some(all.len()));
        let codes: Vec<u64> =
            all.iter().map(|v| morton::encode(v.voxel[0], v.voxel[1], v.voxel[2])).collect();
        assert!(codes.is_sorted_by(|a, b| a < b));
        for (number, voxel) in all.iter().enumerate() {
            assert_eq!(voxel.number, number as u64);
            let length = voxel.normal.unwrap().iter().map(|c| c * c).sum::<f64>();
            assert!((length - 1.0).abs() < 1e-9);
        }
        if surface == SurfaceKind::Skin {
            // Each is inside, and has its own value.
            assert!(all.iter().all(|v| sample(v.voxel) >= 1000));
            assert!(all.iter().all(|v| v.value == Some(f64::from(sample(v.voxel)))));
        } else {
            assert!(all.iter().all(|v| v.value.is_none()));
        }
        // Rays know them by the same numbers, places and, of voxels, normals.
        let (origins, directions) = rays(2000, &mut Random(7));
        let mut hits = Hits::default();
        RayCaster::new(&model).unwrap().first_hits(&origins, &directions, &mut hits).unwrap();
        for hit in (0..hits.len()).filter_map(|ray| hits.get(ray)) {
            let voxel = all[hit.number as usize];
            assert_eq!(voxel.voxel, hit.voxel);
            if surface == SurfaceKind::Skin {
                assert_eq!(voxel.normal, hit.normal);
            }
        }
    }
    let one = Voxels::from_fn(Dims::new(1, 1, 1).unwrap(), |_| 2000_u16);
    let point = Model::from_bytes(built(&one, &options(SurfaceKind::Skin))).unwrap();
    assert_eq!(point.voxels().map(|v| v.voxel).collect::<Vec<_>>(), [[0; 3]]);
}

#[test]
fn damaged_models_have_an_end() {
    let mut bytes = built(&voxels(), &options(SurfaceKind::Skin));
    let nodes = {
        let model = Model::from_bytes(&bytes[..]).unwrap();
        let entry = model.sections().iter().find(|e| e.kind == Some(infobyte::format::SectionKind::Nodes));
        let entry = entry.unwrap();
        entry.offset as usize..entry.end() as usize
    };
    let mut random = Random(3);
    for how in 0..4 {
        for at in nodes.clone() {
            match how {
                0 => bytes[at] = 0xff,
                1 => bytes[at] = 0,
                _ => bytes[at] = random.below(256_u32) as u8,
            }
        }
        let model = Model::from_bytes(&bytes[..]).unwrap();
        assert!(model.voxels().count() as u64 <= model.view().voxel_count());
    }
}

/// The mesh of a PLY file of `oct export`.
fn read_ply(bytes: &[u8], normals: bool, colors: bool) -> infobyte::Mesh {
    let head = std::str::from_utf8(&bytes[..512]).unwrap();
    let count = |what: &str| -> usize {
        let line = head.lines().find_map(|line| line.strip_prefix(what)).unwrap();
        line.trim().parse().unwrap()
    };
    let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let (mut mesh, mut at) = (infobyte::Mesh::default(), 512);
    for _ in 0..count("element vertex") {
        mesh.vertices.push([0, 4, 8].map(|k| float(at + k)));
        at += 12;
        if normals {
            mesh.normals.push([0, 4, 8].map(|k| float(at + k)));
            at += 12;
        }
        if colors {
            mesh.colors.push([bytes[at], bytes[at + 1], bytes[at + 2]]);
            at += 3;
        }
    }
    for _ in 0..count("element face") {
        mesh.faces.push([1, 5, 9].map(|k| u32::from_le_bytes(bytes[at + k..at + k + 4].try_into().unwrap())));
        at += 13;
    }
    assert_eq!(at, bytes.len());
    mesh
}

#[test]
fn triangles_in_memory_are_those_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let (path, ply) = (folder.path().join("m.oct"), folder.path().join("m.ply"));
    let compare = |normals: bool, colors: bool| {
        let request = ExportRequest::of(ExportForm::Ply);
        let report = export(&path, &ply, request, &Silent).unwrap();
        let mesh = infobyte::triangles(&Model::read(&path).unwrap(), &Silent).unwrap();
        assert!(mesh == read_ply(&fs::read(&ply).unwrap(), normals, colors), "{normals} {colors}");
        assert_eq!(
            (report.triangles, report.vertices),
            (mesh.faces.len() as u64, mesh.vertices.len() as u64)
        );
        assert!(mesh.faces.len() > 50);
    };
    for surface in BOTH {
        infobyte::build(&voxels(), &options(surface), &path).unwrap();
        compare(true, false);
    }
    let bare = BuildOptions { channels: Some(infobyte::Channels::NONE), ..options(SurfaceKind::Skin) };
    infobyte::build(&voxels(), &bare, &path).unwrap();
    compare(false, false);

    // A tetrahedron with a colour at each corner.
    let solid = folder.path().join("a.ply");
    let mut text = String::from("ply\nformat ascii 1.0\nelement vertex 4\n");
    text += "property float x\nproperty float y\nproperty float z\n";
    text += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    text += "element face 4\nproperty list uchar int vertex_indices\nend_header\n";
    text += "0 0 0 255 0 0\n9 0 0 0 255 0\n0 9 0 0 0 255\n0 0 9 9 99 200\n";
    text += "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
    fs::write(&solid, text).unwrap();
    let mesh = on_grid(GridChoice::Side { voxels: 24, margin: 1 });
    let colored = BuildOptions { channels: Some(Channels::default().with(Channel::Color)), ..skin_options() };
    build_mesh(&[solid], &mesh, &colored, &path, &Silent).unwrap();
    compare(true, true);
    let colors: Vec<_> = Model::open(&path).unwrap().voxels().map(|v| v.color.unwrap()).collect();
    assert!(colors.iter().any(|c| c[0] > 200) && colors.iter().any(|c| c[2] > 200));

    // What is hidden is not known.
    let part =
        BuildOptions { visible_from: vec![builder::ViewedFrom::Outside], ..options(SurfaceKind::Skin) };
    infobyte::build(&voxels(), &part, &path).unwrap();
    let error = infobyte::triangles(&Model::open(&path).unwrap(), &Silent).unwrap_err();
    assert_eq!(error.kind(), ExitKind::Usage);
}
