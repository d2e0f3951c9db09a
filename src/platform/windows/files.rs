//! Files.
#![expect(unsafe_code, reason = "calls of the system")]

use std::ffi::OsStr;
use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io;
use std::os::windows::ffi::OsStrExt as _;
use std::os::windows::fs::{FileExt as _, MetadataExt, OpenOptionsExt};
use std::os::windows::io::AsRawHandle;
use std::path::{Path, PathBuf};

#[cfg(test)]
pub(crate) use std::os::windows::fs::symlink_file as symlink;

use thiserror::Error;
use windows_sys::Win32::Foundation::{
    ERROR_FILENAME_EXCED_RANGE, ERROR_LOCK_VIOLATION, ERROR_SHARING_VIOLATION, ERROR_TOO_MANY_OPEN_FILES,
    ERROR_USER_MAPPED_FILE, HANDLE,
};
use windows_sys::Win32::Storage::FileSystem::{
    BY_HANDLE_FILE_INFORMATION, FILE_FLAG_BACKUP_SEMANTICS, FILE_FLAG_OPEN_REPARSE_POINT, FILE_TYPE_DISK,
    GetDiskFreeSpaceExW, GetFileInformationByHandle, GetFileType, GetFinalPathNameByHandleW,
};

/// Names as bytes, in Rust's encoding: UTF-8, with lone surrogates encoded alike.
pub(crate) trait OsStrExt {
    /// Bytes of the name.
    fn as_bytes(&self) -> &[u8];
    /// The name of bytes from [`Self::as_bytes`].
    fn from_bytes(bytes: &[u8]) -> &Self;
}

impl OsStrExt for OsStr {
    fn as_bytes(&self) -> &[u8] {
        self.as_encoded_bytes()
    }

    fn from_bytes(bytes: &[u8]) -> &Self {
        // SAFETY: bytes come from `as_bytes` of the same process, whole or cut at separators, which are ASCII.
        unsafe { Self::from_encoded_bytes_unchecked(bytes) }
    }
}

/// Reading and writing by position. The system moves the file's cursor, too, so readers by position must not rely on
/// it.
pub(crate) trait FileExt {
    /// As `pread`.
    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize>;
    /// Fills all bytes.
    fn read_exact_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()>;
    /// Writes all bytes.
    fn write_all_at(&self, bytes: &[u8], offset: u64) -> io::Result<()>;
}

impl FileExt for File {
    fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<usize> {
        self.seek_read(bytes, offset)
    }

    fn read_exact_at(&self, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
        while !bytes.is_empty() {
            match self.seek_read(bytes, offset) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(read) => {
                    bytes = &mut bytes[read..];
                    offset += read as u64;
                }
                Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
                Err(cause) => return Err(cause),
            }
        }
        Ok(())
    }

    fn write_all_at(&self, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
        while !bytes.is_empty() {
            match self.seek_write(bytes, offset) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(written) => {
                    bytes = &bytes[written..];
                    offset += written as u64;
                }
                Err(cause) if cause.kind() == io::ErrorKind::Interrupted => {}
                Err(cause) => return Err(cause),
            }
        }
        Ok(())
    }
}

fn handle(file: &File) -> HANDLE {
    file.as_raw_handle()
}

/// Identity of an open file regardless of its name: the volume and its number there.
///
/// # Errors
/// The system refused.
pub(crate) fn open_file_id(file: &File) -> io::Result<(u64, u64)> {
    // SAFETY: a structure of integers may be zeros; the handle is open, and the pointer is to a value that lives through the
    // call.
    let (done, known) = unsafe {
        let mut known: BY_HANDLE_FILE_INFORMATION = std::mem::zeroed();
        (GetFileInformationByHandle(handle(file), &raw mut known), known)
    };
    if done == 0 {
        return Err(io::Error::last_os_error());
    }
    let number = u64::from(known.nFileIndexHigh) << 32 | u64::from(known.nFileIndexLow);
    Ok((known.dwVolumeSerialNumber.into(), number))
}

/// Identity of a file or folder that a path leads to.
///
/// # Errors
/// The system refused.
pub(crate) fn file_id(path: &Path) -> io::Result<(u64, u64)> {
    open_file_id(&OpenOptions::new().access_mode(0).custom_flags(FILE_FLAG_BACKUP_SEMANTICS).open(path)?)
}

/// Prefix of a path that the system takes literally, in which `/` is not a separator.
const VERBATIM: &str = r"\\?\";

/// A path below a folder, with `/` between them: volumes have the same names and order as on Linux.
pub(crate) fn below(folder: &Path, name: &Path) -> PathBuf {
    let bytes = folder.as_os_str().as_bytes();
    if bytes.is_empty() || bytes.starts_with(VERBATIM.as_bytes()) || name.has_root() {
        return folder.join(name);
    }
    let mut path = folder.as_os_str().to_owned();
    if !bytes.ends_with(b"/") && !bytes.ends_with(b"\\") {
        path.push("/");
    }
    path.push(name);
    path.into()
}

