//! Single views of many different rooms with their depth: what a depth network learns from.
//!
//! A flight shows one room for a minute; a network needs a thousand rooms. Each room here is drawn anew: a share are furnished
//! as the flights' Vicon rooms around a swept path, the others have any size from a chamber to a hall, and in half of them the
//! covers are exchanged or patched from tiles of other covers, and slabs and cabinets stand about at any angle. Cameras are
//! EuRoC's left one, or others like it, at a person's or a drone's height and tilt.

use libella_core::camera::{CameraModel, PinholeRadTan};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::photometry::PhotometryConfig;
use super::random::{Random, mix};
use super::render::{RenderConfig, Renderer, World};
use super::scene::{Hidden, Material, Quad, RoomConfig, Scene, box_sides};
use super::trajectory::{Motion, Trajectory};
use super::{SimError, euroc};
use crate::dataset::GrayImage;

/// Which views are wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoomsConfig {
    /// Views of each room; 1 to 10 000.
    pub views: usize,
    /// Size of the images, px; 64 to 2048, multiples of `stride`.
    pub size_px: [u32; 2],
    /// Pixels of the image per pixel of the depth map; 1 to 8.
    pub stride: u32,
    /// Share of rooms that are furnished as those of flights; 0 to 1.
    pub flight_share: f64,
    /// Whether focal length and distortion vary; otherwise they are EuRoC's. A varied focal length blurs the sizes of things:
    /// the network cannot tell it from the size of the room.
    pub varied_camera: bool,
    /// Threads; 1 to 256. The pictures do not depend on it.
    pub threads: usize,
}

impl Default for RoomsConfig {
    fn default() -> Self {
        Self {
            views: 24,
            size_px: [320, 192],
            stride: 4,
            flight_share: 0.6,
            varied_camera: false,
            threads: RenderConfig::default().threads,
        }
    }
}

impl RoomsConfig {
    /// Whether every parameter is within its range.
    ///
    /// # Errors
    /// The first that is not, named with its range.
    pub fn check(&self) -> Result<(), SimError> {
        SimError::check("rooms.views", self.views as f64, 1.0, 1e4)?;
        SimError::check("rooms.flight_share", self.flight_share, 0.0, 1.0)?;
        SimError::check("rooms.stride", f64::from(self.stride), 1.0, 8.0)?;
        SimError::check("rooms.threads", self.threads as f64, 1.0, 256.0)?;
        for side in self.size_px {
            SimError::check("rooms.size_px", f64::from(side), 64.0, 2048.0)?;
            SimError::check("rooms.size_px (rest of its division by the stride)", f64::from(side % self.stride), 0.0, 0.0)?;
        }
        Ok(())
    }
}

/// Share of the rooms of flights that are halls.
const HALL_SHARE: f64 = 0.2;
/// Share of the rooms with exchanged covers where all of those are printed: nothing there has a usual size but the room itself.
const PRINT_SHARE: f64 = 0.3;
const PRINTS: [Material; 3] = [Material::Poster, Material::PlayMat, Material::Cardboard];

/// One view of a room.
#[derive(Debug, Clone)]
pub struct RoomView {
    /// The raw, distorted picture.
    pub image: GrayImage,
    /// Depth along the optical axis, m, at the middle of every `stride × stride` block of pixels; 0 where there is nothing.
    pub depth_m: Vec<f64>,
    /// `fx / width, fy / height, (cx + ½) / width, (cy + ½) / height`.
    pub normalised_intrinsics: [f64; 4],
    /// `T_WC`.
    pub world_from_camera: Isometry3<f64>,
}

/// Renders the views of the room of a seed.
///
/// # Errors
/// A parameter out of range.
pub fn room_views(config: &RoomsConfig, seed: u64, mut each: impl FnMut(RoomView)) -> Result<(), SimError> {
    config.check()?;
    let mut random = Random::new(seed, "rooms");
    let (room, scene, path) = furnished(&mut random, config.flight_share, seed)?;
    // What is finer than half a pixel at a metre is not seen: texels as coarse as that save most of the baking.
    let coarseness = (752.0 / f64::from(config.size_px[0])).clamp(1.0, 2.0);
    let world = World::bake_coarsely(scene, Vec::new(), mix(seed ^ 0x51), config.threads, coarseness);
    let [zoom, bend] = if config.varied_camera { [random.between(0.9, 1.2), random.between(0.85, 1.05)] } else { [1.0; 2] };
    let photometry = PhotometryConfig {
        target_grey: random.between(70.0, 160.0),
        control: random.between(0.3, 0.8),
        vignetting: random.between(0.0, 0.45),
        read_noise: random.between(0.3, 2.5),
        shot_noise: random.between(0.0, 0.03),
    };
    let render = RenderConfig { exposure_s: random.between(0.001, 0.012), photometry, threads: config.threads };
    let body_from_camera = Isometry3::identity();
    let camera = scaled_camera(config.size_px, zoom, bend);
    let small = scaled_camera(config.size_px.map(|side| side / config.stride), zoom, bend);
    let normalised = normalised_intrinsics(&camera);
    let pictures = Renderer::new(&world, &CameraModel::PinholeRadTan(camera), &body_from_camera, &render, seed)?;
    let depths = Renderer::new(&world, &CameraModel::PinholeRadTan(small), &body_from_camera, &render, seed)?;
    for index in 0..config.views {
        let glide = glide(&mut random, &room, &world.scene, &path);
        let image = pictures.image(&glide, 0.0, index as u64);
        let depth_m = depths.depth(&glide.world_from_camera, 0.0).depth_m;
        each(RoomView { image, depth_m, normalised_intrinsics: normalised, world_from_camera: glide.world_from_camera });
    }
    Ok(())
}

