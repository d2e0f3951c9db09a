//! Lanes of 16 bits: the vector operations of the tables of symbols and the grids of voxels. They use the instructions
//! of every x86-64, and AVX2 where the caller has it; elsewhere, and in the test, the same in portable code.
#![allow(unsafe_code)]

pub(super) const LANES: usize = 16;

/// A boxed array of one value, built on the heap: `Box::new` would build it on the stack first.
pub(super) fn boxed<T: Copy, const N: usize>(value: T) -> Box<[T; N]> {
    // The list has this length, so it becomes the array, and the fallback is never taken.
    vec![value; N].into_boxed_slice().try_into().unwrap_or_else(|_| Box::new([value; N]))
}

/// Sixteen lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(32))]
pub(crate) struct Row(pub(super) [u16; LANES]);

impl Row {
    /// One lane; its number wraps within the row.
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize) -> u16 {
        self.0[lane % LANES]
    }
}

/// Eight lanes with wrapping arithmetic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(align(16))]
pub(super) struct Octet(pub(super) [i16; 8]);

/// Four inputs of a mixer and one more, or their weights; the rest are 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(32))]
pub(super) struct Inputs(pub(super) [i32; 8]);

/// Four lanes of 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(16))]
pub(super) struct Quad(pub(super) [u32; 4]);

/// The slots of three keys, one of each pair. A slot holds a number in its high half, a count and a key in its low
/// bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Found {
    /// The slot of each pair that has the key, else the one with the lower count, reset.
    pub(super) slots: Quad,
    firsts: Quad,
    seconds: Quad,
    /// All bits set where the slot is the second of its pair.
    is_second: Quad,
}

#[cfg(target_arch = "x86_64")]
pub(super) use x86::{find, last_within, learn, mean_of_four, mixed, products_above_0, sink, update};

#[cfg(not(target_arch = "x86_64"))]
pub(super) use portable::{find, last_within, learn, mean_of_four, mixed, products_above_0, sink, update};

