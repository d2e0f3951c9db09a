//! `oct render SCENE.toml`: what the text of a scene says is shown, and what cannot be is told with the key and the
//! cure. If this fails, a scene is shown otherwise than it is written, or a user is left with half a sentence.

use crate::prelude::*;

/// A folder with a ball, a cube and a ring.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, body) in
        [("ball", "sphere@32"), ("cube", "box@32?edges=26x26x26,turn=0x0x0"), ("ring", "torus@32")]
    {
        let path = text(&folder.path().join(format!("{name}.oct")));
        oct(&["build", &format!("synthetic:{body}"), "-o", &path, "--iso", "0.5", "--json"]).json();
    }
    folder
}

fn rendered(folder: &Path, scene: &str, extra: &[&str]) -> command::Run {
    let path = folder.join("scene.toml");
    fs::write(&path, scene).unwrap();
    let (scene, picture) = (text(&path), text(&folder.join("scene.png")));
    oct(&[&["render", &scene, "-o", &picture, "--json"], extra].concat())
}

/// The scene of the documentation's kind: instances, a mirror, glass, shadows, ambient occlusion.
const SCENE: &str = r##"
size = [80, 60]
background = "#406080"
samples = 2

[camera]
projection = "perspective"
eye = [-40, -160, 60]
look_at = [0, 0, 0]
fov = 30

[[light]]
kind = "point"
at = [-100, -150, 200]

[ambient]
rays = 8

[[model]]
file = "ball.oct"
material = "glass"
at = [18, -15, 0]

[[model]]
file = "./ball.oct"
material = "bone"
at = [-18, 0, 0]

[[model]]
file = "cube.oct"
material = "floor"
scale = [4, 4, 0.2]
at = [0, 0, -20]

[material.floor]
preset = "matt"
color = "#b0b8b0"
mirror = 0.4
"##;

#[test]
fn a_scene_is_shown_and_told_of() {
    let folder = folder();
    let report = rendered(folder.path(), SCENE, &["--threads", "2"]).json();
    let number = |key: &str| report[key].as_u64().unwrap_or_else(|| panic!("{key}: {report}"));
    assert_eq!((number("width"), number("height"), number("rays")), (80, 60, 80 * 60 * 5));
    // Two models are of one file, however it is named.
    assert_eq!((number("models"), number("files")), (3, 2));
    for key in ["hits", "shadow_rays", "mirrored_rays", "refracted_rays", "ambient_rays"] {
        assert!(number(key) > 1000, "{key}: {report}");
    }
    let picture = fs::read(folder.path().join("scene.png")).unwrap();
    rendered(folder.path(), SCENE, &["--threads", "1"]).json();
    assert_eq!(picture, fs::read(folder.path().join("scene.png")).unwrap());
    // The command line counts before the scene; layers are as of one model.
    let (depth, normals) = (text(&folder.path().join("d.png")), text(&folder.path().join("n.png")));
    let flags = ["--size", "20x10", "--view", "top", "--depth", &depth, "--normals", &normals];
    let other = rendered(folder.path(), SCENE, &flags).json();
    assert_eq!((other["width"].as_u64(), other["rays"].as_u64()), (Some(20), Some(1000)));
    let brightness = |path: &str| -> Vec<u8> {
        let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        bytes
    };
    assert!(brightness(&depth).iter().any(|b| *b > 0) && brightness(&normals).iter().any(|b| *b > 0));
}

#[test]
fn a_hundred_instances_share_one_file() {
    let folder = folder();
    let scene = |count: u32| -> Value {
        let models: String = (0..count)
            .map(|i| {
                format!("[[model]]\nfile = \"ring.oct\"\nmove = [{}, 0, {}]\n", i % 10 * 40, i / 10 * 40)
            })
            .collect();
        rendered(folder.path(), &models, &["--size", "64x64", "--threads", "1"]).json()
    };
    let (one, many) = (scene(1), scene(100));
    assert_eq!(
        (one["files"].as_u64(), many["files"].as_u64(), many["models"].as_u64()),
        (Some(1), Some(1), Some(100))
    );
    let touched = |report: &Value| report["bytes_touched"].as_u64().unwrap();
    assert!(touched(&many) <= 2 * touched(&one), "{one} {many}");
    assert!(many["hits"].as_u64().unwrap() > 500, "{many}");
}

