//! JPEG 2000 (ISO/IEC 15444-1) and high-throughput JPEG 2000 (15444-15): raw codestreams and JP2 files.
//!
//! The stages of a frame, one file each:
//!
//! ```text
//! header    marker segments -> image size, coding and quantisation of each component, tile-parts
//! geometry  a tile -> resolutions, sub-bands, precincts, code-blocks, and what they will take
//! packets   packet headers (tag trees) -> where the bytes of each code-block are
//!           progression: the order of packets
//! mq, block bit-plane decoding of a code-block (EBCOT)      ht, ht_tables   its high-throughput kin
//! wavelet   the inverse transforms 5/3 (integers, exact) and 9/7 (floats)
//! ```
//!
//! Memory: the compressed bytes; the samples of one row of tiles (4 bytes each; of the whole image
//! if it is one tile), transformed in place; and per tile some 40 bytes for a code-block and 16 for each
//! of its pieces. All of it is counted before it is allocated, against the bytes allowed.
//!
//! Time: every packet consumes a byte at least; visits of code-blocks that consume nothing are counted;
//! every other loop is over samples that the receiver accepted or over bytes that were read. Bit planes of
//! a code-block are limited to 30.
//!
//! Not decoded: components of different size, precision or sign; packed packet headers (PPM, PPT); more
//! than 30 bit planes; palettes; code-blocks mixing both block coders; Part 2 extensions.

use std::io::Read;

use super::{CodecError, FrameFormat, RowSink};

mod allowance;
mod block;
mod geometry;
mod header;
mod ht;
mod ht_tables;
mod mq;
mod packets;
mod progression;
#[cfg(test)]
mod tests;
#[cfg(test)]
#[path = "../../../tests/it/common/codec/jpeg2000_vectors.rs"]
mod vectors;
mod wavelet;

use crate::codec::{damaged, unsupported};
use allowance::Allowance;
use geometry::TileLayout;
use header::{ImageSize, Parameters, TileParts};

/// Magnitude bit planes of a coefficient: one more bit holds the half for the middle of an interval, and one the sign.
const MAX_PLANES: u32 = 30;

/// Resolution levels above the lowest, by the standard.
const MAX_LEVELS: usize = 32;

/// Visits of code-blocks and precincts that a frame may take besides [`VISITS_PER_SAMPLE`]: less than a second,
/// far more than any encoder's choices lead to.
const VISITS: u64 = 1 << 22;

/// One layer of the smallest code-blocks is a sixteenth of a visit for each sample.
const VISITS_PER_SAMPLE: u64 = 4;

/// Bytes for lists of a few dozen bytes each, which are not counted one by one.
const SMALL_LISTS: u64 = 4096;

/// Decodes one frame of `compressed_bytes` bytes, holding at most `memory_bytes`.
///
/// Samples are of the precision and sign of the codestream. Reversibly coded frames are exact; irreversible ones may
/// differ by one unit from other decoders, as the standard allows.
///
/// # Errors
/// The codestream is damaged or ends early, is of a kind named in the module's text, needs more memory
/// than allowed, or `sink` refuses it.
pub(crate) fn decode(
    input: &mut dyn Read,
    compressed_bytes: u64,
    memory_bytes: u64,
    sink: &mut dyn RowSink,
) -> Result<(), CodecError> {
    let mut allowance = Allowance { used: 0, allowed: memory_bytes, visits: VISITS };
    allowance.reserve(SMALL_LISTS)?;
    let too_long = || CodecError::Memory { needed_bytes: compressed_bytes, allowed_bytes: memory_bytes };
    // Places in the codestream are kept as 32 bits.
    if compressed_bytes >= u64::from(u32::MAX) {
        return Err(too_long());
    }
    let mut bytes: Vec<u8> = allowance.room(usize::try_from(compressed_bytes).map_err(|_| too_long())?)?;
    input.take(compressed_bytes).read_to_end(&mut bytes)?;

    let codestream = header::find_codestream(&bytes)?;
    let (size, at) = ImageSize::parse(codestream)?;
    sink.begin(&FrameFormat {
        columns: size.x1 - size.x0,
        rows: size.y1 - size.y0,
        components: size.components,
        precision: size.precision,
        signed: size.signed,
    })?;
    // Arithmetic on coefficients is in 32 bits; medical images have 16 at most.
    if u32::from(size.precision) > MAX_PLANES - 2 {
        return Err(unsupported("samples of more than 28 bits"));
    }
    allowance.reserve(Parameters::bytes(size.components).saturating_mul(2))?;
    let (parameters, at) = Parameters::parse_main(codestream, at, size.components)?;
    let parts = TileParts::index(codestream, at, &size, &mut allowance)?;
    decode_tiles(codestream, &size, &parameters, &parts, &mut allowance, sink)
}

