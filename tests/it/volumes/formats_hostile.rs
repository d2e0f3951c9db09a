//! Whatever is cut off or changed in the file of a volume or its side-car, reading it ends in a volume or a
//! sentence: no panic, no hang, no memory beyond what was allowed. If this fails, one bad file on a disk stops a
//! whole batch.

use crate::prelude::*;
use infobyte::discovery::open_unprepared as open;

use crate::common::formats::bzip2;

/// What unrolling may hold.
const ALLOWED: u64 = 3 << 20;

/// What the process may grow by: that, file names, and what the allocator keeps of it.
const GROWTH: u64 = 8 << 20;

const SLOWEST: Duration = Duration::from_secs(5);

/// Opens, unrolls and reads a little; the refusal if there is one.
fn read(path: &Path, scratch: &Path) -> Result<(), String> {
    let mut source = open(&[path.to_path_buf()], &OpenOptions::default()).map_err(|e| e.to_string())?;
    let workspace = Workspace { scratch, memory: Budget::new(ALLOWED), progress: &Silent };
    source.prepare(&workspace).map_err(|e| e.to_string())?;
    let (dims, width) = (source.info().dims, source.info().scalar.bytes());
    let rows = 0..dims.ny().min(3);
    let mut out = vec![0; rows.len() * dims.nx() as usize * width];
    for z in [0, dims.nz() / 2, dims.nz() - 1] {
        source.read_rows(z, rows.clone(), 0..dims.nx(), &mut out).map_err(|e| e.to_string())?;
    }
    Ok(())
}

/// Cuts `bytes` at 200 places and changes bytes 1,000 times, mostly in the head.
fn torment(folder: &Path, name: &str, bytes: &[u8]) {
    let mut random = Random(name.len() as u64 + bytes.len() as u64);
    let path = file(folder, name, bytes);
    read(&path, folder).unwrap_or_else(|e| panic!("{name}, unchanged: {e}"));
    let (before, mut refused, mut slowest) = (current_rss_bytes(), 0, Duration::ZERO);
    let mut case = |bytes: &[u8], what: &str| {
        fs::write(&path, bytes).unwrap();
        let started = Instant::now();
        if let Err(sentence) = read(&path, folder) {
            refused += 1;
            assert!(!sentence.contains('\n') && sentence.len() > 20, "{name}, {what}: {sentence}");
        }
        slowest = slowest.max(started.elapsed());
        assert!(slowest < SLOWEST, "{name}, {what}: {slowest:?}");
    };
    for n in 0..200 {
        let length = if n < 100 { n * bytes.len() / 100 } else { (n - 100) * 4 }.min(bytes.len());
        case(&bytes[..length], &format!("{length} bytes"));
    }
    for n in 0..1000 {
        let mut changed = bytes.to_vec();
        let mut what = String::new();
        for _ in 0..=random.below(3) {
            let reach = [bytes.len(), 96, 600, 600][n % 4].min(bytes.len());
            let at = random.below(reach);
            // Directories of TIFF stand at the end of a slice.
            let at = if n % 8 == 3 { bytes.len() - 1 - at } else { at };
            let new = [random.byte(), 0xff, 0, 0x39, bytes[at] ^ (1 << random.below(8))][n % 5];
            changed[at] = new;
            what += &format!("byte {at} = {new} ");
        }
        case(&changed, &what);
    }
    let growth = peak_rss_bytes().saturating_sub(before);
    assert!(growth <= GROWTH, "{name}: {growth} bytes of memory");
    assert!(refused >= 100, "{name}: {refused} refusals");
    println!(
        "{name}: {refused} of 1200 refused, slowest {slowest:?}, {growth} bytes of memory at most so far"
    );
    fs::remove_file(path).unwrap();
}

#[test]
fn cut_and_changed_files_of_every_format_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new([17, 9, 6], ScalarType::I16, [0.5, 1.0, 2.0]);
    for encoding in ["raw", "gzip", "bzip2", "ascii", "hex"] {
        torment(at, &format!("{encoding}.nrrd"), &nrrd(&object, encoding, false, ""));
    }
    for version in [1, 2] {
        let whole = [nifti(&object, version, version == 2, true, 1), object.bytes.clone()].concat();
        torment(at, &format!("v{version}.nii"), &whole);
        torment(at, &format!("v{version}.nii.gz"), &gzip(&whole));
    }
    let local = |packed, body: &[u8]| [&metaimage(&object, false, packed, "LOCAL")[..], body].concat();
    torment(at, "v.mha", &local(false, &object.bytes));
    torment(at, "z.mha", &local(true, &zlib(&object.bytes)));
    for version in [1, 2, 3] {
        torment(at, &format!("v{version}.npy"), &npy(&object, version, false, version == 3));
    }
    for (compression, predictor, tile, big_tiff) in [
        (1, 1, None, false),
        (1, 1, Some([16, 16]), false),
        (5, 2, None, true),
        (8, 2, Some([16, 16]), false),
        (32773, 1, None, false),
    ] {
        let how = Tiff { compression, predictor, tile, big_tiff, strip: 4, ..Tiff::default() };
        torment(at, &format!("{compression}-{big_tiff}.tif"), &how.write(&object));
    }
    for scalar in [ScalarType::U8, ScalarType::U16] {
        let object = Object::new([40, 30, 1], scalar, [1.0; 3]);
        let picture = pngs(&object, &at.join("png")).swap_remove(0);
        torment(at, &format!("{scalar}.png"), &fs::read(picture).unwrap());
    }
}

