//! Counts of a text, from which follows what its tree takes.

use std::io::BufRead;

use super::Stop;
use super::lexer::{Lexer, Token};
use super::modules::{MAX_SIDES, is_block};
use super::parser::OPEN_BYTES;
use crate::csg::leaf::{Block, Body, Curved, Half, along_axes, round};
use crate::csg::tree::{LISTS, Node, NodeId, Shape, boxed, grown, room, shrunk};
use crate::geom::Affine;
use crate::mesh::Triangle;

/// What a text has, and what is made of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::csg) struct TextCounts {
    /// Modules without children; those of them that name files.
    pub(in crate::csg) leaves: u64,
    pub(in crate::csg) files: u64,
    /// Blocks that join other than one child, and children of these; blocks that place and that only move.
    pub(in crate::csg) joins: u64,
    pub(in crate::csg) children: u64,
    placed: u64,
    moved: u64,
    /// Bytes of its lists.
    lists: u64,
    /// Joins without children.
    pub(in crate::csg) empty: u64,
    /// Most blocks that place at a time.
    pub(in crate::csg) depth: u64,
    /// Bytes of points and triangles in the tree; what placed leaves hold outside themselves; the most that making
    /// one of them takes on top of those before.
    faces: u64,
    pub(in crate::csg) held: u64,
    pub(in crate::csg) making: u64,
    /// The most that a tree and its open blocks take at a time.
    pub(in crate::csg) peak_bytes: u64,
}

impl TextCounts {
    /// What the whole tree takes.
    pub(in crate::csg) fn tree_bytes(&self) -> u64 {
        let boxes = self.leaves * boxed::<Shape>() as u64
            + self.placed * boxed::<(Affine, u32)>() as u64
            + self.moved * boxed::<([f64; 3], u32)>() as u64;
        self.lists + boxes + self.faces
    }
}

/// What is known of an open block, in two bytes, as texts nest blocks by the hundred thousand.
type Open = u16;

/// Has it a child, or several?
const ONE: Open = 1;
const MANY: Open = 2;
/// Is it placed, and only moved?
const PLACED: Open = 4;
const MOVED: Open = 8;
/// Do axes within not run along those outside, or are spheres within none outside?
const TURNED: Open = 16;
const STRETCHED: Open = 32;
/// Is it left out?
const OUT: Open = 64;
/// Has it no braces, but the one module that follows?
const SINGLE: Open = 128;
/// Is it grown or shrunk?
const OFFSET: Open = 256;

/// What blocks hand on to those within.
const HANDED_ON: Open = TURNED | STRETCHED | OUT | OFFSET;

/// Numbers of a list, and lists within.
#[derive(Clone, Copy, Default)]
struct Listed {
    numbers: u64,
    rows: u64,
}

/// The module that is being read, and what of its arguments decides about memory.
#[derive(Default)]
struct Module {
    name: String,
    left_out: bool,
    argument: Option<String>,
    place: usize,
    /// How deep lists are open.
    depth: u32,
    /// Points, and the lists that name them.
    lists: [Listed; 2],
    numbers: usize,
    first: [f64; 12],
    sides: f64,
}

impl Module {
    fn take(&mut self, token: Token) {
        match token {
            Token::Name(name) if self.depth == 0 => self.argument = Some(name),
            Token::Sign(b',') if self.depth == 0 => {
                self.place += usize::from(self.argument.take().is_none());
            }
            Token::Sign(b'[') => {
                self.depth += 1;
                if let Some(list) = self.list().filter(|_| self.depth == 2) {
                    self.lists[list].rows += 1;
                }
            }
            Token::Sign(b']') => self.depth = self.depth.saturating_sub(1),
            Token::Number(number) => {
                if let Some(place) = self.first.get_mut(self.numbers) {
                    *place = number;
                }
                self.numbers += 1;
                if let Some(list) = self.list() {
                    self.lists[list].numbers += 1;
                }
                if self.argument.as_deref() == Some("$fn") {
                    self.sides = number;
                }
            }
            _ => {}
        }
    }

