//! The way flown, the truth, points and planes: from above, from the side, and for the view that turns.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::chart::{closed, joined, round_steps};
use super::folder::Output;
use super::html::coordinate;
use crate::eval::align;

/// Points in the view that turns, and in the flat ones.
const MOST_POINTS: usize = 6_000;
const MOST_FLAT_POINTS: usize = 2_000;
/// Corners of a curve.
const MOST_CORNERS: usize = 1_500;
/// Width of a flat view in its own units, and the shapes it may have.
const WIDTH: f64 = 1000.0;
const SHAPES: [f64; 2] = [0.45, 0.85];
/// How far around the way planes are shown, in extents of the way.
const ROOM: f64 = 0.7;

/// Everything in one world, turned about the vertical so that the largest wall lies along an axis.
#[derive(Debug, Clone)]
pub(super) struct Space {
    /// Seconds and place.
    pub way: Vec<(f64, [f64; 3])>,
    pub truth: Vec<(f64, [f64; 3])>,
    pub points: Vec<([f64; 3], [u8; 3])>,
    pub planes: Vec<Polygon>,
    /// Times in which it was not tracking, s.
    pub trouble: Vec<(f64, f64)>,
    /// The ways of several runs, for a comparison.
    pub others: Vec<Vec<(f64, [f64; 3])>>,
}

/// A plane's extent.
#[derive(Debug, Clone)]
pub(super) struct Polygon {
    pub name: String,
    pub class: String,
    pub corners: Vec<[f64; 3]>,
}

