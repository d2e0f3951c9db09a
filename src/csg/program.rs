//! Programs: a flat tree as a list of steps on a stack, and the part of it that matters in a box.
//!
//! ```text
//! and(or(a, b), not c)   becomes   a b OR ~c AND
//! ```
//!
//! The part of a join that needs the deepest stack comes first, so that n leaves need no more than log2 n + 2 places
//! however deep the tree is. In a box most leaves are all in or all out; the rest of the program then is as long as the
//! surface there is complicated.

use super::normal_form::{Kind, NormalForm, Part};
use crate::builder::Cover;

/// One step: a join, or a leaf with a bit that is set for its complement.
pub(super) type Step = u32;

const AND: Step = 1 << 31;
const OR: Step = 1 << 30;

/// Places of a stack: more than log2 of the most leaves.
pub(super) const STACK: usize = 24;
const _: () = assert!(super::normal_form::MAX_LEAVES <= 1 << (STACK - 3));

/// The leaf of a step, and true for its complement; `None` for a join.
#[inline]
pub(super) fn leaf_of(step: Step) -> Option<(u32, bool)> {
    (step < OR).then_some((step >> 1, step & 1 != 0))
}

/// Cover of the complement.
fn complement(cover: Cover) -> Cover {
    match cover {
        Cover::Outside => Cover::Inside,
        Cover::Inside => Cover::Outside,
        Cover::Mixed => Cover::Mixed,
    }
}

pub(super) fn compile<T>(flat: &NormalForm<T>) -> Vec<Step> {
    let (mut parts, starts) = flat.parts_by_join();
    // Joins stand before their parts.
    let mut needs = vec![0_u8; flat.joins.len()];
    for join in (0..flat.joins.len()).rev() {
        let own = &mut parts[starts[join] as usize..starts[join + 1] as usize];
        let need = |part: &Part| match part {
            Part::Leaf { .. } => 1,
            Part::Join(below) => needs[*below as usize],
        };
        let deepest =
            (0..own.len()).fold(0, |best, at| if need(&own[at]) > need(&own[best]) { at } else { best });
        own.get_mut(..=deepest).into_iter().for_each(|first| first.rotate_right(1));
        let others = own.iter().skip(1).map(|part| 1 + need(part)).max().unwrap_or(0);
        needs[join] = own.first().map_or(1, need).max(others);
    }
    let mut steps = Vec::with_capacity(2 * flat.leaves.len());
    let mut open = vec![(0_u32, 0_u32)];
    while let Some((join, done)) = open.pop() {
        let own = &parts[starts[join as usize] as usize..starts[join as usize + 1] as usize];
        let step = if flat.joins[join as usize] == Kind::And { AND } else { OR };
        if done >= 2 {
            steps.push(step);
        }
        let Some(part) = own.get(done as usize) else { continue };
        open.push((join, done + 1));
        match part {
            Part::Leaf { leaf, negated } => steps.push(leaf << 1 | Step::from(*negated)),
            Part::Join(below) => open.push((*below, 0)),
        }
    }
    steps
}

/// Inclusion of leaves in each other in a box.
pub(super) trait Nesting {
    /// Rank of a leaf, the smaller the farther it reaches around the middle of the box; `None` for leaves that are not
    /// compared.
    fn reach(&self, leaf: u32) -> Option<i64>;
    /// True if all of one leaf in the box lies a lattice step and more within the other.
    fn holds(&self, outer: u32, inner: u32) -> bool;
}

/// Nesting of leaves that are not compared.
pub(super) struct Apart;

impl Nesting for Apart {
    fn reach(&self, _: u32) -> Option<i64> {
        None
    }

    fn holds(&self, _: u32, _: u32) -> bool {
        false
    }
}

/// Nesting turned round: leaves kept in a union are those otherwise kept in an intersection.
pub(super) struct Inverse<N>(pub(super) N);

impl<N: Nesting> Nesting for Inverse<N> {
    fn reach(&self, leaf: u32) -> Option<i64> {
        self.0.reach(leaf).map(|reach| -reach)
    }

    fn holds(&self, outer: u32, inner: u32) -> bool {
        self.0.holds(inner, outer)
    }
}

