//! Flies a simulated recording through the estimator and keeps what it said.
#![allow(dead_code)] // each test reads its own part

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use libella_core::depth::DepthSample;
use libella_core::estimator::{EstimatorConfig, FrameOutcome, Health, InputError, StepBudget};
use libella_core::imu::{ImuNoise, ImuSample, NavState};
use libella_core::profile::Desktop;
use libella_core::real::Real;
use libella_core::time::{Span, Timestamp};
use libella_core::track::{Observation, TrackId};
use libella_host::eval::{StampedPose, Statistics, Trajectory, align, associate, position_errors_m};
use libella_host::sim::{Frame, Recording};
use nalgebra::{Isometry3, Matrix6, Quaternion, Translation3, UnitQuaternion, Vector3};

/// The estimator is built on the stack before it moves to the heap, in debug builds more than once.
const STACK_BYTES: usize = 64 << 20;

/// Standard deviation of simulated corners, px: what the simulator draws unless told otherwise.
const SIGMA_PX: f64 = 1.0;

/// What the estimator knew after one image.
#[derive(Debug, Clone, Copy)]
pub struct Knowledge {
    pub stamp: Timestamp,
    pub state: NavState<f64>,
    /// Before the solution: where the covariance was linearised.
    pub predicted: NavState<f64>,
    pub pose_covariance: Matrix6<f64>,
}

/// What became of a flight.
#[derive(Debug, Clone, Default)]
pub struct Flown {
    /// One entry per image.
    pub outcomes: Vec<(Timestamp, FrameOutcome)>,
    /// Health after each image.
    pub health: Vec<Health>,
    /// The causal states.
    pub states: Vec<Knowledge>,
    /// The frame that defines the world, as it was when initialisation ended (the last one, where it was lost in between).
    pub origin: Option<(Timestamp, NavState<f64>)>,
}

/// Error of the positions of a flight after alignment by a rigid transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// RMSE, m.
    pub ate_m: f64,
    /// The factor on the estimate that would have fitted best, minus one, in percent.
    pub scale_error_percent: f64,
}

impl Flown {
    /// How often tracking was lost.
    pub fn losses(&self) -> usize {
        self.count(|outcome| outcome == FrameOutcome::Lost)
    }

    pub fn count(&self, what: impl Fn(FrameOutcome) -> bool) -> usize {
        self.outcomes.iter().filter(|(_, outcome)| what(*outcome)).count()
    }

    /// Time from the first image to the end of the first initialisation, s.
    pub fn initialised_after_s(&self) -> Option<f64> {
        let (first, _) = self.outcomes.first()?;
        let (stamp, _) = self.outcomes.iter().find(|(_, outcome)| *outcome == FrameOutcome::Initialised)?;
        Some((*stamp - *first).as_seconds())
    }

    /// Share of the images that have a pose.
    pub fn coverage(&self) -> f64 {
        self.states.len() as f64 / self.outcomes.len().max(1) as f64
    }

    /// The causal poses against the truth; `None` where there are too few to align.
    pub fn accuracy(&self, recording: &Recording) -> Option<Accuracy> {
        let posed = |stamp, state: &NavState<f64>| StampedPose { stamp, world_from_body: state.pose() };
        let estimate = Trajectory::new(self.states.iter().map(|known| posed(known.stamp, &known.state)));
        let truth = Trajectory::new(recording.truth.iter().map(|row| posed(row.stamp, &row.state)));
        let pairs = associate(&estimate, &truth, Span::from_millis(100));
        if pairs.len() < 10 {
            return None;
        }
        let positions: Vec<_> = pairs.iter().map(|pair| (pair.estimate.translation.vector, pair.truth.translation.vector)).collect();
        let alignment = align(&positions)?;
        let errors = Statistics::of(&position_errors_m(&pairs, &alignment))?;
        Some(Accuracy { ate_m: errors.rmse, scale_error_percent: 100.0 * (alignment.scale - 1.0) })
    }
}

