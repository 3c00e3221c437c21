//! Where a patch of the previous image is in the current one: pyramidal Lucas-Kanade, inverse-compositional.
//!
//! # Model
//! With the patch `T` around a corner in the previous image, a window `w` and a gain and an offset of the exposure `a, b`,
//! ```text
//! minimise over u, a, b:   Σ w(x) (I(x + u) − a T(x) − b)²
//! ```
//! The roles of the images are exchanged in every step, so that the Jacobian `∇T` and the Hessian belong to the template
//! and are computed once. Exposure is eliminated beforehand: `g` is `∇T` made orthogonal (in the window) to `1` and to `T`, and
//! ```text
//! H = Σ w g gᵀ       u ← u − H⁻¹ Σ w g I(x + u)
//! ```
//! since `Σ w g (a T + b) = 0`. The step lacks the factor `1/a`, which moves neither the solution nor, for `a` near 1, the
//! speed of convergence.
//!
//! # Degeneracy
//! A patch whose smaller eigenvalue of `H` is low (an edge, a blank wall) is refused at level 0 and passed over above.

// A comparison that NaN must fail is written as the negation of what must hold, and a kernel's lanes are counted.
#![allow(clippy::neg_cmp_op_on_partial_ord, clippy::needless_range_loop)]

use crate::image::{Level, MAX_LEVELS};
use crate::storage::blank::{Blank, blank};

/// Columns of the scratch block for patches that reach over the border; patches are smaller by three.
const BLOCK: usize = 32;

/// What decides whether a patch was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowConfig {
    /// How much less the border of a patch weighs than its centre, in [0, 1]; read once, at construction. Default 0.7.
    pub window_fall: f32,
    /// Most Gauss-Newton steps per level. Default 10.
    pub max_iterations: u32,
    /// A step shorter than this ends level 0, px. Default 0.02, which leaves an error far smaller: the steps shrink quickly.
    pub converged_px: f32,
    /// A step shorter than this ends the levels above, px of that level. Default 0.1.
    pub converged_coarse_px: f32,
    /// Smallest eigenvalue of `H/Σw` that is tracked, (grey level/px)². Default 1.
    pub min_eigenvalue: f32,
    /// Smallest correlation of the patches once found, in [-1, 1]. Default 0.8.
    pub min_correlation: f32,
    /// Largest exposure gain between two images, and inverse of the smallest. Default 2.
    pub max_gain: f32,
}

blank!([] FlowConfig {
    window_fall, max_iterations, converged_px, converged_coarse_px, min_eigenvalue, min_correlation, max_gain,
});

impl FlowConfig {
    /// The defaults.
    pub const DEFAULT: Self = Self {
        window_fall: 0.7,
        max_iterations: 10,
        converged_px: 0.02,
        converged_coarse_px: 0.1,
        min_eigenvalue: 1.0,
        min_correlation: 0.8,
        max_gain: 2.0,
    };
}

impl Default for FlowConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Why a patch has no place in the other image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlowFailure {
    /// Its place, or what it was predicted to be, is outside the image or too near to the border.
    Outside,
    /// Too little texture.
    Flat,
    /// The steps did not settle near their start.
    Diverged,
    /// What was found looks different.
    Different,
}

/// Scratch memory for one patch of `N × N` samples, `N` a multiple of 4 from 8 to 28.
#[derive(Debug, Clone)]
pub struct FlowWorkspace<const N: usize> {
    window: [f32; N],
    /// `T − offset`.
    template: [[f32; N]; N],
    /// `w g`, both components.
    gradient: [[[f32; N]; N]; 2],
    inverse_hessian: [f32; 3],
    block: [[u8; BLOCK]; BLOCK],
}

blank!([const N: usize] FlowWorkspace<N> { window, template, gradient, inverse_hessian, block };
    N >= 8 && N.is_multiple_of(4) && N + 4 <= BLOCK, "the patch is 8, 12, ... 28 samples wide");

impl<const N: usize> Default for FlowWorkspace<N> {
    fn default() -> Self {
        Self::new(FlowConfig::DEFAULT.window_fall)
    }
}

/// The pixels around a patch: `stride` apart, the sample of index (0, 0) between `pixels[0]`, its right and its lower neighbour.
#[derive(Clone, Copy)]
struct Source<'a> {
    pixels: &'a [u8],
    stride: usize,
    fraction: [f32; 2],
}

/// Distance between the centre of a patch and its first sample, px.
const fn half_width<const N: usize>() -> f32 {
    (N as f32 - 1.0) * 0.5
}

