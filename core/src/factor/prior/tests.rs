use std::boxed::Box;

use nalgebra::{DMatrix, DVector};

use super::Prior;
use crate::imu::testing::{Motion, Normal};
use crate::imu::{ImuBias, Preintegration};
use crate::real::Real;
use crate::storage::blocks::{pairs, place, zero_block};
use crate::time::Timestamp;
use crate::window::Frame;

const FRAMES: usize = 4;
const PAIRS: usize = pairs(FRAMES);

/// A prior on the first three of four frames, at their first estimates but for position, velocity and biases.
fn example<T: Real>(seed: u64) -> (Box<Prior<T, FRAMES, PAIRS>>, [Frame<T>; FRAMES]) {
    let mut normal = Normal(seed);
    let mut prior = Box::new(Prior::<T, FRAMES, PAIRS> { frames: 3, ..Prior::default() });
    for (r, c) in (0..15).flat_map(|r| (r..15).map(move |c| (r, c))) {
        prior.head[r][c] = T::of(normal.draw());
    }
    prior.right_head = core::array::from_fn(|_| T::of(normal.draw()));
    for j in 1..3 {
        *prior.column_mut(j).0 = core::array::from_fn(|_| core::array::from_fn(|_| T::of(normal.draw())));
        for i in 1..=j {
            for (r, c) in (0..6).flat_map(|r| (0..6).map(move |c| (r, c))).filter(|(r, c)| i < j || r <= c) {
                prior.column_mut(j).1[i - 1][r][c] = T::of(normal.draw());
            }
        }
        prior.right[j] = core::array::from_fn(|_| T::of(normal.draw()));
    }
    let frames = core::array::from_fn(|k| {
        let state = Motion::lively().state(k as f64);
        let state = crate::imu::NavState {
            world_from_body: nalgebra::UnitQuaternion::new_normalize(state.world_from_body.coords.map(T::of).into()),
            position_in_world: state.position_in_world.map(T::of),
            velocity_in_world: state.velocity_in_world.map(T::of),
            bias: ImuBias { gyro_rad_s: state.bias.gyro_rad_s.map(T::of), accel_m_s2: state.bias.accel_m_s2.map(T::of) },
        };
        let delta: [T; 15] = core::array::from_fn(|i| if i < 3 { T::ZERO } else { T::of(0.1 * normal.draw()) });
        let mut frame = Frame::new(Timestamp::from_nanos(k as i64), state.retract(&delta), Preintegration::new(state.bias));
        frame.linearization = Some(state);
        frame
    });
    (prior, frames)
}

/// `H` and `b` of the frames as dense ones.
fn normal_equations(prior: &Prior<f64, FRAMES, PAIRS>, frames: &[Frame<f64>; FRAMES]) -> (DMatrix<f64>, DVector<f64>) {
    let (mut poses, mut couplings, mut rest) = ([zero_block(); PAIRS], [[[0.0; 6]; 9]; PAIRS], zero_block());
    let mut gradient = [[0.0; 15]; FRAMES];
    prior.add_to(frames, &mut poses, &mut couplings, &mut rest, &mut gradient);
    let entry = |r: usize, c: usize| {
        let (r, c) = if r / 15 >= c / 15 { (r, c) } else { (c, r) };
        let ((i, a), (j, b)) = ((r / 15, r % 15), (c / 15, c % 15));
        match (a.checked_sub(6), b.checked_sub(6)) {
            (None, None) => poses[place(i, j)][a][b],
            (None, Some(b)) => couplings[place(i, j)][b][a],
            (Some(a), None) if i == j => couplings[place(i, i)][a][b],
            (Some(a), Some(b)) if (i, j) == (0, 0) => rest[a][b],
            _ => 0.0,
        }
    };
    (DMatrix::from_fn(60, 60, entry), DVector::from_column_slice(gradient.as_flattened()))
}

fn moved(frames: &[Frame<f64>; FRAMES], delta: &DVector<f64>) -> [Frame<f64>; FRAMES] {
    let mut out = *frames;
    for (k, frame) in out.iter_mut().enumerate() {
        frame.state = frame.state.retract(&core::array::from_fn(|i| delta[15 * k + i]));
    }
    out
}

