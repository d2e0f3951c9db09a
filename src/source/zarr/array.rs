//! The metadata of an array, of Zarr 2 and 3.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::Read;
use super::packing::{Packing, damaged, short};

use crate::fault::{Fault, bad};
use crate::platform::PositionalFile;
use crate::source::payload::Samples;
use crate::source::raw_with_header::sample_type;
use crate::volume::{Endian, ScalarType};

/// Most chunks of a volume.
const MAX_CHUNKS: u64 = 1 << 30;

/// Most entries of a folder that are inspected for a chunk.
const LOOKED_AT: usize = 1 << 10;

/// Longest index of a shard whose checksum is verified for each of its chunks.
const SHORT_INDEX: u64 = 16 << 10;

/// An array, with the layout of its chunks.
pub(super) struct Array {
    folder: PathBuf,
    /// Voxels along z, y and x.
    pub(super) size: [u64; 3],
    /// Size of a chunk along z, y and x; within shards, of their inner chunks.
    pub(super) chunk: [u64; 3],
    /// Sides of the array and of a chunk, along the axes before z.
    leading: Vec<[u64; 2]>,
    /// True for fewer than three axes.
    flat: bool,
    pub(super) samples: Samples,
    pub(super) endian: Endian,
    pub(super) packing: Packing,
    /// The delivered sample where there is no chunk.
    pub(super) fill: Vec<u8>,
    shard: Option<Shard>,
    keys: Keys,
}

/// Chunks within the chunks of an array (Zarr 3, `sharding_indexed`).
struct Shard {
    /// Chunks along each axis of the array.
    counts: Vec<u64>,
    at_end: bool,
    /// True if a checksum follows the index.
    checked: bool,
}

/// Names of chunks.
struct Keys {
    prefix: bool,
    separator: char,
}

/// Location of a chunk's bytes.
pub(super) struct ChunkLocation {
    pub(super) file: PositionalFile,
    pub(super) at: u64,
    pub(super) length: u64,
}

pub(super) fn missing(field: &'static str) -> Fault {
    bad!("does not state `{field}`, or not as Zarr does; is it damaged?")
}

pub(super) fn unread(what: impl AsRef<str>) -> Fault {
    bad!(
        "holds {}, which is not read; pass the array to `infobyte.build` in Python, which reads any chunks",
        what.as_ref().escape_debug()
    )
}

fn text<'a>(of: &'a Value, key: &str) -> Option<&'a str> {
    of.get(key).and_then(Value::as_str)
}

/// The word of `known` that a field has; the first where the field is missing or null.
///
/// # Errors
/// The field has another value.
fn word(value: Option<&Value>, field: &'static str, known: &[&'static str]) -> Read<&'static str> {
    let stated = value.filter(|value| !value.is_null());
    let found = known.iter().find(|word| stated.is_none_or(|value| value == *word));
    found.copied().ok_or_else(|| missing(field))
}

fn sides(list: Option<&Value>, field: &'static str) -> Read<Vec<u64>> {
    let list = list.and_then(Value::as_array).and_then(|list| list.iter().map(Value::as_u64).collect());
    list.filter(|sides: &Vec<u64>| !sides.contains(&0)).ok_or_else(|| missing(field))
}

/// True if the first chunk that is found lies in a folder, by its name a number.
fn are_nested(folder: &Path) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let first = |entry: std::fs::DirEntry| {
        let name = entry.file_name();
        let is_numbers = |c: &u8| c.is_ascii_digit() || *c == b'.';
        name.as_encoded_bytes().iter().all(is_numbers).then(|| entry.path().is_dir())
    };
    let mut found = entries.take(LOOKED_AT).filter_map(first);
    found.next().unwrap_or(false)
}

impl Array {
    /// Reads the metadata of the array in `folder`.
    pub(super) fn read(folder: &Path, what: &Value) -> Read<Self> {
        match what.get("zarr_format").and_then(Value::as_u64) {
            Some(2) => Self::version_2(folder, what),
            Some(3) => Self::version_3(folder, what),
            _ => Err(missing("zarr_format")),
        }
    }

