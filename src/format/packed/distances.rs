//! Offsets of a group's cells, each predicted from the planes of the coded cells around it (SPEC 5.8). The normals are
//! known.
//!
//! The surface bends evenly between neighbours, so a neighbour's plane is extrapolated by the mean of both normals:
//! with the normal of one of the two 3.76 bits a cell of a head are left, with the mean 3.55 (zstd: 6.9).

use super::CodingError;
use super::blocks::{Blocks, CORNERS, EDGES, FACES, Neighbour, Octet, SELF, VoxelCoder, Window};
use super::classes::{Classes, SHARES, TOKENS, difference_of, low_bits, token_of};
use super::group::{Group, SymbolGroups};
use super::tables::{SymbolCoder, Tables};
use crate::format::cell::HAS_CORNERS;
use crate::format::normal::decode_l1;

// Lanes of a cell in the grid: its L1-127 vector, 1 for having a plane, its offset, the error of the prediction, 1 for
// having corners.
const PLANE: usize = 3;
const OFFSET: usize = 4;
const OFF: usize = 5;
const CORNERED: usize = 6;

/// The symbol of a cell with corners. The previous symbol covers all differences of 96 and more.
const CORNERS_TOKEN: usize = 15;
/// Further bits of the previous symbol: 0 to 158, and the sign.
const FAR_BITS: u32 = 9;
/// Largest counted distance of a neighbour's prediction from the mean.
const FAR: i32 = 80;
/// Largest residual that counts.
const MAX_OFF: i32 = 120;
/// Most neighbours coded before a cell.
const NEAR: usize = 19;

/// Weights of neighbours across a face, an edge, a corner, by the distance of their normals from the cell's own; 512
/// across a face with the same normal.
static WEIGHTS: [[i32; 256]; 3] = {
    let mut weights = [[0; 256]; 3];
    let base = [8, 3, 1];
    let mut kind = 0;
    while kind < 3 {
        let mut apart = 0;
        while apart < 256 {
            let weight = 64 * 32 * base[kind] / (32 + apart * apart);
            weights[kind][apart as usize] = if weight < 1 { 1 } else { weight };
            apart += 1;
        }
        kind += 1;
    }
    weights
};

static OFF_CLASSES: Classes = Classes::new(&[1, 3, 5, 7, 10, 14, 19, 26, 36, 52, 76, 110, 160, 230]);
static SPREAD_CLASSES: Classes = Classes::new(&[3, 7, 11, 15, 21, 27, 35, 47, 63, 90]);
static COUNT_CLASSES: Classes = Classes::new(&[0, 1, 2, 4, 7]);

/// Codes the offsets of groups of cells.
#[derive(Debug)]
pub(crate) struct DistanceCoder {
    blocks: Blocks,
    spread: Tables<128, 5, 7>,
    off: Tables<64, 5, 7>,
}

impl Default for DistanceCoder {
    fn default() -> Self {
        Self { blocks: Blocks::default(), spread: Tables::new(), off: Tables::new() }
    }
}

impl SymbolGroups for DistanceCoder {
    const VOXELS: usize = 1 << 17;

    #[inline(always)]
    fn code<C: SymbolCoder>(&mut self, coder: &mut C, group: &mut Group) -> Result<(), CodingError> {
        self.spread.restart();
        self.off.restart();
        let mut offsets = std::mem::take(&mut group.offsets);
        offsets.resize(group.voxels, 0);
        let mut voxels = Distances {
            spread: &mut self.spread,
            off: &mut self.off,
            normals: &group.normals,
            offsets: &mut offsets,
        };
        let result = self.blocks.code(coder, group, &mut voxels);
        group.offsets = offsets;
        result
    }
}

/// The offsets of a group while they are coded.
struct Distances<'a> {
    spread: &'a mut Tables<128, 5, 7>,
    off: &'a mut Tables<64, 5, 7>,
    normals: &'a [u16],
    offsets: &'a mut [u8],
}

/// The neighbours' predictions of a cell's offset.
#[derive(Default)]
struct Predictions {
    offsets: [i32; NEAR],
    weights: [i32; NEAR],
    planes: i32,
    cornered: i32,
    off: i32,
}

impl Predictions {
    /// Adds neighbours of one kind; the first has number `from`.
    #[inline(always)]
    fn add(
        &mut self,
        window: &Window,
        neighbours: &[Neighbour],
        from: usize,
        weights: &[i32; 256],
        own: [i32; 3],
    ) {
        for (i, near) in neighbours.iter().enumerate() {
            let lanes = &window[near.at].0;
            let known = |lane: usize| i32::from(lanes[lane]);
            let (mut offset, mut apart) = (known(OFFSET), 0);
            for (a, own) in own.iter().enumerate() {
                offset = offset.wrapping_add(own.wrapping_add(known(a)).wrapping_mul(near.away[a]));
                apart += own.abs_diff(known(a));
            }
            // A position without a plane has no weight.
            let weight = weights[apart as usize % 256] & known(PLANE).wrapping_neg();
            self.offsets[(from + i) % NEAR] = offset;
            self.weights[(from + i) % NEAR] = weight;
            self.planes = self.planes.wrapping_add(known(PLANE));
            self.cornered = self.cornered.wrapping_add(known(CORNERED));
            self.off = self.off.wrapping_add(known(OFF));
        }
    }

