//! The solver goes down, arrives, and does not stumble over bad numbers.

use std::boxed::Box;
use std::vec::Vec;

use super::world::{INVERSE_SIGMA, Recipe, SmallWorkspace, World, copy};
use crate::imu::NavState;
use crate::real::Real;
use crate::robust::kernel::Kernel;
use crate::solve::{SolveReport, cost, optimize};
use crate::window::NormalizedPoint;

fn solve<T: Real>(world: &mut World<T>, iterations: u8) -> SolveReport<T> {
    let mut workspace = Box::<SmallWorkspace<T>>::default();
    optimize(&mut world.window, &world.prior, &mut workspace, &world.settings, iterations)
}

fn cost_of<T: Real>(world: &World<T>) -> T {
    let mut workspace = Box::<SmallWorkspace<T>>::default();
    workspace.prepare(&world.window, &world.settings);
    cost(&world.window, &world.prior, &workspace, &world.settings)
}

fn states<T: Real>(world: &World<T>) -> Vec<NavState<T>> {
    world.window.frames.iter().map(|frame| frame.state).collect()
}

/// Largest difference of positions (m) and of rotations (rad).
fn apart<T: Real>(one: &[NavState<T>], other: &[NavState<T>]) -> (f64, f64) {
    let pairs = || one.iter().zip(other);
    let largest = |values: &mut dyn Iterator<Item = T>| values.map(|value| value.as_f64()).fold(0.0, f64::max);
    (
        largest(&mut pairs().map(|(a, b)| (a.position_in_world - b.position_in_world).norm())),
        largest(&mut pairs().map(|(a, b)| a.world_from_body.angle_to(&b.world_from_body))),
    )
}

fn arrives<T: Real>(seed: u64, bound: f64) {
    let mut world = World::<T>::new(&Recipe { seed, noise: 0.0, error: 0.5, ..Recipe::default() });
    let (start_m, start_rad) = apart(&states(&world), &world.truth);
    assert!(start_m > 0.05 && start_rad > 0.01, "it starts at the truth already");
    let report = solve(&mut world, 30);
    let (end_m, end_rad) = apart(&states(&world), &world.truth);
    assert!(end_m < bound && end_rad < bound, "seed {seed}: {end_m:.1e} m and {end_rad:.1e} rad off, {report:?}");
    for (landmark, truth) in world.window.landmarks.iter().zip(&world.inverse_depths) {
        let error = (landmark.inverse_depth / *truth - T::one()).as_f64().abs();
        assert!(error < 10.0 * bound, "seed {seed}: a depth is {error:.1e} off");
    }
}

#[test]
fn without_noise_it_arrives_at_the_truth() {
    for seed in 0..8 {
        arrives::<f64>(seed, 1e-6);
        // Corners are rounded to 1e-7 of the focal length, some 1e-6 m at the distance of the landmarks; whitened sums add to that.
        arrives::<f32>(seed, 2e-3);
    }
}

#[test]
fn the_cost_never_rises() {
    for seed in 0..20_u64 {
        let kernel = if seed.is_multiple_of(2) { Kernel::Quadratic } else { Kernel::huber(2.25) };
        let recipe = Recipe { seed, noise: 3.0, error: 0.3 * (seed % 5) as f64, kernel, ..Recipe::default() };
        let mut world = World::<f64>::new(&recipe);
        let mut last = cost_of(&world);
        for round in 0..6 {
            let report = solve(&mut world, 1);
            assert!((report.initial_cost - last).abs() <= 1e-9 * last, "seed {seed}, round {round}: the start is misreported");
            assert!(report.iterations <= 1 && report.accepted <= report.iterations);
            let found = cost_of(&world);
            assert!(found <= last * (1.0 + 1e-12), "seed {seed}, round {round}: {last} rose to {found}");
            assert!((report.final_cost - found).abs() <= 1e-9 * found, "seed {seed}, round {round}: the end is misreported");
            last = found;
        }
    }
}

