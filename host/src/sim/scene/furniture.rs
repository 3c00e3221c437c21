//! What lies on the floor, stands about and hangs on the walls of a room.

use nalgebra::{Rotation3, Vector3};

use super::quad::{Hidden, box_sides};
use super::{Material, RoomConfig, Scene};
use crate::sim::random::Random;

impl Scene {
    fn add_box(&mut self, center: Vector3<f64>, half: Vector3<f64>, rotation: &Rotation3<f64>, material: Material, hidden: Hidden) {
        self.quads.extend(box_sides(center, half, rotation, material, hidden));
    }

    pub(super) fn furnish(&mut self, config: &RoomConfig, path: &[Vector3<f64>], random: &mut Random) {
        let floor = config.floor_center_m.z;
        // A hall holds larger things.
        let scale = (config.size_m.x.min(config.size_m.y) / 8.0).clamp(0.5, 3.0);
        let is_free = |center: &Vector3<f64>, radius: f64, height: f64| {
            path.iter().all(|point| {
                let across = (point - center).xy().norm();
                across > radius + config.clearance_m || point.z > floor + height + config.clearance_m
            })
        };
        if !config.is_bare {
            self.cover_floor(config, random, scale, &is_free);
        }
        self.stand_boxes(config, random, scale, &is_free);
        if !config.is_bare {
            for side in 0..4 {
                self.dress_wall(config, random, side, scale, &is_free);
            }
        }
    }

