//! The front end on images whose motion is known: smooth random textures that can be sampled anywhere.

#![allow(clippy::unwrap_used)]

use std::boxed::Box;
use std::collections::BTreeSet;
use std::vec::Vec;

use nalgebra::{Matrix2x3, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;

use super::detect::{Corner, DetectConfig, detect};
use super::flow::{FlowConfig, FlowFailure, FlowWorkspace};
use super::two_view::{BearingPair, TwoViewConfig, reject_outliers};
use super::{FrontEnd, FrontEndConfig};
use crate::camera::Camera;
use crate::image::{ImageView, MAX_LEVELS, PyramidPair, pyramid_bytes};
use crate::lie::so3;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const BYTES: usize = pyramid_bytes(WIDTH, HEIGHT, 4);

/// A number in [−1, 1] that depends on its arguments only.
fn hash(x: i32, y: i32, seed: u32) -> f64 {
    let mut h = (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed.wrapping_mul(0xc2b2_ae3d);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    f64::from(h ^ (h >> 15)) / f64::from(u32::MAX) * 2.0 - 1.0
}

/// A texture that is defined everywhere: value noise of three scales, smoothly interpolated, in grey levels about 128.
fn texture(x: f64, y: f64) -> f64 {
    let mut sum = 128.0;
    for (scale, height, seed) in [(7.0, 50.0, 1), (17.0, 40.0, 2), (45.0, 30.0, 3)] {
        let (u, v) = (x / scale, y / scale);
        let (i, j) = (u.floor(), v.floor());
        let ease = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let (s, t) = (ease(u - i), ease(v - j));
        let node = |di: i32, dj: i32| hash(i as i32 + di, j as i32 + dj, seed);
        let upper = node(0, 0) * (1.0 - s) + node(1, 0) * s;
        let lower = node(0, 1) * (1.0 - s) + node(1, 1) * s;
        sum += height * (upper * (1.0 - t) + lower * t);
    }
    sum
}

/// An image of the texture through `texture_from_pixel`, with white noise.
fn render(texture_from_pixel: impl Fn(f64, f64) -> (f64, f64), gain: f64, offset: f64, noise: f64, seed: u32) -> Vec<u8> {
    let mut pixels = Vec::with_capacity(WIDTH * HEIGHT);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let (u, v) = texture_from_pixel(x as f64, y as f64);
            // The sum of three uniform numbers of variance 1/3 has variance 1.
            let white: f64 = (0..3).map(|k| hash(x as i32, y as i32, seed * 8 + k + 100)).sum();
            pixels.push((gain * texture(u, v) + offset + noise * white).round().clamp(0.0, 255.0) as u8);
        }
    }
    pixels
}

fn view(pixels: &[u8]) -> ImageView<'_> {
    ImageView::new(pixels, WIDTH, HEIGHT, WIDTH).unwrap()
}

fn pair(first: &[u8], second: &[u8]) -> Box<PyramidPair<BYTES>> {
    let mut pyramids = Box::new(PyramidPair::new());
    pyramids.push(&view(first), 4).unwrap();
    pyramids.push(&view(second), 4).unwrap();
    pyramids
}

/// RMS error of tracking a lattice of points, px, and the share that was found.
fn tracking_error(
    pyramids: &PyramidPair<BYTES>,
    truth: impl Fn(f64, f64) -> (f64, f64),
    start: impl Fn(f64, f64) -> (f64, f64),
) -> (f64, f64) {
    let mut flow = FlowWorkspace::<16>::default();
    let (mut squares, mut found, mut all) = (0.0, 0, 0);
    for y in (50..HEIGHT - 50).step_by(13) {
        for x in (50..WIDTH - 50).step_by(13) {
            let from = [x as f32 + 0.37, y as f32 - 0.21];
            let (sx, sy) = start(f64::from(from[0]), f64::from(from[1]));
            let (tx, ty) = truth(f64::from(from[0]), f64::from(from[1]));
            let levels = |level| Some((pyramids.previous(level)?, pyramids.current(level)?));
            all += 1;
            if let Ok(place) = flow.track(&FlowConfig::DEFAULT, pyramids.common_levels(), levels, from, [sx as f32, sy as f32]) {
                let error = (f64::from(place[0]) - tx).hypot(f64::from(place[1]) - ty);
                if error < 3.0 {
                    squares += error * error;
                    found += 1;
                }
            }
        }
    }
    ((squares / f64::from(found.max(1))).sqrt(), f64::from(found) / f64::from(all))
}

