//! PLY: a header of text, then elements in binary of either order or in text.
//!
//! Colours are taken from vertices; where these have none, from faces.

use std::sync::OnceLock;

use super::Limits;
use super::polygon;
use super::stop::{Each, EachLook, EachOf, Stop, finite};
use super::stream::{Stream, Token, Words, head, mark};
use super::text::{Faces, Fan, Polygons, more_than};
use super::vertex_looks::{VertexLooks, scaled};
use super::vertices::{FEW_PAGES, MAX_RECORD, Number, PAGES, Pages, Spool, Vertices};
use crate::fault::bad;
use crate::mesh::read::stop::{
    bad_index, count_lies, cut_short, no_coordinates, no_faces, only_points, unknown_format,
};
use crate::platform::PositionalFile;
use crate::text::{plain_head, shown};

const MAX_HEADER: u64 = 64 << 10;

#[derive(Debug)]
pub(super) enum Ply {
    /// Faces are read from the file itself.
    Binary(Binary),
    /// Text, and binary files of an unusual order of elements or with unusual lists.
    Written(Faces),
}

#[derive(Debug)]
pub(super) struct Binary {
    vertices: Vertices,
    looks: VertexLooks,
    /// Offset of the faces, their number, and the properties of each.
    offset: u64,
    faces: u64,
    kind: Kind,
    properties: Vec<Property>,
    /// Index of the property that names vertices.
    corners: usize,
    /// Factor that brings colours of faces to 0 to 1, where vertices have none.
    face_colors: Option<f64>,
    file: PositionalFile,
    /// Length of the file, if the faces are its last element.
    ends: Option<u64>,
    /// True if at least as many bytes as a triangle takes follow the last face; known once the faces have been read.
    has_more: OnceLock<bool>,
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
    /// Triangles that share edges; -1 begins another strip.
    Strips,
    Other,
}

impl Kind {
    fn has_corners(self) -> bool {
        matches!(self, Self::Face | Self::Strips)
    }

    fn fan<V: Copy>(self) -> Fan<V> {
        if self == Self::Strips { Fan::strip() } else { Fan::new() }
    }
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
    Red,
    Green,
    Blue,
    Packed,
    NormalX,
    NormalY,
    NormalZ,
    Other,
}

impl Property {
    /// True for the list of a face's vertices.
    fn is_corners(&self) -> bool {
        let whole = !matches!(self.value, Number::F32 | Number::F64);
        self.name == Name::Corners && self.length.is_some() && whole
    }
}

impl Name {
    /// Puts the value of a property of this name in its place, if it is one of three.
    fn put(self, value: f64, names: [Self; 3], values: &mut [f64; 3]) {
        if let Some(at) = names.iter().position(|name| *name == self) {
            values[at] = value;
        }
    }
}

const PLACE: [Name; 3] = [Name::X, Name::Y, Name::Z];
const COLOR: [Name; 3] = [Name::Red, Name::Green, Name::Blue];
const NORMAL: [Name; 3] = [Name::NormalX, Name::NormalY, Name::NormalZ];

impl Element {
    /// Bytes of an element, if all are equally long.
    fn record(&self) -> Option<u64> {
        self.properties.iter().map(|p| p.length.is_none().then(|| p.value.bytes())).sum()
    }

    /// Fewest bytes of an element.
    fn least(&self) -> u64 {
        least(&self.properties)
    }
}

fn least(properties: &[Property]) -> u64 {
    properties.iter().map(|p| p.length.unwrap_or(p.value).bytes()).sum()
}

