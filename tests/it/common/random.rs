//! Numbers from a seed, the same on every machine, so that a failure can be repeated. The only generator of
//! all tests: those in this folder's parent and the unit tests below `src`.
#![allow(dead_code, reason = "each test file uses its own part")]

/// A Weyl sequence through Stafford's mixer 13 (Steele, Lea and Flood, OOPSLA 2014): any seed is as good.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// The next 64 bits.
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// The next number below `n`, which is above 0.
    pub(crate) fn below<N: TryInto<u64> + TryFrom<u64>>(&mut self, n: N) -> N {
        let n: u64 = n.try_into().ok().unwrap();
        N::try_from((self.bits() >> 11) % n).ok().unwrap()
    }

    /// The next byte.
    pub(crate) fn byte(&mut self) -> u8 {
        self.bits().to_be_bytes()[0]
    }

    /// The next number in 0..1, a multiple of 2^-53.
    #[expect(clippy::cast_precision_loss, reason = "53 bits")]
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / 9_007_199_254_740_992.0
    }

    /// One of several things.
    pub(crate) fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }
}
