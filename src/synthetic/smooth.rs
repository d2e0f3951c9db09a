//! Bodies with a distance in closed form, each about the origin of its own frame.

use super::math::{Vector, sin_cos, unit};
use crate::geom::dot;

/// A body about the origin; lengths in units.
#[derive(Clone, Copy, Debug)]
pub(super) enum Smooth {
    Sphere {
        radius: f64,
    },
    Ellipsoid {
        radii: Vector,
    },
    /// A torus about the z axis: radius of the ring, and of the tube.
    Torus {
        ring: f64,
        tube: f64,
    },
    Box {
        half: Vector,
    },
    /// Endless across the z axis.
    Slab {
        half: f64,
    },
}

/// A turn about x, then y, then z.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turn {
    /// Axes of the body in the volume.
    axes: [Vector; 3],
}

impl Turn {
    pub(super) fn new(degrees: Vector) -> Self {
        let [x, y, z] = degrees.map(|d| sin_cos(d * (std::f64::consts::PI / 180.0)));
        let about = |v: Vector, [i, j]: [usize; 2], [sin, cos]: [f64; 2]| {
            let mut turned = v;
            turned[i] = cos * v[i] - sin * v[j];
            turned[j] = sin * v[i] + cos * v[j];
            turned
        };
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Self { axes: axes.map(|v| about(about(about(v, [1, 2], x), [2, 0], y), [0, 1], z)) }
    }

    pub(super) fn into_body(self, v: Vector) -> Vector {
        self.axes.map(|axis| dot(axis, v))
    }

    pub(super) fn out_of_body(self, v: Vector) -> Vector {
        std::array::from_fn(|i| self.axes[0][i] * v[0] + self.axes[1][i] * v[1] + self.axes[2][i] * v[2])
    }
}

impl Smooth {
    /// Distance and normal at the nearest point.
    pub(super) fn surface(&self, p: Vector) -> (f64, Vector) {
        match *self {
            Self::Sphere { radius } => (dot(p, p).sqrt() - radius, unit(p)),
            Self::Ellipsoid { radii } => ellipsoid(radii, p),
            Self::Torus { ring, tube } => {
                let around = (p[0] * p[0] + p[1] * p[1]).sqrt();
                let off = around - ring;
                let out = if around > 0.0 { [p[0] / around, p[1] / around] } else { [1.0, 0.0] };
                let distance = (off * off + p[2] * p[2]).sqrt() - tube;
                (distance, unit([out[0] * off, out[1] * off, p[2]]))
            }
            Self::Box { half } => cuboid(half, p),
            Self::Slab { half } => (p[2].abs() - half, [0.0, 0.0, 1.0_f64.copysign(p[2])]),
        }
    }

    /// The distance; farther away than `reach` a cheaper number on the same side and beyond `reach`.
    #[inline]
    pub(super) fn distance_near(&self, p: Vector, reach: f64) -> f64 {
        match *self {
            Self::Sphere { radius } => dot(p, p).sqrt() - radius,
            Self::Ellipsoid { radii } => {
                let scaled = [p[0] / radii[0], p[1] / radii[1], p[2] / radii[2]];
                // Lower bound of the distance.
                let bound = (dot(scaled, scaled).sqrt() - 1.0) * radii[0].min(radii[1]).min(radii[2]);
                if bound.abs() > reach { bound } else { ellipsoid(radii, p).0 }
            }
            Self::Slab { half } => p[2].abs() - half,
            Self::Torus { ring, tube } => {
                let off = (p[0] * p[0] + p[1] * p[1]).sqrt() - ring;
                (off * off + p[2] * p[2]).sqrt() - tube
            }
            Self::Box { half } => cuboid(half, p).0,
        }
    }
}

fn cuboid(half: Vector, p: Vector) -> (f64, Vector) {
    let over: Vector = std::array::from_fn(|a| p[a].abs() - half[a]);
    let outside = over.map(|o| o.max(0.0));
    let length = dot(outside, outside).sqrt();
    if length > 0.0 {
        return (length, std::array::from_fn(|a| (outside[a] / length).copysign(p[a])));
    }
    let axis = (0..3).fold(0, |best, a| if over[a] > over[best] { a } else { best });
    let mut normal = [0.0; 3];
    normal[axis] = 1.0_f64.copysign(p[axis]);
    (over[axis], normal)
}

/// Steps of bisection down to the last bit.
const HALVINGS: u32 = 120;

