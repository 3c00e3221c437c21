//! Full bundle adjustment: all keyframes and landmarks of a flight at once.
//!
//! # Model
//! Keyframe `i` has the 15 numbers of a [`NavState`], landmark `l` the three of its position `x_l` in world, plane
//! `(n, d)` its offset, and if it is a wall its heading.
//! Gravity is known and world z is up. The cost is half the sum of
//! ```text
//! ‖W r(x_i, x_i+1)‖²                inertial samples between neighbours, and the random walk of the biases (core: factor::imu)
//! ρ(‖s (π(T_CW x_l) − z)‖²)         a corner (core: factor::reprojection), ρ of Huber
//! ρ(α s² (u(T_C'W x_l) − u')²)      its column in the virtual right view, where a network tells a depth
//! ρ(β (nᵀx_l + d)² / σ²)            a landmark on a plane (core: plane::Plane)
//! ‖v_i / σ_rest‖²                   a body found at rest
//! ‖b_0 / σ_b‖²                      biases of the first keyframe, as the estimator expects them before it has seen anything
//! ```
//! The residual of a corner is that of the core with the world as anchor: direction `x_l`, inverse depth one. The three that are the
//! core's are evaluated by the core: one definition of each.
//!
//! # Gauge
//! Nothing above tells the first position or heading. The normal equations are singular along these four directions, and a weight on
//! that part of the step of the first keyframe selects the solution that leaves it where it is; the cost is unchanged.
//!
//! # Elimination
//! Landmarks are eliminated (`eliminate`); what is left couples the poses of keyframes that see one landmark and the whole states of
//! neighbours (`sparse`). Tracks are short beside a flight, so the factor has a band, and time grows with the length of the flight.

mod eliminate;
mod inertial;
mod landmarks;
mod levenberg;
mod normal;
mod planes;
mod sparse;
mod views;

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

pub use inertial::pairs_between;
pub use levenberg::SolveReport;
pub use views::RightView;

use libella_core::estimator::EstimatorConfig;
use libella_core::factor::reprojection::CameraMount;
use libella_core::imu::{ImuNoise, ImuRange, ImuSample, NavState};
use libella_core::plane::Plane;
use libella_core::robust::kernel::Kernel;
use libella_core::time::Timestamp;
use libella_core::window::{CameraPose, NormalizedPoint};
use nalgebra::{Isometry3, Vector3};

use inertial::Link;
use planes::FreePlane;
use sparse::Structure;

/// Why a flight cannot be adjusted. Nothing changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BundleError {
    /// One keyframe or none: nothing moves.
    #[error("there are only {0} keyframes")]
    TooFewKeyframes(usize),
    /// Keyframes are not in the order of time.
    #[error("the keyframe at {0} is not newer than the one before it")]
    Order(Timestamp),
    /// A state, sample or corner is NaN or infinite.
    #[error("{0} is not a finite number")]
    NotFinite(String),
    /// A corner names a keyframe, or a landmark a plane, that is not there.
    #[error("landmark {0} refers to a keyframe or plane that does not exist")]
    Reference(usize),
    /// Inertial samples do not reach from one keyframe to the next.
    #[error("no inertial samples reach from {0} to {1}")]
    MissingImu(Timestamp, Timestamp),
    /// The inertial factor that ends there has no weight: a noise density of zero.
    #[error("the inertial samples before {0} have no usable noise")]
    Noise(Timestamp),
    /// No landmark is seen from three places far enough apart.
    #[error("no landmark is seen well enough")]
    NoLandmarks,
    /// The linear solver ran out of memory or had too large a problem.
    #[error("the normal equations cannot be set up ({0})")]
    Solver(String),
}

/// What the factors have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct BundleSettings {
    /// `g_W`, m/s².
    pub gravity_in_world: Vector3<f64>,
    /// `T_BC`.
    pub body_from_camera: Isometry3<f64>,
    /// Noise of the inertial samples, inflation included.
    pub imu_noise: ImuNoise<f64>,
    /// Largest readings.
    pub imu_range: ImuRange<f64>,
    /// Cost of a whitened observation.
    pub kernel: Kernel<f64>,
    /// Squared whitened residual over which an observation is taken out between rounds.
    pub outlier_chi2: f64,
    /// Standard deviation of the velocity of a body found at rest, m/s.
    pub rest_sigma_m_s: f64,
    /// Standard deviations of the first biases about zero, rad/s and m/s²; `None` where nothing is known of them.
    pub first_bias_sigma: Option<(f64, f64)>,
    /// Distance of the virtual right camera along the left one's x axis, m.
    pub virtual_baseline_m: f64,
    /// `α`, weight of the virtual right view.
    pub right_weight: f64,
    /// `β`, weight of planes.
    pub plane_weight: f64,
    /// `σ`, how far a point of a real surface is off its plane, m.
    pub plane_sigma_m: f64,
    /// `θ`, distance from a plane within which a landmark belongs to it, m.
    pub plane_theta_m: f64,
}

