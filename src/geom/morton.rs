//! Morton order: the z-curve over (x, y, z) with x in the lowest bit.

/// Spreads the low 16 bits of `v` so that bit i moves to bit 3 i.
#[inline]
pub(crate) const fn spread(v: u32) -> u64 {
    let x = v as u64 & 0xffff;
    // Each step halves the run length and doubles the gap between runs.
    let x = (x | x << 16) & 0x0000_0000_ff00_00ff;
    let x = (x | x << 8) & 0x0000_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x0000_0c30_c30c_30c3;
    (x | x << 2) & 0x0000_2492_4924_9249
}

/// Inverse of `spread`: collects bits 0, 3, 6 ... 45 of `code`.
#[inline]
pub const fn compact(code: u64) -> u32 {
    let x = code & 0x0000_2492_4924_9249;
    let x = (x | x >> 2) & 0x0000_0c30_c30c_30c3;
    let x = (x | x >> 4) & 0x0000_00f0_0f00_f00f;
    let x = (x | x >> 8) & 0x0000_0000_ff00_00ff;
    let x = (x | x >> 16) & 0xffff;
    x as u32
}

/// Morton code of a cell with coordinates below 2^16.
#[inline]
pub const fn encode(x: u32, y: u32, z: u32) -> u64 {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

/// Cell `[x, y, z]` of a Morton code below 2^48.
#[inline]
pub const fn decode(code: u64) -> [u32; 3] {
    [compact(code), compact(code >> 1), compact(code >> 2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_coordinate_spreads_bit_by_bit_and_comes_back() {
        for v in 0..=0xffff_u32 {
            let mut slow = 0;
            for bit in 0..16 {
                slow |= u64::from(v >> bit & 1) << (3 * bit);
            }
            assert_eq!(spread(v), slow);
            assert_eq!(compact(slow), v);
        }
        assert_eq!(decode(encode(1, 2, 65535)), [1, 2, 65535]);
    }
}
