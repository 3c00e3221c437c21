//! Taking the oldest frame out loses nothing but what is meant to be dropped.
//!
//! A landmark that the newest frame still sees is not marginalised: what the leaving frame saw of it is dropped, and it moves
//! to its next frame. The batch problem to compare with is the whole window without those observations.

use std::boxed::Box;
use std::vec::Vec;

use nalgebra::{DMatrix, DVector};

use super::dense::{Dense, dense, dense_step, schur_step};
use super::world::{Recipe, SmallPrior, SmallWindow, SmallWorkspace, World, copy, state_error};
use crate::imu::testing::Normal;
use crate::real::Real;
use crate::robust::kernel::Kernel;
use crate::solve::{Settings, marginalize_oldest};
use crate::window::Landmark;

fn marginalise<T: Real>(window: &mut SmallWindow<T>, prior: &mut SmallPrior<T>, settings: &Settings<T>) {
    let mut workspace = Box::<SmallWorkspace<T>>::default();
    let keyframes = window.frames.len() - 1;
    marginalize_oldest(window, prior, &mut workspace, settings, keyframes);
}

/// Whether a landmark is dissolved into the prior when frame 0 leaves.
fn leaves(landmark: &Landmark<f64, { super::world::FRAMES }>, newest: usize) -> bool {
    landmark.anchor() == 0 && !landmark.is_seen_in(newest)
}

/// The window before frame 0 left, without the observations that were dropped: every landmark that stayed is as it is `after`.
fn batch(before: &SmallWindow<f64>, after: &SmallWindow<f64>) -> SmallWindow<f64> {
    let newest = before.frames.len() - 1;
    let mut whole = copy(before);
    whole.landmarks.retain(|landmark| leaves(landmark, newest));
    // First estimates of the frames that the prior now speaks of.
    for (frame, kept) in whole.frames.iter_mut().skip(1).zip(&after.frames) {
        frame.linearization = kept.linearization;
    }
    for kept in &after.landmarks {
        let mut seen = kept.seen();
        let (first, point) = seen.next().unwrap();
        let mut landmark = Landmark::new(kept.track, first + 1, *point);
        for (frame, point) in seen {
            landmark.observe(frame + 1, *point);
        }
        (landmark.bearing, landmark.inverse_depth) = (kept.bearing, kept.inverse_depth);
        (landmark.active, landmark.depth_source, landmark.given) = (kept.active, kept.depth_source, kept.given);
        assert!(whole.landmarks.push(landmark).is_ok());
    }
    whole
}

/// Steps of the frames that remain, in standard deviations of the batch problem.
fn compare(
    before: &SmallWindow<f64>,
    prior_before: &SmallPrior<f64>,
    after: &SmallWindow<f64>,
    prior: &SmallPrior<f64>,
    settings: &Settings<f64>,
) -> f64 {
    let whole_window = batch(before, after);
    let whole = dense(&whole_window, prior_before, settings);
    let expected = dense_step(&whole);
    let mut reduced = copy(after);
    let workspace = schur_step(&mut reduced, prior, settings);
    let mut worst = 0.0_f64;
    for part in 0..5 {
        let (mut error, mut norm) = (0.0, 0.0);
        for (frame, step) in workspace.step.iter().enumerate().take(after.frames.len()) {
            for axis in 0..3 {
                let batch = expected[15 * (frame + 1) + 3 * part + axis];
                error += (step[3 * part + axis] - batch).powi(2);
                norm += batch * batch;
            }
        }
        worst = worst.max((error / norm).sqrt());
    }
    let newest = after.landmarks.iter().filter(|landmark| landmark.active).count();
    assert!(newest > 10, "only {newest} landmarks remain");
    worst
}

fn recipe(seed: u64) -> Recipe {
    let kernel = if seed.is_multiple_of(2) { Kernel::Quadratic } else { Kernel::huber(2.25) };
    Recipe { seed, frames: 6, kernel, ..Recipe::default() }
}

#[test]
fn marginalised_is_batch() {
    for seed in 0..6 {
        let world = World::<f64>::new(&recipe(seed));
        let (mut window, mut prior) = (copy(&world.window), world.prior.clone());
        let newest = window.frames.len() - 1;
        let leaving = window.landmarks.iter().filter(|landmark| leaves(landmark, newest)).count();
        marginalise(&mut window, &mut prior, &world.settings);
        assert!(leaving >= 5 && window.landmarks.len() == world.window.landmarks.len() - leaving);
        assert_eq!((window.frames.len(), prior.frames), (newest, newest - 1));
        let worst = compare(&world.window, &world.prior, &window, &prior, &world.settings);
        assert!(worst < 1e-6, "seed {seed}: steps differ by {worst:.1e}");
    }
}

/// Twice in a row, the states moved in between: the prior then stands at other states than it was made at.
#[test]
fn marginalised_twice_is_batch_at_the_same_first_estimates() {
    for seed in 0..6 {
        let mut world = World::<f64>::new(&recipe(seed));
        marginalise(&mut world.window, &mut world.prior, &world.settings);
        world.disturb(100 + seed, 0.1);
        let (mut window, mut prior) = (copy(&world.window), world.prior.clone());
        marginalise(&mut window, &mut prior, &world.settings);
        let mut before = copy(&world.window);
        // The leaving frame and the one that entered got their first estimates during the second marginalisation.
        for frame in before.frames.iter_mut().take(world.window.frames.len() - 1) {
            frame.linearization.get_or_insert(frame.state);
        }
        let worst = compare(&before, &world.prior, &window, &prior, &world.settings);
        assert!(worst < 1e-6, "seed {seed}: steps differ by {worst:.1e}");
    }
}

