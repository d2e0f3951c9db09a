//! Counts of a text, for a bound of what its tree takes.

use std::io::BufRead;

use super::Stop;
use super::lexer::{Lexer, Token};

/// How many modules, numbers and open blocks a text has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::csg) struct TextCounts {
    /// Modules without children, and with some.
    pub(in crate::csg) leaves: u64,
    pub(in crate::csg) blocks: u64,
    /// Most blocks that are open at a time.
    pub(in crate::csg) depth: u64,
    /// Numbers of modules without children; the most of one.
    pub(in crate::csg) numbers: u64,
    pub(in crate::csg) longest: u64,
}

/// Counts, in little memory; faults are left to the parser.
///
/// # Errors
/// A token that is none; the text cannot be read.
pub(in crate::csg) fn count(input: &mut dyn BufRead) -> Result<TextCounts, Stop> {
    let (mut lexer, mut counts) = (Lexer::new(input), TextCounts::default());
    let (mut braces, mut singles, mut brackets, mut numbers) = (0_u64, 0_u64, 0_u64, 0_u64);
    let mut behind_module = false;
    loop {
        let token = lexer.next()?;
        if std::mem::take(&mut behind_module) {
            match token {
                Token::Sign(b';') => {
                    counts.leaves += 1;
                    counts.numbers += numbers;
                    singles = 0;
                }
                Token::Sign(b'{') => counts.blocks += 1,
                _ => (counts.blocks, singles) = (counts.blocks + 1, singles + 1),
            }
        }
        match token {
            Token::Sign(b'(') => (brackets, numbers) = (brackets + 1, 0),
            Token::Sign(b')') => {
                brackets = brackets.saturating_sub(1);
                behind_module = brackets == 0;
                counts.longest = counts.longest.max(numbers);
            }
            Token::Sign(b'{') => braces += 1,
            Token::Sign(b'}') => (braces, singles) = (braces.saturating_sub(1), 0),
            Token::Number(_) => numbers += 1,
            Token::End => return Ok(counts),
            _ => {}
        }
        counts.depth = counts.depth.max(braces + singles);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_numbers_and_depth_are_counted() {
        let of = |text: &str| count(&mut text.as_bytes()).unwrap();
        let counts = TextCounts { leaves: 3, blocks: 3, depth: 2, numbers: 5, longest: 4 };
        let text =
            "union() { multmatrix([[1, 2], [3, 4]]) { cube([1, 2, 3]); } color() sphere(1); cube(7); }";
        assert_eq!(of(text), counts);
        assert_eq!(of(""), TextCounts::default());
        assert_eq!(of("a() b() c() sphere();"), TextCounts { leaves: 1, blocks: 3, depth: 3, ..of("") });
    }
}
