//! The most likely motion of the start: all bearings, the inertial samples as one rigid curve.
//!
//! # Model
//! Parameters `x = [v₀ g b_a b_g ḃ_a]`, 14 degrees of freedom: `g` on the sphere of known radius, the rest additive; `ḃ_a` is a
//! steady growth of the accelerometer bias. A landmark is
//! a direction `u` in the camera `a` that saw it first, and an inverse distance ρ. In the body frame of the first image
//! ```text
//! q = R_a u + ρ (c_a − c_i)          3×1, R_a, c: orientation and centre of a camera, m
//! e = B(f)ᵀ R_iᵀ q / (fᵀ R_iᵀ q)     2×1, tangent of the angle off the measured bearing f
//! c = v₀ t + ½ g t² + α(b, ḃ_a) + R(b_g) t_BC
//! ```
//! and with `h = R_iᵀ q` in the camera, `d = fᵀ h`, body-frame vectors in the first body frame, `φ` and `∂α` from the chain,
//! ```text
//! ∂e/∂h = (Bᵀ − e fᵀ)/d      2×3     ∂h/∂δu = R_iᵀ R_a B(u)   3×2     ∂h/∂ρ = R_iᵀ (c_a − c_i)   3×1
//! ∂h/∂x = [h]× R_CB φ_i δb_g + R_iᵀ (−R_a [u]× R_CB φ_a δb_g + ρ (∂c_a − ∂c_i))                    3×14
//! ```
//! Levenberg-Marquardt on Cauchy's kernel with the three numbers of each landmark eliminated.
//!
//! # Degeneracy
//! At constant velocity the scale is free, without translation everything but the rotation is; the covariance says so.

use nalgebra::{Cholesky, Const, Isometry3, Matrix2x3, Matrix3, SMatrix, SVector, Vector2, Vector3};

use super::chain::{InertialLink, Node, walk};
use super::config::InitConfig;
use super::gyro_bias::cauchy;
use super::median::Histogram;
use super::tracks::{Bearings, InitLandmark, across};
use crate::imu::ImuBias;
use crate::lie::matrix::{diagonal, of_rotation, product, transposed_product};
use crate::lie::so3;
use crate::real::Real;
use crate::storage::blank::blank;

/// `[v₀ δg b_a b_g ḃ_a]`.
pub(super) const PARAMETERS: usize = 14;
const VELOCITY: usize = 0;
const GRAVITY: usize = 3;
const ACCEL: usize = 5;
const GYRO: usize = 8;
const DRIFT: usize = 11;
/// `(width of the kernel, iterations at most, relative gain that ends the stage)`: a wide kernel first carries a poor start close.
const STAGES: [(f64, usize, f64); 2] = [(5.0, 10, 1e-2), (1.0, 30, 2e-5)];

/// Damping that each stage begins with.
const FIRST_DAMPING: f64 = 1e-4;

type Row<T> = SMatrix<T, 3, PARAMETERS>;
type Information<T> = SMatrix<T, PARAMETERS, PARAMETERS>;
type Factor<T> = Cholesky<T, Const<PARAMETERS>>;
type Gradient<T> = SVector<T, PARAMETERS>;

/// The parameters, in the body frame of the first image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion<T: Real> {
    pub velocity: Vector3<T>,
    pub gravity: Vector3<T>,
    pub bias: ImuBias<T>,
    /// `ḃ_a`, m/s³.
    pub drift: Vector3<T>,
}

blank!([T: Real] Motion<T> { velocity, gravity, bias, drift });

impl<T: Real> Motion<T> {
    pub(super) fn retract(&self, step: &Gradient<T>) -> Self {
        let magnitude = self.gravity.norm();
        let moved = self.gravity + across(&(self.gravity / magnitude)) * step.fixed_rows::<2>(GRAVITY) * magnitude;
        Self {
            velocity: self.velocity + step.fixed_rows::<3>(VELOCITY),
            gravity: moved * (magnitude / moved.norm()),
            bias: ImuBias {
                gyro_rad_s: self.bias.gyro_rad_s + step.fixed_rows::<3>(GYRO),
                accel_m_s2: self.bias.accel_m_s2 + step.fixed_rows::<3>(ACCEL),
            },
            drift: self.drift + step.fixed_rows::<3>(DRIFT),
        }
    }

