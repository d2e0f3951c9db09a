//! A ray and the walls between the labels of a cell (SPEC 4.12).
//!
//! A ray's side of each plane at entry and exit is decided in integers, as in [`super::cells`]. The planes that it
//! crosses on its way are taken in their order, with the label on either side of each.

use super::cells::Side;
use super::ray::Ray;
use super::surface::Passage;
use super::traverse::Hit;
use crate::format::Walls;

/// Hidden labels, which count as background.
#[derive(Clone, Debug)]
pub(crate) struct Hidden(Vec<u64>);

impl Hidden {
    /// Hides labels with these numbers.
    pub(crate) fn of(numbers: impl Iterator<Item = u16>) -> Self {
        let mut bits = vec![0; 1 << 10];
        numbers.for_each(|number| bits[usize::from(number >> 6)] |= 1 << (number & 63));
        Self(bits)
    }

    /// The visible label; 0 for a hidden one.
    #[inline]
    pub(crate) fn seen(&self, label: u16) -> u16 {
        let is_hidden = self.0.get(usize::from(label >> 6)).is_some_and(|bits| bits >> (label & 63) & 1 == 1);
        if is_hidden { 0 } else { label }
    }
}

/// Entry of a ray from the visible label `from` into another one.
#[inline(never)]
pub(super) fn meet(
    walls: &Walls,
    seen: impl Fn(u16) -> u16,
    from: u16,
    ray: &Ray,
    passage: &Passage,
) -> Option<Hit> {
    let mut fronts = 0;
    let mut crossed = [(0, 0.0); 3];
    let mut count = 0;
    for (i, plane) in walls.planes().iter().enumerate() {
        let side = Side::new(plane, ray, passage);
        let (is_front, leaves_front) = (side.at_entry() > 0, side.at_exit() > 0);
        fronts |= usize::from(is_front) << i;
        if is_front != leaves_front {
            crossed[count] = (i, side.crossing(ray));
            count += 1;
        }
    }
    if seen(walls.label(fronts)) != from {
        return Some(passage.entry_hit(ray));
    }
    let crossed = &mut crossed[..count];
    crossed.sort_by(|a, b| a.1.total_cmp(&b.1));
    for (plane, t) in crossed {
        fronts ^= 1 << *plane;
        if seen(walls.label(fronts)) != from {
            let Passage { box_number, cell, edge_log2, .. } = *passage;
            return Some(Hit { box_number, cell, edge_log2, face: None, t: *t });
        }
    }
    None
}
