//! A model as a page that any browser shows: one HTML file with the model in it, drawn by WebGL2, without a network.
//!
//! ```text
//! sections --differences, deflate, base64--> script elements that no browser runs
//!                                              | load.js, model.js
//!                                 integer textures --trace.glsl--> pictures; picks in doubles
//! ```
//!
//! | file | content |
//! |---|---|
//! | `data` | the sections of a model, in the form of the page |
//! | `page.html`, `page.css` | parts shown before, beside and without scripts |
//! | `load.js`, `model.js` | the model in the browser, and rays through it one at a time; run under node, too |
//! | `stream.js` | instead of `load.js`: the model of an `.oct` file on the page's own server, by Range requests, coarse first |
//! | `ask.js` | pictures of `oct view` for browsers that cannot draw the model |
//! | `trace.glsl`, `draw.js` | the same rays on the graphics processor, one a fragment |
//! | `camera.js`, `ui.js` | cameras, the cut, the address; events, marks, keys |
//!
//! The page may run its own script and nothing else (CSP level 2 by a hash), and may not load anything; a linked one may
//! fetch from its own server.

mod data;

use std::io::{self, Write};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::format::{Channel, Label, Quantity, SectionKind, ValueColors};
use crate::geom::Affine;
use crate::load::{Model, NodeView};
use crate::render::GridSpace;
use crate::render::walls::Hidden;
use crate::text::{html, size_title};

use data::Section;

pub(crate) use data::MAX_LABELS;

/// Most bytes of sections in a page, as they lie in the file: pages of 315 MB opened, in 11 s.
pub(crate) const MAX_BYTES: u64 = 400 << 20;

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const TRACE: &str = include_str!("trace.glsl");
/// Scripts in the order of their dependencies; those that load the model follow the first.
const SCRIPTS: [&str; 4] =
    [include_str!("model.js"), include_str!("camera.js"), include_str!("draw.js"), include_str!("ui.js")];
const LOAD: &str = include_str!("load.js");
const ASK: &str = include_str!("ask.js");
const STREAM: &str = include_str!("stream.js");

/// Degrees between the bottom and the top of the page's perspective pictures (`FOV` of camera.js).
pub(crate) const FOV_DEG: f64 = 30.0;

/// Height of the first view in heights of the model, as `camera.js` has it.
const MARGIN: f64 = 1.06;

/// Transport of a page to a browser.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transport {
    /// From a file.
    File,
    /// From a server that makes pictures, too.
    Served,
    /// From such a server, and without the model's sections: all pictures come from the server.
    Pictures,
    /// From any server, from which it fetches the model.
    Linked,
}

/// Content of a page.
pub(crate) enum Shown<'a, D> {
    /// A model, and its first view in the form that pages write, empty for the front.
    Model(&'a Model<D>, &'a GridSpace, String),
    /// A scene, by pictures of a server: its least and greatest corner in LPS mm, and its own view.
    Scene([[f64; 3]; 2], String),
    /// The model of a file next to a linked page, or one named in the page's address.
    Linked(Option<&'a str>),
}

impl<D: AsRef<[u8]>> Shown<'_, D> {
    /// The title, with the size of a model.
    fn caption(&self, title: &str) -> String {
        match self {
            Self::Model(model, space, _) => {
                size_title(title, |direction| space.support_of_inside(&model.view(), direction, None))
            }
            _ => title.to_owned(),
        }
    }

    /// Classes of the page, which tell its scripts what to prepare while the model is loading.
    fn kind(&self, way: Transport) -> &'static str {
        let has_labels = matches!(self, Self::Model(model, ..) if !model.frame().labels.is_empty());
        match (way, has_labels) {
            (Transport::Pictures, true) => "asks",
            (Transport::Pictures, false) => "asks plain",
            (_, true) => "",
            // Linked models are coarse at first, without labels.
            (_, false) => "plain",
        }
    }
}

