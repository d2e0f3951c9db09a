//! The fixed header (SPEC 4.1).

use super::error::{FormatError, damaged};
use super::kind::SurfaceKind;
use crate::geom::Dims;

/// First eight bytes of every file (SPEC 4.1).
pub const MAGIC: [u8; 8] = [0x89, b'O', b'C', b'T', 0x0d, 0x0a, 0x1a, 0x0a];
/// Major version written and read.
pub(crate) const VERSION_MAJOR: u16 = 1;
/// Minor version written; higher ones are also read.
pub(crate) const VERSION_MINOR: u16 = 0;
/// Minor version of files with a quantity.
pub(crate) const QUANTITY_MINOR: u16 = 1;
/// Size of the header.
pub const HEADER_BYTES: usize = 64;

const AT_MAJOR: usize = MAGIC.len();
const AT_MINOR: usize = AT_MAJOR + 2;
const AT_ENCODING: usize = AT_MINOR + 2;
const AT_DEPTH: usize = AT_ENCODING + 1;
const AT_SECTIONS: usize = AT_DEPTH + 1;
const AT_FILE_BYTES: usize = AT_SECTIONS + 2;
const AT_NODES: usize = AT_FILE_BYTES + 8;
const AT_VOXELS: usize = AT_NODES + 8;
const AT_DIMS: usize = AT_VOXELS + 8;
const AT_RESERVED: usize = AT_DIMS + 12;
const AT_TABLE_CRC: usize = AT_RESERVED + 4;
const AT_HEADER_CRC: usize = AT_TABLE_CRC + 4;
const _: () = assert!(AT_HEADER_CRC + 4 == HEADER_BYTES);

/// Bits of the encoding byte: packed; cells instead of skin voxels; cells with larger leaves; cells between labels.
const PACKED: u8 = 1;
const CELLS: u8 = 2;
const LEAVES: u8 = 4;
const WALLS: u8 = 8;
const WITH_LEAVES: u8 = CELLS | LEAVES;
const WITH_WALLS: u8 = CELLS | WALLS;

/// Storage of sections.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Encoding {
    /// Plain, used in place.
    Mapped,
    /// Entropy coded, for archive and transport.
    Packed,
}

impl Encoding {
    /// Word used in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mapped => "mapped",
            Self::Packed => "packed",
        }
    }
}

/// The header's fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Minor version found or written.
    pub minor: u16,
    /// Storage of the sections.
    pub encoding: Encoding,
    /// The kind of the boxes of the finest level.
    pub surface: SurfaceKind,
    /// True if some nodes are larger leaves (SPEC 4.9); only for cells.
    pub leaves: bool,
    /// True if planes separate labels (SPEC 4.12); only for cells without larger leaves.
    pub walls: bool,
    /// Number of sections.
    pub sections: u16,
    /// Length of the file in bytes.
    pub file_bytes: u64,
    /// Nodes N (infobytes).
    pub nodes: u64,
    /// Skin voxels V, or cells.
    pub voxels: u64,
    /// Size of the volume in voxels, or in cells: one more along each axis. The depth follows from it.
    pub dims: Dims,
    /// CRC of the section table.
    pub table_crc: u32,
}

fn u16_at(b: &[u8; HEADER_BYTES], at: usize) -> u16 {
    u16::from_le_bytes([b[at], b[at + 1]])
}

fn u32_at(b: &[u8; HEADER_BYTES], at: usize) -> u32 {
    u32::from_le_bytes([b[at], b[at + 1], b[at + 2], b[at + 3]])
}

fn u64_at(b: &[u8; HEADER_BYTES], at: usize) -> u64 {
    u64::from(u32_at(b, at)) | u64::from(u32_at(b, at + 4)) << 32
}

