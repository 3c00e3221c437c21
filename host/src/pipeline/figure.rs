//! The picture of a run: top view, side view, error over time.

use std::path::Path;

use nalgebra::Vector3;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::record::write;
use crate::eval::{Evaluation, Trajectory};
use crate::fault::{Fault, FaultKind};
use crate::paint::{INK, SOFT_INK, load_font, text};

const SIZE: (u32, u32) = (1600, 1000);
pub(super) const ESTIMATE: RGBColor = RGBColor(0x1f, 0x5f, 0xbf);
pub(super) const TRUTH: RGBColor = RGBColor(0x9a, 0x9a, 0x9a);
const ERROR: RGBColor = RGBColor(0xc0, 0x39, 0x2b);
pub(super) const FAINT: RGBColor = RGBColor(0xe6, 0xe6, 0xe6);
/// Points per piece of a line.
pub(super) const PIECE: usize = 12;

/// What is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Figure<'a> {
    /// Name of the recording.
    pub title: &'a str,
    /// One line of figures under the title.
    pub subtitle: &'a str,
    /// The causal poses, in the estimator's world.
    pub estimate: &'a Trajectory,
    /// The truth.
    pub truth: Option<&'a Trajectory>,
    /// The comparison, whose alignment is applied to the estimate.
    pub evaluation: Option<&'a Evaluation>,
}

/// Draws `trajectory.svg` and `trajectory.png` into a folder.
///
/// # Errors
/// When a file cannot be written.
pub fn draw(folder: &Path, figure: &Figure<'_>) -> Result<(), Fault> {
    let failed =
        |reason: String| Fault::new(FaultKind::Output, format!("the picture cannot be drawn ({reason})"), "report this as an error");
    load_font().map_err(failed)?;
    let mut svg = String::new();
    paint(&SVGBackend::with_string(&mut svg, SIZE).into_drawing_area(), figure, 1).map_err(failed)?;
    write(&folder.join("trajectory.svg"), &svg)?;
    let mut pixels = vec![0_u8; (4 * SIZE.0 * SIZE.1 * 3) as usize];
    paint(&BitMapBackend::with_buffer(&mut pixels, (2 * SIZE.0, 2 * SIZE.1)).into_drawing_area(), figure, 2).map_err(failed)?;
    let pixels = halved(&pixels, SIZE);
    let path = folder.join("trajectory.png");
    image::save_buffer(&path, &pixels, SIZE.0, SIZE.1, image::ColorType::Rgb8).map_err(|error| Fault::unwritable(&path, &error))
}

/// The mean of every 2x2 pixels: smooth edges, which the bitmap backend does not draw by itself.
pub(super) fn halved(pixels: &[u8], (width, height): (u32, u32)) -> Vec<u8> {
    let (width, height) = (width as usize, height as usize);
    let at = |x: usize, y: usize, channel: usize| u16::from(pixels.get((y * 2 * width + x) * 3 + channel).copied().unwrap_or_default());
    let mut small = Vec::with_capacity(width * height * 3);
    for (y, x, channel) in (0..height).flat_map(|y| (0..width).flat_map(move |x| (0..3).map(move |channel| (2 * y, 2 * x, channel)))) {
        let sum = at(x, y, channel) + at(x + 1, y, channel) + at(x, y + 1, channel) + at(x + 1, y + 1, channel);
        small.push(u8::try_from((sum + 2) / 4).unwrap_or(u8::MAX));
    }
    small
}

/// Paints on an area of `zoom` times [`SIZE`].
fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, figure: &Figure<'_>, zoom: u32) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    let at = |x: u32, y: u32| ((x * zoom).cast_signed(), (y * zoom).cast_signed());
    area.fill(&WHITE).map_err(said)?;
    area.draw(&Text::new(figure.title.to_owned(), at(40, 24), text(34, zoom, INK))).map_err(said)?;
    area.draw(&Text::new(figure.subtitle.to_owned(), at(40, 70), text(20, zoom, SOFT_INK))).map_err(said)?;
    let (_, body) = area.split_vertically(100 * zoom);
    let (views, below) = body.split_vertically(590 * zoom);
    let (top, side) = views.split_horizontally(SIZE.0 / 2 * zoom);
    let paths = Paths::of(figure);
    paint_view(&top, "Top view", ("x [m]", "y [m]"), &paths.projected(|point| (point.x, point.y)), zoom)?;
    paint_view(&side, "Side view", ("x [m]", "z [m]"), &paths.projected(|point| (point.x, point.z)), zoom)?;
    paint_error(&below, figure, zoom)?;
    area.present().map_err(said)
}

