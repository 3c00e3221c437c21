//! What memory holds before it is set up: zeros.
//!
//! A `static` of zeros takes no flash, and zeros are written straight to where they belong: a structure as large as most of the memory
//! must not be put together on the stack first.

use heapless::Vec;
use nalgebra::{ArrayStorage, Isometry3, Quaternion, SMatrix, Translation3, UnitQuaternion};

use crate::real::Real;
use crate::time::{Span, Timestamp};

/// A value of zeros, that means nothing yet: overwrite it before it is read.
pub(crate) trait Blank {
    /// All of its bytes are zero.
    const BLANK: Self;
}

/// `blank!([generics] Structure { its fields }; condition, "what must hold"; ...)`.
macro_rules! blank {
    ([$($generics:tt)*] $structure:ty { $($field:ident),+ $(,)? } $(; $condition:expr, $reason:literal)*) => {
        impl<$($generics)*> $crate::storage::blank::Blank for $structure {
            const BLANK: Self = {
                $(assert!($condition, $reason);)*
                Self { $($field: $crate::storage::blank::Blank::BLANK),+ }
            };
        }
    };
}
pub(crate) use blank;

impl<T: Real> Blank for T {
    const BLANK: Self = T::ZERO;
}

macro_rules! zero {
    ($($number:ty),+) => {
        $(impl Blank for $number { const BLANK: Self = 0; })+
    };
}
zero!(u8, u16, u32, usize);

impl Blank for bool {
    const BLANK: Self = false;
}

impl Blank for Timestamp {
    const BLANK: Self = Self::from_nanos(0);
}

impl Blank for Span {
    const BLANK: Self = Self::from_millis(0);
}

impl<A: Blank, B: Blank> Blank for (A, B) {
    const BLANK: Self = (A::BLANK, B::BLANK);
}

/// `None` is zeros where it has a tag of its own or is a null pointer; beside an enumeration it is the number after the last variant.
macro_rules! none {
    ($([$($generics:tt)*] $value:ty),+ $(,)?) => {
        $(impl<$($generics)*> Blank for Option<$value> { const BLANK: Self = None; })+
    };
}
none!([] Timestamp, [A, B, C] (A, B, C), [V, const N: usize] [V; N], [E, A, R] fn(&mut E, A) -> R);

impl<V: Blank, const N: usize> Blank for [V; N] {
    const BLANK: Self = [V::BLANK; N];
}

impl<V, const N: usize> Blank for Vec<V, N> {
    const BLANK: Self = Self::new();
}

impl<T: Real, const R: usize, const C: usize> Blank for SMatrix<T, R, C> {
    const BLANK: Self = Self::from_array_storage(ArrayStorage([[T::ZERO; R]; C]));
}

impl<T: Real> Blank for UnitQuaternion<T> {
    const BLANK: Self = Self::new_unchecked(Quaternion { coords: Blank::BLANK });
}

impl<T: Real> Blank for Isometry3<T> {
    const BLANK: Self = Self { rotation: Blank::BLANK, translation: Translation3 { vector: Blank::BLANK } };
}
