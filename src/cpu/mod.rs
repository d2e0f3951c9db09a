//! The ladder of instruction sets: portable, AVX2, AVX-512 with VBMI2.
//!
//! A `Kernel` is written once, over `Lanes`, and `#[inline(always)]` all the way down; it is compiled for each form
//! inside a function with that form's target features. A value of a form's type is the proof that the machine has the
//! instructions. All forms do the same operations in the same order, each rounded once (nothing is fused), so they give
//! the same bits.
//!
//! | caller | forms |
//! |---|---|
//! | `dispatch`: builder, packed format, exports | portable, AVX2: memory and branches bound these, and a third form of some 50 kernels would double their part of the compile time |
//! | `Form::run`: rays, shading | all three: VBMI2 compares a brick's pairs of ray and cell sixteen at a time, in 0.55 to 0.7 of AVX2's time |
//!
//! AVX-512 without VBMI2 (Skylake-SP, Cascade Lake) runs AVX2: pictures take 1.0 to 1.4 times as long as with a fourth
//! form, which was a quarter of the machine code of all rays.

use std::sync::OnceLock;

mod lanes;
#[cfg(not(target_arch = "x86_64"))]
#[path = "other.rs"]
mod machine;
#[cfg(target_arch = "x86_64")]
#[path = "x86.rs"]
mod machine;

pub(crate) use lanes::{DOUBLES, Lanes, OCTET, Octet, Portable, SINGLES, Term, Truths};
pub(crate) use machine::{Avx2, Narrow, Vbmi2, deposit, mirror_bits, movemask, prefetch};

/// A kernel that can be compiled for every form.
pub(crate) trait Kernel {
    /// Its result.
    type Output;
    /// The work; must be `#[inline(always)]` all the way down.
    fn run(self, lanes: impl Lanes) -> Self::Output;
}

/// Runs `kernel` with AVX2 where the machine has it, else portably.
#[inline]
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    match Avx2::detect() {
        Some(avx2) => avx2.run(kernel),
        None => kernel.run(Portable),
    }
}

/// Instruction set that a traversal is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Form {
    /// Any machine.
    Portable,
    /// x86-64 with AVX2, BMI2 and population count.
    Avx2,
    /// x86-64 with AVX-512 F, DQ, BW, VL, VBMI and VBMI2 too.
    Vbmi2,
}

impl Form {
    /// The forms that this machine can run, the slowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        [Self::Portable, Self::Avx2, Self::Vbmi2].into_iter().filter(|form| form.is_available())
    }

    /// The form of [`Form::chosen`]; the portable one if that is an error.
    #[inline]
    pub fn best() -> Self {
        Self::chosen().unwrap_or(Self::Portable)
    }

    /// The fastest form of this machine, or the one that `INFOBYTE_FORM` in the environment names as [`Form::name`]
    /// does, to measure a slower form on the same machine.
    ///
    /// # Errors
    /// A sentence, if the environment does not name a form of this machine.
    #[inline]
    pub fn chosen() -> Result<Self, &'static str> {
        static CHOSEN: OnceLock<Result<Form, String>> = OnceLock::new();
        let read = || Self::named(&std::env::var_os("INFOBYTE_FORM").unwrap_or_default().to_string_lossy());
        CHOSEN.get_or_init(read).as_ref().copied().map_err(String::as_str)
    }

    /// The form of this name; the fastest one for an empty name.
    fn named(name: &str) -> Result<Self, String> {
        let found = Self::available().filter(|form| name.is_empty() || form.name() == name).last();
        found.ok_or_else(|| {
            let names: Vec<_> = Self::available().map(Self::name).collect();
            format!(
                "INFOBYTE_FORM={name} in the environment is not a form of this machine; choose one of {}, or unset it",
                names.join(", ")
            )
        })
    }

    #[inline]
    fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            Self::Avx2 => Avx2::detect().is_some(),
            Self::Vbmi2 => Vbmi2::detect().is_some(),
        }
    }

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            Self::Avx2 => "AVX2",
            Self::Vbmi2 => "AVX-512 VBMI2",
        }
    }

    /// Runs a kernel in this form, or portably if the machine lacks it.
    #[inline]
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        if self == Self::Vbmi2
            && let Some(vbmi2) = Vbmi2::detect()
        {
            return vbmi2.run(kernel);
        }
        if self == Self::Avx2
            && let Some(avx2) = Avx2::detect()
        {
            return avx2.run(kernel);
        }
        kernel.run(Portable)
    }
}
