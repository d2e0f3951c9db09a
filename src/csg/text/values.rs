//! The arguments of a module: numbers, words, texts and lists.

use super::Stop;
use super::lexer::{Lexer, Token};
use crate::csg::fault::{At, bad_argument, expected, singular};
use crate::csg::tree::push;
use crate::fault::{Fault, bad};
use crate::geom::Affine;
use crate::text::shown;

/// Greatest depth of lists in lists: the rows of a list of lists.
const DEEPEST: usize = 4;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Number(f64),
    Flag(bool),
    Text(String),
    /// Numbers, and the bounds of the lists within.
    List(List),
    /// `undef`.
    Nothing,
}

/// A list, or a list of lists of numbers: their numbers one after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct List {
    pub(super) numbers: Vec<f64>,
    /// End of each inner list.
    pub(super) ends: Vec<usize>,
    depth: usize,
    /// True if there is anything but numbers.
    mixed: bool,
    /// The first three of `true` and `false`.
    flags: Vec<bool>,
}

impl List {
    pub(super) fn rows(&self) -> impl Iterator<Item = &[f64]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(from, to)| &self.numbers[from..*to])
    }

    /// The inner lists, if each has `N` numbers.
    pub(super) fn rows_of<const N: usize>(&self) -> Option<Vec<[f64; N]>> {
        let whole = self.depth == 2 && !self.mixed && self.ends.last() == Some(&self.numbers.len());
        if !whole {
            return (self.numbers.is_empty() && self.depth <= 2).then(Vec::new);
        }
        let mut rows = Vec::with_capacity(self.ends.len());
        for row in self.rows() {
            rows.push(row.try_into().ok()?);
        }
        Some(rows)
    }

    /// Memory that it holds.
    fn bytes(&self) -> u64 {
        (self.numbers.capacity() * size_of::<f64>() + self.ends.capacity() * size_of::<usize>()) as u64
    }

    /// Lists of any length, of whole numbers.
    pub(super) fn indices(&self) -> Option<Vec<Vec<u32>>> {
        let mut all = Vec::new();
        self.each_indices(&mut |row| {
            all.push(row.to_vec());
            Some(())
        })?;
        Some(all)
    }

    /// Calls `each` with every one of them, until it returns nothing.
    pub(super) fn each_indices(&self, each: &mut dyn FnMut(&[u32]) -> Option<()>) -> Option<()> {
        if self.mixed || self.depth > 2 {
            return None;
        }
        let mut indices = Vec::new();
        #[expect(clippy::cast_possible_truncation, reason = "compared with the number")]
        let index = |n: &f64| (*n >= 0.0 && *n < 4e9 && n.fract() == 0.0).then_some(*n as u32);
        for row in self.rows() {
            indices.clear();
            for number in row {
                indices.push(index(number)?);
            }
            each(&indices)?;
        }
        Some(())
    }
}

pub(super) struct Arguments {
    pub(super) line: u64,
    pub(super) module: String,
    /// `$fn`, its own or the surrounding block's.
    pub(super) facets: Option<f64>,
    named: Vec<(String, Value)>,
    placed: Vec<Value>,
}

/// Most letters of a name in a message.
pub(super) const MAX_NAME: usize = 40;
/// Arguments that OpenSCAD gives any module: the fineness of round shapes, and hints for its preview.
const SPECIAL: [&str; 5] = ["$fn", "$fa", "$fs", "$fe", "convexity"];

/// Most arguments of a module.
const MAX: usize = 64;

impl Arguments {
    /// Reads them from behind the opening bracket to the closing one, within `most_bytes`.
    ///
    /// # Errors
    /// A fault of the text; [`Stop::Memory`] with the bytes needed.
    pub(super) fn read(
        lexer: &mut Lexer<'_>,
        module: String,
        line: u64,
        most_bytes: u64,
    ) -> Result<Self, Stop> {
        let mut all = Self { line, module, facets: None, named: Vec::new(), placed: Vec::new() };
        let missing = |line: u64, what| Stop::from(expected(line, what));
        let mut token = lexer.next()?;
        while token != Token::Sign(b')') {
            if all.named.len() + all.placed.len() == MAX {
                return Err(missing(lexer.line(), ", or ) behind an argument"));
            }
            let mut name = None;
            if let Token::Name(word) = &token
                && !matches!(word.as_str(), "true" | "false" | "undef")
            {
                name = Some(word.clone());
                if lexer.next()? != Token::Sign(b'=') {
                    return Err(missing(lexer.line(), "a value"));
                }
                token = lexer.next()?;
            }
            let held = all.bytes();
            let value = value(lexer, token, most_bytes.saturating_sub(held)).map_err(|stop| match stop {
                Stop::Memory { bytes } => Stop::Memory { bytes: held + bytes },
                other => other,
            })?;
            match name {
                Some(name) if all.named.iter().any(|(known, _)| *known == name) => {
                    return Err(all.twice(&name).into());
                }
                Some(name) => all.named.push((name, value)),
                None if !all.named.is_empty() => return Err(all.surplus(&value).into()),
                None => all.placed.push(value),
            }
            token = match lexer.next()? {
                Token::Sign(b',') => lexer.next()?,
                Token::Sign(b')') => break,
                _ => return Err(missing(lexer.line(), ", or ) behind an argument")),
            };
        }
        Ok(all)
    }

