//! Pinhole camera with radial-tangential distortion.
//!
//! # Model
//! For a point `(x, y, z)` in the camera frame, `z > 0`, with `a = x/z`, `b = y/z`, `r² = a² + b²`, `ρ = 1 + k₁r² + k₂r⁴`:
//! ```text
//! a' = a ρ + 2 p₁ab + p₂(r² + 2a²)            u = fx a' + cx
//! b' = b ρ + p₁(r² + 2b²) + 2 p₂ab            v = fy b' + cy
//! D = ∂(a', b')/∂(a, b)                       2×2, symmetric
//! ∂(u, v)/∂(x, y, z) = diag(fx, fy) D [ 1/z 0 −a/z ; 0 1/z −b/z ]      2×3, px/m
//! ```
//! # Degeneracy
//! Beyond the radius where `r ρ(r²)` stops growing, or where `det D ≤ 0`, two points share a pixel: there is no projection.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

use super::monotone::is_positive_up_to;
use super::{Camera, CameraError, check_intrinsics};
use crate::real::Real;
use crate::storage::blank::blank;

/// Pinhole camera with radial-tangential distortion, as OpenCV, Kalibr and EuRoC define it.
///
/// # Example
/// ```
/// use libella_core::camera::{Camera, PinholeRadTan};
/// use nalgebra::{Vector2, Vector3};
/// // cam0 of EuRoC
/// let camera = PinholeRadTan::<f64>::new(
///     (752, 480),
///     [458.654, 457.296],
///     [367.215, 248.375],
///     [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05],
/// )?;
/// let corner = Vector2::new(0.0, 0.0);
/// let bearing = camera.unproject(&corner).expect("inside the field of view");
/// assert!((camera.project(&(bearing * 3.0)).expect("in front") - corner).norm() < 1e-9);
/// assert_eq!(camera.project(&Vector3::new(0.0, 0.0, -1.0)), None);
/// # Ok::<(), libella_core::camera::CameraError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinholeRadTan<T: Real> {
    /// Image width and height, px.
    pub size_px: (u32, u32),
    /// Focal lengths `fx fy`, px.
    pub focal_px: [T; 2],
    /// Principal point `cx cy`, px.
    pub center_px: [T; 2],
    /// `k1 k2 p1 p2`, dimensionless.
    pub distortion: [T; 4],
}

blank!([T: Real] PinholeRadTan<T> { size_px, focal_px, center_px, distortion });

impl<T: Real> PinholeRadTan<T> {
    /// A camera from its calibration: size, `fx fy`, `cx cy` in px, `k1 k2 p1 p2`.
    ///
    /// # Errors
    /// See [`Self::validate`].
    pub fn new(size_px: (u32, u32), focal_px: [T; 2], center_px: [T; 2], distortion: [T; 4]) -> Result<Self, CameraError> {
        let camera = Self { size_px, focal_px, center_px, distortion };
        camera.validate().map(|()| camera)
    }

