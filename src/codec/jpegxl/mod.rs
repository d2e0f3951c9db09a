//! JPEG XL (ISO/IEC 18181): bare codestreams and files, lossless, lossy, and recompressed JPEG.
//!
//! Only with the cargo feature `jpeg-xl`, which is off by default because of what is said of memory below.
//!
//! An adapter: the decoder is the crate `jxl`. The stream's header is read first, on its own, and nothing of
//! the image's size is allocated before the receiver accepted it and [`memory_bytes_for`] fits what is
//! allowed. Integers of up to 16 bits are exact where the stream is lossless. What is lossy
//! was within 1 of libjxl, recompressed JPEG within 1 of the JPEG as decoded here; the tests hold 2.
//!
//! What is held: [`memory_bytes_for`], an upper bound of what was measured for the settings of libjxl's
//! encoder (efforts 1 to 9, lossless to distance 8, 64 to 1500 pixels a side, grey and colour). Unlike the
//! decoders beside this one, it is not counted allocation by allocation, for the crate has no such limit; it
//! bounds sizes by level 5 of the standard (transforms, trees, patches, splines) and samples of a frame by
//! the number given. A stream made for the purpose, not merely damaged, can take more: up to four stored
//! frames, a colour profile of 16 MiB, and tables of entropy codes of 32 MiB a set.
//!
//! Time: the groups of pixels that are worked on are counted, so that frames that are never shown end.
//!
//! Not decoded: floating-point samples, or of more than 16 bits; alpha and other extra channels; animations.

use std::io::{self, IoSliceMut};
use std::panic::{AssertUnwindSafe, catch_unwind};

use jxl::api::{
    Endianness, Event, JxlBasicInfo, JxlBitDepth, JxlBitstreamInput, JxlColorType, JxlDataFormat, JxlDecoder,
    JxlDecoderOptions, JxlOutputBuffer, JxlParallelRunner, JxlParallelRunnerFun, JxlPixelFormat,
};
use jxl::error::Error;

use super::{CodecError, FrameBytes, FrameFormat, RowSink};

#[cfg(test)]
mod tests;

/// Tables that the crate keeps once made (2 MiB), and what it takes for a small image.
const FIXED_BYTES: u64 = 4 << 20;

/// Bytes for each pixel besides [`BYTES_PER_SAMPLE`]: its quantisation, low frequencies, rows being put
/// together. Grey is three channels inside where it is lossy.
const BYTES_PER_PIXEL: u64 = 4;

/// Bytes for each delivered sample: itself, and as much of the compressed stream.
const BYTES_PER_SAMPLE: u64 = 4;

/// Compressed bytes offered at a time, so that sections are decoded when they are there instead of being
/// gathered.
const STEP_BYTES: usize = 64 << 10;

/// Widest samples: the crate goes by way of single-precision floats.
const MOST_BITS: u32 = 16;

/// Bytes that any stream may have.
const LEAST_STREAM: u64 = 64 << 10;

/// Side of the smallest groups of pixels, and how often a frame's groups may be visited: 11 passes of a
/// group, with what is done around them, are usual at most.
const GROUP_SIDE: u64 = 128;
const VISITS_PER_GROUP: u64 = 32;
const VISITS: u64 = 256;

/// Samples of a frame that is allowed for however small the image is: patches may be gathered on one.
const LEAST_FRAME: u64 = 256 * 256;

fn damaged(what: impl ToString) -> CodecError {
    CodecError::Damaged(what.to_string())
}

fn unsupported(what: &str) -> CodecError {
    CodecError::Unsupported(what.to_owned())
}

/// Bytes of memory that a frame of this size takes, if its codestream is no longer than 2.5 bytes a sample.
#[must_use]
pub fn memory_bytes_for(columns: u32, rows: u32, components: u8) -> u64 {
    let pixels = u64::from(columns) * u64::from(rows);
    let each = BYTES_PER_PIXEL + BYTES_PER_SAMPLE * u64::from(components);
    FIXED_BYTES.saturating_add(pixels.saturating_mul(each))
}

