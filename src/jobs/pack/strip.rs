//! `oct strip`: a finished model without some channels or fine levels.
//!
//! Channels and means that stay are copied. Where fine levels go, the boxes of the finest remaining level become the
//! voxels: their items are the means of all voxels within, and the means of coarser nodes are made anew from them.
//! Everything is read and written from front to back. Memory: as [`crate::load::verify()`], under 3 MiB for any model.
//! Cost: the model is verified, then read once or twice more.

use std::fs::File;
use std::path::Path;

use super::Stop;
use super::encode::finish_frame;
use super::stream::{BUFFER_BYTES, Writer, crc_of};
use super::{PackReport, convert, decode, unpack_file};
use crate::error::Error;
use crate::fault::{self, conversions, usage};
use crate::format::{Channel, Channels, Encoding, SectionEntry, SectionKind, SurfaceKind, damaged};
use crate::geom::{Dims, Level};
use crate::jobs::open_model::scratch_beside;
use crate::load::{Cursor, Fault, Frame, ReadAt, verify, walk, walked_channels};
use crate::progress::Silent;
use crate::text::names::{CHANNELS, INFO, LEVELS, LOD};

/// Parts to be left out of a model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StripRequest {
    /// Channels that stay; `None` for all.
    pub channels: Option<Channels>,
    /// Number of finest levels to leave out: each makes boxes twice as long.
    pub levels: u32,
    /// True to keep the means of coarse nodes where they exist.
    pub lod: bool,
}

/// Writes a model without the parts that the request leaves out, in the mapped form. A packed one is unpacked into an
/// unnamed file beside the output first.
///
/// # Errors
/// The input is damaged or foreign; the request does not fit it; the output cannot be written. A file at
/// `output` is untouched then.
pub fn strip(input: &Path, output: &Path, request: &StripRequest) -> Result<PackReport, Error> {
    convert(input, output, &Silent, |source, out| {
        if Frame::read(source)?.header.encoding == Encoding::Mapped {
            return strip_file(source, out, request);
        }
        let mapped = scratch_beside(output).map_err(Stop::Output)?;
        unpack_file(source, &mapped)?;
        strip_file(&mapped, out, request)
    })
}

/// Reason for stopping.
pub(super) enum StripStop {
    Stop(Stop),
    Request(fault::Fault),
}

impl<T: Into<Stop>> From<T> for StripStop {
    fn from(cause: T) -> Self {
        Self::Stop(cause.into())
    }
}

conversions!(StripStop { fault: fault::Fault => Self::Request(fault) });

impl StripStop {
    pub(super) fn at(self, input: &Path, other: impl FnOnce(Stop) -> Error) -> Error {
        match self {
            Self::Stop(stop) => other(stop),
            Self::Request(fault) => fault.at(input).into(),
        }
    }
}

pub(super) fn strip_file<R: ReadAt + ?Sized>(
    source: &R,
    out: &File,
    request: &StripRequest,
) -> Result<Frame, StripStop> {
    let frame = verify(source)?;
    let kept = kept_channels(&frame, request)?;
    let mut left = lay_out(&frame, kept, request)?;
    for entry in left.sections.clone() {
        match entry.kind {
            Some(SectionKind::Meta) => write_all(out, &entry, &left.metadata_bytes)?,
            Some(SectionKind::Levels) => {
                let bytes: Vec<u8> = left.levels.iter().flat_map(|l| l.to_le_bytes()).collect();
                write_all(out, &entry, &bytes)?;
            }
            Some(SectionKind::Rank | SectionKind::Means(_)) => {}
            Some(SectionKind::Voxels(_)) if request.levels > 0 => {}
            _ => copy(source, &frame, out, &entry)?,
        }
    }
    if request.levels > 0 {
        coarsen(source, &frame, out, &left)?;
    }
    complete(&mut left, out)?;
    Ok(left)
}

/// Writes the sections that follow from the infobytes and items in `out`: directory, means, checksums, table and
/// header.
pub(super) fn complete(left: &mut Frame, out: &File) -> Result<(), Stop> {
    decode::rebuild_rank(left, out)?;
    if left.sections.iter().any(|e| matches!(e.kind, Some(SectionKind::Means(_)))) {
        decode::rebuild_means(out, left, out)?;
    }
    out.set_len(left.header.file_bytes).map_err(Stop::Output)?;
    for entry in &mut left.sections {
        let crc = crc_of(out, entry)?;
        (entry.stored_crc, entry.content_crc) = (crc, crc);
    }
    finish_frame(left, out)
}

