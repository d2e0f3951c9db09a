//! Connected components of a bit volume, labelled as a stream: two passes, memory of a few rows.
//!
//! **Forward**, rows in the order of the volume. A row falls into *runs*. A run joins the neighbouring runs that came
//! before it (in the row above, and in the slice before) in a union-find over *nodes*: the components that reach the
//! slice before, and the runs of this slice that began a component. At the end of a slice every component that has a
//! run in it gets a *slot*, in the order of first appearance; slots are the first nodes of the next slice, with the
//! sums of their components so far. Every slot of the slice before gets a link to the slot that continues it, or its
//! finished component.
//!
//! ```text
//!   slice z - 1     slot 0     slot 1   slot 2          links of its slots: 0, 0, finished (size, first voxel)
//!                       \      /
//!   slice z              slot 0         slot 1 (new)
//! ```
//!
//! **Backward**, slices from the last to the first: a slot has the fate of its link, or the rule decides on its
//! finished component. Each run has its slot written down, and its bits are changed if its fate says so.
//!
//! Runs, links and finished components are lists in scratch files, written and read in order; nodes and fates
//! are tables of one slice, paged to a scratch file where they outgrow their cache. No component is ever
//! looked up across slices, so a volume of noise costs disk and time, never memory. Source: the streaming idea
//! of M. Isenburg and J. Shewchuk, *Streaming connected component computation for trillion voxel images* (2009).
//! Here links are followed backwards instead of being resolved in memory.
//!
//! Scratch: 4 bytes a run, 4 bytes a slot of every slice, 16 bytes a component.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::io;
use std::path::Path;

use super::bits::{BitVolume, RowWindow, Run, fill, find_runs, scratch_error};
use super::paged::PagedTable;
use super::stream::{BUFFER_BYTES, Cursor, Stream};
pub(super) use super::union_find::Component;
use super::union_find::UnionFind;
use crate::budget::{Budget, Reservation, TooSmall};
use crate::builder::BuildError;
use crate::geom::Dims;
use crate::progress::Progress;

/// Link of a slot whose component is finished.
const FINISHED: u32 = u32::MAX;
/// Neighbourhood of voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
pub enum ComponentConnectivity {
    /// Voxels that share a face. The triangles around them are one body.
    #[default]
    #[serde(rename = "6")]
    Faces6,
    /// Voxels that share a face, an edge or a corner.
    #[serde(rename = "26")]
    Corners26,
}

impl ComponentConnectivity {
    /// Number of neighbours: 6 or 26.
    pub(crate) fn neighbours(self) -> u8 {
        match self {
            Self::Faces6 => 6,
            Self::Corners26 => 26,
        }
    }
}

/// Offsets of the lists of a slice: runs, links, finished components.
type SliceStart = [u64; 3];
const RUNS: usize = 0;
const LINKS: usize = 1;
const FINISHES: usize = 2;

/// A volume to label, with the parameters and resources for it.
#[derive(Clone, Copy)]
pub(super) struct Task<'a> {
    pub(super) bits: &'a BitVolume,
    /// True to label the voxels that are not set.
    pub(super) inverted: bool,
    pub(super) connectivity: ComponentConnectivity,
    pub(super) largest: usize,
    pub(super) folder: &'a Path,
    pub(super) memory: &'a TaskMemory,
    pub(super) progress: &'a dyn Progress,
}

/// Results of the forward pass.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Census {
    pub(super) components: u64,
    pub(super) largest: Vec<Component>,
}

/// Bytes without the caches: rows, runs, buffers, the largest.
fn fixed_bytes(dims: Dims, largest: usize) -> u64 {
    let row_words = dims.nx().div_ceil(64) as usize;
    let runs = (u64::from(dims.nx()) / 2 + 2) * size_of::<Run>() as u64;
    2 * RowWindow::bytes(row_words) + 5 * runs + 6 * BUFFER_BYTES as u64 + 2 * 16 * largest as u64
}

/// Least memory of a task.
pub(super) fn least_bytes(dims: Dims, largest: usize) -> u64 {
    fixed_bytes(dims, largest) + 3 * UnionFind::MIN_BYTES
}

pub(super) struct TaskMemory {
    /// Memory for the cache of a table of one slice; each pass has two.
    table_bytes: u64,
    _held: [Reservation; 2],
}