/// The model's facts for the page's scripts, as JSON.
#[derive(Default, Serialize)]
struct Head<'a> {
    depth: u32,
    /// Boxes along x, y, z.
    dims: [u32; 3],
    nodes: u64,
    voxels: u64,
    leaves: u64,
    cells: bool,
    /// Index of a box, with its middle at whole numbers, to LPS mm.
    affine: [[f64; 4]; 3],
    /// Least and greatest corner of the surface in LPS mm.
    box_mm: [[f64; 3]; 2],
    /// Bytes of a value; physical value = `value_scale[0]` x stored + `value_scale[1]`.
    value_bytes: u8,
    value_scale: [f64; 2],
    /// True if the axes are a patient's.
    patient: bool,
    /// The first view; empty for the front.
    start: &'a str,
    /// True if the page may ask for pictures.
    served: bool,
    /// The table of labels; labels of voxels are indices into it.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    labels: &'a [Label],
    #[serde(skip_serializing_if = "Option::is_none")]
    quantity: Option<Measured<'a>>,
    sections: Vec<Section>,
}

/// A measured quantity, with the colours of its values.
#[derive(Serialize)]
struct Measured<'a> {
    name: &'a str,
    unit: &'a str,
    sign: &'a str,
    /// Values of the first and the last colour; colours are at even steps.
    range: [f64; 2],
    colors: Vec<[u8; 3]>,
    /// Colour of boxes without a value.
    none: [u8; 3],
}

impl<'a> Measured<'a> {
    fn of(quantity: &'a Quantity, scale: [f64; 2]) -> Self {
        let colors = ValueColors::new(quantity, scale, None, None);
        let [low, high] = colors.range;
        let at = |step: u8| colors.at(low + (high - low) * f64::from(step) / 255.0);
        let Quantity { name, unit, sign, .. } = quantity;
        Self {
            name,
            unit,
            sign,
            range: colors.range,
            colors: (0..=255).map(at).collect(),
            none: ValueColors::NONE,
        }
    }
}

/// Writes a page; `picture` is a PNG of its content for browsers without scripts or WebGL2, and for print; it may be
/// empty.
///
/// Memory: some 200 KiB. Cost: `deflate` of all sections but those that are rebuilt, some 30 ns a byte.
///
/// # Errors
/// Errors of `out`.
pub(crate) fn write<D: AsRef<[u8]>>(
    shown: &Shown<'_, D>,
    title: &str,
    picture: &[u8],
    way: Transport,
    out: &mut dyn Write,
) -> io::Result<()> {
    let script = script(way);
    let hash = |text: &str| format!("'sha256-{}'", STANDARD.encode(Sha256::digest(text)));
    let style = slim(STYLE);
    let policy = format!(
        "default-src 'none'; script-src {}; style-src {}; img-src blob: data:{}; base-uri 'none'; form-action 'none'",
        hash(&script),
        hash(&style),
        match way {
            Transport::File => "",
            Transport::Served | Transport::Pictures => " 'self'",
            Transport::Linked => "; connect-src 'self'",
        }
    );
    for part in PAGE.split("{{") {
        let (name, text) = part.split_once("}}").unwrap_or(("", part));
        match name {
            "POLICY" => out.write_all(policy.as_bytes())?,
            "TITLE" => out.write_all(html(title).as_bytes())?,
            "CAPTION" => out.write_all(html(&shown.caption(title)).as_bytes())?,
            "STYLE" => out.write_all(style.as_bytes())?,
            "PICTURE" if picture.is_empty() => out.write_all(b"data:,")?,
            "PICTURE" => write!(out, "data:image/png;base64,{}", STANDARD.encode(picture))?,
            "DATA" => write_data(shown, way, out)?,
            "KIND" => out.write_all(shown.kind(way).as_bytes())?,
            "SCRIPT" => out.write_all(script.as_bytes())?,
            _ => {}
        }
        out.write_all(text.as_bytes())?;
    }
    out.flush()
}

fn write_data<D: AsRef<[u8]>>(shown: &Shown<'_, D>, way: Transport, out: &mut dyn Write) -> io::Result<()> {
    let mut head = match shown {
        Shown::Linked(model) => return write_head(&serde_json::json!({ "model": model }), out),
        Shown::Model(model, space, start) => Head { start, ..Head::of(model, space) },
        Shown::Scene(box_mm, start) => {
            let affine = Affine::from_spacing([1.0; 3]).rows;
            Head { box_mm: *box_mm, affine, start, ..Head::default() }
        }
    };
    head.served = way != Transport::File;
    if let (Shown::Model(model, ..), Transport::File | Transport::Served) = (shown, way) {
        head.sections = data::write(model, out)?;
    }
    write_head(&head, out)
}

