//! Directions: unit vectors with two degrees of freedom.
//!
//! # Model
//! With `B(n)` ∈ ℝ³ˣ² an orthonormal basis of the plane at right angles to `n`, and `θ = ‖δ‖` the angle (rad) between the two directions:
//! ```text
//! n ⊞ δ = cos θ n + sin θ/θ Bδ
//! ∂(n ⊞ δ)/∂δ = σ B + (k Bδ − σ n) δᵀ          3×2, σ = sin θ/θ, k = (cos θ − σ)/θ²
//! m ⊟ n = φ w,  w = Bᵀm,  c = nᵀm,  φ = θ/sin θ = atan2(‖w‖, c)/‖w‖
//! ∂(m ⊟ n)/∂m = φ Bᵀ + w (h wᵀBᵀ − nᵀ)         2×3, h = (c − φ)/‖w‖²
//! ```
//! To first order `n ⊞ δ = normalize(n + Bδ)`.
//!
//! # Degeneracy
//! `⊞` has none. `m ⊟ n` is `(π, 0)` at the antipode `m = −n`, where every direction leads there. `B` is regular everywhere; it jumps
//! where `n` crosses the horizon `n_z = 0`, as some jump is unavoidable on a sphere, so that one `δ` belongs to one `n`.

use nalgebra::{Matrix2x3, Matrix3x2, UnitVector3, Vector2, Vector3};

use crate::real::Real;

/// An orthonormal basis `B` of the tangent plane at `n`, 3×2: `BᵀB = I`, `Bᵀn = 0`.
///
/// The first two columns of the Householder reflection that takes `n` to `±z`, to the side that does not cancel.
#[inline]
#[must_use]
pub fn tangent_basis<T: Real>(n: &UnitVector3<T>) -> Matrix3x2<T> {
    // H = I − v vᵀ/(1 + |n_z|) with v = n ± e_z, ‖v‖² = 2(1 + |n_z|)
    let up = if n.z < T::ZERO { -T::one() } else { T::one() };
    let (v_x, v_y, v_z) = (n.x, n.y, n.z + up);
    let scale = T::one() / (T::one() + n.z.abs());
    let (s_x, s_y) = (scale * v_x, scale * v_y);
    Matrix3x2::new(T::one() - s_x * v_x, -s_y * v_x, -s_x * v_y, T::one() - s_y * v_y, -s_x * v_z, -s_y * v_z)
}

/// `n ⊞ δ`: the direction reached from `n` by the angle `‖δ‖` (rad) along `B(n) δ`.
#[inline]
#[must_use]
pub fn boxplus<T: Real>(n: &UnitVector3<T>, delta: &Vector2<T>) -> UnitVector3<T> {
    let (sinc, cosine, _) = series(delta.norm_squared());
    UnitVector3::new_normalize(n.into_inner() * cosine + tangent_basis(n) * delta * sinc)
}

/// `∂(n ⊞ δ)/∂δ`, 3×2; `B(n)` at `δ = 0`.
#[inline]
#[must_use]
pub fn boxplus_jacobian<T: Real>(n: &UnitVector3<T>, delta: &Vector2<T>) -> Matrix3x2<T> {
    let (sinc, _, bend) = series(delta.norm_squared());
    let basis = tangent_basis(n);
    basis * sinc + (basis * delta * bend - n.into_inner() * sinc) * delta.transpose()
}

/// `m ⊟ n`: the tangent vector (rad) at `n` that leads to `m`, such that `n ⊞ (m ⊟ n) = m`; `(π, 0)` at the antipode.
#[inline]
#[must_use]
pub fn boxminus<T: Real>(m: &UnitVector3<T>, n: &UnitVector3<T>) -> Vector2<T> {
    let w = tangent_basis(n).transpose() * m.into_inner();
    if w.norm_squared() == T::ZERO && n.dot(m) < T::ZERO {
        return Vector2::new(T::pi(), T::ZERO);
    }
    w * stretch(&w, n.dot(m))
}

/// `∂(m ⊟ n)/∂m`, 2×3, for changes of `m` on the sphere; infinite at the antipode.
#[inline]
#[must_use]
pub fn boxminus_jacobian<T: Real>(m: &UnitVector3<T>, n: &UnitVector3<T>) -> Matrix2x3<T> {
    let basis = tangent_basis(n);
    let (w, cosine) = (basis.transpose() * m.into_inner(), n.dot(m));
    let phi = stretch(&w, cosine);
    let sine_squared = w.norm_squared();
    let h = if cosine > T::ZERO && sine_squared < T::of(1e-4) {
        // √(1−s²) − asin(s)/s = −2s²/3 − s⁴/5 − …
        -T::of(2.0 / 3.0) - sine_squared * T::of(0.2)
    } else {
        (cosine - phi) / sine_squared
    };
    basis.transpose() * phi + w * ((basis * w) * h - n.into_inner()).transpose()
}

/// The angle between two directions, rad, precise at both ends.
#[inline]
#[must_use]
pub fn angle<T: Real>(m: &UnitVector3<T>, n: &UnitVector3<T>) -> T {
    let cross: Vector3<T> = m.cross(n);
    cross.norm_squared().root().arc_tangent(m.dot(n))
}