impl TaskMemory {
    /// Reserves the least memory, and as much more as two tables can use and the budget grants.
    ///
    /// # Errors
    /// The budget is below [`least_bytes`].
    pub(super) fn reserve(dims: Dims, largest: usize, budget: &Budget) -> Result<Self, TooSmall> {
        let least = budget.reserve(least_bytes(dims, largest))?;
        let useful = 2 * (most_table_bytes(dims, UnionFind::NODE_BYTES) - UnionFind::MIN_BYTES);
        let more = budget.reserve(budget.left_bytes().min(useful))?;
        Ok(Self { table_bytes: UnionFind::MIN_BYTES + more.bytes() / 2, _held: [least, more] })
    }
}

/// Most bytes that a table of one slice can fill.
fn most_table_bytes(dims: Dims, item_bytes: usize) -> u64 {
    let runs = u64::from(dims.nx().div_ceil(2)) * u64::from(dims.ny());
    // Nodes are the runs of two slices at most; pages are whole, and come in sets.
    2 * runs * (item_bytes as u64 + 1) + UnionFind::MIN_BYTES
}

/// A labelled volume: its components are known, and can be kept or dropped.
pub(super) struct Labelled<'a> {
    task: Task<'a>,
    runs: Stream<u32>,
    links: Stream<u32>,
    finished: Stream<[u64; 2]>,
    starts: PagedTable<SliceStart>,
    pub(super) census: Census,
}

impl<'a> Task<'a> {
    /// The forward pass.
    ///
    /// # Errors
    /// The scratch files fail, or a slice has more than 2^32 - 2 runs and components together.
    pub(super) fn label(self) -> Result<Labelled<'a>, BuildError> {
        let failed = |cause| scratch_error(self.folder, cause);
        let mut labelled = Labelled {
            task: self,
            runs: Stream::new(self.folder).map_err(failed)?,
            links: Stream::new(self.folder).map_err(failed)?,
            finished: Stream::new(self.folder).map_err(failed)?,
            starts: PagedTable::new(self.folder, 0).map_err(failed)?,
            census: Census::default(),
        };
        let mut forward = Forward::new(&mut labelled).map_err(failed)?;
        forward.run()?;
        let largest = forward.heap.into_sorted_vec().into_iter().map(|Reverse(component)| component);
        labelled.census.largest = largest.collect();
        Ok(labelled)
    }

    /// Memory for the cache of a table of one slice, and no more than it can fill.
    fn table_bytes(&self, item_bytes: usize) -> u64 {
        self.memory.table_bytes.min(most_table_bytes(self.bits.dims(), item_bytes))
    }
}

struct Forward<'l, 'a> {
    to: &'l mut Labelled<'a>,
    sets: UnionFind,
    next: UnionFind,
    /// Slots of the slice before: the first nodes.
    slots: u64,
    row: Vec<Run>,
    above: Vec<Run>,
    /// Rows y - 1, y and y + 1 of the slice before.
    before: [Vec<Run>; 3],
    heap: BinaryHeap<Reverse<Component>>,
}

impl<'l, 'a> Forward<'l, 'a> {
    fn new(to: &'l mut Labelled<'a>) -> io::Result<Self> {
        let task = to.task;
        let bytes = task.table_bytes(UnionFind::NODE_BYTES);
        let sets = || UnionFind::new(task.folder, bytes);
        let most = task.bits.dims().nx() as usize / 2 + 1;
        let runs = || Vec::with_capacity(most);
        Ok(Self {
            sets: sets()?,
            next: sets()?,
            to,
            slots: 0,
            row: runs(),
            above: runs(),
            before: [runs(), runs(), runs()],
            heap: BinaryHeap::new(),
        })
    }

