//! How well the biases are known.

use nalgebra::Vector3;

use super::{Estimator, Health};
use crate::imu::ImuBias;
use crate::real::Real;
use crate::solve::newest_bias_variances;

impl<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>
    Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>
{
    /// Standard deviations of the biases of the newest state, rad/s and m/s², while there is one.
    ///
    /// Asked for between steps and computed then, in about the time of one iteration of a solution; poses that follow are the same
    /// whether it was asked for or not.
    pub fn bias_sigmas(&mut self) -> Option<ImuBias<T>> {
        if !matches!(self.health, Health::Tracking | Health::Degraded) {
            return None;
        }
        let [gx, gy, gz, ax, ay, az] =
            newest_bias_variances(&self.window, &self.prior, &mut self.workspace, &self.settings)?.map(Real::root);
        Some(ImuBias { gyro_rad_s: Vector3::new(gx, gy, gz), accel_m_s2: Vector3::new(ax, ay, az) })
    }
}
