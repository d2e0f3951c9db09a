//! A label map as a solid: the skin of every label, walls between neighbours included, in one pass.
//!
//! ```text
//!   slice z+2   --read-->  numbers of labels, 0 for none, in a ring of 5 slices
//!   slice z     skin: a label with a face neighbour that has another one, or none
//!               normal: gradient of the voxel's own label on z-2 ..= z+2; label
//! ```
//!
//! The ring has two columns and rows around the tile, 0 beyond the volume, so that no border is a special case.
//! Memory is that of [`worker_bytes`].
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^16")]

use std::borrow::Cow;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::classify::classify;
use super::error::BuildError;
use super::estimator::{Estimate, Gradient, Taps};
use super::gradient::{Codes, Gradients, NormalRule, REACH, SLICE_VOXELS, outward};
use super::item::ItemForm;
use super::options::BuildOptions;
use super::range::{Ordered, SampleRange};
use super::report::BuildNote;
use super::simd::{Isa, Kernel, dispatch, movemask};
use super::solid::{BRICK, OccupancyRows, ScanSummary, SkinSlice, Solid, SolidWorker, Tile, VoxelBox};
use crate::builder::BuildFault;
use crate::format::normal::NormalBits;
use crate::format::{Channel, Label, LabelName, MAX_LABELS, Metadata, Selection, SelectionKind, SourceMeta};
use crate::geom::Dims;
use crate::volume::{Fault, ScalarType, SourceError, SourceFault, StatedLabel, VolumeInfo, VolumeSource};

/// Columns and rows of the ring before the tile, and slices before the present one.
const HALO: usize = REACH as usize;
const RING: usize = 2 * HALO + 1;
/// Rows of the ring: a tile's and those around it.
const ROWS: usize = BRICK as usize + 2 * HALO;
/// Samples that are read at once for a normal.
const LANES: usize = 8;
/// A cache line of the ring: rows are an odd number of lines apart, and may be read beyond their end.
const LINE: usize = 32;
const _: () = assert!(2 * HALO + LANES <= LINE);

/// The labels of a volume that a model is built of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LabelChoice {
    /// Every number but 0.
    All,
    /// Those in these ranges, both ends included.
    Only(Vec<[u16; 2]>),
}

impl LabelChoice {
    /// Is this number among them?
    pub fn contains(&self, number: u16) -> bool {
        match self {
            Self::All => number > 0,
            Self::Only(ranges) => ranges.iter().any(|[lo, hi]| (*lo..=*hi).contains(&number)),
        }
    }
}

/// As `all`, or as `1,5,7..20`.
impl FromStr for LabelChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "all" {
            return Ok(Self::All);
        }
        let number = |text: &str| text.trim().parse().ok().filter(|n| *n > 0);
        let ranges = text.split(',').map(|part| match part.split_once("..") {
            Some((lo, hi)) => number(lo).zip(number(hi)).filter(|(lo, hi)| lo <= hi).map(|(lo, hi)| [lo, hi]),
            None => number(part).map(|n| [n, n]),
        });
        ranges.collect::<Option<_>>().map(Self::Only).ok_or_else(|| {
            format!("'{text}' does not name labels; write all, or numbers from 1 to 65535 as 1,5,7..20")
        })
    }
}

/// The items of a channel, of those that labels have.
pub(super) fn label_form(channel: Channel) -> Option<ItemForm> {
    match channel {
        Channel::Normal | Channel::Label => Some(ItemForm::AsIs { bytes: 2 }),
        Channel::Fine => Some(ItemForm::AsIs { bytes: 1 }),
        _ => None,
    }
}

/// Samples from one row of the ring to the next.
fn stride(tile: &Tile) -> usize {
    (2 * tile.columns.div_ceil(64) as usize + 1) * LINE
}

