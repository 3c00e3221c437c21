//! A hand-held camera with an inertial measurement unit among points, truth known exactly.

use std::vec::Vec;

use nalgebra::{Isometry3, Matrix3, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector3};

use crate::imu::{ImuBias, NavState};
use crate::init::{Bearings, InertialLink};
use crate::lie::so3;

pub const GRAVITY: f64 = 9.81;
const FOCAL_PX: f64 = 458.0;

#[derive(Clone, Copy, PartialEq)]
pub enum Kind {
    HandHeld,
    PureRotation,
    ConstantVelocity,
    Still,
}

#[derive(Clone, Copy)]
pub struct Setup {
    pub kind: Kind,
    pub seed: u64,
    pub span_s: f64,
    pub frames: usize,
    pub points: usize,
    pub noise_px: f64,
    pub outliers: f64,
    /// Standard noise densities of the inertial samples, times this.
    pub imu_noise: f64,
}

impl Default for Setup {
    fn default() -> Self {
        Self { kind: Kind::HandHeld, seed: 0, span_s: 2.0, frames: 11, points: 150, noise_px: 0.5, outliers: 0.1, imu_noise: 1.0 }
    }
}

/// xorshift64*, and Box-Muller on top.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self((seed + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15))
    }
    pub fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1_u64 << 53) as f64
    }
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    pub fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (core::f64::consts::TAU * self.unit()).cos()
    }
    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }
}

/// Two sinusoids per axis, and their derivatives.
struct Wave {
    terms: [[(f64, f64, f64); 2]; 3],
}

impl Wave {
    fn new(random: &mut Random, amplitude: f64) -> Self {
        let terms = core::array::from_fn(|_| {
            core::array::from_fn(|i| {
                let hz = if i == 0 { random.between(0.35, 0.7) } else { random.between(0.7, 1.3) };
                let share = if i == 0 { 1.0 } else { 0.4 };
                (random.between(0.6, 1.2) * amplitude * share, core::f64::consts::TAU * hz, random.between(0.0, 6.3))
            })
        });
        Self { terms }
    }
    /// The `order`-th derivative.
    fn at(&self, time: f64, order: i32) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| {
            self.terms[axis]
                .iter()
                .map(|(a, w, phase)| a * w.powi(order) * (w * time + phase + f64::from(order) * core::f64::consts::FRAC_PI_2).sin())
                .sum()
        })
    }
}

pub struct World {
    pub links: Vec<InertialLink<f64>>,
    pub truth: Vec<NavState<f64>>,
    pub bias: ImuBias<f64>,
    pub body_from_camera: Isometry3<f64>,
    pub bearings: Vec<Vec<Option<Vector3<f64>>>>,
    /// Distance of every landmark from every camera, m.
    pub distances: Vec<Vec<f64>>,
}

impl Bearings<f64> for World {
    fn landmark_count(&self) -> usize {
        self.bearings.len()
    }
    fn bearing(&self, landmark: usize, frame: usize) -> Option<Vector3<f64>> {
        self.bearings[landmark][frame]
    }
}

/// Angular rate and specific force, raw.
pub type Reading = (Vector3<f64>, Vector3<f64>);

/// Midpoint integration of raw readings at equal intervals.
fn integrate(readings: &[Reading], step_s: f64, bias: &ImuBias<f64>) -> (UnitQuaternion<f64>, Vector3<f64>, Vector3<f64>) {
    let (mut rotation, mut velocity, mut position) = (UnitQuaternion::identity(), Vector3::zeros(), Vector3::zeros());
    for pair in readings.windows(2) {
        let rate = (pair[0].0 + pair[1].0) * 0.5 - bias.gyro_rad_s;
        let next = rotation * so3::exp(&(rate * step_s));
        let force = (rotation * (pair[0].1 - bias.accel_m_s2) + next * (pair[1].1 - bias.accel_m_s2)) * 0.5;
        position += velocity * step_s + force * (step_s * step_s * 0.5);
        velocity += force * step_s;
        rotation = next;
    }
    (rotation, velocity, position)
}

pub fn link(readings: &[Reading], step_s: f64, bias: &ImuBias<f64>) -> InertialLink<f64> {
    let (rotation, velocity, position) = integrate(readings, step_s, bias);
    let mut link = InertialLink {
        span_s: (readings.len() - 1) as f64 * step_s,
        bias: *bias,
        rotation,
        velocity,
        position,
        d_rotation_d_gyro: Matrix3::zeros(),
        d_velocity_d_bias: SMatrix::zeros(),
        d_position_d_bias: SMatrix::zeros(),
    };
    let h = 1e-5;
    for column in 0..6 {
        let moved = |by: f64| {
            let mut bias = *bias;
            let part = if column < 3 { &mut bias.gyro_rad_s } else { &mut bias.accel_m_s2 };
            part[column % 3] += by;
            integrate(readings, step_s, &bias)
        };
        let (up, down) = (moved(h), moved(-h));
        if column < 3 {
            link.d_rotation_d_gyro.set_column(column, &(so3::log(&(down.0.inverse() * up.0)) / (2.0 * h)));
        }
        link.d_velocity_d_bias.set_column(column, &((up.1 - down.1) / (2.0 * h)));
        link.d_position_d_bias.set_column(column, &((up.2 - down.2) / (2.0 * h)));
    }
    link
}

/// EuRoC's `T_BC`.
pub fn extrinsics() -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(-0.0216, -0.0647, 0.0098),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::new(
            0.0148655429818,
            -0.999880929698,
            0.00414029679422, //
            0.999557249008,
            0.0149672133247,
            0.025715529948, //
            -0.0257744366974,
            0.00375618835797,
            0.999660727178,
        ))),
    )
}

