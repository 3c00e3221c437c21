//! The real room of V1_01 in fifty stereo pairs: planes from a network's depth beside those from stereo corners.
//!
//! Two roads: corners of the left image, followed into the right one and triangulated with the stated baseline; and the depth of `euroc` in
//! the left images of every fifth pair, which it was not trained on. Poses and gravity are those of the truth. What lies on which plane is painted
//! over the images in `keyframe_planes.png`, in the folder of the tests' outputs.

use std::path::Path;

use libella_core::camera::{Camera, CameraModel};
use libella_core::image::{ImageView, PyramidPair};
use libella_core::plane::fit::FitConfig;
use libella_core::plane::{Detection, Detections, Orientation, Sample, Samples, Source};
use libella_core::robust::ransac::Generator;
use libella_core::time::Timestamp;
use libella_core::track::{FrontEnd, FrontEndConfig};
use libella_host::calibration::{CameraCalibration, read_camera};
use libella_host::network::{DepthMap, ModelChoice};
use libella_host::planes::DepthLook;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector2, Vector3};

use crate::support::recordings::data;

/// As in the card of the network: number 2, 7, ... in the order of time is not trained on.
const SCORED: usize = 2;
const EVERY: usize = 5;
/// A stereo corner counts up to here, m: a pixel of disparity is 5 % of the depth there.
const FARTHEST_M: f64 = 4.0;
/// What the rays of both cameras may be off, px.
const GATE_PX: f64 = 1.0;

type Found = Vec<Detection<f64, 16>>;

struct Keyframe {
    stamp: Timestamp,
    world_from_body: Isometry3<f64>,
    /// Left and right, 752×480.
    images: [Vec<u8>; 2],
}

const SIZE: (usize, usize) = (752, 480);

fn gray(path: &Path) -> Vec<u8> {
    image::open(path).unwrap().into_luma8().into_raw()
}

fn keyframes(folder: &Path) -> Vec<Keyframe> {
    let table = std::fs::read_to_string(folder.join("keyframes_gt.csv")).unwrap();
    let rows = table.lines().filter(|line| !line.starts_with('#')).map(|line| {
        let (stamp, rest) = line.split_once(',').unwrap();
        let v: Vec<f64> = rest.split(',').map(|field| field.parse().unwrap()).collect();
        let rotation = UnitQuaternion::new_normalize(Quaternion::new(v[3], v[4], v[5], v[6]));
        Keyframe {
            stamp: Timestamp::from_nanos(stamp.parse().unwrap()),
            world_from_body: Isometry3::from_parts(Translation3::new(v[0], v[1], v[2]), rotation),
            images: ["cam0", "cam1"].map(|camera| gray(&folder.join(camera).join("data").join(format!("{stamp}.jpg")))),
        }
    });
    rows.collect()
}

/// Corners of the left image in world, m, from where the right one sees them.
fn stereo_points(keyframe: &Keyframe, [left, right]: [&CameraCalibration; 2]) -> Vec<Vector3<f64>> {
    let mut pyramids: Box<PyramidPair<{ 2 << 20 }>> = Box::default();
    let mut front_end: Box<FrontEnd<400>> = Box::new(FrontEnd::new(FrontEndConfig::for_image(SIZE.0, SIZE.1, 400)));
    let [first, second] = keyframe.images.each_ref().map(|pixels| ImageView::new(pixels, SIZE.0, SIZE.1, SIZE.0).unwrap());
    let levels = front_end.config().levels;
    pyramids.push(&first, levels).unwrap();
    front_end.replenish(&pyramids);
    pyramids.push(&second, levels).unwrap();
    front_end.follow(&pyramids, &left.camera, None::<UnitQuaternion<f64>>);
    let right_from_left = right.body_from_camera.inverse() * left.body_from_camera;
    let world_from_left = keyframe.world_from_body * left.body_from_camera;
    let point = |from: [f32; 2], to: [f32; 2]| {
        let ray = |camera: &CameraModel<f64>, pixel: [f32; 2]| camera.unproject(&pixel.map(f64::from).into());
        let (a, b) = (right_from_left.rotation * ray(&left.camera, from)?, ray(&right.camera, to)?);
        // The place on the left ray that is nearest to the right one: (s a + t) × b = 0 in the least squares.
        let (across, offset) = (a.cross(&b), right_from_left.translation.vector.cross(&b));
        let along = -across.dot(&offset) / across.norm_squared();
        let in_right = a * along + right_from_left.translation.vector;
        let missed = (right.camera.project(&in_right)? - Vector2::from(to.map(f64::from))).norm();
        let in_left = right_from_left.inverse_transform_point(&in_right.into());
        let is_good = missed < GATE_PX && (0.3..FARTHEST_M).contains(&in_left.z);
        is_good.then(|| world_from_left.transform_point(&in_left).coords)
    };
    front_end.tracks().iter().filter_map(|track| point(track.previous, track.pixel)).collect()
}

