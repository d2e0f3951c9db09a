//! OBJ and OFF: text, read once; vertices and triangles wait in nameless files.

use std::fs::File;
use std::path::Path;

use super::stop::{Each, Stop};
use super::stream::{Stream, Token, Words};
use super::vertices::{PAGES, Pages, Spool, Vertices};
use crate::facts::MeshFault;

/// Vertices, and triangles that name them.
#[derive(Debug)]
pub(super) struct Faces {
    vertices: Vertices,
    triangles: File,
    count: u64,
}

/// Triangles that fan out from the first vertex of a face.
pub(super) struct Fan {
    first: u32,
    last: u32,
    seen: u64,
}

impl Fan {
    pub(super) fn new() -> Self {
        Self { first: 0, last: 0, seen: 0 }
    }

    /// The triangle that the next vertex adds.
    #[inline]
    pub(super) fn next(&mut self, vertex: u32) -> Option<[u32; 3]> {
        let triangle = (self.seen >= 2).then_some([self.first, self.last, vertex]);
        if self.seen == 0 {
            self.first = vertex;
        }
        self.last = vertex;
        self.seen += 1;
        triangle
    }
}

/// Does it begin as an OFF file?
pub(super) fn is_off(head: &[u8]) -> bool {
    let word = head.split(u8::is_ascii_whitespace).next().unwrap_or_default();
    [&b"OFF"[..], b"COFF", b"NOFF", b"CNOFF", b"STOFF"].contains(&word)
}

fn index(words: &Words<'_>, vertices: u64, face: u64, at: i64) -> Result<u32, Stop> {
    let _ = words;
    let bad = || Stop::from(MeshFault::BadIndex { face: face + 1, vertices });
    u32::try_from(at).map_err(|_| bad())
}

impl Faces {
    /// Reads an OBJ file; of its many statements vertices and faces count.
    pub(super) fn obj(file: &File, _: u64, scratch: &Path) -> Result<Self, Stop> {
        let mut words = Words::new(file, 0);
        let (mut vertices, mut triangles) = (Spool::new(scratch)?, Spool::new(scratch)?);
        let mut faces = 0;
        let mut understood = false;
        loop {
            match words.next()? {
                Token::End => break,
                Token::LineEnd => continue,
                Token::Word => {}
            }
            match words.word() {
                b"v" => {
                    vertices.vertex([words.number()?, words.number()?, words.number()?])?;
                    words.skip_line()?;
                    understood = true;
                }
                b"f" => {
                    let mut fan = Fan::new();
                    let mut continued = false;
                    loop {
                        match words.next()? {
                            Token::Word if words.word() == b"\\" => continued = true,
                            Token::LineEnd if continued => continued = false,
                            Token::LineEnd | Token::End => break,
                            Token::Word => {
                                let at = obj_index(&words, vertices.count, faces)?;
                                if let Some(t) = fan.next(at) {
                                    triangles.triangle(t)?;
                                }
                            }
                        }
                    }
                    faces += 1;
                }
                _ => words.skip_line()?,
            }
        }
        if !understood {
            return Err(MeshFault::Unknown.into());
        }
        Self::done(vertices, triangles)
    }

    /// Reads an OFF file, with or without colours behind its vertices and faces.
    pub(super) fn off(file: &File, bytes: u64, scratch: &Path) -> Result<Self, Stop> {
        let mut words = Words::new(file, 0);
        words.must_anywhere()?;
        let mut counts = [0; 3];
        for count in &mut counts {
            words.must_anywhere()?;
            *count = u64::try_from(words.as_whole()?).map_err(|_| words.wrong())?;
        }
        let [vertex_count, face_count, _] = counts;
        // A vertex takes six bytes at least, a face two.
        if vertex_count > bytes / 6 + 1 || face_count > bytes / 2 || vertex_count > u64::from(u32::MAX) {
            return Err(MeshFault::CountLies { stated: vertex_count.max(face_count), held: bytes / 6 }.into());
        }
        let (mut vertices, mut triangles) = (Spool::new(scratch)?, Spool::new(scratch)?);
        for _ in 0..vertex_count {
            words.must_anywhere()?;
            let x = words.as_number()?;
            vertices.vertex([x, words.number()?, words.number()?])?;
            words.skip_line()?;
        }
        for face in 0..face_count {
            words.must_anywhere()?;
            let corners = words.as_whole()?;
            let mut fan = Fan::new();
            for _ in 0..corners {
                words.must()?;
                let at = index(&words, vertex_count, face, words.as_whole()?)?;
                if let Some(t) = fan.next(at) {
                    triangles.triangle(t)?;
                }
            }
            words.skip_line()?;
        }
        Self::done(vertices, triangles)
    }

    /// Reads the text of a PLY file from its first vertex on; see [`super::ply`].
    pub(super) fn of(vertices: Spool, triangles: Spool) -> Result<Self, Stop> {
        Self::done(vertices, triangles)
    }

    fn done(vertices: Spool, triangles: Spool) -> Result<Self, Stop> {
        let (triangles, count) = triangles.finish()?;
        Ok(Self { vertices: vertices.into_vertices()?, triangles, count })
    }

    pub(super) fn for_each(&self, each: &mut Each<'_>) -> Result<(), Stop> {
        let mut pages = Pages::new(&self.vertices, PAGES);
        let mut stream = Stream::new(&self.triangles, 0);
        for face in 0..self.count {
            let record: [u8; 12] = stream.take()?;
            let mut t = [[0.0; 3]; 3];
            for (out, at) in t.iter_mut().zip(record.as_chunks::<4>().0) {
                *out = pages.get(u32::from_le_bytes(*at).into(), face)?;
            }
            if !t.iter().flatten().all(|c| c.is_finite()) {
                return Err(MeshFault::NotFinite { triangle: face + 1 }.into());
            }
            each(&t)?;
        }
        Ok(())
    }
}

/// The vertex of a corner `7`, `7/1`, `7//3` or `-1`, counted from 0.
#[inline]
fn obj_index(words: &Words<'_>, vertices: u64, face: u64) -> Result<u32, Stop> {
    let word = words.word();
    let end = word.iter().position(|b| *b == b'/').unwrap_or(word.len());
    let (negative, digits) = match word[..end].split_first() {
        Some((b'-', rest)) => (true, rest),
        _ => (false, &word[..end]),
    };
    if digits.is_empty() || digits.len() > 18 || !digits.iter().all(u8::is_ascii_digit) {
        return Err(words.wrong());
    }
    let value = digits.iter().fold(0, |n, d| 10 * n + i64::from(d - b'0'));
    let at = if negative { i64::try_from(vertices).unwrap_or(i64::MAX) - value } else { value - 1 };
    index(words, vertices, face, at)
}
