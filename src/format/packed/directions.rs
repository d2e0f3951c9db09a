//! Normals of a group, each predicted from the coded voxels around it (SPEC 5.7).
#![expect(clippy::cast_possible_truncation, reason = "components were held to a byte")]

use super::CodingError;
use super::blocks::{Blocks, CORNERS, EDGES, FACES, Neighbour, Octet, SELF, VoxelCoder, Window};
use super::classes::{Classes, SHARES, TOKENS, difference_of, low_bits, token_of};
use super::group::{Group, SymbolGroups};
use super::tables::{SymbolCoder, Tables};
use crate::format::normal::{SCALE, decode_l1};

// Lanes of a voxel in the grid: x, y, z of its L1-127 vector, 1 for presence, the errors of both coordinates in
// quarters, and the error of the prediction. Weighted sums of each stay in 16 bits: the weights add up to 58.
const COUNT: usize = 3;
const ERRORS: [usize; 2] = [4, 5];
const OFF: usize = 6;
/// Largest error that is stored, in quarters.
const MAX_ERROR: i32 = 350;
/// Largest residual that counts.
const MAX_OFF: u32 = 120;

const BIASES: usize = 2048;

/// A running mean of errors in one context, in 1/256.
type Bias = [i32; BIASES];

#[derive(Debug)]
struct Component {
    off: Tables<256, 5, 7>,
    bent: Tables<256, 5, 7>,
    bias: Box<Bias>,
}

/// Codes the normals of groups.
#[derive(Debug, Default)]
pub(crate) struct DirectionCoder {
    blocks: Blocks,
    known: DirectionTables,
}

#[derive(Debug)]
struct DirectionTables {
    components: [Component; 2],
    twins: [Tables<2, 5, 7>; 2],
}

impl Default for DirectionTables {
    fn default() -> Self {
        let component = || Component { off: Tables::new(), bent: Tables::new(), bias: Box::new([0; BIASES]) };
        Self { components: [component(), component()], twins: [Tables::new(), Tables::new()] }
    }
}

/// The two octahedral coordinates of an L1-127 vector, `s(0) = +1` (SPEC 4.6).
#[inline(always)]
fn chart(v: [i32; 3]) -> [i32; 2] {
    let s = |c: i32| if c < 0 { -1 } else { 1 };
    if v[2] >= 0 { [v[0], v[1]] } else { [s(v[0]) * (SCALE - v[1].abs()), s(v[1]) * (SCALE - v[0].abs())] }
}

/// Mirrors a vector when the prediction points down, so that the chart's fold lies opposite to it.
#[inline(always)]
fn mirrored(v: [i32; 3], mirror: bool) -> [i32; 3] {
    if mirror { [v[0], v[1], v[2].wrapping_neg()] } else { v }
}

#[inline(always)]
fn code_of(c: [i32; 2]) -> u16 {
    u16::from(c[0] as u8) | u16::from(c[1] as u8) << 8
}

/// A class with a sign, 0 to 15.
#[inline(always)]
fn signed(class: usize, value: i32) -> usize {
    class + if value < 0 { 8 } else { 0 }
}

static OFF_CLASSES: Classes = Classes::new(&[1, 3, 5, 7, 10, 14, 19, 26, 36, 52, 76, 110, 160, 230]);
static COUNT_CLASSES: Classes = Classes::new(&[10, 20, 34]);
static ERROR_CLASSES: Classes = Classes::new(&[1, 3, 6, 12, 24, 60]);
static BENT_CLASSES: Classes = Classes::new(&[4, 12, 24, 48, 100, 240]);
static OTHER_CLASSES: Classes = Classes::new(&[1, 3, 8]);

impl SymbolGroups for DirectionCoder {
    /// Half of the infobytes' number, to save memory; costs 0.7 % of the bytes of normals.
    const VOXELS: usize = 1 << 17;

    #[inline(always)]
    fn code<C: SymbolCoder>(&mut self, coder: &mut C, group: &mut Group) -> Result<(), CodingError> {
        for component in &mut self.known.components {
            component.off.restart();
            component.bent.restart();
            component.bias.fill(0);
        }
        self.known.twins.iter_mut().for_each(Tables::restart);
        let mut codes = std::mem::take(&mut group.normals);
        codes.resize(group.voxels, 0);
        if coder.even(1, 0) != 0 {
            return Err(CodingError::NORMAL_RANGE);
        }
        let known = &mut self.known;
        let mut voxels = Directions { known, codes: &mut codes, last: [0, 0, SCALE] };
        let result = self.blocks.code(coder, group, &mut voxels);
        group.normals = codes;
        result
    }
}

