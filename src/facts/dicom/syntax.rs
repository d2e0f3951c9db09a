//! Transfer syntaxes (PS3.5 annex A, PS3.6 annex A): how elements and pixels are encoded.

/// Encoding of a file's elements and pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum TransferSyntax {
    /// 1.2.840.10008.1.2: no VR in the file, little-endian, native pixels. DICOM's default.
    #[default]
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

impl TransferSyntax {
    /// Classifies a UID; never fails.
    pub fn from_uid(uid: &str) -> Self {
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

    /// Are pixels stored as plain integers at one offset?
    pub fn is_native(&self) -> bool {
        matches!(self, Self::ImplicitLe | Self::ExplicitLe | Self::ExplicitBe)
    }

    /// What sets an encapsulated syntax apart: the UID without the root of the standard's transfer syntaxes.
    pub(crate) fn tail(&self) -> Option<&str> {
        if let Self::Encapsulated(uid) = self { uid.strip_prefix(ROOT) } else { None }
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
}
