//! Whatever a user types, hands in, unplugs or kills: the command says in one sentence what is wrong and
//! what to do, with the exit code of its kind, and leaves the folder as it was. If this fails, a batch over
//! night stops without a reason, or replaces a good model with half of one.

use crate::prelude::*;

const OLD: &[u8] = b"the model of yesterday";

/// Inputs on one side, and on the other a folder that holds an old model and must not change.
struct Stage {
    folder: TempDir,
}

impl Stage {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("out")).unwrap();
        let stage = Self { folder };
        fs::write(stage.output(), OLD).unwrap();
        stage
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn output(&self) -> PathBuf {
        self.path("out/m.oct")
    }

    fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }

    /// A file of zeros that takes no space.
    fn zeros(&self, name: &str, len: u64) -> PathBuf {
        let path = self.path(name);
        fs::File::create(&path).unwrap().set_len(len).unwrap();
        path
    }

    /// `oct build INPUT -o out/m.oct EXTRA`.
    fn build(&self, input: &Path, extra: &[&str]) -> Run {
        command::build(&[input], &self.output(), extra)
    }

    /// The folder of the output holds the old model and nothing else.
    fn untouched(&self) {
        assert_eq!(names(&self.path("out")), ["m.oct"]);
        assert_eq!(fs::read(self.output()).unwrap(), OLD);
    }

    fn refused(&self, input: &Path, extra: &[&str], code: i32, words: &[&str]) {
        self.build(input, extra).refused(code, words);
        self.untouched();
        // The same with JSON asked for: the sentence stays on stderr, and is in the object, too.
        self.build(input, &[extra, &["--json"]].concat()).refused(code, words);
        self.untouched();
    }
}

/// A sound model of a small ball.
fn model(folder: &Path) -> PathBuf {
    let (raw, path) = (folder.join("ball.raw"), folder.join("ball.oct"));
    write_raw(&raw, [20; 3], |at| {
        let [x, y, z] = at.map(u32::cast_signed);
        let d = (x - 9).pow(2) + (y - 10).pow(2) + (z - 8).pow(2);
        [u8::try_from((160 - d).clamp(0, 255)).unwrap()]
    });
    let run = command::build(&[raw], &path, &["--dims", "20x20x20", "--dtype", "u8", "--iso", "100"]);
    assert_eq!(run.code, 0, "{run:?}");
    path
}

#[test]
fn files_that_do_not_fit_their_description_are_refused() {
    let stage = Stage::new();
    let raw = ["--dims", "4x5x6", "--dtype", "u16", "--iso", "1"];
    for (name, len, words) in [
        ("short.raw", 239, ["has 239 bytes", "240"]),
        ("long.raw", 241, ["has 241 bytes", "240"]),
        ("none.raw", 0, ["has 0 bytes", "240"]),
    ] {
        let file = stage.file(name, &vec![7; len]);
        stage.refused(&file, &raw, 3, &[name, words[0], words[1], "check --dims"]);
    }
    stage.refused(&stage.path("missing.raw"), &raw, 3, &["missing.raw", "check that it exists"]);
    stage.refused(&stage.path("missing"), &[], 3, &["missing", "check that it exists"]);

    for slice in 0..6 {
        stage.file(&format!("uneven/{slice}"), &vec![7; if slice == 4 { 38 } else { 40 }]);
        stage.file(&format!("few/{slice}"), &[7; 40]);
    }
    stage.refused(&stage.path("uneven"), &raw, 3, &["uneven/4", "has 38 bytes", "40", "check --dims"]);
    let more = ["--dims", "4x5x7", "--dtype", "u16", "--iso", "1"];
    stage.refused(&stage.path("few"), &more, 3, &["few", "6 slice files", "needs 7", "check --dims"]);
}