#[test]
fn gradient_and_hessian_are_those_of_the_cost() {
    for seed in 0..5 {
        let (prior, frames) = example::<f64>(seed);
        let (hessian, gradient) = normal_equations(&prior, &frames);
        let half_cost = |delta: &DVector<f64>| 0.5 * prior.cost(&moved(&frames, delta));
        let unit = |k: usize, size: f64| DVector::from_fn(60, |r, _| if r == k { size } else { 0.0 });
        // The cost is a quadratic: central differences are exact but for the curvature of rotations, which goes with the square of the step.
        let step = 1e-4;
        for k in 0..60 {
            let slope = (half_cost(&unit(k, step)) - half_cost(&unit(k, -step))) / (2.0 * step);
            assert!((slope - gradient[k]).abs() < 1e-6 * gradient.norm(), "unknown {k}: {slope} {}", gradient[k]);
            for l in (k..60).step_by(7) {
                let second = (half_cost(&(unit(k, step) + unit(l, step)))
                    - half_cost(&(unit(k, step) - unit(l, step)))
                    - half_cost(&(unit(l, step) - unit(k, step)))
                    + half_cost(&-(unit(k, step) + unit(l, step))))
                    / (4.0 * step * step);
                // Rotations about one point do not commute: their second derivative holds a share of the gradient.
                let scale = hessian.norm() + gradient.norm();
                let bound = if k / 15 == l / 15 && k % 15 < 3 && l % 15 < 3 { 0.2 } else { 1e-4 };
                assert!((second - hessian[(k, l)]).abs() < bound * scale, "unknowns {k} {l}: {second} {}", hessian[(k, l)]);
            }
        }
    }
}

#[test]
fn a_prior_of_one_number_by_hand() {
    let (_, frames) = example::<f64>(1);
    let mut prior = Prior::<f64, FRAMES, PAIRS> { frames: 1, ..Prior::default() };
    prior.head[3][3] = 2.0;
    prior.right_head[3] = -1.0;
    let mut frames = frames;
    frames[0].state = frames[0].linearization.unwrap();
    frames[0].state.position_in_world.x += 3.0;
    // (2 · 3 − 1)² = 25, slope 2 · 5, curvature 4.
    assert!((prior.cost(&frames) - 25.0).abs() < 1e-12);
    let (hessian, gradient) = normal_equations(&prior, &frames);
    assert!((gradient[3] - 10.0).abs() < 1e-12 && (gradient.norm() - 10.0).abs() < 1e-12);
    assert!((hessian[(3, 3)] - 4.0).abs() < 1e-12 && (hessian.norm() - 4.0).abs() < 1e-12);
}

#[test]
fn frames_beyond_the_prior_are_free() {
    let (prior, frames) = example::<f64>(3);
    let (hessian, gradient) = normal_equations(&prior, &frames);
    let total = prior.add_to(&frames, &mut [zero_block(); PAIRS], &mut [[[0.0; 6]; 9]; PAIRS], &mut zero_block(), &mut [[0.0; 15]; FRAMES]);
    assert_eq!(total.to_bits(), prior.cost(&frames).to_bits());
    assert!(hessian.rows(45, 15).iter().chain(gradient.rows(45, 15).iter()).all(|value| *value == 0.0));
    let mut other = frames;
    other[3].state.position_in_world.x += 100.0;
    assert_eq!(prior.cost(&frames).to_bits(), prior.cost(&other).to_bits());
    // And of the others all but the oldest are known by their poses alone.
    #[allow(clippy::needless_range_loop)] // k also names rows of the matrix
    for k in 1..3 {
        assert!(hessian.rows(15 * k + 6, 9).iter().chain(gradient.rows(15 * k + 6, 9).iter()).all(|value| *value == 0.0));
        other[k].state.velocity_in_world.x += 100.0;
        other[k].state.bias.gyro_rad_s.x += 100.0;
    }
    assert_eq!(prior.cost(&frames).to_bits(), prior.cost(&other).to_bits());
}

/// The first prior stands where it was set up; once settled it speaks of the first estimate, and costs the same.
#[test]
fn settling_keeps_the_cost() {
    let (_, mut frames) = example::<f64>(4);
    let mut prior = Prior::<f64, FRAMES, PAIRS> { frames: 1, ..Prior::default() };
    let mut normal = Normal(9);
    for r in 0..15 {
        for c in r..15 {
            prior.head[r][c] = normal.draw();
        }
    }
    let origin = Motion::lively().state(0.0);
    prior.origin = Some(origin);
    // Positions, velocities and biases are linear: exact. Rotations about one axis are, too.
    let along = |angle: f64| core::array::from_fn(|i| if i < 3 { angle * [0.6, 0.0, 0.8][i] } else { angle * i as f64 });
    frames[0].linearization = Some(origin.retract(&along(0.1)));
    frames[0].state = origin.retract(&along(0.1)).retract(&along(0.2));
    let before = prior.cost(&frames);
    prior.settle(&frames);
    assert!(prior.origin.is_none());
    assert!(before > 0.1 && (prior.cost(&frames) - before).abs() < 1e-10 * before);
    // Once is enough.
    prior.settle(&frames);
    assert!((prior.cost(&frames) - before).abs() < 1e-10 * before);
    prior.clear();
    assert_eq!((prior.cost(&frames), prior.frames), (0.0, 0));
}

#[test]
fn both_scalars_cost_the_same() {
    for seed in 0..5 {
        let ((wide, frames), (narrow, short)) = (example::<f64>(seed), example::<f32>(seed));
        let (wide, narrow) = (wide.cost(&frames), f64::from(narrow.cost(&short)));
        // Some 27 products a row, each rounded to 6e-8.
        assert!(wide > 1.0 && (narrow - wide).abs() < 1e-5 * wide, "{wide} {narrow}");
    }
}
