//! Elements of an XML text with their attributes, one after the other, in constant memory.
//!
//! Text between elements, comments and instructions are left out; declarations of types, through which a text could
//! make itself longer, are refused. So is text that is not well-formed: elements that are not closed, or by another
//! name, attributes that are stated twice, prefixes without a namespace.

use std::io::Read;

use super::stop::Stop;
use super::stream::{mark, uninterrupted};
use super::zip::reading;
use crate::fault::bad;
use crate::mesh::read::stop::{bad_text, bad_text_because, cut_short, not_a_number, recursion};
use crate::text::shown;

/// Bytes read at a time.
const BUFFER: usize = 64 << 10;
/// Longest tag with its attributes, most attributes, and deepest nesting of elements.
const MAX_TAG: usize = 16 << 10;
const MAX_ATTRIBUTES: usize = 64;
const MAX_DEPTH: usize = 64;
/// Most namespaces that are declared at a time, and most bytes of open names and namespaces.
const MAX_SPACES: usize = 64;
const MAX_HELD: usize = 32 << 10;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Event {
    /// An element begins; `empty` ones end at once, without an event of their own.
    Start {
        /// True if it ends at once.
        empty: bool,
    },
    End,
    Done,
}

pub(super) struct Xml<R> {
    input: R,
    buffer: Vec<u8>,
    at: usize,
    line: u64,
    /// Names of the open elements one after the other, and the start of each.
    open: Vec<u8>,
    depths: Vec<usize>,
    /// Namespaces of prefixes (Namespaces in XML 1.0), the empty one included, the innermost last.
    spaces: Vec<Declared>,
    space_bytes: usize,
    begun: bool,
    /// True if the only element at the top has begun.
    rooted: bool,
    /// The tag: its name, then its attributes.
    tag: Vec<u8>,
    name: usize,
    /// Beginning of each name, beginning and end of its value.
    attributes: Vec<[u32; 4]>,
}

struct Declared {
    /// Open elements around the one that declares it.
    depth: usize,
    prefix: Vec<u8>,
    space: Vec<u8>,
}

/// A name's prefix and the part after its colon.
#[inline]
fn split(name: &[u8]) -> (&[u8], &[u8]) {
    name.iter().position(|b| *b == b':').map_or((&[], name), |at| (&name[..at], &name[at + 1..]))
}

impl<R: Read> Xml<R> {
    pub(super) fn new(input: R) -> Self {
        Self {
            input,
            buffer: Vec::new(),
            at: 0,
            line: 1,
            open: Vec::new(),
            depths: Vec::new(),
            spaces: Vec::new(),
            space_bytes: 0,
            begun: false,
            rooted: false,
            tag: Vec::new(),
            name: 0,
            attributes: Vec::new(),
        }
    }

    pub(super) fn wrong(&self) -> Stop {
        bad_text(self.line).into()
    }

    #[inline]
    fn byte(&mut self) -> Result<Option<u8>, Stop> {
        if self.at == self.buffer.len() && !self.fill()? {
            return Ok(None);
        }
        let byte = self.buffer[self.at];
        self.at += 1;
        self.line += u64::from(byte == b'\n');
        Ok(Some(byte))
    }

    #[cold]
    fn fill(&mut self) -> Result<bool, Stop> {
        self.buffer.resize(BUFFER, 0);
        self.at = 0;
        let read = uninterrupted(|| self.input.read(&mut self.buffer)).map_err(reading)?;
        self.buffer.truncate(read);
        if !std::mem::replace(&mut self.begun, true) {
            mark(&self.buffer)?;
            if self.buffer.starts_with(b"<\0") || self.buffer.starts_with(b"\0<") {
                return Err(bad!("is text in UTF-16, which is not read; save it as UTF-8").into());
            }
        }
        Ok(read > 0)
    }

    fn must(&mut self) -> Result<u8, Stop> {
        self.byte()?.ok_or_else(|| cut_short().into())
    }

    /// Reads on past the end mark.
    fn skip_past(&mut self, mark: &[u8]) -> Result<(), Stop> {
        let mut last = [0_u8; 3];
        loop {
            last = [last[1], last[2], self.must()?];
            if last.ends_with(mark) {
                return Ok(());
            }
        }
    }