fn write_head(head: &impl Serialize, out: &mut dyn Write) -> io::Result<()> {
    // The name of a label could close the script element.
    let head = serde_json::to_string(head).map_err(io::Error::other)?.replace('<', "\\u003c");
    write!(out, "<script type=\"application/json\" id=\"head\">{head}</script>")
}

impl<'a> Head<'a> {
    /// A model's facts, without its sections.
    fn of<D: AsRef<[u8]>>(model: &'a Model<D>, space: &GridSpace) -> Self {
        let (header, meta, view) = (model.header(), model.metadata(), model.view());
        let entry = |kind| model.frame().section(kind);
        let reach = |axis: usize, sign: f64| sign * space.support(&view, along(axis, sign));
        Self {
            depth: view.depth(),
            dims: model.dims().to_array(),
            nodes: header.nodes,
            voxels: header.voxels,
            leaves: entry(SectionKind::LeafNormals).map_or(0, |entry| entry.items),
            cells: view.cells().is_some(),
            affine: model.affine().rows,
            box_mm: [-1.0, 1.0].map(|sign| std::array::from_fn(|axis| reach(axis, sign))),
            value_bytes: entry(SectionKind::Voxels(Channel::Value)).map_or(0, |entry| entry.item_bytes),
            value_scale: meta.value_scale,
            patient: meta.source.is_patient(),
            labels: &model.frame().labels,
            quantity: model.frame().quantity.as_ref().map(|of| Measured::of(of, meta.value_scale)),
            ..Self::default()
        }
    }
}

/// A vector along an axis.
fn along(axis: usize, length: f64) -> [f64; 3] {
    std::array::from_fn(|a| if a == axis { length } else { 0.0 })
}

/// The view from the front of some labels alone, in the form that pages write.
pub(crate) fn front_of(model: &Model, space: &GridSpace, hidden: &[u16]) -> String {
    let (view, of) = (model.view(), Hidden::of(hidden.iter().copied()));
    let bounds = space.bounds_of_visible(&view, &of, &|| {});
    let ends = [0, 1, 2].map(|axis| {
        [-1.0, 1.0].map(|sign| sign * space.support_of_inside(&view, along(axis, sign), Some((&of, bounds))))
    });
    let [x, y, z] = ends.map(|[low, high]| f64::midpoint(low, high));
    let half =
        MARGIN * [ends[0], ends[2]].map(|[low, high]| (high - low) / 2.0).into_iter().fold(0.0, f64::max);
    let hidden: Vec<_> = hidden.iter().map(u16::to_string).collect();
    format!("t={x},{y},{z}&h={half}&x={}", hidden.join(","))
}

fn script(way: Transport) -> String {
    let squeezed = |text: &str| joined(&shortened(&slim(text)));
    let [model, camera, draw, ui] = SCRIPTS.map(squeezed);
    let load = match way {
        Transport::File => squeezed(LOAD),
        Transport::Served | Transport::Pictures => squeezed(LOAD) + &squeezed(ASK),
        Transport::Linked => squeezed(STREAM),
    };
    let trace = serde_json::Value::from(joined(&slim(TRACE)));
    // One strict scope; a shader is a string of it.
    format!("'use strict';\n{model}{load}{camera}{draw}const SHADER = {trace};\n{ui}")
}

/// A text without indentation, empty lines, lines of comments, and parts for node alone.
fn slim(text: &str) -> String {
    let mut slim = String::with_capacity(text.len());
    let mut comment = false;
    for line in text.lines().map(str::trim) {
        comment |= line.starts_with("/*");
        let is_left_out = line.is_empty()
            || ["//", "'use strict'", "if (typeof module"].iter().any(|begin| line.starts_with(begin));
        if !(comment || is_left_out) {
            slim.push_str(line);
            slim.push('\n');
        }
        comment &= !line.ends_with("*/");
    }
    slim
}

/// Lines without blanks, joined where punctuation separates them, since every statement ends with a semicolon. Lines of
/// the preprocessor stay alone, and lines that may hold a comment.
fn joined(text: &str) -> String {
    let mut joined = String::with_capacity(text.len());
    let is_alone = |line: &str| line.starts_with('#') || line.contains("//");
    let mut was_alone = true;
    for line in text.lines() {
        let fits = joined.ends_with([';', '{', '}', ',']) || line.starts_with('}');
        if !joined.is_empty() && (was_alone || is_alone(line) || !fits) {
            joined.push('\n');
        }
        joined.push_str(&tight(line));
        was_alone = is_alone(line);
    }
    joined.push('\n');
    joined
}

