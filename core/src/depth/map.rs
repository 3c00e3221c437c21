//! A borrowed depth map.

use core::fmt;

use nalgebra::Vector2;

use crate::real::Real;

/// Neighbours whose inverse depths differ by more than this factor lie on two sides of an edge: what is between them is neither.
const EDGE_RATIO: f32 = 1.3;

/// What a depth map says at one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthSample<T> {
    /// `1/d` along the optical axis, 1/m.
    pub inverse_depth: T,
    /// Standard deviation of `ln d`.
    pub sigma_log: T,
    /// What the source itself says of its doubt, `u` in (0, 1).
    pub uncertainty: T,
}

impl<T: Real> DepthSample<T> {
    /// Whether all three are numbers, the depth and its sigma positive.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        let positive = |value: T| value > T::ZERO && value.is_usable();
        positive(self.inverse_depth) && positive(self.sigma_log) && self.uncertainty.is_usable()
    }
}

/// Inverse depths with their standard deviations, lent by the caller, row by row.
///
/// Map pixel `(i, j)` is the raw, distorted pixel `(i, j) · step + origin` of the camera's image.
#[derive(Debug, Clone, Copy)]
pub struct DepthView<'a> {
    width: usize,
    height: usize,
    step_px: [f32; 2],
    origin_px: [f32; 2],
    inverse_depth: &'a [f32],
    sigma_log: &'a [f32],
    uncertainty: &'a [f32],
}

/// Why slices are no depth map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DepthViewError {
    /// Width or height is below two.
    TooSmall,
    /// A step is zero, negative or no number, or the origin is no number.
    BadGrid,
    /// A slice does not hold `width × height` values.
    WrongLength {
        /// Values that the shape needs.
        needed: usize,
        /// Values that were given.
        given: usize,
    },
}

impl fmt::Display for DepthViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooSmall => write!(f, "a depth map needs at least two rows and two columns"),
            Self::BadGrid => write!(f, "the steps of a depth map must be positive and its origin finite"),
            Self::WrongLength { needed, given } => write!(f, "a depth map of this shape needs {needed} values where {given} were given"),
        }
    }
}

impl core::error::Error for DepthViewError {}

impl<'a> DepthView<'a> {
    /// A map of `size` = width × height values: `inverse_depth` in 1/m, `sigma_log` of `ln d`, `uncertainty` u in (0, 1). A value that is
    /// not positive, or no number, is unknown.
    ///
    /// # Errors
    /// When a slice does not fit the size, or the grid is none.
    pub fn new(
        size: (usize, usize),
        step_px: [f32; 2],
        origin_px: [f32; 2],
        inverse_depth: &'a [f32],
        sigma_log: &'a [f32],
        uncertainty: &'a [f32],
    ) -> Result<Self, DepthViewError> {
        let (width, height) = size;
        if width < 2 || height < 2 {
            return Err(DepthViewError::TooSmall);
        }
        if !(step_px.iter().all(|step| *step > 0.0 && step.is_finite()) && origin_px.iter().all(|origin| origin.is_finite())) {
            return Err(DepthViewError::BadGrid);
        }
        let needed = width.saturating_mul(height);
        for given in [inverse_depth.len(), sigma_log.len(), uncertainty.len()] {
            if given != needed {
                return Err(DepthViewError::WrongLength { needed, given });
            }
        }
        Ok(Self { width, height, step_px, origin_px, inverse_depth, sigma_log, uncertainty })
    }

    /// Width and height in values.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The raw pixel at the centre of value `(i, j)`.
    #[must_use]
    #[allow(clippy::cast_precision_loss)] // far below 2²⁴
    pub fn pixel<T: Real>(&self, i: usize, j: usize) -> Vector2<T> {
        let at = |index: usize, axis: usize| T::of(f64::from(index as f32 * self.step_px[axis] + self.origin_px[axis]));
        Vector2::new(at(i, 0), at(j, 1))
    }

    /// The value `(i, j)` as it is; `None` outside, or where it is unknown.
    #[must_use]
    pub fn value<T: Real>(&self, i: usize, j: usize) -> Option<DepthSample<T>> {
        if i >= self.width || j >= self.height {
            return None;
        }
        let at = j * self.width + i;
        let known = |value: f32| if value > 0.0 && value.is_finite() { Some(T::of(f64::from(value))) } else { None };
        Some(DepthSample {
            inverse_depth: known(*self.inverse_depth.get(at)?)?,
            sigma_log: known(*self.sigma_log.get(at)?)?,
            uncertainty: known(*self.uncertainty.get(at)?)?.min(T::one()),
        })
    }

    /// Bilinearly between the four values around a raw pixel; `None` outside, where one of the four is unknown, and across an edge of
    /// depth.
    #[must_use]
    pub fn sample<T: Real>(&self, pixel: &Vector2<T>) -> Option<DepthSample<T>> {
        let (i, right) = self.place(pixel.x, 0, self.width)?;
        let (j, below) = self.place(pixel.y, 1, self.height)?;
        let corners = [self.value(i, j)?, self.value(i + 1, j)?, self.value(i, j + 1)?, self.value(i + 1, j + 1)?];
        let weights = [(T::one() - right) * (T::one() - below), right * (T::one() - below), (T::one() - right) * below, right * below];
        let depths = corners.map(|corner: DepthSample<T>| corner.inverse_depth);
        let nearest = depths.iter().fold(depths[0], |most, value| most.max(*value));
        let farthest = depths.iter().fold(depths[0], |least, value| least.min(*value));
        if nearest > farthest * T::of(f64::from(EDGE_RATIO)) {
            return None;
        }
        let mean =
            |of: fn(&DepthSample<T>) -> T| corners.iter().zip(&weights).fold(T::ZERO, |sum, (corner, weight)| sum + of(corner) * *weight);
        Some(DepthSample {
            inverse_depth: mean(|corner| corner.inverse_depth),
            sigma_log: mean(|corner| corner.sigma_log),
            uncertainty: mean(|corner| corner.uncertainty),
        })
    }

