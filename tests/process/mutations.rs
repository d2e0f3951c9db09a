//! Any bytes may come in: whatever is cut off or changed in a volume's file, opening and reading it ends in
//! time, without a panic, and without more memory than it was allowed.
//!
//! A few hundred changes of small files made here and of a few real ones, and with INFOBYTE_LONG=N so many times as
//! many; `INFOBYTE_MUTATE` names a folder whose files (those up to 2 MiB) are used instead.

use crate::prelude::*;
use infobyte::budget::current_rss_bytes;
use infobyte::source::Subject;

const CAP: u64 = 16 << 20;
const SLOWEST: Duration = Duration::from_secs(5);
const LARGEST: u64 = 2 << 20;

/// Finds, prepares and reads every volume of a file; true if anything could be read.
fn read_all(path: &Path, scratch: &Path) -> bool {
    let Ok(catalogue) = Catalogue::survey(&[path.to_path_buf()], &OpenOptions::default(), scratch) else {
        return false;
    };
    let mut any = false;
    for index in 0..catalogue.len() {
        for finding in catalogue.open(index) {
            let Ok(Subject::Volume(mut source)) = finding.subject else { continue };
            let workspace = Workspace { scratch, memory: Budget::new(CAP / 2), progress: &Silent };
            if source.prepare(&workspace).is_err() {
                continue;
            }
            let (dims, sample) = (source.info().dims, source.info().scalar.bytes());
            let rows = 0..dims.ny().min(3);
            let cols = 0..dims.nx().min(4096);
            let mut out = vec![0; rows.len() * cols.len() * sample];
            for z in [0, dims.nz() / 2, dims.nz() - 1] {
                any |= source.read_rows(z, rows.clone(), cols.clone(), &mut out).is_ok();
            }
        }
    }
    any
}

/// Runs one case and holds it to time and to silence; the case is named when it fails.
fn case(path: &Path, scratch: &Path, what: &str) {
    let started = Instant::now();
    let done = catch_unwind(AssertUnwindSafe(|| read_all(path, scratch)));
    assert!(done.is_ok(), "{}: panicked with {what}", path.display());
    assert!(started.elapsed() < SLOWEST, "{}: {:?} with {what}", path.display(), started.elapsed());
}

/// Cuts a copy of `original` at 200 places and changes `changes` single bytes of it, one at a time.
fn torment(original: &Path, changes: u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(original.file_name().unwrap());
    let bytes = fs::read(original).unwrap();
    let whole = bytes.len() as u64;
    fs::write(&path, &bytes).unwrap();
    // A header on its own leads nowhere; what it names lies beside it.
    if ["nhdr", "mhd", "hdr", "json", "toml"].iter().any(|end| path.extension().is_some_and(|e| e == *end)) {
        for entry in fs::read_dir(original.parent().unwrap()).unwrap() {
            let beside = entry.unwrap().path();
            let _ = symlink(&beside, folder.path().join(beside.file_name().unwrap()));
        }
    }
    let file = File::options().write(true).open(&path).unwrap();
    let mut random = Random(whole ^ 0x5eed);
    for n in 0..changes {
        // Heads hold what is believed; bodies hold what is decoded.
        let reach = [whole, 512.min(whole), 8192.min(whole), whole][usize::try_from(n % 4).unwrap()];
        let at = random.below(reach.max(1));
        let new = [random.below(256), 0xff, 0, 1 << random.below(8)][usize::try_from(n / 4 % 4).unwrap()];
        let new = u8::try_from(new).unwrap();
        file.write_all_at(&[new], at).unwrap();
        case(&path, folder.path(), &format!("byte {at} = {new}"));
        file.write_all_at(&bytes[usize::try_from(at).unwrap()..][..1], at).unwrap();
    }
    for n in (0..200).rev() {
        let length = if n < 50 { n * 8 } else { n * whole / 200 }.min(whole);
        file.set_len(length).unwrap();
        case(&path, folder.path(), &format!("{length} of {whole} bytes"));
        // Cut from long to short, so that no zeros come in.
        file.set_len(0).unwrap();
        file.write_all_at(&bytes, 0).unwrap();
    }
}

/// Files below a folder that are small enough to be changed many times.
fn small_files(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            small_files(&path, found);
        } else if fs::metadata(&path).unwrap().len() <= LARGEST {
            found.push(path);
        }
    }
}

#[test]
fn nothing_that_a_file_holds_makes_reading_panic_hang_or_swell() {
    let changes = 300 * u64::from(long());
    let made = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    if let Some(folder) = std::env::var_os("INFOBYTE_MUTATE") {
        small_files(Path::new(&folder), &mut files);
    } else {
        for (n, syntax) in dicom::Syntax::ALL.into_iter().enumerate() {
            let path = made.path().join(format!("{n}.dcm"));
            let image = dicom::Image { syntax, clutter: n == 1, meta: n != 0, ..dicom::Image::default() };
            fs::write(&path, image.bytes()).unwrap();
            files.push(path);
        }
        let path = made.path().join("mosaic.dcm");
        let mosaic =
            dicom::mosaic(5, [4, 3], "1\\0\\0\\0\\1\\0", &["0", "0", "1"], &|k, j, i| 100 * k + 10 * j + i);
        fs::write(&path, mosaic.bytes()).unwrap();
        files.push(path);
        for real in
            ["dicom-odd/jpegls-near-16.dcm", "multiframe/emri-10f-rle.dcm", "multiframe/emri-10f-jpegls.dcm"]
        {
            files.extend(data::real_data(real));
        }
    }
    let before = current_rss_bytes();
    for path in &files {
        torment(path, changes);
        let swollen = peak_rss_bytes().saturating_sub(before);
        assert!(swollen <= CAP, "{}: {swollen} bytes of memory", path.display());
        println!(
            "{}: {changes} changes and 200 cuts, {swollen} bytes of memory at most so far",
            path.display()
        );
    }
}
