//! Preintegration of 20 samples (200 Hz, one image at 10 Hz), with covariance and bias Jacobians: target 250 ns per sample in f64.
//! The factor on top of it: whitening matrix once per integral, linearisation at most 5 us.
//! Read the figures on an idle machine: other work on the same core shows up in full.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use libella_core::factor::imu::{linearize, sqrt_information};
use libella_core::imu::{ImuBias, ImuNoise, ImuSample, NavState, Preintegration};
use libella_core::real::Real;
use libella_core::time::Timestamp;
use nalgebra::Vector3;

const SAMPLES: usize = 20;

fn samples<T: Real>() -> Vec<ImuSample<T>> {
    (0..=SAMPLES)
        .map(|k| {
            let t = k as f64 * 0.005;
            let of = |x: f64, y: f64, z: f64| Vector3::new(T::of(x), T::of(y), T::of(z));
            ImuSample {
                stamp: Timestamp::from_nanos(k as i64 * 5_000_000),
                gyro_rad_s: of((3.0 * t).sin(), 0.5 * (5.0 * t).cos(), -0.8),
                accel_m_s2: of((2.0 * t).cos(), 0.3, 9.8 + (7.0 * t).sin()),
            }
        })
        .collect()
}

fn integrate<T: Real>(noise: &ImuNoise<T>, samples: &[ImuSample<T>]) -> Preintegration<T> {
    let mut integral = Preintegration::new(ImuBias::default());
    for pair in samples.windows(2) {
        integral.integrate(noise, &pair[0], &pair[1]).unwrap();
    }
    integral
}

fn measure<T: Real>(criterion: &mut Criterion, scalar: &str) {
    let mut group = criterion.benchmark_group(format!("preintegration/{scalar}"));
    let (noise, samples) = (ImuNoise::<T>::adis16448(), samples::<T>());
    println!("size of Preintegration<{scalar}>: {} bytes", size_of::<Preintegration<T>>());

    group.throughput(Throughput::Elements(SAMPLES as u64));
    group.bench_function("integrate 20 samples", |b| b.iter(|| integrate(black_box(&noise), black_box(&samples))));

    group.throughput(Throughput::Elements(1));
    let whole = integrate(&noise, &samples);
    group.bench_function("append", |b| {
        b.iter(|| {
            let mut first = black_box(whole);
            first.append(black_box(&whole));
            first
        });
    });
    group.bench_function("sqrt_information", |b| b.iter(|| sqrt_information(black_box(&whole), T::of(1e-3))));
    let gravity = Vector3::new(T::ZERO, T::ZERO, T::of(-9.81));
    let whitening = sqrt_information(&whole, T::of(1e-3)).unwrap();
    let from = NavState::origin();
    let to = whole.predict(&from, &gravity);
    group.bench_function("linearize", |b| {
        b.iter(|| {
            let (from, to) = (black_box(&from), black_box(&to));
            linearize(black_box(&whole), &gravity, black_box(&whitening), from, to, from, to)
        });
    });
    group.finish();
}

fn both(criterion: &mut Criterion) {
    measure::<f64>(criterion, "f64");
    measure::<f32>(criterion, "f32");
}

criterion_group!(benches, both);
criterion_main!(benches);
