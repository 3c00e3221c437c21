//! Depth and uncertainty beside the image, in colours with a legend.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{DepthKind, DepthMap};
use crate::dataset::GrayImage;
use crate::fault::{Fault, FaultKind};
use crate::paint::{self, DEPTH_COLORS, INK, SIGMA_COLORS, SOFT_INK, UNKNOWN, load_font, log_place};

/// Width of a panel, space around it, height of the title and of a legend, px.
const PANEL: u32 = 600;
const GAP: u32 = 20;
const HEAD: u32 = 76;
const LEGEND: u32 = 84;
const BAR: u32 = 16;
/// Numbers that a legend may show.
const ROUND: [f64; 12] = [1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 7.0, 8.0];

type Paper<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

/// Writes a picture: the image, its depth, the standard deviation of the depth. Both legends are logarithmic; depths beyond the
/// ends of the legend, the outer 1 % on either side, have the colours of its ends.
///
/// # Errors
/// When the file cannot be written.
pub fn draw_depth(path: &Path, image: &GrayImage, map: &DepthMap, title: &str, subtitle: &str) -> Result<(), Fault> {
    let failed =
        |reason: String| Fault::new(FaultKind::Output, format!("the picture cannot be drawn ({reason})"), "report this as an error");
    let height = u32::try_from((PANEL as usize * image.height / image.width.max(1)).clamp(50, 4 * PANEL as usize)).unwrap_or(PANEL);
    let (all_width, all_height) = (3 * PANEL + 4 * GAP, HEAD + height + LEGEND);
    let mut pixels = vec![255_u8; (all_width * all_height * 3) as usize];
    let scale = Scale::depth(map);
    let spread = Scale::sigma(map);
    for y in 0..height {
        for x in 0..PANEL {
            let raw = [at_raw(x, PANEL, image.width), at_raw(y, height, image.height)];
            let grey = [grey_at(image, raw); 3];
            let sample = map.sample(raw);
            let depth = sample.map_or(UNKNOWN, |sample| scale.color(scale.shown(f64::from(sample.inverse_depth_1_m)), &DEPTH_COLORS));
            let sigma = sample.map_or(UNKNOWN, |sample| spread.color(f64::from(sample.sigma_log), &SIGMA_COLORS));
            for (panel, color) in (0_u32..).zip([grey, depth, sigma]) {
                let at = 3 * ((HEAD + y) * all_width + GAP + panel * (PANEL + GAP) + x) as usize;
                if let Some(pixel) = pixels.get_mut(at..at + 3) {
                    pixel.copy_from_slice(&color);
                }
            }
        }
    }
    label(&mut pixels, (all_width, all_height), (title, subtitle), &scale, &spread, HEAD + height).map_err(failed)?;
    let image = image::RgbImage::from_raw(all_width, all_height, pixels).ok_or_else(|| failed("its size is wrong".into()))?;
    image.save_with_format(path, image::ImageFormat::Png).map_err(|error| {
        let remedy = "give another file with --out, or free the disk";
        Fault::new(FaultKind::Output, format!("cannot be written ({})", error.to_string().replace('\n', " ")), remedy).at(path)
    })
}

/// Title, legends.
fn label(pixels: &mut [u8], size: (u32, u32), titles: (&str, &str), scale: &Scale, spread: &Scale, top: u32) -> Result<(), String> {
    load_font()?;
    let said = |error: DrawingAreaErrorKind<_>| error.to_string();
    let paper: Paper<'_> = BitMapBackend::with_buffer(pixels, size).into_drawing_area();
    paper.draw(&Text::new(titles.0.to_owned(), (20, 12), paint::text(24, 1, INK))).map_err(said)?;
    paper.draw(&Text::new(titles.1.to_owned(), (20, 46), paint::text(15, 1, SOFT_INK))).map_err(said)?;
    let left = |panel: u32| GAP + panel * (PANEL + GAP);
    scale.legend(&paper, (left(1), top), &DEPTH_COLORS)?;
    spread.legend(&paper, (left(2), top), &SIGMA_COLORS)?;
    let below = |line: u32| (left(0).cast_signed(), (top + 12 + line * 22).cast_signed());
    paper.draw(&Text::new("image", below(0), paint::text(15, 1, SOFT_INK))).map_err(said)?;
    paper.draw(&Text::new("grey in the other two: nothing known", below(1), paint::text(15, 1, SOFT_INK))).map_err(said)?;
    paper.present().map_err(said)
}

