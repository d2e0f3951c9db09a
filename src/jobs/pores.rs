//! `oct pores`: single cavities that a model encloses, or its separate bodies.

mod components;
mod gap;

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Seek, Write};
use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use super::cell_volume::CellVolume;
use super::export::{ExportRequest, commit, exported, refuse_input, refuse_seen, unknown_inside};
use super::measure::wall_areas;
use super::open_model::{open_model, refuse_larger_leaves, scratch_beside};
use super::verify::verify_unless_packed;
use crate::atomic::AtomicFile;
use crate::budget::peak_rss_bytes;
use crate::error::Error;
use crate::export::{ExportForm, LayerCell, RegionFrame, RegionSlice};
use crate::fault::usage;
use crate::geom::Affine;
use crate::load::{Model, ModelView, NodeView};
use crate::measure::nearest::Surface;
use crate::progress::Progress;
use crate::text::names::SURFACE;
use crate::text::{Count, Rounded, Short, data, shown};

use components::{Component, Components, Side, Sought};
use gap::{LEFT_OUT, Notes};

/// Rows that the text for people shows.
const SHOWN: usize = 10;

/// Rows of the largest that a report holds.
const LARGEST: usize = 20;

/// A component whose equivalent diameter is less than this many voxels is below the resolution: the smallest structure
/// that can still be measured (VDI/VDE 2630-1.3).
const RESOLVED_VOXELS: f64 = 3.0;

/// Selection and measures of components.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoresRequest {
    /// True for bodies, false for pores.
    pub bodies: bool,
    /// Components of fewer samples are left out.
    pub least: u64,
    /// True to measure how far pores are from the outer surface.
    pub gap: bool,
}

/// A pore, or a body. Lengths are in mm (LPS).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Pore {
    /// Number, from 1 on: in the order of last slices, in each by first samples.
    pub id: u64,
    /// Label of a body of a model of labels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label: Option<u16>,
    /// Volume in mm3: samples times the volume of a voxel.
    pub volume_mm3: f64,
    /// Area of the surface around it.
    pub area_mm2: f64,
    /// Mean position of its samples.
    pub at_mm: [f64; 3],
    /// Least and greatest coordinates of its voxels.
    pub box_mm: [[f64; 3]; 2],
    /// Diameter of a ball of the same volume.
    pub equivalent_diameter_mm: f64,
    /// Area of that ball over its own area, at most 1.
    pub sphericity: f64,
    /// Number of samples.
    pub samples: u64,
    /// True if its equivalent diameter is less than three voxels, along the axis where voxels are longest.
    pub below_resolution: bool,
    /// Distance from the outer surface, if it was asked for and there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gap_mm: Option<f64>,
}

/// Columns of the table; the gap comes last, if it is asked for.
const COLUMNS: &str = "id,label,volume_mm3,area_mm2,x,y,z,x_min,y_min,z_min,x_max,y_max,z_max,equivalent_diameter_mm,\
                       sphericity,samples,below_resolution";

impl Pore {
    /// The row of the table.
    fn row(&self) -> String {
        let label = self.label.map(|label| label.to_string()).unwrap_or_default();
        let [x, y, z] = self.at_mm;
        let [low, high] = self.box_mm.map(|[x, y, z]| format!("{x},{y},{z}"));
        format!(
            "{},{label},{},{},{x},{y},{z},{low},{high},{},{},{},{}",
            self.id,
            self.volume_mm3,
            self.area_mm2,
            self.equivalent_diameter_mm,
            self.sphericity,
            self.samples,
            self.below_resolution
        )
    }
}

/// Pores or bodies of a model.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PoresReport {
    /// Input as named on the command line; several separated by blanks; `-` for standard input.
    pub input: String,
    /// Number of pores.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pores: Option<u64>,
    /// Number of bodies, if these were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bodies: Option<u64>,
    /// Porosity: volume of the pores over the volume of solid and pores.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub porosity: Option<f64>,
    /// Volume of the pores.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pore_volume_mm3: Option<f64>,
    /// Volume inside: samples times the volume of a voxel.
    pub solid_volume_mm3: f64,
    /// Components, or cells, below the resolution.
    pub below_resolution: u64,
    /// Least diameter that can still be measured.
    #[serde(skip)]
    pub resolved_mm: f64,
    /// Number of components left out for their few samples.
    pub below_least: u64,
    /// The largest components, at most 20.
    pub largest: Vec<Pore>,
    /// Sentences about the input: assumptions, parts left out, oddities.
    pub warnings: Vec<String>,
    /// Peak resident memory of the process.
    pub peak_rss_bytes: u64,
    /// Seconds from start to end.
    pub wall_s: f64,
}