/// Rows of the dense system that touch frame 0 or a landmark that leaves with it.
fn leaving_rows(whole: &Dense, window: &SmallWindow<f64>) -> (DMatrix<f64>, DVector<f64>, Vec<usize>) {
    let newest = window.frames.len() - 1;
    let mut gone: Vec<usize> = (0..15).collect();
    for (landmark, column) in window.landmarks.iter().zip(&whole.landmarks) {
        gone.extend(column.filter(|_| leaves(landmark, newest)).into_iter().flat_map(|first| first..first + 3));
    }
    let rows: Vec<usize> = (0..whole.jacobian.nrows()).filter(|r| gone.iter().any(|c| whole.jacobian[(*r, *c)] != 0.0)).collect();
    let jacobian = DMatrix::from_fn(rows.len(), whole.jacobian.ncols(), |r, c| whole.jacobian[(rows[r], c)]);
    (jacobian, DVector::from_fn(rows.len(), |r, _| whole.residual[rows[r]]), gone)
}

/// The prior costs what the linearised factors cost once the leaving unknowns have adapted themselves.
#[test]
fn the_prior_costs_what_the_eliminated_factors_cost() {
    for seed in 0..4 {
        let world = World::<f64>::new(&recipe(seed));
        let (mut window, mut prior) = (copy(&world.window), world.prior.clone());
        marginalise(&mut window, &mut prior, &world.settings);
        let whole = dense(&batch(&world.window, &window), &world.prior, &world.settings);
        let whole_window = batch(&world.window, &window);
        let (jacobian, residual, gone) = leaving_rows(&whole, &whole_window);
        let leaving = DMatrix::from_fn(jacobian.nrows(), gone.len(), |r, c| jacobian[(r, gone[c])]);
        let svd = leaving.svd(true, false);
        let span = svd.u.unwrap();
        let mut normal = Normal(seed + 50);
        let mut step = DVector::<f64>::zeros(jacobian.ncols());
        let mut cost_at = |scale: f64| {
            let deltas: Vec<[f64; 15]> = (0..window.frames.len()).map(|_| state_error(&mut normal, scale)).collect();
            let mut moved = copy(&window);
            for (k, (frame, delta)) in moved.frames.iter_mut().zip(&deltas).enumerate() {
                frame.state = frame.linearization_point().retract(delta);
                step.as_mut_slice()[15 * (k + 1)..15 * (k + 2)].copy_from_slice(delta);
            }
            let rows = &jacobian * &step + &residual;
            // What the leaving unknowns can explain is no cost.
            let left = &rows - &span * (span.transpose() * &rows);
            (prior.cost(&moved.frames), left.norm_squared())
        };
        // Both are known up to one constant.
        let (at_first, expected_at_first) = cost_at(0.0);
        for _ in 0..5 {
            let (found, expected) = cost_at(0.3);
            let (found, expected) = (found - at_first, expected - expected_at_first);
            assert!((found - expected).abs() < 1e-7 * expected.abs(), "seed {seed}: {found} where {expected} is due");
        }
    }
}

/// Observations in frames that may not enter the prior are left out, and the landmark with them: nothing is used twice.
#[test]
fn recent_frames_keep_out_of_the_prior() {
    let world = World::<f64>::new(&recipe(2));
    let (mut window, mut prior) = (copy(&world.window), world.prior.clone());
    let mut workspace = Box::<SmallWorkspace<f64>>::default();
    marginalize_oldest(&mut window, &mut prior, &mut workspace, &world.settings, 3);
    assert_eq!(prior.frames, 2);
    assert!(window.frames.iter().enumerate().all(|(k, frame)| frame.linearization.is_some() == (k < 2)));
    assert!(window.landmarks.iter().all(|landmark| landmark.observations() > 0));
}

/// In single precision the prior says the same. The normal equations of these rows have a condition that f32 cannot hold.
#[test]
fn single_precision_gives_the_same_prior() {
    for seed in 0..6 {
        let (mut wide, mut narrow) = (World::<f64>::new(&recipe(seed)), World::<f32>::new(&recipe(seed)));
        for round in 0..2 {
            marginalise(&mut wide.window, &mut wide.prior, &wide.settings);
            marginalise(&mut narrow.window, &mut narrow.prior, &narrow.settings);
            assert_eq!(wide.prior.frames, narrow.prior.frames);
            let mut normal = Normal(seed + 90);
            for _ in 0..5 {
                let deltas: Vec<[f64; 15]> = wide.window.frames.iter().map(|_| state_error(&mut normal, 0.1)).collect();
                let (mut one, mut other) = (copy(&wide.window), copy(&narrow.window));
                for ((a, b), delta) in one.frames.iter_mut().zip(&mut other.frames).zip(&deltas) {
                    a.state = a.linearization_point().retract(delta);
                    b.state = b.linearization_point().retract(&delta.map(|value| value as f32));
                }
                let (wide_cost, narrow_cost) = (wide.prior.cost(&one.frames), f64::from(narrow.prior.cost(&other.frames)));
                assert!(
                    (narrow_cost - wide_cost).abs() < 2e-3 * wide_cost,
                    "seed {seed}, round {round}: {wide_cost} in f64, {narrow_cost} in f32"
                );
            }
        }
    }
}
