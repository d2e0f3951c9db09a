//! OFF, and its common parts with other text formats: vertices and triangles wait in scratch files.

use std::fs::File;
use std::path::Path;

use super::stop::{Each, EachLook, EachOf, Stop, finite};
use super::stream::{Stream, Token, Words, numbers};
use super::vertex_looks::VertexLooks;
use super::vertices::{PAGES, Pages, Spool, Vertices};
use crate::mesh::read::stop::{bad_index, count_lies};

/// Vertices, and triangles that name them.
#[derive(Debug)]
pub(super) struct Faces {
    vertices: Vertices,
    triangles: File,
    count: u64,
    looks: VertexLooks,
}

/// Triangles that fan out from the first vertex of a face, or of which each shares an edge with the next.
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

/// Does it begin as an OFF file?
pub(super) fn is_off(head: &[u8]) -> bool {
    let word = head.split(u8::is_ascii_whitespace).next().unwrap_or_default();
    [&b"OFF"[..], b"COFF", b"NOFF", b"CNOFF", b"STOFF"].contains(&word)
}

/// A vertex by its number from 0.
pub(super) fn index(vertices: u64, face: u64, at: i64) -> Result<u32, Stop> {
    let bad = || Stop::from(bad_index(face + 1, vertices));
    u32::try_from(at).map_err(|_| bad())
}

impl Faces {
    /// Reads an OFF file, with or without colours behind its vertices and faces.
    pub(super) fn off(file: &File, bytes: u64, scratch: &Path) -> Result<Self, Stop> {
        let mut words = Words::new(file, 0, 1);
        words.must_anywhere()?;
        let mut counts = [0; 3];
        for count in &mut counts {
            words.must_anywhere()?;
            *count = u64::try_from(words.as_whole()?).map_err(|_| words.wrong())?;
        }
        let [vertex_count, face_count, _] = counts;
        // A vertex takes six bytes at least, a face two.
        if vertex_count > bytes / 6 + 1 || face_count > bytes / 2 || vertex_count > u64::from(u32::MAX) {
            return Err(count_lies(vertex_count.max(face_count), bytes / 6).into());
        }
        let (mut vertices, mut triangles) = (Spool::new(scratch), Spool::new(scratch));
        for _ in 0..vertex_count {
            words.must_anywhere()?;
            let x = words.as_number()?;
            vertices.vertex([x, words.number()?, words.number()?])?;
            words.skip_line()?;
        }
        for face in 0..face_count {
            words.must_anywhere()?;
            let (line, corners) = (words.line(), words.as_whole()?);
            if corners < 0 {
                return Err(words.wrong());
            }
            let mut fan = Fan::new();
            for _ in 0..corners {
                words.must_anywhere()?;
                let at = index(vertex_count, face, words.as_whole()?)?;
                if let Some(t) = fan.next(at) {
                    triangles.numbers(t)?;
                }
            }
            if words.line() == line {
                words.skip_line()?;
            } else if words.next()? == Token::Word {
                // Colours stand behind faces of one line: the first line was short.
                return Err(Words::wrong_at(line));
            }
        }
        Self::of(vertices, triangles, VertexLooks::default())
    }

    /// Vertices and triangles that were written, and what vertices carry.
    pub(super) fn of(vertices: Spool, triangles: Spool, looks: VertexLooks) -> Result<Self, Stop> {
        let (triangles, count) = triangles.finish()?;
        Ok(Self { vertices: vertices.into_vertices()?, triangles, count, looks })
    }

    pub(super) fn looks(&self) -> &VertexLooks {
        &self.looks
    }

    /// Calls `each` with every triangle and what its vertices carry.
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

    /// Calls `each` with what is made of the vertices of every triangle, and its number, counted from 1.
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
