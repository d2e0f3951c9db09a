//! A file from a place to its end: bytes, or the words and numbers of text.

use std::io;

use super::stop::Stop;
use crate::fault::{Fault, bad};
use crate::mesh::read::stop::{bad_text, bad_text_because, cut_short, not_a_number, quoted};
use crate::platform::PositionalFile;
use crate::text::mark_bytes;

/// Bytes read at a time.
const BUFFER: usize = 64 << 10;
/// Bytes by which a file's format is recognised.
pub(super) const HEAD: usize = 512;
/// Longest word with a meaning; longer ones are cut.
const WORD: usize = 64;

/// Reads, once more after a signal.
pub(super) fn uninterrupted(mut read: impl FnMut() -> io::Result<usize>) -> io::Result<usize> {
    loop {
        match read() {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            done => return done,
        }
    }
}

pub(super) fn head(file: &PositionalFile) -> io::Result<Vec<u8>> {
    let mut head = vec![0; HEAD];
    let mut have = 0;
    while have < HEAD {
        match uninterrupted(|| file.read_at(&mut head[have..], have as u64))? {
            0 => break,
            n => have += n,
        }
    }
    head.truncate(have);
    Ok(head)
}

/// Bytes of the mark of the byte order before a text.
pub(super) fn mark(head: &[u8]) -> Result<usize, Fault> {
    mark_bytes(head).map_err(|fault| bad!("{fault}"))
}

/// Little-endian numbers of 32 bits.
#[inline]
pub(super) fn numbers<const N: usize>(bytes: &[u8]) -> [u32; N] {
    std::array::from_fn(|k| bytes[4 * k..].first_chunk().map_or(0, |b| u32::from_le_bytes(*b)))
}

pub(super) struct Stream<'a> {
    file: &'a PositionalFile,
    next: u64,
    buffer: Vec<u8>,
    at: usize,
}

impl<'a> Stream<'a> {
    pub(super) fn new(file: &'a PositionalFile, from: u64) -> Self {
        Self { file, next: from, buffer: Vec::with_capacity(BUFFER), at: 0 }
    }

    /// Reads more bytes into the buffer; `false` at the end.
    #[cold]
    fn fill(&mut self) -> io::Result<bool> {
        self.buffer.drain(..self.at);
        self.at = 0;
        let have = self.buffer.len();
        self.buffer.resize(BUFFER, 0);
        let read = uninterrupted(|| self.file.read_at(&mut self.buffer[have..], self.next));
        let read = read.inspect_err(|_| self.buffer.truncate(have))?;
        self.buffer.truncate(have + read);
        self.next += read as u64;
        Ok(read > 0)
    }

    #[inline]
    pub(super) fn take<const N: usize>(&mut self) -> Result<[u8; N], Stop> {
        loop {
            if let Some(bytes) = self.buffer[self.at..].first_chunk::<N>() {
                self.at += N;
                return Ok(*bytes);
            }
            if !self.fill().map_err(Stop::Read)? {
                return Err(cut_short().into());
            }
        }
    }

    /// The next byte, which is read again.
    #[inline]
    pub(super) fn peek(&mut self) -> Result<u8, Stop> {
        let [byte] = self.take()?;
        self.at -= 1;
        Ok(byte)
    }

    /// Skips bytes.
    pub(super) fn skip(&mut self, bytes: u64) {
        let here = (self.buffer.len() - self.at) as u64;
        if bytes <= here {
            self.at += usize::try_from(bytes).unwrap_or(0);
        } else {
            self.buffer.clear();
            self.at = 0;
            self.next = self.next.saturating_add(bytes - here);
        }
    }

    #[inline]
    fn byte(&mut self) -> Result<Option<u8>, Stop> {
        if self.at == self.buffer.len() && !self.fill().map_err(Stop::Read)? {
            return Ok(None);
        }
        let byte = self.buffer[self.at];
        self.at += 1;
        Ok(Some(byte))
    }

    pub(super) fn offset(&self) -> u64 {
        self.next - (self.buffer.len() - self.at) as u64
    }
}

