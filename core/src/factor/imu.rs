//! Two states are joined by the inertial samples between them.
//!
//! # Model
//! For states i and j, a preintegration over `t` seconds with deltas `(ΔR, Δv, Δp)` corrected for the bias of i, and gravity `g` in world,
//! ```text
//! r_φ = Log(ΔRᵀ R_iᵀ R_j)                                3×1, rad
//! r_p = R_iᵀ (p_j − p_i − v_i t − g t²/2) − Δp           3×1, m
//! r_v = R_iᵀ (v_j − v_i − g t) − Δv                      3×1, m/s
//! r_g = b_g,j − b_g,i      r_a = b_a,j − b_a,i           3×1 each, rad/s and m/s²
//! ```
//! At the true states this is the error whose covariance is [`Preintegration::covariance`]. Jacobians with respect to
//! `[δφ δp δv δb_g δb_a]` of either state, `E = Jr⁻¹(r_φ)`, `D = J_θ (b_g,i − b̄_g)`:
//! ```text
//!        δφ_i               δp_i    δv_i      δb_g,i             δb_a,i      δφ_j   δp_j    δv_j
//! r_φ    −E R_jᵀ R_i                          −E R_jᵀR_i Jl(D)J_θ             E
//! r_p    [R_iᵀ(…)]×         −R_iᵀ   −R_iᵀ t   −∂Δp/∂b_g          −∂Δp/∂b_a          R_iᵀ
//! r_v    [R_iᵀ(…)]×                 −R_iᵀ     −∂Δv/∂b_g          −∂Δv/∂b_a                  R_iᵀ
//! ```
//!
//! # Degeneracy
//! `Jr⁻¹` is singular where the rotation residual is a full turn; an estimate that far off has nothing left to linearise.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::imu::{NavState, Preintegration};
use crate::lie::matrix::of_rotation;
use crate::lie::so3;
use crate::real::Real;

/// Residual and Jacobians, whitened: 15×1 and 15×15 each, dimensionless rows, columns `[δφ δp δv δb_g δb_a]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuLinearization<T: Real> {
    /// `W r`.
    pub residual: SVector<T, 15>,
    /// `W ∂r/∂δx_i`.
    pub d_residual_d_from: SMatrix<T, 15, 15>,
    /// `W ∂r/∂δx_j`.
    pub d_residual_d_to: SMatrix<T, 15, 15>,
}

/// What position and velocity gained beyond the start velocity and gravity, in the frame of the start: `(R_iᵀ(p_j − …), R_iᵀ(v_j − …))`.
fn gains<T: Real>(
    pre: &Preintegration<T>,
    gravity_in_world: &Vector3<T>,
    from: &NavState<T>,
    to: &NavState<T>,
) -> (Vector3<T>, Vector3<T>) {
    let span = pre.span_s();
    let fall = gravity_in_world * span;
    let travelled = to.position_in_world - from.position_in_world - (from.velocity_in_world + fall * T::of(0.5)) * span;
    let gained = to.velocity_in_world - from.velocity_in_world - fall;
    let body_from_world = from.world_from_body.inverse();
    (body_from_world * travelled, body_from_world * gained)
}

/// The residual `[r_φ r_p r_v r_g r_a]`, 15×1, not whitened.
#[must_use]
pub fn residual<T: Real>(pre: &Preintegration<T>, gravity_in_world: &Vector3<T>, from: &NavState<T>, to: &NavState<T>) -> SVector<T, 15> {
    let (rotation, velocity, position) = pre.corrected(&from.bias);
    let (travelled, gained) = gains(pre, gravity_in_world, from, to);
    let parts = [
        so3::log(&(rotation.inverse() * (from.world_from_body.inverse() * to.world_from_body))),
        travelled - position,
        gained - velocity,
        to.bias.gyro_rad_s - from.bias.gyro_rad_s,
        to.bias.accel_m_s2 - from.bias.accel_m_s2,
    ];
    let mut residual = SVector::<T, 15>::zeros();
    for (slot, part) in residual.as_mut_slice().chunks_exact_mut(3).zip(&parts) {
        slot.copy_from_slice(part.as_slice());
    }
    residual
}

