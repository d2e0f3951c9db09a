//! A DICOM series as a volume.

use std::io;
use std::ops::Range;
use std::path::Path;

use super::assemble::{Layer, Stack};
use super::group::{Group, Key, Series, Slice};
use crate::fault::{Fault, bad, unfit};
use crate::geom::Dims;
use crate::platform::PositionalFile;
use crate::progress::Progress;
use crate::source::dicom::image::describe::Image;
use crate::source::dicom::image::pixels::{Padding, PixelLayout};
use crate::source::dicom::image::unroll::{FrameSink, unroll};
use crate::source::dicom::parse::scan::scan;
use crate::source::dicom::series::findings::of_image;
use crate::source::files::FileSet;
use crate::volume::{
    ImageKind, Note, Preparation, Rescale, Result, ScalarType, SourceDescription, SourceError, SourceFault,
    Spool, StatedLabel, VolumeInfo, VolumeSource, Workspace, blend_rows, check_request, neighbour_bytes,
    read_block,
};

/// Physical value that stands for padding in CT (air, in HU); elsewhere it is 0.
const CT_BACKGROUND: f64 = -1000.0;

/// A DICOM series, uncompressed images read by position, others unrolled first.
///
/// x runs along the rows of an image, y down its columns, z along the images' normal (x cross y) by
/// increasing position, so the affine is right-handed. The step between slices is the mean step from
/// the first to the last; with a tilted gantry it is not parallel to the normal.
///
/// Samples are the stored values (masked to Bits Stored, sign-extended) with one rescale for all; if slices differ in
/// rescale, they are physical values as `F32`. MONOCHROME1 numbers are kept. Pixels that equal the Pixel Padding Value
/// (or lie in the padding range) become the stored value nearest to -1000 HU in CT and to 0 elsewhere, as far as Bits
/// Stored reach: background, but no outlier. So do floating-point pixels that equal their padding value, which may be
/// NaN.
///
/// Slices that a segmentation leaves out are 0.
///
/// Missing slices that are to be filled are made when they are read: delivered samples are interpolated linearly
/// between the two neighbours, integers rounded half away from zero.
///
/// A Siemens mosaic is a volume by itself, its slices the tiles of its picture; they are read by position
/// where the picture can be.
///
/// Holds some 90 bytes a slice with its name (nothing for a tile), and no pixels; where slices are made,
/// 64 KiB (or one row) for each thread that reads.
pub(crate) struct DicomVolume {
    info: VolumeInfo,
    files: FileSet,
    layouts: Vec<PixelLayout>,
    paddings: Vec<Option<Padding>>,
    places: Vec<ImageSource>,
    /// Layer of each slice; indices into `places`. Empty for a mosaic, see [`DicomVolume::layer`].
    layers: Vec<Layer>,
    /// True if the last tile of a mosaic is the first slice.
    backwards: bool,
    /// True if values are delivered as physical `f32`s.
    physical: bool,
    /// True if slices differ in the type of their samples, so that the spool holds physical `f32`s, too.
    mixed: bool,
    /// Number of slices that must be decoded first.
    coded: u32,
    unroll_bytes: u64,
    spool: Option<Spool>,
    modality: String,
}

/// Location of an image.
#[derive(Clone, Copy, Debug)]
struct ImageSource {
    /// Index in the volume's files.
    file: u32,
    frame: u32,
    at: At,
    slope: f64,
    intercept: f64,
    layout: u32,
    padding: u32,
}

/// Images, the paddings that they refer to, and the number of slices that must be decoded first.
type PlacedImages = (Vec<ImageSource>, Vec<Option<Padding>>, u32);

#[derive(Clone, Copy, Debug)]
enum At {
    /// Offset in the file.
    File(u64),
    /// Slice of the spool.
    Spool(u32),
}

