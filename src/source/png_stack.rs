//! PNG pictures as slices, in natural order of their names.
//!
//! Grey values of 8 or 16 bits, and of 1, 2 or 4 bits scaled to 8 as PNG defines it. Rows are unpacked one at
//! a time into the scratch file. x runs along the rows, y down, z with the files; PNG knows no third
//! distance, so spacing is 1 mm with a warning. Numbers that are missing in the names are gaps (`numbered`).

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use png::{ColorType, DecodingError, Limits, Transformations};

use super::OpenOptions;
use super::files::{FileList, FileSet, base_name};
use super::formats::Slices;
use super::header::{unreadable, unusable};
use super::numbered::judge;
use super::payload::{StoredVolume, Target, Unroll, regular, section};
use crate::fault::{Fault, bad};
use crate::geom::{Affine, Dims};
use crate::platform::PositionalFile;
use crate::volume::{Endian, Note, Rescale, Result, ScalarType, SourceDescription, VolumeInfo, VolumeSource};

const MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";

/// Signature, length and name of the first chunk, and its 13 bytes.
const HEAD_BYTES: usize = 29;

/// Bytes that the decoder may allocate for chunks other than the picture.
const CHUNK_BYTES: usize = 64 << 10;

/// The decoder of a PNG file: the inflater, its window, and two rows.
const PNG_DECODER: u64 = 512 << 10;

/// Greatest expansion by deflate: bytes made of one.
const MAX_EXPANSION: u64 = 1032;

/// True for a PNG picture.
pub(super) fn recognise(head: &[u8], _: &Path) -> bool {
    head.starts_with(MAGIC)
}

/// Opens pictures as the slices of one volume.
pub(super) fn open(list: FileList, options: &OpenOptions) -> Vec<Slices> {
    let files = (0..list.len()).collect();
    let judged = judge(list, options.gaps);
    vec![Slices { files, volumes: judged.and_then(|(list, order)| Ok(vec![order.apply(stack(list)?)])) }]
}

