//! Help: the options that matter for `-h`, all of them in groups for `--help`, and pages for `oct help PAGE`.

use clap::{Arg, Command, CommandFactory};
use infobyte::text::nearest;

use crate::args::Cli;

/// Columns of a page.
const COLUMNS: usize = 100;

/// Pages by name, with their subjects.
const PAGES: [(&str, &str, &str); 9] = [
    ("commands", "all commands, exit codes, streams", include_str!("../src/jobs/COMMANDS.md")),
    ("formats", "what is read: volumes, series, masks, label maps", include_str!("../src/source/READING.md")),
    ("reading", "another name of formats", include_str!("../src/source/READING.md")),
    ("scenes", "several models in one picture", include_str!("../src/scene/SCENES.md")),
    ("meshes", "triangles as input", include_str!("../src/mesh/MESHES.md")),
    ("solids", "trees of solids as input", include_str!("../src/csg/CSG.md")),
    ("measuring", "deviation, thickness, pores: how far to trust them", include_str!("../docs/MEASURING.md")),
    ("synthetic", "bodies whose surface is known", include_str!("../src/synthetic/BODIES.md")),
    ("cleaning", "crop, presets, components", include_str!("../src/clean/CLEANING.md")),
];

/// Options that `-h` lists, of commands that have more than a screen holds.
const SHORT: [(&str, &str); 4] = [
    ("build", "output iso preset labels memory error spacing dims dtype grid"),
    ("batch", "out iso preset memory jobs thumbnails modality keep-names json quiet"),
    ("plan", "parts out iso preset memory labels error spacing dims dtype"),
    ("render", "output size view clip section background shading annotate legend turntable"),
];

/// Groups of the options of `render`.
const GROUPS: [(&str, &str); 5] = [
    ("Camera", "size view eye look-at up projection fov zoom contact turntable section"),
    ("What is shown", "clip only hide opacity color colors range background annotate title legend"),
    ("Light and rays", "shading blended samples ao-rays traversal lod lod-bias"),
    ("Other pictures of the same view", "depth normals ids"),
    ("Machine and output", "threads memory json force"),
];

/// Ends of the clause of an option's text that `-h` shows.
const CLAUSE_ENDS: [&str; 5] = ["; ", ": ", ". ", ", such as", ", by default"];

/// Words of other programs for commands and options of this one.
const SYNONYMS: [(&str, &str); 12] = [
    ("info", "measure stats metadata show header"),
    ("build", "convert import voxelize create"),
    ("export", "mesh save stl"),
    ("view", "open viewer display"),
    ("render", "picture image draw screenshot"),
    ("compare", "diff deviation distance"),
    ("intersect", "collide overlap clearance"),
    ("--iso", "--threshold --level --isovalue"),
    ("--output", "--out --file"),
    ("--out", "--output --folder"),
    ("--grid", "--resolution --voxels"),
    ("--size", "--width --height --resolution"),
];

/// The likely meaning of an unknown word among these commands or options: a word of another program for one of them, or
/// the most similar one.
pub(crate) fn meant(word: &str, known: &[String]) -> Option<String> {
    let others = SYNONYMS.iter().flat_map(|(own, names)| names.split(' ').map(move |name| (name, *own)));
    let others = others.filter(|(_, own)| known.iter().any(|name| name == own));
    nearest(word, others.chain(known.iter().map(|name| (&**name, &**name)))).map(str::to_owned)
}

/// The command line as help shows it; short help has no groups.
pub(crate) fn command(is_short: bool) -> Command {
    let pages: Vec<String> =
        PAGES.iter().map(|(name, about, _)| format!("  oct help {name:<11}{about}")).collect();
    Cli::command().after_help(format!("Pages:\n{}", pages.join("\n"))).mut_subcommands(|command| {
        let name = command.get_name().to_owned();
        let short = SHORT.iter().find(|(of, _)| *of == name).map(|(_, short)| *short);
        let examples = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        let command = command.mut_args(|arg| of_command(arg, &name, short, is_short));
        match short {
            Some(_) if !is_short => {
                command.after_help(format!("-h lists the options that matter most.\n\n{examples}"))
            }
            _ => command,
        }
    })
}

/// An option of a command in its group; with its first clause for `-h`, or left out there.
fn of_command(arg: Arg, command: &str, short: Option<&str>, is_short: bool) -> Arg {
    let Some(name) = arg.get_long().map(str::to_owned) else { return arg };
    let is_among = |names: &str| names.split(' ').any(|other| other == name);
    let group = GROUPS.iter().find(|(_, names)| command == "render" && is_among(names));
    let heading = group.map(|(heading, _)| *heading);
    match short {
        Some(short) if is_short && !is_among(short) => arg.hide_short_help(true),
        _ if is_short => {
            let full = arg.get_help().map(ToString::to_string).unwrap_or_default();
            let first = CLAUSE_ENDS.iter().filter_map(|end| full.find(end)).min().unwrap_or(full.len());
            arg.help(full[..first].to_owned()).help_heading(None)
        }
        _ if heading.is_some() => arg.help_heading(heading),
        _ => arg,
    }
}

/// The page that the words of the command line select.
pub(crate) fn page(words: &[&str]) -> Option<String> {
    let &["help", name] = words else { return None };
    let (.., text) = PAGES.iter().find(|(page, ..)| *page == name)?;
    Some(shown(text))
}

