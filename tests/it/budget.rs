//! What a build allocates is what it has reserved: the heap of a whole build, counted allocation by allocation,
//! stays within its plan, and the smallest share that is stated works while one step less is refused with the
//! same number. If this fails, a buffer was made that the budget does not know of, and the cap is kept by luck.

use crate::prelude::*;
use infobyte::budget::{Bytes, ExactSize, costs};
use infobyte::builder::{build_volume as build, smallest_share};
use infobyte::discovery;

/// Half of the voxels inside, in no order: all of them skin, the most records there can be.
fn noise(dims: [u32; 3], scalar: ScalarType) -> MemoryVolume {
    let mut random = Random(11);
    let count = dims.iter().map(|n| *n as usize).product();
    let values: Vec<f64> = (0..count).map(|_| 20.0 + 80.0 * f64::from(random.below(2_u32) == 1)).collect();
    MemoryVolume::new(dims, scalar, &values)
}

fn options(threshold: Threshold, memory: MemoryCap) -> BuildOptions {
    BuildOptions {
        threshold,
        channels: Some(Channels::from([Channel::Normal, Channel::Value])),
        memory,
        // One thread works on the caller's, where everything is counted.
        threads: 1,
        ..skin_options()
    }
}

fn built(
    source: &dyn VolumeSource,
    threshold: Threshold,
    share: u64,
    output: &Path,
) -> (Result<BuildReport, BuildError>, u64) {
    let options = options(threshold, MemoryCap::Share(share));
    let (result, Taken { peak, .. }) = measured(|| build(source, &options, output, &Silent));
    (result, peak as u64)
}

#[test]
fn a_build_allocates_no_more_than_it_has_reserved() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("m.oct");
    for (dims, scalar) in [
        ([700, 66, 20], ScalarType::U8),
        ([65, 100, 70], ScalarType::U16),
        ([2500, 36, 8], ScalarType::F32),
        ([300, 60, 40], ScalarType::F64),
    ] {
        let source = noise(dims, scalar);
        for threshold in [Threshold::Iso(50.0), Threshold::Range(50.0, 150.0), Threshold::Otsu] {
            let kindest = smallest_share(&source, &options(threshold, MemoryCap::Share(0)));
            let mut models = Vec::new();
            for share in [0, kindest, kindest + (512 << 10), 64 << 20] {
                let name = format!("{dims:?} {scalar} {threshold:?} {share}");
                let (result, peak) = built(&source, threshold, share, &output);
                match result {
                    Ok(report) => {
                        println!("{name}: {peak} of {}", report.plan_bytes);
                        assert!(report.plan_bytes <= share, "{name}: plan {}", report.plan_bytes);
                        assert!(peak <= report.plan_bytes, "{name}: {peak} of {}", report.plan_bytes);
                        models.push(fs::read(&output).unwrap());
                    }
                    // A range that needs a wider ring than the kindest one.
                    Err(error) if error.minimum_bytes().is_some() => {
                        let minimum_bytes = error.minimum_bytes().unwrap();
                        assert!(minimum_bytes >= kindest && minimum_bytes > share, "{name}: {minimum_bytes}");
                        assert!(built(&source, threshold, minimum_bytes, &output).0.is_ok(), "{name}");
                    }
                    Err(e) => panic!("{name}: {e:?}"),
                }
            }
            assert!(!models.is_empty() && models.iter().all(|model| *model == models[0]));
        }
    }
}

#[test]
fn the_smallest_share_works_and_one_step_less_is_refused_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("m.oct");
    for (dims, scalar) in [([1, 1, 1], ScalarType::U8), ([90, 64, 40], ScalarType::I16)] {
        let mut source = noise(dims, scalar);
        source.bytes.fill(100);
        let threshold = Threshold::Iso(50.0);
        let smallest = smallest_share(&source, &options(threshold, MemoryCap::Share(0)));
        assert!(smallest.is_multiple_of(costs::STATED_STEP));
        assert!(built(&source, threshold, smallest, &output).0.is_ok());
        let less = built(&source, threshold, smallest - costs::STATED_STEP, &output).0;
        let refused = less.expect_err("one step less is not enough");
        assert_eq!(refused.minimum_bytes(), Some(smallest));
        let limit = format!("{} is too small", ExactSize(smallest - costs::STATED_STEP));
        assert!(refused.to_string().contains(&limit), "{refused}");
    }
}

