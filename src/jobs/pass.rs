//! A pass over the cells of a model that measures each of them, and the files that it writes.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::thread;

use super::export::commit;
use super::open_model::scratch_beside;
use crate::atomic::AtomicFile;
use crate::error::Error;
use crate::format::Quantity;
use crate::load::Model;
use crate::measure::nearest::{BLOCK, Search};
use crate::measure::write_values;
use crate::platform;
use crate::progress::Progress;

/// Cells that a thread takes at a time.
const CHUNK: usize = 4096;

/// Cells between two looks at the resident memory.
const STEPS: usize = 256;

/// Bytes of a table that are written at a time.
const TEXT_BYTES: usize = 64 << 10;

/// Gives pages of models back while cells are measured.
pub(super) struct PageRelief<'a> {
    models: &'a [&'a Model],
    left: usize,
}

impl<'a> PageRelief<'a> {
    pub(super) fn new(models: &'a [&'a Model]) -> Self {
        models.iter().for_each(|model| model.give_back());
        Self { models, left: STEPS }
    }

    /// To be called after some cells of a pass.
    #[inline]
    pub(super) fn step(&mut self, cells: usize) {
        self.left = self.left.saturating_sub(cells);
        if self.left == 0 {
            self.look();
        }
    }

    /// Gives pages back if there are many.
    #[cold]
    pub(super) fn look(&mut self) {
        self.left = STEPS;
        Model::give_back_many(self.models);
    }
}

/// A pass over the cells of the first of some models.
pub(super) struct Pass<'a> {
    /// The models whose pages are given back.
    pub(super) models: &'a [&'a Model],
    pub(super) progress: &'a dyn Progress,
}

impl Pass<'_> {
    /// Makes a row of each cell, works on up to [`BLOCK`] of them at once, and passes them on in the order of the file. Each
    /// worker has a thread.
    ///
    /// Memory: the rows of 4,096 cells a worker.
    ///
    /// # Errors
    /// An error of `each`; [`Error::Stopped`].
    pub(super) fn run<'s, R: Send>(
        &self,
        workers: impl IntoIterator<Item = Search<'s>>,
        row: impl Fn(u64, [u32; 3]) -> R,
        work: impl Fn(&mut Search<'s>, &mut [R]) + Sync,
        mut each: impl FnMut(&R) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let Some(measured) = self.models.first() else { return Ok(()) };
        let mut cells = measured.voxels().places();
        platform::give_back();
        let with_rows = |search| (search, PageRelief::new(self.models), Vec::with_capacity(CHUNK));
        let mut workers: Vec<(Search<'s>, PageRelief<'_>, Vec<R>)> =
            workers.into_iter().map(with_rows).collect();
        let work = |(search, relief, rows): &mut (Search<'s>, PageRelief<'_>, Vec<R>)| {
            for rows in rows.chunks_mut(BLOCK) {
                work(search, rows);
                relief.step(rows.len());
            }
        };
        loop {
            let mut count = 0;
            for (_, _, rows) in &mut workers {
                rows.clear();
                rows.extend(cells.by_ref().take(CHUNK).map(|(number, cell)| row(number, cell)));
                count += rows.len();
            }
            if count == 0 {
                return Ok(());
            }
            let busy = count.div_ceil(CHUNK);
            on_threads(busy, workers.iter_mut().take(busy), work);
            self.progress.advance(count as u64);
            if self.progress.stopped() {
                return Err(Error::Stopped);
            }
            workers.iter().flat_map(|(_, _, rows)| rows).try_for_each(&mut each)?;
        }
    }
}

/// Works on all items with at most `threads` threads: this one, and others as far as the system starts them.
pub(super) fn on_threads<T>(threads: usize, items: impl Iterator<Item = T> + Send, work: impl Fn(T) + Sync) {
    let items = Mutex::new(items);
    let next = || items.lock().unwrap_or_else(PoisonError::into_inner).next();
    let run = || {
        while let Some(item) = next() {
            work(item);
        }
    };
    thread::scope(|scope| {
        (1..threads).for_each(|_| drop(thread::Builder::new().spawn_scoped(scope, run)));
        run();
    });
}

