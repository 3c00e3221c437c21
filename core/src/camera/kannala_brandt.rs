//! Equidistant fisheye camera.
//!
//! # Model
//! For a point `(x, y, z)` in the camera frame with `r² = x² + y²`, `R² = r² + z²`, the angle from the axis `θ = atan2(r, z)` and
//! `d(θ) = θ (1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸)`:
//! ```text
//! (a, b) = d(θ)/r (x, y)                      u = fx a + cx,  v = fy b + cy
//! ∂(a, b)/∂(x, y) = s I + (d' z/R² − s) e eᵀ   s = d/r, e = (x, y)/r      2×2
//! ∂(a, b)/∂z = −d' r/R² e                                                2×1
//! ```
//! # Degeneracy
//! Points beyond 90° from the axis project too, as far as `d(θ)` grows; straight behind the camera no direction is left.

use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::monotone::is_positive_up_to;
use super::{Camera, CameraError, check_intrinsics};
use crate::real::Real;

/// Fisheye camera of Kannala and Brandt with four coefficients, as OpenCV (`fisheye`), Kalibr (`equidistant`) and TUM-VI define it.
///
/// # Example
/// ```
/// use libella_core::camera::{Camera, KannalaBrandt};
/// use nalgebra::Vector3;
/// // cam0 of TUM-VI, 512×512
/// let camera = KannalaBrandt::<f64>::new(
///     (512, 512),
///     [190.978, 190.973],
///     [254.932, 256.897],
///     [0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182],
/// )?;
/// // Three degrees behind the image plane, and still seen.
/// assert!(camera.project(&Vector3::new(1.0, 0.0, -0.05)).is_some());
/// # Ok::<(), libella_core::camera::CameraError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KannalaBrandt<T: Real> {
    /// Image width and height, px.
    pub size_px: (u32, u32),
    /// Focal lengths `fx fy`, px.
    pub focal_px: [T; 2],
    /// Principal point `cx cy`, px.
    pub center_px: [T; 2],
    /// `k1 k2 k3 k4`, dimensionless.
    pub distortion: [T; 4],
}

/// `d(θ)/r` and `d'(θ) z/R²`, `d'(θ)/R²`, with `e = (x, y)/r`.
struct Radial<T: Real> {
    scale: T,
    d_radius: T,
    d_depth: T,
    direction: Vector2<T>,
}

impl<T: Real> KannalaBrandt<T> {
    /// A camera from its calibration: size, `fx fy`, `cx cy` in px, `k1 k2 k3 k4`.
    ///
    /// # Errors
    /// See [`Self::validate`].
    pub fn new(size_px: (u32, u32), focal_px: [T; 2], center_px: [T; 2], distortion: [T; 4]) -> Result<Self, CameraError> {
        let camera = Self { size_px, focal_px, center_px, distortion };
        camera.validate().map(|()| camera)
    }

    /// Whether the numbers can be those of a camera.
    ///
    /// # Errors
    /// An empty image, a focal length that is not positive, a number that is not finite.
    pub fn validate(&self) -> Result<(), CameraError> {
        check_intrinsics(self.size_px, &self.focal_px, &self.center_px, &self.distortion)
    }

    /// The same camera in another scalar.
    #[must_use]
    pub fn cast<U: Real>(&self) -> KannalaBrandt<U> {
        let of = |value: T| U::of(value.as_f64());
        KannalaBrandt {
            size_px: self.size_px,
            focal_px: self.focal_px.map(of),
            center_px: self.center_px.map(of),
            distortion: self.distortion.map(of),
        }
    }

    /// `d(θ)` and `d'(θ)`, or `None` where `d` has stopped growing.
    #[inline]
    fn radius(&self, angle: T) -> Option<(T, T)> {
        let [k1, k2, k3, k4] = self.distortion;
        let derivative = [k1 * T::of(3.0), k2 * T::of(5.0), k3 * T::of(7.0), k4 * T::of(9.0)];
        let squared = angle * angle;
        if !is_positive_up_to(&derivative, squared) {
            return None;
        }
        let series = |[a, b, c, d]: [T; 4]| T::one() + squared * (a + squared * (b + squared * (c + squared * d)));
        Some((angle * series(self.distortion), series(derivative)))
    }

