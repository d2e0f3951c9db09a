//! Streams with known samples, and refusals. Damaged streams, memory and whole files are in `tests/jpegxl.rs`.

use super::*;

#[path = "../../../tests/support/jpegxl.rs"]
mod streams;
use streams::*;

#[derive(Default)]
struct Frame {
    format: Option<FrameFormat>,
    samples: Vec<i32>,
    refuses: bool,
}

impl RowSink for Frame {
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        assert!(self.format.replace(*format).is_none(), "begin is called once");
        if self.refuses { Err(unsupported("everything")) } else { Ok(()) }
    }

    fn row(&mut self, samples: &[i32]) -> Result<(), CodecError> {
        let format = self.format.expect("begin comes first");
        assert_eq!(samples.len(), format.columns as usize * usize::from(format.components));
        self.samples.extend_from_slice(samples);
        Ok(())
    }
}

fn try_decode(stream: &[u8], memory_bytes: u64) -> Result<Frame, CodecError> {
    let mut frame = Frame::default();
    decode(&stream.to_vec(), memory_bytes, &mut frame)?;
    Ok(frame)
}

/// Format and samples.
fn decoded(stream: &[u8]) -> ([u32; 4], Vec<i32>) {
    let Frame { format, samples, .. } = try_decode(stream, 16 << 20).unwrap();
    let FrameFormat { columns, rows, components, precision, signed } = format.unwrap();
    assert!(!signed, "the codestream cannot say");
    ([columns, rows, components.into(), precision.into()], samples)
}

/// The image of the script that made the streams.
fn formula(width: i32, height: i32, levels: i32) -> Vec<i32> {
    let at = |x: i32, y: i32| (x * x * 37 + y * 91 + x * y * 13) % levels;
    (0..height).flat_map(|y| (0..width).map(move |x| at(x, y))).collect()
}

#[test]
fn lossless_streams_are_exact() {
    for (stream, precision, levels) in
        [(EIGHT, 8, 256), (BOXED, 8, 256), (TWELVE, 12, 4096), (TWELVE_IN_16, 16, 4096), (SIXTEEN, 16, 65536)]
    {
        assert_eq!(decoded(stream), ([9, 7, 1, precision], formula(9, 7, levels)), "{precision} {levels}");
    }
    let [red, green, blue] = [256, 251, 241].map(|levels| formula(9, 7, levels));
    let colour = red.iter().zip(&green).zip(&blue).flat_map(|((r, g), b)| [*r, *g, *b]).collect();
    assert_eq!(decoded(COLOUR), ([9, 7, 3, 8], colour));
}

#[test]
fn a_frame_of_several_groups_is_exact() {
    let expected = (0..280).flat_map(|y| (0..300).map(move |x| x + 3 * y)).collect();
    assert_eq!(decoded(GROUPS), ([300, 280, 1, 16], expected));
}

/// The largest difference of two lists of samples.
fn farthest(a: &[i32], b: &[i32]) -> u32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

#[test]
fn lossy_streams_are_within_2_of_libjxl() {
    for (stream, format, reference) in
        [(NEAR_GREY, [24, 20, 1, 16], NEAR_GREY_SAMPLES), (NEAR_COLOUR, [12, 10, 3, 8], NEAR_COLOUR_SAMPLES)]
    {
        let (of, samples) = decoded(stream);
        assert_eq!(of, format);
        assert!(farthest(&samples, reference) <= 2, "{} of {format:?}", farthest(&samples, reference));
    }
}

#[test]
fn recompressed_jpeg_is_within_2_of_the_jpeg() {
    let mut jpeg = Frame::default();
    crate::codec::jpeg::decode(&mut &*JPEG_GREY, 1 << 20, &mut jpeg).unwrap();
    let (of, samples) = decoded(RECOMPRESSED_GREY);
    assert_eq!(of, [24, 20, 1, 8]);
    assert!(farthest(&samples, &jpeg.samples) <= 2, "{}", farthest(&samples, &jpeg.samples));
}

#[test]
fn too_little_memory_is_said_and_what_is_asked_for_suffices() {
    for stream in [EIGHT, SIXTEEN, NEAR_COLOUR, RECOMPRESSED_COLOUR, GROUPS] {
        let error = try_decode(stream, 1000).err().expect("it is too little");
        let CodecError::Memory { needed_bytes, allowed_bytes: 1000 } = error else { panic!("{error}") };
        assert!(try_decode(stream, needed_bytes - 1).is_err() && try_decode(stream, needed_bytes).is_ok());
    }
    // What follows a codestream is not read, but a long one would be held.
    let long = [SIXTEEN, &[0; 100_000]].concat();
    let error = try_decode(&long, memory_bytes_for(9, 7, 1)).err().expect("it is longer than planned");
    assert!(matches!(error, CodecError::Memory { .. }), "{error}");
    // What a slice of 512 by 512 is planned with.
    assert_eq!(memory_bytes_for(512, 512, 1), 6 << 20);
}

#[test]
fn what_is_not_decoded_is_named() {
    for (stream, text) in [(ALPHA, "extra channel"), (FLOATS, "floating-point")] {
        let error = try_decode(stream, 16 << 20).err().expect("it is not decoded");
        assert!(matches!(&error, CodecError::Unsupported(what) if what.contains(text)), "{error}");
    }
    for stream in [&b""[..], b"\xff", b"\xff\x0a", b"\0\0\0\x0cJXL \r\n\x87\n", b"\xff\xd8\xff\xe0", &[0; 64]]
    {
        let error = try_decode(stream, 16 << 20).err().expect("it is no stream");
        assert!(matches!(error, CodecError::Damaged(_)), "{error}");
    }
}

#[test]
fn a_receiver_that_refuses_ends_it() {
    let mut frame = Frame { refuses: true, ..Frame::default() };
    let error = decode(&SIXTEEN.to_vec(), 16 << 20, &mut frame).unwrap_err();
    assert!(matches!(error, CodecError::Unsupported(_)) && frame.samples.is_empty(), "{error}");
}

/// A file that cannot be read on.
struct Broken;

impl FrameBytes for Broken {
    fn len(&self) -> u64 {
        1000
    }

    fn read_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<usize> {
        let bytes = SIXTEEN.get(usize::try_from(offset).unwrap()..20).ok_or(io::ErrorKind::TimedOut)?;
        let taken = bytes.len().min(buffer.len());
        buffer[..taken].copy_from_slice(&bytes[..taken]);
        if taken == 0 { Err(io::ErrorKind::TimedOut.into()) } else { Ok(taken) }
    }
}

#[test]
fn a_file_that_fails_is_no_damage() {
    let error = decode(&Broken, 16 << 20, &mut Frame::default()).unwrap_err();
    assert!(matches!(&error, CodecError::Io(cause) if cause.kind() == io::ErrorKind::TimedOut), "{error}");
}

#[test]
fn a_panic_of_the_crate_is_damage() {
    let result: Result<(), CodecError> = fenced(|| panic!("as the crate would"));
    assert!(matches!(result, Err(CodecError::Damaged(_))));
}
