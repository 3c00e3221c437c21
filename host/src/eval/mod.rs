//! Trajectories against the truth.

mod align;
mod ate;
mod consistency;
mod metric;
mod report;
mod rpe;
mod trajectory;

pub use align::{Alignment, align};
pub(crate) use ate::percentile;
pub use ate::{Matched, Statistics, associate, position_errors_m};
pub use consistency::{PoseWithCovariance, pose_nees, pose_nees_of_each};
pub use metric::metric_from;
pub use report::{Evaluation, evaluate};
pub use rpe::{RelativeError, relative_errors};
pub use trajectory::{StampedPose, Trajectory};
