//! The last step of a fit: every point by what is known of it.
//!
//! # Model
//! A search counts a point of the map once and a point of a depth map half, wherever it was seen from. What a distance from the plane is known to is
//! `σ_i = σ_ln |nᵀ(x_i − c_i)|` beside the roughness `σ_s` of real surfaces, so that with `w_i = 1/(σ_i² + σ_s²)`, distances `r_i` and places `u_i` along the
//! plane's horizontal, both about the weighted mean, a wall turns and moves by
//! ```text
//! δ = Σ w u r / (Σ w u² + 1/σ_δ²)        d ← d − r̄
//! ```
//! `σ_δ` = 1° says that a wall which was found along another one's direction mostly has it; a horizontal plane only moves.
//!
//! What the search took for one plane may be two that are close: a wall and the curtain before it, a floor and the mats on it. Their mean is
//! neither. So points count less the farther they are off, as in Cauchy's distribution, and the fit is made anew with the weights of the
//! last one:
//! ```text
//! w_i = 1/(σ_i² + σ_s² + r_i²)
//! ```

use libella_core::plane::{Detection, Orientation, Plane, Polygon};
use nalgebra::{UnitVector3, Vector3};

use super::finder::CORNERS;
use super::sight::Sight;

/// What a point of a real surface is off its plane, m.
const ROUGHNESS_M: f64 = 0.02;
/// How well the direction of another wall tells that of one which was found along it, rad.
const TURN_SIGMA_RAD: f64 = 0.0175;
/// Fits with the weights of the one before, at most, and what a wall still moves by when that is enough, m.
const ROUNDS: usize = 30;
const SETTLED_M: f64 = 1e-4;

/// The same plane, fitted once more to the points that were found on it.
pub(super) fn refit<'a>(found: &Detection<f64, CORNERS>, on_it: impl Iterator<Item = &'a Sight>) -> Detection<f64, CORNERS> {
    let plane = found.fit.plane;
    let normal = plane.normal_in_world.into_inner();
    // e₁ is horizontal for a wall.
    let (along, _) = plane.axes();
    // Variance of its distance, and the point.
    let known: Vec<(f64, Vector3<f64>)> =
        on_it.map(|sight| (sight.sigma_m(&normal).powi(2) + ROUGHNESS_M * ROUGHNESS_M, sight.sample.point_in_world)).collect();
    let mut refined = plane;
    for _ in 0..ROUNDS {
        let near = refined;
        let weighed = known.iter().map(|(variance, point)| (1.0 / (variance + near.distance_m(point).powi(2)), *point));
        let (all, sum) = weighed.clone().fold((0.0, Vector3::zeros()), |(all, sum), (weight, point)| (all + weight, sum + point * weight));
        if all <= 0.0 {
            return *found;
        }
        let mean = sum / all;
        let turn = if found.orientation == Orientation::Vertical {
            let (both, squares) = weighed.fold((0.0, TURN_SIGMA_RAD.powi(-2)), |(both, squares), (weight, point)| {
                let (u, r) = (along.dot(&(point - mean)), normal.dot(&(point - mean)));
                (both + weight * u * r, squares + weight * u * u)
            });
            both / squares
        } else {
            0.0
        };
        // r = δ u on the turned plane, so n ← n − δ e₁.
        refined = Plane::through(&mean, UnitVector3::new_normalize(normal - along * turn)).canonical().aligned_with(&plane);
        if near.distance_m(&mean).abs() < SETTLED_M {
            break;
        }
    }
    let corners = found.polygon.corners().iter().map(|corner| refined.project(&plane.lift(*corner)));
    let mut better = *found;
    better.polygon = Polygon::of(corners);
    better.fit.plane = refined;
    better
}

#[cfg(test)]
pub(super) mod tests {
    use libella_core::plane::fit::Fit;
    use libella_core::plane::{Sample, Source};

    use super::*;

