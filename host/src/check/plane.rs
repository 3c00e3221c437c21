//! What one pair of images says: static corners lie in planes with the translation.
//!
//! # Model
//! A corner seen along `f₁`, `f₂` lies in one plane with the translation `t`. With `R` the second camera from the first and `D` the
//! derivative of a bearing by its pixel,
//! ```text
//! g = R f₁,   a₁ = Rᵀ (f₂ × t),   a₂ = t × g
//! r = tᵀ (g × f₂)/s          px       s² = (a₁ᵀ D₁D₁ᵀ a₁ + a₂ᵀ D₂D₂ᵀ a₂)/2
//! R ← Exp(θ) R   ∂r/∂θ = (g × (f₂ × t))/s − r (q₁ × (f₂ × t) + g × (q₂ × t))/2s²      q₁ = R D₁D₁ᵀ a₁,  q₂ = D₂D₂ᵀ a₂
//!                ∂r/∂t = (g × f₂)/s − r (q₁ × f₂ + g × q₂)/2s²
//! ```
//! and by the lens from the residual with neighbouring lenses. Noise of one pixel gives `r` the variance 2 whatever the direction, the
//! rotation or the lens; without the derivatives of `s`, noise would draw all of them to where `s` is large.
//!
//! # Degeneracy
//! With little parallax `p` the direction adapts itself to the noise `σ`, and what it leaves to the rotation is wrong by about
//! `σ²/p`, in the same way for all pairs of a stretch of motion. Pairs count the less for it, and the error is part of the uncertainty.

use libella_core::robust::stats;
use libella_core::track::two_view::{BearingPair, TwoViewConfig, reject_outliers};
use nalgebra::{Matrix2, Matrix3, Matrix3x2, SMatrix, Vector2, Vector3};

use super::fit::{Gradient, Information, LENS, STATES};
use super::lens::{Ray, STEP};
use super::pairs::Pair;

/// Sine below which a bearing is too close to the translation to say much about its plane.
const NEAR_EPIPOLE: f64 = 0.05;
/// Corners that a pair needs: a direction has two degrees of freedom, and the rest must outvote outliers.
const LEAST_CORNERS: usize = 12;

/// What all corners of a pair are seen with.
pub(super) struct View<'a> {
    /// Every corner of the table.
    pub rays: &'a [Option<Ray>],
    /// The same with the lens a step away in each parameter; empty when the lens is held.
    pub near: &'a [Vec<Option<Ray>>],
    /// `R`, second from first.
    pub rotation: Matrix3<f64>,
    /// `∂θ/∂[δX b τ]`.
    pub d_rotation: SMatrix<f64, 3, 7>,
    /// Robust standard deviation of `r`, px.
    pub scale_px: f64,
    pub focal_px: f64,
    /// Number of pairs whose errors may be related.
    pub related: f64,
}

/// What a pair says, its direction eliminated.
pub(super) struct Equations {
    pub information: Information,
    /// Downhill.
    pub gradient: Gradient,
    /// Gradients of the rotation that noise may feign, one per axis of the camera.
    pub tilts: SMatrix<f64, STATES, 3>,
}

fn both(rays: &[Option<Ray>], [first, second]: [usize; 2]) -> Option<[&Ray; 2]> {
    Some([rays.get(first)?.as_ref()?, rays.get(second)?.as_ref()?])
}

impl View<'_> {
    fn corners<'b>(&'b self, pair: &'b Pair) -> impl Iterator<Item = ([usize; 2], [&'b Ray; 2])> {
        pair.places.iter().filter_map(|place| Some((*place, both(self.rays, *place)?)))
    }

    /// Displacements beyond rotation, px.
    pub fn parallaxes_px<'b>(&'b self, pair: &'b Pair) -> impl Iterator<Item = f64> + 'b {
        self.corners(pair).map(|(_, [first, second])| (self.rotation * first.bearing).cross(&second.bearing).norm() * self.focal_px)
    }
}

/// The direction of the translation in a pair.
#[derive(Debug, Clone)]
pub(super) struct Plane {
    direction: Vector3<f64>,
    /// Inverse information, gradient and coupling of the direction, to follow the state's step.
    eliminated: (Matrix2<f64>, Vector2<f64>, SMatrix<f64, STATES, 2>),
}

impl Default for Plane {
    fn default() -> Self {
        Self { direction: Vector3::z(), eliminated: (Matrix2::zeros(), Vector2::zeros(), SMatrix::zeros()) }
    }
}

/// A residual with what its derivatives share.
struct Residual {
    turned: Vector3<f64>,
    normal: Vector3<f64>,
    /// `f₂ × t`.
    arm: Vector3<f64>,
    q: [Vector3<f64>; 2],
    s: f64,
    is_near_epipole: bool,
    r: f64,
}

impl Plane {
    fn residual(&self, rotation: &Matrix3<f64>, [first, second]: [&Ray; 2], least_s: f64) -> Residual {
        let t = self.direction;
        let turned = rotation * first.bearing;
        let normal = turned.cross(&second.bearing);
        let (arm, side) = (second.bearing.cross(&t), t.cross(&turned));
        let back = rotation.tr_mul(&arm);
        let (q_first, q_second) = (first.spread * back, second.spread * side);
        let square = 0.5 * (back.dot(&q_first) + side.dot(&q_second));
        let s = square.max(0.0).sqrt().max(least_s);
        let q = [rotation * q_first, q_second];
        Residual { turned, normal, arm, q, s, is_near_epipole: s <= least_s, r: t.dot(&normal) / s }
    }

