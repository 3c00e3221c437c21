//! Levenberg-Marquardt with the gain ratio.

use super::workspace::{Settings, Workspace};
use super::{assemble, back_substitute, chain, cost};
use crate::factor::prior::Prior;
use crate::real::Real;
use crate::storage::blank::blank;
use crate::storage::blocks::{Block, place};
use crate::window::Window;

/// What a solution did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveReport<T> {
    /// Robust cost before.
    pub initial_cost: T,
    /// Robust cost after; never above the cost before.
    pub final_cost: T,
    /// Iterations that were tried.
    pub iterations: u8,
    /// Iterations whose step was kept.
    pub accepted: u8,
}

blank!([T: Real] SolveReport<T> { initial_cost, final_cost, iterations, accepted });

/// Damping at the start and its bounds; Marquardt's, relative to the diagonal.
const DAMPING_START: f64 = 1e-11;
const DAMPING_MOST: f64 = 1e3;
/// A step that lowers the cost by less than this share ends the solution.
const CONVERGED: f64 = 1e-4;

/// Minimises the cost of the window over frames and landmarks; at most `iterations` steps are tried.
///
/// A step is kept where the true cost falls; damping follows the ratio of true and predicted decrease. On return the
/// workspace holds the geometry of the final states and the factors of the last normal equations.
pub fn optimize<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &mut Window<T, FRAMES, POINTS>,
    prior: &Prior<T, FRAMES, PAIRS>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    iterations: u8,
) -> SolveReport<T> {
    let frames = window.frames.len();
    workspace.prepare(window, settings);
    let mut damping = T::of(DAMPING_START);
    let mut report = SolveReport { initial_cost: T::ZERO, final_cost: T::ZERO, iterations: 0, accepted: 0 };
    // One at least: the workspace has to hold the factor of these states.
    for iteration in 0..iterations.max(1) {
        let before = assemble(window, prior, workspace, settings, damping);
        if iteration == 0 {
            report.initial_cost = before;
        }
        report.final_cost = before;
        report.iterations += 1;
        let factored = solve_step(workspace, frames, damping);
        if iteration == 0 {
            // Later ones may be damped, which would claim to know more.
            if let Some(covariance) = factored.and_then(|_| workspace.factored_covariance(frames)) {
                workspace.newest_pose_covariance = covariance;
            }
        }
        let Some(predicted) = factored else {
            damping *= T::of(100.0);
            if damping > T::of(DAMPING_MOST) {
                break;
            }
            continue;
        };
        back_substitute(window, workspace, settings, damping);
        for (frame, (saved, step)) in window.frames.iter_mut().zip(workspace.saved.iter_mut().zip(&workspace.step)) {
            *saved = frame.state;
            frame.state = frame.state.retract(step);
        }
        workspace.geometry.update(&window.frames, settings);
        let after = cost(window, prior, workspace, settings);
        let decrease = before - after;
        // Within rounding the costs are the same, and the step is the better judge.
        if decrease >= -before * T::default_epsilon() * T::of(16.0) && after.is_usable() {
            report.accepted += 1;
            report.final_cost = after;
            let gain = if predicted > T::ZERO { decrease / predicted } else { T::ZERO };
            // Nielsen's rule, bounded to a factor of ten.
            let turn = T::of(2.0) * gain - T::one();
            damping = (damping * (T::one() - turn * turn * turn).max(T::of(0.1))).max(T::of(1e-12));
            if decrease < before * T::of(CONVERGED) {
                break;
            }
        } else {
            for (frame, saved) in window.frames.iter_mut().zip(&workspace.saved) {
                frame.state = *saved;
            }
            for landmark in window.landmarks.iter_mut().filter(|landmark| landmark.active) {
                landmark.take_step_back();
            }
            workspace.geometry.update(&window.frames, settings);
            if -decrease < before * T::of(CONVERGED) {
                break;
            }
            damping = (damping * T::of(30.0)).max(T::of(1e-5));
            if damping > T::of(DAMPING_MOST) {
                break;
            }
        }
    }
    report
}

/// Solves `(H + μ diag H) δ = −b`; returns the decrease that the linear model predicts.
pub(super) fn solve_step<T: Real, const FRAMES: usize, const PAIRS: usize>(
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    frames: usize,
    damping: T,
) -> Option<T> {
    // A floor for states that no factor touches.
    let floor = T::of(1e-6);
    let mut normal = workspace.normal.parts();
    for i in 0..frames {
        damp(&mut normal.poses[place(i, i)], damping, floor);
        damp(&mut normal.own[i], damping, floor);
    }
    chain::factorize(&mut normal, frames).ok()?;
    for (step, gradient) in workspace.step.iter_mut().zip(&workspace.gradient).take(frames) {
        for (out, value) in step.iter_mut().zip(gradient) {
            *out = -*value;
        }
    }
    chain::solve(&mut normal, &mut workspace.step[..frames], &mut workspace.visual_gradient);
    let mut predicted = T::ZERO;
    for (step, gradient) in workspace.step.iter().zip(&workspace.gradient).take(frames) {
        for (value, slope) in step.iter().zip(gradient) {
            if !value.is_usable() {
                return None;
            }
            predicted -= *value * *slope;
        }
    }
    Some(predicted * T::of(0.5))
}

fn damp<T: Real, const B: usize>(block: &mut Block<T, B>, damping: T, floor: T) {
    for (k, row) in block.iter_mut().enumerate() {
        row[k] += row[k] * damping + floor;
    }
}
