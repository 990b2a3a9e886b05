//! Keeps the parts that are in use in memory, and the others in a store.

use super::part::PartInner;
use super::{Store, StoreError};
use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Parts of which so many bytes at most lie in memory; those that were not used for the longest time are put away.
///
/// What comes back is what was put away, so that no result depends on which parts these are.
pub(crate) struct Shelf {
    most_bytes: usize,
    /// Counts the uses of parts.
    clock: AtomicU64,
    state: Mutex<State>,
}

struct State {
    store: Box<dyn Store>,
    /// Bytes in memory, and those in the store alone.
    held_bytes: usize,
    away_bytes: usize,
    /// The parts in memory, each with its last use as of when it was entered: about the one used the longest ago first.
    order: VecDeque<(u64, Weak<PartInner>)>,
    /// Why nothing is put away any more.
    full: Option<String>,
    /// Why something could not be brought back.
    lost: Option<String>,
}

/// What is wrong with the store, in words for the user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StorageTrouble {
    /// No more can be put away: the drive goes on, and all that comes stays in memory.
    Full(String),
    /// What was put away cannot be had again: what comes of the drive is not to be relied on.
    Lost(String),
}

impl fmt::Debug for Shelf {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "at most {} bytes in memory", self.most_bytes)
    }
}

impl Shelf {
    pub(crate) fn new(store: Box<dyn Store>, most_bytes: usize) -> Self {
        let state = State { store, held_bytes: 0, away_bytes: 0, order: VecDeque::new(), full: None, lost: None };
        Self { most_bytes, clock: AtomicU64::new(1), state: Mutex::new(state) }
    }

    /// What is wrong with the store, if anything is.
    pub(crate) fn trouble(&self) -> Option<StorageTrouble> {
        let state = self.lock();
        let lost = state.lost.clone().map(StorageTrouble::Lost);
        lost.or_else(|| state.full.clone().map(StorageTrouble::Full))
    }

    /// Bytes that lie in the store alone.
    pub(crate) fn away_bytes(&self) -> usize {
        self.lock().away_bytes
    }

    pub(super) fn tick(&self) -> u64 {
        self.clock.fetch_add(1, Ordering::Relaxed)
    }

    /// Takes in a part that is in memory.
    pub(super) fn take(&self, part: &Arc<PartInner>) {
        let mut state = self.lock();
        let used = self.tick();
        part.lock().used = used;
        let done_with = self.enter(&mut state, part, used);
        drop(state);
        drop(done_with);
    }

    /// Brings a part back into memory.
    pub(super) fn bring_back(&self, part: &Arc<PartInner>) -> Arc<[u8]> {
        let mut state = self.lock();
        let mut place = part.lock();
        // Another thread may have been quicker.
        if let Some(bytes) = &place.bytes {
            return Arc::clone(bytes);
        }
        let found = match place.key {
            Some(key) => state.store.get(key, part.length()),
            None => Err(StoreError("nothing was put away".to_owned())),
        };
        let bytes: Arc<[u8]> = match found {
            Ok(bytes) => bytes.into(),
            Err(StoreError(why)) => {
                state.lost.get_or_insert(why);
                return Arc::default();
            }
        };
        let used = self.tick();
        (place.bytes, place.used) = (Some(Arc::clone(&bytes)), used);
        drop(place);
        state.away_bytes -= part.length();
        let done_with = self.enter(&mut state, part, used);
        drop(state);
        drop(done_with);
        bytes
    }

    /// A part is gone.
    pub(super) fn forget(&self, length: usize, is_held: bool, key: Option<u64>) {
        let mut state = self.lock();
        let bytes = if is_held { &mut state.held_bytes } else { &mut state.away_bytes };
        *bytes -= length;
        if let Some(key) = key {
            state.store.free(key, length);
        }
    }

    /// Counts a part that is in memory now, and puts away others until there is room. Gives parts that may have ended
    /// meanwhile: their end takes the lock that is held here, so that they are to be dropped after it.
    fn enter(&self, state: &mut State, part: &Arc<PartInner>, used: u64) -> Vec<Arc<PartInner>> {
        state.held_bytes += part.length();
        state.order.push_back((used, Arc::downgrade(part)));
        let mut done_with = Vec::new();
        while state.held_bytes > self.most_bytes && state.full.is_none() {
            let Some((used, oldest)) = state.order.pop_front() else { break };
            if let Some(oldest) = oldest.upgrade() {
                state.put_away(&oldest, used);
                done_with.push(oldest);
            }
        }
        done_with
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// Puts a part away whose last use was this; one that was used since has its turn later.
    fn put_away(&mut self, part: &Arc<PartInner>, used: u64) {
        let mut place = part.lock();
        let Some(bytes) = &place.bytes else { return };
        if place.used > used {
            self.order.push_back((place.used, Arc::downgrade(part)));
            return;
        }
        if place.key.is_none() {
            match self.store.put(bytes) {
                Ok(key) => place.key = Some(key),
                Err(StoreError(why)) => {
                    self.full = Some(why);
                    self.order.push_front((used, Arc::downgrade(part)));
                    return;
                }
            }
        }
        place.bytes = None;
        self.held_bytes -= part.length();
        self.away_bytes += part.length();
    }
}

#[cfg(test)]
mod tests {
    use super::super::Part;
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    /// A store in memory of which the test sees what is in it.
    #[derive(Debug, Default)]
    struct Shown {
        pieces: Arc<Mutex<BTreeMap<u64, Vec<u8>>>>,
        puts: u64,
        refuses_after: Option<u64>,
    }