impl DicomVolume {
    /// The volume of a stack of images of a group; `name` becomes the source's, `notes` are about the whole series.
    pub(crate) fn build(
        series: &Series,
        group: &Group,
        stack: Stack,
        name: &str,
        part: &str,
        notes: &[Note],
    ) -> Result<Self, Fault> {
        let Stack { layers, affine, notes: of_stack } = stack;
        let mut notes = notes.to_vec();
        notes.extend(group.shared.notes.iter().cloned());
        notes.extend(of_stack);
        let shared = &group.shared;
        let (used, layers) = number_images(layers);
        let slices: Vec<&Slice> = used.iter().filter_map(|i| group.slices.get(*i)).collect();
        let rescaled = slices.iter().filter(|s| s.rescales).count();
        let stated = slices.iter().filter(|s| s.rescales && s.rescale().is_some()).count();
        if stated > 0 && stated < rescaled {
            return Err(unfit!(
                "{} of {} slices state no rescale slope and intercept, so their values cannot be compared; correct them, or leave them out",
                rescaled - stated,
                slices.len()
            ));
        }
        if slices.iter().any(|s| rescale_of(s).0 == 0.0) {
            return Err(unfit!(
                "the rescale slope is 0, so every pixel would have the same value; correct the headers"
            ));
        }
        let common = slices.first().map_or((1.0, 0.0), |s| rescale_of(s));
        let layout = *layout_of(series, slices.first().ok_or(unfit!("no image"))?)?;
        let mut mixed = false;
        for slice in &slices {
            mixed |= layout_of(series, slice)?.scalar() != layout.scalar();
        }
        let rescaled_apart = slices.iter().any(|s| rescale_of(s) != common);
        let physical = mixed || rescaled_apart;
        if rescaled_apart {
            notes.push(Note::new("slices differ in rescale; values are converted to single precision"));
        }
        if mixed {
            notes.push(Note::new(
                "slices differ in the type of their samples; each is converted as its header says, to single precision",
            ));
        }
        if stated == 0 && rescaled > 0 && shared.modality == "CT" {
            notes.push(Note::new("the images state no rescale; values may not be HU"));
        }
        let background = if shared.modality == "CT" { CT_BACKGROUND } else { 0.0 };
        let mut files: Vec<u32> = slices.iter().map(|s| s.file).collect();
        files.sort_unstable();
        files.dedup();
        // A volume is a single mosaic, or has none.
        let tiles = if layout.across() > 1 { u32::try_from(layers.len()).unwrap_or(u32::MAX) } else { 1 };
        let (places, paddings, coded) = place_images(series, &slices, &files, tiles, background)?;
        let (columns, rows, size) = (layout.columns, layout.rows, layers.len());
        let dims = layout.dims(size).ok_or(unfit!("{columns}x{rows}x{size} voxels are out of range"))?;
        let description = SourceDescription {
            format: "dicom".into(),
            name: name.into(),
            kind: ImageKind::Series {
                object: shared.object.clone(),
                number: shared.series_number,
                part: part.into(),
            },
            labels: labels_of(series, group, slices.first().copied()),
            treatments: Vec::new(),
            files: files.len() as u64,
            bytes: dims.voxels() * layout.scalar().bytes() as u64,
        };
        let info = VolumeInfo {
            dims,
            scalar: if physical { ScalarType::F32 } else { layout.scalar() },
            rescale: if physical {
                Rescale::IDENTITY
            } else {
                Rescale { slope: common.0, intercept: common.1 }
            },
            spacing_mm: affine.spacing_mm(),
            affine,
            description,
            notes,
        };
        let files = FileSet::new(series.files.select(files.iter().map(|f| *f as usize)));
        Ok(Self {
            info,
            files,
            layouts: series.layouts.clone(),
            paddings,
            places,
            backwards: matches!(layers.first(), Some(Layer::Tile(_, first)) if *first > 0),
            // A functional study has a thousand mosaics of sixty slices.
            layers: if layout.across() > 1 { Vec::new() } else { layers },
            physical,
            mixed,
            coded,
            unroll_bytes: shared.unroll_bytes,
            spool: None,
            modality: shared.modality.clone(),
        })
    }

    /// Origin of slice `z`.
    fn layer(&self, z: u32) -> Option<Layer> {
        if !self.layers.is_empty() {
            return self.layers.get(z as usize).copied();
        }
        let last = self.info.dims.nz() - 1;
        let tile = if self.backwards { last.checked_sub(z) } else { Some(z) };
        tile.map(|tile| Layer::Tile(0, tile))
    }

