//! A queue in time order.
//!
//! At most `N` values, oldest first. Pushing into a full ring either hands the value back ([`Ring::push`]) or evicts the oldest
//! ([`Ring::push_evicting`]); nothing else moves, and both take constant time.

use core::iter::Chain;

use super::blank::{Blank, blank};
use core::slice;

/// At most `N` values, oldest first.
///
/// # Example
/// ```
/// use libella_core::storage::ring::Ring;
/// let mut ring = Ring::<u32, 2>::new();
/// assert_eq!(ring.push(1), Ok(()));
/// assert_eq!(ring.push(2), Ok(()));
/// assert_eq!(ring.push(3), Err(3)); // full: the value comes back
/// assert_eq!(ring.push_evicting(3), Some(1)); // full: the oldest goes
/// assert!(ring.iter().eq([2, 3].iter()));
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Ring<V, const N: usize> {
    values: [V; N],
    first: usize,
    len: usize,
}

blank!([V: Blank, const N: usize] Ring<V, N> { values, first, len });

impl<V: Copy + Default, const N: usize> Ring<V, N> {
    /// An empty ring.
    #[must_use]
    pub fn new() -> Self {
        Self { values: [V::default(); N], first: 0, len: 0 }
    }
}

impl<V: Copy + Default, const N: usize> Default for Ring<V, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<V: Copy, const N: usize> Ring<V, N> {
    /// A ring that is empty; `filler` is what its memory holds meanwhile. For values without a default, and for constants.
    #[must_use]
    pub const fn filled_with(filler: V) -> Self {
        Self { values: [filler; N], first: 0, len: 0 }
    }

    /// How many values there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether the next [`Self::push`] hands its value back.
    #[must_use]
    pub const fn is_full(&self) -> bool {
        self.len == N
    }

    /// `N`.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        N
    }

    /// Where the value `index` places after the oldest lies. `index < N`, `first < N`.
    #[inline]
    const fn place(&self, index: usize) -> usize {
        let place = self.first + index;
        if place < N { place } else { place - N }
    }

    /// Appends the newest value.
    ///
    /// # Errors
    /// The value itself if the ring is full.
    pub fn push(&mut self, value: V) -> Result<(), V> {
        if self.is_full() {
            return Err(value);
        }
        let place = self.place(self.len);
        match self.values.get_mut(place) {
            Some(slot) => *slot = value,
            None => return Err(value),
        }
        self.len += 1;
        Ok(())
    }

    /// Appends the newest value; returns the oldest if it had to go, and the value itself if `N` is 0.
    pub fn push_evicting(&mut self, value: V) -> Option<V> {
        let evicted = if self.is_full() { self.pop() } else { None };
        match self.push(value) {
            Ok(()) => evicted,
            Err(value) => Some(value),
        }
    }

    /// Removes the oldest value.
    pub fn pop(&mut self) -> Option<V> {
        let oldest = *self.first()?;
        self.first = self.place(1);
        self.len -= 1;
        Some(oldest)
    }

    /// Removes the newest value.
    pub fn pop_newest(&mut self) -> Option<V> {
        let newest = *self.last()?;
        self.len -= 1;
        Some(newest)
    }

    /// Removes the oldest values as long as `condition` holds; returns how many went.
    pub fn pop_while(&mut self, mut condition: impl FnMut(&V) -> bool) -> usize {
        let before = self.len;
        while self.first().is_some_and(&mut condition) {
            self.pop();
        }
        before - self.len
    }

    /// Removes all but the oldest `len` values.
    pub fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
    }

    /// Removes everything.
    pub fn clear(&mut self) {
        (self.first, self.len) = (0, 0);
    }

    /// The value `index` places after the oldest.
    #[must_use]
    pub fn get(&self, index: usize) -> Option<&V> {
        if index < self.len { self.values.get(self.place(index)) } else { None }
    }

    /// The value `index` places after the oldest.
    #[must_use]
    pub fn get_mut(&mut self, index: usize) -> Option<&mut V> {
        let place = self.place(index.min(self.len));
        if index < self.len { self.values.get_mut(place) } else { None }
    }

    /// The oldest value.
    #[must_use]
    pub fn first(&self) -> Option<&V> {
        self.get(0)
    }

    /// The newest value.
    #[must_use]
    pub fn last(&self) -> Option<&V> {
        self.get(self.len.checked_sub(1)?)
    }

    /// The newest value.
    #[must_use]
    pub fn last_mut(&mut self) -> Option<&mut V> {
        self.get_mut(self.len.checked_sub(1)?)
    }

    /// All values, oldest first, as two slices in memory order; the second is empty unless the ring wraps around.
    #[must_use]
    pub fn as_slices(&self) -> (&[V], &[V]) {
        let (wrapped, from_first) = self.values.split_at(self.first);
        let straight = self.len.min(from_first.len());
        (from_first.split_at(straight).0, wrapped.split_at(self.len - straight).0)
    }

    /// All values, oldest first, as one slice; moves them in memory if the ring wraps around.
    pub fn make_contiguous(&mut self) -> &mut [V] {
        self.values.rotate_left(self.first);
        self.first = 0;
        self.values.split_at_mut(self.len).0
    }

    /// All values, oldest first.
    pub fn iter(&self) -> Iter<'_, V> {
        let (older, newer) = self.as_slices();
        older.iter().chain(newer)
    }

    /// How many of the oldest values satisfy `condition`, which must hold for a prefix: binary search, for values in time order.
    pub fn partition_point(&self, mut condition: impl FnMut(&V) -> bool) -> usize {
        let (older, newer) = self.as_slices();
        let in_older = older.partition_point(&mut condition);
        if in_older < older.len() { in_older } else { in_older + newer.partition_point(condition) }
    }
}

