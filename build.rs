//! Links the C++ library into the program, where the system has it as an archive: as a shared one it costs every
//! command 1.2 MiB of memory, and all that is used of it is an allocator.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if let (Some(archive), Some(out)) = (archive(), env::var_os("OUT_DIR")) {
        let link = Path::new(&out).join("libstdc++.a");
        let _ = std::fs::remove_file(&link);
        // Of the folders with a library the linker takes the first, in which it prefers a shared one.
        #[cfg(unix)]
        if std::os::unix::fs::symlink(archive, &link).is_ok() {
            println!("cargo:rustc-link-search=native={}", Path::new(&out).display());
        }
    }
}

/// The archive that belongs to the compiler.
fn archive() -> Option<PathBuf> {
    let of_target =
        env::var("TARGET").ok().and_then(|target| env::var(format!("CXX_{}", target.replace('-', "_"))).ok());
    let compiler = of_target.or_else(|| env::var("CXX").ok()).unwrap_or_else(|| "c++".into());
    let found = Command::new(compiler).arg("-print-file-name=libstdc++.a").output().ok()?;
    let path = PathBuf::from(String::from_utf8(found.stdout).ok()?.trim());
    path.is_absolute().then_some(path).filter(|path| path.is_file())
}
