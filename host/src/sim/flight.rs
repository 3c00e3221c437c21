//! A motion with its clock: what all sensors of one flight have in common.

use std::path::Path;
use std::sync::Arc;

use libella_core::imu::{ImuBias, ImuNoise, ImuSample};
use libella_core::time::{Span, Timestamp};
use nalgebra::{Isometry3, Translation3, Vector3};

use super::euroc::{self, RecordedMotion, TruthRow};
use super::features::{FeatureConfig, Tracker};
use super::imu::{self, ImuConfig};
use super::scene::{RoomConfig, Scene};
use super::spline::{Spline, TimedPose};
use super::trajectory::{Analytic, AnalyticConfig, Trajectory};
use super::{EPOCH, Frame, Recording, SimError, TruthState, regular_stamps};

/// Where the inertial samples of a recorded motion come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ImuSource {
    /// The recorded samples, as they are.
    #[default]
    Recorded,
    /// Simulated on the smoothed truth, at the recorded stamps and from the true initial bias.
    Simulated,
}

/// How a recorded motion is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RealMotionConfig {
    /// Where the inertial samples come from.
    pub imu_source: ImuSource,
    /// Noise of simulated samples; for recorded ones what the datasheet says.
    pub imu_noise: ImuNoise<f64>,
    /// Magnitude of gravity, m/s².
    pub gravity_m_s2: f64,
    /// Where to start after the beginning of the truth, s.
    pub start_s: f64,
    /// How long at most, s; 1 to 3600.
    pub duration_s: f64,
    /// The corner tracks.
    pub features: FeatureConfig,
}

impl Default for RealMotionConfig {
    fn default() -> Self {
        Self {
            imu_source: ImuSource::Recorded,
            imu_noise: ImuNoise::adis16448(),
            gravity_m_s2: 9.81,
            start_s: 0.0,
            duration_s: 3600.0,
            features: FeatureConfig::default(),
        }
    }
}

/// A motion, its clock, its inertial samples and the stamps of its images.
#[derive(Clone)]
pub struct Flight {
    /// The motion; its time 0 is `epoch`.
    pub trajectory: Arc<dyn Trajectory>,
    /// The stamp of the trajectory's time 0.
    pub epoch: Timestamp,
    /// When images are taken.
    pub frame_stamps: Vec<Timestamp>,
    /// Inertial samples.
    pub imu: Vec<ImuSample<f64>>,
    /// Noise of the samples.
    pub imu_noise: ImuNoise<f64>,
    /// Magnitude of gravity, m/s².
    pub gravity_m_s2: f64,
    /// True states at the inertial stamps that the motion covers.
    pub truth: Vec<TruthState>,
}

