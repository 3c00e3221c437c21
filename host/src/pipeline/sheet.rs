//! One picture of a whole run: images with the corners that were followed, the map from above, height and error over time.

use std::collections::BTreeMap;
use std::path::Path;

use libella_core::time::Timestamp;
use libella_core::track::TrackId;
use nalgebra::{Isometry3, Point3, Vector3};
use plotters::coord::Shift;
use plotters::prelude::*;

use super::figure::{ESTIMATE, FAINT, Paths, TRUTH, bounds, halved, mesh, paint_error, thinned};
use super::trails::{TRAIL, Trails};
use super::{Corner, Figure, View};
use crate::dataset::GrayImage;
use crate::fault::{Fault, FaultKind};
use crate::paint::{DEPTH_COLORS, INK, SOFT_INK, color, load_font, log_place, text};

/// Images shown.
const COLUMNS: u32 = 3;
const ROWS: u32 = 2;
/// Width of the sheet and the space around its parts, px.
const WIDTH: u32 = 1200;
const GAP: u32 = 18;
/// Height of title, legend and plots, px.
const HEAD: u32 = 92;
const LEGEND: u32 = 40;
const PLOTS: u32 = 470;
/// Painted at twice the size and averaged: smooth edges.
const ZOOM: u32 = 2;
/// Depths at the two ends of the colours, m.
const DEPTHS_M: [f64; 2] = [1.0, 6.0];

/// Gathers what the sheet shows while a run goes on.
#[derive(Debug)]
pub struct ContactSheet {
    /// Numbers of the images to show.
    wanted: Vec<usize>,
    images: usize,
    begun: Option<Timestamp>,
    trails: Trails,
    /// The newest estimate of every landmark, in the estimator's world, m.
    landmarks: BTreeMap<TrackId, Vector3<f64>>,
    tiles: Vec<Tile>,
}

#[derive(Debug)]
struct Tile {
    seconds: f64,
    image: GrayImage,
    corners: Vec<(Corner, Vec<[f64; 2]>)>,
}

impl ContactSheet {
    /// A sheet for a run over so many images.
    #[must_use]
    pub fn new(images: usize) -> Self {
        // The first one not before the start has been found in most runs, the last one near the end.
        let tiles = (COLUMNS * ROWS) as usize;
        let wanted = (0..tiles).map(|tile| images * (3 * tile + 3) / (3 * tiles + 1)).collect();
        Self { wanted, images: 0, begun: None, trails: Trails::default(), landmarks: BTreeMap::new(), tiles: Vec::new() }
    }

    /// Takes in one image of the run; they come in order.
    pub fn add(&mut self, stamp: Timestamp, view: View) {
        let begun = *self.begun.get_or_insert(stamp);
        self.trails.follow(&view);
        for corner in &view.corners {
            self.landmarks.extend(corner.point_in_world.map(|point| (corner.track, point)));
        }
        if self.wanted.contains(&self.images)
            && let Some(image) = view.image
        {
            let corners = view.corners.iter().map(|corner| (*corner, self.trails.of(corner.track))).collect();
            self.tiles.push(Tile { seconds: (stamp - begun).as_seconds(), image, corners });
        }
        self.images += 1;
    }

