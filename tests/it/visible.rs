//! What cannot be seen is left out, and no ray from there meets anything else than before. Would break: a wall that
//! is missing where a ray slips between two voxels, a model that hangs on the budget, inner walls that stay.
//!
//! With INFOBYTE_LONG=N so many times as many rays are tried; 500 are ten million.

#![expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "samples are clamped to bytes")]

use crate::prelude::*;
use infobyte::SurfacePoint;
use infobyte::synthetic;

fn times() -> u64 {
    long().into()
}

fn options(iso: f64, surface: SurfaceKind, from: &[ViewedFrom]) -> BuildOptions {
    BuildOptions {
        threshold: Threshold::Iso(iso),
        surface: Some(surface),
        visible_from: from.to_vec(),
        ..BuildOptions::default()
    }
}

/// The model, and how many boxes were left out.
fn build(source: &dyn VolumeSource, options: &BuildOptions) -> (Model, u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.oct");
    let report = infobyte::build(source, options, &path).unwrap();
    let model = Model::open(&path).unwrap();
    verify(model.bytes()).unwrap();
    (model, report.hidden.unwrap_or(0))
}

/// The whole model and what is seen of it, with the hidden boxes counted.
fn pair(
    source: &dyn VolumeSource,
    iso: f64,
    surface: SurfaceKind,
    from: &[ViewedFrom],
) -> (Model, Model, u64) {
    let (whole, none) = build(source, &options(iso, surface, &[]));
    let (seen, hidden) = build(source, &options(iso, surface, from));
    assert_eq!((none, whole.header().voxels), (0, seen.header().voxels + hidden));
    (whole, seen, hidden)
}

/// Holds rays against both models; returns how many hit.
fn same_hits(whole: &Model, seen: &Model, rays: impl Iterator<Item = ([f64; 3], [f64; 3])>) -> u64 {
    let (a, b) = (RayCaster::new(whole).unwrap(), RayCaster::new(seen).unwrap());
    let mut hits = 0;
    for (origin, direction) in rays {
        // Models of other voxels have other numbers for them.
        let cast = |caster: &RayCaster<&Model>| -> Option<SurfacePoint> {
            let mut hit = caster.first_hit(origin, direction).unwrap()?;
            hit.number = 0;
            Some(hit)
        };
        let (a, b) = (cast(&a), cast(&b));
        assert_eq!(a, b, "{origin:?} {direction:?}");
        hits += u64::from(a.is_some());
    }
    hits
}

/// Rays from beyond the volume to places in it, one in eight along an axis or through samples and edges.
fn outside_rays(model: &Model, count: u64, seed: u64) -> impl Iterator<Item = ([f64; 3], [f64; 3])> {
    let (dims, affine) = (model.dims().to_array().map(f64::from), model.affine());
    let mut random = Random(seed);
    let reach = dims.iter().fold(0.0_f64, |m, n| m.max(*n));
    (0..count).map(move |i| {
        let grain = if i % 8 == 0 { 2.0 } else { f64::from(1 << 20) };
        let round = |v: f64| (v * grain).round() / grain;
        let to: [f64; 3] = dims.map(|n| round(random.unit() * n - 0.5));
        let away: [f64; 3] = [0; 3].map(|_: i32| round(random.unit() * 2.0 - 1.0));
        let away = if away == [0.0; 3] { [0.0, 0.0, 1.0] } else { away };
        let length = away.iter().map(|c| c * c).sum::<f64>().sqrt();
        let from = std::array::from_fn(|a| to[a] + away[a] / length * 3.0 * reach);
        let (from, to) = (affine.apply(from), affine.apply(to));
        (from, std::array::from_fn(|a| to[a] - from[a]))
    })
}

const SURFACES: [SurfaceKind; 2] = [SurfaceKind::Skin, SurfaceKind::Cells];

