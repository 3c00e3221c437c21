//! Corners over the parts of the recording that tell most, and what the images look like.
//!
//! # Method
//! Work is bounded: of a long recording the windows of the most varied angular rate are read. Corners are followed without the help of
//! the gyro or the calibration, because either may be wrong.

use libella_core::camera::{CameraModel, PinholeRadTan};
use libella_core::image::PyramidPair;
use libella_core::robust::stats;
use libella_core::time::Timestamp;
use libella_core::track::{FrontEnd, FrontEndConfig};
use nalgebra::{Vector2, Vector3};

use super::Material;
use super::finding::Pictures;
use crate::dataset::{Frames, GrayImage, Recording};
use crate::fault::{Fault, FaultKind};

/// Images per window: five seconds of most cameras.
const WINDOW: usize = 100;
const TRACKS: usize = 200;
/// Room for the pyramids of images up to about 1.5 megapixels.
const PYRAMID_BYTES: usize = 2 << 20;
/// Front end and pyramids are built on the stack before they move to the heap.
const STACK_BYTES: usize = 64 << 20;

/// Corners of one image, by rising track.
#[derive(Debug, Clone)]
pub(super) struct Shot {
    pub stamp: Timestamp,
    pub corners: Vec<(u32, Vector2<f64>)>,
}

/// What was seen.
#[derive(Debug, Default)]
pub(super) struct Sightings {
    /// Uninterrupted series of images.
    pub windows: Vec<Vec<Shot>>,
    pub pictures: Option<Pictures>,
    /// Size of the images, where there are any, px.
    pub size_px: Option<(u32, u32)>,
    /// Images that could not be read, and why the first.
    pub unread: (usize, Option<String>),
}

/// The frames of the windows to read: indices into the material's frames, in order, one list per window.
fn choose(material: &Material, most: usize) -> Vec<Vec<usize>> {
    let count = material.frames.len();
    if count <= most {
        return vec![(0..count).collect()];
    }
    let mut windows: Vec<(f64, usize)> = (0..count / WINDOW).map(|k| (variety(material, k * WINDOW, (k + 1) * WINDOW - 1), k)).collect();
    windows.sort_by(|a, b| b.0.total_cmp(&a.0));
    windows.truncate((most / WINDOW).max(1));
    windows.sort_by_key(|(_, k)| *k);
    windows.into_iter().map(|(_, k)| (k * WINDOW..(k + 1) * WINDOW).collect()).collect()
}

/// How much the angular rate varies from its mean between two frames.
fn variety(material: &Material, first: usize, last: usize) -> f64 {
    let (Some(from), Some(to)) = (material.frames.get(first), material.frames.get(last)) else { return 0.0 };
    let begin = material.imu.partition_point(|sample| sample.stamp < *from);
    let end = material.imu.partition_point(|sample| sample.stamp <= *to);
    let samples = material.imu.get(begin..end).unwrap_or_default();
    if samples.is_empty() {
        return 0.0;
    }
    let mean = samples.iter().map(|sample| sample.gyro_rad_s).sum::<Vector3<f64>>() / samples.len() as f64;
    samples.iter().map(|sample| (sample.gyro_rad_s - mean).norm_squared()).sum::<f64>() / samples.len() as f64
}

/// Follows corners through at most `most` images.
///
/// # Errors
/// When no thread can be started.
pub(super) fn look(recording: &Recording, material: &Material, most: usize, ahead: usize) -> Result<Sightings, Fault> {
    if let Frames::Tracks(frames) = &recording.frames {
        // Nothing has to be decoded: four times as many cost as much.
        let windows = choose(material, 4 * most).into_iter().map(|window| {
            let shot = |index: usize| {
                let (file, stamp) = (*material.source.get(index)?, *material.frames.get(index)?);
                let mut corners: Vec<_> = frames.get(file)?.observations.iter().map(|seen| (seen.track.0, seen.pixel)).collect();
                corners.sort_by_key(|(track, _)| *track);
                Some(Shot { stamp, corners })
            };
            window.into_iter().filter_map(shot).collect()
        });
        return Ok(Sightings { windows: windows.collect(), ..Sightings::default() });
    }
    std::thread::scope(|scope| {
        std::thread::Builder::new()
            .name("sightings".into())
            .stack_size(STACK_BYTES)
            .spawn_scoped(scope, || follow(recording, material, most, ahead))
            .map_err(|error| {
                Fault::new(FaultKind::Output, format!("no thread for the images ({error})"), "free memory or raise the limit")
            })?
            .join()
            .unwrap_or_else(|_| {
                Err(Fault::new(FaultKind::NoResult, "the front end stopped without a word", "report it with the recording"))
            })
    })
}

