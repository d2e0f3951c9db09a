//! Round trips through an encoder of our own, refusals, and damage.

use std::io::Read;

use super::super::kept::Kept;
use super::super::{CodecError, FrameFormat, RowSink};
use super::encoder::{Dct, FLAT, Lossless, STEEP, Writer};
use super::{dct, decode};
use crate::codec::damaged;
use crate::random::Random;

/// More than any image of the tests needs.
const PLENTY: u64 = 1 << 22;

fn decoded(stream: &[u8]) -> Result<Kept, CodecError> {
    let mut kept = Kept::default();
    decode(&mut &*stream, PLENTY, &mut kept).map(|()| kept)
}

/// All samples of an image that must decode.
fn samples(stream: &[u8]) -> Vec<i32> {
    let kept = decoded(stream).unwrap();
    assert_eq!(kept.rows.len(), kept.format.unwrap().rows as usize);
    kept.rows.concat()
}

/// The error for an image that must not decode.
fn refusal(stream: &[u8]) -> String {
    decoded(stream).map(drop).unwrap_err().to_string()
}

/// A ramp with noise, and every extreme of the precision.
fn picture(seed: u64, count: usize, precision: u8) -> Vec<u16> {
    let mut random = Random(seed);
    let range = 1_u32 << precision;
    (0..count)
        .map(|i| {
            let value = match random.below(20) {
                0 => 0,
                1 => range - 1,
                2 => range / 2,
                3 => random.below(range),
                _ => (u32::try_from(i).unwrap() * range / 97 + random.below(1 + range / 32)) % range,
            };
            u16::try_from(value).unwrap()
        })
        .collect()
}

fn as_samples(picture: &[u16], point_transform: u8) -> Vec<i32> {
    picture.iter().map(|&s| i32::from(s >> point_transform << point_transform)).collect()
}

#[test]
fn lossless_images_come_back_for_every_predictor_precision_shift_and_restart() {
    for precision in 2..=16 {
        for predictor in 1..=7 {
            for point_transform in 0..precision.min(3) {
                for (restart_lines, counts) in [(0, FLAT), (1, STEEP), (3, FLAT), (0, STEEP)] {
                    let image = picture(u64::from(precision * 8 + predictor), 23 * 11, precision);
                    let stream = Lossless {
                        samples: &image,
                        columns: 23,
                        components: 1,
                        precision,
                        predictor,
                        point_transform,
                        restart_lines,
                        counts,
                    };
                    assert_eq!(
                        samples(&stream.encode()),
                        as_samples(&image, point_transform),
                        "{precision} bits, predictor {predictor}, shift {point_transform}, {restart_lines}"
                    );
                }
            }
        }
    }
}

fn lossless(samples: &[u16], columns: usize, components: usize) -> Lossless<'_> {
    Lossless {
        samples,
        columns,
        components,
        precision: 16,
        predictor: 4,
        point_transform: 0,
        restart_lines: 2,
        counts: FLAT,
    }
}

#[test]
fn lossless_components_come_together_or_one_by_one() {
    for components in 1..=4_u8 {
        let image = picture(5, 9 * 7 * usize::from(components), 16);
        let stream = lossless(&image, 9, components.into());
        assert_eq!(samples(&stream.encode()), as_samples(&image, 0), "{components} together");
        let mut out = stream.header();
        (0..components).rev().for_each(|c| stream.scan(&mut out, &[c]));
        assert_eq!(samples(&out.end()), as_samples(&image, 0), "{components} one by one");
        let mut out = stream.header();
        let backwards: Vec<u8> = (0..components).rev().collect();
        stream.scan(&mut out, &backwards);
        assert_eq!(samples(&out.end()), as_samples(&image, 0), "{components} backwards");
    }
}

#[test]
fn signed_samples_of_few_bits_lose_the_copies_of_their_sign() {
    // -1000 in 12 bits, as an encoder codes it that reads the 16-bit memory unchanged.
    let image: Vec<u16> = [-1000_i16, -2048, -1, 0, 2047, 1].map(i16::cast_unsigned).to_vec();
    let mut stream = lossless(&image, 3, 1);
    stream.precision = 12;
    let expected: Vec<i32> = image.iter().map(|&s| i32::from(s & 0xFFF)).collect();
    assert_eq!(samples(&stream.encode()), expected);
    let wrong = [0, 4096, 0, 0, 0, 0];
    stream.samples = &wrong;
    assert!(refusal(&stream.encode()).contains("out of the range"));
}

