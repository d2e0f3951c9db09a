//! Pictures that misled: sheets one voxel thick in dark and light bands, single slices nearly black.

use crate::prelude::*;
use std::io::BufReader;

use super::{ball, built, noise};

/// Red of every opaque pixel whose neighbours are opaque, too.
fn brightness(path: &Path) -> Vec<u8> {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut bytes).unwrap();
    let width = reader.info().width as usize;
    let pixels: Vec<[u8; 4]> = bytes.as_chunks::<4>().0.to_vec();
    let opaque = |at: usize| pixels.get(at).is_some_and(|p| p[3] == 255);
    (width..pixels.len() - width)
        .filter(|at| [at - width, at - 1, *at, at + 1, at + width].iter().all(|at| opaque(*at)))
        .map(|at| pixels[at][0])
        .collect()
}

/// Darkest and brightest of the middle 94 in a hundred.
fn span(path: &Path) -> (u8, u8) {
    let mut all = brightness(path);
    assert!(all.len() > 1000, "{}", all.len());
    all.sort_unstable();
    (all[all.len() * 3 / 100], all[all.len() - 1 - all.len() * 3 / 100])
}

#[test]
fn a_sheet_one_voxel_thick_is_lit_evenly() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // Flat, in noise: its gradient is that of the noise.
    let sheet =
        built(folder.path(), "flat", [64, 64, 64], &[], |p| noise(p) + if p[1] == 30 { 1000 } else { 0 });
    for (name, args) in [
        ("front", &["--view", "front"][..]),
        ("iso", &["--view", "iso"]),
        ("behind", &["--eye", "100,400,120", "--look-at", "32,32,32"]),
    ] {
        let picture = at(&format!("{name}.png"));
        let run =
            oct(&[&["render", &text(&sheet), "-o", &text(&picture), "--size", "200x200"], args].concat());
        assert_eq!(run.code, 0, "{run:?}");
        let (dark, light) = span(&picture);
        assert!(light - dark < 60 && dark > 90, "{name}: {dark} to {light}");
    }
    // Coarse nodes of it as well.
    let thumbnail = at("flat.png");
    assert_eq!(oct(&["thumbnail", &text(&sheet), "-o", &text(&thumbnail), "--size", "64"]).code, 0);
    let (dark, light) = span(&thumbnail);
    assert!(light - dark < 60 && dark > 120, "thumbnail: {dark} to {light}");
}

#[test]
fn a_table_that_is_bent_and_tilted_has_no_bands() {
    let folder = tempfile::tempdir().unwrap();
    let table = built(folder.path(), "table", [96, 96, 48], &[], |p| {
        let x = f64::from(p[0]) - 48.0;
        let off = (f64::from(p[1]) - 40.0 - 0.06 * x - x * x / 288.0).abs();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 1000")]
        let value = (1000.0 * (1.0 - off / 1.2).max(0.0)) as u16;
        value + noise(p)
    });
    let picture = folder.path().join("table.png");
    let view = ["--eye", "48,-400,24", "--look-at", "48,40,24", "--size", "300x150"];
    // The lamp at the eye: how stored normals of so thin a skin err shows in light from the side.
    let view = [&view[..], &["--shading", "plain"]].concat();
    assert_eq!(oct(&[&["render", &text(&table), "-o", &text(&picture)], &view[..]].concat()).code, 0);
    // The bands were few, and black.
    let mut all = brightness(&picture);
    all.sort_unstable();
    let (dark, light) = (all[all.len() / 200], all[all.len() * 9 / 10]);
    assert!(dark > 180 && light > 220, "{dark} to {light}");
}

#[test]
fn a_single_slice_is_not_black_on_the_contact_sheet() {
    let folder = tempfile::tempdir().unwrap();
    let slice = built(folder.path(), "slice", [96, 96, 1], &[], |p| {
        let r = (f64::from(p[0]) - 48.0).hypot(f64::from(p[1]) - 48.0);
        noise(p) + if r < 12.0 || (20.0..40.0).contains(&r) { 1000 } else { 0 }
    });
    let picture = folder.path().join("slice.png");
    assert_eq!(oct(&["thumbnail", &text(&slice), "-o", &text(&picture)]).code, 0);
    let (dark, light) = span(&picture);
    // What faces the eye is turned away from the key lamp.
    assert!(dark > 180 && light > 180, "{dark} to {light}");
}

#[test]
fn a_round_body_is_shaded_as_by_its_normals() {
    let folder = tempfile::tempdir().unwrap();
    let model = built(folder.path(), "ball", [64, 64, 64], &[], ball(64, 28.0));
    let picture = folder.path().join("ball.png");
    let plain = ["render", &text(&model), "-o", &text(&picture), "--size", "200x200", "--shading", "plain"];
    assert_eq!(oct(&plain).code, 0);
    let mut all = brightness(&picture);
    all.sort_unstable();
    // From the lit middle to the dark rim, all shades: nothing was flattened.
    let share = |below: u8| all.iter().filter(|v| **v < below).count() * 100 / all.len();
    assert!((15..50).contains(&share(180)) && (3..25).contains(&share(130)), "{} {}", share(180), share(130));
}

#[test]
fn a_missing_folder_is_told_before_a_long_picture_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let model = built(folder.path(), "ball", [64, 64, 64], &[], ball(64, 28.0));
    let nowhere = text(&folder.path().join("nowhere/p.png"));
    let picture = text(&folder.path().join("p.png"));
    let started = std::time::Instant::now();
    for files in [
        vec!["-o", &nowhere],
        vec!["-o", &picture, "--depth", &nowhere],
        vec!["-o", &picture, "--normals", &nowhere],
    ] {
        let model = text(&model);
        let whole = ["render", &model, "--size", "16384x16384", "--threads", "1"];
        oct(&[&whole[..], &files[..]].concat()).refused(5, &["nowhere/p.png", "folder does not exist"]);
    }
    // The picture itself takes some 10 seconds and 1 GiB each time.
    assert!(started.elapsed().as_secs() < 5, "{:?}", started.elapsed());
    assert_eq!(names(folder.path()), ["ball.oct", "ball.raw"]);
}

#[test]
fn pictures_under_a_cap_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let model = built(folder.path(), "ball", [48, 48, 48], &[], ball(48, 20.0));
    let render = |output: &str, extra: &[&str]| {
        let size = ["--size", "1100x1300", "--depth", &at("d.png"), "--json"];
        oct(&[&["render", &text(&model), "-o", &at(output)], &size[..], extra].concat())
    };
    assert_eq!(render("a.png", &[]).code, 0);
    let depth = std::fs::read(at("d.png")).unwrap();
    let refused = render("b.png", &["--memory", "2MiB", "--threads", "2"]);
    assert_eq!(refused.code, 4, "{refused:?}");
    let named = refused.stderr.trim().rsplit(' ').next().unwrap().to_owned();
    // Bands of any height, down to the fewest rows, are one picture.
    for memory in [named.as_str(), "20MiB", "64MiB"] {
        assert_eq!(render("b.png", &["--memory", memory, "--threads", "2"]).code, 0, "{memory}");
        assert_eq!(std::fs::read(at("a.png")).unwrap(), std::fs::read(at("b.png")).unwrap(), "{memory}");
        assert_eq!(depth, std::fs::read(at("d.png")).unwrap(), "{memory}");
    }
}