/// At the minimum the mean cost is that of the noise: half of the redundancy.
#[test]
fn the_cost_at_the_minimum_is_that_of_the_noise() {
    let (mut total, mut redundancy, runs) = (0.0, 0.0, 40);
    for seed in 100..100 + runs {
        let mut world = World::<f64>::new(&Recipe { seed, noise: 1.0, error: 0.1, ..Recipe::default() });
        total += solve(&mut world, 20).final_cost;
        // Inertial residuals and prior are zero at the truth: what is random are the corners alone. Their part of the cost is at
        // most half their number less what their own landmarks explain, and at least half of what the unknowns cannot explain.
        let rows: usize = world.window.landmarks.iter().map(|landmark| 2 * landmark.observations() - 3).sum();
        redundancy += rows as f64;
    }
    let unknowns = (runs as f64) * (15.0 * 6.0);
    assert!(2.0 * total < redundancy + 3.0 * (2.0 * redundancy).sqrt(), "{total} of {redundancy}");
    assert!(2.0 * total > redundancy - unknowns - 3.0 * (2.0 * redundancy).sqrt(), "{total} of {redundancy}");
}

/// However wrong one corner is, its pull on the states is bounded; without a robust kernel it grows without bound.
#[test]
fn one_outlier_pulls_only_so_far() {
    let moved = |kernel: Kernel<f64>, sigmas: f64| {
        let mut clean = World::<f64>::new(&Recipe { seed: 3, error: 0.0, kernel, ..Recipe::default() });
        let mut spoilt = World { window: copy(&clean.window), ..World::new(&Recipe { seed: 3, error: 0.0, kernel, ..Recipe::default() }) };
        let landmark = &mut spoilt.window.landmarks[0];
        let (frame, point) = landmark.seen().last().map(|(frame, point)| (frame, *point)).unwrap();
        landmark.observe(frame, NormalizedPoint { x: point.x + sigmas / INVERSE_SIGMA, ..point });
        solve(&mut clean, 50);
        solve(&mut spoilt, 50);
        apart(&states(&spoilt), &states(&clean)).0
    };
    let huber = Kernel::huber(2.25);
    let (near, far) = (moved(huber, 3.0), moved(huber, 30.0));
    assert!(near > 0.0 && far < 1.5 * near, "{near:.1e} m at 3 sigma, {far:.1e} m at 30");
    let (near, far) = (moved(Kernel::Quadratic, 3.0), moved(Kernel::Quadratic, 30.0));
    assert!(far > 5.0 * near, "{near:.1e} m at 3 sigma, {far:.1e} m at 30, without a kernel");
}

/// A window with a number that is none: the solver returns, and touches nothing.
#[test]
fn numbers_that_are_none_do_not_spread() {
    for spoil in [f64::NAN, f64::INFINITY] {
        let mut world = World::<f64>::new(&Recipe::default());
        let landmark = &mut world.window.landmarks[5];
        let (frame, point) = landmark.seen().last().map(|(frame, point)| (frame, *point)).unwrap();
        landmark.observe(frame, NormalizedPoint { x: spoil, ..point });
        let before = states(&world);
        let report = solve(&mut world, 10);
        assert!(report.iterations <= 10);
        assert!(world.window.frames.iter().all(|frame| frame.state.is_finite()), "{spoil} spread to the states");
        assert_eq!(states(&world), before, "steps were taken on a cost of {spoil}");

        let mut world = World::<f64>::new(&Recipe::default());
        world.window.frames[2].state.velocity_in_world.x = spoil;
        solve(&mut world, 10);
        let finite = world.window.frames.iter().filter(|frame| frame.state.is_finite()).count();
        assert_eq!(finite, 5, "{spoil} spread from one frame to others");
    }
}

#[test]
fn few_frames_and_no_landmarks_are_no_trouble() {
    for frames in 0..3 {
        let mut world = World::<f64>::new(&Recipe::default());
        world.window.frames.truncate(frames);
        world.window.landmarks.clear();
        world.prior.frames = world.prior.frames.min(frames);
        let report = solve(&mut world, 10);
        assert!(report.final_cost.is_finite() && report.final_cost <= report.initial_cost);
    }
}

/// A landmark behind the camera costs a fixed amount, so that a step that puts it there is refused or not, but never free.
#[test]
fn points_behind_a_camera_are_charged() {
    let mut world = World::<f64>::new(&Recipe { noise: 0.0, error: 0.0, ..Recipe::default() });
    assert!(cost_of(&world) < 1e-6);
    let turned = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), core::f64::consts::PI);
    let mount = world.settings.body_from_camera.rotation;
    let newest = world.window.frames.len() - 1;
    let landmarks = world.window.landmarks.iter().filter(|landmark| landmark.is_seen_in(newest)).count();
    let state = &mut world.window.frames[newest].state;
    state.world_from_body = state.world_from_body * mount * turned * mount.inverse();
    assert!(cost_of(&world) >= 0.5 * 100.0 * landmarks as f64);
    assert!(solve(&mut world, 5).final_cost.is_finite());
}
