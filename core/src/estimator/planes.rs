//! Landmarks that lie on known planes.

use nalgebra::Vector3;

use super::Estimator;
use crate::factor::point_on_plane::PlaneTerm;
use crate::plane::Plane;
use crate::real::Real;
use crate::track::TrackId;

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// Tells which plane each landmark lies on: `plane_of` is asked once for every landmark with a depth, with its point in world, m.
    ///
    /// A plane is fixed in the solutions that follow; a landmark nearer to it than `theta_m` of [`PlaneConfig`](super::PlaneConfig) is
    /// drawn to it, the others are on no plane. Returns how many are on one.
    pub fn attach_planes(&mut self, plane_of: impl Fn(TrackId, &Vector3<T>) -> Option<Plane<T>>) -> usize {
        let config = &self.config.planes;
        let inverse_sigma = config.weight.root() / config.sigma_m;
        self.workspace.geometry.update_camera_poses(&self.window.frames, &self.settings);
        let poses = &self.workspace.geometry.camera_poses[..self.window.frames.len()];
        let origin = self.window.origin_in_world;
        let mut attached = 0;
        for landmark in &mut self.window.landmarks {
            landmark.plane = PlaneTerm::NONE;
            let Some(point) = landmark.position_in_world(poses).map(|point| point + origin) else { continue };
            let Some(plane) = plane_of(landmark.track, &point).filter(|plane| plane.distance_m(&point).abs() < config.theta_m) else {
                continue;
            };
            let normal = plane.normal_in_world.into_inner();
            landmark.plane = PlaneTerm { normal_in_world: normal.into(), offset_m: plane.offset_m + normal.dot(&origin), inverse_sigma };
            attached += 1;
        }
        attached
    }

    /// The points of the landmarks with a depth, in world, m, with the tracks that see them.
    pub fn points_in_world(&mut self) -> impl Iterator<Item = (TrackId, Vector3<T>)> {
        self.workspace.geometry.update_camera_poses(&self.window.frames, &self.settings);
        let poses = &self.workspace.geometry.camera_poses[..self.window.frames.len()];
        let origin = self.window.origin_in_world;
        self.window.landmarks.iter().filter_map(move |landmark| Some((landmark.track, landmark.position_in_world(poses)? + origin)))
    }
}
