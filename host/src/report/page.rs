//! The page of one run.

use std::fmt::Write as _;

use serde_json::Value;

use super::chart::{Chart, Line, Points};
use super::folder::{Output, Picture, known_class};
use super::html::{data_uri, duration, escape, json_for_script, length, table};
use super::space::Space;
use super::verdict::{Figure, Stretch, configuration_in_words, figures, recording_in_words, stretches, verdict};
use crate::config::Config;

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");
/// Stages of the estimator in order.
const STAGES: [&str; 4] = ["imu", "track", "depth", "solve"];
/// 95 % of a χ² of six degrees of freedom lie between these.
const NEES_BAND: (f64, f64) = (1.237, 14.449);

/// A document around the content of its body.
pub(super) fn document(title: &str, body: &str, scene: Option<&Value>) -> String {
    let scene = scene.map(|scene| format!("<script type=\"application/json\" id=\"scene\">{}</script>", json_for_script(scene)));
    // An icon of its own, or a browser asks the server for one.
    let icon = data_uri("image/svg+xml", ICON.as_bytes());
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<meta name=\"color-scheme\" content=\"light dark\"/>\n\
         <title>{}</title>\n<link rel=\"icon\" href=\"{icon}\"/>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n{}\n<script>{SCRIPT}</script>\n</body>\n</html>\n",
        escape(title),
        scene.unwrap_or_default(),
    )
}

const ICON: &str = "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 16 16\"><path d=\"M2 13C5 2 9 14 14 3\" fill=\"none\" stroke=\"#1f5fbf\" stroke-width=\"3\"/></svg>";

/// The page.
pub(super) fn page(output: &Output) -> String {
    let stretches = stretches(output);
    let trouble = stretches.iter().filter(|stretch| !matches!(stretch.state, "tracking" | "initialising"));
    let space = Space::of(output, trouble.map(|stretch| (stretch.from_s, stretch.to_s)).collect());
    let mut body = first_screen(output, &stretches);
    body += "<main>";
    section(&mut body, "way", "Where it flew", &where_it_flew(output, &space));
    section(&mut body, "pictures", "What it saw", &what_it_saw(output));
    section(&mut body, "curves", "How wrong, and how sure", &curves(output, &stretches));
    section(&mut body, "depth", "Depth", &depth(output, &stretches));
    section(&mut body, "planes", "Planes", &planes(output));
    section(&mut body, "time", "Time and memory", &time_and_memory(output, &stretches));
    section(&mut body, "warnings", "Warnings", &warnings(output));
    section(&mut body, "figures", "All figures", &all_figures(output));
    section(&mut body, "protocol", "How this was measured", &protocol(output));
    section(&mut body, "configuration", "Configuration", &configuration(output));
    body += "</main>";
    let _ = write!(
        body,
        "<footer>libella {} · every number here stands in report.json, frames.csv or trajectory.csv of the folder “{}”</footer>",
        escape(output.text("/libella").unwrap_or("")),
        escape(&output.name)
    );
    document(&format!("{} · libella", output.dataset()), &body, Some(&space.json()))
}

fn section(body: &mut String, id: &str, title: &str, content: &str) {
    if !content.is_empty() {
        let _ = writeln!(body, "<section id=\"{id}\"><h2>{title}</h2>{content}</section>");
    }
}

