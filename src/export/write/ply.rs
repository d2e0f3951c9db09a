//! Binary PLY, little-endian: corners with normals and colours (sRGB), then triangles, of parts with their labels; or
//! corners alone.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};

use super::{Output, PartHead, Sink, Vertex, Waiting, bytes_of};
use crate::render::shade::Shader;

/// Bytes of the header: counts of any length fit, and a comment fills the rest.
const HEAD_BYTES: usize = 512;

pub(in crate::export) struct Ply {
    out: BufWriter<File>,
    /// Triangles; none for a file of points.
    faces: Option<Waiting>,
    normals: bool,
    /// Conversion of light to colours, if there are any.
    colors: Option<Shader>,
    /// The label of the present part, if triangles have labels.
    label: Option<u16>,
    vertices: u64,
    triangles: u64,
}

impl Ply {
    pub(in crate::export) fn new(
        out: File,
        faces: Option<File>,
        normals: bool,
        colors: bool,
    ) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        out.write_all(&[b' '; HEAD_BYTES])?;
        let (faces, colors) = (faces.map(Waiting::new), colors.then(Shader::new));
        Ok(Self { out, faces, normals, colors, label: None, vertices: 0, triangles: 0 })
    }

    /// The writer, with the label of each triangle.
    pub(in crate::export) fn with_labels(self) -> Self {
        Self { label: Some(0), ..self }
    }

    fn head(&self) -> Vec<u8> {
        let mut head =
            String::from("ply\nformat binary_little_endian 1.0\ncomment millimetres, x left, y back, z up\n");
        head += &format!("element vertex {}\n", self.vertices);
        head += "property float x\nproperty float y\nproperty float z\n";
        if self.normals {
            head += "property float nx\nproperty float ny\nproperty float nz\n";
        }
        if self.colors.is_some() {
            head += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
        }
        if self.faces.is_some() {
            head += &format!("element face {}\nproperty list uchar uint vertex_indices\n", self.triangles);
        }
        if self.label.is_some() {
            head += "property ushort label\n";
        }
        let end = "\nend_header\n";
        head += "comment ";
        head += &".".repeat(HEAD_BYTES.saturating_sub(head.len() + end.len()));
        head += end;
        head.into_bytes()
    }
}

impl Sink for Ply {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        self.vertices += 1;
        self.out.write_all(&bytes_of(vertex.at))?;
        if self.normals {
            self.out.write_all(&bytes_of(vertex.normal))?;
        }
        match &self.colors {
            Some(shader) => {
                self.out.write_all(&vertex.light.map(|light| shader.encode(f64::from(light) / 65535.0)))
            }
            None => Ok(()),
        }
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        self.triangles += 1;
        let Some(faces) = &mut self.faces else { return Ok(()) };
        let mut record = [3; 13];
        for (bytes, corner) in record[1..].as_chunks_mut().0.iter_mut().zip(corners) {
            *bytes = corner.to_le_bytes();
        }
        faces.0.write_all(&record)?;
        self.label.map_or(Ok(()), |label| faces.0.write_all(&label.to_le_bytes()))
    }
}

impl Output for Ply {
    fn part(&mut self, part: &PartHead) -> io::Result<()> {
        self.label = self.label.map(|_| part.label);
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let head = self.head();
        if let Some(faces) = self.faces.take() {
            faces.append_to(&mut self.out)?;
        }
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(&head)?;
        self.out.flush()
    }
}