fn planes_among(samples: impl Iterator<Item = Sample<f64>>, least_share: f64) -> Found {
    let mut config = FitConfig::<f64>::default();
    config.ransac.least_inlier_ratio = least_share;
    let mut all = Box::new(Samples::<f64, 16_384>::new(&Vector3::z_axis(), config.normal_tolerance_rad));
    for sample in samples {
        all.push(&sample).unwrap();
    }
    let mut found = Box::<Detections<f64, 16, 16>>::default();
    found.detect(&mut all, None, &config, &mut Generator::new(1));
    println!("{} planes among {} samples", found.len(), all.len());
    for plane in found.iter() {
        let fit = &plane.fit;
        println!(
            "  {:?} {:.3?} {:.3} m: {} on it, spread {:.3} m, own tilt {:.2} deg, {:.1?} m",
            plane.orientation,
            fit.plane.normal_in_world.as_slice(),
            fit.plane.offset_m,
            fit.inliers,
            fit.spread_m,
            fit.tilt_rad.to_degrees(),
            fit.extent_m
        );
    }
    found.to_vec()
}

fn look_of<'a>(keyframe: &Keyframe, map: &'a DepthMap, left: &'a CameraCalibration) -> DepthLook<'a> {
    let world_from_camera = keyframe.world_from_body * left.body_from_camera;
    DepthLook { map: map.view().unwrap(), camera: &left.camera, world_from_camera, scale: 1.0 }
}

/// What the network sees on the planes of the stereo corners, over half-sized images in two columns: floor blue, tables green, walls red.
fn paint(maps: &[(&Keyframe, DepthMap)], planes: &Found, left: &CameraCalibration) {
    let (width, height) = (SIZE.0 / 2, SIZE.1 / 2);
    let mut sheet = image::RgbImage::new(2 * width as u32, (maps.len().div_ceil(2) * height) as u32);
    let lowest = floor(planes).fit.mean_in_world.z;
    for (place, (keyframe, map)) in maps.iter().enumerate() {
        let look = look_of(keyframe, map, left);
        // Half-sized pixels take the ink of the nearest value of the map.
        let ink_of = |(i, j): (usize, usize)| {
            let (Some(reading), Some(normal)) = (look.value(i, j), look.normal(i, j)) else { return [0; 3] };
            let plane = planes.iter().find(|Detection { fit, polygon, .. }| {
                // Else a band of every wall is at the height of a table.
                let is_along = fit.plane.normal_in_world.dot(&normal).abs() > 0.8;
                let point = &reading.point_in_world;
                is_along && fit.plane.distance_m(point).abs() < 0.15 && polygon.contains(fit.plane.project(point), 0.2)
            });
            match plane.map(|plane| (plane.orientation, plane.fit.mean_in_world.z - lowest)) {
                None => [0, 0, 0],
                Some((Orientation::Vertical, _)) => [100, 0, 0],
                Some((Orientation::Horizontal, above)) if above < 0.1 => [0, 0, 120],
                Some((Orientation::Horizontal, _)) => [0, 90, 0],
            }
        };
        let inks: Vec<[u8; 3]> = (0..map.height).flat_map(|j| (0..map.width).map(move |i| (i, j))).map(ink_of).collect();
        let nearest = |at: usize, axis: usize, count: usize| {
            let value = ((2 * at) as f64 - map.origin_px[axis]) / map.step_px[axis];
            (value.round().max(0.0) as usize).min(count - 1)
        };
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let gray = keyframe.images[0][2 * y * SIZE.0 + 2 * x] / 2;
            let ink = inks[nearest(y, 1, map.height) * map.width + nearest(x, 0, map.width)];
            let (column, row) = (place % 2 * width + x, place / 2 * height + y);
            sheet.put_pixel(column as u32, row as u32, image::Rgb(ink.map(|value| gray + value)));
        }
    }
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("keyframe_planes.png");
    sheet.save(&file).unwrap();
    println!("painted {}", file.display());
}