/// True if at least as many bytes as a triangle takes follow a place in a file.
fn holds_more(properties: &[Property], bytes: u64, at: u64) -> bool {
    let corners = properties.iter().find(|p| p.is_corners()).map_or(0, |p| 3 * p.value.bytes());
    bytes.saturating_sub(at) >= least(properties) + corners
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

/// A header, and the offset of its end.
struct Header {
    form: Form,
    elements: Vec<Element>,
    end: u64,
    /// Number of the line behind it; true if lines end in CR alone.
    line: u64,
    cr_alone: bool,
    /// Name of a texture.
    texture: Option<String>,
}

impl Header {
    /// Most elements of a kind that `bytes` bytes may hold.
    fn held(&self, element: &Element, bytes: u64) -> u64 {
        let of_text = 2 * element.properties.len() as u64;
        bytes / if self.form == Form::Text { of_text } else { element.least() }.max(1) + 1
    }

    /// The numbers of the elements that hold vertices and faces.
    fn used(&self, bytes: u64) -> Result<[usize; 2], Stop> {
        let vertex = self.elements.iter().position(|e| e.kind == Kind::Vertex).ok_or_else(no_coordinates)?;
        coordinates(&self.elements[vertex].properties)?;
        let (count, held) = (self.elements[vertex].count, self.held(&self.elements[vertex], bytes));
        if count > held {
            return Err(count_lies(count, held).into());
        }
        let faces = |e: &&Element| e.kind.has_corners() && e.count > 0;
        if !self.elements.iter().any(|e| faces(&e)) {
            return Err(only_points().into());
        }
        let lists = |e: &Element| faces(&e) && e.properties.iter().any(Property::is_corners);
        Ok([vertex, self.elements.iter().position(lists).ok_or_else(no_faces)?])
    }

    /// True where faces can be read from the file itself: all that comes before them has records of one length.
    fn is_usual(&self, [vertex, face]: [usize; 2]) -> bool {
        let fixed = || self.elements.iter().take(face).all(|e| e.record().is_some());
        let small = self.elements[vertex].record().is_some_and(|bytes| bytes <= MAX_RECORD);
        self.form != Form::Text && vertex < face && small && fixed()
    }

    fn read(file: &PositionalFile) -> Result<Self, Stop> {
        let mut words = Words::begin(file)?;
        let head = head(file).map_err(Stop::Read)?;
        if !is_ply(&plain_head(&head)) {
            return Err(unknown_format().into());
        }
        let end = head.get(mark(&head)? + 3..).and_then(|rest| rest.get(..2));
        let cr_alone = end.is_some_and(|end| end[0] == b'\r' && end[1] != b'\n');
        words.cr_alone = cr_alone;
        words.skip_line()?;
        let (mut form, mut elements, mut texture) = (None, Vec::<Element>::new(), None);
        let mut line = 1_u64;
        loop {
            line += 1;
            let wrong = || Stop::from(bad!("line {line} of its header cannot be understood"));
            if words.offset() > MAX_HEADER {
                return Err(wrong());
            }
            match words.next()? {
                Token::Word => {}
                Token::LineEnd => continue,
                Token::End => return Err(cut_short().into()),
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
                        b"tristrips" => Kind::Strips,
                        _ => Kind::Other,
                    };
                    words.must()?;
                    let digits = std::str::from_utf8(words.word()).ok();
                    let count = digits.and_then(|digits| digits.parse().ok()).ok_or_else(|| words.wrong())?;
                    elements.push(Element { kind, count, properties: Vec::new() });
                    words.end_of_line("its element")?;
                    continue;
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
                        b"red" | b"Red" | b"diffuse_red" | b"vertex_red" | b"r" => Name::Red,
                        b"green" | b"Green" | b"diffuse_green" | b"vertex_green" | b"g" => Name::Green,
                        b"blue" | b"Blue" | b"diffuse_blue" | b"vertex_blue" | b"b" => Name::Blue,
                        b"rgb" | b"rgba" => Name::Packed,
                        b"nx" => Name::NormalX,
                        b"ny" => Name::NormalY,
                        b"nz" => Name::NormalZ,
                        b"vertex_indices" | b"vertex_index" => Name::Corners,
                        _ => Name::Other,
                    };
                    if PLACE.contains(&name) && element.properties.iter().any(|before| before.name == name) {
                        return Err(wrong());
                    }
                    element.properties.push(Property { name, length, value });
                }
                b"end_header" => {
                    words.skip_line()?;
                    let form = form.ok_or_else(wrong)?;
                    let (end, line) = (words.offset(), words.line());
                    return Ok(Self { form, elements, end, line, cr_alone, texture });
                }
                b"comment" => {
                    if words.next()? != Token::Word {
                        continue;
                    }
                    if words.is("TextureFile") {
                        texture = Some(words.rest_of_line(1024)?);
                    }
                }
                b"obj_info" => {}
                _ => return Err(wrong()),
            }
            words.skip_line()?;
        }
    }
}

