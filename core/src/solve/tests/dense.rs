//! The reduced normal equations and the step that follows are those of the whole system of frames and landmarks.

use std::boxed::Box;
use std::vec::Vec;

use nalgebra::{DMatrix, DVector, Matrix6, RowVector6};

use super::world::{Recipe, SmallPrior, SmallWindow, SmallWorkspace, World};
use crate::factor::{imu, reprojection};
use crate::robust::kernel::Kernel;
use crate::solve::point::FLOOR;
use crate::solve::{Settings, assemble, back_substitute, chain, cost, newest_bias_variances, optimize};
use crate::storage::blocks::place;

/// Rows of all factors as one matrix; unknowns are the frames, 15 each, then the active landmarks, `x, y, λ`.
pub struct Dense {
    pub jacobian: DMatrix<f64>,
    pub residual: DVector<f64>,
    pub frames: usize,
    /// First unknown of each landmark, by its place in the window.
    pub landmarks: Vec<Option<usize>>,
}

impl Dense {
    /// `(H, b)` over frames and landmarks.
    pub fn normal_equations(&self) -> (DMatrix<f64>, DVector<f64>) {
        let mut hessian = self.jacobian.transpose() * &self.jacobian;
        for k in 15 * self.frames..hessian.nrows() {
            hessian[(k, k)] += FLOOR;
        }
        (hessian, self.jacobian.transpose() * &self.residual)
    }
}

/// The prior as a dense `(R, R δ + d)` over its own frames, 15 columns each: rows for the oldest frame, then for each other pose.
pub fn dense_prior(window: &SmallWindow<f64>, prior: &SmallPrior<f64>) -> (DMatrix<f64>, DVector<f64>) {
    let n = 15 * prior.frames;
    let rows = if prior.frames == 0 { 0 } else { 9 + 6 * prior.frames };
    let root = DMatrix::from_fn(rows, n, |r, c| match (r.checked_sub(15), c / 15, c % 15) {
        (None, 0, c) => prior.head[r][c],
        (None, j, c) if c < 6 => prior.column(j).0[r][c],
        (Some(below), j, c) if c < 6 && below / 6 < j => prior.column(j).1[below / 6][below % 6][c],
        _ => 0.0,
    });
    let delta = DVector::from_fn(n, |r, _| {
        let frame = &window.frames[r / 15];
        frame.state.local(prior.origin.as_ref().unwrap_or(frame.linearization_point()))[r % 15]
    });
    let right = DVector::from_fn(rows, |r, _| match r.checked_sub(15) {
        None => prior.right_head[r],
        Some(below) => prior.right[below / 6 + 1][below % 6],
    });
    (root.clone(), root * delta + right)
}