/// True for the text that older programs write for the result of a division by zero.
#[cold]
fn is_undefined(text: &str) -> bool {
    let text = text.trim_start_matches(['-', '+']).to_ascii_lowercase();
    text.starts_with("nan(") || text.starts_with("1.#")
}

/// A token of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Token {
    Word,
    LineEnd,
    End,
}

/// Words and ends of lines (CR, LF or both); comments from `#` on are left out.
pub(super) struct Words<'a> {
    stream: Stream<'a>,
    /// Line of the next byte, counted from 1.
    line: u64,
    word: [u8; WORD],
    length: usize,
    /// True where only the beginning of the last word is kept.
    longer: bool,
    ended: bool,
    /// True if lines end in CR alone, so that an LF after one does not belong to it.
    pub(super) cr_alone: bool,
    /// True if `#` begins a comment.
    pub(super) comments: bool,
    /// True if a comment held colours of vertices, as ZBrush writes them.
    pub(super) painted: bool,
}

/// Beginning of a comment that holds colours of vertices.
const PAINT: &[u8] = b"#MRGB";

impl<'a> Words<'a> {
    /// Words from an offset of a file on, which is in this line.
    pub(super) fn new(file: &'a PositionalFile, from: u64, line: u64) -> Self {
        let stream = Stream::new(file, from);
        let word = [0; WORD];
        Self {
            stream,
            line,
            word,
            length: 0,
            longer: false,
            ended: false,
            cr_alone: false,
            comments: true,
            painted: false,
        }
    }

    /// Words of a whole file, without the mark of its byte order.
    pub(super) fn begin(file: &'a PositionalFile) -> Result<Self, Stop> {
        let head = head(file).map_err(Stop::Read)?;
        Ok(Self::new(file, mark(&head)? as u64, 1))
    }

    /// Reads on; the word is [`Words::word`] then.
    #[inline]
    pub(super) fn next(&mut self) -> Result<Token, Stop> {
        self.length = 0;
        self.longer = false;
        let mut comment = 0;
        loop {
            let Some(byte) = self.stream.byte()? else {
                return Ok(match (self.length, std::mem::replace(&mut self.ended, true)) {
                    (1.., _) => {
                        self.ended = false;
                        Token::Word
                    }
                    (0, false) => Token::LineEnd,
                    (0, true) => Token::End,
                });
            };
            match byte {
                b'\n' | b'\r' if self.length == 0 => {
                    if byte == b'\r'
                        && !self.cr_alone
                        && self.stream.byte()?.is_some_and(|next| next != b'\n')
                    {
                        self.stream.at -= 1;
                    }
                    self.line += 1;
                    return Ok(Token::LineEnd);
                }
                b'\n' | b'\r' => {
                    self.stream.at -= 1;
                    return Ok(Token::Word);
                }
                _ if comment > 0 => {
                    if let Some(due) = PAINT.get(comment) {
                        comment = if byte == *due { comment + 1 } else { PAINT.len() };
                        self.painted |= byte == *due && comment == PAINT.len();
                    }
                }
                b' ' | b'\t' | 0x0b | 0x0c if self.length == 0 => {}
                b' ' | b'\t' | 0x0b | 0x0c => return Ok(Token::Word),
                b'#' if self.length == 0 && self.comments => comment = 1,
                _ if self.length < WORD => {
                    self.word[self.length] = byte;
                    self.length += 1;
                }
                _ => self.longer = true,
            }
        }
    }

    /// The word that was read last.
    #[inline]
    pub(super) fn word(&self) -> &[u8] {
        &self.word[..self.length]
    }

    /// The refusal of the last word.
    #[cold]
    pub(super) fn wrong(&self) -> Stop {
        self.because(&format!("{} is out of place", quoted(self.word())))
    }

    #[cold]
    fn because(&self, why: &str) -> Stop {
        bad_text_because(self.line, why).into()
    }

    pub(super) fn wrong_at(line: u64) -> Stop {
        bad_text(line).into()
    }

    /// The refusal of the last word, which is one more than belongs to `what`.
    #[cold]
    pub(super) fn one_more(&self, what: &str) -> Stop {
        self.because(&format!("{} is one number more than {what} has", quoted(self.word())))
    }

