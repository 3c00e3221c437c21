//! The inertial factor between two keyframes, integrated anew as the biases move.
//!
//! # An image is not quite where the samples are
//! Stamps jitter and mounts flex: by a millimetre or so the camera is not where exact samples would have it. The estimator adds that to each
//! integral. For one image after another that does; over a flight it says too much, for what one image is off, the next is not. As an error
//! of its own in each link a millimetre is 40 mm/s² at four links a second, which is what accelerations are told by, and corners that
//! are believed while samples are not shrink the scale. So here it belongs to the image: the body is at the keyframe's pose moved by an
//! offset `o = (Q, p_o)` of its own,
//! ```text
//! R_B = R Q     p_B = p + p_o     r_o = [Log Q / σ_φ   p_o / σ_p]                     6×1
//! ∂/∂δφ = ∂/∂δφ_B Qᵀ     ∂/∂δp = ∂/∂δp_B     ∂/∂δo = ∂/∂[δφ_B δp_B]
//! ```
//! The landmarks are seen from `(R, p)`, the samples go from one `(R_B, p_B)` to the next.

use libella_core::factor::imu;
use libella_core::imu::{ImuBias, ImuSample, NavState, Preintegration, stretch};
use libella_core::lie::so3;
use libella_core::time::Timestamp;
use nalgebra::{Isometry3, SMatrix, SVector, Vector3};

use super::{BundleError, BundleSettings, Keyframe, WIDTH};

/// Distance of the bias from where an integral was linearised at which it is made anew, rad/s and m/s²: a tenth of what the estimator
/// allows, because here time is no matter.
const STALE_GYRO_RAD_S: f64 = 2e-4;
const STALE_ACCEL_M_S2: f64 = 5e-3;
/// Noise of the position beside that of the samples, m: so much that an integral of one sample can be weighted.
const LEAST_JITTER_M: f64 = 1e-5;

/// The samples between two keyframes.
#[derive(Debug, Clone)]
pub(super) struct Link {
    pairs: Vec<(ImuSample<f64>, ImuSample<f64>)>,
    integral: Preintegration<f64>,
    root: SMatrix<f64, 15, 15>,
}

/// The factor, linearised: whitened.
#[derive(Debug)]
pub(super) struct LinkLinearization {
    pub residual: SVector<f64, 15>,
    pub by_from: SMatrix<f64, 15, WIDTH>,
    pub by_to: SMatrix<f64, 15, WIDTH>,
}

/// Samples of a closed interval in neighbouring pairs, those at its ends interpolated; `samples` in the order of time.
pub fn pairs_between(
    samples: &[ImuSample<f64>],
    from: Timestamp,
    to: Timestamp,
) -> impl Iterator<Item = (ImuSample<f64>, ImuSample<f64>)> + '_ {
    let first = samples.partition_point(|sample| sample.stamp <= from).saturating_sub(1);
    let end = samples.partition_point(|sample| sample.stamp < to).saturating_add(1).min(samples.len());
    let around = samples.get(first..end).unwrap_or_default();
    around.iter().zip(around.iter().skip(1)).filter_map(move |(a, b)| stretch::clipped(a, b, from, to))
}

/// One link between every two neighbours.
pub(super) fn links(settings: &BundleSettings, keyframes: &[Keyframe], samples: &[ImuSample<f64>]) -> Result<Vec<Link>, BundleError> {
    let ends = samples.first().zip(samples.last());
    let neighbours = keyframes.iter().zip(keyframes.iter().skip(1));
    neighbours
        .map(|(from, to)| {
            if to.stamp <= from.stamp {
                return Err(BundleError::Order(to.stamp));
            }
            if !ends.is_some_and(|(first, last)| first.stamp <= from.stamp && last.stamp >= to.stamp) {
                return Err(BundleError::MissingImu(from.stamp, to.stamp));
            }
            let pairs: Vec<_> = pairs_between(samples, from.stamp, to.stamp).collect();
            if let Some((bad, _)) = pairs.iter().find(|(a, b)| !(a.is_finite() && b.is_finite())) {
                return Err(BundleError::NotFinite(format!("the inertial sample at {}", bad.stamp)));
            }
            Link::new(pairs, settings, from.state.bias).ok_or(BundleError::Noise(to.stamp))
        })
        .collect()
}

