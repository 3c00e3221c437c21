//! What marginalised frames and landmarks have said about the frames that remain, as a square root.
//!
//! # Model
//! `½ ‖R δ + d‖²` with `δ = x ⊟ x₀` stacked over the oldest frames of the window, `x₀` their first estimates, `R` upper
//! triangular. Inertial samples tie a leaving frame to its successor alone, landmarks to poses: so the prior speaks of the whole
//! state of the oldest frame and of the poses of the others,
//! ```text
//! R = [ H  C₁ C₂ … ]      H 15×15, C_j 15×6
//!     [    P₁₁ P₁₂ … ]    P_ij 6×6
//!     [        P₂₂ … ]
//! ```
//! Jacobians stay where they were first evaluated (first-estimate Jacobians), so the prior gives no
//! information along the unobservable directions (position, yaw). Keeping `R` instead of `RᵀR` halves the digits that
//! the prior needs, which is what `f32` has.

use crate::imu::NavState;
use crate::real::Real;
use crate::storage::blank::{Blank, blank};
use crate::storage::blocks::{Block, add_transposed_product, columns, pairs, place};
use crate::window::Frame;

/// A square-root prior on the first `frames` frames of the window, at most `FRAMES − 2`.
#[derive(Debug, Clone)]
pub struct Prior<T: Real, const FRAMES: usize, const PAIRS: usize> {
    /// `H`, upper triangular.
    pub head: Block<T, 15>,
    /// Columns one after the other, see [`Self::column`].
    columns: [Block<T, 6>; PAIRS],
    /// `d` of the oldest frame.
    pub right_head: [T; 15],
    /// `d` of the poses.
    pub right: [[T; 6]; FRAMES],
    /// How many frames, from the oldest, it speaks of.
    pub frames: usize,
    /// Where the very first prior was set up; from the first marginalisation on, first estimates take its place.
    pub origin: Option<NavState<T>>,
}

impl<T: Real> Blank for Option<NavState<T>> {
    const BLANK: Self = None;
}

blank!([T: Real, const FRAMES: usize, const PAIRS: usize] Prior<T, FRAMES, PAIRS> {
    head, columns, right_head, right, frames, origin,
};
    PAIRS == pairs(FRAMES), "PAIRS must be FRAMES (FRAMES + 1) / 2");

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Default for Prior<T, FRAMES, PAIRS> {
    fn default() -> Self {
        Self::BLANK
    }
}

