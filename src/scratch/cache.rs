//! Pages of a file in memory.

/// A cache of read-only pages, each with a fixed slot; the next page of a slot replaces the one before.
///
/// Memory: [`PageCache::memory_bytes`].
pub(crate) struct PageCache<K, T> {
    /// Key of the page in each slot.
    held: Vec<Option<K>>,
    items: Vec<T>,
    page: usize,
}

impl<K: Copy + PartialEq, T: Copy> PageCache<K, T> {
    /// Memory of so many slots for pages of so many items.
    pub(crate) const fn memory_bytes(slots: usize, page: usize) -> u64 {
        (slots * (page * size_of::<T>() + size_of::<Option<K>>())) as u64
    }

    /// An empty cache.
    pub(crate) fn new(slots: usize, page: usize, item: T) -> Self {
        Self { held: vec![None; slots], items: vec![item; slots * page], page }
    }

    /// The items of a page, which `load` reads unless its slot holds it.
    ///
    /// # Errors
    /// Errors of `load`.
    #[inline]
    pub(crate) fn get<E>(
        &mut self,
        slot: usize,
        page: K,
        load: impl FnOnce(&mut [T]) -> Result<(), E>,
    ) -> Result<&[T], E> {
        let items = &mut self.items[slot * self.page..][..self.page];
        if self.held[slot] != Some(page) {
            self.held[slot] = None;
            load(items)?;
            self.held[slot] = Some(page);
        }
        Ok(items)
    }
}
