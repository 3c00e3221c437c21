//! Surface normals from depth.
//!
//! # Model
//! With the points `P(x, y) = d(x, y) K⁻¹ (x, y, 1)` of a depth map, and a shift `δ` in values of the map,
//! ```text
//! n = (P(x, y−δ) − P(x, y)) × (P(x−δ, y) − P(x, y))
//! ```
//! normalised and turned towards the camera. A landmark's running normal weighs the nearer view more: with `d` and `d'` the distances of
//! the last and the new view, `n ← (n' d + n d') / (d + d')`.
//!
//! Source: Ji et al., "CNN-Augmented Visual-Inertial SLAM with Planar Constraints"; the printed formula leaves the depths out, without
//! which the normal would be the same everywhere.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use nalgebra::Vector3;

use super::DepthView;
use crate::camera::{Camera, CameraModel};
use crate::real::Real;

/// The normal in the camera's frame at value `(i, j)` of a depth map, turned towards the camera; `None` at the rim, where depth is
/// unknown, across an edge of depth, and where the three points are on a line.
///
/// Both differences are averaged over the two sides, so that the normal belongs to the middle.
#[must_use]
pub fn normal<T: Real>(map: &DepthView<'_>, camera: &CameraModel<T>, at: (usize, usize), shift: usize) -> Option<Vector3<T>> {
    let (i, j) = at;
    let shift = shift.max(1);
    let center = point(map, camera, i, j)?;
    let (above, below) = (point(map, camera, i, j.checked_sub(shift)?)?, point(map, camera, i, j + shift)?);
    let (left, right) = (point(map, camera, i.checked_sub(shift)?, j)?, point(map, camera, i + shift, j)?);
    // On one surface both sides lie about as far away; across an edge one of them is elsewhere.
    let (vertical, horizontal) = ((above - center, below - center), (left - center, right - center));
    let lopsided = |(one, other): &(Vector3<T>, Vector3<T>)| {
        let (one, other) = (one.norm_squared(), other.norm_squared());
        one.max(other) > one.min(other) * T::of(9.0)
    };
    if lopsided(&vertical) || lopsided(&horizontal) {
        return None;
    }
    let cross = (above - below).cross(&(left - right));
    let length = cross.norm();
    if !(length > center.norm_squared() * T::of(1e-9)) {
        return None;
    }
    let normal = cross / length;
    Some(if normal.dot(&center) > T::ZERO { -normal } else { normal })
}

/// The point of a value, m, in the camera's frame.
fn point<T: Real>(map: &DepthView<'_>, camera: &CameraModel<T>, i: usize, j: usize) -> Option<Vector3<T>> {
    let sample = map.value::<T>(i, j)?;
    let (ray, _) = camera.unproject_with_jacobian(&map.pixel(i, j))?;
    Some(Vector3::new(ray.x, ray.y, T::one()) / sample.inverse_depth)
}

/// A landmark's running normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalAverage<T: Real> {
    /// Of unit length, in world.
    pub normal_in_world: Vector3<T>,
    /// From where it was last seen, m.
    pub distance_m: T,
}

impl<T: Real> NormalAverage<T> {
    /// Takes in one more view from `distance_m`: the nearer one weighs more. Opposite normals leave it as it is.
    #[must_use]
    pub fn seen(self, normal_in_world: &Vector3<T>, distance_m: T) -> Self {
        let mixed = normal_in_world * self.distance_m + self.normal_in_world * distance_m;
        let length = mixed.norm();
        if !(length > T::of(1e-6) * (self.distance_m + distance_m)) {
            return self;
        }
        Self { normal_in_world: mixed / length, distance_m }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::vec::Vec;

    use nalgebra::Vector2;
    use proptest::prelude::*;

    use super::*;
    use crate::camera::PinholeRadTan;

    const SIZE: (usize, usize) = (40, 24);

    fn camera() -> CameraModel<f64> {
        CameraModel::PinholeRadTan(PinholeRadTan {
            size_px: (320, 192),
            focal_px: [195.0, 183.0],
            center_px: [156.0, 99.0],
            distortion: [-0.28, 0.07, 0.0002, 0.00002],
        })
    }

    /// Exact inverse depths of the plane `n · X = d` in the grid of values.
    fn plane(normal: &Vector3<f64>, distance: f64) -> Vec<f32> {
        let camera = camera();
        (0..SIZE.0 * SIZE.1)
            .map(|k| {
                let pixel = Vector2::new((k % SIZE.0) as f64 * 8.0 + 3.5, (k / SIZE.0) as f64 * 8.0 + 3.5);
                let ray = camera.unproject_with_jacobian(&pixel).map_or_else(Vector2::zeros, |(ray, _)| ray);
                (normal.dot(&Vector3::new(ray.x, ray.y, 1.0)) / distance) as f32
            })
            .collect()
    }

    proptest! {
        /// The normal of a plane is that of the plane, anywhere in a distorted image, and looks at the camera.
        #[test]
        fn a_plane_has_its_normal_everywhere(
            tilt in -0.7f64..0.7, pan in -0.7f64..0.7, distance in 0.5f64..8.0, i in 2usize..38, j in 2usize..22, shift in 1usize..3,
        ) {
            let normal_in_camera = Vector3::new(pan, tilt, 1.0).normalize();
            let (depths, ones) = (plane(&normal_in_camera, distance), [0.1_f32; SIZE.0 * SIZE.1]);
            let map = DepthView::new(SIZE, [8.0; 2], [3.5; 2], &depths, &ones, &ones).unwrap();
            prop_assume!(map.value::<f64>(i, j).is_some());
            let Some(found) = normal(&map, &camera(), (i, j), shift) else { return Ok(()) };
            prop_assert!(found.angle(&-normal_in_camera) < 2e-3, "{} rad off", found.angle(&-normal_in_camera));
        }
    }

    #[test]
    fn rim_hole_and_edge_have_no_normal() {
        let ones = [0.1_f32; SIZE.0 * SIZE.1];
        let mut depths = plane(&Vector3::z(), 2.0);
        let at = |i: usize, j: usize| j * SIZE.0 + i;
        depths[at(10, 10)] = f32::NAN;
        for j in 0..SIZE.1 {
            for i in 25..SIZE.0 {
                depths[at(i, j)] = 0.1; // ten metres instead of two
            }
        }
        let map = DepthView::new(SIZE, [8.0; 2], [3.5; 2], &depths, &ones, &ones).unwrap();
        let camera = camera();
        for (i, j) in [(0, 5), (5, 0), (39, 5), (5, 23), (10, 10), (11, 10), (24, 12)] {
            assert_eq!(normal(&map, &camera, (i, j), 1), None, "({i}, {j})");
        }
        let found = normal(&map, &camera, (15, 15), 1).unwrap();
        assert!((found + Vector3::z()).norm() < 1e-3);
    }

    #[test]
    fn the_nearer_view_weighs_more() {
        let (up, aside) = (Vector3::z(), Vector3::x());
        let mixed = NormalAverage { normal_in_world: up, distance_m: 1.0 }.seen(&aside, 3.0);
        // n ∝ 1·aside + 3·up
        let expected = (aside + up * 3.0).normalize();
        assert!((mixed.normal_in_world - expected).norm() < 1e-12 && mixed.distance_m == 3.0);
        let opposite = NormalAverage { normal_in_world: up, distance_m: 2.0 }.seen(&-up, 2.0);
        assert_eq!(opposite.normal_in_world, up);
    }
}