/// Bytes that one worker holds.
pub(super) fn worker_bytes(info: &VolumeInfo, tile: &Tile) -> u64 {
    // One more slice for what lies beyond the volume.
    let ring = (RING + 1) * ROWS * stride(tile) * size_of::<u16>();
    let columns = (tile.columns as usize + 2 * HALO).min(info.dims.nx() as usize);
    let staged = columns * ROWS.min(info.dims.ny() as usize) * info.scalar.bytes();
    (ring + staged + SLICE_VOXELS * 21 + MAX_LABELS * size_of::<Count>()) as u64
}

/// What a table states of labels; what the input states where there is no table.
fn names<'a>(table: &'a [LabelName], stated: &[StatedLabel]) -> Cow<'a, [LabelName]> {
    if !table.is_empty() {
        return Cow::Borrowed(table);
    }
    let of = |StatedLabel { number, name, color, .. }: &StatedLabel| LabelName {
        number: *number,
        name: name.clone(),
        color: *color,
    };
    stated.iter().map(of).collect()
}

/// The solid of the labels that are chosen.
///
/// # Errors
/// The options ask for what labels do not have.
pub(super) fn label_solid<'a>(
    source: &'a dyn VolumeSource,
    choice: &'a LabelChoice,
    options: &'a BuildOptions,
) -> Result<Box<dyn Solid + 'a>, BuildError> {
    let refused = options.labels_refused();
    if let Some(asked) = refused {
        let name = source.info().description.name.clone();
        return Err(BuildFault::NotOfLabels { name, asked }.into());
    }
    let gradient = match options.gradient {
        Gradient::Isotropic5 | Gradient::Auto => Gradient::Label5,
        given => given,
    };
    let spacing_mm = source.info().spacing_mm;
    let estimate = Estimate::new(gradient, spacing_mm);
    let solid = LabelSolid {
        source,
        choice,
        names: names(&options.label_names, &source.info().description.labels),
        gradient,
        rule: NormalRule::new(spacing_mm, gradient),
        weights: std::iter::once(estimate.taps).chain(estimate.more).map(Weights::new).collect(),
        estimate,
        bits: options.normal_bits,
        counts: Mutex::default(),
    };
    Ok(match source.info().scalar {
        ScalarType::U8 => Box::new(Typed(solid, |v: u8| v.into())),
        ScalarType::I8 => Box::new(Typed(solid, |v: i8| v.into())),
        ScalarType::U16 => Box::new(Typed(solid, |v: u16| v.into())),
        ScalarType::I16 => Box::new(Typed(solid, |v: i16| v.into())),
        ScalarType::U32 => Box::new(Typed(solid, |v: u32| v.into())),
        ScalarType::I32 => Box::new(Typed(solid, |v: i32| v.into())),
        ScalarType::F32 => Box::new(Typed(solid, |v: f32| v.into())),
        ScalarType::F64 => Box::new(Typed(solid, |v: f64| v)),
    })
}

/// Voxels of a label.
type Count = (u16, u64);

struct LabelSolid<'a> {
    source: &'a dyn VolumeSource,
    choice: &'a LabelChoice,
    names: Cow<'a, [LabelName]>,
    gradient: Gradient,
    rule: NormalRule,
    estimate: Estimate,
    /// Of the estimate's one or two products.
    weights: Vec<Weights>,
    bits: NormalBits,
    /// Of all workers that are done, by number.
    counts: Mutex<Vec<Count>>,
}

/// A solid whose samples have this type, and their numbers.
struct Typed<'a, T>(LabelSolid<'a>, fn(T) -> f64);

