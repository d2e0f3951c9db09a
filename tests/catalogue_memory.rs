//! A catalogue of many files is held in little memory: it grows with the number of series, by some tens of
//! bytes, and not with the number of files. If this fails, a disk full of studies breaks the memory cap.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fs;

use infobyte::source::{Catalogue, OpenOptions};

#[path = "support/dicom.rs"]
mod dicom;
use dicom::Elements;

/// Counts what the current thread allocates.
struct Counting;

thread_local! {
    /// Bytes live now, and the most that were.
    static LIVE: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system allocator unchanged; the counters are thread-local
// and need no allocation themselves.
#[expect(unsafe_code, reason = "a counting allocator cannot be written without; tests only")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = LIVE.try_with(|n| {
            n.set(n.get() + layout.size().cast_signed());
            let _ = PEAK.try_with(|peak| peak.set(peak.get().max(n.get())));
        });
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        let _ = LIVE.try_with(|n| n.set(n.get() - layout.size().cast_signed()));
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn twenty_thousand_files_of_two_hundred_series_take_a_few_hundred_kilobytes() {
    const SERIES: usize = 200;
    const IMAGES: usize = 100;
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("a-folder-with-a-rather-long-name-as-archives-like-to-have-them");
    fs::create_dir(&inner).unwrap();
    for i in 0..IMAGES {
        let instance = i32::try_from(i).unwrap();
        let mut image = Elements::ct(f64::from(instance), instance, [1, 2, 3, 4]);
        for s in 0..SERIES {
            // All of them in one folder, the series interleaved.
            let bytes = image.set(0x0020_000e, "UI", &format!("1.2.840.{s}")).bytes();
            fs::write(inner.join(format!("1.2.840.113619.2.55.3.604688119.969.{i}.{s}.dcm")), bytes).unwrap();
        }
    }
    let inputs = [folder.path().to_path_buf()];
    let before = LIVE.get();
    PEAK.set(before);
    let found = Catalogue::survey(&inputs, &OpenOptions::default(), folder.path()).unwrap();
    let (held, peak) = (LIVE.get() - before, PEAK.get() - before);
    println!("{} series of {} files: {held} bytes held, {peak} at most", found.len(), SERIES * IMAGES);
    assert_eq!((found.len(), found.left_out().len()), (SERIES, 0));
    assert!(peak < 400 << 10, "{peak} bytes while searching");
    assert!(held < 180 << 10, "{held} bytes held");
    PEAK.set(LIVE.get());
    let before = LIVE.get();
    for index in [0, SERIES / 2, SERIES - 1] {
        let findings = found.open(index);
        let volume = findings[0].volume.as_ref().unwrap();
        assert_eq!((findings.len(), volume.info().dims.nz(), findings[0].files.count), (1, 100, 100));
    }
    let peak = PEAK.get() - before;
    println!("one series open: {peak} bytes at most");
    assert!(peak < 200 << 10, "{peak} bytes for a series of {IMAGES} images");
}
