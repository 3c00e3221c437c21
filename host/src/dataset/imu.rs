//! The table of inertial samples, and what looks wrong in it.

use std::path::Path;

use libella_core::imu::ImuSample;
use libella_core::time::Timestamp;
use nalgebra::Vector3;

use super::table::rows;
use super::{Purpose, Remark, RemarkKind, remark};
use crate::config::DatasetSection;
use crate::fault::Fault;

/// The smallest full scale of inertial units in use: 200 deg/s and 2 g; a constant below it is rest, not saturation.
const SMALLEST_FULL_SCALE: [f64; 2] = [3.4, 19.0];
/// So many equal largest readings in a row are saturation: a moving sensor does not repeat itself.
const SATURATED_RUN: usize = 3;
/// Start of the recording over which specific force is compared with gravity, samples.
const GRAVITY_SAMPLES: usize = 200;

/// Reads `stamp, gyro x y z (rad/s), accel x y z (m/s²)`.
pub(super) fn read(
    purpose: Purpose,
    path: &Path,
    text: &str,
    options: &DatasetSection,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<ImuSample<f64>>, Fault> {
    let mut samples: Vec<ImuSample<f64>> = Vec::new();
    for row in rows(path, text, true) {
        row.at_least(7)?;
        let stamp = row.stamp()?;
        if let Some(last) = samples.last() {
            if stamp < last.stamp && purpose == Purpose::Check {
                remark(remarks, RemarkKind::ImuOrder, || format!("{} line {}: time stamp goes back", path.display(), row.line));
                continue;
            }
            if stamp < last.stamp {
                let back_ms = (last.stamp - stamp).as_seconds::<f64>() * 1e3;
                return Err(row.fault(format!("time stamp goes back by {back_ms:.3} ms"), "sort the file by its first column"));
            }
            if !follows(last.stamp, stamp, options, remarks, || format!("{} line {}", path.display(), row.line)) {
                continue;
            }
        }
        let [gx, gy, gz, ax, ay, az] = row.numbers::<6>(1)?;
        samples.push(ImuSample { stamp, gyro_rad_s: Vector3::new(gx, gy, gz), accel_m_s2: Vector3::new(ax, ay, az) });
    }
    checked(purpose, path, samples, remarks)
}

/// Takes the samples of a bag, which do not fall in time, as a table.
pub(super) fn take(
    purpose: Purpose,
    path: &Path,
    mut samples: Vec<ImuSample<f64>>,
    options: &DatasetSection,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<ImuSample<f64>>, Fault> {
    let mut last = None;
    samples.retain(|sample| {
        let keep =
            last.is_none_or(|last| follows(last, sample.stamp, options, remarks, || format!("{} at {}", path.display(), sample.stamp)));
        last = Some(sample.stamp);
        keep
    });
    checked(purpose, path, samples, remarks)
}

/// Whether a sample is another one than the last; remarks repetitions and gaps.
fn follows(last: Timestamp, stamp: Timestamp, options: &DatasetSection, remarks: &mut Vec<Remark>, place: impl Fn() -> String) -> bool {
    let step_ms = (stamp - last).as_seconds::<f64>() * 1e3;
    if stamp == last {
        remark(remarks, RemarkKind::ImuDuplicate, || format!("{}: time stamp occurs twice; the second sample is left out", place()));
    } else if step_ms > options.max_imu_gap_ms {
        remark(remarks, RemarkKind::ImuGap, || format!("{}: no inertial sample for {step_ms:.0} ms; accuracy suffers there", place()));
    }
    stamp != last
}

/// Refuses samples that cannot be those of an inertial unit.
fn checked(purpose: Purpose, path: &Path, samples: Vec<ImuSample<f64>>, remarks: &mut Vec<Remark>) -> Result<Vec<ImuSample<f64>>, Fault> {
    if samples.len() < 2 {
        return Err(Fault::malformed(path, format!("has {} inertial samples", samples.len()), "the file is cut off: copy it again"));
    }
    if purpose == Purpose::Run {
        check_gravity(path, &samples, remarks)?;
    }
    report_saturation(path, &samples, remarks);
    Ok(samples)
}

/// A sensor that is carried feels gravity on average: far from it, units or axes are wrong.
fn check_gravity(path: &Path, samples: &[ImuSample<f64>], remarks: &mut Vec<Remark>) -> Result<(), Fault> {
    let first = samples.get(..GRAVITY_SAMPLES).unwrap_or(samples);
    let mean = first.iter().map(|sample| sample.accel_m_s2).sum::<Vector3<f64>>().norm() / first.len() as f64;
    let what = format!("mean specific force of the first {} samples is {mean:.2} m/s^2, far from gravity", first.len());
    match mean {
        ..2.0 => Err(Fault::malformed(path, what, "give m/s^2 (not g), with gravity included, after the three gyro columns")),
        30.0.. => Err(Fault::malformed(path, what, "give m/s^2, after the three gyro columns")),
        ..7.0 | 13.0.. => {
            remark(remarks, RemarkKind::Gravity, || format!("{}: {what}; check units and axes", path.display()));
            Ok(())
        }
        _ => Ok(()),
    }
}

fn report_saturation(path: &Path, samples: &[ImuSample<f64>], remarks: &mut Vec<Remark>) {
    for axis in 0..6 {
        let value = |sample: &ImuSample<f64>| if axis < 3 { sample.gyro_rad_s[axis] } else { sample.accel_m_s2[axis - 3] };
        let largest = samples.iter().map(|sample| value(sample).abs()).fold(0.0, f64::max);
        if largest < SMALLEST_FULL_SCALE[axis / 3] {
            continue;
        }
        let mut run = 0;
        for sample in samples {
            run = if value(sample).abs() == largest { run + 1 } else { 0 };
            if run == SATURATED_RUN {
                let (name, unit) = if axis < 3 { ("angular rate", "rad/s") } else { ("specific force", "m/s^2") };
                let letter = ["x", "y", "z"][axis % 3];
                remark(remarks, RemarkKind::ImuSaturated, || {
                    format!("{}: {name} {letter} stays at {largest:.2} {unit} at {}: the sensor is saturated", path.display(), sample.stamp)
                });
            }
        }
    }
}
