//! Normals as they are stored in a finished file, against the true normals of analytic solids.
//!
//! Would break: a worse gradient kernel, a swapped axis, a lost spacing, an inward sign, normals that
//! stand at the wrong voxels, a coarser quantiser. The figures are mean and 99th percentile of the
//! angle, in degrees, between the stored normal and the true one at the voxel's centre, over all skin
//! voxels; the gates are those set for the default estimator before it was chosen, and apply **after**
//! quantisation to 16 bits (0.31 degrees on its own).
//!
//! Run with `--nocapture` for the table.

use std::ops::Range;

use infobyte::build::{BuildOptions, Connectivity, Silent, Threshold, build};
use infobyte::format::normal;
use infobyte::geom::{Affine, Dims, morton};
use infobyte::load::{Model, NodeView};
use infobyte::source::{Rescale, ScalarType, SourceDescription, SourceError, VolumeInfo, VolumeSource};

/// A volume held in memory.
struct Held {
    info: VolumeInfo,
    samples: Vec<u8>,
}

impl Held {
    /// Samples `value(x, y, z)` of type `scalar`.
    fn new<T: bytemuck::Pod>(
        dims: [u32; 3],
        spacing_mm: [f64; 3],
        scalar: ScalarType,
        value: impl Fn([u32; 3]) -> T,
    ) -> Self {
        assert_eq!(size_of::<T>(), scalar.bytes());
        let [nx, ny, nz] = dims;
        let mut samples = Vec::new();
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    samples.extend(bytemuck::bytes_of(&value([x, y, z])));
                }
            }
        }
        let info = VolumeInfo {
            dims: Dims::new(nx, ny, nz).unwrap(),
            scalar,
            rescale: Rescale::IDENTITY,
            spacing_mm,
            affine: Affine::from_spacing(spacing_mm),
            description: SourceDescription::default(),
            warnings: Vec::new(),
        };
        Self { info, samples }
    }
}

impl VolumeSource for Held {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn read_rows(
        &self,
        z: u32,
        rows: Range<u32>,
        cols: Range<u32>,
        out: &mut [u8],
    ) -> Result<(), SourceError> {
        let [nx, ny, _] = self.info.dims.to_array().map(|n| n as usize);
        let width = self.info.scalar.bytes();
        for (y, row) in rows.zip(out.chunks_mut(cols.len() * width)) {
            let from = ((z as usize * ny + y as usize) * nx + cols.start as usize) * width;
            row.copy_from_slice(&self.samples[from..from + row.len()]);
        }
        Ok(())
    }
}

/// Every skin voxel of the finished file with its stored normal.
fn stored_normals(volume: &Held, iso: f64) -> Vec<([u32; 3], [f64; 3])> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.oct");
    let options = BuildOptions {
        threshold: Threshold::Iso(iso),
        connectivity: Connectivity::Thin26,
        normals: true,
        values: false,
        lod: false,
        memory_bytes: 1 << 30,
        threads: 2,
        scratch: None,
    };
    build(volume, &options, &path, &Silent).unwrap();
    let model = Model::open(&path).unwrap();
    let view = model.view();
    // Breadth first, so that the last level comes out as voxels 0, 1, ... in Morton order.
    let mut level = vec![(0_u64, 0_u64)];
    for _ in 0..view.depth() {
        level = level
            .into_iter()
            .flat_map(|(node, code)| (0..8).map(move |octant| (node, octant, code << 3 | u64::from(octant))))
            .filter_map(|(node, octant, code)| view.child(node, octant).map(|child| (child, code)))
            .collect();
    }
    level
        .into_iter()
        .enumerate()
        .map(|(i, (number, code))| {
            let voxel = number - view.node_count();
            assert_eq!(voxel, i as u64);
            let stored = normal::decode(view.voxel_normal(voxel).unwrap());
            (position(code), stored.map(f64::from))
        })
        .collect()
}

/// Voxel of a Morton code, bit by bit (an oracle apart from the library's).
fn position(code: u64) -> [u32; 3] {
    let axis = |a: u32| (0..16).fold(0_u32, |p, bit| p | u32::from(code >> (3 * bit + a) & 1 == 1) << bit);
    let at = [axis(0), axis(1), axis(2)];
    assert_eq!(morton::encode(at[0], at[1], at[2]), code);
    at
}