#[test]
fn bad_scenes_are_refused_with_the_key_and_the_cure() {
    let folder = folder();
    let model = "[[model]]\nfile = \"ball.oct\"\n";
    for (scene, words) in [
        (String::new(), &["names no model", "[[model]]"][..]),
        ("[[model]".to_owned(), &["line 1"]),
        (format!("{model}colour = 3\n"), &["line 3", "colour", "SCENES.md"]),
        ("[[model]]\nmaterial = \"bone\"\n".to_owned(), &["line 1", "file"]),
        (format!("{model}material = \"wood\"\n"), &["[[model]] 1, material", "wood", "glass"]),
        (format!("{model}scale = 0\n"), &["[[model]] 1, scale", "without a volume"]),
        (format!("{model}scale = [1, nan, 1]\n"), &["[[model]] 1, scale", "out of range"]),
        (format!("{model}turn = [0, inf, 0]\n"), &["[[model]] 1, turn"]),
        (format!("{model}place = [[1,0,0,0],[1,0,0,0],[0,0,1,0]]\n"), &["place", "without a volume"]),
        (format!("{model}place = [[1,0,0,0],[0,1,0,0],[0,0,1,0]]\nmove = [1,2,3]\n"), &["move", "place"]),
        (format!("{model}at = [1,2,3]\nmove = [1,2,3]\n"), &["at", "move"]),
        (format!("{model}pivot = \"left\"\n"), &["pivot", "left", "middle"]),
        (format!("{model}clip.box = [[1,1,1],[0,2,2]]\n"), &["[[model]] 1, clip, box", "low corner"]),
        (format!("{model}clip.planes = [[0,0,0,1]]\n"), &["planes", "not a direction", "[0, 0, 1, 40]"]),
        (format!("size = [40000, 8]\n{model}"), &["size", "40000x8", "32768"]),
        (format!("{model}move = [1,5, 2, 3]\n"), &["line 3", "3 numbers belong here, not 4"]),
        (format!("size = [400, 300, 1]\n{model}"), &["line 1", "2 numbers belong here, not 3"]),
        (format!("{model}clip.planes = [[0,0,1,4,0]]\n"), &["line 3", "4 numbers belong here, not 5"]),
        (format!("{model}clip.box = [[0,0,0],[1,1,1],[2,2,2]]\n"), &["line 3", "2 lists belong here, not 3"]),
        (format!("{model}place = [[1,0,0,0],[0,1,0,0,9],[0,0,1,0]]\n"), &["line 3", "not 5"]),
        (format!("{model}scale = [1, 1, 1, 1]\n"), &["line 3", "scale"]),
        (format!("{model}[clip]\ncap = \"reddish\"\n"), &["[clip], cap", "reddish", "#rrggbb"]),
        (format!("background = \"#12345\"\n{model}"), &["background", "#12345"]),
        (format!("samples = 9\n{model}"), &["samples", "1 to 8"]),
        (format!("bounces = 65\n{model}"), &["bounces", "0 to 64"]),
        (format!("{model}[camera]\nview = \"above\"\n"), &["[camera], view", "above", "top"]),
        (format!("{model}[camera]\neye = [1,2,3]\n"), &["[camera], eye", "look_at"]),
        (
            format!("{model}[camera]\neye = [1,2,3]\nlook_at = [1,2,3]\n"),
            &["[camera]", "the eye is at the point"],
        ),
        (
            format!("{model}[camera]\neye = [1,2,3]\nlook_at = [1,2,9]\nup = [0,0,1]\n"),
            &["[camera]", "up direction"],
        ),
        (format!("{model}[camera]\neye = [1,2,nan]\nlook_at = [1,2,9]\n"), &["[camera]", "finite"]),
        (format!("{model}[camera]\nfov = 0\n"), &["[camera]", "field of view"]),
        (format!("{model}[camera]\nfov = 180\n"), &["[camera]", "field of view"]),
        (format!("{model}[camera]\nnear = -1\n"), &["[camera], near"]),
        (format!("{model}[[light]]\nkind = \"lamp\"\n"), &["line 4", "lamp", "directional"]),
        (format!("{model}[[light]]\nkind = \"point\"\n"), &["[[light]] 1, kind", "at"]),
        (
            format!("{model}[[light]]\nkind = \"directional\"\nfrom = [0,0,0]\n"),
            &["[[light]] 1, from", "length"],
        ),
        (format!("{model}[[light]]\nkind = \"head\"\nat = [0,0,0]\n"), &["[[light]] 1, at", "kind"]),
        (format!("{model}[material.a]\nmirror = 1.5\n"), &["[material.a], mirror", "0 to 1"]),
        (format!("{model}[material.a]\npreset = \"gold\"\n"), &["[material.a], preset", "gold"]),
        (format!("{model}[material.a]\nindex = 0\n"), &["[material.a], index"]),
        (format!("{model}[material.a]\nchannel = \"value\"\n"), &["[material.a], channel", "colors"]),
        (
            format!("{model}[material.a]\nchannel = \"material\"\ncolors = [[1.5, \"#ffffff\"]]\n"),
            &["[material.a], colors", "1.5 is not a label"],
        ),
        (format!("{model}[material.a]\ncolors = [[1, \"#ffffff\"]]\n"), &["[material.a], colors", "channel"]),
        (
            format!("{model}[material.a]\npreset = \"ct\"\ncolors = [[1, \"#ffffff\"], [1, \"#000000\"]]\n"),
            &["[material.a], colors", "rise"],
        ),
        (
            format!("{model}material = \"a\"\n[material.a]\nchannel = \"color\"\n"),
            &["[[model]] 1, material", "channel color"],
        ),
        (
            "[[model]]\nfile = \"nothing.oct\"\n".to_owned(),
            &["scene.toml", "[[model]] 1, file", "nothing.oct"],
        ),
        ("[[model]]\nfile = \"scene.toml\"\n".to_owned(), &["scene.toml"]),
    ] {
        let run = rendered(folder.path(), &scene, &[]);
        run.refused(3, words);
        assert!(run.stderr.contains("scene.toml"), "{run:?}");
    }
    // What the command line says wrongly is wrong usage.
    let good = format!("{model}[camera]\neye = [0,-90,0]\nlook_at = [0,0,0]\n");
    rendered(folder.path(), &good, &["--eye", "1,2,3", "--look-at", "1,2,3"]).refused(2, &["the eye"]);
    fs::write(folder.path().join("bytes.toml"), [0xff, 0xfe, 0, 1]).unwrap();
    let bytes = text(&folder.path().join("bytes.toml"));
    oct(&["render", &bytes, "-o", &text(&folder.path().join("p.png"))]).refused(3, &["bytes.toml", "UTF-8"]);
    // The model and the scene are never replaced.
    let scene = text(&folder.path().join("scene.toml"));
    oct(&["render", &scene, "-o", &text(&folder.path().join("ball.oct")), "--force"])
        .refused(2, &["ball.oct"]);
    oct(&["render", &scene, "-o", &scene, "--force"]).refused(2, &["scene.toml"]);
}

