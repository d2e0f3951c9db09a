//! MetaImage volumes: `.mha` with the samples behind the header, `.mhd` with files next to it.
//!
//! Axes stay as they are stored, the first is x. Row i of `TransformMatrix` is the direction of index axis
//! i in LPS, as ITK reads and writes it; `CenterOfRotation` moves nothing there and is passed over here.

use std::path::Path;

use super::OpenOptions;
use super::files::FileList;
use super::header::{
    Lines, Once, check_links, files_beside, is_list, listed, not_a_field, number, numbered, numbers, sweep,
    text, unit_mm, unreadable, unusable, wrong_count,
};
use super::payload::{Encoding, Samples, Skip, StoredLayout, regular};
use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::platform::PositionalFile;
use crate::volume::{Endian, Note, Rescale, Result, ScalarType, VolumeSource};

/// Keys that a header begins with, in lower case.
const FIRST_KEYS: [&str; 4] = ["objecttype", "ndims", "comment", "objectsubtype"];

/// Fields that may be stated once.
const ONCE: [&str; 15] = [
    "ndims",
    "dimsize",
    "elementtype",
    "elementspacing",
    "elementnumberofchannels",
    "headersize",
    "offset",
    "transformmatrix",
    "compresseddata",
    "binarydata",
    "elementsize",
    "elementtointensityfunctionslope",
    "elementtointensityfunctionoffset",
    "distanceunits",
    "kinds",
];

/// True for a MetaImage header.
pub(super) fn recognise(head: &[u8], path: &Path) -> bool {
    let Some(line) = head.split(|b| *b == b'\n').next() else { return false };
    let line = text(line).to_lowercase();
    let Some((key, value)) = line.split_once('=') else { return false };
    let named =
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mha") || e.eq_ignore_ascii_case("mhd"));
    let (key, value) = (key.trim(), value.trim());
    (key == "objecttype" && value == "image") || (named && FIRST_KEYS.contains(&key))
}

/// Opens a header and finds its samples.
pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = PositionalFile::open(path).map_err(|cause| unreadable(path, cause))?;
    let header = Header::read(path, &file)?;
    header.stored(path, options.follow_links)?.open()
}

/// The fields of a header, as far as they matter.
#[derive(Debug, Default)]
struct Header {
    axes: usize,
    size: Vec<u64>,
    kind: String,
    big: Option<bool>,
    binary: bool,
    compressed: bool,
    channels: u64,
    header_size: i64,
    spacing: Vec<f64>,
    element_size: Vec<f64>,
    origin: Vec<f64>,
    matrix: Vec<f64>,
    unit: String,
    /// Slope and offset of the values, where they are stated.
    intensity: [Option<f64>; 2],
    /// Kinds of the axes, in lower case; empty if they are not stated.
    kinds: Vec<String>,
    /// True if frames have fields of their own.
    is_sequence: bool,
    /// True if frames have places of their own.
    placed_one_by_one: bool,
    data: String,
    /// Files of a `LIST`.
    list: FileList,
    /// Byte behind the last line.
    end: u64,
}

impl Header {
    fn read(path: &Path, file: &PositionalFile) -> Result<Self> {
        let mut lines = Lines::new(file);
        let next = |lines: &mut Lines<'_>| lines.next().map_err(|cause| unreadable(path, cause));
        let mut header = Self { binary: true, channels: 1, list: files_beside(path), ..Self::default() };
        let mut once = Once::new(&ONCE);
        while let Some(line) = next(&mut lines)? {
            let line = text(&line);
            if line.is_empty() {
                continue;
            }
            let Some((key, value)) = line.split_once('=') else {
                return Err(unusable(path, not_a_field(&line)));
            };
            let (key, value) = (key.trim().to_lowercase(), value.trim());
            if key == "elementdatafile" {
                header.data = value.to_owned();
                if is_list("ElementDataFile", value).map_err(|fault| unusable(path, fault))? {
                    while let Some(name) = next(&mut lines)? {
                        let name = text(&name);
                        if !name.is_empty() {
                            listed(&mut header.list, &name).map_err(|fault| unusable(path, fault))?;
                        }
                    }
                }
                header.end = lines.offset;
                return Ok(header);
            }
            once.check(&key).map_err(|fault| unusable(path, fault))?;
            header.field(&key, value).map_err(|fault| unusable(path, fault))?;
        }
        Err(unusable(path, bad!("its header ends without ElementDataFile, which names the samples")))
    }