/// True if it begins as a PLY file.
pub(super) fn is_ply(head: &[u8]) -> bool {
    head.strip_prefix(b"ply").is_some_and(|rest| rest.first().is_some_and(u8::is_ascii_whitespace))
}

/// Looks at the header alone.
pub(super) fn check(file: PositionalFile, bytes: u64) -> Result<(), Stop> {
    let header = Header::read(&file)?;
    let used = header.used(bytes)?;
    // The length of a text contradicts nothing in its header.
    if header.is_usual(used) { Binary::open(file, bytes, header, used).map(drop) } else { Ok(()) }
}

impl Ply {
    /// A file, and notes on parts that are left out.
    pub(super) fn open(
        file: PositionalFile,
        bytes: u64,
        limits: &Limits<'_>,
    ) -> Result<(Self, Vec<String>), Stop> {
        let mut header = Header::read(&file)?;
        let texture = header.texture.take().filter(|_| limits.colors);
        let mut lacks: Vec<String> = texture.map(|name| format!("takes colours from the texture {}, which is not read from PLY; the model lacks them: write it as OBJ or glTF", shown(&name))).into_iter().collect();
        let used = header.used(bytes)?;
        let packed = |p: &[Property]| p.iter().any(|p| p.name == Name::Packed) && fields(p, COLOR).is_none();
        if limits.colors && used.iter().any(|at| packed(&header.elements[*at].properties)) {
            lacks.push("has colours in one number (rgba), which are not read; the model lacks them: write them as red, green and blue".to_owned());
        }
        let open = if header.is_usual(used) {
            let mut binary = Binary::open(file, bytes, header, used)?;
            binary.face_colors = binary.face_colors.filter(|_| limits.colors);
            Self::Binary(binary)
        } else {
            let (faces, has_more) = write_out(&file, bytes, &header, used, *limits)?;
            lacks.extend(has_more.then(|| more_than(header.elements[used[1]].count)));
            Self::Written(faces)
        };
        Ok((open, lacks))
    }

    /// The note on what follows the last face of a binary file; known once the faces have been read.
    pub(super) fn lack(&self) -> Option<String> {
        let Self::Binary(binary) = self else { return None };
        binary.has_more.get().is_some_and(|has_more| *has_more).then(|| more_than(binary.faces))
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
        match self {
            Self::Binary(binary) => binary.for_each_of(make, each),
            Self::Written(faces) => faces.for_each_of(make, each),
        }
    }

    /// True if vertices or faces have colours; true if vertices have normals.
    pub(super) fn has_looks(&self) -> [bool; 2] {
        let (looks, of_faces) = match self {
            Self::Binary(binary) => (&binary.looks, binary.face_colors.is_some()),
            Self::Written(faces) => (faces.looks(), faces.looks().of_triangles.is_some()),
        };
        [of_faces || looks.colors.is_some(), looks.normals.is_some()]
    }

    /// Calls `each` with every triangle and its look.
    pub(super) fn for_each_look(&self, each: &mut EachLook<'_>) -> Result<(), Stop> {
        match self {
            Self::Binary(binary) => binary.for_each_look(each),
            Self::Written(faces) => faces.for_each_look(each),
        }
    }
}