/// The normals of a group while they are coded.
struct Directions<'a> {
    known: &'a mut DirectionTables,
    codes: &'a mut [u16],
    last: [i32; 3],
}

impl VoxelCoder for Directions<'_> {
    #[inline(always)]
    fn begin_subtree(&mut self) {
        self.last = [0, 0, SCALE];
    }

    #[inline(always)]
    fn code_voxel<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        window: &mut Window,
        number: usize,
    ) -> Result<(), CodingError> {
        let Some(code) = self.codes.get_mut(number) else { return Err(CodingError::SUBTREE_TOO_DEEP) };
        *code = code_one(self.known, coder, window, self.last, *code)?;
        self.last = decode_l1(*code);
        Ok(())
    }
}

/// Coordinate of the direction of a sum, in 1/16, by `part` = 2^20 over the sum's L1 length.
#[inline(always)]
fn sixteenths(sum: i32, part: u32) -> i32 {
    let magnitude = sum.unsigned_abs().wrapping_mul(part).wrapping_mul(16 * SCALE.unsigned_abs()) >> 20;
    if sum < 0 { magnitude.cast_signed().wrapping_neg() } else { magnitude.cast_signed() }
}

/// The neighbours' predictions of both coordinates.
struct Around {
    sum: Octet,
    /// Reciprocal of the weights in the sum.
    share: i32,
    ahead: Octet,
    /// Predicted coordinates, in 1/16.
    guess: [i32; 2],
    off: usize,
    first: usize,
}

impl Around {
    #[inline(always)]
    fn known(&self, i: usize, due: i32) -> CoordinateContext {
        let two = i32::from(self.ahead.0[COUNT]);
        let ahead = i32::from(self.ahead.0[i]).wrapping_mul(16).wrapping_mul(SHARES[two as usize % 64]) >> 16;
        let turn = if two == 0 { 0 } else { ahead.wrapping_sub(self.guess[i]) };
        let error = i32::from(self.sum.0[ERRORS[i]]).wrapping_mul(self.share) >> 16;
        CoordinateContext { due, guess: self.guess[i], turn, error, off: self.off, first: self.first }
    }
}

struct CoordinateContext {
    due: i32,
    /// Prediction in 1/16, like the next three.
    guess: i32,
    turn: i32,
    error: i32,
    off: usize,
    first: usize,
}

struct Coded {
    value: i32,
    residual: i32,
    error: i32,
}

impl Component {
    #[inline(always)]
    fn code<C: SymbolCoder>(&mut self, coder: &mut C, known: &CoordinateContext, other: usize) -> Coded {
        let (bend, err) = (BENT_CLASSES.of(known.turn), ERROR_CLASSES.of(known.error));
        let context = ((known.off >> 1) * 16 + signed(bend, known.turn)) * 16 + signed(err, known.error);
        let bias = &mut self.bias[context % BIASES];
        let expected = (known.guess.wrapping_add(*bias >> 4).wrapping_add(8) >> 4).clamp(-SCALE, SCALE);
        let residual = known.due.wrapping_sub(expected);
        let magnitude = residual.unsigned_abs();
        let token = coder.code(
            (&mut self.off, known.first * 4 + other),
            (&mut self.bent, (bend * 8 + err) * 4 + other),
            token_of(magnitude),
        );
        let bits = TOKENS[token].1;
        let residual = difference_of(token, coder.even(bits, low_bits(token, bits, residual)));
        let value = expected.wrapping_add(residual);
        let wrong = (value << 4).wrapping_sub(known.guess);
        *bias = bias.wrapping_add((wrong << 4).wrapping_sub(*bias) >> 5);
        Coded { value, residual, error: (wrong >> 2).clamp(-MAX_ERROR, MAX_ERROR) }
    }
}

