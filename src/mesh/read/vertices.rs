//! Vertices by number: looked up where they are stored, through a small cache of pages.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use super::stop::Stop;
use crate::facts::MeshFault;
use crate::platform::FileExt;

/// Vertices of a page, and pages that are held; a prime number, so that runs of pages at even distances do not
/// fall upon each other.
const PAGE: u64 = 128;
pub(super) const PAGES: u64 = 61;
/// Pages of colours, normals and places.
pub(super) const FEW_PAGES: u64 = 17;
pub(super) const MAX_RECORD: u64 = 256;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    pub(super) fn bytes(self) -> u64 {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in the first of these bytes, the lowest byte first unless `big`.
    #[inline]
    pub(super) fn read(self, bytes: &[u8], big: bool) -> f64 {
        let n = usize::try_from(self.bytes()).unwrap_or(8);
        let mut raw = [0; 8];
        for (i, out) in raw.iter_mut().enumerate().take(n) {
            *out = bytes.get(if big { n - 1 - i } else { i }).copied().unwrap_or(0);
        }
        let [a, b, c, d, ..] = raw;
        match self {
            Self::I8 => f64::from(a.cast_signed()),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(raw),
        }
    }
}

/// Where vertices are stored: records of one length, with x, y and z somewhere in each.
#[derive(Debug)]
pub(super) struct Vertices {
    pub(super) file: File,
    pub(super) offset: u64,
    pub(super) record: u64,
    pub(super) fields: [(usize, Number); 3],
    pub(super) big: bool,
    pub(super) count: u64,
}

/// Vertices of text formats on their way into a scratch file.
pub(super) struct Spool {
    file: File,
    buffer: Vec<u8>,
    pub(super) count: u64,
}

impl Spool {
    /// Bytes written at a time.
    const BUFFER: usize = 32 << 10;

    pub(super) fn new(folder: &Path) -> Result<Self, Stop> {
        let file = crate::scratch::unnamed(folder).map_err(Stop::Scratch)?;
        Ok(Self { file, buffer: Vec::with_capacity(Self::BUFFER), count: 0 })
    }

    #[inline]
    fn put(&mut self, record: &[u8]) -> Result<(), Stop> {
        if self.buffer.len() + record.len() > Self::BUFFER {
            self.flush().map_err(Stop::Scratch)?;
        }
        self.buffer.extend_from_slice(record);
        self.count += 1;
        Ok(())
    }

    #[inline]
    pub(super) fn vertex(&mut self, v: [f64; 3]) -> Result<(), Stop> {
        self.put(v.map(f64::to_le_bytes).as_flattened())
    }

    /// Appends a triangle, or the numbers that it carries.
    #[inline]
    pub(super) fn numbers<const N: usize>(&mut self, record: [u32; N]) -> Result<(), Stop> {
        self.put(record.map(u32::to_le_bytes).as_flattened())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.write_all(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }

    /// The file and its number of records.
    pub(super) fn finish(mut self) -> Result<(File, u64), Stop> {
        self.flush().map_err(Stop::Scratch)?;
        Ok((self.file, self.count))
    }

    pub(super) fn into_vertices(self) -> Result<Vertices, Stop> {
        let (file, count) = self.finish()?;
        let fields = [(0, Number::F64), (8, Number::F64), (16, Number::F64)];
        Ok(Vertices { file, offset: 0, record: 24, fields, big: false, count })
    }
}

/// A cache of pages of vertices, or of what is made of each as it is read.
pub(super) struct Pages<'a, P = [f64; 3]> {
    vertices: &'a Vertices,
    make: &'a dyn Fn([f64; 3]) -> P,
    places: u64,
    /// Page in each place; a number beyond any for none.
    held: Vec<u64>,
    points: Vec<P>,
    bytes: Vec<u8>,
}

impl<'a> Pages<'a> {
    /// With so many pages: a prime number.
    pub(super) fn new(vertices: &'a Vertices, pages: u64) -> Self {
        Self::of(vertices, pages, &|p| p)
    }
}

impl<'a, P: Copy> Pages<'a, P> {
    /// With so many pages, of values made of vertices.
    pub(super) fn of(vertices: &'a Vertices, pages: u64, make: &'a dyn Fn([f64; 3]) -> P) -> Self {
        let places = usize::try_from(pages).unwrap_or(1);
        let page = usize::try_from(PAGE).unwrap_or(1);
        Self {
            vertices,
            make,
            places: pages,
            held: vec![u64::MAX; places],
            points: vec![make([0.0; 3]); places * page],
            bytes: Vec::new(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.vertices.count == 0
    }

    /// Vertex `at` of face `face`, which is counted from 0.
    #[inline]
    pub(super) fn get(&mut self, at: u64, face: u64) -> Result<P, Stop> {
        if at >= self.vertices.count {
            return Err(MeshFault::BadIndex { face: face + 1, vertices: self.vertices.count }.into());
        }
        let page = at / PAGE;
        // By a number that is known division is a product.
        let place = if self.places == PAGES { page % PAGES } else { page % self.places };
        #[expect(clippy::cast_possible_truncation, reason = "places in memory")]
        let (place, within) = (place as usize, (at % PAGE) as usize);
        if self.held[place] != page {
            self.load(page, place)?;
        }
        #[expect(clippy::cast_possible_truncation, reason = "places in memory")]
        let point = self.points[place * PAGE as usize + within];
        Ok(point)
    }

    #[cold]
    fn load(&mut self, page: u64, place: usize) -> Result<(), Stop> {
        let v = self.vertices;
        let count = (v.count - page * PAGE).min(PAGE);
        let record = usize::try_from(v.record).unwrap_or(usize::MAX).max(1);
        // Nothing needs to stand behind the last number of the last vertex.
        let last = v.fields.iter().map(|(at, number)| *at as u64 + number.bytes()).max().unwrap_or(0);
        let bytes = count.saturating_sub(1) * v.record + last.min(v.record);
        self.bytes.resize(usize::try_from(bytes).unwrap_or(0), 0);
        v.file.read_exact_at(&mut self.bytes, v.offset + page * PAGE * v.record).map_err(Stop::reading)?;
        let first = place * usize::try_from(PAGE).unwrap_or(0);
        let simple = !v.big && v.fields.iter().all(|f| f.1 == Number::F32);
        for (out, bytes) in self.points[first..].iter_mut().zip(self.bytes.chunks(record)) {
            *out = (self.make)(if simple {
                v.fields.map(|(at, _)| {
                    bytes[at..].first_chunk::<4>().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(*b)))
                })
            } else {
                v.fields.map(|(at, number)| number.read(bytes.get(at..).unwrap_or_default(), v.big))
            });
        }
        self.held[place] = page;
        Ok(())
    }
}
