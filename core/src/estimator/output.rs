//! What the estimator says.

use core::fmt;

use nalgebra::SMatrix;

use crate::depth::Verdict;
use crate::imu::NavState;
use crate::init::InitError;
use crate::real::Real;
use crate::solve::SolveReport;
use crate::storage::blank::{Blank, blank};
use crate::time::{Span, Timestamp};

/// What initialisation is waiting for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Waiting {
    /// Inertial samples that reach past the image.
    Imu,
    /// Enough corners followed long enough.
    Tracks,
    /// Motion: the camera has not seen enough parallax yet.
    Parallax,
    /// Acceleration: scale cannot be told from the motion so far.
    Excitation,
    /// Measured specific force is far from gravity: wrong units, wrong axes, or violent motion.
    Gravity,
    /// Vision and inertial samples contradict each other: wrong extrinsics, wrong time stamps, or a `sigma_px` far too small.
    Agreement,
    /// The rest of its own computation, which [`StepBudget::start_iterations`] spreads over some images.
    Computation,
}

/// How the estimator is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Health {
    /// No state yet.
    Initialising(Waiting),
    /// Vision and inertial samples agree.
    Tracking,
    /// Too few corners: the pose coasts on inertial samples.
    Degraded,
    /// Coasted too long; initialises anew with the next data.
    Lost,
}

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum FrameOutcome {
    /// There was no new frame to work on.
    NoFrame,
    /// The inertial samples do not reach the frame yet: push more, then step again.
    NeedImu,
    /// Stored; no state yet, for the reason given.
    Initialising(Waiting),
    /// This frame completed initialisation.
    Initialised,
    /// The newest pose is estimated.
    Tracked,
    /// The same, and the frame will stay as a keyframe.
    NewKeyframe,
    /// Too few corners: the pose coasts on inertial samples.
    Coasted,
    /// Tracking was lost; the estimator starts over.
    Lost,
}

/// Bounds of one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepBudget {
    /// Iterations of the solver at most; it ends sooner where the cost no longer falls.
    pub iterations: u8,
    /// Iterations of a start in motion that one image may take; [`Self::WHOLE_START`] computes all of it in the image that allows it.
    ///
    /// While a start is spread, corners are followed but images do not join the window, and the first state is that of the image with
    /// which the start began. With [`Self::even`] it takes three to nine images; one that lasts for three quarters of the inertial
    /// samples that there is room for is given up.
    pub start_iterations: u8,
}

impl StepBudget {
    /// A start in motion in one image.
    pub const WHOLE_START: u8 = u8::MAX;

    /// For a microcontroller: a start in motion is spread, so that no image takes much longer than one in flight.
    #[must_use]
    pub const fn even() -> Self {
        Self { iterations: 4, start_iterations: 16 }
    }

    pub(super) fn is_whole_start(self) -> bool {
        self.start_iterations == Self::WHOLE_START
    }
}

impl Default for StepBudget {
    fn default() -> Self {
        Self { iterations: 4, start_iterations: Self::WHOLE_START }
    }
}

/// The newest state with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateEstimate<T: Real> {
    /// Time of the image that it belongs to.
    pub stamp: Timestamp,
    /// Pose, velocity and biases.
    pub state: NavState<T>,
    /// Covariance of the pose, `[δφ δp]` (rad, m), 6×6.
    pub pose_covariance: SMatrix<T, 6, 6>,
}

/// What one step did, for reports and tuning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport<T: Real> {
    /// The solver's own report.
    pub solver: SolveReport<T>,
    /// Landmarks with a depth that the newest frame sees.
    pub tracked: usize,
    /// Observations taken out as outliers.
    pub outliers: usize,
    /// Robust cost per observation that was kept; about 0.75 where noise alone is left.
    pub mean_cost: T,
    /// Whether a keyframe was marginalised.
    pub marginalized: bool,
    /// Inertial samples since the image before that were at the end of their range.
    pub saturated: usize,
    /// Why the moving start refused, where it did.
    pub init_error: Option<InitError<T>>,
    /// What the depth map of this image did, where there was one.
    pub depth: Option<DepthReport<T>>,
}

/// What one depth map did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthReport<T> {
    /// Landmarks that the image sees and the map gives a depth.
    pub given: usize,
    /// Factor from the source's depths to metric ones.
    pub scale: T,
    /// Standard deviation of the logarithm of [`Self::scale`].
    pub sigma_log_scale: T,
    /// Whether the map agreed with what motion tells; one that does not is left out.
    pub verdict: Verdict,
}

impl<T: Real> Default for StepReport<T> {
    fn default() -> Self {
        let solver = SolveReport { initial_cost: T::ZERO, final_cost: T::ZERO, iterations: 0, accepted: 0 };
        Self { solver, tracked: 0, outliers: 0, mean_cost: T::ZERO, marginalized: false, saturated: 0, init_error: None, depth: None }
    }
}

impl<T: Real> Blank for StepReport<T> {
    const BLANK: Self = Self {
        solver: Blank::BLANK,
        tracked: 0,
        outliers: 0,
        mean_cost: T::ZERO,
        marginalized: false,
        saturated: 0,
        // Nothing at all would be the number after the last of the errors.
        init_error: Some(InitError::Frames(0)),
        depth: Blank::BLANK,
    };
}

blank!([T: Real] DepthReport<T> { given, scale, sigma_log_scale, verdict });

impl Blank for Verdict {
    const BLANK: Self = Self::Believed;
}

/// `None` would be the number after the last of the verdicts.
impl<T: Real> Blank for Option<DepthReport<T>> {
    const BLANK: Self = Some(Blank::BLANK);
}

impl Blank for Health {
    const BLANK: Self = Self::Initialising(Waiting::Imu);
}

/// Why an input was refused. Nothing changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum InputError {
    /// A number is NaN or infinite.
    NotFinite(Timestamp),
    /// Not newer than the last of its kind; the difference is given.
    Stale(Span),
    /// Size of the image, and what the camera says.
    WrongImageSize {
        /// Width and height given, px.
        given: (usize, usize),
        /// Width and height of the calibrated camera, px.
        expected: (usize, usize),
    },
    /// Inertial samples do not reach this image: push samples past it first.
    MissingImu(Timestamp),
    /// The caller's pyramid memory does not hold the image; its size per image is given.
    PyramidTooSmall {
        /// Bytes per image that were lent.
        bytes: usize,
    },
    /// No image of this time is in the window: a depth map comes with its image or soon after.
    NoSuchImage(Timestamp),
    /// More samples between two images than there is room for.
    Full,
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite(stamp) => write!(f, "the reading at {stamp} is not a finite number"),
            Self::Stale(by) => write!(f, "time stamp goes back by {by}"),
            Self::WrongImageSize { given, expected } => {
                write!(f, "image is {}x{} where the camera is calibrated for {}x{}", given.0, given.1, expected.0, expected.1)
            }
            Self::MissingImu(stamp) => write!(f, "inertial samples do not reach the image at {stamp}: push samples past it first"),
            Self::PyramidTooSmall { bytes } => write!(f, "pyramid memory of {bytes} bytes an image is too small for this image"),
            Self::NoSuchImage(stamp) => write!(f, "no image of {stamp} is in the window: push a depth map with its image or soon after"),
            Self::Full => write!(f, "no room for more inertial samples before the next image"),
        }
    }
}

impl core::error::Error for InputError {}
