//! Every picture of a stack is a slice of the volume, and none is lost in silence: pictures that this program made
//! are told by what is written in them, a file given by name is never dropped, and a number that is missing in the
//! names is a gap like any other. If this fails, five slices become four, and everything behind moves up.

use crate::prelude::*;

fn stack(folder: &Path, slices: u32) -> Vec<PathBuf> {
    pngs(&Object::new([24, 20, slices], ScalarType::U8, [1.0; 3]), folder)
}

fn build(inputs: &[&Path], output: &Path, extra: &[&str]) -> Run {
    command::build(inputs, output, &[&["--iso", "128", "--json"], extra].concat())
}

fn slices(run: &Run) -> u64 {
    run.json()["dims"][2].as_u64().unwrap()
}

#[test]
fn a_model_beside_a_slice_of_its_name_takes_no_slice_away() {
    let folder = tempfile::tempdir().unwrap();
    let st = folder.path().join("st");
    stack(&st, 5);
    // The model of the stack lies in its folder, named like one of the slices.
    let model = st.join("s3.oct");
    for _ in 0..3 {
        assert_eq!(slices(&build(&[&st], &model, &[])), 5);
    }
    // A single picture, given by name, as often as one likes.
    let scan = folder.path().join("scan.png");
    fs::copy(st.join("s1.png"), &scan).unwrap();
    let model = folder.path().join("scan.oct");
    for _ in 0..2 {
        assert_eq!(slices(&build(&[&scan], &model, &[])), 1);
    }
}

#[test]
fn pictures_of_models_are_known_by_what_is_written_in_them() {
    let folder = tempfile::tempdir().unwrap();
    let st = folder.path().join("st");
    let files = stack(&st, 5);
    let model = st.join("m.oct");
    assert_eq!(slices(&build(&[&st], &model, &[])), 5);
    // The picture has a name of its own, and even that of another slice; and a grey one as large as the slices.
    let (model, at) = (text(&model), |name: &str| text(&st.join(name)));
    let drawn = oct(&[
        "render",
        &model,
        "-o",
        &at("s6.png"),
        "--depth",
        &at("s7.png"),
        "--normals",
        &at("n.png"),
        "--size",
        "24x20",
    ]);
    assert_eq!(drawn.code, 0, "{drawn:?}");
    assert_eq!(oct(&["thumbnail", &model, "-o", &at("view.png")]).code, 0);
    let run = build(&[&st], &st.join("again.oct"), &[]);
    assert_eq!(slices(&run), 5);
    let warnings = run.json()["warnings"].to_string();
    assert!(warnings.contains("4 files left out: picture of a model"), "{warnings}");
    // A picture that is given by name is what is meant: its colours are refused, it is not dropped.
    let mut inputs: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    let own = st.join("s6.png");
    inputs.push(&own);
    build(&inputs, &st.join("named.oct"), &[]).refused(3, &["s6.png", "grey"]);
    // So is an empty file among those that are named.
    fs::write(&own, "").unwrap();
    build(&inputs, &st.join("named.oct"), &[]).refused(3, &["s6.png", "is empty"]);
    assert!(!names(&st).contains(&"named.oct".to_owned()));
}

#[test]
fn a_missing_number_is_a_gap() {
    let folder = tempfile::tempdir().unwrap();
    let st = folder.path().join("st");
    let files = stack(&st, 9);
    let whole = folder.path().join("whole.oct");
    assert_eq!(slices(&build(&[&st], &whole, &[])), 9);
    fs::remove_file(&files[3]).unwrap();
    let model = folder.path().join("m.oct");
    build(&[&st], &model, &[]).refused(3, &["1 slice in", "s3.png", "s5.png", "--gaps fill"]);
    assert!(!model.exists());
    // Given one by one they are the same files.
    let rest: Vec<&Path> = files.iter().map(PathBuf::as_path).filter(|p| p.exists()).collect();
    build(&rest, &model, &[]).refused(3, &["s3.png", "s5.png"]);
    // Filled, the others keep their places; kept, what lies behind moves up, and that is said.
    let filled = build(&[&st], &model, &["--gaps", "fill"]);
    assert_eq!(slices(&filled), 9);
    assert!(filled.json()["warnings"].to_string().contains("1 of 9 slices"), "{filled:?}");
    let kept = build(&[&st], &model, &["--gaps", "keep"]);
    assert_eq!(slices(&kept), 8);
    assert!(kept.json()["warnings"].to_string().contains("taken as evenly spaced"), "{kept:?}");
    let listed = oct(&["scan", &text(&st)]);
    assert!(listed.stdout.contains("refused") && listed.stdout.contains("s5.png"), "{listed:?}");
}

#[test]
fn a_filled_slice_lies_half_way_between_its_neighbours() {
    let folder = tempfile::tempdir().unwrap();
    let files = stack(folder.path(), 9);
    let read = |gaps, z| {
        let options = infobyte::source::OpenOptions { gaps, ..Default::default() };
        let inputs = [folder.path().to_path_buf()];
        let volume = infobyte::discovery::open(&inputs, &options).unwrap();
        let dims = volume.info().dims;
        assert_eq!(dims.to_array(), [24, 20, 9]);
        let mut out = vec![0; 24 * 20];
        volume.read_rows(z, 0..20, 0..24, &mut out).unwrap();
        out
    };
    let [below, above, last] = [2, 4, 8].map(|z| read(Default::default(), z));
    fs::remove_file(&files[3]).unwrap();
    let fill = infobyte::source::GapPolicy::Fill;
    for (z, expected) in [(2, &below), (4, &above), (8, &last)] {
        assert_eq!(&read(fill, z), expected);
    }
    let made = read(fill, 3);
    for ((made, a), b) in made.iter().zip(&below).zip(&above) {
        let exact = f64::midpoint(f64::from(*a), f64::from(*b));
        assert!((f64::from(*made) - exact).abs() <= 0.5, "{made} between {a} and {b}");
    }
}