    /// Line of the last word, or of the next one where a line has ended.
    pub(super) fn line(&self) -> u64 {
        self.line
    }

    /// True if the last word is `word`, in any case.
    pub(super) fn is(&self, word: &str) -> bool {
        self.word().eq_ignore_ascii_case(word.as_bytes())
    }

    /// The end of this line, before which there is nothing more.
    pub(super) fn end_of_line(&mut self, what: &str) -> Result<(), Stop> {
        if self.next()? == Token::Word { Err(self.one_more(what)) } else { Ok(()) }
    }

    /// True if a word follows, on this line or a later one.
    pub(super) fn has_more(&mut self) -> Result<bool, Stop> {
        loop {
            match self.next()? {
                Token::Word => return Ok(true),
                Token::LineEnd => {}
                Token::End => return Ok(false),
            }
        }
    }

    /// The numbers left in this line; there must be as many as one of `counts` says.
    pub(super) fn rest<const N: usize>(
        &mut self,
        what: &str,
        counts: &[usize],
    ) -> Result<([f64; N], usize), Stop> {
        let (mut values, mut count) = ([0.0; N], 0);
        while self.next()? == Token::Word {
            let value = self.as_number()?;
            if let Some(out) = values.get_mut(count) {
                *out = value;
            }
            count += 1;
        }
        if counts.contains(&count) {
            return Ok((values, count));
        }
        let line = if self.ended { self.line } else { self.line - 1 };
        let belong = counts.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ");
        let why = format!("{what} has {count} numbers where {belong} belong");
        Err(bad_text_because(line, &why).into())
    }

    pub(super) fn skip_line(&mut self) -> Result<(), Stop> {
        while self.next()? == Token::Word {}
        Ok(())
    }

    /// The rest of this line, at most `most` bytes, without blanks around it.
    pub(super) fn rest_of_line(&mut self, most: usize) -> Result<String, Stop> {
        let mut rest = Vec::new();
        while let Some(byte) = self.stream.byte()? {
            if matches!(byte, b'\n' | b'\r') {
                // The line end is read again as such.
                self.stream.at -= 1;
                break;
            }
            if rest.len() < most {
                rest.push(byte);
            }
        }
        Ok(String::from_utf8_lossy(&rest).trim().to_owned())
    }

    #[inline]
    pub(super) fn as_number(&self) -> Result<f64, Stop> {
        let text = std::str::from_utf8(self.word()).ok().filter(|_| !self.longer);
        let number =
            text.and_then(|text| text.parse().ok().or_else(|| is_undefined(text).then_some(f64::NAN)));
        number.ok_or_else(|| self.because(&not_a_number(self.word())))
    }

    /// The last word as a whole number.
    #[inline]
    pub(super) fn as_whole(&self) -> Result<i64, Stop> {
        self.whole_of(self.word())
    }

    /// A part of the last word as a whole number.
    #[inline]
    pub(super) fn whole_of(&self, part: &[u8]) -> Result<i64, Stop> {
        let (negative, digits) = match part.split_first() {
            Some((b'-', rest)) => (true, rest),
            Some((b'+', rest)) => (false, rest),
            _ => (false, part),
        };
        if digits.is_empty() || digits.len() > 18 || !digits.iter().all(u8::is_ascii_digit) {
            return Err(self.because(&not_a_number(self.word())));
        }
        let value = digits.iter().fold(0, |n, d| 10 * n + i64::from(d - b'0'));
        Ok(if negative { -value } else { value })
    }

    /// The next word, which must be in this line.
    #[inline]
    pub(super) fn must(&mut self) -> Result<(), Stop> {
        match self.next()? {
            Token::Word => Ok(()),
            Token::LineEnd => Err(Self::wrong_at(self.line - 1)),
            Token::End => Err(cut_short().into()),
        }
    }

    /// The next word in this line or a later one.
    pub(super) fn must_anywhere(&mut self) -> Result<(), Stop> {
        loop {
            match self.next()? {
                Token::Word => return Ok(()),
                Token::LineEnd => {}
                Token::End => return Err(cut_short().into()),
            }
        }
    }

    pub(super) fn offset(&self) -> u64 {
        self.stream.offset()
    }
}