#[test]
fn folders_and_files_without_images_are_refused() {
    let stage = Stage::new();
    fs::create_dir(stage.path("empty")).unwrap();
    stage.file("texts/readme.txt", b"no image here");
    stage.file("texts/data.bin", &[9; 3000]);
    stage.refused(&stage.path("empty"), &[], 3, &["empty", "holds no file"]);
    stage.refused(
        &stage.path("empty"),
        &["--dims", "4x4x4", "--dtype", "u8"],
        3,
        &["empty", "holds no file"],
    );
    stage.refused(&stage.path("texts"), &[], 3, &["texts"]);
    let model = model(stage.folder.path());
    stage.refused(&model, &[], 3, &["ball.oct", "an .oct model"]);
    // A side-car that was meant to help is what has to be corrected.
    let raw = stage.file("a.raw", &[7; 8]);
    for (name, told, words) in [
        ("a.json", "{\"dims\": [2, 2, 2], \"dtyp\": \"u8\"}", ["a.json", "without the key dtype"]),
        ("a.json", "{\"dims\": [2, 2, 2], \"dtype\": \"u8\",}", ["a.json", "cannot be parsed"]),
        ("a.raw.json", "{\"dims\": [2, 2, 2], \"dtype\": \"u9\"}", ["a.raw.json", "dtype `u9` is not known"]),
    ] {
        let beside = stage.file(name, told.as_bytes());
        stage.refused(&raw, &[], 3, &words);
        fs::remove_file(beside).unwrap();
    }
    let broken = stage.file("a.dcm", &[0; 500]);
    stage.refused(&broken, &[], 3, &["a.dcm", "not DICOM"]);
}

#[test]
fn a_range_without_voxels_is_refused_with_the_values_there_are() {
    let stage = Stage::new();
    let ramp: Vec<u8> = (0..120).map(|i| 3 + i % 5).collect();
    let file = stage.file("ramp.raw", &ramp);
    let raw = ["--dims", "4x5x6", "--dtype", "u8"];
    for range in [["--iso", "8"], ["--iso", "1e9"], ["--range", "0..2.5"], ["--range", "-9..-1"]] {
        let words = ["ramp.raw", "from 3 to 7", "choose --iso or --range"];
        stage.refused(&file, &[&raw[..], &range].concat(), 3, &words);
    }
    let flat = stage.file("flat.raw", &[5; 120]);
    stage.refused(&flat, &raw, 3, &["flat.raw", "from 5 to 5", "choose --iso or --range"]);

    let nan: Vec<u8> = std::iter::repeat_n(f32::NAN.to_le_bytes(), 120).flatten().collect();
    let file = stage.file("nan.raw", &nan);
    for extra in [&["--iso", "0"][..], &["--range", "-5..5"], &[]] {
        let args = [&["--dims", "4x5x6", "--dtype", "f32"], extra].concat();
        stage.refused(&file, &args, 3, &["nan.raw", "no finite value", "check --dtype"]);
    }
}