/// A logarithmic scale with colours.
struct Scale {
    low: f64,
    high: f64,
    title: String,
    /// What a number is shown as.
    percent: bool,
    affine: Option<[f64; 2]>,
}

impl Scale {
    fn depth(map: &DepthMap) -> Self {
        let known = (0..map.inverse_depth_1_m.len()).filter(|index| map.is_known(*index));
        let mut values: Vec<f64> = known.filter_map(|index| map.inverse_depth_1_m.get(index).copied()).map(f64::from).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.get((share * values.len() as f64) as usize).copied();
        let (low, high) = (at(0.01).unwrap_or(0.1), at(0.99).unwrap_or(1.0));
        let title = match map.kind {
            DepthKind::Metric => "depth along the optical axis, m",
            DepthKind::UpToScale => "depth along the optical axis, of unknown unit",
            DepthKind::Affine => "relative depth: order only",
        };
        let affine = (map.kind == DepthKind::Affine).then(|| [low, (high - low).max(1e-9)]);
        let [near, far] = if affine.is_some() { [1.0, 10.0] } else { [1.0 / high, 1.0 / low] };
        Self::new(near, far, title, false, affine)
    }

    fn sigma(map: &DepthMap) -> Self {
        let known = map.sigma_log.iter().enumerate().filter(|(index, sigma)| map.is_known(*index) && sigma.is_finite());
        let mut values: Vec<f64> = known.map(|(_, sigma)| f64::from(*sigma)).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.get((share * values.len() as f64) as usize).copied();
        let mut u: Vec<f32> = map.uncertainty.iter().copied().filter(|u| u.is_finite()).collect();
        u.sort_by(f32::total_cmp);
        let (least, most) = (u.first().copied().unwrap_or(0.0), u.last().copied().unwrap_or(0.0));
        let title = format!("1 sigma of the depth, %   (u from {least:.2} to {most:.2})");
        Self::new(at(0.01).unwrap_or(0.1), at(0.99).unwrap_or(1.0), &title, true, None)
    }

    /// At least a factor of 1.2 from end to end, so that noise of an even map is not blown up.
    fn new(low: f64, high: f64, title: &str, percent: bool, affine: Option<[f64; 2]>) -> Self {
        let low = low.max(1e-6);
        let middle = (low * high.max(low)).sqrt();
        let half = (high.max(low) / low).sqrt().max(1.1);
        Self { low: middle / half, high: middle * half, title: title.into(), percent, affine }
    }

    /// What stands on the scale for an inverse depth.
    fn shown(&self, inverse_depth: f64) -> f64 {
        match self.affine {
            // Evenly from far to near.
            Some([low, span]) => 10.0_f64.powf(1.0 - ((inverse_depth - low) / span).clamp(0.0, 1.0)),
            None => 1.0 / inverse_depth,
        }
    }

    fn place(&self, value: f64) -> f64 {
        log_place(value, [self.low, self.high])
    }

    fn color(&self, value: f64, colors: &[[f64; 3]]) -> [u8; 3] {
        paint::color(self.place(value), colors)
    }

    fn legend(&self, paper: &Paper<'_>, (left, top): (u32, u32), colors: &[[f64; 3]]) -> Result<(), String> {
        let said = |error: DrawingAreaErrorKind<_>| error.to_string();
        let (left, top) = (left.cast_signed(), top.cast_signed());
        let bar = BAR.cast_signed();
        for x in 0..PANEL.cast_signed() {
            let value = self.low * (self.high / self.low).powf((f64::from(x) + 0.5) / f64::from(PANEL));
            let [r, g, b] = self.color(value, colors);
            let column = [(left + x, top + 8), (left + x, top + 8 + bar)];
            paper.draw(&PathElement::new(column, RGBColor(r, g, b))).map_err(said)?;
        }
        let mut free = i32::MIN;
        for value in self.ticks() {
            let x = left + (self.place(value) * f64::from(PANEL)).round() as i32;
            // Numbers that would touch the one before are left out.
            if x < free {
                continue;
            }
            free = x + 40;
            paper.draw(&PathElement::new([(x, top + 8 + bar), (x, top + 13 + bar)], INK)).map_err(said)?;
            let number = if self.percent { format!("{}", round3(value * 100.0)) } else { format!("{}", round3(value)) };
            let style = paint::text(14, 1, INK).pos(Pos::new(HPos::Center, VPos::Top));
            paper.draw(&Text::new(number, (x, top + 16 + bar), style)).map_err(said)?;
        }
        paper.draw(&Text::new(self.title.clone(), (left, top + 38 + bar), paint::text(15, 1, SOFT_INK))).map_err(said)
    }

