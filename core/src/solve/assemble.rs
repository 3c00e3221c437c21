//! Normal equations of the window with the landmarks eliminated.
//!
//! # Model
//! Every factor contributes `JᵀJ` and `Jᵀr`; each landmark is three numbers `l = (x, y, λ)` with
//! ```text
//! C = Σ w J_lᵀ J_l = L Lᵀ     g = Σ w J_lᵀ r     W_f = Σ w J_fᵀ J_l
//! H ← H − Y Yᵀ     b ← b − Y L⁻¹ g     Y = W L⁻ᵀ   (Schur complement)
//! δl = −C⁻¹ (g + Wᵀ δx)
//! ```
//! `w` is the robust weight. The elimination of one landmark touches only the frames that see it ([`point`](super::point)).
//!
//! All that concerns images is summed over motions of the cameras, six columns a frame, and moved to the bodies at the end:
//! with `B = ∂[θ ρ]/∂[δφ δp]`, block `(i, j)` of `H` is `B_iᵀ V_ij B_j`.

use super::normal::{Coupling, Parts};
use super::point::PointNormal;
use super::workspace::{Geometry, Settings, Workspace};
use crate::factor::{imu, prior::Prior};
use crate::real::Real;
use crate::storage::blocks::{Block, add_transposed_product, columns, place, transpose, zero_block};
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
        // Summed up by landmarks: f32 loses less.
        let mut own = settings.prior_on(landmark).residual(landmark.inverse_depth);
        own *= own;
        for (frame, point) in landmark.seen() {
            let residual = workspace.geometry.residual(anchor, frame, &direction, landmark.inverse_depth, point);
            let squared = residual.map_or(settings.behind_camera_cost, |residual| residual.norm_squared());
            own += huber.rho(squared);
        }
        if let Some(residual) = workspace.geometry.plane_residual(landmark) {
            own += huber.rho(residual * residual);
        }
        total += own;
    }
    for (pair, i) in window.frames.windows(2).zip(1..) {
        if let ([from, to], Some(root)) = (pair, workspace.imu_square_root(i)) {
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
    let Workspace { normal, geometry, gradient, visual_gradient, .. } = workspace;
    let mut normal = normal.parts();
    normal.clear(frames);
    gradient[..frames].fill([T::ZERO; 15]);
    visual_gradient[..frames].fill([T::ZERO; 6]);
    let mut total = T::ZERO;
    for landmark in window.landmarks.iter().filter(|landmark| landmark.active) {
        total += add_landmark(landmark, &mut normal, visual_gradient, geometry, settings, damping);
    }
    add_pairs(&mut normal, visual_gradient, geometry, frames);
    normal.clear_couplings(frames);
    move_to_bodies(&mut normal, visual_gradient, gradient, geometry, frames, settings);
    total += prior.add_to(&window.frames, normal.poses, normal.couplings, &mut normal.own[0], gradient);
    for i in 1..frames {
        total += add_inertial(window, workspace, settings, i);
    }
    let rest = T::one() / (settings.rest_sigma_m_s * settings.rest_sigma_m_s);
    for (i, frame) in window.frames.iter().enumerate().filter(|(_, frame)| frame.at_rest) {
        for (axis, velocity) in frame.state.velocity_in_world.iter().enumerate() {
            workspace.normal.parts().own[i][axis][axis] += rest;
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
    let geometry = &workspace.geometry;
    let mut camera_steps = [[T::ZERO; 6]; FRAMES];
    for ((out, camera), step) in camera_steps.iter_mut().zip(&geometry.first_camera_poses).zip(&workspace.step) {
        *out = settings.mount.d_camera_d_body(camera).map(|row| dot(&row, step));
    }
    for landmark in window.landmarks.iter_mut().filter(|landmark| landmark.active) {
        let anchor = landmark.anchor();
        let direction = landmark.direction();
        let mut own = PointNormal::default();
        own.add_prior(landmark.inverse_depth, &settings.prior_on(landmark));
        for (frame, point) in landmark.seen() {
            if frame == anchor {
                own.add_anchor(&direction, point, &huber);
                continue;
            }
            let Some(linear) = geometry.linearize(anchor, frame, &direction, landmark.inverse_depth, point) else {
                continue;
            };
            let r = &linear.residual;
            let weight = huber.weight(r[0] * r[0] + r[1] * r[1]);
            // The target's step as the anchor sees it.
            let mut relative = geometry.first_pairs[place(frame, anchor)].carry_to_target(&camera_steps[anchor]);
            for (value, own) in relative.iter_mut().zip(&camera_steps[frame]) {
                *value = *own - *value;
            }
            for ((value, e), by_point) in r.iter().zip(&linear.d_residual_d_target).zip(&linear.d_residual_d_landmark) {
                own.add_row(by_point, &by_point.map(|slope| slope * weight), *value + dot(e, &relative));
            }
        }
        if let Some(linear) = geometry.linearize_plane(landmark) {
            let weight = huber.weight(linear.residual * linear.residual);
            let by_point = &linear.d_residual_d_landmark;
            let residual = linear.residual + dot(&linear.d_residual_d_anchor, &camera_steps[anchor]);
            own.add_row(by_point, &by_point.map(|slope| slope * weight), residual);
        }
        if let Some(factor) = own.factorize(damping) {
            landmark.take_step(&factor.solve(&own.gradient).map(|value| -value));
        } else {
            landmark.take_step(&[T::ZERO; 3]);
        }
    }
}

/// Product of as many entries as `a` has.
#[inline(always)]
fn dot<T: Real>(a: &[T; 6], b: &[T]) -> T {
    a.iter().zip(b).fold(T::ZERO, |sum, (x, y)| sum + *x * *y)
}

/// Adds one landmark to the sums of its pairs and subtracts its Schur complement. Returns twice its cost.
fn add_landmark<T: Real, const FRAMES: usize, const PAIRS: usize>(
    landmark: &Landmark<T, FRAMES>,
    normal: &mut Parts<'_, T>,
    visual_gradient: &mut [[T; 6]; FRAMES],
    geometry: &Geometry<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    damping: T,
) -> T {
    let huber = settings.kernel;
    let anchor = landmark.anchor();
    let direction = landmark.direction();
    let mut own = PointNormal::default();
    let mut total = own.add_prior(landmark.inverse_depth, &settings.prior_on(landmark));
    // W_f of the frames that see it, oldest first; the anchor's comes first because the anchor is the oldest.
    let mut couplings = [(0_usize, [[T::ZERO; 6]; 3]); FRAMES];
    let mut anchor_coupling = [[T::ZERO; 6]; 3];
    let mut count = 1;
    for (frame, point) in landmark.seen() {
        if frame == anchor {
            total += own.add_anchor(&direction, point, &huber);
            continue;
        }
        let Some(linear) = geometry.linearize(anchor, frame, &direction, landmark.inverse_depth, point) else {
            total += huber.rho(settings.behind_camera_cost);
            continue;
        };
        let r = &linear.residual;
        let squared = r[0] * r[0] + r[1] * r[1];
        let weight = huber.weight(squared);
        total += huber.rho(squared);
        let (e, dl) = (&linear.d_residual_d_target, &linear.d_residual_d_landmark);
        let weighted = e.map(|row| row.map(|value| value * weight));
        for k in 0..2 {
            own.add_row(&dl[k], &dl[k].map(|slope| slope * weight), r[k]);
        }
        add_observation(&mut normal.couplings[place(frame, anchor)], e, &weighted, r);
        let Some((to, coupling)) = couplings.get_mut(count) else { continue };
        *to = frame;
        let pair = &geometry.first_pairs[place(frame, anchor)];
        for (k, (out, anchored)) in coupling.iter_mut().zip(&mut anchor_coupling).enumerate() {
            *out = core::array::from_fn(|i| weighted[0][i] * dl[0][k] + weighted[1][i] * dl[1][k]);
            for (sum, value) in anchored.iter_mut().zip(&pair.carry_to_anchor(out)) {
                *sum -= *value;
            }
        }
        count += 1;
    }
    if let Some(linear) = geometry.linearize_plane(landmark) {
        let squared = linear.residual * linear.residual;
        total += huber.rho(squared);
        let (e, dl) = (&linear.d_residual_d_anchor, &linear.d_residual_d_landmark);
        let weighted = e.map(|value| value * huber.weight(squared));
        own.add_row(dl, &dl.map(|slope| slope * huber.weight(squared)), linear.residual);
        for (i, value) in weighted.iter().enumerate() {
            for (out, other) in normal.poses[place(anchor, anchor)][i].iter_mut().zip(e) {
                *out += *value * *other;
            }
            visual_gradient[anchor][i] += *value * linear.residual;
            for (out, slope) in anchor_coupling.iter_mut().zip(dl) {
                out[i] += *value * *slope;
            }
        }
    }
    couplings[0] = (anchor, anchor_coupling);
    let Some(factor) = own.factorize(damping) else { return total };
    let slope = factor.whiten(&own.gradient);
    for row in 0..count {
        let (before, rest) = couplings.split_at_mut(row);
        let Some((frame, coupling)) = rest.first_mut() else { continue };
        factor.whiten_rows(coupling);
        for (i, out) in visual_gradient[*frame].iter_mut().enumerate() {
            *out -= coupling[0][i] * slope[0] + coupling[1][i] * slope[1] + coupling[2][i] * slope[2];
        }
        for (other_frame, other) in before.iter() {
            subtract_outer(&mut normal.poses[place(*frame, *other_frame)], coupling, other);
        }
        let same = *coupling;
        subtract_outer(&mut normal.poses[place(*frame, *frame)], coupling, &same);
    }
    total
}

/// `G += w eᵀ e`, `g += w eᵀ r` of a pair of frames: `G` in the first six rows, `g` in the next.
// Out of line, as the kernels of `storage::blocks` are.
#[inline(never)]
fn add_observation<T: Real>(sum: &mut Coupling<T>, e: &[[T; 6]; 2], weighted: &[[T; 6]; 2], r: &[T; 2]) {
    for i in 0..6 {
        let (first, second) = (weighted[0][i], weighted[1][i]);
        for j in 0..6 {
            sum[i][j] += first * e[0][j] + second * e[1][j];
        }
        sum[6][i] += first * r[0] + second * r[1];
    }
}

/// `V −= aᵀ b`.
#[inline(never)]
fn subtract_outer<T: Real>(block: &mut Block<T, 6>, a: &[[T; 6]; 3], b: &[[T; 6]; 3]) {
    for (i, row) in block.iter_mut().enumerate() {
        for (j, out) in row.iter_mut().enumerate() {
            *out -= a[0][i] * b[0][j] + a[1][i] * b[1][j] + a[2][i] * b[2][j];
        }
    }
}

/// Spreads the sums of the pairs over target and anchor: as `e_a = −M e`, they become `−G Mᵀ` and `M G Mᵀ`.
fn add_pairs<T: Real, const FRAMES: usize, const PAIRS: usize>(
    normal: &mut Parts<'_, T>,
    visual_gradient: &mut [[T; 6]; FRAMES],
    geometry: &Geometry<T, FRAMES, PAIRS>,
    frames: usize,
) {
    for target in 1..frames {
        for anchor in 0..target {
            let pair = &geometry.first_pairs[place(target, anchor)];
            let [information @ .., gradient, _, _] = normal.couplings[place(target, anchor)];
            add_block(&mut normal.poses[place(target, target)], &information, T::one());
            let cross = information.map(|row| pair.carry_to_anchor(&row));
            add_block(&mut normal.poses[place(target, anchor)], &cross, -T::one());
            // Symmetric, so its rows may stand for its columns.
            let own = transpose(&cross).map(|row| pair.carry_to_anchor(&row));
            add_block(&mut normal.poses[place(anchor, anchor)], &own, T::one());
            let carried = pair.carry_to_anchor(&gradient);
            for i in 0..6 {
                visual_gradient[target][i] += gradient[i];
                visual_gradient[anchor][i] -= carried[i];
            }
        }
    }
}

fn add_block<T: Real>(out: &mut Block<T, 6>, value: &Block<T, 6>, scale: T) {
    for (out, value) in out.as_flattened_mut().iter_mut().zip(value.as_flattened()) {
        *out += *value * scale;
    }
}

/// `V ← Bᵀ V B`, `b += Bᵀ v`: from motions of the cameras to motions of the bodies.
fn move_to_bodies<T: Real, const FRAMES: usize, const PAIRS: usize>(
    normal: &mut Parts<'_, T>,
    visual_gradient: &[[T; 6]; FRAMES],
    gradient: &mut [[T; 15]; FRAMES],
    geometry: &Geometry<T, FRAMES, PAIRS>,
    frames: usize,
    settings: &Settings<T>,
) {
    let mut by_body = [zero_block::<T, 6>(); FRAMES];
    for (out, camera) in by_body.iter_mut().zip(&geometry.first_camera_poses).take(frames) {
        *out = settings.mount.d_camera_d_body(camera);
    }
    for i in 0..frames {
        for j in 0..=i {
            let block = &mut normal.poses[place(i, j)];
            // (Vᵀ B_i)ᵀ = B_iᵀ V
            let mut half = zero_block::<T, 6>();
            add_transposed_product(&mut half, block, &by_body[i]);
            *block = zero_block();
            add_transposed_product(block, &half, &by_body[j]);
        }
        for (row, value) in by_body[i].iter().zip(&visual_gradient[i]) {
            for (out, entry) in gradient[i].iter_mut().zip(row) {
                *out += *entry * *value;
            }
        }
    }
}

fn add_inertial<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &Window<T, FRAMES, POINTS>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    to: usize,
) -> T {
    let (Some(root), Some(before), Some(after)) = (workspace.imu_square_root(to), window.frames.get(to - 1), window.frames.get(to)) else {
        return T::ZERO;
    };
    let linear = imu::linearize(
        &after.from_previous,
        &settings.gravity_in_world,
        &root,
        &before.state,
        &after.state,
        before.linearization_point(),
        after.linearization_point(),
    );
    let (from_rows, to_rows) = (block_of(&linear.d_residual_d_from), block_of(&linear.d_residual_d_to));
    let (from_pose, from_rest): ([[T; 6]; 15], [[T; 9]; 15]) = (columns(&from_rows, 0), columns(&from_rows, 6));
    let (to_pose, to_rest): ([[T; 6]; 15], [[T; 9]; 15]) = (columns(&to_rows, 0), columns(&to_rows, 6));
    let normal = workspace.normal.parts();
    let (first, cross, second) = (place(to - 1, to - 1), place(to, to - 1), place(to, to));
    add_transposed_product(&mut normal.poses[first], &from_pose, &from_pose);
    add_transposed_product(&mut normal.poses[cross], &to_pose, &from_pose);
    add_transposed_product(&mut normal.poses[second], &to_pose, &to_pose);
    add_transposed_product(&mut normal.couplings[first], &from_rest, &from_pose);
    add_transposed_product(&mut normal.couplings[cross], &from_rest, &to_pose);
    add_transposed_product(&mut normal.couplings[second], &to_rest, &to_pose);
    add_transposed_product(&mut normal.pose_before[to], &to_rest, &from_pose);
    add_transposed_product(&mut normal.own[to - 1], &from_rest, &from_rest);
    add_transposed_product(&mut normal.before[to], &to_rest, &from_rest);
    add_transposed_product(&mut normal.own[to], &to_rest, &to_rest);
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
