//! What a suite says: its tables, its protocol, and where a figure is over a threshold.

use super::median::{extent, mean, median};
use super::{Cell, Outcome, PAPER, Plan, PreparedSequence, Published, Row, RunResult, SYSTEMS, Style, Table, Variant};

/// Results with all that is needed to read them.
#[derive(Debug, Clone, Copy)]
pub struct Summary<'a> {
    /// What was to be run.
    pub plan: &'a Plan,
    /// On what.
    pub sequences: &'a [PreparedSequence],
    /// What came out.
    pub outcome: &'a Outcome,
}

/// A figure over the threshold.
#[derive(Debug, Clone, PartialEq)]
pub struct Exceeding {
    /// The row.
    pub sequence: String,
    /// The column.
    pub variant: Variant,
    /// The median, m; none where it is a run without trajectory.
    pub ate_rmse_m: Option<f64>,
}

/// The error figures and words of a whole suite.
impl Summary<'_> {
    /// The results of one place of the table.
    pub fn runs(&self, sequence: &str, variant: Variant) -> impl Iterator<Item = &RunResult> {
        self.outcome.results.iter().filter(move |result| result.sequence == sequence && result.variant == variant)
    }

    fn values(&self, sequence: &str, variant: Variant, figure: impl Fn(&RunResult) -> Option<f64>) -> Vec<Option<f64>> {
        self.runs(sequence, variant).map(figure).collect()
    }

    /// The median ATE of one place, m.
    #[must_use]
    pub fn ate_m(&self, sequence: &str, variant: Variant) -> Option<f64> {
        median(&self.values(sequence, variant, |run| run.ate_rmse_m))
    }

    /// Medians over the runs, and their mean over the sequences.
    fn medians(&self, title: &str, decimals: usize, figure: impl Fn(&RunResult) -> Option<f64> + Copy) -> Table {
        let mut rows: Vec<Row> = self
            .sequences
            .iter()
            .map(|sequence| {
                let cell = |variant: &Variant| {
                    let values = self.values(&sequence.name, *variant, figure);
                    let (lost, all) = (values.iter().filter(|value| value.is_none()).count(), values.len());
                    match median(&values) {
                        Some(value) => Cell::Value(value, (lost > 0).then(|| format!("{lost} of {all} lost"))),
                        None if values.is_empty() => Cell::Empty,
                        None => Cell::Text("lost".into()),
                    }
                };
                Row { name: sequence.name.clone(), cells: self.plan.variants.iter().map(cell).collect() }
            })
            .collect();
        let over_rows = |variant: &Variant| {
            let medians: Vec<Option<f64>> =
                self.sequences.iter().map(|sequence| median(&self.values(&sequence.name, *variant, figure))).collect();
            mean(&medians).map_or(Cell::Empty, |value| Cell::Value(value, None))
        };
        if rows.len() > 1 {
            rows.push(Row { name: "mean".into(), cells: self.plan.variants.iter().map(over_rows).collect() });
        }
        self.table(title, rows, decimals, true)
    }

    fn table(&self, title: &str, rows: Vec<Row>, decimals: usize, smallest_is_best: bool) -> Table {
        let columns = self.plan.variants.iter().map(|variant| variant.label().to_owned()).collect();
        Table { title: title.into(), corner: "sequence".into(), columns, rows, decimals, smallest_is_best }
    }

    /// One cell per sequence and variant, in words.
    fn worded(&self, title: &str, word: impl Fn(&[&RunResult]) -> Option<String>) -> Table {
        let rows = self.sequences.iter().map(|sequence| {
            let cell = |variant: &Variant| {
                let runs: Vec<&RunResult> = self.runs(&sequence.name, *variant).collect();
                word(&runs).map_or(Cell::Empty, Cell::Text)
            };
            Row { name: sequence.name.clone(), cells: self.plan.variants.iter().map(cell).collect() }
        });
        self.table(title, rows.collect(), 0, false)
    }

    /// The paper's table.
    #[must_use]
    pub fn ate_table(&self) -> Table {
        self.medians(&format!("RMSE ATE, m, median of {}", count(self.plan.runs, "run")), 4, |run| run.ate_rmse_m)
    }

    /// All tables of this program's own figures.
    #[must_use]
    pub fn own_tables(&self) -> Vec<Table> {
        let spread = |runs: &[&RunResult]| {
            let values: Vec<Option<f64>> = runs.iter().map(|run| run.ate_rmse_m).collect();
            extent(&values).map(|(low, high)| format!("{low:.4} to {high:.4}"))
        };
        let coverage = |runs: &[&RunResult]| {
            let lowest = runs.iter().map(|run| run.coverage).min_by(f64::total_cmp)?;
            Some(format!("{:.1}", 100.0 * lowest))
        };
        let mut tables = vec![self.ate_table()];
        if self.plan.runs > 1 {
            tables.push(self.worded("RMSE ATE, m, smallest and largest of the runs: smaller differences mean nothing", spread));
        }
        tables.push(self.medians("First pose after the first image, s, median", 2, |run| run.initialised_after_s));
        tables.push(self.medians("Scale right within 10 % from then on, after the first image, s, median", 2, |run| run.metric_after_s));
        tables.push(self.medians("Scale error, percent, median", 2, |run| run.scale_error_percent));
        tables.push(self.worded("Images with a pose, percent, lowest of the runs", coverage));
        tables.extend(self.truths_table());
        tables
    }

    /// The same runs against every truth of sequences that have more than one.
    fn truths_table(&self) -> Option<Table> {
        let mut rows = Vec::new();
        for sequence in self.sequences.iter().filter(|sequence| !sequence.other_truths.is_empty()) {
            let row = |truth: &str, figure: &dyn Fn(&RunResult) -> Option<f64>| {
                let cell = |variant: &Variant| {
                    let values = self.values(&sequence.name, *variant, figure);
                    median(&values).map_or(Cell::Empty, |value| Cell::Value(value, None))
                };
                Row { name: format!("{}, {truth}", sequence.name), cells: self.plan.variants.iter().map(cell).collect() }
            };
            rows.push(row("state_groundtruth_estimate0", &|run| run.ate_rmse_m));
            for truth in &sequence.other_truths {
                rows.push(row(truth.name, &|run| run.other_truths.iter().find(|other| other.truth == truth.name)?.ate_rmse_m));
            }
        }
        (!rows.is_empty()).then(|| self.table("RMSE ATE, m, against each truth of the recording, median", rows, 4, true))
    }

    /// What others report on the sequences of EuRoC that occur; nothing where none does.
    #[must_use]
    pub fn published_tables(&self) -> Vec<Table> {
        let mut names: Vec<&'static str> = Vec::new();
        for name in self.sequences.iter().filter_map(|sequence| sequence.euroc) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let table = |title: &str, systems: &[Published]| {
            let figures = |name: &str| -> Vec<Option<f64>> { systems.iter().map(|system| system.on(name)).collect() };
            let cells = |values: Vec<Option<f64>>| values.into_iter().map(|value| value.map_or(Cell::Empty, |v| Cell::Value(v, None)));
            let mut rows: Vec<Row> = names
                .iter()
                .filter(|name| figures(name).iter().any(Option::is_some))
                .map(|name| Row { name: (*name).to_owned(), cells: cells(figures(name)).collect() })
                .collect();
            if rows.len() > 1 {
                let means = systems.iter().map(|system| mean(&names.iter().map(|name| system.on(name)).collect::<Vec<_>>()));
                rows.push(Row { name: "mean".into(), cells: cells(means.collect()).collect() });
            }
            let columns = systems.iter().map(|system| system.name.to_owned()).collect();
            let (title, corner) = (title.to_owned(), "EuRoC".to_owned());
            (!rows.is_empty()).then_some(Table { title, corner, columns, rows, decimals: 4, smallest_is_best: false })
        };
        let paper = table("The paper's own figures, RMSE ATE, m, on the real images", &PAPER);
        let systems = table("Other systems as published, RMSE ATE, m, on the real images", &SYSTEMS);
        paper.into_iter().chain(systems).collect()
    }

    /// How the figures were made, one statement a line.
    #[must_use]
    pub fn protocol(&self) -> Vec<String> {
        let plan = self.plan;
        let (rendered, real): (Vec<_>, Vec<_>) = self.sequences.iter().partition(|sequence| sequence.is_rendered);
        let names =
            |sequences: &[&PreparedSequence]| sequences.iter().map(|sequence| sequence.name.as_str()).collect::<Vec<_>>().join(", ");
        let mut lines = vec![
            "poses: causal. Each was known when its image had been worked on, and is not touched afterwards; all of them from the first on are judged.".into(),
            "alignment: one rigid transform of the whole trajectory to the truth by least squares, without scale. Truth is interpolated at the stamps of the images.".into(),
            "loop closure: none, nor any map beyond the window of the estimator.".into(),
            format!(
                "runs: {} of each; run k has the seed {} + k - 1 and gravity {} + (k - 1) 1e-9 m/s2, and begins k - 1 images later, so that its decisions fall otherwise. A cell is the median over runs, the last row the mean of the medians. A run without a pose is lost, and worse than any number.",
                plan.runs, plan.config.seed, plan.config.estimator.gravity_m_s2
            ),
            format!(
                "variants: + CNN is depth from {} for at most {} images a second, all depths with the same weight (standard deviation of ln depth {} times inflation); + U weighs them by the uncertainty that the source states; + P draws landmarks to planes found among them.",
                plan.depth, plan.config.depth.rate_hz, plan.config.depth.sigma_log
            ),
        ];
        if !plan.variants.iter().any(|variant| variant.has_depth()) {
            lines.pop();
        }
        if !rendered.is_empty() {
            lines.push(format!(
                "images: rendered for {}{}.",
                names(&rendered),
                if rendered.iter().any(|sequence| sequence.euroc.is_some()) {
                    "; published figures are of the real images, so that rows of one and the other cannot be compared"
                } else {
                    ""
                }
            ));
        }
        if !real.is_empty() {
            lines.push(format!("images: as recorded for {}.", names(&real)));
        }
        if self.outcome.of_other_builds > 0 {
            let (others, all) = (self.outcome.of_other_builds, self.outcome.all);
            lines.push(format!("program: {others} of {all} runs were made by another build of this program, as --any-build allows."));
        }
        if let Some(result) = self.outcome.results.iter().find(|result| result.ended != "complete") {
            lines.push(format!("the estimator failed in at least one run: {}", result.ended));
        }
        lines
    }

    /// How the published figures were made, one system a line.
    #[must_use]
    pub fn published_protocol(&self) -> Vec<String> {
        let said = |system: &Published, name: &str| {
            format!("{name}: {}, {}; loop closure {}. {}.", system.sensors, system.poses, system.loops, system.source)
        };
        let occurs =
            |system: &&Published| self.sequences.iter().filter_map(|sequence| sequence.euroc).any(|name| system.on(name).is_some());
        let paper = PAPER.iter().take(1).filter(occurs).map(|system| said(system, "the paper"));
        paper.chain(SYSTEMS.iter().map(|system| said(system, system.name))).collect()
    }

    /// Places of the table whose median is over a threshold or lost.
    #[must_use]
    pub fn above(&self, threshold_m: f64) -> Vec<Exceeding> {
        let places = self.sequences.iter().flat_map(|sequence| self.plan.variants.iter().map(move |variant| (sequence, *variant)));
        places
            .map(|(sequence, variant)| Exceeding {
                sequence: sequence.name.clone(),
                variant,
                ate_rmse_m: self.ate_m(&sequence.name, variant),
            })
            .filter(|place| place.ate_rmse_m.is_none_or(|ate| ate > threshold_m))
            .collect()
    }

    /// Everything for a reader.
    #[must_use]
    pub fn render(&self, style: Style) -> String {
        let mut parts = Vec::new();
        if style == Style::Markdown {
            parts.push(format!("## {}\n", self.plan.name));
        }
        if !self.outcome.is_complete() {
            parts.push(format!("Not finished: {} of {} runs.\n", self.outcome.results.len(), self.outcome.all));
        }
        let list = |title: &str, lines: &[String]| {
            let lines: String = lines.iter().map(|line| format!("- {line}\n")).collect();
            match style {
                Style::Plain => format!("{title}\n{lines}"),
                Style::Markdown => format!("### {title}\n\n{lines}"),
            }
        };
        parts.extend(self.own_tables().iter().map(|table| table.render(style)));
        parts.push(list("Protocol", &self.protocol()));
        let published = self.published_tables();
        if !published.is_empty() {
            parts.extend(published.iter().map(|table| table.render(style)));
            parts.push(list("Protocols of the published figures", &self.published_protocol()));
        }
        parts.join("\n")
    }
}

