//! The order of packets (ISO/IEC 15444-1 B.12).

use super::header::Progression;
use super::packets::{Reader, Tile};
use crate::codec::CodecError;

/// Visits the packets of a progression in order (B.12.1).
pub(super) fn walk(
    tile: &mut Tile,
    progression: &Progression,
    reader: &mut Reader<'_>,
) -> Result<(), CodecError> {
    // Resolutions without precincts are skipped once, not in every layer.
    let mut present: Vec<(u8, u8)> = Vec::new();
    let components = usize::from(progression.components.start)..usize::from(progression.components.end);
    for component in components {
        let Some(layout) = tile.layout.components.get(component) else { break };
        for (index, resolution) in layout.resolutions.iter().enumerate() {
            let (Ok(index), Ok(component)) = (u8::try_from(index), u8::try_from(component)) else { continue };
            if progression.resolutions.contains(&index) && resolution.across > 0 && resolution.down > 0 {
                present.push((index, component));
            }
        }
    }
    reader.allowance.reserve(present.capacity() as u64 * 2)?;
    let layers = progression.layers;
    match progression.order {
        0 | 1 => {
            present.sort_unstable();
            let by_resolution: Vec<&[(u8, u8)]> = present.chunk_by(|a, b| a.0 == b.0).collect();
            let mut level = |reader: &mut Reader<'_>, layer: u16, level: &[(u8, u8)]| {
                for &at in level {
                    for precinct in 0..tile.layout.resolution(at).precincts() {
                        reader.packet(tile, at, precinct, layer)?;
                    }
                }
                Ok::<(), CodecError>(())
            };
            if progression.order == 0 {
                for layer in 0..layers {
                    for group in &by_resolution {
                        level(reader, layer, group)?;
                    }
                }
            } else {
                for group in &by_resolution {
                    for layer in 0..layers {
                        level(reader, layer, group)?;
                    }
                }
            }
        }
        2 => {
            present.sort_unstable();
            for group in present.chunk_by(|a, b| a.0 == b.0) {
                by_position(tile, group, layers, reader)?;
            }
        }
        3 => {
            present.sort_unstable_by_key(|&(resolution, component)| (component, resolution));
            by_position(tile, &present, layers, reader)?;
        }
        _ => {
            present.sort_unstable_by_key(|&(resolution, component)| (component, resolution));
            for group in present.chunk_by(|a, b| a.1 == b.1) {
                by_position(tile, group, layers, reader)?;
            }
        }
    }
    reader.allowance.release(present.capacity() as u64 * 2);
    Ok(())
}

/// Visits precincts by their upper left corners on the reference grid, then in the order of `present`,
/// then by layer.
fn by_position(
    tile: &mut Tile,
    present: &[(u8, u8)],
    layers: u16,
    reader: &mut Reader<'_>,
) -> Result<(), CodecError> {
    let rect = tile.layout.rect;
    // The smallest precinct's sides: no corner lies between multiples of them.
    let (mut step_x, mut step_y) = (31, 31);
    for &at in present {
        let (level, depth) = (tile.layout.resolution(at), tile.layout.depth(at));
        step_x = step_x.min(level.width_log2 + depth);
        step_y = step_y.min(level.height_log2 + depth);
    }
    let next = |place: u32, log2: u32| ((u64::from(place) >> log2) + 1) << log2;
    let mut y = rect.y0;
    while y < rect.y1 {
        let mut x = rect.x0;
        while x < rect.x1 {
            reader.allowance.visit(present.len())?;
            for &at in present {
                if let Some(precinct) = precinct_at(tile, at, x, y) {
                    for layer in 0..layers {
                        reader.packet(tile, at, precinct, layer)?;
                    }
                }
            }
            x = u32::try_from(next(x, step_x)).unwrap_or(u32::MAX);
        }
        y = u32::try_from(next(y, step_y)).unwrap_or(u32::MAX);
    }
    Ok(())
}

/// The precinct whose upper left corner is at a place of the reference grid, if any (B.12.1.3).
fn precinct_at(tile: &Tile, at: (u8, u8), x: u32, y: u32) -> Option<u32> {
    let (level, depth) = (tile.layout.resolution(at), tile.layout.depth(at));
    let index = |place: u32, tile_start: u32, start: u32, log2: u32| {
        let corner = u64::from(place) & ((1u64 << (log2 + depth)) - 1) == 0;
        // The first precinct may begin before the tile does.
        let cut = place == tile_start && (u64::from(start) << depth) & ((1u64 << (log2 + depth)) - 1) != 0;
        let reduced = (u64::from(place) + (1u64 << depth) - 1) >> depth;
        (corner || cut).then_some(u32::try_from(reduced >> log2).ok()?.checked_sub(start >> log2)?)
    };
    let column = index(x, tile.layout.rect.x0, level.rect.x0, level.width_log2)?;
    let row = index(y, tile.layout.rect.y0, level.rect.y0, level.height_log2)?;
    (column < level.across && row < level.down).then(|| row * level.across + column)
}
