//! Time as integer nanoseconds: exact, comparable, never rounded by a sum.

use core::fmt;
use core::ops::{Add, Neg, Sub};

use crate::real::Real;

/// An instant: nanoseconds since an epoch of the recording's choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Timestamp(i64);

/// A signed difference of two instants, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Span(i64);

impl Timestamp {
    /// An instant from its nanoseconds.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the epoch.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        self.0
    }
}

impl Span {
    /// A span from its nanoseconds.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// A span from milliseconds.
    #[must_use]
    pub const fn from_millis(millis: i64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// Nanoseconds, signed.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// The span in seconds.
    #[must_use]
    // Three calls of the software's double precision, in fifty places.
    #[cfg_attr(target_os = "none", inline(never))]
    pub fn as_seconds<T: Real>(self) -> T {
        #[allow(clippy::cast_precision_loss)]
        T::of(self.0 as f64 * 1e-9)
    }
}

impl Sub for Timestamp {
    type Output = Span;
    fn sub(self, earlier: Self) -> Span {
        Span(self.0.saturating_sub(earlier.0))
    }
}

impl Add<Span> for Timestamp {
    type Output = Self;
    fn add(self, span: Span) -> Self {
        Self(self.0.saturating_add(span.0))
    }
}

impl Sub<Span> for Timestamp {
    type Output = Self;
    fn sub(self, span: Span) -> Self {
        Self(self.0.saturating_sub(span.0))
    }
}

impl Add for Span {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl Neg for Span {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.saturating_neg())
    }
}

impl fmt::Display for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ns", self.0)
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} us", self.0 / 1_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::string::ToString;

    proptest! {
        #[test]
        fn differences_are_exact(a in any::<i32>(), b in any::<i32>()) {
            // Nanoseconds since 1970, as recordings carry them: no double holds these to the nanosecond.
            let epoch = 1_403_715_273_262_142_976_i64;
            let (earlier, later) = (Timestamp::from_nanos(epoch + i64::from(a)), Timestamp::from_nanos(epoch + i64::from(b)));
            let span = later - earlier;
            prop_assert_eq!(span.as_nanos(), i64::from(b) - i64::from(a));
            prop_assert_eq!(earlier + span, later);
            prop_assert_eq!(later - span, earlier);
            prop_assert_eq!(earlier - later, -span);
            prop_assert_eq!(span + -span, Span::default());
            prop_assert_eq!(earlier < later, a < b);
        }

        #[test]
        fn nothing_overflows(a in any::<i64>(), b in any::<i64>()) {
            let (instant, span) = (Timestamp::from_nanos(a), Span::from_nanos(b));
            prop_assert_eq!((instant + span).as_nanos(), a.saturating_add(b));
            prop_assert_eq!((instant - span).as_nanos(), a.saturating_sub(b));
            prop_assert_eq!((instant - Timestamp::from_nanos(b)).as_nanos(), a.saturating_sub(b));
            prop_assert!(Span::from_millis(b).as_seconds::<f64>().is_finite());
        }

        #[test]
        fn seconds_keep_the_precision_of_their_scalar(nanos in -10_000_000_000_i64..10_000_000_000) {
            let span = Span::from_nanos(nanos);
            let expected = nanos as f64 / 1e9;
            // Three roundings to half a unit in the last place: 1e-9, the product, and the quotient above.
            prop_assert!((span.as_seconds::<f64>() - expected).abs() <= 1.5 * f64::EPSILON * expected.abs());
            prop_assert!((f64::from(span.as_seconds::<f32>()) - expected).abs() <= 0.5001 * f64::from(f32::EPSILON) * expected.abs());
        }
    }

    #[test]
    fn units() {
        assert_eq!(Span::from_millis(5).as_nanos(), 5_000_000);
        assert_eq!(Span::from_millis(5).as_seconds::<f64>(), 0.005);
        assert_eq!(Timestamp::from_nanos(12).to_string(), "12 ns");
        assert_eq!(Span::from_millis(-5).to_string(), "-5000 us");
        assert_eq!((-Span::from_nanos(i64::MIN)).as_nanos(), i64::MAX);
    }
}
