//! What travels tells nobody whom it shows: model, record, thumbnail and contact sheet hold no name, no number and
//! no date of a patient, and no name of a file or folder, whatever these are. What stays at home names them.
//! If this fails, a shared model tells its patient's name.

use crate::prelude::*;
use infobyte::jobs::info::read_info as info;

/// A made-up patient.
struct Patient {
    /// Patient's Name as in the file, and the character set that says how.
    name: &'static str,
    set: Option<&'static str>,
    id: &'static str,
    birth: &'static str,
    accession: &'static str,
    study_date: &'static str,
    /// Words that must not travel.
    words: &'static [&'static str],
}

const PATIENTS: [Patient; 4] = [
    Patient {
        // Called by words of our own messages, and of the contact sheet.
        name: "White^Page",
        set: None,
        id: "series-471199",
        birth: "19700102",
        accession: "ACC90817",
        study_date: "20190304",
        words: &["white^page", "white_page", "471199", "1970-01-02"],
    },
    Patient {
        name: "Kim",
        set: None,
        id: "QZK",
        birth: "19800506",
        accession: "KX7731",
        study_date: "20200405",
        words: &["kim", "qzk"],
    },
    Patient {
        name: "Щукин^Пётр",
        set: Some("ISO_IR 192"),
        id: "Ж-8842",
        birth: "19550708",
        accession: "Ъ5501",
        study_date: "20180706",
        words: &["щукин", "пётр", "петр", "8842"],
    },
    Patient {
        name: "山田^太郎",
        set: Some("ISO_IR 192"),
        id: "患者77120",
        birth: "19610912",
        accession: "受付3301",
        study_date: "20170809",
        words: &["山田", "太郎", "患者", "77120"],
    },
];

/// Names of files and folders that the first patient's words are hidden in, and that are words of our own.
const OWN_WORDS: [&str; 2] = ["white", "page"];

impl Patient {
    fn folder(&self) -> String {
        self.name.replace('^', "_")
    }

    /// A series of three slices of 2 x 2 voxels; `also` is one more element.
    fn series(&self, folder: &Path, uid: &str, also: Option<(u32, &'static str, &str)>) {
        fs::create_dir_all(folder).unwrap();
        for i in 0..3 {
            let mut image = Elements::ct(f64::from(i), i + 1, [2900, 20, 2900, 20]);
            if let Some(set) = self.set {
                image.set(0x0008_0005, "CS", set);
            }
            image.set(0x0008_0020, "DA", self.study_date).set(0x0008_0050, "SH", self.accession);
            image.set(0x0010_0010, "PN", self.name).set(0x0010_0020, "LO", self.id);
            image.set(0x0010_0030, "DA", self.birth).set(0x0020_000e, "UI", uid);
            image.set(0x0008_103e, "LO", self.name);
            if let Some((tag, vr, value)) = also {
                image.set(tag, vr, value);
            }
            fs::write(folder.join(format!("{}-{i}.dcm", self.folder())), image.bytes()).unwrap();
        }
    }

    fn all_words(&self) -> Vec<String> {
        let whole = [self.name, self.id, self.birth, self.accession, self.study_date];
        let folder = self.folder();
        whole.into_iter().chain([&*folder]).chain(self.words.iter().copied()).map(str::to_lowercase).collect()
    }
}

/// Every form in which a word could stand in bytes: UTF-8, and Latin-1 where it has one.
fn forms(word: &str) -> Vec<Vec<u8>> {
    let latin: Option<Vec<u8>> = word.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
    std::iter::once(word.as_bytes().to_vec()).chain(latin).collect()
}

/// Fails where a word is in bytes, in upper or lower case.
fn holds_no(words: &[String], what: &str, bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes).to_lowercase();
    let lower = bytes.to_ascii_lowercase();
    for word in words {
        assert!(!text.contains(word.as_str()), "{word} in {what}");
        for form in forms(word) {
            // Three letters are found in packed bytes by chance.
            assert!(
                form.len() < 4 || !lower.windows(form.len()).any(|part| part == form),
                "{word} in {what}"
            );
        }
    }
}

/// The chunks of a PNG but its pixels: type and content.
fn chunks(png: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    let mut at = 8;
    while let Some(head) = png.get(at..at + 8) {
        let length = u32::from_be_bytes(head[..4].try_into().unwrap()) as usize;
        let kind = String::from_utf8_lossy(&head[4..]).into_owned();
        if kind != "IDAT" {
            found.push((kind, png[at + 8..at + 8 + length].to_vec()));
        }
        at += length + 12;
    }
    found
}

/// The words of a contact sheet that do not come from the program itself: texts of cards, without pictures.
fn cards(page: &str) -> String {
    page.split("<article").skip(1).map(|part| part.split("</article>").next().unwrap()).fold(
        String::new(),
        |text, card| {
            let pictures = card.split("base64,").enumerate();
            pictures.fold(text, |text, (i, part)| {
                text + if i == 0 { part } else { part.split_once('"').map_or("", |(_, rest)| rest) }
            })
        },
    )
}

