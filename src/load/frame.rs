//! The small parts of a file that describe the large ones: header, table, metadata, levels.

use crate::format::{
    Channel, ENTRY_BYTES, Encoding, FormatError, HEADER_BYTES, Header, Label, LabelForm, MAX_SECTIONS,
    METADATA_LIMIT, Metadata, Quantity, SectionEntry, SectionKind, SurfaceKind, WALL_BYTES, align_up, cell,
    damaged, label_directory_bytes, parse_labels, parse_table, rank,
};
use crate::geom::{Affine, Dims, Level};

use super::stream::{Fault, ReadAt};

/// The parts that `open` reads and checks (SPEC I1 to I7), for mapped and packed files alike.
///
/// Reading costs at most the header, the table and 1 MiB of metadata, for any bytes.
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
    /// The labels, by number (SPEC 4.10); empty for a model without labels.
    pub labels: Vec<Label>,
    /// The measured quantity of the values (SPEC 4.13); `None` for a model without one.
    pub quantity: Option<Quantity>,
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
            return Err(damaged("the number of sections is outside 1..=64 (SPEC I3)").into());
        }
        let table_end = HEADER_BYTES + usize::from(header.sections) * ENTRY_BYTES;
        if len < table_end as u64 {
            return Err(FormatError::Truncated { expected: table_end as u64, got: len }.into());
        }
        head.resize(table_end, 0);
        source.read_at(&mut head[HEADER_BYTES..], HEADER_BYTES as u64)?;
        let sections = parse_table(&header, &head)?;
        check_presence(&header, &sections)?;

        let metadata_bytes = read_small(source, &sections, SectionKind::Meta)?;
        let metadata = Metadata::parse(&metadata_bytes)?;
        if metadata.error.is_some_and(|error| error.is_sound()) != header.leaves
            || metadata.error.is_some() != header.leaves
        {
            return Err(leaves_apart().into());
        }
        if metadata.dims.map(|n| n.saturating_add(header.surface.grown())) != header.dims.to_array() {
            return Err(damaged("metadata and header disagree about the dims (SPEC I6)").into());
        }
        let levels: Vec<u64> = read_small(source, &sections, SectionKind::Levels)?
            .as_chunks::<8>()
            .0
            .iter()
            .map(|b| u64::from_le_bytes(*b))
            .collect();
        check_levels(&header, &levels)?;
        let labels = if header.walls {
            let bytes = read_small(source, &sections, SectionKind::LabelTable)?;
            // The volume has fewer voxels than there are cells.
            let [nx, ny, nz] = metadata.dims.map(u64::from);
            parse_labels(&bytes, nx * ny * nz)?
        } else {
            Vec::new()
        };
        let has_quantity = sections.iter().any(|e| e.kind == Some(SectionKind::Quantity));
        let quantity = match has_quantity {
            true => Some(Quantity::parse(&read_small(source, &sections, SectionKind::Quantity)?)?),
            false => None,
        };
        let frame = Self { header, sections, metadata, metadata_bytes, levels, labels, quantity };
        frame.check_item_counts()?;
        Ok(frame)
    }

    /// The entry of a section, if the file has it.
    pub fn section(&self, kind: SectionKind) -> Option<&SectionEntry> {
        self.sections.iter().find(|e| e.kind == Some(kind))
    }

    /// Form of the label entries.
    pub(crate) fn label_form(&self) -> LabelForm {
        LabelForm::of(self.labels.len())
    }

    /// The channels of the file, with the bytes of an item, in file order.
    pub fn channels(&self) -> impl Iterator<Item = (Channel, u8)> {
        self.sections.iter().filter_map(|e| match e.kind {
            Some(SectionKind::Voxels(channel)) => Some((channel, e.item_bytes)),
            _ => None,
        })
    }

    /// The kind of the boxes of the finest level.
    pub fn surface(&self) -> SurfaceKind {
        self.header.surface
    }

    /// Size of the grid's occupied part in boxes of the finest level: the volume in voxels, or in cells, one more along
    /// each axis.
    pub fn dims(&self) -> Dims {
        self.header.dims
    }

    /// Index of a box of the finest level (its middle at integers) to LPS mm: the volume's affine, shifted by half a
    /// voxel for cells.
    pub fn affine(&self) -> Affine {
        let volume = Affine { rows: self.metadata.affine };
        match self.surface() {
            SurfaceKind::Skin => volume,
            SurfaceKind::Cells => volume.starting_at([-0.5; 3]),
        }
    }

    /// First node of depth L-1: the number of coarse nodes, those with an edge of 4 cells and more.
    pub(crate) fn coarse_nodes(&self) -> u64 {
        coarse_nodes(&self.header, &self.levels)
    }

    /// Nodes of a level as a range of breadth-first numbers; empty for depths without nodes.
    pub fn level(&self, level: Level) -> std::ops::Range<u64> {
        let at = level.index();
        match (self.levels.get(at), self.levels.get(at + 1)) {
            (Some(a), Some(b)) => *a..*b,
            _ => 0..0,
        }
    }

    /// Sets each section's number of items and offset, where counts are known; tables and coded sections keep their
    /// items.
    pub(crate) fn place_sections(&mut self) {
        let (voxels, nodes, coarse) = (self.header.voxels, self.header.nodes, self.coarse_nodes());
        let mut end = (HEADER_BYTES + self.sections.len() * ENTRY_BYTES) as u64;
        for entry in &mut self.sections {
            let items = match entry.kind {
                Some(SectionKind::Meta) => self.metadata_bytes.len() as u64,
                Some(SectionKind::Levels) => self.levels.len() as u64,
                Some(SectionKind::Nodes) => nodes,
                Some(SectionKind::Rank) => rank::directory_bytes(nodes).1,
                Some(SectionKind::Means(_)) => coarse,
                Some(SectionKind::Voxels(channel)) if !channel.row().is_sparse && !channel.row().is_coded => {
                    voxels
                }
                _ => entry.items,
            };
            *entry = match entry.kind {
                Some(kind) => SectionEntry::plain(kind, entry.item_bytes, items, align_up(end)),
                None => SectionEntry { offset: align_up(end), ..*entry },
            };
            end = entry.end();
        }
        self.header.file_bytes = end;
    }

    pub(super) fn refuse_packed(&self) -> Result<(), FormatError> {
        match self.header.encoding {
            Encoding::Mapped => Ok(()),
            Encoding::Packed => Err(FormatError::Packed),
        }
    }

    /// SPEC I4: the required content of each section.
    fn check_item_counts(&self) -> Result<(), FormatError> {
        let (n, v) = (self.header.nodes, self.header.voxels);
        #[expect(clippy::cast_possible_truncation, reason = "8 or 20")]
        let corner_bytes = if self.header.walls { WALL_BYTES } else { cell::CORNERS } as u8;
        for entry in &self.sections {
            let Some(kind) = entry.kind else { continue };
            let (item_ok, items) = match kind {
                // Checked before they were read.
                SectionKind::Meta | SectionKind::LabelTable | SectionKind::Quantity | SectionKind::Levels => {
                    continue;
                }
                SectionKind::Nodes => (entry.item_bytes == 1, n),
                SectionKind::Rank => (entry.item_bytes == 1, rank::directory_bytes(n).1),
                SectionKind::Means(channel) => {
                    let due = self.section(SectionKind::Voxels(channel)).map(|e| e.item_bytes);
                    // Illegal items of the voxels are reported below.
                    let illegal = due.is_some_and(|due| !channel.row().item_bytes.contains(&due));
                    (Some(entry.item_bytes) == due || illegal, self.coarse_nodes())
                }
                SectionKind::Voxels(channel) => {
                    // The number of items of a sparse channel is known once all offsets are read (SPEC I18).
                    let items = match channel.row() {
                        row if row.is_sparse => entry.items.min(v),
                        // The bytes of blocks are known once all are read (SPEC I21).
                        row if row.is_coded => {
                            entry.items.clamp(label_directory_bytes(v), self.label_form().most_bytes(v))
                        }
                        _ => v,
                    };
                    let is_due = match channel {
                        Channel::Corners => entry.item_bytes == corner_bytes,
                        Channel::Value => entry.item_bytes == 2 || self.quantity.is_none(),
                        _ => true,
                    };
                    (is_due && channel.row().item_bytes.contains(&entry.item_bytes), items)
                }
                SectionKind::CornerRank => (entry.item_bytes == 8, cell::corner_blocks(v)),
                // The number of leaves is known once all infobytes are read (SPEC I19).
                SectionKind::LeafNormals => (entry.item_bytes == 2, entry.items.min(n)),
                SectionKind::LeafOffsets => {
                    let normals = self.section(SectionKind::LeafNormals).map_or(0, |e| e.items);
                    (entry.item_bytes == 1, normals)
                }
                SectionKind::LeafRank => (entry.item_bytes == 8, cell::leaf_blocks(n)),
            };
            if !item_ok || entry.items != items {
                let (name, item_bytes, stated) = (kind.name(), entry.item_bytes, entry.items);
                return Err(damaged(format_args!(
                    "the {name} section has {stated} items of {item_bytes} bytes where {items} are due (SPEC I4)"
                )));
            }
        }
        Ok(())
    }
}

