//! `table.md`, `runs.csv`, `suite.json`.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;

use super::{RunResult, Style, Summary, Variant};
use crate::config::Config;
use crate::fault::Fault;

/// `suite.json`. The names of the fields are an interface: they stay.
#[derive(Serialize)]
struct SuiteJson<'a> {
    libella: &'static str,
    suite: &'a str,
    complete: bool,
    runs: u32,
    depth: &'a str,
    variants: &'a [Variant],
    protocol: Vec<String>,
    configuration: &'a Config,
    sequences: Vec<SequenceJson<'a>>,
    table: Vec<PlaceJson<'a>>,
    results: &'a [RunResult],
}

#[derive(Serialize)]
struct SequenceJson<'a> {
    name: &'a str,
    frames: usize,
    span_s: f64,
    is_rendered: bool,
    euroc: Option<&'static str>,
}

#[derive(Serialize)]
struct PlaceJson<'a> {
    sequence: &'a str,
    variant: Variant,
    ate_rmse_m_median: Option<f64>,
    runs: usize,
    lost: usize,
}

/// The suite as JSON.
fn json(summary: &Summary<'_>) -> String {
    let (plan, outcome) = (summary.plan, summary.outcome);
    let places = summary.sequences.iter().flat_map(|sequence| plan.variants.iter().map(move |variant| (sequence.name.as_str(), *variant)));
    let whole = SuiteJson {
        libella: env!("CARGO_PKG_VERSION"),
        suite: &plan.name,
        complete: outcome.is_complete(),
        runs: plan.runs,
        depth: &plan.depth,
        variants: &plan.variants,
        protocol: summary.protocol(),
        configuration: &plan.config,
        sequences: summary
            .sequences
            .iter()
            .map(|sequence| SequenceJson {
                name: &sequence.name,
                frames: sequence.frames,
                span_s: sequence.span_s,
                is_rendered: sequence.is_rendered,
                euroc: sequence.euroc,
            })
            .collect(),
        table: places
            .map(|(sequence, variant)| PlaceJson {
                sequence,
                variant,
                ate_rmse_m_median: summary.ate_m(sequence, variant),
                runs: summary.runs(sequence, variant).count(),
                lost: summary.runs(sequence, variant).filter(|run| run.ate_rmse_m.is_none()).count(),
            })
            .collect(),
        results: &outcome.results,
    };
    // What is written is text and numbers that were read from JSON before.
    serde_json::to_string_pretty(&whole).unwrap_or_default() + "\n"
}

/// One line per run.
fn csv(results: &[RunResult]) -> String {
    let mut text = String::from(
        "sequence,variant,run,seed,gravity_m_s2,skipped_images,ended,frames,poses,initialised_after_s,metric_after_s,ate_rmse_m,scale_error_percent,path_length_m,\
         pose_nees_mean,core_ms_median,wall_s\n",
    );
    let number = |value: Option<f64>| value.map(|value| format!("{value:.6}")).unwrap_or_default();
    for run in results {
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{:.2}",
            quoted(&run.sequence),
            run.variant.name(),
            run.run,
            run.seed,
            run.gravity_m_s2,
            run.skipped_images,
            quoted(&run.ended),
            run.frames,
            run.poses,
            number(run.initialised_after_s),
            number(run.metric_after_s),
            number(run.ate_rmse_m),
            number(run.scale_error_percent),
            number(run.path_length_m),
            number(run.pose_nees_mean),
            number(run.core_ms_median),
            run.wall_s
        );
    }
    text
}

/// A field as RFC 4180 wants it.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.to_owned() }
}

/// Writes the three files; returns the text of `suite.json`.
///
/// # Errors
/// When one cannot be written.
pub fn write_outputs(folder: &Path, summary: &Summary<'_>) -> Result<String, Fault> {
    let json = json(summary);
    for (name, text) in
        [("table.md", summary.render(Style::Markdown)), ("runs.csv", csv(&summary.outcome.results)), ("suite.json", json.clone())]
    {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| Fault::unwritable(&path, &error))?;
    }
    Ok(json)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_with_a_comma_stays_one_field() {
        assert_eq!(quoted("V1_01"), "V1_01");
        assert_eq!(quoted("V1_01, \"room\" 2"), "\"V1_01, \"\"room\"\" 2\"");
    }
}
