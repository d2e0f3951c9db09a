//! Parsing of modules and their blocks into a tree.

use std::io::BufRead;
use std::path::Path;

use super::Stop;
use super::lexer::{Lexer, Token};
use super::modules::{Block, Meaning, childless, doubled, made_bytes, meaning};
use super::values::{Arguments, MAX_NAME};
use crate::csg::fault::{At, expected, unsupported, variable};
use crate::csg::tree::{NodeId, Operation, Tree, boxed, push};
use crate::fault::bad;
use crate::geom::Affine;

struct OpenBlock {
    block: Block<()>,
    /// Index of its first child among the waiting nodes.
    first: usize,
    /// Heights between which its flat shapes are extruded.
    extruded: Option<Box<[f64; 2]>>,
    line: u64,
    /// True if it is left out, with all its content.
    left_out: bool,
    /// True if it has no braces, only the one module that follows.
    single: bool,
    /// `$fn` for modules in it that state none.
    facets: Option<f64>,
}

/// Frees unused room of a list, as the tree grows while the blocks of a deep one are closed.
fn shrink<T>(list: &mut Vec<T>) {
    let len = list.len();
    if len + len / 7 + 64 < list.capacity() {
        list.shrink_to(len + len / 16);
    }
}

struct Parser<'a> {
    lexer: Lexer<'a>,
    folder: &'a Path,
    most_bytes: u64,
    tree: Tree,
    open: Vec<OpenBlock>,
    /// Affines of open blocks. (Boxes of their own would leave holes in the allocator's heap that the smaller ones of
    /// the tree do not fill.)
    places: Vec<Affine>,
    /// Nodes that wait for their block to be closed.
    waiting: Vec<NodeId>,
    /// Bytes of the boxes of open blocks.
    boxed_bytes: u64,
    /// The beginning of a module, read ahead.
    pending: Option<Token>,
}

/// Reads a text; files that it names lie in `folder`.
///
/// # Errors
/// A fault of the text, with the line.
pub(in crate::csg) fn parse(
    input: &mut dyn BufRead,
    folder: &Path,
    most_bytes: u64,
) -> Result<(Tree, NodeId), Stop> {
    let top = Block::Joined(Operation::Union);
    let mut parser = Parser {
        lexer: Lexer::new(input)?,
        folder,
        most_bytes,
        tree: Tree::new(),
        open: vec![OpenBlock {
            block: top,
            first: 0,
            extruded: None,
            line: 1,
            left_out: false,
            single: false,
            facets: None,
        }],
        places: Vec::new(),
        waiting: Vec::new(),
        boxed_bytes: 0,
        pending: None,
    };
    while parser.step()? {
        parser.hold(0)?;
    }
    let root = parser.tree.join(Operation::Union, &parser.waiting);
    Ok((parser.tree, root))
}

/// Bytes of a block's box.
fn boxed_bytes(extruded: bool) -> u64 {
    if extruded { boxed::<[f64; 2]>() as u64 } else { 0 }
}

