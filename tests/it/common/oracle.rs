//! An independent oracle: rays of any finite f64 numbers against boxes, in whole numbers without a limit.
//!
//! It shares nothing with the library: no rounding of rays, no fixed point, no walk. A finite f64 is a whole number
//! times a power of two, and so are sums, differences and products of such ([`Dyadic`]); times are compared as
//! fractions by multiplying crosswise. Numbers reach some 4,000 bits. Slow, and right by inspection.

use std::cmp::Ordering;
use std::ops::{Add, Mul, Neg, Sub};

use infobyte::geom::{BoxIndex, Octant};
use infobyte::load::{CellItems, NodeView};
use infobyte::render::ray::{FRACTION_BITS, Ray};
use num_bigint::{BigInt, Sign};

/// `whole * 2^exponent`.
#[derive(Clone, Debug)]
pub(crate) struct Dyadic {
    whole: BigInt,
    exponent: i64,
}

impl Dyadic {
    pub(crate) fn zero() -> Self {
        Self::of(0)
    }

    pub(crate) fn of(whole: i64) -> Self {
        Self { whole: whole.into(), exponent: 0 }
    }

    /// The value of a finite f64, exactly.
    pub(crate) fn from_f64(x: f64) -> Self {
        assert!(x.is_finite());
        let bits = x.to_bits();
        let field = i64::try_from(bits >> 52 & 0x7ff).unwrap();
        let fraction = bits & ((1 << 52) - 1);
        // Denormals have no hidden one.
        let (whole, exponent) =
            if field == 0 { (fraction, -1074) } else { (fraction | 1 << 52, field - 1075) };
        let whole = BigInt::from(whole);
        Self { whole: if x.is_sign_negative() { -whole } else { whole }, exponent }
    }

    pub(crate) fn times_power_of_two(mut self, exponent: i64) -> Self {
        self.exponent += exponent;
        self
    }

    pub(crate) fn power_of_two(exponent: i64) -> Self {
        Self::of(1).times_power_of_two(exponent)
    }

    pub(crate) fn sign(&self) -> Ordering {
        match self.whole.sign() {
            Sign::Minus => Ordering::Less,
            Sign::NoSign => Ordering::Equal,
            Sign::Plus => Ordering::Greater,
        }
    }

    pub(crate) fn abs(self) -> Self {
        if self.sign() == Ordering::Less { -self } else { self }
    }

    /// The whole numbers of two at the smaller of their exponents.
    fn aligned(&self, other: &Self) -> (BigInt, BigInt, i64) {
        let exponent = self.exponent.min(other.exponent);
        let at = |v: &Self| v.whole.clone() << usize::try_from(v.exponent - exponent).unwrap();
        (at(self), at(other), exponent)
    }

    /// Its highest bits, and the power of two that they stand for.
    fn parts(&self) -> (f64, i64) {
        let bits = i64::try_from(self.whole.bits()).unwrap();
        let drop = (bits - 60).max(0);
        let top = i64::try_from(self.whole.clone() >> usize::try_from(drop).unwrap()).unwrap();
        (top as f64, self.exponent + drop)
    }

    /// About its value.
    pub(crate) fn to_f64(&self) -> f64 {
        self.over(&Self::of(1))
    }

    /// About the quotient of two, however great or small both are.
    pub(crate) fn over(&self, other: &Self) -> f64 {
        let ((a, e), (b, f)) = (self.parts(), other.parts());
        a / b * 2.0_f64.powi(i32::try_from((e - f).clamp(-1000, 1000)).unwrap())
    }
}

impl PartialEq for Dyadic {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Dyadic {}
impl PartialOrd for Dyadic {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Dyadic {
    fn cmp(&self, other: &Self) -> Ordering {
        let (a, b, _) = self.aligned(other);
        a.cmp(&b)
    }
}
impl Add for &Dyadic {
    type Output = Dyadic;
    fn add(self, other: Self) -> Dyadic {
        let (a, b, exponent) = self.aligned(other);
        Dyadic { whole: a + b, exponent }
    }
}
impl Sub for &Dyadic {
    type Output = Dyadic;
    fn sub(self, other: Self) -> Dyadic {
        let (a, b, exponent) = self.aligned(other);
        Dyadic { whole: a - b, exponent }
    }
}
impl Mul for &Dyadic {
    type Output = Dyadic;
    fn mul(self, other: Self) -> Dyadic {
        Dyadic { whole: &self.whole * &other.whole, exponent: self.exponent + other.exponent }
    }
}
impl Neg for Dyadic {
    type Output = Dyadic;
    fn neg(self) -> Dyadic {
        Dyadic { whole: -self.whole, exponent: self.exponent }
    }
}

/// A time on a ray: `over / under`, with `under > 0`.
#[derive(Clone, Debug)]
pub(crate) struct Time {
    over: Dyadic,
    under: Dyadic,
}

impl Time {
    fn new(over: Dyadic, under: &Dyadic) -> Self {
        if under.sign() == Ordering::Less {
            Self { over: -over, under: -under.clone() }
        } else {
            Self { over, under: under.clone() }
        }
    }

