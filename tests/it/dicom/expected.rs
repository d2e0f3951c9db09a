//! The stored values of every real file are those that another reader decoded (EXPECTED.tsv beside the
//! data): by hash where decoding leaves nothing to choose, by smallest, largest and mean value where it does
//! (JPEG's cosine transform). If this fails, a model is built from wrong numbers.

use crate::prelude::*;
use infobyte::source::dicom::{FrameGeometry, Image};
use sha2::{Digest, Sha256};

/// Hash and extent of all samples of a file.
struct Summary {
    scalar: ScalarType,
    hash: Sha256,
    low: f64,
    high: f64,
    sum: f64,
    count: u64,
}

impl Summary {
    fn new(scalar: ScalarType) -> Self {
        let (low, high) = (f64::INFINITY, f64::NEG_INFINITY);
        Self { scalar, hash: Sha256::new(), low, high, sum: 0.0, count: 0 }
    }

    fn add(&mut self, samples: &[u8]) {
        let width = self.scalar.bytes();
        for sample in samples.chunks_exact(width) {
            let value = match self.scalar {
                ScalarType::U8 => f64::from(sample[0]),
                ScalarType::I8 => f64::from(sample[0].cast_signed()),
                ScalarType::U16 => f64::from(bytemuck::pod_read_unaligned::<u16>(sample)),
                ScalarType::I16 => f64::from(bytemuck::pod_read_unaligned::<i16>(sample)),
                ScalarType::U32 => f64::from(bytemuck::pod_read_unaligned::<u32>(sample)),
                ScalarType::I32 => f64::from(bytemuck::pod_read_unaligned::<i32>(sample)),
                ScalarType::F32 => f64::from(bytemuck::pod_read_unaligned::<f32>(sample)),
                ScalarType::F64 => bytemuck::pod_read_unaligned::<f64>(sample),
            };
            (self.low, self.high) = (self.low.min(value), self.high.max(value));
            self.sum += value;
            self.count += 1;
        }
        // Native to little-endian is the same swap as back.
        let mut little = samples.to_vec();
        Endian::Little.to_native(width, &mut little);
        self.hash.update(&little);
    }

    fn hash(&self) -> String {
        self.hash.clone().finalize().iter().map(|b| format!("{b:02x}")).collect()
    }
}

impl FrameSink for Summary {
    fn row(&mut self, _frame: u32, _row: u32, samples: &[u8]) -> Result<(), SourceError> {
        self.add(samples);
        Ok(())
    }
}

fn summary(file: &File, path: &Path, header: &DicomHeader, image: &Image) -> Result<Summary, SourceError> {
    let mut summary = Summary::new(image.layout.scalar());
    match image.access {
        // What it says it needs is enough.
        Access::Unrolled => {
            unroll(file, path, header, image, &Budget::new(image.unroll_bytes()), &mut summary)?
        }
        Access::Native { offset, frame_bytes } => {
            for frame in 0..image.frames {
                let mut cells = vec![0; usize::try_from(frame_bytes).unwrap()];
                file.read_exact_at(&mut cells, offset + u64::from(frame) * frame_bytes).unwrap();
                image.layout.decode(&mut cells);
                summary.add(&cells);
            }
        }
    }
    Ok(summary)
}

/// As another reader writes the shape.
fn shape(image: &Image) -> String {
    let layout = &image.layout;
    let frames = if image.frames > 1 { format!("{}x", image.frames) } else { String::new() };
    let samples = image.row_samples() / layout.columns as usize;
    let samples = if samples > 1 { format!("x{samples}") } else { String::new() };
    format!("{frames}{}x{}{samples}", layout.rows, layout.columns)
}