    /// Draws the sheet into a PNG file.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn draw(&self, path: &Path, figure: &Figure<'_>) -> Result<(), Fault> {
        let failed =
            |reason: String| Fault::new(FaultKind::Output, format!("the picture cannot be drawn ({reason})"), "report this as an error");
        load_font().map_err(failed)?;
        let tile = self.tile_size();
        let rows = if self.tiles.is_empty() { 0 } else { ROWS };
        let height = HEAD + rows * (tile.1 + GAP) + LEGEND + PLOTS;
        let mut pixels = vec![255_u8; (WIDTH * ZOOM * height * ZOOM * 3) as usize];
        let place = |index: usize| {
            let index = u32::try_from(index).unwrap_or(u32::MAX);
            (GAP + (index % COLUMNS) * (tile.0 + GAP), HEAD + (index / COLUMNS) * (tile.1 + GAP))
        };
        for (index, shown) in self.tiles.iter().enumerate() {
            copy_image(&shown.image, &mut pixels, place(index), tile);
        }
        {
            let area = BitMapBackend::with_buffer(&mut pixels, (WIDTH * ZOOM, height * ZOOM)).into_drawing_area();
            let texts = [(figure.title, 16, text(31, ZOOM, INK)), (figure.subtitle, 58, text(17, ZOOM, SOFT_INK))];
            for (line, y, style) in texts {
                area.draw(&Text::new(line.to_owned(), at(GAP, y), style)).map_err(|error| failed(error.to_string()))?;
            }
            for (index, shown) in self.tiles.iter().enumerate() {
                let (x, y) = place(index);
                let part = area.clone().shrink((x * ZOOM, y * ZOOM), (tile.0 * ZOOM, tile.1 * ZOOM));
                shown.paint(&part, tile).map_err(failed)?;
            }
            let (_, below) = area.split_vertically((height - PLOTS - LEGEND) * ZOOM);
            let (legend, plots) = below.split_vertically(LEGEND * ZOOM);
            if rows > 0 {
                paint_legend(&legend).map_err(failed)?;
            }
            self.paint_plots(&plots, figure).map_err(failed)?;
            area.present().map_err(|error| failed(error.to_string()))?;
        }
        write_png(path, &halved(&pixels, (WIDTH, height)), (WIDTH, height))
    }

    /// Size of an image on the sheet: as many side by side as columns, shape kept.
    fn tile_size(&self) -> (u32, u32) {
        let width = (WIDTH - (COLUMNS + 1) * GAP) / COLUMNS;
        let shape = self.tiles.first().map_or(0.0, |tile| tile.image.height as f64 / tile.image.width.max(1) as f64);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        (width, (f64::from(width) * shape).round() as u32)
    }

    fn paint_plots<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, figure: &Figure<'_>) -> Result<(), String> {
        let (top, right) = area.split_horizontally(620 * ZOOM);
        let (side, error) = right.split_vertically(PLOTS / 2 * ZOOM);
        let aligned = figure.evaluation.map_or_else(Isometry3::identity, |found| found.truth_from_estimate);
        let landmarks: Vec<_> = self.landmarks.values().map(|point| (aligned * Point3::from(*point)).coords).collect();
        let paths = Paths::of(figure);
        paint_map(&top, "From above, with the landmarks", ("x [m]", "y [m]"), &paths, &landmarks, |point| (point.x, point.y))?;
        paint_map(&side, "From the side", ("x [m]", "z [m]"), &paths, &landmarks, |point| (point.x, point.z))?;
        paint_error(&error, figure, ZOOM)
    }
}

fn at(x: u32, y: u32) -> (i32, i32) {
    ((x * ZOOM).cast_signed(), (y * ZOOM).cast_signed())
}

/// Copies an image onto a part of the sheet, nearest pixel; in the common case nothing is resampled but by the final average.
fn copy_image(image: &GrayImage, pixels: &mut [u8], (left, top): (u32, u32), (width, height): (u32, u32)) {
    let (columns, rows) = ((width * ZOOM) as usize, (height * ZOOM) as usize);
    let stride = (WIDTH * ZOOM) as usize;
    for row in 0..rows {
        for column in 0..columns {
            let source = (row * image.height / rows.max(1)) * image.width + column * image.width / columns.max(1);
            let grey = image.pixels.get(source).copied().unwrap_or_default();
            let target = ((top * ZOOM) as usize + row) * stride + (left * ZOOM) as usize + column;
            if let Some(pixel) = pixels.get_mut(3 * target..3 * target + 3) {
                pixel.fill(grey);
            }
        }
    }
}

impl Tile {
    fn paint<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, size: (u32, u32)) -> Result<(), String> {
        let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
        let scale = f64::from(size.0 * ZOOM) / self.image.width.max(1) as f64;
        #[allow(clippy::cast_possible_truncation)]
        let on_sheet = |pixel: &[f64; 2]| (((pixel[0] + 0.5) * scale).round() as i32, ((pixel[1] + 0.5) * scale).round() as i32);
        for (corner, trail) in &self.corners {
            let color = corner.depth_m.map_or(WHITE, color_of_depth);
            for (age, step) in trail.windows(2).rev().enumerate() {
                let strength = 0.9 * (1.0 - age as f64 / TRAIL as f64);
                let line: Vec<_> = step.iter().map(on_sheet).collect();
                area.draw(&PathElement::new(line, color.mix(strength).stroke_width(3))).map_err(said)?;
            }
        }
        for (corner, _) in &self.corners {
            let place = on_sheet(&corner.pixel);
            match corner.depth_m {
                Some(depth_m) => {
                    area.draw(&Circle::new(place, 7, BLACK.mix(0.55).filled())).map_err(said)?;
                    area.draw(&Circle::new(place, 5, color_of_depth(depth_m).filled())).map_err(said)?;
                }
                None => area.draw(&Circle::new(place, 4, WHITE.mix(0.8).stroke_width(2))).map_err(said)?,
            }
        }
        let label = format!("{:.1} s", self.seconds);
        let height = (size.1 * ZOOM).cast_signed();
        area.draw(&Rectangle::new([(0, height - 44), (104, height)], BLACK.mix(0.6).filled())).map_err(said)?;
        area.draw(&Text::new(label, (14, height - 37), text(15, ZOOM, WHITE))).map_err(said)
    }
}