impl LabelSolid<'_> {
    fn wrong(&self, fault: Fault) -> SourceError {
        let path = PathBuf::from(&self.source.info().description.name);
        SourceFault::Unusable { path, fault }.into()
    }

    /// The label of a sample; 0 for none.
    #[cold]
    fn label_of(&self, sample: f64) -> Result<u16, SourceError> {
        let value = self.source.info().rescale.apply(sample);
        if value.fract() != 0.0 {
            return Err(self.wrong(Fault::NotALabel { value }));
        }
        let number = if (0.0..=65_535.0).contains(&value) { Some(value as u16) } else { None };
        match (self.choice, number) {
            (LabelChoice::All, None) => Err(self.wrong(Fault::LabelRange { value })),
            (choice, Some(number)) if choice.contains(number) => Ok(number),
            _ => Ok(0),
        }
    }

    fn found(&self) -> std::sync::MutexGuard<'_, Vec<Count>> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Ordered> Solid for Typed<'_, T> {
    fn dims(&self) -> Dims {
        self.0.source.info().dims
    }

    fn metadata(&self, _: &ScanSummary) -> Metadata {
        let VolumeInfo { dims, scalar, rescale, spacing_mm, affine, description, .. } = self.0.source.info();
        let found = self.0.found();
        let ends = found.first().zip(found.last()).map_or((1, u16::MAX), |(first, last)| (first.0, last.0));
        Metadata {
            source: SourceMeta {
                format: description.format.clone(),
                kind: description.to_string(),
                files: description.files,
                bytes: description.bytes,
            },
            scalar: scalar.code(),
            spacing_mm: *spacing_mm,
            affine: affine.rows,
            rescale: [rescale.slope, rescale.intercept],
            selection: Selection { kind: SelectionKind::Range, lo: ends.0.into(), hi: ends.1.into() },
            gradient: match self.0.bits {
                NormalBits::Twelve => format!("{}, 12 bits", self.0.gradient.name()),
                _ => self.0.gradient.name().into(),
            },
            ..Metadata::of_grid(*dims, "")
        }
    }

    fn name(&self) -> String {
        self.0.source.info().description.name.clone()
    }

    fn form(&self, channel: Channel, _: &ScanSummary) -> Option<ItemForm> {
        label_form(channel)
    }

    fn worker_bytes(&self, tile: &Tile) -> u64 {
        worker_bytes(self.0.source.info(), tile)
    }

    fn input_bytes(&self) -> u64 {
        self.0.source.resident_bytes()
    }

    fn worker(&self, tile: &Tile) -> Box<dyn SolidWorker + '_> {
        Box::new(LabelWorker::new(&self.0, self.1, tile))
    }

    fn labels(&self) -> Result<Vec<Label>, BuildError> {
        let found = self.0.found();
        if found.len() > MAX_LABELS {
            return Err(BuildFault::Source(self.0.wrong(Fault::ManyLabels { most: MAX_LABELS })).into());
        }
        let label = |(number, voxels): &Count| {
            let stated = self.0.names.iter().find(|stated| stated.number == *number);
            Label {
                number: *number,
                name: stated.map_or_else(String::new, |stated| stated.name.clone()),
                color: stated.and_then(|s| s.color).unwrap_or_else(|| Label::default_color(*number)),
                voxels: *voxels,
            }
        };
        Ok(found.iter().map(label).collect())
    }

    fn check_unchanged(&self) -> Result<(), SourceError> {
        self.0.source.check_unchanged()
    }

    /// A table that names other labels, or the first label that was asked for, or has a name, and has no voxel.
    fn note(&self) -> Option<BuildNote> {
        let (found, names) = (self.0.found(), &self.0.names);
        let is_found = |named: &LabelName| found.binary_search_by_key(&named.number, |count| count.0).is_ok();
        if !names.is_empty() && !names.iter().any(is_found) {
            return Some(BuildNote::LabelsUnnamed { named: names.len() });
        }
        let LabelChoice::Only(ranges) = self.0.choice else {
            let mut absent = names.iter().filter(|named| !is_found(named));
            let first = absent.next()?.number;
            return Some(BuildNote::NamesAbsent { first, others: absent.count() });
        };
        let is_there = |[lo, hi]: &[u16; 2]| found.iter().any(|(number, _)| (*lo..=*hi).contains(number));
        let mut absent = ranges.iter().filter(|range| !is_there(range));
        let first = absent.next()?[0];
        Some(BuildNote::LabelsAbsent { first, others: absent.count() })
    }

    fn nothing_inside(&self) -> BuildError {
        BuildFault::NoLabels { name: self.name() }.into()
    }
}