    fn list(&self) -> Option<usize> {
        match self.argument.as_deref() {
            None => Some(self.place).filter(|place| *place < 2),
            Some("points") => Some(0),
            Some("faces" | "triangles" | "paths") => Some(1),
            Some(_) => None,
        }
    }

    /// Points and triangles of what has plane faces.
    fn faces(&self) -> Option<[u64; 2]> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "3 to 256")]
        let sides = (self.sides > 0.0 && self.sides <= MAX_SIDES).then_some(self.sides.max(3.0) as u64);
        let [points, lists] = self.lists;
        Some(match (self.name.as_str(), sides) {
            ("polyhedron", _) => [points.numbers / 3, lists.numbers.saturating_sub(2 * lists.rows)],
            ("polygon", _) => {
                let (corners, paths) =
                    if lists.rows == 0 { (points.numbers / 2, 1) } else { (lists.numbers, lists.rows) };
                [2 * corners, (4 * corners).saturating_sub(4 * paths)]
            }
            ("sphere", Some(n)) => [n * n.div_ceil(2), 2 * n * n.div_ceil(2) - 4],
            ("cylinder" | "circle", Some(n)) => [2 * n, 4 * n - 4],
            _ => return None,
        })
    }

    /// What reading it takes: its lists, and what is made of them.
    fn read_bytes(&self) -> u64 {
        let listed: u64 = self.lists.iter().map(|list| 8 * (room(list.numbers) + room(list.rows))).sum();
        listed
            + match (self.name.as_str(), self.faces()) {
                // Rings and outlines, too.
                ("polygon", _) => self.lists[0].numbers * 80,
                (_, Some([points, triangles])) => 24 * points + 12 * triangles,
                _ => 0,
            }
    }

    /// The block that it opens within another one.
    fn open(&self, above: Open) -> Open {
        let mut open = above & HANDED_ON | if self.left_out { OUT } else { 0 };
        open |= if self.name == "offset3d" { OFFSET } else { 0 };
        if self.name == "multmatrix" {
            let [a, b, c, _, d, e, f, _, g, h, i, _] = self.first;
            let columns = [[a, d, g], [b, e, h], [c, f, i]];
            open |= PLACED;
            if columns == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
                open |= MOVED;
            }
            if !along_axes(&columns) {
                open |= TURNED;
            }
            if round(&columns).is_none() {
                open |= STRETCHED;
            }
        }
        open
    }
}

impl TextCounts {
    /// Counts a module without children within a block.
    fn leaf(&mut self, module: &Module, open: Open) {
        self.leaves += 1;
        let curved = boxed::<Curved>() as u64;
        self.files += u64::from(matches!(module.name.as_str(), "mesh" | "import" | "volume"));
        let triangle = size_of::<Triangle>() as u64;
        if let Some([points, triangles]) = module.faces() {
            self.faces += LISTS as u64 + 24 * points + 12 * triangles;
            self.making = self.making.max(self.held + 36 * (points + triangles));
            self.held += boxed::<Body>() as u64 + triangle * triangles;
            return;
        }
        if open & OFFSET != 0 {
            // Boxes get edges and corners, cylinders rims; the others are made larger.
            let pieces = match module.name.as_str() {
                "cube" => 23,
                "cylinder" => 7,
                _ => 1,
            };
            self.leaves += pieces;
            self.placed += pieces;
            self.children += pieces;
            self.joins += 1;
            self.held += pieces * curved;
        }
        self.held += match module.name.as_str() {
            "cube" | "square" if open & TURNED != 0 => boxed::<Body>() as u64 + 12 * triangle,
            "cube" | "square" => boxed::<Block>() as u64,
            "sphere" if open & STRETCHED == 0 => 0,
            "halfspace" => boxed::<Half>() as u64,
            _ => curved,
        };
    }

