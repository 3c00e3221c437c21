//! The firmware's main loop on this machine: the same poses as on the microcontroller, in memory of fixed size, without allocating.
//!
//! `cargo test --manifest-path firmware-sim/Cargo.toml -- --nocapture` prints the accuracy.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use libella_core::estimator::{Health, Place};
use libella_core::profile::{Micro, MicroPyramids};
use libella_firmware_sim::cycles::Clock;
use libella_firmware_sim::memory;
use libella_firmware_sim::replay::Replay;
use libella_firmware_sim::schedule::{Plan, Summary, fly};
use libella_firmware_sim::telemetry::Telemetry;
use nalgebra::{Matrix3, Vector3};

/// Stack of the flight. The frames are those of a 64-bit machine, and a thread's own needs come on top.
const STACK_BYTES: usize = 128 * 1024;
/// Lines and bytes of telemetry that are kept.
const LOG_BYTES: usize = 64 * 1024;
/// A pose may differ by this from that of the microcontroller, m.
const TOLERANCE_M: f32 = 1e-4;

thread_local! {
    static IN_FLIGHT: Cell<bool> = const { Cell::new(false) };
}

/// Ends the process when somebody allocates in flight.
struct Grounded;

// SAFETY: hands everything on to the system's allocator, or does not return.
unsafe impl GlobalAlloc for Grounded {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if IN_FLIGHT.get() {
            std::process::abort();
        }
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        if IN_FLIGHT.get() {
            std::process::abort();
        }
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Grounded = Grounded;

/// Costs nothing, for want of a counter that means something.
struct NoClock;

impl Clock for NoClock {
    fn now(&mut self) -> u32 {
        0
    }
}

/// Telemetry into memory that is there already.
struct Log {
    bytes: Box<[u8]>,
    length: usize,
}

impl Telemetry for Log {
    fn send(&mut self, line: &[u8]) {
        if let Some(place) = self.bytes.get_mut(self.length..self.length + line.len()) {
            place.copy_from_slice(line);
            self.length += line.len();
        }
    }
}

struct Flight {
    summary: Summary,
    lines: Vec<String>,
}

/// Flies in a thread with a small stack, in memory that is all there before the start.
fn flight(recording: &[u8], plan: &str) -> Flight {
    let replay = Replay::new(recording).unwrap();
    let plan = Plan::from_name(plan).unwrap();
    let mut place: Box<Place<Micro>> = Box::default();
    let estimator = memory::build(&mut place, &replay);
    let mut pyramids = Box::new(MicroPyramids::new());
    let mut log = Log { bytes: vec![0; LOG_BYTES].into_boxed_slice(), length: 0 };
    let summary = std::thread::scope(|scope| {
        let work = || {
            IN_FLIGHT.set(true);
            let summary = fly(&replay, plan, estimator, &mut pyramids, &mut NoClock, &mut log);
            IN_FLIGHT.set(false);
            summary
        };
        std::thread::Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, work).unwrap().join().unwrap()
    });
    let text = std::str::from_utf8(&log.bytes[..log.length]).unwrap();
    Flight { summary, lines: text.lines().filter(|line| !line.starts_with("cost")).map(str::to_owned).collect() }
}

