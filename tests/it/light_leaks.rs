//! No ray passes from outside to a point inside, whichever surface a model has: closed bodies turned at random, and
//! noise. Rays go along axes, along diagonals and through samples exactly, and from anywhere to anywhere. If this
//! fails, models have pinholes through which light falls.
//!
//! With INFOBYTE_LONG=N so many times as many rays and orientations are tried; 63 are 10^7 rays at 1,000 orientations.
#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use crate::prelude::*;
use bodies::{Body, ISO, scan};
use infobyte::builder::Tolerance;

/// Directions whose components divide by the longest without a rest in binary: rays along them go through samples
/// exactly.
const STEPS: [[i64; 3]; 16] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, 0, 1],
    [0, 1, 1],
    [1, -1, 0],
    [1, 1, 1],
    [1, -1, 1],
    [-1, 1, 1],
    [2, 1, 0],
    [0, -1, 2],
    [4, 1, 2],
    [1, -2, 4],
    [-1, 4, 1],
    [3, 8, -5],
];

/// A body at a random orientation: a torus, a plate or a brick.
fn turned(random: &mut Random, n: f64) -> Body {
    // A rotation from four numbers.
    let q: [f64; 4] = std::array::from_fn(|_| random.unit() - 0.5);
    let l = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|c| c / l);
    let rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let c = [0; 3].map(|_: i32| n / 2.0 + random.unit() - 0.5);
    match random.below(3_u32) {
        0 => Body::Torus(c, rows[2], 0.26 * n, 0.1 * n),
        1 => Body::Box(c, rows, [0.33 * n, 0.27 * n, 0.9]),
        _ => Body::Box(c, rows, [0.3 * n, 0.24 * n, 0.16 * n]),
    }
}

fn noise(random: &mut Random) -> Voxels<u16> {
    let n = [0; 3].map(|_: i32| 8 + random.below(20_u32));
    Voxels::from_fn(Dims::new(n[0], n[1], n[2]).unwrap(), |p| {
        let border = (0..3).any(|a| p[a] == 0 || p[a] + 1 == n[a]);
        if border { 0 } else { 79 * u16::from(random.byte()) }
    })
}

/// A surface, and the bound of its larger leaves.
#[derive(Debug)]
struct Kind(SurfaceKind, Option<f64>);

const KINDS: [Kind; 4] = [
    Kind(SurfaceKind::Cells, None),
    Kind(SurfaceKind::Cells, Some(0.1)),
    Kind(SurfaceKind::Cells, Some(0.5)),
    Kind(SurfaceKind::Skin, None),
];

/// The samples of a volume by their place.
struct Samples<'a> {
    values: &'a [u16],
    dims: [u32; 3],
}

