//! Several volumes in one input: which one is taken is what is meant, or it is asked. If this fails, a study of the
//! brain at work fills a disk with five hundred models, or a scout is taken for the series that lacks a slice.

use crate::prelude::*;

/// A series of so many moments of three slices, as a scanner at work writes it.
fn film(folder: &Path, moments: i32) {
    for moment in 0..moments {
        for slice in 0..3 {
            let number = moment * 3 + slice + 1;
            let value = u16::try_from(moment + 1).unwrap();
            let mut image = Elements::ct(f64::from(slice) * 2.5, number, [value, 0, value, 9]);
            image.set(0x0020_0100, "IS", &(moment + 1).to_string());
            image.set(0x0008_0018, "UI", &format!("1.2.3.{number}"));
            fs::write(folder.join(format!("{number}.dcm")), image.bytes()).unwrap();
        }
    }
}

#[test]
fn very_many_volumes_of_one_series_are_one_line_and_one_model() {
    let folder = tempfile::tempdir().unwrap();
    film(folder.path(), 40);
    let listed = |extra: &[&str]| {
        let run = oct(&[&["scan", &text(folder.path()), "--json"], extra].concat());
        run.json()["items"].as_array().unwrap().clone()
    };
    let items = listed(&[]);
    assert_eq!(items.len(), 1, "{items:?}");
    assert!(items[0]["warnings"].to_string().contains("the first of 40 similar volumes"), "{items:?}");
    assert_eq!((items[0]["number"].as_u64(), items[0]["part"].as_str()), (Some(1), Some("time 1")));
    let all = listed(&["--all-volumes"]);
    assert_eq!(all.len(), 40);
    assert_eq!(all[39]["number"].as_u64(), Some(40));

    let out = tempfile::tempdir().unwrap();
    let batch = |extra: &[&str]| {
        let args = ["batch", &text(folder.path()), "--out", &text(out.path()), "--iso", "-1020", "--json"];
        oct(&[&args[..], extra].concat()).json()
    };
    let report = batch(&[]);
    assert_eq!((report["converted"].as_u64(), report["failed"].as_u64()), (Some(1), Some(0)));
    assert!(report["items"][0]["warnings"].to_string().contains("--all-volumes"), "{report}");
    let report = batch(&["--all-volumes"]);
    assert_eq!((report["converted"].as_u64(), report["skipped"].as_u64()), (Some(39), Some(1)));

    // One model: the first by default, any by its number in the list.
    let model = text(&folder.path().join("m.oct"));
    let built = |extra: &[&str]| {
        let args =
            ["build", &text(folder.path()), "-o", &model, "--iso", "-1020", "--channels", "value", "--json"];
        oct(&[&args[..], extra].concat()).json()
    };
    assert!(built(&[])["warnings"].to_string().contains("40 sets of images"));
    let chosen = built(&["--volume", "17"]);
    assert!(chosen["warnings"].to_string().contains("time 17"), "{chosen}");
}

#[test]
fn a_few_volumes_are_all_taken() {
    let folder = tempfile::tempdir().unwrap();
    film(folder.path(), 16);
    let run = oct(&["scan", &text(folder.path()), "--json"]);
    assert_eq!(run.json()["items"].as_array().unwrap().len(), 16);
}

#[test]
fn a_larger_series_that_lacks_a_slice_is_not_passed_over() {
    let folder = tempfile::tempdir().unwrap();
    let put = |series: &str, slices: &[i32]| {
        for slice in slices {
            let mut image = Elements::ct(f64::from(*slice) * 2.5, slice + 1, [1, 2, 3, 4]);
            image.set(0x0020_000e, "UI", series);
            image.set(0x0008_0018, "UI", &format!("{series}.{slice}"));
            fs::write(folder.path().join(format!("{series}-{slice}.dcm")), image.bytes()).unwrap();
        }
    };
    put("1.2.1", &[0, 1, 2, 3]);
    put("1.2.2", &[0, 1, 2, 3, 5, 6, 7, 8]);
    let (input, model) = (text(folder.path()), folder.path().join("m.oct"));
    let output = text(&model);
    let build = |extra: &[&str]| {
        let args = ["build", &input, "-o", &output, "--iso", "-1022", "--json"];
        oct(&[&args[..], extra].concat())
    };
    build(&[])
        .refused(3, &["probably missing: 1 slice in", "--gaps fill", "--volume 2", "--volume 1", "2x2x4"]);
    assert!(!model.exists());
    let slices = |extra: &[&str]| build(extra).json()["dims"][2].as_u64();
    assert_eq!(slices(&["--gaps", "fill"]), Some(9));
    assert_eq!(slices(&["--gaps", "keep"]), Some(8));
    assert_eq!(slices(&["--volume", "1"]), Some(4));
    // The other way round nothing is lost: the largest is whole.
    put("1.2.1", &[4, 5, 6, 7, 8, 9]);
    let run = build(&[]);
    assert_eq!(run.json()["dims"][2].as_u64(), Some(10));
    assert!(run.json()["warnings"].to_string().contains("refused"), "{run:?}");
}