impl BundleSettings {
    /// What the estimator goes by, for the whole flight; what the estimator has no use for as in Ji et al., `β = 0.1` and `α = 1`.
    #[must_use]
    pub fn new(config: &EstimatorConfig<f64>, body_from_camera: Isometry3<f64>) -> Self {
        let sigma = &config.first_sigma;
        Self {
            gravity_in_world: Vector3::new(0.0, 0.0, -config.gravity_m_s2),
            body_from_camera,
            imu_noise: config.inflated_noise(),
            imu_range: ImuRange { gyro_rad_s: config.gyro_range_rad_s, accel_m_s2: config.accel_range_m_s2 },
            kernel: Kernel::huber(config.huber * config.huber),
            outlier_chi2: config.outlier_chi2,
            rest_sigma_m_s: config.rest_sigma_m_s,
            first_bias_sigma: Some((sigma.gyro_bias_rad_s, sigma.accel_bias_m_s2)),
            virtual_baseline_m: 0.1,
            right_weight: 1.0,
            plane_weight: config.planes.weight,
            plane_sigma_m: config.planes.sigma_m,
            plane_theta_m: config.planes.theta_m,
        }
    }
}

/// A state that is estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keyframe {
    /// When.
    pub stamp: Timestamp,
    /// Pose, velocity and biases.
    pub state: NavState<f64>,
    /// Whether the body was found at rest.
    pub at_rest: bool,
}

/// A landmark in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LandmarkView {
    /// Which keyframe.
    pub keyframe: usize,
    /// Where it is seen.
    pub point: NormalizedPoint<f64>,
    /// Where the virtual right camera sees it.
    pub right: Option<RightView>,
    /// Whether it takes part: outliers do not.
    pub used: bool,
}

/// A landmark.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmark {
    /// Where it is, m; means nothing until it is used.
    pub position_in_world: Vector3<f64>,
    /// Whether it takes part: seen well enough, in front of the cameras.
    pub used: bool,
    /// Who sees it, in the order of time.
    pub views: Vec<LandmarkView>,
    /// The plane that it lies on.
    pub plane: Option<usize>,
}

/// The problem, and its solution so far.
#[derive(Debug)]
pub struct Bundle {
    settings: BundleSettings,
    mount: CameraMount<f64>,
    keyframes: Vec<Keyframe>,
    landmarks: Vec<Landmark>,
    planes: Vec<FreePlane>,
    links: Vec<Link>,
    structure: Structure,
}

impl Bundle {
    /// A problem from first guesses. Keyframes in the order of time; `samples` reach past both ends. Landmarks are not used before they are
    /// [triangulated](Self::triangulate).
    ///
    /// # Errors
    /// When something is missing, not finite, or out of order.
    pub fn new(
        settings: BundleSettings,
        keyframes: Vec<Keyframe>,
        samples: &[ImuSample<f64>],
        mut landmarks: Vec<Landmark>,
        planes: Vec<Plane<f64>>,
    ) -> Result<Self, BundleError> {
        if keyframes.len() < 2 {
            return Err(BundleError::TooFewKeyframes(keyframes.len()));
        }
        if let Some(bad) = keyframes.iter().find(|keyframe| !keyframe.state.is_finite()) {
            return Err(BundleError::NotFinite(format!("the state at {}", bad.stamp)));
        }
        for (index, landmark) in landmarks.iter_mut().enumerate() {
            let known = landmark.views.iter().all(|view| view.keyframe < keyframes.len());
            if !known || landmark.plane.is_some_and(|plane| plane >= planes.len()) {
                return Err(BundleError::Reference(index));
            }
            if !landmark.views.iter().all(LandmarkView::is_finite) {
                return Err(BundleError::NotFinite(format!("a corner of landmark {index}")));
            }
            landmark.views.sort_by_key(|view| view.keyframe);
            landmark.views.dedup_by_key(|view| view.keyframe);
        }
        let links = inertial::links(&settings, &keyframes, samples)?;
        let structure = Structure::new(keyframes.len(), &landmarks, planes.len())?;
        let planes = planes.into_iter().map(FreePlane::new).collect();
        let mount = CameraMount::new(&settings.body_from_camera);
        Ok(Self { settings, mount, keyframes, landmarks, planes, links, structure })
    }

    /// The states.
    #[must_use]
    pub fn keyframes(&self) -> &[Keyframe] {
        &self.keyframes
    }

    /// The landmarks, those that are not used included.
    #[must_use]
    pub fn landmarks(&self) -> &[Landmark] {
        &self.landmarks
    }

    /// Landmarks and corners that take part.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        let used = || self.landmarks.iter().filter(|landmark| landmark.used);
        (used().count(), used().map(|landmark| landmark.views.iter().filter(|view| view.used).count()).sum())
    }

    /// Non-zeros of the factor of the reduced normal equations.
    #[must_use]
    pub fn factor_non_zeros(&self) -> usize {
        self.structure.factor_non_zeros()
    }

    /// The planes.
    pub fn planes(&self) -> impl Iterator<Item = &Plane<f64>> {
        self.planes.iter().map(|free| &free.plane)
    }

    /// Where the cameras are.
    fn camera_poses(&self) -> Vec<CameraPose<f64>> {
        self.keyframes.iter().map(|keyframe| CameraPose::of(&keyframe.state, &self.settings.body_from_camera)).collect()
    }
}

impl LandmarkView {
    /// A corner, its virtual right view unknown.
    #[must_use]
    pub fn new(keyframe: usize, point: NormalizedPoint<f64>) -> Self {
        Self { keyframe, point, right: None, used: true }
    }

    fn is_finite(&self) -> bool {
        let right = self.right.is_none_or(|right| right.x.is_finite() && right.inverse_sigma.is_finite());
        right && [self.point.x, self.point.y, self.point.inverse_sigma].iter().all(|value| value.is_finite())
    }
}
