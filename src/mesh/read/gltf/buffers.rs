//! Bytes of a glTF file: its own, those of files next to it, and those written into its text.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::Limits;
use super::super::appearance::Image;
use super::super::linked::{open_linked, unescaped};
use super::super::stop::Stop;
use super::super::stream::Stream;
use super::super::vertices::{Number, Spool, Vertices};
use super::MESHOPT;
use super::json::{Accessor, Described, Embedded, Shape};
use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::mesh::read::stop::{bad_reference, buffer_lies, count_lies, outside};
use crate::platform::PositionalFile;

/// Longest distance of two items.
const MAX_STRIDE: u64 = 252;
/// Bytes of a matrix.
const MATRIX: u64 = 64;

/// A run of bytes of a file.
#[derive(Clone, Debug)]
pub(super) struct Section {
    pub(super) file: Arc<PositionalFile>,
    pub(super) offset: u64,
    pub(super) bytes: u64,
}

/// Items in a file.
#[derive(Clone, Debug)]
pub(super) struct Items {
    pub(super) run: Section,
    pub(super) stride: u64,
    pub(super) count: u64,
    pub(super) number: Number,
    pub(super) shape: Shape,
    /// Factor of a stored number; whole numbers may be parts of 1.
    pub(super) scale: f64,
}

pub(super) struct Buffers {
    runs: Vec<Section>,
}

pub(super) fn out_of_range(part: &str) -> Stop {
    bad_reference(part).into()
}

fn bad_base64() -> Fault {
    bad!("holds data that are not well-formed base64; write them to a file beside it, or as GLB")
}

pub(super) fn item<'a, T>(list: &'a [T], at: u32, part: &str) -> Result<&'a T, Stop> {
    list.get(at as usize).ok_or_else(|| out_of_range(part))
}

/// Finds the bytes that URIs lead to.
pub(super) struct Resolver<'a> {
    pub(super) path: &'a Path,
    pub(super) own: Arc<PositionalFile>,
    /// Binary part of a binary file.
    pub(super) binary: Option<Section>,
    pub(super) limits: &'a Limits<'a>,
    /// Every other file that the mesh is read from.
    pub(super) files: Vec<PathBuf>,
    /// A scratch file for data within the text, and its length.
    pub(super) decoded: Option<(Arc<PositionalFile>, u64)>,
}

impl Resolver<'_> {
    /// Decodes a `data:` string (RFC 2397, base64 only) into the scratch file.
    fn decode(&mut self, at: Embedded) -> Result<Section, Stop> {
        let mut stream = Stream::new(&self.own, at.offset);
        let mut left = at.bytes;
        let mut head = Vec::new();
        loop {
            if left == 0 || head.len() > 256 {
                return Err(bad_base64().into());
            }
            let [byte] = stream.take()?;
            left -= 1;
            if byte == b',' {
                break;
            }
            head.push(byte);
        }
        if !head.ends_with(b";base64") {
            return Err(bad_base64().into());
        }
        let (file, offset) = match self.decoded.take() {
            Some(known) => known,
            None => {
                (Arc::new(crate::scratch::unnamed(self.limits.scratch).map_err(Stop::Scratch)?.into()), 0)
            }
        };
        let mut out = std::io::BufWriter::with_capacity(32 << 10, file.onwards(offset));
        let (mut bits, mut held, mut written) = (0_u32, 0, 0_u64);
        for _ in 0..left {
            let [byte] = stream.take()?;
            let value = match byte {
                b'A'..=b'Z' => byte - b'A',
                b'a'..=b'z' => byte - b'a' + 26,
                b'0'..=b'9' => byte - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                // An escape before a slash, and padding.
                b'\\' | b'=' => continue,
                _ => return Err(bad_base64().into()),
            };
            bits = bits << 6 | u32::from(value);
            held += 6;
            if held >= 8 {
                held -= 8;
                out.write_all(&[(bits >> held).to_le_bytes()[0]]).map_err(Stop::Scratch)?;
                bits &= (1 << held) - 1;
                written += 1;
            }
        }
        out.flush().map_err(Stop::Scratch)?;
        drop(out);
        self.decoded = Some((file.clone(), offset + written));
        Ok(Section { file, offset, bytes: written })
    }

    /// The bytes that a URI leads to.
    pub(super) fn section(&mut self, uri: &str, described: &Described) -> Result<Section, Stop> {
        if let Some(number) = uri.strip_prefix("data:") {
            let at = number.parse().ok().and_then(|at: usize| described.embedded.get(at));
            let at = at.ok_or_else(|| out_of_range("a buffer"))?;
            return self.decode(*at);
        }
        if uri.contains("://") {
            return Err(outside(uri).into());
        }
        let (file, path, bytes) = open_linked(self.path, &unescaped(uri), self.limits.follow_links)?;
        self.files.push(path);
        Ok(Section { file: Arc::new(file), offset: 0, bytes })
    }
}

impl Buffers {
    pub(super) fn open(described: &Described, resolver: &mut Resolver<'_>) -> Result<Self, Stop> {
        let mut runs = Vec::new();
        for (at, buffer) in described.root.buffers.iter().enumerate() {
            let run = match &buffer.uri {
                Some(uri) => resolver.section(uri, described)?,
                None if at == 0 => resolver.binary.clone().ok_or_else(|| out_of_range("a buffer"))?,
                None => return Err(out_of_range("a buffer")),
            };
            if run.bytes < buffer.byte_length {
                let (stated, held) = (buffer.byte_length, run.bytes);
                return Err(buffer_lies(stated, held).into());
            }
            runs.push(Section { bytes: buffer.byte_length, ..run });
        }
        Ok(Self { runs })
    }