/// Linearises every factor where the solver does.
pub fn dense(window: &SmallWindow<f64>, prior: &SmallPrior<f64>, settings: &Settings<f64>) -> Dense {
    let frames = window.frames.len();
    let mut workspace = Box::<SmallWorkspace<f64>>::default();
    workspace.prepare(window, settings);
    let mut landmarks = Vec::new();
    let mut columns = 15 * frames;
    for landmark in &window.landmarks {
        landmarks.push(landmark.active.then_some(columns));
        columns += 3 * usize::from(landmark.active);
    }
    let mut rows: Vec<(DVector<f64>, f64)> = Vec::new();
    let (root, right) = dense_prior(window, prior);
    for (row, value) in root.row_iter().zip(right.iter()) {
        let mut whole = DVector::zeros(columns);
        for (c, entry) in row.iter().enumerate() {
            whole[c] = *entry;
        }
        rows.push((whole, *value));
    }
    for to in 1..frames {
        let (from_frame, to_frame) = (&window.frames[to - 1], &window.frames[to]);
        let weight = imu::sqrt_information(&to_frame.from_previous, settings.position_jitter_m).unwrap();
        let linear = imu::linearize(
            &to_frame.from_previous,
            &settings.gravity_in_world,
            &weight,
            &from_frame.state,
            &to_frame.state,
            from_frame.linearization_point(),
            to_frame.linearization_point(),
        );
        for k in 0..15 {
            let mut whole = DVector::zeros(columns);
            for c in 0..15 {
                whole[15 * (to - 1) + c] = linear.d_residual_d_from[(k, c)];
                whole[15 * to + c] = linear.d_residual_d_to[(k, c)];
            }
            rows.push((whole, linear.residual[k]));
        }
    }
    for (landmark, column) in window.landmarks.iter().zip(&landmarks) {
        let (anchor, Some(column)) = (landmark.anchor(), column) else { continue };
        let mut whole = DVector::zeros(columns);
        whole[*column + 2] = settings.prior_on(landmark).slope(landmark.inverse_depth);
        rows.push((whole, settings.prior_on(landmark).residual(landmark.inverse_depth)));
        if let Some(linear) = workspace.geometry.linearize_plane(landmark) {
            let root = settings.kernel.weight(linear.residual.powi(2)).sqrt();
            let camera = settings.mount.d_camera_d_body(&workspace.geometry.first_camera_poses[anchor]);
            let anchored = RowVector6::from(linear.d_residual_d_anchor) * Matrix6::from_fn(|r, c| camera[r][c]);
            let mut whole = DVector::zeros(columns);
            for c in 0..6 {
                whole[15 * anchor + c] = root * anchored[c];
            }
            for c in 0..3 {
                whole[*column + c] = root * linear.d_residual_d_landmark[c];
            }
            rows.push((whole, root * linear.residual));
        }
        for (frame, point) in landmark.seen() {
            if frame == anchor {
                let residual = reprojection::at_anchor(&landmark.direction(), point);
                let root = settings.kernel.weight(residual.norm_squared()).sqrt();
                for k in 0..2 {
                    let mut whole = DVector::zeros(columns);
                    whole[*column + k] = root * point.inverse_sigma;
                    rows.push((whole, root * residual[k]));
                }
                continue;
            }
            let geometry = &workspace.geometry;
            let (pair, first_pair) = (&geometry.pairs[place(frame, anchor)], &geometry.first_pairs[place(frame, anchor)]);
            let linear = reprojection::linearize(pair, first_pair, &landmark.direction(), landmark.inverse_depth, point).unwrap();
            // From motions of the camera to motions of the body.
            let by_body = |frame: usize, row: [f64; 6]| {
                let camera = settings.mount.d_camera_d_body(&geometry.first_camera_poses[frame]);
                RowVector6::from(row) * Matrix6::from_fn(|r, c| camera[r][c])
            };
            let squared = linear.residual[0].powi(2) + linear.residual[1].powi(2);
            let root = settings.kernel.weight(squared).sqrt();
            for k in 0..2 {
                let mut whole = DVector::zeros(columns);
                let target = by_body(frame, linear.d_residual_d_target[k]);
                let anchored = -by_body(anchor, first_pair.carry_to_anchor(&linear.d_residual_d_target[k]));
                for c in 0..6 {
                    whole[15 * anchor + c] = root * anchored[c];
                    whole[15 * frame + c] = root * target[c];
                }
                for c in 0..3 {
                    whole[*column + c] = root * linear.d_residual_d_landmark[k][c];
                }
                rows.push((whole, root * linear.residual[k]));
            }
        }
    }
    for (i, frame) in window.frames.iter().enumerate().filter(|(_, frame)| frame.at_rest) {
        for axis in 0..3 {
            let mut whole = DVector::zeros(columns);
            whole[15 * i + 6 + axis] = 1.0 / settings.rest_sigma_m_s;
            rows.push((whole, frame.state.velocity_in_world[axis] / settings.rest_sigma_m_s));
        }
    }
    let jacobian = DMatrix::from_fn(rows.len(), columns, |r, c| rows[r].0[c]);
    Dense { jacobian, residual: DVector::from_fn(rows.len(), |r, _| rows[r].1), frames, landmarks }
}

