//! Common parts of the headers of several formats: lines of text, numbers, units, and the names of data files.

use std::fs;
use std::io::{self, BufRead, Read};
use std::path::{Component, Path, PathBuf};
use std::str::FromStr;

use super::files::FileList;
use super::payload::{Section, section};
use crate::budget::Bytes;
use crate::fault::{Fault, bad};
use crate::platform::PositionalFile;
use crate::text::mark_bytes;
use crate::text::names::FOLLOW_LINKS;
use crate::volume::{Result, SourceError, SourceFault};

/// Longest line: far more than any real one, so that binary data is not taken for a line.
const MAX_LINE: u64 = 64 << 10;

/// Longest header: some ten thousand names of data files.
const MAX_HEADER: u64 = 1 << 20;

/// Most data files that a header may name.
const MAX_FILES: u64 = 1 << 16;

/// The lines of a text header, one at a time.
pub(super) struct Lines<'a> {
    file: &'a PositionalFile,
    reader: Section<'a>,
    /// Byte of the file at which the next line begins.
    pub(super) offset: u64,
    /// Bytes that are skipped.
    skipped: u64,
}

impl<'a> Lines<'a> {
    pub(super) fn new(file: &'a PositionalFile) -> Self {
        Self { file, reader: section(file, 0, MAX_HEADER), offset: 0, skipped: 0 }
    }

    /// Leaves out binary values among the lines.
    pub(super) fn skip(&mut self, bytes: u64) {
        self.offset = self.offset.saturating_add(bytes);
        self.skipped = self.skipped.saturating_add(bytes);
        let end = MAX_HEADER.saturating_add(self.skipped);
        self.reader = section(self.file, self.offset, end.saturating_sub(self.offset));
    }

    /// The next line without its end; `None` at the end of the file.
    pub(super) fn next(&mut self) -> io::Result<Option<Vec<u8>>> {
        if self.offset == 0 {
            let mark = mark_bytes(self.reader.fill_buf()?).map_err(|wide| bad!("{wide}").in_stream())?;
            self.reader.consume(mark);
            self.offset = mark as u64;
        }
        let mut line = Vec::new();
        let read = self.reader.by_ref().take(MAX_LINE).read_until(b'\n', &mut line)?;
        self.offset += read as u64;
        if read == 0 && self.offset - self.skipped >= MAX_HEADER {
            return Err(bad!(
                "its header does not end within {}; is it damaged, or full of comments?",
                Bytes(MAX_HEADER)
            )
            .in_stream());
        }
        if read as u64 == MAX_LINE && !line.ends_with(b"\n") {
            return Err(bad!("a line of the header has no end").in_stream());
        }
        if line.pop_if(|last| *last == b'\n').is_some() {
            line.pop_if(|last| *last == b'\r');
        }
        Ok((read > 0).then_some(line))
    }
}

/// The fields of a header that may be stated once.
pub(super) struct Once {
    fields: &'static [&'static str],
    seen: u32,
}

impl Once {
    /// A check of these fields, at most 32.
    pub(super) fn new(fields: &'static [&'static str]) -> Self {
        Self { fields, seen: 0 }
    }

    /// Refuses a field that was stated before; blanks in its name do not count.
    pub(super) fn check(&mut self, field: &str) -> Result<(), Fault> {
        let same = |known: &&str| known.chars().filter(|c| *c != ' ').eq(field.chars().filter(|c| *c != ' '));
        let Some(at) = self.fields.iter().position(same) else { return Ok(()) };
        let bit = 1 << at;
        if self.seen & bit != 0 {
            return Err(bad!("its header states `{}` twice; remove the wrong line", self.fields[at]));
        }
        self.seen |= bit;
        Ok(())
    }
}

/// Reads as many bytes as there are.
pub(super) fn unpacked(stream: impl Read, out: &mut [u8]) -> usize {
    let mut stream = stream;
    let mut got = 0;
    while let Some(rest) = out.get_mut(got..).filter(|rest| !rest.is_empty()) {
        match stream.read(rest) {
            Ok(0) | Err(_) => break,
            Ok(n) => got += n,
        }
    }
    got
}

/// A line as text; bytes outside UTF-8 become question marks.
pub(super) fn text(line: &[u8]) -> String {
    String::from_utf8_lossy(line).trim().to_owned()
}

