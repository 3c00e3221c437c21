//! Motions of the body with exact derivatives.
//!
//! # Model
//! Position and three angles are sums of sinusoids of a warped time `τ(t)`, which stays at zero while the vehicle rests and
//! then gathers pace:
//! ```text
//! p(t) = c + Σ a_k sin(ω_k τ + φ_k)        v = p′ τ̇        a = p″ τ̇² + p′ τ̈
//! R_WB = Rz(yaw) Ry(pitch) Rx(roll) R_VB   ω_V = (ṙ − ẏ sin p, ṗ cos r + ẏ sin r cos p, ẏ cos r cos p − ṗ sin r)
//! ```
//! `V` is the vehicle frame (x forward, y left, z up); `R_VB` turns it into the body frame of EuRoC's sensor, whose x points up
//! and whose z looks forward.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::SimError;
use super::random::Random;

/// Where the body is and how it moves at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// `R_WB`.
    pub world_from_body: UnitQuaternion<f64>,
    /// `p_WB`, m.
    pub position_in_world: Vector3<f64>,
    /// `v_WB`, m/s.
    pub velocity_in_world: Vector3<f64>,
    /// `dv_WB/dt`, m/s², gravity not included.
    pub acceleration_in_world: Vector3<f64>,
    /// Angular rate of the body in the body frame, rad/s.
    pub rate_in_body: Vector3<f64>,
}

/// A motion known at every time from 0 to its duration. Times outside are answered too, by the same formulas.
pub trait Trajectory: Send + Sync {
    /// The motion at a time in seconds since the start.
    fn at(&self, seconds: f64) -> Motion;
    /// How long it lasts, s.
    fn duration_s(&self) -> f64;
}

/// The kinds of analytic motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MotionKind {
    /// Calm flight: mean speed 0.41 m/s, mean rate 0.28 rad/s, as EuRoC's V1_01.
    Easy,
    /// 0.91 m/s and 0.56 rad/s, as V1_02.
    Medium,
    /// 0.75 m/s and 0.62 rad/s in shorter, harder swings, as V1_03.
    Difficult,
    /// No motion at all.
    Still,
    /// Turning on the spot, 0.5 rad/s in the mean.
    PureRotation,
    /// Turning about the vertical at 1.5 rad/s while flying at 0.4 m/s.
    FastYaw,
}

impl MotionKind {
    /// The kind of a name as the command line writes it.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "easy" => Self::Easy,
            "medium" => Self::Medium,
            "difficult" => Self::Difficult,
            "still" => Self::Still,
            "pure-rotation" => Self::PureRotation,
            "fast-yaw" => Self::FastYaw,
            _ => return None,
        })
    }

    /// Mean speed (m/s), mean angular rate (rad/s) and the band of the sinusoids (Hz).
    fn targets(self) -> (f64, f64, [f64; 2]) {
        match self {
            Self::Easy => (0.41, 0.28, [0.04, 0.16]),
            Self::Medium => (0.91, 0.56, [0.08, 0.28]),
            Self::Difficult => (0.75, 0.62, [0.12, 0.55]),
            Self::Still => (0.0, 0.0, [0.05, 0.1]),
            Self::PureRotation => (0.0, 0.5, [0.08, 0.3]),
            Self::FastYaw => (0.4, 0.3, [0.05, 0.2]),
        }
    }
}

/// One sinusoid.
#[derive(Debug, Clone, Copy)]
struct Wave {
    amplitude: f64,
    rate_rad_s: f64,
    phase_rad: f64,
}

/// A sum of sinusoids plus a ramp, and its first two derivatives.
#[derive(Debug, Clone)]
struct Waves {
    center: f64,
    slope: f64,
    waves: Vec<Wave>,
}