/// Intrinsics, since compilers split these loops into single lanes.
#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{
        __m128i, __m256i, _mm_add_epi16, _mm_add_epi32, _mm_and_si128, _mm_andnot_si128, _mm_avg_epu16,
        _mm_blendv_epi8, _mm_cmpeq_epi32, _mm_cmpgt_epi16, _mm_cmpgt_epi32, _mm_cvtsi32_si128,
        _mm_cvtsi128_si32, _mm_madd_epi16, _mm_max_epi16, _mm_movemask_epi8, _mm_mullo_epi16,
        _mm_mullo_epi32, _mm_or_si128, _mm_packs_epi16, _mm_set_epi64x, _mm_set1_epi16, _mm_set1_epi32,
        _mm_setzero_si128, _mm_shuffle_epi32, _mm_shufflelo_epi16, _mm_slli_epi32, _mm_srai_epi32,
        _mm_srl_epi16, _mm_srli_epi32, _mm_sub_epi16, _mm_sub_epi32, _mm_unpackhi_epi32, _mm_unpackhi_epi64,
        _mm_unpacklo_epi32, _mm_unpacklo_epi64, _mm_xor_si128, _mm256_add_epi32, _mm256_avg_epu16,
        _mm256_castsi256_si128, _mm256_cmpgt_epi16, _mm256_extracti128_si256, _mm256_madd_epi16,
        _mm256_max_epi16, _mm256_max_epi32, _mm256_min_epi32, _mm256_movemask_epi8, _mm256_mullo_epi32,
        _mm256_set1_epi16, _mm256_set1_epi32, _mm256_setzero_si256, _mm256_srai_epi32, _mm256_srl_epi16,
        _mm256_sub_epi16, _mm256_xor_si256,
    };

    use super::{Found, Inputs, LANES, Octet, Quad, Row, portable};
    use crate::cpu::Lanes;

    #[inline(always)]
    fn halves(row: &Row) -> [__m128i; 2] {
        bytemuck::cast(row.0)
    }

    #[inline(always)]
    fn whole(row: &Row) -> __m256i {
        bytemuck::cast(row.0)
    }

    /// `sink` of the portable form.
    #[inline(always)]
    pub(in super::super) fn sink(isa: impl Lanes, row: &mut Row, turn: &Row, end: &Row, shift: u8) {
        let shift = i32::from(shift & 15);
        if isa.avx2().is_some() {
            let (lanes, turn, end) = (whole(row), whole(turn), whole(end));
            // SAFETY: the proof says that the machine has AVX2; no memory is accessed.
            let moved = unsafe {
                let seen = _mm256_xor_si256(lanes, turn);
                let way = _mm256_srl_epi16(_mm256_sub_epi16(seen, end), _mm_cvtsi32_si128(shift));
                _mm256_xor_si256(_mm256_sub_epi16(seen, way), turn)
            };
            row.0 = bytemuck::cast(moved);
            return;
        }
        let (mut lanes, turn, end) = (halves(row), halves(turn), halves(end));
        for ((lanes, turn), end) in lanes.iter_mut().zip(turn).zip(end) {
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            *lanes = unsafe {
                let seen = _mm_xor_si128(*lanes, turn);
                let way = _mm_srl_epi16(_mm_sub_epi16(seen, end), _mm_cvtsi32_si128(shift));
                _mm_xor_si128(_mm_sub_epi16(seen, way), turn)
            };
        }
        row.0 = bytemuck::cast(lanes);
    }

    /// `mean_of_four` of the portable form.
    #[inline(always)]
    pub(in super::super) fn mean_of_four(isa: impl Lanes, a: [&Row; 2], b: [&Row; 2]) -> Row {
        if isa.avx2().is_some() {
            let ([a, b], [c, d]) = (a.map(whole), b.map(whole));
            // SAFETY: the proof says that the machine has AVX2; no memory is accessed.
            return Row(bytemuck::cast(unsafe {
                _mm256_avg_epu16(_mm256_avg_epu16(a, b), _mm256_avg_epu16(c, d))
            }));
        }
        let ([a, b], [c, d]) = (a.map(halves), b.map(halves));
        let mean = |i: usize| {
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            unsafe { _mm_avg_epu16(_mm_avg_epu16(a[i], b[i]), _mm_avg_epu16(c[i], d[i])) }
        };
        Row(bytemuck::cast([mean(0), mean(1)]))
    }

    /// `products_above_0` of the portable form.
    #[inline(always)]
    pub(in super::super) fn products_above_0(isa: impl Lanes, sums: &[i16; 32], weights: &[i16; 32]) -> i32 {
        let sum = if isa.avx2().is_some() {
            let (sums, weights): ([__m256i; 2], [__m256i; 2]) =
                (bytemuck::cast(*sums), bytemuck::cast(*weights));
            // SAFETY: the proof says that the machine has AVX2; no memory is accessed.
            unsafe {
                let zero = _mm256_setzero_si256();
                let product = |i: usize| _mm256_madd_epi16(_mm256_max_epi16(sums[i], zero), weights[i]);
                let all = _mm256_add_epi32(product(0), product(1));
                _mm_add_epi32(_mm256_castsi256_si128(all), _mm256_extracti128_si256::<1>(all))
            }
        } else {
            let (sums, weights): ([__m128i; 4], [__m128i; 4]) =
                (bytemuck::cast(*sums), bytemuck::cast(*weights));
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            unsafe {
                let product =
                    |i: usize| _mm_madd_epi16(_mm_max_epi16(sums[i], _mm_setzero_si128()), weights[i]);
                _mm_add_epi32(_mm_add_epi32(product(0), product(1)), _mm_add_epi32(product(2), product(3)))
            }
        };
        sum_of(sum)
    }

    /// The sum of four lanes.
    #[inline(always)]
    fn sum_of(lanes: __m128i) -> i32 {
        // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
        unsafe {
            let half = _mm_add_epi32(lanes, _mm_shuffle_epi32::<0b01_00_11_10>(lanes));
            _mm_cvtsi128_si32(_mm_add_epi32(half, _mm_shuffle_epi32::<0b10_11_00_01>(half)))
        }
    }

    /// `mixed` of the portable form.
    #[inline(always)]
    pub(in super::super) fn mixed(isa: impl Lanes, weights: &Inputs, inputs: &Inputs) -> i32 {
        if isa.avx2().is_none() {
            return portable::mixed(isa, weights, inputs);
        }
        let [weight, _, input, _]: [__m128i; 4] = bytemuck::cast([weights.0, inputs.0]);
        // SAFETY: the proof says that the machine has AVX2; no memory is accessed.
        let products = unsafe { _mm_srai_epi32::<2>(_mm_mullo_epi32(weight, input)) };
        sum_of(products).wrapping_add(weights.0[4].wrapping_mul(inputs.0[4]) >> 2)
    }

    /// `find` of the portable form.
    #[inline(always)]
    pub(in super::super) fn find(isa: impl Lanes, pairs: [[u32; 2]; 3], keys: [u32; 3], new: u32) -> Found {
        if isa.avx2().is_none() {
            return portable::find(isa, pairs, keys, new);
        }
        let [[a, b], [c, d], [e, f]] = pairs;
        let two = |low: [u32; 2], high: [u32; 2]| bytemuck::cast::<_, __m128i>([low, high]);
        let (ab, cd) = (two([a, b], [c, d]), two([e, f], [0; 2]));
        let keys: __m128i = bytemuck::cast([keys[0], keys[1], keys[2], 0]);
        // SAFETY: the proof says that the machine has AVX2; no memory is accessed.
        let [slots, firsts, seconds, is_second] = unsafe {
            // [a, c, e, 0] and [b, d, f, 0].
            let (low, high) =
                (_mm_shuffle_epi32::<0b11_01_10_00>(ab), _mm_shuffle_epi32::<0b11_01_10_00>(cd));
            let (firsts, seconds) = (_mm_unpacklo_epi64(low, high), _mm_unpackhi_epi64(low, high));
            let byte = _mm_set1_epi32(0xff);
            let has_first = _mm_cmpeq_epi32(_mm_and_si128(firsts, byte), keys);
            let has_second = _mm_cmpeq_epi32(_mm_and_si128(seconds, byte), keys);
            let counts = _mm_set1_epi32(0xff00);
            let is_less = _mm_cmpgt_epi32(_mm_and_si128(firsts, counts), _mm_and_si128(seconds, counts));
            let is_second = _mm_andnot_si128(has_first, _mm_or_si128(has_second, is_less));
            let old = _mm_blendv_epi8(firsts, seconds, is_second);
            let new = _mm_or_si128(keys, _mm_set1_epi32(new.cast_signed()));
            [_mm_blendv_epi8(new, old, _mm_or_si128(has_first, has_second)), firsts, seconds, is_second]
        }
        .map(|lanes| Quad(bytemuck::cast(lanes)));
        Found { slots, firsts, seconds, is_second }
    }

    /// `update` of the portable form.
    #[inline(always)]
    pub(in super::super) fn update(
        isa: impl Lanes,
        found: &Found,
        counts: [u32; 3],
        bit: bool,
    ) -> [[u32; 2]; 3] {
        if isa.avx2().is_none() {
            return portable::update(isa, found, counts, bit);
        }
        let counts: __m128i = bytemuck::cast([counts[0], counts[1], counts[2], 0]);
        let [slots, firsts, seconds, is_second]: [__m128i; 4] =
            bytemuck::cast([found.slots.0, found.firsts.0, found.seconds.0, found.is_second.0]);
        let target = i32::from(bit).wrapping_neg() & 0xffff;
        // SAFETY: the proof says that the machine has AVX2; no memory is accessed.
        let [low, high]: [[[u32; 2]; 2]; 2] = bytemuck::cast(unsafe {
            let one = _mm_srli_epi32::<16>(slots);
            let way = _mm_sub_epi32(_mm_set1_epi32(target), one);
            let step = _mm_mullo_epi32(way, _mm_and_si128(counts, _mm_set1_epi32(0xffff)));
            let one = _mm_add_epi32(one, _mm_srai_epi32::<16>(step));
            let count = _mm_and_si128(_mm_srli_epi32::<8>(counts), _mm_set1_epi32(0xff00));
            let key = _mm_and_si128(slots, _mm_set1_epi32(0xff));
            let moved = _mm_or_si128(_mm_slli_epi32::<16>(one), _mm_or_si128(count, key));
            let firsts = _mm_blendv_epi8(moved, firsts, is_second);
            let seconds = _mm_blendv_epi8(seconds, moved, is_second);
            [_mm_unpacklo_epi32(firsts, seconds), _mm_unpackhi_epi32(firsts, seconds)]
        });
        [low[0], low[1], high[0]]
    }

    /// `learn` of the portable form.
    #[inline(always)]
    pub(in super::super) fn learn(
        isa: impl Lanes,
        weights: &mut Inputs,
        inputs: &Inputs,
        error: i32,
        limit: i32,
    ) {
        if isa.avx2().is_none() {
            return portable::learn(isa, weights, inputs, error, limit);
        }
        let [weight, input]: [__m256i; 2] = bytemuck::cast([weights.0, inputs.0]);
        // SAFETY: the proof says that the machine has AVX2; no memory is accessed.
        weights.0 = bytemuck::cast(unsafe {
            let product = _mm256_mullo_epi32(input, _mm256_set1_epi32(error));
            let step = _mm256_srai_epi32::<14>(_mm256_add_epi32(product, _mm256_set1_epi32(1 << 13)));
            let moved = _mm256_add_epi32(weight, step);
            let least = _mm256_max_epi32(moved, _mm256_set1_epi32(-limit));
            _mm256_min_epi32(least, _mm256_set1_epi32(limit))
        });
    }

    /// `last_within` of the portable form.
    #[inline(always)]
    pub(in super::super) fn last_within(isa: impl Lanes, row: &Row, most: u16) -> usize {
        // The machine's comparison of lanes is signed.
        let (sign, most) = (i16::MIN, (most ^ 0x8000).cast_signed());
        let lanes = if isa.avx2().is_some() {
            // SAFETY: the proof says that the machine has AVX2; no memory is accessed.
            let bits = unsafe {
                let lanes = _mm256_xor_si256(whole(row), _mm256_set1_epi16(sign));
                _mm256_movemask_epi8(_mm256_cmpgt_epi16(lanes, _mm256_set1_epi16(most)))
            };
            bits.trailing_zeros() / 2
        } else {
            let [low, high] = halves(row);
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            let bits = unsafe {
                let (sign, most) = (_mm_set1_epi16(sign), _mm_set1_epi16(most));
                let low = _mm_cmpgt_epi16(_mm_xor_si128(low, sign), most);
                let high = _mm_cmpgt_epi16(_mm_xor_si128(high, sign), most);
                _mm_movemask_epi8(_mm_packs_epi16(low, high))
            };
            (bits | 1 << LANES).trailing_zeros()
        };
        lanes.wrapping_sub(1) as usize % LANES
    }

    #[inline(always)]
    fn vector(lanes: Octet) -> __m128i {
        bytemuck::cast(lanes.0)
    }

    #[inline(always)]
    fn octet(lanes: __m128i) -> Octet {
        Octet(bytemuck::cast(lanes))
    }

    impl Octet {
        /// The low halves of numbers.
        #[inline(always)]
        pub(in super::super) fn of(lanes: [i32; 8]) -> Self {
            // Eight narrow stores would delay the next load of the whole octet.
            let four = |i: usize| {
                let lane = |i: usize| u64::from(lanes[i].cast_unsigned() & 0xffff);
                (lane(i) | lane(i + 1) << 16 | lane(i + 2) << 32 | lane(i + 3) << 48).cast_signed()
            };
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            octet(unsafe { _mm_set_epi64x(four(4), four(0)) })
        }

        /// Adds lane by lane.
        #[inline(always)]
        pub(in super::super) fn plus(self, other: Self) -> Self {
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            octet(unsafe { _mm_add_epi16(vector(self), vector(other)) })
        }

        /// Subtracts lane by lane.
        #[inline(always)]
        pub(in super::super) fn minus(self, other: Self) -> Self {
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            octet(unsafe { _mm_sub_epi16(vector(self), vector(other)) })
        }

        /// Multiplies all lanes by one number.
        #[inline(always)]
        pub(in super::super) fn times(self, factor: i16) -> Self {
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            octet(unsafe { _mm_mullo_epi16(vector(self), _mm_set1_epi16(factor)) })
        }

        #[inline(always)]
        pub(in super::super) fn both(self, other: Self) -> Self {
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            octet(unsafe { _mm_and_si128(vector(self), vector(other)) })
        }

        #[inline(always)]
        pub(in super::super) fn all_of_lane_3(self) -> Self {
            // SAFETY: every x86-64 machine has SSE2; no memory is accessed.
            octet(unsafe {
                _mm_shuffle_epi32::<0b01_01_01_01>(_mm_shufflelo_epi16::<0b11_11_11_11>(vector(self)))
            })
        }
    }
}

