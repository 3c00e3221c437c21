//! The scalar of all computations: `f32` on target, `f64` on the host.

use nalgebra::RealField;

/// A floating-point scalar.
///
/// The elementary functions that cost most on a microcontroller go through this trait under names of their own,
/// so that a target can bring a cheaper version in one place.
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