    /// `p_i` of the body in its first frame.
    pub(super) fn position(&self, node: &Node<T>) -> Vector3<T> {
        let half_squared = node.time_s * node.time_s * T::of(0.5);
        self.velocity * node.time_s + self.gravity * half_squared + node.position + node.d_position_d_drift * self.drift
    }

    /// Its derivative, 3×14.
    pub(super) fn d_position(&self, node: &Node<T>) -> Row<T> {
        let half_squared = node.time_s * node.time_s * T::of(0.5);
        let magnitude = self.gravity.norm();
        let mut d_position = Row::zeros();
        d_position.fixed_columns_mut::<3>(VELOCITY).fill_with_identity();
        d_position *= node.time_s;
        d_position.fixed_columns_mut::<2>(GRAVITY).copy_from(&(across(&(self.gravity / magnitude)) * (magnitude * half_squared)));
        d_position.fixed_columns_mut::<3>(ACCEL).copy_from(&node.d_position_d_bias.fixed_columns::<3>(3));
        d_position.fixed_columns_mut::<3>(GYRO).copy_from(&node.d_position_d_bias.fixed_columns::<3>(0));
        d_position.fixed_columns_mut::<3>(DRIFT).copy_from(&node.d_position_d_drift);
        d_position
    }
}

/// A camera of the chain in the first body frame.
#[derive(Clone, Copy)]
pub(super) struct Pose<T: Real> {
    pub time_s: T,
    pub first_from_camera: Matrix3<T>,
    pub centre: Vector3<T>,
}

impl<T: Real> Pose<T> {
    fn of(motion: &Motion<T>, node: &Node<T>, body_from_camera: &Isometry3<T>) -> Self {
        let first_from_body = of_rotation(&node.first_from_body);
        Self {
            time_s: node.time_s,
            first_from_camera: product(&first_from_body, &of_rotation(&body_from_camera.rotation)),
            centre: motion.position(node) + first_from_body * body_from_camera.translation.vector,
        }
    }
}

/// The same with its derivatives.
#[derive(Clone, Copy)]
pub(super) struct View<T: Real> {
    pub pose: Pose<T>,
    d_centre: Row<T>,
    /// `R_CB φ`, 3×3: turn of the camera about its own axes by the gyro bias.
    d_turn: Matrix3<T>,
}

impl<T: Real> View<T> {
    fn of(motion: &Motion<T>, node: &Node<T>, body_from_camera: &Isometry3<T>) -> Self {
        let first_from_body = of_rotation(&node.first_from_body);
        let mut d_centre = motion.d_position(node);
        let mut gyro = d_centre.fixed_columns_mut::<3>(GYRO);
        gyro -= product(&product(&first_from_body, &so3::hat(&body_from_camera.translation.vector)), &node.d_rotation_d_gyro);
        Self {
            pose: Pose::of(motion, node, body_from_camera),
            d_centre,
            d_turn: transposed_product(&of_rotation(&body_from_camera.rotation), &node.d_rotation_d_gyro),
        }
    }
}

/// All cameras at one set of parameters.
pub(super) struct Poses<T: Real, const FRAMES: usize> {
    poses: [Pose<T>; FRAMES],
    count: usize,
}

impl<T: Real, const FRAMES: usize> Poses<T, FRAMES> {
    pub(super) fn empty() -> Self {
        let pose = Pose { time_s: T::ZERO, first_from_camera: Matrix3::identity(), centre: Vector3::zeros() };
        Self { poses: [pose; FRAMES], count: 0 }
    }