/// Logarithmic between the ends: a step of colour is a factor of distance.
fn color_of_depth(depth_m: f64) -> RGBColor {
    let [r, g, b] = color(log_place(depth_m, DEPTHS_M), &DEPTH_COLORS);
    RGBColor(r, g, b)
}

fn paint_legend<B: DrawingBackend>(area: &DrawingArea<B, Shift>) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    let write = |x: u32, line: &str| area.draw(&Text::new(line.to_owned(), at(x, 3), text(15, ZOOM, SOFT_INK))).map_err(said);
    let (left, width) = (300, 240_u32);
    write(GAP, "corners followed, by distance")?;
    write(left - 34, "1 m")?;
    for column in 0..width * ZOOM {
        let depth = DEPTHS_M[0] * (DEPTHS_M[1] / DEPTHS_M[0]).powf(f64::from(column) / f64::from(width * ZOOM));
        let x = (left * ZOOM + column).cast_signed();
        let bar = [(x, 8 * ZOOM.cast_signed()), (x, 15 * ZOOM.cast_signed())];
        area.draw(&PathElement::new(bar.to_vec(), color_of_depth(depth))).map_err(said)?;
    }
    write(left + width + 8, "6 m")?;
    area.draw(&Circle::new(at(640, 12), 5, SOFT_INK.stroke_width(2))).map_err(said)?;
    write(652, "not known yet")?;
    area.draw(&PathElement::new(vec![at(790, 12), at(820, 12)], SOFT_INK.stroke_width(3))).map_err(said)?;
    write(828, "where it was in the last 0.5 s")
}

fn paint_map<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    name: &str,
    axes: (&str, &str),
    paths: &Paths,
    landmarks: &[Vector3<f64>],
    project: impl Fn(&Vector3<f64>) -> (f64, f64),
) -> Result<(), String> {
    let said = |error: DrawingAreaErrorKind<B::ErrorType>| error.to_string();
    let (left, bottom, margin, caption) = (56 * ZOOM, 44 * ZOOM, 12 * ZOOM, 38 * ZOOM);
    let (width, height) = area.dim_in_pixel();
    let inner = (f64::from(width - left - 2 * margin), f64::from(height - bottom - caption - 2 * margin));
    let flat = |points: &[Vector3<f64>]| points.iter().map(&project).collect::<Vec<_>>();
    let (estimate, truth, cloud) = (flat(&paths.estimate), flat(&paths.truth), flat(landmarks));
    let kept = within(&cloud);
    let (x, y) = bounds(estimate.iter().chain(&truth).chain(&kept).copied(), inner.0 / inner.1);
    let mut chart = ChartBuilder::on(area)
        .margin(margin)
        .caption(name, text(22, ZOOM, INK))
        .x_label_area_size(bottom)
        .y_label_area_size(left)
        .build_cartesian_2d(x.0..x.1, y.0..y.1)
        .map_err(said)?;
    mesh(&mut chart, axes, ZOOM)?;
    let heights: Vec<f64> = landmarks.iter().map(|point| point.z).collect();
    let ([low, high], inside) = (ends(&heights), |point: &(f64, f64)| x.0 < point.0 && point.0 < x.1 && y.0 < point.1 && point.1 < y.1);
    let dots = cloud.iter().zip(landmarks).filter(|(point, _)| inside(point)).map(|(point, landmark)| {
        // Floor dark, ceiling light.
        let share = ((landmark.z - low) / (high - low).max(1e-9)).clamp(0.0, 1.0);
        let shade = RGBColor(grade(40.0, 228.0, share), grade(56.0, 140.0, share), grade(92.0, 66.0, share));
        Circle::new(*point, 3, shade.mix(0.5).filled())
    });
    chart.draw_series(dots).map_err(said)?;
    let step = 2.0 * f64::from(ZOOM) * (x.1 - x.0) / inner.0;
    for (label, points, color, stroke) in [("truth", &truth, TRUTH, 5), ("libella", &estimate, ESTIMATE, 2)] {
        if points.is_empty() {
            continue;
        }
        let style = color.stroke_width(stroke * ZOOM);
        let points = thinned(points, step);
        let pieces = (1..points.len()).filter_map(|end| points.get(end - 1..=end));
        let line = chart.draw_series(pieces.map(|piece| PathElement::new(piece.to_vec(), style))).map_err(said)?;
        line.label(label).legend(move |(x, y)| PathElement::new([(x, y), (x + 48, y)], style));
    }
    chart.draw_series(estimate.first().map(|point| Circle::new(*point, 5 * ZOOM, ESTIMATE.filled()))).map_err(said)?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .margin(8 * ZOOM)
        .legend_area_size(30 * ZOOM)
        .background_style(WHITE.mix(0.85))
        .border_style(FAINT)
        .label_font(text(15, ZOOM, INK))
        .draw()
        .map_err(said)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn grade(low: f64, high: f64, share: f64) -> u8 {
    (low + (high - low) * share).round() as u8
}

/// The values below which 2 % and above which 2 % lie.
fn ends(values: &[f64]) -> [f64; 2] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let cut = sorted.len() / 50;
    [sorted.get(cut), sorted.get(sorted.len().saturating_sub(1 + cut))].map(|value| value.copied().unwrap_or_default())
}