#[test]
fn cleaning_allocates_no_more_than_it_has_reserved() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("m.oct");
    let source = noise([300, 90, 40], ScalarType::U16);
    let threshold = Threshold::Iso(50.0);
    for clean in [
        CleanOptions { close: 2, ..CleanOptions::default() },
        CleanOptions { fill_cavities: true, ..CleanOptions::default() },
        CleanOptions { keep_largest: Some(3), ..CleanOptions::default() },
        CleanOptions { drop_below: Some(SizeLimit::Voxels(2)), close: 1, ..CleanOptions::default() },
    ] {
        let smallest = clean.smallest_share(&source, &options(threshold, MemoryCap::Share(0)));
        for share in [smallest, smallest + (1 << 20), 64 << 20] {
            let options = options(threshold, MemoryCap::Share(share));
            let (cleaned, Taken { peak, .. }) =
                measured(|| clean.clean(&source, &options, &output, &Silent).unwrap().unwrap());
            println!("{:?} {share}: {peak}", clean.operations());
            assert!(peak as u64 <= share, "{:?}: {peak} of {share}", clean.operations());
            let options = BuildOptions { threshold: Threshold::Chosen(cleaned.selection), ..options };
            let (report, Taken { peak, .. }) =
                measured(|| build(cleaned.source(), &options, &output, &Silent).unwrap());
            assert!(peak as u64 <= report.plan_bytes, "{peak} of {}", report.plan_bytes);
        }
        let options = options(threshold, MemoryCap::Share(smallest - costs::STATED_STEP));
        match clean.clean(&source, &options, &output, &Silent) {
            Err(error) => assert_eq!(error.minimum_bytes(), Some(smallest), "{error}"),
            Ok(_) => panic!("{:?}: one step less is enough", clean.operations()),
        }
    }
}

/// What a reader states before it unrolls is what its decoders take.
#[test]
fn unrolling_allocates_no_more_than_is_stated_and_one_byte_less_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let object = Object::new([300, 200, 24], ScalarType::I16, [1.0; 3]);
    let whole = [formats::nifti(&object, 1, false, true, 1), object.bytes.clone()].concat();
    fs::write(at("v.nii.gz"), formats::gzip(&whole)).unwrap();
    fs::write(at("v.nrrd"), formats::nrrd(&object, "bzip2", false, "")).unwrap();
    for compression in [5, 8] {
        let how = Tiff { compression, ..Tiff::default() };
        fs::write(at(&format!("{compression}.tif")), how.write(&object)).unwrap();
    }
    formats::pngs(&object, &at("png"));
    for name in ["v.nii.gz", "v.nrrd", "5.tif", "8.tif", "png"] {
        let mut source = discovery::open_unprepared(&[at(name)], &OpenOptions::default()).unwrap();
        let needed = source.preparation().memory_bytes;
        assert!(needed > 0, "{name} is read in place");
        let workspace =
            |bytes| Workspace { scratch: folder.path(), memory: Budget::new(bytes), progress: &Silent };
        let refused = source.prepare(&workspace(needed - 1)).expect_err("one byte less is not enough");
        assert_eq!(refused.minimum_bytes(), Some(needed), "{name}");
        let allowed = format!("leaves only {}", Bytes(needed - 1));
        assert!(refused.to_string().contains(&allowed), "{name}: {refused}");
        let (done, Taken { peak, .. }) = measured(|| source.prepare(&workspace(needed)));
        done.unwrap();
        println!("{name}: {peak} of {needed}");
        assert!(peak as u64 <= needed, "{name}: {peak} of {needed}");
    }
}
