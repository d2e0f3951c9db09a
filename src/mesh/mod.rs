//! Triangle meshes as solids: any size, in a fixed amount of memory, every voxel decided in integers.
//!
//! ```text
//! file --bounds--> grid --triangles on the lattice--> bins (scratch) --rows--> bits --builder--> .oct
//!                              └─> census: closed? ──no──> open edges ──> caps ──┘
//! ```
//!
//! A voxel is inside if its centre is. That is decided on a lattice of 2^-12 voxel, to which vertices are rounded
//! once; so the model depends neither on the order of triangles nor on memory or threads, and formats that hold the
//! same numbers give the same bytes. Which rule applies follows from what the mesh is:
//!
//! | mesh | inside is |
//! |---|---|
//! | closed, directions agree | what it winds around (nonzero winding): overlapping parts are one |
//! | closed, directions disagree | where a ray meets it an odd number of times (parity) |
//! | open | as above, once caps close the loops of its open edges |
//!
//! [`Fill::Surface`] asks for none of them: inside are the voxels that rows of centres cross the mesh in.
//!
//! | part | what it holds |
//! |---|---|
//! | `read` | triangles from files |
//! | `lattice` | the grid, and whole numbers for coordinates |
//! | `corner` | vertices on the lattice, each once |
//! | `census`, `boundary` | closed or not, told by sums; open edges and caps |
//! | `bins` | triangles sorted by place, in a nameless file |
//! | `raster` | rows that cross triangles, bits from crossings |
//! | `resident`, `cells` | triangles at hand; small ones by cells of a voxel |
//! | `nearest`, `bound`, `prism` | the nearest of a voxel; what is too far to be it |
//! | `crossed` | cells instead of skin: planes from where edges meet triangles |
//! | `paint` | colours, parts and smooth normals at the nearest point |
//! | `solid` | all of it as a solid of the builder |
//! | `thin` | surfaces alone, and walls thinner than a voxel |
//!
//! Memory: [`BuildOptions::memory`]. Passes over the files: one for the bounds, unless the grid is given in full, one
//! for the bins, and one or two more where a mesh is open. Temporary disk: some 32 bytes a triangle of up to eight
//! voxels (more for longer ones, in every bin that they meet), 36 more for every triangle and vertex of formats of
//! text, and about the size of the model.

mod bins;
mod bound;
mod boundary;
mod cells;
mod census;
mod corner;
mod crossed;
mod lattice;
mod nearest;
mod paint;
mod prism;
mod raster;
mod read;
mod resident;
mod solid;
mod thin;

pub(crate) use census::{Census, Closed};
pub(crate) use lattice::{Bounds, MOST_VOXELS, STEPS, Triangle, span, turned};
pub use lattice::{Grid, GridChoice};
pub(crate) use nearest::{Facet, Nearest};
pub(crate) use raster::{Crossings, Rule, cross_slice};

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::budget::costs::{LEAST_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, MemoryCap};
use crate::builder::{
    BuildError, BuildOptions, BuildReport, CellEdges, Progress, Tile, build_solid, cell_dims,
};
use crate::facts::{Boundary, Fault, Fill, MeshFacts, MeshFault, MeshNote, SourceError};
use crate::format::{Channel, Channels, SurfaceKind};
use crate::geom::{Affine, Dims};
use crate::stamp::stamp;
use bins::{BINNING_BYTES, Binner, Bins};
use boundary::{BOUNDARY_BYTES, OpenEdge, Sums, Table};
use corner::Corner;
use crossed::MeshCells;
pub(crate) use crossed::cross_edges;
use paint::{COLLECTING_BYTES, Collector, Painter, Wanted};
use read::{Limits, Look, MeshFile, READER_BYTES};
pub(crate) use read::{check, format_of};
use resident::Resident;
pub(crate) use solid::MeshSolid;
use solid::fixed_bytes;
use thin::{Thin, ThinSolid};

/// How a mesh is made a solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// How fine the grid is.
    pub grid: GridChoice,
    /// Millimetres of a unit of the files.
    pub unit_mm: f64,
    /// What is inside; what fits the mesh, if not given.
    pub fill: Option<Fill>,
    /// Are walls thinner than a voxel kept? What is inside is then, too, a voxel of every two neighbours between whose
    /// centres, both outside, the mesh passes. Without effect where the fill is [`Fill::Surface`].
    pub keep_thin: bool,
    /// May links lead from files that a mesh names out of its folder?
    pub follow_links: bool,
}

