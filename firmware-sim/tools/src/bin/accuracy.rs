//! `Micro` on small images beside `Desktop` on the large ones of the same recording.
//!
//! ```sh
//! cargo run --release -p libella-firmware-tools --bin accuracy -- [SETTING=VALUE...] RECORDING...
//! ```
//! A recording is a EuRoC folder. A setting is a number of `EstimatorConfig` or, with `planes.` before it, of `planes::Settings`; it holds for
//! `Micro` alone, and `only=micro` leaves `Desktop` out. Prints, for each, how many images have a pose, when the first came, and the error of the causal positions after SE(3)
//! alignment without scale. `Micro` flies without planes, and with them.

use std::error::Error;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use libella_core::camera::CameraModel;
use libella_core::estimator::{EstimatorConfig, FrameOutcome, StepBudget};
use libella_core::image::ImageView;
use libella_core::imu::{ImuNoise, ImuSample};
use libella_core::profile::{Micro, MicroPyramids};
use libella_core::time::{Span, Timestamp};
use libella_firmware_sim::memory;
use libella_firmware_sim::planes::{self, Planes};
use libella_firmware_tools::small;
use libella_host::config::Config;
use libella_host::dataset::{self, Event, Recording};
use libella_host::eval::{StampedPose, Trajectory, align};
use libella_host::pipeline;
use nalgebra::{Isometry3, Vector3};

fn main() -> Result<(), Box<dyn Error>> {
    let config = Config::default();
    let mut small = memory::settings(ImuNoise::adis16448());
    let (mut planes, mut micro_only) = (planes::Settings::small_images(), false);
    for argument in std::env::args().skip(1) {
        if let Some((name, value)) = argument.split_once('=') {
            match name {
                "only" if value == "micro" => micro_only = true,
                "planes.every" => planes.every = value.parse()?,
                "planes.steady_after" => planes.associate.steady_after = value.parse()?,
                "planes.least_inliers" => planes.fit.least_inliers = value.parse()?,
                _ => *setting(&mut small, &mut planes, name).ok_or_else(|| format!("no setting {name}"))? = value.parse()?,
            }
            continue;
        }
        let recording = dataset::open(Path::new(&argument), &config.dataset)?;
        println!("{}", recording.name);
        for (name, planes) in [("Micro, 160x120, f32", None), ("Micro with planes", Some(planes))] {
            let (trajectory, lost) = fly_small(&recording, &config, small, planes)?;
            report(name, &recording, &trajectory, lost);
        }
        if micro_only {
            continue;
        }
        let run = pipeline::run(&recording, &config, &AtomicBool::new(false), |_| ())?;
        let lost = run.frames.iter().filter(|frame| frame.outcome == Some(FrameOutcome::Lost)).count();
        report("Desktop, f64", &recording, &run.trajectory(), lost);
    }
    Ok(())
}

fn setting<'a>(config: &'a mut EstimatorConfig<f32>, planes: &'a mut planes::Settings, name: &str) -> Option<&'a mut f32> {
    Some(match name {
        "sigma_px" => &mut config.sigma_px,
        "huber" => &mut config.huber,
        "outlier_chi2" => &mut config.outlier_chi2,
        "keyframe_parallax_px" => &mut config.keyframe_parallax_px,
        "keyframe_shared_ratio" => &mut config.keyframe_shared_ratio,
        "keyframe_interval_s" => &mut config.keyframe_interval_s,
        "inverse_depth_sigma_per_m" => &mut config.inverse_depth_sigma_per_m,
        "inverse_depth_guess_sigma_per_m" => &mut config.inverse_depth_guess_sigma_per_m,
        "imu_noise_inflation" => &mut config.imu_noise_inflation,
        "imu_walk_inflation" => &mut config.imu_walk_inflation,
        "position_jitter_m" => &mut config.position_jitter_m,
        "initialisation_scale_sigma" => &mut config.initialisation_scale_sigma,
        "longest_initialisation_s" => &mut config.longest_initialisation_s,
        "rest_motion_px" => &mut config.rest_motion_px,
        "planes.sigma_m" => &mut config.planes.sigma_m,
        "planes.weight" => &mut config.planes.weight,
        "planes.attach_m" => &mut config.planes.theta_m,
        "planes.theta_m" => &mut planes.fit.theta_m,
        "planes.greatest_spread" => &mut planes.fit.greatest_spread,
        "planes.least_width_m" => &mut planes.fit.least_width_m,
        "planes.tilt_tolerance_rad" => &mut planes.fit.tilt_tolerance_rad,
        "planes.match_distance_m" => &mut planes.associate.match_distance_m,
        _ => return None,
    })
}