impl Header {
    /// The bytes of the header.
    pub fn to_bytes(&self) -> [u8; HEADER_BYTES] {
        let mut b = [0; HEADER_BYTES];
        let mut put = |at: usize, bytes: &[u8]| b[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, &MAGIC);
        put(AT_MAJOR, &VERSION_MAJOR.to_le_bytes());
        put(AT_MINOR, &self.minor.to_le_bytes());
        let packed = if self.encoding == Encoding::Packed { PACKED } else { 0 };
        let cells = if self.surface == SurfaceKind::Cells { CELLS } else { 0 };
        let leaves = if self.leaves { LEAVES } else { 0 };
        put(AT_ENCODING, &[packed | cells | leaves | if self.walls { WALLS } else { 0 }]);
        #[expect(clippy::cast_possible_truncation, reason = "depth is at most 16")]
        put(AT_DEPTH, &[self.dims.depth() as u8]);
        put(AT_SECTIONS, &self.sections.to_le_bytes());
        put(AT_FILE_BYTES, &self.file_bytes.to_le_bytes());
        put(AT_NODES, &self.nodes.to_le_bytes());
        put(AT_VOXELS, &self.voxels.to_le_bytes());
        for (axis, n) in self.dims.to_array().into_iter().enumerate() {
            put(AT_DIMS + 4 * axis, &n.to_le_bytes());
        }
        put(AT_TABLE_CRC, &self.table_crc.to_le_bytes());
        let crc = crc32c::crc32c(&b[..AT_HEADER_CRC]);
        b[AT_HEADER_CRC..].copy_from_slice(&crc.to_le_bytes());
        b
    }

    /// Reads and checks the header of a file of `file_len` bytes that starts with `bytes`.
    ///
    /// # Errors
    /// Magic first (so that foreign files are reported as such), then version, checksum, each field.
    pub fn parse(bytes: &[u8], file_len: u64) -> Result<Self, FormatError> {
        let shown = bytes.len().min(MAGIC.len());
        if bytes.is_empty() || bytes[..shown] != MAGIC[..shown] {
            return Err(FormatError::BadMagic);
        }
        let Some(b) = bytes.first_chunk::<HEADER_BYTES>() else {
            return Err(FormatError::Truncated { expected: HEADER_BYTES as u64, got: file_len });
        };
        let major = u16_at(b, AT_MAJOR);
        let (stated, found) = (u32_at(b, AT_HEADER_CRC), crc32c::crc32c(&b[..AT_HEADER_CRC]));
        if stated != found {
            return Err(FormatError::Checksum { of: "the header", stated, found });
        }
        if major != VERSION_MAJOR {
            return Err(FormatError::Said(format!(
                "has format version {major}; this program reads version 1: update infobyte"
            )));
        }
        let code = b[AT_ENCODING];
        if !matches!(code & !PACKED, 0 | CELLS | WITH_LEAVES | WITH_WALLS) {
            return Err(damaged(format_args!("encoding {code} is unknown")));
        }
        let encoding = if code & PACKED == 0 { Encoding::Mapped } else { Encoding::Packed };
        let surface = if code & CELLS == 0 { SurfaceKind::Skin } else { SurfaceKind::Cells };
        let [nx, ny, nz] = [0, 4, 8].map(|at| u32_at(b, AT_DIMS + at));
        let dims = Dims::new(nx, ny, nz).ok_or_else(|| damaged("dims are outside 1..=65536"))?;
        if u32::from(b[AT_DEPTH]) != dims.depth() {
            return Err(damaged("the depth does not belong to the dims"));
        }
        let header = Self {
            minor: u16_at(b, AT_MINOR),
            encoding,
            surface,
            leaves: code & LEAVES != 0,
            walls: code & WALLS != 0,
            sections: u16_at(b, AT_SECTIONS),
            file_bytes: u64_at(b, AT_FILE_BYTES),
            nodes: u64_at(b, AT_NODES),
            voxels: u64_at(b, AT_VOXELS),
            dims,
            table_crc: u32_at(b, AT_TABLE_CRC),
        };
        if u32_at(b, AT_RESERVED) != 0 {
            return Err(damaged("reserved header bytes are not zero"));
        }
        if file_len < header.file_bytes {
            return Err(FormatError::Truncated { expected: header.file_bytes, got: file_len });
        }
        if file_len > header.file_bytes {
            let extra = file_len - header.file_bytes;
            let sentence = format!("has {extra} bytes after its end; copy or build it again");
            return Err(FormatError::Said(sentence));
        }
        if (header.voxels == 0 && !header.leaves) || header.voxels > dims.voxels() {
            return Err(damaged("the number of skin voxels is impossible for the dims"));
        }
        // SPEC I5: every node has a child and every box but the root has one parent.
        // A node without children is a leaf with an item of its own.
        let most =
            if header.leaves { dims.voxels() } else { header.voxels.saturating_mul(u64::from(dims.depth())) };
        if header.nodes > most || (dims.depth() > 0) != (header.nodes > 0) {
            return Err(damaged("the number of nodes is impossible for the skin voxels"));
        }
        Ok(header)
    }
}