/// The image of given coefficients, put together pixel by pixel.
fn pixels(image: &Dct) -> Vec<i32> {
    let steps = [2; 64];
    let h_max = image.planes.iter().map(|p| p.h).max().unwrap();
    let v_max = image.planes.iter().map(|p| p.v).max().unwrap();
    let mut out = Vec::new();
    for y in 0..image.size.1 {
        for x in 0..image.size.0 {
            for plane in &image.planes {
                let (x, y) = (x * plane.h / h_max, y * plane.v / v_max);
                let block = &plane.blocks[y / 8 * plane.stride + x / 8];
                out.push(dct::samples(block, &steps, image.precision)[y % 8 * 8 + x % 8].into());
            }
        }
    }
    out
}

/// Sampling factors of the components: grey (idle factors are tested elsewhere), colour in several ways.
const FACTORS: [&[(usize, usize)]; 6] = [
    &[(1, 1)],
    &[(1, 1), (1, 1), (1, 1)],
    &[(2, 2), (1, 1), (1, 1)],
    &[(2, 1), (1, 1), (1, 1), (2, 1)],
    &[(1, 2), (1, 1)],
    &[(3, 1), (2, 2), (1, 1)],
];

fn dct_images() -> impl Iterator<Item = Dct> {
    (0_u64..).zip(FACTORS).flat_map(|(seed, factors)| {
        [(8, (37, 29), 0), (12, (37, 29), 3), (12, (64, 8), 1), (8, (1, 1), 0), (8, (9, 70), 4)].map(
            |(precision, size, restart)| {
                let mut image = Dct::random(seed, precision, size, factors);
                image.restart = restart;
                image
            },
        )
    })
}

fn all_components(image: &Dct) -> Vec<u8> {
    (0..u8::try_from(image.planes.len()).unwrap()).collect()
}

fn sequential(image: &Dct) -> Vec<u8> {
    let mut out = image.header(0xC1);
    image.scan(&mut out, &all_components(image), (0, 63), 0, 0);
    out.end()
}

#[test]
fn sequential_images_come_back_in_one_scan_and_in_several() {
    for image in dct_images() {
        let expected = pixels(&image);
        assert_eq!(samples(&sequential(&image)), expected);
        let mut out = image.header(0xC1);
        for component in all_components(&image) {
            image.scan(&mut out, &[component], (0, 63), 0, 0);
        }
        assert_eq!(samples(&out.end()), expected, "one by one");
    }
}

#[test]
fn the_factors_of_a_grey_image_mean_nothing() {
    let image = Dct::random(3, 8, (37, 29), &[(1, 1)]);
    let mut stream = sequential(&image);
    let at = stream.windows(4).position(|w| w == [1, 10, 0x11, 0]).unwrap();
    stream[at + 2] = 0x22;
    assert_eq!(samples(&stream), pixels(&image));
}

/// Spectral selection alone, successive approximation alone, and both, three bits deep.
fn progressive(image: &Dct, script: usize) -> Writer {
    let all = all_components(image);
    let mut out = image.header(0xC2);
    let bands: &[(u8, u8)] = if script == 1 { &[(1, 63)] } else { &[(1, 2), (3, 9), (10, 63)] };
    let depth = [0, 3, 2][script];
    image.scan(&mut out, &all, (0, 0), 0, depth);
    for &component in &all {
        for &band in bands {
            image.scan(&mut out, &[component], band, 0, depth);
        }
    }
    for low in (0..depth).rev() {
        // The DC bits of one component by itself, of the others together.
        if all.len() > 2 {
            image.scan(&mut out, &all[..1], (0, 0), low + 1, low);
            image.scan(&mut out, &all[1..], (0, 0), low + 1, low);
        } else {
            image.scan(&mut out, &all, (0, 0), low + 1, low);
        }
        for &component in &all {
            for &band in bands {
                image.scan(&mut out, &[component], band, low + 1, low);
            }
        }
    }
    out
}

#[test]
fn progressive_images_come_back_whatever_the_order_of_their_scans() {
    for image in dct_images() {
        let expected = pixels(&image);
        for script in 0..3 {
            let stream = progressive(&image, script).end();
            assert_eq!(samples(&stream), expected, "script {script}");
            // The stream is also complete without its end marker.
            assert_eq!(samples(&stream[..stream.len() - 2]), expected);
        }
    }
}

