//! The planes of a room that is known exactly, what of them a camera has in view, and what was found of them.

use nalgebra::{Isometry3, Point3, Unit, Vector3};

/// A found plane is one of the room if it is this near to a rectangle of it, degrees and m at its middle.
pub const TRUE_ANGLE_DEG: f64 = 5.0;
/// See [`TRUE_ANGLE_DEG`].
pub const TRUE_OFFSET_M: f64 = 0.2;
/// How far beyond the rectangle its middle may be, m.
const BEYOND_M: f64 = 0.5;
/// Smaller rectangles are no planes to be found, m².
const LEAST_AREA_M2: f64 = 0.3;

/// A rectangle seen from the side that its normal points to.
#[derive(Debug, Clone, Copy)]
pub struct Rectangle {
    pub corner: Vector3<f64>,
    /// Unit vectors along its sides, and `u × v`.
    pub axes: [Vector3<f64>; 3],
    pub size_m: [f64; 2],
}

impl Rectangle {
    /// From its corners in order.
    pub fn of(polygon: &[Vector3<f64>]) -> Self {
        let (u, v) = (polygon[1] - polygon[0], polygon[3] - polygon[0]);
        let (length, height) = (u.norm(), v.norm());
        let (u, v) = (u / length, v / height);
        Self { corner: polygon[0], axes: [u, v, u.cross(&v)], size_m: [length, height] }
    }

    pub fn area_m2(&self) -> f64 {
        self.size_m[0] * self.size_m[1]
    }

    pub fn is_level(&self) -> bool {
        self.axes[2].z.abs() > 0.9999
    }

    pub fn is_upright(&self) -> bool {
        self.axes[2].z.abs() < 0.01
    }

    /// Where a ray from the visible side meets it, in units of the ray.
    fn meets(&self, origin: &Vector3<f64>, ray: &Vector3<f64>) -> Option<f64> {
        let approach = self.axes[2].dot(ray);
        let way = self.axes[2].dot(&(self.corner - origin)) / approach;
        if approach >= 0.0 || way <= 0.0 {
            return None;
        }
        let at = origin + ray * way - self.corner;
        (0..2).all(|k| (0.0..=self.size_m[k]).contains(&self.axes[k].dot(&at))).then_some(way)
    }

    /// How far a point is beyond its rim, m.
    fn beyond_m(&self, point: &Vector3<f64>) -> f64 {
        let at = |k: usize| self.axes[k].dot(&(point - self.corner));
        (0..2).map(|k| (-at(k)).max(at(k) - self.size_m[k]).max(0.0)).fold(0.0, f64::hypot)
    }
}

