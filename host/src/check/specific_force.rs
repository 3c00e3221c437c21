//! The accelerometer: unit, gravity, and which way is up.
//!
//! # Method
//! A sensor that is carried feels gravity in the median; the median magnitude tells the unit. Over a recording accelerations
//! average out, so that the mean direction is up, unless the sensor is turned all over.

use libella_core::robust::stats;
use nalgebra::Vector3;

use super::Material;
use super::finding::{FindingKind, Findings, Severity};

/// Units that are met, by the value of one m/s² in them.
const UNITS: [(f64, &str); 4] = [(1.0 / 9.80665, "g"), (1e3 / 9.80665, "milli-g"), (1e2, "cm/s^2"), (3.280_84, "ft/s^2")];
/// How far the median magnitude may be from gravity in a unit that is believed: motion of 0.15 g.
const UNIT_TOLERANCE: f64 = 0.15;
/// Below this gravity has been taken out, m/s².
const NO_GRAVITY_M_S2: f64 = 3.0;
/// Deviation of the median magnitude: a bias of 0.5 m/s² and the rest from motion, m/s²; then what no calibration leaves.
const GRAVITY_OFF_M_S2: [f64; 2] = [1.0, 3.0];

/// Looks at the magnitude of specific force and repairs its unit.
pub(super) fn check(material: &mut Material, gravity_m_s2: f64, findings: &mut Findings) {
    let magnitude = |material: &Material| stats::median(&mut material.imu.iter().map(|s| s.accel_m_s2.norm()).collect::<Vec<f64>>());
    let Some(median) = magnitude(material) else { return };
    let expected = format!("{gravity_m_s2:.2} m/s^2, give or take motion");
    let measured = format!("the median magnitude of specific force is {median:.3}");
    let near = |value: f64| (value / gravity_m_s2 - 1.0).abs() < UNIT_TOLERANCE;
    if !near(median)
        && let Some((per_si, unit)) = UNITS.into_iter().find(|(per_si, _)| near(median / per_si))
    {
        let change = format!("specific force is in {unit}: multiply the three columns by {:.6}", 1.0 / per_si);
        findings.add(Severity::Fault, FindingKind::AccelUnit, measured, expected, change);
        for sample in &mut material.imu {
            sample.accel_m_s2 /= per_si;
        }
    } else if median < NO_GRAVITY_M_S2 {
        let change = "record raw specific force, with gravity in it (some drivers subtract it: switch that off)";
        findings.add(Severity::Fault, FindingKind::Gravity, measured, expected, change);
        material.accel_is_usable = false;
    } else if (median - gravity_m_s2).abs() > GRAVITY_OFF_M_S2[0] {
        let fatal = (median - gravity_m_s2).abs() > GRAVITY_OFF_M_S2[1];
        let change = "calibrate scale and bias of the accelerometer, and check its unit (m/s^2) and that its columns follow the gyro's";
        findings.add(if fatal { Severity::Fault } else { Severity::Warning }, FindingKind::Gravity, measured, expected, change);
        material.accel_is_usable = !fatal;
    }
    material.figures.gravity_m_s2 = magnitude(material);
    let mean = material.imu.iter().map(|sample| sample.accel_m_s2).sum::<Vector3<f64>>() / material.imu.len().max(1) as f64;
    if material.accel_is_usable && mean.norm() > 0.7 * gravity_m_s2 {
        let up = (material.body_from_camera.rotation.inverse() * mean).normalize();
        material.figures.up_in_camera = Some(up.into());
        // Up is −y of an upright camera.
        if up.y > 0.7 {
            let measured = format!("up points to the bottom of the image (specific force {:.1} {:.1} {:.1} m/s^2)", mean.x, mean.y, mean.z);
            let change =
                "nothing, if the camera is mounted upside down; else turn the sign of the accelerometer (at rest it reads +g upwards)";
            findings.add(Severity::Note, FindingKind::Gravity, measured, "up towards the top of the image", change);
        }
    }
}
