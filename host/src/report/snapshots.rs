//! A handful of images with what the estimator saw in them, taken while a run goes on and kept in `views/` of its output folder.

use std::collections::VecDeque;
use std::path::Path;

use image::ExtendedColorType;
use libella_core::estimator::Health;
use libella_core::time::Timestamp;
use serde::{Deserialize, Serialize};

use super::frames::name_of;
use crate::dataset::GrayImage;
use crate::fault::Fault;
use crate::network::DepthMap;
use crate::paint::{DEPTH_COLORS, SIGMA_COLORS, UNKNOWN, color, jpeg, log_place, tint};
use crate::pipeline::{FrameResult, PlaneInView, Trails, View};
use crate::planes::{light_color_of, name_of as name_of_plane};

/// Images over the whole run, and images at which tracking broke down.
const EVEN: usize = 6;
const BREAKDOWNS: usize = 2;
/// Images tracked in a row before a breakdown is one.
const STEADY: usize = 20;
/// How long an image waits for one that has a depth, in images.
const PATIENCE: usize = 20;
/// Width of the pictures, px.
const WIDTH: usize = 480;
const MAP_WIDTH: usize = 240;
const QUALITY: u8 = 72;

/// One entry of `views.json`. The names of the fields are an interface: they stay.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Snapshot {
    /// Time of the image.
    pub stamp_ns: i64,
    /// Since the first image, s.
    pub seconds: f64,
    /// As in `frames.csv`.
    pub health: String,
    /// Size of the image that the corners are measured in, px.
    pub size_px: [usize; 2],
    /// Name of the picture beside `views.json`.
    pub image: String,
    /// Names of the coloured maps, where the image had a depth.
    pub depth: Option<Map>,
    pub sigma: Option<Map>,
    pub corners: Vec<Seen>,
    /// Planes that corners lie on.
    #[serde(default)]
    pub planes: Vec<Outlined>,
    /// Name of the picture with the planes painted over it, where there are some.
    #[serde(default)]
    pub overlay: Option<String>,
}

/// A steady plane in the image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Outlined {
    /// As in `planes.json`.
    pub id: usize,
    pub class: String,
    /// Where it is, px.
    pub outline_px: Vec<[f64; 2]>,
}

/// A coloured map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Map {
    pub picture: String,
    /// What the ends of the colours stand for: m, or a standard deviation of ln depth.
    pub range: [f64; 2],
}

/// A corner that was followed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Seen {
    /// Where it was, oldest first; the last is where it is, px.
    pub trail_px: Vec<[f64; 2]>,
    pub depth_m: Option<f64>,
    /// What the plane is that it lies on.
    pub plane: Option<String>,
}

/// Takes snapshots.
#[derive(Debug, Default)]
pub struct Snapshots {
    wanted: VecDeque<usize>,
    images: usize,
    begun: Option<Timestamp>,
    /// Images tracked in a row so far.
    tracked: usize,
    breakdowns: usize,
    trails: Trails,
    /// Whether any image had a depth so far.
    has_depth: bool,
    taken: Vec<Snapshot>,
    pictures: Vec<(String, Vec<u8>)>,
}

impl Snapshots {
    /// Of a run over so many images.
    #[must_use]
    pub fn new(images: usize) -> Self {
        let wanted = (0..EVEN).map(|index| images * (2 * index + 1) / (2 * EVEN)).collect();
        Self { wanted, ..Self::default() }
    }

    /// Looks at one image of the run; they come in order.
    pub fn add(&mut self, frame: &FrameResult, view: &View) {
        let index = self.images;
        self.images += 1;
        let begun = *self.begun.get_or_insert(frame.stamp);
        self.trails.follow(view);
        self.has_depth |= view.depth.is_some();
        let tracked = if frame.health == Health::Tracking { self.tracked + 1 } else { 0 };
        let broke_down = std::mem::replace(&mut self.tracked, tracked) >= STEADY && tracked == 0;
        let Some(image) = view.image.as_ref().filter(|image| image.width > 0 && image.height > 0) else { return };
        let due = self
            .wanted
            .front()
            .is_some_and(|wanted| *wanted <= index && (view.depth.is_some() || !self.has_depth || wanted + PATIENCE <= index));
        let breakdown = broke_down && self.breakdowns < BREAKDOWNS;
        self.breakdowns += usize::from(breakdown);
        if due {
            self.wanted.pop_front();
        }
        if due || breakdown {
            self.take(frame, (frame.stamp - begun).as_seconds(), image, view);
        }
    }

