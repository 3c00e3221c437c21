//! The reduced normal equations as a sparse matrix, factorised by faer.
//!
//! # Layout
//! Fifteen columns a keyframe and, after all of them, two a plane; the lower triangle by columns. Column `c` of keyframe `j` holds the rest
//! of its own block, the whole block of its successor (the inertial factor), and where `c` belongs to the pose that of every later keyframe
//! that sees a landmark of `j`, and all planes: they are few, and a landmark may come to be on any of them.
//! What is never touched is no entry, so the pattern depends on who sees what alone: it is analysed once.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::{CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use nalgebra::SMatrix;

use super::planes::PlaneBlocks;
use super::{BundleError, Landmark};

pub(super) type Pose = SMatrix<f64, 6, 6>;
pub(super) type Whole = SMatrix<f64, 15, 15>;

/// Who is coupled with whom, and the analysed pattern.
#[derive(Debug)]
pub(super) struct Structure {
    /// Of each keyframe, the later ones that share a landmark with it.
    later: Vec<Vec<usize>>,
    /// Of each keyframe, where its blocks begin in a [`Band`].
    offsets: Vec<usize>,
    col_ptr: Vec<usize>,
    row_idx: Vec<usize>,
    symbolic: SymbolicCholesky<usize>,
}

/// Pose blocks `(i, j)`, `i ≥ j`, `i` up to the last keyframe that shares a landmark with `j`.
#[derive(Debug, Clone)]
pub(super) struct Band(pub Vec<Pose>);

impl Structure {
    /// Analyses the pattern of all views, whether they take part or not.
    pub fn new(keyframes: usize, landmarks: &[Landmark], planes: usize) -> Result<Self, BundleError> {
        let mut reach: Vec<usize> = (0..keyframes).collect();
        for landmark in landmarks {
            let Some(last) = landmark.views.last() else { continue };
            for view in &landmark.views {
                if let Some(reach) = reach.get_mut(view.keyframe) {
                    *reach = (*reach).max(last.keyframe);
                }
            }
        }
        let mut offsets = vec![0];
        let mut end = 0;
        for (j, reach) in reach.iter().enumerate() {
            end += reach - j + 1;
            offsets.push(end);
        }
        let mut shared = vec![false; end];
        for landmark in landmarks {
            for (k, earlier) in landmark.views.iter().enumerate() {
                for later in &landmark.views[k..] {
                    shared[offsets[earlier.keyframe] + later.keyframe - earlier.keyframe] = true;
                }
            }
        }
        let later = |j: usize| (j + 1..=reach[j]).filter(|i| shared[offsets[j] + i - j]).collect::<Vec<_>>();
        let later: Vec<_> = (0..keyframes).map(later).collect();
        let size = 15 * keyframes + 2 * planes;
        let (mut col_ptr, mut row_idx) = (vec![0], Vec::new());
        for (j, later) in later.iter().enumerate() {
            for c in 0..15 {
                row_idx.extend(15 * j + c..15 * j + 15);
                if j + 1 < keyframes {
                    row_idx.extend(15 * (j + 1)..15 * (j + 2));
                }
                if c < 6 {
                    row_idx.extend(later.iter().filter(|i| **i > j + 1).flat_map(|i| 15 * i..15 * i + 6));
                    row_idx.extend(15 * keyframes..size);
                }
                col_ptr.push(row_idx.len());
            }
        }
        for p in (15 * keyframes..size).step_by(2) {
            row_idx.extend([p, p + 1, p + 1]);
            col_ptr.extend([row_idx.len() - 1, row_idx.len()]);
        }
        let pattern = SymbolicSparseColMatRef::new_checked(size, size, &col_ptr, None, &row_idx);
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Lower, SymmetricOrdering::Amd, CholeskySymbolicParams::default()).map_err(failed)?;
        Ok(Self { later, offsets, col_ptr, row_idx, symbolic })
    }

    /// Non-zeros of the factor.
    pub fn factor_non_zeros(&self) -> usize {
        self.symbolic.len_val()
    }

    /// All blocks zero.
    pub fn empty_band(&self) -> Band {
        Band(vec![Pose::zeros(); self.offsets.last().copied().unwrap_or(0)])
    }

    /// Place of block `(i, j)` in a band, `i ≥ j`.
    pub fn place(&self, i: usize, j: usize) -> usize {
        self.offsets[j] + i - j
    }

    /// Number of blocks of keyframe `j` in a band, its own included.
    pub fn blocks(&self, j: usize) -> usize {
        self.offsets[j + 1] - self.offsets[j]
    }

    /// Solves for `right` in place. `own` holds `H(j, j)`, `successors` `H(j + 1, j)`, `band` the pose blocks of those that are not neighbours.
    /// `false` where the matrix is not positive definite.
    pub fn solve(
        &self,
        own: &[Whole],
        successors: &[Whole],
        band: &Band,
        planes: &PlaneBlocks,
        right: &mut [f64],
    ) -> Result<bool, BundleError> {
        let mut values = Vec::with_capacity(self.row_idx.len());
        for (j, later) in self.later.iter().enumerate() {
            for c in 0..15 {
                values.extend_from_slice(&own[j].column(c).as_slice()[c..]);
                if let Some(successor) = successors.get(j) {
                    values.extend_from_slice(successor.column(c).as_slice());
                }
                if c < 6 {
                    for i in later.iter().filter(|i| **i > j + 1) {
                        values.extend_from_slice(band.0[self.place(*i, j)].column(c).as_slice());
                    }
                    for block in planes.of_keyframe(j) {
                        values.extend_from_slice(block.column(c).as_slice());
                    }
                }
            }
        }
        for own in &planes.own {
            values.extend([own.m11, own.m21, own.m22]);
        }
        let size = self.col_ptr.len() - 1;
        let pattern = SymbolicSparseColMatRef::new_checked(size, size, &self.col_ptr, None, &self.row_idx);
        let matrix = SparseColMatRef::new(pattern, &values);
        let mut factor = vec![0.0; self.symbolic.len_val()];
        let needed = self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::try_new(needed).map_err(failed)?;
        let stack = MemStack::new(&mut memory);
        let done =
            self.symbolic.factorize_numeric_llt(&mut factor, matrix, Side::Lower, Default::default(), Par::Seq, stack, Default::default());
        if done.is_err() {
            return Ok(false);
        }
        let mut memory = MemBuffer::try_new(self.symbolic.solve_in_place_scratch::<f64>(1, Par::Seq)).map_err(failed)?;
        LltRef::new(&self.symbolic, &factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(right, size, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        Ok(right.iter().all(|value| value.is_finite()))
    }
}

fn failed(error: impl std::fmt::Debug) -> BundleError {
    BundleError::Solver(format!("{error:?}"))
}
