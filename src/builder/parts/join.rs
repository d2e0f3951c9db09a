//! Joins all parts to a model: their groups in Morton order, each stretch of a record behind the previous one of its
//! level.
//!
//! Memory: runs of 32 KiB, one for each level of each section, a record's step of 256 KiB, and some 200 bytes a part;
//! it does not depend on the content of the parts.

use std::path::Path;
use std::time::Instant;

use super::cut::{Cuts, PartId};
use super::fault::PartFault;
use super::head::Head;
use super::read::{Cursor, PartFile, STEP, at, for_each_step};
use super::record::{Entry, RecordField, RecordForm};
use crate::atomic::AtomicFile;
use crate::builder::error::{BuildError, BuildFault};
use crate::builder::item::ChannelForm;
use crate::builder::layout::{Census, GroupCounts, Layout};
use crate::builder::merge::{MergeQueue, Run, Target, parse_summary, summary_bytes_of};
use crate::builder::walk::{BrickWalk, GROUP_BRICKS};
use crate::builder::{StageSeconds, seal};
use crate::fault::conversions;
use crate::format::{SectionEntry, SectionKind, Sum, SurfaceKind};
use crate::platform::PositionalFile;
use crate::progress::Progress;

/// Most parts open at a time: below the usual limit of every system.
const OPEN: usize = 512;
/// Most missing parts that are named.
pub(super) const NAMED: usize = 8;

/// Result of a join.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Joined {
    pub(crate) surface: SurfaceKind,
    pub(crate) voxels: u64,
    pub(crate) nodes: u64,
    pub(crate) file_bytes: u64,
    pub(crate) seconds: StageSeconds,
}

/// Writes the model of all parts of a plan that lie in `folder`.
///
/// # Errors
/// A part is missing, damaged or not of this plan, or the disk fails; the old output is untouched then.
pub(crate) fn join(
    digest: [u8; 32],
    cuts: Cuts,
    folder: &Path,
    output: &Path,
    progress: &dyn Progress,
) -> Result<Joined, BuildError> {
    let written = |cause| BuildError::from(BuildFault::Output { path: output.to_path_buf(), cause });
    let mut seconds = StageSeconds::default();
    let started = Instant::now();
    let mut parts = Parts::open(digest, cuts, folder, progress)?;
    let mut census = Census::new(cuts.dims.depth());
    let groups = parts.cursors.iter().map(Cursor::groups).sum();
    parts.for_each_group(progress, |_, _, _, entry| {
        census.add(entry.code, &entry.counts);
        Ok(())
    })?;
    if census.voxels == 0 {
        return Err(at(folder, PartFault::NothingInside));
    }
    let Head { channels, metadata, surface, .. } = parts.head.clone();
    let layout = Layout::new(&census, [metadata.len() as u64, 0], 0, &channels);
    let atomic = AtomicFile::create(output).map_err(written)?;
    let target = Target { file: atomic.file(), path: output, layout: &layout, channels: &channels, progress };
    progress.stage("merge", groups);
    let entries = atomic.written_behind(|| {
        let mut joiner = Joiner::new(&target, &census, &parts.form);
        parts.rewind();
        parts.for_each_group(progress, |id, file, form, entry| {
            joiner.record(file, form, entry).map_err(|fault| match fault {
                Stop::Part(fault) => at(&id.path(folder), damaged_by(fault, id.number)),
                Stop::Damaged => at(&id.path(folder), PartFault::Damaged { number: id.number }),
                Stop::Build(error) => error,
            })?;
            progress.advance(1);
            Ok(())
        })?;
        joiner.finish()?;
        seconds.merge = started.elapsed().as_secs_f64();
        let started = Instant::now();
        let entries = seal::seal(&target, cuts.dims, surface, &census, &metadata, &[])?;
        seconds.seal = started.elapsed().as_secs_f64();
        Ok::<_, BuildError>(entries)
    });
    let entries = entries.map_err(written)??;
    let started = Instant::now();
    atomic.file().sync_all().map_err(written)?;
    progress.check()?;
    atomic.commit().map_err(written)?;
    seconds.commit = started.elapsed().as_secs_f64();
    Ok(Joined {
        surface,
        voxels: census.voxels,
        nodes: census.nodes(),
        file_bytes: entries.last().map_or(0, SectionEntry::end),
        seconds,
    })
}

