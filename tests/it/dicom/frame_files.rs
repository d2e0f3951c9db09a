//! Fragments find their frames whatever the offset tables say, ten thousand frames cost no more memory than
//! ten, and no bytes make the reader of frames panic, loop, or allocate more than a few rows and tables.

use crate::prelude::*;
use std::io::Write as _;

use infobyte::facts::Instead;
use infobyte::source::dicom::Image;

use crate::common::frames::{ENCAPSULATED, deflated_parts, pixel_items};

/// Runs something and returns the most bytes that it held at a time.
fn peak_of<T>(run: impl FnOnce() -> T) -> (T, usize) {
    let (result, taken) = measured(run);
    (result, taken.peak)
}

/// Frames of four bytes, in one fragment each.
fn three() -> Vec<Vec<u8>> {
    vec![vec![1, 2, 3, 4], vec![5, 6, 7, 8], vec![9, 10, 11, 12]]
}

const SMALL: Spec<'static> = Spec {
    size: [2, 2],
    bits: [8, 8, 7],
    signed: false,
    samples: 1,
    planar: 0,
    photometric: "MONOCHROME2",
    frames: "3",
};

#[test]
fn fragments_make_frames_by_number_table_or_marker() {
    let whole = three();
    let halves: Vec<Vec<u8>> = whole.iter().flat_map(|f| [f[..2].to_vec(), f[2..].to_vec()]).collect();
    let uneven = vec![whole[0].clone(), whole[1][..2].to_vec(), whole[1][2..].to_vec(), whole[2].clone()];
    for (what, table, fragments) in [
        ("no table", &[][..], &whole),
        ("a table", &[0, 12, 24], &whole),
        ("a wrong table", &[0, 13, 7], &whole),
        ("a table that is too long", &[0, 12, 24, 36], &whole),
        ("two fragments a frame", &[0, 20, 40], &halves),
        ("one frame in two fragments", &[0, 12, 32], &uneven),
    ] {
        let file = encapsulated(ENCAPSULATED, SMALL, table, fragments);
        assert_eq!(frames_of(&file).unwrap(), whole, "{what}");
        // Without the delimiter, and with junk in its place.
        let n = file.len() - 8;
        assert_eq!(frames_of(&file[..n]).unwrap(), whole, "{what}, no delimiter");
        let mut junk = file[..n].to_vec();
        junk.extend([0x55; 100]);
        assert_eq!(frames_of(&junk).unwrap(), whole, "{what}, junk");
        // Only one of them.
        let header = header_of(&file);
        let image = Image::of(&header).unwrap();
        let mut collected = Collected { only: Some(1), ..Collected::default() };
        unroll(&file[..], Path::new("x"), &header, &image, &Budget::new(MEMORY), &mut collected).unwrap();
        assert_eq!(collected.frames[1], whole[1], "{what}");
    }
    for (what, table) in [
        ("no table", &[][..]),
        ("beside a fragment", &[0, 20, 41]),
        ("not increasing", &[0, 40, 20]),
        ("repeated", &[0, 0, 40]),
        ("not from the first", &[10, 20, 40]),
        ("past the end", &[0, 20, 4000]),
    ] {
        let error = frames_of(&encapsulated(ENCAPSULATED, SMALL, table, &halves)).unwrap_err();
        assert!(error.contains("6 fragments") && error.contains("3 frames stated"), "{what}: {error}");
    }
    let one = Spec { frames: "", ..SMALL };
    let many: Vec<Vec<u8>> = [&[1, 2][..], &[], &[3], &[4, 0]].map(<[u8]>::to_vec).to_vec();
    assert_eq!(frames_of(&encapsulated(ENCAPSULATED, one, &[], &many)).unwrap(), [[1, 2, 3, 4]]);
    let few = frames_of(&encapsulated(ENCAPSULATED, SMALL, &[], &whole[..2])).unwrap_err();
    assert!(few.contains("2 fragments"), "{few}");
}

