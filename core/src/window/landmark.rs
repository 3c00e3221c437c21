//! A landmark: inverse depth along a bearing of its anchor frame.
//!
//! # Model
//! With `b = (x, y, 1)` in the anchor's camera and inverse depth `λ` (1/m), the point is `b / λ`. Points at infinity
//! (`λ = 0`) are regular. All three numbers are estimated: the anchor's corner is an observation like any other.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use nalgebra::{Matrix3, Vector3};

use super::{CameraPose, DepthKnowledge, DepthPrior, DepthSource, GivenDepth};
use crate::factor::point_on_plane::PlaneTerm;
use crate::real::Real;
use crate::track::TrackId;

/// A corner on the plane `z = 1` of the camera, undistorted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NormalizedPoint<T> {
    /// `x / z`.
    pub x: T,
    /// `y / z`.
    pub y: T,
    /// One over the standard deviation of `x` and `y`: the residual times this is whitened.
    pub inverse_sigma: T,
}

/// A corner followed through the window.
#[derive(Debug, Clone, Copy)]
pub struct Landmark<T: Real, const FRAMES: usize> {
    /// The track that observes it.
    pub track: TrackId,
    /// Whether its depth is known well enough to take part in the solution.
    pub active: bool,
    /// Which prior its inverse depth has.
    pub depth_source: DepthSource,
    /// Whether it was found wrong and leaves the window.
    pub condemned: bool,
    /// `λ`, 1/m, along [`Landmark::bearing`].
    pub inverse_depth: T,
    /// `(x, y)` of the direction `(x, y, 1)` in the anchor's camera.
    pub bearing: [T; 2],
    /// What a depth map says of `λ`, where [`DepthSource::Given`].
    pub given: GivenDepth<T>,
    /// The plane that it lies on, where it does.
    pub plane: PlaneTerm<T>,
    /// `(x, y, λ)` before the last step of the solver, to go back to.
    saved: [T; 3],
    anchor: u8,
    observed: u32,
    points: [NormalizedPoint<T>; FRAMES],
}

impl<T: Real, const FRAMES: usize> Landmark<T, FRAMES> {
    /// A landmark seen for the first time, in `frame`. Its depth is unknown.
    #[must_use]
    pub fn new(track: TrackId, frame: usize, point: NormalizedPoint<T>) -> Self {
        let mut landmark = Self {
            track,
            active: false,
            depth_source: DepthSource::Usual,
            condemned: false,
            inverse_depth: T::ZERO,
            saved: [T::ZERO; 3],
            bearing: [point.x, point.y],
            given: GivenDepth::default(),
            plane: PlaneTerm::NONE,
            #[allow(clippy::cast_possible_truncation)] // a window holds at most 32 frames
            anchor: frame as u8,
            observed: 0,
            points: [NormalizedPoint::default(); FRAMES],
        };
        landmark.observe(frame, point);
        landmark
    }

    /// Index of the frame in whose camera the landmark is expressed: the oldest that sees it.
    #[inline]
    #[must_use]
    pub fn anchor(&self) -> usize {
        usize::from(self.anchor)
    }

    /// Whether `frame` sees it.
    #[inline]
    #[must_use]
    pub fn is_seen_in(&self, frame: usize) -> bool {
        frame < FRAMES && self.observed >> frame & 1 == 1
    }

    /// Number of frames that see it.
    #[must_use]
    pub fn observations(&self) -> usize {
        self.observed.count_ones() as usize
    }

    /// Adds or replaces the observation in `frame`.
    pub fn observe(&mut self, frame: usize, point: NormalizedPoint<T>) {
        if let Some(slot) = self.points.get_mut(frame) {
            *slot = point;
            self.observed |= 1 << frame;
        }
    }

    /// Takes the observation in `frame` out. A landmark anchored there moves to the next frame that sees it.
    pub fn forget(&mut self, frame: usize, camera_poses: &[CameraPose<T>]) {
        if frame >= FRAMES {
            return;
        }
        self.observed &= !(1 << frame);
        if frame == self.anchor() && self.observed != 0 {
            let next = self.observed.trailing_zeros() as usize;
            self.move_anchor(camera_poses.get(frame).zip(camera_poses.get(next)), next);
        }
    }

    /// Moves `(x, y, λ)`; [`Self::take_step_back`] undoes it.
    pub fn take_step(&mut self, step: &[T; 3]) {
        let [x, y] = self.bearing;
        self.saved = [x, y, self.inverse_depth];
        self.bearing = [x + step[0], y + step[1]];
        self.inverse_depth += step[2];
    }

