//! A start in motion while it is computed: in one image, or a piece of it with each of some images.
//!
//! ```text
//! gyro bias, linear solution ─▶ refinement, some iterations an image ─▶ states ─▶ the window's own solver
//!        ▲                                                                │
//!        └───── integrated anew, where the bias came out far away ────────┘
//! ```
//! The frames and landmarks of the window stay as they are meanwhile: images that come in are followed, and left out.

use heapless::Vec;
use nalgebra::Vector3;

use super::{Estimator, StepBudget, Waiting};
use crate::camera::Camera;
use crate::imu::{ImuBias, NavState};
use crate::init::{InertialLink, InitConfig, InitError, MovingStart, Problem};
use crate::real::Real;
use crate::storage::blank::{Blank, blank};
use crate::time::Timestamp;
use crate::window::NormalizedPoint;

/// A gyro bias this far from the one integrated with, rad/s, asks for a second round.
const FAR_BIAS: f64 = 0.02;

/// What comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Nothing,
    Beginning,
    Refinement,
    Settlement,
}

impl Blank for Stage {
    const BLANK: Self = Self::Nothing;
}

/// How far the start is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attempt<T: Real> {
    stage: Stage,
    /// Whether the samples have been integrated anew.
    is_second_round: bool,
    integrated_at: ImuBias<T>,
    start: MovingStart<T>,
}

blank!([T: Real] Attempt<T> { stage, is_second_round, integrated_at, start });

impl<T: Real> Attempt<T> {
    pub(super) fn is_under_way(&self) -> bool {
        self.stage != Stage::Nothing
    }

    pub(super) fn begin(&mut self, integrated_at: ImuBias<T>) {
        (self.stage, self.is_second_round, self.integrated_at) = (Stage::Beginning, false, integrated_at);
    }

    pub(super) fn end(&mut self) {
        self.stage = Stage::Nothing;
    }
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// Whether an image at `stamp` stays out of the window, because a start is being computed from what is in it. It may not take so long
    /// that samples no longer find room.
    pub(super) fn leaves_out(&mut self, stamp: Timestamp) -> bool {
        let Some(newest) = self.window.frames.last().map(|frame| frame.stamp) else { return false };
        if self.attempt.is_under_way() && self.inertial.count(newest, stamp) * 4 > SAMPLES * 3 {
            self.attempt.end();
        }
        self.attempt.is_under_way()
    }

    /// Finds the states of all frames, or as much as the budget of one image allows.
    // Out of line: this memory is given back before the solution needs its own.
    #[inline(never)]
    pub(super) fn align(&mut self, budget: StepBudget) -> Result<(), Waiting> {
        loop {
            match self.attempt.stage {
                Stage::Settlement => {
                    self.attempt.end();
                    return Ok(());
                }
                _ => self.align_some(usize::from(budget.start_iterations))?,
            }
            if !budget.is_whole_start() {
                return Err(Waiting::Computation);
            }
        }
    }

    /// The next piece of work.
    #[inline(never)]
    fn align_some(&mut self, iterations: usize) -> Result<(), Waiting> {
        let mut links = Vec::<InertialLink<T>, FRAMES>::new();
        links.extend(self.window.frames.iter().skip(1).map(|frame| InertialLink::from(&frame.from_previous)));
        let config = InitConfig {
            sigma_px: self.config.sigma_px,
            focal_px: self.camera.focal_px(),
            gravity_m_s2: self.config.gravity_m_s2,
            maximum_scale_sigma: self.config.initialisation_scale_sigma,
            ..InitConfig::default()
        };
        let landmarks = &self.window.landmarks;
        // The memory of the normal equations is idle until there is a solution: it holds bearings, which are asked for hundreds of
        // times, and equations of landmarks, as many as fit.
        let idle = self.workspace.normal.memory().as_flattened_mut();
        let (known, memory) = idle.split_at_mut(idle.len().min(landmarks.len() * FRAMES * 3));
        let known = known.as_chunks_mut::<3>().0.as_chunks_mut::<FRAMES>().0;
        for (row, landmark) in known.iter_mut().zip(landmarks) {
            for (frame, point) in landmark.seen() {
                if let Some(place) = row.get_mut(frame) {
                    *place = bearing(point).into();
                }
            }
        }
        let bearings = (landmarks.len(), |landmark: usize, frame: usize| {
            let point = landmarks.get(landmark)?.point(frame)?;
            let known = known.get(landmark).and_then(|row| row.get(frame));
            Some(known.map_or_else(|| bearing(point), |known| Vector3::from(*known)))
        });
        let body_from_camera = &self.settings.body_from_camera;
        let problem = Problem::<_, _, FRAMES> { config: &config, body_from_camera, links: &links, bearings: &bearings };
        let (records, memory) = (&mut self.init_landmarks, memory.as_chunks_mut().0);
        let iterations = if iterations == usize::from(StepBudget::WHOLE_START) { usize::MAX } else { iterations };
        let mut states = [NavState::origin(); FRAMES];
        let found = if self.attempt.stage == Stage::Beginning {
            MovingStart::begin(&problem, records).map(|start| {
                (self.attempt.start, self.attempt.stage) = (start, Stage::Refinement);
                None
            })
        } else {
            let start = &mut self.attempt.start;
            start.refine(&problem, records, memory, iterations).and_then(|is_over| {
                let found = if is_over { Some(start.finish(&problem, records, &mut states)?.bias) } else { None };
                Ok(found)
            })
        };
        let found = found.map_err(|error| {
            self.report.init_error = Some(error);
            waiting_for(&error)
        })?;
        if let Some(bias) = found {
            self.take_states(&states, bias);
        }
        Ok(())
    }

    /// Takes the states that were found, or begins the second round at their bias.
    fn take_states(&mut self, states: &[NavState<T>; FRAMES], bias: ImuBias<T>) {
        let moved = (bias.gyro_rad_s - self.attempt.integrated_at.gyro_rad_s).norm();
        self.integrate_at(bias);
        if !self.attempt.is_second_round && moved >= T::of(FAR_BIAS) {
            (self.attempt.stage, self.attempt.is_second_round) = (Stage::Beginning, true);
            return;
        }
        self.attempt.stage = Stage::Settlement;
        for (frame, state) in self.window.frames.iter_mut().zip(states) {
            frame.state = *state;
        }
    }
}

fn bearing<T: Real>(point: &NormalizedPoint<T>) -> Vector3<T> {
    Vector3::new(point.x, point.y, T::one()).normalize()
}

fn waiting_for<T: Real>(error: &InitError<T>) -> Waiting {
    match error {
        InitError::Parallax(_) => Waiting::Parallax,
        InitError::Excitation(_) => Waiting::Excitation,
        InitError::Gravity(_) => Waiting::Gravity,
        InitError::Agreement(..) | InitError::Numerical => Waiting::Agreement,
        _ => Waiting::Tracks,
    }
}
