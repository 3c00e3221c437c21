//! Camera against inertial unit: unit and axes of the gyro, direction and value of the extrinsic rotation, time offset.
//!
//! # Order
//! The coarse alignment knows nothing and finds anything; what it finds is compared with what is stated, simplest explanation first:
//! stated, inverse of the stated, axes exchanged, anything. Unit and axes are then repaired in memory, and the joint fit measures the rest.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::Material;
use super::axes;
use super::coarse::{self, Coarse};
use super::finding::{CameraImu, FindingKind, Findings, Measured, Severity};
use super::fit::{Fit, State, fit};
use super::gyro::Gyro;
use super::lens::{Deviation, Lens};
use super::pairs::{Pair, pairs, table};
use super::sightings::{Shot, Sightings};

/// Distances in time of the pairs, s: the first for the coarse alignment, the others for the fit.
const SPANS_S: [f64; 4] = [0.1, 0.25, 0.5, 1.0];
/// Rates of the camera about their mean below which nothing can be told, rad/s: a pixel or two between images.
const LEAST_RATE_RAD_S: f64 = 0.03;
/// Correlation below which images and gyro have nothing in common, and above which they surely have.
const LEAST_CORRELATION: f64 = 0.6;
/// What a wrong hypothesis may lack of the best correlation to be kept: 14 degrees about one axis, or noise.
const TIE: f64 = 0.03;
/// An exchange of axes must reach the best correlation this closely: other rotations are no exchange.
const EXACT: f64 = 0.02;
/// Factors between rad/s and deg/s that are taken for one: intrinsics may be wrong by a third as well.
const DEGREES: [f64; 2] = [35.0, 95.0];
/// Offset from which a rolling or late clock shows: at 1 rad/s a millisecond is half a pixel. Warning, and fault, s.
const OFFSET_S: [f64; 2] = [0.0025, 0.004];
/// The error of an offset grows with the square of the corners' noise in a way that no covariance knows. Corners of images are 0.1 to
/// 0.4 px off; beyond this value only offsets beyond the next are judged. px, s.
const NOISY_PX: f64 = 0.7;
const FAR_OFFSET_S: f64 = 0.05;
/// Images over less time than this fit many offsets and alignments at once, s.
const LEAST_SPAN_S: f64 = 4.0;
/// As of the offset, of the rotation: the estimator follows corners to 1 px (0.12 degree), calibrations repeat to 0.3 degree. Degrees.
const ROTATION_DEG: [f64; 2] = [1.0, 3.0];
/// Standard deviations that a deviation must have.
const SIGMAS: f64 = 4.0;
/// A value known worse than this is not observable: s, and degrees.
const OFFSET_KNOWN_S: f64 = 0.003;
const ROTATION_KNOWN_DEG: f64 = 1.0;
/// Focal lengths from which intrinsics are wrong, as a share: warning and fault. A gyro's scale may be off by 2 % and counts the same.
const FOCAL_OFF: [f64; 2] = [0.05, 0.08];
/// Principal point, as an angle, rad.
const CENTER_OFF: [f64; 2] = [0.05, 0.08];
const DISTORTION_OFF: [f64; 2] = [0.08, 0.15];
const LENS_KNOWN: f64 = 0.03;

/// Time from the first to the last image of a window.
fn window_s(window: &[Shot]) -> f64 {
    match (window.first(), window.last()) {
        (Some(first), Some(last)) => (last.stamp - first.stamp).as_seconds(),
        _ => 0.0,
    }
}

/// What is assumed of the raw gyro before the fit.
struct Reading {
    /// Takes raw rates to the body frame of the stated extrinsics.
    repair: Matrix3<f64>,
    /// `R_BC` to start from.
    body_from_camera: Matrix3<f64>,
}