/// The whitened residual at `(from, to)` and the whitened Jacobians at `(from_lin, to_lin)`: first-estimate Jacobians, or ordinary ones when
/// the same states are given twice. `sqrt_information` is the lower triangular one of [`sqrt_information`], 15×15.
#[must_use]
pub fn linearize<T: Real>(
    pre: &Preintegration<T>,
    gravity_in_world: &Vector3<T>,
    sqrt_information: &SMatrix<T, 15, 15>,
    from: &NavState<T>,
    to: &NavState<T>,
    from_lin: &NavState<T>,
    to_lin: &NavState<T>,
) -> ImuLinearization<T> {
    let (rotation, _, _) = pre.corrected(&from_lin.bias);
    let (travelled, gained) = gains(pre, gravity_in_world, from_lin, to_lin);
    let end_from_start = to_lin.world_from_body.inverse() * from_lin.world_from_body;
    let r_phi = so3::log(&(end_from_start * rotation).inverse());
    let phi_by_to = so3::right_jacobian_inverse(&r_phi);
    let phi_by_from = -(phi_by_to * of_rotation(&end_from_start));
    let moved = pre.d_theta_d_gyro() * (from_lin.bias.gyro_rad_s - pre.bias().gyro_rad_s);
    let phi_by_gyro = phi_by_from * (so3::right_jacobian(&-moved) * pre.d_theta_d_gyro());
    let body_from_world = of_rotation(&from_lin.world_from_body).transpose();

    // Columns of W, three at a time; with them every product below is (15×3)(3×3).
    let of = |block: usize| Columns::new(sqrt_information, block);
    let (phi, position, velocity, gyro, accel) = (of(0), of(1), of(2), of(3), of(4));
    let by_position = position.times(&body_from_world);
    let by_velocity = velocity.times(&body_from_world);

    let mut d_to = SMatrix::<T, 15, 15>::zeros();
    d_to.fixed_columns_mut::<3>(0).copy_from(&phi.times(&phi_by_to));
    d_to.fixed_columns_mut::<3>(3).copy_from(&by_position);
    d_to.fixed_columns_mut::<3>(6).copy_from(&by_velocity);
    d_to.fixed_columns_mut::<3>(9).copy_from(&gyro.0);
    d_to.fixed_columns_mut::<3>(12).copy_from(&accel.0);

    let mut d_from = SMatrix::<T, 15, 15>::zeros();
    d_from
        .fixed_columns_mut::<3>(0)
        .copy_from(&(phi.times(&phi_by_from) + position.times(&so3::hat(&travelled)) + velocity.times(&so3::hat(&gained))));
    d_from.fixed_columns_mut::<3>(3).copy_from(&-by_position);
    d_from.fixed_columns_mut::<3>(6).copy_from(&(by_position * -pre.span_s() - by_velocity));
    d_from
        .fixed_columns_mut::<3>(9)
        .copy_from(&(phi.times(&phi_by_gyro) - position.times(pre.d_position_d_gyro()) - velocity.times(pre.d_velocity_d_gyro()) - gyro.0));
    d_from
        .fixed_columns_mut::<3>(12)
        .copy_from(&-(position.times(pre.d_position_d_accel()) + velocity.times(pre.d_velocity_d_accel()) + accel.0));

    ImuLinearization {
        residual: sqrt_information * residual(pre, gravity_in_world, from, to),
        d_residual_d_from: d_from,
        d_residual_d_to: d_to,
    }
}

/// Three neighbouring columns of the triangular `W`, 15×3.
struct Columns<T: Real>(SMatrix<T, 15, 3>, usize);

impl<T: Real> Columns<T> {
    fn new(whole: &SMatrix<T, 15, 15>, block: usize) -> Self {
        Self(whole.fixed_columns::<3>(3 * block).into_owned(), 3 * block)
    }

    /// The product with a 3×3 block; rows above the diagonal are zero and skipped.
    // Out of line: nine calls unrolled are ten kilobytes of a microcontroller's flash.
    #[inline(never)]
    fn times(&self, right: &Matrix3<T>) -> SMatrix<T, 15, 3> {
        let mut product = SMatrix::<T, 15, 3>::zeros();
        for row in self.1..15 {
            for column in 0..3 {
                product[(row, column)] =
                    self.0[(row, 0)] * right[(0, column)] + self.0[(row, 1)] * right[(1, column)] + self.0[(row, 2)] * right[(2, column)];
            }
        }
        product
    }
}

/// The lower triangular `W` with `WᵀW = Σ⁻¹`, 15×15, or `None` where Σ is not positive definite (no sample yet, a noise density of zero, not finite).
///
/// Variances of the blocks differ by up to ten orders of magnitude. Scaling to a unit diagonal first, `Σ = S C S`, leaves the
/// correlations `C = L Lᵀ`, which f32 can factor; then `W = L⁻¹ S⁻¹`.
///
/// `position_jitter_m` is added to the noise of the position: between two images 50 ms apart, samples alone would tell it to
/// some 20 µm where velocity is given, finer than stamps and mounts are true. That is 2·10⁹ m⁻² of information, whose
/// rounding in f32 exceeds what is known of the scale.
#[must_use]
pub fn sqrt_information<T: Real>(pre: &Preintegration<T>, position_jitter_m: T) -> Option<SMatrix<T, 15, 15>> {
    let mut covariance = pre.covariance();
    for axis in 3..6 {
        covariance[(axis, axis)] += position_jitter_m * position_jitter_m;
    }
    let mut inverse_sigma = SVector::<T, 15>::zeros();
    for (slot, variance) in inverse_sigma.iter_mut().zip(covariance.diagonal().iter()) {
        *slot = T::one() / variance.root();
        if *variance <= T::ZERO || !slot.is_usable() {
            return None;
        }
    }
    let mut correlation = covariance;
    for row in 0..15 {
        for column in 0..15 {
            correlation[(row, column)] *= inverse_sigma[row] * inverse_sigma[column];
        }
    }
    let lower = correlation.cholesky()?.unpack();
    let mut whitening = SMatrix::<T, 15, 15>::from_diagonal(&inverse_sigma);
    if !lower.solve_lower_triangular_mut(&mut whitening) {
        return None;
    }
    whitening.iter().all(|value| value.is_usable()).then_some(whitening)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
