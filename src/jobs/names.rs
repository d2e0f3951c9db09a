//! Names and colours of labels from the tables that segmentation tools write.
//!
//! | table | a row |
//! |---|---|
//! | TSV or CSV with a header | columns index (or LabelValue), name, and color (#rrggbb or a name of CSS) or Color_R, Color_G, Color_B |
//! | ITK-SNAP label descriptions | `number R G B A visible mesh "name"` |
//! | Slicer colour table (.ctbl), FreeSurfer | `number name R G B A`; in .ctbl `_` stands for a blank |
//! | JSON of DICOM SEG tools | `segmentAttributes`: labelID, SegmentedPropertyTypeCodeSequence and its modifier or SegmentLabel, recommendedDisplayRGBValue |
//! | `totalsegmentator`, `freesurfer` | built-in tables of the program, selected by these words in place of a path |

use std::collections::HashSet;
use std::io::Read;
use std::path::Path;

use serde_json::Value;

use crate::error::Error;
use crate::export::part_name;
use crate::fault::{bad, usage};
use crate::format::{Label, LabelName};
use crate::load::{LoadError, LoadFault};
use crate::platform::{PositionalFile, is_device_name};
use crate::text::{self, mark_bytes};
use crate::volume::SourceError;

/// Built-in tables, by name.
const TABLES: [(&str, &str); 2] = [
    ("totalsegmentator", include_str!("tables/totalsegmentator.tsv")),
    ("freesurfer", include_str!("tables/freesurfer.tsv")),
];

/// Longest table, and longest name in it, in bytes.
const MAX_BYTES: u64 = 4 << 20;
const MAX_NAME_BYTES: usize = 1000;

/// Reads a table of labels, of the kind that its content shows; label 0 is left out. `path` may name a built-in table.
/// Where JSON has both a code and a typed name, the code's meaning is taken, unless `typed` is set.
///
/// # Errors
/// The file cannot be read, is not one of these tables, or names a label twice.
pub fn read_label_names(path: &Path, typed: bool) -> Result<Vec<LabelName>, Error> {
    let wrong = |line: usize| {
        let what = match line {
            0 => "is not a table of labels".to_owned(),
            _ => format!("line {line} is not a row of a table of labels"),
        };
        usage!("{what}; give a TSV or CSV with a header, ITK-SNAP label descriptions, a .ctbl, or the JSON of DICOM SEG tools").at(path)
    };
    if let Some((_, table)) = TABLES.iter().find(|(name, _)| path == Path::new(name)) {
        return Ok(of_rows(table, false).map_err(wrong)?);
    }
    if path.components().count() == 1 && path.extension().is_none() && !path.exists() {
        let known = TABLES.map(|(name, _)| name).join(", ");
        let fault = usage!("is neither a file nor a table of names of the program; its tables are {known}");
        return Err(SourceError::from(fault.at(path)).into());
    }
    let unreadable = |cause| LoadError::from(LoadFault::Unreadable { path: path.to_path_buf(), cause });
    let mut bytes = Vec::new();
    let file = PositionalFile::open(path).map_err(unreadable)?;
    file.onwards(0).take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(wrong(0).into());
    }
    let mark = mark_bytes(&bytes).map_err(|wide| SourceError::from(bad!("{wide}").at(path)))?;
    let bytes = bytes.get(mark..).unwrap_or_default();
    let text = std::str::from_utf8(bytes).map_err(|wrong| {
        let line = bytes.iter().take(wrong.valid_up_to()).filter(|c| **c == b'\n').count() + 1;
        SourceError::from(usage!("line {line} is not text in UTF-8; save the table as UTF-8").at(path))
    })?;
    let blanks = path.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("ctbl"));
    let mut names = match text.trim_start().starts_with(['{', '[']) {
        true => of_json(text, typed).ok_or_else(|| wrong(0))?,
        false => of_rows(text, blanks).map_err(wrong)?,
    };
    if let Some(long) = names.iter().find(|label| label.name.len() > MAX_NAME_BYTES) {
        let (number, bytes) = (long.number, long.name.len());
        let fault = usage!("gives label {number} a name of {bytes} bytes; shorten it to {MAX_NAME_BYTES}");
        return Err(SourceError::from(fault.at(path)).into());
    }
    crate::order::by_key(&mut names, |label| label.number);
    match names.windows(2).find(|pair| pair[0].number == pair[1].number) {
        Some([twice, _]) => {
            Err(usage!("names the label {} twice; name it once", twice.number).at(path).into())
        }
        _ => Ok(names),
    }
}

