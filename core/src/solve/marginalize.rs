//! Takes the oldest frame out of the window and keeps what it knew as a square-root prior.
//!
//! # Model
//! All factors that touch the oldest frame, or a landmark that leaves with it, are linearised once (at first estimates),
//! stacked as rows `(A, b)` and folded into an upper triangle whose first columns are the leaving frame's.
//! Then its first rows hold the leaving frame's conditional, and the rest is the prior on what remains.
//!
//! Landmarks come first, in a triangle of their own. They are anchored in the leaving frame, so their rows speak of the poses
//! of the other cameras relative to it, six columns each; a landmark's three numbers are eliminated from its own rows by one
//! reflection each. The triangle's rows then join the others, with `e_j` becoming `e_j B_j` and `−(M_j e_jᵀ)ᵀ B_0`
//! (see [`reprojection`](crate::factor::reprojection)).
//!
//! Landmarks that the newest frame still sees are not marginalised: their observation in the leaving frame is dropped
//! instead and they move to their next frame. So no observation is ever used twice, and the prior stays consistent.

use nalgebra::SMatrix;

use super::assemble::block_of;
use super::normal::TILES as MEMORY_TILES;
use super::triangle::{Rows, TILE, eliminate, fold, tiles};
use super::workspace::{Geometry, Settings, Workspace};
use crate::factor::{imu, prior::Prior, reprojection};
use crate::imu::NavState;
use crate::real::Real;
use crate::storage::blocks::{pairs, place, zero_block};
use crate::window::{Frame, Landmark, Window};

/// Numbers of a landmark: `x, y, λ`.
const POINT: usize = 3;

/// Rows that are gathered before they are folded in.
const GATHERED: usize = 48;

/// Frames that the prior may speak of while the oldest leaves: not the newest two, which are never keyframes.
const fn most_involved(frames: usize) -> usize {
    frames - 2
}

/// Whether the memory of the normal equations holds both triangles, and besides them either the rows of an inertial factor or those
/// of one landmark.
pub(super) const fn fits(frames: usize) -> bool {
    let involved = most_involved(frames);
    let relative = 6 * (involved - 1);
    let (wide, narrow) = (tiles(column(involved)), tiles(relative + POINT));
    let rest = (MEMORY_TILES * pairs(frames)).saturating_sub(narrow * relative);
    rest >= wide * (column(involved) + 15) && rest >= narrow * (2 * involved + 1)
}

