//! Morphological closing: gaps up to about twice the radius wide are bridged, small holes disappear.
//!
//! Closing is dilation followed by erosion, with the same element: all voxels whose centres lie within
//! `R + 1/2` voxels of the middle one. That is 19 voxels for R = 1 (a cube of 3 without its corners) and 81 for
//! R = 2. Distances count voxels along each axis, at any spacing in mm. The volume lies in unbounded air:
//! nothing is lost or added at its border that would not be in the middle of a larger volume, and no voxel
//! that was inside is lost.
//!
//! Strips of rows are walked along z with rings of `2 R + 1` slices of the occupancy and of its dilation; a
//! strip reads `2 R` rows beyond its own on either side. One pass.

use super::bits::{BitVolume, row_mask};
use crate::budget::costs::MAPPED_FROM;
use crate::budget::{Budget, Reservation, TooSmall};
use crate::builder::BuildError;
use crate::progress::Progress;

/// Half width of the element along x in its row (dy, dz); `None` where it has no voxel.
fn half_width(radius: i64, dy: i64, dz: i64) -> Option<usize> {
    // (R + 1/2)^2 in quarters, so that it is whole.
    let left = (2 * radius + 1).pow(2) - 4 * (dy * dy + dz * dz);
    (0..=2).rev().find(|x| 4 * x * x <= left).and_then(|x| usize::try_from(x).ok())
}

fn ring(radius: i64) -> i64 {
    2 * radius + 1
}

pub(super) fn bytes(row_words: usize, radius: u32, rows: u64) -> u64 {
    let r = u64::from(radius);
    let padded = (row_words as u64 + 2) * 8;
    (2 * r + 1) * padded * (2 * rows + 6 * r) + 4 * padded
}

/// Most bytes of one slice of a strip, so that the allocator keeps none of it (see `paged`).
const SLICE_BYTES: u64 = 96 << 10;
const _: () = assert!(SLICE_BYTES < MAPPED_FROM as u64);

/// Rows of a strip: as many as fit, at least one.
fn strip_rows(bits: &BitVolume, radius: u32, room_bytes: u64) -> u32 {
    let (mut few, mut many) = (1, bits.dims().ny());
    while few < many {
        let middle = few + (many - few).div_ceil(2);
        let slice = (bits.row_words as u64 + 2) * 8 * (u64::from(middle) + 4 * u64::from(radius));
        if slice <= SLICE_BYTES && bytes(bits.row_words, radius, u64::from(middle)) <= room_bytes {
            few = middle;
        } else {
            many = middle - 1;
        }
    }
    few
}

/// Rows of a strip for [`close`], as many as the budget grants, and their memory.
///
/// # Errors
/// The budget is too small for one row.
pub(super) fn reserve_strips(
    bits: &BitVolume,
    radius: u32,
    budget: &Budget,
) -> Result<(u32, Reservation), TooSmall> {
    let rows = strip_rows(bits, radius, budget.left_bytes());
    Ok((rows, budget.reserve(bytes(bits.row_words, radius, rows.into()))?))
}

/// Writes the closing of `from` into `to`, which is empty, in strips of `rows` rows, and returns how many voxels
/// were added.
///
/// # Errors
/// The scratch file fails.
pub(super) fn close(
    from: &BitVolume,
    to: &BitVolume,
    radius: u32,
    rows: u32,
    progress: &dyn Progress,
) -> Result<u64, BuildError> {
    let dims = from.dims();
    let strips = dims.ny().div_ceil(rows);
    progress.stage("close", u64::from(strips) * u64::from(dims.nz()));
    let mut added = 0;
    for strip in 0..strips {
        let first = strip * rows;
        let count = rows.min(dims.ny() - first);
        added += Strip::new(from, to, radius, first, count).walk(progress)?;
    }
    Ok(added)
}

/// Slices of rows with one word more on either side: the dilation reaches beyond the volume.
struct Ring {
    slices: Vec<Vec<u64>>,
    width: usize,
    first_row: i64,
    rows: i64,
}

impl Ring {
    fn new(row_words: usize, first_row: i64, rows: i64, slices: i64) -> Self {
        let width = row_words + 2;
        let slice = vec![0; width * usize::try_from(rows).unwrap_or(0)];
        Self { slices: vec![slice; usize::try_from(slices).unwrap_or(0)], width, first_row, rows }
    }

    fn place(&self, y: i64, z: i64) -> (usize, std::ops::Range<usize>) {
        let slice = usize::try_from(z.rem_euclid(self.slices.len() as i64)).unwrap_or(0);
        let start = usize::try_from(y - self.first_row).unwrap_or(0) * self.width;
        (slice, start..start + self.width)
    }

    fn row(&self, y: i64, z: i64) -> &[u64] {
        let (slice, words) = self.place(y, z);
        &self.slices[slice][words]
    }

    fn row_mut(&mut self, y: i64, z: i64) -> &mut [u64] {
        let (slice, words) = self.place(y, z);
        &mut self.slices[slice][words]
    }
}

struct Strip<'a> {
    from: &'a BitVolume,
    to: &'a BitVolume,
    radius: i64,
    first: i64,
    count: i64,
    /// Rows (dy, dz, half width) of the element.
    element: Vec<(i64, i64, usize)>,
    inside: Ring,
    dilated: Ring,
    /// Rows of each half width, put together.
    sums: [Vec<u64>; 3],
}

