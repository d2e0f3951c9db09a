//! NRRD volumes (<https://teem.sourceforge.net/nrrd/format.html>), NRRD0001 to NRRD0005: attached `.nrrd`
//! and detached `.nhdr` headers.
//!
//! Axes stay as they are stored, the fastest is x. `space` and `space directions` become an affine to LPS millimetres;
//! without them `spacings` and `axis mins` do. A last axis that is not a direction in space (a list, time) makes
//! several volumes; one that runs faster than space (colours, vectors) is refused by name. Names and colours of
//! segments, as 3D Slicer writes them, become those of labels, and their layers become one map.

mod geometry;
mod layers;
mod segments;

use std::path::Path;

use super::OpenOptions;
use super::files::{FileList, base_name};
use super::header::{
    Lines, Once, check_links, files_beside, is_list, listed, not_a_field, number, numbered, numbers, sweep,
    text, unreadable, unusable,
};
use super::payload::{Encoding, Samples, Skip, StoredLayout, section};
use crate::fault::{Fault, bad};
use crate::geom::Dims;
use crate::platform::PositionalFile;
use crate::volume::{Endian, Note, Overlap, Rescale, Result, ScalarType, SourceError, VolumeSource};
use geometry::{Axis, Geometry};
use layers::{LayeredMap, Layers, Order};
use segments::Segments;

/// Most axes that the format allows.
const MAX_AXES: usize = 16;

/// Fields that state the type and location of the samples.
const ONCE: [&str; 20] = [
    "type",
    "encoding",
    "endian",
    "dimension",
    "sizes",
    "line skip",
    "byte skip",
    "space",
    "space directions",
    "space origin",
    "space units",
    "units",
    "spacings",
    "axis mins",
    "axis maxs",
    "kinds",
    "centers",
    "centerings",
    "space dimension",
    "data file",
];

/// True for an NRRD header.
pub(super) fn recognise(head: &[u8], _: &Path) -> bool {
    head.starts_with(b"NRRD00")
}

/// Opens a header and finds its samples.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = PositionalFile::open(path).map_err(|cause| unreadable(path, cause))?;
    let header = Header::read(path, &file)?;
    let (stored, layers) = header.stored(path, &file, options).map_err(|wrong| match wrong {
        HeaderError::Header(fault) => unusable(path, fault),
        HeaderError::Other(error) => error,
    })?;
    let Some(layers) = layers else { return stored.open() };
    let mut sides = stored.size.map(|n| u32::try_from(n).unwrap_or(0));
    sides[layers.order.axis()] /= u32::try_from(layers.count).unwrap_or(1).max(1);
    let map = |source: Box<dyn VolumeSource>| -> Box<dyn VolumeSource> {
        match Dims::new(sides[0], sides[1], sides[2]) {
            Some(dims) => Box::new(LayeredMap::new(source, dims, layers.clone())),
            None => source,
        }
    };
    Ok(stored.open()?.into_iter().map(map).collect())
}

/// Reason why a header is refused.
enum HeaderError {
    Header(Fault),
    Other(SourceError),
}

impl<F: Into<Fault>> From<F> for HeaderError {
    fn from(fault: F) -> Self {
        Self::Header(fault.into())
    }
}

/// Location of the samples.
#[derive(Debug)]
enum DataFiles {
    /// The samples follow the header, at this offset.
    Attached(u64),
    /// Listed in the header.
    Listed(FileList),
    /// A pattern of names, with the first, last and step of its numbers.
    Pattern(String, [i64; 3]),
}

/// The fields of a header, as far as they matter.
#[derive(Debug, Default)]
struct Header {
    kind: String,
    encoding: String,
    endian: String,
    dimension: usize,
    sizes: Vec<u64>,
    line_skip: u64,
    byte_skip: i64,
    geometry: Geometry,
    /// True if each frame has a transform.
    placed_one_by_one: bool,
    data: Option<DataFiles>,
    segments: Segments,
}

