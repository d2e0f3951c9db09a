//! PLY: a header of text, then elements in binary of either order or in text.

use std::fs::File;
use std::path::Path;

use super::stop::{Each, Stop};
use super::stream::{Stream, Token, Words};
use super::text::{Faces, Fan};
use super::vertices::{MOST_RECORD, Number, PAGES, Pages, Spool, Vertices};
use crate::facts::MeshFault;

/// Longest header, in bytes.
const MOST_HEADER: u64 = 64 << 10;

/// An open PLY file.
#[derive(Debug)]
pub(super) enum Ply {
    /// Faces are read from the file itself.
    Binary(Binary),
    Text(Faces),
}

#[derive(Debug)]
pub(super) struct Binary {
    vertices: Vertices,
    /// Where faces begin, how many there are, and what each holds.
    offset: u64,
    faces: u64,
    properties: Vec<Property>,
    /// Which property names vertices.
    corners: usize,
    file: File,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    Text,
    Little,
    Big,
}

#[derive(Debug)]
struct Element {
    kind: Kind,
    count: u64,
    properties: Vec<Property>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Vertex,
    Face,
    Other,
}

#[derive(Clone, Copy, Debug)]
struct Property {
    name: Name,
    /// Number of a list's items; `None` for a single value.
    length: Option<Number>,
    value: Number,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Name {
    X,
    Y,
    Z,
    Corners,
    Other,
}

impl Element {
    /// Bytes of one, if all are equally long.
    fn record(&self) -> Option<u64> {
        self.properties.iter().map(|p| p.length.is_none().then(|| p.value.bytes())).sum()
    }

    /// Fewest bytes of one.
    fn least(&self) -> u64 {
        self.properties.iter().map(|p| p.length.unwrap_or(p.value).bytes()).sum()
    }
}

fn number(word: &[u8]) -> Option<Number> {
    Some(match word {
        b"char" | b"int8" => Number::I8,
        b"uchar" | b"uint8" => Number::U8,
        b"short" | b"int16" => Number::I16,
        b"ushort" | b"uint16" => Number::U16,
        b"int" | b"int32" => Number::I32,
        b"uint" | b"uint32" => Number::U32,
        b"float" | b"float32" => Number::F32,
        b"double" | b"float64" => Number::F64,
        _ => return None,
    })
}

/// What a header says, and where it ends.
struct Header {
    form: Form,
    elements: Vec<Element>,
    end: u64,
}

impl Header {
    fn read(file: &File) -> Result<Self, Stop> {
        let mut words = Words::new(file, 0);
        words.skip_line()?;
        let (mut form, mut elements) = (None, Vec::<Element>::new());
        let mut line = 1_u64;
        loop {
            line += 1;
            let wrong = || Stop::from(MeshFault::BadHeader { line });
            if words.offset() > MOST_HEADER {
                return Err(wrong());
            }
            match words.next()? {
                Token::Word => {}
                Token::LineEnd => continue,
                Token::End => return Err(MeshFault::CutShort.into()),
            }
            match words.word() {
                b"format" => {
                    words.must()?;
                    form = match words.word() {
                        b"ascii" => Some(Form::Text),
                        b"binary_little_endian" => Some(Form::Little),
                        b"binary_big_endian" => Some(Form::Big),
                        _ => return Err(wrong()),
                    };
                }
                b"element" => {
                    words.must()?;
                    let kind = match words.word() {
                        b"vertex" => Kind::Vertex,
                        b"face" => Kind::Face,
                        _ => Kind::Other,
                    };
                    words.must()?;
                    let digits = std::str::from_utf8(words.word()).map_err(|_| wrong())?;
                    let count = digits.parse().map_err(|_| wrong())?;
                    elements.push(Element { kind, count, properties: Vec::new() });
                }
                b"property" => {
                    let element = elements.last_mut().ok_or_else(wrong)?;
                    words.must()?;
                    let (length, value) = if words.word() == b"list" {
                        words.must()?;
                        let length = number(words.word()).ok_or_else(wrong)?;
                        words.must()?;
                        if matches!(length, Number::F32 | Number::F64) {
                            return Err(wrong());
                        }
                        (Some(length), number(words.word()).ok_or_else(wrong)?)
                    } else {
                        (None, number(words.word()).ok_or_else(wrong)?)
                    };
                    words.must()?;
                    let name = match words.word() {
                        b"x" => Name::X,
                        b"y" => Name::Y,
                        b"z" => Name::Z,
                        b"vertex_indices" | b"vertex_index" => Name::Corners,
                        _ => Name::Other,
                    };
                    element.properties.push(Property { name, length, value });
                }
                b"end_header" => {
                    words.skip_line()?;
                    let form = form.ok_or_else(wrong)?;
                    return Ok(Self { form, elements, end: words.offset() });
                }
                b"comment" | b"obj_info" => {}
                _ => return Err(wrong()),
            }
            words.skip_line()?;
        }
    }
}

/// Looks at the header alone.
pub(super) fn check(file: File, bytes: u64) -> Result<(), Stop> {
    let header = Header::read(&file)?;
    match header.form {
        // Of text the header holds nothing that its length could contradict.
        Form::Text => Ok(()),
        form => Binary::open(file, bytes, header, form == Form::Big).map(drop),
    }
}

impl Ply {
    pub(super) fn open(file: File, bytes: u64, scratch: &Path) -> Result<Self, Stop> {
        let header = Header::read(&file)?;
        match header.form {
            Form::Text => read_text(&file, bytes, &header, scratch).map(Self::Text),
            form => Binary::open(file, bytes, header, form == Form::Big).map(Self::Binary),
        }
    }