    fn compare(&self, other: &Self) -> Ordering {
        (&self.over * &other.under).cmp(&(&other.over * &self.under))
    }

    /// About its value.
    pub(crate) fn to_f64(&self) -> f64 {
        self.over.over(&self.under)
    }
}

/// A ray of exact numbers, in grid space; it begins at `t_min`.
#[derive(Clone, Debug)]
pub(crate) struct ExactRay {
    pub(crate) origin: [Dyadic; 3],
    pub(crate) direction: [Dyadic; 3],
    pub(crate) t_min: Dyadic,
}

/// What an exact ray meets first.
#[derive(Clone, Debug)]
pub(crate) struct ExactHit {
    pub(crate) cell: [u32; 3],
    /// Axis of the last of the crossings into it, of tied ones the first; `None` where the ray begins in it.
    pub(crate) axis: Option<usize>,
    pub(crate) time: Time,
}

impl ExactRay {
    /// The ray of these numbers, without any rounding.
    pub(crate) fn new(origin: [f64; 3], direction: [f64; 3], t_min: f64) -> Self {
        let t_min = Dyadic::from_f64(t_min.max(0.0));
        Self { origin: origin.map(Dyadic::from_f64), direction: direction.map(Dyadic::from_f64), t_min }
    }

    /// What the library has made of a ray.
    pub(crate) fn of_fixed(ray: &Ray) -> Self {
        let unit = -i64::from(FRACTION_BITS);
        Self {
            origin: ray.origin().map(|o| Dyadic::of(o).times_power_of_two(unit)),
            direction: ray.direction().map(Dyadic::of),
            t_min: Dyadic::zero(),
        }
    }

    /// Are both the same ray, but for the scale of their times?
    pub(crate) fn is(&self, other: &Self) -> bool {
        let crosswise = |a: usize, b: usize| &self.direction[a] * &other.direction[b];
        self.origin == other.origin
            && self.t_min == other.t_min
            && (0..3).all(|a| self.direction[a].sign() == other.direction[a].sign())
            && (0..3).all(|a| (0..a).all(|b| crosswise(a, b) == crosswise(b, a)))
    }

    /// When the ray enters and leaves the box, if it passes through: at its planes, moved out by `margin`. Half-open
    /// in the direction of travel: it is in the box from the first time on, and not any more at the second.
    fn passage(&self, low: [i64; 3], edge: i64, margin: &Dyadic) -> Option<(Option<usize>, Time, Time)> {
        let one = Dyadic::of(1);
        let mut enter = Time { over: self.t_min.clone(), under: one };
        let (mut leave, mut axis) = (None::<Time>, None);
        for (a, low) in low.into_iter().enumerate() {
            let from = &Dyadic::of(low) - margin;
            let to = &Dyadic::of(low + edge) + margin;
            let d = &self.direction[a];
            let (near, far) = match d.sign() {
                Ordering::Equal => {
                    if self.origin[a] < from || self.origin[a] >= to {
                        return None;
                    }
                    continue;
                }
                Ordering::Greater => (from, to),
                Ordering::Less => (to, from),
            };
            let near = Time::new(&near - &self.origin[a], d);
            let far = Time::new(&far - &self.origin[a], d);
            if near.compare(&enter).is_gt() {
                (enter, axis) = (near, Some(a));
            }
            if leave.as_ref().is_none_or(|l| far.compare(l).is_lt()) {
                leave = Some(far);
            }
        }
        let leave = leave?;
        enter.compare(&leave).is_lt().then_some((axis, enter, leave))
    }

    /// Does the ray pass through a cell whose faces are moved out by `margin`?
    pub(crate) fn passes(&self, cell: [u32; 3], margin: &Dyadic) -> bool {
        self.passage(cell.map(i64::from), 1, margin).is_some()
    }

    /// The first of some cells, by looking at every one.
    pub(crate) fn first_of(&self, cells: impl Iterator<Item = [u32; 3]>) -> Option<ExactHit> {
        let mut best: Option<ExactHit> = None;
        for cell in cells {
            if let Some((axis, time, _)) = self.passage(cell.map(i64::from), 1, &Dyadic::zero())
                && best.as_ref().is_none_or(|b| time.compare(&b.time).is_lt())
            {
                best = Some(ExactHit { cell, axis, time });
            }
        }
        best
    }

    /// The first voxel of an octree: children are looked at in the order in which the ray enters them.
    pub(crate) fn first_in<V: NodeView>(&self, view: &V) -> Option<ExactHit> {
        let depth = view.depth();
        if view.voxel_count() == 0 {
            return None;
        }
        self.passage([0; 3], 1 << depth, &Dyadic::zero())?;
        self.descend(view, BoxIndex::ROOT, [0; 3], depth)
    }

