//! Decodes the frames of a file row by row: compressed, deflated, bits, tables and colour.
//!
//! Memory: a row of cells, a row of samples, a table of at most 128 KiB (384 while a palette is read) and the buffers
//! of the frame's decoder. None of it grows with the number of frames.

use std::io;
use std::path::Path;

use super::convert::Converter;
use super::describe::{Image, Mapping, Storage};
use super::encapsulated::{FrameReader, Frames, ListedFrame, Span, read_full};
use super::pixels::Padding;
use crate::budget::{Budget, Reservation, TooSmall};
use crate::codec::rle::RleFormat;
use crate::codec::{CodecError, FrameFormat, RowSink, damaged, jpeg, jpeg2000, jpegls, rle};
use crate::fault::{bad, conversions};
use crate::source::dicom::parse::deflated::InflateReader;
use crate::source::dicom::parse::error::{DeflateFault, ScanError};
use crate::source::dicom::parse::header::DicomHeader;
use crate::source::dicom::parse::syntax::{Codec, TransferSyntax};
use crate::source::dicom::parse::window::ReadAt;
use crate::volume::{Result, SourceError, SourceFault};

/// Read buffers, decoder tables and other small allocations of any DICOM codec but JPEG 2000.
const DICOM_DECODER: u64 = 256 << 10;

/// Buffers for a code-block, lists of a tile and other small allocations of JPEG 2000, which counts all it holds.
const JPEG2000_DECODER: u64 = 64 << 10;

/// The tables of a palette, read as it is turned into grey.
const DICOM_PALETTE: u64 = 384 << 10;

/// The table of a modality look-up, 2^16 entries of 16 bits.
const DICOM_LOOKUP: u64 = 128 << 10;

/// Receives decoded frames.
pub trait FrameSink {
    /// True if this frame is wanted; others are skipped.
    fn wants(&mut self, frame: u32) -> bool {
        let _ = frame;
        true
    }

    /// Stored values of this frame to be replaced (see [`super::pixels::PixelLayout::padding`]).
    fn padding(&mut self, frame: u32) -> Option<Padding> {
        let _ = frame;
        None
    }

    /// One row, top to bottom: samples of the image's delivered type in native byte order.
    ///
    /// # Errors
    /// The samples cannot be kept.
    fn row(&mut self, frame: u32, row: u32, samples: &[u8]) -> Result;
}

/// Decodes the frames that are wanted, in the order of the file, row by row, in one pass.
///
/// # Errors
/// A frame is damaged or of a kind that is not decoded here, the memory is too little, the file failed,
/// or the sink did. The `path` is for messages.
pub fn unroll<R: ReadAt + ?Sized>(
    input: &R,
    path: &Path,
    header: &DicomHeader,
    image: &Image,
    memory: &Budget,
    sink: &mut dyn FrameSink,
) -> Result {
    let walked = if header.transfer_syntax == TransferSyntax::Deflated {
        deflated(input, header, image, memory, sink)
    } else {
        match image.storage {
            Storage::Coded(codec) => coded(input, header, image, codec, memory, sink),
            Storage::Plain | Storage::Bits => plain(&[input], input, header, image, memory, sink),
        }
    };
    walked.map_err(|failure| failure.at(path, image))
}

impl Image {
    /// Bytes of memory that [`unroll`] holds for this image: an upper bound for all but JPEG 2000, which
    /// takes what its codestream needs, and JPEG whose components come one after another, which is held whole.
    pub fn unroll_bytes(&self) -> u64 {
        let samples = u64::from(self.layout.columns) * u64::from(self.samples);
        let frame = u64::from(self.layout.rows) * samples;
        let codec = match self.storage {
            Storage::Coded(Codec::Jpeg2000) => {
                return self.jpeg2000_bytes(frame) + self.rows_bytes() + self.table_bytes();
            }
            // Sixteen rows of 32 bits in the widest subsampling.
            Storage::Coded(Codec::Jpeg | Codec::JpegLs) => samples * 4 * 20,
            Storage::Coded(Codec::JpegPasses) => frame.saturating_mul(2) + samples * 4 * 20,
            Storage::Coded(Codec::Rle | Codec::None) | Storage::Plain | Storage::Bits => 0,
        };
        codec + self.rows_bytes() + DICOM_DECODER + self.table_bytes()
    }