/// Maps the error of a file that became shorter while it was read to damage.
fn damaged_by(fault: PartFault, number: u32) -> PartFault {
    match fault {
        PartFault::Unreadable(cause) if cause.kind() == std::io::ErrorKind::UnexpectedEof => {
            PartFault::Damaged { number }
        }
        other => other,
    }
}

/// All parts of a plan.
struct Parts<'a> {
    id: PartId,
    folder: &'a Path,
    /// Head of the first part, with which the others must agree.
    head: Head,
    form: RecordForm,
    cursors: Vec<Cursor>,
    /// Part n at index n modulo [`OPEN`].
    open: Vec<Option<(u32, PositionalFile)>>,
}

impl<'a> Parts<'a> {
    fn open(
        digest: [u8; 32],
        cuts: Cuts,
        folder: &'a Path,
        progress: &dyn Progress,
    ) -> Result<Self, BuildError> {
        let id = PartId { digest, number: 0, cuts };
        let (mut missing, mut named) = (0, Vec::new());
        let mut head: Option<Head> = None;
        let mut cursors = Vec::new();
        for number in 0..cuts.parts {
            progress.check()?;
            let id = PartId { number, ..id };
            let Some(part) = PartFile::open(&id, folder)? else {
                missing += 1;
                if named.len() < NAMED {
                    named.push(number);
                }
                continue;
            };
            match &head {
                None => head = Some(part.head),
                Some(first) if !same_model(first, &part.head) => {
                    return Err(at(&id.path(folder), PartFault::Foreign { number }));
                }
                Some(_) => {}
            }
            cursors.push(part.cursor);
        }
        let Some(head) = head.filter(|_| missing == 0) else {
            return Err(at(folder, PartFault::Missing { parts: cuts.parts, missing, first: named }));
        };
        let form = RecordForm::new(&head.channels, cuts.dims.depth());
        Ok(Self { id, folder, head, form, cursors, open: (0..OPEN).map(|_| None).collect() })
    }

    fn rewind(&mut self) {
        for cursor in &mut self.cursors {
            *cursor = cursor.rewound();
        }
    }

    /// Calls `each` with the groups of all parts in Morton order: part, its file, and the entry.
    fn for_each_group(
        &mut self,
        progress: &dyn Progress,
        mut each: impl FnMut(PartId, &PositionalFile, &RecordForm, &Entry) -> Result<(), BuildError>,
    ) -> Result<(), BuildError> {
        let Self { id, folder, form, cursors, open, .. } = self;
        let cuts = id.cuts;
        for (number, cursor) in (0..).zip(cursors.iter_mut()) {
            let id = PartId { number, ..*id };
            let path = || id.path(folder);
            cursor.advance(file(open, &id, folder)?, form).map_err(|fault| at(&path(), fault))?;
        }
        for (code, place) in BrickWalk::new(cuts.dims) {
            let id = PartId { number: cuts.owner(place), ..*id };
            let Some(cursor) = cursors.get_mut(id.number as usize) else { continue };
            let Some(entry) = cursor.next.filter(|entry| entry.code <= code) else { continue };
            progress.check()?;
            let failed = |fault| at(&id.path(folder), fault);
            if entry.code != code {
                return Err(failed(PartFault::Damaged { number: id.number }));
            }
            let file = file(open, &id, folder)?;
            each(id, file, form, &entry)?;
            cursor.advance(file, form).map_err(failed)?;
        }
        // A group that remains lies in the box of another part.
        match (0..).zip(cursors.iter()).find(|(_, cursor)| cursor.next.is_some()) {
            None => Ok(()),
            Some((number, _)) => {
                let id = PartId { number, ..*id };
                Err(at(&id.path(folder), PartFault::Damaged { number }))
            }
        }
    }
}

/// Returns the open file of a part.
fn file<'a>(
    open: &'a mut [Option<(u32, PositionalFile)>],
    id: &PartId,
    folder: &Path,
) -> Result<&'a PositionalFile, BuildError> {
    let held = &mut open[id.number as usize % OPEN];
    if held.as_ref().is_none_or(|(number, _)| *number != id.number) {
        let path = id.path(folder);
        let file = PositionalFile::open(&path).map_err(|cause| at(&path, PartFault::Unreadable(cause)))?;
        *held = Some((id.number, file));
    }
    match held {
        Some((_, file)) => Ok(file),
        None => {
            Err(at(folder, PartFault::Missing { parts: id.cuts.parts, missing: 1, first: vec![id.number] }))
        }
    }
}