/// Offsets of three values of these names in a record of single values.
fn fields(properties: &[Property], names: [Name; 3]) -> Option<[(usize, Number); 3]> {
    let mut fields = [None; 3];
    let mut at = 0;
    for property in properties {
        let place = names.iter().position(|n| *n == property.name);
        if let (Some(place), None) = (place, property.length) {
            fields[place] = Some((at, property.value));
        }
        at += usize::try_from(property.value.bytes()).unwrap_or(0);
    }
    match fields {
        [Some(x), Some(y), Some(z)] => Some([x, y, z]),
        _ => None,
    }
}

/// Offsets of x, y and z.
fn coordinates(properties: &[Property]) -> Result<[(usize, Number); 3], Stop> {
    Ok(fields(properties, PLACE).ok_or_else(no_coordinates)?)
}

/// Factor that brings stored colours to 0 to 1.
fn color_scale([(_, number), ..]: [(usize, Number); 3]) -> f64 {
    match number {
        Number::I8 | Number::U8 => 1.0 / 255.0,
        Number::I16 | Number::U16 => 1.0 / 65_535.0,
        _ => 1.0,
    }
}

impl Binary {
    fn open(
        file: PositionalFile,
        bytes: u64,
        header: Header,
        [vertex, face]: [usize; 2],
    ) -> Result<Self, Stop> {
        let big = header.form == Form::Big;
        let mut elements = header.elements;
        let mut starts = vec![header.end];
        for (number, element) in elements.iter().take(face + 1).enumerate() {
            let at = starts[number];
            // Every element fits, or the file lies.
            let least = element.least().max(1);
            let held = bytes.saturating_sub(at) / least;
            if element.count > held && (number == vertex || number == face) {
                return Err(count_lies(element.count, held).into());
            }
            // The last one's record does not matter.
            starts.push(at.saturating_add(element.count.saturating_mul(element.record().unwrap_or(0))));
        }
        let of = |fields| -> Result<Vertices, Stop> {
            let file = file.try_clone().map_err(Stop::Read)?;
            let record = elements[vertex].record().ok_or_else(no_coordinates)?;
            Ok(Vertices { file, offset: starts[vertex], record, fields, big, count: elements[vertex].count })
        };
        let vertices = of(coordinates(&elements[vertex].properties)?)?;
        let colors =
            fields(&elements[vertex].properties, COLOR).map(|at| Ok::<_, Stop>((of(at)?, color_scale(at))));
        let normals = fields(&elements[vertex].properties, NORMAL).map(of).transpose()?;
        let looks = VertexLooks { colors: colors.transpose()?, normals, ..VertexLooks::default() };
        let ends = Some(bytes).filter(|_| face + 1 == elements.len());
        let Element { kind, count: faces, properties } = elements.swap_remove(face);
        let corners = properties.iter().position(Property::is_corners).ok_or_else(no_faces)?;
        let of_faces = looks.colors.is_none() && kind == Kind::Face;
        let face_colors = fields(&properties, COLOR).filter(|_| of_faces).map(color_scale);
        Ok(Self {
            vertices,
            looks,
            offset: starts[face],
            faces,
            kind,
            properties,
            corners,
            face_colors,
            file,
            ends,
            has_more: OnceLock::new(),
        })
    }