/// The curves in the world of the truth, or of the estimate where there is no truth.
pub(super) struct Paths {
    pub(super) estimate: Vec<Vector3<f64>>,
    pub(super) truth: Vec<Vector3<f64>>,
}

pub(super) struct Flat {
    estimate: Vec<(f64, f64)>,
    truth: Vec<(f64, f64)>,
}

impl Paths {
    pub(super) fn of(figure: &Figure<'_>) -> Self {
        let aligned = figure.evaluation.map_or_else(nalgebra::Isometry3::identity, |found| found.truth_from_estimate);
        let points =
            |trajectory: &Trajectory| trajectory.poses().iter().map(|pose| pose.world_from_body.translation.vector).collect::<Vec<_>>();
        let estimate = points(figure.estimate).into_iter().map(|point| (aligned * nalgebra::Point3::from(point)).coords).collect();
        Self { estimate, truth: figure.truth.map(points).unwrap_or_default() }
    }

    fn projected(&self, project: impl Fn(&Vector3<f64>) -> (f64, f64)) -> Flat {
        Flat { estimate: self.estimate.iter().map(&project).collect(), truth: self.truth.iter().map(&project).collect() }
    }
}

/// Both axes in the same scale, centred on the curves.
pub(super) fn bounds(points: impl Iterator<Item = (f64, f64)>, aspect: f64) -> ((f64, f64), (f64, f64)) {
    let (mut low, mut high) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
    for (x, y) in points {
        low = (low.0.min(x), low.1.min(y));
        high = (high.0.max(x), high.1.max(y));
    }
    if low.0 > high.0 {
        return ((-1.0, 1.0), (-1.0, 1.0));
    }
    let half_height = (0.5 * (high.1 - low.1)).max(0.5 * (high.0 - low.0) / aspect).max(0.05) * 1.08;
    let (x, y) = (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1));
    ((x - half_height * aspect, x + half_height * aspect), (y - half_height, y + half_height))
}

/// Leaves out points closer than `step` to the last one kept: they would only roughen a wide line.
pub(super) fn thinned(points: &[(f64, f64)], step: f64) -> Vec<(f64, f64)> {
    let mut kept: Vec<(f64, f64)> = Vec::new();
    for point in points {
        if kept.last().is_none_or(|last| (point.0 - last.0).hypot(point.1 - last.1) >= step) {
            kept.push(*point);
        }
    }
    kept
}

fn paint_view<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    name: &str,
    axes: (&str, &str),
    flat: &Flat,
    zoom: u32,
) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    // Labels and caption take this much of the area; what is left is the plot.
    let (left, bottom, margin, caption) = (70 * zoom, 50 * zoom, 20 * zoom, 40 * zoom);
    let (width, height) = area.dim_in_pixel();
    let inner = (f64::from(width - left - 2 * margin), f64::from(height - bottom - caption - 2 * margin));
    let (x, y) = bounds(flat.estimate.iter().chain(&flat.truth).copied(), inner.0 / inner.1);
    let step = 2.0 * f64::from(zoom) * (x.1 - x.0) / inner.0;
    let mut chart = ChartBuilder::on(area)
        .margin(margin)
        .caption(name, text(22, zoom, INK))
        .x_label_area_size(bottom)
        .y_label_area_size(left)
        .build_cartesian_2d(x.0..x.1, y.0..y.1)
        .map_err(said)?;
    mesh(&mut chart, axes, zoom)?;
    for (label, points, color, stroke) in [("truth", &flat.truth, TRUTH, 4), ("libella", &flat.estimate, ESTIMATE, 2)] {
        if points.is_empty() {
            continue;
        }
        let (style, length) = (color.stroke_width(stroke * zoom), (24 * zoom).cast_signed());
        let points = thinned(points, step);
        // In pieces: one wide line that crosses itself is left white where it does.
        let pieces = (0..points.len()).step_by(PIECE).filter_map(|start| points.get(start..points.len().min(start + PIECE + 1)));
        let line = chart.draw_series(pieces.map(|piece| PathElement::new(piece.to_vec(), style))).map_err(said)?;
        line.label(label).legend(move |(x, y)| PathElement::new([(x, y), (x + length, y)], style));
    }
    chart.draw_series(flat.estimate.first().map(|point| Circle::new(*point, 6 * zoom, ESTIMATE.filled()))).map_err(said)?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .margin(8 * zoom)
        .legend_area_size(30 * zoom)
        .background_style(WHITE.mix(0.85))
        .border_style(FAINT)
        .label_font(text(18, zoom, INK))
        .draw()
        .map_err(said)
}

