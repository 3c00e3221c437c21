//! The smallest estimator, `Micro`, in static memory and on corners that are made up: a body rests for a second, then swings to and fro
//! before a cloud of points. The same code runs on a microcontroller; only the printing needs `std`.
//!
//! `cargo run -p libella-core --example static_memory`

use std::error::Error;
use std::sync::Mutex;

use libella_core::camera::{Camera, PinholeRadTan};
use libella_core::estimator::{EstimatorConfig, Place, StepBudget};
use libella_core::imu::ImuSample;
use libella_core::profile::Micro;
use libella_core::time::Timestamp;
use libella_core::track::{Observation, TrackId};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// All of the estimator's memory; zeros, so that it takes no flash.
static PLACE: Mutex<Place<Micro>> = Mutex::new(Place::new());

/// Position (m) and acceleration (m/s²) at a time: rest, then up to 0.4 m sideways and half of it up.
fn motion(seconds: f64) -> (Vector3<f64>, Vector3<f64>) {
    const RATE_RAD_S: f64 = 2.5;
    let phase = RATE_RAD_S * (seconds - 1.0).max(0.0);
    let swing = Vector3::new(0.0, 0.1, 0.05);
    // (1 − cos)², which leaves rest without a jerk.
    let bend = 2.0 * phase.sin().powi(2) + 2.0 * (1.0 - phase.cos()) * phase.cos();
    (swing * (1.0 - phase.cos()).powi(2), swing * bend * RATE_RAD_S * RATE_RAD_S)
}

fn main() -> Result<(), Box<dyn Error>> {
    let camera = PinholeRadTan::<f32>::new((160, 120), [106.0; 2], [79.5, 59.5], [0.0; 4])?;
    // The camera looks along the body's x axis: its right is the body's -y, its down the body's -z.
    let axes = Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0));
    let body_from_camera = Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_rotation_matrix(&axes));

    let mut place = PLACE.lock().map_err(|_| "another thread failed")?;
    let estimator = place.make(EstimatorConfig::default(), camera.into(), body_from_camera);
    println!("{} bytes, all of them static", size_of::<Micro>());

    // 48 points between 2 and 5 m ahead, where the golden ratio puts them.
    let point = |index: u32| {
        let share = |factor: f64| (f64::from(index) * factor).fract();
        let depth_m = 2.0 + 3.0 * share(0.618_034);
        Vector3::new(depth_m, depth_m * (share(0.754_878) - 0.5), depth_m * 0.8 * (share(0.569_840) - 0.5))
    };
    // 4 s of samples at 200 Hz, and every tenth time an image.
    for step in 0..800_i64 {
        let stamp = Timestamp::from_nanos(5_000_000 * step);
        let (position, acceleration) = motion(0.005 * step as f64);
        let force = acceleration + Vector3::new(0.0, 0.0, 9.81);
        // A hum, so that readings differ as those of a sensor do.
        let hum = 1e-3 * (1.7 * step as f64).sin();
        estimator.push_imu(ImuSample { stamp, gyro_rad_s: Vector3::repeat(0.1 * hum).cast(), accel_m_s2: force.add_scalar(hum).cast() })?;
        if step % 10 != 0 {
            continue;
        }
        let seen = (0..48).filter_map(|index| {
            let point_in_camera = body_from_camera.inverse() * nalgebra::Point3::from((point(index) - position).cast::<f32>());
            Some(Observation { track: TrackId(index), pixel: camera.project(&point_in_camera.coords)? })
        });
        estimator.push_tracks(stamp, &seen.collect::<Vec<_>>())?;
        let outcome = estimator.step(StepBudget::default());
        if step % 100 == 0 {
            let found = estimator.state().map(|estimate| estimate.state.position_in_world);
            println!(
                "{:.1} s  {outcome:?}  found {:?}  true {:?}",
                0.005 * step as f64,
                found.map(|p| [p.x, p.y, p.z]),
                position.as_slice()
            );
        }
    }
    Ok(())
}