/// The nearest point of an ellipsoid is `x_i = r_i^2 p_i / (t + r_i^2)` for the largest root t of
/// `sum (r_i p_i / (t + r_i^2))^2 = 1` (Eberly, *Distance from a Point to an Ellipsoid*); found by bisection.
///
/// The unknown is `s = t + r^2` of the shortest axis: near the middle of the body t is next to `-r^2`, and its distance
/// from there matters.
fn ellipsoid(radii: Vector, p: Vector) -> (f64, Vector) {
    // A place within a plane of symmetry has two nearest points: step slightly off it.
    const HAIR: f64 = 1e-13;
    let p = p.map(|c| if c.abs() < HAIR { HAIR.copysign(c) } else { c });
    let least = radii[0].min(radii[1]).min(radii[2]);
    let more = radii.map(|r| (r - least) * (r + least));
    let scaled: Vector = std::array::from_fn(|a| radii[a] * p[a]);
    let value = |s: f64| {
        let terms: Vector = std::array::from_fn(|a| scaled[a] / (s + more[a]));
        dot(terms, terms) - 1.0
    };
    // At the lower end the term of one axis alone is 1; at the upper all together are at most 1.
    let mut low = (0..3).fold(0.0_f64, |low, a| low.max(scaled[a].abs() - more[a]));
    let mut high = dot(scaled, scaled).sqrt().max(low);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        if value(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    let foot: Vector = std::array::from_fn(|a| radii[a] * scaled[a] / (high + more[a]));
    let normal = unit(std::array::from_fn(|a| scaled[a] / radii[a] / (high + more[a])));
    let away: Vector = std::array::from_fn(|a| p[a] - foot[a]);
    let distance = dot(away, away).sqrt();
    (if high < least * least { -distance } else { distance }, normal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::synthetic::body::{cosine, slope_of};

    const ALL: [Smooth; 5] = [
        Smooth::Sphere { radius: 10.0 },
        Smooth::Ellipsoid { radii: [12.0, 8.0, 5.0] },
        Smooth::Torus { ring: 9.0, tube: 3.0 },
        Smooth::Box { half: [9.0, 7.0, 4.0] },
        Smooth::Slab { half: 2.5 },
    ];

    #[test]
    fn distances_are_euclidean_and_normals_their_slopes() {
        let mut random = Random(3);
        for shape in ALL {
            for _ in 0..4000 {
                let p: Vector = std::array::from_fn(|_| random.unit() * 32.0 - 16.0);
                let (distance, normal) = shape.surface(p);
                assert!((shape.distance_near(p, 100.0) - distance).abs() < 1e-12);
                // The foot lies on the surface, and the way to it is along the normal.
                let foot: Vector = std::array::from_fn(|a| p[a] - distance * normal[a]);
                assert!(shape.surface(foot).0.abs() < 1e-9, "{shape:?} {p:?}");
                // A true distance has slope 1 almost everywhere.
                let slope = slope_of(|q| shape.surface(q).0, p);
                let length = dot(slope, slope).sqrt();
                if (length - 1.0).abs() < 1e-6 {
                    assert!(cosine(slope, normal) > 1.0 - 1e-6, "{shape:?} {p:?} {slope:?} {normal:?}");
                }
                // Farther away than asked for, only the sign and the excess hold.
                let near = shape.distance_near(p, 0.5);
                assert!(
                    (near < 0.0) == (distance < 0.0) && (near - distance).abs() < 1e-12 || near.abs() > 0.5
                );
            }
        }
    }

    #[test]
    fn an_ellipsoids_distance_is_the_least_of_all_to_its_points() {
        let (radii, mut random) = ([12.0, 8.0, 5.0], Random(5));
        let shape = Smooth::Ellipsoid { radii };
        for p in [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [20.0, 0.0, 0.0], [0.1, 0.0, 7.0]] {
            let distance = shape.surface(p).0.abs();
            let least = (0..200_000).fold(f64::INFINITY, |least: f64, _| {
                let u = unit(std::array::from_fn(|_| random.unit() - 0.5));
                let away: Vector = std::array::from_fn(|a| u[a] * radii[a] - p[a]);
                least.min(dot(away, away).sqrt())
            });
            assert!((distance - 1e-9..distance + 0.1).contains(&least), "{p:?}: {distance} {least}");
        }
    }

    #[test]
    fn a_turn_keeps_lengths_and_comes_back() {
        let turn = Turn::new([20.0, -35.0, 110.0]);
        let v = [1.0, -2.0, 3.0];
        let there = turn.into_body(v);
        let back = turn.out_of_body(there);
        assert!((dot(there, there) - dot(v, v)).abs() < 1e-12);
        assert!((0..3).all(|a| (back[a] - v[a]).abs() < 1e-12));
        assert!(Turn::new([0.0, 0.0, 90.0]).out_of_body([1.0, 0.0, 0.0])[1] > 0.999_999);
    }
}
