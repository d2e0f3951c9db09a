//! Natural order of file names: runs of digits compare as numbers, so `CThead.2` precedes `CThead.10`.

use std::cmp::Ordering;

/// Compares two names byte by byte, but runs of ASCII digits by their value.
///
/// Numbers may be of any length. Names that differ only in leading zeros are ordered by their bytes,
/// so the order is total and only equal names are equal.
pub(crate) fn natural_cmp(a: &[u8], b: &[u8]) -> Ordering {
    let (mut rest_a, mut rest_b) = (a, b);
    loop {
        let (run_a, run_b) = (digits(rest_a), digits(rest_b));
        if !run_a.is_empty() && !run_b.is_empty() {
            let (value_a, value_b) = (without_zeros(run_a), without_zeros(run_b));
            let order = value_a.len().cmp(&value_b.len()).then_with(|| value_a.cmp(value_b));
            if order.is_ne() {
                return order;
            }
            rest_a = &rest_a[run_a.len()..];
            rest_b = &rest_b[run_b.len()..];
            continue;
        }
        match (rest_a.split_first(), rest_b.split_first()) {
            (Some((x, tail_a)), Some((y, tail_b))) if x == y => (rest_a, rest_b) = (tail_a, tail_b),
            (Some((x, _)), Some((y, _))) => return x.cmp(y),
            (None, None) => return a.cmp(b),
            (left, _) => return if left.is_none() { Ordering::Less } else { Ordering::Greater },
        }
    }
}

/// The run of digits at the head.
fn digits(text: &[u8]) -> &[u8] {
    let end = text.iter().position(|c| !c.is_ascii_digit()).unwrap_or(text.len());
    &text[..end]
}

fn without_zeros(run: &[u8]) -> &[u8] {
    let start = run.iter().position(|c| *c != b'0').unwrap_or(run.len());
    &run[start..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_compare_as_numbers() {
        let mut names: Vec<String> = (1..=113).rev().map(|n| format!("CThead.{n}")).collect();
        names.sort_by(|a, b| natural_cmp(a.as_bytes(), b.as_bytes()));
        let expected: Vec<String> = (1..=113).map(|n| format!("CThead.{n}")).collect();
        assert_eq!(names, expected);
    }

    #[test]
    fn order_is_total_and_antisymmetric() {
        let sorted = ["", "1", "01", "2", "10", "99999999999999999999999999", "a", "a1", "a1b", "a2", "ab"];
        for (i, a) in sorted.iter().enumerate() {
            for (j, b) in sorted.iter().enumerate() {
                // "01" and "1" have the same value: their bytes decide, '0' first.
                let expected = match (*a, *b) {
                    ("1", "01") => Ordering::Greater,
                    ("01", "1") => Ordering::Less,
                    _ => i.cmp(&j),
                };
                assert_eq!(natural_cmp(a.as_bytes(), b.as_bytes()), expected, "{a} {b}");
            }
        }
    }
}