#[derive(Debug)]
struct Errors {
    mean: f64,
    p99: f64,
    worst: f64,
}

/// Angles between stored and true normals, in degrees; `truth` gives any outward vector, or `None`
/// for a voxel that is left out.
fn errors(name: &str, volume: &Held, iso: f64, truth: impl Fn([u32; 3]) -> Option<[f64; 3]>) -> Errors {
    let mut angles: Vec<f64> = stored_normals(volume, iso)
        .into_iter()
        .filter_map(|(at, stored)| truth(at).map(|t| angle_degrees(stored, t)))
        .collect();
    assert!(angles.len() > 4000, "{name}: only {} skin voxels", angles.len());
    angles.sort_by(f64::total_cmp);
    let e = Errors {
        mean: angles.iter().sum::<f64>() / angles.len() as f64,
        p99: angles[angles.len() * 99 / 100],
        worst: angles[angles.len() - 1],
    };
    println!("{name:28} {:6} voxels  mean {:.3}  p99 {:.3}  max {:.3}", angles.len(), e.mean, e.p99, e.worst);
    assert!(e.worst < 90.0, "{name}: an inward normal");
    e
}

fn angle_degrees(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let sine = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
    sine.atan2(a.iter().zip(b).map(|(x, y)| x * y).sum()).to_degrees()
}

/// Share of a Gaussian below `t` standard deviations, by Simpson's rule.
fn gaussian_share(t: f64) -> f64 {
    let (t, steps) = (t.clamp(-8.0, 8.0), 64);
    let width = t / f64::from(steps);
    let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let sum: f64 = (0..=steps)
        .map(|i| {
            let weight = if i == 0 || i == steps {
                1.0
            } else if i % 2 == 1 {
                4.0
            } else {
                2.0
            };
            weight * density(width * f64::from(i))
        })
        .sum();
    0.5 + sum * width / 3.0
}

/// Air, and the step from air to body, in grey levels.
const AIR: f64 = 1000.0;
const STEP: f64 = 2000.0;

/// A ball blurred by a Gaussian of `sigma` mm (exact: planar share plus the curvature term), centred
/// off the grid.
struct Ball {
    centre: [f64; 3],
    radius: f64,
    spacing: [f64; 3],
}

impl Ball {
    fn new(radius: f64, spacing: [f64; 3]) -> Self {
        let centre = [0.17, -0.31, 0.43];
        let centre = [0, 1, 2].map(|a| ((radius / spacing[a]).ceil() + 5.0 + centre[a]) * spacing[a]);
        Self { centre, radius, spacing }
    }

    fn dims(&self) -> [u32; 3] {
        [0, 1, 2].map(|a| 2 * ((self.radius / self.spacing[a]).ceil() as u32 + 5) + 1)
    }

    fn from_centre(&self, at: [u32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|a| f64::from(at[a]) * self.spacing[a] - self.centre[a])
    }

    fn distance(&self, at: [u32; 3]) -> f64 {
        self.from_centre(at).iter().map(|c| c * c).sum::<f64>().sqrt()
    }

    fn blurred(&self, at: [u32; 3], sigma: f64) -> f64 {
        let r = self.distance(at).max(1e-6);
        let t = (self.radius - r) / sigma;
        let curvature = sigma / (r * std::f64::consts::TAU.sqrt()) * (-0.5 * t * t).exp();
        AIR + STEP * (gaussian_share(t) - curvature)
    }

    fn grey(&self, noise: f64) -> Held {
        Held::new(self.dims(), self.spacing, ScalarType::U16, |at| {
            let value = self.blurred(at, 0.8) + noise * STEP * gaussian_noise(at);
            value.round().clamp(0.0, 65535.0) as u16
        })
    }
}