/// Compares camera and inertial unit.
pub(super) fn check(material: &mut Material, seen: &Sightings, findings: &mut Findings) {
    let Some(origin) = material.imu.first().map(|sample| sample.stamp) else { return };
    let looked_s: f64 = seen.windows.iter().map(|window| window_s(window)).sum();
    if looked_s < LEAST_SPAN_S {
        let measured = format!("images over {looked_s:.1} s, too short to tell time offset, extrinsic rotation and intrinsics");
        let expected = format!("at least {LEAST_SPAN_S} s with some turning");
        findings.add(Severity::Note, FindingKind::Motion, measured, expected, "record longer to have them checked");
        return;
    }
    let of = |span_s: f64| pairs(&seen.windows, span_s, |shot| (shot.stamp - origin).as_seconds());
    let sets = SPANS_S.map(of);
    let lens = Lens::new(&material.camera, &Deviation::zeros());
    let mut gyro = Gyro::new(material);
    let Some(coarse) = coarse::align(&sets[0], &lens, &gyro).filter(|coarse| coarse.rms[0] >= LEAST_RATE_RAD_S) else {
        let measured = "time offset, extrinsic rotation and intrinsics are not observable: the camera hardly turns in the images";
        let expected = format!("at least {LEAST_RATE_RAD_S} rad/s of varied rotation with corners in view, over a few seconds");
        findings.add(Severity::Note, FindingKind::Motion, measured, expected, "record some turning about all axes to have them checked");
        return;
    };
    if coarse.correlation < LEAST_CORRELATION {
        let measured = format!(
            "rotation seen in the images ({:.2} rad/s) and by the gyro ({:.2} rad/s) correlate by {:.2} at best, at any offset within 1 s",
            coarse.rms[0], coarse.rms[1], coarse.correlation
        );
        let change = "check that images and inertial samples are of the same recording and that their clocks differ by less than a second";
        findings.add(Severity::Fault, FindingKind::Disagreement, measured, format!("a correlation above {LEAST_CORRELATION}"), change);
        return;
    }
    let unit = judge_unit(&coarse, findings);
    // So that axes and noise are judged in rad/s.
    material.imu.iter_mut().for_each(|sample| sample.gyro_rad_s *= unit);
    let raw_bias = coarse.bias(&coarse.best()) * unit;
    let reading = judge_axes(material, &coarse, &raw_bias, findings);
    gyro.map(&(reading.repair * unit));
    let start = State {
        body_from_camera: UnitQuaternion::from_matrix(&reading.body_from_camera),
        bias: reading.repair * raw_bias,
        offset_s: coarse.offset_s,
        lens: Deviation::zeros(),
    };
    // The shortest say next to nothing beside the others, and are the ones that noise biases.
    let all: Vec<Pair> = sets.into_iter().skip(1).flatten().collect();
    let corners = table(&seen.windows);
    let free = fit(&all, &corners, &gyro, &material.camera, &start, true);
    let lens_is_wrong = free.as_ref().is_some_and(|fit| judge_lens(material, fit, findings));
    let held = if lens_is_wrong { free.clone() } else { fit(&all, &corners, &gyro, &material.camera, &start, false) };
    let (Some(found), Some(free)) = (held, free) else { return };
    let figures = describe(material, &coarse, &found, &free);
    judge_offset(&figures, findings);
    if !lens_is_wrong {
        judge_rotation(&figures, findings);
    }
    material.figures.camera_imu = Some(figures);
}

