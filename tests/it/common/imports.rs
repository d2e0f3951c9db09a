//! Which file of the library names what of which other file: paths of `use` lines and in the code, followed through
//! the re-exports of the modules on their way to the file that an item stands in.
//!
//! A `mod.rs` that only re-exports its children does not depend on them: it is their table of contents. Unit tests
//! may look wherever they need to and are left out.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// A module by its names from the crate down; the crate itself is empty.
pub(crate) type Module = Vec<String>;

/// One file: what it names, and what its own names stand for.
#[derive(Default)]
struct File {
    lines: usize,
    /// Paths that it names, and whether a re-export does.
    named: Vec<(Vec<String>, bool)>,
    /// What a name that it imports stands for.
    imports: BTreeMap<String, Vec<String>>,
}

/// The files of a library and the arrows between them.
pub(crate) struct Imports {
    files: BTreeMap<Module, File>,
    /// Files that a file depends on.
    pub(crate) arrows: BTreeMap<Module, BTreeSet<Module>>,
}

impl Imports {
    /// Reads every file below a folder `src`.
    pub(crate) fn read(src: &Path) -> Self {
        let mut texts = BTreeMap::new();
        collect(src, &mut Vec::new(), &mut texts);
        let known: BTreeSet<Module> = texts.keys().cloned().collect();
        let files: BTreeMap<Module, File> =
            texts.iter().map(|(module, text)| (module.clone(), read_file(module, text, &known))).collect();
        let mut all = Self { files, arrows: BTreeMap::new() };
        let arrows = all.files.keys().map(|module| (module.clone(), all.arrows_of(module))).collect();
        all.arrows = arrows;
        all
    }

    fn arrows_of(&self, module: &Module) -> BTreeSet<Module> {
        let mut found = BTreeSet::new();
        for (path, public) in &self.files[module].named {
            let Some(target) = self.home(module, path, 0) else { continue };
            let contents = *public && target.len() > module.len() && target.starts_with(module);
            if target != *module && !contents {
                found.insert(target);
            }
        }
        found
    }

    /// The file that an item stands in, which `from` names by `path`.
    fn home(&self, from: &Module, path: &[String], depth: usize) -> Option<Module> {
        let first = path.first()?;
        let supers = path.iter().take_while(|part| *part == "super").count();
        let (mut base, mut rest) = match first.as_str() {
            "crate" => (Vec::new(), &path[1..]),
            "self" => (from.clone(), &path[1..]),
            "super" => (from[..from.len().checked_sub(supers)?].to_vec(), &path[supers..]),
            _ if self.files.contains_key(&child(from, first)) => (from.clone(), path),
            _ => return None,
        };
        while let Some((name, more)) = rest.split_first() {
            let inner = child(&base, name);
            if self.files.contains_key(&inner) {
                (base, rest) = (inner, more);
                continue;
            }
            let meant = self.files.get(&base).and_then(|file| file.imports.get(name));
            let through = meant.filter(|meant| *meant != path && depth < 12).and_then(|meant| {
                let whole: Vec<String> = meant.iter().chain(more).cloned().collect();
                self.home(&base, &whole, depth + 1)
            });
            return Some(through.unwrap_or(base));
        }
        Some(base)
    }

    /// Groups of files of which each depends on every other, largest first.
    pub(crate) fn circles(&self) -> Vec<Vec<String>> {
        let reach: BTreeMap<&Module, BTreeSet<&Module>> =
            self.files.keys().map(|module| (module, self.reachable(module))).collect();
        let mut seen = BTreeSet::new();
        let mut circles = Vec::new();
        for module in self.files.keys() {
            let circle: Vec<&Module> =
                reach[module].iter().copied().filter(|other| reach[*other].contains(module)).collect();
            if circle.len() > 1 && seen.insert(circle.clone()) {
                circles.push(circle.into_iter().map(|m| m.join("/")).collect::<Vec<_>>());
            }
        }
        circles.sort_by_key(|circle| std::cmp::Reverse(circle.len()));
        circles
    }

    fn reachable<'a>(&'a self, module: &'a Module) -> BTreeSet<&'a Module> {
        let mut found = BTreeSet::new();
        let mut next = vec![module];
        while let Some(at) = next.pop() {
            for other in &self.arrows[at] {
                if found.insert(other) {
                    next.push(other);
                }
            }
        }
        found
    }

    /// Lines of the files of each top module.
    pub(crate) fn lines(&self) -> BTreeMap<&str, usize> {
        let mut lines = BTreeMap::new();
        for (module, file) in &self.files {
            *lines.entry(module.first().map_or("lib", String::as_str)).or_default() += file.lines;
        }
        lines
    }
}

