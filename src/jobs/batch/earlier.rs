//! Results of earlier runs in the output folder: models that this run did not come across. Reports go on naming their
//! origin, which is recorded nowhere else.

use std::collections::HashSet;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

use super::record::{Item, Journal, Record, Status};
use crate::platform::PositionalFile;

/// Longest line of a report that is read; longer ones are passed over.
const MAX_LINE_BYTES: u64 = 1 << 20;

/// Hands out the items of the report that lies in `out`, with their lines' numbers. A report that cannot be read has
/// none; a line that is not an item is passed over.
///
/// Memory: one line.
///
/// # Errors
/// The errors of `work`.
pub(in crate::jobs) fn items(
    out: &Path,
    work: &mut dyn FnMut(usize, Item) -> io::Result<()>,
) -> io::Result<()> {
    let Ok(report) = PositionalFile::open(&out.join("report.json")) else { return Ok(()) };
    let mut lines = BufReader::new(report.onwards(0));
    let mut line = Vec::new();
    for number in 0.. {
        line.clear();
        match io::Read::take(&mut lines, MAX_LINE_BYTES).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => break,
            Ok(_) => {}
        }
        // Each item is a line of its own.
        let text = line.trim_ascii();
        let text = text.strip_suffix(b",").unwrap_or(text);
        if let Ok(item) = serde_json::from_slice(text) {
            work(number, item)?;
        }
    }
    Ok(())
}

/// Adds to the journal, behind this run's items, the items of the report in `out` whose models are still there and are
/// not models of this run. `shows_text` is set if thumbnails are shown whose pixels may carry text.
///
/// Memory: a name for each model of this run, and a line.
///
/// # Errors
/// The journal cannot be read or written. A report that cannot be read is ignored.
pub(super) fn take_over(out: &Path, shows_text: bool, journal: &Journal) -> io::Result<()> {
    let mut known = HashSet::new();
    journal.for_each(&mut |item| {
        if item.model.is_some() {
            known.insert(item.name);
        }
        Ok(())
    })?;
    items(out, &mut |number, mut item| {
        let Some(record) = Record::read(out, &item.name).filter(|record| record.is_of(&item.name, out))
        else {
            return Ok(());
        };
        if !known.insert(item.name.clone()) {
            return Ok(());
        }
        let mut model = record.model;
        if item.burned_in.is_some() && !shows_text {
            model.thumbnail = None;
        }
        (item.status, item.model) = (Status::Kept, Some(model));
        (item.cause, item.reason) = (None, None);
        journal.add((usize::MAX, number), &item)
    })
}
