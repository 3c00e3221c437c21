//! The moving start on simulated motions with exact truth.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

mod world;

use std::{println, vec, vec::Vec};

use nalgebra::{Vector2, Vector3};

use self::world::{Kind, Setup, World};
use super::refinement::{Motion, Views, linearize, residual};
use super::tracks::across;
use super::*;
use crate::imu::{ImuBias, NavState};
use crate::lie::so3;
use crate::testing::{assert_close, numerical_jacobian};

fn start(world: &World, config: &InitConfig<f64>) -> (Result<Alignment<f64>, InitError<f64>>, Vec<NavState<f64>>, Vec<InitLandmark<f64>>) {
    let mut landmarks = vec![InitLandmark::default(); world.landmark_count()];
    let mut states = vec![NavState::origin(); world.links.len() + 1];
    let result = initialise_moving(config, &world.body_from_camera, &world.links, world, &mut landmarks, &mut states);
    (result, states, landmarks)
}

fn config() -> InitConfig<f64> {
    InitConfig { sigma_px: 0.5, ..InitConfig::default() }
}

fn quantile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * part).round() as usize]
}

/// Errors of one start: scale, tilt (rad), gyro bias (rad/s), velocity (m/s), and scale in standard deviations.
fn errors(world: &World, states: &[NavState<f64>], alignment: &Alignment<f64>) -> [f64; 5] {
    let centred = |p: &[Vector3<f64>]| {
        let mean = p.iter().sum::<Vector3<f64>>() / p.len() as f64;
        p.iter().map(|p| (p - mean).norm_squared()).sum::<f64>().sqrt()
    };
    let truth: Vec<_> = world.truth.iter().map(|state| state.position_in_world).collect();
    let ours: Vec<_> = states.iter().map(|state| state.position_in_world).collect();
    let scale = centred(&ours) / centred(&truth) - 1.0;
    let last = states.len() - 1;
    let up = |state: &NavState<f64>| state.world_from_body.inverse() * Vector3::z();
    let tilt = up(&states[last]).angle(&up(&world.truth[last]));
    let gyro = (states[0].bias.gyro_rad_s - world.bias.gyro_rad_s).norm();
    let velocity = |state: &NavState<f64>| state.world_from_body.inverse() * state.velocity_in_world;
    let velocity = (velocity(&states[last]) - velocity(&world.truth[last])).norm();
    [scale.abs(), tilt, gyro, velocity, scale / alignment.scale_sigma]
}

#[test]
fn hand_held_motion_is_recovered_over_a_hundred_seeds() {
    for span_s in [1.0, 1.5, 2.0, 2.5] {
        let mut all: [Vec<f64>; 5] = Default::default();
        let (mut refused, mut reasons) = (0, Vec::new());
        let clock = std::time::Instant::now();
        for seed in 0..100 {
            let world = World::new(&Setup { span_s, seed, ..Setup::default() });
            let (result, states, _) = start(&world, &config());
            match result {
                Ok(alignment) => all.iter_mut().zip(errors(&world, &states, &alignment)).for_each(|(list, e)| list.push(e)),
                Err(error) => {
                    refused += 1;
                    reasons.push(error);
                }
            }
        }
        println!("span {span_s}: refused {refused} {:?} in {:?}", &reasons[..reasons.len().min(6)], clock.elapsed() / 100);
        let nees = all[4].iter().map(|z| z * z).sum::<f64>() / all[4].len() as f64;
        for (name, list) in ["scale", "tilt", "gyro", "velocity"].iter().zip(&mut all) {
            println!("  {name:9} median {:.4} p90 {:.4} max {:.4}", quantile(list, 0.5), quantile(list, 0.9), quantile(list, 1.0));
        }
        println!("  scale NEES {nees:.2}");
    }
}
