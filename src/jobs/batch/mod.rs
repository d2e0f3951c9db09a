//! `oct batch`: every volume below some folders into a model, a thumbnail and a line of report, several
//! at a time within one memory budget.
//!
//! ```text
//! catalogue --items--> workers (open, prepare, build, thumbnail) --items--> journal --> reports
//!                          |  memory from one ledger  |
//!                          +-- record beside each model: what is done is not done again
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `ledger` | shares the memory among jobs |
//! | `lock` | one batch at a time in an output folder |
//! | `record` | what is remembered of each volume |
//! | `report` | `report.json` and `report.csv` |
//! | `page` | `index.html`, the contact sheet |

mod ledger;
mod lock;
mod page;
mod record;
mod report;

pub use record::{Item, ModelFacts, Status};
pub use report::{BatchReport, Counts};

use std::fs;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde_json::{Value, json};

use super::build::build_reshaped_source;
use super::masked::{LeftOuts, Masked};
use super::picture::thumbnail_file;
use super::wording::sentences;
use crate::atomic::sweep;
use crate::budget::{HELD_SPREAD, MemoryCap, SizeArgument, peak_rss_bytes};
use crate::builder::{BuildError, BuildOptions, Connectivity, Threshold};
use crate::catalogue::{Catalogue, PatientWords};
use crate::clean::CleanOptions;
use crate::error::Error;
use crate::facts::Instead;
use crate::format::Channel;
use crate::progress::Progress;
use crate::render::picture::paint_bytes;
use crate::resident::give_back;
use crate::source::{Finding, OpenOptions};
use crate::volume::{SourceError, VolumeSource};
use ledger::Ledger;
use lock::FolderLock;
use record::{Journal, Record};

/// Code that is resident beside that of one stage of one job: other jobs are at other stages.
const MORE_CODE: u64 = 1 << 20;
/// What opening a small input and watching a job take, for each job.
const JOB_OVERHEAD: u64 = 704 << 10;
/// Least memory that a job is of use with.
const LEAST_SHARE: u64 = 1536 << 10;
/// Series that take more to be opened, of some 40,000 images, are left aside where the least memory for a batch
/// is stated.
const USUAL_OPENING_BYTES: u64 = 16 << 20;
/// Most pages of a model that a thumbnail touches: coarse levels of however large a model.
const THUMBNAIL_PAGES: u64 = 5 << 20;

/// What to convert, into what, and within which means.
#[derive(Clone, Debug)]
pub struct BatchRequest {
    /// Folders and files to search.
    pub inputs: Vec<PathBuf>,
    /// Folder of the results; made if it is not there.
    pub out: PathBuf,
    /// How volumes are read.
    pub how: OpenOptions,
    /// What is done to each volume before it is built.
    pub clean: CleanOptions,
    /// How models are built. Its memory is the whole process's cap, its threads are shared by the jobs.
    pub build: BuildOptions,
    /// Volumes worked on at a time.
    pub jobs: usize,
    /// Longest side of the thumbnails in pixels; 0 for none.
    pub thumbnails: u32,
    /// Leave patient names that occur in paths as they are?
    pub keep_names: bool,
    /// Volumes of fewer slices are left alone: scouts, scanned documents, single pictures.
    pub min_slices: u32,
}

/// Told how a batch goes on; called from several threads.
pub trait Watcher: Sync {
    /// The inputs have been searched: this many series and files were found.
    fn found(&self, items: u64);
    /// Progress of the job in this slot (0 to jobs - 1), which now works on `name`.
    fn begin(&self, slot: usize, name: &str) -> &dyn Progress;
    /// A volume is finished.
    fn end(&self, slot: usize, item: &Item);
    /// A series or file is finished, with all its volumes.
    fn advance(&self);
}

