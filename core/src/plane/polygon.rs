//! The extent of a plane: a convex polygon of bounded size.
//!
//! # Model
//! Of a cloud of points `(u, v)` the furthest in each of `V` directions `2πk/V` is kept. These are corners of the convex hull in
//! counterclockwise order; what lies between them and the hull is cut off. Of a disc of radius `r` at most `r (1 − cos π/V)` is lost at the rim:
//! 8 % for 8 corners, 2 % for 16. The points need not be stored, and in any order they give the same polygon but for ties.
//!
//! # Degeneracy
//! One point and segments are polygons without area; their distance is that to the point or segment.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use crate::real::Real;

/// At most `V` corners, counterclockwise, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Polygon<T: Real, const V: usize> {
    corners: [[T; 2]; V],
    len: u8,
}

impl<T: Real, const V: usize> Default for Polygon<T, V> {
    fn default() -> Self {
        Self { corners: [[T::ZERO; 2]; V], len: 0 }
    }
}

/// Keeps the furthest point in each direction.
#[derive(Debug, Clone, Copy)]
pub struct Hull<T: Real, const V: usize> {
    directions: [[T; 2]; V],
    furthest: [T; V],
    corners: [[T; 2]; V],
    is_empty: bool,
}

impl<T: Real, const V: usize> Default for Hull<T, V> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const V: usize> Hull<T, V> {
    /// Without points.
    #[must_use]
    #[allow(clippy::cast_precision_loss)]
    pub fn new() -> Self {
        const { assert!(V >= 3 && V <= 64) }
        let directions = core::array::from_fn(|k| {
            let (sine, cosine) = T::of(core::f64::consts::TAU * k as f64 / V as f64).sine_cosine();
            [cosine, sine]
        });
        Self { directions, furthest: [T::ZERO; V], corners: [[T::ZERO; 2]; V], is_empty: true }
    }

    /// Takes a point in; one that is not finite is passed over.
    #[inline]
    pub fn push(&mut self, [u, v]: [T; 2]) {
        if self.is_empty {
            if !(u.is_usable() && v.is_usable()) {
                return;
            }
            self.is_empty = false;
            self.corners = [[u, v]; V];
            self.furthest = self.directions.map(|[c, s]| c * u + s * v);
            return;
        }
        for ((direction, furthest), corner) in self.directions.iter().zip(&mut self.furthest).zip(&mut self.corners) {
            let reach = direction[0] * u + direction[1] * v;
            if reach > *furthest && reach.is_usable() {
                *furthest = reach;
                *corner = [u, v];
            }
        }
    }

    /// The corners without repetitions.
    #[must_use]
    pub fn polygon(&self) -> Polygon<T, V> {
        let mut polygon = Polygon::default();
        if self.is_empty {
            return polygon;
        }
        let mut len = 0;
        for corner in self.corners {
            if len == 0 || (polygon.corners[len - 1] != corner && polygon.corners[0] != corner) {
                polygon.corners[len] = corner;
                len += 1;
            }
        }
        #[allow(clippy::cast_possible_truncation)]
        {
            polygon.len = len as u8; // V ≤ 64
        }
        polygon
    }
}

impl<T: Real, const V: usize> Polygon<T, V> {
    /// The polygon of some points.
    #[must_use]
    pub fn of(points: impl IntoIterator<Item = [T; 2]>) -> Self {
        let mut hull = Hull::new();
        points.into_iter().for_each(|point| hull.push(point));
        hull.polygon()
    }

    /// Corners `(u, v)`, m, counterclockwise.
    #[must_use]
    pub fn corners(&self) -> &[[T; 2]] {
        &self.corners[..usize::from(self.len)]
    }

    /// m².
    #[must_use]
    pub fn area_m2(&self) -> T {
        let Some(&[u0, v0]) = self.corners().first() else { return T::ZERO };
        self.edges().fold(T::ZERO, |sum, (a, b)| sum + (a[0] - u0) * (b[1] - v0) - (a[1] - v0) * (b[0] - u0)) * T::of(0.5)
    }

    /// The mean of the corners; `None` without corners.
    #[must_use]
    pub fn middle(&self) -> Option<[T; 2]> {
        let count = T::of(f64::from(self.len));
        let sum = self.corners().iter().fold([T::ZERO; 2], |sum, [u, v]| [sum[0] + *u, sum[1] + *v]);
        (self.len > 0).then(|| [sum[0] / count, sum[1] / count])
    }

