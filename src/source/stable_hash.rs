//! A hash that is the same on every machine and in every version: parts of names depend on it.

/// FNV-1a over bytes, 64 bits, with a final mix so that its high bits are as good as its low ones.
///
/// Not for input that an attacker chooses: two inputs with one hash can be made. Where that matters, the inputs
/// themselves are compared.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StableHash(u64);

impl StableHash {
    const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
    const PRIME: u64 = 0x0000_0100_0000_01b3;

    pub(crate) fn new() -> Self {
        Self(Self::OFFSET)
    }

    /// Takes in some bytes and their length, so that neighbours do not run into each other.
    pub(crate) fn part(mut self, bytes: &[u8]) -> Self {
        for byte in bytes.iter().copied().chain((bytes.len() as u64).to_le_bytes()) {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(Self::PRIME);
        }
        self
    }

    /// Takes in a number.
    pub(crate) fn number(self, number: u64) -> Self {
        self.part(&number.to_le_bytes())
    }

    /// The hash; the last steps of `MurmurHash3` spread every bit.
    pub(crate) fn finish(self) -> u64 {
        let mut h = self.0;
        h = (h ^ (h >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
        h = (h ^ (h >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
        h ^ (h >> 33)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_never_change_and_parts_stay_apart() {
        let of = |parts: &[&str]| parts.iter().fold(StableHash::new(), |h, p| h.part(p.as_bytes())).finish();
        assert_eq!(format!("{:016x}", of(&["1.2.3"])), "f780b147879ced3f");
        assert_ne!(of(&["ab", "c"]), of(&["a", "bc"]));
        assert_ne!(of(&["a"]), of(&["a", ""]));
    }
}