/// One thread's ring of slices.
struct LabelWorker<'a, T> {
    solid: &'a LabelSolid<'a>,
    to_number: fn(T) -> f64,
    column: VoxelBox,
    stride: usize,
    ring: Vec<u16>,
    /// A slice beyond the volume.
    none: Vec<u16>,
    staged: Vec<T>,
    /// The sample before, and its label.
    known: Option<(T, u16)>,
    normals: bool,
    gradients: Box<Gradients>,
    codes: Box<Codes>,
    /// Of the skin voxels that are described, the places of the first of the samples around them.
    places: Vec<u32>,
    labels: Vec<u8>,
    counts: Vec<Count>,
    reading: Duration,
}

impl<'a, T: Ordered> LabelWorker<'a, T> {
    fn new(solid: &'a LabelSolid<'a>, to_number: fn(T) -> f64, tile: &Tile) -> Self {
        let stride = stride(tile);
        Self {
            solid,
            to_number,
            column: VoxelBox { x: 0..0, y: 0..0, z: 0..0 },
            stride,
            ring: vec![0; RING * ROWS * stride],
            none: vec![0; ROWS * stride],
            staged: Vec::new(),
            known: None,
            normals: tile.channels.contains(Channel::Normal),
            gradients: Gradients::new(&solid.rule),
            codes: Codes::new(solid.bits),
            places: Vec::with_capacity(SLICE_VOXELS),
            labels: Vec::with_capacity(2 * SLICE_VOXELS),
            counts: Vec::new(),
            reading: Duration::ZERO,
        }
    }

    /// Reads a slice of the column, with what lies around its tile, into its place of the ring.
    fn load(&mut self, z: u32) -> Result<(), SourceError> {
        let dims = self.solid.source.info().dims.to_array();
        let around =
            |own: &std::ops::Range<u32>, n: u32| own.start.saturating_sub(REACH)..(own.end + REACH).min(n);
        let (cols, rows) = (around(&self.column.x, dims[0]), around(&self.column.y, dims[1]));
        let width = cols.len();
        self.staged.resize(width * rows.len(), bytemuck::Zeroable::zeroed());
        let started = Instant::now();
        let bytes = bytemuck::cast_slice_mut(&mut self.staged);
        self.solid.source.read_rows(z, rows.clone(), cols.clone(), bytes)?;
        self.reading += started.elapsed();
        let slice = &mut self.ring[z as usize % RING * ROWS * self.stride..][..ROWS * self.stride];
        slice.fill(0);
        let first = cols.start as usize + HALO - self.column.x.start as usize;
        let first_row = rows.start as usize + HALO - self.column.y.start as usize;
        for (from, to) in
            self.staged.chunks_exact(width).zip(slice.chunks_exact_mut(self.stride).skip(first_row))
        {
            convert(self.solid, self.to_number, &mut self.known, from, &mut to[first..first + width])?;
        }
        Ok(())
    }

    /// Counts the labels of the tile's own rows of a slice.
    fn count(&mut self, z: u32) -> Result<(), SourceError> {
        let slice = &self.ring[z as usize % RING * ROWS * self.stride..][..ROWS * self.stride];
        let width = self.column.x.len();
        for row in slice.chunks_exact(self.stride).skip(HALO).take(self.column.y.len()) {
            let mut rest = &row[HALO..HALO + width];
            while let [first, ..] = rest {
                let differs = |part: &[u16]| part.iter().fold(0, |any, label| any | (label ^ first)) != 0;
                let alike = rest.chunks_exact(64).take_while(|part| !differs(part)).count() * 64;
                let run = alike + rest[alike..].iter().take_while(|label| *label == first).count();
                let (number, voxels) = (*first, run as u64);
                rest = &rest[run..];
                if number > 0 {
                    match self.counts.binary_search_by_key(&number, |count| count.0) {
                        Ok(at) => self.counts[at].1 += voxels,
                        Err(_) if self.counts.len() == MAX_LABELS => {
                            return Err(self.solid.wrong(Fault::ManyLabels { most: MAX_LABELS }));
                        }
                        Err(at) => self.counts.insert(at, (number, voxels)),
                    }
                }
            }
        }
        Ok(())
    }
}

