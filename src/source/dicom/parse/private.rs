//! Private elements of Siemens that describe mosaics.

use super::value::{Tag, text};
use crate::volume::Endian;

/// Private creators of the blocks that matter.
const MR_HEADER: &str = "SIEMENS MR HEADER";
const CSA_HEADER: &str = "SIEMENS CSA HEADER";

/// Private elements of the main dataset that describe a mosaic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Private {
    mr_block: Option<u8>,
    csa_block: Option<u8>,
    /// (0019,xx0A) Number of Images in Mosaic.
    pub images: Option<u32>,
}

/// Block and element of a private tag of a group, if it is one.
fn private(tag: Tag, group: u32) -> Option<(u8, u8)> {
    let [high, low, block, element] = tag.to_be_bytes();
    (u32::from(u16::from_be_bytes([high, low])) == group && block >= 0x10).then_some((block, element))
}

/// Block that this element reserves in a group, if it is a private creator.
fn reserved(tag: Tag, group: u32) -> Option<u8> {
    let [high, low, zero, block] = tag.to_be_bytes();
    (u32::from(u16::from_be_bytes([high, low])) == group && zero == 0 && block >= 0x10).then_some(block)
}

impl Private {
    /// True if [`Private::keep`] looks at this tag.
    pub(crate) fn wants(tag: Tag) -> bool {
        reserved(tag, 0x0019).or(reserved(tag, 0x0029)).is_some()
            || private(tag, 0x0019).is_some_and(|(_, element)| element == 0x0a)
    }

    /// Takes over one element, if it is one that matters.
    pub(crate) fn keep(&mut self, tag: Tag, value: &[u8], endian: Endian) {
        if let Some(block) = reserved(tag, 0x0019).filter(|_| text(value) == MR_HEADER) {
            self.mr_block.get_or_insert(block);
        } else if let Some(block) = reserved(tag, 0x0029).filter(|_| text(value) == CSA_HEADER) {
            self.csa_block.get_or_insert(block);
        } else if private(tag, 0x0019)
            .is_some_and(|(block, element)| Some(block) == self.mr_block && element == 0x0a)
        {
            self.images = match *value {
                [a, b] if endian == Endian::Big => Some(u16::from_be_bytes([a, b]).into()),
                [a, b] => Some(u16::from_le_bytes([a, b]).into()),
                _ => text(value).parse().ok(),
            };
        }
    }

    /// True for the header that [`super::csa`] reads.
    pub(crate) fn is_csa(&self, tag: Tag) -> bool {
        private(tag, 0x0029).is_some_and(|(block, element)| Some(block) == self.csa_block && element == 0x10)
    }
}
