//! One run of one variant on one sequence.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use super::stored::{Maps, Stored};
use super::{Plan, PreparedSequence, Variant, fingerprint};
use crate::config::Config;
use crate::dataset;
use crate::fault::Fault;
use crate::network::{DepthNetwork, ModelChoice};
use crate::pipeline::{self, Ended, Report};

/// Counted up when what a result holds means something else than before.
const FORMAT: u32 = 3;
/// By how much gravity differs from run to run, m/s².
const GRAVITY_STEP_M_S2: f64 = 1e-9;

/// A run that may have been made already.
#[derive(Debug, Clone)]
pub(super) struct Job {
    pub sequence: Arc<PreparedSequence>,
    pub variant: Variant,
    /// Counted from 1.
    pub run: u32,
    pub config: Config,
    pub key: String,
    pub build: String,
    pub maps: Arc<Maps>,
}

/// What a run gave. The names of the fields are an interface: they stay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunResult {
    /// The row.
    pub sequence: String,
    /// The column.
    pub variant: Variant,
    /// Which run, counted from 1.
    pub run: u32,
    /// Hash of recording, configuration and source of depth.
    pub key: String,
    /// Hash of the program.
    pub build: String,
    /// Seed of the run.
    pub seed: u64,
    /// Magnitude of gravity of the run, m/s².
    pub gravity_m_s2: f64,
    /// Images left out at the beginning.
    pub skipped_images: usize,
    /// `complete`, or what the estimator said when it failed.
    pub ended: String,
    /// Images in the recording.
    pub frames: usize,
    /// Causal poses.
    pub poses: usize,
    /// `poses / frames`.
    pub coverage: f64,
    /// From the first image to the first pose, s.
    pub initialised_after_s: Option<f64>,
    /// From the first image until the scale of every stretch of 2 s is right within 10 %, s.
    pub metric_after_s: Option<f64>,
    /// Position error after alignment by a rigid transform, RMSE, m.
    pub ate_rmse_m: Option<f64>,
    /// How far the scale is from the truth's, percent.
    pub scale_error_percent: Option<f64>,
    /// Length of the true path over the poses, m.
    pub path_length_m: Option<f64>,
    /// Mean normalised estimation error squared of the pose; 6 is consistent.
    pub pose_nees_mean: Option<f64>,
    /// Relative errors.
    pub rpe: Vec<RelativeFigure>,
    /// Against other truths of the recording.
    pub other_truths: Vec<OtherAte>,
    /// Depth maps that were used, of those that were made.
    pub depth_maps: Option<[usize; 2]>,
    /// Share of the landmarks that were drawn to a plane.
    pub share_on_planes: Option<f64>,
    /// Median time in the estimator per image, ms; several runs at a time slow each other down.
    pub core_ms_median: Option<f64>,
    /// Wall time, s.
    pub wall_s: f64,
}

/// Relative errors over one distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RelativeFigure {
    /// Length of the stretches, m.
    pub distance_m: f64,
    /// RMSE of the relative position, m.
    pub translation_rmse_m: f64,
    /// RMSE of the relative rotation, degrees.
    pub rotation_rmse_deg: f64,
}

/// The error against a truth beside the first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OtherAte {
    /// The folder of the truth.
    pub truth: String,
    /// RMSE after alignment, m; none where estimate and truth share no time.
    pub ate_rmse_m: Option<f64>,
}

/// All runs of a plan, sequence by sequence.
pub(super) fn jobs(plan: &Plan, sequences: &[PreparedSequence]) -> Result<Vec<Job>, Fault> {
    let build = fingerprint::of_program();
    let Ok(choice) = plan.depth.parse::<ModelChoice>();
    let model = match choice.file()? {
        Some(path) => fingerprint::of_file(&path)? + &fingerprint::of_file(&path.with_extension("toml")).unwrap_or_default(),
        None => String::new(),
    };
    let mut jobs = Vec::new();
    for sequence in sequences {
        let (sequence, maps) = (Arc::new(sequence.clone()), Arc::new(Maps::default()));
        for variant in &plan.variants {
            for run in 1..=plan.runs {
                let mut config = variant.applied_to(&plan.config, &plan.depth);
                config.seed = config.seed.wrapping_add(u64::from(run - 1));
                config.estimator.gravity_m_s2 += f64::from(run - 1) * GRAVITY_STEP_M_S2;
                config.dataset.skip_images += run as usize - 1;
                // What a configuration holds is text and finite numbers: it can always be written.
                let text = serde_json::to_string(&config).unwrap_or_default();
                let print = fingerprint::Fingerprint::new().add(&FORMAT.to_le_bytes()).add(sequence.fingerprint.as_bytes());
                let print = print.add(text.as_bytes()).add(if variant.has_depth() { model.as_bytes() } else { &[] });
                let (sequence, maps, build) = (Arc::clone(&sequence), Arc::clone(&maps), build.clone());
                jobs.push(Job { sequence, variant: *variant, run, config, key: print.hex(), build, maps });
            }
        }
    }
    Ok(jobs)
}

