//! `oct batch`: every volume below some folders into a model, a thumbnail and a line of report, several
//! at a time within one memory budget.
//!
//! ```text
//! catalogue --items--> workers (open, prepare, build, thumbnail) --items--> journal --> reports
//!                          |  memory from one budget  |
//!                          +-- record beside each model: what is done is not done again
//! ```
//!
//! | file | content |
//! |---|---|
//! | `claims` | names of the volumes |
//! | `key` | key that hides times of change in records; options of the request as a number |
//! | `lock` | the output folder, and one batch at a time in it |
//! | `settle` | labels or a threshold, without a choice |
//! | `record` | record of each volume |
//! | `report` | `report.json` and `report.csv`, and `viewer.html`, a linked page of models |
//! | `page` | `index.html`, the contact sheet, and `report.js`, its names and folders, which stay at home |

mod claims;
pub(super) mod earlier;
mod key;
mod lock;
pub(super) mod page;
mod record;
mod report;
mod settle;

pub use record::{Cause, Item, ModelFacts, Status};
pub use report::{
    BatchOptions, BatchReport, Counts, Holdings, LeftOutCount, LeftOutFile, NOTICE, ThresholdOption,
};

use std::fs;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use super::build::{BuildJob, BuildSummary, GridOptions, above_cap};
use super::picture::thumbnail_within_pages;
use crate::atomic::sweep;
use crate::budget::{Budget, MemoryCap, Reservation, SizeArgument, TooSmall, peak_rss_bytes};
use crate::builder::{BuildError, BuildFault, BuildOptions};
use crate::clean::CleanOptions;
use crate::discovery::Catalogue;
use crate::error::Error;
use crate::fault::{FaultKind, unfit};
use crate::format::{Channel, Channels, SurfaceKind};
use crate::platform::give_back;
use crate::progress::Progress;
use crate::scene::paint_bytes;
use crate::source::{BurnedIn, Finding, OpenOptions, Subject, SubjectKind};
use crate::text::names::{MEMORY, MIN_SLICES, SCAN, THUMBNAILS_OF_ALL};
use crate::text::{Count, data};
use crate::volume::{Note, Overlap, SourceError, sentences};
pub(super) use claims::{Claim, Claims};
use key::{Key, options_fingerprint};
use lock::FolderLock;
pub(super) use lock::NewFolders;
use record::{Journal, Record};

/// Resident code beyond one stage of one job: other jobs are at other stages.
const BATCH_CODE: u64 = 1 << 20;

/// Memory for opening a small input and watching a job, for each job.
const JOB_OVERHEAD: u64 = 704 << 10;

/// Least useful memory of a job: a build of small slices.
const MIN_JOB: u64 = 1536 << 10;

/// Limit of the memory for opening a series of some 40,000 images. Larger ones are disregarded in the stated least
/// memory of a batch.
const USUAL_OPENING: u64 = 16 << 20;

/// Pages of a model that its thumbnail may hold. With fewer than the minimum, they would be evicted all the time.
const THUMBNAIL_PAGES: Range<u64> = 4 << 20..16 << 20;
/// Room for the painter's code, which no build runs.
const PAINTER_CODE: u64 = 1 << 20;

/// Inputs, outputs, options and resources of a batch.
#[derive(Clone, Debug)]
pub struct BatchRequest {
    /// Folders and files to search.
    pub inputs: Vec<PathBuf>,
    /// Folder of the results; made if it is missing.
    pub out: PathBuf,
    /// How volumes are read.
    pub how: OpenOptions,
    /// Reshaping and cleaning of each volume before it is built.
    pub clean: CleanOptions,
    /// True to build volumes that look like labels as labels, all of them, where no cleaning is asked for. False if a
    /// threshold was given.
    pub find_labels: bool,
    /// How models are built. Its memory is the whole process's cap, its threads are shared by the jobs.
    pub build: BuildOptions,
    /// Volumes worked on at a time.
    pub jobs: usize,
    /// Longest side of the thumbnails in pixels; 0 for none.
    pub thumbnails: u32,
    /// True to name files and folders in the contact sheet, too.
    pub keep_names: bool,
    /// True to make thumbnails also of images whose pixels may carry text, such as the name of the patient.
    pub thumbnails_of_all: bool,
    /// Volumes of fewer slices are left alone: scouts, scanned documents, single pictures.
    pub min_slices: u32,
    /// Grid of meshes and trees of solids.
    pub grid: GridOptions,
    /// Only DICOM series of these modalities (`CT`, `MR`, ...) are taken; all volumes if there are none.
    pub modalities: Vec<String>,
    /// Only volumes of these ids, or whose ids begin with one of these and a hyphen, are taken; all if there are none.
    pub series: Vec<String>,
}