    pub(super) fn view(&self, described: &Described, at: u32) -> Result<(Section, Option<u64>), Stop> {
        let view = item(&described.root.buffer_views, at, "a view of a buffer")?;
        if view.extensions.meshopt.is_some() {
            return Err(bad!("{MESHOPT}").into());
        }
        let run = item(&self.runs, view.buffer, "a buffer")?;
        let end = view.byte_offset.checked_add(view.byte_length);
        if end.is_none_or(|end| end > run.bytes) {
            return Err(out_of_range("a view of a buffer"));
        }
        let run = Section { offset: run.offset + view.byte_offset, bytes: view.byte_length, ..run.clone() };
        Ok((run, view.byte_stride))
    }

    pub(super) fn items(&self, described: &Described, at: u32) -> Result<Items, Stop> {
        let accessor: &Accessor = item(&described.root.accessors, at, "an accessor")?;
        if accessor.sparse.is_some() {
            return Err(bad!("has sparse accessors, which are not read; write them out").into());
        }
        let Some(view) = accessor.buffer_view else {
            return Err(bad!("has accessors without bytes, which are not read; write them out").into());
        };
        let (number, most) = match accessor.component_type {
            5120 => (Number::I8, 127.0),
            5121 => (Number::U8, 255.0),
            5122 => (Number::I16, 32_767.0),
            5123 => (Number::U16, 65_535.0),
            5125 => (Number::U32, 1.0),
            5126 => (Number::F32, 1.0),
            _ => return Err(out_of_range("an accessor")),
        };
        let parts = accessor.shape.parts().ok_or_else(|| out_of_range("an accessor"))?;
        let own = parts * number.bytes();
        let (run, stride) = self.view(described, view)?;
        let stride = stride.unwrap_or(own);
        if stride < own || stride > MAX_STRIDE {
            return Err(out_of_range("a view of a buffer"));
        }
        let end = accessor
            .count
            .checked_sub(1)
            .and_then(|last| last.checked_mul(stride)?.checked_add(own)?.checked_add(accessor.byte_offset));
        if end.is_none_or(|end| end > run.bytes) {
            let held = run.bytes.saturating_sub(accessor.byte_offset) / stride.max(1);
            return Err(count_lies(accessor.count, held).into());
        }
        let run = Section { offset: run.offset + accessor.byte_offset, ..run };
        let scale = if accessor.normalized { 1.0 / most } else { 1.0 };
        Ok(Items { run, stride, count: accessor.count, number, shape: accessor.shape, scale })
    }

    /// Matrices of singles, one behind the other.
    pub(super) fn matrices(&self, described: &Described, at: u32) -> Result<Vec<Affine>, Stop> {
        let accessor: &Accessor = item(&described.root.accessors, at, "an accessor")?;
        let view = accessor.buffer_view.ok_or_else(|| out_of_range("an accessor"))?;
        let (run, _) = self.view(described, view)?;
        let held = run.bytes.saturating_sub(accessor.byte_offset) / MATRIX;
        if (accessor.shape, accessor.component_type) != (Shape::Matrix, 5126) || accessor.count > held {
            return Err(out_of_range("an accessor"));
        }
        let mut stream = Stream::new(&run.file, run.offset + accessor.byte_offset);
        let mut matrix = || {
            let mut rows = [[0.0; 4]; 3];
            for at in 0..16 {
                let number = f32::from_le_bytes(stream.take()?);
                if let Some(row) = rows.get_mut(at % 4) {
                    row[at / 4] = number.into();
                }
            }
            Ok(Affine { rows })
        };
        (0..accessor.count).map(|_| matrix()).collect()
    }

    /// An image, whose bytes stand in a view.
    pub(super) fn image(&self, described: &Described, view: u32, name: String) -> Result<Image, Stop> {
        let (run, _) = self.view(described, view)?;
        Ok(Image { name, file: run.file, offset: run.offset, bytes: run.bytes })
    }
}

impl Items {
    /// Vertices that were written, as items.
    pub(super) fn written(spool: Spool) -> Result<Self, Stop> {
        let Vertices { file, record: stride, count, .. } = spool.into_vertices()?;
        let run = Section { file: Arc::new(file), offset: 0, bytes: count * stride };
        Ok(Self { run, stride, count, number: Number::F64, shape: Shape::Three, scale: 1.0 })
    }

    /// The numbers of one item, which is there.
    pub(super) fn at(&self, index: u64) -> Result<[f64; 4], Stop> {
        let width = usize::try_from(self.number.bytes()).unwrap_or(8);
        let parts = self.shape.parts().and_then(|parts| usize::try_from(parts).ok()).unwrap_or(0);
        let mut raw = [0; 32];
        let raw = raw.get_mut(..parts * width).unwrap_or_default();
        self.run.file.read_exact_at(raw, self.run.offset + index * self.stride).map_err(Stop::reading)?;
        let mut numbers = [0.0; 4];
        for (out, raw) in numbers.iter_mut().zip(raw.chunks(width)) {
            *out = self.number.read(raw, false) * self.scale;
        }
        Ok(numbers)
    }

    /// Vertices of three numbers; pairs repeat their second.
    pub(super) fn vertices(&self) -> Result<Vertices, Stop> {
        let width = usize::try_from(self.number.bytes()).unwrap_or(4);
        let last = if self.shape == Shape::Two { 1 } else { 2 };
        Ok(Vertices {
            file: self.run.file.try_clone().map_err(Stop::Read)?,
            offset: self.run.offset,
            record: self.stride,
            fields: [0, 1, last].map(|at| (at * width, self.number)),
            big: false,
            count: self.count,
        })
    }
}