/// Converts everything below the inputs.
///
/// One bad volume never stops the others. What an earlier run has finished from the same files with the same
/// options is skipped. Reports are written last; a killed run leaves finished models with their records, and
/// no half-written file.
///
/// Memory: [`BuildOptions::memory`] bounds the whole process. A volume that needs more than its job's share
/// waits until it has the others' as well.
///
/// # Errors
/// An input cannot be read at all, the output folder cannot be written, another batch writes into it, or the cap
/// is too small for any job.
/// Volumes that fail are not errors; they are counted in the report.
pub fn batch(request: &BatchRequest, watcher: &dyn Watcher) -> Result<BatchReport, Error> {
    let started = Instant::now();
    let out_error = |cause| Error::Output { path: request.out.clone(), cause };
    fs::create_dir_all(&request.out).map_err(out_error)?;
    let lock = FolderLock::take(&request.out)?;
    sweep(&request.out);
    let scratch = request.build.scratch_folder(&request.out.join("x"));
    let how = OpenOptions { skip: request.out.canonicalize().ok(), ..request.how.clone() };
    let mut catalogue = Catalogue::survey(&request.inputs, &how, &scratch)?;
    watcher.found(catalogue.len() as u64);
    if catalogue.is_empty() {
        let path = request.inputs.first().cloned().unwrap_or_default();
        return Err(SourceError::NoVolume { path, found: Instead::Nothing }.into());
    }

    let limit = request.build.memory.bytes();
    give_back();
    let resident = request.build.memory.held();
    // One series too large to be opened is refused alone.
    let room = limit.saturating_sub(resident + JOB_OVERHEAD + LEAST_SHARE);
    let openable = room / 4 * 3;
    catalogue.allow_opening(openable);
    let base = |jobs: usize, openable| {
        let code = if jobs > 1 { MORE_CODE } else { 0 };
        resident + code + JOB_OVERHEAD * jobs as u64 + opening_bytes(&catalogue, openable, jobs)
    };
    let base_of = |jobs: usize| base(jobs, openable);
    let fits = |jobs: &usize| base_of(*jobs) + LEAST_SHARE * *jobs as u64 <= limit;
    // Fewer jobs where the memory is not enough for all.
    let Some(jobs) = (1..=request.jobs.clamp(1, catalogue.len())).rev().find(fits) else {
        return Err(Error::Build(BuildError::BudgetTooSmall {
            name: request.out.display().to_string(),
            limit_bytes: limit,
            minimum_bytes: (base(1, USUAL_OPENING_BYTES) + LEAST_SHARE + HELD_SPREAD)
                .next_multiple_of(1 << 16),
        }));
    };
    // With more memory more jobs fit, which take more beside their builds.
    let base_at_most = base_of(request.jobs.clamp(1, catalogue.len())).saturating_add(HELD_SPREAD);
    let base = base_of(jobs);
    let masked = Masked::new(request.keep_names, &request.inputs, catalogue.patient_words());
    let run = Run {
        request,
        catalogue: &catalogue,
        watcher,
        ledger: Ledger::new(limit.saturating_sub(base)),
        base_at_most,
        share: limit.saturating_sub(base) / jobs as u64,
        threads: (request.build.threads / jobs).max(1),
        options: options_fingerprint(request),
        journal: Journal::create(&scratch).map_err(out_error)?,
        opening: Mutex::default(),
        names: Mutex::default(),
        broken: Mutex::default(),
        counts: [const { AtomicU64::new(0) }; 3],
        left_outs: Mutex::new(LeftOuts::new(&masked, &catalogue)),
        masked,
    };
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for slot in 0..jobs {
            let (run, next) = (&run, &next);
            scope.spawn(move || {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    if at >= run.catalogue.len() || run.is_broken() {
                        break;
                    }
                    run.convert_item(slot, at);
                    run.watcher.advance();
                }
            });
        }
    });
    if let Some(error) = run.broken.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    let [converted, skipped, failed] = run.counts.map(AtomicU64::into_inner);
    let report = BatchReport {
        counts: Counts { converted, skipped, failed },
        left_out: run.left_outs.into_inner().unwrap_or_else(PoisonError::into_inner).into_lines(),
        warnings: lock.warning.iter().cloned().chain(too_many_words(request, &catalogue)).collect(),
        memory_budget_bytes: limit,
        peak_rss_bytes: peak_rss_bytes(),
        jobs,
        wall_s: started.elapsed().as_secs_f64(),
        options: options_told(request),
    };
    report.write(&request.out, &run.journal).map_err(out_error)?;
    drop(lock);
    Ok(report)
}

/// What the items that can be opened within `openable` bytes take beside their builds: the largest one while it
/// is opened, and what stays of the largest ones while they are worked on.
fn opening_bytes(catalogue: &Catalogue, openable: u64, jobs: usize) -> u64 {
    let mut largest = vec![0; jobs];
    for bytes in (0..catalogue.len()).map(|at| catalogue.opening_bytes(at)).filter(|bytes| *bytes <= openable)
    {
        if let Some(least) = largest.last_mut().filter(|least| bytes > **least) {
            *least = bytes;
            largest.sort_unstable_by(|a, b| b.cmp(a));
        }
    }
    largest.first().copied().unwrap_or(0) + largest.iter().sum::<u64>() / 3
}

