//! Slices of bits, row by row, 64 to a word.

/// A bit for each place of a slice. Each row has one spare bit at its end, which stays 0.
#[derive(Clone, Debug, Default)]
pub(super) struct Bits {
    words: Vec<u64>,
    /// Words of a row.
    stride: usize,
}

impl Bits {
    /// Bits that are all 0.
    pub(super) fn new(width: u32, height: usize) -> Self {
        let stride = width as usize / 64 + 1;
        Self { words: vec![0; stride * height], stride }
    }

    pub(super) fn stride(&self) -> usize {
        self.stride
    }

    pub(super) fn fill(&mut self, word: u64) {
        self.words.fill(word);
    }

    /// The words of a row; empty beyond the last row.
    #[inline(always)]
    pub(super) fn row(&self, row: usize) -> &[u64] {
        let start = row.saturating_mul(self.stride);
        self.words.get(start..start.saturating_add(self.stride)).unwrap_or_default()
    }

    #[inline(always)]
    pub(super) fn row_mut(&mut self, row: usize) -> &mut [u64] {
        self.words.get_mut(row * self.stride..(row + 1) * self.stride).unwrap_or_default()
    }

    /// The words of a row and the next one.
    #[inline(always)]
    pub(super) fn two_rows_mut(&mut self, row: usize) -> &mut [u64] {
        self.words.get_mut(row * self.stride..(row + 2) * self.stride).unwrap_or_default()
    }

    /// True if all bits are 0.
    pub(super) fn is_empty(&self) -> bool {
        self.words.iter().all(|word| *word == 0)
    }

    /// The runs of ones in a row: the first place of each, and the one after its last.
    pub(super) fn stretches(&self, row: usize) -> impl Iterator<Item = [u32; 2]> {
        let words = self.row(row);
        let mut at = 0;
        std::iter::from_fn(move || {
            let start = next(words, at, 0)?;
            let end = next(words, start, u64::MAX)?;
            at = end;
            Some([start, end])
        })
    }
}

/// The first place from `at` on with a 1, or with a 0 if all bits of `flip` are set.
fn next(words: &[u64], at: u32, flip: u64) -> Option<u32> {
    let mut from = at % 64;
    for (number, word) in (at / 64..).zip(words.get(at as usize / 64..)?) {
        let found = (word ^ flip) >> from << from;
        if found != 0 {
            return Some(64 * number + found.trailing_zeros());
        }
        from = 0;
    }
    None
}

/// Sets the bits from `start` up to `end` of a row.
#[inline(always)]
pub(super) fn set(row: &mut [u64], start: u32, end: u32) {
    if start >= end {
        return;
    }
    let (first, last) = (start as usize / 64, (end as usize - 1) / 64);
    let (low, high) = (u64::MAX << (start % 64), u64::MAX >> (63 - (end - 1) % 64));
    match row.get_mut(first..=last) {
        Some([word]) => *word |= low & high,
        Some([one, between @ .., other]) => {
            *one |= low;
            between.fill(u64::MAX);
            *other |= high;
        }
        _ => {}
    }
}

/// True if a bit is set from `start` up to `end` of a row.
pub(super) fn any(row: &[u64], start: u32, end: u32) -> bool {
    next(row, start, 0).is_some_and(|at| at < end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_are_what_was_set() {
        for (start, end) in [(0, 1), (3, 64), (63, 65), (60, 200), (128, 192), (5, 5)] {
            let mut bits = Bits::new(200, 2);
            set(bits.row_mut(1), start, end);
            let due: Vec<[u32; 2]> = (start < end).then_some([start, end]).into_iter().collect();
            assert_eq!(bits.stretches(1).collect::<Vec<_>>(), due);
            assert_eq!(bits.stretches(0).count(), 0);
            assert!((0..200).all(|x| any(bits.row(1), x, x + 1) == (start..end).contains(&x)));
        }
        let mut bits = Bits::new(130, 1);
        [(1, 3), (4, 5), (100, 129)].iter().for_each(|(start, end)| set(bits.row_mut(0), *start, *end));
        assert_eq!(bits.stretches(0).collect::<Vec<_>>(), [[1, 3], [4, 5], [100, 129]]);
        assert!(bits.row(1).is_empty());
    }
}