#[inline(always)]
fn code_one<C: SymbolCoder>(
    known: &mut DirectionTables,
    coder: &mut C,
    window: &mut Window,
    last: [i32; 3],
    code: u16,
) -> Result<u16, CodingError> {
    let DirectionTables { components: [u, v], twins } = known;
    // The face towards lower x comes last: its voxel is the one coded just before.
    let [others @ .., beside] = &FACES;
    let edges = sum_of(window, &EDGES).times(3);
    let known_before = edges.plus(sum_of(window, &CORNERS)).plus(sum_of(window, others).times(8));
    let sum = known_before.plus(window[beside.at].times(8));
    // Extrapolation from two voxels in a row.
    let mut ahead = Octet::default();
    for face in &FACES {
        let (near, far) = (window[face.at], window[2 * face.at - SELF]);
        // 1 in all lanes where both voxels exist.
        let both = near.both(far).all_of_lane_3();
        let both = Octet::default().minus(both);
        ahead = ahead.plus(near.plus(near).minus(far).both(both));
    }
    let sums = sum.0;
    let weight = i32::from(sums[COUNT]);
    let share = SHARES[weight as usize % 64];
    let mut s = [i32::from(sums[0]), i32::from(sums[1]), i32::from(sums[2])];
    if weight == 0 {
        s = last;
    }
    let mut l1 = s[0].wrapping_abs().wrapping_add(s[1].wrapping_abs()).wrapping_add(s[2].wrapping_abs());
    if l1 == 0 {
        (s, l1) = ([0, 0, SCALE], SCALE);
    }
    let mirror = s[2] < 0;
    let part = (1 << 20) / l1 as u32;
    // In 1/16: sign and magnitude.
    let guess = [sixteenths(s[0], part), sixteenths(s[1], part)];
    let off = (4 * i32::from(sums[OFF])).wrapping_mul(share) >> 16;
    let off = if weight == 0 { 15 } else { OFF_CLASSES.of(off) };
    let around = Around { sum, share, ahead, guess, off, first: off * 4 + COUNT_CLASSES.of(weight) };
    let due = if C::READS { [0; 2] } else { chart(mirrored(decode_l1(code), mirror)) };
    let u = u.code(coder, &around.known(0, due[0]), 0);
    let v = v.code(coder, &around.known(1, due[1]), OTHER_CLASSES.of(u.residual));
    let got = [u.value, v.value];
    let errors = [u.error, v.error];
    let magnitudes = u.residual.unsigned_abs().min(MAX_OFF) + v.residual.unsigned_abs().min(MAX_OFF);
    if got[0].wrapping_abs() > SCALE || got[1].wrapping_abs() > SCALE {
        return Err(CodingError::NORMAL_RANGE);
    }
    let vector = mirrored(decode_l1(code_of(got)), mirror);
    let mut plain = chart(vector);
    // On the square's rim two codes share a direction: one symbol selects the code.
    if vector[2] < 0 && (vector[0] == 0 || vector[1] == 0) {
        let [u, v] = code.to_le_bytes();
        let [first, second] = twins;
        let axes = [(vector[0] == 0, u.cast_signed() < 0), (vector[1] == 0, v.cast_signed() < 0)];
        for (axis, (zero, negative)) in axes.into_iter().enumerate() {
            if zero && coder.code((first, axis), (second, axis), usize::from(negative)) & 1 == 1 {
                plain[axis] = -plain[axis];
            }
        }
    }
    let lanes = [vector[0], vector[1], vector[2], 1, errors[0], errors[1], magnitudes.cast_signed(), 0];
    // All lanes are far below 32768.
    window[SELF] = Octet::of(lanes);
    Ok(code_of(plain))
}

#[inline(always)]
fn sum_of(window: &Window, neighbours: &[Neighbour]) -> Octet {
    neighbours.iter().fold(Octet::default(), |sum, near| sum.plus(window[near.at]))
}

#[cfg(test)]
mod tests {
    use super::super::group::tests::slab;
    use super::super::tables::{Decoder, Encoder};
    use super::*;
    use crate::cpu::Portable;

    #[test]
    fn every_legal_code_comes_back_after_any_prediction() {
        let legal: Vec<u16> = (0..=u16::MAX).filter(|c| !c.to_le_bytes().contains(&0x80)).collect();
        assert_eq!(legal.len(), 255 * 255);
        let order: Vec<u16> =
            (0..legal.len()).map(|i| legal[i * 7919 % legal.len()]).chain(legal.clone()).collect();
        let mut group = slab(order.len() / 4096, 6);
        group.normals = order[..group.voxels].to_vec();
        let mut encoder = Encoder::new(Portable);
        DirectionCoder::default().code(&mut encoder, &mut group).unwrap();
        let payload = encoder.finish();
        let normals = std::mem::take(&mut group.normals);
        let mut decoder = Decoder::new(Portable, &payload).unwrap();
        DirectionCoder::default().code(&mut decoder, &mut group).unwrap();
        decoder.finish().unwrap();
        assert!(group.normals == normals);
    }
}
