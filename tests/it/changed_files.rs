//! What is read stays what it was, or nothing is made of it: a volume whose files change while a model is built of
//! them, a model that is overwritten or cut short while a picture is made of it. If this fails, a copy that was
//! still running ends up as a model of which half is of yesterday, with exit code 0.

use crate::prelude::*;
use std::fs::OpenOptions;
use std::process::Child;

use infobyte::builder::build_volume;

/// A raw volume with its header: a ball, x fastest.
fn ball(folder: &Path, side: u32) -> PathBuf {
    let middle = f64::from(side) / 2.0;
    write_raw(&folder.join("ball.raw"), [side; 3], |at| {
        let d = at.map(|c| (f64::from(c) - middle).powi(2)).iter().sum::<f64>().sqrt();
        [if d < middle * 0.8 { 200_u8 } else { 3 }]
    });
    let header = folder.join("ball.nhdr");
    let text = format!(
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: {side} {side} {side}\nencoding: raw\ndata file: ball.raw\n\n"
    );
    fs::write(&header, text).unwrap();
    header
}

/// Moves a file's time of change, as writing to it later would.
fn touch(path: &Path) {
    let later = std::time::SystemTime::now() + Duration::from_secs(2);
    OpenOptions::new().write(true).open(path).unwrap().set_modified(later).unwrap();
}

#[test]
fn a_volume_that_changes_during_the_build_makes_no_model() {
    type Change<'a> = &'a dyn Fn(&Path);
    let ways: [(&str, &str, Change<'_>); 5] = [
        ("overwritten in place", "ball.raw", &|path| {
            OpenOptions::new().write(true).open(path).unwrap().write_all_at(&[9; 64], 100).unwrap();
            touch(path);
        }),
        ("grown", "ball.raw", &|path| {
            let len = fs::metadata(path).unwrap().len();
            OpenOptions::new().write(true).open(path).unwrap().set_len(len + 1).unwrap();
        }),
        ("replaced", "ball.raw", &|path| {
            let other = path.with_extension("new");
            fs::copy(path, &other).unwrap();
            let time = fs::metadata(path).unwrap().modified().unwrap();
            OpenOptions::new().write(true).open(&other).unwrap().set_modified(time).unwrap();
            fs::rename(other, path).unwrap();
        }),
        ("the header overwritten", "ball.nhdr", &|path| touch(path)),
        ("removed", "ball.raw", &|path| fs::remove_file(path).unwrap()),
    ];
    let options = BuildOptions { threshold: Threshold::Iso(100.0), ..skin_options() };
    for (how, name, change) in ways {
        let folder = tempfile::tempdir().unwrap();
        let header = ball(folder.path(), 24);
        let output = folder.path().join("m.oct");
        let volume = infobyte::open(&header).unwrap();
        // Open descriptors go on reading a file that was replaced; that it was one counts.
        infobyte::build(&*volume, &options, &output).unwrap();
        fs::remove_file(&output).unwrap();
        change(&folder.path().join(name));
        let error = infobyte::build(&*volume, &options, &output).err().unwrap_or_else(|| panic!("{how}"));
        let told = error.to_string();
        assert!(told.contains(name) && told.contains("was changed or replaced"), "{how}: {told}");
        assert_eq!(error.kind(), ExitKind::Input, "{how}");
        assert!(!output.exists(), "{how}");
    }
}

/// Tells nobody how far a build is, and changes a file when its scan begins.
struct Meddler<'a>(&'a Path);

impl Progress for Meddler<'_> {
    fn stage(&self, name: &'static str, _: u64) {
        if name == "scan" {
            touch(self.0);
        }
    }

    fn advance(&self, _: u64) {}
}

#[test]
fn cells_and_meshes_notice_it_too() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("m.oct");
    let header = ball(folder.path(), 24);
    for surface in [SurfaceKind::Skin, SurfaceKind::Cells] {
        let options = BuildOptions {
            threshold: Threshold::Iso(100.0),
            surface: Some(surface),
            ..BuildOptions::default()
        };
        let volume = infobyte::open(&header).unwrap();
        let meddler = Meddler(&folder.path().join("ball.raw"));
        let told = build_volume(&*volume, &options, &output, &meddler).unwrap_err().to_string();
        assert!(told.contains("ball.raw: was changed or replaced"), "{surface:?}: {told}");
    }
    let mesh = folder.path().join("a.stl");
    fs::write(&mesh, meshes::Body::tetrahedron(9.0).stl_text()).unwrap();
    let options = on_grid(GridChoice::Side { voxels: 16, margin: 1 });
    let mesh_built = |progress: &dyn Progress| {
        build_mesh(std::slice::from_ref(&mesh), &options, &skin_options(), &output, progress)
    };
    let told = mesh_built(&Meddler(&mesh)).unwrap_err().to_string();
    assert!(told.contains("a.stl: was changed or replaced"), "{told}");
    assert!(!output.exists());
    mesh_built(&Silent).unwrap();
}

