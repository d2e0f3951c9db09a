//! A model in a page: a browser draws what the library's own rays meet, its user can turn, cut and measure, and nothing
//! that is damaged stops it. If this fails, a page shows another surface than the model's, or none.
//!
//! The browser is chromium, with software for graphics; without one these tests say that they are skipped, unless
//! `INFOBYTE_BROWSER` names one (or says `required`, or `brief`: required, but without the longest tests, which
//! `scripts/long.sh` runs). With a Firefox (which needs a display, such as that of Xvfb) the
//! tests that compare pictures run in that; those of hands, damage and frames are of chromium only.

#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

mod broken;
mod driver;
mod firefox;
mod hands;
mod labels;
mod server;
mod site;
mod stream;

use crate::prelude::*;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use infobyte::format::Channel;
use infobyte::load::CellShape;
use infobyte::render::{Projection, ViewPoint};
use sha2::{Digest, Sha256};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::process::{Child, Command, Stdio};

/// Pixels along a side of the pictures that are compared; more where tests are long.
fn side() -> u32 {
    if crate::common::long() > 1 { 512 } else { 64 }
}

/// Pixels of a picture that may differ, 30 of 512 x 512: a browser's numbers have 24 bits, ours are exact.
fn max_other() -> usize {
    (30 * side() * side()).div_ceil(512 * 512) as usize
}

/// A chromium, for tests by its debugging protocol.
fn chromium() -> Option<PathBuf> {
    let found = browser();
    if found.as_ref().is_some_and(|browser| browser.to_string_lossy().contains("firefox")) {
        println!("skipped: it needs a chromium");
        return None;
    }
    found
}

/// A chromium for tests of half a minute, which CI leaves to `scripts/long.sh`.
fn chromium_at_length() -> Option<PathBuf> {
    if std::env::var_os("INFOBYTE_BROWSER").is_some_and(|name| name == "brief") {
        println!("skipped: scripts/long.sh runs it");
        return None;
    }
    chromium()
}

fn browser() -> Option<PathBuf> {
    let is_name = |name: &std::ffi::OsString| !name.is_empty() && name != "required" && name != "brief";
    let named = std::env::var_os("INFOBYTE_BROWSER").filter(is_name);
    let names = ["chromium", "chromium-browser", "google-chrome", "chrome"].map(PathBuf::from);
    let works =
        |name: &PathBuf| Command::new(name).arg("--version").output().is_ok_and(|run| run.status.success());
    let found = named.into_iter().map(PathBuf::from).chain(names).find(works);
    if found.is_none() {
        assert!(std::env::var_os("INFOBYTE_BROWSER").is_none(), "no browser, where one is required");
        println!("skipped: no chromium is installed");
    }
    found
}

/// A camera of the page: half the picture's height in mm at what it looks at.
#[derive(Clone)]
struct Look {
    forward: [f64; 3],
    up: [f64; 3],
    target: [f64; 3],
    half: f64,
    perspective: bool,
    /// Places of labels that are not seen.
    hidden: Vec<u8>,
}

/// Angle of the page's perspective pictures.
const FOV_DEG: f64 = 30.0;

impl Look {
    fn json(&self) -> Value {
        let Self { forward, up, target, half, perspective, hidden } = self;
        serde_json::json!({
            "forward": forward, "up": up, "target": target, "half": half, "perspective": perspective, "hidden": hidden
        })
    }

    /// Origin and direction of the line of sight of each pixel of the page's picture.
    fn lines(&self) -> impl Iterator<Item = ([f64; 3], [f64; 3])> {
        let (camera, side) = (self.camera(), side());
        (0..side * side).map(move |pixel| {
            let at = [pixel % side, pixel / side].map(|c| 2.0 * (f64::from(c) + 0.5) / f64::from(side) - 1.0);
            camera.ray(at[0], -at[1])
        })
    }

    /// A direction of the world to the right, upwards and to the eye.
    fn turned(&self, v: [f64; 3]) -> [f64; 3] {
        let forward = unit(self.forward);
        let right = unit(cross(forward, self.up));
        [right, cross(right, forward), forward.map(|c| -c)].map(|axis| dot(axis, v))
    }

    fn camera(&self) -> Camera {
        let distance = self.half / (FOV_DEG / 2.0).to_radians().tan();
        let forward = unit(self.forward);
        let eye = std::array::from_fn(|a| self.target[a] - distance * forward[a]);
        let point = ViewPoint::Free { eye, look_at: self.target, up: Some(self.up) };
        let projection = if self.perspective { Projection::Perspective } else { Projection::Parallel };
        Camera::new(point, projection, FOV_DEG, 1.0, |_| 0.0).unwrap()
    }
}