/// The channels that stay, if the request fits the model.
fn kept_channels(frame: &Frame, request: &StripRequest) -> Result<Channels, fault::Fault> {
    let there: Channels = frame.channels().map(|(channel, _)| channel).collect();
    let kept = request.channels.unwrap_or(there);
    if let Some(channel) = kept.iter().find(|c| !there.contains(*c)) {
        return Err(usage!("does not have the channel '{channel}'; {INFO} names those that it has"));
    }
    if frame.surface() == SurfaceKind::Cells && (kept != there || request.levels > 0) {
        return Err(usage!(
            "a model of cells stores its surface in its channels and finest boxes, so both must stay; only {LOD} off removes something"
        ));
    }
    let depth = frame.dims().depth();
    if request.levels > 0 && request.levels >= depth {
        let (asked, most) = (request.levels, depth.saturating_sub(1));
        return Err(usage!("does not have {asked} levels to leave out; choose {LEVELS} 0 to {most}"));
    }
    let mean = |channel: &Channel| channel.row().means.is_some();
    match kept.iter().find(|channel| request.levels > 0 && !mean(channel)) {
        Some(channel) => {
            Err(usage!("coarse boxes have no mean of the channel '{channel}'; leave it out with {CHANNELS}"))
        }
        None => Ok(kept),
    }
}

/// The frame of the result: header, sections, metadata and levels, without checksums.
fn lay_out(frame: &Frame, kept: Channels, request: &StripRequest) -> Result<Frame, Stop> {
    let mut left = frame.clone();
    let edge = 1_u32 << request.levels;
    let depth = frame.dims().depth() - request.levels;
    if request.levels > 0 {
        let [nx, ny, nz] = frame.dims().to_array().map(|n| n.div_ceil(edge));
        left.header.dims = Dims::new(nx, ny, nz).ok_or_else(|| damaged("dims are outside 1..=65536"))?;
        left.metadata.dims = [nx, ny, nz];
        // The middle of the first box is the mean of the voxels within.
        let middle = frame.affine().apply([0.5 * f64::from(edge - 1); 3]);
        for (row, at) in left.metadata.affine.iter_mut().zip(middle) {
            row[..3].iter_mut().for_each(|step| *step *= f64::from(edge));
            row[3] = at;
        }
        left.metadata.spacing_mm = left.metadata.spacing_mm.map(|s| s * f64::from(edge));
        let finest = frame.level(Level::new(depth));
        left.header.voxels = finest.end - finest.start;
        left.header.nodes = finest.start;
        left.levels.truncate(depth as usize + 1);
    }
    if !kept.contains(Channel::Normal) {
        left.metadata.gradient = String::new();
    }
    if !kept.contains(Channel::Value) {
        left.metadata.value_scale = [0.0; 2];
    }
    if !kept.contains(Channel::Steepness) {
        left.metadata.noise = None;
    }
    left.metadata_bytes = left.metadata.to_bytes()?;
    left.sections.retain(|entry| match entry.kind {
        Some(SectionKind::Voxels(channel)) => kept.contains(channel),
        Some(SectionKind::LabelTable) => kept.contains(Channel::Label),
        Some(SectionKind::Quantity) => kept.contains(Channel::Value),
        Some(SectionKind::Means(channel)) => request.lod && kept.contains(channel),
        Some(_) => true,
        None => false,
    });
    left.place_sections();
    Ok(left)
}

fn write_all(out: &File, entry: &SectionEntry, bytes: &[u8]) -> Result<(), Stop> {
    let mut writer = Writer::new(out, entry.offset, entry.end());
    writer.write(bytes).and_then(|()| writer.flush()).map_err(Stop::Output)
}

/// Copies the first bytes of a section, as many as the result keeps.
fn copy<R: ReadAt + ?Sized>(source: &R, frame: &Frame, out: &File, entry: &SectionEntry) -> Result<(), Stop> {
    let Some(from) = entry.kind.and_then(|kind| frame.section(kind)) else { return Ok(()) };
    let mut cursor = Cursor::new(source, from.offset, from.offset + entry.stored_bytes, BUFFER_BYTES);
    let mut writer = Writer::new(out, entry.offset, entry.end());
    writer.copy(&mut cursor)?;
    writer.flush().map_err(Stop::Output)
}

