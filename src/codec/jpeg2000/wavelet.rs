//! Inverse wavelet transforms in place (ISO/IEC 15444-1 Annex F).

use super::allowance::Allowance;
use super::geometry::TileLayout;
use crate::codec::CodecError;

/// Columns transformed together: half a cache line.
const LANES: usize = 8;

/// Lifting coefficients and scale of the 9/7 filter (Table F.4).
const ALPHA: f32 = -1.586_134_3;
const BETA: f32 = -0.052_980_12;
const GAMMA: f32 = 0.882_911_1;
const DELTA: f32 = 0.443_506_85;
const SCALE: f32 = 1.230_174_1;

/// A coefficient of an irreversible component, kept as its bit pattern.
pub(super) fn float(bits: i32) -> f32 {
    f32::from_bits(bits.cast_unsigned())
}

pub(super) fn pattern(value: f32) -> i32 {
    value.to_bits().cast_signed()
}

/// Room for one row, and for [`LANES`] columns.
pub(super) struct Scratch {
    row: Vec<[i32; 1]>,
    columns: Vec<[i32; LANES]>,
}

impl Scratch {
    pub(super) fn new(longest: usize, allowance: &mut Allowance) -> Result<Self, CodecError> {
        Ok(Self { row: allowance.filled(longest, [0])?, columns: allowance.filled(longest, [0; LANES])? })
    }
}

/// Transforms one component of a tile whose area begins at the first of `samples`, in rows of `stride`.
pub(super) fn invert(
    reversible: bool,
    layout: &TileLayout,
    component: usize,
    samples: &mut [i32],
    stride: usize,
    scratch: &mut Scratch,
) {
    let Some(component) = layout.components.get(component) else { return };
    for level in component.resolutions.iter().skip(1) {
        let (width, height) = (level.rect.width() as usize, level.rect.height() as usize);
        if width == 0 || height == 0 {
            continue;
        }
        let (odd_x, odd_y) = ((level.rect.x0 & 1) as usize, (level.rect.y0 & 1) as usize);
        // Low coefficients are at even places of the whole grid.
        let low = (width + 1 - odd_x) / 2;
        let line = &mut scratch.row[..width];
        for row in samples.chunks_mut(stride).take(height) {
            let row = &mut row[..width];
            interleave(line, odd_x, low, |index| [row[index]]);
            filter(reversible, line, odd_x);
            for (to, from) in row.iter_mut().zip(line.iter()) {
                *to = from[0];
            }
        }
        let low = (height + 1 - odd_y) / 2;
        let lines = &mut scratch.columns[..height];
        for x in (0..width).step_by(LANES) {
            let lanes = LANES.min(width - x);
            interleave(lines, odd_y, low, |index| {
                let mut values = [0; LANES];
                values[..lanes].copy_from_slice(&samples[index * stride + x..index * stride + x + lanes]);
                values
            });
            filter(reversible, lines, odd_y);
            for (row, from) in samples.chunks_mut(stride).zip(lines.iter()) {
                row[x..x + lanes].copy_from_slice(&from[..lanes]);
            }
        }
    }
}

/// Interleaves the low coefficients, which come first, with the high ones.
fn interleave<const N: usize>(
    line: &mut [[i32; N]],
    odd: usize,
    low: usize,
    value: impl Fn(usize) -> [i32; N],
) {
    for (index, to) in line.iter_mut().skip(odd).step_by(2).enumerate() {
        *to = value(index);
    }
    for (index, to) in line.iter_mut().skip(1 - odd).step_by(2).enumerate() {
        *to = value(low + index);
    }
}

/// Inverts one line whose low coefficients are at the places of parity `odd`.
fn filter<const N: usize>(reversible: bool, line: &mut [[i32; N]], odd: usize) {
    if line.len() == 1 {
        // A single high coefficient is twice the sample (F.3.6).
        if odd == 1 {
            line[0] = line[0].map(|value| if reversible { value >> 1 } else { pattern(float(value) * 0.5) });
        }
        return;
    }
    let (low, high) = (odd, 1 - odd);
    if reversible {
        lift(line, low, |value, before, after| {
            value.wrapping_sub(before.wrapping_add(after).wrapping_add(2) >> 2)
        });
        lift(line, high, |value, before, after| value.wrapping_add(before.wrapping_add(after) >> 1));
        return;
    }
    for (index, values) in line.iter_mut().enumerate() {
        let scale = if index & 1 == low { SCALE } else { 1.0 / SCALE };
        *values = values.map(|value| pattern(float(value) * scale));
    }
    for (first, factor) in [(low, DELTA), (high, GAMMA), (low, BETA), (high, ALPHA)] {
        lift(line, first, |value, before, after| {
            pattern(float(value) - factor * (float(before) + float(after)))
        });
    }
}

/// One lifting step on every other place, mirrored at both ends.
#[inline]
fn lift<const N: usize>(line: &mut [[i32; N]], first: usize, step: impl Fn(i32, i32, i32) -> i32) {
    let last = line.len() - 1;
    for at in (first..=last).step_by(2) {
        let before = line[if at == 0 { 1 } else { at - 1 }];
        let after = line[if at == last { at - 1 } else { at + 1 }];
        for ((value, before), after) in line[at].iter_mut().zip(before).zip(after) {
            *value = step(*value, before, after);
        }
    }
}