    /// The angle (rad) of a radius: damped Newton, to the last digit.
    fn angle(&self, radius: T) -> Option<T> {
        let half = T::of(0.5);
        // The step that falls below this is still taken, and its square is below the rounding error.
        let tolerance = (T::default_epsilon() * T::of(64.0)).max(T::of(1e-12));
        let mut angle = radius;
        let mut state = self.radius(angle);
        for _ in 0..8 {
            if state.is_some() {
                break;
            }
            angle *= half;
            state = self.radius(angle);
        }
        let (mut value, mut slope) = state?;
        for _ in 0..30 {
            let residual = radius - value;
            let step = residual / slope;
            if step.abs() <= tolerance * (T::one() + angle) {
                let solution = angle + step;
                return self.radius(solution).map(|_| solution).filter(|solution| *solution < T::pi());
            }
            let mut scale = T::one();
            let (next, evaluated) = loop {
                let candidate = angle + step * scale;
                match self.radius(candidate) {
                    Some(evaluated) if (radius - evaluated.0).abs() < residual.abs() => break (candidate, evaluated),
                    _ => scale *= half,
                }
                if scale < T::of(1e-3) {
                    return None;
                }
            };
            angle = next;
            (value, slope) = evaluated;
        }
        None
    }

    #[inline]
    fn radial(&self, point: &Vector3<T>) -> Option<Radial<T>> {
        let lateral_squared = point.xy().norm_squared();
        let depth_squared = point.z * point.z;
        if lateral_squared <= depth_squared * T::default_epsilon() {
            // d(θ)/r = (1 + O(θ²))/z, and θ² is below the rounding error
            let inverse_depth = T::one() / point.z;
            let on_axis = Radial {
                scale: inverse_depth,
                d_radius: inverse_depth,
                d_depth: inverse_depth * inverse_depth,
                direction: Vector2::zeros(),
            };
            return (point.z > T::ZERO && inverse_depth.is_usable()).then_some(on_axis);
        }
        let lateral = lateral_squared.root();
        let (radius, slope) = self.radius(lateral.arc_tangent(point.z))?;
        let d_depth = slope / (lateral_squared + depth_squared);
        let scale = radius / lateral;
        (scale.is_usable() && d_depth.is_usable()).then(|| Radial {
            scale,
            d_radius: d_depth * point.z,
            d_depth,
            direction: point.xy() / lateral,
        })
    }

    #[inline]
    fn pixel(&self, radial: &Radial<T>, point: &Vector3<T>) -> Vector2<T> {
        Vector2::new(
            self.focal_px[0] * (radial.scale * point.x) + self.center_px[0],
            self.focal_px[1] * (radial.scale * point.y) + self.center_px[1],
        )
    }
}

impl<T: Real> Camera<T> for KannalaBrandt<T> {
    #[inline]
    fn project(&self, point_in_camera: &Vector3<T>) -> Option<Vector2<T>> {
        self.radial(point_in_camera).map(|radial| self.pixel(&radial, point_in_camera))
    }

    #[inline]
    fn project_with_jacobian(&self, point_in_camera: &Vector3<T>) -> Option<(Vector2<T>, Matrix2x3<T>)> {
        let radial = self.radial(point_in_camera)?;
        let e = radial.direction;
        let bend = radial.d_radius - radial.scale;
        let [fx, fy] = self.focal_px;
        let jacobian = Matrix2x3::new(
            fx * (radial.scale + bend * e.x * e.x),
            fx * bend * e.x * e.y,
            -fx * radial.d_depth * point_in_camera.x,
            fy * bend * e.x * e.y,
            fy * (radial.scale + bend * e.y * e.y),
            -fy * radial.d_depth * point_in_camera.y,
        );
        Some((self.pixel(&radial, point_in_camera), jacobian))
    }

    fn unproject(&self, pixel: &Vector2<T>) -> Option<Vector3<T>> {
        let plane = Vector2::new((pixel.x - self.center_px[0]) / self.focal_px[0], (pixel.y - self.center_px[1]) / self.focal_px[1]);
        let radius_squared = plane.norm_squared();
        if radius_squared <= T::default_epsilon() {
            // sin θ / d = 1 + O(θ²)
            return Some(Vector3::new(plane.x, plane.y, T::one() - radius_squared * T::of(0.5)));
        }
        let radius = radius_squared.root();
        let (sine, cosine) = self.angle(radius)?.sine_cosine();
        Some(Vector3::new(plane.x * sine / radius, plane.y * sine / radius, cosine))
    }

    fn focal_px(&self) -> T {
        (self.focal_px[0] + self.focal_px[1]) * T::of(0.5)
    }

    fn size_px(&self) -> (u32, u32) {
        self.size_px
    }
}