impl BatchRequest {
    /// True for a volume of the modalities and series of the request.
    fn asks_for(&self, finding: &Finding) -> bool {
        let modality = || match &finding.subject {
            Ok(subject) => subject.volume().and_then(|volume| volume.modality()),
            // A refused volume still has its id.
            Err(_) if finding.format == "dicom" => finding.id.split('-').next(),
            Err(_) => None,
        };
        let of_modality = |wanted: &String| modality().is_some_and(|m| m.eq_ignore_ascii_case(wanted));
        let of_series = |wanted: &String| {
            let rest = finding.id.strip_prefix(wanted.as_str());
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
        };
        (self.modalities.is_empty() || self.modalities.iter().any(of_modality))
            && (self.series.is_empty() || self.series.iter().any(of_series))
    }
}

/// Watcher of a batch; called from several threads.
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
    let _new = NewFolders::create(&request.out).map_err(out_error)?;
    let lock = FolderLock::take(&request.out)?;
    sweep(&request.out);
    let scratch = request.build.scratch_folder(&request.out.join("x"));
    let skip = request.out.canonicalize().ok();
    let masks = request.find_labels.then(Overlap::default);
    let how = OpenOptions { skip, masks, meshes: true, ..request.how.clone() };
    let mut catalogue = Catalogue::survey(&request.inputs, &how, &scratch)?;
    watcher.found(catalogue.len() as u64);
    if catalogue.is_empty() {
        let path = request.inputs.first().cloned().unwrap_or_default();
        return Err(SourceError::from(
            unfit!("no volume was found below it; `{SCAN}` says what is there").at(path),
        )
        .into());
    }

    let cap = request.build.memory;
    let limit = cap.bytes();
    give_back();
    let budget = Budget::of_job(cap);
    // One series too large to be opened is refused alone.
    let openable = budget.left_bytes().saturating_sub(JOB_OVERHEAD + MIN_JOB) / 4 * 3;
    catalogue.allow_opening(openable);
    // Fewer jobs where the memory is not enough for all.
    let most_jobs = request.jobs.clamp(1, catalogue.len());
    let overhead = |openable, jobs| overhead_bytes(&catalogue, openable, jobs);
    let reserve = |jobs| Some((jobs, reserve_jobs(&budget, overhead(openable, jobs), jobs).ok()?));
    let Some((jobs, _watching)) = (1..=most_jobs).rev().find_map(reserve) else {
        let dry = Budget::dry(cap);
        drop(reserve_jobs(&dry, overhead(USUAL_OPENING, 1), 1));
        return Err(Error::Build(BuildError::from(BuildFault::BudgetTooSmall {
            name: data(&request.out),
            limit_bytes: limit,
            minimum_bytes: dry.smallest_limit(1),
        })));
    };
    let builds = budget.reserve_rest().into_budget();
    let with_all_jobs = Budget::dry(cap);
    let _all = with_all_jobs.reserve(overhead(openable, most_jobs));
    let run = Run {
        request,
        catalogue: &catalogue,
        watcher,
        share: builds.limit_bytes() / jobs as u64,
        builds,
        with_all_jobs,
        threads: (request.build.threads / jobs).max(1),
        options: options_fingerprint(request),
        key: Key::of(&request.out).map_err(out_error)?,
        journal: Journal::new(&scratch),
        opening: Mutex::default(),
        claims: Claims::default(),
        broken: Mutex::default(),
        counts: [const { AtomicU64::new(0) }; 3],
        burned_in: [const { AtomicU64::new(0) }; BurnedIn::ALL.len()],
    };
    let next = AtomicUsize::new(0);
    let convert = |slot| {
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            if at >= run.catalogue.len() || run.is_broken() {
                break;
            }
            run.convert_item(slot, at);
            run.watcher.advance();
        }
    };
    std::thread::scope(|scope| {
        let start = |slot| std::thread::Builder::new().spawn_scoped(scope, move || convert(slot));
        // Fewer jobs where the system refuses threads.
        if (0..jobs).filter(|slot| start(*slot).is_ok()).count() == 0 {
            convert(0);
        }
    });
    if let Some(error) = run.broken.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    let [converted, skipped, failed] = run.counts.map(AtomicU64::into_inner);
    let burned_in = told_of_text(&run.burned_in.map(AtomicU64::into_inner), request);
    let report = BatchReport {
        counts: Counts { converted, skipped, failed },
        left_out: catalogue.left_out().iter().map(LeftOutCount::from).collect(),
        left_out_files: LeftOutFile::first(&catalogue, MAX_NAMED)?,
        warnings: lock.warning.iter().cloned().chain(burned_in).chain(above_cap(cap)).collect(),
        memory_budget_bytes: limit,
        peak_rss_bytes: peak_rss_bytes(),
        jobs,
        wall_s: started.elapsed().as_secs_f64(),
        keep_names: request.keep_names,
        holds: Holdings::of(&request.out),
        program: concat!("infobyte ", env!("CARGO_PKG_VERSION")),
        options: request.into(),
    };
    earlier::take_over(&request.out, request.thumbnails_of_all, &run.journal).map_err(out_error)?;
    report.write(&request.out, &run.journal).map_err(out_error)?;
    drop(lock);
    Ok(report)
}