/// Decodes one frame, holding at most `memory_bytes` as far as the module's text says.
///
/// Colour comes as red, green and blue, also where it was JPEG's luminance and chrominance.
///
/// # Errors
/// The codestream is damaged or ends early, is of a kind named in the module's text, needs more memory
/// than allowed, or `sink` refuses it.
pub fn decode(bytes: &dyn FrameBytes, memory_bytes: u64, sink: &mut dyn RowSink) -> Result<(), CodecError> {
    let header = Header::read(bytes)?;
    let FrameFormat { columns, rows, components, .. } = header.format;
    sink.begin(&header.format)?;
    header.check()?;
    let samples = u64::from(columns) * u64::from(rows) * u64::from(components);
    // Noise is a little longer compressed than it was; a group's part of it is held at a time.
    let longest = samples.saturating_mul(5) / 2;
    let needed_bytes = memory_bytes_for(columns, rows, components)
        .saturating_add(bytes.len().saturating_sub(longest.max(LEAST_STREAM)));
    let too_much = CodecError::Memory { needed_bytes, allowed_bytes: memory_bytes };
    if needed_bytes > memory_bytes {
        return Err(too_much);
    }
    let Ok(samples) = usize::try_from(samples) else { return Err(too_much) };
    let mut image: Vec<u16> = Vec::new();
    image.try_reserve_exact(samples).map_err(|_| too_much)?;
    image.resize(samples, 0);
    header.decode(bytes, &mut image)?;

    let row_samples = columns as usize * usize::from(components);
    let mut row: Vec<i32> = Vec::with_capacity(row_samples);
    for from in image.chunks_exact(row_samples.max(1)) {
        row.clear();
        row.extend(from.iter().map(|sample| i32::from(*sample)));
        sink.row(&row)?;
    }
    Ok(())
}

/// What is known before any pixel.
struct Header {
    format: FrameFormat,
    info: JxlBasicInfo,
}

impl Header {
    fn read(bytes: &dyn FrameBytes) -> Result<Self, CodecError> {
        let mut input = Input::new(bytes);
        let info = fenced(|| {
            let mut decoder = JxlDecoder::new(JxlDecoderOptions::default());
            to_basic_info(&mut decoder, &mut input)?;
            let grey = decoder.current_pixel_format().is_some_and(|format| format.color_type.is_grayscale());
            Ok(decoder.basic_info().cloned().map(|info| (info, grey)))
        });
        let (info, grey) = input.explain(info)?.ok_or_else(|| damaged("it has no header"))?;
        let side = |side: usize| u32::try_from(side).map_err(|_| damaged("its size is out of range"));
        let (columns, rows) = (side(info.size.0)?, side(info.size.1)?);
        let components = info.extra_channels.len().saturating_add(if grey { 1 } else { 3 });
        let format = FrameFormat {
            columns,
            rows,
            components: u8::try_from(components).unwrap_or(u8::MAX),
            precision: u8::try_from(info.bit_depth.bits_per_sample()).unwrap_or(u8::MAX),
            signed: false,
        };
        Ok(Self { format, info })
    }

    /// Is it of a kind that is decoded here?
    fn check(&self) -> Result<(), CodecError> {
        match self.info.bit_depth {
            JxlBitDepth::Float { .. } => return Err(unsupported("floating-point samples")),
            JxlBitDepth::Int { bits_per_sample: 1..=MOST_BITS } => {}
            JxlBitDepth::Int { .. } => return Err(unsupported("samples of more than 16 bits")),
        }
        if !self.info.extra_channels.is_empty() {
            return Err(unsupported("an alpha or other extra channel"));
        }
        if self.info.animation.is_some() {
            return Err(unsupported("an animation"));
        }
        Ok(())
    }

    /// Decodes all samples into `image`, those of a pixel side by side.
    fn decode(&self, bytes: &dyn FrameBytes, image: &mut [u16]) -> Result<(), CodecError> {
        let FrameFormat { columns, rows, components, precision, .. } = self.format;
        let (width, height) = (u64::from(columns), u64::from(rows));
        // Frames are rounded up to whole blocks.
        let frame = (width + 16).saturating_mul(height + 16).max(LEAST_FRAME);
        let mut options = JxlDecoderOptions::default();
        options.sample_limit = usize::try_from(frame.saturating_mul(3)).ok();
        let groups = width.div_ceil(GROUP_SIDE).saturating_mul(height.div_ceil(GROUP_SIDE));
        let mut visits = Visits(VISITS.saturating_add(groups.saturating_mul(VISITS_PER_GROUP)));
        let pixels = JxlPixelFormat {
            color_type: if components == 1 { JxlColorType::Grayscale } else { JxlColorType::Rgb },
            color_data_format: Some(JxlDataFormat::U16 {
                endianness: Endianness::native(),
                bit_depth: precision,
            }),
            extra_channel_format: Vec::new(),
        };
        let row_bytes = columns as usize * usize::from(components) * size_of::<u16>();
        let mut input = Input::new(bytes);
        let more = fenced(|| {
            let mut decoder = JxlDecoder::new(options);
            to_basic_info(&mut decoder, &mut input)?;
            decoder.set_pixel_format(pixels)?;
            let cells: &mut [u8] = bytemuck::cast_slice_mut(image);
            let mut buffers = [JxlOutputBuffer::new(cells, rows as usize, row_bytes)];
            loop {
                match decoder.process(&mut input, Some(&mut buffers), Some(&mut visits))? {
                    Event::FrameComplete { has_more_frames } => return Ok(has_more_frames),
                    Event::NeedMoreInput { size_hint } => return Err(Error::OutOfBounds(size_hint)),
                    Event::Complete => return Err(Error::SectionTooShort),
                    _ => {}
                }
            }
        });
        if input.explain(more)? { Err(unsupported("several frames")) } else { Ok(()) }
    }
}