impl MeshOptions {
    fn thin(&self) -> Option<Thin> {
        match self.fill {
            Some(Fill::Surface) => Some(Thin::Surface),
            _ => self.keep_thin.then_some(Thin::Walls),
        }
    }
}

/// What was built, and what was found about the mesh.
#[derive(Clone, Debug)]
pub struct MeshReport {
    /// Figures of the build; the time of reading the mesh is in the scan's.
    pub build: BuildReport,
    /// What was found and chosen.
    pub facts: MeshFacts,
    /// What the mesh lacks.
    pub notes: Vec<MeshNote>,
}

/// Fewest triangles that a worker has room for.
const LEAST_RESIDENT: usize = 2048;
/// Bytes of a worker of the builder beside its part of the solid, about.
const COLUMN_BYTES: u64 = 768 << 10;

/// Builds the skin octree of a mesh, which several files may hold together, into `output`.
///
/// Channels: normals, smooth where files have normals of vertices; colours, left out where files have none; and as
/// material the number of the part, from 0, those beyond 255 as 255: files count as parts one after the other, and
/// within them objects and groups of OBJ, nodes of glTF with a mesh, and meshes of 3MF where they are placed.
///
/// # Errors
/// [`BuildError`]; the old output, if any, is untouched then and no temporary file remains.
pub fn build_mesh(
    inputs: &[PathBuf],
    mesh: &MeshOptions,
    options: &BuildOptions,
    output: &Path,
    progress: &dyn Progress,
) -> Result<MeshReport, BuildError> {
    let started = Instant::now();
    let scratch = options.scratch_folder(output);
    let front = Front { inputs, mesh, options, scratch, progress, placed: None };
    let cells = front.is_of_cells();
    if cells && mesh.thin().is_some() {
        return Err(front.unusable(MeshFault::ThinCells).into());
    }
    let (solid, facts, notes) = front.solid()?;
    let reading_s = started.elapsed().as_secs_f64();
    // In a share nobody else counts what the solid holds.
    let memory = match options.memory {
        MemoryCap::Share(bytes) => {
            let painted = solid.paint.as_ref().map_or(0, paint::Paint::bytes);
            MemoryCap::Share(bytes.saturating_sub(Bins::memory_bytes(front.boxes(&solid.grid)) + painted))
        }
        whole => whole,
    };
    // A mesh without colours has none to store; whoever wants them of cells is told that these have none.
    let colored = cells || solid.paint.as_ref().is_some_and(|paint| paint.wanted.colors);
    let stored = options.channels.iter().filter(|channel| *channel != Channel::Color || colored);
    let options = BuildOptions { memory, channels: stored.collect(), ..options.clone() };
    let binned = solid.bins.bytes();
    let mut build = match mesh.thin() {
        None if cells => {
            let dims = front.boxes(&solid.grid);
            build_solid(&MeshCells { mesh: solid, dims }, &options, output, progress)?
        }
        None => build_solid(&solid, &options, output, progress)?,
        Some(thin) => build_solid(&ThinSolid { mesh: solid, thin }, &options, output, progress)?,
    };
    build.scratch_bytes += binned;
    build.seconds.scan += reading_s;
    build.seconds.read += reading_s;
    Ok(MeshReport { build, facts, notes })
}

/// A mesh as a part of something else: `placed` leads from the units of the file to voxels, counted from the low
/// corner of the first. So many `parts` share the memory.
///
/// # Errors
/// As [`build_mesh`].
pub(crate) fn mesh_part(
    path: &Path,
    (placed, dims): (Affine, Dims),
    parts: usize,
    options: &BuildOptions,
    scratch: &Path,
    progress: &dyn Progress,
) -> Result<(MeshSolid, MeshFacts), BuildError> {
    let grid = GridChoice::Exact { edge_mm: 1.0, origin_mm: [0.0; 3], dims };
    let mesh = MeshOptions { grid, unit_mm: 1.0, fill: None, keep_thin: false, follow_links: false };
    let inputs = [path.to_path_buf()];
    let scratch = scratch.to_path_buf();
    let front = Front { inputs: &inputs, mesh: &mesh, options, scratch, progress, placed: Some(placed) };
    let (mut solid, facts, _) = front.solid()?;
    solid.resident = (solid.resident / parts.max(1)).max(LEAST_RESIDENT);
    Ok((solid, facts))
}

