//! The normals that pictures show are true: smooth bodies are smooth in noise and between thick slices, edges stay edges,
//! and the other side of a thin wall has no part. If this fails, pictures have facets, specks or bevels again.
//!
//! Read from the normal images themselves, 8 bits a part: that adds a fifth of a degree.

use crate::prelude::*;
use bodies::{Body, iso, scan};

const CLEAN: Scan = Scan { spread: 0.8, thick: 1, noise: 0.0 };
const NOISY: Scan = Scan { noise: 0.025, ..CLEAN };
const THICK: Scan = Scan { thick: 6, ..CLEAN };
/// Samples along a side.
const SIDE: u32 = 72;
const PIXELS: u32 = 160;
const FOV_DEG: f64 = 22.0;

/// A picture of a body from some side: the mean angle in degrees between the normals that are shown and the true ones, and
/// the share of pixels that are more than 15 degrees off, in percent.
fn shown(body: &Body, how: Scan, smoothing: Smoothing) -> (f64, f64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let options = BuildOptions {
        threshold: Threshold::Iso(iso(how)),
        surface: Some(SurfaceKind::Cells),
        ..BuildOptions::default()
    };
    infobyte::build(&scan(body, SIDE, how), &options, &path).unwrap();
    let model = Model::open(&path).unwrap();
    let span = f64::from(SIDE);
    let side = unit([0.5, -0.8, 0.33]);
    let eye: [f64; 3] = std::array::from_fn(|a| span / 2.0 + 3.0 * span * side[a]);
    let request = RenderRequest {
        size: Some([PIXELS; 2]),
        point: Some(ViewPoint::Free { eye, look_at: [span / 2.0; 3], up: Some([0.0, 0.0, 1.0]) }),
        projection: Some(Projection::Perspective),
        fov_deg: Some(FOV_DEG),
        depth: true,
        normals: true,
        smoothing,
        ..RenderRequest::default()
    };
    let (image, report) = infobyte::render(&model, &request).unwrap();
    // As the camera has it: t is the depth along the line through the picture's middle.
    let forward = side.map(|c| -c);
    let right = unit(cross(forward, [0.0, 0.0, 1.0]));
    let up = cross(right, forward);
    let tangent = (FOV_DEG / 2.0).to_radians().tan();
    let at = |i: u32| (f64::from(2 * i + 1) / f64::from(PIXELS) - 1.0) * tangent;
    let (mut sum, mut far, mut count) = (0.0, 0.0, 0.0);
    let (depths, normals) = (image.depth.unwrap(), image.normals.unwrap());
    for (i, (depth, code)) in (0..).zip(depths.iter().zip(normals.as_chunks::<3>().0)) {
        if *depth == 0 {
            continue;
        }
        let part = f64::from(*depth - 1) / 65_534.0;
        let t = report.depth_near_mm + part * (report.depth_far_mm - report.depth_near_mm);
        let (u, v) = (at(i % PIXELS), -at(i / PIXELS));
        let point = std::array::from_fn(|a| eye[a] + t * (forward[a] + u * right[a] + v * up[a]));
        let normal = unit(code.map(|c| (f64::from(c) - 128.0) / 127.0));
        let angle = dot(normal, body.normal(point)).clamp(-1.0, 1.0).acos().to_degrees();
        sum += angle;
        far += f64::from(u8::from(angle > 15.0));
        count += 1.0;
    }
    assert!(count > 3000.0, "{count}");
    (sum / count, 100.0 * far / count)
}

/// Body, scan, most degrees in the mean, most percent beyond 15 degrees, and what part of the error of the stored normals is
/// left at most. At 128 samples and 640 pixels the errors are smaller; the box has more pixels on its edges here.
const ROWS: [(&str, usize, Scan, f64, f64, f64); 5] = [
    ("ball", 0, CLEAN, 0.5, 0.1, 1.05),
    ("ball, 2.5 % noise", 0, NOISY, 0.9, 0.1, 0.8),
    ("torus", 1, CLEAN, 0.8, 0.3, 0.9),
    ("torus, slices 6 x", 1, THICK, 6.5, 10.0, 1.0),
    ("box", 2, CLEAN, 3.6, 8.0, 1.05),
];

#[test]
fn shown_normals_are_smooth_where_the_surface_is_and_sharp_where_it_is_not() {
    let bodies = Body::all(f64::from(SIDE));
    let mut failed = Vec::new();
    for (name, at, how, mean, share, part) in ROWS {
        let stored = shown(&bodies[at].1, how, Smoothing::Stored);
        let smooth = shown(&bodies[at].1, how, Smoothing::Smooth);
        println!("{name}: stored {stored:.2?}, shown {smooth:.2?}");
        if smooth.0 > mean || smooth.1 > share || smooth.0 > part * stored.0 {
            failed.push(format!("{name}: stored {stored:.2?}, shown {smooth:.2?}"));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}
