//! What pictures have in common: inks, the font, colours of a scale.

use std::sync::OnceLock;

use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

const FONT: &str = "libella";

pub(crate) const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
pub(crate) const SOFT_INK: RGBColor = RGBColor(0x60, 0x60, 0x60);
/// From near to far.
pub(crate) const DEPTH_COLORS: [[f64; 3]; 5] =
    [[255.0, 72.0, 48.0], [255.0, 176.0, 32.0], [150.0, 226.0, 84.0], [40.0, 200.0, 205.0], [84.0, 140.0, 255.0]];
/// From sure to unsure.
pub(crate) const SIGMA_COLORS: [[f64; 3]; 4] = [[18.0, 16.0, 60.0], [130.0, 30.0, 120.0], [240.0, 100.0, 60.0], [255.0, 240.0, 150.0]];
/// Where nothing is known.
pub(crate) const UNKNOWN: [u8; 3] = [0x70; 3];

/// The place of a value between two ends, in [0, 1]: a step is a factor.
pub(crate) fn log_place(value: f64, [low, high]: [f64; 2]) -> f64 {
    ((value / low).ln() / (high / low).ln()).clamp(0.0, 1.0)
}

/// The colour at a place in [0, 1] along two colours or more.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
pub(crate) fn color(place: f64, colors: &[[f64; 3]]) -> [u8; 3] {
    let along = place * (colors.len() - 1) as f64;
    let index = (along as usize).min(colors.len() - 2);
    let part = along - index as f64;
    [0, 1, 2].map(|channel| ((1.0 - part) * colors[index][channel] + part * colors[index + 1][channel]).round() as u8)
}

/// Text is drawn with a font that comes with the program: the picture is the same on every machine.
pub(crate) fn load_font() -> Result<(), String> {
    static LOADED: OnceLock<bool> = OnceLock::new();
    let font = include_bytes!("../assets/DejaVuSans-subset.ttf");
    let loaded = LOADED.get_or_init(|| register_font(FONT, FontStyle::Normal, font).is_ok());
    if *loaded { Ok(()) } else { Err("the font is damaged".into()) }
}

pub(crate) fn text(size: u32, zoom: u32, color: RGBColor) -> TextStyle<'static> {
    (FONT, size * zoom).into_font().color(&color)
}
