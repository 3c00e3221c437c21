//! A run and its recording in words.

use super::folder::Output;
use super::html::duration;

/// What ran, in words: number type, depth, planes, seed.
pub(super) fn configuration_in_words(output: &Output) -> Vec<String> {
    let mut words = vec![match output.text("/scalar") {
        Some("f32") => "single precision (f32)".to_owned(),
        _ => "double precision (f64)".to_owned(),
    }];
    words.push(match output.text("/depth/source").or_else(|| output.text("/configuration/depth/source")) {
        None | Some("none") => "camera and IMU, no depth network".to_owned(),
        Some(source) => {
            let rate = output.number("/configuration/depth/rate_hz").map(|rate| format!(", {rate} images/s")).unwrap_or_default();
            format!("camera, IMU and depth from {source}{rate}")
        }
    });
    let flag = |pointer| output.report.pointer(pointer).and_then(serde_json::Value::as_bool).unwrap_or(false);
    words.push(
        match (flag("/configuration/planes/used"), flag("/configuration/planes/find")) {
            (true, _) => "planes found and used",
            (false, true) => "planes found, not used",
            (false, false) => "no planes",
        }
        .to_owned(),
    );
    words.push(format!("seed {}", output.number("/seed").unwrap_or(0.0)));
    words
}

/// The same in a few letters, for tables.
pub(super) fn variant(output: &Output) -> String {
    let mut name = String::from("inertial");
    if let Some(source) = output.text("/depth/source").or_else(|| output.text("/configuration/depth/source")).filter(|name| *name != "none")
    {
        let source = output.text("/configuration/depth/source").unwrap_or(source);
        let short = source.rsplit(['/', '\\']).next().unwrap_or(source);
        name += &format!(" + depth ({short})");
    }
    if output.report.pointer("/configuration/planes/used").and_then(serde_json::Value::as_bool) == Some(true) {
        name += " + planes";
    }
    if output.text("/scalar") == Some("f32") {
        name += ", f32";
    }
    name
}

/// The recording in words.
pub(super) fn recording_in_words(output: &Output) -> String {
    let layout = match output.text("/layout") {
        Some("euroc") => "EuRoC/ASL folder",
        Some("corners") => "recording of corners",
        Some("simulated") => "rendered while it ran",
        _ => "recording",
    };
    let images = output.number("/frames").unwrap_or(0.0);
    format!("{layout}, {}, {images} images", duration(output.duration_s()))
}