/// Most left-out files that reports name; some 100 KiB at a time.
const MAX_NAMED: usize = 1000;

/// Reserves `overhead` bytes for so many jobs, if enough is left for useful builds.
fn reserve_jobs(budget: &Budget, overhead: u64, jobs: usize) -> Result<Reservation, TooSmall> {
    let held = budget.reserve(overhead)?;
    drop(budget.reserve(MIN_JOB * jobs as u64)?);
    Ok(held)
}

/// Memory of so many jobs beyond their builds: code, opening and watching in each, and inputs that stay open.
fn overhead_bytes(catalogue: &Catalogue, openable: u64, jobs: usize) -> u64 {
    let code = if jobs > 1 { BATCH_CODE } else { 0 };
    code + JOB_OVERHEAD * jobs as u64 + opening_bytes(catalogue, openable, jobs)
}

/// Memory of the items that can be opened within `openable` bytes, beyond their builds: for the largest one while it is
/// opened, and for the remainders of the largest ones while they are worked on.
fn opening_bytes(catalogue: &Catalogue, openable: u64, jobs: usize) -> u64 {
    let mut largest = vec![0; jobs];
    for bytes in (0..catalogue.len()).map(|at| catalogue.opening_bytes(at)).filter(|bytes| *bytes <= openable)
    {
        if let Some(least) = largest.last_mut().filter(|least| bytes > **least) {
            *least = bytes;
            crate::order::by(&mut largest, |a, b| b.cmp(a));
        }
    }
    largest.first().copied().unwrap_or(0) + largest.iter().sum::<u64>() / 3
}

/// The warning of volumes whose pixels may carry text, from their counts.
fn told_of_text(counts: &[u64; BurnedIn::ALL.len()], request: &BatchRequest) -> Option<String> {
    let volumes: u64 = counts.iter().sum();
    let each = |(kind, count): (&BurnedIn, &u64)| {
        let why = match kind {
            BurnedIn::Stated => "Burned In Annotation is YES",
            BurnedIn::Ultrasound => "ultrasound",
            BurnedIn::SecondaryCapture => "secondary capture",
            BurnedIn::ScreenCapture => "picture of a screen",
        };
        (*count > 0).then(|| format!("{why}: {count}"))
    };
    let all: Vec<String> = BurnedIn::ALL.iter().zip(counts).filter_map(each).collect();
    let thumbnails = match (request.thumbnails, request.thumbnails_of_all) {
        (0, _) => String::new(),
        (_, true) => "; thumbnails were asked for".to_owned(),
        (_, false) => format!("; {THUMBNAILS_OF_ALL} makes thumbnails, which are left out"),
    };
    (volumes > 0).then(|| {
        format!(
            "the pixels of {} may carry text, such as the name of the patient ({}), and models may show it{thumbnails}",
            Count(volumes, "volume"),
            all.join(", ")
        )
    })
}

