//! What all depths of a source have in common: a factor, for some sources also a shift of the inverse depth.
//!
//! # Model
//! `d = s d_source`. Each landmark whose depth motion has told gives one ratio `d / d_source`. The paper takes their mean
//! ([`mean_ratio`]); a median with its spread stands wrong depths ([`spread`] of their logarithms). [`ScaleTracker`] follows `ln s` over the images
//! as a random walk, because a network's factor hangs on what it sees and changes slowly:
//! ```text
//! P ← P + q Δt      K = P / (P + R)      ln s ← ln s + K (m − ln s)      P ← (1 − K) P
//! ```
//! Motion's depths are no truth: their scale, which is that of the trajectory, is some percent off for tens of seconds after a start. A
//! factor that is learned from them takes over that error, and a source that knows metres has nothing left to say about them. So a source
//! whose factor is known beforehand better than one image tells it is *taken at its word*: its factor stays where it is, but for what
//! motion says with [`MOTION_SIGMA`], until motion contradicts it beyond doubt. Then it is followed like any other.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::DepthSample;
use crate::real::Real;
use crate::robust::stats::spread;
use crate::storage::blank::blank;
use crate::time::Timestamp;

/// The mean of `d / d_source` over positive, finite ratios; `None` where there is none.
pub fn mean_ratio<T: Real>(ratios: impl Iterator<Item = T>) -> Option<T> {
    let usable = ratios.filter(|ratio| *ratio > T::ZERO && ratio.is_usable());
    let (sum, count) = usable.fold((T::ZERO, T::ZERO), |(sum, count), ratio| (sum + ratio, count + T::one()));
    if count > T::ZERO { Some(sum / count) } else { None }
}

/// `λ = factor λ_source + shift_per_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine<T> {
    /// Of the inverse depth.
    pub factor: T,
    /// 1/m.
    pub shift_per_m: T,
}

/// Factor and shift by weighted least squares over pairs `(λ_source, λ, 1/σ²)`; for sources that know depth up to both. `None` for
/// fewer than two different depths.
pub fn affine<T: Real>(pairs: impl Iterator<Item = (T, T, T)>) -> Option<Affine<T>> {
    let o = T::ZERO;
    let (mut sum, mut by_x, mut by_y, mut by_xx, mut by_xy) = (o, o, o, o, o);
    for (x, y, weight) in pairs {
        sum += weight;
        by_x += weight * x;
        by_y += weight * y;
        by_xx += weight * x * x;
        by_xy += weight * x * y;
    }
    let determinant = sum * by_xx - by_x * by_x;
    // Relative to its two terms: what is left of them by rounding is nothing.
    if !(determinant > sum * by_xx * T::default_epsilon() * T::of(64.0)) {
        return None;
    }
    let factor = (sum * by_xy - by_x * by_y) / determinant;
    Some(Affine { factor, shift_per_m: (by_y - factor * by_x) / sum })
}

/// What became of one depth map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It agrees with what motion tells, or motion tells nothing yet.
    Believed,
    /// Its factor is far from the one known so far: left out, unless it stays so.
    OtherScale,
    /// It explains the depths that motion tells no better than one constant would: it is no depth map of this image.
    NoDepth,
}

/// Follows the factor on the depths of a source over time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScaleTracker<T> {
    log_scale: T,
    variance: T,
    /// Variance of `ln s` that a second adds.
    walk_per_s: T,
    /// Standard deviation of what one image says, however many landmarks agree.
    image_sigma: T,
    /// Whether motion has not refuted what the source is known for.
    is_taken_at_its_word: bool,
    last: Option<Timestamp>,
    /// Images in a row that contradicted.
    refused: u8,
}

blank!([T: Real] ScaleTracker<T> { log_scale, variance, walk_per_s, image_sigma, is_taken_at_its_word, last, refused });

/// Standard deviation of the logarithm of what one image says of the factor of a source that is taken at its word: the scale of a
/// trajectory is about 5 % off for 20 s, which are a hundred images but tell as much as one does.
const MOTION_SIGMA: f64 = 0.5;
/// Images in a row after which what they say is believed instead.
const MOST_REFUSED: u8 = 10;
/// Squared standard deviations beyond which an image is refused.
const GATE: f64 = 9.0;
/// A map whose errors, one standard deviation of the logarithm, are above this and above most of the spread of the depths themselves says
/// nothing of depth.
const MOST_ERROR: f64 = 0.2;
const MOST_SHARE: f64 = 0.8;
/// Fewer landmarks say nothing.
const LEAST_LANDMARKS: usize = 8;