fn stack(list: FileList) -> Result<Box<dyn VolumeSource>> {
    let mut first: Option<Head> = None;
    let mut file_bytes = 0_u64;
    for index in 0..list.len() {
        let path = list.path(index);
        file_bytes = file_bytes.saturating_add(regular(&path)?);
        let head = Head::read(&path).map_err(|cause| unreadable(&path, cause))?;
        head.check().map_err(|fault| unusable(&path, fault))?;
        let expected = *first.get_or_insert(head);
        if (head.size, head.scalar()) != (expected.size, expected.scalar()) {
            let (picture, first) = (head.facts(), expected.facts());
            return Err(unusable(
                &path,
                bad!(
                    "is {picture} where the first slice is {first}; slices of a volume are alike in size and type, move the other away"
                ),
            ));
        }
    }
    let path = list.path(0);
    let head = first.ok_or_else(|| unusable(&path, bad!("holds no picture")))?;
    let count = u32::try_from(list.len()).unwrap_or(u32::MAX);
    let dims = Dims::new(head.size[0], head.size[1], count)
        .ok_or_else(|| unusable(&path, bad!("{} in {count} slices are out of range", head.facts())))?;
    let bytes = dims.voxels() * head.scalar().bytes() as u64;
    // Samples smaller than a byte grow by a factor of 8 at most.
    if bytes > file_bytes.saturating_mul(8 * MAX_EXPANSION) {
        return Err(unusable(
            &path,
            bad!("its header promises {bytes} bytes, more than {file_bytes} bytes of PNG can hold"),
        ));
    }
    let name = if count == 1 {
        base_name(&path)
    } else {
        base_name(path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")))
    };
    let mut notes = vec![Note::no_spacing("PNG"), Note::no_directions("PNG")];
    if head.depth < 8 {
        notes.push(Note::new(format!("samples of {} bits are scaled to 0..255", head.depth)));
    }
    let info = VolumeInfo {
        dims,
        scalar: head.scalar(),
        rescale: Rescale::IDENTITY,
        spacing_mm: [1.0; 3],
        affine: Affine::from_spacing([1.0; 3]),
        description: SourceDescription {
            format: "png".into(),
            name,
            files: count.into(),
            bytes,
            ..SourceDescription::default()
        },
        notes,
    };
    let recipe = Pictures { files: Arc::new(FileSet::new(list)), row_bytes: u64::from(head.size[0]) * 2 };
    Ok(Box::new(StoredVolume::sequential(info, Box::new(recipe))))
}

/// The first chunk of a PNG file.
#[derive(Clone, Copy, Debug)]
struct Head {
    size: [u32; 2],
    depth: u8,
    color: u8,
    interlaced: bool,
}

impl Head {
    fn read(path: &Path) -> io::Result<Self> {
        let mut bytes = [0; HEAD_BYTES];
        PositionalFile::open(path)?.read_exact_at(&mut bytes, 0)?;
        let number = |at: usize| {
            bytes.get(at..).and_then(|b| b.first_chunk::<4>()).map_or(0, |b| u32::from_be_bytes(*b))
        };
        if !bytes.starts_with(MAGIC) || bytes.get(12..16) != Some(b"IHDR") {
            return Err(bad!("its PNG header is damaged").in_stream());
        }
        Ok(Self {
            size: [number(16), number(20)],
            depth: bytes[24],
            color: bytes[25],
            interlaced: bytes[28] != 0,
        })
    }

    /// Refuses kinds of pictures that are not read.
    fn check(&self) -> Result<(), Fault> {
        if self.color != 0 {
            return Err(bad!("has {}, and grey values are needed; convert it to grey", colour(self.color)));
        }
        if ![1, 2, 4, 8, 16].contains(&self.depth) {
            return Err(bad!("its PNG header is damaged: samples of {} bits", self.depth));
        }
        if self.interlaced {
            return Err(bad!("is interlaced, which is not read; save it without"));
        }
        Ok(())
    }

    /// Size and type, which all pictures of a stack share.
    fn facts(&self) -> String {
        let [x, y] = self.size;
        format!("{x}x{y} of {} bits", self.depth)
    }

    fn scalar(&self) -> ScalarType {
        if self.depth == 16 { ScalarType::U16 } else { ScalarType::U8 }
    }
}

/// The recipe: one picture after another, row by row.
struct Pictures {
    files: Arc<FileSet>,
    row_bytes: u64,
}

impl Unroll for Pictures {
    fn memory_bytes(&self) -> u64 {
        // Two rows of the decoder, one as it is written.
        PNG_DECODER + CHUNK_BYTES as u64 + 4 * self.row_bytes
    }

    fn files(&self) -> &FileList {
        self.files.list()
    }

    fn unroll(&self, info: &VolumeInfo, target: &Target<'_>) -> Result<Vec<Note>> {
        for z in 0..info.dims.nz() {
            let index = z as usize;
            let path = || self.files.list().path(index);
            let mut result = Ok(());
            self.files
                .with(index, |file| {
                    result = picture(file, z, info, target, &path);
                    Ok(())
                })
                .map_err(|cause| unreadable(&path(), cause))?;
            result?;
        }
        Ok(Vec::new())
    }
}

/// Unrolls one picture.
fn picture(
    file: &PositionalFile,
    z: u32,
    info: &VolumeInfo,
    target: &Target<'_>,
    path: &dyn Fn() -> PathBuf,
) -> Result {
    let failed = |error: DecodingError| match error {
        DecodingError::IoError(cause) if cause.raw_os_error().is_some() => unreadable(&path(), cause),
        DecodingError::IoError(cause) if cause.kind() == io::ErrorKind::UnexpectedEof => {
            unusable(&path(), bad!("the PNG picture ends early; the file was cut short, copy it again"))
        }
        other => unusable(&path(), bad!("the PNG picture is damaged ({other}); copy the file again")),
    };
    let mut decoder = png::Decoder::new_with_limits(
        Forward(section(file, 0, u64::MAX)),
        Limits { bytes: CHUNK_BYTES + 8 * info.dims.nx() as usize },
    );
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.set_transformations(Transformations::IDENTITY);
    let head = decoder.read_header_info().map_err(failed)?;
    // Compared with the survey: the file may have been changed since.
    let same = head.color_type == ColorType::Grayscale
        && !head.interlaced
        && (head.bit_depth as usize).div_ceil(8) == info.scalar.bytes()
        && [head.width, head.height] == [info.dims.nx(), info.dims.ny()];
    if !same {
        return Err(unusable(&path(), bad!("is not the picture that it was a moment ago")));
    }
    let depth = head.bit_depth as usize;
    let mut reader = decoder.read_info().map_err(failed)?;
    let mut samples = vec![0; info.dims.nx() as usize * info.scalar.bytes()];
    for y in 0..info.dims.ny() {
        let row = reader.next_row().map_err(failed)?;
        let row = row.ok_or_else(|| unusable(&path(), bad!("the PNG picture has too few rows")))?;
        if depth < 8 {
            expand(row.data(), depth, &mut samples);
        } else {
            let length = samples.len().min(row.data().len());
            let (to, from) = (samples.get_mut(..length), row.data().get(..length));
            if let (Some(to), Some(from)) = (to, from) {
                to.copy_from_slice(from);
            }
            Endian::Big.to_native(info.scalar.bytes(), &mut samples);
        }
        target.write(&samples, target.offset(y, z))?;
    }
    // Reads the rest after the last row, which checks its checksum.
    reader.finish().map_err(failed)
}

/// Samples of 1, 2 or 4 bits scaled to 0..255.
fn expand(packed: &[u8], depth: usize, out: &mut [u8]) {
    let most = (1_u16 << depth) - 1;
    let per_byte = 8 / depth;
    for (i, sample) in out.iter_mut().enumerate() {
        let byte = u16::from(packed.get(i / per_byte).copied().unwrap_or(0));
        let value = byte >> (8 - depth - i % per_byte * depth) & most;
        *sample = u8::try_from(value * 255 / most).unwrap_or(u8::MAX);
    }
}

/// The decoder asks for `Seek`, but only reads on.
struct Forward<R>(R);

impl<R: Read> Read for Forward<R> {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        self.0.read(buf)
    }
}

