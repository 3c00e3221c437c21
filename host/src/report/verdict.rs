//! How good a run was, in words, by rules that stand beside each figure.

use super::folder::Output;
use super::html::length;

/// What a figure is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Light {
    /// Nothing to complain of.
    Good,
    /// Usable, and worth a look.
    Fair,
    /// Not to be relied on.
    Poor,
    /// There is nothing to judge by.
    Unknown,
}

impl Light {
    /// By two limits, inclusive; more is worse.
    fn below(value: f64, good: f64, fair: f64) -> Self {
        if value <= good {
            Self::Good
        } else if value <= fair {
            Self::Fair
        } else {
            Self::Poor
        }
    }

    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Poor => "poor",
            Self::Unknown => "not judged",
        }
    }

    pub(super) fn class(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            known => known.word(),
        }
    }
}

/// A figure of the first screen.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figure {
    /// Where it stands in `report.json`.
    pub pointer: &'static str,
    pub label: &'static str,
    /// For people.
    pub shown: String,
    /// As it stands in `report.json`.
    pub value: Option<f64>,
    pub more: String,
    pub rule: String,
    pub light: Light,
}

/// The five figures.
pub(super) fn figures(output: &Output) -> [Figure; 5] {
    [position(output), scale(output), coverage(output), start(output), time(output)]
}

fn absent(pointer: &'static str, label: &'static str, more: &str, light: Light) -> Figure {
    Figure { pointer, label, shown: "–".into(), value: None, more: more.into(), rule: String::new(), light }
}

const NO_TRUTH: &str = "the recording has no true poses to compare with";

/// Why there is no error: no truth, or no pose that could be compared.
fn no_error(output: &Output) -> (&'static str, Light) {
    if output.number("/poses") == Some(0.0) { ("there is no pose to judge", Light::Poor) } else { (NO_TRUTH, Light::Unknown) }
}

fn position(output: &Output) -> Figure {
    const POINTER: &str = "/ate_rmse_m";
    const LABEL: &str = "position error";
    let Some(error) = output.number(POINTER) else {
        let (more, light) = no_error(output);
        return absent(POINTER, LABEL, more, light);
    };
    let path = output.number("/path_length_m").unwrap_or(0.0);
    let [good, fair] = [0.005, 0.02].map(|share| (share * path).max(0.01));
    Figure {
        pointer: POINTER,
        label: LABEL,
        shown: length(error),
        value: Some(error),
        more: format!("ATE, RMSE over {} flown ({:.2} %)", length(path), 100.0 * error / path.max(1e-9)),
        rule: format!("good up to 0.5 % of the way ({}), fair up to 2 % ({}); 1 cm always passes", length(good), length(fair)),
        light: Light::below(error, good, fair),
    }
}

fn scale(output: &Output) -> Figure {
    const POINTER: &str = "/scale_error_percent";
    const LABEL: &str = "scale error";
    let Some(error) = output.number(POINTER) else {
        let (more, light) = no_error(output);
        return absent(POINTER, LABEL, more, light);
    };
    Figure {
        pointer: POINTER,
        label: LABEL,
        shown: format!("{error:.1} %"),
        value: Some(error),
        more: "how much too large or too small the flown path came out".into(),
        rule: "good up to 2 %, fair up to 5 %".into(),
        light: Light::below(error, 2.0, 5.0),
    }
}

fn coverage(output: &Output) -> Figure {
    let share = output.number("/coverage").unwrap_or(0.0);
    let count = |pointer| output.number(pointer).unwrap_or(0.0);
    Figure {
        pointer: "/coverage",
        label: "images with a pose",
        shown: format!("{:.1} %", 100.0 * share),
        value: Some(share),
        more: format!("{} of {} images", count("/poses"), count("/frames")),
        rule: "good from 90 %, fair from 70 %".into(),
        light: Light::below(-share, -0.9, -0.7),
    }
}

fn start(output: &Output) -> Figure {
    const POINTER: &str = "/initialised_after_s";
    const LABEL: &str = "started after";
    let Some(after) = output.number(POINTER) else {
        return Figure { shown: "never".into(), ..absent(POINTER, LABEL, "it never found its first pose", Light::Poor) };
    };
    Figure {
        pointer: POINTER,
        label: LABEL,
        shown: format!("{after:.2} s"),
        value: Some(after),
        more: "from the first image to the first pose".into(),
        rule: "good up to 2 s, fair up to 5 s".into(),
        light: Light::below(after, 2.0, 5.0),
    }
}

fn time(output: &Output) -> Figure {
    const POINTER: &str = "/core_ms/median";
    const LABEL: &str = "time per image";
    let (Some(median), Some(p95)) = (output.number(POINTER), output.number("/core_ms/p95")) else {
        return absent(POINTER, LABEL, "no image was worked on", Light::Unknown);
    };
    let (rule, light) = match output.image_interval_ms() {
        Some(interval) => (
            format!("good if 95 % take less than half of the {interval:.0} ms between images, fair if less than all of it"),
            Light::below(p95, 0.5 * interval, interval),
        ),
        None => ("not judged: the time between images is not known".into(), Light::Unknown),
    };
    Figure {
        pointer: POINTER,
        label: LABEL,
        shown: format!("{median:.1} ms"),
        value: Some(median),
        more: format!("median; 95 % below {p95:.1} ms"),
        rule,
        light,
    }
}

/// A stretch of the run in one state of health.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stretch {
    pub from_s: f64,
    pub to_s: f64,
    /// `initialising`, `tracking`, `degraded` or `lost`.
    pub state: &'static str,
    /// What it waited for mostly, while initialising.
    pub waited_for: Option<&'static str>,
}