    fn version_2(folder: &Path, what: &Value) -> Read<Self> {
        let dtype = text(what, "dtype").ok_or_else(|| unread("records, or another type of elements"))?;
        let (order, kind) = dtype.split_at_checked(1).ok_or_else(|| missing("dtype"))?;
        let endian = match order {
            ">" => Endian::Big,
            "<" | "|" => Endian::Little,
            _ => return Err(missing("dtype")),
        };
        let samples = match kind.split_at_checked(1) {
            Some(("b", "1")) => Some(Samples::Plain(ScalarType::U8)),
            Some((class @ ("u" | "i" | "f"), bytes)) => {
                let bits = bytes.parse::<u64>().ok().and_then(|bytes| bytes.checked_mul(8));
                bits.and_then(|bits| sample_type(class == "f", class == "i", bits))
            }
            _ => None,
        };
        let samples = samples.ok_or_else(|| unread(format!("elements of the type `{dtype}`")))?;
        if word(what.get("order"), "order", &["C", "F"])? == "F" {
            return Err(unread("chunks in Fortran order"));
        }
        match what.get("filters") {
            None | Some(Value::Null) => {}
            Some(Value::Array(filters)) if filters.is_empty() => {}
            Some(filters) => {
                let name = filters.get(0).and_then(|filter| text(filter, "id")).unwrap_or("?");
                return Err(unread(format!("the filter `{name}`")));
            }
        }
        let packing = match what.get("compressor").filter(|codec| !codec.is_null()) {
            None => Packing::default(),
            Some(codec) => {
                Packing::default().then(text(codec, "id").ok_or_else(|| missing("compressor"))?)?
            }
        };
        let separator = match word(what.get("dimension_separator"), "dimension_separator", &["", ".", "/"])? {
            "/" => '/',
            // Some writers nest chunks and do not say so.
            "" if are_nested(folder) => '/',
            _ => '.',
        };
        let keys = Keys { prefix: false, separator };
        let (shape, chunk) = (sides(what.get("shape"), "shape")?, sides(what.get("chunks"), "chunks")?);
        let fill = fill(samples, what.get("fill_value"))?;
        Self::new(folder, (&shape, &chunk, None), (samples, endian), packing, fill, keys)
    }

    fn version_3(folder: &Path, what: &Value) -> Read<Self> {
        let kind = text(what, "data_type").ok_or_else(|| unread("another type of elements"))?;
        let digits = kind.find(|c: char| c.is_ascii_digit()).unwrap_or(kind.len());
        let (class, bits) = kind.split_at(digits);
        let samples = match (class, bits.parse()) {
            ("bool", _) => Some(Samples::Plain(ScalarType::U8)),
            ("uint" | "int" | "float", Ok(bits)) => sample_type(class == "float", class == "int", bits),
            _ => None,
        };
        let samples = samples.ok_or_else(|| unread(format!("elements of the type `{kind}`")))?;
        let grid = what.get("chunk_grid").ok_or_else(|| missing("chunk_grid"))?;
        if text(grid, "name") != Some("regular") {
            return Err(unread("chunks of several sizes"));
        }
        let configured =
            |of: &Value, key: &str| of.get("configuration").and_then(|all| all.get(key)).cloned();
        let shape = sides(what.get("shape"), "shape")?;
        let outer = sides(configured(grid, "chunk_shape").as_ref(), "chunk_shape")?;
        let encoding = what.get("chunk_key_encoding").ok_or_else(|| missing("chunk_key_encoding"))?;
        let (prefix, usual) = match text(encoding, "name") {
            Some("default") => (true, "/"),
            Some("v2") => (false, ""),
            _ => return Err(missing("chunk_key_encoding")),
        };
        let separator = configured(encoding, "separator");
        let separator = match word(separator.as_ref(), "chunk_key_encoding", &[usual, ".", "/"])? {
            "/" => '/',
            "" if are_nested(folder) => '/',
            _ => '.',
        };
        let keys = Keys { prefix, separator };
        let fill = fill(samples, what.get("fill_value"))?;
        let codecs = what.get("codecs").and_then(Value::as_array).ok_or_else(|| missing("codecs"))?;
        let sharding = codecs.first().filter(|codec| text(codec, "name") == Some("sharding_indexed"));
        let Some(sharding) = sharding else {
            let (endian, packing) = chain(codecs, shape.len())?;
            let layout = (shape.as_slice(), outer.as_slice(), None);
            return Self::new(folder, layout, (samples, endian), packing, fill, keys);
        };
        if codecs.len() > 1 {
            return Err(unread("shards that are packed as a whole"));
        }
        let inner = sides(configured(sharding, "chunk_shape").as_ref(), "chunk_shape")?;
        let is_whole = inner.len() == outer.len() && outer.iter().zip(&inner).all(|(a, b)| a % b == 0);
        if !is_whole {
            return Err(missing("chunk_shape"));
        }
        let codecs = configured(sharding, "codecs");
        let codecs = codecs.as_ref().and_then(Value::as_array).ok_or_else(|| missing("codecs"))?;
        let (endian, packing) = chain(codecs, shape.len())?;
        let index = configured(sharding, "index_codecs");
        let index = index.as_ref().and_then(Value::as_array).ok_or_else(|| missing("index_codecs"))?;
        let (order, of_index) = chain(index, shape.len())?;
        if order != Endian::Little || of_index.is_packed() {
            return Err(unread("shards whose index is packed"));
        }
        let location = configured(sharding, "index_location");
        let counts: Vec<u64> = outer.iter().zip(&inner).map(|(outer, inner)| outer / inner).collect();
        if counts.iter().fold(1_u64, |all, count| all.saturating_mul(*count)) > MAX_CHUNKS {
            return Err(unread("shards of thousands of millions of chunks"));
        }
        let shard = Shard {
            counts,
            at_end: word(location.as_ref(), "index_location", &["end", "start"])? == "end",
            checked: of_index.is_checked(),
        };
        Self::new(folder, (&shape, &inner, Some(shard)), (samples, endian), packing, fill, keys)
    }