#[test]
fn a_file_that_grows_under_the_command_ends_it_without_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let (raw, output) = (folder.path().join("a.raw"), folder.path().join("m.oct"));
    // Long enough to be met at work on a busy machine; all but one row is a hole.
    let [nx, ny, nz] = [256_u64, 256, 4000];
    let file = File::create(&raw).unwrap();
    file.set_len(nx * ny * nz).unwrap();
    file.write_all_at(&[200; 256], 100 * nx * ny).unwrap();
    let layout = ["--dims", "256x256x4000", "--dtype", "u8", "--iso", "100", "--threads", "1", "--quiet"];
    let mut child = started(&[&["build", &text(&raw), "-o", &text(&output)], &layout[..]].concat());
    // An open file alone may not have been looked at yet: grown then, it has its new length from the beginning.
    wait_for(&mut child, |pid| {
        let read = fs::read_to_string(format!("/proc/{pid}/io")).unwrap_or_default();
        let bytes = read.lines().find_map(|line| line.strip_prefix("rchar: ")?.parse::<u64>().ok());
        bytes.is_some_and(|bytes| bytes > 4 << 20)
    });
    file.set_len(nx * ny * nz + 1).unwrap();
    let done = child.wait_with_output().unwrap();
    let told = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(3), "{told}");
    assert!(told.contains("a.raw: was changed or replaced while it was read"), "{told}");
    assert_eq!(names(folder.path()), ["a.raw"]);
}

/// Waits until a process is where it should be.
fn wait_for(child: &mut Child, is_there: impl Fn(u32) -> bool) {
    let started = Instant::now();
    while !is_there(child.id()) {
        assert!(child.try_wait().unwrap().is_none(), "it ended before");
        assert!(started.elapsed() < Duration::from_secs(60), "it does not get there");
        sleep(Duration::from_millis(1));
    }
}

fn model_of(folder: &Path) -> PathBuf {
    let header = ball(folder, 96);
    let model = folder.join("m.oct");
    let run = oct(&["build", &text(&header), "-o", &text(&model), "--iso", "100"]);
    assert_eq!(run.code, 0, "{run:?}");
    model
}

/// Runs a command on a model, does something to the model once it is mapped, and gives back what was said.
fn disturbed(model: &Path, args: &[&str], disturb: &dyn Fn(&Path)) -> (Option<i32>, String) {
    let mut child = started(args);
    let real = text(&model.canonicalize().unwrap());
    wait_for(&mut child, |pid| {
        fs::read_to_string(format!("/proc/{pid}/maps")).is_ok_and(|maps| maps.contains(&real))
    });
    disturb(model);
    let done = child.wait_with_output().unwrap();
    (done.status.code(), String::from_utf8_lossy(&done.stderr).into_owned())
}

/// Long enough that the model is disturbed in the middle of them.
fn long_commands<'a>(model: &'a str, picture: &'a str) -> [Vec<&'a str>; 3] {
    [
        vec!["render", model, "-o", picture, "--size", "1600x1600", "--threads", "2"],
        vec!["thumbnail", model, "-o", picture, "--size", "1024", "--threads", "2"],
        vec!["selfcheck", model, "--rays", "100000"],
    ]
}

#[test]
fn a_model_that_is_cut_short_ends_the_command_with_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let whole = model_of(folder.path());
    let (cut, picture) = (folder.path().join("cut.oct"), folder.path().join("p.png"));
    let (cut_text, picture_text) = (text(&cut), text(&picture));
    for args in long_commands(&cut_text, &picture_text) {
        fs::copy(&whole, &cut).unwrap();
        let disturb = |path: &Path| OpenOptions::new().write(true).open(path).unwrap().set_len(0).unwrap();
        let (code, told) = disturbed(&cut, &args, &disturb);
        assert_eq!(code, Some(3), "{args:?}: {told}");
        assert_eq!(told.lines().count(), 1, "{told}");
        assert!(told.starts_with("oct: ") && told.contains("cut.oct"), "{told}");
        assert!(!picture.exists());
        assert!(!names(folder.path()).iter().any(|name| name.starts_with('.')), "{:?}", names(folder.path()));
    }
}