/// `sin θ/θ`, `cos θ` and `(cos θ − sin θ/θ)/θ²`.
#[inline]
fn series<T: Real>(angle_squared: T) -> (T, T, T) {
    let angle = angle_squared.root();
    let (sine, cosine) = angle.sine_cosine();
    if angle_squared < T::of(1e-4) {
        // 1 − θ²/6 + θ⁴/120, −1/3 + θ²/30
        let sinc = T::one() - angle_squared * (T::of(1.0 / 6.0) - angle_squared * T::of(1.0 / 120.0));
        (sinc, cosine, angle_squared * T::of(1.0 / 30.0) - T::of(1.0 / 3.0))
    } else {
        let sinc = sine / angle;
        (sinc, cosine, (cosine - sinc) / angle_squared)
    }
}

/// `θ/sin θ` from `w = Bᵀm` and `cos θ`.
#[inline]
fn stretch<T: Real>(w: &Vector2<T>, cosine: T) -> T {
    let sine_squared = w.norm_squared();
    if cosine > T::ZERO && sine_squared < T::of(1e-8) {
        return T::one() + sine_squared * T::of(1.0 / 6.0); // asin(s)/s
    }
    let sine = sine_squared.root();
    sine.arc_tangent(cosine) / sine
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_close, numerical_jacobian};
    use core::f64::consts::PI;
    use nalgebra::Matrix2;
    use proptest::prelude::*;

    /// Anywhere on the sphere, often close to a pole or on the horizon.
    fn unit() -> impl Strategy<Value = UnitVector3<f64>> {
        (prop::array::uniform3(-1.0f64..1.0), 0..4).prop_filter_map("has a direction", |(v, kind)| {
            let v = match kind {
                0 => Vector3::new(v[0] * 1e-6, v[1] * 1e-6, -1.0),
                1 => Vector3::new(v[0], v[1], 0.0),
                _ => Vector3::from(v),
            };
            UnitVector3::try_new(v, 0.1)
        })
    }

    prop_compose! {
        fn tangent(limit: f64)(turn in -PI..PI, size in 1e-3..limit, power in 0..9i32) -> Vector2<f64> {
            Vector2::new(turn.cos(), turn.sin()) * (size * 10f64.powi(-power))
        }
    }

    fn assert_basis<T: Real>(n: &UnitVector3<T>, tolerance: f64) {
        let basis = tangent_basis(n);
        assert!((basis.transpose() * basis - Matrix2::identity()).norm().as_f64() < tolerance);
        assert!((basis.transpose() * n.into_inner()).norm().as_f64() < tolerance);
    }

    proptest! {
        #[test]
        fn the_basis_is_orthonormal_everywhere(n in unit()) {
            assert_basis(&n, 1e-15 * 4.0);
            assert_basis(&UnitVector3::new_normalize(n.into_inner().cast::<f32>()), 1e-6);
        }

        #[test]
        fn boxminus_inverts_boxplus(n in unit(), delta in tangent(3.1)) {
            let m = boxplus(&n, &delta);
            prop_assert!((m.norm() - 1.0).abs() < 1e-15 * 4.0);
            prop_assert!((boxminus(&m, &n) - delta).norm() < 1e-13);
            prop_assert!((angle(&m, &n) - delta.norm()).abs() < 1e-14);
        }

        #[test]
        fn boxplus_inverts_boxminus(n in unit(), m in unit()) {
            prop_assert!((boxplus(&n, &boxminus(&m, &n)).into_inner() - m.into_inner()).norm() < 1e-13);
        }

        #[test]
        fn boxplus_jacobian_matches_central_differences(n in unit(), delta in tangent(3.1)) {
            let numerical = numerical_jacobian(1e-5, |d| boxplus(&n, &(delta + d)).into_inner());
            assert_close(&boxplus_jacobian(&n, &delta), &numerical, 1e-8);
        }

        #[test]
        fn boxminus_jacobian_matches_central_differences(n in unit(), delta in tangent(3.0)) {
            // m moves on the sphere by its own ⊞, whose Jacobian at zero is B(m).
            let m = boxplus(&n, &delta);
            let numerical: Matrix2<f64> = numerical_jacobian(1e-5, |d| boxminus(&boxplus(&m, d), &n));
            assert_close(&(boxminus_jacobian(&m, &n) * tangent_basis(&m)), &numerical, 1e-7);
        }

        #[test]
        fn the_jacobians_are_inverse_to_each_other(n in unit(), delta in tangent(3.0)) {
            let m = boxplus(&n, &delta);
            let product = boxminus_jacobian(&m, &n) * boxplus_jacobian(&n, &delta);
            prop_assert!((product - Matrix2::identity()).norm() < 1e-11);
        }

        #[test]
        fn single_precision_agrees(n in unit(), delta in tangent(3.0)) {
            let single = UnitVector3::new_normalize(n.into_inner().cast::<f32>());
            let m = boxplus(&single, &delta.cast::<f32>());
            prop_assert!((boxminus(&m, &single).cast::<f64>() - delta).norm() < 3e-6);
        }
    }

    #[test]
    fn poles_and_antipodes() {
        for n in [Vector3::z_axis(), -Vector3::z_axis(), Vector3::x_axis(), -Vector3::y_axis()] {
            assert_basis::<f64>(&n, 1e-15);
            let minus = UnitVector3::new_unchecked(-n.into_inner());
            assert_eq!(boxminus(&minus, &n), Vector2::new(PI, 0.0));
            assert!((boxplus(&n, &Vector2::new(PI, 0.0)).into_inner() - minus.into_inner()).norm() < 1e-15);
            assert_eq!(boxminus(&n, &n), Vector2::zeros());
        }
    }
}