/// The Gauss-Newton step of the whole system.
///
/// Columns are scaled to unit length first; the condition of what remains is what the geometry makes it.
pub fn dense_step(dense: &Dense) -> DVector<f64> {
    let (hessian, gradient) = dense.normal_equations();
    let scale = hessian.diagonal().map(|value| 1.0 / value.sqrt());
    let scaled = DMatrix::from_fn(hessian.nrows(), hessian.ncols(), |r, c| hessian[(r, c)] * scale[r] * scale[c]);
    -scaled.cholesky().unwrap().solve(&gradient.component_mul(&scale)).component_mul(&scale)
}

/// The Gauss-Newton step by the solver's own way: frames in the workspace, depths moved in the window.
pub fn schur_step(window: &mut SmallWindow<f64>, prior: &SmallPrior<f64>, settings: &Settings<f64>) -> Box<SmallWorkspace<f64>> {
    let frames = window.frames.len();
    let mut workspace = Box::<SmallWorkspace<f64>>::default();
    workspace.prepare(window, settings);
    assemble(window, prior, &mut workspace, settings, 0.0);
    assert!(chain::factorize(&mut workspace.normal.parts(), frames).is_ok());
    for (step, gradient) in workspace.step.iter_mut().zip(&workspace.gradient).take(frames) {
        *step = gradient.map(|value| -value);
    }
    chain::solve(&mut workspace.normal.parts(), &mut workspace.step[..frames], &mut workspace.visual_gradient);
    back_substitute(window, &workspace, settings, 0.0);
    workspace
}

fn recipes() -> impl Iterator<Item = Recipe> {
    (0..6).map(|seed| Recipe {
        seed,
        frames: 4 + seed as usize % 3,
        kernel: if seed.is_multiple_of(2) { Kernel::Quadratic } else { Kernel::huber(2.25) },
        ..Recipe::default()
    })
}

/// The normal equations of the workspace, whole.
fn reduced(workspace: &mut SmallWorkspace<f64>, frames: usize) -> DMatrix<f64> {
    let normal = workspace.normal.parts();
    DMatrix::from_fn(15 * frames, 15 * frames, |r, c| {
        let (r, c) = if r / 15 >= c / 15 { (r, c) } else { (c, r) };
        let ((i, a), (j, b)) = ((r / 15, r % 15), (c / 15, c % 15));
        match (a.checked_sub(6), b.checked_sub(6)) {
            (None, None) => normal.poses[place(i, j)][a][b],
            (None, Some(b)) => normal.couplings[place(i, j)][b][a],
            (Some(a), None) if i == j => normal.couplings[place(i, i)][a][b],
            (Some(a), None) if i == j + 1 => normal.pose_before[i][a][b],
            (Some(a), Some(b)) if i == j => normal.own[i][a][b],
            (Some(a), Some(b)) if i == j + 1 => normal.before[i][a][b],
            _ => 0.0,
        }
    })
}

#[test]
fn reduced_normal_equations_are_the_schur_complement_of_the_whole() {
    for recipe in recipes() {
        let mut world = World::<f64>::new(&recipe).with_planes();
        world.window.frames[1].at_rest = true;
        let frames = world.window.frames.len();
        let whole = dense(&world.window, &world.prior, &world.settings);
        let (hessian, gradient) = whole.normal_equations();
        let n = 15 * frames;
        let depths = hessian.nrows() - n;
        let coupling = hessian.view((0, n), (n, depths)).into_owned();
        let inverse = hessian.view((n, n), (depths, depths)).into_owned().try_inverse().unwrap();
        let expected = hessian.view((0, 0), (n, n)) - &coupling * &inverse * coupling.transpose();
        let expected_gradient = gradient.rows(0, n) - &coupling * &inverse * gradient.rows(n, depths);

        let mut workspace = Box::<SmallWorkspace<f64>>::default();
        workspace.prepare(&world.window, &world.settings);
        let total = assemble(&world.window, &world.prior, &mut workspace, &world.settings, 0.0);
        let found = reduced(&mut workspace, frames);
        for (r, c) in (0..n).flat_map(|r| (0..n).map(move |c| (r, c))) {
            // Entries differ by ten orders of magnitude: each is judged in the units of its own row and column.
            let scale = (hessian[(r, r)] * hessian[(c, c)]).sqrt();
            assert!((found[(r, c)] - expected[(r, c)]).abs() < 1e-12 * scale, "H {r} {c}: {} {}", found[(r, c)], expected[(r, c)]);
        }
        for r in 0..n {
            let scale = hessian[(r, r)].sqrt() * whole.residual.norm();
            assert!((workspace.gradient[r / 15][r % 15] - expected_gradient[r]).abs() < 1e-12 * scale, "b {r}");
        }
        assert!((total - cost(&world.window, &world.prior, &workspace, &world.settings)).abs() < 1e-12 * total);
        if matches!(recipe.kernel, Kernel::Quadratic) {
            assert!((total - 0.5 * whole.residual.norm_squared()).abs() < 1e-12 * total);
        }
    }
}

