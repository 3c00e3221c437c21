//! The best hypothesis, fitted to all its inliers.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use nalgebra::{Matrix3, UnitVector3, Vector3};

use super::scan::{Level, Limits, Sums, Surface, Tilted, Upright, distances, moments, moments_from_above};
use super::{Fit, Found, angle_rad};
use crate::lie::matrix::symmetric_eigen;
use crate::plane::geometry::Plane;
use crate::plane::samples::{Candidates, View};
use crate::real::Real;

/// Fits after the first: the inliers change little after two.
const ROUNDS: usize = 3;

/// What a refinement may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Freedom {
    Offset,
    YawAndOffset,
    All,
}

impl<T: Real> From<Level<T>> for Tilted<T> {
    fn from(level: Level<T>) -> Self {
        Self { normal: [T::ZERO, T::ZERO, T::one()], offset_m: level.offset_m }
    }
}

impl<T: Real> From<Upright<T>> for Tilted<T> {
    fn from(upright: Upright<T>) -> Self {
        Self { normal: [upright.normal[0], upright.normal[1], T::ZERO], offset_m: upright.offset_m }
    }
}

/// Weighted mean and scatter of some samples.
struct Scatter<T: Real> {
    mean: Vector3<T>,
    covariance: Matrix3<T>,
}

impl<T: Real> Scatter<T> {
    fn new(sums: &Sums<T, 11>, center: [T; 3]) -> Option<Self> {
        let [weight, _, x, y, z, xx, xy, xz, yy, yz, zz] = sums.values;
        if !(weight > T::ZERO) {
            return None;
        }
        let shift = Vector3::new(x, y, z) / weight;
        let about_center = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) / weight;
        Some(Self { mean: Vector3::from(center) + shift, covariance: about_center - shift * shift.transpose() })
    }

    /// The normal of the inliers' own plane: across the two major axes.
    fn own_normal(&self) -> Option<Vector3<T>> {
        let eigen = symmetric_eigen(&self.covariance)?;
        let normal: Vector3<T> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
        normal.iter().all(|x| x.is_usable()).then_some(normal)
    }

    fn through_mean(&self, normal: Vector3<T>) -> Tilted<T> {
        Tilted { normal: normal.into(), offset_m: -normal.dot(&self.mean) }
    }

    /// Standard deviations along the minor and the major axis within a plane, m.
    fn extent(&self, plane: &Plane<T>) -> [T; 2] {
        let (e1, e2) = plane.axes();
        let (a, b, c) = (e1.dot(&(self.covariance * e1)), e1.dot(&(self.covariance * e2)), e2.dot(&(self.covariance * e2)));
        let half = T::of(0.5);
        let (middle, apart) = (half * (a + c), (half * (a - c) * half * (a - c) + b * b).root());
        [middle - apart, middle + apart].map(|variance| if variance > T::ZERO { variance.root() } else { T::ZERO })
    }
}

/// `Σ w (1 − d²/θ²)` from `Σ w` and `Σ w d²` of the inliers.
fn score<T: Real>(weight: T, squared: T, limits: &Limits<T>) -> T {
    weight - squared / limits.squared_distance
}

/// The plane of some freedom that fits the inliers of another best, and how good that other is: its score and its inliers.
fn refitted<T: Real>(
    view: &View<'_, T>,
    limits: &Limits<T>,
    of: Candidates,
    surface: &Tilted<T>,
    freedom: Freedom,
    center: [T; 3],
) -> (T, T, Option<Tilted<T>>) {
    let half = T::of(0.5);
    match freedom {
        Freedom::Offset => {
            let Sums { inliers, values: [weight, distance, squared], .. } = distances(view, surface, limits, of);
            let fitted = Tilted { normal: surface.normal, offset_m: surface.offset_m - distance / weight };
            (score(weight, squared, limits), inliers, Some(fitted))
        }
        Freedom::YawAndOffset => {
            let Sums { inliers, values, .. } = moments_from_above(view, surface, limits, of, center);
            let [_, _, x, y, xx, xy, yy] = values.map(|value| value / values[0]);
            // The major axis of what is seen from above; the normal is across it.
            let (xx, xy, yy) = (xx - x * x, xy - x * y, yy - y * y);
            let (sine, cosine) = (half * (xy + xy).arc_tangent(xx - yy)).sine_cosine();
            let mean = [center[0] + x, center[1] + y];
            let fitted = Tilted { normal: [-sine, cosine, T::ZERO], offset_m: sine * mean[0] - cosine * mean[1] };
            (score(values[0], values[1], limits), inliers, Some(fitted))
        }
        Freedom::All => {
            let sums = moments(view, surface, limits, of, center);
            let scatter = Scatter::new(&sums, center);
            (
                score(sums.values[0], sums.values[1], limits),
                sums.inliers,
                scatter.and_then(|scatter| Some(scatter.through_mean(scatter.own_normal()?))),
            )
        }
    }
}