/// The labels of `segmentAttributes`, which is a list of lists.
fn of_json(text: &str, typed: bool) -> Option<Vec<LabelName>> {
    let table: Value = serde_json::from_slice(text.as_bytes()).ok()?;
    let mut all = Vec::new();
    for segment in table.get("segmentAttributes")?.as_array()?.iter().map(|list| list.as_array()) {
        for segment in segment? {
            let number = u16::try_from(segment.get("labelID")?.as_u64()?).ok()?;
            let text = |key: &str| segment.get(key).and_then(|value| value.as_str()).unwrap_or_default();
            let code = |key: &str| {
                let meaning = segment.get(key).and_then(|code| code.get("CodeMeaning")?.as_str());
                meaning.unwrap_or_default().trim()
            };
            let [own, modifier] =
                ["Type", "TypeModifier"].map(|of| code(&format!("SegmentedProperty{of}CodeSequence")));
            let coded = if own.is_empty() { String::new() } else { format!("{modifier} {own}") };
            let written = [text("SegmentLabel"), text("SegmentDescription")];
            let mut names = [coded.trim(), written[0], written[1]];
            names.rotate_left(usize::from(typed && !written.concat().is_empty()));
            let name = names.into_iter().find(|name| !name.is_empty()).unwrap_or_default().to_owned();
            let color = match segment.get("recommendedDisplayRGBValue") {
                Some(color) => Some(serde_json::from_value(color.clone()).ok()?),
                None => None,
            };
            all.push(LabelName { number, name, color });
        }
    }
    all.retain(|label| label.number > 0);
    (!all.is_empty()).then_some(all)
}

/// The labels of a table of lines; the error is the number of a line that cannot be read.
fn of_rows(text: &str, blanks: bool) -> Result<Vec<LabelName>, usize> {
    let mut names = Vec::new();
    let mut header: Option<(char, Columns)> = None;
    for (line, row) in (1_usize..).zip(text.lines()) {
        let row = row.trim();
        if row.is_empty() || row.starts_with('#') {
            continue;
        }
        if names.is_empty() && header.is_none() && !row.starts_with(|c: char| c.is_ascii_digit()) {
            let separator = if row.contains('\t') { '\t' } else { ',' };
            header = Some((separator, Columns::of(row, separator).ok_or(line)?));
            continue;
        }
        let label = match &header {
            Some((separator, columns)) => columns.label(row, *separator),
            None => of_fields(row, blanks),
        };
        match label.ok_or(line)? {
            label if label.number == 0 => {}
            label => names.push(label),
        }
    }
    if names.is_empty() { Err(0) } else { Ok(names) }
}

/// `number R G B A visible mesh "name"`, or `number name R G B A`.
fn of_fields(row: &str, blanks: bool) -> Option<LabelName> {
    let (before, name) = match row.split_once('"') {
        Some((before, rest)) => (before, Some(rest.strip_suffix('"')?)),
        None => (row, None),
    };
    let fields: Vec<&str> = before.split_whitespace().collect();
    let number = fields.first()?.parse().ok()?;
    let (name, first) = match name {
        Some(name) => (name.to_owned(), 1),
        None if blanks => (fields.get(1)?.replace('_', " "), 2),
        None => ((*fields.get(1)?).to_owned(), 2),
    };
    let part = |i: usize| fields.get(first + i)?.parse::<u8>().ok();
    Some(LabelName { number, name, color: Some([part(0)?, part(1)?, part(2)?]) })
}

/// The fields of a row; one in quotes may hold separators, and quotes that are doubled. `None` if a quote is not closed.
fn fields_of(row: &str, separator: char) -> Option<Vec<String>> {
    let mut fields = Vec::new();
    let mut rest = Some(row);
    while let Some(row) = rest {
        let row = row.trim_start_matches(|c: char| c.is_whitespace() && c != separator);
        let mut field = String::new();
        let mut behind = row;
        while let Some(quoted) = behind.strip_prefix('"') {
            let (inside, after) = quoted.split_once('"')?;
            field.push_str(inside);
            behind = after;
            if behind.starts_with('"') {
                field.push('"');
            }
        }
        let (plain, after) = behind.split_once(separator).map_or((behind, None), |(a, b)| (a, Some(b)));
        field.push_str(plain);
        fields.push(field.trim().to_owned());
        rest = after;
    }
    Some(fields)
}