/// Values of a [`Ring`], oldest first.
pub type Iter<'a, V> = Chain<slice::Iter<'a, V>, slice::Iter<'a, V>>;

impl<'a, V: Copy, const N: usize> IntoIterator for &'a Ring<V, N> {
    type Item = &'a V;
    type IntoIter = Iter<'a, V>;
    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<V: Copy + PartialEq, const N: usize> PartialEq for Ring<V, N> {
    /// Equal values in equal order, wherever they lie in memory.
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;
    use std::vec::Vec;

    #[derive(Debug, Clone, Copy)]
    enum Act {
        Push(u8),
        PushEvicting(u8),
        Pop,
        PopNewest,
        PopWhileBelow(u8),
        Truncate(usize),
        MakeContiguous,
        Clear,
        Set(usize, u8),
    }

    fn act() -> impl Strategy<Value = Act> {
        prop_oneof![
            6 => any::<u8>().prop_map(Act::Push),
            6 => any::<u8>().prop_map(Act::PushEvicting),
            4 => Just(Act::Pop),
            1 => Just(Act::PopNewest),
            1 => any::<u8>().prop_map(Act::PopWhileBelow),
            1 => (0..9usize).prop_map(Act::Truncate),
            1 => Just(Act::MakeContiguous),
            1 => Just(Act::Clear),
            2 => (0..9usize, any::<u8>()).prop_map(|(index, value)| Act::Set(index, value)),
        ]
    }

    /// Every act on the ring and on a `VecDeque` leaves the same answer and the same content.
    fn follows_the_model<const N: usize>(acts: &[Act]) {
        let mut ring = Ring::<u8, N>::new();
        let mut model = VecDeque::new();
        for &act in acts {
            match act {
                Act::Push(value) => {
                    let fits = model.len() < N;
                    assert_eq!(ring.push(value), if fits { Ok(()) } else { Err(value) });
                    model.extend(fits.then_some(value));
                }
                Act::PushEvicting(value) => {
                    model.push_back(value);
                    let expected = if model.len() > N { model.pop_front() } else { None };
                    assert_eq!(ring.push_evicting(value), expected);
                }
                Act::Pop => assert_eq!(ring.pop(), model.pop_front()),
                Act::PopNewest => assert_eq!(ring.pop_newest(), model.pop_back()),
                Act::PopWhileBelow(limit) => {
                    let expected = model.iter().take_while(|value| **value < limit).count();
                    model.drain(..expected);
                    assert_eq!(ring.pop_while(|value| *value < limit), expected);
                }
                Act::Truncate(len) => {
                    ring.truncate(len);
                    model.truncate(len);
                }
                Act::MakeContiguous => assert_eq!(ring.make_contiguous(), model.make_contiguous()),
                Act::Clear => {
                    ring.clear();
                    model.clear();
                }
                Act::Set(index, value) => {
                    let (slot, expected) = (ring.get_mut(index), model.get_mut(index));
                    assert_eq!(slot, expected);
                    if let (Some(slot), Some(expected)) = (slot, expected) {
                        (*slot, *expected) = (value, value);
                    }
                }
            }
            assert!(ring.iter().eq(&model), "{ring:?} {model:?}");
            let (older, newer) = ring.as_slices();
            assert_eq!([older, newer].concat(), model.iter().copied().collect::<Vec<_>>());
            assert_eq!((ring.len(), ring.is_empty(), ring.is_full()), (model.len(), model.is_empty(), model.len() == N));
            assert_eq!((ring.first(), ring.last()), (model.front(), model.back()));
            assert!((0..9).all(|index| ring.get(index) == model.get(index)));
        }
    }

    proptest! {
        #[test]
        fn behaves_as_a_bounded_deque(acts in prop::collection::vec(act(), 0..80)) {
            follows_the_model::<0>(&acts);
            follows_the_model::<1>(&acts);
            follows_the_model::<5>(&acts);
        }

        #[test]
        fn partition_point_counts_the_older_ones(skip in 0..7usize, count in 0..7usize, limit in 0..15usize) {
            let mut ring = Ring::<usize, 7>::new();
            for value in 0..skip + count {
                let _ = ring.push_evicting(value);
            }
            let expected = ring.iter().filter(|value| **value < limit).count();
            prop_assert_eq!(ring.partition_point(|value| *value < limit), expected);
        }
    }

    #[test]
    fn equality_ignores_where_the_values_lie() {
        let mut turned = Ring::<u8, 3>::new();
        for value in 0..5 {
            let _ = turned.push_evicting(value);
        }
        let mut straight = Ring::<u8, 3>::filled_with(9);
        for value in 2..5 {
            assert_eq!(straight.push(value), Ok(()));
        }
        assert_eq!(turned, straight);
        straight.truncate(2);
        assert_ne!(turned, straight);
    }
}
