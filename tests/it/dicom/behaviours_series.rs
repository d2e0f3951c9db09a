//! What users expect of the assembly of series, one test for each behaviour: what is found, what is one
//! volume, in which order, with which spacing, and what happens where slices are missing, doubled or
//! damaged. If one fails, a volume gets the wrong geometry or is lost without a word.

use crate::prelude::*;
use infobyte::discovery::open_unprepared as open;

const IMAGE_TYPE: u32 = 0x0008_0008;
const ACQUISITION: u32 = 0x0020_0012;
const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;

/// A folder of its own.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn of(images: &[Elements]) -> Self {
        let folder = Self::new();
        for (i, image) in images.iter().enumerate() {
            folder.put(&format!("{}.dcm", i + 1), &image.bytes());
        }
        folder
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        let path = self.0.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn survey(&self, options: &OpenOptions) -> (Catalogue, Vec<Finding>) {
        let scratch = tempfile::tempdir().unwrap();
        let found = Catalogue::survey(&[self.path().to_path_buf()], options, scratch.path()).unwrap();
        let findings = (0..found.len()).flat_map(|i| found.open(i)).collect();
        (found, findings)
    }

    fn findings(&self) -> Vec<Finding> {
        self.survey(&OpenOptions::default()).1
    }

    fn open(&self, gaps: GapPolicy) -> Result<Box<dyn VolumeSource>, SourceError> {
        open(&[self.path().to_path_buf()], &OpenOptions { gaps, ..OpenOptions::default() })
    }
}

fn ct(z: f64, instance: i32) -> Elements {
    let value = u16::try_from(instance).unwrap() * 10;
    Elements::ct(z, instance, [value, value + 1, value + 2, value + 3])
}

fn warnings(source: &dyn VolumeSource) -> String {
    sentences(&source.info().notes).join("\n")
}

fn parts(findings: &[Finding]) -> Vec<(&str, [u32; 3], bool)> {
    findings
        .iter()
        .map(|f| (f.part.as_deref().unwrap_or_default(), f.size.unwrap_or_default(), f.subject.is_ok()))
        .collect()
}

