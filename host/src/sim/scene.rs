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
    /// Printed picture on the floor.
    PlayMat,
    /// Black strip with white patches.
    Tape,
    /// Bright panes in a dark frame: shines.
    Window,
    /// Ribbed heater.
    Radiator,
}

impl Material {
    /// All of them.
    pub const ALL: [Self; 16] = [
        Self::Floor,
        Self::Plaster,
        Self::Blocks,
        Self::Curtain,
        Self::Wood,
        Self::Mat,
        Self::Poster,
        Self::Checkerboard,
        Self::Pallet,
        Self::Cardboard,
        Self::Metal,
        Self::Ceiling,
        Self::PlayMat,
        Self::Tape,
        Self::Window,
        Self::Radiator,
    ];

    /// Name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Floor => "floor",
            Self::Plaster => "plaster",
            Self::Blocks => "blocks",
            Self::Curtain => "curtain",
            Self::Wood => "wood",
            Self::Mat => "mat",
            Self::Poster => "poster",
            Self::Checkerboard => "checkerboard",
            Self::Pallet => "pallet",
            Self::Cardboard => "cardboard",
            Self::Metal => "metal",
            Self::Ceiling => "ceiling",
            Self::PlayMat => "play_mat",
            Self::Tape => "tape",
            Self::Window => "window",
            Self::Radiator => "radiator",
        }
    }

    /// Light that it sends out itself at reflectance 1, in units of a lit white wall.
    #[must_use]
    pub fn glow(self) -> f32 {
        if self == Self::Window { 3.0 } else { 0.0 }
    }

    /// Share of spots where a corner detector finds something to follow.
    #[must_use]
    pub fn richness(self) -> f64 {
        match self {
            Self::Plaster | Self::Ceiling | Self::Window => 0.15,
            Self::Curtain | Self::Mat | Self::Radiator => 0.35,
            Self::Floor | Self::Metal => 0.6,
            Self::Blocks | Self::Wood | Self::Cardboard => 0.8,
            Self::Poster | Self::Checkerboard | Self::Pallet | Self::PlayMat | Self::Tape => 1.0,
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

/// Which side of a box nobody can see.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Hidden {
    /// It stands on the floor.
    Underside,
    /// It is close to a wall.
    Back,
    /// It is free on all sides.
    Nothing,
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
        let mut walls = [Material::Plaster, Material::Plaster, Material::Blocks, Material::Wood];
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

    /// A box from its middle, half sizes and rotation, without the sides that nobody can see.
    pub(super) fn add_box(
        &mut self,
        center: Vector3<f64>,
        half: Vector3<f64>,
        rotation: &Rotation3<f64>,
        material: Material,
        hidden: Hidden,
    ) {
        let axes = [0, 1, 2].map(|k| rotation * (Vector3::ith(k, 1.0)));
        for k in 0..3 {
            for sign in [1.0, -1.0] {
                if sign < 0.0 && (k == 2 && hidden == Hidden::Underside || k == 0 && hidden == Hidden::Back) {
                    continue;
                }
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
        // A hall holds larger things.
        let scale = (config.size_m.x.min(config.size_m.y) / 8.0).clamp(0.5, 3.0);
        let is_free = |center: &Vector3<f64>, radius: f64, height: f64| {
            path.iter().all(|point| {
                let across = (point - center).xy().norm();
                across > radius + config.clearance_m || point.z > floor + height + config.clearance_m
            })
        };
        // Pictures, strips of tape and a mat or two lie on the floor.
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
        // Boxes, crates and cabinets stand about, rather along the walls.
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
        for side in 0..4 {
            self.dress_wall(config, random, side, scale, &is_free);
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
        scene.add_box(center, half, &Rotation3::from_euler_angles(0.3, -0.7, 1.1), Material::Wood, Hidden::Nothing);
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
