//! Motion: whether there is any, and enough to start from.
//!
//! # Method
//! A visual-inertial start needs corners that move beyond rotation and a specific force that changes; the estimator waits for 6 px and
//! for a scale known to 10 %. Here only recordings that have nothing of it are named.

use nalgebra::Vector3;

use super::Material;
use super::finding::{FindingKind, Findings, Severity};
use super::pairs::pairs;
use super::sightings::Sightings;

/// Means over so long are compared: vibration is gone, motion is not, s.
const BLOCK_S: f64 = 0.25;
/// Spread of block means of a resting inertial unit: rad/s, m/s² (a resting start allows as much within half a second).
const REST_GYRO_RAD_S: f64 = 0.02;
const REST_ACCEL_M_S2: f64 = 0.1;
/// Times over which displacements are taken, s.
const SPANS_S: [f64; 2] = [0.1, 0.5];
/// Displacement over half a second of a resting camera, px: three standard deviations of a good corner; with noisy corners more, if it
/// hardly grows with time.
const REST_PX: f64 = 1.0;
const NOISE_PX: f64 = 5.0;
const NOISE_GROWTH: f64 = 1.3;
/// Least displacement beyond rotation over half a second, of the best tenth of the corners, px.
const LEAST_PARALLAX_PX: f64 = 3.0;
/// Specific force must vary by this, m/s², or scale stays unknown: three times the spread of bias and tilt at rest.
const LEAST_EXCITATION_M_S2: f64 = 0.15;

/// Judges the motion, and returns whether the inertial unit moves.
pub(super) fn check(material: &Material, seen: &Sightings, findings: &mut Findings) -> bool {
    let Some(rate_hz) = material.figures.imu.map(|clock| clock.rate_hz) else { return false };
    let (gyro, accel) = spreads(material, rate_hz);
    let imu_rests = gyro < REST_GYRO_RAD_S && (accel < REST_ACCEL_M_S2 || !material.accel_is_usable);
    let camera_px = displacement(material, seen, SPANS_S[1]);
    // What is the same over a fifth of the time is noise.
    let sooner_px = displacement(material, seen, SPANS_S[0]);
    let camera_rests =
        camera_px.is_none_or(|px| px < REST_PX || px < NOISE_PX && sooner_px.is_some_and(|sooner| px < NOISE_GROWTH * sooner));
    let px = camera_px.map_or_else(|| "no corner is followed".into(), |px| format!("corners move {px:.2} px in half a second"));
    let measured = format!("{px}, the angular rate varies by {gyro:.3} rad/s, specific force by {accel:.2} m/s^2");
    if imu_rests && camera_rests {
        let change = "record while the rig is carried: turn and shift it for a few seconds, with changes of speed";
        findings.add(Severity::Fault, FindingKind::Static, measured, "a rig that moves", change);
    } else if camera_px.is_some() && camera_rests {
        let change = "check that the images belong to these inertial samples and that the camera does not look at the rig itself";
        findings.add(Severity::Fault, FindingKind::Disagreement, measured, "images that move while the inertial unit does", change);
    } else if imu_rests {
        let change = "check that the inertial samples belong to these images and that the unit is fixed to the camera";
        findings.add(Severity::Fault, FindingKind::Disagreement, measured, "an inertial unit that moves while the images do", change);
    } else if let Some(found) = &material.figures.camera_imu
        && found.parallax_px < LEAST_PARALLAX_PX
    {
        let measured = format!("corners move {:.1} px beyond rotation in half a second", found.parallax_px);
        let expected = format!("at least {LEAST_PARALLAX_PX} px for one corner in ten");
        findings.add(
            Severity::Warning,
            FindingKind::Motion,
            measured,
            expected,
            "shift the camera instead of turning it, or move closer to the scene",
        );
    } else if material.accel_is_usable && accel < LEAST_EXCITATION_M_S2 {
        let measured = format!("specific force varies by {accel:.2} m/s^2");
        let expected = format!("at least {LEAST_EXCITATION_M_S2} m/s^2, or scale cannot be told");
        findings.add(Severity::Warning, FindingKind::Motion, measured, expected, "start with a few seconds of faster, uneven motion");
    }
    !imu_rests
}

/// Spread of the block means of both sensors, root mean square of three axes' sum.
fn spreads(material: &Material, rate_hz: f64) -> (f64, f64) {
    let length = (BLOCK_S * rate_hz).round().max(1.0) as usize;
    let spread = |part: fn(&libella_core::imu::ImuSample<f64>) -> Vector3<f64>| {
        let means: Vec<Vector3<f64>> =
            material.imu.chunks_exact(length).map(|block| block.iter().map(part).sum::<Vector3<f64>>() / length as f64).collect();
        let count = means.len().max(1) as f64;
        let center = means.iter().sum::<Vector3<f64>>() / count;
        (means.iter().map(|mean| (mean - center).norm_squared()).sum::<f64>() / count).sqrt()
    };
    (spread(|sample| sample.gyro_rad_s), spread(|sample| sample.accel_m_s2))
}

/// The 90 % quantile over pairs of the median displacement in a time, px.
fn displacement(material: &Material, seen: &Sightings, span_s: f64) -> Option<f64> {
    let origin = material.imu.first()?.stamp;
    let pairs = pairs(&seen.windows, span_s, |shot| (shot.stamp - origin).as_seconds());
    let mut moved: Vec<f64> = pairs.iter().map(super::pairs::Pair::displacement_px).collect();
    libella_core::robust::stats::quantile(&mut moved, 0.9)
}