    /// A camera without distortion.
    ///
    /// # Errors
    /// See [`Self::validate`].
    pub fn ideal(size_px: (u32, u32), focal_px: [T; 2], center_px: [T; 2]) -> Result<Self, CameraError> {
        Self::new(size_px, focal_px, center_px, [T::ZERO; 4])
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
    pub fn cast<U: Real>(&self) -> PinholeRadTan<U> {
        let of = |value: T| U::of(value.as_f64());
        PinholeRadTan {
            size_px: self.size_px,
            focal_px: self.focal_px.map(of),
            center_px: self.center_px.map(of),
            distortion: self.distortion.map(of),
        }
    }

    /// Normalised to distorted coordinates and `D`, or `None` outside the invertible region.
    #[inline]
    fn distort(&self, point: &Vector2<T>) -> Option<(Vector2<T>, Matrix2<T>)> {
        let [k1, k2, p1, p2] = self.distortion;
        let (a, b) = (point.x, point.y);
        let two = T::of(2.0);
        let (aa, bb, ab) = (a * a, b * b, a * b);
        let r2 = aa + bb;
        let radial = T::one() + r2 * (k1 + r2 * k2);
        let slope = (k1 + two * k2 * r2) * two; // dρ/da = slope·a
        let distorted = Vector2::new(a * radial + two * p1 * ab + p2 * (r2 + two * aa), b * radial + p1 * (r2 + two * bb) + two * p2 * ab);
        let cross = slope * ab + two * (p1 * a + p2 * b);
        let jacobian = Matrix2::new(
            radial + slope * aa + two * p1 * b + T::of(6.0) * p2 * a,
            cross,
            cross,
            radial + slope * bb + T::of(6.0) * p1 * b + two * p2 * a,
        );
        // d(rρ)/dr = 1 + 3k₁r² + 5k₂r⁴
        let invertible = is_positive_up_to(&[k1 * T::of(3.0), k2 * T::of(5.0)], r2)
            && jacobian.m11 * jacobian.m22 > cross * cross
            && distorted.x.is_usable()
            && distorted.y.is_usable();
        invertible.then_some((distorted, jacobian))
    }

    /// The normalised coordinates of distorted ones: damped Newton on the distortion, to the last digit.
    fn undistort(&self, distorted: &Vector2<T>) -> Option<Vector2<T>> {
        let half = T::of(0.5);
        // The step that falls below this is still taken, and its square is below the rounding error.
        let tolerance = (T::default_epsilon() * T::of(64.0)).max(T::of(1e-12));
        // The distorted point itself is the start; for barrel distortion Newton then approaches monotonically from within.
        let mut point = *distorted;
        let mut state = self.distort(&point);
        for _ in 0..8 {
            if state.is_some() {
                break;
            }
            point *= half;
            state = self.distort(&point);
        }
        let (mut value, mut jacobian) = state?;
        for _ in 0..30 {
            let residual = distorted - value;
            let step = jacobian.try_inverse()? * residual;
            let size = step.norm_squared();
            if size <= tolerance * tolerance * (T::one() + point.norm_squared()) {
                let solution = point + step;
                return self.distort(&solution).map(|_| solution);
            }
            let mut scale = T::one();
            let (next, evaluated) = loop {
                let candidate = point + step * scale;
                match self.distort(&candidate) {
                    Some(evaluated) if (distorted - evaluated.0).norm_squared() < residual.norm_squared() => break (candidate, evaluated),
                    _ => scale *= half,
                }
                if scale < T::of(1e-3) {
                    return None;
                }
            };
            point = next;
            (value, jacobian) = evaluated;
        }
        None
    }

    #[inline]
    fn normalized(point_in_camera: &Vector3<T>) -> Option<(Vector2<T>, T)> {
        if point_in_camera.z > T::ZERO {
            let inverse_depth = T::one() / point_in_camera.z;
            Some((point_in_camera.xy() * inverse_depth, inverse_depth))
        } else {
            None
        }
    }

    #[inline]
    fn pixel(&self, distorted: &Vector2<T>) -> Vector2<T> {
        Vector2::new(self.focal_px[0] * distorted.x + self.center_px[0], self.focal_px[1] * distorted.y + self.center_px[1])
    }
}

impl<T: Real> Camera<T> for PinholeRadTan<T> {
    #[inline]
    fn project(&self, point_in_camera: &Vector3<T>) -> Option<Vector2<T>> {
        let (point, _) = Self::normalized(point_in_camera)?;
        self.distort(&point).map(|(distorted, _)| self.pixel(&distorted))
    }

    #[inline]
    fn project_with_jacobian(&self, point_in_camera: &Vector3<T>) -> Option<(Vector2<T>, Matrix2x3<T>)> {
        let (point, inverse_depth) = Self::normalized(point_in_camera)?;
        let (distorted, d) = self.distort(&point)?;
        let row = |focal: T, d_a: T, d_b: T| {
            let (d_x, d_y) = (focal * d_a * inverse_depth, focal * d_b * inverse_depth);
            (d_x, d_y, -(d_x * point.x + d_y * point.y))
        };
        let (ux, uy, uz) = row(self.focal_px[0], d.m11, d.m12);
        let (vx, vy, vz) = row(self.focal_px[1], d.m21, d.m22);
        Some((self.pixel(&distorted), Matrix2x3::new(ux, uy, uz, vx, vy, vz)))
    }

    fn unproject(&self, pixel: &Vector2<T>) -> Option<Vector3<T>> {
        let distorted = Vector2::new((pixel.x - self.center_px[0]) / self.focal_px[0], (pixel.y - self.center_px[1]) / self.focal_px[1]);
        let point = self.undistort(&distorted)?;
        Some(Vector3::new(point.x, point.y, T::one()) / (T::one() + point.norm_squared()).root())
    }

    fn focal_px(&self) -> T {
        (self.focal_px[0] + self.focal_px[1]) * T::of(0.5)
    }

    fn size_px(&self) -> (u32, u32) {
        self.size_px
    }
}