    fn for_each_of<P: Copy>(
        &self,
        make: &dyn Fn([f64; 3]) -> P,
        each: &mut EachOf<'_, P>,
    ) -> Result<(), Stop> {
        let mut stream = Stream::new(&self.file, self.offset);
        let mut pages = Pages::of(&self.vertices, PAGES, make);
        let mut plain = None;
        let mut triangles = 0;
        // Nearly all files: faces are lists of 32 bits with a count of 8, and nothing else.
        let usual = !self.vertices.big
            && self.kind == Kind::Face
            && matches!(self.properties[..], [Property { length: Some(n), value, .. }]
                if n.bytes() == 1 && value.bytes() == 4);
        for face in 0..self.faces {
            if usual && stream.peek()? == 3 {
                let [_, corners @ ..]: [u8; 13] = stream.take()?;
                let [a, b, c, d, e, f, g, h, i, j, k, l] = corners;
                let mut corner = |at: [u8; 4]| pages.get(u32::from_le_bytes(at).into(), face);
                let t = [corner([a, b, c, d])?, corner([e, f, g, h])?, corner([i, j, k, l])?];
                triangles += 1;
                each(&t, triangles)?;
                continue;
            }
            let plain = plain.get_or_insert_with(|| Pages::new(&self.vertices, FEW_PAGES));
            self.face(&mut stream, face, plain, &mut |at| pages.get(at.into(), face), &mut |t| {
                triangles += 1;
                each(&t, triangles)
            })?;
        }
        let has_more = self.ends.is_some_and(|bytes| holds_more(&self.properties, bytes, stream.offset()));
        self.has_more.get_or_init(|| has_more);
        Ok(())
    }

    /// Reads a face: `vertex` makes a value of the number of every vertex, `each` takes the triangles; polygons are cut
    /// by the places of their vertices.
    fn face<V: Copy>(
        &self,
        stream: &mut Stream<'_>,
        face: u64,
        places: &mut Pages<'_>,
        vertex: &mut impl FnMut(u32) -> Result<V, Stop>,
        each: &mut impl FnMut([V; 3]) -> Result<(), Stop>,
    ) -> Result<(), Stop> {
        let big = self.vertices.big;
        let bad = |_| bad_index(face + 1, self.vertices.count);
        for (at, property) in self.properties.iter().enumerate() {
            let Some(length) = property.length else {
                stream.skip(property.value.bytes());
                continue;
            };
            let count = u64::try_from(whole(stream, length, big)?).map_err(bad)?;
            if at != self.corners {
                stream.skip(property.value.bytes().saturating_mul(count));
                continue;
            }
            let corners = usize::try_from(count).unwrap_or(usize::MAX);
            if self.kind == Kind::Face && (4..=polygon::MAX_CORNERS).contains(&corners) {
                let mut polygon = Vec::with_capacity(corners);
                let mut points = Vec::with_capacity(corners);
                for _ in 0..corners {
                    let index = u32::try_from(whole(stream, property.value, big)?).map_err(bad)?;
                    points.push(places.get(index.into(), face)?);
                    polygon.push(vertex(index)?);
                }
                match polygon::cut(&points) {
                    Some(cut) => cut.iter().try_for_each(|t| each(t.map(|at| polygon[at as usize])))?,
                    None => {
                        (2..corners).try_for_each(|at| each([polygon[0], polygon[at - 1], polygon[at]]))?;
                    }
                }
                continue;
            }
            let mut fan = self.kind.fan();
            for _ in 0..count {
                let index = whole(stream, property.value, big)?;
                if index == -1 && self.kind == Kind::Strips {
                    fan = self.kind.fan();
                    continue;
                }
                let index = u32::try_from(index).map_err(bad)?;
                if let Some(t) = fan.next(vertex(index)?) {
                    each(t)?;
                }
            }
        }
        Ok(())
    }

    /// Calls `each` with the triangles and their looks.
    fn for_each_look(&self, each: &mut EachLook<'_>) -> Result<(), Stop> {
        let mut stream = Stream::new(&self.file, self.offset);
        let mut pages = Pages::new(&self.vertices, PAGES);
        let mut places = Pages::new(&self.vertices, FEW_PAGES);
        let mut looks = self.looks.open();
        let mut triangles = 0;
        // The colour of a face may stand behind its corners, whose number has no bound: another stream runs ahead.
        let mut ahead = self.face_colors.map(|scale| (Stream::new(&self.file, self.offset), scale));
        for face in 0..self.faces {
            let mut color = None;
            if let Some((stream, scale)) = &mut ahead {
                color = Some(scaled(self.face_color(stream)?, *scale)?);
            }
            self.face(&mut stream, face, &mut places, &mut Ok, &mut |corners| {
                triangles += 1;
                let mut t = [[0.0; 3]; 3];
                for (out, corner) in t.iter_mut().zip(corners) {
                    *out = pages.get(corner.into(), face)?;
                }
                finite(&t, triangles)?;
                let mut look = looks.look(corners, face)?;
                look.colors = look.colors.or(color.map(|color| [color; 3]));
                each(&t, &look)
            })?;
        }
        Ok(())
    }

