//! Starts all along recorded motions: how long a window has to be.

use std::{fs, path::PathBuf, println, string::String, vec, vec::Vec};

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector2, Vector3};

use super::world::{GRAVITY, Random, Reading, Setup, World, extrinsics, link};
use super::{errors, quantile, start};
use crate::imu::{ImuBias, ImuSample, NavState};
use crate::init::{InitConfig, RestConfig, detect_rest};
use crate::time::Timestamp;

/// The folder of shared recordings, when it holds `path`.
fn data(path: &str) -> Option<PathBuf> {
    let root = std::env::var("LIBELLA_DATA").unwrap_or_else(|_| String::from("../../shared/data"));
    let found = PathBuf::from(root).join(path);
    if found.exists() {
        return Some(found);
    }
    println!("skipped: LIBELLA_DATA has no {path}");
    None
}

/// Time in ns and the numbers of each row.
fn table(path: PathBuf) -> Vec<(i64, Vec<f64>)> {
    let text = fs::read_to_string(path).unwrap();
    let rows = text.lines().filter(|line| !line.starts_with('#'));
    rows.map(|line| {
        let mut cells = line.split(',');
        (cells.next().unwrap().parse().unwrap(), cells.map(|cell| cell.trim().parse().unwrap()).collect())
    })
    .collect()
}

fn vector(row: &[f64]) -> Vector3<f64> {
    Vector3::new(row[0], row[1], row[2])
}

/// The readings from one stamp to another, 5 ms apart; `None` where some are missing.
fn between(imu: &[(i64, Vec<f64>)], from: i64, to: i64) -> Option<Vec<Reading>> {
    let start = imu.partition_point(|(stamp, _)| *stamp < from - 1_000_000);
    let rows: Vec<_> = imu[start..].iter().take_while(|(stamp, _)| *stamp <= to + 1_000_000).collect();
    let is_whole = rows.len() as i64 == (to - from + 2_500_000) / 5_000_000 + 1;
    is_whole.then(|| rows.iter().map(|(_, row)| (vector(row), vector(&row[3..]))).collect())
}

/// Errors of starts every `hop_s` with windows of each length, as a table; scale errors per window length.
fn report(
    name: &str,
    windows_s: &[f64],
    world_at: impl Fn(f64, i64) -> Option<World>,
    starts: &[i64],
    config: &InitConfig<f64>,
) -> Vec<(f64, f64)> {
    println!("{name}: window, tried, started, scale error median 90 % max, tilt 90 %, gyro 90 %, velocity 90 %, NEES, refusals");
    let mut medians = Vec::new();
    for &span_s in windows_s {
        let (mut all, mut reasons, mut tried): ([Vec<f64>; 5], Vec<String>, usize) = Default::default();
        for &from in starts {
            let Some(world) = world_at(span_s, from) else { continue };
            tried += 1;
            let (result, states, _) = start(&world, config);
            match result {
                Ok(alignment) => all.iter_mut().zip(errors(&world, &states, &alignment)).for_each(|(list, e)| list.push(e)),
                Err(error) => reasons.push(std::format!("{error:?}").split('(').next().unwrap().into()),
            }
        }
        let started = all[0].len();
        if started == 0 {
            println!("  {span_s:.1} s {tried:4} {started:4}  {reasons:?}");
            continue;
        }
        let nees = all[4].iter().map(|z| z * z).sum::<f64>() / started as f64;
        let mut counts: Vec<(String, usize)> = Vec::new();
        for reason in reasons {
            match counts.iter_mut().find(|(known, _)| *known == reason) {
                Some((_, count)) => *count += 1,
                None => counts.push((reason, 1)),
            }
        }
        let q = |i: usize, part: f64, all: &mut [Vec<f64>; 5]| quantile(&mut all[i], part);
        println!(
            "  {span_s:.1} s {tried:4} {started:4}  {:.4} {:.4} {:.4}  {:.4}  {:.4}  {:.4}  {nees:.2}  {counts:?}",
            q(0, 0.5, &mut all),
            q(0, 0.9, &mut all),
            q(0, 1.0, &mut all),
            q(1, 0.9, &mut all),
            q(2, 0.9, &mut all),
            q(3, 0.9, &mut all)
        );
        medians.push((started as f64 / tried as f64, q(0, 0.5, &mut all)));
    }
    medians
}

