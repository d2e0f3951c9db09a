//! The arrows between modules point one way, and `unsafe` stays where it is known. If this fails, a
//! change tied together two parts that are understood, tested and replaced apart from each other.
//!
//! Read from the source text, outside comments and unit tests; only what the privacy of modules and the lints
//! cannot say.

use crate::prelude::*;

/// What each top module may see besides itself and `platform`. `error` gathers the errors of every boundary at the
/// top; `ExitKind` depends on nothing.
const MAY_SEE: &[(&str, &str)] = &[
    ("atomic", ""),
    ("budget", ""),
    ("codec", "order"),
    ("intersect", "geom load"),
    ("cpu", ""),
    ("exit", ""),
    ("geom", ""),
    ("text", "atomic"),
    ("format", "cpu geom text"),
    ("picture_mark", ""),
    ("order", ""),
    ("progress", ""),
    ("platform", ""),
    ("scratch", "budget"),
    ("identity", ""),
    ("fault", "exit text"),
    ("volume", "budget exit fault geom identity progress scratch text"),
    ("source", "budget codec cpu exit fault geom picture_mark order progress scratch text volume"),
    ("synthetic", "fault geom text volume"),
    (
        "discovery",
        "budget csg exit fault geom identity picture_mark mesh order progress scratch source synthetic text volume",
    ),
    ("builder", "atomic budget cpu exit fault format geom progress scratch text volume"),
    ("clean", "budget builder exit fault format geom progress scratch text volume"),
    ("mesh", "budget builder codec cpu fault format geom identity scratch source text volume"),
    ("csg", "budget builder fault format geom identity mesh order progress scratch source text volume"),
    ("load", "budget cpu exit format geom text"),
    ("render", "atomic budget cpu exit fault format geom load picture_mark text"),
    ("scene", "cpu exit fault format geom load order render text"),
    ("interior", "format geom load"),
    ("measure", "atomic cpu fault format geom load order text"),
    ("page", "format geom load render text"),
    ("export", "cpu interior format geom load order progress render scratch text"),
    (
        "jobs",
        "atomic budget builder discovery clean codec intersect cpu csg interior error exit export fault \
         format geom load measure mesh order page progress render scene scratch source synthetic text volume",
    ),
    (
        "python",
        "budget builder clean clean_and_build error exit export fault format geom jobs load mesh progress render \
         source text volume",
    ),
    ("error", "budget builder clean exit export fault format load page progress render scene text volume"),
];

/// Calls that look for something in a message, or take it apart.
const TAKES_APART: &str = "contains ends_with find lines match_indices matches replace replacen rfind rsplit \
    rsplit_once rsplitn split split_at split_once split_whitespace splitn starts_with strip_prefix strip_suffix \
    trim_end_matches trim_start_matches";

/// What a message is bound to; a text made of a value (`to_string()`) is one, too.
const MESSAGES: &str = "cause error fault message misuse note reason refusal sentence warning why";

/// Files that may contain `unsafe`: the mapping, what happens when its file is cut short, and vector instructions with
/// safe twins.
const UNSAFE_FILES: &[&str] = &[
    "bin/platform/unix.rs",
    "src/builder/lanes.rs",
    "src/cpu/x86.rs",
    "src/format/packed/lanes.rs",
    "src/load/map.rs",
    "src/platform/linux/resident.rs",
    "src/platform/macos/machine.rs",
    "src/platform/macos/memory.rs",
    "src/platform/unix/mod.rs",
    "src/platform/unix/torn.rs",
    "src/platform/windows/files.rs",
    "src/platform/windows/machine.rs",
    "src/platform/windows/memory.rs",
    "src/render/pairs_vbmi2.rs",
];

/// Where the operating system is seen, and how.
const PLATFORM: &[&str] = &["src/platform/", "bin/platform/"];
const SYSTEM: &[&str] = &[
    "std::os::",
    "/proc",
    "rustix::",
    "libc::",
    "signal_hook::",
    "target_os",
    "windows_sys::",
    "cfg(windows",
];

/// No source file is longer; near 300 is comfortable.
const MAX_LINES: usize = 800;

/// One source file: its path from the top of the project, its text without comments, and where its unit tests begin.
struct Source {
    path: String,
    lines: usize,
    text: String,
    tests: usize,
}

