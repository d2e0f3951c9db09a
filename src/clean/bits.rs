//! Rows of the occupancy read one after the other, and their runs.

use crate::builder::BuildError;
pub(super) use crate::builder::{BitVolume, scratch_error};

/// Bytes of rows that are read at a time.
const WINDOW_BYTES: usize = 16 << 10;

/// Rows read from front to back, many at a time.
pub(super) struct RowWindow<'a> {
    bits: &'a BitVolume,
    words: Vec<u64>,
    first: u64,
    rows: u64,
}

impl<'a> RowWindow<'a> {
    pub(super) fn new(bits: &'a BitVolume) -> Self {
        let rows = (WINDOW_BYTES / 8 / bits.row_words).max(1) as u64;
        let rows = usize::try_from(rows.min(bits.rows())).unwrap_or(1);
        Self { bits, words: vec![0; rows * bits.row_words], first: 0, rows: 0 }
    }

    pub(super) fn bytes(row_words: usize) -> u64 {
        WINDOW_BYTES.max(row_words * 8) as u64
    }

    pub(super) fn get(&mut self, row: u64) -> Result<&mut [u64], BuildError> {
        let width = self.bits.row_words;
        if row < self.first || row >= self.first + self.rows {
            let most = (self.words.len() / width) as u64;
            self.rows = most.min(self.bits.rows() - row);
            self.first = row;
            let words = &mut self.words[..usize::try_from(self.rows).unwrap_or(0) * width];
            self.bits.read(row, 0, words).map_err(|cause| self.bits.failed(cause))?;
        }
        let at = usize::try_from(row - self.first).unwrap_or(0) * width;
        Ok(&mut self.words[at..at + width])
    }
}

/// Run of set voxels in a row, and its label.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Run {
    /// First and last column.
    pub(super) start: u16,
    pub(super) last: u16,
    pub(super) label: u32,
}

impl Run {
    pub(super) fn voxels(self) -> u64 {
        u64::from(self.last - self.start) + 1
    }
}

/// Finds the runs of a row of `nx` voxels, or of the voxels that are not set in it.
pub(super) fn find_runs(words: &[u64], nx: u32, inverted: bool, runs: &mut Vec<Run>) {
    runs.clear();
    #[expect(clippy::cast_possible_truncation, reason = "columns are below 2^16")]
    let mut push = |start: u32, end: u32| {
        runs.push(Run { start: start as u16, last: (end - 1) as u16, label: 0 });
    };
    let mut open = None;
    for (word, base) in words.iter().zip((0..nx).step_by(64)) {
        let word = if inverted { !word & row_mask(nx, base) } else { *word };
        let mut at = 0;
        while at < 64 {
            let rest = word >> at;
            if let Some(start) = open {
                at += rest.trailing_ones();
                if at < 64 {
                    push(start, base + at);
                    open = None;
                }
            } else if rest == 0 {
                break;
            } else {
                at += rest.trailing_zeros();
                open = Some(base + at);
            }
        }
    }
    if let Some(start) = open {
        push(start, nx);
    }
}

/// The bits of the word at column `base` that belong to a row of `nx` voxels.
pub(super) fn row_mask(nx: u32, base: u32) -> u64 {
    match nx.saturating_sub(base) {
        0 => 0,
        left @ 1..64 => (1 << left) - 1,
        _ => u64::MAX,
    }
}

pub(super) fn fill(words: &mut [u64], run: Run, set: bool) {
    let (first, last) = (u32::from(run.start), u32::from(run.last));
    for (at, word) in words.iter_mut().enumerate().take(last as usize / 64 + 1).skip(first as usize / 64) {
        #[expect(clippy::cast_possible_truncation, reason = "columns are below 2^16")]
        let base = at as u32 * 64;
        let mask = row_mask(last + 1, base) & !row_mask(first, base);
        if set {
            *word |= mask;
        } else {
            *word &= !mask;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::builder::BuildFault;
    use crate::geom::Dims;
    use crate::random::Random;

    #[test]
    fn runs_are_those_of_the_bits_and_filling_them_undoes_the_search() {
        let mut random = Random(7);
        for nx in [1, 2, 63, 64, 65, 127, 128, 129, 200, 65_536] {
            for sparse in 0..6 {
                let mut words = vec![0_u64; (nx as usize).div_ceil(64)];
                for (word, base) in words.iter_mut().zip((0..nx).step_by(64)) {
                    for _ in 0..=sparse {
                        *word |= random.bits();
                    }
                    *word = if sparse == 5 { u64::MAX } else { *word } & row_mask(nx, base);
                }
                for inverted in [false, true] {
                    let mut runs = Vec::new();
                    find_runs(&words, nx, inverted, &mut runs);
                    assert!(runs.windows(2).all(|w| u32::from(w[0].last) + 1 < u32::from(w[1].start)));
                    let mut again = vec![if inverted { u64::MAX } else { 0 }; words.len()];
                    runs.iter().for_each(|run| fill(&mut again, *run, !inverted));
                    for (word, base) in again.iter_mut().zip((0..nx).step_by(64)) {
                        *word &= row_mask(nx, base);
                    }
                    assert_eq!(again, words, "{nx} {inverted}");
                    let voxels: u64 = runs.iter().map(|r| r.voxels()).sum();
                    let set: u64 = words.iter().map(|w| u64::from(w.count_ones())).sum();
                    assert_eq!(voxels, if inverted { u64::from(nx) - set } else { set });
                }
            }
        }
    }

    #[test]
    fn windows_give_every_row() {
        let folder = tempfile::tempdir().unwrap();
        let dims = Dims::new(130, 700, 2).unwrap();
        let bits = BitVolume::create(folder.path(), dims).unwrap();
        for row in 0..bits.rows() {
            bits.write(row, 1, &[row]).unwrap();
        }
        let mut window = RowWindow::new(&bits);
        for row in (0..bits.rows()).chain([3, 1399, 0]) {
            assert_eq!(window.get(row).unwrap(), [0, row, 0]);
        }
        assert_eq!(bits.bytes(), 1400 * 24);
        let refused = BitVolume::create(Path::new("no/folder"), dims).err().unwrap();
        assert!(matches!(refused.fault(), BuildFault::Scratch { .. }), "{refused}");
    }
}
