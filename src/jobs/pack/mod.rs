//! `oct pack` and `oct unpack`: the two encodings of one content, lossless both ways (SPEC 5); `oct strip`: a part of
//! it.

mod decode;
mod encode;
mod follow;
mod groups;
mod split;
mod stored;
mod stream;
mod strip;

pub(crate) use decode::unpack_file;
pub(crate) use split::split;
pub use strip::{StripRequest, strip};

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use super::export::refuse_input;
use super::info::ratio;
use crate::atomic::AtomicFile;
use crate::budget::{Bytes, peak_rss_bytes};
use crate::error::Error;
use crate::fault::conversions;
use crate::format::packed::CodingError;
use crate::format::{FormatError, SurfaceKind};
use crate::load::{Fault, FileIdentity, Frame, LoadError, LoadFault, ReadAt};
use crate::platform::{PositionalFile, give_back};
use crate::progress::{Progress, Silent, Stopped};
use crate::text::{data, shown};
use strip::StripStop;

/// Why packing stopped: at the input, or at the output.
#[derive(Debug)]
pub(crate) enum Stop {
    /// The input is wrong or cannot be read.
    Input(Fault),
    /// The output cannot be written or read back.
    Output(io::Error),
}

conversions!(Stop {
    fault: Fault => Self::Input(fault),
    cause: FormatError => Self::Input(Fault::Format(cause)),
    cause: CodingError => FormatError::from(cause).into(),
});

/// Figures of packing or unpacking.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PackReport {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Output as named on the command line.
    pub output: String,
    /// Size of the input file.
    pub bytes_in: u64,
    /// Size of the file that was written or read.
    #[serde(rename = "bytes")]
    pub bytes_out: u64,
    /// Skin voxels of the model.
    pub skin_voxels: u64,
    /// `bytes` per skin voxel.
    pub bytes_per_skin_voxel: f64,
    #[serde(skip)]
    pub(crate) surface: SurfaceKind,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

impl PackReport {
    /// Report in one sentence.
    pub fn text(&self) -> String {
        format!(
            "{}: {} -> {} ({:.4} bytes per {})\n",
            shown(&self.output),
            Bytes(self.bytes_in),
            Bytes(self.bytes_out),
            self.bytes_per_skin_voxel,
            super::info::noun(self.surface)
        )
    }
}

/// Packs a mapped file. The input is verified first, so that only sound models are archived.
///
/// Memory: under 8 MiB, measured on a model of 8.3 million skin voxels; a model most of whose boxes are voxels may take
/// more. Cost: below 0.5 microseconds per skin voxel.
///
/// # Errors
/// The input is damaged, foreign or packed already, or is written to meanwhile; the output cannot be written. A file at
/// `output` is untouched then.
pub fn pack(input: &Path, output: &Path) -> Result<PackReport, Error> {
    pack_with(input, output, &Silent)
}

/// As [`pack`], until [`Progress::stopped`] returns true: it is asked whenever a part of the input is read. No stage is
/// reported.
///
/// # Errors
/// As [`pack`], and [`Error::Stopped`].
pub fn pack_with(input: &Path, output: &Path, progress: &dyn Progress) -> Result<PackReport, Error> {
    convert(input, output, progress, |source, out| Ok(encode::pack_file(source, out)?))
}

/// Unpacks a packed file into the mapped file that it was made from, byte for byte.
///
/// # Errors
/// As [`pack`].
pub fn unpack(input: &Path, output: &Path) -> Result<PackReport, Error> {
    unpack_with(input, output, &Silent)
}

/// As [`unpack`], with the stop of [`pack_with`].
///
/// # Errors
/// As [`pack_with`].
pub fn unpack_with(input: &Path, output: &Path, progress: &dyn Progress) -> Result<PackReport, Error> {
    convert(input, output, progress, |source, out| Ok(unpack_file(source, out)?))
}

/// A file that cannot be read any more once the job is stopped, which ends all readers.
struct Stoppable<'a> {
    file: &'a PositionalFile,
    progress: &'a dyn Progress,
}

impl ReadAt for Stoppable<'_> {
    fn byte_len(&self) -> io::Result<u64> {
        self.file.byte_len()
    }

    fn read_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        self.progress.check().map_err(io::Error::other)?;
        self.file.read_exact_at(out, offset)
    }
}