impl Source {
    fn new(path: String, text: &str) -> Self {
        let code = |line: &str| {
            let is_comment = line.trim_start().starts_with("//");
            if is_comment { String::new() } else { line.split(" // ").next().unwrap().to_owned() + "\n" }
        };
        let (lines, text) = (text.lines().count(), text.lines().map(code).collect::<String>());
        let opens_tests = |at: &usize| {
            let mut after = text[*at..].lines().skip_while(|line| line.starts_with("#["));
            after.next().is_some_and(|line| line.starts_with("mod ") && line.ends_with('{'))
        };
        let tests = text.match_indices("#[cfg(test)]\n").map(|(at, _)| at).find(opens_tests);
        let is_test = path.ends_with("/tests.rs") || text.contains("#![cfg(test)]");
        let tests = if is_test { 0 } else { tests.unwrap_or(text.len()) };
        Self { path, lines, text, tests }
    }

    /// What stands before the unit tests.
    fn code(&self) -> &str {
        &self.text[..self.tests]
    }

    /// `builder` for `src/builder/brick.rs` and for `src/builder.rs`.
    fn module(&self) -> &str {
        self.path.split(['/', '.']).nth(1).unwrap()
    }

    /// The line of the code that holds a place.
    fn line(&self, at: usize) -> String {
        let start = self.text[..at].rfind('\n').map_or(0, |end| end + 1);
        format!("{}: {}", self.path, self.text[start..].lines().next().unwrap_or_default())
    }
}

/// Every Rust file below a folder of the project.
fn sources(folder: &str) -> Vec<Source> {
    let top = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut found, mut folders): (_, Vec<PathBuf>) = (Vec::new(), vec![top.join(folder)]);
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let name = path.strip_prefix(top).unwrap().to_string_lossy().replace('\\', "/");
                found.push(Source::new(name, &fs::read_to_string(&path).unwrap()));
            }
        }
    }
    assert!(!found.is_empty(), "no source files below {folder}");
    found
}

fn assert_none(wrong: &[String]) {
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

/// The leading identifier of a text.
fn word(text: &str) -> &str {
    &text[..text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len())]
}

/// Arrows that no rule allows, one sentence each.
fn forbidden(source: &Source) -> Vec<String> {
    let module = source.module();
    let Some((_, may_see)) = MAY_SEE.iter().find(|(name, _)| *name == module) else {
        return vec![format!("{}: the module `{module}` has no row in MAY_SEE", source.path)];
    };
    // As many `super` as the file is deep reach the crate.
    let depth = source.path.trim_end_matches("/mod.rs").matches('/').count();
    let code = source.code().replace(&"super::".repeat(depth), "crate::");
    let seen = code.split("crate::").skip(1).map(|path| match word(path) {
        "Error" => "error",
        "ExitKind" => "exit",
        // A group of paths is written as several lines.
        "" => "{",
        name => name,
    });
    let wrong = seen.filter(|name| {
        *name != module && *name != "platform" && !may_see.split(' ').any(|seen| seen == *name)
    });
    wrong.map(|name| format!("{}: `{module}` must not see `{name}`", source.path)).collect()
}

#[test]
fn arrows_between_modules_point_one_way() {
    let all: Vec<Source> = sources("src").into_iter().filter(|source| source.module() != "lib").collect();
    all.iter().for_each(|source| assert_none(&forbidden(source)));
    // The rules are about modules that exist, and none holds too much.
    let mut lines: BTreeMap<&str, usize> = BTreeMap::new();
    all.iter().for_each(|source| *lines.entry(source.module()).or_default() += source.lines);
    for (name, _) in MAY_SEE {
        let own = lines.get(name).unwrap_or_else(|| panic!("no module {name}"));
        assert!(3 * own <= lines.values().sum(), "{name}: {own} lines");
    }
}

#[test]
fn the_rules_have_no_circle_below_the_gathered_error() {
    // Taken away layer by layer: a module whose every dependency is gone can go.
    let mut left: Vec<_> = MAY_SEE.iter().filter(|(name, _)| *name != "error").collect();
    while !left.is_empty() {
        let names: Vec<&str> = left.iter().map(|(name, _)| *name).collect();
        left.retain(|(_, may_see)| may_see.split(' ').any(|name| names.contains(&name)));
        assert!(left.len() < names.len(), "a circle among {names:?}");
    }
}

/// Flags named in a text of the code; variables of style sheets (`--ink:`, `var(--ink)`) look alike.
fn spoken(source: &Source) -> Vec<String> {
    let code = source.code();
    let flag = |at: &usize| {
        code[at + 2..].starts_with(|c: char| c.is_ascii_lowercase())
            && code[..*at].ends_with(|c: char| c.is_whitespace() || "\"'`(".contains(c))
            && !code[..*at].ends_with("var(")
            && !code[*at..]
                .trim_start_matches(|c: char| c == '-' || c.is_ascii_alphanumeric())
                .starts_with(':')
    };
    code.match_indices("--").map(|(at, _)| at).filter(flag).map(|at| source.line(at)).collect()
}

