//! Parts of DICOM files with frames: fragments, offset tables, functional groups, tables, deflate.

use std::io::Write as _;
use std::path::Path;

use infobyte::budget::Budget;
use infobyte::source::dicom::{
    Access, DicomHeader, FrameGeometry, FrameSink, Image, Padding, ReadAt, ScanError, scan, unroll, visit,
};
use infobyte::volume::SourceError;

use super::dicom::{Syntax, Writer};

pub(crate) const RLE: &str = "1.2.840.10008.1.2.5";
pub(crate) const ENCAPSULATED: &str = "1.2.840.10008.1.2.1.98";
pub(crate) const JPEG: &str = "1.2.840.10008.1.2.4.70";
pub(crate) const DEFLATED: &str = "1.2.840.10008.1.2.1.99";

/// What an image is, for [`image`].
#[derive(Clone, Copy)]
pub(crate) struct Spec<'a> {
    pub(crate) size: [u16; 2],
    /// Bits Allocated, Bits Stored, High Bit.
    pub(crate) bits: [u16; 3],
    pub(crate) signed: bool,
    pub(crate) samples: u16,
    pub(crate) planar: u16,
    pub(crate) photometric: &'a str,
    pub(crate) frames: &'a str,
}

impl Default for Spec<'_> {
    fn default() -> Self {
        Self {
            size: [2, 2],
            bits: [16, 16, 15],
            signed: false,
            samples: 1,
            planar: 0,
            photometric: "MONOCHROME2",
            frames: "",
        }
    }
}

/// The elements every image has, without pixels.
pub(crate) fn image(w: &mut Writer, spec: Spec<'_>) {
    w.text(0x0008_0008, "CS", "ORIGINAL\\PRIMARY");
    w.text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.2.1");
    w.text(0x0008_0060, "CS", "CT");
    w.text(0x0020_000e, "UI", "1.2.3");
    w.us(0x0028_0002, spec.samples);
    w.text(0x0028_0004, "CS", spec.photometric);
    w.us(0x0028_0006, spec.planar);
    if !spec.frames.is_empty() {
        w.text(0x0028_0008, "IS", spec.frames);
    }
    w.us(0x0028_0010, spec.size[1]);
    w.us(0x0028_0011, spec.size[0]);
    w.us(0x0028_0100, spec.bits[0]);
    w.us(0x0028_0101, spec.bits[1]);
    w.us(0x0028_0102, spec.bits[2]);
    w.us(0x0028_0103, spec.signed.into());
}

/// A file of such an image with these bytes as pixels.
pub(crate) fn native(syntax: Syntax, spec: Spec<'_>, pixels: &[u8]) -> Vec<u8> {
    let mut w = Writer::with_meta(syntax, syntax.uid());
    image(&mut w, spec);
    w.element(0x7fe0_0010, "OW", pixels);
    w.bytes
}

/// A file of such an image with these fragments, after an offset table.
pub(crate) fn encapsulated(uid: &str, spec: Spec<'_>, table: &[u32], fragments: &[Vec<u8>]) -> Vec<u8> {
    let mut w = Writer::with_meta(Syntax::ExplicitLe, uid);
    image(&mut w, spec);
    pixel_items(&mut w, table, fragments);
    w.head(0xfffe_e0dd, "", 0);
    w.bytes
}

/// The pixel element and its items, without the delimiter.
pub(crate) fn pixel_items(w: &mut Writer, table: &[u32], fragments: &[Vec<u8>]) {
    w.head(0x7fe0_0010, "OB", u32::MAX);
    w.head(0xfffe_e000, "", u32::try_from(4 * table.len()).unwrap());
    table.iter().for_each(|entry| w.u32(*entry));
    for fragment in fragments {
        w.element(0xfffe_e000, "", fragment);
    }
}

/// One RLE frame: byte planes, most significant first, as literal runs (PS3.5 annex G).
pub(crate) fn rle(planes: &[Vec<u8>]) -> Vec<u8> {
    let mut header = vec![u32::try_from(planes.len()).unwrap()];
    let mut body = Vec::new();
    for plane in planes {
        header.push(64 + u32::try_from(body.len()).unwrap());
        for run in plane.chunks(128) {
            body.push(u8::try_from(run.len() - 1).unwrap());
            body.extend(run);
        }
        if body.len() % 2 == 1 {
            body.push(0);
        }
    }
    header.resize(16, 0);
    header.into_iter().flat_map(u32::to_le_bytes).chain(body).collect()
}

