//! Order statistics in place, and the quantiles that decide what is an outlier.

use crate::real::Real;

// Quantiles of the χ² distribution, `P(χ²ₙ ≤ q) = p`: NIST/SEMATECH e-Handbook of Statistical Methods, section 1.3.6.7.4.
// The tests recompute them from the closed forms of the distribution.

/// 95 % of χ² with 1 degree of freedom.
pub const CHI2_95_1DOF: f64 = 3.841_458_820_694_124;
/// 95 % of χ² with 2 degrees of freedom: a pixel.
pub const CHI2_95_2DOF: f64 = 5.991_464_547_107_979;
/// 95 % of χ² with 3 degrees of freedom: a pixel and a virtual disparity.
pub const CHI2_95_3DOF: f64 = 7.814_727_903_251_179;
/// 99 % of χ² with 1 degree of freedom.
pub const CHI2_99_1DOF: f64 = 6.634_896_601_021_213;
/// 99 % of χ² with 2 degrees of freedom.
pub const CHI2_99_2DOF: f64 = 9.210_340_371_976_182;
/// 99 % of χ² with 3 degrees of freedom.
pub const CHI2_99_3DOF: f64 = 11.344_866_730_144_373;

/// `σ = 1.4826 MAD` for normally distributed values: the inverse of the normal distribution's 75 % quantile, 0.674490.
pub const SIGMA_PER_MAD: f64 = 1.482_602_218_505_602;

/// The median and how far the values lie from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread<T: Real> {
    /// The median.
    pub median: T,
    /// The median absolute deviation from the median.
    pub mad: T,
}

impl<T: Real> Spread<T> {
    /// The standard deviation of normally distributed values with this spread.
    #[must_use]
    pub fn sigma(&self) -> T {
        self.mad * T::of(SIGMA_PER_MAD)
    }
}

/// The value of rank `⌊p (n − 1)⌉` of `n`, `0 ≤ p ≤ 1`; reorders the values. `None` if there are none or one is not a number.
#[must_use]
pub fn quantile<T: Real>(values: &mut [T], p: T) -> Option<T> {
    if values.iter().any(|value| value.partial_cmp(value).is_none()) {
        return None;
    }
    let last = values.len().checked_sub(1)?;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss)]
    let rank = (p.as_f64() * last as f64 + 0.5) as usize; // a cast saturates, NaN becomes 0
    Some(select(values, rank.min(last)))
}

/// The median, the mean of the middle two where their number is even; reorders the values.
///
/// `None` if there are no values or one is not a number.
#[must_use]
pub fn median<T: Real>(values: &mut [T]) -> Option<T> {
    if values.is_empty() || values.iter().any(|value| value.partial_cmp(value).is_none()) {
        return None;
    }
    let middle = values.len() / 2;
    let upper = select(values, middle);
    if values.len() % 2 == 1 {
        return Some(upper);
    }
    // What lies before the middle is no larger; its largest is the other half of the median.
    let lower = values.iter().take(middle).fold(values[0], |largest, value| largest.max(*value));
    Some(lower + (upper - lower) * T::of(0.5))
}

/// Median and median absolute deviation; the values are replaced by their deviations.
///
/// `None` if there are no values or one is not a number.
#[must_use]
pub fn spread<T: Real>(values: &mut [T]) -> Option<Spread<T>> {
    let center = median(values)?;
    for value in values.iter_mut() {
        *value = (*value - center).abs();
    }
    Some(Spread { median: center, mad: median(values)? })
}

