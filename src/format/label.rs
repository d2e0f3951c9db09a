//! The labels of a model: their table (SPEC 4.10), and the labels of each cell, in blocks with palettes (SPEC 4.11, 4.12).

use super::error::{FormatError, damaged};
use super::metadata::METADATA_LIMIT;

/// Most labels of one model.
pub(crate) const MAX_LABELS: usize = 1 << 14;
/// Cells of a block, which has its own palette, and blocks of a group, which has an entry in the directory.
const BLOCK: usize = 64;
const BLOCKS: usize = 8;
/// Cells of a group.
pub(crate) const GROUP: usize = BLOCK * BLOCKS;
/// Bytes of an entry of the directory: offset of the group, and size of each block's palette.
pub(crate) const ENTRY: usize = 16;
/// Labels of the largest palette; blocks with more labels store them directly.
const LARGEST: usize = 16;
/// Bytes of a record of the table, without its name.
const RECORD: usize = 2 + 4 + 8 + 8;

/// One label of a model.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Label {
    /// Number in the volume: 1 to 65,535.
    pub number: u16,
    /// Name; may be empty.
    pub name: String,
    /// Colour (sRGB).
    pub color: [u8; 3],
    /// Voxels of the volume with this label, those inside included.
    pub voxels: u64,
}

/// Entry of a table of label names.
#[derive(Clone, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelName {
    /// Number in the volume.
    pub number: u16,
    /// Name; may be empty.
    pub name: String,
    /// Colour (sRGB), if the table has one.
    #[serde(default)]
    pub color: Option<[u8; 3]>,
}

impl Label {
    /// The default colour of a label: 120 colours far from each other, also to dichromats (CIEDE2000 of the first 10 /
    /// 20 / 40 / 120: at least 23 / 14 / 9.7 / 5.3; to them 16 / 9.6 / 6.3 / 3.5).
    pub fn default_color(number: u16) -> [u8; 3] {
        let [_, r, g, b] = PALETTE[(usize::from(number).wrapping_sub(1)) % PALETTE.len()].to_be_bytes();
        [r, g, b]
    }
}

/// Chosen farthest first by the least CIEDE2000 of normal sight (over 1.5) and of protan, deutan and tritan sight by
/// Machado's matrices, among 5,328 colours with a lightness of 22 to 94 and some chroma.
#[rustfmt::skip]
const PALETTE: [u32; 120] = [
    0x00e1_3c2d, 0x0000_e1ff, 0x0000_4b69, 0x00ff_f000, 0x00c3_1eff, 0x004b_2d2d, 0x004b_9678, 0x0087_87a5,
    0x00d2_f0d2, 0x00e1_b478, 0x004b_00d2, 0x003c_3c00, 0x0096_4b5a, 0x0078_a5ff, 0x0087_5a96, 0x00ff_8700,
    0x00e1_c3d2, 0x004b_7878, 0x0096_b4a5, 0x00e1_f096, 0x0069_0f4b, 0x00ff_5ad2, 0x00b4_002d, 0x0069_874b,
    0x0000_2d87, 0x0087_d2a5, 0x000f_5ac3, 0x00c3_f0ff, 0x001e_c33c, 0x0096_a578, 0x00f0_96d2, 0x00d2_5a96,
    0x005a_5a3c, 0x0078_781e, 0x005a_5a78, 0x002d_5a00, 0x002d_695a, 0x00f0_d25a, 0x00c3_96b4, 0x0000_78b4,
    0x0096_004b, 0x0096_964b, 0x005a_96c3, 0x0096_1e96, 0x0096_00f0, 0x0078_694b, 0x00b4_6969, 0x003c_c3f0,
    0x00b4_8787, 0x0087_87ff, 0x00f0_e1b4, 0x0069_3c4b, 0x0078_002d, 0x00a5_5a78, 0x001e_b4b4, 0x00b4_d2c3,
    0x00d2_0f96, 0x00c3_d296, 0x00f0_690f, 0x0096_69d2, 0x0096_fff0, 0x00ff_a55a, 0x00a5_e1e1, 0x00f0_3c69,
    0x0096_c3e1, 0x00ff_7896, 0x00a5_7887, 0x0096_0069, 0x0069_a596, 0x0087_5a69, 0x0078_00a5, 0x00c3_4b00,
    0x00d2_8769, 0x00b4_b487, 0x000f_875a, 0x005a_3c1e, 0x0000_87b4, 0x00b4_87e1, 0x00ff_00c3, 0x0000_4b3c,
    0x0096_e100, 0x00c3_ff78, 0x00ff_c3b4, 0x005a_0f69, 0x0096_6987, 0x001e_3cb4, 0x00d2_d278, 0x004b_69ff,
    0x0069_5a2d, 0x0069_3c78, 0x00e1_a5c3, 0x00b4_3c69, 0x00c3_000f, 0x0069_783c, 0x00b4_9687, 0x00c3_a569,
    0x005a_8769, 0x0087_b496, 0x0078_5a4b, 0x00d2_783c, 0x00b4_00d2, 0x003c_3c5a, 0x0078_2d3c, 0x001e_00b4,
    0x0069_4b5a, 0x002d_6987, 0x005a_d22d, 0x005a_4b2d, 0x0087_3cb4, 0x0096_4b87, 0x0096_ffc3, 0x00e1_2de1,
    0x00a5_d2e1, 0x00e1_c3ff, 0x00d2_87a5, 0x00b4_e1c3, 0x0096_7896, 0x0078_00e1, 0x003c_962d, 0x00c3_7878,
];