/// A number of a field.
///
/// # Errors
/// The text is not a number of the type; the fault names both.
pub(super) fn number<T: FromStr>(field: &str, text: &str) -> Result<T, Fault> {
    let text = text.trim();
    text.parse().map_err(|_| {
        bad!(
            "its header states `{}` for {}, which is not a number of the kind that belongs there{}",
            text.escape_debug(),
            field.escape_debug(),
            if text.contains(',') { "; write decimals with a point" } else { "" }
        )
    })
}

/// The numbers of a field, between white space.
///
/// # Errors
/// The errors of [`number`], and a field without any.
pub(super) fn numbers<T: FromStr>(field: &str, text: &str) -> Result<Vec<T>, Fault> {
    if text.trim().is_empty() {
        let field = field.escape_debug();
        return Err(bad!("its header states nothing for {field}; write its numbers, or leave the line out"));
    }
    text.split_whitespace().map(|part| number(field, part)).collect()
}

/// Exactly `N` numbers of a field.
///
/// # Errors
/// The errors of [`number`], and another count.
pub(super) fn exactly<const N: usize, T: FromStr>(field: &str, text: &str) -> Result<[T; N], Fault> {
    let list = numbers(field, text)?;
    let many = list.len();
    list.try_into().map_err(|_| wrong_count(field, text, many, N))
}

/// The fault of a field with another number of numbers than belongs there.
pub(super) fn wrong_count(field: &str, text: &str, many: usize, due: usize) -> Fault {
    let (field, text) = (field.escape_debug(), text.trim().escape_debug());
    bad!("its header states {many} numbers for {field}, where {due} belong: `{text}`")
}

/// Millimetres in a unit of length, by its usual names.
pub(super) fn unit_mm(name: &str) -> Option<f64> {
    let name = name.trim().trim_matches('"').to_lowercase();
    match name.as_str() {
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some(1.0),
        "cm" | "centimeter" | "centimeters" => Some(10.0),
        "m" | "meter" | "meters" | "metre" | "metres" => Some(1000.0),
        "um" | "\u{b5}m" | "\u{3bc}m" | "\\u00b5m" | "micron" | "microns" | "micrometer" | "micrometers"
        | "micrometre" => Some(1e-3),
        "nm" | "nanometer" | "nanometers" => Some(1e-6),
        "\u{e5}" | "angstrom" | "angstroms" | "\u{e5}ngstr\u{f6}m" => Some(1e-7),
        "inch" | "inches" | "in" => Some(25.4),
        _ => None,
    }
}

/// The vector at right angles to two others, `length` long.
pub(super) fn normal_of(a: [f64; 3], b: [f64; 3], length: f64) -> [f64; 3] {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let norm = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
    if norm > 0.0 { cross.map(|c| c / norm * length) } else { [0.0, 0.0, length] }
}

/// The error of a file that the system refused, or whose content made no sense.
pub(super) fn unreadable(path: &Path, cause: io::Error) -> SourceError {
    match cause.downcast::<Fault>() {
        Ok(fault) => unusable(path, fault),
        Err(cause) if cause.kind() == io::ErrorKind::UnexpectedEof => {
            unusable(path, bad!("ends early; it was cut short, copy it again"))
        }
        Err(cause) => SourceError::from(SourceFault::Unreadable { path: path.to_path_buf(), cause }),
    }
}

/// The error of a file that is damaged, or of a kind that is not read.
pub(super) fn unusable(path: &Path, fault: Fault) -> SourceError {
    fault.at(path).into()
}

/// The fault of a header whose pictures are not slices.
pub(super) fn sweep() -> Fault {
    bad!(
        "is a list of pictures, each with a place of its own (a free-hand sweep), and these are not slices; reconstruct a volume from it first, and give that"
    )
}

/// A line of a header without a name and a value.
pub(super) fn not_a_field(line: &str) -> Fault {
    bad!("the line `{}` of its header is not a field", line.escape_debug())
}

/// An empty list of files that lie in the folder of a header.
pub(super) fn files_beside(header: &Path) -> FileList {
    FileList::new(header.parent().unwrap_or(Path::new("")))
}