#[test]
fn a_shift_is_recovered_to_a_twentieth_of_a_pixel() {
    for (dx, dy) in [(0.0, 0.0), (0.5, 0.25), (-0.3, 0.8), (3.6, -2.3), (-9.45, 6.15)] {
        let first = render(|x, y| (x, y), 1.0, 0.0, 0.0, 1);
        let second = render(|x, y| (x - dx, y - dy), 1.0, 0.0, 0.0, 2);
        let (error, share) = tracking_error(&pair(&first, &second), |x, y| (x + dx, y + dy), |x, y| (x, y));
        std::println!("shift {dx} {dy}: rms {error:.4} px, found {share:.3}");
        assert!(error < 0.05 && share > 0.97, "shift {dx} {dy}: rms {error:.4} px, found {share:.3}");
    }
}

#[test]
fn rotation_scale_noise_and_exposure_cost_little() {
    // A warp that the model lacks may cost what it moves a pixel at the rms radius of the window, 5 px; white noise of σ costs
    // about σ √2 / √(Σ w² |g|²) = σ · 1.4 / (12 · 6) px on this texture (slope 6 per px), for which twice that is allowed; 0.04 px otherwise.
    let (cx, cy) = (160.0, 120.0);
    for (name, angle, scale, gain, offset, noise, bound) in [
        ("turn of 2 degrees", 0.035, 1.0, 1.0, 0.0, 0.0, 0.175),
        ("scale 3 %", 0.0, 1.03, 1.0, 0.0, 0.0, 0.15),
        ("gain 0.8, offset 15", 0.0, 1.0, 0.8, 15.0, 0.0, 0.04),
        ("noise 2", 0.0, 1.0, 1.0, 0.0, 2.0, 0.08),
        ("noise 5", 0.0, 1.0, 1.0, 0.0, 5.0, 0.20),
        ("all, noise 3", 0.02, 1.02, 1.2, -20.0, 3.0, 0.20),
    ] {
        let forward = move |x: f64, y: f64| {
            let (u, v) = (x - cx, y - cy);
            let (s, c) = (scale * f64::sin(angle), scale * f64::cos(angle));
            (c * u - s * v + cx + 1.3, s * u + c * v + cy - 0.6)
        };
        let backward = move |x: f64, y: f64| {
            let (u, v) = (x - cx - 1.3, y - cy + 0.6);
            let (s, c) = (-f64::sin(angle) / scale, f64::cos(angle) / scale);
            (c * u - s * v + cx, s * u + c * v + cy)
        };
        let first = render(|x, y| (x, y), 1.0, 0.0, noise, 3);
        let second = render(backward, gain, offset, noise, 4);
        let (error, share) = tracking_error(&pair(&first, &second), forward, |x, y| (x, y));
        std::println!("{name}: rms {error:.4} px, found {share:.3}");
        assert!(error < bound && share > 0.95, "{name}: rms {error:.4} px, found {share:.3}");
    }
}

