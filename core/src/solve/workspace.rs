//! Memory that one solution needs, reused from image to image.

use nalgebra::{Isometry3, SMatrix, Vector2, Vector3};

use super::marginalize::fits as marginalization_fits;
use super::normal::NormalEquations;
use crate::factor::imu;
use crate::factor::point_on_plane::PlaneLinearization;
use crate::factor::reprojection::{self, CameraMount, PairGeometry, ReprojectionLinearization};
use crate::imu::{ImuBias, NavState};
use crate::real::Real;
use crate::robust::kernel::Kernel;
use crate::storage::blank::{Blank, blank};
use crate::storage::blocks::{pairs, place};
use crate::time::{Span, Timestamp};
use crate::window::{CameraPose, DepthKnowledge, DepthPrior, DepthSource, Frame, Landmark, NormalizedPoint, Window};

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
    /// Of every landmark.
    pub depth_prior: DepthPrior<T>,
    /// The same while motion has not told the depth yet.
    pub guessed_depth_prior: DepthPrior<T>,
    /// Standard deviation of the velocity of a body found at rest, m/s.
    pub rest_sigma_m_s: T,
    /// Noise of the position beside that of the inertial samples, m.
    pub position_jitter_m: T,
    /// Squared whitened residual charged for a landmark behind a camera that sees it.
    pub behind_camera_cost: T,
}

blank!([T: Real] Settings<T> {
    gravity_in_world,
    body_from_camera,
    mount,
    kernel,
    depth_prior,
    guessed_depth_prior,
    rest_sigma_m_s,
    position_jitter_m,
    behind_camera_cost,
});

impl<T: Real> Settings<T> {
    /// What is known beforehand of the inverse depth of `landmark`.
    #[inline(always)]
    #[must_use]
    pub fn prior_on<const FRAMES: usize>(&self, landmark: &Landmark<T, FRAMES>) -> DepthKnowledge<T> {
        match landmark.depth_source {
            DepthSource::Usual => DepthKnowledge::Usual(self.depth_prior),
            DepthSource::Guessed => DepthKnowledge::Usual(self.guessed_depth_prior),
            DepthSource::Given => DepthKnowledge::Given(landmark.given),
        }
    }
}

/// Where the cameras of a window are, currently and at the first estimates.
#[derive(Debug)]
pub struct Geometry<T: Real, const FRAMES: usize, const PAIRS: usize> {
    /// Pairs at the current states, `anchor < target` at `place(target, anchor)`.
    pub pairs: [PairGeometry<T>; PAIRS],
    /// The same at the first estimates.
    pub first_pairs: [PairGeometry<T>; PAIRS],
    /// Camera poses at the current states.
    pub camera_poses: [CameraPose<T>; FRAMES],
    /// Camera poses at the first estimates.
    pub first_camera_poses: [CameraPose<T>; FRAMES],
}

blank!([T: Real, const FRAMES: usize, const PAIRS: usize] Geometry<T, FRAMES, PAIRS> {
    pairs, first_pairs, camera_poses, first_camera_poses,
});

/// Normal equations and geometry of one window.
#[derive(Debug)]
pub struct Workspace<T: Real, const FRAMES: usize, const PAIRS: usize> {
    /// `H`, later its factors.
    pub normal: NormalEquations<T, FRAMES, PAIRS>,
    /// `b = Jᵀ r`.
    pub gradient: [[T; 15]; FRAMES],
    /// The solved step of the frames.
    pub step: [[T; 15]; FRAMES],
    /// The part of `b` that comes from images, over motions of the cameras.
    pub visual_gradient: [[T; 6]; FRAMES],
    /// Cameras.
    pub geometry: Geometry<T, FRAMES, PAIRS>,
    /// Square-root information of the inertial factor that ends in each frame: the lower triangle, row by row.
    imu_square_roots: [Option<[T; 120]>; FRAMES],
    /// What each was computed for.
    imu_keys: [Option<IntegralKey<T>>; FRAMES],
    /// Covariance of the newest pose, `[δφ δp]`, 6×6, from the first, undamped factor of the last solution.
    pub newest_pose_covariance: SMatrix<T, 6, 6>,
    /// States to go back to when a step is refused.
    pub saved: [NavState<T>; FRAMES],
}

blank!([T: Real, const FRAMES: usize, const PAIRS: usize] Workspace<T, FRAMES, PAIRS> {
    normal, gradient, step, visual_gradient, geometry, imu_square_roots, imu_keys, newest_pose_covariance, saved,
};
    PAIRS == pairs(FRAMES), "PAIRS must be FRAMES (FRAMES + 1) / 2";
    marginalization_fits(FRAMES), "marginalisation works in the memory of the normal equations");