/// The true state at an image, which is an inertial stamp as well in all simulated motions.
pub fn truth_at(recording: &Recording, stamp: Timestamp) -> Option<NavState<f64>> {
    let index = recording.truth.binary_search_by_key(&stamp, |row| row.stamp).ok()?;
    recording.truth.get(index).map(|row| row.state)
}

/// The default configuration with the recording's gravity and noise, the noise not inflated: it is exactly what was simulated.
pub fn simulated_config<T: Real>(recording: &Recording) -> EstimatorConfig<T> {
    EstimatorConfig { imu_noise_inflation: T::one(), imu_walk_inflation: T::one(), ..real_config(recording) }
}

/// The default configuration with the recording's gravity and noise, and the noise of simulated corners instead of that of the
/// project's own front end.
pub fn real_config<T: Real>(recording: &Recording) -> EstimatorConfig<T> {
    let noise = &recording.imu_noise;
    EstimatorConfig {
        imu_noise: ImuNoise {
            gyro_noise_density: T::of(noise.gyro_noise_density),
            accel_noise_density: T::of(noise.accel_noise_density),
            gyro_random_walk: T::of(noise.gyro_random_walk),
            accel_random_walk: T::of(noise.accel_random_walk),
        },
        gravity_m_s2: T::of(recording.gravity_m_s2),
        sigma_px: T::of(SIGMA_PX),
        ..EstimatorConfig::default()
    }
}

/// An estimator with its place in a recording.
pub struct Pilot<'a, T: Real> {
    pub estimator: Box<Desktop<T>>,
    pub flown: Flown,
    recording: &'a Recording,
    next_sample: usize,
}

impl<'a, T: Real> Pilot<'a, T> {
    pub fn new(recording: &'a Recording, config: EstimatorConfig<T>) -> Self {
        Self::with_extrinsics(recording, config, &recording.body_from_camera)
    }

    /// With another pose of the camera on the body than the recording has.
    pub fn with_extrinsics(recording: &'a Recording, config: EstimatorConfig<T>, body_from_camera: &Isometry3<f64>) -> Self {
        let pose = Isometry3::from_parts(
            Translation3::from(body_from_camera.translation.vector.map(T::of)),
            UnitQuaternion::new_normalize(Quaternion::from(body_from_camera.rotation.coords.map(T::of))),
        );
        let estimator = Box::new(Desktop::new(config, recording.camera.cast(), pose));
        Self { estimator, flown: Flown::default(), recording, next_sample: 0 }
    }

    /// Inertial samples up to the first that is not before `stamp`, each as `change` makes it; `None` leaves it out.
    pub fn push_imu_past(&mut self, stamp: Timestamp, mut change: impl FnMut(ImuSample<f64>) -> Option<ImuSample<f64>>) {
        while let Some(sample) = self.recording.imu.get(self.next_sample) {
            self.next_sample += 1;
            if let Some(sample) = change(*sample) {
                // A sample that is refused changes nothing; tests that expect a refusal push for themselves.
                let _ = self.estimator.push_imu(in_scalar(&sample));
            }
            if sample.stamp >= stamp {
                break;
            }
        }
    }

    /// One image, its inertial samples pushed before.
    pub fn push_frame(&mut self, stamp: Timestamp, observations: &[Observation<f64>]) -> Result<FrameOutcome, InputError> {
        self.push_tracks(stamp, observations)?;
        Ok(self.step(stamp))
    }

    fn push_tracks(&mut self, stamp: Timestamp, observations: &[Observation<f64>]) -> Result<(), InputError> {
        let observations: Vec<_> =
            observations.iter().map(|seen| Observation { track: seen.track, pixel: seen.pixel.map(T::of) }).collect();
        self.estimator.push_tracks(stamp, &observations)
    }