#[test]
fn flat_and_outside_patches_are_refused() {
    let blank = [90_u8; WIDTH * HEIGHT];
    let pyramids = pair(&blank, &blank);
    let levels = |level| Some((pyramids.previous(level)?, pyramids.current(level)?));
    let mut flow = FlowWorkspace::<16>::default();
    let mut track = |from, to| flow.track(&FlowConfig::DEFAULT, 4, levels, from, to);
    assert_eq!(track([100.0, 100.0], [100.0, 100.0]), Err(FlowFailure::Flat));
    assert_eq!(track([3.0, 100.0], [100.0, 100.0]), Err(FlowFailure::Outside));
    assert_eq!(track([100.0, 100.0], [1e9, 100.0]), Err(FlowFailure::Outside));
    assert_eq!(track([100.0, 100.0], [f32::NAN, 100.0]), Err(FlowFailure::Outside));
}

const DETECT: DetectConfig = DetectConfig { cell_px: 24, min_distance_px: 15.0, border_px: 12, min_score: 8.0, min_relative_score: 0.005 };

#[test]
fn a_spot_is_found_where_it_is() {
    // Gaussian spots 40 px apart: by symmetry the score is highest at their centres.
    let (cx, cy, sigma) = (20.3, 19.8, 2.5_f64);
    let spot = |i: usize| {
        let (u, v) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
        let (u, v) = ((u - cx + 20.0).rem_euclid(40.0) - 20.0, (v - cy + 20.0).rem_euclid(40.0) - 20.0);
        (200.0 * (-(u * u + v * v) / (2.0 * sigma * sigma)).exp()).round() as u8
    };
    let pixels: Vec<u8> = (0..WIDTH * HEIGHT).map(spot).collect();
    let pyramids = pair(&pixels, &pixels);
    let mut corners = [Corner::default(); 128];
    let found = detect(&pyramids.current(0).unwrap(), &DETECT, core::iter::empty(), 128, &mut corners);
    assert_eq!(found, 8 * 6);
    for corner in &corners[..found] {
        let (x, y) = (f64::from(corner.pixel[0]), f64::from(corner.pixel[1]));
        let (dx, dy) = ((x - cx + 20.0).rem_euclid(40.0) - 20.0, (y - cy + 20.0).rem_euclid(40.0) - 20.0);
        assert!(dx.hypot(dy) < 0.15, "{corner:?} is off by {dx:.3} {dy:.3}");
    }
}

#[test]
fn corners_keep_their_distance_and_blank_or_noisy_images_have_none() {
    let first = render(|x, y| (x, y), 1.0, 0.0, 0.0, 1);
    let pyramids = pair(&first, &first);
    let level = pyramids.current(0).unwrap();
    let occupied = [[60.0_f32, 60.0], [200.5, 120.25]];
    let mut corners = [Corner::default(); 256];
    let found = detect(&level, &DETECT, occupied.into_iter(), 256, &mut corners);
    assert!(found > 40, "{found}");
    let all: Vec<[f32; 2]> = occupied.into_iter().chain(corners[..found].iter().map(|corner| corner.pixel)).collect();
    for (i, a) in all.iter().enumerate() {
        for b in &all[..i] {
            // Refinement moves each by half a pixel at most, along each axis.
            assert!((a[0] - b[0]).hypot(a[1] - b[1]) > DETECT.min_distance_px - 1.5);
        }
    }
    assert!(corners[..found].windows(2).all(|two| two[0].score >= two[1].score), "best first");
    let few = detect(&level, &DETECT, occupied.into_iter(), 7, &mut corners);
    assert_eq!(few, 7);

    let blank = [0_u8; WIDTH * HEIGHT];
    let noise: Vec<u8> = (0..WIDTH * HEIGHT).map(|i| (128.0 + 3.0 * hash(i as i32, 0, 9)).round() as u8).collect();
    for pixels in [&blank[..], &noise] {
        let pyramids = pair(pixels, pixels);
        assert_eq!(detect(&pyramids.current(0).unwrap(), &DETECT, core::iter::empty(), 256, &mut corners), 0);
    }
}