/// Writes the means of the boxes that become voxels.
fn coarsen<R: ReadAt + ?Sized>(source: &R, frame: &Frame, out: &File, left: &Frame) -> Result<(), Stop> {
    let finest = left.dims().depth();
    let mut writers: Vec<Option<(Channel, usize, Writer<'_>)>> = walked_channels(frame)
        .into_iter()
        .map(|channel| {
            let entry = left.section(SectionKind::Voxels(channel))?;
            let writer = Writer::new(out, entry.offset, entry.end());
            Some((channel, usize::from(entry.item_bytes), writer))
        })
        .collect();
    walk(source, frame, finest + 1, &mut |level, sums| {
        if level != Level::new(finest) {
            return Ok(());
        }
        for (writer, sum) in writers.iter_mut().zip(sums) {
            let Some((channel, item, writer)) = writer else { continue };
            if let Some(means) = &channel.row().means {
                writer.write(means.rule.mean(sum).get(..*item).unwrap_or_default())?;
            }
        }
        Ok::<(), Fault>(())
    })?;
    writers.iter_mut().flatten().try_for_each(|(.., writer)| writer.flush()).map_err(Stop::Output)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembled::OptionalSections;
    use crate::jobs::pack::tests::sheet;
    use crate::load::Model;

    fn stripped(file: &[u8], request: StripRequest) -> Result<Vec<u8>, fault::Fault> {
        let out = tempfile::tempfile().unwrap();
        match strip_file(file, &out, &request) {
            Ok(_) => {}
            Err(StripStop::Request(fault)) => return Err(fault),
            Err(StripStop::Stop(stop)) => panic!("{stop:?}"),
        }
        let mut all = vec![0; usize::try_from(out.byte_len().unwrap()).unwrap()];
        out.read_at(&mut all, 0).unwrap();
        Ok(all)
    }

    const ALL: OptionalSections = OptionalSections { normal: true, value_bytes: 2, lod: true };

    #[test]
    fn what_is_left_is_the_model_that_would_have_been_built_so() {
        for dims in [[3, 5, 4], [40, 33, 20], [65, 3, 9], [150, 140, 40]] {
            let file = sheet(dims, ALL);
            for (channels, lod) in [
                (Channels::NONE, true),
                (Channels::from([Channel::Normal]), true),
                (Channels::from([Channel::Normal, Channel::Value]), false),
                (Channels::from([Channel::Value]), true),
            ] {
                let how = OptionalSections {
                    normal: channels.contains(Channel::Normal),
                    value_bytes: if channels.contains(Channel::Value) { 2 } else { 0 },
                    lod,
                };
                let built = sheet(dims, how);
                let request = StripRequest { channels: Some(channels), levels: 0, lod };
                assert_eq!(stripped(&file, request), Ok(built), "{dims:?} {channels:?} {lod}");
            }
            let same = StripRequest { channels: None, levels: 0, lod: true };
            assert_eq!(stripped(&file, same).as_deref(), Ok(&file[..]));
        }
    }

    #[test]
    fn fine_levels_become_means_that_verify() {
        let dims = [150, 140, 40];
        let file = sheet(dims, ALL);
        let whole = Model::from_bytes(file.clone()).unwrap();
        for levels in 1..8 {
            let request = StripRequest { channels: None, levels, lod: true };
            let coarse = stripped(&file, request).unwrap();
            verify(coarse.as_slice()).unwrap();
            let coarse = Model::from_bytes(coarse).unwrap();
            let edge = 1 << levels;
            assert_eq!(coarse.dims().to_array(), dims.map(|n: u32| n.div_ceil(edge)));
            let level = whole.frame().level(Level::new(8 - levels));
            assert_eq!(coarse.header().voxels, level.end - level.start);
            // The corner of the box stays where it is.
            let corner = |m: &Model<Vec<u8>>| m.affine().apply([-0.5; 3]);
            assert_eq!(corner(&coarse), corner(&whole));
        }
        let too_many = StripRequest { channels: None, levels: 8, lod: true };
        assert!(stripped(&file, too_many).unwrap_err().text.contains("not have 8 levels"));
        let absent = StripRequest { channels: Some(Channels::from([Channel::Color])), levels: 0, lod: true };
        assert!(stripped(&file, absent).unwrap_err().text.contains("not have the channel 'color'"));
    }
}
