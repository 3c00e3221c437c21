//! Planes that keep their names: matched, merged, retired.
//!
//! # Model
//! A detection is taken for a known plane of its orientation if the angle between both, the distance of either's middle from the other, and
//! the gap between the polygons are small enough; of several known ones for the nearest. The plane is then blended with it, evenly over what was
//! seen at first and with a least share later:
//! ```text
//! share = max(1/(hits + 1), least share)        nᵀx + d ← (1 − share)(nᵀx + d) + share (n'ᵀx + d'),  normalised
//! confidence ← confidence + gain (1 − confidence)  when seen,   confidence (1 − gain)  when it should have been
//! ```
//! A detection that matches nothing is a plane of its own, not yet *steady*: nobody hears of it until it has been seen several times. Known
//! planes that turn out to be near-coplanar and to overlap become one, under the name of the steady or else the older one. A plane is
//! retired when its confidence is spent; a tentative one needs few misses for that, a steady one many. The caller says which planes should
//! have been seen: a wall behind the camera loses nothing.
//!
//! # Degeneracy
//! When the map is full, room is made by the least confident tentative plane not seen in this update, or else by the plane not seen for
//! the longest time if that is [`AssociateConfig::forget_after`] updates or more; otherwise the detection is refused and counted.

use nalgebra::Vector3;

use super::detect::Detection;
use super::geometry::Orientation;
use super::tracked::{PlaneClass, PlaneId, TrackedPlane};
use crate::real::Real;
use crate::storage::slots::{SlotId, Slots};
use crate::time::Timestamp;

/// What has become of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlaneEvent {
    /// It has become steady.
    Added(PlaneId),
    /// A steady one has been seen again.
    Updated(PlaneId),
    /// A steady one is now part of another, under the other's name.
    Merged {
        /// The name that is valid from now on.
        into: PlaneId,
        /// The name that is not valid any more.
        gone: PlaneId,
    },
    /// A steady one is no more.
    Removed(PlaneId),
}

/// When a plane is the same, and how long it is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AssociateConfig<T: Real> {
    /// The greatest angle to a plane that a detection is taken for, rad. Default 10°.
    pub match_angle_rad: T,
    /// The greatest distance of either's middle from the other plane, m. Default 0.1: less than a step of a staircase.
    pub match_distance_m: T,
    /// The greatest gap between the polygons, m. Default 0.5.
    pub match_gap_m: T,
    /// The same for two planes to become one. Default 5°.
    pub merge_angle_rad: T,
    /// Default 0.07 m.
    pub merge_distance_m: T,
    /// Default 0.2 m.
    pub merge_gap_m: T,
    /// The least share of a new detection in a plane. Default 0.05: what was seen 20 detections ago is forgotten.
    pub least_share: T,
    /// What a detection adds to the confidence, of what is missing to 1. Default 0.3.
    pub confidence_gain: T,
    /// The confidence below which a plane is retired. Default 0.15: five misses from near 1, two from one detection.
    pub least_confidence: T,
    /// Detections that make a plane steady. Default 3.
    pub steady_after: u16,
    /// Updates without being seen after which a plane may have to make room. Default 10.
    pub forget_after: u32,
    /// What belongs to the floor although it is this much higher, m. Default 0.1.
    pub floor_slack_m: T,
    /// Lowest and highest table above the floor, m. Default 0.4 and 1.2.
    pub table_heights_m: [T; 2],
    /// The lowest ceiling above the floor, m. Default 1.9.
    pub ceiling_height_m: T,
}

impl<T: Real> Default for AssociateConfig<T> {
    fn default() -> Self {
        Self {
            match_angle_rad: T::of(10_f64.to_radians()),
            match_distance_m: T::of(0.1),
            match_gap_m: T::of(0.5),
            merge_angle_rad: T::of(5_f64.to_radians()),
            merge_distance_m: T::of(0.07),
            merge_gap_m: T::of(0.2),
            least_share: T::of(0.05),
            confidence_gain: T::of(0.3),
            least_confidence: T::of(0.15),
            steady_after: 3,
            forget_after: 10,
            floor_slack_m: T::of(0.1),
            table_heights_m: [T::of(0.4), T::of(1.2)],
            ceiling_height_m: T::of(1.9),
        }
    }
}

