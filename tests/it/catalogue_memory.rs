//! A catalogue of many files is held in little memory: it grows with the number of series, by some tens of
//! bytes, and not with the number of files. If this fails, a disk full of studies breaks the memory cap.

use crate::prelude::*;

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
    let survey = || Catalogue::survey(&inputs, &OpenOptions::default(), folder.path()).unwrap();
    let (found, Taken { held, peak, .. }) = measured(survey);
    println!("{} series of {} files: {held} bytes held, {peak} at most", found.len(), SERIES * IMAGES);
    assert_eq!((found.len(), found.left_out().len()), (SERIES, 0));
    assert!(peak < 400 << 10, "{peak} bytes while searching");
    assert!(held < 180 << 10, "{held} bytes held");
    let ((), Taken { peak, .. }) = measured(|| {
        for index in [0, SERIES / 2, SERIES - 1] {
            let findings = found.open(index);
            let volume = findings[0].subject.as_ref().unwrap().volume().unwrap();
            assert_eq!((findings.len(), volume.info().dims.nz(), findings[0].files.count), (1, 100, 100));
        }
    });
    println!("one series open: {peak} bytes at most");
    assert!(peak < 200 << 10, "{peak} bytes for a series of {IMAGES} images");
}