/// Outputs of a pass: values in an unnamed file, rows in a table.
pub(super) struct Records<'a> {
    folder: &'a Path,
    values: BufWriter<File>,
    table: Option<(AtomicFile, &'a Path)>,
    text: Vec<u8>,
}

impl<'a> Records<'a> {
    /// Creates the outputs. The columns of the table are places, the named value, half its 95 % interval, and area.
    pub(super) fn create(folder: &'a Path, csv: Option<&'a Path>, value: &str) -> Result<Self, Error> {
        let values = BufWriter::new(scratch_beside(folder).map_err(unwritable(folder))?);
        let created = |path| Ok::<_, Error>((AtomicFile::create(path).map_err(unwritable(path))?, path));
        let table = csv.map(created).transpose()?;
        let text = format!("x_mm,y_mm,z_mm,{value}_mm,u95_mm,area_mm2\n").into_bytes();
        Ok(Self { folder, values, table, text })
    }

    /// Adds a cell: the values to be kept, and the value and half its interval for the table; NaN for none.
    pub(super) fn add(
        &mut self,
        (at_mm, area_mm2): ([f64; 3], f64),
        kept: &[f64],
        shown: [f64; 2],
    ) -> Result<(), Error> {
        for value in kept {
            // No path is copied for what does not fail.
            self.values.write_all(&value.to_le_bytes()).map_err(|cause| unwritable(self.folder)(cause))?;
        }
        let Some((_, path)) = self.table else { return Ok(()) };
        let [value, u95] = shown.map(|v| if v.is_nan() { String::new() } else { v.to_string() });
        let [x, y, z] = at_mm;
        writeln!(self.text, "{x},{y},{z},{value},{u95},{area_mm2}").map_err(unwritable(path))?;
        if self.text.len() > TEXT_BYTES { self.write_text() } else { Ok(()) }
    }

    fn write_text(&mut self) -> Result<(), Error> {
        if let Some((table, path)) = &self.table {
            table.file().write_all(&self.text).map_err(unwritable(path))?;
            self.text.clear();
        }
        Ok(())
    }

    /// The values of each cell, from the first one on; no cell can be added afterwards.
    pub(super) fn values<const N: usize>(
        &mut self,
    ) -> Result<impl Iterator<Item = io::Result<[f64; N]>>, Error> {
        let rewound = self.values.flush().and_then(|()| self.values.get_mut().rewind());
        rewound.map_err(unwritable(self.folder))?;
        let mut file = BufReader::new(self.values.get_ref());
        Ok(std::iter::repeat_with(move || {
            let mut bytes = [[0; 8]; N];
            file.read_exact(bytes.as_flattened_mut())?;
            Ok(bytes.map(f64::from_le_bytes))
        }))
    }

    /// Writes the model with the first of each cell's `N` values, of magnitudes up to `extent`, and commits the table.
    pub(super) fn finish<const N: usize>(
        mut self,
        (model, output): (&Model, Option<&Path>),
        quantity: &Quantity,
        extent: f64,
        progress: &dyn Progress,
    ) -> Result<(), Error> {
        self.write_text()?;
        if let Some(output) = output {
            if progress.stopped() {
                return Err(Error::Stopped);
            }
            let first = |values: [f64; N]| values.first().copied().filter(|value| !value.is_nan());
            let values = self.values::<N>()?.map(|values| values.map(first));
            write_values(model, output, quantity, extent, values).map_err(unwritable(output))?;
        }
        self.table.map_or(Ok(()), |(table, path)| commit(table, path, progress).map(drop))
    }
}

/// The error of an output that cannot be written.
fn unwritable(path: &Path) -> impl FnOnce(io::Error) -> Error {
    let path = path.to_path_buf();
    move |cause| Error::Output { path, cause }
}
