//! Planes from points: what is found in rooms under noise, outliers and a wrong gravity, what is not found in spheres, stairs and slanted
//! boards, and that names stay. Figures with `--nocapture`.

use std::f64::consts::TAU;

use libella_core::plane::associate::{AssociateConfig, UpdateReport};
use libella_core::plane::fit::{self, FitConfig, FitError};
use libella_core::plane::{
    Detections, Orientation, Plane, PlaneClass, PlaneEvent, PlaneId, PlaneMap, Sample, SampleError, Samples, Source,
};
use libella_core::real::Real;
use libella_core::robust::ransac::{Generator, draws};
use libella_core::time::Timestamp;
use nalgebra::{Rotation3, UnitVector3, Vector3};

/// A point and the normal of the surface there.
type Point = (Vector3<f64>, Vector3<f64>);
/// Points of a shape, as many as asked for or nearly.
type Shape = fn(&mut Generator, usize) -> Vec<Point>;
type Map = PlaneMap<f64, 16, 16>;
type Found = Detections<f64, 16, 16>;

fn uniform(generator: &mut Generator, low: f64, high: f64) -> f64 {
    low + (high - low) * generator.unit::<f64>()
}

/// Box and Muller.
fn normal(generator: &mut Generator) -> f64 {
    let radius = (-2.0 * (1.0 - generator.unit::<f64>()).ln()).sqrt();
    radius * (TAU * generator.unit::<f64>()).cos()
}

fn direction(generator: &mut Generator) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(generator)).normalize()
}

/// Points on the rectangle `corner + s a + t b`, with its normal.
fn rectangle(generator: &mut Generator, count: usize, corner: [f64; 3], a: [f64; 3], b: [f64; 3]) -> Vec<Point> {
    let [corner, a, b] = [corner, a, b].map(Vector3::from);
    let normal = a.cross(&b).normalize();
    (0..count).map(|_| (corner + a * generator.unit::<f64>() + b * generator.unit::<f64>(), normal)).collect()
}

/// 5 m × 4 m × 2.6 m with a table, seen in full; the floor at −1.2 m. Points in proportion to areas, on a table of
/// 1.6 m × 1 m six times as dense.
fn room(generator: &mut Generator, count: usize) -> Vec<Point> {
    let share = |area: f64| (count as f64 * area / 96.4) as usize;
    let mut points = rectangle(generator, share(20.0), [0.0, 0.0, -1.2], [5.0, 0.0, 0.0], [0.0, 4.0, 0.0]);
    points.extend(rectangle(generator, share(20.0), [0.0, 0.0, 1.4], [5.0, 0.0, 0.0], [0.0, 4.0, 0.0]));
    points.extend(rectangle(generator, share(13.0), [0.0, 0.0, -1.2], [5.0, 0.0, 0.0], [0.0, 0.0, 2.6]));
    points.extend(rectangle(generator, share(13.0), [0.0, 4.0, -1.2], [5.0, 0.0, 0.0], [0.0, 0.0, 2.6]));
    points.extend(rectangle(generator, share(10.4), [0.0, 0.0, -1.2], [0.0, 4.0, 0.0], [0.0, 0.0, 2.6]));
    points.extend(rectangle(generator, share(10.4), [5.0, 0.0, -1.2], [0.0, 4.0, 0.0], [0.0, 0.0, 2.6]));
    points.extend(rectangle(generator, share(9.6), [2.0, 1.0, -0.45], [1.6, 0.0, 0.0], [0.0, 1.0, 0.0]));
    points
}

/// The planes of [`room`] but for the table.
fn room_planes() -> [Plane<f64>; 6] {
    [(2, -1.2), (2, 1.4), (1, 0.0), (1, 4.0), (0, 0.0), (0, 5.0)].map(|(axis, at)| {
        let normal_in_world = UnitVector3::new_unchecked(Vector3::ith(axis, 1.0));
        Plane { normal_in_world, offset_m: -at }
    })
}

/// How points are measured.
#[derive(Clone, Copy)]
struct Measured {
    sigma_m: f64,
    /// Of normals, about each axis; none without.
    sigma_normal_rad: Option<f64>,
    outliers: f64,
    depth_share: f64,
}

const CLEAN: Measured = Measured { sigma_m: 0.01, sigma_normal_rad: Some(0.05), outliers: 0.0, depth_share: 0.5 };

