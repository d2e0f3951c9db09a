//! MTL: the materials of OBJ. A colour (`Kd`, sRGB) times a texture (`map_Kd`).
//!
//! Missing files are left out and reported, as in every viewer: they are often not passed on.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::appearance::{Image, Material, Texture, UNPLACED, Wrap};
use super::super::linked::open_linked;
use super::super::stop::{Stop, bad_text_because, not_a_number};
use super::super::stream::{Token, Words};
use super::super::vertex_looks::light;
use super::super::{Limits, Summary};
use super::NONE;
use crate::fault::FaultKind;
use crate::platform::PositionalFile;
use crate::text::shown;

/// Memory of a material without its name, about.
const EACH_BYTES: u64 = 256;

/// Most names of missing files that are kept.
const MAX_MISSING: usize = 16;
/// Most materials that wait for a library behind the faces.
const MAX_UNDEFINED: usize = 1024;

pub(super) struct Materials<'a> {
    path: &'a Path,
    limits: &'a Limits<'a>,
    numbers: BTreeMap<String, u32>,
    all: Vec<Material>,
    /// Numbers of materials that are used and that no library defines so far.
    undefined: BTreeSet<u32>,
    images: BTreeMap<String, Arc<Image>>,
    files: Vec<PathBuf>,
    /// Files that are not there.
    lacks: Vec<String>,
    held_bytes: u64,
}

impl<'a> Materials<'a> {
    pub(super) fn new(path: &'a Path, limits: &'a Limits<'a>) -> Self {
        let (numbers, images) = (BTreeMap::new(), BTreeMap::new());
        let (all, files, lacks) = (Vec::new(), Vec::new(), Vec::new());
        let undefined = BTreeSet::new();
        Self { path, limits, numbers, all, undefined, images, files, lacks, held_bytes: 0 }
    }

    fn hold(&mut self, name_bytes: usize) -> Result<(), Stop> {
        self.held_bytes += EACH_BYTES + name_bytes as u64;
        if self.held_bytes > self.limits.most_bytes {
            let (needed_bytes, allowed_bytes) = (self.held_bytes, self.limits.most_bytes);
            return Err(Stop::Memory { needed_bytes, allowed_bytes });
        }
        Ok(())
    }

    /// The number of a material, which a library may define later.
    pub(super) fn number(&mut self, name: &str) -> Result<u32, Stop> {
        if let Some(number) = self.numbers.get(name) {
            return Ok(*number);
        }
        if self.undefined.len() == MAX_UNDEFINED {
            self.lack(format!(
                "uses more than {MAX_UNDEFINED} materials before a library defines them; faces of the others have no colour: put mtllib before the faces"
            ))?;
            return Ok(NONE);
        }
        let number = self.add(name.to_owned())?;
        self.undefined.insert(number);
        Ok(number)
    }

    fn add(&mut self, name: String) -> Result<u32, Stop> {
        self.hold(name.len())?;
        let number = u32::try_from(self.all.len()).unwrap_or(NONE);
        self.numbers.insert(name, number);
        self.all.push(Material { color: [1.0; 3], texture: None });
        Ok(number)
    }

    fn lack(&mut self, lack: String) -> Result<(), Stop> {
        if !self.lacks.contains(&lack) && self.lacks.len() < MAX_MISSING {
            self.hold(lack.len())?;
            self.lacks.push(lack);
        }
        Ok(())
    }

    /// Summary of all materials, and the files of the mesh; and the numbers of materials that nothing defines, which
    /// are noted where a library was read.
    pub(super) fn summary(mut self) -> Result<(Summary, BTreeSet<u32>), Stop> {
        let undefined = std::mem::take(&mut self.undefined);
        if undefined.len() == self.all.len() {
            self.all.clear();
        }
        let is_read = !self.all.is_empty();
        let numbers = std::mem::take(&mut self.numbers);
        for (name, _) in numbers.iter().filter(|(_, number)| is_read && undefined.contains(number)) {
            let name = shown(name);
            self.lack(format!(
                "uses the material {name}, which its libraries do not define; those faces have no colour"
            ))?;
        }
        let Self { all: materials, files, lacks, held_bytes, .. } = self;
        Ok((Summary { materials, files, lacks, held_bytes, ..Summary::default() }, undefined))
    }

    /// A file that the mesh names; `None` if it is missing.
    fn open(&mut self, name: &str) -> Result<Option<(PositionalFile, u64)>, Stop> {
        let name = name.replace('\\', "/");
        match open_linked(self.path, &name, self.limits.follow_links) {
            Ok((file, path, bytes)) => {
                self.files.push(path);
                Ok(Some((file, bytes)))
            }
            Err(Stop::Mesh(fault)) if fault.kind == FaultKind::Absent => {
                self.lack(format!(
                    "takes colours from {}, which is not there; the model lacks them: put the file beside it and build again",
                    shown(&name)
                ))?;
                Ok(None)
            }
            Err(stop) => Err(stop),
        }
    }

