//! Division of a tile into resolutions, sub-bands, precincts and code-blocks (ISO/IEC 15444-1 Annex B).
//!
//! A tile's coefficients lie in the place of its samples, the sub-bands as in Mallat's pyramid:
//!
//! ```text
//! +----+----+---------+     LL and the three sub-bands of resolution 1 fill the area of resolution 1,
//! | LL | HL |         |     which together with those of resolution 2 fills that of resolution 2.
//! +----+----+   HL    |
//! | LH | HH |         |
//! +----+----+---------+
//! |   LH    |   HH    |
//! +---------+---------+
//! ```

use super::MAX_PLANES;
use super::allowance::Allowance;
use super::header::{Coding, Parameters};
use crate::codec::{CodecError, damaged, unsupported};

/// A half-open rectangle on a grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Rect {
    pub(super) x0: u32,
    pub(super) y0: u32,
    pub(super) x1: u32,
    pub(super) y1: u32,
}

impl Rect {
    pub(super) fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    pub(super) fn height(&self) -> u32 {
        self.y1 - self.y0
    }

    fn is_empty(&self) -> bool {
        self.x0 >= self.x1 || self.y0 >= self.y1
    }

    /// The rectangle with its corners divided by a power of two and rounded up.
    fn reduced(&self, log2: u32) -> Self {
        let reduce = |place: u32| ceil_shift(u64::from(place), log2);
        Self { x0: reduce(self.x0), y0: reduce(self.y0), x1: reduce(self.x1), y1: reduce(self.y1) }
    }
}

/// `value / 2^log2`, rounded up; places are below 2^31 and `log2` at most 33.
fn ceil_shift(value: u64, log2: u32) -> u32 {
    u32::try_from((value + (1u64 << log2) - 1) >> log2).unwrap_or(u32::MAX)
}

/// A sub-band's kind, and so the contexts of its coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Orientation {
    /// Low in both directions.
    Ll,
    /// High along rows.
    Hl,
    /// High along columns.
    Lh,
    /// High in both.
    Hh,
}

pub(super) struct Band {
    rect: Rect,
    /// Position in the tile's area.
    left: u32,
    top: u32,
    pub(super) orientation: Orientation,
    /// Magnitude bit planes, including the region of interest's.
    pub(super) planes: u32,
    /// Quantisation step; 1 where reversible.
    pub(super) step: f32,
}

pub(super) struct Resolution {
    pub(super) rect: Rect,
    /// Precincts across and down.
    pub(super) across: u32,
    pub(super) down: u32,
    pub(super) width_log2: u32,
    pub(super) height_log2: u32,
    /// Number of its first precinct in the tile.
    pub(super) first_precinct: u32,
    /// Its sub-bands: one at the lowest resolution, three at the others.
    bands: Vec<Band>,
}

impl Resolution {
    pub(super) fn precincts(&self) -> u32 {
        self.across * self.down
    }
}

/// The code-blocks of one sub-band in one precinct.
#[derive(Clone, Copy)]
pub(super) struct Grid {
    /// First code-block across and down, counted from the grid's origin.
    column: u32,
    row: u32,
    pub(super) across: u32,
    pub(super) down: u32,
    width_log2: u32,
    height_log2: u32,
    /// The precinct's part of the sub-band.
    area: Rect,
    left: u32,
    top: u32,
}

impl Grid {
    pub(super) fn blocks(&self) -> usize {
        self.across as usize * self.down as usize
    }

    /// Position in the tile's area, width and height of a code-block.
    pub(super) fn block(&self, column: u32, row: u32) -> (u32, u32, u16, u16) {
        let side = |first: u32, index: u32, log2: u32, least: u32, most: u32| {
            let start = (first + index) << log2;
            let (start, end) = (start.max(least), (start + (1 << log2)).min(most));
            (start, u16::try_from(end.saturating_sub(start)).unwrap_or(0))
        };
        let (x, width) = side(self.column, column, self.width_log2, self.area.x0, self.area.x1);
        let (y, height) = side(self.row, row, self.height_log2, self.area.y0, self.area.y1);
        (x.wrapping_sub(self.left), y.wrapping_sub(self.top), width, height)
    }
}

