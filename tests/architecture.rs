//! The arrows between modules point one way, and `unsafe` stays where it is known. If this fails, a
//! change tied together two parts that are understood, tested and replaced apart from each other.
//!
//! Read from the source text: every `crate::` path (grouped imports too) outside comments and outside
//! unit tests, at the end of a file or in a `tests.rs`, which may look wherever they need to.

#[path = "support/imports.rs"]
mod imports;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// What each top module may see besides itself. `error` is two things: it gathers the errors of every
/// boundary once, at the top; and every boundary may name `error::ExitKind`, which depends on nothing.
const MAY_SEE: &[(&str, &[&str])] = &[
    ("atomic", &[]),
    ("budget", &[]),
    ("codec", &[]),
    ("contact", &["geom", "load"]),
    ("cpu", &[]),
    ("exit", &[]),
    ("geom", &[]),
    ("format", &["cpu", "geom"]),
    ("mark", &[]),
    ("progress", &[]),
    ("resident", &["budget"]),
    ("scratch", &[]),
    ("stamp", &[]),
    ("facts", &["budget", "codec", "exit", "geom"]),
    ("volume", &["budget", "exit", "facts", "geom", "progress", "scratch", "stamp"]),
    ("source", &["budget", "codec", "cpu", "exit", "facts", "geom", "mark", "progress", "scratch", "volume"]),
    ("synthetic", &["facts", "geom", "volume"]),
    (
        "catalogue",
        &[
            "budget",
            "csg",
            "exit",
            "facts",
            "geom",
            "mark",
            "mesh",
            "progress",
            "scratch",
            "source",
            "stamp",
            "synthetic",
            "volume",
        ],
    ),
    (
        "builder",
        &["atomic", "budget", "cpu", "exit", "format", "geom", "progress", "resident", "scratch", "volume"],
    ),
    ("clean", &["budget", "builder", "exit", "format", "geom", "progress", "scratch", "volume"]),
    ("mesh", &["budget", "builder", "codec", "cpu", "facts", "format", "geom", "scratch", "source", "stamp"]),
    (
        "csg",
        &[
            "budget", "builder", "facts", "format", "geom", "mesh", "progress", "resident", "scratch",
            "source", "stamp", "volume",
        ],
    ),
    ("load", &["budget", "cpu", "exit", "format", "geom"]),
    ("render", &["atomic", "budget", "cpu", "exit", "format", "geom", "load", "mark"]),
    ("scene", &["exit", "format", "geom", "load", "render"]),
    ("enclosed", &["format", "geom", "load"]),
    ("export", &["enclosed", "format", "geom", "load", "progress", "render", "scratch"]),
    (
        "jobs",
        &[
            "atomic",
            "budget",
            "builder",
            "catalogue",
            "clean",
            "codec",
            "contact",
            "cpu",
            "csg",
            "enclosed",
            "error",
            "exit",
            "export",
            "facts",
            "format",
            "geom",
            "load",
            "mesh",
            "progress",
            "render",
            "resident",
            "scene",
            "scratch",
            "source",
            "synthetic",
            "volume",
        ],
    ),
    ("error", &["builder", "clean", "exit", "export", "facts", "format", "load", "render", "scene"]),
];

/// Modules that may see the gathered `Error` itself; those below it name only `ExitKind`.
const ABOVE_ERROR: &[&str] = &["jobs", "lib"];

/// Where sentences are written and flags named.
const SPEAKING: &[&str] = &["src/jobs/"];

/// Names of what holds a message; besides them, whatever is bound to the text of a value.
const MESSAGES: &[&str] = &[
    "cause", "error", "fault", "message", "misuse", "note", "reason", "refusal", "sentence", "warning", "why",
];

/// Calls that look for something in a text, or take it apart.
const TAKES_APART: &[&str] = &[
    "contains",
    "ends_with",
    "find",
    "lines",
    "match_indices",
    "matches",
    "replace",
    "replacen",
    "rfind",
    "rsplit",
    "rsplit_once",
    "rsplitn",
    "split",
    "split_at",
    "split_once",
    "split_whitespace",
    "splitn",
    "starts_with",
    "strip_prefix",
    "strip_suffix",
    "trim_end_matches",
    "trim_start_matches",
];

/// Files that may contain `unsafe`: the mapping, what happens when its file is cut short, and vector instructions beside their safe twins.
const UNSAFE_FILES: &[&str] = &[
    "bin/bus.rs",
    "src/builder/lanes.rs",
    "src/builder/simd.rs",
    "src/cpu.rs",
    "src/format/packed/lanes.rs",
    "src/load/map.rs",
    "src/render/lanes_x86.rs",
    "src/resident.rs",
];

