//! An upper bound of the memory of a tree, from the counts of its text.

use std::io::BufRead;

use super::Stop;
use super::lexer::{Lexer, Token};

/// Bytes of a module: an open block, or a leaf, in the tree, in the flat tree, placed, and in a worker.
const MODULE_BYTES: u64 = 1 << 10;
/// Parts that `offset3d` makes of a box.
const PARTS: u64 = 24;

/// Bytes for a number among the arguments of a module, of which corners and triangles are made.
fn number_bytes(module: &str) -> u64 {
    match module {
        "polygon" => 320,
        "polyhedron" => 64,
        _ => 0,
    }
}

/// Bytes of a shape of this many sides: as many triangles as a sphere of them.
fn facet_bytes(sides: f64) -> u64 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 256")]
    let sides = sides.clamp(0.0, super::modules::MAX_SIDES) as u64;
    128 * sides * sides
}

/// Bytes that are sufficient for the tree of a text in every stage, and the number of files that it names.
///
/// # Errors
/// A malformed token; the text cannot be read.
pub(in crate::csg) fn memory_bound(input: &mut dyn BufRead) -> Result<(u64, u64), Stop> {
    let mut lexer = Lexer::new(input)?;
    let (mut module, mut name) = (String::new(), String::new());
    let (mut bytes, mut files, mut parts) = (0, 0, 1);
    // Most sides of a round shape, from the blocks around it.
    let mut above = 0.0_f64;
    loop {
        match lexer.next()? {
            Token::Name(next) => name = next,
            Token::Sign(b'(') => {
                module = std::mem::take(&mut name);
                bytes += MODULE_BYTES;
                let is_round = matches!(module.as_str(), "sphere" | "cylinder" | "circle");
                bytes += if is_round { facet_bytes(above) } else { 0 };
                files += u64::from(matches!(module.as_str(), "mesh" | "import" | "volume"));
                parts = if module == "offset3d" { PARTS } else { parts };
            }
            Token::Number(sides) if name == "$fn" => match module.as_str() {
                "sphere" | "cylinder" | "circle" => bytes += facet_bytes(sides),
                _ => above = above.max(sides.min(super::modules::MAX_SIDES)),
            },
            Token::Number(_) => bytes += number_bytes(&module),
            Token::End => return Ok((bytes * parts, files)),
            _ => {}
        }
    }
}