    fn close(&mut self, block: Open) {
        self.empty += u64::from(block & (ONE | MANY) == 0);
        self.joins += u64::from(block & (ONE | MANY) != ONE);
        self.placed += u64::from(block & (PLACED | MOVED) == PLACED);
        self.moved += u64::from(block & MOVED != 0);
    }

    fn child(&mut self, above: &mut Open) {
        if *above & MANY != 0 {
            self.children += 1;
        } else if *above & ONE != 0 {
            self.children += 2;
            *above ^= ONE | MANY;
        } else {
            *above |= ONE;
        }
    }
}

/// The room of a list, as [`push`](crate::csg::tree::push) makes it.
#[derive(Default)]
struct Room(usize);

impl Room {
    fn grow(&mut self, len: usize) {
        while self.0 < len {
            self.0 += grown(self.0);
        }
    }

    fn shrink(&mut self, len: usize) {
        self.0 = shrunk(len, self.0).unwrap_or(self.0);
    }

    fn bytes<T>(&self) -> u64 {
        (self.0 * size_of::<T>()) as u64
    }
}

/// What a parser holds of lists, as it would.
#[derive(Default)]
struct Rooms {
    nodes: Room,
    children: Room,
    open: Room,
    places: Room,
    waiting: Room,
}

impl Rooms {
    /// Follows the lists to their lengths; gives the bytes of those of open blocks.
    fn follow(&mut self, counts: &mut TextCounts, [open, places]: [usize; 2]) -> u64 {
        let len = |count: u64| usize::try_from(count).unwrap_or(usize::MAX / 2);
        self.nodes.grow(len(counts.leaves + counts.joins + counts.placed + counts.moved));
        self.children.grow(len(counts.children));
        self.open.grow(open);
        self.open.shrink(open);
        self.places.grow(places);
        self.places.shrink(places);
        // Those of blocks that are closed among them.
        self.waiting.grow(len(counts.children));
        counts.lists = self.nodes.bytes::<Node>() + self.children.bytes::<NodeId>();
        self.open.0 as u64 * OPEN_BYTES + self.places.bytes::<Affine>() + self.waiting.bytes::<NodeId>()
    }
}