impl Space {
    pub fn of(output: &Output, trouble: Vec<(f64, f64)>) -> Self {
        let standing = || output.planes.iter().filter(|plane| plane.gone_into.is_none());
        let wall = standing().filter(|plane| plane.class == "wall").max_by_key(|plane| plane.support);
        let heading = wall.map_or(0.0, |wall| wall.normal_in_world[1].atan2(wall.normal_in_world[0]));
        let (sine, cosine) = (-heading).sin_cos();
        let turned = |[x, y, z]: [f64; 3]| [cosine * x - sine * y, sine * x + cosine * y, z];
        let polygons = standing().map(|plane| Polygon {
            name: format!("{} {}", plane.class, plane.id),
            class: plane.class.clone(),
            corners: plane.polygon_in_world_m.iter().map(|corner| turned(*corner)).collect(),
        });
        let truth = output.frames.iter().filter_map(|frame| Some((output.seconds(frame.stamp_ns), turned(frame.truth?))));
        Self {
            way: output.poses.iter().map(|pose| (output.seconds(pose.stamp_ns), turned(pose.position))).collect(),
            truth: truth.collect(),
            points: thinned(&output.points, MOST_POINTS).map(|(point, color)| (turned(*point), *color)).collect(),
            planes: polygons.collect(),
            trouble,
            others: Vec::new(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.way.is_empty() && self.truth.is_empty()
    }

    /// A flat view: the coordinates `across` and `up`.
    pub fn flat(&self, id: &str, title: &str, across: usize, up: usize) -> String {
        let flat = |point: &[f64; 3]| (point[across], point[up]);
        let corners = self.planes.iter().flat_map(|plane| &plane.corners);
        let ways = self.way.iter().chain(&self.truth).chain(self.others.iter().flatten()).map(|(_, point)| flat(point));
        let Some((from, to)) = bounds(ways) else { return String::new() };
        // A plane may reach far beyond the way, which is what matters.
        let room = ROOM * (to.0 - from.0).max(to.1 - from.1).max(0.1);
        let clipped = corners.map(flat).map(|(x, y)| (x.clamp(from.0 - room, to.0 + room), y.clamp(from.1 - room, to.1 + room)));
        let (low, high) = bounds(clipped.chain([from, to])).unwrap_or((from, to));
        let (wide, tall) = ((high.0 - low.0).max(0.2) * 1.1, (high.1 - low.1).max(0.1) * 1.1);
        let shape = (tall / wide).clamp(SHAPES[0], SHAPES[1]);
        let metres = wide.max(tall / shape);
        let (scale, height) = (WIDTH / metres, WIDTH * shape);
        let middle = (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1));
        let at = |point: &[f64; 3]| {
            let (x, y) = flat(point);
            (0.5 * WIDTH + scale * (x - middle.0), 0.5 * height - scale * (y - middle.1))
        };
        let steps = round_steps(0.0, metres, 8);
        let step = steps.get(1).copied().unwrap_or(1.0);
        let mut svg = String::new();
        let mut grid = String::new();
        let lines = |from: f64, to: f64| (0..60).map(move |k| ((from / step).ceil() + f64::from(k)) * step).take_while(move |at| *at <= to);
        for x in lines(middle.0 - 0.5 * metres, middle.0 + 0.5 * metres) {
            let _ = write!(grid, "M{:.1} 0V{height:.1}", 0.5 * WIDTH + scale * (x - middle.0));
        }
        for y in lines(middle.1 - 0.5 * metres * shape, middle.1 + 0.5 * metres * shape) {
            let _ = write!(grid, "M0 {:.1}H1000", 0.5 * height - scale * (y - middle.1));
        }
        let _ = write!(svg, "<path class=\"grid\" d=\"{grid}\"/>");
        for plane in &self.planes {
            let outline: Vec<_> = plane.corners.iter().map(at).collect();
            let _ = write!(svg, "<path class=\"plane p-{}\" d=\"{}\"/>", plane.class, closed(&outline));
        }
        let mut dots = String::new();
        for (point, _) in thinned(&self.points, MOST_FLAT_POINTS) {
            let (x, y) = at(point);
            if (0.0..=WIDTH).contains(&x) && (0.0..=height).contains(&y) {
                dots.push('M');
                coordinate(&mut dots, x);
                dots.push(' ');
                coordinate(&mut dots, y);
                dots.push_str("h0");
            }
        }
        let _ = write!(svg, "<path class=\"dots\" d=\"{dots}\"/>");
        for (class, curve) in [("truth", &self.truth), ("way", &self.way)] {
            let _ = write!(svg, "<path class=\"{class}\" d=\"{}\"/>", pieces(curve, at));
        }
        for (index, curve) in self.others.iter().enumerate() {
            let _ = write!(svg, "<path class=\"way c{}\" d=\"{}\"/>", index % 8 + 1, pieces(curve, at));
        }
        let trouble: Vec<_> = self.way.iter().filter(|(time, _)| self.is_trouble(*time)).copied().collect();
        let _ = write!(svg, "<path class=\"trouble\" d=\"{}\"/>", pieces(&trouble, at));
        for (class, place) in [("start", self.way.first()), ("end", self.way.last())] {
            if let Some((x, y)) = place.map(|(_, point)| at(point)) {
                let _ = write!(svg, "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"9\"/>");
            }
        }
        format!(
            "<figure class=\"map\" id=\"{id}\"><figcaption><b>{title}</b> <span class=\"unit\">grid {step} m</span></figcaption>\
             <svg viewBox=\"0 0 1000 {height:.0}\" role=\"img\" aria-label=\"{title} of the way flown\">{svg}</svg></figure>"
        )
    }

    fn is_trouble(&self, time: f64) -> bool {
        self.trouble.iter().any(|(from, to)| (*from..=*to).contains(&time))
    }

    /// What the view that turns draws, in millimetres.
    pub fn json(&self) -> Value {
        #[allow(clippy::cast_possible_truncation)]
        let small = |point: &[f64; 3]| point.map(|value| (value * 1e3).round() as i64);
        let curve = |curve: &[(f64, [f64; 3])]| thinned(curve, MOST_CORNERS).map(|(_, point)| small(point)).collect::<Vec<_>>();
        let kinds = [[0x1f, 0x5f, 0xbf], [0xc0, 0x39, 0x2b], [0x7d, 0x5b, 0xa6], [0xd3, 0x8b, 0x1d], [0x2e, 0x8b, 0x57]];
        let kind = |color: &[u8; 3]| kinds.iter().position(|kind| kind == color).map_or(0, |place| place + 1);
        let points: Vec<Value> = self.points.iter().map(|(point, color)| json!([small(point), kind(color)])).collect();
        let planes: Vec<Value> = self
            .planes
            .iter()
            .map(|plane| json!({"name": plane.name, "class": plane.class, "corners": plane.corners.iter().map(small).collect::<Vec<_>>()}))
            .collect();
        json!({"way": curve(&self.way), "truth": curve(&self.truth), "points": points, "planes": planes})
    }
}

/// The ways of several runs on one recording from above, in the world of the first: each is laid onto it where both know the truth.
pub(super) fn overlay(id: &str, outputs: &[&Output]) -> String {
    let Some(first) = outputs.first() else { return String::new() };
    let reference: Vec<(i64, [f64; 3])> = first.frames.iter().filter_map(|frame| Some((frame.stamp_ns, frame.truth?))).collect();
    let mut spaces = Vec::new();
    for output in outputs {
        let truth = |stamp: i64| reference.binary_search_by_key(&stamp, |(stamp, _)| *stamp).ok().and_then(|place| reference.get(place));
        let pairs: Vec<_> = output.frames.iter().filter_map(|frame| Some((frame.truth?.into(), truth(frame.stamp_ns)?.1.into()))).collect();
        let Some(moved) = align(&pairs).map(|found| found.truth_from_estimate) else { continue };
        let laid = |[x, y, z]: [f64; 3]| (moved * nalgebra::Point3::new(x, y, z)).coords.into();
        let way = output.poses.iter().map(|pose| (output.seconds(pose.stamp_ns), laid(pose.position)));
        spaces.push(way.collect::<Vec<_>>());
    }
    if spaces.is_empty() {
        return String::new();
    }
    let truth = reference.iter().map(|(stamp, point)| (first.seconds(*stamp), *point)).collect();
    let space = Space { way: Vec::new(), truth, points: Vec::new(), planes: Vec::new(), trouble: Vec::new(), others: spaces };
    space.flat(id, "From above", 0, 1)
}

fn bounds(points: impl Iterator<Item = (f64, f64)>) -> Option<((f64, f64), (f64, f64))> {
    let (mut low, mut high) = ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
    for (x, y) in points.filter(|(x, y)| x.is_finite() && y.is_finite()) {
        (low, high) = ((low.0.min(x), low.1.min(y)), (high.0.max(x), high.1.max(y)));
    }
    (low.0 <= high.0).then_some((low, high))
}

fn thinned<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    all.iter().step_by(all.len().div_ceil(most).max(1))
}

/// A curve, broken where it pauses for more than half a second.
fn pieces(curve: &[(f64, [f64; 3])], at: impl Fn(&[f64; 3]) -> (f64, f64)) -> String {
    let mut d = String::new();
    for piece in curve.chunk_by(|a, b| b.0 - a.0 < 0.5) {
        let corners: Vec<_> = thinned(piece, MOST_CORNERS).map(|(_, point)| at(point)).collect();
        d += &joined(&corners);
    }
    d
}