/// Labels of slices z - 2 to z + 2 of `nz`, which the ring holds or which lie beyond the volume.
fn slices<'r>(ring: &'r [u16], none: &'r [u16], z: u32, nz: u32) -> [&'r [u16]; RING] {
    let size = none.len();
    std::array::from_fn(|dz| match (z + dz as u32).checked_sub(REACH).filter(|z| *z < nz) {
        Some(z) => &ring[z as usize % RING * size..][..size],
        None => none,
    })
}

/// Numbers of the labels of a row; a sample like the one before costs a comparison.
fn convert<T: Ordered>(
    solid: &LabelSolid<'_>,
    to_number: fn(T) -> f64,
    known: &mut Option<(T, u16)>,
    from: &[T],
    to: &mut [u16],
) -> Result<(), SourceError> {
    let as_it_is =
        *solid.choice == LabelChoice::All && solid.source.info().rescale == crate::volume::Rescale::IDENTITY;
    match T::TYPE {
        ScalarType::U8 if as_it_is => {
            let bytes: &[u8] = bytemuck::cast_slice(from);
            to.iter_mut().zip(bytes).for_each(|(to, from)| *to = u16::from(*from));
            return Ok(());
        }
        ScalarType::U16 if as_it_is => {
            to.copy_from_slice(bytemuck::cast_slice(from));
            return Ok(());
        }
        _ => {}
    }
    for (to, sample) in to.iter_mut().zip(from) {
        *to = match known {
            Some((before, label)) if before == sample => *label,
            _ => {
                let label = solid.label_of(to_number(*sample))?;
                *known = Some((*sample, label));
                label
            }
        };
    }
    Ok(())
}

/// Where a row's labels have a face neighbour with another one, or none: the rows before and behind along z and y,
/// and the row itself with a sample more at either end.
struct WallKernel<'a> {
    around: [&'a [u16]; 4],
    row: &'a [u16],
    out: &'a mut [u64],
}

impl Kernel for WallKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, isa: impl Isa) {
        let [down, up, north, south] = self.around.map(|row| row.as_chunks::<32>().0);
        let [west, here, east] =
            std::array::from_fn(|i| self.row.get(i..).unwrap_or_default().as_chunks::<32>().0);
        for (i, out) in self.out.iter_mut().enumerate() {
            *out = 0;
            for half in 0..2 {
                let at = 2 * i + half;
                let (Some(here), Some(west), Some(east)) = (here.get(at), west.get(at), east.get(at)) else {
                    continue;
                };
                let mut differ = [0_u16; 32];
                for around in [down, up, north, south] {
                    let Some(around) = around.get(at) else { continue };
                    for (differ, (a, b)) in differ.iter_mut().zip(here.iter().zip(around)) {
                        *differ |= a ^ b;
                    }
                }
                let mut mask = [0_u8; 32];
                for (k, mask) in mask.iter_mut().enumerate() {
                    let differ = differ[k] | (here[k] ^ west[k]) | (here[k] ^ east[k]);
                    *mask = if differ != 0 && here[k] != 0 { 0xff } else { 0 };
                }
                let word = if let Some(avx2) = isa.avx2() {
                    movemask(avx2, mask)
                } else {
                    mask.iter().enumerate().fold(0, |m, (k, b)| m | u32::from(b >> 7) << k)
                };
                *out |= u64::from(word) << (32 * half);
            }
        }
    }
}

/// Weights of the samples around a voxel, row by row.
struct Weights {
    /// Of a row's samples in the sums along x, y and z, by slice and row.
    rows: [[[i16; 3]; RING]; RING],
    /// Of the sums' lanes: the derivative along x, and the smoothing along it.
    along: [[i16; LANES]; 2],
}

