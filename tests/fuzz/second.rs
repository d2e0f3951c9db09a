//! Slow second readings of meshes in text: lines, words between blanks, numbers by the standard library.
//!
//! They know the plain forms of a format alone, and give `None` for anything else. Where a reader takes such a file, it has
//! to have found as many triangles, and the same extent.

use std::str::FromStr;

/// What a second reading finds.
pub(crate) struct Second {
    /// Triangles, n - 2 of a face of n corners.
    pub(crate) triangles: u64,
    /// Least and greatest coordinates of corners of faces.
    pub(crate) range: [[f64; 3]; 2],
}

/// Points and faces so far.
#[derive(Default)]
struct Faces {
    points: Vec<[f64; 3]>,
    faces: Vec<Vec<usize>>,
}

impl Faces {
    fn point(&mut self, words: &[&str]) -> Option<()> {
        self.points.push([number(words.first()?)?, number(words.get(1)?)?, number(words.get(2)?)?]);
        Some(())
    }

    /// The reading, if all faces have corners that differ.
    fn found(self) -> Option<Second> {
        let mut second = Second { triangles: 0, range: [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]] };
        for face in &self.faces {
            let corners: Vec<[f64; 3]> =
                face.iter().map(|at| self.points.get(*at).copied()).collect::<Option<_>>()?;
            let differ = |at: usize| corners[..at].iter().all(|other| *other != corners[at]);
            if corners.len() < 3 || !(0..corners.len()).all(differ) {
                return None;
            }
            second.triangles += corners.len() as u64 - 2;
            for (a, c) in corners.iter().flat_map(|corner| corner.iter().enumerate()) {
                second.range[0][a] = second.range[0][a].min(*c);
                second.range[1][a] = second.range[1][a].max(*c);
            }
        }
        (second.triangles > 0).then_some(second)
    }
}

fn number(word: &str) -> Option<f64> {
    f64::from_str(word).ok().filter(|number| number.is_finite())
}

fn whole(word: &str) -> Option<usize> {
    usize::from_str(word).ok()
}

/// The words of each line that has any, up to a mark of comments.
fn lines<'t>(bytes: &'t [u8], comment: &str) -> Option<impl Iterator<Item = Vec<&'t str>>> {
    let text = std::str::from_utf8(bytes).ok().filter(|text| text.is_ascii())?;
    let words = move |line: &'t str| -> Vec<&'t str> {
        let line = if comment.is_empty() { line } else { line.split(comment).next().unwrap_or("") };
        line.split_ascii_whitespace().collect()
    };
    let lines: Vec<Vec<&str>> = text.split(['\n', '\r']).map(words).collect();
    Some(lines.into_iter().filter(|words| !words.is_empty()))
}

/// `n` and `n` numbers of corners, then anything.
fn counted(words: &[&str]) -> Option<Vec<usize>> {
    let count = whole(words.first()?)?;
    words.get(1..=count)?.iter().map(|word| whole(word)).collect()
}

pub(crate) fn off(bytes: &[u8]) -> Option<Second> {
    let mut lines = lines(bytes, "#")?;
    if lines.next()? != ["OFF"] {
        return None;
    }
    let counts = lines.next().filter(|words| words.len() == 3)?;
    let [points, faces] = [whole(counts[0])?, whole(counts[1])?];
    let mut found = Faces::default();
    for _ in 0..points {
        found.point(&lines.next().filter(|words| words.len() == 3)?)?;
    }
    for _ in 0..faces {
        found.faces.push(counted(&lines.next()?)?);
    }
    found.found()
}

pub(crate) fn ply(bytes: &[u8]) -> Option<Second> {
    let mut lines = lines(bytes, "")?;
    if lines.next()? != ["ply"] || lines.next()? != ["format", "ascii", "1.0"] {
        return None;
    }
    let (mut counts, mut properties) = (Vec::new(), Vec::new());
    loop {
        let line = lines.next()?;
        match line[..] {
            ["comment", ..] => {}
            ["element", name @ ("vertex" | "face"), count] => {
                counts.push((name, whole(count)?));
            }
            ["property", "float" | "double", name @ ("x" | "y" | "z")] => properties.push(name),
            ["property", "list", "uchar", "int", "vertex_indices" | "vertex_index"] => {
                properties.push("list")
            }
            ["end_header"] => break,
            _ => return None,
        }
    }
    let [("vertex", points), ("face", faces)] = counts[..] else { return None };
    if properties != ["x", "y", "z", "list"] {
        return None;
    }
    let mut found = Faces::default();
    for _ in 0..points {
        found.point(&lines.next().filter(|words| words.len() == 3)?)?;
    }
    for _ in 0..faces {
        let line = lines.next()?;
        let face = counted(&line).filter(|face| face.len() + 1 == line.len())?;
        found.faces.push(face);
    }
    found.found()
}

pub(crate) fn obj(bytes: &[u8]) -> Option<Second> {
    let mut found = Faces::default();
    for line in lines(bytes, "#")? {
        match line[..] {
            ["v", _, _, _] => found.point(&line[1..])?,
            ["f", ..] => {
                let corner = |word: &&str| whole(word)?.checked_sub(1);
                let face = line[1..].iter().map(corner).collect::<Option<Vec<_>>>()?;
                // Faces that come before their corners are another matter.
                if face.iter().any(|at| *at >= found.points.len()) {
                    return None;
                }
                found.faces.push(face);
            }
            _ => return None,
        }
    }
    found.found()
}

pub(crate) fn stl(bytes: &[u8]) -> Option<Second> {
    let mut lines = lines(bytes, "")?;
    if lines.next()?[0] != "solid" {
        return None;
    }
    let mut found = Faces::default();
    loop {
        match lines.next()?[..] {
            ["endsolid", ..] => break,
            ["facet", "normal", x, y, z] if [x, y, z].into_iter().all(|word| number(word).is_some()) => {}
            _ => return None,
        }
        let first = found.points.len();
        if lines.next()? != ["outer", "loop"] {
            return None;
        }
        for _ in 0..3 {
            let line = lines.next().filter(|words| words.len() == 4 && words[0] == "vertex")?;
            found.point(&line[1..])?;
        }
        if lines.next()? != ["endloop"] || lines.next()? != ["endfacet"] {
            return None;
        }
        found.faces.push(vec![first, first + 1, first + 2]);
    }
    if lines.next().is_none() { found.found() } else { None }
}
