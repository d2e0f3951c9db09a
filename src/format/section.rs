//! The section table (SPEC 3, 4.2, 4.3).

use super::error::{FormatError, damaged};
use super::header::{HEADER_BYTES, Header};
use super::kind::{Channel, SectionKind};
use super::packed::{CODEC_CUBES, CODEC_DERIVED, CODEC_NONE, CODEC_PLANES};

/// Sections start at multiples of this: a cache line.
pub(crate) const SECTION_ALIGN: u64 = 64;
/// Size of a table entry.
pub const ENTRY_BYTES: usize = 48;
/// Most sections a file may have.
pub const MAX_SECTIONS: u16 = 64;

/// The next multiple of `SECTION_ALIGN` at or after `offset` (saturating).
pub const fn align_up(offset: u64) -> u64 {
    match offset.checked_add(SECTION_ALIGN - 1) {
        Some(sum) => sum / SECTION_ALIGN * SECTION_ALIGN,
        None => u64::MAX,
    }
}

impl SectionKind {
    /// Every kind, in file order.
    pub fn all() -> impl Iterator<Item = Self> {
        let means = Channel::all().filter(|c| c.row().means.is_some()).map(Self::Means);
        let voxels = Channel::all().map(Self::Voxels);
        let fixed = [Self::Meta, Self::LabelTable, Self::Quantity, Self::Levels, Self::Nodes, Self::Rank];
        let of_leaves = [Self::CornerRank, Self::LeafNormals, Self::LeafOffsets, Self::LeafRank];
        fixed.into_iter().chain(means).chain(voxels).chain(of_leaves)
    }

    /// True for a section that is read whole when a file is opened.
    pub(crate) fn is_small(self) -> bool {
        matches!(self, Self::Meta | Self::LabelTable | Self::Quantity | Self::Levels)
    }

    /// The channel of the section's items or means.
    pub(crate) fn channel(self) -> Option<Channel> {
        match self {
            Self::Means(channel) | Self::Voxels(channel) => Some(channel),
            _ => None,
        }
    }

    /// True for a section of larger leaves.
    pub(crate) fn is_of_leaves(self) -> bool {
        matches!(self, Self::LeafNormals | Self::LeafOffsets | Self::LeafRank)
    }

    /// Tag of four ASCII bytes.
    pub fn tag(self) -> [u8; 4] {
        match self {
            Self::Meta => *b"META",
            Self::LabelTable => *b"LTAB",
            Self::Quantity => *b"QUAN",
            Self::Levels => *b"LEVL",
            Self::Nodes => *b"NODE",
            Self::Rank => *b"RANK",
            Self::Means(channel) => channel.row().means.as_ref().map_or([0; 4], |means| means.tag),
            Self::Voxels(channel) => channel.row().tag,
            Self::CornerRank => *b"CRNK",
            Self::LeafNormals => *b"LNRM",
            Self::LeafOffsets => *b"LOFS",
            Self::LeafRank => *b"LRNK",
        }
    }

    /// Name for messages and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Meta => "metadata",
            Self::LabelTable => "label_table",
            Self::Quantity => "quantity",
            Self::Levels => "levels",
            Self::Nodes => "nodes",
            Self::Rank => "rank",
            Self::Means(channel) => channel.row().means.as_ref().map_or("", |means| means.name),
            Self::Voxels(channel) => channel.row().name,
            Self::CornerRank => "corner_rank",
            Self::LeafNormals => "leaf_normal",
            Self::LeafOffsets => "leaf_offset",
            Self::LeafRank => "leaf_rank",
        }
    }

    /// Name of its items, for messages.
    pub(crate) fn items_name(self) -> &'static str {
        self.channel().map_or(self.name(), |channel| channel.row().items_name)
    }

    /// The codec of its packed section (SPEC 5.1): fixed, so that the same content gives the same bytes.
    pub(crate) fn codec(self) -> u8 {
        match self {
            Self::Meta | Self::LabelTable | Self::Quantity | Self::Levels | Self::Rank => CODEC_NONE,
            Self::Nodes => CODEC_CUBES,
            Self::Means(_) => CODEC_DERIVED,
            Self::Voxels(channel) => channel.row().codec,
            Self::CornerRank | Self::LeafNormals | Self::LeafOffsets | Self::LeafRank => CODEC_PLANES,
        }
    }

    fn from_tag(tag: [u8; 4]) -> Option<Self> {
        Self::all().find(|k| k.tag() == tag)
    }
}

/// One entry of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SectionEntry {
    /// The kind of section; `None` for a kind of a later minor version.
    pub kind: Option<SectionKind>,
    /// Tag of four ASCII bytes, as found.
    pub tag: [u8; 4],
    /// Codec of the stored bytes (SPEC 5); 0 for plain bytes.
    pub codec: u8,
    /// Bytes per item.
    pub item_bytes: u8,
    /// Offset of the stored bytes.
    pub offset: u64,
    /// Length of the stored bytes.
    pub stored_bytes: u64,
    /// Length after decoding.
    pub content_bytes: u64,
    /// Number of items.
    pub items: u64,
    /// CRC of the stored bytes.
    pub stored_crc: u32,
    /// CRC of the content.
    pub content_crc: u32,
}

