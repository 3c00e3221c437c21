//! Which landmarks lie on which plane, and where the planes are. Both stay as they are while the cost is minimised.

use libella_core::plane::Plane;
use nalgebra::{UnitVector3, Vector3};

use super::Bundle;

/// Landmarks that a plane needs to be moved.
const LEAST_LANDMARKS: usize = 8;
/// A normal this far from the horizontal, as the sine of the angle, is that of a wall: only its heading is estimated.
const WALL: f64 = 0.1;

impl Bundle {
    /// Puts every landmark that takes part on the nearest plane, where one is near enough, and then each plane in the middle of its landmarks:
    /// a floor is moved along its normal, a wall is also turned about the vertical. Planes come from the causal pass, and its errors would
    /// otherwise stay in them.
    pub fn attach_planes(&mut self) {
        let theta_m = self.settings.plane_theta_m;
        let mut on: Vec<Vec<Vector3<f64>>> = vec![Vec::new(); self.planes.len()];
        for landmark in &mut self.landmarks {
            let at = landmark.position_in_world;
            let distances = self.planes.iter().map(|plane| plane.distance_m(&at).abs()).enumerate();
            let nearest = distances.filter(|(_, distance)| landmark.used && *distance < theta_m).min_by(|a, b| a.1.total_cmp(&b.1));
            landmark.plane = nearest.map(|(plane, _)| plane);
            if let Some(points) = landmark.plane.and_then(|plane| on.get_mut(plane)) {
                points.push(at);
            }
        }
        for (plane, points) in self.planes.iter_mut().zip(&on) {
            if points.len() >= LEAST_LANDMARKS {
                *plane = moved(plane, points);
            }
        }
    }
}

/// The plane of least squares in the degrees of freedom that gravity leaves.
fn moved(plane: &Plane<f64>, points: &[Vector3<f64>]) -> Plane<f64> {
    let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let normal = plane.normal_in_world.into_inner();
    if normal.z.abs() > WALL {
        return Plane::through(&middle, plane.normal_in_world);
    }
    let along = normal.cross(&Vector3::z()).normalize();
    let (mut square, mut product) = (0.0, 0.0);
    for point in points {
        let arm = (point - middle).dot(&along);
        square += arm * arm;
        product += arm * (point - middle).dot(&normal);
    }
    let slope = if square > 0.0 { product / square } else { 0.0 };
    Plane::through(&middle, UnitVector3::new_normalize(normal - along * slope))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_turns_about_the_vertical_to_its_points_and_a_floor_rises_to_them() {
        let heading = 0.03_f64;
        let truth = UnitVector3::new_normalize(Vector3::new(heading.cos(), heading.sin(), 0.0));
        let along = truth.cross(&Vector3::z());
        let points: Vec<_> = (0..20_i32)
            .map(|k| truth.into_inner() * 2.0 + along * (f64::from(k) * 0.2 - 1.0) + Vector3::z() * (f64::from(k * 7 % 5) * 0.3))
            .collect();
        let wall = moved(&Plane::through(&Vector3::new(2.03, 0.0, 0.0), Vector3::x_axis()), &points);
        assert!(points.iter().all(|point| wall.distance_m(point).abs() < 1e-12));
        assert!(wall.normal_in_world.dot(&truth) > 1.0 - 1e-12);
        let floor = moved(&Plane::through(&Vector3::zeros(), Vector3::z_axis()), &points);
        assert_eq!(floor.normal_in_world, Vector3::z_axis());
        assert!((floor.offset_m + 0.6).abs() < 1e-12, "the mean height of the points: {}", floor.offset_m);
    }
}