    fn descend<V: NodeView>(
        &self,
        view: &V,
        number: BoxIndex,
        low: [u32; 3],
        level: u32,
    ) -> Option<ExactHit> {
        if level == 0 {
            let (axis, time, _) = self.passage(low.map(i64::from), 1, &Dyadic::zero())?;
            return Some(ExactHit { cell: low, axis, time });
        }
        let half = 1_u32 << (level - 1);
        let mut pierced: Vec<(Time, BoxIndex, [u32; 3])> = Octant::ALL
            .into_iter()
            .filter_map(|octant| {
                let child = view.child(number.node(), octant)?;
                let at = std::array::from_fn(|a| low[a] + octant.high()[a] * half);
                let (_, enter, _) = self.passage(at.map(i64::from), i64::from(half), &Dyadic::zero())?;
                Some((enter, child, at))
            })
            .collect();
        pierced.sort_by(|a, b| a.0.compare(&b.0));
        pierced.into_iter().find_map(|(_, child, at)| self.descend(view, child, at, level - 1))
    }

    /// The first place of a model of cells that this ray meets: the entry of a cell that it enters behind the plane, or
    /// the crossing of the plane within. `None` where it first comes to a cell that has corners, whose surface is no
    /// plane; then nothing is said.
    pub(crate) fn first_in_cells<V: NodeView>(
        &self,
        cells: &[([u32; 3], u64)],
        view: &V,
        items: &CellItems<'_>,
    ) -> Option<Option<ExactHit>> {
        let mut pierced: Vec<_> = cells
            .iter()
            .filter_map(|(cell, number)| {
                let (axis, enter, leave) = self.passage(cell.map(i64::from), 1, &Dyadic::zero())?;
                Some((enter, axis, leave, *cell, *number))
            })
            .collect();
        pierced.sort_by(|a, b| a.0.compare(&b.0));
        assert!(view.voxel_count() >= pierced.len() as u64);
        for (enter, axis, leave, cell, number) in pierced {
            let plane = items.plane(number)?;
            // Twice the place in the cell's own coordinates, -1..1, over the time's denominator; times the normal.
            let height = |time: &Time| {
                let normal = plane.normal.map(|n| Dyadic::of(n.into()));
                let sum = (0..3).fold(Dyadic::zero(), |sum, a| {
                    let middle = &Dyadic::of((2 * cell[a] + 1).into());
                    let at = &(&self.origin[a] * &time.under) + &(&time.over * &self.direction[a]);
                    let own = &at.times_power_of_two(1) - &(middle * &time.under);
                    &sum + &(&normal[a] * &own)
                });
                &sum - &(&Dyadic::of(plane.offset.into()) * &time.under)
            };
            let (first, last) = (height(&enter), height(&leave));
            if first.sign() != Ordering::Greater {
                return Some(Some(ExactHit { cell, axis, time: enter }));
            }
            if last.sign() != Ordering::Greater {
                // Linear in time: from `first` at the entry to 0.
                let slope = (0..3).fold(Dyadic::zero(), |sum, a| {
                    &sum + &(&Dyadic::of(plane.normal[a].into()) * &self.direction[a])
                });
                let slope = -slope.times_power_of_two(1);
                // enter + first / (enter.under * slope), as one fraction.
                let over = &(&enter.over * &slope) + &first;
                let time = Time::new(over, &(&enter.under * &slope));
                return Some(Some(ExactHit { cell, axis: None, time }));
            }
        }
        Some(None)
    }

    /// How far another line lies from this ray, in cells: the greatest difference of a coordinate where both have the
    /// same coordinate along the main axis of the ray, over the places where the other one is in the grid.
    ///
    /// Both lines are straight, so the greatest difference is at one of the ends.
    pub(crate) fn deviation(&self, other: &Self, depth: u32) -> Option<f64> {
        let main = (0..3).max_by(|a, b| {
            let size = |i: &usize| self.direction[*i].clone().abs();
            size(a).cmp(&size(b))
        })?;
        // `t_min` of the other is its origin, which may be the middle of its way.
        let (_, enter, leave) = other.passage([0; 3], 1 << depth, &Dyadic::zero())?;
        let mut worst = 0.0_f64;
        for time in [enter, leave] {
            for b in (0..3).filter(|b| *b != main) {
                // other_m = o_m + t d_m and other_b, over the time's denominator.
                let at = |i: usize| &(&other.origin[i] * &time.under) + &(&time.over * &other.direction[i]);
                // true_b - other_b = o_b + (other_m - o_m) s_b / s_m - other_b.
                let to_main = &at(main) - &(&self.origin[main] * &time.under);
                let to_other = &at(b) - &(&self.origin[b] * &time.under);
                let off = &(&to_main * &self.direction[b]) - &(&to_other * &self.direction[main]);
                let scale = &time.under * &self.direction[main];
                worst = worst.max(off.over(&scale).abs());
            }
        }
        Some(worst)
    }
}
