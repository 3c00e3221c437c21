//! Figures over time.

use nalgebra::Vector3;
use re_types::archetypes::{Scalars, SeriesLines};

use super::shapes::color;
use super::sink::Sink;
use crate::pipeline::{FrameResult, PoseResult};

/// Colours of x, y, z, and the same faint.
const AXES: [(&str, [u8; 3], [u8; 3]); 3] = [
    ("x", [0xff, 0x6e, 0x62], [0x80, 0x4a, 0x46]),
    ("y", [0x4c, 0xc7, 0x9a], [0x38, 0x69, 0x55]),
    ("z", [0x6e, 0xa8, 0xff], [0x46, 0x5c, 0x80]),
];
/// Stages of the estimator.
const STAGES: [(&str, [u8; 3]); 5] = [
    ("imu", [0x7d, 0x87, 0x94]),
    ("track", [0x6e, 0xa8, 0xff]),
    ("depth", [0xe6, 0xb8, 0x4a]),
    ("solve", [0x4c, 0xc7, 0x9a]),
    ("wait", [0xff, 0x7a, 0x6e]),
];
/// Standard deviations that a band is wide to either side.
const BAND: f64 = 3.0;
/// Sensors that have a bias, and its unit.
const BIASES: [(&str, &str); 2] = [("gyro", "rad/s"), ("accel", "m/s²")];

/// Names and colours, which hold all the time.
pub(super) fn describe(sink: &mut Sink) {
    for (sensor, unit) in BIASES {
        for (axis, ink, faint) in AXES {
            let line = SeriesLines::new().with_colors([color(ink)]).with_names([format!("{axis} [{unit}]")]).with_widths([2.0]);
            sink.log_static(&format!("bias/{sensor}/{axis}"), &line);
            let band = SeriesLines::new().with_colors([color(faint); 2]).with_widths([1.0; 2]);
            sink.log_static(
                &format!("bias/{sensor}/{axis}_band"),
                &band.with_names(["−", "+"].map(|sign| format!("{axis} {sign} 3 sigma"))),
            );
        }
    }
    for (stage, ink) in STAGES {
        sink.log_static(&format!("time_ms/{stage}"), &SeriesLines::new().with_colors([color(ink)]).with_names([format!("{stage} [ms]")]));
    }
    for (entity, name) in [
        ("error/position", "position error [m]"),
        ("error/nees", "NEES, 6 is right"),
        ("depth_scale", "factor on depths"),
        ("tracked", "landmarks with a depth"),
    ] {
        sink.log_static(entity, &SeriesLines::new().with_names([name]));
    }
}

/// A value at the time of the image, unless it is none.
pub(super) fn value(sink: &mut Sink, entity: &str, value: f64) {
    if value.is_finite() {
        sink.log(entity, &Scalars::new([value]));
    }
}

/// What is known of an image at once.
pub(super) fn frame(sink: &mut Sink, frame: &FrameResult) {
    let times = frame.depth.as_ref().map(|depth| depth.times);
    value(sink, "time_ms/imu", frame.imu_ms);
    value(sink, "time_ms/track", frame.track_ms);
    value(sink, "time_ms/solve", frame.solve_ms);
    if let Some(times) = times {
        value(sink, "time_ms/depth", times.push_ms);
        value(sink, "time_ms/wait", times.wait_ms);
    }
    if frame.outcome.is_some() {
        value(sink, "tracked", frame.tracked as f64);
    }
    if let Some(used) = frame.depth.as_ref().and_then(|depth| depth.used.as_ref().ok()) {
        value(sink, "depth_scale", used.scale);
    }
    if let Some(pose) = &frame.pose {
        biases(sink, pose);
    }
}

fn biases(sink: &mut Sink, pose: &PoseResult) {
    let mut log = |sensor: &str, bias: &Vector3<f64>, sigma: Option<Vector3<f64>>| {
        for (index, (axis, _, _)) in AXES.iter().enumerate() {
            value(sink, &format!("bias/{sensor}/{axis}"), bias[index]);
            if let Some(sigma) = sigma.filter(|sigma| sigma[index].is_finite()) {
                let band = [-BAND, BAND].map(|times| bias[index] + times * sigma[index]);
                sink.log(&format!("bias/{sensor}/{axis}_band"), &Scalars::new(band));
            }
        }
    };
    log("gyro", &pose.gyro_bias_rad_s, pose.bias_sigma.map(|sigma| sigma.gyro_rad_s));
    log("accel", &pose.accel_bias_m_s2, pose.bias_sigma.map(|sigma| sigma.accel_m_s2));
}