/// The `N + MARGIN` wide block of pixels that interpolating a patch centred at `center` reads, with the border replicated
/// through `block` if need be.
fn source<'a, const N: usize, const MARGIN: usize>(
    level: &Level<'a>,
    center: [f32; 2],
    block: &'a mut [[u8; BLOCK]; BLOCK],
) -> Option<Source<'a>> {
    let (width, height) = (level.width(), level.height());
    // The margin is symmetric about the samples and their right and lower neighbours.
    let reach = half_width::<N>() + (MARGIN / 2) as f32;
    let (left, top) = (center[0] - reach, center[1] - reach);
    if !(center[0] >= 0.0 && center[1] >= 0.0 && center[0] <= width as f32 && center[1] <= height as f32) {
        return None;
    }
    // Truncation is floor for the positive numbers that the offset makes of these.
    let (x, y) = ((left + BLOCK as f32) as i32 - BLOCK as i32, (top + BLOCK as f32) as i32 - BLOCK as i32);
    let fraction = [left - x as f32, top - y as f32];
    let side = N + 1 + MARGIN;
    let is_inside = x >= 0 && y >= 0 && x as usize + side <= width && y as usize + side <= height;
    if let Some(pixels) = level.pixels().filter(|_| is_inside) {
        return Some(Source { pixels: pixels.get(y as usize * width + x as usize..)?, stride: width, fraction });
    }
    level.copy_block(x, y, side, block)?;
    Some(Source { pixels: block.as_flattened(), stride: BLOCK, fraction })
}

/// `out[k]` = row interpolated between `row[k]` and `row[k + 1]`, for `W` samples.
#[inline(always)]
fn interpolate_row<const L: usize>(row: &[u8], w: usize, fraction: f32, out: &mut [f32; L]) -> Option<()> {
    let (a, b) = (row.get(..w)?, row.get(1..=w)?);
    for ((out, &a), &b) in out.get_mut(..w)?.iter_mut().zip(a).zip(b) {
        let (a, b) = (f32::from(a), f32::from(b));
        *out = a + fraction * (b - a);
    }
    Some(())
}

#[inline(always)]
fn sum<const L: usize>(lanes: &[f32; L]) -> f32 {
    lanes.iter().sum()
}

impl<const N: usize> FlowWorkspace<N> {
    /// Scratch memory with the window `w(x, y) = v(x) v(y)`, `v(u) = 1 − window_fall u²`, `u` = ±1 at the borders of the patch.
    #[must_use]
    pub const fn new(window_fall: f32) -> Self {
        let mut workspace = Self::BLANK;
        workspace.set_window(window_fall);
        workspace
    }

    /// Chooses another window.
    pub(super) const fn set_window(&mut self, window_fall: f32) {
        let mut k = 0;
        while k < N {
            let u = (k as f32 - half_width::<N>()) / (half_width::<N>() + 0.5);
            self.window[k] = 1.0 - window_fall * u * u;
            k += 1;
        }
    }