/// A page as a terminal shows it: links without their targets, lines and tables within [`COLUMNS`].
fn shown(page: &str) -> String {
    let (mut out, mut is_code, mut rows) = (String::new(), false, Vec::new());
    for line in page.lines() {
        if let Some(row) = line.strip_prefix('|').filter(|_| !is_code) {
            rows.push(unlinked(row.trim_end().trim_end_matches('|')));
            continue;
        }
        out += &table(&std::mem::take(&mut rows));
        if line.starts_with("```") {
            is_code = !is_code;
        } else if is_code {
            out += &format!("    {line}\n");
        } else {
            let hang = if line.starts_with("- ") { 2 } else { 0 };
            out += &wrapped(&unlinked(line), hang, COLUMNS);
        }
    }
    out + &table(&rows)
}

/// The rows of a table, their cells separated by `|`, in columns. If it is wider than [`COLUMNS`] characters, the
/// widest column is broken into lines, or else the next.
fn table(rows: &[String]) -> String {
    let is_rule = |row: &&String| row.chars().all(|c| matches!(c, '-' | '|' | ' ' | ':'));
    let rows: Vec<Vec<&str>> =
        rows.iter().filter(|row| !is_rule(row)).map(|row| row.split('|').map(str::trim).collect()).collect();
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |at: usize| rows.iter().filter_map(|row| row.get(at)).map(|cell| cell.chars().count()).max();
    let mut widths: Vec<usize> = (0..columns).map(|at| width(at).unwrap_or(0)).collect();
    let room = COLUMNS.saturating_sub(2 * columns.saturating_sub(1));
    while widths.iter().sum::<usize>() > room
        && let Some(widest) = widths.iter_mut().max()
    {
        *widest -= 1;
    }
    let mut out = String::new();
    for row in &rows {
        let cells: Vec<String> =
            row.iter().zip(&widths).map(|(cell, width)| wrapped(cell, 0, *width)).collect();
        let lines: Vec<Vec<&str>> = cells.iter().map(|cell| cell.lines().collect()).collect();
        for line in 0..lines.iter().map(Vec::len).max().unwrap_or(0) {
            let part = |(cell, width): (&Vec<&str>, &usize)| {
                format!("{:width$}  ", cell.get(line).copied().unwrap_or(""))
            };
            let text: String = lines.iter().zip(&widths).map(part).collect();
            out += text.trim_end();
            out.push('\n');
        }
    }
    out
}

/// A text in lines of at most `columns` characters, of which all but the first are indented; longer words stay whole.
fn wrapped(text: &str, indent: usize, columns: usize) -> String {
    let (mut out, mut line) = (String::new(), String::new());
    for word in text.split_whitespace() {
        let is_begun = line.len() > indent;
        if is_begun && line.chars().count() + 1 + word.chars().count() > columns {
            out += line.trim_end();
            out.push('\n');
            line = " ".repeat(indent);
        }
        if !(line.is_empty() || line.ends_with(' ')) {
            line.push(' ');
        }
        line += word;
    }
    out + line.trim_end() + "\n"
}

/// A line with the words of its links alone.
fn unlinked(line: &str) -> String {
    let mut out = String::new();
    let mut rest = line;
    while let Some(middle) = rest.find("](")
        && let (Some(open), Some(end)) = (rest[..middle].rfind('['), rest[middle..].find(')'))
    {
        out += &rest[..open];
        out += &rest[open + 1..middle];
        rest = &rest[middle + end + 1..];
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A screen has 24 lines; every option in these tables exists, and pages keep to their width.
    #[test]
    fn short_help_fits_a_screen_and_pages_a_terminal() {
        for sub in command(true).get_subcommands_mut() {
            let name = sub.get_name().to_owned();
            let help = sub.render_help().to_string();
            let options = help.lines().skip_while(|line| !line.starts_with("Options:")).skip(1);
            let count = options.take_while(|line| !line.is_empty()).count();
            assert!(count <= 24 || SHORT.iter().all(|(of, _)| *of != name), "{name}: {count}\n{help}");
            for arg in sub.get_arguments().filter(|arg| !arg.is_hide_short_help_set()) {
                let text = arg.get_help().map(ToString::to_string).unwrap_or_default();
                assert!(text.len() <= 90, "{name} {:?}: {} characters: {text}", arg.get_long(), text.len());
            }
            let known: Vec<&str> = sub.get_arguments().filter_map(Arg::get_long).collect();
            let short = SHORT.iter().filter(|(of, _)| *of == name).flat_map(|(_, names)| names.split(' '));
            let grouped = GROUPS.iter().filter(|_| name == "render").flat_map(|(_, names)| names.split(' '));
            for option in short.chain(grouped) {
                assert!(known.contains(&option), "{name} --{option}");
            }
        }
        for (name, ..) in PAGES {
            let page = page(&["help", name]).unwrap();
            let is_wide = |line: &&str| line.chars().count() > COLUMNS && !line.starts_with("    ");
            assert_eq!(page.lines().find(is_wide), None, "{name}");
        }
        assert_eq!(unlinked("see [A](b.md), [x] and [C](d)"), "see A, [x] and C");
        assert_eq!(page(&["help", "build"]), None);
    }
}