    impl Store for Shown {
        fn put(&mut self, bytes: &[u8]) -> Result<u64, StoreError> {
            if self.refuses_after.is_some_and(|most| self.puts >= most) {
                return Err(StoreError("no room".to_owned()));
            }
            self.puts += 1;
            self.pieces.lock().unwrap().insert(self.puts, bytes.to_vec());
            Ok(self.puts)
        }

        fn get(&mut self, key: u64, length: usize) -> Result<Vec<u8>, StoreError> {
            let pieces = self.pieces.lock().unwrap();
            pieces.get(&key).filter(|piece| piece.len() == length).cloned().ok_or(StoreError("gone".to_owned()))
        }

        fn free(&mut self, key: u64, length: usize) {
            assert_eq!(self.pieces.lock().unwrap().remove(&key).map(|piece| piece.len()), Some(length));
        }
    }

    fn bytes_of(number: usize) -> Vec<u8> {
        vec![number as u8; 1 + 7 * number % 50]
    }

    proptest! {
        #[test]
        fn parts_are_what_they_were_and_no_more_than_so_much_is_held(
            most in 0_usize..200,
            // A part is laid down, used, or dropped.
            actions in prop::collection::vec((0_usize..30, 0..4), 1..200),
        ) {
            let pieces = Arc::default();
            let shelf = Arc::new(Shelf::new(Box::new(Shown { pieces: Arc::clone(&pieces), ..Shown::default() }), most));
            let mut parts: BTreeMap<usize, Part> = BTreeMap::new();
            for (number, action) in actions {
                if action == 0 {
                    parts.remove(&number);
                } else {
                    let part = parts.entry(number).or_insert_with(|| Part::new(bytes_of(number)));
                    part.lay_on(&shelf);
                    prop_assert_eq!(&part.bytes()[..], &bytes_of(number)[..]);
                }
                let held: usize = parts.values().map(Part::held_bytes).sum();
                prop_assert!(held <= most && held == shelf.lock().held_bytes);
                prop_assert_eq!(shelf.away_bytes() + held, parts.values().map(Part::len).sum::<usize>());
            }
            prop_assert_eq!(shelf.trouble(), None);
            parts.clear();
            prop_assert!(pieces.lock().unwrap().is_empty());
        }
    }

    #[test]
    fn those_used_last_stay() {
        let shelf = Arc::new(Shelf::new(Box::new(Shown::default()), 3 * bytes_of(3).len()));
        let parts = [(); 4].map(|()| Part::new(bytes_of(3)));
        for part in &parts[..3] {
            part.lay_on(&shelf);
        }
        let _ = parts[0].bytes();
        parts[3].lay_on(&shelf);
        assert_eq!(parts.each_ref().map(|part| part.held_bytes() > 0), [true, false, true, true]);
    }

    #[test]
    fn where_no_more_can_be_put_away_it_stays_in_memory() {
        let store = Shown { refuses_after: Some(2), ..Shown::default() };
        let shelf = Arc::new(Shelf::new(Box::new(store), 0));
        let parts: Vec<Part> = (1..6).map(|number| Part::new(bytes_of(number))).collect();
        parts.iter().for_each(|part| part.lay_on(&shelf));
        assert_eq!(shelf.trouble(), Some(StorageTrouble::Full("no room".to_owned())));
        for (part, number) in parts.iter().zip(1..) {
            assert_eq!(part.bytes()[..], bytes_of(number));
        }
        assert_eq!(shelf.away_bytes(), 0);
    }

    #[test]
    fn what_is_lost_is_told() {
        let pieces: Arc<Mutex<BTreeMap<u64, Vec<u8>>>> = Arc::default();
        let shelf = Arc::new(Shelf::new(Box::new(Shown { pieces: Arc::clone(&pieces), ..Shown::default() }), 0));
        let part = Part::new(bytes_of(4));
        part.lay_on(&shelf);
        pieces.lock().unwrap().values_mut().for_each(Vec::clear);
        assert!(part.bytes().is_empty());
        assert_eq!(shelf.trouble(), Some(StorageTrouble::Lost("gone".to_owned())));
        pieces.lock().unwrap().values_mut().for_each(|piece| *piece = bytes_of(4));
    }

    #[test]
    fn several_threads_may_use_parts_at_once() {
        let shelf = Arc::new(Shelf::new(Box::new(Shown::default()), 100));
        let parts: Vec<Part> = (0..30).map(|number| Part::new(bytes_of(number))).collect();
        parts.iter().for_each(|part| part.lay_on(&shelf));
        std::thread::scope(|scope| {
            for step in [1, 7, 11, 13] {
                let parts = &parts;
                scope.spawn(move || {
                    for number in (0..3000).map(|turn| turn * step % 30) {
                        assert_eq!(parts[number].bytes()[..], bytes_of(number));
                    }
                });
            }
        });
        assert_eq!(shelf.trouble(), None);
    }
}
