//! One camera's image as the model's camera would see it, and what the model says back in the pixels of the first.
//!
//! # Model
//! A network's depths hold for one camera. Both cameras stand at the same place and look the same way, so that a change between
//! them needs no depth: a pixel's ray is projected into the other image. With zoom z the model's pixel p stands for the ray
//! ```text
//! (x/z, y/z, 1),   (x, y, 1) = unproject_model(p)
//! ```
//! To the model a scene seen so looks like one whose depths are divided by z, therefore its depths are multiplied by z. z is 1
//! where the caller's image fills at least nine tenths of the model's; a longer lens gets the smallest z that does so.
//!
//! An image of the model's own camera (see [`SAME_CAMERA_PX`]) is only shrunk, and its map is what the network gave. Any other is
//! looked up through a table that is made once: every pixel of the model's image is the mean of a few bilinear samples spread over
//! it, as many as source pixels fit. Pixels that the caller does not see repeat the nearest one that it does.
//!
//! # Degeneracy
//! Rays that the model's image does not contain have no depth: the map is unknown there.

#[cfg(test)]
mod tests;

use libella_core::camera::{Camera as _, CameraModel};
use libella_core::image::ImageView;
use nalgebra::{Vector2, Vector3};

use super::area::AreaAverage;
use super::{DepthKind, DepthMap, ModelCamera, NetworkError};
use crate::fault::{Fault, FaultKind};

/// Two cameras are the same if none of the pixels of a grid over the image is off by more than this, in pixels of the model's input:
/// a sixteenth of a pixel of its output.
pub const SAME_CAMERA_PX: f64 = 0.25;
/// Share of the model's image that the caller's must fill before it is zoomed in.
const LEAST_COVERED: f64 = 0.9;
const LARGEST_ZOOM: f64 = 8.0;
/// Samples along one side of a pixel of the input, at most.
const MOST_SAMPLES: usize = 4;
/// Nothing is known there.
const NOWHERE: u32 = u32::MAX;

/// A bilinear sample: index of the upper left pixel and shares of the right and lower neighbours.
#[derive(Debug, Clone, Copy)]
struct Tap {
    index: u32,
    right: f32,
    down: f32,
}

/// The way from the images of one camera to a model's input, and from its output back.
#[derive(Debug, Clone)]
pub struct Resampling {
    size: [usize; 2],
    output: [usize; 2],
    zoom: f64,
    step_px: [f64; 2],
    way: Way,
}

#[derive(Debug, Clone)]
enum Way {
    Same(AreaAverage),
    /// Taps of the image for each pixel of the input, `samples` of each; taps of the output for each pixel of the map.
    Other {
        samples: usize,
        taps: Vec<Tap>,
        map: [usize; 2],
        back: Vec<Tap>,
    },
}

#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_sign_loss)]
impl Resampling {
    /// Prepares for images of `camera`; `input` and `output` are width and height of the model's, in pixels.
    ///
    /// # Errors
    /// When the camera's numbers are no camera's, or it sees nothing that the model's camera would see.
    pub fn new(camera: &CameraModel<f64>, model: &ModelCamera, input: [usize; 2], output: [usize; 2]) -> Result<Self, Fault> {
        let refused = |what: &str| Fault::new(FaultKind::Configuration, what, "calibrate the camera again");
        camera.validate().map_err(|error| refused(&format!("the camera cannot be used for depth ({error})")))?;
        let (width, height) = camera.size_px();
        let size = [width as usize, height as usize];
        if size[0] > 1 << 14 || size[1] > 1 << 14 {
            return Err(refused(&format!("images of {width}x{height} pixels are larger than 16384 on a side")));
        }
        let between = Between { camera, model: model.camera(input), size, input };
        let ratio = |from: [usize; 2], to: [usize; 2]| [from[0] as f64 / to[0] as f64, from[1] as f64 / to[1] as f64];
        if between.is_same() {
            let way = Way::Same(AreaAverage::new(size, input));
            return Ok(Self { size, output, zoom: 1.0, step_px: ratio(size, output), way });
        }
        let zoom = between.zoom().ok_or_else(|| refused("the camera sees nothing that the camera of the network would see"))?;
        let (samples, taps) = between.taps(zoom);
        // As many map pixels per radian along the axis as the network has, evenly over the image.
        let one = between
            .to_input(zoom, [0.5 * width as f64, 0.5 * height as f64])
            .zip(between.to_input(zoom, [0.5 * width as f64 + 1.0, 0.5 * height as f64 + 1.0]));
        let scale = one.map_or([1.0, 1.0], |(a, b)| [(b[0] - a[0]).abs(), (b[1] - a[1]).abs()]);
        let stride = ratio(input, output);
        let map = [0, 1].map(|axis| ((size[axis] as f64 * scale[axis] / stride[axis]).ceil() as usize).clamp(2, size[axis].clamp(2, 1024)));
        let step_px = ratio(size, map);
        let mut back = Vec::with_capacity(map[0] * map[1]);
        for j in 0..map[1] {
            for i in 0..map[0] {
                let raw = [(i as f64 + 0.5) * step_px[0] - 0.5, (j as f64 + 0.5) * step_px[1] - 0.5];
                let at = between.to_input(zoom, raw).map(|p| [(p[0] + 0.5) / stride[0] - 0.5, (p[1] + 0.5) / stride[1] - 0.5]);
                let inside = at.filter(|p| (0..2).all(|axis| p[axis] >= -0.5 && p[axis] <= output[axis] as f64 - 0.5));
                back.push(inside.map_or(Tap { index: NOWHERE, right: 0.0, down: 0.0 }, |p| tap(p, output)));
            }
        }
        if back.iter().all(|tap| tap.index == NOWHERE) {
            return Err(refused("the camera sees nothing that the camera of the network would see"));
        }
        Ok(Self { size, output, zoom, step_px, way: Way::Other { samples, taps, map, back } })
    }

