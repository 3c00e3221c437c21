//! Images between two keyframes.
//!
//! # Model
//! The state of the earlier keyframe is carried on by the inertial samples; by how much that misses the later one,
//! `δ = x_to ⊟ predicted`, is shared out in proportion to time. Over the half second at most between keyframes the miss is of the size of
//! the noise, and its way there hardly matters; the causal poses, with the jitter of estimates that did not know what followed, are not used.

use libella_core::imu::{ImuSample, NavState, stretch};
use libella_core::time::Timestamp;

use super::bundle::{BundleSettings, Keyframe, pairs_between};

/// A pose that knows the whole flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothPose {
    /// Time of the image.
    pub stamp: Timestamp,
    /// Pose, velocity and biases.
    pub state: NavState<f64>,
}

/// The states at `stamps`, which rise in time; those outside of the keyframes are left out.
pub(super) fn fill(
    keyframes: &[Keyframe],
    stamps: impl Iterator<Item = Timestamp>,
    samples: &[ImuSample<f64>],
    settings: &BundleSettings,
) -> Vec<SmoothPose> {
    stamps.filter_map(|stamp| Some(SmoothPose { stamp, state: at(keyframes, stamp, samples, settings)? })).collect()
}

fn at(keyframes: &[Keyframe], stamp: Timestamp, samples: &[ImuSample<f64>], settings: &BundleSettings) -> Option<NavState<f64>> {
    let next = keyframes.partition_point(|keyframe| keyframe.stamp < stamp);
    let to = keyframes.get(next)?;
    if to.stamp == stamp {
        return Some(to.state);
    }
    let from = keyframes.get(next.checked_sub(1)?)?;
    let carried = |until: Timestamp| {
        let pairs = pairs_between(samples, from.stamp, until);
        let integral = stretch::integrate(pairs, &settings.imu_noise, &settings.imu_range, from.state.bias);
        integral.predict(&from.state, &settings.gravity_in_world)
    };
    let share = (stamp - from.stamp).as_seconds::<f64>() / (to.stamp - from.stamp).as_seconds::<f64>();
    let missed = to.state.local(&carried(to.stamp));
    Some(carried(stamp).retract(&missed.map(|value| value * share)))
}