/// Noise on every point, and outliers in addition: as many as make up that share of all, anywhere in the box about the points.
fn measure(generator: &mut Generator, points: &[Point], measured: Measured) -> Vec<Sample<f64>> {
    let (mut low, mut high) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
    for (point, _) in points {
        (low, high) = (low.inf(point), high.sup(point));
    }
    let outliers = (points.len() as f64 * measured.outliers / (1.0 - measured.outliers)) as usize;
    let mut all: Vec<Point> = points.to_vec();
    for _ in 0..outliers {
        all.push((Vector3::from_fn(|axis, _| uniform(generator, low[axis], high[axis])), direction(generator)));
    }
    let noisy = |generator: &mut Generator, (point, normal_in_world): &Point| {
        let off = Vector3::from_fn(|_, _| normal(generator)) * measured.sigma_m;
        let turned = measured.sigma_normal_rad.map(|sigma| {
            let turn = Vector3::from_fn(|_, _| normal(generator)) * sigma;
            // Normals have no sign to rely on.
            Rotation3::new(turn) * normal_in_world * if generator.below(2) == 0 { 1.0 } else { -1.0 }
        });
        let source = if generator.unit::<f64>() < measured.depth_share {
            Source::Depth { uncertainty: uniform(generator, 0.0, 0.8) }
        } else {
            Source::MapPoint
        };
        Sample { point_in_world: point + off, normal_in_world: turned, source }
    };
    let mut samples: Vec<_> = all.iter().map(|point| noisy(generator, point)).collect();
    shuffle(generator, &mut samples);
    samples
}

fn shuffle<V>(generator: &mut Generator, values: &mut [V]) {
    for k in (1..values.len()).rev() {
        values.swap(k, generator.below(k + 1));
    }
}

fn filled<T: Real>(points: &[Sample<f64>], up: Vector3<f64>, config: &FitConfig<T>) -> Box<Samples<T, 4000>> {
    let mut samples = Box::new(Samples::new(&UnitVector3::new_normalize(up.map(T::of)), config.normal_tolerance_rad));
    for Sample { point_in_world, normal_in_world, source } in points {
        let source = match source {
            Source::MapPoint => Source::MapPoint,
            Source::Depth { uncertainty } => Source::Depth { uncertainty: T::of(*uncertainty) },
        };
        let sample = Sample { point_in_world: point_in_world.map(T::of), normal_in_world: normal_in_world.map(|n| n.map(T::of)), source };
        samples.push(&sample).expect("a usable sample, and room for it");
    }
    samples
}

fn detect(points: &[Sample<f64>], up: Vector3<f64>, config: &FitConfig<f64>, seed: u64) -> Found {
    let mut found = Found::default();
    found.detect(&mut filled(points, up, config), None, config, &mut Generator::new(seed));
    found
}

/// Angle, rad, and distance at a point, m, between an estimate and the truth.
fn errors(estimate: &Plane<f64>, truth: &Plane<f64>, at: &Vector3<f64>) -> (f64, f64) {
    let estimate = estimate.aligned_with(truth);
    (estimate.angle_rad(truth), (estimate.distance_m(at) - truth.distance_m(at)).abs())
}

/// A least share that planes of a sixth of the points reach beside many outliers.
fn of_many_outliers() -> FitConfig<f64> {
    let mut config = FitConfig::default();
    config.ransac.least_inlier_ratio = 0.05;
    config
}

#[test]
fn the_paper_mixes_its_logarithms() {
    assert_eq!([3, 2, 1].map(|n| draws(0.99_f64, 0.2, n)), [574, 113, 21]);
    let mixed = |n: i32| (0.01_f64.log10() / (1.0 - 0.2_f64.powi(n)).ln()).round();
    assert_eq!([3, 2, 1].map(mixed), [249.0, 49.0, 9.0]);
}

/// Recall of the six planes of a room, found per room beside them and the table, and the worst errors.
fn monte_carlo<T: Real>(measured: Measured, rooms: u64) -> (f64, f64, f64, f64) {
    let mut config = FitConfig::<T>::default();
    config.ransac.least_inlier_ratio = T::of(0.05);
    let (mut hits, mut others, mut worst_rad, mut worst_m) = (0, 0, 0.0_f64, 0.0_f64);
    for seed in 0..rooms {
        let mut generator = Generator::new(1000 + seed);
        let points = room(&mut generator, 1000);
        let samples = measure(&mut generator, &points, measured);
        let mut found = Detections::<T, 16, 16>::default();
        found.detect(&mut filled::<T>(&samples, Vector3::z(), &config), None, &config, &mut Generator::new(seed));
        let mut unmatched: Vec<_> = found
            .iter()
            .map(|detection| Plane {
                normal_in_world: UnitVector3::new_normalize(detection.fit.plane.normal_in_world.map(|x| x.as_f64())),
                offset_m: detection.fit.plane.offset_m.as_f64(),
            })
            .collect();
        let middle = Vector3::new(2.5, 2.0, 0.1);
        for truth in room_planes() {
            let best = unmatched.iter().position(|plane| {
                let (angle, off) = errors(plane, &truth, &middle);
                angle < 0.1 && off < 0.1
            });
            let Some(best) = best else { continue };
            let (angle, off) = errors(&unmatched.remove(best), &truth, &middle);
            (worst_rad, worst_m) = (worst_rad.max(angle), worst_m.max(off));
            hits += 1;
        }
        unmatched.retain(|plane| {
            (plane.normal_in_world.z.abs() - 1.0).abs() > 1e-3 || (plane.distance_m(&Vector3::new(0.0, 0.0, -0.45))).abs() > 0.05
        });
        others += unmatched.len();
    }
    (hits as f64 / (6 * rooms) as f64, others as f64 / rooms as f64, worst_rad, worst_m)
}

