//! Bodies whose surface is known, sampled as a scanner would.

use infobyte::geom::{Affine, Dims};
use infobyte::volume::Voxels;

use super::random::Random;
use super::vectors::dot;

/// A closed body, by the signed distance of a point from its surface (below 0 inside), in voxels of the finest
/// spacing.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Body {
    /// Middle, radius.
    Ball([f64; 3], f64),
    /// Middle, unit axis, radius of the ring and of its tube.
    Torus([f64; 3], [f64; 3], f64, f64),
    /// Middle, rows of a rotation, half edges.
    Box([f64; 3], [[f64; 3]; 3], [f64; 3]),
}

fn length(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

impl Body {
    /// The ball, the torus and the turned box of the tables, in a cube of n voxels.
    pub(crate) fn all(n: f64) -> [(&'static str, Self); 3] {
        let c = [n * 0.5 + 0.13, n * 0.5 - 0.29, n * 0.5 + 0.41];
        let axis = [0.36, 0.48, 0.8];
        let (a, b) = (0.6_f64, 0.35_f64);
        let turn_z = [[a.cos(), -a.sin(), 0.0], [a.sin(), a.cos(), 0.0], [0.0, 0.0, 1.0]];
        let turn_x = [[1.0, 0.0, 0.0], [0.0, b.cos(), -b.sin()], [0.0, b.sin(), b.cos()]];
        let rows = std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..3).map(|k| turn_x[i][k] * turn_z[k][j]).sum())
        });
        [
            ("ball", Self::Ball(c, 0.38 * n)),
            ("torus", Self::Torus(c, axis, 0.27 * n, 0.12 * n)),
            ("box", Self::Box(c, rows, [0.3 * n, 0.23 * n, 0.18 * n])),
        ]
    }

    pub(crate) fn distance(&self, p: [f64; 3]) -> f64 {
        let from = |c: [f64; 3]| -> [f64; 3] { std::array::from_fn(|a| p[a] - c[a]) };
        match *self {
            Self::Ball(c, r) => length(from(c)) - r,
            Self::Torus(c, axis, ring, tube) => {
                let q = from(c);
                let along = dot(q, axis);
                let across = (dot(q, q) - along * along).max(0.0).sqrt();
                (across - ring).hypot(along) - tube
            }
            Self::Box(c, rows, half) => {
                let q: [f64; 3] = rows.map(|row| dot(row, from(c)));
                let over: [f64; 3] = std::array::from_fn(|a| q[a].abs() - half[a]);
                let inner = over[0].max(over[1]).max(over[2]).min(0.0);
                length(over.map(|v| v.max(0.0))) + inner
            }
        }
    }

    /// Outward unit normal.
    pub(crate) fn normal(&self, p: [f64; 3]) -> [f64; 3] {
        let h = 1e-5;
        let g: [f64; 3] = std::array::from_fn(|a| {
            let moved =
                |s: f64| self.distance(std::array::from_fn(|b| if a == b { p[b] + s * h } else { p[b] }));
            moved(1.0) - moved(-1.0)
        });
        let l = length(g);
        g.map(|c| c / l)
    }

    /// Where a ray first meets the body, by steps of the distance; the direction has length 1.
    pub(crate) fn first_hit(&self, origin: [f64; 3], direction: [f64; 3], most: f64) -> Option<f64> {
        let mut t = 0.0;
        for _ in 0..2000 {
            let d = self.distance(std::array::from_fn(|a| origin[a] + t * direction[a]));
            if d < 1e-9 {
                return Some(t);
            }
            t += d;
            if t > most {
                return None;
            }
        }
        Some(t)
    }
}

/// How a body becomes samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scan {
    /// Standard deviation of the point spread, in voxels; 0 for two values.
    pub(crate) spread: f64,
    /// Slices this many times as thick as pixels, averaged over their thickness.
    pub(crate) thick: u32,
    /// Standard deviation of noise, as a part of the contrast.
    pub(crate) noise: f64,
}

/// Half of the contrast above which a sample is inside.
pub(crate) const ISO: f64 = 10_000.0;

/// Integral of the normal distribution (Abramowitz and Stegun 7.1.26 is not fine enough; a series and a continued
/// fraction are).
fn cumulative(x: f64) -> f64 {
    if x.abs() > 8.0 {
        return if x > 0.0 { 1.0 } else { 0.0 };
    }
    let (mut term, mut sum) = (x, x);
    for k in 1..200 {
        term *= x * x / f64::from(2 * k + 1);
        sum += term;
        if term.abs() < 1e-17 {
            break;
        }
    }
    0.5 + sum * (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt()
}

/// Samples a body in a cube of n voxels of the finest spacing; the middle of the first voxel is the origin, and
/// world coordinates are those voxels (along z moved by half a thick slice).
pub(crate) fn scan(body: &Body, n: u32, how: Scan) -> Voxels<u16> {
    let slices = n / how.thick;
    let dims = Dims::new(n, n, slices).unwrap();
    let mut random = Random(0x5eed);
    let parts = if how.thick > 1 { 2 * how.thick } else { 1 };
    let density = |p: [f64; 3]| {
        let d = body.distance(p);
        if how.spread > 0.0 { cumulative(-d / how.spread) } else { f64::from(u8::from(d <= 0.0)) }
    };
    let thick = f64::from(how.thick);
    let voxels = Voxels::from_fn(dims, |[x, y, z]| {
        let (x, y) = (f64::from(x), f64::from(y));
        let first = thick * f64::from(z);
        // A slab from `first` on, in the middle of each of its parts.
        let sum: f64 = (0..parts)
            .map(|k| density([x, y, first + (f64::from(k) + 0.5) * thick / f64::from(parts) - 0.5]))
            .sum();
        let even: f64 = (0..12).map(|_| if how.noise > 0.0 { random.unit() } else { 0.5 }).sum::<f64>() - 6.0;
        let v = 2.0 * ISO * (sum / f64::from(parts) + how.noise * even) + 5000.0 * lift(how);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts saturate")]
        {
            v.round() as u16
        }
    });
    let mut affine = Affine::from_spacing([1.0, 1.0, thick]);
    affine.rows[2][3] = (thick - 1.0) / 2.0;
    voxels.placed(affine)
}

/// The threshold of [`scan`].
pub(crate) fn iso(how: Scan) -> f64 {
    ISO + 5000.0 * lift(how)
}

/// Noise is added above a floor, so that nothing is cut off at 0.
fn lift(how: Scan) -> f64 {
    if how.noise > 0.0 { 1.0 } else { 0.0 }
}
