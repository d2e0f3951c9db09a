//! Tables that are longer than memory: fixed pages in a unnamed scratch file, the latest used ones held.

use std::fs::File;
use std::io;
use std::marker::PhantomData;
use std::path::Path;

use crate::budget::costs::MAPPED_FROM;
use crate::platform::FileExt;
use crate::scratch::unnamed;

/// Words of a page are at most this.
const PAGE_WORDS: usize = 512;
/// Pages that compete for the same places; the least recently used one gives way.
const WAYS: usize = 4;
const NO_PAGE: u64 = u64::MAX;
/// Pages that are allocated together: 64 KiB. The C library's allocator would map larger buffers one by one, and
/// freeing a mapped one makes it keep as much of its heap from then on.
const CHUNK_PAGES: usize = 16;
const _: () = assert!(CHUNK_PAGES * PAGE_WORDS * 8 < MAPPED_FROM);
/// Most pages of a cache, 20 MiB of them, so that the list of places stays below that size too. Pages beyond are left
/// to the system's page cache.
const MAX_PAGES: u64 = 5120;

/// A table of items that grows at its end.
///
/// Memory: the cache it is made with, at least [`PagedTable::MIN_BYTES`], touched as it fills. As long as the
/// table fits into the cache the file stays empty.
pub(super) struct PagedTable<T> {
    file: File,
    /// Chunks of pages; empty until one of their pages is used.
    cache: Vec<Vec<u64>>,
    places: Vec<Slot>,
    page_words: usize,
    page_items: u64,
    clock: u32,
    latest: (u64, usize),
    len: u64,
    /// Pages that exist since the table was empty.
    pages: u64,
    items: PhantomData<T>,
}

/// The content of a slot of the cache.
#[derive(Clone, Copy)]
struct Slot {
    page: u64,
    used: u32,
    dirty: bool,
}

const EMPTY: Slot = Slot { page: NO_PAGE, used: 0, dirty: false };

impl<T: bytemuck::Pod> PagedTable<T> {
    pub(super) const MIN_BYTES: u64 = (4 * WAYS * PAGE_WORDS * 8) as u64;

    /// An empty table whose cache takes at most `cache_bytes`.
    pub(super) fn new(folder: &Path, cache_bytes: u64) -> io::Result<Self> {
        let page_items = (PAGE_WORDS * 8 / size_of::<T>()).next_power_of_two().max(8);
        let page_items =
            if page_items * size_of::<T>() > PAGE_WORDS * 8 { page_items / 2 } else { page_items };
        let page_words = page_items * size_of::<T>() / 8;
        let page_bytes = (page_words * 8 + size_of::<Slot>()) as u64;
        let pages = cache_bytes.max(Self::MIN_BYTES) / page_bytes;
        let sets = usize::try_from(pages.min(MAX_PAGES)).unwrap_or(usize::MAX) / WAYS;
        Ok(Self {
            file: unnamed(folder)?,
            cache: vec![Vec::new(); (sets * WAYS).div_ceil(CHUNK_PAGES)],
            places: vec![EMPTY; sets * WAYS],
            page_words,
            page_items: page_items as u64,
            clock: 0,
            latest: (NO_PAGE, 0),
            len: 0,
            pages: 0,
            items: PhantomData,
        })
    }

    pub(super) fn len(&self) -> u64 {
        self.len
    }

    pub(super) fn clear(&mut self) {
        self.places.fill(EMPTY);
        self.latest = (NO_PAGE, 0);
        self.len = 0;
        self.pages = 0;
    }

    /// Item `index`, which is below [`PagedTable::len`].
    #[inline]
    pub(super) fn get(&mut self, index: u64) -> io::Result<T> {
        let place = self.locate(index / self.page_items)?;
        let words =
            &self.cache[place / CHUNK_PAGES][place % CHUNK_PAGES * self.page_words..][..self.page_words];
        Ok(bytemuck::cast_slice::<u64, T>(words)[self.within(index)])
    }

    #[inline]
    pub(super) fn get_mut(&mut self, index: u64) -> io::Result<&mut T> {
        let place = self.locate(index / self.page_items)?;
        self.places[place].dirty = true;
        let at = self.within(index);
        Ok(&mut bytemuck::cast_slice_mut::<u64, T>(self.words(place))[at])
    }

    pub(super) fn push(&mut self, item: T) -> io::Result<()> {
        let index = self.len;
        self.len += 1;
        *self.get_mut(index)? = item;
        Ok(())
    }

