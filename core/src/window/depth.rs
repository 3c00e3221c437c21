//! What is known of a landmark's depth beside its corners.

use crate::real::Real;
use crate::storage::blank::blank;

/// What is known of an inverse depth before anything is seen: normally distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthPrior<T> {
    /// Mean, 1/m.
    pub mean: T,
    /// One over the standard deviation, m.
    pub inverse_sigma: T,
}

blank!([T: Real] DepthPrior<T> { mean, inverse_sigma });

impl<T: Real> DepthPrior<T> {
    /// From mean and standard deviation, 1/m.
    #[must_use]
    pub fn new(mean_per_m: T, sigma_per_m: T) -> Self {
        Self { mean: mean_per_m, inverse_sigma: T::one() / sigma_per_m }
    }

    /// Whether an inverse depth of this `information` (m²) is known to the mean: its standard deviation is below that.
    #[inline]
    #[must_use]
    pub fn is_surpassed_by(&self, information: T) -> bool {
        self.mean * information.root() > T::one()
    }
}

/// What a depth map says of an inverse depth: its logarithm is normally distributed.
///
/// In `λ` itself, errors of the same share would count less where they make a thing look farther away, and a hundred landmarks with
/// errors of 15 % would all be found 3 % too far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GivenDepth<T> {
    /// Median, 1/m.
    pub inverse_depth: T,
    /// One over the standard deviation of the logarithm.
    pub inverse_sigma_log: T,
}

/// Below this share of the median the logarithm goes on as its tangent: steps of the solver may lead anywhere.
const LEAST_SHARE: f64 = 0.1;
/// How much a new value counts beside the old one.
const NEW_SHARE: f64 = 0.2;

impl<T: Real> GivenDepth<T> {
    /// Whitened: `ln(λ / median) / σ`.
    // Out of line: it stands in every loop over landmarks, and a logarithm is long.
    #[inline(never)]
    #[must_use]
    pub fn residual(&self, inverse_depth: T) -> T {
        let (share, least) = (inverse_depth / self.inverse_depth, T::of(LEAST_SHARE));
        let logarithm = if share > least { share.ln() } else { least.ln() + (share - least) / least };
        logarithm * self.inverse_sigma_log
    }

    /// `∂r/∂λ`, m.
    #[inline(never)]
    #[must_use]
    pub fn slope(&self, inverse_depth: T) -> T {
        self.inverse_sigma_log / inverse_depth.max(self.inverse_depth * T::of(LEAST_SHARE))
    }

    /// The same with one more value. Errors of one source on one thing are mostly the same error: values are averaged, and what is known
    /// does not grow with their number.
    #[must_use]
    pub fn with(&self, new: &Self) -> Self {
        let share = T::of(NEW_SHARE);
        Self {
            inverse_depth: self.inverse_depth * ((new.inverse_depth / self.inverse_depth).ln() * share).exp(),
            inverse_sigma_log: self.inverse_sigma_log + (new.inverse_sigma_log - self.inverse_sigma_log) * share,
        }
    }

    /// The same seen from another camera: `depth` of the ray `(x, y, 1)` along its axis, and how far `ahead` of the new camera the old
    /// one is, m. `λ' = λ / (depth + λ ahead)`, linearised at the median; `None` where that is behind it.
    #[inline(never)]
    #[must_use]
    pub fn seen_from(&self, depth: T, ahead: T) -> Option<Self> {
        let z = depth + self.inverse_depth * ahead;
        if !(z > T::of(0.05) && depth > T::of(0.05)) {
            return None;
        }
        Some(Self { inverse_depth: self.inverse_depth / z, inverse_sigma_log: self.inverse_sigma_log * z / depth })
    }
}

/// Where the prior of a landmark's inverse depth comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthSource {
    /// The usual depth, wide: motion decides.
    Usual,
    /// The usual depth, narrow, because motion has told nothing yet.
    Guessed,
    /// A depth map.
    Given,
}

