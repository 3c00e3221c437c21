//! How much a depth counts beside the corners.

use super::DepthSample;
use crate::real::Real;
use crate::storage::blank::Blank;

/// From a depth sample to the standard deviation of `ln λ` that a landmark takes from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Weighting<T> {
    /// Inverse variance: `k σ_log`. `k > 1` because the errors of many pixels are one error.
    Calibrated {
        /// `k`.
        inflation: T,
    },
    /// The paper's virtual right view: information `α (1 − u)` on its coordinate, so `σ_px / (f b λ √(α (1 − u)))`.
    VirtualRightView {
        /// `f b / σ_px`: focal length (px) times virtual baseline (m) over the standard deviation of a corner (px), m.
        baseline_m: T,
        /// `α`, how much the right view counts beside the left one, 0 to 1.
        alpha: T,
    },
    /// As in D3VO: a weight `c²/(c² + u²)` on a virtual right view, `u` taken for the spread of a residual.
    Damped {
        /// `f b / σ_px`, m.
        baseline_m: T,
        /// `c`.
        scale: T,
    },
}

impl<T: Real> Blank for Weighting<T> {
    const BLANK: Self = Self::Calibrated { inflation: T::ZERO };
}

impl<T: Real> Weighting<T> {
    /// The standard deviation of `ln λ`; `None` where the sample counts for nothing.
    #[must_use]
    pub fn sigma_log(&self, sample: &DepthSample<T>) -> Option<T> {
        let sigma = match *self {
            Self::Calibrated { inflation } => inflation * sample.sigma_log,
            Self::VirtualRightView { baseline_m, alpha } => {
                T::one() / (baseline_m * sample.inverse_depth * (alpha * (T::one() - sample.uncertainty)).root())
            }
            Self::Damped { baseline_m, scale } => {
                let ratio = sample.uncertainty / scale;
                (T::one() + ratio * ratio).root() / (baseline_m * sample.inverse_depth)
            }
        };
        if sigma > T::ZERO && sigma.is_usable() { Some(sigma) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The whitened residual of the virtual right view, computed in pixels, is near its zero that of `ln λ` with the sigma stated.
    #[test]
    fn the_virtual_right_view_is_a_prior_on_the_inverse_depth() {
        let (focal_px, baseline_m, sigma_px, alpha, u) = (458.0_f64, 0.1, 0.4, 0.8, 0.3);
        let sample = DepthSample { inverse_depth: 0.4, sigma_log: 0.2, uncertainty: u };
        let weighting = Weighting::VirtualRightView { baseline_m: focal_px * baseline_m / sigma_px, alpha };
        let sigma = weighting.sigma_log(&sample).unwrap_or(0.0);
        for inverse_depth in [0.399_99, 0.4, 0.400_01] {
            let left = 320.0;
            let measured_right = left - focal_px * baseline_m * sample.inverse_depth;
            let projected_right = left - focal_px * baseline_m * inverse_depth;
            let cost = alpha * (1.0 - u) * ((projected_right - measured_right) / sigma_px).powi(2);
            let prior = ((inverse_depth / sample.inverse_depth).ln() / sigma).powi(2);
            assert!((cost - prior).abs() <= 1e-4 * cost, "{cost} {prior}");
        }
    }

    #[test]
    fn doubt_widens_every_weighting_and_total_doubt_counts_nothing() {
        let at = |sigma_log: f64, uncertainty: f64| DepthSample { inverse_depth: 0.5, sigma_log, uncertainty };
        for weighting in [
            Weighting::Calibrated { inflation: 3.0 },
            Weighting::VirtualRightView { baseline_m: 100.0, alpha: 1.0 },
            Weighting::Damped { baseline_m: 100.0, scale: 0.3 },
        ] {
            let (sure, unsure) = (weighting.sigma_log(&at(0.1, 0.1)), weighting.sigma_log(&at(0.3, 0.6)));
            assert!(matches!((sure, unsure), (Some(sure), Some(unsure)) if sure < unsure), "{weighting:?}");
        }
        assert_eq!(Weighting::VirtualRightView { baseline_m: 100.0, alpha: 1.0 }.sigma_log(&at(0.1, 1.0)), None);
        assert_eq!(Weighting::Calibrated { inflation: f64::NAN }.sigma_log(&at(0.1, 0.5)), None);
    }
}
