//! What stops a job: the gathered error, wrong requests, and the system's refusals that have a reason of ours.

use std::fmt;

use super::foreign::shown;
use super::system::writing;
use crate::atomic::TargetFault;
use crate::budget::Bytes;
use crate::error::{Error, StripFault, UsageError};
use crate::export::ExportFault;
use crate::progress::Stopped;
use crate::scratch::NoRoom;

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(inner) => inner.fmt(f),
            Self::Source(inner) => inner.fmt(f),
            Self::Build(inner) => inner.fmt(f),
            Self::Clean(inner) => inner.fmt(f),
            Self::Format(inner) => inner.fmt(f),
            Self::Load(inner) => inner.fmt(f),
            Self::Render(inner) => inner.fmt(f),
            Self::Scene(inner) => inner.fmt(f),
            Self::Stopped => Stopped.fmt(f),
            Self::Busy { path } => write!(
                f,
                "{}: another batch is writing into this folder; wait until it has finished, or choose another folder with --out",
                shown(path)
            ),
            Self::Output { path, cause } => {
                write!(f, "{}: cannot be written ({cause}); {}", shown(path), writing(cause))
            }
            Self::Internal => {
                f.write_str("an internal error stopped its conversion; please report it with the file")
            }
        }
    }
}

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("stopped by its caller; nothing was written")
    }
}

impl fmt::Display for UsageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::KeepsPart { path, seen_from } => write!(
                f,
                "{}: keeps only what can be seen (--visible-from {seen_from}), so that its inside is not known; build it without --visible-from, or write its skin with --as points, or a mask with --skin",
                shown(path)
            ),
            Self::ReplacesInput { path, folder: true } => write!(
                f,
                "{}: is the input, or part of it, and would be replaced by the model; name another file with --output",
                shown(path)
            ),
            Self::ReplacesInput { path, folder: false } => write!(
                f,
                "{}: is the input, and would be replaced; name another file with --output",
                shown(path)
            ),
            Self::ReplacesModel { path } => write!(
                f,
                "{}: is the model and would be replaced by a picture; name another file",
                shown(path)
            ),
            Self::NamedTwice { path } => {
                write!(
                    f,
                    "{}: two pictures would be written to it; name another file for one of them",
                    shown(path)
                )
            }
            Self::Strip { path, fault } => {
                write!(f, "{}: ", shown(path))?;
                match fault {
                    StripFault::Cells => f.write_str(
                        "of cells the channels are the surface, and coarse boxes do not have it; only --lod off leaves something out",
                    ),
                    StripFault::Levels { asked, most } => write!(
                        f,
                        "does not have {asked} levels to leave out; choose --levels 0 to {most}"
                    ),
                    StripFault::NoMeans { channel } => write!(
                        f,
                        "coarse boxes have no mean of the channel '{channel}'; leave it out with --channels"
                    ),
                    StripFault::FineAlone => {
                        f.write_str("the channel 'fine' refines 'normal'; keep both, or leave out both")
                    }
                    StripFault::NoChannel { channel } => {
                        write!(f, "does not have the channel '{channel}'; oct info names those that it has")
                    }
                }
            }
            Self::Export { path, fault } => write!(f, "{}: {fault}", shown(path)),
            Self::FlatPlacement { path } => write!(
                f,
                "{}: the placement leaves it without a volume; give three rows that are not parallel, as in 1,0,0,0,0,1,0,0,0,0,1,0",
                shown(path)
            ),
            Self::HeadSize { side } => {
                write!(f, "a head of {side} voxels a side cannot be made; choose 1 to 65536")
            }
        }
    }
}

impl fmt::Display for ExportFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLong { needed } => write!(
                f,
                "{needed} corners, triangles or bytes are more than the format can count; leave fine levels out of the model first, with oct strip --levels"
            ),
            Self::TooBroad { blocks } => write!(
                f,
                "a slice of {blocks} blocks is more than is kept in memory; choose a larger --simplify, or 0"
            ),
            Self::TooWide { side } => write!(
                f,
                "a side of {side} voxels is longer than NIfTI-1 can state (32767); write NRRD instead"
            ),
        }
    }
}

impl fmt::Display for TargetFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::DanglingLink => "it is a link to a place that does not exist",
            Self::NotRegular => "it exists and is not a regular file",
            Self::NoFileName => "it is not a file name",
            Self::NoFreeName => "no free temporary name in the folder",
        })
    }
}

impl fmt::Display for NoRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} are needed, and {} are free", Bytes(self.needed_bytes), Bytes(self.free_bytes))
    }
}
