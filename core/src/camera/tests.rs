//! The cameras against their definition, numerical Jacobians, and each other.
#![allow(clippy::unwrap_used)]

use nalgebra::{Matrix2, Vector2, Vector3};
use proptest::prelude::*;
use std::string::ToString;

use super::*;
use crate::real::Real;
use crate::testing::{assert_close, numerical_jacobian};

/// cam0 of EuRoC, from its sensor.yaml.
fn euroc() -> PinholeRadTan<f64> {
    PinholeRadTan::new((752, 480), [458.654, 457.296], [367.215, 248.375], [-0.283_408_11, 0.073_959_07, 0.000_193_59, 1.761_871_14e-5])
        .unwrap()
}

/// cam0 of TUM-VI, 512×512.
fn tum_vi() -> KannalaBrandt<f64> {
    KannalaBrandt::new(
        (512, 512),
        [190.978, 190.973],
        [254.932, 256.897],
        [0.003_482_389_402_249_343_4, 0.000_715_034_845_216_225_7, -0.002_053_236_141_870_620_2, 0.000_202_936_735_918_111_82],
    )
    .unwrap()
}

fn cameras() -> [CameraModel<f64>; 2] {
    [euroc().into(), tum_vi().into()]
}

/// The largest round-trip error in pixels over the image, corners included, and how many pixels had no bearing.
fn round_trip<T: Real>(camera: &impl Camera<T>) -> (f64, usize) {
    let (width, height) = camera.size_px();
    let (mut worst, mut missing) = (0.0_f64, 0);
    for v in (0..height).step_by(7).chain([height - 1]) {
        for u in (0..width).step_by(7).chain([width - 1]) {
            let pixel = Vector2::new(T::of(f64::from(u)), T::of(f64::from(v)));
            let Some(bearing) = camera.unproject(&pixel) else {
                missing += 1;
                continue;
            };
            assert!((bearing.norm() - T::one()).abs() < T::default_epsilon() * T::of(4.0));
            // Any point along the bearing has the same pixel.
            let again = camera.project(&(bearing * T::of(2.5))).unwrap();
            worst = worst.max((again - pixel).norm().as_f64());
        }
    }
    (worst, missing)
}

#[test]
fn every_pixel_of_the_image_returns_to_itself_in_f64() {
    for camera in cameras() {
        let (worst, missing) = round_trip(&camera);
        assert_eq!(missing, 0);
        assert!(worst < 1e-9, "{worst:.1e} px");
    }
}

#[test]
fn every_pixel_of_the_image_returns_to_itself_in_f32() {
    for camera in cameras() {
        let (worst, missing) = round_trip(&camera.cast::<f32>());
        assert_eq!(missing, 0);
        // A coordinate of 752 px is itself rounded to 3e-5 px; a few such roundings add up on the way.
        assert!(worst < 3e-4, "{worst:.1e} px");
    }
}

#[test]
fn single_precision_bearings_are_those_of_double_precision() {
    for camera in cameras() {
        let single = camera.cast::<f32>();
        for pixel in [[0.0, 0.0], [100.0, 300.0], [511.0, 20.0], [256.0, 250.0]] {
            let expected = camera.unproject(&Vector2::from(pixel)).unwrap();
            let actual = single.unproject(&Vector2::from(pixel).cast::<f32>()).unwrap().cast::<f64>();
            assert!((actual - expected).norm() < 2e-6, "{pixel:?} {:.1e}", (actual - expected).norm());
        }
    }
}

#[test]
fn pinhole_follows_the_opencv_convention() {
    // a = 0.5, b = −0.25: r² = 0.3125, ρ = 1 − 0.28340811·0.3125 + 0.07395907·0.09765625 = 0.91865753105,
    // a' = 0.5ρ − 0.25 p₁ + 0.8125 p₂ = 0.45929468325, b' = −0.25ρ + 0.4375 p₁ − 0.25 p₂ = −0.22958409182.
    let pixel = euroc().project(&Vector3::new(1.0, -0.5, 2.0)).unwrap();
    assert!((pixel - Vector2::new(577.872_343_642_3, 143.387_113_148_7)).norm() < 1e-9, "{pixel}");
}

#[test]
fn fisheye_follows_the_opencv_convention() {
    // 45° to the right: θ² = π²/16; d = θ(1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸) straight from the definition.
    let camera = tum_vi();
    let angle = std::f64::consts::FRAC_PI_4;
    let radius = camera.distortion.iter().enumerate().fold(angle, |sum, (i, k)| sum + k * angle.powi(2 * i32::try_from(i).unwrap() + 3));
    let pixel = camera.project(&Vector3::new(3.0, 0.0, 3.0)).unwrap();
    assert!((pixel - Vector2::new(190.978 * radius + 254.932, 256.897)).norm() < 1e-10);
}

