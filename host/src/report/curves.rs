//! What was wrong and how sure the estimator was, over time.

use super::chart::{Chart, Line, Points};
use super::folder::{Output, Pose};
use super::frames::Frame;
use super::html::table;
use super::verdict::Stretch;

/// 95 % of a χ² of six degrees of freedom lie between these.
const NEES_BAND: (f64, f64) = (1.237, 14.449);

/// What every chart of a run has in common.
pub(super) fn blank<'a>(output: &Output, stretches: &'a [Stretch]) -> Chart<'a> {
    let gap_s = 5.0 * output.image_interval_ms().unwrap_or(100.0) * 1e-3;
    Chart { seconds: output.duration_s(), stretches, gap_s, ..Chart::default() }
}

fn line(name: &str, class: &str, points: Points) -> Line {
    Line { name: name.into(), class: class.into(), points, area: None }
}

pub(super) fn over_frames(output: &Output, value: impl Fn(&Frame) -> Option<f64>) -> Points {
    output.frames.iter().filter_map(|frame| Some((output.seconds(frame.stamp_ns), value(frame)?))).collect()
}

pub(super) fn curves(output: &Output, stretches: &[Stretch]) -> String {
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
    value: impl Fn(&Pose) -> [f64; 3],
    sigma: impl Fn(&Frame) -> Option<[f64; 3]>,
) -> String {
    let sigmas: Vec<(i64, [f64; 3])> = output.frames.iter().filter_map(|frame| Some((frame.stamp_ns, sigma(frame)?))).collect();
    let last = output.poses.last().map(|pose| value(pose).map(|value| factor * value)).unwrap_or_default();
    let lines = [("x", "c1"), ("y", "c3"), ("z", "c2")].into_iter().enumerate().map(|(axis, (name, class))| {
        let at = |pose: &Pose| (output.seconds(pose.stamp_ns), factor * value(pose)[axis] - last[axis]);
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

pub(super) fn depth(output: &Output, stretches: &[Stretch]) -> String {
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
        ("rejected, no usable depth where the corners are".to_owned(), format!("{}", count("rejected_unusable"))),
    ];
    facts.extend(
        output
            .number("/depth/observation_share")
            .map(|share| ("landmarks whose depth began with a map".to_owned(), format!("{:.0} % of those seen", 100.0 * share))),
    );
    format!("{}<div class=\"two\">{}{}</div>", table(&facts), scale.html(), network.html())
}
