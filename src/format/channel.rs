//! The channels: what is stored of a skin voxel, one row of the table each.
//!
//! A row says everything that differs between channels: name and tags, bytes per item, how items are averaged
//! for coarse nodes, how they are packed, what is legal. Builder, loader, verifier, packer and reports
//! read the row; none of them names a channel, but where the metadata or a view does.

use std::fmt;

use serde::{Deserialize, Deserializer};

use super::kind::Channel;
use super::metadata::Metadata;
use super::normal;
use super::packed::{CODEC_DIRECTIONS, CODEC_PLANES};

/// The properties of a channel.
#[derive(Debug)]
pub struct ChannelRow {
    channel: Channel,
    /// Its name on the command line and in reports.
    pub name: &'static str,
    /// Its items in sentences.
    pub items_name: &'static str,
    /// Tag of the section with one item per voxel.
    pub tag: [u8; 4],
    /// Bytes that an item may have.
    pub item_bytes: &'static [u8],
    /// How coarse nodes come to items, if they do.
    pub means: Option<Means>,
    /// Codec of the packed section (SPEC 5.1).
    pub codec: u8,
    /// Does the metadata say that the channel is there (SPEC I17)? Not asked if it says nothing of it.
    pub is_stated: Option<fn(&Metadata) -> bool>,
    /// The illegal items (SPEC I14).
    pub illegal: Option<fn(&[u8]) -> bool>,
    /// Does only a part of the voxels have an item? The offset says which (SPEC 4.8).
    pub is_sparse: bool,
    /// Does its section hold bytes from which the items are decoded (SPEC 4.11), rather than the items?
    pub is_coded: bool,
}

/// The section of coarse means of a channel.
#[derive(Debug)]
pub struct Means {
    /// Its tag.
    pub tag: [u8; 4],
    /// Its name in reports.
    pub name: &'static str,
    /// How a mean comes about.
    pub rule: MeanRule,
}

impl ChannelRow {
    /// A channel of voxels alone, whose items may be anything.
    const fn plain(
        channel: Channel,
        name: &'static str,
        items_name: &'static str,
        tag: [u8; 4],
        item_bytes: &'static [u8],
    ) -> Self {
        Self {
            channel,
            name,
            items_name,
            tag,
            item_bytes,
            means: None,
            codec: CODEC_PLANES,
            is_stated: None,
            illegal: None,
            is_sparse: false,
            is_coded: false,
        }
    }
}

/// The rows, by [`Channel`].
static TABLE: &[ChannelRow] = &[
    ChannelRow {
        means: Some(Means { tag: *b"NLOD", name: "normal_lod", rule: MeanRule::Direction }),
        codec: CODEC_DIRECTIONS,
        is_stated: Some(|m| !m.gradient.is_empty()),
        illegal: Some(|item| item.contains(&0x80)),
        ..ChannelRow::plain(Channel::Normal, "normal", "normals", *b"NORM", &[2])
    },
    ChannelRow {
        means: Some(Means { tag: *b"VLOD", name: "value_lod", rule: MeanRule::Number }),
        is_stated: Some(|m| m.value_scale != [0.0, 0.0]),
        ..ChannelRow::plain(Channel::Value, "value", "values", *b"VALU", &[1, 2])
    },
    ChannelRow::plain(Channel::Offset, "offset", "offsets", *b"OFFS", &[1]),
    ChannelRow::plain(Channel::Color, "color", "colors", *b"COLR", &[3]),
    ChannelRow::plain(Channel::Material, "material", "materials", *b"MATL", &[1]),
    ChannelRow {
        illegal: Some(|item| {
            if let Some(walls) = item.first_chunk() {
                return super::walls::WallItem::is_illegal(walls);
            }
            let outside = item.iter().filter(|c| **c >= 0x80).count();
            outside == 0 || outside == item.len() || item.iter().any(|c| matches!(c, 0 | 0x80))
        }),
        is_sparse: true,
        ..ChannelRow::plain(Channel::Corners, "corners", "corners", *b"CORN", &[8, 20])
    },
    ChannelRow { is_coded: true, ..ChannelRow::plain(Channel::Label, "label", "labels", *b"LABL", &[1]) },
    ChannelRow {
        is_stated: Some(|m| m.noise.is_some()),
        ..ChannelRow::plain(Channel::Steepness, "steepness", "steepnesses", *b"STEE", &[1])
    },
    #[cfg(test)]
    ChannelRow {
        means: Some(Means { tag: *b"DLOD", name: "dummy_lod", rule: MeanRule::Number }),
        illegal: Some(|item| item == [0xff; 4]),
        ..ChannelRow::plain(Channel::Dummy, "dummy", "dummies", *b"DUMM", &[4])
    },
];

