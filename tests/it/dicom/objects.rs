//! What objects other than plain series mean: nuclear medicine, dose, segmentations, dynamic PET, enhanced
//! multi-frame images in any order. If one of these fails, frames that are not neighbours get stacked, or a
//! volume is mirrored, moved or scaled wrongly, without a word.

use crate::prelude::*;

const IMAGE_TYPE: u32 = 0x0008_0008;
const CLASS: u32 = 0x0008_0016;
const MODALITY: u32 = 0x0008_0060;
const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;
const PIXELS: u32 = 0x7fe0_0010;

/// Volumes found in a folder, which lives as long.
struct Found {
    findings: Vec<Finding>,
    _folder: tempfile::TempDir,
}

impl Found {
    fn in_files(images: &[Elements]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (i, image) in images.iter().enumerate() {
            fs::write(folder.path().join(format!("{}.dcm", i + 1)), image.bytes()).unwrap();
        }
        let scratch = tempfile::tempdir().unwrap();
        let paths = [folder.path().to_path_buf()];
        let options = OpenOptions { all_volumes: true, ..OpenOptions::default() };
        let found = Catalogue::survey(&paths, &options, scratch.path()).unwrap();
        let findings = (0..found.len()).flat_map(|i| found.open(i)).collect();
        Self { findings, _folder: folder }
    }

    fn parts(&self) -> Vec<&str> {
        self.findings.iter().map(|f| f.part.as_deref().unwrap_or_default()).collect()
    }

    fn volume(&self, at: usize) -> &dyn VolumeSource {
        self.findings[at].subject.as_ref().unwrap().volume().unwrap()
    }

    fn refusal(&self, at: usize) -> String {
        self.findings[at].subject.as_ref().unwrap_err().to_string()
    }

    /// The first sample of each slice of each volume.
    fn firsts(&self) -> Vec<Vec<u16>> {
        (0..self.findings.len()).map(|at| firsts(self.volume(at))).collect()
    }
}

/// Origin and step of the slices.
fn line(source: &dyn VolumeSource) -> ([f64; 3], [f64; 3]) {
    let rows = source.info().affine.rows;
    ([0, 1, 2].map(|i| rows[i][3]), [0, 1, 2].map(|i| rows[i][2]))
}

fn part(write: impl FnOnce(&mut Writer)) -> Vec<u8> {
    let mut w = Writer::bare(Syntax::ExplicitLe);
    write(&mut w);
    w.bytes
}

/// An item of a sequence.
fn item(content: &[u8]) -> Vec<u8> {
    part(|w| w.element(0xfffe_e000, "", content))
}

/// A sequence of one item.
fn sequence(tag: u32, content: &[u8]) -> Vec<u8> {
    part(|w| w.element(tag, "SQ", &item(content)))
}

