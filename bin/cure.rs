//! Flags and commands in the library's sentences, which name fields and functions to Rust callers.

/// Names that are not spelled like their flag.
const OTHERWISE: [(&str, &str); 28] = [
    ("GridChoice::Voxel", "--voxel"),
    ("Threshold::Iso", "--iso"),
    ("Threshold::Range", "--range"),
    ("anyway", "--measure"),
    ("form", "--as"),
    ("label_names", "--names"),
    ("origin_mm", "--origin"),
    ("replace", "--force"),
    ("scalar", "--dtype"),
    ("skin_only", "--skin"),
    ("spacing_mm", "--spacing"),
    ("unit_mm", "--unit"),
    ("build", "oct build"),
    ("jobs::build(INPUT)", "oct build INPUT -o MODEL.oct"),
    ("jobs::compare", "oct compare"),
    ("jobs::export::export_each", "--each"),
    ("jobs::info", "oct info"),
    ("jobs::parts::Stage", "--stage"),
    ("jobs::parts::merge", "oct merge"),
    ("jobs::parts::part", "oct part"),
    ("jobs::parts::plan", "oct plan"),
    ("jobs::pack::strip", "oct strip"),
    ("jobs::pack::unpack", "oct unpack"),
    ("jobs::scan", "oct scan"),
    ("jobs::thickness", "oct thickness"),
    ("jobs::picture", "oct render"),
    ("jobs::verify", "oct verify"),
    ("jobs::view", "oct view"),
];

/// The flag or command of a name.
pub(crate) fn spelled(name: &str) -> String {
    let known = OTHERWISE.iter().find(|(of, _)| *of == name);
    known.map_or_else(|| format!("--{}", name.replace('_', "-")), |(_, flag)| (*flag).to_owned())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory;
    use infobyte::text::Name;

    use super::{OTHERWISE, spelled};
    use crate::args::Cli;

    #[test]
    fn every_name_is_a_flag_or_a_command() {
        let oct = Cli::command();
        let flags: BTreeSet<&str> = oct
            .get_subcommands()
            .flat_map(|of| of.get_arguments())
            .filter_map(|arg| arg.get_long())
            .collect();
        for name in Name::ALL {
            let spelled = spelled(name);
            match spelled.strip_prefix("oct ").and_then(|rest| rest.split(' ').next()) {
                Some(command) => assert!(oct.find_subcommand(command).is_some(), "{spelled}"),
                None => assert!(flags.contains(spelled.trim_start_matches("--")), "{spelled}"),
            }
        }
        for (name, _) in OTHERWISE {
            assert!(Name::ALL.contains(&name), "{name}");
        }
    }
}
