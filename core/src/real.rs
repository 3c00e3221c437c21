//! The scalar of all computations: `f32` on target, `f64` on the host.

use nalgebra::RealField;

/// A floating-point scalar.
///
/// The elementary functions that cost most on a microcontroller go through this trait under names of their own,
/// so that a target can bring a cheaper version in one place. Both scalars use `libm`, on every machine the same: on a Cortex-M7 all of
/// it takes 2.0 % of an image's instructions (`sqrtf` 1.1, `sincosf` 0.7, `logf` 0.2), which is what the approximations of `micromath`
/// could gain at most.
pub trait Real: RealField + Copy + Default + 'static {
    /// Zero, usable in constants.
    const ZERO: Self;
    /// The nearest value of this type.
    fn of(value: f64) -> Self;
    /// The value as `f64`, exact for both scalars.
    fn as_f64(self) -> f64;
    /// The value as `f32`, rounded.
    fn as_f32(self) -> f32;
    /// The square root; NaN for negative input.
    fn root(self) -> Self;
    /// `(sin, cos)` of an angle in radians.
    fn sine_cosine(self) -> (Self, Self);
    /// `atan2(self, x)`, the angle in radians of the vector `(x, self)`.
    fn arc_tangent(self, x: Self) -> Self;
    /// Whether neither infinite nor NaN.
    fn is_usable(self) -> bool;
}

macro_rules! impl_real {
    ($scalar:ty) => {
        impl Real for $scalar {
            const ZERO: Self = 0.0;
            #[inline(always)]
            #[allow(clippy::cast_possible_truncation)]
            fn of(value: f64) -> Self {
                value as $scalar
            }
            #[inline(always)]
            fn as_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            #[allow(clippy::unnecessary_cast)]
            fn as_f32(self) -> f32 {
                self as f32
            }
            #[inline(always)]
            fn root(self) -> Self {
                nalgebra::ComplexField::sqrt(self)
            }
            #[inline(always)]
            fn sine_cosine(self) -> (Self, Self) {
                nalgebra::ComplexField::sin_cos(self)
            }
            #[inline(always)]
            fn arc_tangent(self, x: Self) -> Self {
                nalgebra::RealField::atan2(self, x)
            }
            #[inline(always)]
            fn is_usable(self) -> bool {
                <$scalar>::is_finite(self)
            }
        }
    };
}

impl_real!(f32);
impl_real!(f64);

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn obeys_its_identities<T: Real>(a: f64, b: f64) {
        let epsilon = T::default_epsilon().as_f64();
        let (a, b) = (T::of(a), T::of(b));
        let (sine, cosine) = a.sine_cosine();
        assert!((sine * sine + cosine * cosine - T::one()).as_f64().abs() <= 4.0 * epsilon);
        assert!((sine.as_f64() - a.as_f64().sin()).abs() <= 2.0 * epsilon);
        assert!((cosine.as_f64() - a.as_f64().cos()).abs() <= 2.0 * epsilon);
        assert!((a.arc_tangent(b).as_f64() - a.as_f64().atan2(b.as_f64())).abs() <= 4.0 * epsilon);
        let root = (a * a).root();
        assert!((root - a.abs()).as_f64().abs() <= 2.0 * epsilon * a.as_f64().abs());
        assert_eq!(T::of(a.as_f64()), a);
        assert!(a.is_usable());
    }

    proptest! {
        #[test]
        fn both_scalars_obey_the_identities(a in -50.0f64..50.0, b in -50.0f64..50.0) {
            obeys_its_identities::<f32>(a, b);
            obeys_its_identities::<f64>(a, b);
        }

        #[test]
        fn conversions_are_exact_or_rounded(value in any::<f64>(), single in any::<f32>()) {
            prop_assert_eq!(f64::of(value).to_bits(), value.to_bits());
            prop_assert_eq!(value.as_f32().to_bits(), (value as f32).to_bits());
            prop_assert_eq!(f32::of(single.as_f64()).to_bits(), single.to_bits());
        }
    }

    #[test]
    fn what_is_not_a_number_is_not_usable() {
        assert!(!f64::NAN.is_usable() && !f64::INFINITY.is_usable() && !f32::NEG_INFINITY.is_usable());
        assert!(f64::MAX.is_usable() && f32::MIN_POSITIVE.is_usable());
        assert!((-1.0_f64).root().is_nan() && (-1.0_f32).root().is_nan());
        assert!(!f32::of(1e300).is_usable());
    }

    #[test]
    fn arc_tangent_knows_its_quadrant() {
        let half = core::f64::consts::PI;
        assert_eq!(
            [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)].map(|(y, x): (f64, f64)| y.arc_tangent(x)),
            [0.0, half / 2.0, half, -half / 2.0]
        );
    }
}