impl<T: Real> ScaleTracker<T> {
    /// A source whose factor is one within `sigma` (of its logarithm), whose factor walks by `walk_per_root_s` in a second, and of which
    /// one image tells the factor to `image_sigma`.
    #[must_use]
    pub fn new(sigma: T, walk_per_root_s: T, image_sigma: T) -> Self {
        Self {
            log_scale: T::ZERO,
            variance: sigma * sigma,
            walk_per_s: walk_per_root_s * walk_per_root_s,
            image_sigma,
            is_taken_at_its_word: sigma < image_sigma,
            last: None,
            refused: 0,
        }
    }

    /// `s`: the factor from the source's depths to metric ones.
    #[must_use]
    pub fn scale(&self) -> T {
        self.log_scale.exp()
    }

    /// Standard deviation of `ln s`.
    #[must_use]
    pub fn sigma_log(&self) -> T {
        self.variance.root()
    }

    /// Takes in what one image says: `ln(d / d_source)` of its landmarks and `ln d` of the same, both used up.
    pub fn update(&mut self, stamp: Timestamp, log_ratios: &mut [T], log_depths: &mut [T]) -> Verdict {
        if let (false, Some(last)) = (self.is_taken_at_its_word, self.last) {
            self.variance += self.walk_per_s * (stamp - last).as_seconds::<T>().max(T::ZERO);
        }
        self.last = Some(stamp);
        if log_ratios.len() < LEAST_LANDMARKS {
            return Verdict::Believed;
        }
        let (Some(found), Some(depths)) = (spread(log_ratios), spread(log_depths)) else { return Verdict::NoDepth };
        if found.sigma() > T::of(MOST_ERROR) && found.sigma() > depths.sigma() * T::of(MOST_SHARE) {
            return Verdict::NoDepth;
        }
        #[allow(clippy::cast_precision_loss)]
        let noise = self.image_sigma * self.image_sigma + found.sigma() * found.sigma() / T::of(LEAST_LANDMARKS as f64);
        let innovation = found.median - self.log_scale;
        if innovation * innovation > (self.variance + noise) * T::of(GATE) {
            self.refused = self.refused.saturating_add(1);
            if self.refused < MOST_REFUSED {
                return Verdict::OtherScale;
            }
            // So many cannot all be chance: start from them.
            (self.log_scale, self.variance) = (found.median, noise);
            self.is_taken_at_its_word = false;
        } else {
            let doubt = if self.is_taken_at_its_word { T::of(MOTION_SIGMA * MOTION_SIGMA) } else { T::ZERO };
            let gain = self.variance / (self.variance + noise + doubt);
            self.log_scale += gain * innovation;
            self.variance *= T::one() - gain;
        }
        self.refused = 0;
        Verdict::Believed
    }

