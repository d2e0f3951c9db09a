//! Sentences about files that are left out, and about the choice among several volumes.

use std::fmt;

use super::error::Reason;
use crate::facts::{Candidate, Choice, Known, NotVolume, Refusal};

impl fmt::Display for NotVolume {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => f.write_str("empty file"),
            Self::Unreadable(kind) => write!(f, "cannot be read ({kind})"),
            Self::Dicom(kind) => kind.fmt(f),
            Self::ModelPicture => f.write_str("picture of a model"),
            Self::SinglePicture => f.write_str("single picture, no stack"),
            Self::Mesh => f.write_str("a triangle mesh, which is taken with --grid N or --voxel MM only"),
            Self::Tree => f.write_str("a tree of solids, which is taken with --grid N or --voxel MM only"),
            Self::Known(known) => known.fmt(f),
            Self::OtherSideCar => f.write_str("another side-car describes the same data"),
            Self::SideCar(unparsed) => unparsed.fmt(f),
            Self::Headerless => f.write_str(
                "headerless voxels by its name, which lack a side-car: write NAME.json beside NAME.raw, or beside the folder NAME of slices, with {\"dims\": [512, 512, 300], \"dtype\": \"u16\", \"spacing\": [0.5, 0.5, 1.0]}",
            ),
            Self::Unknown => f.write_str("not a volume"),
            Self::FolderUnreadable => f.write_str("folder that cannot be read"),
            Self::LinkedFolder => {
                f.write_str("folder that a link leads to, which is searched with --follow-links only")
            }
            Self::FolderTooDeep => f.write_str("folder that lies too deep to be searched"),
            Self::Other => f.write_str("left out for other reasons"),
        }
    }
}

impl fmt::Display for Known {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Gzip => "a gzip file, but of no volume that is read",
            Self::Jpeg => "a JPEG image",
            Self::Ply => "a PLY mesh",
            Self::Off => "an OFF mesh",
            Self::Oct => "an .oct model, not a volume",
        })
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { found, asked_for, used, others, more } = self;
        let why = if *asked_for { "the chosen one" } else { "the largest that forms a volume" };
        write!(f, "{found} sets of images were found; {why} is used ({used}); not used: ")?;
        for (i, other) in others.iter().enumerate() {
            write!(f, "{}{other}", if i > 0 { "; " } else { "" })?;
        }
        if *more > 0 { write!(f, "; and {more} more") } else { Ok(()) }
    }
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.kind)?;
        if let Some(part) = &self.part {
            write!(f, " {part}")?;
        }
        if let Some([x, y, z]) = self.size {
            write!(f, " {x}x{y}x{z}")?;
        }
        match &self.refused {
            Some(Refusal(error)) => write!(f, ", refused: {}", Reason(error)),
            None => Ok(()),
        }
    }
}
