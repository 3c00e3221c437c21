//! What marginalised frames and landmarks have said about the frames that remain, as a square root.
//!
//! # Model
//! `½ ‖R δ + d‖²` with `δ = x ⊟ x₀` stacked over the oldest frames of the window, `x₀` their first estimates, `R` upper
//! triangular. Jacobians stay where they were first evaluated (first-estimate Jacobians), so the prior gives no
//! information along the unobservable directions (position, yaw). Keeping `R` instead of `RᵀR` halves the digits that
//! the prior needs, which is what `f32` has.

use crate::imu::NavState;
use crate::real::Real;
use crate::storage::blocks::{Block, add_transposed_product, pairs, place, zero_block};
use crate::window::Frame;

/// A square-root prior on the first `frames` frames of the window.
#[derive(Debug)]
pub struct Prior<T: Real, const FRAMES: usize, const PAIRS: usize> {
    /// `R`: block row `i`, block column `j ≥ i` at `place(j, i)`.
    pub triangle: [Block<T, 15>; PAIRS],
    /// `d`.
    pub right: [[T; 15]; FRAMES],
    /// How many frames, from the oldest, it speaks of.
    pub frames: usize,
    /// Where the very first prior was set up; from the first marginalisation on, first estimates take its place.
    pub origin: Option<NavState<T>>,
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Default for Prior<T, FRAMES, PAIRS> {
    fn default() -> Self {
        const { assert!(PAIRS == pairs(FRAMES), "PAIRS must be FRAMES (FRAMES + 1) / 2") };
        Self { triangle: [zero_block(); PAIRS], right: [[T::ZERO; 15]; FRAMES], frames: 0, origin: None }
    }
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Prior<T, FRAMES, PAIRS> {
    /// Says nothing any more.
    pub fn clear(&mut self) {
        self.triangle.fill(zero_block());
        self.right.fill([T::ZERO; 15]);
        self.frames = 0;
        self.origin = None;
    }

    /// Moves the very first prior from its origin to the first estimate of its frame, by its own linear model.
    pub fn settle(&mut self, frames: &[Frame<T>]) {
        if let (Some(_), Some(frame)) = (self.origin, frames.first()) {
            let at_first_estimate = Frame { state: *frame.linearization_point(), ..*frame };
            let deltas = self.deltas(core::slice::from_ref(&at_first_estimate));
            self.right[0] = self.residual(&deltas, 0);
            self.origin = None;
        }
    }

    /// Twice the cost, `‖R δ + d‖²`.
    #[must_use]
    pub fn cost(&self, frames: &[Frame<T>]) -> T {
        let deltas = self.deltas(frames);
        (0..self.frames).flat_map(|i| self.residual(&deltas, i)).fold(T::ZERO, |sum, r| sum + r * r)
    }

    /// Adds `RᵀR` to the lower block triangle `hessian` and `Rᵀ (R δ + d)` to `gradient`.
    pub fn add_to(&self, frames: &[Frame<T>], hessian: &mut [Block<T, 15>], gradient: &mut [[T; 15]]) {
        let deltas = self.deltas(frames);
        for k in 0..self.frames {
            let residual = self.residual(&deltas, k);
            for i in k..self.frames {
                let rows = &self.triangle[place(i, k)];
                for (row, value) in rows.iter().zip(&residual) {
                    for (out, entry) in gradient[i].iter_mut().zip(row) {
                        *out += *entry * *value;
                    }
                }
                for j in k..=i {
                    add_transposed_product(&mut hessian[place(i, j)], rows, &self.triangle[place(j, k)]);
                }
            }
        }
    }

    /// `x ⊟ x₀` of each frame that the prior speaks of.
    fn deltas(&self, frames: &[Frame<T>]) -> [[T; 15]; FRAMES] {
        let mut deltas = [[T::ZERO; 15]; FRAMES];
        for (delta, frame) in deltas.iter_mut().zip(frames).take(self.frames) {
            *delta = frame.state.local(self.origin.as_ref().unwrap_or(frame.linearization_point()));
        }
        deltas
    }

    /// Block row `k` of `R δ + d`.
    fn residual(&self, deltas: &[[T; 15]; FRAMES], k: usize) -> [T; 15] {
        let mut out = self.right[k];
        for j in k..self.frames {
            for (value, row) in out.iter_mut().zip(&self.triangle[place(j, k)]) {
                for (entry, delta) in row.iter().zip(&deltas[j]) {
                    *value += *entry * *delta;
                }
            }
        }
        out
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