#[test]
fn rooms_are_found_under_noise_and_outliers() {
    for (name, measured) in [
        ("1 cm, normals", CLEAN),
        ("1 cm, normals, 30 % outliers", Measured { outliers: 0.3, ..CLEAN }),
        ("3 cm, normals of 6°, 30 % outliers", Measured { sigma_m: 0.03, sigma_normal_rad: Some(0.1), outliers: 0.3, ..CLEAN }),
        ("1 cm, no normals, 30 % outliers", Measured { sigma_normal_rad: None, outliers: 0.3, ..CLEAN }),
    ] {
        let (double, single) = (monte_carlo::<f64>(measured, 100), monte_carlo::<f32>(measured, 100));
        for (scalar, (recall, others, worst_rad, worst_m)) in [("f64", double), ("f32", single)] {
            println!(
                "{name}, {scalar}: recall {recall:.3}, others per room {others:.2}, worst {:.2}° {:.1} mm",
                worst_rad.to_degrees(),
                worst_m * 1e3
            );
            assert!(recall >= 0.97, "{name} {scalar}: {recall}");
            assert!(others <= 0.1, "{name} {scalar}: {others}");
            assert!(worst_rad < 1_f64.to_radians() && worst_m < 0.03, "{name} {scalar}: {worst_rad} {worst_m}");
        }
    }
}

#[test]
fn errors_are_those_of_the_noise() {
    // The mean of n distances with σ has the deviation σ/√n, if θ cuts nothing off: here at 5 σ.
    let (mut sum, mut squares, rounds) = (0.0, 0.0, 400);
    let mut expected = 0.0;
    for seed in 0..rounds {
        let mut generator = Generator::new(seed);
        let points = rectangle(&mut generator, 100, [0.0, 0.0, 0.7], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]);
        let samples = measure(&mut generator, &points, Measured { depth_share: 0.0, ..CLEAN });
        let mut samples = filled(&samples, Vector3::z(), &FitConfig::<f64>::default());
        let found = fit::horizontal(&mut samples, &FitConfig::default(), &mut generator).expect("nothing else is there");
        let off = -found.plane.offset_m - 0.7;
        (sum, squares) = (sum + off, squares + off * off);
        expected = 0.01 / (found.inliers as f64).sqrt();
    }
    let n = rounds as f64;
    assert!((sum / n).abs() < 3.0 * expected / n.sqrt(), "bias {}", sum / n);
    // χ² of 400: its deviation is √(2/400).
    let ratio = squares / n / (expected * expected);
    assert!((ratio - 1.0).abs() < 4.0 * (2.0 / n).sqrt(), "{ratio}");
}

#[test]
fn a_wrong_gravity_costs_its_own_angle_and_no_more() {
    for degrees in [1.0_f64, 3.0] {
        let (mut floors, mut worst_rad, mut horizontals, mut walls, mut worst_wall) = (0, 0.0_f64, 0, 0, 0.0_f64);
        let rounds = 40;
        for seed in 0..rounds {
            let mut generator = Generator::new(seed);
            let points = room(&mut generator, 1500);
            let samples = measure(&mut generator, &points, Measured { outliers: 0.2, ..CLEAN });
            let about = uniform(&mut generator, 0.0, TAU);
            let axis = UnitVector3::new_unchecked(Vector3::new(about.cos(), about.sin(), 0.0));
            let up = Rotation3::from_axis_angle(&axis, degrees.to_radians()) * Vector3::z();
            let found = detect(&samples, up, &of_many_outliers(), seed);
            for detection in found.iter() {
                let plane = detection.fit.plane;
                let truths = room_planes();
                let truth =
                    truths.iter().find(|truth| plane.angle_rad(truth) < 0.1 && truth.distance_m(&detection.fit.mean_in_world).abs() < 0.05);
                let Some(truth) = truth else { continue };
                if detection.orientation == Orientation::Horizontal {
                    horizontals += 1;
                    floors += usize::from(truth.offset_m == 1.2);
                    worst_rad = worst_rad.max(plane.angle_rad(truth));
                } else {
                    walls += 1;
                    worst_wall = worst_wall.max(plane.angle_rad(truth));
                }
            }
        }
        println!(
            "gravity off by {degrees}°: {floors} floors, {horizontals} floors and ceilings, {walls} walls in {rounds} rooms; worst {:.2}° and {:.2}°",
            worst_rad.to_degrees(),
            worst_wall.to_degrees()
        );
        // One plane for the floor, not several strips of it.
        assert_eq!(floors, rounds as usize);
        assert_eq!(horizontals, 2 * rounds as usize);
        assert!((worst_rad.to_degrees() - degrees).abs() < 1e-3);
        assert!(worst_wall.to_degrees() < degrees + 1.0);
    }
}

fn sphere(generator: &mut Generator, count: usize) -> Vec<Point> {
    (0..count).map(|_| direction(generator)).map(|normal| (normal * 0.5, normal)).collect()
}

