//! Machines other than x86-64: no proof of AVX2 or VBMI2 exists, so functions that take one are never called.

use super::Kernel;

/// Proof of AVX2.
#[derive(Clone, Copy)]
pub(crate) enum Avx2 {}

/// Proof of AVX-512 VBMI2.
#[derive(Clone, Copy)]
pub(crate) enum Vbmi2 {}

macro_rules! absent {
    ($($proof:ident)*) => {$(
        impl $proof {
            pub(crate) fn detect() -> Option<Self> {
                None
            }

            pub(crate) fn run<K: Kernel>(self, _: K) -> K::Output {
                match self {}
            }
        }
    )*};
}
absent!(Avx2 Vbmi2);

/// Integers of 8 or 16 bits.
pub(crate) trait Narrow: bytemuck::Pod + Into<i32> {
    fn widen(avx2: Avx2, _: &[Self; super::OCTET]) -> [i32; super::OCTET] {
        match avx2 {}
    }
}
impl Narrow for u8 {}
impl Narrow for i8 {}
impl Narrow for u16 {}
impl Narrow for i16 {}

pub(crate) fn movemask(avx2: Avx2, _: [u8; 32]) -> u32 {
    match avx2 {}
}

pub(crate) fn deposit(avx2: Avx2, _: u64, _: u64) -> u64 {
    match avx2 {}
}

pub(crate) fn mirror_bits(avx2: Avx2, _: u64, _: u32) -> u64 {
    match avx2 {}
}

/// Hint that a place will be read soon; no-op.
pub(crate) fn prefetch<T: ?Sized>(_: &T) {}