impl Samples<'_> {
    fn exists(&self, p: [i64; 3]) -> bool {
        (0..3).all(|a| (0..i64::from(self.dims[a])).contains(&p[a]))
    }

    fn is_inside(&self, p: [i64; 3]) -> bool {
        let [nx, ny, _] = self.dims.map(|n| n as usize);
        let [x, y, z] = p.map(|c| c as usize);
        self.exists(p) && f64::from(self.values[(z * ny + y) * nx + x]) >= ISO
    }

    /// Are all eight samples inside of the cell above this one along every axis?
    fn is_solid(&self, p: [i64; 3]) -> bool {
        (0..8).all(|c| self.is_inside(std::array::from_fn(|a| p[a] + (c >> a & 1))))
    }

    fn any(&self, random: &mut Random) -> [i64; 3] {
        self.dims.map(|n| i64::from(random.below(n)))
    }

    /// A ray in samples, from outside to a point inside: along one of [`STEPS`] to a sample; or from anywhere to a
    /// point that rounding does not take out of the body.
    fn ray(&self, random: &mut Random, kind: &Kind) -> Option<([f64; 3], [f64; 3])> {
        let target = self.any(random);
        if !self.is_inside(target) {
            return None;
        }
        let sign = if random.below(2_u32) == 0 { 1 } else { -1 };
        if random.below(2_u32) == 0 {
            let step = random.pick(&STEPS);
            let back = (1..80).map(|k| std::array::from_fn(|a| target[a] - sign * step[a] * k));
            let origin: [i64; 3] = back.take_while(|p| self.exists(*p)).find(|p| !self.is_inside(*p))?;
            return Some((origin.map(|c| c as f64), target.map(|c| c as f64)));
        }
        let to = match kind {
            Kind(SurfaceKind::Skin, _) => target.map(|c| c as f64 + 0.9 * (random.unit() - 0.5)),
            Kind(..) if !self.is_solid(target) => return None,
            Kind(..) => target.map(|c| c as f64 + 0.01 + 0.98 * random.unit()),
        };
        if random.below(2_u32) == 0 {
            let origin = self.any(random);
            return (!self.is_inside(origin)).then(|| (origin.map(|c| c as f64), to));
        }
        Some(([0; 3].map(|_: i32| 300.0 * (random.unit() - 0.5)), to))
            .filter(|(from, _)| !self.exists(from.map(|c| c.round() as i64)))
    }
}

/// How many of so many rays from outside to points inside pass?
fn passed(voxels: &Voxels<u16>, kind: &Kind, rays: u32, random: &mut Random) -> u32 {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let options = BuildOptions {
        threshold: Threshold::Iso(ISO),
        surface: Some(kind.0),
        error: kind.1.map(Tolerance::Voxels),
        lod: false,
        ..BuildOptions::default()
    };
    infobyte::build(voxels, &options, &path).unwrap();
    let model = Model::open(&path).unwrap();
    let view = model.view();
    let cells = view.cells().map(Cells::new);
    let samples = Samples { values: voxels.samples(), dims: voxels.info().dims.to_array() };
    // Of skin voxels samples are the middles of boxes, of cells their corners.
    let shift = if kind.0 == SurfaceKind::Cells { 1.0 } else { 0.5 };
    let (mut traced, mut passed) = (0, 0);
    while traced < rays {
        let Some((from, to)) = samples.ray(random, kind) else { continue };
        let direction: [f64; 3] = std::array::from_fn(|a| to[a] - from[a]);
        let Some(ray) = Ray::new(view.depth(), from.map(|c| c + shift), direction, 0.0).unwrap() else {
            panic!("a ray to {to:?} passes by the grid");
        };
        let hit = match &cells {
            Some(cells) => single::trace(Form::best(), &view, cells, &ray, 0).hit,
            None => single::trace(Form::best(), &view, &Skin, &ray, 0).hit,
        };
        traced += 1;
        if hit.is_none_or(|hit| hit.t > 1.0 + 1e-6) {
            println!("{kind:?}: {from:?} to {to:?} in {:?}: {hit:?}", samples.dims);
            passed += 1;
        }
    }
    passed
}

#[test]
fn no_ray_passes_from_outside_to_a_point_inside() {
    let (rays, turns) = (160_000 * long(), 16 * long());
    for kind in &KINDS {
        let mut found = 0;
        for turn in 0..turns {
            let mut random = Random(u64::from(turn));
            let body = turned(&mut random, 26.0);
            let body = scan(&body, 26, Scan { spread: 0.8, thick: 1, noise: 0.0 });
            // Cells far longer than wide keep their corners where the surface bends, next to others with planes.
            let spacing = [1.0, 1.0, if turn % 2 == 0 { 1.0 } else { 9.0 }];
            for volume in [body, noise(&mut random)] {
                let volume = volume.placed(Affine::from_spacing(spacing));
                found += passed(&volume, kind, rays.div_ceil(2 * turns), &mut random);
            }
        }
        assert_eq!(found, 0, "of {rays} rays to {kind:?}");
    }
}