#[test]
fn long_runs_of_ended_blocks_come_back() {
    // 1024 blocks, 10 of them not empty: runs of more than one symbol class, across rows.
    let mut image = Dct::random(1, 8, (256, 256), &[(1, 1)]);
    for (i, block) in image.planes[0].blocks.iter_mut().enumerate() {
        if i % 100 != 99 {
            block[1..].fill(0);
        }
    }
    for script in 0..3 {
        assert_eq!(samples(&progressive(&image, script).end()), pixels(&image));
    }
}

#[test]
fn scans_out_of_turn_are_damage() {
    let image = Dct::random(1, 8, (20, 20), &[(1, 1)]);
    /// Band, previous bit position, bit position.
    type Step = ((u8, u8), u8, u8);
    let scans: &[&[Step]] = &[
        &[((1, 63), 0, 0)],
        &[((0, 0), 0, 0), ((0, 0), 0, 0)],
        &[((0, 0), 0, 2), ((0, 0), 2, 0)],
        &[((0, 0), 0, 0), ((1, 5), 0, 1), ((1, 6), 1, 0)],
        &[((0, 0), 0, 0), ((1, 5), 0, 1), ((5, 63), 0, 1)],
    ];
    for &scans in scans {
        let mut out = image.header(0xC2);
        for &(band, high, low) in scans {
            image.scan(&mut out, &[0], band, high, low);
        }
        assert!(refusal(&out.end()).contains("out of its turn"));
    }
    // A coefficient that no scan began is an error; one not refined to the end is accepted if the end is marked.
    let mut out = image.header(0xC2);
    image.scan(&mut out, &[0], (0, 0), 0, 1);
    let stream = out.end();
    assert!(refusal(&stream[..stream.len() - 2]).contains("before its last scan"));
    assert_eq!(samples(&stream).len(), 400);
    let image = Dct::random(1, 8, (20, 20), &[(1, 1), (1, 1)]);
    let mut out = image.header(0xC2);
    image.scan(&mut out, &[0], (0, 0), 0, 0);
    assert!(refusal(&out.end()).contains("before its last scan"));
}

#[test]
fn what_is_not_decoded_is_named() {
    let image = picture(1, 30, 16);
    let good = lossless(&image, 5, 1).encode();
    let at = good.windows(2).position(|w| w == [0xFF, 0xC3]).unwrap();
    for (marker, reason) in [
        (0xC5, "hierarchical"),
        (0xC7, "hierarchical"),
        (0xDE, "hierarchical"),
        (0xC9, "arithmetic"),
        (0xCB, "arithmetic"),
        (0xF7, "JPEG-LS"),
        (0xC0, "16 bits"),
    ] {
        let mut stream = good.clone();
        stream[at + 1] = marker;
        let said = refusal(&stream);
        assert!(said.contains(reason) && said.contains("not supported"), "{marker:X}: {said}");
    }
    let mut stream = good.clone();
    stream[at + 5..at + 7].fill(0);
    assert!(refusal(&stream).contains("DNL"));
    stream[at + 7..at + 9].fill(0);
    assert!(refusal(&stream).contains("width"));
    let mut subsampled = lossless(&image, 5, 2).encode();
    let at = subsampled.windows(3).position(|w| w == [10, 0x11, 0]).unwrap();
    subsampled[at + 1] = 0x21;
    assert!(refusal(&subsampled).contains("subsampled"));
}

#[test]
fn what_follows_the_last_pixel_does_not_matter() {
    let image = picture(9, 40 * 30, 12);
    let mut stream = lossless(&image, 40, 1);
    stream.precision = 12;
    let good = stream.encode();
    let expected = as_samples(&image, 0);
    assert_eq!(samples(&good[..good.len() - 2]), expected, "no end marker");
    assert_eq!(samples(&[&good[..good.len() - 2], &[0]].concat()), expected, "padded");
    assert_eq!(samples(&[&good[..], &[0xA7; 500]].concat()), expected, "garbage behind the end");
    let filled = [&good[..good.len() - 2], &[0xFF; 7], &[0xD9]].concat();
    assert_eq!(samples(&filled), expected, "fill bytes");
}

