//! Sums over samples that lie on a surface, several samples at a time.
//!
//! Every sum has one accumulator per lane, so that the compiler may use vector instructions without reordering any addition; the result
//! depends on the order of the samples alone. A sample that is off the surface adds zero: no branches.

use core::ops::Range;

use crate::plane::samples::{Candidates, Run, View};
use crate::real::Real;
use crate::robust::ransac::Agreement;

/// Samples at a time: enough that the compiler makes a loop over them, which it turns into vector instructions however many sums there are.
const LANES: usize = 16;
/// Samples between two looks at whether the best can still be beaten.
const BLOCK: usize = 512;

/// A surface without thickness, in the level frame.
pub(in crate::plane) trait Surface<T: Real>: Copy {
    /// What may lie on it.
    const CANDIDATES: Candidates;
    /// The signed distance of a point, m.
    fn distance_m(&self, point: [T; 3]) -> T;
    /// The cosine of the angle to a normal, of either sign.
    fn cosine(&self, normal: [T; 3]) -> T;
}

/// `z + d = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level<T> {
    pub offset_m: T,
}

/// `n_x x + n_y y + d = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Upright<T> {
    pub normal: [T; 2],
    pub offset_m: T,
}

/// `nᵀx + d = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::plane) struct Tilted<T> {
    pub normal: [T; 3],
    pub offset_m: T,
}

impl<T: Real> Surface<T> for Level<T> {
    const CANDIDATES: Candidates = Candidates::Horizontal;
    #[inline(always)]
    fn distance_m(&self, [_, _, z]: [T; 3]) -> T {
        z + self.offset_m
    }
    #[inline(always)]
    fn cosine(&self, [_, _, z]: [T; 3]) -> T {
        z
    }
}

impl<T: Real> Surface<T> for Upright<T> {
    const CANDIDATES: Candidates = Candidates::Vertical;
    #[inline(always)]
    fn distance_m(&self, [x, y, _]: [T; 3]) -> T {
        self.normal[0] * x + self.normal[1] * y + self.offset_m
    }
    #[inline(always)]
    fn cosine(&self, [x, y, _]: [T; 3]) -> T {
        self.normal[0] * x + self.normal[1] * y
    }
}

impl<T: Real> Surface<T> for Tilted<T> {
    const CANDIDATES: Candidates = Candidates::Any;
    #[inline(always)]
    fn distance_m(&self, [x, y, z]: [T; 3]) -> T {
        (self.normal[0] * x + self.normal[1] * y) + (self.normal[2] * z + self.offset_m)
    }
    #[inline(always)]
    fn cosine(&self, [x, y, z]: [T; 3]) -> T {
        self.normal[0] * x + self.normal[1] * y + self.normal[2] * z
    }
}

/// How far from a surface a sample may be, and how far its normal may be turned.
#[derive(Debug, Clone, Copy)]
pub(in crate::plane) struct Limits<T> {
    pub squared_distance: T,
    pub squared_cosine: T,
}

impl<T: Real> Limits<T> {
    pub fn new(view: &View<'_, T>, theta_m: T) -> Self {
        Self { squared_distance: theta_m * theta_m, squared_cosine: view.cosine_tolerance * view.cosine_tolerance }
    }

    /// Whether a sample, with its normal or zeros, lies on a surface.
    #[inline(always)]
    pub fn admit<S: Surface<T>>(&self, surface: &S, [x, y, z, n_x, n_y, n_z]: [T; 6]) -> bool {
        let distance = surface.distance_m([x, y, z]);
        let cosine = surface.cosine([n_x, n_y, n_z]);
        let is_unknown = n_x == T::ZERO && n_y == T::ZERO && n_z == T::ZERO;
        distance * distance < self.squared_distance && (is_unknown || cosine * cosine >= self.squared_cosine)
    }
}

/// `Σ term(sample)` over one run, for `S` terms at once.
#[inline(always)]
fn sum<T: Real, const C: usize, const S: usize>(columns: [&[T]; C], range: Range<usize>, term: impl Fn([T; C]) -> [T; S]) -> [T; S] {
    let columns = columns.map(|column| &column[range.clone()]);
    // A microcontroller has no vector instructions: there the lanes in a row are nothing but code, 17 KB of it.
    if cfg!(target_os = "none") { sum_lane_by_lane(columns, term) } else { sum_lanes(columns, term) }
}