#[test]
fn wrong_usage_is_one_sentence_and_exit_code_2() {
    let stage = Stage::new();
    let file = stage.file("v.raw", &[7; 240]);
    let raw = ["--dims", "4x5x6", "--dtype", "u16"];
    for (extra, words) in [
        (&["--dims", "0x5x6", "--dtype", "u16"][..], &["0x5x6", "each 1 to 65536"][..]),
        (&["--dims", "0", "--dtype", "u16"], &["'0'", "512x512x300"]),
        (&["--dims", "4x5", "--dtype", "u16"], &["4x5", "512x512x300"]),
        (&["--dims", "65537x1x1", "--dtype", "u16"], &["65537", "each 1 to 65536"]),
        (&["--dims", "4x5x6"], &["--dtype"]),
        (&["--dtype", "u16"], &["--dims"]),
        (&["--spacing", "1x1x1"], &["--dims"]),
        (&["--dims", "4x5x6", "--dtype", "u12"], &["u12", "for example u16"]),
        (&["--iso", "1", "--otsu"], &["--iso", "--otsu"]),
        (&["--iso", "1", "--range", "1..2"], &["--iso", "--range"]),
        (&["--range", "5..1"], &["5..1", "lower value first"]),
        (&["--range", "5"], &["'5'", "for example"]),
        (&["--iso", "high"], &["high", "finite number"]),
        (&["--threads", "0"], &["'0'", "choose 1 to 1024"]),
        (&["--memory", "lots"], &["lots", "for example 8MiB"]),
        (&["--memory", "0"], &["'0'"]),
        (&["--channels", "smell"], &["smell", "choose from"]),
        (&["--channels", "colour"], &["colour", "choose from"]),
        // Meshes have colours, volumes do not.
        (
            &["--dims", "4x5x6", "--dtype", "u16", "--iso", "1", "--channels", "color"],
            &["color", "leave it out"],
        ),
        (&["--connectivity", "18"], &["18", "26 or 6"]),
        (&["--lod", "maybe"], &["maybe", "on, off"]),
        (&["--colour"], &["--colour"]),
        (&[], &["v.raw", "--dims", "--dtype"]),
    ] {
        stage.refused(&file, extra, 2, words);
    }
    let (input, output) = (text(&file), text(&stage.output()));
    let skip = "18446744073709551615";
    stage.refused(&file, &[&raw[..], &["--skip", skip]].concat(), 2, &["v.raw", "--skip"]);
    let folder = text(&stage.path("out"));
    for (args, words) in [
        (&["build", "-o", &output][..], &["INPUT"][..]),
        (&["build", &input], &["--output"]),
        (&["build", &input, &folder, "-o", &output, "--dims", "4x5x2", "--dtype", "u16"], &["folder"]),
        (&["bulid", &input, "-o", &output], &["bulid", "did you mean 'build'", "`oct --help`"]),
        (
            &["build", &input, "-o", &output, "--treads", "1"],
            &["did you mean '--threads'", "`oct build --help`"],
        ),
        (&["build", "a.stl", "-o", &output, "--grid", "8", "--margin", "-1"], &["'-1'", "0 to 65535"]),
        (&["build", &input, "-o", &output, "--skip", "-1"], &["'-1'", "0 or more"]),
        (&["build", &input, "-o", &output, "--drop-below", "-5"], &["'-5'", "number of voxels"]),
        (&["build", "a.csg", "b.csg", "-o", &output], &["built by itself", "union()"]),
        (&["build", "a.csg", "-o", &output, "--iso", "3"], &["--iso is for volumes, and"]),
        (&["selfcheck", &input, "--rays", "0"], &["--rays"]),
        (&["render", &input, "-o", &output, "--eye", "1,2,3"], &["--look-at"]),
        (&["render", &input, "-o", &output, "--view", "front", "--eye", "1,2,3"], &["--view", "--eye"]),
        (&["render", &input, "-o", &output, "--size", "0x5"], &["0x5", "1 to 32768"]),
        (&["render", &input, "-o", &output, "--size", "0"], &["'0'", "512 for a square"]),
        (&["render", &input, "-o", &output, "--size", "-4"], &["'-4'", "512 for a square"]),
        (&["render", &input, "-o", &output, "--size", "--force"], &["--size", "value is required"]),
        (&["render", &input, "-o", &output, "--threads", "-1"], &["'-1'", "--threads"]),
        (&["render", &input, "-o", &output, "--samples", "-3"], &["'-3'", "--samples"]),
        (&["build", &input, "-o", &output, "--memory", "-4MiB"], &["'-4MiB'", "--memory"]),
        (&["build", &input, "-o", &output, "--spacing", "-1x1x1"], &["'-1x1x1'", "mm"]),
        (&["render", &input, "-o", &output, "--fov", "180"], &["180", "170 degrees"]),
        (&["render", &input, "-o", &output, "--view", "inside"], &["inside", "front"]),
        (&["render", &input, "-o", &output, "--zoom", "0"], &["'0'", "0.01 to 1000"]),
        (
            &["render", &input, "-o", &output, "--clip", "z=..4mm"],
            &["'4mm'", "write the number alone, in mm;"],
        ),
        (&["render", &input, "-o", &output, "--fov", "30deg"], &["write the number alone, in degrees;"]),
        (&["compare", &input, &input, "--tolerance", "0.2 mm"], &["write the number alone, in mm;"]),
        (&["build", &input, "-o", &output, "--iso", "300HU"], &["'300HU'", "write the number alone;"]),
        (&["build", &input, "-o", &output, "--range", "1..2HU"], &["write the number alone;"]),
        (&["build", &input, "-o", &output, "--spacing", "1x1x2um"], &["write the number alone, in mm;"]),
        (&["render", &input, "-o", &output, "--color", "reddish"], &["'reddish'", "#rrggbb"]),
        (&["measure", &input], &["did you mean 'info'"]),
        (&["build", &input, "-o", &output, "--resolution", "9"], &["did you mean '--grid'"]),
        (&["build", &input, "-o", &output, "--tresh", "9"], &["did you mean '--iso'"]),
        (&["render", &input, "-o", &output, "--resolution", "9"], &["did you mean '--size'"]),
        (&["render", &input, "-o", &output, "--widht", "9"], &["did you mean '--size'"]),
        (&["batch", &input, "--output", &output], &["did you mean '--out'"]),
        (
            &["view", &input, "--width", "9"],
            &["--size is an option of `oct render`, `oct thumbnail` and `oct demo`;"],
        ),
        (
            &["view", &input, "--annotate"],
            &["'--annotate'", "--annotate is an option of `oct render`; see `oct view"],
        ),
        (
            &["view", &input, "--memry", "9"],
            &["--memory is an option of `oct build`, `oct batch` and others"],
        ),
        (&["render", &input, "-o", &output, "--clip", "z=5..2"], &["'z=5..2'", "z=..40"]),
        (&["render", &input, "-o", &output, "--section", "z=0", "--contact"], &["--section", "--contact"]),
        (&["render", &input, "-o", &output, "--fov", "20"], &["--fov", "--projection perspective"]),
        (&["thumbnail", &input, "-o", &output, "--size", "0"], &["'0'", "1 to 16384"]),
        (&["demo", "-o", &output, "--size", "0"], &["'0'", "1 to 16384"]),
        (&["help", "build", "render"], &["one command at a time", "`oct help build`"]),
        (&["info"], &["MODEL.oct"]),
        (&["pack", &input], &["--output"]),
    ] {
        oct(args).refused(2, words);
        stage.untouched();
    }
}

