//! What pictures have in common: inks, the font, colours of a scale.

use std::io::Cursor;
use std::sync::OnceLock;

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
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

/// A picture as JPEG; nothing where it has no pixel.
pub(crate) fn jpeg(pixels: &[u8], (width, height): (usize, usize), color: ExtendedColorType, quality: u8) -> Option<Vec<u8>> {
    let mut bytes = Cursor::new(Vec::new());
    let (width, height) = (u32::try_from(width).ok()?, u32::try_from(height).ok()?);
    JpegEncoder::new_with_quality(&mut bytes, quality).write_image(pixels, width, height, color).ok()?;
    Some(bytes.into_inner())
}

/// What a tint counts inside of its polygon and along its edge.
const TINT: [f64; 2] = [0.3, 0.8];
/// Half the width of that edge, px.
const EDGE_PX: f64 = 0.8;

/// Tints the pixels of an RGB picture inside of a polygon; the centre of the first pixel is (0.5, 0.5).
pub(crate) fn tint(pixels: &mut [u8], (width, height): (usize, usize), polygon: &[[f64; 2]], color: [u8; 3]) {
    let edges = || polygon.iter().zip(polygon.iter().cycle().skip(1));
    for (index, pixel) in pixels.chunks_exact_mut(3).take(width * height).enumerate() {
        let (x, y) = ((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
        let crossings = edges().filter(|(a, b)| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
        let inside = crossings.count() % 2 == 1;
        let on_edge = edges().any(|(a, b)| {
            let (along, from) = ([b[0] - a[0], b[1] - a[1]], [x - a[0], y - a[1]]);
            let length = along[0].hypot(along[1]);
            let place = (along[0] * from[0] + along[1] * from[1]) / length;
            (along[0] * from[1] - along[1] * from[0]).abs() < EDGE_PX * length && (0.0..=length).contains(&place)
        });
        let [fill, edge] = TINT;
        let share = if on_edge { edge } else { fill * f64::from(u8::from(inside)) };
        for (value, tint) in pixel.iter_mut().zip(color) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let mixed = (f64::from(*value) * (1.0 - share) + f64::from(tint) * share).round() as u8;
            *value = mixed;
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tint_stays_inside_of_its_polygon() {
        let mut pixels = vec![100; 3 * 20 * 10];
        tint(&mut pixels, (20, 10), &[[5.0, 2.0], [15.0, 2.0], [15.0, 8.0], [5.0, 8.0]], [200, 0, 100]);
        let at = |x: usize, y: usize| &pixels[3 * (y * 20 + x)..3 * (y * 20 + x) + 3];
        assert_eq!((at(10, 5), at(2, 5), at(10, 0)), (&[130, 70, 100][..], &[100; 3][..], &[100; 3][..]));
        assert_eq!(at(5, 5), &[180, 20, 100]);
    }
}
