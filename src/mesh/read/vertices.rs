//! Vertices by number: looked up where they are stored, through a small cache of pages.

use std::path::Path;

use super::stop::Stop;
use crate::mesh::read::stop::bad_index;
use crate::platform::PositionalFile;
use crate::scratch::{Appended, PageCache};

/// Vertices of a page, and pages that are held; a prime number, so that runs of pages at even distances do not
/// fall upon each other.
const PAGE: u64 = 128;
pub(super) const PAGES: u64 = 61;
/// Number of pages of colours, normals and places.
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

/// Location of stored vertices: records of one length, with x, y and z somewhere in each.
#[derive(Debug)]
pub(super) struct Vertices {
    pub(super) file: PositionalFile,
    pub(super) offset: u64,
    pub(super) record: u64,
    pub(super) fields: [(usize, Number); 3],
    pub(super) big: bool,
    pub(super) count: u64,
}

/// Vertices of text formats on their way into a scratch file.
pub(super) struct Spool {
    records: Appended,
    pub(super) count: u64,
}

impl Spool {
    /// Bytes written at a time.
    const BUFFER: usize = 32 << 10;

    pub(super) fn new(folder: &Path) -> Self {
        Self { records: Appended::new(folder, Self::BUFFER), count: 0 }
    }

    #[inline]
    fn put(&mut self, record: &[u8]) -> Result<(), Stop> {
        self.records.push(record).map_err(Stop::Scratch)?;
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

    /// The file and its number of records.
    pub(super) fn finish(self) -> Result<(PositionalFile, u64), Stop> {
        Ok((self.records.into_file().map_err(Stop::Scratch)?.into(), self.count))
    }

    pub(super) fn into_vertices(self) -> Result<Vertices, Stop> {
        let (file, count) = self.finish()?;
        let fields = [(0, Number::F64), (8, Number::F64), (16, Number::F64)];
        Ok(Vertices { file, offset: 0, record: 24, fields, big: false, count })
    }
}

/// A cache of pages of vertices, or of values made of each as it is read.
pub(super) struct Pages<'a, P = [f64; 3]> {
    vertices: &'a Vertices,
    make: &'a dyn Fn([f64; 3]) -> P,
    places: u64,
    cache: PageCache<u64, P>,
    bytes: Vec<u8>,
}

impl<'a> Pages<'a> {
    /// A cache with this number of pages, a prime number.
    pub(super) fn new(vertices: &'a Vertices, pages: u64) -> Self {
        Self::of(vertices, pages, &|p| p)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "places in memory")]
impl<'a, P: Copy> Pages<'a, P> {
    /// A cache with this number of pages, of values made of vertices.
    pub(super) fn of(vertices: &'a Vertices, pages: u64, make: &'a dyn Fn([f64; 3]) -> P) -> Self {
        let cache = PageCache::new(pages as usize, PAGE as usize, make([0.0; 3]));
        Self { vertices, make, places: pages, cache, bytes: Vec::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.vertices.count == 0
    }

    /// Vertex `at` of face `face`, which is counted from 0.
    #[inline]
    pub(super) fn get(&mut self, at: u64, face: u64) -> Result<P, Stop> {
        let Self { vertices, make, places, cache, bytes } = self;
        if at >= vertices.count {
            return Err(bad_index(face + 1, vertices.count).into());
        }
        let page = at / PAGE;
        // A division by a constant is a product.
        let place = if *places == PAGES { page % PAGES } else { page % *places };
        let points = cache.get(place as usize, page, |points| vertices.load(page, bytes, points, *make))?;
        Ok(points[(at % PAGE) as usize])
    }
}

impl Vertices {
    /// Reads a page, and makes a point of each of its vertices.
    #[cold]
    fn load<P>(
        &self,
        page: u64,
        bytes: &mut Vec<u8>,
        points: &mut [P],
        make: &dyn Fn([f64; 3]) -> P,
    ) -> Result<(), Stop> {
        let count = (self.count - page * PAGE).min(PAGE);
        let record = usize::try_from(self.record).unwrap_or(usize::MAX).max(1);
        // The last vertex may end with its last number.
        let last = self.fields.iter().map(|(at, number)| *at as u64 + number.bytes()).max().unwrap_or(0);
        let length = count.saturating_sub(1) * self.record + last.min(self.record);
        bytes.resize(usize::try_from(length).unwrap_or(0), 0);
        self.file.read_exact_at(bytes, self.offset + page * PAGE * self.record).map_err(Stop::reading)?;
        let simple = !self.big && self.fields.iter().all(|f| f.1 == Number::F32);
        for (out, bytes) in points.iter_mut().zip(bytes.chunks(record)) {
            *out = make(if simple {
                self.fields.map(|(at, _)| {
                    bytes[at..].first_chunk::<4>().map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(*b)))
                })
            } else {
                self.fields.map(|(at, number)| number.read(bytes.get(at..).unwrap_or_default(), self.big))
            });
        }
        Ok(())
    }
}
