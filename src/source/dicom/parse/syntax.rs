//! Transfer syntaxes (PS3.5 annex A, PS3.6 annex A): how elements and pixels are encoded.

use std::fmt;

/// Encoding of a file's elements and pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TransferSyntax {
    /// 1.2.840.10008.1.2: no VR in the file, little-endian, native pixels.
    ImplicitLe,
    /// 1.2.840.10008.1.2.1: native pixels.
    ExplicitLe,
    /// 1.2.840.10008.1.2.2 (retired): native pixels.
    ExplicitBe,
    /// 1.2.840.10008.1.2.1.99: everything after the meta header is one deflate stream.
    Deflated,
    /// Explicit little-endian elements around compressed or wrapped frames.
    Encapsulated(String),
    /// A UID that is not known here.
    Unknown(String),
}

const ROOT: &str = "1.2.840.10008.1.2";

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

impl TransferSyntax {
    /// Classifies a UID; never fails.
    pub fn from_uid(uid: &str) -> Self {
        match uid.strip_prefix(ROOT) {
            Some("") => Self::ImplicitLe,
            Some(".1") => Self::ExplicitLe,
            Some(".2") => Self::ExplicitBe,
            Some(".1.99") => Self::Deflated,
            Some(".5" | ".1.98") => Self::Encapsulated(uid.into()),
            // All of branch 4 are codecs, those not in the table (MPEG-4, HEVC) included.
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

    /// Are pixels stored as plain integers at one offset?
    pub fn is_native(&self) -> bool {
        matches!(self, Self::ImplicitLe | Self::ExplicitLe | Self::ExplicitBe)
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
        let Self::Encapsulated(uid) = self else { return None };
        match uid.strip_prefix(ROOT)? {
            ".1.98" => Some(Codec::None),
            ".5" => Some(Codec::Rle),
            ".4.50" | ".4.51" | ".4.57" | ".4.70" => Some(Codec::Jpeg),
            ".4.53" | ".4.55" => Some(Codec::JpegPasses),
            ".4.80" | ".4.81" => Some(Codec::JpegLs),
            ".4.90" | ".4.91" | ".4.92" | ".4.93" | ".4.201" | ".4.202" | ".4.203" => Some(Codec::Jpeg2000),
            _ => None,
        }
    }

    /// What can be done about pixels that are not decoded, as the end of a sentence. The converter named for
    /// JPEG XL writes uncompressed DICOM by default; DCMTK knows the syntaxes by name only, and `djxl` opens
    /// no DICOM.
    pub(crate) fn remedy(&self) -> &'static str {
        match self.uid().strip_prefix(ROOT) {
            Some(".4.110" | ".4.111" | ".4.112") => {
                "; convert the file first, for example with dcm2dcm of dcm4che"
            }
            _ => "",
        }
    }
}

impl fmt::Display for TransferSyntax {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImplicitLe => f.write_str("implicit little-endian"),
            Self::ExplicitLe => f.write_str("explicit little-endian"),
            Self::ExplicitBe => f.write_str("explicit big-endian"),
            Self::Deflated => f.write_str("deflated"),
            Self::Encapsulated(uid) => {
                let known = ENCAPSULATED.iter().find(|(tail, _)| uid.strip_prefix(ROOT) == Some(tail));
                match known {
                    Some((_, name)) => f.write_str(name),
                    None => write!(f, "compressed, {uid}"),
                }
            }
            Self::Unknown(uid) => write!(f, "unknown syntax {uid}"),
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
        for (tail, name) in ENCAPSULATED {
            let syntax = TransferSyntax::from_uid(&format!("{ROOT}{tail}"));
            assert!(matches!(syntax, TransferSyntax::Encapsulated(_)), "{tail}");
            assert_eq!(syntax.to_string(), name);
        }
        assert_eq!(TransferSyntax::from_uid("1.2.840.10008.1.2.1.99"), TransferSyntax::Deflated);
        for odd in ["", "1.2.840.10008.1.20", "1.2.840.113619.5.2"] {
            assert_eq!(TransferSyntax::from_uid(odd), TransferSyntax::Unknown(odd.into()));
        }
    }
}