#[test]
fn the_step_is_that_of_the_whole_system() {
    for recipe in recipes() {
        let world = World::<f64>::new(&recipe).with_planes();
        let whole = dense(&world.window, &world.prior, &world.settings);
        let expected = dense_step(&whole);
        let mut window = super::world::copy(&world.window);
        let workspace = schur_step(&mut window, &world.prior, &world.settings);
        let n = 15 * whole.frames;
        let mut found = DVector::zeros(expected.len());
        found.rows_mut(0, n).copy_from_slice(&workspace.step.as_flattened()[..n]);
        for ((before, after), column) in world.window.landmarks.iter().zip(&window.landmarks).zip(&whole.landmarks) {
            let column = column.unwrap();
            found[column] = after.bearing[0] - before.bearing[0];
            found[column + 1] = after.bearing[1] - before.bearing[1];
            found[column + 2] = after.inverse_depth - before.inverse_depth;
        }
        // In the norm of the problem, ‖J x‖: along directions that are hardly known both roads carry the rounding of the condition.
        let error = (&whole.jacobian * (&found - &expected)).norm() / (&whole.jacobian * &expected).norm();
        assert!(error < 1e-9, "the steps differ by {error:.1e}");
        // And unknown by unknown, in the standard deviations that the problem gives them.
        let hessian = whole.normal_equations().0;
        let scale = hessian.diagonal().map(|value| 1.0 / value.sqrt());
        let scaled = DMatrix::from_fn(hessian.nrows(), hessian.ncols(), |r, c| hessian[(r, c)] * scale[r] * scale[c]);
        let variances = scaled.cholesky().unwrap().inverse().diagonal().component_mul(&scale).component_mul(&scale);
        for (k, (a, b)) in found.iter().zip(expected.iter()).enumerate() {
            assert!((a - b).abs() < 1e-7 * variances[k].sqrt(), "unknown {k}: {a} where {b} is due");
        }
    }
}

/// The covariance that a solution states of the newest pose is that block of the inverse of the whole system, damped as the
/// first step is: 1e-11 of the diagonal and 1e-6.
#[test]
fn the_stated_covariance_is_that_of_the_whole_system() {
    for recipe in recipes() {
        let world = World::<f64>::new(&recipe).with_planes();
        let whole = dense(&world.window, &world.prior, &world.settings);
        let mut hessian = whole.normal_equations().0;
        let mut workspace = Box::<SmallWorkspace<f64>>::default();
        workspace.prepare(&world.window, &world.settings);
        assemble(&world.window, &world.prior, &mut workspace, &world.settings, 0.0);
        for (k, value) in reduced(&mut workspace, whole.frames).diagonal().iter().enumerate() {
            hessian[(k, k)] += 1e-11 * value + 1e-6;
        }
        let scale = hessian.diagonal().map(|value| 1.0 / value.sqrt());
        let scaled = DMatrix::from_fn(hessian.nrows(), hessian.ncols(), |r, c| hessian[(r, c)] * scale[r] * scale[c]);
        let inverse = scaled.cholesky().unwrap().inverse();
        let newest = 15 * (whole.frames - 1);
        let expected = Matrix6::from_fn(|r, c| inverse[(newest + r, newest + c)] * scale[newest + r] * scale[newest + c]);
        // However far the solution goes: it is that of where it began, where nothing is damped.
        for iterations in [1, 10] {
            let mut workspace = Box::<SmallWorkspace<f64>>::default();
            optimize(&mut super::world::copy(&world.window), &world.prior, &mut workspace, &world.settings, iterations);
            let found = workspace.newest_pose_covariance;
            for (r, c) in (0..6).flat_map(|r| (0..6).map(move |c| (r, c))) {
                let size = (expected[(r, r)] * expected[(c, c)]).sqrt();
                assert!((found[(r, c)] - expected[(r, c)]).abs() < 1e-6 * size, "{r} {c}: {} {}", found[(r, c)], expected[(r, c)]);
            }
        }
    }
}

