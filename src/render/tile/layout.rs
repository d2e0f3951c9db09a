//! Layout of rays in an array, and the groups of 64 neighbours.
//!
//! Rays of an image are stored row by row. Where rows are about as far apart as rays of a row, tiles are squares of 8 x
//! 8; where rows are far apart, as in the rings of a fan, 64 rays of a row; where rays of a row are far apart, 64 rays
//! of a column. Rays without rows count as one row.

use super::beam::{RAYS, TILE};

/// Least ratio of the distances from the first ray to the first ray of the next row and to the second ray.
const JUMP: f64 = 4.0;

/// Largest difference between a step from a ray to the next and the first step, as a part of that: on a fan's circle
/// all are alike.
const BEND: f64 = 0.5;

/// Size of a step between rays, as a part of their coordinates, that may be rounding.
const ROUNDING: f64 = 1e-9;

/// Largest ratio between the distances of rows and of rays in a row, either way, for square tiles.
const UNEVEN: f64 = 4.0;

/// Tiles in an array of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Rays of a row.
    columns: usize,
    /// Rays of a tile in a row: 1, 8 or 64.
    across: usize,
}

/// A tile of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ArrayTile {
    first: usize,
    layout: Layout,
    /// Mask of rays that are in no earlier tile.
    pub(crate) asked: u64,
}

impl ArrayTile {
    /// The number of a ray in the array.
    #[inline(always)]
    pub(crate) fn number(self, ray: usize) -> usize {
        let Layout { columns, across } = self.layout;
        self.first + ray % across + ray / across * columns
    }
}

impl Layout {
    /// Layout of rays that come in rows of `columns`, if that is known.
    pub(crate) fn of(origins: &[[f64; 3]], directions: &[[f64; 3]], columns: Option<usize>) -> Self {
        let rays = origins.len().min(directions.len());
        let columns = columns.or_else(|| row_of(origins, directions)).unwrap_or(rays).max(1);
        let rows = rays / columns;
        let middle = rows / 2 * columns + columns / 2;
        let ratio =
            (middle > 0).then(|| rows_apart(origins, directions, middle, columns)).flatten().unwrap_or(1.0);
        let square = columns >= TILE && rows >= TILE;
        if columns >= RAYS && (ratio > UNEVEN || !square) {
            Self { columns, across: RAYS }
        } else if rows >= RAYS && (ratio < 1.0 / UNEVEN || !square) {
            Self { columns, across: 1 }
        } else if square {
            Self { columns, across: TILE }
        } else {
            Self { columns: rays, across: RAYS }
        }
    }

    /// The pixels of an image, row by row.
    #[cfg(feature = "python")]
    pub(crate) fn image(columns: usize) -> Self {
        Self { columns: columns.max(1), across: TILE }
    }

    /// Length of parts in whole tiles, about `wanted` rays: arrays are cut into parts that are traced separately. A
    /// remainder shorter than the second number belongs to the previous part.
    #[cfg(any(test, feature = "python"))]
    pub(crate) fn part(self, wanted: usize) -> [usize; 2] {
        let Self { columns, across } = self;
        let band = (RAYS / across * columns).max(1);
        if across == RAYS && columns > wanted {
            return [wanted.next_multiple_of(RAYS), RAYS];
        }
        [(wanted / band).max(1) * band, band]
    }

    /// The tiles of an array, or of a part, of `rays` rays. The last tile of a row or column overlaps the previous one.
    /// Also the number of the first ray that is in no tile.
    pub(crate) fn tiles(self, rays: usize) -> (impl Iterator<Item = ArrayTile>, usize) {
        let layout = Self { columns: self.columns.min(rays), ..self };
        let Self { columns, across } = layout;
        let (down, rows) = (RAYS / across, rays / columns.max(1));
        let is_empty = columns < across || rows < down;
        let starts = |count: usize, side: usize| {
            (0..count).step_by(side).map(move |at| (at.min(count - side), (at + side).saturating_sub(count)))
        };
        let rows_of_tiles = starts(if is_empty { 0 } else { rows }, down);
        let tiles = rows_of_tiles.flat_map(move |(row, rows_before)| {
            starts(columns, across).map(move |(column, before)| {
                let mine = |ray: &usize| ray % across >= before && ray / across >= rows_before;
                let asked = if before + rows_before == 0 {
                    u64::MAX
                } else {
                    (0..RAYS).filter(mine).fold(0, |asked, ray| asked | 1 << ray)
                };
                ArrayTile { first: row * columns + column, layout, asked }
            })
        });
        (tiles, if is_empty { 0 } else { rows * columns })
    }
}

/// Step from one ray to another, and its possible size by rounding.
fn step(lines: &[[f64; 3]], before: usize, here: usize) -> Option<([f64; 3], f64)> {
    let (before, here) = (lines.get(before)?, lines.get(here)?);
    let size = here.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
    Some((std::array::from_fn(|a| here[a] - before[a]), size * ROUNDING))
}

