//! A model with measured values: all sections of a finished one, with `VALU` and `QUAN` (SPEC 4.7, 4.13) in place of
//! the values that it had.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::atomic::AtomicFile;
use crate::format::{
    Channel, HEADER_BYTES, QUANTITY_MINOR, Quantity, SectionEntry, SectionKind, stored_value, table_bytes,
};
use crate::load::{Frame, Model};
use crate::platform::FileExt;

const VALUE: SectionKind = SectionKind::Voxels(Channel::Value);
/// Bytes of a writer's buffer, and of the parts in which sections are copied.
const BUFFER_BYTES: usize = 64 << 10;
/// Sections are copied so far before the model's pages are given back.
const PART_BYTES: usize = 1 << 20;

/// Writes a model with one value or none for each of its voxels or cells, in the order of the file; `extent` is the
/// greatest magnitude that a value may have, in the quantity's unit. Means of former values go; all other sections
/// keep their bytes. Returns the length of the file.
///
/// Memory: 64 KiB, and 1 MiB of mapped pages. The output appears whole or not at all.
///
/// # Errors
/// The output cannot be written, a value cannot be read, or there are fewer values than cells.
pub(crate) fn write_values(
    model: &Model,
    output: &Path,
    quantity: &Quantity,
    extent: f64,
    values: impl IntoIterator<Item = io::Result<Option<f64>>>,
) -> io::Result<u64> {
    let out = AtomicFile::create(output)?;
    let mut frame = lay_out(model.frame(), quantity, extent)?;
    let mut values = values.into_iter();
    let mut writer = Writer { out: BufWriter::with_capacity(BUFFER_BYTES, out.file()), at: 0, crc: 0 };
    for entry in &mut frame.sections {
        writer.begin(entry.offset)?;
        match entry.kind {
            Some(SectionKind::Meta) => writer.write(&frame.metadata_bytes)?,
            Some(SectionKind::Quantity) => writer.write(&quantity.to_bytes())?,
            Some(VALUE) => {
                for _ in 0..entry.items {
                    let value = values.next().unwrap_or_else(|| Err(io::ErrorKind::UnexpectedEof.into()))?;
                    writer.write(&stored_value(value, frame.metadata.value_scale).to_le_bytes())?;
                }
            }
            _ => {
                for part in stored(model, entry.tag).chunks(PART_BYTES) {
                    writer.write(part)?;
                    model.give_back();
                }
            }
        }
        (entry.stored_crc, entry.content_crc) = (writer.crc, writer.crc);
    }
    writer.out.flush()?;
    drop(writer);
    let table = table_bytes(&frame.sections);
    frame.header.table_crc = crc32c::crc32c(&table);
    out.file().write_all_at(&frame.header.to_bytes(), 0)?;
    out.file().write_all_at(&table, HEADER_BYTES as u64)?;
    out.commit()?;
    Ok(frame.header.file_bytes)
}

/// The bytes of a section, which may be of a later minor version.
fn stored(model: &Model, tag: [u8; 4]) -> &[u8] {
    let entry = model.sections().iter().find(|entry| entry.tag == tag);
    let range = entry.map_or(0..0, |e| e.offset..e.end());
    let [start, end] = [range.start, range.end].map(|at| usize::try_from(at).unwrap_or(usize::MAX));
    model.bytes().get(start..end).unwrap_or_default()
}

/// The frame of the model with values, without checksums.
fn lay_out(frame: &Frame, quantity: &Quantity, extent: f64) -> io::Result<Frame> {
    let mut own = frame.clone();
    own.metadata.value_scale = quantity.scale(extent);
    own.metadata_bytes = own.metadata.to_bytes().map_err(io::Error::other)?;
    let replaced = [Some(VALUE), Some(SectionKind::Means(Channel::Value)), Some(SectionKind::Quantity)];
    own.sections.retain(|entry| !replaced.contains(&entry.kind));
    let bytes = quantity.to_bytes().len() as u64;
    for (kind, item_bytes, items) in [(SectionKind::Quantity, 1, bytes), (VALUE, 2, own.header.voxels)] {
        let is_behind = |entry: &SectionEntry| entry.kind.is_some_and(|other| other > kind);
        let at = own.sections.iter().position(is_behind).unwrap_or(own.sections.len());
        own.sections.insert(at, SectionEntry::plain(kind, item_bytes, items, 0));
    }
    own.place_sections();
    own.header.minor = own.header.minor.max(QUANTITY_MINOR);
    own.header.sections = u16::try_from(own.sections.len()).map_err(io::Error::other)?;
    Ok(own)
}

