//! The picture of the planes: from above and from the side, with the points of the map and the way flown.

use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};
use plotters::coord::Shift;
use plotters::prelude::*;

use super::Figure;
use super::figure::{PIECE, Paths, bounds, halved, mesh, thinned};
use crate::fault::{Fault, FaultKind};
use crate::paint::{INK, SOFT_INK, load_font, text};
use crate::planes::{Planes, color_of, name_of};

const SIZE: (u32, u32) = (1600, 860);
/// Painted at twice the size and averaged: smooth edges.
const ZOOM: u32 = 2;
/// Points drawn at most.
const MOST_POINTS: usize = 4_000;
const LONE_POINT: RGBColor = RGBColor(0xb8, 0xb8, 0xb8);

/// Draws `planes.png` into a folder.
///
/// # Errors
/// When the file cannot be written.
pub fn draw_planes(folder: &Path, figure: &Figure<'_>, planes: &Planes) -> Result<(), Fault> {
    let failed =
        |reason: String| Fault::new(FaultKind::Output, format!("the picture cannot be drawn ({reason})"), "report this as an error");
    load_font().map_err(failed)?;
    let mut pixels = vec![0_u8; (ZOOM * SIZE.0 * ZOOM * SIZE.1 * 3) as usize];
    paint(&BitMapBackend::with_buffer(&mut pixels, (ZOOM * SIZE.0, ZOOM * SIZE.1)).into_drawing_area(), figure, planes).map_err(failed)?;
    let path = folder.join("planes.png");
    image::save_buffer(&path, &halved(&pixels, SIZE), SIZE.0, SIZE.1, image::ColorType::Rgb8)
        .map_err(|error| Fault::unwritable(&path, &error))
}

fn rgb([red, green, blue]: [u8; 3]) -> RGBColor {
    RGBColor(red, green, blue)
}

fn paint<B: DrawingBackend>(area: &DrawingArea<B, Shift>, figure: &Figure<'_>, planes: &Planes) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    area.fill(&WHITE).map_err(said)?;
    let at = |x: u32, y: u32| ((x * ZOOM).cast_signed(), (y * ZOOM).cast_signed());
    let standing = planes.planes.iter().filter(|plane| plane.gone_into.is_none()).count();
    let subtitle = format!(
        "{standing} planes, {} points of the map; blue floor, red walls, orange tables, violet ceilings, green others",
        planes.points.len()
    );
    area.draw(&Text::new(figure.title.to_owned(), at(40, 24), text(34, ZOOM, INK))).map_err(said)?;
    area.draw(&Text::new(subtitle, at(40, 70), text(20, ZOOM, SOFT_INK))).map_err(said)?;
    let (_, body) = area.split_vertically(100 * ZOOM);
    let (top, side) = body.split_horizontally(SIZE.0 / 2 * ZOOM);
    let drawing = Drawing::of(figure, planes);
    drawing.paint_view(&top, "Top view", ("x [m]", "y [m]"), |point| (point.x, point.y))?;
    drawing.paint_view(&side, "Side view", ("x [m]", "z [m]"), |point| (point.x, point.z))?;
    area.present().map_err(said)
}

/// Everything in the world of the truth, or of the estimate where there is no truth.
struct Drawing {
    way: Vec<Vector3<f64>>,
    polygons: Vec<(String, RGBColor, Vec<Vector3<f64>>)>,
    points: Vec<(Vector3<f64>, RGBColor)>,
}

impl Drawing {
    fn of(figure: &Figure<'_>, planes: &Planes) -> Self {
        let aligned = figure.evaluation.map_or_else(Isometry3::identity, |found| found.truth_from_estimate);
        let moved = |point: &Vector3<f64>| (aligned * Point3::from(*point)).coords;
        let standing = || planes.planes.iter().filter(|plane| plane.gone_into.is_none());
        let polygons = standing().map(|plane| {
            let name = format!("{} {}", plane.id, name_of(plane.class));
            (name, rgb(color_of(plane.class)), plane.polygon_in_world.iter().map(moved).collect())
        });
        let color = |name: usize| standing().find(|plane| plane.id == name).map_or(LONE_POINT, |plane| rgb(color_of(plane.class)));
        let step = planes.points.len().div_ceil(MOST_POINTS).max(1);
        let points = planes.points.iter().step_by(step).map(|(point, plane)| (moved(point), plane.map_or(LONE_POINT, color)));
        Self { way: Paths::of(figure).estimate, polygons: polygons.collect(), points: points.collect() }
    }

    fn paint_view<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
        name: &str,
        axes: (&str, &str),
        flat: impl Fn(&Vector3<f64>) -> (f64, f64),
    ) -> Result<(), String> {
        let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
        let (left, bottom, margin, caption) = (70 * ZOOM, 50 * ZOOM, 20 * ZOOM, 40 * ZOOM);
        let (width, height) = area.dim_in_pixel();
        let inner = (f64::from(width - left - 2 * margin), f64::from(height - bottom - caption - 2 * margin));
        // Stray points far away would shrink the room.
        let shown = self.polygons.iter().flat_map(|(_, _, corners)| corners).chain(&self.way);
        let (x, y) = bounds(shown.map(&flat), inner.0 / inner.1);
        let step = 2.0 * f64::from(ZOOM) * (x.1 - x.0) / inner.0;
        let mut chart = ChartBuilder::on(area)
            .margin(margin)
            .caption(name, text(22, ZOOM, INK))
            .x_label_area_size(bottom)
            .y_label_area_size(left)
            .build_cartesian_2d(x.0..x.1, y.0..y.1)
            .map_err(said)?;
        mesh(&mut chart, axes, ZOOM)?;
        for (_, color, corners) in &self.polygons {
            let outline: Vec<_> = corners.iter().chain(corners.first()).map(&flat).collect();
            chart.draw_series([Polygon::new(outline.clone(), color.mix(0.12))]).map_err(said)?;
            chart.draw_series([PathElement::new(outline, color.stroke_width(2 * ZOOM))]).map_err(said)?;
        }
        let inside = |(u, v): &(f64, f64)| *u > x.0 && *u < x.1 && *v > y.0 && *v < y.1;
        let points = self.points.iter().map(|(point, color)| (flat(point), color)).filter(|(point, _)| inside(point));
        chart.draw_series(points.map(|(point, color)| Circle::new(point, 2, color.mix(0.6).filled()))).map_err(said)?;
        let way = thinned(&self.way.iter().map(&flat).collect::<Vec<_>>(), step);
        let style = INK.stroke_width(2 * ZOOM);
        // In pieces: one wide line that crosses itself is left white where it does.
        let pieces = (0..way.len()).step_by(PIECE).filter_map(|start| way.get(start..way.len().min(start + PIECE + 1)));
        chart.draw_series(pieces.map(|piece| PathElement::new(piece.to_vec(), style))).map_err(said)?;
        for (name, color, corners) in &self.polygons {
            let middle = corners.iter().sum::<Vector3<f64>>() / corners.len().max(1) as f64;
            chart.draw_series([Text::new(name.clone(), flat(&middle), text(18, ZOOM, *color))]).map_err(said)?;
        }
        chart.plotting_area().present().map_err(said)?;
        Ok(())
    }
}