/// Points without the outermost 2 % on each side: a landmark that was wrong must not shrink the picture.
fn within(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let (x, y): (Vec<_>, Vec<_>) = points.iter().copied().unzip();
    let (x, y) = (ends(&x), ends(&y));
    points.iter().filter(|point| (x[0]..=x[1]).contains(&point.0) && (y[0]..=y[1]).contains(&point.1)).copied().collect()
}

/// The colours are worth the slower compression: the picture is looked at more often than it is written.
fn write_png(path: &Path, pixels: &[u8], (width, height): (u32, u32)) -> Result<(), Fault> {
    use image::ImageEncoder as _;
    use image::codecs::png::{CompressionType, FilterType, PngEncoder};
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Adaptive)
        .write_image(pixels, width, height, image::ExtendedColorType::Rgb8)
        .map_err(|error| Fault::unwritable(path, &error))?;
    std::fs::write(path, bytes).map_err(|error| Fault::unwritable(path, &error))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::eval::Trajectory;

    fn sheet(images: usize) -> ContactSheet {
        let mut sheet = ContactSheet::new(images);
        for index in 0..images {
            let image = GrayImage { width: 752, height: 480, pixels: vec![90; 752 * 480] };
            let corner = |track: u32, depth_m: Option<f64>| Corner {
                track: TrackId(track),
                pixel: [100.0 + index as f64 + 150.0 * f64::from(track), 200.0],
                depth_m,
                point_in_world: depth_m.map(|depth| Vector3::new(depth, f64::from(track), 1.0)),
                plane: None,
            };
            let corners = vec![corner(0, Some(1.0)), corner(1, Some(6.0)), corner(2, None)];
            sheet.add(
                Timestamp::from_nanos(50_000_000 * i64::try_from(index).unwrap()),
                View { image: Some(image), corners, ..View::default() },
            );
        }
        sheet
    }

    #[test]
    fn near_and_far_corners_are_where_they_were_seen_in_their_colours() {
        let sheet = sheet(60);
        assert_eq!(sheet.tiles.len(), 6);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sheet.png");
        let figure = Figure { title: "title", subtitle: "", estimate: &Trajectory::default(), truth: None, evaluation: None };
        sheet.draw(&path, &figure).unwrap();
        let png = image::open(&path).unwrap().into_rgb8();
        assert_eq!(png.width(), WIDTH);
        for tile in 0..6 {
            let (shown, left, top) = (&sheet.tiles[tile], GAP + (tile as u32 % 3) * (376 + GAP), HEAD + (tile as u32 / 3) * (240 + GAP));
            for (index, depth_m) in [(0, 1.0), (1, 6.0)] {
                let [x, y] = shown.corners[index].0.pixel;
                let pixel = png.get_pixel(left + (x / 2.0).round() as u32, top + (y / 2.0).round() as u32).0;
                let RGBColor(r, g, b) = color_of_depth(depth_m);
                assert!(pixel.iter().zip([r, g, b]).all(|(found, wanted)| found.abs_diff(wanted) < 30), "{pixel:?} {r} {g} {b}");
            }
            // Away from the corners the image itself.
            assert_eq!(png.get_pixel(left + 200, top + 20).0, [90; 3]);
        }
    }

    #[test]
    fn trails_follow_their_corner_and_end_with_it() {
        let mut sheet = sheet(30);
        assert_eq!(sheet.trails.of(TrackId(0)).iter().map(|pixel| pixel[0]).collect::<Vec<_>>()[..2], [119.0, 120.0]);
        assert_eq!(sheet.trails.of(TrackId(0)).len(), TRAIL);
        sheet.add(Timestamp::from_nanos(2_000_000_000), View::default());
        assert!(sheet.trails.is_empty());
    }

    #[test]
    fn colours_run_from_near_to_far_and_stay_at_their_ends() {
        assert_eq!((color_of_depth(0.1), color_of_depth(1.0)), (RGBColor(255, 72, 48), RGBColor(255, 72, 48)));
        assert_eq!((color_of_depth(6.0), color_of_depth(100.0)), (RGBColor(84, 140, 255), RGBColor(84, 140, 255)));
    }
}
