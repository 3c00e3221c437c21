//! The planes of a flight: found among the points of the map, in a thread of their own, and kept by name.
//!
//! ```text
//! landmarks ─▶ points ─ snapshot, every 30 images ─▶ seeker (thread) ─ detections, 10 images later ─▶ finder ─▶ estimator, files
//! ```
//! The answer to a snapshot is applied at a fixed image, and waited for if need be: a run gives the same planes and poses however fast
//! the machine is.

mod depth_look;
mod depth_points;
mod drift;
mod evidence;
mod files;
mod finder;
mod outline;
mod points;
mod seeker;
mod sight;
mod weighted;

pub use depth_look::{DepthLook, DepthReading};
pub use files::write;
pub(crate) use files::{color_of, light_color_of, name_of};
pub use finder::{FoundPlane, PlaneFinder, Planes, PlanesConfig};
pub use outline::outline_in_image;
pub use points::MapPoints;
