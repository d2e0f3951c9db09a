//! [`super::pairs`] with AVX-512 VBMI2: sixteen pairs of a ray and a cell at a time.
//!
//! SAFETY (every block here): a [`Vbmi2`] proves that the machine has AVX-512 F, BW, DQ, VL, VBMI and VBMI2; functions
//! without one are called by functions that have it. Loads and stores are of whole arrays.
#![allow(unsafe_code)]

use std::arch::x86_64::*;

use crate::cpu::{SINGLES, Vbmi2};
use crate::format::cell::HAS_CORNERS;

use super::pairs::{ALL_CELLS, CELLS, Compared, LISTED, Lines, Planes};

/// Integers from `first` on in steps of `step`.
const fn bytes(first: u8, step: u8) -> [u8; CELLS] {
    let mut bytes = [0; CELLS];
    let mut i = 0;
    while i < CELLS {
        #[expect(clippy::cast_possible_truncation, reason = "below 64")]
        let number = i as u8;
        bytes[i] = number.wrapping_mul(step).wrapping_add(first);
        i += 1;
    }
    bytes
}

static COUNTED: [u8; CELLS] = bytes(0, 1);
/// Even bytes of 128, and odd ones.
static EVEN: [u8; CELLS] = bytes(0, 2);
static ODD: [u8; CELLS] = bytes(1, 2);

/// Distances of a brick's cells from its middle along an axis.
const STEPS: [f32; 4] = [-1.5, -0.5, 0.5, 1.5];

/// AVX-512 form of [`super::pairs::list`].
#[inline(always)]
pub(super) fn list(_: Vbmi2, boxes: u64, places: &mut [u8; LISTED]) {
    // SAFETY: see the top of this file.
    unsafe {
        let counted = _mm512_loadu_si512(COUNTED.as_ptr().cast());
        let packed = _mm512_maskz_compress_epi8(boxes, counted);
        _mm_storeu_si128(places.as_mut_ptr().cast(), _mm512_castsi512_si128(packed));
    }
}

/// AVX-512 form of [`super::pairs::planes`].
#[inline(always)]
pub(super) fn planes(
    _: Vbmi2,
    codes: &[[u8; 2]; CELLS],
    offsets: &[u8; CELLS],
    stored: u64,
    flip: u32,
) -> Planes {
    let (normal, offset) = ([[0; CELLS]; 3], [0; CELLS]);
    let mut planes = Planes { normal, offset, number: [0; CELLS], cells: ALL_CELLS };
    // SAFETY: see the top of this file.
    unsafe {
        let codes = codes.as_ptr().cast::<u8>();
        let (low, high) = (_mm512_loadu_si512(codes.cast()), _mm512_loadu_si512(codes.add(CELLS).cast()));
        let least = _mm512_set1_epi8(-127);
        let even = _mm512_loadu_si512(EVEN.as_ptr().cast());
        let odd = _mm512_loadu_si512(ODD.as_ptr().cast());
        let u = _mm512_max_epi8(_mm512_permutex2var_epi8(low, even, high), least);
        let v = _mm512_max_epi8(_mm512_permutex2var_epi8(low, odd, high), least);
        // Same as `normal::decode_l1`; all values fit signed bytes.
        let (zero, scale) = (_mm512_setzero_si512(), _mm512_set1_epi8(127));
        let (beside_u, beside_v) =
            (_mm512_sub_epi8(scale, _mm512_abs_epi8(u)), _mm512_sub_epi8(scale, _mm512_abs_epi8(v)));
        let z = _mm512_sub_epi8(beside_u, _mm512_abs_epi8(v));
        let fold_u = _mm512_mask_sub_epi8(beside_v, _mm512_movepi8_mask(u), zero, beside_v);
        let fold_v = _mm512_mask_sub_epi8(beside_u, _mm512_movepi8_mask(v), zero, beside_u);
        let below = _mm512_movepi8_mask(z);
        let x = _mm512_mask_blend_epi8(below, u, fold_u);
        let y = _mm512_mask_blend_epi8(below, v, fold_v);
        let mirrored = [u64::from(flip & 1), u64::from(flip >> 1 & 1), u64::from(flip >> 2 & 1)];
        let x = _mm512_mask_sub_epi8(x, mirrored[0].wrapping_neg(), zero, x);
        let y = _mm512_mask_sub_epi8(y, mirrored[1].wrapping_neg(), zero, y);
        let z = _mm512_mask_sub_epi8(z, mirrored[2].wrapping_neg(), zero, z);
        let counted = _mm512_loadu_si512(COUNTED.as_ptr().cast());
        let by_place = _mm512_maskz_expand_epi8(stored, counted);
        let from = _mm512_xor_si512(counted, _mm512_set1_epi8((flip & 63) as i8));
        _mm512_store_si512(planes.normal[0].as_mut_ptr().cast(), x);
        _mm512_store_si512(planes.normal[1].as_mut_ptr().cast(), y);
        _mm512_store_si512(planes.normal[2].as_mut_ptr().cast(), z);
        _mm512_store_si512(planes.offset.as_mut_ptr().cast(), _mm512_loadu_si512(offsets.as_ptr().cast()));
        _mm512_store_si512(planes.number.as_mut_ptr().cast(), _mm512_permutexvar_epi8(from, by_place));
    }
    planes
}

