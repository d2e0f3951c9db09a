//! Parts of a file of text, by where their triangles begin.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Most parts with numbers of their own; later ones share the last.
const MAX_PARTS: usize = 256;
/// Most changes from part to part that are followed.
const MAX_CHANGES: usize = 1 << 14;

/// Part of each triangle. Parts are numbered in the order of their first triangles.
#[derive(Debug, Default)]
pub(super) struct Parts {
    /// First triangle, and part, of every run.
    runs: Vec<(u64, u32)>,
    /// Numbers of parts by hashes of their names.
    numbers: BTreeMap<u64, u32>,
    /// Hashes of the names of the current object and group.
    names: [u64; 2],
}

impl Parts {
    /// Most memory that it may hold.
    pub(super) const BYTES: u64 = (MAX_CHANGES * 16 + MAX_PARTS * 32) as u64;

    /// Begins an object, without a group yet.
    pub(super) fn object(&mut self, name: &[u8]) {
        self.names = [hash(name), 0];
    }

    /// Begins a group of the same object.
    pub(super) fn group(&mut self, name: &[u8]) {
        self.names[1] = hash(name);
    }

    /// Begins a face with this triangle.
    pub(super) fn face(&mut self, triangle: u64) {
        let mut all = DefaultHasher::new();
        self.names.hash(&mut all);
        let next = u32::try_from(self.numbers.len()).unwrap_or(u32::MAX);
        let key = all.finish();
        let number = if self.numbers.len() < MAX_PARTS {
            *self.numbers.entry(key).or_insert(next)
        } else {
            self.numbers.get(&key).copied().unwrap_or(next - 1)
        };
        let is_new = self.runs.last().is_none_or(|(_, last)| *last != number);
        if is_new && self.runs.len() < MAX_CHANGES {
            self.runs.push((triangle, number));
        }
    }

    pub(super) fn count(&self) -> u64 {
        self.numbers.len().max(1) as u64
    }

    /// The parts of triangles, one after the other.
    pub(super) fn each(&self) -> impl FnMut() -> u32 {
        let mut runs = self.runs.iter().copied().peekable();
        let (mut triangle, mut part) = (0, 0);
        move || {
            while let Some((_, next)) = runs.next_if(|(first, _)| *first <= triangle) {
                part = next;
            }
            triangle += 1;
            part
        }
    }
}

fn hash(name: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    name.hash(&mut hasher);
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_belong_to_the_names_that_came_last() {
        let mut parts = Parts::default();
        parts.group(b"unused");
        parts.object(b"a");
        (0..3).for_each(|at| parts.face(at));
        parts.group(b"g");
        parts.face(3);
        parts.object(b"b");
        parts.face(5);
        parts.object(b"a");
        parts.face(6);
        let mut next = parts.each();
        let got: Vec<u32> = (0..8).map(|_| next()).collect();
        drop(next);
        assert_eq!((parts.count(), got), (3, vec![0, 0, 0, 1, 1, 2, 0, 0]));
        for at in 0..2000_u64 {
            parts.object(&at.to_le_bytes());
            parts.face(10 + at);
        }
        assert_eq!(parts.count(), 256);
    }
}