#[test]
fn outputs_that_cannot_be_written_are_refused() {
    let stage = Stage::new();
    let file = stage.file("v.raw", &[7; 120]);
    let input = text(&file);
    let build = |output: &Path, extra: &[&str]| {
        let output = text(output);
        let all = ["build", &input, "-o", &output, "--dims", "4x5x6", "--dtype", "u8", "--iso", "1"];
        oct(&[&all, extra].concat())
    };
    build(&file, &["--force"]).refused(2, &["v.raw", "is the input", "--output"]);
    build(&stage.path("nowhere/m.oct"), &[]).refused(5, &["nowhere/m.oct", "folder does not exist"]);
    build(&stage.path("out"), &[]).refused(5, &["out", "not a regular file", "name a file"]);
    build(&stage.path("v.raw/m.oct"), &[]).refused(5, &["v.raw/m.oct", "cannot be written"]);
    // Nobody, root included, can make a file there.
    build(Path::new("/proc/m.oct"), &[]).refused(5, &["/proc/m.oct", "cannot be written"]);
    let nowhere = text(&stage.path("nowhere"));
    build(&stage.output(), &["--scratch", &nowhere]).refused(5, &["nowhere", "--scratch"]);
    stage.untouched();
    assert!(!stage.path("nowhere").exists());
    assert_eq!(fs::read(&file).unwrap(), [7; 120]);

    let model = text(&model(stage.folder.path()));
    let missing = text(&stage.path("nowhere/m.png"));
    for command in ["render", "thumbnail", "pack", "unpack"] {
        if command == "unpack" {
            let packed = text(&stage.path("ball.opk"));
            assert_eq!(oct(&["pack", &model, "-o", &packed]).code, 0);
            oct(&[command, &packed, "-o", &missing, "--force"])
                .refused(5, &["nowhere/m.png", "folder does not exist"]);
        } else {
            oct(&[command, &model, "-o", &missing, "--force"])
                .refused(5, &["nowhere/m.png", "folder does not exist"]);
        }
    }
    // Cells take more than 8 MiB in a program that is not optimised.
    oct(&["demo", "--size", "8", "-o", &missing, "--force", "--memory", "16MiB"])
        .refused(2, &["nowhere/m.png", "name another file"]);
    let missing = text(&stage.path("nowhere/m.oct"));
    oct(&["demo", "--size", "8", "-o", &missing, "--memory", "16MiB"])
        .refused(5, &["nowhere/m.oct", "folder does not exist"]);
    oct(&["render", &model, "-o", &model, "--force"]).refused(2, &["is the model", "name another file"]);
    oct(&["thumbnail", &model, "-o", &model, "--force"]).refused(2, &["is the model", "name another file"]);
}

