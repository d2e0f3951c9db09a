//! Head and tail of a part.

use super::cut::PartId;
use crate::builder::item::{ChannelForm, ItemForm};
use crate::builder::layout::StoredChannels;
use crate::format::{Channel, METADATA_LIMIT, SurfaceKind};
use crate::geom::Dims;

const MAGIC: [u8; 8] = *b"\x89OPART\r\n";
/// Magic, and the bytes of the whole head.
pub(super) const START_BYTES: usize = 12;
/// Digest, number, count, dims, surface, means, channels.
const FIXED_BYTES: usize = START_BYTES + 32 + 4 + 4 + 12 + 3;
/// Length limit of a head.
const MAX_BYTES: usize = FIXED_BYTES + 2 * u8::MAX as usize + 4 + METADATA_LIMIT + 4;
pub(super) const TAIL_BYTES: usize = 24;
const END: [u8; 4] = *b"PEND";

/// Description of a part at its start.
#[derive(Clone, Debug)]
pub(super) struct Head {
    pub(super) digest: [u8; 32],
    pub(super) number: u32,
    pub(super) parts: u32,
    pub(super) dims: [u32; 3],
    pub(super) surface: SurfaceKind,
    pub(super) channels: StoredChannels,
    pub(super) metadata: Vec<u8>,
}

/// Length of a head, read from its first [`START_BYTES`].
pub(super) fn head_bytes(start: &[u8; START_BYTES]) -> Option<usize> {
    let (magic, length) = start.split_first_chunk::<8>()?;
    let length = u32::from_le_bytes(length.try_into().ok()?) as usize;
    (*magic == MAGIC && (FIXED_BYTES..=MAX_BYTES).contains(&length)).then_some(length)
}

pub(super) fn write(
    part: &PartId,
    dims: Dims,
    surface: SurfaceKind,
    channels: &StoredChannels,
    metadata: &[u8],
) -> Vec<u8> {
    let mut head = [&MAGIC[..], &[0; 4], &part.digest].concat();
    for word in [part.number, part.cuts.parts].into_iter().chain(dims.to_array()) {
        head.extend(word.to_le_bytes());
    }
    #[expect(clippy::cast_possible_truncation, reason = "a channel is in the list once")]
    head.extend([
        u8::from(surface == SurfaceKind::Cells),
        u8::from(channels.lod),
        channels.forms.len() as u8,
    ]);
    for ChannelForm { channel, form } in &channels.forms {
        #[expect(clippy::cast_possible_truncation, reason = "an item has at most 8 bytes")]
        head.extend([*channel as u8, form.stored_bytes() as u8]);
    }
    #[expect(clippy::cast_possible_truncation, reason = "below METADATA_LIMIT")]
    head.extend((metadata.len() as u32).to_le_bytes());
    head.extend(metadata);
    #[expect(clippy::cast_possible_truncation, reason = "below MAX_BYTES")]
    let length = (head.len() + 4) as u32;
    head[8..START_BYTES].copy_from_slice(&length.to_le_bytes());
    let crc = crc32c::crc32c(&head);
    head.extend(crc.to_le_bytes());
    head
}

/// Bytes read from the front.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*first)
    }

    fn word(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }
}

impl Head {
    /// Reads the bytes of a whole head; `None` if they are damaged.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let (content, crc) = bytes.split_last_chunk::<4>()?;
        if crc32c::crc32c(content) != u32::from_le_bytes(*crc) {
            return None;
        }
        let mut rest = Bytes(content.get(START_BYTES..)?);
        let digest = rest.take()?;
        let (number, parts) = (rest.word()?, rest.word()?);
        let dims = [rest.word()?, rest.word()?, rest.word()?];
        let [surface, lod, count] = rest.take()?;
        let mut forms = Vec::new();
        for _ in 0..count {
            let [code, bytes] = rest.take()?;
            let channel = Channel::all().nth(code.into())?;
            let bytes = usize::from(bytes);
            if !channel.row().item_bytes.iter().any(|known| usize::from(*known) == bytes) {
                return None;
            }
            forms.push(ChannelForm { channel, form: ItemForm::AsIs { bytes } });
        }
        let length = rest.word()? as usize;
        let surface = if surface == 0 { SurfaceKind::Skin } else { SurfaceKind::Cells };
        let channels = StoredChannels { forms, lod: lod != 0, leaves: false };
        let metadata = rest.0.to_vec();
        (metadata.len() == length).then_some(Self {
            digest,
            number,
            parts,
            dims,
            surface,
            channels,
            metadata,
        })
    }
}

/// The end of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tail {
    pub(super) footer: u64,
    pub(super) groups: u64,
    pub(super) crc: u32,
}

impl Tail {
    pub(super) fn to_bytes(self) -> [u8; TAIL_BYTES] {
        let mut bytes = [0; TAIL_BYTES];
        bytes[..8].copy_from_slice(&self.footer.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.groups.to_le_bytes());
        bytes[16..20].copy_from_slice(&self.crc.to_le_bytes());
        bytes[20..].copy_from_slice(&END);
        bytes
    }

    pub(super) fn parse(bytes: &[u8; TAIL_BYTES]) -> Option<Self> {
        let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
        let crc = u32::from_le_bytes(std::array::from_fn(|i| bytes[16 + i]));
        (bytes[20..] == END).then_some(Self { footer: number(0), groups: number(8), crc })
    }
}
