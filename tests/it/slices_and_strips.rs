//! Slices have the area of what they cut, in true scale; what is written around a picture leaves it alone; a GIF has the
//! frames of the turntable. If this fails, a length that is measured in a figure is wrong, or a model is covered.

use crate::prelude::*;
use crate::scene_command::samples;

/// Builds what is named, and returns the options that a picture of it begins with.
fn model(folder: &Path, input: &str, extra: &[&str]) -> String {
    let path = text(&folder.join("m.oct"));
    // Through the shell: what it names says of which surface it is.
    let run = shell(&format!("\"$OCT\" build '{input}' -o '{path}' --quiet {}", extra.join(" ")), &[""; 0]);
    assert_eq!(run.code, 0, "{run:?}");
    path
}

/// A picture, as rows of pixels.
fn picture(folder: &Path, model: &str, extra: &[&str]) -> Vec<[u8; 4]> {
    let path = folder.join("p.png");
    let run = oct(&[&["render", model, "-o", &text(&path)], extra].concat());
    assert_eq!(run.code, 0, "{run:?}");
    samples(&path).as_chunks().0.to_vec()
}

/// Pixels, those half covered by halves, whose colours are not the cut line's.
fn filled(pixels: &[[u8; 4]]) -> f64 {
    let part = |p: &[u8; 4]| f64::from(p[0].saturating_sub(32)) / 204.0 * f64::from(p[3]) / 255.0;
    pixels.iter().map(part).sum()
}

/// Balls and rings, of voxels and of cells: the area that is filled, and half of the line, is that of the circles.
#[test]
fn slices_have_the_area_of_what_they_cut() {
    let folder = tempfile::tempdir().unwrap();
    let circle = |radius: f64| std::f64::consts::PI * radius * radius;
    let around = |radius: f64| 2.0 * std::f64::consts::PI * radius;
    for (body, section, area, rim, edge) in [
        ("sphere@64?radius=24", "z=31.5", circle(24.0), around(24.0), 48.0),
        ("sphere@64?radius=24", "x=44", circle(24.0) - circle(12.5), around(20.5), 48.0),
        ("torus@64?ring=18,tube=7,turn=0x0x0", "z=31.5", circle(25.0) - circle(11.0), around(36.0), 50.0),
        ("torus@64?ring=18,tube=7,turn=0x0x0", "y=31.5", 2.0 * circle(7.0), around(14.0), 50.0),
    ] {
        for (surface, slack) in [("cells", 0.015), ("skin", 0.035)] {
            let input = format!("synthetic:{body}");
            let model = model(folder.path(), &input, &["--iso", "0.5", "--surface", surface]);
            let side = 400.0;
            let pixels = picture(folder.path(), &model, &["--section", section, "--size", "400x400"]);
            // The model fills the picture but for a margin of 4 %; cells reach to the samples around.
            let edge = if surface == "cells" { edge + 1.0 } else { edge };
            let pixel_mm = edge * 1.04 / side;
            // The line takes three quarters of a pixel off within.
            let found = filled(&pixels) * pixel_mm * pixel_mm + 0.75 * pixel_mm * rim;
            assert!((found / area - 1.0).abs() < slack, "{body} {section} {surface}: {found} for {area}");
            let same = picture(
                folder.path(),
                &model,
                &["--section", section, "--size", "400x400", "--threads", "1"],
            );
            assert!(same == pixels, "{body} {section} {surface}: threads");
        }
    }
    let model = text(&folder.path().join("m.oct"));
    let refused = |extra: &[&str], words: &[&str]| {
        oct(&[&["render", &model, "-o", &text(&folder.path().join("x.png"))], extra].concat())
            .refused(2, words);
    };
    refused(
        &["--section", "z=90"],
        &["m.oct", "does not intersect what is shown", "--section", "with z from"],
    );
    refused(&["--section", "w=1"], &["'w=1' is not a plane", "z=40"]);
    refused(&["--section", "z=30", "--view", "left"], &["--section", "--view"]);
    refused(&["--section", "z=30", "--contact"], &["--section", "--contact"]);
    refused(&["--legend"], &["m.oct", "no labels to list", "--legend", "--labels"]);
}