/// The values of sixteen rays.
///
/// # Safety
/// The machine must have the features that the top of this file names; `high` has the lanes whose ray is 32 or above.
#[inline(always)]
unsafe fn of_rays(values: &[f32; CELLS], rays: __m512i, high: __mmask16) -> __m512 {
    // SAFETY: see the top of this file.
    unsafe {
        let p = values.as_ptr();
        let low_half = _mm512_permutex2var_ps(_mm512_loadu_ps(p), rays, _mm512_loadu_ps(p.add(16)));
        let high_half = _mm512_permutex2var_ps(_mm512_loadu_ps(p.add(32)), rays, _mm512_loadu_ps(p.add(48)));
        _mm512_mask_blend_ps(high, low_half, high_half)
    }
}

/// The bytes of sixteen cells.
///
/// # Safety
/// Same as [`of_rays`].
#[inline(always)]
unsafe fn of_cells(values: &[i8; CELLS], cells: __m512i) -> __m128i {
    // SAFETY: see the top of this file.
    unsafe {
        let values = _mm512_loadu_si512(values.as_ptr().cast());
        _mm512_castsi512_si128(_mm512_permutexvar_epi8(cells, values))
    }
}

/// Bytes as singles.
///
/// # Safety
/// Same as [`of_rays`].
#[inline(always)]
unsafe fn singles(bytes: __m128i) -> __m512 {
    // SAFETY: see the top of this file.
    unsafe { _mm512_cvtepi32_ps(_mm512_cvtepi8_epi32(bytes)) }
}

/// `a * b + c * d - e * f`, each operation rounded.
macro_rules! at {
    ($a:ident * $b:ident + $c:ident * $d:ident - $e:ident * $f:ident) => {
        _mm512_sub_ps(_mm512_add_ps(_mm512_mul_ps($a, $b), _mm512_mul_ps($c, $d)), _mm512_mul_ps($e, $f))
    };
    ($a:ident * $b:ident - $c:ident * $d:ident - $e:ident * $f:ident) => {
        _mm512_sub_ps(_mm512_sub_ps(_mm512_mul_ps($a, $b), _mm512_mul_ps($c, $d)), _mm512_mul_ps($e, $f))
    };
    ($base:ident + $a:ident * $b:ident - $c:ident * $d:ident) => {
        _mm512_sub_ps(_mm512_add_ps($base, _mm512_mul_ps($a, $b)), _mm512_mul_ps($c, $d))
    };
    ($base:ident - $a:ident * $b:ident - $c:ident * $d:ident - $e:ident * $f:ident) => {
        _mm512_sub_ps(
            _mm512_sub_ps(_mm512_sub_ps($base, _mm512_mul_ps($a, $b)), _mm512_mul_ps($c, $d)),
            _mm512_mul_ps($e, $f),
        )
    };
}

