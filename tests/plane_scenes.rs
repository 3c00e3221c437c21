//! What the host's finder of planes makes of points and depth maps in scenes that are known exactly, without images or estimator: a room,
//! and what is none of its planes. Figures with `--nocapture`.

use crate::support::plane_truth::{Candidate, Rectangle, first_hit};
use libella_core::camera::{Camera, CameraModel, PinholeRadTan};
use libella_core::depth::DepthView;
use libella_core::time::Timestamp;
use libella_core::track::TrackId;
use libella_host::planes::{DepthLook, FoundPlane, PlaneFinder, PlanesConfig};
use libella_host::sim::random::Random;
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector2, Vector3};

const IMAGES: usize = 500;
const RATE_HZ: f64 = 20.0;
/// Every so many images have a depth map.
const DEPTH_EVERY: usize = 4;
const MAP: (usize, usize) = (40, 30);
const LANDMARKS: usize = 120;
const FLOOR: usize = 0;

/// What depth maps are like.
#[derive(Clone, Copy, PartialEq)]
enum Maps {
    None,
    /// 1 % of noise.
    Exact,
    /// 7 % of a slow wave over the image, another one in each, which is what a network is like.
    Rough,
}

/// What there is beside the room, and where it is at a time, s.
struct Scene {
    still: Vec<Rectangle>,
    /// Radius and middle, m.
    sphere: Option<(f64, Vector3<f64>)>,
    /// A box that goes along `y`: its rectangles at the beginning, and how fast, m/s.
    mover: Option<(Vec<Rectangle>, f64)>,
    maps: Maps,
    normals: bool,
    /// The world that the finder is told is turned by this about the horizontal, rad.
    gravity_error_rad: f64,
}

fn rectangle(corner: [f64; 3], u: [f64; 3], v: [f64; 3]) -> Rectangle {
    let [corner, u, v] = [corner, u, v].map(Vector3::from);
    Rectangle::of(&[corner, corner + u, corner + u + v, corner + v])
}

/// Seen from outside.
fn block([x, y, z]: [f64; 3], [a, b, c]: [f64; 3]) -> Vec<Rectangle> {
    vec![
        rectangle([x, y, z + c], [a, 0.0, 0.0], [0.0, b, 0.0]),
        rectangle([x, y, z], [0.0, 0.0, c], [0.0, b, 0.0]),
        rectangle([x + a, y, z], [0.0, b, 0.0], [0.0, 0.0, c]),
        rectangle([x, y, z], [a, 0.0, 0.0], [0.0, 0.0, c]),
        rectangle([x, y + b, z], [0.0, 0.0, c], [a, 0.0, 0.0]),
    ]
}

/// 5 m × 5 m × 2.5 m, without a ceiling.
fn room() -> Vec<Rectangle> {
    vec![
        rectangle([-2.5, -2.5, 0.0], [5.0, 0.0, 0.0], [0.0, 5.0, 0.0]),
        rectangle([2.5, -2.5, 0.0], [0.0, 0.0, 2.5], [0.0, 5.0, 0.0]),
        rectangle([-2.5, -2.5, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 2.5]),
        rectangle([-2.5, 2.5, 0.0], [5.0, 0.0, 0.0], [0.0, 0.0, 2.5]),
        rectangle([-2.5, -2.5, 0.0], [0.0, 0.0, 2.5], [5.0, 0.0, 0.0]),
    ]
}

/// Seven steps of 1.2 m × 0.26 m, 0.17 m high.
fn stairs() -> Vec<Rectangle> {
    (0..7).flat_map(|k| block([0.5 + 0.26 * f64::from(k), -0.6, 0.0], [0.26, 1.2, 0.17 * f64::from(k + 1)])).collect()
}

/// 1.2 m × 1 m, leaning back by 40°.
fn board() -> Rectangle {
    rectangle([0.8, -0.6, 0.1], [0.64, 0.0, 0.77], [0.0, 1.2, 0.0])
}

impl Scene {
    fn of(more: Vec<Rectangle>, maps: Maps) -> Self {
        let still = room().into_iter().chain(more).collect();
        Self { still, sphere: None, mover: None, maps, normals: true, gravity_error_rad: 0.0 }
    }

