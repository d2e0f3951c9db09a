//! Normals where faces meet.

use super::{build_to, exact, options, parsed, skin_of};
use crate::prelude::*;

/// Taken from one face only, normals of edge voxels would change from voxel to voxel: edges would look dotted.
#[test]
fn faces_that_meet_in_a_voxel_share_its_normal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let near = |n: [f32; 3], want: [f32; 3]| {
        let length = |v: [f32; 3]| v.iter().map(|c| c * c).sum::<f32>().sqrt();
        let cosine: f32 = (0..3).map(|k| n[k] * want[k]).sum::<f32>() / length(n) / length(want);
        assert!(cosine > 0.9995, "{n:?} {want:?}");
    };
    // A box, alone and as a box from which half-spaces were cut: edges face both ways, corners three.
    let cut = "difference() { multmatrix([[1,0,0,8],[0,1,0,8],[0,0,1,8],[0,0,0,1]]) cube([16, 16, 40]); \
               multmatrix([[1,0,0,0],[0,1,0,0],[0,0,1,24],[0,0,0,1]]) halfspace([0, 0, -1], 0); }";
    let whole = "multmatrix([[1,0,0,8],[0,1,0,8],[0,0,1,8],[0,0,0,1]]) cube([16, 16, 16]);";
    for text in [whole, cut] {
        build_to(parsed(text), &exact([32; 3]), &options(16, 1), &path).unwrap();
        for (voxel, n) in skin_of(&Model::open(&path).unwrap()) {
            let want = voxel.map(|c| {
                if c == 8 {
                    -1.0
                } else if c == 23 {
                    1.0
                } else {
                    0.0
                }
            });
            near(n, want);
        }
    }
    // A turned box: normals of an edge lie between those of its faces, and hardly change along it.
    let text = "multmatrix([[0.8,-0.6,0,32],[0.6,0.8,0,32],[0,0,1,8],[0,0,0,1]]) cube([20, 20, 48]);";
    build_to(parsed(text), &exact([64; 3]), &options(16, 1), &path).unwrap();
    let edge = skin_of(&Model::open(&path).unwrap());
    let mut edge = edge.into_iter().filter(|(v, _)| {
        let p = [f64::from(v[0]) + 0.5 - 32.0, f64::from(v[1]) + 0.5 - 32.0];
        (12..52).contains(&v[2]) && p[0] * p[0] + p[1] * p[1] < 1.2
    });
    let (_, first) = edge.next().unwrap();
    let [a, b] = [[-0.8, -0.6], [0.6, -0.8]];
    let along = |n: [f32; 3], f: [f32; 2]| n[0] * f[0] + n[1] * f[1];
    assert!(along(first, a) > 0.1 && along(first, b) > 0.1, "{first:?}");
    edge.filter(|(v, _)| v[0] == 32).for_each(|(_, n)| assert!(along(n, a) > -1e-3 && along(n, b) > -1e-3));
    // A thin wall has two sides, and each of its voxels one of them.
    let text = "multmatrix([[0.8,-0.6,0,16],[0.6,0.8,0,16],[0,0,1,0],[0,0,0,1]]) cube([1.2, 30, 64], center = true);";
    build_to(parsed(text), &exact([32; 3]), &options(16, 1), &path).unwrap();
    for (voxel, n) in skin_of(&Model::open(&path).unwrap()) {
        if (10..22).contains(&voxel[0]) && (10..22).contains(&voxel[1]) {
            assert!(along(n, [0.8, 0.6]).abs() > 0.999, "{voxel:?} {n:?}");
        }
    }
}
