//! The page that compares several runs.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::chart::{Chart, Line, round_steps, tick};
use super::first::health_strip;
use super::folder::Output;
use super::html::{duration, escape, length};
use super::page::document;
use super::space::overlay;
use super::verdict::{Light, figures, stretches, verdict};
use super::words::variant;
use crate::eval::percentile;

/// Runs that curves are drawn of in one chart.
const MOST_CURVES: usize = 8;

/// The runs of one recording, by variant.
struct Group<'a> {
    dataset: &'a str,
    variants: BTreeMap<String, Vec<&'a Output>>,
}

/// The page.
pub(super) fn page(outputs: &[Output]) -> String {
    let mut groups: Vec<Group<'_>> = Vec::new();
    for output in outputs {
        let place = groups.iter().position(|group| group.dataset == output.dataset()).unwrap_or_else(|| {
            groups.push(Group { dataset: output.dataset(), variants: BTreeMap::new() });
            groups.len() - 1
        });
        if let Some(group) = groups.get_mut(place) {
            group.variants.entry(variant(output)).or_default().push(output);
        }
    }
    let judged: Vec<Light> = outputs.iter().map(|output| verdict(output).0).collect();
    let count = |light| judged.iter().filter(|judged| **judged == light).count();
    let worst = judged.iter().copied().filter(|light| *light != Light::Unknown).max().unwrap_or(Light::Unknown);
    let variants: std::collections::BTreeSet<_> = groups.iter().flat_map(|group| group.variants.keys()).collect();
    let mut body = format!(
        "<header><p class=\"brand\">libella · comparison of runs</p><h1>{} runs on {} recording{}</h1><p class=\"what\">{}</p>\
         <p class=\"verdict {}\"><b><span class=\"lamp\" aria-hidden=\"true\"></span>{} good, {} fair, {} poor</b></p></header><main>",
        outputs.len(),
        groups.len(),
        if groups.len() == 1 { "" } else { "s" },
        escape(&variants.iter().map(|name| name.as_str()).collect::<Vec<_>>().join(" · ")),
        worst.class(),
        count(Light::Good),
        count(Light::Fair),
        count(Light::Poor),
    );
    let _ = write!(body, "<section id=\"table\"><h2>All runs</h2>{}</section>", table(&groups));
    for (id, title, pointer, factor, unit) in [
        ("ate", "Position error (ATE)", "/ate_rmse_m", 100.0, "cm"),
        ("scale", "Scale error", "/scale_error_percent", 1.0, "%"),
        ("core", "Computing time per image, median", "/core_ms/median", 1.0, "ms"),
    ] {
        let boxes = boxes(&groups, pointer, factor, unit);
        if !boxes.is_empty() {
            let _ = write!(body, "<section id=\"{id}\"><h2>{title}</h2>{boxes}</section>");
        }
    }
    let curves: String = groups.iter().enumerate().map(|(place, group)| curves(place, group)).collect();
    let _ = write!(body, "<section id=\"curves\"><h2>Side by side</h2>{curves}</section>");
    body += "<section id=\"protocol\"><h2>How this was measured</h2><ul><li>Causal poses, errors after SE(3) alignment without scale, each run \
             against the truth of its recording; the report of a single run says more.</li><li>A box spans the middle half of the runs, its \
             line is the median, the whiskers reach to the ends; every run is a dot.</li><li>The lamp is the worst figure of a run by the \
             rules of its own report: position error up to 0.5 % of the way is good, up to 2 % fair; scale 2 % and 5 %; images with a pose \
             90 % and 70 %; start 2 s and 5 s; time half of and all of the time between images. Lost tracking is poor.</li></ul></section></main>";
    body += "<footer>libella · every number here stands in report.json of the folder that the row names</footer>";
    document("Comparison · libella", &body, None)
}