/// Least memory of a share in which a mesh of nearly any kind is built.
pub(crate) fn least_share(mesh: &MeshOptions, options: &BuildOptions) -> u64 {
    let side = match mesh.grid {
        GridChoice::Side { voxels, .. } => voxels,
        GridChoice::Voxel { .. } => 1024,
        GridChoice::Exact { dims, .. } => dims.to_array().into_iter().max().unwrap_or(1),
    };
    let cells = options.volume_surface() == SurfaceKind::Cells;
    let side = side.max(1) + if cells { SurfaceKind::Cells.grown() } else { 0 };
    let bins = Dims::new(side, side, side).map_or(0, Bins::memory_bytes);
    let tile = Tile { columns: side.min(1024), channels: options.channels };
    let painted = options.channels.contains(Channel::Color) || options.channels.contains(Channel::Material);
    let (collecting, painter) = if painted { (COLLECTING_BYTES, Painter::BYTES) } else { (0, 0) };
    let thin = mesh.thin().map_or(0, |_| thin::fixed_bytes(&tile) + Resident::bytes(LEAST_RESIDENT, 0));
    let edges = if cells { CellEdges::BYTES } else { 0 };
    let column =
        COLUMN_BYTES + fixed_bytes(&tile) + Resident::bytes(LEAST_RESIDENT, 32) + painter + thin + edges;
    bins + (READER_BYTES + collecting + BINNING_BYTES.max(BOUNDARY_BYTES))
        .max(column.max(LEAST_WORKER) + WORKER_OVERHEAD)
}

/// The bounds of a mesh at another place.
///
/// # Errors
/// It cannot be read.
pub(crate) fn mesh_bounds(path: &Path, placed: &Affine, scratch: &Path) -> Result<Bounds, SourceError> {
    let mut bounds = Bounds::EMPTY;
    MeshFile::open(path, &Limits::plain(scratch))?.for_each(scratch, &mut |t| {
        t.iter().for_each(|p| bounds.add(placed.apply(*p)));
        Ok(())
    })?;
    Ok(bounds)
}

/// From files to a solid.
struct Front<'a> {
    inputs: &'a [PathBuf],
    mesh: &'a MeshOptions,
    options: &'a BuildOptions,
    scratch: PathBuf,
    progress: &'a dyn Progress,
    /// Where the mesh lies as a part of something else, in units of the grid.
    placed: Option<Affine>,
}

/// What one pass over all triangles on the lattice found.
#[derive(Default)]
struct Counted {
    triangles: u64,
    flat: u64,
    census: Census,
}

/// Triangles on their way from a reader, and why one was not taken.
#[derive(Default)]
struct Handed {
    counted: Counted,
    stopped: Option<SourceError>,
}

impl Handed {
    /// Counts a triangle and hands it on.
    #[inline(always)]
    fn take(
        &mut self,
        t: &Triangle,
        corners: &[Corner; 3],
        each: impl FnOnce(&Triangle) -> Result<(), SourceError>,
    ) -> Result<(), MeshFault> {
        let [a, b, c] = corners;
        self.counted.triangles += 1;
        self.counted.flat += u64::from(a.at == b.at || b.at == c.at || a.at == c.at);
        self.counted.census.add_hashed([a.hash, b.hash, c.hash]);
        each(t).map_err(|failed| {
            self.stopped = Some(failed);
            MeshFault::CutShort
        })
    }
}

