//! JPEG frames of real DICOM files, decoded by the codec alone: lossless ones to the sample, DCT ones to what
//! another decoder's rounding allows. If this fails, compressed series come out wrong or not at all.

use std::fs;

use infobyte::codec::{CodecError, FrameFormat, RowSink, jpeg};
use sha2::{Digest, Sha256};

#[path = "support/data.rs"]
mod data;
use data::real_data;

/// What every frame of the data decodes in; the progressive ones need 512 KiB and a little more.
const STREAMED_BYTES: u64 = 64 << 10;
const WHOLE_BYTES: u64 = 600 << 10;

#[derive(Default)]
struct Kept {
    precision: u8,
    samples: Vec<u16>,
}

impl RowSink for Kept {
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        assert_eq!(format.components, 1);
        self.precision = format.precision;
        Ok(())
    }

    fn row(&mut self, samples: &[i32]) -> Result<(), CodecError> {
        self.samples.extend(samples.iter().map(|&s| u16::try_from(s).unwrap()));
        Ok(())
    }
}

/// Codestreams of the encapsulated pixels: the last element, OB or OW in explicit little endian, of undefined
/// length. A fragment that begins with SOI begins a frame.
fn frames(file: &[u8]) -> Vec<Vec<u8>> {
    let begins = |w: &[u8]| w.starts_with(b"\xE0\x7F\x10\x00O") && w.ends_with(b"\0\0\xFF\xFF\xFF\xFF");
    let mut at = file.windows(12).position(begins).expect("encapsulated pixels") + 12;
    let mut frames: Vec<Vec<u8>> = Vec::new();
    let mut first = true;
    while file[at..at + 4] == *b"\xFE\xFF\x00\xE0" {
        let length = u32::from_le_bytes(file[at + 4..at + 8].try_into().unwrap()) as usize;
        let fragment = &file[at + 8..at + 8 + length];
        // The first item is the offset table.
        if !std::mem::take(&mut first) {
            if fragment.starts_with(&[0xFF, 0xD8]) {
                frames.push(Vec::new());
            }
            frames.last_mut().expect("a first frame").extend(fragment);
        }
        at += 8 + length;
    }
    frames
}

/// The samples of a file, all frames behind one another.
fn decoded(item: &str, memory_bytes: u64) -> Option<Kept> {
    let file = fs::read(real_data(item)?).unwrap();
    let mut kept = Kept::default();
    for frame in frames(&file) {
        jpeg::decode(&mut &frame[..], memory_bytes, &mut kept).unwrap_or_else(|e| panic!("{item}: {e}"));
    }
    Some(kept)
}

/// The columns of EXPECTED.tsv for a file, from the type on: type, smallest, largest, mean, SHA-256.
fn expected(item: &str) -> Vec<String> {
    let list = fs::read_to_string(real_data("EXPECTED.tsv").expect("EXPECTED.tsv")).unwrap();
    let row = list.lines().find(|line| line.split('\t').next() == Some(item)).expect(item);
    row.split('\t').skip(3).map(str::to_owned).collect()
}

#[test]
fn lossless_frames_are_exact() {
    let mr = (1..=4).map(|i| format!("mr-encodings/jpeg-lossless/IM-0001-000{i}-0001.dcm"));
    let others = ["ct-15-syntaxes/jpeg-lossless-57", "ct-15-syntaxes/jpeg-lossless-70"];
    let others = others.into_iter().chain(["odd/bad-sequence-jpeg-lossless"]);
    for item in others.map(|name| format!("dicom-{name}.dcm")).chain(mr) {
        let Some(kept) = decoded(&item, STREAMED_BYTES) else { return };
        assert_eq!(kept.precision, 16);
        let bytes: Vec<u8> = kept.samples.iter().flat_map(|s| s.to_le_bytes()).collect();
        let hash: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(hash, expected(&item)[4], "{item}");
    }
}

#[test]
fn dct_frames_have_the_range_and_mean_of_another_decoder() {
    for (item, precision) in [
        ("dicom-ct-15-syntaxes/jpeg-baseline-50.dcm", 8),
        ("dicom-ct-15-syntaxes/jpeg-extended-51.dcm", 12),
        ("multiframe/ct-2f-fragmented-no-bot-jpeg12.dcm", 12),
    ] {
        let Some(kept) = decoded(item, STREAMED_BYTES) else { return };
        assert_eq!(kept.precision, precision);
        let expected: Vec<f64> = expected(item)[1..4].iter().map(|n| n.parse().unwrap()).collect();
        let samples = || kept.samples.iter().map(|&s| f64::from(s));
        let mean = samples().sum::<f64>() / kept.samples.len() as f64;
        let (low, high) = (samples().fold(f64::MAX, f64::min), samples().fold(0.0, f64::max));
        println!("{item}: {low} to {high}, mean {mean}, against {expected:?}");
        assert!((low - expected[0]).abs() <= 1.0 && (high - expected[1]).abs() <= 1.0);
        assert!((mean - expected[2]).abs() <= 0.03);
    }
}

#[test]
fn the_retired_syntaxes_hold_the_same_image_as_the_extended_one() {
    // The same slice with the same steps of quantisation, its coefficients only sent in another order.
    let folder = "dicom-ct-15-syntaxes";
    let Some(extended) = decoded(&format!("{folder}/jpeg-extended-51.dcm"), STREAMED_BYTES) else { return };
    for name in ["jpeg-spectral-53", "jpeg-progressive-55"] {
        let kept = decoded(&format!("{folder}/{name}.dcm"), WHOLE_BYTES).unwrap();
        assert_eq!(kept.samples.len(), 512 * 512);
        assert!(kept.samples == extended.samples, "{name}");
    }
}

#[test]
fn the_lossy_slice_is_the_lossless_one_but_for_its_quantisation() {
    // The lossy siblings were rescaled to fit 12 bits: HU = stored * 2.0002442 - 4047; -1024 for the lossless.
    let folder = "dicom-ct-15-syntaxes";
    let Some(exact) = decoded(&format!("{folder}/jpeg-lossless-70.dcm"), STREAMED_BYTES) else { return };
    let lossy = decoded(&format!("{folder}/jpeg-progressive-55.dcm"), WHOLE_BYTES).unwrap();
    let mut squares = 0.0;
    for (&exact, &lossy) in exact.samples.iter().zip(&lossy.samples) {
        let exact = f64::from(exact.cast_signed()) - 1024.0;
        squares += (f64::from(lossy).mul_add(2.000_244_2, -4047.0) - exact).powi(2);
    }
    let rms = (squares / exact.samples.len() as f64).sqrt();
    println!("RMS difference {rms} HU");
    assert!(rms < 12.0, "{rms}");
}

#[test]
fn real_frames_cut_short_are_refused() {
    for item in ["jpeg-extended-51", "jpeg-progressive-55", "jpeg-lossless-57"] {
        let Some(path) = real_data(&format!("dicom-ct-15-syntaxes/{item}.dcm")) else { return };
        let frame = frames(&fs::read(path).unwrap()).swap_remove(0);
        for cut in 0..40 {
            let short = &frame[..(frame.len() - 4) * cut / 39];
            let result = jpeg::decode(&mut &short[..], WHOLE_BYTES, &mut Kept::default());
            assert!(matches!(result, Err(CodecError::Damaged(_))), "{item}, {} bytes", short.len());
        }
    }
}
