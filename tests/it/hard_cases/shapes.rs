//! What a volume may hold.

use crate::prelude::*;
use infobyte::render::selfcheck::Random;

use super::{build, dot, hard_cases, skin, unit};

fn voxels(dims: [u32; 3], inside: impl Fn([u32; 3]) -> bool) -> Voxels<u8> {
    let [x, y, z] = dims;
    Voxels::from_fn(Dims::new(x, y, z).unwrap(), |at| u8::from(inside(at)))
}

/// Builds a two-valued volume, and checks skin and normals: one of length 1 at each voxel, never into the model.
fn check(dims: [u32; 3], inside: impl Fn([u32; 3]) -> bool, name: &str) -> super::Built {
    let built = build(&voxels(dims, &inside), Threshold::Iso(1.0)).unwrap();
    assert_eq!(built.cells(), skin(dims, &inside), "{name}");
    let is_in = |at: [i64; 3]| {
        (0..3).all(|a| (0..i64::from(dims[a])).contains(&at[a])) && inside(at.map(|c| c as u32))
    };
    for (at, normal) in built.voxels() {
        let normal = normal.unwrap();
        assert!((dot(normal, normal) - 1.0).abs() < 1e-3, "{name} {at:?}: {normal:?}");
        // The sum of the directions of its open faces, where that says anything.
        let mut open = [0.0; 3];
        for (a, sign) in (0..3).flat_map(|a| [(a, 1), (a, -1)]) {
            let mut beside = at.map(i64::from);
            beside[a] += sign;
            open[a] += if is_in(beside) { 0.0 } else { sign as f64 };
        }
        assert!(dot(normal, open) > -0.02, "{name} {at:?}: {normal:?} against {open:?}");
    }
    built
}

