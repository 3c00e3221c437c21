//! The picture of a run: top view, side view, error over time.

use std::path::Path;
use std::sync::OnceLock;

use nalgebra::Vector3;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use super::record::{unwritable, write};
use crate::eval::{Evaluation, Trajectory};
use crate::fault::{Fault, FaultKind};

const SIZE: (u32, u32) = (1600, 1000);
const ESTIMATE: RGBColor = RGBColor(0x1f, 0x5f, 0xbf);
const TRUTH: RGBColor = RGBColor(0x9a, 0x9a, 0x9a);
const ERROR: RGBColor = RGBColor(0xc0, 0x39, 0x2b);
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const FAINT: RGBColor = RGBColor(0xe6, 0xe6, 0xe6);
const FONT: &str = "sans-serif";

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
    paint(&SVGBackend::with_string(&mut svg, SIZE).into_drawing_area(), figure).map_err(failed)?;
    write(&folder.join("trajectory.svg"), &svg)?;
    let mut pixels = vec![0_u8; (SIZE.0 * SIZE.1 * 3) as usize];
    paint(&BitMapBackend::with_buffer(&mut pixels, SIZE).into_drawing_area(), figure).map_err(failed)?;
    let path = folder.join("trajectory.png");
    image::save_buffer(&path, &pixels, SIZE.0, SIZE.1, image::ColorType::Rgb8).map_err(|error| unwritable(&path, &error))
}

/// Text is drawn with a font that comes with the program: the picture is the same on every machine.
fn load_font() -> Result<(), String> {
    static LOADED: OnceLock<bool> = OnceLock::new();
    let font = include_bytes!("../../assets/DejaVuSans-subset.ttf");
    let loaded = LOADED.get_or_init(|| register_font(FONT, FontStyle::Normal, font).is_ok());
    if *loaded { Ok(()) } else { Err("the font is damaged".into()) }
}

fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, figure: &Figure<'_>) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    area.fill(&WHITE).map_err(said)?;
    let dark = |size: i32| (FONT, size).into_font().color(&INK);
    area.draw(&Text::new(figure.title.to_owned(), (40, 24), dark(34))).map_err(said)?;
    area.draw(&Text::new(figure.subtitle.to_owned(), (40, 66), (FONT, 20).into_font().color(&RGBColor(0x60, 0x60, 0x60)))).map_err(said)?;
    let (_, body) = area.split_vertically(100);
    let (views, below) = body.split_vertically(590);
    let (top, side) = views.split_horizontally(SIZE.0 / 2);
    let paths = Paths::of(figure);
    paint_view(&top, "Top view", ("x [m]", "y [m]"), &paths.projected(|point| (point.x, point.y)))?;
    paint_view(&side, "Side view", ("x [m]", "z [m]"), &paths.projected(|point| (point.x, point.z)))?;
    paint_error(&below, figure)?;
    area.present().map_err(said)
}

/// The curves in the world of the truth, or of the estimate where there is no truth.
struct Paths {
    estimate: Vec<Vector3<f64>>,
    truth: Vec<Vector3<f64>>,
}

struct Flat {
    estimate: Vec<(f64, f64)>,
    truth: Vec<(f64, f64)>,
}

impl Paths {
    fn of(figure: &Figure<'_>) -> Self {
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
fn bounds(points: impl Iterator<Item = (f64, f64)>, aspect: f64) -> ((f64, f64), (f64, f64)) {
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

fn paint_view<B: DrawingBackend>(area: &DrawingArea<B, Shift>, name: &str, axes: (&str, &str), flat: &Flat) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    // Labels and caption take this much of the area; what is left is the plot.
    let (left, bottom, margin, caption) = (70_u32, 50_u32, 20_u32, 40_u32);
    let (width, height) = area.dim_in_pixel();
    let inner = (f64::from(width - left - 2 * margin), f64::from(height - bottom - caption - 2 * margin));
    let (x, y) = bounds(flat.estimate.iter().chain(&flat.truth).copied(), inner.0 / inner.1);
    let mut chart = ChartBuilder::on(area)
        .margin(margin)
        .caption(name, (FONT, 22).into_font().color(&INK))
        .x_label_area_size(bottom)
        .y_label_area_size(left)
        .build_cartesian_2d(x.0..x.1, y.0..y.1)
        .map_err(said)?;
    mesh(&mut chart, axes)?;
    let truth = chart.draw_series(LineSeries::new(flat.truth.iter().copied(), TRUTH.stroke_width(4))).map_err(said)?;
    if !flat.truth.is_empty() {
        truth.label("truth").legend(|(x, y)| PathElement::new([(x, y), (x + 24, y)], TRUTH.stroke_width(4)));
    }
    let estimate = chart.draw_series(LineSeries::new(flat.estimate.iter().copied(), ESTIMATE.stroke_width(2))).map_err(said)?;
    if !flat.estimate.is_empty() {
        estimate.label("libella").legend(|(x, y)| PathElement::new([(x, y), (x + 24, y)], ESTIMATE.stroke_width(2)));
    }
    chart.draw_series(flat.estimate.first().map(|point| Circle::new(*point, 6, ESTIMATE.filled()))).map_err(said)?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(FAINT)
        .label_font((FONT, 18).into_font().color(&INK))
        .draw()
        .map_err(said)
}

fn paint_error<B: DrawingBackend>(area: &DrawingArea<B, Shift>, figure: &Figure<'_>) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    let errors = figure.evaluation.map(|found| found.errors.as_slice()).unwrap_or_default();
    let Some((first, last)) = errors.first().zip(errors.last()) else {
        let style = (FONT, 20).into_font().color(&RGBColor(0x60, 0x60, 0x60));
        let reason = if figure.estimate.poses().is_empty() { "no pose was estimated" } else { "no ground truth to compare with" };
        return area.draw(&Text::new(reason, (90, 40), style)).map_err(said);
    };
    let seconds = |nanos: i64| nanos.saturating_sub(first.0) as f64 * 1e-9;
    let largest = errors.iter().map(|(_, error)| *error).fold(1e-6, f64::max);
    // Millimetres where metres would print zeros.
    let (factor, unit) = if largest < 0.1 { (1e3, "error [mm]") } else { (1.0, "error [m]") };
    let mut chart = ChartBuilder::on(area)
        .margin(20)
        .caption("Position error after alignment", (FONT, 22).into_font().color(&INK))
        .x_label_area_size(50)
        .y_label_area_size(70)
        .build_cartesian_2d(0.0..seconds(last.0).max(1e-3), 0.0..largest * factor * 1.08)
        .map_err(said)?;
    mesh(&mut chart, ("time since the first pose [s]", unit))?;
    let curve = errors.iter().map(|(nanos, error)| (seconds(*nanos), error * factor));
    chart.draw_series(LineSeries::new(curve, ERROR.stroke_width(2))).map_err(said)?;
    Ok(())
}

type Plane<'a, B> = ChartContext<'a, B, Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>>;

fn mesh<B: DrawingBackend>(chart: &mut Plane<'_, B>, (x, y): (&str, &str)) -> Result<(), String> {
    chart
        .configure_mesh()
        .x_desc(x)
        .y_desc(y)
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT)
        .axis_style(RGBColor(0x88, 0x88, 0x88))
        .label_style((FONT, 17).into_font().color(&INK))
        .axis_desc_style((FONT, 19).into_font().color(&INK))
        .draw()
        .map_err(|error| error.to_string())
}