    /// Reads the template centred at `center` (px of this level). False when it is outside or flat.
    fn read_template(&mut self, level: &Level<'_>, center: [f32; 2], min_eigenvalue: f32) -> Result<(), FlowFailure> {
        let Self { window, template, gradient, inverse_hessian, block } = self;
        let source = source::<N, 2>(level, center, block).ok_or(FlowFailure::Outside)?;
        let [fx, fy] = source.fraction;
        // Rows y−1, y, y+1 of the interpolated patch with one sample more on either side; `level_row` is the row of pixels below.
        let row = |y: usize| source.pixels.get(y * source.stride..).unwrap_or(&[]);
        let mut raw = [[0.0_f32; BLOCK]; 2];
        let mut rows = [[0.0_f32; BLOCK]; 3];
        interpolate_row(row(0), N + 2, fx, &mut raw[0]).ok_or(FlowFailure::Outside)?;
        // Sums over the window of w, wT, wTT, wgx, wgy, wTgx, wTgy, wgxgx, wgxgy, wgygy.
        let mut sums = [[0.0_f32; 4]; 10];
        let mut offset = 0.0;
        for y in 0..N + 2 {
            let [above, below] = if y % 2 == 0 { [0, 1] } else { [1, 0] };
            let mut lower = [0.0_f32; BLOCK];
            interpolate_row(row(y + 1), N + 2, fx, &mut lower).ok_or(FlowFailure::Outside)?;
            let current = &mut rows[y % 3];
            for k in 0..N + 2 {
                current[k] = raw[above][k] + fy * (lower[k] - raw[above][k]);
            }
            raw[below] = lower;
            if y == 0 {
                // Sums of squares lose nothing to a common grey level.
                offset = current[N / 2];
            }
            if y < 2 {
                continue;
            }
            let (up, middle, down) = (&rows[(y - 2) % 3], &rows[(y - 1) % 3], &rows[y % 3]);
            let j = y - 2;
            let weight = window[j];
            for k in (0..N).step_by(4) {
                for l in 0..4 {
                    let i = k + l;
                    let gx = 0.5 * (middle[i + 2] - middle[i]);
                    let gy = 0.5 * (down[i + 1] - up[i + 1]);
                    let t = middle[i + 1] - offset;
                    let w = weight * window[i];
                    template[j][i] = t;
                    gradient[0][j][i] = gx;
                    gradient[1][j][i] = gy;
                    let (wt, wx, wy) = (w * t, w * gx, w * gy);
                    sums[0][l] += w;
                    sums[1][l] += wt;
                    sums[2][l] += wt * t;
                    sums[3][l] += wx;
                    sums[4][l] += wy;
                    sums[5][l] += wx * t;
                    sums[6][l] += wy * t;
                    sums[7][l] += wx * gx;
                    sums[8][l] += wx * gy;
                    sums[9][l] += wy * gy;
                }
            }
        }
        let [w, t, tt, gx, gy, tgx, tgy, xx, xy, yy] = sums.map(|lanes| sum(&lanes));
        // Gram-Schmidt in the window: against 1, then against T − T̄.
        let (mean, mean_x, mean_y) = (t / w, gx / w, gy / w);
        let variance = tt - t * mean;
        let (cov_x, cov_y) = (tgx - t * mean_x, tgy - t * mean_y);
        if !(variance > w * min_eigenvalue) {
            return Err(FlowFailure::Flat);
        }
        let (slope_x, slope_y) = (cov_x / variance, cov_y / variance);
        let hxx = xx - gx * mean_x - cov_x * slope_x;
        let hxy = xy - gx * mean_y - cov_x * slope_y;
        let hyy = yy - gy * mean_y - cov_y * slope_y;
        // λ_min ≥ m  ⇔  trace ≥ 2m and (hxx − m)(hyy − m) ≥ hxy²
        let least = w * min_eigenvalue;
        if !(hxx > least && hyy > least && (hxx - least) * (hyy - least) > hxy * hxy) {
            return Err(FlowFailure::Flat);
        }
        let determinant = hxx * hyy - hxy * hxy;
        *inverse_hessian = [hyy / determinant, -hxy / determinant, hxx / determinant];
        let (shift_x, shift_y) = (mean_x - slope_x * mean, mean_y - slope_y * mean);
        let [gradient_x, gradient_y] = gradient;
        for (((row_x, row_y), row_t), &weight) in gradient_x.iter_mut().zip(gradient_y).zip(template.iter_mut()).zip(window.iter()) {
            for (((x, y), t), &w) in row_x.iter_mut().zip(row_y).zip(row_t).zip(window.iter()) {
                let w = w * weight;
                *x = w * (*x - shift_x - slope_x * *t);
                *y = w * (*y - shift_y - slope_y * *t);
                *t -= mean;
            }
        }
        Ok(())
    }

    /// `Σ w g I(x + u)` for the patch at `center`.
    #[inline]
    fn steepest_descent(&mut self, level: &Level<'_>, center: [f32; 2]) -> Option<[f32; 2]> {
        let Self { gradient, block, .. } = self;
        let source = source::<N, 0>(level, center, block)?;
        let [fx, fy] = source.fraction;
        let (mut bx, mut by) = ([0.0_f32; N], [0.0_f32; N]);
        let mut upper = [0.0_f32; N];
        interpolate_row(source.pixels, N, fx, &mut upper)?;
        let [gradient_x, gradient_y] = &*gradient;
        for (y, (gx, gy)) in gradient_x.iter().zip(gradient_y).enumerate() {
            let mut lower = [0.0_f32; N];
            interpolate_row(source.pixels.get((y + 1) * source.stride..)?, N, fx, &mut lower)?;
            for k in 0..N {
                let value = upper[k] + fy * (lower[k] - upper[k]);
                bx[k] += gx[k] * value;
                by[k] += gy[k] * value;
            }
            upper = lower;
        }
        Some([sum(&bx), sum(&by)])
    }