#[test]
fn the_axis_meets_the_principal_point() {
    for camera in cameras() {
        let (pixel, jacobian) = camera.project_with_jacobian(&Vector3::new(0.0, 0.0, 4.0)).unwrap();
        let (center, focal) = match camera {
            CameraModel::PinholeRadTan(c) => (c.center_px, c.focal_px),
            CameraModel::KannalaBrandt(c) => (c.center_px, c.focal_px),
        };
        assert!((pixel - Vector2::from(center)).norm() < 1e-12);
        let expected = Matrix2x3::new(focal[0] / 4.0, 0.0, 0.0, 0.0, focal[1] / 4.0, 0.0);
        assert!((jacobian - expected).norm() < 1e-12);
        assert!((camera.unproject(&pixel).unwrap() - Vector3::z()).norm() < 1e-12);
    }
}

/// Points in front of the camera, near the axis (down to 1e-9) and far from it.
fn point_in_view() -> impl Strategy<Value = Vector3<f64>> {
    (-1.0f64..1.0, -0.7f64..0.7, 0.2f64..20.0, 0..10i32).prop_map(|(a, b, depth, power)| {
        let shrink = if power < 5 { 1.0 } else { 10f64.powi(5 - 2 * power) };
        Vector3::new(a * shrink, b * shrink, 1.0) * depth
    })
}