/// What is said where more words tell of patients than are kept.
fn too_many_words(request: &BatchRequest, catalogue: &Catalogue) -> Option<String> {
    let most = PatientWords::MOST;
    (!request.keep_names && catalogue.patient_words().is_full()).then(|| {
        format!(
            "the names, numbers and birth dates of the patients have more than {most} words; the longest {most} are masked everywhere, the others only in what concerns their own series and the files beside it"
        )
    })
}

/// All that the workers of one batch share.
struct Run<'a> {
    request: &'a BatchRequest,
    catalogue: &'a Catalogue,
    watcher: &'a dyn Watcher,
    ledger: Ledger,
    /// Memory of the process beside as many jobs as were asked for.
    base_at_most: u64,
    /// Memory of a job that needs no more.
    share: u64,
    threads: usize,
    options: String,
    journal: Journal,
    /// Taken while an item is opened that needs memory worth mentioning: one at a time.
    opening: Mutex<()>,
    /// Hashes of the names that this run has used.
    names: Mutex<std::collections::BTreeSet<u64>>,
    /// What ends the whole batch: the output folder fails.
    broken: Mutex<Option<Error>>,
    counts: [AtomicU64; 3],
    left_outs: Mutex<LeftOuts>,
    masked: Masked<'a>,
}

