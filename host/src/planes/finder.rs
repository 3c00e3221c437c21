//! From points to named planes, and from these to the estimator.

use std::collections::BTreeMap;

use libella_core::plane::associate::AssociateConfig;
use libella_core::plane::fit::FitConfig;
use libella_core::plane::{Plane, PlaneClass, PlaneEvent, PlaneId, PlaneMap, TrackedPlane};
use libella_core::profile::Desktop;
use libella_core::real::Real;
use libella_core::time::{Span, Timestamp};
use libella_core::track::TrackId;
use nalgebra::{UnitVector3, Vector3};

use super::depth_look::DepthLook;
use super::depth_points::DepthPoints;
use super::drift;
use super::evidence::{Evidence, LATELY, MARGIN_M, MEMORY};
use super::points::MapPoints;
use super::seeker::{Answer, Question, Seeker};
use crate::fault::Fault;

/// Planes at a time.
pub(super) const PLANES: usize = 16;
/// Corners of a polygon.
pub(super) const CORNERS: usize = 16;
/// Images between two searches: `N_d` of Ji et al.
const SEARCH_EVERY: usize = 30;
/// Images from a snapshot to the one at which its answer is applied.
const ANSWER_AFTER: usize = 10;
/// The least share of all that a search looks at which a plane has to have, among the points of the map alone.
const LEAST_SHARE: f64 = 0.1;
/// The same with depth maps: a tenth of what one image shows is less of what is seen in 15 s of flight. What that lets in, the many sights of maps take out again.
const LEAST_SHARE_WITH_DEPTH: f64 = 0.03;
/// What must lie on a plane before it is moved after them.
const LEAST_FOLLOWED: usize = 12;

/// How planes are found and used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanesConfig {
    /// Whether landmarks are drawn to the planes that they lie on.
    pub used: bool,
    /// A point is on a plane up to this distance, m.
    pub theta_m: f64,
    /// Searches that a plane has to be found in before it counts as steady.
    pub steady_after: u16,
    /// The share of its landmarks' median distance that a plane is moved by with each image. A plane that stays where it was first found holds the
    /// scale of the first seconds, which is the least certain of all.
    pub follow: f64,
    /// Whether a point lies only on planes that its surface is parallel to, where a depth map tells which way that faces.
    pub normals: bool,
}

/// A plane that was steady at some time.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundPlane {
    /// Its name in this run, counted from 1.
    pub id: usize,
    /// What it is in the room.
    pub class: PlaneClass,
    /// Unit normal in world.
    pub normal_in_world: Vector3<f64>,
    /// `d` of `nᵀx + d = 0`, m.
    pub offset_m: f64,
    /// Corners of its extent in world, m.
    pub polygon_in_world: Vec<Vector3<f64>>,
    /// Points of the map that lay on it when it was last found.
    pub support: u32,
    /// Searches that found it.
    pub hits: u16,
    /// When it was first found.
    pub first_seen: Timestamp,
    /// When it was last found.
    pub last_seen: Timestamp,
    /// Why it is no more: the plane it became part of, or zero.
    pub gone_into: Option<usize>,
}

/// The planes and points of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Planes {
    /// By name.
    pub planes: Vec<FoundPlane>,
    /// Points of the map in world, m, with the name of the plane that each lies on.
    pub points: Vec<(Vector3<f64>, Option<usize>)>,
    /// Mean share of the landmarks that were on a plane, where planes were used.
    pub share_on_planes: Option<f64>,
}

impl Planes {
    /// Those that are still there at the end.
    #[must_use]
    pub fn standing(&self) -> Vec<Plane<f64>> {
        let standing = self.planes.iter().filter(|plane| plane.gone_into.is_none());
        standing
            .map(|plane| Plane { normal_in_world: UnitVector3::new_normalize(plane.normal_in_world), offset_m: plane.offset_m })
            .collect()
    }
}

/// Finds planes while an estimator runs.
#[derive(Debug)]
pub struct PlaneFinder {
    config: PlanesConfig,
    association: AssociateConfig<f64>,
    points: MapPoints,
    depth: DepthPoints,
    map: PlaneMap<f64, PLANES, CORNERS>,
    seeker: Seeker,
    /// Images since the world began.
    images: usize,
    /// Snapshots sent out so far.
    searches: u64,
    /// Images since an open question was asked.
    waiting: Option<usize>,
    /// Names of steady planes, and all of them as they were last.
    names: BTreeMap<PlaneId, usize>,
    ledger: BTreeMap<usize, FoundPlane>,
    attached: (usize, usize),
}