impl World {
    pub fn new(setup: &Setup) -> Self {
        let random = &mut Random::new(setup.seed);
        let body_from_camera = extrinsics();
        let bias = ImuBias { gyro_rad_s: random.vector().normalize() * 0.08, accel_m_s2: random.vector().normalize() * 0.1 };
        let (walk, turn) = (Wave::new(random, 0.1), Wave::new(random, 0.12));
        let drift = random.vector().normalize() * random.between(0.0, 0.3);
        let steady = random.vector().normalize() * 0.5;
        // Camera level and looking along world x: body x up, as on EuRoC.
        let start = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::new(
            0.0, 0.0, 1.0, //
            0.0, 1.0, 0.0, //
            -1.0, 0.0, 0.0,
        ))) * so3::exp(&(random.vector() * 0.2));
        let attitude = |t: f64| match setup.kind {
            Kind::Still => start,
            Kind::ConstantVelocity => start * so3::exp(&(turn.at(t, 0) * 0.3)),
            _ => start * so3::exp(&turn.at(t, 0)),
        };
        let position = |t: f64, order: i32| match (setup.kind, order) {
            (Kind::HandHeld, 0) => walk.at(t, 0) + drift * t,
            (Kind::HandHeld, 1) => walk.at(t, 1) + drift,
            (Kind::HandHeld, _) => walk.at(t, order),
            (Kind::ConstantVelocity, 0) => steady * t,
            (Kind::ConstantVelocity, 1) => steady,
            _ => Vector3::zeros(),
        };
        let step_s = 0.005;
        let per_link = (setup.span_s / (setup.frames - 1) as f64 / step_s).round() as usize;
        let noise_rate = setup.imu_noise * (1.0 / step_s).sqrt();
        let readings: Vec<Reading> = (0..=per_link * (setup.frames - 1))
            .map(|i| {
                let (t, h) = (i as f64 * step_s, 1e-4);
                let rate = so3::log(&(attitude(t - h).inverse() * attitude(t + h))) / (2.0 * h);
                let force = attitude(t).inverse() * (position(t, 2) + Vector3::z() * GRAVITY);
                (
                    rate + bias.gyro_rad_s + random.vector() * (1.6968e-4 * noise_rate),
                    force + bias.accel_m_s2 + random.vector() * (2e-3 * noise_rate),
                )
            })
            .collect();
        let links =
            (0..setup.frames - 1).map(|i| link(&readings[i * per_link..=(i + 1) * per_link], step_s, &ImuBias::default())).collect();
        let truth: Vec<_> = (0..setup.frames)
            .map(|i| {
                let t = (i * per_link) as f64 * step_s;
                NavState { world_from_body: attitude(t), position_in_world: position(t, 0), velocity_in_world: position(t, 1), bias }
            })
            .collect();
        let mut world = Self { links, truth, bias, body_from_camera, bearings: Vec::new(), distances: Vec::new() };
        while world.bearings.len() < setup.points {
            world.add_point(random, setup);
        }
        world
    }

    /// The links in single precision.
    pub fn narrow(&self) -> Vec<InertialLink<f32>> {
        let narrow = |link: &InertialLink<f64>| InertialLink {
            span_s: link.span_s as f32,
            bias: ImuBias { gyro_rad_s: link.bias.gyro_rad_s.cast(), accel_m_s2: link.bias.accel_m_s2.cast() },
            rotation: link.rotation.cast(),
            velocity: link.velocity.cast(),
            position: link.position.cast(),
            d_rotation_d_gyro: link.d_rotation_d_gyro.cast(),
            d_velocity_d_bias: link.d_velocity_d_bias.cast(),
            d_position_d_bias: link.d_position_d_bias.cast(),
        };
        self.links.iter().map(narrow).collect()
    }

    pub fn add_point(&mut self, random: &mut Random, setup: &Setup) {
        let frames = self.truth.len();
        let home = (random.unit() * frames as f64) as usize;
        let ray = Vector3::new(random.between(-0.75, 0.75), random.between(-0.5, 0.5), 1.0);
        let point = self.truth[home].pose() * self.body_from_camera * nalgebra::Point3::from(ray * random.between(2.0, 6.0));
        // Tracks live 0.3 of the window and more.
        let length = ((random.between(0.3, 1.4) * frames as f64) as usize).max(3);
        let first = home.saturating_sub((random.unit() * length as f64) as usize);
        let mut row = std::vec![None; frames];
        let cameras = self.truth.iter().map(|state| state.pose() * self.body_from_camera);
        self.distances.push(cameras.map(|camera| (camera.inverse() * point).coords.norm()).collect());
        for (frame, bearing) in row.iter_mut().enumerate().skip(first).take(length) {
            let seen = (self.truth[frame].pose() * self.body_from_camera).inverse() * point;
            let noise = Vector3::new(random.normal(), random.normal(), 0.0) * (setup.noise_px / FOCAL_PX);
            let is_outlier = random.unit() < setup.outliers;
            let turn = random.between(0.0, core::f64::consts::TAU);
            let off = Vector3::new(turn.cos(), turn.sin(), 0.0) * (random.between(5.0, 50.0) / FOCAL_PX);
            let pixel = seen.coords / seen.z + noise + if is_outlier { off } else { Vector3::zeros() };
            if seen.z > 0.2 && pixel.x.abs() < 0.8 && pixel.y.abs() < 0.52 {
                *bearing = Some(pixel.normalize());
            }
        }
        self.bearings.push(row);
    }
}
