//! A run in the viewer [rerun](https://rerun.io): recorded into a file, or shown while it goes on.
//!
//! ```text
//! /world                     z up, the estimator's world, m
//!   /camera                  its pose
//!     /image                 pinhole and image; corners, tracks, planes: where they are in it, raw px
//!     /depth                 pinhole and depth of images that have one, m
//!   /points                  landmarks of the window        /map     all points, at the end
//!   /planes/ID               polygons in their colours      /trajectory   the way so far
//!   /truth                   at the end, laid onto the estimate by the alignment of the position error
//! /error/position, /error/nees                              at the end
//! /bias/gyro, /bias/accel    each axis, with three standard deviations about it
//! /time_ms                   stages of the estimator        /depth_scale, /tracked, /health
//! ```
//! Time is that since the first image (`time`) and its number (`image`). The viewer knows no lens: it shows raw images, and its pinhole is
//! that of the calibration without distortion.
//!
//! All of it needs the feature `rerun`; without it [`Viewer::open`] says so.

#[cfg(not(feature = "rerun"))]
mod absent;
#[cfg(feature = "rerun")]
mod layout;
#[cfg(feature = "rerun")]
mod live;
#[cfg(feature = "rerun")]
mod series;
#[cfg(feature = "rerun")]
mod shapes;
#[cfg(feature = "rerun")]
mod sink;

#[cfg(not(feature = "rerun"))]
pub use absent::Viewer;
#[cfg(feature = "rerun")]
pub use live::Viewer;

use std::path::PathBuf;

/// Where a viewer of this machine listens.
pub const DEFAULT_URL: &str = "rerun+http://127.0.0.1:9876/proxy";

/// Where a run is shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// A file (`.rrd`) that a viewer opens later.
    File(PathBuf),
    /// A viewer that listens at this address, [`DEFAULT_URL`] for one.
    Connect(String),
}
