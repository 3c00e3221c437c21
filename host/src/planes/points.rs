//! Where landmarks were when they were last seen.

use std::collections::BTreeMap;

use libella_core::time::{Span, Timestamp};
use libella_core::track::TrackId;
use nalgebra::Vector3;

/// Images that a point must have been estimated in: half a second at 20 Hz. What is followed for less is mostly wrong.
const LEAST_LOOKS: u32 = 10;
/// Points that are kept at most; the oldest go first.
const MOST: usize = 20_000;

/// A point of the map.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MapPoint {
    point_in_world: Vector3<f64>,
    last_seen: Timestamp,
    looks: u32,
}

/// The latest estimate of every landmark, those that have left the window included.
#[derive(Debug, Clone, Default)]
pub struct MapPoints {
    points: BTreeMap<TrackId, MapPoint>,
}

impl MapPoints {
    /// Takes in where a landmark is, m.
    pub fn note(&mut self, track: TrackId, point_in_world: Vector3<f64>, stamp: Timestamp) {
        if !point_in_world.iter().all(|value| value.is_finite()) {
            return;
        }
        let point = self.points.entry(track).or_insert(MapPoint { point_in_world, last_seen: stamp, looks: 0 });
        *point = MapPoint { point_in_world, last_seen: stamp, looks: point.looks + 1 };
        while self.points.len() > MOST {
            self.points.pop_first();
        }
    }

    /// Forgets all of them.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// Those of [`Self::usable`] that were seen not longer than `memory` ago.
    pub fn recent(&self, now: Timestamp, memory: Span) -> impl DoubleEndedIterator<Item = Vector3<f64>> {
        let is_recent = move |point: &&MapPoint| point.looks >= LEAST_LOOKS && now - point.last_seen <= memory;
        self.points.values().filter(is_recent).map(|point| point.point_in_world)
    }

    /// Points that were looked at often enough, by the name of their track.
    pub fn usable(&self) -> impl DoubleEndedIterator<Item = (TrackId, Vector3<f64>)> {
        self.points.iter().filter(|(_, point)| point.looks >= LEAST_LOOKS).map(|(track, point)| (*track, point.point_in_world))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_counts_once_it_was_followed_and_moves_with_its_estimate() {
        let mut points = MapPoints::default();
        for look in 0..LEAST_LOOKS {
            assert_eq!(points.usable().count(), 0, "after {look} looks");
            points.note(TrackId(7), Vector3::new(f64::from(look), 0.0, 0.0), Timestamp::from_nanos(i64::from(look)));
        }
        let last = f64::from(LEAST_LOOKS - 1);
        assert_eq!(points.usable().collect::<Vec<_>>(), [(TrackId(7), Vector3::new(last, 0.0, 0.0))]);
        points.note(TrackId(7), Vector3::new(f64::NAN, 0.0, 0.0), Timestamp::from_nanos(99));
        assert_eq!(points.usable().count(), 1, "what is no number is left out");
    }

    #[test]
    fn memory_is_bounded() {
        let mut points = MapPoints::default();
        for track in 0..MOST as u32 + 50 {
            for _ in 0..LEAST_LOOKS {
                points.note(TrackId(track), Vector3::zeros(), Timestamp::from_nanos(0));
            }
        }
        assert_eq!(points.usable().count(), MOST);
        assert_eq!(points.usable().next().map(|(track, _)| track), Some(TrackId(50)), "the oldest have gone");
    }
}
