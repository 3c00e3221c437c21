//! Places with names that outlive their tenants.
//!
//! A value keeps its place from [`Slots::insert`] to [`Slots::remove`], and its [`SlotId`] names it exactly that long: a place given to
//! another value gets a new generation, so that a stale id finds nothing instead of a stranger. Every operation but iteration takes
//! constant time.

/// Names one value in [`Slots`] until it is removed, and nothing afterwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SlotId {
    generation: u32,
    place: u32,
}

impl SlotId {
    /// The place, below the capacity: an index for arrays that run beside the slots.
    #[must_use]
    pub const fn place(self) -> usize {
        self.place as usize
    }

    /// One number for both, for up to 256 places: a place is used 16 million times before it comes again.
    #[must_use]
    pub const fn number(self) -> u32 {
        self.generation << 8 | self.place & 0xff
    }
}

#[derive(Debug, Clone, Copy)]
struct Slot<V> {
    /// Grows with every removal.
    generation: u32,
    /// The next free place, where this one is free.
    next_free: u32,
    value: Option<V>,
}

/// At most `N` values with stable ids.
///
/// # Example
/// ```
/// use libella_core::storage::slots::Slots;
/// let mut slots = Slots::<char, 2>::new();
/// let a = slots.insert('a').expect("room for two");
/// assert_eq!(slots.get(a), Some(&'a'));
/// assert_eq!(slots.remove(a), Some('a'));
/// let b = slots.insert('b').expect("room for two");
/// assert_eq!(b.place(), a.place()); // the same place
/// assert_eq!(slots.get(a), None); // but the old name is not valid
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Slots<V, const N: usize> {
    slots: [Slot<V>; N],
    /// The most recently freed place; `N` if there is none.
    first_free: u32,
    len: usize,
}

impl<V: Copy, const N: usize> Default for Slots<V, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<V: Copy, const N: usize> Slots<V, N> {
    /// Empty slots.
    #[must_use]
    #[allow(clippy::cast_possible_truncation)]
    pub const fn new() -> Self {
        const { assert!(N < u32::MAX as usize) }
        let mut slots = [Slot { generation: 0, next_free: 0, value: None }; N];
        let mut place = 0;
        while place < N {
            slots[place].next_free = place as u32 + 1;
            place += 1;
        }
        Self { slots, first_free: 0, len: 0 }
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

    /// Whether the next [`Self::insert`] hands its value back.
    #[must_use]
    pub const fn is_full(&self) -> bool {
        self.len == N
    }

    /// `N`.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        N
    }

    /// Takes a value in.
    ///
    /// # Errors
    /// The value itself if all places are taken.
    pub fn insert(&mut self, value: V) -> Result<SlotId, V> {
        let place = self.first_free;
        let Some(slot) = self.slots.get_mut(place as usize) else { return Err(value) };
        slot.value = Some(value);
        self.first_free = slot.next_free;
        self.len += 1;
        Ok(SlotId { generation: slot.generation, place })
    }

    /// Removes a value; its id names nothing from now on.
    pub fn remove(&mut self, id: SlotId) -> Option<V> {
        let slot = self.slots.get_mut(id.place()).filter(|slot| slot.generation == id.generation)?;
        let value = slot.value.take()?;
        slot.generation = slot.generation.wrapping_add(1);
        slot.next_free = self.first_free;
        self.first_free = id.place;
        self.len -= 1;
        Some(value)
    }

    /// The value of an id, `None` once it has been removed.
    #[must_use]
    pub fn get(&self, id: SlotId) -> Option<&V> {
        self.slots.get(id.place()).filter(|slot| slot.generation == id.generation)?.value.as_ref()
    }

    /// The value of an id, `None` once it has been removed.
    #[must_use]
    pub fn get_mut(&mut self, id: SlotId) -> Option<&mut V> {
        self.slots.get_mut(id.place()).filter(|slot| slot.generation == id.generation)?.value.as_mut()
    }

    /// Whether an id still names a value.
    #[must_use]
    pub fn contains(&self, id: SlotId) -> bool {
        self.get(id).is_some()
    }

    /// The id of the value at a place, if there is one.
    #[must_use]
    #[allow(clippy::cast_possible_truncation)]
    pub fn id_at(&self, place: usize) -> Option<SlotId> {
        let slot = self.slots.get(place).filter(|slot| slot.value.is_some())?;
        Some(SlotId { generation: slot.generation, place: place as u32 })
    }

    /// All values with their ids, by place.
    #[allow(clippy::cast_possible_truncation)]
    pub fn iter(&self) -> impl Iterator<Item = (SlotId, &V)> {
        self.slots.iter().enumerate().filter_map(|(place, slot)| {
            let id = SlotId { generation: slot.generation, place: place as u32 };
            slot.value.as_ref().map(|value| (id, value))
        })
    }