    /// How far a point is from the edge, m: negative inside. `None` without corners.
    #[must_use]
    pub fn distance_m(&self, point: [T; 2]) -> Option<T> {
        let mut nearest_squared: Option<T> = None;
        let mut inside = self.len >= 3;
        for (a, b) in self.edges() {
            let (along, to) = (minus(b, a), minus(point, a));
            let length_squared = dot(along, along);
            let share = if length_squared > T::ZERO { dot(along, to) / length_squared } else { T::ZERO };
            let share = if share < T::ZERO {
                T::ZERO
            } else if share > T::one() {
                T::one()
            } else {
                share
            };
            let off = [to[0] - along[0] * share, to[1] - along[1] * share];
            let squared = dot(off, off);
            if nearest_squared.is_none_or(|nearest| squared < nearest) {
                nearest_squared = Some(squared);
            }
            inside &= along[0] * to[1] - along[1] * to[0] >= T::ZERO;
        }
        nearest_squared.map(|squared| if inside { -squared.root() } else { squared.root() })
    }

    /// Whether a point is inside the polygon grown by `margin_m` (shrunk, if negative). Never for a point that is not finite.
    #[must_use]
    pub fn contains(&self, point: [T; 2], margin_m: T) -> bool {
        self.distance_m(point).is_some_and(|distance| distance <= margin_m)
    }

    /// Whether two polygons of one plane overlap or come closer than about `margin_m`.
    ///
    /// No line that separates them by more is parallel to an edge of either or across the line of their middles. At corners that face each
    /// other this is generous by a factor of √2 at most.
    #[must_use]
    pub fn overlaps<const W: usize>(&self, other: &Polygon<T, W>, margin_m: T) -> bool {
        let (Some(own), Some(its)) = (self.middle(), other.middle()) else { return false };
        let apart_along = |axis: [T; 2]| {
            let length = dot(axis, axis).root();
            if !(length > T::ZERO) {
                return false;
            }
            let (low, high) = reach(self.corners(), axis);
            let (other_low, other_high) = reach(other.corners(), axis);
            let (gap, other_gap) = (other_low - high, low - other_high);
            gap > margin_m * length || other_gap > margin_m * length
        };
        let across = |(a, b): ([T; 2], [T; 2])| [b[1] - a[1], a[0] - b[0]];
        !(apart_along(minus(its, own))
            || self.edges().any(|edge| apart_along(across(edge)))
            || other.edges().any(|edge| apart_along(across(edge))))
    }

    /// Every corner with the next; one corner with itself.
    fn edges(&self) -> impl Iterator<Item = ([T; 2], [T; 2])> {
        let corners = self.corners();
        corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| (*a, *b))
    }
}