const _: () = assert!(super::cell::CORNERS == 8, "one byte for each corner");
const _: () = assert!(super::walls::WALL_BYTES == 20);

const _: () = {
    let mut at = 0;
    while at < TABLE.len() {
        assert!(TABLE[at].channel as usize == at, "rows stand in the order of the channels");
        at += 1;
    }
};

impl Channel {
    /// Every channel, in file order.
    pub fn all() -> impl DoubleEndedIterator<Item = Self> + Clone {
        TABLE.iter().map(|row| row.channel)
    }

    /// Its row of the table.
    #[inline]
    pub fn row(self) -> &'static ChannelRow {
        &TABLE[self as usize]
    }

    /// Its name on the command line and in reports.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The channel of a name.
    pub fn by_name(name: &str) -> Option<Self> {
        Self::all().find(|channel| channel.name() == name)
    }
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A set of channels.
///
/// ```
/// use infobyte::format::{Channel, Channels};
/// let both = Channels::from([Channel::Value, Channel::Normal]);
/// assert_eq!(both.iter().collect::<Vec<_>>(), [Channel::Normal, Channel::Value]);
/// assert!(!both.contains(Channel::Color));
/// assert_eq!(Channels::default(), Channels::from([Channel::Normal]));
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Channels(u16);

impl Channels {
    /// No channel: the structure alone.
    pub const NONE: Self = Self(0);

    /// The same set with one more.
    #[must_use]
    pub const fn with(self, channel: Channel) -> Self {
        Self(self.0 | 1 << channel as u16)
    }

    /// Is the channel in the set?
    pub const fn contains(self, channel: Channel) -> bool {
        self.0 >> channel as u16 & 1 == 1
    }

    /// Its channels, in file order.
    pub fn iter(self) -> impl DoubleEndedIterator<Item = Channel> + Clone {
        Channel::all().filter(move |channel| self.contains(*channel))
    }
}

impl Default for Channels {
    /// Normals, which shading needs, and nothing else.
    fn default() -> Self {
        Self::NONE.with(Channel::Normal)
    }
}

impl FromIterator<Channel> for Channels {
    fn from_iter<I: IntoIterator<Item = Channel>>(channels: I) -> Self {
        channels.into_iter().fold(Self::NONE, Self::with)
    }
}

impl<const N: usize> From<[Channel; N]> for Channels {
    fn from(channels: [Channel; N]) -> Self {
        channels.into_iter().collect()
    }
}

impl<'de> Deserialize<'de> for Channels {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Vec::<Channel>::deserialize(deserializer).map(Self::from_iter)
    }
}

impl fmt::Debug for Channels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

/// How the items of a node's voxels become the item of the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeanRule {
    /// The direction of the sum of the L1-127 vectors; the first voxel's if that is zero (SPEC 4.6, I15).
    Direction,
    /// The mean of unsigned numbers, rounded half up (SPEC 4.7, I16).
    Number,
}

/// The items of some voxels, added up for their mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sum {
    /// Components; of a number the first alone, which holds the bits of a u64.
    parts: [i64; 3],
    /// Voxels.
    count: u64,
    /// Code of the first voxel, of directions.
    first: u16,
}

/// A mean, little-endian; as many bytes as an item has are stored.
pub(crate) type MeanBytes = [u8; 8];

/// Longest item that can be averaged.
const LONGEST_MEAN: usize = size_of::<MeanBytes>();