#[test]
fn a_model_that_is_overwritten_makes_no_picture_and_one_that_is_replaced_does() {
    let folder = tempfile::tempdir().unwrap();
    let whole = model_of(folder.path());
    let (other, picture) = (folder.path().join("other.oct"), folder.path().join("p.png"));
    let (other_text, picture_text) = (text(&other), text(&picture));
    for args in long_commands(&other_text, &picture_text) {
        fs::copy(&whole, &other).unwrap();
        let overwrite = |path: &Path| {
            let bytes = fs::read(path).unwrap();
            OpenOptions::new().write(true).open(path).unwrap().write_all_at(&bytes, 0).unwrap();
            touch(path);
        };
        let (code, told) = disturbed(&other, &args, &overwrite);
        assert_eq!(code, Some(3), "{args:?}: {told}");
        assert!(told.contains("other.oct: was changed while it was in use"), "{told}");
        assert!(!picture.exists());
    }
    // Every output of this program replaces: the picture is that of the old model, whole.
    let args = &long_commands(&other_text, &picture_text)[1];
    let replace = |path: &Path| {
        fs::write(folder.path().join("new"), "another").unwrap();
        fs::rename(folder.path().join("new"), path).unwrap();
    };
    fs::copy(&whole, &other).unwrap();
    assert_eq!(disturbed(&other, args, &replace).0, Some(0));
    assert!(picture.exists());
}

/// A model of more than 1 MiB, which is mapped: every second voxel or so is inside.
fn large_model(folder: &Path) -> PathBuf {
    let (raw, model) = (folder.join("noise.raw"), folder.join("large.oct"));
    let mut random = Random(7);
    write_raw(&raw, [96; 3], |_| [u8::try_from(random.below(2)).unwrap()]);
    let run = oct(&[
        "build",
        &text(&raw),
        "-o",
        &text(&model),
        "--dims",
        "96x96x96",
        "--dtype",
        "u8",
        "--iso",
        "1",
        "--channels",
        "normal,value",
    ]);
    assert_eq!(run.code, 0, "{run:?}");
    assert!(fs::metadata(&model).unwrap().len() > 1 << 20);
    model
}

#[test]
fn a_program_that_uses_the_library_is_told_that_its_model_was_changed() {
    let folder = tempfile::tempdir().unwrap();
    let request = RenderRequest { size: Some([40; 2]), ..Default::default() };
    let path = large_model(folder.path());
    let model = Model::open(&path).unwrap();
    let caster = RayCaster::new(&model).unwrap();
    let (origins, directions) = ([[48.0, 48.0, -9.0]; 3], [[0.0, 0.0, 1.0]; 3]);
    let (mut hits, mut met) = (infobyte::Hits::default(), [false; 3]);
    caster.first_hits(&origins, &directions, &mut hits).unwrap();
    assert_eq!(hits.len(), 3);
    OpenOptions::new().write(true).open(&path).unwrap().write_all_at(&[9; 64], 100_000).unwrap();
    touch(&path);
    let told: [infobyte::Error; 5] = [
        infobyte::render(&model, &request).unwrap_err(),
        infobyte::triangles(&model, &Silent).unwrap_err(),
        RayCaster::new(&model).unwrap_err().into(),
        caster.first_hits(&origins, &directions, &mut hits).unwrap_err().into(),
        caster.any_hit(&origins, &directions, 99.0, &mut met).unwrap_err().into(),
    ];
    for error in told {
        let sentence = error.to_string();
        assert!(sentence.contains("large.oct: was changed while it was in use"), "{sentence}");
        assert_eq!(error.kind(), ExitKind::Input);
    }
    assert!(hits.is_empty());
    // Replaced under its name it is the old one still, and a small one is in memory.
    let replaced = Model::open(&path).unwrap();
    fs::rename(&path, folder.path().join("other")).unwrap();
    infobyte::render(&replaced, &request).unwrap();
    let path = model_of(folder.path());
    let small = Model::open(&path).unwrap();
    OpenOptions::new().write(true).open(&path).unwrap().set_len(0).unwrap();
    infobyte::render(&small, &request).unwrap();
}
