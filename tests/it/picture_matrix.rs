//! Every flag of `oct render` works on every kind of model: whole, cut, and in a scene. If this fails, a flag is refused
//! that the page of commands does not list among its five refusals, or it changes nothing.

use crate::prelude::*;

/// Models of a folder by name: skin, cells, larger leaves, labels, and packed cells; and for each a scene of it and a ball.
const MODELS: [&str; 5] = ["skin", "cells", "larger", "labels", "packed"];

fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| text(&folder.path().join(format!("{name}.oct")));
    let gyroid = |name: &str, extra: &[&str]| {
        let run = ["build", "synthetic:gyroid@24", "-o", &at(name), "--json"];
        oct(&[&run[..], extra].concat()).json();
    };
    gyroid("skin", &["--surface", "skin"]);
    gyroid("cells", &["--surface", "cells"]);
    gyroid("larger", &["--surface", "cells", "--error", "0.1"]);
    let label = |[x, y, z]: [u32; 3]| match [x, y, z].map(|c| c.abs_diff(8)).into_iter().max().unwrap() {
        _ if x > 9 && y < 7 => 0,
        0..4 => 7_u8,
        4..7 => 3,
        _ => 0,
    };
    let map: Vec<u8> = (0..16_u32.pow(3)).map(|i| label([i % 16, i / 16 % 16, i / 256])).collect();
    fs::write(folder.path().join("map.raw"), map).unwrap();
    let raw = text(&folder.path().join("map.raw"));
    let run = ["build", &raw, "-o", &at("labels"), "--dims", "16x16x16", "--dtype", "u8", "--labels", "all"];
    oct(&[&run[..], &["--surface", "cells", "--json"]].concat()).json();
    oct(&["pack", &at("cells"), "-o", &at("packed"), "--json"]).json();
    oct(&["build", "synthetic:sphere@16", "-o", &at("ball"), "--iso", "0.5", "--json"]).json();
    for name in MODELS {
        let scene =
            format!("[[model]]\nfile = '{name}.oct'\n[[model]]\nfile = 'ball.oct'\nmove = [6, 0, 9]\n");
        fs::write(folder.path().join(format!("{name}.toml")), scene).unwrap();
    }
    folder
}

/// Flags that go together, what else they write, and the words of the refusal where the page lists one.
struct Case {
    flags: &'static [&'static str],
    refused: fn(&str, &str) -> Option<&'static str>,
}

const fn works(flags: &'static [&'static str]) -> Case {
    Case { flags, refused: |_, _| None }
}

/// Labels are needed.
const fn of_labels(flags: &'static [&'static str]) -> Case {
    Case { flags, refused: |model, _| (model != "labels").then_some("labels") }
}

/// Measured values are needed, which none of the models has.
const fn of_values(flags: &'static [&'static str]) -> Case {
    Case { flags, refused: |_, _| Some("measured values") }
}

const CASES: [Case; 35] = [
    works(&["--force", "--threads", "2", "--color", "#4080ff", "--json", "--output", "other.png"]),
    works(&["--size", "20"]),
    works(&["--view", "left"]),
    works(&["--eye", "90,-80,70", "--look-at", "8,8,8", "--up", "0,0,1"]),
    works(&["--projection", "perspective", "--fov", "20"]),
    works(&["--zoom", "2"]),
    works(&["--clip", "x=..9"]),
    works(&["--background", "#204060"]),
    of_labels(&["--only", "7"]),
    of_labels(&["--hide", "3"]),
    of_labels(&["--opacity", "3=0.3"]),
    works(&["--lod", "on", "--lod-bias", "3", "--memory", "200MiB"]),
    works(&["--shading", "plain"]),
    works(&["--shading", "soft"]),
    works(&["--shading", "ao"]),
    works(&["--shading", "stored"]),
    works(&["--shading", "blended"]),
    works(&["--shading", "flat"]),
    of_values(&["--colors", "sequential"]),
    of_values(&["--range", "-1..1"]),
    works(&["--blended"]),
    works(&["--samples", "1"]),
    works(&["--samples", "4"]),
    works(&["--samples", "16"]),
    works(&["--samples", "64"]),
    works(&["--samples", "auto"]),
    works(&["--ao-rays", "3"]),
    works(&["--traversal", "exact"]),
    Case {
        flags: &["--traversal", "discrete"],
        refused: |model, way| (model != "skin" || way == "cut").then_some("discrete rays"),
    },
    works(&["--contact"]),
    works(&["--turntable", "3"]),
    works(&["--section", "z=8"]),
    works(&["--annotate", "--title", "--size", "90x80"]),
    Case {
        flags: &["--legend", "--size", "120x80"],
        refused: |model, way| (model != "labels" && way != "scene").then_some("labels"),
    },
    works(&["--depth", "d.png", "--normals", "n.png", "--ids", "i.png"]),
];

