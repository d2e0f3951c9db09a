//! Which instructions a traversal is compiled for. All forms give the same results.

use super::lanes::{Lanes, Portable};
#[cfg(target_arch = "x86_64")]
use super::lanes_x86::Avx512;
#[cfg(target_arch = "x86_64")]
use crate::cpu::Avx2;

/// A kernel that runs on any lanes; `#[inline(always)]` all the way down.
pub(crate) trait LanesKernel {
    /// Its result.
    type Output;
    /// The work.
    fn run(self, lanes: impl Lanes) -> Self::Output;
}

/// A form of the traversal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Form {
    /// Any machine.
    Portable,
    /// x86-64 with AVX2, BMI2 and population count.
    Avx2,
    /// The same with AVX-512 F and DQ.
    Avx512,
    /// The same with AVX-512 BW, VL, VBMI and VBMI2.
    Vbmi2,
}

impl Form {
    /// The forms that this machine can run, the slowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        [Self::Portable, Self::Avx2, Self::Avx512, Self::Vbmi2].into_iter().filter(|form| form.is_available())
    }

    /// The fastest form of this machine.
    #[inline]
    pub fn best() -> Self {
        if Self::Vbmi2.is_available() {
            Self::Vbmi2
        } else if Self::Avx512.is_available() {
            Self::Avx512
        } else if Self::Avx2.is_available() {
            Self::Avx2
        } else {
            Self::Portable
        }
    }

    /// Can this machine run it?
    #[inline]
    pub(crate) fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => Avx2::detect().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => Avx512::<false>::detect().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::Vbmi2 => Avx512::<true>::detect().is_some(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Avx512 | Self::Vbmi2 => false,
        }
    }

    /// Its name, for reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
            Self::Vbmi2 => "AVX-512 VBMI2",
        }
    }

    /// Runs a kernel in this form, or portably where the machine cannot.
    #[inline]
    pub(crate) fn run<K: LanesKernel>(self, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        {
            if self == Self::Vbmi2
                && let Some(vbmi2) = Avx512::<true>::detect()
            {
                return vbmi2.run(kernel);
            }
            if self == Self::Avx512
                && let Some(avx512) = Avx512::<false>::detect()
            {
                return avx512.run(kernel);
            }
            if self == Self::Avx2
                && let Some(avx2) = Avx2::detect()
            {
                return avx2.run(kernel);
            }
        }
        kernel.run(Portable)
    }
}
