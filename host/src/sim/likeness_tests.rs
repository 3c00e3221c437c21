//! Are the rendered pictures like real ones? Corners, grey values and track lengths, side by side.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use libella_core::image::{ImageView, PyramidPair, pyramid_bytes};
use libella_core::track::detect::{Corner, DetectConfig, detect};
use libella_core::track::{FrontEnd, FrontEndConfig, TrackId};

use super::{MotionSource, RealMotionConfig, RenderConfig, RenderedFlight, euroc};
use crate::dataset::GrayImage;

const BYTES: usize = pyramid_bytes(752, 480, 4);

/// What a set of pictures looks like.
#[derive(Debug, Clone, Copy)]
struct Likeness {
    /// Cells of 16 px with a corner in them, mean per picture.
    corners: f64,
    /// Mean and standard deviation of the grey values, mean over the pictures.
    grey: [f64; 2],
    /// Grey values below which 5, 25, 50, 75 and 95 % of the pixels lie, mean over the pictures.
    quantiles: [f64; 5],
    /// Share of corners of a picture that are still followed 10 pictures later; NaN for pictures that do not follow each other.
    kept: f64,
    /// Mean length of the tracks that ended, in pictures.
    track: f64,
}

fn measure(images: impl Iterator<Item = GrayImage>, is_film: bool) -> Likeness {
    let mut pyramids = Box::<PyramidPair<BYTES>>::default();
    let mut front_end = Box::new(FrontEnd::<200>::new(FrontEndConfig::for_image(752, 480, 150)));
    let camera = euroc::camera(0);
    let (mut count, mut corners, mut grey, mut quantiles) = (0.0, 0.0, [0.0; 2], [0.0; 5]);
    let mut history: Vec<Vec<TrackId>> = Vec::new();
    let mut births = std::collections::HashMap::new();
    for image in images {
        let view = ImageView::new(&image.pixels, image.width, image.height, image.width).unwrap();
        if is_film {
            front_end.process::<f64, _, BYTES>(&view, &mut pyramids, &camera, None).unwrap();
            history.push(front_end.tracks().iter().map(|track| track.id).collect());
            history.last().unwrap().iter().for_each(|id| *births.entry(*id).or_insert(0.0) += 1.0);
        } else {
            pyramids.push(&view, 1).unwrap();
        }
        let mut found = vec![Corner::default(); 2000];
        let config = DetectConfig { cell_px: 16, min_distance_px: 8.0, border_px: 8, min_score: 30.0, min_relative_score: 0.0 };
        corners += detect(&pyramids.current(0).unwrap(), &config, std::iter::empty(), 2000, &mut found) as f64;
        let mean = image.pixels.iter().map(|value| f64::from(*value)).sum::<f64>() / image.pixels.len() as f64;
        let variance = image.pixels.iter().map(|value| (f64::from(*value) - mean).powi(2)).sum::<f64>() / image.pixels.len() as f64;
        grey = [grey[0] + mean, grey[1] + variance.sqrt()];
        let mut sorted = image.pixels;
        sorted.sort_unstable();
        for (sum, percent) in quantiles.iter_mut().zip([5, 25, 50, 75, 95]) {
            *sum += f64::from(sorted[sorted.len() * percent / 100]);
        }
        count += 1.0;
    }
    let kept: Vec<f64> = history
        .windows(11)
        .filter(|window| !window[0].is_empty())
        .map(|window| window[0].iter().filter(|id| window[10].contains(id)).count() as f64 / window[0].len() as f64)
        .collect();
    let ended: Vec<f64> = births.iter().filter(|(id, _)| !history.last().unwrap().contains(id)).map(|(_, length)| *length).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    Likeness {
        corners: corners / count,
        grey: grey.map(|sum| sum / count),
        quantiles: quantiles.map(|sum| sum / count),
        kept: mean(&kept),
        track: mean(&ended),
    }
}

/// Pictures of a folder in the order of their names, every `step`-th.
fn files(folder: &Path, step: usize) -> impl Iterator<Item = GrayImage> {
    let mut names: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    names.sort();
    names.into_iter().step_by(step).map(|name| {
        let image = image::open(name).unwrap().into_luma8();
        GrayImage { width: image.width() as usize, height: image.height() as usize, pixels: image.into_raw() }
    })
}

