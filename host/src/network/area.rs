//! An image shrinks to another size by averages over area.
//!
//! # Model
//! Target pixel i of n covers source columns `i·W/n` to `(i+1)·W/n`, pixel edges at whole numbers. Its value is the mean of what it
//! covers, each source pixel weighted with its covered part; rows likewise, one after the other. An enlarged image repeats pixels.

use libella_core::image::ImageView;

/// The source pixels of every target pixel along one axis.
#[derive(Debug, Clone)]
struct Axis {
    /// First source pixel, and how many weights belong to it.
    spans: Vec<(usize, usize)>,
    weights: Vec<f32>,
}

impl Axis {
    #[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_sign_loss)]
    fn new(source: usize, target: usize) -> Self {
        let (mut spans, mut weights) = (Vec::with_capacity(target), Vec::new());
        for i in 0..target {
            // In whole numbers of 1/target pixels, so that edges that meet do so exactly.
            let (from, to) = (i * source, (i + 1) * source);
            let first = from / target;
            let last = (to - 1) / target;
            spans.push((first, last - first + 1));
            for pixel in first..=last {
                let covered = to.min((pixel + 1) * target) - from.max(pixel * target);
                weights.push((covered as f64 / source as f64) as f32);
            }
        }
        Self { spans, weights }
    }

    /// First source pixel and weights of each target pixel.
    fn parts(&self) -> impl Iterator<Item = (usize, &[f32])> {
        let mut rest = self.weights.as_slice();
        self.spans.iter().map(move |(first, count)| {
            let (now, later) = rest.split_at(*count);
            rest = later;
            (*first, now)
        })
    }
}

/// Shrinks images of one size to another; weights are computed once.
#[derive(Debug, Clone)]
pub(super) struct AreaAverage {
    columns: Axis,
    rows: Axis,
    target: [usize; 2],
}

impl AreaAverage {
    /// From one size to another, width and height in pixels, none of them 0.
    pub(super) fn new(source: [usize; 2], target: [usize; 2]) -> Self {
        Self { columns: Axis::new(source[0], target[0]), rows: Axis::new(source[1], target[1]), target }
    }

    /// Grey values 0 to 1 of the shrunk image, row by row.
    pub(super) fn of(&self, image: &ImageView<'_>) -> Vec<f32> {
        let mut out = Vec::with_capacity(self.target[0] * self.target[1]);
        let mut mean = vec![0.0_f32; image.width()];
        for (first, weights) in self.rows.parts() {
            mean.fill(0.0);
            for (y, weight) in (first..).zip(weights) {
                let weight = weight / 255.0;
                for (sum, pixel) in mean.iter_mut().zip(image.row(y)) {
                    *sum += weight * f32::from(*pixel);
                }
            }
            out.extend(self.columns.parts().map(|(first, weights)| {
                mean.get(first..).unwrap_or(&[]).iter().zip(weights).map(|(value, weight)| value * weight).sum::<f32>()
            }));
        }
        out
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp() {
        // The mean of a ramp over an interval is its value in the middle: (i + 1/2)·W/n − 1/2.
        let (width, height) = (188, 120);
        let pixels: Vec<u8> = (0..height).flat_map(|y| (0..width).map(move |x| u8::try_from(x + y / 2).unwrap())).collect();
        let even: Vec<u8> = (0..height).flat_map(|_| (0..width).map(|x| u8::try_from(x).unwrap())).collect();
        let image = ImageView::new(&even, width, height, width).unwrap();
        let small = AreaAverage::new([width, height], [80, 48]).of(&image);
        for (index, value) in small.iter().enumerate() {
            let x = (index % 80) as f64;
            let expected = ((x + 0.5) * 188.0 / 80.0 - 0.5) / 255.0;
            // A pixel's value holds over its whole area, so that a cut pixel moves the mean by at most 1/8 of it over the width.
            assert!((f64::from(*value) - expected).abs() < 0.125 / 2.35 / 255.0 + 1e-6, "{index}: {value} {expected}");
        }
        // Whatever the sizes, the mean of the image stays.
        let image = ImageView::new(&pixels, width, height, width).unwrap();
        let mean = pixels.iter().map(|pixel| f64::from(*pixel)).sum::<f64>() / (pixels.len() as f64 * 255.0);
        for target in [[80, 48], [188, 120], [7, 11], [1, 1], [300, 200]] {
            let small = AreaAverage::new([width, height], target).of(&image);
            assert_eq!(small.len(), target[0] * target[1]);
            let kept = small.iter().map(|value| f64::from(*value)).sum::<f64>() / small.len() as f64;
            assert!((kept - mean).abs() < 1e-6, "{target:?}: {kept} {mean}");
        }
    }

    #[test]
    fn the_same_size_is_the_same_image() {
        let pixels: Vec<u8> = (0..=255).collect();
        let image = ImageView::new(&pixels, 32, 8, 32).unwrap();
        let same = AreaAverage::new([32, 8], [32, 8]).of(&image);
        assert!(same.iter().zip(&pixels).all(|(value, pixel)| (value - f32::from(*pixel) / 255.0).abs() < 1e-7));
    }
}
