//! Binary STL: 80 arbitrary bytes, a count, and 50 bytes a triangle.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};

use super::{Output, Sink, Vertex, bytes_of, counted, unit};

/// Must not begin with "solid", which readers take for the text form.
const HEAD: &[u8; 80] = b"binary STL, millimetres                                                         ";

pub(in crate::export) struct Stl {
    out: BufWriter<File>,
    triangles: u64,
}

impl Stl {
    pub(in crate::export) fn new(out: File) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        out.write_all(HEAD)?;
        out.write_all(&[0; 4])?;
        Ok(Self { out, triangles: 0 })
    }
}

impl Sink for Stl {
    fn vertex(&mut self, _: &Vertex) -> io::Result<()> {
        Ok(())
    }

    fn triangle(&mut self, _: [u32; 3], [a, b, c]: [[f32; 3]; 3]) -> io::Result<()> {
        let [u, v]: [[f32; 3]; 2] = [b, c].map(|p| std::array::from_fn(|i| p[i] - a[i]));
        let across = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let mut record = [0; 50];
        for (bytes, corner) in record.as_chunks_mut().0.iter_mut().zip([unit(across), a, b, c]) {
            *bytes = bytes_of(corner);
        }
        self.triangles += 1;
        self.out.write_all(&record)
    }
}

impl Output for Stl {
    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let count = counted(self.triangles)?;
        self.out.seek(SeekFrom::Start(80))?;
        self.out.write_all(&count.to_le_bytes())?;
        self.out.flush()
    }
}