    /// What was pushed for the image, solved and kept.
    fn step(&mut self, stamp: Timestamp) -> FrameOutcome {
        let window = self.estimator.window();
        let predicted = window.frames.last().map(|frame| in_f64(&window.in_world(&frame.state)));
        let outcome = self.estimator.step(StepBudget::default());
        self.flown.outcomes.push((stamp, outcome));
        self.flown.health.push(self.estimator.health());
        if outcome == FrameOutcome::Initialised {
            let window = self.estimator.window();
            self.flown.origin = window.frames.first().map(|frame| (frame.stamp, in_f64(&window.in_world(&frame.state))));
        }
        if let (Some(estimate), Some(predicted)) = (self.estimator.state(), predicted) {
            self.flown.states.push(Knowledge {
                stamp: estimate.stamp,
                state: in_f64(&estimate.state),
                predicted,
                pose_covariance: estimate.pose_covariance.map(T::as_f64),
            });
        }
        outcome
    }

    /// The same with depths of some of its tracks.
    pub fn push_frame_with_depths(
        &mut self,
        stamp: Timestamp,
        observations: &[Observation<f64>],
        depths: &[(TrackId, DepthSample<T>)],
    ) -> Result<FrameOutcome, InputError> {
        self.push_tracks(stamp, observations)?;
        self.estimator.push_depths(stamp, depths)?;
        Ok(self.step(stamp))
    }

    /// One image with all that belongs to it; images that the estimator refuses are left out.
    pub fn fly(&mut self, frame: &Frame) {
        self.push_imu_past(frame.stamp, Some);
        let _ = self.push_frame(frame.stamp, &frame.observations);
    }
}

/// A whole recording.
pub fn fly<T: Real>(recording: &Recording, config: EstimatorConfig<T>) -> Flown {
    let mut pilot = Pilot::new(recording, config);
    for frame in &recording.frames {
        pilot.fly(frame);
    }
    pilot.flown
}

/// The samples in another scalar.
pub fn in_scalar<T: Real>(sample: &ImuSample<f64>) -> ImuSample<T> {
    ImuSample { stamp: sample.stamp, gyro_rad_s: sample.gyro_rad_s.map(T::of), accel_m_s2: sample.accel_m_s2.map(T::of) }
}

fn in_f64<T: Real>(state: &NavState<T>) -> NavState<f64> {
    let wide = |vector: &Vector3<T>| vector.map(T::as_f64);
    NavState {
        world_from_body: UnitQuaternion::new_normalize(Quaternion::from(state.world_from_body.coords.map(T::as_f64))),
        position_in_world: wide(&state.position_in_world),
        velocity_in_world: wide(&state.velocity_in_world),
        bias: libella_core::imu::ImuBias { gyro_rad_s: wide(&state.bias.gyro_rad_s), accel_m_s2: wide(&state.bias.accel_m_s2) },
    }
}

/// Does `work` for every job on as many threads as there are cores; results in the order of the jobs.
pub fn on_all_cores<J: Sync, R: Send>(jobs: &[J], work: impl Fn(&J) -> R + Sync) -> Vec<R> {
    let threads = std::thread::available_parallelism().map_or(2, std::num::NonZero::get).min(jobs.len().max(1));
    let (next, results) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        let worker = || {
            while let Some((index, job)) = {
                let index = next.fetch_add(1, Ordering::Relaxed);
                jobs.get(index).map(|job| (index, job))
            } {
                let result = work(job);
                results.lock().unwrap().push((index, result));
            }
        };
        let handles: Vec<_> =
            (0..threads).map(|_| std::thread::Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, worker).unwrap()).collect();
        for handle in handles {
            if let Err(payload) = handle.join() {
                std::panic::resume_unwind(payload);
            }
        }
    });
    let mut results = results.into_inner().unwrap();
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

/// Does `work` where the stack has room for an estimator.
pub fn with_room<R: Send>(work: impl Fn() -> R + Sync) -> R {
    on_all_cores(&[()], |()| work()).remove(0)
}