/// Name of a data file as a header has it, if it lies in the header's folder or below.
///
/// A header that came from elsewhere must not make the program read any file it names.
fn data_name(name: &str) -> Result<PathBuf, Fault> {
    let path = Path::new(name.trim());
    let inside = path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !inside || path.as_os_str().is_empty() {
        return Err(bad!(
            "its data file `{}` is not in the folder of the header; put both into one folder and name it without a path",
            name.escape_debug()
        ));
    }
    Ok(path.to_path_buf())
}

/// Checks that the data files of a header stay in its folder, or in the folder where the header really lies. A symbolic
/// link to data elsewhere is followed only where links may be: a header of foreign origin must not make the program
/// read any file it links to.
///
/// # Errors
/// The first file that lies elsewhere.
pub(super) fn check_links(header: &Path, files: &FileList, follow: bool) -> Result {
    let outside = (0..files.len()).find(|at| !stays(header, &files.path(*at)));
    match outside.filter(|_| !follow) {
        None => Ok(()),
        Some(at) => {
            let name = files.name(at).to_string_lossy().into_owned();
            Err(unusable(
                header,
                bad!(
                    "its data file `{}` is a link that leads out of the folder of the header; put the data there, or add {FOLLOW_LINKS}",
                    name.escape_debug()
                ),
            ))
        }
    }
}

/// True if data lies in the folder of its header, links included. A missing file counts as staying.
pub(crate) fn stays(header: &Path, data: &Path) -> bool {
    let folder = |path: &Path| path.parent().map(Path::to_path_buf).unwrap_or_default();
    let here = folder(header);
    // Links lie in the header's folder or below it.
    let below = data.ancestors().take_while(|part| *part != here && !part.as_os_str().is_empty());
    let is_link = |part: &Path| fs::symlink_metadata(part).is_ok_and(|meta| meta.is_symlink());
    if !below.into_iter().any(is_link) {
        return true;
    }
    let here = if here.as_os_str().is_empty() { PathBuf::from(".") } else { here };
    let Ok(real) = data.canonicalize() else { return true };
    let inside = |folder: io::Result<PathBuf>| folder.is_ok_and(|folder| real.starts_with(folder));
    inside(here.canonicalize()) || inside(header.canonicalize().map(|header| folder(&header)))
}

/// Adds a data file that a header names.
pub(super) fn listed(list: &mut FileList, name: &str) -> Result<(), Fault> {
    if list.len() as u64 >= MAX_FILES {
        return Err(bad!("it names more than {MAX_FILES} data files"));
    }
    list.push(&data_name(name)?);
    Ok(())
}

/// True for `LIST`, which names of data files follow, one a line; the dimension of a file may follow it (`LIST 2D`).
pub(super) fn is_list(field: &str, value: &str) -> Result<bool, Fault> {
    let mut words = value.split_whitespace();
    if !words.next().is_some_and(|word| word.eq_ignore_ascii_case("list")) {
        return Ok(false);
    }
    if let Some(dimension) = words.next() {
        number::<u64>(field, dimension.strip_suffix(['d', 'D']).unwrap_or(dimension))?;
    }
    Ok(true)
}

/// File names from a pattern such as `slice%03d.raw`, for numbers from `first` to `last`; `most` at most.
pub(super) fn numbered(
    list: &mut FileList,
    pattern: &str,
    [first, last, step]: [i64; 3],
    most: u64,
) -> Result<(), Fault> {
    let towards = if first <= last { step > 0 } else { step < 0 };
    if !towards {
        return Err(bad!("its data files from {first} to {last} in steps of {step} have no end"));
    }
    let mut number = first;
    while if step > 0 { number <= last } else { number >= last } {
        if list.len() as u64 >= most {
            return Err(bad!("it names more data files than its {most} slices"));
        }
        let name = with_number(pattern, number)
            .ok_or_else(|| bad!("`{}` is not a pattern with one number", pattern.escape_debug()))?;
        listed(list, &name)?;
        let Some(next) = number.checked_add(step) else { break };
        number = next;
    }
    Ok(())
}