/// Columns of a table with a header.
struct Columns {
    number: usize,
    name: usize,
    color: Option<usize>,
    parts: Option<[usize; 3]>,
}

impl Columns {
    fn of(header: &str, separator: char) -> Option<Self> {
        let names: Vec<String> =
            fields_of(header, separator)?.iter().map(|name| name.to_ascii_lowercase()).collect();
        let at = |wanted: &[&str]| names.iter().position(|name| wanted.contains(&name.as_str()));
        Some(Self {
            number: at(&["index", "labelvalue", "value", "label", "id"])?,
            name: at(&["name"])?,
            color: at(&["color", "colour"]),
            parts: at(&["color_r"]).zip(at(&["color_g"])).zip(at(&["color_b"])).map(|((r, g), b)| [r, g, b]),
        })
    }

    fn label(&self, row: &str, separator: char) -> Option<LabelName> {
        let fields = fields_of(row, separator)?;
        let number = fields.get(self.number)?.parse().ok()?;
        let color = match (self.parts, self.color.and_then(|at| fields.get(at))) {
            (Some(parts), _) => {
                let part = |i: usize| fields.get(parts[i])?.parse::<u8>().ok();
                Some([part(0)?, part(1)?, part(2)?])
            }
            (None, Some(color)) if !color.is_empty() && color != "n/a" => Some(text::color(color).ok()?),
            _ => None,
        };
        Some(LabelName { number, name: fields.get(self.name)?.clone(), color })
    }
}

/// Bytes of a label's name in a file name: file systems allow 255.
const MAX_NAME: usize = 200;

