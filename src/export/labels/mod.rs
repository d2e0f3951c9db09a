//! A model of labels as triangles: a closed part for each label, neighbours sharing exactly the same wall.
//!
//! ```text
//!   cells between labels --> a vertex a cell by its walls (cell, walls)
//!     --> polygons of both labels of each edge (mesher) --> parts on disk (parts) --> files, part by part
//! ```
//!
//! Memory: two layers of cells, and the buffers of the parts. Temporary disk: 24 bytes a vertex and 12 a triangle. STL takes
//! 12 bytes a vertex of the largest part in memory, too. Fewer triangles (fewer) are made of one label after the other, so
//! that neighbours share their walls within the distance only.

mod cell;
mod fewer;
mod mesher;
mod parts;
mod walls;

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::Path;

use super::boundary::Bounded;
use super::mask::Mask;
use super::vertex_color::Lights;
use super::write::{GlbParts, Obj, Output, PartHead, Ply, Sink, Stl, ThreeMf, Vertex, counted};
use super::{Bounds, ExportForm, ExportStop, Exported, Exporter, Mesh};
use crate::format::Label;
use crate::geom::Dims;
use crate::interior::{SkinVoxel, extent};
use crate::load::ModelView;
use crate::progress::Progress;
use crate::scratch;

use mesher::{MARGIN, Mesher, Stored};
use parts::Parts;
use walls::Placing;

/// The corner of a cell on the high side along all axes.
pub(super) const HIGH: usize = 7;

/// Number of possible labels, 0 included.
const NUMBERS: usize = 1 << 16;

/// The surfaces of all labels of a model, to be written.
pub(crate) struct LabelMesh {
    parts: Parts,
    /// Labels that are wanted, and the part of each.
    labels: Vec<Label>,
    part_of: Vec<usize>,
    /// The reduction, for fewer triangles.
    made: Exported,
    /// True if vertices have normals: where walls are smooth.
    normals: bool,
}

impl Exporter<'_> {
    /// Makes the surfaces of the `wanted` ones of all labels, which are the same whatever else is wanted. A corner of the
    /// wall moves at most `smooth` voxels along each axis from where four voxels' edges meet; at 0 the walls are those of the
    /// voxels.
    ///
    /// # Errors
    /// The model is damaged, or the disk is full.
    pub(crate) fn label_mesh(
        &self,
        all: &[Label],
        wanted: &[bool],
        smooth: f64,
        scratch: &Path,
        progress: &dyn Progress,
    ) -> Result<LabelMesh, ExportStop> {
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        let [low, end] = bounds;
        let mut part_of = vec![0; NUMBERS];
        for (part, label) in (1..).zip(all) {
            part_of[usize::from(label.number)] = part;
        }
        // Cells of the box have [`MARGIN`] columns and rows before them.
        let before = [MARGIN, MARGIN, 0].map(f64::from);
        let to_mm = self.affine.starting_at(std::array::from_fn(|a| f64::from(low[a]) - before[a]));
        let parts = Parts::new(scratch::unnamed(scratch)?, wanted);
        let mut mesher = Mesher::new(to_mm, Placing::new(self.space, smooth), parts);
        let [width, height] = [0, 1].map(|a| end[a] - low[a] + MARGIN);
        let mut slices = 0..;
        self.label_slices(bounds, progress, &mut |cells| {
            let Some(z) = slices.next() else { return Ok(()) };
            mesher.next(&Stored { view: self.view, cells, low, width, height, part_of: &part_of }, z)
        })?;
        let parts = mesher.parts;
        let wanted_parts = (0..all.len()).filter(|part| wanted[*part]);
        let (part_of, labels): (Vec<_>, _) = wanted_parts.map(|part| (part, all[part].clone())).unzip();
        let (parts, made) = match self.is_fewer() {
            true => self.fewer_of_parts(&parts, (&part_of, wanted), scratch, progress)?,
            false => (parts, Exported::default()),
        };
        Ok(LabelMesh { parts, labels, part_of, made, normals: smooth > 0.0 })
    }

    /// Writes the labels of all voxels that are among these numbers, 0 for none, into an empty file.
    ///
    /// # Errors
    /// The model is damaged, the disk is full, or the format cannot hold so many voxels.
    pub(crate) fn label_map(
        &self,
        labels: &[u16],
        form: ExportForm,
        out: &File,
        progress: &dyn Progress,
    ) -> Result<Exported, ExportStop> {
        let mut shown = vec![0; NUMBERS];
        labels.iter().for_each(|label| shown[usize::from(*label)] = *label);
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        let [nx, ny, nz] = self.dims.to_array().map(|n| n - 1);
        let dims = Dims::new(nx, ny, nz).ok_or(ExportStop::Damaged)?;
        let mut mask = Mask::new(out.try_clone()?, form, dims, &self.affine.starting_at([0.5; 3]), true)?;
        mask.empty_until(bounds[0][2])?;
        self.label_slices(bounds, progress, &mut |cells| {
            mask.label_slice(|y, row| {
                let first = cells.partition_point(|cell| cell.y < y);
                let of_row = cells[first..].iter().take_while(|cell| cell.y == y);
                fill_row(self.view, of_row, &shown, row);
            })
        })?;
        let inside = mask.inside();
        mask.finish()?;
        Ok(Exported { inside, ..Exported::default() })
    }

    /// Calls `work` with the cells of every slice of the model's box.
    pub(super) fn label_slices(
        &self,
        bounds: Bounds,
        progress: &dyn Progress,
        work: &mut dyn FnMut(&[SkinVoxel]) -> io::Result<()>,
    ) -> Result<(), ExportStop> {
        let count = bounds[1][2] - bounds[0][2];
        progress.stage("export", count.into());
        let mut slices = 0;
        self.each_slice(bounds, |cells| {
            progress.step(1)?;
            // The first and the last slice lie beyond the box.
            if (1..=count).contains(&slices) {
                work(cells)?;
            }
            slices += 1;
            Ok(Some(()))
        })?;
        Ok(())
    }
}