    /// Size of the images that are unrolled, and type of their samples.
    fn spool_dims(&self) -> Option<(Dims, ScalarType)> {
        let first = self.places.first()?;
        let layout = self.layouts.get(first.layout as usize)?;
        let scalar = if self.mixed { ScalarType::F32 } else { layout.scalar() };
        Some((layout.dims(self.coded as usize)?, scalar))
    }

    /// Rows of an image, or of a tile of one, as they are delivered.
    fn read_image(
        &self,
        index: usize,
        tile: u32,
        rows: &Range<u32>,
        cols: &Range<u32>,
        out: &mut [u8],
    ) -> io::Result<()> {
        let place = self.places.get(index).ok_or(io::ErrorKind::InvalidInput)?;
        let layout = self.layouts.get(place.layout as usize).ok_or(io::ErrorKind::InvalidInput)?;
        let padding = self.paddings.get(place.padding as usize).copied().flatten();
        let grows = self.physical && !(self.mixed && matches!(place.at, At::Spool(_)));
        let width = layout.scalar().bytes();
        // Stored values that are widened to `f32` wait in the tail of `out`.
        let tail = if grows { out.len() - out.len() / 4 * width } else { 0 };
        let stored = out.get_mut(tail..).unwrap_or(&mut []);
        match place.at {
            At::File(offset) => {
                self.files.with(place.file as usize, |f| {
                    read_block(
                        f,
                        offset + layout.tile_offset(tile),
                        layout.pitch(),
                        width,
                        rows,
                        cols,
                        stored,
                    )
                })?;
                layout.decode_padded(stored, padding);
            }
            At::Spool(slice) => match &self.spool {
                Some(spool) => spool.read_rows(slice + tile, rows, cols, stored)?,
                None => return Err(io::Error::other("compressed images are read before they are unrolled")),
            },
        }
        if grows {
            layout.widen(out, place.slope, place.intercept);
        }
        Ok(())
    }

    /// The file of a slice, for messages.
    fn file_of(&self, z: u32) -> usize {
        let place = match self.layer(z) {
            Some(Layer::Image(at) | Layer::Tile(at, _) | Layer::Between(at, ..)) => self.places.get(at),
            Some(Layer::Empty) | None => None,
        };
        place.map_or(0, |p| p.file as usize)
    }
}

/// The labels of a volume of segments: its own segment, where frames name theirs, or all of them.
fn labels_of(series: &Series, group: &Group, first: Option<&Slice>) -> Vec<StatedLabel> {
    if group.shared.object == crate::volume::FRACTIONAL {
        return Vec::new();
    }
    let own = first.and_then(|slice| Key::SEGMENT.number(slice));
    let is_own = |label: &&StatedLabel| own.is_none_or(|own| own == f64::from(label.number));
    series.segments.iter().filter(is_own).cloned().collect()
}

/// Slope and intercept of a slice.
fn rescale_of(slice: &Slice) -> (f64, f64) {
    slice.rescale().unwrap_or((1.0, 0.0))
}

fn layout_of<'s>(series: &'s Series, slice: &Slice) -> Result<&'s PixelLayout, Fault> {
    series.layouts.get(slice.layout as usize).ok_or(unfit!("an image without layout or file"))
}

/// Location of each image, the paddings that they refer to, and the number of slices that must be decoded first.
///
/// `files` are sorted; a picture holds `tiles` slices; padding becomes `background`, a physical value.
fn place_images(
    series: &Series,
    slices: &[&Slice],
    files: &[u32],
    tiles: u32,
    background: f64,
) -> Result<PlacedImages, Fault> {
    let mut paddings: Vec<Option<Padding>> = Vec::new();
    let mut places = Vec::with_capacity(slices.len());
    let mut coded = 0;
    for slice in slices {
        let (slope, intercept) = rescale_of(slice);
        let own = layout_of(series, slice)?;
        let padding = own.padding(slice.padding, background, slope, intercept);
        let padding = padding.filter(|p| p.matters() && (slice.rescales || own.stored().is_float()));
        let at = paddings.iter().position(|p| *p == padding).unwrap_or_else(|| {
            paddings.push(padding);
            paddings.len() - 1
        });
        let padding = u32::try_from(at).map_err(|_| unfit!("too many padding values"))?;
        let file = files.binary_search(&slice.file).map_err(|_| unfit!("an image without layout or file"))?;
        let at = match slice.native() {
            Some(offset) => At::File(offset),
            None => {
                coded += tiles;
                At::Spool(coded - tiles)
            }
        };
        places.push(ImageSource {
            file: u32::try_from(file).map_err(|_| unfit!("too many files"))?,
            frame: slice.frame,
            at,
            slope,
            intercept,
            layout: slice.layout,
            padding,
        });
    }
    Ok((places, paddings, coded))
}