    fn new(
        folder: &Path,
        (shape, chunk, shard): (&[u64], &[u64], Option<Shard>),
        (samples, endian): (Samples, Endian),
        packing: Packing,
        fill: Vec<u8>,
        keys: Keys,
    ) -> Read<Self> {
        if shape.len() < 2 {
            return Err(unread("an array of fewer than two dimensions"));
        }
        if chunk.len() != shape.len() || chunk.iter().any(|side| *side > u64::from(u32::MAX)) {
            return Err(missing("chunks"));
        }
        let bytes = chunk.iter().try_fold(samples.bytes() as u64, |all, side| all.checked_mul(*side));
        if bytes.is_none_or(|bytes| bytes > 1 << 40) {
            return Err(unread("chunks of more than a terabyte"));
        }
        let flat = shape.len() == 2;
        let first = shape.len().saturating_sub(3);
        let last =
            |of: &[u64]| if flat { [1, of[0], of[1]] } else { [of[first], of[first + 1], of[first + 2]] };
        let leading = shape.iter().zip(chunk).take(first).map(|(side, chunk)| [*side, *chunk]).collect();
        let chunks = shape.iter().zip(chunk).rev().take(3);
        if chunks.fold(1_u64, |all, (side, chunk)| all.saturating_mul(side.div_ceil(*chunk))) > MAX_CHUNKS {
            return Err(unread("thousands of millions of chunks"));
        }
        let (size, chunk, folder) = (last(shape), last(chunk), folder.to_path_buf());
        Ok(Self { folder, size, chunk, leading, flat, samples, endian, packing, fill, shard, keys })
    }

    /// True if chunks lie in shards.
    pub(super) fn is_sharded(&self) -> bool {
        self.shard.is_some()
    }

    /// Axes of the array.
    pub(super) fn axes(&self) -> usize {
        self.leading.len() + if self.flat { 2 } else { 3 }
    }

    /// Sides of the axes before z.
    pub(super) fn leading_sides(&self) -> impl Iterator<Item = u64> {
        self.leading.iter().map(|[side, _]| *side)
    }

    /// Volumes: combinations of the axes before z.
    pub(super) fn leading_count(&self) -> u64 {
        self.leading_sides().fold(1_u64, u64::saturating_mul)
    }

    /// Bytes of a chunk of one volume, as it is stored.
    pub(super) fn volume_bytes(&self) -> u64 {
        self.chunk.iter().product::<u64>() * self.samples.bytes() as u64
    }

    /// Bytes of a whole chunk, and the offset in it of the volume of this number.
    pub(super) fn within(&self, volume: u64) -> (u64, u64) {
        let (mut offset, mut step) = (0, self.volume_bytes());
        for (index, [_, chunk]) in self.index(volume).into_iter().zip(&self.leading).rev() {
            offset += index % chunk * step;
            step *= chunk;
        }
        (step, offset)
    }

    /// Places on the axes before z of the volume of this number.
    fn index(&self, volume: u64) -> Vec<u64> {
        let mut rest = volume;
        let mut places = vec![0; self.leading.len()];
        for (place, [side, _]) in places.iter_mut().zip(&self.leading).rev() {
            (*place, rest) = (rest % side, rest / side);
        }
        places
    }

