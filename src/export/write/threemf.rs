//! 3MF: objects of triangles with names and colours, as XML in a ZIP archive (3MF Core Specification 1.3; PKWARE APPNOTE 4.3).
//!
//! An object's triangles follow all its vertices, and wait for them in an anonymous file.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};

use flate2::write::DeflateEncoder;
use flate2::{Compression, Crc};

use super::digits::{shortest, whole};
use super::{Output, PartHead, Sink, Vertex, counted};

const TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"><Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>
"#;
const RELATIONS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>
"#;
const BEGIN: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<resources>
<basematerials id="1">
"#;

/// The resource of the colours, and the first one of an object.
const FIRST_OBJECT: u64 = 2;
/// Bytes of text that are buffered before compression.
const TEXT: usize = 1 << 16;
/// Version 2.0 of the archive's format: deflated members. Members have a date: 1 January 1980.
const VERSION: u16 = 20;
const DATE: u16 = 0x0021;
const STORED: u16 = 0;
const DEFLATED: u16 = 8;

/// A member of the archive, and the offset of its header.
struct Member {
    name: &'static str,
    method: u16,
    crc: u32,
    packed: u32,
    bytes: u32,
    offset: u32,
}

impl Member {
    /// Fields common to its header and to the archive's directory.
    fn record(&self) -> io::Result<Vec<u8>> {
        let length = u16::try_from(self.name.len()).map_err(io::Error::other)?;
        let mut record = Vec::new();
        [VERSION, 0, self.method, 0, DATE].iter().for_each(|n| record.extend(n.to_le_bytes()));
        [self.crc, self.packed, self.bytes].iter().for_each(|n| record.extend(n.to_le_bytes()));
        [length, 0].iter().for_each(|n| record.extend(n.to_le_bytes()));
        Ok(record)
    }

    fn header(&self) -> io::Result<Vec<u8>> {
        let mut header = b"PK\x03\x04".to_vec();
        header.extend(self.record()?);
        header.extend(self.name.as_bytes());
        Ok(header)
    }

    fn entry(&self) -> io::Result<Vec<u8>> {
        let mut entry = b"PK\x01\x02".to_vec();
        entry.extend(VERSION.to_le_bytes());
        entry.extend(self.record()?);
        // No comment, on the first disk, no attributes.
        entry.extend([0; 10]);
        entry.extend(self.offset.to_le_bytes());
        entry.extend(self.name.as_bytes());
        Ok(entry)
    }
}

pub(in crate::export) struct ThreeMf {
    out: DeflateEncoder<BufWriter<File>>,
    members: Vec<Member>,
    crc: Crc,
    text: Vec<u8>,
    triangles: BufWriter<File>,
    waiting: u64,
    first: u32,
    objects: u64,
}

impl ThreeMf {
    /// `triangles` is the file for pending triangles.
    pub(in crate::export) fn new(out: File, parts: &[PartHead], triangles: File) -> io::Result<Self> {
        let mut out = BufWriter::with_capacity(1 << 18, out);
        let mut members = Vec::new();
        let mut offset = 0;
        for (name, text) in [("[Content_Types].xml", TYPES), ("_rels/.rels", RELATIONS)] {
            let (mut crc, bytes) = (Crc::new(), counted(text.len() as u64)?);
            crc.update(text.as_bytes());
            let member = Member { name, method: STORED, crc: crc.sum(), packed: bytes, bytes, offset };
            let header = member.header()?;
            out.write_all(&header)?;
            out.write_all(text.as_bytes())?;
            offset += counted((header.len() + text.len()) as u64)?;
            members.push(member);
        }
        let name = "3D/3dmodel.model";
        let model = Member { name, method: DEFLATED, crc: 0, packed: 0, bytes: 0, offset };
        out.write_all(&model.header()?)?;
        members.push(model);
        let mut text = BEGIN.as_bytes().to_vec();
        for part in parts {
            let [r, g, b] = part.color;
            let name = escaped(&part.name);
            writeln!(text, "<base name=\"{name}\" displaycolor=\"#{r:02X}{g:02X}{b:02X}\"/>")?;
        }
        text.extend(b"</basematerials>\n");
        Ok(Self {
            out: DeflateEncoder::new(out, Compression::fast()),
            members,
            crc: Crc::new(),
            text,
            triangles: BufWriter::new(triangles),
            waiting: 0,
            first: 0,
            objects: 0,
        })
    }