    /// Round numbers within the scale, a little away from its ends.
    fn ticks(&self) -> Vec<f64> {
        if self.affine.is_some() {
            return Vec::new();
        }
        let decades = (-4..5).flat_map(|power| ROUND.map(|digit| digit * 10.0_f64.powi(power)));
        decades.filter(|value| (self.low..=self.high).contains(value) && (0.02..=0.98).contains(&self.place(*value))).collect()
    }
}

/// Without the last digits of binary fractions.
fn round3(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// The raw coordinate at the centre of a pixel of a panel.
fn at_raw(pixel: u32, side: u32, raw_side: usize) -> f64 {
    (f64::from(pixel) + 0.5) * raw_side as f64 / f64::from(side) - 0.5
}

fn grey_at(image: &GrayImage, [x, y]: [f64; 2]) -> u8 {
    let (x, y) = (x.round().max(0.0) as usize, y.round().max(0.0) as usize);
    image.pixels.get(y.min(image.height.saturating_sub(1)) * image.width + x.min(image.width.saturating_sub(1))).copied().unwrap_or(0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn map(kind: DepthKind) -> DepthMap {
        let mut map = DepthMap::unknown([8, 6], [8.0; 2], [3.5; 2], kind);
        for index in 0..48 {
            map.inverse_depth_1_m[index] = if index < 8 { f32::NAN } else { 0.2 + 0.02 * index as f32 };
            (map.sigma_log[index], map.uncertainty[index]) = (0.1 + 0.01 * index as f32, 0.2);
        }
        map
    }

    #[test]
    fn panels_hold_the_image_the_depth_and_the_uncertainty() {
        let folder = tempfile::tempdir().unwrap();
        let image = GrayImage { width: 64, height: 48, pixels: vec![90; 64 * 48] };
        for kind in [DepthKind::Metric, DepthKind::UpToScale, DepthKind::Affine] {
            let path = folder.path().join(format!("{kind:?}.png"));
            draw_depth(&path, &image, &map(kind), "title", "subtitle").unwrap();
            let drawn = image::open(&path).unwrap().into_rgb8();
            assert_eq!(drawn.width(), 3 * PANEL + 4 * GAP);
            let height = PANEL * 48 / 64;
            let at = |panel: u32, x: u32, y: u32| drawn.get_pixel(GAP + panel * (PANEL + GAP) + x, HEAD + y).0;
            assert_eq!(at(0, 300, 200), [90; 3]);
            assert_eq!((at(1, 300, 4), at(2, 300, 4)), (UNKNOWN, UNKNOWN));
            // Far above, near below: blue, then red.
            let (far, near) = (at(1, 10, 120), at(1, 590, height - 4));
            assert!(far[2] > 180 && far[0] < 120 && near[0] > 180 && near[2] < 120, "{far:?} {near:?}");
        }
    }

    #[test]
    fn a_legend_has_round_numbers_within_its_range() {
        let scale = Scale::new(0.55, 7.3, "", false, None);
        assert_eq!(
            scale.ticks().into_iter().map(round3).collect::<Vec<_>>(),
            [0.6, 0.7, 0.8, 1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0]
        );
        assert!(scale.place(0.1) <= 0.0 && scale.place(50.0) >= 1.0 && (scale.place((0.55_f64 * 7.3).sqrt()) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn a_file_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let image = GrayImage { width: 64, height: 48, pixels: vec![90; 64 * 48] };
        let path = folder.path().join("absent/depth.png");
        let fault = draw_depth(&path, &image, &map(DepthKind::Metric), "", "").unwrap_err();
        assert!(fault.kind == FaultKind::Output && fault.to_string().contains("absent"), "{fault}");
    }
}
