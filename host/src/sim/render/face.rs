//! One rectangle before one camera.

use nalgebra::{Isometry3, Vector3};

use crate::sim::scene::Quad;

/// A rectangle as a camera sees it at one instant; see the module's model. Lengths along u and v in texels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    pub w: [f32; 3],
    pub a: [f32; 3],
    pub b: [f32; 3],
    pub corner: [f32; 2],
    size: [f32; 2],
    /// Number among all rectangles of the world.
    pub quad: u32,
}

#[inline(always)]
pub(super) fn linear(row: &[f32; 3], x: f32, y: f32) -> f32 {
    row[0] * x + row[1] * y + row[2]
}

impl Face {
    /// `None` for a rectangle that turns its back. `camera_from_frame` maps the frame that the rectangle is given in.
    #[allow(clippy::cast_possible_truncation)]
    pub fn new(rectangle: &Quad, density: [f32; 2], quad: usize, camera_from_frame: &Isometry3<f64>) -> Option<Self> {
        let corner = camera_from_frame.transform_point(&rectangle.corner.into()).coords;
        let turn = |v: &Vector3<f64>| camera_from_frame.rotation * v;
        let (normal, a, b) = (turn(&rectangle.normal), turn(&rectangle.axis_u), turn(&rectangle.axis_v));
        let offset = normal.dot(&corner);
        if offset > -1e-6 {
            return None;
        }
        let density = density.map(f64::from);
        let row = |v: Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
        Some(Self {
            w: row(normal / offset),
            a: row(a * density[0]),
            b: row(b * density[1]),
            corner: [(a.dot(&corner) * density[0]) as f32, (b.dot(&corner) * density[1]) as f32],
            size: [(rectangle.size_m[0] * density[0]) as f32, (rectangle.size_m[1] * density[1]) as f32],
            quad: quad as u32,
        })
    }

    /// The five conditions at a ray; all positive means hit.
    #[inline(always)]
    fn conditions(&self, x: f32, y: f32) -> [f32; 5] {
        let w = linear(&self.w, x, y);
        let (u, v) = (linear(&self.a, x, y) - self.corner[0] * w, linear(&self.b, x, y) - self.corner[1] * w);
        [w, u, self.size[0] * w - u, v, self.size[1] * w - v]
    }

    /// Whether no ray of a tile can meet it.
    pub fn misses(&self, tile: &[f32; 4]) -> bool {
        let [left, top, right, bottom] = *tile;
        let corners = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| self.conditions(x, y));
        (0..5).any(|k| corners.iter().all(|conditions| conditions[k] < 0.0))
    }
}

/// The nearest face on a ray, and its inverse depth there.
#[inline(always)]
pub(super) fn nearest(faces: &[Face], x: f32, y: f32) -> Option<(&Face, f32)> {
    let mut best = 0.0_f32;
    let mut found = None;
    for face in faces {
        let [w, u0, u1, v0, v1] = face.conditions(x, y);
        if w > best && u0 >= 0.0 && u1 >= 0.0 && v0 >= 0.0 && v1 >= 0.0 {
            best = w;
            found = Some(face);
        }
    }
    found.map(|face| (face, best))
}
