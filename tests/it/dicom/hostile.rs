//! No bytes make the header scanner panic, loop, or allocate more than its window and a few short
//! strings: damaged, truncated and lying files yield a sentence. And a sound series of a thousand
//! slices is held in a few hundred KiB.

use crate::prelude::*;
use infobyte::discovery::open_unprepared as open;
use infobyte::source::dicom::Image as Judged;

/// Scans, and holds every scan to a total of 64 KiB of allocations.
fn bounded(bytes: &[u8]) -> Result<DicomHeader, ScanError> {
    let (result, taken) = measured(|| scan(bytes));
    let spent = taken.allocated;
    assert!(spent < 64 << 10, "{spent} bytes allocated for {} bytes of input", bytes.len());
    if let Ok(header) = &result {
        // Whatever was read must also be judged without a panic.
        if let Ok(Judged { access: Access::Native { frame_bytes, .. }, frames, .. }) = Judged::of(header) {
            assert!(header.pixels.unwrap().available >= frame_bytes * u64::from(frames));
        }
    }
    result
}

fn sample(syntax: Syntax, meta: bool) -> Vec<u8> {
    let mut bytes = Image { syntax, meta, clutter: false, ..Image::default() }.bytes();
    // Sequences too, but short: every prefix and many flips are tried.
    let mut w = Writer::bare(syntax);
    w.head(0x0008_1140, "SQ", u32::MAX);
    w.head(0xfffe_e000, "", u32::MAX);
    w.us(0x0028_0010, 9999);
    w.head(0xfffe_e00d, "", 0);
    w.head(0xfffe_e0dd, "", 0);
    let at = bytes.windows(11).position(|s| s == b"Nobody^Real").unwrap() - 8;
    bytes.splice(at..at, w.bytes);
    bytes
}

#[test]
fn the_samples_are_sound() {
    for syntax in Syntax::ALL {
        for meta in [true, false] {
            let header = bounded(&sample(syntax, meta)).unwrap();
            assert_eq!((header.rows, header.columns), (Some(2), Some(2)), "{syntax:?} {meta}");
            assert_eq!(header.modality, "CT");
            assert_eq!(header.pixel_spacing, Some([0.75, 0.5]));
            assert_eq!(header.transfer_syntax.uid(), syntax.uid());
            assert!(Judged::of(&header).is_ok());
        }
    }
}

#[test]
fn every_truncation_is_refused_or_told() {
    for syntax in Syntax::ALL {
        for meta in [true, false] {
            let bytes = sample(syntax, meta);
            let pixels = bounded(&bytes).unwrap().pixels.unwrap();
            let whole = usize::try_from(pixels.offset).unwrap() + 8;
            for end in 0..bytes.len() {
                let usable = bounded(&bytes[..end]).is_ok_and(|h| Judged::of(&h).is_ok());
                assert_eq!(usable, end >= whole, "{syntax:?} {meta} cut at {end} of {}", bytes.len());
            }
        }
    }
}

#[test]
fn random_flips_never_panic_or_allocate() {
    let mut random = Random(0x1234_5678_9abc_def0);
    let mut refused = 0;
    for syntax in Syntax::ALL {
        for meta in [true, false] {
            let clean = sample(syntax, meta);
            for _ in 0..2000 {
                let mut bytes = clean.clone();
                for _ in 0..=random.below(4) {
                    let at = random.below(bytes.len());
                    bytes[at] = random.byte();
                }
                refused += usize::from(bounded(&bytes).is_err());
            }
        }
    }
    // Both fates must occur, or nothing was tried.
    assert!((100..11_900).contains(&refused), "{refused} of 12000 refused");
}

#[test]
fn lying_lengths_are_refused_before_they_are_used() {
    for syntax in Syntax::ALL {
        for (tag, vr) in [(0x0008_0008, "UN"), (0x0009_1001, "OB"), (0x0040_0001, "SQ"), (0x0008_0016, "UN")]
        {
            for length in [0x7fff_fffe, 0xffff_fffe, 0xf000_0000, 1000] {
                let mut w = Writer::with_meta(syntax, syntax.uid());
                w.text(0x0008_0005, "CS", "ISO_IR 100");
                w.head(tag, vr, length);
                w.bytes.extend([b'1'; 16]);
                let error = bounded(&w.bytes).unwrap_err().to_string();
                assert!(error.contains("declares") && error.contains("16 are left"), "{error}");
            }
        }
    }
}

