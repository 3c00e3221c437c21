//! Readings that stop at an end of the range, and axes that never change.
//!
//! # Method
//! A signal that is not cut off reaches its extreme value once, or a few times where readings are coarse, and the levels below it more
//! often. A cut one piles up: the extreme value repeats, in a row, and more often than the level next to it. Neither needs the full
//! scale to be known. Samples next to a cut are marked, so that they do not mislead the comparison with the images.

use super::Material;
use super::finding::{FindingKind, Findings, Severity};

/// Repetitions in a row that mark a cut: a moving sensor does not repeat itself to the last digit.
const RUN: usize = 3;
/// Repetitions of the extreme value over those of the next level.
const PILE: usize = 3;
/// Repetitions at least.
const LEAST: usize = 5;
/// A cut-off end lies beyond what a resting sensor reads: rad/s and m/s².
const LEAST_EXTREME: [f64; 2] = [0.2, 12.0];
/// Share of samples from which integration is lost rather than disturbed: at 200 Hz half a second in four minutes.
const FAULT_SHARE: f64 = 0.002;
/// An axis that is the same over the whole of a recording of so many samples is no measurement.
const STUCK_SAMPLES: usize = 100;

struct Cut {
    axis: usize,
    limit: f64,
    samples: usize,
}

/// Looks at each axis of both sensors.
pub(super) fn check(material: &mut Material, findings: &mut Findings) {
    let count = material.imu.len();
    material.unreliable = vec![false; count];
    for sensor in 0..2 {
        let (name, unit) = [("angular rate", "rad/s"), ("specific force", "m/s^2")][sensor];
        let kind = [FindingKind::GyroSaturated, FindingKind::AccelSaturated][sensor];
        let mut cuts = Vec::new();
        for axis in 0..3 {
            let values: Vec<f64> =
                material.imu.iter().map(|sample| if sensor == 0 { sample.gyro_rad_s[axis] } else { sample.accel_m_s2[axis] }).collect();
            let letter = ["x", "y", "z"][axis];
            if count >= STUCK_SAMPLES && values.windows(2).all(|pair| pair[0] == pair[1]) {
                let measured = format!("{name} {letter} is {} {unit} in all samples", values.first().copied().unwrap_or_default());
                let change = "check the column order of the table and the driver of the inertial unit";
                findings.add(Severity::Fault, FindingKind::ImuStuck, measured, "readings with at least their noise", change);
                continue;
            }
            for sign in [1.0, -1.0] {
                if let Some(limit) = pile(&values, sign, LEAST_EXTREME[sensor]) {
                    let mut samples = 0;
                    for (value, mark) in values.iter().zip(&mut material.unreliable) {
                        if *value == limit {
                            samples += 1;
                            *mark |= sensor == 0;
                        }
                    }
                    cuts.push(Cut { axis, limit, samples });
                }
            }
        }
        let Some(worst) = cuts.iter().max_by_key(|cut| cut.samples) else { continue };
        let total: usize = cuts.iter().map(|cut| cut.samples).sum();
        let share = total as f64 / count.max(1) as f64;
        let severity = if share >= FAULT_SHARE { Severity::Fault } else { Severity::Warning };
        let letter = ["x", "y", "z"][worst.axis];
        let measured =
            format!("{name} is cut off in {total} samples ({:.2} %), mostly at {letter} = {:.3} {unit}", 100.0 * share, worst.limit);
        let expected = "an extreme value that is not reached several times in a row";
        let change = "choose a larger full scale of the inertial unit, or move more gently";
        findings.add(severity, kind, measured, expected, change);
    }
}

/// The extreme value on one side, if readings pile up at it.
fn pile(values: &[f64], sign: f64, least: f64) -> Option<f64> {
    let extreme = values.iter().map(|value| sign * value).fold(f64::NEG_INFINITY, f64::max);
    if !(extreme.is_finite() && extreme >= least) {
        return None;
    }
    let next = values.iter().map(|value| sign * value).filter(|value| *value < extreme).fold(f64::NEG_INFINITY, f64::max);
    let times = |level: f64| values.iter().filter(|value| sign * **value == level).count();
    let (at_extreme, at_next) = (times(extreme), times(next));
    let (mut run, mut longest) = (0, 0);
    for value in values {
        run = if sign * value == extreme { run + 1 } else { 0 };
        longest = longest.max(run);
    }
    (at_extreme >= LEAST && longest >= RUN && at_extreme >= PILE * at_next).then_some(sign * extreme)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(count: usize) -> Vec<f64> {
        (0..count).map(|k| 3.0 * (0.05 * k as f64).sin()).collect()
    }

    #[test]
    fn a_cut_sine_piles_up_and_a_whole_or_coarse_one_does_not() {
        assert_eq!(pile(&sine(1000), 1.0, 0.2), None);
        let coarse: Vec<f64> = sine(1000).iter().map(|value| (value * 20.0).round() / 20.0).collect();
        assert_eq!(pile(&coarse.iter().map(|value| value * 0.01).collect::<Vec<_>>(), 1.0, 0.2), None);
        let cut: Vec<f64> = sine(1000).iter().map(|value| value.clamp(-2.0, 2.5)).collect();
        assert_eq!((pile(&cut, 1.0, 0.2), pile(&cut, -1.0, 0.2)), (Some(2.5), Some(-2.0)));
    }
}
