//! Where landmarks were when they were last seen, and which way their surfaces face.
//!
//! # Model
//! The depth of a point comes from the angle `α` between the directions from which it was seen, each good to a pixel or so:
//! ```text
//! σ(ln depth)² = 0.03² + (√2 σ_bearing / sin α)²
//! ```
//! so that what lies far away, or was flown towards, proves little about what is before it.

use std::collections::BTreeMap;

use libella_core::depth::NormalAverage;
use libella_core::plane::{Sample, Source};
use libella_core::time::{Span, Timestamp};
use libella_core::track::TrackId;
use nalgebra::Vector3;

use super::depth_look::DepthLook;
use super::sight::Sight;

/// Images that a point must have been estimated in: half a second at 20 Hz. What is followed for less is mostly wrong.
const LEAST_LOOKS: u32 = 10;
/// Points that are kept at most; the oldest go first.
const MOST: usize = 20_000;
/// Standard deviations by which a depth map may miss a landmark and still show the surface that it lies on.
const GATE_SIGMA: f64 = 3.0;
/// What the landmark's own depth may be off whatever the angle that it was seen under, of the logarithm: the scale of the map, mostly.
const POINT_SIGMA_LOG: f64 = 0.03;
/// A landmark whose depth is less sure than this cannot tell whether a map shows its surface or another one.
const SURE_SIGMA_LOG: f64 = 0.1;
/// Of the direction in which a point is seen: a pixel of a camera with 450 pixels of focal length, rad.
const BEARING_SIGMA_RAD: f64 = 1.0 / 450.0;

/// A point of the map.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MapPoint {
    point_in_world: Vector3<f64>,
    /// Where it was seen from when its depth became known, m.
    seen_from: Vector3<f64>,
    /// The sine of the widest angle between that direction and a later one.
    parallax: f64,
    last_seen: Timestamp,
    looks: u32,
    normal: Option<NormalAverage<f64>>,
}

impl MapPoint {
    /// Standard deviation of the logarithm of its depth.
    fn sigma_log(&self) -> f64 {
        POINT_SIGMA_LOG.hypot(core::f64::consts::SQRT_2 * BEARING_SIGMA_RAD / self.parallax.max(1e-3))
    }
}

/// The latest estimate of every landmark, those that have left the window included.
#[derive(Debug, Clone, Default)]
pub struct MapPoints {
    points: BTreeMap<TrackId, MapPoint>,
}

impl MapPoints {
    /// Takes in where a landmark is, and where it is seen from, m.
    pub fn note(&mut self, track: TrackId, point_in_world: Vector3<f64>, viewer_in_world: &Vector3<f64>, stamp: Timestamp) {
        if !point_in_world.iter().all(|value| value.is_finite()) {
            return;
        }
        let new = MapPoint { point_in_world, seen_from: *viewer_in_world, parallax: 0.0, last_seen: stamp, looks: 0, normal: None };
        let point = self.points.entry(track).or_insert(new);
        let (first, now) = (point_in_world - point.seen_from, point_in_world - viewer_in_world);
        // f64::max leaves out what is no number: a point where the camera is.
        let parallax = (first.cross(&now).norm() / (first.norm() * now.norm())).max(point.parallax);
        *point = MapPoint { point_in_world, parallax, last_seen: stamp, looks: point.looks + 1, ..*point };
        while self.points.len() > MOST {
            self.points.pop_first();
        }
    }

    /// Takes in which way the surfaces of the landmarks of `stamp` face, where a depth map of that image shows them.
    pub fn note_normals(&mut self, look: &DepthLook<'_>, stamp: Timestamp) {
        let center = look.center_in_world();
        for point in self.points.values_mut().filter(|point| point.last_seen == stamp) {
            let sigma_log = point.sigma_log();
            if sigma_log > SURE_SIGMA_LOG {
                continue;
            }
            let Some((reading, depth_m)) = look.towards(&point.point_in_world) else { continue };
            // Behind an edge, or a depth that is wrong: another surface.
            if (reading.depth_m / depth_m).ln().abs() > GATE_SIGMA * reading.sigma_log.hypot(sigma_log) {
                continue;
            }
            let Some(normal_in_world) = look.sure_normal(&reading) else { continue };
            let distance_m = (point.point_in_world - center).norm();
            point.normal = Some(match point.normal {
                None => NormalAverage { normal_in_world, distance_m },
                Some(known) => known.seen(&normal_in_world, distance_m),
            });
        }
    }