#[cfg_attr(
    all(target_arch = "x86_64", not(test)),
    expect(dead_code, reason = "rows and sums have SSE2's instructions there")
)]
mod portable {
    use super::{Found, Inputs, LANES, Quad, Row};
    use crate::cpu::Lanes;

    /// Moves lanes by 2^-shift of the way to `end`; lanes and ends are first XORed with `turn`.
    #[inline(always)]
    pub(in super::super) fn sink(_: impl Lanes, row: &mut Row, turn: &Row, end: &Row, shift: u8) {
        for ((lane, turn), end) in row.0.iter_mut().zip(turn.0).zip(end.0) {
            let seen = *lane ^ turn;
            *lane = seen.wrapping_sub(seen.wrapping_sub(end) >> (shift & 15)) ^ turn;
        }
    }

    /// The mean of the means of two rows each, each mean rounded up.
    #[inline(always)]
    pub(in super::super) fn mean_of_four(_: impl Lanes, a: [&Row; 2], b: [&Row; 2]) -> Row {
        let mean = |a: u16, b: u16| (a >> 1) + (b >> 1) + ((a | b) & 1);
        let both = |[a, b]: [&Row; 2], i: usize| mean(a.0[i], b.0[i]);
        Row(std::array::from_fn(|i| mean(both(a, i), both(b, i))))
    }

