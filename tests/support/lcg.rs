//! Numbers from a fixed seed, so that a failure can be repeated.

/// A small linear congruential generator, the same on every machine.
pub(crate) struct Lcg(pub(crate) u64);

impl Lcg {
    /// The next number below `n`.
    pub(crate) fn below<N: TryInto<u64> + TryFrom<u64>>(&mut self, n: N) -> N {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let n: u64 = n.try_into().ok().unwrap();
        N::try_from((self.0 >> 33) % n).ok().unwrap()
    }
}
