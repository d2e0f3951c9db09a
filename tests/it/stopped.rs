//! A job that its watcher stops ends soon, with an error of its own kind, and leaves no trace, wherever it was. If this
//! fails, a program that was interrupted goes on for minutes, or loses the model that it had.

use crate::prelude::*;
use std::sync::Mutex;

use infobyte::Error;
use infobyte::jobs::picture::{Outputs, render_file};
use infobyte::render::Shading;
use infobyte::scene::Section;

/// Stops a job when it asks for the n-th time.
struct Stopper {
    after: u64,
    asked: AtomicU64,
    stage: Mutex<&'static str>,
}

impl Stopper {
    fn new(after: u64) -> Self {
        Self { after, asked: AtomicU64::new(0), stage: Mutex::new("") }
    }
}

impl Progress for Stopper {
    fn stage(&self, name: &'static str, _: u64) {
        *self.stage.lock().unwrap() = name;
    }

    fn advance(&self, _: u64) {}

    fn stopped(&self) -> bool {
        self.asked.fetch_add(1, Ordering::Relaxed) >= self.after
    }
}

fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    all.sort();
    all.into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

/// Does a job in a folder where its output is already, stopped at up to `tries` of the times that it asks; gives the
/// stages in which it was stopped.
fn stop_everywhere(
    folder: &Path,
    tries: u64,
    job: &dyn Fn(&dyn Progress) -> Result<(), Error>,
) -> BTreeSet<&'static str> {
    let before = files(folder);
    let free = Stopper::new(u64::MAX);
    job(&free).unwrap();
    assert_eq!(before.len(), files(folder).len());
    let before = files(folder);
    let asked = free.asked.into_inner();
    assert!(asked > 3, "{asked}");
    let mut stages = BTreeSet::new();
    for turn in 0..tries.min(asked) {
        let after = turn * asked / tries.min(asked);
        let stopper = Stopper::new(after);
        let error = job(&stopper).unwrap_err();
        assert!(matches!(error, Error::Stopped), "{after} of {asked}: {error}");
        assert_eq!(error.kind(), ExitKind::Stopped);
        assert!(error.to_string().contains("stopped"), "{error}");
        assert!(files(folder) == before, "{after} of {asked} left something");
        // It does not ask on and on.
        assert!(stopper.asked.into_inner() < after + 20);
        stages.insert(stopper.stage.into_inner().unwrap());
    }
    // The last question is that before the output gets its name.
    let last = Stopper::new(asked - 1);
    assert!(matches!(job(&last), Err(Error::Stopped)));
    assert!(files(folder) == before);
    job(&Stopper::new(asked)).unwrap();
    stages
}

fn depth([x, y, z]: [u32; 3]) -> f32 {
    let from = [x, y, z].map(|c| (c as f32 - 20.0).powi(2)).iter().sum::<f32>().sqrt();
    if (x * 7 + y * 11 + z * 13) % 331 == 0 { 30.0 } else { 15.0 - from + (from - 6.0).abs().min(2.0) }
}

fn dims() -> Dims {
    Dims::new(70, 41, 44).unwrap()
}

