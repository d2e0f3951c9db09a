//! VGStudio volumes: `.vgi` with fields in sections, the samples in `.vol` files that it names.
//!
//! The first volume is read. `resolution` and `unit` give the spacing; where the volume lies in VGStudio's scene is not
//! read.

use std::path::{Path, PathBuf};

use super::{Headed, Read, missing, refused, sample_type, scale, unread, upright};
use crate::platform::PositionalFile;
use crate::source::OpenOptions;
use crate::source::files::FileList;
use crate::source::header::{
    Lines, Once, check_links, exactly, files_beside, listed, number, text, unreadable,
};
use crate::source::payload::Encoding;
use crate::volume::{Endian, Note, Result, VolumeSource};

pub(in crate::source) fn recognise(head: &[u8], _: &Path) -> bool {
    head.starts_with(b"{volume")
}

/// The header of a file of samples, of the same name.
pub(in crate::source) fn header_of(samples: &Path) -> Option<PathBuf> {
    let is_vol = samples.extension().is_some_and(|e| e.eq_ignore_ascii_case("vol"));
    let header = ["vgi", "VGI"].map(|e| samples.with_extension(e));
    header.into_iter().find(|path| is_vol && path.is_file())
}

pub(in crate::source) fn open(path: &Path, options: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = PositionalFile::open(path).map_err(|cause| unreadable(path, cause))?;
    let mut lines = Lines::new(&file);
    let mut fields = Fields { files: files_beside(path), ..Fields::default() };
    let mut once = Once::new(&["size", "datatype", "bitsperelement", "resolution", "unit"]);
    while let Some(line) = lines.next().map_err(|cause| unreadable(path, cause))? {
        fields.line(&text(&line), &mut once).map_err(refused(path))?;
    }
    if fields.files.len() == 0 {
        return Err(refused(path)(missing("the name of its .vol")));
    }
    check_links(path, &fields.files, options.follow_links)?;
    let files = std::mem::take(&mut fields.files);
    fields.headed().map_err(refused(path))?.open(path, Some(files))
}

#[derive(Default)]
struct Fields {
    section: String,
    /// Volumes begun.
    volumes: usize,
    size: Option<[u64; 3]>,
    kind: String,
    bits: u64,
    skip: u64,
    resolution: Option<[f64; 3]>,
    unit: Option<String>,
    files: FileList,
}

impl Fields {
    fn line(&mut self, line: &str, once: &mut Once) -> Read<()> {
        if let Some(object) = line.strip_prefix('{') {
            self.volumes += usize::from(
                object.trim_end_matches('}').strip_prefix("volume").is_some_and(|n| n.parse::<u32>().is_ok()),
            );
        }
        if line.starts_with(['{', '[']) {
            self.section = line.trim_matches(['[', ']']).to_lowercase();
            return Ok(());
        }
        let Some((key, value)) = line.split_once('=') else { return Ok(()) };
        let (key, value) = (key.trim().to_lowercase(), value.trim());
        let of_file = self.section.starts_with("file");
        let is_read = of_file || ["representation", "geometry"].contains(&self.section.as_str());
        if is_read && self.volumes > 1 {
            return Ok(());
        }
        if is_read && !of_file {
            once.check(&key)?;
        }
        match (self.section.as_str(), key.as_str()) {
            ("representation", "size") => self.size = Some(exactly("size", value)?),
            ("representation", "datatype") => self.kind = value.to_lowercase(),
            ("representation", "bitsperelement") => self.bits = number("bitsperelement", value)?,
            ("geometry", "resolution") => self.resolution = Some(exactly("resolution", value)?),
            ("geometry", "unit") => self.unit = Some(value.to_owned()),
            (_, "name") if of_file => listed(&mut self.files, value)?,
            (_, "skipheader") if of_file => self.skip = number("SkipHeader", value)?,
            (_, "fileformat") if of_file && !value.eq_ignore_ascii_case("raw") => {
                return Err(unread(format!("files of the format `{value}`"), "export it as raw"));
            }
            _ => {}
        }
        Ok(())
    }

    fn headed(self) -> Read<Headed> {
        let size = self.size.ok_or_else(|| missing("size"))?;
        let is_float = self.kind.contains("float");
        let signed =
            self.kind.contains("signed") && !self.kind.contains("unsigned") || self.kind == "integer";
        let samples = sample_type(is_float, signed, self.bits);
        let samples = samples.filter(|_| is_float || self.kind.contains("int"));
        let samples = samples.ok_or_else(|| missing("datatype and bitsperelement"))?;
        let mut notes = vec![Note::new("the header states no origin; the first voxel is used as the origin")];
        let spacing = self.resolution.ok_or_else(|| missing("resolution"))?;
        let affine = upright(spacing, [0.0; 3], scale(self.unit.as_deref(), &mut notes));
        let (endian, at) = (Endian::Little, self.skip);
        Ok(Headed {
            format: "vgi",
            size,
            volumes: 1,
            samples,
            endian,
            at,
            encoding: Encoding::Raw,
            affine,
            notes,
        })
    }
}
