//! Codestreams with known samples, and damaged ones.

use super::super::kept::Kept;
use super::vectors::{
    EVERYTHING, HIGH_THROUGHPUT, IRREVERSIBLE, THREE_PASSES, THREE_PASSES_SAMPLES, plain_stream,
};
use super::*;
use crate::random::Random;

fn try_decode(bytes: &[u8], memory_bytes: u64) -> Result<Kept, CodecError> {
    let mut frame = Kept { most_samples: 1 << 21, ..Kept::default() };
    decode(&mut &*bytes, bytes.len() as u64, memory_bytes, &mut frame)?;
    let format = frame.format.expect("a decoded frame has a format");
    assert_eq!(frame.rows.len(), format.rows as usize, "a decoded frame has all its rows");
    Ok(frame)
}

fn decoded(bytes: &[u8]) -> Kept {
    try_decode(bytes, 16 << 20).unwrap()
}

/// The image of the script that made the codestreams.
fn formula(width: i32, height: i32, levels: i32, offset: i32) -> Vec<i32> {
    let at = |x: i32, y: i32| (x * x * 37 + y * 91 + x * y * 13) % levels + offset;
    (0..height).flat_map(|y| (0..width).map(move |x| at(x, y))).collect()
}

#[test]
fn all_styles_tiles_and_layers_are_exact() {
    let frame = decoded(EVERYTHING);
    let format = FrameFormat { columns: 9, rows: 7, components: 1, precision: 12, signed: true };
    assert_eq!(frame.format, Some(format));
    assert_eq!(frame.rows.concat(), formula(9, 7, 250, -100));
}

#[test]
fn irreversible_colours_are_near() {
    let frame = decoded(IRREVERSIBLE);
    assert_eq!(frame.rows.concat().len(), 9 * 9 * 3);
    for (index, pixel) in frame.rows.concat().chunks_exact(3).enumerate() {
        let (x, y) = (i32::try_from(index % 9).unwrap(), i32::try_from(index / 9).unwrap());
        for (sample, expected) in pixel.iter().zip([20 * x + 5 * y, 200 - 10 * x, 7 * x + 13 * y]) {
            assert!((sample - expected).abs() <= 2, "pixel {x}, {y}: {sample} for {expected}");
        }
    }
}

#[test]
fn high_throughput_is_exact() {
    let frame = decoded(HIGH_THROUGHPUT);
    let format = FrameFormat { columns: 9, rows: 7, components: 1, precision: 16, signed: false };
    assert_eq!(frame.format, Some(format));
    assert_eq!(frame.rows.concat(), formula(9, 7, 65536, 0));
}

#[test]
fn high_throughput_passes_agree_with_openjpeg() {
    assert_eq!(decoded(THREE_PASSES).rows.concat(), THREE_PASSES_SAMPLES.map(i32::from));
}

#[test]
fn a_box_around_the_codestream_is_opened() {
    let mut file = b"\0\0\0\x0CjP  \x0D\x0A\x87\x0A\0\0\0\x14ftypjp2 \0\0\0\0jp2 ".to_vec();
    let length = u32::try_from(HIGH_THROUGHPUT.len() + 8).unwrap();
    file.extend(length.to_be_bytes());
    file.extend(b"jp2c");
    file.extend(HIGH_THROUGHPUT);
    file.extend(b"\0\0\0\x08free");
    assert_eq!(decoded(&file).rows.concat(), formula(9, 7, 65536, 0));
}

#[test]
fn too_little_memory_is_said_and_what_is_asked_for_suffices() {
    for stream in [EVERYTHING, IRREVERSIBLE, HIGH_THROUGHPUT] {
        let mut allowed = 0;
        let mut refusals = 0;
        while let Err(error) = try_decode(stream, allowed) {
            let CodecError::Memory { needed_bytes, allowed_bytes } = error else { panic!("{error}") };
            assert!(allowed_bytes == allowed && needed_bytes > allowed, "{needed_bytes} {allowed_bytes}");
            // Refused before it is allocated, so a small frame never asks for much.
            assert!(needed_bytes < 100_000, "{needed_bytes}");
            (allowed, refusals) = (needed_bytes, refusals + 1);
        }
        assert!(refusals > 1);
    }
}

#[test]
fn a_receiver_that_refuses_ends_it() {
    let mut frame = Kept { most_samples: 1, ..Kept::default() };
    let result = decode(&mut &*EVERYTHING, EVERYTHING.len() as u64, 1 << 20, &mut frame);
    assert!(matches!(result, Err(CodecError::Unsupported(_))));
    assert!(frame.rows.is_empty());
}

#[test]
fn empty_packets_are_grey_and_missing_ones_are_damage() {
    let whole =
        plain_stream(64, 32, 2, &[(0, vec![0; 2]), (1, vec![0; 2]), (2, vec![0; 2]), (3, vec![0; 2])]);
    assert!(decoded(&whole).rows.concat().iter().all(|&sample| sample == 128));
    for parts in [
        vec![(0, vec![0; 2]), (1, vec![0; 2]), (2, vec![0; 2])],
        vec![(0, vec![0; 2]), (1, vec![0; 2]), (2, vec![0; 2]), (3, vec![0; 1])],
    ] {
        let error = try_decode(&plain_stream(64, 32, 2, &parts), 1 << 20).expect_err("a packet is missing");
        assert!(matches!(error, CodecError::Damaged(_)), "{error}");
    }
}

#[test]
fn packets_that_pass_over_everything_are_refused_in_time() {
    // 65535 layers, each with two bits that exclude all 65536 code-blocks: four thousand million visits.
    let stream = plain_stream(1024, 1024, 65535, &[(0, vec![0x80; 65535])]);
    let error = try_decode(&stream, 64 << 20).expect_err("it leads nowhere");
    assert!(matches!(error, CodecError::Damaged(_)), "{error}");
}

#[test]
fn vast_sizes_are_refused_before_anything_is_taken() {
    let stream = plain_stream(0x7FFF_FFFF, 0x7FFF_FFFF, 1, &[(0, vec![0])]);
    let mut frame = Kept { most_samples: u64::MAX, ..Kept::default() };
    let result = decode(&mut &*stream, stream.len() as u64, 1 << 20, &mut frame);
    assert!(matches!(result, Err(CodecError::Memory { .. })));
}

/// Decodes a stream that must not panic, hang or report more rows than there are; 1 if it is refused.
fn refused(bytes: &[u8]) -> usize {
    usize::from(try_decode(bytes, 4 << 20).is_err())
}

#[test]
fn cut_streams_are_damage() {
    for stream in [EVERYTHING, IRREVERSIBLE, HIGH_THROUGHPUT, THREE_PASSES] {
        // Only the end marker may be missing.
        assert_eq!((0..stream.len() - 2).map(|end| refused(&stream[..end])).sum::<usize>(), stream.len() - 2);
        assert_eq!(refused(&stream[..stream.len() - 2]), 0);
    }
}

#[test]
fn changed_bytes_do_no_harm() {
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    let mut bad = 0;
    for stream in [EVERYTHING, IRREVERSIBLE, HIGH_THROUGHPUT, THREE_PASSES] {
        for round in 0..2000 {
            let mut changed = stream.to_vec();
            for _ in 0..1 + random.below(3) {
                let at = random.below(if round % 2 == 0 { 120 } else { changed.len() });
                changed[at] = match random.below(3) {
                    0 => 0xFF,
                    1 => changed[at] ^ 1 << random.below(8),
                    _ => random.byte(),
                };
            }
            bad += refused(&changed);
        }
    }
    assert!((1000..8000).contains(&bad), "{bad} of 8000 are refused");
}
