//! A whole mapped file from a list of voxels, in memory: the slow and simple twin of the builder.
//!
//! Written for clarity, from SPEC.md alone; tests compare faster code with it.

#![allow(dead_code, reason = "unit tests and tests of the whole use their own parts")]

use infobyte::format::{
    Channel, ENTRY_BYTES, Encoding, HEADER_BYTES, Header, Metadata, SectionEntry, SectionKind, Selection,
    SelectionKind, SourceMeta, SurfaceKind, align_up, normal, rank, table_bytes,
};
use infobyte::geom::{Dims, morton};

/// One skin voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AssembledVoxel {
    /// Index (x, y, z).
    pub(crate) cell: [u32; 3],
    /// Normal code (SPEC 4.6); not used in a model without normals.
    pub(crate) normal: u16,
    /// Stored value (SPEC 4.7); not used in a model without values.
    pub(crate) value: u16,
}

/// Which optional sections an assembled file has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct OptionalSections {
    /// `NORM`.
    pub(crate) normal: bool,
    /// `VALU` with this many bytes per item (1 or 2), or none with 0.
    pub(crate) value_bytes: u8,
    /// `NLOD` and `VLOD` of the channels that are there.
    pub(crate) lod: bool,
}

/// Metadata of a unnamed volume of unit spacing, inside from 1 on: all that a file to be compared needs.
pub(crate) fn plain_metadata(dims: [u32; 3], channels: OptionalSections) -> Metadata {
    Metadata {
        program: "example".into(),
        source: SourceMeta::default(),
        dims,
        scalar: 0,
        spacing_mm: [1.0; 3],
        affine: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        rescale: [1.0, 0.0],
        selection: Selection { kind: SelectionKind::Iso, lo: 1.0, hi: f64::INFINITY },
        connectivity: 26,
        gradient: if channels.normal { "gauss5".into() } else { String::new() },
        value_scale: if channels.value_bytes > 0 { [1.0, 0.0] } else { [0.0, 0.0] },
        error: None,
        noise: None,
    }
}

/// Places sections one after the other and writes header, table and padding (SPEC 3).
///
/// Each section comes with its entry, of which kind, codec, item size, items, content size and
/// content CRC must be set; offset, stored size and stored CRC are filled in here.
pub(crate) fn join_sections(
    encoding: Encoding,
    dims: Dims,
    nodes: u64,
    voxels: u64,
    sections: &[(SectionEntry, Vec<u8>)],
) -> Vec<u8> {
    let table_end = (HEADER_BYTES + ENTRY_BYTES * sections.len()) as u64;
    let mut file = vec![0; HEADER_BYTES + ENTRY_BYTES * sections.len()];
    let mut end = table_end;
    let mut entries = Vec::new();
    for (entry, stored) in sections {
        let mut entry = *entry;
        entry.offset = align_up(end);
        entry.stored_bytes = stored.len() as u64;
        entry.stored_crc = crc32c::crc32c(stored);
        file.resize(usize::try_from(entry.offset).unwrap_or(usize::MAX), 0);
        file.extend_from_slice(stored);
        end = entry.end();
        entries.push(entry);
    }
    let table = table_bytes(&entries);
    let header = Header {
        minor: 0,
        encoding,
        surface: SurfaceKind::Skin,
        leaves: false,
        walls: false,
        sections: u16::try_from(sections.len()).unwrap_or(u16::MAX),
        file_bytes: file.len() as u64,
        nodes,
        voxels,
        dims,
        table_crc: crc32c::crc32c(&table),
    };
    file[..HEADER_BYTES].copy_from_slice(&header.to_bytes());
    file[HEADER_BYTES..HEADER_BYTES + table.len()].copy_from_slice(&table);
    file
}

