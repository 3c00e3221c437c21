//! One surface, one plane: what is found a little way before or behind a plane is that plane, or too close to it to be told apart.
//!
//! # Model
//! An estimator's first seconds have a scale that is some percent off, and its position drifts: after a while a wall is found 10 or 20 cm from where it was. Of two planes that
//! are nearly parallel, overlap, and are nearer than [`NEAR_M`], a camera sees one only, and the older one keeps its name. Where the younger holds more than twice
//! what the older does, of all that was seen lately, the old one has drifted: it is moved to the place of the younger,
//! ```text
//! δ = nᵀy + d        d ← d − δ        y the middle of the younger
//! ```
//! once that has been found half as often, or for 9 s: a bad stretch of flight passes, and an old plane is worth more. Otherwise the younger is a board or a
//! curtain before a wall that is seen beside it. It is no more in either case.

use libella_core::plane::{PlaneId, PlaneMap, Polygon, TrackedPlane};

use super::evidence::Evidence;
use super::finder::{CORNERS, PLANES};

/// Nearer than this, m, two parallel surfaces are one or are not told apart.
const NEAR_M: f64 = 0.2;
/// Searches, 1.5 s apart at 20 Hz, after which a surface that is found in a new place is there.
const SURELY: u16 = 6;
/// What their normals may differ, rad: 5°.
const MOST_TURN_RAD: f64 = 0.087;

/// Two planes that are one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Double {
    pub older: PlaneId,
    pub younger: PlaneId,
    /// What is added to the older one's `d`, m.
    pub shift_m: f64,
}

/// The first pair of planes that are one, judged by what was seen lately.
pub(super) fn double(map: &PlaneMap<f64, PLANES, CORNERS>, lately: &Evidence, theta_m: f64) -> Option<Double> {
    let mut planes: Vec<_> = map.iter().collect();
    // Names before no names, then by age; the sort is stable.
    planes.sort_by_key(|(_, plane)| (!plane.is_steady, plane.first_seen));
    let pairs = planes.iter().enumerate().flat_map(|(k, older)| planes.iter().skip(k + 1).map(move |younger| (older, younger)));
    pairs.into_iter().find_map(|((older, old), (younger, young))| {
        let off_m = gap_m(old, young)?;
        let on = |plane: &TrackedPlane<f64, CORNERS>| lately.share_on(&plane.plane, &plane.polygon, theta_m);
        let has_drifted = on(young) > 2.0 * on(old);
        if has_drifted && young.hits < (old.hits / 2).min(SURELY) {
            return None;
        }
        Some(Double { older: *older, younger: *younger, shift_m: if has_drifted { -off_m } else { 0.0 } })
    })
}

/// How far the younger plane is before the older one, where they may be one.
fn gap_m(old: &TrackedPlane<f64, CORNERS>, young: &TrackedPlane<f64, CORNERS>) -> Option<f64> {
    if old.orientation != young.orientation || old.plane.angle_rad(&young.plane) > MOST_TURN_RAD {
        return None;
    }
    let off_m = old.plane.distance_m(&young.plane.lift(young.polygon.middle()?));
    let corners = young.polygon.corners().iter().map(|corner| old.plane.project(&young.plane.lift(*corner)));
    (off_m.abs() < NEAR_M && old.polygon.overlaps(&Polygon::<f64, CORNERS>::of(corners), 0.0)).then_some(off_m)
}

#[cfg(test)]
mod tests {
    use libella_core::plane::associate::AssociateConfig;
    use libella_core::plane::{Detection, Sample, Source};
    use libella_core::time::Timestamp;
    use nalgebra::Vector3;

    use super::super::sight::Sight;
    use super::super::weighted::tests::wall_at;
    use super::*;

    type Map = PlaneMap<f64, PLANES, CORNERS>;

    /// A wall at 2 m that was found `old` times, and then one at `other` m, `young` times.
    fn map(old: u64, other: Detection<f64, CORNERS>, young: u64) -> Map {
        let mut map = Map::new();
        for look in 0..old + young {
            let found = if look < old { wall_at(2.0, 0.0) } else { other };
            let stamp = Timestamp::from_nanos(look as i64);
            map.update(&[found], stamp, &Vector3::zeros(), &AssociateConfig::default(), |_| false, |_| ());
        }
        map
    }

    /// Points of walls at these places.
    fn evidence(at_m: &[f64]) -> Evidence {
        let sights = at_m.iter().flat_map(|x| {
            (0..100).map(|k| Sight {
                sample: Sample {
                    point_in_world: Vector3::new(*x, f64::from(k % 10) * 0.2 - 0.9, f64::from(k / 10) * 0.2),
                    normal_in_world: None,
                    source: Source::MapPoint,
                },
                from: Vector3::z(),
                sigma_log: 0.01,
                is_sought: true,
            })
        });
        Evidence { sights: sights.collect() }
    }

    fn place_m(map: &Map, id: PlaneId) -> f64 {
        map.get(id).map_or(f64::NAN, |plane| -plane.plane.offset_m * plane.plane.normal_in_world.x)
    }

    #[test]
    fn a_wall_that_has_drifted_is_moved_under_its_name() {
        let mut map = map(20, wall_at(2.15, 0.0), 6);
        let double = double(&map, &evidence(&[2.15]), 0.05);
        let Some(Double { older, younger, shift_m }) = double else { unreachable!("no double") };
        assert!((place_m(&map, older) - 2.0).abs() < 1e-9 && (place_m(&map, younger) - 2.15).abs() < 1e-9);
        map.shift(older, shift_m);
        assert!((place_m(&map, older) - 2.15).abs() < 1e-9);
    }

    #[test]
    fn a_short_while_moves_nothing_and_a_board_before_a_wall_is_the_wall() {
        assert_eq!(double(&map(20, wall_at(2.15, 0.0), 5), &evidence(&[2.15]), 0.05), None);
        let board = double(&map(20, wall_at(1.85, 0.0), 5), &evidence(&[2.0, 1.85]), 0.05);
        assert_eq!(board.map(|double| double.shift_m), Some(0.0));
    }

    #[test]
    fn others_are_others() {
        let all = evidence(&[2.0, 2.15, 2.3]);
        assert_eq!(double(&map(20, wall_at(2.3, 0.0), 6), &all, 0.05), None, "30 cm behind");
        assert_eq!(double(&map(20, wall_at(2.15, 3.0), 6), &all, 0.05), None, "beside it");
        assert_eq!(double(&map(20, wall_at(2.15, 0.0), 0), &all, 0.05), None, "alone");
    }
}
