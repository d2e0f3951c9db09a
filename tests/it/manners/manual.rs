//! Completions, manual pages and examples come from the command line itself, so none can be forgotten.

use crate::prelude::*;

/// Every command, as `oct --help` lists them.
fn commands() -> Vec<String> {
    let help = oct(&["--help"]).stdout;
    let (_, list) = help.split_once("Commands:\n").unwrap_or_else(|| panic!("{help}"));
    let list = list.split("\n\n").next().unwrap();
    let name = |line: &str| line.split_whitespace().next().unwrap().to_owned();
    list.lines().map(name).filter(|name| name != "help").collect()
}

#[test]
fn every_command_has_two_examples_that_are_understood() {
    let folder = tempfile::tempdir().unwrap();
    assert!(commands().len() >= 13, "{:?}", commands());
    for command in commands() {
        let help = oct(&[command.as_str(), "--help"]).stdout;
        let (_, examples) = help.split_once("Examples:\n").unwrap_or_else(|| panic!("{command}: {help}"));
        let start = format!("  oct {command} ");
        let typed: Vec<&str> = examples
            .lines()
            .filter(|line| line.starts_with(&start) || line.trim() == format!("oct {command}"))
            .collect();
        assert_eq!((typed.len(), examples.lines().count()), (2, 2), "{command}: {examples}");
        for line in typed {
            let words: Vec<&str> = line.split_whitespace().skip(1).collect();
            if matches!(command.as_str(), "completions" | "man" | "demo" | "report") {
                continue;
            }
            // Its files are not there; the line itself is sound.
            let run = shell(
                r#"cd "$1"; shift; exec "$OCT" "$@""#,
                &[&[text(folder.path()).as_str()][..], &words].concat(),
            );
            assert!([3, 5].contains(&run.code), "{line}: {run:?}");
            assert!(!run.stderr.contains("--help"), "{line}: {run:?}");
        }
    }
}

#[test]
fn completions_know_every_command_and_shells_accept_them() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let run = oct(&["completions", name]);
        assert_eq!((run.code, &run.stderr[..]), (0, ""), "{run:?}");
        for command in commands() {
            assert!(run.stdout.contains(&command), "{name} lacks {command}");
        }
        for word in ["keep-largest", "perspective", "cells", "isotropic5", "compact-bone", "i16be"] {
            assert!(
                run.stdout.contains(word) || name == "elvish" || name == "powershell",
                "{name} lacks {word}"
            );
        }
        let script = folder.path().join(name);
        fs::write(&script, &run.stdout).unwrap();
        // Those shells that are there.
        let check = r#"command -v "$1" > /dev/null || exit 0; "$1" -n "$2""#;
        if name != "elvish" && name != "powershell" {
            assert_eq!(shell(check, &[name, &text(&script)]).code, 0, "{name}");
        }
    }
    oct(&["completions", "dos"]).refused(2, &["dos"]);
    let gone = shell(r#""$OCT" completions bash | head -1 > /dev/null"#, &[""; 0]);
    assert_eq!((gone.code, &gone.stderr[..]), (0, ""));
}

#[test]
fn the_manual_has_a_page_for_every_command_with_its_options() {
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("share/man1");
    let run = oct(&["man", &text(&pages)]);
    assert_eq!((run.code, &run.stderr[..]), (0, ""), "{run:?}");
    let mut expected: Vec<String> = commands().iter().map(|name| format!("oct-{name}.1")).collect();
    expected.push("oct.1".into());
    expected.sort();
    assert_eq!(names(&pages), expected);
    for name in expected {
        let page = fs::read_to_string(pages.join(&name)).unwrap();
        assert!(page.contains(".TH ") && run.stdout.contains(&name), "{name}: {page}");
        if name != "oct.1" {
            assert!(page.contains("Examples"), "{name}: {page}");
        }
    }
    let build = fs::read_to_string(pages.join("oct-build.1")).unwrap();
    assert!(build.contains("connectivity") && build.contains("oct\\-build"), "{build}");
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    oct(&["man", &text(&file)]).refused(5, &["file", "cannot be written"]);
}
