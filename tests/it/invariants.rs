//! Every invariant of SPEC 6 has files that break it, and the reader names the very rule and its place. If
//! this fails, a damaged model is called damaged for a wrong reason, or passes for a sound one.

#![expect(clippy::cast_possible_truncation, reason = "numbers here are small by construction")]

use crate::common as support;
use crate::prelude::*;

use crate::common::assembled::join_sections;
use infobyte::format::SectionEntry;
use infobyte::format::{ErrorBound, Noise, Selection, SelectionKind};
use infobyte::geom::Level;
use infobyte::load::Fault;
use support::shell;

use FormatError as E;

/// Neither normals nor values.
const PLAIN: OptionalSections = OptionalSections { normal: false, value_bytes: 0, lod: false };

const NORMAL: SectionKind = SectionKind::Voxels(Channel::Normal);
const VALUE: SectionKind = SectionKind::Voxels(Channel::Value);
const NORMAL_LOD: SectionKind = SectionKind::Means(Channel::Normal);
const VALUE_LOD: SectionKind = SectionKind::Means(Channel::Value);

fn sound() -> Vec<u8> {
    let file = shell([12, 9, 10], FULL, 5);
    verify(file.as_slice()).unwrap();
    file
}

/// A model of these voxels.
fn model(dims: [u32; 3], channels: OptionalSections, cells: &[[u32; 3]]) -> Vec<u8> {
    let voxels: Vec<_> =
        cells.iter().map(|cell| AssembledVoxel { cell: *cell, normal: 0, value: 0 }).collect();
    assemble(&metadata(dims, channels), &voxels, channels)
}

fn frame(file: &[u8]) -> Frame {
    Frame::read(file).unwrap()
}

fn content(file: &[u8], kind: SectionKind) -> Vec<u8> {
    let frame = frame(file);
    let entry = frame.section(kind).unwrap();
    file[entry.offset as usize..entry.end() as usize].to_vec()
}

/// A model of three labels.
fn labelled() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.oct");
    let volume =
        Voxels::from_fn(Dims::new(20, 16, 12).unwrap(), |[x, y, z]| ((x / 5 + y / 4 + z / 6) % 4) as u8);
    let labels = Some(infobyte::builder::LabelChoice::All);
    infobyte::build(&volume, &BuildOptions { labels, ..skin_options() }, &path).unwrap();
    std::fs::read(&path).unwrap()
}

/// The header with a right checksum after a change of its bytes.
fn with_header(file: &[u8], change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let mut file = file.to_vec();
    change(&mut file[..HEADER_BYTES]);
    let crc = crc32c::crc32c(&file[..HEADER_BYTES - 4]).to_le_bytes();
    file[HEADER_BYTES - 4..HEADER_BYTES].copy_from_slice(&crc);
    file
}

/// The table with right checksums after a change of its bytes.
fn with_table(file: &[u8], change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let mut file = file.to_vec();
    let end = HEADER_BYTES + frame(&file).sections.len() * ENTRY_BYTES;
    change(&mut file[HEADER_BYTES..end]);
    let crc = crc32c::crc32c(&file[HEADER_BYTES..end]).to_le_bytes();
    with_header(&file, |header| header[56..60].copy_from_slice(&crc))
}

/// The same with one entry of the table changed.
fn with_entry(file: &[u8], kind: SectionKind, change: impl FnOnce(&mut SectionEntry)) -> Vec<u8> {
    let mut sections = frame(file).sections;
    change(sections.iter_mut().find(|e| e.kind == Some(kind)).unwrap());
    with_table(file, |table| table.copy_from_slice(&table_bytes(&sections)))
}

/// The file put together anew, with right sizes and checksums, after a change of one section's content.
fn with_content(file: &[u8], kind: SectionKind, change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let frame = frame(file);
    let mut change = Some(change);
    let sections: Vec<_> = frame
        .sections
        .iter()
        .map(|entry| {
            let mut bytes = file[entry.offset as usize..entry.end() as usize].to_vec();
            let mut entry = *entry;
            if entry.kind == Some(kind) {
                change.take().unwrap()(&mut bytes);
            }
            entry.content_bytes = bytes.len() as u64;
            entry.items = entry.content_bytes / u64::from(entry.item_bytes);
            entry.content_crc = crc32c::crc32c(&bytes);
            (entry, bytes)
        })
        .collect();
    let Header { dims, nodes, voxels, surface, leaves, walls, .. } = frame.header;
    let mut file = join_sections(Encoding::Mapped, dims, nodes, voxels, &sections);
    let joined = Header::parse(&file, file.len() as u64).unwrap();
    file[..HEADER_BYTES].copy_from_slice(&Header { surface, leaves, walls, ..joined }.to_bytes());
    file
}