impl Weights {
    fn new(Taps { smooth, derive }: Taps) -> Self {
        let even = |axis: usize, i: usize| i16::from(smooth[axis][i.abs_diff(HALO)]);
        let odd = |i: usize| match i {
            0 => -i16::from(derive[1]),
            1 => -i16::from(derive[0]),
            3 => i16::from(derive[0]),
            4 => i16::from(derive[1]),
            _ => 0,
        };
        let row = |j: usize, k: usize| [even(1, j) * even(2, k), odd(j) * even(2, k), even(1, j) * odd(k)];
        let lane = |i: usize, of: &dyn Fn(usize) -> i16| if i < RING { of(i) } else { 0 };
        Self {
            rows: std::array::from_fn(|k| std::array::from_fn(|j| row(j, k))),
            along: [
                std::array::from_fn(|i| lane(i, &odd)),
                std::array::from_fn(|i| lane(i, &|i| even(0, i))),
            ],
        }
    }

    /// Gradient of a label in the 5 x 5 x 5 samples of which `at` is the first, times the weights' sum.
    #[inline(always)]
    fn gradient(&self, slices: &[&[u16]; RING], at: usize, stride: usize, label: u16) -> [i32; 3] {
        let mut sums = [[0_i16; LANES]; 3];
        for (slice, weights) in slices.iter().zip(&self.rows) {
            let rows = slice.get(at..).unwrap_or_default().chunks(stride);
            for (row, weights) in rows.zip(weights) {
                let Some(row) = row.first_chunk::<LANES>() else { continue };
                let inside = row.map(|found| i16::from(found == label).wrapping_neg());
                for (sums, weight) in sums.iter_mut().zip(weights) {
                    for (sum, inside) in sums.iter_mut().zip(inside) {
                        *sum = sum.wrapping_add(weight & inside);
                    }
                }
            }
        }
        let [odd, even] = &self.along;
        let along = |sums: [i16; LANES], taps: &[i16; LANES]| {
            let products =
                sums.iter().zip(taps).map(|(sum, tap)| i32::from(*sum).wrapping_mul((*tap).into()));
            products.fold(0_i32, i32::wrapping_add)
        };
        [along(sums[0], odd), along(sums[1], even), along(sums[2], even)]
    }
}

/// The outward vectors of the skin voxels of one brick in one slice.
struct NormalKernel<'a> {
    slices: [&'a [u16]; RING],
    stride: usize,
    /// Places of the voxels' first samples in the slices.
    places: &'a [u32],
    estimate: &'a Estimate,
    weights: &'a [Weights],
    out: &'a mut Gradients,
}

impl Kernel for NormalKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: impl Isa) {
        let Self { slices, stride, places, estimate, weights, out } = self;
        let here = slices[HALO];
        for (slot, at) in places.iter().enumerate() {
            let at = *at as usize;
            let middle = at + HALO * stride + HALO;
            let label = here[middle];
            let others = [
                here[middle - 1],
                here[middle + 1],
                here[middle - stride],
                here[middle + stride],
                slices[HALO - 1][middle],
                slices[HALO + 1][middle],
            ];
            let open = others.iter().enumerate().fold(0, |open, (f, l)| open | u8::from(*l != label) << f);
            let mut sum = [0; 3];
            for weights in weights {
                let more = weights.gradient(&slices, at, stride, label);
                sum = std::array::from_fn(|a| sum[a] + more[a]);
            }
            #[expect(clippy::cast_precision_loss, reason = "below 2^24")]
            let inward: [f32; 3] = std::array::from_fn(|a| sum[a] as f32 * estimate.per_spacing[a]);
            out.set(slot, outward(estimate, inward.map(|c| -c), open));
        }
    }
}