    fn run(&mut self) -> Result<(), BuildError> {
        let task = self.to.task;
        let dims = task.bits.dims();
        let mut here = RowWindow::new(task.bits);
        let mut back = RowWindow::new(task.bits);
        let mut labels = Cursor::new();
        let failed = |cause| task.bits.failed(cause);
        let mut start = SliceStart::default();
        for z in 0..dims.nz() {
            let previous = std::mem::replace(&mut start, self.start().map_err(failed)?);
            self.above.clear();
            self.before.iter_mut().for_each(Vec::clear);
            if z > 0 {
                labels.start(previous[RUNS]..start[RUNS]);
                self.load_before(&mut back, &mut labels, 0, z)?;
            }
            for y in 0..dims.ny() {
                if z > 0 {
                    self.before.rotate_left(1);
                    self.load_before(&mut back, &mut labels, y + 1, z)?;
                }
                let words = here.get(task.bits.row(y, z))?;
                find_runs(words, dims.nx(), task.inverted, &mut self.row);
                self.join_row(y, z).map_err(failed)?;
                std::mem::swap(&mut self.row, &mut self.above);
            }
            self.end_slice(start[RUNS]).map_err(failed)?;
            task.progress.step(1)?;
        }
        self.end_volume().map_err(failed)
    }

    /// Records the offsets of the lists of the next slice.
    fn start(&mut self) -> io::Result<SliceStart> {
        let to = &mut *self.to;
        let start = [to.runs.len(), to.links.len(), to.finished.len()];
        to.starts.push(start)?;
        Ok(start)
    }

    /// Loads row `y` of the slice before `z`, if there is one, into the last place of `before`.
    fn load_before(
        &mut self,
        window: &mut RowWindow<'_>,
        labels: &mut Cursor<u32>,
        y: u32,
        z: u32,
    ) -> Result<(), BuildError> {
        let task = self.to.task;
        let dims = task.bits.dims();
        let row = &mut self.before[2];
        row.clear();
        if y < dims.ny() {
            find_runs(window.get(task.bits.row(y, z - 1))?, dims.nx(), task.inverted, row);
            for run in row.iter_mut() {
                run.label = labels.next(&self.to.runs).map_err(|cause| task.bits.failed(cause))?;
            }
        }
        Ok(())
    }

    /// Labels the runs of a row by their neighbours, and writes the labels down.
    fn join_row(&mut self, y: u32, z: u32) -> io::Result<()> {
        let task = self.to.task;
        let [nx, ny, nz] = task.bits.dims().to_array();
        let outer = y == 0 || z == 0 || y + 1 == ny || z + 1 == nz;
        let origin = task.bits.row(y, z) * u64::from(nx);
        let wide = task.connectivity == ComponentConnectivity::Corners26;
        let (reach, sides) = if wide { (1, 4) } else { (0, 2) };
        let neighbours = [&self.above, &self.before[1], &self.before[0], &self.before[2]];
        let mut at = [0_usize; 4];
        for run in &mut self.row {
            let (first, last) = (u32::from(run.start), u32::from(run.last));
            let mut label = None;
            for (side, at) in neighbours.iter().zip(&mut at).take(sides) {
                while side.get(*at).is_some_and(|n| u32::from(n.last) + reach < first) {
                    *at += 1;
                }
                let touching = side[*at..].iter().take_while(|n| u32::from(n.start) <= last + reach);
                for neighbour in touching {
                    label = Some(match label {
                        Some(label) if label == neighbour.label => label,
                        Some(label) => match self.sets.find(neighbour.label)? {
                            root if root == label => label,
                            root => self.sets.join(label, root)?,
                        },
                        None => self.sets.find(neighbour.label)?,
                    });
                }
            }
            let border = outer || first == 0 || last + 1 == nx;
            let component = Component::new(run.voxels(), origin + u64::from(first), border);
            run.label = match label {
                Some(label) => {
                    self.sets.add(label, component)?;
                    label
                }
                None => self.sets.push(component)?,
            };
            self.to.runs.push(run.label)?;
        }
        Ok(())
    }

    /// Gives slots to the components of the slice, whose runs begin at `runs`, and links to the slots before.
    fn end_slice(&mut self, runs: u64) -> io::Result<()> {
        let Self { to, sets, next, .. } = self;
        next.clear();
        to.runs.flush()?;
        let end = to.runs.len();
        to.runs.rewrite(runs..end, &mut |label| {
            let root = sets.find(label)?;
            let (component, slot) = sets.get(root)?;
            if let Some(slot) = slot {
                return Ok(slot);
            }
            let slot = next.push(component)?;
            sets.set_slot(root, slot)?;
            Ok(slot)
        })?;
        for slot in 0..self.slots {
            #[expect(clippy::cast_possible_truncation, reason = "a node's number")]
            let root = self.sets.find(slot as u32)?;
            match self.sets.get(root)? {
                (_, Some(slot)) => self.to.links.push(slot)?,
                (component, None) => self.finish(component)?,
            }
        }
        std::mem::swap(&mut self.sets, &mut self.next);
        self.slots = self.sets.len();
        Ok(())
    }

