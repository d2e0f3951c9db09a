//! STL: binary if its length fits the number of triangles that it states, or if it does not begin like text, else text.

use std::sync::OnceLock;

use super::stop::{Each, Stop, finite};
use super::stream::{Stream, Token, Words, mark};
use crate::mesh::read::stop::{count_lies, cut_short, not_finite, unread_colors};
use crate::platform::PositionalFile;
use crate::text::plain_head;

/// Bytes before the first triangle, and of each.
const HEADER: u64 = 84;
const RECORD: u64 = 50;

/// Triangles of a binary file, if it is one.
pub(super) fn binary_triangles(head: &[u8], bytes: u64) -> Option<u64> {
    let stated = stated(head)?;
    (HEADER + RECORD * stated == bytes).then_some(stated)
}

fn stated(head: &[u8]) -> Option<u64> {
    let count = head.get(80..84)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*count).into())
}

/// Triangles of a binary file, and bytes behind the last one; `None` for text.
pub(super) fn triangles(head: &[u8], bytes: u64) -> Result<Option<(u64, u64)>, Stop> {
    let stated = stated(head);
    let behind = |stated: u64| bytes.checked_sub(HEADER + RECORD * stated);
    match (stated, stated.and_then(behind)) {
        (Some(stated), Some(0)) => Ok(Some((stated, 0))),
        _ if is_text(head) => Ok(None),
        (stated, behind) => {
            mark(head)?;
            match (stated, behind) {
                (Some(stated @ 1..), Some(behind)) => Ok(Some((stated, behind))),
                (Some(stated), _) => Err(count_lies(stated, bytes.saturating_sub(HEADER) / RECORD).into()),
                (None, _) => Err(cut_short().into()),
            }
        }
    }
}

/// The note on bytes behind the last triangle, where these might be triangles.
pub(super) fn lack(triangles: u64, behind: u64) -> Option<String> {
    (behind >= RECORD).then(|| format!("has {behind} bytes behind the {triangles} triangles that it states, which were left out; copy it again if triangles are missing"))
}

/// True if it begins like text.
pub(super) fn is_text(head: &[u8]) -> bool {
    let head = plain_head(head);
    let start = head.trim_ascii_start();
    let end = start.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    start.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) && !start[..end].contains(&0)
}

/// True for the header of Materialise Magics that states a colour.
pub(super) fn is_colored(head: &[u8]) -> bool {
    head.get(..80).is_some_and(|head| head.windows(6).any(|word| word == b"COLOR="))
}

/// A note that is known once the triangles have been read.
pub(super) type LateLack = OnceLock<String>;

/// Reads the triangles; `colored` takes the note on their colours (VisCAM), if these are wanted.
pub(super) fn for_each_binary(
    file: &PositionalFile,
    triangles: u64,
    colored: Option<&LateLack>,
    each: &mut Each<'_>,
) -> Result<(), Stop> {
    let mut stream = Stream::new(file, HEADER);
    for at in 0..triangles {
        let record: [u8; 50] = stream.take()?;
        let single =
            |k: usize| f64::from(f32::from_le_bytes(std::array::from_fn(|i| record[12 + 4 * k + i])));
        let t: [[f64; 3]; 3] = std::array::from_fn(|v| std::array::from_fn(|c| single(3 * v + c)));
        finite(&t, at + 1)?;
        each(&t)?;
        if let Some(colored) = colored.filter(|_| record[49] & 0x80 != 0) {
            colored.get_or_init(|| unread_colors("STL"));
        }
    }
    Ok(())
}

/// Words make a text, not lines; but a name ends with its line, or where a facet begins. `tail` takes the note on other
/// text behind a solid; zeros and Ctrl-Z are skipped.
pub(super) fn for_each_text(file: &PositionalFile, tail: &LateLack, each: &mut Each<'_>) -> Result<(), Stop> {
    let mut words = Words::begin(file)?;
    let mut triangle = [[0.0; 3]; 3];
    let (mut vertices, mut read) = (0, 0);
    // True while a solid has not ended.
    let (mut solid, mut ended) = (false, false);
    loop {
        match words.next()? {
            Token::LineEnd => continue,
            Token::End if solid || vertices > 0 => return Err(cut_short().into()),
            Token::End => return Ok(()),
            Token::Word => {}
        }
        if words.is("solid") || words.is("endsolid") {
            solid = words.is("solid");
            ended = true;
            if vertices > 0 {
                return Err(words.wrong());
            }
            solid |= name_ends_with_a_facet(&mut words)?;
        } else if words.is("facet") || words.is("endfacet") {
            if vertices > 0 {
                return Err(words.wrong());
            }
            solid |= words.is("facet");
        } else if ended && !solid {
            if !words.word().iter().all(|byte| matches!(byte, 0 | 0x1a)) {
                let line = words.line();
                tail.get_or_init(|| format!("has other text behind a solid, in line {line}, which was left out; correct it if triangles are missing"));
                words.skip_line()?;
            }
        } else if words.is("normal") {
            // Normals of the file are not used: triangles have their own.
            for _ in 0..3 {
                words.must_anywhere()?;
                words.as_number()?;
            }
        } else if words.is("vertex") {
            if vertices == 3 {
                return Err(words.wrong());
            }
            for coordinate in &mut triangle[vertices] {
                words.must_anywhere()?;
                *coordinate = words.as_number()?;
            }
            if !triangle[vertices].iter().all(|c| c.is_finite()) {
                return Err(not_finite(read + 1).into());
            }
            vertices += 1;
        } else if words.is("endloop") {
            if vertices != 3 {
                return Err(words.wrong());
            }
            each(&triangle)?;
            read += 1;
            vertices = 0;
        } else if !words.is("outer") && !words.is("loop") {
            words.as_number().map_or(Ok(()), |_| Err(words.one_more("this line")))?;
            return Err(words.wrong());
        }
    }
}

/// Skips a name of any words; returns true if a facet began in its line.
fn name_ends_with_a_facet(words: &mut Words<'_>) -> Result<bool, Stop> {
    words.comments = false;
    let mut begins = false;
    while words.next()? == Token::Word {
        if begins && words.is("normal") {
            words.comments = true;
            for _ in 0..3 {
                words.must_anywhere()?;
                words.as_number()?;
            }
            return Ok(true);
        }
        begins = words.is("facet");
    }
    words.comments = true;
    Ok(false)
}