/// A normally distributed value of each voxel, fixed: twelve uniform halves of a hash.
fn gaussian_noise([x, y, z]: [u32; 3]) -> f64 {
    let mut state = u64::from(x) | u64::from(y) << 20 | u64::from(z) << 40;
    let sum: f64 = (0..12)
        .map(|_| {
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut h = (state ^ state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            h = (h ^ h >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((h ^ h >> 31) >> 11) as f64 / (1_u64 << 53) as f64
        })
        .sum();
    sum - 6.0
}

#[test]
fn a_clean_blurred_ball_is_limited_by_the_quantiser_alone() {
    for radius in [40.0, 20.0] {
        let ball = Ball::new(radius, [1.0; 3]);
        let name = format!("ball R={radius}");
        let e = errors(&name, &ball.grey(0.0), AIR + STEP / 2.0, |at| Some(ball.from_centre(at)));
        assert!(e.mean <= 0.40 && e.p99 <= 0.65, "{e:?}");
        // The code's own worst case is 0.64; the gradient may add a few hundredths.
        assert!(e.worst <= 0.72, "{e:?}");
    }
}

#[test]
fn noise_of_two_and_a_half_percent_is_averaged_out() {
    let ball = Ball::new(40.0, [1.0; 3]);
    let e = errors("ball R=40, 2.5 % noise", &ball.grey(0.025), AIR + STEP / 2.0, |at| {
        Some(ball.from_centre(at))
    });
    assert!(e.mean <= 0.85 && e.p99 <= 2.1, "{e:?}");
}

#[test]
fn a_binary_ball_keeps_its_mean_but_not_its_percentile() {
    let ball = Ball::new(40.0, [1.0; 3]);
    let volume =
        Held::new(ball.dims(), [1.0; 3], ScalarType::U8, |at| u8::from(ball.distance(at) <= ball.radius));
    let e = errors("ball R=40, binary", &volume, 0.5, |at| Some(ball.from_centre(at)));
    assert!(e.mean <= 4.2, "{e:?}");
    // The wish was 10. No linear 5x5x5 kernel that was found has it together with 12 degrees on
    // Marschner-Lobb 80^3 (best 10.7 of all kernels with the cube's symmetry), so this is what the
    // default has, held against getting worse.
    assert!(e.p99 <= 12.5, "{e:?}");
}

#[test]
fn spacing_enters_as_physical_units() {
    // Half as many slices, twice as far apart.
    let ball = Ball::new(40.0, [1.0, 1.0, 2.0]);
    let e = errors("ball R=40 mm, 1:1:2", &ball.grey(0.0), AIR + STEP / 2.0, |at| Some(ball.from_centre(at)));
    // One and a half times the bound of the isotropic ball.
    assert!(e.mean <= 1.5 * 0.40, "{e:?}");
}

/// Marschner and Lobb's test signal (1994; f_M = 6, alpha = 0.25) and minus its gradient, on -1..1.
fn marschner_lobb([x, y, z]: [f64; 3]) -> (f64, [f64; 3]) {
    use std::f64::consts::{FRAC_PI_2, PI};
    let r = (x * x + y * y).sqrt();
    let wave = 12.0 * PI * (FRAC_PI_2 * r).cos();
    let value = (1.0 - (FRAC_PI_2 * z).sin() + 0.25 * (1.0 + wave.cos())) / 2.5;
    let slope = 0.25 * -wave.sin() * 12.0 * PI * -(FRAC_PI_2 * r).sin() * FRAC_PI_2 / 2.5;
    let radial = |c: f64| if r > 0.0 { -slope * c / r } else { 0.0 };
    (value, [radial(x), radial(y), FRAC_PI_2 * (FRAC_PI_2 * z).cos() / 2.5])
}

#[test]
fn the_marschner_lobb_signal_is_resolved() {
    // Mean gate at 80^3; 160^3 is held to a quarter of it (second-order convergence is the least).
    for (n, gate) in [(80_u32, 12.0), (160, 3.0)] {
        // Samples beyond the signal's cube, so that no neighbourhood is cut; they are not counted.
        let margin = 3;
        let place =
            |at: [u32; 3]| at.map(|i| (f64::from(i) + 0.5 - f64::from(margin)) * 2.0 / f64::from(n) - 1.0);
        let volume = Held::new([n + 2 * margin; 3], [1.0; 3], ScalarType::F32, |at| {
            marschner_lobb(place(at)).0 as f32
        });
        let inside = |at: [u32; 3]| at.iter().all(|i| (margin..n + margin).contains(i));
        let e = errors(&format!("Marschner-Lobb {n}^3"), &volume, 0.5, |at| {
            inside(at).then(|| marschner_lobb(place(at)).1)
        });
        assert!(e.mean <= gate, "{e:?}");
    }
}