/// Finds the pores of a model of cells, or its bodies.
///
/// Samples are at the corners of cells, at the volume's spacing. Pores are connected samples outside that the surface
/// encloses; an opening of one sample joins them to the outside, and so does the border of the volume. Bodies are
/// connected samples inside, of one label each. Volumes count samples; areas are areas of the surface in the cells.
///
/// `table` is the path of a CSV of all components.
///
/// Memory: as [`export`](super::export::export) of a mask, and some 150 bytes for each component of a slice. Cost: one pass
/// over the model. Gaps take a bit a cell, 8 bytes for each run of samples that began a component, 24 bytes of temporary
/// disk a cell, and a search for each cell of a pore.
///
/// # Errors
/// The model is damaged, has a skin of voxels (for gaps: several labels, larger leaves, axes not at right angles), or keeps
/// only what can be seen; the table cannot be written, and is left as it was before.
pub fn pores(
    input: &Path,
    request: PoresRequest,
    table: Option<&Path>,
    progress: &dyn Progress,
) -> Result<PoresReport, Error> {
    let start = Instant::now();
    table.map_or(Ok(()), |table| refuse_input(input, table))?;
    verify_unless_packed(input)?;
    let model = open_model(input)?;
    refuse(&model, input)?;
    let unwritable = |cause| Error::Output { path: table.unwrap_or(input).to_path_buf(), cause };
    if request.gap && request.bodies {
        return Err(usage!("gaps are measured from pores, not from bodies").into());
    }
    let out = table.map(AtomicFile::create).transpose().map_err(unwritable)?;
    let (view, solid_view) = (model.view(), model.solid_view());
    let surface = request.gap.then(|| surface_of(&model, &solid_view, input)).transpose()?;
    let scratch = || scratch_beside(table.unwrap_or(input)).map_err(unwritable);
    // Rows wait here for their gaps.
    let waiting = request.gap.then(scratch).transpose()?;
    let notes = request.gap.then(scratch).transpose()?;
    let rows = table.and(waiting.as_ref().or(out.as_ref().map(AtomicFile::file)));
    let geometry = Geometry::of(&model.affine());
    let is_labelled = !model.frame().labels.is_empty();
    let begin = |frame| Found::begin(frame, request, is_labelled, [rows, notes.as_ref()]);
    let work = |found: &mut Found, slice: &RegionSlice| {
        let sides = |cell: &LayerCell, add: &mut dyn FnMut(Side)| geometry.sides(&view, cell, add);
        let done = found.components.slice(slice, &sides);
        if let Some(notes) = &mut found.notes {
            notes.add(&found.components.noted)?;
        }
        done.iter().try_for_each(|component| found.take(component, &geometry))
    };
    let (paths, form) = ([input, table.unwrap_or(input)], ExportRequest::of(ExportForm::Nrrd));
    let (mut found, unknown) =
        exported(&model, paths, form, |exporter| exporter.regions(is_labelled, progress, &begin, &work))?;
    let solid = found.components.solid;
    let rest = found.components.finish();
    rest.iter().try_for_each(|component| found.take(component, &geometry)).map_err(unwritable)?;
    found.out.as_mut().map_or(Ok(()), Write::flush).map_err(unwritable)?;
    if let (Some(surface), Some(notes)) = (&surface, &mut found.notes) {
        let pores = usize::try_from(found.rows).unwrap_or(usize::MAX);
        let gaps =
            notes.gaps_mm((&model, surface), &found.components.parents, &found.ends, pores, progress)?;
        let gap = |id: u64| gaps.get(usize::try_from(id - 1).ok()?).copied().filter(|gap| gap.is_finite());
        found.largest.iter_mut().for_each(|pore| pore.gap_mm = gap(pore.id));
        if let (Some(out), Some(rows)) = (&out, rows) {
            with_gaps(rows, out.file(), gap).map_err(unwritable)?;
        }
    }
    model.check_unchanged(input)?;
    if let Some(out) = out {
        commit(out, table.unwrap_or(input), progress)?;
    }
    let solid_volume_mm3 = count(solid) * geometry.voxel_mm3;
    let pore_volume_mm3 = count(found.samples) * geometry.voxel_mm3;
    let of_pores = |value: f64| (!request.bodies).then_some(value);
    Ok(PoresReport {
        input: data(input),
        pores: (!request.bodies).then_some(found.rows),
        bodies: request.bodies.then_some(found.rows),
        porosity: of_pores(pore_volume_mm3 / (pore_volume_mm3 + solid_volume_mm3))
            .filter(|part| part.is_finite()),
        pore_volume_mm3: of_pores(pore_volume_mm3),
        solid_volume_mm3,
        below_resolution: found.below_resolution,
        resolved_mm: geometry.resolved_mm(),
        below_least: found.below_least,
        largest: found.largest,
        warnings: unknown_inside(unknown).into_iter().collect(),
        peak_rss_bytes: peak_rss_bytes(),
        wall_s: start.elapsed().as_secs_f64(),
    })
}

