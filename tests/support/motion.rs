//! Flights that halt on the way.
#![allow(dead_code)] // each test reads its own part

use std::sync::Arc;

use libella_core::imu::ImuNoise;
use libella_host::sim::trajectory::Analytic;
use libella_host::sim::{
    AnalyticConfig, EPOCH, FeatureConfig, Flight, ImuConfig, Motion, MotionKind, Recording, RoomConfig, Trajectory, imu, regular_stamps,
};

/// How long a halt takes to set in and to end, s.
const RAMP_S: f64 = 1.0;

/// From when to when something halts, s; it comes to rest one second after the first and moves again after the second.
pub type Halt = (f64, f64);

/// A pace that falls from 1 to 0 at each halt and rises again: `τ`, `τ̇`, `τ̈`. The steps are `s³(10 − 15 s + 6 s²)`.
fn warp(seconds: f64, halts: &[Halt]) -> [f64; 3] {
    let step = |from: f64| {
        let s = (seconds - from) / RAMP_S;
        if s <= 0.0 {
            [0.0, 0.0, 0.0]
        } else if s >= 1.0 {
            [RAMP_S * (s - 0.5), 1.0, 0.0]
        } else {
            let s2 = s * s;
            [RAMP_S * s2 * s2 * (2.5 - 3.0 * s + s2), s2 * s * (10.0 - 15.0 * s + 6.0 * s2), 30.0 * s2 * (1.0 - s) * (1.0 - s) / RAMP_S]
        }
    };
    let mut out = [seconds, 1.0, 0.0];
    for (from, to) in halts {
        for (value, (sets_in, ends)) in out.iter_mut().zip(step(*from).into_iter().zip(step(*to))) {
            *value -= sets_in - ends;
        }
    }
    out
}

/// An analytic motion whose position and rotation halt apart.
struct Halting {
    inner: Analytic,
    position: Vec<Halt>,
    rotation: Vec<Halt>,
}

impl Trajectory for Halting {
    fn at(&self, seconds: f64) -> Motion {
        let [place, pace, change] = warp(seconds, &self.position);
        let [angle, turn, _] = warp(seconds, &self.rotation);
        let (moved, turned) = (self.inner.at(place), self.inner.at(angle));
        Motion {
            world_from_body: turned.world_from_body,
            position_in_world: moved.position_in_world,
            velocity_in_world: moved.velocity_in_world * pace,
            acceleration_in_world: moved.acceleration_in_world * (pace * pace) + moved.velocity_in_world * change,
            rate_in_body: turned.rate_in_body * turn,
        }
    }

    fn duration_s(&self) -> f64 {
        self.inner.duration_s()
    }
}

/// What a flight with halts is made of.
pub struct Script {
    pub kind: MotionKind,
    pub duration_s: f64,
    /// Rest at the start, s.
    pub rest_s: f64,
    pub position_halts: Vec<Halt>,
    pub rotation_halts: Vec<Halt>,
    pub features: FeatureConfig,
    pub frame_rate_hz: f64,
    pub seed: u64,
}

impl Default for Script {
    fn default() -> Self {
        Self {
            kind: MotionKind::Medium,
            duration_s: 20.0,
            rest_s: 1.5,
            position_halts: Vec::new(),
            rotation_halts: Vec::new(),
            features: FeatureConfig { count: 100, ..FeatureConfig::default() },
            frame_rate_hz: 20.0,
            seed: 1,
        }
    }
}

impl Script {
    /// Tracks as they are of a body at rest: quiet to a tenth of a pixel, and never lost without reason.
    pub fn with_calm_tracks(self) -> Self {
        Self { features: FeatureConfig { sigma_px: 0.1, mean_track_s: 1000.0, outlier_share: 0.0, ..self.features }, ..self }
    }

    pub fn recording(&self) -> Recording {
        let config = AnalyticConfig { kind: self.kind, duration_s: self.duration_s, rest_s: self.rest_s, ..AnalyticConfig::default() };
        let inner = Analytic::new(&config, self.seed).unwrap_or_else(|error| panic!("{error}"));
        let trajectory = Halting { inner, position: self.position_halts.clone(), rotation: self.rotation_halts.clone() };
        let sensor = ImuConfig::default();
        let stamps = regular_stamps(self.duration_s, sensor.rate_hz);
        let (samples, truth) = imu::samples(&trajectory, EPOCH, &stamps, &sensor, self.seed).unwrap_or_else(|error| panic!("{error}"));
        let flight = Flight {
            trajectory: Arc::new(trajectory),
            epoch: EPOCH,
            frame_stamps: regular_stamps(self.duration_s, self.frame_rate_hz),
            imu: samples,
            imu_noise: ImuNoise::adis16448(),
            gravity_m_s2: sensor.gravity_m_s2,
            truth,
        };
        let room = RoomConfig::vicon(&flight.path());
        flight.record(&room, &self.features, self.seed).unwrap_or_else(|error| panic!("{error}")).0
    }
}