fn follow(recording: &Recording, material: &Material, most: usize, ahead: usize) -> Result<Sightings, Fault> {
    let windows = choose(material, most);
    let wanted: Vec<usize> = windows.iter().flatten().filter_map(|index| material.source.get(*index).copied()).collect();
    let mut images = recording.images(&wanted, ahead)?;
    let mut front = Box::new(FrontEnd::<TRACKS>::new(FrontEndConfig::DEFAULT));
    let mut pyramids: Box<PyramidPair<PYRAMID_BYTES>> = Box::default();
    let mut album = Album::default();
    let mut seen = Sightings::default();
    for window in &windows {
        front.reset();
        pyramids.clear();
        album.previous = None;
        let mut shots = Vec::with_capacity(window.len());
        for index in window {
            let (Some(stamp), Some((_, decoded))) = (material.frames.get(*index), images.next()) else { continue };
            let read = decoded.map_err(|fault| fault.to_string()).and_then(|image| {
                seen.size_px.get_or_insert((image.width as u32, image.height as u32));
                let corners = corners(&mut front, &mut pyramids, &image)?;
                album.add(image, front.tracks().iter().filter(|track| track.age > 0).count());
                Ok(corners)
            });
            match read {
                Ok(corners) => shots.push(Shot { stamp: *stamp, corners }),
                Err(reason) => {
                    seen.unread.0 += 1;
                    seen.unread.1.get_or_insert(reason);
                }
            }
        }
        seen.windows.push(shots);
    }
    seen.pictures = album.close();
    Ok(seen)
}

fn corners(
    front: &mut FrontEnd<TRACKS>,
    pyramids: &mut PyramidPair<PYRAMID_BYTES>,
    image: &GrayImage,
) -> Result<Vec<(u32, Vector2<f64>)>, String> {
    let view = image.view().map_err(|error| error.to_string())?;
    let levels = front.config().levels;
    *front.config_mut() = FrontEndConfig::for_image(image.width, image.height, TRACKS);
    pyramids.push(&view, levels).map_err(|error| error.to_string())?;
    // Only a predicted rotation would ask for a camera.
    let unused =
        CameraModel::<f64>::PinholeRadTan(PinholeRadTan { size_px: (1, 1), focal_px: [1.0; 2], center_px: [0.0; 2], distortion: [0.0; 4] });
    front.follow(pyramids, &unused, None);
    front.replenish(pyramids);
    let mut corners: Vec<_> =
        front.tracks().iter().map(|track| (track.id.0, Vector2::new(f64::from(track.pixel[0]), f64::from(track.pixel[1])))).collect();
    corners.sort_by_key(|(track, _)| *track);
    Ok(corners)
}

/// Figures of the images as they pass.
#[derive(Default)]
struct Album {
    previous: Option<GrayImage>,
    grey: Vec<f64>,
    dark: Vec<f64>,
    bright: Vec<f64>,
    flicker: Vec<f64>,
    sharpness: Vec<f64>,
    followed: Vec<f64>,
    repeated: usize,
}

impl Album {
    fn add(&mut self, image: GrayImage, followed: usize) {
        let count = image.pixels.len().max(1) as f64;
        let grey = image.pixels.iter().map(|grey| f64::from(*grey)).sum::<f64>() / count;
        let share = |test: fn(&&u8) -> bool| image.pixels.iter().filter(test).count() as f64 / count;
        self.dark.push(share(|grey| **grey <= 5));
        self.bright.push(share(|grey| **grey >= 250));
        if let Some(previous) = &self.previous {
            self.repeated += usize::from(previous.pixels == image.pixels);
            self.followed.push(followed as f64);
            self.flicker.extend(self.grey.last().map(|last| (grey - last).abs()));
        }
        self.grey.push(grey);
        let (mut near, mut far) = (0_i64, 0_i64);
        // Every fourth row says the same as all of them.
        for row in image.pixels.chunks_exact(image.width.max(1)).step_by(4) {
            for window in row.windows(3) {
                let difference = |a: u8, b: u8| (i64::from(a) - i64::from(b)).pow(2);
                near += difference(window[1], window[0]);
                far += difference(window[2], window[0]);
            }
        }
        if far > 0 {
            self.sharpness.push(near as f64 / far as f64);
        }
        self.previous = Some(image);
    }

    fn close(mut self) -> Option<Pictures> {
        let looked_at = self.grey.len();
        let median = |values: &mut Vec<f64>| stats::median(values).unwrap_or(0.0);
        (looked_at > 0).then(|| Pictures {
            looked_at,
            grey: median(&mut self.grey),
            dark_share: median(&mut self.dark),
            bright_share: median(&mut self.bright),
            flicker: median(&mut self.flicker),
            sharpness: median(&mut self.sharpness),
            repeated_share: self.repeated as f64 / looked_at as f64,
            followed: median(&mut self.followed),
        })
    }
}
