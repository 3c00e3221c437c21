//! Where a distortion polynomial can be inverted.

use crate::real::Real;

/// Whether `g(u) = 1 + c₁u + … + c_N uᴺ` is positive on the whole of `[0, end]`.
///
/// With `g = P − M`, `P` gathering the positive and `M` the negative terms, both grow with `u`, so that `P(a) > M(b)` proves `g > 0`
/// on `[a, b]`. One such interval settles it for most lenses; otherwise the interval is walked in steps as long as the proof allows.
/// The walk is bounded; where it does not arrive the answer is no, which makes the field of view smaller by a hair at most.
pub(super) fn is_positive_up_to<T: Real, const N: usize>(coefficients: &[T; N], end: T) -> bool {
    let part = |sign: T, u: T| coefficients.iter().rev().fold(T::ZERO, |sum, &c| (sum + (sign * c).max(T::ZERO)) * u);
    let positive = |u: T| T::one() + part(T::one(), u);
    let negative = |u: T| part(-T::one(), u);
    let (mut from, mut step) = (T::ZERO, end);
    // Comparisons are written so that a NaN anywhere fails.
    for _ in 0..256 {
        let to = (from + step).min(end);
        let most_negative = negative(to);
        if positive(from) > most_negative {
            if to >= end {
                return end.is_usable();
            }
            from = to;
            step *= T::of(2.0);
        } else if positive(to) > most_negative {
            step *= T::of(0.5);
        } else {
            return false;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        // The road of the lens designer: sample the polynomial densely and look at its sign.
        #[test]
        fn agrees_with_dense_sampling(at_end in prop::array::uniform4(-4.0f64..4.0), end in 0.1f64..10.0) {
            let c = [at_end[0] / end, at_end[1] / end.powi(2), at_end[2] / end.powi(3), at_end[3] / end.powi(4)];
            let g = |u: f64| 1.0 + u * (c[0] + u * (c[1] + u * (c[2] + u * c[3])));
            let least = (0..=4000).map(|i| g(end * f64::from(i) / 4000.0)).fold(f64::INFINITY, f64::min);
            if least > 0.02 {
                prop_assert!(is_positive_up_to(&c, end));
            }
            if least <= 0.0 {
                prop_assert!(!is_positive_up_to(&c, end));
            }
        }
    }

    #[test]
    fn a_second_positive_branch_does_not_count() {
        // 1 − 3u + 2u² = (1 − u)(1 − 2u): negative between 1/2 and 1, positive again beyond.
        let c = [-3.0, 2.0];
        assert!(is_positive_up_to(&c, 0.49));
        assert!(!is_positive_up_to(&c, 0.51));
        assert!(!is_positive_up_to(&c, 1.5));
    }

    #[test]
    fn not_a_number_is_refused() {
        assert!(!is_positive_up_to(&[0.1, -0.2, 0.0], f64::NAN));
        assert!(!is_positive_up_to(&[0.1], f64::INFINITY));
    }
}
