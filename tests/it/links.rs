//! A header that came from elsewhere names its data, and no link may make that any file of the disk; folders that
//! links lead to are counted, not passed over in silence. If this fails, an archive that was sent makes a model of
//! files that its receiver can read and its sender cannot.

use crate::prelude::*;

/// A folder of headers whose data are links, and beside it the data.
fn headers(top: &Path, target: &Path) -> Vec<(PathBuf, &'static str)> {
    let folder = top.join("sent");
    fs::create_dir(&folder).unwrap();
    let write = |name: &str, text: &[u8]| fs::write(folder.join(name), text).unwrap();
    let link = |name| symlink(target, folder.join::<&str>(name)).unwrap();
    write(
        "a.nhdr",
        b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: a.raw\n\n",
    );
    write("b.mhd", b"NDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\nElementDataFile = b.bin\n");
    write("c.json", br#"{"dims": [4, 4, 4], "dtype": "u8", "file": "c.dat"}"#);
    let mut head = vec![0; 348];
    head[..4].copy_from_slice(&348_i32.to_le_bytes());
    for (at, n) in [3_i16, 4, 4, 4, 1, 1, 1, 1].into_iter().enumerate() {
        head[40 + 2 * at..42 + 2 * at].copy_from_slice(&n.to_le_bytes());
    }
    head[70] = 2;
    head[344..348].copy_from_slice(b"ni1\0");
    write("d.hdr", &head);
    // A folder of the name that leads elsewhere.
    write(
        "e.nhdr",
        b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: sub/x.raw\n\n",
    );
    ["a.raw", "b.bin", "c.dat", "d.img"].into_iter().for_each(link);
    symlink(target.parent().unwrap(), folder.join("sub")).unwrap();
    [
        ("a.nhdr", "a.raw"),
        ("b.mhd", "b.bin"),
        ("c.json", "c.dat"),
        ("d.hdr", "d.img"),
        ("e.nhdr", "sub/x.raw"),
    ]
    .map(|(header, data)| (folder.join(header), data))
    .into()
}

fn samples() -> Vec<u8> {
    (0..64).map(|i| if i % 5 == 0 { 200 } else { 1 }).collect()
}

#[test]
fn data_that_a_link_leads_out_of_the_folder_is_not_read() {
    let top = tempfile::tempdir().unwrap();
    let secret = top.path().join("private");
    fs::create_dir(&secret).unwrap();
    let target = secret.join("x.raw");
    fs::write(&target, samples()).unwrap();
    let model = text(&top.path().join("m.oct"));
    for (header, data) in headers(top.path(), &target) {
        let build =
            |extra: &[&str]| oct(&[&["build", &text(&header), "-o", &model, "--iso", "100"], extra].concat());
        build(&[]).refused(3, &[data, "a link that leads out of the folder", "--follow-links"]);
        assert!(!Path::new(&model).exists());
        let followed = build(&["--follow-links"]);
        assert_eq!(followed.code, 0, "{header:?}: {followed:?}");
        fs::remove_file(&model).unwrap();
    }
}

#[test]
fn links_within_the_folder_and_to_where_the_header_lies_are_no_matter() {
    let top = tempfile::tempdir().unwrap();
    let real = top.path().join("archive");
    let farm = top.path().join("farm");
    fs::create_dir_all(real.join("data")).unwrap();
    fs::create_dir(&farm).unwrap();
    fs::write(real.join("data/x.raw"), samples()).unwrap();
    symlink("data/x.raw", real.join("a.raw")).unwrap();
    let head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: a.raw\n\n";
    fs::write(real.join("a.nhdr"), head).unwrap();
    // A folder of links to an archive: header and data lie together in truth.
    for name in ["a.nhdr", "a.raw"] {
        symlink(real.join(name), farm.join(name)).unwrap();
    }
    for folder in [&real, &farm] {
        let model = text(&top.path().join("m.oct"));
        let run = oct(&["build", &text(&folder.join("a.nhdr")), "-o", &model, "--iso", "100"]);
        assert_eq!(run.code, 0, "{run:?}");
    }
}

#[test]
fn linked_folders_are_counted_or_followed_and_never_in_circles() {
    let top = tempfile::tempdir().unwrap();
    let (searched, elsewhere) = (top.path().join("searched"), top.path().join("elsewhere"));
    fs::create_dir_all(searched.join("deeper")).unwrap();
    fs::create_dir(&elsewhere).unwrap();
    let mut nrrd = b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\n".to_vec();
    nrrd.extend(samples());
    fs::write(elsewhere.join("a.nrrd"), nrrd).unwrap();
    symlink(&elsewhere, searched.join("linked")).unwrap();
    symlink(&searched, searched.join("deeper/circle")).unwrap();
    symlink(&elsewhere, elsewhere.join("itself")).unwrap();
    let scan = |extra: &[&str]| oct(&[&["scan", &text(&searched), "--json"], extra].concat()).json();
    let found = scan(&[]);
    assert_eq!(found["items"].as_array().unwrap().len(), 0, "{found}");
    let left = &found["left_out"][0];
    assert_eq!(left["count"].as_u64(), Some(2), "{found}");
    assert!(left["reason"].as_str().unwrap().contains("link"), "{found}");
    let found = scan(&["--follow-links"]);
    assert_eq!(found["items"].as_array().unwrap().len(), 1, "{found}");
    assert_eq!(found["left_out"][0]["count"].as_u64(), Some(2), "{found}");
}
