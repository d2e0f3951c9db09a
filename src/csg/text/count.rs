//! Counts of a text, for a bound of what its tree takes.

use std::io::BufRead;

use super::Stop;
use super::lexer::{Lexer, Token};
use super::parser::OPEN_BYTES;
use crate::csg::tree::{BOXED, Node, NodeId, Shape};
use crate::geom::Affine;

/// How many modules, numbers and open blocks a text has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::csg) struct TextCounts {
    /// Modules without children; those of them that are spheres.
    pub(in crate::csg) leaves: u64,
    pub(in crate::csg) spheres: u64,
    /// Blocks that join other than one child, and children of these; blocks that place and that only move.
    pub(in crate::csg) joins: u64,
    children: u64,
    pub(in crate::csg) placed: u64,
    moved: u64,
    /// Most blocks that are open at a time.
    pub(in crate::csg) depth: u64,
    /// Numbers of polyhedra and polygons; the most of one module.
    pub(in crate::csg) numbers: u64,
    pub(in crate::csg) longest: u64,
    /// The most that a tree and its open blocks take at a time.
    pub(in crate::csg) peak_bytes: u64,
}

impl TextCounts {
    /// What the whole tree takes at most: lists grow by an eighth.
    pub(in crate::csg) fn tree_bytes(&self) -> u64 {
        let bytes = |size: usize| size as u64;
        let nodes = self.leaves + self.joins + self.placed + self.moved;
        let lists = nodes * bytes(size_of::<Node>()) + self.children * bytes(size_of::<NodeId>());
        let boxes = self.leaves * bytes(size_of::<Shape>() + BOXED)
            + self.placed * bytes(size_of::<(Affine, u32)>() + BOXED)
            + self.moved * bytes(size_of::<([f64; 3], u32)>() + BOXED);
        lists * 9 / 8 + boxes + 12 * self.numbers
    }
}

/// A block that is open.
struct Open {
    children: u32,
    /// Is it only moved, or placed?
    moved: bool,
    placed: bool,
    /// Has it no braces, but the one module that follows?
    single: bool,
}

/// The module that is being read: its name, and the numbers of its arguments.
#[derive(Default)]
struct Module {
    name: String,
    numbers: u64,
    first: [f64; 12],
}