proptest! {
    #[test]
    fn jacobians_match_central_differences(point in point_in_view()) {
        for camera in cameras() {
            let (pixel, jacobian) = camera.project_with_jacobian(&point).unwrap();
            prop_assert_eq!(pixel, camera.project(&point).unwrap());
            let numerical = numerical_jacobian(1e-5 * point.z, |delta| camera.project(&(point + delta)).unwrap());
            assert_close(&jacobian, &numerical, 1e-7);
        }
    }

    #[test]
    fn fisheye_jacobian_holds_behind_the_image_plane(turn in -3.1f64..3.1, angle in 1.3f64..1.8, range in 0.5f64..9.0) {
        let camera = tum_vi();
        let point = Vector3::new(angle.sin() * turn.cos(), angle.sin() * turn.sin(), angle.cos()) * range;
        let (_, jacobian) = camera.project_with_jacobian(&point).unwrap();
        let numerical = numerical_jacobian(1e-5 * range, |delta| camera.project(&(point + delta)).unwrap());
        assert_close(&jacobian, &numerical, 1e-7);
    }

    #[test]
    fn bearings_survive_the_way_through_the_image(point in point_in_view()) {
        for camera in cameras() {
            let bearing = camera.unproject(&camera.project(&point).unwrap()).unwrap();
            prop_assert!((bearing - point.normalize()).norm() < 1e-11);
        }
    }

    #[test]
    fn unprojection_jacobian_matches_central_differences(u in 5.0f64..500.0, v in 120.0f64..400.0) {
        for camera in cameras() {
            let pixel = Vector2::new(u, v);
            let Some((normalized, jacobian)) = camera.unproject_with_jacobian(&pixel) else {
                // Only the fisheye sees 90°, about 1.57 · 191 px from its centre.
                prop_assert!((pixel - Vector2::new(254.932, 256.897)).norm() > 280.0);
                continue;
            };
            let bearing = camera.unproject(&pixel).unwrap();
            prop_assert!((normalized.push(1.0).normalize() - bearing).norm() < 1e-12);
            if normalized.norm() < 3.0 {
                let at = |delta: &Vector2<f64>| camera.unproject_with_jacobian(&(pixel + delta)).unwrap().0;
                let numerical: Matrix2<f64> = numerical_jacobian(1e-3, at);
                assert_close(&jacobian, &numerical, 1e-6);
            }
        }
    }

    #[test]
    fn no_input_panics_or_yields_a_number_that_is_none(
        bits in prop::array::uniform3(any::<u64>()),
        distortion in prop::array::uniform4(-2.0f64..2.0),
    ) {
        let [x, y, z] = bits.map(f64::from_bits);
        let pinhole = PinholeRadTan { distortion, ..euroc() };
        let fisheye = KannalaBrandt { distortion, ..tum_vi() };
        for camera in [CameraModel::from(pinhole), fisheye.into(), euroc().into(), tum_vi().into()] {
            if let Some(pixel) = camera.project(&Vector3::new(x, y, z)) {
                prop_assert!(!pixel.x.is_nan() && !pixel.y.is_nan());
            }
            if let Some(bearing) = camera.unproject(&Vector2::new(x, y)) {
                prop_assert!((bearing.norm() - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn what_unprojects_projects_back_whatever_the_lens(
        u in -200.0f64..900.0, v in -200.0f64..700.0,
        k1 in -0.5f64..0.5, k2 in -0.3f64..0.3, p1 in -0.01f64..0.01, p2 in -0.01f64..0.01,
    ) {
        let pixel = Vector2::new(u, v);
        let pinhole = PinholeRadTan { distortion: [k1, k2, p1, p2], ..euroc() };
        let fisheye = KannalaBrandt { distortion: [0.2 * k1, 0.1 * k2, p1, 0.1 * p2], ..tum_vi() };
        for camera in [CameraModel::from(pinhole), fisheye.into()] {
            if let Some(bearing) = camera.unproject(&pixel) {
                let again = camera.project(&bearing).unwrap();
                prop_assert!((again - pixel).norm() < 1e-8, "{:.1e}", (again - pixel).norm());
            }
        }
    }
}

#[test]
fn the_folded_part_of_a_barrel_lens_is_refused() {
    // r(1 − 0.3 r²) grows up to r = 1/√0.9 = 1.0541 and reaches 0.7027 there.
    let camera = PinholeRadTan::new((640, 480), [400.0, 400.0], [320.0, 240.0], [-0.3, 0.0, 0.0, 0.0]).unwrap();
    let edge = 1.0 / 0.9f64.sqrt();
    assert!(camera.project(&Vector3::new(0.999 * edge, 0.0, 1.0)).is_some());
    assert!(camera.project(&Vector3::new(1.001 * edge, 0.0, 1.0)).is_none());
    // r = 1.8 would fold back onto a pixel well inside the image.
    assert!(camera.project(&Vector3::new(1.8, 0.0, 1.0)).is_none());
    let rim = edge * (1.0 - 0.3 * edge * edge);
    assert!(camera.unproject(&Vector2::new(320.0 + 400.0 * rim * 0.9999, 240.0)).is_some());
    assert!(camera.unproject(&Vector2::new(320.0 + 400.0 * rim * 1.0001, 240.0)).is_none());
}

#[test]
fn the_folded_part_of_a_fisheye_is_refused() {
    // d(θ) stops growing where 1 + 3k₁u + 5k₂u² + 7k₃u³ + 9k₄u⁴ = 0, u = θ². Bisection from the definition finds where.
    let camera = KannalaBrandt { distortion: [0.0035, 0.0007, -0.002, 0.0], ..tum_vi() };
    let [k1, k2, k3, k4] = camera.distortion;
    let slope = |u: f64| 1.0 + u * (3.0 * k1 + u * (5.0 * k2 + u * (7.0 * k3 + u * 9.0 * k4)));
    let (mut low, mut high) = (0.0, 7.0);
    assert!(slope(high) < 0.0, "the test needs a lens that folds");
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if slope(middle) > 0.0 { low = middle } else { high = middle }
    }
    let edge = low.sqrt();
    assert!(edge < std::f64::consts::PI);
    let at = |angle: f64| camera.project(&Vector3::new(angle.sin(), 0.0, angle.cos()));
    assert!(at(edge - 1e-3).is_some());
    assert!(at(edge + 1e-3).is_none());
    assert!(at(std::f64::consts::PI).is_none());
    assert!(camera.unproject(&Vector2::new(2000.0, 256.0)).is_none());
}

#[test]
fn behind_and_beside_the_camera() {
    for camera in cameras() {
        assert_eq!(camera.project(&Vector3::new(0.0, 0.0, 0.0)), None);
        assert_eq!(camera.project(&Vector3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(camera.project(&Vector3::new(0.1, f64::NAN, 1.0)), None);
        assert_eq!(camera.unproject(&Vector2::new(f64::NAN, 1.0)), None);
        assert_eq!(camera.unproject(&Vector2::new(f64::INFINITY, 1.0)), None);
    }
    assert_eq!(euroc().project(&Vector3::new(1.0, 0.0, 0.0)), None);
    assert!(tum_vi().project(&Vector3::new(1.0, 0.0, 0.0)).is_some());
}

#[test]
fn impossible_calibrations_are_refused() {
    let check = |size, focal, center, distortion| PinholeRadTan::<f64>::new(size, focal, center, distortion).map(|_| ());
    let (f, c, k) = ([400.0, 400.0], [320.0, 240.0], [0.0; 4]);
    assert_eq!(check((640, 480), f, c, k), Ok(()));
    assert_eq!(check((640, 0), f, c, k), Err(CameraError::EmptyImage(640, 0)));
    assert_eq!(check((640, 480), [400.0, 0.0], c, k), Err(CameraError::FocalLength));
    assert_eq!(check((640, 480), [-1.0, 400.0], c, k), Err(CameraError::FocalLength));
    assert_eq!(check((640, 480), f, [f64::NAN, 0.0], k), Err(CameraError::NotFinite));
    assert_eq!(check((640, 480), f, c, [0.0, f64::INFINITY, 0.0, 0.0]), Err(CameraError::NotFinite));
    assert_eq!(KannalaBrandt { focal_px: [0.0, 1.0], ..tum_vi() }.validate(), Err(CameraError::FocalLength));
    assert_eq!(CameraError::EmptyImage(640, 0).to_string(), "image of 640 x 0 px is empty");
}