#[test]
fn stored_values_of_every_file_match_another_readers() {
    let Some(list) = real_data("EXPECTED.tsv") else { return };
    let root = list.parent().unwrap().to_path_buf();
    let (mut exact, mut near, mut wrong, mut unjudged) = (0, 0, Vec::new(), Vec::new());
    let mut hashes = Vec::new();
    for line in fs::read_to_string(&list).unwrap().lines().skip(1) {
        let fields: Vec<&str> = line.split('\t').collect();
        let [name, syntax, expected_shape, _, low, high, mean, hash, ..] = fields[..] else {
            panic!("{line}")
        };
        let path = root.join(name);
        let file = File::open(&path).unwrap();
        let image = match scan(&file) {
            Ok(header) => Image::of_components(&header)
                .map(|image| (header, image))
                .map_err(|obstacle| obstacle.to_string()),
            Err(ScanError::NotDicom | ScanError::Damaged { .. }) => Err("no DICOM".to_owned()),
            Err(e) => panic!("{name}: {e}"),
        };
        let (header, image) = match image {
            Ok(found) => found,
            Err(obstacle) => {
                if !hash.is_empty() {
                    wrong.push(format!("{name}: {obstacle}"));
                }
                continue;
            }
        };
        let got = match summary(&file, &path, &header, &image) {
            Ok(got) => got,
            Err(error) if hash.is_empty() => {
                println!("{error}");
                continue;
            }
            Err(error) => {
                wrong.push(format!("{name}: {error}"));
                continue;
            }
        };
        unjudged.extend(hash.is_empty().then(|| (name.to_owned(), got.hash())));
        if hash.is_empty() {
            println!(
                "{name}: {} {} to {} ({}), which the other reader could not decode",
                shape(&image),
                got.low,
                got.high,
                got.hash()
            );
            continue;
        }
        if shape(&image) != expected_shape {
            wrong.push(format!("{name}: {} for {expected_shape}", shape(&image)));
            continue;
        }
        if got.hash() == hash {
            hashes.push((name.to_owned(), hash.to_owned()));
            exact += 1;
            continue;
        }
        let lossy = ["4.50", "4.51"].iter().any(|tail| syntax.ends_with(tail));
        #[expect(clippy::cast_precision_loss, reason = "far below 2^53")]
        let got_mean = got.sum / got.count as f64;
        let [low_off, high_off, mean_off] = [(got.low, low), (got.high, high), (got_mean, mean)]
            .map(|(got, expected)| (got - expected.parse::<f64>().unwrap()).abs());
        println!("{name}: {} {} {got_mean} for {low} {high} {mean}", got.low, got.high);
        if lossy && low_off <= 1.0 && high_off <= 1.0 && mean_off <= 0.03 {
            hashes.push((name.to_owned(), got.hash()));
            near += 1;
        } else {
            wrong.push(format!("{name}: range {low_off} and {high_off}, mean {mean_off} off"));
        }
    }
    println!("{exact} exact, {near} near");
    // What the other reader cannot decode agrees with its kin: a file whose pixels lack only their end with
    // the whole one, and the retired kinds of JPEG with the extended one: the same coefficients, only sent in
    // another order.
    let of = |list: &[(String, String)], name: &str| {
        list.iter().find(|(known, _)| known == name).map(|(_, hash)| hash.clone())
    };
    let cut = of(&unjudged, "dicom-odd/j2k-cut-short-no-pixels.dcm");
    assert_eq!(cut, of(&hashes, "multiframe/emri-10f.dcm"));
    let [spectral, progressive] = ["spectral-53", "progressive-55"]
        .map(|kind| of(&unjudged, &format!("dicom-ct-15-syntaxes/jpeg-{kind}.dcm")));
    let extended = of(&hashes, "dicom-ct-15-syntaxes/jpeg-extended-51.dcm");
    assert!(extended.is_some() && spectral == extended && progressive == extended);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(exact > 160, "only {exact} files were compared");
}

/// JPEG 2000 is said to need what its codestream and its samples take, and little more.
#[test]
fn jpeg_2000_takes_what_it_is_said_to_need() {
    let files = [
        "dicom-ct-15-syntaxes/j2k-90.dcm",
        "dicom-ct-15-syntaxes/j2k-lossy-91.dcm",
        "dicom-odd/htj2k-rgb.dcm",
    ];
    for path in files.into_iter().filter_map(real_data) {
        let file = File::open(&path).unwrap();
        let header = scan(&file).unwrap();
        let image = Image::of(&header).unwrap();
        let within = |bytes| {
            let mut all = Collected::default();
            unroll(&file, &path, &header, &image, &Budget::new(bytes), &mut all)
        };
        let needed = image.unroll_bytes();
        within(needed).unwrap();
        let refused = within(needed - (128 << 10)).expect_err("far less is not enough");
        assert!(refused.minimum_bytes().is_some(), "{refused}");
    }
}

#[test]
fn the_lossy_slice_is_the_lossless_one_but_for_its_quantisation() {
    let samples = |kind: &str| {
        let path = real_data(&format!("dicom-ct-15-syntaxes/jpeg-{kind}.dcm"))?;
        let file = File::open(&path).unwrap();
        let header = scan(&file).unwrap();
        let image = Image::of(&header).unwrap();
        let mut all = Collected::default();
        unroll(&file, &path, &header, &image, &Budget::new(image.unroll_bytes()), &mut all).unwrap();
        Some(words(&all.frames[0]))
    };
    let Some(exact) = samples("lossless-70") else { return };
    let lossy = samples("progressive-55").unwrap();
    assert_eq!((exact.len(), lossy.len()), (512 * 512, 512 * 512));
    // The lossy siblings were rescaled to fit 12 bits: HU = stored * 2.0002442 - 4047; -1024 for the lossless.
    let mut squares = 0.0;
    for (&exact, &lossy) in exact.iter().zip(&lossy) {
        let exact = f64::from(exact.cast_signed()) - 1024.0;
        squares += (f64::from(lossy).mul_add(2.000_244_2, -4047.0) - exact).powi(2);
    }
    let rms = (squares / f64::from(512 * 512)).sqrt();
    println!("RMS difference {rms} HU");
    assert!(rms < 12.0, "{rms}");
}

