//! A small window of a simulated flight.

use std::vec::Vec;

use nalgebra::{Isometry3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

use crate::factor::point_on_plane::PlaneTerm;
use crate::factor::prior::Prior;
use crate::factor::reprojection::CameraMount;
use crate::imu::testing::{Motion, Normal, gravity, integrated};
use crate::imu::{ImuBias, ImuNoise, ImuSample, NavState, Preintegration};
use crate::real::Real;
use crate::robust::kernel::Kernel;
use crate::solve::{Settings, Workspace, add_initial};
use crate::storage::blocks::pairs;
use crate::track::TrackId;
use crate::window::{CameraPose, DepthPrior, DepthSource, Frame, GivenDepth, Landmark, NormalizedPoint, Window};

pub const FRAMES: usize = 8;
pub const PAIRS: usize = pairs(FRAMES);
pub const POINTS: usize = 48;
/// One over the standard deviation of a corner on the plane z = 1: one pixel of EuRoC's camera.
pub const INVERSE_SIGMA: f64 = 458.0;
/// One over the standard deviation of the inverse depths before anything is seen, m; where there is no noise, nothing is known
/// beforehand, so that the cost can vanish.
const DEPTH_PRIOR: f64 = 5.0;
/// Time between frames, ns.
const STEP_NS: i64 = 200_000_000;

pub type SmallWindow<T> = Window<T, FRAMES, POINTS>;
pub type SmallPrior<T> = Prior<T, FRAMES, PAIRS>;
pub type SmallWorkspace<T> = Workspace<T, FRAMES, PAIRS>;

/// What a world is made of.
#[derive(Clone, Copy)]
pub struct Recipe {
    pub seed: u64,
    pub frames: usize,
    /// Noise of the corners in standard deviations.
    pub noise: f64,
    /// Error of the states and depths: 1 is about a degree, a decimetre and a tenth of the depth.
    pub error: f64,
    pub kernel: Kernel<f64>,
}

impl Default for Recipe {
    fn default() -> Self {
        Self { seed: 1, frames: 6, noise: 1.0, error: 0.2, kernel: Kernel::Quadratic }
    }
}

/// A window with a prior on its first frame, and the truth.
pub struct World<T: Real> {
    pub window: SmallWindow<T>,
    pub prior: SmallPrior<T>,
    pub settings: Settings<T>,
    pub truth: Vec<NavState<T>>,
    /// True inverse depths in the order of the landmarks, 1/m.
    pub inverse_depths: Vec<T>,
}

/// Standard deviations of the first frame: `[φ p v b_g b_a]`.
const FIRST_SIGMA: [f64; 5] = [0.02, 0.01, 0.3, 0.02, 0.1];

fn cast<T: Real>(state: &NavState<f64>) -> NavState<T> {
    NavState {
        world_from_body: UnitQuaternion::new_normalize(state.world_from_body.coords.map(T::of).into()),
        position_in_world: state.position_in_world.map(T::of),
        velocity_in_world: state.velocity_in_world.map(T::of),
        bias: cast_bias(&state.bias),
    }
}

fn cast_bias<T: Real>(bias: &ImuBias<f64>) -> ImuBias<T> {
    ImuBias { gyro_rad_s: bias.gyro_rad_s.map(T::of), accel_m_s2: bias.accel_m_s2.map(T::of) }
}

/// A random error of a state, `scale` 1: 0.02 rad, 0.1 m, 0.1 m/s, 0.005 rad/s, 0.02 m/s².
pub fn state_error(normal: &mut Normal, scale: f64) -> [f64; 15] {
    core::array::from_fn(|i| scale * normal.draw() * [0.02, 0.1, 0.1, 0.005, 0.02][i / 3])
}

pub fn settings<T: Real>(kernel: Kernel<f64>) -> Settings<T> {
    let pose = Isometry3::from_parts(
        Translation3::new(T::of(0.05), T::of(-0.02), T::of(0.03)),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -1.2, 0.4).map(T::of)),
    );
    let kernel = match kernel {
        Kernel::Huber { threshold_squared } => Kernel::huber(T::of(threshold_squared)),
        _ => Kernel::Quadratic,
    };
    Settings {
        gravity_in_world: gravity().map(T::of),
        body_from_camera: pose,
        mount: CameraMount::new(&pose),
        kernel,
        depth_prior: DepthPrior { mean: T::of(0.2), inverse_sigma: T::ZERO },
        guessed_depth_prior: DepthPrior { mean: T::of(0.25), inverse_sigma: T::of(4.0) },
        rest_sigma_m_s: T::of(0.02),
        position_jitter_m: T::of(1e-3),
        behind_camera_cost: T::of(100.0),
    }
}

/// The true states, each predicted from the one before, so that the inertial residuals vanish there.
fn flight(frames: usize) -> (Vec<NavState<f64>>, Vec<Vec<ImuSample<f64>>>) {
    let motion = Motion { agility: 0.3, ..Motion::lively() };
    let mut states: Vec<NavState<f64>> = Vec::from([motion.state(0.0)]);
    let mut samples = Vec::new();
    for k in 1..frames as i64 {
        let between = motion.samples((k - 1) * STEP_NS, STEP_NS / 40, 40);
        let integral = integrated(motion.bias, &ImuNoise::adis16448(), &between);
        states.push(integral.predict(&states[k as usize - 1], &gravity()));
        samples.push(between);
    }
    (states, samples)
}