fn first_screen(output: &Output, stretches: &[Stretch]) -> String {
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

fn where_it_flew(output: &Output, space: &Space) -> String {
    if space.is_empty() {
        return "<p class=\"note\">There is no pose and no truth to draw.</p>".into();
    }
    let truth = if output.has_truth() {
        "<span class=\"key truth\"><i></i>truth</span>"
    } else {
        "<span class=\"key\">no truth in this recording</span>"
    };
    let mut classes: Vec<&str> = output.planes.iter().filter(|plane| plane.gone_into.is_none()).map(|plane| plane.class.as_str()).collect();
    classes.sort_unstable();
    classes.dedup();
    let planes: String = classes.iter().map(|class| format!("<span class=\"key p-{class}\"><i></i>{class}</span>")).collect();
    let points = if output.points.is_empty() { "" } else { "<span class=\"key dots\"><i></i>points of the map</span>" };
    let trouble = if space.trouble.is_empty() { "" } else { "<span class=\"key trouble\"><i></i>degraded or lost</span>" };
    format!(
        "<p class=\"keys\"><span class=\"key way\"><i></i>libella</span>{truth}{trouble}<span class=\"key\">○ start ● end</span>{planes}{points}</p>\
         <div class=\"two\">{}{}</div>\
         <figure class=\"space\" id=\"space\"><figcaption><b>In space</b> <span class=\"unit\">drag or arrow keys turn, wheel or pinch zooms</span>\
         <span class=\"buttons\"><button type=\"button\" data-view=\"home\">reset</button><button type=\"button\" data-view=\"top\">top</button>\
         <button type=\"button\" data-view=\"side\">side</button>\
         <label><input type=\"checkbox\" data-show=\"truth\" checked=\"checked\"/>truth</label><label><input type=\"checkbox\" data-show=\"points\" checked=\"checked\"/>points</label>\
         <label><input type=\"checkbox\" data-show=\"planes\" checked=\"checked\"/>planes</label></span></figcaption>\
         <canvas id=\"view\" tabindex=\"0\" aria-label=\"the way flown in space\"></canvas></figure>",
        space.flat("top", "From above", 0, 1),
        space.flat("side", "From the side", 0, 2),
    )
}

fn what_it_saw(output: &Output) -> String {
    if output.pictures.is_empty() {
        return String::new();
    }
    let pictures: String = output.pictures.iter().map(picture).collect();
    let mut classes: Vec<_> = output
        .pictures
        .iter()
        .flat_map(|picture| &picture.taken.corners)
        .filter_map(|corner| corner.plane.as_deref().map(known_class))
        .collect();
    classes.sort_unstable();
    classes.dedup();
    let planes: String = classes
        .iter()
        .map(|class| format!("<span class=\"key p-{class}\"><i></i>on a {class}</span>").replace("a floor", "the floor"))
        .collect();
    let maps = if output.pictures.iter().any(|picture| picture.depth.is_some()) {
        "<span class=\"key\">below: depth of the network from near to far, and its standard deviation</span>"
    } else {
        ""
    };
    format!(
        "<p class=\"keys\"><span class=\"key known\"><i></i>corner with a depth</span><span class=\"key unknown\"><i></i>not known yet</span>{planes}\
         <span class=\"key\">tails: the last 10 images</span>{maps}</p><div class=\"pictures\">{pictures}</div>"
    )
}

fn picture(picture: &Picture) -> String {
    let [width, height] = picture.taken.size_px;
    let mut paths = String::new();
    for corner in &picture.taken.corners {
        let class = match (&corner.plane, corner.depth_m) {
            (Some(plane), _) => format!("p-{}", known_class(plane)),
            (None, Some(_)) => "known".into(),
            (None, None) => "unknown".into(),
        };
        let Some([x, y]) = corner.trail_px.last() else { continue };
        if corner.trail_px.len() > 1 {
            let trail: Vec<String> = corner.trail_px.iter().map(|[x, y]| format!("{x:.0} {y:.0}")).collect();
            let _ = write!(paths, "<path class=\"trail {class}\" d=\"M{}\"/>", trail.join("L"));
        }
        let _ = write!(paths, "<circle class=\"{class}\" cx=\"{x:.0}\" cy=\"{y:.0}\" r=\"{}\"/>", width as f64 / 130.0);
    }
    let maps = [("depth", &picture.depth, &picture.taken.depth), ("sigma", &picture.sigma, &picture.taken.sigma)];
    let maps = maps.into_iter().filter_map(|(kind, uri, map)| {
        let (uri, map) = (uri.as_ref()?, map.as_ref()?);
        let end = |value: f64| if kind == "depth" { length(value) } else { format!("{:.0} %", 100.0 * value) };
        let name = if kind == "depth" { "depth of the network" } else { "its standard deviation" };
        Some(format!(
            "<div><img alt=\"{name}\" src=\"{uri}\"/><p class=\"scale {kind}\"><span>{}</span><i></i><span>{}</span></p></div>",
            end(map.range[0]),
            end(map.range[1])
        ))
    });
    let maps: String = maps.collect();
    let maps = if maps.is_empty() { String::new() } else { format!("<div class=\"maps\">{maps}</div>") };
    let known = picture.taken.corners.iter().filter(|corner| corner.depth_m.is_some()).count();
    let on_planes = picture.taken.corners.iter().filter(|corner| corner.plane.is_some()).count();
    let on_planes = if on_planes > 0 { format!(", {on_planes} on planes") } else { String::new() };
    let health = picture.taken.health.split('_').next().unwrap_or("");
    let alarm = if health == "tracking" { "" } else { " alarm" };
    format!(
        "<figure class=\"picture\"><div class=\"shot\"><img alt=\"image at {s:.1} s\" src=\"{}\"/>\
         <svg viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\">{paths}</svg></div>{maps}\
         <figcaption><b>{s:.1} s</b> <span class=\"state{alarm}\">{}</span> {} corners, {known} with a depth{on_planes}</figcaption></figure>",
        picture.image,
        escape(health),
        picture.taken.corners.len(),
        s = picture.taken.seconds,
    )
}

/// What every chart of a run has in common.
fn blank<'a>(output: &Output, stretches: &'a [Stretch]) -> Chart<'a> {
    let gap_s = 5.0 * output.image_interval_ms().unwrap_or(100.0) * 1e-3;
    Chart { seconds: output.duration_s(), stretches, gap_s, ..Chart::default() }
}

