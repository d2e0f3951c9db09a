//! Statistics of a value over a surface, weighted by area.
//!
//! Percentiles go by magnitude, and come from a table of 65,536 of them with whole numbers as areas, so that they do not
//! depend on the order of the values. Sums are those of the order in which values come.

/// Entries of the table.
const BINS: usize = 1 << 16;

/// Parts of a cell's face that an area is counted in.
const PARTS: f64 = 1_048_576.0;

/// The distribution of a value over a surface.
///
/// Memory: 512 KiB. Cost: nanoseconds a value.
#[derive(Clone, Debug, Default)]
pub(crate) struct Distribution {
    /// Width of a bin.
    bin: f64,
    /// Area in mm2 to whole numbers.
    scale: f64,
    areas: Vec<u64>,
    total: u64,
    /// Sums of area, of area times value, and of area times its square.
    sums: [f64; 3],
    count: u64,
    least: f64,
    most: f64,
}

impl Distribution {
    /// A distribution of values up to `extent` in size, on a model whose finest spacing is given in mm.
    pub(crate) fn new(extent: f64, finest: f64) -> Self {
        Self {
            bin: extent / (BINS - 1) as f64,
            scale: PARTS / (finest * finest),
            areas: vec![0; BINS],
            least: f64::INFINITY,
            most: f64::NEG_INFINITY,
            ..Self::default()
        }
    }

    /// Adds a value that stands for an area in mm2.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts saturate")]
    pub(crate) fn add(&mut self, value: f64, area: f64) {
        // Rounded half up, as neither is below 0.
        let weight = (area * self.scale + 0.5) as u64;
        let at = (value.abs() / self.bin + 0.5) as usize;
        self.areas[at.min(BINS - 1)] += weight;
        self.total += weight;
        for (sum, term) in self.sums.iter_mut().zip([1.0, value, value * value]) {
            *sum += area * term;
        }
        self.count += 1;
        (self.least, self.most) = (self.least.min(value), self.most.max(value));
    }

    /// Values.
    pub(crate) fn count(&self) -> u64 {
        self.count
    }

    /// Mean and root mean square; `None` without area.
    pub(crate) fn mean_and_rms(&self) -> Option<[f64; 2]> {
        let [area, first, second] = self.sums;
        (area > 0.0).then(|| [first / area, (second / area).sqrt()])
    }

    /// Least and greatest value.
    pub(crate) fn range(&self) -> Option<[f64; 2]> {
        (self.count > 0).then_some([self.least, self.most])
    }

    /// The magnitude that so much of the area does not exceed, 0 to 1.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "areas stay below 2^53 parts for all but the largest models"
    )]
    pub(crate) fn percentile(&self, part: f64) -> Option<f64> {
        let wanted = ((part * self.total as f64).ceil() as u64).max(1);
        let mut sum = 0;
        let at = self.areas.iter().position(|area| {
            sum += area;
            sum >= wanted
        })?;
        // A bin's middle may lie beyond all values.
        let [one, other] = [self.least.abs(), self.most.abs()];
        let least = if self.least * self.most > 0.0 { one.min(other) } else { 0.0 };
        Some((at as f64 * self.bin).clamp(least, one.max(other)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_weighted_by_area() {
        let mut all = Distribution::new(10.0, 0.5);
        assert_eq!((all.mean_and_rms(), all.range(), all.percentile(0.5)), (None, None, None));
        all.add(-1.0, 3.0);
        all.add(4.0, 1.0);
        assert_eq!(all.count(), 2);
        assert_eq!(all.mean_and_rms(), Some([0.25, (19.0_f64 / 4.0).sqrt()]));
        assert_eq!(all.range(), Some([-1.0, 4.0]));
        for (part, due) in [(0.0, 1.0), (0.75, 1.0), (0.76, 4.0), (1.0, 4.0)] {
            assert!((all.percentile(part).unwrap() - due).abs() < 1e-4, "{part}");
        }
        all.add(99.0, 100.0);
        assert_eq!(all.percentile(0.9), Some(10.0));
        let mut one = Distribution::new(10.0, 0.5);
        one.add(-1.0 / 3.0, 1.0);
        assert_eq!(one.percentile(0.05), Some(1.0 / 3.0));
    }
}
