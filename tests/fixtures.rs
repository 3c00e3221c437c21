//! The room that other tests move through tells one story: its inertial samples integrate to its poses, and its images
//! show each landmark where the camera says it is.

use crate::support::room::{self, GRAVITY_M_S2, HEIGHT, Renderer, WIDTH};
use nalgebra::{UnitQuaternion, Vector3};

/// Midpoint steps of 0.2 ms over half a second; the error of the rule goes with the square of the step.
#[test]
fn inertial_samples_integrate_to_the_poses() {
    const STEP_NS: i64 = 200_000;
    const STEPS: i64 = 2_500;
    let start_ns = 300_000_000;
    let at = |ns: i64| room::world_from_body(ns);
    let mut rotation = at(start_ns).rotation;
    let mut position = at(start_ns).translation.vector;
    // The velocity by central differences of positions: their error at 10 us is below 1e-9 m/s.
    let mut velocity = (at(start_ns + 10_000).translation.vector - at(start_ns - 10_000).translation.vector) / 2e-5;
    let step_s = STEP_NS as f64 * 1e-9;
    for step in 0..STEPS {
        let sample = room::imu_sample(start_ns + step * STEP_NS + STEP_NS / 2);
        let halfway = rotation * UnitQuaternion::from_scaled_axis(sample.gyro_rad_s * (0.5 * step_s));
        let acceleration = halfway * sample.accel_m_s2 - Vector3::new(0.0, 0.0, GRAVITY_M_S2);
        position += velocity * step_s + acceleration * (0.5 * step_s * step_s);
        velocity += acceleration * step_s;
        rotation *= UnitQuaternion::from_scaled_axis(sample.gyro_rad_s * step_s);
    }
    let end = at(start_ns + STEPS * STEP_NS);
    assert!(rotation.angle_to(&end.rotation) < 1e-7, "rotation is off by {} rad", rotation.angle_to(&end.rotation));
    let off_m = (position - end.translation.vector).norm();
    assert!(off_m < 1e-7, "position is off by {off_m} m");
}

#[test]
fn images_show_landmarks_where_they_project() {
    let renderer = Renderer::new();
    let (mut seen, mut contrast) = (0, 0.0_f64);
    for nanos in [0, 1_000_000_000] {
        let image = renderer.image(nanos);
        let eye = (room::world_from_body(nanos) * room::body_from_camera()).translation.vector;
        let mean = image.iter().map(|&grey| f64::from(grey)).sum::<f64>() / image.len() as f64;
        for landmark in room::landmarks(1_500) {
            let Some(pixel) = room::pixel_of(&landmark, nanos) else { continue };
            if room::distance_to_edge_m(&landmark) < 0.03 {
                continue; // the pixels around it may show another wall
            }
            let (x, y) = (pixel.x.floor() as usize, pixel.y.floor() as usize);
            if x + 1 >= WIDTH || y + 1 >= HEIGHT {
                continue;
            }
            let at = |dx: usize, dy: usize| f64::from(image[(y + dy) * WIDTH + x + dx]);
            let (a, b) = (pixel.x.fract(), pixel.y.fract());
            let shown = (1.0 - b) * ((1.0 - a) * at(0, 0) + a * at(1, 0)) + b * ((1.0 - a) * at(0, 1) + a * at(1, 1));
            let painted = room::grey(&eye, &(landmark - eye));
            // Interpolation between pixels of a pattern whose finest cells are 4 px wide or more.
            assert!((shown - painted).abs() < 12.0, "{landmark:?} at {pixel:?}: {shown} where {painted} is painted");
            contrast += (painted - mean).powi(2);
            seen += 1;
        }
    }
    assert!(seen > 200, "only {seen} landmarks in two images");
    // A grey wall would pass the comparison above.
    assert!((contrast / f64::from(seen)).sqrt() > 20.0, "the walls have no texture");
}