/// The leaf that decides most of a part: its only one, or one of several that are all joined alike.
#[derive(Clone, Copy)]
struct Lead {
    leaf: u32,
    negated: bool,
    reach: i64,
    /// The join, if there are several.
    join: Option<Step>,
}

impl Lead {
    fn new(step: Step, nesting: &impl Nesting) -> Option<Self> {
        let (leaf, negated) = leaf_of(step)?;
        Some(Self { leaf, negated, reach: nesting.reach(leaf)?, join: None })
    }

    /// The pair, if both may stand in one list.
    fn pair(a: Option<Self>, b: Option<Self>, join: Step) -> Option<(Self, Self)> {
        let (a, b) = (a?, b?);
        let alike = |lead: &Self| lead.join.is_none_or(|own| own == join);
        (alike(&a) && alike(&b) && a.negated == b.negated).then_some((a, b))
    }
}

/// Writes the rest of a program where leaves have these covers; nothing, if all is in or out. `None` where the list has
/// no room: the program itself has the same result then.
///
/// Leaves within another leaf of the same union are left out: they change neither the voxels that are
/// inside nor the place where an edge first comes inside.
pub(super) fn prune(
    program: &[Step],
    mut cover: impl FnMut(u32) -> Cover,
    nesting: &impl Nesting,
    out: &mut Vec<Step>,
) -> Option<Cover> {
    out.clear();
    let mut stack = [(Cover::Outside, 0_usize, None::<Lead>); STACK];
    let mut top = 0;
    for step in program {
        if let Some((leaf, negated)) = leaf_of(*step) {
            let own = cover(leaf);
            let own = if negated { complement(own) } else { own };
            let lead = if own == Cover::Mixed { Lead::new(*step, nesting) } else { None };
            stack[top] = (own, out.len(), lead);
            top += 1;
            if own == Cover::Mixed {
                if out.len() == out.capacity() {
                    return None;
                }
                out.push(*step);
            }
            continue;
        }
        let is_and = *step == AND;
        let ((b, second, lead_b), (a, first, lead_a)) = (stack[top - 1], stack[top - 2]);
        top -= 1;
        // One side decides alone, or does not matter.
        let (decides, matters_not) =
            if is_and { (Cover::Outside, Cover::Inside) } else { (Cover::Inside, Cover::Outside) };
        let (joined, lead) = if a == decides || b == decides {
            out.truncate(first);
            (decides, None)
        } else if a == matters_not {
            (b, lead_b)
        } else if b == matters_not {
            out.truncate(second);
            (a, lead_a)
        } else {
            let lead = match Lead::pair(lead_a, lead_b, *step) {
                None => None,
                Some((a, b)) => {
                    // In a union the larger leaf counts, in an intersection the smaller one; for complements the other
                    // way round.
                    let larger = is_and == a.negated;
                    let beats = |a: &Lead, b: &Lead| match larger {
                        true => nesting.holds(a.leaf, b.leaf),
                        false => nesting.holds(b.leaf, a.leaf),
                    };
                    let a_leads = (a.reach <= b.reach) == larger;
                    if a_leads && b.join.is_none() && beats(&a, &b) {
                        out.truncate(second);
                        stack[top - 1] = (Cover::Mixed, first, Some(a));
                        continue;
                    }
                    if !a_leads && a.join.is_none() && beats(&b, &a) {
                        out.remove(first);
                        stack[top - 1] = (Cover::Mixed, first, Some(b));
                        continue;
                    }
                    Some(Lead { join: Some(*step), ..if a_leads { a } else { b } })
                }
            };
            if out.len() == out.capacity() {
                return None;
            }
            out.push(*step);
            (Cover::Mixed, lead)
        };
        stack[top - 1] = (joined, first, lead);
    }
    Some(if top == 0 { Cover::Outside } else { stack[0].0 })
}

/// True for a union of leaves.
pub(super) fn is_union(program: &[Step]) -> bool {
    program.iter().all(|step| leaf_of(*step).map_or(*step == OR, |(_, negated)| !negated))
}

/// The value of a program, of 64 voxels or cases at once.
pub(super) fn value(program: &[Step], mut leaf: impl FnMut(u32) -> u64) -> u64 {
    let mut stack = [0_u64; STACK];
    let mut top = 0;
    for step in program {
        if let Some((at, negated)) = leaf_of(*step) {
            stack[top] = leaf(at) ^ if negated { u64::MAX } else { 0 };
            top += 1;
        } else {
            let b = stack[top - 1];
            let a = &mut stack[top - 2];
            *a = if *step == AND { *a & b } else { *a | b };
            top -= 1;
        }
    }
    stack[0]
}