#[test]
fn flags_are_written_in_the_command_only() {
    sources("src").iter().for_each(|source| assert_none(&spoken(source)));
}

/// Calls that take a message apart: a value's text (`x.to_string().split(..)`), or what is called one ([`MESSAGES`]).
/// What a function gives back under another name is not seen.
fn taken_apart(source: &Source) -> Vec<String> {
    let mut wrong = Vec::new();
    for call in TAKES_APART.split_whitespace() {
        for (at, _) in source.code().match_indices(&format!(".{call}(")) {
            // `a.as_str().split(..)` is about `a`.
            let before = source.code()[..at].trim_end_matches(".as_str()").trim_end_matches(".as_deref()");
            let start = before.rfind(|c: char| !c.is_alphanumeric() && c != '_').map_or(0, |i| i + 1);
            if before.ends_with(".to_string()")
                || MESSAGES.split_whitespace().any(|name| name == &before[start..])
            {
                wrong.push(source.line(at));
            }
        }
    }
    wrong
}

#[test]
fn no_message_is_taken_apart() {
    ["src", "bin"].into_iter().flat_map(sources).for_each(|source| assert_none(&taken_apart(&source)));
}

#[test]
fn files_stay_short() {
    for source in ["src", "bin", "tests"].into_iter().flat_map(sources) {
        assert!(source.lines <= MAX_LINES, "{}: {} lines", source.path, source.lines);
    }
}

#[test]
fn unsafe_stays_in_the_known_files() {
    for source in ["src", "bin"].into_iter().flat_map(sources) {
        let uses = source.text.split(|c: char| !c.is_alphanumeric() && c != '_').any(|w| w == "unsafe");
        assert!(!uses || UNSAFE_FILES.contains(&source.path.as_str()), "{}: unsafe", source.path);
    }
}

#[test]
fn the_operating_system_is_seen_in_one_place() {
    for source in ["src", "bin"].into_iter().flat_map(sources) {
        let is_platform = PLATFORM.iter().any(|place| source.path.starts_with(place));
        let seen = SYSTEM.iter().find(|name| source.code().contains(**name));
        assert!(is_platform || seen.is_none(), "{}: {seen:?}", source.path);
    }
}

#[test]
fn the_reader_of_this_test_sees_what_it_should() {
    let source = |code: &str| Source::new("src/load/example.rs".to_owned(), code);
    let example = source(
        "use crate::builder::plan;\nuse crate::{geom::Dims, render};\nuse crate::error::Error;\n\
         // use crate::jobs;\nlet x = crate::format::f();\nuse super::super::jobs;\nuse super::model;\n\
         #[cfg(test)]\nmod outline;\nuse crate::source;\n#[cfg(test)]\n#[expect(lint)]\nmod tests {\n\
         use crate::bin;\n}\n",
    );
    // All but geom and format; a group is refused whole.
    assert_eq!(forbidden(&example).len(), 5, "{:?}", forbidden(&example));
    assert_eq!(forbidden(&Source::new("src/strange.rs".to_owned(), "")).len(), 1);
    for wrong in [
        "if error.to_string().contains(\"cut short\") {}",
        "let (path, rest) = self.reason.split_once(\": \").unwrap();",
        "item.warning.as_deref().strip_prefix(input)",
    ] {
        assert_eq!(taken_apart(&source(wrong)).len(), 1, "{wrong}");
    }
    for sound in ["if header.contains(\"dims\") {}", "notes.contains(&note)"] {
        assert!(taken_apart(&source(sound)).is_empty(), "{sound}");
    }
    assert_eq!(spoken(&source("let a = \"check --dims\";\nlet b = a--c; // --d")).len(), 1);
}

/// Where foreign text becomes printable.
const FOREIGN: &str = "src/text/sanitize.rs";

#[test]
fn foreign_text_is_printed_in_one_way() {
    // A path that speaks for itself prints whatever its name holds; parts of names that make other names do not.
    let is_name =
        |line: &str| ["file_stem()", "extension()", "args_os()"].iter().any(|part| line.contains(part));
    for source in ["src/jobs", "bin"].into_iter().flat_map(sources).filter(|source| source.path != FOREIGN) {
        let prints = |line: &&str| line.contains(".display()") || line.contains("to_string_lossy()");
        let wrong = source.code().lines().filter(prints).find(|line| !is_name(line));
        assert!(wrong.is_none(), "{}: {wrong:?}", source.path);
    }
}