    /// Forgets all of them.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// Those of [`Self::usable`] that were seen not longer than `memory` ago.
    pub fn recent(&self, now: Timestamp, memory: Span) -> impl DoubleEndedIterator<Item = Sight> {
        let is_recent = move |point: &&MapPoint| point.looks >= LEAST_LOOKS && now - point.last_seen <= memory;
        self.points.values().filter(is_recent).map(|point| Sight {
            sample: Sample {
                point_in_world: point.point_in_world,
                normal_in_world: point.normal.map(|normal| normal.normal_in_world),
                source: Source::MapPoint,
            },
            from: point.seen_from,
            sigma_log: point.sigma_log(),
            is_sought: true,
        })
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
            points.note(TrackId(7), Vector3::new(f64::from(look), 0.0, 0.0), &Vector3::zeros(), Timestamp::from_nanos(i64::from(look)));
        }
        let last = f64::from(LEAST_LOOKS - 1);
        assert_eq!(points.usable().collect::<Vec<_>>(), [(TrackId(7), Vector3::new(last, 0.0, 0.0))]);
        points.note(TrackId(7), Vector3::new(f64::NAN, 0.0, 0.0), &Vector3::zeros(), Timestamp::from_nanos(99));
        assert_eq!(points.usable().count(), 1, "what is no number is left out");
    }

    #[test]
    fn a_wide_angle_makes_a_point_sure_and_coming_nearer_does_not() {
        let sigma_log = |viewers: [[f64; 3]; 2]| {
            let mut points = MapPoints::default();
            for look in 0..LEAST_LOOKS {
                let viewer = Vector3::from(viewers[look as usize % 2]);
                points.note(TrackId(1), Vector3::new(0.0, 0.0, 4.0), &viewer, Timestamp::from_nanos(0));
            }
            points.recent(Timestamp::from_nanos(0), Span::from_millis(0)).next().map_or(f64::NAN, |sight| sight.sigma_log)
        };
        // At right angles each direction gives the other's depth: two bearings, each with its sigma.
        let across = sigma_log([[0.0; 3], [4.0, 0.0, 4.0]]);
        assert!((across - POINT_SIGMA_LOG.hypot(core::f64::consts::SQRT_2 * BEARING_SIGMA_RAD)).abs() < 1e-12);
        let [wide, narrow, ahead] = [[0.8, 0.0, 0.0], [0.08, 0.0, 0.0], [0.0, 0.0, 2.0]].map(|to| sigma_log([[0.0; 3], to]));
        assert!(across < wide && wide < 0.04 && (0.14..0.17).contains(&narrow) && ahead > 1.0, "{wide} {narrow} {ahead}");
    }

    #[test]
    fn memory_is_bounded() {
        let mut points = MapPoints::default();
        for track in 0..MOST as u32 + 50 {
            for _ in 0..LEAST_LOOKS {
                points.note(TrackId(track), Vector3::zeros(), &Vector3::zeros(), Timestamp::from_nanos(0));
            }
        }
        assert_eq!(points.usable().count(), MOST);
        assert_eq!(points.usable().next().map(|(track, _)| track), Some(TrackId(50)), "the oldest have gone");
    }

    #[test]
    fn a_depth_map_tells_which_way_surfaces_face_where_it_agrees() {
        use super::super::depth_look::tests::at_wall;
        let mut points = MapPoints::default();
        let (on, before) = (Vector3::new(2.0, 0.1, 1.0), Vector3::new(1.0, -0.1, 1.0));
        let stamp = Timestamp::from_nanos(0);
        for look in 0..LEAST_LOOKS {
            let viewer = Vector3::new(0.0, 0.1 * f64::from(look), 1.0);
            points.note(TrackId(1), on, &viewer, stamp);
            points.note(TrackId(2), before, &viewer, stamp);
            points.note(TrackId(3), on, &Vector3::z(), stamp);
        }
        at_wall(2.0, [0.0, 0.0, 1.0], 0.02, |look| points.note_normals(look, stamp));
        let normals: Vec<_> = points.recent(stamp, Span::from_millis(0)).map(|sight| sight.sample.normal_in_world).collect();
        assert!(normals[0].is_some_and(|normal| (normal + Vector3::x()).norm() < 1e-5));
        assert_eq!(normals[1], None, "the map shows the wall behind it");
        assert_eq!(normals[2], None, "seen from one place: where it is nobody knows");
    }
}