/// A volume of two values, each with its colour; by the preset it is as bone is.
#[test]
fn colours_come_from_what_the_volume_holds() {
    let folder = tempfile::tempdir().unwrap();
    // Soft below, hard above.
    let raw: Vec<u8> = (0..16_u32 * 16 * 16)
        .map(|i| [i % 16, i / 16 % 16, i / 256])
        .map(|c| if c.iter().all(|c| (3..13).contains(c)) { if c[2] < 8 { 100 } else { 200 } } else { 0 })
        .collect();
    let at = |name: &str| text(&folder.path().join(name));
    fs::write(folder.path().join("v.raw"), raw).unwrap();
    let flags =
        ["--dims", "16x16x16", "--dtype", "u8", "--iso", "50", "--channels", "normal,value", "--json"];
    oct(&[&["build", &at("v.raw"), "-o", &at("v.oct")], &flags[..]].concat()).json();
    let pixels = |material: &str| -> [[u8; 4]; 2] {
        let scene =
            format!("size = [9, 9]\n[[model]]\nfile = \"v.oct\"\nmaterial = \"m\"\n[material.m]\n{material}");
        rendered(folder.path(), &scene, &["--shading", "plain"]).json();
        let file = std::io::BufReader::new(fs::File::open(at("scene.png")).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        [2, 6].map(|row| bytes.as_chunks().0[row * 9 + 4])
    };
    let [hard, soft] = pixels("channel = \"value\"\ncolors = [[100, \"#ff0000\"], [200, \"#0000ff\"]]\n");
    assert!(hard[0] == 0 && hard[2] > 200 && soft[0] > 200 && soft[2] == 0, "{hard:?} {soft:?}");
    let [hard, soft] = pixels("preset = \"ct\"\n");
    assert!(hard[1] > soft[1] && soft[0] > 150, "{hard:?} {soft:?}");
    // Without a channel, what the preset says of it does not count.
    let [hard, soft] = pixels("preset = \"ct\"\nchannel = \"none\"\n");
    assert!(hard.iter().zip(soft).all(|(hard, soft)| hard.abs_diff(soft) <= 2), "{hard:?} {soft:?}");
}

/// The chunks of a PNG by their names.
fn chunks(path: &Path) -> Vec<String> {
    let bytes = fs::read(path).unwrap();
    let (mut at, mut names) = (8, Vec::new());
    while at + 8 <= bytes.len() {
        let length = u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        names.push(String::from_utf8_lossy(&bytes[at + 4..at + 8]).into_owned());
        at += 12 + length;
    }
    names
}

/// The samples of a PNG, as bytes.
pub(crate) fn samples(path: &Path) -> Vec<u8> {
    let decoder = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    bytes
}

#[test]
fn a_model_is_magnified_coloured_and_cut() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let render = |input: &str, picture: &str, extra: &[&str]| {
        let run = ["render", &text(&at(input)), "-o", &text(&at(picture)), "--view", "iso", "--json"];
        oct(&[&run[..], extra].concat()).json()
    };
    // The middle half of a picture twice as large, box by box.
    let ids = |picture: &str, size: &str, zoom: &str| {
        let layer = at(picture);
        render("ring.oct", "p.png", &["--size", size, "--zoom", zoom, "--ids", &text(&layer)]);
        samples(&layer)
    };
    let (near, whole) = (ids("near.png", "60x60", "2"), ids("whole.png", "120x120", "1"));
    let rows = whole.chunks(120 * 6).skip(30).take(60);
    let middle: Vec<u8> = rows.flat_map(|row| row[30 * 6..90 * 6].to_vec()).collect();
    assert!(near == middle && near.iter().any(|byte| *byte > 0));
    // The colours behind and of the model.
    render("ring.oct", "p.png", &["--size", "60x60"]);
    let bare = samples(&at("p.png"));
    let json =
        render("ring.oct", "p.png", &["--size", "60x60", "--background", "#102030", "--color", "#2040ff"]);
    assert!(json["hits"].as_u64() > Some(100));
    let colored = samples(&at("p.png"));
    assert!(colored.chunks(4).zip(bare.chunks(4)).all(|(pixel, before)| match before[3] {
        0 => pixel == [0x10, 0x20, 0x30, 255],
        255 => pixel[2] > pixel[0] && before[0] >= before[2],
        _ => pixel[3] == 255,
    }));
    // A model that is cut is a scene that is.
    for (clip, planes) in [("z=..15", "[0, 0, 1, 15]"), ("x=12..,z=..20", "[-1, 0, 0, -12], [0, 0, 1, 20]")] {
        fs::write(
            at("cut.toml"),
            format!(
                "samples = 2\n[[model]]\nfile = 'cube.oct'\n[clip]\nplanes = [{planes}]\ncap = '#ff0000'"
            ),
        )
        .unwrap();
        let depth = |input: &str, layer: &str, extra: &[&str]| {
            let [picture, layer_path] = ["p.png", layer].map(|name| text(&at(name)));
            let json =
                render(input, "p.png", &[&["--size", "60x60", "--depth", &layer_path], extra].concat());
            assert!(json["hits"].as_u64() > Some(100), "{picture}: {json}");
            samples(&at(layer))
        };
        let cut = depth("cube.oct", "a.png", &["--clip", clip]);
        assert!(
            samples(&at("p.png")).chunks(4).any(|pixel| pixel[0] / 3 > pixel[1] / 2 && pixel[3] == 255),
            "{clip}"
        );
        assert!(cut == depth("cut.toml", "b.png", &[]), "{clip}");
        assert!(
            cut != depth("cube.oct", "c.png", &[])
                && cut != depth("cube.oct", "c.png", &["--clip", "z=12.."])
        );
    }
}