    /// To where it was before the last [`Self::take_step`].
    pub fn take_step_back(&mut self) {
        let [x, y, inverse_depth] = self.saved;
        (self.bearing, self.inverse_depth) = ([x, y], inverse_depth);
    }

    /// The observation in `frame`, where there is one.
    #[must_use]
    pub fn point(&self, frame: usize) -> Option<&NormalizedPoint<T>> {
        if self.is_seen_in(frame) { self.points.get(frame) } else { None }
    }

    /// Frames that see it, oldest first, with what they see.
    pub fn seen(&self) -> impl Iterator<Item = (usize, &NormalizedPoint<T>)> {
        self.points.iter().enumerate().filter(|(frame, _)| self.observed >> frame & 1 == 1)
    }

    /// The direction `(x, y, 1)` in the anchor's camera.
    #[inline]
    #[must_use]
    pub fn direction(&self) -> Vector3<T> {
        Vector3::new(self.bearing[0], self.bearing[1], T::one())
    }

    /// The point in world, m, where its depth is known and finite.
    #[must_use]
    pub fn position_in_world(&self, camera_poses: &[CameraPose<T>]) -> Option<Vector3<T>> {
        let anchor = camera_poses.get(self.anchor())?;
        if !(self.active && self.inverse_depth > T::of(1e-3)) {
            return None;
        }
        Some(anchor.world_from_camera * (self.direction() / self.inverse_depth) + anchor.center_in_world)
    }

    /// Takes frame `index` out of the window: later frames move down by one, and a landmark anchored there moves to
    /// the next frame that sees it, its estimate unchanged.
    pub fn remove_frame(&mut self, index: usize, camera_poses: &[CameraPose<T>]) {
        if index >= FRAMES {
            return;
        }
        let was_anchor = self.anchor() == index;
        let below = self.observed & ((1u32 << index) - 1);
        let above = (self.observed >> index >> 1) << index;
        self.points.copy_within(index + 1.., index);
        self.observed = below | above;
        if was_anchor {
            let next = self.observed.trailing_zeros() as usize;
            if self.observed != 0 {
                // `camera_poses` still counts the removed frame.
                self.move_anchor(camera_poses.get(index).zip(camera_poses.get(next + 1)), next);
            }
        } else if self.anchor() > index {
            self.anchor -= 1;
        }
    }

    /// Takes in what a depth map says of `λ` in the anchor: see [`GivenDepth::with`].
    pub fn give(&mut self, given: GivenDepth<T>) {
        self.given = if self.depth_source == DepthSource::Given { self.given.with(&given) } else { given };
        self.depth_source = DepthSource::Given;
    }

    #[inline(never)]
    fn move_anchor(&mut self, poses: Option<(&CameraPose<T>, &CameraPose<T>)>, next: usize) {
        let seen = self.points[next];
        #[allow(clippy::cast_possible_truncation)] // below 32
        {
            self.anchor = next as u8;
        }
        if let (true, Some((old, new))) = (self.active, poses) {
            let (rotation, translation) = CameraPose::target_from_anchor(new, old);
            if self.depth_source == DepthSource::Given {
                match self.given.seen_from((rotation * self.direction()).z, translation.z) {
                    Some(given) => self.given = given,
                    None => self.depth_source = DepthSource::Usual,
                }
            }
            // (b/λ) in the new camera, times λ
            let moved = rotation * self.direction() + translation * self.inverse_depth;
            if moved.z > T::of(1e-2) {
                self.bearing = [moved.x / moved.z, moved.y / moved.z];
                self.inverse_depth /= moved.z;
                return;
            }
        }
        self.active = false;
        if self.depth_source == DepthSource::Given {
            self.depth_source = DepthSource::Usual;
        }
        self.bearing = [seen.x, seen.y];
    }