    fn words(&mut self, place: usize) -> &mut [u64] {
        let at = place % CHUNK_PAGES * self.page_words;
        &mut self.cache[place / CHUNK_PAGES][at..at + self.page_words]
    }

    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "below the items of a page")]
    fn within(&self, index: u64) -> usize {
        (index & (self.page_items - 1)) as usize
    }

    /// The place of a page, which is brought in if it is not held.
    #[inline]
    fn locate(&mut self, page: u64) -> io::Result<usize> {
        if self.latest.0 == page {
            return Ok(self.latest.1);
        }
        self.search(page)
    }

    fn search(&mut self, page: u64) -> io::Result<usize> {
        let sets = (self.places.len() / WAYS) as u64;
        #[expect(clippy::cast_possible_truncation, reason = "below the number of places")]
        let first = (page % sets) as usize * WAYS;
        let set = &self.places[first..first + WAYS];
        let held = set.iter().position(|p| p.page == page);
        let place = match held {
            Some(way) => first + way,
            None => {
                let oldest = (0..WAYS).min_by_key(|way| {
                    let p = set[*way];
                    (p.page != NO_PAGE, p.used)
                });
                let place = first + oldest.unwrap_or(0);
                self.bring(page, place)?;
                place
            }
        };
        if self.clock == u32::MAX {
            // The order of use is reset now and then.
            self.clock = 0;
            self.places.iter_mut().for_each(|p| p.used = 0);
        }
        self.clock += 1;
        self.places[place].used = self.clock;
        self.latest = (page, place);
        Ok(place)
    }

    /// Puts a page in place of another. A page beyond the last is new: old content of the file there is from before
    /// [`PagedTable::clear`].
    fn bring(&mut self, page: u64, place: usize) -> io::Result<()> {
        let old = self.places[place];
        let page_words = self.page_words;
        let chunk = &mut self.cache[place / CHUNK_PAGES];
        if chunk.is_empty() {
            chunk.resize(CHUNK_PAGES * page_words, 0);
        }
        let words = &mut chunk[place % CHUNK_PAGES * page_words..][..page_words];
        let offset = |page: u64| page * page_words as u64 * 8;
        if old.dirty {
            self.file.write_all_at(bytemuck::cast_slice(words), offset(old.page))?;
        }
        let fresh = page >= self.pages;
        self.places[place] = EMPTY;
        if self.latest.1 == place {
            self.latest = (NO_PAGE, 0);
        }
        if fresh {
            self.pages = page + 1;
            words.fill(0);
        } else {
            self.file.read_exact_at(bytemuck::cast_slice_mut(words), offset(page))?;
        }
        self.places[place] = Slot { page, used: 0, dirty: fresh };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn a_table_far_longer_than_its_cache_keeps_every_item() {
        let folder = tempfile::tempdir().unwrap();
        let mut table = PagedTable::<[u64; 3]>::new(folder.path(), 0).unwrap();
        for round in 0..2 {
            table.clear();
            let count = 100_000_u64 >> round;
            for i in 0..count {
                table.push([i, round, 1]).unwrap();
                if i % 128 < 2 {
                    // A page of few items gives way and comes back.
                    for far in (0..i).step_by(331) {
                        assert_eq!(table.get(far).unwrap(), [far, round, 1]);
                    }
                }
            }
            let mut random = Random(1);
            let mut changed = std::collections::BTreeMap::new();
            for _ in 0..50_000 {
                let i = random.below(count);
                table.get_mut(i).unwrap()[2] += 1;
                *changed.entry(i).or_insert(1) += 1;
            }
            for i in 0..count {
                assert_eq!(table.get(i).unwrap(), [i, round, changed.get(&i).copied().unwrap_or(1)]);
            }
            assert_eq!(table.len(), count);
        }
    }

    #[test]
    fn small_items_fill_whole_pages() {
        let folder = tempfile::tempdir().unwrap();
        let mut table = PagedTable::<u8>::new(folder.path(), 0).unwrap();
        for i in 0..200_000_u64 {
            table.push((i % 251) as u8).unwrap();
        }
        for i in (0..200_000).step_by(77) {
            assert_eq!(u64::from(table.get(i).unwrap()), i % 251);
        }
        let mut mid = PagedTable::<[u32; 3]>::new(folder.path(), 1 << 20).unwrap();
        for i in 0..100_000 {
            mid.push([i; 3]).unwrap();
        }
        assert_eq!(mid.get(77_777).unwrap(), [77_777; 3]);
    }
}