/// A path in the form without a limit of its length, if it comes near the 260 characters of other forms.
pub(crate) fn of_any_length(path: PathBuf) -> PathBuf {
    /// Length that leaves room for the name of a temporary file in the same folder.
    const NEAR: usize = 200;
    let is_long = std::path::absolute(&path).is_ok_and(|whole| whole.as_os_str().len() > NEAR);
    let folder =
        path.parent().map(|folder| if folder.as_os_str().is_empty() { Path::new(".") } else { folder });
    let whole = || Some(std::fs::canonicalize(folder?).ok()?.join(path.file_name()?));
    if is_long { whole().unwrap_or(path) } else { path }
}

/// True for a path that leads to a device, whatever its folder and suffix are.
pub(crate) fn is_device(path: &Path) -> bool {
    path.file_name().is_some_and(|name| super::super::is_device_name(&name.to_string_lossy()))
}

/// The reason why a file is not replaced: in a folder that took a new file, access is denied to a file that is open or
/// read-only, and a name that cannot be found is too long.
pub(crate) fn not_replaced(cause: io::Error) -> io::Error {
    match cause.kind() {
        io::ErrorKind::PermissionDenied => {
            io::Error::from_raw_os_error(ERROR_SHARING_VIOLATION.cast_signed())
        }
        io::ErrorKind::NotFound => io::Error::from_raw_os_error(ERROR_FILENAME_EXCED_RANGE.cast_signed()),
        _ => cause,
    }
}

/// True if another program has the file open or mapped.
pub(crate) fn is_open_elsewhere(cause: &io::Error) -> bool {
    let causes = [ERROR_SHARING_VIOLATION, ERROR_LOCK_VIOLATION, ERROR_USER_MAPPED_FILE];
    causes.iter().any(|known| cause.raw_os_error() == Some(known.cast_signed()))
}

/// A path for reports: with `/`, as on Linux.
pub(crate) fn as_reported(path: String) -> String {
    if path.starts_with(VERBATIM) { path } else { path.replace('\\', "/") }
}

/// Time of the last change of a file's bytes: seconds and nanoseconds.
pub(crate) fn changed(meta: &Metadata) -> (i64, i64) {
    /// Ticks of 100 ns in a second, and seconds from 1601 to 1970.
    const TICKS: i64 = 10_000_000;
    const TO_1970: i64 = 11_644_473_600;
    let ticks = meta.last_write_time().cast_signed();
    (ticks.div_euclid(TICKS) - TO_1970, ticks.rem_euclid(TICKS) * 100)
}

/// A folder, a pipe or a device where a file is needed; held by an [`io::Error`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("it is not a regular file")]
pub(crate) struct NotRegular;

/// Opens a regular file for reading; a folder, a pipe and a device (`NUL`, `COM1`) are refused.
///
/// # Errors
/// The file is not regular ([`NotRegular`], of the kind [`io::ErrorKind::InvalidInput`]), or the system refused.
pub(in crate::platform) fn open_file(path: &Path) -> io::Result<File> {
    let refused = || io::Error::new(io::ErrorKind::InvalidInput, NotRegular);
    if is_device(path) || std::fs::metadata(path)?.is_dir() {
        return Err(refused());
    }
    let file = File::open(path)?;
    // SAFETY: the handle is open.
    if unsafe { GetFileType(handle(&file)) } != FILE_TYPE_DISK || !file.metadata()?.is_file() {
        return Err(refused());
    }
    Ok(file)
}

/// `None`: a new file has the permissions of its folder.
pub(crate) fn new_file_permissions() -> Option<Permissions> {
    None
}

/// True for a refusal by [`open_file`].
pub(crate) fn is_not_regular(cause: &io::Error) -> bool {
    cause.get_ref().is_some_and(|inner| inner.is::<NotRegular>())
}

/// Opens a file for reading and writing, and makes it if it is missing; a link itself is opened, not its target.
///
/// # Errors
/// The system refused.
pub(crate) fn open_itself(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    options.custom_flags(FILE_FLAG_OPEN_REPARSE_POINT).open(path)
}

/// Free bytes of the file system of a file.
pub(crate) fn free_bytes(file: &File) -> Option<u64> {
    let mut name = [0_u16; 1 << 10];
    // SAFETY: the handle is open, and the buffer has the length given.
    let length = unsafe { GetFinalPathNameByHandleW(handle(file), name.as_mut_ptr(), 1 << 10, 0) };
    let name = name.get(..usize::try_from(length).ok()?).filter(|name| !name.is_empty())?;
    let folder = std::os::windows::ffi::OsStringExt::from_wide(name);
    let folder: std::ffi::OsString = folder;
    let wide: Vec<u16> = Path::new(&folder).parent()?.as_os_str().encode_wide().chain([0]).collect();
    let mut free = 0;
    // SAFETY: the name ends with a zero; the pointer is to a value that lives through the call, the others may be null.
    let done = unsafe {
        GetDiskFreeSpaceExW(wide.as_ptr(), &raw mut free, std::ptr::null_mut(), std::ptr::null_mut())
    };
    (done != 0).then_some(free)
}

/// Most files that this process may have open; `None` without a limit.
pub(crate) fn open_files_limit() -> Option<u64> {
    None
}

/// True if a file was refused because too many are open.
pub(crate) fn is_too_many_open(cause: &io::Error) -> bool {
    cause.raw_os_error() == Some(ERROR_TOO_MANY_OPEN_FILES.cast_signed())
}