    /// The sum of products with weights, of sums above 0.
    #[inline(always)]
    pub(in super::super) fn products_above_0(_: impl Lanes, sums: &[i16; 32], weights: &[i16; 32]) -> i32 {
        let products = sums.iter().zip(weights).map(|(sum, w)| i32::from((*sum).max(0)) * i32::from(*w));
        products.fold(0, i32::wrapping_add)
    }

    /// A quarter of the sum of products with weights, each quarter rounded down.
    #[inline(always)]
    pub(in super::super) fn mixed(_: impl Lanes, weights: &Inputs, inputs: &Inputs) -> i32 {
        let products = weights.0.iter().zip(inputs.0).map(|(w, input)| w.wrapping_mul(input) >> 2);
        products.take(5).fold(0, i32::wrapping_add)
    }

    /// The slots of keys of a byte; `new` is the content of a new slot besides its key.
    #[inline(always)]
    pub(in super::super) fn find(_: impl Lanes, pairs: [[u32; 2]; 3], keys: [u32; 3], new: u32) -> Found {
        let mut found = Found {
            slots: Quad([0; 4]),
            firsts: Quad([0; 4]),
            seconds: Quad([0; 4]),
            is_second: Quad([0; 4]),
        };
        for (i, ([first, second], key)) in pairs.into_iter().zip(keys).enumerate() {
            let (has_first, has_second) = (first % 256 == key, second % 256 == key);
            let is_second = !has_first & (has_second | ((second & 0xff00) < (first & 0xff00)));
            let old = if is_second { second } else { first };
            found.slots.0[i] = if has_first | has_second { old } else { new | key };
            (found.firsts.0[i], found.seconds.0[i]) = (first, second);
            found.is_second.0[i] = u32::from(is_second).wrapping_neg();
        }
        found
    }