impl Module {
    fn open(&self, single: bool) -> Open {
        let [a, b, c, _, d, e, f, _, g, h, i, _] = self.first;
        let is_placing = self.name == "multmatrix";
        let moved =
            is_placing && [a, b, c, d, e, f, g, h, i] == [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        Open { children: 0, moved, placed: is_placing && !moved, single }
    }
}

/// Counts, in eight bytes for every open block; faults are left to the parser.
///
/// # Errors
/// A token that is none; the text cannot be read.
pub(in crate::csg) fn count(input: &mut dyn BufRead) -> Result<TextCounts, Stop> {
    let (mut lexer, mut counts) = (Lexer::new(input), TextCounts::default());
    let mut open = vec![Open { children: 0, moved: false, placed: false, single: false }];
    let (mut module, mut brackets, mut behind_module) = (Module::default(), 0_u64, false);
    let close = |open: &mut Vec<Open>, counts: &mut TextCounts| {
        if let Some(last) = open.pop() {
            counts.joins += u64::from(last.children != 1);
            counts.children += if last.children == 1 { 0 } else { last.children.into() };
            counts.placed += u64::from(last.placed);
            counts.moved += u64::from(last.moved);
        }
        open.last_mut().into_iter().for_each(|above| above.children += 1);
    };
    loop {
        let token = lexer.next()?;
        if std::mem::take(&mut behind_module) {
            match token {
                Token::Sign(b';') => {
                    counts.leaves += 1;
                    counts.spheres += u64::from(module.name == "sphere");
                    let of_list = matches!(module.name.as_str(), "polyhedron" | "polygon");
                    counts.numbers += if of_list { module.numbers } else { 0 };
                    open.last_mut().into_iter().for_each(|above| above.children += 1);
                    while open.len() > 1 && open.last().is_some_and(|last| last.single) {
                        close(&mut open, &mut counts);
                    }
                }
                Token::Sign(b'{') => open.push(module.open(false)),
                _ => {
                    open.push(module.open(true));
                    let held = counts.tree_bytes() + (open.len() * OPEN_BYTES) as u64;
                    counts.peak_bytes = counts.peak_bytes.max(held);
                }
            }
        } else if token == Token::Sign(b'}') && open.len() > 1 {
            close(&mut open, &mut counts);
            while open.len() > 1 && open.last().is_some_and(|last| last.single) {
                close(&mut open, &mut counts);
            }
        }
        // Blocks without braces may be closed by the same token.
        counts.depth = counts.depth.max(open.len() as u64);
        match token {
            Token::Name(name) if brackets == 0 => module = Module { name, ..Module::default() },
            Token::Sign(b'(') => brackets += 1,
            Token::Sign(b')') => {
                brackets = brackets.saturating_sub(1);
                behind_module = brackets == 0;
                counts.longest = counts.longest.max(module.numbers);
            }
            Token::Number(number) => {
                if let Some(place) =
                    usize::try_from(module.numbers).ok().and_then(|at| module.first.get_mut(at))
                {
                    *place = number;
                }
                module.numbers += 1;
            }
            Token::Sign(b'{' | b'}' | b';') | Token::End => {
                if token == Token::End {
                    // The root, of what is open at the top.
                    counts.joins += 1;
                    counts.children += open.first().map_or(0, |root| u64::from(root.children));
                }
                let held = counts.tree_bytes() + (open.len() * OPEN_BYTES) as u64;
                counts.peak_bytes = counts.peak_bytes.max(held);
                if token == Token::End {
                    return Ok(counts);
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_numbers_and_depth_are_counted() {
        let of = |text: &str| {
            let counts = count(&mut text.as_bytes()).unwrap();
            assert!(counts.peak_bytes >= counts.tree_bytes());
            TextCounts { peak_bytes: 0, ..counts }
        };
        let text = "union() { multmatrix([[1, 0, 0, 7], [0, 1, 0, 0], [0, 0, 1, 0]]) { cube([1, 2, 3]); } color() sphere(1); cube(7); }";
        let counts = TextCounts {
            leaves: 3,
            spheres: 1,
            joins: 2,
            children: 4,
            moved: 1,
            depth: 3,
            longest: 12,
            ..of("")
        };
        assert_eq!(of(text), counts);
        let chain =
            TextCounts { leaves: 1, spheres: 1, placed: 1, children: 1, depth: 4, longest: 1, ..of("") };
        assert_eq!(of("a() multmatrix(2) c() sphere();"), chain);
        let list = TextCounts { leaves: 1, children: 1, numbers: 5, longest: 5, ..of("") };
        assert_eq!(of("polygon([[1, 2], [3, 4], 5]);"), list);
    }

    #[test]
    fn the_bound_holds_what_the_parser_takes() {
        let deep = "multmatrix([[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]) {";
        for text in [
            "sphere(1);".repeat(999),
            format!("{}cube(3);{}", deep.repeat(500), "}".repeat(500)),
            format!("difference() {{ cube(1); {} }}", "cylinder(3, 1);".repeat(70)),
        ] {
            let counts = count(&mut text.as_bytes()).unwrap();
            let parsed = super::super::parse(&mut text.as_bytes(), "".as_ref(), u64::MAX).unwrap();
            // Lists begin with room for 64.
            assert!(parsed.tree.bytes() <= counts.tree_bytes() + 2048, "{counts:?}");
            assert!(parsed.peak_bytes <= counts.peak_bytes + 8192, "{} {counts:?}", parsed.peak_bytes);
        }
    }
}