    /// The codestream, coefficients of 32 bits, lines that the wavelets go along (nine of the longer side), and a
    /// thirty-second of the samples for code-blocks and their pieces, which is enough for blocks of 32 x 32.
    fn jpeg2000_bytes(&self, frame: u64) -> u64 {
        let codestream =
            if self.frames == 1 { self.held_bytes } else { self.held_bytes.min(frame.saturating_mul(2)) };
        let longest = u64::from(self.layout.columns.max(self.layout.rows));
        let interleaved =
            if self.samples > 1 { u64::from(self.layout.columns) * u64::from(self.samples) * 4 } else { 0 };
        codestream.saturating_add(frame.saturating_mul(4))
            + frame / 32
            + 36 * longest
            + interleaved
            + JPEG2000_DECODER
    }

    /// Rows held here, in addition to the decoder.
    fn rows_bytes(&self) -> u64 {
        u64::from(self.layout.columns) * u64::from(self.samples) * 16
    }

    fn table_bytes(&self) -> u64 {
        match self.mapping {
            Mapping::Palette => DICOM_PALETTE,
            Mapping::ModalityLut => DICOM_LOOKUP,
            _ => 0,
        }
    }
}

/// The cure for a file that proved damaged when it was decoded.
const LEAVE_OUT: &str = "; copy the file again, or leave it out";

/// A failure whose file is not named yet.
enum Failure {
    Scan(ScanError),
    Codec(u32, CodecError),
    Read(u32, io::Error),
    Memory { needed_bytes: u64, allowed_bytes: u64 },
    Cut { needed: u64, got: u64 },
    Sink(SourceError),
}

conversions!(Failure {
    error: ScanError => Self::Scan(error),
    refused: TooSmall => Self::Memory { needed_bytes: refused.needed_bytes, allowed_bytes: refused.left_bytes },
    error: io::Error => Self::Read(0, error),
});

impl Failure {
    fn at(self, path: &Path, image: &Image) -> SourceError {
        let (path, frames) = (path.to_path_buf(), image.frames);
        let fault = match self {
            Self::Sink(error) => return error,
            Self::Scan(ScanError::Io(fault)) => {
                return SourceError::from(SourceFault::Unreadable { path, cause: fault.into() });
            }
            Self::Scan(error) => bad!("{error}{LEAVE_OUT}"),
            Self::Read(slice, cause) | Self::Codec(slice, CodecError::Io(cause)) => {
                match DeflateFault::inside(&cause) {
                    Some(fault) => bad!("cannot be decoded: {fault}"),
                    None => return SourceError::from(SourceFault::ReadFailed { path, slice, cause }),
                }
            }
            // A decoder reserves memory part by part, and stops at the first part that is too large.
            Self::Codec(_, CodecError::Memory { needed_bytes, allowed_bytes }) => {
                let whole = needed_bytes.max(image.unroll_bytes());
                let needed_bytes = whole.saturating_add(whole / 16);
                return SourceError::from(SourceFault::Memory { path, needed_bytes, allowed_bytes });
            }
            Self::Memory { needed_bytes, allowed_bytes } => {
                return SourceError::from(SourceFault::Memory { path, needed_bytes, allowed_bytes });
            }
            Self::Codec(frame, error) => {
                let frame =
                    if frames > 1 { format!("in frame {} ", u64::from(frame) + 1) } else { String::new() };
                bad!("{frame}{error}")
            }
            Self::Cut { needed, got } => bad!("the pixels are cut short: {got} bytes of {needed}{LEAVE_OUT}"),
        };
        fault.at(path).into()
    }
}