fn us_list(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A file of frames of four equal pixels each, without groups.
fn frames(class: &str, modality: &str, values: &[u16]) -> Elements {
    let mut image = Elements::ct(0.0, 1, [0; 4]);
    image.set(CLASS, "UI", class).set(MODALITY, "CS", modality);
    image.set(0x0028_0008, "IS", &values.len().to_string());
    let pixels: Vec<u16> = values.iter().flat_map(|v| [*v; 4]).collect();
    image.raw(PIXELS, "OW", &us_list(&pixels));
    image
}

const NM: &str = "1.2.840.10008.5.1.4.1.1.20";

/// Nuclear medicine whose place is the detector's, with these vectors.
fn nuclear(values: &[u16], vectors: &[(u32, &[u16])]) -> Elements {
    let mut image = frames(NM, "NM", values);
    image.without(POSITION).without(ORIENTATION).set(0x0018_0088, "DS", "4");
    let place = part(|w| {
        w.text(POSITION, "DS", "1\\2\\3");
        w.text(ORIENTATION, "DS", "1\\0\\0\\0\\1\\0");
    });
    image.raw(0x0054_0022, "SQ", &item(&place));
    for (tag, numbers) in vectors {
        image.raw(*tag, "US", &us_list(numbers));
    }
    image
}

const ENERGY: u32 = 0x0054_0010;
const SLOT: u32 = 0x0054_0070;
const SLICE: u32 = 0x0054_0080;
const VIEW: u32 = 0x0054_0090;

#[test]
fn time_slots_and_energy_windows_of_nuclear_medicine_are_volumes() {
    for (what, values, slots, slices) in [
        ("one after another", [10, 20, 30, 11, 21, 31], [1, 1, 1, 2, 2, 2], [1, 2, 3, 1, 2, 3]),
        ("in turns", [10, 11, 20, 21, 30, 31], [1, 2, 1, 2, 1, 2], [1, 1, 2, 2, 3, 3]),
    ] {
        let found =
            Found::in_files(&[nuclear(&values, &[(ENERGY, &[1; 6]), (SLOT, &slots), (SLICE, &slices)])]);
        assert_eq!(found.parts(), ["frames 1", "frames 2"], "{what}");
        assert_eq!(found.firsts(), [[10, 20, 30], [11, 21, 31]], "{what}");
        for at in [0, 1] {
            assert_eq!(line(found.volume(at)), ([1.0, 2.0, 3.0], [0.0, 0.0, 4.0]), "{what}");
        }
    }
    // One of each: one volume, whether or not that is said.
    for vectors in [&[(ENERGY, &[1, 1, 1][..]), (SLICE, &[1, 2, 3])][..], &[]] {
        let found = Found::in_files(&[nuclear(&[10, 20, 30], vectors)]);
        assert_eq!((found.parts(), found.firsts()), (vec![""], vec![vec![10, 20, 30]]));
    }
}

#[test]
fn slices_of_nuclear_medicine_begin_where_the_first_frame_lies() {
    // Numbered downwards: still from the first frame, as others read it.
    let found = Found::in_files(&[nuclear(&[10, 20, 30], &[(SLICE, &[3, 2, 1])])]);
    assert_eq!((line(found.volume(0)).0, found.firsts()), ([1.0, 2.0, 3.0], vec![vec![10, 20, 30]]));
    // Stacked in front of the first frame, by a negative distance.
    let mut image = nuclear(&[10, 20, 30], &[(SLICE, &[1, 2, 3])]);
    let found = Found::in_files(&[image.with(0x0018_0088, "DS", "-4")]);
    assert_eq!((line(found.volume(0)).0, found.firsts()), ([1.0, 2.0, -5.0], vec![vec![30, 20, 10]]));
    // No distance but the thickness.
    let found = Found::in_files(&[image.without(0x0018_0088).with(0x0018_0050, "DS", "2")]);
    assert_eq!(line(found.volume(0)).1, [0.0, 0.0, 2.0]);
    // A vector that is too short would put the frames it leaves out somewhere.
    let found = Found::in_files(&[nuclear(&[10, 20, 30], &[(SLICE, &[1, 2])])]);
    assert!(found.refusal(0).contains("numbers 2 of 3 frames"), "{}", found.refusal(0));
    // Nonsense: an answer, no panic.
    for numbers in [&[][..], &[1], &[1, 1, 1], &[65535, 0, 65535]] {
        Found::in_files(&[nuclear(&[10, 20, 30], &[(SLICE, numbers), (SLOT, numbers)])]);
    }
}

#[test]
fn projections_of_nuclear_medicine_are_no_slices() {
    let found = Found::in_files(&[nuclear(&[1, 2, 3], &[(VIEW, &[1, 2, 3])])]);
    assert!(found.refusal(0).contains("not slices (there is no Slice Vector"), "{}", found.refusal(0));
}

#[test]
fn a_dose_begins_at_its_position_whatever_its_offsets_begin_with() {
    let found = |orientation: &str, offsets: &str| {
        let mut image = frames("1.2.840.10008.5.1.4.1.1.481.2", "RTDOSE", &[10, 20, 30]);
        image.set(POSITION, "DS", "1\\2\\3").set(ORIENTATION, "DS", orientation);
        image.set(0x3004_000c, "DS", offsets).set(0x3004_000e, "DS", "0.5");
        Found::in_files(&[image])
    };
    let dose = |orientation: &str, offsets: &str| {
        let found = found(orientation, offsets);
        (line(found.volume(0)), found.firsts().remove(0))
    };
    let (up, down) = ("1\\0\\0\\0\\1\\0", "1\\0\\0\\0\\-1\\0");
    let rising = vec![10, 20, 30];
    for offsets in ["0\\4\\8", "3\\7\\11", "100\\104\\108"] {
        assert_eq!(dose(up, offsets), (([1.0, 2.0, 3.0], [0.0, 0.0, 4.0]), rising.clone()), "{offsets}");
    }
    // The normal points down: offsets follow it, coordinates do not.
    assert_eq!(dose(down, "0\\4\\8"), (([1.0, 2.0, 3.0], [0.0, 0.0, -4.0]), rising.clone()));
    assert_eq!(dose(down, "3\\7\\11"), (([1.0, 2.0, 11.0], [0.0, 0.0, -4.0]), vec![30, 20, 10]));
    // Coordinates along z say nothing where z is not a normal.
    assert_eq!(dose("1\\0\\0\\0\\0\\-1", "3\\7\\11"), (([1.0, 2.0, 3.0], [0.0, 4.0, 0.0]), rising));
    assert_eq!(dose(up, "0\\2,5\\5").0, ([1.0, 2.0, 3.0], [0.0, 0.0, 2.5]));
    let notes = sentences(&found(up, "0\\2,5\\5").volume(0).info().notes).join("; ");
    assert!(notes.contains("decimal commas of the Grid Frame Offset Vector"), "{notes}");
    for (offsets, shown) in [
        ("0\\x\\8", "`x`"),
        ("0\\4\\NaN", "`NaN`"),
        ("0\\\\8", "``"),
        ("0\\4\\", "``"),
        ("0\\4", "`0\\4`"),
        ("0\\4\\8\\12", "`0\\4\\8\\12`"),
    ] {
        let found = found(up, offsets);
        let told = found.refusal(0);
        let named = format!("its Grid Frame Offset Vector (3004,000C) is {shown}, which is");
        assert!(found.findings.len() == 1 && told.contains(&named), "{offsets}: {told}");
    }
}

/// What makes a frame: its z in mm, and the content of its functional groups.
type Frame<'a> = (f64, Vec<u8>);

/// An enhanced image; values are the numbers of frames.
fn enhanced(class: &str, modality: &str, list: &[Frame<'_>]) -> Elements {
    let values: Vec<u16> = (0..u16::try_from(list.len()).unwrap()).collect();
    let mut image = frames(class, modality, &values);
    image.without(POSITION).without(ORIENTATION);
    let groups: Vec<u8> = list
        .iter()
        .flat_map(|(z, groups)| {
            let place = part(|w| w.text(POSITION, "DS", &format!("0\\0\\{z}")));
            item(&[groups.clone(), sequence(0x0020_9113, &place)].concat())
        })
        .collect();
    let turn = part(|w| w.text(ORIENTATION, "DS", "1\\0\\0\\0\\1\\0"));
    image.raw(0x5200_9229, "SQ", &item(&sequence(0x0020_9116, &turn)));
    image.raw(0x5200_9230, "SQ", &groups);
    image
}

const ENHANCED_MR: &str = "1.2.840.10008.5.1.4.1.1.4.1";
const SEGMENTATION: &str = "1.2.840.10008.5.1.4.1.1.66.4";

/// Frame Content with one element.
fn content(tag: u32, vr: &str, value: &[u8]) -> Vec<u8> {
    sequence(0x0020_9111, &part(|w| w.element(tag, vr, value)))
}

fn doubles(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn longs(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn frames_in_any_order_are_told_apart_by_dimension_gradient_or_time() {
    // Two volumes of three slices, in an order that says nothing: (volume, slice).
    let order: [(u32, u32); 6] = [(0, 1), (1, 0), (1, 1), (0, 2), (0, 0), (1, 2)];
    type Tell = fn(u32, u32) -> Vec<u8>;
    let ways: [(&str, Tell); 4] = [
        ("dimension 1", |volume, slice| content(0x0020_9157, "UL", &longs(&[volume + 1, slice + 1]))),
        ("dimension 2", |volume, slice| content(0x0020_9157, "UL", &longs(&[3 - slice, volume + 1]))),
        ("direction", |volume, _| {
            let direction = if volume == 0 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
            let direction = part(|w| w.element(0x0018_9089, "FD", &doubles(&direction)));
            sequence(0x0018_9117, &sequence(0x0018_9076, &direction))
        }),
        ("set", |volume, slice| {
            content(0x0018_9074, "DT", format!("20200101120{volume}0{slice}.00+0100 ").as_bytes())
        }),
    ];
    for (word, tell) in ways {
        let list: Vec<Frame<'_>> = order.iter().map(|(v, s)| (f64::from(*s), tell(*v, *s))).collect();
        let found = Found::in_files(&[enhanced(ENHANCED_MR, "MR", &list)]);
        assert_eq!(found.firsts(), [[4, 0, 3], [1, 2, 5]], "{word}");
        assert!(found.parts().iter().all(|p| p.contains(word)), "{word}: {:?}", found.parts());
    }
    // Nothing tells: better no volume than a mixed one.
    let list: Vec<Frame<'_>> = order.iter().map(|(_, s)| (f64::from(*s), Vec::new())).collect();
    let found = Found::in_files(&[enhanced(ENHANCED_MR, "MR", &list)]);
    assert!(found.refusal(0).contains("repeat the position"), "{}", found.refusal(0));
}

#[test]
fn stacks_with_a_gap_between_them_are_volumes() {
    let list = |gap: f64| -> Vec<Frame<'static>> {
        let frame = |i: u32| {
            let stack = content(0x0020_9056, "SH", if i < 3 { b"1 " } else { b"2 " });
            (f64::from(i) + if i < 3 { 0.0 } else { gap }, stack)
        };
        (0..6).map(frame).collect()
    };
    let found = Found::in_files(&[enhanced(ENHANCED_MR, "MR", &list(2.5))]);
    assert_eq!(found.firsts(), [[0, 1, 2], [3, 4, 5]]);
    let found = Found::in_files(&[enhanced(ENHANCED_MR, "MR", &list(0.0))]);
    assert_eq!(found.firsts(), [[0, 1, 2, 3, 4, 5]]);
}

#[test]
fn segments_are_volumes_wherever_they_lie() {
    let segment = |number: u16| sequence(0x0062_000a, &part(|w| w.us(0x0062_000b, number)));
    let list: Vec<Frame<'_>> =
        [1, 1, 2, 2].iter().zip([0.0, 1.0, 2.0, 3.0]).map(|(s, z)| (z, segment(*s))).collect();
    let found = Found::in_files(&[enhanced(SEGMENTATION, "SEG", &list)]);
    assert_eq!(found.parts(), ["segment 1", "segment 2"]);
    assert_eq!(found.firsts(), [[0, 1], [2, 3]]);
}

/// Segmentation of two segments of two slices each, of which the second one is stated first.
fn segmentation(kind: &str) -> Elements {
    let segment = |number: u16| sequence(0x0062_000a, &part(|w| w.us(0x0062_000b, number)));
    let list: Vec<Frame<'_>> =
        [2, 2, 5, 5].iter().zip([0.0, 1.0, 1.0, 2.0]).map(|(s, z)| (z, segment(*s))).collect();
    let mut image = enhanced(SEGMENTATION, "SEG", &list);
    image.set(0x0062_0001, "CS", kind);
    let code = |meaning: &str, more: &[u8]| {
        let own = part(|w| w.text(0x0008_0104, "LO", meaning));
        item(&[own, more.to_vec()].concat())
    };
    let segment = |number: u16, label: &str, coded: &[u8], lab: [u16; 3]| {
        let head = part(|w| {
            w.us(0x0062_0004, number);
            w.text(0x0062_0005, "LO", label);
            w.element(0x0062_000d, "US", &us_list(&lab));
        });
        let coded = part(|w| w.element(0x0062_000f, "SQ", coded));
        item(&[head, coded].concat())
    };
    let right = part(|w| w.element(0x0062_0011, "SQ", &code("Right", &[])));
    // L 54.29, a 80.81, b 69.89 is red where D50 is white; L 100 is white.
    let all = [
        segment(5, "Jo Real's kidney", &code("Kidney", &right), [35_580, 53_665, 50_858]),
        segment(2, "liver", &code("Liver", &[]), [65_535, 32_896, 32_896]),
    ];
    image.raw(0x0062_0002, "SQ", &all.concat());
    // Values are the numbers of frames, and those of a mask are 0 and 1.
    image.raw(PIXELS, "OW", &us_list(&[1; 16])).without(0x0028_1052).without(0x0028_1053);
    image
}

#[test]
fn segments_are_named_by_codes_and_coloured_and_joined_where_labels_are_looked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (seg, model) = (folder.path().join("s.dcm"), folder.path().join("m.oct"));
    fs::write(&seg, segmentation("BINARY").bytes()).unwrap();
    let build = |extra: &[&str]| {
        let run = command::build(&[&seg], &model, &[&["--labels", "all", "--json"], extra].concat());
        (run.json()["warnings"].to_string(), Model::open(&model).unwrap().frame().labels.clone())
    };
    let (warnings, labels) = build(&[]);
    let told: Vec<_> = labels.iter().map(|l| (l.number, l.name.as_str(), l.color)).collect();
    assert_eq!(told, [(2, "Liver", [255, 255, 255]), (5, "Right Kidney", [255, 0, 0])]);
    // The later segment has the slice that both hold.
    assert_eq!(labels.iter().map(|l| l.voxels).collect::<Vec<_>>(), [4, 8]);
    assert!(
        warnings.contains("--keep-names uses those") && warnings.contains("several masks share 4 voxels")
    );
    assert!(!fs::read(&model).unwrap().windows(4).any(|part| part == b"Real"));
    let (warnings, labels) = build(&["--keep-names", "--overlap", "first"]);
    let told: Vec<_> = labels.iter().map(|l| (l.name.as_str(), l.voxels)).collect();
    assert_eq!(told, [("liver", 8), ("Jo Real's kidney", 4)]);
    assert!(!warnings.contains("--keep-names"), "{warnings}");
    let (_, labels) = build(&["--volume", "2"]);
    assert_eq!((labels.len(), labels[0].number, labels[0].voxels), (1, 5, 8));
    // One volume of a list and of a batch.
    let listed = oct(&["scan", &text(&seg), "--json"]).json();
    assert_eq!((listed["usable"].as_u64(), listed["items"][0]["label_count"].as_u64()), (Some(1), Some(2)));
    let out = folder.path().join("out");
    let batch = oct(&["batch", &text(&seg), "--out", &text(&out), "--json"]).json();
    let made = &batch["items"][0];
    assert_eq!(
        (batch["converted"].as_u64(), made["model"]["label_count"].as_u64()),
        (Some(1), Some(2)),
        "{batch}"
    );
    assert_eq!(made["name"], listed["items"][0]["name"]);
    assert!(made["kind"] == "segmentation" && !made["name"].as_str().unwrap().contains("segment"), "{batch}");
    let found = Model::open(out.join(made["model"]["file"].as_str().unwrap())).unwrap();
    assert_eq!(found.frame().labels[1].name, "Right Kidney");
    let apart =
        oct(&["batch", &text(&seg), "--out", &text(&folder.path().join("iso")), "--iso", "1", "--json"]);
    assert_eq!(apart.json()["converted"].as_u64(), Some(2));
    // Parts of voxels are no labels.
    fs::write(&seg, segmentation("FRACTIONAL").bytes()).unwrap();
    command::build(&[&seg], &model, &["--labels", "all"]).refused(2, &["FRACTIONAL", "--iso"]);
    assert_eq!(oct(&["scan", &text(&seg), "--json"]).json()["items"][0]["label_count"], Value::Null);
}

#[test]
fn labels_stay_numbers_whatever_their_colours() {
    let list: Vec<Frame<'_>> = [0.0, 1.0, 2.0].iter().map(|z| (*z, Vec::new())).collect();
    let mut image = enhanced("1.2.840.10008.5.1.4.1.1.66.7", "SEG", &list);
    image.set(0x0028_0004, "CS", "PALETTE COLOR");
    for colour in 0..3 {
        image.raw(0x0028_1101 + colour, "US", &us_list(&[4, 0, 8]));
        image.raw(0x0028_1201 + colour, "OW", &[9, 200, 30, 7]);
    }
    assert_eq!(Found::in_files(&[image.clone()]).firsts(), [[0, 1, 2]]);
    // A picture is another thing.
    image.set(CLASS, "UI", "1.2.840.10008.5.1.4.1.1.7.4").set(MODALITY, "CS", "OT");
    let found = Found::in_files(&[image]);
    let warnings = sentences(&found.volume(0).info().notes).join("\n");
    assert!(warnings.contains("palette colours"), "{warnings}");
}

/// Two volumes of three slices in files, with instance numbers in this order.
fn series(numbers: [i32; 6], tell: impl Fn(&mut Elements, u32)) -> Vec<Elements> {
    let mut images = Vec::new();
    for volume in 0..2_u32 {
        for slice in 0..3_u32 {
            let at = usize::try_from(3 * volume + slice).unwrap();
            let value = u16::try_from(10 * volume + slice).unwrap();
            let mut image = Elements::ct(f64::from(slice), numbers[at], [value; 4]);
            tell(&mut image, volume);
            images.push(image);
        }
    }
    images
}

#[test]
fn dynamic_pet_is_told_apart_by_frame_reference_time() {
    let found = Found::in_files(&series([4, 1, 6, 2, 5, 3], |image, volume| {
        image.set(MODALITY, "CS", "PT").set(0x0054_1300, "DS", &(volume * 60_000).to_string());
    }));
    assert_eq!(found.firsts(), [[0, 1, 2], [10, 11, 12]]);
    assert!(found.parts()[1].contains("reference time 60000"), "{:?}", found.parts());
}

#[test]
fn an_order_that_says_nothing_makes_no_volumes() {
    for (numbers, regular) in [
        ([1, 2, 3, 4, 5, 6], true),
        ([3, 1, 2, 5, 6, 4], true),
        ([1, 3, 5, 2, 4, 6], true),
        ([5, 1, 4, 2, 3, 6], false),
    ] {
        let found = Found::in_files(&series(numbers, |image, _| {
            image.set(IMAGE_TYPE, "CS", "ORIGINAL\\PRIMARY");
        }));
        if regular {
            assert_eq!(found.firsts(), [[0, 1, 2], [10, 11, 12]], "{numbers:?}");
        } else {
            assert!(found.refusal(0).contains("nothing in their headers tells them apart"), "{numbers:?}");
        }
    }
    // The last of three was not finished.
    let mut images = series([1, 2, 3, 4, 5, 6], |_, _| {});
    images.push(Elements::ct(0.0, 7, [20; 4]));
    images.push(Elements::ct(1.0, 8, [21; 4]));
    let found = Found::in_files(&images);
    assert_eq!(found.firsts(), [vec![0, 1, 2], vec![10, 11, 12], vec![20, 21]]);
    // One volume, and one image too many: which is the right one?
    let mut images = images[..3].to_vec();
    images.push(Elements::ct(1.0, 7, [20; 4]));
    assert!(Found::in_files(&images).refusal(0).contains("repeat the position"));
    // The date and time of acquisition says it after all.
    let found = Found::in_files(&series([4, 1, 6, 2, 5, 3], |image, volume| {
        image.set(0x0008_002a, "DT", &format!("202001011200{}0.5", 1 - volume));
    }));
    assert_eq!(found.firsts(), [[10, 11, 12], [0, 1, 2]]);
}

#[test]
fn positions_rounded_to_tenths_are_even() {
    let at = |i: i32| (f64::from(i) * 6.25).round() / 10.0;
    let images: Vec<Elements> = (0..40).map(|i| Elements::ct(at(i), i + 1, [1; 4])).collect();
    let found = Found::in_files(&images);
    let info = found.volume(0).info();
    assert!((info.spacing_mm[2] - at(39) / 39.0).abs() < 1e-12, "{:?}", info.spacing_mm);
    assert!(sentences(&info.notes).join("\n").contains("not quite evenly spaced"), "{:?}", info.notes);
    // A slice that is missing is still missing.
    let some: Vec<Elements> =
        images.iter().enumerate().filter(|(i, _)| *i != 17).map(|(_, e)| e.clone()).collect();
    assert!(Found::in_files(&some).refusal(0).contains("unevenly spaced"));
    // And so is one of three.
    let some: Vec<Elements> = [0, 1, 3].map(|i| images[i].clone()).to_vec();
    assert!(Found::in_files(&some).refusal(0).contains("unevenly spaced"));
}

#[test]
fn slices_that_a_segmentation_leaves_out_are_empty() {
    let list: Vec<Frame<'_>> = [0.0, 1.0, 2.0, 5.0].iter().map(|z| (*z, Vec::new())).collect();
    let found = Found::in_files(&[enhanced(SEGMENTATION, "SEG", &list)]);
    assert_eq!(found.firsts(), [[0, 1, 2, 0, 0, 3]]);
    let info = found.volume(0).info();
    assert_eq!((info.dims.to_array(), info.spacing_mm[2]), ([2, 2, 6], 1.0));
    assert!(sentences(&info.notes).join("\n").contains("2 slices for which the segmentation has no frame"));
    // Of other images they would be missing.
    let found = Found::in_files(&[enhanced(ENHANCED_MR, "MR", &list)]);
    assert!(found.refusal(0).contains("probably missing: 2 slices in"), "{}", found.refusal(0));
}

#[test]
fn parametric_maps_mean_what_their_mapping_says() {
    let mapping = part(|w| {
        w.element(0x0040_9224, "FD", &doubles(&[-5.0]));
        w.element(0x0040_9225, "FD", &doubles(&[0.25]));
    });
    let list: Vec<Frame<'_>> = [0.0, 1.0].iter().map(|z| (*z, sequence(0x0040_9096, &mapping))).collect();
    for (class, rescale) in [("1.2.840.10008.5.1.4.1.1.30", (0.25, -5.0)), (ENHANCED_MR, (1.0, -1024.0))] {
        let found = Found::in_files(&[enhanced(class, "MR", &list)]);
        let info = found.volume(0).info();
        assert_eq!((info.rescale.slope, info.rescale.intercept), rescale, "{class}");
    }
}

#[test]
fn times_that_differ_from_slice_to_slice_tear_no_volume_apart() {
    // A beating heart, slice by slice: beats differ in length, and some slices share one.
    let cine = |beats: [f64; 6], more: u16| -> Vec<Elements> {
        let all = (0..6_u16).flat_map(|slice| (0..20_u16).map(move |phase| (slice, phase)));
        let image = |(slice, phase): (u16, u16)| {
            let n = i32::from(20 * slice + phase);
            let mut image = Elements::ct(f64::from(slice), n, [more + 100 * phase + slice; 4]);
            let trigger = beats[usize::from(slice)] * f64::from(phase) / 20.0;
            image.set(MODALITY, "CS", "MR").set(0x0018_1060, "DS", &format!("{trigger:.2}"));
            image
        };
        all.map(image).collect()
    };
    // Two slices at a time.
    let bands = |at: (u16, u16)| {
        let (time, slice) = at;
        let mut image = Elements::ct(f64::from(slice), i32::from(6 * time + slice), [100 * time + slice; 4]);
        image.set(0x0008_0032, "TM", &format!("1200{:02}", 3 * time + slice % 3));
        image
    };
    let bands: Vec<Elements> = (0..20).flat_map(|t| (0..6).map(move |s| (t, s))).map(bands).collect();
    let expected: Vec<Vec<u16>> = (0..20).map(|t| (0..6).map(|slice| 100 * t + slice).collect()).collect();
    for images in [
        cine([900.0, 910.0, 920.0, 900.0, 910.0, 920.0], 0),
        cine([900.0, 907.3, 914.6, 1021.9, 929.2, 836.5], 0),
        bands,
    ] {
        assert_eq!(Found::in_files(&images).firsts(), expected);
    }
    // Magnitude and phase of each, now the one first and now the other.
    let both = [("M", 0), ("P", 5000)].map(|(part, more)| {
        let mut images = cine([900.0, 910.0, 920.0, 900.0, 910.0, 920.0], more);
        for (n, image) in (0..).zip(&mut images) {
            let number = 2 * n + (n / 20 + i32::from(part == "P")) % 2;
            image.set(IMAGE_TYPE, "CS", &format!("ORIGINAL\\PRIMARY\\{part}"));
            image.set(0x0020_0013, "IS", &number.to_string());
            image.set(0x0008_0018, "UI", &format!("1.2.3.{number}"));
        }
        images
    });
    let found = Found::in_files(&both.into_iter().flatten().collect::<Vec<_>>());
    let later = expected.iter().map(|own| own.iter().map(|v| v + 5000).collect());
    assert_eq!(found.firsts(), expected.iter().cloned().chain(later).collect::<Vec<Vec<u16>>>());
    let parts = found.parts();
    assert!(parts[0].contains("magnitude") && parts[20].contains("phase"), "{parts:?}");
}

#[test]
fn a_series_that_goes_on_past_midnight_keeps_its_order() {
    // Four volumes of four slices, a second each; the third volume is half done at midnight.
    let image = |n: u16| {
        let mut image = Elements::ct(f64::from(n % 4), i32::from(n), [n; 4]);
        let time = if n < 10 { format!("2359{}", 50 + n) } else { format!("0000{:02}", n - 10) };
        image.set(0x0008_0032, "TM", &time);
        image
    };
    let images: Vec<Elements> = (0..16).map(image).collect();
    let expected: Vec<Vec<u16>> = (0..4).map(|t| (4 * t..4 * t + 4).collect()).collect();
    assert_eq!(Found::in_files(&images).firsts(), expected);
}

#[test]
fn positions_without_orientation_are_still_positions() {
    let images: Vec<Elements> = [(8, 1), (4, 2), (0, 3)]
        .map(|(z, n)| {
            let mut image = Elements::ct(f64::from(z), n, [u16::try_from(n).unwrap(); 4]);
            image.set(POSITION, "DS", &format!("1\\2\\{z}")).without(ORIENTATION);
            image
        })
        .to_vec();
    let found = Found::in_files(&images);
    assert_eq!(line(found.volume(0)), ([1.0, 2.0, 0.0], [0.0, 0.0, 4.0]));
    assert_eq!(found.firsts(), [[3, 2, 1]]);
    assert!(sentences(&found.volume(0).info().notes).join("\n").contains("no orientation"));
    let found = Found::in_files(&series([4, 1, 6, 2, 5, 3], |image, volume| {
        image.without(ORIENTATION).set(0x0020_0100, "IS", &volume.to_string());
    }));
    assert_eq!(found.firsts(), [[0, 1, 2], [10, 11, 12]]);
}

#[test]
fn films_are_reported_as_such() {
    let mut image = frames("1.2.840.10008.5.1.4.1.1.12.1", "XA", &[1, 2, 3]);
    image.without(POSITION).without(ORIENTATION);
    let warned = |image: &Elements| {
        let found = Found::in_files(std::slice::from_ref(image));
        sentences(&found.volume(0).info().notes).join("\n").contains("follow each other in time")
    };
    assert!(!warned(&image));
    image.raw(0x0028_0009, "AT", &us_list(&[0x0018, 0x1063]));
    assert!(warned(&image));
    image.raw(0x0028_0009, "AT", &us_list(&[0x0018]));
    assert!(!warned(&image));
}