#[test]
fn sheets_turntables_and_numbers_are_written_for_models_and_scenes() {
    let folder = folder();
    let at = |name: &str| text(&folder.path().join(name));
    fs::write(
        folder.path().join("two.toml"),
        "[[model]]\nfile = 'ball.oct'\n[[model]]\nfile = 'ring.oct'\nmove = [40, 0, 0]\n",
    )
    .unwrap();
    for input in ["ring.oct", "two.toml"] {
        let run = |extra: &[&str]| {
            let one =
                ["render", &at(input), "-o", &at("p.png"), "--size", "96x64", "--json", "--samples", "1"];
            oct(&[&one[..], extra].concat())
        };
        let sheet = run(&["--contact", "--annotate"]).json();
        assert_eq!((sheet["width"].as_u64(), sheet["rays"].as_u64()), (Some(96), Some(96 * 64)), "{sheet}");
        let turning = run(&["--turntable", "5", "--view", "iso", "--projection", "perspective"]).json();
        assert_eq!(turning["rays"].as_u64(), Some(5 * 96 * 64), "{turning}");
        let names = chunks(&folder.path().join("p.png"));
        assert_eq!(names.iter().filter(|name| *name == "fcTL").count(), 5, "{names:?}");
        for (output, second) in [("frames/", "frames/0001.png"), ("turn-%02d.png", "turn-01.png")] {
            let line = format!(
                "render {} -o {} --size 40x30 --turntable 3 --json --samples 1",
                at(input),
                at(output)
            );
            let json = oct(&line.split(' ').collect::<Vec<_>>());
            assert_eq!(json.json()["rays"].as_u64(), Some(3 * 40 * 30));
            let names = chunks(&folder.path().join(second));
            assert!(names.iter().any(|name| name == "IDAT") && !names.iter().any(|name| name == "fcTL"));
            assert!(!folder.path().join(second.replace('1', "3")).exists());
        }
        run(&["--contact", "--view", "left"]).refused(2, &["--view"]);
        run(&["--turntable", "1"]).refused(2, &["--turntable"]);
    }
    let render = |extra: &[&str]| oct(&[&["render", &at("ring.oct"), "-o", &at("p.png")], extra].concat());
    let report = oct(&["info", &at("ring.oct"), "--json"]).json();
    let most = report["nodes"].as_u64().unwrap() + report["skin_voxels"].as_u64().unwrap();
    assert_eq!(render(&["--size", "64x64", "--ids", &at("i.png")]).code, 0);
    let ids: Vec<u64> = samples(&folder.path().join("i.png"))
        .chunks(6)
        .map(|p| p.iter().fold(0, |id, byte| id << 8 | u64::from(*byte)))
        .collect();
    assert_eq!(ids.len(), 64 * 64);
    let nodes = report["nodes"].as_u64().unwrap();
    assert!(ids.iter().all(|id| *id == 0 || (nodes + 1..=most).contains(id)) && ids.iter().any(|id| *id > 0));
    // The first channel counts the models of a scene.
    oct(&["render", &at("two.toml"), "-o", &at("p.png"), "--ids", &at("i.png"), "--json"]).json();
    let models: BTreeSet<[u8; 2]> =
        samples(&folder.path().join("i.png")).as_chunks::<6>().0.iter().map(|p| [p[0], p[1]]).collect();
    assert_eq!(models, BTreeSet::from([[0, 0], [0, 1]]));
}

#[test]
fn a_size_of_one_number_is_a_square() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    oct(&["build", "synthetic:sphere@16", "-o", &at("m.oct"), "--json"]).json();
    for (size, name) in [("48", "a.png"), ("48x48", "b.png"), ("48x40", "c.png")] {
        oct(&["render", &at("m.oct"), "-o", &at(name), "--size", size, "--json"]).json();
    }
    let bytes = |name: &str| std::fs::read(at(name)).unwrap();
    assert!(bytes("a.png") == bytes("b.png") && bytes("a.png") != bytes("c.png"));
}
