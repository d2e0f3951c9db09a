//! Within what a mesh is read, and what of it.

use std::path::Path;

/// Within what a mesh is read.
#[derive(Clone, Copy, Debug)]
pub(in crate::mesh) struct Limits<'a> {
    /// Folder of nameless files.
    pub(in crate::mesh) scratch: &'a Path,
    /// Memory for what a file says of its parts, beside what every reader takes.
    pub(in crate::mesh) most_bytes: u64,
    /// May links lead from a file that a mesh names out of its folder?
    pub(in crate::mesh) follow_links: bool,
    /// Is what vertices carry wanted, and are colours and textures?
    pub(in crate::mesh) looks: bool,
    pub(in crate::mesh) colors: bool,
    /// Millimetres of a unit that callers take the coordinates to be in: where a file states its unit, its
    /// coordinates are brought to that.
    pub(in crate::mesh) unit_mm: f64,
}

impl<'a> Limits<'a> {
    /// Shapes in millimetres, and a few MiB.
    pub(in crate::mesh) fn plain(scratch: &'a Path) -> Self {
        Self { scratch, most_bytes: 4 << 20, follow_links: false, looks: false, colors: false, unit_mm: 1.0 }
    }
}
