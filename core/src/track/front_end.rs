//! Image in, observations out: predict, follow, verify, reject, replenish.

use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::detect::{Corner, DetectConfig, detect};
use super::flow::{FlowConfig, FlowWorkspace};
use super::observation::Observation;
use super::table::{Track, TrackTable};
use super::two_view::{BearingPair, TwoView, TwoViewConfig, reject_outliers};
use crate::camera::Camera;
use crate::image::{ImageView, MAX_LEVELS, PyramidError, PyramidPair};
use crate::real::Real;
use crate::storage::blank::blank;

/// How corners are found, followed and rejected. The defaults are for 752×480; see [`Self::for_image`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrontEndConfig {
    /// Tracks to aim for; the table's capacity bounds it. Default 200.
    pub target_tracks: usize,
    /// Detection runs when fewer than this share of `target_tracks` is left, in [0, 1]. Default 0.97,
    /// so that not every image pays for detection.
    pub detect_below_share: f32,
    /// Smallest distance between a new corner and any track, px. Default 20.
    pub min_distance_px: f32,
    /// Width of the cells, one new corner each, px. Default 28.
    pub cell_px: usize,
    /// Pyramid levels, 1 to 5. Default 4.
    pub levels: usize,
    /// Least corner score, (grey level/px)², see [`detect`](super::detect). Default 8.
    pub min_score: f32,
    /// Least corner score as a share of the best in the image. Default 0.005.
    pub min_relative_score: f32,
    /// Patch tracking.
    pub flow: FlowConfig,
    /// Levels of the backward check, 0 for none. Default 1.
    pub backward_levels: usize,
    /// Largest distance between a corner and its image tracked forward and back, px. Default 0.3.
    pub max_backward_px: f32,
    /// Outlier rejection.
    pub two_view: TwoViewConfig,
    /// Uncertainty of the given rotation between two images, rad per axis. Default 0.006: a gyro bias of 0.1 rad/s at 20 Hz.
    pub rotation_sigma_rad: f32,
    /// The same when no rotation is given, rad. Default 0.05.
    pub unknown_rotation_sigma_rad: f32,
}

blank!([] FrontEndConfig {
    target_tracks,
    detect_below_share,
    min_distance_px,
    cell_px,
    levels,
    min_score,
    min_relative_score,
    flow,
    backward_levels,
    max_backward_px,
    two_view,
    rotation_sigma_rad,
    unknown_rotation_sigma_rad,
});

impl FrontEndConfig {
    /// The defaults.
    pub const DEFAULT: Self = Self {
        target_tracks: 200,
        detect_below_share: 0.97,
        min_distance_px: 20.0,
        cell_px: 28,
        levels: 4,
        min_score: 8.0,
        min_relative_score: 0.005,
        flow: FlowConfig::DEFAULT,
        backward_levels: 1,
        max_backward_px: 0.3,
        two_view: TwoViewConfig::DEFAULT,
        rotation_sigma_rad: 0.006,
        unknown_rotation_sigma_rad: 0.05,
    };

    /// The defaults with distances for an image of this size and this many tracks: the cells hold twice as many corners as are wanted.
    #[must_use]
    pub fn for_image(width: usize, height: usize, target_tracks: usize) -> Self {
        let area = (width * height) as f32 / target_tracks.max(1) as f32;
        let cell_px = (Real::root(0.45 * area) as usize).clamp(8, super::detect::MAX_CELL_PX);
        Self { target_tracks, cell_px, min_distance_px: 0.7 * cell_px as f32, ..Self::DEFAULT }
    }
}

impl Default for FrontEndConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What became of the tracks in one image.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrontEndReport {
    /// Tracks of the previous image found in this one and kept.
    pub tracked: usize,
    /// Tracks not found, or not found again on the way back.
    pub lost: usize,
    /// Tracks found but contradicting the motion of the others.
    pub rejected: usize,
    /// Corners that are new in this image.
    pub detected: usize,
    /// The motion between the two images, when there is one to speak of.
    pub two_view: Option<TwoView>,
}