impl Flight {
    /// Flies an analytic motion.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn analytic(motion: &AnalyticConfig, imu: &ImuConfig, frame_rate_hz: f64, seed: u64) -> Result<Self, SimError> {
        SimError::check("frame_rate_hz", frame_rate_hz, 1.0, 200.0)?;
        let trajectory = Analytic::new(motion, seed)?;
        SimError::check("imu.rate_hz", imu.rate_hz, 20.0, 2000.0)?;
        let stamps = regular_stamps(motion.duration_s, imu.rate_hz);
        let (samples, truth) = imu::samples(&trajectory, EPOCH, &stamps, imu, seed)?;
        Ok(Self {
            trajectory: Arc::new(trajectory),
            epoch: EPOCH,
            frame_stamps: regular_stamps(motion.duration_s, frame_rate_hz),
            imu: samples,
            imu_noise: imu.noise.unwrap_or_else(ImuNoise::adis16448),
            gravity_m_s2: imu.gravity_m_s2,
            truth,
        })
    }

    /// Flies the recorded motion of a EuRoC folder: a spline through its truth, images at the recorded stamps.
    ///
    /// # Errors
    /// Files that cannot be read, or a start beyond the end of the truth.
    pub fn recorded(folder: &Path, config: &RealMotionConfig, seed: u64) -> Result<Self, SimError> {
        let motion = RecordedMotion::read(folder)?;
        let (Some(first), Some(last)) = (motion.truth.first(), motion.truth.last()) else {
            return Err(SimError::TooShort { what: "rows of ground truth", count: 0, least: 10 });
        };
        let (epoch, end) = (first.stamp, last.stamp);
        let poses: Vec<TimedPose> = motion
            .truth
            .iter()
            .map(|row| TimedPose {
                seconds: (row.stamp - epoch).as_seconds(),
                world_from_body: row.world_from_body,
                position_in_world: row.position_in_world,
            })
            .collect();
        let duration_s = (end - epoch).as_seconds::<f64>();
        SimError::check("start_s", config.start_s, 0.0, (duration_s - 1.0).max(0.0))?;
        SimError::check("duration_s", config.duration_s, 1.0, 3600.0)?;
        // A knot per row where rows are 50 ms apart; five rows per knot where they are 5 ms apart.
        let knot_s = (duration_s / (poses.len().max(2) - 1) as f64).clamp(0.025, 0.2);
        let spline = Spline::fit(&poses, knot_s)?;

        let after = |seconds: f64| epoch + nanos(seconds);
        let (from, to) = (after(config.start_s), after((config.start_s + config.duration_s).min(duration_s)).min(end));
        let frame_stamps: Vec<Timestamp> = motion.frame_stamps.into_iter().filter(|stamp| *stamp >= from && *stamp <= to).collect();
        let (Some(first_frame), Some(last_frame)) = (frame_stamps.first(), frame_stamps.last()) else {
            return Err(SimError::TooShort { what: "images within the ground truth", count: 0, least: 1 });
        };
        // One second ahead of the first image, and enough after the last to enclose it.
        let (imu_from, imu_to) = (*first_frame - Span::from_millis(1000), *last_frame + Span::from_millis(50));
        let recorded: Vec<ImuSample<f64>> =
            motion.imu.into_iter().filter(|sample| sample.stamp >= imu_from && sample.stamp <= imu_to).collect();
        let covered: Vec<Timestamp> = recorded.iter().map(|sample| sample.stamp).filter(|stamp| *stamp >= epoch && *stamp <= end).collect();
        let (imu, truth) = match config.imu_source {
            ImuSource::Recorded => {
                let truth = covered
                    .iter()
                    .map(|stamp| {
                        let moment = spline.at((*stamp - epoch).as_seconds());
                        imu::truth_state(*stamp, &moment, bias_at(&motion.truth, *stamp))
                    })
                    .collect();
                (recorded, truth)
            }
            ImuSource::Simulated => {
                let imu_config = ImuConfig {
                    rate_hz: 200.0,
                    noise: Some(config.imu_noise),
                    initial_bias: bias_at(&motion.truth, *first_frame),
                    gravity_m_s2: config.gravity_m_s2,
                };
                imu::samples(&spline, epoch, &covered, &imu_config, seed)?
            }
        };
        Ok(Self {
            trajectory: Arc::new(spline),
            epoch,
            frame_stamps,
            imu,
            imu_noise: config.imu_noise,
            gravity_m_s2: config.gravity_m_s2,
            truth,
        })
    }

    /// Positions along the way, m, five per second.
    #[must_use]
    pub fn path(&self) -> Vec<Vector3<f64>> {
        let (Some(first), Some(last)) = (self.frame_stamps.first(), self.frame_stamps.last()) else { return Vec::new() };
        let (start, end) = ((*first - self.epoch).as_seconds::<f64>(), (*last - self.epoch).as_seconds::<f64>());
        let mut seconds = start;
        let mut path = Vec::new();
        while seconds <= end {
            path.push(self.trajectory.at(seconds).position_in_world);
            seconds += 0.2;
        }
        path
    }

    /// The Vicon room where the motion fits into it, otherwise the hall.
    #[must_use]
    pub fn fitting_room(&self) -> RoomConfig {
        let path = self.path();
        let room = RoomConfig::vicon(&path);
        if room.size_m.x > 10.0 || room.size_m.y > 10.0 { RoomConfig::hall(&path) } else { room }
    }

    /// The pose of a camera on the body at a stamp.
    #[must_use]
    pub fn world_from_camera(&self, stamp: Timestamp, body_from_camera: &Isometry3<f64>) -> Isometry3<f64> {
        let motion = self.trajectory.at((stamp - self.epoch).as_seconds());
        Isometry3::from_parts(Translation3::from(motion.position_in_world), motion.world_from_body) * body_from_camera
    }

    /// Simulates the corner tracks of EuRoC's left camera; also returns the true landmarks by track id.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn record(self, room: &RoomConfig, features: &FeatureConfig, seed: u64) -> Result<(Recording, Vec<Vector3<f64>>), SimError> {
        let scene = Scene::room(room, &self.path(), seed)?;
        let (camera, body_from_camera) = (euroc::camera(0), euroc::body_from_camera(0));
        let mut tracker = Tracker::new(&scene, camera, features, seed)?;
        let frames = self
            .frame_stamps
            .iter()
            .map(|stamp| {
                let pose = self.world_from_camera(*stamp, &body_from_camera);
                Frame { stamp: *stamp, observations: tracker.observe((*stamp - self.epoch).as_seconds(), &pose) }
            })
            .collect();
        let landmarks = tracker.landmarks().to_vec();
        let recording = Recording {
            camera,
            body_from_camera,
            imu_noise: self.imu_noise,
            gravity_m_s2: self.gravity_m_s2,
            imu: self.imu,
            frames,
            truth: self.truth,
        };
        Ok((recording, landmarks))
    }
}

