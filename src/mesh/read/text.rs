//! OFF, and its common parts with other text formats: vertices and triangles wait in scratch files.

use std::path::Path;

use super::Limits;
use super::polygon;
use super::stop::{Each, EachLook, EachOf, Stop, finite};
use super::stream::{Stream, Token, Words, numbers};
use super::vertex_looks::VertexLooks;
use super::vertices::{FEW_PAGES, PAGES, Pages, Spool, Vertices};
use crate::fault::bad;
use crate::mesh::read::stop::{bad_index, count_lies, only_points, unread_colors};
use crate::platform::PositionalFile;

/// Vertices, and triangles that name them.
#[derive(Debug)]
pub(super) struct Faces {
    vertices: Vertices,
    triangles: PositionalFile,
    count: u64,
    looks: VertexLooks,
}

/// Triangles that fan out from the first vertex of a face, or a strip in which each shares an edge with the next.
pub(super) struct Fan<V = u32> {
    first: Option<V>,
    last: Option<V>,
    strip: bool,
    /// Every other triangle of a strip is turned over.
    odd: bool,
}

impl<V: Copy> Fan<V> {
    pub(super) fn new() -> Self {
        Self { first: None, last: None, strip: false, odd: false }
    }

    pub(super) fn strip() -> Self {
        Self { strip: true, ..Self::new() }
    }

    /// The triangle that the next vertex adds.
    #[inline]
    pub(super) fn next(&mut self, vertex: V) -> Option<[V; 3]> {
        let Some(first) = self.first else {
            self.first = Some(vertex);
            return None;
        };
        let last = self.last.replace(vertex)?;
        if !self.strip {
            return Some([first, last, vertex]);
        }
        self.first = Some(last);
        self.odd = !self.odd;
        Some(if self.odd { [first, last, vertex] } else { [last, first, vertex] })
    }
}

/// Faces of four corners and more that were written as fans: the number of the first triangle, and the corners.
pub(super) struct Polygons(Spool);

impl Polygons {
    pub(super) fn new(scratch: &Path) -> Self {
        Self(Spool::new(scratch))
    }

    /// Records the fan of triangles from `first` to before `end`.
    #[inline]
    pub(super) fn fan(&mut self, first: u64, end: u64) -> Result<(), Stop> {
        match u32::try_from(end - first + 2) {
            Ok(corners) if (4..=polygon::MAX_CORNERS).contains(&(corners as usize)) => {
                let half = |n: u64| u32::try_from(n & u64::from(u32::MAX)).unwrap_or(0);
                self.0.numbers([half(first), half(first >> 32), corners])
            }
            _ => Ok(()),
        }
    }
}

/// Data of the triangles of a fan, in records of `numbers` numbers: triples, a number for each corner, come first.
struct Records<'a> {
    file: &'a PositionalFile,
    numbers: usize,
    triples: usize,
}

impl Records<'_> {
    fn at(&self, triangle: u64) -> u64 {
        4 * triangle * self.numbers as u64
    }

    /// The records of the corners of a fan: for each a number of every triple, then the numbers behind these.
    fn corners(&self, first: u64, triangles: usize) -> Result<Vec<Vec<u32>>, Stop> {
        let mut bytes = vec![0; 4 * self.numbers * triangles];
        self.file.read_exact_at(&mut bytes, self.at(first)).map_err(Stop::Scratch)?;
        let number = |record: usize, at: usize| {
            let [number] = numbers(&bytes[4 * (self.numbers * record + at)..]);
            number
        };
        let corner = |record: usize, of: usize| {
            let triples = (0..self.triples).map(|triple| number(record, 3 * triple + of));
            triples.chain((3 * self.triples..self.numbers).map(|at| number(record, at))).collect()
        };
        Ok([corner(0, 0), corner(0, 1)].into_iter().chain((0..triangles).map(|at| corner(at, 2))).collect())
    }

    /// Writes the records of other triangles of the same corners.
    fn rewrite(&self, first: u64, corners: &[Vec<u32>], cut: &[[u32; 3]]) -> Result<(), Stop> {
        let mut bytes = Vec::with_capacity(4 * self.numbers * cut.len());
        for t in cut {
            let of = t.map(|at| &corners[at as usize]);
            let triples = (0..self.triples).flat_map(|triple| of.map(|corner| corner[triple]));
            let all = triples.chain(of[0][self.triples..].iter().copied());
            all.for_each(|number| bytes.extend(number.to_le_bytes()));
        }
        self.file.write_all_at(&bytes, self.at(first)).map_err(Stop::Scratch)
    }
}