/// A block of two labels, one of them in two parts, with a hollow in the other: each in its colour and as large as it is.
#[test]
fn labels_are_cut_and_listed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |p: [u32; 3]| match p {
        [8..24, 8..40, 8..40] if !(12..20).contains(&p[0]) || !(12..30).contains(&p[1]) => 1,
        [24..40, 8..40, 8..40] => 2,
        [4..6, 4..6, 4..6] => 7,
        _ => 0,
    };
    let side = 48_u32;
    let bytes: Vec<u8> = (0..side.pow(3)).map(|i| at([i % side, i / side % side, i / side / side])).collect();
    let raw = folder.path().join("labels.raw");
    fs::write(&raw, bytes).unwrap();
    let names = folder.path().join("names.tsv");
    fs::write(&names, "index\tname\tcolor\n1\tliver\t#ff0000\n2\tlung\t#00ff00\n7\tspot\t#0000ff\n").unwrap();
    let folder = folder.path();
    let options = ["--labels", "all", "--dims", "48x48x48", "--dtype", "u8", "--names", &text(&names)];
    let model = model(folder, &text(&raw), &options);
    let count = |pixels: &[[u8; 4]], color: [u8; 3]| {
        pixels.iter().filter(|p| p[..3] == color && p[3] == 255).count() as f64
    };
    let (red, green, blue) = ([255, 0, 0], [0, 255, 0], [0, 0, 255]);
    let slice = ["--section", "z=24", "--size", "300x300"];
    let pixels = picture(folder, &model, &slice);
    // From 3.5 to 39.5 mm and 4 % more, so 8 pixels a voxel; the line takes some.
    let voxel = (300.0 / (36.0 * 1.04_f64)).powi(2);
    for (color, voxels) in [(red, 16.0 * 32.0 - 8.0 * 18.0), (green, 16.0 * 32.0)] {
        let share = count(&pixels, color) / (voxels * voxel);
        assert!((0.87..1.0).contains(&share), "{color:?}: {share}");
    }
    assert_eq!(count(&pixels, blue), 0.0);
    let hidden = picture(folder, &model, &[&slice[..], &["--hide", "liver"]].concat());
    assert!(count(&hidden, red) == 0.0 && count(&hidden, green) == count(&pixels, green));
    // A slice keeps its frame, and titles state what is shown.
    let lung = picture(folder, &model, &[&slice[..], &["--only", "lung"]].concat());
    assert!(count(&lung, red) == 0.0 && count(&lung, green) == count(&pixels, green));
    for (extra, title) in [
        (&["--only", "lung"][..], "m · 16.4 × 32.8 × 32.8 mm"),
        (&["--only", "lung", "--section", "z=24"], "m · 16.4 × 32.8 × 32.8 mm (uncut)"),
        (&["--clip", "z=..24"], "m · 35.9 × 35.9 × 35.9 mm (uncut)"),
    ] {
        let titled = |title: &str| picture(folder, &model, &[&["--size", "300x200", title], extra].concat());
        assert!(titled("--title") == titled(&format!("--title={title}")), "{title}");
    }
    oct(&["render", &model, "-o", &text(&folder.join("x.png")), "--section", "z=24", "--only", "spot"])
        .refused(2, &["does not intersect what is shown; choose --section with z from 3 to 6 mm"]);
    let run =
        oct(&["render", &model, "-o", &text(&folder.join("x.png")), "--section", "z=24", "--clip", "z=..9"]);
    assert!(run.code == 0 && run.stdout.contains("choose another place with --section"), "{run:?}");
    // Swatches of what is seen alone, in a slice, a view, a sheet and a turntable, where all are listed.
    let swatches = |extra: &[&str]| {
        let all = picture(folder, &model, &[&["--size", "300x300", "--legend"], extra].concat());
        // The widest name is two ems and less: the last column of the picture is that of the legend.
        let strip: Vec<[u8; 4]> = all.chunks(300).flat_map(|row| row[240..].to_vec()).collect();
        [red, green, blue].map(|color| count(&strip, color) > 50.0)
    };
    assert_eq!(swatches(&["--section", "z=24"]), [true, true, false]);
    assert_eq!(swatches(&["--section", "z=24", "--only", "lung"]), [false, true, false]);
    assert_eq!(swatches(&[]), [true, true, true]);
    // The spot is beside the block, which hides the liver from its left, but for what its round edges show.
    assert_eq!(swatches(&["--view", "left"]), [true, true, true]);
    assert_eq!(swatches(&["--contact"]), [true, true, true]);
    assert_eq!(swatches(&["--turntable", "2", "--view", "left"]), [true, true, true]);
}