/// What a model says of itself, decoded.
fn told(path: &Path) -> String {
    let metadata = info(path).unwrap().frame.metadata;
    assert!(!metadata.source.kind.is_empty());
    format!("{metadata:?}").to_lowercase()
}

fn batch(top: &Path, out: &Path, extra: &[&str]) -> Value {
    oct(&[&["batch", &text(top), "--out", &text(out), "--iso", "500", "--quiet"], extra].concat());
    serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap()
}

fn object(depth: u32) -> Object {
    Object::new([6, 5, depth], ScalarType::I16, [1.0; 3])
}

/// Studies of all patients; returns the words that must not travel.
fn studies(top: &Path) -> Vec<String> {
    let mut words = Vec::new();
    for (n, patient) in PATIENTS.iter().enumerate() {
        let folder = top.join(format!("{}_{}", patient.folder(), patient.birth)).join(patient.accession);
        patient.series(&folder, &format!("1.2.3.{n}"), None);
        // Other files beside the images, named like the patient, and a refused one.
        let depth = 4 + u32::try_from(n).unwrap();
        file(&folder, &format!("{}_seg.nrrd", patient.folder()), &nrrd(&object(depth), "raw", false, ""));
        file(&folder, &format!("{}-broken.nrrd", patient.id), b"NRRD0004\n");
        file(&folder, &format!("{}.txt", patient.folder()), b"nothing");
        words.extend(patient.all_words());
    }
    file(top, "page.npy", &npy(&object(9), 1, false, false));
    file(top, "white.npy", &npy(&object(10), 1, false, false));
    // Latin-1 in a name that is not a UTF-8.
    let odd = latin1(b"M\xfcllerin.nrrd");
    fs::write(top.join(odd), nrrd(&object(11), "raw", false, "")).unwrap();
    words.extend(["müllerin".to_owned(), "llerin".to_owned()]);
    // A volume whose samples lie in a file that is named in its header, which is called by a path.
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: raw\n\
                  data file: Kim_Kim.raw\n\n";
    file(top, "Kim_Kim.nhdr", header.as_bytes());
    let samples: Vec<u8> = (0..64).map(|i| if i % 16 < 8 { 200 } else { 0 }).collect();
    file(top, "Kim_Kim.raw", &samples);
    words
}

#[test]
fn what_travels_names_nobody_and_what_stays_maps_ids_to_paths() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    let words = studies(&top);
    let report = batch(&top, &out, &[]);
    let items = report["items"].as_array().unwrap();
    assert_eq!((items.len(), &report["failed"]), (16, &5.into()), "{report}");
    let (mut models, mut pictures) = (0, 0);
    for name in names(&out) {
        holds_no(&words, "a name", name.as_bytes());
        let path = out.join(&name);
        let bytes = fs::read(&path).unwrap();
        let own = |text: &str| {
            for word in OWN_WORDS {
                assert!(!text.to_lowercase().contains(word), "{word} in {name}");
            }
        };
        own(&name);
        match path.extension().and_then(|end| end.to_str()).unwrap_or_default() {
            "oct" => {
                models += 1;
                holds_no(&words, &name, &bytes);
                let text = told(&path);
                holds_no(&words, &name, text.as_bytes());
                own(&text);
            }
            "png" => {
                pictures += 1;
                for (kind, content) in chunks(&bytes) {
                    holds_no(&words, &format!("{kind} of {name}"), &content);
                    own(&String::from_utf8_lossy(&content));
                }
            }
            "html" if name == "viewer.html" => holds_no(&words, &name, &bytes),
            "html" => {
                let page = String::from_utf8(bytes).unwrap();
                assert_eq!(page.matches("<article").count(), items.len());
                let cards = cards(&page);
                holds_no(&words, &name, cards.as_bytes());
                own(&cards);
                let rest: String = page.split("<h2>Files that are not volumes").skip(1).collect();
                holds_no(&words, &name, rest.as_bytes());
            }
            "json" if name != "report.json" => {
                holds_no(&words, &name, &bytes);
                own(&String::from_utf8_lossy(&bytes));
            }
            _ => {}
        }
    }
    assert_eq!((models, pictures), (11, 11));

    // What stays at home says so first, and tells which is which.
    let table = fs::read_to_string(out.join("report.csv")).unwrap();
    assert!(table.starts_with("names_files_and_folders,"), "{table}");
    let whole = fs::read_to_string(out.join("report.json")).unwrap();
    assert!(whole.starts_with("{\"notice\":\"this report names files and folders"), "{whole}");
    for item in items {
        let (id, input) = (item["name"].as_str().unwrap(), item["input"].as_str().unwrap());
        let exists = Path::new(input).exists() || input.contains('\u{fffd}');
        assert!(exists && input.starts_with(&text(&top)), "{item}");
        assert!(table.lines().any(|line| line.contains(id) && line.contains(input)), "{id} in {table}");
    }
    assert!(whole.contains("Щукин_Пётр") && whole.contains("page.npy"), "{whole}");

    // A list names them, and says so, too; names are asked for in the contact sheet alone.
    let scan = oct(&["scan", &text(&top)]);
    assert!(scan.stdout.starts_with("this list names files and folders"), "{scan:?}");
    assert!(scan.stdout.contains("山田_太郎"), "{scan:?}");
    let listed = oct(&["scan", &text(&top), "--json"]).json();
    let ids = |value: &Value| -> Vec<Value> {
        value["items"].as_array().unwrap().iter().map(|item| item["name"].clone()).collect()
    };
    assert_eq!(ids(&listed), ids(&report));
    let before: Vec<String> = names(&out);
    let kept = batch(&top, &out, &["--keep-names"]);
    assert_eq!((&kept["converted"], &kept["skipped"]), (&0.into(), &11.into()), "{kept}");
    assert!(fs::read_to_string(out.join("index.html")).unwrap().contains("山田_太郎"));
    assert_eq!(names(&out), before);
    for name in before.iter().filter(|name| name.ends_with(".oct.json")) {
        holds_no(&words, name, &fs::read(out.join(name)).unwrap());
    }
}