    /// Takes one field.
    fn field(&mut self, key: &str, value: &str) -> Result<(), Fault> {
        let wrong = || bad!("its field `{} = {}` makes no sense", key.escape_debug(), value.escape_debug());
        let truth = || match value.to_lowercase().as_str() {
            "true" | "t" | "1" | "yes" => Ok(true),
            "false" | "f" | "0" | "no" => Ok(false),
            _ => Err(wrong()),
        };
        match key {
            "ndims" => self.axes = number(key, value)?,
            "dimsize" => self.size = numbers(key, value)?,
            "elementtype" => self.kind = value.to_uppercase(),
            "elementbyteordermsb" | "binarydatabyteordermsb" => {
                let big = truth()?;
                if self.big.replace(big).is_some_and(|before| before != big) {
                    return Err(twice("the byte order", "BinaryDataByteOrderMSB, ElementByteOrderMSB"));
                }
            }
            "binarydata" => self.binary = truth()?,
            "compresseddata" => self.compressed = truth()?,
            "elementnumberofchannels" => self.channels = number(key, value)?,
            "headersize" => {
                self.header_size = Some(number(key, value)?).filter(|n| *n >= -1).ok_or_else(wrong)?;
            }
            "elementspacing" => self.spacing = numbers(key, value)?,
            "elementsize" => self.element_size = numbers(key, value)?,
            "offset" | "position" | "origin" => {
                let before = std::mem::replace(&mut self.origin, numbers(key, value)?);
                if !(before.is_empty() || before == self.origin) {
                    return Err(twice("the place of the first voxel", "Offset, Position, Origin"));
                }
            }
            "transformmatrix" | "rotation" | "orientation" => {
                let before = std::mem::replace(&mut self.matrix, numbers(key, value)?);
                if !(before.is_empty() || before == self.matrix) {
                    return Err(twice("its directions", "TransformMatrix, Rotation, Orientation"));
                }
            }
            "elementtointensityfunctionslope" => self.intensity[0] = Some(number(key, value)?),
            "elementtointensityfunctionoffset" => self.intensity[1] = Some(number(key, value)?),
            "distanceunits" => self.unit = value.to_owned(),
            "kinds" => self.kinds = value.split_whitespace().map(str::to_lowercase).collect(),
            _ => {
                let of_frame = key.starts_with("seq_frame");
                self.is_sequence |= of_frame;
                self.placed_one_by_one |= of_frame && key.ends_with("transform");
            }
        }
        Ok(())
    }

    fn stored(mut self, path: &Path, follow: bool) -> Result<StoredLayout> {
        let refuse = |fault: Fault| unusable(path, fault);
        if !(2..=4).contains(&self.axes) || self.size.len() != self.axes {
            return Err(refuse(bad!(
                "its header states NDims = {} and {} sizes (DimSize); volumes of 2 to 4 dimensions are read",
                self.axes,
                self.size.len()
            )));
        }
        if self.channels != 1 {
            return Err(refuse(bad!(
                "has {} channels a voxel; extract one into a file of its own",
                self.channels
            )));
        }
        // A list of volumes is read as volumes; a list of pictures is not.
        let pictures = self.axes == 3 || self.size.get(2) == Some(&1);
        let sweeps = match self.kinds.get(2).map(String::as_str) {
            Some("list") => self.is_sequence,
            // A volume that was reconstructed of pictures keeps fields of its frames.
            Some(_) => false,
            None => self.placed_one_by_one,
        };
        if pictures && sweeps {
            return Err(unusable(path, sweep()));
        }
        let samples = samples(&self.kind)
            .ok_or_else(|| refuse(bad!("its ElementType `{}` is not read", self.kind.escape_debug())))?;
        let at = |i: usize| self.size.get(i).copied().unwrap_or(1);
        let (size, volumes) = ([at(0), at(1), at(2)], at(3));
        let mut notes = Vec::new();
        let affine = self.affine(&mut notes).map_err(refuse)?;
        let local = self.data.eq_ignore_ascii_case("local");
        let mut files = std::mem::take(&mut self.list);
        let mut skip = 0;
        let slices = size[2].saturating_mul(volumes);
        if local {
            let name = path.file_name().unwrap_or_default();
            files.push(Path::new(name));
            skip = self.end;
        } else if files.len() == 0 {
            self.name_files(&mut files, slices).map_err(|fault| unusable(path, fault))?;
        }
        check_links(path, &files, follow)?;
        let encoding = match (self.compressed, self.binary) {
            (true, true) => stream_kind(&files, skip)?,
            (true, false) => return Err(refuse(bad!("compressed text is not read"))),
            (false, true) => Encoding::Raw,
            (false, false) => Encoding::Text,
        };
        let skip = match u64::try_from(self.header_size) {
            Ok(bytes) => Skip::Bytes(skip.saturating_add(bytes)),
            Err(_) if encoding == Encoding::Raw => Skip::AllButSamples,
            Err(_) => return Err(refuse(bad!("HeaderSize = -1 is for uncompressed samples only"))),
        };
        Ok(StoredLayout {
            header: path.to_path_buf(),
            format: "metaimage",
            files,
            size,
            volumes,
            samples,
            endian: if self.big == Some(true) { Endian::Big } else { Endian::Little },
            encoding,
            skip,
            skip_unpacked: Skip::Bytes(0),
            rescale: Rescale::IDENTITY,
            affine,
            notes,
            labels: Vec::new(),
        })
    }