/// Bytes of the section of the table.
///
/// # Errors
/// The section would be longer than 1 MiB.
pub(crate) fn table_to_bytes(labels: &[Label]) -> Result<Vec<u8>, FormatError> {
    let mut bytes = (labels.len() as u64).to_le_bytes().to_vec();
    for label in labels {
        bytes.extend(label.number.to_le_bytes());
        bytes.extend(label.color);
        bytes.push(0);
        bytes.extend(label.voxels.to_le_bytes());
        bytes.extend((label.name.len() as u64).to_le_bytes());
        bytes.extend(label.name.as_bytes());
    }
    if bytes.len() > METADATA_LIMIT {
        return Err(FormatError::Said(format!(
            "the table of its labels would take {} bytes, and 1 MiB is all that there is; shorten their names",
            bytes.len()
        )));
    }
    Ok(bytes)
}

/// Parses the section of the table; `voxels` is the number of voxels of the volume.
///
/// # Errors
/// It is cut short or too long, numbers of labels do not rise, or a label has no voxel or more than there are.
pub(crate) fn parse_table(bytes: &[u8], voxels: u64) -> Result<Vec<Label>, FormatError> {
    let table = || {
        let (count, mut rest) = bytes.split_first_chunk::<8>()?;
        let count =
            usize::try_from(u64::from_le_bytes(*count)).ok().filter(|n| (1..=MAX_LABELS).contains(n))?;
        let mut labels: Vec<Label> = Vec::with_capacity(count.min(rest.len() / RECORD));
        let mut left = voxels;
        for _ in 0..count {
            let (record, more) = rest.split_first_chunk::<RECORD>()?;
            let [n0, n1, r, g, b, zero, numbers @ ..] = *record;
            let word = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| numbers[8 * i + k]));
            let (name, more) = more.split_at_checked(usize::try_from(word(1)).ok()?)?;
            let number = u16::from_le_bytes([n0, n1]);
            let rises = labels.last().map_or(0, |last| last.number) < number;
            if zero != 0 || !rises || word(0) == 0 {
                return None;
            }
            left = left.checked_sub(word(0))?;
            let name = std::str::from_utf8(name).ok()?.to_owned();
            labels.push(Label { number, name, color: [r, g, b], voxels: word(0) });
            rest = more;
        }
        rest.is_empty().then_some(labels)
    };
    table().ok_or_else(|| damaged("the table of labels cannot be read, or is impossible (SPEC I20)"))
}

/// Bytes of the directory for this many cells.
pub(crate) fn directory_bytes(cells: u64) -> u64 {
    cells.div_ceil(GROUP as u64).saturating_mul(ENTRY as u64)
}

/// Most labels for which indices in the table, and 0 for background, fit a byte.
const BYTE_PLACES: usize = 255;