    pub(super) fn for_each(&self, each: &mut Each<'_>) -> Result<(), Stop> {
        match self {
            Self::Binary(binary) => binary.for_each(each),
            Self::Text(faces) => faces.for_each(each),
        }
    }
}

/// Where x, y and z stand in a record of single values.
fn coordinates(element: &Element) -> Result<[(usize, Number); 3], Stop> {
    let mut fields = [None; 3];
    let mut at = 0;
    for property in &element.properties {
        let place = [Name::X, Name::Y, Name::Z].iter().position(|n| *n == property.name);
        if let (Some(place), None) = (place, property.length) {
            fields[place] = Some((at, property.value));
        }
        at += usize::try_from(property.value.bytes()).unwrap_or(0);
    }
    match fields {
        [Some(x), Some(y), Some(z)] => Ok([x, y, z]),
        _ => Err(MeshFault::NoCoordinates.into()),
    }
}

impl Binary {
    fn open(file: File, bytes: u64, header: Header, big: bool) -> Result<Self, Stop> {
        let mut at = header.end;
        let mut vertices = None;
        for element in header.elements {
            let left = bytes.saturating_sub(at);
            // Every element fits, or the file lies.
            let least = element.count.saturating_mul(element.least().max(1));
            if element.kind != Kind::Other && least > left {
                let held = left / element.least().max(1);
                return Err(MeshFault::CountLies { stated: element.count, held }.into());
            }
            match element.kind {
                Kind::Vertex => {
                    let fields = coordinates(&element)?;
                    let record = element.record().filter(|r| *r <= MOST_RECORD);
                    let record = record.ok_or(MeshFault::NoCoordinates)?;
                    let file = file.try_clone().map_err(Stop::Read)?;
                    let count = element.count;
                    vertices = Some(Vertices { file, offset: at, record, fields, big, count });
                }
                Kind::Face => {
                    let corners = element.properties.iter().position(|p| {
                        p.name == Name::Corners
                            && p.length.is_some()
                            && !matches!(p.value, Number::F32 | Number::F64)
                    });
                    let (Some(corners), Some(vertices)) = (corners, vertices) else {
                        return Err(MeshFault::NoFaces.into());
                    };
                    return Ok(Self {
                        vertices,
                        offset: at,
                        faces: element.count,
                        properties: element.properties,
                        corners,
                        file,
                    });
                }
                Kind::Other => {}
            }
            let record = element.record().ok_or(MeshFault::NoFaces)?;
            at = at.saturating_add(element.count.saturating_mul(record));
        }
        Err(MeshFault::NoFaces.into())
    }