    fn put(&mut self, least: usize) -> io::Result<()> {
        if self.text.len() < least {
            return Ok(());
        }
        self.crc.update(&self.text);
        self.out.write_all(&self.text)?;
        self.text.clear();
        counted(self.out.total_in()).map(|_| ())
    }

    /// Completes the object that was begun last.
    fn end_object(&mut self) -> io::Result<()> {
        if self.objects == 0 {
            return Ok(());
        }
        self.text.extend(b"</vertices><triangles>\n");
        self.triangles.rewind()?;
        let mut waiting = BufReader::new(self.triangles.get_ref().try_clone()?);
        let mut record = [0; 12];
        for _ in 0..std::mem::take(&mut self.waiting) {
            waiting.read_exact(&mut record)?;
            for (name, corner) in ["<triangle v1=\"", "\" v2=\"", "\" v3=\""].iter().zip(record.as_chunks().0)
            {
                self.text.extend(name.as_bytes());
                whole(&mut self.text, u32::from_le_bytes(*corner).into());
            }
            self.text.extend(b"\"/>\n");
            self.put(TEXT)?;
        }
        self.triangles.rewind()?;
        self.text.extend(b"</triangles></mesh></object>\n");
        Ok(())
    }
}

/// A text as a value of an attribute; characters that XML does not have become `_`.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('_'),
            c => out.push(c),
        }
    }
    out
}

impl Sink for ThreeMf {
    fn vertex(&mut self, vertex: &Vertex) -> io::Result<()> {
        for (name, c) in ["<vertex x=\"", "\" y=\"", "\" z=\""].iter().zip(vertex.at) {
            self.text.extend(name.as_bytes());
            shortest(&mut self.text, c);
        }
        self.text.extend(b"\"/>\n");
        self.put(TEXT)
    }

    fn triangle(&mut self, corners: [u32; 3], _: [[f32; 3]; 3]) -> io::Result<()> {
        self.waiting += 1;
        let corners = corners.map(|corner| (corner - self.first).to_le_bytes());
        self.triangles.write_all(&bytemuck::cast::<_, [u8; 12]>(corners))
    }
}

impl Output for ThreeMf {
    fn part(&mut self, part: &PartHead) -> io::Result<()> {
        self.end_object()?;
        let (id, name, place) = (self.objects + FIRST_OBJECT, escaped(&part.name), self.objects);
        let object = format!(
            "<object id=\"{id}\" name=\"{name}\" type=\"model\" pid=\"1\" pindex=\"{place}\"><mesh><vertices>\n"
        );
        self.text.extend(object.as_bytes());
        self.objects += 1;
        self.first = part.first;
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.end_object()?;
        self.text.extend(b"</resources>\n<build>\n");
        for object in 0..self.objects {
            writeln!(self.text, "<item objectid=\"{}\"/>", object + FIRST_OBJECT)?;
        }
        self.text.extend(b"</build>\n</model>\n");
        self.put(0)?;
        let Self { mut out, mut members, crc, .. } = *self;
        out.try_finish()?;
        let (bytes, packed) = (counted(out.total_in())?, counted(out.total_out())?);
        let mut out = out.finish()?;
        if let Some(model) = members.last_mut() {
            (model.crc, model.packed, model.bytes) = (crc.sum(), packed, bytes);
        }
        let list = out.stream_position()?;
        let mut entries = Vec::new();
        for member in &members {
            entries.extend(member.entry()?);
        }
        out.write_all(&entries)?;
        let count = u16::try_from(members.len()).map_err(io::Error::other)?;
        out.write_all(b"PK\x05\x06\0\0\0\0")?;
        [count, count].iter().try_for_each(|n| out.write_all(&n.to_le_bytes()))?;
        [counted(entries.len() as u64)?, counted(list)?]
            .iter()
            .try_for_each(|n| out.write_all(&n.to_le_bytes()))?;
        out.write_all(&[0; 2])?;
        if let Some(model) = members.last() {
            out.seek(SeekFrom::Start(model.offset.into()))?;
            out.write_all(&model.header()?)?;
        }
        out.flush()
    }
}