impl<T: Real> World<T> {
    pub fn new(recipe: &Recipe) -> Self {
        let mut normal = Normal(recipe.seed);
        let mut settings = settings::<T>(recipe.kernel);
        settings.depth_prior.inverse_sigma = T::of(if recipe.noise > 0.0 { DEPTH_PRIOR } else { 0.0 });
        let (truth, samples) = flight(recipe.frames);
        let mut window = SmallWindow::<T>::default();
        for (k, state) in truth.iter().enumerate() {
            let integral = match k.checked_sub(1) {
                Some(before) => {
                    let samples: Vec<_> = samples[before].iter().map(cast_sample).collect();
                    integrated(cast_bias(&state.bias), &ImuNoise::adis16448(), &samples)
                }
                None => Preintegration::new(cast_bias(&state.bias)),
            };
            let start = cast::<T>(&state.retract(&state_error(&mut normal, recipe.error)));
            let stamp = crate::time::Timestamp::from_nanos(k as i64 * STEP_NS);
            assert!(window.frames.push(Frame::new(stamp, start, integral)).is_ok());
        }
        let exact = self::settings::<f64>(recipe.kernel);
        let poses: Vec<_> = truth.iter().map(|state| CameraPose::of(state, &exact.body_from_camera)).collect();
        let mut inverse_depths = Vec::new();
        let mut index = 0;
        while window.landmarks.len() < POINTS {
            let anchor = index % 3 % (recipe.frames - 2);
            // Every other one is still seen by the newest frame.
            let last = if index % 2 == 0 { recipe.frames - 1 } else { (anchor + 2 + index % 3).min(recipe.frames - 2) };
            index += 1;
            let direction = Vector3::new(0.4 * normal.draw(), 0.3 * normal.draw(), 1.0);
            let inverse_depth = 1.0 / (4.0 + 2.0 * normal.draw().abs());
            let seen: Option<Vec<_>> = (anchor..=last).map(|frame| see(&poses[anchor], &poses[frame], &direction, inverse_depth)).collect();
            let Some(seen) = seen else { continue };
            let mut points = seen
                .into_iter()
                .map(|point| point + normal.vector(recipe.noise / INVERSE_SIGMA).xy())
                .map(|point| NormalizedPoint { x: T::of(point.x), y: T::of(point.y), inverse_sigma: T::of(INVERSE_SIGMA) });
            let mut landmark = Landmark::new(TrackId(index as u32), anchor, points.next().unwrap_or_default());
            for (frame, point) in points.enumerate() {
                landmark.observe(anchor + 1 + frame, point);
            }
            // The estimate starts at the truth: the noise-free cost can vanish.
            landmark.bearing = [T::of(direction.x), T::of(direction.y)];
            landmark.inverse_depth = T::of(inverse_depth * (1.0 + 0.1 * recipe.error * normal.draw()));
            landmark.active = true;
            // Each kind of prior, where there is noise for them to stand against.
            match index % 3 {
                0 if recipe.noise > 0.0 => landmark.depth_source = DepthSource::Guessed,
                1 if recipe.noise > 0.0 => landmark.give(GivenDepth { inverse_depth: T::of(0.25), inverse_sigma_log: T::of(2.0) }),
                _ => {}
            }
            inverse_depths.push(T::of(inverse_depth));
            assert!(window.landmarks.push(landmark).is_ok());
        }
        let mut prior = SmallPrior::<T>::default();
        let root = SVector::<T, 15>::from_fn(|i, _| T::of(1.0 / FIRST_SIGMA[i / 3]));
        let mut workspace = std::boxed::Box::<SmallWorkspace<T>>::default();
        add_initial(&mut prior, &mut workspace, &cast(&truth[0]), &SMatrix::from_diagonal(&root));
        Self { window, prior, settings, truth: truth.iter().map(cast).collect(), inverse_depths }
    }

    /// The same window without any prior.
    pub fn without_prior(mut self) -> Self {
        self.prior.clear();
        self
    }

    /// The same window with every other landmark on a plane that its true point is within three standard deviations of.
    pub fn with_planes(mut self) -> Self {
        let mut normal = Normal(77);
        for (landmark, inverse_depth) in self.window.landmarks.iter_mut().zip(&self.inverse_depths).step_by(2) {
            let camera = CameraPose::of(&self.truth[landmark.anchor()], &self.settings.body_from_camera);
            let point = camera.center_in_world + camera.world_from_camera * landmark.direction() / *inverse_depth;
            let n = normal.vector(1.0).normalize().map(T::of);
            let off = T::of(0.06 * normal.draw().clamp(-1.0, 1.0));
            landmark.plane = PlaneTerm { normal_in_world: n.into(), offset_m: off - n.dot(&point), inverse_sigma: T::of(50.0) };
        }
        self
    }

    /// Moves every state by a random error.
    pub fn disturb(&mut self, seed: u64, scale: f64) {
        let mut normal = Normal(seed);
        for frame in &mut self.window.frames {
            frame.state = frame.state.retract(&state_error(&mut normal, scale).map(T::of));
        }
    }
}

fn cast_sample<T: Real>(sample: &ImuSample<f64>) -> ImuSample<T> {
    ImuSample { stamp: sample.stamp, gyro_rad_s: sample.gyro_rad_s.map(T::of), accel_m_s2: sample.accel_m_s2.map(T::of) }
}

/// Where a landmark is seen, unless it lies too far aside.
fn see(anchor: &CameraPose<f64>, target: &CameraPose<f64>, direction: &Vector3<f64>, inverse_depth: f64) -> Option<nalgebra::Vector2<f64>> {
    let (rotation, translation) = CameraPose::target_from_anchor(target, anchor);
    let ray = rotation * direction + translation * inverse_depth;
    let point = ray.xy() / ray.z;
    (ray.z > 0.3 && point.norm() < 1.5).then_some(point)
}

/// The same window once more.
pub fn copy<T: Real>(window: &SmallWindow<T>) -> SmallWindow<T> {
    Window { origin_in_world: window.origin_in_world, frames: window.frames.clone(), landmarks: window.landmarks.clone() }
}
