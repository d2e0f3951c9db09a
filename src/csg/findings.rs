//! Facts about trees of solids.

use std::fmt;

use crate::mesh::length;

/// Facts about a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CsgFacts {
    /// Number of leaves.
    pub leaves: u64,
    /// Number of meshes and volumes among them, which are read from files.
    pub files: u64,
    /// Steps from voxel to voxel in mm.
    pub voxel_mm: [f64; 3],
    /// Corner of the grid in mm, along the axes of the model; for a volume's grid the middle of its first voxel.
    pub origin_mm: [f64; 3],
    /// Sides on which solids are cut because their bounds reach out of a volume's grid: at the low end of each axis of
    /// the grid, then at the high ends.
    pub cut: [[bool; 3]; 2],
}

impl fmt::Display for CsgFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { leaves, files, voxel_mm, origin_mm, cut } = self;
        write!(f, "{leaves} {}", if *leaves == 1 { "leaf" } else { "leaves" })?;
        if *files > 0 {
            write!(f, ", {files} of them from files")?;
        }
        let short = |of: f64| length(of, of / 1000.0);
        let smallest = voxel_mm.iter().fold(f64::INFINITY, |a, b| a.min(*b));
        let [x, y, z] = origin_mm.map(|at| length(at, smallest));
        match voxel_mm {
            [a, b, c] if a == b && b == c => write!(f, "; voxels of {} mm", short(*a))?,
            [a, b, c] => write!(f, "; voxels of {} x {} x {} mm", short(*a), short(*b), short(*c))?,
        }
        write!(f, " from {x}, {y}, {z}")?;
        if *cut == [[false; 3]; 2] {
            return Ok(());
        }
        f.write_str(
            "; the bounds of its solids reach out of the volume's grid, and what lies beyond is cut off (",
        )?;
        let mut before = "";
        for (cut, end) in cut.iter().zip(["low", "high"]) {
            for axis in ["x", "y", "z"].iter().zip(cut).filter_map(|(axis, cut)| cut.then_some(axis)) {
                write!(f, "{before}{end} {axis}")?;
                before = ", ";
            }
        }
        f.write_str(")")
    }
}
