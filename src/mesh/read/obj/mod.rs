//! OBJ: text, read once; vertices, triangles and their looks wait in scratch files. Materials come from MTL.
//!
//! The statements `v`, `vt`, `vn`, `f`, `o`, `g`, `mtllib` and `usemtl` count; objects and groups are parts. The
//! second coordinate of places runs up.

mod materials;

use std::collections::BTreeSet;
use std::path::Path;

use super::appearance::{Appearance, NO_MATERIAL};
use super::parts::Parts;
use super::stop::{Each, EachLook, Stop, UNPLACED};
use super::stream::{Stream, Token, Words, numbers};
use super::text::{Faces, Fan, Polygons, index};
use super::vertex_looks::{VertexLooks, light, single};
use super::vertices::{FEW_PAGES, Pages, Spool, Vertices};
use super::{Limits, Summary};
use crate::mesh::read::stop::{only_points, unknown_format};
use crate::platform::PositionalFile;
use materials::Materials;

/// Marks a corner without a place or a normal.
const NONE: u32 = u32::MAX;
/// Bytes of a triangle's look: places, normals and colours of its corners, and its material.
const CARRIED: usize = 40;

pub(super) struct Obj {
    faces: Faces,
    carried: Option<Carried>,
    parts: Parts,
}

struct Carried {
    triangles: PositionalFile,
    places: Vertices,
    normals: Vertices,
    /// Colours of all vertices, if one has a colour.
    colors: Option<Vertices>,
    /// Numbers of materials that no library defines.
    undefined: BTreeSet<u32>,
}

/// The same while the file is read.
struct Spools {
    triangles: Spool,
    places: Spool,
    normals: Spool,
    colors: Spool,
    colored: bool,
    /// Materials of faces without places in a texture.
    unplaced: BTreeSet<u32>,
}

impl Spools {
    fn new(scratch: &Path) -> Self {
        Self {
            triangles: Spool::new(scratch),
            places: Spool::new(scratch),
            normals: Spool::new(scratch),
            colors: Spool::new(scratch),
            colored: false,
            unplaced: BTreeSet::new(),
        }
    }

    fn finish(self, undefined: BTreeSet<u32>) -> Result<Carried, Stop> {
        Ok(Carried {
            undefined,
            triangles: self.triangles.finish()?.0,
            places: self.places.into_vertices()?,
            normals: self.normals.into_vertices()?,
            colors: if self.colored { Some(self.colors.into_vertices()?) } else { None },
        })
    }
}

