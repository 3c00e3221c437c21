//! A whole image of 752×480 with up to 200 tracks and a window of 12 frames: detection, tracking and solution on one core, along a
//! simulated flight. Target: 6 ms in f64, of which tracking 2.5 ms.
//! Read the figures on an idle machine: other work on the same core shows up in full.
#![allow(missing_docs, clippy::unwrap_used)]

use std::time::{Duration, Instant};

use criterion::{Criterion, criterion_group, criterion_main};
use libella_core::camera::CameraModel;
use libella_core::estimator::{EstimatorConfig, Health, StepBudget};
use libella_core::image::{ImageView, PyramidPair, pyramid_bytes};
use libella_core::imu::ImuSample;
use libella_core::profile::Desktop;
use libella_core::real::Real;
use libella_core::time::Timestamp;
use libella_host::sim::{AnalyticConfig, ImuConfig, MotionKind, MotionSource, RenderConfig, RenderedFlight, euroc};
use nalgebra::Isometry3;

const WIDTH: usize = 752;
const HEIGHT: usize = 480;
const IMAGES: usize = 200;

/// The data of ten seconds of flight.
struct Flight {
    images: Vec<(Timestamp, Vec<u8>)>,
    imu: Vec<ImuSample<f64>>,
}

impl Flight {
    fn render() -> Self {
        let motion = MotionSource::Analytic(
            AnalyticConfig { kind: MotionKind::Medium, duration_s: 10.5, ..AnalyticConfig::default() },
            ImuConfig::default(),
        );
        let flight = RenderedFlight::new(&motion, &RenderConfig::default(), 1, 1).unwrap();
        let renderer = flight.renderer(0).unwrap();
        let images = (0..IMAGES).map(|i| (flight.flight.frame_stamps[i], flight.image(&renderer, i).unwrap().pixels)).collect();
        drop(renderer);
        Self { images, imu: flight.flight.imu.clone() }
    }
}

/// Plays a flight over and over; what comes before the window is full is not timed.
struct Player<'a, T: Real> {
    flight: &'a Flight,
    estimator: Box<Desktop<T>>,
    pyramids: Box<PyramidPair<{ pyramid_bytes(WIDTH, HEIGHT, 4) }>>,
    image: usize,
    sample: usize,
}

impl<'a, T: Real> Player<'a, T> {
    fn new(flight: &'a Flight) -> Self {
        Self { flight, estimator: Self::estimator(), pyramids: Box::default(), image: 0, sample: 0 }
    }

    fn estimator() -> Box<Desktop<T>> {
        let camera: CameraModel<T> = euroc::camera(0).cast();
        let body_from_camera = nalgebra::convert::<_, Isometry3<f64>>(euroc::body_from_camera(0)).cast();
        Box::new(Desktop::new(EstimatorConfig::default(), camera, body_from_camera))
    }

    /// Times of tracking and of the step on the next image, and whether it counts.
    fn next(&mut self) -> (Duration, Duration, bool) {
        if self.image == self.flight.images.len() {
            (self.estimator, self.image, self.sample) = (Self::estimator(), 0, 0);
        }
        let (stamp, pixels) = &self.flight.images[self.image];
        self.image += 1;
        while let Some(sample) =
            self.flight.imu.get(self.sample).filter(|_| self.sample == 0 || self.flight.imu[self.sample - 1].stamp < *stamp)
        {
            let _ = self.estimator.push_imu(ImuSample {
                stamp: sample.stamp,
                gyro_rad_s: sample.gyro_rad_s.map(T::of),
                accel_m_s2: sample.accel_m_s2.map(T::of),
            });
            self.sample += 1;
        }
        let counts = self.estimator.health() == Health::Tracking && self.estimator.window().frames.len() >= 10;
        let view = ImageView::new(pixels, WIDTH, HEIGHT, WIDTH).unwrap();
        let start = Instant::now();
        let taken = self.estimator.push_image(*stamp, &view, &mut self.pyramids);
        let tracked = Instant::now();
        self.estimator.step(StepBudget::default());
        (tracked - start, tracked.elapsed(), counts && taken.is_ok())
    }

    /// The sum of `part` over as many images as asked for.
    fn play(&mut self, images: u64, part: impl Fn(Duration, Duration) -> Duration) -> Duration {
        let (mut sum, mut left) = (Duration::ZERO, images);
        while left > 0 {
            let (track, step, counts) = self.next();
            if counts {
                sum += part(track, step);
                left -= 1;
            }
        }
        sum
    }
}

fn measure<T: Real>(criterion: &mut Criterion, flight: &Flight, scalar: &str) {
    let mut player = Player::<T>::new(flight);
    let (mut tracks, mut frames, mut images) = (0, 0, 0);
    for _ in 0..flight.images.len() {
        if player.next().2 {
            tracks += player.estimator.report().tracked;
            frames += player.estimator.window().frames.len();
            images += 1;
        }
    }
    assert!(
        images > 0,
        "the flight never filled the window: {:?}, {} frames",
        player.estimator.health(),
        player.estimator.window().frames.len()
    );
    println!("{scalar}: {images} images, on average {} solved tracks and {} frames", tracks / images, frames / images);
    let mut group = criterion.benchmark_group(format!("frame/{scalar}/752x480"));
    group.sample_size(20);
    group.bench_function("detect and track", |b| b.iter_custom(|images| player.play(images, |track, _| track)));
    group.bench_function("solve and slide", |b| b.iter_custom(|images| player.play(images, |_, step| step)));
    group.bench_function("whole image", |b| b.iter_custom(|images| player.play(images, |track, step| track + step)));
    group.finish();
}

fn both(criterion: &mut Criterion) {
    let flight = Flight::render();
    measure::<f64>(criterion, &flight, "f64");
    measure::<f32>(criterion, &flight, "f32");
}

criterion_group!(benches, both);
criterion_main!(benches);