/// Modes of folders do not exist on Windows.
#[cfg(unix)]
#[test]
fn a_folder_without_write_permission_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let stage = Stage::new();
    let file = stage.file("v.raw", &[7; 120]);
    fs::set_permissions(stage.path("out"), fs::Permissions::from_mode(0o555)).unwrap();
    if fs::write(stage.path("out/probe"), b"").is_ok() {
        println!("skipped: this user may write into any folder");
        return;
    }
    let raw = ["--dims", "4x5x6", "--dtype", "u8", "--iso", "1"];
    stage.refused(&file, &raw, 5, &["m.oct", "may not write"]);
    fs::set_permissions(stage.path("out"), fs::Permissions::from_mode(0o755)).unwrap();
}

/// A solid of 300^3: a skin of half a million voxels from a file that takes no space.
const SOLID: [&str; 6] = ["--dims", "300x300x300", "--dtype", "u8", "--iso", "0"];

#[test]
fn a_file_size_limit_stops_output_or_scratch_with_a_sentence() {
    let stage = Stage::new();
    let file = text(&stage.zeros("solid.raw", 27_000_000));
    fs::create_dir(stage.path("scratch")).unwrap();
    let (output, scratch) = (text(&stage.output()), text(&stage.path("scratch")));
    let build = r#"ulimit -f "$1"; shift; exec "$OCT" build "$@""#;
    let with = |blocks: &'static str| {
        let head = [blocks, &file, "-o", &output, "--scratch", &scratch, "--threads", "1"];
        shell(build, &[&head[..], &SOLID].concat())
    };
    // Blocks are of 512 bytes: the model has some 1.4 MB, the scratch file compresses well.
    with("2000").refused(5, &["m.oct", "cannot be written", "free space"]);
    stage.untouched();
    with("90").refused(5, &["scratch", "--scratch"]);
    stage.untouched();
    with("1").refused(5, &["scratch", "--scratch"]);
    stage.untouched();
    assert_eq!(names(&stage.path("scratch")), [""; 0]);
    assert_eq!(with("4000").code, 0);
}

#[test]
fn a_full_or_read_only_disk_stops_output_or_scratch_with_a_sentence() {
    let stage = Stage::new();
    let file = text(&stage.zeros("solid.raw", 27_000_000));
    fs::create_dir(stage.path("disk")).unwrap();
    let disk = text(&stage.path("disk"));
    // A mount of this test alone, gone with the shell. After the build: what the disk holds.
    let mounted = r#"
        for how in "-m" "-rm"; do unshare $how sh -c 'mount -t tmpfs none "$0"' "$1" 2>/dev/null && ok=$how; done
        [ -n "$ok" ] || exit 77
        exec unshare $ok sh -c '
            disk=$1; options=$2; shift 2
            mount -t tmpfs -o size=512k none "$disk" && echo old > "$disk/m.oct" || exit 77
            mount -o remount,size=512k,$options none "$disk" || exit 77
            "$OCT" build "$@"; code=$?
            [ "$(ls -A "$disk")" = m.oct ] && [ "$(cat "$disk/m.oct")" = old ] || exit 99
            exit $code' sh "$@""#;
    let on_disk = text(&stage.path("disk/m.oct"));
    let elsewhere = text(&stage.path("out"));
    // A noisy volume fills the scratch file, a solid one the output.
    let mut random = Random(1);
    let noise: Vec<u8> = (0..96 * 96 * 96).map(|_| random.byte()).collect();
    let noise = text(&stage.file("noise.raw", &noise));
    let noisy = ["--dims", "96x96x96", "--dtype", "u8", "--iso", "128"];
    let output = text(&stage.output());
    let cases = [
        ("rw", [&["-o", &on_disk, &file, "--scratch", &elsewhere][..], &SOLID].concat(), "cannot be written"),
        ("rw", [&["-o", &output, &noise, "--scratch", &disk][..], &noisy].concat(), "--scratch"),
        (
            "ro",
            [&["-o", &on_disk, &noise, "--scratch", &elsewhere][..], &noisy].concat(),
            "cannot be written",
        ),
        ("ro", [&["-o", &output, &noise, "--scratch", &disk][..], &noisy].concat(), "--scratch"),
    ];
    for (options, args, word) in cases {
        let head = [&disk[..], options];
        let run = shell(mounted, &[&head[..], &args].concat());
        if run.code == 77 {
            println!("skipped: nothing can be mounted here");
            return;
        }
        run.refused(5, &["disk", word]);
        stage.untouched();
    }
}

