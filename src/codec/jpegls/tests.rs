//! Round trips, the standard's example, streams of another encoder, and damage.

use super::super::kept::Kept;
use super::encoder::{Options, encode};
use super::parameters::Preset;
use super::*;
use crate::random::Random;

/// Enough for every test image.
const ENOUGH_BYTES: u64 = 1 << 20;

/// Hands out at most `step` bytes at a time.
struct Trickle<'a>(&'a [u8], usize);

impl Read for Trickle<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.1.min(buffer.len());
        let taken = self.0.read(&mut buffer[..count])?;
        self.1 = self.1 % 7 + 1;
        Ok(taken)
    }
}

fn decoded(stream: &[u8]) -> Result<Kept, CodecError> {
    let mut kept = Kept::default();
    decode(&mut &*stream, ENOUGH_BYTES, &mut kept).map(|()| kept)
}

/// Noise, ramps with noise, runs, or one value.
fn plane(random: &mut Random, kind: u64, columns: usize, rows: usize, most: u64) -> Vec<u16> {
    let mut value = random.below(most + 1);
    (0..columns * rows)
        .map(|i| {
            let (x, y) = ((i % columns) as u64, (i / columns) as u64);
            value = match kind {
                0 => random.below(most + 1),
                1 => (x * 5 + y * 3 + random.below(4)) % (most + 1),
                2 if random.below(9) == 0 => random.below(most + 1),
                3 => [0, most][random.below(2_usize)],
                _ => value,
            };
            value as u16
        })
        .collect()
}

/// Encodes, decodes through reads of odd lengths, and compares; returns the stream.
fn round_trip(options: &Options, random: &mut Random) -> Vec<u8> {
    let most = match options.preset {
        Some(Preset { maximum, .. }) if maximum > 0 => u64::from(maximum),
        _ => (1 << options.precision) - 1,
    };
    let kind = random.below(5);
    let planes: Vec<Vec<u16>> =
        (0..options.components).map(|_| plane(random, kind, options.columns, options.rows, most)).collect();
    let (stream, expected) = encode(options, &planes);
    for (before, after) in planes.iter().flatten().zip(expected.iter().flatten()) {
        assert!(before.abs_diff(*after) <= u16::from(options.near), "the encoder keeps its bound");
    }
    let mut kept = Kept::default();
    decode(&mut Trickle(&stream, 3), ENOUGH_BYTES, &mut kept)
        .unwrap_or_else(|e| panic!("{options:?} kind {kind}: {e}"));
    assert_eq!(kept.rows.len(), options.rows);
    for (y, row) in kept.rows.iter().enumerate() {
        for (i, &sample) in row.iter().enumerate() {
            let (x, component) = (i / options.components, i % options.components);
            let wanted = i32::from(expected[component][y * options.columns + x]);
            assert_eq!(sample, wanted, "{options:?} kind {kind} at {x}, {y}");
        }
    }
    stream
}

#[test]
fn the_example_of_the_standard() {
    // T.87 annex H.3: an image of 4 x 4 samples of 8 bits.
    let stream = [
        0xFF, 0xD8, 0xFF, 0xF7, 0x00, 0x0B, 0x08, 0x00, 0x04, 0x00, 0x04, 0x01, 0x01, 0x11, 0x00, 0xFF, 0xDA,
        0x00, 0x08, 0x01, 0x01, 0x00, 0x00, 0x00, 0x00, 0xC0, 0x00, 0x00, 0x6C, 0x80, 0x20, 0x8E, 0x01, 0xC0,
        0x00, 0x00, 0x57, 0x40, 0x00, 0x00, 0x6E, 0xE6, 0x00, 0x00, 0x01, 0xBC, 0x18, 0x00, 0x00, 0x05, 0xD8,
        0x00, 0x00, 0x91, 0x60, 0xFF, 0xD9,
    ];
    let image: [[i32; 4]; 4] = [[0, 0, 90, 74], [68, 50, 43, 205], [64, 145, 145, 145], [100, 145, 145, 145]];
    assert_eq!(decoded(&stream).unwrap().rows, image);
    let plane = image.as_flattened().iter().map(|&sample| sample as u16).collect();
    assert_eq!(encode(&Options::new(4, 4, 8, 0), &[plane]).0, stream, "and so does the encoder of the tests");
}

