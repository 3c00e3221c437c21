//! A plane as a unit normal and an offset.
//!
//! # Model
//! ```text
//! nᵀx + d = 0        ‖n‖ = 1, x and d in m; the signed distance of a point is nᵀx + d
//! x = u e₁ + v e₂ − d n        in-plane coordinates (u, v), m, about the foot of the world's origin
//! ```
//! `(n, d)` and `(−n, −d)` are one plane. [`Plane::canonical`] chooses the sign for which the largest component of `n` is positive (of
//! equal ones the later: z before y before x): the normal of a floor or ceiling points up, and no wall along an axis of the world is near
//! a jump. Some jump is unavoidable, so whoever compares planes over time uses [`Plane::aligned_with`].
//!
//! `e₁ = normalize(e_z × n)` is horizontal and `e₂ = n × e₁` points up where the plane is steeper than 45°; below, `e₁` is the world's x
//! axis projected into the plane.
//!
//! # Degeneracy
//! None: `(n, d)` is regular for planes through the world's origin.

use nalgebra::{UnitVector3, Vector3};

use crate::real::Real;

/// How a plane lies to gravity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Orientation {
    /// Its normal is along gravity.
    Horizontal,
    /// Its normal is across gravity.
    Vertical,
}

/// `nᵀx + d = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane<T: Real> {
    /// `n`, unit.
    pub normal_in_world: UnitVector3<T>,
    /// `d`, m: the signed distance of the world's origin.
    pub offset_m: T,
}

impl<T: Real> Plane<T> {
    /// The plane through a point.
    #[must_use]
    pub fn through(point_in_world: &Vector3<T>, normal_in_world: UnitVector3<T>) -> Self {
        Self { normal_in_world, offset_m: -normal_in_world.dot(point_in_world) }
    }

    /// `nᵀx + d`, m: positive on the side that the normal points to.
    #[inline]
    #[must_use]
    pub fn distance_m(&self, point_in_world: &Vector3<T>) -> T {
        self.normal_in_world.dot(point_in_world) + self.offset_m
    }

    /// The same plane with the other sign.
    #[must_use]
    pub fn flipped(&self) -> Self {
        Self { normal_in_world: UnitVector3::new_unchecked(-self.normal_in_world.into_inner()), offset_m: -self.offset_m }
    }

    /// The same plane with the largest component of its normal positive.
    #[must_use]
    pub fn canonical(&self) -> Self {
        let n = &self.normal_in_world;
        let mut largest = n.z;
        for component in [n.y, n.x] {
            if component.abs() > largest.abs() {
                largest = component;
            }
        }
        if largest < T::ZERO { self.flipped() } else { *self }
    }

    /// The same plane with the sign that turns its normal towards another's.
    #[must_use]
    pub fn aligned_with(&self, other: &Self) -> Self {
        if self.normal_in_world.dot(&other.normal_in_world) < T::ZERO { self.flipped() } else { *self }
    }

    /// The angle between two planes, rad, in [0, π/2], whatever the signs.
    #[must_use]
    pub fn angle_rad(&self, other: &Self) -> T {
        angle_between_lines(&self.normal_in_world, &other.normal_in_world)
    }

    /// Horizontal or vertical, within `tolerance_rad`; `None` if neither.
    #[must_use]
    pub fn orientation(&self, up_in_world: &UnitVector3<T>, tolerance_rad: T) -> Option<Orientation> {
        let angle = angle_between_lines(&self.normal_in_world, up_in_world);
        if angle <= tolerance_rad {
            Some(Orientation::Horizontal)
        } else if T::frac_pi_2() - angle <= tolerance_rad {
            Some(Orientation::Vertical)
        } else {
            None
        }
    }

    /// `(e₁, e₂)`, so that `e₁ × e₂ = n`.
    #[must_use]
    pub fn axes(&self) -> (Vector3<T>, Vector3<T>) {
        let n = self.normal_in_world.into_inner();
        let e1 = if n.z.abs() > T::of(core::f64::consts::FRAC_1_SQRT_2) {
            let along_x = Vector3::x() - n * n.x;
            along_x / along_x.norm_squared().root() // ‖·‖² = 1 − n_x² ≥ 1/2
        } else {
            let across = Vector3::new(-n.y, n.x, T::ZERO);
            across / across.norm_squared().root() // ‖·‖² = 1 − n_z² ≥ 1/2
        };
        (e1, n.cross(&e1))
    }

    /// `(u, v)` of the foot of a point, m.
    #[must_use]
    pub fn project(&self, point_in_world: &Vector3<T>) -> [T; 2] {
        let (e1, e2) = self.axes();
        [e1.dot(point_in_world), e2.dot(point_in_world)]
    }

    /// The point at `(u, v)`.
    #[must_use]
    pub fn lift(&self, [u, v]: [T; 2]) -> Vector3<T> {
        let (e1, e2) = self.axes();
        e1 * u + e2 * v - self.normal_in_world.into_inner() * self.offset_m
    }

