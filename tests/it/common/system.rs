//! Parts of tests that depend on the operating system: reading and writing at places, links, names that are no text,
//! how a process ended.

#[cfg(unix)]
pub(crate) use std::os::unix::{ffi::OsStrExt, fs::FileExt, fs::symlink, process::ExitStatusExt};

#[cfg(windows)]
pub(crate) use windows::*;

#[cfg(windows)]
mod windows {
    use std::ffi::OsStr;
    use std::fs::File;
    use std::io;
    use std::os::windows::fs::{FileExt as Seeking, symlink_dir, symlink_file};
    use std::path::Path;
    use std::process::ExitStatus;

    /// Whole reads and writes at places.
    pub(crate) trait FileExt {
        fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()>;
        fn write_all_at(&self, bytes: &[u8], offset: u64) -> io::Result<()>;
    }

    impl FileExt for File {
        fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
            let read = self.seek_read(bytes, offset)?;
            if read == bytes.len() { Ok(()) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
        }

        fn write_all_at(&self, bytes: &[u8], offset: u64) -> io::Result<()> {
            let written = self.seek_write(bytes, offset)?;
            if written == bytes.len() { Ok(()) } else { Err(io::ErrorKind::WriteZero.into()) }
        }
    }

    /// Names as the bytes by which Rust encodes them.
    pub(crate) trait OsStrExt {
        fn as_bytes(&self) -> &[u8];
    }

    impl OsStrExt for OsStr {
        fn as_bytes(&self) -> &[u8] {
            self.as_encoded_bytes()
        }
    }

    /// Signals do not exist; a killed process ends with 1, which counts as 9 here.
    pub(crate) trait ExitStatusExt {
        fn signal(&self) -> Option<i32>;
    }

    impl ExitStatusExt for ExitStatus {
        fn signal(&self) -> Option<i32> {
            (self.code() == Some(1)).then_some(9)
        }
    }

    pub(crate) fn symlink(target: impl AsRef<Path>, link: impl AsRef<Path>) -> io::Result<()> {
        if target.as_ref().is_dir() { symlink_dir(target, link) } else { symlink_file(target, link) }
    }
}

/// A name in Latin-1 that is no Unicode: bytes here, a lone surrogate for each of them on Windows.
pub(crate) fn latin1(name: &[u8]) -> std::ffi::OsString {
    #[cfg(unix)]
    return std::ffi::OsStr::from_bytes(name).to_owned();
    #[cfg(windows)]
    return std::os::windows::ffi::OsStringExt::from_wide(
        &name
            .iter()
            .map(|b| if b.is_ascii() { u16::from(*b) } else { 0xdc00 | u16::from(*b) })
            .collect::<Vec<_>>(),
    );
}
