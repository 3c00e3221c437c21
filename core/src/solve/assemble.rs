//! Normal equations of the window with the landmarks eliminated.
//!
//! # Model
//! Every factor contributes `JᵀJ` and `Jᵀr`; each landmark is one scalar `λ` with
//! ```text
//! c = Σ w J_λᵀ J_λ     g = Σ w J_λᵀ r     W_f = Σ w J_fᵀ J_λ
//! H ← H − W Wᵀ / c      b ← b − W g / c   (Schur complement)
//! δλ = −(g + Wᵀ δx) / c
//! ```
//! `w` is the robust weight. The elimination of one landmark touches only the frames that see it.

use super::workspace::{Settings, Workspace};
use crate::factor::{imu, prior::Prior, reprojection};
use crate::real::Real;
use crate::storage::blocks::{Block, add_transposed_product, place, zero_block};
use crate::window::{Landmark, Window};

/// Robust cost `½ Σ ρ` at the current states. Needs up-to-date geometry in the workspace.
pub fn cost<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &Window<T, FRAMES, POINTS>,
    prior: &Prior<T, FRAMES, PAIRS>,
    workspace: &Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
) -> T {
    let huber = settings.kernel;
    let mut total = prior.cost(&window.frames);
    for landmark in window.landmarks.iter().filter(|landmark| landmark.active) {
        let direction = landmark.direction();
        let anchor = landmark.anchor();
        for (frame, point) in landmark.seen().filter(|(frame, _)| *frame != anchor) {
            let squared = reprojection::residual(&workspace.geometry.pairs[anchor][frame], &direction, landmark.inverse_depth, point)
                .map_or(settings.behind_camera_cost, |residual| residual.norm_squared());
            total += huber.rho(squared);
        }
    }
    for pair in window.frames.windows(2).zip(&workspace.imu_square_roots[1..]) {
        if let ([from, to], Some(root)) = pair {
            let residual = root * imu::residual(&to.from_previous, &settings.gravity_in_world, &from.state, &to.state);
            total += residual.norm_squared();
        }
    }
    for frame in window.frames.iter().filter(|frame| frame.at_rest) {
        total += frame.state.velocity_in_world.norm_squared() / (settings.rest_sigma_m_s * settings.rest_sigma_m_s);
    }
    total * T::of(0.5)
}

/// Fills `H` and `b` of the workspace and returns the robust cost. Landmarks are damped by `damping` here, the frames are not.
pub fn assemble<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &Window<T, FRAMES, POINTS>,
    prior: &Prior<T, FRAMES, PAIRS>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    damping: T,
) -> T {
    let frames = window.frames.len();
    workspace.clear(frames);
    let mut total = prior.cost(&window.frames);
    prior.add_to(&window.frames, &mut workspace.hessian, &mut workspace.gradient);
    for landmark in window.landmarks.iter().filter(|landmark| landmark.active) {
        total += add_landmark(landmark, workspace, settings, damping);
    }
    for i in 1..frames {
        total += add_inertial(window, workspace, settings, i);
    }
    let rest = T::one() / (settings.rest_sigma_m_s * settings.rest_sigma_m_s);
    for (i, frame) in window.frames.iter().enumerate().filter(|(_, frame)| frame.at_rest) {
        for (axis, velocity) in frame.state.velocity_in_world.iter().enumerate() {
            workspace.hessian[place(i, i)][6 + axis][6 + axis] += rest;
            workspace.gradient[i][6 + axis] += rest * *velocity;
            total += rest * *velocity * *velocity;
        }
    }
    total * T::of(0.5)
}

/// Moves every active landmark by its part of the step that was solved for the frames.
pub fn back_substitute<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &mut Window<T, FRAMES, POINTS>,
    workspace: &Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    damping: T,
) {
    let huber = settings.kernel;
    for landmark in window.landmarks.iter_mut().filter(|landmark| landmark.active) {
        let anchor = landmark.anchor();
        let direction = landmark.direction();
        let (mut curvature, mut slope) = (T::ZERO, T::ZERO);
        for (frame, point) in landmark.seen().filter(|(frame, _)| *frame != anchor) {
            let Some(linear) = workspace.geometry.linearize(settings, anchor, frame, &direction, landmark.inverse_depth, point) else {
                continue;
            };
            let r = &linear.residual;
            let weight = huber.weight(r[0] * r[0] + r[1] * r[1]);
            for (row, value) in r.iter().enumerate() {
                let mut moved = *value;
                for c in 0..6 {
                    moved += linear.d_residual_d_anchor[row][c] * workspace.step[anchor][c]
                        + linear.d_residual_d_target[row][c] * workspace.step[frame][c];
                }
                let d_depth = linear.d_residual_d_inverse_depth[row];
                slope += weight * d_depth * moved;
                curvature += weight * d_depth * d_depth;
            }
        }
        landmark.saved_inverse_depth = landmark.inverse_depth;
        if curvature > T::ZERO {
            landmark.inverse_depth -= slope / damped(curvature, damping);
        }
    }
}

#[inline]
fn damped<T: Real>(curvature: T, damping: T) -> T {
    curvature * (T::one() + damping) + T::of(1e-6)
}

