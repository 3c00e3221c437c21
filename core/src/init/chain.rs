//! The motion as the inertial samples alone have it, in the body frame of the first image.
//!
//! # Model
//! With `(ΔR, Δv, Δp, Δt)` between neighbours and `v₀`, `g` in the first body frame,
//! ```text
//! R_{i+1} = R_i ΔR        β_{i+1} = β_i + R_i Δv       α_{i+1} = α_i + β_i Δt + R_i Δp
//! v_i = v₀ + g t_i + β_i                               p_i = v₀ t_i + ½ g t_i² + α_i
//! ```
//! and to first order in the biases, `R_i(b + δb) = R_i Exp(φ_i δb_g)`,
//! ```text
//! φ_{i+1} = ΔRᵀ φ_i + ∂ΔR        δβ_{i+1} = δβ_i + R_i (∂Δv − [Δv]× φ_i)
//! ```

use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

use crate::imu::{ImuBias, Preintegration};
use crate::lie::matrix::{of_rotation, product, sum, transposed_product};
use crate::lie::so3;
use crate::real::Real;

/// Most frames that the moving start takes.
pub const MAX_INIT_FRAMES: usize = 12;

/// What the inertial samples say about the motion from one frame to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertialLink<T: Real> {
    /// Length, s.
    pub span_s: T,
    /// Bias at which the deltas were integrated.
    pub bias: ImuBias<T>,
    /// `ΔR`.
    pub rotation: UnitQuaternion<T>,
    /// `Δv`, m/s.
    pub velocity: Vector3<T>,
    /// `Δp`, m.
    pub position: Vector3<T>,
    /// `∂Log ΔR/∂b_g`, perturbation on the right, 3×3.
    pub d_rotation_d_gyro: Matrix3<T>,
    /// `∂Δv/∂[b_g b_a]`, 3×6.
    pub d_velocity_d_bias: SMatrix<T, 3, 6>,
    /// `∂Δp/∂[b_g b_a]`, 3×6.
    pub d_position_d_bias: SMatrix<T, 3, 6>,
}

impl<T: Real> From<&Preintegration<T>> for InertialLink<T> {
    /// The bias Jacobians are read off the first-order correction, which is linear in velocity and position.
    fn from(integral: &Preintegration<T>) -> Self {
        let bias = *integral.bias();
        let (rotation, velocity, position) = integral.corrected(&bias);
        let mut link = Self {
            span_s: integral.span_s(),
            bias,
            rotation,
            velocity,
            position,
            d_rotation_d_gyro: *integral.d_rotation_d_gyro(),
            d_velocity_d_bias: SMatrix::zeros(),
            d_position_d_bias: SMatrix::zeros(),
        };
        let step = T::of(0.125);
        for column in 0..6 {
            let mut moved = bias;
            let part = if column < 3 { &mut moved.gyro_rad_s } else { &mut moved.accel_m_s2 };
            part[column % 3] += step;
            let (_, moved_velocity, moved_position) = integral.corrected(&moved);
            link.d_velocity_d_bias.set_column(column, &((moved_velocity - velocity) / step));
            link.d_position_d_bias.set_column(column, &((moved_position - position) / step));
        }
        link
    }
}

impl<T: Real> InertialLink<T> {
    /// `(ΔR, ∂Log ΔR/∂b_g)` at another gyro bias, to first order.
    pub(super) fn rotation_at(&self, gyro_bias_rad_s: &Vector3<T>) -> (UnitQuaternion<T>, Matrix3<T>) {
        let turn = self.d_rotation_d_gyro * (gyro_bias_rad_s - self.bias.gyro_rad_s);
        (self.rotation * so3::exp(&turn), product(&so3::right_jacobian(&turn), &self.d_rotation_d_gyro))
    }
}

/// One frame of the chain, relative to the first body frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node<T: Real> {
    pub time_s: T,
    pub first_from_body: UnitQuaternion<T>,
    /// `β`, m/s, and `α`, m.
    pub velocity: Vector3<T>,
    pub position: Vector3<T>,
    /// `φ`, 3×3.
    pub d_rotation_d_gyro: Matrix3<T>,
    /// `∂β/∂[b_g b_a]` and `∂α/∂[b_g b_a]`, 3×6.
    pub d_velocity_d_bias: SMatrix<T, 3, 6>,
    pub d_position_d_bias: SMatrix<T, 3, 6>,
    /// `∂β/∂ḃ_a` and `∂α/∂ḃ_a`, 3×3: an accelerometer bias that grows with time.
    pub d_velocity_d_drift: Matrix3<T>,
    pub d_position_d_drift: Matrix3<T>,
}

impl<T: Real> Node<T> {
    fn first() -> Self {
        Self {
            time_s: T::ZERO,
            first_from_body: UnitQuaternion::identity(),
            velocity: Vector3::zeros(),
            position: Vector3::zeros(),
            d_rotation_d_gyro: Matrix3::zeros(),
            d_velocity_d_bias: SMatrix::zeros(),
            d_position_d_bias: SMatrix::zeros(),
            d_velocity_d_drift: Matrix3::zeros(),
            d_position_d_drift: Matrix3::zeros(),
        }
    }