/// Follows at most `TRACKS` corners with patches of `PATCH × PATCH` samples (a multiple of 4 from 8 to 28).
#[derive(Debug, Clone)]
pub struct FrontEnd<const TRACKS: usize, const PATCH: usize = 16> {
    config: FrontEndConfig,
    table: TrackTable<TRACKS>,
    flow: FlowWorkspace<PATCH>,
    pairs: [BearingPair; TRACKS],
    corners: [Corner; TRACKS],
}

blank!([const TRACKS: usize, const PATCH: usize] FrontEnd<TRACKS, PATCH> { config, table, flow, pairs, corners });

impl<const TRACKS: usize, const PATCH: usize> FrontEnd<TRACKS, PATCH> {
    /// A front end without tracks; fit for a `static`.
    #[must_use]
    pub const fn new(config: FrontEndConfig) -> Self {
        let flow = FlowWorkspace::new(config.flow.window_fall);
        Self {
            config,
            table: TrackTable::new(),
            flow,
            pairs: [BearingPair::EMPTY; TRACKS],
            corners: [Corner { pixel: [0.0; 2], score: 0.0 }; TRACKS],
        }
    }

    /// Starts over with another configuration.
    pub(crate) fn configure(&mut self, config: FrontEndConfig) {
        self.config = config;
        self.table = TrackTable::new();
        self.flow.set_window(config.flow.window_fall);
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &FrontEndConfig {
        &self.config
    }

    /// The configuration, to be changed between images (for instance `rotation_sigma_rad` once the gyro bias is known).
    pub fn config_mut(&mut self) -> &mut FrontEndConfig {
        &mut self.config
    }

    /// Ends all tracks. Their ids are not used again.
    pub fn reset(&mut self) {
        self.table.clear();
    }

    /// The tracks, oldest first.
    #[must_use]
    pub fn tracks(&self) -> &[Track] {
        self.table.tracks()
    }

    /// What the estimator reads of the last image, oldest track first.
    pub fn observations<T: Real>(&self) -> impl ExactSizeIterator<Item = Observation<T>> + Clone + '_ {
        self.table.observations()
    }

    /// Ends the tracks for which `is_bad`, for instance those that the estimator found to be outliers.
    pub fn drop_tracks(&mut self, mut is_bad: impl FnMut(&Track) -> bool) {
        self.table.retain(|track| !is_bad(track));
    }

    /// Reads one image. `camera_rotation` is `current_from_previous` in the camera frame, from the gyro.
    ///
    /// The pyramids must be the same ones in every call. Tracks end when the size of the image changes.
    ///
    /// # Errors
    /// When the image does not fit into the pyramids; nothing has changed then.
    pub fn process<T: Real, C: Camera<T>, const BYTES: usize>(
        &mut self,
        image: &ImageView<'_>,
        pyramids: &mut PyramidPair<BYTES>,
        camera: &C,
        camera_rotation: Option<UnitQuaternion<T>>,
    ) -> Result<FrontEndReport, PyramidError> {
        pyramids.push(image, self.config.levels.clamp(1, MAX_LEVELS))?;
        let before = self.table.tracks().len();
        self.follow(pyramids, camera, camera_rotation);
        let found = self.table.tracks().len();
        let two_view = self.verify(camera, camera_rotation);
        let tracked = self.table.tracks().len();
        let detected = self.replenish(pyramids);
        Ok(FrontEndReport { tracked, lost: before - found, rejected: found - tracked, detected, two_view })
    }

