//! A model of labels as triangles: a closed part for each label, neighbours sharing the very same wall.
//!
//! ```text
//!   skin of a slice --> labels of all its samples (field) --> a corner a cell (cell, place)
//!   cells between labels -------------------------> a corner a cell by its walls (walls)
//!     --> polygons of both labels of each edge (mesher) --> parts on disk (parts) --> files, part by part
//! ```
//!
//! A model of skins is swept twice: first to learn what each skin encloses. Memory: of skins eight slices of the model's
//! box; two layers of cells, and the buffers of the parts. Temporary disk: 24 bytes a vertex and 12 a triangle. STL takes
//! 12 bytes a vertex of the largest part in memory, too.

mod cell;
mod field;
mod mesher;
mod parts;
mod place;
mod walls;

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::Path;

use super::mask::{Mask, MaskForm};
use super::tint::Lights;
use super::write::{GlbParts, Obj, Output, PartHead, Ply, Sink, Stl, ThreeMf, Vertex, counted};
use super::{Bounds, ExportForm, ExportStop, Exported, Exporter};
use crate::enclosed::{Fates, SkinVoxel, Sweep, extent};
use crate::format::Label;
use crate::geom::Dims;
use crate::load::NodeView;
use crate::progress::Progress;
use crate::scratch;

use field::{Field, MARGIN};
use mesher::{Mesher, Stored};
use parts::Parts;
use place::Placing;

/// Numbers that a label may have, and 0.
const NUMBERS: usize = 1 << 16;

/// The surfaces of all labels of a model, to be written.
pub(crate) struct LabelMesh {
    parts: Parts,
    labels: Vec<Label>,
    /// Are there normals?
    normals: bool,
    /// Voxels of which the model does not say whether they are inside.
    unknown: u64,
}