/// EuRoC's left camera with another focal length, on an image of another size; pixel centres lie at whole numbers.
fn scaled_camera(size_px: [u32; 2], zoom: f64, bend: f64) -> PinholeRadTan<f64> {
    let usual = euroc::pinhole(0);
    let scale = [f64::from(size_px[0]) / f64::from(usual.size_px.0), f64::from(size_px[1]) / f64::from(usual.size_px.1)];
    PinholeRadTan {
        size_px: (size_px[0], size_px[1]),
        focal_px: [usual.focal_px[0] * scale[0] * zoom, usual.focal_px[1] * scale[1] * zoom],
        center_px: [(usual.center_px[0] + 0.5) * scale[0] - 0.5, (usual.center_px[1] + 0.5) * scale[1] - 0.5],
        distortion: usual.distortion.map(|value| value * bend),
    }
}

fn normalised_intrinsics(camera: &PinholeRadTan<f64>) -> [f64; 4] {
    let (width, height) = (f64::from(camera.size_px.0), f64::from(camera.size_px.1));
    let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.center_px);
    [fx / width, fy / height, (cx + 0.5) / width, (cy + 0.5) / height]
}

/// A room, what is in it and where cameras go (nothing: anywhere).
fn furnished(random: &mut Random, flight_share: f64, seed: u64) -> Result<(RoomConfig, Scene, Vec<Vector3<f64>>), SimError> {
    if random.unit() < flight_share {
        let in_hall = random.unit() < HALL_SHARE;
        let stretch = if in_hall { random.between(1.5, 3.5) } else { 1.0 };
        let path = swept_path(random, stretch);
        let room = if in_hall { RoomConfig::hall(&path) } else { RoomConfig::vicon(&path) };
        let mut scene = Scene::room(&room, &path, mix(seed))?;
        if random.unit() < 0.25 {
            vary(&mut scene, random);
        }
        return Ok((room, scene, path));
    }
    let size = if random.unit() < 0.9 {
        Vector3::new(random.between(3.6, 11.0), random.between(3.6, 11.0), random.between(2.3, 4.6))
    } else {
        Vector3::new(random.between(12.0, 26.0), random.between(12.0, 24.0), random.between(4.0, 9.0))
    };
    let boxes = random.below(28);
    let room = RoomConfig { floor_center_m: Vector3::zeros(), size_m: size, boxes, clearance_m: random.between(0.3, 0.9), is_bare: false };
    // Something stays open in the middle.
    let open = [Vector3::new(0.2 * size.x * random.between(-1.0, 1.0), 0.2 * size.y * random.between(-1.0, 1.0), 1.2)];
    let mut scene = Scene::room(&room, &open, mix(seed))?;
    if random.unit() < 0.6 {
        vary(&mut scene, random);
    }
    if random.unit() < 0.5 {
        clutter(&mut scene, &room, random);
    }
    Ok((room, scene, Vec::new()))
}

/// The way of a flight, `stretch` times as far as in a Vicon room: sums of two sinusoids per axis, as the analytic motions are. Now and
/// then it starts or ends near the floor.
fn swept_path(random: &mut Random, stretch: f64) -> Vec<Vector3<f64>> {
    let (height, climb) = (random.between(0.9, 1.8) * stretch.sqrt(), random.between(0.2, 0.8) * stretch);
    let mut axis = |middle: f64, reach: f64| {
        let parts = [0, 1].map(|_| (random.between(0.3, 1.0) * reach, random.between(0.2, 1.2), random.between(0.0, 6.3)));
        move |time: f64| middle + parts.iter().map(|(size, rate, phase)| 0.6 * size * (rate * time + phase).sin()).sum::<f64>()
    };
    let (x, y, z) = (axis(0.0, 2.6 * stretch), axis(0.0, 2.6 * stretch), axis(height, climb));
    (0..150).map(|k| f64::from(k) * 0.4).map(|time| Vector3::new(x(time), y(time), z(time).max(0.36))).collect()
}

