//! Memory and work that a frame may take.

use crate::codec::{CodecError, damaged};

/// Counts memory against its limit, and work that is not bounded by the bytes of the input.
pub(super) struct Allowance {
    pub(super) used: u64,
    pub(super) allowed: u64,
    pub(super) visits: u64,
}

impl Allowance {
    pub(super) fn reserve(&mut self, bytes: u64) -> Result<(), CodecError> {
        let needed = self.used.saturating_add(bytes);
        if needed > self.allowed {
            return Err(CodecError::Memory { needed_bytes: needed, allowed_bytes: self.allowed });
        }
        self.used = needed;
        Ok(())
    }

    pub(super) fn visit(&mut self, count: usize) -> Result<(), CodecError> {
        self.visits =
            self.visits.checked_sub(count as u64).ok_or_else(|| damaged("its packets lead nowhere"))?;
        Ok(())
    }

    pub(super) fn release(&mut self, bytes: u64) {
        self.used = self.used.saturating_sub(bytes);
    }

    /// An empty vector that can take `count` values without growing.
    pub(super) fn room<T>(&mut self, count: usize) -> Result<Vec<T>, CodecError> {
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        self.reserve(bytes)?;
        let mut room = Vec::new();
        room.try_reserve_exact(count)
            .map_err(|_| CodecError::Memory { needed_bytes: self.used, allowed_bytes: self.allowed })?;
        Ok(room)
    }

    pub(super) fn filled<T: Clone>(&mut self, count: usize, value: T) -> Result<Vec<T>, CodecError> {
        let mut filled = self.room(count)?;
        filled.resize(count, value);
        Ok(filled)
    }

    /// Appends, doubling the room when it is full.
    pub(super) fn push<T>(&mut self, list: &mut Vec<T>, value: T) -> Result<(), CodecError> {
        if list.len() == list.capacity() {
            let old = list.capacity();
            let new = old.saturating_mul(2).max(64);
            let size = size_of::<T>() as u64;
            self.reserve((new as u64).saturating_mul(size))?;
            list.try_reserve_exact(new - old)
                .map_err(|_| CodecError::Memory { needed_bytes: self.used, allowed_bytes: self.allowed })?;
            self.release((old as u64).saturating_mul(size));
        }
        list.push(value);
        Ok(())
    }

    pub(super) fn drop_list<T>(&mut self, list: Vec<T>) {
        self.release((list.capacity() as u64).saturating_mul(size_of::<T>() as u64));
        drop(list);
    }
}
