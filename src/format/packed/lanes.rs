//! Sixteen lanes of 16 bits: what the tables of symbols ask of a machine. The instructions are those that every x86-64
//! has; elsewhere, and in the test, the same in portable code.
#![allow(unsafe_code)]

/// Lanes of a row.
pub(super) const LANES: usize = 16;

/// Sixteen lanes in two halves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(32))]
pub(super) struct Row(pub(super) [[u16; 8]; 2]);

impl Row {
    /// One lane, its number held to the row.
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize) -> u16 {
        self.0.as_flattened()[lane % LANES]
    }

    /// A row of lanes.
    pub(super) const fn of(lanes: [u16; LANES]) -> Self {
        let mut row = Self([[0; 8]; 2]);
        let mut i = 0;
        while i < LANES {
            row.0[i / 8][i % 8] = lanes[i];
            i += 1;
        }
        row
    }
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{above, mean_of_four, sink};

#[cfg(not(target_arch = "x86_64"))]
pub(super) use portable::{above, mean_of_four, sink};

/// Written out with the instructions, for compilers take these loops apart into single lanes.
#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{
        __m128i, _mm_avg_epu16, _mm_cmpgt_epi16, _mm_cvtsi32_si128, _mm_movemask_epi8, _mm_packs_epi16,
        _mm_set1_epi16, _mm_srl_epi16, _mm_srli_epi16, _mm_sub_epi16, _mm_xor_si128,
    };

    use super::Row;

    #[inline(always)]
    fn vector(half: [u16; 8]) -> __m128i {
        bytemuck::cast(half)
    }

    /// `sink` of the portable form.
    #[inline(always)]
    pub(in super::super) fn sink(row: &mut Row, turn: &Row, end: &Row, shift: u8) {
        for half in 0..2 {
            let (lanes, turn, end) = (vector(row.0[half]), vector(turn.0[half]), vector(end.0[half]));
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            let moved = unsafe {
                let seen = _mm_xor_si128(lanes, turn);
                let way = _mm_srl_epi16(_mm_sub_epi16(seen, end), _mm_cvtsi32_si128(i32::from(shift & 15)));
                _mm_xor_si128(_mm_sub_epi16(seen, way), turn)
            };
            row.0[half] = bytemuck::cast(moved);
        }
    }

    /// `mean_of_four` of the portable form.
    #[inline(always)]
    pub(in super::super) fn mean_of_four(a: &Row, b: &Row, c: &Row, d: &Row) -> Row {
        let mut means = [[0; 8]; 2];
        for (half, mean) in means.iter_mut().enumerate() {
            let (a, b) = (vector(a.0[half]), vector(b.0[half]));
            let (c, d) = (vector(c.0[half]), vector(d.0[half]));
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            let all = unsafe { _mm_srli_epi16::<1>(_mm_avg_epu16(_mm_avg_epu16(a, b), _mm_avg_epu16(c, d))) };
            *mean = bytemuck::cast(all);
        }
        Row(means)
    }

    /// `above` of the portable form.
    #[inline(always)]
    pub(in super::super) fn above(row: &Row, value: u16) -> u32 {
        let (low, high) = (vector(row.0[0]), vector(row.0[1]));
        // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
        let bits = unsafe {
            let value = _mm_set1_epi16(value.cast_signed());
            _mm_movemask_epi8(_mm_packs_epi16(_mm_cmpgt_epi16(low, value), _mm_cmpgt_epi16(high, value)))
        };
        bits.cast_unsigned()
    }
}

#[cfg(any(test, not(target_arch = "x86_64")))]
mod portable {
    use super::Row;

    /// Moves lanes by 2^-shift of the way to `end`, the lanes and their ends seen through `turn`.
    #[inline(always)]
    pub(in super::super) fn sink(row: &mut Row, turn: &Row, end: &Row, shift: u8) {
        let others = turn.0.as_flattened().iter().zip(end.0.as_flattened());
        for (lane, (turn, end)) in row.0.as_flattened_mut().iter_mut().zip(others) {
            let seen = *lane ^ turn;
            *lane = seen.wrapping_sub(seen.wrapping_sub(*end) >> (shift & 15)) ^ turn;
        }
    }

    /// Half the mean of the means of two rows each, each mean rounded up, its half down.
    #[inline(always)]
    pub(in super::super) fn mean_of_four(a: &Row, b: &Row, c: &Row, d: &Row) -> Row {
        let mean = |a: u16, b: u16| (a >> 1) + (b >> 1) + ((a | b) & 1);
        Row([0, 1].map(|half| {
            std::array::from_fn(|i| {
                mean(mean(a.0[half][i], b.0[half][i]), mean(c.0[half][i], d.0[half][i])) >> 1
            })
        }))
    }

    /// Lanes above a value, lane i as bit i; lanes and value are below 32768.
    #[inline(always)]
    pub(in super::super) fn above(row: &Row, value: u16) -> u32 {
        let lanes = row.0.as_flattened().iter().enumerate();
        lanes.fold(0, |bits, (i, lane)| bits | u32::from(*lane > value) << i)
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;

    #[test]
    fn both_forms_give_the_same_lanes() {
        let mut state = 1_u32;
        let mut number = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as u16
        };
        let mut row = || Row::of(std::array::from_fn(|_| number()));
        for i in 0..2000 {
            let [a, b, c, d] = [row(), row(), row(), row()];
            for shift in 1..=15 {
                let (mut fast, mut plain) = (a, a);
                x86::sink(&mut fast, &b, &c, shift);
                portable::sink(&mut plain, &b, &c, shift);
                assert_eq!(fast, plain);
            }
            let mean = x86::mean_of_four(&a, &b, &c, &d);
            assert_eq!(mean, portable::mean_of_four(&a, &b, &c, &d));
            let value = mean.lane(i);
            assert_eq!(x86::above(&mean, value), portable::above(&mean, value));
        }
    }
}