impl PlaneFinder {
    /// # Errors
    /// When no thread can be started.
    pub fn new(config: PlanesConfig) -> Result<Self, Fault> {
        let fit = FitConfig { theta_m: config.theta_m, ..FitConfig::default() };
        Ok(Self {
            config,
            association: AssociateConfig { steady_after: config.steady_after, ..AssociateConfig::default() },
            points: MapPoints::default(),
            depth: DepthPoints::default(),
            map: PlaneMap::new(),
            seeker: Seeker::start(fit)?,
            images: 0,
            searches: 0,
            waiting: None,
            names: BTreeMap::new(),
            ledger: BTreeMap::new(),
            attached: (0, 0),
        })
    }

    /// Looks at the landmarks of an estimator that has a pose for the image of `stamp`, and at the depth map of that image.
    pub fn look<T: Real>(&mut self, estimator: &mut Desktop<T>, stamp: Timestamp, depth: Option<&DepthLook<'_>>) {
        let Some(state) = estimator.state() else { return };
        let viewer = state.state.position_in_world.map(Real::as_f64);
        let seen: Vec<_> = estimator.points_in_world().map(|(track, point)| (track, point.map(Real::as_f64))).collect();
        self.see(&seen, &viewer, stamp, depth);
        if self.config.used {
            self.follow(seen.iter().map(|(_, point)| *point));
            let plane_of = |point: &Vector3<T>| {
                let id = self.map.supporting(&point.map(Real::as_f64), self.config.theta_m, MARGIN_M)?;
                let plane = self.map.get(id)?.plane;
                Some(libella_core::plane::Plane {
                    normal_in_world: UnitVector3::new_unchecked(plane.normal_in_world.into_inner().map(T::of)),
                    offset_m: T::of(plane.offset_m),
                })
            };
            self.attached.0 += estimator.attach_planes(|_, point| plane_of(point));
            self.attached.1 += seen.len();
        }
    }

    /// Takes in where landmarks are and where they are seen from, m, and what a depth map shows of them; searches, and applies what was found, when it is
    /// time to.
    pub fn see(&mut self, seen: &[(TrackId, Vector3<f64>)], viewer: &Vector3<f64>, stamp: Timestamp, depth: Option<&DepthLook<'_>>) {
        for (track, point) in seen {
            self.points.note(*track, *point, viewer, stamp);
        }
        if let Some(look) = depth {
            self.depth.note(look, stamp);
            self.points.note_normals(look, stamp);
        }
        self.images += 1;
        if let Some(images) = &mut self.waiting {
            *images += 1;
            if *images == ANSWER_AFTER {
                self.waiting = None;
                if let Some(answer) = self.seeker.answer() {
                    self.take(&answer, stamp, viewer);
                }
            }
        } else if self.images.is_multiple_of(SEARCH_EVERY) {
            self.ask(stamp);
        }
    }

    /// Forgets where everything was: the estimator has started a new world.
    pub fn forget(&mut self) {
        if self.waiting.take().is_some() {
            // Of a world that is no more.
            let _ = self.seeker.answer();
        }
        self.points.clear();
        self.depth.clear();
        self.map = PlaneMap::new();
        self.names.clear();
        self.ledger.clear();
        self.images = 0;
    }

    /// The steady plane that a point in world, m, lies on: its name and what it is.
    #[must_use]
    pub fn plane_at(&self, point: &Vector3<f64>) -> Option<(usize, PlaneClass)> {
        let id = self.map.supporting(point, self.config.theta_m, MARGIN_M)?;
        Some((*self.names.get(&id)?, self.map.get(id)?.class))
    }

    /// The steady planes as they are: name, what each is, and the corners of its extent in world, m.
    pub fn steady(&self) -> impl Iterator<Item = (usize, PlaneClass, Vec<Vector3<f64>>)> {
        self.map.steady().filter_map(|(id, plane)| Some((*self.names.get(&id)?, plane.class, corners_in_world(plane))))
    }

    /// What was found.
    #[must_use]
    pub fn finish(mut self) -> Planes {
        self.record();
        let name =
            |point: &Vector3<f64>| self.map.supporting(point, self.config.theta_m, MARGIN_M).and_then(|id| self.names.get(&id).copied());
        let points = self.points.usable().map(|(_, point)| (point, name(&point))).collect();
        let share = self.attached.0 as f64 / self.attached.1.max(1) as f64;
        Planes { planes: self.ledger.into_values().collect(), points, share_on_planes: self.config.used.then_some(share) }
    }

