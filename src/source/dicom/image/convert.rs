//! Conversion of cells of a row, or samples of a decoder, into delivered samples.

use super::describe::{Image, Mapping};
use super::lut::{Lut, luminance};
use super::pixels::{CellFormat, Padding, PixelLayout};
use crate::codec::{CodecError, FrameFormat, damaged};
use crate::source::dicom::parse::error::ScanError;
use crate::source::dicom::parse::header::DicomHeader;
use crate::source::dicom::parse::window::ReadAt;
use crate::volume::Endian;

/// Converter of rows into the delivered samples of an image.
pub(crate) struct Converter<'a> {
    image: &'a Image,
    table: Option<Lut>,
    padding: Option<Padding>,
    /// Layout of decoded samples.
    decoded: PixelLayout,
    /// Decoded samples as cells.
    cells: Vec<u8>,
    out: Vec<u8>,
}

impl<'a> Converter<'a> {
    /// Reads the tables that the image needs.
    pub(crate) fn new<R: ReadAt + ?Sized>(
        input: &R,
        header: &DicomHeader,
        image: &'a Image,
    ) -> Result<Self, ScanError> {
        let signed = image.layout.stored().is_signed();
        let table = match image.mapping {
            Mapping::ModalityLut => Some(Lut::modality(input, header, signed)?),
            Mapping::Palette => Some(Lut::palette(input, header, signed)?),
            _ => None,
        };
        Ok(Self { image, table, padding: None, decoded: image.layout, cells: Vec::new(), out: Vec::new() })
    }

    pub(crate) fn set_padding(&mut self, padding: Option<Padding>) {
        self.padding = padding;
    }

    /// Prepares for decoding a codestream of this format.
    ///
    /// Its precision may differ from Bits Stored, and it may not know the sign. As many bits as it has are the value,
    /// at most Bits Stored; the header says whether they have a sign. Only where it has more than Bits Stored do these
    /// lie where High Bit says.
    pub(crate) fn begin(&mut self, format: &FrameFormat) -> Result<(), CodecError> {
        let stored = self.image.layout.stored();
        let allocated = u32::try_from(8 * stored.bytes()).unwrap_or(32);
        let precision = u32::from(format.precision);
        if precision == 0 || precision > allocated {
            return Err(damaged(format!(
                "it has {precision} bits a sample, and the header allocates {allocated}"
            )));
        }
        let bits = precision.min(stored.bits());
        let shift = if precision >= stored.bits() + stored.shift() { stored.shift() } else { 0 };
        let native = if Endian::Little.is_native() { Endian::Little } else { Endian::Big };
        let cell = CellFormat::integer(allocated, bits, shift, stored.is_signed(), native);
        let layout = &self.image.layout;
        self.decoded = PixelLayout::new(layout.columns, layout.rows, layout.scalar(), cell);
        Ok(())
    }

    /// A row of decoded samples.
    pub(crate) fn decoded(&mut self, samples: &[i32]) -> &[u8] {
        let mut cells = std::mem::take(&mut self.cells);
        cells.clear();
        let little = Endian::Little.is_native();
        let width = self.decoded.stored().bytes();
        for sample in samples {
            let bytes: [u8; 4] = bytemuck::cast(*sample);
            // The low bytes, which come first on a little-endian machine.
            let low = if little { bytes.get(..width) } else { bytes.get(4 - width..) };
            cells.extend_from_slice(low.unwrap_or(&[]));
        }
        let layout = self.decoded;
        self.convert(&layout, &mut cells);
        self.cells = cells;
        self.finish()
    }

    /// A row of cells as the file has them.
    pub(crate) fn cells(&mut self, cells: &mut Vec<u8>) -> &[u8] {
        let layout = self.image.layout;
        self.convert(&layout, cells);
        self.finish()
    }

    fn finish(&self) -> &[u8] {
        &self.out
    }

    /// Converts `cells` into `out`; the old content of `out` becomes `cells`.
    fn convert(&mut self, layout: &PixelLayout, cells: &mut Vec<u8>) {
        let (samples, width) = (usize::from(self.image.samples), layout.stored().bytes());
        match self.image.mapping {
            Mapping::Values => {
                layout.decode_padded(cells, self.padding);
                std::mem::swap(&mut self.out, cells);
                return;
            }
            Mapping::Components => {
                layout.decode(cells);
                std::mem::swap(&mut self.out, cells);
                return;
            }
            _ => layout.decode(cells),
        }
        self.out.clear();
        let stored = layout.stored();
        let value = |pixel: &[u8], i: usize| stored.value(pixel.get(i * width..).unwrap_or(&[]));
        match self.image.mapping {
            Mapping::ModalityLut | Mapping::Palette => {
                let (padding, Some(table)) = (self.padding, &self.table) else { return };
                for cell in cells.chunks_exact(width) {
                    let value = value(cell, 0);
                    // Padding has no entry of its own.
                    let entry = if padding.is_some_and(|p| p.holds(value)) { 0 } else { table.of(value) };
                    self.out.extend_from_slice(bytemuck::bytes_of(&entry));
                }
            }
            Mapping::Rgb => {
                for pixel in cells.chunks_exact(samples * width) {
                    let [red, green, blue] = [0, 1, 2].map(|i| u32::try_from(value(pixel, i)).unwrap_or(0));
                    push(&mut self.out, luminance([red, green, blue]), width);
                }
            }
            Mapping::Luma422 => {
                for pair in cells.chunks(4 * width) {
                    // Y Y Cb Cr
                    self.out.extend_from_slice(pair.get(..2 * width).unwrap_or(pair));
                }
                self.out.truncate(self.image.layout.columns as usize * width);
            }
            _ => {
                for pixel in cells.chunks_exact(samples * width) {
                    self.out.extend_from_slice(pixel.get(..width).unwrap_or(&[]));
                }
            }
        }
    }
}

/// Appends the low `width` bytes (1 or 2) in native order.
fn push(out: &mut Vec<u8>, value: u32, width: usize) {
    if width == 1 {
        out.push(u8::try_from(value).unwrap_or(u8::MAX));
    } else {
        out.extend_from_slice(bytemuck::bytes_of(&u16::try_from(value).unwrap_or(u16::MAX)));
    }
}
