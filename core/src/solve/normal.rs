//! Normal equations of the frames, without the blocks that are always zero.
//!
//! # Model
//! A frame's state is its pose `p` (6) and velocity and biases `u` (9). Images and the prior join all poses, inertial factors
//! neighbours, and the prior joins `u_0` with all poses; eliminating `u_k` from the newest to the oldest (see
//! [`chain`](super::chain)) joins it with the poses from `k − 1` on, and nothing else.
//! ```text
//!        p_j      u_j    j < k−1             p_{k−1}         u_{k−1}          p_k        u_k
//! p_k  ⎡ poses   couplingsᵀ        …         poses           couplingsᵀ       poses      couplingsᵀ ⎤
//! u_k  ⎣  0        0               …      pose_before        before         couplings      own      ⎦
//! ```
//! That is 90 scalars a pair of frames and 216 a frame, where dense blocks would take 225 a pair.

use super::triangle::TILE;
use crate::real::Real;
use crate::storage::blank::{Blank, blank};
use crate::storage::blocks::{Block, place, zero_block};

/// Scalars of a frame's pose.
pub const POSE: usize = 6;
/// Scalars of its velocity and biases.
pub const REST: usize = 9;

/// A block of velocities and biases (rows) with a pose (columns).
pub type Coupling<T> = [[T; POSE]; REST];

/// Tiles a pair of frames: 152 scalars, which from 6 frames on are enough for `90 PAIRS + 216 FRAMES`.
pub(super) const TILES: usize = 19;

/// The memory of the equations, which marginalisation uses as well.
#[derive(Debug)]
pub struct NormalEquations<T: Real, const FRAMES: usize, const PAIRS: usize> {
    tiles: [[[T; TILE]; TILES]; PAIRS],
}

blank!([T: Real, const FRAMES: usize, const PAIRS: usize] NormalEquations<T, FRAMES, PAIRS> { tiles };
    90 * PAIRS + 216 * FRAMES <= TILES * TILE * PAIRS, "a window holds 6 frames at least");

/// The blocks by name. Triangles are stored as in [`storage::blocks`](crate::storage::blocks).
#[derive(Debug)]
pub struct Parts<'a, T> {
    /// `H(p_i, p_j)`, `j ≤ i`, at `place(i, j)`; later the Cholesky factor of the poses.
    pub poses: &'a mut [Block<T, POSE>],
    /// `H(u_j, p_i)`, `j ≤ i`, at `place(i, j)`; later part of `Y`. While images are summed up, the sums of the pairs of frames.
    pub couplings: &'a mut [Coupling<T>],
    /// `H(u_k, u_k)`; later `L`.
    pub own: &'a mut [Block<T, REST>],
    /// `H(u_k, u_{k−1})`; later part of `Y`.
    pub before: &'a mut [Block<T, REST>],
    /// `H(u_k, p_{k−1})`; later part of `Y`.
    pub pose_before: &'a mut [Coupling<T>],
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Default for NormalEquations<T, FRAMES, PAIRS> {
    fn default() -> Self {
        Self::BLANK
    }
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> NormalEquations<T, FRAMES, PAIRS> {
    /// The blocks.
    pub fn parts(&mut self) -> Parts<'_, T> {
        let scalars = self.tiles.as_flattened_mut().as_flattened_mut();
        let (poses, scalars) = scalars.split_at_mut(POSE * POSE * PAIRS);
        let (couplings, scalars) = scalars.split_at_mut(REST * POSE * PAIRS);
        let (own, scalars) = scalars.split_at_mut(REST * REST * FRAMES);
        let (before, scalars) = scalars.split_at_mut(REST * REST * FRAMES);
        let (pose_before, _) = scalars.split_at_mut(REST * POSE * FRAMES);
        Parts {
            poses: blocks(poses),
            couplings: blocks(couplings),
            own: blocks(own),
            before: blocks(before),
            pose_before: blocks(pose_before),
        }
    }

    /// The diagonal block of a frame's pose, or of its Cholesky factor.
    #[must_use]
    pub fn pose(&self, frame: usize) -> Option<&Block<T, POSE>> {
        let at = place(frame, frame);
        if frame < FRAMES { self.tiles.as_flattened().as_flattened().as_chunks().0.as_chunks().0.get(at) } else { None }
    }

    /// All of the memory, for other use.
    pub fn memory(&mut self) -> &mut [[T; TILE]] {
        self.tiles.as_flattened_mut()
    }
}

impl<T: Real> Parts<'_, T> {
    /// Zeroes the equations of `frames` frames.
    pub fn clear(&mut self, frames: usize) {
        let triangle = place(frames, 0);
        self.poses[..triangle].fill(zero_block());
        self.clear_couplings(frames);
        self.own[..frames].fill(zero_block());
        self.before[..frames].fill(zero_block());
        self.pose_before[..frames].fill([[T::ZERO; POSE]; REST]);
    }

    /// Zeroes the couplings alone.
    pub fn clear_couplings(&mut self, frames: usize) {
        self.couplings[..place(frames, 0)].fill([[T::ZERO; POSE]; REST]);
    }

    /// `H(u_k, p_j)` where it is stored: from `j = k − 1` on.
    #[inline]
    pub fn coupling(&mut self, k: usize, j: usize) -> &mut Coupling<T> {
        if j < k { &mut self.pose_before[k] } else { &mut self.couplings[place(j, k)] }
    }
}

/// Scalars as blocks of `M` rows and `N` columns.
fn blocks<T, const M: usize, const N: usize>(scalars: &mut [T]) -> &mut [[[T; N]; M]] {
    scalars.as_chunks_mut().0.as_chunks_mut().0
}
