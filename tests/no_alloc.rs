//! Nothing is allocated or freed by the estimator once it stands: not in flight, not when it refuses an input, not when
//! it loses its way and starts over.
#![allow(unsafe_code)] // a global allocator cannot be written without

mod support {
    pub mod room;
}

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use libella_core::estimator::{Estimator, EstimatorConfig, FrameOutcome, StepBudget};
use libella_core::image::{ImageView, PyramidPair};
use libella_core::imu::ImuSample;
use libella_core::profile::Desktop;
use libella_core::real::Real;
use libella_core::track::{Observation, TrackId};
use support::room::{self, HEIGHT, IMAGE_STEP_NS, IMU_STEP_NS, Renderer, WIDTH};

/// Counts the calls of the thread that makes them, and passes them on.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

thread_local! {
    static CALLS: Cell<usize> = const { Cell::new(0) };
}

fn note() {
    // A thread that is ending has no counter any more, and nothing here to count.
    let _ = CALLS.try_with(|calls| calls.set(calls.get() + 1));
}

// SAFETY: every call goes to the system's allocator with unchanged arguments.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note();
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note();
        unsafe { System.realloc(block, layout, size) }
    }
    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        note();
        unsafe { System.dealloc(block, layout) }
    }
}

/// What the call gives, and how often it asked the allocator for anything.
fn counted<R>(call: impl FnOnce() -> R) -> (R, usize) {
    let before = CALLS.get();
    let result = call();
    (result, CALLS.get() - before)
}

/// Calls of the allocator by input, and what became of the frames.
#[derive(Debug, Default)]
struct Tally {
    imu: usize,
    frames: usize,
    steps: usize,
    refusals: usize,
    tracked: usize,
    coasted_or_lost: usize,
}

impl Tally {
    fn note_outcome(&mut self, outcome: FrameOutcome) {
        match outcome {
            FrameOutcome::Tracked | FrameOutcome::NewKeyframe => self.tracked += 1,
            FrameOutcome::Coasted | FrameOutcome::Lost => self.coasted_or_lost += 1,
            _ => {}
        }
    }

    /// # Panics
    /// When the allocator was called, or when the estimator never came to work, so that nothing was shown.
    fn assert_silent(&self, tracked_at_least: usize) {
        assert_eq!((self.imu, self.frames, self.steps, self.refusals), (0, 0, 0, 0), "the allocator was called: {self:?}");
        assert!(self.tracked >= tracked_at_least, "too few frames were tracked for this to show anything: {self:?}");
    }
}

fn in_scalar<T: Real>(sample: &ImuSample<f64>) -> ImuSample<T> {
    ImuSample { stamp: sample.stamp, gyro_rad_s: sample.gyro_rad_s.map(T::of), accel_m_s2: sample.accel_m_s2.map(T::of) }
}

fn camera<T: Real>() -> libella_core::camera::CameraModel<T> {
    use libella_core::camera::{CameraModel, PinholeRadTan};
    match room::camera() {
        CameraModel::PinholeRadTan(pinhole) => CameraModel::PinholeRadTan(PinholeRadTan {
            size_px: pinhole.size_px,
            focal_px: pinhole.focal_px.map(T::of),
            center_px: pinhole.center_px.map(T::of),
            distortion: pinhole.distortion.map(T::of),
        }),
        other => panic!("the room is seen through a pinhole, not {other:?}"),
    }
}

fn estimator<T: Real>() -> Box<Desktop<T>> {
    let pose = room::body_from_camera();
    let body_from_camera = nalgebra::Isometry3::from_parts(
        nalgebra::Translation3::from(pose.translation.vector.map(T::of)),
        nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::from(pose.rotation.coords.map(T::of))),
    );
    Box::new(Desktop::new(EstimatorConfig::default(), camera(), body_from_camera))
}

/// The inertial samples up to and past the image at `nanos`, which an estimator needs before it can use that image.
fn push_imu_past<T: Real, const F: usize, const P: usize, const L: usize, const S: usize>(
    estimator: &mut Estimator<T, F, P, L, S>,
    next_ns: &mut i64,
    nanos: i64,
    tally: &mut Tally,
) {
    while *next_ns <= nanos + IMU_STEP_NS {
        let sample = in_scalar(&room::imu_sample(*next_ns));
        let (result, calls) = counted(|| estimator.push_imu(sample));
        result.unwrap_or_else(|error| panic!("a good sample was refused: {error}"));
        tally.imu += calls;
        *next_ns += IMU_STEP_NS;
    }
}

/// The estimator and its buffers are built on the stack before they move to the heap, which in an unoptimised build
/// needs more of it than a test's thread has.
fn with_large_stack(test: impl FnOnce() + Send + 'static) {
    let thread = std::thread::Builder::new().stack_size(128 << 20).spawn(test);
    let outcome = thread.unwrap_or_else(|error| panic!("no thread: {error}")).join();
    if let Err(cause) = outcome {
        std::panic::resume_unwind(cause);
    }
}