    fn take(&mut self, frame: &FrameResult, seconds: f64, image: &GrayImage, view: &View) {
        let stamp = frame.stamp.as_nanos();
        let (grey, small) = smaller(image);
        let Some(bytes) = jpeg(&grey, small, ExtendedColorType::L8, QUALITY) else { return };
        let picture = format!("{stamp}.jpg");
        self.pictures.push((picture.clone(), bytes));
        let in_view = || view.planes.iter().filter(|plane| !plane.outline_px.is_empty());
        let painted =
            in_view().next().and_then(|_| jpeg(&painted(&grey, small, image.width, in_view()), small, ExtendedColorType::Rgb8, QUALITY));
        let overlay = painted.map(|bytes| {
            let picture = format!("{stamp}_planes.jpg");
            self.pictures.push((picture.clone(), bytes));
            picture
        });
        let mut map = |kind: &str, made: Option<(Vec<u8>, [f64; 2])>| {
            let (bytes, range) = made?;
            let picture = format!("{stamp}_{kind}.jpg");
            self.pictures.push((picture.clone(), bytes));
            Some(Map { picture, range })
        };
        let size = (image.width, image.height);
        let of = |map: &DepthMap, value: fn(&DepthMap, [f64; 2]) -> Option<f64>, colors: &[[f64; 3]]| colored(map, size, value, colors);
        let depth = map(
            "depth",
            view.depth.as_ref().and_then(|map| {
                of(map, |map, pixel| map.sample(pixel).map(|sample| f64::from(sample.inverse_depth_1_m).recip()), &DEPTH_COLORS)
            }),
        );
        let sigma = map(
            "sigma",
            view.depth
                .as_ref()
                .and_then(|map| of(map, |map, pixel| map.sample(pixel).map(|sample| f64::from(sample.sigma_log)), &SIGMA_COLORS)),
        );
        let rounded = |pixel: &[f64; 2]| pixel.map(|value| (value * 10.0).round() / 10.0);
        let corners = view.corners.iter().map(|corner| Seen {
            trail_px: self.trails.of(corner.track).iter().map(rounded).collect(),
            depth_m: corner.depth_m.map(|depth| (depth * 1e3).round() / 1e3),
            plane: corner.plane.map(|class| name_of_plane(class).to_owned()),
        });
        let planes = in_view().map(|plane| Outlined {
            id: plane.id,
            class: name_of_plane(plane.class).to_owned(),
            outline_px: plane.outline_px.iter().map(rounded).collect(),
        });
        self.taken.push(Snapshot {
            stamp_ns: stamp,
            seconds,
            health: name_of(frame.health).to_owned(),
            size_px: [image.width, image.height],
            image: picture,
            depth,
            sigma,
            corners: corners.collect(),
            planes: planes.collect(),
            overlay,
        });
    }

    /// Writes `views/` into a folder; without a snapshot there is none.
    pub(super) fn write(&self, folder: &Path) -> Result<(), Fault> {
        let views = folder.join("views");
        if views.is_dir() {
            // Those of an earlier run into the same folder.
            let _ = std::fs::remove_dir_all(&views);
        }
        if self.taken.is_empty() {
            return Ok(());
        }
        let json = serde_json::to_string(&self.taken).unwrap_or_default() + "\n";
        let files = self.pictures.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
        let files = files.chain([("views.json", json.as_bytes())]);
        std::fs::create_dir_all(&views).map_err(|error| Fault::unwritable(&views, &error))?;
        for (name, bytes) in files {
            let path = views.join(name);
            std::fs::write(&path, bytes).map_err(|error| Fault::unwritable(&path, &error))?;
        }
        Ok(())
    }
}

