//! Interpolation of samples.

use std::ops::Range;

use super::{ScalarType, VolumeInfo};

/// Bytes of the second neighbour that are held while rows between two slices are made, unless a row is longer.
const NEIGHBOUR_BYTES: usize = 64 << 10;

/// Bytes that [`blend_rows`] holds for whole rows of a volume.
pub(crate) fn neighbour_bytes(info: &VolumeInfo) -> u64 {
    NEIGHBOUR_BYTES.max(info.dims.nx() as usize * info.scalar.bytes()) as u64
}

/// Moves rows of one slice, of `cols` columns, a part of the way to the same rows of another, which `read` delivers a
/// few at a time.
///
/// # Errors
/// The errors of `read`.
pub(crate) fn blend_rows<E>(
    scalar: ScalarType,
    part: f64,
    rows: Range<u32>,
    cols: usize,
    out: &mut [u8],
    mut read: impl FnMut(Range<u32>, &mut [u8]) -> Result<(), E>,
) -> Result<(), E> {
    let row_bytes = cols * scalar.bytes();
    if row_bytes == 0 || rows.is_empty() {
        return Ok(());
    }
    let many = (NEIGHBOUR_BYTES / row_bytes).clamp(1, rows.len());
    let mut others = vec![0; many * row_bytes];
    let mut first = rows.start;
    for own in out.chunks_mut(many * row_bytes) {
        let end = first + u32::try_from(own.len() / row_bytes).unwrap_or(0);
        let other = others.get_mut(..own.len()).unwrap_or_default();
        read(first..end, other)?;
        blend(scalar, own, other, part);
        first = end;
    }
    Ok(())
}

/// Replaces each sample by the value `part` (0 to 1) of the way to its neighbour; integers are rounded half away from
/// zero. Both are in native byte order and equally long.
fn blend(scalar: ScalarType, own: &mut [u8], other: &[u8], part: f64) {
    match scalar {
        ScalarType::U8 => each::<u8>(own, other, part),
        ScalarType::I8 => each::<i8>(own, other, part),
        ScalarType::U16 => each::<u16>(own, other, part),
        ScalarType::I16 => each::<i16>(own, other, part),
        ScalarType::U32 => each::<u32>(own, other, part),
        ScalarType::I32 => each::<i32>(own, other, part),
        ScalarType::F32 => each::<f32>(own, other, part),
        ScalarType::F64 => each::<f64>(own, other, part),
    }
}

fn each<T: Number>(own: &mut [u8], other: &[u8], part: f64) {
    let width = size_of::<T>();
    for (a, b) in own.chunks_exact_mut(width).zip(other.chunks_exact(width)) {
        let from: T = bytemuck::pod_read_unaligned(a);
        let to: T = bytemuck::pod_read_unaligned(b);
        let (from, to) = (from.to_f64(), to.to_f64());
        a.copy_from_slice(bytemuck::bytes_of(&T::nearest(from + (to - from) * part)));
    }
}

/// A sample that is exact in `f64`.
trait Number: bytemuck::Pod {
    fn to_f64(self) -> f64;
    fn nearest(value: f64) -> Self;
}

macro_rules! number {
    ($round:expr, $($t:ty),*) => {$(
        impl Number for $t {
            fn to_f64(self) -> f64 {
                self.into()
            }
            #[allow(clippy::cast_possible_truncation, reason = "the value lies between two samples of the type")]
            fn nearest(value: f64) -> Self {
                let round: fn(f64) -> f64 = $round;
                round(value) as Self
            }
        }
    )*};
}
number!(f64::round, u8, i8, u16, i16, u32, i32);
number!(|v| v, f32, f64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_round_half_away_from_zero_and_floats_do_not_round() {
        fn between<T: Number>(scalar: ScalarType, from: T, to: T, part: f64) -> T {
            let mut own = from;
            blend(scalar, bytemuck::bytes_of_mut(&mut own), bytemuck::bytes_of(&to), part);
            own
        }
        let i16s = |from, to, part| between::<i16>(ScalarType::I16, from, to, part);
        assert_eq!((i16s(1, 2, 0.5), i16s(-1, -2, 0.5), i16s(2, 1, 0.5)), (2, -2, 2));
        assert_eq!((i16s(-32768, 32767, 0.0), i16s(-32768, 32767, 1.0)), (-32768, 32767));
        assert_eq!(i16s(100, 0, 0.25), 75);
        assert_eq!(between::<f32>(ScalarType::F32, 1.0, 2.0, 0.25), 1.25);
        assert_eq!(between::<u32>(ScalarType::U32, u32::MAX, 0, 0.5), 2_147_483_648);
    }
}