    /// The refusal of a second value of a name.
    fn twice(&self, name: &str) -> Fault {
        let name: String = name.chars().take(MAX_NAME).collect();
        bad!("{}{} has {} twice; leave one out", At(self.line), shown(&self.module), shown(&name))
    }

    /// The refusal of a value without a name behind one with a name: mostly the decimals behind a comma.
    fn surplus(&self, value: &Value) -> Fault {
        let (at, module) = (At(self.line), shown(&self.module));
        let text = match value {
            Value::Number(number) => format!("{number} "),
            _ => String::new(),
        };
        bad!(
            "{at}{module} has a value {text}without a name behind one with a name; write decimals behind a point, and values without names first"
        )
    }

    /// Memory that its lists hold.
    pub(super) fn bytes(&self) -> u64 {
        let values = self.named.iter().map(|(_, value)| value).chain(&self.placed);
        values.map(|value| if let Value::List(list) = value { list.bytes() } else { 0 }).sum()
    }

    /// The value of a name, or of the place where it may stand without a name.
    pub(super) fn value(&self, name: &str, place: Option<usize>) -> Option<&Value> {
        let named = self.named.iter().rev().find(|(own, _)| own == name).map(|(_, value)| value);
        let value = named.or_else(|| self.placed.get(place?));
        value.filter(|value| **value != Value::Nothing)
    }

    /// Refuses names that the module does not take, and more values than it has places: a misspelt name would
    /// change the solid without a word.
    pub(super) fn only(&self, known: &'static [&'static str], places: usize) -> Result<(), Fault> {
        let stranger = self
            .named
            .iter()
            .find(|(name, _)| !known.contains(&name.as_str()) && !SPECIAL.contains(&name.as_str()));
        let given = known.iter().take(self.placed.len().min(places));
        if let Some(name) = given.clone().find(|name| self.named.iter().any(|(own, _)| own == *name)) {
            return Err(self.twice(name));
        }
        let argument = stranger.map(|(name, _)| name.chars().take(MAX_NAME).collect::<String>());
        if argument.is_none() && self.placed.len() <= places {
            return Ok(());
        }
        let (at, module) = (At(self.line), shown(&self.module));
        let taken = match known {
            [] => "leave it out".to_owned(),
            _ => format!("it takes {}", known.join(", ")),
        };
        Err(match argument {
            Some(name) => bad!("{at}{module} does not take {}; {taken}", shown(&name)),
            None => bad!("{at}{module} has more values than it takes; {taken}"),
        })
    }

    /// The refusal of an argument.
    pub(super) fn wrong(&self, argument: &'static str) -> Fault {
        bad_argument(self.line, &self.module, argument)
    }

    /// A number, if stated.
    pub(super) fn number(&self, name: &'static str, place: Option<usize>) -> Result<Option<f64>, Fault> {
        match self.value(name, place) {
            None => Ok(None),
            Some(Value::Number(number)) => Ok(Some(*number)),
            Some(_) => Err(self.wrong(name)),
        }
    }

    /// A finite number that must be there.
    pub(super) fn need(&self, name: &'static str, place: Option<usize>) -> Result<f64, Fault> {
        self.number(name, place)?.filter(|n| n.is_finite()).ok_or_else(|| self.wrong(name))
    }

    /// A boolean; false if not stated.
    pub(super) fn flag(&self, name: &'static str, place: Option<usize>) -> Result<bool, Fault> {
        match self.value(name, place) {
            None => Ok(false),
            Some(Value::Flag(flag)) => Ok(*flag),
            Some(_) => Err(self.wrong(name)),
        }
    }

    /// `N` numbers; a single one stands for all of them.
    pub(super) fn numbers<const N: usize>(
        &self,
        name: &'static str,
        place: Option<usize>,
    ) -> Result<Option<[f64; N]>, Fault> {
        match self.value(name, place) {
            None => Ok(None),
            Some(Value::Number(number)) => Ok(Some([*number; N])),
            Some(Value::List(list)) if list.depth == 1 && !list.mixed => {
                list.numbers.as_slice().try_into().map(Some).map_err(|_| self.wrong(name))
            }
            Some(_) => Err(self.wrong(name)),
        }
    }

    pub(super) fn list(&self, name: &'static str, place: Option<usize>) -> Result<Option<&List>, Fault> {
        match self.value(name, place) {
            None => Ok(None),
            Some(Value::List(list)) => Ok(Some(list)),
            Some(_) => Err(self.wrong(name)),
        }
    }

    /// A text that must be there.
    pub(super) fn text(&self, name: &'static str, place: Option<usize>) -> Result<&str, Fault> {
        match self.value(name, place) {
            Some(Value::Text(text)) => Ok(text),
            _ => Err(self.wrong(name)),
        }
    }

    /// Refuses a colour that is neither a name nor three or four numbers.
    pub(super) fn color(&self) -> Result<(), Fault> {
        let is_color = match self.value("c", Some(0)) {
            None | Some(Value::Text(_)) => true,
            Some(Value::List(list)) => list.depth == 1 && !list.mixed && matches!(list.numbers.len(), 3 | 4),
            Some(_) => false,
        };
        self.number("alpha", Some(1))?;
        if is_color { Ok(()) } else { Err(self.wrong("c")) }
    }

    /// Two or three numbers, or one for all; `missing` is the third of two.
    pub(super) fn vector(
        &self,
        name: &'static str,
        place: usize,
        missing: f64,
    ) -> Result<Option<[f64; 3]>, Fault> {
        let flat = self.list(name, Some(place)).ok().flatten().filter(|list| list.numbers.len() == 2);
        let vector = match flat {
            Some(_) => self.numbers::<2>(name, Some(place))?.map(|[x, y]| [x, y, missing]),
            None => self.numbers::<3>(name, Some(place))?,
        };
        if vector.is_some_and(|v| !v.iter().all(|c| c.is_finite())) {
            Err(self.wrong(name))
        } else {
            Ok(vector)
        }
    }

    /// A boolean for each axis; one stands for all.
    pub(super) fn flags(&self, name: &'static str, place: Option<usize>) -> Result<[bool; 3], Fault> {
        match self.value(name, place) {
            Some(Value::List(list)) if list.depth == 1 && list.numbers.is_empty() => {
                let flags = list.flags.as_slice();
                flags.try_into().map_err(|_| self.wrong(name))
            }
            _ => Ok([self.flag(name, place)?; 3]),
        }
    }

    /// The matrix of `multmatrix`, whose last row is 0, 0, 0, 1.
    pub(super) fn matrix(&self) -> Result<Affine, Fault> {
        let wrong = || self.wrong("m");
        let rows = self.list("m", Some(0))?.and_then(List::rows_of::<4>).ok_or_else(wrong)?;
        let (Some(head), last) = (rows.first_chunk::<3>(), rows.get(3)) else { return Err(wrong()) };
        if rows.len() > 4 || last.is_some_and(|last| *last != [0.0, 0.0, 0.0, 1.0]) {
            return Err(wrong());
        }
        if !head.iter().flatten().all(|c| c.is_finite()) {
            return Err(singular(self.line));
        }
        Ok(Affine { rows: *head })
    }
}

