//! Textures: an image in linear light, in halving sizes, in a scratch file.
//!
//! A texel of size l is the mean of up to 2^l x 2^l texels of the image. A colour is mixed from the two sizes whose
//! texels are next to a voxel's, each mixed from four texels, so that it is about the mean over the voxel.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use super::super::read::{Image, Texture as FileTexture, Wrap, linear, missing};
use super::image::{Rows, Stop, read};
use crate::fault::bad;
use crate::platform::FileExt;
use crate::scratch::PageCache;
use crate::text::names::CHANNELS;
use crate::text::shown;
use crate::volume::{SourceError, SourceFault};

/// Bytes of a texel: three parts of 16 bits.
const TEXEL: usize = 6;
/// Texels of a page, and pages that a worker holds.
const PAGE: usize = 32;
const PAGES: usize = 509;
/// Most sizes of an image: sides are below 2^16.
const MAX_LEVELS: usize = 17;

#[derive(Clone, Copy, Debug)]
struct Level {
    width: u32,
    height: u32,
    offset: u64,
}

pub(super) struct Levels {
    file: File,
    /// The number of its image, for the pages of workers.
    number: u32,
    levels: Vec<Level>,
}

pub(super) struct Texture {
    levels: Arc<Levels>,
    wraps: [Wrap; 2],
    upwards: bool,
    placed: [[f32; 3]; 2],
}

/// Linear light of every byte, in 16 bits.
fn lights() -> &'static [u16; 256] {
    static LIGHTS: OnceLock<[u16; 256]> = OnceLock::new();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 65535")]
    LIGHTS.get_or_init(|| {
        let mut byte = 0.0_f32;
        std::array::from_fn(|_| {
            let light = (linear(byte / 255.0) * 65_535.0).round() as u16;
            byte += 1.0;
            light
        })
    })
}

/// sRGB of linear light.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
pub(super) fn encoded(light: f32) -> u8 {
    let light = light.clamp(0.0, 1.0);
    let stored = if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    (stored * 255.0 + 0.5) as u8
}

type Row = Vec<[u16; 3]>;

/// Halves an image while its rows come.
struct Halver {
    file: File,
    levels: Vec<Level>,
    /// For every size: number of received rows, and the last one where it waits for the next.
    seen: Vec<(u32, Option<Row>)>,
}

impl Halver {
    fn put(&mut self, mut row: Row) -> io::Result<()> {
        for (level, (count, waiting)) in self.levels.iter().zip(&mut self.seen) {
            let at = level.offset + u64::from(*count) * u64::from(level.width) * TEXEL as u64;
            self.file.write_all_at(bytemuck::cast_slice(&row), at)?;
            *count += 1;
            if level.width == 1 && level.height == 1 {
                break;
            }
            match (waiting.take(), *count == level.height) {
                (None, false) => {
                    *waiting = Some(row);
                    break;
                }
                (None, true) => row = halved(&row, &row),
                (Some(above), _) => row = halved(&above, &row),
            }
        }
        Ok(())
    }
}

/// The means of pairs of two rows; a last texel without a partner counts alone.
fn halved(above: &[[u16; 3]], below: &[[u16; 3]]) -> Row {
    let pair = |(a, b): (&[[u16; 3]], &[[u16; 3]])| {
        std::array::from_fn(|k| {
            let sum: u32 = [a.first(), a.last(), b.first(), b.last()]
                .into_iter()
                .flatten()
                .map(|texel| u32::from(texel[k]))
                .sum();
            u16::try_from((sum + 2) / 4).unwrap_or(u16::MAX)
        })
    };
    above.chunks(2).zip(below.chunks(2)).map(pair).collect()
}

impl Rows for Halver {
    fn begin(&mut self, mut width: u32, mut height: u32) -> io::Result<()> {
        let mut offset = 0;
        loop {
            self.levels.push(Level { width, height, offset });
            self.seen.push((0, None));
            offset += u64::from(width) * u64::from(height) * TEXEL as u64;
            if width == 1 && height == 1 || self.levels.len() == MAX_LEVELS {
                return Ok(());
            }
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
        }
    }

    fn row(&mut self, texels: &[u8]) -> io::Result<()> {
        let lights = lights();
        let light = |byte: u8| lights.get(usize::from(byte)).copied().unwrap_or_default();
        self.put(texels.as_chunks::<3>().0.iter().map(|texel| texel.map(light)).collect())
    }
}

impl Levels {
    fn read(image: &Image, number: u32, folder: &Path) -> Result<Self, SourceError> {
        let scratch = |cause| SourceError::from(SourceFault::Scratch { path: folder.to_path_buf(), cause });
        let name = shown(&image.name);
        let file = crate::scratch::unnamed(folder).map_err(scratch)?;
        let mut halver = Halver { file, levels: Vec::new(), seen: Vec::new() };
        match read(image, folder, &mut halver) {
            Ok(()) => Ok(Self { file: halver.file, number, levels: halver.levels }),
            Err(Stop::Scratch(cause)) => Err(scratch(cause)),
            Err(Stop::Read(cause)) => Err(missing(&image.name, &cause).into()),
            Err(Stop::Wrong(fault)) => {
                Err(bad!("has a texture, {name}, which {fault}, or build it with {CHANNELS} normal").into())
            }
        }
    }
}

/// Images of a file that were read, by their places.
pub(super) type ReadImages = Vec<(Arc<Image>, Arc<Levels>)>;

