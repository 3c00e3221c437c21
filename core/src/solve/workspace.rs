//! Memory that one solution needs, reused from image to image.

use nalgebra::{Isometry3, SMatrix, Vector3};

use crate::factor::imu;
use crate::factor::reprojection::{self, CameraMount, PairGeometry, ReprojectionLinearization};
use crate::imu::NavState;
use crate::real::Real;
use crate::robust::kernel::Kernel;
use crate::storage::blocks::{Block, pairs, zero_block};
use crate::window::{CameraPose, Frame, NormalizedPoint, Window};

/// What the factors have in common.
#[derive(Debug, Clone, Copy)]
pub struct Settings<T: Real> {
    /// `g_W`, m/s².
    pub gravity_in_world: Vector3<T>,
    /// `T_BC`.
    pub body_from_camera: Isometry3<T>,
    /// The same, as the Jacobians need it.
    pub mount: CameraMount<T>,
    /// Cost of a whitened observation.
    pub kernel: Kernel<T>,
    /// Standard deviation of the velocity of a body found at rest, m/s.
    pub rest_sigma_m_s: T,
    /// Squared whitened residual charged for a landmark behind a camera that sees it.
    pub behind_camera_cost: T,
}

/// Where the cameras of a window are, currently and at the first estimates.
#[derive(Debug)]
pub struct Geometry<T: Real, const FRAMES: usize> {
    /// `pairs[anchor][target]` at the current states.
    pub pairs: [[PairGeometry<T>; FRAMES]; FRAMES],
    /// The same at the first estimates.
    pub first_pairs: [[PairGeometry<T>; FRAMES]; FRAMES],
    /// Camera poses at the current states.
    pub camera_poses: [CameraPose<T>; FRAMES],
    /// Camera poses at the first estimates.
    pub first_camera_poses: [CameraPose<T>; FRAMES],
}

/// Normal equations and geometry of one window.
#[derive(Debug)]
pub struct Workspace<T: Real, const FRAMES: usize, const PAIRS: usize> {
    /// Lower block triangle of `H`, later of its Cholesky factor.
    pub hessian: [Block<T, 15>; PAIRS],
    /// `b = Jᵀ r`.
    pub gradient: [[T; 15]; FRAMES],
    /// The solved step of the frames.
    pub step: [[T; 15]; FRAMES],
    /// Cameras.
    pub geometry: Geometry<T, FRAMES>,
    /// Square-root information of the inertial factor that ends in each frame.
    pub imu_square_roots: [Option<SMatrix<T, 15, 15>>; FRAMES],
    /// States to go back to when a step is refused.
    pub saved: [NavState<T>; FRAMES],
}

impl<T: Real, const FRAMES: usize> Default for Geometry<T, FRAMES> {
    fn default() -> Self {
        Self {
            pairs: [[PairGeometry::default(); FRAMES]; FRAMES],
            first_pairs: [[PairGeometry::default(); FRAMES]; FRAMES],
            camera_poses: [CameraPose::default(); FRAMES],
            first_camera_poses: [CameraPose::default(); FRAMES],
        }
    }
}

impl<T: Real, const FRAMES: usize> Geometry<T, FRAMES> {
    /// Camera poses of all frames at their current states.
    pub fn update_camera_poses(&mut self, frames: &[Frame<T>], settings: &Settings<T>) {
        for (frame, pose) in frames.iter().zip(&mut self.camera_poses) {
            *pose = CameraPose::of(&frame.state, &settings.body_from_camera);
        }
    }

    /// Camera poses and pairs, currently and where Jacobians are evaluated.
    pub fn update(&mut self, frames: &[Frame<T>], settings: &Settings<T>) {
        self.update_camera_poses(frames, settings);
        fill_pairs(&mut self.pairs, &self.camera_poses[..frames.len()]);
        for ((frame, pose), current) in frames.iter().zip(&mut self.first_camera_poses).zip(&self.camera_poses) {
            *pose = frame.linearization.as_ref().map_or(*current, |first| CameraPose::of(first, &settings.body_from_camera));
        }
        fill_pairs(&mut self.first_pairs, &self.first_camera_poses[..frames.len()]);
    }

    /// One observation, linearised.
    #[inline]
    pub fn linearize(
        &self,
        settings: &Settings<T>,
        anchor: usize,
        target: usize,
        direction: &Vector3<T>,
        inverse_depth: T,
        point: &NormalizedPoint<T>,
    ) -> Option<ReprojectionLinearization<T>> {
        reprojection::linearize(
            &settings.mount,
            &self.pairs[anchor][target],
            &self.first_pairs[anchor][target],
            &self.first_camera_poses[target],
            direction,
            inverse_depth,
            point,
        )
    }
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Default for Workspace<T, FRAMES, PAIRS> {
    fn default() -> Self {
        const { assert!(PAIRS == pairs(FRAMES), "PAIRS must be FRAMES (FRAMES + 1) / 2") };
        Self {
            hessian: [zero_block(); PAIRS],
            gradient: [[T::ZERO; 15]; FRAMES],
            step: [[T::ZERO; 15]; FRAMES],
            geometry: Geometry::default(),
            imu_square_roots: [None; FRAMES],
            saved: [NavState::origin(); FRAMES],
        }
    }
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Workspace<T, FRAMES, PAIRS> {
    /// Zeroes the normal equations of `frames` frames.
    pub fn clear(&mut self, frames: usize) {
        self.hessian[..pairs(frames)].fill(zero_block());
        self.gradient[..frames].fill([T::ZERO; 15]);
    }

    /// Geometry, and the weights of the inertial factors; once per solution.
    pub fn prepare<const POINTS: usize>(&mut self, window: &Window<T, FRAMES, POINTS>, settings: &Settings<T>) {
        for (i, frame) in window.frames.iter().enumerate() {
            self.imu_square_roots[i] = if i == 0 { None } else { imu::sqrt_information(&frame.from_previous) };
        }
        self.geometry.update(&window.frames, settings);
    }
}

fn fill_pairs<T: Real, const FRAMES: usize>(pairs: &mut [[PairGeometry<T>; FRAMES]; FRAMES], poses: &[CameraPose<T>]) {
    for (i, anchor) in poses.iter().enumerate() {
        // A landmark's anchor is the oldest frame that sees it: later frames are the targets.
        for (target, pair) in poses.iter().zip(&mut pairs[i]).skip(i + 1) {
            *pair = PairGeometry::new(target, anchor);
        }
    }
}
