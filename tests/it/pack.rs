//! Packing loses nothing. If this fails, an archived model cannot be brought back, or two machines
//! make different archives of the same model.

use crate::common as support;
use crate::prelude::*;

use infobyte::jobs::verify;
use support::shell;

#[test]
fn unpacking_gives_the_file_and_packing_again_gives_the_archive() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (i, dims) in [[1, 1, 1], [3, 2, 1], [40, 40, 40], [70, 66, 90], [130, 20, 24]].into_iter().enumerate()
    {
        for channels in [NORMALS, FULL, OptionalSections { normal: false, value_bytes: 1, lod: true }] {
            let name = |what: &str| at(&format!("{i}-{what}.oct"));
            let seed = 7 + i as u64;
            let file =
                if dims[0] < 4 { support::corner(dims, channels) } else { shell(dims, channels, seed) };
            fs::write(name("a"), &file).unwrap();
            let packed = pack::pack(&name("a"), &name("p")).unwrap();
            assert_eq!(packed.bytes_out, fs::metadata(name("p")).unwrap().len());
            pack::unpack(&name("p"), &name("b")).unwrap();
            assert!(fs::read(name("b")).unwrap() == file, "{dims:?} {channels:?} seed {seed}");
            pack::pack(&name("b"), &name("q")).unwrap();
            assert!(fs::read(name("p")).unwrap() == fs::read(name("q")).unwrap());
            verify::verify_file(&name("p")).unwrap();

            let (mapped, archived) =
                (info::read_info(&name("a")).unwrap(), info::read_info(&name("p")).unwrap());
            assert_eq!(archived.frame.header.encoding, Encoding::Packed);
            let [mapped, archived] =
                [mapped, archived].map(|info| serde_json::to_value(info.json()).unwrap());
            assert_eq!(mapped["checksum"], archived["checksum"]);
            assert_eq!(mapped["nodes"], archived["nodes"]);

            let request = pack::StripRequest { channels: None, levels: u32::from(i > 1), lod: false };
            let stripped = ["a", "p"].map(|from| {
                pack::strip(&name(from), &name("s"), &request).unwrap();
                fs::read(name("s")).unwrap()
            });
            assert!(stripped[0] == stripped[1], "{dims:?} {channels:?}");
        }
    }
}

#[test]
fn a_rough_shell_with_normals_is_packed_below_its_target() {
    let folder = tempfile::tempdir().unwrap();
    let (a, p) = (folder.path().join("a.oct"), folder.path().join("p.oct"));
    fs::write(&a, shell([180; 3], NORMALS, 3)).unwrap();
    let report = pack::pack(&a, &p).unwrap();
    let per_voxel = report.bytes_out as f64 / report.skin_voxels as f64;
    assert!(per_voxel <= 1.6, "{per_voxel} bytes per skin voxel of {}", report.skin_voxels);
}

#[test]
fn wrong_directions_and_bad_targets_are_refused_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("a"), shell([20; 3], NORMALS, 1)).unwrap();
    pack::pack(&at("a"), &at("p")).unwrap();
    let refused = |result: Result<pack::PackReport, infobyte::Error>, kind: ExitKind, part: &str| {
        let e = result.unwrap_err();
        assert_eq!(e.kind(), kind, "{e}");
        assert!(e.to_string().contains(part), "{e}");
    };
    refused(pack::pack(&at("p"), &at("x")), ExitKind::Input, "packed already");
    refused(pack::unpack(&at("a"), &at("x")), ExitKind::Input, "not packed");
    refused(pack::pack(&at("none"), &at("x")), ExitKind::Input, "cannot be read");
    refused(pack::pack(folder.path(), &at("x")), ExitKind::Input, "not a regular file");
    refused(pack::pack(&at("a"), &at("none/x")), ExitKind::Io, "cannot be written");
    refused(pack::pack(&at("a"), folder.path()), ExitKind::Io, "not a regular file");
    let mut damaged = fs::read(at("a")).unwrap();
    let last = damaged.len() - 1;
    damaged[last] ^= 1;
    fs::write(at("d"), &damaged).unwrap();
    fs::write(at("x"), "precious").unwrap();
    refused(pack::pack(&at("d"), &at("x")), ExitKind::Input, "checksum of normal");
    assert_eq!(fs::read(at("x")).unwrap(), b"precious", "the old target is untouched");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 4, "nothing is left behind");
}

/// Files of every format version stay readable; `tests/it/fixtures.rs` says how they are made.
#[test]
fn the_files_of_every_version_are_read_as_they_were_written() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let mapped = folder.join("v1.0-mapped.oct");
    let packed = folder.join("v1.0-packed.oct");
    for path in [&packed, &mapped] {
        let report = verify::verify_file(path).unwrap();
        assert_eq!((report.skin_voxels, report.nodes), FIXTURE_COUNTS);
        assert_eq!(report.checksum, FIXTURE_CHECKSUM);
    }
    let out = tempfile::tempdir().unwrap();
    pack::unpack(&packed, &out.path().join("a")).unwrap();
    assert!(fs::read(out.path().join("a")).unwrap() == fs::read(&mapped).unwrap());
    for (name, part) in
        [("x_foreign.oct", "not an infobyte"), ("x_cut.oct", "cut short"), ("x_newer.oct", "version 2")]
    {
        let error = info::read_info(&folder.join(name)).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}

const FIXTURE_COUNTS: (u64, u64) = (872, 362);
const FIXTURE_CHECKSUM: &str = "1b6a86b7";