impl Front<'_> {
    /// Are cells built in place of skin voxels?
    fn is_of_cells(&self) -> bool {
        self.options.volume_surface() == SurfaceKind::Cells
    }

    /// The grid of the boxes that are built on a grid of voxels.
    fn boxes(&self, grid: &Grid) -> Dims {
        let cells = self.is_of_cells().then(|| cell_dims(grid.dims));
        cells.flatten().unwrap_or(grid.dims)
    }

    fn name(&self) -> String {
        self.inputs.first().map(|p| p.display().to_string()).unwrap_or_default()
    }

    fn unusable(&self, fault: MeshFault) -> SourceError {
        let path = self.inputs.first().cloned().unwrap_or_default();
        SourceError::Unusable { path, fault: Fault::MeshFile(fault) }
    }

    fn solid(&self) -> Result<(MeshSolid, MeshFacts, Vec<MeshNote>), BuildError> {
        let budget = Budget::of_job(self.options.memory);
        let reading = self.reserve(&budget, READER_BYTES)?;
        let files = self.open(budget.left_bytes() / 2)?;
        let described = self.reserve(&budget, files.iter().map(MeshFile::held_bytes).sum())?;
        let beside = files.iter().flat_map(|file| file.beside().iter().cloned());
        let inputs: Vec<_> =
            self.inputs.iter().cloned().chain(beside).map(|p| (p.clone(), stamp(&p))).collect();
        let grid = self.grid(&files)?;
        let held = self.reserve(&budget, Bins::memory_bytes(self.boxes(&grid)))?;
        let binning = self.reserve(&budget, BINNING_BYTES)?;
        let mut binner = Binner::new(self.boxes(&grid), &self.scratch)?;
        let wanted = self.wanted(&files);
        let collecting = self.reserve(&budget, if wanted.anything() { COLLECTING_BYTES } else { 0 })?;
        let mut collector = None;
        let counted = if wanted.anything() {
            let collector = collector.insert(Collector::new(wanted, grid.dims, &self.scratch)?);
            let mut known = 0;
            self.count_looks(&files, &grid, &mut |t, look, file| {
                if known == file {
                    known += 1;
                    let first_part = files[..file].iter().map(MeshFile::parts).sum();
                    collector
                        .file(first_part, files[file].materials())
                        .map_err(|fault| self.of_paint(fault, file))?;
                }
                collector.add(t, look)?;
                binner.add(t)
            })?
        } else {
            self.count(&files, &grid, &mut |t| binner.add(t))?
        };
        let paint = collector.map(Collector::finish).transpose()?;
        drop(collecting);
        if counted.triangles == 0 {
            return Err(self.unusable(MeshFault::NoTriangles).into());
        }
        let closed = counted.census.closed();
        let mut is_closed = true;
        let (boundary, rule) = match closed {
            Closed::Oriented => (Boundary::Oriented, Rule::NonZero),
            Closed::Mixed => (Boundary::Mixed, Rule::Odd),
            Closed::No if self.mesh.fill == Some(Fill::Surface) => (Boundary::Sheet, Rule::NonZero),
            Closed::No => {
                // The pool makes room for the table of edges.
                let bins = binner.finish()?;
                drop(binning);
                let closing = self.reserve(&budget, BOUNDARY_BYTES)?;
                let (edges, sums) = match self.open_edges(&files, &grid)? {
                    Some(found) => found,
                    // Whoever says what is inside takes the mesh as it is.
                    None if self.mesh.fill.is_some() => {
                        is_closed = false;
                        (Vec::new(), Sums::Signed)
                    }
                    None => return Err(self.unusable(boundary::too_open()).into()),
                };
                let open = edges.len() as u64;
                let mut caps = Vec::new();
                let loops = boundary::close(edges, sums, &mut |t| {
                    caps.push(t);
                    Ok(())
                })?;
                drop(closing);
                let _binning = self.reserve(&budget, BINNING_BYTES)?;
                binner = Binner::go_on(bins);
                for cap in &caps {
                    binner.add(cap)?;
                }
                let rule = if sums == Sums::Signed { Rule::NonZero } else { Rule::Odd };
                (Boundary::Open { edges: open, loops }, rule)
            }
        };
        let bins = binner.finish()?;
        let parts = files.iter().map(MeshFile::parts).sum();
        let notes = self.notes(&files);
        drop(files);
        drop((reading, held, described));
        let (rule, asked_for) = match self.mesh.fill {
            Some(Fill::Winding) => {
                // Caps of odd edges, or directions that disagree, leave sums behind the last crossing.
                is_closed &= rule == Rule::NonZero;
                (Rule::NonZero, true)
            }
            Some(Fill::Parity) => (Rule::Odd, true),
            Some(Fill::Surface) => (rule, true),
            None => (rule, false),
        };
        let fill = match (self.mesh.fill, rule) {
            (Some(Fill::Surface), _) => Fill::Surface,
            (_, Rule::NonZero) => Fill::Winding,
            (_, Rule::Odd) => Fill::Parity,
        };
        let facts = MeshFacts {
            triangles: counted.triangles,
            flat: counted.flat,
            parts,
            files: self.inputs.len() as u64,
            boundary,
            fill,
            asked_for,
            keep_thin: self.mesh.thin() == Some(Thin::Walls),
            voxel_mm: grid.voxel_mm,
            origin_mm: grid.origin_mm,
        };
        let resident = self.resident(&bins, &grid, paint.as_ref());
        Ok((
            MeshSolid { name: self.name(), grid, bins, rule, closed: is_closed, resident, inputs, paint },
            facts,
            notes,
        ))
    }

    /// What files lack.
    fn notes(&self, files: &[MeshFile]) -> Vec<MeshNote> {
        let of = |(file, path): (&MeshFile, &PathBuf)| {
            let mesh = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let note = |name: &String| MeshNote::NoColors { mesh: mesh.clone(), name: name.clone() };
            file.missing().iter().map(note).collect::<Vec<_>>()
        };
        files.iter().zip(self.inputs).flat_map(of).collect()
    }

    /// Takes memory for a part of the work.
    fn reserve(&self, budget: &Budget, bytes: u64) -> Result<crate::budget::Reservation, BuildError> {
        let refused = |_| {
            let dry = Budget::dry(self.options.memory);
            let _most = dry.reserve(READER_BYTES + BINNING_BYTES.max(BOUNDARY_BYTES));
            let limit_bytes = self.options.memory.bytes();
            BuildError::BudgetTooSmall {
                name: self.name(),
                limit_bytes,
                minimum_bytes: dry.smallest_limit(1).max(limit_bytes + 1),
            }
        };
        budget.reserve(bytes).map_err(refused)
    }

    fn open(&self, most_bytes: u64) -> Result<Vec<MeshFile>, SourceError> {
        let MeshOptions { unit_mm, follow_links, .. } = *self.mesh;
        let [colors, looks] =
            [Channel::Color, Channel::Normal].map(|channel| self.channels().contains(channel));
        let scratch = &self.scratch;
        let limits = Limits { scratch, most_bytes, follow_links, looks: looks || colors, colors, unit_mm };
        self.inputs.iter().map(|path| MeshFile::open(path, &limits)).collect()
    }

    /// Channels that are asked for; parts of something else have only normals of their own triangles, and so have
    /// cells.
    fn channels(&self) -> Channels {
        let own = self.placed.is_some() || self.is_of_cells();
        if own { Channels::NONE } else { self.options.channels }
    }

    /// What is asked for and there.
    fn wanted(&self, files: &[MeshFile]) -> Wanted {
        let has = |k: usize| files.iter().any(|file| file.has_looks()[k]);
        let channels = self.channels();
        Wanted {
            colors: channels.contains(Channel::Color) && has(0),
            parts: channels.contains(Channel::Material),
            normals: channels.contains(Channel::Normal) && has(1),
        }
    }

    fn of_paint(&self, fault: paint::Fault, file: usize) -> SourceError {
        match fault {
            paint::Fault::Mesh(fault) => SourceError::Unusable {
                path: self.inputs.get(file).cloned().unwrap_or_default(),
                fault: Fault::MeshFile(fault),
            },
            paint::Fault::Source(error) => error,
        }
    }

    /// The grid of the choice; the bounds are those of triangles, not of vertices that no face names.
    fn grid(&self, files: &[MeshFile]) -> Result<Grid, SourceError> {
        let mut bounds = Bounds::EMPTY;
        if !matches!(self.mesh.grid, GridChoice::Exact { .. }) {
            self.progress.stage("bounds", files.len() as u64);
            let mut triangles = 0_u64;
            for file in files {
                file.for_each(&self.scratch, &mut |t| {
                    triangles += 1;
                    t.iter().for_each(|p| bounds.add(*p));
                    Ok(())
                })?;
                self.progress.step(1)?;
            }
            if triangles == 0 {
                return Err(self.unusable(MeshFault::NoTriangles));
            }
        }
        Grid::new(self.mesh.grid, &bounds, self.mesh.unit_mm).map_err(|fault| self.unusable(fault))
    }

    /// Brings every triangle onto the lattice, counts it, and hands it on.
    fn count(
        &self,
        files: &[MeshFile],
        grid: &Grid,
        each: &mut dyn FnMut(&Triangle) -> Result<(), SourceError>,
    ) -> Result<Counted, SourceError> {
        let place = |p| self.point(grid, p);
        self.go_through(files, &mut |file, _, handed| {
            file.for_each_corner(&self.scratch, &place, &mut |corners| {
                let t = turned(corners.map(|corner| corner.at));
                handed.take(&t, corners, |t| each(t))
            })
        })
    }

    /// The same with what triangles carry, and the number of the file.
    fn count_looks(
        &self,
        files: &[MeshFile],
        grid: &Grid,
        each: &mut dyn FnMut(&Triangle, &Look, usize) -> Result<(), SourceError>,
    ) -> Result<Counted, SourceError> {
        let place = |p| self.point(grid, p);
        self.go_through(files, &mut |file, number, handed| {
            file.for_each_look(&self.scratch, &mut |t, look| {
                let corners = t.map(|p| Corner::new(p, &place));
                Corner::check(&corners, 0)?;
                let at = corners.map(|corner| corner.at);
                let t = turned(at);
                let turned;
                let mut look = look;
                if *look != Look::NONE {
                    // What corners carry turns with them.
                    turned = look.turned(at.iter().position(|corner| t.starts_with(corner)).unwrap_or(0));
                    look = &turned;
                }
                handed.take(&t, &corners, |t| each(t, look, number))
            })
        })
    }

    #[inline]
    fn point(&self, grid: &Grid, p: [f64; 3]) -> Result<[i32; 3], MeshFault> {
        match &self.placed {
            Some(placed) => grid.point(placed.apply(p)),
            None => grid.point(p),
        }
    }

    /// Reads all files, one after the other.
    fn go_through(
        &self,
        files: &[MeshFile],
        read: &mut dyn FnMut(&MeshFile, usize, &mut Handed) -> Result<(), SourceError>,
    ) -> Result<Counted, SourceError> {
        self.progress.stage("triangles", files.len() as u64);
        let mut handed = Handed::default();
        for (number, file) in files.iter().enumerate() {
            let done = read(file, number, &mut handed);
            handed.stopped.take().map_or(done, Err)?;
            self.progress.step(1)?;
        }
        Ok(handed.counted)
    }

    /// The open edges, and how they are counted: with their direction, unless that disagrees with its neighbours;
    /// `None` if they are too many.
    fn open_edges(
        &self,
        files: &[MeshFile],
        grid: &Grid,
    ) -> Result<Option<(Vec<OpenEdge>, Sums)>, SourceError> {
        let find = |sums| {
            let mut table = Table::new(sums);
            self.count(files, grid, &mut |t| {
                table.add(t);
                Ok(())
            })?;
            Ok::<_, SourceError>(table.open_edges())
        };
        let signed = find(Sums::Signed)?;
        match signed {
            Some(edges) if !boundary::disagree(&edges) => Ok(Some((edges, Sums::Signed))),
            signed => {
                let most = signed.as_ref().map_or(usize::MAX, Vec::len);
                drop(signed);
                Ok(find(Sums::Odd)?.filter(|edges| edges.len() < most).map(|edges| (edges, Sums::Odd)))
            }
        }
    }

    /// How many triangles a worker may have at hand: those of the fullest bin, if the budget has room.
    fn resident(&self, bins: &Bins, grid: &Grid, paint: Option<&paint::Paint>) -> usize {
        let tile = Tile { columns: grid.dims.nx().min(1024), channels: self.options.channels };
        let own = (COLUMN_BYTES + fixed_bytes(&tile)).max(LEAST_WORKER) + WORKER_OVERHEAD;
        let own = own + paint.map_or(0, |_| Painter::BYTES);
        let own = own + if self.is_of_cells() { CellEdges::BYTES } else { 0 };
        let left = Budget::of_job(self.options.memory).left_bytes();
        // Thin walls take triangles of their own.
        let (own, shares) = match self.mesh.thin() {
            None => (own, 1),
            Some(_) => (own + thin::fixed_bytes(&tile), 2),
        };
        let each = (left / self.options.threads.max(1) as u64).saturating_sub(own) / shares;
        // A longer triangle takes two places more, one near to two bricks another.
        let most = 4 * bins.fullest() as usize + 8;
        Resident::fit(each).clamp(LEAST_RESIDENT, LEAST_RESIDENT.max(most))
    }
}