/// Statements of the first word of an OFF file about the numbers of its vertices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct OffKind {
    /// True for vertices with colours.
    colored: bool,
    /// Numbers of normals and places in textures behind the coordinates.
    more: usize,
    /// True for a coordinate more than usual.
    fourth: bool,
    /// True where the number of coordinates stands before the counts.
    dimension: bool,
}

/// The kind of an OFF file by its first word, and the rest of that word: ModelNet writes `OFF8 6 0`.
fn off_word(word: &[u8]) -> Option<(OffKind, &[u8])> {
    let mut kind = OffKind::default();
    let mut rest = word;
    for (prefix, more) in [(&b"ST"[..], 2), (b"C", 0), (b"N", 3)] {
        if let Some(behind) = rest.strip_prefix(prefix) {
            (rest, kind.more) = (behind, kind.more + more);
            kind.colored |= prefix == b"C";
        }
    }
    for (prefix, stated) in [(b"4", &mut kind.fourth), (b"n", &mut kind.dimension)] {
        if let Some(behind) = rest.strip_prefix(prefix) {
            (rest, *stated) = (behind, true);
        }
    }
    let rest = rest.strip_prefix(b"OFF")?;
    rest.first().is_none_or(u8::is_ascii_digit).then_some((kind, rest))
}

/// The note on text behind the last face.
pub(super) fn more_than(faces: u64) -> String {
    format!(
        "has more behind the {faces} faces that it states, which was left out; correct their number if faces are missing"
    )
}

/// True if it begins as an OFF file. Empty lines and comments may come first.
pub(super) fn is_off(head: &[u8]) -> bool {
    let mut rest = head.trim_ascii_start();
    while rest.starts_with(b"#") {
        let end = rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
        rest = rest[end..].trim_ascii_start();
    }
    off_word(rest.split(u8::is_ascii_whitespace).next().unwrap_or_default()).is_some()
}

/// A vertex by its number from 0.
pub(super) fn index(vertices: u64, face: u64, at: i64) -> Result<u32, Stop> {
    let bad = || Stop::from(bad_index(face + 1, vertices));
    u32::try_from(at).map_err(|_| bad())
}

impl Faces {
    /// Cuts polygons that are not convex anew, given by the number of the first triangle and the corners of each; other
    /// data of its triangles, in records of as many numbers, triples of corners first, is moved along.
    pub(super) fn cut(
        &self,
        polygons: Polygons,
        carried: Option<(&PositionalFile, usize)>,
    ) -> Result<(), Stop> {
        if polygons.0.count == 0 {
            return Ok(());
        }
        let (file, count) = polygons.0.finish()?;
        let mut points = Pages::new(&self.vertices, FEW_PAGES);
        let mut stream = Stream::new(&file, 0);
        for _ in 0..count {
            let record: [u8; 12] = stream.take()?;
            let [low, high, corners] = numbers(&record);
            let first = u64::from(low) | u64::from(high) << 32;
            let triangles = corners as usize - 2;
            let own = Records { file: &self.triangles, numbers: 3, triples: 1 }.corners(first, triangles)?;
            let mut polygon = Vec::with_capacity(corners as usize);
            for corner in &own {
                polygon.push(points.get(corner[0].into(), first)?);
            }
            let Some(cut) = polygon::cut(&polygon) else { continue };
            Records { file: &self.triangles, numbers: 3, triples: 1 }.rewrite(first, &own, &cut)?;
            if let Some((file, numbers)) = carried {
                let records = Records { file, numbers, triples: numbers / 3 };
                records.rewrite(first, &records.corners(first, triangles)?, &cut)?;
            }
        }
        Ok(())
    }

