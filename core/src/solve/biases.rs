//! How well a window knows the biases of its newest frame.

use super::levenberg::solve_step;
use super::{Settings, Workspace, assemble, chain};
use crate::factor::prior::Prior;
use crate::real::Real;
use crate::window::Window;

/// Where the biases of a frame begin, `[b_g b_a]`.
const FIRST: usize = 9;

/// Variances of `[b_g b_a]` of the newest frame, (rad/s)² and (m/s²)²: six diagonal entries of the inverse of the whole system at the
/// states as they are, one solved column each. Takes about as long as one iteration of a solution and overwrites the workspace as that
/// does; `None` where the system cannot be solved.
pub fn newest_bias_variances<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &Window<T, FRAMES, POINTS>,
    prior: &Prior<T, FRAMES, PAIRS>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
) -> Option<[T; 6]> {
    let frames = window.frames.len();
    let newest = frames.checked_sub(1)?;
    workspace.prepare(window, settings);
    assemble(window, prior, workspace, settings, T::ZERO);
    solve_step(workspace, frames, T::ZERO)?;
    let mut variances = [T::ZERO; 6];
    for (axis, variance) in variances.iter_mut().enumerate() {
        workspace.step[..frames].fill([T::ZERO; 15]);
        workspace.step[newest][FIRST + axis] = T::one();
        chain::solve(&mut workspace.normal.parts(), &mut workspace.step[..frames], &mut workspace.visual_gradient);
        *variance = workspace.step[newest][FIRST + axis];
        if !(*variance > T::ZERO && variance.is_usable()) {
            return None;
        }
    }
    Some(variances)
}
