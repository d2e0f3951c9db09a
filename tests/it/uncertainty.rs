//! `oct build --uncertainty`: the noise that was put in is found, and nothing else changes.

use crate::prelude::*;

/// A ball whose samples have noise, as 16-bit numbers.
pub(crate) fn noisy(path: &Path, noise: f64) {
    let value = |p: [u32; 3]| {
        let mut random = Random(u64::from(p[0]) << 40 ^ u64::from(p[1]) << 20 ^ u64::from(p[2]));
        let deviate = (0..12).map(|_| random.below(1 << 20) as f64 / f64::from(1 << 20)).sum::<f64>() - 6.0;
        let from = p.map(|c| f64::from(c) - 33.4).iter().map(|c| c * c).sum::<f64>().sqrt();
        let step = (500.0 * (24.0 - from)).clamp(-500.0, 500.0);
        #[expect(clippy::cast_possible_truncation, reason = "below 2^15")]
        ((step + noise * deviate).round() as i16).to_le_bytes()
    };
    write_raw(path, [70, 66, 68], value);
}

#[test]
fn noise_is_found_in_the_same_bytes_at_any_budget_and_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    noisy(Path::new(&at("v.raw")), 20.0);
    let shape = ["--dims", "70x66x68", "--dtype", "i16", "--iso", "0", "--surface", "cells", "--json"];
    let build = |name: &str, extra: &[&str]| {
        oct(&[&["build", &at("v.raw"), "-o", &at(name)], &shape[..], extra].concat()).json()
    };
    build("plain.oct", &[]);
    for (name, how) in [
        ("one.oct", &["--threads", "1"][..]),
        ("five.oct", &["--threads", "5"]),
        ("small.oct", &["--threads", "2", "--memory", "12MiB"]),
        ("large.oct", &["--memory", "1GiB"]),
    ] {
        build(name, &[how, &["--uncertainty"]].concat());
        assert_eq!(std::fs::read(at(name)).unwrap(), std::fs::read(at("one.oct")).unwrap(), "{name}");
    }
    let info = oct(&["info", &at("one.oct"), "--json"]).json();
    for side in ["inside", "outside"] {
        let found = info["noise"][side].as_f64().unwrap();
        assert!((found / 20.0 - 1.0).abs() < 0.04, "{side}: {found}");
    }
    for correlation in info["noise"]["correlation"].as_array().unwrap() {
        assert!(correlation.as_f64().unwrap() < 0.1, "{correlation}");
    }
    assert_eq!(oct(&["verify", &at("one.oct")]).code, 0);
    oct(&["pack", &at("one.oct"), "-o", &at("p.oct"), "--json"]).json();
    oct(&["unpack", &at("p.oct"), "-o", &at("u.oct"), "--json"]).json();
    assert_eq!(std::fs::read(at("u.oct")).unwrap(), std::fs::read(at("one.oct")).unwrap());
    let compared = |other: &str| oct(&["compare", &at("one.oct"), &at(other)]).stdout;
    assert!(compared("plain.oct").contains("build both with --uncertainty"));
    assert!(compared("five.oct").contains("uncertainty: ") && !compared("five.oct").contains("build both"));
    // The surface is that of a build without it.
    for name in ["one", "plain"] {
        oct(&["export", &at(&format!("{name}.oct")), "-o", &at(&format!("{name}.stl")), "--json"]).json();
    }
    assert_eq!(std::fs::read(at("one.stl")).unwrap(), std::fs::read(at("plain.stl")).unwrap());
}

#[test]
fn what_has_no_noise_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    noisy(Path::new(&at("v.raw")), 0.0);
    let shape = ["--dims", "70x66x68", "--dtype", "i16", "--iso", "0", "--surface", "cells", "--uncertainty"];
    let build =
        |extra: &[&str]| oct(&[&["build", &at("v.raw"), "-o", &at("m.oct")], &shape[..], extra].concat());
    assert_eq!(build(&[]).code, 0);
    assert!(oct(&["info", &at("m.oct")]).stdout.contains("not measurable"));
    build(&["--error", "0.1"]).refused(2, &["larger leaves have no channel 'steepness'"]);
    let skin: Vec<&str> = shape.iter().map(|arg| if *arg == "cells" { "skin" } else { arg }).collect();
    oct(&[&["build", &at("v.raw"), "-o", &at("m.oct")], &skin[..]].concat()).refused(2, &["--uncertainty"]);
    let labels: Vec<&str> = shape.iter().map(|arg| if *arg == "--iso" { "--labels" } else { arg }).collect();
    let labels: Vec<&str> = labels.iter().map(|arg| if *arg == "0" { "all" } else { arg }).collect();
    oct(&[&["build", &at("v.raw"), "-o", &at("m.oct")], &labels[..]].concat()).refused(2, &["uncertainty"]);
    std::fs::write(at("c.csg"), "sphere(r = 5);").unwrap();
    oct(&["build", &at("c.csg"), "-o", &at("m.oct"), "--surface", "cells", "--uncertainty"])
        .refused(2, &["no noise", "--uncertainty"]);
}