/// Most files of which each depends on every other.
const MOST_IN_A_CIRCLE: usize = 3;

/// No source file is longer; near 300 is comfortable.
const MOST_LINES: usize = 800;

/// One source file: its path from the top of the project, and its text without comments.
struct Source {
    path: String,
    lines: usize,
    code: String,
}

impl Source {
    /// `build` for `src/builder/brick.rs` and for `src/builder.rs`.
    fn module(&self) -> &str {
        let inside = self.path.strip_prefix("src/").unwrap();
        inside.split(['/', '.']).next().unwrap()
    }

    /// How far below the crate the file's module is: 1 for `src/builder/mod.rs`, 2 for `src/builder/brick.rs`.
    fn depth(&self) -> usize {
        self.path.trim_end_matches("/mod.rs").matches('/').count()
    }

    /// The text before the file's unit tests, with the `super::` that reach the crate written `crate::`.
    fn without_tests(&self) -> String {
        let lines: Vec<&str> = self.code.lines().collect();
        let opens_tests = |i: &usize| {
            let after = lines[i + 1..].iter().find(|line| !line.starts_with("#["));
            lines[*i] == "#[cfg(test)]"
                && after.is_some_and(|line| line.starts_with("mod ") && line.ends_with('{'))
        };
        let end = (0..lines.len()).find(opens_tests).unwrap_or(lines.len());
        lines[..end].join("\n").replace(&"super::".repeat(self.depth()), "crate::")
    }
}

/// Every Rust file below a folder of the project.
fn sources(folder: &str) -> Vec<Source> {
    let top = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = vec![top.join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                let path = path.strip_prefix(top).unwrap().to_string_lossy().replace('\\', "/");
                found.push(Source { path, lines: text.lines().count(), code: without_comments(&text) });
            }
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    assert!(!found.is_empty(), "no source files below {folder}");
    found
}

/// Line comments, documentation included, taken out; the house style has no block comments.
fn without_comments(text: &str) -> String {
    let keep = |line: &str| {
        let code = line.trim_start();
        if code.starts_with("//") { String::new() } else { line.split(" // ").next().unwrap().to_owned() }
    };
    text.lines().map(|line| keep(line) + "\n").collect()
}

/// The leading identifier of a text.
fn word(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

/// Every `crate::a::...` as `a` with what follows it; `crate::{a::X, b}` gives one for each part.
fn crate_paths(code: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '$') {
            continue;
        }
        let rest = &code[at + "crate::".len()..];
        let Some(group) = rest.strip_prefix('{') else {
            let name = word(rest);
            found.push((name.to_owned(), rest[name.len()..].chars().take(80).collect()));
            continue;
        };
        let (mut depth, mut part) = (0, String::new());
        for c in group.chars() {
            match c {
                '}' if depth == 0 => break,
                ',' if depth == 0 => {
                    let name = word(part.trim()).to_owned();
                    found.push((name.clone(), part.trim()[name.len()..].to_owned()));
                    part.clear();
                    continue;
                }
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            part.push(c);
        }
        let name = word(part.trim()).to_owned();
        if !name.is_empty() {
            found.push((name.clone(), part.trim()[name.len()..].to_owned()));
        }
    }
    found
}

/// Arrows that no rule allows, one sentence each.
fn forbidden(source: &Source) -> Vec<String> {
    let module = source.module();
    if module == "lib" || source.path.ends_with("/tests.rs") {
        return Vec::new();
    }
    let Some((_, may_see)) = MAY_SEE.iter().find(|(name, _)| *name == module) else {
        return vec![format!("{}: the module `{module}` has no place in MAY_SEE", source.path)];
    };
    let mut wrong = Vec::new();
    for (name, _) in crate_paths(&source.without_tests()) {
        if name == module {
            continue;
        }
        // Both are re-exported at the top.
        let name = match name.as_str() {
            "Error" => "error".to_owned(),
            "ExitKind" => "exit".to_owned(),
            _ => name,
        };
        if !may_see.contains(&name.as_str()) {
            wrong.push(format!("{}: `{module}` must not see `{name}`", source.path));
        } else if name == "error" && !ABOVE_ERROR.contains(&module) {
            wrong.push(format!("{}: `{module}` is below the gathered error; name its own", source.path));
        }
    }
    wrong
}

