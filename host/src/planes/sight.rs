//! What was seen through a plane is proof that it is none.
//!
//! # Model
//! A camera at `c` that saw a point `x` looked through everything between them. With the signed distances `a` and `b` of `c` and `x` from a plane, the
//! sight meets it at
//! ```text
//! y = c + (x − c) a/(a − b)        through ⇔ a b < 0, y within the polygon, |b| > max(2 θ, 3 σ |a − b|)
//!                                  on      ⇔ y within the polygon, |b| ≤ max(θ, 2 σ |a − b|)
//! ```
//! `σ` of the logarithm of the distance of `x` from `c`: a poor depth map sees through little and proves little. A plane that more than a quarter
//! of the sights through its polygon pierce is a cut through clutter, along stairs, or across an open door.
//!
//! # Degeneracy
//! A hull is convex: an L-shaped floor would be seen through in its corner, but there is seldom anything below a floor or behind a wall.

use libella_core::plane::{Plane, Polygon, Sample};
use nalgebra::Vector3;

use super::finder::CORNERS;

/// Share of the sights that meet a polygon which may go through it.
const MOST_THROUGH: f64 = 0.25;
/// The rim of a polygon says little: what is behind an edge is seen past it, m.
const RIM_M: f64 = 0.05;

/// A point of a surface and where it was seen from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// The point, with its normal if that is sure, and its source.
    pub sample: Sample<f64>,
    /// The camera, in world, m.
    pub from: Vector3<f64>,
    /// Standard deviation of the logarithm of the distance between them.
    pub sigma_log: f64,
    /// Whether planes are sought among such points, or they only tell what is no plane.
    pub is_sought: bool,
}

/// Where a sight ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Through,
    On,
    Elsewhere,
}

impl Sight {
    /// What the point counts beside others: a point of a depth map half.
    #[must_use]
    pub fn weight(&self) -> f64 {
        self.sample.source.weight()
    }

    /// Standard deviation of the distance of the point from a plane through it, m.
    #[must_use]
    pub fn sigma_m(&self, normal_in_world: &Vector3<f64>) -> f64 {
        self.sigma_log * normal_in_world.dot(&(self.sample.point_in_world - self.from)).abs()
    }

    fn end(&self, plane: &Plane<f64>, polygon: &Polygon<f64, CORNERS>, theta_m: f64) -> End {
        let to = self.sample.point_in_world;
        let (a, b) = (plane.distance_m(&self.from), plane.distance_m(&to));
        let sigma_m = self.sigma_log * (a - b).abs();
        let is_behind = a * b < 0.0 && b.abs() > (2.0 * theta_m).max(3.0 * sigma_m);
        let is_near = b.abs() <= theta_m.max(2.0 * sigma_m);
        // A sight along the plane meets it nowhere.
        if !(is_behind || is_near) || (a - b).abs() < theta_m {
            return End::Elsewhere;
        }
        let crossing = self.from + (to - self.from) * (a / (a - b));
        if !polygon.contains(plane.project(&crossing), -RIM_M) {
            End::Elsewhere
        } else if is_behind {
            End::Through
        } else {
            End::On
        }
    }
}

/// Whether a plane hides what is behind it, as far as anybody has looked.
#[must_use]
pub fn is_opaque(plane: &Plane<f64>, polygon: &Polygon<f64, CORNERS>, sights: &[Sight], theta_m: f64) -> bool {
    let (mut through, mut on) = (0.0, 0.0);
    for sight in sights {
        match sight.end(plane, polygon, theta_m) {
            End::Through => through += sight.weight(),
            End::On => on += sight.weight(),
            End::Elsewhere => {}
        }
    }
    through <= MOST_THROUGH * (through + on)
}

#[cfg(test)]
mod tests {
    use libella_core::plane::Source;

    use super::*;

    /// The wall `x = 2`, 2 m wide and high.
    fn wall() -> (Plane<f64>, Polygon<f64, CORNERS>) {
        let plane = Plane { normal_in_world: Vector3::x_axis(), offset_m: -2.0 };
        let corners = [[-1.0, 0.0], [1.0, 0.0], [1.0, 2.0], [-1.0, 2.0]].map(|[y, z]| plane.project(&Vector3::new(2.0, y, z)));
        (plane, Polygon::of(corners))
    }

    fn sight(to: [f64; 3], sigma_log: f64) -> Sight {
        let sample = Sample { point_in_world: Vector3::from(to), normal_in_world: None, source: Source::MapPoint };
        Sight { sample, from: Vector3::new(0.0, 0.0, 1.0), sigma_log, is_sought: true }
    }

    #[test]
    fn a_sight_ends_on_a_wall_behind_it_or_elsewhere() {
        let (plane, polygon) = wall();
        let end = |to, sigma| sight(to, sigma).end(&plane, &polygon, 0.05);
        assert_eq!(end([2.03, 0.5, 1.0], 0.01), End::On);
        assert_eq!(end([4.0, 0.5, 1.0], 0.01), End::Through);
        assert_eq!(end([4.0, 0.5, 1.0], 0.4), End::On, "two metres of five are within two standard deviations of 40 %");
        assert_eq!(end([4.0, 0.5, 1.0], 0.2), End::Elsewhere, "neither surely behind nor on it");
        assert_eq!(end([1.0, 0.5, 1.0], 0.01), End::Elsewhere, "in front");
        assert_eq!(end([4.0, 3.0, 1.0], 0.01), End::Elsewhere, "past the edge: it meets the plane at 1.5 m");
        assert_eq!(end([-4.0, 0.5, 1.0], 0.01), End::Elsewhere, "the other way");
        assert_eq!(end([0.0, 0.5, 1.0], 0.01), End::Elsewhere, "along the plane");
    }

    #[test]
    fn what_a_quarter_of_the_sights_pierce_is_no_wall() {
        let (plane, polygon) = wall();
        let sights =
            |through: usize| -> Vec<Sight> { (0..100).map(|k| sight([if k < through { 4.0 } else { 2.0 }, 0.3, 1.0], 0.01)).collect() };
        assert!(is_opaque(&plane, &polygon, &sights(25), 0.05));
        assert!(!is_opaque(&plane, &polygon, &sights(26), 0.05));
        assert!(is_opaque(&plane, &polygon, &[], 0.05), "nobody has looked");
    }

    #[test]
    fn the_side_of_a_normal_and_who_looks_from_where_do_not_matter() {
        let (plane, polygon) = wall();
        let there = sight([4.0, 0.5, 1.0], 0.01);
        let flipped = plane.flipped();
        let corners = polygon.corners().iter().map(|corner| flipped.project(&plane.lift(*corner)));
        let same = Polygon::<f64, CORNERS>::of(corners);
        assert_eq!(there.end(&flipped, &same, 0.05), End::Through);
        let back = Sight { from: there.sample.point_in_world, sample: Sample { point_in_world: there.from, ..there.sample }, ..there };
        assert_eq!(back.end(&plane, &polygon, 0.05), End::Through);
    }
}