/// All lanes side by side.
#[inline(always)]
fn sum_lanes<T: Real, const C: usize, const S: usize>(columns: [&[T]; C], term: impl Fn([T; C]) -> [T; S]) -> [T; S] {
    let len = columns[0].len();
    let columns = columns.map(|column| column.as_chunks::<LANES>());
    let mut sums = [[T::ZERO; LANES]; S];
    // Same number for all columns: said once more, so that no bound is checked within.
    let chunks = len / LANES;
    let whole = columns.map(|(whole, _)| &whole[..chunks]);
    #[allow(clippy::needless_range_loop)] // of several columns at once
    for k in 0..chunks {
        let rows: [&[T; LANES]; C] = core::array::from_fn(|c| &whole[c][k]);
        for lane in 0..LANES {
            let terms = term(core::array::from_fn(|c| rows[c][lane]));
            for s in 0..S {
                sums[s][lane] += terms[s];
            }
        }
    }
    let mut total = sums.map(|lanes| lanes.iter().fold(T::ZERO, |sum, value| sum + *value));
    for place in 0..len % LANES {
        let terms = term(core::array::from_fn(|c| columns[c].1[place]));
        for s in 0..S {
            total[s] += terms[s];
        }
    }
    total
}

/// One lane after the other: the same additions in the same order.
#[inline(always)]
fn sum_lane_by_lane<T: Real, const C: usize, const S: usize>(columns: [&[T]; C], term: impl Fn([T; C]) -> [T; S]) -> [T; S] {
    let len = columns[0].len();
    let whole = len - len % LANES;
    let mut total = [T::ZERO; S];
    // What is left over comes one by one, after the lanes.
    for first in (0..LANES.min(whole)).chain(whole..len) {
        let (end, mut part) = (if first < whole { whole } else { first + 1 }, [T::ZERO; S]);
        for place in (first..end).step_by(LANES) {
            let terms = term(columns.map(|column| column[place]));
            for s in 0..S {
                part[s] += terms[s];
            }
        }
        for s in 0..S {
            total[s] += part[s];
        }
    }
    total
}

/// `Σ min(d², θ²)` of a run, m²; a sample with the wrong normal counts as far.
// Out of line, once for each surface: a loop of its own is what the compiler makes vector instructions of.
#[inline(never)]
fn loss<T: Real, S: Surface<T>>(view: &View<'_, T>, surface: &S, limits: &Limits<T>, range: Range<usize>, checks_normals: bool) -> T {
    let (limits, surface) = (*limits, *surface);
    let loss = move |point: [T; 3]| {
        let distance = surface.distance_m(point);
        let squared = distance * distance;
        if squared < limits.squared_distance { squared } else { limits.squared_distance }
    };
    let [x, y, z, n_x, n_y, n_z] = view.columns;
    let [total] = if checks_normals {
        sum([x, y, z, n_x, n_y, n_z], range, |[x, y, z, n_x, n_y, n_z]| {
            let cosine = surface.cosine([n_x, n_y, n_z]);
            let loss = loss([x, y, z]);
            [if cosine * cosine >= limits.squared_cosine { loss } else { limits.squared_distance }]
        })
    } else {
        sum([x, y, z], range, |point| [loss(point)])
    };
    total
}

/// How many samples of a run lie on a surface.
#[inline(never)]
fn count<T: Real, S: Surface<T>>(view: &View<'_, T>, surface: &S, limits: &Limits<T>, range: Range<usize>, checks_normals: bool) -> T {
    let (limits, surface) = (*limits, *surface);
    let near = move |point: [T; 3]| {
        let distance = surface.distance_m(point);
        if distance * distance < limits.squared_distance { T::one() } else { T::ZERO }
    };
    let [x, y, z, n_x, n_y, n_z] = view.columns;
    let [total] = if checks_normals {
        sum([x, y, z, n_x, n_y, n_z], range, |[x, y, z, n_x, n_y, n_z]| {
            let cosine = surface.cosine([n_x, n_y, n_z]);
            let near = near([x, y, z]);
            [if cosine * cosine >= limits.squared_cosine { near } else { T::ZERO }]
        })
    } else {
        sum([x, y, z], range, |point| [near(point)])
    };
    total
}

/// How the candidates agree with a surface; `None` as soon as it is certain that `to_beat` is not exceeded: what has not been looked at
/// adds its weight at most.
#[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation, clippy::cast_sign_loss)]
pub(super) fn agreement<T: Real, S: Surface<T>>(view: &View<'_, T>, surface: &S, limits: &Limits<T>, to_beat: T) -> Option<Agreement<T>> {
    let per_squared_distance = T::one() / limits.squared_distance;
    let mut left = view.weight(S::CANDIDATES);
    let mut score = T::ZERO;
    for Run { range, weight, checks_normals, .. } in view.runs(S::CANDIDATES) {
        let mut start = range.start;
        while start < range.end {
            let end = (start + BLOCK).min(range.end);
            let weight_of_block = weight * T::of((end - start) as f64);
            // Σ (1 − d²/θ²) where that is positive.
            score += weight_of_block - weight * per_squared_distance * loss(view, surface, limits, start..end, checks_normals);
            left -= weight_of_block;
            if score + left <= to_beat {
                return None;
            }
            start = end;
        }
    }
    if score <= to_beat {
        return None;
    }
    let mut agreement = Agreement { score, weight: T::ZERO, inliers: 0 };
    for Run { range, weight, checks_normals, .. } in view.runs(S::CANDIDATES) {
        let inliers = count(view, surface, limits, range, checks_normals);
        agreement.weight += weight * inliers;
        agreement.inliers += inliers.as_f64() as usize; // exact below 2²⁴
    }
    Some(agreement)
}