#[test]
fn a_build_is_stopped_in_every_stage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    fs::write(&path, b"an old model").unwrap();
    let cleaning = CleanOptions {
        roi: Some([0..64, 0..41, 1..44]),
        close: 1,
        fill_cavities: true,
        keep_largest: Some(1),
        ..CleanOptions::default()
    };
    let build = |surface, threads, from: &[ViewedFrom], progress: &dyn Progress| {
        let mut slices = Slices::new(dims(), |z, slice: &mut [f32]| {
            let places = (0..41).flat_map(|y| (0..70).map(move |x| [x, y, z]));
            slice.iter_mut().zip(places).for_each(|(out, place)| *out = depth(place));
            Ok(())
        });
        let visible_from = from.to_vec();
        let options = BuildOptions {
            threshold: Threshold::Otsu,
            surface: Some(surface),
            threads,
            visible_from,
            ..BuildOptions::default()
        };
        infobyte::clean_and_build(&mut slices, &cleaning, &options, &path, progress).map(|_| ())
    };
    let all = stop_everywhere(folder.path(), 200, &|progress| build(SurfaceKind::Skin, 1, &[], progress));
    for stage in ["unroll", "histogram", "range test", "close", "cavities", "components", "scan", "merge"] {
        assert!(all.contains(stage), "{stage}: {all:?}");
    }
    let seen = stop_everywhere(folder.path(), 60, &|progress| {
        build(SurfaceKind::Cells, 1, &[ViewedFrom::Outside], progress)
    });
    assert!(seen.contains("occupancy") && seen.contains("sight"), "{seen:?}");
    // Several workers ask in any order, and the job ends all the same.
    for after in [0, 1, 40, 200] {
        let before = files(folder.path());
        let error = build(SurfaceKind::Skin, 3, &[], &Stopper::new(after)).unwrap_err();
        assert!(matches!(error, Error::Stopped), "{after}: {error}");
        assert!(files(folder.path()) == before);
    }
}

#[test]
fn a_build_of_a_mesh_is_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, path) = (folder.path().join("a.stl"), folder.path().join("m.oct"));
    fs::write(&mesh, meshes::Body::tetrahedron(9.0).stl_text()).unwrap();
    fs::write(&path, b"an old model").unwrap();
    let how = on_grid(GridChoice::Side { voxels: 40, margin: 1 });
    let options = BuildOptions { threads: 1, ..skin_options() };
    let stages = stop_everywhere(folder.path(), 100, &|progress| {
        build_mesh(std::slice::from_ref(&mesh), &how, &options, &path, progress)?;
        Ok(())
    });
    for stage in ["bounds", "triangles", "scan", "merge"] {
        assert!(stages.contains(stage), "{stage}: {stages:?}");
    }
}

#[test]
fn exports_and_packing_are_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let options = BuildOptions {
        threshold: Threshold::Iso(0.0),
        surface: Some(SurfaceKind::Cells),
        ..BuildOptions::default()
    };
    infobyte::build(&Voxels::from_fn(dims(), depth), &options, at("m.oct")).unwrap();
    for name in ["m.stl", "m.ply", "m.glb", "m.nii.gz", "points.ply", "m.packed", "back.oct"] {
        fs::write(at(name), b"old").unwrap();
        let form = match name {
            "points.ply" => Some(ExportForm::Points),
            name => ExportForm::of(Path::new(name)),
        };
        stop_everywhere(folder.path(), 60, &|progress| match (form, name) {
            (Some(form), _) => {
                let request = ExportRequest::of(form);
                export(&at("m.oct"), &at(name), request, progress).map(|_| ())
            }
            (None, "m.packed") => pack::pack_with(&at("m.oct"), &at(name), progress).map(|_| ()),
            (None, _) => pack::unpack_with(&at("m.packed"), &at(name), progress).map(|_| ()),
        });
    }
    assert!(fs::read(at("m.oct")).unwrap() == fs::read(at("back.oct")).unwrap());
    let model = Model::open(at("m.oct")).unwrap();
    let stopped = infobyte::triangles(&model, &Stopper::new(5));
    assert!(matches!(stopped, Err(Error::Stopped)));
    infobyte::triangles(&model, &Silent).unwrap();
}

#[test]
fn pictures_are_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    infobyte::build(&Voxels::from_fn(dims(), depth), &BuildOptions::default(), at("m.oct")).unwrap();
    fs::write(at("m.png"), b"an old picture").unwrap();
    let cut = Section { axis: 2, at_mm: 20.0 };
    for (section, shading) in [(None, Some(Shading::Plain)), (None, Some(Shading::Ao)), (Some(cut), None)] {
        let request =
            RenderRequest { size: Some([40, 40]), section, shading, threads: 1, ..RenderRequest::default() };
        stop_everywhere(folder.path(), 60, &|progress| {
            render_file(&at("m.oct"), &Outputs::of(&at("m.png")), &request, progress).map(|_| ())
        });
    }
}