/// The real inertial samples and motion, simulated points.
#[test]
fn real_motion_starts_with_simulated_points() {
    for name in ["V1_01_easy", "V1_02_medium", "V2_01_easy", "MH_04_difficult"] {
        let Some(folder) = data(&std::format!("euroc_motion/{name}/mav0")) else { continue };
        let imu = table(folder.join("imu0/data.csv"));
        let truth = table(folder.join("state_groundtruth_estimate0/data.csv"));
        let step = ((truth.len() - 1) as f64 / ((truth[truth.len() - 1].0 - truth[0].0) as f64 * 1e-9) / 20.0).round() as usize;
        let world_at = |span_s: f64, index: i64| {
            let frames = 11;
            let hop = (span_s / (frames - 1) as f64 * 20.0).round() as usize * step;
            let rows: Vec<_> = (0..frames).map(|i| truth.get(index as usize + i * hop)).collect::<Option<_>>()?;
            let state = |row: &Vec<f64>| NavState {
                position_in_world: vector(row),
                world_from_body: UnitQuaternion::from_quaternion(Quaternion::new(row[3], row[4], row[5], row[6])),
                velocity_in_world: vector(&row[7..]),
                bias: ImuBias { gyro_rad_s: vector(&row[10..]), accel_m_s2: vector(&row[13..]) },
            };
            let truth: Vec<_> = rows.iter().map(|(_, row)| state(row)).collect();
            let pair = |pair: &[&(i64, Vec<f64>)]| Some(link(&between(&imu, pair[0].0, pair[1].0)?, 0.005, &ImuBias::default()));
            let links = rows.windows(2).map(pair).collect::<Option<Vec<_>>>()?;
            let mut world =
                World { links, bias: truth[0].bias, truth, body_from_camera: extrinsics(), bearings: vec![], distances: vec![] };
            let setup = Setup { frames, noise_px: 0.7, outliers: 0.03, ..Setup::default() };
            let mut random = Random::new(index as u64);
            for _ in 0..setup.points {
                world.add_point(&mut random, &setup);
            }
            Some(world)
        };
        let starts: Vec<i64> = (0..truth.len() as i64).step_by(100 * step).collect();
        let config = InitConfig { sigma_px: 0.7, gravity_m_s2: GRAVITY, ..InitConfig::default() };
        let medians = report(name, &[1.0, 2.0], world_at, &starts, &config);
        assert!(medians.last().is_some_and(|(_, scale)| *scale < 0.05), "{name}: {medians:?}");
    }
}

/// Undoes EuRoC's radial-tangential distortion by fixed-point iteration.
fn unproject(pixel: Vector2<f64>) -> Vector3<f64> {
    let seen = Vector2::new((pixel.x - 367.215) / 458.654, (pixel.y - 248.375) / 457.296);
    let (k1, k2, p1, p2) = (-0.283_408_11, 0.073_959_07, 0.000_193_59, 1.761_871_14e-5);
    let mut p = seen;
    for _ in 0..40 {
        let r = p.norm_squared();
        let radial = 1.0 + k1 * r + k2 * r * r;
        let tangential = Vector2::new(2.0 * p1 * p.x * p.y + p2 * (r + 2.0 * p.x * p.x), p1 * (r + 2.0 * p.y * p.y) + 2.0 * p2 * p.x * p.y);
        p = (seen - tangential) / radial;
    }
    Vector3::new(p.x, p.y, 1.0).normalize()
}

