//! The sections of a model as they stand in a page: differences of items by `deflate`, in base64.

use std::io::{self, Write};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde::Serialize;

use crate::format::{Channel, SectionKind};
use crate::load::{Model, NodeView};

/// Bytes of one element of the page: strings of browsers end at 512 MiB, and short ones are let go sooner.
const ELEMENT: usize = 96 * BLOCK;

/// Bytes that become text at a time, a multiple of three.
const BLOCK: usize = 48 << 10;

const OPEN: &[u8] = b"<script type=\"text/plain\" data-part>";
const CLOSE: &[u8] = b"</script>\n";

/// Sections that a page has; directories are counted again there, and coarse levels not drawn.
const KINDS: [SectionKind; 9] = [
    SectionKind::Nodes,
    SectionKind::Voxels(Channel::Normal),
    SectionKind::Voxels(Channel::Offset),
    SectionKind::Voxels(Channel::Corners),
    SectionKind::Voxels(Channel::Color),
    SectionKind::Voxels(Channel::Value),
    SectionKind::Voxels(Channel::Material),
    SectionKind::LeafNormals,
    SectionKind::LeafOffsets,
];

/// A section among the data of a page.
#[derive(Serialize)]
pub(super) struct Section {
    kind: String,
    /// Bytes in the model, and as they are stored.
    bytes: u64,
    stored: u64,
    /// Bytes of an item, which are stored one after the other for all items, each less the one before; 0 for bytes as
    /// they are.
    planes: u8,
}

/// Writes the sections of a model, and says where they are.
pub(super) fn write<D: AsRef<[u8]>>(model: &Model<D>, out: &mut dyn Write) -> io::Result<Vec<Section>> {
    let mut elements = Elements { out, block: Vec::with_capacity(BLOCK), room: 0, bytes: 0 };
    let mut written = Vec::new();
    let cells = model.view().cells().is_some();
    for kind in KINDS {
        // Distances of skin voxels are not drawn.
        if kind == SectionKind::Voxels(Channel::Offset) && !cells {
            continue;
        }
        let (Some(bytes), Some(entry)) = (model.section_bytes(kind), model.frame().section(kind)) else {
            continue;
        };
        let planes = if kind == SectionKind::Nodes { 0 } else { entry.item_bytes };
        let before = elements.bytes;
        let mut encoder = ZlibEncoder::new(&mut elements, Compression::new(6));
        if planes == 0 {
            encoder.write_all(bytes)?;
        }
        for plane in 0..usize::from(planes) {
            let mut items = bytes.iter().skip(plane).step_by(planes.into());
            let (mut last, mut some) = (0, Vec::with_capacity(BLOCK));
            loop {
                some.clear();
                some.extend(
                    items
                        .by_ref()
                        .take(BLOCK)
                        .map(|byte| byte.wrapping_sub(std::mem::replace(&mut last, *byte))),
                );
                if some.is_empty() {
                    break;
                }
                encoder.write_all(&some)?;
            }
        }
        encoder.finish()?;
        written.push(Section {
            kind: String::from_utf8_lossy(&kind.tag()).into_owned(),
            bytes: bytes.len() as u64,
            stored: elements.bytes - before,
            planes,
        });
    }
    elements.finish()?;
    Ok(written)
}

/// Bytes as base64 in elements of a page.
struct Elements<'a> {
    out: &'a mut dyn Write,
    /// Fewer than [`BLOCK`] bytes that wait.
    block: Vec<u8>,
    /// Bytes that the element still takes; 0 before the first one.
    room: usize,
    /// Bytes so far.
    bytes: u64,
}

impl Elements<'_> {
    fn put(&mut self) -> io::Result<()> {
        if self.room == 0 {
            self.out.write_all(OPEN)?;
            self.room = ELEMENT;
        }
        self.out.write_all(STANDARD.encode(&self.block).as_bytes())?;
        // Only the last block is shorter, so that the others end between characters.
        self.room -= self.block.len();
        self.block.clear();
        if self.room == 0 { self.out.write_all(CLOSE) } else { Ok(()) }
    }

    fn finish(mut self) -> io::Result<()> {
        if !self.block.is_empty() {
            self.put()?;
        }
        if self.room > 0 { self.out.write_all(CLOSE) } else { Ok(()) }
    }
}

impl Write for Elements<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(BLOCK - self.block.len());
        self.block.extend(bytes.iter().take(taken));
        self.bytes += taken as u64;
        if self.block.len() == BLOCK {
            self.put()?;
        }
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