fn add_landmark<T: Real, const FRAMES: usize, const PAIRS: usize>(
    landmark: &Landmark<T, FRAMES>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    damping: T,
) -> T {
    let huber = settings.kernel;
    let anchor = landmark.anchor();
    let direction = landmark.direction();
    let (mut curvature, mut slope, mut total) = (T::ZERO, T::ZERO, T::ZERO);
    let mut anchor_hessian = zero_block::<T, 6>();
    let mut anchor_gradient = [T::ZERO; 6];
    let mut anchor_coupling = [T::ZERO; 6];
    // W_f of the frames that see it, oldest first; the anchor's comes first because the anchor is the oldest.
    let mut couplings = [(0_usize, [T::ZERO; 6]); FRAMES];
    let mut count = 1;
    for (frame, point) in landmark.seen().filter(|(frame, _)| *frame != anchor) {
        let Some(linear) = workspace.geometry.linearize(settings, anchor, frame, &direction, landmark.inverse_depth, point) else {
            total += huber.rho(settings.behind_camera_cost);
            continue;
        };
        let r = &linear.residual;
        let squared = r[0] * r[0] + r[1] * r[1];
        let weight = huber.weight(squared);
        total += huber.rho(squared);
        let (da, dt, dl) = (&linear.d_residual_d_anchor, &linear.d_residual_d_target, &linear.d_residual_d_inverse_depth);
        curvature += weight * (dl[0] * dl[0] + dl[1] * dl[1]);
        slope += weight * (dl[0] * r[0] + dl[1] * r[1]);
        let cross = &mut workspace.hessian[place(frame, anchor)];
        for i in 0..6 {
            let (t0, t1) = (weight * dt[0][i], weight * dt[1][i]);
            for j in 0..6 {
                cross[i][j] += t0 * da[0][j] + t1 * da[1][j];
            }
        }
        let own = &mut workspace.hessian[place(frame, frame)];
        let mut coupling = [T::ZERO; 6];
        for i in 0..6 {
            let (t0, t1) = (weight * dt[0][i], weight * dt[1][i]);
            for j in 0..6 {
                own[i][j] += t0 * dt[0][j] + t1 * dt[1][j];
            }
            workspace.gradient[frame][i] += t0 * r[0] + t1 * r[1];
            coupling[i] = t0 * dl[0] + t1 * dl[1];
            let (a0, a1) = (weight * da[0][i], weight * da[1][i]);
            for j in 0..6 {
                anchor_hessian[i][j] += a0 * da[0][j] + a1 * da[1][j];
            }
            anchor_gradient[i] += a0 * r[0] + a1 * r[1];
            anchor_coupling[i] += a0 * dl[0] + a1 * dl[1];
        }
        couplings[count] = (frame, coupling);
        count += 1;
    }
    if !(curvature > T::ZERO) {
        return total;
    }
    couplings[0] = (anchor, anchor_coupling);
    let own = &mut workspace.hessian[place(anchor, anchor)];
    for i in 0..6 {
        for j in 0..6 {
            own[i][j] += anchor_hessian[i][j];
        }
        workspace.gradient[anchor][i] += anchor_gradient[i];
    }
    let inverse = T::one() / damped(curvature, damping);
    for (row, (frame, coupling)) in couplings[..count].iter().enumerate() {
        let mut scaled = *coupling;
        for (value, out) in scaled.iter_mut().zip(&mut workspace.gradient[*frame]) {
            *value *= inverse;
            *out -= *value * slope;
        }
        for (other_frame, other) in &couplings[..=row] {
            let block = &mut workspace.hessian[place(*frame, *other_frame)];
            for i in 0..6 {
                for j in 0..6 {
                    block[i][j] -= scaled[i] * other[j];
                }
            }
        }
    }
    total
}

fn add_inertial<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &Window<T, FRAMES, POINTS>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    to: usize,
) -> T {
    let (Some(root), Some(before), Some(after)) = (&workspace.imu_square_roots[to], window.frames.get(to - 1), window.frames.get(to))
    else {
        return T::ZERO;
    };
    let linear = imu::linearize(
        &after.from_previous,
        &settings.gravity_in_world,
        root,
        &before.state,
        &after.state,
        before.linearization_point(),
        after.linearization_point(),
    );
    let (from_rows, to_rows) = (block_of(&linear.d_residual_d_from), block_of(&linear.d_residual_d_to));
    add_transposed_product(&mut workspace.hessian[place(to - 1, to - 1)], &from_rows, &from_rows);
    add_transposed_product(&mut workspace.hessian[place(to, to - 1)], &to_rows, &from_rows);
    add_transposed_product(&mut workspace.hessian[place(to, to)], &to_rows, &to_rows);
    for (k, residual) in linear.residual.iter().enumerate() {
        for c in 0..15 {
            workspace.gradient[to - 1][c] += from_rows[k][c] * *residual;
            workspace.gradient[to][c] += to_rows[k][c] * *residual;
        }
    }
    linear.residual.norm_squared()
}

/// Row-major copy of a matrix.
pub(super) fn block_of<T: Real>(matrix: &nalgebra::SMatrix<T, 15, 15>) -> Block<T, 15> {
    let mut rows = zero_block();
    for (c, column) in matrix.column_iter().enumerate() {
        for (r, value) in column.iter().enumerate() {
            rows[r][c] = *value;
        }
    }
    rows
}