impl<'a> Strip<'a> {
    fn new(from: &'a BitVolume, to: &'a BitVolume, radius: u32, first: u32, count: u32) -> Self {
        let (r, first, count) = (i64::from(radius), i64::from(first), i64::from(count));
        let words = from.row_words;
        let around = |r: i64| (-r..=r).flat_map(move |dz| (-r..=r).map(move |dy| (dy, dz)));
        Self {
            from,
            to,
            radius: r,
            first,
            count,
            element: around(r).filter_map(|(dy, dz)| Some((dy, dz, half_width(r, dy, dz)?))).collect(),
            inside: Ring::new(words, first - 2 * r, count + 4 * r, ring(r)),
            dilated: Ring::new(words, first - r, count + 2 * r, ring(r)),
            sums: std::array::from_fn(|_| vec![0; words + 2]),
        }
    }

    /// Slice z is read, slice z - R of the dilation follows, and slice z - 2 R of the closing.
    fn walk(&mut self, progress: &dyn Progress) -> Result<u64, BuildError> {
        let (r, nz) = (self.radius, i64::from(self.from.dims().nz()));
        let mut added = 0;
        for z in -2 * r..nz + 2 * r {
            self.read(z)?;
            // The first ring, around slice -R, is complete with slice 0.
            if z >= 0 {
                self.dilate(z - r);
            }
            let done = z - 2 * r;
            if (0..nz).contains(&done) {
                added += self.erode(done)?;
                progress.step(1)?;
            }
        }
        Ok(added)
    }

    fn read(&mut self, z: i64) -> Result<(), BuildError> {
        let dims = self.from.dims();
        for y in self.inside.first_row..self.inside.first_row + self.inside.rows {
            let row = self.inside.row_mut(y, z);
            row.fill(0);
            let (Ok(y), Ok(z)) = (u32::try_from(y), u32::try_from(z)) else { continue };
            if y < dims.ny() && z < dims.nz() {
                let end = row.len() - 1;
                self.from.read(self.from.row(y, z), 0, &mut row[1..end]).map_err(|e| self.from.failed(e))?;
            }
        }
        Ok(())
    }

    fn dilate(&mut self, z: i64) {
        for y in self.first - self.radius..self.first + self.count + self.radius {
            self.sums.iter_mut().for_each(|s| s.fill(0));
            for (dy, dz, width) in &self.element {
                let row = self.inside.row(y + dy, z + dz);
                self.sums[*width].iter_mut().zip(row).for_each(|(sum, word)| *sum |= word);
            }
            let out = self.dilated.row_mut(y, z);
            out.fill(0);
            for (width, sum) in self.sums.iter().enumerate() {
                for shift in 0..=width {
                    shifted(sum, shift, |i, left, right| out[i] |= left | right);
                }
            }
        }
    }

    fn erode(&mut self, z: i64) -> Result<u64, BuildError> {
        let dims = self.from.dims();
        let mut added = 0;
        let mut out = vec![0; self.from.row_words + 2];
        for y in self.first..self.first + self.count {
            self.sums.iter_mut().for_each(|s| s.fill(u64::MAX));
            for (dy, dz, width) in &self.element {
                let row = self.dilated.row(y + dy, z + dz);
                self.sums[*width].iter_mut().zip(row).for_each(|(sum, word)| *sum &= word);
            }
            out.fill(u64::MAX);
            for (width, sum) in self.sums.iter().enumerate() {
                for shift in 0..=width {
                    shifted(sum, shift, |i, left, right| out[i] &= left & right);
                }
            }
            let end = out.len() - 1;
            let closed = &mut out[1..end];
            for (word, base) in closed.iter_mut().zip((0..dims.nx()).step_by(64)) {
                *word &= row_mask(dims.nx(), base);
            }
            let before = &self.inside.row(y, z)[1..end];
            added += closed.iter().zip(before).map(|(a, b)| u64::from((a & !b).count_ones())).sum::<u64>();
            if let (Ok(y), Ok(z)) = (u32::try_from(y), u32::try_from(z)) {
                self.to.write(self.to.row(y, z), 0, closed)?;
            }
        }
        Ok(added)
    }
}

/// Gives the words of a row shifted by `shift` bits towards higher and towards lower columns; beyond the ends
/// the row is taken as 0, which only the outer words, whose outer bits are not needed, can show.
fn shifted(row: &[u64], shift: usize, mut take: impl FnMut(usize, u64, u64)) {
    if shift == 0 {
        row.iter().enumerate().for_each(|(i, word)| take(i, *word, *word));
        return;
    }
    let back = 64 - shift;
    for (i, word) in row.iter().enumerate() {
        let before = i.checked_sub(1).map_or(0, |i| row[i] >> back);
        let after = row.get(i + 1).map_or(0, |next| next << back);
        take(i, word << shift | before, word >> shift | after);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_element_has_the_voxels_that_its_description_says() {
        for (radius, want) in [(1, 19), (2, 81)] {
            let widths = (-radius..=radius)
                .flat_map(|dz| (-radius..=radius).filter_map(move |dy| half_width(radius, dy, dz)));
            assert_eq!(widths.map(|w| 2 * w + 1).sum::<usize>(), want);
        }
    }
}