/// Where a frame's columns begin: whole states of the oldest two, poses of the others.
const fn column(frame: usize) -> usize {
    match frame {
        0 => 0,
        1 => 15,
        _ => 18 + 6 * frame,
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
    let (mut triangle, rest) = Rows::carve(workspace.normal.memory(), 15, 15);
    let (mut rows, _) = Rows::carve(rest, 15, 15);
    for (i, row) in block_of(square_root).iter().enumerate() {
        rows.row_mut(i)[..15].copy_from_slice(row);
    }
    fold(&mut triangle, &mut rows, 15);
    for (i, row) in prior.head.iter_mut().enumerate() {
        row.copy_from_slice(&triangle.row(i)[..15]);
    }
    prior.right_head = [T::ZERO; 15];
}

/// Marginalises frame 0. Frames `0..keyframes` may enter the prior; later ones are recent and keep their observations to themselves.
pub fn marginalize_oldest<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize>(
    window: &mut Window<T, FRAMES, POINTS>,
    prior: &mut Prior<T, FRAMES, PAIRS>,
    workspace: &mut Workspace<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    keyframes: usize,
) {
    let Some(newest) = window.frames.len().checked_sub(1) else { return };
    if newest == 0 {
        prior.clear();
        window.remove_frame(0, &workspace.geometry.camera_poses);
        return;
    }
    let involved = keyframes.max(prior.frames).max(2).min(newest + 1).min(most_involved(FRAMES));
    for frame in window.frames.iter_mut().take(involved) {
        frame.linearization.get_or_insert(frame.state);
    }
    prior.settle(&window.frames);
    workspace.prepare(window, settings);
    let inertial = workspace.imu_square_root(1);

    let columns = column(involved);
    let relative_columns = 6 * (involved - 1);
    let (mut relative, rest) = Rows::carve(workspace.normal.memory(), relative_columns + POINT, relative_columns);
    let leaving = window.landmarks.iter().filter(|landmark| landmark.anchor() == 0 && landmark.active && !landmark.is_seen_in(newest));
    fold_landmarks(leaving, &mut relative, rest, &workspace.geometry, settings, involved);
    // Once marginalised, a landmark is gone.
    window.landmarks.retain(|landmark| landmark.anchor() != 0 || landmark.is_seen_in(newest));

    let (mut triangle, rest) = Rows::carve(rest, columns, columns);
    load(&mut triangle, prior, columns);
    fold_poses(&mut triangle, &relative, rest, &window.frames[..involved], &workspace.geometry, settings);
    if let (Some(root), [oldest, second, ..]) = (&inertial, window.frames.as_slice()) {
        fold_inertial(&mut triangle, rest, root, oldest, second, settings, columns);
    }
    if let Some(oldest) = window.frames.first().filter(|frame| frame.at_rest) {
        let (mut rows, _) = Rows::carve(rest, columns, 3);
        let delta = oldest.state.local(oldest.linearization_point());
        let root = T::one() / settings.rest_sigma_m_s;
        for axis in 0..3 {
            let row = rows.row_mut(axis);
            row[6 + axis] = root;
            row[columns] = root * (oldest.state.velocity_in_world[axis] - delta[6 + axis]);
        }
        fold(&mut triangle, &mut rows, columns);
    }
    // The first rows are the leaving frame's conditional: only the others are kept.
    store(&triangle, prior, involved, columns);
    window.remove_frame(0, &workspace.geometry.camera_poses);
}

fn dot<T: Real>(a: &[T], b: &[T]) -> T {
    a.iter().zip(b).fold(T::ZERO, |sum, (x, y)| sum + *x * *y)
}

/// Folds the landmarks into the triangle of relative poses, their own numbers eliminated. Right-hand sides are residuals.
fn fold_landmarks<'a, T: Real, const FRAMES: usize, const PAIRS: usize>(
    landmarks: impl Iterator<Item = &'a Landmark<T, FRAMES>>,
    triangle: &mut Rows<'_, T>,
    buffer: &mut [[T; TILE]],
    geometry: &Geometry<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
    involved: usize,
) {
    let columns = triangle.count();
    // Relative poses, the right-hand side, and behind it x, y and λ.
    let own = columns + 1;
    let most = 2 * involved + 1;
    // As many rows as there is memory for, so that a portion always has room for one more landmark.
    let (mut rows, _) = Rows::carve(buffer, columns + POINT, (buffer.len() / tiles(columns + POINT)).min(GATHERED + most));
    let mut gathered = 0;
    for landmark in landmarks {
        if gathered + most > rows.count() {
            fold(triangle, &mut rows.part(0, gathered), columns);
            gathered = 0;
        }
        let direction = landmark.direction();
        let row = rows.row_mut(gathered);
        row.fill(T::ZERO);
        let prior = settings.prior_on(landmark);
        row[columns] = prior.residual(landmark.inverse_depth);
        row[own + 2] = prior.slope(landmark.inverse_depth);
        let mut count = 1;
        for (frame, point) in landmark.seen().filter(|(frame, _)| *frame < involved) {
            if frame == 0 {
                let r = reprojection::at_anchor(&direction, point);
                let root = settings.kernel.weight(r.norm_squared()).root();
                for k in 0..2 {
                    let row = rows.row_mut(gathered + count);
                    row.fill(T::ZERO);
                    row[columns] = root * r[k];
                    row[own + k] = root * point.inverse_sigma;
                    count += 1;
                }
                continue;
            }
            let Some(linear) = geometry.linearize(0, frame, &direction, landmark.inverse_depth, point) else { continue };
            let r = &linear.residual;
            let root = settings.kernel.weight(r[0] * r[0] + r[1] * r[1]).root();
            for k in 0..2 {
                let row = rows.row_mut(gathered + count);
                row.fill(T::ZERO);
                for (out, value) in row[6 * (frame - 1)..].iter_mut().zip(&linear.d_residual_d_target[k]) {
                    *out = root * *value;
                }
                row[columns] = root * r[k];
                for (out, value) in row[own..].iter_mut().zip(&linear.d_residual_d_landmark[k]) {
                    *out = root * *value;
                }
                count += 1;
            }
        }
        // Three rows say where the landmark is: nothing is left of fewer than two observations.
        if count < 5 {
            continue;
        }
        // Reflect each of its columns onto a row of its own; those rows are its conditional and are dropped.
        for k in 0..POINT {
            let mut left = rows.part(gathered, gathered + count);
            let (mut others, mut last) = left.split(count - 1);
            eliminate(last.tiles_mut(), &mut others, own + k, 0);
            count -= 1;
        }
        gathered += count;
    }
    fold(triangle, &mut rows.part(0, gathered), columns);
}

