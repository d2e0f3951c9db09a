//! Natural order of file names: runs of digits compare as numbers, so `CThead.2` precedes `CThead.10`.

use std::cmp::Ordering;

use super::stable_hash::StableHash;

/// Compares two names byte by byte, but runs of ASCII digits by their value.
///
/// Numbers may be of any length. Names that differ only in leading zeros are ordered by their bytes,
/// so the order is total and only equal names are equal.
pub(crate) fn natural_cmp(a: &[u8], b: &[u8]) -> Ordering {
    let (mut rest_a, mut rest_b) = (a, b);
    loop {
        let (run_a, run_b) = (digits(rest_a), digits(rest_b));
        if !run_a.is_empty() && !run_b.is_empty() {
            let order = integers(run_a, run_b);
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

/// A number of a file's name.
#[derive(Clone, Copy, Debug)]
pub(super) struct Number<'a> {
    /// `-` or `+` directly before the digits and behind no digit: a sign or a separator.
    pub(super) sign: Option<u8>,
    pub(super) whole: &'a [u8],
    /// Digits behind a point, unless there are several points, as in a UID: a fraction or another number.
    pub(super) fraction: Option<&'a [u8]>,
}

/// A run of a file's name.
#[derive(Clone, Copy, Debug)]
pub(super) enum Piece<'a> {
    Number(Number<'a>),
    Text(&'a [u8]),
}

/// The name without its extension, and that.
fn stem(name: &[u8]) -> (&[u8], &[u8]) {
    let point = name.iter().rposition(|c| *c == b'.').filter(|at| *at > 0);
    let (stem, rest) = name.split_at(point.unwrap_or(name.len()));
    let is_extension = rest.get(1).is_some_and(u8::is_ascii_alphabetic) && !rest.contains(&b'/');
    if is_extension { (stem, rest) } else { (name, &[]) }
}

/// The pieces of a name without its extension.
pub(super) fn pieces(name: &[u8]) -> impl Iterator<Item = Piece<'_>> {
    let (stem, _) = stem(name);
    let mut at = 0;
    std::iter::from_fn(move || {
        let start = at;
        if let Some((number, end)) = number(stem, start) {
            at = end;
            return Some(Piece::Number(number));
        }
        while at < stem.len() && number(stem, at).is_none() {
            at += 1;
        }
        stem.get(start..at).filter(|text| !text.is_empty()).map(Piece::Text)
    })
}

/// The number that begins at a byte of a name, and its end.
fn number(name: &[u8], at: usize) -> Option<(Number<'_>, usize)> {
    let rest = name.get(at..)?;
    let before = name.get(..at)?;
    let ends_in_digit = before.last().is_some_and(u8::is_ascii_digit);
    let sign = rest.first().copied().filter(|c| matches!(c, b'-' | b'+') && !ends_in_digit);
    let rest = &rest[usize::from(sign.is_some())..];
    let whole = digits(rest);
    if whole.is_empty() {
        return None;
    }
    let end = name.len() - rest.len() + whole.len();
    let point = |text: &[u8]| text.first() == Some(&b'.') && text.get(1).is_some_and(u8::is_ascii_digit);
    let is_behind_point = matches!(before, [.., digit, b'.'] if digit.is_ascii_digit());
    let behind = &rest[whole.len()..];
    let fraction = Some(behind).filter(|text| point(text) && !is_behind_point).map(|text| digits(&text[1..]));
    match fraction.filter(|digits| !point(&behind[1 + digits.len()..])) {
        Some(digits) => Some((Number { sign, whole, fraction: Some(digits) }, end + 1 + digits.len())),
        None => Some((Number { sign, whole, fraction: None }, end)),
    }
}

/// The meaning of signs and points in the names of a list; bit k is for the k-th number of each.
///
/// A hyphen is a sign, and digits behind a point are a fraction, if some names have it and others, which are the same
/// but for that, do not: `scan-001` counts from 1 on, and `z-1` precedes `z0`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Meaning {
    signed: u16,
    decimal: u16,
}

/// Most sets of names that are distinguished; folders have one or two.
pub(super) const MAX_SETS: usize = 64;

impl Meaning {
    /// The meaning in some names.
    pub(super) fn of<'a>(names: impl Iterator<Item = &'a [u8]>) -> Self {
        // Names without their numbers, and the numbers with a sign and a fraction: of some, and of all of them.
        let mut sets: Vec<(u64, [u16; 2], [u16; 2])> = Vec::new();
        for name in names {
            let mut hash = StableHash::new();
            let (mut own, mut bit) = ([0; 2], 1_u16);
            for piece in pieces(name) {
                match piece {
                    Piece::Text(text) => hash = hash.part(&text.to_ascii_lowercase()),
                    Piece::Number(number) => {
                        own[0] |= if number.sign == Some(b'-') { bit } else { 0 };
                        own[1] |= if number.fraction.is_some() { bit } else { 0 };
                        bit <<= 1;
                        hash = hash.number(1);
                    }
                }
            }
            let template = hash.finish();
            let is_full = sets.len() == MAX_SETS;
            match sets.iter_mut().find(|set| set.0 == template) {
                Some((_, some, all)) => {
                    for (axis, own) in own.iter().enumerate() {
                        some[axis] |= own;
                        all[axis] &= own;
                    }
                }
                None if !is_full => sets.push((template, own, own)),
                None => {}
            }
        }
        let mixed = |axis: usize| sets.iter().fold(0, |bits, set| bits | set.1[axis] & !set.2[axis]);
        Self { signed: mixed(0), decimal: mixed(1) }
    }

    /// True if a hyphen before the k-th number is a sign.
    pub(super) fn is_signed(self, number: u32) -> bool {
        1_u16.checked_shl(number).is_some_and(|bit| self.signed & bit != 0)
    }

    /// True if digits behind the point of the k-th number are a fraction.
    pub(super) fn is_decimal(self, number: u32) -> bool {
        1_u16.checked_shl(number).is_some_and(|bit| self.decimal & bit != 0)
    }

    /// Compares the names of slices: by text, in which the case of letters does not count, and by numbers.
    ///
    /// The order is total and only equal names are equal.
    pub(super) fn compare(self, a: &[u8], b: &[u8]) -> Ordering {
        let (mut of_a, mut of_b) = (pieces(a), pieces(b));
        let mut at = 0;
        loop {
            let order = match (of_a.next(), of_b.next()) {
                (Some(Piece::Number(x)), Some(Piece::Number(y))) => {
                    at += 1;
                    self.numbers(at - 1, x, y)
                }
                (Some(Piece::Text(x)), Some(Piece::Text(y))) => {
                    x.iter().map(u8::to_ascii_lowercase).cmp(y.iter().map(u8::to_ascii_lowercase))
                }
                (Some(Piece::Number(_)), Some(_)) | (None, Some(_)) => Ordering::Less,
                (Some(_), _) => Ordering::Greater,
                (None, None) => return stem(a).1.cmp(stem(b).1).then_with(|| a.cmp(b)),
            };
            if order.is_ne() {
                return order;
            }
        }
    }

    fn numbers(self, at: u32, a: Number<'_>, b: Number<'_>) -> Ordering {
        let fractions = match (self.is_decimal(at), a.fraction, b.fraction) {
            (true, x, y) => decimals(x.unwrap_or_default(), y.unwrap_or_default()),
            (false, Some(x), Some(y)) => integers(x, y),
            (false, x, y) => x.cmp(&y),
        };
        let order = integers(a.whole, b.whole).then(fractions);
        let is_below_0 = |number: Number<'_>| number.sign == Some(b'-');
        match (is_below_0(a), is_below_0(b)) {
            _ if !self.is_signed(at) => a.sign.cmp(&b.sign).then(order),
            (true, true) => order.reverse(),
            (x, y) => y.cmp(&x).then(order),
        }
    }
}

