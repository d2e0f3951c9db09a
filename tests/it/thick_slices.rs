//! A head with slices eleven times as thick as its pixels is as smooth as its samples allow: hits of rays on cells
//! against the trilinear interpolation of the same samples, whose surface is sought along each ray. If this fails,
//! clinical series look like stairs, or thin bone is filled up or lost. Skipped where the real data is not there.
//!
//! The goal is 0.2 % and 0.3 voxel. Measured: skin 0.05 % and 0.20 voxel (skin voxels 0.81 % and 23), bone 0.18 % and
//! 0.29 (2.1 % and 320). With a plane in every cell that a plane separates it would be 0.18 % and 0.85, 0.44 % and 1.9:
//! cells are eleven times as long as wide, and the surface bends within them.

use crate::prelude::*;

/// The samples of a volume as depths inside the threshold.
struct Samples {
    depth: Vec<f64>,
    dims: [i64; 3],
    to_index: Affine,
    to_world: Affine,
}

impl Samples {
    fn read(volume: &dyn VolumeSource, threshold: f64) -> Self {
        let info = volume.info();
        let [nx, ny, nz] = info.dims.to_array();
        let mut bytes = vec![0; nx as usize * ny as usize * 2];
        let mut depth = Vec::new();
        for z in 0..nz {
            volume.read_rows(z, 0..ny, 0..nx, &mut bytes).unwrap();
            let samples = bytes.as_chunks().0.iter().map(|b| f64::from(u16::from_le_bytes(*b)));
            depth.extend(samples.map(|v| info.rescale.apply(v) - threshold));
        }
        let to_world = info.affine;
        Self { depth, dims: [nx, ny, nz].map(i64::from), to_index: to_world.inverse().unwrap(), to_world }
    }

    /// What lies beyond the volume is as far outside as the border is inside.
    fn at(&self, p: [i64; 3]) -> f64 {
        let [x, y, z]: [i64; 3] = std::array::from_fn(|a| p[a].clamp(0, self.dims[a] - 1));
        let depth = self.depth[usize::try_from((z * self.dims[1] + y) * self.dims[0] + x).unwrap()];
        if [x, y, z] == p { depth } else { -depth.abs() - 0.5 }
    }