fn size(step: [f64; 3]) -> f64 {
    step.iter().fold(0.0_f64, |m, c| m.max(c.abs()))
}

/// Ratio of the distances to the next row and to the next ray: by directions, or by origins where all directions are
/// equal.
fn rows_apart(origins: &[[f64; 3]], directions: &[[f64; 3]], ray: usize, columns: usize) -> Option<f64> {
    let ray = ray.min(origins.len().min(directions.len()).checked_sub(columns + 1)?);
    [directions, origins].into_iter().find_map(|lines| {
        let (across, rounding) = step(lines, ray, ray + 1)?;
        let (down, _) = step(lines, ray, ray + columns)?;
        (size(across).max(size(down)) > rounding).then(|| size(down) / size(across))
    })
}

/// Rays of a row, if an array looks like an image's: there directions or origins first jump, or turn.
fn row_of(origins: &[[f64; 3]], directions: &[[f64; 3]]) -> Option<usize> {
    let first = [step(origins, 0, 1)?.0, step(directions, 0, 1)?.0];
    (2..origins.len().min(directions.len())).find(|at| {
        [origins, directions].into_iter().zip(first).any(|(lines, first)| {
            let Some((here, rounding)) = step(lines, at - 1, *at) else { return false };
            let Some((before, _)) = step(lines, at - 2, at - 1) else { return false };
            let bend = size(std::array::from_fn(|a| here[a] - before[a]));
            size(here) > JUMP * size(first) + rounding || bend > BEND * size(first) + 4.0 * rounding
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    type Lines = (Vec<[f64; 3]>, Vec<[f64; 3]>);

    fn unit(d: [f64; 3]) -> [f64; 3] {
        let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
        d.map(|c| c / length)
    }

    /// A pinhole's image; a parallel one, of single precision; a scanner's rings, and the same by azimuth.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is asked for")]
    fn arrays(columns: usize, rows: usize) -> [Lines; 4] {
        let at = |i: usize| ((i % columns) as f64, (i / columns) as f64);
        let fan = |turn: f64, ring: f64| {
            let (turn, up) = (turn * 0.003, (ring - 16.0) * 0.02);
            [turn.cos() * up.cos(), turn.sin() * up.cos(), up.sin()]
        };
        let all = |line: &dyn Fn(f64, f64) -> ([f64; 3], [f64; 3])| {
            (0..columns * rows).map(|i| line(at(i).0, at(i).1)).unzip()
        };
        [
            all(&|x, y| ([1.0, 2.0, 3.0], unit([x - 9.5, y - 5.0, 400.0]))),
            all(&|x, y| ([f64::from((x * 0.3) as f32), f64::from((y * 0.3) as f32), 0.0], [0.0, 0.0, 1.0])),
            all(&|x, y| ([1.0, 2.0, 3.0], fan(x, y))),
            all(&|x, y| ([1.0, 2.0, 3.0], fan(y, x))),
        ]
    }

    #[test]
    fn rows_of_any_length_are_found_and_cut_into_tiles() {
        for (columns, rows, across) in [
            (1000, 70, [8, 8, 64, 1]),
            (64, 64, [8, 8, 64, 1]),
            (65, 67, [8, 8, 64, 1]),
            (16, 100, [8, 8, 8, 1]),
            (333, 8, [8, 8, 64, 8]),
        ] {
            for ((origins, directions), across) in arrays(columns, rows).into_iter().zip(across) {
                let layout = Layout::of(&origins, &directions, None);
                assert_eq!(layout, Layout { columns, across }, "{columns} x {rows}");
                assert_eq!(layout, Layout::of(&origins, &directions, Some(columns)));
                // Parts of whole tiles, each ray in one of them.
                let [part, _] = layout.part(1 << 14);
                let (tiles, rest) = layout.tiles(part.min(columns * rows));
                let mut seen = vec![0; part.min(columns * rows)];
                for tile in tiles {
                    (0..RAYS)
                        .filter(|ray| tile.asked >> ray & 1 == 1)
                        .for_each(|ray| seen[tile.number(ray)] += 1);
                }
                assert_eq!(rest, seen.len());
                assert!(seen.iter().all(|times| *times == 1), "{columns} x {rows}");
            }
        }
    }

    #[test]
    fn arrays_without_rows_are_one() {
        let (here, ahead) = (vec![[1.0, 2.0, 3.0]; 200], vec![[0.0, 0.0, 1.0]; 200]);
        let line = Layout { columns: 200, across: RAYS };
        assert_eq!(Layout::of(&here, &ahead, None), line);
        assert_eq!((line.tiles(200).0.count(), line.tiles(200).1), (4, 200));
        assert_eq!(line.part(100), [128, RAYS]);
        for rays in [0, 1, 2, 63] {
            let layout = Layout::of(&here[..rays], &ahead[..rays], None);
            assert_eq!((layout.tiles(rays).0.count(), layout.tiles(rays).1), (0, 0));
        }
    }
}
