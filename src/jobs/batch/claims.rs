//! Names of the volumes of a batch, given in the order of the catalogue, whichever job opens a volume first: the same
//! volumes have the same names in every run.

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::fnv;
use crate::source::Finding;

/// A volume of the catalogue: the number of its item, and its number within the item.
pub(in crate::jobs) type Place = (usize, usize);

/// Names given so far; some 40 bytes of memory for each volume.
#[derive(Debug, Default)]
pub(in crate::jobs) struct Claims {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// Item whose turn it is.
    turn: usize,
    /// Owners of the names, by the hash of each name.
    owners: BTreeMap<u64, Place>,
}

/// Answer to a volume that asks for a name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::jobs) enum Claim {
    /// The volume has this name; the number is set if others have the same id and another content.
    Own(String, Option<u32>),
    /// The volume is a copy of the one of this name.
    CopyOf(String),
}

/// The turn of an item; the next one's begins when it is dropped.
pub(in crate::jobs) struct Turn<'a> {
    claims: &'a Claims,
}

impl Claims {
    /// Waits until all items before this one have had their turns. Every item has to take its own.
    pub(in crate::jobs) fn turn(&self, item: usize) -> Turn<'_> {
        let mut state = self.lock();
        while state.turn != item {
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        Turn { claims: self }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Turn<'_> {
    /// True if a volume of this batch has the name.
    pub(in crate::jobs) fn is_taken(&self, name: &str) -> bool {
        self.claims.lock().owners.contains_key(&fnv(name.as_bytes()))
    }

    /// A name for a volume; `is_copy` compares it with one that has its id.
    pub(in crate::jobs) fn claim(
        &self,
        finding: &Finding,
        place: Place,
        is_copy: &dyn Fn(&Finding, Place) -> bool,
    ) -> Claim {
        let (mut name, mut number) = (finding.id.clone(), None);
        loop {
            let key = fnv(name.as_bytes());
            let owner = self.claims.lock().owners.get(&key).copied();
            let Some(owner) = owner else {
                self.claims.lock().owners.insert(key, place);
                return Claim::Own(name, number);
            };
            if is_copy(finding, owner) {
                return Claim::CopyOf(name);
            }
            let next = number.unwrap_or(1) + 1;
            number = Some(next);
            name = format!("{}-n{next}", finding.id);
        }
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.claims.lock().turn += 1;
        self.claims.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::InputFiles;

    fn finding(id: &str) -> Finding {
        let error = crate::volume::SourceError::unreadable("x", std::io::ErrorKind::NotFound.into());
        Finding::new("x".as_ref(), "nrrd", id.into(), InputFiles::default(), Err(error))
    }

    #[test]
    fn names_follow_the_order_of_items_and_copies_have_none() {
        let claims = Claims::default();
        let got = Mutex::new(Vec::new());
        std::thread::scope(|scope| {
            for item in (0..6).rev() {
                let (claims, got) = (&claims, &got);
                scope.spawn(move || {
                    let turn = claims.turn(item);
                    // Volumes of even items are copies of each other, those of odd items are all different.
                    let is_copy = |_: &Finding, (of, _): Place| item % 2 == 0 && of % 2 == 0;
                    let claim = turn.claim(&finding("a"), (item, 0), &is_copy);
                    got.lock().unwrap().push(claim);
                });
            }
        });
        let own = |name: &str, number| Claim::Own(name.into(), number);
        let copy = || Claim::CopyOf("a".into());
        let expected = [
            own("a", None),
            own("a-n2", Some(2)),
            copy(),
            own("a-n3", Some(3)),
            copy(),
            own("a-n4", Some(4)),
        ];
        assert_eq!(*got.lock().unwrap(), expected);
        assert!(claims.turn(6).is_taken("a-n3") && !claims.turn(7).is_taken("b"));
    }
}
