//! Planes as unknowns: which landmarks lie on them, and their part of the normal equations.
//!
//! # Model
//! Gravity leaves a floor one freedom, its offset, and a wall a second one, its heading about the vertical through its middle `m`:
//! ```text
//! r = √β/σ (nᵀx + d)      ∂r/∂x = √β/σ n      ∂r/∂d = √β/σ      ∂r/∂ψ = √β/σ (z × n)ᵀ(x − m)
//! ```
//! What a plane tells is that its landmarks are on one, not where it is. Held where the causal pass has found it, it would hold the scale and
//! the drift of that pass too: rendered V1_01 0.0230 m with planes and 0.0166 m without.

use libella_core::plane::Plane;
use nalgebra::{Matrix2, Rotation3, SMatrix, UnitVector3, Vector2, Vector3};

use super::sparse::Pose;
use super::{Bundle, BundleSettings, Landmark};

/// A normal this far from the horizontal, as the sine of the angle, is not that of a wall.
const WALL: f64 = 0.1;
/// Weight of a plane's step, 1/m² and 1/rad²: keeps what no landmark tells of where it is. The cost is unchanged.
const STEP_WEIGHT: f64 = 1.0;

/// A plane and the middle of its landmarks, about which it turns.
#[derive(Debug, Clone, Copy)]
pub(super) struct FreePlane {
    pub plane: Plane<f64>,
    middle: Vector3<f64>,
}

/// A landmark's distance from its plane, whitened, and its slopes.
pub(super) struct PlaneRow {
    pub residual: f64,
    pub by_point: Vector3<f64>,
    pub by_plane: Vector2<f64>,
}

/// What `(d, ψ)` of a plane has to do with a landmark.
pub(super) type PlaneCoupling = SMatrix<f64, 2, 3>;
/// And with a pose.
pub(super) type PlaneByPose = SMatrix<f64, 2, 6>;

/// The rows of the planes in the reduced normal equations.
pub(super) struct PlaneBlocks {
    /// `H(p, p)`.
    pub own: Vec<Matrix2<f64>>,
    /// `H(p, i)`, all keyframes of the first plane, then those of the second.
    by_pose: Vec<PlaneByPose>,
    keyframes: usize,
    pub gradient: Vec<Vector2<f64>>,
}

impl FreePlane {
    pub fn new(plane: Plane<f64>) -> Self {
        Self { plane, middle: plane.normal_in_world.into_inner() * -plane.offset_m }
    }

    pub fn row(&self, at: &Vector3<f64>, settings: &BundleSettings) -> PlaneRow {
        let scale = settings.plane_weight.sqrt() / settings.plane_sigma_m;
        let normal = self.plane.normal_in_world.into_inner();
        let turn = if self.is_wall() { Vector3::z().cross(&normal).dot(&(at - self.middle)) } else { 0.0 };
        PlaneRow { residual: self.plane.distance_m(at) * scale, by_point: normal * scale, by_plane: Vector2::new(1.0, turn) * scale }
    }

    /// Moves by `(δd, δψ)`.
    pub fn retract(&mut self, [shift_m, turn_rad]: [f64; 2]) {
        let distance_m = self.plane.distance_m(&self.middle) + shift_m;
        if self.is_wall() {
            let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), turn_rad) * self.plane.normal_in_world.into_inner();
            self.plane.normal_in_world = UnitVector3::new_normalize(turned);
        }
        self.plane.offset_m = distance_m - self.plane.normal_in_world.dot(&self.middle);
    }

    fn is_wall(&self) -> bool {
        self.plane.normal_in_world.z.abs() < WALL
    }
}

impl PlaneBlocks {
    /// Before landmarks are eliminated, damped; with the diagonal that belongs to the step.
    pub fn new(keyframes: usize, planes: &[(Matrix2<f64>, Vector2<f64>)], damping: f64) -> (Self, Vec<Vector2<f64>>) {
        let diagonals: Vec<_> = planes.iter().map(|(own, _)| (own.diagonal() * damping).add_scalar(STEP_WEIGHT)).collect();
        let blocks = Self {
            own: planes.iter().zip(&diagonals).map(|((own, _), more)| own + Matrix2::from_diagonal(more)).collect(),
            by_pose: vec![PlaneByPose::zeros(); keyframes * planes.len()],
            keyframes,
            gradient: planes.iter().map(|(_, gradient)| *gradient).collect(),
        };
        (blocks, diagonals)
    }

    /// `H(p, i)`.
    pub fn by_pose_mut(&mut self, plane: usize, keyframe: usize) -> &mut PlaneByPose {
        &mut self.by_pose[plane * self.keyframes + keyframe]
    }

    /// `H(p, i)` of one keyframe and every plane.
    pub fn of_keyframe(&self, keyframe: usize) -> impl Iterator<Item = &PlaneByPose> {
        self.by_pose.iter().skip(keyframe).step_by(self.keyframes)
    }

    /// From motions of the cameras to those of the bodies.
    pub fn turn_to_bodies(&mut self, camera_by_body: &[Pose]) {
        for (block, by_body) in self.by_pose.iter_mut().zip(camera_by_body.iter().cycle()) {
            *block *= by_body;
        }
    }
}

impl Bundle {
    /// Puts every landmark that takes part on the nearest plane, where one is near enough.
    pub fn attach_planes(&mut self) {
        let theta_m = self.settings.plane_theta_m;
        let mut on = vec![(0.0, Vector3::zeros()); self.planes.len()];
        for landmark in &mut self.landmarks {
            landmark.plane = nearest(landmark, &self.planes, theta_m);
            if let Some((count, sum)) = landmark.plane.and_then(|plane| on.get_mut(plane)) {
                *count += 1.0;
                *sum += landmark.position_in_world;
            }
        }
        for (plane, (count, sum)) in self.planes.iter_mut().zip(on) {
            if count > 0.0 {
                plane.middle = sum / count;
            }
        }
    }
}

fn nearest(landmark: &Landmark, planes: &[FreePlane], theta_m: f64) -> Option<usize> {
    let distances = planes.iter().map(|free| free.plane.distance_m(&landmark.position_in_world).abs()).enumerate();
    let near = distances.filter(|(_, distance)| landmark.used && *distance < theta_m);
    near.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(plane, _)| plane)
}
