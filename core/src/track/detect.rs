//! New corners where the image has none: the best of every empty grid cell.
//!
//! # Model
//! With central differences `g` and the structure tensor `M = Σ g gᵀ / 49` over 7×7 pixels, in (grey level/px)²,
//! ```text
//! score = det M / tr M = 1 / (1/λ₁ + 1/λ₂)            λ_min/2 ≤ score ≤ λ_min
//! ```
//! the inverse of the trace of a tracked position's covariance per unit of pixel noise. It orders corners as the smaller
//! eigenvalue of Shi and Tomasi does, without a square root. White noise of σ grey levels alone scores `σ²/4`.
//!
//! # Bounds
//! One pass over the empty cells; at most `corners.len()` candidates are kept, the best.

use crate::image::Level;
use crate::storage::blank::blank;

/// Half the width of the summation window, px.
const RADIUS: usize = 3;
/// Pixels in the summation window.
const WINDOW: f32 = ((2 * RADIUS + 1) * (2 * RADIUS + 1)) as f32;
/// Widest cell, px.
pub const MAX_CELL_PX: usize = 64;
/// Most cells; cells are widened until there are no more.
const MAX_CELLS: usize = 2048;
/// Pixels that are summed or scored together.
const LANES: usize = 8;
const ROW: usize = (MAX_CELL_PX + 2 * RADIUS).next_multiple_of(LANES);

/// A corner that was found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Corner {
    /// Sub-pixel place at level 0, px.
    pub pixel: [f32; 2],
    /// `det M / tr M`, (grey level/px)².
    pub score: f32,
}

blank!([] Corner { pixel, score });

/// Where to look for corners and which to take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectConfig {
    /// Width of a grid cell, px, 8 to [`MAX_CELL_PX`]. A cell yields one corner at most.
    pub cell_px: usize,
    /// Smallest distance between two corners, px.
    pub min_distance_px: f32,
    /// Corners keep this distance from the border, px.
    pub border_px: usize,
    /// Least score, (grey level/px)².
    pub min_score: f32,
    /// Least score as a share of the best corner's in the same image.
    pub min_relative_score: f32,
}

/// The grid over an image.
struct Grid {
    cell: usize,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new(level: &Level<'_>, cell_px: usize) -> Self {
        let mut cell = cell_px.clamp(8, MAX_CELL_PX);
        loop {
            let (columns, rows) = (level.width().div_ceil(cell), level.height().div_ceil(cell));
            // Beyond the widest cell the last rows go without new corners.
            if columns * rows <= MAX_CELLS || cell == MAX_CELL_PX {
                return Self { cell, columns, rows };
            }
            cell = (cell * 2).min(MAX_CELL_PX);
        }
    }

    fn index(&self, pixel: [f32; 2]) -> usize {
        let column = (pixel[0].max(0.0) as usize / self.cell).min(self.columns.saturating_sub(1));
        let row = (pixel[1].max(0.0) as usize / self.cell).min(self.rows.saturating_sub(1));
        row * self.columns + column
    }
}

/// Finds corners in the cells that hold none of `occupied` (px of level 0), best first, at most `wanted` and `corners.len()`,
/// and returns how many it wrote to `corners`.
pub fn detect(
    level: &Level<'_>,
    config: &DetectConfig,
    occupied: impl Iterator<Item = [f32; 2]> + Clone,
    wanted: usize,
    corners: &mut [Corner],
) -> usize {
    let border = config.border_px.max(RADIUS + 2);
    if level.width() <= 2 * border || level.height() <= 2 * border || wanted == 0 {
        return 0;
    }
    let grid = Grid::new(level, config.cell_px);
    let mut taken = [0_u64; MAX_CELLS / 64];
    for pixel in occupied.clone() {
        let index = grid.index(pixel);
        if let Some(word) = taken.get_mut(index / 64) {
            *word |= 1 << (index % 64);
        }
    }
    let mut found = 0;
    for row in 0..grid.rows {
        for column in 0..grid.columns {
            let index = row * grid.columns + column;
            if taken.get(index / 64).is_none_or(|word| word >> (index % 64) & 1 == 1) {
                continue;
            }
            let span = |cell: usize, size: usize| (cell * grid.cell).max(border)..((cell + 1) * grid.cell).min(size - border);
            if let Some((x, y, score)) = best_in(level, span(column, level.width()), span(row, level.height()), config.min_score) {
                keep(corners, &mut found, Corner { pixel: [x as f32, y as f32], score });
            }
        }
    }
    let candidates = corners.get_mut(..found).unwrap_or_default();
    best_first(candidates);
    let least = candidates.first().map_or(0.0, |best| best.score * config.min_relative_score);
    let mut accepted = 0;
    let apart = |a: [f32; 2], b: [f32; 2]| {
        let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
        dx * dx + dy * dy >= config.min_distance_px * config.min_distance_px
    };
    for candidate in 0..found {
        if accepted == wanted {
            break;
        }
        let Some(&corner) = corners.get(candidate) else { break };
        if corner.score < least {
            break;
        }
        let earlier = corners.get(..accepted).unwrap_or_default();
        if occupied.clone().all(|pixel| apart(pixel, corner.pixel)) && earlier.iter().all(|other| apart(other.pixel, corner.pixel)) {
            let refined = refine(level, corner);
            if let Some(slot) = corners.get_mut(accepted) {
                *slot = refined;
                accepted += 1;
            }
        }
    }
    accepted
}