    fn for_each(&self, each: &mut Each<'_>) -> Result<(), Stop> {
        let mut stream = Stream::new(&self.file, self.offset);
        let mut pages = Pages::new(&self.vertices, PAGES);
        let big = self.vertices.big;
        let mut triangles = 0;
        // Nearly all files: faces are lists of 32 bits with a count of 8, and nothing else.
        let usual = !big
            && matches!(self.properties[..], [Property { length: Some(n), value, .. }]
                if n.bytes() == 1 && value.bytes() == 4);
        for face in 0..self.faces {
            if usual && stream.peek()? == 3 {
                let record: [u8; 13] = stream.take()?;
                let mut t = [[0.0; 3]; 3];
                for (out, at) in t.iter_mut().zip(record[1..].as_chunks::<4>().0) {
                    *out = pages.get(u32::from_le_bytes(*at).into(), face)?;
                }
                triangles += 1;
                if !t.iter().flatten().all(|c| c.is_finite()) {
                    return Err(MeshFault::NotFinite { triangle: triangles }.into());
                }
                each(&t)?;
                continue;
            }
            for (at, property) in self.properties.iter().enumerate() {
                let Some(length) = property.length else {
                    stream.skip(property.value.bytes());
                    continue;
                };
                let count = whole(&mut stream, length, big)?;
                let count = u64::try_from(count)
                    .map_err(|_| MeshFault::BadIndex { face: face + 1, vertices: self.vertices.count })?;
                if at != self.corners {
                    stream.skip(property.value.bytes().saturating_mul(count));
                    continue;
                }
                let (mut first, mut last) = ([0.0; 3], [0.0; 3]);
                for corner in 0..count {
                    let index = whole(&mut stream, property.value, big)?;
                    let point = pages.get(u64::try_from(index).unwrap_or(u64::MAX), face)?;
                    if corner == 0 {
                        first = point;
                    } else if corner > 1 {
                        triangles += 1;
                        let t = [first, last, point];
                        if !t.iter().flatten().all(|c| c.is_finite()) {
                            return Err(MeshFault::NotFinite { triangle: triangles }.into());
                        }
                        each(&t)?;
                    }
                    last = point;
                }
            }
        }
        Ok(())
    }
}

/// The next whole number.
#[inline]
fn whole(stream: &mut Stream<'_>, number: Number, big: bool) -> Result<i64, Stop> {
    Ok(match number.bytes() {
        1 => {
            let [b] = stream.take()?;
            if number == Number::I8 { b.cast_signed().into() } else { b.into() }
        }
        2 => {
            let mut b: [u8; 2] = stream.take()?;
            if big {
                b.reverse();
            }
            if number == Number::I16 { i16::from_le_bytes(b).into() } else { u16::from_le_bytes(b).into() }
        }
        _ => {
            let mut b: [u8; 4] = stream.take()?;
            if big {
                b.reverse();
            }
            if number == Number::I32 { i32::from_le_bytes(b).into() } else { u32::from_le_bytes(b).into() }
        }
    })
}

fn read_text(file: &File, bytes: u64, header: &Header, scratch: &Path) -> Result<Faces, Stop> {
    let mut words = Words::new(file, header.end);
    let (mut vertices, mut triangles) = (Spool::new(scratch)?, Spool::new(scratch)?);
    let mut seen = false;
    for element in &header.elements {
        // Every value takes two bytes at least.
        let held = bytes / (2 * element.properties.len().max(1) as u64) + 1;
        if element.count > held {
            return Err(MeshFault::CountLies { stated: element.count, held }.into());
        }
        match element.kind {
            Kind::Vertex => {
                coordinates(element)?;
                seen = true;
            }
            Kind::Face => {
                let lists = |p: &Property| p.name == Name::Corners && p.length.is_some();
                if !seen || !element.properties.iter().any(lists) {
                    return Err(MeshFault::NoFaces.into());
                }
            }
            Kind::Other => {}
        }
        for at in 0..element.count {
            let mut point = [0.0; 3];
            for property in &element.properties {
                words.must_anywhere()?;
                if property.length.is_none() {
                    if element.kind == Kind::Vertex {
                        let value = words.as_number()?;
                        match property.name {
                            Name::X => point[0] = value,
                            Name::Y => point[1] = value,
                            Name::Z => point[2] = value,
                            _ => {}
                        }
                    }
                    continue;
                }
                let count = words.as_whole()?;
                let mut fan = Fan::new();
                for _ in 0..count {
                    words.must_anywhere()?;
                    if element.kind != Kind::Face || property.name != Name::Corners {
                        continue;
                    }
                    let index = u32::try_from(words.as_whole()?)
                        .map_err(|_| MeshFault::BadIndex { face: at + 1, vertices: vertices.count })?;
                    if let Some(t) = fan.next(index) {
                        triangles.triangle(t)?;
                    }
                }
            }
            if element.kind == Kind::Vertex {
                vertices.vertex(point)?;
            }
        }
        if element.kind == Kind::Face {
            return Faces::of(vertices, triangles);
        }
    }
    Err(MeshFault::NoFaces.into())
}