#[test]
fn arrows_between_modules_point_one_way() {
    let all = sources("src");
    let wrong: Vec<String> = all.iter().flat_map(forbidden).collect();
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
    // The rules are about modules that exist.
    let modules: BTreeSet<&str> = all.iter().map(Source::module).collect();
    for name in [
        "budget",
        "builder",
        "catalogue",
        "error",
        "format",
        "geom",
        "jobs",
        "load",
        "render",
        "source",
        "synthetic",
        "volume",
    ] {
        assert!(modules.contains(name), "no module {name}");
    }
}

#[test]
fn the_rules_have_no_circle_below_the_gathered_error() {
    // Taken away layer by layer: a module whose every dependency is gone can go.
    let mut left: Vec<&str> = MAY_SEE.iter().map(|(name, _)| *name).filter(|n| *n != "error").collect();
    while !left.is_empty() {
        let free = |name: &&str| {
            let (_, may_see) = MAY_SEE.iter().find(|(n, _)| n == name).unwrap();
            !may_see.iter().any(|m| left.contains(m))
        };
        let (gone, rest): (Vec<&str>, Vec<&str>) = left.iter().partition(|n| free(n));
        assert!(!gone.is_empty(), "a circle among {left:?}");
        left = rest;
    }
}

#[test]
fn the_command_knows_the_library_only_from_outside() {
    for source in sources("bin") {
        for (name, _) in crate_paths(&source.code) {
            assert!(
                ["args", "bars", "bus", "failure", "manual", "pictures", "print", "streams"]
                    .contains(&name.as_str()),
                "{}: crate::{name}",
                source.path
            );
        }
    }
}

/// Flags named in a text of the code, and sentences in the definition of an error.
fn spoken(source: &Source) -> Vec<String> {
    let code = source.without_tests();
    let flag = |at: usize| {
        code[at + 2..].starts_with(|c: char| c.is_ascii_lowercase())
            && code[..at].ends_with(|c: char| c.is_whitespace() || "\"'`(".contains(c))
    };
    let flags = code.match_indices("--").map(|(at, _)| at).filter(|at| flag(*at));
    let sentences = code.match_indices("#[error(").map(|(at, _)| at);
    let line = |at: usize| code[at..].lines().next().unwrap_or_default().to_owned();
    flags.chain(sentences).map(|at| format!("{}: {}", source.path, line(at))).collect()
}

#[test]
fn sentences_and_flags_are_written_in_jobs_only() {
    for source in sources("src") {
        if SPEAKING.iter().any(|part| source.path.starts_with(part)) || source.path.ends_with("/tests.rs") {
            continue;
        }
        let wrong = spoken(&source);
        assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
    }
}

/// Calls that take a message apart: on a value's text (`x.to_string().split(..)`), on a name that was bound to
/// one (`let x = ... .to_string();`), or on a name that stands for one ([`MESSAGES`]).
///
/// That is as far as the text of the code tells; what a function gives back under another name it does not.
fn taken_apart(source: &Source) -> Vec<String> {
    let code = source.without_tests();
    let mut wrong = Vec::new();
    let mut bound: BTreeSet<&str> = BTreeSet::new();
    for line in code.lines() {
        let line = line.trim();
        // Names count within one function.
        if word(line) == "fn" || line.contains(" fn ") {
            bound.clear();
        }
        if let Some(rest) = line.strip_prefix("let ") {
            let name = word(rest.strip_prefix("mut ").unwrap_or(rest));
            // A report as JSON is data, which is written in parts.
            if line.ends_with(".to_string();") && !line.contains("json") {
                bound.insert(name);
            } else {
                bound.remove(name);
            }
        }
        for call in TAKES_APART {
            for (at, _) in line.match_indices(&format!(".{call}(")) {
                // `a.as_str().split(..)` is about `a`.
                let before = line[..at].trim_end_matches(".as_str()").trim_end_matches(".as_deref()");
                let start = before.rfind(|c: char| !c.is_alphanumeric() && c != '_').map_or(0, |i| i + 1);
                let name = &before[start..];
                let is_text = before.ends_with(".to_string()") || MESSAGES.contains(&name);
                if is_text || bound.contains(name) {
                    wrong.push(format!("{}: {line}", source.path));
                }
            }
        }
    }
    wrong
}

#[test]
fn no_message_is_taken_apart() {
    for folder in ["src", "bin"] {
        for source in sources(folder) {
            if source.path.ends_with("tests.rs") {
                continue;
            }
            let wrong = taken_apart(&source);
            assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
        }
    }
}