fn fly_small(
    recording: &Recording,
    config: &Config,
    settings: EstimatorConfig<f32>,
    planes: Option<planes::Settings>,
) -> Result<(Trajectory, usize), Box<dyn Error>> {
    let rig = &recording.rig;
    let camera = small::camera(&rig.camera).ok_or("no pinhole camera")?;
    let n = &rig.imu_noise;
    let imu_noise = ImuNoise {
        gyro_noise_density: n.gyro_noise_density as f32,
        accel_noise_density: n.accel_noise_density as f32,
        gyro_random_walk: n.gyro_random_walk as f32,
        accel_random_walk: n.accel_random_walk as f32,
    };
    let settings = EstimatorConfig { imu_noise, ..settings };
    let mut estimator = Box::new(Micro::new(settings, CameraModel::PinholeRadTan(camera).cast(), rig.body_from_camera_as()));
    let mut pyramids = Box::new(MicroPyramids::new());
    let mut planes = planes.map(Planes::new);
    let (mut poses, mut lost) = (Vec::new(), 0);
    for event in recording.events(config.dataset.images_ahead)? {
        match event {
            Event::Imu(sample) => {
                let sample = ImuSample { stamp: sample.stamp, gyro_rad_s: sample.gyro_rad_s.cast(), accel_m_s2: sample.accel_m_s2.cast() };
                estimator.push_imu(sample)?;
            }
            Event::Image { stamp, image } => {
                let pixels = small::shrink(&image?);
                estimator.push_image(
                    stamp,
                    &ImageView::new(&pixels, small::SIZE_PX.0, small::SIZE_PX.1, small::SIZE_PX.0)?,
                    &mut pyramids,
                )?;
                let outcome = estimator.step(StepBudget::even());
                lost += usize::from(outcome == FrameOutcome::Lost);
                if let Some(planes) = &mut planes {
                    let _ = planes.after_image(stamp, outcome, &mut estimator);
                }
                poses.extend(pose(&estimator, stamp));
            }
            Event::Tracks(_) => return Err("a recording of corners has no images".into()),
        }
    }
    Ok((Trajectory::new(poses), lost))
}

fn pose(estimator: &Micro, stamp: Timestamp) -> Option<StampedPose> {
    let state = estimator.state().filter(|estimate| estimate.stamp == stamp)?.state;
    let position: Vector3<f64> = state.position_in_world.cast();
    Some(StampedPose { stamp, world_from_body: Isometry3::from_parts(position.into(), state.world_from_body.cast()) })
}

fn report(name: &str, recording: &Recording, trajectory: &Trajectory, lost: usize) {
    let (Some(truth), Some(first)) = (&recording.truth, trajectory.poses().first()) else {
        println!("  {name}: no poses, or no truth");
        return;
    };
    let positions: Vec<_> = trajectory
        .poses()
        .iter()
        .filter_map(|pose| {
            Some((pose.world_from_body.translation.vector, truth.at(pose.stamp, Span::from_millis(100))?.translation.vector))
        })
        .collect();
    let Some(alignment) = align(&positions) else {
        println!("  {name}: too few poses to align");
        return;
    };
    let aligned = |position: &Vector3<f64>| (alignment.truth_from_estimate * nalgebra::Point3::from(*position)).coords;
    let squares: f64 = positions.iter().map(|(estimate, truth)| (aligned(estimate) - truth).norm_squared()).sum();
    let ate_m = (squares / positions.len() as f64).sqrt();
    let initialised_s = recording.frames.stamp(0).map_or(0.0, |begin| (first.stamp - begin).as_seconds::<f64>());
    let (poses, images) = (trajectory.poses().len(), recording.frames.len());
    println!("  {name}: {poses} of {images} poses, first after {initialised_s:.2} s, lost {lost} times, ATE {ate_m:.4} m");
}