fn table(groups: &[Group<'_>]) -> String {
    let mut rows = String::new();
    for group in groups {
        let of = |pointer: &str| {
            let values = group.variants.values().flatten().filter_map(|output| output.number(pointer));
            values.min_by(f64::total_cmp)
        };
        let best = of("/ate_rmse_m");
        for (name, output) in group.variants.iter().flat_map(|(name, outputs)| outputs.iter().map(move |output| (name, output))) {
            let (light, headline, _) = verdict(output);
            let [ate, scale, coverage, start, time] = figures(output);
            let is_best = best.is_some() && output.number("/ate_rmse_m") == best;
            let strong = |text: &str| if is_best { format!("<b>{}</b>", escape(text)) } else { escape(text) };
            let cell = |figure: &super::verdict::Figure, shown: String| {
                let value = figure.value.map(|value| format!(" data-value=\"{value}\"")).unwrap_or_default();
                format!("<td data-figure=\"{}\"{value}>{shown}</td>", figure.pointer)
            };
            let memory = output.number("/rss_peak_mb").map_or("–".into(), |peak| format!("{peak:.0} MB"));
            let _ = write!(
                rows,
                "<tr class=\"{}\" data-folder=\"{folder}\"><th>{}<br/><small>{} · {folder}</small></th>{}{}{}{}{}<td>{memory}</td>\
                 <td class=\"text {class}\"><span class=\"lamp\" aria-hidden=\"true\"></span>{headline}{}</td></tr>",
                if is_best { "best" } else { "" },
                escape(group.dataset),
                escape(name),
                cell(&ate, strong(&ate.shown)),
                cell(&scale, escape(&scale.shown)),
                cell(&coverage, escape(&coverage.shown)),
                cell(&start, escape(&start.shown)),
                cell(&time, escape(&time.shown)),
                health_strip(output, &stretches(output)),
                folder = escape(&output.name),
                class = light.class(),
                headline = escape(&headline),
            );
        }
    }
    format!(
        "<div class=\"wide\"><table class=\"runs\"><thead><tr><th>recording</th><th>position error</th><th>scale error</th><th>images with a pose</th>\
         <th>started after</th><th>per image</th><th>memory</th><th>what happened</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
}

/// Boxplots over the runs of each variant, one scale per recording.
fn boxes(groups: &[Group<'_>], pointer: &str, factor: f64, unit: &str) -> String {
    let mut html = String::new();
    for group in groups {
        let of = |outputs: &[&Output]| {
            let mut values: Vec<f64> = outputs.iter().filter_map(|output| output.number(pointer)).map(|value| factor * value).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let most = group.variants.values().flat_map(|outputs| of(outputs)).fold(0.0, f64::max);
        if most <= 0.0 {
            continue;
        }
        let most = most * 1.06;
        let steps = round_steps(0.0, most, 5);
        let mut rows = String::new();
        for (place, (name, outputs)) in group.variants.iter().enumerate() {
            let values = of(outputs);
            let Some(median) = percentile(&values, 0.5) else {
                let _ = write!(
                    rows,
                    "<div class=\"row\"><span class=\"name\">{}</span><span class=\"bar\"></span><span>–</span></div>",
                    escape(name)
                );
                continue;
            };
            let at = |value: f64| 100.0 * value / most;
            let mut marks = String::new();
            if let (4.., Some(low), Some(high)) = (values.len(), percentile(&values, 0.25), percentile(&values, 0.75)) {
                let (first, last) = (values.first().copied().unwrap_or(low), values.last().copied().unwrap_or(high));
                let mut mark = |class: &str, from: f64, to: f64| {
                    let _ = write!(marks, "<i class=\"{class}\" style=\"left:{:.2}%;width:{:.2}%\"></i>", at(from), at(to) - at(from));
                };
                mark("whisker", first, low);
                mark("whisker", high, last);
                mark("fill", low, high);
                mark("edge", low, high);
            }
            let _ = write!(marks, "<i class=\"median\" style=\"left:{:.2}%\"></i>", at(median));
            for value in &values {
                let _ = write!(marks, "<b style=\"left:{:.2}%\" title=\"{value:.3} {unit}\"></b>", at(*value));
            }
            let runs = if values.len() == 1 { "1 run".to_owned() } else { format!("{} runs", values.len()) };
            let _ = write!(
                rows,
                "<div class=\"row c{}\"><span class=\"name\">{} <small>{runs}</small></span><span class=\"bar\">{marks}</span><span>{median:.2} {unit}</span></div>",
                place % 8 + 1,
                escape(name)
            );
        }
        let ends: String = steps
            .iter()
            .map(|step| format!("<span class=\"x\" style=\"left:{:.1}%\">{}</span>", 100.0 * step / most, tick(*step, &steps, false)))
            .collect();
        let _ = write!(
            html,
            "<figure class=\"rows box\"><figcaption><b>{}</b> <span class=\"unit\">{unit}, median at the right</span></figcaption>{rows}\
             <div class=\"row scale-row\"><span class=\"name\"></span><span class=\"axis\">{ends}</span></div></figure>",
            escape(group.dataset)
        );
    }
    html
}

/// The ways and the errors of the runs on one recording.
fn curves(place: usize, group: &Group<'_>) -> String {
    let all: Vec<(&String, &Output)> =
        group.variants.iter().flat_map(|(name, outputs)| outputs.iter().map(move |output| (name, *output))).collect();
    let shown = all.get(..all.len().min(MOST_CURVES)).unwrap_or_default();
    let seconds = shown.iter().map(|(_, output)| output.duration_s()).fold(0.0, f64::max);
    let lines = shown.iter().enumerate().map(|(index, (name, output))| Line {
        name: if all.len() == group.variants.len() { (*name).clone() } else { format!("{name}, {}", output.name) },
        class: format!("c{}", index % 8 + 1),
        points: output.frames.iter().filter_map(|frame| Some((output.seconds(frame.stamp_ns), 100.0 * frame.error_m?))).collect(),
        area: None,
    });
    let id = format!("error-{place}");
    let chart = Chart {
        id: &id,
        title: "Position error",
        unit: "cm",
        seconds,
        from_zero: true,
        gap_s: 0.5,
        lines: lines.collect(),
        ..Chart::default()
    };
    let left_out =
        if all.len() > shown.len() { format!("<p class=\"note\">Curves of the first {MOST_CURVES} runs.</p>") } else { String::new() };
    let outputs: Vec<&Output> = shown.iter().map(|(_, output)| *output).collect();
    let way = shown.iter().filter_map(|(_, output)| output.number("/path_length_m")).fold(0.0, f64::max);
    let way = if way > 0.0 { format!(", {} flown", length(way)) } else { String::new() };
    format!(
        "<h3>{} <small>{}{way}</small></h3>{left_out}<div class=\"two\">{}{}</div>",
        escape(group.dataset),
        duration(seconds),
        chart.html(),
        overlay(&format!("ways-{place}"), &outputs)
    )
}
