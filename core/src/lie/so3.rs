//! Rotations.
//!
//! # Model
//! Perturbation on the right, `R ⊞ δ = R Exp(δ)`, `R₁ ⊟ R₀ = Log(R₀ᵀ R₁)`, δ in radians.
//! ```text
//! Exp(φ + δ) ≈ Exp(φ) Exp(Jr(φ) δ)        Jr(φ) = I − (1−cos θ)/θ² [φ]× + (θ − sin θ)/θ³ [φ]×²
//! ```

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::real::Real;

/// `[v]×`, with `[v]× w = v × w`.
#[inline]
pub fn hat<T: Real>(v: &Vector3<T>) -> Matrix3<T> {
    let o = T::ZERO;
    Matrix3::new(o, -v.z, v.y, v.z, o, -v.x, -v.y, v.x, o)
}

/// The rotation by the angle `‖φ‖` (rad) about `φ`.
#[inline]
pub fn exp<T: Real>(phi: &Vector3<T>) -> UnitQuaternion<T> {
    let half = T::of(0.5);
    let angle_squared = phi.norm_squared();
    // Below this the next term of the series is under the rounding error of f32 (and of f64 at 1e-4⁴ / 384).
    let (scale, w) = if angle_squared < T::of(1e-8) {
        (half - angle_squared * T::of(1.0 / 48.0), T::one() - angle_squared * T::of(0.125))
    } else {
        let angle = angle_squared.root();
        let (sine, cosine) = (angle * half).sine_cosine();
        (sine / angle, cosine)
    };
    UnitQuaternion::new_unchecked(Quaternion::new(w, phi.x * scale, phi.y * scale, phi.z * scale))
}

/// The rotation vector (rad) of the shorter way, `‖φ‖ ≤ π`.
#[inline]
pub fn log<T: Real>(rotation: &UnitQuaternion<T>) -> Vector3<T> {
    let q = rotation.quaternion();
    let flip = if q.w < T::ZERO { -T::one() } else { T::one() };
    let (w, v) = (q.w * flip, Vector3::new(q.i, q.j, q.k) * flip);
    let sine_squared = v.norm_squared();
    let scale = if sine_squared < T::of(1e-8) {
        // 2 atan(s/w)/s with s → 0, w → 1
        (T::of(2.0) - sine_squared / (w * w) * T::of(2.0 / 3.0)) / w
    } else {
        let sine = sine_squared.root();
        sine.arc_tangent(w) * T::of(2.0) / sine
    };
    v * scale
}

/// The right Jacobian `Jr(φ)`, 3×3.
#[inline]
pub fn right_jacobian<T: Real>(phi: &Vector3<T>) -> Matrix3<T> {
    let angle_squared = phi.norm_squared();
    let (a, b) = if angle_squared < T::of(1e-4) {
        (T::of(0.5) - angle_squared * T::of(1.0 / 24.0), T::of(1.0 / 6.0) - angle_squared * T::of(1.0 / 120.0))
    } else {
        let angle = angle_squared.root();
        let (sine, cosine) = angle.sine_cosine();
        ((T::one() - cosine) / angle_squared, (angle - sine) / (angle_squared * angle))
    };
    let cross = hat(phi);
    Matrix3::identity() - cross * a + cross * cross * b
}

/// The inverse of the right Jacobian, 3×3: `Log(Exp(φ) Exp(δ)) ≈ φ + Jr⁻¹(φ) δ`. Singular at `‖φ‖ = 2π`.
#[inline]
pub fn right_jacobian_inverse<T: Real>(phi: &Vector3<T>) -> Matrix3<T> {
    let angle_squared = phi.norm_squared();
    let b = if angle_squared < T::of(1e-4) {
        T::of(1.0 / 12.0) + angle_squared * T::of(1.0 / 720.0)
    } else {
        let angle = angle_squared.root();
        let (sine, cosine) = angle.sine_cosine();
        T::one() / angle_squared - (T::one() + cosine) / (T::of(2.0) * angle * sine)
    };
    let cross = hat(phi);
    Matrix3::identity() + cross * T::of(0.5) + cross * cross * b
}