/// A deflated file: one inflater, or one for each plane of colour, each going forwards.
fn deflated<R: ReadAt + ?Sized>(
    input: &R,
    header: &DicomHeader,
    image: &Image,
    memory: &Budget,
    sink: &mut dyn FrameSink,
) -> Result<(), Failure> {
    let open = || InflateReader::up_to(input, header.dataset, u64::MAX);
    let tables = open()?;
    if image.planar {
        let planes = [open()?, open()?, open()?];
        return plain(&[&planes[0], &planes[1], &planes[2]], &tables, header, image, memory, sink);
    }
    plain(&[&open()?], &tables, header, image, memory, sink)
}

/// Whole cells, or bits, at known offsets: `inputs` has one for all, or one for each plane.
fn plain<R: ReadAt + ?Sized>(
    inputs: &[&R],
    tables: &R,
    header: &DicomHeader,
    image: &Image,
    memory: &Budget,
    sink: &mut dyn FrameSink,
) -> Result<(), Failure> {
    let Some(pixels) = header.pixels else { return Ok(()) };
    let mut rows = Rows::new(tables, header, image, memory)?;
    let end = pixels.offset.saturating_add(pixels.available);
    for frame in 0..image.frames {
        if !sink.wants(frame) {
            continue;
        }
        rows.converter.set_padding(sink.padding(frame));
        let base = pixels.offset.saturating_add(u64::from(frame).saturating_mul(image.frame_bytes()));
        let cells = Cells { inputs, base, value: pixels.offset, end };
        rows.plain_frame(&cells, frame, sink)?;
    }
    Ok(())
}

/// Compressed frames.
fn coded<R: ReadAt + ?Sized>(
    input: &R,
    header: &DicomHeader,
    image: &Image,
    codec: Codec,
    memory: &Budget,
    sink: &mut dyn FrameSink,
) -> Result<(), Failure> {
    let Some(pixels) = header.pixels else { return Ok(()) };
    let mut rows = Rows::new(input, header, image, memory)?;
    // The decoder may hold the rest of the memory; its needs show in the codestream.
    let decoder = memory.reserve_rest();
    let mut frames = Frames::of(input, header, &pixels, codec, image.frames)?;
    let mut frame = 0;
    while let Some(span) = frames.next()? {
        if sink.wants(frame) {
            rows.converter.set_padding(sink.padding(frame));
            if codec == Codec::None {
                let listed = ListedFrame::new(input, &span)?;
                let cells = Cells { inputs: &[&listed], base: 0, value: 0, end: span.bytes };
                rows.plain_frame(&cells, frame, sink)?;
            } else {
                rows.coded_frame(input, &span, codec, decoder.bytes(), frame, sink)?;
            }
        }
        frame += 1;
    }
    Ok(())
}

/// Location of the cells of a frame.
struct Cells<'a, R: ReadAt + ?Sized> {
    inputs: &'a [&'a R],
    /// Offset of the frame, of the first frame, and of the end of all.
    base: u64,
    value: u64,
    end: u64,
}

/// Buffers for a row, and its converter.
struct Rows<'a> {
    image: &'a Image,
    converter: Converter<'a>,
    /// Cells of a row as they are in the file, components side by side.
    cells: Vec<u8>,
    /// One plane of them, or a row of swapped bytes.
    part: Vec<u8>,
    _memory: Reservation,
}

impl<'a> Rows<'a> {
    fn new<R: ReadAt + ?Sized>(
        tables: &R,
        header: &DicomHeader,
        image: &'a Image,
        memory: &Budget,
    ) -> Result<Self, Failure> {
        let held = memory.reserve(image.rows_bytes() + image.table_bytes())?;
        Ok(Self {
            image,
            converter: Converter::new(tables, header, image)?,
            cells: Vec::new(),
            part: Vec::new(),
            _memory: held,
        })
    }

