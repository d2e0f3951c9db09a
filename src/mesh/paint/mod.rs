//! The look of a mesh's surface: the colour, the part and the smooth normal at the nearest point of a triangle.
//!
//! ```text
//! triangles with looks --numbered--> columns (scratch)     images --linear light, halved--> levels (scratch)
//!                                        └── nearest point of triangle N ──> colour, part, normal <──┘
//! ```
//!
//! | part | what it holds |
//! |---|---|
//! | `store` | looks of triangles, by their numbers |
//! | `image` | PNG and JPEG, row by row |
//! | `texture` | images in halving sizes, and their colours at a place |
//! | `near` | triangles that may be near, by boxes of voxels |
//! | `point` | the nearest point of a triangle, and texels per voxel there |
//!
//! Colours are mixed in linear light and stored as sRGB. Of two triangles at the same distance the one counts that
//! faces the voxel more, then the first. The search is its own, so that meshes without colours do not pay for it.
#![expect(clippy::cast_possible_truncation, reason = "coordinates are below 2^16, rows of a brick few")]

mod image;
mod near;
mod point;
mod store;
mod texture;

use std::io;
use std::path::{Path, PathBuf};

use super::lattice::{HALF, STEPS, Triangle, edges, first_centre, last_centre, span};
use super::read::{Appearance, Material, NO_MATERIAL};
use crate::builder::{ItemForm, SkinSlice};
use crate::format::cell::{HAS_CORNERS, Plane};
use crate::format::{Channel, SurfaceKind, normal};
use crate::geom::{Dims, cross};
use crate::volume::{SourceError, SourceFault};
pub(super) use image::needed_bytes as image_bytes;
use near::{Near, Numbered, SORTING_BYTES, Sorter};
use point::{nearest_point, squared_distance, texels_per_voxel};
use store::Columns;
use texture::{Pages, Texture};

/// Painted channels of a mesh.
#[derive(Clone, Copy, Debug)]
pub(super) struct PaintChannels {
    pub(super) colors: bool,
    pub(super) parts: bool,
    pub(super) normals: bool,
}

impl PaintChannels {
    pub(super) fn anything(self) -> bool {
        self.colors || self.parts || self.normals
    }

    /// The form of the items of a channel that is painted.
    pub(super) fn form(self, channel: Channel) -> Option<ItemForm> {
        let bytes = match channel {
            Channel::Color if self.colors => 3,
            Channel::Material if self.parts => 1,
            _ => return None,
        };
        Some(ItemForm::AsIs { bytes })
    }
}

/// Number of no triangle.
const UNKNOWN: u32 = u32::MAX;
/// Memory while triangles are gathered, without textures.
pub(super) const COLLECTING_BYTES: u64 = SORTING_BYTES + (1 << 20);
/// Colour of surfaces without one (sRGB): the same as for models without colours.
const UNCOLORED: [u8; 3] = [236, 226, 208];
/// Highest number of a part; later ones share it.
const LAST_PART: u64 = 255;

/// Colours and texture of a material.
struct Coat {
    color: [f32; 3],
    texture: Option<Texture>,
}

/// Triangles with their looks.
pub(super) struct Paint {
    pub(super) wanted: PaintChannels,
    surface: SurfaceKind,
    near: Near,
    columns: Columns,
    coats: Vec<Coat>,
    folder: PathBuf,
}

impl Paint {
    /// Memory held beyond the workers'.
    pub(super) fn bytes(&self) -> u64 {
        self.near.bytes() + (self.coats.len() * size_of::<Coat>()) as u64
    }
}

/// The look of a point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SurfaceLook {
    /// Colour in sRGB.
    pub(super) color: [u8; 3],
    pub(super) part: u8,
    /// Unit vector, on either side.
    pub(super) normal: Option<[f32; 3]>,
}

impl SurfaceLook {
    pub(super) const NOTHING: Self = Self { color: UNCOLORED, part: 0, normal: None };
}

/// Collects the looks of triangles, in their order.
pub(super) struct Collector {
    wanted: PaintChannels,
    surface: SurfaceKind,
    sorter: Sorter,
    columns: Columns,
    coats: Vec<Coat>,
    folder: PathBuf,
    next: u32,
    /// Number of the file's first part.
    first_part: u64,
    first_coat: u32,
}

impl Collector {
    /// Begins for a grid of boxes, which are voxels or cells.
    ///
    /// # Errors
    /// The scratch file cannot be made.
    pub(super) fn new(
        wanted: PaintChannels,
        (surface, dims): (SurfaceKind, Dims),
        folder: &Path,
    ) -> Result<Self, SourceError> {
        let sorter = Sorter::new(dims, folder).map_err(|cause| scratch(folder, cause))?;
        let columns = Columns::new(folder);
        let folder = folder.to_path_buf();
        let coats = Vec::new();
        Ok(Self { wanted, surface, sorter, columns, coats, folder, next: 0, first_part: 0, first_coat: 0 })
    }