/// Cameras around a model, some of them near.
fn looks(model: &Model) -> Vec<Look> {
    let space = GridSpace::new(model.dims(), &model.affine()).unwrap();
    let view = model.view();
    let ends = |a: usize| {
        let along = |sign: f64| {
            let mut direction = [0.0; 3];
            direction[a] = sign;
            sign * space.support(&view, direction)
        };
        [along(-1.0), along(1.0)]
    };
    let ends = [0, 1, 2].map(ends);
    let middle = ends.map(|[low, high]| 0.5 * (low + high));
    let reach = ends.map(|[low, high]| (0.5 * (high - low)).powi(2)).iter().sum::<f64>().sqrt();
    // Half a parallel picture's height at most, so that the model's thinnest side has 8 pixels.
    let thinnest = ends.map(|[low, high]| high - low).into_iter().fold(f64::INFINITY, f64::min);
    let most = thinnest * f64::from(side()) / 16.0;
    let head = [0.0, 0.0, 1.0];
    let look = |forward, up, part: f64, perspective| Look {
        forward,
        up,
        target: middle,
        half: (reach * part).min(if perspective { f64::INFINITY } else { most }),
        perspective,
        hidden: Vec::new(),
    };
    // The middle of the box that is nearest to the model's.
    let far = |at: [f64; 3]| (0..3).map(|a| (at[a] - middle[a]).powi(2)).sum::<f64>();
    let boxes = model.voxels().map(|cell| model.affine().apply(cell.voxel.map(f64::from)));
    let near = boxes.min_by(|a, b| far(*a).total_cmp(&far(*b))).unwrap();
    vec![
        look([0.0, 1.0, 0.0], head, 0.9, false),
        look([-0.55, 0.75, -0.38], head, 0.8, true),
        look([0.3, -0.2, -0.9], [0.0, 1.0, 0.0], 0.4, false),
        // Within the model, and not on a face between two cells: an eye in matter there meets either of them.
        Look { target: near.map(|c| c + 0.25), ..look([1.0, 0.0, 0.0], head, 0.15, true) },
    ]
}

