//! Ellipsoids, cylinders, cones and tori under any affine.
//!
//! A leaf has a frame: a middle m and three axes e on the lattice. u(p), with p = m + u1 e1 + u2 e2 + u3 e3, is a
//! rational number of whole numbers: u = q / D, D the determinant of the axes, q the adjugate times p - m.
//!
//! | leaf | inside is, or on it | as whole numbers |
//! |---|---|---|
//! | ellipsoid | `|u| <= 1` | `q1^2 + q2^2 + q3^2 <= D^2` |
//! | cylinder, cone | `u1^2 + u2^2 <= w(u3)^2`, `0 <= u3 <= 1`, `w = r0 + u3 (r1 - r0)` | `(S q1)^2 + (S q2)^2 <= (D R0 + q3 (R1 - R0))^2`, radii being R / S |
//! | torus | `(sqrt(u1^2 + u2^2) - 1)^2 + u3^2 <= r^2` | on u rounded to 1 / F, squared once |
//!
//! Squares have up to 226 bits. They are computed only where double precision leaves doubt: each leaf has a function g
//! of u, below 0 inside, that nowhere changes faster than u does (times two for a cylinder), so that one value of g
//! decides for a whole box or for part of a row. Middles on the surface are moved, as for all leaves.

use std::cmp::Ordering;

use super::{Face, Rows};
use crate::builder::Cover;
use crate::csg::place::centre;
use crate::csg::wide::{square, sum};
use crate::geom::dot;
use crate::mesh::STEPS;

/// Units of a ratio of radii.
pub(in crate::csg) const RATIO: i64 = 1 << 20;
/// Units of a torus' major radius.
const FIXED: i128 = 1 << 26;
/// Greatest distance of a voxel of any grid from a frame's middle, in lattice steps: both from the corner, added.
const REACH: f64 = 2.7e8 + 5.4e8;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::csg) enum Round {
    Ellipsoid,
    /// Radii at u3 = 0 and 1; the larger one is [`RATIO`].
    Cylinder([i64; 2]),
    /// Radius of the tube, in units of 2^-26 of the major one.
    Torus(i64),
}

#[derive(Debug)]
pub(in crate::csg) struct Curved {
    middle: [i64; 3],
    axes: [[i64; 3]; 3],
    round: Round,
    /// Matrix from lattice steps to u.
    inverse: [[f64; 3]; 3],
    /// Bound of |g| below which its sign is uncertain.
    unsure: f64,
    /// Greatest change of g from voxel to voxel along a row.
    along: f64,
}