    /// Correlation of the template and the patch at `center`, and the gain `a`.
    fn likeness(&mut self, level: &Level<'_>, center: [f32; 2]) -> Option<(f32, f32)> {
        let Self { template, block, .. } = self;
        let source = source::<N, 0>(level, center, block)?;
        let [fx, fy] = source.fraction;
        let mut sums = [[0.0_f32; 4]; 5];
        let (mut upper, mut lower) = ([0.0_f32; N], [0.0_f32; N]);
        interpolate_row(source.pixels, N, fx, &mut upper)?;
        let offset = upper[N / 2];
        for (y, template) in template.iter().enumerate() {
            interpolate_row(source.pixels.get((y + 1) * source.stride..)?, N, fx, &mut lower)?;
            for k in (0..N).step_by(4) {
                for l in 0..4 {
                    let (u, t) = (upper[k + l], template[k + l]);
                    let value = u + fy * (lower[k + l] - u) - offset;
                    sums[0][l] += value;
                    sums[1][l] += value * value;
                    sums[2][l] += value * t;
                    sums[3][l] += t;
                    sums[4][l] += t * t;
                }
            }
            upper = lower;
        }
        let [i, ii, it, t, tt] = sums.map(|lanes| sum(&lanes));
        let count = (N * N) as f32;
        let (variance_i, variance_t, covariance) = (ii - i * i / count, tt - t * t / count, it - i * t / count);
        let square = covariance * covariance / (variance_i * variance_t).max(1e-3);
        let correlation = crate::real::Real::root(square);
        Some((if covariance < 0.0 { -correlation } else { correlation }, covariance / variance_t.max(1e-3)))
    }

    /// Gauss-Newton at one level from `start`. Returns the place, or why there is none.
    fn align(&mut self, level: &Level<'_>, start: [f32; 2], converged_px: f32, max_iterations: u32) -> Result<[f32; 2], FlowFailure> {
        let mut center = start;
        let far = N as f32 * 0.75;
        let mut last_square = f32::MAX;
        for _ in 0..max_iterations {
            let [bx, by] = self.steepest_descent(level, center).ok_or(FlowFailure::Outside)?;
            let [ixx, ixy, iyy] = self.inverse_hessian;
            let (dx, dy) = (ixx * bx + ixy * by, ixy * bx + iyy * by);
            center = [center[0] - dx, center[1] - dy];
            let (from_x, from_y) = (center[0] - start[0], center[1] - start[1]);
            if !(from_x * from_x + from_y * from_y < far * far) {
                return Err(FlowFailure::Diverged);
            }
            let square = dx * dx + dy * dy;
            if square < converged_px * converged_px {
                return Ok(center);
            }
            last_square = square;
        }
        // Out of steps: good enough if the last was small.
        if last_square < 0.01 { Ok(center) } else { Err(FlowFailure::Diverged) }
    }

    /// Follows the patch at `from` (px of level 0 of the first images) into the second images, starting at `predicted`.
    ///
    /// `pyramid(level)` yields a level of the first and of the second image, up to `levels`.
    ///
    /// # Errors
    /// Why it was not found.
    pub fn track<'a>(
        &mut self,
        config: &FlowConfig,
        levels: usize,
        pyramid: impl Fn(usize) -> Option<(Level<'a>, Level<'a>)>,
        from: [f32; 2],
        predicted: [f32; 2],
    ) -> Result<[f32; 2], FlowFailure> {
        let mut place = predicted;
        for index in (0..levels.clamp(1, MAX_LEVELS)).rev() {
            let (first, second) = pyramid(index).ok_or(FlowFailure::Outside)?;
            let scale = 1.0 / (1_u32 << index) as f32;
            let down = |p: [f32; 2]| [(p[0] + 0.5) * scale - 0.5, (p[1] + 0.5) * scale - 0.5];
            if index == 0 {
                if !(is_inside::<N>(&first, from) && is_inside::<N>(&second, place)) {
                    return Err(FlowFailure::Outside);
                }
                self.read_template(&first, from, config.min_eigenvalue)?;
                place = self.align(&second, place, config.converged_px, config.max_iterations)?;
                if !is_inside::<N>(&second, place) {
                    return Err(FlowFailure::Outside);
                }
                let (correlation, gain) = self.likeness(&second, place).ok_or(FlowFailure::Outside)?;
                if !(correlation >= config.min_correlation && gain <= config.max_gain && gain * config.max_gain >= 1.0) {
                    return Err(FlowFailure::Different);
                }
            } else if self.read_template(&first, down(from), config.min_eigenvalue).is_ok() {
                // A coarse level that fails leaves the prediction as it was.
                if let Ok(found) = self.align(&second, down(place), config.converged_coarse_px, config.max_iterations) {
                    let up = (1_u32 << index) as f32;
                    place = [(found[0] + 0.5) * up - 0.5, (found[1] + 0.5) * up - 0.5];
                }
            }
        }
        Ok(place)
    }
}

/// Whether a patch at `center` lies in the level with all the pixels that it reads.
#[must_use]
pub fn is_inside<const N: usize>(level: &Level<'_>, center: [f32; 2]) -> bool {
    let reach = half_width::<N>() + 1.0;
    let right = level.width() as f32 - 2.0 - reach;
    let bottom = level.height() as f32 - 2.0 - reach;
    center[0] >= reach && center[1] >= reach && center[0] <= right && center[1] <= bottom
}