impl Link {
    fn new(pairs: Vec<(ImuSample<f64>, ImuSample<f64>)>, settings: &BundleSettings, bias: ImuBias<f64>) -> Option<Self> {
        let integral = stretch::integrate(pairs.iter().copied(), &settings.imu_noise, &settings.imu_range, bias);
        let root = imu::sqrt_information(&integral, LEAST_JITTER_M)?;
        Some(Self { pairs, integral, root })
    }

    /// Integrates anew where the bias has moved. What cannot be weighted is left as it was.
    pub fn refresh(&mut self, settings: &BundleSettings, bias: &ImuBias<f64>) {
        if !self.integral.bias_is_beyond(bias, STALE_GYRO_RAD_S, STALE_ACCEL_M_S2) {
            return;
        }
        let integral = stretch::integrate(self.pairs.iter().copied(), &settings.imu_noise, &settings.imu_range, *bias);
        if let Some(root) = imu::sqrt_information(&integral, LEAST_JITTER_M) {
            (self.integral, self.root) = (integral, root);
        }
    }

    /// `‖W r‖²`.
    pub fn cost(&self, settings: &BundleSettings, from: &Keyframe, to: &Keyframe) -> f64 {
        (self.root * imu::residual(&self.integral, &settings.gravity_in_world, &from.body(), &to.body())).norm_squared()
    }

    pub fn linearize(&self, settings: &BundleSettings, from: &Keyframe, to: &Keyframe) -> LinkLinearization {
        let (start, end) = (from.body(), to.body());
        let linear = imu::linearize(&self.integral, &settings.gravity_in_world, &self.root, &start, &end, &start, &end);
        LinkLinearization {
            residual: linear.residual,
            by_from: with_offset(&linear.d_residual_d_from, from),
            by_to: with_offset(&linear.d_residual_d_to, to),
        }
    }
}

/// Slopes along the state of the body become those along the keyframe.
fn with_offset(by_body: &SMatrix<f64, 15, 15>, keyframe: &Keyframe) -> SMatrix<f64, 15, WIDTH> {
    let mut out = SMatrix::<f64, 15, WIDTH>::zeros();
    out.fixed_columns_mut::<15>(0).copy_from(by_body);
    out.fixed_columns_mut::<6>(15).copy_from(&by_body.fixed_columns::<6>(0));
    let from_offset = keyframe.offset.rotation.inverse().to_rotation_matrix();
    out.fixed_columns_mut::<3>(0).copy_from(&(by_body.fixed_columns::<3>(0) * from_offset.matrix()));
    out
}

impl Keyframe {
    /// Where the inertial samples are.
    #[must_use]
    pub fn body(&self) -> NavState<f64> {
        NavState {
            world_from_body: self.state.world_from_body * self.offset.rotation,
            position_in_world: self.state.position_in_world + self.offset.translation.vector,
            ..self.state
        }
    }

    /// Moved by `[δφ δp δv δb_g δb_a δo]`.
    pub(super) fn retract(&self, delta: &[f64; WIDTH]) -> Self {
        let (state, offset) = delta.split_at(15);
        let part = |at: usize| Vector3::new(offset[at], offset[at + 1], offset[at + 2]);
        let mut whole = [0.0; 15];
        whole.copy_from_slice(state);
        let rotation = self.offset.rotation * so3::exp(&part(0));
        let translation = self.offset.translation.vector + part(3);
        Self { state: self.state.retract(&whole), offset: Isometry3::from_parts(translation.into(), rotation), ..*self }
    }

    /// `r_o`, not whitened, and its slope along `δφ_o`.
    pub(super) fn offset_residual(&self) -> ([Vector3<f64>; 2], nalgebra::Matrix3<f64>) {
        let turned = so3::log(&self.offset.rotation);
        ([turned, self.offset.translation.vector], so3::right_jacobian_inverse(&turned))
    }
}