fn geometry(item: &str) -> Option<Vec<FrameGeometry>> {
    let file = File::open(real_data(item)?).unwrap();
    let header = scan(&file).unwrap();
    let mut frames = Vec::new();
    visit(&file, &header, &mut |frame| {
        frames.push(frame.clone());
        true
    })
    .unwrap();
    Some(frames)
}

#[test]
fn functional_groups_of_real_files_are_read() {
    if let Some(frames) = geometry("multiframe/mr-xa30-t1-96f.dcm") {
        assert_eq!(frames.len(), 96);
        let first = &frames[0];
        println!("{first:#?}\n{:?}", frames[95].position);
        assert_eq!(first.pixel_spacing, Some([2.0, 2.0]));
        assert_eq!(first.slice_thickness, Some(2.0));
        assert_eq!((first.slope, first.intercept), (Some(1.0), Some(0.0)));
        assert!(first.echo_time.is_some_and(|ms| ms > 0.5 && ms < 20.0));
        for pair in frames.windows(2) {
            let [a, b] = [&pair[0], &pair[1]].map(|frame| frame.position.unwrap());
            let step = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
            assert!((step - 2.0).abs() < 1e-3, "{step}");
            assert_eq!(pair[0].orientation, first.orientation);
        }
    }
    if let Some(frames) = geometry("multiframe/ct-enhanced-2f.dcm") {
        assert_eq!(frames.len(), 2);
        assert_eq!(frames[0].orientation, Some([-1.0, 0.0, 0.0, 0.0, 1.0, 0.0]));
        assert_eq!(frames[0].stack_id, "1");
        assert_eq!((frames[0].in_stack_position, frames[1].in_stack_position), (Some(2), Some(1)));
        let [a, b] = [&frames[0], &frames[1]].map(|frame| frame.position.unwrap());
        assert!(((a[2] - b[2]).abs() - 10.0).abs() < 1e-3, "{a:?} {b:?}");
        assert!(frames.iter().all(|frame| frame.pixel_spacing.is_some() && frame.slope.is_some()));
    }
    for item in
        ["multiframe/emri-10f.dcm", "multiframe/emri-10f-bigendian.dcm", "multiframe/emri-10f-rle.dcm"]
    {
        let Some(frames) = geometry(item) else { continue };
        assert_eq!(frames.len(), 10, "{item}");
        assert!(frames.iter().all(|frame| frame.position.is_none()), "{item}");
    }
}

/// Takes what comes.
struct Anything;

impl FrameSink for Anything {
    fn row(&mut self, _frame: u32, _row: u32, _samples: &[u8]) -> Result<(), SourceError> {
        Ok(())
    }
}

#[test]
fn damaged_real_files_end_quickly() {
    let mut random = Random(0x0123_4567_89ab_cdef);
    let mut paths = Vec::new();
    for folder in ["dicom-ct-15-syntaxes", "dicom-odd", "multiframe"] {
        let Some(folder) = real_data(folder) else { return };
        paths.extend(fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()));
    }
    paths.sort();
    let (mut tried, mut refused) = (0, 0);
    for path in paths {
        let clean = fs::read(&path).unwrap();
        for attempt in 0..30 {
            let mut bytes = clean.clone();
            if attempt < 12 {
                bytes.truncate(random.below(clean.len()));
            } else {
                for _ in 0..=random.below(8) {
                    // Some in the header and the tables, some anywhere.
                    let reach = if random.below(2) == 0 { clean.len() } else { clean.len().min(8000) };
                    bytes[random.below(reach)] = random.byte();
                }
            }
            let start = std::time::Instant::now();
            let sound = scan(&bytes[..]).ok().and_then(|header| {
                let image = Image::of(&header).ok()?;
                let mut told = 0;
                let visited = visit(&bytes[..], &header, &mut |_| {
                    told += 1;
                    told < 100_000
                });
                let memory = image.unroll_bytes().min(8 << 20);
                let unrolled =
                    unroll(&bytes[..], &path, &header, &image, &Budget::new(memory), &mut Anything);
                (visited.is_ok() && unrolled.is_ok()).then_some(())
            });
            tried += 1;
            refused += u32::from(sound.is_none());
            let took = start.elapsed();
            assert!(took.as_secs() < 5, "{}: attempt {attempt} took {took:?}", path.display());
        }
    }
    println!("{refused} of {tried} damaged files refused");
    assert!(refused > tried / 4 && refused < tried);
}
