//! Size of a volume in voxels, and of the cubic grid that holds it.

use std::fmt;

/// Number of voxels along x, y and z, each within 1..=65536.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(try_from = "[u32; 3]")]
pub struct Dims {
    nx: u32,
    ny: u32,
    nz: u32,
}

impl TryFrom<[u32; 3]> for Dims {
    type Error = String;

    fn try_from([x, y, z]: [u32; 3]) -> Result<Self, String> {
        Self::new(x, y, z).ok_or_else(|| format!("{x} x {y} x {z} is not a size; each side is 1 to 65536"))
    }
}

impl Dims {
    /// Longest side that the format and the Morton codes allow.
    pub const MAX_SIDE: u32 = 1 << 16;

    /// Checked constructor: `None` when a side is 0 or over [`Dims::MAX_SIDE`].
    pub fn new(nx: u32, ny: u32, nz: u32) -> Option<Self> {
        let ok = |n: u32| (1..=Self::MAX_SIDE).contains(&n);
        (ok(nx) && ok(ny) && ok(nz)).then_some(Self { nx, ny, nz })
    }

    /// Columns (x).
    pub fn nx(self) -> u32 {
        self.nx
    }

    /// Rows (y).
    pub fn ny(self) -> u32 {
        self.ny
    }

    /// Slices (z).
    pub fn nz(self) -> u32 {
        self.nz
    }

    /// `[nx, ny, nz]`.
    pub fn to_array(self) -> [u32; 3] {
        [self.nx, self.ny, self.nz]
    }

    /// Number of voxels; at most 2^48.
    pub fn voxels(self) -> u64 {
        u64::from(self.nx) * u64::from(self.ny) * u64::from(self.nz)
    }

    /// Depth L of the octree: the smallest L with `2^L >=` the longest side, 0..=16.
    pub fn depth(self) -> u32 {
        self.nx.max(self.ny).max(self.nz).next_power_of_two().trailing_zeros()
    }

    /// True for a voxel inside the volume.
    pub fn contains(self, x: u32, y: u32, z: u32) -> bool {
        x < self.nx && y < self.ny && z < self.nz
    }
}

impl fmt::Display for Dims {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}x{}", self.nx, self.ny, self.nz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_the_smallest_power_of_two_that_fits() {
        let depth = |a, b, c| Dims::new(a, b, c).unwrap().depth();
        assert_eq!(depth(1, 1, 1), 0);
        assert_eq!(depth(2, 1, 1), 1);
        assert_eq!(depth(1, 3, 1), 2);
        assert_eq!(depth(256, 256, 113), 8);
        assert_eq!(depth(1, 1, 257), 9);
        assert_eq!(depth(65536, 1, 1), 16);
        assert!(Dims::new(0, 1, 1).is_none());
        assert!(Dims::new(1, 65537, 1).is_none());
    }
}