impl MeanRule {
    /// Adds voxels that follow in Morton order, `item_bytes` each, at most 2^24.
    #[inline]
    pub(crate) fn add_items(self, sum: &mut Sum, items: &[u8], item_bytes: usize) {
        match self {
            Self::Direction => {
                let codes = items.as_chunks::<2>().0;
                let Some(first) = codes.first() else { return };
                if sum.count == 0 {
                    sum.first = u16::from_le_bytes(*first);
                }
                // 127 x 2^24 stays below 2^31.
                let mut total = [0_i32; 3];
                for code in codes {
                    let v = normal::decode_l1(u16::from_le_bytes(*code));
                    (total[0], total[1], total[2]) = (total[0] + v[0], total[1] + v[1], total[2] + v[2]);
                }
                for (part, more) in sum.parts.iter_mut().zip(total) {
                    *part += i64::from(more);
                }
                sum.count += codes.len() as u64;
            }
            Self::Number => {
                let total = match item_bytes {
                    1 => items.iter().map(|v| u64::from(*v)).sum(),
                    2 => items.as_chunks::<2>().0.iter().map(|v| u64::from(u16::from_le_bytes(*v))).sum(),
                    _ => items.chunks_exact(item_bytes.max(1)).map(number).sum::<u64>(),
                };
                sum.parts[0] = sum.parts[0].wrapping_add(total.cast_signed());
                sum.count += (items.len() / item_bytes.max(1)) as u64;
            }
        }
    }

    /// Adds an item as often as said, at most 2^10 times.
    pub(crate) fn add_repeated(self, sum: &mut Sum, item: &[u8], times: u64) {
        let mut own = Sum::default();
        self.add_items(&mut own, item, item.len());
        own.parts = own.parts.map(|part| part.wrapping_mul(times.cast_signed()));
        own.count = times;
        sum.join(&own);
    }

    /// The mean of what was added.
    #[inline]
    pub(crate) fn mean(self, sum: &Sum) -> MeanBytes {
        match self {
            Self::Direction => {
                let mut bytes = [0; LONGEST_MEAN];
                bytes[..2].copy_from_slice(&normal::mean(sum.parts, sum.first).to_le_bytes());
                bytes
            }
            Self::Number => {
                let (total, count) = (sum.parts[0].cast_unsigned(), sum.count.max(1));
                // Half up without a sum that could overflow.
                let mean = total / count + u64::from(2 * (total % count) >= count);
                mean.to_le_bytes()
            }
        }
    }
}

/// An item as a number, of a longer one the first eight bytes.
pub(crate) fn number(item: &[u8]) -> u64 {
    item.iter().take(8).rev().fold(0, |n, byte| n << 8 | u64::from(*byte))
}

impl Sum {
    /// Bytes of [`Sum::to_bytes`].
    pub(crate) const BYTES: usize = 40;

    /// Adds boxes that follow in Morton order.
    #[inline]
    pub fn join(&mut self, next: &Self) {
        if self.count == 0 {
            self.first = next.first;
        }
        for (part, more) in self.parts.iter_mut().zip(next.parts) {
            *part = part.wrapping_add(more);
        }
        self.count += next.count;
    }

    /// Voxels added.
    #[inline]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The sum as bytes, for a scratch file.
    pub(crate) fn to_bytes(self) -> [u8; Self::BYTES] {
        let [x, y, z] = self.parts.map(i64::cast_unsigned);
        let mut bytes = [0; Self::BYTES];
        for (to, word) in
            bytes.as_chunks_mut::<8>().0.iter_mut().zip([x, y, z, self.count, self.first.into()])
        {
            *to = word.to_le_bytes();
        }
        bytes
    }

