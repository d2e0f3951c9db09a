//! A file from a place to its end: bytes, or the words and numbers of text.

use std::fs::File;
use std::io;

use super::stop::Stop;
use crate::mesh::read::stop::{bad_text, cut_short};
use crate::platform::FileExt;

/// Bytes read at a time.
const BUFFER: usize = 64 << 10;
/// Bytes that tell what a file is.
pub(super) const HEAD: usize = 512;
/// Longest word that means something; of longer ones the beginning is kept.
const WORD: usize = 64;

/// Reads, again after a signal.
pub(super) fn uninterrupted(mut read: impl FnMut() -> io::Result<usize>) -> io::Result<usize> {
    loop {
        match read() {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            done => return done,
        }
    }
}

pub(super) fn head(file: &File) -> io::Result<Vec<u8>> {
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

/// Little-endian numbers of 32 bits.
#[inline]
pub(super) fn numbers<const N: usize>(bytes: &[u8]) -> [u32; N] {
    std::array::from_fn(|k| bytes[4 * k..].first_chunk().map_or(0, |b| u32::from_le_bytes(*b)))
}

pub(super) struct Stream<'a> {
    file: &'a File,
    next: u64,
    buffer: Vec<u8>,
    at: usize,
}

impl<'a> Stream<'a> {
    pub(super) fn new(file: &'a File, from: u64) -> Self {
        Self { file, next: from, buffer: Vec::with_capacity(BUFFER), at: 0 }
    }

    /// Has more bytes in the buffer; `false` at the end.
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

    /// Leaves bytes out.
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
    ended: bool,
    /// Do lines end in CR alone, so that an LF behind one does not belong to it?
    pub(super) cr_alone: bool,
    /// Does `#` begin a comment?
    pub(super) comments: bool,
}

impl<'a> Words<'a> {
    /// From a place in a file on, at this line.
    pub(super) fn new(file: &'a File, from: u64, line: u64) -> Self {
        let stream = Stream::new(file, from);
        Self { stream, line, word: [0; WORD], length: 0, ended: false, cr_alone: false, comments: true }
    }

    /// Reads on; the word is [`Words::word`] then.
    #[inline]
    pub(super) fn next(&mut self) -> Result<Token, Stop> {
        self.length = 0;
        let mut comment = false;
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
                _ if comment => {}
                b' ' | b'\t' | 0x0b | 0x0c if self.length == 0 => {}
                b' ' | b'\t' | 0x0b | 0x0c => return Ok(Token::Word),
                b'#' if self.length == 0 && self.comments => comment = true,
                _ if self.length < WORD => {
                    self.word[self.length] = byte;
                    self.length += 1;
                }
                _ => {}
            }
        }
    }

    /// The word that was read last.
    #[inline]
    pub(super) fn word(&self) -> &[u8] {
        &self.word[..self.length]
    }

    pub(super) fn wrong(&self) -> Stop {
        Self::wrong_at(self.line)
    }

    pub(super) fn wrong_at(line: u64) -> Stop {
        bad_text(line).into()
    }

    /// Line of the last word, or of the next one where a line has ended.
    pub(super) fn line(&self) -> u64 {
        self.line
    }

    /// Is it the last word, whatever the case of its letters?
    pub(super) fn is(&self, word: &str) -> bool {
        self.word().eq_ignore_ascii_case(word.as_bytes())
    }

    /// The end of this line, before which there is nothing more.
    pub(super) fn end_of_line(&mut self) -> Result<(), Stop> {
        if self.next()? == Token::Word { Err(self.wrong()) } else { Ok(()) }
    }

    pub(super) fn skip_line(&mut self) -> Result<(), Stop> {
        while self.next()? == Token::Word {}
        Ok(())
    }

    /// The rest of this line, at most so many bytes, without blanks around it.
    pub(super) fn rest_of_line(&mut self, most: usize) -> Result<String, Stop> {
        let mut rest = Vec::new();
        while let Some(byte) = self.stream.byte()? {
            if matches!(byte, b'\n' | b'\r') {
                // It is met again as the end of the line.
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
        let text = std::str::from_utf8(self.word()).map_err(|_| self.wrong())?;
        text.parse().map_err(|_| self.wrong())
    }

    /// The last word as a whole number.
    #[inline]
    pub(super) fn as_whole(&self) -> Result<i64, Stop> {
        let (negative, digits) = match self.word().split_first() {
            Some((b'-', rest)) => (true, rest),
            Some((b'+', rest)) => (false, rest),
            _ => (false, self.word()),
        };
        if digits.is_empty() || digits.len() > 18 || !digits.iter().all(u8::is_ascii_digit) {
            return Err(self.wrong());
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

    #[inline]
    pub(super) fn number(&mut self) -> Result<f64, Stop> {
        self.must()?;
        self.as_number()
    }

    pub(super) fn offset(&self) -> u64 {
        self.stream.offset()
    }
}
