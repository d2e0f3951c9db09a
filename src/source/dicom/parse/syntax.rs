//! The transfer syntaxes that are decoded here (PS3.5 annex A).

use crate::facts::dicom::TransferSyntax;

/// A way of compressing frames that is decoded here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Codec {
    /// Uncompressed frames in fragments (.1.98).
    None,
    /// JPEG: baseline, extended, lossless.
    Jpeg,
    /// JPEG whose pixels come in several passes, so that a frame is held whole.
    JpegPasses,
    /// JPEG-LS.
    JpegLs,
    /// JPEG 2000 and its high-throughput variant.
    Jpeg2000,
    /// RLE.
    Rle,
}

impl Codec {
    pub(crate) fn is_jpeg2000(self) -> bool {
        self == Self::Jpeg2000
    }

    /// Does a fragment with these first bytes begin a codestream?
    pub(crate) fn begins(self, bytes: [u8; 4]) -> bool {
        match self {
            Self::Jpeg | Self::JpegPasses | Self::JpegLs => bytes.starts_with(&[0xff, 0xd8, 0xff]),
            // A bare codestream, or the signature box of a JP2 file, which some programs leave around it.
            Self::Jpeg2000 => bytes == [0xff, 0x4f, 0xff, 0x51] || bytes == [0, 0, 0, 12],
            Self::None | Self::Rle => false,
        }
    }
}

impl TransferSyntax {
    /// The codec of an encapsulated syntax, if it is one that is decoded here.
    pub(crate) fn codec(&self) -> Option<Codec> {
        match self.tail()? {
            ".1.98" => Some(Codec::None),
            ".5" => Some(Codec::Rle),
            ".4.50" | ".4.51" | ".4.57" | ".4.70" => Some(Codec::Jpeg),
            ".4.53" | ".4.55" => Some(Codec::JpegPasses),
            ".4.80" | ".4.81" => Some(Codec::JpegLs),
            ".4.90" | ".4.91" | ".4.92" | ".4.93" | ".4.201" | ".4.202" | ".4.203" => Some(Codec::Jpeg2000),
            _ => None,
        }
    }
}
