//! A receiver of decoded frames, for the decoders' unit tests.

use super::{CodecError, FrameFormat, RowSink};

/// Keeps the rows, and holds the decoder to the order and the size of what it says.
#[derive(Debug)]
pub(super) struct Kept {
    pub(super) format: Option<FrameFormat>,
    pub(super) rows: Vec<Vec<i32>>,
    /// Frames of more samples are refused.
    pub(super) most_samples: u64,
}

impl Default for Kept {
    /// Takes more than a test's own images have, and less than a damaged header may say.
    fn default() -> Self {
        Self { format: None, rows: Vec::new(), most_samples: 1 << 18 }
    }
}

impl RowSink for Kept {
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        assert!(self.format.replace(*format).is_none(), "begun twice");
        let samples = u64::from(format.columns) * u64::from(format.rows);
        if samples.saturating_mul(format.components.into()) > self.most_samples {
            return Err(CodecError::Unsupported("that many samples".into()));
        }
        Ok(())
    }

    fn row(&mut self, samples: &[i32]) -> Result<(), CodecError> {
        let format = self.format.expect("begun before rows");
        assert_eq!(samples.len(), format.columns as usize * usize::from(format.components));
        if format.precision <= 16 && !format.signed {
            let most = (1 << format.precision) - 1;
            assert!(samples.iter().all(|s| (0..=most).contains(s)), "a sample has more than its bits");
        }
        self.rows.push(samples.to_vec());
        assert!(self.rows.len() <= format.rows as usize, "more rows than were said");
        Ok(())
    }
}