/// A ball with a cavity, and another ball in that.
fn nested(n: u32) -> Voxels<u8> {
    let c = f64::from(n) / 2.0 + 0.2;
    Voxels::from_fn(Dims::new(n, n, n).unwrap(), |p| {
        let r = (0..3).map(|a| (f64::from(p[a]) - c).powi(2)).sum::<f64>().sqrt() / f64::from(n);
        let depth = (0.45 - r).min((r - 0.36).max(0.25 - r)) * f64::from(n);
        (128.0 + 60.0 * depth).clamp(0.0, 255.0) as u8
    })
}

fn noise(dims: [u32; 3], seed: u64, inside: u8) -> Voxels<u8> {
    let mut random = Random(seed);
    Voxels::from_fn(Dims::new(dims[0], dims[1], dims[2]).unwrap(), |_| {
        if random.byte() < inside { 200 } else { 50 }
    })
}

#[test]
fn walls_of_a_closed_cavity_are_left_out() {
    for surface in SURFACES {
        let (whole, seen, hidden) = pair(&nested(60), 128.0, surface, &[ViewedFrom::Outside]);
        // The outer wall alone: its area is 0.45^2 of 0.45^2 + 0.36^2 + 0.25^2.
        let part = seen.header().voxels as f64 / whole.header().voxels as f64;
        assert!((0.48..0.56).contains(&part), "{surface:?}: {part}, {hidden} hidden");
        assert!(seen.header().file_bytes < whole.header().file_bytes * 6 / 10);
        let hits = same_hits(&whole, &seen, outside_rays(&whole, 4000 * times(), 5));
        assert!(hits > 1000, "{hits}");
    }
}

#[test]
fn no_ray_from_outside_meets_anything_else() {
    for (round, inside) in [20, 60, 90, 128, 160, 200, 250].into_iter().enumerate() {
        let dims = [[21, 17, 30], [70, 9, 12], [33, 33, 33]][round % 3];
        let voxels = noise(dims, round as u64, inside);
        for surface in SURFACES {
            let (whole, seen, hidden) = pair(&voxels, 128.0, surface, &[ViewedFrom::Outside]);
            let hits = same_hits(&whole, &seen, outside_rays(&whole, 6000 * times(), round as u64));
            println!("{inside} {surface:?}: {hidden} of {} hidden, {hits} hits", whole.header().voxels);
        }
    }
}

#[test]
fn views_and_eyes_see_what_they_saw() {
    let sources: [Voxels<u8>; 3] = [nested(40), noise([40, 30, 20], 1, 60), noise([30, 40, 33], 2, 20)];
    let mut random = Random(9);
    for (voxels, surface) in sources.iter().flat_map(|v| SURFACES.map(|s| (v, s))) {
        for along in [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.2], [-0.55, 0.75, -0.38]] {
            let (whole, seen, hidden) = pair(voxels, 128.0, surface, &[ViewedFrom::Along(along)]);
            // At least the cavity of the ball; in thin noise there is always a bent way.
            assert!(hidden > 0 || !std::ptr::eq(voxels, &sources[0]), "{along:?}");
            let rays = outside_rays(&whole, 2000 * times(), 3).map(|(from, to)| {
                let target: [f64; 3] = std::array::from_fn(|a| from[a] + to[a]);
                (std::array::from_fn(|a| target[a] - 100.0 * along[a]), along)
            });
            same_hits(&whole, &seen, rays);
        }
        for _ in 0..4 {
            let eye: [f64; 3] = [0; 3].map(|_: i32| random.unit() * 80.0 - 20.0);
            let from = [ViewedFrom::Point(eye)];
            let (whole, none) = build(voxels, &options(128.0, surface, &[]));
            let shown = tempfile::tempdir().unwrap();
            let path = shown.path().join("m.oct");
            let report = infobyte::build(voxels, &options(128.0, surface, &from), &path).unwrap();
            let seen = Model::open(&path).unwrap();
            assert!(none == 0 && report.hidden.is_some());
            let rays = outside_rays(&whole, 2000 * times(), 4)
                .map(|(from, to)| (eye, std::array::from_fn(|a| from[a] + to[a] - eye[a])));
            same_hits(&whole, &seen, rays);
        }
    }
}