    /// Lays pictures, strips of tape and mats on the floor, some of them in a stack.
    fn cover_floor(&mut self, config: &RoomConfig, random: &mut Random, scale: f64, is_free: &dyn Fn(&Vector3<f64>, f64, f64) -> bool) {
        let floor = config.floor_center_m.z;
        let flat = [Material::PlayMat, Material::Tape, Material::PlayMat, Material::Tape, Material::Mat, Material::PlayMat, Material::Tape];
        for (k, material) in flat.iter().enumerate() {
            let half = match material {
                Material::Tape => Vector3::new(random.between(1.0, 1.8), 0.055, 0.001 + 1e-4 * k as f64) * scale,
                Material::Mat => Vector3::new(1.0, 0.5, 0.06) * scale,
                _ => Vector3::new(random.between(0.6, 0.95), random.between(0.45, 0.65), 0.002 + 1e-4 * k as f64) * scale,
            };
            let spot = self.place(config, random, half.xy().norm() + 0.2);
            let center = Vector3::new(spot.x, spot.y, floor + half.z);
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), random.between(-1.5, 1.5));
            if is_free(&center, half.xy().norm(), 2.0 * half.z) {
                self.add_box(center, half, &turn, *material, Hidden::Underside);
            }
        }
        // A stack of mats.
        let spot = self.place(config, random, 1.2 * scale);
        if is_free(&spot, 1.1 * scale, 0.75 * scale) {
            let heading = random.between(-1.5, 1.5);
            for layer in 0..4 {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), heading + random.between(-0.05, 0.05));
                let half = Vector3::new(1.0, 0.55, 0.08) * scale;
                self.add_box(
                    Vector3::new(spot.x, spot.y, floor + half.z * (1.0 + 2.05 * f64::from(layer))),
                    half,
                    &turn,
                    Material::Mat,
                    Hidden::Underside,
                );
            }
        }
    }

    /// Boxes, crates and cabinets stand about, rather along the walls.
    fn stand_boxes(&mut self, config: &RoomConfig, random: &mut Random, scale: f64, is_free: &dyn Fn(&Vector3<f64>, f64, f64) -> bool) {
        let floor = config.floor_center_m.z;
        let materials = [Material::Cardboard, Material::Wood, Material::Metal, Material::Pallet, Material::Cardboard, Material::Blocks];
        let mut placed = 0;
        for _ in 0..config.boxes * 30 {
            if placed == config.boxes {
                break;
            }
            let half = Vector3::new(random.between(0.15, 0.5), random.between(0.15, 0.45), random.between(0.15, 0.75)) * scale;
            let spot = self.place(config, random, half.xy().norm());
            let center = Vector3::new(spot.x, spot.y, floor + half.z);
            if is_free(&center, half.xy().norm(), 2.0 * half.z) {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), random.between(-1.5, 1.5));
                self.add_box(center, half, &turn, materials[placed % materials.len()], Hidden::Underside);
                placed += 1;
            }
        }
    }

    /// Hangs windows with curtains and heaters, pictures and boards on a wall, and leans mats and boards against it.
    fn dress_wall(
        &mut self,
        config: &RoomConfig,
        random: &mut Random,
        side: u8,
        scale: f64,
        is_free: &dyn Fn(&Vector3<f64>, f64, f64) -> bool,
    ) {
        let half_room = config.size_m * 0.5;
        let (sine, cosine) = (f64::from(side) * std::f64::consts::FRAC_PI_2).sin_cos();
        let outward = Vector3::new(cosine.round(), sine.round(), 0.0);
        let sideways = Vector3::new(-sine.round(), cosine.round(), 0.0);
        let (reach, span) = (half_room.component_mul(&outward).norm(), half_room.component_mul(&sideways).norm());
        // The board's x faces the room, its z is up; `tilt` leans its top towards the wall.
        let mut hang = |along: f64, lift: f64, half: Vector3<f64>, tilt: f64, material: Material| {
            let half = half.component_mul(&Vector3::new(1.0, scale, scale));
            let (lean, stand) = tilt.sin_cos();
            let depth = half.z * lean + half.x * stand + 0.004;
            let height = if tilt > 0.0 { half.z * stand + half.x * lean } else { lift * scale };
            let center = config.floor_center_m + outward * (reach - depth) + sideways * (along * (span - half.y)) + Vector3::z() * height;
            let fits = height + half.z < config.size_m.z;
            if fits && is_free(&center, half.y, 2.0 * config.size_m.z) {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), sine.atan2(cosine) + std::f64::consts::PI)
                    * Rotation3::from_axis_angle(&Vector3::y_axis(), -tilt);
                self.add_box(center, half, &turn, material, Hidden::Back);
            }
        };
        // Windows on two of the walls.
        if side.is_multiple_of(2) {
            for along in [-0.6, 0.1] {
                let along = along + random.between(-0.1, 0.1);
                let aside = 0.95 * scale / span;
                hang(along, 2.2, Vector3::new(0.01, 0.75, 0.95), 0.0, Material::Window);
                hang(along - aside, 2.0, Vector3::new(0.04, 0.3, 1.25), 0.0, Material::Curtain);
                hang(along + aside, 2.0, Vector3::new(0.05, 0.25, 1.25), 0.0, Material::Curtain);
                hang(along, 0.5, Vector3::new(0.06, 0.6, 0.35), 0.0, Material::Radiator);
            }
        }
        for k in 0..3 {
            let along = -0.9 + 0.75 * f64::from(k) + random.between(-0.1, 0.1);
            let upright = random.unit() < 0.6;
            let half = if upright { Vector3::new(0.06, 0.5, 1.0) } else { Vector3::new(0.06, 1.0, 0.5) };
            if side % 2 == 1 || !upright {
                hang(along, 0.0, half, random.between(0.06, 0.2), Material::Mat);
            }
        }
        let board = [Material::Checkerboard, Material::Pallet, Material::Checkerboard, Material::Metal][usize::from(side) % 4];
        let half = if board == Material::Checkerboard { Vector3::new(0.006, 0.32, 0.24) } else { Vector3::new(0.06, 0.6, 0.5) };
        hang(random.between(-0.3, 0.9), 0.0, half, random.between(0.12, 0.25), board);
        for _ in 0..2 {
            let half = Vector3::new(0.006, random.between(0.3, 0.55), random.between(0.35, 0.6));
            hang(random.between(-0.9, 0.9), random.between(1.3, 2.2), half, 0.0, Material::Poster);
        }
        hang(random.between(-0.9, 0.9), random.between(2.2, 2.9), Vector3::new(0.02, random.between(0.3, 0.8), 0.25), 0.0, Material::Metal);
    }

    /// A spot on the floor, more often near a wall than in the middle.
    fn place(&self, config: &RoomConfig, random: &mut Random, radius: f64) -> Vector3<f64> {
        let half = config.size_m * 0.5;
        let toward_wall = |random: &mut Random| {
            let value = random.between(-1.0, 1.0);
            value.signum() * value.abs().powf(0.5)
        };
        let spot = Vector3::new(toward_wall(random) * (half.x - radius), toward_wall(random) * (half.y - radius), 0.0);
        config.floor_center_m + spot
    }
}
