//! Records by key in one unnamed file.

use std::fs::File;
use std::io;

use crate::platform::FileExt;

/// Bytes before a chunk: the offset of the next chunk of its key, and its number of bytes.
const HEAD: usize = 16;

/// Records by key, in chained chunks of one file.
///
/// Memory: [`Chains::memory_bytes`]. Each chunk's place is allocated before it is written, so that a key only remembers
/// its first and its last one.
#[derive(Debug)]
pub(crate) struct Chains {
    file: File,
    chunk_bytes: usize,
    end: u64,
    keys: Vec<Chain>,
}

#[derive(Debug)]
struct Chain {
    first: u64,
    last: u64,
    /// The content of the last chunk.
    open: Vec<u8>,
}

impl Chains {
    /// Memory of as many keys, whose chunks are allocated with their first record.
    pub(crate) fn memory_bytes(keys: usize, chunk_bytes: usize) -> u64 {
        (keys * (size_of::<Chain>() + chunk_bytes)) as u64
    }

    /// No records yet, for keys from 0; a record is at most a chunk long.
    pub(crate) fn new(file: File, keys: usize, chunk_bytes: usize) -> Self {
        let step = (HEAD + chunk_bytes) as u64;
        let chain = |at| Chain { first: at, last: at, open: Vec::new() };
        let places = (0..keys as u64).map(|key| key * step);
        Self { file, chunk_bytes, end: keys as u64 * step, keys: places.map(chain).collect() }
    }

    /// Appends a record to a key.
    ///
    /// # Errors
    /// The disk is full.
    #[inline]
    pub(crate) fn push(&mut self, key: usize, record: &[u8]) -> io::Result<()> {
        let Some(chain) = self.keys.get_mut(key) else { return Ok(()) };
        if chain.open.len() + record.len() > self.chunk_bytes {
            write(&self.file, chain, self.end)?;
            (chain.last, self.end) = (self.end, self.end + (HEAD + self.chunk_bytes) as u64);
            chain.open.clear();
        }
        chain.open.reserve_exact(self.chunk_bytes - chain.open.len());
        chain.open.extend_from_slice(record);
        Ok(())
    }

    /// Calls `work` with the records of a key, chunk by chunk, each of whole records.
    ///
    /// # Errors
    /// Errors of `work`, or `failed` of an error of the disk.
    pub(crate) fn for_each_chunk<E>(
        &self,
        key: usize,
        failed: impl Fn(io::Error) -> E,
        mut work: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let Some(chain) = self.keys.get(key) else { return Ok(()) };
        let (mut at, mut bytes) = (chain.first, Vec::new());
        while at != chain.last {
            let mut head = [0; HEAD];
            self.file.read_exact_at(&mut head, at).map_err(&failed)?;
            let [next, len] = bytemuck::cast::<[u8; HEAD], [u64; 2]>(head);
            bytes.resize(usize::try_from(len).unwrap_or(0).min(self.chunk_bytes), 0);
            self.file.read_exact_at(&mut bytes, at + HEAD as u64).map_err(&failed)?;
            work(&bytes)?;
            at = next;
        }
        work(&chain.open)
    }
}

#[cold]
fn write(file: &File, chain: &Chain, next: u64) -> io::Result<()> {
    let head = [next, chain.open.len() as u64];
    file.write_all_at(bytemuck::bytes_of(&head), chain.last)?;
    file.write_all_at(&chain.open, chain.last + HEAD as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_of_every_key_come_back_in_their_order() {
        let mut chains = Chains::new(tempfile::tempfile().unwrap(), 3, 64);
        let record = |i: usize| vec![u8::try_from(i % 251).unwrap(); i % 65];
        let mut expected = [const { Vec::new() }; 3];
        for i in 0..3000 {
            let key = i * i % 3;
            chains.push(key, &record(i)).unwrap();
            expected[key].extend(record(i));
        }
        for (key, expected) in expected.into_iter().enumerate() {
            let mut found = Vec::new();
            let add = |chunk: &[u8]| {
                found.extend_from_slice(chunk);
                Ok::<_, io::Error>(())
            };
            chains.for_each_chunk(key, |e| e, add).unwrap();
            assert_eq!(found, expected);
        }
    }
}