    /// Reads a face for its colour alone.
    fn face_color(&self, stream: &mut Stream<'_>) -> Result<[f64; 3], Stop> {
        let big = self.vertices.big;
        let mut color = [0.0; 3];
        for property in &self.properties {
            if let Some(length) = property.length {
                let count = u64::try_from(whole(stream, length, big)?).unwrap_or(0);
                stream.skip(property.value.bytes().saturating_mul(count));
            } else if let Some(at) = COLOR.iter().position(|name| *name == property.name) {
                color[at] = real(stream, property.value, big)?;
            } else {
                stream.skip(property.value.bytes());
            }
        }
        Ok(color)
    }
}

/// The next number.
#[expect(clippy::cast_precision_loss, reason = "integers of 32 bits")]
fn real(stream: &mut Stream<'_>, number: Number, big: bool) -> Result<f64, Stop> {
    Ok(match number {
        Number::F32 => {
            let b: [u8; 4] = stream.take()?;
            if big { f32::from_be_bytes(b) } else { f32::from_le_bytes(b) }.into()
        }
        Number::F64 => {
            let b: [u8; 8] = stream.take()?;
            if big { f64::from_be_bytes(b) } else { f64::from_le_bytes(b) }
        }
        _ => whole(stream, number, big)? as f64,
    })
}

/// The next whole number.
#[inline]
fn whole(stream: &mut Stream<'_>, number: Number, big: bool) -> Result<i64, Stop> {
    macro_rules! take {
        ($t:ty) => {{
            let bytes = stream.take()?;
            if big { <$t>::from_be_bytes(bytes) } else { <$t>::from_le_bytes(bytes) }.into()
        }};
    }
    Ok(match number {
        Number::I8 => take!(i8),
        Number::U8 => take!(u8),
        Number::I16 => take!(i16),
        Number::U16 => take!(u16),
        Number::I32 => take!(i32),
        _ => take!(u32),
    })
}

/// Colours and normals of vertices, and colours of triangles, as they were written.
fn written(spools: [Option<(Spool, f64)>; 3]) -> Result<VertexLooks, Stop> {
    let read = |of: Option<(Spool, f64)>| {
        of.map(|(spool, scale)| Ok::<_, Stop>((spool.into_vertices()?, scale))).transpose()
    };
    let [colors, normals, of_triangles] = spools.map(read);
    let normals = normals?.map(|(vertices, _)| vertices);
    Ok(VertexLooks { colors: colors?, normals, of_triangles: of_triangles? })
}

/// The values of elements, one after the other.
enum Values<'a> {
    Text(Words<'a>),
    /// Binary values; true for the highest byte first.
    Binary(Stream<'a>, bool),
}

impl Values<'_> {
    fn real(&mut self, number: Number) -> Result<f64, Stop> {
        match self {
            Self::Text(words) => {
                words.must_anywhere()?;
                words.as_number()
            }
            Self::Binary(stream, big) => real(stream, number, *big),
        }
    }

    fn whole(&mut self, number: Number) -> Result<i64, Stop> {
        match self {
            Self::Text(words) => {
                words.must_anywhere()?;
                words.as_whole()
            }
            Self::Binary(stream, big) => whole(stream, number, *big),
        }
    }

    /// The length of a list.
    fn count(&mut self, number: Number) -> Result<u64, Stop> {
        let count = self.whole(number)?;
        u64::try_from(count).map_err(|_| match self {
            Self::Text(words) => words.wrong(),
            Self::Binary(..) => bad!("has a list of {count} items; repair the file").into(),
        })
    }

    /// Ends an element: lines of text have one each, and a further number would be taken for the next one's.
    fn end(&mut self) -> Result<(), Stop> {
        match self {
            Self::Text(words) => words.end_of_line("its element"),
            Self::Binary(..) => Ok(()),
        }
    }
}