/// What an update did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct UpdateReport {
    /// Detections of known planes.
    pub matched: usize,
    /// Detections of new ones.
    pub inserted: usize,
    /// Planes that became part of another.
    pub merged: usize,
    /// Planes retired, forgotten or replaced.
    pub retired: usize,
    /// Detections for which there was no room.
    pub refused: usize,
}

/// At most `P` planes of at most `V` corners.
///
/// Bytes, single precision with 8 corners: 134 per plane.
#[derive(Debug, Clone)]
pub struct PlaneMap<T: Real, const P: usize, const V: usize> {
    planes: Slots<TrackedPlane<T, V>, P>,
    updates: u32,
}

impl<T: Real, const P: usize, const V: usize> Default for PlaneMap<T, P, V> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const P: usize, const V: usize> PlaneMap<T, P, V> {
    /// Without planes.
    #[must_use]
    pub const fn new() -> Self {
        Self { planes: Slots::new(), updates: 0 }
    }

    /// All planes, steady or not, by place.
    pub fn iter(&self) -> impl Iterator<Item = (PlaneId, &TrackedPlane<T, V>)> {
        self.planes.iter().map(|(id, plane)| (PlaneId(id), plane))
    }

    /// The planes fit for use.
    pub fn steady(&self) -> impl Iterator<Item = (PlaneId, &TrackedPlane<T, V>)> {
        self.iter().filter(|(_, plane)| plane.is_steady)
    }

    /// The plane of a name.
    #[must_use]
    pub fn get(&self, id: PlaneId) -> Option<&TrackedPlane<T, V>> {
        self.planes.get(id.0)
    }