/// Folds the triangle of relative poses in, as rows over the poses of the bodies.
fn fold_poses<T: Real, const FRAMES: usize, const PAIRS: usize>(
    triangle: &mut Rows<'_, T>,
    relative: &Rows<'_, T>,
    buffer: &mut [[T; TILE]],
    frames: &[Frame<T>],
    geometry: &Geometry<T, FRAMES, PAIRS>,
    settings: &Settings<T>,
) {
    let columns = triangle.count();
    let mut by_body = [zero_block::<T, 6>(); FRAMES];
    let mut deltas = [[T::ZERO; 15]; FRAMES];
    for (i, frame) in frames.iter().enumerate() {
        by_body[i] = settings.mount.d_camera_d_body(&geometry.first_camera_poses[i]);
        deltas[i] = frame.state.local(frame.linearization_point());
    }
    // e B
    let moved = |e: &[T; 6], by_body: &[[T; 6]; 6]| {
        let mut out = [T::ZERO; 6];
        for (value, row) in e.iter().zip(by_body) {
            for (sum, entry) in out.iter_mut().zip(row) {
                *sum += *value * *entry;
            }
        }
        out
    };
    let at_once = (buffer.len() / tiles(columns)).clamp(1, GATHERED);
    for first in (0..relative.count()).step_by(at_once) {
        let count = at_once.min(relative.count() - first);
        let (mut rows, _) = Rows::carve(buffer, columns, count);
        for i in 0..count {
            let (from, row) = (relative.row(first + i), rows.row_mut(i));
            let mut anchor = [T::ZERO; 6];
            let mut right = from[relative.count()];
            for (frame, e) in (1..frames.len()).zip(from.as_chunks::<6>().0) {
                let target = moved(e, &by_body[frame]);
                row[column(frame)..column(frame) + 6].copy_from_slice(&target);
                right -= dot(&target, &deltas[frame]);
                for (sum, value) in anchor.iter_mut().zip(geometry.first_pairs[place(frame, 0)].carry_to_anchor(e)) {
                    *sum -= value;
                }
            }
            let anchor = moved(&anchor, &by_body[0]);
            row[..6].copy_from_slice(&anchor);
            row[columns] = right - dot(&anchor, &deltas[0]);
        }
        fold(triangle, &mut rows, columns);
    }
}

fn fold_inertial<T: Real>(
    triangle: &mut Rows<'_, T>,
    buffer: &mut [[T; TILE]],
    root: &SMatrix<T, 15, 15>,
    oldest: &Frame<T>,
    second: &Frame<T>,
    settings: &Settings<T>,
    columns: usize,
) {
    let (at_oldest, at_second) = (oldest.linearization_point(), second.linearization_point());
    let gravity = &settings.gravity_in_world;
    let linear = imu::linearize(&second.from_previous, gravity, root, &oldest.state, &second.state, at_oldest, at_second);
    let (from_rows, to_rows) = (block_of(&linear.d_residual_d_from), block_of(&linear.d_residual_d_to));
    let deltas = [oldest.state.local(at_oldest), second.state.local(at_second)];
    let (mut rows, _) = Rows::carve(buffer, columns, 15);
    for (k, residual) in linear.residual.iter().enumerate().take(rows.count()) {
        let row = rows.row_mut(k);
        row[..15].copy_from_slice(&from_rows[k]);
        row[15..30].copy_from_slice(&to_rows[k]);
        row[columns] = *residual - dot(&from_rows[k], &deltas[0]) - dot(&to_rows[k], &deltas[1]);
    }
    fold(triangle, &mut rows, columns);
}

/// Writes the prior into the triangle.
fn load<T: Real, const FRAMES: usize, const PAIRS: usize>(triangle: &mut Rows<'_, T>, prior: &Prior<T, FRAMES, PAIRS>, columns: usize) {
    if prior.frames == 0 {
        return;
    }
    for r in 0..15 {
        let row = triangle.row_mut(r);
        row[..15].copy_from_slice(&prior.head[r]);
        row[columns] = prior.right_head[r];
    }
    for j in 1..prior.frames {
        let (coupling, poses) = prior.column(j);
        for (r, values) in coupling.iter().enumerate() {
            triangle.row_mut(r)[column(j)..column(j) + 6].copy_from_slice(values);
        }
        for (i, block) in (1..).zip(poses) {
            for (r, values) in block.iter().enumerate() {
                triangle.row_mut(column(i) + r)[column(j)..column(j) + 6].copy_from_slice(values);
            }
        }
        for (r, value) in prior.right[j].iter().enumerate() {
            triangle.row_mut(column(j) + r)[columns] = *value;
        }
    }
}

/// Reads the prior off the triangle from the second frame on, which becomes the oldest.
fn store<T: Real, const FRAMES: usize, const PAIRS: usize>(
    triangle: &Rows<'_, T>,
    prior: &mut Prior<T, FRAMES, PAIRS>,
    involved: usize,
    columns: usize,
) {
    for r in 0..15 {
        let row = triangle.row(15 + r);
        prior.head[r].copy_from_slice(&row[15..30]);
        prior.right_head[r] = row[columns];
    }
    for j in 2..involved {
        let (coupling, poses) = prior.column_mut(j - 1);
        for (r, values) in coupling.iter_mut().enumerate() {
            values.copy_from_slice(&triangle.row(15 + r)[column(j)..column(j) + 6]);
        }
        for (i, block) in (2..).zip(poses) {
            for (r, values) in block.iter_mut().enumerate() {
                values.copy_from_slice(&triangle.row(column(i) + r)[column(j)..column(j) + 6]);
            }
        }
        for (r, value) in prior.right[j - 1].iter_mut().enumerate() {
            *value = triangle.row(column(j) + r)[columns];
        }
    }
    prior.frames = involved - 1;
}