    /// How far a ray goes, in its own units, and how fast what it meets is, m/s along `y`.
    fn cast(&self, seconds: f64, origin: &Vector3<f64>, ray: &Vector3<f64>) -> Option<(f64, f64)> {
        let still = first_hit(&self.still, origin, ray).map(|(_, way)| (way, 0.0));
        let sphere = self.sphere.and_then(|(radius, middle)| {
            let (from, square) = (origin - middle, ray.norm_squared());
            let half = from.dot(ray) / square;
            let root = half * half - (from.norm_squared() - radius * radius) / square;
            (root > 0.0).then(|| (-half - root.sqrt(), 0.0)).filter(|(way, _)| *way > 0.0)
        });
        let mover = self.mover.as_ref().and_then(|(sides, speed)| {
            let then = origin - Vector3::y() * (speed * seconds);
            first_hit(sides, &then, ray).map(|(_, way)| (way, *speed))
        });
        [still, sphere, mover].into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

fn camera() -> CameraModel<f64> {
    CameraModel::PinholeRadTan(PinholeRadTan { size_px: (320, 240), focal_px: [200.0; 2], center_px: [160.0, 120.0], distortion: [0.0; 4] })
}

/// To and fro before what stands in the room, which it looks at, a little past it to either side.
fn world_from_camera(seconds: f64) -> Isometry3<f64> {
    let position = Vector3::new(-1.3 + 0.4 * (0.5 * seconds).sin(), 1.1 * (0.7 * seconds).sin(), 1.3 + 0.3 * (0.9 * seconds).sin());
    let target = Vector3::new(1.2, 1.4 * (0.35 * seconds).sin(), 0.5 + 0.2 * (0.6 * seconds).sin());
    let forward = (target - position).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    Isometry3::from_parts(position.into(), UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes)))
}

struct Landmark {
    track: TrackId,
    point: Vector3<f64>,
    /// What it is taken to be nearer or farther.
    error_m: Vector3<f64>,
    speed_m_s: f64,
}

/// Where landmarks are that can be followed through the scene.
struct Follower {
    landmarks: Vec<Landmark>,
    next: u32,
}

impl Follower {
    fn see(&mut self, scene: &Scene, camera: &CameraModel<f64>, pose: &Isometry3<f64>, seconds: f64, random: &mut Random) {
        let center = pose.translation.vector;
        self.landmarks.retain_mut(|landmark| {
            landmark.point.y += landmark.speed_m_s / RATE_HZ;
            let in_camera = pose.inverse_transform_point(&landmark.point.into()).coords;
            let inside = |pixel: Vector2<f64>| (0.0..320.0).contains(&pixel.x) && (0.0..240.0).contains(&pixel.y);
            let seen = in_camera.z > 0.1 && camera.project(&in_camera).is_some_and(inside);
            seen && scene.cast(seconds, &center, &(landmark.point - center)).is_some_and(|(way, _)| way > 0.98)
        });
        while self.landmarks.len() < LANDMARKS {
            let ray = pose.rotation * Vector3::new(random.between(-0.8, 0.8), random.between(-0.6, 0.6), 1.0);
            let Some((way, speed_m_s)) = scene.cast(seconds, &center, &ray) else { continue };
            let error_m = ray * (way * 0.01 * random.normal());
            self.landmarks.push(Landmark { track: TrackId(self.next), point: center + ray * way, error_m, speed_m_s });
            self.next += 1;
        }
    }
}

/// What was found that stands at the end.
fn found(scene: &Scene, seed: u64) -> Vec<FoundPlane> {
    let config = PlanesConfig { used: false, theta_m: 0.05, steady_after: 6, follow: 0.1, normals: scene.normals };
    let mut finder = PlaneFinder::new(config).unwrap();
    let (camera, mut random) = (camera(), Random::new(seed, "scene"));
    let mut follower = Follower { landmarks: Vec::new(), next: 0 };
    let told_from_world = UnitQuaternion::from_euler_angles(0.6 * scene.gravity_error_rad, 0.8 * scene.gravity_error_rad, 0.0);
    for image in 0..IMAGES {
        let seconds = image as f64 / RATE_HZ;
        let pose = world_from_camera(seconds);
        follower.see(scene, &camera, &pose, seconds, &mut random);
        let seen: Vec<_> = follower.landmarks.iter().map(|l| (l.track, told_from_world * (l.point + l.error_m))).collect();
        let stamp = Timestamp::from_nanos((seconds * 1e9) as i64);
        let told = told_from_world * pose;
        if scene.maps == Maps::None || image % DEPTH_EVERY > 0 {
            finder.see(&seen, &told.translation.vector, stamp, None);
            continue;
        }
        let phases = [(); 2].map(|()| random.between(0.0, std::f64::consts::TAU));
        let inverse = (0..MAP.0 * MAP.1).map(|index| {
            let (x, y) = ((index % MAP.0) as f64 / 25.0 - 0.78, (index / MAP.0) as f64 / 25.0 - 0.58);
            let error = match scene.maps {
                Maps::Rough => 0.07 * ((3.0 * x + phases[0]).sin() + (3.0 * y + phases[1]).sin()),
                _ => 0.01 * random.normal(),
            };
            let way = scene.cast(seconds, &pose.translation.vector, &(pose.rotation * Vector3::new(x, y, 1.0)));
            way.map_or(0.0, |(way, _)| (-error).exp() / way) as f32
        });
        let inverse: Vec<f32> = inverse.collect();
        let sigmas = vec![if scene.maps == Maps::Rough { 0.07 } else { 0.01 }; inverse.len()];
        let map = DepthView::new(MAP, [8.0; 2], [4.0; 2], &inverse, &sigmas, &sigmas).unwrap();
        let look = DepthLook { map, camera: &camera, world_from_camera: told, scale: 1.0 };
        finder.see(&seen, &told.translation.vector, stamp, Some(&look));
    }
    finder.finish().planes.into_iter().filter(|plane| plane.gone_into.is_none()).collect()
}