/// Bytes of an item before it is coded: the numbers behind and in front.
pub(crate) const ITEM_BYTES: usize = 4;

/// Form of palette entries: the labels behind and in front of a cell's plane, as indices in the table from 1 on, 0 for
/// background.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LabelForm {
    /// Bytes of an entry: 2 or 4.
    bytes: usize,
}

impl LabelForm {
    /// The form for a model with this many labels.
    pub(crate) fn of(labels: usize) -> Self {
        Self { bytes: if labels > BYTE_PLACES { 4 } else { 2 } }
    }

    /// The entry of an item; `None` if the table lacks a number.
    pub(crate) fn entry(self, item: &[u8], table: &[Label]) -> Option<u32> {
        let number = |at: usize| item.get(at..)?.first_chunk().map(|b| u16::from_le_bytes(*b));
        let place = |number| match number {
            0 => Some(0),
            _ => Some(table.binary_search_by_key(&number, |label| label.number).ok()? + 1),
        };
        #[expect(clippy::cast_possible_truncation, reason = "at most 2^14 labels")]
        let [behind, front] = [place(number(0)?)? as u32, place(number(2)?)? as u32];
        Some(behind | front << (4 * self.bytes))
    }

    /// The numbers of an entry: behind and in front; `None` if the table lacks one of them.
    pub(crate) fn numbers(self, entry: u32, table: &[Label]) -> Option<[u16; 2]> {
        let number = |place: u32| match place.checked_sub(1) {
            None => Some(0),
            Some(at) => table.get(usize::try_from(at).ok()?).map(|label| label.number),
        };
        let shift = 4 * self.bytes;
        Some([number(entry & ((1 << shift) - 1))?, number(entry >> shift)?])
    }

    /// The largest size of the section, in bytes.
    pub(crate) fn most_bytes(self, cells: u64) -> u64 {
        directory_bytes(cells).saturating_add(cells.saturating_mul(self.bytes as u64))
    }

    /// Bytes of a block of `voxels` with a palette of `labels`; 0 labels for a block without one.
    fn block_bytes(self, labels: usize, voxels: usize) -> usize {
        if labels == 0 {
            self.bytes * voxels
        } else {
            self.bytes * labels + (voxels * width(labels)).div_ceil(8)
        }
    }

    fn read(self, entry: &[u8]) -> u32 {
        entry.iter().take(self.bytes).rev().fold(0, |word, byte| word << 8 | u32::from(*byte))
    }

    /// Codes the entries of a group, at most 512, whose bytes begin at `at` of the section: appends them to `out` and
    /// returns the entry of the directory.
    pub(crate) fn encode_group(self, labels: &[u32], at: u64, out: &mut Vec<u8>) -> [u8; ENTRY] {
        let mut entry = [0; ENTRY];
        entry[..8].copy_from_slice(&at.to_le_bytes());
        for (block, size) in labels.chunks(BLOCK).zip(&mut entry[8..]) {
            let mut palette: Vec<u32> = Vec::with_capacity(LARGEST + 1);
            let mut last = None;
            for label in block.iter().filter(|label| last.replace(**label) != Some(**label)) {
                if let Err(place) = palette.binary_search(label) {
                    palette.insert(place, *label);
                    if palette.len() > LARGEST {
                        break;
                    }
                }
            }
            let mut put = |labels: &[u32]| {
                labels.iter().for_each(|label| out.extend(&label.to_le_bytes()[..self.bytes]));
            };
            let plain = self.block_bytes(0, block.len());
            if palette.len() > LARGEST || self.block_bytes(palette.len(), block.len()) > plain {
                put(block);
                continue;
            }
            #[expect(clippy::cast_possible_truncation, reason = "at most 16")]
            {
                *size = palette.len() as u8;
            }
            put(&palette);
            let bits = width(palette.len());
            if bits == 0 {
                continue;
            }
            out.extend(block.chunks(8 / bits).map(|few| {
                few.iter().enumerate().fold(0_u8, |byte, (i, label)| {
                    #[expect(clippy::cast_possible_truncation, reason = "at most 15")]
                    let place = palette.binary_search(label).unwrap_or(0) as u8;
                    byte | place << (i * bits)
                })
            }));
        }
        entry
    }