    #[inline(never)]
    pub(super) fn fill(&mut self, motion: &Motion<T>, links: &[InertialLink<T>], body_from_camera: &Isometry3<T>) {
        self.count = (links.len() + 1).min(FRAMES);
        walk(links, &motion.bias, |frame, node| {
            if let Some(pose) = self.poses.get_mut(frame) {
                *pose = Pose::of(motion, node, body_from_camera);
            }
        });
    }

    pub(super) fn as_slice(&self) -> &[Pose<T>] {
        self.poses.get(..self.count).unwrap_or_default()
    }
}

/// The same with their derivatives.
pub(super) struct Views<T: Real, const FRAMES: usize> {
    views: [View<T>; FRAMES],
    count: usize,
}

impl<T: Real, const FRAMES: usize> Views<T, FRAMES> {
    pub(super) fn empty() -> Self {
        let pose = Pose { time_s: T::ZERO, first_from_camera: Matrix3::identity(), centre: Vector3::zeros() };
        Self { views: [View { pose, d_centre: Row::zeros(), d_turn: Matrix3::zeros() }; FRAMES], count: 0 }
    }

    #[inline(never)]
    pub(super) fn fill(&mut self, motion: &Motion<T>, links: &[InertialLink<T>], body_from_camera: &Isometry3<T>) {
        self.count = (links.len() + 1).min(FRAMES);
        walk(links, &motion.bias, |frame, node| {
            if let Some(view) = self.views.get_mut(frame) {
                *view = View::of(motion, node, body_from_camera);
            }
        });
    }

    pub(super) fn as_slice(&self) -> &[View<T>] {
        self.views.get(..self.count).unwrap_or_default()
    }
}

/// One bearing, linearised.
pub(super) struct Linear<T: Real> {
    pub residual: Vector2<T>,
    /// 2×14
    pub d_motion: SMatrix<T, 2, PARAMETERS>,
    /// `[δu δρ]`, 2×3
    pub d_landmark: Matrix2x3<T>,
}

/// `None` when the point is not in front of the camera.
pub(super) fn residual<T: Real>(
    anchor: &Pose<T>,
    view: &Pose<T>,
    u: &Vector3<T>,
    rho: T,
    f: &Vector3<T>,
) -> Option<(Vector2<T>, Vector3<T>, T)> {
    let h = view.first_from_camera.tr_mul(&(anchor.first_from_camera * u + (anchor.centre - view.centre) * rho));
    let depth = f.dot(&h);
    (depth > T::of(0.05)).then(|| (across(f).tr_mul(&h) / depth, h, depth))
}

pub(super) fn linearize<T: Real>(
    anchor: &View<T>,
    view: &View<T>,
    is_anchor: bool,
    u: &Vector3<T>,
    rho: T,
    f: &Vector3<T>,
) -> Option<Linear<T>> {
    let (View { pose: anchor, d_centre: d_anchor, d_turn: d_anchor_turn }, View { pose: view, d_centre, d_turn }) = (anchor, view);
    let (residual, h, depth) = residual(anchor, view, u, rho, f)?;
    let d_h = (across(f).transpose() - residual * f.transpose()) / depth;
    let camera_from_first = view.first_from_camera.transpose();
    let d_h_first = d_h * camera_from_first;
    let mut d_landmark = Matrix2x3::zeros();
    d_landmark.fixed_columns_mut::<2>(0).copy_from(&(d_h_first * anchor.first_from_camera * across(u)));
    let mut d_motion = SMatrix::<T, 2, PARAMETERS>::zeros();
    if !is_anchor {
        d_landmark.set_column(2, &(d_h_first * (anchor.centre - view.centre)));
        for (column, (anchor, own)) in d_anchor.column_iter().zip(d_centre.column_iter()).enumerate() {
            d_motion.set_column(column, &(d_h_first * (anchor - own) * rho));
        }
        let mut gyro = d_motion.fixed_columns_mut::<3>(GYRO);
        gyro += d_h * so3::hat(&h) * d_turn - d_h_first * anchor.first_from_camera * so3::hat(u) * d_anchor_turn;
    }
    Some(Linear { residual, d_motion, d_landmark })
}