/// Opens a page of a model in the browser, with the script of the tests behind its own; what that says.
fn shown(browser: &Path, page: &Path, looks: &[Look], what: &str) -> Value {
    let html = fs::read_to_string(page).unwrap();
    let (head, rest) = html.split_once("<meta http-equiv=\"Content-Security-Policy\" content=\"").unwrap();
    let (_, rest) = rest.split_once("\">").unwrap();
    let cameras = serde_json::json!(looks.iter().map(Look::json).collect::<Vec<_>>());
    let (test, side) = (include_str!("selftest.js"), side());
    let firefox = browser.to_string_lossy().contains("firefox").then(firefox::Ear::open);
    let tell = firefox.as_ref().map_or(String::new(), firefox::Ear::address);
    let body = rest.replace(
        "</body>",
        &format!("<script>const CAMERAS = {cameras}, SIDE = {side}, WHAT = {what:?}, TELL = {tell:?};</script>\n<script>{test}</script></body>"),
    );
    let flat = if what == "pictures" && !driver::are_drawn() { driver::FLAT } else { "" };
    let tested = page.with_extension("test.html");
    fs::write(&tested, format!("{head}<script>{flat}</script>{body}")).unwrap();
    let address = format!("file://{}", tested.canonicalize().unwrap().display());
    if let Some(ear) = firefox {
        return ear.told_by(browser, &address);
    }
    let profile = tempfile::tempdir().unwrap();
    let run = Command::new(browser)
        .args(driver::ARGUMENTS)
        .args(["--virtual-time-budget=120000", "--window-size=900,700", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(address)
        .output()
        .unwrap();
    let dom = String::from_utf8_lossy(&run.stdout);
    let said = dom.split_once("<pre id=\"result\">").and_then(|(_, rest)| Some(rest.split_once("</pre>")?.0));
    let said =
        said.unwrap_or_else(|| panic!("the page says nothing: {}", String::from_utf8_lossy(&run.stderr)));
    let said = said.replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    serde_json::from_str(&said).unwrap()
}

/// The normal of a pixel of the page: right, up, to the eye.
fn normal_of(pixel: &[u32]) -> [f64; 3] {
    unit([pixel[3], pixel[3] >> 16, pixel[2] >> 16].map(|word| f64::from((word as u16).cast_signed())))
}

/// Are two directions the same within 0.006 degrees, which single precision and 16 bits allow?
fn are_alike(a: [f64; 3], b: [f64; 3]) -> bool {
    (0..3).all(|axis| (a[axis] - b[axis]).abs() < 1e-4)
}

/// Words of base64, as the page writes them.
fn words_of(text: &str) -> Vec<u32> {
    let bytes = STANDARD.decode(text).unwrap();
    bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

/// Compares the page's pictures with rays of the library; gives the pixels that are hit.
fn compare(name: &str, model: &Model, looks: &[Look], said: &Value) -> usize {
    let (view, space) = (model.view(), GridSpace::new(model.dims(), &model.affine()).unwrap());
    let cells = view.cells().map(Cells::new);
    let mut all = 0;
    for (number, (look, picture)) in looks.iter().zip(said["pictures"].as_array().unwrap()).enumerate() {
        let found = words_of(picture["found"].as_str().unwrap());
        let (mut hits, mut other, mut far) = (0, 0, 0);
        for ((origin, direction), got) in look.lines().zip(found.chunks_exact(4)) {
            let ray = space.ray(origin, direction).unwrap();
            let hit = ray.and_then(|ray| match &cells {
                Some(cells) => single::trace(Form::Portable, &view, cells, &ray, 0).hit,
                None => single::trace(Form::Portable, &view, &Skin, &ray, 0).hit,
            });
            // The page gives a single voxel a node above it.
            let first = 1 + u32::from(view.depth() == 0);
            let want = hit.map_or(0, |hit| u32::try_from(hit.box_number).unwrap() + first);
            hits += usize::from(hit.is_some());
            other += usize::from(want != got[0]);
            let Some(hit) = hit.filter(|_| want == got[0]) else { continue };
            let voxel = hit.voxel(&view).map(VoxelIndex::new);
            let stored = voxel.and_then(|voxel| view.voxel_direction(voxel));
            let shape = voxel.zip(view.cells()).map(|(voxel, items)| items.shape(voxel.get()));
            let has_corners = matches!(shape, Some(CellShape::Corners(_)));
            if let Some(n) = stored.filter(|_| !has_corners).map(|n| n.map(f64::from)) {
                let affine = model.affine();
                let spacing = if cells.is_some() { [1.0; 3] } else { affine.spacing_mm() };
                let inverse = affine.inverse().unwrap();
                let world: [f64; 3] =
                    std::array::from_fn(|i| (0..3).map(|a| inverse.rows[a][i] * spacing[a] * n[a]).sum());
                far += usize::from(!are_alike(normal_of(got), look.turned(unit(world))));
            }
        }
        println!("{name}, camera {number}: {hits} hits, {other} other boxes, {far} other normals");
        assert!(
            other <= max_other() && far == 0,
            "{name}, camera {number}: {other} of {hits}, {far} normals"
        );
        assert_eq!(picture["picks"], 0, "{name}, camera {number}");
        all += hits;
    }
    all
}

/// A model, and its page.
fn paged(folder: &Path, name: &str, arguments: &[&str]) -> (Model, PathBuf) {
    let (model, page) = (folder.join(format!("{name}.oct")), folder.join(format!("{name}.html")));
    let built = oct(&[&["build", "-o", &text(&model)], arguments].concat());
    assert_eq!(built.code, 0, "{}", built.stderr);
    let run = oct(&["export", &text(&model), "-o", &text(&page), "--json"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(
        (&run.json()["form"], run.json()["bytes"].as_u64()),
        (&"html".into(), Some(fs::metadata(&page).unwrap().len()))
    );
    (Model::open(&model).unwrap(), page)
}

/// Faces of red, green, blue and white corners.
const COLORED: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 4\n\
    property list uchar int vertex_indices\nend_header\n\
    0 0 0 255 0 0\n30 0 0 0 255 0\n0 30 0 0 0 255\n0 0 30 255 255 255\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";

/// Names of models, and what they are built of.
fn cases(folder: &Path) -> Vec<(&'static str, String)> {
    let made = |name: &str, bytes: &[u8]| {
        fs::write(folder.join(name), bytes).unwrap();
        text(&folder.join(name))
    };
    let raw = |name: &str, bytes: &[u8], dims: &str, surface: &str| {
        format!("{} --dims {dims} --dtype u8 --iso 100 --surface {surface}", made(name, bytes))
    };
    let striped = |count: u32| (0..count).map(|i| if i % 97 < 60 { 200 } else { 0 }).collect::<Vec<u8>>();
    let flat: Vec<u8> = (0..40 * 30_u32).map(|i| if (i % 40) * (i / 40) % 7 > 2 { 200 } else { 0 }).collect();
    let mut cases = vec![
        ("skin", "synthetic:head@96 --surface skin".to_owned()),
        ("leaves", "synthetic:head@96 --surface cells --error 0.2".to_owned()),
        ("corners", "synthetic:sphere@40?noise=0.4 --surface cells".to_owned()),
        ("slices", "synthetic:torus@48?spacing=1x1x6,slab=1 --surface cells".to_owned()),
        ("colors", format!("{} --grid 64 --surface skin", made("colors.ply", COLORED.as_bytes()))),
        ("one", raw("one.raw", &[200], "1x1x1", "skin")),
        ("long", raw("long.raw", &striped(4096 * 6), "4096x3x2", "cells")),
    ];
    if crate::common::long() > 1 {
        cases.push(("cells", "synthetic:head@96 --surface cells".to_owned()));
        cases.push(("flat", raw("flat.raw", &flat, "40x30x1", "skin")));
        cases.push(("longest", raw("longest.raw", &striped(65536 * 4), "65536x2x2", "skin")));
        if let Some(head) = real_data("raw-cthead") {
            let head = format!("{} --dims 256x256x113 --dtype i16be --spacing 1x1x2 --surface", text(&head));
            cases.extend([("CT skin", format!("{head} skin")), ("CT cells", format!("{head} cells"))]);
        }
    }
    cases
}

/// With INFOBYTE_LONG of more than 1 in pictures of 512 x 512, and of models that take longer.
#[test]
fn a_browser_meets_what_the_librarys_rays_meet() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    for (name, arguments) in cases(folder.path()) {
        let (model, page) = paged(folder.path(), name, &arguments.split(' ').collect::<Vec<_>>());
        let has = |kind| model.section_bytes(SectionKind::Voxels(kind)).is_some();
        assert_eq!(has(Channel::Color), name == "colors", "{name}");
        let looks = looks(&model);
        let said = shown(&browser, &page, &looks, "pictures");
        assert!(said["error"].is_null() && said["threw"].is_null(), "{name}: {said}");
        let hits = compare(name, &model, &looks, &said);
        assert!(hits > (side() * side() / 64) as usize, "{name}: {hits}");
    }
}

#[test]
fn a_page_is_turned_cut_measured_and_survives_what_it_is_given() {
    let Some(browser) = browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (_, page) = paged(folder.path(), "m", &["synthetic:head@48", "--surface", "cells"]);
    let said = shown(&browser, &page, &[], "events");
    all_happened(&said);
}

/// Everything that a user did came of it, and damaged data gave sentences.
fn all_happened(said: &Value) {
    let events = said["events"].as_object().unwrap_or_else(|| panic!("{said}"));
    for (name, happened) in events.iter().filter(|(_, happened)| happened.is_boolean()) {
        assert_eq!(happened, true, "{name}: {said}");
    }
    assert!(events["picked"].as_str().unwrap().contains("x "), "{said}");
    assert!(events["distance"].as_str().unwrap().starts_with("distance "), "{said}");
    assert_eq!(
        (&events["marks"], &events["tool"], &events["unnamed"]),
        (&2.into(), &"pick".into(), &0.into())
    );
    let count = |key: &str| said["damaged"][key].as_u64().unwrap();
    assert!(count("refused") > 50 && count("opened") > 50 && count("met") > 100, "{}", said["damaged"]);
}

/// What the page may do is said in it: its own script by its hash, and nothing from anywhere.
#[test]
fn a_page_may_run_its_own_script_and_load_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (_, page) = paged(folder.path(), "<a> & b", &["synthetic:sphere@16", "--surface", "skin"]);
    let html = fs::read_to_string(page).unwrap();
    let between =
        |start: &str, end: &str| html.split_once(start).unwrap().1.split_once(end).unwrap().0.to_owned();
    let policy = between("Content-Security-Policy\" content=\"", "\">");
    for part in [between("\n<script>", "</script>"), between("<style>", "</style>")] {
        let hash = STANDARD.encode(Sha256::digest(part.as_bytes()));
        assert!(policy.contains(&format!("'sha256-{hash}'")), "{policy}");
    }
    assert!(policy.starts_with("default-src 'none'; ") && !policy.contains("unsafe"), "{policy}");
    assert!(
        html.contains("<title>&lt;a&gt; &amp; b</title>")
            && html.contains("src=\"data:image/png;base64,iVBOR")
    );
    for outside in ["http:", "https:", "//cdn", "import(", "fetch(", "XMLHttpRequest", "innerHTML"] {
        assert!(!html.replace("http://www.w3.org/2000/svg", "").contains(outside), "{outside}");
    }
}
