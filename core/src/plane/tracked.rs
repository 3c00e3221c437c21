//! A plane with a history: what it is, where it ends, how far it is believed.

// A comparison that NaN must fail is written as the negation of what must hold.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use nalgebra::Vector3;

use super::geometry::{Orientation, Plane};
use super::polygon::{Hull, Polygon};
use crate::real::Real;
use crate::storage::slots::SlotId;
use crate::time::Timestamp;

/// Names a plane of a [`PlaneMap`](super::PlaneMap) as long as it exists, and nothing afterwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PlaneId(pub(super) SlotId);

impl PlaneId {
    /// An index below the map's capacity, for arrays beside it.
    #[must_use]
    pub const fn place(self) -> usize {
        self.0.place()
    }

    /// The name as a number, for maps of up to 256 planes.
    #[must_use]
    pub const fn number(self) -> u32 {
        self.0.number()
    }
}

/// What a plane is in a room.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum PlaneClass {
    /// The lowest horizontal plane below the viewer, and what is level with it.
    Floor,
    /// Horizontal, [`AssociateConfig::ceiling_height_m`](super::associate::AssociateConfig::ceiling_height_m) or more above the floor; above the viewer, while no floor is known.
    Ceiling,
    /// Vertical.
    Wall,
    /// Horizontal, as high above the floor as a table.
    Table,
    /// Horizontal, none of these.
    Other,
}

/// A plane with a history.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedPlane<T: Real, const V: usize> {
    /// The plane; its sign stays as it was when first seen.
    pub plane: Plane<T>,
    /// How it lies.
    pub orientation: Orientation,
    /// What it is.
    pub class: PlaneClass,
    /// Its extent so far, in the coordinates of [`Plane::project`].
    pub polygon: Polygon<T, V>,
    /// In [0, 1].
    pub confidence: T,
    /// Whether it has been seen often enough to be used, and not been missed too often since.
    pub is_steady: bool,
    /// In how many updates it has been seen.
    pub hits: u16,
    /// How many samples spoke for it when last seen.
    pub inliers: u32,
    /// When it was first seen.
    pub first_seen: Timestamp,
    /// When it was last seen.
    pub last_seen: Timestamp,
    /// The update that saw it last.
    pub(super) last_update: u32,
}

impl<T: Real, const V: usize> TrackedPlane<T, V> {
    /// Whether the foot of a point is inside the polygon grown by `margin_m`, however far the point is from the plane.
    #[must_use]
    pub fn contains(&self, point_in_world: &Vector3<T>, margin_m: T) -> bool {
        self.polygon.contains(self.plane.project(point_in_world), margin_m)
    }

    /// Whether a point is within `theta_m` of the plane and its foot inside the polygon grown by `margin_m`.
    #[must_use]
    pub fn supports(&self, point_in_world: &Vector3<T>, theta_m: T, margin_m: T) -> bool {
        self.plane.distance_m(point_in_world).abs() < theta_m && self.contains(point_in_world, margin_m)
    }

    /// The height of a horizontal plane, m: of its point above the world's origin.
    pub(super) fn height_m(&self) -> T {
        -self.plane.offset_m * self.plane.normal_in_world.z
    }

    /// How far another plane is from being this one: below 1 it may be. `None` beyond any limit.
    pub(super) fn difference(&self, plane: &Plane<T>, polygon: &Polygon<T, V>, angle_rad: T, distance_m: T, gap_m: T) -> Option<T> {
        let angle = self.plane.angle_rad(plane) / angle_rad;
        let its_middle = plane.lift(polygon.middle()?);
        let own_middle = self.plane.lift(self.polygon.middle()?);
        let apart = self.plane.distance_m(&its_middle).abs().max(plane.distance_m(&own_middle).abs()) / distance_m;
        if !(angle <= T::one() && apart <= T::one()) {
            return None;
        }
        let its_corners = Polygon::<T, V>::of(polygon.corners().iter().map(|corner| self.plane.project(&plane.lift(*corner))));
        self.polygon.overlaps(&its_corners, gap_m).then_some(angle + apart)
    }

    /// Blends with another plane and takes its extent in.
    pub(super) fn absorb(&mut self, plane: &Plane<T>, polygon: &Polygon<T, V>, share: T) {
        let Some(blend) = self.plane.blended_with(plane, share) else { return };
        let mut hull = Hull::<T, V>::new();
        for (plane, polygon) in [(&self.plane, &self.polygon), (plane, polygon)] {
            polygon.corners().iter().for_each(|corner| hull.push(blend.project(&plane.lift(*corner))));
        }
        self.plane = blend;
        self.polygon = hull.polygon();
    }
}
