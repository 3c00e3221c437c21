//! The viewer while a run goes on, and at its end.

use std::collections::{BTreeMap, BTreeSet};

use libella_core::camera::CameraModel;
use libella_core::estimator::Health;
use libella_core::plane::PlaneClass;
use nalgebra::Vector3;
use re_types::archetypes::{Clear, EncodedImage, TextLog, ViewCoordinates};

use super::sink::Sink;
use super::{Target, layout, series, shapes};
use crate::config::Config;
use crate::dataset::{GrayImage, Recording};
use crate::eval::Evaluation;
use crate::fault::Fault;
use crate::paint::jpeg;
use crate::pipeline::{FrameResult, PlaneInView, Run, Trails, View, nees_over_time};

/// Poses from one drawing of the way so far to the next: each holds all of it.
const WAY_EVERY: usize = 10;
/// Points of the true way at most.
const TRUTH_POINTS: usize = 4000;
/// Of the images, which would fill a disk as they are.
const JPEG_QUALITY: u8 = 80;

/// Shows a run.
pub struct Viewer {
    sink: Sink,
    camera: CameraModel<f64>,
    images: usize,
    trails: Trails,
    way: Vec<Vector3<f64>>,
    planes: BTreeMap<usize, PlaneInView>,
    health: Option<Health>,
}

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Viewer").field("images", &self.images).finish_non_exhaustive()
    }
}

impl Viewer {
    /// Makes the file, or finds the viewer that listens.
    ///
    /// # Errors
    /// When the file cannot be made, or no viewer answers.
    pub fn open(target: &Target, recording: &Recording, has_depth: bool) -> Result<Self, Fault> {
        let mut sink = Sink::open(target, &recording.name)?;
        layout::send(&mut sink, recording.truth.is_some(), has_depth);
        sink.log_static("world", &ViewCoordinates::RIGHT_HAND_Z_UP());
        sink.log_static("world/camera/image", &shapes::pinhole_of_images(&recording.rig.camera));
        series::describe(&mut sink);
        Ok(Self {
            sink,
            camera: recording.rig.camera,
            images: 0,
            trails: Trails::default(),
            way: Vec::new(),
            planes: BTreeMap::new(),
            health: None,
        })
    }

    /// Whether this program can show runs.
    ///
    /// # Errors
    /// Never: it can.
    pub fn check() -> Result<(), Fault> {
        Ok(())
    }

    /// Shows one image of the run; they come in order.
    pub fn add(&mut self, frame: &FrameResult, view: Option<&View>) {
        self.sink.set_image(frame.stamp, self.images);
        self.images += 1;
        if self.health.replace(frame.health) != Some(frame.health) {
            self.sink.log("health", &TextLog::new(format!("{:?}", frame.health)));
        }
        if let Some(reason) = &frame.refused {
            self.sink.log("health", &TextLog::new(format!("image left out: {reason}")));
        }
        series::frame(&mut self.sink, frame);
        if let Some(view) = view {
            self.look(view);
        }
        if let Some(pose) = &frame.pose {
            self.way.push(pose.world_from_body.translation.vector);
            if self.way.len().is_multiple_of(WAY_EVERY) {
                self.sink.log("world/trajectory", &shapes::way(self.way.iter().copied(), shapes::WAY));
            }
        }
    }

    fn look(&mut self, view: &View) {
        self.trails.follow(view);
        let sink = &mut self.sink;
        if let Some(pose) = &view.world_from_camera {
            sink.log("world/camera", &shapes::pose(pose));
        }
        if let Some(bytes) = view.image.as_ref().and_then(encoded) {
            sink.log("world/camera/image", &EncodedImage::from_file_contents(bytes));
        }
        sink.log("world/camera/image/corners", &shapes::corners(view));
        sink.log("world/camera/image/tracks", &shapes::tracks(view, &self.trails));
        sink.log("world/camera/image/planes", &shapes::outlines(&view.planes));
        sink.log("world/points", &shapes::landmarks(view));
        if let Some((pinhole, image)) = view.depth.as_ref().and_then(|map| shapes::depth(&self.camera, map)) {
            sink.log("world/camera/depth", &pinhole);
            sink.log("world/camera/depth", &image);
        }
        self.take_planes(&view.planes);
    }

    /// Draws the planes that changed, and takes away those that are no more.
    fn take_planes(&mut self, planes: &[PlaneInView]) {
        let standing: BTreeSet<usize> = planes.iter().map(|plane| plane.id).collect();
        let gone: Vec<usize> = self.planes.keys().filter(|id| !standing.contains(id)).copied().collect();
        for id in gone {
            self.planes.remove(&id);
            self.sink.log(&entity_of(id), &Clear::recursive());
        }
        for plane in planes {
            let same = |known: &PlaneInView| known.class == plane.class && known.polygon_in_world == plane.polygon_in_world;
            if self.planes.get(&plane.id).is_some_and(same) {
                continue;
            }
            self.planes.insert(plane.id, plane.clone());
            if let Some((mesh, edge)) = shapes::surface(plane.class, &plane.polygon_in_world) {
                self.sink.log(&entity_of(plane.id), &mesh);
                self.sink.log(&format!("{}/edge", entity_of(plane.id)), &edge);
            }
        }
    }

    /// Shows what is known at the end of the run only: truth, errors, the whole map.
    ///
    /// # Errors
    /// When something of the run could not be written or sent.
    pub fn finish(mut self, recording: &Recording, config: &Config, run: &Run, evaluation: Option<&Evaluation>) -> Result<(), Fault> {
        let sink = &mut self.sink;
        sink.log("world/trajectory", &shapes::way(self.way.iter().copied(), shapes::WAY));
        if let Some(found) = &run.planes {
            let classes: BTreeMap<usize, PlaneClass> = found.planes.iter().map(|plane| (plane.id, plane.class)).collect();
            let points = found.points.iter().map(|(point, plane)| (*point, plane.and_then(|id| classes.get(&id).copied())));
            sink.log("world/map", &shapes::map(points));
        }
        if let (Some(truth), Some(found), Some(first), Some(last)) = (&recording.truth, evaluation, run.frames.first(), run.frames.last()) {
            let estimate_from_truth = found.truth_from_estimate.inverse();
            let during: Vec<_> = truth.poses().iter().filter(|pose| (first.stamp..=last.stamp).contains(&pose.stamp)).collect();
            let thinned = during.iter().step_by(during.len().div_ceil(TRUTH_POINTS).max(1));
            let points = thinned.map(|pose| (estimate_from_truth * pose.world_from_body).translation.vector);
            sink.log_static("world/truth", &shapes::way(points, shapes::TRUTH));
        }
        let errors: BTreeMap<i64, f64> = evaluation.map(|found| found.errors.iter().copied().collect()).unwrap_or_default();
        let nees: BTreeMap<_, f64> = nees_over_time(recording, config, run).unwrap_or_default().into_iter().collect();
        for (number, frame) in run.frames.iter().enumerate() {
            sink.set_image(frame.stamp, number);
            if let Some(error) = errors.get(&frame.stamp.as_nanos()) {
                series::value(sink, "error/position", *error);
            }
            if let Some(nees) = nees.get(&frame.stamp) {
                series::value(sink, "error/nees", *nees);
            }
        }
        self.sink.close()
    }
}

fn entity_of(plane: usize) -> String {
    format!("world/planes/{plane}")
}

fn encoded(image: &GrayImage) -> Option<Vec<u8>> {
    jpeg(&image.pixels, (image.width, image.height), image::ExtendedColorType::L8, JPEG_QUALITY)
}
