//! A room made of rectangles.
//!
//! Walls, boxes and boards are all rectangles that can be seen from one side. A ray meets the nearest of them; that answers which
//! landmark is hidden, where a pixel lands and which plane it lies on.

use nalgebra::{Rotation3, Vector3};

use super::SimError;
use super::random::Random;

/// What a rectangle is covered with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Material {
    /// Worn screed with joints and marks.
    Floor,
    /// White plaster, poor in texture.
    Plaster,
    /// Painted blocks.
    Blocks,
    /// Hanging cloth with folds.
    Curtain,
    /// Wooden panels.
    Wood,
    /// Foam mat.
    Mat,
    /// Printed picture with shapes and lettering.
    Poster,
    /// Calibration board of squares.
    Checkerboard,
    /// Slats of a pallet.
    Pallet,
    /// Cardboard with tape and a label.
    Cardboard,
    /// Sheet metal with rivets and scratches.
    Metal,
    /// Ceiling panels.
    Ceiling,
}

impl Material {
    /// Share of spots where a corner detector finds something to follow.
    #[must_use]
    pub fn richness(self) -> f64 {
        match self {
            Self::Plaster | Self::Ceiling => 0.15,
            Self::Curtain | Self::Mat => 0.35,
            Self::Floor | Self::Metal => 0.6,
            Self::Blocks | Self::Wood | Self::Cardboard => 0.8,
            Self::Poster | Self::Checkerboard | Self::Pallet => 1.0,
        }
    }
}

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
        Self { floor_center_m: Vector3::new((low.x + high.x) * 0.5, (low.y + high.y) * 0.5, floor), size_m: size, boxes, clearance_m: 0.5 }
    }
}

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

    /// Floor, ceiling and four walls, seen from within.
    fn shell(&mut self, config: &RoomConfig, random: &mut Random) {
        let half = config.size_m * 0.5;
        let base = config.floor_center_m;
        let (x, y, z) = (Vector3::x() * config.size_m.x, Vector3::y() * config.size_m.y, Vector3::z() * config.size_m.z);
        let low = base - Vector3::new(half.x, half.y, 0.0);
        let mut walls = [Material::Curtain, Material::Plaster, Material::Blocks, Material::Wood];
        for k in (1..walls.len()).rev() {
            walls.swap(k, random.below(k + 1));
        }
        self.quads.push(Quad::new(low, x, y, Material::Floor));
        self.quads.push(Quad::new(low + z, y, x, Material::Ceiling));
        // u runs to the right and v upwards for an onlooker within.
        self.quads.push(Quad::new(low + y, x, z, walls[0]));
        self.quads.push(Quad::new(low + x, -x, z, walls[1]));
        self.quads.push(Quad::new(low, y, z, walls[2]));
        self.quads.push(Quad::new(low + x + y, -y, z, walls[3]));
    }

    /// A box from its middle, half sizes and rotation. All six sides, so that leaning ones show their underside too.
    fn add_box(&mut self, center: Vector3<f64>, half: Vector3<f64>, rotation: &Rotation3<f64>, material: Material) {
        let axes = [0, 1, 2].map(|k| rotation * (Vector3::ith(k, 1.0)));
        for k in 0..3 {
            for sign in [1.0, -1.0] {
                let normal = axes[k] * sign;
                // (u, v, n) right-handed, with v upwards on the upright sides.
                let (u, v, half_u, half_v) = if k == 2 {
                    (axes[0], axes[1] * sign, half[0], half[1])
                } else {
                    (axes[2].cross(&normal), axes[2], half[1 - k], half[2])
                };
                let corner = center + normal * half[k] - u * half_u - v * half_v;
                self.quads.push(Quad::new(corner, u * (2.0 * half_u), v * (2.0 * half_v), material));
            }
        }
    }

    fn furnish(&mut self, config: &RoomConfig, path: &[Vector3<f64>], random: &mut Random) {
        let floor = config.floor_center_m.z;
        let half = config.size_m * 0.5;
        // A hall holds larger things.
        let scale = (config.size_m.x.min(config.size_m.y) / 8.0).clamp(0.5, 3.0);
        let is_free = |center: &Vector3<f64>, radius: f64, height: f64| {
            path.iter().all(|point| {
                let across = (point - center).xy().norm();
                across > radius + config.clearance_m || point.z > floor + height + config.clearance_m
            })
        };
        // Mats lie on the floor.
        for _ in 0..5 {
            let size = Vector3::new(random.between(0.8, 1.1), random.between(0.5, 0.8), 0.025) * scale;
            let at = self.place(config, random, size.xy().norm());
            let center = Vector3::new(at.x, at.y, floor + size.z);
            if is_free(&center, size.xy().norm(), 2.0 * size.z) {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), random.between(-0.5, 0.5));
                self.add_box(center, size, &turn, Material::Mat);
            }
        }
        // Boxes, crates and cabinets stand about, rather along the walls.
        let materials = [Material::Cardboard, Material::Wood, Material::Metal, Material::Pallet, Material::Cardboard, Material::Blocks];
        let mut placed = 0;
        for _ in 0..config.boxes * 30 {
            if placed == config.boxes {
                break;
            }
            let size = Vector3::new(random.between(0.15, 0.5), random.between(0.15, 0.45), random.between(0.15, 0.75)) * scale;
            let at = self.place(config, random, size.xy().norm());
            let center = Vector3::new(at.x, at.y, floor + size.z);
            if is_free(&center, size.xy().norm(), 2.0 * size.z) {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), random.between(-1.5, 1.5));
                self.add_box(center, size, &turn, materials[placed % materials.len()]);
                placed += 1;
            }
        }
        // Boards hang on the walls and lean against them.
        let boards = [Material::Poster, Material::Checkerboard, Material::Poster, Material::Wood, Material::Poster, Material::Metal];
        for k in 0..12 {
            let material = boards[k % boards.len()];
            let side = k % 4;
            let (width, height, depth) = match material {
                Material::Checkerboard => (0.45, 0.35, 0.01),
                Material::Poster => (random.between(0.35, 0.6), random.between(0.4, 0.7), 0.008),
                _ => (random.between(0.3, 0.8), random.between(0.4, 0.9), 0.02),
            };
            let (width, height) = (width * scale, height * scale);
            let (sine, cosine) = (f64::from(u8::try_from(side).unwrap_or(0)) * std::f64::consts::FRAC_PI_2).sin_cos();
            let along = random.between(-0.85, 0.85);
            let outward = Vector3::new(cosine.round(), sine.round(), 0.0);
            let sideways = Vector3::new(-sine.round(), cosine.round(), 0.0);
            let reach = half.component_mul(&outward).norm();
            let span = half.component_mul(&sideways).norm() - width;
            let lift = random.between(height, (config.size_m.z - height).max(height + 0.1) * 0.8);
            let center = config.floor_center_m + outward * (reach - depth - 0.005) + sideways * (along * span) + Vector3::z() * lift;
            if is_free(&center, width, 2.0 * config.size_m.z) {
                // The board's z is up, its x faces the room.
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), sine.atan2(cosine) + std::f64::consts::PI);
                self.add_box(center, Vector3::new(depth, width, height), &turn, material);
            }
        }
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn room() -> (RoomConfig, Scene) {
        let path = [Vector3::new(0.0, 0.0, 1.0), Vector3::new(1.0, -1.0, 2.0)];
        let config = RoomConfig::vicon(&path);
        let scene = Scene::room(&config, &path, 3).unwrap();
        (config, scene)
    }

    #[test]
    fn a_room_is_closed_and_boxes_face_outwards() {
        let (_, scene) = room();
        let mut random = Random::new(1, "rays");
        for _ in 0..2000 {
            let direction = random.normal3();
            let hit = scene.cast(&Vector3::new(0.5, -0.5, 1.5), &direction).unwrap();
            let quad = &scene.quads[hit.quad];
            let point = Vector3::new(0.5, -0.5, 1.5) + direction * hit.distance;
            assert!((quad.normal.dot(&point) - quad.offset_m()).abs() < 1e-9);
            assert!((quad.point(hit.place_m[0], hit.place_m[1]) - point).norm() < 1e-9);
            assert!(quad.normal.dot(&direction) < 0.0);
            assert!((quad.axis_u.cross(&quad.axis_v) - quad.normal).norm() < 1e-12);
        }
    }

    #[test]
    fn the_six_sides_of_a_box_bound_its_volume() {
        let mut scene = Scene { quads: Vec::new() };
        let half = Vector3::new(0.2, 0.3, 0.5);
        let center = Vector3::new(1.0, 2.0, 3.0);
        scene.add_box(center, half, &Rotation3::from_euler_angles(0.3, -0.7, 1.1), Material::Wood);
        // Divergence theorem: Σ area · nᵀ(x − c) = 3 V.
        let flux: f64 = scene.quads.iter().map(|quad| quad.size_m[0] * quad.size_m[1] * quad.normal.dot(&(quad.corner - center))).sum();
        assert!((flux - 3.0 * 8.0 * 0.2 * 0.3 * 0.5).abs() < 1e-12);
    }

    #[test]
    fn what_stands_behind_something_is_not_clear() {
        let (_, scene) = room();
        let eye = Vector3::new(0.5, -0.5, 1.5);
        let hit = scene.cast(&eye, &Vector3::new(1.0, 0.2, -0.4)).unwrap();
        let on_it = eye + Vector3::new(1.0, 0.2, -0.4) * hit.distance;
        let behind_it = eye + Vector3::new(1.0, 0.2, -0.4) * (hit.distance * 1.1);
        assert!(scene.is_clear(&eye, &on_it, 1e-6) && !scene.is_clear(&eye, &behind_it, 1e-6));
    }

    #[test]
    fn things_keep_clear_of_the_path() {
        let path: Vec<_> =
            (0..50).map(|k| Vector3::new((f64::from(k) * 0.2).sin() * 2.0, (f64::from(k) * 0.13).cos() * 2.0, 1.2)).collect();
        for seed in 0..5 {
            let scene = Scene::room(&RoomConfig::vicon(&path), &path, seed).unwrap();
            assert!(scene.quads.len() > 40);
            for pair in path.windows(2) {
                assert!(scene.is_clear(&pair[0], &pair[1], 0.0));
            }
        }
    }

    #[test]
    fn refuses_a_room_without_height() {
        let config = RoomConfig { size_m: Vector3::new(8.0, 8.0, 0.0), ..RoomConfig::vicon(&[]) };
        let message = Scene::room(&config, &[], 1).unwrap_err().to_string();
        assert!(message.contains("size_m.z") && message.contains("2 to 100"), "{message}");
    }
}