fn line(name: &str, class: &str, points: Points) -> Line {
    Line { name: name.into(), class: class.into(), points, area: None }
}

fn over_frames(output: &Output, value: impl Fn(&super::frames::Frame) -> Option<f64>) -> Points {
    output.frames.iter().filter_map(|frame| Some((output.seconds(frame.stamp_ns), value(frame)?))).collect()
}

fn curves(output: &Output, stretches: &[Stretch]) -> String {
    let error = Chart {
        id: "error",
        title: "Position error",
        unit: "cm",
        from_zero: true,
        lines: vec![line("distance to the truth", "c1", over_frames(output, |frame| frame.error_m.map(|error| 100.0 * error)))],
        ..blank(output, stretches)
    };
    let nees = Chart {
        id: "nees",
        title: "Honesty of the stated uncertainty (NEES)",
        unit: "6 is right",
        is_log: true,
        expected: Some(NEES_BAND),
        note: "Shaded: where 95 % of the values of an honest estimator lie. Above, it is too sure of itself; below, too modest.".into(),
        lines: vec![line("NEES of the pose", "c1", over_frames(output, |frame| frame.nees))],
        ..blank(output, stretches)
    };
    let mut html = String::new();
    if output.frames.is_empty() {
        html += "<p class=\"note\">No error over time, uncertainty and stage times: the folder has no frames.csv (it is of an older version).</p>";
    } else if !output.has_truth() {
        html += "<p class=\"note\">No error and no NEES: there are no true poses to compare with.</p>";
    }
    let charts = [
        error.html(),
        nees.html(),
        bias(
            output,
            stretches,
            "gyro-bias",
            "Gyro bias, less its last value",
            "deg/s",
            1.0_f64.to_degrees(),
            |pose| pose.gyro_bias,
            |frame| frame.sigma_gyro_bias,
        ),
        bias(
            output,
            stretches,
            "accel-bias",
            "Accelerometer bias, less its last value",
            "m/s²",
            1.0,
            |pose| pose.accel_bias,
            |frame| frame.sigma_accel_bias,
        ),
        Chart {
            id: "tracked",
            title: "Landmarks seen",
            unit: "with a depth, per image",
            from_zero: true,
            lines: vec![line("landmarks", "c2", over_frames(output, |frame| frame.tracked))],
            ..blank(output, stretches)
        }
        .html(),
    ];
    let charts = charts.concat();
    if charts.is_empty() && html.is_empty() { String::new() } else { format!("{html}<div class=\"two\">{charts}</div>") }
}