    /// The pairs, with their slots moved towards a bit by the steps in the low halves of `counts`, and with new counts
    /// in their third bytes.
    #[inline(always)]
    pub(in super::super) fn update(
        _: impl Lanes,
        found: &Found,
        counts: [u32; 3],
        bit: bool,
    ) -> [[u32; 2]; 3] {
        std::array::from_fn(|i| {
            let slot = found.slots.0[i];
            let (one, step) = ((slot >> 16).cast_signed(), (counts[i] & 0xffff).cast_signed());
            let target = if bit { 0xffff } else { 0 };
            let one = one.wrapping_add((target - one).wrapping_mul(step) >> 16).cast_unsigned();
            let moved = one << 16 | counts[i] >> 8 & 0xff00 | slot & 0xff;
            if found.is_second.0[i] == 0 { [moved, found.seconds.0[i]] } else { [found.firsts.0[i], moved] }
        })
    }

    /// Adds the products of inputs and an error, in units of 2^-14, to the weights, which stay within a limit.
    #[inline(always)]
    pub(in super::super) fn learn(
        _: impl Lanes,
        weights: &mut Inputs,
        inputs: &Inputs,
        error: i32,
        limit: i32,
    ) {
        for (weight, input) in weights.0.iter_mut().zip(inputs.0).take(5) {
            let step = input.wrapping_mul(error).wrapping_add(1 << 13) >> 14;
            *weight = weight.wrapping_add(step).clamp(-limit, limit);
        }
    }