/// The first rectangle that a ray meets, and where, in units of the ray.
pub fn first_hit(room: &[Rectangle], origin: &Vector3<f64>, ray: &Vector3<f64>) -> Option<(usize, f64)> {
    let hits = room.iter().enumerate().filter_map(|(k, rectangle)| Some((k, rectangle.meets(origin, ray)?)));
    hits.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// What of each rectangle a camera has in view, m²; `is_seen` says of normalised image coordinates whether they are in the image.
pub fn areas_in_view(room: &[Rectangle], world_from_camera: &Isometry3<f64>, is_seen: &dyn Fn(f64, f64) -> bool) -> Vec<f64> {
    const STEP: f64 = 0.03;
    let mut areas = vec![0.0; room.len()];
    let origin = world_from_camera.translation.vector;
    for row in -40..40 {
        for column in -40..40 {
            let (x, y) = ((f64::from(column) + 0.5) * STEP, (f64::from(row) + 0.5) * STEP);
            if !is_seen(x, y) {
                continue;
            }
            let ray = world_from_camera.rotation * Vector3::new(x, y, 1.0);
            if let Some((k, depth)) = first_hit(room, &origin, &ray) {
                // dx dy = dA |nᵀX| / z³ of the surface through X with depth z.
                areas[k] += STEP * STEP * depth * depth / room[k].axes[2].dot(&ray).abs();
            }
        }
    }
    areas
}

/// A plane that was found, in the truth's world.
#[derive(Debug, Clone)]
pub struct Candidate {
    pub normal: Unit<Vector3<f64>>,
    pub middle: Vector3<f64>,
    pub stands: bool,
}

impl Candidate {
    /// From its normal and corners in the estimate's world.
    pub fn new(normal: &Vector3<f64>, polygon: &[Vector3<f64>], stands: bool, truth_from_estimate: &Isometry3<f64>) -> Self {
        let middle = polygon.iter().sum::<Vector3<f64>>() / polygon.len().max(1) as f64;
        Self {
            normal: Unit::new_normalize(truth_from_estimate.rotation * normal),
            middle: truth_from_estimate.transform_point(&Point3::from(middle)).coords,
            stands,
        }
    }

    /// Angle (degrees) and distance (m) from a rectangle, where it may be that one.
    pub fn errors(&self, rectangle: &Rectangle) -> Option<(f64, f64)> {
        let normal = rectangle.axes[2];
        let angle_deg = normal.cross(&self.normal).norm().atan2(normal.dot(&self.normal).abs()).to_degrees();
        let offset_m = normal.dot(&(self.middle - rectangle.corner)).abs();
        (angle_deg < TRUE_ANGLE_DEG && offset_m < TRUE_OFFSET_M && rectangle.beyond_m(&self.middle) < BEYOND_M)
            .then_some((angle_deg, offset_m))
    }

    /// The rectangle that it is, with its errors.
    pub fn true_one(&self, room: &[Rectangle]) -> Option<(usize, f64, f64)> {
        let near = room.iter().enumerate().filter(|(_, rectangle)| rectangle.area_m2() >= LEAST_AREA_M2);
        let near = near.filter_map(|(k, rectangle)| self.errors(rectangle).map(|(angle, offset)| (k, angle, offset)));
        near.min_by(|a, b| (a.1 + a.2 / 0.03).total_cmp(&(b.1 + b.2 / 0.03)))
    }
}

/// What was found of a room.
#[derive(Debug, Clone, Default)]
pub struct Score {
    pub floor_found: bool,
    /// Walls in view long enough, and those of them that were found.
    pub walls: usize,
    pub walls_found: usize,
    /// Planes that stand, and those of them that are there.
    pub planes: usize,
    pub planes_true: usize,
    /// Names beyond the first of one rectangle.
    pub flips: usize,
    /// Errors of those that are there, degrees and m.
    pub angles_deg: Vec<f64>,
    pub offsets_m: Vec<f64>,
    /// What is wrong, in words.
    pub remarks: Vec<String>,
}

impl Score {
    /// `seconds` says how long 2 m² or more of each rectangle were in view at once.
    pub fn new(room: &[Rectangle], seconds: &[f64], least_s: f64, found: &[Candidate]) -> Self {
        let mut score = Self::default();
        let standing: Vec<&Candidate> = found.iter().filter(|plane| plane.stands).collect();
        for (rectangle, seconds) in room.iter().zip(seconds) {
            let is_found = standing.iter().any(|plane| plane.errors(rectangle).is_some());
            if rectangle.is_upright() && *seconds >= least_s {
                score.walls += 1;
                score.walls_found += usize::from(is_found);
                if !is_found {
                    score.remarks.push(format!(
                        "missed: wall {:.1?} at {:.2?}, {seconds:.1} s",
                        rectangle.axes[2].as_slice(),
                        rectangle.corner.as_slice()
                    ));
                }
            }
        }
        // The floor is the largest of what looks up.
        let floor = room.iter().filter(|rectangle| rectangle.axes[2].z > 0.999).max_by(|a, b| a.area_m2().total_cmp(&b.area_m2()));
        score.floor_found = floor.is_some_and(|floor| standing.iter().any(|plane| plane.errors(floor).is_some()));
        let mut names = vec![0; room.len()];
        for plane in found {
            let Some((k, angle_deg, offset_m)) = plane.true_one(room) else {
                if plane.stands {
                    score.planes += 1;
                }
                score.remarks.push(format!(
                    "false{}: {:.2?} at {:.2?}",
                    if plane.stands { "" } else { " for a while" },
                    plane.normal.as_slice(),
                    plane.middle.as_slice()
                ));
                continue;
            };
            names[k] += 1;
            if plane.stands {
                score.planes += 1;
                score.planes_true += 1;
                if room[k].is_level() || room[k].is_upright() {
                    score.angles_deg.push(angle_deg);
                    score.offsets_m.push(offset_m);
                }
            }
        }
        score.flips = names.iter().map(|names: &usize| names.saturating_sub(1)).sum();
        score
    }

    pub fn add(&mut self, other: &Self) {
        self.walls += other.walls;
        self.walls_found += other.walls_found;
        self.planes += other.planes;
        self.planes_true += other.planes_true;
        self.flips += other.flips;
        self.angles_deg.extend(&other.angles_deg);
        self.offsets_m.extend(&other.offsets_m);
    }

    pub fn recall(&self) -> f64 {
        self.walls_found as f64 / self.walls.max(1) as f64
    }

    pub fn precision(&self) -> f64 {
        self.planes_true as f64 / self.planes.max(1) as f64
    }

    /// Median and greatest.
    pub fn spread(values: &[f64]) -> (f64, f64) {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        (sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN), sorted.last().copied().unwrap_or(f64::NAN))
    }
}