impl<T: Ordered> SolidWorker for LabelWorker<'_, T> {
    fn start(&mut self, column: &VoxelBox) -> Result<(), SourceError> {
        self.column = column.clone();
        Ok(())
    }

    fn occupancy(&mut self, wanted: &mut OccupancyRows<'_>) -> Result<(), SourceError> {
        let z = wanted.z();
        self.load(z)?;
        if self.column.z.contains(&z) {
            self.count(z)?;
        }
        let width = self.column.x.len();
        let slice = &self.ring[z as usize % RING * ROWS * self.stride..];
        for y in wanted.y() {
            let row = &slice[(y as usize + HALO - self.column.y.start as usize) * self.stride..];
            let [before, words @ .., after] = wanted.row_mut(y) else { continue };
            classify(&row[HALO..HALO + width], SampleRange { lo: 1, hi: u16::MAX }, words);
            *before = u64::from(row[HALO - 1] > 0) << 63;
            *after = u64::from(row[HALO + width] > 0);
        }
        Ok(())
    }

    fn skin(&mut self, wanted: &mut OccupancyRows<'_>) -> bool {
        let (z, stride) = (wanted.z(), self.stride);
        let nz = self.solid.source.info().dims.nz();
        let [_, below, here, above, _] = slices(&self.ring, &self.none, z, nz);
        for y in wanted.y() {
            let row = (y as usize + HALO - self.column.y.start as usize) * stride;
            let part = |from: usize| from + HALO..from + stride;
            let around =
                [&below[part(row)], &above[part(row)], &here[part(row - stride)], &here[part(row + stride)]];
            let out = wanted.row_mut(y);
            dispatch(WallKernel { around, row: &here[row + HALO - 1..row + stride], out });
        }
        true
    }

    fn describe(&mut self, skin: &SkinSlice<'_>) -> Result<(), SourceError> {
        let (stride, [x0, y0, z]) = (self.stride, skin.corner());
        let slices = slices(&self.ring, &self.none, z, self.solid.source.info().dims.nz());
        let corner = (y0 - self.column.y.start) * stride as u32 + (x0 - self.column.x.start);
        self.places.clear();
        self.places.extend(skin.voxels().map(|[x, y, _]| corner + (y - y0) * stride as u32 + (x - x0)));
        let middle = HALO * stride + HALO;
        self.labels.clear();
        let labels = self.places.iter().map(|at| slices[HALO][*at as usize + middle]);
        self.labels.extend(labels.flat_map(u16::to_le_bytes));
        if self.normals {
            let (places, out) = (&self.places[..], &mut *self.gradients);
            let LabelSolid { estimate, weights, .. } = self.solid;
            dispatch(NormalKernel { slices, stride, places, estimate, weights, out });
            self.codes.encode(&self.gradients, skin.len());
        }
        Ok(())
    }

    fn items(&self, channel: Channel) -> &[u8] {
        let count = self.labels.len() / 2;
        match channel {
            Channel::Normal => self.codes.codes(count),
            Channel::Fine => self.codes.fine(count),
            Channel::Label => &self.labels,
            _ => &[],
        }
    }

    fn found(&self) -> ScanSummary {
        let mut all = self.solid.found();
        for (number, voxels) in &self.counts {
            match all.binary_search_by_key(number, |count| count.0) {
                Ok(at) => all[at].1 += voxels,
                Err(at) => all.insert(at, (*number, *voxels)),
            }
        }
        ScanSummary { reading: self.reading, ..ScanSummary::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_chosen_by_number_and_range() {
        assert_eq!("all".parse(), Ok(LabelChoice::All));
        let some: LabelChoice = "1, 5,7..20".parse().unwrap();
        assert_eq!(some, LabelChoice::Only(vec![[1, 1], [5, 5], [7, 20]]));
        let chosen: Vec<u16> = (0..40).filter(|n| some.contains(*n)).collect();
        assert_eq!(chosen, [1, 5].into_iter().chain(7..=20).collect::<Vec<_>>());
        for wrong in ["", "0", "1,", "5..3", "-1", "1.5", "65536", "liver", "all,1", "1..."] {
            assert!(wrong.parse::<LabelChoice>().is_err(), "{wrong}");
        }
    }
}
