//! Files of other kinds that lie beside the images of a patient do not carry the patient's name into names of
//! models, metadata and reports. If this fails, a shared model tells whom it shows.

use std::fs;

use infobyte::catalogue::Catalogue;
use infobyte::source::{Finding, OpenOptions};
use infobyte::volume::ScalarType;

#[path = "support/dicom.rs"]
mod dicom;
#[path = "support/formats.rs"]
mod formats;
#[path = "support/volume.rs"]
mod volume;

use dicom::Elements;
use formats::{Object, file, nifti, npy};

#[test]
fn a_segmentation_beside_a_series_is_masked_like_it() {
    let folder = tempfile::tempdir().unwrap();
    let patient = folder.path().join("Zimmermann_Anna");
    fs::create_dir(&patient).unwrap();
    for i in 0..3 {
        let image = Elements::ct(f64::from(i), i + 1, [1, 2, 3, 4]);
        let image = image.with(0x0010_0010, "PN", "Zimmermann^Anna").with(0x0010_0020, "LO", "P-4711");
        fs::write(patient.join(format!("{i}.dcm")), image.bytes()).unwrap();
    }
    let object = Object::new([4, 3, 2], ScalarType::I16, [1.0; 3]);
    file(&patient, "ZIMMERMANN_seg.nii", &nifti(&object, 1, false, true, 1));
    file(&patient, "mask-anna-4711.npy", &npy(&object, 1, false, false));
    file(&patient, "anna_broken.npy", b"\x93NUMPY\x01\x00");
    // Another folder, without images: whose they are is known from the others.
    let other = folder.path().join("other");
    let whole = [nifti(&object, 1, false, true, 1), object.ordered(false)].concat();
    file(&other, "Zimmermann_seg.nii", &whole);

    let inputs = [folder.path().to_path_buf()];
    let found = Catalogue::survey(&inputs, &OpenOptions::default(), folder.path()).unwrap();
    let findings: Vec<Finding> = (0..found.len()).flat_map(|i| found.open(i)).collect();
    assert_eq!(findings.len(), 5, "{findings:?}");
    let mut stems: Vec<&str> = Vec::new();
    for finding in findings.iter().filter(|f| f.path.starts_with(&patient)) {
        for word in ["Zimmermann", "Anna", "4711"] {
            assert!(finding.secrets.iter().any(|s| s == word), "{finding:?}: {word}");
            let lower = word.to_lowercase();
            assert!(!finding.stem.to_lowercase().contains(&lower), "{finding:?}");
            if let Ok(volume) = &finding.volume {
                let name = &volume.info().description.name;
                assert!(!name.to_lowercase().contains(&lower), "{name}");
            }
        }
        if finding.format != "dicom" {
            stems.push(&finding.stem);
        }
    }
    stems.sort_unstable();
    assert_eq!(stems, ["mask-x-x", "x_broken", "x_seg"]);
    let far = findings.iter().find(|f| f.path.starts_with(&other)).unwrap();
    assert_eq!((far.stem.as_str(), far.secrets.len()), ("x_seg", 0));
    let name = &far.volume.as_ref().unwrap().info().description.name;
    assert_eq!(name, "x_seg.nii");
}