/// Assembles a mapped file of `voxels` (any order, no cell twice); dims come from the metadata.
///
/// # Panics
/// No voxel, a cell twice or outside the dims, impossible dims, or a value that does not fit.
pub(crate) fn assemble(
    metadata: &Metadata,
    voxels: &[AssembledVoxel],
    channels: OptionalSections,
) -> Vec<u8> {
    let [nx, ny, nz] = metadata.dims;
    let dims = Dims::new(nx, ny, nz).expect("possible dims");
    let depth = dims.depth();
    let mut sorted: Vec<(u64, AssembledVoxel)> =
        voxels.iter().map(|v| (morton::encode(v.cell[0], v.cell[1], v.cell[2]), *v)).collect();
    sorted.sort_by_key(|v| v.0);
    assert!(voxels.iter().all(|v| dims.contains(v.cell[0], v.cell[1], v.cell[2])));
    assert!(channels.value_bytes != 1 || voxels.iter().all(|v| v.value < 256));
    assert!(!sorted.is_empty() && sorted.windows(2).all(|w| w[0].0 != w[1].0));

    // A depth's nodes are the distinct prefixes of the voxels' Morton codes.
    let (mut levels, mut nodes) = (vec![0_u64], Vec::new());
    let (mut normal_lod, mut value_lod) = (Vec::new(), Vec::new());
    for d in 0..depth {
        let below = 3 * (depth - d - 1);
        for box_voxels in sorted.chunk_by(|a, b| a.0 >> (below + 3) == b.0 >> (below + 3)) {
            nodes.push(box_voxels.iter().fold(0_u8, |mask, v| mask | 1 << (v.0 >> below & 7)));
            if d + 2 <= depth {
                normal_lod.extend(mean_normal(box_voxels).to_le_bytes());
                let sum: u64 = box_voxels.iter().map(|v| u64::from(v.1.value)).sum();
                let count = box_voxels.len() as u64;
                let mean = ((2 * sum + count) / (2 * count)).to_le_bytes();
                value_lod.extend_from_slice(&mean[..usize::from(channels.value_bytes)]);
            }
        }
        levels.push(nodes.len() as u64);
    }

    let directory = rank::directory(&nodes);
    let n = nodes.len() as u64;
    let mut sections = Vec::new();
    let mut push = |kind, item: u8, bytes: Vec<u8>| {
        let mut entry = SectionEntry::plain(kind, item, bytes.len() as u64 / u64::from(item), 0);
        entry.content_crc = crc32c::crc32c(&bytes);
        sections.push((entry, bytes));
    };
    push(SectionKind::Meta, 1, metadata.to_bytes().unwrap());
    push(SectionKind::Levels, 8, levels.iter().flat_map(|l| l.to_le_bytes()).collect());
    push(SectionKind::Nodes, 1, nodes);
    push(SectionKind::Rank, 1, directory);
    if channels.normal && channels.lod {
        push(SectionKind::Means(Channel::Normal), 2, normal_lod);
    }
    if channels.value_bytes > 0 && channels.lod {
        push(SectionKind::Means(Channel::Value), channels.value_bytes, value_lod);
    }
    if channels.normal {
        push(
            SectionKind::Voxels(Channel::Normal),
            2,
            sorted.iter().flat_map(|v| v.1.normal.to_le_bytes()).collect(),
        );
    }
    if channels.value_bytes > 0 {
        let item = usize::from(channels.value_bytes);
        let values = sorted.iter().flat_map(|v| v.1.value.to_le_bytes().into_iter().take(item)).collect();
        push(SectionKind::Voxels(Channel::Value), channels.value_bytes, values);
    }
    join_sections(Encoding::Mapped, dims, n, sorted.len() as u64, &sections)
}

fn mean_normal(voxels: &[(u64, AssembledVoxel)]) -> u16 {
    let mut sum = [0_i64; 3];
    for (_, v) in voxels {
        for (s, c) in sum.iter_mut().zip(normal::decode_l1(v.normal)) {
            *s += i64::from(c);
        }
    }
    normal::mean(sum, voxels[0].1.normal)
}
