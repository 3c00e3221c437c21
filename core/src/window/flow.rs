//! How an image moved as a whole.
//!
//! # Model
//! The displacements `d` of the corners at `p` are fitted by a shift, a zoom and a roll about their centre,
//! ```text
//! d = s + z (p − p̄) + w (p − p̄)⊥        size = √(‖s‖² + (z² + w²) mean‖p − p̄‖²)
//! ```
//! Four numbers out of hundreds of corners: their noise averages out, where the mean length of the displacements keeps it.
//! Only stillness is asked for, so corners that moved beyond a reach are left out, and too many of them are an answer by themselves.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::NormalizedPoint;
use crate::real::Real;
use crate::storage::blank::blank;
use crate::time::Timestamp;

/// Corners that are needed to tell.
const LEAST: f64 = 10.0;
/// The share of corners beyond the reach from which on the image moved, not they.
const MOST_BEYOND: f64 = 0.3;

/// Sums over the displacements of corners between two images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommonFlow<T> {
    reach: T,
    beyond: T,
    count: T,
    position: [T; 2],
    squared: T,
    displacement: [T; 2],
    along: T,
    across: T,
}

blank!([T: Real] CommonFlow<T> { reach, beyond, count, position, squared, displacement, along, across });

impl<T: Real> CommonFlow<T> {
    /// Corners that moved by `reach` or more, in the units of the points, are only counted.
    #[must_use]
    pub fn within(reach: T) -> Self {
        let (none, nowhere) = (T::ZERO, [T::ZERO; 2]);
        Self { reach, beyond: none, count: none, position: nowhere, squared: none, displacement: nowhere, along: none, across: none }
    }

    /// Adds one corner, seen at `before` in the earlier image and at `after` in the later.
    pub fn add(&mut self, before: &NormalizedPoint<T>, after: &NormalizedPoint<T>) {
        let (x, y) = (before.x, before.y);
        let (dx, dy) = (after.x - x, after.y - y);
        if !((dx * dx + dy * dy) < self.reach * self.reach) {
            self.beyond += T::one();
            return;
        }
        self.count += T::one();
        self.position[0] += x;
        self.position[1] += y;
        self.squared += x * x + y * y;
        self.displacement[0] += dx;
        self.displacement[1] += dy;
        self.along += x * dx + y * dy;
        self.across += x * dy - y * dx;
    }

    /// Root mean square of the common displacement, in the units of the points; nothing below ten corners, or where three in ten
    /// moved beyond the reach.
    #[must_use]
    pub fn size(&self) -> Option<T> {
        self.parts().map(|parts| norm(&parts))
    }

    /// Shift (2), zoom and roll, the latter two as the mean displacement that they make.
    fn parts(&self) -> Option<[T; 4]> {
        if self.count < T::of(LEAST) || self.beyond > (self.count + self.beyond) * T::of(MOST_BEYOND) {
            return None;
        }
        let n = self.count;
        let ([px, py], [dx, dy]) = (self.position, self.displacement);
        // About the centre of the corners.
        let squared = self.squared - (px * px + py * py) / n;
        let along = self.along - (px * dx + py * dy) / n;
        let across = self.across - (px * dy - py * dx) / n;
        let spread = if squared > T::ZERO { T::one() / (squared * n).root() } else { T::ZERO };
        Some([dx / n, dy / n, along * spread, across * spread])
    }
}

fn norm<T: Real>(parts: &[T; 4]) -> T {
    parts.iter().fold(T::ZERO, |sum, part| sum + *part * *part).root()
}

/// Since when the image stands still.
///
/// From image to image a slow body's motion drowns in the noise; the sum of the displacements since then does not.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stillness<T> {
    since: Option<Timestamp>,
    moved: [T; 4],
}

blank!([T: Real] Stillness<T> { since, moved });