/// AVX-512 form of [`super::pairs::compare`].
#[inline(always)]
pub(super) fn compare(
    _: Vbmi2,
    planes: &Planes,
    lines: &Lines<'_>,
    places: &[u8; SINGLES],
    rays: &[u8; SINGLES],
) -> Compared {
    // SAFETY: see the top of this file.
    unsafe {
        let places = _mm_loadu_si128(places.as_ptr().cast());
        let numbers = _mm512_loadu_si512(planes.number.as_ptr().cast());
        let cells = _mm512_permutexvar_epi8(_mm512_castsi128_si512(places), numbers);
        let bx = of_cells(&planes.normal[0], cells);
        let by = of_cells(&planes.normal[1], cells);
        let bz = of_cells(&planes.normal[2], cells);
        let bk = of_cells(&planes.offset, cells);
        let xy = [_mm_unpacklo_epi8(bx, by), _mm_unpackhi_epi8(bx, by)];
        let zk = [_mm_unpacklo_epi8(bz, bk), _mm_unpackhi_epi8(bz, bk)];
        let bias = _mm_set1_epi8(-128);
        let mut packed = [0_u32; SINGLES];
        let to = packed.as_mut_ptr().cast::<__m128i>();
        _mm_storeu_si128(to, _mm_xor_si128(bias, _mm_unpacklo_epi16(xy[0], zk[0])));
        _mm_storeu_si128(to.add(1), _mm_xor_si128(bias, _mm_unpackhi_epi16(xy[0], zk[0])));
        _mm_storeu_si128(to.add(2), _mm_xor_si128(bias, _mm_unpacklo_epi16(xy[1], zk[1])));
        _mm_storeu_si128(to.add(3), _mm_xor_si128(bias, _mm_unpackhi_epi16(xy[1], zk[1])));
        let has_plane = !_mm_cmpeq_epi8_mask(bk, _mm_set1_epi8(HAS_CORNERS));
        let (nx, ny, nz) = (singles(bx), singles(by), singles(bz));
        let larger = _mm_cmpge_epu8_mask(_mm512_castsi512_si128(cells), _mm_set1_epi8(planes.cells as i8));
        let half_edge = _mm512_mask_blend_ps(larger, _mm512_set1_ps(0.5), _mm512_set1_ps(1.0));
        let k = _mm512_mul_ps(singles(bk), half_edge);

        let rays = _mm512_cvtepu8_epi32(_mm_loadu_si128(rays.as_ptr().cast()));
        let high = _mm512_test_epi32_mask(rays, _mm512_set1_epi32(32));
        let dx = of_rays(&lines.direction[0], rays, high);
        let dy = of_rays(&lines.direction[1], rays, high);
        let dz = of_rays(&lines.direction[2], rays, high);
        let e_xy = of_rays(&lines.beside[0], rays, high);
        let e_xz = of_rays(&lines.beside[1], rays, high);
        let e_yz = of_rays(&lines.beside[2], rays, high);

        // A coordinate's low bit is bit `axis` of the place, its high one bit `axis + 3`; the rest is ignored.
        let v = _mm512_cvtepu8_epi32(places);
        let one = _mm512_set1_epi32(1);
        let steps = _mm512_broadcast_f32x4(_mm_loadu_ps(STEPS.as_ptr()));
        let (v1, v2) = (_mm512_srli_epi32::<1>(v), _mm512_srli_epi32::<2>(v));
        let (v3, v4) = (_mm512_srli_epi32::<3>(v), _mm512_srli_epi32::<4>(v));
        let ox = _mm512_permutevar_ps(steps, _mm512_ternarylogic_epi32::<0xca>(one, v, v2));
        let oy = _mm512_permutevar_ps(steps, _mm512_ternarylogic_epi32::<0xca>(one, v1, v3));
        let oz = _mm512_permutevar_ps(steps, _mm512_ternarylogic_epi32::<0xca>(one, v2, v4));
        let to_middle = _mm512_set1_ps(0.5);
        let ox = _mm512_mask_add_ps(ox, larger, ox, to_middle);
        let oy = _mm512_mask_add_ps(oy, larger, oy, to_middle);
        let oz = _mm512_mask_add_ps(oz, larger, oz, to_middle);

        let e_xy = at!(e_xy + ox * dy - oy * dx);
        let e_xz = at!(e_xz + ox * dz - oz * dx);
        let e_yz = at!(e_yz + oy * dz - oz * dy);
        let zero = _mm512_setzero_ps();
        let at_x = at!(ny * e_xy + nz * e_xz - dx * k);
        let at_y = at!(nz * e_yz - nx * e_xy - dy * k);
        let at_z = at!(zero - nx * e_xz - ny * e_yz - dz * k);
        let s =
            _mm512_add_ps(_mm512_add_ps(_mm512_mul_ps(nx, dx), _mm512_mul_ps(ny, dy)), _mm512_mul_ps(nz, dz));
        let half = _mm512_mul_ps(_mm512_abs_ps(s), half_edge);
        let slack = _mm512_set1_ps(lines.slack);
        let slack = _mm512_mask_add_ps(slack, larger, slack, slack);
        let (beyond, inner) = (_mm512_add_ps(half, slack), _mm512_sub_ps(half, slack));
        let most = _mm512_max_ps(_mm512_max_ps(at_x, at_y), at_z);
        let least = _mm512_min_ps(_mm512_min_ps(at_x, at_y), at_z);
        let past = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(has_plane, most, beyond);
        let within = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(has_plane, s, zero);
        let within = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(within, most, inner);
        let within = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(within, least, _mm512_sub_ps(zero, inner));
        Compared { past: past.into(), within: within.into(), planes: packed }
    }
}