#[test]
fn bytes_are_the_same_at_any_budget_and_threads() {
    // Several words and bricks along x and y.
    let voxels = noise([150, 70, 36], 4, 60);
    for surface in SURFACES {
        let mut models = Vec::new();
        for (mib, threads) in [(2, 1), (4, 2), (64, 3)] {
            let how = BuildOptions {
                memory: MemoryCap::Share(mib << 20),
                threads,
                ..options(128.0, surface, &[ViewedFrom::Outside])
            };
            models.push(build(&voxels, &how).0);
        }
        assert!(models.windows(2).all(|m| m[0].bytes() == m[1].bytes()), "{surface:?}");
    }
}

#[test]
fn heads_lose_inner_walls_and_no_first_hit() {
    let mut subjects: Vec<(Box<dyn VolumeSource>, f64)> =
        vec![(synthetic::open(Path::new("synthetic:head@96")).unwrap(), -300.0)];
    if let Some(path) = data::real_data("ct-philips-28") {
        let source = infobyte::discovery::open(&[path], &infobyte::source::OpenOptions::default()).unwrap();
        subjects.push((source, -300.0));
    }
    for (source, iso) in &subjects {
        for surface in SURFACES {
            let (whole, seen, hidden) = pair(&**source, *iso, surface, &[ViewedFrom::Outside]);
            same_hits(&whole, &seen, outside_rays(&whole, 5000 * times(), 8));
            println!(
                "{surface:?}: {hidden} of {} hidden, {} of {} bytes",
                whole.header().voxels,
                seen.header().file_bytes,
                whole.header().file_bytes
            );
            assert!(hidden > 0);
        }
    }
}

#[test]
fn the_command_tells_what_was_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(&folder.path().join("m.oct"));
    let ball = text(&folder.path().join("ball.raw"));
    fs::write(&ball, nested(48).samples()).unwrap();
    let build = |from: &[&str]| {
        let mut args =
            vec!["build", &ball, "-o", &out, "--dims", "48x48x48", "--dtype", "u8", "--iso", "128", "--json"];
        from.iter().for_each(|f| args.extend(["--visible-from", f]));
        oct(&args)
    };
    let whole = build(&[]).json();
    assert!(whole["sight"].is_null(), "{whole}");
    let seen = build(&["outside"]).json();
    let of = |key: &str| seen["sight"][key].as_f64().unwrap();
    assert!(of("hidden") > 0.0 && of("bytes_saved_about") > 0.0 && of("seconds") >= 0.0);
    assert_eq!(of("hidden"), whole["skin_voxels"].as_f64().unwrap() - seen["skin_voxels"].as_f64().unwrap());
    // A part does not tell what is inside.
    let info = oct(&["info", &out, "--measure", "--json"]).json();
    assert!(info["volume_mm3"].is_null() && info["surface_area_mm2"].is_f64(), "{info}");
    let export = |name: &str, more: &[&str]| {
        let to = text(&folder.path().join(name));
        oct(&[&["export", &out, "-o", &to], more].concat())
    };
    for name in ["a.stl", "a.nrrd"] {
        export(name, &[]).refused(2, &["m.oct", "--visible-from outside", "--skin"]);
        assert!(!folder.path().join(name).exists());
    }
    assert_eq!((export("b.nrrd", &["--skin"]).code, export("b.ply", &["--as", "points"]).code), (0, 0));
    let front = build(&["front", "along:0,-1,0", "-10,-500,0"]).json();
    assert!(front["skin_voxels"].as_u64() < seen["skin_voxels"].as_u64());
    for (wrong, words) in
        [("inside", "write outside, front"), ("along:0,0,0", "not a direction"), ("1,2", "mm")]
    {
        build(&[wrong]).refused(2, &[words]);
    }
    // From within a solid its surface is seen from the other side.
    let raw = folder.path().join("full.raw");
    fs::write(&raw, vec![200_u8; 4096]).unwrap();
    let args = ["build", &text(&raw), "-o", &out, "--dims", "16x16x16", "--dtype", "u8", "--iso", "100"];
    let within = oct(&[&args[..], &["--visible-from", "8,8,8", "--json"]].concat()).json();
    assert_eq!((&within["sight"]["hidden"], &within["skin_voxels"]), (&0.into(), &1352.into()));
}