/// How far the minimisation is: it may be left and taken up again after any iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Descent<T: Real> {
    pub motion: Motion<T>,
    damping: T,
    stage: usize,
    /// Iterations of the stage so far.
    iteration: usize,
    /// Iterations left when the stage began.
    left: usize,
    is_converged: bool,
}

blank!([T: Real] Descent<T> { motion, damping, stage, iteration, left, is_converged });

impl<T: Real> Descent<T> {
    /// From `motion`, in at most `iterations`.
    pub(super) fn new(motion: Motion<T>, iterations: usize) -> Self {
        Self { motion, damping: T::of(FIRST_DAMPING), stage: 0, iteration: 0, left: iterations, is_converged: false }
    }

    pub(super) fn is_over(&self) -> bool {
        self.stage >= STAGES.len()
    }
}

/// What the refinement leaves behind.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refined<T: Real> {
    pub motion: Motion<T>,
    pub covariance: Information<T>,
    pub median_residual_px: T,
    pub inlier_ratio: T,
    pub observations: usize,
    pub is_converged: bool,
}

/// The problem that does not change while it is solved. At most `FRAMES` frames.
pub struct Problem<'a, T: Real, B, const FRAMES: usize> {
    /// Assumptions and thresholds.
    pub config: &'a InitConfig<T>,
    /// Pose of the camera in the body (IMU) frame.
    pub body_from_camera: &'a Isometry3<T>,
    /// `links[i]` leads from frame `i` to `i + 1`.
    pub links: &'a [InertialLink<T>],
    /// What the frames see.
    pub bearings: &'a B,
}

/// `A += JᵀW`, where that is symmetric: its lower triangle, two columns at a time.
fn add_square<T: Real>(information: &mut Information<T>, jacobian: &SMatrix<T, 2, PARAMETERS>, weighted: &SMatrix<T, 2, PARAMETERS>) {
    let mut rows = jacobian.as_slice().as_chunks::<2>().0;
    let weights = weighted.as_slice().as_chunks::<2>().0.as_chunks::<2>().0;
    for (columns, [[l0, l1], [r0, r1]]) in information.as_mut_slice().chunks_exact_mut(2 * PARAMETERS).zip(weights) {
        let (left, right) = columns.split_at_mut(PARAMETERS);
        let first = PARAMETERS - rows.len();
        let (Some(([j0, j1], below)), Some((corner, left)), Some((_, right))) = (
            rows.split_first(),
            left.get_mut(first..).and_then(<[T]>::split_first_mut),
            right.get_mut(first..).and_then(<[T]>::split_first_mut),
        ) else {
            return;
        };
        *corner += *j0 * *l0 + *j1 * *l1;
        for ((left, right), [j0, j1]) in left.iter_mut().zip(right).zip(below) {
            *left += *j0 * *l0 + *j1 * *l1;
            *right += *j0 * *r0 + *j1 * *r1;
        }
        rows = below.get(1..).unwrap_or_default();
    }
}

/// `A −= P Cᵀ`, where that is symmetric: its lower triangle.
fn subtract_product<T: Real>(information: &mut Information<T>, p: &SMatrix<T, PARAMETERS, 3>, c: &SMatrix<T, PARAMETERS, 3>) {
    // Row by row, so that the numbers of a row lie side by side.
    let (p, c) = (p.transpose(), c.transpose());
    let mut rows = p.as_slice().as_chunks::<3>().0;
    let columns = information.as_mut_slice().chunks_exact_mut(PARAMETERS);
    for (column, [c0, c1, c2]) in columns.zip(c.as_slice().as_chunks::<3>().0) {
        let first = PARAMETERS - rows.len();
        for (entry, [p0, p1, p2]) in column.get_mut(first..).unwrap_or_default().iter_mut().zip(rows) {
            *entry -= *p0 * *c0 + *p1 * *c1 + *p2 * *c2;
        }
        rows = rows.split_first().map_or(&[], |(_, rest)| rest);
    }
}