impl Waves {
    fn draw(random: &mut Random, center: f64, weight: f64, band_hz: [f64; 2]) -> Self {
        let count = 4;
        let waves = (0..count)
            .map(|k| {
                // One frequency from each quarter of the band; the amplitude falls with it, as in flown motion.
                let part = (f64::from(k) + random.unit()) / f64::from(count);
                let hertz = band_hz[0] * (band_hz[1] / band_hz[0]).powf(part);
                Wave {
                    amplitude: weight * random.between(0.6, 1.0) * band_hz[0] / hertz,
                    rate_rad_s: std::f64::consts::TAU * hertz,
                    phase_rad: random.between(0.0, std::f64::consts::TAU),
                }
            })
            .collect();
        Self { center, slope: 0.0, waves }
    }

    /// Value and two derivatives with respect to the warped time.
    fn at(&self, time: f64) -> [f64; 3] {
        let mut out = [self.center + self.slope * time, self.slope, 0.0];
        for wave in &self.waves {
            let (sine, cosine) = (wave.rate_rad_s * time + wave.phase_rad).sin_cos();
            out[0] += wave.amplitude * sine;
            out[1] += wave.amplitude * wave.rate_rad_s * cosine;
            out[2] -= wave.amplitude * wave.rate_rad_s * wave.rate_rad_s * sine;
        }
        out
    }

    fn scale(&mut self, factor: f64) {
        self.waves.iter_mut().for_each(|wave| wave.amplitude *= factor);
    }
}

/// What an analytic motion is drawn from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnalyticConfig {
    /// Which kind.
    pub kind: MotionKind,
    /// How long, s; 1 to 3600.
    pub duration_s: f64,
    /// How long it rests at first, s; 0 starts in full motion.
    pub rest_s: f64,
    /// Where it swings about, m.
    pub center_m: Vector3<f64>,
    /// Half the size of the box it stays in, m.
    pub reach_m: Vector3<f64>,
}

impl Default for AnalyticConfig {
    fn default() -> Self {
        Self {
            kind: MotionKind::Easy,
            duration_s: 60.0,
            rest_s: 2.0,
            center_m: Vector3::new(0.0, 0.0, 1.5),
            reach_m: Vector3::new(2.8, 2.8, 0.9),
        }
    }
}

/// A smooth, seeded motion of sinusoids.
#[derive(Debug, Clone)]
pub struct Analytic {
    duration_s: f64,
    rest_s: f64,
    position: [Waves; 3],
    /// Yaw, pitch, roll.
    angles: [Waves; 3],
}

/// How long the start from rest takes, s.
const RAMP_S: f64 = 2.0;

impl Analytic {
    /// Draws a motion and scales it to the speed and rate of its kind, as far as the reach allows.
    ///
    /// # Errors
    /// When the duration or the rest is out of range.
    pub fn new(config: &AnalyticConfig, seed: u64) -> Result<Self, SimError> {
        SimError::check("duration_s", config.duration_s, 1.0, 3600.0)?;
        SimError::check("rest_s", config.rest_s, 0.0, config.duration_s)?;
        let (speed, rate, band) = config.kind.targets();
        let mut random = Random::new(seed, "trajectory");
        let weights = [1.0, 1.0, 0.3];
        let position = std::array::from_fn(|i| Waves::draw(&mut random, config.center_m[i], weights[i], band));
        // The camera looks a little downwards on the whole: 10 degrees.
        let mut angles = [(0.0, 1.0), (0.17, 0.35), (0.0, 0.3)].map(|(center, weight)| Waves::draw(&mut random, center, weight, band));
        angles[0].center = random.between(-3.0, 3.0);
        if config.kind == MotionKind::FastYaw {
            angles[0].slope = 1.5;
        }
        let mut motion = Self { duration_s: config.duration_s, rest_s: config.rest_s, position, angles };

        // Speed is linear in the amplitudes and, for small angles, so is the rate: two rounds settle both.
        for _ in 0..3 {
            let (mean_speed, mean_rate) = motion.mean_speed_and_rate();
            let position_factor = if mean_speed > 0.0 { speed / mean_speed } else { 0.0 };
            let rate_factor = if mean_rate > 0.0 && config.kind != MotionKind::FastYaw { rate / mean_rate } else { 1.0 };
            motion.position.iter_mut().for_each(|waves| waves.scale(position_factor));
            motion.angles.iter_mut().for_each(|waves| waves.scale(rate_factor));
            if rate == 0.0 {
                motion.angles.iter_mut().for_each(|waves| waves.scale(0.0));
            }
        }
        for (waves, reach) in motion.position.iter_mut().zip(config.reach_m.iter()) {
            let extent: f64 = waves.waves.iter().map(|wave| wave.amplitude).sum();
            if extent > *reach {
                // Same speed in less room: shorter swings of a higher frequency.
                let factor = reach / extent;
                waves.scale(factor);
                waves.waves.iter_mut().for_each(|wave| wave.rate_rad_s /= factor);
            }
        }
        Ok(motion)
    }