    /// Begins a file: parts of its own from a number on, with these materials.
    ///
    /// # Errors
    /// An image is wrong or too large, or cannot be read, or the scratch file cannot.
    pub(super) fn file(&mut self, first_part: u64, materials: &[Material]) -> Result<(), SourceError> {
        self.first_part = first_part;
        self.first_coat = u32::try_from(self.coats.len()).unwrap_or(u32::MAX);
        if !self.wanted.colors {
            return Ok(());
        }
        let mut images = Vec::new();
        for material in materials {
            let texture = match &material.texture {
                Some(texture) => Some(Texture::open(texture, &self.folder, &mut images)?),
                None => None,
            };
            self.coats.push(Coat { color: material.color, texture });
        }
        Ok(())
    }

    /// Keeps the next triangle and its look.
    pub(super) fn add(&mut self, t: &Triangle, look: &Appearance) -> Result<(), SourceError> {
        let part = self.first_part.saturating_add(look.part.into()).min(LAST_PART) as u32;
        let mut look = Appearance { part, ..*look };
        if !self.wanted.normals {
            look.normals = None;
        }
        if !self.wanted.colors {
            look = Appearance { normals: look.normals, part, ..Appearance::NONE };
        }
        if look.material != NO_MATERIAL {
            look.material = self.first_coat.saturating_add(look.material);
        }
        let number = self.next;
        // Numbers end here; later triangles look like the last.
        self.next = (number + 1).min(UNKNOWN - 1);
        self.columns
            .put(&look)
            .and_then(|()| self.sorter.add(t, number))
            .map_err(|cause| scratch(&self.folder, cause))
    }

    pub(super) fn finish(mut self) -> Result<Paint, SourceError> {
        let failed = |cause| scratch(&self.folder, cause);
        self.columns.flush().map_err(failed)?;
        let near = self.sorter.finish(&self.folder).map_err(failed)?;
        let Self { wanted, surface, columns, coats, folder, .. } = self;
        Ok(Paint { wanted, surface, near, columns, coats, folder })
    }
}

fn scratch(folder: &Path, cause: std::io::Error) -> SourceError {
    SourceError::from(SourceFault::Scratch { path: folder.to_path_buf(), cause })
}

/// The best triangle for a place so far.
#[derive(Clone, Copy, Debug)]
struct Best {
    /// Squared distance in lattice steps, rounded.
    squared: f64,
    /// The negated squared distance of the voxel from its plane, rounded: the larger, the more it faces it.
    height: f64,
    record: Numbered,
}

impl Best {
    const NONE: Self = Self { squared: WITHIN, height: 0.0, record: [-1; 10] };

    fn number(&self) -> u32 {
        self.record[9].cast_unsigned()
    }
}

/// Squared distance within which triangles are sought, in lattice steps: two voxels.
const WITHIN: f64 = 4.0 * STEPS as f64 * STEPS as f64;
/// Number that rounds a square of lattice steps to 2^-28 voxel^2 when it is added and taken away again.
const ROUNDER: f64 = 6_755_399_441_055_744.0 / 16.0;
/// Voxels along a side of a brick.
const BRICK: usize = 32;
/// Most triangles of a box that are held.
const HELD: usize = 4 * near::BLOCK;

/// A worker's view of the paint.
pub(super) struct Painter<'a> {
    paint: &'a Paint,
    pages: Pages,
    /// Triangles of a box, if they fit.
    held: Option<usize>,
    records: Vec<Numbered>,
    /// Places of the slice whose look is sought, in lattice steps, and their triangles.
    places: Vec<[f64; 3]>,
    best: Vec<Best>,
    last: Option<(u32, Appearance)>,
    colors: Vec<u8>,
    parts: Vec<u8>,
}

impl<'a> Painter<'a> {
    pub(super) const BYTES: u64 = Pages::BYTES
        + (HELD * size_of::<Numbered>()
            + SkinSlice::MAX_VOXELS * (size_of::<Best>() + size_of::<[f64; 3]>() + 4)) as u64
        + 4096;

    pub(super) fn new(paint: &'a Paint) -> Self {
        Self {
            paint,
            pages: Pages::new(),
            held: None,
            records: Vec::with_capacity(HELD),
            places: vec![[0.0; 3]; SkinSlice::MAX_VOXELS],
            best: vec![Best::NONE; SkinSlice::MAX_VOXELS],
            last: None,
            colors: Vec::with_capacity(3 * SkinSlice::MAX_VOXELS),
            parts: Vec::with_capacity(SkinSlice::MAX_VOXELS),
        }
    }