fn child(module: &[String], name: &str) -> Module {
    module.iter().map(String::as_str).chain([name]).map(str::to_owned).collect()
}

/// The text of every file by its module; files of unit tests are left out.
fn collect(folder: &Path, module: &mut Module, texts: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
        if stem == "tests" {
            continue;
        }
        if path.is_dir() {
            module.push(stem);
            collect(&path, module, texts);
            module.pop();
        } else if path.extension().is_some_and(|e| e == "rs") {
            let name = if stem == "mod" || stem == "lib" { module.clone() } else { child(module, &stem) };
            texts.insert(name, fs::read_to_string(&path).unwrap());
        }
    }
}

fn read_file(module: &Module, text: &str, known: &BTreeSet<Module>) -> File {
    let mut file = File { lines: text.lines().count(), ..File::default() };
    let code = without_comments_and_tests(text);
    let mut rest = String::new();
    let mut lines = code.lines();
    while let Some(line) = lines.next() {
        let (public, tree) = match line.trim_start().split_once("use ") {
            Some(("", tree)) => (false, tree),
            Some((before, tree)) if before.starts_with("pub") && !before.contains('"') => (true, tree),
            _ => {
                rest += line;
                rest.push('\n');
                continue;
            }
        };
        let mut tree = tree.to_owned();
        while !tree.contains(';') {
            let Some(more) = lines.next() else { break };
            tree += more.trim();
        }
        for (mut path, name) in leaves(tree.split(';').next().unwrap()) {
            if path.last().is_some_and(|last| last == "self") {
                path.pop();
            }
            let own = name.or_else(|| path.last().cloned()).unwrap_or_default();
            file.imports.insert(own, path.clone());
            file.named.push((path, public));
        }
    }
    for path in paths_in(&without_visibility(&rest)) {
        let leads = matches!(path[0].as_str(), "crate" | "self" | "super");
        if leads || known.contains(&child(module, &path[0])) {
            file.named.push((path, false));
        }
    }
    file
}

/// `pub(in crate::a)` says who may look, and looks at nobody.
fn without_visibility(code: &str) -> String {
    let mut parts = code.split("pub(in ");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |all, part| all + part.split_once(')').map_or(part, |(_, after)| after))
}

/// The code of a file before its unit tests.
fn without_comments_and_tests(text: &str) -> String {
    let lines: Vec<&str> =
        text.lines().map(|l| if l.trim_start().starts_with("//") { "" } else { l }).collect();
    let opens = |at: usize| {
        let after = lines[at + 1..].iter().find(|line| !line.starts_with("#["));
        lines[at] == "#[cfg(test)]" && after.is_some_and(|l| l.contains("mod ") && l.ends_with('{'))
    };
    let end = (0..lines.len()).find(|at| opens(*at)).unwrap_or(lines.len());
    lines[..end].join("\n")
}

/// The paths of a `use` tree, each with the name after `as`.
fn leaves(tree: &str) -> Vec<(Vec<String>, Option<String>)> {
    let tree = tree.trim();
    let Some(open) = tree.find('{') else {
        let (path, name) =
            tree.split_once(" as ").map_or((tree, None), |(p, n)| (p, Some(n.trim().to_owned())));
        return vec![(path.trim().split("::").map(str::to_owned).collect(), name)];
    };
    let before: Vec<String> =
        tree[..open].split("::").map(str::trim).filter(|p| !p.is_empty()).map(str::to_owned).collect();
    let body = &tree[open + 1..tree.rfind('}').unwrap_or(tree.len())];
    let (mut depth, mut part, mut parts) = (0, String::new(), Vec::new());
    for c in body.chars() {
        match c {
            ',' if depth == 0 => {
                parts.push(std::mem::take(&mut part));
                continue;
            }
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        part.push(c);
    }
    parts.push(part);
    let whole = |part: &String| {
        leaves(part)
            .into_iter()
            .map(|(path, name)| ([before.clone(), path].concat(), name))
            .collect::<Vec<_>>()
    };
    parts.iter().filter(|part| !part.trim().is_empty()).flat_map(whole).collect()
}

/// Every path of two and more names in a code.
fn paths_in(code: &str) -> Vec<Vec<String>> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let words = code.split(|c: char| !is_word(c) && c != ':');
    let paths = words.map(|word| word.split("::").map(str::to_owned).collect::<Vec<_>>());
    paths
        .filter(|path| path.len() > 1 && path.iter().all(|p| !p.is_empty() && p.chars().all(is_word)))
        .collect()
}