/// What is none of the scene's planes, in words, and which of these are found; in a world that is turned back.
fn judge(scene: &Scene, seed: u64) -> (Vec<String>, Vec<usize>) {
    let (mut wrong, mut right) = (Vec::new(), Vec::new());
    let world_from_told = UnitQuaternion::from_euler_angles(0.6 * scene.gravity_error_rad, 0.8 * scene.gravity_error_rad, 0.0).inverse();
    for plane in found(scene, seed) {
        let back = Isometry3::from_parts(Vector3::zeros().into(), world_from_told);
        let candidate = Candidate::new(&plane.normal_in_world, &plane.polygon_in_world, true, &back);
        match candidate.true_one(&scene.still) {
            Some((which, angle_deg, offset_m)) if angle_deg < 1.5 + scene.gravity_error_rad.to_degrees() && offset_m < 0.05 => {
                right.push(which)
            }
            near => wrong.push(format!(
                "{:?} {:.2?} at {:.2?}, {near:.2?}",
                plane.class,
                candidate.normal.as_slice(),
                candidate.middle.as_slice()
            )),
        }
    }
    (wrong, right)
}

const ALL_MAPS: [(Maps, &str); 3] = [(Maps::None, "points alone"), (Maps::Exact, "exact depth"), (Maps::Rough, "rough depth")];

#[test]
fn floor_and_the_walls_in_view_are_found() {
    for (maps, name) in ALL_MAPS {
        let (wrong, mut right) = judge(&Scene::of(Vec::new(), maps), 1);
        right.sort_unstable();
        println!("{name}: found {right:?}, wrong {wrong:?}");
        assert_eq!((wrong, right[..2].to_vec()), (vec![], vec![FLOOR, 1]), "{name}: the floor and the wall that is looked at");
    }
}

/// No plane that is not there stands at the end, whatever is looked at; the floor is found.
#[test]
fn stairs_boards_spheres_and_boxes_that_go_about_leave_no_plane() {
    for (maps, name) in ALL_MAPS {
        let sphere = Scene { sphere: Some((0.6, Vector3::new(1.2, 0.0, 0.6))), ..Scene::of(Vec::new(), maps) };
        let cart = block([0.6, -1.5, 0.0], [0.8, 0.8, 0.5]);
        let mover = Scene { mover: Some((cart, 0.1)), ..Scene::of(Vec::new(), maps) };
        let scenes = [
            ("stairs", Scene::of(stairs(), maps)),
            ("a leaning board", Scene::of(vec![board()], maps)),
            ("a sphere", sphere),
            ("a cart", mover),
        ];
        for (what, scene) in scenes {
            for seed in 1..=2 {
                let (wrong, right) = judge(&scene, seed);
                println!("{what}, {name}, seed {seed}: found {right:?}, wrong {wrong:?}");
                assert!(right.contains(&FLOOR), "{what}, {name}: the floor");
                assert_eq!(wrong, [""; 0], "{what}, {name}, seed {seed}");
            }
        }
    }
}

/// What a wrong gravity costs: nothing is found that is not there, and what is found is off by the error of gravity.
#[test]
fn a_wrong_gravity_costs_its_own_angle_and_no_more() {
    for (maps, name) in ALL_MAPS {
        for degrees in [1.0_f64, 3.0] {
            let scene = Scene { gravity_error_rad: degrees.to_radians(), ..Scene::of(Vec::new(), maps) };
            let (wrong, right) = judge(&scene, 1);
            println!("{degrees} deg, {name}: found {right:?}, wrong {wrong:?}");
            assert_eq!(wrong, [""; 0], "{degrees} deg, {name}");
            assert!(right.contains(&FLOOR) || degrees > 1.0, "{degrees} deg, {name}: the floor");
        }
    }
}
