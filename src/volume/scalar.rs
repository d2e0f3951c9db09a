//! Sample types and byte orders.

use std::fmt;

/// Type of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ScalarType {
    /// Unsigned 8 bits.
    U8,
    /// Signed 8 bits.
    I8,
    /// Unsigned 16 bits.
    U16,
    /// Signed 16 bits.
    I16,
    /// Unsigned 32 bits.
    U32,
    /// Signed 32 bits.
    I32,
    /// IEEE single.
    F32,
    /// IEEE double.
    F64,
}

impl ScalarType {
    /// Every type, in the order of their codes in the file format.
    pub const ALL: [Self; 8] =
        [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::F32, Self::F64];

    /// Bytes per sample.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Name as written on the command line.
    pub fn name(self) -> &'static str {
        ["u8", "i8", "u16", "i16", "u32", "i32", "f32", "f64"][self as usize]
    }

    /// Position in [`ScalarType::ALL`]: the code in the file format.
    pub(crate) fn code(self) -> u8 {
        self as u8
    }

    /// Parses `u16`, `u16le`, `i16be`; without a suffix the order is little.
    pub fn parse(text: &str) -> Option<(Self, Endian)> {
        let (stem, endian) = match text {
            _ if text.ends_with("be") => (&text[..text.len() - 2], Endian::Big),
            _ if text.ends_with("le") => (&text[..text.len() - 2], Endian::Little),
            _ => (text, Endian::Little),
        };
        Self::ALL.into_iter().find(|s| s.name() == stem).map(|s| (s, endian))
    }
}

impl fmt::Display for ScalarType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Byte order of samples in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Endian {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

impl Endian {
    /// True for the machine's own order.
    pub(crate) fn is_native(self) -> bool {
        (self == Self::Little) == cfg!(target_endian = "little")
    }

    /// Turns samples of `width` bytes from this order into the machine's, in place.
    pub fn to_native(self, width: usize, bytes: &mut [u8]) {
        if self.is_native() || width == 1 {
            return;
        }
        match width {
            2 => bytes.as_chunks_mut::<2>().0.iter_mut().for_each(|c| c.reverse()),
            4 => bytes.as_chunks_mut::<4>().0.iter_mut().for_each(|c| c.reverse()),
            _ => bytes.chunks_exact_mut(width).for_each(<[u8]>::reverse),
        }
    }
}

impl ScalarType {
    /// The value of a sample in native byte order; 0 for bytes of another length.
    pub(crate) fn value(self, bytes: &[u8]) -> f64 {
        fn of<T: Scalar>(bytes: &[u8]) -> f64 {
            bytemuck::try_pod_read_unaligned::<T>(bytes).map_or(0.0, T::to_f64)
        }
        match self {
            Self::U8 => of::<u8>(bytes),
            Self::I8 => of::<i8>(bytes),
            Self::U16 => of::<u16>(bytes),
            Self::I16 => of::<i16>(bytes),
            Self::U32 => of::<u32>(bytes),
            Self::I32 => of::<i32>(bytes),
            Self::F32 => of::<f32>(bytes),
            Self::F64 => of::<f64>(bytes),
        }
    }
}

/// A sample type that the builder's kernels are instantiated for.
pub trait Scalar: bytemuck::Pod + PartialOrd + Send + Sync {
    /// The run-time tag of this type.
    const TYPE: ScalarType;
    /// Exact for every type here (all fit a double).
    fn to_f64(self) -> f64;
}

macro_rules! scalar {
    ($($t:ty => $tag:ident),*) => {$(
        impl Scalar for $t {
            const TYPE: ScalarType = ScalarType::$tag;
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
        }
    )*};
}
scalar!(u8 => U8, i8 => I8, u16 => U16, i16 => I16, u32 => U32, i32 => I32, f32 => F32, f64 => F64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_with_and_without_byte_order() {
        for s in ScalarType::ALL {
            assert_eq!(ScalarType::parse(s.name()), Some((s, Endian::Little)));
            assert_eq!(ScalarType::parse(&format!("{s}be")), Some((s, Endian::Big)));
            assert_eq!(ScalarType::parse(&format!("{s}le")), Some((s, Endian::Little)));
        }
        for bad in ["", "u24", "be", "U16", "float"] {
            assert_eq!(ScalarType::parse(bad), None);
        }
    }
}