/// The outer surface, for gaps.
fn surface_of<'a>(model: &Model, view: &'a ModelView<'a>, input: &Path) -> Result<Surface<'a>, Error> {
    refuse_larger_leaves(model, input, "gaps are")?;
    Ok(Surface::open(view, &model.affine(), model.dims()).map_err(|fault| fault.at(input))?)
}

/// A writer of a file, which is emptied.
fn emptied(file: &File) -> io::Result<BufWriter<File>> {
    let mut file = file.try_clone()?;
    file.set_len(0)?;
    file.rewind()?;
    Ok(BufWriter::new(file))
}

/// Copies a table with one more column.
fn with_gaps(mut rows: &File, out: &File, gap: impl Fn(u64) -> Option<f64>) -> io::Result<()> {
    rows.rewind()?;
    let mut out = BufWriter::new(out);
    for (number, line) in (0..).zip(BufReader::new(rows).lines()) {
        let last = match number {
            0 => "gap_mm".into(),
            id => gap(id).map(|gap| gap.to_string()).unwrap_or_default(),
        };
        writeln!(out, "{},{last}", line?)?;
    }
    out.flush()
}

/// Refuses a model whose inside is not known.
fn refuse(model: &Model, input: &Path) -> Result<(), Error> {
    refuse_seen(model, input)?;
    if model.view().cells().is_none() {
        let fault =
            usage!("is a skin of voxels, which is too coarse to measure; build it with {SURFACE} cells");
        return Err(fault.at(input).into());
    }
    Ok(())
}

fn count(samples: u64) -> f64 {
    samples as f64
}

/// Conversion from voxels to mm.
struct Geometry {
    affine: Affine,
    columns: [[f64; 3]; 3],
    voxel_mm3: f64,
    longest_mm: f64,
}

impl Geometry {
    /// From an affine of indices of cells to LPS mm.
    fn of(affine: &Affine) -> Self {
        Self {
            affine: affine.starting_at([0.5; 3]),
            columns: [0, 1, 2].map(|axis| affine.column(axis)),
            voxel_mm3: affine.determinant().abs(),
            longest_mm: affine.spacing_mm().into_iter().fold(0.0, f64::max),
        }
    }

    /// The areas of a cell's surface, by the labels on its sides.
    fn sides(&self, view: &ModelView<'_>, cell: &LayerCell, add: &mut dyn FnMut(Side)) {
        if let Some(shape) = &cell.shape {
            let area = CellVolume::of(shape, &self.columns).area;
            [(0, area), (1, area)].into_iter().for_each(add);
        } else if let Some(walls) = view.walls(cell.number) {
            let areas = wall_areas(&walls, &self.columns);
            areas.into_iter().flat_map(|(labels, area)| labels.map(|label| (label, area))).for_each(add);
        }
    }

    /// Least and greatest coordinates of the voxels of a range.
    fn box_mm(&self, [low, high]: [[i64; 3]; 2]) -> [[f64; 3]; 2] {
        let mut reach = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for corner in 0..8 {
            let at: [f64; 3] = std::array::from_fn(|a| {
                if corner >> a & 1 == 1 { high[a] as f64 + 0.5 } else { low[a] as f64 - 0.5 }
            });
            for (axis, c) in self.affine.apply(at).into_iter().enumerate() {
                reach[0][axis] = reach[0][axis].min(c);
                reach[1][axis] = reach[1][axis].max(c);
            }
        }
        reach
    }

    /// Least diameter that can still be measured.
    fn resolved_mm(&self) -> f64 {
        RESOLVED_VOXELS * self.longest_mm
    }

    fn pore(&self, id: u64, component: &Component, is_labelled: bool) -> Pore {
        let samples = count(component.samples);
        let volume_mm3 = samples * self.voxel_mm3;
        let ball_mm2 = (36.0 * PI * volume_mm3 * volume_mm3).cbrt();
        let equivalent_diameter_mm = (6.0 * volume_mm3 / PI).cbrt();
        Pore {
            id,
            label: Some(component.label).filter(|label| is_labelled && *label != 0),
            volume_mm3,
            area_mm2: component.area,
            at_mm: self.affine.apply(component.sums.map(|sum| sum as f64 / samples)),
            box_mm: self.box_mm(component.range),
            equivalent_diameter_mm,
            sphericity: if component.area > 0.0 { (ball_mm2 / component.area).min(1.0) } else { 1.0 },
            samples: component.samples,
            below_resolution: equivalent_diameter_mm < self.resolved_mm(),
            gap_mm: None,
        }
    }
}

