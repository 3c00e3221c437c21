//! Rooms, boxes and rays.
#![allow(clippy::unwrap_used)]

use nalgebra::Rotation3;

use super::quad::{Hidden, box_sides};
use super::*;

fn room() -> (RoomConfig, Scene) {
    let path = [Vector3::new(0.0, 0.0, 1.0), Vector3::new(1.0, -1.0, 2.0)];
    let config = RoomConfig::vicon(&path);
    let scene = Scene::room(&config, &path, 3).unwrap();
    (config, scene)
}

#[test]
fn a_room_is_closed_and_boxes_face_outwards() {
    let (_, scene) = room();
    let mut random = Random::new(1, "rays");
    for _ in 0..2000 {
        let direction = random.normal3();
        let hit = scene.cast(&Vector3::new(0.5, -0.5, 1.5), &direction).unwrap();
        let quad = &scene.quads[hit.quad];
        let point = Vector3::new(0.5, -0.5, 1.5) + direction * hit.distance;
        assert!((quad.normal.dot(&point) - quad.offset_m()).abs() < 1e-9);
        assert!((quad.point(hit.place_m[0], hit.place_m[1]) - point).norm() < 1e-9);
        assert!(quad.normal.dot(&direction) < 0.0);
        assert!((quad.axis_u.cross(&quad.axis_v) - quad.normal).norm() < 1e-12);
    }
}

#[test]
fn the_six_sides_of_a_box_bound_its_volume() {
    let half = Vector3::new(0.2, 0.3, 0.5);
    let center = Vector3::new(1.0, 2.0, 3.0);
    let sides = box_sides(center, half, &Rotation3::from_euler_angles(0.3, -0.7, 1.1), Material::Wood, Hidden::Nothing);
    // Divergence theorem: Σ area · nᵀ(x − c) = 3 V.
    let flux: f64 = sides.iter().map(|quad| quad.size_m[0] * quad.size_m[1] * quad.normal.dot(&(quad.corner - center))).sum();
    assert!((flux - 3.0 * 8.0 * 0.2 * 0.3 * 0.5).abs() < 1e-12);
}

#[test]
fn what_stands_behind_something_is_not_clear() {
    let (_, scene) = room();
    let eye = Vector3::new(0.5, -0.5, 1.5);
    let hit = scene.cast(&eye, &Vector3::new(1.0, 0.2, -0.4)).unwrap();
    let on_it = eye + Vector3::new(1.0, 0.2, -0.4) * hit.distance;
    let behind_it = eye + Vector3::new(1.0, 0.2, -0.4) * (hit.distance * 1.1);
    assert!(scene.is_clear(&eye, &on_it, 1e-6) && !scene.is_clear(&eye, &behind_it, 1e-6));
}

#[test]
fn things_keep_clear_of_the_path() {
    let path: Vec<_> = (0..50).map(|k| Vector3::new((f64::from(k) * 0.2).sin() * 2.0, (f64::from(k) * 0.13).cos() * 2.0, 1.2)).collect();
    for seed in 0..5 {
        let scene = Scene::room(&RoomConfig::vicon(&path), &path, seed).unwrap();
        assert!(scene.quads.len() > 40);
        for pair in path.windows(2) {
            assert!(scene.is_clear(&pair[0], &pair[1], 0.0));
        }
    }
}

#[test]
fn a_bare_room_has_little_to_hold_on_to() {
    let path = [Vector3::new(0.0, 0.0, 1.2)];
    let usual = RoomConfig::vicon(&path);
    let texture = |config: &RoomConfig| {
        let scene = Scene::room(config, &path, 3).unwrap();
        let of = |quad: &Quad| quad.size_m[0] * quad.size_m[1];
        let rich: f64 = scene.quads.iter().map(|quad| of(quad) * quad.material.richness()).sum();
        let shell: Vec<_> = scene.quads[..6].iter().map(|quad| (quad.corner, quad.size_m)).collect();
        (rich, shell, scene.quads.len())
    };
    let ((rich, shell, all), (poor, bare_shell, boxes)) = (texture(&usual), texture(&RoomConfig { is_bare: true, ..usual }));
    assert_eq!(shell, bare_shell);
    // Six sides of the room, and five of every box.
    assert_eq!((boxes, usual.boxes), (6 + 5 * 12, 12));
    assert!(boxes < all && poor < 0.6 * rich, "{poor} of {rich} m2");
}

#[test]
fn refuses_a_room_without_height() {
    let config = RoomConfig { size_m: Vector3::new(8.0, 8.0, 0.0), ..RoomConfig::vicon(&[]) };
    let message = Scene::room(&config, &[], 1).unwrap_err().to_string();
    assert!(message.contains("size_m.z") && message.contains("2 to 100"), "{message}");
}