    /// Means over the part in full motion.
    fn mean_speed_and_rate(&self) -> (f64, f64) {
        let count = 2000;
        let (mut speed, mut rate) = (0.0, 0.0);
        for k in 0..count {
            // Long enough for the slowest wave even where the flight is short.
            let motion = self.at_warped([60.0 * f64::from(k) / f64::from(count), 1.0, 0.0]);
            speed += motion.velocity_in_world.norm();
            rate += motion.rate_in_body.norm();
        }
        (speed / f64::from(count), rate / f64::from(count))
    }

    /// `τ`, `τ̇`, `τ̈`: zero at rest, then the rate rises as the smooth step `s³(10 − 15 s + 6 s²)`.
    fn warp(&self, seconds: f64) -> [f64; 3] {
        if self.rest_s <= 0.0 {
            return [seconds, 1.0, 0.0];
        }
        let s = (seconds - self.rest_s) / RAMP_S;
        if s <= 0.0 {
            [0.0, 0.0, 0.0]
        } else if s >= 1.0 {
            [RAMP_S * (s - 0.5), 1.0, 0.0]
        } else {
            let (s2, s3) = (s * s, s * s * s);
            [RAMP_S * s2 * s2 * (2.5 - 3.0 * s + s2), s3 * (10.0 - 15.0 * s + 6.0 * s2), 30.0 * s2 * (1.0 - s) * (1.0 - s) / RAMP_S]
        }
    }

    fn at_warped(&self, [time, pace, pace_change]: [f64; 3]) -> Motion {
        let position = [0, 1, 2].map(|i| self.position[i].at(time));
        let [yaw, pitch, roll] = [0, 1, 2].map(|i| {
            let [value, first, _] = self.angles[i].at(time);
            (value, first * pace)
        });
        let vehicle_from_body = vehicle_from_body();
        let world_from_body = UnitQuaternion::from_euler_angles(roll.0, pitch.0, yaw.0) * vehicle_from_body;
        let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) = (roll.0.sin_cos(), pitch.0.sin_cos());
        let rate_in_vehicle = Vector3::new(
            roll.1 - yaw.1 * sin_pitch,
            pitch.1 * cos_roll + yaw.1 * sin_roll * cos_pitch,
            yaw.1 * cos_roll * cos_pitch - pitch.1 * sin_roll,
        );
        Motion {
            world_from_body,
            position_in_world: Vector3::from(position.map(|p| p[0])),
            velocity_in_world: Vector3::from(position.map(|p| p[1] * pace)),
            acceleration_in_world: Vector3::from(position.map(|p| p[2] * pace * pace + p[1] * pace_change)),
            rate_in_body: vehicle_from_body.inverse() * rate_in_vehicle,
        }
    }
}

/// `R_VB`: the body's x is up, its z forward, hence its y to the right.
fn vehicle_from_body() -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::new(
        0.0, 0.0, 1.0, //
        0.0, -1.0, 0.0, //
        1.0, 0.0, 0.0,
    )))
}