    /// Files of a single name, or of a pattern with its numbers.
    fn name_files(&self, files: &mut FileList, slices: u64) -> Result<(), Fault> {
        let parts: Vec<&str> = self.data.split_whitespace().collect();
        if let [pattern, range @ ..] = parts.as_slice()
            && pattern.contains('%')
            && (2..=3).contains(&range.len())
        {
            let range: Vec<i64> = numbers("ElementDataFile", &range.join(" "))?;
            if let [first, last, step @ ..] = range.as_slice() {
                return numbered(files, pattern, [*first, *last, step.first().copied().unwrap_or(1)], slices);
            }
        }
        listed(files, &self.data)
    }

    /// Voxel index to LPS mm.
    fn affine(&self, notes: &mut Vec<Note>) -> Result<Affine, Fault> {
        let axes = self.axes;
        for (field, list, due) in [
            ("ElementSpacing", &self.spacing, axes),
            ("ElementSize", &self.element_size, axes),
            ("Offset", &self.origin, axes),
            ("TransformMatrix", &self.matrix, axes * axes),
        ] {
            if !list.is_empty() && list.len() != due {
                let text: Vec<String> = list.iter().map(f64::to_string).collect();
                return Err(wrong_count(field, &text.join(" "), list.len(), due));
            }
        }
        let (field, spacing) = match self.spacing.as_slice() {
            [] => ("ElementSize", &self.element_size),
            _ => ("ElementSpacing", &self.spacing),
        };
        if let Some(step) = spacing.iter().take(3).find(|step| **step <= 0.0) {
            return Err(bad!(
                "its field {field} has {step}, which is not above 0; an axis that runs backwards is stated by TransformMatrix"
            ));
        }
        if spacing.is_empty() {
            notes.push(Note::no_spacing("the header"));
        }
        let (slope, offset) = (self.intensity[0].unwrap_or(1.0), self.intensity[1].unwrap_or(0.0));
        if (slope, offset) != (1.0, 0.0) {
            notes.push(Note::new(format!(
                "the header states that values are {slope} x the samples + {offset}; this is not applied, as in ITK"
            )));
        }
        let mut scale = 1.0;
        if !self.unit.is_empty() && !self.unit.contains('?') {
            match unit_mm(&self.unit) {
                Some(mm) => scale = mm,
                None => {
                    notes.push(Note::new(format!("the unit `{}` is taken for mm", self.unit.escape_debug())))
                }
            }
        }
        let number = |list: &[f64], at: usize, default: f64| list.get(at).copied().unwrap_or(default);
        let mut affine = Affine::from_spacing([1.0; 3]);
        for axis in 0..axes.min(3) {
            let step = number(spacing, axis, 1.0) * scale;
            let origin = number(&self.origin, axis, 0.0) * scale;
            for world in 0..axes.min(3) {
                let same = if world == axis { 1.0 } else { 0.0 };
                let direction = number(&self.matrix, axis * axes + world, same);
                if let Some(row) = affine.rows.get_mut(world) {
                    row[axis] = direction * step;
                }
            }
            if let Some(row) = affine.rows.get_mut(axis) {
                row[3] = origin;
            }
        }
        Ok(affine)
    }
}

/// The fault of a field with several names whose values differ.
fn twice(what: &str, names: &str) -> Fault {
    bad!("its header states {what} twice ({names}), and not alike; remove the wrong line")
}

/// Type of a sample by its name in the format; `MET_LONG` has 32 bits there.
fn samples(name: &str) -> Option<Samples> {
    Some(match name {
        "MET_CHAR" | "MET_ASCII_CHAR" => Samples::Plain(ScalarType::I8),
        "MET_UCHAR" => Samples::Plain(ScalarType::U8),
        "MET_SHORT" => Samples::Plain(ScalarType::I16),
        "MET_USHORT" => Samples::Plain(ScalarType::U16),
        "MET_INT" | "MET_LONG" => Samples::Plain(ScalarType::I32),
        "MET_UINT" | "MET_ULONG" => Samples::Plain(ScalarType::U32),
        "MET_LONG_LONG" => Samples::I64,
        "MET_ULONG_LONG" => Samples::U64,
        "MET_FLOAT" => Samples::Plain(ScalarType::F32),
        "MET_DOUBLE" => Samples::Plain(ScalarType::F64),
        _ => return None,
    })
}

/// Compressed samples are zlib, but gzip is written, too.
fn stream_kind(files: &FileList, skip: u64) -> Result<Encoding> {
    let path = files.path(0);
    regular(&path)?;
    let mut magic = [0; 2];
    let file = PositionalFile::open(&path).map_err(|cause| unreadable(&path, cause))?;
    let gzip = file.read_exact_at(&mut magic, skip).is_ok() && magic == [0x1f, 0x8b];
    Ok(if gzip { Encoding::Gzip } else { Encoding::Zlib })
}