/// 12 steps of 17 cm by 28 cm, 1 m wide.
fn stairs(generator: &mut Generator, count: usize) -> Vec<Point> {
    let mut points = Vec::new();
    for step in 0..12 {
        let (x, z) = (0.28 * f64::from(step), 0.17 * f64::from(step));
        points.extend(rectangle(generator, count * 28 / (12 * 45), [x, 0.0, z + 0.17], [0.28, 0.0, 0.0], [0.0, 1.0, 0.0]));
        points.extend(rectangle(generator, count * 17 / (12 * 45), [x, 0.0, z], [0.0, 0.0, 0.17], [0.0, 1.0, 0.0]));
    }
    points
}

/// 1.2 m × 1.2 m, slanted by 20°.
fn board(generator: &mut Generator, count: usize) -> Vec<Point> {
    let (sine, cosine) = 20_f64.to_radians().sin_cos();
    rectangle(generator, count, [0.0; 3], [1.2 * cosine, 0.0, 1.2 * sine], [0.0, 1.2, 0.0])
}

/// Steady planes in 30 looks at a shape, over some seeds, and detections per look.
fn steady_in(shape: Shape, measured: Measured) -> (usize, f64) {
    let (mut steady, mut detections, seeds, looks) = (0, 0, 10, 30);
    for seed in 0..seeds {
        let mut generator = Generator::new(seed);
        let mut map = Map::new();
        for look in 0..looks {
            let points = shape(&mut generator, 600);
            let samples = measure(&mut generator, &points, measured);
            let found = detect(&samples, Vector3::z(), &FitConfig::default(), 100 * seed + look);
            detections += found.len();
            update(&mut map, &found, look, &mut |_| {});
        }
        steady += map.steady().count();
    }
    (steady, detections as f64 / (seeds * looks) as f64)
}

fn update(map: &mut Map, found: &Found, look: u64, on_event: &mut dyn FnMut(PlaneEvent)) -> UpdateReport {
    let now = Timestamp::from_nanos(look as i64 * 1_000_000_000);
    map.update(found, now, &Vector3::zeros(), &AssociateConfig::default(), |_| true, on_event)
}

#[test]
fn spheres_stairs_and_slanted_boards_are_no_planes() {
    let shapes: [(&str, Shape); 3] = [("sphere", sphere), ("stairs", stairs), ("board at 20°", board)];
    for (name, shape) in shapes {
        let with_normals = steady_in(shape, Measured { outliers: 0.1, ..CLEAN });
        let without = steady_in(shape, Measured { outliers: 0.1, sigma_normal_rad: None, ..CLEAN });
        println!(
            "{name}: steady planes in 10 scenes {} with normals, {} without; detections per look {:.3}, {:.3}",
            with_normals.0, without.0, with_normals.1, without.1
        );
        assert_eq!(with_normals.0, 0, "{name}");
    }
    // The inliers' own plane gives the board away even without normals.
    assert_eq!(steady_in(board, Measured { outliers: 0.1, sigma_normal_rad: None, ..CLEAN }).0, 0);
}

#[test]
fn names_stay_through_a_hundred_looks() {
    let mut generator = Generator::new(5);
    let mut map = Map::new();
    let mut named: Vec<(PlaneId, Plane<f64>)> = Vec::new();
    let mut events = Vec::new();
    for look in 0..100 {
        let points = room(&mut generator, 1000);
        let samples = measure(&mut generator, &points, Measured { sigma_m: 0.02, outliers: 0.2, ..CLEAN });
        let found = detect(&samples, Vector3::z(), &of_many_outliers(), look);
        update(&mut map, &found, look, &mut |event| events.push(event));
        if look == 10 {
            named = map.steady().map(|(id, plane)| (id, plane.plane)).collect();
            assert_eq!(named.len(), 7);
        }
        for (id, plane) in &named {
            let now = map.get(*id).expect("the same name");
            assert!(now.plane.angle_rad(plane) < 0.02 && now.plane.normal_in_world.dot(&plane.normal_in_world) > 0.0);
            assert!((now.plane.offset_m - plane.offset_m).abs() < 0.03);
        }
    }
    let count = |is: fn(&PlaneEvent) -> bool| events.iter().filter(|event| is(event)).count();
    let added = count(|event| matches!(event, PlaneEvent::Added(_)));
    println!(
        "{added} added, {} updates, {} steady in the end",
        count(|event| matches!(event, PlaneEvent::Updated(_))),
        map.steady().count()
    );
    assert_eq!(added, map.steady().count());
    assert_eq!(count(|event| matches!(event, PlaneEvent::Removed(_) | PlaneEvent::Merged { .. })), 0);
    let classes: Vec<_> = map.steady().map(|(_, plane)| plane.class).collect();
    for (class, number) in [(PlaneClass::Floor, 1), (PlaneClass::Ceiling, 1), (PlaneClass::Wall, 4), (PlaneClass::Table, 1)] {
        assert_eq!(classes.iter().filter(|other| **other == class).count(), number, "{class:?}");
    }
    let (_, wall) = map.main_wall().expect("four walls");
    assert!((wall.polygon.area_m2() - 13.0).abs() < 1.3, "{}", wall.polygon.area_m2());
}

