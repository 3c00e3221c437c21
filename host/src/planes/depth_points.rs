//! Points of depth maps, averaged over the views that see them.
//!
//! # Model
//! Every [`ANCHOR_EVERY`] a map becomes an *anchor*: a coarse grid of points `x = c + r d`, each known by `ln d` with variance `V` and by the normal
//! of the surface there. A later map that sees the point says `d'` along its own axis where the point has `z'`; near the anchor's ray, `z' = a d + b`:
//! ```text
//! e = ln d' − ln z'        S = V + σ'²        e² > 9 S: it disagrees
//! ln d ← ln d + K e z'/(a d)        K = V/(V + m σ'²)        V ← (1 − K) V, not below V₀/N
//! ```
//! Errors of one network in one room are alike: a view counts as the `m`-th of one, and [`MOST_VIEWS`] `N` are all that ever count. A point that is contradicted as
//! often as it is confirmed is left out; so is one whose distance from its plane is not known to `θ`: with few sure depths a source finds no plane by itself.
//!
//! # Bounds
//! [`ANCHORS`] anchors of [`GRID`] points; each map is compared with each of them once.

use std::collections::VecDeque;

use libella_core::plane::{Sample, Source};
use libella_core::time::{Span, Timestamp};
use nalgebra::Vector3;

use super::depth_look::DepthLook;
use super::sight::Sight;

/// Time from one anchor to the next.
const ANCHOR_EVERY: Span = Span::from_millis(750);
/// Anchors that are kept: those of 15 s.
const ANCHORS: usize = 20;
/// Columns and rows of an anchor's grid.
const GRID: [usize; 2] = [16, 11];
/// How many views of a place are worth one that is independent of the others.
const VIEWS_ALIKE: f64 = 4.0;
/// Independent views that count at most.
const MOST_VIEWS: f64 = 4.0;
/// Squared standard deviations beyond which a view contradicts.
const GATE: f64 = 9.0;
/// Share of a point's motion along its ray that another view must see as depth.
const LEAST_LEVER: f64 = 0.3;

/// A point of a depth map.
#[derive(Debug, Clone, Copy, PartialEq)]
struct DepthPoint {
    point_in_world: Vector3<f64>,
    /// Where the depths are good enough for one.
    normal_in_world: Option<Vector3<f64>>,
    /// Variance of `ln d`, and what it was at first.
    variance: f64,
    first_variance: f64,
    uncertainty: f64,
    confirmed: u16,
    contradicted: u16,
}

/// A map that points were taken from.
#[derive(Debug, Clone)]
struct Anchor {
    stamp: Timestamp,
    center_in_world: Vector3<f64>,
    points: Vec<DepthPoint>,
}

/// The points of the last depth maps.
#[derive(Debug, Clone, Default)]
pub struct DepthPoints {
    anchors: VecDeque<Anchor>,
}

impl DepthPoints {
    /// Takes a map in.
    pub fn note(&mut self, look: &DepthLook<'_>, stamp: Timestamp) {
        for anchor in &mut self.anchors {
            let center = anchor.center_in_world;
            for point in &mut anchor.points {
                point.compare(&center, look);
            }
        }
        if self.anchors.back().is_none_or(|last| stamp - last.stamp >= ANCHOR_EVERY) {
            if self.anchors.len() == ANCHORS {
                self.anchors.pop_front();
            }
            self.anchors.push_back(Anchor { stamp, center_in_world: look.center_in_world(), points: grid(look) });
        }
    }

    /// Whether there was no map yet.
    pub fn is_empty(&self) -> bool {
        self.anchors.is_empty()
    }

    /// Forgets all of them.
    pub fn clear(&mut self) {
        self.anchors.clear();
    }

    /// The points of the last `memory` that other views agree with, newest first. Planes are sought among those that have a normal and are known to `theta_m` from the
    /// plane through them.
    pub fn recent(&self, now: Timestamp, memory: Span, theta_m: f64) -> impl Iterator<Item = Sight> {
        let recent = self.anchors.iter().rev().filter(move |anchor| now - anchor.stamp <= memory);
        recent.flat_map(move |anchor| {
            let points = anchor.points.iter().filter(|point| point.contradicted == 0 || point.contradicted < point.confirmed);
            points.map(move |point| point.sight(&anchor.center_in_world, theta_m))
        })
    }
}

/// The grid of points of a map.
fn grid(look: &DepthLook<'_>) -> Vec<DepthPoint> {
    let (width, height) = look.map.size();
    let mut points = Vec::with_capacity(GRID[0] * GRID[1]);
    for row in 0..GRID[1] {
        for column in 0..GRID[0] {
            // The middle of each cell.
            let (i, j) = ((2 * column + 1) * width / (2 * GRID[0]), (2 * row + 1) * height / (2 * GRID[1]));
            let Some(reading) = look.value(i, j) else { continue };
            let normal_in_world = if reading.tells_normals() { look.normal(i, j) } else { None };
            let variance = reading.sigma_log * reading.sigma_log;
            points.push(DepthPoint {
                point_in_world: reading.point_in_world,
                normal_in_world,
                variance,
                first_variance: variance,
                uncertainty: reading.uncertainty,
                confirmed: 0,
                contradicted: 0,
            });
        }
    }
    points
}

