//! The corners being followed, with names that never repeat.

use nalgebra::Vector2;

use super::observation::{Observation, TrackId};
use crate::real::Real;
use crate::storage::blank::blank;

/// One corner being followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    /// Its name.
    pub id: TrackId,
    /// Where it is in the current image, raw px of level 0.
    pub pixel: [f32; 2],
    /// Where it was in the previous image; the same as `pixel` when it is new.
    pub previous: [f32; 2],
    /// Images it was found in after the first.
    pub age: u32,
}

blank!([] Track { id, pixel, previous, age });

impl Track {
    const EMPTY: Self = Self { id: TrackId(0), pixel: [0.0; 2], previous: [0.0; 2], age: 0 };
}

/// At most `TRACKS` corners, the oldest first.
#[derive(Debug, Clone)]
pub struct TrackTable<const TRACKS: usize> {
    tracks: [Track; TRACKS],
    len: usize,
    next_id: u32,
}

blank!([const TRACKS: usize] TrackTable<TRACKS> { tracks, len, next_id });

impl<const TRACKS: usize> Default for TrackTable<TRACKS> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const TRACKS: usize> TrackTable<TRACKS> {
    /// An empty table.
    #[must_use]
    pub const fn new() -> Self {
        Self { tracks: [Track::EMPTY; TRACKS], len: 0, next_id: 0 }
    }

    /// The tracks, oldest first.
    #[must_use]
    pub fn tracks(&self) -> &[Track] {
        self.tracks.get(..self.len).unwrap_or_default()
    }

    /// The tracks, to be moved.
    pub fn tracks_mut(&mut self) -> &mut [Track] {
        self.tracks.get_mut(..self.len).unwrap_or_default()
    }

    /// Starts a track at `pixel` under a new name. `None` when the table is full or, after 2³² tracks, out of names.
    pub fn start(&mut self, pixel: [f32; 2]) -> Option<TrackId> {
        let following = self.next_id.checked_add(1)?;
        let slot = self.tracks.get_mut(self.len)?;
        let id = TrackId(self.next_id);
        *slot = Track { id, pixel, previous: pixel, age: 0 };
        self.next_id = following;
        self.len += 1;
        Some(id)
    }

    /// Keeps the tracks for which `keep`, called once each in order, is true.
    pub fn retain(&mut self, mut keep: impl FnMut(&mut Track) -> bool) {
        let mut kept = 0;
        for index in 0..self.len {
            let Some(mut track) = self.tracks.get(index).copied() else { break };
            if keep(&mut track)
                && let Some(place) = self.tracks.get_mut(kept)
            {
                *place = track;
                kept += 1;
            }
        }
        self.len = kept;
    }

    /// Ends all tracks; their names stay used.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// What the estimator reads.
    pub fn observations<T: Real>(&self) -> impl ExactSizeIterator<Item = Observation<T>> + Clone + '_ {
        self.tracks().iter().map(|track| Observation {
            track: track.id,
            pixel: Vector2::new(T::of(f64::from(track.pixel[0])), T::of(f64::from(track.pixel[1]))),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::vec::Vec;

    #[test]
    fn names_are_never_used_twice() {
        let mut table = TrackTable::<5>::new();
        let mut seen = BTreeSet::new();
        for round in 0..50_u32 {
            while let Some(id) = table.start([round as f32, 0.0]) {
                assert!(seen.insert(id));
            }
            assert_eq!(table.tracks().len(), 5);
            if round % 7 == 0 { table.clear() } else { table.retain(|track| (track.id.0 + round) % 3 == 0) }
        }
        assert!(seen.len() > 100);
    }

    #[test]
    fn retaining_keeps_order() {
        let mut table = TrackTable::<8>::new();
        for k in 0..8 {
            table.start([k as f32, 0.0]);
        }
        table.retain(|track| track.id.0 % 2 == 1);
        let ids: Vec<u32> = table.observations::<f64>().map(|o| o.track.0).collect();
        assert_eq!(ids, [1, 3, 5, 7]);
    }
}