/// Exchanges covers, and patches some of the large rectangles from tiles.
fn vary(scene: &mut Scene, random: &mut Random) {
    let share = random.between(0.1, 1.0);
    // A few covers per room, so that rooms differ from each other and not only pieces within them.
    let covers: &[Material] = if random.unit() < PRINT_SHARE { &PRINTS } else { &Material::ALL };
    let palette: Vec<Material> = (0..1 + random.below(5)).map(|_| covers[random.below(covers.len())]).collect();
    let mut quads = Vec::with_capacity(scene.quads.len());
    for mut quad in scene.quads.drain(..) {
        if quad.material == Material::Checkerboard || random.unit() > share {
            quads.push(quad);
            continue;
        }
        quad.material = palette[random.below(palette.len())];
        if quad.size_m[0] * quad.size_m[1] > 6.0 && random.unit() < 0.6 {
            quads.extend(tiles(&quad, random));
        } else {
            quads.push(quad);
        }
    }
    // The cover of a checkerboard has a fixed number of texels: no wall is made of it.
    quads.iter_mut().filter(|quad| quad.material == Material::Checkerboard && quad.size_m[0] > 2.0).for_each(|quad| {
        quad.material = Material::PlayMat;
    });
    scene.quads = quads;
}

/// The same rectangle from pieces of 1 to 3 m, each painted for itself.
fn tiles(quad: &Quad, random: &mut Random) -> Vec<Quad> {
    let piece_m = random.between(1.0, 3.0).max((quad.size_m[0] * quad.size_m[1] / 60.0).sqrt());
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let counts = quad.size_m.map(|side| (side / piece_m).ceil().max(1.0) as usize);
    let step = [0, 1].map(|k| quad.size_m[k] / counts[k] as f64);
    let at = |column: usize, row: usize| quad.point(column as f64 * step[0], row as f64 * step[1]);
    let (side_u, side_v) = (quad.axis_u * step[0], quad.axis_v * step[1]);
    (0..counts[1])
        .flat_map(|row| (0..counts[0]).map(move |column| (column, row)))
        .map(|(column, row)| Quad::new(at(column, row), side_u, side_v, quad.material))
        .collect()
}

/// Slabs, cabinets and boxes at any angle and height.
fn clutter(scene: &mut Scene, room: &RoomConfig, random: &mut Random) {
    for _ in 0..1 + random.below(8) {
        let mut half = Vector3::new(random.between(0.1, 0.7), random.between(0.1, 0.7), random.between(0.1, 1.0));
        if random.unit() < 0.4 {
            half[random.below(3)] = 0.03;
        }
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), random.between(-3.1, 3.1));
        let tilted = random.unit() < 0.35;
        let turn =
            if tilted { turn * Rotation3::from_euler_angles(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.0) } else { turn };
        let lift = if random.unit() < 0.6 && !tilted { half.z } else { random.between(0.2, 0.8 * room.size_m.z) };
        let spread = room.size_m * 0.45;
        let place = Vector3::new(spread.x * random.between(-1.0, 1.0), spread.y * random.between(-1.0, 1.0), lift);
        let material = Material::ALL[random.below(Material::ALL.len())];
        let material = if material == Material::Checkerboard { Material::Poster } else { material };
        scene.quads.extend(box_sides(room.floor_center_m + place, half, &turn, material, Hidden::Nothing));
    }
}

/// A camera that moves a little during the exposure.
struct Glide {
    world_from_camera: Isometry3<f64>,
    velocity_in_world: Vector3<f64>,
    rate_in_camera: Vector3<f64>,
}

impl Trajectory for Glide {
    fn at(&self, seconds: f64) -> Motion {
        Motion {
            world_from_body: self.world_from_camera.rotation * UnitQuaternion::from_scaled_axis(self.rate_in_camera * seconds),
            position_in_world: self.world_from_camera.translation.vector + self.velocity_in_world * seconds,
            velocity_in_world: self.velocity_in_world,
            acceleration_in_world: Vector3::zeros(),
            rate_in_body: self.rate_in_camera,
        }
    }

    fn duration_s(&self) -> f64 {
        1.0
    }
}