impl Run<'_> {
    fn is_broken(&self) -> bool {
        self.broken.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Every volume of one item of the catalogue.
    fn convert_item(&self, slot: usize, at: usize) {
        let large = self.catalogue.opening_bytes(at) > JOB_OVERHEAD / 2;
        let turn = large.then(|| self.opening.lock().unwrap_or_else(PoisonError::into_inner));
        let findings = catch_unwind(AssertUnwindSafe(|| self.catalogue.open(at)));
        drop(turn);
        let Ok(findings) = findings else {
            self.report((at, 0), slot, &Item::of_defect(at));
            return;
        };
        for (part, finding) in findings.into_iter().enumerate() {
            let item = self.convert(slot, finding);
            self.report((at, part), slot, &item);
        }
    }

    /// Counts, shows and notes what became of a volume.
    fn report(&self, order: (usize, usize), slot: usize, item: &Item) {
        let count = match item.status {
            Status::Converted => 0,
            Status::Skipped => 1,
            Status::Failed => 2,
        };
        if let Some(count) = self.counts.get(count) {
            count.fetch_add(1, Ordering::Relaxed);
        }
        self.watcher.end(slot, item);
        if let Err(cause) = self.journal.add(order, item) {
            let path = self.request.out.clone();
            self.broken
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .get_or_insert(Error::Output { path, cause });
        }
    }

    /// One volume: skipped, built, or the reason why not.
    fn convert(&self, slot: usize, finding: Finding) -> Item {
        let masked = &self.masked;
        let input = masked.path(&finding.path, &finding.secrets);
        self.left_outs.lock().unwrap_or_else(PoisonError::into_inner).hide(masked, &finding.secrets);
        let mut item = Item {
            status: Status::Failed,
            name: name_of(&finding, &masked.identity(&finding.path)),
            input,
            format: finding.format.to_owned(),
            part: finding.part.clone().unwrap_or_default(),
            files: finding.files.count,
            input_bytes: finding.files.bytes,
            reason: None,
            warnings: Vec::new(),
            model: None,
        };
        // Sentences begin with the path that the item names already.
        let mask = |text: String| masked.text(text, &finding.secrets);
        let mask_reason = |e: String, input: &str| {
            let text = mask(e);
            text.strip_prefix(input)
                .and_then(|rest| rest.strip_prefix(": "))
                .map_or(text.clone(), str::to_owned)
        };
        let slices = finding.size.map(|[_, _, slices]| slices);
        if let Some(slices) = slices.filter(|slices| *slices < self.request.min_slices) {
            item.status = Status::Skipped;
            item.reason =
                Some(format!("has {slices} slice(s), fewer than --min-slices {}", self.request.min_slices));
            return item;
        }
        let source = match finding.volume {
            Ok(source) => source,
            Err(e) => {
                item.reason = Some(mask_reason(e.to_string(), &item.input));
                // What an earlier state of the input gave would lie there as if it were this one's.
                Record::clear(&self.request.out, &item.name);
                return item;
            }
        };
        if !self.names.lock().unwrap_or_else(PoisonError::into_inner).insert(fnv(item.name.as_bytes())) {
            item.reason = Some("another volume of this batch has the same name; convert it apart".into());
            return item;
        }
        item.warnings = sentences(&source.info().notes).into_iter().map(mask).collect();
        let inputs = format!("{:016x}", finding.files.fingerprint);
        if let Some(done) = Record::read(&self.request.out, &item.name)
            && done.version == env!("CARGO_PKG_VERSION")
            && (&done.options, &done.inputs) == (&self.options, &inputs)
            && done.is_whole(&self.request.out)
            && !self.lacks_thumbnail(&done)
        {
            return self.skipped(done, item, &mask);
        }
        let progress = self.watcher.begin(slot, &item.name);
        // A defect in one volume's way must not take the others along.
        let built = catch_unwind(AssertUnwindSafe(|| self.build(source, &item.name, progress)));
        let built = built.unwrap_or(Err(Error::Internal));
        match built {
            Ok((facts, thumbnail_bytes, warnings)) => {
                item.status = Status::Converted;
                item.warnings = warnings.into_iter().map(mask).collect();
                item.model = Some(facts);
                let record = Record {
                    version: env!("CARGO_PKG_VERSION").into(),
                    options: self.options.clone(),
                    inputs,
                    thumbnail_bytes,
                    item: item.clone(),
                };
                if let Err(cause) = record.write(&self.request.out) {
                    item.status = Status::Failed;
                    item.reason = Some(format!("its record cannot be written ({cause})"));
                }
            }
            Err(e) => {
                item.reason = Some(mask_reason(e.to_string(), &item.input));
                Record::clear(&self.request.out, &item.name);
            }
        }
        item
    }

    /// Memory of a thumbnail of a model of so many bytes: the picture, and the pages of the model.
    fn thumbnail_bytes(&self, model_bytes: u64) -> u64 {
        let side = self.request.thumbnails;
        paint_bytes(side, side, self.threads) + model_bytes.min(THUMBNAIL_PAGES)
    }

    /// Was there no memory for a thumbnail when the model was built, and is there now?
    fn lacks_thumbnail(&self, done: &Record) -> bool {
        let lacks =
            |m: &ModelFacts| m.thumbnail.is_none() && self.thumbnail_bytes(m.bytes) <= self.ledger.total();
        self.request.thumbnails > 0 && done.item.model.as_ref().is_some_and(lacks)
    }

    /// What is reported of a volume that was built before: where it lies now, with names masked as this run
    /// asks for, whatever the earlier one did.
    fn skipped(&self, done: Record, item: Item, mask: &dyn Fn(String) -> String) -> Item {
        let item = Item {
            status: Status::Skipped,
            warnings: done.item.warnings.iter().map(|w| mask(w.clone())).collect(),
            model: done.item.model.clone(),
            ..item
        };
        let known = Item { status: done.item.status, ..item.clone() };
        if known != done.item {
            // A record that still tells a name is replaced; if that fails, the model is as good as before.
            let _ = Record { item: known, ..done }.write(&self.request.out);
        }
        item
    }

    /// Model and thumbnail of one volume within the memory that it is granted.
    fn build(
        &self,
        source: Box<dyn VolumeSource>,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<(ModelFacts, u64, Vec<String>), Error> {
        let started = Instant::now();
        let out = &self.request.out;
        let model = out.join(format!("{name}.oct"));
        // A record tells of a whole model; until then there is none.
        Record::clear(out, name);
        let template = BuildOptions {
            threads: self.threads,
            scratch: Some(self.scratch()),
            ..self.request.build.clone()
        };
        let cleaning = &self.request.clean;
        let source = cleaning.reshape(source)?;
        let least = cleaning.smallest_share(&*source, &template).max(source.preparation().memory_bytes);
        let needed = least.max(self.share);
        let Some(grant) = self.ledger.take(needed.min(self.ledger.total()).max(least)) else {
            return Err(Error::Build(BuildError::BudgetTooSmall {
                name: source.info().description.name.clone(),
                limit_bytes: self.request.build.memory.bytes(),
                minimum_bytes: (self.base_at_most + least).next_multiple_of(1 << 16),
            }));
        };
        let options = BuildOptions { memory: MemoryCap::Share(grant.bytes()), ..template };
        let prepared = source.preparation().scratch_bytes;
        let built =
            build_reshaped_source(source, String::new(), cleaning, &options, &model, progress, started)?;
        let memory_bytes = grant.bytes();
        drop(grant);
        let mut warnings = built.warnings;
        let mut thumbnail = None;
        let mut thumbnail_bytes = 0;
        if self.request.thumbnails > 0 {
            let needed = self.thumbnail_bytes(built.report.file_bytes);
            if let Some(_grant) = self.ledger.take(needed) {
                let file = format!("{name}.png");
                thumbnail_file(&model, &out.join(&file), self.request.thumbnails, self.threads)?;
                thumbnail_bytes = fs::metadata(out.join(&file)).map_or(0, |meta| meta.len());
                thumbnail = Some(file);
            } else {
                let enough = SizeArgument((self.base_at_most + needed).next_multiple_of(1 << 16));
                warnings.push(format!("there is no memory for its thumbnail; --memory {enough} is enough"));
            }
        }
        let m = &built.info.frame.metadata;
        let r = &built.report;
        let facts = ModelFacts {
            file: format!("{name}.oct"),
            thumbnail,
            dims: m.dims,
            spacing_mm: m.spacing_mm,
            dtype: super::info::dtype(&built.info.frame).to_owned(),
            range: (r.selection.lo, r.selection.hi.is_finite().then_some(r.selection.hi)),
            skin_voxels: r.skin_voxels,
            nodes: r.nodes,
            bytes: r.file_bytes,
            wall_s: started.elapsed().as_secs_f64(),
            memory_bytes,
            scratch_bytes: prepared + r.scratch_bytes,
        };
        Ok((facts, thumbnail_bytes, warnings))
    }

    fn scratch(&self) -> PathBuf {
        self.request.build.scratch_folder(&self.request.out.join("x"))
    }
}

/// Name of a volume's files: the same in every run, whatever else lies beside it. DICOM names carry a hash of
/// the series; others get one of their path, as `scan.nii.gz` lies in many folders.
fn name_of(finding: &Finding, input: &Path) -> String {
    let part = finding.part.as_deref().unwrap_or_default();
    let stem: String = finding.stem.chars().map(|c| if is_plain(c) { c } else { '_' }).take(80).collect();
    let stem = if stem.starts_with('.') { format!("_{stem}") } else { stem };
    if finding.format == "dicom" {
        return stem;
    }
    // Of the bytes of the path: two names that are no UTF-8 may look the same in a report.
    let key = [input.as_os_str().as_bytes(), b"\n", part.as_bytes()].concat();
    format!("{stem}-{:08x}", fnv(&key) & 0xffff_ffff)
}

/// Characters that any file system and any shell takes as they are.
fn is_plain(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | '+')
}

