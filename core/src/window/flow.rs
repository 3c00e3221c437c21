//! How an image moved as a whole.
//!
//! # Model
//! The displacements `d` of the corners at `p` are fitted by a shift, a zoom and a roll about their centre,
//! ```text
//! d = s + z (p − p̄) + w (p − p̄)⊥        size = √(‖s‖² + (z² + w²) mean‖p − p̄‖²)
//! ```
//! Four numbers out of hundreds of corners: their noise averages out, where the mean length of the displacements keeps it.

use super::NormalizedPoint;
use crate::real::Real;

/// Corners that are needed to tell.
const LEAST: f64 = 10.0;

/// Sums over the displacements of corners between two images.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CommonFlow<T> {
    count: T,
    position: [T; 2],
    squared: T,
    displacement: [T; 2],
    along: T,
    across: T,
}

impl<T: Real> CommonFlow<T> {
    /// Adds one corner, seen at `before` in the earlier image and at `after` in the later.
    pub fn add(&mut self, before: &NormalizedPoint<T>, after: &NormalizedPoint<T>) {
        let (x, y) = (before.x, before.y);
        let (dx, dy) = (after.x - x, after.y - y);
        self.count += T::one();
        self.position[0] += x;
        self.position[1] += y;
        self.squared += x * x + y * y;
        self.displacement[0] += dx;
        self.displacement[1] += dy;
        self.along += x * dx + y * dy;
        self.across += x * dy - y * dx;
    }

    /// Root mean square of the common displacement, in the units of the points; nothing below ten corners.
    #[must_use]
    pub fn size(&self) -> Option<T> {
        if self.count < T::of(LEAST) {
            return None;
        }
        let n = self.count;
        let ([px, py], [dx, dy]) = (self.position, self.displacement);
        // About the centre of the corners.
        let squared = self.squared - (px * px + py * py) / n;
        let along = self.along - (px * dx + py * dy) / n;
        let across = self.across - (px * dy - py * dx) / n;
        let turned = if squared > T::ZERO { (along * along + across * across) / squared } else { T::ZERO };
        Some((((dx * dx + dy * dy) / n + turned) / n).root())
    }
}