    /// The items of the boxes that were described last.
    pub(super) fn items(&self, channel: Channel) -> &[u8] {
        match channel {
            Channel::Color => &self.colors,
            Channel::Material => &self.parts,
            _ => &[],
        }
    }

    /// Finds the looks of the voxels of a brick's slice at their centres; `codes` are their normals, on the side of the
    /// outside.
    ///
    /// # Errors
    /// A scratch file cannot be read.
    pub(super) fn voxels(&mut self, skin: &SkinSlice<'_>, codes: &mut [u8]) -> Result<(), SourceError> {
        self.describe(skin, skin.voxels().map(|voxel| voxel.map(centre)), codes)
    }

    /// Finds the looks of the cells of a brick's slice, on their planes next to the middle; in the middle if they have
    /// corners instead.
    ///
    /// # Errors
    /// A scratch file cannot be read.
    pub(super) fn cells(
        &mut self,
        skin: &SkinSlice<'_>,
        codes: &[u8],
        offsets: &[u8],
    ) -> Result<(), SourceError> {
        let items = codes.as_chunks::<2>().0.iter().zip(offsets.iter().map(|offset| offset.cast_signed()));
        let place = |(cell, (code, offset)): ([u32; 3], (&[u8; 2], i8))| {
            let plane = (offset != HAS_CORNERS).then(|| Plane::new(u16::from_le_bytes(*code), offset));
            let within = plane.map_or([0.0; 3], Plane::nearest_to_middle);
            [0, 1, 2].map(|k| (f64::from(cell[k]) + within[k]) * f64::from(STEPS))
        };
        self.describe(skin, skin.voxels().zip(items).map(place), &mut [])
    }

    /// Finds the looks at a place of every box of a brick's slice, and turns `codes`, if there are any, to the smooth
    /// normals there.
    fn describe(
        &mut self,
        skin: &SkinSlice<'_>,
        places: impl Iterator<Item = [f64; 3]>,
        codes: &mut [u8],
    ) -> Result<(), SourceError> {
        for (voxel, place) in skin.voxels().zip(places) {
            self.places[at_in_slice(skin, voxel)] = place;
        }
        self.seek(skin).map_err(|cause| scratch(&self.paint.folder, cause))?;
        self.colors.clear();
        self.parts.clear();
        let mut codes = codes.as_chunks_mut::<2>().0.iter_mut();
        for voxel in skin.voxels() {
            let at = at_in_slice(skin, voxel);
            let best = self.best[at];
            let [t @ .., _] = best.record;
            let painted = self.at(best.number(), &t, self.places[at])?;
            self.colors.extend(painted.color);
            self.parts.push(painted.part);
            if let (Some(code), Some(smooth)) = (codes.next(), painted.normal) {
                let own = normal::decode_l1(u16::from_le_bytes(*code));
                let along: f32 = own.iter().zip(smooth).map(|(a, b)| *a as f32 * b).sum();
                let out = if along < 0.0 { smooth.map(|c| -c) } else { smooth };
                *code = normal::encode(out).to_le_bytes();
            }
        }
        Ok(())
    }

    /// Finds the nearest triangles of the places of a brick's slice.
    fn seek(&mut self, skin: &SkinSlice<'_>) -> io::Result<()> {
        self.best.fill(Best::NONE);
        let near = &self.paint.near;
        let at = near.box_of(skin.corner());
        let Self { paint, records, places, best, held, .. } = self;
        let mut search = SliceSearch { skin, surface: paint.surface, places, best };
        if near.count(at) <= HELD as u64 {
            if *held != Some(at) {
                *held = None;
                near.read(at, 0, records, HELD)?;
                *held = Some(at);
            }
            records.iter().for_each(|record| search.offer(record));
            return Ok(());
        }
        *held = None;
        let mut from = 0;
        while from < near.count(at) {
            near.read(at, from, records, HELD)?;
            records.iter().for_each(|record| search.offer(record));
            from += HELD as u64;
        }
        Ok(())
    }