pub(super) fn open(file: &PositionalFile, path: &Path, limits: &Limits<'_>) -> Result<(Obj, Summary), Stop> {
    let mut words = Words::begin(file)?;
    let scratch = limits.scratch;
    let (mut vertices, mut triangles) = (Spool::new(scratch), Spool::new(scratch));
    let mut polygons = Polygons::new(scratch);
    let mut spools = limits.looks.then(|| Spools::new(scratch));
    let mut materials = Materials::new(path, limits);
    let mut material = NO_MATERIAL;
    let mut parts = Parts::default();
    let (mut faces, mut understood, mut has_colors) = (0, false, false);
    // Places and normals that faces name, and places that there are.
    let (mut named, mut places) = ([false; 2], 0_u64);
    loop {
        match words.next()? {
            Token::End => break,
            Token::LineEnd => continue,
            Token::Word => {}
        }
        match (words.word(), &mut spools) {
            (b"v", spools) => {
                // A weight, or a colour and perhaps its opacity, may follow.
                let ([x, y, z, r, g, b, _], count) = words.rest::<7>("a vertex", &[3, 4, 6, 7])?;
                vertices.vertex([x, y, z])?;
                let colored = count > 4;
                has_colors |= colored;
                if let Some(spools) = spools {
                    spools.colored |= colored;
                    spools.colors.vertex(if colored { [r, g, b] } else { [1.0; 3] })?;
                }
                understood = true;
            }
            (b"vt", spools) => {
                places += 1;
                let ([u, v, _], _) = words.rest("a place in a texture", &[1, 2, 3])?;
                if let Some(spools) = spools {
                    spools.places.vertex([u, v, 0.0])?;
                }
            }
            (b"vn", spools) => {
                let (normal, _) = words.rest("a normal", &[3])?;
                if let Some(spools) = spools {
                    spools.normals.vertex(normal)?;
                }
            }
            (b"usemtl", Some(_)) if limits.colors => {
                material = materials.number(&words.rest_of_line(1024)?)?
            }
            (b"mtllib", Some(_)) if limits.colors => materials.read(&words.rest_of_line(1024)?)?,
            (b"mtllib", None) => {
                has_colors = true;
                words.skip_line()?;
            }
            (b"o", _) => parts.object(words.rest_of_line(1024)?.as_bytes()),
            (b"g", _) => parts.group(words.rest_of_line(1024)?.as_bytes()),
            (b"f", spools) => {
                let first = triangles.count;
                parts.face(first);
                let corners = [vertices.count, faces];
                face(&mut words, corners, material, &mut triangles, spools.as_mut(), &mut named)?;
                polygons.fan(first, triangles.count)?;
                faces += 1;
            }
            _ => words.skip_line()?,
        }
    }
    if !understood {
        return Err(unknown_format().into());
    }
    if faces == 0 {
        return Err(only_points().into());
    }
    let no_normals = spools.as_ref().is_some_and(|spools| spools.normals.count == 0);
    let (mut summary, undefined) = materials.summary()?;
    let textured = |at: &u32| {
        let material = summary.materials.get(*at as usize);
        material.is_some_and(|material| material.texture.is_some())
    };
    let lost = named[0] && places == 0;
    let unplaced = !lost && spools.as_ref().is_some_and(|spools| spools.unplaced.iter().any(textured));
    let missing = [lost, named[1] && no_normals, unplaced, limits.colors && words.painted];
    let carried = spools.map(|spools| spools.finish(undefined)).transpose()?;
    let lacks = [
        "names places in a texture (vt) that it does not hold; the model lacks the texture".to_owned(),
        "names normals (vn) that it does not hold; those of its triangles are used".to_owned(),
        UNPLACED.to_owned(),
        "has colours of vertices in comments (#MRGB), which are not read; the model lacks them: write them behind the vertices, as x y z r g b".to_owned(),
    ]
    .into_iter()
    .zip(missing);
    summary.lacks.extend(lacks.filter(|(_, is_so)| *is_so).map(|(lack, _)| lack));
    let looks = carried.as_ref().map_or([has_colors, false], |carried: &Carried| {
        [carried.colors.is_some() || !summary.materials.is_empty(), carried.normals.count > 0]
    });
    let held_bytes = summary.held_bytes + Parts::BYTES;
    let summary = Summary { held_bytes, parts: parts.count(), looks, ..summary };
    let faces = Faces::of(vertices, triangles, VertexLooks::default())?;
    faces.cut(polygons, carried.as_ref().map(|carried| (&carried.triangles, CARRIED / 4)))?;
    Ok((Obj { faces, carried, parts }, summary))
}

impl Obj {
    pub(super) fn for_each(&self, each: &mut Each<'_>) -> Result<(), Stop> {
        self.faces.for_each(each)
    }

    /// Calls `each` with every triangle and its look.
    pub(super) fn for_each_look(&self, each: &mut EachLook<'_>) -> Result<(), Stop> {
        let mut part = self.parts.each();
        let Some(carried) = &self.carried else {
            return self.for_each(&mut |t| each(t, &Appearance { part: part(), ..Appearance::NONE }));
        };
        let mut open = LookReader {
            stream: Stream::new(&carried.triangles, 0),
            places: Pages::new(&carried.places, FEW_PAGES),
            normals: Pages::new(&carried.normals, FEW_PAGES),
            colors: carried.colors.as_ref().map(|colors| Pages::new(colors, FEW_PAGES)),
            undefined: &carried.undefined,
            face: 0,
        };
        self.faces.for_each(&mut |t| each(t, &Appearance { part: part(), ..open.next()? }))
    }
}

/// Reads the looks of triangles, one after the other.
struct LookReader<'a> {
    stream: Stream<'a>,
    places: Pages<'a>,
    normals: Pages<'a>,
    colors: Option<Pages<'a>>,
    undefined: &'a BTreeSet<u32>,
    face: u64,
}