#[allow(clippy::too_many_arguments)]
fn bias(
    output: &Output,
    stretches: &[Stretch],
    id: &str,
    title: &str,
    unit: &str,
    factor: f64,
    value: impl Fn(&super::folder::Pose) -> [f64; 3],
    sigma: impl Fn(&super::frames::Frame) -> Option<[f64; 3]>,
) -> String {
    let sigmas: Vec<(i64, [f64; 3])> = output.frames.iter().filter_map(|frame| Some((frame.stamp_ns, sigma(frame)?))).collect();
    let last = output.poses.last().map(|pose| value(pose).map(|value| factor * value)).unwrap_or_default();
    let lines = [("x", "c1"), ("y", "c3"), ("z", "c2")].into_iter().enumerate().map(|(axis, (name, class))| {
        let at = |pose: &super::folder::Pose| (output.seconds(pose.stamp_ns), factor * value(pose)[axis] - last[axis]);
        let around = |sign: f64| {
            let poses = output.poses.iter().filter_map(|pose| {
                let place = sigmas.binary_search_by_key(&pose.stamp_ns, |(stamp, _)| *stamp).ok()?;
                let (time, middle) = at(pose);
                Some((time, middle + sign * factor * sigmas.get(place)?.1[axis]))
            });
            poses.collect::<Points>()
        };
        let area = (!sigmas.is_empty()).then(|| (around(-1.0), around(1.0)));
        Line { name: name.into(), class: class.into(), points: output.poses.iter().map(at).collect(), area }
    });
    let shaded = if sigmas.is_empty() { "" } else { " Shaded: one standard deviation, as the estimator states it." };
    let [x, y, z] = last.map(|value| format!("{value:.3}"));
    let note = format!("At the end {x}, {y}, {z} {unit}.{shaded}");
    Chart { id, title, unit, note, lines: lines.collect(), ..blank(output, stretches) }.html()
}

fn depth(output: &Output, stretches: &[Stretch]) -> String {
    let Some(source) = output.text("/depth/source") else { return String::new() };
    let factors: Vec<_> =
        output.scales.iter().filter_map(|scale| scale.factor.map(|factor| (output.seconds(scale.stamp_ns), factor))).collect();
    let edge = |sign: f64| factors.iter().map(|(time, (factor, sigma))| (*time, factor * (sign * sigma).exp())).collect::<Points>();
    let scale = Chart {
        id: "depth-scale",
        title: "Depth scale factor",
        unit: "metres per unit of the network",
        note: "1: the network's depths are metres as they are. Shaded: one standard deviation.".into(),
        gap_s: 10.0,
        lines: vec![Line {
            name: "factor".into(),
            class: "c1".into(),
            points: factors.iter().map(|(time, (factor, _))| (*time, *factor)).collect(),
            area: Some((edge(-1.0), edge(1.0))),
        }],
        ..blank(output, stretches)
    };
    let network = Chart {
        id: "network-time",
        title: "Time of the network",
        unit: "ms per map, in a thread of its own",
        from_zero: true,
        gap_s: 10.0,
        lines: vec![line("network", "c4", over_frames(output, |frame| frame.network_ms))],
        ..blank(output, stretches)
    };
    let count = |key: &str| output.number(&format!("/depth/{key}")).unwrap_or(0.0);
    let mut facts = vec![
        ("source".to_owned(), source.to_owned()),
        ("maps believed".to_owned(), format!("{} of {}", count("believed"), count("images"))),
        ("rejected, of another scale".to_owned(), format!("{}", count("rejected_other_scale"))),
        ("rejected, no depth of this image".to_owned(), format!("{}", count("rejected_no_depth"))),
    ];
    facts.extend(
        output
            .number("/depth/observation_share")
            .map(|share| ("landmarks whose depth began with a map".to_owned(), format!("{:.0} % of those seen", 100.0 * share))),
    );
    format!("{}<div class=\"two\">{}{}</div>", table(&facts), scale.html(), network.html())
}

fn planes(output: &Output) -> String {
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

fn time_and_memory(output: &Output, stretches: &[Stretch]) -> String {
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

fn warnings(output: &Output) -> String {
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

fn all_figures(output: &Output) -> String {
    let mut facts = Vec::new();
    let mut add = |name: &str, value: Option<String>| facts.extend(value.map(|value| (name.to_owned(), value)));
    let metres = |pointer: &str| output.number(pointer).map(length);
    add("ATE, RMSE", metres("/ate_rmse_m"));
    add("ATE, mean", metres("/ate_m/mean"));
    add("ATE, median", metres("/ate_m/median"));
    add("ATE, 95 %", metres("/ate_m/p95"));
    add("ATE, largest", metres("/ate_m/max"));
    add("way flown", metres("/path_length_m"));
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

fn protocol(output: &Output) -> String {
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
        said.push("RPE: from every pose to the first one after the given length of the true path, without alignment.".to_owned());
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

fn configuration(output: &Output) -> String {
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
