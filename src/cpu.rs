//! Running hot loops with AVX2 where the machine has it.
//!
//! Kernels are written once as portable `#[inline(always)]` code; [`with_avx2`] instantiates them a
//! second time inside a function with the target feature. Both give the same bits: floats are never
//! contracted or reassociated, and integers are exact.
#![allow(unsafe_code)]

/// Proof that this machine has AVX2, bit manipulation and population count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

#[cfg(target_arch = "x86_64")]
impl Avx2 {
    /// The proof, if this machine has the instructions.
    #[inline]
    pub(crate) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt"))
        .then_some(Self(()))
    }
}

/// The instruction set that a kernel is compiled for.
pub(crate) trait Isa: Copy {
    /// The proof of AVX2, in instances compiled with it.
    fn avx2(self) -> Option<Avx2>;

    /// Calls a kernel that is compiled for the same instructions by itself, for work that is seldom asked for.
    fn call<K: Kernel>(self, kernel: K) -> K::Output;
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

impl Isa for Portable {
    #[inline(always)]
    fn avx2(self) -> Option<Avx2> {
        None
    }

    #[inline(never)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run(self)
    }
}

impl Isa for Avx2 {
    #[inline(always)]
    fn avx2(self) -> Option<Self> {
        Some(self)
    }

    #[inline(always)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `self` proves every feature that `with_avx2` enables.
        return unsafe { with_avx2(self, kernel) };
        #[cfg(not(target_arch = "x86_64"))]
        kernel.run(self)
    }
}

/// A kernel that can be compiled for more than one instruction set.
pub(crate) trait Kernel {
    type Output;
    /// The work; must be `#[inline(always)]` all the way down.
    fn run(self, isa: impl Isa) -> Self::Output;
}

/// Runs `kernel` with the best instruction set of this machine.
#[inline]
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = Avx2::detect() {
        // SAFETY: `avx2` proves every feature that `with_avx2` enables.
        return unsafe { with_avx2(avx2, kernel) };
    }
    kernel.run(Portable)
}

/// The kernel compiled with AVX2, bit manipulation and population count.
///
/// # Safety
/// The machine must have the features named.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn with_avx2<K: Kernel>(avx2: Avx2, kernel: K) -> K::Output {
    kernel.run(avx2)
}

/// The sum over rows of a row's factors times the entry of a table that its byte names, lane by lane: of every fourth row
/// by themselves, then of the first two and the last two, so that none waits for the one before. Left to itself the
/// compiler takes the lanes apart.
#[inline(always)]
pub(crate) fn sums_by_table(
    isa: impl Isa,
    rows: &[[f32; 8]; 64],
    table: &[[f32; 8]; 256],
    bytes: &[u8; 64],
) -> [f32; 8] {
    #[cfg(target_arch = "x86_64")]
    if isa.avx2().is_some() {
        use std::arch::x86_64::{__m256, _mm256_add_ps, _mm256_mul_ps};
        let mut sums = [[0.0; 8]; 4].map(|zero: [f32; 8]| -> __m256 { bytemuck::cast(zero) });
        for (rows, bytes) in rows.as_chunks::<4>().0.iter().zip(bytes.as_chunks::<4>().0) {
            for i in 0..4 {
                let (row, entry) = (bytemuck::cast(rows[i]), bytemuck::cast(table[usize::from(bytes[i])]));
                // SAFETY: an instance with the proof is compiled for AVX2; no memory is accessed.
                sums[i] = unsafe { _mm256_add_ps(sums[i], _mm256_mul_ps(row, entry)) };
            }
        }
        // SAFETY: as above.
        let sum = unsafe { _mm256_add_ps(_mm256_add_ps(sums[0], sums[1]), _mm256_add_ps(sums[2], sums[3])) };
        return bytemuck::cast(sum);
    }
    let mut sums = [[0.0_f32; 8]; 4];
    for (at, (row, byte)) in rows.iter().zip(bytes).enumerate() {
        let entry = &table[usize::from(*byte)];
        for lane in 0..8 {
            sums[at % 4][lane] += row[lane] * entry[lane];
        }
    }
    std::array::from_fn(|lane| (sums[0][lane] + sums[1][lane]) + (sums[2][lane] + sums[3][lane]))
}

/// Bits 7 of 32 bytes, byte i giving bit i: the one instruction that portable code does not reach.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) fn movemask(_: Avx2, bytes: [u8; 32]) -> u32 {
    use std::arch::x86_64::{__m256i, _mm256_movemask_epi8};
    let v: __m256i = bytemuck::cast(bytes);
    // SAFETY: the first argument proves that this machine has AVX2; no memory is accessed.
    unsafe { _mm256_movemask_epi8(v).cast_unsigned() }
}

/// Portable stand-in, never called: other machines give no such proof.
#[cfg(not(target_arch = "x86_64"))]
#[inline(always)]
pub(crate) fn movemask(_: Avx2, bytes: [u8; 32]) -> u32 {
    bytes.iter().enumerate().fold(0, |m, (i, b)| m | u32::from(b >> 7) << i)
}
