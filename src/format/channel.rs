//! The channels: attributes stored for a skin voxel, one row of the table each.
//!
//! A row holds everything that differs between channels: name and tags, bytes per item, averaging of items for coarse
//! nodes, packing, illegal items. Builder, loader, verifier, packer and reports read the row; none of them names a
//! channel, except where the metadata or a view does.

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
    /// Name on the command line and in reports.
    pub name: &'static str,
    /// Name of its items in sentences.
    pub items_name: &'static str,
    /// Tag of the section with one item per voxel.
    pub tag: [u8; 4],
    /// Allowed numbers of bytes per item.
    pub item_bytes: &'static [u8],
    /// Rule for the items of coarse nodes, if they have any.
    pub means: Option<Means>,
    /// Codec of the packed section (SPEC 5.1).
    pub codec: u8,
    /// True if the metadata states the channel (SPEC I17); `None` if the metadata never mentions it.
    pub is_stated: Option<fn(&Metadata) -> bool>,
    /// True for an illegal item (SPEC I14).
    pub illegal: Option<fn(&[u8]) -> bool>,
    /// True if only a part of the voxels has an item, marked by the offset (SPEC 4.8).
    pub is_sparse: bool,
    /// True if the section holds bytes from which the items are decoded (SPEC 4.11), rather than the items.
    pub is_coded: bool,
}

/// The section of coarse means of a channel.
#[derive(Debug)]
pub struct Means {
    /// Tag of the section.
    pub tag: [u8; 4],
    /// Name in reports.
    pub name: &'static str,
    /// Rule of the mean.
    pub rule: MeanRule,
}

impl ChannelRow {
    /// A row of an independent channel of voxels without illegal items.
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

    /// The channel's row of the table.
    #[inline]
    pub fn row(self) -> &'static ChannelRow {
        &TABLE[self as usize]
    }

    /// Name on the command line and in reports.
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

    /// The same set with one more channel.
    #[must_use]
    pub const fn with(self, channel: Channel) -> Self {
        Self(self.0 | 1 << channel as u16)
    }

    /// True if the channel is in the set.
    pub const fn contains(self, channel: Channel) -> bool {
        self.0 >> channel as u16 & 1 == 1
    }

    /// The channels of the set, in file order.
    pub fn iter(self) -> impl DoubleEndedIterator<Item = Channel> + Clone {
        Channel::all().filter(move |channel| self.contains(*channel))
    }
}

impl Default for Channels {
    /// Normals alone, which shading needs.
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

/// Rule that combines the items of a node's voxels to the item of the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeanRule {
    /// The direction of the sum of the L1-127 vectors; the first voxel's if that is zero (SPEC 4.6, I15).
    Direction,
    /// The mean of unsigned numbers, rounded half up (SPEC 4.7, I16).
    Number,
}

/// Sum of voxel items for their mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sum {
    /// Components; a number only uses the first, which holds the bits of a u64.
    parts: [i64; 3],
    /// Number of voxels.
    count: u64,
    /// Code of the first voxel; only for directions.
    first: u16,
}

/// A mean, little-endian; only as many bytes as an item has are stored.
pub(crate) type MeanBytes = [u8; 8];

/// Longest item that can be averaged.
const LONGEST_MEAN: usize = size_of::<MeanBytes>();

impl MeanRule {
    /// Adds the next voxels in Morton order, `item_bytes` each, at most 2^24.
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

    /// Adds an item `times` times, at most 2^10.
    pub(crate) fn add_repeated(self, sum: &mut Sum, item: &[u8], times: u64) {
        let mut own = Sum::default();
        self.add_items(&mut own, item, item.len());
        own.parts = own.parts.map(|part| part.wrapping_mul(times.cast_signed()));
        own.count = times;
        sum.join(&own);
    }

    /// The mean of the added items.
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
                // Rounded half up without a sum that could overflow.
                let mean = total / count + u64::from(2 * (total % count) >= count);
                mean.to_le_bytes()
            }
        }
    }
}

/// An item as a number; only the first eight bytes of a longer one.
pub(crate) fn number(item: &[u8]) -> u64 {
    item.iter().take(8).rev().fold(0, |n, byte| n << 8 | u64::from(*byte))
}

impl Sum {
    /// Bytes of [`Sum::to_bytes`].
    pub(crate) const BYTES: usize = 40;

    /// Adds the next boxes in Morton order.
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

    /// Number of added voxels.
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

    /// Parses the bytes of [`Sum::to_bytes`].
    pub(crate) fn parse(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |i: usize| u64::from_le_bytes(std::array::from_fn(|k| bytes[8 * i + k]));
        #[expect(clippy::cast_possible_truncation, reason = "written from a u16")]
        Self { parts: std::array::from_fn(|a| word(a).cast_signed()), count: word(3), first: word(4) as u16 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