impl SectionEntry {
    /// An uncompressed section; its CRC is filled in later.
    pub fn plain(kind: SectionKind, item_bytes: u8, items: u64, offset: u64) -> Self {
        let bytes = items.saturating_mul(u64::from(item_bytes));
        Self {
            kind: Some(kind),
            tag: kind.tag(),
            codec: 0,
            item_bytes,
            offset,
            stored_bytes: bytes,
            content_bytes: bytes,
            items,
            stored_crc: 0,
            content_crc: 0,
        }
    }

    /// Offset past the stored bytes.
    pub fn end(&self) -> u64 {
        self.offset.saturating_add(self.stored_bytes)
    }

    fn to_bytes(self) -> [u8; ENTRY_BYTES] {
        let mut b = [0; ENTRY_BYTES];
        b[0..4].copy_from_slice(&self.tag);
        b[4] = self.codec;
        b[5] = self.item_bytes;
        b[8..16].copy_from_slice(&self.offset.to_le_bytes());
        b[16..24].copy_from_slice(&self.stored_bytes.to_le_bytes());
        b[24..32].copy_from_slice(&self.content_bytes.to_le_bytes());
        b[32..40].copy_from_slice(&self.items.to_le_bytes());
        b[40..44].copy_from_slice(&self.stored_crc.to_le_bytes());
        b[44..48].copy_from_slice(&self.content_crc.to_le_bytes());
        b
    }

    fn parse(b: &[u8; ENTRY_BYTES], section: u16) -> Result<Self, FormatError> {
        let u64_at = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| b[at + i]));
        let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| b[at + i]));
        let tag = [b[0], b[1], b[2], b[3]];
        let reserved = u16::from_le_bytes([b[6], b[7]]);
        if reserved != 0 {
            let fault = "reserved bytes of the section table are not zero";
            return Err(FormatError::Entry { section, fault });
        }
        Ok(Self {
            kind: SectionKind::from_tag(tag),
            tag,
            codec: b[4],
            item_bytes: b[5],
            offset: u64_at(8),
            stored_bytes: u64_at(16),
            content_bytes: u64_at(24),
            items: u64_at(32),
            stored_crc: u32_at(40),
            content_crc: u32_at(44),
        })
    }
}

/// The table's bytes, without padding.
pub fn table_bytes(entries: &[SectionEntry]) -> Vec<u8> {
    entries.iter().flat_map(|e| e.to_bytes()).collect()
}

/// Reads and checks the section table that follows `header` in `bytes` (the file from its start, at
/// least as far as the table's end).
///
/// Checks the table's CRC, that sections tile the file as SPEC 3 states, and that kinds are known, in order and not
/// repeated. The loader checks the content of each section.
///
/// # Errors
/// The first rule that is broken.
pub(crate) fn parse_table(header: &Header, bytes: &[u8]) -> Result<Vec<SectionEntry>, FormatError> {
    if header.sections == 0 || header.sections > MAX_SECTIONS {
        return Err(damaged("the number of sections is outside 1..=64 (SPEC I3)"));
    }
    let len = usize::from(header.sections) * ENTRY_BYTES;
    let Some(table) = bytes.get(HEADER_BYTES..HEADER_BYTES + len) else {
        return Err(FormatError::Truncated {
            expected: (HEADER_BYTES + len) as u64,
            got: bytes.len() as u64,
        });
    };
    let (stated, found) = (header.table_crc, crc32c::crc32c(table));
    if stated != found {
        return Err(FormatError::Checksum { of: "the section table", stated, found });
    }
    let mut entries: Vec<SectionEntry> = Vec::with_capacity(usize::from(header.sections));
    let mut end = (HEADER_BYTES + len) as u64;
    let mut last_kind = None;
    for (section, raw) in (0..).zip(table.as_chunks::<ENTRY_BYTES>().0) {
        let entry = SectionEntry::parse(raw, section)?;
        let wrong = |fault| Err(FormatError::Entry { section, fault });
        let SectionEntry { item_bytes, stored_bytes, content_bytes, items, .. } = entry;
        if entry.offset != align_up(end) {
            return wrong("sections do not follow each other without gaps");
        }
        if items.checked_mul(u64::from(item_bytes)) != Some(content_bytes) {
            return wrong("a section's size is not items times bytes per item");
        }
        if entry.codec == 0 && (stored_bytes != content_bytes || entry.stored_crc != entry.content_crc) {
            return wrong("an uncompressed section differs from its content");
        }
        if entry.kind.is_some() {
            if last_kind >= entry.kind {
                return wrong("sections are repeated or out of order");
            }
            last_kind = entry.kind;
        }
        end = entry.end();
        entries.push(entry);
    }
    if end != header.file_bytes {
        return Err(damaged("the last section does not end where the file ends"));
    }
    Ok(entries)
}
