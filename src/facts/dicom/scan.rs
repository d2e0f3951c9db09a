//! Why the elements of a file cannot be followed.

use std::fmt::{self, Display, Formatter};
use std::io;

use thiserror::Error;

use crate::facts::SystemError;

/// Why bytes of a file cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ReadFault {
    #[error("{0}")]
    System(SystemError),
    #[error("{0}")]
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
    #[error("its deflate stream is damaged")]
    Damaged,
    #[error("its deflate stream is longer than {bytes} bytes before the pixels")]
    LongHeader { bytes: u64 },
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
#[expect(missing_docs, reason = "the sentence of each variant says it")]
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ScanError {
    #[error("cannot be read ({0})")]
    Io(ReadFault),
    #[error("is not a DICOM file")]
    NotDicom,
    #[error("is a damaged DICOM file: {damage} (at byte {offset})")]
    Damaged { offset: u64, damage: Damage },
}

impl From<io::Error> for ScanError {
    fn from(error: io::Error) -> Self {
        Self::Io(error.into())
    }
}

/// What is wrong with an element, or with what it holds; tags have the group in their high 16 bits.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Damage {
    #[error("the file ends inside an element")]
    EndsInElement,
    #[error("the file ends inside the head of {}", Tag(*.0))]
    EndsInHead(u32),
    #[error("{} declares {declared} bytes, but {left} are left", Tag(*.tag))]
    LongElement { tag: u32, declared: u32, left: u64 },
    #[error("{} has no length where it needs one", Tag(*.0))]
    NoLength(u32),
    #[error("{} stands where an item must", Tag(*.0))]
    NoItem(u32),
    #[error("sequences are nested more than {most} deep")]
    Nesting { most: usize },
    #[error("{0}")]
    Deflate(DeflateFault),
    #[error("the Slice Vector (0054,0080) numbers {numbered} of {frames} frames")]
    SliceVector { numbered: u32, frames: u32 },
    #[error("the grid frame offset vector has no number for frame {}", u64::from(*.0) + 1)]
    GridOffset(u32),
    #[error("the modality LUT has no descriptor")]
    LutWithoutDescriptor,
    #[error("the modality LUT is incomplete")]
    IncompleteLut,
    #[error("the palettes of red, green and blue differ in size")]
    PalettesDiffer,
    #[error("the palette has no descriptor")]
    PaletteWithoutDescriptor,
    #[error("the descriptor of a table is cut short")]
    ShortDescriptor,
    #[error("a table has entries of {0} bits")]
    EntryBits(u16),
    #[error("a table of {entries} entries has {bytes} bytes")]
    ShortTable { entries: usize, bytes: usize },
    #[error("the file ends inside a table")]
    EndsInTable,
    #[error("the compressed pixels are not in items")]
    NotInItems,
    #[error(
        "the compressed pixels are {fragments} fragments with {begun} beginnings, which cannot be told apart into the {frames} frames stated"
    )]
    Fragments { fragments: u64, begun: u64, frames: u32 },
    #[error("the compressed pixels end before frame {}", u64::from(*.0) + 1)]
    NoFragment(u32),
    #[error("one frame is cut into more than {most} fragments")]
    ManyFragments { most: usize },
}

/// A tag as the standard writes it.
struct Tag(u32);

impl Display for Tag {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "element ({:04X},{:04X})", self.0 >> 16, self.0 & 0xffff)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_says_comes_through() {
        let missing = io::Error::from_raw_os_error(2);
        assert_eq!(SystemError::from(&missing).to_string(), missing.to_string());
        let fault: ReadFault = io::Error::from(DeflateFault::Damaged).into();
        assert_eq!(fault, ReadFault::Deflate(DeflateFault::Damaged));
    }
}