/// Pairs of a random scene seen before and after a motion; every `outlier_every`-th is moved by 5 to 40 px.
fn scene(rotation_error: Vector3<f64>, translation: Vector3<f64>, outlier_every: usize, noise_px: f64) -> (Vec<BearingPair>, Vec<bool>) {
    let focal = 450.0;
    (0..200)
        .map(|k| {
            let number = |n: u32| hash(k as i32, n as i32, 77);
            let depth = 2.0 + 3.0 * (number(0) + 1.0);
            let point = Vector3::new(number(1) * 0.7 * depth, number(2) * 0.45 * depth, depth);
            let is_outlier = k % outlier_every == 0;
            let mut current = (point + translation).normalize();
            let angle = number(3) * 3.0;
            let length = (22.5 + 17.5 * number(4)) / focal;
            let shift = if is_outlier { Vector3::new(angle.cos() * length, angle.sin() * length, 0.0) } else { Vector3::zeros() };
            let noise = Vector3::new(number(5) + number(6) + number(7), number(8) + number(9) + number(10), 0.0) * (noise_px / focal);
            current = (current + shift + noise).normalize();
            let rotated = so3::exp(&rotation_error) * point.normalize();
            (BearingPair { rotated: rotated.cast(), current: current.cast(), is_inlier: false }, is_outlier)
        })
        .unzip()
}

#[test]
fn two_views_keep_the_static_and_reject_the_moving() {
    let none = Vector3::zeros();
    // 0.08 rad/s over 50 ms about an oblique axis: 1.8 px.
    let bias = Vector3::new(0.6, 0.64, 0.48) * 0.004;
    for (name, error, translation, sigma) in [
        ("sideways", none, Vector3::new(0.06, 0.01, 0.0), 1e-4),
        ("forwards", none, Vector3::new(0.01, 0.0, -0.08), 1e-4),
        ("sideways, biased gyro", bias, Vector3::new(0.06, 0.01, 0.0), 0.006),
        ("forwards, biased gyro", bias, Vector3::new(0.01, 0.0, -0.08), 0.006),
        ("pure rotation", none, none, 1e-4),
        ("pure rotation, biased gyro", bias, none, 0.006),
        ("no gyro", Vector3::new(0.01, -0.03, 0.02), Vector3::new(0.03, 0.03, 0.03), 0.05),
    ] {
        let (mut pairs, is_outlier) = scene(error, translation, 3, 0.2);
        let motion = reject_outliers(&mut pairs, &TwoViewConfig::DEFAULT, 450.0, sigma).unwrap();
        let count =
            |outlier: bool, inlier: bool| pairs.iter().zip(&is_outlier).filter(|(p, o)| **o == outlier && p.is_inlier == inlier).count();
        let (kept, lost, missed, caught) = (count(false, true), count(false, false), count(true, true), count(true, false));
        std::println!("{name}: static kept {kept} lost {lost}; moving missed {missed} caught {caught}; {motion:?}");
        assert!(lost * 50 <= kept, "{name}: {lost} of {} static points rejected", kept + lost);
        // An outlier that slides along its epipolar line cannot be told: 1 px of 5..40 px in a random direction is about 4 %, and
        // in a pure rotation the sampling may choose the line.
        assert!(missed * 5 <= caught, "{name}: {missed} of {} moving points kept", missed + caught);
        if translation.norm() > 0.0 && error.norm() == 0.0 {
            assert!(motion.direction.dot(&translation.normalize().cast()).abs() > 0.99, "{name}: {:?}", motion.direction);
        }
    }
}

