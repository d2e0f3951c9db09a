//! The sections of a model in the form of a page: differences of items by `deflate`, in base64.

use std::io::{self, Write};
use std::rc::Rc;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde::Serialize;

use crate::format::cell::CORNERS;
use crate::format::{Channel, Label, LabelItems, SectionKind, WALL_BYTES};
use crate::load::{Model, NodeView};

/// Bytes that become one element of text, a multiple of three; short elements are freed sooner.
const BLOCK: usize = 48 << 10;

const OPEN: &[u8] = b"<script type=\"text/plain\" data-part>";
const CLOSE: &[u8] = b"</script>\n";

/// Sections that a page has; the page recomputes directories, and does not draw coarse levels.
const KINDS: [SectionKind; 10] = [
    SectionKind::Nodes,
    SectionKind::Voxels(Channel::Normal),
    SectionKind::Voxels(Channel::Offset),
    SectionKind::Voxels(Channel::Corners),
    SectionKind::Voxels(Channel::Label),
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
    /// Bytes in the model, and in the stored form.
    bytes: u64,
    stored: u64,
    /// Bytes of an item; each is stored for all items in turn, as a difference to the item before; 0 for unchanged
    /// bytes.
    planes: u8,
}

/// Most labels of a page: a label is a byte there, its index in the table from 1 on; 0 stands for no label.
pub(crate) const MAX_LABELS: usize = 255;

/// Bytes of the item of a cell that one plane does not part, in the page's form, a texel: the labels of its corners,
/// the offsets of both planes, the second one's normal, and zeros.
const ITEM_BYTES: usize = 16;

/// The bytes of a section as a page holds them, plane by plane.
struct Content<'a> {
    /// Bytes in total, and of an item; 0 for unchanged bytes, in one plane.
    bytes: u64,
    planes: u8,
    plane: Box<dyn Fn(usize) -> Box<dyn Iterator<Item = u8> + 'a> + 'a>,
}

impl<'a> Content<'a> {
    /// Items as in the file.
    fn plain(bytes: &'a [u8], planes: u8) -> Self {
        let step = usize::from(planes.max(1));
        let plane = move |plane| -> Box<dyn Iterator<Item = u8>> {
            Box::new(bytes.iter().skip(plane).step_by(step).copied())
        };
        Self { bytes: bytes.len() as u64, planes, plane: Box::new(plane) }
    }

    /// The labels behind and in front of each cell.
    fn labels(labels: LabelItems<'a>, cells: u64, places: Places) -> Self {
        let plane = move |plane: usize| -> Box<dyn Iterator<Item = u8>> {
            let places = places.clone();
            let number = move |cell| labels.pair(cell).and_then(|pair| pair.get(plane).copied());
            Box::new((0..cells).map(move |cell| places.of(number(cell).unwrap_or(0))))
        };
        Self { bytes: 2 * cells, planes: 2, plane: Box::new(plane) }
    }

    /// Items of cells between more than two labels.
    fn walls(bytes: &'a [u8], places: Places) -> Self {
        let items: &[[u8; WALL_BYTES]] = bytes.as_chunks().0;
        let plane = move |plane: usize| -> Box<dyn Iterator<Item = u8>> {
            let places = places.clone();
            let label = move |item: &[u8; WALL_BYTES]| {
                Some(u16::from_le_bytes(*item.get(2 * plane..)?.first_chunk()?))
            };
            let byte = move |item: &[u8; WALL_BYTES]| match plane {
                0..CORNERS => places.of(label(item).unwrap_or(0)),
                _ => item.get(plane + CORNERS).copied().unwrap_or(0),
            };
            Box::new(items.iter().map(byte))
        };
        Self { bytes: (items.len() * ITEM_BYTES) as u64, planes: 16, plane: Box::new(plane) }
    }
}

/// Indices of labels in the table, from 1 on.
#[derive(Clone)]
struct Places(Rc<[u16]>);

impl Places {
    fn new(table: &[Label]) -> Self {
        Self(table.iter().map(|label| label.number).collect())
    }

    /// Index of a label; 0 for none.
    fn of(&self, number: u16) -> u8 {
        self.0.binary_search(&number).map_or(0, |at| u8::try_from(at + 1).unwrap_or(0))
    }
}

/// The content of a section, if the page has it.
fn content<D: AsRef<[u8]>>(model: &Model<D>, kind: SectionKind) -> Option<Content<'_>> {
    let (table, view) = (&model.frame().labels, model.view());
    let is_cells = view.cells().is_some();
    let (bytes, entry) = (model.section_bytes(kind)?, model.frame().section(kind)?);
    Some(match kind {
        // Distances of skin voxels are not drawn.
        SectionKind::Voxels(Channel::Offset) if !is_cells => return None,
        SectionKind::Voxels(Channel::Label) => {
            Content::labels(view.labels()?, model.header().voxels, Places::new(table))
        }
        SectionKind::Voxels(Channel::Corners) if !table.is_empty() => {
            Content::walls(bytes, Places::new(table))
        }
        SectionKind::Nodes => Content::plain(bytes, 0),
        _ => Content::plain(bytes, entry.item_bytes),
    })
}

/// Writes the sections of a model, and returns their positions.
pub(super) fn write<D: AsRef<[u8]>>(model: &Model<D>, out: &mut dyn Write) -> io::Result<Vec<Section>> {
    let mut elements = Elements { out, block: Vec::with_capacity(BLOCK), bytes: 0 };
    let mut written = Vec::new();
    for kind in KINDS {
        let Some(content) = content(model, kind) else { continue };
        let before = elements.bytes;
        let mut encoder = ZlibEncoder::new(&mut elements, Compression::new(6));
        for plane in 0..usize::from(content.planes.max(1)) {
            let mut items = (content.plane)(plane);
            let (mut last, mut some) = (0, Vec::with_capacity(BLOCK));
            let mut less = |byte: u8| match content.planes {
                0 => byte,
                _ => byte.wrapping_sub(std::mem::replace(&mut last, byte)),
            };
            loop {
                some.clear();
                some.extend(items.by_ref().take(BLOCK).map(&mut less));
                if some.is_empty() {
                    break;
                }
                encoder.write_all(&some)?;
            }
        }
        encoder.finish()?;
        written.push(Section {
            kind: String::from_utf8_lossy(&kind.tag()).into_owned(),
            bytes: content.bytes,
            stored: elements.bytes - before,
            planes: content.planes,
        });
    }
    elements.finish()?;
    Ok(written)
}

/// Bytes as base64 in elements of a page.
struct Elements<'a> {
    out: &'a mut dyn Write,
    /// Pending bytes, fewer than [`BLOCK`].
    block: Vec<u8>,
    /// Bytes so far.
    bytes: u64,
}

impl Elements<'_> {
    fn put(&mut self) -> io::Result<()> {
        self.out.write_all(OPEN)?;
        self.out.write_all(STANDARD.encode(&self.block).as_bytes())?;
        self.block.clear();
        self.out.write_all(CLOSE)
    }

    fn finish(mut self) -> io::Result<()> {
        if self.block.is_empty() { Ok(()) } else { self.put() }
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