hard_cases! {
    flat_neighbourhoods_have_a_normal:
        "Where all samples around a voxel are alike the gradient is 0, and its direction NaN or a null vector: black \
         pixels.",
        "Scrawk Marching-Cubes-On-The-GPU #1, ipyvolume #3, UnityVolumeRendering #108" => {
        // A volume that is full: the only outside is beyond its faces.
        check([16, 16, 16], |_| true, "full");
        check([16, 16, 16], |at| at[2] < 9, "a thick plate");
        // Samples that do not change across the threshold: all at least 5, and inside from 5 on.
        let flat = Voxels::from_fn(Dims::new(9, 9, 9).unwrap(), |_| 5_u16);
        let built = build(&flat, Threshold::Iso(5.0)).unwrap();
        assert_eq!(built.report.skin_voxels, 9 * 9 * 9 - 7 * 7 * 7);
        assert!(built.voxels().iter().all(|(_, n)| dot(n.unwrap(), n.unwrap()) > 0.99));
    }

    one_voxel_in_every_corner:
        "A neighbourhood that leaves the volume on three sides reads beyond it, wraps around, or gives no normal.",
        "nii2mesh #2 (reads beyond the last slice), warp #324 (faces missing on three sides)" => {
        for dims in [[1, 1, 1], [2, 2, 2], [5, 4, 3], [17, 16, 33]] {
            for corner in 0..8_u32 {
                let at: [u32; 3] = std::array::from_fn(|a| (corner >> a & 1) * (dims[a] - 1));
                let built = check(dims, |p| p == at, &format!("{dims:?} {at:?}"));
                assert_eq!((built.report.skin_voxels, built.report.nodes), (1, u64::from(built.model().dims().depth())));
            }
        }
    }

    a_full_volume_is_closed_at_its_faces:
        "What touches the volume's faces is left open there, or crashes.",
        "vedo #217, warp #324, sparse-voxel-octrees #5 (holes at the bounding box), nii2mesh #13" => {
        for dims in [[16, 16, 16], [15, 17, 9], [33, 2, 31], [64, 1, 1]] {
            let built = check(dims, |_| true, "full");
            let inner: u64 = dims.map(|n| u64::from(n.saturating_sub(2))).iter().product();
            let all: u64 = dims.map(u64::from).iter().product();
            assert_eq!(built.report.skin_voxels, all - inner, "{dims:?}");
        }
    }

    sides_of_one_voxel:
        "Volumes of a single slice, row or column: the next slice is out of bounds, or a gradient divides by their \
         extent of 0.",
        "MeshLib #119, minc-tools #112 (crashes), VisIt #703 (NaN by zero width)" => {
        for dims in [[40, 30, 1], [40, 1, 30], [1, 40, 30], [1, 1, 300], [1, 300, 1], [300, 1, 1], [2, 1, 2]] {
            check(dims, |[x, y, z]| (x * 7 + y * 5 + z * 3) % 4 != 0, &format!("{dims:?}"));
        }
    }

    sides_that_are_no_powers_of_two:
        "Padding up to the grid is taken for volume: ghosts beyond the last voxel, or its last layers are lost.",
        "anchors: the paper's own models are 451 x 315 x 450" => {
        for dims in [[3, 5, 7], [31, 32, 33], [100, 3, 65], [129, 127, 2]] {
            check(dims, |[x, y, z]| (x ^ y ^ z) & 3 != 1, &format!("{dims:?}"));
        }
    }

    every_sign_pattern_around_a_corner:
        "Of the 256 ways in which eight samples around a corner can be in or out, some are ambiguous: tables leave \
         holes between neighbours, or hit the wrong side.",
        "dualmc #1, AMReX #5704, scikit-image #8116 (ambiguous cases of marching cubes)" => {
        for pattern in 1..256_u32 {
            for low in [[3, 3, 3], [7, 7, 7], [0, 0, 0]] {
                let inside = |at: [u32; 3]| {
                    let off: [u32; 3] = std::array::from_fn(|a| at[a].wrapping_sub(low[a]));
                    off.iter().all(|o| *o < 2) && pattern >> (off[0] + 2 * off[1] + 4 * off[2]) & 1 == 1
                };
                let built = check([12, 12, 12], inside, &format!("pattern {pattern:08b} at {low:?}"));
                assert_eq!(built.report.skin_voxels, u64::from(pattern.count_ones()));
                // Rays exactly through the corner that the eight share, along every lattice direction.
                let (model, middle) = (built.model(), low.map(|c| f64::from(c) + 1.0));
                let view = model.view();
                for code in (0..27_u32).filter(|code| *code != 13) {
                    let step = [code % 3, code / 3 % 3, code / 9];
                    let direction = step.map(|s| f64::from(s) - 1.0);
                    let origin = std::array::from_fn(|a| middle[a] - 40.0 * direction[a]);
                    let ray = Ray::new(view.depth(), origin, direction, 0.0).unwrap().unwrap();
                    let Some(hit) = first_hit_sealed(&view, &ray, 0).hit else { continue };
                    assert!(inside(hit.cell), "{pattern:08b} {direction:?}");
                }
            }
        }
    }

    two_voxels_that_touch_in_an_edge_stop_rays:
        "A ray exactly through the edge that two voxels share passes between them: light through closed walls.",
        "the paper, 3.3 (the tunnel effect); gvdb-voxels #99 (gaps at bricks)" => {
        // A wall of voxels that touch in edges only, at a place where bricks of 32 meet.
        let wall = |[x, y, z]: [u32; 3]| (28..36).contains(&z) && x + y == 63;
        let built = check([64, 64, 64], wall, "a wall");
        let (model, mut random) = (built.model(), Random::new(1));
        let view = model.view();
        for i in 0..200 * long() {
            let k = f64::from(29 + i % 6);
            let along = 2.0 + f64::from(i % 60);
            // Through the edges at x + y = 64.
            let (x, y) = (along, 64.0 - along);
            let z = if i % 2 == 0 { k } else { k + random.unit() };
            let ray = Ray::new(6, [x - 70.0, y - 70.0, z], [1.0, 1.0, 0.0], 0.0).unwrap().unwrap();
            assert!(first_hit_sealed(&view, &ray, 0).hit.is_some(), "{x} {y} {z}");
        }
    }

    plates_one_voxel_thick_at_every_angle:
        "Samples in front of and behind a thin plate cancel: no normal, or one along the plate.",
        "found here: the plain kernel's gradient vanishes in the middle of a plate" => {
        let mut random = Random::new(2);
        let mut worst = 0.0_f64;
        for i in 0..100 * long() {
            let n = unit([0.0; 3].map(|_: f64| random.range(-1.0, 1.0)));
            let reach = n.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
            // As thin as a plate can be without holes.
            let inside = |at: [u32; 3]| {
                let side: f64 = (0..3).map(|a| n[a] * (f64::from(at[a]) - 11.4)).sum();
                (-0.5 * reach..0.5 * reach).contains(&side)
            };
            let built = check([24, 24, 24], inside, &format!("plate {i} {n:?}"));
            let inner = |at: [u32; 3]| at.iter().all(|c| (3..21).contains(c));
            let angles = built.voxels().into_iter().filter(|(at, _)| inner(*at)).map(|(_, normal)| {
                dot(normal.unwrap(), n).abs().clamp(0.0, 1.0).acos().to_degrees()
            });
            let angles: Vec<f64> = angles.collect();
            worst = worst.max(angles.iter().sum::<f64>() / angles.len() as f64);
        }
        println!("plates: mean angle of the worst one {worst:.1} degrees");
        // Defined and outward everywhere; how true they are is another matter, and bad for plates this thin.
        assert!(worst < 60.0, "{worst}");
    }

    the_worst_volumes_for_an_octree:
        "Checkerboards, combs, sponges and salt: every voxel is skin, parts meet late, counts overflow.",
        "ooc_svo_builder 1.6.4 (no voxels at -O3, exit code 0); percolation tests of scipy's labels" => {
        for text in [
            "synthetic:checkerboard@33?sample=binary",
            "synthetic:comb@40x40x24?sample=binary",
            "synthetic:comb@33?sample=binary,cell=3",
            "synthetic:menger@81?sample=binary,levels=4",
            "synthetic:salt@48?sample=binary,share=0.001",
            "synthetic:salt@48?sample=binary,share=0.1",
            "synthetic:salt@32?sample=binary,share=0.9",
        ] {
            let volume = analytic(text).unwrap();
            let info = volume.info();
            let inside = |at: [u32; 3]| {
                let mut sample = [0];
                volume.read_rows(at[2], at[1]..at[1] + 1, at[0]..at[0] + 1, &mut sample).unwrap();
                sample[0] == 1
            };
            let built = build(&volume, Threshold::Iso(1.0)).unwrap();
            assert_eq!(built.cells(), skin(info.dims.to_array(), inside), "{text}");
        }
    }
}
