//! Real DICOM frames in JPEG-LS and RLE give exactly the stored values that reference decoders read,
//! near-lossless ones too: their decoding leaves nothing to choose. If this fails, a published image of a
//! common scanner or archive is decoded wrongly.

use infobyte::codec::{CodecError, FrameFormat, FrameReader, RowSink, jpegls, rle};
use sha2::{Digest, Sha256};

#[path = "support/data.rs"]
mod data;

/// All that a decoder may take for one frame.
const MEMORY_BYTES: u64 = 64 << 10;

/// Hashes the samples as the file would store them.
struct Hash {
    expected: FrameFormat,
    bytes_per_sample: usize,
    rows: u32,
    stored: Sha256,
}

impl RowSink for Hash {
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        assert_eq!(format, &self.expected);
        self.rows = 0;
        Ok(())
    }

    fn row(&mut self, samples: &[i32]) -> Result<(), CodecError> {
        assert_eq!(samples.len(), self.expected.columns as usize);
        self.rows += 1;
        for sample in samples {
            self.stored.update(&sample.to_le_bytes()[..self.bytes_per_sample]);
        }
        Ok(())
    }
}

/// The frames of a file whose compressed frames have one fragment each.
fn frames(file: &[u8]) -> Vec<Vec<u8>> {
    // OB by the standard, OW in some of these files.
    let pixels =
        |window: &[u8]| window.starts_with(b"\xE0\x7F\x10\x00O") && window[6..] == *b"\0\0\xFF\xFF\xFF\xFF";
    let mut at = file.windows(12).position(pixels).unwrap() + 12;
    let mut items = Vec::new();
    while file[at..at + 4] == *b"\xFE\xFF\x00\xE0" {
        let length = u32::from_le_bytes(file[at + 4..at + 8].try_into().unwrap()) as usize;
        items.push(file[at + 8..at + 8 + length].to_vec());
        at += 8 + length;
    }
    // The first item is the table of offsets.
    items.split_off(1)
}

/// Decodes all frames of a file, and compares the stored values with the table of expected ones.
fn compare(item: &str, columns: u32, rows: u32, bits: u8) {
    let Some(path) = data::real_data(item) else { return };
    let bytes = std::fs::read(&path).unwrap();
    let Some(table) = data::real_data("EXPECTED.tsv") else { return };
    let table = std::fs::read_to_string(table).unwrap();
    let line: Vec<&str> = table
        .lines()
        .map(|line| line.split('\t').collect())
        .find(|line: &Vec<&str>| line[0] == item)
        .unwrap();
    let is_rle = line[1] == "1.2.840.10008.1.2.5";
    let bytes_per_sample = bits.div_ceil(8);
    let precision = if is_rle { 8 * bytes_per_sample } else { bits };
    let expected = FrameFormat { columns, rows, components: 1, precision, signed: false };
    let mut hash =
        Hash { expected, bytes_per_sample: bytes_per_sample.into(), rows: 0, stored: Sha256::new() };
    let frames = frames(&bytes);
    assert!(!frames.is_empty());
    for frame in &frames {
        if is_rle {
            let format = rle::RleFormat { columns, rows, components: 1, bytes_per_sample };
            rle::decode(frame, &format, &mut hash).unwrap();
        } else {
            jpegls::decode(&mut FrameReader::new(frame), MEMORY_BYTES, &mut hash).unwrap();
        }
        assert_eq!(hash.rows, rows, "{item}");
    }
    let stored: String = hash.stored.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(stored, line[7], "{item}");
    println!("{item}: {} frames as expected", frames.len());
}

#[test]
fn jpeg_ls_frames_have_the_reference_values() {
    compare("dicom-ct-15-syntaxes/jpegls-80.dcm", 512, 512, 16);
    compare("dicom-ct-15-syntaxes/jpegls-lossy-81.dcm", 512, 512, 16);
    compare("dicom-odd/jpegls-near-16.dcm", 10, 50, 16);
    compare("multiframe/emri-10f-jpegls.dcm", 64, 64, 16);
    for number in 1..=4 {
        compare(&format!("mr-encodings/jpeg-ls/IM-0001-000{number}-0001.dcm"), 256, 256, 16);
    }
}

#[test]
fn rle_frames_have_the_reference_values() {
    compare("dicom-ct-15-syntaxes/rle.dcm", 512, 512, 16);
    compare("dicom-odd/no-pixel-spacing.dcm", 800, 600, 8);
    compare("multiframe/emri-10f-rle.dcm", 64, 64, 16);
    for number in 1..=4 {
        compare(&format!("mr-encodings/rle/IM-0001-000{number}-0001.dcm"), 256, 256, 16);
    }
}
