//! Planes over time, and the time that the stages of the estimator took.

use std::fmt::Write as _;

use super::chart::{Chart, Line, Points};
use super::curves::{blank, over_frames};
use super::folder::Output;
use super::html::{duration, table};
use super::verdict::Stretch;

/// Stages of the estimator in order.
const STAGES: [&str; 4] = ["imu", "track", "depth", "solve"];

pub(super) fn planes(output: &Output) -> String {
    if output.planes.is_empty() {
        let sought = output.report.pointer("/planes").is_some_and(|planes| !planes.is_null());
        return if sought { "<p class=\"note\">Planes were sought; none was found steadily.</p>".into() } else { String::new() };
    }
    let span = output.duration_s().max(1e-6);
    let mut rows = String::new();
    for plane in &output.planes {
        let (from, to) = (output.seconds(plane.first_seen_ns), output.seconds(plane.last_seen_ns));
        let (gone, said) = match plane.gone_into {
            None => ("", format!("{} points", plane.support)),
            Some(0) => (" gone", "given up".to_owned()),
            Some(into) => (" gone", format!("became part of {into}")),
        };
        let _ = write!(
            rows,
            "<div class=\"row{gone}\"><span class=\"name\">{class} {id} <small>{said}</small></span><span class=\"bar\">\
             <i class=\"p-{class}\" style=\"left:{:.2}%;width:{:.2}%\" title=\"seen {from:.1} s to {to:.1} s\"></i></span></div>",
            100.0 * from.max(0.0) / span,
            (100.0 * (to - from) / span).max(0.6),
            class = plane.class,
            id = plane.id,
        );
    }
    let share = output.number("/planes/share_on_planes");
    let share = share.map(|share| format!(" {:.0} % of the landmarks were drawn to one.", 100.0 * share)).unwrap_or_default();
    format!(
        "<p class=\"note\">From first to last seen, over the {} of the run.{share}</p><div class=\"rows\">{rows}\
         <div class=\"row ends\"><span class=\"name\"></span><span class=\"bar\"><small>0 s</small><small>{}</small></span></div></div>",
        duration(span),
        duration(span)
    )
}

pub(super) fn time_and_memory(output: &Output, stretches: &[Stretch]) -> String {
    let mut lines = Vec::new();
    let mut below: Points = over_frames(output, |_| Some(0.0));
    for (place, stage) in STAGES.into_iter().enumerate() {
        let values = over_frames(output, |frame| frame.stages_ms.get(place).copied());
        if values.iter().all(|(_, value)| *value == 0.0) {
            continue;
        }
        // Means over pieces, so that the stack stays a stack.
        let above: Points = below.iter().zip(&values).map(|((time, base), (_, value))| (*time, base + value)).collect();
        lines.push(Line {
            name: stage.into(),
            class: format!("s{place}"),
            points: Vec::new(),
            area: Some((averaged(&below), averaged(&above))),
        });
        below = above;
    }
    let stack = Chart {
        id: "stages",
        title: "Computing time per image",
        unit: "ms, stages on top of each other",
        from_zero: true,
        note: output.image_interval_ms().map(|interval| format!("An image comes every {interval:.0} ms. Smoothed.")).unwrap_or_default(),
        lines,
        // Means of many images lie far apart in a long run.
        gap_s: output.duration_s() / 40.0,
        ..blank(output, stretches)
    };
    let longest = output.number("/core_ms/max").unwrap_or(1.0).max(1e-9);
    let mut rows = String::new();
    for stage in STAGES.into_iter().chain([""]) {
        let pointer = if stage.is_empty() { "/core_ms".to_owned() } else { format!("/core_ms/stages/{stage}") };
        let value = |key: &str| output.number(&format!("{pointer}/{key}"));
        let (Some(median), Some(p95), Some(max)) = (value("median"), value("p95"), value("max")) else { continue };
        let name = if stage.is_empty() { "all" } else { stage };
        let class = STAGES.iter().position(|known| *known == stage).map_or("all".to_owned(), |place| format!("s{place}"));
        let _ = write!(
            rows,
            "<tr><th>{name}</th><td data-figure=\"{pointer}/median\" data-value=\"{median}\">{median:.2}</td><td>{p95:.2}</td><td>{max:.2}</td>\
             <td class=\"range {class}\"><span><i class=\"thin\" style=\"width:{:.1}%\"></i><i style=\"width:{:.1}%\"></i></span></td></tr>",
            100.0 * max / longest,
            100.0 * p95 / longest,
        );
    }
    let stages = if rows.is_empty() {
        String::new()
    } else {
        format!(
            "<table class=\"stages\"><thead><tr><th>stage</th><th>median, ms</th><th>95 %</th><th>most</th><th class=\"range\"></th></tr></thead>\
             <tbody>{rows}</tbody></table>"
        )
    };
    let mut facts = Vec::new();
    facts.extend(output.number("/rss_peak_mb").map(|peak| ("memory of the whole process at most".to_owned(), format!("{peak:.0} MB"))));
    facts.extend(output.number("/wall_s").map(|wall| ("the run took".to_owned(), duration(wall))));
    facts.extend(output.number("/images_per_s").map(|rate| ("images per second, reading files included".to_owned(), format!("{rate:.0}"))));
    format!("<div class=\"two\">{}<div>{stages}{}</div></div>", stack.html(), table(&facts))
}

/// Means over about two hundred pieces.
fn averaged(points: &[(f64, f64)]) -> Points {
    let size = points.len().div_ceil(200).max(1);
    let mean = |piece: &[(f64, f64)]| {
        let count = piece.len() as f64;
        (piece.iter().map(|point| point.0).sum::<f64>() / count, piece.iter().map(|point| point.1).sum::<f64>() / count)
    };
    points.chunks(size).map(mean).collect()
}