    /// How many planes there are, steady or not.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.planes.len()
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.planes.is_empty()
    }

    /// The steady wall with the largest extent: the one that Manhattan directions are taken from.
    #[must_use]
    pub fn main_wall(&self) -> Option<(PlaneId, &TrackedPlane<T, V>)> {
        let mut best: Option<(T, (PlaneId, &TrackedPlane<T, V>))> = None;
        for candidate in self.steady().filter(|(_, plane)| plane.orientation == Orientation::Vertical) {
            let area = candidate.1.polygon.area_m2();
            if best.is_none_or(|(largest, _)| area > largest) {
                best = Some((area, candidate));
            }
        }
        best.map(|(_, wall)| wall)
    }

    /// The steady plane nearest to a point, among those that support it.
    #[must_use]
    pub fn supporting(&self, point_in_world: &Vector3<T>, theta_m: T, margin_m: T) -> Option<PlaneId> {
        let mut best: Option<(T, PlaneId)> = None;
        for (id, plane) in self.steady().filter(|(_, plane)| plane.supports(point_in_world, theta_m, margin_m)) {
            let distance = plane.plane.distance_m(point_in_world).abs();
            if best.is_none_or(|(nearest, _)| distance < nearest) {
                best = Some((distance, id));
            }
        }
        best.map(|(_, id)| id)
    }

    /// Moves a plane along its normal, where what lies on it has drifted.
    pub fn shift(&mut self, id: PlaneId, by_m: T) {
        if let Some(known) = self.planes.get_mut(id.0) {
            known.plane.offset_m += by_m;
        }
    }

    /// Retires a plane that has shown itself wrong; whether there was one.
    pub fn remove(&mut self, id: PlaneId, mut on_event: impl FnMut(PlaneEvent)) -> bool {
        let removed = self.planes.remove(id.0);
        if removed.is_some_and(|plane| plane.is_steady) {
            on_event(PlaneEvent::Removed(id));
        }
        removed.is_some()
    }

    /// Takes the planes of one detection in.
    ///
    /// `viewer_in_world` is where the camera is, and `should_be_seen` says of a plane that has not been detected whether it ought to have been.
    pub fn update(
        &mut self,
        detections: &[Detection<T, V>],
        now: Timestamp,
        viewer_in_world: &Vector3<T>,
        config: &AssociateConfig<T>,
        should_be_seen: impl Fn(&TrackedPlane<T, V>) -> bool,
        mut on_event: impl FnMut(PlaneEvent),
    ) -> UpdateReport {
        self.updates = self.updates.wrapping_add(1);
        let mut report = UpdateReport::default();
        for detection in detections {
            match self.nearest(detection, config) {
                Some(id) => {
                    report.matched += 1;
                    self.see_again(id, detection, now, config);
                }
                None if self.make_room(&mut report, config, &mut on_event) => {
                    report.inserted += 1;
                    self.insert(detection, now, config);
                }
                None => report.refused += 1,
            }
        }
        report.merged = self.merge(config, &mut on_event);
        report.retired += self.judge(config, should_be_seen, &mut on_event);
        self.classify(viewer_in_world, config);
        report
    }

    /// The known plane that a detection is of.
    fn nearest(&self, detection: &Detection<T, V>, config: &AssociateConfig<T>) -> Option<SlotId> {
        let mut best: Option<(T, SlotId)> = None;
        for (id, known) in self.planes.iter().filter(|(_, known)| known.orientation == detection.orientation) {
            let limits = (config.match_angle_rad, config.match_distance_m, config.match_gap_m);
            let Some(difference) = known.difference(&detection.fit.plane, &detection.polygon, limits.0, limits.1, limits.2) else {
                continue;
            };
            if best.is_none_or(|(least, _)| difference < least) {
                best = Some((difference, id));
            }
        }
        best.map(|(_, id)| id)
    }

    #[allow(clippy::cast_possible_truncation)]
    fn see_again(&mut self, id: SlotId, detection: &Detection<T, V>, now: Timestamp, config: &AssociateConfig<T>) {
        let update = self.updates;
        let Some(known) = self.planes.get_mut(id) else { return };
        let even = T::one() / T::of(f64::from(known.hits) + 1.0);
        known.absorb(&detection.fit.plane, &detection.polygon, even.max(config.least_share));
        let inliers = detection.fit.inliers as u32;
        if known.last_update == update {
            known.inliers += inliers; // another part of it, in the same look
            return;
        }
        known.hits = known.hits.saturating_add(1);
        known.confidence += config.confidence_gain * (T::one() - known.confidence);
        known.inliers = inliers;
        known.last_seen = now;
        known.last_update = update;
    }

    #[allow(clippy::cast_possible_truncation)]
    fn insert(&mut self, detection: &Detection<T, V>, now: Timestamp, config: &AssociateConfig<T>) {
        let _ = self.planes.insert(TrackedPlane {
            plane: detection.fit.plane,
            orientation: detection.orientation,
            class: if detection.orientation == Orientation::Vertical { PlaneClass::Wall } else { PlaneClass::Other },
            polygon: detection.polygon,
            confidence: config.confidence_gain,
            is_steady: false,
            hits: 1,
            inliers: detection.fit.inliers as u32,
            first_seen: now,
            last_seen: now,
            last_update: self.updates,
        });
    }

    /// Whether there is room for one more plane, made if need be.
    fn make_room(&mut self, report: &mut UpdateReport, config: &AssociateConfig<T>, on_event: &mut impl FnMut(PlaneEvent)) -> bool {
        if !self.planes.is_full() {
            return true;
        }
        let update = self.updates;
        let unseen = |plane: &TrackedPlane<T, V>| update.wrapping_sub(plane.last_update);
        let mut least: Option<(T, SlotId)> = None;
        let mut longest: Option<(u32, SlotId)> = None;
        for (id, plane) in self.planes.iter().filter(|(_, plane)| unseen(plane) > 0) {
            if !plane.is_steady && least.is_none_or(|(confidence, _)| plane.confidence < confidence) {
                least = Some((plane.confidence, id));
            }
            if unseen(plane) >= config.forget_after && longest.is_none_or(|(updates, _)| unseen(plane) > updates) {
                longest = Some((unseen(plane), id));
            }
        }
        let Some(id) = least.map(|(_, id)| id).or(longest.map(|(_, id)| id)) else { return false };
        report.retired += 1;
        self.remove(PlaneId(id), on_event)
    }

    /// Makes one of planes that are near-coplanar and overlap; how often.
    fn merge(&mut self, config: &AssociateConfig<T>, on_event: &mut impl FnMut(PlaneEvent)) -> usize {
        let mut merged = 0;
        for first in 0..P {
            for second in first + 1..P {
                let (Some(a), Some(b)) = (self.planes.id_at(first), self.planes.id_at(second)) else { continue };
                let (Some(plane_a), Some(plane_b)) = (self.planes.get(a).copied(), self.planes.get(b).copied()) else { continue };
                let limits = (config.merge_angle_rad, config.merge_distance_m, config.merge_gap_m);
                if plane_a.orientation != plane_b.orientation
                    || plane_a.difference(&plane_b.plane, &plane_b.polygon, limits.0, limits.1, limits.2).is_none()
                {
                    continue;
                }
                let second_stays = (plane_b.is_steady, plane_a.first_seen) > (plane_a.is_steady, plane_b.first_seen);
                let (into, gone, mut stays, goes) = if second_stays { (b, a, plane_b, plane_a) } else { (a, b, plane_a, plane_b) };
                let hits = [stays.hits, goes.hits].map(|hits| T::of(f64::from(hits)));
                stays.absorb(&goes.plane, &goes.polygon, hits[1] / (hits[0] + hits[1]));
                stays.hits = stays.hits.max(goes.hits);
                stays.confidence = stays.confidence.max(goes.confidence);
                stays.first_seen = stays.first_seen.min(goes.first_seen);
                stays.last_seen = stays.last_seen.max(goes.last_seen);
                stays.inliers = stays.inliers.max(goes.inliers);
                if self.updates.wrapping_sub(goes.last_update) < self.updates.wrapping_sub(stays.last_update) {
                    stays.last_update = goes.last_update;
                }
                if let Some(slot) = self.planes.get_mut(into) {
                    *slot = stays;
                }
                self.planes.remove(gone);
                merged += 1;
                if goes.is_steady {
                    on_event(PlaneEvent::Merged { into: PlaneId(into), gone: PlaneId(gone) });
                }
            }
        }
        merged
    }

    /// Settles who is steady, and retires whom nobody believes any more; how many.
    fn judge(
        &mut self,
        config: &AssociateConfig<T>,
        should_be_seen: impl Fn(&TrackedPlane<T, V>) -> bool,
        on_event: &mut impl FnMut(PlaneEvent),
    ) -> usize {
        let (update, mut retired) = (self.updates, 0);
        self.planes.retain(|id, plane| {
            let id = PlaneId(id);
            if plane.last_update == update {
                if plane.is_steady {
                    on_event(PlaneEvent::Updated(id));
                } else if plane.hits >= config.steady_after {
                    plane.is_steady = true;
                    on_event(PlaneEvent::Added(id));
                }
                return true;
            }
            if should_be_seen(plane) {
                plane.confidence *= T::one() - config.confidence_gain;
            }
            if plane.confidence >= config.least_confidence {
                return true;
            }
            retired += 1;
            if plane.is_steady {
                on_event(PlaneEvent::Removed(id));
            }
            false
        });
        retired
    }

    /// Says what the planes are. While there are steady ones, only these tell where the floor is.
    fn classify(&mut self, viewer_in_world: &Vector3<T>, config: &AssociateConfig<T>) {
        let viewer_m = viewer_in_world.z;
        let lowest = |steady_only: bool| {
            let mut floor: Option<T> = None;
            for (_, plane) in self.planes.iter() {
                let height = plane.height_m();
                let may_be = plane.orientation == Orientation::Horizontal && (plane.is_steady || !steady_only) && height < viewer_m;
                if may_be && floor.is_none_or(|floor| height < floor) {
                    floor = Some(height);
                }
            }
            floor
        };
        let floor = lowest(true).or_else(|| lowest(false));
        for (_, plane) in self.planes.iter_mut() {
            let height = plane.height_m();
            plane.class = match (plane.orientation, floor.map(|floor| height - floor)) {
                (Orientation::Vertical, _) => PlaneClass::Wall,
                (Orientation::Horizontal, Some(above)) if above.abs() <= config.floor_slack_m => PlaneClass::Floor,
                (Orientation::Horizontal, Some(above)) if above >= config.ceiling_height_m => PlaneClass::Ceiling,
                (Orientation::Horizontal, Some(above)) if above >= config.table_heights_m[0] && above <= config.table_heights_m[1] => {
                    PlaneClass::Table
                }
                (Orientation::Horizontal, None) if height > viewer_m => PlaneClass::Ceiling,
                (Orientation::Horizontal, _) => PlaneClass::Other,
            };
        }
    }
}
