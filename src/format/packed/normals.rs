//! Normals of a subtree, each predicted from the voxels around it that are coded already (SPEC 5.4).

use super::CodingError;
use super::around::{Neighbour, PLACES, clear, neighbours, place};
use super::coder::{Bit, BitCoder};
use super::residual::{COUNTS, OTHERS, Residual, SPREADS, count_class, spread_class};
use super::structure::Cell;
use crate::format::normal::{SCALE, decode_l1};

/// In the grid: no voxel, or not coded yet. An illegal code (SPEC 4.6), so no voxel has it.
const NONE: u16 = 0x8080;

/// Codes the normals of subtrees one after the other; what it learns carries on until a restart.
#[derive(Debug)]
pub struct NormalCoder {
    grid: Vec<u16>,
    components: [Residual; 2],
    twins: [Bit; 2],
    around: [Neighbour; 26],
}

impl Default for NormalCoder {
    fn default() -> Self {
        Self {
            grid: vec![NONE; PLACES],
            components: [Residual::new(), Residual::new()],
            twins: [Bit::NEW; 2],
            around: neighbours(),
        }
    }
}

/// The two octahedral coordinates of an L1-127 vector, `s(0) = +1` (SPEC 4.6).
#[inline]
fn chart(v: [i32; 3]) -> [i32; 2] {
    let s = |c: i32| if c < 0 { -1 } else { 1 };
    if v[2] >= 0 { [v[0], v[1]] } else { [s(v[0]) * (SCALE - v[1].abs()), s(v[1]) * (SCALE - v[0].abs())] }
}

/// Mirrors a vector when the prediction looks down, so that the chart's fold lies opposite to it.
#[inline]
fn mirrored(v: [i32; 3], mirror: bool) -> [i32; 3] {
    if mirror { [v[0], v[1], -v[2]] } else { v }
}

fn code_of(c: [i32; 2]) -> Option<u16> {
    let byte =
        |v: i32| i8::try_from(v).ok().filter(|v| i32::from(v.unsigned_abs()) <= SCALE).map(i8::cast_unsigned);
    Some(u16::from(byte(c[0])?) | u16::from(byte(c[1])?) << 8)
}

/// What is expected of a voxel's normal.
struct Expected {
    chart: [i32; 2],
    mirror: bool,
    /// Class of spread and of count together.
    class: usize,
}

impl NormalCoder {
    /// Forgets what was learnt: the start of a group.
    pub fn restart(&mut self) {
        self.components = [Residual::new(), Residual::new()];
        self.twins = [Bit::NEW; 2];
    }

    /// Codes the normals of one subtree's voxels, `codes` in the order of `cells`. A decoder replaces
    /// their values.
    ///
    /// # Errors
    /// A decoder ran out of bytes or left the range of codes; an encoder met an illegal code.
    pub fn code(
        &mut self,
        coder: &mut impl BitCoder,
        cells: &[Cell],
        codes: &mut [u16],
    ) -> Result<(), CodingError> {
        let mut result = Ok(());
        let mut last = [0, 0, SCALE];
        for (cell, code) in cells.iter().zip(codes) {
            let at = place(cell);
            match self.code_one(coder, at, last, *code) {
                Ok(done) => {
                    *code = done;
                    last = decode_l1(done);
                    if let Some(slot) = self.grid.get_mut(at) {
                        *slot = done;
                    }
                }
                Err(e) => {
                    result = Err(e);
                    break;
                }
            }
        }
        clear(&mut self.grid, cells, NONE);
        result
    }

