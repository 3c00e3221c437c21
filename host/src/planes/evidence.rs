//! What is known of surfaces at one time.

use libella_core::plane::{Plane, Polygon};
use libella_core::time::{Span, Timestamp};

use super::depth_points::DepthPoints;
use super::finder::CORNERS;
use super::points::MapPoints;
use super::sight::{Sight, is_opaque};

/// What was seen longer ago takes no part in a search: a wall has to be a share of what was just in view, not of the whole flight.
pub(super) const MEMORY: Span = Span::from_millis(15_000);
/// What was seen since then tells where surfaces are now.
pub(super) const LATELY: Span = Span::from_millis(4_000);
/// Points that are sought among at most.
pub(super) const SAMPLES: usize = 5_000;
/// What must lie on a plane, in units of what a search asks for, before not finding it speaks against it.
const PLENTY: f64 = 2.0;
/// Where a point may be outside of the polygon of its plane, m.
pub(super) const MARGIN_M: f64 = 0.1;

/// What a search is given: points of the map, the newest first, then those of depth maps.
#[derive(Debug, Clone, Default)]
pub(super) struct Evidence {
    pub sights: Vec<Sight>,
}

impl Evidence {
    /// That of the last `memory`.
    pub fn gather(points: &MapPoints, depth: &DepthPoints, now: Timestamp, memory: Span, theta_m: f64) -> Self {
        Self { sights: points.recent(now, memory).rev().chain(depth.recent(now, memory, theta_m)).collect() }
    }

    /// The same points, of which nobody knows which way their surface faces.
    pub fn without_normals(mut self) -> Self {
        for sight in &mut self.sights {
            sight.sample.normal_in_world = None;
        }
        self
    }

    /// What planes are sought among.
    pub fn sought(&self) -> impl Iterator<Item = &Sight> {
        self.sights.iter().filter(|sight| sight.is_sought).take(SAMPLES)
    }

    /// Whether a plane that a search did not find has become doubtful: there was plenty on it, or it was seen through.
    pub fn doubts(&self, plane: &Plane<f64>, polygon: &Polygon<f64, CORNERS>, theta_m: f64, least_share: f64) -> bool {
        self.share_on(plane, polygon, theta_m) > PLENTY * least_share || !is_opaque(plane, polygon, &self.sights, theta_m)
    }

    /// The share of all that is sought among, by weight, that lies on a plane.
    pub fn share_on(&self, plane: &Plane<f64>, polygon: &Polygon<f64, CORNERS>, theta_m: f64) -> f64 {
        let is_on = |sight: &&Sight| {
            let point = &sight.sample.point_in_world;
            plane.distance_m(point).abs() < theta_m && polygon.contains(plane.project(point), MARGIN_M)
        };
        let all: f64 = self.sought().map(Sight::weight).sum();
        self.sought().filter(is_on).map(Sight::weight).sum::<f64>() / all.max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use libella_core::plane::{Sample, Source};
    use nalgebra::Vector3;

    use super::super::weighted::tests::wall_at;
    use super::*;

    /// Points of the walls `x = 2` and `x = 4`, seen from the origin.
    fn walls(near: usize, far: usize) -> Evidence {
        let point = |k: usize| {
            let x = if k < near { 2.0 } else { 4.0 };
            let point_in_world = Vector3::new(x, 0.1, 0.2) + Vector3::new(0.0, 0.001, 0.0) * k as f64;
            let sample = Sample { point_in_world, normal_in_world: Some(-Vector3::x()), source: Source::MapPoint };
            Sight { sample, from: Vector3::new(0.0, 0.0, 0.2), sigma_log: 0.01, is_sought: k.is_multiple_of(2) }
        };
        Evidence { sights: (0..near + far).map(point).collect() }
    }

    #[test]
    fn a_share_is_of_what_is_sought_among() {
        let (wall, evidence) = (wall_at(2.0, 0.0), walls(20, 180));
        assert_eq!(evidence.sought().count(), 100);
        assert!((evidence.share_on(&wall.fit.plane, &wall.polygon, 0.05) - 0.1).abs() < 1e-12);
        assert!(evidence.without_normals().sought().all(|sight| sight.sample.normal_in_world.is_none()));
    }

    #[test]
    fn plenty_on_a_plane_and_sights_through_it_are_doubts() {
        let wall = wall_at(2.0, 0.0);
        let doubts = |evidence: &Evidence, least_share| evidence.doubts(&wall.fit.plane, &wall.polygon, 0.05, least_share);
        assert!(doubts(&walls(100, 10), 0.3), "a search ought to have found it");
        assert!(!doubts(&walls(100, 10), 0.5) && !doubts(&Evidence::default(), 0.1), "nobody can have found it");
        assert!(doubts(&walls(10, 100), 0.5), "it was seen through");
    }
}