/// Lines of a script in a shorter form: `let` for constants, and no semicolon where a block ends after a statement. A
/// loop without a body does not end a block.
fn shortened(text: &str) -> String {
    let mut short = String::with_capacity(text.len());
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next() {
        let is_last = lines.peek().is_some_and(|next| next.starts_with('}'));
        let line = line.strip_suffix(';').filter(|_| is_last).unwrap_or(line);
        match line.strip_prefix("const ") {
            Some(rest) => short += &format!("let {rest}"),
            None => short += &line.replace("for (const ", "for (let "),
        }
        short.push('\n');
    }
    short
}

/// A line of a script or shader without blanks around punctuation, unless its strings cannot be told for certain.
fn tight(line: &str) -> String {
    // Code and strings in turn; a string ends with the quote that it begins with.
    let (mut texts, mut mark) = (vec![String::new()], None);
    for c in line.chars() {
        match mark {
            None if matches!(c, '\'' | '"' | '`') => {
                mark = Some(c);
                texts.push(c.to_string());
            }
            _ => {
                texts.last_mut().into_iter().for_each(|text| text.push(c));
                if mark == Some(c) {
                    mark = None;
                    texts.push(String::new());
                }
            }
        }
    }
    let unclear = |code: &str| {
        code.replace(" / ", "").contains(['/', '#']) || code.contains("+ +") || code.contains("- -")
    };
    if line.contains('\\')
        || line.matches('`').count() > 2
        || texts.iter().step_by(2).any(|code| unclear(code))
    {
        return line.to_owned();
    }
    texts.iter().enumerate().map(|(i, text)| if i % 2 == 0 { code(text) } else { text.clone() }).collect()
}

fn code(text: &str) -> String {
    let is_mark = |c: Option<char>| c.is_some_and(|c| "-=,;(){}*?:<>&|[]!%+^/".contains(c));
    let all: Vec<char> = text.chars().collect();
    let at = |i: usize| all.get(i).copied();
    let needed = |&i: &usize| at(i) != Some(' ') || !(is_mark(at(i + 1)) || i > 0 && is_mark(at(i - 1)));
    (0..all.len()).filter(needed).filter_map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scripts_are_short_and_cannot_end_their_element() {
        for way in [Transport::File, Transport::Served, Transport::Pictures, Transport::Linked] {
            let script = script(way);
            assert!(script.len() < 60 << 10, "{way:?}: {}", script.len());
            assert!(!script.contains("</script") && !script.contains("<!--"));
            assert!(!script.contains("innerHTML") && !script.contains("eval("));
        }
    }

    #[test]
    fn comments_are_left_out() {
        assert_eq!(slim("  a\n\n// b\n  /** c\n d */\ne /* f */\n"), "a\ne /* f */\n");
    }

    #[test]
    fn lines_are_joined_where_marks_part_them() {
        for (text, wanted) in [
            ("if (a) {\nb;\n}\nc;\nd;\n", "if(a){b;}c;d;\n"),
            ("a;\n#ifdef B\nc;\n#endif\nd,\ne\n", "a;\n#ifdef B\nc;\n#endif\nd,e\n"),
            ("a = 'http://b';\nc;\n", "a='http://b';\nc;\n"),
            ("return a\n&& b\n}\n", "return a\n&&b}\n"),
        ] {
            assert_eq!(joined(text), wanted);
        }
    }

    #[test]
    fn constants_and_ends_of_blocks_are_shortened() {
        let text = "if (a) {\nconst b = 'c;}';\nreturn b;\n}\nd;\n";
        assert_eq!(shortened(text), "if (a) {\nlet b = 'c;}';\nreturn b\n}\nd;\n");
    }

    #[test]
    fn blanks_are_left_out_but_within_strings() {
        for (line, wanted) in [
            ("if (a > b) return [c, -d];", "if(a>b)return[c,-d];"),
            ("say('a, b', c - -d);", "say('a, b', c - -d);"),
            ("const x = 'a, b' + c, y = d / e;", "const x='a, b'+c,y=d/e;"),
            ("a = `b, ${c}` + \"d, e\";", "a=`b, ${c}`+\"d, e\";"),
            ("x = /a, b/;", "x = /a, b/;"),
            ("#define A (b)", "#define A (b)"),
        ] {
            assert_eq!(tight(line), wanted);
        }
    }
}
