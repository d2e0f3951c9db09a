//! Descriptions become volumes, and samples agree with the true surface.

use super::*;
use crate::volume::ScalarType;

fn densities(volume: &AnalyticVolume) -> Vec<f64> {
    let info = volume.info();
    let [nx, ny, nz] = info.dims.to_array();
    let width = info.scalar.bytes();
    let mut row = vec![0; nx as usize * width];
    let mut all = Vec::new();
    for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
        volume.read_rows(z, y..y + 1, 0..nx, &mut row).unwrap();
        all.extend(row.chunks_exact(width).map(|b| {
            let sample = match info.scalar {
                ScalarType::U8 => f64::from(b[0]),
                ScalarType::U16 => f64::from(bytemuck::pod_read_unaligned::<u16>(b)),
                _ => f64::from(bytemuck::pod_read_unaligned::<f32>(b)),
            };
            info.rescale.apply(sample)
        }));
    }
    all
}

#[test]
fn every_body_is_inside_where_its_distance_says_so() {
    for name in spec::bodies() {
        for (n, keys) in
            [(24, ""), (20, "?bits=8"), (20, "?bits=32"), (16, "?sample=binary"), (1, ""), (3, "")]
        {
            let text = format!("synthetic:{name}@{n}{keys}");
            let volume = analytic(&text).unwrap();
            let all = densities(&volume);
            let [nx, ny, _] = volume.dims().to_array().map(|n| n as usize);
            for (i, density) in all.iter().enumerate() {
                let at = [i % nx, i / nx % ny, i / nx / ny].map(|c| c as f64);
                let true_distance = volume.surface_at(at).distance;
                // A place within the rounding of the surface may fall to either side.
                let slack = if keys == "?bits=8" { 0.05 } else { 0.01 };
                let inside = *density >= 0.5;
                assert!(
                    inside == (true_distance <= 0.0) || true_distance.abs() < slack,
                    "{text} {at:?}: {density} at {true_distance}"
                );
            }
        }
    }
}

#[test]
fn densities_follow_the_distance_to_the_surface() {
    let volume = analytic("synthetic:sphere@48?psf=0.8").unwrap();
    let mut between = 0;
    for (i, density) in densities(&volume).iter().enumerate() {
        let at = [i % 48, i / 48 % 48, i / 48 / 48].map(|c| c as f64);
        let share = math::share_below(-volume.surface_at(at).distance / 0.8);
        assert!((density - share).abs() < 2e-5, "{at:?}");
        between += usize::from((0.1..0.9).contains(density));
    }
    assert!(between > 5000, "{between}");
    // Noise: its amount, its repetition, and its change with the seed.
    let noisy =
        |seed: u32| densities(&analytic(&format!("synthetic:sphere@32?noise=0.05,seed={seed}")).unwrap());
    let (one, again, other) = (noisy(1), noisy(1), noisy(2));
    let clean = densities(&analytic("synthetic:sphere@32").unwrap());
    let deviation = |a: &[f64]| {
        let squares: f64 = a.iter().zip(&clean).map(|(a, b)| (a - b) * (a - b)).sum();
        (squares / a.len() as f64).sqrt()
    };
    assert!(one == again && one != other);
    assert!((deviation(&one) - 0.05).abs() < 0.001, "{}", deviation(&one));
}

#[test]
fn thick_slices_average_what_thin_ones_would_show() {
    let thin = densities(&analytic("synthetic:torus@48?bits=32").unwrap());
    let thick = analytic("synthetic:torus@48?bits=32,spacing=1x1x6,slab=1").unwrap();
    assert_eq!((thick.dims().to_array(), thick.info().spacing_mm), ([48, 48, 8], [1.0, 1.0, 6.0]));
    let slice = 48 * 48;
    for (i, density) in densities(&thick).iter().enumerate() {
        let (z, at) = (i / slice, i % slice);
        let mean = (0..6).map(|k| thin[(6 * z + k) * slice + at]).sum::<f64>() / 6.0;
        // Six points represent twelve: the rest is the rule's error at a blur of 0.8.
        assert!((density - mean).abs() < 5e-3, "{i}: {density} {mean}");
    }
}

#[test]
fn samples_do_not_depend_on_how_they_are_read() {
    let volume = analytic("synthetic:gyroid@20x17x5?noise=0.1,bits=12").unwrap();
    let whole = {
        let mut out = vec![0; 20 * 17 * 2];
        volume.read_rows(3, 0..17, 0..20, &mut out).unwrap();
        out
    };
    let mut part = vec![0; 5 * 4 * 2];
    volume.read_rows(3, 6..11, 9..13, &mut part).unwrap();
    for (y, row) in part.chunks(8).enumerate() {
        let at = ((6 + y) * 20 + 9) * 2;
        assert_eq!(row, &whole[at..at + 8]);
    }
    volume.read_rows(0, 2..2, 0..20, &mut []).unwrap();
    volume.read_rows(0, 2..3, 5..5, &mut []).unwrap();
}

#[test]
fn rays_enter_bodies_where_their_distance_vanishes() {
    for name in ["sphere", "ellipsoid", "torus", "box", "slab", "gyroid", "menger"] {
        let volume = analytic(&format!("synthetic:{name}@64")).unwrap();
        let (body, mut hits) = (volume.body(), 0);
        for i in 0..400 {
            let across = [f64::from(i % 20) * 3.2, f64::from(i / 20) * 3.2];
            let (origin, direction) = ([across[0], across[1], -20.0], [0.03, -0.02, 1.0]);
            let t = body.cast(origin, direction, 200.0);
            // A body that fills the volume is also present where the ray begins.
            if let Some(t) = t.filter(|t| *t > 0.0) {
                hits += 1;
                let d = math::unit(direction);
                let at = crate::geom::add_scaled(origin, t, d);
                assert!(body.surface(at).distance.abs() < 1e-6, "{name} {i}: {:?}", body.surface(at));
            }
        }
        assert!(hits > 40, "{name}: {hits}");
    }
    let sphere = analytic("synthetic:sphere@64?radius=20").unwrap();
    let t = sphere.body().cast([32.17, 31.69, -10.0], [0.0, 0.0, 2.0], 100.0).unwrap();
    assert!((t - (32.43 - 20.0 + 10.0)).abs() < 1e-8, "{t}");
    assert_eq!(sphere.body().cast([0.0, 0.0, -10.0], [0.0, 0.0, 1.0], 100.0), None);
}
