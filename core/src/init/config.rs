//! What the moving start may assume, and why it may refuse.

use core::fmt;

use crate::real::Real;

/// Assumptions and thresholds of the moving start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InitConfig<T: Real> {
    /// Standard deviation of a corner's position, px.
    pub sigma_px: T,
    /// Focal length that turns angles into pixels, px.
    pub focal_px: T,
    /// Magnitude of gravity, m/s².
    pub gravity_m_s2: T,
    /// Standard deviation of the gyro bias before any measurement, rad/s.
    pub sigma_gyro_bias_rad_s: T,
    /// Standard deviation of the accelerometer bias before any measurement, m/s².
    pub sigma_accel_bias_m_s2: T,
    /// Standard deviation of the apparent change of the accelerometer bias, m/s³. Beside the bias itself it stands for scale
    /// and axis errors of both sensors, which turn gravity into false acceleration while the body turns.
    pub sigma_accel_drift_m_s3: T,
    /// Tracks seen in at least three frames that are needed.
    pub minimum_tracks: usize,
    /// Median displacement of the tracks beyond rotation that is needed, px.
    pub minimum_parallax_px: T,
    /// Largest standard deviation of the relative scale that is accepted.
    pub maximum_scale_sigma: T,
    /// Largest median reprojection error that is accepted, in units of `sigma_px`.
    pub maximum_median_residual: T,
    /// Iterations of the refinement at most; a motion that has not settled by then lacks excitation.
    pub maximum_iterations: usize,
    /// Least share of the observations within three standard deviations.
    pub minimum_inlier_ratio: T,
    /// Largest difference of the freely estimated gravity from the known magnitude, m/s², beyond three of its standard deviations.
    pub maximum_gravity_error_m_s2: T,
}

impl<T: Real> Default for InitConfig<T> {
    fn default() -> Self {
        Self {
            sigma_px: T::of(1.0),
            focal_px: T::of(458.0),
            gravity_m_s2: T::of(9.81),
            sigma_gyro_bias_rad_s: T::of(0.2),
            sigma_accel_bias_m_s2: T::of(0.1),
            sigma_accel_drift_m_s3: T::of(0.05),
            minimum_tracks: 15,
            minimum_parallax_px: T::of(6.0),
            maximum_scale_sigma: T::of(0.1),
            maximum_median_residual: T::of(2.0),
            maximum_iterations: 40,
            minimum_inlier_ratio: T::of(0.6),
            maximum_gravity_error_m_s2: T::of(1.5),
        }
    }
}

impl<T: Real> InitConfig<T> {
    /// Standard deviation of a bearing, rad.
    pub(crate) fn sigma_rad(&self) -> T {
        self.sigma_px / self.focal_px
    }
}

/// Why there are no first states yet. The outputs are unspecified then.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum InitError<T: Real> {
    /// Fewer than three frames, more than fit, or too little room in the outputs; the number of frames is given.
    Frames(usize),
    /// Too few tracks that are seen in three frames; their number is given.
    Tracks(usize),
    /// Median displacement beyond rotation, px.
    Parallax(T),
    /// The scale cannot be told yet; its relative standard deviation is given.
    Excitation(T),
    /// Gravity as vision and inertial samples have it together, m/s².
    Gravity(T),
    /// Vision and inertial samples contradict each other: median residual, px, and the share of inliers.
    Agreement(T, T),
    /// The equations were singular or a number was not finite.
    Numerical,
}

impl<T: Real> fmt::Display for InitError<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Frames(count) => write!(f, "{count} frames are too few or too many to start from"),
            Self::Tracks(count) => write!(f, "only {count} tracks are seen in three frames"),
            Self::Parallax(px) => write!(f, "tracks moved only {px:.1} px beyond rotation"),
            Self::Excitation(sigma) => write!(f, "scale is known to {:.0} % only: accelerate the camera", sigma.as_f64() * 100.0),
            Self::Gravity(magnitude) => write!(f, "gravity comes out as {magnitude:.2} m/s²: check units and axes"),
            Self::Agreement(px, ratio) => {
                write!(
                    f,
                    "images and inertial samples disagree by {px:.1} px ({:.0} % fit): check extrinsics and stamps",
                    ratio.as_f64() * 100.0
                )
            }
            Self::Numerical => write!(f, "the equations of the start are singular"),
        }
    }
}

impl<T: Real> core::error::Error for InitError<T> {}