    /// Decodes the entries of a group of `voxels` from the bytes at its offset; `None` if a palette is invalid, or
    /// bytes are missing. Also returns the number of bytes used.
    pub(crate) fn decode_group(
        self,
        sizes: &[u8; BLOCKS],
        bytes: &[u8],
        voxels: usize,
    ) -> Option<(Vec<u32>, usize)> {
        let (mut labels, mut used) = (Vec::with_capacity(GROUP), 0_usize);
        for (i, size) in sizes.iter().enumerate() {
            let (count, size) = (voxels.saturating_sub(i * BLOCK).min(BLOCK), usize::from(*size));
            if size > LARGEST || (count == 0 && size > 0) {
                return None;
            }
            let block = bytes.get(used..used.checked_add(self.block_bytes(size, count))?)?;
            used += block.len();
            let (palette, places) = block.split_at_checked(self.bytes * size)?;
            let entries =
                |bytes: &[u8]| bytes.chunks_exact(self.bytes).map(|e| self.read(e)).collect::<Vec<_>>();
            let palette = entries(palette);
            if !palette.is_sorted_by(|a, b| a < b) {
                return None;
            }
            if size == 0 {
                labels.extend(entries(places));
                continue;
            }
            for voxel in 0..count {
                labels.push(*palette.get(place_of(places, voxel, width(size)))?);
            }
            let rest = (count * width(size)) % 8;
            if rest > 0 && places.last()? >> rest != 0 {
                return None;
            }
        }
        Some((labels, used))
    }
}

/// Bits of a voxel's index in a palette of `labels`.
const fn width(labels: usize) -> usize {
    match labels {
        0 | 1 => 0,
        2 => 1,
        3 | 4 => 2,
        _ => 4,
    }
}

/// Index of a voxel's entry in the palette of its block.
fn place_of(places: &[u8], voxel: usize, bits: usize) -> usize {
    let at = voxel * bits;
    let byte = places.get(at / 8).copied().unwrap_or(0);
    usize::from(byte >> (at % 8)) & ((1 << bits) - 1)
}

/// The labels of a model's cells, read in place; safe on any bytes.
#[derive(Clone, Copy, Debug)]
pub struct LabelItems<'a> {
    section: &'a [u8],
    cells: u64,
    table: &'a [Label],
    form: LabelForm,
}

impl<'a> LabelItems<'a> {
    pub(crate) fn new(section: &'a [u8], cells: u64, table: &'a [Label]) -> Self {
        Self { section, cells, table, form: LabelForm::of(table.len()) }
    }

    /// Number of the greatest label of a cell; `None` past the last cell.
    #[inline]
    pub fn get(&self, cell: u64) -> Option<u16> {
        self.pair(cell).map(|[label, _]| label)
    }

    /// Numbers of the labels behind and in front of a cell's plane, 0 for background (SPEC 4.12).
    pub(crate) fn pair(&self, cell: u64) -> Option<[u16; 2]> {
        if cell >= self.cells {
            return None;
        }
        let (group, within) = (cell / GROUP as u64, usize::try_from(cell % GROUP as u64).ok()?);
        let entry = usize::try_from(group).ok()?.checked_mul(ENTRY)?;
        let entry = self.section.get(entry..)?.first_chunk::<ENTRY>()?;
        let mut at = u64::from_le_bytes(std::array::from_fn(|i| entry[i]));
        let (block, cell_of_block) = (within / BLOCK, within % BLOCK);
        for size in &entry[8..8 + block] {
            at = at.checked_add(self.form.block_bytes(usize::from(*size), BLOCK) as u64)?;
        }
        let bytes = self.section.get(usize::try_from(at).ok()?..)?;
        let size = usize::from(entry[8 + block]);
        let place = if size == 0 {
            cell_of_block
        } else {
            place_of(bytes.get(self.form.bytes * size..)?, cell_of_block, width(size))
        };
        let entry = bytes.get(self.form.bytes * place..)?.get(..self.form.bytes)?;
        self.form.numbers(self.form.read(entry), self.table)
    }