/// `LIBELLA_DATA=... cargo test -p libella-host likeness -- --ignored --nocapture`
#[test]
#[ignore = "renders for half a minute and needs LIBELLA_DATA"]
fn rendered_pictures_are_like_real_ones() {
    let Some(root) = std::env::var_os("LIBELLA_DATA").map(PathBuf::from).filter(|root| root.join("euroc").is_dir()) else {
        eprintln!("skipped: LIBELLA_DATA has no euroc");
        return;
    };
    let vicon = measure(files(&root.join("euroc/V1_01_keyframes/cam0/data"), 1), false);
    let hall = measure(files(&root.join("euroc/MH_01_easy/mav0/cam0/data"), 1).take(200), true);
    eprintln!("real V1_01 keyframes  {vicon:.1?}\nreal MH_01            {hall:.2?}");
    for (scene_seed, motion) in [(1, "V1_01_easy"), (2, "V1_02_medium"), (3, "V2_01_easy")] {
        let config = RealMotionConfig { start_s: 10.0, duration_s: 10.0, ..RealMotionConfig::default() };
        let source = MotionSource::Recorded(root.join("euroc_motion").join(motion), config);
        let flight = RenderedFlight::new(&source, &RenderConfig::default(), scene_seed, 1).unwrap();
        let renderer = flight.renderer(0).unwrap();
        let count = flight.flight.frame_stamps.len();
        let rendered = measure((0..count).map(|k| flight.image(&renderer, k).unwrap()), true);
        eprintln!("rendered {motion} scene {scene_seed}  {rendered:.2?}");
        assert!((0.5..2.0).contains(&(rendered.corners / vicon.corners)), "corners");
        assert!(
            (0.6..1.6).contains(&(rendered.grey[0] / vicon.grey[0])) && (0.5..1.6).contains(&(rendered.grey[1] / vicon.grey[1])),
            "grey"
        );
        assert!((0.6..1.6).contains(&(rendered.quantiles[2] / vicon.quantiles[2])), "median grey");
        assert!((0.6..1.6).contains(&(rendered.kept / hall.kept)) && (0.5..3.0).contains(&(rendered.track / hall.track)), "tracks");
    }
}

/// Half the width and height of a picture: means of four pixels.
fn halved(image: &GrayImage) -> image::GrayImage {
    let [width, height] = [image.width, image.height].map(|side| u32::try_from(side / 2).unwrap());
    image::GrayImage::from_fn(width, height, |x, y| {
        let at = |dx, dy| u32::from(image.pixels[(2 * y as usize + dy) * image.width + 2 * x as usize + dx]);
        image::Luma([u8::try_from((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1) + 2) / 4).unwrap()])
    })
}

/// Pictures in rows of three.
fn sheet(path: &Path, pictures: &[GrayImage]) {
    let (width, height, gap) = (376, 240, 4);
    let rows = i64::try_from(pictures.len().div_ceil(3)).unwrap();
    let size = [3 * (width + gap) - gap, rows * (height + gap) - gap].map(|side| u32::try_from(side).unwrap());
    let mut sheet = image::GrayImage::from_pixel(size[0], size[1], image::Luma([255]));
    for (place, picture) in (0..).zip(pictures) {
        image::imageops::replace(&mut sheet, &halved(picture), place % 3 * (width + gap), place / 3 * (height + gap));
    }
    sheet.save(path).unwrap();
    eprintln!("{}", path.display());
}

/// Pictures for the eye, in `LOOK` or else `target/look`: `rendered.png` of three rooms, and with `LIBELLA_DATA` `beside_real.png` with two
/// rows of real ones above: `cargo test -p libella-host contact_sheets -- --ignored --nocapture`
#[test]
#[ignore = "writes pictures for the eye"]
fn contact_sheets() {
    let folder = PathBuf::from(std::env::var_os("LOOK").unwrap_or("target/look".into()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut rendered = Vec::new();
    for room in 1..=3 {
        let source = MotionSource::parse("medium", 24.0).unwrap();
        let flight = RenderedFlight::new(&source, &RenderConfig::default(), room, room).unwrap();
        let renderer = flight.renderer(0).unwrap();
        rendered.extend([120, 280, 440].map(|index| flight.image(&renderer, index).unwrap()));
    }
    sheet(&folder.join("rendered.png"), &rendered);
    let Some(root) = std::env::var_os("LIBELLA_DATA").map(PathBuf::from).filter(|root| root.join("euroc").is_dir()) else {
        eprintln!("skipped: LIBELLA_DATA has no euroc");
        return;
    };
    let mut both: Vec<_> = files(&root.join("euroc/V1_01_keyframes/cam0/data"), 15).take(3).collect();
    both.extend(files(&root.join("euroc/MH_01_easy/mav0/cam0/data"), 110).take(3));
    both.extend(rendered);
    sheet(&folder.join("beside_real.png"), &both);
}