/// Flags whose picture must differ from the one without them, of whatever model.
const CHANGE: [&str; 14] = [
    "--view",
    "--eye",
    "--projection",
    "--zoom",
    "--background",
    "--only",
    "--hide",
    "--opacity",
    "--shading plain",
    "--shading ao",
    "--shading stored",
    "--samples 1",
    "--section",
    "--ao-rays",
];

#[test]
fn every_flag_works_on_every_model_whole_cut_and_in_a_scene() {
    let folder = folder();
    let render = |input: &str, cut: bool, flags: &[&str]| -> (Run, Vec<u8>) {
        let mut line = vec!["render".to_owned(), text(&folder.path().join(input))];
        if !flags.contains(&"--output") {
            line.extend(["-o".into(), text(&folder.path().join("p.png"))]);
        }
        if !flags.contains(&"--size") {
            line.extend(["--size".into(), "24x18".into()]);
        }
        if cut && !flags.contains(&"--clip") {
            line.extend(["--clip".into(), "z=..11".into()]);
        }
        let named = |flag: &&str| {
            if flag.ends_with(".png") { text(&folder.path().join(flag)) } else { (*flag).to_owned() }
        };
        line.extend(flags.iter().map(named));
        if !flags.contains(&"--json") {
            line.push("--json".into());
        }
        let run = oct(&line);
        let output = if flags.contains(&"--output") { "other.png" } else { "p.png" };
        (run, fs::read(folder.path().join(output)).unwrap_or_default())
    };
    for model in MODELS {
        for way in ["whole", "cut", "scene"] {
            let input = format!("{model}.{}", if way == "scene" { "toml" } else { "oct" });
            let (run, usual) = render(&input, way == "cut", &[]);
            assert!(run.json()["hits"].as_u64() > Some(20), "{input} {way}: {run:?}");
            for Case { flags, refused } in CASES {
                let (run, picture) = render(&input, way == "cut", flags);
                if let Some(word) = refused(model, way) {
                    run.refused(2, &[word]);
                    continue;
                }
                let json = run.json();
                assert!(json["hits"].as_u64() > Some(10), "{input} {way} {flags:?}: {json}");
                let words = flags.join(" ");
                let changes = CHANGE.iter().any(|change| words.starts_with(change));
                assert!(!changes || picture != usual, "{input} {way} {flags:?} changes nothing");
            }
        }
    }
}

/// The cases name every flag that the command has, and the page lists what they refuse.
#[test]
fn no_flag_is_left_out_and_the_page_lists_the_refusals() {
    let help = oct(&["render", "--help"]).stdout;
    let known: BTreeSet<&str> = CASES.iter().flat_map(|case| case.flags).copied().collect();
    let flags = help.split_whitespace().filter(|word| word.starts_with("--") && word.len() > 2);
    for flag in
        flags.map(|flag| flag.trim_end_matches([',', '.', ':', ';', ')']).split(['=', '[']).next().unwrap())
    {
        assert!(known.contains(flag) || ["--help", "--quiet"].contains(&flag), "{flag} is in no case");
    }
    let page = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/src/jobs/COMMANDS.md")).unwrap();
    let (_, refused) = page.split_once("These combinations are refused:\n\n").unwrap();
    let rows = refused.lines().take_while(|line| line.starts_with("- ")).count();
    assert!((1..=5).contains(&rows), "{rows}");
}