/// The lowest horizontal plane.
fn floor(found: &Found) -> &Detection<f64, 16> {
    let level = found.iter().filter(|plane| plane.orientation == Orientation::Horizontal);
    level.min_by(|a, b| a.fit.mean_in_world.z.total_cmp(&b.fit.mean_in_world.z)).expect("a floor")
}

#[test]
fn the_floor_of_a_real_room_is_that_of_its_stereo_corners() {
    let (Some(folder), Some(hall)) = (data("euroc/V1_01_keyframes"), data("euroc/MH_01_easy/mav0")) else { return };
    let [left, right] = ["cam0", "cam1"].map(|camera| read_camera(&hall.join(camera).join("sensor.yaml")).unwrap());
    let keyframes = keyframes(&folder);

    let corners = keyframes.iter().flat_map(|keyframe| stereo_points(keyframe, [&left, &right]));
    let corners = corners.map(|point_in_world| Sample { point_in_world, normal_in_world: None, source: Source::MapPoint });
    let by_stereo = planes_among(corners, 0.05);

    let Ok(choice) = "euroc".parse::<ModelChoice>();
    let mut network = choice.open(&left.camera, None).unwrap().unwrap();
    let (mut samples, mut maps) = (Vec::new(), Vec::new());
    for keyframe in keyframes.iter().skip(SCORED).step_by(EVERY) {
        let image = ImageView::new(&keyframe.images[0], SIZE.0, SIZE.1, SIZE.0).unwrap();
        let map = network.predict(keyframe.stamp, &image).unwrap();
        let look = look_of(keyframe, &map, &left);
        for (i, j) in (0..map.height).step_by(2).flat_map(|j| (0..map.width).step_by(2).map(move |i| (i, j))) {
            let Some(reading) = look.value(i, j).filter(|reading| reading.depth_m < FARTHEST_M) else { continue };
            let source = Source::Depth { uncertainty: reading.uncertainty };
            samples.push(Sample { point_in_world: reading.point_in_world, normal_in_world: look.sure_normal(&reading), source });
        }
        maps.push((keyframe, map));
    }
    let by_network = planes_among(samples.into_iter(), 0.05);
    paint(&maps, &by_stereo, &left);

    let (stereo, network) = (floor(&by_stereo), floor(&by_network));
    let apart_m = stereo.fit.mean_in_world.z - network.fit.mean_in_world.z;
    println!("floor {:.3} m by stereo, {:.3} m by the network", stereo.fit.mean_in_world.z, network.fit.mean_in_world.z);
    assert!(apart_m.abs() < 0.05, "{apart_m} m apart");
    assert!(network.fit.tilt_rad.to_degrees() < 2.0 && stereo.fit.tilt_rad.to_degrees() < 1.0);
}
