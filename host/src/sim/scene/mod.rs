//! A room made of rectangles.
//!
//! Walls, boxes and boards are all rectangles that can be seen from one side. A ray meets the nearest of them; that answers which
//! landmark is hidden, where a pixel lands and which plane it lies on. The room stands still; what moves in it is kept apart, see [`Mover`].

mod block;
mod furniture;
mod material;
mod mover;
mod quad;
mod room;
#[cfg(test)]
mod tests;
mod traffic;

pub use material::Material;
pub use mover::{Mover, Swing};
pub(super) use quad::{Hidden, box_sides};
pub use quad::{Hit, Quad};
pub use room::RoomConfig;
pub use traffic::MOST_MOVERS;

use nalgebra::Vector3;

use super::SimError;
use super::random::Random;

/// A room and what stands in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// All rectangles.
    pub quads: Vec<Quad>,
}

impl Scene {
    /// Furnishes a room; things keep clear of the path.
    ///
    /// # Errors
    /// A size or count out of range.
    pub fn room(config: &RoomConfig, path: &[Vector3<f64>], seed: u64) -> Result<Self, SimError> {
        SimError::check("room.size_m.x", config.size_m.x, 3.0, 100.0)?;
        SimError::check("room.size_m.y", config.size_m.y, 3.0, 100.0)?;
        SimError::check("room.size_m.z", config.size_m.z, 2.0, 100.0)?;
        SimError::check("room.boxes", config.boxes as f64, 0.0, 200.0)?;
        SimError::check("room.clearance_m", config.clearance_m, 0.1, 5.0)?;
        let mut random = Random::new(seed, "scene");
        let mut scene = Self { quads: Vec::new() };
        scene.shell(config, &mut random);
        scene.furnish(config, path, &mut random);
        Ok(scene)
    }

    /// The nearest rectangle on a ray.
    #[must_use]
    pub fn cast(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        let mut nearest: Option<Hit> = None;
        for (quad, rectangle) in self.quads.iter().enumerate() {
            if let Some((distance, place_m)) = rectangle.intersect(origin, direction)
                && nearest.is_none_or(|hit| distance < hit.distance)
            {
                nearest = Some(Hit { quad, distance, place_m });
            }
        }
        nearest
    }

    /// Whether nothing stands between two points; `margin` is the part of the way at its end that does not count.
    #[must_use]
    pub fn is_clear(&self, from: &Vector3<f64>, to: &Vector3<f64>, margin: f64) -> bool {
        let way = to - from;
        !self.quads.iter().any(|quad| quad.intersect(from, &way).is_some_and(|(distance, _)| distance < 1.0 - margin))
    }
}
