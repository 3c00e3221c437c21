//! Rectangles seen from one side, and the boxes they make up.

use nalgebra::{Isometry3, Rotation3, Vector3};

use super::Material;

/// A rectangle seen from the side its normal points to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quad {
    /// The corner at texture coordinates (0, 0), m.
    pub corner: Vector3<f64>,
    /// Unit vectors along the two sides.
    pub axis_u: Vector3<f64>,
    /// See `axis_u`.
    pub axis_v: Vector3<f64>,
    /// `axis_u × axis_v`.
    pub normal: Vector3<f64>,
    /// Lengths of the sides, m.
    pub size_m: [f64; 2],
    /// Its cover.
    pub material: Material,
}

/// Where a ray meets a rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Index of the rectangle.
    pub quad: usize,
    /// Distance along the ray in units of its direction.
    pub distance: f64,
    /// Place on the rectangle from its corner, m.
    pub place_m: [f64; 2],
}

impl Quad {
    /// A rectangle from a corner and two perpendicular sides (m); seen from the side of `side_u × side_v`.
    #[must_use]
    pub fn new(corner: Vector3<f64>, side_u: Vector3<f64>, side_v: Vector3<f64>, material: Material) -> Self {
        let (axis_u, axis_v) = (side_u.normalize(), side_v.normalize());
        Self { corner, axis_u, axis_v, normal: axis_u.cross(&axis_v), size_m: [side_u.norm(), side_v.norm()], material }
    }

    /// The same rectangle seen from another frame.
    #[must_use]
    pub fn moved(&self, pose: &Isometry3<f64>) -> Self {
        Self {
            corner: pose.transform_point(&self.corner.into()).coords,
            axis_u: pose.rotation * self.axis_u,
            axis_v: pose.rotation * self.axis_v,
            normal: pose.rotation * self.normal,
            ..*self
        }
    }

    /// The point at `(u, v)` metres from the corner.
    #[must_use]
    pub fn point(&self, u_m: f64, v_m: f64) -> Vector3<f64> {
        self.corner + self.axis_u * u_m + self.axis_v * v_m
    }

    /// The four corners in order.
    #[must_use]
    pub fn polygon(&self) -> [Vector3<f64>; 4] {
        let [u, v] = self.size_m;
        [self.point(0.0, 0.0), self.point(u, 0.0), self.point(u, v), self.point(0.0, v)]
    }

    /// `d` in `nᵀx = d`, m.
    #[must_use]
    pub fn offset_m(&self) -> f64 {
        self.normal.dot(&self.corner)
    }

    /// Distance and place of the intersection with a ray that comes from the visible side.
    #[inline]
    #[must_use]
    pub fn intersect(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, [f64; 2])> {
        let approach = self.normal.dot(direction);
        if approach >= 0.0 {
            return None;
        }
        let distance = self.normal.dot(&(self.corner - origin)) / approach;
        if distance <= 0.0 {
            return None;
        }
        let offset = origin + direction * distance - self.corner;
        let (u, v) = (self.axis_u.dot(&offset), self.axis_v.dot(&offset));
        (u >= 0.0 && v >= 0.0 && u <= self.size_m[0] && v <= self.size_m[1]).then_some((distance, [u, v]))
    }
}

/// Which side of a box nobody can see.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::sim) enum Hidden {
    /// It stands on the floor.
    Underside,
    /// It is close to a wall.
    Back,
    /// All sides can be seen.
    Nothing,
}

/// The sides of a box from its middle, half sizes and rotation, without those that nobody can see.
pub(in crate::sim) fn box_sides(
    center: Vector3<f64>,
    half: Vector3<f64>,
    rotation: &Rotation3<f64>,
    material: Material,
    hidden: Hidden,
) -> Vec<Quad> {
    let mut sides = Vec::with_capacity(6);
    let axes = [0, 1, 2].map(|k| rotation * (Vector3::ith(k, 1.0)));
    for k in 0..3 {
        for sign in [1.0, -1.0] {
            if sign < 0.0 && (k == 2 && hidden == Hidden::Underside || k == 0 && hidden == Hidden::Back) {
                continue;
            }
            let normal = axes[k] * sign;
            // (u, v, n) right-handed, with v upwards on the upright sides.
            let (u, v, half_u, half_v) =
                if k == 2 { (axes[0], axes[1] * sign, half[0], half[1]) } else { (axes[2].cross(&normal), axes[2], half[1 - k], half[2]) };
            let corner = center + normal * half[k] - u * half_u - v * half_v;
            sides.push(Quad::new(corner, u * (2.0 * half_u), v * (2.0 * half_v), material));
        }
    }
    sides
}