fn minus<T: Real>(a: [T; 2], b: [T; 2]) -> [T; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot<T: Real>(a: [T; 2], b: [T; 2]) -> T {
    a[0] * b[0] + a[1] * b[1]
}

/// The least and the greatest `axisᵀ corner`; there is at least one corner.
fn reach<T: Real>(corners: &[[T; 2]], axis: [T; 2]) -> (T, T) {
    let first = corners.first().map_or(T::ZERO, |corner| dot(*corner, axis));
    corners.iter().fold((first, first), |(low, high), corner| {
        let along = dot(*corner, axis);
        (if along < low { along } else { low }, if along > high { along } else { high })
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn cloud() -> impl Strategy<Value = Vec<[f64; 2]>> {
        prop::collection::vec(prop::array::uniform2(-3.0f64..3.0), 1..60)
    }

    proptest! {
        #[test]
        fn corners_are_convex_counterclockwise_and_from_the_cloud(points in cloud()) {
            let polygon = Polygon::<f64, 16>::of(points.iter().copied());
            let corners = polygon.corners();
            prop_assert!(!corners.is_empty() && corners.len() <= 16);
            prop_assert!(corners.iter().all(|corner| points.contains(corner)));
            for k in 0..corners.len() {
                let [a, b, c] = [0, 1, 2].map(|step| corners[(k + step) % corners.len()]);
                let turn = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
                prop_assert!(turn >= -1e-12, "{turn}");
            }
            prop_assert!(polygon.area_m2() >= -1e-12);
            // Taking the corners again changes nothing.
            prop_assert_eq!(Polygon::of(corners.iter().copied()), polygon);
        }

        #[test]
        fn no_point_is_far_outside(points in cloud()) {
            let polygon = Polygon::<f64, 16>::of(points.iter().copied());
            let mut reversed = points.clone();
            reversed.reverse();
            prop_assert_eq!(Polygon::of(reversed), polygon);
            // Between neighbouring directions the cut corner is at most (edge/2) tan(π/16) high.
            let longest = points.iter().flat_map(|a| points.iter().map(move |b| (a[0] - b[0]).hypot(a[1] - b[1]))).fold(0.0, f64::max);
            for point in &points {
                let outside = polygon.distance_m(*point).unwrap();
                prop_assert!(outside <= 0.5 * longest * (core::f64::consts::PI / 16.0).tan() + 1e-12, "{outside}");
            }
        }

        #[test]
        fn overlap_is_symmetric_and_shifts_with_both(a in cloud(), b in cloud(), shift in prop::array::uniform2(-5.0f64..5.0), margin in 0.0f64..0.5) {
            let moved = |points: &[[f64; 2]], s: [f64; 2]| Polygon::<f64, 8>::of(points.iter().map(|p| [p[0] + s[0], p[1] + s[1]]));
            let (p, q) = (moved(&a, [0.0; 2]), moved(&b, shift));
            prop_assert_eq!(p.overlaps(&q, margin), q.overlaps(&p, margin));
            // A common point is an overlap; a gap beyond √2 margins is none.
            if q.corners().iter().any(|corner| p.contains(*corner, 0.0)) {
                prop_assert!(p.overlaps(&q, 0.0));
            }
            let nearest = p.corners().iter().flat_map(|c| q.distance_m(*c)).chain(q.corners().iter().flat_map(|c| p.distance_m(*c))).fold(9e9, f64::min);
            if !p.overlaps(&q, margin) {
                prop_assert!(nearest > margin - 1e-12);
            }
        }
    }

    #[test]
    fn a_square_by_hand() {
        let square = Polygon::<f64, 8>::of([[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.0, 2.0]]);
        assert_eq!((square.corners().len(), square.area_m2(), square.middle()), (4, 4.0, Some([1.0, 1.0])));
        assert_eq!(square.distance_m([1.0, 0.5]), Some(-0.5));
        assert_eq!(square.distance_m([5.0, 6.0]), Some(5.0));
        assert!(square.contains([2.1, 1.0], 0.11) && !square.contains([2.1, 1.0], 0.09) && !square.contains([1.0, 0.05], -0.1));
        let apart = Polygon::<f64, 8>::of([[2.5, 0.0], [3.0, 0.0], [3.0, 1.0]]);
        assert!(square.overlaps(&apart, 0.51) && !square.overlaps(&apart, 0.49));
        // A cross has no corner inside the other.
        let (wide, tall) = (
            Polygon::<f64, 8>::of([[-2.0, -0.1], [2.0, -0.1], [2.0, 0.1], [-2.0, 0.1]]),
            Polygon::<f64, 8>::of([[-0.1, -2.0], [0.1, -2.0], [0.1, 2.0], [-0.1, 2.0]]),
        );
        assert!(wide.overlaps(&tall, 0.0));
    }

    #[test]
    fn without_area() {
        let nothing = Polygon::<f64, 8>::of([]);
        assert_eq!((nothing.area_m2(), nothing.middle(), nothing.distance_m([0.0, 0.0])), (0.0, None, None));
        let point = Polygon::<f64, 8>::of([[1.0, 2.0]; 5]);
        assert_eq!((point.corners().len(), point.area_m2(), point.distance_m([4.0, 6.0])), (1, 0.0, Some(5.0)));
        let segment = Polygon::<f64, 8>::of([[0.0, 0.0], [2.0, 0.0]]);
        assert_eq!((segment.corners().len(), segment.area_m2()), (2, 0.0));
        assert!(segment.contains([1.0, 0.1], 0.2) && !segment.contains([2.5, 0.0], 0.2));
        assert!(!nothing.overlaps(&point, 1.0) && point.overlaps(&segment, 2.01) && !point.overlaps(&segment, 1.99));
        let broken = Polygon::<f64, 8>::of([[f64::NAN, 0.0], [f64::INFINITY, 1.0], [1.0, 1.0], [f64::NAN, f64::NAN], [f64::INFINITY, 0.0]]);
        assert_eq!(broken.corners(), [[1.0, 1.0]]);
        assert!(!segment.contains([f64::NAN, 0.0], 9.0));
    }
}
