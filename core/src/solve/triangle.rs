//! A least-squares problem kept as an upper triangle: rows are folded in by Householder reflections.
//!
//! # Model
//! `‖R x + d‖²` with `R` upper triangular. Folding rows `(A, b)` in gives the triangle of the stacked problem,
//! ```text
//! ‖R x + d‖² + ‖A x + b‖² = ‖R' x + d'‖² + constant
//! ```
//! The normal equations are never formed, so the condition number is not squared: this is what makes the prior
//! survive `f32` (Demmel et al., ICCV 2021).

use crate::real::Real;

/// Columns that are worked on at a time. Rows are padded to whole tiles, so that every inner loop has this length.
pub const TILE: usize = 8;

/// Rows that are folded in at a time at most.
const PORTION: usize = 64;

/// Squared length of a column below which it says nothing (a standard deviation of 10¹²) and is left out: in `f32` its
/// reflection would divide by a number that is no longer normal.
const NOTHING: f64 = 1e-24;

/// Rows of equal width, one after the other: `columns` scalars, the right-hand side, padding.
#[derive(Debug)]
pub struct Rows<'a, T: Real> {
    tiles: &'a mut [[T; TILE]],
    tiles_a_row: usize,
}

/// Tiles that a row of `columns` scalars and its right-hand side takes.
#[must_use]
pub const fn tiles(columns: usize) -> usize {
    columns / TILE + 1
}

impl<'a, T: Real> Rows<'a, T> {
    /// `count` rows of zeros at the beginning of the buffer, fewer where it is too short; and the rest of the buffer.
    pub fn carve(buffer: &'a mut [[T; TILE]], columns: usize, count: usize) -> (Self, &'a mut [[T; TILE]]) {
        let tiles_a_row = tiles(columns);
        let fits = count.min(buffer.len() / tiles_a_row);
        debug_assert!(fits == count, "row buffer too short");
        let (tiles, rest) = buffer.split_at_mut(fits * tiles_a_row);
        tiles.fill([T::ZERO; TILE]);
        (Self { tiles, tiles_a_row }, rest)
    }

    /// Number of rows.
    #[must_use]
    pub fn count(&self) -> usize {
        self.tiles.len() / self.tiles_a_row
    }

    /// Row `i`.
    #[must_use]
    pub fn row(&self, i: usize) -> &[T] {
        self.tiles[i * self.tiles_a_row..(i + 1) * self.tiles_a_row].as_flattened()
    }

    /// Row `i`.
    pub fn row_mut(&mut self, i: usize) -> &mut [T] {
        self.tiles[i * self.tiles_a_row..(i + 1) * self.tiles_a_row].as_flattened_mut()
    }

    /// The first `count` rows, and the others.
    pub fn split(&mut self, count: usize) -> (Rows<'_, T>, Rows<'_, T>) {
        let (before, after) = self.tiles.split_at_mut(count * self.tiles_a_row);
        (Rows { tiles: before, tiles_a_row: self.tiles_a_row }, Rows { tiles: after, tiles_a_row: self.tiles_a_row })
    }

    /// Every row's entry in one column.
    pub fn column(&self, column: usize) -> impl Iterator<Item = T> {
        self.tiles.chunks_exact(self.tiles_a_row).map(move |row| row[column / TILE][column % TILE])
    }

    /// All rows, one after the other.
    pub fn tiles_mut(&mut self) -> &mut [[T; TILE]] {
        self.tiles
    }

    /// The rows from `first` to before `end`.
    pub fn part(&mut self, first: usize, end: usize) -> Rows<'_, T> {
        Rows { tiles: &mut self.tiles[first * self.tiles_a_row..end * self.tiles_a_row], tiles_a_row: self.tiles_a_row }
    }
}

/// Folds `rows` into the triangle, whose row `c` begins with column `c` (zeros before it). The rows are overwritten.
pub fn fold<T: Real>(triangle: &mut Rows<'_, T>, rows: &mut Rows<'_, T>, columns: usize) {
    debug_assert!(triangle.count() == columns && triangle.tiles_a_row == rows.tiles_a_row);
    for portion in rows.tiles.chunks_mut(PORTION * rows.tiles_a_row) {
        let mut portion = Rows { tiles: portion, tiles_a_row: rows.tiles_a_row };
        for column in 0..columns {
            let first = column / TILE;
            let top = &mut triangle.tiles[column * triangle.tiles_a_row..(column + 1) * triangle.tiles_a_row];
            eliminate(top, &mut portion, column, first);
        }
    }
}