/// The value that begins with a token.
fn value(lexer: &mut Lexer<'_>, token: Token, most_bytes: u64) -> Result<Value, Stop> {
    match token {
        Token::Number(number) => Ok(Value::Number(number)),
        Token::Text(text) => Ok(Value::Text(text)),
        Token::Name(word) => match word.as_str() {
            "true" => Ok(Value::Flag(true)),
            "false" => Ok(Value::Flag(false)),
            "undef" => Ok(Value::Nothing),
            _ => Err(expected(lexer.line(), "a value").into()),
        },
        Token::Sign(b'[') => list(lexer, most_bytes).map(Value::List),
        _ => Err(expected(lexer.line(), "a value").into()),
    }
}

/// The list behind an opening bracket. Items are separated by commas, of which one may stand behind the last.
fn list(lexer: &mut Lexer<'_>, most_bytes: u64) -> Result<List, Stop> {
    let mut all = List { depth: 1, ..List::default() };
    let mut depth = 1;
    // True behind an item, where a comma or the end has to follow.
    let mut behind = false;
    loop {
        let token = lexer.next()?;
        let is_item = matches!(token, Token::Number(_) | Token::Text(_) | Token::Name(_) | Token::Sign(b'['));
        if is_item && std::mem::replace(&mut behind, true) || token == Token::Sign(b',') && !behind {
            return Err(expected(lexer.line(), "one comma between the items of a list").into());
        }
        match token {
            Token::Sign(b'[') if depth < DEEPEST => {
                // Numbers before a list lie in no list.
                all.mixed |= depth == 1 && all.ends.last().copied().unwrap_or(0) != all.numbers.len();
                depth += 1;
                all.depth = all.depth.max(depth);
                behind = false;
            }
            Token::Sign(b']') => {
                depth -= 1;
                behind = true;
                match depth {
                    0 => return Ok(all),
                    1 => push(&mut all.ends, all.numbers.len()),
                    _ => {}
                }
            }
            Token::Number(number) => push(&mut all.numbers, number),
            Token::Sign(b',') if all.bytes() > most_bytes => {
                return Err(Stop::Memory { bytes: all.bytes() });
            }
            Token::Sign(b',') => behind = false,
            Token::Name(word) if all.flags.len() < 3 && matches!(word.as_str(), "true" | "false") => {
                all.mixed = true;
                all.flags.push(word == "true");
            }
            Token::Text(_) | Token::Name(_) => all.mixed = true,
            Token::Sign(_) | Token::End => {
                return Err(expected(lexer.line(), "the ] of a list").into());
            }
        }
    }
}