/// One RLE frame of 16-bit samples.
pub(crate) fn rle16(samples: &[u16]) -> Vec<u8> {
    let [high, low] = [1, 0].map(|i: usize| samples.iter().map(|s| s.to_le_bytes()[i]).collect());
    rle(&[high, low])
}

/// Meta header of a sound explicit little-endian file made one of a deflated file, and the dataset.
pub(crate) fn deflated_parts(file: &[u8]) -> (Vec<u8>, &[u8]) {
    let uid = Syntax::ExplicitLe.uid().as_bytes();
    let at = file.windows(uid.len()).position(|part| part == uid).unwrap();
    // The UID grows from 19 bytes and a zero to 22.
    let mut meta = file[..at].to_vec();
    meta[at - 2] = 22;
    meta.extend(DEFLATED.as_bytes());
    (meta, &file[at + 20..])
}

/// A sound explicit little-endian file as a deflated one.
pub(crate) fn deflated(file: &[u8], zlib: bool) -> Vec<u8> {
    let (mut out, rest) = deflated_parts(file);
    let level = flate2::Compression::default();
    out.extend(if zlib {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), level);
        encoder.write_all(rest).unwrap();
        encoder.finish().unwrap()
    } else {
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), level);
        encoder.write_all(rest).unwrap();
        encoder.finish().unwrap()
    });
    out
}

/// Frames as they are delivered, of any file.
#[derive(Default)]
pub(crate) struct Collected {
    pub(crate) frames: Vec<Vec<u8>>,
    pub(crate) padding: Option<Padding>,
    /// The only frame that is wanted.
    pub(crate) only: Option<u32>,
}

impl FrameSink for Collected {
    fn wants(&mut self, frame: u32) -> bool {
        self.only.is_none_or(|only| only == frame)
    }

    fn padding(&mut self, _frame: u32) -> Option<Padding> {
        self.padding
    }

    fn row(&mut self, frame: u32, row: u32, samples: &[u8]) -> Result<(), SourceError> {
        if row == 0 {
            assert!(self.frames.len() <= frame as usize);
            self.frames.resize(frame as usize + 1, Vec::new());
        }
        self.frames[frame as usize].extend(samples);
        Ok(())
    }
}

/// What is allowed to decode the small images of tests.
pub(crate) const MEMORY: u64 = 1 << 20;

pub(crate) fn header_of(file: &[u8]) -> DicomHeader {
    scan(file).unwrap()
}

/// Every frame of a file, by position or unrolled, as its access says.
pub(crate) fn frames_of(file: &[u8]) -> Result<Vec<Vec<u8>>, String> {
    let header = scan(file).map_err(|e| e.to_string())?;
    let image = Image::of(&header).map_err(|e| e.to_string())?;
    let mut collected = Collected::default();
    match image.access {
        Access::Native { offset, frame_bytes } => {
            for frame in 0..image.frames {
                let mut cells = vec![0; usize::try_from(frame_bytes).unwrap()];
                let at = offset + u64::from(frame) * frame_bytes;
                let n = file.read_some_at(&mut cells, at).unwrap();
                assert_eq!(n, cells.len());
                image.layout.decode(&mut cells);
                collected.frames.push(cells);
            }
        }
        Access::Unrolled => {
            unroll(file, Path::new("x.dcm"), &header, &image, &Budget::new(MEMORY), &mut collected)
                .map_err(|e| e.to_string())?;
        }
    }
    Ok(collected.frames)
}

/// Samples of 16 bits.
pub(crate) fn words(bytes: &[u8]) -> Vec<u16> {
    bytes.chunks_exact(2).map(bytemuck::pod_read_unaligned::<u16>).collect()
}

pub(crate) fn geometry_of(file: &[u8]) -> Result<Vec<FrameGeometry>, ScanError> {
    let header = scan(file)?;
    let mut frames = Vec::new();
    visit(file, &header, &mut |frame| {
        frames.push(frame.clone());
        true
    })?;
    Ok(frames)
}