    /// The wall `x = 2` as somebody found it who took it to be turned by `turn` and 1 cm away.
    fn found(turn: f64) -> Detection<f64, CORNERS> {
        let normal = UnitVector3::new_normalize(Vector3::new(turn.cos(), turn.sin(), 0.0));
        detection(Plane::through(&Vector3::new(2.01, 0.0, 1.0), normal), [2.0, 0.0])
    }

    /// The wall `x = at_m`, 2 m wide and high, with its middle at `y = aside_m`.
    pub fn wall_at(at_m: f64, aside_m: f64) -> Detection<f64, CORNERS> {
        detection(Plane::through(&Vector3::new(at_m, 0.0, 0.0), Vector3::x_axis()), [at_m, aside_m])
    }

    fn detection(plane: Plane<f64>, [x, aside_m]: [f64; 2]) -> Detection<f64, CORNERS> {
        let corners = [[-1.0, 0.0], [1.0, 0.0], [1.0, 2.0], [-1.0, 2.0]].map(|[y, z]| plane.project(&Vector3::new(x, aside_m + y, z)));
        let fit = Fit {
            plane,
            inliers: 0,
            weight: 0.0,
            score: 0.0,
            mean_in_world: Vector3::zeros(),
            spread_m: 0.0,
            extent_m: [2.0; 2],
            tilt_rad: 0.0,
            draws: 0,
        };
        Detection { fit, orientation: Orientation::Vertical, polygon: Polygon::of(corners) }
    }

    fn sights(off_m: impl Fn(usize) -> f64, sigma_log: impl Fn(usize) -> f64) -> Vec<Sight> {
        (0..400)
            .map(|k| {
                let (y, z) = ((k % 20) as f64 * 0.1 - 0.95, (k / 20) as f64 * 0.1);
                let sample = Sample { point_in_world: Vector3::new(2.0 + off_m(k), y, z), normal_in_world: None, source: Source::MapPoint };
                Sight { sample, from: Vector3::new(0.0, 0.0, 1.0), sigma_log: sigma_log(k), is_sought: true }
            })
            .collect()
    }

    #[test]
    fn points_of_a_wall_turn_it_back_and_its_polygon_goes_along() {
        let points = sights(|_| 0.0, |_| 0.01);
        let refined = refit(&found(0.05), points.iter());
        let off = refined.fit.plane.normal_in_world.angle(&Vector3::x_axis());
        // With Σ w u² = 400 · 0.33 m² / (2.8 cm)² against 1/(1°)², 2 % of the turn stay.
        assert!(off < 0.05 * 0.03 && (refined.fit.plane.offset_m + 2.0).abs() < 1e-3, "{off} {}", refined.fit.plane.offset_m);
        for (new, old) in refined.polygon.corners().iter().zip(found(0.05).polygon.corners()) {
            let moved = refined.fit.plane.lift(*new) - found(0.05).fit.plane.lift(*old);
            assert!(moved.norm() < 0.07, "a corner went {} m", moved.norm());
        }
    }

    #[test]
    fn of_two_planes_that_are_close_the_fuller_one_is_meant() {
        // A wall, and a curtain 9 cm before two fifths of it: found between them, where both are on it.
        let points = sights(|k| if k % 5 < 2 { 0.05 } else { -0.04 }, |_| 0.005);
        let refined = refit(&found(0.0), points.iter());
        let off_m = -refined.fit.plane.offset_m - 1.96;
        assert!((0.0..0.01).contains(&off_m), "{off_m} m before the wall; the mean of all is 3.6 cm before it");
    }

    #[test]
    fn who_knows_little_says_little() {
        // Every other point 4 cm off, and known to 50 % of 2 m only.
        let points = sights(|k| if k % 2 == 0 { 0.04 } else { 0.0 }, |k| if k % 2 == 0 { 0.5 } else { 0.005 });
        let refined = refit(&found(0.0), points.iter());
        assert!((refined.fit.plane.offset_m + 2.0).abs() < 1e-4, "{}", refined.fit.plane.offset_m);
        let nobody = refit(&found(0.02), points.iter().take(0));
        assert_eq!(nobody, found(0.02));
    }
}