impl Parser<'_> {
    fn bytes(&self) -> u64 {
        let lists = self.waiting.capacity() * size_of::<NodeId>()
            + self.open.capacity() * size_of::<OpenBlock>()
            + self.places.capacity() * size_of::<Affine>();
        self.tree.bytes() + lists as u64 + self.boxed_bytes
    }

    /// Checks that there is memory for `more_bytes` besides those held.
    fn hold(&self, more_bytes: u64) -> Result<(), Stop> {
        let bytes = self.bytes() + more_bytes;
        if bytes > self.most_bytes { Err(Stop::Memory { bytes }) } else { Ok(()) }
    }

    /// Reads a module or the end of a block; `false` at the end of the text.
    fn step(&mut self) -> Result<bool, Stop> {
        let token = match self.pending.take() {
            Some(token) => token,
            None => self.lexer.next()?,
        };
        let expected = |parser: &Self, what| Stop::from(expected(parser.lexer.line(), what));
        match token {
            Token::Sign(b';') => {}
            Token::Sign(b'}') if self.open.len() > 1 => self.close()?,
            Token::End if self.open.len() == 1 => return Ok(false),
            Token::End => return Err(expected(self, "} before the end of the file")),
            Token::Sign(mut mark @ (b'#' | b'%' | b'*')) => {
                // Background and disabled modules are read and left out; # only marks.
                let mut left_out = false;
                let name = loop {
                    left_out |= mark != b'#';
                    match self.lexer.next()? {
                        Token::Sign(next @ (b'#' | b'%' | b'*')) => mark = next,
                        Token::Name(name) => break name,
                        _ => return Err(expected(self, "the name of a module")),
                    }
                };
                self.module(name, left_out)?;
            }
            Token::Name(name) => self.module(name, false)?,
            _ => return Err(expected(self, "the name of a module")),
        }
        Ok(true)
    }

    /// Reads a module from behind its name to its `;` or `{`.
    fn module(&mut self, name: String, left_out: bool) -> Result<(), Stop> {
        let line = self.lexer.line();
        let (extruded, above_out) = self
            .open
            .last()
            .map_or((None, false), |above| (above.extruded.as_deref().copied(), above.left_out));
        let left_out = left_out || above_out;
        let expected = |line, what| Stop::from(expected(line, what));
        match self.lexer.next()? {
            Token::Sign(b'(') => {}
            Token::Sign(b'=') => return self.assignment(&name, line),
            Token::Name(_) | Token::Sign(b'<') => return Err(unsupported(line, &name).into()),
            _ => return Err(expected(self.lexer.line(), "( behind the name of a module")),
        }
        let held = self.bytes();
        let room = self.most_bytes.saturating_sub(held);
        let mut arguments =
            Arguments::read(&mut self.lexer, name, line, room).map_err(|stop| match stop {
                Stop::Memory { bytes } => Stop::Memory { bytes: held + bytes },
                other => other,
            })?;
        // A block's fineness applies to its content.
        arguments.facets = self.open.last().and_then(|above| above.facets);
        arguments.facets = arguments.number("$fn", None)?.or(arguments.facets);
        let facets = arguments.facets;
        self.hold(arguments.bytes() + made_bytes(&arguments))?;
        let meant = meaning(&arguments, extruded, self.folder)?;
        if let Some(note) = doubled(&arguments).filter(|_| !left_out) {
            self.tree.note(note);
        }
        let union = Block::Joined(Operation::Union);
        let (block, extruded) = match meant {
            Meaning::Leaf(shape) => {
                if !left_out {
                    let leaf = self.tree.leaf_of_line(shape, line);
                    push(&mut self.waiting, leaf);
                }
                // A leaf has no children; any that are there are ignored.
                return match self.lexer.next()? {
                    Token::Sign(b';') => self.close_singles(),
                    Token::Sign(b'{') => {
                        self.begin(union, extruded, line, true, facets);
                        let next = self.lexer.next()?;
                        if !left_out && !matches!(next, Token::Sign(b'}' | b';')) {
                            self.tree.note(childless(&arguments));
                        }
                        self.pending = Some(next);
                        Ok(())
                    }
                    _ => Err(expected(self.lexer.line(), "; or { behind a module")),
                };
            }
            Meaning::Block(block) => (block, extruded),
            Meaning::Extruded(z) => (union, Some(z)),
        };
        let token = self.lexer.next()?;
        match token {
            Token::Sign(b'{') => self.begin(block, extruded, line, left_out, facets),
            Token::Sign(b';') => {
                self.begin(block, extruded, line, left_out, facets);
                self.close()?;
            }
            // A module that follows at once, without braces, is the only child.
            Token::Name(_) | Token::Sign(b'#' | b'%' | b'*') => {
                self.begin(block, extruded, line, left_out, facets);
                if let Some(open) = self.open.last_mut() {
                    open.single = true;
                }
                self.pending = Some(token);
            }
            _ => return Err(expected(self.lexer.line(), "; or { behind a module")),
        }
        Ok(())
    }

    /// Reads an assignment; only the fineness of round solids counts, for all that follows.
    fn assignment(&mut self, name: &str, line: u64) -> Result<(), Stop> {
        if !matches!(name, "$fn" | "$fa" | "$fs" | "$fe") {
            let name: String = name.chars().take(MAX_NAME).collect();
            return Err(variable(line, &name).into());
        }
        let expected = |parser: &Self, what| Stop::from(expected(parser.lexer.line(), what));
        let Token::Number(number) = self.lexer.next()? else { return Err(expected(self, "a number")) };
        if self.lexer.next()? != Token::Sign(b';') {
            return Err(expected(self, "; behind a number"));
        }
        if name == "$fn" {
            let is_late = self.open.len() > 1 || !self.tree.is_empty();
            if is_late {
                return Err(bad!(
                    "{}$fn counts for all that stands before it, too; set it once, in the first line",
                    At(line)
                )
                .into());
            }
            self.open.iter_mut().for_each(|top| top.facets = Some(number));
        }
        Ok(())
    }

    fn begin(
        &mut self,
        block: Block<Affine>,
        extruded: Option<[f64; 2]>,
        line: u64,
        left_out: bool,
        facets: Option<f64>,
    ) {
        let first = self.waiting.len();
        self.boxed_bytes += boxed_bytes(extruded.is_some());
        let extruded = extruded.map(Box::new);
        let block = match block {
            Block::Placed(affine) => {
                push(&mut self.places, affine);
                Block::Placed(())
            }
            Block::Joined(operation) => Block::Joined(operation),
            Block::Offset(by) => Block::Offset(by),
            Block::Resized(size) => Block::Resized(size),
        };
        push(&mut self.open, OpenBlock { block, first, extruded, line, left_out, single: false, facets });
    }

    /// Closes the block that was opened last, and the blocks around it without braces.
    fn close(&mut self) -> Result<(), Stop> {
        self.close_last()?;
        self.close_singles()
    }

    fn close_singles(&mut self) -> Result<(), Stop> {
        while self.open.last().is_some_and(|open| open.single) {
            self.close_last()?;
        }
        Ok(())
    }

    /// Makes a node of the children of the block that was opened last.
    fn close_last(&mut self) -> Result<(), Stop> {
        let Some(block) = self.open.pop() else { return Ok(()) };
        self.boxed_bytes = self.boxed_bytes.saturating_sub(boxed_bytes(block.extruded.is_some()));
        let place = if matches!(block.block, Block::Placed(())) { self.places.pop() } else { None };
        shrink(&mut self.open);
        shrink(&mut self.places);
        if block.left_out {
            return Ok(());
        }
        let children = &self.waiting[block.first..];
        let operation = match block.block {
            Block::Joined(operation) => operation,
            Block::Placed(()) | Block::Offset(_) | Block::Resized(_) => Operation::Union,
        };
        let is_one = children.len() == 1 && operation != Operation::Complement;
        let mut node = if is_one { children[0] } else { self.tree.join(operation, children) };
        match block.block {
            Block::Joined(_) => {}
            Block::Placed(()) => {
                node = place.map_or(node, |place| self.tree.placed_of_line(place, node, block.line));
            }
            Block::Resized(size) => {
                let room = self.most_bytes.saturating_sub(self.bytes());
                let place = self.tree.resized(node, &size, block.line, room)?;
                let place = place.ok_or_else(|| Stop::Memory { bytes: self.bytes() + room })?;
                node = self.tree.placed_of_line(place, node, block.line);
            }
            Block::Offset(by) => {
                let made = self.tree.offset_within(by, node, block.line, self.most_bytes)?;
                node = made.ok_or_else(|| Stop::Memory { bytes: self.bytes() })?;
            }
        }
        self.waiting.truncate(block.first);
        push(&mut self.waiting, node);
        Ok(())
    }
}
