//! Side files of slicers, which mark parts of objects that are not printed: blockers and enforcers of supports,
//! modifiers of settings, and volumes to be cut away.

use std::io::Read;

use super::super::stop::Stop;
use super::super::xml::{Event, Xml};
use super::super::zip::Archive;
use super::model::Reader;
use super::{IDENTITY, Instance, Object};
use crate::platform::PositionalFile;

/// Names of PrusaSlicer and its relatives, and of Bambu Studio and OrcaSlicer.
const FILES: [&str; 4] = [
    "Metadata/Slic3r_PE_model.config",
    "Metadata/Prusa_Slicer_model.config",
    "Metadata/SuperSlicer_model.config",
    "Metadata/model_settings.config",
];
/// The text of the objects that numbers of runs stand for: no text has this number.
const RUNS: u32 = u32::MAX;

/// Leaves out the parts that side files mark.
pub(super) fn leave_out(
    file: &PositionalFile,
    archive: &Archive,
    reader: &mut Reader<'_>,
) -> Result<(), Stop> {
    for name in FILES {
        let Some(member) = archive.find(file, name)? else { continue };
        let read = member.open(file).and_then(|content| marked(content, reader));
        match read {
            Err(Stop::Mesh(_)) => reader.lack(format!(
                "has a damaged {name}; what it marks as support, modifier or blocker is part of the model"
            )),
            other => other?,
        }
    }
    Ok(())
}

fn marked(input: impl Read, reader: &mut Reader<'_>) -> Result<(), Stop> {
    let mut xml = Xml::new(input);
    let (mut object, mut run) = (None, None);
    let mut runs: Vec<(u32, [u32; 2])> = Vec::new();
    loop {
        match xml.next()? {
            Event::Done => break,
            Event::End => continue,
            Event::Start { .. } => {}
        }
        match (xml.name(), object) {
            (b"object", _) => (object, run) = (xml.whole(b"id")?, None),
            // Triangles of the object's mesh, the last one included.
            (b"volume", Some(_)) => run = xml.whole(b"firstid")?.zip(xml.whole(b"lastid")?),
            // A component of the object.
            (b"part", Some(object)) if !matches!(xml.raw(b"subtype"), None | Some(b"normal_part")) => {
                if let Some(part) = xml.whole(b"id")? {
                    reader.leave_component_out(object, part);
                }
            }
            (b"metadata", Some(object)) => {
                let other = match xml.raw(b"key") {
                    Some(b"volume_type") => xml.raw(b"value") != Some(b"ModelPart"),
                    Some(b"modifier") => xml.raw(b"value") == Some(b"1"),
                    _ => false,
                };
                if let Some((first, last)) = run.filter(|_| other) {
                    run = None;
                    reader.hold(size_of::<(u32, [u32; 2])>() as u64)?;
                    runs.push((object, [first, last]));
                }
            }
            _ => {}
        }
    }
    runs.sort_unstable();
    for of_one in runs.chunk_by(|a, b| a.0 == b.0) {
        reader.leave_runs_out(of_one[0].0, of_one.iter().map(|(_, run)| *run))?;
    }
    Ok(())
}

impl Reader<'_> {
    fn leave_component_out(&mut self, object: u32, part: u32) {
        let mut left_out = 0;
        if let Some(Object::Parts(parts)) = self.objects.get_mut(&(0, object)) {
            let before = parts.len();
            parts.retain(|instance| instance.key.1 != part);
            left_out = before - parts.len();
        }
        self.left_out += left_out as u64;
    }

    /// Leaves out runs of triangles of a mesh, in their order: the rest becomes objects of their own.
    fn leave_runs_out(&mut self, object: u32, runs: impl Iterator<Item = [u32; 2]>) -> Result<(), Stop> {
        let Some(Object::Mesh([first, vertices, from, count])) = self.objects.get(&(0, object)).cloned()
        else {
            return Ok(());
        };
        let (mut parts, mut next) = (Vec::new(), 0);
        let end = [u32::try_from(count).unwrap_or(u32::MAX), 0];
        for [begin, last] in runs.inspect(|_| self.left_out += 1).chain([end]).collect::<Vec<_>>() {
            if u64::from(begin) > next {
                let key = (RUNS, u32::try_from(self.objects.len()).unwrap_or(u32::MAX));
                let stays = [first, vertices, from + next, u64::from(begin).min(count) - next];
                self.add_object(key, Object::Mesh(stays))?;
                parts.push(Instance { key, at: IDENTITY });
            }
            next = next.max(u64::from(last) + 1).min(count);
        }
        self.objects.insert((0, object), Object::Parts(parts));
        Ok(())
    }
}