/// Names an inertial integral: its end, its length, and the bias it was linearised at.
type IntegralKey<T> = (Timestamp, Span, ImuBias<T>);

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Geometry<T, FRAMES, PAIRS> {
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

    /// The pair of `anchor < target` at the current states.
    #[inline]
    #[must_use]
    pub fn pair(&self, anchor: usize, target: usize) -> &PairGeometry<T> {
        &self.pairs[place(target, anchor)]
    }

    /// One observation's whitened residual, that of the anchor itself included; nothing behind the camera.
    #[inline(always)]
    pub fn residual(
        &self,
        anchor: usize,
        frame: usize,
        direction: &Vector3<T>,
        inverse_depth: T,
        point: &NormalizedPoint<T>,
    ) -> Option<Vector2<T>> {
        if frame == anchor {
            Some(reprojection::at_anchor(direction, point))
        } else {
            reprojection::residual(self.pair(anchor, frame), direction, inverse_depth, point)
        }
    }

    /// How far a landmark is off its plane, whitened, where it has one.
    #[inline(always)]
    pub fn plane_residual(&self, landmark: &Landmark<T, FRAMES>) -> Option<T> {
        if !landmark.plane.is_some() {
            return None;
        }
        landmark.plane.residual(self.camera_poses.get(landmark.anchor())?, &landmark.direction(), landmark.inverse_depth)
    }

    /// The same, linearised.
    #[inline(always)]
    pub fn linearize_plane(&self, landmark: &Landmark<T, FRAMES>) -> Option<PlaneLinearization<T>> {
        if !landmark.plane.is_some() {
            return None;
        }
        let (camera, first) = (self.camera_poses.get(landmark.anchor())?, self.first_camera_poses.get(landmark.anchor())?);
        landmark.plane.linearize(camera, first, &landmark.direction(), landmark.inverse_depth)
    }

    /// One observation, linearised.
    #[inline(always)]
    pub fn linearize(
        &self,
        anchor: usize,
        target: usize,
        direction: &Vector3<T>,
        inverse_depth: T,
        point: &NormalizedPoint<T>,
    ) -> Option<ReprojectionLinearization<T>> {
        let at = place(target, anchor);
        reprojection::linearize(&self.pairs[at], &self.first_pairs[at], direction, inverse_depth, point)
    }
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Default for Workspace<T, FRAMES, PAIRS> {
    fn default() -> Self {
        Self::BLANK
    }
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Workspace<T, FRAMES, PAIRS> {
    /// The square-root information of the inertial factor that ends in a frame, lower triangular, where it has one.
    #[must_use]
    pub fn imu_square_root(&self, frame: usize) -> Option<SMatrix<T, 15, 15>> {
        let packed = self.imu_square_roots.get(frame)?.as_ref()?;
        Some(SMatrix::from_fn(|r, c| if c <= r { packed[place(r, c)] } else { T::ZERO }))
    }

    /// Covariance of the newest of `frames` poses, `[δφ δp]`, 6×6, once factorised: it comes last in the elimination, so it
    /// is that of the last diagonal block alone.
    pub(super) fn factored_covariance(&self, frames: usize) -> Option<SMatrix<T, 6, 6>> {
        let last = frames.checked_sub(1)?;
        let block = self.normal.pose(last)?;
        let lower = SMatrix::<T, 6, 6>::from_fn(|r, c| if c <= r { block[r][c] } else { T::ZERO });
        let inverse = lower.solve_lower_triangular(&SMatrix::<T, 6, 6>::identity())?;
        Some(inverse.tr_mul(&inverse))
    }

    /// Geometry, and the weights of the inertial factors; once per solution.
    pub fn prepare<const POINTS: usize>(&mut self, window: &Window<T, FRAMES, POINTS>, settings: &Settings<T>) {
        for (i, frame) in window.frames.iter().enumerate().skip(1) {
            let key = Some((frame.stamp, frame.from_previous.span(), *frame.from_previous.bias()));
            // When frames have left the window, the others have moved towards its beginning.
            if let Some(known) = (i..FRAMES).find(|known| self.imu_keys[*known] == key) {
                self.imu_keys.swap(i, known);
                self.imu_square_roots.swap(i, known);
            } else {
                self.imu_keys[i] = key;
                self.imu_square_roots[i] = imu::sqrt_information(&frame.from_previous, settings.position_jitter_m).map(|root| {
                    let mut packed = [T::ZERO; 120];
                    for (slot, (r, c)) in packed.iter_mut().zip((0..15).flat_map(|r| (0..=r).map(move |c| (r, c)))) {
                        *slot = root[(r, c)];
                    }
                    packed
                });
            }
        }
        self.geometry.update(&window.frames, settings);
    }
}

fn fill_pairs<T: Real>(pairs: &mut [PairGeometry<T>], poses: &[CameraPose<T>]) {
    // A landmark's anchor is the oldest frame that sees it: later frames are the targets.
    for (i, target) in poses.iter().enumerate() {
        for (anchor, pair) in poses[..i].iter().zip(&mut pairs[place(i, 0)..]) {
            *pair = PairGeometry::new(target, anchor);
        }
    }
}