/// A place in the open and a direction to look.
fn glide(random: &mut Random, room: &RoomConfig, scene: &Scene, path: &[Vector3<f64>]) -> Glide {
    let mut pose = Isometry3::identity();
    for _ in 0..400 {
        let position = if path.is_empty() {
            let reach = (room.size_m * 0.5).add_scalar(-0.4);
            let height = if random.unit() < 0.8 { random.between(0.6, 2.0) } else { random.between(0.3, room.size_m.z - 0.5) };
            let height = height.min(room.size_m.z - 0.4);
            room.floor_center_m + Vector3::new(reach.x * random.between(-1.0, 1.0), reach.y * random.between(-1.0, 1.0), height)
        } else {
            path[random.below(path.len())]
        };
        pose = Isometry3::from_parts(position.into(), view_direction(random));
        let above = Vector3::new(position.x, position.y, room.floor_center_m.z + room.size_m.z - 0.02);
        let open = |x: f64, y: f64| {
            let ray = pose.rotation * Vector3::new(x, y, 1.0);
            scene.cast(&position, &ray).is_some_and(|hit| hit.distance > 0.3)
        };
        let seen = [-0.75, 0.0, 0.75].iter().all(|x| [-0.5, 0.0, 0.5].iter().all(|y| open(*x, *y)));
        // Nothing above, or it is within a box: boxes are open from inside.
        if seen && open(0.0, 0.0) && scene.is_clear(&above, &position, 0.0) {
            break;
        }
    }
    let (speed, turning) = (random.between(0.0, 0.5), random.exponential(0.25).min(2.0));
    Glide { world_from_camera: pose, velocity_in_world: random.normal3() * speed, rate_in_camera: random.normal3() * turning }
}

/// `R_WC`: any heading; half of the tilts are those of EuRoC's flights, whose camera looks down by 20 degrees.
fn view_direction(random: &mut Random) -> UnitQuaternion<f64> {
    let yaw = random.between(0.0, std::f64::consts::TAU);
    let kind = random.unit();
    let (pitch, roll) = if kind < 0.5 {
        (-20.0 + 5.0 * random.normal(), 3.0 * random.normal())
    } else if kind < 0.85 {
        (-5.0 + 12.0 * random.normal(), 6.0 * random.normal())
    } else {
        (-10.0 + 22.0 * random.normal(), 18.0 * random.normal())
    };
    let (pitch, roll) = (pitch.clamp(-75.0, 60.0).to_radians(), roll.to_radians());
    let forward = Vector3::new(pitch.cos() * yaw.cos(), pitch.cos() * yaw.sin(), pitch.sin());
    let right = forward.cross(&Vector3::z()).normalize();
    let level = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(level))
        * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn views(seed: u64, threads: usize) -> Vec<RoomView> {
        let config = RoomsConfig { views: 3, size_px: [160, 96], threads, ..RoomsConfig::default() };
        let mut views = Vec::new();
        room_views(&config, seed, |view| views.push(view)).unwrap();
        views
    }

    #[test]
    fn a_view_is_a_function_of_the_seed_and_shows_depth_everywhere() {
        for seed in [1, 2] {
            let (one, other) = (views(seed, 1), views(seed, 2));
            assert_eq!(one.len(), 3);
            for (a, b) in one.iter().zip(&other) {
                assert_eq!(a.image.pixels, b.image.pixels);
                assert_eq!(a.depth_m.len(), 40 * 24);
                // A closed room: a wall behind every pixel, none closer than a hand or further than the longest diagonal.
                assert!(a.depth_m.iter().all(|depth| (0.05..40.0).contains(depth)), "seed {seed}");
            }
        }
        assert_ne!(views(1, 1)[0].image.pixels, views(2, 1)[0].image.pixels);
    }

    #[test]
    fn tiles_cover_exactly_what_they_replace() {
        let quad = Quad::new(Vector3::new(1.0, 2.0, 0.0), Vector3::x() * 7.3, Vector3::y() * 4.1, Material::Floor);
        let mut random = Random::new(4, "tiles");
        let tiles = tiles(&quad, &mut random);
        let area: f64 = tiles.iter().map(|tile| tile.size_m[0] * tile.size_m[1]).sum();
        assert!((area - 7.3 * 4.1).abs() < 1e-9);
        for _ in 0..500 {
            let origin = Vector3::new(random.between(1.01, 8.29), random.between(2.01, 6.09), 1.0);
            let hits = tiles.iter().filter(|tile| tile.intersect(&origin, &-Vector3::z()).is_some()).count();
            assert_eq!(hits, 1);
        }
    }

    #[test]
    fn a_view_without_roll_has_its_horizon_level() {
        let mut random = Random::new(9, "tilt");
        let rotations: Vec<_> = (0..400).map(|_| view_direction(&mut random)).collect();
        // Orthonormal and right-handed, and on average the image's y points down.
        assert!(rotations.iter().all(|r| (r.to_rotation_matrix().matrix().determinant() - 1.0).abs() < 1e-9));
        let down = rotations.iter().map(|r| -(r * Vector3::y()).z).sum::<f64>() / 400.0;
        assert!(down > 0.8, "{down}");
    }

    #[test]
    fn refuses_a_size_that_the_stride_does_not_divide() {
        let config = RoomsConfig { size_px: [322, 192], ..RoomsConfig::default() };
        assert!(room_views(&config, 1, |_| ()).unwrap_err().to_string().contains("stride"));
    }
}