fn convert(
    input: &Path,
    output: &Path,
    progress: &dyn Progress,
    work: impl FnOnce(&Stoppable<'_>, &File) -> Result<Frame, StripStop>,
) -> Result<PackReport, Error> {
    let start = Instant::now();
    let unreadable = |cause| LoadError::from(LoadFault::Unreadable { path: input.to_path_buf(), cause });
    let unwritable = |cause| Error::Output { path: output.to_path_buf(), cause };
    let source = PositionalFile::open(input).map_err(unreadable)?;
    refuse_input(input, output)?;
    let then = FileIdentity::of(&source).map_err(unreadable)?;
    // The input's frame first: a foreign file is refused before anything is said about the output.
    Frame::read(&source).map_err(|fault| fault.at(input))?;
    let out = AtomicFile::create(output).map_err(unwritable)?;
    let stopped = |stop| match stop {
        Stop::Input(Fault::Io(cause)) if cause.get_ref().is_some_and(|inner| inner.is::<Stopped>()) => {
            Error::Stopped
        }
        Stop::Input(fault) => Error::Load(fault.at(input)),
        Stop::Output(cause) => unwritable(cause),
    };
    // The program's start is over; its pages would count in a job of a few MiB.
    give_back();
    let done = work(&Stoppable { file: &source, progress }, out.file());
    // An input overwritten meanwhile is a mixture of two models, in which any fault may be found.
    then.check(&source, input)?;
    let frame = done.map_err(|stop| stop.at(input, stopped))?;
    if progress.stopped() {
        return Err(Error::Stopped);
    }
    out.commit().map_err(unwritable)?;
    Ok(PackReport {
        input: data(input),
        output: data(output),
        bytes_in: source.byte_len().map_err(unreadable)?,
        bytes_out: frame.header.file_bytes,
        skin_voxels: frame.header.voxels,
        bytes_per_skin_voxel: ratio(frame.header.file_bytes, frame.header.voxels),
        surface: frame.surface(),
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: start.elapsed().as_secs_f64(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembled::{AssembledVoxel, OptionalSections, assemble, plain_metadata};
    use crate::format::normal;

    /// A bumpy sheet through a box: every kind of neighbourhood, several subtrees.
    pub(super) fn sheet(dims: [u32; 3], channels: OptionalSections) -> Vec<u8> {
        let places = (0..dims[1]).flat_map(|y| (0..dims[0]).map(move |x| [x, y]));
        let voxel = |[x, y]: [u32; 2]| AssembledVoxel {
            cell: [x, y, (x * x / 7 + y * 3 + (x * y) % 5) % dims[2]],
            normal: normal::encode([x as f32 - 9.0, y as f32 - 5.0, 7.0]),
            value: u16::try_from(x * y % 200).unwrap_or(0),
        };
        let voxels: Vec<_> = places.map(voxel).collect();
        assemble(&plain_metadata(dims, channels), &voxels, channels)
    }

    /// Parts read from two models can pass every checksum.
    #[test]
    fn nothing_is_made_of_a_model_that_is_overwritten_meanwhile() {
        let folder = tempfile::tempdir().unwrap();
        let (input, output) = (folder.path().join("m.oct"), folder.path().join("n.oct"));
        let channels = OptionalSections { normal: true, value_bytes: 0, lod: true };
        let overwrite = || {
            let file = std::fs::OpenOptions::new().write(true).open(&input).unwrap();
            crate::platform::FileExt::write_all_at(&file, &[0x5a], 5000).unwrap();
            file.set_modified(std::time::SystemTime::now() + std::time::Duration::from_secs(2)).unwrap();
        };
        type Work<'a> = &'a dyn Fn(&Stoppable<'_>, &File) -> Result<Frame, StripStop>;
        let pack: Work<'_> = &|source, out| Ok(encode::pack_file(source, out)?);
        let strip: Work<'_> = &|source, out| strip::strip_file(source, out, &StripRequest::default());
        for (before, work) in [(false, pack), (true, pack), (false, strip), (true, strip)] {
            std::fs::write(&input, sheet([64, 64, 64], channels)).unwrap();
            let made = convert(&input, &output, &Silent, |source, out| {
                if before {
                    overwrite();
                }
                let made = work(source, out);
                if !before {
                    overwrite();
                }
                made
            });
            let told = made.unwrap_err();
            assert!(told.to_string().contains("was changed while it was in use"), "{told}");
            assert_eq!(told.kind(), crate::ExitKind::Input);
            assert!(!output.exists());
        }
    }
}