impl Texture {
    /// Reads a texture's image, unless another texture had the same.
    pub(super) fn open(
        stated: &FileTexture,
        folder: &Path,
        known: &mut ReadImages,
    ) -> Result<Self, SourceError> {
        let levels = match known.iter().find(|(image, _)| Arc::ptr_eq(image, &stated.image)) {
            Some((_, levels)) => levels.clone(),
            None => {
                static NUMBER: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
                let number = NUMBER.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                let levels = Arc::new(Levels::read(&stated.image, number, folder)?);
                known.push((stated.image.clone(), levels.clone()));
                levels
            }
        };
        Ok(Self { levels, wraps: stated.wraps, upwards: stated.upwards, placed: stated.placed })
    }

    /// A place as a file has it in texels of the image, from its upper left corner; beyond the image, too.
    pub(super) fn texels(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let [s, t] = self.placed.map(|[a, b, c]| a * u + b * v + c);
        let t = if self.upwards { 1.0 - t } else { t };
        let size = self.levels.levels.first().map_or([1; 2], |level| [level.width, level.height]);
        let [width, height] = size.map(|side| side as f32);
        [s * width, t * height]
    }

    /// Linear light at a place, in texels, with `rate` texels on a voxel.
    pub(super) fn color(&self, at: [f32; 2], rate: f32, pages: &mut Pages) -> io::Result<[f32; 3]> {
        let last = self.levels.levels.len().saturating_sub(1) as f32;
        let size = if rate > 1.0 { rate.log2().min(last) } else { 0.0 };
        let (fine, more) = (size.floor(), size.fract());
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "few sizes")]
        let fine = fine as usize;
        let near = self.of_level(fine, at, pages)?;
        if more == 0.0 {
            return Ok(near);
        }
        let far = self.of_level(fine + 1, at, pages)?;
        Ok(std::array::from_fn(|k| near[k] + more * (far[k] - near[k])))
    }

    /// Colour mixed from four texels of a size.
    fn of_level(&self, level: usize, at: [f32; 2], pages: &mut Pages) -> io::Result<[f32; 3]> {
        let Some(Level { width, height, .. }) = self.levels.levels.get(level).copied() else {
            return Ok([0.0; 3]);
        };
        let whole = self.levels.levels.first().map_or([1; 2], |level| [level.width, level.height]);
        let mut along = [[(0, 0.0); 2]; 2];
        for (axis, side) in [width, height].into_iter().enumerate() {
            along[axis] = texels_around(at[axis], whole[axis], level, side, self.wraps[axis]);
        }
        let mut light = [0.0; 3];
        for (y, of_row) in along[1] {
            for (x, of_column) in along[0] {
                let texel = pages.texel(&self.levels, level, x, y)?;
                for (sum, part) in light.iter_mut().zip(texel) {
                    *sum += of_row * of_column * f32::from(part) / 65_535.0;
                }
            }
        }
        Ok(light)
    }
}

/// The two texels of a size along an axis around a place in texels of the whole image, and their weights.
#[expect(clippy::cast_possible_truncation, reason = "brought near to the image before")]
fn texels_around(at: f32, whole: u32, level: usize, side: u32, wrap: Wrap) -> [(u32, f32); 2] {
    let (whole, side_f) = (f64::from(whole), i64::from(side));
    let at = if at.is_finite() { f64::from(at) } else { 0.0 };
    let near = match wrap {
        Wrap::Repeat => at.rem_euclid(whole),
        Wrap::Mirror => {
            let back = at.rem_euclid(2.0 * whole);
            if back < whole { back } else { 2.0 * whole - back }
        }
        Wrap::Clamp => at.clamp(0.0, whole),
    };
    let place = near / f64::from(1_u32 << level.min(31)) - 0.5;
    let low = place.floor();
    let more = (place - low) as f32;
    let texel = |k: i64| match wrap {
        Wrap::Repeat => k.rem_euclid(side_f) as u32,
        Wrap::Mirror | Wrap::Clamp => k.clamp(0, side_f - 1) as u32,
    };
    let low = low as i64;
    [(texel(low), 1.0 - more), (texel(low + 1), more)]
}

/// A worker's pages of textures, by image, size, row and number within the row.
pub(super) struct Pages(PageCache<(u32, u32, u32, u32), [u16; 3]>);

impl Pages {
    pub(super) const BYTES: u64 =
        PageCache::<(u32, u32, u32, u32), [u16; 3]>::memory_bytes(PAGES, PAGE) + 1024;

    pub(super) fn new() -> Self {
        Self(PageCache::new(PAGES, PAGE, [0; 3]))
    }

    fn texel(&mut self, levels: &Levels, level: usize, x: u32, y: u32) -> io::Result<[u16; 3]> {
        let Some(size) = levels.levels.get(level) else { return Ok([0; 3]) };
        #[expect(clippy::cast_possible_truncation, reason = "few sizes, pages of 32")]
        let key = (levels.number, level as u32, y, x / PAGE as u32);
        let mixed = [key.0, key.1, key.2, key.3]
            .into_iter()
            .fold(0_u64, |hash, part| (hash ^ u64::from(part)).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let slot = usize::try_from(mixed >> 33).unwrap_or(0) % PAGES;
        let page = self.0.get(slot, key, |page| {
            let from = key.3 as usize * PAGE;
            let count = (size.width as usize).saturating_sub(from).min(PAGE);
            let offset = size.offset + (u64::from(y) * u64::from(size.width) + from as u64) * TEXEL as u64;
            levels.file.read_exact_at(bytemuck::cast_slice_mut(&mut page[..count]), offset)
        })?;
        Ok(page[x as usize % PAGE])
    }
}
