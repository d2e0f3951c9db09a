//! Items of one slice, row by row.

/// Items in rows, one after the other.
#[derive(Clone, Debug)]
pub(crate) struct Rows<T> {
    items: Vec<T>,
    ends: Vec<usize>,
}

impl<T> Default for Rows<T> {
    fn default() -> Self {
        Self { items: Vec::new(), ends: Vec::new() }
    }
}

impl<T> Rows<T> {
    /// Adds an item to the row that is being filled.
    pub(crate) fn push(&mut self, item: T) {
        self.items.push(item);
    }

    /// Ends the row that is being filled.
    pub(crate) fn end_row(&mut self) {
        self.ends.push(self.items.len());
    }

    /// True if no row has an item.
    pub(crate) fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    /// Removes all rows, and keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.items.clear();
        self.ends.clear();
    }

    /// The items of a row; empty beyond the last row.
    pub(crate) fn row(&self, row: usize) -> &[T] {
        let start = row.checked_sub(1).map_or(Some(0), |before| self.ends.get(before).copied());
        match (start, self.ends.get(row)) {
            (Some(start), Some(end)) => self.items.get(start..*end).unwrap_or_default(),
            _ => &[],
        }
    }

    /// All items, mutable.
    pub(crate) fn items_mut(&mut self) -> &mut [T] {
        &mut self.items
    }

    /// The items of the row that was ended last, and of the row that is being filled.
    pub(crate) fn last_and_open(&mut self) -> (&[T], &mut [T]) {
        let open = self.ends.last().copied().unwrap_or(0);
        let start = self.ends.len().checked_sub(2).and_then(|before| self.ends.get(before)).copied();
        let (done, filled) = self.items.split_at_mut(open);
        (done.get(start.unwrap_or(0)..).unwrap_or_default(), filled)
    }
}
