//! Texts of an archive: the root, and those that its parts name.

use std::io::Read;
use std::sync::Arc;

use super::super::Limits;
use super::super::appearance::Image;
use super::super::stop::Stop;
use super::super::xml::{Event, Xml};
use super::super::zip::{Archive, Member, reading};
use super::Contents;
use super::marked::leave_out;
use super::model::Reader;
use crate::mesh::read::stop::bad_reference;
use crate::platform::PositionalFile;

/// Usual name of the text, and the file that may name another one (ECMA-376-2, 9.3).
const USUAL: &str = "3D/3dmodel.model";
const RELATIONS: &str = "_rels/.rels";
const KIND: &[u8] = b"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel";
const MAX_TEXTS: usize = 4096;

/// The archive, its root text, and the number of root texts that it lists.
pub(super) fn root(file: &PositionalFile, bytes: u64) -> Result<(Archive, Member, u64), Stop> {
    let archive = Archive::open(file, bytes)?;
    let mut target = USUAL.to_owned();
    let mut starts = 0;
    if let Some(relations) = archive.find(file, RELATIONS)? {
        let mut xml = Xml::new(relations.open(file)?);
        loop {
            match xml.next()? {
                Event::Done => break,
                Event::Start { .. } if xml.name() == b"Relationship" && xml.raw(b"Type") == Some(KIND) => {
                    // The first of several counts.
                    starts += 1;
                    if starts == 1 {
                        target = xml.text(xml.raw(b"Target"))?.unwrap_or(target);
                    }
                }
                _ => {}
            }
        }
    }
    let member = archive.find(file, &target)?;
    Ok((archive, member.ok_or_else(|| bad_reference("a part of the archive"))?, starts))
}

/// Reads all texts of an archive; also returns the memory that is held, and the number of inflated bytes.
pub(super) fn read(
    file: PositionalFile,
    bytes: u64,
    limits: &Limits<'_>,
) -> Result<(Contents, u64, u64), Stop> {
    let (archive, first, starts) = root(&file, bytes)?;
    let mut inflated = first.checked_bytes()?;
    let mut reader = Reader::new(limits);
    if starts > 1 {
        reader.lacks.push(format!("begins with {starts} texts; the first was built"));
    }
    reader.text(first.open(&file)?, 0)?;
    let mut done = 1;
    // Texts that parts name, including parts of these texts.
    while done < reader.texts.len() {
        if reader.texts.len() > MAX_TEXTS {
            return Err(bad_reference("a part of the archive").into());
        }
        let name = reader.texts[done].clone();
        let member = archive.find(&file, &name)?.ok_or_else(|| bad_reference("a part of the archive"))?;
        inflated = inflated.saturating_add(member.checked_bytes()?);
        let number = u32::try_from(done).unwrap_or(u32::MAX);
        reader.text(member.open(&file)?, number)?;
        done += 1;
    }
    leave_out(&file, &archive, &mut reader)?;
    let mut images = Vec::new();
    for path in reader.images() {
        let member = archive.find(&file, path)?.ok_or_else(|| bad_reference("an image"))?;
        inflated = inflated.saturating_add(member.checked_bytes()?);
        images.push(Arc::new(unpacked(&file, &member, images.len(), limits)?));
    }
    let held_bytes = reader.held_bytes;
    Ok((reader.finish(images)?, held_bytes, inflated))
}

/// An image in a scratch file.
fn unpacked(
    file: &PositionalFile,
    member: &Member,
    number: usize,
    limits: &Limits<'_>,
) -> Result<Image, Stop> {
    let out = crate::scratch::unnamed(limits.scratch).map_err(Stop::Scratch)?;
    let mut content = member.open(file)?;
    let mut buffer = vec![0; 32 << 10];
    let mut bytes = 0;
    loop {
        let got = content.read(&mut buffer).map_err(reading)?;
        if got == 0 {
            break;
        }
        std::io::Write::write_all(&mut &out, &buffer[..got]).map_err(Stop::Scratch)?;
        bytes += got as u64;
    }
    Ok(Image { name: format!("image {}", number + 1), file: Arc::new(out.into()), offset: 0, bytes })
}