    fn plain_frame<R: ReadAt + ?Sized>(
        &mut self,
        cells: &Cells<'_, R>,
        frame: u32,
        sink: &mut dyn FrameSink,
    ) -> Result<(), Failure> {
        let image = self.image;
        let layout = &image.layout;
        let columns = u64::from(layout.columns);
        for row in 0..layout.rows {
            if image.storage == Storage::Bits {
                let pixels =
                    (u64::from(frame) * u64::from(layout.rows) + u64::from(row)).saturating_mul(columns);
                let (first, last) = (pixels / 8, (pixels + columns).div_ceil(8));
                self.fill_part(cells, 0, cells.value + first, last - first)?;
                let skip = usize::try_from(pixels % 8).unwrap_or(0);
                self.cells.clear();
                // The first pixel is the lowest bit (PS3.5 8.1.1).
                let bits = self.part.iter().flat_map(|byte| (0..8).map(move |bit| byte >> bit & 1));
                self.cells.extend(bits.skip(skip).take(layout.columns as usize));
            } else if image.planar {
                self.read_planes(cells, row)?;
            } else {
                let bytes = image.frame_bytes() / u64::from(layout.rows);
                self.read_row(cells, cells.base + u64::from(row) * bytes, bytes)?;
            }
            let samples = self.converter.cells(&mut self.cells);
            sink.row(frame, row, samples).map_err(Failure::Sink)?;
        }
        Ok(())
    }

    /// A row that is one run of bytes.
    fn read_row<R: ReadAt + ?Sized>(
        &mut self,
        cells: &Cells<'_, R>,
        at: u64,
        bytes: u64,
    ) -> Result<(), Failure> {
        if !self.image.swapped {
            self.fill_part(cells, 0, at, bytes)?;
            std::mem::swap(&mut self.cells, &mut self.part);
            return Ok(());
        }
        // Whole words around the row; the last word of all has its padding byte in the file.
        let odd = (at - cells.value) % 2;
        self.fill_part(cells, 0, at - odd, (bytes + odd).next_multiple_of(2))?;
        self.part.as_chunks_mut::<2>().0.iter_mut().for_each(|word| word.reverse());
        let odd = usize::try_from(odd).unwrap_or(0);
        self.cells.clear();
        self.cells.extend(self.part.iter().skip(odd).take(usize::try_from(bytes).unwrap_or(0)));
        Ok(())
    }

    /// A row from three planes, its components side by side.
    fn read_planes<R: ReadAt + ?Sized>(&mut self, cells: &Cells<'_, R>, row: u32) -> Result<(), Failure> {
        let image = self.image;
        let width = image.layout.stored().bytes();
        let samples = usize::from(image.samples);
        let plane_bytes = image.frame_bytes() / u64::from(image.samples);
        let row_bytes = plane_bytes / u64::from(image.layout.rows);
        let mut together = std::mem::take(&mut self.cells);
        together.resize(image.layout.columns as usize * samples * width, 0);
        for plane in 0..samples {
            let at = cells.base + plane as u64 * plane_bytes + u64::from(row) * row_bytes;
            self.read_plane_row(cells, plane, at, row_bytes)?;
            for (pixel, cell) in together.chunks_exact_mut(samples * width).zip(self.part.chunks_exact(width))
            {
                if let Some(slot) = pixel.get_mut(plane * width..(plane + 1) * width) {
                    slot.copy_from_slice(cell);
                }
            }
        }
        self.cells = together;
        Ok(())
    }

    /// One plane's row into `part`.
    fn read_plane_row<R: ReadAt + ?Sized>(
        &mut self,
        cells: &Cells<'_, R>,
        plane: usize,
        at: u64,
        bytes: u64,
    ) -> Result<(), Failure> {
        if self.image.swapped {
            self.read_row(cells, at, bytes)?;
            std::mem::swap(&mut self.cells, &mut self.part);
            return Ok(());
        }
        self.fill_part(cells, plane, at, bytes)
    }

