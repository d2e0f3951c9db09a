//! Binary glTF 2.0: a header of JSON, then positions, normals, colours (linear) and corners of triangles (Khronos, sections 3 and 4).
//!
//! Coordinates stay millimetres of the patient's axes; the node maps them to the metres of glTF, with the head up and
//! the face forward.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};

use serde_json::{Value, json};

use super::{Output, Sink, Vertex, Waiting, bytes_of, counted};

/// Bytes of the JSON, filled with spaces.
const JSON_BYTES: usize = 1536;

/// Bytes before the positions: the file's header, the JSON with its header, and the header of the binary data.
const HEAD_BYTES: usize = 12 + 8 + JSON_BYTES + 8;

pub(super) const FLOAT: u32 = 5126;
pub(super) const UNSIGNED_INT: u32 = 5125;
const UNSIGNED_SHORT: u32 = 5123;

/// From LPS millimetres to metres with the head up (y) and the face forward (z), column by column.
pub(super) const TO_METRES: [f64; 16] =
    [0.001, 0.0, 0.0, 0.0, 0.0, 0.0, -0.001, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// A vertex's normal, which must have the length 1.
pub(super) fn normal_of(vertex: &Vertex) -> [f32; 3] {
    if vertex.normal == [0.0; 3] { [0.0, 0.0, 1.0] } else { vertex.normal }
}

/// Begins a file of so many bytes of JSON and of binary data.
pub(super) fn begin(out: &mut impl Write, json: u64, data: u64) -> io::Result<()> {
    out.write_all(b"glTF")?;
    let numbers = [2, counted(12 + 8 + json + 8 + data)?, counted(json)?];
    numbers.iter().try_for_each(|n| out.write_all(&n.to_le_bytes()))?;
    out.write_all(b"JSON")
}

/// Begins the binary data, after the JSON.
pub(super) fn begin_data(out: &mut impl Write, data: u64) -> io::Result<()> {
    out.write_all(&counted(data)?.to_le_bytes())?;
    out.write_all(b"BIN\0")
}

pub(in crate::export) struct Glb {
    out: BufWriter<File>,
    normals: Option<Waiting>,
    colors: Option<Waiting>,
    corners: Waiting,
    vertices: u64,
    triangles: u64,
    least: [f32; 3],
    greatest: [f32; 3],
}

impl Glb {
    /// `normals` and `colors` are files for their pending data, if there are any; so is `corners`.
    pub(in crate::export) fn new(
        out: File,
        normals: Option<File>,
        colors: Option<File>,
        corners: File,
    ) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        out.write_all(&[0; HEAD_BYTES])?;
        Ok(Self {
            out,
            normals: normals.map(Waiting::new),
            colors: colors.map(Waiting::new),
            corners: Waiting::new(corners),
            vertices: 0,
            triangles: 0,
            least: [f32::INFINITY; 3],
            greatest: [f32::NEG_INFINITY; 3],
        })
    }

    fn description(&self) -> Value {
        let (places, corners) = (12 * self.vertices, 12 * self.triangles);
        let normals = self.normals.is_some();
        let mut views = vec![json!({"buffer": 0, "byteLength": places, "target": 34962})];
        let mut accessors = vec![json!({
            "bufferView": 0, "componentType": FLOAT, "count": self.vertices, "type": "VEC3",
            "min": self.least, "max": self.greatest,
        })];
        let mut attributes = json!({"POSITION": 0});
        let mut offset = places;
        if normals {
            views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": places, "target": 34962}));
            accessors.push(json!({
                "bufferView": 1, "componentType": FLOAT, "count": self.vertices, "type": "VEC3",
            }));
            attributes["NORMAL"] = json!(1);
            offset += places;
        }
        let mut base_color = json!([0.92, 0.88, 0.8, 1.0]);
        if self.colors.is_some() {
            let bytes = 8 * self.vertices;
            views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes, "target": 34962}));
            attributes["COLOR_0"] = json!(accessors.len());
            accessors.push(json!({
                "bufferView": accessors.len(), "componentType": UNSIGNED_SHORT, "normalized": true,
                "count": self.vertices, "type": "VEC4",
            }));
            offset += bytes;
            // The base colour is multiplied by the vertices' colours.
            base_color = json!([1.0, 1.0, 1.0, 1.0]);
        }
        let last = views.len();
        views.push(json!({"buffer": 0, "byteOffset": offset, "byteLength": corners, "target": 34963}));
        accessors.push(json!({
            "bufferView": last, "componentType": UNSIGNED_INT, "count": 3 * self.triangles, "type": "SCALAR",
        }));
        json!({
            "asset": {"version": "2.0", "generator": concat!("infobyte ", env!("CARGO_PKG_VERSION"))},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{
                "mesh": 0,
                "matrix": TO_METRES,
            }],
            "meshes": [{"primitives": [{"attributes": attributes, "indices": last, "material": 0}]}],
            "materials": [{
                "pbrMetallicRoughness": {
                    "baseColorFactor": base_color, "metallicFactor": 0, "roughnessFactor": 0.9,
                },
            }],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": offset + corners}],
        })
    }
}

impl Sink for Glb {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        self.vertices += 1;
        for a in 0..3 {
            self.least[a] = self.least[a].min(vertex.at[a]);
            self.greatest[a] = self.greatest[a].max(vertex.at[a]);
        }
        self.out.write_all(&bytes_of(vertex.at))?;
        if let Some(colors) = &mut self.colors {
            // Opaque colours, of four components of two bytes: attributes must begin at multiples of four.
            let [r, g, b] = vertex.light.map(u16::to_le_bytes);
            colors.0.write_all(&bytemuck::cast::<_, [u8; 8]>([r, g, b, [255; 2]]))?;
        }
        match &mut self.normals {
            Some(normals) => normals.0.write_all(&bytes_of(normal_of(vertex))),
            None => Ok(()),
        }
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        self.triangles += 1;
        self.corners.0.write_all(&bytemuck::cast::<_, [u8; 12]>(corners.map(u32::to_le_bytes)))
    }
}

impl Output for Glb {
    fn finish(self: Box<Self>) -> io::Result<()> {
        let text = self.description().to_string();
        let Self { mut out, normals, colors, corners, vertices, triangles, .. } = *self;
        let vertex = 12 + if normals.is_some() { 12 } else { 0 } + if colors.is_some() { 8 } else { 0 };
        let data = vertex * vertices + 12 * triangles;
        if let Some(normals) = normals {
            normals.append_to(&mut out)?;
        }
        if let Some(colors) = colors {
            colors.append_to(&mut out)?;
        }
        corners.append_to(&mut out)?;
        out.seek(SeekFrom::Start(0))?;
        begin(&mut out, JSON_BYTES as u64, data)?;
        write!(out, "{text:JSON_BYTES$}")?;
        begin_data(&mut out, data)?;
        out.flush()
    }
}
