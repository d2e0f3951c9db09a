//! Sorting of short lists by code that is compiled once: the standard library's sort takes 4 to 8 KB of the program for
//! each type and order, and the time of these lists does not show.

use std::cmp::Ordering;

/// Sorts by a key; equal items keep their order.
pub(crate) fn by_key<T, K: Ord>(items: &mut [T], key: impl Fn(&T) -> K) {
    by(items, |a, b| key(a).cmp(&key(b)));
}

/// Sorts by a comparison; equal items keep their order. Costs a move of each item, and 16 bytes of memory.
pub(crate) fn by<T>(items: &mut [T], compare: impl Fn(&T, &T) -> Ordering) {
    let mut sources = sources(items.len(), &|a, b| compare(&items[a], &items[b]));
    // Along each cycle: an item goes to its place, and the next one is looked for where it came from.
    for start in 0..sources.len() {
        let mut at = start;
        loop {
            let from = std::mem::replace(&mut sources[at], at);
            if from == start {
                break;
            }
            items.swap(at, from);
            at = from;
        }
    }
}

/// The places, before sorting, of items in their order.
fn sources(count: usize, compare: &dyn Fn(usize, usize) -> Ordering) -> Vec<usize> {
    let mut sources: Vec<usize> = (0..count).collect();
    sources.sort_by(|a, b| compare(*a, *b));
    sources
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_is_the_same_as_by_the_standard_library() {
        for count in [0, 1, 2, 3, 20, 21, 500_usize] {
            let items: Vec<(usize, String)> =
                (0..count).map(|i| (i.wrapping_mul(2_654_435_761) % 37, i.to_string())).collect();
            let (mut ordered, mut sorted) = (items.clone(), items.clone());
            by_key(&mut ordered, |item| item.0);
            sorted.sort_by_key(|item| item.0);
            assert_eq!(ordered, sorted);
            by(&mut ordered, |a, b| b.1.cmp(&a.1));
            sorted.sort_by(|a, b| b.1.cmp(&a.1));
            assert_eq!(ordered, sorted);
        }
    }
}