/// `R δ + d`: the rows of the oldest frame and those of the poses.
struct Residual<T, const FRAMES: usize> {
    head: [T; 15],
    poses: [[T; 6]; FRAMES],
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Prior<T, FRAMES, PAIRS> {
    /// Says nothing any more. Matrices are overwritten where the prior is next set up.
    pub fn clear(&mut self) {
        self.frames = 0;
        self.origin = None;
    }

    /// What `R` says of the pose of frame `j ≥ 1`: `C_j`, and `P_1j … P_jj`.
    #[must_use]
    pub fn column(&self, j: usize) -> (&[[T; 6]; 15], &[Block<T, 6>]) {
        let (coupling, poses) = self.columns.as_flattened()[rows_of(j)].split_at(15);
        (&coupling.as_chunks().0[0], poses.as_chunks().0)
    }

    /// The same, to be written.
    pub fn column_mut(&mut self, j: usize) -> (&mut [[T; 6]; 15], &mut [Block<T, 6>]) {
        let (coupling, poses) = self.columns.as_flattened_mut()[rows_of(j)].split_at_mut(15);
        (&mut coupling.as_chunks_mut().0[0], poses.as_chunks_mut().0)
    }

    /// Moves the very first prior from its origin to the first estimate of its frame, by its own linear model.
    pub fn settle(&mut self, frames: &[Frame<T>]) {
        if let (Some(_), Some(frame)) = (self.origin, frames.first()) {
            let at_first_estimate = Frame { state: *frame.linearization_point(), ..*frame };
            self.right_head = self.residual(core::slice::from_ref(&at_first_estimate)).head;
            self.origin = None;
        }
    }

    /// Twice the cost, `‖R δ + d‖²`.
    #[must_use]
    pub fn cost(&self, frames: &[Frame<T>]) -> T {
        self.residual(frames).squared()
    }

    /// Adds `RᵀR` and `Rᵀ (R δ + d)` to the normal equations; returns `‖R δ + d‖²`. Of the pose `p` and the rest `u` of a frame,
    /// `poses` holds `H(p_i, p_j)` and `couplings` `H(u_j, p_i)`, `j ≤ i`, at `place(i, j)`; `rest_of_first` is `H(u_0, u_0)`.
    pub fn add_to(
        &self,
        frames: &[Frame<T>],
        poses: &mut [Block<T, 6>],
        couplings: &mut [[[T; 6]; 9]],
        rest_of_first: &mut Block<T, 9>,
        gradient: &mut [[T; 15]],
    ) -> T {
        if self.frames == 0 {
            return T::ZERO;
        }
        let residual = self.residual(frames);
        let (pose, rest): ([[T; 6]; 15], [[T; 9]; 15]) = (columns(&self.head, 0), columns(&self.head, 6));
        add_transposed_product(&mut poses[0], &pose, &pose);
        add_transposed_product(&mut couplings[0], &rest, &pose);
        add_transposed_product(rest_of_first, &rest, &rest);
        add_transposed_times(&mut gradient[0], &self.head, &residual.head);
        for i in 1..self.frames {
            let (coupling, own) = self.column(i);
            add_transposed_product(&mut poses[place(i, 0)], coupling, &pose);
            add_transposed_product(&mut couplings[place(i, 0)], &rest, coupling);
            add_transposed_times(&mut gradient[i], coupling, &residual.head);
            for (j, block) in (1..).zip(own) {
                let target = &mut poses[place(i, j)];
                let (other_coupling, other) = self.column(j);
                add_transposed_product(target, coupling, other_coupling);
                for (a, b) in own.iter().zip(other) {
                    add_transposed_product(target, a, b);
                }
                add_transposed_times(&mut gradient[i], block, &residual.poses[j]);
            }
        }
        residual.squared()
    }

    fn residual(&self, frames: &[Frame<T>]) -> Residual<T, FRAMES> {
        let mut out = Residual { head: self.right_head, poses: self.right };
        for (j, frame) in frames.iter().enumerate().take(self.frames) {
            // δ = x ⊟ x₀
            let delta = frame.state.local(self.origin.as_ref().unwrap_or(frame.linearization_point()));
            if j == 0 {
                add_times(&mut out.head, &self.head, &delta);
                continue;
            }
            let (coupling, poses) = self.column(j);
            add_times(&mut out.head, coupling, &delta);
            for (out, block) in out.poses.iter_mut().skip(1).zip(poses) {
                add_times(out, block, &delta);
            }
        }
        out.poses[self.frames.max(1)..].fill([T::ZERO; 6]);
        out.poses[0] = [T::ZERO; 6];
        if self.frames == 0 {
            out.head = [T::ZERO; 15];
        }
        out
    }
}

impl<T: Real, const FRAMES: usize> Residual<T, FRAMES> {
    fn squared(&self) -> T {
        self.head.iter().chain(self.poses.as_flattened()).fold(T::ZERO, |sum, value| sum + *value * *value)
    }
}

/// Rows of six that the column of frame `j` takes, after `15 + 6k` for each `k` before it.
fn rows_of(j: usize) -> core::ops::Range<usize> {
    let start = (j - 1) * (15 + 3 * j);
    start..start + 15 + 6 * j
}

/// `y += A x`, by as much of `x` as `A` has columns.
fn add_times<T: Real, const N: usize>(y: &mut [T], a: &[[T; N]], x: &[T; 15]) {
    for (out, row) in y.iter_mut().zip(a) {
        for (entry, value) in row.iter().zip(x) {
            *out += *entry * *value;
        }
    }
}

/// `y += Aᵀ x`, onto as much of `y` as `A` has columns.
fn add_transposed_times<T: Real, const N: usize>(y: &mut [T; 15], a: &[[T; N]], x: &[T]) {
    for (row, value) in a.iter().zip(x) {
        for (out, entry) in y.iter_mut().zip(row) {
            *out += *entry * *value;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