fn file(name: &str) -> Vec<u8> {
    std::fs::read(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

/// The words of a line, and the numbers of the pose that it ends with.
fn parts(line: &str) -> (Vec<&str>, Vec<f32>) {
    let bits = |word: &&str| word.len() == 8 && word.bytes().all(|byte| byte.is_ascii_hexdigit());
    let words = line.split(' ').filter(|word| !bits(word)).collect();
    let numbers = line.split(' ').filter(bits).map(|word| f32::from_bits(u32::from_str_radix(word, 16).unwrap())).collect();
    (words, numbers)
}

fn millis_and_position(line: &str) -> Option<(i64, Vector3<f64>)> {
    let (words, numbers) = parts(line.strip_prefix("image").map(|_| line)?);
    let [x, y, z, ..] = numbers[..] else { return None };
    Some((words[1].parse().unwrap(), Vector3::new(x, y, z).cast()))
}

/// Root mean square distance to the truth, m, after the best rotation and translation (Umeyama without scale).
fn ate_m(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> f64 {
    let count = pairs.len() as f64;
    let of_estimate = pairs.iter().map(|pair| pair.0).sum::<Vector3<f64>>() / count;
    let of_truth = pairs.iter().map(|pair| pair.1).sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = pairs.iter().map(|(estimate, truth)| (truth - of_truth) * (estimate - of_estimate).transpose()).sum();
    let svd = spread.svd(true, true);
    let (u, v_t) = (svd.u.unwrap(), svd.v_t.unwrap());
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum())) * v_t;
    let squares: f64 =
        pairs.iter().map(|(estimate, truth)| (rotation * (estimate - of_estimate) - (truth - of_truth)).norm_squared()).sum();
    (squares / count).sqrt()
}

fn truth() -> Vec<(i64, Vector3<f64>)> {
    let text = String::from_utf8(file("replay/flight.truth.csv")).unwrap();
    let row = |line: &str| {
        let values: Vec<f64> = line.split(',').map(|value| value.parse().unwrap()).collect();
        (values[0] as i64, Vector3::new(values[1], values[2], values[3]))
    };
    text.lines().skip(1).map(row).collect()
}

/// ATE, m, and the length of the way, m.
fn accuracy(lines: &[String], skipped_ms: i64) -> (f64, f64) {
    let truth = truth();
    let at = |millis: i64| truth.iter().find(|(when, _)| *when == millis + skipped_ms).unwrap().1;
    let pairs: Vec<_> =
        lines.iter().filter_map(|line| millis_and_position(line)).map(|(millis, position)| (position, at(millis))).collect();
    (ate_m(&pairs), pairs.windows(2).map(|pair| (pair[1].1 - pair[0].1).norm()).sum())
}

#[test]
fn the_host_flies_as_the_microcontroller_did() {
    let recording = file("replay/flight.bin");
    let plans = [("none", 0), ("planes", 0), ("depth", 0), ("full", 0), ("moving", 2_000), ("full-moving", 2_000)];
    for (plan, skipped_ms) in plans {
        let flown = flight(&recording, plan);
        let expected = String::from_utf8(file(&format!("expected/{plan}.txt"))).unwrap();
        let expected: Vec<&str> = expected.lines().collect();
        assert_eq!(flown.lines.len(), expected.len());
        let (mut farthest, mut same) = (0.0_f32, 0);
        for (line, expected) in flown.lines.iter().zip(&expected) {
            let ((words, numbers), (expected_words, expected_numbers)) = (parts(line), parts(expected));
            assert_eq!((words, numbers.len()), (expected_words, expected_numbers.len()));
            same += usize::from(numbers == expected_numbers);
            farthest = numbers.iter().zip(&expected_numbers).map(|(a, b)| (a - b).abs()).fold(farthest, f32::max);
        }
        let (ate, way) = accuracy(&flown.lines, skipped_ms);
        println!(
            "{plan}: {same} of {} lines the same bit for bit, else by {farthest:e} at most; ATE {ate:.4} m of {way:.1} m",
            expected.len()
        );
        assert!(farthest <= TOLERANCE_M, "{plan}: differs by {farthest} m");
        // The share that `tests/profiles.rs` grants to Micro. What is left of the flight after the moving start is too short to judge by.
        assert!(skipped_ms > 0 || ate < 0.05 * way, "{plan}: ATE {ate} m of {way} m");
    }
}

#[test]
fn faults_end_in_reported_states_and_the_flight_goes_on() {
    let recording = file("replay/flight.bin");
    let of_motion = [("nan-imu", 20, 130), ("stuck-camera", 0, 120), ("time-back", 100, 120), ("gap", 0, 90)];
    let of_depth = [("nan-depth", 0, 135), ("zero-depth", 0, 135), ("inverted-depth", 0, 135)];
    for (plan, refused, poses) in of_motion.into_iter().chain(of_depth) {
        let flown = flight(&recording, plan);
        println!("{plan}: {:?}, ATE {:.3} m", flown.summary, accuracy(&flown.lines, 0).0);
        assert!(flown.summary.refused >= refused, "{plan}: faulty data was taken");
        assert!(flown.summary.poses >= poses, "{plan}: too few poses");
        // A picture that stood still for a second contradicts the motion for as long as the window remembers it: the estimator may
        // still be starting over when the recording ends, but then it has said that it was lost.
        let said_lost = flown.lines.iter().any(|line| line.ends_with(" lost"));
        let recovered = flown.summary.health == Health::Tracking;
        assert!(recovered || (plan == "stuck-camera" && said_lost), "{plan}: {:?}", flown.summary.health);
        for line in &flown.lines {
            assert!(parts(line).1.iter().all(|number| number.is_finite()), "{plan}: {line}");
        }
    }
}

#[test]
fn what_is_no_recording_is_refused() {
    let recording = file("replay/flight.bin");
    assert!(Replay::new(&recording).is_some());
    assert!(Replay::new(&recording[..recording.len() - 1]).is_none());
    assert!(Replay::new(&recording[1..]).is_none());
    assert!(Replay::new(&[]).is_none());
    let changed = |at: usize, value: u32| {
        let mut bytes = recording.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    // Counts of samples, images and depth maps, the size of an image and that of a map.
    for at in (8..36).step_by(4) {
        assert!(Replay::new(&changed(at, u32::MAX)).is_none(), "{at}");
    }
    // A map of one column, and one larger than the memory for it.
    assert!(Replay::new(&changed(28, 1)).is_none());
    assert!(Replay::new(&changed(32, 16)).is_none());
    assert!(Replay::new(&changed(16, 29)).is_some(), "one map less is still a recording");
}