/// The images that layers refer to, each once, and the layers in terms of these.
fn number_images(layers: Vec<Layer>) -> (Vec<usize>, Vec<Layer>) {
    let mut used: Vec<usize> = Vec::with_capacity(layers.len());
    // Layers go forwards, so an image that was met lies close to the end.
    let mut number = |image: usize| match used.iter().rev().take(2).position(|known| *known == image) {
        Some(back) => used.len() - 1 - back,
        None => {
            used.push(image);
            used.len() - 1
        }
    };
    let renumber = |layer| match layer {
        Layer::Image(at) => Layer::Image(number(at)),
        Layer::Tile(at, tile) => Layer::Tile(number(at), tile),
        Layer::Empty => Layer::Empty,
        Layer::Between(from, to, part) => {
            let from = number(from);
            Layer::Between(from, number(to), part)
        }
    };
    let layers = layers.into_iter().map(renumber).collect();
    (used, layers)
}

/// Takes the frames of one file into the spool.
struct ToSpool<'a> {
    spool: &'a Spool,
    paddings: &'a [Option<Padding>],
    /// The images of the file, in the order of their frames.
    wanted: Vec<ImageSource>,
    /// Size of a slice, and number of slices in a row of a picture.
    layout: PixelLayout,
    /// Slices in a picture.
    tiles: u32,
    /// A row of physical values, where the spool holds these.
    physical: Option<Vec<u8>>,
    progress: &'a dyn Progress,
}

impl ToSpool<'_> {
    fn find(&self, frame: u32) -> Option<ImageSource> {
        let at = self.wanted.binary_search_by_key(&frame, |w| w.frame).ok()?;
        self.wanted.get(at).copied()
    }
}

impl FrameSink for ToSpool<'_> {
    fn wants(&mut self, frame: u32) -> bool {
        self.find(frame).is_some()
    }

    fn padding(&mut self, frame: u32) -> Option<Padding> {
        self.paddings.get(self.find(frame)?.padding as usize).copied().flatten()
    }

    fn row(&mut self, frame: u32, row: u32, samples: &[u8]) -> Result {
        let Some(ImageSource { at: At::Spool(slice), slope, intercept, .. }) = self.find(frame) else {
            return Ok(());
        };
        if let Some(values) = &mut self.physical {
            values.resize(4 * samples.len() / self.layout.scalar().bytes(), 0);
            let tail = values.len() - samples.len();
            values.get_mut(tail..).unwrap_or_default().copy_from_slice(samples);
            self.layout.widen(values, slope, intercept);
            self.spool.write(values, self.spool.offset(row, slice))?;
            if row + 1 == self.layout.rows {
                self.progress.step(1)?;
            }
            return Ok(());
        }
        let (rows, across) = (self.layout.rows, self.layout.across());
        let (down, row) = (row / rows, row % rows);
        let bytes = (self.layout.columns as usize * self.layout.scalar().bytes()).max(1);
        let first = down.saturating_mul(across);
        for (tile, samples) in
            (first..self.tiles.min(first.saturating_add(across))).zip(samples.chunks_exact(bytes))
        {
            if row + 1 == rows {
                self.progress.step(1)?;
            }
            self.spool.write(samples, self.spool.offset(row, slice + tile))?;
        }
        Ok(())
    }
}

impl VolumeSource for DicomVolume {
    fn info(&self) -> &VolumeInfo {
        &self.info
    }

