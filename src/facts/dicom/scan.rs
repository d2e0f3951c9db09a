//! Why the elements of a file cannot be followed.

use std::io;

use thiserror::Error;

use crate::facts::SystemError;

/// Why bytes of a file cannot be had.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ReadFault {
    /// The system refused.
    System(SystemError),
    /// They lie in a deflate stream that is wrong.
    Deflate(DeflateFault),
}

impl From<io::Error> for ReadFault {
    fn from(error: io::Error) -> Self {
        DeflateFault::inside(&error).map_or_else(|| Self::System((&error).into()), Self::Deflate)
    }
}

impl From<ReadFault> for io::Error {
    fn from(fault: ReadFault) -> Self {
        match fault {
            ReadFault::System(error) => error.into(),
            ReadFault::Deflate(fault) => fault.into(),
        }
    }
}

/// What is wrong with the stream of a deflated file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DeflateFault {
    /// It cannot be inflated.
    Damaged,
    /// So many bytes, and no pixels yet.
    LongHeader {
        /// Bytes that were inflated, those before the stream included.
        bytes: u64,
    },
}

impl DeflateFault {
    /// The fault that travels in an error of a reader, if it is one of these.
    pub(crate) fn inside(error: &io::Error) -> Option<Self> {
        error.get_ref().and_then(|inner| inner.downcast_ref::<Self>()).copied()
    }
}

impl From<DeflateFault> for io::Error {
    fn from(fault: DeflateFault) -> Self {
        Self::new(io::ErrorKind::InvalidData, fault)
    }
}

/// Why a file yields no header.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ScanError {
    /// It cannot be read.
    Io(ReadFault),
    /// It does not look like DICOM at all.
    NotDicom,
    /// It begins as DICOM, but cannot be followed.
    Damaged {
        /// Offset of the element that is wrong.
        offset: u64,
        /// What is wrong there.
        damage: Damage,
    },
}

impl From<io::Error> for ScanError {
    fn from(error: io::Error) -> Self {
        Self::Io(error.into())
    }
}

/// What is wrong with an element, or with what it holds; tags have the group in their high 16 bits.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// The file ends inside an element.
    EndsInElement,
    /// The file ends inside the head of this element.
    EndsInHead(u32),
    /// An element is longer than the rest of the file.
    LongElement {
        /// Its tag.
        tag: u32,
        /// Bytes that it declares.
        declared: u32,
        /// Bytes that are left.
        left: u64,
    },
    /// This element has an undefined length where it must not.
    NoLength(u32),
    /// This element stands where an item must.
    NoItem(u32),
    /// Sequences lie in each other, deeper than this.
    Nesting {
        /// Levels that are followed.
        most: usize,
    },
    /// The file is deflated, and its stream is wrong.
    Deflate(DeflateFault),
    /// The Slice Vector is shorter than the frames are many.
    SliceVector {
        /// Frames that it numbers.
        numbered: u32,
        /// Frames that there are.
        frames: u32,
    },
    /// The Grid Frame Offset Vector has no number for this frame, counted from 0.
    GridOffset(u32),
    /// The Modality LUT has no LUT Descriptor before its data.
    LutWithoutDescriptor,
    /// The Modality LUT lacks its descriptor or its data.
    IncompleteLut,
    /// The descriptors of the three palettes differ.
    PalettesDiffer,
    /// A palette has no descriptor.
    PaletteWithoutDescriptor,
    /// The descriptor of a table is cut short.
    ShortDescriptor,
    /// A table has entries of so many bits.
    EntryBits(u16),
    /// A table has too few bytes.
    ShortTable {
        /// Entries that its descriptor states.
        entries: usize,
        /// Bytes that it has.
        bytes: usize,
    },
    /// The file ends inside a table.
    EndsInTable,
    /// Compressed pixels do not begin with an item.
    NotInItems,
    /// Nothing tells which fragments make which frame.
    Fragments {
        /// Fragments that there are.
        fragments: u64,
        /// Fragments that begin as a compressed image does.
        begun: u64,
        /// Frames that are stated.
        frames: u32,
    },
    /// No fragment is left for this frame, counted from 0.
    NoFragment(u32),
    /// One frame has more fragments than this.
    ManyFragments {
        /// Fragments that are followed.
        most: usize,
    },
}