#[test]
fn round_trips_over_sizes_precisions_and_bounds() {
    let mut random = Random(1);
    for (columns, rows) in [(1, 1), (1, 2), (2, 1), (1, 60), (300, 1), (2, 3), (5, 4), (31, 17), (130, 9)] {
        for precision in 2..=16 {
            for near in [0, 1, 2, 3, 5, 40, 255] {
                if u32::from(near) <= ((1_u32 << precision) - 1) / 2 {
                    for _ in 0..3 {
                        round_trip(&Options::new(columns, rows, precision, near), &mut random);
                    }
                }
            }
        }
    }
}

#[test]
fn round_trips_with_components_presets_restarts_and_large_sizes() {
    let mut random = Random(2);
    for turn in 0..600 {
        let mut options = Options::new(
            1 + random.below(40_usize),
            1 + random.below(30_usize),
            2 + random.below(15_u8),
            random.below(3_u8),
        );
        options.components = 1 + random.below(4_usize);
        options.by_line = random.below(2) == 1;
        options.restart_lines = [0, 1, 3, 20][random.below(4_usize)];
        options.oversize = random.below(3) == 0;
        if turn % 2 == 0 {
            let maximum = 7 + random.below((1_u32 << options.precision.max(3)) - 7);
            options.precision = options.precision.max(3);
            let first = 3 + random.below(2_u32);
            let last = maximum.min(first + 1 + random.below(60_u32));
            options.preset =
                Some(Preset { maximum, thresholds: [first, first, last], reset: 3 + random.below(200_u32) });
        }
        options.near = options.near.min(if options.precision == 2 { 1 } else { 2 });
        round_trip(&options, &mut random);
    }
}

#[test]
fn a_colour_stream_of_charls_in_each_interleave_mode() {
    // Made with CharLS by scripts/make_jpegls_vectors.py.
    let image = vectors::pixels();
    for stream in [vectors::BY_PLANE, vectors::BY_LINE, vectors::BY_SAMPLE] {
        let kept = decoded(stream).unwrap();
        assert_eq!(kept.rows.concat(), image);
    }
    let near = decoded(vectors::BY_SAMPLE_NEAR).unwrap();
    assert_eq!(near.rows.concat(), vectors::BY_SAMPLE_NEAR_PIXELS.map(i32::from));
}