/// True if two parts belong to one model.
fn same_model(one: &Head, other: &Head) -> bool {
    let of = |head: &Head| (head.surface, head.channels.lod, head.channels.forms.clone());
    of(one) == of(other) && one.metadata == other.metadata
}

/// Reason why a record cannot be joined.
enum Stop {
    Part(PartFault),
    Damaged,
    Build(BuildError),
}

conversions!(Stop {
    fault: PartFault => Self::Part(fault),
    error: BuildError => Self::Build(error),
});

/// The levels of the model, each extended at its end.
struct Joiner<'a> {
    target: &'a Target<'a>,
    queue: MergeQueue<'a>,
    /// Runs by stretch; summaries are not written.
    runs: Vec<Run>,
    summary_bytes: usize,
    summaries: Vec<u8>,
    sums: Vec<Sum>,
    buffer: Vec<u8>,
}

impl<'a> Joiner<'a> {
    fn new(target: &'a Target<'a>, census: &Census, form: &RecordForm) -> Self {
        let of = |at: usize| target.channels.forms.get(at);
        let start = |stretch| match stretch {
            RecordField::Summaries => None,
            RecordField::Nodes(e) => target.offset(SectionKind::Nodes, first_node(census, e), 1),
            RecordField::Items(at) => {
                of(at).and_then(|c: &ChannelForm| target.offset(SectionKind::Voxels(c.channel), 0, 0))
            }
            RecordField::Means(at, e) => of(at).and_then(|c| {
                let kind = SectionKind::Means(c.channel);
                target.offset(kind, first_node(census, e), c.form.stored_bytes())
            }),
        };
        let stretches = form.lengths(GroupCounts::default());
        Self {
            target,
            queue: MergeQueue::new(target, census),
            runs: stretches.map(|(stretch, _)| Run::new(start(stretch))).collect(),
            summary_bytes: summary_bytes_of(target.channels),
            summaries: Vec::new(),
            sums: Vec::new(),
            buffer: vec![0; STEP],
        }
    }

    /// Copies the stretches of a record to their places.
    fn record(&mut self, file: &PositionalFile, form: &RecordForm, entry: &Entry) -> Result<(), Stop> {
        let Self { target, runs, summaries, buffer, .. } = self;
        summaries.clear();
        let bytes = form.bytes(&entry.counts);
        let mut stretches = form.lengths(entry.counts).zip(runs.iter_mut());
        let mut current = stretches.next();
        let mut crc = 0;
        for_each_step::<Stop>(file, entry.offset, bytes, buffer, &mut |step| {
            crc = crc32c::crc32c_append(crc, step);
            let mut rest = step;
            while let (false, Some(((stretch, left), run))) = (rest.is_empty(), &mut current) {
                let now = usize::try_from(*left).unwrap_or(usize::MAX).min(rest.len());
                let (bytes, later) = rest.split_at(now);
                match stretch {
                    RecordField::Summaries => summaries.extend_from_slice(bytes),
                    _ => run.put(target, bytes)?,
                }
                *left -= now as u64;
                rest = later;
                if *left == 0 {
                    current = stretches.next();
                }
            }
            Ok(())
        })?;
        if crc != entry.crc || !self.push_bricks(entry)? {
            return Err(Stop::Damaged);
        }
        Ok(())
    }

    /// Passes the bricks of a group to the levels above; `false` if they do not belong to the group.
    fn push_bricks(&mut self, entry: &Entry) -> Result<bool, BuildError> {
        let Self { queue, summaries, summary_bytes, sums, .. } = self;
        let (mut previous, mut boxes) = (None, 0);
        for summary in summaries.chunks_exact(*summary_bytes) {
            let code = parse_summary(summary, sums);
            if code / GROUP_BRICKS as u64 != entry.code || previous.is_some_and(|last| last >= code) {
                return Ok(false);
            }
            boxes += u32::from(previous.map(|last| last >> 3) != Some(code >> 3));
            previous = Some(code);
            queue.push(code, sums)?;
        }
        Ok(entry.counts.boxes.last() == Some(&boxes))
    }

    fn finish(mut self) -> Result<(), BuildError> {
        for run in &mut self.runs {
            run.flush(self.target)?;
        }
        self.queue.finish()
    }
}

/// Number of the first node with an edge of 2^e.
fn first_node(census: &Census, e: usize) -> u64 {
    u32::try_from(e).map_or(0, |e| census.first_node(e))
}