/// One number for everything in the request that the bytes of results depend on.
fn options_fingerprint(request: &BatchRequest) -> String {
    let b = &request.build;
    let text = format!(
        "{:?} {:?} {:?} {} {} {:?} {:?}",
        b.threshold, b.connectivity, b.channels, b.lod, request.thumbnails, request.how, request.clean
    );
    format!("{:016x}", fnv(text.as_bytes()))
}

/// The same for people.
fn options_told(request: &BatchRequest) -> Value {
    let b = &request.build;
    json!({
        "threshold": match b.threshold {
            Threshold::Iso(lo) => json!({ "iso": lo }),
            Threshold::Range(lo, hi) => json!({ "range": [lo, hi] }),
            Threshold::Otsu => json!("otsu"),
            Threshold::Chosen(selection) => json!({ "range": [selection.lo, selection.hi] }),
        },
        "connectivity": if b.connectivity == Connectivity::Thick6 { 6 } else { 26 },
        "channels": b.channels.iter().map(Channel::name).collect::<Vec<_>>(),
        "gaps": format!("{:?}", request.how.gaps).to_lowercase(),
        "cleaning": request.clean.operations(),
        "thumbnails": request.thumbnails,
        "min_slices": request.min_slices,
    })
}

/// FNV-1a, 64 bits: stable over versions and machines; for telling things apart, not for safety.
pub(super) fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// An atomic text file of the output folder, written through a buffer.
fn write_whole(path: &Path, write: impl FnOnce(&mut dyn io::Write) -> io::Result<()>) -> io::Result<()> {
    let file = crate::atomic::AtomicFile::create(path)?;
    let mut buffered = io::BufWriter::with_capacity(16 << 10, file.file());
    write(&mut buffered)?;
    io::Write::flush(&mut buffered)?;
    drop(buffered);
    file.commit()
}