#[test]
fn two_halves_of_a_wall_become_one() {
    let mut generator = Generator::new(9);
    let mut map = Map::new();
    let mut events = Vec::new();
    let look_at = |map: &mut Map, generator: &mut Generator, look: u64, from: f64, to: f64, events: &mut Vec<PlaneEvent>| {
        let points = rectangle(generator, 200, [from, 2.0, -1.0], [to - from, 0.0, 0.0], [0.0, 0.0, 2.0]);
        let samples = measure(generator, &points, CLEAN);
        let found = detect(&samples, Vector3::z(), &FitConfig::default(), look);
        let now = Timestamp::from_nanos(look as i64);
        // Only what overlaps the view is missed.
        map.update(&found, now, &Vector3::zeros(), &AssociateConfig::default(), |_| false, |event| events.push(event));
    };
    for look in 0..4 {
        look_at(&mut map, &mut generator, look, 0.0, 2.0, &mut events);
    }
    for look in 4..8 {
        look_at(&mut map, &mut generator, look, 4.0, 6.0, &mut events);
    }
    // 2 m apart: two names, until what is between is seen.
    assert_eq!(map.steady().count(), 2);
    let first = map.steady().min_by_key(|(_, plane)| plane.first_seen).map(|(id, _)| id).expect("two");
    for look in 8..12 {
        look_at(&mut map, &mut generator, look, 1.5, 4.5, &mut events);
    }
    assert_eq!(map.steady().count(), 1);
    let (id, wall) = map.steady().next().expect("one");
    assert_eq!(id, first);
    assert!(events.iter().any(|event| matches!(event, PlaneEvent::Merged { into, .. } if *into == first)));
    assert!((wall.polygon.area_m2() - 12.0).abs() < 0.6, "{}", wall.polygon.area_m2());
    assert!(wall.plane.angle_rad(&room_planes()[2]) < 0.01 && wall.plane.distance_m(&Vector3::new(3.0, 2.0, 0.0)).abs() < 0.01);
    assert!(
        map.supporting(&Vector3::new(3.0, 2.03, 0.0), 0.05, 0.1) == Some(first)
            && map.supporting(&Vector3::new(3.0, 2.06, 0.0), 0.05, 0.1).is_none()
    );
    assert!(map.supporting(&Vector3::new(7.0, 2.0, 0.0), 0.05, 0.1).is_none());
}

/// The planes as (normal, offset) in an order that does not depend on how they were found.
fn sorted(found: &Found) -> Vec<Plane<f64>> {
    let mut planes: Vec<_> = found.iter().map(|detection| detection.fit.plane).collect();
    planes.sort_by(|a, b| {
        let key = |plane: &Plane<f64>| {
            plane.normal_in_world.map(|x| (x * 20.0).round()).dot(&Vector3::new(100.0, 10.0, 1.0)) + 0.1 * plane.offset_m
        };
        key(a).total_cmp(&key(b))
    });
    planes
}

#[test]
fn order_signs_yaw_and_place_do_not_matter() {
    for seed in 0..20 {
        let mut generator = Generator::new(seed);
        let points = room(&mut generator, 800);
        // Noise well within θ, so that which points are inliers does not hang on the last digit.
        let measured = Measured { sigma_m: 0.004, sigma_normal_rad: Some(0.02), ..CLEAN };
        let samples = measure(&mut generator, &points, measured);
        let found = detect(&samples, Vector3::z(), &of_many_outliers(), seed);
        assert!(found.len() >= 6, "{}", found.len());
        assert_eq!(*found, *detect(&samples, Vector3::z(), &of_many_outliers(), seed), "the same seed, the same planes");

        let mut flipped = samples.clone();
        flipped.iter_mut().for_each(|sample| sample.normal_in_world = sample.normal_in_world.map(|normal| -normal * 3.0));
        let again = detect(&flipped, Vector3::z(), &of_many_outliers(), seed);
        for (a, b) in found.iter().zip(again.iter()) {
            assert!(a.fit.plane.angle_rad(&b.fit.plane) < 1e-12 && a.fit.inliers == b.fit.inliers);
        }

        let mut shuffled = samples.clone();
        shuffle(&mut generator, &mut shuffled);
        let again = detect(&shuffled, Vector3::z(), &of_many_outliers(), seed + 1);
        assert_eq!(again.len(), found.len());
        for (a, b) in sorted(&found).iter().zip(sorted(&again)) {
            // Points in the corner of two planes go with whichever is found first.
            assert!(a.angle_rad(&b) < 3e-3 && (a.aligned_with(&b).offset_m - b.offset_m).abs() < 3e-3, "{a:?} {b:?}");
        }

        let (turn, shift) =
            (Rotation3::from_axis_angle(&Vector3::z_axis(), uniform(&mut generator, 0.0, TAU)), direction(&mut generator) * 7.0);
        let mut moved = samples.clone();
        for sample in &mut moved {
            sample.point_in_world = turn * sample.point_in_world + shift;
            sample.normal_in_world = sample.normal_in_world.map(|normal| turn * normal);
        }
        let again = detect(&moved, Vector3::z(), &of_many_outliers(), seed);
        assert_eq!(again.len(), found.len());
        for (a, b) in found.iter().zip(again.iter()) {
            assert_eq!((a.fit.inliers, a.orientation), (b.fit.inliers, b.orientation));
            let back = Plane { normal_in_world: turn.inverse() * b.fit.plane.normal_in_world, offset_m: b.fit.plane.distance_m(&shift) };
            assert!(a.fit.plane.angle_rad(&back) < 1e-9 && (a.fit.plane.offset_m - back.aligned_with(&a.fit.plane).offset_m).abs() < 1e-9);
            // The corners are extreme in directions of the plane's own axes: horizontal ones do not turn along.
            assert!((a.polygon.area_m2() - b.polygon.area_m2()).abs() < 0.1 * a.polygon.area_m2());
        }
    }
}