/// Which of the simple explanations holds for the orientation of the gyro, of which the bias is given in rad/s.
fn judge_axes(material: &Material, coarse: &Coarse, bias: &Vector3<f64>, findings: &mut Findings) -> Reading {
    let stated = material.body_from_camera.rotation.to_rotation_matrix().into_inner();
    let reaches = |body_from_camera: &Matrix3<f64>, repair: &Matrix3<f64>| coarse.correlation_of(&(body_from_camera.transpose() * repair));
    let as_stated = Reading { repair: Matrix3::identity(), body_from_camera: stated };
    let rate_hz = material.figures.imu.map_or(200.0, |clock| clock.rate_hz);
    let agreement = material.accel_is_usable.then(|| axes::compare(material, rate_hz, bias)).flatten();
    let identity = Matrix3::identity();
    let contradicts = |exchange: &Matrix3<f64>| agreement.as_ref().is_some_and(|found| found.contradicts(exchange));
    if reaches(&stated, &identity) >= coarse.correlation - TIE {
        if let Some(agreement) = agreement.filter(|found| found.contradicts(&identity)) {
            // The images agree with the gyro, so the accelerometer is the odd one out; its exchange is the inverse, of either sign.
            let inverse = agreement.best().transpose();
            let up = material.body_from_camera.rotation.inverse() * (inverse * mean_force(material));
            let inverse = if up.y > 0.0 { -inverse } else { inverse };
            let measured = format!(
                "gravity turns against the gyro: with the accelerometer's axes as they are it spreads {:.0} times as much as with the best",
                agreement.excess(&identity)
            );
            let change =
                format!("read the accelerometer's x, y, z from its {}, so that it shares the gyro's axes", axes::in_words(&inverse));
            findings.add(Severity::Fault, FindingKind::ImuAxes, measured, "specific force that turns as the gyro says", change);
        }
        return as_stated;
    }
    let found = coarse.best();
    let expected = "an image rotation equal to the gyro's after T_BS";
    // Exchanges in the order of the correlation they reach.
    let mut exchanges: Vec<(f64, Matrix3<f64>)> =
        axes::exchanges().into_iter().map(|exchange| (reaches(&stated, &exchange), exchange)).collect();
    exchanges.sort_by(|a, b| b.0.total_cmp(&a.0));
    let exchange = exchanges.first().filter(|(reached, _)| *reached >= coarse.correlation - EXACT).map(|(_, exchange)| *exchange);
    // Whether the gyro alone is exchanged: it then agrees with the accelerometer after the repair and not before.
    let gyro_is_odd = contradicts(&identity) && exchange.is_some_and(|exchange| !contradicts(&exchange));
    if reaches(&stated.transpose(), &identity) >= coarse.correlation - TIE && !gyro_is_odd {
        let measured = format!(
            "the images turn as the inverse of T_BS says (correlation {:.3}, as stated {:.3})",
            reaches(&stated.transpose(), &identity),
            reaches(&stated, &identity)
        );
        let change = "T_BS must map camera coordinates to body coordinates: write the inverse of the matrix (rotation and translation)";
        findings.add(Severity::Fault, FindingKind::ExtrinsicInverted, measured, expected, change);
        return Reading { repair: identity, body_from_camera: stated.transpose() };
    }
    if let Some(exchange) = exchange {
        let handed = if exchange.determinant() < 0.0 { ", a mirrored frame" } else { "" };
        let measured = format!(
            "image rotation fits the gyro read as {} (correlation {:.3}, as stated {:.3}){handed}",
            axes::in_words(&exchange),
            reaches(&stated, &exchange),
            reaches(&stated, &identity)
        );
        let change = if gyro_is_odd {
            format!("read the gyro's x, y, z from its {}: axes are exchanged, the accelerometer's are not", axes::in_words(&exchange))
        } else {
            format!(
                "read x, y, z of the inertial unit from its {}, or correct T_BS: axes are exchanged or turned round between camera and inertial unit",
                axes::in_words(&exchange)
            )
        };
        findings.add(Severity::Fault, FindingKind::ImuAxes, measured, expected, change);
        return Reading { repair: exchange, body_from_camera: stated };
    }
    if found.determinant() < 0.0 {
        let measured = format!(
            "image rotation fits a mirrored gyro only (correlation {:.3}, as stated {:.3})",
            coarse.correlation,
            reaches(&stated, &identity)
        );
        let change = "one axis of the gyro has the wrong sign or two are exchanged: make the axes right-handed as in the data sheet";
        findings.add(Severity::Fault, FindingKind::ImuAxes, measured, expected, change);
        return Reading { repair: stated * found, body_from_camera: stated };
    }
    // Another rotation: the fit measures it.
    Reading { repair: identity, body_from_camera: found.transpose() }
}

