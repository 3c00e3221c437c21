//! The search for planes, in a thread of its own.

use std::sync::mpsc::{Receiver, Sender, channel};

use libella_core::plane::fit::FitConfig;
use libella_core::plane::{Detection, Detections, Sample, Samples, Source};
use libella_core::robust::ransac::Generator;
use nalgebra::{UnitVector3, Vector3};

use super::finder::{CORNERS, PLANES};
use crate::fault::{Fault, FaultKind};

/// Samples that one search looks at; of more points the newest.
pub(super) const SAMPLES: usize = 5_000;

/// What a search is given.
pub(super) struct Question {
    /// In world, m.
    pub points: Vec<Vector3<f64>>,
    /// The wall that others are expected to be parallel or at right angles to.
    pub main_wall: Option<UnitVector3<f64>>,
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
    pub fn start(config: FitConfig<f64>) -> Result<Self, Fault> {
        let (questions, asked) = channel::<Question>();
        let (answered, answers) = channel();
        let work = move || {
            // Scratch of a third of a megabyte, made once.
            let mut samples = Box::new(Samples::<f64, SAMPLES>::new(&Vector3::z_axis(), config.normal_tolerance_rad));
            let mut detections = Box::<Detections<f64, PLANES, CORNERS>>::default();
            for question in asked {
                samples.clear();
                for point_in_world in question.points {
                    // A point that is refused is no number or one too many.
                    let _ = samples.push(&Sample { point_in_world, normal_in_world: None, source: Source::MapPoint });
                }
                detections.detect(&mut samples, question.main_wall.as_ref(), &config, &mut Generator::new(question.seed));
                if answered.send(detections.to_vec()).is_err() {
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
