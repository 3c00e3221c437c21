//! A run in a line or two, for a terminal.

use std::path::Path;

use super::folder::Output;
use super::verdict::{Light, verdict};
use crate::fault::Fault;

/// What is said where errors cannot be measured.
pub const NO_TRUTH: &str = "no ground truth in the recording: errors are not measured";

/// How a run went, judged by the rules of the report.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The judgement of the report.
    pub light: Light,
    /// How many images have a pose and how far off they are.
    pub line: String,
    /// The first sentence of the report.
    pub headline: String,
}

impl Summary {
    /// Of the output folder of a run.
    ///
    /// # Errors
    /// When the folder is none of a run.
    pub fn of(folder: &Path) -> Result<Self, Fault> {
        Ok(Self::of_output(&Output::read(folder)?))
    }

    fn of_output(output: &Output) -> Self {
        let (light, headline, _) = verdict(output);
        let share = 100.0 * output.number("/coverage").unwrap_or(0.0);
        let error = output.number("/ate_rmse_m");
        let line = match error {
            _ if output.number("/poses").unwrap_or(0.0) == 0.0 => "tracked none of the images".to_owned(),
            Some(error) => format!("tracked {share:.0} % of the images, {} off the truth", distance(error)),
            None => format!("tracked {share:.0} % of the images, errors are not measured"),
        };
        Self { light, line, headline }
    }
}

/// Millimetres up to a metre.
fn distance(metres: f64) -> String {
    match metres {
        small if small < 0.00995 => format!("{:.1} mm", 1e3 * metres),
        medium if medium < 0.9995 => format!("{:.0} mm", 1e3 * metres),
        _ => format!("{metres:.2} m"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn summary(report: Value) -> Summary {
        Summary::of_output(&Output {
            name: "out".into(),
            report,
            poses: Vec::new(),
            frames: Vec::new(),
            planes: Vec::new(),
            points: Vec::new(),
            scales: Vec::new(),
            pictures: Vec::new(),
        })
    }

    fn report(coverage: f64, ate_m: Value) -> Value {
        json!({"frames": 100, "poses": 98, "coverage": coverage, "ended": "complete", "initialised_after_s": 0.5,
            "ate_rmse_m": ate_m, "path_length_m": 10.0, "scale_error_percent": 0.5})
    }

    #[test]
    fn the_line_is_judged_as_the_report_judges() {
        // Of 10 m, 5 cm are the most that is good and 20 cm the most that is fair.
        for (error, shown, light) in [
            (0.0024, "2.4 mm", Light::Good),
            (0.024, "24 mm", Light::Good),
            (0.051, "51 mm", Light::Fair),
            (0.25, "250 mm", Light::Poor),
            (0.9999, "1.00 m", Light::Poor),
        ] {
            let found = summary(report(0.98, error.into()));
            assert_eq!((found.line, found.light), (format!("tracked 98 % of the images, {shown} off the truth"), light));
        }
        assert_eq!(summary(report(0.6, 0.024.into())).light, Light::Poor);
    }

    #[test]
    fn without_truth_or_poses_nothing_is_claimed() {
        let blind = summary(report(0.98, Value::Null));
        assert_eq!((blind.line.as_str(), blind.light), ("tracked 98 % of the images, errors are not measured", Light::Good));
        let none = summary(json!({"frames": 10, "poses": 0, "coverage": 0.0, "ended": "complete"}));
        assert_eq!((none.line.as_str(), none.light), ("tracked none of the images", Light::Poor));
    }
}
