//! Choices for a picture's rays, light, normals and samples.

/// Declares choices with their names on the command line and in reports.
macro_rules! choices {
    ($(#[$doc:meta])* $name:ident { $($(#[$of:meta])* $variant:ident = $text:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize)]
        #[cfg_attr(test, derive(schemars::JsonSchema))]
        pub enum $name {
            $($(#[$of])* #[serde(rename = $text)] $variant,)+
        }

        impl $name {
            /// All choices.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];

            /// Name on the command line and in reports.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $text,)+
                }
            }
        }
    };
}

choices! {
    /// The light of a picture.
    Shading {
        /// One lamp at the eye.
        Plain = "plain",
        /// A key lamp, a lamp at the eye and the sky; hollows turn dark by one ambient-occlusion ray a pixel.
        #[default]
        Soft = "soft",
        /// One lamp at the eye, and ambient occlusion: hollows turn dark, ridges stay bright.
        Ao = "ao",
        /// No light: unshaded colours, which match a legend of values.
        Flat = "flat",
    }
}

choices! {
    /// Rays of a pixel's colours. Depths, normals and numbers of boxes come from the ray through its middle.
    Samples {
        /// Eight where neighbouring pixels differ in depth or normal, else one.
        #[default]
        Auto = "auto",
        /// One, through the middle.
        One = "1",
        /// Four.
        Four = "4",
        /// Sixteen.
        Sixteen = "16",
        /// Sixty-four.
        SixtyFour = "64",
    }
}

choices! {
    /// The displayed normals.
    Smoothing {
        /// Stored normals of the boxes that are hit.
        Stored = "stored",
        /// For cells, the mean over the cells around that belong to the same surface; for voxels, the stored ones.
        #[default]
        Smooth = "smooth",
        /// As `Smooth`, and normals of voxels are blended between the boxes around a hit: smoother close-ups, some
        /// microseconds a pixel.
        Blended = "blended",
    }
}

choices! {
    /// The kind of a picture's rays.
    Traversal {
        /// The first box that the line intersects.
        #[default]
        Exact = "exact",
        /// The first voxel of a 6-connected discrete ray ([`super::discrete`]).
        Discrete = "discrete",
    }
}

/// Subpixels along each axis of a pixel, through which its rays may go.
pub(crate) const PLACES: usize = 8;

/// Rows of eight rooks that do not attack each other, column by column.
const ROOKS: [usize; PLACES] = [4, 1, 6, 3, 0, 7, 2, 5];

impl Samples {
    /// Subpixels for the several rays of a pixel, as bits of 8 x 8 positions: bit `8 y + x`.
    pub(crate) const fn places(self) -> u64 {
        let mut bits = 0;
        let mut x = 0;
        while x < PLACES {
            bits |= match self {
                Self::One => 0,
                Self::Auto => 1 << (PLACES * ROOKS[x] + x),
                Self::Sixteen => 1 << (PLACES * ROOKS[x] + x) | 1 << (PLACES * ((ROOKS[x] + 4) % 8) + x),
                Self::SixtyFour => 0x0101_0101_0101_0101 << x,
                // A rotated square.
                Self::Four => match x {
                    1 => 1 << (PLACES * 4 + x),
                    3 => 1 << (PLACES + x),
                    4 => 1 << (PLACES * 6 + x),
                    6 => 1 << (PLACES * 3 + x),
                    _ => 0,
                },
            };
            x += 1;
        }
        bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pixel has the stated number of rays, their mean is its middle, and rays are evenly spread over rows and
    /// columns.
    #[test]
    fn rays_of_a_pixel_are_spread_evenly() {
        for (samples, count) in
            [(Samples::One, 0), (Samples::Four, 4), (Samples::Auto, 8), (Samples::Sixteen, 16)]
        {
            let places: Vec<usize> = (0..64).filter(|at| samples.places() >> at & 1 == 1).collect();
            assert_eq!(places.len(), count, "{samples:?}");
            let sum = |of: fn(usize) -> usize| places.iter().map(|at| 2 * of(*at) + 1).sum::<usize>();
            assert_eq!((sum(|at| at % 8), sum(|at| at / 8)), (8 * count, 8 * count), "{samples:?}");
            let most = count.div_ceil(8);
            for line in 0..8 {
                assert!(places.iter().filter(|at| *at % 8 == line).count() <= most, "{samples:?}");
                assert!(places.iter().filter(|at| *at / 8 == line).count() <= most, "{samples:?}");
            }
        }
    }
}