#[test]
fn a_killed_build_leaves_the_old_model_and_nothing_else() {
    for (signal, number) in [("INT", 2), ("KILL", 9), ("TERM", 15)] {
        for wait_ms in [20, 200, 500] {
            let stage = Stage::new();
            // Where the tests run in the background, INT is ignored, and children inherit that.
            let mut child = Command::new("env")
                .arg("--default-signal=INT")
                .arg(binary())
                .args(["demo", "--size", "900", "--quiet", "--threads", "2", "--memory", "64MiB", "-o"])
                .arg(stage.output())
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .spawn()
                .unwrap();
            sleep(Duration::from_millis(wait_ms));
            let pid = child.id().to_string();
            let killed = Command::new("sh").args(["-c", "kill -s $0 $1", signal, &pid]).status().unwrap();
            assert!(killed.success());
            let status = child.wait().unwrap();
            assert_eq!(status.signal(), Some(number), "the build was over after {wait_ms} ms: {status}");
            stage.untouched();
        }
    }
}

#[test]
fn files_that_are_no_models_are_refused_by_every_command() {
    let stage = Stage::new();
    let sound = fs::read(model(stage.folder.path())).unwrap();
    let mut random = Random(7);
    let noise: Vec<u8> = (0..5000).map(|_| random.byte()).collect();
    let mut longer = sound.clone();
    longer.push(0);
    let mut newer = sound.clone();
    newer[8] = 2;
    let foreign = "not an infobyte .oct";
    let mut cases: Vec<(String, Vec<u8>, &str)> = vec![
        ("foreign.oct".into(), b"Octave-1-L text of another program".to_vec(), foreign),
        ("empty.oct".into(), Vec::new(), foreign),
        ("zeros.oct".into(), vec![0; 4096], foreign),
        ("noise.oct".into(), noise.clone(), foreign),
        ("magic.oct".into(), [&sound[..8], &noise].concat(), "checksum of the header"),
        ("header.oct".into(), [&sound[..64], &noise].concat(), ""),
        ("longer.oct".into(), longer, ""),
        ("newer.oct".into(), newer, ""),
        ("bare.oct".into(), sound[..8].to_vec(), "cut short"),
    ];
    for len in [1, 7, 40, 63, 64, 200, sound.len() / 2, sound.len() - 1] {
        cases.push((format!("cut{len}.oct"), sound[..len].to_vec(), ""));
    }
    let output = text(&stage.output());
    let commands = [
        &["info"][..],
        &["verify"],
        &["selfcheck"],
        &["render", "--force", "-o", &output],
        &["thumbnail", "--force", "-o", &output],
        &["pack", "-o", &output],
        &["unpack", "-o", &output],
    ];
    for (name, bytes, word) in &cases {
        let path = text(&stage.file(name, bytes));
        for command in commands {
            oct(&[command, &[&path]].concat()).refused(3, &[name, word]);
            stage.untouched();
        }
    }
    for name in ["scan.nrrd", "part.stl", "tree.csg", "head.raw", "bare"] {
        let path = text(&stage.file(name, &noise));
        for command in commands {
            let sentence = "is not a model; build it first, with `oct build INPUT -o MODEL.oct`";
            oct(&[command, &[&path]].concat()).refused(3, &[name, sentence]);
        }
    }
    fs::create_dir(stage.path("folder.oct")).unwrap();
    oct(&["render", &text(&stage.path("folder.oct")), "-o", &output, "--force"])
        .refused(3, &["a folder of slices becomes a model with `oct build INPUT -o MODEL.oct`"]);
    for name in ["folder.oct", "folder.oct/..", "missing.oct", "/dev/zero"] {
        let path = text(&stage.path(name));
        for command in commands {
            oct(&[command, &[&path]].concat()).refused(3, &[name]);
            stage.untouched();
        }
    }
    let (mapped, packed) = (text(&stage.path("ball.oct")), text(&stage.path("ball.opk")));
    assert_eq!(oct(&["pack", &mapped, "-o", &packed]).code, 0);
    oct(&["unpack", &mapped, "-o", &output]).refused(3, &["ball.oct"]);
    stage.untouched();
}

