//! Ten minutes of flight need no more memory than ten seconds: no allocation, and resident memory that stands still.
//!
//! `cargo test --release --test constant_memory -- --ignored --nocapture` flies the ten minutes.
#![allow(clippy::unwrap_used, unsafe_code)] // a global allocator cannot be written without unsafe code

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Mutex;

use libella_core::camera::CameraModel;
use libella_core::estimator::{Estimator, EstimatorConfig, FrameOutcome, StepBudget};
use libella_core::imu::ImuSample;
use libella_core::real::Real;
use libella_core::time::Timestamp;
use libella_core::track::Observation;
use libella_host::sim::features::Tracker;
use libella_host::sim::{AnalyticConfig, FeatureConfig, Flight, ImuConfig, MotionKind, RoomConfig, Scene, euroc};

thread_local! {
    /// Calls of the allocator by this thread (the harness has another), and the bytes that are out.
    static TALLY: Cell<(u64, i64)> = const { Cell::new((0, 0)) };
}

fn note(bytes: i64) {
    // A thread that is ending has no tally any more, and nothing here to count.
    let _ = TALLY.try_with(|tally| {
        let (calls, live) = tally.get();
        tally.set((calls + 1, live + bytes));
    });
}

/// One flight at a time, so that the resident memory is its own.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Counts calls and the bytes that are out.
struct Counting;

// SAFETY: hands everything on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size() as i64);
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(size as i64 - layout.size() as i64);
        // SAFETY: as the caller promised.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        note(-(layout.size() as i64));
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Resident memory of this process, bytes, its own pages: those of the program's file come and go. None where there is no /proc.
fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("RssAnon:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? * 1024)
}

/// All inputs of a flight, made before it.
struct Inputs<T: Real> {
    imu: Vec<ImuSample<T>>,
    frames: Vec<(Timestamp, Vec<Observation<T>>)>,
}

fn inputs<T: Real>(duration_s: f64, tracks: usize) -> Inputs<T> {
    let motion = AnalyticConfig { kind: MotionKind::Medium, duration_s, ..AnalyticConfig::default() };
    let flight = Flight::analytic(&motion, &ImuConfig::default(), 20.0, 1).unwrap();
    let scene = Scene::room(&RoomConfig::vicon(&flight.path()), &flight.path(), 1).unwrap();
    let features = FeatureConfig { count: tracks, ..FeatureConfig::default() };
    let mut tracker = Tracker::new(&scene, euroc::camera(0), &features, 1).unwrap();
    let body_from_camera = euroc::body_from_camera(0);
    let observe = |stamp: &Timestamp| {
        let seconds = (*stamp - flight.epoch).as_seconds::<f64>();
        let seen = tracker.observe(seconds, &flight.world_from_camera(*stamp, &body_from_camera));
        (*stamp, seen.iter().map(|seen| Observation { track: seen.track, pixel: seen.pixel.map(T::of) }).collect())
    };
    let frames = flight.frame_stamps.iter().map(observe).collect();
    let cast = |sample: &ImuSample<f64>| ImuSample {
        stamp: sample.stamp,
        gyro_rad_s: sample.gyro_rad_s.map(T::of),
        accel_m_s2: sample.accel_m_s2.map(T::of),
    };
    Inputs { imu: flight.imu.iter().map(cast).collect(), frames }
}

/// Flies, and compares the memory at every tenth of the flight with that after the first.
fn memory_stands_still<T: Real, const FRAMES: usize, const PAIRS: usize, const POINTS: usize, const SAMPLES: usize>(
    name: &str,
    duration_s: f64,
    camera: CameraModel<T>,
    body_from_camera: nalgebra::Isometry3<T>,
) {
    let _alone = ONE_AT_A_TIME.lock();
    let inputs = inputs::<T>(duration_s, (POINTS * 3 / 4).min(150));
    // Whoever brings corners knows how good they are.
    let config = EstimatorConfig { sigma_px: T::of(FeatureConfig::default().sigma_px), ..EstimatorConfig::default() };
    let mut estimator = Box::new(Estimator::<T, FRAMES, PAIRS, POINTS, SAMPLES>::new(config, camera, body_from_camera));
    let (mut next, mut poses, mut lost) = (0, 0, 0);
    // Room for the marks, so that taking them changes nothing.
    let mut marks = Vec::with_capacity(10);
    let tenth = inputs.frames.len() / 10;
    for (index, (stamp, observations)) in inputs.frames.iter().enumerate() {
        if index > 0 && index % tenth == 0 && marks.len() < marks.capacity() {
            // Reading /proc allocates, and frees again: the calls are counted before it.
            let counted = TALLY.get();
            let resident = resident_bytes();
            marks.push((counted, resident, TALLY.get().0));
        }
        while let Some(sample) = inputs.imu.get(next).filter(|sample| sample.stamp <= *stamp) {
            estimator.push_imu(*sample).unwrap();
            next += 1;
        }
        estimator.push_tracks(*stamp, observations).unwrap();
        lost += usize::from(estimator.step(StepBudget::default()) == FrameOutcome::Lost);
        poses += usize::from(estimator.state().is_some());
    }
    for pair in marks.windows(2) {
        let (((_, live_before), _, calls_before), ((calls, live), _, _)) = (pair[0], pair[1]);
        assert_eq!((calls - calls_before, live - live_before), (0, 0), "{name}: the allocator was called in flight");
    }
    let resident: Vec<u64> = marks.iter().filter_map(|(_, resident, _)| *resident).collect();
    let growth = resident.iter().max().zip(resident.first()).map(|(most, first)| most - first);
    println!(
        "{name}: {duration_s} s, {poses} of {} poses, lost {lost} times, resident {:?}, grown by {growth:?} bytes",
        inputs.frames.len(),
        resident.first()
    );
    assert!(growth.is_none_or(|growth| growth == 0), "{name}: the resident memory grew by {growth:?} bytes");
    assert!(poses * 10 > inputs.frames.len() * 7, "{name}: only {poses} poses");
}

fn profiles(duration_s: f64) {
    let camera = euroc::camera(0);
    let mount = euroc::body_from_camera(0);
    memory_stands_still::<f64, 16, 136, 640, 4096>("Desktop, f64", duration_s, camera, mount);
    memory_stands_still::<f32, 16, 136, 640, 4096>("Desktop, f32", duration_s, camera.cast(), mount.cast());
    memory_stands_still::<f32, 8, 36, 150, 512>("Mobile", duration_s, camera.cast(), mount.cast());
}

/// The capacities above are those of `libella_core::profile`.
const _: fn(libella_core::profile::Desktop<f64>) -> Estimator<f64, 16, 136, 640, 4096> = |desktop| desktop;
const _: fn(libella_core::profile::Mobile) -> Estimator<f32, 8, 36, 150, 512> = |mobile| mobile;

#[test]
fn twenty_seconds_of_flight_in_constant_memory() {
    profiles(20.0);
}

#[test]
#[ignore = "ten minutes of flight, three times"]
fn ten_minutes_of_flight_in_constant_memory() {
    profiles(600.0);
}
