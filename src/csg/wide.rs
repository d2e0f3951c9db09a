//! Squares of whole numbers of 128 bits, and their sums, exactly.

/// A whole number of 256 bits: its upper and its lower half.
pub(super) type Wide = (u128, u128);

/// The square of a whole number below 2^127.
pub(super) fn square(of: i128) -> Wide {
    let value = of.unsigned_abs();
    let (high, low) = (value >> 64, value & u128::from(u64::MAX));
    // high^2 2^128 + 2 high low 2^64 + low^2.
    let middle = high * low;
    let (sum, carry) = (low * low).overflowing_add(middle << 65);
    (high * high + (middle >> 63) + u128::from(carry), sum)
}

/// The sum of numbers below 2^254.
pub(super) fn sum(a: Wide, b: Wide) -> Wide {
    let (low, carry) = a.1.overflowing_add(b.1);
    (a.0 + b.0 + u128::from(carry), low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_and_sums_are_exact() {
        assert_eq!(square(-3), (0, 9));
        assert_eq!(square(1 << 64), (1, 0));
        assert_eq!(square(i128::from(u64::MAX)), (0, u128::from(u64::MAX).pow(2)));
        // (2^100 + 1)^2 = 2^200 + 2^101 + 1.
        assert_eq!(square((1 << 100) + 1), (1 << 72, (1 << 101) + 1));
        // (2^126 - 1)^2 = 2^252 - 2^127 + 1.
        assert_eq!(square((1 << 126) - 1), ((1 << 124) - 1, (1 << 127) + 1));
        assert_eq!(sum((1, u128::MAX), (2, 1)), (4, 0));
    }
}