impl LookReader<'_> {
    fn next(&mut self) -> Result<Appearance, Stop> {
        let record: [u8; CARRIED] = self.stream.take()?;
        let [p0, p1, p2, n0, n1, n2, v0, v1, v2, material] = numbers(&record);
        self.face += 1;
        let face = self.face;
        let three = |pages: &mut Pages<'_>, at: [u32; 3]| -> Result<Option<[[f64; 3]; 3]>, Stop> {
            if at.contains(&NONE) || pages.is_empty() {
                return Ok(None);
            }
            let mut get = |at: u32| pages.get(at.into(), face);
            Ok(Some([get(at[0])?, get(at[1])?, get(at[2])?]))
        };
        let places = three(&mut self.places, [p0, p1, p2])?;
        let normals = three(&mut self.normals, [n0, n1, n2])?;
        let mut look = Appearance {
            places: places.map(|of| of.map(single).map(|[u, v, _]| [u, v])),
            normals: normals.map(|of| of.map(single)),
            material: if self.undefined.contains(&material) { NO_MATERIAL } else { material },
            ..Appearance::NONE
        };
        if let Some(colors) = &mut self.colors {
            // Colours of vertices come before the plain colour of a material.
            if let Some([a, b, c]) = three(colors, [v0, v1, v2])? {
                look.colors = Some([light(a)?, light(b)?, light(c)?]);
            }
            if look.places.is_none() {
                look.material = NO_MATERIAL;
            }
        }
        Ok(look)
    }
}

fn face(
    words: &mut Words<'_>,
    [vertices, number]: [u64; 2],
    material: u32,
    triangles: &mut Spool,
    mut spools: Option<&mut Spools>,
    [places_named, normals_named]: &mut [bool; 2],
) -> Result<(), Stop> {
    let (mut fan, mut of_places, mut of_normals) = (Fan::new(), Fan::new(), Fan::new());
    let mut continued = false;
    loop {
        match words.next()? {
            Token::Word if words.word() == b"\\" => continued = true,
            Token::LineEnd if continued => continued = false,
            Token::LineEnd | Token::End => return Ok(()),
            Token::Word => {
                let mut parts = words.word().split(|b| *b == b'/');
                let at = part(parts.next(), vertices, number).map_err(|()| words.wrong())??;
                let triangle = fan.next(at.ok_or_else(|| words.wrong())?);
                if let Some(t) = triangle {
                    triangles.numbers(t)?;
                }
                let Some(spools) = spools.as_mut() else {
                    *places_named |= parts.next().is_some_and(|word| !word.is_empty());
                    continue;
                };
                let mut other = |count: u64, named: &mut bool| {
                    let at = part(parts.next(), count, number).map_err(|()| words.wrong())?;
                    *named |= !matches!(at, Ok(None));
                    // A number may point to values that come later; the shape does not need them.
                    Ok::<_, Stop>(
                        at.or_else(|stop| if count == 0 { Ok(None) } else { Err(stop) })?.unwrap_or(NONE),
                    )
                };
                let places = of_places.next(other(spools.places.count, places_named)?);
                let normals = of_normals.next(other(spools.normals.count, normals_named)?);
                if let (Some(p), Some(n), Some(t)) = (places, normals, triangle) {
                    if p.contains(&NONE) && material != NO_MATERIAL {
                        spools.unplaced.insert(material);
                    }
                    let record = [p[0], p[1], p[2], n[0], n[1], n[2], t[0], t[1], t[2], material];
                    spools.triangles.numbers(record)?;
                }
            }
        }
    }
}

/// One part of a corner `7`, `7/1`, `7//3` or `-1`, counted from 0; `None` for an empty one. Refuses other texts, and
/// numbers of vertices that do not exist yet.
#[inline]
fn part(word: Option<&[u8]>, count: u64, face: u64) -> Result<Result<Option<u32>, Stop>, ()> {
    let Some(word) = word.filter(|word| !word.is_empty()) else { return Ok(Ok(None)) };
    let (negative, digits) = match word.split_first() {
        Some((b'-', rest)) => (true, rest),
        _ => (false, word),
    };
    if digits.is_empty() || digits.len() > 18 || !digits.iter().all(u8::is_ascii_digit) {
        return Err(());
    }
    let value = digits.iter().fold(0, |n, d| 10 * n + i64::from(d - b'0'));
    let at = if negative { i64::try_from(count).unwrap_or(i64::MAX) - value } else { value - 1 };
    Ok(index(count, face, at).map(Some))
}