    fn fill_part<R: ReadAt + ?Sized>(
        &mut self,
        cells: &Cells<'_, R>,
        plane: usize,
        at: u64,
        bytes: u64,
    ) -> Result<(), Failure> {
        let Some(input) = cells.inputs.get(plane).or(cells.inputs.first()) else { return Ok(()) };
        let length = usize::try_from(bytes).unwrap_or(usize::MAX);
        self.part.resize(length, 0);
        let inside = usize::try_from(cells.end.saturating_sub(at)).unwrap_or(usize::MAX).min(length);
        let have = read_full(*input, self.part.get_mut(..inside).unwrap_or(&mut []), at)?;
        if have < length {
            let needed = self.image.frame_bytes().saturating_mul(self.image.frames.into());
            let got = (at - cells.value).saturating_add(have as u64);
            return Err(Failure::Cut { needed: needed.max(got + 1), got });
        }
        Ok(())
    }

    fn coded_frame<R: ReadAt + ?Sized>(
        &mut self,
        input: &R,
        span: &Span,
        codec: Codec,
        memory_bytes: u64,
        frame: u32,
        sink: &mut dyn FrameSink,
    ) -> Result<(), Failure> {
        let image = self.image;
        let mut receiver = Receiver { rows: self, frame, next: 0, sink, error: None };
        let mut reader = FrameReader::new(input, span);
        let decoded = match codec {
            Codec::Jpeg | Codec::JpegPasses => jpeg::decode(&mut reader, memory_bytes, &mut receiver),
            Codec::JpegLs => jpegls::decode(&mut reader, memory_bytes, &mut receiver),
            Codec::Jpeg2000 => jpeg2000::decode(&mut reader, span.bytes, memory_bytes, &mut receiver),
            Codec::Rle | Codec::None => {
                let listed = ListedFrame::new(input, span)?;
                let format = RleFormat {
                    columns: image.layout.columns,
                    rows: image.layout.rows,
                    components: image.samples,
                    bytes_per_sample: u8::try_from(image.layout.stored().bytes()).unwrap_or(0),
                };
                rle::decode(&listed, &format, &mut receiver)
            }
        };
        let (next, error) = (receiver.next, receiver.error.take());
        if let Some(error) = error {
            return Err(Failure::Sink(error));
        }
        decoded.map_err(|error| Failure::Codec(frame, error))?;
        if next < image.layout.rows {
            let mismatch = damaged(format!("it has {next} rows of {}", image.layout.rows));
            return Err(Failure::Codec(frame, mismatch));
        }
        Ok(())
    }
}

/// Receives decoded rows, once their format matches the header.
struct Receiver<'r, 'a> {
    rows: &'r mut Rows<'a>,
    frame: u32,
    next: u32,
    sink: &'r mut dyn FrameSink,
    /// Error of the sink, which does not fit a decoder's error.
    error: Option<SourceError>,
}

impl RowSink for Receiver<'_, '_> {
    fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        let image = self.rows.image;
        let layout = &image.layout;
        if (format.columns, format.rows) != (layout.columns, layout.rows) {
            let (size, stated) = ([format.columns, format.rows], [layout.columns, layout.rows]);
            return Err(damaged(format!(
                "it is {}x{}, and the header says {}x{}",
                size[0], size[1], stated[0], stated[1]
            )));
        }
        if format.components != image.samples {
            let (samples, stated) = (format.components, image.samples);
            return Err(damaged(format!("it has {samples} samples a pixel, and the header says {stated}")));
        }
        self.rows.converter.begin(format)
    }

    fn row(&mut self, samples: &[i32]) -> Result<(), CodecError> {
        if self.next >= self.rows.image.layout.rows {
            return Err(damaged("it has more rows than it says"));
        }
        let converted = self.rows.converter.decoded(samples);
        match self.sink.row(self.frame, self.next, converted) {
            Ok(()) => {
                self.next += 1;
                Ok(())
            }
            Err(error) => {
                self.error = Some(error);
                Err(CodecError::Io(io::ErrorKind::Other.into()))
            }
        }
    }
}