impl Header {
    fn read(path: &Path, file: &PositionalFile) -> Result<Self> {
        let mut lines = Lines::new(file);
        let next = |lines: &mut Lines<'_>| lines.next().map_err(|cause| unreadable(path, cause));
        let magic = next(&mut lines)?.unwrap_or_default();
        if !matches!(magic.as_slice(), [b'N', b'R', b'R', b'D', b'0', b'0', b'0', b'1'..=b'5']) {
            return Err(unusable(
                path,
                bad!("`{}` is not a version of NRRD that is read (1 to 5)", text(&magic).escape_debug()),
            ));
        }
        let mut header = Self::default();
        let mut wrong: Option<Fault> = None;
        let mut once = Once::new(&ONCE);
        while let Some(line) = next(&mut lines)? {
            if line.is_empty() {
                header.data.get_or_insert(DataFiles::Attached(lines.offset));
                break;
            }
            let line = text(&line);
            if line.starts_with('#') {
                continue;
            }
            let Some((field, value)) = line.split_once(':') else {
                wrong.get_or_insert_with(|| not_a_field(&line));
                continue;
            };
            let (field, value) = (field.trim().to_lowercase(), value.trim());
            if let Some(value) = value.strip_prefix('=') {
                if let Err(fault) = header.segments.pair(&field, value.trim()) {
                    wrong.get_or_insert(fault);
                }
                header.placed_one_by_one |= field.starts_with("seq_frame") && field.ends_with("transform");
                continue;
            }
            if let Err(fault) = once.check(&field) {
                wrong.get_or_insert(fault);
            } else if matches!(field.as_str(), "data file" | "datafile") {
                if value.starts_with("LIST")
                    && is_list(&field, value).map_err(|fault| unusable(path, fault))?
                {
                    let mut list = files_beside(path);
                    while let Some(name) = next(&mut lines)? {
                        let name = text(&name);
                        if !name.is_empty() {
                            listed(&mut list, &name).map_err(|fault| unusable(path, fault))?;
                        }
                    }
                    header.data = Some(DataFiles::Listed(list));
                    break;
                }
                header.data = Some(data_file(path, value).map_err(|fault| unusable(path, fault))?);
            } else if let Err(fault) = header.field(&field, value) {
                wrong.get_or_insert(fault);
            }
        }
        match wrong {
            Some(fault) => Err(unusable(path, fault)),
            None => Ok(header),
        }
    }

    /// Takes one field; fields about other things than voxels and space are passed over.
    fn field(&mut self, field: &str, value: &str) -> Result<(), Fault> {
        let bad = || bad!("its field `{field}: {}` makes no sense", value.escape_debug());
        match field {
            "type" => self.kind = value.to_lowercase(),
            "encoding" => self.encoding = value.to_lowercase(),
            "endian" => self.endian = value.to_lowercase(),
            "dimension" => {
                let axes = Some(number(field, value)?);
                self.dimension = axes.filter(|n| (1..=MAX_AXES).contains(n)).ok_or_else(bad)?;
            }
            "sizes" => self.sizes = numbers(field, value)?,
            "line skip" | "lineskip" => self.line_skip = number(field, value)?,
            "byte skip" | "byteskip" => {
                self.byte_skip = Some(number(field, value)?).filter(|n| *n >= -1).ok_or_else(bad)?;
            }
            _ => self.geometry.field(field, value)?,
        }
        Ok(())
    }

