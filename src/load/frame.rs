//! The small parts of a file that say what the large ones are: header, table, metadata, levels.

use crate::format::{
    Channel, Encoding, FormatError, HEADER_BYTES, Header, MAX_SECTIONS, METADATA_LIMIT, Metadata,
    SectionEntry, SectionKind, parse_table, rank,
};
use crate::geom::Dims;

use super::stream::{Fault, ReadAt};

/// Everything that `open` reads and checks (SPEC I1 to I7), for mapped and packed files alike.
///
/// Reading costs at most the header, the table and 1 MiB of metadata, whatever the bytes are.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The header.
    pub header: Header,
    /// The section table.
    pub sections: Vec<SectionEntry>,
    /// The metadata record.
    pub metadata: Metadata,
    /// The metadata's bytes.
    pub metadata_bytes: Vec<u8>,
    /// First node of every depth, then N (SPEC 4.3 `LEVL`).
    pub levels: Vec<u64>,
}

impl Frame {
    /// Reads and checks the frame of a file.
    ///
    /// # Errors
    /// The first rule that is broken, or a failure to read.
    pub fn read<R: ReadAt + ?Sized>(source: &R) -> Result<Self, Fault> {
        let len = source.byte_len()?;
        let mut head = vec![0; usize::try_from(len.min(HEADER_BYTES as u64)).unwrap_or(0)];
        source.read_at(&mut head, 0)?;
        let header = Header::parse(&head, len)?;
        if header.sections > MAX_SECTIONS {
            return Err(FormatError::invalid("the number of sections is outside 1..=64 (SPEC I3)").into());
        }
        let table_end = HEADER_BYTES + usize::from(header.sections) * crate::format::ENTRY_BYTES;
        if len < table_end as u64 {
            return Err(FormatError::Truncated { expected: table_end as u64, got: len }.into());
        }
        head.resize(table_end, 0);
        source.read_at(&mut head[HEADER_BYTES..], HEADER_BYTES as u64)?;
        let sections = parse_table(&header, &head)?;
        check_presence(&header, &sections)?;

        let metadata_bytes = read_small(source, &sections, SectionKind::Meta)?;
        let metadata = Metadata::parse(&metadata_bytes)?;
        if metadata.dims != header.dims.to_array() {
            return Err(FormatError::invalid("metadata and header disagree about the dims (SPEC I6)").into());
        }
        let levels: Vec<u64> = read_small(source, &sections, SectionKind::Levels)?
            .as_chunks::<8>()
            .0
            .iter()
            .map(|b| u64::from_le_bytes(*b))
            .collect();
        check_levels(&header, &levels)?;
        let frame = Self { header, sections, metadata, metadata_bytes, levels };
        frame.check_item_counts()?;
        Ok(frame)
    }

    /// The entry of a section, if the file has it.
    pub fn section(&self, kind: SectionKind) -> Option<&SectionEntry> {
        self.sections.iter().find(|e| e.kind == Some(kind))
    }

    /// The channels that the file has, with the bytes of an item, in file order.
    pub fn channels(&self) -> impl Iterator<Item = (Channel, u8)> {
        self.sections.iter().filter_map(|e| match e.kind {
            Some(SectionKind::Voxels(channel)) => Some((channel, e.item_bytes)),
            _ => None,
        })
    }

    /// Size of the volume.
    pub fn dims(&self) -> Dims {
        self.header.dims
    }

    /// First node of depth L-1: the number of coarse nodes, those with an edge of 4 cells and more.
    pub fn coarse_nodes(&self) -> u64 {
        coarse_nodes(&self.header, &self.levels)
    }

    /// Nodes of depth `d` as a range of breadth-first numbers; empty for depths without nodes.
    pub fn level(&self, depth: u32) -> std::ops::Range<u64> {
        let at = depth as usize;
        match (self.levels.get(at), self.levels.get(at + 1)) {
            (Some(a), Some(b)) => *a..*b,
            _ => 0..0,
        }
    }