    /// The sum that gave these bytes.
    pub(crate) fn parse(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| bytes[8 * i + k]));
        #[expect(clippy::cast_possible_truncation, reason = "written from a u16")]
        Self { parts: std::array::from_fn(|a| word(a).cast_signed()), count: word(3), first: word(4) as u16 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::{
        BuildOptions, ItemForm, OccupancyRows, ScanSummary, Silent, SkinSlice, Solid, SolidWorker, Tile,
        VoxelBox, build_solid,
    };
    use crate::format::{FormatError, HEADER_BYTES, Header, SectionKind, table_bytes};
    use crate::geom::{BoxIndex, Dims, Level, NodeIndex, Octant, VoxelIndex};
    use crate::jobs::{info, pack};
    use crate::load::{Fault, Frame, Model, NodeView, verify};
    use crate::volume::SourceError;

    #[test]
    fn names_and_tags_are_told_apart_and_found() {
        for channel in Channel::all() {
            assert_eq!(Channel::by_name(channel.name()), Some(channel));
            let same = |other: &Channel| {
                other.row().tag == channel.row().tag || other.row().name == channel.row().name
            };
            assert_eq!(Channel::all().filter(same).count(), 1, "{channel}");
            if let Some(means) = &channel.row().means {
                assert!(
                    channel.row().item_bytes.iter().all(|b| usize::from(*b) <= LONGEST_MEAN),
                    "{channel}"
                );
                assert!(Channel::all().all(|c| c.row().tag != means.tag), "{channel}");
            }
        }
        assert_eq!(Channel::by_name("smell"), None);
    }

    #[test]
    fn means_round_half_up_and_fall_back_to_the_first() {
        let code = |d| normal::encode(d).to_le_bytes();
        let (there, back) = (code([1.0, 0.0, 0.0]), code([-1.0, 0.0, 0.0]));
        let mut sum = Sum::default();
        MeanRule::Direction.add_items(&mut sum, &there, 2);
        let mut next = Sum::default();
        MeanRule::Direction.add_items(&mut next, &back, 2);
        sum.join(&next);
        assert_eq!((&MeanRule::Direction.mean(&sum)[..2], sum.count()), (&there[..], 2));
        assert_eq!(Sum::parse(&sum.to_bytes()), sum);
        for (item, items, mean) in
            [(1, &[1_u8, 2][..], 2_u64), (2, &[1, 0, 2, 1, 0, 0], 86), (4, &[9, 0, 0, 1], 0x100_0009)]
        {
            let mut sum = Sum::default();
            MeanRule::Number.add_items(&mut sum, items, item);
            assert_eq!(u64::from_le_bytes(MeanRule::Number.mean(&sum)), mean);
        }
    }

    /// A cube with a dummy item for every skin voxel.
    struct Cube;

    #[derive(Default)]
    struct CubeWorker {
        dummies: Vec<u8>,
    }

    fn dummy([x, y, z]: [u32; 3]) -> u32 {
        x * x + (y << 10) + (z << 24)
    }

    impl Solid for Cube {
        fn dims(&self) -> Dims {
            Dims::new(80, 70, 60).unwrap()
        }

        fn metadata(&self, _: &ScanSummary) -> Metadata {
            Metadata::of_grid(self.dims(), "cube")
        }

        fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
            (channel == Channel::Dummy).then_some(ItemForm::AsIs { bytes: 4 })
        }

        fn worker_bytes(&self, _: &Tile) -> u64 {
            0
        }

        fn worker(&self, _: &Tile) -> Box<dyn SolidWorker + '_> {
            Box::new(CubeWorker::default())
        }
    }

    impl SolidWorker for CubeWorker {
        fn start(&mut self, _: &VoxelBox) -> Result<(), SourceError> {
            Ok(())
        }

        fn occupancy(&mut self, rows: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
            for y in rows.y() {
                let inside = (7..55).contains(&y) && (3..51).contains(&rows.z());
                rows.set_row(y, if inside { 20..68 } else { 0..0 });
            }
            Ok(())
        }

        fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
            self.dummies.clear();
            self.dummies.extend(skin.voxels().flat_map(|voxel| dummy(voxel).to_le_bytes()));
            Ok(())
        }

        fn items(&self, _: Channel) -> &[u8] {
            &self.dummies
        }
    }

    /// The voxels of the model below a box, in the order of their numbers.
    fn voxels_below(m: &Model, at: BoxIndex, corner: [u32; 3], left: u32, found: &mut Vec<[u32; 3]>) {
        if left == 0 {
            found.push(corner);
        }
        for octant in Octant::ALL.into_iter().filter(|_| left > 0) {
            if let Some(child) = m.child(at.node(), octant) {
                let corner = std::array::from_fn(|a| corner[a] + (octant.high()[a] << (left - 1)));
                voxels_below(m, child, corner, left - 1, found);
            }
        }
    }

    /// A row of the table is all that a channel needs: `Dummy` is named in no other file.
    #[test]
    fn a_new_row_is_built_loaded_verified_packed_and_shown() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let options =
            BuildOptions { channels: Some(Channels::from([Channel::Dummy])), ..BuildOptions::default() };
        let report = build_solid(&Cube, &options, &at("m.oct"), &Silent).unwrap();
        assert_eq!(report.skin_voxels, 48 * 48 * 48 - 46 * 46 * 46);

        let model = Model::open(at("m.oct")).unwrap();
        verify(&model).unwrap();
        let mut voxels = Vec::new();
        voxels_below(&model, BoxIndex::ROOT, [0; 3], model.dims().depth(), &mut voxels);
        let items = model.items(Channel::Dummy).unwrap();
        assert_eq!((voxels.len() as u64, items.item_bytes()), (report.skin_voxels, 4));
        for (number, voxel) in (0..).zip(&voxels) {
            assert_eq!(items.get(number), Some(&dummy(*voxel).to_le_bytes()[..]), "{voxel:?}");
        }
        let (sum, count) = (voxels.iter().map(|v| u64::from(dummy(*v))).sum::<u64>(), voxels.len() as u64);
        let mean = u32::try_from((2 * sum + count) / (2 * count)).unwrap();
        assert_eq!(model.means(Channel::Dummy).unwrap().get(0), Some(&mean.to_le_bytes()[..]));

        // The verifier looks at items and means of the row.
        let wrong = |kind: SectionKind, bytes: [u8; 4]| {
            let mut file = std::fs::read(at("m.oct")).unwrap();
            let frame = Frame::read(&file[..]).unwrap();
            let mut sections = frame.sections.clone();
            let entry = sections.iter_mut().find(|e| e.kind == Some(kind)).unwrap();
            let range = usize::try_from(entry.offset).unwrap()..usize::try_from(entry.end()).unwrap();
            file[range.clone()][..4].copy_from_slice(&bytes);
            (entry.stored_crc, entry.content_crc) =
                (crc32c::crc32c(&file[range.clone()]), crc32c::crc32c(&file[range]));
            let table = table_bytes(&sections);
            let header = Header { table_crc: crc32c::crc32c(&table), ..frame.header };
            file[HEADER_BYTES..HEADER_BYTES + table.len()].copy_from_slice(&table);
            file[..HEADER_BYTES].copy_from_slice(&header.to_bytes());
            match verify(&file[..]) {
                Err(Fault::Format(fault)) => fault,
                other => panic!("{other:?}"),
            }
        };
        let channel = Channel::Dummy;
        assert_eq!(
            wrong(SectionKind::Voxels(channel), [0xff; 4]),
            FormatError::IllegalItem { channel, voxel: VoxelIndex::new(0), item: u32::MAX.into() }
        );
        let (level, node) = (Level::ROOT, NodeIndex::ROOT);
        let found = u32::from_le_bytes([1; 4]).into();
        assert_eq!(
            wrong(SectionKind::Means(channel), [1; 4]),
            FormatError::MeanValue { channel, level, node, due: mean.into(), found }
        );

        pack::pack(&at("m.oct"), &at("p.oct")).unwrap();
        let shown = info::read_info(&at("p.oct")).unwrap().json();
        assert_eq!(shown.channels, ["dummy"]);
        assert!(shown.model.channel_bytes["dummy"] > 0, "{shown:?}");
        assert_eq!(shown.model.channel_bytes["dummy_lod"], 0);
        pack::unpack(&at("p.oct"), &at("u.oct")).unwrap();
        assert!(std::fs::read(at("u.oct")).unwrap() == std::fs::read(at("m.oct")).unwrap());
    }
}