    /// Moves every track to its place in the current image, or ends it.
    #[inline(never)]
    pub fn follow<T: Real, C: Camera<T>, const BYTES: usize>(
        &mut self,
        pyramids: &PyramidPair<BYTES>,
        camera: &C,
        camera_rotation: Option<UnitQuaternion<T>>,
    ) {
        let Self { config, table, flow, .. } = self;
        let levels = pyramids.common_levels();
        if levels == 0 {
            table.clear();
            return;
        }
        let forward = |level| Some((pyramids.previous(level)?, pyramids.current(level)?));
        let backward = |level| Some((pyramids.current(level)?, pyramids.previous(level)?));
        let limit = config.max_backward_px * config.max_backward_px;
        table.retain(|track| {
            let from = track.pixel;
            let predicted = camera_rotation.and_then(|rotation| predict(camera, &rotation, from)).unwrap_or(from);
            let Ok(found) = flow.track(&config.flow, levels, forward, from, predicted) else { return false };
            if config.backward_levels > 0 {
                // From the true start, so that most corners need two short steps only.
                let Ok(back) = flow.track(&config.flow, config.backward_levels.min(levels), backward, found, from) else {
                    return false;
                };
                let (dx, dy) = (back[0] - from[0], back[1] - from[1]);
                if dx * dx + dy * dy > limit {
                    return false;
                }
            }
            track.previous = from;
            track.pixel = found;
            track.age = track.age.saturating_add(1);
            true
        });
    }

    /// Ends the tracks that contradict the motion of the others.
    #[inline(never)]
    pub fn verify<T: Real, C: Camera<T>>(&mut self, camera: &C, camera_rotation: Option<UnitQuaternion<T>>) -> Option<TwoView> {
        let Self { config, table, pairs, .. } = self;
        let rotation = camera_rotation.unwrap_or_else(UnitQuaternion::identity);
        let mut count = 0;
        // A track without a bearing ends here.
        table.retain(|track| {
            let (Some(first), Some(second)) = (bearing(camera, track.previous), bearing(camera, track.pixel)) else { return false };
            let rotated = rotation * first;
            let Some(slot) = pairs.get_mut(count) else { return false };
            *slot = BearingPair { rotated: rotated.map(Real::as_f32), current: second.map(Real::as_f32), is_inlier: true };
            count += 1;
            true
        });
        let sigma = if camera_rotation.is_some() { config.rotation_sigma_rad } else { config.unknown_rotation_sigma_rad };
        let pairs = pairs.get_mut(..count)?;
        let two_view = reject_outliers(pairs, &config.two_view, camera.focal_px().as_f32(), sigma)?;
        let mut flags = pairs.iter();
        table.retain(|_| flags.next().is_some_and(|pair| pair.is_inlier));
        Some(two_view)
    }

    /// Starts tracks where there are none, and returns how many.
    #[inline(never)]
    pub fn replenish<const BYTES: usize>(&mut self, pyramids: &PyramidPair<BYTES>) -> usize {
        let Self { config, table, corners, .. } = self;
        let target = config.target_tracks.min(TRACKS);
        let count = table.tracks().len();
        if count >= target || count as f32 > config.detect_below_share * target as f32 {
            return 0;
        }
        let Some(level) = pyramids.current(0) else { return 0 };
        let detect_config = DetectConfig {
            cell_px: config.cell_px,
            min_distance_px: config.min_distance_px,
            border_px: PATCH / 2 + 4,
            min_score: config.min_score,
            min_relative_score: config.min_relative_score,
        };
        let occupied = table.tracks().iter().map(|track| track.pixel);
        let found = detect(&level, &detect_config, occupied, target - count, corners);
        corners.iter().take(found).filter(|corner| table.start(corner.pixel).is_some()).count()
    }
}

fn bearing<T: Real, C: Camera<T>>(camera: &C, pixel: [f32; 2]) -> Option<Vector3<T>> {
    camera.unproject(&Vector2::new(T::of(f64::from(pixel[0])), T::of(f64::from(pixel[1]))))
}

/// Where a distant point would be after the rotation.
fn predict<T: Real, C: Camera<T>>(camera: &C, rotation: &UnitQuaternion<T>, pixel: [f32; 2]) -> Option<[f32; 2]> {
    let pixel = camera.project(&(rotation * bearing(camera, pixel)?))?;
    Some([pixel.x.as_f32(), pixel.y.as_f32()])
}