#[test]
fn any_up_will_do() {
    // The room and gravity turned together: the same planes, turned.
    let mut generator = Generator::new(3);
    let points = room(&mut generator, 800);
    let samples = measure(&mut generator, &points, Measured { sigma_m: 0.004, sigma_normal_rad: Some(0.02), ..CLEAN });
    let found = detect(&samples, Vector3::z(), &of_many_outliers(), 1);
    for _ in 0..20 {
        let turn = Rotation3::new(direction(&mut generator) * uniform(&mut generator, 0.0, 3.1));
        let turned: Vec<_> = samples
            .iter()
            .map(|sample| Sample {
                point_in_world: turn * sample.point_in_world,
                normal_in_world: sample.normal_in_world.map(|n| turn * n),
                ..*sample
            })
            .collect();
        let again = detect(&turned, turn * Vector3::z(), &of_many_outliers(), 1);
        assert_eq!(again.len(), found.len());
        for (a, b) in found.iter().zip(again.iter()) {
            assert_eq!((a.fit.inliers, a.orientation), (b.fit.inliers, b.orientation));
            assert!((turn.inverse() * b.fit.plane.normal_in_world).cross(&a.fit.plane.normal_in_world).norm() < 1e-9);
        }
    }
}

#[test]
fn lines_and_lumps_are_no_planes() {
    let config = FitConfig::<f64>::default();
    let mut generator = Generator::new(1);
    let fitted = |points: Vec<Vector3<f64>>| {
        let points: Vec<_> = points.into_iter().map(|point| (point, Vector3::z())).collect();
        let measured = Measured { sigma_m: 0.003, sigma_normal_rad: None, outliers: 0.0, depth_share: 0.0 };
        let samples = measure(&mut Generator::new(2), &points, measured);
        let mut samples = filled(&samples, Vector3::z(), &config);
        let mut generator = Generator::new(3);
        let single = [
            fit::horizontal(&mut samples, &config, &mut generator),
            fit::vertical(&mut samples, &config, &mut generator),
            fit::free(&mut samples, &config, &mut generator),
        ];
        let mut found = Found::default();
        found.detect(&mut samples, None, &config, &mut generator);
        (single, found.len())
    };
    // A plumb line: no two points are apart horizontally, and a slab at one height holds a lump of it.
    let ([horizontal, vertical, free], planes) = fitted((0..200).map(|k| Vector3::new(1.0, 2.0, 0.01 * f64::from(k))).collect());
    assert!(matches!(vertical, Err(FitError::NoConsensus)) && matches!(free, Err(FitError::NoConsensus)), "{vertical:?} {free:?}");
    assert!(horizontal.is_err() && planes == 0);
    // A level line lies on planes of every kind.
    let ([horizontal, vertical, _], planes) = fitted((0..200).map(|k| Vector3::new(0.01 * f64::from(k), 2.0, 1.0)).collect());
    assert!(matches!(horizontal, Err(FitError::Thin(width)) if width < 0.1), "{horizontal:?}");
    assert!(matches!(vertical, Err(FitError::Thin(_))), "{vertical:?}");
    assert_eq!(planes, 0);
    // One point many times over.
    let (single, planes) = fitted((0..200).map(|_| Vector3::new(0.3, 0.2, 0.1)).collect());
    assert!(single.iter().all(Result::is_err) && planes == 0);
    // A slanted board is a plane to who knows no gravity.
    let points = board(&mut generator, 200).into_iter().map(|(point, _)| point).collect();
    let ([horizontal, _, free], planes) = fitted(points);
    assert!(matches!(horizontal, Err(FitError::Tilted(angle)) if (angle - 20_f64.to_radians()).abs() < 0.1), "{horizontal:?}");
    assert!(free.is_ok_and(|fit| (fit.plane.normal_in_world.z - 20_f64.to_radians().cos()).abs() < 0.01) && planes == 0);
}