/// Rows of the adjugate of axes, and the determinant, which is not below 0.
fn adjugate(axes: &[[i64; 3]; 3]) -> ([[i128; 3]; 3], i128) {
    let e = axes.map(|axis| axis.map(i128::from));
    let cross = |a: [i128; 3], b: [i128; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let adjugate = [cross(e[1], e[2]), cross(e[2], e[0]), cross(e[0], e[1])];
    let determinant: i128 = (0..3).map(|k| adjugate[0][k] * e[0][k]).sum();
    if determinant < 0 {
        (adjugate.map(|row| row.map(|c| -c)), -determinant)
    } else {
        (adjugate, determinant)
    }
}

#[expect(clippy::cast_precision_loss, reason = "bounded by `unsure`")]
fn float(of: i128) -> f64 {
    of as f64
}

impl Curved {
    /// The leaf of a frame; `None` if its axes lie in a plane, so that it has no inside.
    pub(in crate::csg) fn new(middle: [i64; 3], axes: [[i64; 3]; 3], round: Round) -> Option<Self> {
        let (adjugate, determinant) = adjugate(&axes);
        if determinant == 0 {
            return None;
        }
        let inverse = adjugate.map(|row| row.map(|c| float(c) / float(determinant)));
        let steep = steep(round);
        // Rounding of the inverse, the products and the sums, each at most 2^-52 of its terms; u of a torus is
        // rounded for the decision as well.
        let terms: f64 = inverse.iter().flatten().map(|c| c.abs()).sum::<f64>() * REACH;
        let unsure = steep * terms * 16.0 * f64::EPSILON + 1e-7;
        let along = inverse.iter().map(|row| row[0] * row[0]).sum::<f64>().sqrt() * f64::from(STEPS) * steep;
        Some(Self { middle, axes, round, inverse, unsure, along })
    }

    /// Bounding box.
    pub(super) fn bounds(&self) -> [[i64; 3]; 2] {
        let [a, b, c] = self.axes.map(|axis| axis.map(i64::abs));
        let low_high: [(i64, i64); 3] = std::array::from_fn(|k| match self.round {
            Round::Ellipsoid => (a[k] + b[k] + c[k], a[k] + b[k] + c[k]),
            Round::Cylinder(_) => {
                let along = self.axes[2][k];
                (a[k] + b[k] + (-along).max(0), a[k] + b[k] + along.max(0))
            }
            Round::Torus(tube) => {
                // The ring and the tube, rounded up; a tube has 16 major radii at most.
                let tube = i128::from(tube);
                let reach = i128::from(a[k] + b[k]) * (FIXED + tube) + i128::from(c[k]) * tube;
                let reach = i64::try_from(reach / FIXED + 1).unwrap_or(i64::MAX / 4);
                (reach, reach)
            }
        });
        [
            std::array::from_fn(|k| self.middle[k] - low_high[k].0),
            std::array::from_fn(|k| self.middle[k] + low_high[k].1),
        ]
    }

    #[inline]
    #[expect(clippy::cast_precision_loss, reason = "below 2^30")]
    fn local(&self, p: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.middle.map(|c| c as f64);
        let d = [p[0] - x, p[1] - y, p[2] - z];
        self.inverse.map(|row| dot(row, d))
    }

    /// Value of g: below 0 inside, above outside.
    #[inline]
    fn distance(&self, u: [f64; 3]) -> f64 {
        let radial = (u[0] * u[0] + u[1] * u[1]).sqrt();
        match self.round {
            Round::Ellipsoid => (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]).sqrt() - 1.0,
            Round::Cylinder(radii) => (radial - width(radii, u[2])).max(-u[2]).max(u[2] - 1.0),
            Round::Torus(tube) => ((radial - 1.0).powi(2) + u[2] * u[2]).sqrt() - tube_of(tube),
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "below 2^31")]
    pub(super) fn cover(&self, region: &[(i64, i64); 3]) -> Cover {
        let middle = region.map(|(low, high)| (low + high) as f64 / 2.0);
        let half = region.map(|(low, high)| (high - low) as f64 / 2.0);
        let reach = self.inverse.map(|row| dot(row.map(f64::abs), half));
        let within = dot(reach, reach).sqrt() * steep(self.round) * (1.0 + 1e-9) + self.unsure;
        match self.distance(self.local(middle)) {
            g if g > within => Cover::Outside,
            g if g < -within => Cover::Inside,
            _ => Cover::Mixed,
        }
    }

    /// Walks along each row in steps within which g cannot change its sign.
    #[expect(clippy::cast_precision_loss, reason = "below 2^31")]
    pub(super) fn fill(&self, at: Rows, out: &mut [u64]) {
        let step = self.inverse.map(|row| row[0] * f64::from(STEPS));
        for (word, y) in out.iter_mut().zip(at.y..) {
            let first = [centre(at.x), centre(y), centre(at.z)];
            let start = self.local(first.map(|c| c as f64));
            let mut x = 0_i32;
            *word = 0;
            while x < 64 {
                let along = f64::from(x);
                let g = self.distance([0, 1, 2].map(|k| start[k] + along * step[k]));
                let sure = g.abs() - self.unsure;
                if sure > 0.0 {
                    #[expect(clippy::cast_possible_truncation, reason = "at most 64")]
                    let more = (sure / self.along * (1.0 - 1e-9)).min(64.0) as i32;
                    let last = (x + more).min(63);
                    if g < 0.0 {
                        *word |= super::bits(x.into(), last.into());
                    }
                    x = last + 1;
                } else {
                    let p = [first[0] + i64::from(x) * i64::from(STEPS), first[1], first[2]];
                    *word |= u64::from(self.decide(p)) << x;
                    x += 1;
                }
            }
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "below 2^31")]
    pub(super) fn contains(&self, p: [i64; 3]) -> bool {
        let g = self.distance(self.local(p.map(|c| c as f64)));
        if g.abs() > self.unsure { g < 0.0 } else { self.decide(p) }
    }

    /// Decides by the definition; a middle on the surface by its move.
    fn decide(&self, p: [i64; 3]) -> bool {
        let d: [i128; 3] = std::array::from_fn(|k| i128::from(p[k] - self.middle[k]));
        let (adjugate, whole) = adjugate(&self.axes);
        let q = adjugate.map(|row| row[0] * d[0] + row[1] * d[1] + row[2] * d[2]);
        let (side, part) = match self.round {
            Round::Ellipsoid => {
                let squares = sum(sum(square(q[0]), square(q[1])), square(q[2]));
                (squares.cmp(&square(whole)), 0)
            }
            Round::Cylinder(radii) => {
                let [r0, r1] = radii.map(i128::from);
                let scale = i128::from(RATIO);
                let width = square(whole * r0 + q[2] * (r1 - r0));
                let sides = [
                    sum(square(scale * q[0]), square(scale * q[1])).cmp(&width),
                    0.cmp(&q[2]),
                    q[2].cmp(&whole),
                ];
                // A point on several parts is inside if each part says so.
                return sides.into_iter().enumerate().all(|(part, side)| self.is_within(side, part, p));
            }
            Round::Torus(tube) => {
                // Tubes have 16 major radii at most: points beyond 18 are outside, and nothing overflows.
                if q.iter().any(|c| c.abs() > 18 * whole) {
                    return false;
                }
                let [u, v, w] = q.map(|c| (2 * c * FIXED + whole).div_euclid(2 * whole));
                let radial = u * u + v * v;
                let left = radial + w * w + FIXED * FIXED - i128::from(tube).pow(2);
                (if left < 0 { Ordering::Less } else { (left * left).cmp(&(4 * FIXED * FIXED * radial)) }, 0)
            }
        };
        self.is_within(side, part, p)
    }

    /// True if a point on this side of a part of the surface is inside of it.
    #[expect(clippy::cast_precision_loss, reason = "below 2^31")]
    fn is_within(&self, side: Ordering, part: usize, p: [i64; 3]) -> bool {
        match side {
            Ordering::Less => true,
            Ordering::Greater => false,
            Ordering::Equal => {
                super::leads_in(self.outwards(self.slope(self.local(p.map(|c| c as f64)), part)))
            }
        }
    }

    /// Gradient of g with u on a part of the surface: the round one, and the ends of a cylinder.
    #[expect(clippy::cast_precision_loss, reason = "below 2^21")]
    fn slope(&self, u: [f64; 3], part: usize) -> [f64; 3] {
        let r = (u[0] * u[0] + u[1] * u[1]).sqrt().max(f64::MIN_POSITIVE);
        match self.round {
            Round::Ellipsoid => {
                let length = dot(u, u).sqrt().max(f64::MIN_POSITIVE);
                u.map(|c| c / length)
            }
            Round::Cylinder(radii) => match part {
                0 => [u[0] / r, u[1] / r, -((radii[1] - radii[0]) as f64 / RATIO as f64)],
                1 => [0.0, 0.0, -1.0],
                _ => [0.0, 0.0, 1.0],
            },
            Round::Torus(_) => {
                let around = ((r - 1.0).powi(2) + u[2] * u[2]).sqrt().max(f64::MIN_POSITIVE);
                let ring = (r - 1.0) / around;
                [u[0] / r * ring, u[1] / r * ring, u[2] / around]
            }
        }
    }

    /// The gradient in lattice coordinates: the transposed inverse times that in u.
    fn outwards(&self, of_u: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| (0..3).map(|j| self.inverse[j][k] * of_u[j]).sum::<f64>())
    }

    /// The part of the surface that lies between a voxel and its neighbour.
    #[expect(clippy::cast_precision_loss, reason = "below 2^31")]
    pub(super) fn face(&self, voxel: [i64; 3], beside: [i64; 3], is_inside: bool) -> Face {
        let here = self.local(voxel.map(|c| c as f64));
        let there = self.local(beside.map(|c| c as f64));
        let (inner, outer) = if is_inside { (here, there) } else { (there, here) };
        let (value, part) = match self.round {
            Round::Ellipsoid => (dot(here, here).sqrt().max(f64::MIN_POSITIVE) - 1.0, 0),
            Round::Cylinder(radii) => {
                let radial = |u: [f64; 3]| (u[0] * u[0] + u[1] * u[1]).sqrt();
                let parts = |u: [f64; 3]| [radial(u) - width(radii, u[2]), -u[2], u[2] - 1.0];
                let (a, b) = (parts(inner), parts(outer));
                // The way out leads through the part that it meets first.
                let met = |k: usize| if b[k] > 0.0 { a[k] / (a[k] - b[k]) } else { f64::INFINITY };
                let first = (1..3).fold(0, |best, k| if met(k).abs() < met(best).abs() { k } else { best });
                (parts(here)[first], first)
            }
            Round::Torus(tube) => {
                let r = (here[0] * here[0] + here[1] * here[1]).sqrt().max(f64::MIN_POSITIVE);
                let around = ((r - 1.0).powi(2) + here[2] * here[2]).sqrt().max(f64::MIN_POSITIVE);
                (around - tube_of(tube), 0)
            }
        };
        let outwards = self.outwards(self.slope(here, part));
        let slope = dot(outwards, outwards).sqrt().max(f64::MIN_POSITIVE);
        Face { outwards, distance: (value / slope).abs() }
    }
}

/// Greatest change of g relative to u.
#[inline]
fn steep(round: Round) -> f64 {
    if matches!(round, Round::Cylinder(_)) { 2.0 } else { 1.0 }
}

#[inline]
#[expect(clippy::cast_precision_loss, reason = "below 2^21")]
fn width(radii: [i64; 2], at: f64) -> f64 {
    (radii[0] as f64 + at * (radii[1] - radii[0]) as f64) / RATIO as f64
}

#[inline]
#[expect(clippy::cast_precision_loss, reason = "below 2^27")]
fn tube_of(parts: i64) -> f64 {
    parts as f64 / FIXED as f64
}

/// A ratio of at most 1 in units of a torus' major radius.
#[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "at most 2^26")]
pub(in crate::csg) fn tube_parts(ratio: f64) -> i64 {
    (ratio * FIXED as f64).round_ties_even() as i64
}
