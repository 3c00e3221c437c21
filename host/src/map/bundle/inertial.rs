//! The inertial factor between two keyframes, integrated anew as the biases move.
//!
//! The estimator adds a millimetre of noise to each position that samples predict: stamps jitter, mounts flex, and `f32` needs it. As an error
//! of its own in every link of a whole flight that says too much: at four links a second a millimetre is 40 mm/s², and accelerations, which
//! alone tell the scale, are not believed any more. On the rendered V1_01 the scale was then off by 1.50 % instead of 0.90 %.

use libella_core::factor::imu::{self, ImuLinearization};
use libella_core::imu::{ImuBias, ImuSample, NavState, Preintegration, stretch};
use libella_core::time::Timestamp;
use nalgebra::SMatrix;

use super::{BundleError, BundleSettings, Keyframe};

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
    pub fn cost(&self, settings: &BundleSettings, from: &NavState<f64>, to: &NavState<f64>) -> f64 {
        (self.root * imu::residual(&self.integral, &settings.gravity_in_world, from, to)).norm_squared()
    }

    pub fn linearize(&self, settings: &BundleSettings, from: &NavState<f64>, to: &NavState<f64>) -> ImuLinearization<f64> {
        imu::linearize(&self.integral, &settings.gravity_in_world, &self.root, from, to, from, to)
    }
}