    /// Whether images are only shrunk.
    #[must_use]
    pub fn is_same_camera(&self) -> bool {
        matches!(self.way, Way::Same(_))
    }

    /// How many times longer a lens than its own the model is shown; its depths have to be multiplied by it.
    #[must_use]
    pub fn zoom(&self) -> f64 {
        self.zoom
    }

    /// Grey values 0 to 1 of the image as the model's camera would see it, row by row.
    ///
    /// # Errors
    /// When the image has not the size of the camera's.
    pub fn to_model(&self, image: &ImageView<'_>) -> Result<Vec<f32>, NetworkError> {
        let given = [image.width(), image.height()];
        if given != self.size {
            return Err(NetworkError::ImageSize { given, expected: self.size });
        }
        let (samples, taps) = match &self.way {
            Way::Same(area) => return Ok(area.of(image)),
            Way::Other { samples, taps, .. } => (*samples, taps),
        };
        let share = 1.0 / (255.0 * samples as f32);
        let pixel = |x: usize, y: usize| f32::from(image.row(y).get(x).copied().unwrap_or(0));
        let value = |tap: &Tap| {
            let (x, y) = (tap.index as usize % self.size[0], tap.index as usize / self.size[0]);
            let (x1, y1) = ((x + 1).min(self.size[0] - 1), (y + 1).min(self.size[1] - 1));
            let (top, bottom) = (lerp(pixel(x, y), pixel(x1, y), tap.right), lerp(pixel(x, y1), pixel(x1, y1), tap.right));
            lerp(top, bottom, tap.down)
        };
        Ok(taps.chunks_exact(samples).map(|taps| taps.iter().map(value).sum::<f32>() * share).collect())
    }

    /// A map of the caller's image from what the model gave; `sigma_log` and `uncertainty` are as long as `inverse_depth`, and that
    /// is in 1/m of the model's own camera.
    #[must_use]
    pub fn to_raw(&self, inverse_depth: &[f32], sigma_log: &[f32], uncertainty: &[f32], kind: DepthKind) -> DepthMap {
        let size = match &self.way {
            Way::Same(_) => self.output,
            Way::Other { map, .. } => *map,
        };
        // The centre of the first of evenly spread cells.
        let mut map = DepthMap::unknown(size, self.step_px, self.step_px.map(|step| 0.5 * step - 0.5), kind);
        match &self.way {
            Way::Same(_) => {
                map.inverse_depth_1_m.copy_from_slice(inverse_depth);
                map.sigma_log.copy_from_slice(sigma_log);
                map.uncertainty.copy_from_slice(uncertainty);
            }
            Way::Other { back, .. } => {
                let zoom = if kind == DepthKind::Metric { self.zoom as f32 } else { 1.0 };
                let known = |value: f32| value.is_finite() && (value > 0.0 || kind == DepthKind::Affine);
                for (index, tap) in back.iter().enumerate().filter(|(_, tap)| tap.index != NOWHERE) {
                    let (x, y) = (tap.index as usize % self.output[0], tap.index as usize / self.output[0]);
                    let (x1, y1) = ((x + 1).min(self.output[0] - 1), (y + 1).min(self.output[1] - 1));
                    let corners = [[x, y], [x1, y], [x, y1], [x1, y1]].map(|[x, y]| y * self.output[0] + x);
                    if !corners.iter().all(|corner| inverse_depth.get(*corner).copied().is_some_and(known)) {
                        continue;
                    }
                    let between = |values: &[f32]| {
                        let [a, b, c, d] = corners.map(|corner| values.get(corner).copied().unwrap_or(f32::NAN));
                        lerp(lerp(a, b, tap.right), lerp(c, d, tap.right), tap.down)
                    };
                    map.inverse_depth_1_m[index] = between(inverse_depth) / zoom;
                    map.sigma_log[index] = between(sigma_log);
                    map.uncertainty[index] = between(uncertainty);
                }
            }
        }
        map
    }
}