/// Refines a plane on its inliers until these stay the same, [`ROUNDS`] times at most, as long as the score rises.
pub(super) fn refine<T: Real>(
    view: &View<'_, T>,
    limits: &Limits<T>,
    candidates: Candidates,
    hypothesis: Tilted<T>,
    freedom: Freedom,
    draws: usize,
) -> Option<Found<T>> {
    // A point of the plane near the samples, so that squares stay small.
    let point = view.point(view.range(candidates).start);
    let normal = Vector3::from(hypothesis.normal);
    let center: [T; 3] = (point - normal * hypothesis.distance_m(point.into())).into();
    let mut surface = hypothesis;
    let (mut best, mut inliers, mut next) = refitted(view, limits, candidates, &surface, freedom, center);
    for _ in 0..ROUNDS {
        let Some(fitted) = next else { break };
        let (new_score, new_inliers, new_next) = refitted(view, limits, candidates, &fitted, freedom, center);
        // Not a number, where there was no inlier to fit to, is no rise either.
        if !(new_score >= best) {
            break;
        }
        let is_settled = new_inliers == inliers;
        (surface, best, inliers, next) = (fitted, new_score, new_inliers, new_next);
        if is_settled {
            break;
        }
    }
    let sums = moments(view, &surface, limits, candidates, center);
    let scatter = Scatter::new(&sums, center)?;
    let own = scatter.through_mean(scatter.own_normal()?);
    let world_from_level = view.level_from_world.transpose();
    let normal = Vector3::from(surface.normal);
    let plane = Plane { normal_in_world: UnitVector3::new_normalize(world_from_level * normal), offset_m: surface.offset_m }.canonical();
    let level_plane = Plane { normal_in_world: UnitVector3::new_unchecked(normal), offset_m: surface.offset_m };
    let off = surface.distance_m(scatter.mean.into());
    let variance = normal.dot(&(scatter.covariance * normal)) + off * off;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let inliers = sums.inliers.as_f64() as usize;
    let weight = sums.values[0];
    let fit = Fit {
        plane,
        inliers,
        weight,
        score: score(weight, sums.values[1], limits),
        mean_in_world: world_from_level * scatter.mean,
        spread_m: if variance > T::ZERO { variance.root() } else { T::ZERO },
        extent_m: scatter.extent(&level_plane).map(|sigma| sigma * T::of(12.0).root()),
        tilt_rad: angle_rad(&own, &surface),
        draws,
    };
    let theta_m = limits.squared_distance.root();
    let (own, tilt_rad) = if freedom != Freedom::All && T::of(4.0) * fit.tilt_rad * fit.extent_m[1] > theta_m {
        let own = grown(view, limits, candidates, own, fit.score, center);
        (own, angle_rad(&own, &surface))
    } else {
        (own, fit.tilt_rad)
    };
    let fit = Fit { tilt_rad, ..fit };
    Some(Found { surface, candidates, fit, own, has_normals: sums.weight_with_normals * T::of(2.0) >= weight })
}

/// The inliers' own plane, fitted to its own inliers in turn as long as the score rises: a slab cut out of a slanted surface shows only
/// part of the slant, the less the more outliers there are. The plane as it was, where that ends below the score of the slab.
fn grown<T: Real>(
    view: &View<'_, T>,
    limits: &Limits<T>,
    candidates: Candidates,
    own: Tilted<T>,
    score_of_slab: T,
    center: [T; 3],
) -> Tilted<T> {
    let (mut best, mut grown) = (T::ZERO, own);
    let mut next = Some(own);
    for _ in 0..2 * ROUNDS {
        let Some(fitted) = next else { break };
        let (score, _, after) = refitted(view, limits, candidates, &fitted, Freedom::All, center);
        if !(score > best) {
            break;
        }
        (best, grown, next) = (score, fitted, after);
    }
    if best >= score_of_slab { grown } else { own }
}