impl<T: Real> Stillness<T> {
    /// Takes in how the image of `stamp` differs from the one before. The image counts as still while the sum since then is below `limit`, in
    /// the units of the points.
    pub fn update(&mut self, flow: &CommonFlow<T>, stamp: Timestamp, limit: T) {
        let Some(parts) = flow.parts() else {
            *self = Self::default();
            return;
        };
        for (sum, part) in self.moved.iter_mut().zip(parts) {
            *sum += part;
        }
        if self.since.is_none() || norm(&self.moved) >= limit {
            *self = Self { since: Some(stamp), moved: [T::ZERO; 4] };
        }
    }

    /// How long it has been standing still at `stamp`, s.
    #[must_use]
    pub fn lasted_s(&self, stamp: Timestamp) -> T {
        self.since.map_or(T::ZERO, |since| (stamp - since).as_seconds::<T>())
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    const REACH: f64 = 4e-3;

    /// Corners all over the image, each moved by what `motion` says.
    fn flow(motion: impl Fn(usize, f64, f64) -> [f64; 2]) -> CommonFlow<f64> {
        let mut flow = CommonFlow::within(REACH);
        let corners: Vec<_> = (0..100).map(|k| (f64::from(k % 10) * 0.1 - 0.3, f64::from(k / 10) * 0.08 - 0.4)).collect();
        for (k, (x, y)) in corners.into_iter().enumerate() {
            let [dx, dy] = motion(k, x, y);
            let point = |x, y| NormalizedPoint { x, y, inverse_sigma: 400.0 };
            flow.add(&point(x, y), &point(x + dx, y + dy));
        }
        flow
    }

    #[test]
    fn shift_zoom_and_roll_are_told_as_they_are() {
        let shift = flow(|_, _, _| [3e-4, -4e-4]).size();
        assert!(shift.is_some_and(|size| (size - 5e-4).abs() < 1e-12));
        // About the centre of the corners, (0.15, −0.04): mean squared distance 0.0825 + 0.0528.
        let turned = 1e-3 * (0.0825_f64 + 0.0528).sqrt();
        for size in
            [flow(|_, x, y| [1e-3 * (x - 0.15), 1e-3 * (y + 0.04)]).size(), flow(|_, x, y| [-1e-3 * (y + 0.04), 1e-3 * (x - 0.15)]).size()]
        {
            assert!(size.is_some_and(|size| (size - turned).abs() < 1e-12), "{size:?}");
        }
    }

    #[test]
    fn strays_are_left_out_until_they_are_many() {
        let with_strays = |every: usize| flow(|k, _, _| if k % every == 0 { [0.1, 0.2] } else { [1e-4, 0.0] }).size();
        assert!(with_strays(4).is_some_and(|size| (size - 1e-4).abs() < 1e-12));
        assert_eq!(with_strays(3), None);
        assert_eq!(flow(|_, _, _| [f64::NAN, 0.0]).size(), None);
    }

    #[test]
    fn a_slow_drift_ends_stillness_where_noise_does_not() {
        let limit = 5e-4;
        let at = |image: i64| Timestamp::from_nanos(image * 50_000_000);
        let mut still = Stillness::default();
        for image in 0..40 {
            let noise = if image % 2 == 0 { 4e-4 } else { -4e-4 };
            still.update(&flow(|_, _, _| [noise, 0.0]), at(image), limit);
        }
        assert!((still.lasted_s(at(39)) - 1.95).abs() < 1e-9);
        let mut longest = 0.0_f64;
        for image in 40..80 {
            still.update(&flow(|_, _, _| [1e-4, 0.0]), at(image), limit);
            longest = longest.max(if image > 50 { still.lasted_s(at(image)) } else { 0.0 });
        }
        // Five images of a fifth of the limit each.
        assert!(longest > 0.0 && longest < 0.26, "{longest}");
        still.update(&CommonFlow::within(REACH), at(80), limit);
        assert_eq!(still.lasted_s(at(80)), 0.0);
    }
}
