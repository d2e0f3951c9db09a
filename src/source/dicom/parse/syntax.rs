//! Transfer syntaxes (PS3.5 annex A, PS3.6 annex A): how elements and pixels are encoded, and which are decoded here.

use std::fmt;

/// Encoding of a file's elements and pixels.
#[expect(missing_docs, reason = "the sentence of each variant says it")]
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum TransferSyntax {
    /// DICOM's default: no VR in the file.
    #[default]
    ImplicitLe,
    ExplicitLe,
    ExplicitBe,
    Deflated,
    /// Explicit little-endian elements around compressed or wrapped frames.
    Encapsulated(String),
    Unknown(String),
}

impl fmt::Display for TransferSyntax {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImplicitLe => f.write_str("implicit little-endian"),
            Self::ExplicitLe => f.write_str("explicit little-endian"),
            Self::ExplicitBe => f.write_str("explicit big-endian"),
            Self::Deflated => f.write_str("deflated"),
            Self::Encapsulated(uid) => {
                match ENCAPSULATED.iter().find(|(tail, _)| self.tail() == Some(tail)) {
                    Some((_, name)) => f.write_str(name),
                    None => write!(f, "compressed, {uid}"),
                }
            }
            Self::Unknown(uid) => write!(f, "unknown syntax {uid}"),
        }
    }
}

/// Encapsulated syntaxes by the tail of their UID.
const ENCAPSULATED: [(&str, &str); 23] = [
    (".1.98", "uncompressed, encapsulated"),
    (".4.50", "JPEG baseline"),
    (".4.51", "JPEG extended 12-bit"),
    (".4.53", "JPEG spectral selection, retired"),
    (".4.55", "JPEG progressive, retired"),
    (".4.57", "JPEG lossless"),
    (".4.70", "JPEG lossless, first-order prediction"),
    (".4.80", "JPEG-LS lossless"),
    (".4.81", "JPEG-LS near-lossless"),
    (".4.90", "JPEG 2000 lossless"),
    (".4.91", "JPEG 2000"),
    (".4.92", "JPEG 2000 multi-component lossless"),
    (".4.93", "JPEG 2000 multi-component"),
    (".4.94", "JPIP referenced"),
    (".4.95", "JPIP referenced deflate"),
    (".4.100", "MPEG-2"),
    (".4.110", "JPEG XL lossless"),
    (".4.111", "JPEG XL JPEG recompression"),
    (".4.112", "JPEG XL"),
    (".4.201", "HTJ2K lossless"),
    (".4.202", "HTJ2K lossless RPCL"),
    (".4.203", "HTJ2K"),
    (".5", "RLE lossless"),
];

const ROOT: &str = "1.2.840.10008.1.2";

impl TransferSyntax {
    /// Classifies a UID; never fails.
    pub(crate) fn from_uid(uid: &str) -> Self {
        match uid.strip_prefix(ROOT) {
            Some("") => Self::ImplicitLe,
            Some(".1") => Self::ExplicitLe,
            Some(".2") => Self::ExplicitBe,
            Some(".1.99") => Self::Deflated,
            Some(".5" | ".1.98") => Self::Encapsulated(uid.into()),
            // All of branch 4 are codecs, those without a name here (MPEG-4, HEVC) included.
            Some(tail) if tail.starts_with(".4.") => Self::Encapsulated(uid.into()),
            _ => Self::Unknown(uid.into()),
        }
    }

    /// The UID.
    pub fn uid(&self) -> &str {
        match self {
            Self::ImplicitLe => ROOT,
            Self::ExplicitLe => "1.2.840.10008.1.2.1",
            Self::ExplicitBe => "1.2.840.10008.1.2.2",
            Self::Deflated => "1.2.840.10008.1.2.1.99",
            Self::Encapsulated(uid) | Self::Unknown(uid) => uid,
        }
    }

    /// True if pixels are stored as plain integers at one offset.
    pub(crate) fn is_native(&self) -> bool {
        matches!(self, Self::ImplicitLe | Self::ExplicitLe | Self::ExplicitBe)
    }

    /// Remedy for pixels that are not decoded, as the end of a sentence. The converter named for JPEG XL writes
    /// uncompressed DICOM by default; DCMTK knows the syntaxes by name only, and `djxl` opens no DICOM.
    pub(crate) fn remedy(&self) -> &'static str {
        match self.tail() {
            Some(".4.110" | ".4.111" | ".4.112") => {
                "; convert the file first, for example with dcm2dcm of dcm4che"
            }
            _ => "",
        }
    }

    /// Distinctive part of an encapsulated syntax: the UID without the root of the standard's transfer syntaxes.
    pub(crate) fn tail(&self) -> Option<&str> {
        if let Self::Encapsulated(uid) = self { uid.strip_prefix(ROOT) } else { None }
    }
}

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

    /// True if a fragment with these first bytes begins a codestream.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uids_come_back_and_are_classified() {
        for uid in [ROOT, "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.2"] {
            let syntax = TransferSyntax::from_uid(uid);
            assert!(syntax.is_native() && syntax.uid() == uid, "{uid}");
        }
        for tail in [".1.98", ".5", ".4.50", ".4.203", ".4.102"] {
            let syntax = TransferSyntax::from_uid(&format!("{ROOT}{tail}"));
            assert_eq!(syntax.tail(), Some(tail));
        }
        assert_eq!(TransferSyntax::from_uid("1.2.840.10008.1.2.1.99"), TransferSyntax::Deflated);
        for odd in ["", "1.2.840.10008.1.20", "1.2.840.113619.5.2"] {
            assert_eq!(TransferSyntax::from_uid(odd), TransferSyntax::Unknown(odd.into()));
        }
    }
    #[test]
    fn every_named_syntax_is_encapsulated() {
        for (tail, name) in ENCAPSULATED {
            let syntax = TransferSyntax::from_uid(&format!("1.2.840.10008.1.2{tail}"));
            assert!(matches!(syntax, TransferSyntax::Encapsulated(_)), "{tail}");
            assert_eq!(syntax.to_string(), name);
        }
    }
}
