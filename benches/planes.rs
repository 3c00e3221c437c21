//! Planes in a room: the time of each solver alone on the same 5,000 points, and of all planes of 1,000 points.
//!
//! The points lie on 5 planes of a room of 5 m × 4 m × 2.6 m with 1 cm of noise, and what is missing to 5,000 is spread over the room. The
//! share `w` is that of the plane that is sought: the floor, and for vertical planes a wall. Targets on one core: 1 point at least 15
//! times and 2 points at least 3 times as fast as 3 points, 3 points at `w` = 0.2 within 0.42 ms, all planes of 1,000 points within 300 µs.
//! At `w` = 0.4 the first two are out of reach: there the numbers of draws are as 65 to 26 to 9, and the refinement is the same for all. The
//! third is met where the build may use 8 lanes (`-C target-cpu=x86-64-v3`), not with the 4 of the default target.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;
use std::time::Instant;

use criterion::{Criterion, criterion_group, criterion_main};
use libella_core::plane::fit::{FitConfig, along_wall, free, horizontal, vertical};
use libella_core::plane::{Detections, Sample, Samples, Source};
use libella_core::robust::ransac::Generator;
use nalgebra::Vector3;

const POINTS: usize = 5000;
const SIZE_M: [f32; 3] = [5.0, 4.0, 2.6];

fn normal_number(generator: &mut Generator) -> f32 {
    (0..12).map(|_| generator.unit::<f32>()).sum::<f32>() - 6.0
}

/// `share` of the points on the floor or (`of_wall`) on the wall `x = 0`, `side` of them on each other plane, the rest anywhere.
fn room_with(share: f64, side: f64, of_wall: bool, with_normals: bool, count: usize) -> Vec<Sample<f32>> {
    let mut generator = Generator::new(11);
    let main = (share * count as f64) as usize;
    let side = (side * count as f64) as usize;
    let order: [usize; 5] = if of_wall { [1, 0, 2, 3, 4] } else { [0, 1, 2, 3, 4] };
    let mut samples = Vec::with_capacity(count);
    for k in 0..count {
        let mut point = Vector3::from(SIZE_M.map(|size| size * generator.unit::<f32>()));
        let noise = 0.01 * normal_number(&mut generator);
        let plane = if k < main { Some(0) } else { Some(1 + (k - main) / side.max(1)).filter(|plane| *plane < 5) };
        let mut normal =
            Vector3::new(normal_number(&mut generator), normal_number(&mut generator), normal_number(&mut generator)).normalize();
        if let Some(plane) = plane {
            let (axis, at) = [(2, 0.0), (0, 0.0), (0, SIZE_M[0]), (1, 0.0), (1, SIZE_M[1])][order[plane]];
            point[axis] = at + noise;
            normal = Vector3::ith(axis, 1.0) + normal * 0.05;
        }
        let normal_in_world = with_normals.then_some(normal);
        samples.push(Sample { point_in_world: point, normal_in_world, source: Source::MapPoint });
    }
    // In any order.
    for k in (1..count).rev() {
        samples.swap(k, generator.below(k + 1));
    }
    samples
}

/// As many points on the other planes together as on the one that is sought.
fn room(share: f64, of_wall: bool, with_normals: bool, count: usize) -> Vec<Sample<f32>> {
    room_with(share, share / 4.0, of_wall, with_normals, count)
}

fn filled<const N: usize>(points: &[Sample<f32>], config: &FitConfig<f32>) -> Box<Samples<f32, N>> {
    let mut samples = Box::new(Samples::new(&Vector3::z_axis(), config.normal_tolerance_rad));
    for point in points {
        samples.push(point).unwrap();
    }
    samples
}

/// Time of a call, µs, and its number of draws: the median over seeds of the fastest of five repetitions.
fn timed(mut call: impl FnMut(&mut Generator) -> usize) -> (f64, usize) {
    let mut times: Vec<(f64, usize)> = (0..101)
        .map(|seed| {
            let repetition = |_| {
                let mut generator = Generator::new(seed);
                let start = Instant::now();
                let draws = black_box(call(&mut generator));
                (start.elapsed().as_secs_f64() * 1e6, draws)
            };
            (0..5).map(repetition).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
        })
        .collect();
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut draws: Vec<_> = times.iter().map(|time| time.1).collect();
    draws.sort_unstable();
    (times[50].0, draws[50])
}

fn ratios(with_normals: bool) {
    for share in [0.1, 0.2, 0.4] {
        let mut config = FitConfig::default();
        // What is sought has just about the least share.
        config.ransac.least_inlier_ratio = 0.9 * share as f32;
        let points = [false, true].map(|of_wall| room(share, of_wall, with_normals, POINTS));
        let [mut floor, mut wall] = points.each_ref().map(|points| filled::<POINTS>(points, &config));
        let three = timed(|g| free(&mut floor, &config, g).map_or(0, |fit| fit.draws));
        let two = timed(|g| vertical(&mut wall, &config, g).map_or(0, |fit| fit.draws));
        let on_wall = timed(|g| along_wall(&mut wall, &Vector3::x_axis(), &config, g).map_or(0, |fit| fit.draws));
        let one = timed(|g| horizontal(&mut floor, &config, g).map_or(0, |fit| fit.draws));
        print!("w {share}: 3 points {:.0} µs, {} draws", three.0, three.1);
        for (name, (time_us, draws)) in [("2 points", two), ("1 point on a wall", on_wall), ("1 point", one)] {
            print!(" | {name} {time_us:.1} µs, {draws} draws, {:.1} × faster", three.0 / time_us);
        }
        println!();
    }
}

fn planes(criterion: &mut Criterion) {
    println!("{POINTS} points, single precision, one solver and its refinement, median of 101 seeds; without normals:");
    ratios(false);
    println!("with normals:");
    ratios(true);

    let mut group = criterion.benchmark_group("planes");
    group.sample_size(60);
    let config = FitConfig::<f32>::default();
    for (name, with_normals) in [("all planes of 1000 points with normals", true), ("all planes of 1000 points without normals", false)] {
        let points = rooms_points(with_normals);
        let mut samples = filled::<1000>(&points, &config);
        let mut found = Detections::<f32, 16, 16>::default();
        let mut seed = 0;
        group.bench_function(name, |b| {
            b.iter(|| {
                seed += 1;
                samples.clear();
                for point in &points {
                    samples.push(black_box(point)).unwrap();
                }
                found.detect(&mut samples, None, &config, &mut Generator::new(seed));
            });
        });
        println!("{} planes found", found.len());
    }
}

/// 1,000 points: floor 30 %, four walls 15 % each, 10 % anywhere.
fn rooms_points(with_normals: bool) -> Vec<Sample<f32>> {
    room_with(0.3, 0.15, false, with_normals, 1000)
}

criterion_group!(benches, planes);
criterion_main!(benches);
