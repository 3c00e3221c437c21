//! One plane among many points, with as few points per guess as gravity allows.
//!
//! # Model
//! Gravity leaves a horizontal plane one degree of freedom and a vertical one two, so that samples are smaller and fewer draws contain a
//! clean one with probability `p`, of a share `w` of inliers:
//! ```text
//! k = ln(1 − p) / ln(1 − wⁿ)        p = 0.99, w = 0.2:  21 draws of 1 point, 113 of 2, 574 of 3
//! ```
//! (The paper prints 9, 49 and 249: the common logarithm above and the natural one below. The ratio between solvers is the same.)
//!
//! | solver | points | degrees of freedom | for |
//! |---|---|---|---|
//! | [`horizontal`] | 1 | `d` | floor, ceiling, table |
//! | [`along_wall`], [`across_wall`] | 1 | `d` | walls parallel or at right angles to a known one (Manhattan) |
//! | [`vertical`] | 2 | yaw, `d` | any wall |
//! | [`free`] | 3 | `n`, `d` | comparison, or gravity unknown |
//!
//! A sample is an inlier if `|nᵀx + d| < θ` and, where it has a normal `m`, `|nᵀm| ≥ cos` of the tolerance. Hypotheses are compared by
//! the truncated cost `Σ w (1 − (nᵀx + d)²/θ²)` over inliers, `w` = 1 for map points and ½ for points of a depth map. The best is refined
//! on its inliers in its own degrees of freedom, in closed form, and keeps its number of degrees of freedom:
//! ```text
//! horizontal, along, across    d = −nᵀx̄
//! vertical                     yaw = ½ atan2(2 S_xy, S_xx − S_yy) + π/2,  d = −nᵀx̄        S the inliers' scatter about x̄
//! free                         n the eigenvector of S to its least eigenvalue, d = −nᵀx̄
//! ```
//!
//! # Degeneracy
//! Points above each other do not determine a vertical plane, nor points on a line any. Samples too close to that are drawn again, and a
//! consensus whose inliers are a thin strip is [`FitError::Thin`]: a wall cut at one height is no floor. What lies on a slanted surface
//! through the slab is [`FitError::Tilted`]: the inliers' own plane, with all its freedom, is off the assumed one. Inliers without
//! normals that fill the slab evenly are [`FitError::Loose`]: a cut through a solid. That last one is no proof: without normals a vertical
//! cut along a staircase still passes for a wall now and then.
//!
//! # Reference
//! M. Fischler, R. Bolles, "Random Sample Consensus", 1981. P. Ji et al., "CNN-Augmented Visual-Inertial SLAM with Planar Constraints", 2022.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod models;
mod refine;
mod scan;
#[cfg(test)]
mod tests;

use nalgebra::{UnitVector3, Vector3};

use super::geometry::{Plane, angle_between_lines};
use super::samples::{Candidates, Samples};
use crate::real::Real;
use crate::robust::ransac::{Generator, Ransac, SampleModel};
use models::{OnePoint, OnePointOnWall, ThreePoints, TwoPoints};
use refine::Freedom;
pub(super) use scan::Limits;
use scan::{Level, Surface, Tilted, Upright};

/// What makes a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitConfig<T: Real> {
    /// `θ`, m: what an inlier may be off the plane. Default 0.05.
    pub theta_m: T,
    /// What the normal of a sample may differ from the plane's, rad; given to [`Samples::new`]. Default 15°.
    pub normal_tolerance_rad: T,
    /// When to stop drawing, and the least share of the weight of all samples that a plane has. Default 99 %, 0.1, 4603 draws: those of
    /// three points at that share.
    pub ransac: Ransac<T>,
    /// The least number of inliers. Default 12.
    pub least_inliers: usize,
    /// The least horizontal distance of two points, or height of a triangle, m. Default 0.1: twice `θ`.
    pub least_separation_m: T,
    /// The least width of the inliers in the plane, m, `√12` of the standard deviation along their minor axis. Default 0.25.
    pub least_width_m: T,
    /// What the inliers' own plane may be off the assumed orientation, rad. Default 7°: 3° of gravity error and noise.
    pub tilt_tolerance_rad: T,
    /// The greatest root mean square of `|nᵀx + d|/θ` where less than half the inliers have normals. Default 0.53; points that fill the
    /// slab evenly have 0.577, normally distributed ones with `σ = θ` have 0.54, with `σ = θ/2` 0.44.
    pub greatest_spread: T,
}