/// Real corners of a calibration target and real inertial samples; truth by single-camera resection.
#[test]
fn real_corners_of_a_target_start() {
    let Some(folder) = data("imu_april") else { return };
    let imu = table(folder.join("imu0.csv"));
    let poses = table(folder.join("pnp_cam0_in_target.csv"));
    let corners = table(folder.join("tracks_cam0.csv"));
    let world_at = |span_s: f64, index: i64| {
        let frames = 11;
        let hop = (span_s / (frames - 1) as f64 * 20.0).round() as usize;
        let rows: Vec<_> = (0..frames).map(|i| poses.get(index as usize + i * hop)).collect::<Option<_>>()?;
        let state = |row: &Vec<f64>| {
            let turn = UnitQuaternion::from_quaternion(Quaternion::new(row[3], row[4], row[5], row[6]));
            let pose = Isometry3::from_parts(Translation3::from(vector(row)), turn) * extrinsics().inverse();
            NavState { position_in_world: pose.translation.vector, world_from_body: pose.rotation, ..NavState::origin() }
        };
        let truth: Vec<_> = rows.iter().map(|(_, row)| state(row)).collect();
        let pair = |pair: &[&(i64, Vec<f64>)]| Some(link(&between(&imu, pair[0].0, pair[1].0)?, 0.005, &ImuBias::default()));
        let links = rows.windows(2).map(pair).collect::<Option<Vec<_>>>()?;
        let mut bearings = vec![vec![None; frames]; 144];
        for (frame, (stamp, _)) in rows.iter().enumerate() {
            let first = corners.partition_point(|(at, _)| at < stamp);
            for (_, corner) in corners[first..].iter().take_while(|(at, _)| at == stamp) {
                bearings[corner[0] as usize * 4 + corner[1] as usize][frame] = Some(unproject(Vector2::new(corner[2], corner[3])));
            }
        }

        Some(World { links, bias: ImuBias::default(), truth, body_from_camera: extrinsics(), bearings, distances: vec![] })
    };
    let starts: Vec<i64> = (0..poses.len() as i64).step_by(40).collect();
    let config = InitConfig { sigma_px: 0.3, gravity_m_s2: 9.81007, ..InitConfig::default() };
    // The resection's frame is the target's, not level, and its biases and velocities are unknown: only the scale counts here.
    let medians = report("imu_april", &[1.0, 2.0], world_at, &starts, &config);
    assert!(medians.last().is_some_and(|(_, scale)| *scale < 0.05), "{medians:?}");
}

/// Windows of 0.8 s: how many rest, and the largest error of the gyro bias where the truth has one.
fn resting(imu: &[(i64, Vec<f64>)], truth_rad_s: Option<Vector3<f64>>) -> (usize, usize, f64) {
    let sample = |(stamp, row): &(i64, Vec<f64>)| ImuSample {
        stamp: Timestamp::from_nanos(*stamp),
        gyro_rad_s: vector(row),
        accel_m_s2: vector(&row[3..]),
    };
    let samples: Vec<_> = imu.iter().map(sample).collect();
    let (mut rests, mut windows, mut worst) = (0, 0, 0.0_f64);
    for window in samples.chunks_exact(160) {
        windows += 1;
        if let Ok(rest) = detect_rest(&RestConfig::default(), window, None) {
            rests += 1;
            worst = worst.max(truth_rad_s.map_or(0.0, |truth| (rest.state.bias.gyro_rad_s - truth).norm()));
        }
    }
    (rests, windows, worst)
}

/// EuRoC's V sequences start at rest; MH_01 begins while it is shaken.
#[test]
fn recorded_rest_and_recorded_shaking_are_told_apart() {
    if let Some(folder) = data("euroc_motion/V1_01_easy/mav0") {
        let imu = table(folder.join("imu0/data.csv"));
        let truth = table(folder.join("state_groundtruth_estimate0/data.csv"));
        let (rests, windows, worst) = resting(&imu[..640], Some(vector(&truth[0].1[10..])));
        println!("V1_01 start: {rests} of {windows} rest, gyro bias within {worst:.4} rad/s");
        assert!(rests == windows && worst < 0.004);
        let (rests, windows, _) = resting(&imu[4000..24000], None);
        println!("V1_01 flight: {rests} of {windows} rest");
        assert_eq!(rests, 0);
    }
    if let Some(folder) = data("euroc/MH_01_easy/mav0") {
        let imu = table(folder.join("imu0/data.csv"));
        let (rests, windows, _) = resting(&imu[..2400], None);
        println!("MH_01 start: {rests} of {windows} rest");
        assert_eq!(rests, 0);
    }
}
