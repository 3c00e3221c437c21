//! Levenberg-Marquardt with the gain ratio.

use super::{Bundle, BundleError};

/// Damping at the start and its bounds; Marquardt's, relative to the diagonal. The causal pass has left little to do, so the first step is
/// nearly Gauss and Newton's.
const DAMPING_START: f64 = 1e-8;
const DAMPING_LEAST: f64 = 1e-12;
const DAMPING_MOST: f64 = 1e4;
/// A step that lowers the cost by less than this share ends the solution.
const CONVERGED: f64 = 1e-5;
/// Cost per observation below which only rounding is left.
const EXACT: f64 = 1e-18;

/// What a solution did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveReport {
    /// Robust cost before.
    pub initial_cost: f64,
    /// Robust cost after.
    pub final_cost: f64,
    /// Steps that were tried.
    pub iterations: usize,
}

impl Bundle {
    /// Minimises the cost over keyframes, planes and the landmarks that take part; at most `iterations` steps are tried. Integrals are made anew
    /// as biases move. `go_on` is asked before every step, with the cost so far.
    ///
    /// # Errors
    /// When the cost is not finite at the start, or the solver runs out of memory.
    pub fn optimize(&mut self, iterations: usize, mut go_on: impl FnMut(f64) -> bool) -> Result<SolveReport, BundleError> {
        let mut damping = DAMPING_START;
        let mut report: Option<SolveReport> = None;
        let enough = EXACT * self.counts().1 as f64;
        let mut normal = None;
        for _ in 0..iterations {
            let current = match normal.take() {
                Some(current) => current,
                None => {
                    self.integrate_anew();
                    self.linearize()
                }
            };
            let before = current.cost;
            if !before.is_finite() {
                return Err(BundleError::NotFinite("the cost of the first guess".into()));
            }
            let report = report.get_or_insert(SolveReport { initial_cost: before, final_cost: before, iterations: 0 });
            report.final_cost = before;
            if before <= enough || !go_on(before) {
                break;
            }
            report.iterations += 1;
            let Some(step) = self.step(&current, damping)? else {
                damping = (damping * 100.0).max(1e-6);
                if damping > DAMPING_MOST {
                    break;
                }
                normal = Some(current);
                continue;
            };
            let positions: Vec<_> = self.landmarks.iter().map(|landmark| landmark.position_in_world).collect();
            let saved = (self.keyframes.clone(), positions, self.planes.clone());
            self.take(&step);
            let after = self.cost();
            let decrease = before - after;
            if after.is_finite() && decrease >= -before * 1e-14 {
                report.final_cost = after;
                // Nielsen's rule, bounded to a factor of ten.
                let gain = if step.predicted > 0.0 { decrease / step.predicted } else { 0.0 };
                damping = (damping * (1.0 - (2.0 * gain - 1.0).powi(3)).max(0.1)).max(DAMPING_LEAST);
                if decrease < before * CONVERGED {
                    break;
                }
            } else {
                (self.keyframes, self.planes) = (saved.0, saved.2);
                for (landmark, position) in self.landmarks.iter_mut().zip(saved.1) {
                    landmark.position_in_world = position;
                }
                damping = (damping * 30.0).max(1e-6);
                if damping > DAMPING_MOST {
                    break;
                }
                normal = Some(current);
            }
        }
        let cost = || {
            let cost = self.cost();
            SolveReport { initial_cost: cost, final_cost: cost, iterations: 0 }
        };
        Ok(report.unwrap_or_else(cost))
    }

    pub(super) fn take(&mut self, step: &super::normal::Step) {
        for (keyframe, delta) in self.keyframes.iter_mut().zip(&step.keyframes) {
            keyframe.state = keyframe.state.retract(delta);
        }
        for (index, delta) in &step.landmarks {
            self.landmarks[*index].position_in_world += delta;
        }
        for (plane, delta) in self.planes.iter_mut().zip(&step.planes) {
            plane.retract(*delta);
        }
    }

    fn integrate_anew(&mut self) {
        for (link, from) in self.links.iter_mut().zip(&self.keyframes) {
            link.refresh(&self.settings, &from.state.bias);
        }
    }
}
