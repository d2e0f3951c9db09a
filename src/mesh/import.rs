//! Conversion of files to a solid: bounds, grid, bins, looks of triangles, caps.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use super::bins::{BINNING_BYTES, Binner, Bins};
use super::boundary::{self, BOUNDARY_BYTES, OpenEdge, Sums, Table};
use super::corner::Corner;
use super::crossed::MeshCells;
use super::edge_parity::{Closed, EdgeParity};
use super::lattice::{Bounds, Grid, GridChoice, Triangle, smallest_first};
use super::paint::{self, COLLECTING_BYTES, Collector, PaintChannels, Painter};
use super::raster::Rule;
use super::reach::Reach;
use super::read::{Appearance, Limits, MeshFile, READER_BYTES};
use super::resident::Resident;
use super::shell::{self, Thin, ThinSolid};
use super::solid::{MeshSolid, fixed_bytes};
use super::{COLUMN_BYTES, MIN_RESIDENT, MeshOptions, sufficient_share, too_small};
use crate::budget::costs::{MIN_WORKER, WORKER_OVERHEAD};
use crate::budget::{Budget, Reservation};
use crate::builder::{
    BuildError, BuildFault, BuildOptions, CellEdges, FileSolid, Progress, Solid, Tile, cell_dims,
};
use crate::fault::{Fault, bad};
use crate::format::{Channel, Channels, SurfaceKind};
use crate::geom::{Affine, Dims};
use crate::identity::file_identity;
use crate::mesh::{Boundary, Fill, MeshFacts, MeshNote};
use crate::source::base_name;
use crate::text::names::{ERROR, FILL, KEEP_THIN};
use crate::volume::{SourceError, SourceFault};

/// Most parts whose bounds are looked at.
const MAX_PARTS: usize = 1024;

pub(super) struct Importer<'a> {
    pub(super) inputs: &'a [PathBuf],
    pub(super) mesh: &'a MeshOptions,
    pub(super) options: &'a BuildOptions,
    pub(super) scratch: PathBuf,
    pub(super) progress: &'a dyn Progress,
    /// Affine of a mesh that is a part of something else, to units of the grid.
    pub(super) placed: Option<Affine>,
    /// Extent of the model, filled while it is built.
    pub(super) reach: Arc<Reach>,
}

/// All triangles, caps included, and the rule for inside.
struct Closing {
    bins: Bins,
    boundary: Boundary,
    rule: Rule,
    /// True if the crossings of every row sum up to outside at its end.
    closed: bool,
}

/// Counts of one pass over all triangles on the lattice.
#[derive(Default)]
struct Counts {
    triangles: u64,
    flat: u64,
    census: EdgeParity,
}

impl Counts {
    #[inline(always)]
    fn add(&mut self, [a, b, c]: &[Corner; 3]) {
        self.triangles += 1;
        self.flat += u64::from(a.at == b.at || b.at == c.at || a.at == c.at);
        self.census.add_hashed([a.hash, b.hash, c.hash]);
    }
}

/// Memory for the descriptions of files whose build was refused.
const DESCRIPTIONS: u64 = 512 << 10;

/// Upper bound of the memory of a material with its texture while colours are gathered.
const MATERIAL_BYTES: u64 = 8 << 10;

/// Memory that a file's description would take, if it does not fit.
fn described_bytes(error: &BuildError) -> Option<u64> {
    let BuildFault::Source(error) = error.fault() else { return None };
    match error.fault() {
        SourceFault::Description { needed_bytes, .. } => Some(*needed_bytes),
        _ => None,
    }
}

/// Most memory that reading an image of the files takes.
fn image_bytes(files: &[MeshFile], wanted: PaintChannels) -> u64 {
    let materials = files.iter().flat_map(|file| &file.summary.materials).filter(|_| wanted.colors);
    let images = materials.filter_map(|material| material.texture.as_ref());
    images.map(|texture| paint::image_bytes(&texture.image)).max().unwrap_or(0)
}

fn no_triangles() -> Fault {
    bad!("does not hold a triangle")
}

/// Bounds of a part, and a sum over the edges that it has an odd number of times, 0 for none.
#[derive(Clone, Copy)]
struct PartBounds {
    bounds: Bounds,
    open: u64,
}

