//! Files of triangles and points, written as they are made.
//!
//! Where a format needs counts first, or all corners before all triangles, the rest waits in an anonymous file.

mod digits;
mod glb;
mod glb_parts;
mod obj;
mod ply;
mod stl;
mod threemf;

pub(super) use glb::Glb;
pub(super) use glb_parts::GlbParts;
pub(super) use obj::Obj;
pub(super) use ply::Ply;
pub(super) use stl::Stl;
pub(super) use threemf::ThreeMf;

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Seek, Write};

use crate::export::fault::ExportFault;
use crate::export::vertex_color::Light;

/// A vertex: its position in mm, its normal, a unit vector or zeros, and its colour.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::export) struct Vertex {
    pub(in crate::export) at: [f32; 3],
    pub(in crate::export) normal: [f32; 3],
    pub(in crate::export) light: Light,
}

/// Facts of a part that are known before its vertices: the vertices of one part are contiguous, with their triangles
/// behind them.
#[derive(Clone, Debug, Default)]
pub(in crate::export) struct PartHead {
    pub(in crate::export) label: u16,
    pub(in crate::export) name: String,
    /// Colour (sRGB).
    pub(in crate::export) color: [u8; 3],
    pub(in crate::export) vertices: u64,
    pub(in crate::export) triangles: u64,
    /// Least and greatest coordinates in mm.
    pub(in crate::export) low: [f32; 3],
    pub(in crate::export) high: [f32; 3],
    /// Number of its first vertex in the file.
    pub(in crate::export) first: u32,
}

/// Consumer of vertices in order, and of triangles of vertices that came before.
pub(in crate::export) trait Sink: Send {
    /// # Errors
    /// Errors of the disk.
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()>;

    /// A triangle by the numbers of its corners and their positions; seen from outside they run anticlockwise.
    fn triangle(&mut self, corners: [u32; 3], at: [[f32; 3]; 3]) -> io::Result<()>;

    /// The next layer begins: from here on no triangle has a corner before `first`.
    ///
    /// # Errors
    /// Errors of the disk.
    fn layer(&mut self, _first: u32) -> io::Result<()> {
        Ok(())
    }
}

/// A file of vertices and triangles.
pub(in crate::export) trait Output: Sink {
    /// Begins a part; not called for a surface without parts.
    ///
    /// # Errors
    /// Errors of the disk.
    fn part(&mut self, _: &PartHead) -> io::Result<()> {
        Ok(())
    }

    /// Completes the file.
    ///
    /// # Errors
    /// Errors of the disk; [`ExportFault::TooLong`] where the format cannot hold a count.
    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// A number that a format keeps in 32 bits.
pub(super) fn counted(needed: u64) -> io::Result<u32> {
    u32::try_from(needed).map_err(|_| ExportFault::TooLong { needed }.into())
}

/// Bytes that are kept in an anonymous file until others are written.
#[derive(Debug)]
pub(super) struct Waiting(pub(super) BufWriter<File>);

impl Waiting {
    pub(super) fn new(scratch: File) -> Self {
        Self(BufWriter::new(scratch))
    }

    pub(super) fn append_to(self, out: &mut impl Write) -> io::Result<()> {
        let mut file = self.0.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.rewind()?;
        io::copy(&mut BufReader::new(file), out)?;
        Ok(())
    }
}

/// The bytes of three floats, little-endian.
pub(super) fn bytes_of(v: [f32; 3]) -> [u8; 12] {
    bytemuck::cast(v.map(f32::to_le_bytes))
}

/// The unit vector of a normal; zeros stay.
pub(in crate::export) fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if length > 0.0 && length.is_finite() { v.map(|c| c / length) } else { [0.0; 3] }
}