    /// `(1 − share) (n, d) + share (n', d')`, normalised, the other taken with the sign of this one: the distance of every point
    /// is blended alike, wherever the world's origin may be. `None` if the planes are orthogonal, where no sign is right.
    #[must_use]
    pub fn blended_with(&self, other: &Self, share: T) -> Option<Self> {
        let other = other.aligned_with(self);
        let rest = T::one() - share;
        let sum = self.normal_in_world.into_inner() * rest + other.normal_in_world.into_inner() * share;
        let length = sum.norm_squared().root();
        if !(self.normal_in_world.dot(&other.normal_in_world) > T::of(1e-3) && length.is_usable()) {
            return None;
        }
        Some(Self {
            normal_in_world: UnitVector3::new_unchecked(sum / length),
            offset_m: (self.offset_m * rest + other.offset_m * share) / length,
        })
    }
}

/// The angle between two directions whose signs mean nothing, rad, in [0, π/2], precise at both ends.
pub(super) fn angle_between_lines<T: Real>(a: &Vector3<T>, b: &Vector3<T>) -> T {
    a.cross(b).norm_squared().root().arc_tangent(a.dot(b).abs())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    prop_compose! {
        fn plane()(n in prop::array::uniform3(-1.0f64..1.0).prop_filter("a direction", |n| Vector3::from(*n).norm() > 0.1), d in -9.0f64..9.0) -> Plane<f64> {
            Plane { normal_in_world: UnitVector3::new_normalize(Vector3::from(n)), offset_m: d }
        }
    }

    fn point() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-9.0f64..9.0).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn a_flip_is_the_same_plane(plane in plane(), other in plane(), x in point()) {
            let flipped = plane.flipped();
            prop_assert_eq!(flipped.distance_m(&x), -plane.distance_m(&x));
            prop_assert_eq!(flipped.canonical(), plane.canonical());
            prop_assert_eq!(flipped.angle_rad(&other), plane.angle_rad(&other));
            prop_assert_eq!(flipped.aligned_with(&other), plane.aligned_with(&other));
            let up = Vector3::z_axis();
            prop_assert_eq!(flipped.orientation(&up, 0.3), plane.orientation(&up, 0.3));
        }

        #[test]
        fn coordinates_lead_back_to_the_foot(plane in plane(), x in point()) {
            let foot = plane.lift(plane.project(&x));
            prop_assert!(plane.distance_m(&foot).abs() < 1e-14 * 20.0);
            prop_assert!((foot + plane.normal_in_world.into_inner() * plane.distance_m(&x) - x).norm() < 1e-13);
            let (e1, e2) = plane.axes();
            prop_assert!((e1.cross(&e2) - plane.normal_in_world.into_inner()).norm() < 1e-15 * 8.0);
        }

        #[test]
        fn yaw_and_translation_carry_planes_along(plane in plane(), x in point(), yaw in -4.0f64..4.0, shift in point()) {
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw);
            let moved = Plane::through(&(turn * plane.lift([0.0, 0.0]) + shift), turn * plane.normal_in_world);
            prop_assert!((moved.distance_m(&(turn * x + shift)) - plane.distance_m(&x)).abs() < 1e-13);
            prop_assert_eq!(moved.orientation(&Vector3::z_axis(), 0.2), plane.orientation(&Vector3::z_axis(), 0.2));
        }

        #[test]
        fn a_blend_blends_distances_everywhere(plane in plane(), tilt in prop::array::uniform3(-0.3f64..0.3), d in -9.0f64..9.0, share in 0.0f64..1.0, x in point()) {
            let other = Plane { normal_in_world: UnitVector3::new_normalize(plane.normal_in_world.into_inner() + Vector3::from(tilt)), offset_m: d };
            let blend = plane.blended_with(&other.flipped(), share).unwrap();
            let length = (plane.normal_in_world.into_inner() * (1.0 - share) + other.normal_in_world.into_inner() * share).norm();
            let expected = ((1.0 - share) * plane.distance_m(&x) + share * other.distance_m(&x)) / length;
            prop_assert!((blend.distance_m(&x) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn values_by_hand() {
        let floor = Plane { normal_in_world: -Vector3::<f64>::z_axis(), offset_m: -1.5 };
        assert_eq!(floor.canonical().normal_in_world, Vector3::z_axis());
        assert_eq!(floor.canonical().distance_m(&Vector3::new(3.0, 4.0, 1.0)), 2.5);
        assert_eq!(floor.orientation(&Vector3::z_axis(), 0.01), Some(Orientation::Horizontal));
        let wall = Plane { normal_in_world: -Vector3::<f64>::y_axis(), offset_m: 2.0 };
        assert_eq!(wall.orientation(&Vector3::z_axis(), 0.01), Some(Orientation::Vertical));
        assert_eq!(wall.project(&Vector3::new(1.0, 2.0, 3.0)), [1.0, 3.0]);
        assert!((floor.angle_rad(&wall) - core::f64::consts::FRAC_PI_2).abs() < 1e-15);
        assert_eq!(floor.blended_with(&wall, 0.5), None);
        let board = Plane::through(&Vector3::zeros(), UnitVector3::new_normalize(Vector3::new(0.342, 0.0, 0.94)));
        assert_eq!(board.orientation(&Vector3::z_axis(), 0.3), None);
    }
}