#[allow(clippy::cast_possible_truncation)]
fn nanos(seconds: f64) -> Span {
    Span::from_nanos((seconds * 1e9).round() as i64)
}

/// The bias of the newest row that is not after `stamp`; they drift over minutes.
fn bias_at(rows: &[TruthRow], stamp: Timestamp) -> ImuBias<f64> {
    let next = rows.partition_point(|row| row.stamp <= stamp);
    rows.get(next.saturating_sub(1)).map(|row| row.bias).unwrap_or_default()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::sim::{SimulationConfig, real_motion, simulate};
    use libella_core::imu::Preintegration;
    use libella_core::lie::so3;

    #[test]
    fn same_seed_same_recording() {
        let config =
            SimulationConfig { motion: AnalyticConfig { duration_s: 5.0, ..AnalyticConfig::default() }, ..SimulationConfig::default() };
        let (one, two, other) = (simulate(&config, 1).unwrap(), simulate(&config, 1).unwrap(), simulate(&config, 2).unwrap());
        assert!(one.frames == two.frames && one.imu == two.imu && one.truth == two.truth);
        assert!(one.frames != other.frames && one.imu != other.imu);
    }

    fn shared(folder: &str) -> Option<std::path::PathBuf> {
        let root = std::env::var_os("LIBELLA_DATA")?;
        let path = std::path::PathBuf::from(root).join("euroc_motion").join(folder);
        path.is_dir().then_some(path)
    }

    #[test]
    fn recorded_motions_keep_their_poses_and_agree_with_their_gyro() {
        for folder in ["V1_01_easy", "V1_02_medium", "V2_01_easy", "MH_04_difficult"] {
            let Some(path) = shared(folder) else {
                eprintln!("skipped: LIBELLA_DATA has no euroc_motion/{folder}");
                continue;
            };
            let flight = Flight::recorded(&path, &RealMotionConfig::default(), 1).unwrap();
            let rows = RecordedMotion::read(&path).unwrap().truth;
            let (mut position, mut rotation, mut rate, mut force) = (0.0_f64, 0.0_f64, 0.0, 0.0);
            for row in &rows {
                let motion = flight.trajectory.at((row.stamp - flight.epoch).as_seconds());
                position = position.max((motion.position_in_world - row.position_in_world).norm());
                rotation = rotation.max(so3::log(&(motion.world_from_body.inverse() * row.world_from_body)).norm());
            }
            // Propellers shake the real sensor (1 m/s² and more); the mean over a second is what integration keeps.
            let mut seconds = 0.0;
            for second in flight.truth.chunks_exact(200) {
                let (mut rate_mean, mut force_mean) = (Vector3::zeros(), Vector3::zeros());
                for truth in second {
                    let at = flight.imu.partition_point(|sample| sample.stamp < truth.stamp);
                    let motion = flight.trajectory.at((truth.stamp - flight.epoch).as_seconds());
                    let expected = imu::exact_sample(truth.stamp, &motion, &truth.state.bias, flight.gravity_m_s2);
                    rate_mean += (expected.gyro_rad_s - flight.imu[at].gyro_rad_s) / 200.0;
                    force_mean += (expected.accel_m_s2 - flight.imu[at].accel_m_s2) / 200.0;
                }
                rate += rate_mean.norm_squared();
                force += force_mean.norm_squared();
                seconds += 1.0;
            }
            let (rate, force): (f64, f64) = ((rate / seconds).sqrt(), (force / seconds).sqrt());
            eprintln!(
                "{folder}: {} images, spline off by at most {position:.1e} m {rotation:.1e} rad; IMU means off by {rate:.4} rad/s {force:.3} m/s2 RMS",
                flight.frame_stamps.len()
            );
            // The spline may not move the truth by more than the truth is worth (1 mm, 2 mrad). MH_04's truth itself leaps by
            // 13 cm within 5 ms at 45 s, and by 1 cm elsewhere; the spline spreads a leap over 50 ms.
            let (most_m, most_rad, most_force) = if folder.starts_with("MH") { (0.08, 0.01, 0.8) } else { (1e-3, 2e-3, 0.2) };
            assert!(position < most_m && rotation < most_rad, "{folder} {position} {rotation}");
            assert!(rate < 0.01 && force < most_force, "{folder} {rate} {force}");
        }
    }

    /// The core's integrator on the simulator's samples: two programs that share no line agree on the motion.
    #[test]
    fn preintegration_of_exact_samples_returns_the_motion_with_second_order() {
        let error = |rate_hz: f64| {
            let motion = AnalyticConfig { duration_s: 10.0, rest_s: 0.0, ..AnalyticConfig::default() };
            let imu = ImuConfig { rate_hz, noise: None, ..ImuConfig::default() };
            let flight = Flight::analytic(&motion, &imu, 20.0, 8).unwrap();
            let first = flight.truth.first().unwrap().state;
            let mut integral = Preintegration::new(first.bias);
            for pair in flight.imu.windows(2) {
                integral.integrate(&flight.imu_noise, &pair[0], &pair[1]).unwrap();
            }
            let end = integral.predict(&first, &Vector3::new(0.0, 0.0, -9.81));
            let error = end.local(&flight.truth.last().unwrap().state);
            [0, 3, 6].map(|at| Vector3::new(error[at], error[at + 1], error[at + 2]).norm())
        };
        let (coarse, fine) = (error(100.0), error(200.0));
        for (coarse, fine) in coarse.iter().zip(&fine) {
            assert!((3.6..4.4).contains(&(coarse / fine)), "{coarse} {fine}");
        }
        assert!(fine[1] < 0.01, "{fine:?}");
    }

    #[test]
    fn tracks_on_a_recorded_motion() {
        let Some(path) = shared("MH_04_difficult") else {
            eprintln!("skipped: LIBELLA_DATA has no euroc_motion/MH_04_difficult");
            return;
        };
        let recording = real_motion(&path, &RealMotionConfig { duration_s: 20.0, ..RealMotionConfig::default() }, 3).unwrap();
        assert_eq!(recording.frames.len(), 400);
        assert!(recording.frames.iter().all(|frame| frame.observations.len() > 100));
        let (first, last) = (recording.frames.first().unwrap().stamp, recording.frames.last().unwrap().stamp);
        assert!(recording.imu.first().unwrap().stamp <= first && recording.imu.last().unwrap().stamp >= last);
        assert!(recording.frames.iter().all(|frame| recording.truth.iter().any(|truth| truth.stamp == frame.stamp)));
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = Flight::recorded(Path::new("nowhere/at/all"), &RealMotionConfig::default(), 1).err().unwrap();
        assert!(error.to_string().contains("imu0"), "{error}");
    }
}