pub(super) fn paint_error<B: DrawingBackend>(area: &DrawingArea<B, Shift>, figure: &Figure<'_>, zoom: u32) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    let errors = figure.evaluation.map(|found| found.errors.as_slice()).unwrap_or_default();
    let Some((first, last)) = errors.first().zip(errors.last()) else {
        let reason = if figure.estimate.poses().is_empty() { "no pose was estimated" } else { "no ground truth to compare with" };
        return area
            .draw(&Text::new(reason, ((90 * zoom).cast_signed(), (40 * zoom).cast_signed()), text(20, zoom, SOFT_INK)))
            .map_err(said);
    };
    let seconds = |nanos: i64| nanos.saturating_sub(first.0) as f64 * 1e-9;
    let largest = errors.iter().map(|(_, error)| *error).fold(1e-6, f64::max);
    // Millimetres where metres would print zeros.
    let (factor, unit) = if largest < 0.5 { (1e3, "error [mm]") } else { (1.0, "error [m]") };
    let mut chart = ChartBuilder::on(area)
        .margin(20 * zoom)
        .caption("Position error after alignment", text(22, zoom, INK))
        .x_label_area_size(50 * zoom)
        .y_label_area_size(70 * zoom)
        .build_cartesian_2d(0.0..seconds(last.0).max(1e-3), 0.0..largest * factor * 1.08)
        .map_err(said)?;
    mesh(&mut chart, ("time since the first pose [s]", unit), zoom)?;
    let curve = errors.iter().map(|(nanos, error)| (seconds(*nanos), error * factor));
    chart.draw_series(LineSeries::new(curve, ERROR.stroke_width(2 * zoom))).map_err(said)?;
    Ok(())
}

pub(super) type Plane<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

pub(super) fn mesh<B: DrawingBackend>(chart: &mut Plane<'_, B>, (x, y): (&str, &str), zoom: u32) -> Result<(), String> {
    // As few decimals as tell neighbouring labels apart.
    let label = |range: f64| {
        move |value: &f64| {
            format!(
                "{value:.*}",
                if range > 12.0 {
                    0
                } else if range > 1.2 {
                    1
                } else if range > 0.12 {
                    2
                } else {
                    3
                }
            )
        }
    };
    let (width, height) = (chart.x_range(), chart.y_range());
    chart
        .configure_mesh()
        .x_desc(x)
        .y_desc(y)
        .x_label_formatter(&label(width.end - width.start))
        .y_label_formatter(&label(height.end - height.start))
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT.stroke_width(zoom))
        .axis_style(RGBColor(0x88, 0x88, 0x88).stroke_width(zoom))
        .set_all_tick_mark_size(5 * zoom)
        .label_style(text(17, zoom, INK))
        .axis_desc_style(text(19, zoom, INK))
        .draw()
        .map_err(|error| error.to_string())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use libella_core::time::Timestamp;
    use nalgebra::Isometry3;

    use super::*;
    use crate::config::EvaluationSection;
    use crate::eval::{StampedPose, evaluate};

    #[test]
    fn both_pictures_show_both_curves() {
        let at = |i: i32, scale: f64| StampedPose {
            stamp: Timestamp::from_nanos(i64::from(i) * 50_000_000),
            world_from_body: Isometry3::translation((f64::from(i) * 0.05).sin() * scale, (f64::from(i) * 0.03).cos() * scale, 0.0),
        };
        let truth = Trajectory::new((0..200).map(|i| at(i, 1.0)));
        let estimate = Trajectory::new((20..200).map(|i| at(i, 1.02)));
        let evaluation = evaluate(&estimate, &truth, &EvaluationSection::default()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let figure = Figure { title: "a & b", subtitle: "", estimate: &estimate, truth: Some(&truth), evaluation: Some(&evaluation) };
        draw(folder.path(), &figure).unwrap();
        let svg = std::fs::read_to_string(folder.path().join("trajectory.svg")).unwrap();
        for word in ["Top view", "Side view", "Position error", "truth", "a &amp; b", "error [mm]"] {
            assert!(svg.contains(word), "{word}");
        }
        let png = image::open(folder.path().join("trajectory.png")).unwrap().into_rgb8();
        assert_eq!(png.dimensions(), SIZE);
        for color in [TRUTH, ESTIMATE, ERROR] {
            let pixels = png.pixels().filter(|pixel| pixel.0 == [color.0, color.1, color.2]).count();
            assert!(pixels > 200, "{color:?} covers {pixels} pixels");
        }
    }

    #[test]
    fn a_run_without_pose_or_truth_still_has_a_picture() {
        let folder = tempfile::tempdir().unwrap();
        draw(folder.path(), &Figure { title: "", subtitle: "", estimate: &Trajectory::default(), truth: None, evaluation: None }).unwrap();
        assert!(std::fs::read_to_string(folder.path().join("trajectory.svg")).unwrap().contains("no pose was estimated"));
    }
}
