//! Paths of records, and the order of items.

use crate::platform::{OsStrExt, below};
use std::path::{Path, PathBuf};

use super::log::Record;
use crate::source::natural_cmp;

/// Path of a record's file.
pub(super) fn full_path(inputs: &[PathBuf], record: &Record) -> PathBuf {
    let input = inputs.get(record.input as usize).map_or(Path::new(""), PathBuf::as_path);
    // Joined with nothing, a file would get a slash at its end.
    if record.path.as_os_str().is_empty() { input.to_path_buf() } else { below(input, &record.path) }
}

/// Natural order of whole paths: the order of the inputs does not matter, only their names.
pub(super) fn precedes(inputs: &[PathBuf], a: &Record, b: &Record) -> std::cmp::Ordering {
    let bytes = |r: &Record| full_path(inputs, r).into_os_string();
    if a.input == b.input {
        return natural_cmp(a.path.as_os_str().as_bytes(), b.path.as_os_str().as_bytes());
    }
    natural_cmp(bytes(a).as_bytes(), bytes(b).as_bytes())
}

/// Sorts by an order that has to be read and may fail; equal items keep their places. (The standard library's sort
/// needs an answer to every comparison, and may panic on answers that contradict each other.)
pub(super) fn sort_or_stop<T: Copy, E>(
    items: &mut Vec<T>,
    compare: impl Fn(&T, &T) -> Result<std::cmp::Ordering, E>,
) -> Result<(), E> {
    let mut merged = Vec::with_capacity(items.len());
    let mut run = 1;
    while run < items.len() {
        merged.clear();
        for pair in items.chunks(2 * run) {
            let (mut a, mut b) = pair.split_at(run.min(pair.len()));
            while let ([first, after @ ..], [second, behind @ ..]) = (a, b) {
                if compare(second, first)?.is_lt() {
                    merged.push(*second);
                    b = behind;
                } else {
                    merged.push(*first);
                    a = after;
                }
            }
            merged.extend_from_slice(a);
            merged.extend_from_slice(b);
        }
        std::mem::swap(items, &mut merged);
        run *= 2;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorting_keeps_equal_ones_in_place_and_stops_at_the_first_failure() {
        for count in [0, 1, 2, 3, 64, 1000_u32] {
            let mut items: Vec<(u32, u32)> =
                (0..count).map(|i| (i.wrapping_mul(2_654_435_761) % 37, i)).collect();
            let mut expected = items.clone();
            expected.sort_by_key(|item| item.0);
            sort_or_stop(&mut items, |a, b| Ok::<_, ()>(a.0.cmp(&b.0))).unwrap();
            assert_eq!(items, expected);
        }
        let asked = std::cell::Cell::new(0);
        let failing = |a: &i32, b: &i32| {
            asked.set(asked.get() + 1);
            if asked.get() == 3 { Err("disk") } else { Ok(a.cmp(b)) }
        };
        assert_eq!(sort_or_stop(&mut vec![5, 4, 3, 2, 1, 0], failing), Err("disk"));
        assert_eq!(asked.get(), 3);
    }
}
