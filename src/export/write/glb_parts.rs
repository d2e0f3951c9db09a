//! Binary glTF 2.0 of several parts: a node, a mesh and a material for each, below one node that turns them all.
//!
//! The counts of parts are known before, so the description comes first and all else is written as it comes: the vertices
//! of a part (place and normal in turns), then its triangles.

use std::fs::File;
use std::io::{self, BufWriter, Write};

use serde_json::{Value, json};

use super::glb::{FLOAT, TO_METRES, UNSIGNED_INT, normal_of};
use super::{Output, PartHead, Sink, Vertex, bytes_of, counted};
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
        let mut text = description(parts, stride, data).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut out = BufWriter::with_capacity(1 << 18, out);
        let whole = counted(12 + 8 + text.len() as u64 + 8 + data)?;
        out.write_all(b"glTF")?;
        [2, whole, counted(text.len() as u64)?].iter().try_for_each(|n| out.write_all(&n.to_le_bytes()))?;
        out.write_all(b"JSON")?;
        out.write_all(&text)?;
        out.write_all(&counted(data)?.to_le_bytes())?;
        out.write_all(b"BIN\0")?;
        Ok(Self { out, normals, first: 0 })
    }
}

fn description(parts: &[PartHead], stride: u64, data: u64) -> Value {
    let (mut views, mut accessors, mut meshes) = (Vec::new(), Vec::new(), Vec::new());
    let (mut nodes, mut materials) = (Vec::new(), Vec::new());
    let mut offset = 0;
    for (number, part) in parts.iter().enumerate() {
        let (places, corners) = (stride * part.vertices, 12 * part.triangles);
        let view = views.len();
        views.push(json!({
            "buffer": 0, "byteOffset": offset, "byteLength": places, "byteStride": stride, "target": 34962,
        }));
        let corners_at = offset + places;
        views.push(json!({"buffer": 0, "byteOffset": corners_at, "byteLength": corners, "target": 34963}));
        offset += places + corners;
        let mut attributes = json!({"POSITION": accessors.len()});
        accessors.push(json!({
            "bufferView": view, "componentType": FLOAT, "count": part.vertices, "type": "VEC3",
            "min": part.low, "max": part.high,
        }));
        if stride > 12 {
            attributes["NORMAL"] = json!(accessors.len());
            accessors.push(json!({
                "bufferView": view, "byteOffset": 12, "componentType": FLOAT, "count": part.vertices,
                "type": "VEC3",
            }));
        }
        meshes.push(json!({
            "name": part.name,
            "primitives": [{"attributes": attributes, "indices": accessors.len(), "material": number}],
        }));
        accessors.push(json!({
            "bufferView": view + 1, "componentType": UNSIGNED_INT, "count": 3 * part.triangles,
            "type": "SCALAR",
        }));
        let [r, g, b] = part.color.map(|c| linear(f64::from(c) / 255.0));
        materials.push(json!({
            "name": part.name,
            "pbrMetallicRoughness": {
                "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0, "roughnessFactor": 0.9,
            },
        }));
        nodes.push(json!({"mesh": number, "name": part.name}));
    }
    let root = nodes.len();
    nodes.push(json!({"children": (0..root).collect::<Vec<_>>(), "matrix": TO_METRES}));
    json!({
        "asset": {"version": "2.0", "generator": concat!("infobyte ", env!("CARGO_PKG_VERSION"))},
        "scene": 0,
        "scenes": [{"nodes": [root]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": data}],
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