fn mean_force(material: &Material) -> Vector3<f64> {
    material.imu.iter().map(|sample| sample.accel_m_s2).sum::<Vector3<f64>>() / material.imu.len().max(1) as f64
}

/// The factor to rad/s.
fn judge_unit(coarse: &Coarse, findings: &mut Findings) -> f64 {
    let ratio = 1.0 / coarse.scale.max(1e-9);
    if ratio < 3.0 && ratio > 1.0 / 3.0 {
        return 1.0;
    }
    let measured =
        format!("the gyro turns {ratio:.3} times as fast as the images ({:.2} against {:.2} rad/s)", coarse.rms[1], coarse.rms[0]);
    let expected = "a ratio of 1, within what the focal length may be off";
    if (DEGREES[0]..=DEGREES[1]).contains(&ratio) {
        let change = "the gyro is in deg/s where rad/s belong: multiply its three columns by 0.0174533";
        findings.add(Severity::Fault, FindingKind::GyroUnit, measured, expected, change);
        return std::f64::consts::PI / 180.0;
    }
    let change = "give the gyro in rad/s: its scale is wrong";
    findings.add(Severity::Fault, FindingKind::GyroUnit, measured, expected, change);
    1.0 / ratio
}

/// Whether the lens deviates from the stated calibration; says so.
fn judge_lens(material: &Material, fit: &Fit, findings: &mut Findings) -> bool {
    let lens = &fit.state.lens;
    let sure = |k: usize| fit.lens_sigma(k) < LENS_KNOWN && lens[k].abs() > SIGMAS * fit.lens_sigma(k);
    let limits = [FOCAL_OFF, FOCAL_OFF, CENTER_OFF, CENTER_OFF, DISTORTION_OFF];
    let beyond = |level: usize| (0..limits.len()).any(|k| sure(k) && lens[k].abs() > limits[k][level]);
    if !beyond(0) {
        return false;
    }
    let fault = beyond(1);
    let focal = material.focal_px();
    let center = material.center_px();
    let mut off = Vec::new();
    for (k, axis) in [(0, "x"), (1, "y")] {
        if sure(k) && lens[k].abs() > limits[k][0] {
            let (ratio, sigma, value) = (lens[k].exp(), fit.lens_sigma(k), focal[k] * lens[k].exp());
            off.push(format!("focal length {axis} {value:.0} px, {ratio:.3} ± {sigma:.3} times the stated"));
        }
        let k = 2 + k;
        if sure(k) && lens[k].abs() > limits[k][0] {
            off.push(format!(
                "principal point {axis} {:.0} px, {:+.0} px from the stated",
                center[k - 2] + lens[k] * focal[k - 2],
                lens[k] * focal[k - 2]
            ));
        }
    }
    if sure(4) && lens[4].abs() > limits[4][0] {
        off.push(format!("first distortion coefficient {:.3}, {:+.3} from the stated", material.first_distortion() + lens[4], lens[4]));
    }
    let measured = format!("the motion of the corners does not fit the intrinsics; it fits {}", off.join("; "));
    let expected =
        format!("focal lengths within {:.0} %, a principal point within {:.1} deg", 100.0 * FOCAL_OFF[0], CENTER_OFF[0].to_degrees());
    let change = if material.size_is_wrong {
        "give the intrinsics of this resolution, near these values"
    } else {
        "calibrate the camera again, at this resolution; the values are a guide, not a calibration"
    };
    let severity = if fault { Severity::Fault } else { Severity::Warning };
    findings.add(severity, FindingKind::Intrinsics, measured, expected, change);
    fault
}