pub(super) struct ComponentLayout {
    pub(super) resolutions: Vec<Resolution>,
    block_width_log2: u32,
    block_height_log2: u32,
}

pub(super) struct TileLayout {
    pub(super) rect: Rect,
    pub(super) components: Vec<ComponentLayout>,
    pub(super) precincts: usize,
    /// Memory of the lists of this layout.
    bytes: u64,
}

impl TileLayout {
    pub(super) fn new(
        rect: &Rect,
        parameters: &Parameters,
        precision: u8,
        allowance: &mut Allowance,
    ) -> Result<Self, CodecError> {
        let mut layout = Self { rect: *rect, components: Vec::new(), precincts: 0, bytes: 0 };
        let mut component = 0;
        while let Ok(coding) = parameters.component(component) {
            let resolutions = usize::from(coding.levels) + 1;
            let bytes = size_of::<ComponentLayout>() * 2
                + resolutions * (size_of::<Resolution>() + 3 * size_of::<Band>());
            allowance.reserve(bytes as u64)?;
            layout.bytes += bytes as u64;
            layout.add(coding, precision)?;
            component += 1;
        }
        Ok(layout)
    }

    /// A resolution, by its number and its component's.
    pub(super) fn resolution(&self, (resolution, component): (u8, u8)) -> &Resolution {
        &self.components[usize::from(component)].resolutions[usize::from(resolution)]
    }

    /// Resolutions of the same component above one.
    pub(super) fn depth(&self, (resolution, component): (u8, u8)) -> u32 {
        let resolutions = self.components[usize::from(component)].resolutions.len();
        u32::try_from(resolutions - 1 - usize::from(resolution)).unwrap_or(0)
    }

    pub(super) fn release(&self, allowance: &mut Allowance) {
        allowance.release(self.bytes);
    }

    fn add(&mut self, coding: &Coding, precision: u8) -> Result<(), CodecError> {
        let mut resolutions = Vec::with_capacity(usize::from(coding.levels) + 1);
        for resolution in 0..=coding.levels {
            let rect = self.rect.reduced(u32::from(coding.levels - resolution));
            let precinct = coding.precincts[usize::from(resolution)];
            let (width_log2, height_log2) = (u32::from(precinct & 15), u32::from(precinct >> 4));
            let count = |from: u32, to: u32, log2: u32| ceil_shift(to.into(), log2) - (from >> log2);
            let (across, down) = if rect.is_empty() {
                (0, 0)
            } else {
                (count(rect.x0, rect.x1, width_log2), count(rect.y0, rect.y1, height_log2))
            };
            let first_precinct = u32::try_from(self.precincts).map_err(|_| damaged("too many precincts"))?;
            self.precincts = (across as usize)
                .checked_mul(down as usize)
                .and_then(|count| count.checked_add(self.precincts))
                .filter(|&count| u32::try_from(count).is_ok())
                .ok_or_else(|| damaged("too many precincts"))?;
            let bands = self.bands(coding, precision, resolution, &rect)?;
            resolutions.push(Resolution {
                rect,
                across,
                down,
                width_log2,
                height_log2,
                first_precinct,
                bands,
            });
        }
        self.components.push(ComponentLayout {
            resolutions,
            block_width_log2: coding.block_width_log2.into(),
            block_height_log2: coding.block_height_log2.into(),
        });
        Ok(())
    }

