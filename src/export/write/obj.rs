//! Wavefront OBJ: text, corners and triangles in turns; an object for each part, whose corners have its colour after
//! their positions, as most programs read it.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use super::digits::{four_decimals, shortest, whole};
use super::{Output, PartHead, Sink, Vertex};

pub(in crate::export) struct Obj {
    out: BufWriter<File>,
    normals: bool,
    /// The colour of the present part, as text.
    color: String,
    /// The text to be written next, a few lines at most.
    text: Vec<u8>,
}

impl Obj {
    pub(in crate::export) fn new(out: File, normals: bool) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        out.write_all(b"# millimetres, x left, y back, z up\n")?;
        Ok(Self { out, normals, color: String::new(), text: Vec::with_capacity(256) })
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
        text.extend_from_slice(self.color.as_bytes());
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
}

impl Output for Obj {
    fn part(&mut self, part: &PartHead) -> io::Result<()> {
        let [r, g, b] = part.color.map(|c| f64::from(c) / 255.0);
        self.color = format!(" {r:.4} {g:.4} {b:.4}");
        // A name ends with its line; most programs end it at a space.
        let name = part.name.replace(|c: char| c.is_whitespace() || c.is_control(), "_");
        writeln!(self.out, "o {name}")
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.out.flush()
    }
}