#[test]
fn two_views_that_agree_on_nothing_reject_nothing() {
    let (mut pairs, _) = scene(Vector3::zeros(), Vector3::new(0.05, 0.0, 0.0), 1, 0.2);
    if reject_outliers(&mut pairs, &TwoViewConfig::DEFAULT, 450.0, 1e-4).is_none() {
        assert!(pairs.iter().all(|pair| pair.is_inlier));
    }
    let mut few = [BearingPair::EMPTY; 3];
    assert!(reject_outliers(&mut few, &TwoViewConfig::DEFAULT, 450.0, 1e-4).is_none());
    assert!(few.iter().all(|pair| pair.is_inlier));
    let mut broken = [BearingPair { current: Vector3::new(f32::NAN, 0.0, 0.0), ..BearingPair::EMPTY }; 20];
    reject_outliers(&mut broken, &TwoViewConfig::DEFAULT, 450.0, 1e-4);
}

/// A pinhole without distortion.
struct Pinhole;

impl Camera<f64> for Pinhole {
    fn project(&self, p: &Vector3<f64>) -> Option<Vector2<f64>> {
        (p.z > 0.0).then(|| Vector2::new(300.0 * p.x / p.z + 160.0, 300.0 * p.y / p.z + 120.0))
    }
    fn project_with_jacobian(&self, _: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        None
    }
    fn unproject(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        Some(Vector3::new((pixel.x - 160.0) / 300.0, (pixel.y - 120.0) / 300.0, 1.0).normalize())
    }
    fn focal_px(&self) -> f64 {
        300.0
    }
    fn size_px(&self) -> (u32, u32) {
        (WIDTH as u32, HEIGHT as u32)
    }
}

/// What the pinhole sees of a texture on the sphere around it (on the tangent plane of its first direction).
fn turned(world_from_camera: UnitQuaternion<f64>) -> Vec<u8> {
    render(
        |x, y| {
            let ray = world_from_camera * Vector3::new((x - 160.0) / 300.0, (y - 120.0) / 300.0, 1.0);
            (300.0 * ray.x / ray.z + 160.0, 300.0 * ray.y / ray.z + 120.0)
        },
        1.0,
        0.0,
        1.0,
        6,
    )
}

fn small_front_end() -> (Box<FrontEnd<100>>, Box<PyramidPair<BYTES>>) {
    (Box::new(FrontEnd::new(FrontEndConfig::for_image(WIDTH, HEIGHT, 100))), Box::default())
}

#[test]
fn the_predicted_rotation_carries_large_shifts() {
    // 0.15 rad are 45 px, far beyond the reach of the pyramid alone.
    let current_from_previous = so3::exp(&Vector3::new(0.02, 0.15, 0.02));
    let (first, second) = (turned(UnitQuaternion::identity()), turned(current_from_previous.inverse()));
    let mut tracked = [0, 0];
    let mut visible = 0;
    for (count, rotation) in tracked.iter_mut().zip([Some(current_from_previous), None]) {
        let (mut front_end, mut pyramids) = small_front_end();
        front_end.process(&view(&first), &mut pyramids, &Pinhole, Some(UnitQuaternion::identity())).unwrap();
        let before: Vec<_> = front_end.tracks().to_vec();
        let report = front_end.process(&view(&second), &mut pyramids, &Pinhole, rotation).unwrap();
        assert_eq!(report.tracked + report.lost + report.rejected, before.len());
        visible = 0;
        for old in &before {
            let ray = current_from_previous * Pinhole.unproject(&Vector2::new(old.pixel[0], old.pixel[1]).cast()).unwrap();
            let truth = Pinhole.project(&ray).unwrap();
            let inside = |coordinate: f64, size: usize| coordinate > 12.0 && coordinate < size as f64 - 12.0;
            visible += usize::from(inside(truth.x, WIDTH) && inside(truth.y, HEIGHT));
            let found = front_end.tracks().iter().find(|track| track.id == old.id);
            *count += usize::from(found.is_some_and(|new| (truth - Vector2::new(new.pixel[0], new.pixel[1]).cast()).norm() < 0.5));
        }
    }
    std::println!("of {visible} visible: with the rotation {} tracks, without {}", tracked[0], tracked[1]);
    assert!(tracked[0] * 10 >= visible * 9 && tracked[1] * 3 < tracked[0], "{tracked:?} of {visible}");
}