/// The value of a rank below the length, those before it no larger and those behind it no smaller; NaN has been ruled out. Hoare's: the
/// selection of `core`, which no order slows down, is 3 KB of a microcontroller's flash.
fn select<T: Real>(values: &mut [T], rank: usize) -> T {
    // What is left to part, and the rank within.
    let (mut part, mut at) = (&mut *values, rank);
    while let [_, _, ..] = part {
        let pivot = part[part.len() / 2];
        // Smaller ones first, then those equal to the pivot, then larger ones (Dijkstra).
        let (mut smaller, mut seen, mut larger) = (0, 0, part.len());
        while seen < larger {
            if part[seen] < pivot {
                part.swap(smaller, seen);
                smaller += 1;
                seen += 1;
            } else if part[seen] > pivot {
                larger -= 1;
                part.swap(seen, larger);
            } else {
                seen += 1;
            }
        }
        if at < smaller {
            part = &mut part[..smaller];
        } else if at < larger {
            break;
        } else {
            part = &mut part[larger..];
            at -= larger;
        }
    }
    values[rank]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// `P(χ²₁ ≤ q) = erf(√(q/2))`, by Simpson's rule on the density of a standard normal.
    fn within(sigmas: f64) -> f64 {
        let n = 2000;
        let density = |x: f64| (-0.5 * x * x).exp() / core::f64::consts::TAU.sqrt();
        let h = sigmas / f64::from(n);
        let inner: f64 = (1..n).map(|i| density(h * f64::from(i)) * if i % 2 == 1 { 4.0 } else { 2.0 }).sum();
        2.0 * h / 3.0 * (density(0.0) + density(sigmas) + inner)
    }

    #[test]
    fn quantiles_follow_from_the_distribution() {
        for (p, one, two, three) in [(0.95, CHI2_95_1DOF, CHI2_95_2DOF, CHI2_95_3DOF), (0.99, CHI2_99_1DOF, CHI2_99_2DOF, CHI2_99_3DOF)] {
            assert!((within(one.sqrt()) - p).abs() < 1e-12);
            assert!((1.0 - (-0.5 * two).exp() - p).abs() < 1e-14);
            // P₃(q) = P₁(q) − √(2q/π) e^(−q/2)
            assert!((within(three.sqrt()) - (2.0 * three / core::f64::consts::PI).sqrt() * (-0.5 * three).exp() - p).abs() < 1e-12);
        }
        // Half of a normal distribution lies within one MAD.
        assert!((within(1.0 / SIGMA_PER_MAD) - 0.5).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn median_and_quantiles_are_those_of_the_sorted_values(values in prop::collection::vec(-1e3f64..1e3, 1..80), p in 0.0f64..=1.0) {
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            let n = sorted.len();
            let expected = 0.5 * (sorted[n / 2] + sorted[(n - 1) / 2]);
            prop_assert!((median(&mut values.clone()).unwrap() - expected).abs() <= 1e-12 * expected.abs().max(1.0));
            let rank = (p * (n - 1) as f64).round() as usize;
            prop_assert_eq!(quantile(&mut values.clone(), p).unwrap(), sorted[rank]);
        }

        #[test]
        fn spread_shifts_and_scales_with_the_values(values in prop::collection::vec(-10f64..10.0, 1..40), shift in -50f64..50.0, scale in 0.1f64..9.0) {
            let plain = spread(&mut values.clone()).unwrap();
            let mut moved: Vec<_> = values.iter().map(|value| shift - scale * value).collect();
            let moved = spread(&mut moved).unwrap();
            prop_assert!((moved.median - (shift - scale * plain.median)).abs() < 1e-12 * 200.0);
            prop_assert!((moved.mad - scale * plain.mad).abs() < 1e-12 * 200.0);
        }
    }

    #[test]
    fn a_third_of_gross_errors_does_not_move_the_spread_much() {
        let mut values: Vec<f32> = (0..66_i16).map(|i| f32::from(i % 11) - 5.0).chain((0..33).map(|_| 1e6)).collect();
        let spread = spread(&mut values).unwrap();
        assert!((0.0..=4.0).contains(&spread.median) && spread.sigma() < 10.0, "{spread:?}");
    }

    #[test]
    fn nothing_and_not_a_number_have_no_median() {
        assert_eq!(median::<f64>(&mut []), None);
        assert_eq!(quantile::<f64>(&mut [], 0.5), None);
        assert_eq!(spread(&mut [1.0, f64::NAN, 2.0]), None);
        assert_eq!(quantile(&mut [1.0, 2.0], f64::NAN), Some(1.0));
        assert_eq!(quantile(&mut [1.0, 2.0], 7.0), Some(2.0));
        assert_eq!(spread(&mut [3.0]), Some(Spread { median: 3.0, mad: 0.0 }));
    }
}