/// Compares digits as integers.
pub(super) fn integers(a: &[u8], b: &[u8]) -> Ordering {
    let (a, b) = (without_zeros(a), without_zeros(b));
    a.len().cmp(&b.len()).then_with(|| a.cmp(b))
}

/// Compares digits behind a point.
pub(super) fn decimals(a: &[u8], b: &[u8]) -> Ordering {
    let significant = |digits: &[u8]| digits.iter().rposition(|c| *c != b'0').map_or(0, |at| at + 1);
    a[..significant(a)].cmp(&b[..significant(b)])
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

    #[test]
    fn signs_fractions_copies_and_letters_are_ordered_as_they_are_meant() {
        for sorted in [
            &["scan-001.tif", "scan-002.tif", "scan-010.tif"][..],
            &["z-3.png", "z-2.png", "z-1.png", "z0.png", "z1.png", "z10.png"],
            &["z=-6", "z=-4", "z=0", "z=+2", "z=4"],
            &["z9.png", "z9.25.png", "z9.5.png", "z9.75.png", "z10.png", "z10.25.png"],
            &["1.2.9.tif", "1.2.10.tif", "1.2.10.1.tif"],
            &["v1.9.tif", "v1.10.tif", "v1.11.tif"],
            &["S1.png", "s2.png", "S3.png", "s4.tif", "s5.PNG"],
            &["a.png", "a (2).png", "a (3).png", "a (10).png"],
            &["2024-01-05_x", "2024-01-06_x", "2024-02-01_x"],
        ] {
            let mut names = sorted.to_vec();
            names.reverse();
            let meaning = Meaning::of(names.iter().map(|name| name.as_bytes()));
            names.sort_by(|a, b| meaning.compare(a.as_bytes(), b.as_bytes()));
            assert_eq!(names, sorted);
        }
    }
}
