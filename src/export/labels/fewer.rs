//! Fewer triangles of labels: each label is reduced by itself, within the same distance as all others.
//!
//! A good surface of n triangles lies about c / n from the fine one. The first round, with shares by the fine triangles,
//! measures c for each label. Later rounds share the triangles out in proportion to it, so that all labels have about the
//! same distance.

use std::io;
use std::path::Path;

use super::OnePart;
use super::parts::Parts;
use crate::export::write::{Sink, Vertex};
use crate::export::{ExportStop, Exported, Exporter};
use crate::progress::Progress;
use crate::scratch;

/// Rounds of sharing out a number of triangles; the one with the least distance counts.
const ROUNDS: usize = 3;

/// Distance in voxels that stands for a smaller one: flat labels have none.
const LEAST_APART: f64 = 0.01;

impl Exporter<'_> {
    /// The surfaces of some parts of fewer triangles, and figures of all of them.
    ///
    /// Memory: that of the largest one. Temporary disk: as much again as for the fine triangles.
    pub(super) fn fewer_of_parts(
        &self,
        fine: &Parts,
        (which, wanted): (&[usize], &[bool]),
        scratch: &Path,
        progress: &dyn Progress,
    ) -> Result<(Parts, Exported), ExportStop> {
        let most: Vec<u64> = which.iter().map(|part| fine.counts(*part)[1]).collect();
        let mut weights: Vec<f64> = most.iter().map(|count| to_f64(*count)).collect();
        let rounds = if self.triangles.is_some() && which.len() > 1 { ROUNDS } else { 1 };
        let mut best: Option<(Parts, Exported)> = None;
        for _ in 0..rounds {
            let shares = self.triangles.map(|count| shared(count, &weights, &most));
            let (mut few, mut sum) = (Parts::new(scratch::unnamed(scratch)?, wanted), Exported::default());
            for (at, part) in which.iter().enumerate() {
                let mut whole = self.fewer(shares.as_ref().map(|shares| shares[at]), progress);
                fine.each_vertex(*part, |[at, normal]| whole.vertex(&Vertex { at, normal, light: [0; 3] }))?;
                fine.each_triangle(*part, |corners| whole.triangle(corners, [[0.0; 3]; 3]))?;
                let made = whole.reduce(Exported { triangles: most[at], ..Exported::default() })?;
                whole.hand_on(&mut OnePart(&mut few, *part))?;
                let apart_mm = made.distance_mm.unwrap_or_default().max(LEAST_APART * self.voxel_mm());
                weights[at] = to_f64(made.triangles) * apart_mm;
                sum.triangles += made.triangles;
                sum.fine_triangles += made.fine_triangles;
                sum.distance_mm = [sum.distance_mm, made.distance_mm].into_iter().flatten().reduce(f64::max);
                sum.within_mm = made.within_mm;
                sum.parts_gone =
                    Some(sum.parts_gone.unwrap_or_default() + made.parts_gone.unwrap_or_default());
            }
            if best.as_ref().is_none_or(|(_, best)| sum.distance_mm < best.distance_mm) {
                best = Some((few, sum));
            }
        }
        best.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput).into())
    }
}

/// A number shared out in proportion to weights; no share is greater than its `most`.
fn shared(count: u64, weights: &[f64], most: &[u64]) -> Vec<u64> {
    let (mut left, mut rest, mut shares) = (count, weights.iter().sum::<f64>(), vec![0; weights.len()]);
    let mut order: Vec<usize> = (0..weights.len()).collect();
    let fills = |at: &usize| to_f64(most[*at]) / weights[*at];
    // A share that is full leaves more to those after it.
    crate::order::by(&mut order, |a, b| fills(a).total_cmp(&fills(b)));
    for at in order {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the number")]
        let share = (to_f64(left) * (weights[at] / rest).min(1.0)) as u64;
        shares[at] = share.min(most[at]);
        left -= shares[at];
        rest -= weights[at];
    }
    shares
}

#[expect(clippy::cast_precision_loss, reason = "counts are below 2^48")]
fn to_f64(count: u64) -> f64 {
    count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_shared_out_by_weight_up_to_what_there_is() {
        assert_eq!(shared(100, &[1.0, 3.0], &[1000, 1000]), [25, 75]);
        assert_eq!(shared(100, &[1.0, 3.0, 1.0], &[1000, 20, 1000]), [40, 20, 40]);
        assert_eq!(shared(100, &[5.0, 0.1], &[10, 10]), [10, 10]);
        assert_eq!(shared(7, &[1.0; 3], &[9; 3]).iter().sum::<u64>(), 7);
    }
}