    /// The expected offset, and four times the neighbours' distance from it.
    #[inline(always)]
    fn expected(&self) -> (i32, i32) {
        let (mut sum, mut weight) = (0_i32, 0_i32);
        for (offset, w) in self.offsets.iter().zip(&self.weights) {
            sum = sum.wrapping_add(offset.wrapping_mul(*w));
            weight = weight.wrapping_add(*w);
        }
        if weight == 0 {
            return (0, 0);
        }
        let expected = (2 * sum + weight).div_euclid(2 * weight).clamp(-127, 127);
        let mut far = 0_i32;
        for (offset, w) in self.offsets.iter().zip(&self.weights) {
            far = far.wrapping_add(offset.wrapping_sub(expected).wrapping_abs().min(FAR).wrapping_mul(*w));
        }
        (expected, 4 * far / weight)
    }
}

impl VoxelCoder for Distances<'_> {
    #[inline(always)]
    fn begin_subtree(&mut self) {}

    #[inline(always)]
    fn code_voxel<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        window: &mut Window,
        number: usize,
    ) -> Result<(), CodingError> {
        let (Some(normal), Some(slot)) = (self.normals.get(number), self.offsets.get_mut(number)) else {
            return Err(CodingError::SUBTREE_TOO_DEEP);
        };
        let own = decode_l1(*normal);
        let mut predictions = Predictions::default();
        let [faces, edges, corners] = &WEIGHTS;
        predictions.add(window, &FACES, 0, faces, own);
        predictions.add(window, &EDGES, FACES.len(), edges, own);
        predictions.add(window, &CORNERS, FACES.len() + EDGES.len(), corners, own);
        let (expected, spread) = predictions.expected();
        let first = if predictions.planes == 0 { 15 } else { SPREAD_CLASSES.of(spread) } * 8
            + COUNT_CLASSES.of(predictions.planes);
        let off = (4 * predictions.off).wrapping_mul(SHARES[predictions.planes as usize % 64]) >> 16;
        let second = if predictions.planes == 0 { 15 } else { OFF_CLASSES.of(off) } * 4
            + predictions.cornered.min(3) as usize;
        let given = slot.cast_signed();
        let residual = i32::from(given) - expected;
        let token = token_of(residual.unsigned_abs()).min(CORNERS_TOKEN - 1);
        let token = if given == HAS_CORNERS { CORNERS_TOKEN } else { token };
        let token = coder.code((self.spread, first), (self.off, second), token);
        let lanes = if token == CORNERS_TOKEN {
            *slot = HAS_CORNERS.cast_unsigned();
            [own[0], own[1], own[2], 0, 0, 0, 1, 0]
        } else {
            let bits = if token + 1 == CORNERS_TOKEN { FAR_BITS } else { TOKENS[token].1 };
            let residual = difference_of(token, coder.even(bits, low_bits(token, bits, residual)));
            let offset = i8::try_from(expected + residual).ok().filter(|o| *o != HAS_CORNERS);
            let offset = offset.ok_or(CodingError("a packed offset is out of range (SPEC 5.8)"))?;
            *slot = offset.cast_unsigned();
            [own[0], own[1], own[2], 1, offset.into(), residual.abs().min(MAX_OFF), 0, 0]
        };
        // All lanes are far below 32768.
        window[SELF] = Octet::of(lanes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::group::tests::slab;
    use super::super::tables::{Decoder, Encoder};
    use super::*;
    use crate::cpu::Portable;
    use crate::format::normal;

    #[test]
    fn offsets_come_back_and_those_of_a_plane_cost_little() {
        let mut group = slab(4, 6);
        let tilted = normal::encode([0.02, 0.03, 1.0]);
        group.normals = vec![tilted; group.voxels];
        let all: Vec<u8> = (0..group.voxels).map(|i| (i * 37 % 256).to_le_bytes()[0]).collect();
        for (offsets, most_bits) in [(vec![9; group.voxels], 3), (all, 16)] {
            group.offsets = offsets.clone();
            let mut encoder = Encoder::new(Portable);
            DistanceCoder::default().code(&mut encoder, &mut group).unwrap();
            let payload = encoder.finish();
            assert!(payload.len() * 8 < most_bits * group.voxels, "{}", payload.len());
            group.offsets.clear();
            let mut decoder = Decoder::new(Portable, &payload).unwrap();
            DistanceCoder::default().code(&mut decoder, &mut group).unwrap();
            decoder.finish().unwrap();
            assert!(group.offsets == offsets);
        }
    }
}
