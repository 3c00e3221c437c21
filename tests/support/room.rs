//! A textured room and a rig that moves through it: images, corners and inertial samples that agree with one another.
//!
//! # Model
//! The room is the box `|x| ≤ 3`, `|y| ≤ 2.5`, `0 ≤ z ≤ 3` (m), seen from inside, so nothing hides anything. The body
//! moves on sines whose derivatives are exact; with `R_WB = R_z(yaw) R_y(pitch)` it measures
//! ```text
//! ω_B = ( −sin(pitch) yaw',  pitch',  cos(pitch) yaw' )      rad/s
//! f_B = R_WBᵀ ( p'' − g_W )                                  m/s²
//! ```
#![allow(dead_code)] // each test reads its own part

use libella_core::camera::{Camera, CameraModel, PinholeRadTan};
use libella_core::imu::ImuSample;
use libella_core::time::Timestamp;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

/// Image width and height, px: those of EuRoC.
pub const WIDTH: usize = 752;
pub const HEIGHT: usize = 480;
/// Time between inertial samples (200 Hz) and between images (20 Hz).
pub const IMU_STEP_NS: i64 = 5_000_000;
pub const IMAGE_STEP_NS: i64 = 50_000_000;
/// The clock of the recording does not start at zero.
const EPOCH_NS: i64 = 1_403_636_579_000_000_000;
pub const GRAVITY_M_S2: f64 = 9.81;

const LOW_CORNER_M: [f64; 3] = [-3.0, -2.5, 0.0];
const HIGH_CORNER_M: [f64; 3] = [3.0, 2.5, 3.0];

/// `amplitude · sin(rate · t + phase)` with its derivatives.
struct Sine {
    amplitude: f64,
    rate_rad_s: f64,
    phase: f64,
}

impl Sine {
    const fn new(amplitude: f64, rate_rad_s: f64, phase: f64) -> Self {
        Self { amplitude, rate_rad_s, phase }
    }
    fn value(&self, t: f64) -> f64 {
        self.amplitude * (self.rate_rad_s * t + self.phase).sin()
    }
    fn first(&self, t: f64) -> f64 {
        self.amplitude * self.rate_rad_s * (self.rate_rad_s * t + self.phase).cos()
    }
    fn second(&self, t: f64) -> f64 {
        -self.rate_rad_s * self.rate_rad_s * self.value(t)
    }
}

// About 1 m/s and 2 m/s² at most: enough for scale, slow enough for a tracker at 20 Hz.
const POSITION_M: [Sine; 3] = [Sine::new(0.5, 1.7, 0.3), Sine::new(0.7, 1.3, 1.1), Sine::new(0.3, 2.1, 0.0)];
const YAW: Sine = Sine::new(0.25, 0.9, 0.2);
const PITCH: Sine = Sine::new(0.10, 1.3, 0.0);
/// Height about which the body moves, m.
const HEIGHT_M: f64 = 1.4;

/// The instant `nanos` after the start.
pub fn stamp(nanos: i64) -> Timestamp {
    Timestamp::from_nanos(EPOCH_NS + nanos)
}

fn seconds(nanos: i64) -> f64 {
    nanos as f64 * 1e-9
}

/// `T_WB` at `nanos` after the start.
pub fn world_from_body(nanos: i64) -> Isometry3<f64> {
    let t = seconds(nanos);
    let rotation =
        Rotation3::from_axis_angle(&Vector3::z_axis(), YAW.value(t)) * Rotation3::from_axis_angle(&Vector3::y_axis(), PITCH.value(t));
    let [x, y, z] = POSITION_M.map(|sine| sine.value(t));
    Isometry3::from_parts(Translation3::new(x, y, z + HEIGHT_M), UnitQuaternion::from_rotation_matrix(&rotation))
}

/// What a perfect IMU reads at `nanos` after the start.
pub fn imu_sample(nanos: i64) -> ImuSample<f64> {
    let t = seconds(nanos);
    let (sin_pitch, cos_pitch) = PITCH.value(t).sin_cos();
    let yaw_rate = YAW.first(t);
    let [x, y, z] = POSITION_M.map(|sine| sine.second(t));
    ImuSample {
        stamp: stamp(nanos),
        gyro_rad_s: Vector3::new(-sin_pitch * yaw_rate, PITCH.first(t), cos_pitch * yaw_rate),
        accel_m_s2: world_from_body(nanos).rotation.inverse() * Vector3::new(x, y, z + GRAVITY_M_S2),
    }
}