/// Title, legend and scale bar leave the picture as it is in the size that remains.
#[test]
fn strips_leave_the_picture_alone() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), "synthetic:head@64", &["--iso", "400"]);
    for extra in [&["--view", "iso"][..], &["--eye", "0,-60,0", "--look-at", "0,0,0"], &["--clip", "x=..0"]] {
        let render = |more: &[&str]| picture(folder.path(), &model, &[extra, more].concat());
        // 8 pixels and an eightieth of the height to an em; a title of two, a bar of four.
        let whole = render(&["--size", "240x200", "--annotate", "--title"]);
        let inner = render(&["--size", "240x138"]);
        assert!(whole[21 * 240..(21 + 137) * 240] == inner[..137 * 240], "{extra:?}");
        assert!(
            whole[..21 * 240].iter().any(|p| p[3] == 255) && whole[160 * 240..].iter().any(|p| p[3] == 255)
        );
        // Too small for letters.
        assert!(render(&["--size", "60x60", "--annotate", "--title=Head"]) == render(&["--size", "60x60"]));
    }
}

/// The cube has the letters of a patient for formats that state a patient's axes, and otherwise x, y, z.
#[test]
fn a_cube_has_a_patients_letters_where_the_axes_are_a_patients() {
    let folder = tempfile::tempdir().unwrap();
    let samples: Vec<u8> = (0..512).map(|i| if (2..6).contains(&(i % 8)) { 9 } else { 0 }).collect();
    let strip = |name: &str, head: &str, flags: &[&str]| {
        let (source, model) = (folder.path().join(name), folder.path().join("m.oct"));
        fs::write(&source, [head.as_bytes(), &samples].concat()).unwrap();
        let build = ["build", &text(&source), "-o", &text(&model), "--iso", "5"];
        assert_eq!(oct(&[&build[..], flags].concat()).code, 0);
        picture(folder.path(), &text(&model), &["--size", "200x200", "--annotate", "--view", "iso"])
    };
    let raw = strip("a.raw", "", &["--dims", "8x8x8", "--dtype", "u8"]);
    let head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 8 8 8\nencoding: raw\nspace: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n\n";
    let nrrd = strip("a.nrrd", head, &[]);
    assert!(raw != nrrd && raw[..140 * 200] == nrrd[..140 * 200]);
}

/// The frames of a turntable, six seconds together, as its animated PNG has them but for the palette.
#[test]
fn a_gif_has_the_frames_of_the_turntable() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), "synthetic:head@64", &["--iso", "400"]);
    let path = folder.path().join("turn.gif");
    let turn = ["--size", "120x90", "--turntable", "7", "--background", "#ffffff"];
    let run = oct(&[&["render", &model, "-o", &text(&path)], &turn[..]].concat());
    assert_eq!(run.code, 0, "{run:?}");
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(fs::File::open(&path).unwrap()).unwrap();
    assert_eq!((decoder.width(), decoder.height(), decoder.repeat()), (120, 90, gif::Repeat::Infinite));
    let mut frames = Vec::new();
    let mut hundredths = 0;
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        hundredths += u32::from(frame.delay);
        frames.push(frame.buffer.to_vec());
    }
    assert_eq!((frames.len(), hundredths), (7, 600));
    let numbered = folder.path().join("turn-%d.png");
    assert_eq!(oct(&[&["render", &model, "-o", &text(&numbered)], &turn[..]].concat()).code, 0);
    for (number, frame) in frames.iter().enumerate() {
        let exact = samples(&folder.path().join(format!("turn-{number}.png")));
        let off: u64 = exact.iter().zip(frame).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
        let mean = off as f64 / exact.len() as f64;
        assert!(exact.len() == frame.len() && mean < 1.0, "{number}: {mean}");
    }
    oct(&["render", &model, "-o", &text(&path)]).refused(2, &["turn.gif", "IMAGE.png"]);
    oct(&["render", &model, "-o", "t.mp4", "--turntable", "3"]).refused(2, &["t.mp4", "TURN.gif"]);
}

/// Pages of the program itself, with the same words as the documentation.
#[test]
fn pages_are_printed() {
    for (page, begins) in [("scenes", "# Scenes"), ("commands", "# Commands"), ("formats", "# Inputs")] {
        let run = oct(&["help", page]);
        assert!(run.code == 0 && run.stdout.starts_with(begins) && run.stderr.is_empty(), "{run:?}");
        assert!(oct(&["--help"]).stdout.contains(&format!("oct help {page}")));
    }
    oct(&["help", "nothing"]).refused(2, &["nothing"]);
    let short = oct(&["render", "-h"]).stdout;
    let long = oct(&["render", "--help"]).stdout;
    assert!(short.contains("--section") && !short.contains("--lod-bias") && long.contains("--lod-bias"));
    assert!(short.lines().count() <= 34 && long.contains("Light and rays:"), "{short}");
}