    /// Reads on to the next event; name and attributes are those of the element that begins then.
    pub(super) fn next(&mut self) -> Result<Event, Stop> {
        loop {
            loop {
                match self.byte()? {
                    Some(b'<') => break,
                    // The mark of the byte order may stand before all.
                    Some(byte) if self.depths.is_empty() => {
                        if !byte.is_ascii_whitespace() && (self.rooted || byte.is_ascii()) {
                            return Err(self.wrong());
                        }
                    }
                    Some(_) => {}
                    None if self.depths.is_empty() => return Ok(Event::Done),
                    None => return Err(cut_short().into()),
                }
            }
            match self.must()? {
                b'?' => self.skip_past(b"?>")?,
                b'!' => match (self.must()?, self.must()?) {
                    (b'-', b'-') => self.skip_past(b"-->")?,
                    (b'[', b'C') if !self.depths.is_empty() => self.skip_past(b"]]>")?,
                    _ => return Err(self.wrong()),
                },
                b'/' => {
                    self.end()?;
                    return Ok(Event::End);
                }
                first => {
                    let outside = self.depths.is_empty();
                    if outside && std::mem::replace(&mut self.rooted, true) {
                        return Err(self.wrong());
                    }
                    self.leave();
                    let empty = self.start(first)?;
                    self.declare()?;
                    if !empty {
                        if self.depths.len() == MAX_DEPTH || self.open.len() + self.name > MAX_HELD {
                            return Err(recursion().into());
                        }
                        self.depths.push(self.open.len());
                        self.open.extend_from_slice(&self.tag[..self.name]);
                    }
                    return Ok(Event::Start { empty });
                }
            }
        }
    }

    /// Reads the tag that closes the innermost element from its third byte on.
    fn end(&mut self) -> Result<(), Stop> {
        self.leave();
        let from = self.depths.pop().ok_or_else(|| self.wrong())?;
        for at in from..self.open.len() {
            if self.must()? != self.open[at] {
                return Err(self.wrong());
            }
        }
        self.open.truncate(from);
        loop {
            match self.must()? {
                b'>' => break,
                blank if blank.is_ascii_whitespace() => {}
                _ => return Err(self.wrong()),
            }
        }
        Ok(())
    }

    /// Forgets the declarations of elements that have ended.
    #[inline]
    fn leave(&mut self) {
        while let Some(last) = self.spaces.pop_if(|last| last.depth >= self.depths.len()) {
            self.space_bytes -= last.prefix.len() + last.space.len();
        }
    }

    /// Takes the namespaces that the tag declares, and looks for prefixes without one.
    fn declare(&mut self) -> Result<(), Stop> {
        for at in 0..self.attributes.len() {
            let [from, to, begin, end] = self.attributes[at];
            let name = self.part(from, to);
            let prefix = match split(name) {
                (b"xmlns", b"") => return Err(self.wrong()),
                (b"xmlns", prefix) => prefix,
                (b"", b"xmlns") => b"",
                _ => continue,
            };
            let declared = Declared {
                depth: self.depths.len(),
                prefix: prefix.to_vec(),
                space: self.part(begin, end).to_vec(),
            };
            self.space_bytes += declared.prefix.len() + declared.space.len();
            if self.spaces.len() == MAX_SPACES || self.space_bytes > MAX_HELD {
                return Err(self.wrong());
            }
            self.spaces.push(declared);
        }
        let names = self.attributes.iter().map(|a| self.part(a[0], a[1]));
        for (prefix, _) in names.chain([&self.tag[..self.name]]).map(split) {
            if !matches!(prefix, b"" | b"xml" | b"xmlns") && self.space_of(prefix).is_none() {
                return Err(self.wrong());
            }
        }
        Ok(())
    }

    /// The namespace of a prefix; the empty prefix gives the namespace of elements without one.
    pub(super) fn space_of(&self, prefix: &[u8]) -> Option<&[u8]> {
        self.spaces.iter().rev().find(|known| known.prefix == prefix).map(|known| known.space.as_slice())
    }

    /// The namespace of the element; empty for none.
    #[inline]
    pub(super) fn space(&self) -> &[u8] {
        self.space_of(split(&self.tag[..self.name]).0).unwrap_or_default()
    }

    /// Reads on past the end of the element that has begun.
    pub(super) fn skip_element(&mut self) -> Result<(), Stop> {
        let depth = self.depths.len();
        while self.depths.len() >= depth {
            self.next()?;
        }
        Ok(())
    }

