//! Tokens of bytes, with the line of each.

use std::io::{self, BufRead};

use super::Stop;
use crate::csg::fault::{At, expected};
use crate::fault::bad;
use crate::text::{mark_bytes, shown};

const LONGEST_WORD: usize = 64;
const LONGEST_TEXT: usize = 4096;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token {
    /// A name: letters, digits, `_` and `$`.
    Name(String),
    Number(f64),
    /// A text in quotes.
    Text(String),
    /// Any other byte.
    Sign(u8),
    End,
}

pub(super) struct Lexer<'a> {
    input: &'a mut dyn BufRead,
    line: u64,
}

impl<'a> Lexer<'a> {
    /// Tokens of a text, behind the mark of its byte order.
    pub(super) fn new(input: &'a mut dyn BufRead) -> Result<Self, Stop> {
        let bytes = mark_bytes(input.fill_buf()?).map_err(|fault| bad!("{fault}"))?;
        input.consume(bytes);
        Ok(Self { input, line: 1 })
    }

    /// The line that is being read, counted from 1.
    pub(super) fn line(&self) -> u64 {
        self.line
    }

    fn peek(&mut self) -> io::Result<Option<u8>> {
        loop {
            match self.input.fill_buf() {
                Ok(bytes) => return Ok(bytes.first().copied()),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
    }

    fn take(&mut self) -> io::Result<Option<u8>> {
        let byte = self.peek()?;
        if let Some(byte) = byte {
            self.input.consume(1);
            self.line += u64::from(byte == b'\n');
        }
        Ok(byte)
    }

    fn expected(&self, what: &str) -> Stop {
        expected(self.line, what).into()
    }

    /// Leaves out white space and comments; a slash that begins neither is a sign.
    fn skip(&mut self) -> Result<bool, Stop> {
        while let Some(byte) = self.peek()? {
            if byte == b'/' {
                self.take()?;
                match self.take()? {
                    Some(b'/') => while !matches!(self.take()?, None | Some(b'\n')) {},
                    Some(b'*') => self.skip_comment()?,
                    _ => return Ok(true),
                }
            } else if byte.is_ascii_whitespace() {
                self.take()?;
            } else {
                break;
            }
        }
        Ok(false)
    }

    fn skip_comment(&mut self) -> Result<(), Stop> {
        let mut last = 0;
        loop {
            match self.take()? {
                None => return Err(self.expected("the end of a comment")),
                Some(b'/') if last == b'*' => return Ok(()),
                Some(byte) => last = byte,
            }
        }
    }

    pub(super) fn next(&mut self) -> Result<Token, Stop> {
        if self.skip()? {
            return Ok(Token::Sign(b'/'));
        }
        let Some(first) = self.take()? else { return Ok(Token::End) };
        let is_word = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'$');
        if first == b'"' {
            return self.text();
        }
        let is_number = first.is_ascii_digit() || matches!(first, b'-' | b'+' | b'.');
        if !is_number && !is_word(first) {
            return Ok(Token::Sign(first));
        }
        let mut word = vec![first];
        while let Some(byte) = self.peek()? {
            // An exponent has a sign.
            let signed = is_number && matches!(byte, b'-' | b'+') && matches!(word.last(), Some(b'e' | b'E'));
            if !(is_word(byte) || signed || is_number && byte == b'.') {
                break;
            }
            self.take()?;
            if word.len() == LONGEST_WORD {
                return Err(self.expected("a value"));
            }
            word.push(byte);
        }
        let word = String::from_utf8_lossy(&word).into_owned();
        if !is_number {
            return Ok(match word.as_str() {
                // OpenSCAD prints infinities and NaN so.
                "inf" => Token::Number(f64::INFINITY),
                "nan" => Token::Number(f64::NAN),
                _ => Token::Name(word),
            });
        }
        match word.as_str() {
            "-inf" => Ok(Token::Number(f64::NEG_INFINITY)),
            _ => match word.parse() {
                Ok(number) if word.ends_with(|c: char| c.is_ascii_digit() || c == '.') => {
                    Ok(Token::Number(number))
                }
                _ => Err(bad!(
                    "{}{} is not a number; write it with digits and a decimal point",
                    At(self.line),
                    shown(&word)
                )
                .into()),
            },
        }
    }

    fn text(&mut self) -> Result<Token, Stop> {
        let mut text = Vec::new();
        loop {
            match self.take()? {
                None => return Err(self.expected("the end of a text in quotes")),
                Some(b'"') => return Ok(Token::Text(String::from_utf8_lossy(&text).into_owned())),
                Some(b'\\') => match self.take()? {
                    Some(byte @ (b'"' | b'\\')) => text.push(byte),
                    _ => return Err(self.expected("the end of a text in quotes")),
                },
                Some(_) if text.len() == LONGEST_TEXT => {
                    return Err(self.expected("the end of a text in quotes"));
                }
                Some(byte) => text.push(byte),
            }
        }
    }
}