    /// The sub-bands of a resolution (B-15, E-3).
    fn bands(
        &self,
        coding: &Coding,
        precision: u8,
        resolution: u8,
        rect: &Rect,
    ) -> Result<Vec<Band>, CodecError> {
        let kinds: &[Orientation] = if resolution == 0 {
            &[Orientation::Ll]
        } else {
            &[Orientation::Hl, Orientation::Lh, Orientation::Hh]
        };
        let mut bands = Vec::with_capacity(kinds.len());
        for (index, &orientation) in kinds.iter().enumerate() {
            let (right, below) = match orientation {
                Orientation::Ll => (0, 0),
                Orientation::Hl => (1, 0),
                Orientation::Lh => (0, 1),
                Orientation::Hh => (1, 1),
            };
            let depth = u32::from(coding.levels) - u32::from(resolution) + u32::from(resolution > 0);
            let half = if depth == 0 { 0 } else { 1u64 << (depth - 1) };
            let reduce =
                |place: u32, high: u64| ceil_shift(u64::from(place).saturating_sub(half * high), depth);
            let band = Rect {
                x0: reduce(self.rect.x0, right),
                y0: reduce(self.rect.y0, below),
                x1: reduce(self.rect.x1, right),
                y1: reduce(self.rect.y1, below),
            };
            let number = if resolution == 0 { 0 } else { 3 * (usize::from(resolution) - 1) + 1 + index };
            let (exponent, mantissa) = coding.step(resolution, number)?;
            let planes = coding.planes(exponent) + u32::from(coding.roi_shift);
            // More are harmless as long as no code-block uses them; far more can only be damage.
            if planes > 4 * MAX_PLANES {
                return Err(unsupported("that many bit planes"));
            }
            let step = if coding.reversible {
                1.0
            } else {
                let mantissa = 1.0 + mantissa as f32 / 2048.0;
                let gain = u32::try_from(right + below).unwrap_or(0);
                let range = i32::from(precision) + gain.cast_signed() - exponent.cast_signed();
                mantissa * 2f32.powi(range)
            };
            let low = |first: u32, last: u32| last.div_ceil(2) - first.div_ceil(2);
            bands.push(Band {
                rect: band,
                left: if right == 1 { low(rect.x0, rect.x1) } else { 0 },
                top: if below == 1 { low(rect.y0, rect.y1) } else { 0 },
                orientation,
                planes,
                step,
            });
        }
        Ok(bands)
    }
}

impl ComponentLayout {
    /// The sub-bands of a precinct, with their code-blocks.
    pub(super) fn grids(&self, resolution: usize, precinct: u32) -> impl Iterator<Item = (&Band, Grid)> {
        let level = self.resolutions.get(resolution);
        level.into_iter().flat_map(move |level| {
            level.bands.iter().map(move |band| (band, self.grid(resolution, level, band, precinct)))
        })
    }

    fn grid(&self, resolution: usize, level: &Resolution, band: &Band, precinct: u32) -> Grid {
        // A precinct covers half as much of each sub-band as of its resolution (B.7).
        let half = u32::from(resolution > 0);
        let (across_log2, down_log2) = (level.width_log2 - half, level.height_log2 - half);
        let column = (level.rect.x0 >> level.width_log2) + precinct % level.across.max(1);
        let row = (level.rect.y0 >> level.height_log2) + precinct / level.across.max(1);
        let within = |index: u32, log2: u32, least: u32, most: u32| {
            let start = u64::from(index) << log2;
            let clamp = |place: u64| u32::try_from(place.min(most.into())).unwrap_or(most).max(least);
            (clamp(start), clamp(start + (1 << log2)))
        };
        let (x0, x1) = within(column, across_log2, band.rect.x0, band.rect.x1);
        let (y0, y1) = within(row, down_log2, band.rect.y0, band.rect.y1);
        let area = Rect { x0, y0, x1, y1 };
        let (width_log2, height_log2) =
            (self.block_width_log2.min(across_log2), self.block_height_log2.min(down_log2));
        let (column, row) = (x0 >> width_log2, y0 >> height_log2);
        let (across, down) = if area.is_empty() {
            (0, 0)
        } else {
            (ceil_shift(x1.into(), width_log2) - column, ceil_shift(y1.into(), height_log2) - row)
        };
        // Origin of the sub-band on its own grid, less its position in the tile.
        Grid {
            column,
            row,
            across,
            down,
            width_log2,
            height_log2,
            area,
            left: band.rect.x0.wrapping_sub(band.left),
            top: band.rect.y0.wrapping_sub(band.top),
        }
    }
}
