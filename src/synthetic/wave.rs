//! Bodies below a level of a wave: the gyroid, and the signal of Marschner and Lobb (1994).

use std::f64::consts::{FRAC_PI_2, PI};

use super::body::TrueSurface;
use super::math::{Vector, minus, sin_cos};
use crate::geom::{add_scaled, dot};

/// A wave through the whole volume; inside is where its value is at most 0.
#[derive(Clone, Copy, Debug)]
pub(super) enum Wave {
    /// `sin x cos y + sin y cos z + sin z cos x`, with the angle in radians for each unit.
    Gyroid { frequency: f64 },
    /// Marschner and Lobb's signal on -1..1 across `edge`, with their parameters f_M and alpha; inside is from 1/2 on.
    MarschnerLobb { edge: Vector, frequency: f64, depth: f64 },
}

/// Iterations of the search for the nearest point; each converges by a factor of distance over radius.
const ROUNDS: u32 = 300;

impl Wave {
    /// The signal of Marschner and Lobb, within 0..1; else `None`.
    pub(super) fn signal(&self, p: Vector) -> Option<f64> {
        match self {
            Self::Gyroid { .. } => None,
            Self::MarschnerLobb { .. } => Some(0.5 - self.value_and_slope(p).0),
        }
    }

    fn value_and_slope(&self, p: Vector) -> (f64, Vector) {
        match *self {
            Self::Gyroid { frequency: w } => {
                let [[sx, cx], [sy, cy], [sz, cz]] = p.map(|c| sin_cos(w * c));
                let slope = [cx * cy - sz * sx, cy * cz - sx * sy, cz * cx - sy * sz];
                (sx * cy + sy * cz + sz * cx, slope.map(|c| w * c))
            }
            Self::MarschnerLobb { edge, frequency, depth } => {
                let q: Vector = std::array::from_fn(|a| 2.0 * p[a] / edge[a] - 1.0);
                let r = (q[0] * q[0] + q[1] * q[1]).sqrt();
                let [sin_r, cos_r] = sin_cos(FRAC_PI_2 * r);
                let [sin_wave, cos_wave] = sin_cos(2.0 * PI * frequency * cos_r);
                let [sin_z, cos_z] = sin_cos(FRAC_PI_2 * q[2]);
                let all = 2.0 * (1.0 + depth);
                let value = (1.0 - sin_z + depth * (1.0 + cos_wave)) / all;
                let outward = depth * sin_wave * 2.0 * PI * frequency * sin_r * FRAC_PI_2 / all;
                let radial = if r > 0.0 { outward / r } else { 0.0 };
                let slope = [radial * q[0], radial * q[1], -FRAC_PI_2 * cos_z / all];
                (0.5 - value, std::array::from_fn(|a| -slope[a] * 2.0 / edge[a]))
            }
        }
    }

    /// The value over the slope: a first-order distance.
    pub(super) fn first_order(&self, p: Vector) -> f64 {
        let (value, slope) = self.value_and_slope(p);
        let length = dot(slope, slope).sqrt();
        // On a crest the slope vanishes, and the surface is far away.
        value / length.max(1e-3 * self.steepest())
    }

    /// A bound of the slope's length.
    fn steepest(&self) -> f64 {
        match *self {
            Self::Gyroid { frequency } => frequency * 6.0_f64.sqrt(),
            Self::MarschnerLobb { edge, frequency, depth } => {
                let all = 2.0 * (1.0 + depth);
                let radial = depth * 2.0 * PI * frequency * FRAC_PI_2 / all;
                let upright = FRAC_PI_2 / all;
                let shortest = edge[0].min(edge[1]).min(edge[2]);
                (radial * radial + upright * upright).sqrt() * 2.0 / shortest
            }
        }
    }

    pub(super) fn safe_distance(&self, p: Vector) -> f64 {
        self.value_and_slope(p).0 / self.steepest()
    }

    /// The nearest point: alternate steps to the surface along the slope, and along the surface towards the foot of
    /// `p`.
    pub(super) fn surface(&self, p: Vector) -> TrueSurface {
        let mut foot = p;
        let mut normal = [1.0, 0.0, 0.0];
        let (mut pull, mut last) = (1.0, [0.0; 3]);
        for _ in 0..ROUNDS {
            let (value, slope) = self.value_and_slope(foot);
            let square = dot(slope, slope);
            if square == 0.0 {
                break;
            }
            let length = square.sqrt();
            normal = slope.map(|c| c / length);
            let onto = add_scaled(foot, -value / square, slope);
            let way = minus(p, onto);
            let next = add_scaled(onto, pull, add_scaled(way, -dot(way, normal), normal));
            let moved = minus(next, foot);
            foot = next;
            if dot(moved, moved) < 1e-24 {
                break;
            }
            // Where the surface bends sharply, full steps oscillate: smaller ones converge.
            if dot(moved, last) < 0.0 {
                pull *= 0.75;
            }
            last = moved;
        }
        let way = minus(p, foot);
        let distance = dot(way, way).sqrt();
        let inside = self.value_and_slope(p).0 <= 0.0;
        TrueSurface { distance: if inside { -distance } else { distance }, normal }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::synthetic::body::{cosine, slope_of};

    const WAVES: [Wave; 2] = [
        Wave::Gyroid { frequency: 0.2 },
        Wave::MarschnerLobb { edge: [160.0; 3], frequency: 6.0, depth: 0.25 },
    ];

    #[test]
    fn slopes_are_those_of_the_values_and_below_their_bound() {
        let mut random = Random(8);
        for wave in WAVES {
            for _ in 0..3000 {
                let p: Vector = std::array::from_fn(|_| 20.0 + 120.0 * random.unit());
                let (_, slope) = wave.value_and_slope(p);
                let by_values = slope_of(|q| wave.value_and_slope(q).0, p);
                let off = minus(slope, by_values);
                assert!(dot(off, off).sqrt() < 1e-7, "{wave:?} {p:?}");
                assert!(dot(slope, slope).sqrt() <= wave.steepest());
            }
        }
    }

    #[test]
    fn the_nearest_point_lies_on_the_surface_below_the_place() {
        let mut random = Random(9);
        for wave in WAVES {
            let mut near = 0;
            for _ in 0..4000 {
                let p: Vector = std::array::from_fn(|_| 20.0 + 120.0 * random.unit());
                if wave.first_order(p).abs() > 0.5 {
                    continue;
                }
                let found = wave.surface(p);
                let foot = add_scaled(p, -found.distance, found.normal);
                assert!(wave.value_and_slope(foot).0.abs() < 1e-9, "{wave:?} {p:?} {found:?}");
                assert!(cosine(wave.value_and_slope(foot).1, found.normal) > 1.0 - 1e-9);
                assert!(found.distance.abs() < 1.0, "{wave:?} {p:?} {found:?}");
                assert!(wave.safe_distance(p).abs() <= found.distance.abs() + 1e-9);
                near += 1;
            }
            assert!(near > 100, "{wave:?}: {near}");
        }
    }
}