impl Trajectory for Analytic {
    fn at(&self, seconds: f64) -> Motion {
        self.at_warped(self.warp(seconds))
    }

    fn duration_s(&self) -> f64 {
        self.duration_s
    }
}

/// Central differences of a trajectory against the derivatives it states; for the tests of every kind of trajectory.
#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) fn worst_derivative_error(trajectory: &dyn Trajectory, times: impl Iterator<Item = f64>) -> [f64; 3] {
    use libella_core::lie::so3;
    let step = 1e-4;
    let mut worst = [0.0_f64; 3];
    for time in times {
        let (before, now, after) = (trajectory.at(time - step), trajectory.at(time), trajectory.at(time + step));
        let velocity = (after.position_in_world - before.position_in_world) / (2.0 * step);
        let acceleration = (after.velocity_in_world - before.velocity_in_world) / (2.0 * step);
        let rate = so3::log(&(before.world_from_body.inverse() * after.world_from_body)) / (2.0 * step);
        worst[0] = worst[0].max((velocity - now.velocity_in_world).norm());
        worst[1] = worst[1].max((acceleration - now.acceleration_in_world).norm());
        worst[2] = worst[2].max((rate - now.rate_in_body).norm());
    }
    worst
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const ALL: [MotionKind; 6] =
        [MotionKind::Easy, MotionKind::Medium, MotionKind::Difficult, MotionKind::Still, MotionKind::PureRotation, MotionKind::FastYaw];

    #[test]
    fn derivatives_match_central_differences() {
        for kind in ALL {
            let motion = Analytic::new(&AnalyticConfig { kind, ..AnalyticConfig::default() }, 3).unwrap();
            let worst = worst_derivative_error(&motion, (1..400).map(|k| f64::from(k) * 0.0371));
            // Central differences: h²/6 times the third derivative, which stays below 100 /s³ here.
            assert!(worst.iter().all(|error| *error < 2e-7), "{kind:?} {worst:?}");
        }
    }

    #[test]
    fn presets_have_the_speeds_they_state() {
        for (kind, seed) in ALL.iter().flat_map(|kind| [1, 2, 3].map(|seed| (*kind, seed))) {
            let config = AnalyticConfig { kind, duration_s: 60.0, rest_s: 0.0, ..AnalyticConfig::default() };
            let motion = Analytic::new(&config, seed).unwrap();
            let (speed, rate) = motion.mean_speed_and_rate();
            let (target_speed, target_rate, _) = kind.targets();
            assert!((speed - target_speed).abs() <= 0.15 * target_speed, "{kind:?} {speed} m/s");
            let target_rate = if kind == MotionKind::FastYaw { 1.5 } else { target_rate };
            assert!((rate - target_rate).abs() <= 0.15 * target_rate, "{kind:?} {rate} rad/s");
            for k in 0..600 {
                let offset = motion.at(f64::from(k) * 0.1).position_in_world - config.center_m;
                assert!(offset.iter().zip(config.reach_m.iter()).all(|(x, reach)| x.abs() <= reach + 1e-9));
            }
        }
    }

    #[test]
    fn rests_before_it_moves() {
        let motion = Analytic::new(&AnalyticConfig::default(), 5).unwrap();
        assert_eq!(motion.at(0.0), motion.at(1.99));
        assert!(motion.at(1.0).velocity_in_world.norm() == 0.0 && motion.at(8.0).velocity_in_world.norm() > 0.0);
    }

    #[test]
    fn body_x_points_up_when_level() {
        let up = vehicle_from_body() * Vector3::x();
        assert!((up - Vector3::z()).norm() < 1e-12);
        assert!((vehicle_from_body() * Vector3::z() - Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn refuses_an_impossible_duration() {
        let config = AnalyticConfig { duration_s: 0.0, ..AnalyticConfig::default() };
        let message = Analytic::new(&config, 1).unwrap_err().to_string();
        assert!(message.contains("duration_s") && message.contains("3600"), "{message}");
    }
}
