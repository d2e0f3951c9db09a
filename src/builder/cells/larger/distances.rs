//! Distances between larger leaves and the fine cells that they replace.

use super::{BETWEEN, PARTS};

/// Classes of the histogram of distances from which the 99th percentile is read.
const CLASSES: u32 = 256;

/// Distances between the fine cells and the leaves that replace them, in [`PARTS`].
#[derive(Clone, Debug, PartialEq)]
pub(in crate::builder) struct Distances {
    crossings: u64,
    squares: u128,
    most: u32,
    classes: Vec<u64>,
    /// End of the last class.
    limit: u32,
}

impl Distances {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most two voxels")]
    pub(in crate::builder) fn new(error: f64) -> Self {
        let limit = (error * BETWEEN * f64::from(PARTS)).ceil().clamp(1.0, 1e6) as u32;
        Self { crossings: 0, squares: 0, most: 0, classes: vec![0; CLASSES as usize], limit }
    }

    /// Adds the distances of a leaf's crossings, below 2^17.
    #[inline(always)]
    pub(super) fn add_all(&mut self, distances: impl Iterator<Item = u32>) {
        let (mut count, mut squares, mut most) = (0, 0, self.most);
        for distance in distances {
            let class = distance.saturating_mul(CLASSES) / self.limit;
            self.classes[class.min(CLASSES - 1) as usize] += 1;
            count += 1;
            squares += u64::from(distance) * u64::from(distance);
            most = most.max(distance);
        }
        self.crossings += count;
        self.squares += u128::from(squares);
        self.most = most;
    }

    /// Adds the distance between the fine cells and a point of a leaf's plane between the crossings.
    pub(super) fn add_between(&mut self, distance: u32) {
        self.most = self.most.max(distance);
    }

    /// Adds crossings of cells that stay, at distance 0.
    pub(super) fn add_none(&mut self, crossings: u64) {
        self.classes[0] += crossings;
        self.crossings += crossings;
    }

    pub(in crate::builder) fn join(&mut self, other: &Self) {
        self.crossings += other.crossings;
        self.squares += other.squares;
        self.most = self.most.max(other.most);
        self.classes.iter_mut().zip(&other.classes).for_each(|(own, more)| *own += more);
    }

    /// Root mean square, 99th percentile (the end of its class) and maximum, in voxels of the finest spacing.
    #[expect(clippy::cast_precision_loss, reason = "sums of small whole numbers")]
    pub(in crate::builder) fn rms_p99_most(&self) -> [f64; 3] {
        let (crossings, parts) = (self.crossings.max(1), f64::from(PARTS));
        let rms = (self.squares as f64 / crossings as f64).sqrt() / parts;
        let (mut below, mut p99) = (0, 0.0);
        for (end, count) in (1_u32..).zip(&self.classes) {
            below += count;
            if below * 100 >= crossings * 99 {
                p99 = if end == 1 && self.most == 0 { 0.0 } else { f64::from(end) / f64::from(CLASSES) };
                break;
            }
        }
        let most = f64::from(self.most) / parts;
        [rms, (p99 * f64::from(self.limit) / parts).min(most), most]
    }
}
