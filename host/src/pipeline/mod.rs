//! Events to poses: the estimator in a thread of its own, its results sent out one image at a time.
//!
//! The caller keeps every result as it arrives, so that neither an interruption nor a fault of the estimator loses
//! what was computed before it.

mod depth;
mod estimate;
mod figure;
mod planes_figure;
mod record;
mod resources;
mod sheet;
mod simulated;
mod trails;
mod view;

pub use depth::{DepthResult, DepthTimes, DepthUse};
pub use estimate::{Ended, FrameResult, PoseResult, Refusals, Run, Watch, run, run_watched, run_with, run_with_depth};
pub use figure::{Figure, draw};
pub use planes_figure::draw_planes;
pub(crate) use record::nees_over_time;
pub use record::{
    Consistency, CoreTiming, DepthFigures, LeftOut, PlanesReport, Report, ScaleFigures, SmoothReport, Timing, evaluated, prepare_outputs,
    write_outputs, write_report, write_smooth,
};
pub use resources::rss_peak_mb;
pub use sheet::ContactSheet;
pub use simulated::{RenderClock, rendered_recording, tracked_recording};
pub(crate) use trails::Trails;
pub use view::{Corner, PlaneInView, View};