fn coarse_nodes(header: &Header, levels: &[u64]) -> u64 {
    (header.dims.depth() as usize).checked_sub(1).and_then(|at| levels.get(at)).copied().unwrap_or(0)
}

/// SPEC I4: the required and allowed sections, and their codecs.
fn check_presence(header: &Header, sections: &[SectionEntry]) -> Result<(), FormatError> {
    let has = |kind| sections.iter().any(|e| e.kind == Some(kind));
    let packed = header.encoding == Encoding::Packed;
    for kind in [SectionKind::Meta, SectionKind::Levels, SectionKind::Nodes] {
        if !has(kind) {
            return Err(FormatError::MissingSection(kind));
        }
    }
    match (has(SectionKind::Rank), packed) {
        (false, false) => return Err(FormatError::MissingSection(SectionKind::Rank)),
        (true, true) => return Err(FormatError::MissingSection(SectionKind::Rank)),
        _ => {}
    }
    for channel in Channel::all() {
        if has(SectionKind::Means(channel)) && !has(SectionKind::Voxels(channel)) {
            return Err(damaged("coarse means are there without the voxels' own (SPEC I4)"));
        }
    }
    let cells = header.surface == SurfaceKind::Cells;
    for kind in [
        SectionKind::Voxels(Channel::Normal),
        SectionKind::Voxels(Channel::Offset),
        SectionKind::Voxels(Channel::Corners),
        SectionKind::CornerRank,
    ] {
        let of_cells = matches!(kind, SectionKind::CornerRank | SectionKind::Voxels(Channel::Corners));
        match (cells, has(kind)) {
            (true, false) => return Err(FormatError::MissingSection(kind)),
            (false, true) if of_cells => {
                let name = kind.name();
                return Err(damaged(format_args!("a model of skin voxels has the {name} section (SPEC I4)")));
            }
            _ => {}
        }
    }
    let value = SectionKind::Voxels(Channel::Value);
    if has(SectionKind::Quantity) && !has(value) {
        return Err(FormatError::MissingSection(value));
    }
    for kind in [SectionKind::LabelTable, SectionKind::Voxels(Channel::Label)] {
        if has(kind) != header.walls {
            return Err(damaged(
                "the labels of voxels and their table are not both there, or not as the encoding says (SPEC I4)",
            ));
        }
    }
    for kind in [SectionKind::LeafNormals, SectionKind::LeafOffsets, SectionKind::LeafRank] {
        if has(kind) != header.leaves {
            return Err(leaves_apart());
        }
    }
    for entry in sections {
        let small = entry.kind.is_some_and(SectionKind::is_small);
        if entry.codec != 0 && (!packed || small) {
            return Err(damaged("a section is coded that must not be (SPEC I4)"));
        }
    }
    Ok(())
}

