//! Depth and uncertainty of images: networks in ONNX files, stored maps, and what may be wrong with either.
//!
//! ```text
//! GrayImage ─▶ worker (a thread of its own) ─▶ DepthNetwork ─┬─ onnx      a network in an ONNX file, run by tract
//!                                                            ├─ recorded  maps of `libella simulate`
//!                                                            └─ spoil     any of them with noise, or hostile
//! onnx: raw image ─▶ camera (the model's view of it) ─▶ tract ─▶ camera ─▶ DepthMap in raw pixels
//! ```
//!
//! Whoever reads a [`DepthMap`] works in raw pixels of its own camera and never hears of the model's.

mod alike; // depth without its uncertainty
mod area; // images shrink by averages over area
mod camera; // one camera's pixels in another's
mod card; // model.toml
mod choice; // --depth
mod error;
mod map;
#[cfg(feature = "network")]
mod onnx;
mod picture; // depth and uncertainty in colours
#[cfg(feature = "network")]
mod quiet;
mod recorded;
mod spoil;
mod worker;

pub use alike::Alike;
pub use camera::{Resampling, SAME_CAMERA_PX};
pub use card::{DepthOutput, DistortionModel, ModelCamera, ModelCard, OutputKind, UncertaintyOutput};
pub use choice::{MODELS_VARIABLE, ModelChoice};
pub use error::NetworkError;
pub use map::{DepthKind, DepthMap, DepthSample};
#[cfg(feature = "network")]
pub use onnx::{LARGEST_FILE_BYTES, OPERATOR_SETS, OnnxNetwork};
pub use picture::draw_depth;
pub use recorded::RecordedDepth;
pub use spoil::{DepthNoise, Spoil, Spoiled};
pub use worker::{DepthAnswer, DepthWorker, Timings};

use libella_core::image::ImageView;
use libella_core::time::Timestamp;

/// Whatever gives depth to an image.
pub trait DepthNetwork: Send {
    /// Depth of an image that was taken at `stamp`, in its raw pixels.
    ///
    /// The same image at the same stamp gives the same map, bit for bit, whatever was asked before; only [`Spoil::Frozen`] is
    /// meant to remember.
    ///
    /// # Errors
    /// When there is no map for this image; the next image may have one again.
    fn predict(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError>;

    /// What it is, in a few words for a report.
    fn describe(&self) -> String;

    /// What the numbers of its maps mean.
    fn kind(&self) -> DepthKind {
        DepthKind::Metric
    }
}

impl DepthNetwork for Box<dyn DepthNetwork> {
    fn predict(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        (**self).predict(stamp, image)
    }

    fn describe(&self) -> String {
        (**self).describe()
    }

    fn kind(&self) -> DepthKind {
        (**self).kind()
    }
}