/// The variances stated of the newest biases are those of the inverse of the whole system, with its floor of 1e-6.
#[test]
fn the_stated_variances_of_the_biases_are_those_of_the_whole_system() {
    for recipe in recipes() {
        let world = World::<f64>::new(&recipe).with_planes();
        let whole = dense(&world.window, &world.prior, &world.settings);
        let mut hessian = whole.normal_equations().0;
        for k in 0..15 * whole.frames {
            hessian[(k, k)] += 1e-6;
        }
        let scale = hessian.diagonal().map(|value| 1.0 / value.sqrt());
        let scaled = DMatrix::from_fn(hessian.nrows(), hessian.ncols(), |r, c| hessian[(r, c)] * scale[r] * scale[c]);
        let inverse = scaled.cholesky().unwrap().inverse();
        let mut workspace = Box::<SmallWorkspace<f64>>::default();
        let found = newest_bias_variances(&world.window, &world.prior, &mut workspace, &world.settings).unwrap();
        for (axis, found) in found.into_iter().enumerate() {
            let k = 15 * (whole.frames - 1) + 9 + axis;
            let expected = inverse[(k, k)] * scale[k] * scale[k];
            assert!((found - expected).abs() < 1e-6 * expected, "{axis}: {found} {expected}");
        }
    }
}

/// The gradient is that of the cost, found by moving states and depths.
#[test]
fn the_gradient_is_the_slope_of_the_cost() {
    for recipe in recipes() {
        let mut world = World::<f64>::new(&recipe).with_planes();
        // The prior is linear in x ⊟ origin: at its origin its Jacobian is exact.
        world.window.frames[0].state = world.truth[0];
        let whole = dense(&world.window, &world.prior, &world.settings);
        let gradient = whole.normal_equations().1;
        let cost_at = |window: &SmallWindow<f64>| {
            let mut workspace = Box::<SmallWorkspace<f64>>::default();
            workspace.prepare(window, &world.settings);
            cost(window, &world.prior, &workspace, &world.settings)
        };
        let hessian = whole.normal_equations().0;
        for column in 0..gradient.len() {
            // A step of a thousandth of a standard deviation: the distance from a plane is far from linear in λ.
            let step = 1e-3 / hessian[(column, column)].sqrt();
            let moved = |sign: f64| {
                let mut window = super::world::copy(&world.window);
                if column < 15 * whole.frames {
                    let mut delta = [0.0; 15];
                    delta[column % 15] = sign * step;
                    let state = &mut window.frames[column / 15].state;
                    *state = state.retract(&delta);
                } else {
                    let of = |unknown: &Option<usize>| unknown.is_some_and(|first| (first..first + 3).contains(&column));
                    let index = whole.landmarks.iter().position(of).unwrap();
                    let landmark = &mut window.landmarks[index];
                    match column - whole.landmarks[index].unwrap() {
                        2 => landmark.inverse_depth += sign * step,
                        axis => landmark.bearing[axis] += sign * step,
                    }
                }
                cost_at(&window)
            };
            let slope = (moved(1.0) - moved(-1.0)) / (2.0 * step);
            let scale = hessian[(column, column)].sqrt() * whole.residual.norm();
            assert!((slope - gradient[column]).abs() < 1e-6 * scale, "unknown {column}: slope {slope}, gradient {}", gradient[column]);
        }
    }
}