/// Sums over the candidates on a surface, weighted but for their number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sums<T, const S: usize> {
    /// How many there are, exact below 2²⁴.
    pub inliers: T,
    /// What those weigh that have normals.
    pub weight_with_normals: T,
    pub values: [T; S],
}

/// Sums of `term(point, distance, one)`, where `one` is 1 for a sample on the surface and 0 otherwise, and the first of the term.
#[inline(always)]
fn sum_over_inliers<T: Real, const S: usize>(
    view: &View<'_, T>,
    surface: &Tilted<T>,
    limits: &Limits<T>,
    of: Candidates,
    term: impl Fn([T; 3], T, T) -> [T; S],
) -> Sums<T, S> {
    let (surface, limits) = (*surface, *limits);
    let [x, y, z, n_x, n_y, n_z] = view.columns;
    let mut sums = Sums { inliers: T::ZERO, weight_with_normals: T::ZERO, values: [T::ZERO; S] };
    for Run { range, weight, checks_normals, has_normals } in view.runs(of) {
        let part = if checks_normals {
            sum([x, y, z, n_x, n_y, n_z], range, |[x, y, z, n_x, n_y, n_z]| {
                let distance = surface.distance_m([x, y, z]);
                let cosine = surface.cosine([n_x, n_y, n_z]);
                let is_on = (distance * distance < limits.squared_distance) & (cosine * cosine >= limits.squared_cosine);
                term([x, y, z], distance, if is_on { T::one() } else { T::ZERO })
            })
        } else {
            sum([x, y, z], range, |point| {
                let distance = surface.distance_m(point);
                let is_on = distance * distance < limits.squared_distance;
                term(point, distance, if is_on { T::one() } else { T::ZERO })
            })
        };
        sums.inliers += part[0];
        if has_normals {
            sums.weight_with_normals += weight * part[0];
        }
        for (total, value) in sums.values.iter_mut().zip(part) {
            *total += weight * value;
        }
    }
    sums
}

/// `Σ w (1, d, d²)` of the distances.
#[inline(never)]
pub(super) fn distances<T: Real>(view: &View<'_, T>, surface: &Tilted<T>, limits: &Limits<T>, of: Candidates) -> Sums<T, 3> {
    sum_over_inliers(view, surface, limits, of, |_, distance, one| {
        let masked = one * distance;
        [one, masked, masked * distance]
    })
}

/// `Σ w (1, d², x, y, xx, xy, yy)` about `center`: what is seen from above.
#[inline(never)]
pub(super) fn moments_from_above<T: Real>(
    view: &View<'_, T>,
    surface: &Tilted<T>,
    limits: &Limits<T>,
    of: Candidates,
    center: [T; 3],
) -> Sums<T, 7> {
    sum_over_inliers(view, surface, limits, of, |[x, y, _], distance, one| {
        let (x, y) = (x - center[0], y - center[1]);
        let (on_x, on_y) = (one * x, one * y);
        [one, one * distance * distance, on_x, on_y, on_x * x, on_x * y, on_y * y]
    })
}

/// `Σ w (1, d², x, y, z, xx, xy, xz, yy, yz, zz)` about `center`.
#[inline(never)]
pub(super) fn moments<T: Real>(view: &View<'_, T>, surface: &Tilted<T>, limits: &Limits<T>, of: Candidates, center: [T; 3]) -> Sums<T, 11> {
    sum_over_inliers(view, surface, limits, of, |[x, y, z], distance, one| {
        let (x, y, z) = (x - center[0], y - center[1], z - center[2]);
        let (on_x, on_y, on_z) = (one * x, one * y, one * z);
        [one, one * distance * distance, on_x, on_y, on_z, on_x * x, on_x * y, on_x * z, on_y * y, on_y * z, on_z * z]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robust::ransac::Generator;
    use std::vec::Vec;

    #[test]
    fn lanes_one_by_one_are_the_same_sum_bit_for_bit() {
        let mut generator = Generator::new(1);
        for len in [0, 1, 15, 16, 17, 48, 50, 333] {
            let mut column = || -> Vec<f32> { (0..len).map(|_| generator.below(1 << 20) as f32 * 1e-3 - 500.0).collect() };
            let (a, b) = (column(), column());
            let term = |[a, b]: [f32; 2]| [a, a * b, b * b];
            assert_eq!(sum_lanes([&a, &b], term).map(f32::to_bits), sum_lane_by_lane([&a, &b], term).map(f32::to_bits), "{len}");
        }
    }
}