/// Fills a row of samples with what is shown of their labels, by the cells that end at them: between two cells of a row the
/// label stays.
fn fill_row<'c>(
    view: &ModelView<'_>,
    cells: impl Iterator<Item = &'c SkinVoxel>,
    shown: &[u16],
    row: &mut [u16],
) {
    let (mut from, mut label) = (0, 0);
    for cell in cells {
        let Some(walls) = view.walls(cell.voxel.get()) else { continue };
        let x = cell.x as usize;
        if let Some(between) = row.get_mut(from..x) {
            between.fill(label);
        }
        (from, label) = (x, shown[usize::from(walls.corner(HIGH))]);
    }
}

impl LabelMesh {
    /// The labels, in the order of the parts.
    pub(crate) fn labels(&self) -> &[Label] {
        &self.labels
    }

    /// Vertices and triangles of each label.
    pub(crate) fn counts(&self) -> impl Iterator<Item = [u64; 2]> {
        self.part_of.iter().map(|part| self.parts.counts(*part))
    }

    /// Greatest distance in mm from the fine surfaces, where triangles were left out and it was measured.
    pub(crate) fn distance_mm(&self) -> Option<f64> {
        self.made.distance_mm
    }

    /// The surfaces in memory, one after the other.
    ///
    /// # Errors
    /// The disk's, and [`ExportFault::TooLong`](super::ExportFault::TooLong).
    pub(crate) fn in_memory(&self) -> Result<Mesh, ExportStop> {
        let mut mesh = Mesh::default();
        for (part, head) in self.part_of.iter().zip(self.heads(0..self.labels.len())?) {
            self.parts.each_vertex(*part, |[at, normal]| {
                mesh.vertices.push(at);
                mesh.colors.push(head.color);
                mesh.normals.extend(self.normals.then_some(normal));
                Ok(())
            })?;
            self.parts.each_triangle(*part, |corners| {
                mesh.faces.push(corners.map(|corner| head.first + corner));
                Ok(())
            })?;
        }
        Ok(mesh)
    }

    /// Writes some of the parts into an empty file; pending data goes to anonymous files in `scratch`.
    ///
    /// # Errors
    /// Errors of the disk, and limits of the format.
    pub(crate) fn write(
        &self,
        form: ExportForm,
        out: &File,
        scratch: &Path,
        which: Range<usize>,
    ) -> Result<Exported, ExportStop> {
        let (out, heads) = (out.try_clone()?, self.heads(which.clone())?);
        let waiting = || scratch::unnamed(scratch);
        let sink: Box<dyn Output> = match form {
            ExportForm::Ply => Box::new(Ply::new(out, Some(waiting()?), self.normals, true)?.with_labels()),
            ExportForm::Obj => Box::new(Obj::new(out, self.normals)?),
            ExportForm::Glb => Box::new(GlbParts::new(out, &heads, self.normals)?),
            ExportForm::ThreeMf => Box::new(ThreeMf::new(out, &heads, waiting()?)?),
            _ => Box::new(Stl::new(out)?),
        };
        let (mut sink, lights) = (Bounded::new(sink, None), Lights::new());
        let mut exported = Exported { vertices: 0, triangles: 0, ..self.made };
        for (part, head) in self.part_of[which].iter().zip(&heads) {
            sink.part(head)?;
            let light = lights.of(head.color);
            self.parts.each_vertex(*part, |[at, normal]| sink.vertex(&Vertex { at, normal, light }))?;
            self.triangles(*part, head.first, &mut sink, form == ExportForm::Stl)?;
            exported.vertices += head.vertices;
            exported.triangles += head.triangles;
        }
        Ok(Exported { is_closed: Some(sink.finish()?.0), ..exported })
    }

    /// Heads of consecutive parts of a file.
    fn heads(&self, which: Range<usize>) -> Result<Vec<PartHead>, ExportStop> {
        let (mut heads, mut first) = (Vec::new(), 0);
        for (part, label) in self.part_of[which.clone()].iter().zip(&self.labels[which]) {
            let [vertices, triangles] = self.parts.counts(*part);
            let [low, high] = self.parts.bounds(*part);
            heads.push(PartHead {
                label: label.number,
                name: part_name(label),
                color: label.color,
                vertices,
                triangles,
                low,
                high,
                first: counted(first)?,
            });
            first += vertices;
        }
        Ok(heads)
    }

    /// Passes on a part's triangles; with the positions of their corners if `placed` is set.
    fn triangles(&self, part: usize, first: u32, sink: &mut dyn Sink, placed: bool) -> io::Result<()> {
        let mut places = Vec::new();
        if placed {
            self.parts.each_vertex(part, |[at, _]| {
                places.push(at);
                Ok(())
            })?;
        }
        let place = |corner: u32| places.get(corner as usize).copied().unwrap_or_default();
        self.parts.each_triangle(part, |corners| {
            let at = corners.map(place);
            sink.triangle(corners.map(|corner| first + corner), at)
        })
    }
}

/// A label's name, or its number where it has none.
pub(crate) fn part_name(label: &Label) -> String {
    if label.name.is_empty() { format!("label {}", label.number) } else { label.name.clone() }
}