    fn code_one(
        &mut self,
        coder: &mut impl BitCoder,
        at: usize,
        last: [i32; 3],
        code: u16,
    ) -> Result<u16, CodingError> {
        let expected = self.expect(at, last);
        let vector = decode_l1(code);
        let due = chart(mirrored(vector, expected.mirror));
        let mut got = [0; 2];
        let mut other = 0;
        for (i, component) in self.components.iter_mut().enumerate() {
            let context = expected.class * OTHERS + other;
            let error = component.code(coder, context, due[i] - expected.chart[i])?;
            got[i] = expected.chart[i] + error;
            other = match error.abs() {
                0..=1 => 0,
                2..=3 => 1,
                4..=7 => 2,
                _ => 3,
            };
        }
        let vector = mirrored(decode_l1(code_of(got).ok_or(CodingError::NormalRange)?), expected.mirror);
        let mut plain = chart(vector);
        // On the square's rim two codes share a direction: one bit says which.
        if vector[2] < 0 {
            let [u, v] = code.to_le_bytes().map(u8::cast_signed);
            for (axis, (zero, negative)) in
                [(vector[0] == 0, u < 0), (vector[1] == 0, v < 0)].into_iter().enumerate()
            {
                if zero && coder.code(&mut self.twins[axis], negative)? {
                    plain[axis] = -plain[axis];
                }
            }
        }
        code_of(plain).ok_or(CodingError::NormalRange)
    }

    /// SPEC 5.4: the weighted sum of the coded neighbours, or the voxel before.
    fn expect(&self, at: usize, last: [i32; 3]) -> Expected {
        let mut sum = [0; 3];
        let mut near = [0_u16; 26];
        let mut count = 0;
        for Neighbour { step, weight, .. } in self.around {
            let code = self.grid.get(at.wrapping_add_signed(step)).copied().unwrap_or(NONE);
            if code != NONE {
                for (s, c) in sum.iter_mut().zip(decode_l1(code)) {
                    *s += c * weight;
                }
                near[count] = code;
                count += 1;
            }
        }
        if count == 0 {
            sum = last;
        }
        let mut l1: i32 = sum.iter().map(|c| c.abs()).sum();
        if l1 == 0 {
            (sum, l1) = ([0, 0, SCALE], SCALE);
        }
        let mirror = sum[2] < 0;
        let scaled = |c: i32| {
            let magnitude = (c.abs() * 2 * SCALE + l1) / (2 * l1);
            if c < 0 { -magnitude } else { magnitude }
        };
        let center = [scaled(sum[0]), scaled(sum[1])];
        let class = if count == 0 {
            (SPREADS - 1) * COUNTS
        } else {
            let spread: i32 = near[..count]
                .iter()
                .map(|code| {
                    let c = chart(mirrored(decode_l1(*code), mirror));
                    (c[0] - center[0]).abs().min(40) + (c[1] - center[1]).abs().min(40)
                })
                .sum();
            spread_class(4 * spread / i32::try_from(count).unwrap_or(1)) * COUNTS + count_class(count)
        };
        Expected { chart: center, mirror, class }
    }
}

#[cfg(test)]
mod tests {
    use super::super::coder::{Decoder, Encoder};
    use super::*;

    #[test]
    fn every_legal_code_comes_back_after_any_prediction() {
        let legal: Vec<u16> = (0..=u16::MAX).filter(|c| !c.to_le_bytes().contains(&0x80)).collect();
        assert_eq!(legal.len(), 255 * 255);
        // Neighbours in a row, so that predictions come from everywhere on the sphere.
        let cells: Vec<Cell> =
            (0..64 * 64).map(|i| [i % 64, i / 64, 7].map(|c| u8::try_from(c).unwrap())).collect();
        let mut encoder = Encoder::default();
        let mut coder = NormalCoder::default();
        let order: Vec<u16> =
            (0..legal.len()).map(|i| legal[i * 7919 % legal.len()]).chain(legal.clone()).collect();
        for part in order.chunks(cells.len()) {
            coder.code(&mut encoder, &cells[..part.len()], &mut part.to_vec()).unwrap();
        }
        let payload = encoder.finish();
        let mut decoder = Decoder::new(&payload).unwrap();
        let mut coder = NormalCoder::default();
        for part in order.chunks(cells.len()) {
            let mut got = vec![0; part.len()];
            coder.code(&mut decoder, &cells[..part.len()], &mut got).unwrap();
            assert_eq!(got, part);
        }
        decoder.finish().unwrap();
    }
}
