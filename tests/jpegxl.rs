//! JPEG XL in DICOM: values, signs and colour are what the same pixels give otherwise, and neither sound nor
//! damaged streams take more memory than is planned for them. If this fails, a series has wrong values, or a
//! damaged file takes the memory, or the whole run, with it.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;
use std::time::{Duration, Instant};

use infobyte::budget::Budget;
use infobyte::codec::{CodecError, FrameFormat, RowSink, jpegxl};
use infobyte::source::dicom::{Image, unroll};
use infobyte::volume::{ScalarType, SourceError};

#[path = "support/dicom.rs"]
mod dicom;
#[path = "support/frames.rs"]
mod frames;
#[path = "support/lcg.rs"]
mod lcg;
#[path = "support/jpegxl.rs"]
mod streams;
use frames::{Collected, Spec, encapsulated, header_of, words};
use lcg::Lcg;

const LOSSLESS: &str = "1.2.840.10008.1.2.4.110";
const RECOMPRESSED: &str = "1.2.840.10008.1.2.4.111";
const LOSSY: &str = "1.2.840.10008.1.2.4.112";
const BASELINE: &str = "1.2.840.10008.1.2.4.50";
const MEMORY: u64 = 8 << 20;

/// Counts what the current thread holds; tests run on threads of their own.
struct Counting;

thread_local! {
    static LIVE: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(change: isize) {
    let _ = LIVE.try_with(|live| {
        live.set(live.get() + change);
        let _ = PEAK.try_with(|peak| peak.set(peak.get().max(live.get())));
    });
}

// SAFETY: every call is passed on to the system allocator unchanged; the counters are thread-local
// and need no allocation themselves. Reallocation is by the default, which allocates and copies.
#[expect(unsafe_code, reason = "a counting allocator cannot be written without; tests only")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size().cast_signed());
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-layout.size().cast_signed());
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Most bytes that the thread holds more than now while `work` runs.
fn peak_of<T>(work: impl FnOnce() -> T) -> (T, u64) {
    let before = LIVE.get();
    PEAK.set(before);
    let done = work();
    (done, u64::try_from(PEAK.get() - before).unwrap())
}

fn unrolled(file: &[u8], memory_bytes: u64) -> Result<Vec<Vec<u8>>, SourceError> {
    let header = header_of(file);
    let image = Image::of(&header).unwrap();
    let mut collected = Collected::default();
    unroll(file, Path::new("x.dcm"), &header, &image, &Budget::new(memory_bytes), &mut collected)?;
    Ok(collected.frames)
}

fn formula(levels: i32) -> Vec<i32> {
    (0..7).flat_map(|y| (0..9).map(move |x| (x * x * 37 + y * 91 + x * y * 13) % levels)).collect()
}

fn small(bits: [u16; 3]) -> Spec<'static> {
    Spec { size: [9, 7], bits, ..Spec::default() }
}

#[test]
fn lossless_frames_of_8_12_and_16_bits_are_exact() {
    for uid in [LOSSLESS, LOSSY] {
        let frames = unrolled(&encapsulated(uid, small([8, 8, 7]), &[], &[streams::EIGHT.to_vec()]), MEMORY);
        let expected: Vec<u8> = formula(256).into_iter().map(|v| v.try_into().unwrap()).collect();
        assert_eq!(frames.unwrap(), [expected]);
        for (stream, bits, levels) in [
            (streams::TWELVE, [16, 12, 11], 4096),
            (streams::TWELVE_IN_16, [16, 12, 11], 4096),
            (streams::SIXTEEN, [16, 16, 15], 65536),
        ] {
            let file = encapsulated(uid, small(bits), &[], &[stream.to_vec()]);
            let expected: Vec<u16> = formula(levels).into_iter().map(|v| v.try_into().unwrap()).collect();
            assert_eq!(words(&unrolled(&file, MEMORY).unwrap()[0]), expected, "{bits:?}");
        }
    }
}