fn lerp(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

/// The tap at a place of an image, the nearest one within it.
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_sign_loss)]
fn tap(at: [f64; 2], size: [usize; 2]) -> Tap {
    let clamped = [0, 1].map(|axis| at[axis].clamp(0.0, (size[axis] - 1) as f64));
    let low = clamped.map(|value| value as usize);
    Tap { index: (low[1] * size[0] + low[0]) as u32, right: (clamped[0] - low[0] as f64) as f32, down: (clamped[1] - low[1] as f64) as f32 }
}

/// Both cameras; the model's in pixels of its input.
struct Between<'a> {
    camera: &'a CameraModel<f64>,
    model: CameraModel<f64>,
    size: [usize; 2],
    input: [usize; 2],
}

#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_sign_loss)]
impl Between<'_> {
    /// The pixel of the input that sees what a raw pixel sees.
    fn to_input(&self, zoom: f64, raw: [f64; 2]) -> Option<[f64; 2]> {
        let bearing = self.camera.unproject(&Vector2::from(raw))?;
        let pixel = self.model.project(&Vector3::new(zoom * bearing.x, zoom * bearing.y, bearing.z))?;
        Some([pixel.x, pixel.y])
    }

    /// The raw pixel that sees what a pixel of the input sees; it may lie outside of the image.
    fn to_raw(&self, zoom: f64, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let bearing = self.model.unproject(&Vector2::from(pixel))?;
        let raw = self.camera.project(&Vector3::new(bearing.x / zoom, bearing.y / zoom, bearing.z))?;
        Some([raw.x, raw.y])
    }

    /// Whether shrinking alone puts every pixel where the model's camera has it.
    fn is_same(&self) -> bool {
        const GRID: usize = 16;
        let at = |k: usize, axis: usize| k as f64 / GRID as f64 * self.size[axis] as f64 - 0.5;
        (0..=GRID).all(|j| {
            (0..=GRID).all(|i| {
                let raw = [at(i, 0), at(j, 1)];
                let shrunk = [0, 1].map(|axis| (raw[axis] + 0.5) * self.input[axis] as f64 / self.size[axis] as f64 - 0.5);
                self.to_input(1.0, raw).is_some_and(|p| (p[0] - shrunk[0]).hypot(p[1] - shrunk[1]) <= SAME_CAMERA_PX)
            })
        })
    }

    /// Share of the model's image that the caller's fills.
    fn covered(&self, zoom: f64) -> f64 {
        const GRID: usize = 32;
        let at = |k: usize, axis: usize| (k as f64 + 0.5) / GRID as f64 * self.input[axis] as f64 - 0.5;
        let cells = (0..GRID * GRID)
            .filter(|cell| self.to_raw(zoom, [at(cell % GRID, 0), at(cell / GRID, 1)]).is_some_and(|raw| self.is_seen(raw)));
        cells.count() as f64 / (GRID * GRID) as f64
    }

    fn is_seen(&self, raw: [f64; 2]) -> bool {
        (0..2).all(|axis| raw[axis] >= -0.5 && raw[axis] <= self.size[axis] as f64 - 0.5)
    }

    /// The smallest zoom with which the caller's image fills enough of the model's; `None` if it never fills any.
    fn zoom(&self) -> Option<f64> {
        let covered = self.covered(1.0);
        let (mut low, mut high) = (1.0, LARGEST_ZOOM);
        if covered >= LEAST_COVERED {
            return Some(1.0);
        }
        if self.covered(high) < LEAST_COVERED {
            // Off to a side: more zoom sees no more.
            return (covered > 0.0).then_some(1.0);
        }
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            if self.covered(middle) >= LEAST_COVERED { high = middle } else { low = middle }
        }
        Some(high)
    }

    /// Taps of the raw image for each pixel of the input, and how many belong to one.
    fn taps(&self, zoom: f64) -> (usize, Vec<Tap>) {
        // Raw pixels per pixel of the input: as many samples along a side.
        let middle = [0.5 * self.input[0] as f64, 0.5 * self.input[1] as f64];
        let across = self.to_raw(zoom, middle).zip(self.to_raw(zoom, [middle[0] + 1.0, middle[1] + 1.0]));
        let scale = across.map_or(1.0, |(a, b)| (b[0] - a[0]).abs().max((b[1] - a[1]).abs()));
        let side = (scale.ceil().max(1.0) as usize).min(MOST_SAMPLES);
        let mut taps = Vec::with_capacity(self.input[0] * self.input[1] * side * side);
        let mut last = [0.5 * self.size[0] as f64, 0.5 * self.size[1] as f64];
        for y in 0..self.input[1] {
            for x in 0..self.input[0] {
                for k in 0..side * side {
                    let offset = [k % side, k / side].map(|k| (k as f64 + 0.5) / side as f64 - 0.5);
                    // Beyond the lens, whatever lay beside it.
                    last = self.to_raw(zoom, [x as f64 + offset[0], y as f64 + offset[1]]).unwrap_or(last);
                    taps.push(tap(last, self.size));
                }
            }
        }
        (side * side, taps)
    }
}
