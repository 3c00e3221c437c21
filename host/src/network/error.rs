//! Why an image got no depth.

use crate::fault::Fault;

/// Why an image got no depth. What was predicted for other images stands.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// The image is not of the camera that was announced.
    #[error("the image has {}x{} pixels and the camera {}x{}", .given[0], .given[1], .expected[0], .expected[1])]
    ImageSize {
        /// Width and height of the image, px.
        given: [usize; 2],
        /// Width and height of the camera's images, px.
        expected: [usize; 2],
    },
    /// Numbers that are not finite.
    #[error("the network's `{output}` has {count} of {of} values that are not finite")]
    NotFinite {
        /// Name of the output.
        output: String,
        /// How many.
        count: usize,
        /// Out of how many.
        of: usize,
    },
    /// An uncertainty below 0 or above 1.
    #[error("the network's `{output}` has the value {value}, which is no uncertainty between 0 and 1")]
    Uncertainty {
        /// Name of the output.
        output: String,
        /// The first such value.
        value: f32,
    },
    /// The network could not be run.
    #[error("the network failed ({0})")]
    Failed(String),
    /// A stored map that is absent or damaged.
    #[error(transparent)]
    Stored(#[from] Fault),
    /// The thread that works ended.
    #[error("the thread of the network ended")]
    Ended,
}
