//! Wavefront OBJ: text, corners and triangles in turns.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use super::sink::{Sink, Vertex, unit};

pub(in crate::export) struct Obj {
    out: BufWriter<File>,
    normals: bool,
}

impl Obj {
    pub(in crate::export) fn new(out: File, normals: bool) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        out.write_all(b"# millimetres, x left, y back, z up\n")?;
        Ok(Self { out, normals })
    }
}

impl Sink for Obj {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        let [x, y, z] = vertex.at;
        writeln!(self.out, "v {x} {y} {z}")?;
        if self.normals {
            let [x, y, z] = unit(vertex.normal);
            writeln!(self.out, "vn {x:.4} {y:.4} {z:.4}")?;
        }
        Ok(())
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        // Numbers begin at 1.
        let [a, b, c] = corners.map(|corner| u64::from(corner) + 1);
        if self.normals {
            writeln!(self.out, "f {a}//{a} {b}//{b} {c}//{c}")
        } else {
            writeln!(self.out, "f {a} {b} {c}")
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.out.flush()
    }
}
