//! All planes among some points: the best, then the best of what is left.
//!
//! # Model
//! Round by round the best horizontal plane and, once a main wall is known, the best walls along and across it are sought; the one with
//! the highest score that stands [`fit`](super::fit)'s judgement is taken and its inliers leave. Two points are drawn for a wall of any
//! direction only while there is no main wall, or where one point has found nothing that stands. The first wall found becomes the main one
//! if none was given. What is found but does not stand leaves as well, for no plane, once nothing else does.
//!
//! Where gravity is off by a few degrees, the slab about a horizontal plane covers a strip of the floor only, and the strips beside it would be
//! planes of their own. So the inliers' own plane, as long as it is within the tilt tolerance, takes its inliers along.
//!
//! A point that is on the plane by chance, a corner mistaken for another and a hundred metres off, would stretch the polygon to it for good.
//! What is farther from the inliers' mean than the diagonal of their extent is left out of the polygon: twice as far as the corner of a
//! rectangle that they cover evenly.
//!
//! # Degeneracy
//! Every round takes at least one sample, and there are at most `2 P + 4`; the draws of each are bounded by [`FitConfig::ransac`].

use nalgebra::{UnitVector3, Vector3};

use super::fit::{Fit, FitConfig, FitError, Found, Limits, least_weight, search_horizontal, search_on_wall, search_vertical};
use super::geometry::Orientation;
use super::polygon::{Hull, Polygon};
use super::samples::{Candidates, Samples};
use crate::real::Real;
use crate::robust::ransac::Generator;

/// A plane found in one look at the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection<T: Real, const V: usize> {
    /// The plane and what speaks for it.
    pub fit: Fit<T>,
    /// How it lies.
    pub orientation: Orientation,
    /// Its extent, in the coordinates of [`Plane::project`](super::Plane::project).
    pub polygon: Polygon<T, V>,
}

/// At most `P` planes, the best first.
#[derive(Debug, Clone)]
pub struct Detections<T: Real, const P: usize, const V: usize> {
    planes: heapless::Vec<Detection<T, V>, P>,
}

impl<T: Real, const P: usize, const V: usize> Default for Detections<T, P, V> {
    fn default() -> Self {
        Self { planes: heapless::Vec::new() }
    }
}

impl<T: Real, const P: usize, const V: usize> core::ops::Deref for Detections<T, P, V> {
    type Target = [Detection<T, V>];
    fn deref(&self) -> &[Detection<T, V>] {
        &self.planes
    }
}

impl<T: Real, const P: usize, const V: usize> Detections<T, P, V> {
    /// Seeks planes among all samples; what was found before is forgotten. [`Samples::plane_of`] then tells whose each sample is.
    ///
    /// `main_wall_normal_in_world` is the normal of a wall that others are expected to be parallel or at right angles to.
    pub fn detect<const N: usize>(
        &mut self,
        samples: &mut Samples<T, N>,
        main_wall_normal_in_world: Option<&UnitVector3<T>>,
        config: &FitConfig<T>,
        generator: &mut Generator,
    ) {
        const { assert!(P < u8::MAX as usize) }
        self.planes.clear();
        samples.release();
        let least_weight = least_weight(samples, config);
        let mut main_wall = main_wall_normal_in_world.copied();
        for _ in 0..2 * P + 4 {
            samples.arrange();
            if self.planes.is_full() || samples.view().weight(Candidates::Any) < least_weight {
                break;
            }
            match best(samples, main_wall.as_ref(), config, least_weight, generator) {
                (Some(found), true) => {
                    let detection = self.take(samples, &found, config);
                    if main_wall.is_none() && detection.orientation == Orientation::Vertical {
                        main_wall = Some(detection.fit.plane.normal_in_world);
                    }
                    // There is room: asked above.
                    let _ = self.planes.push(detection);
                }
                (Some(found), false) => {
                    let limits = Limits::new(&samples.view(), config.theta_m);
                    // A slanted surface leaves as a whole, or the next slab through it would be judged by what is left.
                    let slanted = matches!(found.judge(config), Err(FitError::Tilted(_))).then_some(found.own);
                    let is_on = |row| limits.admit(&found.surface, row) || slanted.is_some_and(|own| limits.admit(&own, row));
                    if samples.take(found.candidates, None, is_on) == 0 {
                        break;
                    }
                }
                (None, _) => break,
            }
        }
    }

    /// Takes the samples of a plane out, and their polygon.
    fn take<const N: usize>(&self, samples: &mut Samples<T, N>, found: &Found<T>, config: &FitConfig<T>) -> Detection<T, V> {
        let view = samples.view();
        let limits = Limits::new(&view, config.theta_m);
        let own = found.own_if_tilted(config);
        let plane = found.fit.plane;
        let (e1, e2) = plane.axes();
        let (e1, e2) = (view.level_from_world * e1, view.level_from_world * e2);
        let [minor, major] = found.fit.extent_m;
        let (mean, reach_squared) = (view.level_from_world * found.fit.mean_in_world, minor * minor + major * major);
        let mut hull = Hull::<T, V>::new();
        #[allow(clippy::cast_possible_truncation)]
        let place = self.planes.len() as u8; // P < 255
        samples.take(found.candidates, Some(place), |row| {
            let is_on = limits.admit(&found.surface, row) || own.is_some_and(|own| limits.admit(&own, row));
            if is_on {
                let point = Vector3::new(row[0], row[1], row[2]);
                if (point - mean).norm_squared() <= reach_squared {
                    hull.push([e1.dot(&point), e2.dot(&point)]);
                }
            }
            is_on
        });
        let orientation = if found.candidates == Candidates::Horizontal { Orientation::Horizontal } else { Orientation::Vertical };
        Detection { fit: found.fit, orientation, polygon: hull.polygon() }
    }
}

/// The best of what is left and whether it stands; of what does not stand the best if nothing does.
fn best<T: Real, const N: usize>(
    samples: &mut Samples<T, N>,
    main_wall: Option<&UnitVector3<T>>,
    config: &FitConfig<T>,
    least_weight: T,
    generator: &mut Generator,
) -> (Option<Found<T>>, bool) {
    let mut contest = Contest { standing: None, fallen: None };
    contest.note(search_horizontal(samples, config, least_weight, generator), config);
    if let Some(wall) = main_wall {
        for is_across in [false, true] {
            contest.note(search_on_wall(samples, wall, is_across, config, least_weight, generator), config);
        }
    }
    if main_wall.is_none() || contest.standing.is_none() {
        contest.note(search_vertical(samples, config, least_weight, generator), config);
    }
    let stands = contest.standing.is_some();
    (contest.standing.or(contest.fallen), stands)
}

/// The best plane that stands judgement, and the best that does not.
struct Contest<T: Real> {
    standing: Option<Found<T>>,
    fallen: Option<Found<T>>,
}

impl<T: Real> Contest<T> {
    fn note(&mut self, found: Option<Found<T>>, config: &FitConfig<T>) {
        let Some(found) = found else { return };
        let side = if found.judge(config).is_ok() { &mut self.standing } else { &mut self.fallen };
        if side.as_ref().is_none_or(|other| found.fit.score > other.fit.score) {
            *side = Some(found);
        }
    }
}