impl<R: io::BufRead> io::BufRead for Forward<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.0.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        self.0.consume(amount);
    }
}

impl<R> io::Seek for Forward<R> {
    fn seek(&mut self, _: io::SeekFrom) -> io::Result<u64> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

fn colour(code: u8) -> &'static str {
    match code {
        2 => "RGB colours",
        3 => "colours of a palette",
        4 => "grey values with transparency",
        6 => "RGB colours with transparency",
        _ => "an unknown kind of colour",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_samples_are_scaled() {
        let mut out = [9; 5];
        expand(&[0b1010_0000], 1, &mut out);
        assert_eq!(out, [255, 0, 255, 0, 0]);
        expand(&[0b0001_1011, 0b1100_0000], 2, &mut out);
        assert_eq!(out, [0, 85, 170, 255, 255]);
        expand(&[0x0f, 0x10, 0x80], 4, &mut out);
        assert_eq!(out, [0, 255, 17, 0, 136]);
    }

    #[test]
    fn headers_of_other_kinds_are_refused_by_name() {
        let head = Head { size: [3, 2], depth: 8, color: 0, interlaced: false };
        assert!(head.check().is_ok());
        for (head, fault) in [
            (
                Head { color: 2, ..head },
                bad!("has {}, and grey values are needed; convert it to grey", colour(2)),
            ),
            (Head { depth: 3, ..head }, bad!("its PNG header is damaged: samples of {} bits", 3)),
            (Head { interlaced: true, ..head }, bad!("is interlaced, which is not read; save it without")),
        ] {
            assert_eq!(head.check(), Err(fault));
        }
    }
}