#[test]
fn the_header_says_the_sign_that_the_codestream_cannot() {
    let spec = Spec { signed: true, ..small([16, 16, 15]) };
    let file = encapsulated(LOSSLESS, spec, &[], &[streams::SIXTEEN.to_vec()]);
    assert_eq!(Image::of(&header_of(&file)).unwrap().layout.scalar(), ScalarType::I16);
    let got: Vec<i16> =
        words(&unrolled(&file, MEMORY).unwrap()[0]).into_iter().map(u16::cast_signed).collect();
    let expected: Vec<i16> =
        formula(65536).into_iter().map(|v| u16::try_from(v).unwrap().cast_signed()).collect();
    assert_eq!(got, expected);
    for stream in [streams::TWELVE, streams::TWELVE_IN_16] {
        let spec = Spec { signed: true, ..small([16, 12, 11]) };
        let file = encapsulated(LOSSLESS, spec, &[], &[stream.to_vec()]);
        let expected: Vec<u16> = formula(4096)
            .into_iter()
            .map(|v| i16::try_from(if v < 2048 { v } else { v - 4096 }).unwrap().cast_unsigned())
            .collect();
        assert!(expected.iter().any(|v| v.cast_signed() < 0));
        assert_eq!(words(&unrolled(&file, MEMORY).unwrap()[0]), expected);
    }
}

#[test]
fn frames_are_told_apart_by_fragments_and_by_their_beginnings() {
    let spec = Spec { frames: "2", ..small([16, 16, 15]) };
    let one: Vec<u16> = formula(65536).into_iter().map(|v| v.try_into().unwrap()).collect();
    let (head, tail) = streams::SIXTEEN.split_at(40);
    for fragments in [
        vec![streams::SIXTEEN.to_vec(), streams::SIXTEEN.to_vec()],
        vec![head.to_vec(), tail.to_vec(), streams::SIXTEEN.to_vec()],
    ] {
        let frames = unrolled(&encapsulated(LOSSLESS, spec, &[], &fragments), MEMORY).unwrap();
        assert_eq!(frames.iter().map(|frame| words(frame)).collect::<Vec<_>>(), [one.clone(), one.clone()]);
    }
    let spec = Spec { frames: "2", ..small([8, 8, 7]) };
    let (head, tail) = streams::BOXED.split_at(50);
    let fragments = [head.to_vec(), tail.to_vec(), streams::BOXED.to_vec()];
    assert_eq!(unrolled(&encapsulated(LOSSLESS, spec, &[], &fragments), MEMORY).unwrap().len(), 2);
}

fn colour(uid: &str, photometric: &'static str, size: [u16; 2], stream: &[u8]) -> Vec<u8> {
    let spec = Spec { size, bits: [8, 8, 7], samples: 3, photometric, ..Spec::default() };
    encapsulated(uid, spec, &[], &[stream.to_vec()])
}

#[test]
fn colour_becomes_luminance_or_is_refused() {
    let file = colour(LOSSLESS, "RGB", [9, 7], streams::COLOUR);
    let [red, green, blue] = [256, 251, 241].map(formula);
    let expected: Vec<f64> = red
        .into_iter()
        .zip(green)
        .zip(blue)
        .map(|((r, g), b)| 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b))
        .collect();
    let got = unrolled(&file, MEMORY).unwrap();
    assert!(got[0].iter().zip(&expected).all(|(g, e)| (f64::from(*g) - e).abs() <= 1.0), "{got:?}");
    assert!(Image::of(&header_of(&file)).unwrap().warning().unwrap().contains("luminance"));
    // The decoder undoes what is inside.
    let near = unrolled(&colour(LOSSY, "RGB", [12, 10], streams::NEAR_COLOUR), MEMORY).unwrap();
    assert_eq!(unrolled(&colour(LOSSY, "XYB", [12, 10], streams::NEAR_COLOUR), MEMORY).unwrap(), near);
    for (uid, photometric) in [(LOSSLESS, "YBR_FULL"), (LOSSLESS, "YBR_FULL_422"), (LOSSY, "YBR_FULL")] {
        let error = Image::of(&header_of(&colour(uid, photometric, [9, 7], streams::COLOUR))).unwrap_err();
        assert!(error.to_string().contains(photometric), "{error}");
    }
}

#[test]
fn recompressed_jpeg_is_within_2_of_the_jpeg() {
    let spec = Spec { size: [24, 20], bits: [8, 8, 7], ..Spec::default() };
    let grey = |uid, stream: &[u8]| encapsulated(uid, spec, &[], &[stream.to_vec()]);
    let ybr = |uid, stream| colour(uid, "YBR_FULL_422", [24, 20], stream);
    for (jpeg, again) in [
        (grey(BASELINE, streams::JPEG_GREY), grey(RECOMPRESSED, streams::RECOMPRESSED_GREY)),
        (ybr(BASELINE, streams::JPEG_COLOUR), ybr(RECOMPRESSED, streams::RECOMPRESSED_COLOUR)),
    ] {
        let (jpeg, again) = (unrolled(&jpeg, MEMORY).unwrap(), unrolled(&again, MEMORY).unwrap());
        assert_eq!(jpeg[0].len(), 24 * 20);
        let farthest = jpeg[0].iter().zip(&again[0]).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(farthest <= 2, "{farthest}");
    }
}