#[test]
fn behaviour_01_dicom_is_found_by_content_and_others_are_summed_up() {
    let folder = Folder::new();
    for (name, z) in [("a", 0.0), ("sub/b.txt", 1.0), ("sub/deep/er/c.jpg", 2.0)] {
        folder.put(name, &ct(z, 1).bytes());
    }
    folder.put(".hidden", &ct(3.0, 1).bytes());
    for n in 0..3 {
        let mut report = ct(0.0, 1);
        report.without(0x7fe0_0010).without(0x0028_0010).without(0x0028_0011);
        report.set(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.88.11");
        folder.put(&format!("sr{n}"), &report.bytes());
        folder.put(&format!("sub/note{n}.txt"), b"no image at all");
    }
    let directory = ct(0.0, 1).with(0x0008_0016, "UI", "1.2.840.10008.1.3.10").without(0x7fe0_0010).clone();
    let directory = directory.clone().without(0x0028_0010).without(0x0028_0011).bytes();
    folder.put("DICOMDIR", &directory);
    folder.put("empty", b"");
    symlink(folder.path(), folder.path().join("sub/circle")).unwrap();
    let (found, findings) = folder.survey(&OpenOptions::default());
    assert_eq!(parts(&findings), [("", [2, 2, 3], true)]);
    let left: Vec<(String, u64)> = found.left_out().iter().map(|l| (l.why.to_string(), l.count)).collect();
    assert_eq!(
        left,
        [
            ("structured report without pixels".to_owned(), 3),
            ("not a volume".to_owned(), 3),
            ("DICOMDIR without pixels".to_owned(), 1),
            ("empty file".to_owned(), 1),
            ("folder that a link leads to, which is searched with follow_links only".to_owned(), 1),
        ]
    );
    assert!(found.left_out()[1].first.ends_with("sub/note0.txt"));
}

#[test]
fn behaviour_02_series_are_split_by_uid_orientation_and_tags_of_repeated_positions() {
    let mut images: Vec<Elements> = (0..3).map(|i| ct(f64::from(i), i)).collect();
    images.extend((0..2).map(|i| ct(f64::from(i), i).with(0x0020_000e, "UI", "1.2.9")));
    let coronal = |i| {
        let mut image = ct(0.0, 10 + i);
        image.set(ORIENTATION, "DS", "1\\0\\0\\0\\0\\-1").set(POSITION, "DS", &format!("0\\{i}\\0"));
        image.set(0x0008_0018, "UI", &format!("9.9.{i}"));
        image
    };
    images.extend((0..4).map(coronal));
    let folder = Folder::of(&images);
    let findings = folder.findings();
    assert_eq!(
        parts(&findings),
        [("axial", [2, 2, 3], true), ("coronal", [2, 2, 4], true), ("", [2, 2, 2], true)]
    );
    let said = warnings(findings[0].subject.as_ref().unwrap().volume().unwrap());
    assert!(said.contains("2 volumes, told apart by Image Orientation (0020,0037)"), "{said}");
    // Acquisitions split only where positions repeat: each slice of a step-and-shoot CT is one.
    let stepped: Vec<Elements> =
        (0..4).map(|i| ct(f64::from(i), i).with(ACQUISITION, "IS", &i.to_string())).collect();
    assert_eq!(parts(&Folder::of(&stepped).findings()), [("", [2, 2, 4], true)]);
    let twice: Vec<Elements> =
        (0..6).map(|i| ct(f64::from(i % 3), i).with(ACQUISITION, "IS", &(i / 3 + 4).to_string())).collect();
    assert_eq!(
        parts(&Folder::of(&twice).findings()),
        [("acquisition 4", [2, 2, 3], true), ("acquisition 5", [2, 2, 3], true)]
    );
}

#[test]
fn behaviour_03_what_differs_is_not_stacked_and_the_tag_is_named() {
    for (tag, vr, values, labels, words) in [
        (0x0018_0086, "IS", ["1", "2"], ["echo 1", "echo 2"], "Echo Number"),
        (0x0018_0081, "DS", ["4.9", "7.38"], ["TE 4.9", "TE 7.38"], "Echo Time"),
        (0x0020_0100, "IS", ["1", "2"], ["time 1", "time 2"], "Temporal Position"),
        (0x0018_1060, "DS", ["0", "350"], ["trigger 0", "trigger 350"], "Trigger Time"),
        (0x0018_0082, "DS", ["900", "2500"], ["TI 900", "TI 2500"], "Inversion Time"),
        (0x0018_1314, "DS", ["5", "26"], ["flip 5", "flip 26"], "Flip Angle"),
    ] {
        let images: Vec<Elements> = (0..8)
            .map(|i| ct(f64::from(i / 2), i).with(tag, vr, values[usize::try_from(i % 2).unwrap()]))
            .collect();
        let folder = Folder::of(&images);
        let findings = folder.findings();
        assert_eq!(parts(&findings), [(labels[0], [2, 2, 4], true), (labels[1], [2, 2, 4], true)]);
        assert_eq!(
            firsts(findings[1].subject.as_ref().unwrap().volume().unwrap()),
            [10, 30, 50, 70],
            "{words}"
        );
        assert!(warnings(findings[0].subject.as_ref().unwrap().volume().unwrap()).contains(words));
        assert_ne!(findings[0].id, findings[1].id);
    }
    // Magnitude and phase in two echoes: split twice.
    let images: Vec<Elements> = (0..12)
        .map(|i| {
            let mut image = ct(f64::from(i / 4), i);
            image.set(
                IMAGE_TYPE,
                "CS",
                if i % 2 == 0 { "ORIGINAL\\PRIMARY\\M" } else { "ORIGINAL\\PRIMARY\\P" },
            );
            image.set(0x0018_0086, "IS", &(i / 2 % 2 + 1).to_string());
            image
        })
        .collect();
    let folder = Folder::of(&images);
    let findings = folder.findings();
    let labels: Vec<&str> = findings.iter().map(|f| f.part.as_deref().unwrap()).collect();
    assert_eq!(labels, ["magnitude echo 1", "magnitude echo 2", "phase echo 1", "phase echo 2"]);
    assert!(findings[3].id.ends_with("-phaseecho2"), "{}", findings[3].id);
    // Another size never joins.
    let mut wide = ct(1.0, 5);
    wide.us(0x0028_0010, 1);
    wide.us(0x0028_0011, 4);
    let folder = Folder::of(&[ct(0.0, 1), ct(1.0, 2), ct(2.0, 3), wide]);
    let findings = folder.findings();
    assert_eq!(parts(&findings), [("2x2", [2, 2, 3], true), ("4x1", [4, 1, 1], true)]);
}

#[test]
fn behaviour_03_phases_without_any_tag_are_told_apart_by_their_turn() {
    let images: Vec<Elements> = (0..6).map(|i| ct(f64::from(i % 3), i)).collect();
    let folder = Folder::of(&images);
    let findings = folder.findings();
    assert_eq!(parts(&findings), [("set 1 of 2", [2, 2, 3], true), ("set 2 of 2", [2, 2, 3], true)]);
    assert_eq!(firsts(findings[1].subject.as_ref().unwrap().volume().unwrap()), [30, 40, 50]);
    // One position more often than the others: nothing is guessed.
    let folder = Folder::of(&images[..5]);
    let findings = folder.findings();
    let error = findings[0].subject.as_ref().unwrap_err().to_string();
    assert!(findings.len() == 1 && error.contains("2 of 5 images repeat the position"), "{error}");
}

#[test]
fn behaviour_04_localizers_and_derived_images_are_split_off() {
    let mut images: Vec<Elements> = (0..3).map(|i| ct(f64::from(i), i + 2)).collect();
    images.push(ct(50.0, 1).with(IMAGE_TYPE, "CS", "ORIGINAL\\PRIMARY\\LOCALIZER"));
    images.push(ct(1.5, 9).with(IMAGE_TYPE, "CS", "DERIVED\\SECONDARY\\MIP"));
    let folder = Folder::of(&images);
    let findings = folder.findings();
    assert_eq!(
        parts(&findings),
        [("localizer", [2, 2, 1], true), ("", [2, 2, 3], true), ("derived", [2, 2, 1], true)]
    );
    let chosen = folder.open(GapPolicy::Error).unwrap();
    assert!(chosen.info().dims.nz() == 3 && warnings(chosen.as_ref()).contains("3 sets of images"));
}

#[test]
fn behaviour_05_order_by_position() {
    // Instance numbers and names say otherwise.
    let folder = Folder::of(&[ct(4.0, 1), ct(0.0, 2), ct(6.0, 3), ct(2.0, 4)]);
    let source = folder.open(GapPolicy::Error).unwrap();
    assert_eq!(firsts(source.as_ref()), [20, 40, 10, 30]);
    assert!(warnings(source.as_ref()).contains("instance numbers do not follow the positions"));
    let sorted = Folder::of(&[ct(4.0, 1), ct(2.0, 2), ct(0.0, 3)]);
    let source = sorted.open(GapPolicy::Error).unwrap();
    assert_eq!((firsts(source.as_ref()), warnings(source.as_ref())), (vec![30, 20, 10], String::new()));
}

#[test]
fn behaviour_06_spacing_comes_from_positions_not_thickness() {
    // The writer states a thickness of 2.5 mm.
    let folder = Folder::of(&[ct(-3.0, 1), ct(0.0, 2), ct(3.0, 3), ct(6.0, 4)]);
    let source = folder.open(GapPolicy::Error).unwrap();
    assert_eq!(source.info().spacing_mm, [0.5, 0.75, 3.0]);
    assert_eq!(source.info().affine.origin(), [0.0, 0.0, -3.0]);
}

#[test]
fn behaviour_07_small_unevenness_is_one_warning_with_the_deviation() {
    let at = |zs: &[f64]| {
        let images: Vec<Elements> = zs.iter().zip(1..).map(|(z, i)| ct(*z, i)).collect();
        Folder::of(&images).open(GapPolicy::Error)
    };
    assert_eq!(warnings(at(&[0.0, 5.0, 10.0004, 15.0]).unwrap().as_ref()), "");
    let source = at(&[0.0, 5.0, 10.1, 15.0]).unwrap();
    assert_eq!(source.info().notes.len(), 1);
    let said = warnings(source.as_ref());
    assert!(said.contains("up to 2.00 %") && said.contains("0.100 mm"), "{said}");
    // Relative: the same 0.1 mm is too much of half a millimetre.
    assert!(at(&[0.0, 0.5, 1.1, 1.5]).unwrap_err().to_string().contains("unevenly spaced"));
}

#[test]
fn behaviour_08_missing_slices_are_refused_filled_or_kept() {
    let folder = Folder::of(&[ct(0.0, 1), ct(2.0, 2), ct(8.0, 5), ct(10.0, 6)]);
    let error = folder.open(GapPolicy::Error).unwrap_err().to_string();
    assert!(
        error.contains("probably missing: 2 slices in 1 place, first between 2.dcm and 3.dcm")
            && error.contains("choose gaps fill or gaps keep"),
        "{error}"
    );
    let filled = folder.open(GapPolicy::Fill).unwrap();
    assert_eq!((filled.info().dims.nz(), filled.info().spacing_mm[2]), (6, 2.0));
    assert_eq!(firsts(filled.as_ref()), [10, 20, 30, 40, 50, 60]);
    assert!(warnings(filled.as_ref()).contains("2 of 6 were made by interpolation"));
    // Any block of a made slice is the same as that part of the whole.
    let mut whole = [0; 8];
    filled.read_rows(3, 0..2, 0..2, &mut whole).unwrap();
    let mut block = [0; 4];
    filled.read_rows(3, 0..2, 1..2, &mut block).unwrap();
    assert_eq!(block, [whole[2], whole[3], whole[6], whole[7]]);
    let kept = folder.open(GapPolicy::Keep).unwrap();
    assert_eq!(kept.info().dims.nz(), 4);
    assert!((kept.info().spacing_mm[2] - 10.0 / 3.0).abs() < 1e-12);
    assert!(warnings(kept.as_ref()).contains("1.333 mm off"), "{}", warnings(kept.as_ref()));
}

#[test]
fn behaviour_09_copies_are_dropped_and_counted_other_repeats_are_not() {
    let three = [ct(0.0, 1), ct(2.0, 2), ct(4.0, 3)];
    // The same instance under another name.
    let folder = Folder::of(&three);
    folder.put("again/copy.dcm", &three[1].bytes());
    let source = folder.open(GapPolicy::Error).unwrap();
    assert!(
        source.info().dims.nz() == 3
            && warnings(source.as_ref()).contains("1 image left out for being in the series twice")
    );
    assert!(!warnings(source.as_ref()).contains("different pixels"));
    // The same instance with other pixels: one of them is used, and both are named.
    let folder = Folder::of(&three);
    folder.put("again/copy.dcm", &Elements::ct(2.0, 2, [9; 4]).bytes());
    let said = warnings(folder.open(GapPolicy::Error).unwrap().as_ref());
    assert!(
        said.contains("2.dcm and again/copy.dcm have one SOP Instance UID")
            && said.contains("different pixels"),
        "{said}"
    );
    // Exported again with a new UID: the same numbers and the same pixels.
    let folder = Folder::of(&three);
    folder.put("new-uid.dcm", &three[1].with(0x0008_0018, "UI", "7.7.7").bytes());
    assert!(warnings(folder.open(GapPolicy::Error).unwrap().as_ref()).contains("1 image left out"));
    // Other pixels at one position are not copy, and nothing tells which is meant.
    let folder = Folder::of(&three);
    folder.put("other.dcm", &Elements::ct(2.0, 2, [9; 4]).with(0x0008_0018, "UI", "7.7.7").bytes());
    let error = folder.open(GapPolicy::Error).unwrap_err().to_string();
    assert!(error.contains("1 of 4 images repeat the position of another"), "{error}");
    // One UID for every image (bad anonymisers do that) makes no copies.
    let one_uid: Vec<Elements> = three.iter().map(|i| i.with(0x0008_0018, "UI", "5.5")).collect();
    assert_eq!(parts(&Folder::of(&one_uid).findings()), [("", [2, 2, 3], true)]);
    // All at one position: no volume.
    let error =
        Folder::of(&[ct(1.0, 1), ct(1.0, 2), ct(1.0, 3)]).open(GapPolicy::Keep).unwrap_err().to_string();
    assert!(error.contains("all 3 images are at one position"), "{error}");
}

#[test]
fn behaviour_10_tilt_is_kept_in_the_affine() {
    let tilted = |i: i32| {
        let mut image = ct(f64::from(i), i);
        image.set(POSITION, "DS", &format!("0\\{}\\{}", f64::from(i) * 0.5, f64::from(i) * 2.0));
        image
    };
    let images: Vec<Elements> = [0, 1, 2, 4].map(tilted).into();
    let folder = Folder::of(&images);
    let source = folder.open(GapPolicy::Fill).unwrap();
    let affine = source.info().affine;
    assert_eq!(source.info().dims.nz(), 5);
    for (corner, expected) in [
        ([0.0, 0.0, 4.0], [0.0, 2.0, 8.0]),
        ([1.0, 1.0, 0.0], [0.5, 0.75, 0.0]),
        ([1.0, 0.0, 3.0], [0.5, 1.5, 6.0]),
    ] {
        let got = affine.apply(corner);
        assert!(got.iter().zip(expected).all(|(g, e)| (g - e).abs() < 1e-9), "{corner:?}: {got:?}");
    }
    assert!(warnings(source.as_ref()).contains("14.04 degrees off their normal"));
}

#[test]
fn behaviour_11_rescale_of_each_slice_holds_for_made_slices_too() {
    let mut images = [ct(0.0, 1), ct(1.0, 2), ct(3.0, 4)];
    images[2].set(0x0028_1053, "DS", "0.5");
    let folder = Folder::of(&images);
    let source = folder.open(GapPolicy::Fill).unwrap();
    assert_eq!(source.info().scalar, ScalarType::F32);
    let mut out = [0; 4];
    source.read_rows(2, 0..1, 0..1, &mut out).unwrap();
    // Between 20 - 1024 and 0.5 * 40 - 1024.
    assert_eq!(f32::from_le_bytes(out), -1004.0);
}

#[test]
fn behaviour_18_siemens_mosaics_are_split_into_slices() {
    let mosaic = dicom::mosaic(3, [2, 2], "1\\0\\0\\0\\1\\0", &["0", "0", "1"], &|k, _, _| 10 * (k + 1));
    let folder = Folder::of(std::slice::from_ref(&mosaic));
    let source = folder.open(GapPolicy::Error).unwrap();
    assert_eq!(source.info().dims.to_array(), [2, 2, 3]);
    assert_eq!(firsts(source.as_ref()), [10, 20, 30]);
    // Without the private elements nobody can know how many slices there are.
    let bare = mosaic.clone().without(0x0019_100a).without(0x0029_1010).clone();
    let error = Folder::of(&[bare]).open(GapPolicy::Error).unwrap_err().to_string();
    assert!(error.contains("a Siemens mosaic does not state the number of its slices"), "{error}");
}

#[test]
fn behaviour_19_names_and_folders_do_not_change_the_result() {
    let mut images: Vec<Elements> = (0..5).map(|i| ct(f64::from(i) * 2.0 - 3.0, i)).collect();
    images.extend((0..5).map(|i| ct(f64::from(i) * 2.0 - 3.0, i + 5).with(0x0018_0086, "IS", "2")));
    let of = |name: &dyn Fn(usize) -> String, order: &mut dyn Iterator<Item = usize>| {
        let folder = Folder::new();
        for i in order {
            folder.put(&name(i), &images[i].bytes());
        }
        let describe = |f: Finding| {
            let volume = f.subject.unwrap().into_volume().unwrap();
            let info = volume.info();
            (
                f.id,
                f.part,
                f.files.bytes,
                firsts(volume.as_ref()),
                format!("{:?} {:?}", info.affine, info.notes),
            )
        };
        folder.findings().into_iter().map(describe).collect::<Vec<_>>()
    };
    let plain = of(&|i| format!("{i:03}"), &mut (0..10));
    assert_eq!(plain.len(), 2);
    assert_eq!(plain[0].3, [0, 10, 20, 30, 40]);
    assert!(plain[0].0.starts_with("ct-007-") && plain[0].0.ends_with("-noecho"), "{}", plain[0].0);
    assert_eq!(of(&|i| format!("{}/{}", i % 3, 9 - i), &mut (0..10).rev()), plain);
    assert_eq!(of(&|i| format!("x{}", i * 7 % 10), &mut [3, 1, 4, 0, 9, 2, 6, 8, 5, 7].into_iter()), plain);
}

#[test]
fn behaviour_20_images_without_positions_are_ordered_by_number_with_a_warning() {
    let bare = |i| {
        let mut image = ct(f64::from(i), i);
        image.without(POSITION).without(ORIENTATION).without(0x0028_0030).without(0x0018_0050);
        image
    };
    let folder = Folder::of(&[bare(3), bare(1), bare(2)]);
    let source = folder.open(GapPolicy::Error).unwrap();
    assert_eq!((firsts(source.as_ref()), source.info().spacing_mm), (vec![10, 20, 30], [1.0; 3]));
    let said = warnings(source.as_ref());
    assert!(said.contains("state no positions") && said.contains("no pixel spacing"), "{said}");
}

#[test]
fn behaviour_22_a_bad_file_stops_nothing_else_and_is_named() {
    let folder = Folder::of(&[ct(0.0, 1), ct(1.0, 2)]);
    let other = |z: f64| ct(z, 4).with(0x0020_000e, "UI", "1.2.9");
    folder.put("x/1.dcm", &other(0.0).bytes());
    let mut cut = other(1.0).bytes();
    cut.truncate(cut.len() - 3);
    folder.put("x/cut.dcm", &cut);
    folder.put("x/damaged.dcm", &ct(0.0, 1).bytes()[..300]);
    let findings = folder.findings();
    let errors: Vec<String> =
        findings.iter().filter_map(|f| f.subject.as_ref().err()).map(ToString::to_string).collect();
    assert_eq!((findings.len(), errors.len()), (3, 2), "{errors:?}");
    assert!(errors[0].contains("x/cut.dcm: the pixels are cut short: 5 bytes of 8"), "{errors:?}");
    assert!(errors[1].contains("x/damaged.dcm: is a damaged DICOM file"), "{errors:?}");
    assert!(findings[0].subject.is_ok());
}

#[test]
fn behaviour_23_names_hold_no_patient_and_no_folder() {
    let folder = Folder::of(&[]);
    for z in 0..2 {
        folder.put(&format!("Nobody^Real/ID-4711/{z}"), &ct(f64::from(z), z).bytes());
    }
    let findings = folder.findings();
    let finding = &findings[0];
    let info = finding.subject.as_ref().unwrap().volume().unwrap().info();
    assert_eq!(info.description.to_string(), "CT image, series 7");
    assert!(finding.id.starts_with("ct-007-") && finding.id.len() == 15, "{}", finding.id);
    let all = format!("{:?} {} {:?}", info, finding.id, finding.part);
    for secret in ["Nobody", "Real", "4711"] {
        assert!(!all.contains(secret), "{secret} is in {all}");
    }
}

#[test]
fn volumes_can_be_chosen_by_their_number() {
    let mut images: Vec<Elements> = (0..3).map(|i| ct(f64::from(i), i)).collect();
    images.extend((0..2).map(|i| ct(f64::from(i), i).with(0x0020_000e, "UI", "1.2.9")));
    let folder = Folder::of(&images);
    let of = |volume| {
        let options = OpenOptions { volume: Some(volume), ..OpenOptions::default() };
        open(&[folder.path().to_path_buf()], &options)
    };
    assert_eq!((of(1).unwrap().info().dims.nz(), of(2).unwrap().info().dims.nz()), (3, 2));
    let error = of(3).unwrap_err().to_string();
    assert!(error.contains("no volume 3 among the 2"), "{error}");
}

#[test]
fn inputs_that_repeat_or_contain_each_other_are_searched_once() {
    let folder = Folder::new();
    folder.put("a/1", &ct(0.0, 1).bytes());
    folder.put("a/2", &ct(1.0, 2).bytes());
    let inputs: Vec<PathBuf> = ["", "a", "a/1", ""].map(|n| folder.path().join(n)).into();
    let found = Catalogue::survey(&inputs, &OpenOptions::default(), folder.path()).unwrap();
    assert_eq!(found.len(), 1);
    assert_eq!(found.open(0)[0].files.count, 2);
}

#[test]
fn fingerprints_follow_names_sizes_and_times_only() {
    let folder = Folder::of(&[ct(0.0, 1), ct(1.0, 2)]);
    let print = || folder.findings()[0].files;
    let before = print();
    assert_eq!((before.count, before), (2, print()));
    let path = folder.path().join("2.dcm");
    let bytes = fs::read(&path).unwrap();
    fs::rename(&path, folder.path().join("3.dcm")).unwrap();
    assert_ne!(print().fingerprint, before.fingerprint);
    fs::rename(folder.path().join("3.dcm"), &path).unwrap();
    assert_eq!(print(), before);
    fs::write(&path, bytes).unwrap();
    assert_ne!(print().fingerprint, before.fingerprint, "written again");
}

#[test]
fn raw_files_are_volumes_by_their_side_cars() {
    let folder = Folder::new();
    folder.put("head.raw", &[7; 8]);
    folder.put("head.json", br#"{"dims": [2, 2, 2], "dtype": "u8", "spacing": [1, 1, 3]}"#);
    folder.put("slices/1", &[1; 4]);
    folder.put("slices/2", &[2; 4]);
    folder.put("slices.toml", b"dims = [2, 2, 2]\ndtype = \"u8\"\n");
    folder.put("short.raw", &[7; 7]);
    folder.put("short.json", br#"{"dims": [2, 2, 2], "dtype": "u8"}"#);
    folder.put("report.json", b"{}");
    let (found, findings) = folder.survey(&OpenOptions::default());
    let names: Vec<(PathBuf, bool)> =
        findings.iter().map(|f| (f.path.file_name().unwrap().into(), f.subject.is_ok())).collect();
    assert_eq!(
        names,
        [("head.json".into(), true), ("short.json".into(), false), ("slices.toml".into(), true)]
    );
    assert!(findings.iter().all(|f| f.id.starts_with("raw-") && f.id.len() == 16), "{findings:?}");
    assert_eq!(findings[0].subject.as_ref().unwrap().volume().unwrap().info().spacing_mm, [1.0, 1.0, 3.0]);
    assert!(findings[1].subject.as_ref().unwrap_err().to_string().contains("takes 8 bytes, but it has 7"));
    assert_eq!((found.left_out().len(), found.left_out()[0].count), (1, 1));
}