#[test]
fn the_counter_counts() {
    let (block, calls) = counted(|| std::hint::black_box(Box::new(7_u64)));
    assert_eq!(calls, 1);
    assert_eq!(counted(|| drop(block)).1, 1);
    assert_eq!(counted(|| std::hint::black_box(1 + 1)).1, 0);
}

#[test]
fn images_are_followed_without_an_allocation() {
    with_large_stack(|| {
        const PYRAMID_BYTES: usize = WIDTH * HEIGHT * 4 / 3;
        let renderer = Renderer::new();
        let mut estimator = estimator::<f64>();
        let mut pyramids = Box::new(PyramidPair::<PYRAMID_BYTES>::default());
        let mut tally = Tally::default();
        let mut next_imu_ns = 0;
        let black = vec![0_u8; WIDTH * HEIGHT];
        // 5 s of the room, 3 s of darkness, 1 s of the room again.
        for frame in 0..180 {
            let nanos = frame * IMAGE_STEP_NS + IMU_STEP_NS;
            let rendered;
            let pixels = if (100..160).contains(&frame) {
                &black
            } else {
                rendered = renderer.image(nanos);
                &rendered
            };
            push_imu_past(&mut estimator, &mut next_imu_ns, nanos, &mut tally);
            let image = ImageView::new(pixels, WIDTH, HEIGHT, WIDTH).unwrap_or_else(|error| panic!("{error}"));
            let (result, calls) = counted(|| estimator.push_image(room::stamp(nanos), &image, &mut pyramids));
            result.unwrap_or_else(|error| panic!("a good image was refused: {error}"));
            tally.frames += calls;
            let (outcome, calls) = counted(|| estimator.step(StepBudget::default()));
            tally.steps += calls;
            tally.note_outcome(outcome);
            let (_, calls) = counted(|| (estimator.state(), estimator.health()));
            tally.steps += calls;
        }
        let small = ImageView::new(&black, WIDTH / 2, HEIGHT, WIDTH).unwrap_or_else(|error| panic!("{error}"));
        let (result, calls) = counted(|| estimator.push_image(room::stamp(next_imu_ns), &small, &mut pyramids));
        assert!(result.is_err(), "an image of another size was taken");
        tally.refusals += calls;
        // The moving start takes up to 2.5 s; of the 5 s in light at least two are then left.
        tally.assert_silent(40);
        assert!(tally.coasted_or_lost > 0, "the darkness went unnoticed: {tally:?}");
    });
}

fn tracks_without_an_allocation<T: Real>() {
    let mut estimator = estimator::<T>();
    let mut tally = Tally::default();
    let mut next_imu_ns = 0;
    let landmarks = room::landmarks(1_500);
    // A corner that comes back is a new track.
    let mut visits = vec![(0_u32, false); landmarks.len()];
    for frame in 0..200 {
        let nanos = frame * IMAGE_STEP_NS + IMU_STEP_NS;
        push_imu_past(&mut estimator, &mut next_imu_ns, nanos, &mut tally);
        let mut observations = Vec::new();
        for (index, (point, (visit, visible))) in landmarks.iter().zip(&mut visits).enumerate() {
            let pixel = room::pixel_of(point, nanos).filter(|_| observations.len() < 150);
            *visit += u32::from(pixel.is_some() && !*visible);
            *visible = pixel.is_some();
            if let Some(pixel) = pixel {
                let track = TrackId(*visit * 10_000 + index as u32);
                observations.push(Observation { track, pixel: pixel.map(T::of) });
            }
        }
        let (result, calls) = counted(|| estimator.push_tracks(room::stamp(nanos), &observations));
        result.unwrap_or_else(|error| panic!("good corners were refused: {error}"));
        tally.frames += calls;
        let (outcome, calls) = counted(|| estimator.step(StepBudget::default()));
        tally.steps += calls;
        tally.note_outcome(outcome);
    }
    let mut broken = in_scalar::<T>(&room::imu_sample(next_imu_ns));
    broken.gyro_rad_s.x = T::of(f64::NAN);
    let stale = in_scalar::<T>(&room::imu_sample(0));
    for sample in [broken, stale] {
        let (result, calls) = counted(|| estimator.push_imu(sample));
        assert!(result.is_err(), "a bad sample was taken: {sample:?}");
        tally.refusals += calls;
    }
    let (result, calls) = counted(|| estimator.push_tracks(room::stamp(0), &[]));
    assert!(result.is_err(), "corners from the past were taken");
    tally.refusals += calls;
    // 10 s, of which the moving start may take a quarter.
    tally.assert_silent(140);
}

#[test]
fn tracks_are_estimated_without_an_allocation_in_f64() {
    with_large_stack(tracks_without_an_allocation::<f64>);
}

#[test]
fn tracks_are_estimated_without_an_allocation_in_f32() {
    with_large_stack(tracks_without_an_allocation::<f32>);
}
