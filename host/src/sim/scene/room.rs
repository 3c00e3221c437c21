//! The size of a room, and its bare shell.

use nalgebra::Vector3;

use super::{Material, Quad, Scene};
use crate::sim::random::Random;

/// The size and filling of a room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoomConfig {
    /// Middle of the floor, m.
    pub floor_center_m: Vector3<f64>,
    /// Length, width, height, m; 3 to 100 each, height from 2.
    pub size_m: Vector3<f64>,
    /// Boxes standing about; 0 to 200.
    pub boxes: usize,
    /// How far things stay away from the path of the camera, m; 0.1 to 5.
    pub clearance_m: f64,
    /// Poor in texture: floor and walls are plain plaster, nothing lies on the floor or hangs on a wall. The boxes stand there as ever.
    pub is_bare: bool,
}

impl RoomConfig {
    /// EuRoC's Vicon room, 8 × 8 × 4 m at least, around a path.
    #[must_use]
    pub fn vicon(path: &[Vector3<f64>]) -> Self {
        Self::around(path, Vector3::new(8.0, 8.0, 4.0), 1.2, 12)
    }

    /// A machine hall around a path: 5 to 30 m to whatever is seen.
    #[must_use]
    pub fn hall(path: &[Vector3<f64>]) -> Self {
        Self { clearance_m: 1.5, ..Self::around(path, Vector3::new(26.0, 24.0, 9.0), 4.0, 40) }
    }

    fn around(path: &[Vector3<f64>], least_m: Vector3<f64>, margin_m: f64, boxes: usize) -> Self {
        let start = path.first().copied().unwrap_or(Vector3::new(0.0, 0.0, 1.5));
        let (low, high) = path.iter().fold((start, start), |(low, high), point| (low.inf(point), high.sup(point)));
        let floor = (low.z - 0.35).min(0.0);
        let size = Vector3::new(
            (high.x - low.x + 2.0 * margin_m).max(least_m.x),
            (high.y - low.y + 2.0 * margin_m).max(least_m.y),
            (high.z - floor + 0.8).max(least_m.z),
        );
        let floor_center_m = Vector3::new((low.x + high.x) * 0.5, (low.y + high.y) * 0.5, floor);
        Self { floor_center_m, size_m: size, boxes, clearance_m: 0.5, is_bare: false }
    }
}

impl Scene {
    /// Floor, ceiling and four walls, seen from within.
    pub(super) fn shell(&mut self, config: &RoomConfig, random: &mut Random) {
        let half = config.size_m * 0.5;
        let base = config.floor_center_m;
        let (x, y, z) = (Vector3::x() * config.size_m.x, Vector3::y() * config.size_m.y, Vector3::z() * config.size_m.z);
        let low = base - Vector3::new(half.x, half.y, 0.0);
        let mut walls = [Material::Plaster, Material::Plaster, Material::Blocks, Material::Wood];
        for k in (1..walls.len()).rev() {
            walls.swap(k, random.below(k + 1));
        }
        let floor = if config.is_bare { Material::Plaster } else { Material::Floor };
        if config.is_bare {
            walls = [Material::Plaster; 4];
        }
        self.quads.push(Quad::new(low, x, y, floor));
        self.quads.push(Quad::new(low + z, y, x, Material::Ceiling));
        // u runs to the right and v upwards for an onlooker within.
        self.quads.push(Quad::new(low + y, x, z, walls[0]));
        self.quads.push(Quad::new(low + x, -x, z, walls[1]));
        self.quads.push(Quad::new(low, y, z, walls[2]));
        self.quads.push(Quad::new(low + x + y, -y, z, walls[3]));
    }
}
