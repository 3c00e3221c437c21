//! When a trajectory becomes metric.
//!
//! # Model
//! A pose is no promise of metres: from rest, or with little motion, the first ones have a scale that is guessed. Over windows of 2 s the
//! spread of the estimated positions about their mean is compared with that of the true ones, which needs no alignment:
//! ```text
//! s = √(Σ ‖e_i − ē‖² / Σ ‖t_i − t̄‖²)        right ⇔ |ln s| ≤ 0.1
//! ```
//! The trajectory is metric from the first pose after which no window is wrong.
//!
//! # Degeneracy
//! A window in which the true positions spread by less than 3 cm tells nothing: it is neither right nor wrong.

use libella_core::time::{Span, Timestamp};
use nalgebra::Vector3;

use super::Matched;

const WINDOW: Span = Span::from_millis(2_000);
const LEAST_SPREAD_M: f64 = 0.03;
const MOST_LOG_SCALE: f64 = 0.1;

/// The first pose after which the scale of every stretch of 2 s is right within 10 %; `None` where it is wrong to the end, or no stretch
/// tells.
#[must_use]
pub fn metric_from(pairs: &[Matched]) -> Option<Timestamp> {
    let (mut from, mut is_told) = (pairs.first()?.stamp, false);
    for (start, first) in pairs.iter().enumerate() {
        let stretch = &pairs[start..];
        let end = stretch.partition_point(|pair| pair.stamp - first.stamp < WINDOW);
        if end == stretch.len() {
            break;
        }
        let spread = |of: &dyn Fn(&Matched) -> Vector3<f64>| {
            let count = end as f64;
            let mean = stretch[..end].iter().map(of).sum::<Vector3<f64>>() / count;
            (stretch[..end].iter().map(|pair| (of(pair) - mean).norm_squared()).sum::<f64>() / count).sqrt()
        };
        let truth_m = spread(&|pair| pair.truth.translation.vector);
        if truth_m < LEAST_SPREAD_M {
            continue;
        }
        let log_scale = (spread(&|pair| pair.estimate.translation.vector) / truth_m).ln();
        is_told = log_scale.abs() <= MOST_LOG_SCALE;
        if !is_told {
            from = pairs.get(start + 1)?.stamp;
        }
    }
    is_told.then_some(from)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::{Isometry3, Rotation3, Translation3};

    use super::*;

    /// A circle of 1 m, once in 6 s, after a rest; the estimate is `scale` times as large, somewhere else and turned.
    fn flown(rest_s: f64, scale: impl Fn(f64) -> f64) -> Vec<Matched> {
        let elsewhere = Isometry3::from_parts(Translation3::new(3.0, -1.0, 0.5), Rotation3::from_euler_angles(0.1, -0.2, 2.0).into());
        (0..400)
            .map(|k| {
                let seconds = f64::from(k) * 0.05;
                let angle = (seconds - rest_s).max(0.0);
                let at = Vector3::new(angle.cos() - 1.0, angle.sin(), 0.0);
                #[allow(clippy::cast_possible_truncation)]
                let stamp = Timestamp::from_nanos((seconds * 1e9).round() as i64);
                let pose = |at: Vector3<f64>| Isometry3::translation(at.x, at.y, at.z);
                Matched { stamp, estimate: elsewhere * pose(at * scale(seconds)), truth: pose(at) }
            })
            .collect()
    }

    fn seconds(found: Option<Timestamp>) -> Option<f64> {
        found.map(|stamp| (stamp - Timestamp::from_nanos(0)).as_seconds())
    }

    #[test]
    fn it_is_metric_from_the_first_pose_on_where_no_stretch_is_wrong() {
        assert_eq!(seconds(metric_from(&flown(0.0, |_| 1.05))), Some(0.0));
        // At rest there is no scale that could be wrong.
        assert_eq!(seconds(metric_from(&flown(5.0, |seconds| if seconds < 5.0 { 2.0 } else { 0.95 }))), Some(0.0));
    }

    #[test]
    fn a_wrong_scale_lasts_until_it_is_right_for_good() {
        let found = seconds(metric_from(&flown(0.0, |seconds| 1.0 + 0.5 * (1.0 - seconds / 10.0).max(0.0)))).unwrap();
        // 10 % too large at 8 s; a stretch of 2 s looks ahead, and the shrinking adds some motion of its own.
        assert!((6.0..8.5).contains(&found), "{found} s");
        let relapsed = seconds(metric_from(&flown(0.0, |seconds| if (15.0..16.0).contains(&seconds) { 1.4 } else { 1.0 }))).unwrap();
        assert!((15.0..16.1).contains(&relapsed), "{relapsed} s");
    }

    #[test]
    fn what_is_wrong_to_the_end_or_never_moves_is_not_metric() {
        assert_eq!(metric_from(&flown(0.0, |_| 1.2)), None);
        assert_eq!(metric_from(&flown(100.0, |_| 1.0)), None);
        assert_eq!(metric_from(&[]), None);
    }
}
