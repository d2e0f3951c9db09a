//! `synthetic:NAME@N?key=value` is an input like a file. Would break: a command that looks for a file of that name, a
//! body whose samples hang on how they are read, a wrong word that is not told, a volume that is held in memory.

use crate::prelude::*;

#[test]
fn a_body_builds_as_its_samples_in_a_file_do() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let input = "synthetic:torus@48?noise=0.05,bits=12,spacing=0.5x0.5x1.5,slab=1";
    let volume = analytic(input).unwrap();
    let dims = volume.dims();
    assert_eq!(dims.to_array(), [48, 48, 16]);
    let mut samples = Vec::new();
    for z in 0..dims.nz() {
        let mut slice = vec![0; 48 * 48 * 2];
        volume.read_rows(z, 0..48, 0..48, &mut slice).unwrap();
        Endian::Little.to_native(2, &mut slice);
        samples.append(&mut slice);
    }
    fs::write(at("torus.raw"), samples).unwrap();
    let built = oct(&["build", input, "-o", &at("a.oct"), "--iso", "0.5", "--json"]).json();
    let raw = ["--dims", "48x48x16", "--dtype", "u16", "--spacing", "0.5x0.5x1.5", "--iso", "2048"];
    let (samples, model) = (at("torus.raw"), at("b.oct"));
    let from_file = oct(&[&["build", &samples, "-o", &model, "--json"][..], &raw].concat()).json();
    for key in ["dims", "spacing_mm", "skin_voxels", "nodes", "dtype"] {
        assert_eq!(built[key], from_file[key], "{key}");
    }
    // The level 1/2 is the stored 2048, so structure and normals are the same bytes.
    let (a, b) = (fs::read(at("a.oct")).unwrap(), fs::read(at("b.oct")).unwrap());
    let model = Model::open(Path::new(&at("a.oct"))).unwrap();
    assert!(model.header().voxels > 1000);
    let same = a.iter().rev().zip(b.iter().rev()).take_while(|(a, b)| a == b).count();
    assert!(2 * same > a.len(), "{same} of {} bytes at the end agree", a.len());
    assert_eq!(oct(&["info", &at("a.oct"), "--json"]).json()["source"]["kind"], "torus");
}

#[test]
fn every_command_that_takes_a_volume_takes_a_body() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(&folder.path().join("out"));
    let listed = oct(&["scan", "synthetic:sphere@32", "synthetic:head@32", "--json"]).json();
    assert_eq!((&listed["usable"], &listed["refused"]), (&2.into(), &0.into()));
    assert_eq!(listed["items"][1]["dims"], serde_json::json!([32, 32, 32]));
    // Two alike are one; a body and the head are two models, and a second run has nothing to do.
    let inputs = ["synthetic:box@32?sample=binary", "synthetic:head@32", "synthetic:head@32"];
    let args = [&["batch", "--out", &out, "--json"][..], &inputs].concat();
    let report = oct(&args).json();
    assert_eq!((&report["converted"], &report["failed"]), (&2.into(), &0.into()), "{report}");
    assert_eq!(oct(&args).json()["skipped"], 2);
    assert_eq!(names(out.as_ref()).iter().filter(|name| name.ends_with(".oct")).count(), 2);
}

#[test]
fn wrong_words_are_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let (model, out) = (text(&folder.path().join("a.oct")), text(&folder.path().join("out")));
    for (input, words) in [
        ("synthetic:spere@64", &["no synthetic body 'spere'", "sphere", "menger", "head"][..]),
        ("synthetic:sphere", &["needs its size", "synthetic:NAME@N"]),
        ("synthetic:sphere@70000", &["'70000'", "65536"]),
        ("synthetic:sphere@64?tube=3", &["the sphere has no parameter 'tube'", "radius", "psf"]),
        ("synthetic:torus@64?noise=7", &["'7'", "'noise'", "from 0 to 1"]),
        ("synthetic:torus@64?sample=gray", &["one of density, binary"]),
        ("synthetic:torus@64?sample=binary,psf=1", &["'psf' is about grey levels"]),
        ("synthetic:torus@64?seed=1,seed=2", &["'seed' is given twice"]),
        ("synthetic:head@64?noise=1", &["the head has no parameters"]),
        ("synthetic:box@64?spacing=1x2", &["three numbers"]),
    ] {
        oct(&["build", input, "-o", &model]).refused(2, words);
        oct(&["scan", input]).refused(2, words);
        oct(&["batch", input, "--out", &out]).refused(2, words);
    }
    let raw = ["--dims", "8x8x8", "--dtype", "u8"];
    oct(&[&["build", "synthetic:sphere@8", "-o", &model][..], &raw].concat()).refused(2, &["--dims"]);
    assert!(names(folder.path()).iter().all(|name| !name.ends_with(".oct")));
    // A file of such a name is reached by its folder.
    let file = folder.path().join("synthetic:sphere@4");
    fs::write(&file, [9; 64]).unwrap();
    let args =
        ["build", &text(&file), "-o", &model, "--dims", "4x4x4", "--dtype", "u8", "--iso", "1", "--json"];
    assert_eq!(oct(&args).json()["skin_voxels"], 56);
}

#[test]
fn a_body_of_any_size_is_never_held() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.oct");
    // 32 MiB as samples.
    let input = "synthetic:sphere@512x512x64?psf=0,radius=25";
    // The program of the tests is larger than the one that is released, which does with 8 MiB.
    let extra = ["--iso", "0.5", "--memory", "10MiB", "--threads", "2"];
    let (report, peak) = measured_build(input.as_ref(), &output, &extra);
    assert!(report["peak_rss_bytes"].as_u64().unwrap() <= (10 + SYSTEM_MIB) << 20, "{report}");
    assert!(peak.is_none_or(|peak| peak <= (10 + SYSTEM_MIB) << 20), "{peak:?}");
}

#[test]
fn hits_lie_within_half_a_voxel_of_the_true_surface() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.oct");
    let volume = analytic("synthetic:sphere@64").unwrap();
    let options = BuildOptions { threshold: Threshold::Iso(0.5), ..skin_options() };
    infobyte::build(&volume, &options, &path).unwrap();
    let model = Model::open(&path).unwrap();
    let caster = RayCaster::new(&model).unwrap();
    let (mut squares, mut worst, mut count) = (0.0, 0.0_f64, 0.0);
    for i in 0..40 {
        for j in 0..40 {
            let origin = [10.0 + f64::from(i), 10.0 + f64::from(j), -50.0];
            let Some(hit) = caster.first_hit(origin, [0.05, 0.02, 1.0]).unwrap() else { continue };
            let truth = volume.surface_at(hit.position_mm);
            let cosine: f64 = (0..3).map(|a| hit.normal.unwrap()[a] * truth.normal[a]).sum();
            assert!(cosine > 0.999, "{hit:?} {truth:?}");
            (squares, worst, count) =
                (squares + truth.distance * truth.distance, worst.max(truth.distance.abs()), count + 1.0);
        }
    }
    let rms = (squares / count).sqrt();
    assert!(count > 1000.0 && (0.2..0.35).contains(&rms) && worst < 1.0, "{count} {rms} {worst}");
}