fn describe(material: &Material, coarse: &Coarse, found: &Fit, free: &Fit) -> CameraImu {
    let state = &found.state;
    let off = material.body_from_camera.rotation.inverse() * state.body_from_camera;
    let off_deg = off.scaled_axis().map(f64::to_degrees);
    let worst = found.rotation_covariance().symmetric_eigenvalues().max().max(0.0).sqrt().to_degrees();
    let offset_sigma_s = found.offset_sigma_s();
    let [focal_x, focal_y] = material.focal_px();
    let lens = &free.state.lens;
    let known = |k: usize| free.lens_sigma(k) < LENS_KNOWN;
    let scaled = |k: usize, unit: f64| Measured { value: lens[k] * unit, sigma: free.lens_sigma(k) * unit, observable: known(k) };
    let focal = |k: usize| Measured { value: lens[k].exp(), sigma: free.lens_sigma(k), observable: known(k) };
    CameraImu {
        time_offset_ms: Measured {
            value: state.offset_s * 1e3,
            sigma: offset_sigma_s * 1e3,
            observable: offset_sigma_s < OFFSET_KNOWN_S && found.residual_px < NOISY_PX,
        },
        rotation_off_deg: Measured { value: off_deg.norm(), sigma: worst, observable: worst < ROTATION_KNOWN_DEG },
        rotation_off_vector_deg: off_deg.into(),
        focal_ratio: [focal(0), focal(1)],
        center_off_px: [scaled(2, focal_x), scaled(3, focal_y)],
        distortion_off: scaled(4, 1.0),
        gyro_bias_rad_s: state.bias.into(),
        correlation: coarse.correlation,
        residual_px: found.residual_px,
        parallax_px: found.parallax_px,
        pairs: found.pairs,
    }
}

fn judge_offset(found: &CameraImu, findings: &mut Findings) {
    let Measured { value, sigma, .. } = found.time_offset_ms;
    let off_s = value.abs() * 1e-3;
    if found.residual_px > NOISY_PX && off_s < FAR_OFFSET_S {
        let measured = format!("corners are {:.1} px off: the time offset cannot be told", found.residual_px);
        let expected = format!("less than {NOISY_PX} px");
        findings.add(
            Severity::Note,
            FindingKind::TimeOffset,
            measured,
            expected,
            "sharper images or a better corner detector would tell it",
        );
        return;
    }
    if off_s < OFFSET_S[0] || value.abs() < SIGMAS * sigma {
        return;
    }
    let severity = if off_s >= OFFSET_S[1] { Severity::Fault } else { Severity::Warning };
    let (late, verb) = if value > 0.0 { ("early", "add") } else { ("late", "subtract") };
    let measured = format!("the camera's stamps are {:.1} ± {sigma:.1} ms {late} against the inertial unit's", value.abs());
    let expected = format!("an offset below {:.1} ms", OFFSET_S[0] * 1e3);
    let change = format!("{verb} {:.1} ms {} the stamps of the images", value.abs(), if value > 0.0 { "to" } else { "from" });
    findings.add(severity, FindingKind::TimeOffset, measured, expected, change);
}

fn judge_rotation(found: &CameraImu, findings: &mut Findings) {
    // After an exchange or an inverse has been named, the rest is told by its own repair.
    if findings.has(FindingKind::ExtrinsicInverted, Severity::Fault) {
        return;
    }
    let Measured { value, sigma, .. } = found.rotation_off_deg;
    if value < ROTATION_DEG[0] || value < SIGMAS * sigma {
        return;
    }
    let severity = if value >= ROTATION_DEG[1] { Severity::Fault } else { Severity::Warning };
    let [x, y, z] = found.rotation_off_vector_deg;
    let measured = format!(
        "the camera is turned by {value:.2} ± {sigma:.2} deg against T_BS (rotation vector in the camera frame {x:.2}, {y:.2}, {z:.2} deg)"
    );
    let expected = format!("less than {} deg", ROTATION_DEG[0]);
    let change = "calibrate camera and inertial unit again, or check that T_BS belongs to this camera";
    findings.add(severity, FindingKind::ExtrinsicRotation, measured, expected, change);
}