impl<T: Real> Default for FitConfig<T> {
    fn default() -> Self {
        Self {
            theta_m: T::of(0.05),
            normal_tolerance_rad: T::of(15_f64.to_radians()),
            ransac: Ransac { confidence: T::of(0.99), least_inlier_ratio: T::of(0.1), max_draws: 4603 },
            least_inliers: 12,
            least_separation_m: T::of(0.1),
            least_width_m: T::of(0.25),
            tilt_tolerance_rad: T::of(7_f64.to_radians()),
            greatest_spread: T::of(0.53),
        }
    }
}

/// A plane and the samples that speak for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit<T: Real> {
    /// The plane, canonical.
    pub plane: Plane<T>,
    /// How many samples lie on it.
    pub inliers: usize,
    /// What they weigh.
    pub weight: T,
    /// The truncated cost.
    pub score: T,
    /// Their mean, on the plane but for rounding where the plane is refined.
    pub mean_in_world: Vector3<T>,
    /// Root mean square of their distances from the plane, m.
    pub spread_m: T,
    /// Their width and length in the plane, m: `√12` of the standard deviations along the minor and the major axis.
    pub extent_m: [T; 2],
    /// Angle between the plane and the inliers' own, fitted with all its freedom and, where they differ, to its own inliers again, rad.
    pub tilt_rad: T,
    /// How many samples were drawn.
    pub draws: usize,
}

/// Why there is no plane.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum FitError<T: Real> {
    /// Nothing has the least share of inliers or their least number.
    NoConsensus,
    /// The inliers are a strip of this width, m.
    Thin(T),
    /// The inliers' own plane is off the assumed orientation by this angle, rad.
    Tilted(T),
    /// The inliers fill the slab: the root mean square of their distances is this share of `θ`.
    Loose(T),
}

impl<T: Real> core::fmt::Display for FitError<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoConsensus => f.write_str("too few samples on any plane"),
            Self::Thin(width_m) => write!(f, "the samples on the plane are a strip of {width_m} m"),
            Self::Tilted(angle_rad) => write!(f, "the samples lie on a plane tilted by {angle_rad} rad"),
            Self::Loose(share) => write!(f, "the samples are spread over {share} of the threshold"),
        }
    }
}

impl<T: Real> core::error::Error for FitError<T> {}

/// The best horizontal plane, by samples of one point.
///
/// # Errors
/// Why there is none.
pub fn horizontal<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    config: &FitConfig<T>,
    generator: &mut Generator,
) -> Result<Fit<T>, FitError<T>> {
    judged(samples, config, |samples, least_weight| search_horizontal(samples, config, least_weight, generator))
}

/// The best vertical plane, by samples of two points.
///
/// # Errors
/// Why there is none.
pub fn vertical<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    config: &FitConfig<T>,
    generator: &mut Generator,
) -> Result<Fit<T>, FitError<T>> {
    judged(samples, config, |samples, least_weight| search_vertical(samples, config, least_weight, generator))
}

/// The best vertical plane parallel to a wall, by samples of one point.
///
/// # Errors
/// Why there is none.
pub fn along_wall<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    wall_normal_in_world: &UnitVector3<T>,
    config: &FitConfig<T>,
    generator: &mut Generator,
) -> Result<Fit<T>, FitError<T>> {
    judged(samples, config, |samples, least_weight| search_on_wall(samples, wall_normal_in_world, false, config, least_weight, generator))
}

/// The best vertical plane at right angles to a wall, by samples of one point.
///
/// # Errors
/// Why there is none.
pub fn across_wall<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    wall_normal_in_world: &UnitVector3<T>,
    config: &FitConfig<T>,
    generator: &mut Generator,
) -> Result<Fit<T>, FitError<T>> {
    judged(samples, config, |samples, least_weight| search_on_wall(samples, wall_normal_in_world, true, config, least_weight, generator))
}

/// The best plane of any orientation, by samples of three points.
///
/// # Errors
/// Why there is none.
pub fn free<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    config: &FitConfig<T>,
    generator: &mut Generator,
) -> Result<Fit<T>, FitError<T>> {
    judged(samples, config, |samples, least_weight| search_free(samples, config, least_weight, generator))
}

/// A plane in the level frame, with what is known of it, not yet judged.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found<T: Real> {
    pub surface: Tilted<T>,
    pub candidates: Candidates,
    pub fit: Fit<T>,
    /// The inliers' own plane.
    pub own: Tilted<T>,
    /// Whether at least half of the inliers' weight has normals.
    has_normals: bool,
}

impl<T: Real> Found<T> {
    /// The inliers' own plane, where its tilt makes a difference within their extent.
    pub fn own_if_tilted(&self, config: &FitConfig<T>) -> Option<Tilted<T>> {
        (T::of(2.0) * self.fit.tilt_rad * self.fit.extent_m[1] >= config.theta_m).then_some(self.own)
    }