    fn evidence(&self, now: Timestamp, memory: Span) -> Evidence {
        let evidence = Evidence::gather(&self.points, &self.depth, now, memory, self.config.theta_m);
        if self.config.normals { evidence } else { evidence.without_normals() }
    }

    fn least_share(&self) -> f64 {
        if self.depth.is_empty() { LEAST_SHARE } else { LEAST_SHARE_WITH_DEPTH }
    }

    fn ask(&mut self, now: Timestamp) {
        let evidence = self.evidence(now, MEMORY);
        let main_wall = self.map.main_wall().map(|(_, wall)| wall.plane.normal_in_world);
        self.searches += 1;
        if self.seeker.ask(Question { evidence, main_wall, least_share: self.least_share(), seed: self.searches }) {
            self.waiting = Some(0);
        }
    }

    fn take(&mut self, answer: &Answer, stamp: Timestamp, viewer: &Vector3<f64>) {
        let mut events = Vec::new();
        let (evidence, theta_m) = (self.evidence(stamp, MEMORY), self.config.theta_m);
        let least_share = self.least_share();
        let doubtful = |plane: &TrackedPlane<f64, CORNERS>| evidence.doubts(&plane.plane, &plane.polygon, theta_m, least_share);
        self.map.update(answer, stamp, viewer, &self.association, doubtful, |event| events.push(event));
        let lately = self.evidence(stamp, LATELY);
        while let Some(double) = drift::double(&self.map, &lately, theta_m) {
            self.map.shift(double.older, double.shift_m);
            // What becomes of its name is said here.
            self.map.remove(double.younger, |_| ());
            events.push(PlaneEvent::Merged { into: double.older, gone: double.younger });
        }
        for event in events {
            match event {
                // Not one that turned out to be another just now.
                PlaneEvent::Added(id) if self.map.get(id).is_some() => {
                    let name = self.ledger.len() + 1;
                    self.names.insert(id, name);
                    self.record();
                }
                PlaneEvent::Merged { into, gone } => {
                    if let Some(name) = self.names.remove(&gone) {
                        // A plane that was not steady before takes the name over.
                        match self.names.get(&into).copied() {
                            Some(into) => self.end(name, into),
                            None => {
                                self.names.insert(into, name);
                            }
                        }
                    }
                }
                PlaneEvent::Removed(id) => {
                    if let Some(name) = self.names.remove(&id) {
                        self.end(name, 0);
                    }
                }
                PlaneEvent::Added(_) | PlaneEvent::Updated(_) => {}
            }
        }
        self.record();
    }

    fn end(&mut self, name: usize, into: usize) {
        if let Some(plane) = self.ledger.get_mut(&name) {
            plane.gone_into = Some(into);
        }
    }

    /// Writes down the steady planes as they are.
    fn record(&mut self) {
        for (id, plane) in self.map.steady() {
            let Some(name) = self.names.get(&id).copied() else { continue };
            self.ledger.insert(
                name,
                FoundPlane {
                    id: name,
                    class: plane.class,
                    normal_in_world: plane.plane.normal_in_world.into_inner(),
                    offset_m: plane.plane.offset_m,
                    polygon_in_world: corners_in_world(plane),
                    support: plane.inliers,
                    hits: plane.hits,
                    first_seen: plane.first_seen,
                    last_seen: plane.last_seen,
                    gone_into: None,
                },
            );
        }
    }

    /// Moves each plane after the landmarks that lie on it.
    fn follow(&mut self, points: impl Iterator<Item = Vector3<f64>>) {
        let mut distances: BTreeMap<PlaneId, Vec<f64>> = BTreeMap::new();
        for point in points {
            // Twice as far as a landmark may be that is drawn to it: it must be able to come back.
            if let Some(id) = self.map.supporting(&point, 2.0 * self.config.theta_m, MARGIN_M)
                && let Some(plane) = self.map.get(id)
            {
                distances.entry(id).or_default().push(plane.plane.distance_m(&point));
            }
        }
        for (id, mut distances) in distances.into_iter().filter(|(_, distances)| distances.len() >= LEAST_FOLLOWED) {
            let middle = distances.len() / 2;
            let median = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
            self.map.shift(id, -self.config.follow * median);
        }
    }
}

fn corners_in_world(plane: &TrackedPlane<f64, CORNERS>) -> Vec<Vector3<f64>> {
    plane.polygon.corners().iter().map(|corner| plane.plane.lift(*corner)).collect()
}