    /// A label of the table, by its number.
    pub(crate) fn named(&self, number: u16) -> Option<&'a Label> {
        self.table.binary_search_by_key(&number, |label| label.number).ok().map(|at| &self.table[at])
    }

    /// The label of [`LabelItems::get`] with its name and colour.
    pub(crate) fn label(&self, cell: u64) -> Option<&'a Label> {
        self.named(self.get(cell)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_one_to_many_labels_come_back_and_cost_no_more_than_plain_ones() {
        let named = |number| Label { number, name: String::new(), color: [0; 3], voxels: 1 };
        for kinds in [1_u16, 2, 3, 4, 5, 16, 17, 40, 250, 300] {
            let table: Vec<Label> = (0..kinds).map(|i| named(1 + 200 * i)).collect();
            let form = LabelForm::of(table.len());
            for voxels in [1, 2, 63, 64, 65, 300, 511, 512, 513, 1400] {
                let number = |i: u32, shift: u32| {
                    let any = i.wrapping_mul(2_654_435_761) >> shift;
                    table[any as usize % table.len()].number
                };
                let items: Vec<[u16; 2]> = (0..voxels)
                    .map(|i: u32| [number(i, 9), if i.is_multiple_of(3) { number(i, 20) } else { 0 }])
                    .collect();
                let entries: Vec<u32> = items
                    .iter()
                    .map(|[a, b]| form.entry(&[a.to_le_bytes(), b.to_le_bytes()].concat(), &table).unwrap())
                    .collect();
                let count = entries.len() as u64;
                let mut blocks = Vec::new();
                let mut directory = Vec::new();
                for group in entries.chunks(GROUP) {
                    let at = directory_bytes(count) + blocks.len() as u64;
                    let entry = form.encode_group(group, at, &mut blocks);
                    directory.extend(entry);
                    let from = usize::try_from(at - directory_bytes(count)).unwrap();
                    let sizes = entry.last_chunk().unwrap();
                    let (back, used) = form.decode_group(sizes, &blocks[from..], group.len()).unwrap();
                    assert_eq!((back, used), (group.to_vec(), blocks.len() - from));
                    for cut in 0..used {
                        assert_eq!(form.decode_group(sizes, &blocks[from..from + cut], group.len()), None);
                    }
                }
                let section: Vec<u8> = directory.into_iter().chain(blocks).collect();
                assert!(section.len() as u64 <= form.most_bytes(count), "{kinds} {voxels}");
                let found = LabelItems::new(&section, count, &table);
                for (voxel, (item, entry)) in (0..).zip(items.iter().zip(&entries)) {
                    assert_eq!(found.pair(voxel), Some(*item), "{kinds} {voxels}");
                    assert_eq!(form.numbers(*entry, &table), Some(*item));
                    assert_eq!(found.label(voxel).map(|label| label.number), Some(item[0]));
                }
                assert_eq!(found.pair(count), None);
            }
            assert_eq!(form.entry(&[2, 0, 0, 0], &table), None);
            assert_eq!(form.numbers(u32::MAX, &table), None);
        }
    }

    #[test]
    fn a_table_comes_back_and_every_cut_and_every_wrong_byte_of_its_numbers_is_found() {
        let label = |number, name: &str| Label { number, name: name.into(), color: [1, 2, 3], voxels: 5 };
        let labels = vec![label(1, "liver"), label(7, ""), label(65_535, "rib, left")];
        let bytes = table_to_bytes(&labels).unwrap();
        assert_eq!(parse_table(&bytes, 15), Ok(labels));
        for len in 0..bytes.len() {
            assert!(parse_table(&bytes[..len], 15).is_err(), "cut at {len}");
        }
        assert!(parse_table(&bytes, 14).is_err());
        for (at, value) in [(0, 2), (0, 4), (5, 1), (8, 0), (8, 7), (13, 1), (14, 0), (22, 6), (30, 0xff)] {
            let mut wrong = bytes.clone();
            wrong[at] = value;
            assert!(parse_table(&wrong, 15).is_err(), "{value} at {at}");
        }
        assert!(table_to_bytes(&[label(1, &"a".repeat(METADATA_LIMIT))]).is_err());
    }
}
