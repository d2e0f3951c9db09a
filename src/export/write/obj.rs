//! Wavefront OBJ: text, corners and triangles in turns.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use super::digits::{four_decimals, shortest, whole};
use super::{Sink, Vertex};

pub(in crate::export) struct Obj {
    out: BufWriter<File>,
    normals: bool,
    /// The text to be written next, a few lines at most.
    text: Vec<u8>,
}

impl Obj {
    pub(in crate::export) fn new(out: File, normals: bool) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        out.write_all(b"# millimetres, x left, y back, z up\n")?;
        Ok(Self { out, normals, text: Vec::with_capacity(256) })
    }
}

impl Sink for Obj {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        let text = &mut self.text;
        text.clear();
        text.push(b'v');
        for c in vertex.at {
            text.push(b' ');
            shortest(text, c);
        }
        if self.normals {
            text.extend_from_slice(b"\nvn");
            for c in vertex.normal {
                text.push(b' ');
                four_decimals(text, c);
            }
        }
        text.push(b'\n');
        self.out.write_all(text)
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        let text = &mut self.text;
        text.clear();
        text.push(b'f');
        // Numbers begin at 1.
        for corner in corners.map(|corner| u64::from(corner) + 1) {
            text.push(b' ');
            whole(text, corner);
            if self.normals {
                text.extend_from_slice(b"//");
                whole(text, corner);
            }
        }
        text.push(b'\n');
        self.out.write_all(text)
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.out.flush()
    }
}