    /// SPEC I4: what each section must hold.
    fn check_item_counts(&self) -> Result<(), FormatError> {
        let (n, v) = (self.header.nodes, self.header.voxels);
        for entry in &self.sections {
            let Some(kind) = entry.kind else { continue };
            let (item_ok, items) = match kind {
                // Checked before they were read.
                SectionKind::Meta | SectionKind::Levels => continue,
                SectionKind::Nodes => (entry.item_bytes == 1, n),
                SectionKind::Rank => (entry.item_bytes == 1, rank::directory_bytes(n).1),
                SectionKind::Means(channel) => {
                    let due = self.section(SectionKind::Voxels(channel)).map(|e| e.item_bytes);
                    (Some(entry.item_bytes) == due, self.coarse_nodes())
                }
                SectionKind::Voxels(channel) => (channel.row().item_bytes.contains(&entry.item_bytes), v),
            };
            if !item_ok || entry.items != items {
                return Err(FormatError::invalid(format!(
                    "the {} section has {} items of {} bytes where {items} are due (SPEC I4)",
                    kind.name(),
                    entry.items,
                    entry.item_bytes
                )));
            }
        }
        Ok(())
    }
}

fn coarse_nodes(header: &Header, levels: &[u64]) -> u64 {
    (header.dims.depth() as usize).checked_sub(1).and_then(|at| levels.get(at)).copied().unwrap_or(0)
}

/// SPEC I4: which sections there are, and which codecs they may have.
fn check_presence(header: &Header, sections: &[SectionEntry]) -> Result<(), FormatError> {
    let has = |kind| sections.iter().any(|e| e.kind == Some(kind));
    let packed = header.encoding == Encoding::Packed;
    for kind in [SectionKind::Meta, SectionKind::Levels, SectionKind::Nodes] {
        if !has(kind) {
            return Err(FormatError::invalid(format!("the {} section is missing (SPEC I4)", kind.name())));
        }
    }
    if has(SectionKind::Rank) == packed {
        return Err(FormatError::invalid(
            "the rank section is missing, or present in a packed file (SPEC I4)",
        ));
    }
    let lone_means =
        Channel::all().any(|channel| has(SectionKind::Means(channel)) && !has(SectionKind::Voxels(channel)));
    if lone_means {
        return Err(FormatError::invalid("coarse means are there without the voxels' own (SPEC I4)"));
    }
    for entry in sections {
        let small = matches!(entry.kind, Some(SectionKind::Meta | SectionKind::Levels));
        if entry.codec != 0 && (!packed || small) {
            return Err(FormatError::invalid("a section is coded that must not be (SPEC I4)"));
        }
    }
    Ok(())
}

/// A section that is read whole when a file is opened; its size is checked before anything is allocated.
fn read_small<R: ReadAt + ?Sized>(
    source: &R,
    sections: &[SectionEntry],
    kind: SectionKind,
) -> Result<Vec<u8>, Fault> {
    let entry = sections
        .iter()
        .find(|e| e.kind == Some(kind))
        .ok_or_else(|| FormatError::invalid(format!("the {} section is missing (SPEC I4)", kind.name())))?;
    let item = if kind == SectionKind::Levels { 8 } else { 1 };
    let len = usize::try_from(entry.stored_bytes).unwrap_or(usize::MAX);
    if entry.item_bytes != item || len > METADATA_LIMIT {
        return Err(FormatError::invalid(format!("the {} section is too long (SPEC I4)", kind.name())).into());
    }
    let mut bytes = vec![0; len];
    source.read_at(&mut bytes, entry.offset)?;
    if crc32c::crc32c(&bytes) != entry.stored_crc {
        return Err(FormatError::Checksum { what: kind.name() }.into());
    }
    Ok(bytes)
}

/// SPEC I7: the level table is possible for the volume.
fn check_levels(header: &Header, levels: &[u64]) -> Result<(), FormatError> {
    let depth = header.dims.depth();
    let bad =
        |what: &str| Err(FormatError::invalid(format!("the level table is impossible: {what} (SPEC I7)")));
    if levels.len() as u64 != u64::from(depth) + 1 {
        return bad("it has a wrong number of items");
    }
    if levels.first() != Some(&0) || levels.last() != Some(&header.nodes) {
        return bad("it does not run from 0 to the number of nodes");
    }
    let mut above = 1_u64;
    for d in 0..=depth {
        let at = d as usize;
        let count = if d == depth { Some(header.voxels) } else { levels[at + 1].checked_sub(levels[at]) };
        // Boxes of this depth that touch the volume; at most 2^48.
        let boxes: u64 =
            header.dims.to_array().iter().map(|n| u64::from(n.div_ceil(1 << (depth - d)))).product();
        // Every node has one to eight children; there is one root.
        let most = if d == 0 { 1 } else { above.saturating_mul(8).min(boxes) };
        match count {
            Some(count) if (above..=most).contains(&count) => above = count,
            _ => return bad("a level has more or fewer boxes than it can have"),
        }
    }
    Ok(())
}