    fn modality(&self) -> Option<&str> {
        Some(self.modality.as_str()).filter(|m| !m.is_empty())
    }

    fn for_each_file(&self, each: &mut dyn FnMut(&Path)) {
        self.files.list().for_each(each);
    }

    fn preparation(&self) -> Preparation {
        match self.spool_dims().filter(|_| self.coded > 0 && self.spool.is_none()) {
            Some((dims, scalar)) => Preparation {
                scratch_bytes: dims.voxels() * scalar.bytes() as u64,
                memory_bytes: self.unroll_bytes,
                on_demand: false,
            },
            None => Preparation::default(),
        }
    }

    fn prepare(&mut self, workspace: &Workspace<'_>) -> Result {
        let Some((dims, scalar)) = self.spool_dims().filter(|_| self.coded > 0 && self.spool.is_none())
        else {
            return Ok(());
        };
        let layout_of = |place: &ImageSource| self.layouts.get(place.layout as usize).copied();
        let tiles = match self.places.first().and_then(layout_of) {
            Some(layout) if layout.across() > 1 => self.coded,
            _ => 1,
        };
        let spool = Spool::create(workspace.scratch, dims, scalar)?;
        workspace.progress.stage("decode", self.coded.into());
        let coded = |place: &&ImageSource| matches!(place.at, At::Spool(_));
        let mut wanted: Vec<ImageSource> = self.places.iter().filter(coded).copied().collect();
        wanted.sort_unstable_by_key(|place| (place.file, place.frame));
        for of_file in wanted.chunk_by(|a, b| a.file == b.file) {
            let Some((first, layout)) = of_file.first().and_then(|p| Some((p, layout_of(p)?))) else {
                continue;
            };
            let path = self.files.list().path(first.file as usize);
            let unusable = |fault: Fault| SourceError::from(fault.at(&path));
            let input = PositionalFile::open(&path)
                .map_err(|cause| SourceError::from(SourceFault::Unreadable { path: path.clone(), cause }))?;
            let header = scan(&input).map_err(|error| unusable(bad!("{error}")))?;
            let image = Image::of(&header).map_err(|obstacle| unusable(of_image(&obstacle)))?;
            if (image.layout.columns, image.layout.rows, image.layout.scalar())
                != (layout.pitch(), layout.rows * layout.across(), layout.scalar())
            {
                return Err(unusable(bad!("was changed since it was found; start again")));
            }
            let mut sink = ToSpool {
                spool: &spool,
                paddings: &self.paddings,
                wanted: of_file.to_vec(),
                layout,
                tiles,
                physical: self.mixed.then(Vec::new),
                progress: workspace.progress,
            };
            unroll(&input, &path, &header, &image, &workspace.memory, &mut sink)?;
        }
        self.spool = Some(spool);
        Ok(())
    }

    fn read_rows(&self, z: u32, rows: Range<u32>, cols: Range<u32>, out: &mut [u8]) -> Result {
        let failed = |cause| {
            SourceError::from(SourceFault::ReadFailed {
                path: self.files.list().path(self.file_of(z)),
                slice: z,
                cause,
            })
        };
        check_request(&self.info, z, &rows, &cols, out.len()).map_err(failed)?;
        match self.layer(z) {
            Some(Layer::Image(at)) => self.read_image(at, 0, &rows, &cols, out),
            Some(Layer::Tile(at, tile)) => self.read_image(at, tile, &rows, &cols, out),
            Some(Layer::Empty) => {
                out.fill(0);
                Ok(())
            }
            Some(Layer::Between(from, to, part)) => {
                self.read_image(from, 0, &rows, &cols, out).and_then(|()| {
                    blend_rows(self.info.scalar, part, rows, cols.len(), out, |rows, other| {
                        self.read_image(to, 0, &rows, &cols, other)
                    })
                })
            }
            None => Err(io::ErrorKind::InvalidInput.into()),
        }
        .map_err(failed)
    }

    fn resident_bytes(&self) -> u64 {
        let makes = self.layers.iter().any(|l| matches!(l, Layer::Between(..)));
        if makes { neighbour_bytes(&self.info) } else { 0 }
    }
}