    /// Reads an OFF file, with notes on parts left out: colours behind vertices and faces, and anything after its
    /// faces.
    pub(super) fn off(
        file: &PositionalFile,
        bytes: u64,
        limits: &Limits<'_>,
    ) -> Result<(Self, Vec<String>), Stop> {
        let scratch = limits.scratch;
        let mut words = Words::begin(file)?;
        words.must_anywhere()?;
        // The first word may be missing, or the first number may follow it at once.
        let (kind, rest) = off_word(words.word()).unwrap_or((OffKind::default(), words.word()));
        let mut given = if rest.is_empty() { None } else { Some(words.whole_of(rest)?) };
        let mut counts = [3, 0, 0, 0];
        for count in counts.iter_mut().skip(usize::from(!kind.dimension)) {
            let number = match given.take() {
                Some(number) => number,
                None => {
                    words.must_anywhere()?;
                    if words.word() == b"BINARY" {
                        return Err(bad!(
                            "is binary OFF, which is not read; write it as text, or as PLY or STL"
                        )
                        .into());
                    }
                    words.as_whole()?
                }
            };
            *count = u64::try_from(number).map_err(|_| words.wrong())?;
        }
        words.end_of_line("its list of counts")?;
        let [dimension, vertex_count, face_count, _] = counts;
        let coordinates = dimension.saturating_add(u64::from(kind.fourth));
        if coordinates != 3 {
            return Err(
                bad!("is OFF of {coordinates} coordinates, which is not read; write it with 3").into()
            );
        }
        if face_count == 0 && vertex_count > 0 {
            return Err(only_points().into());
        }
        // A vertex takes six bytes at least, a face two.
        if vertex_count > bytes / 6 + 1 || face_count > bytes / 2 || vertex_count > u64::from(u32::MAX) {
            return Err(count_lies(vertex_count.max(face_count), bytes / 6).into());
        }
        let (mut vertices, mut triangles) = (Spool::new(scratch), Spool::new(scratch));
        let (mut polygons, mut colored) = (Polygons::new(scratch), kind.colored);
        for _ in 0..vertex_count {
            words.must_anywhere()?;
            let x = words.as_number()?;
            let counts = [2, 5, 6].map(|count| count + kind.more);
            let ([y, z], count) = words.rest("a vertex behind its first number", &counts)?;
            colored |= count > counts[0];
            vertices.vertex([x, y, z])?;
        }
        for face in 0..face_count {
            words.must_anywhere()?;
            let (line, corners) = (words.line(), words.as_whole()?);
            if corners < 0 {
                return Err(words.wrong());
            }
            let (mut fan, first) = (Fan::new(), triangles.count);
            for _ in 0..corners {
                words.must_anywhere()?;
                let at = index(vertex_count, face, words.as_whole()?)?;
                if let Some(t) = fan.next(at) {
                    triangles.numbers(t)?;
                }
            }
            polygons.fan(first, triangles.count)?;
            if words.line() == line {
                // The number of a colour, or its parts.
                colored |= words.rest::<0>("the colour of a face", &[0, 1, 3, 4])?.1 > 0;
            } else if words.next()? == Token::Word {
                // Colours stand behind faces of one line: the first line was short.
                return Err(Words::wrong_at(line));
            }
        }
        let mut lacks = Vec::new();
        if colored && limits.colors {
            lacks.push(unread_colors("OFF"));
        }
        lacks.extend(words.has_more()?.then(|| more_than(face_count)));
        let faces = Self::of(vertices, triangles, VertexLooks::default())?;
        faces.cut(polygons, None)?;
        Ok((faces, lacks))
    }

    /// Vertices and triangles that were written, with the looks of vertices.
    pub(super) fn of(vertices: Spool, triangles: Spool, looks: VertexLooks) -> Result<Self, Stop> {
        let (triangles, count) = triangles.finish()?;
        Ok(Self { vertices: vertices.into_vertices()?, triangles, count, looks })
    }

    pub(super) fn looks(&self) -> &VertexLooks {
        &self.looks
    }

    /// Calls `each` with every triangle and the looks of its vertices.
    pub(super) fn for_each_look(&self, each: &mut EachLook<'_>) -> Result<(), Stop> {
        let mut looks = self.looks.open();
        // Triangles come in the order in which they were written.
        let mut corners = Stream::new(&self.triangles, 0);
        self.for_each_of(&|p| p, &mut |t, triangle| {
            finite(t, triangle)?;
            let record: [u8; 12] = corners.take()?;
            each(t, &looks.look_of(triangle - 1, numbers(&record), triangle)?)
        })
    }

    pub(super) fn for_each(&self, each: &mut Each<'_>) -> Result<(), Stop> {
        self.for_each_of(&|p| p, &mut |t, triangle| {
            finite(t, triangle)?;
            each(t)
        })
    }

    /// Calls `each` with the results of `make` for the vertices of every triangle, and its number, counted from 1.
    pub(super) fn for_each_of<P: Copy>(
        &self,
        make: &dyn Fn([f64; 3]) -> P,
        each: &mut EachOf<'_, P>,
    ) -> Result<(), Stop> {
        let mut pages = Pages::of(&self.vertices, PAGES, make);
        let mut stream = Stream::new(&self.triangles, 0);
        for face in 0..self.count {
            let [a, b, c, d, e, f, g, h, i, j, k, l]: [u8; 12] = stream.take()?;
            let mut corner = |at: [u8; 4]| pages.get(u32::from_le_bytes(at).into(), face);
            each(&[corner([a, b, c, d])?, corner([e, f, g, h])?, corner([i, j, k, l])?], face + 1)?;
        }
        Ok(())
    }
}