/// Components and sums so far, and the outputs.
struct Found {
    components: Components,
    least: u64,
    is_labelled: bool,
    out: Option<BufWriter<File>>,
    rows: u64,
    samples: u64,
    below_resolution: u64,
    below_least: u64,
    largest: Vec<Pore>,
    /// Notes for gaps: cells, and components that have ended, with their pores' numbers.
    notes: Option<Notes>,
    ends: Vec<(u32, u32)>,
}

impl Found {
    fn begin(
        frame: RegionFrame,
        request: PoresRequest,
        is_labelled: bool,
        [out, notes]: [Option<&File>; 2],
    ) -> io::Result<Self> {
        let sought = if request.bodies { Sought::Bodies } else { Sought::Pores };
        let begun = |out: &File| {
            let mut out = emptied(out)?;
            writeln!(out, "{COLUMNS}")?;
            io::Result::Ok(out)
        };
        Ok(Self {
            components: Components::new(sought, frame, request.gap),
            least: request.least,
            is_labelled,
            out: out.map(begun).transpose()?,
            rows: 0,
            samples: 0,
            below_resolution: 0,
            below_least: 0,
            largest: Vec::new(),
            notes: notes.map(|file| emptied(file).map(Notes)).transpose()?,
            ends: Vec::new(),
        })
    }

    fn take(&mut self, component: &Component, geometry: &Geometry) -> io::Result<()> {
        if component.samples < self.least {
            self.below_least += 1;
            self.ends.extend(self.notes.as_ref().map(|_| (component.serial, LEFT_OUT)));
            return Ok(());
        }
        self.rows += 1;
        let id = u32::try_from(self.rows).unwrap_or(LEFT_OUT);
        self.ends.extend(self.notes.as_ref().map(|_| (component.serial, id)));
        self.samples += component.samples;
        let pore = geometry.pore(self.rows, component, self.is_labelled);
        self.below_resolution += u64::from(pore.below_resolution);
        if let Some(out) = &mut self.out {
            writeln!(out, "{}", pore.row())?;
        }
        let at = self.largest.partition_point(|other| other.samples >= pore.samples);
        if at < LARGEST {
            self.largest.insert(at, pore);
            self.largest.truncate(LARGEST);
        }
        Ok(())
    }
}

impl PoresReport {
    /// Report for people.
    pub fn text(&self) -> String {
        let mut text = self.head();
        if !self.largest.is_empty() {
            text += "     no.    volume mm3   diameter mm  sphericity  at x, y, z mm (LPS)\n";
        }
        for pore in self.largest.iter().take(SHOWN) {
            let [x, y, z] = pore.at_mm.map(|c| Short(c).to_string());
            let [volume, diameter, sphericity] =
                [pore.volume_mm3, pore.equivalent_diameter_mm, pore.sphericity]
                    .map(|v| Rounded(v).to_string());
            let note = if pore.below_resolution { "  below the resolution" } else { "" };
            let gap =
                pore.gap_mm.map(|gap| format!("  {} mm from outside", Rounded(gap))).unwrap_or_default();
            let _ = writeln!(
                text,
                "  {:>6}  {volume:>12}  {diameter:>12}  {sphericity:>10}  {x}, {y}, {z}{gap}{note}",
                pore.id
            );
        }
        for warning in &self.warnings {
            let _ = writeln!(text, "  note: {warning}");
        }
        text
    }

    fn head(&self) -> String {
        let (input, solid) = (shown(&self.input), Rounded(self.solid_volume_mm3));
        let noun = if self.bodies.is_some() { "body" } else { "pore" };
        let mut text = match (self.pores, self.pore_volume_mm3) {
            (Some(pores), Some(volume)) => {
                let [volume, percent] = [volume, 100.0 * self.porosity.unwrap_or(0.0)].map(Rounded);
                let pores = Count(pores, noun);
                format!("{input}: {pores}, {volume} mm3 in {solid} mm3 of solid: porosity {percent} %\n")
            }
            _ => format!("{input}: {}, {solid} mm3\n", Count(self.bodies.unwrap_or(0), noun)),
        };
        if self.below_resolution > 0 {
            let (below, mm) = (Count(self.below_resolution, noun), Rounded(self.resolved_mm));
            let _ = writeln!(
                text,
                "  {below} of a diameter below {mm} mm, three voxels along their longest side: of uncertain size"
            );
        }
        if self.below_least > 0 {
            let _ = writeln!(text, "  {} of fewer voxels left out", Count(self.below_least, noun));
        }
        text
    }
}