/// A slice of a model of labels: its skin, swept so far, or its cells.
enum Slice<'a> {
    Skin(&'a Sweep),
    Cells(&'a [SkinVoxel]),
}

impl Exporter<'_> {
    /// Makes the surfaces of labels. A corner of the wall moves at most `smooth` voxels along each axis from where four
    /// voxels' edges meet; at 0 the walls are those of the voxels.
    ///
    /// # Errors
    /// The model is damaged, or the disk is full.
    pub(crate) fn label_mesh(
        &self,
        labels: &[Label],
        smooth: f64,
        scratch: &Path,
        progress: &dyn Progress,
    ) -> Result<LabelMesh, ExportStop> {
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        let [low, end] = bounds;
        let (unknown, fates) = self.label_fates(labels, bounds, progress)?;
        let walls = self.has_walls();
        let mut part_of = vec![0; NUMBERS];
        for (part, label) in (1..).zip(labels) {
            part_of[usize::from(label.number)] = part;
        }
        // Between samples, of which that of a cell's number lies half a cell behind its middle.
        let half = if walls { 0.0 } else { 0.5 };
        let before = [MARGIN as f64 + half, MARGIN as f64 + half, half];
        let to_mm = self.affine.starting_at(std::array::from_fn(|a| f64::from(low[a]) - before[a]));
        let parts = Parts::new(scratch::unnamed(scratch)?, labels.len());
        let mut mesher = Mesher::new(to_mm, Placing::new(self.space, smooth), parts);
        let sides = [0, 1].map(|a| end[a] - low[a]);
        if walls {
            #[expect(clippy::cast_possible_truncation, reason = "4")]
            let [width, height] = sides.map(|side| side + MARGIN as u32);
            let mut slices = 0..;
            self.label_slices(bounds, fates, progress, &mut |slice| match (slice, slices.next()) {
                (Slice::Cells(cells), Some(z)) => {
                    let part_of = &part_of;
                    mesher.next_cells(&Stored { view: self.view, cells, low, width, height, part_of }, z)
                }
                _ => Ok(()),
            })?;
        } else {
            let mut field = Field::new(sides.map(|side| side as usize)).map_err(io::Error::from)?;
            self.label_slices(bounds, fates, progress, &mut |slice| {
                self.take(&mut field, slice, low, &part_of);
                mesher.next(&field)
            })?;
            for _ in 0..MARGIN {
                field.take(None, &part_of);
                mesher.next(&field)?;
            }
        }
        Ok(LabelMesh { parts: mesher.parts, labels: labels.to_vec(), normals: smooth > 0.0, unknown })
    }

    /// Writes the labels of all voxels, 0 for none, into an empty file.
    ///
    /// # Errors
    /// The model is damaged, the disk is full, or the format cannot hold so many voxels.
    pub(crate) fn label_map(
        &self,
        labels: &[Label],
        form: ExportForm,
        out: File,
        progress: &dyn Progress,
    ) -> Result<Exported, ExportStop> {
        let form = MaskForm::of(form).ok_or(ExportStop::Output(io::ErrorKind::Unsupported.into()))?;
        let bounds = extent(self.view).ok_or(ExportStop::Damaged)?;
        let [low, end] = bounds;
        let (unknown, fates) = match self.skin_only {
            true => (0, None),
            false => self.label_fates(labels, bounds, progress)?,
        };
        let less = u32::from(self.has_walls());
        let [nx, ny, nz] = self.dims.to_array().map(|n| n - less);
        let dims = Dims::new(nx, ny, nz).ok_or(ExportStop::Damaged)?;
        let affine = self.affine.starting_at([0.5 * f64::from(less); 3]);
        let numbers: Vec<u16> = (0..=u16::MAX).collect();
        let mut mask = Mask::new(out, form, dims, &affine, true)?;
        mask.empty_until(low[2])?;
        let mut field = Field::new([0, 1].map(|a| (end[a] - low[a]) as usize)).map_err(io::Error::from)?;
        self.label_slices(bounds, fates, progress, &mut |slice| {
            self.take(&mut field, slice, low, &numbers);
            mask.label_slice(|y, row| {
                let of_box = y.checked_sub(low[1]).and_then(|y| field.last_row(y as usize));
                if let (Some(of_box), Some(row)) = (of_box, row.get_mut(low[0] as usize..)) {
                    row.iter_mut().zip(of_box).for_each(|(label, of_box)| *label = *of_box);
                }
            })
        })?;
        let inside = mask.inside();
        mask.finish()?;
        Ok(Exported { inside, unknown, ..Exported::default() })
    }

    /// Are there walls between labels, that say which label lies on either side?
    fn has_walls(&self) -> bool {
        self.view.cells().is_some_and(|cells| cells.has_walls())
    }

    fn take(&self, field: &mut Field, slice: Slice<'_>, low: [u32; 3], part_of: &[u16]) {
        match slice {
            Slice::Skin(sweep) => field.take(Some(sweep), part_of),
            Slice::Cells(cells) => field.take_cells(self.view, cells, low, part_of),
        }
    }

    /// What each skin encloses, and of how many voxels the model does not say it.
    fn label_fates(
        &self,
        labels: &[Label],
        bounds: Bounds,
        progress: &dyn Progress,
    ) -> Result<(u64, Option<Fates>), ExportStop> {
        if self.has_walls() {
            return Ok((0, None));
        }
        progress.stage("inside", u64::from(bounds[1][2] - bounds[0][2]));
        let mut sweep = Sweep::new(bounds, self.outward()).by_labels().keeping_fates();
        let mut skin_of = vec![0_u64; NUMBERS];
        self.each_slice(bounds, |skin| {
            sweep.slice(self.view, skin);
            for item in sweep.last().skin.items() {
                skin_of[usize::from(item.label)] += 1;
            }
            Ok(Some(progress.step(1)?))
        })?;
        let beyond_skin = |number: u16| {
            let label = labels.binary_search_by_key(&number, |label| label.number).ok();
            let voxels = label.map_or(0, |at| labels[at].voxels);
            voxels.saturating_sub(skin_of[usize::from(number)])
        };
        let (enclosed, fates) = sweep.finish(&beyond_skin);
        Ok((enclosed.unknown, Some(fates)))
    }

    /// Hands on every slice of the model's box.
    fn label_slices(
        &self,
        bounds: Bounds,
        fates: Option<Fates>,
        progress: &dyn Progress,
        work: &mut dyn FnMut(Slice<'_>) -> io::Result<()>,
    ) -> Result<(), ExportStop> {
        let count = bounds[1][2] - bounds[0][2];
        progress.stage("export", count.into());
        let mut sweep = Sweep::new(bounds, self.outward()).by_labels().knowing(fates.unwrap_or_default());
        let mut slices = 0;
        self.each_slice(bounds, |skin| {
            progress.step(1)?;
            // The first and the last lie beyond the box.
            let within = (1..=count).contains(&slices);
            if self.has_walls() {
                if within {
                    work(Slice::Cells(skin))?;
                }
            } else {
                sweep.slice(self.view, skin);
                if within {
                    work(Slice::Skin(&sweep))?;
                }
            }
            slices += 1;
            Ok(Some(()))
        })?;
        Ok(())
    }
}

impl LabelMesh {
    /// The labels, in the order of the parts.
    pub(crate) fn labels(&self) -> &[Label] {
        &self.labels
    }

    /// Vertices and triangles of a part.
    pub(crate) fn counts(&self, part: usize) -> [u64; 2] {
        self.parts.counts(part)
    }

    /// Writes some of the parts into an empty file; data that has to wait goes to anonymous files in `scratch`.
    ///
    /// # Errors
    /// The disk's, and what the format cannot hold.
    pub(crate) fn write(
        &self,
        form: ExportForm,
        out: File,
        scratch: &Path,
        which: Range<usize>,
    ) -> Result<Exported, ExportStop> {
        let heads = self.heads(which.clone())?;
        let waiting = || scratch::unnamed(scratch);
        let mut sink: Box<dyn Output> = match form {
            ExportForm::Ply => Box::new(Ply::new(out, Some(waiting()?), self.normals, true)?.with_labels()),
            ExportForm::Obj => Box::new(Obj::new(out, self.normals)?),
            ExportForm::Glb => Box::new(GlbParts::new(out, &heads, self.normals)?),
            ExportForm::ThreeMf => Box::new(ThreeMf::new(out, &heads, waiting()?)?),
            _ => Box::new(Stl::new(out)?),
        };
        let lights = Lights::new();
        let mut exported = Exported { unknown: self.unknown, ..Exported::default() };
        for (part, head) in which.zip(&heads) {
            sink.part(head)?;
            let light = lights.of(head.color);
            self.parts.each_vertex(part, |[at, normal]| sink.vertex(&Vertex { at, normal, light }))?;
            self.triangles(part, head.first, sink.as_mut(), form == ExportForm::Stl)?;
            exported.vertices += head.vertices;
            exported.triangles += head.triangles;
        }
        sink.finish()?;
        Ok(exported)
    }

    /// Heads of parts that follow each other in a file.
    fn heads(&self, which: Range<usize>) -> Result<Vec<PartHead>, ExportStop> {
        let (mut heads, mut first) = (Vec::new(), 0);
        for (part, label) in which.clone().zip(self.labels.get(which).unwrap_or_default()) {
            let [vertices, triangles] = self.parts.counts(part);
            let [low, high] = self.parts.bounds(part);
            let (name, color) = (part_name(label), label.color);
            let of = counted(first)?;
            first += vertices;
            heads.push(PartHead {
                label: label.number,
                name,
                color,
                vertices,
                triangles,
                low,
                high,
                first: of,
            });
        }
        Ok(heads)
    }

    /// Hands on a part's triangles; with where their corners are, if that is asked for.
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