#[test]
fn an_extended_offset_table_is_used() {
    let whole = three();
    let mut w = Writer::with_meta(Syntax::ExplicitLe, ENCAPSULATED);
    image(&mut w, SMALL);
    let entries: Vec<u8> = [0_u64, 12, 32].into_iter().flat_map(u64::to_le_bytes).collect();
    // OV has the long form, as OB has.
    w.element(0x7fe0_0001, "OB", &entries);
    let cut = [whole[0].clone(), whole[1][..2].to_vec(), whole[1][2..].to_vec(), whole[2].clone()];
    pixel_items(&mut w, &[], &cut);
    w.head(0xfffe_e0dd, "", 0);
    assert_eq!(frames_of(&w.bytes).unwrap(), whole);
}

/// A lossless JPEG of 2 x 2 samples of 8 bits, first-order prediction, made by hand (ITU-T T.81 H.1): each
/// difference has a category of 3 bits at most 7, coded as its own number.
fn jpeg(samples: [i32; 4]) -> Vec<u8> {
    let mut out = vec![0xff, 0xd8, 0xff, 0xc3, 0, 11, 8, 0, 2, 0, 2, 1, 1, 0x11, 0];
    // Eight codes of four bits, 0 to 7.
    out.extend([0xff, 0xc4, 0, 27, 0, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    out.truncate(out.len() - 1);
    out.extend([0, 1, 2, 3, 4, 5, 6, 7]);
    out.extend([0xff, 0xda, 0, 8, 1, 1, 0, 1, 0, 0]);
    let [a, b, c, d] = samples;
    // The first is predicted by 128, the first of a row by the one above, others by the one to the left.
    let mut bits = Vec::new();
    for difference in [a - 128, b - a, c - a, d - c] {
        let category = 32 - difference.unsigned_abs().leading_zeros();
        let value = if difference < 0 { difference - 1 } else { difference };
        bits.extend((0..4).rev().map(|i| category >> i & 1));
        bits.extend((0..category).rev().map(|i| (value.cast_unsigned() >> i) & 1));
    }
    bits.resize(bits.len().next_multiple_of(8), 1);
    for byte in bits.chunks(8) {
        let byte = byte.iter().fold(0, |all, bit| all << 1 | bit);
        out.push(u8::try_from(byte).unwrap());
        if byte == 0xff {
            out.push(0);
        }
    }
    out.extend([0xff, 0xd9]);
    if out.len() % 2 == 1 {
        out.push(0);
    }
    out
}

#[test]
fn frames_in_several_fragments_are_found_by_their_start_markers() {
    let samples = [[130, 120, 131, 140], [100, 101, 102, 103], [128, 128, 128, 200]];
    let frames: Vec<Vec<u8>> =
        samples.iter().map(|f| f.iter().map(|v| u8::try_from(*v).unwrap()).collect()).collect();
    let streams: Vec<Vec<u8>> = samples.iter().map(|f| jpeg(*f)).collect();
    assert_eq!(frames_of(&encapsulated(JPEG, SMALL, &[], &streams)).unwrap(), frames);
    let cut: Vec<Vec<u8>> = streams.iter().flat_map(|s| s.chunks(20).map(<[u8]>::to_vec)).collect();
    assert!(cut.len() > 6);
    assert_eq!(frames_of(&encapsulated(JPEG, SMALL, &[], &cut)).unwrap(), frames);
    assert_eq!(frames_of(&encapsulated(JPEG, SMALL, &[0, 5, 9], &cut)).unwrap(), frames);
    // No table item at all: the first item is a frame.
    let one = Spec { frames: "", ..SMALL };
    let mut w = Writer::with_meta(Syntax::ExplicitLe, JPEG);
    image(&mut w, one);
    w.head(0x7fe0_0010, "OB", u32::MAX);
    w.element(0xfffe_e000, "", &streams[0]);
    assert_eq!(frames_of(&w.bytes).unwrap(), frames[..1]);
    // More bits, or another size, than the header says.
    let other = Spec { size: [4, 1], ..one };
    let error = frames_of(&encapsulated(JPEG, other, &[], &streams[..1])).unwrap_err();
    assert!(error.contains("it is 2x2, and the header says 4x1"), "{error}");
    let colour = Spec { samples: 3, photometric: "RGB", ..one };
    let error = frames_of(&encapsulated(JPEG, colour, &[], &streams[..1])).unwrap_err();
    assert!(error.contains("1 samples a pixel, and the header says 3"), "{error}");
}

/// Enhanced, RLE, many frames with a group each.
fn many(frames: u32, syntax: Option<Syntax>) -> Vec<u8> {
    let native = syntax.unwrap_or(Syntax::ExplicitLe);
    let mut w = Writer::with_meta(native, syntax.map_or(RLE, Syntax::uid));
    image(&mut w, Spec { frames: &frames.to_string(), ..Spec::default() });
    w.head(0x5200_9230, "SQ", u32::MAX);
    for i in 0..frames {
        w.head(0xfffe_e000, "", u32::MAX);
        w.nest(0x0020_9113, true, |w| {
            w.text(0x0020_0032, "DS", &format!("0\\0\\{i}"));
        });
        w.nest(0x0020_9111, false, |w| w.text(0x0020_9056, "SH", "1"));
        w.head(0xfffe_e00d, "", 0);
    }
    w.head(0xfffe_e0dd, "", 0);
    if syntax.is_some() {
        w.element(0x7fe0_0010, "OW", &vec![7; 8 * frames as usize]);
    } else {
        let value = |i: u32| u16::try_from(i).unwrap();
        let fragments: Vec<Vec<u8>> = (0..frames).map(|i| rle16(&[value(i), 1, 2, 3])).collect();
        pixel_items(&mut w, &[], &fragments);
        w.head(0xfffe_e0dd, "", 0);
    }
    w.bytes
}

/// Counts frames, keeping none.
#[derive(Default)]
struct Counter {
    rows: u32,
    sum: u64,
}

impl FrameSink for Counter {
    fn row(&mut self, _frame: u32, row: u32, samples: &[u8]) -> Result<(), SourceError> {
        self.rows += 1;
        if row == 0 {
            self.sum += u64::from(bytemuck::pod_read_unaligned::<u16>(&samples[..2]));
        }
        Ok(())
    }
}

#[test]
fn ten_thousand_frames_cost_no_more_memory_than_ten() {
    let mut peaks = Vec::new();
    for frames in [10, 10_000] {
        let file = many(frames, None);
        let (header, scanned) = peak_of(|| scan(&file[..]).unwrap());
        let mut last = None;
        let mut told = 0;
        let ((), visited) = peak_of(|| {
            visit(&file[..], &header, &mut |frame| {
                told += 1;
                last = frame.position;
                true
            })
            .unwrap();
        });
        assert_eq!((told, last), (frames, Some([0.0, 0.0, f64::from(frames - 1)])));
        let image = Image::of(&header).unwrap();
        let mut counter = Counter::default();
        let ((), unrolled) = peak_of(|| {
            unroll(&file[..], Path::new("x"), &header, &image, &Budget::new(MEMORY), &mut counter).unwrap();
        });
        assert_eq!((counter.rows, counter.sum), (2 * frames, u64::from(frames) * u64::from(frames - 1) / 2));
        peaks.push([scanned, visited, unrolled]);
    }
    println!("bytes held at most while scanning, visiting and unrolling 10 and 10000 frames: {peaks:?}");
    for (few, many) in peaks[0].iter().zip(&peaks[1]) {
        assert!(many <= &(few + 64) && *many < 64 << 10, "{peaks:?}");
    }
}

#[test]
fn a_long_native_file_is_read_by_position() {
    // 300 MiB that are a hole but for the last row.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.dcm");
    let mut w = Writer::with_meta(Syntax::ExplicitLe, Syntax::ExplicitLe.uid());
    image(&mut w, Spec { size: [512, 512], frames: "600", ..Spec::default() });
    w.head(0x7fe0_0010, "OW", 600 * 512 * 512 * 2);
    let start = w.bytes.len() as u64;
    std::fs::write(&path, &w.bytes).unwrap();
    let file = File::options().write(true).read(true).open(&path).unwrap();
    let end = start + 600 * 512 * 512 * 2;
    file.set_len(end).unwrap();
    file.write_all_at(&[5; 1024], end - 1024).unwrap();
    let (row, peak) = peak_of(|| {
        let header = scan(&file).unwrap();
        let image = Image::of(&header).unwrap();
        let Access::Native { offset, frame_bytes } = image.access else { panic!("{image:?}") };
        assert_eq!((image.frames, offset, frame_bytes), (600, start, 512 * 512 * 2));
        let mut row = vec![0; 1024];
        file.read_exact_at(&mut row, offset + 599 * frame_bytes + 511 * 1024).unwrap();
        image.layout.decode(&mut row);
        row
    });
    assert!(row == [5; 1024] && peak < 32 << 10, "{peak}");
    file.set_len(end - 1).unwrap();
    let error = Image::of(&scan(&file).unwrap()).unwrap_err().to_string();
    assert_eq!(error, "the pixels are cut short: 314572799 bytes of 314572800");
}

#[test]
fn deflated_files_hold_a_small_window_and_bombs_end() {
    let spec = Spec { size: [300, 200], frames: "4", ..Spec::default() };
    let pixels: Vec<u8> =
        (0..300 * 200 * 2 * 4_u32).map(|i| u8::try_from((i ^ i >> 7) % 251).unwrap()).collect();
    for zlib in [false, true] {
        let file = deflated(&native(Syntax::ExplicitLe, spec, &pixels), zlib);
        let (header, peak) = peak_of(|| scan(&file[..]).unwrap());
        assert!(peak < 128 << 10, "{peak}");
        let image = Image::of(&header).unwrap();
        let mut counter = Counter::default();
        let ((), peak) = peak_of(|| {
            unroll(&file[..], Path::new("x"), &header, &image, &Budget::new(MEMORY), &mut counter).unwrap();
        });
        println!("deflated: {peak} bytes");
        assert!(counter.rows == 800 && peak < 192 << 10, "{peak}");
        assert_eq!(frames_of(&file).unwrap().concat(), pixels);
        let cut = frames_of(&file[..file.len() * 2 / 3]).unwrap_err();
        assert!(cut.contains("the pixels are cut short"), "{cut}");
    }
    // An element of 400 MB of zeros before the pixels: 400 KB of file.
    let mut w = Writer::with_meta(Syntax::ExplicitLe, Syntax::ExplicitLe.uid());
    image(&mut w, spec);
    w.head(0x0009_1001, "OB", 400_000_000);
    let (meta, rest) = deflated_parts(&w.bytes);
    let mut encoder = flate2::write::DeflateEncoder::new(meta, flate2::Compression::fast());
    encoder.write_all(rest).unwrap();
    for _ in 0..400 {
        encoder.write_all(&vec![0; 1_000_000]).unwrap();
    }
    let bomb = encoder.finish().unwrap();
    let (error, peak) = peak_of(|| scan(&bomb[..]).unwrap_err().to_string());
    assert!(error.contains("longer than") && peak < 128 << 10, "{error} {peak}");
}

/// Everything that is done with a file, within bounds; what was refused is fine.
fn bounded(file: &[u8]) -> bool {
    let (sound, peak) = peak_of(|| {
        let Ok(header) = scan(file) else { return false };
        let mut told = 0_u64;
        // A count of frames is only believed once the pixels have room for them.
        let Ok(image) = Image::of(&header) else { return false };
        let visited = visit(file, &header, &mut |_| {
            told += 1;
            told < 100_000
        });
        let mut bytes = Limited { left: 1 << 20 };
        let unrolled = unroll(file, Path::new("x"), &header, &image, &Budget::new(MEMORY), &mut bytes);
        visited.is_ok() && unrolled.is_ok()
    });
    assert!(peak < 3 << 19, "{peak} bytes held for {} bytes of input", file.len());
    sound
}

/// Takes a MiB and no more.
struct Limited {
    left: usize,
}

impl FrameSink for Limited {
    fn row(&mut self, _frame: u32, _row: u32, samples: &[u8]) -> Result<(), SourceError> {
        self.left = self
            .left
            .checked_sub(samples.len())
            .ok_or_else(|| SourceError::NoVolume { path: "x".into(), found: Instead::Nothing })?;
        Ok(())
    }
}

/// Small files of every kind.
fn kinds() -> Vec<Vec<u8>> {
    let lut = {
        let mut w = Writer::with_meta(Syntax::ExplicitBe, Syntax::ExplicitBe.uid());
        image(&mut w, Spec { size: [4, 1], ..Spec::default() });
        w.nest(0x0028_3000, false, |w| {
            w.head(0x0028_3002, "US", 6);
            [3, 0, 16].into_iter().for_each(|v| w.u16(v));
            w.element(0x0028_3006, "OW", &[1; 6]);
        });
        w.element(0x7fe0_0010, "OW", &[0; 8]);
        w.bytes
    };
    let rgb = Spec { size: [2, 2], bits: [8, 8, 7], samples: 3, photometric: "RGB", ..Spec::default() };
    let bits = Spec { size: [5, 3], bits: [1, 1, 0], frames: "3", ..Spec::default() };
    let streams: Vec<Vec<u8>> = [[1, 2, 3, 4], [9, 8, 7, 6], [5; 4]].map(jpeg).to_vec();
    let cut: Vec<Vec<u8>> = streams.iter().flat_map(|s| s.chunks(20).map(<[u8]>::to_vec)).collect();
    let plane = vec![1, 2, 3, 4];
    vec![
        many(3, None),
        many(3, Some(Syntax::ImplicitLe)),
        many(3, Some(Syntax::ExplicitBe)),
        deflated(&many(3, Some(Syntax::ExplicitLe)), false),
        encapsulated(JPEG, SMALL, &[], &cut),
        encapsulated(
            ENCAPSULATED,
            SMALL,
            &[0, 20, 40],
            &three().concat().chunks(2).map(<[u8]>::to_vec).collect::<Vec<_>>(),
        ),
        encapsulated(RLE, rgb, &[], &[rle(&[plane.clone(), plane.clone(), plane.clone()])]),
        native(Syntax::ExplicitLe, Spec { planar: 1, ..rgb }, &plane.repeat(3)),
        native(Syntax::ExplicitLe, bits, &[0x5a; 6]),
        lut,
    ]
}

#[test]
fn every_truncation_is_bounded() {
    for (kind, file) in kinds().into_iter().enumerate() {
        assert!(bounded(&file), "{kind}");
        let pixels = header_of(&file).pixels.unwrap();
        let before = usize::try_from(pixels.offset).unwrap();
        for end in 0..file.len() {
            let sound = bounded(&file[..end]);
            assert!(!sound || end >= before.min(file.len() - 16), "{kind} cut at {end} of {}", file.len());
        }
    }
}

#[test]
fn random_flips_never_panic_or_swell() {
    let mut random = Random(0x1234_5678_9abc_def0);
    for (kind, clean) in kinds().into_iter().enumerate() {
        let mut sound = 0;
        for _ in 0..2000 {
            let mut bytes = clean.clone();
            for _ in 0..=random.below(3) {
                // Half of them behind the fixed parts, where the interesting lengths are.
                let at = if random.below(2) == 0 {
                    random.below(bytes.len())
                } else {
                    132 + random.below(bytes.len() - 132)
                };
                bytes[at] = random.byte();
            }
            sound += usize::from(bounded(&bytes));
        }
        // Both fates must occur, or nothing was tried.
        assert!((10..1990).contains(&sound), "kind {kind}: {sound} of 2000 sound");
    }
}