    pub(super) fn read(&mut self, name: &str) -> Result<(), Stop> {
        // A list of no names.
        if name.is_empty() {
            return Ok(());
        }
        // The text is several names, if there is no file with spaces in its name.
        let mut names = name.split_whitespace();
        if names.clone().count() > 1
            && names.clone().all(|name| name.to_lowercase().ends_with(".mtl"))
            && open_linked(self.path, &name.replace('\\', "/"), self.limits.follow_links).is_err()
        {
            return names.try_for_each(|name| self.read(name));
        }
        let Some((file, _)) = self.open(name)? else { return Ok(()) };
        let defined = self.materials(&file).map_err(|stop| stop.in_file(name))?;
        match defined {
            0 => self.lack(format!(
                "takes colours from {}, which defines no material (newmtl); the model lacks them: write it again",
                shown(name)
            )),
            _ => Ok(()),
        }
    }

    /// Reads a library; returns the number of materials that it defines.
    fn materials(&mut self, file: &PositionalFile) -> Result<u64, Stop> {
        let mut words = Words::begin(file)?;
        let (mut at, mut defined) = (None, 0);
        loop {
            match words.next()? {
                Token::End => break,
                Token::LineEnd => continue,
                Token::Word => {}
            }
            match words.word() {
                b"newmtl" => {
                    defined += 1;
                    let name = words.rest_of_line(1024)?;
                    let used = self.numbers.get(&name).copied().filter(|used| self.undefined.remove(used));
                    let number = used.map_or_else(|| self.add(name), Ok)?;
                    at = usize::try_from(number).ok();
                }
                b"Kd" => {
                    let line = words.line();
                    let ([r, g, b], count) = words.rest("a colour", &[1, 3])?;
                    let color = light(if count == 1 { [r; 3] } else { [r, g, b] });
                    let color = color.map_err(|fault| bad_text_because(line, &fault.text))?;
                    if let Some(material) = at.and_then(|at| self.all.get_mut(at)) {
                        material.color = color;
                    }
                }
                word if word.eq_ignore_ascii_case(b"map_Kd") => {
                    let line = words.rest_of_line(4096)?;
                    let texture = self.texture(&line, words.line())?;
                    if let Some(material) = at.and_then(|at| self.all.get_mut(at)) {
                        material.texture = texture;
                    }
                }
                _ => words.skip_line()?,
            }
        }
        for material in &mut self.all {
            // Black, where the texture is all that counts.
            if material.texture.is_some() && material.color == [0.0; 3] {
                material.color = [1.0; 3];
            }
        }
        Ok(defined)
    }

    /// A texture as its line states it: options, then the name of the image.
    fn texture(&mut self, text: &str, line: u64) -> Result<Option<Texture>, Stop> {
        let mut rest = text.trim();
        let (mut wrap, mut placed) = (Wrap::Repeat, UNPLACED);
        while rest.starts_with('-') {
            let (option, behind) = split(rest);
            rest = behind;
            let most = match option {
                "-mm" => 2,
                "-s" | "-o" | "-t" => 3,
                _ => 1,
            };
            let mut seen = 0;
            while seen < most {
                let (value, behind) = split(rest);
                let number = value.parse::<f32>().ok();
                let like_number = value.bytes().all(|b| b.is_ascii_digit() || b"+-.,".contains(&b));
                if most > 1 && number.is_none() && (seen == 0 || like_number) {
                    return Err(bad_text_because(line, &not_a_number(value.as_bytes())).into());
                }
                if most > 1 && number.is_none() || behind.is_empty() {
                    break;
                }
                match (option, number, seen) {
                    ("-clamp", ..) if value == "on" => wrap = Wrap::Clamp,
                    ("-s", Some(scale), 0 | 1) => placed[seen][seen] = scale,
                    ("-o", Some(offset), 0 | 1) => placed[seen][2] = offset,
                    _ => {}
                }
                rest = behind;
                seen += 1;
            }
        }
        if rest.is_empty() {
            return Ok(None);
        }
        let image = match self.images.get(rest) {
            Some(image) => image.clone(),
            None => {
                let Some((file, bytes)) = self.open(rest)? else { return Ok(None) };
                self.hold(rest.len())?;
                let image = Arc::new(Image { name: rest.to_owned(), file: Arc::new(file), offset: 0, bytes });
                self.images.insert(rest.to_owned(), image.clone());
                image
            }
        };
        Ok(Some(Texture { image, wraps: [wrap; 2], upwards: true, placed }))
    }
}

/// The first word, and the rest.
fn split(text: &str) -> (&str, &str) {
    let text = text.trim_start();
    text.split_once(char::is_whitespace).map_or((text, ""), |(word, rest)| (word, rest.trim_start()))
}