    /// Chunks along z, y and x.
    pub(super) fn chunks(&self) -> [u64; 3] {
        std::array::from_fn(|axis| self.size[axis].div_ceil(self.chunk[axis]))
    }

    /// Files of one volume.
    pub(super) fn file_count(&self) -> u64 {
        let counts = self.spatial_shard();
        (0..3).map(|axis| self.chunks()[axis].div_ceil(counts[axis])).product()
    }

    /// Chunks of a file along z, y and x.
    fn spatial_shard(&self) -> [u64; 3] {
        let Some(shard) = &self.shard else { return [1; 3] };
        let mut counts = [1; 3];
        counts.iter_mut().rev().zip(shard.counts.iter().rev()).for_each(|(to, from)| *to = *from);
        counts
    }

    /// Every place of a file, as the first of its chunks.
    pub(super) fn each_file(&self, each: &mut dyn FnMut([u64; 3])) {
        let (counts, chunks) = (self.spatial_shard(), self.chunks());
        let steps =
            |axis: usize| (0..chunks[axis]).step_by(usize::try_from(counts[axis]).unwrap_or(usize::MAX));
        for z in steps(0) {
            for y in steps(1) {
                steps(2).for_each(|x| each([z, y, x]));
            }
        }
    }

    /// The name of the first chunk if none of these volumes has any chunk, as far as a few thousand of them tell.
    pub(super) fn lost(&self, volumes: Range<u64>) -> Option<String> {
        const LOOKED_FOR: u64 = 4096;
        let [nz, ny, nx] = self.chunks();
        let each = nz.saturating_mul(ny).saturating_mul(nx);
        let all = each.saturating_mul(volumes.end - volumes.start);
        let step = usize::try_from(all.div_ceil(LOOKED_FOR)).unwrap_or(usize::MAX).max(1);
        let path = |at: u64| {
            let (volume, at) = (volumes.start + at / each, at % each);
            self.path(volume, [at / (ny * nx), at / nx % ny, at % nx])
        };
        let is_there = (0..all).step_by(step).any(|at| path(at).symlink_metadata().is_ok());
        let first = path(0);
        let name = first.strip_prefix(&self.folder).unwrap_or(&first);
        (!is_there).then(|| name.to_string_lossy().into_owned())
    }

    /// Places of a chunk on all axes of the array.
    fn full(&self, volume: u64, chunk: [u64; 3]) -> Vec<u64> {
        let mut all: Vec<u64> = self
            .index(volume)
            .into_iter()
            .zip(&self.leading)
            .map(|(index, [_, chunk])| index / chunk)
            .collect();
        all.extend_from_slice(&chunk[usize::from(self.flat)..]);
        all
    }

    /// The file that a chunk lies in.
    pub(super) fn path(&self, volume: u64, chunk: [u64; 3]) -> PathBuf {
        let mut places = self.full(volume, chunk);
        if let Some(shard) = &self.shard {
            places.iter_mut().zip(&shard.counts).for_each(|(place, count)| *place /= count);
        }
        let names: Vec<String> = places.iter().map(u64::to_string).collect();
        let name = names.join(&self.keys.separator.to_string());
        self.folder.join(match (self.keys.prefix, self.keys.separator) {
            (false, _) => name,
            (true, separator) => format!("c{separator}{name}"),
        })
    }

    /// Location of a chunk; `None` if it was never written.
    pub(super) fn place(&self, volume: u64, chunk: [u64; 3]) -> std::io::Result<Option<ChunkLocation>> {
        let file = match crate::platform::PositionalFile::open(&self.path(volume, chunk)) {
            Ok(file) => file,
            Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(cause) => return Err(cause),
        };
        let length = file.metadata()?.len();
        let Some(shard) = &self.shard else { return Ok(Some(ChunkLocation { file, at: 0, length })) };
        let entries: u64 = shard.counts.iter().product();
        let index = entries * 16;
        let whole = index + if shard.checked { 4 } else { 0 };
        let from = match length.checked_sub(whole) {
            Some(end) if shard.at_end => end,
            Some(_) => 0,
            None => return Err(short()),
        };
        if shard.checked && index <= SHORT_INDEX {
            let mut all = vec![0; usize::try_from(whole).unwrap_or(0)];
            file.read_exact_at(&mut all, from)?;
            let (entries, sum) = all.split_at(all.len() - 4);
            if crc32c::crc32c(entries).to_le_bytes() != sum {
                return Err(damaged("the index of its shard"));
            }
        }
        let places = self.full(volume, chunk);
        let number = places.iter().zip(&shard.counts).fold(0, |all, (at, count)| all * count + at % count);
        let mut entry = [0; 16];
        file.read_exact_at(&mut entry, from + number * 16)?;
        let (at, length_of) = entry.split_at(8);
        let number = |bytes: &[u8]| bytes.try_into().map_or(0, u64::from_le_bytes);
        match (number(at), number(length_of)) {
            (u64::MAX, u64::MAX) => Ok(None),
            (at, bytes) if at.checked_add(bytes).is_some_and(|end| end <= length) => {
                Ok(Some(ChunkLocation { file, at, length: bytes }))
            }
            _ => Err(damaged("the index of its shard")),
        }
    }
}