/// Writes vertices and triangles out, from text or from elements of any order and length.
fn write_out(
    file: &PositionalFile,
    bytes: u64,
    header: &Header,
    [vertex, face]: [usize; 2],
    Limits { scratch, looks, colors: colored, .. }: Limits<'_>,
) -> Result<(Faces, bool), Stop> {
    let mut values = match header.form {
        Form::Text => {
            let mut words = Words::new(file, header.end, header.line);
            words.cr_alone = header.cr_alone;
            Values::Text(words)
        }
        form => Values::Binary(Stream::new(file, header.end), form == Form::Big),
    };
    let (mut vertices, mut triangles) = (Spool::new(scratch), Spool::new(scratch));
    let mut polygons = Polygons::new(scratch);
    let spool = |number: usize, names, wanted: bool| {
        let fields = fields(&header.elements[number].properties, names).filter(|_| wanted);
        fields.map(|fields| (Spool::new(scratch), color_scale(fields)))
    };
    let (mut colors, mut normals) = (spool(vertex, COLOR, looks), spool(vertex, NORMAL, looks));
    let kind = header.elements[face].kind;
    let mut of_triangles = spool(face, COLOR, colored && colors.is_none() && kind == Kind::Face);
    for (number, element) in header.elements.iter().enumerate().take(vertex.max(face) + 1) {
        let least =
            if header.form == Form::Text { 2 * element.properties.len() as u64 } else { element.least() };
        let held = bytes / least.max(1) + 1;
        if element.count > held {
            return Err(count_lies(element.count, held).into());
        }
        for at in 0..element.count {
            let (mut point, mut color, mut normal) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            let mut added = 0_u64;
            for property in &element.properties {
                let Some(length) = property.length else {
                    let value = values.real(property.value)?;
                    let kinds = [(PLACE, &mut point), (COLOR, &mut color), (NORMAL, &mut normal)];
                    for (names, out) in kinds {
                        property.name.put(value, names, out);
                    }
                    continue;
                };
                let bad = |_| bad_index(at + 1, header.elements[vertex].count);
                let count = values.count(length)?;
                let (mut fan, first) = (element.kind.fan(), triangles.count);
                for _ in 0..count {
                    if number != face || !property.is_corners() {
                        values.real(property.value)?;
                        continue;
                    }
                    let index = values.whole(property.value)?;
                    if index == -1 && kind == Kind::Strips {
                        fan = Fan::strip();
                        continue;
                    }
                    if let Some(t) = fan.next(u32::try_from(index).map_err(bad)?) {
                        triangles.numbers(t)?;
                        added += 1;
                    }
                }
                if number == face && kind == Kind::Face {
                    polygons.fan(first, triangles.count)?;
                }
            }
            if !element.properties.is_empty() {
                values.end()?;
            }
            if let (true, Some((spool, _))) = (number == face, &mut of_triangles) {
                for _ in 0..added {
                    spool.vertex(color)?;
                }
            }
            if number == vertex {
                vertices.vertex(point)?;
                for (spool, value) in [(&mut colors, color), (&mut normals, normal)] {
                    if let Some((spool, _)) = spool {
                        spool.vertex(value)?;
                    }
                }
            }
        }
    }
    // Behind the faces other elements may follow.
    let is_last = vertex.max(face) + 1 == header.elements.len();
    let has_more = match &mut values {
        _ if !is_last => false,
        Values::Text(words) => words.has_more()?,
        Values::Binary(stream, _) => holds_more(&header.elements[face].properties, bytes, stream.offset()),
    };
    let faces = Faces::of(vertices, triangles, written([colors, normals, of_triangles])?)?;
    faces.cut(polygons, None)?;
    Ok((faces, has_more))
}