    /// Reads a tag from its second byte on; returns true for an empty element.
    fn start(&mut self, first: u8) -> Result<bool, Stop> {
        self.tag.clear();
        self.attributes.clear();
        let mut next = first;
        while !next.is_ascii_whitespace() && next != b'>' && next != b'/' {
            self.put(next)?;
            next = self.must()?;
        }
        self.name = self.tag.len();
        if self.name == 0 {
            return Err(self.wrong());
        }
        loop {
            while next.is_ascii_whitespace() {
                next = self.must()?;
            }
            match next {
                b'>' => return Ok(false),
                b'/' => return if self.must()? == b'>' { Ok(true) } else { Err(self.wrong()) },
                _ => {}
            }
            let begin = self.tag.len();
            while !next.is_ascii_whitespace() && next != b'=' {
                if matches!(next, b'>' | b'/' | b'<' | b'"') {
                    return Err(self.wrong());
                }
                self.put(next)?;
                next = self.must()?;
            }
            let name_end = self.tag.len();
            while next.is_ascii_whitespace() {
                next = self.must()?;
            }
            if next != b'=' {
                return Err(self.wrong());
            }
            next = self.must()?;
            while next.is_ascii_whitespace() {
                next = self.must()?;
            }
            if next != b'"' && next != b'\'' {
                return Err(self.wrong());
            }
            let quote = next;
            loop {
                next = self.must()?;
                match next {
                    b'<' => return Err(self.wrong()),
                    _ if next == quote => break,
                    _ => self.put(next)?,
                }
            }
            let places = [begin, name_end, name_end, self.tag.len()];
            let name = &self.tag[begin..name_end];
            let twice = self.attributes.iter().any(|a| self.part(a[0], a[1]) == name);
            if twice || name.is_empty() || self.attributes.len() == MAX_ATTRIBUTES {
                return Err(self.wrong());
            }
            self.attributes.push(places.map(|at| u32::try_from(at).unwrap_or(u32::MAX)));
            next = self.must()?;
            if !next.is_ascii_whitespace() && next != b'>' && next != b'/' {
                return Err(self.wrong());
            }
        }
    }

    /// The text up to the next tag, without blanks around it and without comments, and `most` bytes of it at most.
    pub(super) fn content(&mut self, most: usize) -> Result<Vec<u8>, Stop> {
        let mut text = Vec::new();
        loop {
            match self.must()? {
                b'<' => {
                    if self.at == self.buffer.len() {
                        if !self.fill()? {
                            return Err(cut_short().into());
                        }
                        self.buffer.insert(0, b'<');
                        self.at = 1;
                    }
                    if self.buffer.get(self.at) != Some(&b'!') {
                        break;
                    }
                    self.must()?;
                    match (self.must()?, self.must()?) {
                        (b'-', b'-') => self.skip_past(b"-->")?,
                        (b'[', b'C') => self.quoted(&mut text, most)?,
                        _ => return Err(self.wrong()),
                    }
                }
                blank if text.is_empty() && blank.is_ascii_whitespace() => {}
                byte if text.len() < most => text.push(byte),
                _ => {}
            }
        }
        // The tag is read again as such.
        self.at -= 1;
        Ok(text.trim_ascii().to_vec())
    }

    /// Adds the text of a section `<![CDATA[...]]>` from its fifth byte on.
    fn quoted(&mut self, text: &mut Vec<u8>, most: usize) -> Result<(), Stop> {
        for byte in b"DATA[" {
            if self.must()? != *byte {
                return Err(self.wrong());
            }
        }
        let (mut last, mut seen) = ([0_u8; 3], 0);
        loop {
            last = [last[1], last[2], self.must()?];
            seen += 1;
            if seen >= 3 && last == *b"]]>" {
                return Ok(());
            }
            // Two bytes wait: they may begin the end.
            if seen >= 3 && text.len() < most && !(text.is_empty() && last[0].is_ascii_whitespace()) {
                text.push(last[0]);
            }
        }
    }

    #[inline]
    fn put(&mut self, byte: u8) -> Result<(), Stop> {
        if self.tag.len() == MAX_TAG {
            return Err(self.wrong());
        }
        self.tag.push(byte);
        Ok(())
    }

    /// Name of the element, without its prefix.
    #[inline]
    pub(super) fn name(&self) -> &[u8] {
        split(&self.tag[..self.name]).1
    }

    fn part(&self, from: u32, to: u32) -> &[u8] {
        self.tag.get(from as usize..to as usize).unwrap_or_default()
    }

    /// Value of an attribute without a prefix, as written.
    #[inline]
    pub(super) fn raw(&self, name: &[u8]) -> Option<&[u8]> {
        let found = self.attributes.iter().find(|a| self.part(a[0], a[1]) == name)?;
        Some(self.part(found[2], found[3]))
    }