#[test]
fn memory_is_checked_before_it_is_taken() {
    let needed = |stream: &[u8], allowed: u64| {
        let mut input = stream;
        match decode(&mut input, allowed, &mut Kept::default()) {
            Ok(()) => 0,
            Err(CodecError::Memory { needed_bytes, allowed_bytes }) => {
                assert_eq!(allowed_bytes, allowed);
                needed_bytes
            }
            Err(other) => panic!("{other}"),
        }
    };
    let image = picture(1, 512 * 16, 16);
    let mut grey = lossless(&image, 512, 1);
    grey.restart_lines = 0;
    let grey = grey.encode();
    // A frame of 512 columns streams in less than 40 KiB, whatever its height.
    assert_eq!(needed(&grey, 40 << 10), 0);
    assert!(needed(&grey, 1000) > 1000);
    let image = Dct::random(1, 12, (250, 250), &[(1, 1)]);
    assert_eq!(needed(&sequential(&image), 64 << 10), 0);
    let needs = needed(&progressive(&image, 2).end(), 64 << 10);
    assert!((256 * 256 * 2..256 * 256 * 2 + (40 << 10)).contains(&needs), "{needs}");
    assert_eq!(needed(&progressive(&image, 2).end(), needs), 0);
}

/// Small images of every kind.
fn victims() -> Vec<Vec<u8>> {
    let mut found = Vec::new();
    for components in [1, 3] {
        let image = picture(2, 24 * 10 * components, 16);
        let mut stream = lossless(&image, 24, components);
        found.push(stream.encode());
        (stream.restart_lines, stream.predictor) = (0, 7);
        found.push(stream.encode());
    }
    for factors in [FACTORS[0], FACTORS[2]] {
        let mut image = Dct::random(4, 12, (40, 40), factors);
        found.push(sequential(&image));
        found.push(progressive(&image, 0).end());
        image.restart = 2;
        found.push(sequential(&image));
        found.push(progressive(&image, 2).end());
    }
    found
}

#[test]
fn an_image_cut_short_anywhere_is_refused() {
    for (kind, stream) in victims().iter().enumerate() {
        // Only the end marker may be missing.
        for length in 0..stream.len() - 2 {
            let said = refusal(&stream[..length]);
            assert!(said.contains("damaged"), "kind {kind}, {length} bytes: {said}");
        }
    }
}

#[test]
fn changed_bytes_do_no_harm() {
    let mut random = Random(11);
    let (mut refused, mut whole) = (0, 0);
    for (kind, stream) in victims().iter().enumerate() {
        for case in 0..1500 {
            let mut stream = stream.clone();
            for _ in 0..1 + random.below(4) {
                let at = random.below(stream.len());
                stream[at] = if case % 3 == 0 { 0xFF } else { random.byte() };
            }
            match decoded(&stream) {
                Ok(_) => whole += 1,
                Err(CodecError::Io(error)) => panic!("kind {kind}, case {case}: {error}"),
                Err(_) => refused += 1,
            }
        }
    }
    // Both happen: a changed bit of a sample may go unnoticed, most other changes may not.
    println!("{refused} refused, {whole} decoded");
    assert!(refused > whole && whole > 0);
}

#[test]
fn noise_after_a_header_ends() {
    let mut random = Random(3);
    for stream in victims() {
        let at = stream.windows(2).position(|w| w == [0xFF, 0xDA]).unwrap();
        for _ in 0..100 {
            let noise: Vec<u8> = (0..3000).map(|_| random.byte()).collect();
            let stream = [&stream[..at + 8], &noise].concat();
            assert!(!matches!(decoded(&stream), Err(CodecError::Io(_))));
        }
    }
}

#[test]
fn errors_of_input_and_receiver_are_passed_on() {
    struct Failing<'a>(&'a [u8]);
    impl Read for Failing<'_> {
        fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
            match self.0.read(out)? {
                0 => Err(std::io::Error::other("the disk is gone")),
                read => Ok(read),
            }
        }
    }
    struct Refusing;
    impl RowSink for Refusing {
        fn begin(&mut self, _: &FrameFormat) -> Result<(), CodecError> {
            Err(damaged("it has more rows than it says"))
        }
        fn row(&mut self, _: &[i32]) -> Result<(), CodecError> {
            panic!("a row after a refusal");
        }
    }
    let image = picture(1, 30, 16);
    let stream = lossless(&image, 5, 1).encode();
    let mut input = Failing(&stream[..stream.len() - 9]);
    let error = decode(&mut input, PLENTY, &mut Kept::default()).unwrap_err();
    assert!(matches!(error, CodecError::Io(_)), "{error}");
    let mut input = &stream[..];
    let error = decode(&mut input, PLENTY, &mut Refusing).unwrap_err().to_string();
    assert!(error.contains("more rows than it says"));
}