    /// All values with their ids, by place.
    #[allow(clippy::cast_possible_truncation)]
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (SlotId, &mut V)> {
        self.slots.iter_mut().enumerate().filter_map(|(place, slot)| {
            let id = SlotId { generation: slot.generation, place: place as u32 };
            slot.value.as_mut().map(|value| (id, value))
        })
    }

    /// Removes every value for which `keep` is false.
    pub fn retain(&mut self, mut keep: impl FnMut(SlotId, &mut V) -> bool) {
        for place in 0..N {
            let Some(id) = self.id_at(place) else { continue };
            if self.get_mut(id).is_some_and(|value| !keep(id, value)) {
                self.remove(id);
            }
        }
    }

    /// Removes everything; no id given so far is valid any more.
    pub fn clear(&mut self) {
        self.retain(|_, _| false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[derive(Debug, Clone, Copy)]
    enum Act {
        Insert(u16),
        /// Which of all ids ever given, modulo their number.
        Remove(usize),
        Change(usize, u16),
        KeepEven,
        Clear,
    }

    fn act() -> impl Strategy<Value = Act> {
        prop_oneof![
            8 => any::<u16>().prop_map(Act::Insert),
            5 => any::<usize>().prop_map(Act::Remove),
            2 => (any::<usize>(), any::<u16>()).prop_map(|(which, value)| Act::Change(which, value)),
            1 => Just(Act::KeepEven),
            1 => Just(Act::Clear),
        ]
    }

    /// The model remembers every id ever given, with its value while it is alive.
    fn follows_the_model<const N: usize>(acts: &[Act]) {
        let mut slots = Slots::<u16, N>::new();
        let mut model: Vec<(SlotId, Option<u16>)> = Vec::new();
        for &act in acts {
            let given = model.len().max(1);
            match act {
                Act::Insert(value) => {
                    let alive = model.iter().filter(|(_, value)| value.is_some()).count();
                    match slots.insert(value) {
                        Ok(id) => {
                            assert!(alive < N && id.place() < N);
                            assert!(model.iter().all(|(other, _)| *other != id), "an id was given twice");
                            model.push((id, Some(value)));
                        }
                        Err(returned) => assert_eq!((alive, returned), (N, value)),
                    }
                }
                Act::Remove(which) => {
                    if let Some((id, value)) = model.get_mut(which % given) {
                        assert_eq!(slots.remove(*id), value.take());
                    }
                }
                Act::Change(which, new) => {
                    if let Some((id, value)) = model.get_mut(which % given) {
                        let slot = slots.get_mut(*id);
                        assert_eq!(slot.as_deref(), value.as_ref());
                        if let Some(slot) = slot {
                            *slot = new;
                            *value = Some(new);
                        }
                    }
                }
                Act::KeepEven => {
                    slots.retain(|_, value| *value % 2 == 0);
                    for (_, value) in &mut model {
                        *value = value.filter(|value| value % 2 == 0);
                    }
                }
                Act::Clear => {
                    slots.clear();
                    model.iter_mut().for_each(|(_, value)| *value = None);
                }
            }
            let mut alive: Vec<_> = model.iter().filter_map(|(id, value)| value.map(|value| (*id, value))).collect();
            assert_eq!((slots.len(), slots.is_empty(), slots.is_full()), (alive.len(), alive.is_empty(), alive.len() == N));
            for (id, value) in &model {
                assert_eq!(slots.get(*id), value.as_ref());
                assert_eq!(slots.contains(*id), value.is_some());
            }
            alive.sort_by_key(|(id, _)| id.place());
            assert!(slots.iter().map(|(id, value)| (id, *value)).eq(alive.iter().copied()));
            assert!(slots.iter_mut().map(|(id, value)| (id, *value)).eq(alive.iter().copied()));
            assert!((0..N).filter_map(|place| slots.id_at(place)).eq(alive.iter().map(|(id, _)| *id)));
        }
    }

    proptest! {
        #[test]
        fn ids_name_their_value_and_nothing_else(acts in prop::collection::vec(act(), 0..80)) {
            follows_the_model::<0>(&acts);
            follows_the_model::<1>(&acts);
            follows_the_model::<6>(&acts);
        }
    }

    #[test]
    fn ids_of_a_larger_table_find_nothing() {
        let mut large = Slots::<u8, 8>::new();
        let mut last = None;
        for value in 0..8 {
            last = large.insert(value).ok();
        }
        let small = Slots::<u8, 2>::new();
        assert_eq!(last.map(SlotId::place), Some(7));
        assert!(last.is_some_and(|id| small.get(id).is_none()));
    }
}