/// File names of labels without suffixes: their names, with the number if a name is missing or taken by a label before.
pub(super) fn file_names(labels: &[Label]) -> Vec<String> {
    let mut taken = HashSet::new();
    let plain = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    labels
        .iter()
        .map(|label| {
            let name: String = part_name(label).chars().map(plain).collect();
            // A leading dot would hide the file, a hyphen would make it an option.
            let mut name = name.trim_start_matches(['.', '-']).to_owned();
            while name.len() > MAX_NAME {
                name.pop();
            }
            if is_device_name(&name) {
                name.insert(0, '_');
            }
            while name.is_empty() || !taken.insert(name.to_lowercase()) {
                name.push_str(&format!("_{}", label.number));
            }
            name
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(number: u16, name: &str, color: Option<[u8; 3]>) -> LabelName {
        LabelName { number, name: name.into(), color }
    }

    #[test]
    fn the_programs_own_tables_are_asked_for_by_name() {
        let table = |name: &str| read_label_names(Path::new(name), false);
        let [bodies, brain] = ["totalsegmentator", "freesurfer"].map(|name| table(name).unwrap());
        assert_eq!(
            bodies.iter().map(|label| label.number).collect::<Vec<_>>(),
            (1..=117).collect::<Vec<_>>()
        );
        assert_eq!([&bodies[4], &bodies[116]].map(|label| &*label.name), ["liver", "costal_cartilages"]);
        for due in [
            label(17, "Left-Hippocampus", Some([220, 216, 20])),
            label(2035, "ctx-rh-insula", Some([255, 192, 32])),
            label(3001, "wm-lh-bankssts", Some([230, 155, 215])),
        ] {
            assert!(brain.contains(&due), "{due:?}");
        }
        let said = table("freesurfur").unwrap_err().to_string();
        assert!(said.contains("its tables are totalsegmentator, freesurfer"), "{said}");
    }

    #[test]
    fn tables_of_the_usual_tools_are_read_and_others_refused_with_their_line() {
        let folder = tempfile::tempdir().unwrap();
        let (red, blue) = (Some([255, 0, 0]), Some([0, 0, 254]));
        let due = [label(1, "left lung", red), label(7, "rib", blue)];
        let tables = [
            (
                "a.tsv",
                "index\tname\tabbreviation\tcolor\n0\tbackground\tB\t\n7\trib\tR\t#0000fe\n1\tleft lung\tL\t#ff0000\n",
            ),
            (
                "a.csv",
                "LabelValue,Name,Color_R,Color_G,Color_B,Color_A\n1,left lung,255,0,0,255\n7,rib,0,0,254,255\n",
            ),
            (
                "b.csv",
                "LabelValue,\"Name\",Remark,Color\n7, \"rib\" ,\"\"\"a\"\", b\",#0000fe\n1,\"left lung\",\"1,2\",red\n",
            ),
            (
                "a.txt",
                "# ITK-SNAP\n 0 0 0 0 0 0 0 \"Clear Label\"\n 1 255 0 0 1 1 1 \"left lung\"\n 7 0 0 254 0.5 1 0 \"rib\"\n",
            ),
            ("a.ctbl", "# Color table\n0 Background 0 0 0 0\n1 left_lung 255 0 0 255\n7 rib 0 0 254 255\n"),
            (
                "a.json",
                r#"{"segmentAttributes": [[{"labelID": 1, "SegmentLabel": "left lung", "recommendedDisplayRGBValue": [255, 0, 0]}], [{"labelID": 7, "SegmentDescription": "rib", "recommendedDisplayRGBValue": [0, 0, 254]}]]}"#,
            ),
        ];
        for (name, text) in tables {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            assert_eq!(read_label_names(&path, false).unwrap(), due, "{name}");
        }
        let wrong = [
            ("index\tname\n1\ta\n1\tb\n", "label 1 twice"),
            ("index\tname\tcolor\n1\ta\treddish\n", "line 2"),
            ("1 a 1 2\n", "line 1"),
            ("index,name\n7,\"rib\n", "line 2"),
            ("1 255 0 0 1 1 1 \"a\n", "line 1"),
            ("65536 a 1 2 3 0\n", "line 1"),
            ("liver\n", "line 1"),
            ("", "not a table"),
            ("{}", "not a table"),
            (r#"{"segmentAttributes": [[{"labelID": 70000}]]}"#, "not a table"),
            (
                r#"{"segmentAttributes": [[{"labelID": 7, "recommendedDisplayRGBValue": [1, 2, 256]}]]}"#,
                "not a table",
            ),
            ("i\0n\0d\0e\0x\0", "UTF-16"),
            (&format!("index\tname\n7\t{}\n", "a".repeat(1001)), "label 7 a name of 1001 bytes"),
        ];
        for (text, words) in wrong {
            let path = folder.path().join("w.txt");
            std::fs::write(&path, text).unwrap();
            let said = read_label_names(&path, false).unwrap_err().to_string();
            assert!(said.contains(words) && said.contains("w.txt"), "{text}: {said}");
        }
        assert!(read_label_names(&folder.path().join("absent.txt"), false).is_err());
        let latin = folder.path().join("latin.csv");
        std::fs::write(&latin, b"index,name\n1,lung\n7,\xe9paule\n").unwrap();
        let said = read_label_names(&latin, false).unwrap_err().to_string();
        assert!(said.contains("latin.csv: line 3 is not text in UTF-8"), "{said}");
        let path = folder.path().join("coded.json");
        let table = r#"{"segmentAttributes": [[{"labelID": 7, "SegmentLabel": "his kidney", "SegmentedPropertyTypeCodeSequence": {"CodeMeaning": "Kidney"}, "SegmentedPropertyTypeModifierCodeSequence": {"CodeMeaning": "Right"}}]]}"#;
        std::fs::write(&path, table).unwrap();
        for (typed, name) in [(false, "Right Kidney"), (true, "his kidney")] {
            assert_eq!(read_label_names(&path, typed).unwrap(), [label(7, name, None)]);
        }
    }

    #[test]
    fn files_of_labels_are_named_once_and_stay_in_their_folder() {
        let label = |number, name: &str| Label { number, name: name.into(), color: [0; 3], voxels: 1 };
        let labels = [label(1, "liver"), label(2, ""), label(3, "Liver"), label(7, "../a b"), label(9, "..")];
        assert_eq!(file_names(&labels), ["liver", "label_2", "Liver_3", "_a_b", "_9"]);
        // Windows' device names and invalid characters are replaced on every system.
        let labels = [label(1, "con"), label(2, "Com1.a"), label(3, "a<:>|?*\\b. "), label(4, "console")];
        assert_eq!(file_names(&labels), ["_con", "_Com1.a", "a_______b._", "console"]);
        let labels = [label(1, "x"), label(2, "x_3"), label(3, "x"), label(4, &"肝".repeat(100))];
        let names = file_names(&labels);
        assert_eq!(names[..3], ["x", "x_3", "x_3_3"]);
        assert_eq!(names[3], "肝".repeat(66));
    }
}