/// The run as stretches of health, each up to the beginning of the next.
pub(super) fn stretches(output: &Output) -> Vec<Stretch> {
    let mut found: Vec<(Stretch, Vec<&str>)> = Vec::new();
    for frame in &output.frames {
        let state = ["tracking", "degraded", "lost"].into_iter().find(|state| *state == frame.health).unwrap_or("initialising");
        let now = output.seconds(frame.stamp_ns);
        let reason = frame.health.strip_prefix("initialising_");
        if let Some((last, reasons)) = found.last_mut() {
            last.to_s = now;
            if last.state == state {
                reasons.extend(reason);
                continue;
            }
        }
        found.push((Stretch { from_s: now, to_s: now, state, waited_for: None }, reason.into_iter().collect()));
    }
    let named = found.into_iter().map(|(stretch, reasons)| Stretch { waited_for: most_common(&reasons).and_then(waits_for), ..stretch });
    named.collect()
}

fn most_common<'a>(reasons: &[&'a str]) -> Option<&'a str> {
    reasons.iter().copied().max_by_key(|reason| reasons.iter().filter(|other| *other == reason).count())
}

fn waits_for(reason: &str) -> Option<&'static str> {
    Some(match reason {
        "imu" => "inertial samples",
        "tracks" => "corners followed long enough",
        "parallax" => "motion",
        "excitation" => "acceleration",
        "gravity" => "a specific force like gravity (check units and axes)",
        "agreement" => "vision and inertial samples to agree (check T_BS and time stamps)",
        "computation" => "the start to be computed",
        _ => return None,
    })
}

/// Fewer corners than needed for less than this are a hiccup and no trouble, s.
const SHORTEST_TROUBLE_S: f64 = 0.25;

/// The run in a sentence or two, and the worst of its lights.
pub(super) fn verdict(output: &Output) -> (Light, String, String) {
    let figures = figures(output);
    let stretches = stretches(output);
    let [_, _, coverage, late, _] = &figures;
    let poses = output.number("/poses").unwrap_or(0.0);
    let worst = figures.iter().map(|figure| figure.light).filter(|light| *light != Light::Unknown).max().unwrap_or(Light::Unknown);
    let ended = output.text("/ended").unwrap_or("complete");
    let begun = |state: &str, least_s: f64| {
        let of = stretches.iter().filter(|stretch| stretch.state == state && stretch.to_s - stretch.from_s >= least_s);
        of.map(|stretch| stretch.from_s).collect::<Vec<_>>()
    };
    // A loss that leads to a new start shows as either.
    let again = stretches.windows(2).filter(|pair| pair[0].state != "initialising" && pair[1].state == "initialising");
    let mut lost = begun("lost", 0.0);
    lost.extend(again.filter(|pair| pair[0].state != "lost").map(|pair| pair[1].from_s));
    lost.sort_by(f64::total_cmp);
    let degraded = begun("degraded", SHORTEST_TROUBLE_S);
    let times = |at: &[f64]| at.iter().take(4).map(|at| format!("{at:.1} s")).collect::<Vec<_>>().join(", ");
    let often = |at: &[f64]| match at.len() {
        1 => format!("at {}", times(at)),
        2..=4 => format!("{} times: at {}", at.len(), times(at)),
        many => format!("{many} times, first at {}", times(&at[..1])),
    };
    let poor: Vec<_> = figures.iter().filter(|figure| figure.light == Light::Poor).map(|figure| figure.label).collect();
    let (light, headline) = if poses == 0.0 {
        (Light::Poor, "It never started: there is no trajectory".to_owned())
    } else if ended.starts_with("failed") {
        (Light::Poor, "The estimator failed".to_owned())
    } else if coverage.light == Light::Poor && late.light == Light::Poor {
        (Light::Poor, format!("Started only after {}: {} have a pose", late.shown, coverage.more))
    } else if !lost.is_empty() {
        (worst.max_known(Light::Poor), format!("Tracking was lost {}", often(&lost)))
    } else if !degraded.is_empty() {
        (worst.max_known(Light::Fair), format!("Tracked, with too few corners {}", often(&degraded)))
    } else if worst == Light::Poor {
        (worst, format!("Tracked from start to end, but poor in {}", poor.join(", ")))
    } else {
        (worst, "Tracked from start to end".to_owned())
    };
    let mut details = Vec::new();
    if late.light == Light::Poor {
        // The last thing that it waited for before the first pose is what held it up.
        let start_s = late.value.unwrap_or(f64::INFINITY);
        let waited = stretches.iter().rev().filter(|stretch| stretch.from_s < start_s).find_map(|stretch| stretch.waited_for);
        details.extend(waited.map(|what| format!("It waited for {what}.")));
    }
    match (output.number("/ate_rmse_m"), output.number("/path_length_m")) {
        _ if poses == 0.0 => {}
        (Some(error), Some(path)) => details.push(format!("{} (RMSE) away from the truth over {} of flight.", length(error), length(path))),
        _ => details.push("How far off it is cannot be said: the recording has no true poses.".into()),
    }
    if poses > 0.0 && !poor.is_empty() && !headline.contains("poor in") {
        details.push(format!("Poor: {}.", poor.join(", ")));
    }
    if ended != "complete" {
        details.push(format!("The run was {ended}."));
    }
    let left_out = output.number("/images_left_out/count").unwrap_or(0.0);
    if left_out > 0.0 {
        details.push(format!("{left_out} images were left out."));
    }
    (light, headline, details.join(" "))
}

impl Light {
    /// The worse of two, where [`Light::Unknown`] is no judgement.
    fn max_known(self, other: Self) -> Self {
        if self == Self::Unknown { other } else { self.max(other) }
    }
}