    fn samples(&self) -> Result<Samples, Fault> {
        let words: Vec<&str> = self.kind.split_whitespace().filter(|w| *w != "signed").collect();
        let kind = words.join(" ");
        let plain = |scalar| Ok(Samples::Plain(scalar));
        match kind.as_str() {
            // Names have lost their `signed` above.
            "char" | "int8" | "int8_t" => plain(ScalarType::I8),
            "uchar" | "unsigned char" | "uint8" | "uint8_t" => plain(ScalarType::U8),
            "short" | "short int" | "int16" | "int16_t" => plain(ScalarType::I16),
            "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
                plain(ScalarType::U16)
            }
            "int" | "int32" | "int32_t" => plain(ScalarType::I32),
            "uint" | "unsigned int" | "uint32" | "uint32_t" => plain(ScalarType::U32),
            "longlong" | "long long" | "long long int" | "int64" | "int64_t" => Ok(Samples::I64),
            "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
                Ok(Samples::U64)
            }
            "float" => plain(ScalarType::F32),
            "double" => plain(ScalarType::F64),
            "" => Err(bad!("its header states no sample type")),
            _ => Err(bad!("its sample type `{}` is not read", self.kind.escape_debug())),
        }
    }

    fn encoding(&self) -> Result<Encoding, HeaderError> {
        Ok(match self.encoding.as_str() {
            "raw" => Encoding::Raw,
            "gz" | "gzip" => Encoding::Gzip,
            // The size of its blocks is not known yet.
            "bz2" | "bzip2" => Encoding::Bzip2(9),
            "txt" | "text" | "ascii" => Encoding::Text,
            "hex" => Encoding::Hex,
            "" => return Err(bad!("its header states no encoding").into()),
            other => return Err(bad!("its encoding `{}` is not read", other.escape_debug()).into()),
        })
    }

    fn stored(
        mut self,
        path: &Path,
        file: &PositionalFile,
        options: &OpenOptions,
    ) -> Result<(StoredLayout, Option<Layers>), HeaderError> {
        let samples = self.samples()?;
        let encoding = self.encoding()?;
        if self.dimension == 0 || self.sizes.len() != self.dimension {
            let (sizes, dimensions) = (self.sizes.len(), self.dimension);
            return Err(bad!("its header states {sizes} sizes for {dimensions} dimensions").into());
        }
        let mut notes = Vec::new();
        let endian = match self.endian.as_str() {
            "big" => Endian::Big,
            "little" => Endian::Little,
            "" => {
                if samples.bytes() > 1 && encoding != Encoding::Text {
                    notes.push(Note::new("the header states no byte order; little-endian is assumed"));
                }
                Endian::Little
            }
            other => return Err(bad!("its byte order `{}` is unknown", other.escape_debug()).into()),
        };
        let axes = self.geometry.axes(&self.sizes)?;
        let order = if self.segments.is_stated() { layers_of(&axes) } else { None };
        let mut layout = Layout::of(&axes, order == Some(Order::Together))?;
        if self.segments.is_stated() && layout.size == [1; 3] {
            return Err(bad!("is an empty segmentation: 3D Slicer writes a single voxel where no segment has any; there is nothing to build").into());
        }
        // A list of volumes is read as volumes; a list of pictures is not a volume.
        let listed = axes.iter().any(|axis| axis.kind == "list" && axis.size > 1);
        if order.is_none()
            && layout.size[2] == 1
            && (listed || (self.placed_one_by_one && layout.volumes > 1))
        {
            return Err(sweep().into());
        }
        let affine = self.geometry.affine(&axes, &layout.space, &mut notes)?;
        let segments = std::mem::take(&mut self.segments);
        notes.extend(segments.note());
        let (labels, layers) = match order {
            None => (segments.labels()?, None),
            Some(order) => {
                let layers = layout.join(order, segments, options.masks.unwrap_or_default())?;
                (layers.labels.clone(), Some(layers))
            }
        };
        let slices = layout.size[2].saturating_mul(layout.volumes);
        let (files, start) = files_of(self.data, path, slices)?;
        check_links(path, &files, options.follow_links).map_err(HeaderError::Other)?;
        let mut skip = start;
        if self.line_skip > 0 {
            if files.len() != 1 {
                return Err(bad!("lines are to be skipped in several data files, which is not read").into());
            }
            let data_path = files.path(0);
            let opened;
            let data = if start > 0 {
                file
            } else {
                super::payload::regular(&data_path).map_err(HeaderError::Other)?;
                opened = PositionalFile::open(&data_path)
                    .map_err(|cause| HeaderError::Other(unreadable(&data_path, cause)))?;
                &opened
            };
            skip = skip_lines(data, start, self.line_skip)
                .map_err(|cause| HeaderError::Other(unreadable(&data_path, cause)))?
                .ok_or_else(|| bad!("there are fewer than the {} lines to skip", self.line_skip))?;
        }
        let encoding = match encoding {
            Encoding::Bzip2(_) => Encoding::bzip2(&files, skip),
            other => other,
        };
        let mut skip_unpacked = Skip::Bytes(0);
        let skip = match u64::try_from(self.byte_skip) {
            Ok(bytes) if matches!(encoding, Encoding::Gzip | Encoding::Bzip2(_)) => {
                skip_unpacked = Skip::Bytes(bytes);
                Skip::Bytes(skip)
            }
            Ok(bytes) => Skip::Bytes(skip.saturating_add(bytes)),
            Err(_) if encoding == Encoding::Raw => Skip::AllButSamples,
            Err(_) if matches!(encoding, Encoding::Gzip | Encoding::Bzip2(_)) => {
                skip_unpacked = Skip::AllButSamples;
                Skip::Bytes(skip)
            }
            Err(_) => return Err(bad!("a byte skip of -1 is for raw or packed samples, not for text").into()),
        };
        let stored = StoredLayout {
            header: path.to_path_buf(),
            format: "nrrd",
            files,
            size: layout.size,
            volumes: layout.volumes,
            samples,
            endian,
            encoding,
            skip,
            skip_unpacked,
            rescale: Rescale::IDENTITY,
            affine,
            notes,
            labels,
        };
        Ok((stored, layers))
    }
}