    /// Index of the value at or before a raw coordinate, and the way to the next, 0 to 1.
    fn place<T: Real>(&self, coordinate: T, axis: usize, count: usize) -> Option<(usize, T)> {
        let at = (coordinate - T::of(f64::from(self.origin_px[axis]))) / T::of(f64::from(self.step_px[axis]));
        #[allow(clippy::cast_precision_loss)]
        let last = T::of((count - 1) as f64);
        // A network's values stand for areas: half a value beyond the outermost centre is still theirs.
        let half = T::of(0.5);
        if !(at >= -half && at <= last + half) {
            return None;
        }
        let inside = at.max(T::ZERO).min(last);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // between 0 and count − 1
        let index = (inside.as_f64() as usize).min(count - 2);
        #[allow(clippy::cast_precision_loss)]
        Some((index, inside - T::of(index as f64)))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::string::ToString;
    use std::vec::Vec;

    use super::*;
    use proptest::prelude::*;

    const SIZE: (usize, usize) = (5, 4);
    const STEP: [f32; 2] = [10.0, 8.0];
    const ORIGIN: [f32; 2] = [4.5, 3.5];

    fn filled(of: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        let at = |index: usize, axis: usize| index as f32 * STEP[axis] + ORIGIN[axis];
        (0..SIZE.0 * SIZE.1).map(|k| of(at(k % SIZE.0, 0), at(k / SIZE.0, 1))).collect()
    }

    fn view<'a>(depths: &'a [f32], ones: &'a [f32]) -> DepthView<'a> {
        DepthView::new(SIZE, STEP, ORIGIN, depths, ones, ones).unwrap_or_else(|error| unreachable!("{error}"))
    }

    proptest! {
        /// Bilinear interpolation gives back what is linear, at every pixel between the outermost centres.
        #[test]
        fn what_is_linear_comes_back(x in 4.5f64..44.5, y in 3.5f64..27.5) {
            let linear = |x: f32, y: f32| 0.5 + 0.001 * x + 0.002 * y;
            let (depths, ones) = (filled(linear), filled(|_, _| 0.1));
            let found = view(&depths, &ones).sample(&Vector2::new(x, y)).map(|sample| sample.inverse_depth);
            prop_assert!(found.is_some_and(|found| (found - f64::from(linear(x as f32, y as f32))).abs() < 1e-6), "{:?}", found);
        }

        #[test]
        fn no_pixel_and_no_value_panics(x in any::<f32>(), y in any::<f32>(), bad in any::<f32>(), at in 0usize..20) {
            let (mut depths, ones) = (filled(|_, _| 0.4), filled(|_, _| 0.1));
            depths[at] = bad;
            if let Some(sample) = view(&depths, &ones).sample(&Vector2::new(x, y)) {
                prop_assert!(sample.inverse_depth > 0.0 && sample.inverse_depth.is_finite());
            }
        }
    }

    #[test]
    fn half_a_value_beyond_the_rim_is_still_known_and_more_is_not() {
        let (depths, ones) = (filled(|_, _| 0.4), filled(|_, _| 0.1));
        let map = view(&depths, &ones);
        assert!(map.sample(&Vector2::new(-0.4, 0.0)).is_some());
        assert!(map.sample(&Vector2::new(-0.6, 0.0)).is_none());
        assert!(map.sample(&Vector2::new(49.4, 31.4)).is_some());
        assert!(map.sample(&Vector2::new(49.4, 31.6)).is_none());
        assert!(map.sample(&Vector2::new(f64::NAN, 3.0)).is_none());
    }

    #[test]
    fn an_edge_of_depth_and_an_unknown_neighbour_say_nothing() {
        let ones = filled(|_, _| 0.1);
        let edge = filled(|x, _| if x < 20.0 { 0.4 } else { 0.6 });
        assert!(view(&edge, &ones).sample(&Vector2::new(19.0, 10.0)).is_none());
        assert!(view(&edge, &ones).sample(&Vector2::new(9.0, 10.0)).is_some());
        let mut hole = filled(|_, _| 0.4);
        hole[6] = 0.0; // the second value of the second row
        assert!(view(&hole, &ones).sample(&Vector2::new(12.0, 10.0)).is_none());
        assert!(view(&hole, &ones).sample(&Vector2::new(32.0, 10.0)).is_some());
    }

    #[test]
    fn slices_and_grids_that_fit_nothing_are_refused() {
        let (depths, short) = (filled(|_, _| 0.4), [0.1_f32; 3]);
        let refused = |size, step, origin, sigma| DepthView::new(size, step, origin, &depths, sigma, &depths).unwrap_err().to_string();
        assert!(refused(SIZE, STEP, ORIGIN, &short[..]).contains("20 values where 3"));
        assert!(refused((1, 20), STEP, ORIGIN, &depths[..]).contains("two rows"));
        assert!(refused(SIZE, [0.0, 1.0], ORIGIN, &depths[..]).contains("positive"));
        assert!(refused(SIZE, STEP, [f32::NAN, 0.0], &depths[..]).contains("finite"));
    }
}