#[test]
fn a_sequence_with_a_black_gap_recovers_under_new_names() {
    let (mut front_end, mut pyramids) = small_front_end();
    let mut seen: BTreeSet<u32> = BTreeSet::new();
    let mut last: BTreeSet<u32> = BTreeSet::new();
    let black = [0_u8; WIDTH * HEIGHT];
    let turn = so3::exp(&Vector3::new(0.0, 0.01, 0.0));
    let mut world_from_camera = UnitQuaternion::identity();
    for k in 0..16 {
        let image = if (6..9).contains(&k) { black.to_vec() } else { turned(world_from_camera) };
        let report = front_end.process(&view(&image), &mut pyramids, &Pinhole, Some(turn.inverse())).unwrap();
        let ids: BTreeSet<u32> = front_end.observations::<f64>().map(|observation| observation.track.0).collect();
        assert_eq!(ids.len(), front_end.tracks().len(), "ids are distinct");
        for id in &ids {
            assert!(last.contains(id) || !seen.contains(id), "id {id} came back");
        }
        assert_eq!(ids.len(), report.tracked + report.detected);
        match k {
            6..=8 => assert!(ids.is_empty(), "nothing to see in the dark"),
            1..=5 | 10.. => assert!(report.tracked > 45, "image {k}: {report:?}"),
            _ => assert!(report.detected > 45, "image {k}: {report:?}"),
        }
        seen.extend(&ids);
        last = ids;
        world_from_camera *= turn;
    }
    front_end.reset();
    assert_eq!(front_end.observations::<f32>().len(), 0);
}

#[test]
fn a_repeated_image_moves_nothing() {
    let image = turned(UnitQuaternion::identity());
    let (mut front_end, mut pyramids) = small_front_end();
    front_end.process(&view(&image), &mut pyramids, &Pinhole, None).unwrap();
    let before: Vec<_> = front_end.tracks().to_vec();
    for _ in 0..3 {
        let report = front_end.process(&view(&image), &mut pyramids, &Pinhole, None).unwrap();
        assert_eq!((report.lost, report.rejected), (0, 0));
    }
    for (old, new) in before.iter().zip(front_end.tracks()) {
        assert_eq!(old.id, new.id);
        assert!((old.pixel[0] - new.pixel[0]).hypot(old.pixel[1] - new.pixel[1]) < 1e-3);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_panics_on_any_image(
        sizes in prop::collection::vec((1_usize..150, 1_usize..120, 0_usize..4), 2..5),
        pixels in prop::collection::vec(any::<u8>(), 64),
        turn in -3.2_f64..3.2,
        blocks in 1_usize..20,
    ) {
        let mut front_end: Box<FrontEnd<30, 12>> = Box::new(FrontEnd::new(FrontEndConfig::for_image(150, 120, 30)));
        let mut pyramids: Box<PyramidPair<{ 150 * 120 }>> = Box::default();
        for (width, height, repeats) in sizes {
            let image: Vec<u8> = (0..width * height).map(|i| pixels[((i % width) / blocks + 7 * ((i / width) / blocks)) % 64]).collect();
            for _ in 0..=repeats {
                let view = ImageView::new(&image, width, height, width).unwrap();
                let report = front_end
                    .process(&view, &mut pyramids, &Pinhole, Some(so3::exp(&Vector3::new(turn, 0.3 * turn, -turn))))
                    .unwrap();
                prop_assert!(report.tracked + report.detected <= 30);
                for track in front_end.tracks() {
                    prop_assert!(track.pixel[0] >= 0.0 && track.pixel[0] < width as f32);
                    prop_assert!(track.pixel[1] >= 0.0 && track.pixel[1] < height as f32);
                }
            }
        }
        prop_assert!(pyramids.current(MAX_LEVELS).is_none());
    }
}