/// The files of `slices` slices, and where the samples of each begin.
fn files_of(data: Option<DataFiles>, path: &Path, slices: u64) -> Result<(FileList, u64), HeaderError> {
    let mut files = files_beside(path);
    match data {
        Some(DataFiles::Attached(offset)) => {
            files.push(Path::new(&path.file_name().unwrap_or_default()));
            Ok((files, offset))
        }
        Some(DataFiles::Listed(files)) => Ok((files, 0)),
        Some(DataFiles::Pattern(pattern, range)) => {
            numbered(&mut files, &pattern, range, slices)?;
            Ok((files, 0))
        }
        None => Err(bad!("{} ends within its header, before the blank line", base_name(path)).into()),
    }
}

/// A single file, or a pattern with its numbers.
fn data_file(path: &Path, value: &str) -> Result<DataFiles, Fault> {
    let parts: Vec<&str> = value.split_whitespace().collect();
    // A fifth word is the dimension of each file.
    if let [pattern, range @ ..] = parts.as_slice()
        && pattern.contains('%')
        && (3..=4).contains(&range.len())
    {
        let range: Vec<i64> = numbers("data file", &range.join(" "))?;
        if let [first, last, step, ..] = range.as_slice() {
            return Ok(DataFiles::Pattern((*pattern).into(), [*first, *last, *step]));
        }
    }
    let mut list = files_beside(path);
    listed(&mut list, value)?;
    Ok(DataFiles::Listed(list))
}

/// Offset behind `count` lines; `None` if there are fewer.
fn skip_lines(file: &PositionalFile, start: u64, count: u64) -> std::io::Result<Option<u64>> {
    use std::io::BufRead;
    let mut reader = section(file, start, u64::MAX);
    let (mut offset, mut left) = (start, count);
    while left > 0 {
        let input = reader.fill_buf()?;
        if input.is_empty() {
            return Ok(None);
        }
        let mut used = 0;
        for byte in input {
            used += 1;
            if *byte == b'\n' {
                left -= 1;
                if left == 0 {
                    break;
                }
            }
        }
        reader.consume(used);
        offset += used as u64;
    }
    Ok(Some(offset))
}

/// The axes of x, y and z, and the number of volumes that follow each other.
struct Layout {
    size: [u64; 3],
    volumes: u64,
    space: Vec<usize>,
}

/// Order of the layers of a segmentation, if it has several: along its first axis, or along its last.
fn layers_of(axes: &[Axis]) -> Option<Order> {
    let mut lists = axes.iter().enumerate().filter(|(_, axis)| !axis.spatial && axis.size > 1);
    match (lists.next(), lists.next()) {
        (Some((0, _)), None) => Some(Order::Together),
        (Some((at, _)), None) if at + 1 == axes.len() => Some(Order::Apart),
        _ => None,
    }
}

impl Layout {
    /// A first axis of `layers` makes several volumes, as a last one does.
    fn of(axes: &[Axis], layers: bool) -> Result<Self, Fault> {
        let mut space = Vec::new();
        let mut volumes = 1_u64;
        let mut list: Option<usize> = None;
        for (index, axis) in axes.iter().enumerate() {
            // An axis of one entry that is not a direction in space changes nothing, at any position.
            if axis.size == 1 && !axis.spatial {
                continue;
            }
            if axis.spatial && space.len() < 3 {
                if let Some(at) = list.filter(|at| *at > 0 || !layers) {
                    let kind = axes.get(at).map_or_else(String::new, |a| a.kind.clone());
                    return Err(bad!(
                        "axis {at} of its {} is {} and runs faster than space, so a voxel has several values; extract one component into a file of its own",
                        axes.len(),
                        quoted(&kind)
                    ));
                }
                space.push(index);
            } else {
                list = Some(index);
                volumes = volumes.saturating_mul(axis.size);
            }
        }
        let size_of = |i: usize| space.get(i).and_then(|at| axes.get(*at)).map_or(1, |a| a.size);
        if space.len() < 2 {
            return Err(bad!("it has {} axes in space, and a volume needs two or three", space.len()));
        }
        Ok(Self { size: [size_of(0), size_of(1), size_of(2)], volumes, space })
    }
}

impl Layout {
    /// Makes the layers, which are volumes so far, parts of one.
    fn join(&mut self, order: Order, segments: Segments, overlap: Overlap) -> Result<Layers, Fault> {
        let count = std::mem::replace(&mut self.volumes, 1);
        let side = &mut self.size[order.axis()];
        *side = side.saturating_mul(count);
        let (labels, segments) = segments.layered()?;
        Ok(Layers { count, order, labels, segments, overlap })
    }
}

fn quoted(kind: &str) -> String {
    if kind.is_empty() { "no direction in space".to_owned() } else { format!("`{kind}`") }
}

#[cfg(test)]
mod tests;
