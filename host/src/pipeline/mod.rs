//! Events to poses: the estimator in a thread of its own, its results sent out one image at a time.
//!
//! The caller keeps every result as it arrives, so that neither an interruption nor a fault of the estimator loses
//! what was computed before it.

mod estimate;
mod figure;
mod record;
mod resources;

pub use estimate::{Ended, FrameResult, PoseResult, Refusals, Run, run};
pub use figure::{Figure, draw};
pub use record::{Consistency, CoreTiming, LeftOut, Report, Timing, prepare_outputs, write_outputs};
pub use resources::rss_peak_mb;
