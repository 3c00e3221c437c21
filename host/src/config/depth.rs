//! Depth that someone else tells: which source, for which images, and how much it counts.

use libella_core::depth::Weighting as CoreWeighting;
use libella_core::estimator::DepthConfig;
use libella_core::real::Real;
use serde::{Deserialize, Serialize};

/// Where depth comes from, and for which images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DepthSection {
    /// `none`, `indoor`, `euroc`, an ONNX file with its card beside it, `recorded` for the maps of the recording or
    /// `recorded:FOLDER`. Default `none`.
    pub source: String,
    /// Images that get a depth at most, 1/s: about as many as become keyframes, which nobody knows before an image has been
    /// worked on. At the rate of the camera or above every image gets one. Default 5.0.
    pub rate_hz: f64,
    /// Whether what the source says of its uncertainty is listened to; otherwise all depths count alike, with `sigma_log` and a `u` of almost 0. Default true.
    pub uncertainty: bool,
    /// Without `uncertainty`: the standard deviation of ln depth that all depths have. Default 0.13: the median of
    /// what `indoor` states in rendered rooms.
    pub sigma_log: f64,
}

/// How much depth counts, see [`DepthConfig`]; the defaults are those of the core.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DepthUseSection {
    /// What a depth counts by. Default `calibrated`.
    pub weighting: Weighting,
    /// For `calibrated`: factor on the standard deviation that the source tells, because the errors of many pixels are one
    /// error. Default 8.0.
    pub inflation: f64,
    /// For `right_view` and `damped`: focal length times virtual baseline over the standard deviation of a corner, m. Default 3.0.
    pub right_view_m: f64,
    /// For `right_view`: how much the right view counts beside the left one, 0 to 1. Default 1.0.
    pub right_view_alpha: f64,
    /// For `damped`: the uncertainty at which a depth counts half. Default 0.2.
    pub damped_u: f64,
    /// Standard deviation of the logarithm of the source's factor before anything is known of it. Below `image_scale_sigma` the source is taken at its
    /// word, as a depth camera may be and a network must not. Default 0.2.
    pub scale_sigma: f64,
    /// How far that logarithm walks in a second. Default 0.005.
    pub scale_walk_per_root_s: f64,
    /// To what one image tells it. Default 0.1.
    pub image_scale_sigma: f64,
    /// A depth farther from what the corners say than this many standard deviations is given up. Default 3.0.
    pub gate_sigma: f64,
    /// Shortest stretch of motion for a start with depths, s. Default 0.3.
    pub shortest_start_s: f64,
}

/// What a depth counts by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Weighting {
    /// The standard deviation that the source tells, times a factor.
    #[default]
    Calibrated,
    /// `α (1 − u)` on the coordinate of a virtual right view.
    RightView,
    /// `c² / (c² + u²)` on it.
    Damped,
}

impl Default for DepthSection {
    fn default() -> Self {
        Self { source: "none".into(), rate_hz: 5.0, uncertainty: true, sigma_log: 0.13 }
    }
}

impl Default for DepthUseSection {
    fn default() -> Self {
        let core = DepthConfig::<f64>::default();
        let inflation = match core.weighting {
            CoreWeighting::Calibrated { inflation } => inflation,
            _ => 1.0,
        };
        Self {
            weighting: Weighting::Calibrated,
            inflation,
            right_view_m: 3.0,
            right_view_alpha: 1.0,
            damped_u: 0.2,
            scale_sigma: core.scale_sigma,
            scale_walk_per_root_s: core.scale_walk_per_root_s,
            image_scale_sigma: core.image_scale_sigma,
            gate_sigma: core.gate_sigma,
            shortest_start_s: core.shortest_start_s,
        }
    }
}

impl DepthUseSection {
    /// Keys that have to be positive, with their values.
    pub(super) fn positive(&self) -> [(&'static str, f64); 9] {
        [
            ("estimator.depth.inflation", self.inflation),
            ("estimator.depth.right_view_m", self.right_view_m),
            ("estimator.depth.right_view_alpha", self.right_view_alpha),
            ("estimator.depth.damped_u", self.damped_u),
            ("estimator.depth.scale_sigma", self.scale_sigma),
            ("estimator.depth.scale_walk_per_root_s", self.scale_walk_per_root_s),
            ("estimator.depth.image_scale_sigma", self.image_scale_sigma),
            ("estimator.depth.gate_sigma", self.gate_sigma),
            ("estimator.depth.shortest_start_s", self.shortest_start_s),
        ]
    }

    /// What the estimator reads of it.
    #[must_use]
    pub fn core<T: Real>(&self) -> DepthConfig<T> {
        DepthConfig {
            weighting: match self.weighting {
                Weighting::Calibrated => CoreWeighting::Calibrated { inflation: T::of(self.inflation) },
                Weighting::RightView => {
                    CoreWeighting::VirtualRightView { baseline_m: T::of(self.right_view_m), alpha: T::of(self.right_view_alpha) }
                }
                Weighting::Damped => CoreWeighting::Damped { baseline_m: T::of(self.right_view_m), scale: T::of(self.damped_u) },
            },
            scale_sigma: T::of(self.scale_sigma),
            scale_walk_per_root_s: T::of(self.scale_walk_per_root_s),
            image_scale_sigma: T::of(self.image_scale_sigma),
            gate_sigma: T::of(self.gate_sigma),
            shortest_start_s: T::of(self.shortest_start_s),
        }
    }
}