/// By insertion: a new image adds some dozens of corners at most, and the sorting of `core` is 4 KB of a microcontroller's flash.
fn best_first(corners: &mut [Corner]) {
    for sorted in 1..corners.len() {
        for place in (0..sorted).rev() {
            let Some([before, this]) = corners.get_mut(place..).and_then(<[Corner]>::first_chunk_mut) else { break };
            if before.score.total_cmp(&this.score).is_ge() {
                break;
            }
            core::mem::swap(before, this);
        }
    }
}

/// Keeps the best corners that fit.
fn keep(corners: &mut [Corner], found: &mut usize, corner: Corner) {
    if let Some(slot) = corners.get_mut(*found) {
        *slot = corner;
        *found += 1;
    } else if let Some(worst) = corners.iter_mut().min_by(|a, b| a.score.total_cmp(&b.score))
        && worst.score < corner.score
    {
        *worst = corner;
    }
}

/// Sums of products of gradients over columns of `2 RADIUS + 1` pixels: xx, xy, yy.
type ColumnSums = [[i32; ROW]; 3];

/// Adds (`SIGN` = 1) or takes away (−1) the products of the gradients at row `y`, columns `left ..`, `count` of them.
#[inline]
fn add_row<const SIGN: i32>(level: &Level<'_>, y: usize, left: usize, count: usize, sums: &mut ColumnSums) {
    let rows = (level.row(y.wrapping_sub(1)), level.row(y), level.row(y + 1));
    // Whole groups of lanes where the row is long enough; what they add beyond `count` is not read.
    let padded = count.next_multiple_of(LANES).min(ROW);
    let count = if left + padded < rows.1.len() { padded } else { count };
    let (Some(above), Some(west), Some(east), Some(below)) = (
        rows.0.get(left..left + count),
        rows.1.get(left.wrapping_sub(1)..left.wrapping_sub(1).wrapping_add(count)),
        rows.1.get(left + 1..left + 1 + count),
        rows.2.get(left..left + count),
    ) else {
        return;
    };
    let [xx, xy, yy] = sums;
    let add = |xx: &mut i32, xy: &mut i32, yy: &mut i32, horizontal: [u8; 2], vertical: [u8; 2]| {
        let gx = i32::from(i16::from(horizontal[1]) - i16::from(horizontal[0]));
        let gy = i32::from(i16::from(vertical[1]) - i16::from(vertical[0]));
        *xx += SIGN * gx * gx;
        *xy += SIGN * gx * gy;
        *yy += SIGN * gy * gy;
    };
    let ((west, west_tail), (east, east_tail)) = (west.as_chunks::<LANES>(), east.as_chunks::<LANES>());
    let ((above, above_tail), (below, below_tail)) = (above.as_chunks::<LANES>(), below.as_chunks::<LANES>());
    let whole = west.len() * LANES;
    let groups = xx.as_chunks_mut::<LANES>().0.iter_mut().zip(xy.as_chunks_mut::<LANES>().0).zip(yy.as_chunks_mut::<LANES>().0);
    for (((((xx, xy), yy), west), east), (above, below)) in groups.zip(west).zip(east).zip(above.iter().zip(below)) {
        for l in 0..LANES {
            add(&mut xx[l], &mut xy[l], &mut yy[l], [west[l], east[l]], [above[l], below[l]]);
        }
    }
    let tails = west_tail.iter().zip(east_tail).zip(above_tail.iter().zip(below_tail));
    for (l, ((&west, &east), (&above, &below))) in tails.enumerate() {
        if let (Some(xx), Some(xy), Some(yy)) = (xx.get_mut(whole + l), xy.get_mut(whole + l), yy.get_mut(whole + l)) {
            add(xx, xy, yy, [west, east], [above, below]);
        }
    }
}

