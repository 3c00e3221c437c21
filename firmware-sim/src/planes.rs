//! The planes of the room: sought now and then among the landmarks, kept by name, and told to the estimator.

use core::num::NonZeroU32;

use libella_core::estimator::FrameOutcome;
use libella_core::plane::associate::AssociateConfig;
use libella_core::plane::fit::FitConfig;
use libella_core::plane::{Detections, MicroPlanes, Sample, Samples, Source, TrackedPlane};
use libella_core::profile::Micro;
use libella_core::robust::ransac::Generator;
use libella_core::time::Timestamp;
use nalgebra::Vector3;

/// Landmarks that planes are sought among, at most.
const SAMPLES: usize = 48;
/// A landmark belongs to a plane up to this far outside of its polygon, m.
const MARGIN_M: f32 = 0.1;
/// Landmarks this near to a plane that was not found speak of a plane that ought to have been, m.
const ABOUT_M: f32 = 0.3;

/// When planes are sought and believed. A landmark of a 160×120 image is known to a decimetre or two, not to the centimetres of
/// [`FitConfig`]'s default: with those no plane is found in most flights.
///
/// Measured on seven flights at 160×120 (`accuracy`), geometric mean of the ATE: 0.161 m without planes, 0.144 m with these. Neighbouring
/// settings scatter between 0.138 and 0.168 m: slabs of 0.1 or 0.2 m, a look every 10 images, steady after 6 or 9 looks, planes that follow
/// their landmarks as those of a host do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Images with a pose between one look and the next.
    pub every: NonZeroU32,
    /// What makes a plane.
    pub fit: FitConfig<f32>,
    /// When it is the same, and steady.
    pub associate: AssociateConfig<f32>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            every: const { NonZeroU32::MIN.saturating_add(29) },
            fit: FitConfig { theta_m: 0.15, least_inliers: 10, ..FitConfig::default() },
            associate: AssociateConfig::default(),
        }
    }
}

/// What one look came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Look {
    /// Landmarks that were looked at.
    pub samples: usize,
    /// Planes found among them.
    pub found: usize,
    /// Planes known now, steady or not.
    pub known: usize,
    /// Planes fit for use.
    pub steady: usize,
    /// Landmarks that are on one of these from now on.
    pub attached: usize,
}

/// The planes that are known.
#[derive(Debug, Clone)]
pub struct Planes {
    settings: Settings,
    map: MicroPlanes,
    images: u32,
    looks: u64,
}

impl Planes {
    /// None yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self { settings, map: MicroPlanes::new(), images: 0, looks: 0 }
    }

    /// The planes fit for use.
    pub fn steady(&self) -> impl Iterator<Item = &TrackedPlane<f32, 8>> {
        self.map.steady().map(|(_, plane)| plane)
    }

    /// After an image's step: a look where one is due, and the landmarks' planes for the next solution. Planes of a world that was
    /// lost are forgotten.
    pub fn after_image(&mut self, stamp: Timestamp, outcome: FrameOutcome, estimator: &mut Micro) -> Option<Look> {
        if matches!(outcome, FrameOutcome::Initialised | FrameOutcome::Lost) {
            (self.map, self.images) = (MicroPlanes::new(), 0);
        }
        estimator.state()?;
        self.images += 1;
        let look = (self.images % self.settings.every == 0).then(|| self.look(stamp, estimator));
        let attached = self.attach(estimator);
        look.map(|look| Look { attached, ..look })
    }

    /// Seeks planes among the landmarks. Scratch of a few kilobytes, on the stack while nothing else is.
    #[inline(never)]
    fn look(&mut self, now: Timestamp, estimator: &mut Micro) -> Look {
        let Settings { fit, associate, .. } = &self.settings;
        let viewer_in_world = estimator.state().map_or_else(Vector3::zeros, |estimate| estimate.state.position_in_world);
        let mut samples = Samples::<f32, SAMPLES>::new(&Vector3::z_axis(), fit.normal_tolerance_rad);
        let mut points = [Vector3::zeros(); SAMPLES];
        for (_, point_in_world) in estimator.points_in_world() {
            // What is too far away or too many is left out.
            if samples.push(&Sample { point_in_world, normal_in_world: None, source: Source::MapPoint }).is_ok() {
                if let Some(place) = points.get_mut(samples.len() - 1) {
                    *place = point_in_world;
                }
            }
        }
        let points = points.get(..samples.len()).unwrap_or_default();
        let main_wall = self.map.main_wall().map(|(_, wall)| wall.plane.normal_in_world);
        let mut detections = Detections::<f32, 4, 8>::default();
        detections.detect(&mut samples, main_wall.as_ref(), fit, &mut Generator::new(self.looks));
        self.looks += 1;
        let should_be_seen = |plane: &TrackedPlane<f32, 8>| {
            points.iter().filter(|point| plane.supports(point, ABOUT_M, MARGIN_M)).count() >= fit.least_inliers
        };
        self.map.update(&detections, now, &viewer_in_world, associate, should_be_seen, |_| ());
        Look { samples: points.len(), found: detections.len(), known: self.map.len(), steady: self.steady().count(), attached: 0 }
    }

    #[inline(never)]
    fn attach(&self, estimator: &mut Micro) -> usize {
        let theta_m = self.settings.fit.theta_m;
        let plane_of = |_, point: &Vector3<f32>| {
            let id = self.map.supporting(point, theta_m, MARGIN_M)?;
            self.map.get(id).map(|known| known.plane)
        };
        estimator.attach_planes(plane_of)
    }
}