    /// Finds the direction that most corners agree on.
    pub fn seed(&mut self, pair: &Pair, view: &View<'_>) {
        let mut seen: Vec<BearingPair> = view
            .corners(pair)
            .map(|(_, [first, second])| BearingPair {
                rotated: (view.rotation * first.bearing).map(|value| value as f32),
                current: second.bearing.map(|value| value as f32),
                is_inlier: true,
            })
            .collect();
        // Without an uncertainty of the rotation, which is what is being sought.
        let config = TwoViewConfig { threshold_px: (2.0 * view.scale_px as f32).clamp(0.5, 4.0), ..TwoViewConfig::DEFAULT };
        let found = reject_outliers(&mut seen, &config, view.focal_px as f32, 1e-4);
        if let Some(direction) = found.map(|found| found.direction.map(f64::from)).filter(|direction| direction.norm() > 0.5) {
            self.direction = direction.normalize();
        }
    }

    /// Information and gradient of the pair, its direction eliminated.
    pub fn equations(&mut self, pair: &Pair, view: &View<'_>, residuals: &mut Vec<f64>) -> Option<Equations> {
        let (t, scale) = (self.direction, view.scale_px);
        let basis = across(&t);
        let least_s = NEAR_EPIPOLE / view.focal_px;
        let (mut h, mut g) = (Information::zeros(), Gradient::zeros());
        // A direction is known to a radian.
        let (mut h_t, mut g_t, mut coupling) = (Matrix2::identity(), Vector2::zeros(), SMatrix::<f64, STATES, 2>::zeros());
        let (mut of_rotation, mut rotation_coupling) = (Matrix3::zeros(), Matrix3x2::zeros());
        let mut parallaxes = Vec::with_capacity(pair.places.len());
        for (place, rays) in view.corners(pair) {
            let Residual { turned, normal, arm, q, s, is_near_epipole, r } = self.residual(&view.rotation, rays, least_s);
            residuals.push(r);
            parallaxes.push(normal.norm());
            let noise = if is_near_epipole { 0.0 } else { 0.5 * r / (s * s) };
            let second = rays[1].bearing;
            let by_rotation = turned.cross(&arm) / s - (q[0].cross(&arm) + turned.cross(&q[1].cross(&t))) * noise;
            let by_direction = normal / s - (q[0].cross(&second) + turned.cross(&q[1])) * noise;
            let mut slope = Gradient::zeros();
            slope.fixed_rows_mut::<7>(0).copy_from(&view.d_rotation.tr_mul(&by_rotation));
            for (k, near) in view.near.iter().enumerate() {
                if let Some(rays) = both(near, place) {
                    slope[LENS + k] = (self.residual(&view.rotation, rays, least_s).r - r) / STEP;
                }
            }
            let slope_t: Vector2<f64> = basis.tr_mul(&by_direction);
            // Geman and McClure's kernel: what is far off says nothing.
            let ratio = r / (2.0 * scale);
            let weight = 1.0 / (1.0 + ratio * ratio).powi(2) / (scale * scale);
            h.syger(weight, &slope, &slope, 1.0);
            g -= slope * (weight * r);
            h_t += slope_t * slope_t.transpose() * weight;
            g_t -= slope_t * (weight * r);
            coupling += slope * slope_t.transpose() * weight;
            of_rotation += by_rotation * by_rotation.transpose() * weight;
            rotation_coupling += by_rotation * slope_t.transpose() * weight;
        }
        if parallaxes.len() < LEAST_CORNERS {
            return None;
        }
        h.fill_upper_triangle_with_lower_triangle();
        let inverse = h_t.try_inverse()?;
        h -= coupling * inverse * coupling.transpose();
        g -= coupling * inverse * g_t;
        self.eliminated = (inverse, g_t, coupling);
        // What noise may turn the pair by, and how much less the pair counts for it.
        let parallax = stats::median(&mut parallaxes)?.max(scale / view.focal_px);
        let tilt = (scale / view.focal_px).powi(2) / parallax;
        let of_rotation = of_rotation - rotation_coupling * inverse * rotation_coupling.transpose();
        let worth = 1.0 / (1.0 + tilt * tilt * of_rotation.trace() / 3.0 * view.related);
        let by_tilt = view.d_rotation.transpose() * of_rotation * (tilt * worth);
        let mut tilts = SMatrix::<f64, STATES, 3>::zeros();
        tilts.fixed_view_mut::<7, 3>(0, 0).copy_from(&by_tilt);
        Some(Equations { information: h * worth, gradient: g * worth, tilts })
    }

    fn turn(&mut self, by: &Vector2<f64>) {
        let length = by.norm();
        let by = if length > 0.3 { by * (0.3 / length) } else { *by };
        let moved = self.direction + across(&self.direction) * by;
        if moved.norm() > 0.1 && moved.iter().all(|value| value.is_finite()) {
            self.direction = moved.normalize();
        }
    }

    /// Moves the direction along with a step of the state.
    pub fn follow(&mut self, step: &Gradient) {
        let (inverse, gradient, coupling) = &self.eliminated;
        let by = inverse * (gradient - coupling.tr_mul(step));
        self.turn(&by);
        self.eliminated.1 = Vector2::zeros();
        self.eliminated.2 = SMatrix::zeros();
    }
}

/// Two directions across a unit vector.
fn across(direction: &Vector3<f64>) -> Matrix3x2<f64> {
    let helper = if direction.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let first = direction.cross(&helper).normalize();
    Matrix3x2::from_columns(&[first, direction.cross(&first)])
}
