//! Fewer triangles of labels: each label is reduced by itself, within the same distance as all others.
//!
//! A good surface of n triangles lies about c / n from the fine one. The first round, with shares by the fine triangles,
//! measures c for each label. Later rounds share the triangles out in proportion to it, so that all labels have about the
//! same distance.

use std::path::Path;

use super::parts::Parts;
use crate::export::write::{Sink, Vertex};
use crate::export::{ExportStop, Exported, Exporter};
use crate::progress::Progress;
use crate::scratch;

/// Rounds of sharing out a number of triangles; the one with the least distance counts.
const ROUNDS: usize = 3;

/// Triangles of the smallest closed surface.
const MIN_TRIANGLES: u64 = 4;

/// Distance in voxels that stands for a smaller one: flat labels have none.
const MIN_APART: f64 = 0.01;

impl Exporter<'_> {
    /// The surfaces of some parts of fewer triangles, and figures of all of them.
    ///
    /// Memory: the surface of the part that has most triangles, and the buffers of three [`Parts`]. Temporary disk: up to
    /// twice as much as the fine triangles take.
    pub(super) fn fewer_of_parts(
        &self,
        fine: &Parts,
        (which, wanted): (&[usize], &[bool]),
        scratch: &Path,
        progress: &dyn Progress,
    ) -> Result<(Parts, Exported), ExportStop> {
        let most: Vec<u64> = which.iter().map(|part| fine.counts(*part)[1]).collect();
        let mut weights: Vec<f64> = most.iter().map(|count| to_f64(*count)).collect();
        let is_shared = self.triangles.is_some_and(|count| which.len() > 1 && count < most.iter().sum());
        let rounds = if is_shared { ROUNDS } else { 1 };
        progress.stage("reduce", (rounds * which.len()) as u64);
        let mut round = || -> Result<(Parts, Exported), ExportStop> {
            let shares = self.triangles.map(|count| shared(count, &weights, &most));
            let (mut few, mut sum) = (Parts::new(scratch::unnamed(scratch)?, wanted), Exported::default());
            for (at, part) in which.iter().enumerate() {
                progress.check()?;
                let mut whole = self.fewer(shares.as_ref().map(|shares| shares[at]), progress);
                fine.each_vertex(*part, |[at, normal]| whole.vertex(&Vertex { at, normal, light: [0; 3] }))?;
                fine.each_triangle(*part, |corners| whole.triangle(corners, [[0.0; 3]; 3]))?;
                let made = whole.reduce(Exported { triangles: most[at], ..Exported::default() })?;
                for Vertex { at, normal, .. } in &whole.vertices {
                    few.vertex(*part, &[*at, *normal])?;
                }
                whole.faces.iter().try_for_each(|face| few.triangle(*part, *face))?;
                let apart_mm = made.distance_mm.unwrap_or_default().max(MIN_APART * self.voxel_mm());
                weights[at] = to_f64(made.triangles) * apart_mm;
                sum.triangles += made.triangles;
                sum.fine_triangles += made.fine_triangles;
                if made.distance_mm > sum.distance_mm {
                    (sum.distance_mm, sum.distance_at) = (made.distance_mm, made.distance_at);
                }
                sum.within_mm = made.within_mm;
                sum.parts_gone =
                    Some(sum.parts_gone.unwrap_or_default() + made.parts_gone.unwrap_or_default());
                sum.pieces_gone += made.pieces_gone;
                progress.advance(1);
            }
            Ok((few, sum))
        };
        // A label that cannot be reduced has all its triangles, and no distance.
        let rank = |(_, made): &(Parts, Exported)| {
            (made.triangles.max(self.triangles.unwrap_or(0)), made.distance_mm.unwrap_or(f64::INFINITY))
        };
        let mut best = round()?;
        for _ in 1..rounds {
            let next = round()?;
            if rank(&next) < rank(&best) {
                best = next;
            }
        }
        Ok(best)
    }
}

/// A number shared out in proportion to weights; no share is greater than its `most`, or less than [`MIN_TRIANGLES`] unless that is.
fn shared(count: u64, weights: &[f64], most: &[u64]) -> Vec<u64> {
    if count >= most.iter().sum() {
        return most.to_vec();
    }
    let mut shares: Vec<u64> = most.iter().map(|most| MIN_TRIANGLES.min(*most)).collect();
    let mut left = count.saturating_sub(shares.iter().sum());
    let mut rest = weights.iter().sum::<f64>();
    let mut order: Vec<usize> = (0..weights.len()).collect();
    let fills = |at: &usize| to_f64(most[*at]) / weights[*at];
    // A share that is full leaves more to those after it.
    crate::order::by(&mut order, |a, b| fills(a).total_cmp(&fills(b)));
    for at in order {
        #[expect(clippy::cast_possible_truncation, reason = "at most the number")]
        let more = (to_f64(left) * (weights[at] / rest).min(1.0)) as u64;
        let more = more.min(most[at] - shares[at]);
        shares[at] += more;
        left -= more;
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
        assert_eq!(shared(108, &[1.0, 3.0], &[1000, 1000]), [29, 79]);
        assert_eq!(shared(112, &[1.0, 3.0, 1.0], &[1000, 24, 1000]), [44, 24, 44]);
        assert_eq!(shared(100, &[5.0, 0.1], &[10, 10]), [10, 10]);
        // Each keeps the least, those with fewer theirs, whatever the number.
        assert_eq!(shared(20, &[1e5, 1.0, 1.0, 0.0], &[100_000, 100, 100, 0]), [11, 4, 5, 0]);
        assert_eq!(shared(7, &[1.0; 3], &[9, 9, 2]), [4, 4, 2]);
    }
}
