//! Text from outside (names of files, texts of headers, metadata of models) shows itself and does nothing else:
//! no escape sequence reaches the terminal, no line feed forges a line of a list, nothing turns the direction of
//! writing; in the console, in HTML and in CSV. If this fails, a file's name can recolour, hide or type.

use crate::prelude::*;

/// An escape sequence, a forged line, C1, and overrides of the direction of writing.
const ACTIVE: &str = "a\u{1b}]0;owned\u{7}\u{1b}[31m\noct: forged\r\u{9b}2J\u{202e}gpj\u{2066}b\u{2028}";

fn acts(c: char) -> bool {
    (c.is_control() && c != '\n')
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Does what was printed hold nothing that acts, and no line of its own making?
fn sound(run: &Run, code: i32) {
    assert_eq!(run.code, code, "{run:?}");
    for printed in [&run.stdout, &run.stderr] {
        assert!(!printed.contains(acts), "{printed:?}");
        assert!(!printed.lines().any(|line| line.starts_with("oct: forged")), "{printed:?}");
    }
}

/// A folder and files of such names: a stack of pictures, and a volume with a header.
fn inputs(folder: &Path) -> (PathBuf, PathBuf) {
    let stack = folder.join(format!("{ACTIVE}stack"));
    pngs(&Object::new([16, 16, 6], ScalarType::U8, [1.0; 3]), &stack);
    let nrrd = folder.join(format!("{ACTIVE}.nrrd"));
    let mut bytes = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n".to_vec();
    bytes.extend("space: odd \u{1b}[31m\u{202e} one\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n".as_bytes());
    bytes.extend("space units: \"fur\u{1b}[2Jlong\u{202e}\" \"mm\" \"mm\"\n\n".as_bytes());
    bytes.extend((0..512).map(|i| if i % 3 == 0 { 200 } else { 0 }));
    fs::write(&nrrd, bytes).unwrap();
    (stack, nrrd)
}

#[test]
fn what_commands_print_of_foreign_names_shows_itself_only() {
    let folder = tempfile::tempdir().unwrap();
    let (stack, nrrd) = inputs(folder.path());
    let (model, picture) =
        (folder.path().join(format!("{ACTIVE}m.oct")), folder.path().join(format!("{ACTIVE}m.png")));
    let (model, picture) = (text(&model), text(&picture));
    for input in [&stack, &nrrd] {
        sound(&oct(&["build", &text(input), "-o", &model, "--iso", "128"]), 0);
    }
    let packed = format!("{model}.packed");
    for args in [
        vec!["info", &model],
        vec!["verify", &model],
        vec!["render", &model, "-o", &picture, "--size", "20x20"],
        vec!["thumbnail", &model, "-o", &picture, "--size", "20"],
        vec!["pack", &model, "-o", &packed],
        vec!["scan", &text(folder.path())],
    ] {
        let run = oct(&args);
        sound(&run, 0);
        // JSON says the same as ever, but for how it is written.
        let json = oct(&[&args[..], &["--json"]].concat());
        sound(&json, 0);
        if args[0] == "info" {
            assert_eq!(json.json()["input"], model.as_str());
        }
    }
    // And where it goes wrong.
    let missing = format!("{ACTIVE}missing");
    for args in [
        vec!["info", &missing],
        vec!["verify", &picture],
        vec!["build", &missing, "-o", &model],
        vec!["build", &text(&stack), "-o", &text(&folder.path().join("none").join(ACTIVE))],
    ] {
        let run = oct(&args);
        assert_ne!(run.code, 0);
        sound(&run, run.code);
    }
    sound(&oct(&["build", &text(&stack), "-o", &model, "--iso", ACTIVE]), 2);
}

#[test]
fn metadata_of_a_model_from_elsewhere_is_foreign_text_too() {
    let folder = tempfile::tempdir().unwrap();
    let (_, nrrd) = inputs(folder.path());
    let model = folder.path().join("m.oct");
    assert_eq!(oct(&["build", &text(&nrrd), "-o", &text(&model), "--iso", "128"]).code, 0);
    // The program that wrote it, as its metadata names it; the section's checksum is made to fit.
    let mut bytes = fs::read(&model).unwrap();
    let program = concat!("infobyte ", env!("CARGO_PKG_VERSION")).as_bytes();
    let at = bytes.windows(program.len()).position(|part| part == program).unwrap();
    bytes[at..at + 6].copy_from_slice(b"\x1b[31m\n");
    bytes[at + 6..at + 9].copy_from_slice("\u{202e}".as_bytes());
    let frame = infobyte::Model::from_bytes(fs::read(&model).unwrap()).unwrap();
    let index = |n: u64| usize::try_from(n).unwrap();
    let sections = frame.sections();
    let number = sections.iter().position(|e| (e.offset..e.end()).contains(&(at as u64))).unwrap();
    let section = index(sections[number].offset)..index(sections[number].end());
    // The section's checksums in its entry, then that of the table, then the header's (SPEC 4.1 and 4.2).
    let mut seal = |of: std::ops::Range<usize>, to: &[usize]| {
        let crc = crc32c_of(&bytes[of]).to_le_bytes();
        to.iter().for_each(|at| bytes[*at..at + 4].copy_from_slice(&crc));
    };
    let (table, entry) = (64, 64 + 48 * number);
    seal(section, &[entry + 40, entry + 44]);
    seal(table..table + 48 * sections.len(), &[56]);
    seal(0..60, &[60]);
    fs::write(&model, &bytes).unwrap();
    for command in ["info", "verify"] {
        sound(&oct(&[command, &text(&model)]), 0);
    }
}

/// CRC-32C, bit by bit.
fn crc32c_of(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(
            crc ^ u32::from(*byte),
            |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0x82f6_3b78 } else { crc >> 1 },
        )
    })
}

#[test]
fn reports_of_a_batch_hold_nothing_that_acts() {
    let folder = tempfile::tempdir().unwrap();
    let (stack, nrrd) = inputs(folder.path());
    fs::write(folder.path().join(format!("=cmd{ACTIVE}.nrrd")), "NRRD0004\ntype: \u{1b}[31m\u{202e}\n\n")
        .unwrap();
    let out = tempfile::tempdir().unwrap();
    let run = oct(&[
        "batch",
        &text(&stack),
        &text(&nrrd),
        &text(folder.path()),
        "--out",
        &text(out.path()),
        "--iso",
        "128",
        "--keep-names",
    ]);
    sound(&run, 8);
    for name in ["report.json", "report.csv", "report.js", "index.html"] {
        let text = fs::read_to_string(out.path().join(name)).unwrap();
        assert!(!text.contains(acts), "{name}: {:?}", text.chars().find(|c| acts(*c)));
        assert!(!text.lines().any(|line| line.starts_with("oct: forged")), "{name}");
    }
    // Data stays data: the file can be found by what the JSON says.
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(out.path().join("report.json")).unwrap()).unwrap();
    let named = report["items"].as_array().unwrap().iter().any(|item| {
        Path::new(item["input"].as_str().unwrap()).file_name().unwrap().as_bytes()
            == nrrd.file_name().unwrap().as_bytes()
    });
    assert!(named, "{report}");
}