/// Byte order and packing of a chain of Zarr 3 codecs.
fn chain(codecs: &[Value], axes: usize) -> Read<(Endian, Packing)> {
    let mut endian = None;
    let mut packing = Packing::default();
    for codec in codecs {
        let name = text(codec, "name").ok_or_else(|| missing("codecs"))?;
        let settings = codec.get("configuration");
        match (name, endian) {
            ("transpose", None) => {
                let order = settings.and_then(|all| all.get("order")).and_then(Value::as_array);
                let is_same = |order: &Vec<Value>| {
                    order.len() == axes && order.iter().enumerate().all(|(at, axis)| *axis == at)
                };
                if !order.is_some_and(is_same) {
                    return Err(unread("chunks with their axes in another order"));
                }
            }
            ("bytes" | "endian", None) => {
                let order = settings.and_then(|all| all.get("endian"));
                let is_big = word(order, "endian", &["little", "big"])? == "big";
                endian = Some(if is_big { Endian::Big } else { Endian::Little });
            }
            (_, None) => return Err(unread(format!("the codec `{name}`"))),
            (packed, Some(_)) => packing = packing.then(packed)?,
        }
    }
    Ok((endian.ok_or_else(|| missing("codecs"))?, packing))
}

/// The bytes of a sample as it is delivered, from `fill_value`.
fn fill(samples: Samples, value: Option<&Value>) -> Read<Vec<u8>> {
    let number = match value {
        None | Some(Value::Null) => Some(0.0),
        Some(Value::Bool(value)) => Some(f64::from(u8::from(*value))),
        Some(Value::String(name)) => match name.as_str() {
            "NaN" => Some(f64::NAN),
            "Infinity" => Some(f64::INFINITY),
            "-Infinity" => Some(f64::NEG_INFINITY),
            _ => None,
        },
        Some(value) => value.as_f64(),
    };
    let number = number.ok_or_else(|| missing("fill_value"))?;
    let limits = match samples.delivered() {
        ScalarType::U8 => [0.0, f64::from(u8::MAX)],
        ScalarType::I8 => [f64::from(i8::MIN), f64::from(i8::MAX)],
        ScalarType::U16 => [0.0, f64::from(u16::MAX)],
        ScalarType::I16 => [f64::from(i16::MIN), f64::from(i16::MAX)],
        ScalarType::U32 => [0.0, f64::from(u32::MAX)],
        ScalarType::I32 => [f64::from(i32::MIN), f64::from(i32::MAX)],
        ScalarType::F32 | ScalarType::F64 => [f64::NEG_INFINITY, f64::INFINITY],
    };
    if number < limits[0] || number > limits[1] || number.is_nan() && limits[1].is_finite() {
        return Err(missing("fill_value"));
    }
    #[expect(clippy::cast_possible_truncation, reason = "within the limits")]
    Ok(match samples.delivered() {
        ScalarType::U8 => vec![number as u8],
        ScalarType::I8 => vec![(number as i8).cast_unsigned()],
        ScalarType::U16 => bytemuck::bytes_of(&(number as u16)).to_vec(),
        ScalarType::I16 => bytemuck::bytes_of(&(number as i16)).to_vec(),
        ScalarType::U32 => bytemuck::bytes_of(&(number as u32)).to_vec(),
        ScalarType::I32 => bytemuck::bytes_of(&(number as i32)).to_vec(),
        ScalarType::F32 => bytemuck::bytes_of(&(number as f32)).to_vec(),
        ScalarType::F64 => bytemuck::bytes_of(&number).to_vec(),
    })
}