/// Normal equations of one landmark, its own three unknowns apart.
struct LandmarkEquations<T: Real> {
    own: Matrix3<T>,
    own_gradient: Vector3<T>,
    cross: SMatrix<T, PARAMETERS, 3>,
}

/// Memory for what one landmark's bearings say.
pub type LandmarkMemory<T> = [T; 9 + 3 + 3 * PARAMETERS];

impl<T: Real> LandmarkEquations<T> {
    fn save(&self, memory: &mut LandmarkMemory<T>) {
        let all = self.own.iter().chain(&self.own_gradient).chain(&self.cross);
        memory.iter_mut().zip(all).for_each(|(place, value)| *place = *value);
    }

    fn load(memory: &LandmarkMemory<T>) -> Self {
        let mut values = memory.iter().copied();
        let mut equations = Self { own: Matrix3::zeros(), own_gradient: Vector3::zeros(), cross: SMatrix::zeros() };
        equations.own.iter_mut().zip(&mut values).for_each(|(place, value)| *place = value);
        equations.own_gradient.iter_mut().zip(&mut values).for_each(|(place, value)| *place = value);
        equations.cross.iter_mut().zip(&mut values).for_each(|(place, value)| *place = value);
        equations
    }
}

impl<T: Real, B: Bearings<T>, const FRAMES: usize> Problem<'_, T, B, FRAMES> {
    /// Precision of the parameters before any bearing: `[v₀ δg b_a b_g]`.
    fn prior(&self) -> Gradient<T> {
        let precision = |sigma: T| T::one() / (sigma * sigma);
        let mut prior = Gradient::zeros();
        prior.fixed_rows_mut::<3>(VELOCITY).fill(precision(T::of(10.0)));
        prior.fixed_rows_mut::<3>(ACCEL).fill(precision(self.config.sigma_accel_bias_m_s2));
        prior.fixed_rows_mut::<3>(DRIFT).fill(precision(self.config.sigma_accel_drift_m_s3));
        prior.fixed_rows_mut::<3>(GYRO).fill(precision(self.config.sigma_gyro_bias_rad_s));
        prior
    }

    /// `x − 0` where the prior has its mean; gravity has none.
    fn from_prior(motion: &Motion<T>) -> Gradient<T> {
        let mut x = Gradient::zeros();
        x.fixed_rows_mut::<3>(VELOCITY).copy_from(&motion.velocity);
        x.fixed_rows_mut::<3>(ACCEL).copy_from(&motion.bias.accel_m_s2);
        x.fixed_rows_mut::<3>(DRIFT).copy_from(&motion.drift);
        x.fixed_rows_mut::<3>(GYRO).copy_from(&motion.bias.gyro_rad_s);
        x
    }

    /// The records of the landmarks that there are and that have one.
    pub(super) fn records<'l>(&self, landmarks: &'l mut [InitLandmark<T>]) -> &'l mut [InitLandmark<T>] {
        let count = self.bearings.landmark_count().min(landmarks.len());
        landmarks.get_mut(..count).unwrap_or_default()
    }

    #[inline(never)]
    fn cost(&self, motion: &Motion<T>, landmarks: &[InitLandmark<T>], width: T) -> T {
        let mut poses = Poses::<T, FRAMES>::empty();
        poses.fill(motion, self.links, self.body_from_camera);
        let x = Self::from_prior(motion);
        let mut cost = x.component_mul(&x).dot(&self.prior());
        let variance = self.config.sigma_rad() * self.config.sigma_rad();
        let knee = width * width * T::of(4.0);
        for (index, landmark) in landmarks.iter().enumerate().filter(|(_, landmark)| landmark.is_used) {
            let Some(anchor) = poses.as_slice().get(usize::from(landmark.anchor)) else { continue };
            for (frame, pose) in poses.as_slice().iter().enumerate() {
                let Some(f) = self.observation(landmark, index, frame) else { continue };
                let whitened = residual(anchor, pose, &landmark.bearing_in_anchor, landmark.inverse_distance_per_m, &f)
                    .map_or(T::of(1e4), |(e, ..)| e.norm_squared() / variance);
                // k log(1 + s/k): the kernel whose weight is `cauchy`.
                cost += (T::one() + whitened / knee).ln() * knee;
            }
        }
        cost
    }

    fn observation(&self, landmark: &InitLandmark<T>, index: usize, frame: usize) -> Option<Vector3<T>> {
        if landmark.is_rejected(frame) { None } else { self.bearings.bearing(index, frame) }
    }

    /// Adds a landmark's bearings to `information`, its lower triangle, and `gradient`.
    fn accumulate(
        &self,
        views: &[View<T>],
        index: usize,
        landmark: &InitLandmark<T>,
        width: T,
        mut dense: Option<(&mut Information<T>, &mut Gradient<T>)>,
    ) -> LandmarkEquations<T> {
        let mut equations = LandmarkEquations { own: Matrix3::zeros(), own_gradient: Vector3::zeros(), cross: SMatrix::zeros() };
        let variance = self.config.sigma_rad() * self.config.sigma_rad();
        let Some(anchor) = views.get(usize::from(landmark.anchor)) else { return equations };
        for (frame, view) in views.iter().enumerate() {
            let Some(f) = self.observation(landmark, index, frame) else { continue };
            let is_anchor = frame == usize::from(landmark.anchor);
            let Some(linear) = linearize(anchor, view, is_anchor, &landmark.bearing_in_anchor, landmark.inverse_distance_per_m, &f) else {
                continue;
            };
            let weight = cauchy(linear.residual.norm_squared() / (variance * width * width)) / variance;
            let weighted = linear.d_landmark * weight;
            equations.own += weighted.tr_mul(&linear.d_landmark);
            equations.own_gradient += weighted.tr_mul(&linear.residual);
            if !is_anchor {
                equations.cross += transposed_product(&linear.d_motion, &weighted);
                if let Some((information, gradient)) = &mut dense {
                    add_square(information, &linear.d_motion, &(linear.d_motion * weight));
                    **gradient += transposed_product(&linear.d_motion, &(linear.residual * weight));
                }
            }
        }
        equations
    }

    /// Damped inverse of a landmark's own block; a faint prior keeps points at infinity regular.
    fn own_inverse(equations: &LandmarkEquations<T>, damping: T) -> Option<Matrix3<T>> {
        let mut own = equations.own;
        for i in 0..3 {
            let diagonal = own[(i, i)];
            own[(i, i)] = diagonal * (T::one() + damping) + T::of(1e-2);
        }
        let inverse = own.try_inverse()?;
        inverse.iter().all(|value| value.is_usable()).then_some(inverse)
    }

    /// Information, its lower triangle, and gradient of the parameters with the landmarks eliminated. `memory` keeps the equations
    /// of as many landmarks as it has places.
    #[inline(never)]
    fn reduced(
        &self,
        motion: &Motion<T>,
        views: &[View<T>],
        landmarks: &[InitLandmark<T>],
        width: T,
        damping: T,
        memory: &mut [LandmarkMemory<T>],
    ) -> (Information<T>, Gradient<T>) {
        let prior = self.prior();
        let mut information = diagonal(prior.iter().copied());
        let mut gradient = prior.component_mul(&Self::from_prior(motion));
        for (index, landmark) in landmarks.iter().enumerate().filter(|(_, landmark)| landmark.is_used) {
            let (before, gradient_before) = (information, gradient);
            let equations = self.accumulate(views, index, landmark, width, Some((&mut information, &mut gradient)));
            if let Some(place) = memory.get_mut(index) {
                equations.save(place);
            }
            if let Some(inverse) = Self::own_inverse(&equations, damping) {
                let projected = product(&equations.cross, &inverse);
                subtract_product(&mut information, &projected, &equations.cross);
                gradient -= product(&projected, &equations.own_gradient);
            } else {
                (information, gradient) = (before, gradient_before);
            }
        }
        (information, gradient)
    }

    #[inline(never)]
    fn step_landmarks(
        &self,
        views: &[View<T>],
        landmarks: &mut [InitLandmark<T>],
        step: &Gradient<T>,
        width: T,
        damping: T,
        memory: &[LandmarkMemory<T>],
    ) {
        for (index, landmark) in landmarks.iter_mut().enumerate().filter(|(_, landmark)| landmark.is_used) {
            landmark.previous = (landmark.bearing_in_anchor, landmark.inverse_distance_per_m);
            let equations = match memory.get(index) {
                Some(place) => LandmarkEquations::load(place),
                None => self.accumulate(views, index, landmark, width, None),
            };
            let Some(inverse) = Self::own_inverse(&equations, damping) else { continue };
            let own = -(inverse * (equations.own_gradient + equations.cross.tr_mul(step)));
            let moved = landmark.bearing_in_anchor + across(&landmark.bearing_in_anchor) * own.fixed_rows::<2>(0);
            landmark.bearing_in_anchor = moved.normalize();
            landmark.inverse_distance_per_m += own.z;
            landmark.sigma_inverse_distance_per_m = inverse[(2, 2)].max(T::ZERO).root();
        }
    }

    /// `information⁻¹ (−gradient)`, the diagonal raised by `damping`.
    #[inline(never)]
    fn step(information: &Information<T>, gradient: &Gradient<T>, damping: T) -> Option<Gradient<T>> {
        let mut damped = *information;
        for i in 0..PARAMETERS {
            damped[(i, i)] *= T::one() + damping;
        }
        Some(Self::solution(&Self::factor(&damped)?, &-gradient))
    }

    #[inline(never)]
    fn factor(information: &Information<T>) -> Option<Factor<T>> {
        information.cholesky()
    }

    #[inline(never)]
    fn solution(factor: &Factor<T>, right: &Gradient<T>) -> Gradient<T> {
        factor.solve(right)
    }

    /// Levenberg-Marquardt from where `descent` is, `budget` iterations at most; `None` when a number is not finite or the equations
    /// are singular.
    #[inline(never)]
    pub(super) fn descend(
        &self,
        descent: &mut Descent<T>,
        landmarks: &mut [InitLandmark<T>],
        memory: &mut [LandmarkMemory<T>],
        mut budget: usize,
    ) -> Option<()> {
        let mut views = Views::<T, FRAMES>::empty();
        while let Some(&(width, iterations, least_gain)) = STAGES.get(descent.stage) {
            let (width, most) = (T::of(width), iterations.min(descent.left));
            let mut cost = self.cost(&descent.motion, landmarks, width);
            descent.is_converged = false;
            while descent.iteration < most && !descent.is_converged {
                if budget == 0 {
                    return Some(());
                }
                budget -= 1;
                descent.iteration += 1;
                let damping = descent.damping;
                views.fill(&descent.motion, self.links, self.body_from_camera);
                let (information, gradient) = self.reduced(&descent.motion, views.as_slice(), landmarks, width, damping, memory);
                let step = Self::step(&information, &gradient, damping)?;
                self.step_landmarks(views.as_slice(), landmarks, &step, width, damping, memory);
                let candidate = descent.motion.retract(&step);
                let candidate_cost = self.cost(&candidate, landmarks, width);
                if candidate_cost < cost {
                    let gain = (cost - candidate_cost) / cost;
                    (descent.motion, cost) = (candidate, candidate_cost);
                    descent.damping = (damping * T::of(0.1)).max(T::of(1e-6));
                    descent.is_converged = gain < T::of(least_gain);
                } else {
                    for landmark in landmarks.iter_mut().filter(|landmark| landmark.is_used) {
                        (landmark.bearing_in_anchor, landmark.inverse_distance_per_m) = landmark.previous;
                    }
                    descent.damping = damping * T::of(10.0);
                    descent.is_converged = descent.damping > T::of(1e3);
                }
            }
            if !cost.is_usable() {
                return None;
            }
            descent.left -= descent.iteration;
            (descent.stage, descent.iteration, descent.damping) = (descent.stage + 1, 0, T::of(FIRST_DAMPING));
        }
        Some(())
    }

    /// Covariance of the parameters, but for a factor.
    #[inline(never)]
    fn covariance(&self, motion: &Motion<T>, landmarks: &[InitLandmark<T>]) -> Option<Information<T>> {
        let mut views = Views::<T, FRAMES>::empty();
        views.fill(motion, self.links, self.body_from_camera);
        let (information, _) = self.reduced(motion, views.as_slice(), landmarks, T::one(), T::ZERO, &mut []);
        Self::inverse(&information)
    }

    // Out of line, so that its memory is not there while the information is summed up: here the stack is deepest.
    #[inline(never)]
    fn inverse(information: &Information<T>) -> Option<Information<T>> {
        let factor = Self::factor(information)?;
        let mut inverse: Information<T> = diagonal(core::iter::repeat(T::one()));
        for column in 0..PARAMETERS {
            inverse.set_column(column, &Self::solution(&factor, &inverse.column(column).into_owned()));
        }
        Some(inverse)
    }

    /// What a descent that is over came to; `None` when a number is not finite or the equations are singular.
    #[inline(never)]
    pub(super) fn conclude(&self, descent: &Descent<T>, landmarks: &mut [InitLandmark<T>]) -> Option<Refined<T>> {
        let Descent { motion, is_converged, .. } = *descent;
        let (median_residual_px, inlier_ratio, observations) = self.judge(&motion, landmarks)?;
        // The assumed noise is widened, never narrowed, to what the residuals show (median of a Rayleigh distribution: 1.1774 σ).
        let shown = (median_residual_px / (self.config.sigma_px * T::of(1.1774))).max(T::one());
        let covariance = self.covariance(&motion, landmarks)? * (shown * shown);
        Some(Refined { motion, covariance, median_residual_px, inlier_ratio, observations, is_converged })
    }

    /// Median residual, share of inliers and number of observations; marks the outliers.
    #[inline(never)]
    fn judge(&self, motion: &Motion<T>, landmarks: &mut [InitLandmark<T>]) -> Option<(T, T, usize)> {
        let mut poses = Poses::<T, FRAMES>::empty();
        poses.fill(motion, self.links, self.body_from_camera);
        let (mut residuals, mut inliers, mut total, mut seen) = (Histogram::new(), 0_u32, 0_u32, 0_u32);
        let limit = self.config.sigma_rad() * T::of(3.5);
        for (index, landmark) in landmarks.iter_mut().enumerate().filter(|(_, landmark)| landmark.is_used) {
            let Some(anchor) = poses.as_slice().get(usize::from(landmark.anchor)) else { continue };
            let mut good = 0;
            for (frame, pose) in poses.as_slice().iter().enumerate() {
                seen += u32::from(self.bearings.bearing(index, frame).is_some());
                let Some(f) = self.observation(landmark, index, frame) else { continue };
                let size = residual(anchor, pose, &landmark.bearing_in_anchor, landmark.inverse_distance_per_m, &f)
                    .map_or(T::one(), |(e, ..)| e.norm());
                residuals.add(size);
                total += 1;
                if size < limit {
                    good += 1;
                } else {
                    landmark.rejected_frames |= 1 << frame;
                }
            }
            inliers += good;
            landmark.is_used = good >= 3;
        }
        let ratio = T::of(f64::from(inliers) / f64::from(seen.max(1)));
        Some((residuals.quantile::<T>(0.5)? * self.config.focal_px, ratio, total as usize))
    }
}
