//! Elements of an XML text with their attributes, one after the other, in constant memory.
//!
//! Text between elements, comments and instructions are left out; declarations of types, through which a text could
//! make itself longer, are refused. What is not closed, or closed otherwise, is refused where it ends.

use std::io::Read;

use super::stop::Stop;
use super::stream::uninterrupted;
use super::zip::reading;
use crate::facts::{Feature, MeshFault};

/// Bytes read at a time.
const BUFFER: usize = 64 << 10;
/// Longest tag with its attributes, most attributes, and how deep elements may nest.
const MAX_TAG: usize = 16 << 10;
const MAX_ATTRIBUTES: usize = 64;
const MAX_DEPTH: u32 = 64;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Event {
    /// An element begins; `empty` ones end at once, without an event of their own.
    Start {
        /// Does it end at once?
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
    depth: u32,
    begun: bool,
    /// The tag: its name, then its attributes.
    tag: Vec<u8>,
    name: usize,
    /// Beginning of each name, and of its value, and the end of that.
    attributes: Vec<[u32; 4]>,
}

/// A name without what stands before its colon.
fn local(name: &[u8]) -> &[u8] {
    name.iter().position(|b| *b == b':').map_or(name, |at| &name[at + 1..])
}

impl<R: Read> Xml<R> {
    pub(super) fn new(input: R) -> Self {
        Self {
            input,
            buffer: Vec::new(),
            at: 0,
            line: 1,
            depth: 0,
            begun: false,
            tag: Vec::new(),
            name: 0,
            attributes: Vec::new(),
        }
    }

    pub(super) fn wrong(&self) -> Stop {
        MeshFault::BadText { line: self.line }.into()
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
        if !std::mem::replace(&mut self.begun, true)
            && [&b"\xff\xfe"[..], b"\xfe\xff", b"<\0", b"\0<"]
                .iter()
                .any(|mark| self.buffer.starts_with(mark))
        {
            return Err(MeshFault::Unsupported(Feature::Utf16).into());
        }
        Ok(read > 0)
    }

    fn must(&mut self) -> Result<u8, Stop> {
        self.byte()?.ok_or_else(|| MeshFault::CutShort.into())
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

    /// Reads on; name and attributes are those of the element that begins then.
    pub(super) fn next(&mut self) -> Result<Event, Stop> {
        loop {
            loop {
                match self.byte()? {
                    Some(b'<') => break,
                    Some(_) => {}
                    None if self.depth == 0 => return Ok(Event::Done),
                    None => return Err(MeshFault::CutShort.into()),
                }
            }
            match self.must()? {
                b'?' => self.skip_past(b"?>")?,
                b'!' => match (self.must()?, self.must()?) {
                    (b'-', b'-') => self.skip_past(b"-->")?,
                    (b'[', b'C') => self.skip_past(b"]]>")?,
                    _ => return Err(self.wrong()),
                },
                b'/' => {
                    while self.must()? != b'>' {}
                    self.depth = self.depth.checked_sub(1).ok_or_else(|| self.wrong())?;
                    return Ok(Event::End);
                }
                first => {
                    let empty = self.start(first)?;
                    if !empty {
                        self.depth += 1;
                        if self.depth > MAX_DEPTH {
                            return Err(MeshFault::Recursion.into());
                        }
                    }
                    return Ok(Event::Start { empty });
                }
            }
        }
    }

    /// Reads a tag from its second byte on; is the element empty?
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
            self.attributes.push(places.map(|at| u32::try_from(at).unwrap_or(u32::MAX)));
            if self.attributes.len() > MAX_ATTRIBUTES {
                return Err(self.wrong());
            }
            next = self.must()?;
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

    /// Name of the element, without what stands before its colon.
    #[inline]
    pub(super) fn name(&self) -> &[u8] {
        local(&self.tag[..self.name])
    }

    fn part(&self, from: u32, to: u32) -> &[u8] {
        self.tag.get(from as usize..to as usize).unwrap_or_default()
    }

    /// Value of an attribute as it stands, by its name without what stands before its colon.
    #[inline]
    pub(super) fn raw(&self, name: &[u8]) -> Option<&[u8]> {
        let found = self.attributes.iter().find(|a| local(self.part(a[0], a[1])) == name)?;
        Some(self.part(found[2], found[3]))
    }

    /// Whole names of attributes with their values.
    pub(super) fn all(&self) -> impl Iterator<Item = (&[u8], &[u8])> {
        self.attributes.iter().map(|a| (self.part(a[0], a[1]), self.part(a[2], a[3])))
    }

    /// Value of an attribute as text, with what `&amp;` and the like stand for.
    pub(super) fn text(&self, name: &[u8]) -> Result<Option<String>, Stop> {
        let Some(raw) = self.raw(name) else { return Ok(None) };
        let text = std::str::from_utf8(raw).map_err(|_| self.wrong())?;
        let known = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
        Ok(Some(known.iter().fold(text.to_owned(), |text, (name, sign)| text.replace(name, sign))))
    }

    #[inline]
    pub(super) fn number(&self, name: &[u8]) -> Result<f64, Stop> {
        let text = self.raw(name).and_then(|raw| std::str::from_utf8(raw).ok());
        text.and_then(|text| text.trim().parse().ok()).ok_or_else(|| self.wrong())
    }

    /// A whole number from 0 on.
    #[inline]
    pub(super) fn whole(&self, name: &[u8]) -> Result<Option<u32>, Stop> {
        let Some(raw) = self.raw(name) else { return Ok(None) };
        let digits = raw.trim_ascii();
        if digits.is_empty() || digits.len() > 10 || !digits.iter().all(u8::is_ascii_digit) {
            return Err(self.wrong());
        }
        let value = digits.iter().fold(0_u64, |n, d| 10 * n + u64::from(d - b'0'));
        u32::try_from(value).map(Some).map_err(|_| self.wrong())
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
                    let value = xml.text(b"v")?.map(|v| format!("={v}")).unwrap_or_default();
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
        let text = "\u{feff}<?xml version='1.0'?><!-- <x> -- --><a:b v = '1 &lt; &amp;lt;' w=\"\"><c/>text<d q:v=\"2\" />\
                    <![CDATA[<e>]]></a:b>";
        assert_eq!(names(text).unwrap(), ["b=1 < &lt;", "c/", "d=2/", "end"]);
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