#[test]
fn messages_are_seen_where_they_are_taken_apart() {
    let source =
        |code: &str| Source { path: "src/a/b.rs".to_owned(), lines: 1, code: without_comments(code) };
    for wrong in [
        "if error.to_string().contains(\"cut short\") {}",
        "let text = error.to_string();\nif text.starts_with(\"a\") {}",
        "let (path, rest) = self.reason.split_once(\": \").unwrap();",
        "item.warning.as_deref().strip_prefix(input)",
    ] {
        assert_eq!(taken_apart(&source(wrong)).len(), 1, "{wrong}");
    }
    for sound in [
        "let text = error.to_string();\nfn next() {}\nif text.starts_with(\"a\") {}",
        "if header.contains(\"dims\") {}",
        "notes.contains(&note)",
        "#[cfg(test)]\nmod tests {\nerror.to_string().contains(\"a\");\n}",
    ] {
        assert!(taken_apart(&source(sound)).is_empty(), "{sound}");
    }
    assert_eq!(spoken(&source("let a = \"check --dims\";\n#[error(\"no\")]\nlet b = a--c; // --d")).len(), 2);
}

#[test]
fn circles_of_files_stay_small_and_no_module_holds_too_much() {
    let imports = imports::Imports::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"));
    let circles = imports.circles();
    let large: Vec<String> =
        circles.iter().filter(|c| c.len() > MOST_IN_A_CIRCLE).map(|c| c.join(" ")).collect();
    assert!(large.is_empty(), "\n{}", large.join("\n"));
    // The reader sees circles at all: the table of formats and the formats of slices know each other.
    assert!(circles.iter().any(|c| c.iter().any(|file| file == "source/formats")), "{circles:?}");
    let lines = imports.lines();
    let all: usize = lines.values().sum();
    for (module, own) in lines {
        assert!(3 * own <= all, "{module}: {own} of {all} lines");
    }
}

#[test]
fn files_stay_short() {
    for folder in ["src", "bin", "tests"] {
        for source in sources(folder) {
            assert!(source.lines <= MOST_LINES, "{}: {} lines", source.path, source.lines);
        }
    }
}

#[test]
fn unsafe_stays_in_the_known_files() {
    for folder in ["src", "bin"] {
        for source in sources(folder) {
            let uses = source.code.split(|c: char| !c.is_alphanumeric() && c != '_').any(|w| w == "unsafe");
            assert!(!uses || UNSAFE_FILES.contains(&source.path.as_str()), "{}: unsafe", source.path);
        }
    }
}

#[test]
fn the_reader_of_this_test_sees_what_it_should() {
    let path = "src/load/example.rs".to_owned();
    let code = "use crate::builder::plan;\nuse crate::{geom::Dims, render, error::{Error}};\n\
                // use crate::jobs;\nlet x = crate::format::f(); let y = mycrate::jobs;\n\
                use super::super::jobs;\nuse super::model;\n#[cfg(test)]\nmod outline;\n\
                use crate::source;\n#[cfg(test)]\n#[expect(lint)]\nmod tests {\nuse crate::bin;\n}\n";
    let example = Source { path, lines: 1, code: without_comments(code) };
    let names: Vec<String> = crate_paths(&example.without_tests()).into_iter().map(|(n, _)| n).collect();
    assert_eq!(names, ["builder", "geom", "render", "error", "format", "jobs", "source"]);
    let wrong = forbidden(&example);
    // All but geom and format; of `error` the gathered one is wrong.
    assert_eq!(wrong.len(), 5, "{wrong:?}");
    let strange = Source { path: "src/strange.rs".to_owned(), lines: 1, code: String::new() };
    assert_eq!(forbidden(&strange).len(), 1);
}

/// Where foreign text becomes printable.
const FOREIGN: &str = "src/jobs/wording/foreign.rs";

#[test]
fn foreign_text_is_printed_in_one_way() {
    // A path that speaks for itself prints whatever its name holds.
    for folder in ["src/jobs", "bin"] {
        for source in sources(folder).iter().filter(|source| source.path != FOREIGN) {
            let code = source.without_tests();
            for call in [".display()", "to_string_lossy()"] {
                let line = code.lines().find(|line| line.contains(call));
                // Parts of names that make other names, or are compared, are not printed.
                let is_name = |line: &str| {
                    ["file_stem()", "extension()", "args_os()"].iter().any(|part| line.contains(part))
                };
                assert!(line.is_none_or(is_name), "{}: {}", source.path, line.unwrap_or_default());
            }
        }
    }
}