    /// What is wrong with it, if anything.
    pub fn judge(&self, config: &FitConfig<T>) -> Result<(), FitError<T>> {
        let Fit { inliers, extent_m: [width_m, _], tilt_rad, spread_m, .. } = self.fit;
        let spread = spread_m / config.theta_m;
        if inliers < config.least_inliers {
            return Err(FitError::NoConsensus);
        }
        if !(width_m >= config.least_width_m) {
            return Err(FitError::Thin(width_m));
        }
        if !(tilt_rad <= config.tilt_tolerance_rad) {
            return Err(FitError::Tilted(tilt_rad));
        }
        if !self.has_normals && !(spread <= config.greatest_spread) {
            return Err(FitError::Loose(spread));
        }
        Ok(())
    }
}

/// What a plane must weigh: the least share of all samples that are still candidates for anything.
pub(super) fn least_weight<T: Real, const N: usize>(samples: &mut Samples<T, N>, config: &FitConfig<T>) -> T {
    samples.arrange();
    samples.view().weight(Candidates::Any) * config.ransac.least_inlier_ratio
}

/// What a search finds, where it stands.
fn judged<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    config: &FitConfig<T>,
    search: impl FnOnce(&mut Samples<T, N>, T) -> Option<Found<T>>,
) -> Result<Fit<T>, FitError<T>> {
    let least_weight = least_weight(samples, config);
    let found = search(samples, least_weight).ok_or(FitError::NoConsensus)?;
    found.judge(config).map(|()| found.fit)
}

pub(super) fn search_horizontal<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    config: &FitConfig<T>,
    least_weight: T,
    generator: &mut Generator,
) -> Option<Found<T>> {
    samples.arrange();
    let view = samples.view();
    let limits = Limits::new(&view, config.theta_m);
    let (surface, draws) = run(&OnePoint { view, limits }, config, least_weight, generator)?;
    refine::refine(&view, &limits, Level::<T>::CANDIDATES, surface, Freedom::Offset, draws)
}

pub(super) fn search_vertical<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    config: &FitConfig<T>,
    least_weight: T,
    generator: &mut Generator,
) -> Option<Found<T>> {
    samples.arrange();
    let view = samples.view();
    let limits = Limits::new(&view, config.theta_m);
    let items = TwoPoints { view, limits, least_separation_m: config.least_separation_m };
    let (surface, draws) = run(&items, config, least_weight, generator)?;
    refine::refine(&view, &limits, Upright::<T>::CANDIDATES, surface, Freedom::YawAndOffset, draws)
}

pub(super) fn search_on_wall<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    wall_normal_in_world: &UnitVector3<T>,
    is_across: bool,
    config: &FitConfig<T>,
    least_weight: T,
    generator: &mut Generator,
) -> Option<Found<T>> {
    samples.arrange();
    let view = samples.view();
    let normal = view.level_from_world * wall_normal_in_world.into_inner();
    let length = (normal.x * normal.x + normal.y * normal.y).root();
    if !(length > T::of(0.5)) {
        return None; // no wall
    }
    let (x, y) = (normal.x / length, normal.y / length);
    let limits = Limits::new(&view, config.theta_m);
    let items = OnePointOnWall { view, limits, normal: if is_across { [-y, x] } else { [x, y] } };
    let (surface, draws) = run(&items, config, least_weight, generator)?;
    refine::refine(&view, &limits, Upright::<T>::CANDIDATES, surface, Freedom::Offset, draws)
}

fn search_free<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    config: &FitConfig<T>,
    least_weight: T,
    generator: &mut Generator,
) -> Option<Found<T>> {
    samples.arrange();
    let view = samples.view();
    let limits = Limits::new(&view, config.theta_m);
    let items = ThreePoints { view, limits, least_separation_m: config.least_separation_m };
    let (surface, draws) = run(&items, config, least_weight, generator)?;
    refine::refine(&view, &limits, Candidates::Any, surface, Freedom::All, draws)
}

/// The best hypothesis, and how many draws it took.
type Best<T> = (Tilted<T>, usize);

/// The driver, with the least weight as a share of what the candidates weigh.
fn run<T: Real, P: SampleModel<T, K>, const K: usize>(
    items: &P,
    config: &FitConfig<T>,
    least_weight: T,
    generator: &mut Generator,
) -> Option<Best<T>>
where
    P::Model: Into<Tilted<T>>,
{
    let share = least_weight / items.total_weight();
    if !(share <= T::one()) {
        return None;
    }
    let consensus = Ransac { least_inlier_ratio: share, ..config.ransac }.run(items, generator)?;
    Some((consensus.model.into(), consensus.draws))
}

/// How far a plane of the level frame is off another, rad.
fn angle_rad<T: Real>(a: &Tilted<T>, b: &Tilted<T>) -> T {
    angle_between_lines(&a.normal.into(), &b.normal.into())
}