/// The value of a program; `marks` tells for each leaf's step whether the value turns when that leaf alone does. Once
/// forwards for the values, once backwards for the marks.
pub(super) fn turns(program: &[Step], mut leaf: impl FnMut(usize) -> bool, marks: &mut Vec<u8>) -> bool {
    marks.clear();
    let mut stack = [false; STACK];
    let (mut top, mut at) = (0, 0);
    for step in program {
        if let Some((_, negated)) = leaf_of(*step) {
            stack[top] = leaf(at) != negated;
            top += 1;
            at += 1;
            marks.push(0);
        } else {
            let (a, b) = (stack[top - 2], stack[top - 1]);
            top -= 1;
            stack[top - 1] = if *step == AND { a && b } else { a || b };
            marks.push(u8::from(a) | u8::from(b) << 1);
        }
    }
    let value = stack[0];
    // The parts to come: the right one of a join ends just before it.
    stack[0] = true;
    top = 1;
    for (step, mark) in program.iter().zip(marks.iter_mut()).rev() {
        top -= 1;
        let turns = stack[top];
        if *step < OR {
            *mark = u8::from(turns);
        } else {
            let decides = |other: u8| (other != 0) == (*step == AND);
            let (left, right) = (decides(*mark & 2), decides(*mark & 1));
            stack[top] = turns && left;
            stack[top + 1] = turns && right;
            top += 2;
        }
    }
    value
}

/// The values of a program, of rows of 64 voxels: `stack` has room for [`STACK`] times `rows`, and holds the result
/// first.
pub(super) fn rows_of(
    program: &[Step],
    stack: &mut [u64],
    rows: usize,
    mut leaf: impl FnMut(u32, &mut [u64]),
) {
    let mut top = 0;
    for step in program {
        if let Some((at, negated)) = leaf_of(*step) {
            let own = &mut stack[top * rows..][..rows];
            leaf(at, own);
            if negated {
                own.iter_mut().for_each(|word| *word = !*word);
            }
            top += 1;
        } else {
            let (below, above) = stack.split_at_mut((top - 1) * rows);
            let own = &mut below[(top - 2) * rows..];
            if *step == AND {
                own.iter_mut().zip(above).for_each(|(a, b)| *a &= *b);
            } else {
                own.iter_mut().zip(above).for_each(|(a, b)| *a |= *b);
            }
            top -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program of `leaves` leaves with random joins, the deeper part first.
    fn random(leaves: u32, first: u32, next: &mut impl FnMut(u32) -> u32) -> Vec<Step> {
        if leaves == 1 {
            return vec![first << 1 | next(2)];
        }
        let left = leaves - 1 - next(leaves / 2);
        let mut steps = random(left, first, next);
        steps.extend(random(leaves - left, first + left, next));
        steps.push(if next(2) == 0 { AND } else { OR });
        steps
    }

    #[test]
    fn the_leaves_that_turn_a_program_are_those_that_do_when_tried() {
        let mut state = 7_u32;
        let mut next = |n: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 10) % n
        };
        let mut turning = 0;
        for round in 0..2000 {
            let leaves = 1 + next(if round % 10 == 0 { 300 } else { 9 });
            let steps = random(leaves, 0, &mut next);
            let set: Vec<bool> = (0..leaves).map(|_| next(2) == 0).collect();
            let of = |turned: Option<u32>| {
                value(&steps, |at| u64::from(set[at as usize] != (turned == Some(at)))) & 1 != 0
            };
            let mut marks = Vec::new();
            assert_eq!(turns(&steps, |at| set[at], &mut marks), of(None));
            for (step, mark) in steps.iter().zip(&marks) {
                if let Some((leaf, _)) = leaf_of(*step) {
                    assert_eq!(*mark != 0, of(Some(leaf)) != of(None), "{steps:?} {set:?} {leaf}");
                    turning += u32::from(*mark);
                }
            }
        }
        assert!(turning > 2000, "{turning}");
    }
}