impl DepthPoint {
    /// Asks another view.
    fn compare(&mut self, center_in_world: &Vector3<f64>, look: &DepthLook<'_>) {
        let Some((reading, expected_m)) = look.towards(&self.point_in_world) else { return };
        let way = self.point_in_world - center_in_world;
        // How much of a motion along the anchor's ray the other camera sees as depth: a d / z'.
        let lever = look.world_from_camera.rotation.inverse_transform_vector(&way).z / expected_m;
        if lever < LEAST_LEVER {
            return;
        }
        let error = (reading.depth_m / expected_m).ln();
        let theirs = reading.sigma_log * reading.sigma_log;
        if error * error > GATE * (self.variance + theirs) {
            self.contradicted = self.contradicted.saturating_add(1);
            return;
        }
        self.confirmed = self.confirmed.saturating_add(1);
        let gain = self.variance / (self.variance + VIEWS_ALIKE * theirs);
        self.point_in_world = center_in_world + way * (gain * error / lever).exp();
        self.variance = ((1.0 - gain) * self.variance).max(self.first_variance / MOST_VIEWS);
    }

    fn sight(&self, center_in_world: &Vector3<f64>, theta_m: f64) -> Sight {
        let squared_theta = theta_m * theta_m;
        let distance_m = self.normal_in_world.map(|normal| normal.dot(&(self.point_in_world - center_in_world)));
        let variance_m2 = distance_m.map_or(f64::INFINITY, |distance_m| distance_m * distance_m * self.variance);
        // What is less sure is drawn less often.
        let sure = (1.0 - self.uncertainty) * squared_theta / (squared_theta + variance_m2);
        Sight {
            sample: Sample {
                point_in_world: self.point_in_world,
                normal_in_world: self.normal_in_world,
                source: Source::Depth { uncertainty: 1.0 - sure },
            },
            from: *center_in_world,
            sigma_log: self.variance.sqrt(),
            is_sought: variance_m2 <= squared_theta,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::depth_look::tests::at_wall;
    use super::*;

    fn at(milliseconds: i64) -> Timestamp {
        Timestamp::from_nanos(milliseconds * 1_000_000)
    }

    /// A first look at a wall that seems 4 % too far, and others at where it is, from the side.
    fn seen(looks: i64) -> DepthPoints {
        let mut points = DepthPoints::default();
        at_wall(2.08, [0.0, 0.0, 1.0], 0.04, |look| points.note(look, at(0)));
        for k in 1..=looks {
            at_wall(2.0, [0.0, 0.01 * k as f64, 1.0], 0.04, |look| points.note(look, at(10 * k)));
        }
        points
    }

    fn of(points: &DepthPoints) -> Vec<Sight> {
        points.recent(at(1000), Span::from_millis(2000), 0.05).collect()
    }

    #[test]
    fn views_that_agree_bring_a_point_to_its_place_and_make_it_surer() {
        let (first, then) = (of(&seen(0)), of(&seen(40)));
        assert_eq!((first.len(), then.len()), (GRID[0] * GRID[1], GRID[0] * GRID[1]));
        // Most are still in view of the others.
        let is_there = |sight: &&Sight| (sight.sample.point_in_world.x - 2.0).abs() < 0.02;
        assert_eq!(first.iter().filter(is_there).count(), 0);
        assert!(then.iter().filter(is_there).count() > 140, "{}", then.iter().filter(is_there).count());
        let least = then.iter().map(|sight| sight.sigma_log).fold(f64::INFINITY, f64::min);
        assert!((least - 0.04 / MOST_VIEWS.sqrt()).abs() < 1e-6, "{least}: views of one source are not independent");
    }

    #[test]
    fn what_is_not_known_to_theta_is_not_sought_until_others_have_looked() {
        // 4 % of 2.08 m are 8.3 cm; half of it is 4.2 cm.
        assert!(of(&seen(0)).iter().all(|sight| !sight.is_sought && sight.sample.normal_in_world.is_none_or(|n| n.x < -0.99)));
        assert!(of(&seen(40)).iter().filter(|sight| sight.is_sought).count() > 100);
    }

    #[test]
    fn what_others_see_through_is_left_out_until_more_confirm_it() {
        let mut points = seen(2);
        for k in 3..=5 {
            at_wall(4.0, [0.0, 0.0, 1.0], 0.04, |look| points.note(look, at(10 * k)));
        }
        assert_eq!(of(&points).len(), 0, "two views for it, three against");
        for k in 6..=8 {
            at_wall(2.0, [0.0, 0.0, 1.0], 0.04, |look| points.note(look, at(10 * k)));
        }
        assert!(of(&points).len() > 140);
    }

    #[test]
    fn anchors_are_few_and_pass() {
        let mut points = DepthPoints::default();
        for k in 0..200 {
            at_wall(2.0, [0.0, 0.0, 1.0], 0.01, |look| points.note(look, at(250 * k)));
        }
        assert_eq!(points.anchors.len(), ANCHORS);
        assert_eq!(points.recent(at(250 * 199), Span::from_millis(0), 0.05).count(), 0, "the newest map is 0.25 s younger than its anchor");
        points.clear();
        assert_eq!(of(&points).len(), 0);
    }
}