/// Sections one after the other, behind the place of header and table, with zeros between them.
struct Writer<'a> {
    out: BufWriter<&'a File>,
    at: u64,
    /// CRC of the present section.
    crc: u32,
}

impl Writer<'_> {
    /// Starts a section at its place, which is at most 64 bytes and a table away.
    fn begin(&mut self, offset: u64) -> io::Result<()> {
        let padding = usize::try_from(offset - self.at).map_err(io::Error::other)?;
        self.write(&vec![0; padding])?;
        self.crc = 0;
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.at += bytes.len() as u64;
        self.crc = crc32c::crc32c_append(self.crc, bytes);
        self.out.write_all(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembled::{AssembledVoxel, OptionalSections, assemble, plain_metadata};
    use crate::format::{ColorMap, measured_value};
    use crate::load::verify;

    #[test]
    fn a_model_with_values_verifies_keeps_its_sections_and_can_be_measured_again() {
        let folder = tempfile::tempdir().unwrap();
        let [plain, valued, again] = ["a.oct", "b.oct", "c.oct"].map(|name| folder.path().join(name));
        let voxels: Vec<AssembledVoxel> =
            (0..50).map(|x| AssembledVoxel { cell: [x, x / 2, 3], normal: 0, value: 7 }).collect();
        let channels = OptionalSections { normal: true, value_bytes: 1, lod: true };
        std::fs::write(&plain, assemble(&plain_metadata([60, 40, 9], channels), &voxels, channels)).unwrap();
        let mut quantity = Quantity {
            name: "deviation".into(),
            unit: "mm".into(),
            sign: "+ outside nominal".into(),
            map: ColorMap::Diverging,
            range: [-1.0, 1.0],
            tolerance: None,
        };
        let value = |at: u32| (!at.is_multiple_of(7)).then(|| f64::from(at) / 25.0 - 1.0);
        let values = || (0..50).map(|at| Ok(value(at)));
        let model = Model::open(&plain).unwrap();
        let bytes = write_values(&model, &valued, &quantity, 2.0, values()).unwrap();
        assert_eq!(std::fs::metadata(&valued).unwrap().len(), bytes);
        let found = Model::open(&valued).unwrap();
        verify(found.bytes()).unwrap();
        assert_eq!(found.frame().quantity.as_ref(), Some(&quantity));
        assert!(found.means(Channel::Value).is_none());
        for kind in
            [SectionKind::Nodes, SectionKind::Voxels(Channel::Normal), SectionKind::Means(Channel::Normal)]
        {
            assert_eq!(found.section_bytes(kind), model.section_bytes(kind));
        }
        for at in 0..50 {
            let stored = found.value(crate::geom::VoxelIndex::new(at.into())).unwrap();
            let back = measured_value(stored, found.metadata().value_scale);
            assert_eq!(back.is_some(), value(at).is_some());
            assert!((back.unwrap_or(0.0) - value(at).unwrap_or(0.0)).abs() <= 1.0 / 32_767.0);
        }
        quantity.map = ColorMap::Sequential;
        write_values(&found, &again, &quantity, 2.0, values()).unwrap();
        let twice = Model::open(&again).unwrap();
        verify(twice.bytes()).unwrap();
        assert_eq!(twice.sections().len(), found.sections().len());
        let short = (0..49).map(|at| Ok(value(at)));
        assert!(write_values(&found, &folder.path().join("d.oct"), &quantity, 2.0, short).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3, "nothing half-written");
    }
}