#[test]
fn a_model_that_is_built_alone_names_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let (top, model) = (folder.path().join("in"), folder.path().join("m.oct"));
    let words = studies(&top);
    let mut inputs: Vec<Vec<PathBuf>> =
        ["page.npy", "white.npy", "Kim_Kim.nhdr"].iter().map(|name| vec![top.join(name)]).collect();
    for patient in &PATIENTS {
        let folder = top.join(format!("{}_{}", patient.folder(), patient.birth)).join(patient.accession);
        inputs.push(vec![folder.join(format!("{}_seg.nrrd", patient.folder()))]);
        inputs.push((0..3).map(|i| folder.join(format!("{}-{i}.dcm", patient.folder()))).collect());
    }
    for files in inputs {
        let files: Vec<String> = files.iter().map(|path| text(path)).collect();
        let model_name = text(&model);
        let mut args = vec!["build", "-o", &model_name, "--iso", "100", "--quiet"];
        args.extend(files.iter().map(String::as_str));
        let run = oct(&args);
        assert_eq!(run.code, 0, "{run:?}");
        holds_no(&words, "a model", &fs::read(&model).unwrap());
        let text = told(&model);
        holds_no(&words, "metadata", text.as_bytes());
        assert!(OWN_WORDS.iter().all(|word| !text.contains(word)), "{text}");
    }
}

#[test]
fn thumbnails_of_images_that_may_carry_text_are_made_on_request_only() {
    let folder = tempfile::tempdir().unwrap();
    let (top, out) = (folder.path().join("in"), folder.path().join("out"));
    let [patient, ..] = &PATIENTS;
    let kinds = [
        ("stated", (0x0028_0301, "CS", "YES")),
        ("ultrasound", (0x0008_0060, "CS", "US")),
        ("secondary_capture", (0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.7")),
        ("secondary_capture", (0x0008_0064, "CS", "WSD")),
        ("screen_capture", (0x0008_0008, "CS", "DERIVED\\SECONDARY\\SCREEN SAVE")),
        ("", (0x0028_0301, "CS", "NO")),
    ];
    for (n, (_, said)) in kinds.iter().enumerate() {
        patient.series(&top.join(n.to_string()), &format!("1.2.9.{n}"), Some(*said));
    }
    let thumbnails = |report: &Value| -> Vec<bool> {
        let items = report["items"].as_array().unwrap();
        items.iter().map(|item| item["model"]["thumbnail"].is_string()).collect()
    };
    let pictures = || names(&out).iter().filter(|name| name.ends_with(".png")).count();
    let report = batch(&top, &out, &[]);
    assert_eq!(thumbnails(&report), [false, false, false, false, false, true], "{report}");
    for (item, (kind, _)) in report["items"].as_array().unwrap().iter().zip(kinds) {
        assert_eq!(item["burned_in"].as_str().unwrap_or_default(), kind, "{item}");
    }
    // Told once.
    let warnings = report["warnings"].as_array().unwrap();
    assert_eq!((warnings.len(), pictures()), (1, 1), "{report}");
    let warning = warnings[0].as_str().unwrap();
    for words in ["5 volumes", "secondary capture: 2", "ultrasound: 1", "--thumbnails-of-all"] {
        assert!(warning.contains(words), "{warning}");
    }
    assert!(fs::read_to_string(out.join("index.html")).unwrap().contains("may carry text"));
    let asked = batch(&top, &out, &["--thumbnails-of-all"]);
    assert_eq!((thumbnails(&asked), pictures()), (vec![true; 6], 6), "{asked}");
    // Not asked for any more, they go, and the models stay.
    let again = batch(&top, &out, &[]);
    assert_eq!((thumbnails(&again), pictures()), (thumbnails(&report), 1), "{again}");
    assert_eq!(again["skipped"], 6, "{again}");
    assert_eq!(thumbnails(&batch(&top, &out, &[])), thumbnails(&report));
}