/// Decodes row of tiles after row of tiles and hands over their rows.
fn decode_tiles(
    codestream: &[u8],
    size: &ImageSize,
    parameters: &Parameters,
    parts: &TileParts,
    allowance: &mut Allowance,
    sink: &mut dyn RowSink,
) -> Result<(), CodecError> {
    let columns = (size.x1 - size.x0) as usize;
    let components = usize::from(size.components);
    let band_rows = (0..size.tile_rows()).map(|row| size.tile(0, row).height()).max().unwrap_or(0) as usize;
    let plane = columns.checked_mul(band_rows).filter(|plane| plane.checked_mul(components).is_some());
    let plane =
        plane.ok_or(CodecError::Memory { needed_bytes: u64::MAX, allowed_bytes: allowance.allowed })?;
    // All components of a row of tiles, one after the other, each `band_rows` rows of `columns`.
    let mut samples: Vec<i32> = allowance.filled(plane * components, 0)?;
    let image = columns as u64 * u64::from(size.y1 - size.y0) * components as u64;
    allowance.visits = VISITS.saturating_add(image.saturating_mul(VISITS_PER_SAMPLE));
    let longest = columns.max(band_rows);
    let mut line = wavelet::Scratch::new(longest, allowance)?;
    let mut blocks = block::Scratch::new(allowance)?;
    let mut interleaved: Vec<i32> =
        if components > 1 { allowance.filled(columns * components, 0)? } else { Vec::new() };

    for tile_row in 0..size.tile_rows() {
        for tile_column in 0..size.tile_columns() {
            let rect = size.tile(tile_column, tile_row);
            let own = parts.of(tile_row * size.tile_columns() + tile_column);
            let tile_parameters = parameters.of_tile(codestream, own, size.components)?;
            let layout = TileLayout::new(&rect, &tile_parameters, size.precision, allowance)?;
            let mut tile = packets::Tile::new(layout, allowance)?;
            packets::read(codestream, own, &tile_parameters, &mut tile, allowance)?;
            for (component, area) in samples.chunks_exact_mut(plane.max(1)).enumerate() {
                let origin = (rect.x0 - size.x0) as usize;
                let Some(area) = area.get_mut(origin..) else { continue };
                let coding = tile_parameters.component(component)?;
                block::decode_component(
                    codestream,
                    coding,
                    &tile,
                    component,
                    area,
                    columns,
                    &mut blocks,
                    allowance,
                )?;
                wavelet::invert(coding.reversible, &tile.layout, component, area, columns, &mut line);
            }
            finish_samples(&rect, size, &tile_parameters, &mut samples, plane, columns)?;
            tile.release(allowance);
        }
        let rows = size.tile(0, tile_row).height() as usize;
        for row in 0..rows {
            let start = row * columns;
            if components == 1 {
                sink.row(&samples[start..start + columns])?;
                continue;
            }
            for (component, area) in samples.chunks_exact(plane.max(1)).enumerate() {
                let from = &area[start..start + columns];
                for (to, &sample) in interleaved.iter_mut().skip(component).step_by(components).zip(from) {
                    *to = sample;
                }
            }
            sink.row(&interleaved)?;
        }
    }
    Ok(())
}

/// Undoes the component transform (Annex G), turns floats into integers, shifts unsigned samples to their
/// range and clamps all.
fn finish_samples(
    rect: &geometry::Rect,
    size: &ImageSize,
    parameters: &Parameters,
    samples: &mut [i32],
    plane: usize,
    columns: usize,
) -> Result<(), CodecError> {
    let half = 1i32 << (size.precision - 1);
    let (shift, least, most) =
        if size.signed { (0, -half, half - 1) } else { (half, 0, half.wrapping_sub(1).wrapping_add(half)) };
    let (x, width, height) = ((rect.x0 - size.x0) as usize, rect.width() as usize, rect.height() as usize);
    let finish = |value: i32| value.saturating_add(shift).clamp(least, most);
    let rounded = |value: f32| {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "saturates, and NaN is 0: then clamped to the precision"
        )]
        let whole = value.round_ties_even() as i32;
        finish(whole)
    };

    let transformed = parameters.component_transform && size.components >= 3;
    if transformed {
        let reversible = parameters.component(0)?.reversible;
        if parameters.component(1)?.reversible != reversible
            || parameters.component(2)?.reversible != reversible
        {
            return Err(damaged("components transformed together are of different wavelets"));
        }
        let (first, rest) = samples.split_at_mut(plane);
        let (second, rest) = rest.split_at_mut(plane);
        for row in 0..height {
            let range = row * columns + x..row * columns + x + width;
            let pixels =
                first[range.clone()].iter_mut().zip(&mut second[range.clone()]).zip(&mut rest[range]);
            for ((a, b), c) in pixels {
                if reversible {
                    let green = a.wrapping_sub(b.wrapping_add(*c) >> 2);
                    (*a, *b, *c) = (c.wrapping_add(green), green, b.wrapping_add(green));
                    (*a, *b, *c) = (finish(*a), finish(*b), finish(*c));
                } else {
                    let [y, cb, cr] = [*a, *b, *c].map(wavelet::float);
                    *a = rounded(y + 1.402 * cr);
                    *b = rounded(y - 0.344_136_3 * cb - 0.714_136_3 * cr);
                    *c = rounded(y + 1.772 * cb);
                }
            }
        }
    }
    let plain = if transformed { 3 } else { 0 };
    for (component, area) in samples.chunks_exact_mut(plane.max(1)).enumerate().skip(plain) {
        let reversible = parameters.component(component)?.reversible;
        for row in 0..height {
            for value in &mut area[row * columns + x..row * columns + x + width] {
                *value = if reversible { finish(*value) } else { rounded(wavelet::float(*value)) };
            }
        }
    }
    Ok(())
}
