//! Preintegration alone: half a second of inertial samples on a circle, as one delta with its covariance.
//!
//! `cargo run -p libella-core --example preintegrate`

use libella_core::imu::{ImuBias, ImuNoise, ImuSample, NavState, Preintegration, PreintegrationError};
use libella_core::lie::so3;
use libella_core::time::Timestamp;
use nalgebra::Vector3;

/// A car drives along a circle at constant speed: it turns to the left and is pressed towards the centre.
const SPEED_M_S: f64 = 2.0;
const TURN_RAD_S: f64 = 0.8;
const GRAVITY_M_S2: f64 = 9.81;

fn reading(nanos: i64) -> ImuSample<f64> {
    ImuSample {
        stamp: Timestamp::from_nanos(nanos),
        gyro_rad_s: Vector3::new(0.0, 0.0, TURN_RAD_S),
        // v × ω towards the centre, and what holds it against gravity.
        accel_m_s2: Vector3::new(0.0, SPEED_M_S * TURN_RAD_S, GRAVITY_M_S2),
    }
}

fn main() -> Result<(), PreintegrationError> {
    // 101 samples at 200 Hz, with the noise of a good MEMS sensor, linearised at a bias of zero.
    let noise = ImuNoise::adis16448();
    let mut integral = Preintegration::new(ImuBias::default());
    for step in 0..100 {
        integral.integrate(&noise, &reading(5_000_000 * step), &reading(5_000_000 * (step + 1)))?;
    }

    // The deltas do not know gravity, and are in the frame of the body at the start.
    let (rotation, velocity, position) = integral.corrected(integral.bias());
    println!("over {:.3} s, in the frame of the body at the start and without gravity:", integral.span_s());
    // The order of a state: rotation (rad), position (m), velocity (m/s), biases of gyro and accelerometer.
    let covariance = integral.covariance();
    let names = ["rotation, rad", "position, m", "velocity, m/s"];
    for (index, (name, delta)) in names.into_iter().zip([so3::log(&rotation), position, velocity]).enumerate() {
        let sigma = Vector3::from_fn(|row, _| covariance[(3 * index + row, 3 * index + row)].sqrt());
        println!("{name:14} [{:8.5} {:8.5} {:8.5}]  sigma [{:.1e} {:.1e} {:.1e}]", delta.x, delta.y, delta.z, sigma.x, sigma.y, sigma.z);
    }
    let correlation = covariance[(3, 6)] / (covariance[(3, 3)] * covariance[(6, 6)]).sqrt();
    println!("position and velocity along x are correlated by {correlation:.3}");

    // From a state at the start to the one at the end: gravity comes back here.
    let start = NavState { velocity_in_world: Vector3::new(SPEED_M_S, 0.0, 0.0), ..NavState::origin() };
    let end = integral.predict(&start, &Vector3::new(0.0, 0.0, -GRAVITY_M_S2));
    let (angle, radius) = (TURN_RAD_S * integral.span_s(), SPEED_M_S / TURN_RAD_S);
    let circle = Vector3::new(radius * angle.sin(), radius * (1.0 - angle.cos()), 0.0);
    let error_m = (end.position_in_world - circle).norm();
    println!("predicted position is {error_m:.1e} m off the circle");
    assert!(error_m < 1e-5, "the midpoint rule at 200 Hz is exact to micrometres");

    // A gyro bias found later moves the delta without a new integration.
    let bias = ImuBias { gyro_rad_s: Vector3::new(0.0, 0.0, 0.01), ..ImuBias::default() };
    let (corrected, ..) = integral.corrected(&bias);
    println!("with a gyro bias of 0.01 rad/s it turned by {:.5} rad", so3::log(&corrected).z);
    Ok(())
}
