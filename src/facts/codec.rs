//! Why compressed frames cannot be decoded: what the decoders say, which are not public themselves.

pub use crate::codec::{CodecError, Damage, Feature, Mismatch};

/// What can be wrong with JPEG images.
pub mod jpeg {
    pub use crate::codec::jpeg::{Damage, Feature};
}

/// What can be wrong with JPEG 2000 images.
pub mod jpeg2000 {
    pub use crate::codec::jpeg2000::{Damage, Feature};
}

/// What can be wrong with JPEG-LS images.
pub mod jpegls {
    pub use crate::codec::jpegls::{Damage, Feature, Parameter, SegmentKind};
}

/// What can be wrong with RLE frames.
pub mod rle {
    pub use crate::codec::rle::{Damage, Feature};
}