    /// Value of an attribute of a namespace, as written.
    pub(super) fn raw_of(&self, space: &[u8], name: &[u8]) -> Option<&[u8]> {
        let is_it = |whole| match split(whole) {
            (b"", _) => false,
            (prefix, own) => own == name && self.space_of(prefix) == Some(space),
        };
        let found = self.attributes.iter().find(|a| is_it(self.part(a[0], a[1])))?;
        Some(self.part(found[2], found[3]))
    }

    /// Value of an attribute as text, with `&amp;` and the like replaced.
    pub(super) fn text(&self, raw: Option<&[u8]>) -> Result<Option<String>, Stop> {
        let Some(raw) = raw else { return Ok(None) };
        let text = std::str::from_utf8(raw).map_err(|_| self.wrong())?;
        let known = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
        Ok(Some(known.iter().fold(text.to_owned(), |text, (name, sign)| text.replace(name, sign))))
    }

    #[inline]
    pub(super) fn number(&self, name: &[u8]) -> Result<f64, Stop> {
        let raw = self.raw(name).ok_or_else(|| self.wrong())?;
        let text = std::str::from_utf8(raw).ok();
        text.and_then(|text| text.trim().parse().ok()).ok_or_else(|| self.not_a_number(name, raw))
    }

    /// The refusal of an attribute that should be a number.
    #[cold]
    pub(super) fn not_a_number(&self, name: &[u8], text: &[u8]) -> Stop {
        let name = String::from_utf8_lossy(name);
        bad_text_because(self.line, &format!("{}: {}", shown(&*name), not_a_number(text))).into()
    }

    /// A whole number from 0 on.
    #[inline]
    pub(super) fn whole(&self, name: &[u8]) -> Result<Option<u32>, Stop> {
        let Some(raw) = self.raw(name) else { return Ok(None) };
        let digits = raw.trim_ascii();
        if digits.is_empty() || digits.len() > 10 || !digits.iter().all(u8::is_ascii_digit) {
            return Err(self.not_a_number(name, raw));
        }
        let value = digits.iter().fold(0_u64, |n, d| 10 * n + u64::from(d - b'0'));
        u32::try_from(value).map(Some).map_err(|_| self.not_a_number(name, raw))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Result<Vec<String>, Stop> {
        let mut xml = Xml::new(text.as_bytes());
        let mut all = Vec::new();
        loop {
            match xml.next()? {
                Event::Start { empty } => {
                    let value = xml
                        .text(xml.raw(b"v").or(xml.raw_of(b"r", b"v")))?
                        .map(|v| format!("={v}"))
                        .unwrap_or_default();
                    let name = String::from_utf8_lossy(xml.name()).into_owned();
                    all.push(format!("{name}{value}{}", if empty { "/" } else { "" }));
                }
                Event::End => all.push("end".into()),
                Event::Done => return Ok(all),
            }
        }
    }

    #[test]
    fn elements_and_attributes_come_in_order() {
        let text = "\u{feff}<?xml version='1.0'?><!-- <x> -- --><a:b v = '1 &lt; &amp;lt;' w=\"\" xmlns:a='s'><c/>text\
                    <d xmlns:q='r' q:v=\"2\" /><d xmlns:q='t' q:v=\"2\"/><![CDATA[<e>]]></a:b \n> <!-- end -->";
        assert_eq!(names(text).unwrap(), ["b=1 < &lt;", "c/", "d=2/", "d/", "end"]);
    }

    #[test]
    fn what_is_not_closed_or_makes_itself_longer_is_refused() {
        for bad in [
            "<a",
            "<a>",
            "</a>",
            "<a b>",
            "<a b=c/>",
            "<a b='<'/>",
            "<!DOCTYPE a [<!ENTITY b 'c'>]><a/>",
            "<a/b>",
            "<>",
            "<a><b></a></b>",
            "<a></b>",
            "<a></a b>",
            "<a></ab>",
            "<a b='1' b='2'/>",
            "<a b='1'c='2'/>",
            "<a ='1'/>",
            "<a/><b/>",
            "<a/>b",
            "<p:a/>",
            "<a xmlns:='s'/>",
            "<a p:b='1'/>",
            "<a><b xmlns:p='s'/><p:c/></a>",
            "<!-- a",
            "<a b='",
        ] {
            assert!(names(bad).is_err(), "{bad}");
        }
        assert!(
            names(&"<a>".repeat(100)).is_err() && names(&format!("<a {}/>", "b='' ".repeat(100))).is_err()
        );
        assert!(names(&format!("<a b='{}'/>", "c".repeat(20_000))).is_err());
    }
}