#[test]
fn solvers_agree_where_their_planes_are_the_same() {
    let config = of_many_outliers();
    let mut generator = Generator::new(8);
    for seed in 0..20 {
        let points = room(&mut generator, 1000);
        let samples = measure(&mut generator, &points, Measured { outliers: 0.2, ..CLEAN });
        let mut samples = filled(&samples, Vector3::z(), &config);
        let wall = Vector3::x_axis();
        let two = fit::vertical(&mut samples, &config, &mut Generator::new(seed)).expect("walls");
        let along = fit::along_wall(&mut samples, &wall, &config, &mut Generator::new(seed)).expect("two walls");
        let across = fit::across_wall(&mut samples, &wall, &config, &mut Generator::new(seed)).expect("two walls");
        assert!(along.plane.normal_in_world.dot(&wall).abs() == 1.0 && across.plane.normal_in_world.dot(&wall).abs() < 1e-15);
        let nearest = if two.plane.angle_rad(&along.plane) < 0.5 { [5.0, 0.0] } else { [4.0, 0.0] };
        assert!(nearest.iter().any(|at| (two.plane.offset_m.abs() - at).abs() < 0.02), "{two:?}");
        // With one freedom less the inliers are about the same.
        let same = [along, across]
            .into_iter()
            .find(|one| errors(&one.plane, &two.plane, &two.mean_in_world).1 < 0.02 && one.plane.angle_rad(&two.plane) < 0.02);
        if let Some(same) = same {
            assert!((same.inliers as f64 / two.inliers as f64 - 1.0).abs() < 0.1);
        }
        let three = fit::free(&mut samples, &config, &mut Generator::new(seed)).expect("planes");
        assert!(room_planes().iter().any(|truth| three.plane.angle_rad(truth) < 0.02), "{three:?}");
    }
}

#[test]
fn what_is_not_a_point_is_refused() {
    let mut samples = Samples::<f32, 3>::new(&Vector3::z_axis(), 0.2);
    let at = |x: f32| Sample { point_in_world: Vector3::new(x, 0.0, 0.0), normal_in_world: None, source: Source::MapPoint };
    for x in [f32::NAN, f32::INFINITY, 2e4] {
        assert_eq!(samples.push(&at(x)), Err(SampleError::Coordinate));
    }
    for uncertainty in [f32::NAN, -0.1, 1.1] {
        assert_eq!(samples.push(&Sample { source: Source::Depth { uncertainty }, ..at(0.0) }), Err(SampleError::Uncertainty));
    }
    assert!(samples.is_empty());
    // A normal that is none counts as unknown, so that it speaks for anything.
    for normal in [Vector3::repeat(f32::NAN), Vector3::zeros(), Vector3::repeat(f32::INFINITY)] {
        assert_eq!(samples.push(&Sample { normal_in_world: Some(normal), ..at(1.0) }), Ok(()));
    }
    assert_eq!(samples.push(&at(0.0)), Err(SampleError::Full));
    assert_eq!(samples.len(), 3);
    let mut found = Detections::<f32, 4, 8>::default();
    found.detect(&mut samples, None, &FitConfig::default(), &mut Generator::new(0));
    assert!(found.is_empty() && samples.plane_of(0).is_none() && samples.plane_of(9).is_none());
}

/// A corner mistaken for another may be anywhere, on the plane too.
#[test]
fn a_point_far_out_on_a_plane_does_not_stretch_its_outline() {
    let mut generator = Generator::new(17);
    let mut points = rectangle(&mut generator, 200, [0.0, 0.0, -1.0], [6.0, 0.0, 0.0], [0.0, 4.0, 0.0]);
    let config = FitConfig::default();
    let within = detect(&measure(&mut generator, &points, CLEAN), Vector3::z(), &config, 1);
    let area_m2 = within.first().unwrap().polygon.area_m2();
    assert!((19.0..25.0).contains(&area_m2), "{area_m2}");
    for far_m in [15.0, 80.0, 260.0] {
        points.truncate(200);
        points.push((Vector3::new(3.0 - far_m, 2.0, -1.0), Vector3::z()));
        let found = detect(&measure(&mut generator, &points, CLEAN), Vector3::z(), &config, 1);
        let polygon = &found.first().unwrap().polygon;
        assert!((polygon.area_m2() - area_m2).abs() < 0.1 * area_m2, "{far_m} m: {} m2", polygon.area_m2());
    }
}

/// What lies evenly on a rectangle, however long, is in its outline to the corners.
#[test]
fn corners_of_a_long_wall_are_in_its_outline() {
    let mut generator = Generator::new(18);
    for length in [2.0, 6.0, 20.0] {
        let points = rectangle(&mut generator, 600, [0.0, 3.0, 0.0], [length, 0.0, 0.0], [0.0, 0.0, 2.5]);
        let found = detect(&measure(&mut generator, &points, CLEAN), Vector3::z(), &FitConfig::default(), 1);
        let wall = found.first().unwrap();
        for (x, z) in [(0.0, 0.0), (length, 0.0), (0.0, 2.5), (length, 2.5)] {
            let off_m = wall.polygon.distance_m(wall.fit.plane.project(&Vector3::new(x, 3.0, z))).unwrap();
            assert!(off_m < 0.1 * length.max(2.5), "{length} m: {off_m} m");
        }
    }
}