/// Reflects `column` of `[top; rows]` onto `top`, from tile `first` on; what is left of it in `rows` becomes zero.
///
/// ```text
/// v = (top_c − α, rows_c)     α = ∓‖(top_c, rows_c)‖     [top; rows] −= v wᵀ     w = [top; rows]ᵀ v · 2/vᵀv
/// ```
pub fn eliminate<T: Real>(top: &mut [[T; TILE]], rows: &mut Rows<'_, T>, column: usize, first: usize) {
    let (tile, lane) = (column / TILE, column % TILE);
    // Rows with something in this column: where they begin, and what it is.
    let mut entries = [(0_usize, T::ZERO); PORTION];
    let mut count = 0;
    let mut below = T::ZERO;
    for (i, row) in rows.tiles.chunks_exact_mut(rows.tiles_a_row).enumerate().take(PORTION) {
        let value = row[tile][lane];
        if value != T::ZERO {
            entries[count] = (i * rows.tiles_a_row, value);
            count += 1;
            below += value * value;
        }
    }
    let entries = &entries[..count];
    for (start, _) in entries {
        rows.tiles[start + tile][lane] = T::ZERO;
    }
    if !(below > T::of(NOTHING)) {
        return;
    }
    let pivot = top[tile][lane];
    let norm = (pivot * pivot + below).root();
    let reflected = if pivot > T::ZERO { -norm } else { norm };
    let head = pivot - reflected;
    // 2/vᵀv, with vᵀv = 2 norm (norm + |pivot|)
    let scale = T::one() / (norm * (norm + pivot.abs()));
    top[tile][lane] = T::ZERO;
    for (t, top) in top.iter_mut().enumerate().skip(first) {
        let mut w = [T::ZERO; TILE];
        for (sum, value) in w.iter_mut().zip(&*top) {
            *sum = head * *value;
        }
        for (start, factor) in entries {
            for (sum, value) in w.iter_mut().zip(&rows.tiles[start + t]) {
                *sum += *factor * *value;
            }
        }
        for (sum, out) in w.iter_mut().zip(top) {
            *sum *= scale;
            *out -= head * *sum;
        }
        for (start, factor) in entries {
            for (out, sum) in rows.tiles[start + t].iter_mut().zip(&w) {
                *out -= *factor * *sum;
            }
        }
    }
    top[tile][lane] = reflected;
}

#[cfg(test)]
mod tests {
    use std::vec;

    use nalgebra::DMatrix;
    use proptest::prelude::*;

    use super::{Rows, TILE, fold, tiles};

    proptest! {
        /// The triangle has the normal equations of all rows that were folded in, in whatever portions they came.
        #[test]
        fn folding_keeps_the_normal_equations(entries in prop::collection::vec(-3.0f64..3.0, 14 * 10), portion in 1usize..14) {
            let all = DMatrix::from_row_slice(14, 10, &entries);
            let mut buffer = vec![[0.0; TILE]; 23 * tiles(9)];
            let (mut triangle, rest) = Rows::carve(&mut buffer, 9, 9);
            for given in entries.chunks(portion * 10) {
                let (mut rows, _) = Rows::carve(rest, 9, given.len() / 10);
                for (i, row) in given.chunks(10).enumerate() {
                    rows.row_mut(i)[..10].copy_from_slice(row);
                }
                fold(&mut triangle, &mut rows, 9);
                prop_assert!((0..rows.count()).all(|i| rows.row(i)[..9].iter().all(|value| *value == 0.0)));
            }
            let folded = DMatrix::from_fn(9, 10, |r, c| triangle.row(r)[c]);
            prop_assert!((0..9).all(|r| triangle.row(r)[..r].iter().all(|value| *value == 0.0)));
            let expected = all.columns(0, 9).tr_mul(&all);
            prop_assert!((folded.columns(0, 9).tr_mul(&folded) - &expected).norm() < 1e-10 * expected.norm());
        }
    }
}