#[test]
fn a_stream_of_another_size_or_kind_than_the_header_says_is_refused_before_it_is_decoded() {
    for (spec, text) in [
        (Spec { size: [9, 8], ..small([16, 16, 15]) }, "it is 9x7, and the header says 9x8"),
        (small([8, 8, 7]), "it has 16 bits a sample, and the header allocates 8"),
        (Spec { samples: 3, photometric: "RGB", ..small([16, 16, 15]) }, "it has 1 samples a pixel"),
    ] {
        let file = encapsulated(LOSSLESS, spec, &[], &[streams::SIXTEEN.to_vec()]);
        let (result, peak) = peak_of(|| unrolled(&file, MEMORY));
        let error = result.unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
        assert!(peak < 256 << 10, "{peak}");
    }
}

#[test]
fn too_little_memory_is_refused_with_what_is_needed() {
    let spec = Spec { size: [300, 280], ..Spec::default() };
    let file = encapsulated(LOSSLESS, spec, &[], &[streams::GROUPS.to_vec()]);
    let needed = Image::of(&header_of(&file)).unwrap().unroll_bytes();
    let expected: Vec<u16> = (0..280).flat_map(|y| (0..300).map(move |x| x + 3 * y)).collect();
    assert_eq!(words(&unrolled(&file, needed).unwrap()[0]), expected);
    let error = unrolled(&file, 1 << 20).unwrap_err();
    let SourceError::Memory { needed_bytes, .. } = error else { panic!("{error}") };
    assert!((4 << 20..=needed).contains(&needed_bytes), "{needed_bytes} {needed}");
}

/// Accepts images of one size only.
struct Only(u32, u32, u8);

impl RowSink for Only {
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        let same = (format.columns, format.rows, format.components) == (self.0, self.1, self.2);
        if same { Ok(()) } else { Err(CodecError::Damaged("it is another image".into())) }
    }

    fn row(&mut self, _: &[i32]) -> Result<(), CodecError> {
        Ok(())
    }
}

#[test]
fn damaged_streams_end_in_time_and_within_what_is_planned() {
    let mut random = Lcg(0x5eed);
    let (mut refused, mut all, mut most) = (0_u32, 0_u32, 0);
    for (stream, sink) in [
        (streams::EIGHT, Only(9, 7, 1)),
        (streams::BOXED, Only(9, 7, 1)),
        (streams::SIXTEEN, Only(9, 7, 1)),
        (streams::COLOUR, Only(9, 7, 3)),
        (streams::GROUPS, Only(300, 280, 1)),
        (streams::NEAR_GREY, Only(24, 20, 1)),
        (streams::NEAR_COLOUR, Only(12, 10, 3)),
        (streams::RECOMPRESSED_GREY, Only(24, 20, 1)),
        (streams::RECOMPRESSED_COLOUR, Only(24, 20, 3)),
    ] {
        let planned = jpegxl::memory_bytes_for(sink.0, sink.1, sink.2);
        let mut sink = sink;
        for round in 0..1000 {
            let mut changed = stream.to_vec();
            if round % 5 == 0 {
                changed.truncate(random.below(stream.len()));
            } else {
                for _ in 0..1 + random.below(3) {
                    let at = random.below(if round % 2 == 0 { 40 } else { changed.len() });
                    changed[at] = match random.below(3) {
                        0 => 0xff,
                        1 => changed[at] ^ 1 << random.below(8),
                        _ => u8::try_from(random.below(256_u32)).unwrap(),
                    };
                }
            }
            let started = Instant::now();
            let (result, peak) = peak_of(|| jpegxl::decode(&changed, MEMORY, &mut sink));
            assert!(peak <= planned, "{peak} of {planned}: {changed:02x?}");
            assert!(started.elapsed() < Duration::from_secs(5), "{:?}: {changed:02x?}", started.elapsed());
            most = most.max(peak);
            refused += u32::from(result.is_err());
            all += 1;
        }
    }
    println!("{refused} of {all} are refused, {most} bytes at most");
    assert!(refused > all / 2 && refused < all, "{refused} of {all} are refused");
}
