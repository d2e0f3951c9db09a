//! glTF and 3MF files of bodies, each from the bytes of its specification.
#![allow(clippy::cast_possible_truncation, reason = "bodies are small")]

use std::io::Write;

use flate2::Compression;
use flate2::write::DeflateEncoder;
use serde_json::{Value, json};

use super::meshes::{Body, STEPS};

/// From metres, y up, to millimetres of the patient, and back: what a node says so that vertices are millimetres.
pub(crate) const MILLIMETRES: [f64; 16] =
    [0.001, 0.0, 0.0, 0.0, 0.0, 0.0, -0.001, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];

fn millimetres(body: &Body) -> Vec<[f64; 3]> {
    body.vertices.iter().map(|v| v.map(|c| c as f64 / STEPS as f64)).collect()
}

/// Bytes of vertices as singles, then of corners in 16 bits.
pub(crate) fn buffer(body: &Body) -> Vec<u8> {
    let mut bytes = Vec::new();
    for c in millimetres(body).into_iter().flatten() {
        bytes.extend((c as f32).to_le_bytes());
    }
    for at in body.faces.iter().flatten() {
        bytes.extend(u16::try_from(*at).unwrap().to_le_bytes());
    }
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

/// A description of one mesh in one buffer.
pub(crate) fn description(body: &Body) -> Value {
    let places = 12 * body.vertices.len();
    let corners = 6 * body.faces.len();
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "matrix": MILLIMETRES}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": body.vertices.len(), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3 * body.faces.len(), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": places},
            {"buffer": 0, "byteOffset": places, "byteLength": corners},
        ],
        "buffers": [{"byteLength": buffer(body).len()}],
    })
}

/// A binary file of a description and its buffer.
pub(crate) fn glb(description: &Value, buffer: &[u8]) -> Vec<u8> {
    let mut text = description.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let four = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend(four(28 + text.len() + buffer.len()));
    bytes.extend(four(text.len()));
    bytes.extend(b"JSON");
    bytes.extend(text);
    bytes.extend(four(buffer.len()));
    bytes.extend(b"BIN\0");
    bytes.extend(buffer);
    bytes
}

pub(crate) fn base64(bytes: &[u8]) -> String {
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for part in bytes.chunks(3) {
        let all = [part[0], *part.get(1).unwrap_or(&0), *part.get(2).unwrap_or(&0)];
        let bits = u32::from_be_bytes([0, all[0], all[1], all[2]]);
        for k in 0..4 {
            let digit = digits[(bits >> (18 - 6 * k) & 63) as usize];
            out.push(if k <= part.len() { char::from(digit) } else { '=' });
        }
    }
    out
}

/// Its description as a text, with the buffer in it.
pub(crate) fn gltf(body: &Body) -> Vec<u8> {
    let mut described = description(body);
    let data = base64(&buffer(body));
    described["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{data}").into();
    described.to_string().into_bytes()
}

/// A member of an archive, and how it is packed: deflated (8) or as it is (0).
pub(crate) type Part<'a> = (&'a str, Vec<u8>, u16);

/// A ZIP archive.
pub(crate) fn archive(parts: &[Part<'_>]) -> Vec<u8> {
    let (mut bytes, mut list) = (Vec::new(), Vec::new());
    for (name, content, method) in parts {
        let mut sum = flate2::Crc::new();
        sum.update(content);
        let stored = if *method == 8 {
            let mut packer = DeflateEncoder::new(Vec::new(), Compression::best());
            packer.write_all(content).unwrap();
            packer.finish().unwrap()
        } else {
            content.clone()
        };
        let mut facts = method.to_le_bytes().to_vec();
        facts.extend([0; 4]);
        for n in [sum.sum(), stored.len() as u32, content.len() as u32, name.len() as u32] {
            facts.extend(n.to_le_bytes());
        }
        let offset = bytes.len() as u32;
        bytes.extend(b"PK\x03\x04\x14\0\0\0");
        bytes.extend(&facts);
        bytes.extend(name.bytes());
        bytes.extend(stored);
        list.extend(b"PK\x01\x02\x14\0\x14\0\0\0");
        list.extend(&facts);
        list.extend([0; 10]);
        list.extend(offset.to_le_bytes());
        list.extend(name.bytes());
    }
    let (offset, length) = (bytes.len() as u32, list.len() as u32);
    let count = u16::try_from(parts.len()).unwrap().to_le_bytes();
    bytes.extend(list);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    bytes.extend(count);
    bytes.extend(count);
    bytes.extend(length.to_le_bytes());
    bytes.extend(offset.to_le_bytes());
    bytes.extend([0; 2]);
    bytes
}

/// Where the text of a 3MF file is, as its archive says.
pub(crate) const RELATIONS: &str = "<?xml version=\"1.0\"?><Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship Target=\"/3D/a.model\" Id=\"r\" Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>";

/// A text with these resources and these items.
pub(crate) fn text(unit: &str, resources: &str, items: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model unit=\"{unit}\" xml:lang=\"en-US\" xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\" xmlns:p=\"http://schemas.microsoft.com/3dmanufacturing/production/2015/06\" xmlns:m=\"http://schemas.microsoft.com/3dmanufacturing/material/2015/02\" requiredextensions=\"p m\">\n<resources>{resources}</resources><build>{items}</build></model>"
    )
}

/// A body as an object, in units of so many mm.
pub(crate) fn object(body: &Body, id: u32, unit_mm: f64) -> String {
    let mut text = format!("<object id=\"{id}\" type=\"model\"><mesh><vertices>");
    for [x, y, z] in millimetres(body) {
        text += &format!("<vertex x=\"{}\" y=\"{}\" z=\"{}\"/>", x / unit_mm, y / unit_mm, z / unit_mm);
    }
    text += "</vertices><triangles>";
    for [a, b, c] in &body.faces {
        text += &format!("<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\" />\n");
    }
    text + "</triangles></mesh></object>"
}

/// An archive around a text.
pub(crate) fn packed(text: &str, method: u16) -> Vec<u8> {
    archive(&[("_rels/.rels", RELATIONS.into(), method), ("3D/a.model", text.into(), method)])
}

/// A body as a 3MF file.
pub(crate) fn threemf(body: &Body) -> Vec<u8> {
    packed(&text("millimeter", &object(body, 1, 1.0), "<item objectid=\"1\"/>"), 8)
}
