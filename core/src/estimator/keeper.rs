//! The planes of the room, kept for an estimator by whoever has no thread to spare: sought now and then among the landmarks, kept by
//! name, and told to the estimator.
//!
//! What a search costs is bounded by its samples; a host that has the memory seeks among more points than the window holds instead.

use core::num::NonZeroU32;

use nalgebra::Vector3;

use super::{Estimator, FrameOutcome};
use crate::plane::associate::AssociateConfig;
use crate::plane::fit::FitConfig;
use crate::plane::{Detections, PlaneId, PlaneMap, Sample, Samples, Source, TrackedPlane};
use crate::real::Real;
use crate::robust::ransac::Generator;
use crate::time::Timestamp;

/// A landmark belongs to a plane up to this far outside of its polygon, m.
const MARGIN_M: f64 = 0.1;
/// Landmarks this near to a plane that was not found speak of a plane that ought to have been, m.
const ABOUT_M: f64 = 0.3;

/// When planes are sought and believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeeperConfig<T: Real> {
    /// Images with a pose between one look and the next.
    pub every: NonZeroU32,
    /// What makes a plane.
    pub fit: FitConfig<T>,
    /// When it is the same, and steady.
    pub associate: AssociateConfig<T>,
}

impl<T: Real> Default for KeeperConfig<T> {
    fn default() -> Self {
        Self { every: const { NonZeroU32::MIN.saturating_add(29) }, fit: FitConfig::default(), associate: AssociateConfig::default() }
    }
}

impl<T: Real> KeeperConfig<T> {
    /// For images of 160×120, where a landmark is known to a decimetre or two, not to the centimetres of [`FitConfig`]'s default: with
    /// those no plane is found in most flights.
    ///
    /// Measured on seven flights at 160×120 (the firmware's `accuracy`), geometric mean of the ATE: 0.161 m without planes, 0.144 m with these.
    /// Neighbouring settings scatter between 0.138 and 0.168 m: slabs of 0.1 or 0.2 m, a look every 10 images, steady after 6 or 9 looks,
    /// planes that follow their landmarks as those of a host do.
    #[must_use]
    pub fn small_images() -> Self {
        let fit = FitConfig { theta_m: T::of(0.15), least_inliers: 10, ..FitConfig::default() };
        Self { fit, ..Self::default() }
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

/// Up to `PLANES` planes with polygons of `CORNERS`, sought among up to `SAMPLES` landmarks.
#[derive(Debug, Clone)]
pub struct PlaneKeeper<T: Real, const PLANES: usize, const CORNERS: usize, const SAMPLES: usize> {
    config: KeeperConfig<T>,
    map: PlaneMap<T, PLANES, CORNERS>,
    images: u32,
    looks: u64,
}

impl<T: Real, const PLANES: usize, const CORNERS: usize, const SAMPLES: usize> PlaneKeeper<T, PLANES, CORNERS, SAMPLES> {
    /// None yet.
    #[must_use]
    pub fn new(config: KeeperConfig<T>) -> Self {
        Self { config, map: PlaneMap::new(), images: 0, looks: 0 }
    }

    /// Starts anew.
    pub fn forget(&mut self) {
        (self.map, self.images) = (PlaneMap::new(), 0);
    }

    /// The planes fit for use, with names that stay.
    pub fn steady(&self) -> impl Iterator<Item = (PlaneId, &TrackedPlane<T, CORNERS>)> {
        self.map.steady()
    }

    /// After an image's step: a look where one is due, and the landmarks' planes for the next solution. Planes of a world that was
    /// lost are forgotten.
    pub fn after_image<const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const IMU: usize>(
        &mut self,
        stamp: Timestamp,
        outcome: FrameOutcome,
        estimator: &mut Estimator<T, FRAMES, PAIRS, POINTS, IMU>,
    ) -> Option<Look> {
        if matches!(outcome, FrameOutcome::Initialised | FrameOutcome::Lost) {
            self.forget();
        }
        estimator.state()?;
        self.images += 1;
        let look = (self.images % self.config.every == 0).then(|| self.look(stamp, estimator));
        let attached = self.attach(estimator);
        look.map(|look| Look { attached, ..look })
    }

    /// Seeks planes among the landmarks. Scratch of a few kilobytes, on the stack while nothing else is.
    #[inline(never)]
    fn look<const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const IMU: usize>(
        &mut self,
        now: Timestamp,
        estimator: &mut Estimator<T, FRAMES, PAIRS, POINTS, IMU>,
    ) -> Look {
        let KeeperConfig { fit, associate, .. } = &self.config;
        let viewer_in_world = estimator.state().map_or_else(Vector3::zeros, |estimate| estimate.state.position_in_world);
        let mut samples = Samples::<T, SAMPLES>::new(&Vector3::z_axis(), fit.normal_tolerance_rad);
        let mut points = [Vector3::zeros(); SAMPLES];
        for (_, point_in_world) in estimator.points_in_world() {
            // What is too far away or too many is left out.
            if samples.push(&Sample { point_in_world, normal_in_world: None, source: Source::MapPoint }).is_ok()
                && let Some(place) = points.get_mut(samples.len() - 1)
            {
                *place = point_in_world;
            }
        }
        let points = points.get(..samples.len()).unwrap_or_default();
        let main_wall = self.map.main_wall().map(|(_, wall)| wall.plane.normal_in_world);
        let mut detections = Detections::<T, PLANES, CORNERS>::default();
        detections.detect(&mut samples, main_wall.as_ref(), fit, &mut Generator::new(self.looks));
        self.looks += 1;
        let should_be_seen = |plane: &TrackedPlane<T, CORNERS>| {
            points.iter().filter(|point| plane.supports(point, T::of(ABOUT_M), T::of(MARGIN_M))).count() >= fit.least_inliers
        };
        self.map.update(&detections, now, &viewer_in_world, associate, should_be_seen, |_| ());
        Look { samples: points.len(), found: detections.len(), known: self.map.len(), steady: self.steady().count(), attached: 0 }
    }

    #[inline(never)]
    fn attach<const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const IMU: usize>(
        &self,
        estimator: &mut Estimator<T, FRAMES, PAIRS, POINTS, IMU>,
    ) -> usize {
        let theta_m = self.config.fit.theta_m;
        let plane_of = |_, point: &Vector3<T>| {
            let id = self.map.supporting(point, theta_m, T::of(MARGIN_M))?;
            self.map.get(id).map(|known| known.plane)
        };
        estimator.attach_planes(plane_of)
    }
}
