//! Every parameter has a range: beyond it the error names both.
#![allow(clippy::unwrap_used)]

use nalgebra::Isometry3;

use super::*;
use crate::sim::photometry::Photometry;

/// What a parameter makes of a value: the message of its refusal, or `None` where it is taken.
type Attempt = Box<dyn Fn(f64) -> Option<String>>;

fn message<T>(result: Result<T, SimError>) -> Option<String> {
    result.err().map(|error| error.to_string())
}

fn room(change: impl Fn(&mut RoomConfig, f64) + 'static) -> Attempt {
    Box::new(move |value| {
        let mut config = RoomConfig { boxes: 0, ..RoomConfig::vicon(&[]) };
        change(&mut config, value);
        message(Scene::room(&config, &[], 1))
    })
}

fn motion(change: impl Fn(&mut AnalyticConfig, f64) + 'static) -> Attempt {
    Box::new(move |value| {
        let mut config = AnalyticConfig { duration_s: 5.0, ..AnalyticConfig::default() };
        change(&mut config, value);
        message(Flight::analytic(&config, &ImuConfig::default(), 20.0, 1))
    })
}

fn imu(change: impl Fn(&mut ImuConfig, &mut ImuNoise<f64>, f64) + 'static) -> Attempt {
    Box::new(move |value| {
        let (mut config, mut noise) = (ImuConfig::default(), ImuNoise::adis16448());
        change(&mut config, &mut noise, value);
        config.noise = Some(noise);
        message(Flight::analytic(&AnalyticConfig { duration_s: 2.0, rest_s: 0.0, ..AnalyticConfig::default() }, &config, 20.0, 1))
    })
}

fn render(change: impl Fn(&mut RenderConfig, f64) + 'static) -> Attempt {
    let world = World::bake(Scene { quads: Vec::new() }, 1, 1);
    Box::new(move |value| {
        let mut config = RenderConfig::default();
        change(&mut config, value);
        message(Renderer::new(&world, &euroc::camera(0), &Isometry3::identity(), &config, 1))
    })
}

fn light(change: impl Fn(&mut PhotometryConfig, f64) + 'static) -> Attempt {
    Box::new(move |value| {
        let mut config = PhotometryConfig::default();
        change(&mut config, value);
        message(Photometry::new(&config, 20, 20, 1))
    })
}

fn features(change: impl Fn(&mut FeatureConfig, f64) + 'static) -> Attempt {
    Box::new(move |value| {
        let mut config = FeatureConfig::default();
        change(&mut config, value);
        let motion = AnalyticConfig { duration_s: 1.0, rest_s: 0.0, ..AnalyticConfig::default() };
        message(simulate(&SimulationConfig { motion, features: config, ..SimulationConfig::default() }, 1))
    })
}

#[test]
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn every_parameter_is_refused_beyond_its_range_and_taken_at_its_ends() {
    let movers: Attempt = Box::new(|value| message(Scene { quads: Vec::new() }.movers(&RoomConfig::vicon(&[]), &[], value as usize, 1)));
    let duration: Attempt = Box::new(|value| message(MotionSource::parse("easy", value)));
    let frames: Attempt = Box::new(|value| {
        let motion = AnalyticConfig { duration_s: 2.0, rest_s: 0.0, ..AnalyticConfig::default() };
        message(Flight::analytic(&motion, &ImuConfig::default(), value, 1))
    });
    let parameters: Vec<(&str, f64, f64, bool, Attempt)> = vec![
        // name, least, greatest, whether it counts things, attempt
        ("room.size_m.x", 3.0, 100.0, false, room(|room, value| room.size_m.x = value)),
        ("room.size_m.y", 3.0, 100.0, false, room(|room, value| room.size_m.y = value)),
        ("room.size_m.z", 2.0, 100.0, false, room(|room, value| room.size_m.z = value)),
        ("room.boxes", 0.0, 200.0, true, room(|room, value| room.boxes = value as usize)),
        ("room.clearance_m", 0.1, 5.0, false, room(|room, value| room.clearance_m = value)),
        ("dynamic", 0.0, MOST_MOVERS as f64, true, movers),
        ("duration_s", 1.0, 3600.0, false, duration),
        ("rest_s", 0.0, 5.0, false, motion(|motion, value| motion.rest_s = value)),
        ("frame_rate_hz", 1.0, 200.0, false, frames),
        ("imu.rate_hz", 20.0, 2000.0, false, imu(|imu, _, value| imu.rate_hz = value)),
        ("gravity_m_s2", 0.0, 30.0, false, imu(|imu, _, value| imu.gravity_m_s2 = value)),
        ("gyro_noise_density", 0.0, 1.0, false, imu(|_, noise, value| noise.gyro_noise_density = value)),
        ("accel_noise_density", 0.0, 10.0, false, imu(|_, noise, value| noise.accel_noise_density = value)),
        ("gyro_random_walk", 0.0, 1.0, false, imu(|_, noise, value| noise.gyro_random_walk = value)),
        ("accel_random_walk", 0.0, 10.0, false, imu(|_, noise, value| noise.accel_random_walk = value)),
        ("render.exposure_s", 0.0, 0.03, false, render(|render, value| render.exposure_s = value)),
        ("render.threads", 1.0, 256.0, true, render(|render, value| render.threads = value as usize)),
        ("photometry.target_grey", 20.0, 200.0, false, light(|light, value| light.target_grey = value)),
        ("photometry.control", 0.0, 1.0, false, light(|light, value| light.control = value)),
        ("photometry.vignetting", 0.0, 0.9, false, light(|light, value| light.vignetting = value)),
        ("photometry.read_noise", 0.0, 20.0, false, light(|light, value| light.read_noise = value)),
        ("photometry.shot_noise", 0.0, 1.0, false, light(|light, value| light.shot_noise = value)),
        ("sigma_px", 0.0, 10.0, false, features(|features, value| features.sigma_px = value)),
    ];
    for (name, low, high, is_count, attempt) in parameters {
        for value in [low, high] {
            assert_eq!(attempt(value), None, "{name} = {value} is within its range");
        }
        let step = if is_count { 1.0 } else { 1e-6 };
        let mut beyond = vec![high + step];
        if !is_count {
            beyond.extend([low - step, f64::NAN, f64::INFINITY]);
        } else if low > 0.0 {
            beyond.push(low - step);
        }
        for value in beyond {
            let message = attempt(value).unwrap_or_else(|| unreachable!("{name} = {value} is not refused"));
            assert!(message.contains(name) && message.contains(&format!("{low} to {high}")), "{name} = {value}: {message}");
        }
    }
}