/// The pattern with its one `%d`, `%3d` or `%03d` replaced; `%%` is a percent sign.
fn with_number(pattern: &str, number: i64) -> Option<String> {
    let mut out = String::new();
    let mut rest = pattern;
    let mut replaced = false;
    while let Some((before, after)) = rest.split_once('%') {
        out.push_str(before);
        if let Some(after) = after.strip_prefix('%') {
            out.push('%');
            rest = after;
            continue;
        }
        let digits = after.find(|c: char| !c.is_ascii_digit()).filter(|at| *at < 3)?;
        let (flags, after) = after.split_at(digits);
        rest = after.strip_prefix(['d', 'i', 'u'])?;
        let width: usize = if flags.is_empty() { 0 } else { flags.parse().ok()? };
        out.push_str(&if flags.starts_with('0') {
            format!("{number:0width$}")
        } else {
            format!("{number:width$}")
        });
        if replaced {
            return None;
        }
        replaced = true;
    }
    out.push_str(rest);
    replaced.then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_filled_like_printf() {
        for (pattern, number, name) in [
            ("a%03d.raw", 7, Some("a007.raw")),
            ("%d", 12, Some("12")),
            ("%4d%%", -3, Some("  -3%")),
            ("a.raw", 1, None),
            ("%d%d", 1, None),
            ("%s", 1, None),
            ("%", 1, None),
            ("%999d", 1, None),
        ] {
            assert_eq!(with_number(pattern, number).as_deref(), name, "{pattern}");
        }
        let mut list = FileList::new(Path::new(""));
        numbered(&mut list, "s%d", [5, 1, -2], 3).unwrap();
        assert_eq!((list.len(), list.name(2)), (3, Path::new("s1")));
        assert!(numbered(&mut list, "s%d", [1, 9, -1], 99).is_err());
        assert!(numbered(&mut list, "s%d", [1, i64::MAX, 1], 99).is_err());
        assert!(numbered(&mut FileList::default(), "s%d", [i64::MAX - 1, i64::MAX, 1], 99).is_ok());
    }

    #[test]
    fn data_files_stay_below_the_header() {
        assert_eq!(data_name(" sub/./a.raw ").unwrap(), Path::new("sub/./a.raw"));
        for name in ["/etc/passwd", "../a.raw", "a/../../b", ""] {
            assert_eq!(
                data_name(name),
                Err(bad!(
                    "its data file `{}` is not in the folder of the header; put both into one folder and name it without a path",
                    name.escape_debug()
                ))
            );
        }
    }

    #[test]
    fn lines_end_and_binary_data_is_none() {
        use std::io::Write;
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(b"a: 1\r\n\nlast").unwrap();
        let read = file.try_clone().unwrap().into();
        let mut lines = Lines::new(&read);
        assert_eq!(lines.next().unwrap().unwrap(), b"a: 1");
        assert_eq!((lines.next().unwrap().unwrap(), lines.offset), (Vec::new(), 7));
        assert_eq!(lines.next().unwrap().unwrap(), b"last");
        assert_eq!(lines.next().unwrap(), None);
        file.write_all(&[b'x'; 70_000]).unwrap();
        let mut lines = Lines::new(&read);
        assert!((0..3).any(|_| lines.next().is_err()));
    }

    #[test]
    fn units_have_their_usual_names() {
        assert_eq!(unit_mm("\"mm\""), Some(1.0));
        assert_eq!(unit_mm("micron"), Some(1e-3));
        assert_eq!(["\u{c5}", "\u{212b}", "Angstrom"].map(unit_mm), [Some(1e-7); 3]);
        assert_eq!(unit_mm("furlong"), None);
    }

    #[test]
    fn a_field_that_is_not_a_number_is_named_with_its_text() {
        assert_eq!(numbers::<f64>("spacing", " 1 -2.5e1\t.5 "), Ok(vec![1.0, -25.0, 0.5]));
        assert_eq!(exactly::<3, u64>("size", "4 4 5"), Ok([4, 4, 5]));
        for text in ["1,5", "n/a", "1.5.2", "0x10", "1e", "-", "1_000"] {
            let fault = numbers::<f64>("spacing", &format!("1 {text} 1")).unwrap_err().text;
            assert!(fault.contains("spacing") && fault.contains(text), "{fault}");
        }
        for (text, words) in
            [("1 1", "where 3 belong"), ("1 1 1 1", "where 3 belong"), (" ", "nothing for spacing")]
        {
            let fault = exactly::<3, f64>("spacing", text).unwrap_err().text;
            assert!(fault.contains(words), "{fault}");
        }
        assert!(number::<u64>("size", "-4").is_err() && number::<u64>("size", "4.0").is_err());
    }
}