/// Reads on until size, depth and colour are known.
fn to_basic_info(decoder: &mut JxlDecoder, input: &mut Input<'_>) -> Result<(), Error> {
    loop {
        match decoder.process(input, None, None)? {
            Event::BasicInfo => return Ok(()),
            Event::NeedMoreInput { size_hint } => return Err(Error::OutOfBounds(size_hint)),
            Event::Complete => return Err(Error::SectionTooShort),
            _ => {}
        }
    }
}

/// Runs the crate's code. What it overlooks in a damaged stream ends in a panic: none was seen in 90,000
/// damaged streams, but some were reported of its earlier versions, and one file must not end a whole batch.
/// All that the code borrowed is given up afterwards, so nothing half done is seen.
fn fenced<T>(work: impl FnOnce() -> Result<T, Error>) -> Result<T, CodecError> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(Error::OutOfBounds(_))) => Err(damaged("it ends early")),
        Ok(Err(error)) => Err(damaged(error)),
        Err(_) => Err(damaged("its decoder gave up on it")),
    }
}

/// Feeds the crate.
struct Input<'a> {
    bytes: &'a dyn FrameBytes,
    at: u64,
    /// Why the file could not be read.
    failure: Option<io::Error>,
}

impl<'a> Input<'a> {
    fn new(bytes: &'a dyn FrameBytes) -> Self {
        Self { bytes, at: 0, failure: None }
    }

    /// Puts the file's failure in the place of what the crate made of it.
    fn explain<T>(self, result: Result<T, CodecError>) -> Result<T, CodecError> {
        match self.failure {
            Some(failure) => Err(CodecError::Io(failure)),
            None => result,
        }
    }

    fn fill(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut have = 0;
        while let Some(rest) = buffer.get_mut(have..).filter(|rest| !rest.is_empty()) {
            match self.bytes.read_at(rest, self.at) {
                Ok(0) => break,
                Ok(n) => {
                    have += n;
                    self.at = self.at.saturating_add(n as u64);
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(have)
    }
}

impl JxlBitstreamInput for Input<'_> {
    fn available_bytes(&mut self) -> io::Result<usize> {
        let left = self.bytes.len().saturating_sub(self.at);
        Ok(usize::try_from(left).unwrap_or(usize::MAX).min(STEP_BYTES))
    }

    fn read(&mut self, buffers: &mut [IoSliceMut<'_>]) -> io::Result<usize> {
        let mut have = 0;
        for buffer in buffers {
            match self.fill(buffer) {
                Ok(n) => have += n,
                Err(error) => {
                    let kind = error.kind();
                    self.failure = Some(error);
                    return Err(kind.into());
                }
            }
        }
        Ok(have)
    }
}

/// Runs the crate's tasks one after the other, as many as a sound stream has.
struct Visits(u64);

impl JxlParallelRunner for Visits {
    fn run(&mut self, num: usize, work: &JxlParallelRunnerFun<'_>) -> Result<(), Error> {
        self.run_ordered(num, None, work)
    }

    fn num_threads(&self) -> usize {
        1
    }

    fn run_ordered(
        &mut self,
        num: usize,
        _max_threads: Option<usize>,
        work: &JxlParallelRunnerFun<'_>,
    ) -> Result<(), Error> {
        // A frame that is not shown counts even if nothing is left to do for it.
        let tasks = (num as u64).max(1);
        self.0 = self.0.checked_sub(tasks).ok_or(Error::ApiUsageError("its frames lead nowhere"))?;
        (0..num).try_for_each(work)
    }
}