fn leaves_apart() -> FormatError {
    damaged("encoding and sections disagree about larger leaves (SPEC I4)")
}

/// SPEC I8: the stored bytes of a section have the CRC that the table states.
pub(super) fn check_crc(entry: &SectionEntry, found: u32) -> Result<(), FormatError> {
    let (of, stated) = (entry.kind.map_or("a section of unknown kind", SectionKind::name), entry.stored_crc);
    if stated == found { Ok(()) } else { Err(FormatError::Checksum { of, stated, found }) }
}

/// Reads a section whole when a file is opened; its size is checked before anything is allocated.
fn read_small<R: ReadAt + ?Sized>(
    source: &R,
    sections: &[SectionEntry],
    kind: SectionKind,
) -> Result<Vec<u8>, Fault> {
    let entry = sections.iter().find(|e| e.kind == Some(kind)).ok_or(FormatError::MissingSection(kind))?;
    let item = if kind == SectionKind::Levels { 8 } else { 1 };
    let len = usize::try_from(entry.stored_bytes).unwrap_or(usize::MAX);
    if entry.item_bytes != item || len > METADATA_LIMIT {
        return Err(damaged(format_args!("the {} section is too long (SPEC I4)", kind.name())).into());
    }
    let mut bytes = vec![0; len];
    source.read_at(&mut bytes, entry.offset)?;
    check_crc(entry, crc32c::crc32c(&bytes))?;
    Ok(bytes)
}

/// SPEC I7: the level table is possible for the volume.
fn check_levels(header: &Header, levels: &[u64]) -> Result<(), FormatError> {
    let depth = header.dims.depth();
    let impossible = |fault| damaged(format_args!("the level table is impossible: {fault} (SPEC I7)"));
    if levels.len() != depth as usize + 1 {
        return Err(impossible("it has a wrong number of items"));
    }
    if (levels.first(), levels.last()) != (Some(&0), Some(&header.nodes)) {
        return Err(impossible("it does not run from 0 to the number of nodes"));
    }
    let mut above = 1_u64;
    for d in 0..=depth {
        let at = d as usize;
        let count = if d == depth { Some(header.voxels) } else { levels[at + 1].checked_sub(levels[at]) };
        // Number of boxes of this depth that touch the volume; at most 2^48.
        let boxes: u64 =
            header.dims.to_array().iter().map(|n| u64::from(n.div_ceil(1 << (depth - d)))).product();
        // Every node has one to eight children; there is one root.
        let most = if d == 0 { 1 } else { above.saturating_mul(8).min(boxes) };
        // Boxes above may be larger leaves, which have no children.
        let least = if header.leaves && d > cell::first_leaf_depth(depth) { 0 } else { above };
        match count {
            Some(count) if (least..=most).contains(&count) => above = count,
            boxes => return Err(FormatError::LevelBoxes { level: Level::new(d), boxes }),
        }
    }
    Ok(())
}
