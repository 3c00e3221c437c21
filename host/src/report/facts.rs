//! What stands in words and tables: warnings, all figures, how they were measured, the configuration.

use std::fmt::Write as _;

use serde_json::Value;

use super::folder::Output;
use super::html::{escape, length, table};
use crate::config::Config;

pub(super) fn warnings(output: &Output) -> String {
    let mut said = Vec::new();
    let times = |count: f64| if count > 1.0 { format!(" ({count} times)") } else { String::new() };
    for remark in output.report.pointer("/remarks").and_then(Value::as_array).into_iter().flatten() {
        let count = remark.get("count").and_then(Value::as_f64).unwrap_or(1.0);
        said.extend(remark.get("first").and_then(Value::as_str).map(|first| format!("{first}{}", times(count))));
    }
    for (pointer, what) in [
        ("/images_left_out", "images left out"),
        ("/imu_left_out", "inertial samples left out"),
        ("/depth/failed", "images without their depth"),
    ] {
        let first = output.text(&format!("{pointer}/first"));
        said.extend(first.map(|first| format!("{} {what}, first: {first}", output.number(&format!("{pointer}/count")).unwrap_or(0.0))));
    }
    if let Some(ended) = output.text("/ended").filter(|ended| *ended != "complete") {
        said.push(format!("the run did not come to its end: {ended}"));
    }
    if said.is_empty() {
        return "<p class=\"note\">None: every image and inertial sample was taken.</p>".into();
    }
    let said: String = said.iter().map(|said| format!("<li>{}</li>", escape(said))).collect();
    format!("<ul class=\"warnings\">{said}</ul>")
}

pub(super) fn all_figures(output: &Output) -> String {
    let mut facts = Vec::new();
    let mut add = |name: &str, value: Option<String>| facts.extend(value.map(|value| (name.to_owned(), value)));
    let metres = |pointer: &str| output.number(pointer).map(length);
    add("ATE, RMSE", metres("/ate_rmse_m"));
    add("ATE, mean", metres("/ate_m/mean"));
    add("ATE, median", metres("/ate_m/median"));
    add("ATE, 95 %", metres("/ate_m/p95"));
    add("ATE, largest", metres("/ate_m/max"));
    add("way flown", metres("/path_length_m"));
    add("ATE of the smooth trajectory, RMSE", metres("/smooth/ate_rmse_m"));
    let nees = output.number("/pose_nees/mean").zip(output.number("/pose_nees/median"));
    add("NEES of the pose, 6 is right", nees.map(|(mean, median)| format!("{mean:.2} mean, {median:.2} median")));
    for (outcome, count) in output.report.pointer("/outcomes").and_then(Value::as_object).into_iter().flatten() {
        add(&format!("images: {}", outcome.replace('_', " ")), count.as_f64().map(|count| format!("{count}")));
    }
    let mut html = table(&facts);
    let relative = output.report.pointer("/rpe").and_then(Value::as_array).into_iter().flatten().filter_map(|error| {
        let value = |key: &str| error.get(key).and_then(Value::as_f64);
        Some(format!(
            "<tr><th>{} m</th><td>{}</td><td>{:.2} %</td><td>{:.2}°</td><td>{}</td></tr>",
            value("distance_m")?,
            length(value("translation_rmse_m")?),
            value("translation_rmse_percent")?,
            value("rotation_rmse_deg")?,
            value("pairs")?
        ))
    });
    let relative: String = relative.collect();
    if !relative.is_empty() {
        let _ = write!(
            html,
            "<table><caption>Drift over stretches of the way (RPE, RMSE)</caption><thead><tr><th>over</th><th>position</th><th>of the way</th>\
             <th>rotation</th><th>stretches</th></tr></thead><tbody>{relative}</tbody></table>"
        );
    }
    format!("<div class=\"two\">{html}</div>")
}

pub(super) fn protocol(output: &Output) -> String {
    let gap = output.number("/configuration/evaluation/max_truth_gap_s").unwrap_or(0.1);
    let mut said = vec![
        "Every pose is causal: it was known when its image had been worked on, and was not touched afterwards. No loop closure.".to_owned(),
    ];
    if output.has_truth() {
        said.push(format!(
            "Position errors are taken after alignment of all poses to the truth by one rotation and translation (SE(3), Umeyama), without \
             scale. The truth is interpolated at the time of each image, over pauses of {gap} s at most. Poses are those of the inertial unit."
        ));
        said.push("Scale error: the factor on the estimate that would have fitted best, less 1.".to_owned());
        said.push(
            "RPE: from every pose to the one nearest to the given length along the estimated path, within a tenth, without alignment, \
             as evo_rpe --all_pairs has it."
                .to_owned(),
        );
        said.push(
            "NEES: the squared error of rotation and position against the stated covariance, after the first pose has been laid onto the truth \
             by translation and heading."
                .to_owned(),
        );
    } else {
        said.push("There are no true poses, so that nothing here says how far off the trajectory is.".to_owned());
    }
    said.push("Computing time is that of the estimator alone, on the machine of the run: reading and decoding images, the network and drawing are not in it.".to_owned());
    let said: String = said.iter().map(|said| format!("<li>{}</li>", escape(said))).collect();
    format!("<ul>{said}</ul>")
}

pub(super) fn configuration(output: &Output) -> String {
    let Some(used) = output.report.pointer("/configuration") else { return String::new() };
    let default = serde_json::to_value(Config::default()).unwrap_or_default();
    let (mut used_keys, mut default_keys) = (Vec::new(), Vec::new());
    flatten("", used, &mut used_keys);
    flatten("", &default, &mut default_keys);
    let is_default = |key: &(String, String)| default_keys.contains(key);
    let changed: Vec<_> = used_keys.iter().filter(|key| !is_default(key)).collect();
    let changed = if changed.is_empty() {
        "Every setting has its default.".to_owned()
    } else {
        let changed: Vec<_> = changed.iter().map(|(key, value)| format!("{key} = {value}")).collect();
        format!("Changed from the default: {}.", changed.join(", "))
    };
    let rows: String = used_keys
        .iter()
        .map(|key| {
            let class = if is_default(key) { "" } else { " class=\"changed\"" };
            format!("<tr{class}><th>{}</th><td>{}</td></tr>", escape(&key.0), escape(&key.1))
        })
        .collect();
    format!(
        "<p>{}</p><details><summary>all {} settings</summary><table class=\"plain\"><tbody>{rows}</tbody></table></details>",
        escape(&changed),
        used_keys.len()
    )
}

fn flatten(prefix: &str, value: &Value, keys: &mut Vec<(String, String)>) {
    match value {
        Value::Object(inner) => {
            for (key, value) in inner {
                flatten(&if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") }, value, keys);
            }
        }
        other => keys.push((prefix.to_owned(), other.to_string())),
    }
}