    /// The look of a triangle at its point nearest to `p` (lattice steps).
    fn at(&mut self, number: u32, t: &Triangle, p: [f64; 3]) -> Result<SurfaceLook, SourceError> {
        if number == UNKNOWN {
            return Ok(SurfaceLook::NOTHING);
        }
        let failed = |cause| scratch(&self.paint.folder, cause);
        let look = match &self.last {
            Some((at, look)) if *at == number => *look,
            _ => self.paint.columns.get(number).map_err(failed)?,
        };
        self.last = Some((number, look));
        let weights = nearest_point(t, p);
        let normal = look.normals.and_then(|normals| {
            let n: [f32; 3] = mixed(&normals, weights);
            let length = n.iter().map(|c| c * c).sum::<f32>().sqrt();
            (length > 1e-6).then(|| n.map(|c| c / length))
        });
        let coat = self.paint.coats.get(look.material as usize);
        let part = look.part.to_le_bytes()[0];
        if coat.is_none() && look.colors.is_none() {
            return Ok(SurfaceLook { part, normal, ..SurfaceLook::NOTHING });
        }
        let mut light = look.colors.map_or([1.0; 3], |colors| mixed(&colors, weights));
        let times = |light: &mut [f32; 3], more: [f32; 3]| {
            light.iter_mut().zip(more).for_each(|(c, more)| *c *= more);
        };
        if let Some(coat) = coat {
            times(&mut light, coat.color);
            if let (Some(texture), Some(places)) = (&coat.texture, look.places) {
                let places = places.map(|place| texture.texels(place));
                let (rate, at) = (texels_per_voxel(t, &places), mixed(&places, weights));
                times(&mut light, texture.color(at, rate, &mut self.pages).map_err(failed)?);
            }
        }
        Ok(SurfaceLook { color: light.map(texture::encoded), part, normal })
    }
}

/// The centre of a voxel along an axis.
fn centre(voxel: u32) -> f64 {
    f64::from(voxel) * f64::from(STEPS) + f64::from(HALF)
}

/// Index of a voxel of a brick's slice.
fn at_in_slice(skin: &SkinSlice<'_>, [x, y, _]: [u32; 3]) -> usize {
    let [x0, y0, _] = skin.corner();
    BRICK * (y - y0) as usize + (x - x0) as usize
}

/// The places of a brick's slice, to which triangles are offered.
struct SliceSearch<'a> {
    skin: &'a SkinSlice<'a>,
    surface: SurfaceKind,
    places: &'a [[f64; 3]],
    best: &'a mut [Best],
}

impl SliceSearch<'_> {
    fn offer(&mut self, record: &Numbered) {
        let [t @ .., number] = record;
        let corner = self.skin.corner().map(|c| c as i32);
        // The places of cells lie up to a voxel before the centre of the voxel of the same number.
        let beyond = 2 * STEPS + if self.surface == SurfaceKind::Cells { STEPS } else { 0 };
        let mut ranges = [(0, 0); 3];
        for (axis, out) in ranges.iter_mut().enumerate() {
            let (low, high) = span(t, axis);
            let last = if axis == 2 { 0 } else { BRICK as i32 - 1 };
            let first = first_centre(low - 2 * STEPS) - corner[axis];
            *out = (first.max(0), (last_centre(high + beyond) - corner[axis]).min(last));
            if out.0 > out.1 {
                return;
            }
        }
        let columns = u32::MAX << ranges[0].0 & u32::MAX >> (31 - ranges[0].1);
        let mut ready = None;
        for y in ranges[1].0..=ranges[1].1 {
            let mut left = self.skin.rows()[y as usize] & columns;
            while left != 0 {
                let at = BRICK * y as usize + left.trailing_zeros() as usize;
                left &= left - 1;
                let p = self.places[at];
                let best = &mut self.best[at];
                let height = ready.get_or_insert_with(|| FacetPlane::new(t)).squared_height(p);
                if height > best.squared {
                    continue;
                }
                let squared = (squared_distance(t, p) + ROUNDER) - ROUNDER;
                let taken = squared < best.squared
                    || squared == best.squared
                        && (height > best.height
                            || height == best.height && number.cast_unsigned() < best.number());
                if taken {
                    *best = Best { squared, height, record: *record };
                }
            }
        }
    }
}

struct FacetPlane {
    normal: [f64; 3],
    at: [f64; 3],
}

impl FacetPlane {
    fn new(t: &Triangle) -> Self {
        let [at, b, c] = edges(t);
        let n = cross(b, c);
        let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
        let normal = if length > 0.0 { n.map(|c| c / length) } else { [0.0; 3] };
        Self { normal, at }
    }

    /// Squared distance of a point, rounded.
    fn squared_height(&self, p: [f64; 3]) -> f64 {
        let along: f64 = (0..3).map(|k| self.normal[k] * (p[k] - self.at[k])).sum();
        (along * along + ROUNDER) - ROUNDER
    }
}

/// The mean of three values with these weights.
fn mixed<const N: usize>(of: &[[f32; N]; 3], weights: [f32; 3]) -> [f32; N] {
    std::array::from_fn(|k| (0..3).map(|corner| weights[corner] * of[corner][k]).sum())
}