#[test]
fn pixels_longer_than_the_file_are_measured_by_the_file() {
    let mut w = Writer::with_meta(Syntax::ExplicitLe, Syntax::ExplicitLe.uid());
    w.us(0x0028_0010, 2);
    w.us(0x0028_0011, 2);
    w.us(0x0028_0100, 16);
    w.head(0x7fe0_0010, "OW", 0xf000_0000);
    w.bytes.extend([0; 7]);
    let pixels = bounded(&w.bytes).unwrap().pixels.unwrap();
    assert_eq!((pixels.declared, pixels.available), (Some(0xf000_0000), 7));
}

#[test]
fn depth_bombs_and_endless_items_end() {
    for syntax in Syntax::ALL {
        let mut w = Writer::with_meta(syntax, syntax.uid());
        w.text(0x0008_0005, "CS", "ISO_IR 100");
        for _ in 0..100_000 {
            w.head(0x0040_a730, "SQ", u32::MAX);
            w.head(0xfffe_e000, "", u32::MAX);
        }
        let error = bounded(&w.bytes).unwrap_err().to_string();
        assert!(error.contains("nested more than"), "{error}");

        let mut w = Writer::with_meta(syntax, syntax.uid());
        w.head(0x0040_a730, "SQ", u32::MAX);
        for _ in 0..100_000 {
            w.head(0xfffe_e000, "", 0);
        }
        let error = bounded(&w.bytes).unwrap_err().to_string();
        assert!(error.contains("the file ends inside"), "{error}");
    }
}

#[test]
fn zero_lengths_stray_delimiters_and_constant_bytes_are_harmless() {
    for syntax in Syntax::ALL {
        let mut w = Writer::with_meta(syntax, syntax.uid());
        for tag in [0x0008_0008, 0x0008_0016, 0x0020_0032, 0x0028_0010, 0x0028_0030, 0x0028_0100, 0x0028_1053]
        {
            w.head(tag, "UN", 0);
        }
        w.head(0xfffe_e0dd, "", 0);
        w.head(0x7fe0_0010, "OW", 0);
        let header = bounded(&w.bytes).unwrap();
        assert_eq!((header.rows, header.position, header.slope), (None, None, None));
        assert!(Judged::of(&header).is_err());
    }
    for byte in [0, 2, 8, b'D', 0xff] {
        for n in [0, 1, 7, 131, 132, 133, 140, 10_000] {
            let mut bytes = vec![byte; n];
            assert!(bounded(&bytes).is_err(), "{n} x {byte}");
            if n >= 132 {
                bytes[128..132].copy_from_slice(b"DICM");
                let _ = bounded(&bytes);
            }
        }
    }
}

#[test]
fn a_thousand_slices_are_opened_and_held_in_little_memory() {
    let folder = tempfile::tempdir().unwrap();
    for i in 0..1000_u32 {
        let position = [0.0, 0.0, f64::from(i)];
        let image = Image { instance: i, position, ..Image::default() };
        let name = format!("1.2.840.113619.2.55.3.604688119.969.1268071029.{i}.dcm");
        std::fs::write(folder.path().join(name), image.bytes()).unwrap();
    }
    let inputs = [folder.path().to_path_buf()];
    let (series, Taken { held, peak, .. }) = measured(|| open(&inputs, &OpenOptions::default()).unwrap());
    println!("1000 slices: {held} bytes held, {peak} at most while opening");
    assert_eq!(series.info().dims.nz(), 1000);
    // 8 bytes of them a file, by which a change is noticed.
    assert!(held < 158 << 10, "{held} bytes held");
    assert!(peak < 500 << 10, "{peak} bytes while opening");
    let ((), read) = measured(|| {
        series.read_rows(3, 0..2, 0..2, &mut [0; 8]).unwrap();
        series.read_rows(3, 0..2, 0..2, &mut [0; 8]).unwrap();
    });
    // The path of the one open; nothing for the voxels.
    assert!(read.allocated < 1024);
}
