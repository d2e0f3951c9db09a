//! Offsets of a subtree's cells, each predicted from the planes of the cells around it that are coded already
//! (SPEC 5.7). The normals are known.
//!
//! The surface bends evenly between neighbours, so that a neighbour's plane is carried on by the mean of both
//! normals: with the normal of one of the two 3.76 bits a cell of a head are left, with the mean 3.55 (zstd: 6.9).

use super::CodingError;
use super::around::{Neighbour, PLACES, clear, neighbours, place};
use super::coder::{Bit, BitCoder};
use super::residual::{COUNTS, OTHERS, Residual, SPREADS, count_class, spread_class};
use super::structure::Cell;
use crate::format::cell::HAS_CORNERS;
use crate::format::normal::{SCALE, decode_l1};

/// Contexts of whether a cell has corners: by how many of its neighbours do, up to 7, and whether some do not.
const FLAGS: usize = 16;
/// Of the weight of a neighbour: this over itself and the square of how far its normal is from the cell's own.
const SAME: i32 = 32;
/// A neighbour counts at least once, one across a face with the same normal 512 times.
const UNIT: i32 = 64;
/// Farthest that a neighbour's prediction counts as being from the mean.
const FAR: i32 = 80;

/// What the grid knows of a cell.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    code: u16,
    offset: i8,
    exists: bool,
}

/// Codes the offsets of subtrees one after the other; what it learns carries on until a restart.
#[derive(Debug)]
pub struct OffsetCoder {
    grid: Vec<Known>,
    flags: [Bit; FLAGS],
    residual: Residual,
    around: [Neighbour; 26],
}

impl Default for OffsetCoder {
    fn default() -> Self {
        Self {
            grid: vec![Known::default(); PLACES],
            flags: [Bit::NEW; FLAGS],
            residual: Residual::new(),
            around: neighbours(),
        }
    }
}

/// What is expected of a cell's offset.
struct Expected {
    offset: i32,
    flag: usize,
    /// Class of spread and of count together.
    class: usize,
}

impl OffsetCoder {
    /// Forgets what was learnt: the start of a group.
    pub fn restart(&mut self) {
        self.flags = [Bit::NEW; FLAGS];
        self.residual = Residual::new();
    }

    /// Codes the offsets of one subtree's cells, in the order of `cells` as are their normals, `codes`. A decoder
    /// replaces the values of `offsets`.
    ///
    /// # Errors
    /// A decoder ran out of bytes or left the range of offsets.
    pub fn code(
        &mut self,
        coder: &mut impl BitCoder,
        cells: &[Cell],
        codes: &[u16],
        offsets: &mut [u8],
    ) -> Result<(), CodingError> {
        let mut result = Ok(());
        for ((cell, code), offset) in cells.iter().zip(codes).zip(offsets) {
            let at = place(cell);
            match self.code_one(coder, at, *code, offset.cast_signed()) {
                Ok(done) => {
                    *offset = done.cast_unsigned();
                    if let Some(slot) = self.grid.get_mut(at) {
                        *slot = Known { code: *code, offset: done, exists: true };
                    }
                }
                Err(e) => {
                    result = Err(e);
                    break;
                }
            }
        }
        clear(&mut self.grid, cells, Known::default());
        result
    }

    fn code_one(
        &mut self,
        coder: &mut impl BitCoder,
        at: usize,
        code: u16,
        offset: i8,
    ) -> Result<i8, CodingError> {
        let expected = self.expect(at, code);
        if coder.code(&mut self.flags[expected.flag % FLAGS], offset == HAS_CORNERS)? {
            return Ok(HAS_CORNERS);
        }
        let due = i32::from(offset) - expected.offset;
        let got = expected.offset + self.residual.code(coder, expected.class * OTHERS, due)?;
        i8::try_from(got).ok().filter(|o| *o != HAS_CORNERS).ok_or(CodingError::OffsetRange)
    }

    /// SPEC 5.7: the weighted mean of what the coded neighbours with a plane say.
    fn expect(&self, at: usize, code: u16) -> Expected {
        let own = decode_l1(code);
        let mut said = [(0, 0); 26];
        let (mut sum, mut weights, mut count, mut with_corners) = (0, 0, 0, 0);
        for near in &self.around {
            let known = self.grid.get(at.wrapping_add_signed(near.step)).copied().unwrap_or_default();
            if !known.exists {
                continue;
            }
            if known.offset == HAS_CORNERS {
                with_corners += 1;
                continue;
            }
            let normal = decode_l1(known.code);
            let (mut says, mut apart) = (i32::from(known.offset), 0);
            for a in 0..3 {
                says += (own[a] + normal[a]) * near.away[a];
                apart += (own[a] - normal[a]).abs();
            }
            let weight = (near.weight * UNIT * SAME / (SAME + apart * apart)).max(1);
            said[count % 26] = (says, weight);
            count += 1;
            (sum, weights) = (sum + says * weight, weights + weight);
        }
        let flag = 2 * with_corners.min(7) + usize::from(count > 0);
        if count == 0 {
            return Expected { offset: 0, flag, class: (SPREADS - 1) * COUNTS };
        }
        let offset = (2 * sum + weights).div_euclid(2 * weights).clamp(-SCALE, SCALE);
        let spread: i32 =
            said[..count.min(26)].iter().map(|(says, w)| (says - offset).abs().min(FAR) * w).sum();
        let class = spread_class(4 * spread / weights) * COUNTS + count_class(count);
        Expected { offset, flag, class }
    }
}

#[cfg(test)]
mod tests {
    use super::super::coder::{Decoder, Encoder};
    use super::*;
    use crate::format::normal;

    #[test]
    fn offsets_come_back_and_those_of_a_smooth_surface_take_few_bits() {
        // A sphere around the origin, and every offset there is over and over.
        let (mut cells, mut codes, mut sphere): (Vec<Cell>, Vec<u16>, Vec<u8>) = Default::default();
        for z in 0..64_u8 {
            for y in 0..64_u8 {
                for x in 0..64_u8 {
                    let p = [x, y, z].map(|c| f32::from(c) + 0.5);
                    let length = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
                    let code = normal::encode(p);
                    let n = normal::decode_l1(code).map(|c| c as f32);
                    let size = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
                    let offset = (2.0 * (50.0 - length) * size).round();
                    if offset.abs() <= 127.0 {
                        cells.push([x, y, z]);
                        codes.push(code);
                        #[expect(clippy::cast_possible_truncation, reason = "held to the range")]
                        sphere.push((offset as i8).cast_unsigned());
                    }
                }
            }
        }
        let all = (0..sphere.len()).map(|i| (i * 37 % 256).to_le_bytes()[0]).collect();
        for (offsets, most_bits) in [(sphere, 4), (all, 16)] {
            let mut encoder = Encoder::default();
            OffsetCoder::default().code(&mut encoder, &cells, &codes, &mut offsets.clone()).unwrap();
            let payload = encoder.finish();
            assert!(payload.len() * 8 < most_bits * cells.len(), "{} of {}", payload.len(), cells.len());
            let mut decoder = Decoder::new(&payload).unwrap();
            let mut got = vec![0; offsets.len()];
            OffsetCoder::default().code(&mut decoder, &cells, &codes, &mut got).unwrap();
            assert_eq!(got, offsets);
            decoder.finish().unwrap();
        }
    }
}
