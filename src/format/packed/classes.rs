//! Small differences between expected and actual values, as symbols and classes (SPEC 5.7).
#![expect(clippy::cast_possible_truncation, reason = "classes and shares are small")]

/// Least magnitude and number of further bits, the sign included, of each symbol of a magnitude below 256.
pub(super) const TOKENS: [(u32, u32); 16] = [
    (0, 0),
    (1, 1),
    (2, 1),
    (3, 1),
    (4, 1),
    (5, 1),
    (6, 2),
    (8, 3),
    (12, 3),
    (16, 4),
    (24, 4),
    (32, 5),
    (48, 5),
    (64, 6),
    (96, 6),
    (128, 8),
];

static TOKEN_OF: [u8; 256] = {
    let mut of = [0; 256];
    let (mut magnitude, mut token) = (0, 0);
    while magnitude < 256 {
        if token < 15 && magnitude == TOKENS[token + 1].0 as usize {
            token += 1;
        }
        of[magnitude] = token as u8;
        magnitude += 1;
    }
    of
};

/// The symbol of a magnitude below 256.
#[inline(always)]
pub(super) fn token_of(magnitude: u32) -> usize {
    usize::from(TOKEN_OF[magnitude as usize % 256])
}

/// The `bits` further bits of a difference: excess of its magnitude over the least, then the sign; none for 0.
#[inline(always)]
pub(super) fn low_bits(token: usize, bits: u32, difference: i32) -> u32 {
    let least = TOKENS[token % 16].0;
    let low = difference.unsigned_abs().wrapping_sub(least) << 1 | u32::from(difference < 0);
    low & ((1 << bits) - 1)
}

/// The difference of a symbol and its further bits.
#[inline(always)]
pub(super) fn difference_of(token: usize, low: u32) -> i32 {
    let magnitude = TOKENS[token % 16].0.wrapping_add(low >> 1).cast_signed();
    if low & 1 == 1 { magnitude.wrapping_neg() } else { magnitude }
}

/// 65536 / n, rounded down: divisors are sums of weights.
pub(super) static SHARES: [i32; 64] = {
    let mut shares = [0; 64];
    let mut n = 1;
    while n < 64 {
        shares[n] = 65536 / n as i32;
        n += 1;
    }
    shares
};

/// Classes of magnitudes: the number of limits that each exceeds.
pub(super) struct Classes([u8; 512]);

impl Classes {
    /// Classes with ascending limits, below 511.
    pub(super) const fn new(limits: &[usize]) -> Self {
        let mut classes = [0; 512];
        let mut value = 0;
        while value < 512 {
            let mut class = 0;
            while class < limits.len() && value > limits[class] {
                class += 1;
            }
            classes[value] = class as u8;
            value += 1;
        }
        Self(classes)
    }

    /// The class of a number's magnitude.
    #[inline(always)]
    pub(super) fn of(&self, value: i32) -> usize {
        usize::from(self.0[value.unsigned_abs().min(511) as usize])
    }
}