    /// Inverse depth by linear least squares over all observations, the anchor's corner taken as exact.
    ///
    /// # Model
    /// A ray `R b + λ t` of the anchor meets `(x, y)` in another camera where
    /// `(R b)ₓ − x (R b)_z + λ (tₓ − x t_z) = 0`, likewise for `y`. Rows are divided by the depth, so that they are
    /// in units of the image; two passes suffice.
    #[must_use]
    pub fn triangulate(&self, camera_poses: &[CameraPose<T>]) -> Option<T> {
        let anchor = camera_poses.get(self.anchor())?;
        let direction = Vector3::new(self.points.get(self.anchor())?.x, self.points.get(self.anchor())?.y, T::one());
        let mut inverse_depth = T::ZERO;
        for _ in 0..3 {
            let (mut numerator, mut sum) = (T::ZERO, T::ZERO);
            for (frame, point) in self.seen().filter(|(frame, _)| *frame != self.anchor()) {
                let (rotation, translation) = CameraPose::target_from_anchor(camera_poses.get(frame)?, anchor);
                let ray = rotation * direction;
                let depth = ray.z + inverse_depth * translation.z;
                if depth < T::of(0.05) {
                    continue;
                }
                let scale = point.inverse_sigma / depth;
                for (value, slope) in [
                    (ray.x - point.x * ray.z, translation.x - point.x * translation.z),
                    (ray.y - point.y * ray.z, translation.y - point.y * translation.z),
                ] {
                    numerator -= value * slope * scale * scale;
                    sum += slope * slope * scale * scale;
                }
            }
            if !(sum > T::of(1e-9)) {
                return None;
            }
            inverse_depth = numerator / sum;
        }
        Some(inverse_depth)
    }

    /// One Gauss-Newton step on bearing and inverse depth over all observations, the anchor's included, poses fixed.
    /// The step is kept only where it lowers the cost. Returns the information of `λ`, the bearing being unknown too.
    #[inline(never)]
    pub fn refine(&mut self, camera_poses: &[CameraPose<T>], prior: &DepthKnowledge<T>) -> Option<T> {
        let mut hessian = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        let residual = prior.residual(self.inverse_depth);
        let before = self.cost(camera_poses, self.bearing, self.inverse_depth, Some((&mut hessian, &mut gradient))) + residual * residual;
        let slope = prior.slope(self.inverse_depth);
        hessian[(2, 2)] += slope * slope;
        gradient[2] += slope * residual;
        let factor = hessian.cholesky()?;
        let step = factor.solve(&gradient);
        let bearing = [self.bearing[0] - step.x, self.bearing[1] - step.y];
        let inverse_depth = self.inverse_depth - step.z;
        let after = prior.residual(inverse_depth);
        if self.cost(camera_poses, bearing, inverse_depth, None) + after * after < before {
            self.bearing = bearing;
            self.inverse_depth = inverse_depth;
        }
        // λ comes last: its pivot is what is left when x and y are eliminated.
        let pivot = factor.l_dirty()[(2, 2)];
        Some(pivot * pivot)
    }

    /// Whether observations tell the inverse depth to the mean of the prior, poses fixed.
    #[inline(never)]
    #[must_use]
    pub fn is_told(&self, camera_poses: &[CameraPose<T>], prior: &DepthPrior<T>) -> bool {
        let mut trial = *self;
        trial.refine(camera_poses, &DepthKnowledge::Usual(*prior)).is_some_and(|information| prior.is_surpassed_by(information))
    }

    /// Half the sum of squared whitened residuals, and its normal equations in `(x, y, λ)` where asked for.
    #[inline(never)]
    fn cost(
        &self,
        camera_poses: &[CameraPose<T>],
        bearing: [T; 2],
        inverse_depth: T,
        mut normal: Option<(&mut Matrix3<T>, &mut Vector3<T>)>,
    ) -> T {
        let direction = Vector3::new(bearing[0], bearing[1], T::one());
        let Some(anchor) = camera_poses.get(self.anchor()) else { return T::ZERO };
        let mut cost = T::ZERO;
        for (frame, point) in self.seen() {
            let Some(target) = camera_poses.get(frame) else { continue };
            let (rotation, translation) = if frame == self.anchor() {
                (Matrix3::identity(), Vector3::zeros())
            } else {
                CameraPose::target_from_anchor(target, anchor)
            };
            let ray = rotation * direction + translation * inverse_depth;
            if ray.z < T::of(0.05) {
                return T::of(1e12);
            }
            let (x, y) = (ray.x / ray.z, ray.y / ray.z);
            let residual = [(x - point.x) * point.inverse_sigma, (y - point.y) * point.inverse_sigma];
            cost += residual[0] * residual[0] + residual[1] * residual[1];
            if let Some((hessian, gradient)) = normal.as_mut() {
                let scale = point.inverse_sigma / ray.z;
                for (axis, coordinate) in [x, y].into_iter().enumerate() {
                    let slope = |v: [T; 3]| (v[axis] - coordinate * v[2]) * scale;
                    let row = Vector3::new(
                        slope([rotation[(0, 0)], rotation[(1, 0)], rotation[(2, 0)]]),
                        slope([rotation[(0, 1)], rotation[(1, 1)], rotation[(2, 1)]]),
                        slope([translation.x, translation.y, translation.z]),
                    );
                    **hessian += row * row.transpose();
                    **gradient += row * residual[axis];
                }
            }
        }
        cost
    }
}
