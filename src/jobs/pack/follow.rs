//! A file that is read while it is being written, from front to back: the coarse means are made from normals that other
//! threads are still decoding.

use std::fs::File;
use std::io;
use std::sync::{Condvar, Mutex, PoisonError};

use crate::load::ReadAt;

/// Progress of a file's writer.
struct Written {
    to: u64,
    stopped: bool,
}

/// A file whose readers wait for bytes that are not written yet.
pub(super) struct Follow<'a> {
    file: &'a File,
    written: Mutex<Written>,
    changed: Condvar,
}

impl<'a> Follow<'a> {
    /// A file of which nothing is written.
    pub(super) fn new(file: &'a File) -> Self {
        Self { file, written: Mutex::new(Written { to: 0, stopped: false }), changed: Condvar::new() }
    }

    /// Marks everything before this position as written.
    pub(super) fn reached(&self, position: u64) {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.to = written.to.max(position);
        self.changed.notify_all();
    }

    /// Ends the writing: waiting readers stop.
    pub(super) fn stop(&self) {
        self.written.lock().unwrap_or_else(PoisonError::into_inner).stopped = true;
        self.changed.notify_all();
    }
}

impl ReadAt for Follow<'_> {
    fn byte_len(&self) -> io::Result<u64> {
        self.file.byte_len()
    }

    fn read_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        let end = offset.saturating_add(out.len() as u64);
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        while written.to < end {
            if written.stopped {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            written = self.changed.wait(written).unwrap_or_else(PoisonError::into_inner);
        }
        drop(written);
        self.file.read_at(out, offset)
    }
}

/// Stops the followed file when it is dropped, also by a panic.
pub(super) struct StopAtEnd<'a, 'b>(pub(super) &'a Follow<'b>);

impl Drop for StopAtEnd<'_, '_> {
    fn drop(&mut self) {
        self.0.stop();
    }
}

#[cfg(test)]
mod tests {
    use crate::platform::FileExt;

    use super::*;

    #[test]
    fn readers_wait_for_writers_and_hear_that_they_stopped() {
        let file = tempfile::tempfile().unwrap();
        let follow = Follow::new(&file);
        std::thread::scope(|scope| {
            let read = |at| {
                let mut byte = [0];
                follow.read_at(&mut byte, at).map(|()| byte[0])
            };
            let (first, last) = (scope.spawn(move || read(3)), scope.spawn(move || read(4)));
            file.write_all_at(&[1, 2, 3, 4], 0).unwrap();
            follow.reached(4);
            assert_eq!(first.join().unwrap().unwrap(), 4);
            drop(StopAtEnd(&follow));
            assert_eq!(last.join().unwrap().unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        });
    }
}