#[test]
fn a_reader_that_has_gone_away_is_no_failure() {
    let stage = Stage::new();
    let model = text(&model(stage.folder.path()));
    let raw = text(&stage.path("ball.raw"));
    let output = text(&stage.path("out/again.oct"));
    // The reader is gone before the command starts.
    let gone = r#"{ sleep 0.2; "$OCT" "$@"; echo "code $?" >&2; } | head -c0"#;
    let build = ["build", &raw, "-o", &output, "--dims", "20x20x20", "--dtype", "u8", "--json"];
    for args in [&["info", &model][..], &["info", "--json", &model], &["verify", &model], &["--help"], &build]
    {
        assert_eq!(shell(gone, args).stderr, "code 0\n", "{args:?}");
        let closed = shell(r#""$OCT" "$@" >&-"#, args);
        assert_eq!((closed.code, &closed.stderr[..]), (0, ""), "{args:?}");
    }
    // A full disk behind stdout is one.
    shell(r#"exec "$OCT" "$@" > /dev/full"#, &["info", &model]).refused(5, &["standard output"]);
    // Nobody to tell is not a reason to crash.
    assert_eq!(shell(r#"exec "$OCT" "$@" 2>&-"#, &["info", "nothing.oct"]).code, 3);
    assert_eq!(shell(r#"exec "$OCT" "$@" >&- 2>&-"#, &["info", &model]).code, 0);
}

#[test]
fn json_is_one_object_with_the_keys_of_the_contract() {
    let stage = Stage::new();
    let model = text(&model(stage.folder.path()));
    let raw = text(&stage.path("ball.raw"));
    let (output, picture) = (text(&stage.output()), text(&stage.path("p.png")));
    let raw = ["build", &raw, "-o", &output, "--dims", "20x20x20", "--dtype", "u8", "--json"];
    let statics = "dims spacing_mm grid levels dtype range skin_voxels nodes bytes bytes_per_skin_voxel \
                   structure_bytes channel_bytes input";
    let build = "output memory_budget_bytes memory_plan_bytes peak_rss_bytes scratch_bytes threads read_s \
                 build_s write_s wall_s";
    let info = "format_version affine channels encoding checksum";
    let render =
        "width height rays hits setup_s trace_s shade_s wall_s rays_per_s bytes_touched peak_rss_bytes";
    for (args, keys) in [
        (&raw[..], [statics, build]),
        (&["info", "--json", &model], [statics, info]),
        (&["render", "--json", &model, "-o", &picture, "--size", "40x30"], [render, ""]),
    ] {
        let run = oct(args);
        let report = run.json();
        assert_eq!((&run.stderr[..], run.stdout.matches('\n').count()), ("", 1), "{run:?}");
        for key in keys.iter().flat_map(|k| k.split_whitespace()) {
            assert!(report.get(key).is_some_and(|v| !v.is_null()), "{key} of {report}");
        }
        for key in keys[1].split_whitespace().filter(|k| k.ends_with("_s") || k.ends_with("_bytes")) {
            assert!(report[key].as_f64().is_some_and(|v| v >= 0.0), "{key} of {report}");
        }
    }
    let file_bytes = fs::metadata(&model).unwrap().len();
    let touched = oct(&["thumbnail", "--json", &model, "-o", &picture]).json()["bytes_touched"].as_u64();
    assert!(touched.is_some_and(|b| b > 0 && b < file_bytes + 4096), "{touched:?} of {file_bytes}");
    let report = oct(&["info", "--json", &model]).json();
    assert_eq!(report["dims"], serde_json::json!([20, 20, 20]));
    assert_eq!((report["grid"].as_u64(), report["levels"].as_u64()), (Some(32), Some(5)));
    assert_eq!(report["bytes"].as_u64(), Some(file_bytes));
    let verify = oct(&["verify", "--json", &model]).json();
    assert_eq!(verify["checksum"], report["checksum"]);
}

/// Opening a pipe waits until something is written into it, which may be never. Volumes, and what meshes and trees name,
/// are in `volumes::foreign`.
#[test]
fn pipes_are_refused_at_once_wherever_a_file_is_expected() {
    let stage = Stage::new();
    let pipe = |name: &str| {
        let path = stage.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
        text(&path)
    };
    let [model, scene, tree] = ["p.oct", "p.toml", "p.csg"].map(pipe);
    let of_scene = text(&stage.file("e/e.toml", b"[[model]]\nfile = \"e.oct\"\n"));
    pipe("e/e.oct");
    let (other, rest) = (text(&stage.path("x.oct")), text(&stage.path("x")));
    let commands: [&[&str]; 16] = [
        &["info", &model],
        &["verify", &model],
        &["pack", &model, "-o", &other],
        &["unpack", &model, "-o", &other],
        &["strip", &model, "-o", &other],
        &["export", &model, "-o", &other, "--as", "stl", "--force"],
        &["intersect", &model, &model],
        &["compare", &model, &model],
        &["pores", &model],
        &["render", &model, "-o", &other, "--force"],
        &["thumbnail", &model, "-o", &other, "--force"],
        &["selfcheck", &model],
        &["report", &model, "--out", &rest],
        &["render", &scene, "-o", &other, "--force"],
        &["build", &tree, "-o", &other],
        &["render", &of_scene, "-o", &other, "--force"],
    ];
    for args in commands {
        let (code, told) = within_a_minute(args);
        assert_eq!(code, Some(3), "{args:?}: {told}");
        let sentences = ["not a regular file", "neither a file", "a pipe, a socket or a device"];
        assert!(sentences.iter().any(|sentence| told.contains(sentence)), "{args:?}: {told}");
        assert!(!Path::new(&other).exists() && !Path::new(&rest).exists(), "{args:?}");
    }
}

/// The exit code of a command, and what it says on stderr.
fn within_a_minute(args: &[&str]) -> (Option<i32>, String) {
    let mut child = started(args);
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > Duration::from_secs(60) {
            child.kill().unwrap();
            panic!("{args:?} waits");
        }
        sleep(Duration::from_millis(5));
    }
    let done = child.wait_with_output().unwrap();
    (done.status.code(), String::from_utf8_lossy(&done.stderr).into_owned())
}

#[test]
fn an_option_that_changes_nothing_is_refused() {
    let stage = Stage::new();
    let raw = stage.zeros("v.raw", 27);
    let how = ["--dims", "3x3x3", "--dtype", "u8", "--iso", "1"];
    let cases: [(&[&str], &str); 5] = [
        (
            &["--gradient", "sobel", "--surface", "cells"],
            "--gradient is for skin voxels, and cells are built",
        ),
        (&["--gradient", "sobel", "--channels", "offset"], "--gradient is for skin voxels"),
        (&["--connectivity", "6", "--surface", "cells"], "--connectivity is for skin voxels"),
        (&["--component-connectivity", "26"], "--component-connectivity is for --keep-largest"),
        (&["--keep-thin"], "--keep-thin is for meshes"),
    ];
    for (extra, sentence) in cases {
        stage.refused(&raw, &[&how, extra].concat(), 2, &[sentence]);
    }
    let tree = stage.file("t.csg", b"sphere(3);");
    stage.refused(
        &tree,
        &["--grid", "9", "--keep-thin"],
        2,
        &["--keep-thin is for meshes, and the input is a tree"],
    );
    stage.refused(
        &tree,
        &["--grid", "9", "--gradient", "sobel"],
        2,
        &["holds no volume", "leave out --gradient"],
    );
    let mesh = stage.file("m.glb", &containers::glb(&json!({}), &[]));
    stage.refused(&mesh, &["--grid", "9", "--unit", "cm"], 2, &["--unit is for files without a unit"]);
    stage.refused(&mesh, &["--grid", "9", "--gradient", "sobel"], 2, &["--gradient is for volumes"]);
    let [model, picture] = [stage.output(), stage.path("p.png")].map(|path| text(&path));
    for (extra, with) in [
        (&["--fov", "40"][..], "--projection perspective"),
        (&["--ao-rays", "9", "--shading", "plain"], "--shading ao"),
        (&["--lod-bias", "1"], "--lod on"),
    ] {
        let run = oct(&[&["render", &model, "-o", &picture], extra].concat());
        run.refused(2, &[&format!("{} changes nothing without {with}", extra[0])]);
    }
}
