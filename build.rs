//! Links the C++ library into the program, where the system has it as an archive: as a shared one it costs every
//! command 1.2 MiB of memory, and all that is used of it is an allocator.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if env::var_os("CARGO_CFG_WINDOWS").is_some() {
        // No library of mingw has to lie beside the program.
        println!("cargo:rustc-link-arg-bins=-static");
        // Sections that begin at pages are mapped; others are read into memory, whole.
        println!("cargo:rustc-link-arg-bins=-Wl,--file-alignment=4096");
    }
    if let (Some(archive), Some(out)) = (archive(), env::var_os("OUT_DIR")) {
        let link = Path::new(&out).join("libstdc++.a");
        let _ = std::fs::remove_file(&link);
        // Of the folders with a library the linker takes the first, in which it prefers a shared one.
        if std::fs::copy(archive, &link).is_ok() {
            println!("cargo:rustc-link-search=native={}", Path::new(&out).display());
        }
    }
}

/// The compiler of programs for the target where no variable names one.
fn usual_compiler() -> String {
    let is_for_windows = env::var_os("CARGO_CFG_WINDOWS").is_some() && !cfg!(windows);
    let named = || env::var("CXX").unwrap_or_else(|_| "c++".into());
    if is_for_windows { "x86_64-w64-mingw32-g++".into() } else { named() }
}

/// The archive that belongs to the compiler.
fn archive() -> Option<PathBuf> {
    let of_target =
        env::var("TARGET").ok().and_then(|target| env::var(format!("CXX_{}", target.replace('-', "_"))).ok());
    let compiler = of_target.unwrap_or_else(usual_compiler);
    let found = Command::new(compiler).arg("-print-file-name=libstdc++.a").output().ok()?;
    let path = PathBuf::from(String::from_utf8(found.stdout).ok()?.trim());
    path.is_absolute().then_some(path).filter(|path| path.is_file())
}