    /// The lane before the first that is above a number; lanes rise from 0.
    #[inline(always)]
    pub(in super::super) fn last_within(_: impl Lanes, row: &Row, most: u16) -> usize {
        row.0.iter().position(|lane| *lane > most).unwrap_or(LANES).wrapping_sub(1) % LANES
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl Octet {
    /// The low halves of numbers.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "the low halves are wanted")]
    pub(super) fn of(lanes: [i32; 8]) -> Self {
        Self(lanes.map(|lane| lane as i16))
    }

    /// Adds lane by lane.
    #[inline(always)]
    pub(super) fn plus(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i].wrapping_add(other.0[i])))
    }

    /// Subtracts lane by lane.
    #[inline(always)]
    pub(super) fn minus(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i].wrapping_sub(other.0[i])))
    }

    /// Multiplies all lanes by one number.
    #[inline(always)]
    pub(super) fn times(self, factor: i16) -> Self {
        Self(self.0.map(|lane| lane.wrapping_mul(factor)))
    }

    #[inline(always)]
    pub(super) fn both(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] & other.0[i]))
    }

    #[inline(always)]
    pub(super) fn all_of_lane_3(self) -> Self {
        Self([self.0[3]; 8])
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::cpu::{Kernel, Lanes, Portable, dispatch};

    struct Compare;

    impl Kernel for Compare {
        type Output = ();

        fn run(self, isa: impl Lanes) {
            let mut state = 1_u32;
            let mut number = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 16) as u16
            };
            for _ in 0..2000 {
                let [a, b, c, d]: [Row; 4] = std::array::from_fn(|_| Row(std::array::from_fn(|_| number())));
                for shift in 1..=15 {
                    let (mut fast, mut plain) = (a, a);
                    x86::sink(isa, &mut fast, &b, &c, shift);
                    portable::sink(isa, &mut plain, &b, &c, shift);
                    assert_eq!(fast, plain);
                }
                let mut mean = x86::mean_of_four(isa, [&a, &b], [&c, &d]);
                assert_eq!(mean, portable::mean_of_four(isa, [&a, &b], [&c, &d]));
                let [sums, weights]: [[i16; 32]; 2] = bytemuck::cast([a.0, b.0, c.0, d.0]);
                let product = x86::products_above_0(isa, &sums, &weights);
                assert_eq!(product, portable::products_above_0(isa, &sums, &weights));
                let [pairs, keys, counts, rest]: [[u32; 8]; 4] = bytemuck::cast([a.0, b.0, c.0, d.0]);
                let pairs = [[pairs[0], pairs[1]], [pairs[2], pairs[3]], [pairs[4], pairs[5]]];
                // Keys found in the first slot, in the second, in neither.
                let keys = [pairs[0][0], pairs[1][1], keys[0]].map(|key| key % 256);
                let found = x86::find(isa, pairs, keys, 1 << 31);
                assert_eq!(found, portable::find(isa, pairs, keys, 1 << 31));
                let counts = [counts[0], counts[1], counts[2]];
                for bit in [false, true] {
                    let moved = x86::update(isa, &found, counts, bit);
                    assert_eq!(moved, portable::update(isa, &found, counts, bit));
                }
                let [mut fast, inputs] = [rest, bytemuck::cast(c.0)].map(|lanes: [u32; 8]| {
                    Inputs(std::array::from_fn(|i| if i < 5 { lanes[i].cast_signed() >> 12 } else { 0 }))
                });
                assert_eq!(x86::mixed(isa, &fast, &inputs), portable::mixed(isa, &fast, &inputs));
                let (mut plain, error) = (fast, keys[2].cast_signed() * 512 - 65_535);
                x86::learn(isa, &mut fast, &inputs, error, 1 << 18);
                portable::learn(isa, &mut plain, &inputs, error, 1 << 18);
                assert_eq!(fast, plain);
                mean.0.sort_unstable();
                mean.0[0] = 0;
                for most in [mean.0[number() as usize % LANES], number(), 0, u16::MAX] {
                    assert_eq!(x86::last_within(isa, &mean, most), portable::last_within(isa, &mean, most));
                }
            }
        }
    }

    #[test]
    fn all_forms_give_the_same_lanes() {
        Compare.run(Portable);
        dispatch(Compare);
    }

    #[test]
    fn octets_are_sums_and_products_of_their_lanes() {
        let (a, b) = (Octet::of([1, -2, 3, -4, 70_000, 6, 7, -32_768]), Octet([9, 8, -7, 6, 5, -4, 3, -2]));
        assert_eq!(a.0, [1, -2, 3, -4, 4464, 6, 7, -32_768]);
        assert_eq!(a.plus(b).0, [10, 6, -4, 2, 4469, 2, 10, 32_766]);
        assert_eq!(a.minus(b).0, [-8, -10, 10, -10, 4459, 10, 4, -32_766]);
        assert_eq!(b.times(-3).0, [-27, -24, 21, -18, -15, 12, -9, 6]);
        assert_eq!(a.both(b).0, [1, 8, 1, 4, 0, 4, 3, -32_768]);
        assert_eq!(a.all_of_lane_3().0, [-4; 8]);
    }
}