/// Counts, in two bytes for every open block; faults are left to the parser.
///
/// # Errors
/// A malformed token; the text cannot be read.
pub(in crate::csg) fn count(input: &mut dyn BufRead) -> Result<TextCounts, Stop> {
    let (mut lexer, mut counts) = (Lexer::new(input), TextCounts::default());
    let mut open: Vec<Open> = vec![0];
    let (mut module, mut brackets, mut behind_module, mut placing) = (Module::default(), 0_u64, false, 0);
    let (mut left_out, mut rooms) = (false, Rooms::default());
    let close = |open: &mut Vec<Open>, counts: &mut TextCounts, placing: &mut u64| {
        let Some(last) = open.pop() else { return };
        *placing -= u64::from(last & PLACED != 0);
        if last & OUT == 0 {
            counts.close(last);
            open.last_mut().into_iter().for_each(|above| counts.child(above));
        }
    };
    loop {
        let token = lexer.next()?;
        if std::mem::take(&mut behind_module) {
            let above = open.last().copied().unwrap_or_default();
            match token {
                Token::Sign(b';') => {
                    let block = module.open(above);
                    if block & OUT == 0 {
                        if is_block(&module.name) {
                            counts.close(block);
                        } else {
                            counts.leaf(&module, above);
                        }
                        open.last_mut().into_iter().for_each(|above| counts.child(above));
                    }
                    while open.len() > 1 && open.last().is_some_and(|last| last & SINGLE != 0) {
                        close(&mut open, &mut counts, &mut placing);
                    }
                }
                _ => {
                    let single = if token == Token::Sign(b'{') { 0 } else { SINGLE };
                    let block = module.open(above) | single;
                    placing += u64::from(block & PLACED != 0);
                    open.push(block);
                }
            }
        } else if token == Token::Sign(b'}') && brackets == 0 && open.len() > 1 {
            close(&mut open, &mut counts, &mut placing);
            while open.len() > 1 && open.last().is_some_and(|last| last & SINGLE != 0) {
                close(&mut open, &mut counts, &mut placing);
            }
        }
        counts.depth = counts.depth.max(placing);
        if token == Token::End {
            // The root, of what is open at the top.
            counts.joins += 1;
            counts.children += open.first().map_or(0, |root| u64::from(root & ONE != 0));
        }
        let places = usize::try_from(placing).unwrap_or(usize::MAX);
        let blocks = rooms.follow(&mut counts, [open.len(), places]);
        let mut held = counts.tree_bytes() + blocks;
        if token == Token::Sign(b')') && brackets == 1 {
            held += module.read_bytes();
        }
        counts.peak_bytes = counts.peak_bytes.max(held);
        match token {
            Token::Sign(b'(') => brackets += 1,
            Token::Sign(b')') => {
                brackets = brackets.saturating_sub(1);
                behind_module = brackets == 0;
            }
            Token::End => return Ok(counts),
            Token::Name(name) if brackets == 0 => {
                module = Module { name, left_out: std::mem::take(&mut left_out), ..Module::default() };
            }
            Token::Sign(b'%' | b'*') if brackets == 0 => left_out = true,
            token if brackets > 0 => module.take(token),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_and_depth_are_counted() {
        let of = |text: &str| {
            let counts = count(&mut text.as_bytes()).unwrap();
            assert!(counts.peak_bytes >= counts.tree_bytes());
            TextCounts { peak_bytes: 0, held: 0, lists: 0, ..counts }
        };
        let text = "union() { multmatrix([[1, 0, 0, 7], [0, 1, 0, 0], [0, 0, 1, 0]]) { cube([1, 2, 3]); } color() sphere(1); cube(7); *cube(8); %group() { cube(9); } }";
        let counts = TextCounts { leaves: 3, joins: 2, children: 4, moved: 1, depth: 1, ..of("") };
        assert_eq!(of(text), counts);
        let chain = TextCounts { leaves: 1, joins: 1, children: 1, placed: 1, depth: 1, ..of("") };
        assert_eq!(of("a() multmatrix(2) c() sphere();"), chain);
        let list = TextCounts {
            leaves: 1,
            joins: 1,
            children: 1,
            faces: 32 + 24 * 10 + 12 * 16,
            making: 36 * 26,
            ..of("")
        };
        assert_eq!(of("polygon([[1, 2], [3, 4], [5, 6], [1, 1], [0, 7]], undef);"), list);
    }

    #[test]
    fn the_counts_are_what_the_parser_takes() {
        let deep = "multmatrix([[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {";
        for text in [
            "sphere(1);".repeat(999),
            "sphere(r = 1, $fn = 30); cylinder($fn = 7, h = 1, r1 = 1, r2 = 2);".repeat(99),
            "linear_extrude(height = 3) { polygon(points = [[0,0],[1,0],[1,1],[0,1]], paths = [[0,1,2]]); }".repeat(99),
            "polyhedron(points = [[0,0,0],[1,0,0],[0,1,0],[0,0,1]], faces = [[0,2,1],[0,1,3],[0,3,2],[1,2,3]]);"
                .repeat(300),
            format!("{}cube(3);{}", deep.repeat(5000), "}".repeat(5000)),
            format!("difference() {{ cube(1); {} group(); }}", "cylinder(3, 1);".repeat(70)),
        ] {
            let counts = count(&mut text.as_bytes()).unwrap();
            let parsed = super::super::parse(&mut text.as_bytes(), "".as_ref(), u64::MAX).unwrap();
            for (counted, taken) in
                [(counts.tree_bytes(), parsed.tree.bytes()), (counts.peak_bytes, parsed.peak_bytes)]
            {
                // Which nodes wait for their blocks is not counted block by block.
                assert!(counted + 8192 >= taken, "{counted} for {taken}: {counts:?}");
                assert!(counted <= taken + taken / 16 + 4096, "{counted} for {taken}: {counts:?}");
            }
        }
    }
}