/// The same for headers whose samples lie elsewhere.
#[test]
fn cut_and_changed_headers_of_detached_files_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new([17, 9, 6], ScalarType::I16, [0.5, 1.0, 2.0]);
    for (z, slice) in object.bytes.chunks(object.slice_bytes()).enumerate() {
        file(at, &format!("s{z}.raw"), slice);
        file(at, &format!("s{z}.gz"), &gzip(slice));
    }
    torment(at, "p.nhdr", &nrrd(&object, "gzip", false, "data file: s%d.gz 0 5 1\n"));
    let list: String = (0..6).map(|z| format!("s{z}.raw\n")).collect();
    torment(at, "l.nhdr", &nrrd(&object, "raw", false, &format!("data file: LIST\n{list}")));
    torment(at, "p.mhd", &metaimage(&object, false, false, "s%d.raw 0 5 1"));
    file(at, "v.img", &object.bytes);
    torment(at, "v.hdr", &nifti(&object, 1, false, false, 1));
}

/// The same for the texts that describe headerless voxels.
#[test]
fn cut_and_changed_side_cars_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new([17, 9, 6], ScalarType::I16, [0.5, 1.0, 2.0]);
    file(at, "v.raw", &[&[0; 32][..], &object.bytes].concat());
    let json = r#"{"dims": [17, 9, 6], "dtype": "i16le", "spacing": [0.5, 1.0, 2.0], "skip": 32,
                   "orientation": "LPS", "file": "v.raw", "note": {"a": [1, "b"]}}"#;
    torment(at, "v.json", json.as_bytes());
    let toml = "# voxels\ndims = [17,\n 9, # rows\n 6]\ndtype = 'i16le'\nspacing = \"0.5x1x2\"\nskip = 32\n\
                orientation = \"RAS\"\nfile = \"v.raw\"\n[other]\nskip = 1\n";
    torment(at, "v.toml", toml.as_bytes());
}

#[test]
fn headers_that_promise_the_world_are_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let object = Object::new([17, 9, 6], ScalarType::I16, [1.0; 3]);
    let swell = |bytes: Vec<u8>, from: &str, to: &str| {
        let text = String::from_utf8_lossy(&bytes).into_owned();
        assert!(text.contains(from), "{text}");
        text.replace(from, to).into_bytes()
    };
    let wide = "sizes: 65536 65536 65536";
    let giant = Object { dims: [65_000; 3], ..object.clone() };
    let cases: Vec<(PathBuf, &str)> = vec![
        (file(at, "a.nrrd", &swell(nrrd(&object, "ascii", false, ""), "sizes: 17 9 6", wide)), "can hold"),
        (file(at, "b.nrrd", &swell(nrrd(&object, "hex", false, ""), "sizes: 17 9 6", wide)), "can hold"),
        (file(at, "c.nrrd", &swell(nrrd(&object, "raw", false, ""), "sizes: 17 9 6", wide)), "promises"),
        (
            file(
                at,
                "d.nii.gz",
                &gzip(&nifti(&Object { dims: [32_000; 3], ..object.clone() }, 1, false, true, 9)),
            ),
            "can hold",
        ),
        (file(at, "e.nii", &nifti(&giant, 2, false, true, 2000)), "promises"),
        (file(at, "f.npy", &npy(&giant, 1, false, false)), "promises"),
        (file(at, "g.nrrd", &[b"NRRD0004\n".to_vec(), vec![b'x'; 300_000]].concat()), "no end"),
        (
            file(at, "h.mha", &[b"ObjectType = Image\nComment = ".to_vec(), vec![b'x'; 300_000]].concat()),
            "no end",
        ),
        (
            file(
                at,
                "i.nrrd",
                &[&b"NRRD0004\n"[..], &b"data file: LIST\n"[..], &b"a\n".repeat(400_000)].concat(),
            ),
            "more than 65536",
        ),
    ];
    let before = current_rss_bytes();
    for (path, words) in cases {
        let started = Instant::now();
        let refused = read(&path, at).unwrap_err();
        assert!(refused.contains(words), "{refused}");
        assert!(started.elapsed() < Duration::from_secs(1), "{refused}: {:?}", started.elapsed());
    }
    assert!(peak_rss_bytes().saturating_sub(before) < GROWTH);
    // Pages in a circle: the last directory of a TIFF file points to the first.
    let mut circle = Tiff::default().write(&object);
    let first = circle[4..8].to_vec();
    let end = circle.len();
    circle[end - 4..].copy_from_slice(&first);
    let refused = read(&file(at, "circle.tif", &circle), at).unwrap_err();
    assert!(refused.contains("circle"), "{refused}");
    // Bzip2 of zeros swells most.
    let zeros = Object { dims: [512, 512, 4], bytes: Vec::new(), ..object };
    let bomb = [nrrd(&zeros, "bzip2", false, "\n"), bzip2(&vec![0; 1 << 20])].concat();
    let refused = read(&file(at, "bomb.nrrd", &bomb), at).unwrap_err();
    assert!(
        refused.contains("the header promises 2097152 bytes, the bzip2 stream ends after 1048576"),
        "{refused}"
    );
}