/// State that the workers of one batch share.
struct Run<'a> {
    request: &'a BatchRequest,
    catalogue: &'a Catalogue,
    watcher: &'a dyn Watcher,
    /// Memory of the builds of all jobs; each waits until its need is free.
    builds: Budget,
    /// Memory of all jobs asked for beyond their builds, without a limit: with more memory more jobs fit, each of which
    /// takes more beyond its build.
    with_all_jobs: Budget,
    /// Usual memory of a job.
    share: u64,
    threads: usize,
    options: String,
    key: Key,
    journal: Journal,
    /// Held while an item is opened that needs memory worth mentioning: one at a time.
    opening: Mutex<()>,
    /// Names of the volumes.
    claims: Claims,
    /// Error that ends the whole batch: the output folder fails.
    broken: Mutex<Option<Error>>,
    counts: [AtomicU64; 3],
    /// Volumes whose pixels may carry text, in the order of [`BurnedIn::ALL`].
    burned_in: [AtomicU64; BurnedIn::ALL.len()],
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
        // Items behind this one wait for its turn, even after a panic.
        let turn = self.claims.turn(at);
        let Ok(findings) = findings else {
            drop(turn);
            self.report((at, 0), slot, &Item::of_defect(at));
            return;
        };
        let parts = (0..).zip(findings);
        let named: Vec<_> = parts.map(|(part, finding)| self.name(&turn, finding, (at, part))).collect();
        drop(turn);
        for (part, (item, finding)) in named.into_iter().enumerate() {
            let item = match finding {
                Some(finding) => self.convert(slot, item, finding),
                None => item,
            };
            self.report((at, part), slot, &item);
        }
    }

    /// The item of a volume with its name, and the volume to build, unless that was done before. Without a volume the
    /// outcome is known already: too few slices, refused, or a copy of another.
    fn name(
        &self,
        turn: &claims::Turn<'_>,
        finding: Finding,
        place: claims::Place,
    ) -> (Item, Option<Finding>) {
        let mut item = Item {
            name: finding.id.clone(),
            input: data(&finding.path),
            format: finding.format.to_owned(),
            kind: finding.kind.clone(),
            part: finding.part.clone().unwrap_or_default(),
            files: finding.files.count,
            input_bytes: finding.files.bytes,
            burned_in: finding.burned_in,
            ..Item::default()
        };
        if !self.request.asks_for(&finding) {
            let reason = "is not of the modalities or series that were asked for";
            return (item.ended(Status::Skipped, Cause::NotAskedFor, reason), None);
        }
        if let Some(slices) = finding.size.map(|[_, _, n]| n).filter(|n| *n < self.request.min_slices) {
            let least = self.request.min_slices;
            let reason = format!("has {}, fewer than {MIN_SLICES} {least}", Count(slices, "slice"));
            return (item.ended(Status::Skipped, Cause::FewSlices, reason), None);
        }
        let notes: &[Note] = match &finding.subject {
            Ok(subject) => subject.volume().map_or(&[], |volume| &volume.info().notes),
            Err(e) => {
                // A model of an earlier state of the input would pass for this one's.
                if !turn.is_taken(&item.name)
                    && let Some(old) = Record::take(&self.request.out, &item.name)
                {
                    old.remove_files(&self.request.out, &item.name, None);
                }
                return (item.ended(Status::Failed, Cause::of(e.kind()), e.to_string()), None);
            }
        };
        item.warnings = sentences(notes);
        let is_copy = |finding: &Finding, owner| {
            let _turn = self.opening.lock().unwrap_or_else(PoisonError::into_inner);
            catch_unwind(AssertUnwindSafe(|| self.catalogue.is_copy(finding, owner))).unwrap_or(false)
        };
        match turn.claim(&finding, place, &is_copy) {
            Claim::CopyOf(name) => {
                let reason = copy_of(&name);
                return (item.ended(Status::Skipped, Cause::CopyOf(name), reason), None);
            }
            Claim::Own(name, number) => {
                item.name = name;
                item.warnings.extend(number.map(numbered));
            }
        }
        if let Some(kind) = finding.burned_in {
            self.burned_in[kind as usize].fetch_add(1, Ordering::Relaxed);
        }
        (item, Some(finding))
    }

    /// Counts, shows and notes the outcome of a volume.
    fn report(&self, order: (usize, usize), slot: usize, item: &Item) {
        let count = match item.status {
            Status::Converted => 0,
            Status::Skipped => 1,
            Status::Failed => 2,
            Status::Kept => return,
        };
        self.counts[count].fetch_add(1, Ordering::Relaxed);
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
    fn convert(&self, slot: usize, mut item: Item, finding: Finding) -> Item {
        let Ok(subject) = finding.subject else { return item };
        let inputs = self.key.hidden(finding.files.fingerprint);
        let thumbnails = self.thumbnails(&item);
        if let Some(done) = Record::read(&self.request.out, &item.name)
            && done.version == env!("CARGO_PKG_VERSION")
            && (&done.options, &done.inputs) == (&self.options, &inputs)
            && done.is_whole(&self.request.out)
            && !self.lacks_thumbnail(&done, thumbnails)
        {
            let preset = self.request.clean.preset;
            let volume = subject.volume();
            let doubt = preset.zip(volume).and_then(|(preset, volume)| preset.doubt(volume.modality()));
            item.warnings.extend(doubt.map(|doubt| doubt.to_string()));
            return self.skipped(done, item, thumbnails);
        }
        let progress = self.watcher.begin(slot, &item.name);
        // A record describes a whole model; until then there is none.
        let before = Record::take(&self.request.out, &item.name);
        // A defect that one volume triggers must not stop the others.
        let built = catch_unwind(AssertUnwindSafe(|| self.build(subject, &item.name, thumbnails, progress)));
        let built = built.unwrap_or(Err(Error::Internal));
        match built {
            Ok((facts, thumbnail_bytes, warnings)) => {
                item.status = Status::Converted;
                for warning in warnings {
                    if !item.warnings.contains(&warning) {
                        item.warnings.push(warning);
                    }
                }
                if let Some(before) = before {
                    before.remove_files(&self.request.out, &item.name, Some(&facts));
                }
                item.model = Some(facts);
                if let Some(record) = Record::of(&item, &self.options, &inputs, thumbnail_bytes)
                    && let Err(cause) = record.write(&self.request.out)
                {
                    let reason = format!("its record cannot be written ({cause})");
                    return item.ended(Status::Failed, Cause::Disk, reason);
                }
            }
            Err(e) => {
                item.cause = Some(match &e {
                    Error::Internal => Cause::Defect,
                    Error::Build(e) if e.is_empty() => Cause::Empty,
                    Error::Clean(e) if e.is_empty() => Cause::Empty,
                    e => Cause::of(e.kind()),
                });
                item.reason = Some(e.to_string());
                // An earlier model of the same input, with other options, is kept; a model of an input that has changed
                // would pass for this one's.
                match before {
                    Some(before)
                        if before.inputs == inputs && before.put_back(&self.request.out, &item.name) =>
                    {
                        item.warnings.push("the model that was built before is kept".into());
                    }
                    Some(before) => before.remove_files(&self.request.out, &item.name, None),
                    None => {}
                }
            }
        }
        item
    }

    /// Longest side of a volume's thumbnail; 0 for none.
    fn thumbnails(&self, item: &Item) -> u32 {
        let shown = self.request.thumbnails_of_all || item.burned_in.is_none();
        if shown { self.request.thumbnails } else { 0 }
    }

    /// Memory of a thumbnail of a model of so many bytes, and the pages of the model in it: as many as there is memory
    /// for, between limits.
    fn thumbnail_bytes(&self, model_bytes: u64) -> (u64, u64) {
        let side = self.request.thumbnails;
        let picture = paint_bytes(side, side, self.threads) + PAINTER_CODE;
        let room = self.builds.limit_bytes().saturating_sub(picture);
        let pages = model_bytes.min(room.clamp(THUMBNAIL_PAGES.start, THUMBNAIL_PAGES.end));
        (picture + pages, pages)
    }

    /// True if a model lacks the thumbnail that it should have, and there is memory for it now.
    fn lacks_thumbnail(&self, done: &Record, thumbnails: u32) -> bool {
        let needed = self.thumbnail_bytes(done.model.bytes).0;
        thumbnails > 0 && done.model.thumbnail.is_none() && needed <= self.builds.limit_bytes()
    }

    /// The item of a volume that was built before. A thumbnail that is not to be shown any more is removed.
    fn skipped(&self, mut done: Record, mut item: Item, thumbnails: u32) -> Item {
        if thumbnails == 0
            && let Some(file) = done.model.thumbnail.take()
        {
            // If this fails, the next run tries again.
            let _ = fs::remove_file(self.request.out.join(file)).and_then(|()| done.write(&self.request.out));
        }
        if thumbnails > 0 && done.model.thumbnail.is_none() {
            item.warnings.push(self.no_thumbnail(self.thumbnail_bytes(done.model.bytes).0));
        }
        Item { status: Status::Skipped, model: Some(done.model), ..item }
    }

    /// The warning of a thumbnail that lacks memory.
    fn no_thumbnail(&self, needed: u64) -> String {
        let enough = SizeArgument(self.with_all_jobs.smallest_limit_with(needed));
        format!("there is no memory for its thumbnail; {MEMORY} {enough} is enough")
    }

    /// Builds model and thumbnail of one volume within the memory that is granted.
    fn build(
        &self,
        subject: Subject,
        name: &str,
        thumbnails: u32,
        progress: &dyn Progress,
    ) -> Result<(ModelFacts, u64, Vec<String>), Error> {
        let started = Instant::now();
        let out = &self.request.out;
        let model = out.join(format!("{name}.oct"));
        let (built, memory_bytes, prepared) = self.build_granted(subject, &model, progress, started)?;
        let mut warnings = built.warnings;
        let mut thumbnail = None;
        let mut thumbnail_bytes = 0;
        if thumbnails > 0 {
            let (needed, pages) = self.thumbnail_bytes(built.report.file_bytes);
            if let Ok(_grant) = self.builds.wait_for(needed) {
                let file = format!("{name}.png");
                let size = (thumbnails, self.threads);
                thumbnail_within_pages(&model, &out.join(&file), size, pages)?;
                thumbnail_bytes = fs::metadata(out.join(&file)).map_or(0, |meta| meta.len());
                thumbnail = Some(file);
            } else {
                warnings.push(self.no_thumbnail(needed));
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
            selection: super::info::kind_name(r.selection.kind).to_owned(),
            skin_voxels: r.skin_voxels,
            label_count: built.info.frame.labels.len() as u64,
            nodes: r.nodes,
            bytes: r.file_bytes,
            wall_s: started.elapsed().as_secs_f64(),
            memory_bytes,
            memory_plan_bytes: r.plan_bytes,
            scratch_bytes: prepared + r.scratch_bytes,
        };
        Ok((facts, thumbnail_bytes, warnings))
    }

    /// [`Run::build`] with the memory that was granted, and the scratch space that unrolling the volume took.
    fn build_granted(
        &self,
        subject: Subject,
        model: &Path,
        progress: &dyn Progress,
        started: Instant,
    ) -> Result<(BuildSummary, u64, u64), Error> {
        let (options, clean) = (self.options_for(&subject), self.clean_for(&subject));
        let (mut grid, output) = (&self.request.grid, model);
        let own = GridOptions { grid: None, unit_mm: 1.0, ..*grid };
        let job = BuildJob { clean: &clean, grid, options: &options, output, progress };
        let mut subject = job.reshape(subject)?;
        let mut least = job.least_share(&subject);
        let prepared = subject.volume().map_or(0, |source| source.preparation().scratch_bytes);
        let name = match &subject {
            Subject::Volume(source) => source.info().description.name.clone(),
            Subject::Mesh(paths) => paths.first().map(|path| data(path)).unwrap_or_default(),
            Subject::Tree(path) => data(path),
        };
        let (options, note) = self.settle(&job, &mut subject, &name, least)?;
        let job = BuildJob { options: &options, ..job };
        least = job.least_share(&subject).max(least);
        loop {
            let again = match &subject {
                Subject::Volume(_) => None,
                Subject::Mesh(paths) => Some(Subject::Mesh(paths.clone())),
                Subject::Tree(path) => Some(Subject::Tree(path.clone())),
            };
            let grant = self.grant(&name, least)?;
            let granted = grant.bytes();
            let options = BuildOptions { memory: MemoryCap::Share(granted), ..options.clone() };
            let built = BuildJob { grid, options: &options, ..job }.build(subject, String::new(), started);
            drop(grant);
            match (built, again) {
                // The grid of the request is for subjects without a grid of their own.
                (Err(Error::Build(error)), Some(again)) if grid.grid.is_some() && has_own_grid(&error) => {
                    (grid, subject) = (&own, again);
                }
                // The memory of a mesh is known when it has been read, and of a tree when its leaves are placed.
                (Err(Error::Build(error)), Some(again)) if error.minimum_bytes() > Some(granted) => {
                    least = error.minimum_bytes().unwrap_or(least);
                    subject = again;
                }
                (built, _) => {
                    let mut built = built?;
                    built.warnings.extend(note.map(|note| note.to_string()));
                    return Ok((built, granted, prepared));
                }
            }
        }
    }

    /// The options that apply to a subject. Options of volumes are dropped for a mesh or a tree.
    fn options_for(&self, subject: &Subject) -> BuildOptions {
        let asked = BuildOptions {
            threads: self.threads,
            scratch: Some(self.request.build.scratch_folder(&self.request.out.join("x"))),
            ..self.request.build.clone()
        };
        let kind = subject.kind();
        if kind == SubjectKind::Volume {
            return asked;
        }
        let thin = kind == SubjectKind::Mesh && self.request.grid.is_thin();
        let surface = if thin { SurfaceKind::Skin } else { asked.volume_surface() };
        let foreign = match kind {
            SubjectKind::Mesh => &[Channel::Value, Channel::Offset][..],
            _ => &[Channel::Value, Channel::Offset, Channel::Color, Channel::Material],
        };
        let own = asked.channels().iter().filter(|channel| !foreign.contains(channel)).collect();
        let channels = (own != Channels::default()).then_some(own);
        let is_chosen = thin || asked.surface.is_some() || asked.channels.is_some() || asked.error.is_some();
        let error = asked.error.filter(|_| surface == SurfaceKind::Cells);
        BuildOptions { surface: is_chosen.then_some(surface), channels, error, ..asked }
    }

    /// The cleaning of a subject: as requested for a volume, none for others.
    fn clean_for(&self, subject: &Subject) -> CleanOptions {
        match subject.kind() {
            SubjectKind::Volume => self.request.clean.clone(),
            SubjectKind::Mesh | SubjectKind::Tree => CleanOptions::default(),
        }
    }

    /// Waits for memory for a build: a job's share, or `least` where that is more.
    fn grant(&self, name: &str, least: u64) -> Result<Reservation, Error> {
        let needed = least.max(self.share);
        self.builds.wait_for(needed.min(self.builds.limit_bytes()).max(least)).map_err(|_| {
            Error::Build(BuildError::from(BuildFault::BudgetTooSmall {
                name: name.to_owned(),
                limit_bytes: self.request.build.memory.bytes(),
                minimum_bytes: self.with_all_jobs.smallest_limit_with(least),
            }))
        })
    }
}

/// The reason of a copy.
pub(super) fn copy_of(name: &str) -> String {
    format!("is a copy of what {name} is made of, byte for byte")
}

/// The warning of a volume that has the number `n`, as others have its id.
pub(super) fn numbered(n: u32) -> String {
    format!(
        "this is number {n} of the volumes with this id, whose contents differ, in the order of their paths"
    )
}

/// True if a tree is refused only because a grid is chosen and the tree has the grid of a volume.
fn has_own_grid(error: &BuildError) -> bool {
    let BuildFault::Source(error) = error.fault() else { return false };
    error.has_kind(FaultKind::OwnGrid)
}

/// FNV-1a, 64 bits: stable over versions and machines; for telling things apart, not for safety.
pub(super) fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}