#[test]
fn planes_of_separate_scans_count_against_the_memory() {
    let mut options = Options::new(50, 40, 12, 0);
    options.components = 3;
    let stream = round_trip(&options, &mut Random(3));
    let planes = 2 * 50 * 40 * 2;
    let lines = 5 * 52 + 4 * 3 * 50;
    let allowed = FIXED_BYTES + planes + lines;
    assert!(decode(&mut &stream[..], allowed, &mut Kept::default()).is_ok());
    match decode(&mut &stream[..], allowed - 1, &mut Kept::default()) {
        Err(CodecError::Memory { needed_bytes, allowed_bytes }) => {
            assert_eq!((needed_bytes, allowed_bytes), (allowed, allowed - 1));
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn sizes_that_nobody_accepted_cost_nothing() {
    // 4 G x 4 G, and lines of 4 G that the receiver would take.
    struct Anything;
    impl RowSink for Anything {
        fn begin(&mut self, _: &FrameFormat) -> Result<(), CodecError> {
            Ok(())
        }
        fn row(&mut self, _: &[i32]) -> Result<(), CodecError> {
            Ok(())
        }
    }
    for (components, kind) in [(1, 0), (3, 0), (3, 1)] {
        let mut stream = vec![0xFF, 0xD8, 0xFF, 0xF7, 0, 8 + 3 * components, 16, 0, 0, 0, 0, components];
        for component in 0..components {
            stream.extend([component, 0x11, 0]);
        }
        stream.extend([0xFF, 0xF8, 0, 12, 4, 4]);
        stream.extend([0xFF; 8]);
        let scanned = if kind == 0 { 1 } else { components };
        stream.extend([0xFF, 0xDA, 0, 6 + 2 * scanned, scanned]);
        for component in 0..scanned {
            stream.extend([component, 0]);
        }
        stream.extend([0, kind, 0, 0, 0, 0xFF, 0xD9]);
        assert!(matches!(decoded(&stream), Err(CodecError::Unsupported(_))), "the receiver refuses");
        let result = decode(&mut &stream[..], ENOUGH_BYTES, &mut Anything);
        assert!(matches!(result, Err(CodecError::Memory { .. })), "{result:?}");
    }
}

#[test]
fn what_is_not_decoded_is_named() {
    let (stream, _) = encode(&Options::new(3, 2, 8, 0), &[vec![1, 2, 3, 4, 5, 6]]);
    let refused = |at: usize, bytes: &[u8], name: &str| {
        let mut changed = stream.clone();
        changed.splice(at..at, bytes.iter().copied());
        match decoded(&changed) {
            Err(CodecError::Unsupported(what)) => assert!(what.to_string().contains(name), "{what}"),
            other => panic!("{name}: {:?}", other.map(|kept| kept.rows)),
        }
    };
    refused(2, &[0xFF, 0xF8, 0, 6, 2, 1, 1, 0], "mapping tables");
    refused(2, &[0xFF, 0xE8, 0, 7, b'm', b'r', b'f', b'x', 1], "colour transform 1");
    refused(2, &[0xFF, 0xC3, 0, 11], "SOF3");
    let mut other = stream.clone();
    other[24] = 1; // the last byte of the scan header
    assert!(
        matches!(decoded(&other), Err(CodecError::Unsupported(what)) if what.to_string().contains("point transform"))
    );
    // Application data and comments of no meaning are passed over.
    let mut more = stream.clone();
    more.splice(2..2, [0xFF, 0xE8, 0, 7, b'm', b'r', b'f', b'x', 0, 0xFF, 0xFF, 0xFE, 0, 3, 9]);
    assert_eq!(decoded(&more).unwrap().rows, [[1, 2, 3], [4, 5, 6]]);
}

#[test]
fn every_truncation_is_an_error() {
    let mut random = Random(5);
    for near in [0, 2] {
        let mut options = Options::new(23, 19, 12, near);
        options.restart_lines = 5;
        options.components = 2;
        let stream = round_trip(&options, &mut random);
        let whole = decoded(&stream).unwrap().rows;
        for length in 0..stream.len() - 2 {
            match decoded(&stream[..length]) {
                Err(CodecError::Damaged(_)) => {}
                Err(other) => panic!("{length}: {other}"),
                // Cutting the padding in the last byte does no harm.
                Ok(kept) => assert!(length + 4 > stream.len() && kept.rows == whole, "{length}"),
            }
        }
    }
}

#[test]
fn no_change_of_bytes_makes_it_panic() {
    let mut random = Random(6);
    let mut failed = 0;
    for turn in 0..200 {
        let mut options = Options::new(20, 20, 2 + random.below(15_u8), 0);
        options.near = random.below(2_u8);
        options.components = 1 + turn % 3;
        options.by_line = turn % 2 == 0;
        options.restart_lines = [0, 6][turn % 2];
        let stream = round_trip(&options, &mut random);
        for _ in 0..100 {
            let mut changed = stream.clone();
            for _ in 0..=random.below(4) {
                // Half of the changes hit the marker segments.
                let within = if random.below(2) == 0 { 50.min(stream.len()) } else { stream.len() };
                changed[random.below(within)] = random.byte();
            }
            failed += usize::from(decoded(&changed).is_err());
        }
    }
    assert!((1000..20_000).contains(&failed), "{failed} of 20000 found out");
}