    /// To the end of a link.
    #[inline(never)]
    fn advance(&mut self, link: &InertialLink<T>, bias: &ImuBias<T>) {
        let (rotation, d_rotation) = link.rotation_at(&bias.gyro_rad_s);
        let moved = bias_vector(bias) - bias_vector(&link.bias);
        let velocity = link.velocity + product(&link.d_velocity_d_bias, &moved);
        let position = link.position + product(&link.d_position_d_bias, &moved);
        let turned = of_rotation(&self.first_from_body);
        let turn = |delta: &Vector3<T>, d_delta: &SMatrix<T, 3, 6>| {
            let mut sensitivity = *d_delta;
            let mut gyro = sensitivity.fixed_columns_mut::<3>(0);
            gyro -= product(&so3::hat(delta), &self.d_rotation_d_gyro);
            product(&turned, &sensitivity)
        };
        // The drift stands at its mean over the link.
        let middle_s = self.time_s + link.span_s * T::of(0.5);
        let drifted = |d_delta: &SMatrix<T, 3, 6>| product(&turned, &d_delta.fixed_columns::<3>(3).into_owned()) * middle_s;
        *self = Self {
            d_velocity_d_drift: self.d_velocity_d_drift + drifted(&link.d_velocity_d_bias),
            d_position_d_drift: self.d_position_d_drift + self.d_velocity_d_drift * link.span_s + drifted(&link.d_position_d_bias),
            time_s: self.time_s + link.span_s,
            first_from_body: self.first_from_body * rotation,
            velocity: self.velocity + turned * velocity,
            position: self.position + self.velocity * link.span_s + turned * position,
            d_rotation_d_gyro: sum(&transposed_product(&of_rotation(&rotation), &self.d_rotation_d_gyro), &d_rotation),
            d_velocity_d_bias: self.d_velocity_d_bias + turn(&velocity, &link.d_velocity_d_bias),
            d_position_d_bias: self.d_position_d_bias + self.d_velocity_d_bias * link.span_s + turn(&position, &link.d_position_d_bias),
        };
    }
}

/// `[b_g b_a]`.
pub(super) fn bias_vector<T: Real>(bias: &ImuBias<T>) -> SMatrix<T, 6, 1> {
    let (g, a) = (&bias.gyro_rad_s, &bias.accel_m_s2);
    SMatrix::<T, 6, 1>::new(g.x, g.y, g.z, a.x, a.y, a.z)
}

/// Shows every frame of the chain at one bias, with its number, one after the other: kept together they would take a fifth of the
/// stack of a microcontroller.
pub(super) fn walk<T: Real>(links: &[InertialLink<T>], bias: &ImuBias<T>, mut visit: impl FnMut(usize, &Node<T>)) {
    let mut node = Node::first();
    visit(0, &node);
    for (frame, link) in (1..).zip(links) {
        node.advance(link, bias);
        visit(frame, &node);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{SVector, Vector3};

    use super::*;
    use crate::testing::{assert_close, numerical_jacobian};

    fn links() -> [InertialLink<f64>; 4] {
        core::array::from_fn(|i| {
            let s = 1.0 + i as f64;
            let fill = |k: f64| SMatrix::<f64, 3, 6>::from_fn(|r, c| 0.1 * (k * s + r as f64 * 1.7 + c as f64 * 0.9).sin());
            InertialLink {
                span_s: 0.1 * s,
                bias: ImuBias { gyro_rad_s: Vector3::new(0.01, 0.02, -0.03), accel_m_s2: Vector3::new(0.1, -0.1, 0.05) },
                rotation: so3::exp(&Vector3::new(0.1 * s, -0.2, 0.05 * s)),
                velocity: Vector3::new(0.3, -0.2 * s, 0.5),
                position: Vector3::new(0.03 * s, 0.02, -0.05),
                d_rotation_d_gyro: fill(0.3).fixed_columns::<3>(0).into_owned(),
                d_velocity_d_bias: fill(1.1),
                d_position_d_bias: fill(2.3),
            }
        })
    }

    #[test]
    fn sensitivities_match_central_differences() {
        let links = links();
        let at = |d: &SVector<f64, 6>| {
            let bias = ImuBias {
                gyro_rad_s: Vector3::new(0.05, -0.02, 0.07) + d.fixed_rows::<3>(0),
                accel_m_s2: Vector3::new(0.1, 0.2, 0.3) + d.fixed_rows::<3>(3),
            };
            let mut last = Node::first();
            walk(&links, &bias, |frame, node| {
                if frame == 4 {
                    last = *node;
                }
            });
            last
        };
        let base = at(&SVector::zeros());
        let numerical = numerical_jacobian::<9, 6>(1e-6, |d| {
            let node = at(d);
            let mut all = SVector::<f64, 9>::zeros();
            all.fixed_rows_mut::<3>(0).copy_from(&so3::log(&(base.first_from_body.inverse() * node.first_from_body)));
            all.fixed_rows_mut::<3>(3).copy_from(&node.velocity);
            all.fixed_rows_mut::<3>(6).copy_from(&node.position);
            all
        });
        assert_close(&base.d_rotation_d_gyro, &numerical.fixed_view::<3, 3>(0, 0).into_owned(), 1e-7);
        assert_close(&base.d_velocity_d_bias, &numerical.fixed_view::<3, 6>(3, 0).into_owned(), 1e-7);
        assert_close(&base.d_position_d_bias, &numerical.fixed_view::<3, 6>(6, 0).into_owned(), 1e-7);
    }
}
