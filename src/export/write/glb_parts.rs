//! Binary glTF 2.0 of several parts: a node, a mesh and a material for each, below one node that turns them all.
//!
//! The counts of parts are known in advance, so the description comes first and all else is written as it comes: the
//! vertices of a part (position and normal in turns), then its triangles.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use serde_json::{Value, json};

use super::glb::{FLOAT, TO_METRES, UNSIGNED_INT, begin, begin_data, normal_of};
use super::{Output, PartHead, Sink, Vertex, bytes_of};
use crate::render::shade::linear;

pub(in crate::export) struct GlbParts {
    out: BufWriter<File>,
    normals: bool,
    first: u32,
}

impl GlbParts {
    pub(in crate::export) fn new(out: File, parts: &[PartHead], normals: bool) -> io::Result<Self> {
        let stride = if normals { 24 } else { 12 };
        let data = parts.iter().map(|part| stride * part.vertices + 12 * part.triangles).sum::<u64>();
        let mut length = Length(0);
        describe(parts, stride, data, &mut length)?;
        let padded = length.0.next_multiple_of(4);
        let mut out = BufWriter::with_capacity(1 << 18, out);
        begin(&mut out, padded, data)?;
        describe(parts, stride, data, &mut out)?;
        (length.0..padded).try_for_each(|_| out.write_all(b" "))?;
        begin_data(&mut out, data)?;
        Ok(Self { out, normals, first: 0 })
    }
}

/// Counts the bytes written.
struct Length(u64);

impl Write for Length {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes the description, one part after the other in each of its lists: none of them is held as a whole.
fn describe(parts: &[PartHead], stride: u64, data: u64, out: &mut dyn Write) -> io::Result<()> {
    let accessors_of = if stride > 12 { 3 } else { 2 };
    let numbered = || parts.iter().enumerate();
    out.write_all(b"{")?;
    list(out, "accessors", &mut numbered().flat_map(|(number, part)| accessors(number, part, stride)))?;
    let asset = json!({"version": "2.0", "generator": concat!("infobyte ", env!("CARGO_PKG_VERSION"))});
    write!(out, ",\"asset\":{asset},")?;
    let mut offset = 0;
    let views = parts.iter().flat_map(|part| {
        let (places, corners) = (stride * part.vertices, 12 * part.triangles);
        let corners_at = offset + places;
        let views = [
            json!({"buffer": 0, "byteOffset": offset, "byteLength": places, "byteStride": stride, "target": 34962}),
            json!({"buffer": 0, "byteOffset": corners_at, "byteLength": corners, "target": 34963}),
        ];
        offset = corners_at + corners;
        views
    });
    list(out, "bufferViews", &mut { views })?;
    write!(out, ",\"buffers\":[{{\"byteLength\":{data}}}],")?;
    list(out, "materials", &mut parts.iter().map(material))?;
    out.write_all(b",")?;
    let meshes = numbered().map(|(number, part)| {
        let first = accessors_of * number;
        let mut attributes = json!({"POSITION": first});
        if stride > 12 {
            attributes["NORMAL"] = json!(first + 1);
        }
        let last = first + accessors_of - 1;
        json!({
            "name": part.name,
            "primitives": [{"attributes": attributes, "indices": last, "material": number}],
        })
    });
    list(out, "meshes", &mut { meshes })?;
    out.write_all(b",")?;
    let root = (parts.len(), json!({"children": (0..parts.len()).collect::<Vec<_>>(), "matrix": TO_METRES}));
    let nodes = numbered().map(|(number, part)| json!({"mesh": number, "name": part.name}));
    list(out, "nodes", &mut nodes.chain([root.1]))?;
    write!(out, ",\"scene\":0,\"scenes\":[{{\"nodes\":[{}]}}]}}", root.0)
}

/// Writes a list and its name.
fn list(out: &mut dyn Write, name: &str, items: &mut dyn Iterator<Item = Value>) -> io::Result<()> {
    write!(out, "\"{name}\":[")?;
    for (at, item) in items.enumerate() {
        write!(out, "{}{item}", if at == 0 { "" } else { "," })?;
    }
    out.write_all(b"]")
}

/// The accessors of a part: positions, normals if there are any, and corners.
fn accessors(number: usize, part: &PartHead, stride: u64) -> impl Iterator<Item = Value> {
    let view = 2 * number;
    let places = json!({
        "bufferView": view, "componentType": FLOAT, "count": part.vertices, "type": "VEC3",
        "min": part.low, "max": part.high,
    });
    let normals = (stride > 12).then(|| {
        json!({
            "bufferView": view, "byteOffset": 12, "componentType": FLOAT, "count": part.vertices,
            "type": "VEC3",
        })
    });
    let corners = json!({
        "bufferView": view + 1, "componentType": UNSIGNED_INT, "count": 3 * part.triangles,
        "type": "SCALAR",
    });
    [Some(places), normals, Some(corners)].into_iter().flatten()
}

fn material(part: &PartHead) -> Value {
    let [r, g, b] = part.color.map(|c| linear(f64::from(c) / 255.0));
    json!({
        "name": part.name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0, "roughnessFactor": 0.9,
        },
    })
}

impl Sink for GlbParts {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        self.out.write_all(&bytes_of(vertex.at))?;
        if self.normals { self.out.write_all(&bytes_of(normal_of(vertex))) } else { Ok(()) }
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        let corners = corners.map(|corner| (corner - self.first).to_le_bytes());
        self.out.write_all(&bytemuck::cast::<_, [u8; 12]>(corners))
    }
}

impl Output for GlbParts {
    fn part(&mut self, part: &PartHead) -> io::Result<()> {
        self.first = part.first;
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.out.flush()
    }
}
