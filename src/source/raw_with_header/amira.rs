//! Amira and Avizo lattices (`.am`): a header in blocks of text, `@1`, raw samples of either byte order.
//!
//! `BoundingBox` gives the centres of the first and the last voxel.

use std::path::Path;

use super::{Headed, Read, missing, refused, sample_type, scale, unread, upright};
use crate::fault::bad;
use crate::platform::PositionalFile;
use crate::source::OpenOptions;
use crate::source::header::{Lines, exactly, text, unreadable};
use crate::source::payload::Encoding;
use crate::volume::{Endian, Result, VolumeSource};

const ELSE: &str = "save it as raw binary, NRRD or MetaImage";

pub(in crate::source) fn recognise(head: &[u8], _: &Path) -> bool {
    head.starts_with(b"# AmiraMesh") || head.starts_with(b"# Avizo")
}

pub(in crate::source) fn open(path: &Path, _: &OpenOptions) -> Result<Vec<Box<dyn VolumeSource>>> {
    let file = PositionalFile::open(path).map_err(|cause| unreadable(path, cause))?;
    let mut lines = Lines::new(&file);
    let mut next = || lines.next().map_err(|cause| unreadable(path, cause)).map(|line| (line, lines.offset));
    let (Some(first), _) = next()? else { return Err(refused(path)(missing("its kind"))) };
    let first = text(&first).to_uppercase();
    let mut words: Vec<String> = Vec::new();
    while let (Some(line), at) = next()? {
        let line = text(&line);
        if line == "@1" {
            return headed(&first, &words, at).map_err(refused(path))?.open(path, None);
        }
        if !line.starts_with('#') {
            let parts = line.split(|c: char| c.is_whitespace() || "{}=".contains(c));
            let parts = parts.map(|part| part.trim_end_matches(',')).filter(|part| !part.is_empty());
            words.extend(parts.map(str::to_owned));
        }
    }
    Err(refused(path)(missing("where its samples begin (@1)")))
}

/// The words after `word`, at its first occurrence with a next word that fits.
fn behind<'a>(words: &'a [String], word: &str, fits: impl Fn(&str) -> bool) -> Option<&'a [String]> {
    let mut pairs = words.windows(2);
    let at = pairs.position(|pair| pair[0] == word && fits(&pair[1]))?;
    words.get(at + 1..)
}

/// The words of a field up to the next name, which begins with a letter.
fn number_words(words: &[String]) -> String {
    let named = |word: &&String| !word.starts_with(|c: char| c.is_alphabetic() || "\"@".contains(c));
    let first = words.first().into_iter().chain(words.iter().skip(1).take_while(named));
    first.map(String::as_str).collect::<Vec<_>>().join(" ")
}

fn headed(first: &str, words: &[String], at: u64) -> Read<Headed> {
    if first.contains("ASCII") {
        return Err(unread("text (ASCII)", ELSE));
    }
    let endian = if first.contains("BINARY-LITTLE-ENDIAN") { Endian::Little } else { Endian::Big };
    let is_number = |word: &str| word.starts_with(|c: char| c.is_ascii_digit());
    let lattice = behind(words, "Lattice", is_number).ok_or_else(|| missing("a lattice of three axes"))?;
    let size: [u64; 3] = exactly("define Lattice", &number_words(lattice))?;
    let mut rest = lattice;
    while let Some(again) = behind(rest, "Lattice", is_number) {
        if exactly::<3, u64>("define Lattice", &number_words(again))? != size {
            return Err(bad!(
                "its header defines Lattice twice, with different sizes; remove the wrong line"
            ));
        }
        rest = again;
    }
    if let Some(kind) = behind(words, "CoordType", |kind| kind.trim_matches('"') != "uniform") {
        return Err(unread(
            format!("a lattice of the CoordType {}", kind[0].trim_matches('"')),
            "resample it to a uniform one",
        ));
    }
    let Some([kind, _, mark, ..]) = behind(words, "Lattice", |word| !is_number(word)) else {
        return Err(missing("what its lattice holds"));
    };
    if let Some((_, packing)) = mark.split_once('(') {
        return Err(unread(format!("samples packed by {}", packing.trim_end_matches(')')), ELSE));
    }
    let samples = match kind.as_str() {
        "byte" => sample_type(false, false, 8),
        "short" => sample_type(false, true, 16),
        "ushort" => sample_type(false, false, 16),
        "int" | "int32" => sample_type(false, true, 32),
        "float" => sample_type(true, true, 32),
        "double" => sample_type(true, true, 64),
        _ => None,
    };
    let Some(samples) = samples.filter(|_| mark == "@1") else {
        let what = format!("samples of the type `{kind}` at {mark}");
        return Err(unread(what, "save one value a voxel, alone"));
    };
    let bounds = behind(words, "BoundingBox", |_| true).ok_or_else(|| missing("BoundingBox"))?;
    let bounds: [f64; 6] = exactly("BoundingBox", &number_words(bounds))?;
    let mut notes = Vec::new();
    let unit = behind(words, "Coordinates", |_| true).map(|unit| unit[0].as_str());
    let spacing = [0, 1, 2].map(|k| {
        let length = bounds[2 * k + 1] - bounds[2 * k];
        if size[k] > 1 { length / (size[k] - 1) as f64 } else { length.max(1.0) }
    });
    let affine = upright(spacing, [0, 2, 4].map(|k| bounds[k]), scale(unit, &mut notes));
    Ok(Headed {
        format: "amira",
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