#[test]
fn nothing_is_found_in_nothing() {
    let config = FitConfig::<f64>::default();
    let mut samples = Samples::<f64, 0>::new(&Vector3::z_axis(), 0.2);
    let mut generator = Generator::new(0);
    assert_eq!(fit::horizontal(&mut samples, &config, &mut generator), Err(FitError::NoConsensus));
    assert_eq!(fit::vertical(&mut samples, &config, &mut generator), Err(FitError::NoConsensus));
    assert_eq!(fit::free(&mut samples, &config, &mut generator), Err(FitError::NoConsensus));
    assert_eq!(fit::along_wall(&mut samples, &Vector3::x_axis(), &config, &mut generator), Err(FitError::NoConsensus));
    assert_eq!(fit::across_wall(&mut samples, &Vector3::z_axis(), &config, &mut generator), Err(FitError::NoConsensus));
    let mut found = Found::default();
    found.detect(&mut samples, None, &config, &mut generator);
    assert!(found.is_empty());
    let mut map = PlaneMap::<f64, 0, 16>::new();
    let report = map.update(&found, Timestamp::from_nanos(0), &Vector3::zeros(), &AssociateConfig::default(), |_| true, |_| {});
    assert_eq!((report, map.is_empty()), (UpdateReport::default(), true));
}

#[test]
fn a_full_map_keeps_what_is_steady_and_makes_room_for_what_is_not_old() {
    let mut generator = Generator::new(4);
    let points = room(&mut generator, 1000);
    let samples = measure(&mut generator, &points, CLEAN);
    let mut found = Detections::<f64, 16, 16>::default();
    found.detect(&mut filled(&samples, Vector3::z(), &of_many_outliers()), None, &of_many_outliers(), &mut generator);
    assert!(found.len() >= 6);
    let (few, more) = found.split_at(3);
    let mut map = PlaneMap::<f64, 3, 16>::new();
    let config = AssociateConfig::default();
    let mut removed = 0;
    let mut look = |map: &mut PlaneMap<f64, 3, 16>, detections: &[_]| {
        map.update(
            detections,
            Timestamp::from_nanos(0),
            &Vector3::zeros(),
            &config,
            |_| false,
            |event| {
                removed += usize::from(matches!(event, PlaneEvent::Removed(_)));
            },
        )
    };
    assert_eq!(look(&mut map, few).inserted, 3);
    // None is steady yet: unseen, they make room for the next.
    assert_eq!(look(&mut map, &more[..3]), UpdateReport { inserted: 3, retired: 3, ..UpdateReport::default() });
    for _ in 0..3 {
        assert_eq!(look(&mut map, &more[..3]).matched, 3);
    }
    // Steady: they stay, until nobody has seen them for long.
    for round in 1..=12 {
        let report = look(&mut map, &few[..1]);
        match round {
            ..10 => assert_eq!(report, UpdateReport { refused: 1, ..UpdateReport::default() }),
            10 => assert_eq!((report.inserted, report.retired), (1, 1)),
            _ => assert_eq!(report.matched, 1),
        }
    }
    assert_eq!(removed, 1);
    // Not all planes found fit into fewer places.
    let mut little = Detections::<f64, 2, 16>::default();
    little.detect(&mut filled(&samples, Vector3::z(), &of_many_outliers()), None, &of_many_outliers(), &mut generator);
    assert_eq!(little.len(), 2);
}

#[test]
fn a_plane_that_is_missed_goes_and_one_out_of_view_stays() {
    let mut generator = Generator::new(6);
    let points = rectangle(&mut generator, 200, [0.0, 0.0, -1.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]);
    let samples = measure(&mut generator, &points, CLEAN);
    let found = detect(&samples, Vector3::z(), &FitConfig::default(), 1);
    let nothing = Found::default();
    let mut map = Map::new();
    let mut events = Vec::new();
    let look = |map: &mut Map, found: &Found, in_view: bool, events: &mut Vec<PlaneEvent>| {
        map.update(
            found,
            Timestamp::from_nanos(0),
            &Vector3::zeros(),
            &AssociateConfig::default(),
            |_| in_view,
            |event| events.push(event),
        );
    };
    for _ in 0..10 {
        look(&mut map, &found, true, &mut events);
    }
    let id = map.steady().next().expect("ten looks").0;
    assert_eq!((events[0], events.len()), (PlaneEvent::Added(id), 8));
    for _ in 0..100 {
        look(&mut map, &nothing, false, &mut events);
    }
    assert_eq!(map.steady().count(), 1);
    // 1 − 0.7¹⁰ = 0.97 of confidence, and 0.97 · 0.7⁶ = 0.11 < 0.15.
    for miss in 1..=6 {
        assert!(map.get(id).is_some(), "{miss}");
        look(&mut map, &nothing, true, &mut events);
    }
    assert!(map.get(id).is_none() && map.is_empty());
    assert_eq!(events.last(), Some(&PlaneEvent::Removed(id)));
    // A plane seen once is gone after two misses, and nobody has heard of it.
    events.clear();
    look(&mut map, &found, true, &mut events);
    assert_eq!(map.len(), 1);
    look(&mut map, &nothing, true, &mut events);
    look(&mut map, &nothing, true, &mut events);
    assert!(map.is_empty() && events.is_empty());
    assert!(!map.remove(id, |_| {}));
}