impl PartBounds {
    const EMPTY: Self = Self { bounds: Bounds::EMPTY, open: 0 };

    fn add(&mut self, t: &[[f64; 3]; 3]) {
        let corners = t.map(|p| {
            self.bounds.add(p);
            let mix = |sum: u64, c: f64| {
                ((c + 0.0).to_bits() ^ sum).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
            };
            p.into_iter().fold(7, mix)
        });
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let (a, b) = (corners[a], corners[b]);
            self.open ^= (a.wrapping_add(b) ^ (a ^ b).rotate_left(17)).wrapping_mul(0xd6e8_feb8_6659_fd93);
        }
    }
}

impl Importer<'_> {
    /// True if cells are built in place of skin voxels.
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

    fn unusable(&self, fault: Fault) -> SourceError {
        let path = self.inputs.first().cloned().unwrap_or_default();
        fault.at(path).into()
    }

    /// The solid to build, and its channels among the chosen ones.
    ///
    /// # Errors
    /// The mesh cannot be read, or not be built in this way.
    pub(super) fn made(
        &self,
    ) -> Result<(FileSolid<'static>, Channels, MeshFacts, Vec<MeshNote>), BuildError> {
        let started = Instant::now();
        let (cells, thin) = (self.is_of_cells(), self.mesh.thin());
        if cells && thin.is_some() {
            return Err(self.unusable(bad!("cannot be built as cells with {KEEP_THIN} or {FILL} surface, which add voxels that lie outside; leave one of them out")).into());
        }
        let (mesh, facts, notes) = self.solid()?;
        // A mesh without colours has none to store.
        let colored = mesh.paint.as_ref().is_some_and(|paint| paint.wanted.colors);
        let stored = self.options.channels().iter().filter(|channel| *channel != Channel::Color || colored);
        let channels = stored.collect();
        let held_bytes =
            Bins::memory_bytes(self.boxes(&mesh.grid)) + mesh.paint.as_ref().map_or(0, paint::Paint::bytes);
        let scratch_bytes = mesh.bins.bytes();
        let solid = self.built(mesh);
        let making_s = started.elapsed().as_secs_f64();
        let made = FileSolid { solid, held_bytes, scratch_bytes, reading_s: making_s, making_s };
        Ok((made, channels, facts, notes))
    }

    /// The solid whose model is built of a mesh.
    fn built(&self, mesh: MeshSolid) -> Box<dyn Solid> {
        match self.mesh.thin() {
            None if self.is_of_cells() => {
                let dims = self.boxes(&mesh.grid);
                Box::new(MeshCells { mesh, dims })
            }
            None => Box::new(mesh),
            Some(thin) => Box::new(ThinSolid { mesh, thin }),
        }
    }

    pub(super) fn solid(&self) -> Result<(MeshSolid, MeshFacts, Vec<MeshNote>), BuildError> {
        // Computed before anything is opened, so that nothing counts twice.
        let dry = Budget::dry(self.options.memory);
        self.solid_within(&Budget::of_job(self.options.memory)).map_err(|error| {
            let described = described_bytes(&error);
            let error = described.map_or(error, |bytes| too_small(self.name(), self.options.memory, bytes));
            let named = error.minimum_bytes();
            match named.and_then(|_| self.sufficient_bytes().ok()) {
                // A quarter more: resident memory differs from one size of cap to another.
                Some(bytes) => error.with_minimum(dry.smallest_limit_with(bytes + bytes / 4)),
                None => error,
            }
        })
    }

    /// Memory that suffices for every stage: the sum of the stages, for these files.
    fn sufficient_bytes(&self) -> Result<u64, BuildError> {
        let mut mesh = *self.mesh;
        let described = match self.open(DESCRIPTIONS) {
            Ok(files) => {
                let Grid { voxel_mm, origin_mm, dims, .. } = self.grid(&files)?.0;
                mesh.grid = GridChoice::Exact { edge_mm: voxel_mm, origin_mm, dims };
                let held: u64 = files.iter().map(|file| file.summary.held_bytes).sum();
                let materials: u64 = files.iter().map(|file| file.summary.materials.len() as u64).sum();
                2 * held + image_bytes(&files, self.wanted(&files)) + materials * MATERIAL_BYTES
            }
            Err(error) => {
                let error = BuildError::from(error);
                // Larger descriptions are not read to learn their size.
                described_bytes(&error).map(|bytes| 4 * bytes).ok_or(error)?
            }
        };
        Ok(described + sufficient_share(&mesh, self.options))
    }

    fn solid_within(&self, budget: &Budget) -> Result<(MeshSolid, MeshFacts, Vec<MeshNote>), BuildError> {
        let reading = self.reserve(budget, READER_BYTES)?;
        let files = self.open(budget.left_bytes() / 2)?;
        let described = self.reserve(budget, files.iter().map(|file| file.summary.held_bytes).sum())?;
        let others = files.iter().flat_map(|file| &file.summary.files);
        let inputs: Vec<_> =
            self.inputs.iter().chain(others).map(|p| (p.clone(), file_identity(p))).collect();
        let (grid, thin) = self.grid(&files)?;
        let held = self.reserve(budget, Bins::memory_bytes(self.boxes(&grid)))?;
        let binning = self.reserve(budget, BINNING_BYTES)?;
        let (binner, counted, paint) = self.binned(budget, &files, &grid)?;
        if counted.triangles == 0 {
            return Err(self.unusable(no_triangles()).into());
        }
        let as_it_is = |binner: Binner, boundary, rule| {
            Ok::<_, BuildError>(Closing { bins: binner.finish()?, boundary, rule, closed: true })
        };
        let Closing { bins, boundary, rule, mut closed } = match counted.census.closed() {
            Closed::Oriented => as_it_is(binner, Boundary::Oriented, Rule::NonZero)?,
            Closed::Mixed => as_it_is(binner, Boundary::Mixed, Rule::Odd)?,
            Closed::No if self.mesh.fill == Some(Fill::Surface) => {
                as_it_is(binner, Boundary::Sheet, Rule::NonZero)?
            }
            Closed::No => self.capped(budget, &files, &grid, (binner, binning))?,
        };
        let parts = files.iter().map(MeshFile::parts).sum();
        let mut notes = self.notes(&files);
        // Open parts of a closed mesh bound it together, as the sides of a box do.
        let thin =
            if closed && !matches!(boundary, Boundary::Open { .. }) { thin[0] } else { thin[0] + thin[1] };
        if thin > 0 && self.mesh.thin().is_none() {
            notes.push(MeshNote { mesh: self.mesh_name(), lack: format!("has {parts} parts, of which {thin} {} thinner than a voxel and not in the model; {FILL} surface or smaller voxels keep {}", if thin == 1 { "is" } else { "are" }, if thin == 1 { "it" } else { "them" }) });
        }
        drop(files);
        drop((reading, held, described));
        let (rule, fill) = match self.mesh.fill {
            Some(Fill::Winding) => {
                // Caps of odd edges, or directions that disagree, leave sums behind the last crossing.
                closed &= rule == Rule::NonZero;
                (Rule::NonZero, Fill::Winding)
            }
            Some(Fill::Parity) => (Rule::Odd, Fill::Parity),
            Some(Fill::Surface) => (rule, Fill::Surface),
            None if rule == Rule::NonZero => (rule, Fill::Winding),
            None => (rule, Fill::Parity),
        };
        let facts = MeshFacts {
            triangles: counted.triangles,
            flat: counted.flat,
            parts,
            files: self.inputs.len() as u64,
            boundary,
            fill,
            asked_for: self.mesh.fill.is_some(),
            keep_thin: self.mesh.thin() == Some(Thin::Walls),
            voxel_mm: grid.voxel_mm,
            origin_mm: grid.origin_mm,
        };
        let resident = self.resident(&bins, &grid, paint.as_ref());
        let open = matches!(boundary, Boundary::Open { .. });
        let (name, wanted) = (self.name(), paint.as_ref().map(|paint| paint.wanted));
        let reach = Arc::clone(&self.reach);
        let mesh = MeshSolid { name, grid, bins, rule, closed, open, resident, reach, inputs, wanted, paint };
        Ok((mesh, facts, notes))
    }

    /// The solid of a closed surface in memory.
    pub(super) fn of_triangles(&self, triangles: &[Triangle], rule: Rule) -> Result<MeshSolid, BuildError> {
        let grid = self.grid(&[])?.0;
        let mut binner = Binner::new(self.boxes(&grid), &self.scratch)?;
        triangles.iter().try_for_each(|t| binner.add(t))?;
        let bins = binner.finish()?;
        let (resident, reach) = (self.resident(&bins, &grid, None), Arc::clone(&self.reach));
        let (name, inputs, closed) = (String::new(), Vec::new(), rule == Rule::NonZero);
        let (wanted, paint) = (None, None);
        Ok(MeshSolid { name, grid, bins, rule, closed, open: false, resident, reach, inputs, wanted, paint })
    }

    /// All triangles in bins, their counts, and their looks.
    fn binned(
        &self,
        budget: &Budget,
        files: &[MeshFile],
        grid: &Grid,
    ) -> Result<(Binner, Counts, Option<paint::Paint>), BuildError> {
        let mut binner = Binner::new(self.boxes(grid), &self.scratch)?;
        let wanted = self.wanted(files);
        if !wanted.anything() {
            let counted = self.count(files, grid, &mut |t| binner.add(t))?;
            return Ok((binner, counted, None));
        }
        let _collecting = self.reserve(budget, COLLECTING_BYTES + image_bytes(files, wanted))?;
        let boxes = (self.options.volume_surface(), self.boxes(grid));
        let mut collector = Collector::new(wanted, boxes, &self.scratch)?;
        let mut known = 0;
        let counted = self.count_looks(files, grid, &mut |t, look, file| {
            if known == file {
                known += 1;
                let first_part = files[..file].iter().map(MeshFile::parts).sum();
                collector
                    .file(first_part, &files[file].summary.materials)
                    .map_err(|error| error.in_file(self.inputs.get(file)))?;
            }
            collector.add(t, look)?;
            binner.add(t)
        })?;
        Ok((binner, counted, Some(collector.finish()?)))
    }

    /// Caps over the loops of open edges, among the other triangles.
    fn capped(
        &self,
        budget: &Budget,
        files: &[MeshFile],
        grid: &Grid,
        (binner, binning): (Binner, Reservation),
    ) -> Result<Closing, BuildError> {
        // The pool makes room for the table of edges.
        let bins = binner.finish()?;
        drop(binning);
        let closing = self.reserve(budget, BOUNDARY_BYTES)?;
        let (edges, sums, closed) = match self.open_edges(files, grid)? {
            Some((edges, sums)) => (edges, sums, true),
            // A stated fill takes the mesh as it is.
            None if self.mesh.fill.is_some() => (Vec::new(), Sums::Signed, false),
            None => return Err(self.unusable(boundary::too_open()).into()),
        };
        let open = edges.len() as u64;
        let mut caps = Vec::new();
        let loops = boundary::close(edges, sums, &mut |t| {
            caps.push(t);
            Ok(())
        })?;
        drop(closing);
        let _binning = self.reserve(budget, BINNING_BYTES)?;
        let mut binner = Binner::go_on(bins);
        for cap in &caps {
            binner.add(cap)?;
        }
        let rule = if sums == Sums::Signed { Rule::NonZero } else { Rule::Odd };
        let boundary = Boundary::Open { edges: open, loops };
        Ok(Closing { bins: binner.finish()?, boundary, rule, closed })
    }

    /// Missing parts of files.
    fn notes(&self, files: &[MeshFile]) -> Vec<MeshNote> {
        let of = |(file, path): (&MeshFile, &PathBuf)| {
            let mesh = base_name(path);
            file.lacks().map(|lack| MeshNote { mesh: mesh.clone(), lack }).collect::<Vec<_>>()
        };
        let mut notes: Vec<_> = files.iter().zip(self.inputs).flat_map(of).collect();
        let colored = files.iter().any(|file| file.summary.looks[0]);
        let lack = if self.placed.is_some() {
            Some("has colours, which the model of a tree does not keep".to_owned())
        } else if self.options.joins() {
            Some(format!("has colours, which larger leaves do not hold; leave out {ERROR} to keep them"))
        } else {
            None
        };
        notes.extend(lack.filter(|_| colored).map(|lack| MeshNote { mesh: self.mesh_name(), lack }));
        notes
    }

    /// Takes memory for a part of the work; [`super::least_share`] counts it.
    fn reserve(&self, budget: &Budget, bytes: u64) -> Result<Reservation, BuildError> {
        budget.reserve(bytes).map_err(|_| too_small(self.name(), self.options.memory, bytes))
    }

    fn open(&self, most_bytes: u64) -> Result<Vec<MeshFile>, SourceError> {
        let MeshOptions { unit_mm, up, follow_links, .. } = *self.mesh;
        let PaintChannels { colors, normals: looks, .. } = self.asked();
        let scratch = &self.scratch;
        let limits =
            Limits { scratch, most_bytes, follow_links, looks: looks || colors, colors, unit_mm, up };
        self.inputs.iter().map(|path| MeshFile::open(path, &limits)).collect()
    }

    /// Chosen channels. Parts of something else have only normals, from their own triangles; cells have the normals of
    /// their planes.
    fn asked(&self) -> PaintChannels {
        let asked = |channel| self.placed.is_none() && self.options.channels().contains(channel);
        PaintChannels {
            colors: asked(Channel::Color),
            parts: asked(Channel::Material),
            normals: asked(Channel::Normal) && !self.is_of_cells(),
        }
    }

    /// Channels that are chosen and present.
    fn wanted(&self, files: &[MeshFile]) -> PaintChannels {
        let has = |k: usize| files.iter().any(|file| file.summary.looks[k]);
        let asked = self.asked();
        PaintChannels { colors: asked.colors && has(0), normals: asked.normals && has(1), ..asked }
    }

    /// Note on a model that is short of its mesh, as walls thinner than a voxel vanished; known once it is built.
    pub(super) fn short(&self) -> Option<MeshNote> {
        let voxels = self.reach.short()?;
        Some(MeshNote {
            mesh: self.mesh_name(),
            lack: format!(
                "extends {voxels} voxels beyond the model: that part is thinner than a voxel; {FILL} surface or smaller voxels keep it"
            ),
        })
    }

    pub(super) fn mesh_name(&self) -> String {
        if let [only] = self.inputs { base_name(only) } else { "the mesh".to_owned() }
    }

    /// The chosen grid, and the numbers of parts, closed and open ones, that hold no centre of a voxel, if there are
    /// several parts; the bounds are those of triangles, not of vertices that no face names.
    fn grid(&self, files: &[MeshFile]) -> Result<(Grid, [u64; 2]), SourceError> {
        let mut bounds = Bounds::EMPTY;
        let mut parts = Vec::new();
        if !matches!(self.mesh.grid, GridChoice::Exact { .. }) {
            self.progress.stage("bounds", files.len() as u64);
            for file in files {
                self.part_bounds(file, &mut parts)?;
                self.progress.step(1)?;
            }
            for part in parts.iter().map(|part| &part.bounds).filter(|part| **part != Bounds::EMPTY) {
                [part.low, part.high].into_iter().for_each(|corner| bounds.add(corner));
            }
            if bounds == Bounds::EMPTY {
                return Err(self.unusable(no_triangles()));
            }
        }
        let grid =
            Grid::new(self.mesh.grid, &bounds, self.mesh.unit_mm).map_err(|fault| self.unusable(fault))?;
        let mut thin = [0; 2];
        for part in parts.iter().filter(|part| parts.len() > 1 && part.bounds != Bounds::EMPTY) {
            thin[usize::from(part.open != 0)] += u64::from(!grid.has_centre(&part.bounds));
        }
        if thin == [0; 2] && bounds != Bounds::EMPTY && self.mesh.thin().is_none() {
            self.reach.expect(grid.centres(&bounds));
        }
        Ok((grid, thin))
    }

    /// Adds the bounds of the parts of a file, as many as there is room for: others share the last.
    fn part_bounds(&self, file: &MeshFile, parts: &mut Vec<PartBounds>) -> Result<(), SourceError> {
        let first = parts.len().min(MAX_PARTS - 1);
        let all = usize::try_from(file.parts()).unwrap_or(MAX_PARTS);
        parts.resize((first + all).clamp(parts.len().max(1), MAX_PARTS), PartBounds::EMPTY);
        if file.parts() == 1 {
            return file.for_each(&self.scratch, &mut |t| {
                t.iter().for_each(|p| parts[first].bounds.add(*p));
                Ok(())
            });
        }
        file.for_each_look(&self.scratch, &mut |t, look| {
            let at = first.saturating_add(look.part as usize).min(parts.len() - 1);
            parts[at].add(t);
            Ok(())
        })
    }

    /// Brings every triangle onto the lattice, counts it, and hands it on.
    fn count(
        &self,
        files: &[MeshFile],
        grid: &Grid,
        each: &mut dyn FnMut(&Triangle) -> Result<(), SourceError>,
    ) -> Result<Counts, SourceError> {
        let place = |p| self.point(grid, p);
        self.go_through(files, &mut |file, _, counts| {
            file.for_each_corner(&self.scratch, &place, &mut |corners| {
                counts.add(corners);
                Ok(each(&smallest_first(corners.map(|corner| corner.at)))?)
            })
        })
    }

    /// Like `count`, with the looks of triangles, and the number of the file.
    fn count_looks(
        &self,
        files: &[MeshFile],
        grid: &Grid,
        each: &mut dyn FnMut(&Triangle, &Appearance, usize) -> Result<(), SourceError>,
    ) -> Result<Counts, SourceError> {
        let place = |p| self.point(grid, p);
        self.go_through(files, &mut |file, number, counts| {
            file.for_each_look(&self.scratch, &mut |t, look| {
                let corners = t.map(|p| Corner::new(p, &place));
                Corner::check(&corners, 0)?;
                let at = corners.map(|corner| corner.at);
                let t = smallest_first(at);
                let mut look = *look;
                if look != Appearance::NONE {
                    look = look.rotated(at.iter().position(|corner| t.starts_with(corner)).unwrap_or(0));
                }
                counts.add(&corners);
                Ok(each(&t, &look, number)?)
            })
        })
    }

    #[inline]
    fn point(&self, grid: &Grid, p: [f64; 3]) -> Option<[i32; 3]> {
        match &self.placed {
            Some(placed) => grid.point(placed.apply(p)),
            None => grid.point(p),
        }
    }

    /// Reads all files, one after the other.
    fn go_through(
        &self,
        files: &[MeshFile],
        read: &mut dyn FnMut(&MeshFile, usize, &mut Counts) -> Result<(), SourceError>,
    ) -> Result<Counts, SourceError> {
        self.progress.stage("triangles", files.len() as u64);
        let mut counts = Counts::default();
        for (number, file) in files.iter().enumerate() {
            read(file, number, &mut counts)?;
            self.progress.step(1)?;
        }
        Ok(counts)
    }

    /// The open edges, and the way of counting them: with their direction, unless that disagrees with its neighbours;
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

    /// Number of triangles that a worker may load: as many as the fullest bin has, if the budget has room.
    fn resident(&self, bins: &Bins, grid: &Grid, paint: Option<&paint::Paint>) -> usize {
        let tile = Tile { columns: grid.dims.nx().min(1024), channels: self.options.channels() };
        let own = (COLUMN_BYTES + fixed_bytes(&tile)).max(MIN_WORKER) + WORKER_OVERHEAD;
        let own = own + paint.map_or(0, |_| Painter::BYTES);
        let own = own + if self.is_of_cells() { CellEdges::BYTES } else { 0 };
        let left = Budget::of_job(self.options.memory).left_bytes();
        // Thin walls take triangles of their own.
        let (own, shares) = match self.mesh.thin() {
            None => (own, 1),
            Some(_) => (own + shell::fixed_bytes(&tile), 2),
        };
        let each = (left / self.options.threads.max(1) as u64).saturating_sub(own) / shares;
        // A longer triangle takes two more places, and one near to two bricks another.
        let most = 4 * bins.fullest() as usize + 8;
        Resident::fit(each).clamp(MIN_RESIDENT, MIN_RESIDENT.max(most))
    }
}
