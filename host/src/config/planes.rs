//! `[planes]`

use libella_core::estimator::PlaneConfig;
use libella_core::real::Real;
use serde::{Deserialize, Serialize};

use crate::planes::PlanesConfig;

/// Planes among the points of the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlanesSection {
    /// Whether they are sought; `planes.json`, `points.ply` and `planes.png` then show them. Default true.
    pub find: bool,
    /// Whether landmarks are drawn to them. Default false.
    pub used: bool,
    /// A point is on a plane up to this distance, m. Default 0.05.
    pub theta_m: f64,
    /// What a point of a real surface is off its plane, m. Default 0.02.
    pub sigma_m: f64,
    /// What the cost of being off a plane counts beside that of corners. Default 0.1.
    pub weight: f64,
    /// Searches, 1.5 s apart at 20 Hz, that a plane has to be found in before it counts. Default 6.
    pub steady_after: u16,
    /// The share of its landmarks' median distance that a plane is moved by with each image. Default 0.1.
    pub follow: f64,
    /// Whether a point lies only on planes that its surface is parallel to, where a depth map tells which way that faces. Default true.
    pub normals: bool,
}

impl Default for PlanesSection {
    fn default() -> Self {
        let core = PlaneConfig::<f64>::default();
        Self {
            find: true,
            used: false,
            theta_m: core.theta_m,
            sigma_m: core.sigma_m,
            weight: core.weight,
            steady_after: 6,
            follow: 0.1,
            normals: true,
        }
    }
}

impl PlanesSection {
    /// What the finder reads of it; `None` where no plane is sought.
    #[must_use]
    pub fn finder(&self) -> Option<PlanesConfig> {
        (self.find || self.used).then_some(PlanesConfig {
            used: self.used,
            theta_m: self.theta_m,
            steady_after: self.steady_after,
            follow: self.follow,
            normals: self.normals,
        })
    }

    pub(super) fn for_core<T: Real>(&self) -> PlaneConfig<T> {
        PlaneConfig { weight: T::of(self.weight), sigma_m: T::of(self.sigma_m), theta_m: T::of(self.theta_m) }
    }

    /// What must be positive.
    pub(super) fn positive(&self) -> [(&'static str, f64); 4] {
        [
            ("planes.theta_m", self.theta_m),
            ("planes.sigma_m", self.sigma_m),
            ("planes.weight", self.weight),
            ("planes.steady_after", f64::from(self.steady_after)),
        ]
    }
}