/// The camera looks along the body's x axis, 5 cm in front of the IMU.
pub fn body_from_camera() -> Isometry3<f64> {
    let axes = Matrix3::from_columns(&[-Vector3::y(), -Vector3::z(), Vector3::x()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(Translation3::new(0.05, 0.0, 0.0), rotation)
}

/// EuRoC's cam0.
pub fn camera() -> CameraModel<f64> {
    CameraModel::PinholeRadTan(PinholeRadTan {
        size_px: (WIDTH as u32, HEIGHT as u32),
        focal_px: [458.654, 457.296],
        center_px: [367.215, 248.375],
        distortion: [-0.283_408_11, 0.073_959_07, 0.000_193_59, 1.761_871_14e-5],
    })
}

/// Where a ray from inside leaves the room, and which of the six faces that is.
fn face_hit(origin: &Vector3<f64>, direction: &Vector3<f64>) -> (usize, Vector3<f64>) {
    let mut nearest = (f64::INFINITY, 0);
    for axis in 0..3 {
        let ahead = direction[axis] > 0.0;
        let wall = if ahead { HIGH_CORNER_M[axis] } else { LOW_CORNER_M[axis] };
        let distance = (wall - origin[axis]) / direction[axis];
        if distance < nearest.0 {
            nearest = (distance, 2 * axis + usize::from(ahead));
        }
    }
    (nearest.1, origin + direction * nearest.0)
}

/// How far a point on a wall is from the nearest edge of the room, m: the second smallest of its distances to walls.
pub fn distance_to_edge_m(point_on_wall: &Vector3<f64>) -> f64 {
    let mut distances = [0, 1, 2].map(|axis| (point_on_wall[axis] - LOW_CORNER_M[axis]).min(HIGH_CORNER_M[axis] - point_on_wall[axis]));
    distances.sort_by(f64::total_cmp);
    distances[1]
}

/// A grey level of a lattice point, 0 to 1.
fn lattice(face: usize, u: i64, v: i64) -> f64 {
    let mut hash = (u as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (v as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f) ^ (face as u64 + 1);
    hash = (hash ^ (hash >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (hash >> 40) as f64 / (1_u64 << 24) as f64
}

/// Smooth noise with cells of the given size.
fn noise(face: usize, u: f64, v: f64, cell_m: f64) -> f64 {
    let (u, v) = (u / cell_m, v / cell_m);
    let (column, row) = (u.floor(), v.floor());
    let smooth = |x: f64| x * x * (3.0 - 2.0 * x);
    let (a, b) = (smooth(u - column), smooth(v - row));
    let at = |i: i64, j: i64| lattice(face, column as i64 + i, row as i64 + j);
    (1.0 - b) * ((1.0 - a) * at(0, 0) + a * at(1, 0)) + b * ((1.0 - a) * at(0, 1) + a * at(1, 1))
}

/// Grey level of the room in a direction, 0 to 255.
pub fn grey(origin: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
    let (face, point) = face_hit(origin, direction);
    let (u, v) = match face / 2 {
        0 => (point.y, point.z),
        1 => (point.x, point.z),
        _ => (point.x, point.y),
    };
    // Cells of 5 to 9 px at 3 m for the corners, of 40 px for the coarse levels of a pyramid.
    30.0 + 195.0 * (0.7 * noise(face, u, v, 0.06) + 0.3 * noise(face, u, v, 0.27))
}

/// Renders the room; the bearings of all pixels are computed once.
pub struct Renderer {
    bearings_in_camera: Vec<Vector3<f64>>,
}

impl Renderer {
    pub fn new() -> Self {
        let camera = camera();
        let bearing = |index: usize| {
            let pixel = Vector2::new((index % WIDTH) as f64, (index / WIDTH) as f64);
            camera.unproject(&pixel).unwrap_or_else(|| panic!("pixel {pixel:?} of EuRoC's camera has no bearing"))
        };
        Self { bearings_in_camera: (0..WIDTH * HEIGHT).map(bearing).collect() }
    }

    /// The image at `nanos` after the start, row by row.
    pub fn image(&self, nanos: i64) -> Vec<u8> {
        let world_from_camera = world_from_body(nanos) * body_from_camera();
        let rotation = world_from_camera.rotation.to_rotation_matrix();
        let origin = world_from_camera.translation.vector;
        self.bearings_in_camera.iter().map(|bearing| grey(&origin, &(rotation * bearing)).round() as u8).collect()
    }
}

/// The pixel of a point at `nanos` after the start, while it is in the image.
pub fn pixel_of(point_in_world: &Vector3<f64>, nanos: i64) -> Option<Vector2<f64>> {
    let world_from_camera = world_from_body(nanos) * body_from_camera();
    let point_in_camera = world_from_camera.inverse_transform_point(&(*point_in_world).into());
    let pixel = camera().project(&point_in_camera.coords)?;
    let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x <= (WIDTH - 1) as f64 && pixel.y <= (HEIGHT - 1) as f64;
    inside.then_some(pixel)
}

/// Points all over the walls, where rays from the middle of the room in evenly spread directions end.
pub fn landmarks(count: usize) -> Vec<Vector3<f64>> {
    let middle = Vector3::new(0.0, 0.0, HEIGHT_M);
    let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let direction = |index: usize| {
        let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
        let (sin, cos) = (golden_angle * index as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        Vector3::new(radius * cos, radius * sin, z)
    };
    (0..count).map(|index| face_hit(&middle, &direction(index)).1).collect()
}