fn count(number: u32, what: &str) -> String {
    if number == 1 { format!("1 {what}") } else { format!("{number} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    fn sequence(name: &str) -> PreparedSequence {
        PreparedSequence {
            name: name.into(),
            path: "".into(),
            frames: 100,
            is_rendered: name == "V1_01",
            euroc: crate::suite::euroc_name(name),
            span_s: 5.0,
            fingerprint: String::new(),
            other_truths: Vec::new(),
        }
    }

    fn result(sequence: &str, variant: Variant, run: u32, ate_rmse_m: Option<f64>) -> RunResult {
        RunResult {
            sequence: sequence.into(),
            variant,
            run,
            key: String::new(),
            build: String::new(),
            seed: 0,
            gravity_m_s2: 9.81,
            skipped_images: 0,
            ended: "complete".into(),
            frames: 100,
            poses: 90,
            coverage: 0.9,
            initialised_after_s: ate_rmse_m.map(|_| 0.5),
            metric_after_s: None,
            ate_rmse_m,
            scale_error_percent: None,
            path_length_m: None,
            pose_nees_mean: None,
            rpe: Vec::new(),
            other_truths: Vec::new(),
            depth_maps: None,
            share_on_planes: None,
            core_ms_median: None,
            wall_s: 1.0,
        }
    }

    #[test]
    fn medians_over_runs_and_their_mean_over_sequences() {
        let plan = Plan {
            name: "x".into(),
            runs: 3,
            variants: vec![Variant::Mono, Variant::Cnn],
            depth: "indoor".into(),
            config: Config::default(),
            sequences: Vec::new(),
        };
        let sequences = [sequence("V1_01"), sequence("room")];
        let runs = |name: &'static str, variant: Variant, values: [Option<f64>; 3]| {
            values.into_iter().zip(1..).map(move |(value, run)| result(name, variant, run, value))
        };
        let results: Vec<RunResult> = runs("V1_01", Variant::Mono, [Some(0.03), Some(0.01), Some(0.02)])
            .chain(runs("V1_01", Variant::Cnn, [Some(0.05), Some(0.03), None]))
            .chain(runs("room", Variant::Mono, [Some(0.04), Some(0.04), Some(0.04)]))
            .chain(runs("room", Variant::Cnn, [Some(0.01), None, None]))
            .collect();
        let outcome = Outcome { all: results.len(), found: 0, of_other_builds: 0, results };
        let summary = Summary { plan: &plan, sequences: &sequences, outcome: &outcome };
        let expected = "\
### RMSE ATE, m, median of 3 runs

| sequence | mono-inertial |                + CNN |
|---|---:|---:|
| V1_01    |    **0.0200** | 0.0500 (1 of 3 lost) |
| room     |        0.0400 |                 lost |
| mean     |        0.0300 |                    – |
";
        assert_eq!(summary.ate_table().render(Style::Markdown), expected);
        let whole = summary.render(Style::Plain);
        assert!(whole.contains("0.0100 to 0.0300"), "{whole}");
        // V1_01 has published figures beside it, and the text says that these images are others.
        assert!(whole.contains("The paper's own figures") && whole.contains("rendered for V1_01; published figures"), "{whole}");
        let above: Vec<_> = summary.above(0.03).into_iter().map(|place| (place.sequence, place.variant, place.ate_rmse_m)).collect();
        let place = |name: &str, variant, ate| (name.to_owned(), variant, ate);
        let expected =
            [place("V1_01", Variant::Cnn, Some(0.05)), place("room", Variant::Mono, Some(0.04)), place("room", Variant::Cnn, None)];
        assert_eq!(above, expected);
    }
}