    /// Where a ray (in index coordinates) first is inside.
    #[expect(clippy::cast_possible_truncation, reason = "within the volume")]
    fn first_hit(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<f64> {
        let place = |t: f64| -> [f64; 3] { std::array::from_fn(|a| origin[a] + t * direction[a]) };
        let (mut t, mut end) = (0.0_f64, f64::MAX);
        for a in 0..3 {
            let at = |plane: f64| (plane - origin[a]) / direction[a];
            let (first, last) = (at(-1.0), at(self.dims[a] as f64));
            (t, end) = (t.max(first.min(last)), end.min(first.max(last)));
        }
        while t < end {
            let next = (0..3)
                .map(|a| {
                    let p = place(t)[a] + 1e-9 * direction[a].signum();
                    let plane = if direction[a] > 0.0 { p.floor() + 1.0 } else { p.ceil() - 1.0 };
                    (plane - origin[a]) / direction[a]
                })
                .fold(end, f64::min);
            let low = place((t + next) / 2.0).map(|c| c.floor() as i64);
            let corners: [f64; 8] =
                std::array::from_fn(|c| self.at(std::array::from_fn(|a| low[a] + (c >> a & 1) as i64)));
            if corners.iter().any(|c| *c >= 0.0) {
                let value = |t: f64| {
                    let p = place(t);
                    let u: [f64; 3] = std::array::from_fn(|a| p[a] - low[a] as f64);
                    let weight = |c: usize| {
                        (0..3).map(|a| if c >> a & 1 == 1 { u[a] } else { 1.0 - u[a] }).product::<f64>()
                    };
                    (0..8).map(|c| weight(c) * corners[c]).sum::<f64>()
                };
                let steps = 24;
                let at = |k: u32| t + (next - t) * f64::from(k) / f64::from(steps);
                if let Some(k) = (0..=steps).find(|k| value(at(*k)) >= 0.0) {
                    let (mut outside, mut inside) = (at(k.saturating_sub(1)), at(k));
                    for _ in 0..40 {
                        let middle = (outside + inside) / 2.0;
                        if value(middle) >= 0.0 { inside = middle } else { outside = middle }
                    }
                    return Some(inside);
                }
            }
            t = next.max(t + 1e-9);
        }
        None
    }
}

/// Of rays from three sides: wrong ones in percent of the reference's hits; then of the distance along the ray, in
/// voxels of the finest spacing, the 99th percentile and the mean.
fn compare(volume: &dyn VolumeSource, threshold: f64, surface: SurfaceKind) -> [f64; 3] {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("head.oct");
    let options = BuildOptions {
        threshold: Threshold::Iso(threshold),
        surface: Some(surface),
        ..BuildOptions::default()
    };
    infobyte::build(volume, &options, &path).unwrap();
    let model = Model::open(&path).unwrap();
    let caster = RayCaster::new(&model).unwrap();
    let samples = Samples::read(volume, threshold);
    let middle = samples.to_world.apply(samples.dims.map(|n| (n - 1) as f64 / 2.0));
    let finest = volume.info().spacing_mm.into_iter().fold(f64::MAX, f64::min);
    let (mut wrong, mut hits, mut off) = (0_u32, 0_u32, Vec::new());
    for side in [[0.31, -0.88, 0.25], [0.85, 0.43, -0.3], [-0.23, 0.31, 0.92]] {
        let (back, pixels) = (unit(side), 150_u32);
        let right = unit(cross(back, [0.1, 0.2, 0.97]));
        let up = cross(right, back);
        let eye: [f64; 3] = std::array::from_fn(|a| middle[a] + 500.0 * back[a]);
        for v in 0..pixels {
            for u in 0..pixels {
                let at = |i: u32| (f64::from(2 * i + 1) / f64::from(pixels) - 1.0) * 0.24;
                let d = unit(std::array::from_fn(|a| -back[a] + at(u) * right[a] + at(v) * up[a]));
                let want = samples.first_hit(samples.to_index.apply(eye), samples.to_index.apply_vector(d));
                let got = caster.first_hit(eye, d).unwrap().map(|hit| hit.t);
                hits += u32::from(want.is_some());
                wrong += u32::from(want.is_some() != got.is_some());
                if let (Some(want), Some(got)) = (want, got) {
                    off.push((want - got).abs() / finest);
                }
            }
        }
    }
    off.sort_by(f64::total_cmp);
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    [100.0 * f64::from(wrong) / f64::from(hits), off[off.len() * 99 / 100], mean]
}

fn check(name: &str, threshold: f64) {
    let Some(path) = data::real_data("ct-philips-28") else { return };
    let volume = infobyte::open(path).unwrap();
    let [wrong, p99, mean] = compare(&*volume, threshold, SurfaceKind::Cells);
    println!("{name}: cells wrong {wrong:.3} %, depth p99 {p99:.3}, mean {mean:.4} voxel");
    let [skin_wrong, skin_p99, skin_mean] = compare(&*volume, threshold, SurfaceKind::Skin);
    println!("{name}: voxels wrong {skin_wrong:.3} %, depth p99 {skin_p99:.3}, mean {skin_mean:.4} voxel");
    assert!(wrong <= 0.2 && p99 <= 0.3, "{name}: {wrong} % {p99}");
}

#[test]
fn the_skin_of_a_head_of_thick_slices_is_where_interpolation_puts_it() {
    check("skin", -300.0);
}

#[test]
fn the_bone_of_a_head_of_thick_slices_is_where_interpolation_puts_it() {
    check("bone", 300.0);
}
