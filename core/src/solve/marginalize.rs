//! Takes the oldest frame out of the window and keeps what it knew as a square-root prior.
//!
//! # Model
//! All factors that touch the oldest frame, or a landmark that leaves with it, are linearised once (at first estimates),
//! stacked as rows `(A, b)` and folded into the upper triangle `R` whose first block column is the leaving frame.
//! Then the first block row of `R` holds the leaving frame's conditional, and the rest is the prior on what remains.
//! A landmark's inverse depth is eliminated beforehand from its own rows by one reflection.
//!
//! Landmarks that the newest frame still sees are not marginalised: their observation in the leaving frame is dropped
//! instead and they move to their next frame. So no observation is ever used twice, and the prior stays consistent.

use nalgebra::SMatrix;

use super::assemble::block_of;
use super::triangle::{Rows, fold};
use super::workspace::{Settings, Workspace};
use crate::factor::{imu, prior::Prior};
use crate::imu::NavState;
use crate::real::Real;
use crate::storage::blocks::{Block, pairs, place, zero_block};
use crate::window::{Landmark, Window};

/// Triangle of the visual rows, over poses only.
#[derive(Debug)]
pub struct MarginalizationWorkspace<T: Real, const FRAMES: usize, const PAIRS: usize> {
    triangle: [Block<T, 6>; PAIRS],
    right: [[T; 6]; FRAMES],
}

impl<T: Real, const FRAMES: usize, const PAIRS: usize> Default for MarginalizationWorkspace<T, FRAMES, PAIRS> {
    fn default() -> Self {
        Self { triangle: [zero_block(); PAIRS], right: [[T::ZERO; 6]; FRAMES] }
    }
}

/// Makes `‖A (x ⊟ origin)‖²` the prior of a fresh window's first frame.
pub fn add_initial<T: Real, const FRAMES: usize, const PAIRS: usize>(
    prior: &mut Prior<T, FRAMES, PAIRS>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    origin: &NavState<T>,
    square_root: &SMatrix<T, 15, 15>,
) {
    prior.clear();
    prior.frames = 1;
    prior.origin = Some(*origin);
    let (buffer, scratch) = workspace.hessian.as_flattened_mut().as_flattened_mut().split_at_mut(15 * 16);
    let mut rows = Rows::zeros(buffer, 15, 15);
    for (i, row) in block_of(square_root).iter().enumerate() {
        rows.row_mut(i)[..15].copy_from_slice(row);
    }
    fold(&mut prior.triangle, &mut prior.right[..1], &mut rows, scratch);
}

/// Marginalises frame 0. Frames `0..keyframes` may enter the prior; later ones are recent and keep their observations to themselves.
pub fn marginalize_oldest<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &mut Window<T, FRAMES, POINTS>,
    prior: &mut Prior<T, FRAMES, PAIRS>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    visual: &mut MarginalizationWorkspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    keyframes: usize,
) {
    let Some(newest) = window.frames.len().checked_sub(1) else { return };
    let involved = keyframes.max(prior.frames).max(2).min(newest + 1);
    for frame in window.frames.iter_mut().take(involved) {
        frame.linearization.get_or_insert(frame.state);
    }
    prior.settle(&window.frames);
    workspace.prepare(window, settings);
    let mut deltas = [[T::ZERO; 15]; FRAMES];
    for (delta, frame) in deltas.iter_mut().zip(&window.frames).take(involved) {
        *delta = frame.state.local(frame.linearization_point());
    }

    visual.triangle[..pairs(involved)].fill(zero_block());
    visual.right[..involved].fill([T::ZERO; 6]);
    for landmark in &mut window.landmarks {
        if landmark.anchor() == 0 && landmark.active && !landmark.is_seen_in(newest) {
            fold_landmark(landmark, workspace, visual, settings, &deltas, involved);
        }
    }
    // Once marginalised, a landmark is gone.
    window.landmarks.retain(|landmark| landmark.anchor() != 0 || landmark.is_seen_in(newest));

    let columns = involved * 15;
    let right = &mut prior.right[..involved];
    // Visual rows, spread from poses to whole states, one block row at a time.
    for i in 0..involved {
        let (buffer, scratch) = workspace.hessian.as_flattened_mut().as_flattened_mut().split_at_mut(6 * (columns + 1));
        let mut rows = Rows::zeros(buffer, columns, 6);
        for r in 0..6 {
            let row = rows.row_mut(r);
            for j in i..involved {
                row[j * 15..j * 15 + 6].copy_from_slice(&visual.triangle[place(j, i)][r]);
            }
            row[columns] = visual.right[i][r];
        }
        fold(&mut prior.triangle, right, &mut rows, scratch);
    }
    if let (Some(root), [oldest, second, ..]) = (&workspace.imu_square_roots[1], window.frames.as_slice()) {
        let linear = imu::linearize(
            &second.from_previous,
            &settings.gravity_in_world,
            root,
            &oldest.state,
            &second.state,
            oldest.linearization_point(),
            second.linearization_point(),
        );
        let (from_rows, to_rows) = (block_of(&linear.d_residual_d_from), block_of(&linear.d_residual_d_to));
        let (buffer, scratch) = workspace.hessian.as_flattened_mut().as_flattened_mut().split_at_mut(15 * (columns + 1));
        let mut rows = Rows::zeros(buffer, columns, 15);
        for (k, residual) in linear.residual.iter().enumerate() {
            let row = rows.row_mut(k);
            row[..15].copy_from_slice(&from_rows[k]);
            row[15..30].copy_from_slice(&to_rows[k]);
            row[columns] = *residual - dot(&from_rows[k], &deltas[0]) - dot(&to_rows[k], &deltas[1]);
        }
        fold(&mut prior.triangle, right, &mut rows, scratch);
    }
    if let Some(oldest) = window.frames.first().filter(|frame| frame.at_rest) {
        let (buffer, scratch) = workspace.hessian.as_flattened_mut().as_flattened_mut().split_at_mut(3 * (columns + 1));
        let mut rows = Rows::zeros(buffer, columns, 3);
        let root = T::one() / settings.rest_sigma_m_s;
        for axis in 0..3 {
            let row = rows.row_mut(axis);
            row[6 + axis] = root;
            row[columns] = root * (oldest.state.velocity_in_world[axis] - deltas[0][6 + axis]);
        }
        fold(&mut prior.triangle, right, &mut rows, scratch);
    }

    // The first block row is the leaving frame's conditional: drop it.
    for i in 1..involved {
        for j in i..involved {
            prior.triangle[place(j - 1, i - 1)] = prior.triangle[place(j, i)];
        }
        prior.right[i - 1] = prior.right[i];
    }
    for i in 0..involved {
        prior.triangle[place(involved - 1, i)] = zero_block();
    }
    prior.right[involved - 1] = [T::ZERO; 15];
    prior.frames = involved - 1;
    window.remove_frame(0, &workspace.geometry.camera_poses);
}

fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::ZERO, |sum, (x, y)| sum + *x * *y)
}

/// Rows of one landmark with its inverse depth eliminated, folded into the visual triangle.
fn fold_landmark<T: Real, const FRAMES: usize, const PAIRS: usize>(
    landmark: &Landmark<T, FRAMES>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    visual: &mut MarginalizationWorkspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    deltas: &[[T; 15]; FRAMES],
    involved: usize,
) {
    let huber = settings.kernel;
    let anchor = landmark.anchor();
    let direction = landmark.direction();
    let columns = involved * 6;
    let width = columns + 1;
    let most = 2 * involved;
    let (buffer, scratch) = workspace.hessian.as_flattened_mut().as_flattened_mut().split_at_mut(most * width);
    let mut depths = [[T::ZERO; 2]; FRAMES];
    buffer[..most * width].fill(T::ZERO);
    let mut count = 0;
    for (frame, point) in landmark.seen().filter(|(frame, _)| *frame != anchor && *frame < involved) {
        let Some(linear) = workspace.geometry.linearize(settings, anchor, frame, &direction, landmark.inverse_depth, point) else {
            continue;
        };
        let r = &linear.residual;
        let root = huber.weight(r[0] * r[0] + r[1] * r[1]).root();
        for k in 0..2 {
            let row = &mut buffer[(2 * count + k) * width..(2 * count + k + 1) * width];
            let (anchor_row, target_row) = (&linear.d_residual_d_anchor[k], &linear.d_residual_d_target[k]);
            for c in 0..6 {
                row[anchor * 6 + c] = root * anchor_row[c];
                row[frame * 6 + c] = root * target_row[c];
            }
            row[columns] = root * (r[k] - dot(anchor_row, &deltas[anchor][..6]) - dot(target_row, &deltas[frame][..6]));
            depths[count][k] = root * linear.d_residual_d_inverse_depth[k];
        }
        count += 1;
    }
    let depths = &mut depths.as_flattened_mut()[..2 * count];
    let norm = dot(depths, depths).root();
    if !(norm > T::of(1e-6)) {
        return;
    }
    // Reflect the column of λ onto its first row; that row is the conditional of λ and is dropped.
    let head = if depths[0] > T::ZERO { depths[0] + norm } else { depths[0] - norm };
    let scale = T::one() / (norm * head.abs());
    depths[0] = head;
    let product = &mut scratch[..width];
    product.fill(T::ZERO);
    for (row, factor) in buffer.chunks_exact(width).zip(depths.iter()) {
        for (out, value) in product.iter_mut().zip(row) {
            *out += *factor * *value;
        }
    }
    for (row, factor) in buffer.chunks_exact_mut(width).zip(depths.iter()) {
        for (out, value) in row.iter_mut().zip(product.iter()) {
            *out -= *factor * scale * *value;
        }
    }
    let mut rows = Rows::over(&mut buffer[width..2 * count * width], columns);
    fold(&mut visual.triangle, &mut visual.right[..involved], &mut rows, scratch);
}