/// `det M / tr M` of sums of products of undivided differences.
#[inline(always)]
fn score(xx: f32, xy: f32, yy: f32) -> f32 {
    // The differences are over two pixels: 4 in the squares. The one keeps a blank window at zero.
    (xx * yy - xy * xy) / (xx + yy + 1.0) * (0.25 / WINDOW)
}

/// The pixel of the highest score in a rectangle at most [`MAX_CELL_PX`] wide, if above `least`.
fn best_in(level: &Level<'_>, x: core::ops::Range<usize>, y: core::ops::Range<usize>, least: f32) -> Option<(usize, usize, f32)> {
    if x.is_empty() || y.is_empty() || x.len() > MAX_CELL_PX || x.start <= RADIUS || y.start <= RADIUS {
        return None;
    }
    let (left, count) = (x.start - RADIUS, x.len() + 2 * RADIUS);
    let mut sums: ColumnSums = [[0; ROW]; 3];
    for row in y.start - RADIUS..y.start + RADIUS {
        add_row::<1>(level, row, left, count, &mut sums);
    }
    let (mut best, mut best_score) = (None, least);
    let mut scores = [0.0_f32; MAX_CELL_PX];
    for row in y {
        add_row::<1>(level, row + RADIUS, left, count, &mut sums);
        let mut highest = [0.0_f32; LANES];
        for first in (0..x.len()).step_by(LANES) {
            let mut windows = [[0_i32; LANES]; 3];
            for (window, sums) in windows.iter_mut().zip(&sums) {
                let Some(sums) = sums.get(first..).and_then(|sums| sums.first_chunk::<{ LANES + 2 * RADIUS }>()) else { continue };
                for l in 0..LANES {
                    window[l] = (sums[l] + sums[l + 1]) + (sums[l + 2] + sums[l + 3]) + (sums[l + 4] + sums[l + 5]) + sums[l + 6];
                }
            }
            let Some(scores) = scores.get_mut(first..).and_then(|scores| scores.first_chunk_mut::<LANES>()) else { continue };
            for l in 0..LANES {
                let value = score(windows[0][l] as f32, windows[1][l] as f32, windows[2][l] as f32);
                scores[l] = value;
                highest[l] = if value > highest[l] { value } else { highest[l] };
            }
        }
        // Lanes beyond the cell may be high too; the scan below leaves them out.
        if highest.iter().any(|&value| value > best_score) {
            for (k, &value) in scores.iter().take(x.len()).enumerate() {
                if value > best_score {
                    best_score = value;
                    best = Some((x.start + k, row));
                }
            }
        }
        add_row::<-1>(level, row - RADIUS, left, count, &mut sums);
    }
    best.map(|(x, y)| (x, y, best_score))
}

/// The score at one pixel.
fn score_at(level: &Level<'_>, x: usize, y: usize) -> f32 {
    if x <= RADIUS || y <= RADIUS {
        return 0.0;
    }
    let mut sums: ColumnSums = [[0; ROW]; 3];
    for row in y - RADIUS..=y + RADIUS {
        add_row::<1>(level, row, x - RADIUS, 2 * RADIUS + 1, &mut sums);
    }
    let [xx, xy, yy] = sums.map(|columns| columns.iter().take(2 * RADIUS + 1).sum::<i32>() as f32);
    score(xx, xy, yy)
}

/// Moves a corner to the top of the parabolas through the scores of its neighbours, by half a pixel at most.
fn refine(level: &Level<'_>, corner: Corner) -> Corner {
    let (x, y) = (corner.pixel[0] as usize, corner.pixel[1] as usize);
    let top = |before: f32, after: f32| {
        let curvature = 2.0 * corner.score - before - after;
        if curvature > 1e-6 { (0.5 * (after - before) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let dx = top(score_at(level, x.wrapping_sub(1), y), score_at(level, x + 1, y));
    let dy = top(score_at(level, x, y.wrapping_sub(1)), score_at(level, x, y + 1));
    Corner { pixel: [x as f32 + dx, y as f32 + dy], ..corner }
}
