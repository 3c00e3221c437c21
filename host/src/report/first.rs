//! What is seen first: what ran, how good it was, where it failed.

use std::fmt::Write as _;

use super::folder::Output;
use super::html::{duration, escape};
use super::verdict::{Figure, Stretch, figures, verdict};
use super::words::{configuration_in_words, recording_in_words};

pub(super) fn first_screen(output: &Output, stretches: &[Stretch]) -> String {
    let (light, headline, detail) = verdict(output);
    let cards: String = figures(output).iter().map(card).collect();
    format!(
        "<header><p class=\"brand\">libella · report of a run</p><h1>{name}</h1><p class=\"what\">{recording}<br/>{words}</p>\
         <p class=\"verdict {class}\"><b><span class=\"lamp\" aria-hidden=\"true\"></span>{headline}</b> <span>{detail}</span></p>\
         {line}<div class=\"cards\">{cards}</div></header>",
        name = escape(output.dataset()),
        recording = escape(&recording_in_words(output)),
        words = escape(&configuration_in_words(output).join(" · ")),
        class = light.class(),
        headline = escape(&headline),
        detail = escape(&detail),
        line = health_line(output, stretches),
    )
}

fn card(figure: &Figure) -> String {
    let value = figure.value.map(|value| format!(" data-value=\"{value}\"")).unwrap_or_default();
    let rule = if figure.rule.is_empty() { String::new() } else { format!("<p class=\"rule\">{}</p>", escape(&figure.rule)) };
    format!(
        "<div class=\"card {class}\" data-figure=\"{pointer}\"{value}><p class=\"label\">{label}</p><p class=\"value\">{shown}</p>\
         <p class=\"light\"><span class=\"lamp\" aria-hidden=\"true\"></span>{word}</p><p class=\"more\">{more}</p>{rule}</div>",
        class = figure.light.class(),
        pointer = figure.pointer,
        label = figure.label,
        shown = escape(&figure.shown),
        word = figure.light.word(),
        more = escape(&figure.more),
    )
}

/// The time line of health. In tables it stands without its legend.
pub(super) fn health_strip(output: &Output, stretches: &[Stretch]) -> String {
    let span = output.duration_s().max(1e-6);
    let parts: String = stretches
        .iter()
        .map(|stretch| {
            let waiting = stretch.waited_for.map(|what| format!(", waiting for {what}")).unwrap_or_default();
            format!(
                "<i class=\"h-{}\" style=\"left:{:.2}%;width:{:.2}%\" title=\"{}{} {:.1} s to {:.1} s\"></i>",
                stretch.state,
                100.0 * stretch.from_s / span,
                (100.0 * (stretch.to_s - stretch.from_s) / span).max(0.4),
                stretch.state,
                escape(&waiting),
                stretch.from_s,
                stretch.to_s
            )
        })
        .collect();
    format!("<div class=\"strip\">{parts}</div>")
}

fn health_line(output: &Output, stretches: &[Stretch]) -> String {
    if stretches.is_empty() {
        return "<p class=\"note\">No time line: the folder has no frames.csv.</p>".into();
    }
    let span = output.duration_s().max(1e-6);
    let mut marks = String::new();
    let mut mark = |kind: &str, letter: &str, at: f64, said: &str| {
        let _ = write!(
            marks,
            "<b class=\"mark {kind}\" style=\"left:{:.2}%\" title=\"{} at {at:.1} s\">{letter}</b>",
            100.0 * at / span,
            escape(said)
        );
    };
    let left_out = output.frames.iter().filter(|frame| frame.left_out);
    for frame in left_out.take(200) {
        mark("out", "", output.seconds(frame.stamp_ns), "image left out");
    }
    let first_pose = output.number("/initialised_after_s");
    if let Some(after) = first_pose {
        mark("begun", "▲", after, "first pose");
    }
    for stretch in stretches.iter().filter(|stretch| matches!(stretch.state, "degraded" | "lost")).take(40) {
        let (letter, said) = if stretch.state == "lost" { ("✕", "lost") } else { ("!", "too few corners") };
        mark(stretch.state, letter, stretch.from_s, said);
    }
    let share = |state: &str| {
        let time: f64 = stretches.iter().filter(|stretch| stretch.state == state).map(|stretch| stretch.to_s - stretch.from_s).sum();
        let there = stretches.iter().any(|stretch| stretch.state == state);
        there.then(|| format!("<span class=\"key\"><i class=\"h-{state}\"></i>{} {}</span>", word_of(state), duration(time)))
    };
    let keys: String = ["initialising", "tracking", "degraded", "lost"].into_iter().filter_map(share).collect();
    let first_pose = first_pose.map_or("", |_| "<span class=\"key\">▲ first pose</span>");
    let outs = output.frames.iter().filter(|frame| frame.left_out).count();
    let outs =
        if outs > 0 { format!("<span class=\"key\"><i class=\"tickmark\"></i>{outs} images left out</span>") } else { String::new() };
    let waited: Vec<_> = stretches.iter().filter_map(|stretch| stretch.waited_for).collect();
    let waited =
        waited.first().map(|what| format!("<span class=\"key\">at first it waited for {}</span>", escape(what))).unwrap_or_default();
    format!(
        "<div class=\"health\" id=\"health\" role=\"img\" aria-label=\"time line of the run\"><div class=\"marks\">{marks}</div>{}<div class=\"ends\"><span>0 s</span><span>{}</span></div>\
         <p class=\"keys\">{first_pose}{keys}{outs}{waited}</p></div>",
        health_strip(output, stretches),
        duration(output.duration_s())
    )
}

fn word_of(state: &str) -> &str {
    if state == "degraded" { "degraded (too few corners)" } else { state }
}
