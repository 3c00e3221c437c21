//! Corner tracks of a camera that flies through a room.
//!
//! A track begins at a random pixel: the ray through it meets the room in a landmark, which is then followed by projection. It
//! ends when the landmark leaves the image, is hidden by something, is seen too obliquely, or when its random lifetime is over,
//! as real trackers lose corners; new tracks keep the number up. Each observation carries independent Gaussian noise; a share of
//! them are outliers.

use libella_core::camera::{Camera, CameraModel};
use libella_core::track::{Observation, TrackId};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};

use super::SimError;
use super::random::Random;
use super::scene::Scene;

/// How tracks are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeatureConfig {
    /// Tracks to keep up per image; 8 to 2000.
    pub count: usize,
    /// Standard deviation of each coordinate of an observation, px; 0 to 10.
    pub sigma_px: f64,
    /// Mean of the random lifetime, s; 0.1 to 1000. Leaving the image and hiding shorten it.
    pub mean_track_s: f64,
    /// Share of observations that are displaced by up to 30 px; 0 to 0.5.
    pub outlier_share: f64,
    /// Least distance between a new track and the others, px; 0 to 100.
    pub spacing_px: f64,
    /// Width of the rim of the image without tracks, px; 0 to 100.
    pub border_px: f64,
}

impl Default for FeatureConfig {
    fn default() -> Self {
        Self { count: 150, sigma_px: 1.0, mean_track_s: 2.5, outlier_share: 0.01, spacing_px: 20.0, border_px: 8.0 }
    }
}

impl FeatureConfig {
    fn check(&self) -> Result<(), SimError> {
        SimError::check("features.count", self.count as f64, 8.0, 2000.0)?;
        SimError::check("features.sigma_px", self.sigma_px, 0.0, 10.0)?;
        SimError::check("features.mean_track_s", self.mean_track_s, 0.1, 1000.0)?;
        SimError::check("features.outlier_share", self.outlier_share, 0.0, 0.5)?;
        SimError::check("features.spacing_px", self.spacing_px, 0.0, 100.0)?;
        SimError::check("features.border_px", self.border_px, 0.0, 100.0)
    }
}

/// Cosine of the most oblique view at which a corner is still recognised: 75 degrees off the normal.
const LEAST_COSINE: f64 = 0.26;
/// A landmark nearer than this is out of focus, m.
const NEAREST_M: f64 = 0.25;

#[derive(Debug, Clone)]
struct Track {
    id: TrackId,
    landmark: Vector3<f64>,
    normal: Vector3<f64>,
    pixel: Vector2<f64>,
    dies_at_s: f64,
}

/// The simulated front end of one camera.
#[derive(Debug, Clone)]
pub struct Tracker<'a> {
    scene: &'a Scene,
    camera: CameraModel<f64>,
    config: FeatureConfig,
    random: Random,
    tracks: Vec<Track>,
    landmarks: Vec<Vector3<f64>>,
    /// Cosine of the widest angle that the image shows.
    least_axis_cosine: f64,
}

