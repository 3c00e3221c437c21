//! Position and heading of the world are not observable, and no sequence of marginalisations makes them so.
//!
//! A turn `ψ` of the world about the vertical and a shift `t` move all states by
//! ```text
//! δφ = R_WBᵀ ẑ ψ     δp = ẑ × p ψ + t     δv = ẑ × v ψ     δb = 0
//! ```
//! With first-estimate Jacobians the four directions at the first estimates stay in the null space of the information, however
//! the states have moved since.

use std::boxed::Box;

use nalgebra::{DMatrix, DVector, Vector3};

use super::dense::{dense, dense_prior};
use super::world::{Recipe, SmallPrior, SmallWindow, SmallWorkspace, World};
use crate::imu::NavState;
use crate::solve::{assemble, cost, marginalize_oldest};
use crate::storage::blocks::place;

/// The four directions at the given states, 15 N × 4: heading, then position.
fn gauge<'a>(states: impl Iterator<Item = &'a NavState<f64>>) -> DMatrix<f64> {
    let rows: std::vec::Vec<[[f64; 4]; 15]> = states
        .map(|state| {
            let turn = state.world_from_body.inverse() * Vector3::z();
            let (shift, speed) = (Vector3::z().cross(&state.position_in_world), Vector3::z().cross(&state.velocity_in_world));
            let mut block = [[0.0; 4]; 15];
            for axis in 0..3 {
                (block[axis][0], block[3 + axis][0], block[6 + axis][0]) = (turn[axis], shift[axis], speed[axis]);
                block[3 + axis][1 + axis] = 1.0;
            }
            block
        })
        .collect();
    DMatrix::from_fn(15 * rows.len(), 4, |r, c| rows[r / 15][r % 15][c])
}

/// Marginalises three frames, the states moving by `error` in between, and gives the information along the gauge at the states that
/// `pick` chooses, in parts of what is known along the same directions when only one frame moves.
fn information(seed: u64, error: f64, pick: impl Fn(&crate::window::Frame<f64>) -> NavState<f64>) -> f64 {
    let mut world = World::<f64>::new(&Recipe { seed, frames: 7, ..Recipe::default() }).without_prior();
    for round in 0..3 {
        let mut workspace = Box::<SmallWorkspace<f64>>::default();
        let keyframes = world.window.frames.len() - 1;
        marginalize_oldest(&mut world.window, &mut world.prior, &mut workspace, &world.settings, keyframes);
        world.disturb(10 * seed + round, error);
    }
    let (root, _) = dense_prior(&world.window, &world.prior);
    let states: std::vec::Vec<_> = world.window.frames.iter().take(world.prior.frames).map(pick).collect();
    along(&root, &gauge(states.iter()))
}

/// `max ‖R n‖ / ‖R n₁‖` over the four directions, `n₁` the part of `n` in the newest frame alone.
fn along(root: &DMatrix<f64>, directions: &DMatrix<f64>) -> f64 {
    let mut worst = 0.0_f64;
    for direction in directions.column_iter() {
        let mut alone = DVector::zeros(direction.len());
        let last = direction.len() - 15;
        alone.rows_mut(last, 15).copy_from(&direction.rows(last, 15));
        worst = worst.max((root * direction).norm() / (root * alone).norm());
    }
    worst
}

#[test]
fn the_prior_knows_neither_position_nor_heading() {
    for seed in 0..4 {
        let found = information(seed, 0.2, |frame| *frame.linearization_point());
        assert!(found < 1e-8, "seed {seed}: {found:.1e}");
    }
}

/// The test above can fail: at states other than the first estimates the directions are others.
#[test]
fn the_directions_are_those_at_the_first_estimates() {
    for seed in 0..4 {
        let found = information(seed, 0.2, |frame| frame.state);
        assert!(found > 1e-4, "seed {seed}: {found:.1e}");
    }
}

/// What the solver sees of the whole window, prior and all, has the same null space.
#[test]
fn the_window_knows_neither_position_nor_heading() {
    for seed in 0..4 {
        let mut world = World::<f64>::new(&Recipe { seed, frames: 7, ..Recipe::default() }).without_prior();
        let mut workspace = Box::<SmallWorkspace<f64>>::default();
        marginalize_oldest(&mut world.window, &mut world.prior, &mut workspace, &world.settings, 4);
        world.disturb(20 + seed, 0.2);
        let whole = dense(&world.window, &world.prior, &world.settings);
        let states: std::vec::Vec<_> = world.window.frames.iter().map(|frame| *frame.linearization_point()).collect();
        let frames = gauge(states.iter());
        let mut directions = DMatrix::zeros(whole.jacobian.ncols(), 4);
        directions.rows_mut(0, frames.nrows()).copy_from(&frames);
        // Depths are relative to their anchors: they do not move with the world.
        for column in 0..4 {
            let direction = directions.column(column);
            let mut alone = DVector::zeros(direction.len());
            alone.rows_mut(frames.nrows() - 15, 15).copy_from(&frames.view((frames.nrows() - 15, column), (15, 1)));
            let share = (&whole.jacobian * direction).norm() / (&whole.jacobian * alone).norm();
            assert!(share < 1e-9, "seed {seed}, direction {column}: {share:.1e}");
        }
    }
}

/// A turn and a shift of the whole world, not only a small one, cost nothing where there is no prior.
#[test]
fn the_cost_does_not_see_the_place_and_heading_of_the_world() {
    let mut world = World::<f64>::new(&Recipe::default()).without_prior();
    let cost_of = |window: &SmallWindow<f64>, prior: &SmallPrior<f64>| {
        let mut workspace = Box::<SmallWorkspace<f64>>::default();
        workspace.prepare(window, &world.settings);
        let found = cost(window, prior, &workspace, &world.settings);
        assemble(window, prior, &mut workspace, &world.settings, 0.0);
        let poses = workspace.normal.parts().poses;
        (found, (0..window.frames.len()).map(|k| poses[place(k, k)][0][0]).sum::<f64>())
    };
    let (before, information) = cost_of(&world.window, &world.prior);
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 2.1);
    for frame in &mut world.window.frames {
        let state = &mut frame.state;
        state.world_from_body = turn * state.world_from_body;
        state.position_in_world = turn * state.position_in_world + Vector3::new(30.0, -7.0, 2.0);
        state.velocity_in_world = turn * state.velocity_in_world;
    }
    let (after, information_after) = cost_of(&world.window, &world.prior);
    assert!(before > 1.0 && (after - before).abs() < 1e-8 * before, "{before} became {after}");
    assert!((information_after - information).abs() < 1e-8 * information);
    // A tilt, on the other hand, is seen.
    let tilt = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.05);
    for frame in &mut world.window.frames {
        let state = &mut frame.state;
        state.world_from_body = tilt * state.world_from_body;
        state.position_in_world = tilt * state.position_in_world;
        state.velocity_in_world = tilt * state.velocity_in_world;
    }
    assert!(cost_of(&world.window, &world.prior).0 > after + 10.0);
}