    /// Ends the volume: every component of the last slice is finished.
    fn end_volume(&mut self) -> io::Result<()> {
        self.start()?;
        for slot in 0..self.slots {
            #[expect(clippy::cast_possible_truncation, reason = "a node's number")]
            let (component, _) = self.sets.get(slot as u32)?;
            self.finish(component)?;
        }
        self.start()?;
        self.to.runs.flush()?;
        self.to.links.flush()?;
        self.to.finished.flush()
    }

    fn finish(&mut self, component: Component) -> io::Result<()> {
        self.to.links.push(FINISHED)?;
        self.to.finished.push(component.words())?;
        self.to.census.components += 1;
        let most = self.to.task.largest;
        if self.heap.len() < most {
            self.heap.push(Reverse(component));
        } else if self.heap.peek().is_some_and(|least| component > least.0) {
            self.heap.pop();
            self.heap.push(Reverse(component));
        }
        Ok(())
    }
}

/// Results of the backward pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Outcome {
    pub(super) kept: u64,
    /// Voxels of the largest dropped component.
    pub(super) largest_dropped: u64,
    /// Voxels of dropped components, whose bits were changed.
    pub(super) changed: u64,
}

impl Labelled<'_> {
    /// The backward pass: voxels of components that `keep` refuses are turned: cleared, or set if the unset ones were
    /// labelled.
    ///
    /// # Errors
    /// The scratch files fail.
    pub(super) fn decide(mut self, keep: &dyn Fn(Component) -> bool) -> Result<Outcome, BuildError> {
        let task = self.task;
        let failed = |cause| scratch_error(task.folder, cause);
        let dims = task.bits.dims();
        let bytes = task.table_bytes(1);
        let mut later = PagedTable::<u8>::new(task.folder, bytes).map_err(failed)?;
        let mut fates = PagedTable::<u8>::new(task.folder, bytes).map_err(failed)?;
        let (mut links, mut finished, mut slots) = (Cursor::new(), Cursor::new(), Cursor::new());
        let mut window = RowWindow::new(task.bits);
        let mut runs = Vec::with_capacity(dims.nx() as usize / 2 + 1);
        let mut outcome = Outcome::default();
        for z in (0..dims.nz()).rev() {
            let mut start = |after: u32| self.starts.get(u64::from(z) + u64::from(after)).map_err(failed);
            let [here, next, end] = [start(0)?, start(1)?, start(2)?];
            links.start(next[LINKS]..end[LINKS]);
            finished.start(next[FINISHES]..end[FINISHES]);
            slots.start(here[RUNS]..next[RUNS]);
            fates.clear();
            let mut decide = || -> io::Result<()> {
                for _ in next[LINKS]..end[LINKS] {
                    let fate = match links.next(&self.links)? {
                        FINISHED => {
                            let component = Component::of_words(finished.next(&self.finished)?);
                            let kept = keep(component);
                            outcome.kept += u64::from(kept);
                            if !kept {
                                outcome.largest_dropped = outcome.largest_dropped.max(component.voxels);
                            }
                            u8::from(kept)
                        }
                        link => later.get(u64::from(link))?,
                    };
                    fates.push(fate)?;
                }
                Ok(())
            };
            decide().map_err(failed)?;
            for row in task.bits.row(0, z)..task.bits.row(0, z) + u64::from(dims.ny()) {
                let words = window.get(row)?;
                find_runs(words, dims.nx(), task.inverted, &mut runs);
                let mut changed = 0;
                for run in &runs {
                    let slot = slots.next(&self.runs).map_err(failed)?;
                    if fates.get(u64::from(slot)).map_err(failed)? == 0 {
                        fill(words, *run, task.inverted);
                        changed += run.voxels();
                    }
                }
                if changed > 0 {
                    task.bits.write(row, 0, words)?;
                    outcome.changed += changed;
                }
            }
            std::mem::swap(&mut fates, &mut later);
            task.progress.step(1)?;
        }
        Ok(outcome)
    }
}