impl Job {
    /// Where its result lies.
    pub fn file(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}.{}.run{}.{}.json", file_name(&self.sequence.name), self.variant.name(), self.run, self.key))
    }

    /// The result of an earlier call; `None` where there is none that is whole, of this key, and of this program.
    pub fn found(&self, folder: &Path, any_build: bool) -> Option<RunResult> {
        let text = std::fs::read_to_string(self.file(folder)).ok()?;
        let result: RunResult = serde_json::from_str(&text).ok()?;
        (result.key == self.key && (any_build || result.build == self.build)).then_some(result)
    }

    /// Runs, and leaves the result in the folder; `None` where it was interrupted.
    pub fn work(&self, folder: &Path, stop: &AtomicBool, mut each_image: impl FnMut()) -> Result<Option<RunResult>, Fault> {
        let recording = dataset::open(&self.sequence.path, &self.config.dataset)?;
        let Ok(choice) = self.config.depth.source.parse::<ModelChoice>();
        let network = Stored::open(&self.maps, &choice, &recording.rig.camera, &self.sequence.path)?;
        let network = network.filter(|_| self.variant.has_depth()).map(|network| -> Box<dyn DepthNetwork> { Box::new(network) });
        let run = pipeline::run_with_depth(&recording, &self.config, network, stop, |_| each_image())?;
        let ended = match &run.ended {
            Ended::Interrupted => return Ok(None),
            Ended::Complete => "complete".to_owned(),
            Ended::Failed(said) => said.clone(),
        };
        let estimate = run.trajectory();
        let evaluation = pipeline::evaluated(&estimate, &recording, &self.config);
        let report = Report::new(&recording, &self.config, &run, evaluation.as_ref());
        let finite = |value: Option<f64>| value.filter(|value| value.is_finite());
        let truths = self.sequence.other_truths.iter();
        let result = RunResult {
            sequence: self.sequence.name.clone(),
            variant: self.variant,
            run: self.run,
            key: self.key.clone(),
            build: self.build.clone(),
            seed: self.config.seed,
            gravity_m_s2: self.config.estimator.gravity_m_s2,
            skipped_images: self.config.dataset.skip_images,
            ended,
            frames: report.frames,
            poses: report.poses,
            coverage: report.coverage,
            initialised_after_s: report.initialised_after_s,
            metric_after_s: finite(report.metric_after_s),
            ate_rmse_m: finite(report.ate_rmse_m),
            scale_error_percent: finite(report.scale_error_percent),
            path_length_m: finite(report.path_length_m),
            pose_nees_mean: finite(report.pose_nees.map(|nees| nees.mean)),
            rpe: report
                .rpe
                .iter()
                .map(|error| RelativeFigure {
                    distance_m: error.distance_m,
                    translation_rmse_m: error.translation_rmse_m,
                    rotation_rmse_deg: error.rotation_rmse_deg,
                })
                .collect(),
            other_truths: truths
                .map(|truth| OtherAte { truth: truth.name.into(), ate_rmse_m: truth.ate_rmse_m(&estimate, &self.config.evaluation) })
                .collect(),
            depth_maps: report.depth.as_ref().map(|depth| [depth.believed, depth.images]),
            share_on_planes: report.planes.as_ref().and_then(|planes| planes.share_on_planes),
            core_ms_median: report.core_ms.as_ref().map(|core| core.total.median),
            wall_s: run.wall_s,
        };
        keep(&self.file(folder), &result).map(Some)
    }
}

/// Writes a result and reads it back, so that a table is the same whether its runs were made now or before.
fn keep(file: &Path, result: &RunResult) -> Result<RunResult, Fault> {
    let text = serde_json::to_string_pretty(result).map_err(|error| Fault::unwritable(file, &error))? + "\n";
    // Under its own name only when it is whole: a result that is cut off is none.
    let part = file.with_extension("part");
    std::fs::write(&part, &text).and_then(|()| std::fs::rename(&part, file)).map_err(|error| Fault::unwritable(file, &error))?;
    serde_json::from_str(&text).map_err(|error| Fault::unwritable(file, &error))
}

/// A name that every file system takes.
pub(super) fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "+-_.".contains(c) { c } else { '_' };
    let text: String = name.chars().map(plain).take(80).collect();
    if text.starts_with('.') { format!("_{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_rows_become_names_of_files() {
        assert_eq!(file_name("V1_01, room 2"), "V1_01__room_2");
        assert_eq!(file_name("../x"), "_.._x");
    }
}