/// A prior of either kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DepthKnowledge<T> {
    /// Of every landmark.
    Usual(DepthPrior<T>),
    /// Of this one.
    Given(GivenDepth<T>),
}

impl<T: Real> DepthKnowledge<T> {
    /// Nothing at all.
    #[must_use]
    pub fn none() -> Self {
        Self::Usual(DepthPrior { mean: T::ZERO, inverse_sigma: T::ZERO })
    }

    /// Whitened residual.
    #[inline(always)]
    #[must_use]
    pub fn residual(&self, inverse_depth: T) -> T {
        match self {
            Self::Usual(prior) => (inverse_depth - prior.mean) * prior.inverse_sigma,
            Self::Given(given) => given.residual(inverse_depth),
        }
    }

    /// Its derivative, m.
    #[inline(always)]
    #[must_use]
    pub fn slope(&self, inverse_depth: T) -> T {
        match self {
            Self::Usual(prior) => prior.inverse_sigma,
            Self::Given(given) => given.slope(inverse_depth),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn slopes_match_central_differences(median in 0.05f64..2.0, share in -0.5f64..4.0, sigma in 0.05f64..1.0) {
            let given = GivenDepth { inverse_depth: median, inverse_sigma_log: 1.0 / sigma };
            prop_assume!((share - LEAST_SHARE).abs() > 1e-3);
            for prior in [DepthKnowledge::Given(given), DepthKnowledge::Usual(DepthPrior::new(median, sigma))] {
                let (at, h) = (share * median, 1e-6 * median);
                let numerical = (prior.residual(at + h) - prior.residual(at - h)) / (2.0 * h);
                prop_assert!((numerical - prior.slope(at)).abs() < 1e-5 * prior.slope(at), "{} {}", numerical, prior.slope(at));
            }
        }

        /// Two roads to one answer: a normal `ln λ`, moved to another camera by sampling and by formula.
        #[test]
        fn another_camera_sees_the_same_depth(median in 0.1f64..1.0, depth in 0.8f64..1.2, ahead in -0.5f64..0.5) {
            let given = GivenDepth { inverse_depth: median, inverse_sigma_log: 1.0 / 0.01 };
            let Some(moved) = given.seen_from(depth, ahead) else { return Ok(()) };
            prop_assume!(depth + median * ahead > 0.3);
            let at = |sigmas: f64| {
                let inverse_depth = median * (0.01 * sigmas).exp();
                inverse_depth / (depth + inverse_depth * ahead)
            };
            prop_assert!((at(0.0) - moved.inverse_depth).abs() < 1e-12);
            let sigma_log = (at(1.0) / at(-1.0)).ln() / 2.0;
            prop_assert!((sigma_log * moved.inverse_sigma_log - 1.0).abs() < 1e-3, "{}", sigma_log);
        }
    }

    /// Landmarks with errors of one share in a hundred directions: the common factor that fits them best is one.
    #[test]
    fn errors_of_a_share_leave_the_scale_where_it_is() {
        let errors = (0..101).map(|k| 0.3 * f64::from(k - 50) / 25.0);
        let given: std::vec::Vec<_> =
            errors.map(|error| GivenDepth { inverse_depth: 0.4 * error.exp(), inverse_sigma_log: 1.0 / 0.3 }).collect();
        let gradient: f64 = given.iter().map(|given| given.residual(0.4) * given.slope(0.4)).sum();
        assert!(gradient.abs() < 1e-9, "{gradient}");
    }

    #[test]
    fn many_values_of_one_source_average_and_do_not_add_up() {
        let one = GivenDepth { inverse_depth: 0.5_f64, inverse_sigma_log: 4.0 };
        let other = GivenDepth { inverse_depth: 0.6, inverse_sigma_log: 4.0 };
        let mean = (0..50).fold(one, |sum, _| sum.with(&other));
        assert!((mean.inverse_depth - 0.6).abs() < 1e-4 && mean.inverse_sigma_log == 4.0);
    }
}
