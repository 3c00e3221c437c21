//! Time of the image front end per image of 752×480 with room for 200 tracks (the texture yields 145), stage by stage.
//! Target: 2.5 ms for the whole at 200 tracks.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use libella_core::camera::{CameraModel, PinholeRadTan};
use libella_core::image::{ImageView, PyramidPair, pyramid_bytes};
use libella_core::track::detect::{Corner, DetectConfig, detect};
use libella_core::track::two_view::{BearingPair, TwoViewConfig, reject_outliers};
use libella_core::track::{FrontEnd, FrontEndConfig};
use nalgebra::{UnitQuaternion, Vector3};

const WIDTH: usize = 752;
const HEIGHT: usize = 480;
const BYTES: usize = pyramid_bytes(WIDTH, HEIGHT, 4);

fn hash(x: i32, y: i32, seed: u32) -> f64 {
    let mut h = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed.wrapping_mul(0xc2b2_ae3d);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    f64::from(h ^ (h >> 15)) / f64::from(u32::MAX) * 2.0 - 1.0
}

/// Value noise of three scales moved by `(dx, dy)` px, with white noise of 2 grey levels.
fn image(dx: f64, dy: f64, seed: u32) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(WIDTH * HEIGHT);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let mut sum = 128.0 + 2.0 * (0..3).map(|k| hash(x as i32, y as i32, seed + k)).sum::<f64>();
            for (scale, height, layer) in [(8.0, 40.0, 1), (19.0, 40.0, 2), (60.0, 30.0, 3)] {
                let (u, v) = ((x as f64 - dx) / scale, (y as f64 - dy) / scale);
                let (i, j) = (u.floor(), v.floor());
                let ease = |t: f64| t * t * (3.0 - 2.0 * t);
                let (s, t) = (ease(u - i), ease(v - j));
                let node = |di: i32, dj: i32| hash(i as i32 + di, j as i32 + dj, layer);
                sum += height * ((node(0, 0) * (1.0 - s) + node(1, 0) * s) * (1.0 - t) + (node(0, 1) * (1.0 - s) + node(1, 1) * s) * t);
            }
            pixels.push(sum.round().clamp(0.0, 255.0) as u8);
        }
    }
    pixels
}

fn frontend(criterion: &mut Criterion) {
    let (first, second) = (image(0.0, 0.0, 10), image(4.3, -2.6, 20));
    let (first, second) = (ImageView::new(&first, WIDTH, HEIGHT, WIDTH).unwrap(), ImageView::new(&second, WIDTH, HEIGHT, WIDTH).unwrap());
    let camera = CameraModel::PinholeRadTan(PinholeRadTan {
        size_px: (WIDTH as u32, HEIGHT as u32),
        focal_px: [458.654, 457.296],
        center_px: [367.215, 248.375],
        distortion: [-0.283, 0.0739, 0.0002, 0.0],
    });
    let rotation = Some(UnitQuaternion::<f64>::identity());
    let mut pyramids: Box<PyramidPair<BYTES>> = Box::default();
    let mut group = criterion.benchmark_group("frontend 752x480");
    group.sample_size(60);
    group.bench_function("pyramid of 4 levels", |b| b.iter(|| pyramids.push(black_box(&first), 4)));

    let mut fresh: Box<FrontEnd<200>> = Box::new(FrontEnd::new(FrontEndConfig::DEFAULT));
    pyramids.clear();
    let report = fresh.process(&first, &mut pyramids, &camera, rotation).unwrap();
    println!("{} tracks: the corners of the first image", report.detected);
    pyramids.push(&second, 4).unwrap();
    let mut front_end = fresh.clone();
    group.bench_function("flow with backward check", |b| {
        b.iter(|| {
            front_end.clone_from(&fresh);
            front_end.follow(&pyramids, &camera, rotation);
        });
    });
    println!("{} of {} followed", front_end.tracks().len(), report.detected);
    let followed = front_end.clone();
    group.bench_function("two-view check with undistortion", |b| {
        b.iter(|| {
            front_end.clone_from(&followed);
            front_end.verify(&camera, rotation)
        });
    });

    let mut pairs = [BearingPair::EMPTY; 200];
    for (k, pair) in pairs.iter_mut().enumerate() {
        let number = |n: u32| hash(k as i32, n as i32, 5) as f32;
        let point = Vector3::new(number(1) * 3.0, number(2) * 2.0, 4.0 + 2.0 * number(3));
        let outlier = if k % 5 == 0 { Vector3::new(number(4), number(5), 0.0) * 0.05 } else { Vector3::zeros() };
        *pair =
            BearingPair { rotated: point.normalize(), current: (point + Vector3::new(0.05, 0.01, 0.02)).normalize() + outlier, ..*pair };
    }
    group.bench_function("two-view, 20 % outliers", |b| b.iter(|| reject_outliers(&mut pairs, &TwoViewConfig::DEFAULT, 458.0, 0.006)));

    let config = DetectConfig { cell_px: 28, min_distance_px: 20.0, border_px: 12, min_score: 8.0, min_relative_score: 0.005 };
    let mut corners = [Corner::default(); 200];
    let level = pyramids.current(0).unwrap();
    group.bench_function("detection in an empty image", |b| {
        b.iter(|| detect(black_box(&level), &config, core::iter::empty(), 200, &mut corners));
    });
    let kept: Vec<[f32; 2]> = followed.tracks().iter().skip(followed.tracks().len() / 10).map(|track| track.pixel).collect();
    group.bench_function("detection of the tenth that is missing", |b| {
        b.iter(|| detect(black_box(&level), &config, kept.iter().copied(), 200 - kept.len(), &mut corners));
    });
    group.finish();
}

criterion_group!(benches, frontend);
criterion_main!(benches);
