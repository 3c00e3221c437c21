//! The search for planes, in a thread of its own.

use std::sync::mpsc::{Receiver, Sender, channel};

use libella_core::plane::fit::FitConfig;
use libella_core::plane::{Detection, Detections, Samples};
use libella_core::robust::ransac::Generator;
use nalgebra::{UnitVector3, Vector3};

use super::evidence::{Evidence, SAMPLES};
use super::finder::{CORNERS, PLANES};
use super::sight::{Sight, is_opaque};
use super::weighted::refit;
use crate::fault::{Fault, FaultKind};

/// What a search is given.
pub(super) struct Question {
    /// What is known.
    pub evidence: Evidence,
    /// The wall that others are expected to be parallel or at right angles to.
    pub main_wall: Option<UnitVector3<f64>>,
    /// The share of what is sought among, by weight, that a plane has to have.
    pub least_share: f64,
    /// Seed of the draws.
    pub seed: u64,
}

/// What it found.
pub(super) type Answer = Vec<Detection<f64, CORNERS>>;

/// A thread that searches. It ends with this handle.
#[derive(Debug)]
pub(super) struct Seeker {
    questions: Sender<Question>,
    answers: Receiver<Answer>,
}

impl Seeker {
    pub fn start(mut config: FitConfig<f64>) -> Result<Self, Fault> {
        let (questions, asked) = channel::<Question>();
        let (answered, answers) = channel();
        let work = move || {
            // Scratch of a third of a megabyte, made once.
            let mut samples = Box::new(Samples::<f64, SAMPLES>::new(&Vector3::z_axis(), config.normal_tolerance_rad));
            let mut detections = Box::<Detections<f64, PLANES, CORNERS>>::default();
            for question in asked {
                samples.clear();
                config.ransac.least_inlier_ratio = question.least_share;
                // A point that is refused is no number.
                let taken: Vec<&Sight> = question.evidence.sought().filter(|sight| samples.push(&sight.sample).is_ok()).collect();
                detections.detect(&mut samples, question.main_wall.as_ref(), &config, &mut Generator::new(question.seed));
                let on = |plane: usize| {
                    let samples = &samples;
                    taken.iter().enumerate().filter(move |(place, _)| samples.plane_of(*place) == Some(plane)).map(|(_, sight)| *sight)
                };
                let refined = detections.iter().enumerate().map(|(place, found)| refit(found, on(place)));
                let sights = &question.evidence.sights;
                let opaque = refined.filter(|found| is_opaque(&found.fit.plane, &found.polygon, sights, config.theta_m));
                if answered.send(opaque.collect()).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("planes".into()).stack_size(8 << 20).spawn(work).map_err(|error| {
            Fault::new(FaultKind::Output, format!("no thread for the planes ({error})"), "free memory or raise the limit")
        })?;
        Ok(Self { questions, answers })
    }

    /// Whether the thread took it.
    pub fn ask(&self, question: Question) -> bool {
        self.questions.send(question).is_ok()
    }

    /// Waits for the answer; `None` where the thread has gone.
    pub fn answer(&self) -> Option<Answer> {
        self.answers.recv().ok()
    }
}