pub(crate) fn with_metadata(file: &[u8], change: impl FnOnce(&mut Metadata)) -> Vec<u8> {
    let mut metadata = frame(file).metadata;
    change(&mut metadata);
    let bytes = metadata.to_bytes().unwrap();
    with_content(file, SectionKind::Meta, |content| *content = bytes)
}

fn fault(file: &[u8]) -> FormatError {
    let found = match verify(file).expect_err("a broken file") {
        Fault::Format(fault) => fault,
        Fault::Io(cause) => panic!("{cause}"),
    };
    // What `open` refuses, it refuses for the same reason.
    if let Err(fault) = Model::from_bytes(file) {
        assert_eq!(fault, found);
    }
    found
}

/// A rule by the number that SPEC 6 gives it.
struct Rule(&'static str);

/// Phrases that SPEC 6 gives for a rule; those after `;` belong to packed files, or to larger leaves.
fn phrases_of(rule: &str) -> BTreeSet<String> {
    let spec = include_str!("../../src/format/SPEC.md");
    let row = spec.lines().find(|line| line.starts_with(&format!("| {rule} |"))).unwrap();
    let cell = row.split('|').nth(3).unwrap().split(';').next().unwrap();
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

impl Rule {
    /// Each file breaks the rule in the way given, and together they show every phrase that SPEC gives for it, one each.
    fn broken_by(&self, cases: Vec<(Vec<u8>, FormatError)>) {
        let (phrases, mut shown) = (phrases_of(self.0), BTreeSet::new());
        for (file, due) in cases {
            assert_eq!(fault(&file), due, "{}", self.0);
            let sentence = due.to_string();
            let found: Vec<_> = phrases.iter().filter(|phrase| sentence.contains(*phrase)).collect();
            assert_eq!(found.len(), 1, "{}: {sentence}: {found:?}", self.0);
            shown.insert(found[0].clone());
        }
        assert_eq!(shown, phrases, "{}", self.0);
    }
}

/// Damage with this middle of its sentence.
fn damaged(fault: &str) -> E {
    E::Said(format!("is damaged: {fault}; copy or build it again"))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

#[test]
fn i1_magic_version_checksum_encoding() {
    let file = sound();
    let mut torn = file.clone();
    torn[24] ^= 1;
    let (stated, found) = (u32_at(&file, 60), crc32c::crc32c(&torn[..60]));
    Rule("I1").broken_by(vec![
        ([&b"%PDF-1.7"[..], &file[8..]].concat(), E::BadMagic),
        (torn, E::Checksum { of: "the header", stated, found }),
        (
            with_header(&file, |h| h[8] = 2),
            E::Said("has format version 2; this program reads version 1: update infobyte".into()),
        ),
        (with_header(&file, |h| h[12] = 8), damaged("encoding 8 is unknown")),
        (with_header(&file, |h| h[12] = 5), damaged("encoding 5 is unknown")),
    ]);
}

#[test]
fn i2_length() {
    let file = sound();
    let len = file.len() as u64;
    Rule("I2").broken_by(vec![
        (file[..file.len() - 5].to_vec(), E::Truncated { expected: len, got: len - 5 }),
        ([&file[..], &[0; 3]].concat(), E::Said("has 3 bytes after its end; copy or build it again".into())),
    ]);
}

#[test]
fn i3_section_table() {
    let file = sound();
    let frame = frame(&file);
    let mut torn = file.clone();
    torn[HEADER_BYTES + 20] ^= 1;
    let end = HEADER_BYTES + frame.sections.len() * ENTRY_BYTES;
    let (stated, found) = (frame.header.table_crc, crc32c::crc32c(&torn[HEADER_BYTES..end]));
    let entry = |section, fault| E::Entry { section, fault };
    let longer = with_header(&[&file[..], &[0; 64]].concat(), |h| {
        h[16..24].copy_from_slice(&(file.len() as u64 + 64).to_le_bytes());
    });
    Rule("I3").broken_by(vec![
        (torn, E::Checksum { of: "the section table", stated, found }),
        (with_header(&file, |h| h[14] = 65), damaged("the number of sections is outside 1..=64 (SPEC I3)")),
        (
            with_entry(&file, SectionKind::Nodes, |e| e.offset += 64),
            entry(2, "sections do not follow each other without gaps"),
        ),
        (
            with_entry(&file, SectionKind::Meta, |e| e.items += 1),
            entry(0, "a section's size is not items times bytes per item"),
        ),
        (
            with_entry(&file, SectionKind::Meta, |e| e.content_crc ^= 1),
            entry(0, "an uncompressed section differs from its content"),
        ),
        (
            with_entry(&file, SectionKind::Rank, |e| e.tag = *b"NODE"),
            entry(3, "sections are repeated or out of order"),
        ),
        (longer, damaged("the last section does not end where the file ends")),
    ]);
}

fn leaves_apart() -> E {
    damaged("encoding and sections disagree about larger leaves (SPEC I4)")
}

fn items_due(kind: SectionKind, bytes: u8, items: u64, due: u64) -> E {
    let section = format!("the {} section has {items} items of {bytes} bytes", kind.name());
    damaged(&format!("{section} where {due} are due (SPEC I4)"))
}

#[test]
fn i4_sections_and_their_items() {
    let file = sound();
    let voxels = frame(&file).header.voxels;
    let unknown = |kind| with_entry(&file, kind, |e| e.tag = *b"ZZZZ");
    let levels = frame(&file).levels.len() as u64;
    let means = damaged("coarse means are there without the voxels' own (SPEC I4)");
    Rule("I4").broken_by(vec![
        (unknown(SectionKind::Meta), E::MissingSection(SectionKind::Meta)),
        (unknown(SectionKind::Nodes), E::MissingSection(SectionKind::Nodes)),
        (unknown(SectionKind::Rank), E::MissingSection(SectionKind::Rank)),
        (
            with_entry(&unknown(VALUE_LOD), VALUE, |e| e.tag = *b"CRNK"),
            damaged("a model of skin voxels has the corner_rank section (SPEC I4)"),
        ),
        (
            with_entry(&unknown(VALUE_LOD), VALUE, |e| e.tag = *b"LNRM"),
            leaves_apart(),
        ),
        (
            with_entry(&labelled(), SectionKind::LabelTable, |e| e.tag = *b"ZZZZ"),
            damaged("the labels of voxels and their table are not both there, or not as the encoding says (SPEC I4)"),
        ),
        (with_header(&file, |h| h[12] = 1), E::MissingSection(SectionKind::Rank)),
        (unknown(NORMAL), means.clone()),
        (unknown(VALUE), means),
        (
            with_entry(&file, NORMAL, |e| e.codec = 4),
            damaged("a section is coded that must not be (SPEC I4)"),
        ),
        (
            with_entry(&file, SectionKind::Levels, |e| (e.item_bytes, e.items) = (4, 2 * levels)),
            damaged("the levels section is too long (SPEC I4)"),
        ),
        (
            with_entry(&file, NORMAL, |e| (e.item_bytes, e.items) = (1, 2 * voxels)),
            items_due(NORMAL, 1, 2 * voxels, voxels),
        ),
    ]);
}

#[test]
fn i5_sizes_of_volume_and_model() {
    let file = sound();
    let header = frame(&file).header;
    let put =
        |at: usize, value: u64| with_header(&file, |h| h[at..at + 8].copy_from_slice(&value.to_le_bytes()));
    let most = header.voxels * 4;
    let voxels = damaged("the number of skin voxels is impossible for the dims");
    let nodes = damaged("the number of nodes is impossible for the skin voxels");
    Rule("I5").broken_by(vec![
        (with_header(&file, |h| h[40..44].fill(0)), damaged("dims are outside 1..=65536")),
        (with_header(&file, |h| h[13] = 5), damaged("the depth does not belong to the dims")),
        (put(32, 0), voxels.clone()),
        (put(32, 12 * 9 * 10 + 1), voxels.clone()),
        (put(24, 0), nodes.clone()),
        (put(24, most + 1), nodes.clone()),
    ]);
    // The limits themselves are possible here, and refused for other reasons.
    assert!(![&voxels, &nodes].contains(&&fault(&put(32, 12 * 9 * 10))));
    assert!(![&voxels, &nodes].contains(&&fault(&put(24, most))));
}

/// The CRC fault of a section whose byte `at` is flipped, and the file.
fn torn_section(file: &[u8], kind: SectionKind) -> (Vec<u8>, FormatError) {
    let entry = *frame(file).section(kind).unwrap();
    let mut torn = file.to_vec();
    torn[entry.offset as usize + 3] ^= 0x40;
    let found = crc32c::crc32c(&torn[entry.offset as usize..entry.end() as usize]);
    (torn, E::Checksum { of: kind.name(), stated: entry.stored_crc, found })
}

#[test]
fn i6_metadata() {
    let file = sound();
    let bytes = content(&file, SectionKind::Meta);
    // The one byte in which the ways to choose a range differ.
    let otsu = with_metadata(&file, |m| m.selection.kind = SelectionKind::Otsu);
    let otsu = content(&otsu, SectionKind::Meta);
    let kind_at = bytes.iter().zip(&otsu).position(|(a, b)| a != b).unwrap();
    let geometry = |m: &mut Metadata| m.spacing_mm[1] = 0.0;
    let bound = ErrorBound { bound: 0.1, rms: 0.02, p99: 0.05, most: 0.1 };
    let codes = damaged("metadata names an unknown sample type or connectivity");
    Rule("I6").broken_by(vec![
        torn_section(&file, SectionKind::Meta),
        (with_content(&file, SectionKind::Meta, |b| b[..8].fill(0xff)), damaged("metadata cannot be read")),
        (
            with_content(&file, SectionKind::Meta, |b| b.extend([0; 7])),
            damaged("metadata has bytes left over"),
        ),
        (with_content(&file, SectionKind::Meta, |b| b[kind_at] = 9), damaged("selection kind 9 is unknown")),
        (with_metadata(&file, |m| m.scalar = 8), codes.clone()),
        (with_metadata(&file, |m| m.connectivity = 18), codes),
        (with_metadata(&file, geometry), damaged("metadata has a geometry that is not finite and positive")),
        (
            with_metadata(&file, |m| {
                m.noise = Some(Noise { correlation: [0.0, 1.0, 0.0], ..Noise::default() })
            }),
            damaged("metadata states noise that cannot be"),
        ),
        (with_metadata(&file, |m| m.error = Some(bound)), leaves_apart()),
        (
            with_metadata(&file, |m| m.dims = [12, 9, 11]),
            damaged("metadata and header disagree about the dims (SPEC I6)"),
        ),
    ]);
}

#[test]
fn i7_levels() {
    let file = sound();
    let levels = frame(&file).levels;
    let put = |at: usize, value: u64| {
        with_content(&file, SectionKind::Levels, |b| {
            b[8 * at..8 * at + 8].copy_from_slice(&value.to_le_bytes())
        })
    };
    let nodes = levels[4];
    let impossible = |fault| damaged(&format!("the level table is impossible: {fault} (SPEC I7)"));
    let ends = impossible("it does not run from 0 to the number of nodes");
    Rule("I7").broken_by(vec![
        torn_section(&file, SectionKind::Levels),
        (
            with_content(&file, SectionKind::Levels, |b| b.truncate(32)),
            impossible("it has a wrong number of items"),
        ),
        (put(0, 1), ends.clone()),
        (put(4, nodes + 1), ends),
        (put(1, 2), E::LevelBoxes { level: Level::new(0), boxes: Some(2) }),
        (put(2, 0), E::LevelBoxes { level: Level::new(1), boxes: None }),
        (put(2, 10), E::LevelBoxes { level: Level::new(1), boxes: Some(9) }),
    ]);
}

#[test]
fn i8_checksums_of_sections() {
    let file = sound();
    let kinds = [SectionKind::Nodes, SectionKind::Rank, NORMAL, VALUE];
    Rule("I8").broken_by(kinds.map(|kind| torn_section(&file, kind)).to_vec());
}

#[test]
fn i9_reserved_bytes_and_padding() {
    let file = sound();
    let gap = frame(&file).sections[0].end();
    let mut padded = file.clone();
    padded[gap as usize + 1] = 1;
    Rule("I9").broken_by(vec![
        (with_header(&file, |h| h[53] = 2), damaged("reserved header bytes are not zero")),
        (
            with_table(&file, |t| t[2 * ENTRY_BYTES + 6] = 3),
            E::Entry { section: 2, fault: "reserved bytes of the section table are not zero" },
        ),
        (padded, E::PaddingNotZero { offset: gap + 1 }),
    ]);
}

#[test]
fn i10_to_i12_the_walk() {
    // Two nodes, the root 10 and its child 01; the rank directory cannot see what changes.
    let one = model([3, 1, 1], PLAIN, &[[2, 0, 0]]);
    let two = model([3, 1, 1], PLAIN, &[[0, 0, 0], [2, 0, 0]]);
    let pair = model([2, 1, 1], NORMALS, &[[0, 0, 0]]);
    let nodes =
        |file: &[u8], at: usize, infobyte: u8| with_content(file, SectionKind::Nodes, |b| b[at] = infobyte);
    Rule("I10").broken_by(vec![(
        nodes(&one, 1, 0),
        E::EmptyNode { level: Level::new(1), node: NodeIndex::new(1), corner: [2, 0, 0] },
    )]);
    Rule("I11").broken_by(vec![
        (nodes(&one, 0, 0b11), E::MissingNode { level: Level::new(1), corner: [2, 0, 0] }),
        (nodes(&two, 0, 0b01), E::SurplusBoxes { level: Level::new(1), stated: 2, found: 1 }),
        (nodes(&pair, 0, 0b11), E::MissingItem { kind: NORMAL }),
    ]);
    let outside = |corner| E::OutsideVolume { level: Level::new(2), corner };
    Rule("I12").broken_by(vec![
        (nodes(&one, 1, 0b10), outside([3, 0, 0])),
        (nodes(&one, 1, 0b100), outside([2, 1, 0])),
        (nodes(&one, 0, 0b10_0000), E::OutsideVolume { level: Level::new(1), corner: [2, 0, 2] }),
    ]);
}

#[test]
fn i13_rank_directory() {
    let file = sound();
    let directory = content(&file, SectionKind::Rank);
    let block = u64::from(directory[10]) | u64::from(directory[11]) << 8;
    Rule("I13").broken_by(vec![
        (
            with_content(&file, SectionKind::Rank, |b| b[0] = 1),
            E::RankMismatch { node: NodeIndex::new(0), due: 0, found: 1 },
        ),
        (
            with_content(&file, SectionKind::Rank, |b| b[10] ^= 1),
            E::RankMismatch { node: NodeIndex::new(32), due: block, found: block ^ 1 },
        ),
    ]);
}

#[test]
fn i14_to_i16_channels() {
    let file = sound();
    let normals = content(&file, NORMAL);
    let item = u16::from_le_bytes([0x80, normals[5]]).into();
    Rule("I14").broken_by(vec![(
        with_content(&file, NORMAL, |b| b[4] = 0x80),
        E::IllegalItem { channel: Channel::Normal, voxel: VoxelIndex::new(2), item },
    )]);
    let item =
        |kind, at: usize| u16::from_le_bytes(content(&file, kind)[2 * at..2 * at + 2].try_into().unwrap());
    let due = item(NORMAL_LOD, 1);
    Rule("I15").broken_by(vec![(
        with_content(&file, NORMAL_LOD, |b| b[2] ^= 1),
        E::MeanNormal {
            channel: Channel::Normal,
            level: Level::new(1),
            node: NodeIndex::new(1),
            due,
            found: Some(due ^ 1),
        },
    )]);
    let due = u64::from(item(VALUE_LOD, 1));
    Rule("I16").broken_by(vec![(
        with_content(&file, VALUE_LOD, |b| b[2] ^= 1),
        E::MeanValue {
            channel: Channel::Value,
            level: Level::new(1),
            node: NodeIndex::new(1),
            due,
            found: due ^ 1,
        },
    )]);
    // A changed voxel shows in the means above it.
    let rule = |kind, change: fn(&mut Vec<u8>)| fault(&with_content(&file, kind, change));
    assert!(matches!(rule(NORMAL, |b| b[4] ^= 0x40), E::MeanNormal { .. }));
    assert!(matches!(rule(VALUE, |b| b[1] ^= 0x80), E::MeanValue { .. }));
}

#[test]
fn i17_metadata_and_sections_agree() {
    let (full, plain) = (sound(), model([3, 1, 1], PLAIN, &[[2, 0, 0]]));
    let impossible = damaged("metadata has an impossible range of values (SPEC I17)");
    let disagree = |of| damaged(&format!("metadata and sections disagree about {of} (SPEC I17)"));
    let range = |kind, lo, hi| {
        (with_metadata(&full, |m| m.selection = Selection { kind, lo, hi }), impossible.clone())
    };
    Rule("I17").broken_by(vec![
        (with_metadata(&full, |m| m.gradient.clear()), disagree("normals")),
        (with_metadata(&plain, |m| m.gradient = "sobel".into()), disagree("normals")),
        (with_metadata(&full, |m| m.value_scale = [0.0; 2]), disagree("values")),
        (with_metadata(&plain, |m| m.value_scale = [1.0, 0.0]), disagree("values")),
        range(SelectionKind::Range, 2.0, 1.0),
        range(SelectionKind::Iso, 2.0, 3.0),
    ]);
    let nan = with_metadata(&full, |m| m.selection.lo = f64::NAN);
    assert_eq!(fault(&nan), impossible);
}

#[test]
fn i20_and_i21_labels() {
    let (file, table) = (labelled(), SectionKind::LabelTable);
    let blocks = SectionKind::Voxels(Channel::Label);
    verify(file.as_slice()).unwrap();
    assert_eq!(verify(with_content(&file, table, |_| {}).as_slice()).unwrap().labels, frame(&file).labels);
    let wrong = damaged("the table of labels cannot be read, or is impossible (SPEC I20)");
    Rule("I20").broken_by(vec![
        (with_content(&file, table, |t| t.truncate(t.len() - 1)), wrong.clone()),
        (with_content(&file, table, |t| t[8] = 0), wrong),
    ]);
    let voxels = frame(&file).header.voxels;
    assert!(voxels > 512);
    let of_first = E::LabelBlocks { first: 0, last: 511 };
    let directory = 16 * voxels.div_ceil(512) as usize;
    Rule("I21").broken_by(vec![
        (with_content(&file, blocks, |b| b[0] += 1), of_first.clone()),
        (with_content(&file, blocks, |b| b[8] = 17), of_first.clone()),
        (with_content(&file, blocks, |b| b[directory] = 9), of_first),
        (with_content(&file, blocks, |b| b.push(0)), E::LabelBlocks { first: voxels, last: voxels }),
    ]);
}

#[test]
fn i23_quantity() {
    let file = sound();
    let frame = frame(&file);
    let mut record = vec![0, 1, 0, 0, 0, 0, 0, 0];
    record.extend([-1.0_f64, 1.0, -0.5, 0.5].iter().flat_map(|n| n.to_le_bytes()));
    for text in ["deviation", "mm", ""] {
        record.extend((text.len() as u64).to_le_bytes());
        record.extend(text.as_bytes());
    }
    let sections = |value_bytes: u8| {
        let content = |e: &SectionEntry| (*e, file[e.offset as usize..e.end() as usize].to_vec());
        let mut all: Vec<_> =
            frame.sections.iter().filter(|e| e.kind != Some(VALUE_LOD)).map(content).collect();
        let crc = crc32c::crc32c(&record);
        let entry = SectionEntry::plain(SectionKind::Quantity, 1, record.len() as u64, 0);
        all.insert(1, (SectionEntry { stored_crc: crc, content_crc: crc, ..entry }, record.clone()));
        for (entry, bytes) in all.iter_mut().filter(|(entry, _)| entry.kind == Some(VALUE)) {
            *bytes = vec![1; usize::from(value_bytes) * frame.header.voxels as usize];
            *entry = SectionEntry::plain(VALUE, value_bytes, frame.header.voxels, 0);
            (entry.stored_crc, entry.content_crc) = (crc32c::crc32c(bytes), crc32c::crc32c(bytes));
        }
        let Header { dims, nodes, voxels, .. } = frame.header;
        join_sections(Encoding::Mapped, dims, nodes, voxels, &all)
    };
    let sound = sections(2);
    assert_eq!(verify(sound.as_slice()).unwrap().quantity.unwrap().tolerance, Some([-0.5, 0.5]));
    let quantity = SectionKind::Quantity;
    let wrong = damaged("the quantity of the values cannot be read, or is impossible (SPEC I23)");
    Rule("I23").broken_by(vec![
        torn_section(&sound, quantity),
        (with_content(&sound, quantity, |b| b[0] = 2), wrong.clone()),
        (with_content(&sound, quantity, |b| b.push(0)), wrong),
    ]);
    let items = frame.header.voxels;
    assert_eq!(fault(&sections(1)), items_due(VALUE, 1, items, items));
    assert_eq!(fault(&with_entry(&sound, VALUE, |e| e.tag = *b"ZZZZ")), E::MissingSection(VALUE));
}
