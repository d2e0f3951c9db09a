//! Gap between a pore and the outer surface: the least distance from middles and corners of the pore's cells to a cell
//! of that surface.
//!
//! While slices pass, each cell is noted with the components that it bounds; whether these are enclosed is known when
//! they end. Then a search runs from the cells of each pore over the cells that bound no pore.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, Write};

use super::components::Noted;
use crate::error::Error;
use crate::jobs::pass::PageRelief;
use crate::load::Model;
use crate::measure::nearest::{Query, Surface};
use crate::progress::Progress;

/// Bytes of a noted cell.
const NOTE_BYTES: usize = 24;

/// Cells between two checks for a stop.
const PART: usize = 1024;

/// Numbers of a component that bounds the outside, and of one that was left out.
const OUTER: u32 = 0;
pub(super) const LEFT_OUT: u32 = u32::MAX;

/// Noted cells, in an unnamed file.
pub(super) struct Notes(pub(super) BufWriter<File>);

impl Notes {
    pub(super) fn add(&mut self, noted: &[Noted]) -> io::Result<()> {
        for Noted { serial, number, cell } in noted {
            self.0.write_all(&serial.to_le_bytes())?;
            self.0.write_all(&number.to_le_bytes())?;
            cell.iter().try_for_each(|c| self.0.write_all(&c.to_le_bytes()))?;
        }
        Ok(())
    }

    /// Reads all of them, from the first one on.
    fn read(&mut self) -> io::Result<impl Iterator<Item = io::Result<Noted>> + '_> {
        self.0.flush()?;
        self.0.get_mut().rewind()?;
        let mut file = BufReader::new(self.0.get_ref());
        Ok(std::iter::from_fn(move || {
            let mut bytes = [0; NOTE_BYTES];
            match file.read_exact(&mut bytes) {
                Err(cause) if cause.kind() == io::ErrorKind::UnexpectedEof => None,
                read => Some(read.map(|()| {
                    let words: [[u8; 4]; 6] = bytemuck::cast(bytes);
                    let [serial, low, high, x, y, z] = words.map(u32::from_le_bytes);
                    Noted { serial, number: u64::from(high) << 32 | u64::from(low), cell: [x, y, z] }
                })),
            }
        }))
    }

    /// The gap of each of so many pores, by number from 1 on; infinity without an outer surface. `parents` maps a
    /// component to the one that it was joined with, `ends` are components that ended, with their pores' numbers.
    ///
    /// Memory: a bit a cell, 8 bytes a component. Cost: a search for each cell of a pore, bounded by the gap so far.
    pub(super) fn gaps_mm(
        &mut self,
        (model, surface): (&Model, &Surface<'_>),
        parents: &[u32],
        ends: &[(u32, u32)],
        pores: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<f64>, Error> {
        let unreadable = |cause| Error::Output { path: std::env::temp_dir(), cause };
        let mut ids = vec![OUTER; parents.len()];
        ends.iter().for_each(|(serial, id)| ids[*serial as usize] = *id);
        // A parent is older, so its number is final before its children's.
        for (serial, parent) in parents.iter().enumerate() {
            ids[serial] = ids[*parent as usize];
        }
        let mut outer = vec![0_u64; usize::try_from(model.header().voxels / 64 + 1).unwrap_or(0)];
        for noted in self.read().map_err(unreadable)? {
            let Noted { serial, number, .. } = noted.map_err(unreadable)?;
            if ids[serial as usize] == OUTER
                && let Some(word) = usize::try_from(number / 64).ok().and_then(|at| outer.get_mut(at))
            {
                *word |= 1 << (number % 64);
            }
        }
        let mut gaps = vec![f64::INFINITY; pores + 1];
        let models = [model];
        let mut search = surface.relieved(&models).search();
        let mut relief = PageRelief::new(&models);
        for (at, noted) in self.read().map_err(unreadable)?.enumerate() {
            let Noted { serial, number, cell } = noted.map_err(unreadable)?;
            let Some(gap) =
                gaps.get_mut(ids[serial as usize] as usize).filter(|_| ids[serial as usize] != OUTER)
            else {
                continue;
            };
            let mut ask = |point: [f64; 3]| {
                let query = Query { among: Some(&outer), ..Query::within(*gap) };
                *gap = search.nearest(point, &query).map_or(*gap, |found| gap.min(found.distance()));
            };
            let place = surface.cell_place(number, cell);
            ask(surface.sample(place).point);
            surface.facets(place, |_, facet| facet.corners(&mut ask));
            relief.step(1);
            if at % PART == 0 && progress.stopped() {
                return Err(Error::Stopped);
            }
        }
        Ok(gaps.split_off(1))
    }
}