impl<'a> Tracker<'a> {
    /// A tracker that has seen nothing yet.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn new(scene: &'a Scene, camera: CameraModel<f64>, config: &FeatureConfig, seed: u64) -> Result<Self, SimError> {
        config.check()?;
        let (width, height) = camera.size_px();
        let (right, bottom) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
        let least_axis_cosine = [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)]
            .iter()
            .filter_map(|(x, y)| camera.unproject(&Vector2::new(*x, *y)))
            .map(|bearing| bearing.z)
            .fold(1.0, f64::min);
        Ok(Self {
            scene,
            camera,
            config: *config,
            random: Random::new(seed, "features"),
            tracks: Vec::new(),
            landmarks: Vec::new(),
            least_axis_cosine,
        })
    }

    /// The landmarks of all tracks so far, m in world, by track id.
    #[must_use]
    pub fn landmarks(&self) -> &[Vector3<f64>] {
        &self.landmarks
    }

    /// What the camera sees from a pose at a time.
    pub fn observe(&mut self, seconds: f64, world_from_camera: &Isometry3<f64>) -> Vec<Observation<f64>> {
        let mut tracks = std::mem::take(&mut self.tracks);
        tracks.retain_mut(|track| match self.see(&track.landmark, &track.normal, world_from_camera) {
            Some(pixel) if seconds < track.dies_at_s => {
                track.pixel = pixel;
                true
            }
            _ => false,
        });
        self.tracks = tracks;
        for _ in 0..self.config.count * 20 {
            if self.tracks.len() >= self.config.count {
                break;
            }
            self.try_to_start(seconds, world_from_camera);
        }
        let (sigma, share) = (self.config.sigma_px, self.config.outlier_share);
        let random = &mut self.random;
        self.tracks
            .iter()
            .map(|track| {
                let noise = Vector2::new(random.normal(), random.normal()) * sigma;
                let gross = if random.unit() < share {
                    Vector2::new(random.between(-30.0, 30.0), random.between(-30.0, 30.0))
                } else {
                    Vector2::zeros()
                };
                Observation { track: track.id, pixel: track.pixel + noise + gross }
            })
            .collect()
    }

    /// The exact pixel of a landmark, if it can be seen.
    fn see(&self, landmark: &Vector3<f64>, normal: &Vector3<f64>, world_from_camera: &Isometry3<f64>) -> Option<Vector2<f64>> {
        let point_in_camera = world_from_camera.inverse_transform_point(&Point3::from(*landmark)).coords;
        let distance = point_in_camera.norm();
        if distance < NEAREST_M || point_in_camera.z < self.least_axis_cosine * distance {
            return None;
        }
        let eye = world_from_camera.translation.vector;
        if normal.dot(&(eye - landmark)) < LEAST_COSINE * distance {
            return None;
        }
        let pixel = self.camera.project(&point_in_camera)?;
        // A thousandth of the way keeps the landmark's own surface out of the test.
        (self.is_inside(&pixel) && self.scene.is_clear(&eye, landmark, 1e-3)).then_some(pixel)
    }

    fn is_inside(&self, pixel: &Vector2<f64>) -> bool {
        let (width, height) = self.camera.size_px();
        let border = self.config.border_px;
        let fits = |x: f64, size: u32| x >= border && x <= f64::from(size) - 1.0 - border;
        fits(pixel.x, width) && fits(pixel.y, height)
    }

    fn try_to_start(&mut self, seconds: f64, world_from_camera: &Isometry3<f64>) {
        let (width, height) = self.camera.size_px();
        let border = self.config.border_px;
        let pixel = Vector2::new(
            self.random.between(border, f64::from(width) - 1.0 - border),
            self.random.between(border, f64::from(height) - 1.0 - border),
        );
        let taste = self.random.unit();
        let lifetime_s = self.random.exponential(self.config.mean_track_s);
        if self.tracks.iter().any(|track| (track.pixel - pixel).norm() < self.config.spacing_px) {
            return;
        }
        let Some(bearing) = self.camera.unproject(&pixel) else { return };
        let eye = world_from_camera.translation.vector;
        let direction = world_from_camera.rotation * bearing;
        let Some(hit) = self.scene.cast(&eye, &direction) else { return };
        let Some(quad) = self.scene.quads.get(hit.quad) else { return };
        let landmark = eye + direction * hit.distance;
        if taste > quad.material.richness() || self.see(&landmark, &quad.normal, world_from_camera).is_none() {
            return;
        }
        let id = TrackId(u32::try_from(self.landmarks.len()).unwrap_or(u32::MAX));
        self.landmarks.push(landmark);
        self.tracks.push(Track { id, landmark, normal: quad.normal, pixel, dies_at_s: seconds + lifetime_s });
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::sim::{SimulationConfig, euroc, simulate_with_landmarks};

    fn quiet() -> SimulationConfig {
        let features = FeatureConfig { sigma_px: 0.0, outlier_share: 0.0, ..FeatureConfig::default() };
        SimulationConfig { features, ..SimulationConfig::default() }
    }

    #[test]
    fn noise_free_observations_reproject_exactly() {
        let (recording, landmarks) = simulate_with_landmarks(&quiet(), 2).unwrap();
        let camera = euroc::camera(0);
        let mut seen = 0;
        for frame in &recording.frames {
            let truth = recording.truth.iter().find(|truth| truth.stamp == frame.stamp).unwrap();
            let camera_from_world = (truth.state.pose() * recording.body_from_camera).inverse();
            for observation in &frame.observations {
                let landmark = landmarks[observation.track.0 as usize];
                let pixel = camera.project(&camera_from_world.transform_point(&landmark.into()).coords).unwrap();
                assert!((pixel - observation.pixel).norm() < 1e-6, "{pixel} {}", observation.pixel);
                seen += 1;
            }
        }
        assert!(seen > 100_000);
    }

    #[test]
    fn noise_has_the_sigma_and_the_share_of_outliers_it_states() {
        let features = FeatureConfig { sigma_px: 1.0, outlier_share: 0.05, ..FeatureConfig::default() };
        let (recording, landmarks) = simulate_with_landmarks(&SimulationConfig { features, ..SimulationConfig::default() }, 2).unwrap();
        let camera = euroc::camera(0);
        let (mut squares, mut inliers, mut outliers) = (0.0, 0, 0);
        for frame in recording.frames.iter().step_by(5) {
            let truth = recording.truth.iter().find(|truth| truth.stamp == frame.stamp).unwrap();
            let camera_from_world = (truth.state.pose() * recording.body_from_camera).inverse();
            for observation in &frame.observations {
                let landmark = landmarks[observation.track.0 as usize];
                let pixel = camera.project(&camera_from_world.transform_point(&landmark.into()).coords).unwrap();
                let error = pixel - observation.pixel;
                if error.norm() > 5.0 {
                    outliers += 1;
                } else {
                    inliers += 1;
                    squares += error.norm_squared();
                }
            }
        }
        // Outliers within 5 px (2 %) count as inliers and add 2 % · 5 % · 13 px² or so to the variance.
        let sigma = (squares / (2.0 * f64::from(inliers))).sqrt();
        let share = f64::from(outliers) / f64::from(outliers + inliers);
        assert!((sigma - 1.0).abs() < 0.02, "{sigma}");
        assert!((share - 0.049).abs() < 0.004, "{share}");
    }

    #[test]
    fn tracks_are_continuous_and_of_realistic_length() {
        let (recording, _) = simulate_with_landmarks(&quiet(), 5).unwrap();
        let mut spans: HashMap<TrackId, (usize, usize, usize)> = HashMap::new();
        for (index, frame) in recording.frames.iter().enumerate() {
            assert!(frame.observations.len() > 100, "{} tracks in image {index}", frame.observations.len());
            for observation in &frame.observations {
                let span = spans.entry(observation.track).or_insert((index, index, 0));
                span.1 = index;
                span.2 += 1;
            }
        }
        assert!(spans.values().all(|(first, last, count)| last - first + 1 == *count), "an id came back after a gap");
        let mean_s = spans.values().map(|span| span.2 as f64).sum::<f64>() / spans.len() as f64 / 20.0;
        assert!((0.8..2.6).contains(&mean_s), "{mean_s} s");
    }

    #[test]
    fn refuses_noise_out_of_range() {
        let features = FeatureConfig { sigma_px: -1.0, ..FeatureConfig::default() };
        let config = SimulationConfig { features, ..SimulationConfig::default() };
        let message = simulate_with_landmarks(&config, 1).unwrap_err().to_string();
        assert!(message.contains("sigma_px = -1") && message.contains("0 to 10"), "{message}");
    }
}