/// Grey in colour, with the planes over it.
fn painted<'a>(grey: &[u8], (width, height): (usize, usize), raw_width: usize, planes: impl Iterator<Item = &'a PlaneInView>) -> Vec<u8> {
    let mut pixels: Vec<u8> = grey.iter().flat_map(|value| [*value; 3]).collect();
    let scale = width as f64 / raw_width.max(1) as f64;
    for plane in planes {
        let outline: Vec<[f64; 2]> = plane.outline_px.iter().map(|pixel| pixel.map(|value| (value + 0.5) * scale)).collect();
        tint(&mut pixels, (width, height), &outline, light_color_of(plane.class));
    }
    pixels
}

/// A picture of at most [`WIDTH`], each pixel the mean of those that it covers.
fn smaller(image: &GrayImage) -> (Vec<u8>, (usize, usize)) {
    let width = image.width.min(WIDTH);
    let height = (image.height * width / image.width).max(1);
    let mut pixels = Vec::with_capacity(width * height);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let rows = y * image.height / height..((y + 1) * image.height / height).max(y * image.height / height + 1);
        let columns = x * image.width / width..((x + 1) * image.width / width).max(x * image.width / width + 1);
        let (mut sum, mut count) = (0_usize, 0_usize);
        for row in rows {
            for pixel in image.pixels.get(row * image.width + columns.start..row * image.width + columns.end).unwrap_or_default() {
                sum += usize::from(*pixel);
                count += 1;
            }
        }
        pixels.push(u8::try_from(sum / count.max(1)).unwrap_or(u8::MAX));
    }
    (pixels, (width, height))
}

/// A map in colours, logarithmic between its outer percents.
fn colored(
    map: &DepthMap,
    (raw_width, raw_height): (usize, usize),
    value: impl Fn(&DepthMap, [f64; 2]) -> Option<f64>,
    colors: &[[f64; 3]],
) -> Option<(Vec<u8>, [f64; 2])> {
    let (width, height) = (MAP_WIDTH, (MAP_WIDTH * raw_height / raw_width).max(1));
    let raw = |pixel: usize, side: usize, raw: usize| (pixel as f64 + 0.5) * raw as f64 / side as f64 - 0.5;
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (y, x)));
    let usable = |value: &f64| value.is_finite() && *value > 0.0;
    let values: Vec<Option<f64>> =
        places.map(|(y, x)| value(map, [raw(x, width, raw_width), raw(y, height, raw_height)]).filter(usable)).collect();
    let mut known: Vec<f64> = values.iter().flatten().copied().collect();
    known.sort_by(f64::total_cmp);
    let last = known.len().checked_sub(1)?;
    let (low, high) = (known.get(last / 100).copied()?, known.get(last - last / 100).copied()?);
    let high = high.max(low * 1.2);
    let mut pixels = Vec::with_capacity(3 * values.len());
    for value in values {
        pixels.extend(value.map_or(UNKNOWN, |value| color(log_place(value, [low, high]), colors)));
    }
    Some((jpeg(&pixels, (width, height), ExtendedColorType::Rgb8, QUALITY)?, [low, high]))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_smaller_picture_keeps_shape_and_mean() {
        let image = GrayImage { width: 960, height: 600, pixels: (0..960 * 600).map(|index| ((index % 2) * 100 + 50) as u8).collect() };
        let (small, size) = smaller(&image);
        assert_eq!(size, (480, 300));
        assert!(small.iter().all(|grey| grey.abs_diff(100) < 3));
    }

    #[test]
    fn colours_end_where_the_scale_ends() {
        assert_eq!((color(0.0, &DEPTH_COLORS), color(1.0, &DEPTH_COLORS)), ([255, 72, 48], [84, 140, 255]));
        assert_eq!(color(0.5, &DEPTH_COLORS), [150, 226, 84]);
    }
}