    /// The sample in metres as the tracker knows them.
    #[must_use]
    pub fn apply(&self, sample: &DepthSample<T>) -> DepthSample<T> {
        DepthSample { inverse_depth: sample.inverse_depth / self.scale(), ..*sample }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Span;

    fn at(image: i64) -> Timestamp {
        Timestamp::from_nanos(0) + Span::from_nanos(image * 50_000_000)
    }

    /// Depths from 1 to 7 m, and the ratios of a source that is off by `factor`, with errors up to ±10 %.
    fn image(factor: f64, count: usize) -> (std::vec::Vec<f64>, std::vec::Vec<f64>) {
        let depths = (0..count).map(|k| (1.0 + 6.0 * k as f64 / count as f64).ln()).collect();
        let ratios = (0..count).map(|k| factor.ln() + 0.1 * ((k * 37 % 41) as f64 / 20.0 - 1.0)).collect();
        (ratios, depths)
    }

    fn tracker() -> ScaleTracker<f64> {
        ScaleTracker::new(0.2, 0.005, 0.1)
    }

    #[test]
    fn the_factor_of_a_source_is_found_and_its_doubt_falls() {
        let mut tracker = tracker();
        for k in 0..100 {
            let (mut ratios, mut depths) = image(1.15, 41);
            assert_eq!(tracker.update(at(k), &mut ratios, &mut depths), Verdict::Believed);
        }
        assert!((tracker.scale() / 1.15 - 1.0).abs() < 0.01, "{}", tracker.scale());
        assert!(tracker.sigma_log() < 0.03);
        let sample = tracker.apply(&DepthSample { inverse_depth: 0.5, sigma_log: 0.1, uncertainty: 0.1 });
        assert!((sample.inverse_depth * 1.15 - 0.5).abs() < 0.01);
    }

    #[test]
    fn one_image_of_another_scale_is_left_out_and_many_are_believed() {
        let mut tracker = tracker();
        for k in 0..50 {
            let (mut ratios, mut depths) = image(1.0, 41);
            tracker.update(at(k), &mut ratios, &mut depths);
        }
        let mut verdicts = std::vec::Vec::new();
        for k in 50..65 {
            let (mut ratios, mut depths) = image(2.0, 41);
            verdicts.push(tracker.update(at(k), &mut ratios, &mut depths));
            if k == 50 {
                assert!((tracker.scale() - 1.0).abs() < 0.01, "one image moved the factor to {}", tracker.scale());
            }
        }
        assert_eq!(verdicts[0], Verdict::OtherScale);
        assert_eq!(verdicts.last(), Some(&Verdict::Believed));
        assert!((tracker.scale() - 2.0).abs() < 0.05, "{}", tracker.scale());
    }

    #[test]
    fn a_source_that_knows_metres_keeps_its_word_until_it_is_refuted() {
        let mut tracker = ScaleTracker::<f64>::new(0.02, 0.005, 0.1);
        // The scale of a trajectory 5 % off, for 20 s.
        for k in 0..100 {
            let (mut ratios, mut depths) = image(1.05, 41);
            assert_eq!(tracker.update(at(4 * k), &mut ratios, &mut depths), Verdict::Believed);
        }
        assert!((tracker.scale() - 1.0).abs() < 0.01, "{}", tracker.scale());
        assert!(tracker.sigma_log() < 0.02);
        for k in 100..150 {
            let (mut ratios, mut depths) = image(0.25, 41);
            tracker.update(at(4 * k), &mut ratios, &mut depths);
        }
        assert!((tracker.scale() / 0.25 - 1.0).abs() < 0.02, "{}", tracker.scale());
        // From now on it is followed.
        for k in 150..300 {
            let (mut ratios, mut depths) = image(0.27, 41);
            tracker.update(at(4 * k), &mut ratios, &mut depths);
        }
        assert!((tracker.scale() / 0.27 - 1.0).abs() < 0.03, "{}", tracker.scale());
    }

    #[test]
    fn constants_inversions_and_noise_are_no_depth() {
        let (_, depths) = image(1.0, 41);
        let noise = |k: usize| ((k * 29 % 41) as f64 / 20.0 - 1.0) * 1.5;
        let told = |what: &str, source: &dyn Fn(usize, f64) -> f64| {
            let mut ratios: std::vec::Vec<f64> = depths.iter().enumerate().map(|(k, depth)| depth - source(k, *depth)).collect();
            assert_eq!(tracker().update(at(0), &mut ratios, &mut depths.clone()), Verdict::NoDepth, "{what}");
        };
        told("one depth everywhere", &|_, _| 0.9);
        told("near for far", &|_, depth| 2.0 - depth);
        told("anything", &|k, _| noise(k));
        told("depth lost in noise", &|k, depth| depth + noise(k));
        let mut broken = [f64::NAN; 20];
        assert_eq!(tracker().update(at(0), &mut broken, &mut depths[..20].to_vec()), Verdict::NoDepth);
    }

    #[test]
    fn a_flat_wall_is_no_reason_to_doubt() {
        let (mut ratios, _) = image(1.0, 41);
        assert_eq!(tracker().update(at(0), &mut ratios, &mut [0.7; 41]), Verdict::Believed);
    }

    #[test]
    fn factor_and_shift_are_recovered_and_one_depth_tells_neither() {
        let pairs = (1..30).map(|k| (f64::from(k) / 20.0, 0.8 * f64::from(k) / 20.0 + 0.1, 1.0 + f64::from(k % 3)));
        let found = affine(pairs).unwrap_or(Affine { factor: 0.0, shift_per_m: 0.0 });
        assert!((found.factor - 0.8).abs() < 1e-12 && (found.shift_per_m - 0.1).abs() < 1e-12);
        assert_eq!(affine((0..10).map(|_| (0.5, 0.4, 1.0))), None);
        assert_eq!(affine(core::iter::empty::<(f64, f64, f64)>()), None);
    }

    #[test]
    fn the_mean_follows_one_wrong_depth_and_the_median_does_not() {
        let ratios = [1.0, 1.1, 0.9, 1.05, 0.95, 30.0];
        assert!(mean_ratio(ratios.into_iter()).is_some_and(|mean| mean > 5.0));
        let mut logs = ratios.map(f64::ln);
        assert!(spread(&mut logs).is_some_and(|found| found.median.abs() < 0.1));
        assert_eq!(mean_ratio([f64::NAN, -1.0].into_iter()), None);
    }
}
