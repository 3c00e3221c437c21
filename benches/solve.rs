//! The solver on synthetic truth: 10 keyframes, 500 points, 2,991 observations, inertial factors and a prior.
//! Targets in f64: one iteration of Levenberg-Marquardt 0.6 ms (assembly with Schur complement, factorisation, back-substitution, cost),
//! marginalisation of a keyframe 1 ms.
//! Read the figures on an idle machine: other work on the same core shows up in full.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use libella_core::factor::prior::Prior;
use libella_core::factor::reprojection::CameraMount;
use libella_core::imu::{ImuBias, ImuNoise, ImuSample, NavState, Preintegration};
use libella_core::real::Real;
use libella_core::robust::kernel::Kernel;
use libella_core::solve::normal::{NormalEquations, Parts};
use libella_core::solve::{Settings, Workspace, add_initial, assemble, chain, cholesky, cost, marginalize_oldest, optimize};
use libella_core::storage::blocks::{Block, pairs, place, zero_block};
use libella_core::time::Timestamp;
use libella_core::track::TrackId;
use libella_core::window::{CameraPose, DepthPrior, Frame, Landmark, NormalizedPoint, Window};
use nalgebra::{Isometry3, SMatrix, Translation3, UnitQuaternion, Vector3};

const FRAMES: usize = 12;
const PAIRS: usize = pairs(FRAMES);
const KEYFRAMES: usize = 10;
const POINTS: usize = 500;
const SEEN: usize = 6;
const OBSERVATIONS: usize = 2991;
const INTERVAL_NS: i64 = 250_000_000;

/// Numbers in (−1, 1), the same in every run.
struct Noise(u64);

impl Noise {
    fn draw(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

struct World<T: Real> {
    window: Box<Window<T, FRAMES, POINTS>>,
    prior: Box<Prior<T, FRAMES, PAIRS>>,
    workspace: Box<Workspace<T, FRAMES, PAIRS>>,
    settings: Settings<T>,
    states: Vec<NavState<T>>,
    depths: Vec<T>,
}

fn vector<T: Real>(x: f64, y: f64, z: f64) -> Vector3<T> {
    Vector3::new(T::of(x), T::of(y), T::of(z))
}

/// A camera that flies sideways past points 4 to 10 m ahead, every estimate a little off.
fn world<T: Real>() -> World<T> {
    let mut noise = Noise(7);
    // The camera looks along the body's x axis.
    let looking = UnitQuaternion::from_euler_angles(-core::f64::consts::FRAC_PI_2, 0.0, -core::f64::consts::FRAC_PI_2);
    let body_from_camera: Isometry3<T> =
        nalgebra::convert::<_, Isometry3<f64>>(Isometry3::from_parts(Translation3::new(0.05, 0.02, -0.01), looking)).cast();
    let settings = Settings {
        gravity_in_world: vector(0.0, 0.0, -9.81),
        body_from_camera,
        mount: CameraMount::new(&body_from_camera),
        kernel: Kernel::huber(T::of(2.25)),
        depth_prior: DepthPrior::new(T::of(0.3), T::of(3.0)),
        guessed_depth_prior: DepthPrior::new(T::of(0.3), T::of(0.6)),
        rest_sigma_m_s: T::of(0.02),
        position_jitter_m: T::of(1e-3),
        behind_camera_cost: T::of(100.0),
    };
    let velocity = vector::<T>(0.05, 0.6, 0.1);
    let mut window = Box::new(Window::default());
    let mut truth = Vec::new();
    for k in 0..KEYFRAMES {
        let mut integral = Preintegration::new(ImuBias::default());
        let sample = |i: i64| ImuSample {
            stamp: Timestamp::from_nanos((k as i64 - 1) * INTERVAL_NS + i * 5_000_000),
            gyro_rad_s: Vector3::zeros(),
            accel_m_s2: vector(0.0, 0.0, 9.81),
        };
        for i in 0..50 {
            integral.integrate(&ImuNoise::adis16448(), &sample(i), &sample(i + 1)).unwrap();
        }
        let mut state = NavState::origin();
        state.position_in_world = velocity * T::of(k as f64 * INTERVAL_NS as f64 * 1e-9);
        state.velocity_in_world = velocity;
        truth.push(CameraPose::of(&state, &body_from_camera));
        let off: [T; 15] = core::array::from_fn(|_| T::of(2e-3 * noise.draw()));
        let mut frame = Frame::new(Timestamp::from_nanos(k as i64 * INTERVAL_NS), state.retract(&off), integral);
        frame.keyframe = k + 2 < KEYFRAMES;
        window.frames.push(frame).ok().unwrap();
    }
    let mut observations = 0;
    for l in 0..POINTS {
        let anchor = l % (KEYFRAMES - SEEN + 1);
        let point_in_anchor = {
            let depth = 7.0 + 3.0 * noise.draw();
            vector::<T>(depth * 0.5 * noise.draw(), depth * 0.35 * noise.draw(), depth)
        };
        let point_in_world = truth[anchor].world_from_camera * point_in_anchor + truth[anchor].center_in_world;
        // Nine points are seen once less: 2,991.
        let seen = if l < POINTS * SEEN - OBSERVATIONS { SEEN - 1 } else { SEEN };
        let mut landmark: Option<Landmark<T, FRAMES>> = None;
        for (frame, pose) in truth.iter().enumerate().skip(anchor).take(seen) {
            let seen = pose.world_from_camera.tr_mul(&(point_in_world - pose.center_in_world));
            let error = [T::of(noise.draw() / 458.0), T::of(noise.draw() / 458.0)];
            let point = NormalizedPoint { x: seen.x / seen.z + error[0], y: seen.y / seen.z + error[1], inverse_sigma: T::of(458.0) };
            match &mut landmark {
                Some(landmark) => landmark.observe(frame, point),
                None => landmark = Some(Landmark::new(TrackId(l as u32), frame, point)),
            }
            observations += 1;
        }
        let mut landmark = landmark.unwrap();
        landmark.active = true;
        landmark.inverse_depth = T::of(1.0 + 0.05 * noise.draw()) / point_in_anchor.z;
        window.landmarks.push(landmark).ok().unwrap();
    }
    assert_eq!(observations, OBSERVATIONS);
    let mut prior = Box::new(Prior::default());
    let mut workspace = Box::new(Workspace::default());
    let origin = window.frames[0].state;
    add_initial(&mut prior, &mut workspace, &origin, &(SMatrix::identity() * T::of(100.0)));
    let states = window.frames.iter().map(|frame| frame.state).collect();
    let depths = window.landmarks.iter().map(|landmark| landmark.inverse_depth).collect();
    World { window, prior, workspace, settings, states, depths }
}

impl<T: Real> World<T> {
    /// Back to where the estimates were a little off.
    fn reset(&mut self) {
        for (frame, state) in self.window.frames.iter_mut().zip(&self.states) {
            frame.state = *state;
        }
        for (landmark, depth) in self.window.landmarks.iter_mut().zip(&self.depths) {
            landmark.inverse_depth = *depth;
        }
    }

    fn optimize(&mut self, iterations: u8) -> T {
        self.reset();
        optimize(&mut self.window, &self.prior, &mut self.workspace, &self.settings, iterations).final_cost
    }

    fn assemble(&mut self) -> T {
        assemble(&self.window, &self.prior, &mut self.workspace, &self.settings, T::of(1e-5))
    }

    fn marginalize(&mut self) {
        marginalize_oldest(&mut self.window, &mut self.prior, &mut self.workspace, &self.settings, KEYFRAMES - 2);
    }
}

fn measure<T: Real>(criterion: &mut Criterion, scalar: &str) {
    let mut group = criterion.benchmark_group(format!("solve/{scalar}/10 keyframes x 500 points x 2991 observations"));
    let mut world = world::<T>();
    let before = {
        world.workspace.prepare(&world.window, &world.settings);
        cost(&world.window, &world.prior, &world.workspace, &world.settings)
    };
    println!(
        "cost {:.1} -> {:.1} after one iteration, {:.1} after four",
        before.as_f64(),
        world.optimize(1).as_f64(),
        world.optimize(4).as_f64()
    );
    group.bench_function("one iteration", |b| b.iter(|| world.optimize(1)));
    group.bench_function("four iterations", |b| b.iter(|| world.optimize(4)));
    world.reset();
    world.workspace.prepare(&world.window, &world.settings);
    group.bench_function("assemble", |b| b.iter(|| world.assemble()));
    group.bench_function("cost", |b| b.iter(|| cost(&world.window, &world.prior, &world.workspace, &world.settings)));
    group.bench_function("marginalize a keyframe with 100 points", |b| {
        b.iter_batched(
            self::world::<T>,
            |mut world| {
                world.marginalize();
                world
            },
            BatchSize::LargeInput,
        );
    });
    world.marginalize();
    let (frames, mut gradient) = (world.prior.frames, [[T::ZERO; 15]; FRAMES]);
    let World { window, prior, workspace, .. } = &mut world;
    let normal = workspace.normal.parts();
    group.bench_function(format!("prior on {frames} frames"), |b| {
        b.iter(|| prior.add_to(&window.frames, normal.poses, normal.couplings, &mut normal.own[0], black_box(&mut gradient)))
    });
    group.finish();
}

/// Normal equations of 11 frames, all states joined, copied in anew for every factorisation.
fn factorize<T: Real>(criterion: &mut Criterion, scalar: &str) {
    const N: usize = 11;
    let mut group = criterion.benchmark_group(format!("solve/{scalar}/165x165"));
    let mut noise = Noise(3);
    let mut matrix = vec![zero_block::<T, 15>(); pairs(N)];
    for value in matrix.as_flattened_mut().as_flattened_mut() {
        *value = T::of(0.1 * noise.draw());
    }
    for i in 0..N {
        let block: &mut Block<T, 15> = &mut matrix[place(i, i)];
        #[allow(clippy::needless_range_loop)] // k names a diagonal entry
        for k in 0..15 {
            block[k][k] = T::of(100.0);
        }
    }
    let mut work = matrix.clone();
    group.bench_function("copy", |b| b.iter(|| black_box(&mut work).copy_from_slice(black_box(&matrix))));
    group.bench_function("dense Cholesky", |b| {
        b.iter(|| {
            work.copy_from_slice(black_box(&matrix));
            cholesky::factorize(&mut work, N)
        });
    });
    let mut normal = NormalEquations::<T, FRAMES, PAIRS>::default();
    group.bench_function("velocities and biases along their chain", |b| {
        b.iter(|| {
            let mut parts = normal.parts();
            fill(&mut parts, black_box(&matrix), N);
            chain::factorize(&mut parts, N)
        });
    });
    group.finish();
}

/// The blocks of a dense triangle that are not zero.
fn fill<T: Real>(parts: &mut Parts<'_, T>, dense: &[Block<T, 15>], frames: usize) {
    for (i, j) in (0..frames).flat_map(|i| (0..=i).map(move |j| (i, j))) {
        let block = &dense[place(i, j)];
        parts.poses[place(i, j)] = core::array::from_fn(|r| core::array::from_fn(|c| block[r][c]));
        parts.couplings[place(i, j)] = core::array::from_fn(|r| core::array::from_fn(|c| block[c][6 + r]));
        if i == j {
            parts.own[i] = core::array::from_fn(|r| core::array::from_fn(|c| block[6 + r][6 + c]));
        } else if i == j + 1 {
            parts.before[i] = core::array::from_fn(|r| core::array::from_fn(|c| block[6 + r][6 + c]));
            parts.pose_before[i] = core::array::from_fn(|r| core::array::from_fn(|c| block[6 + r][c]));
        }
    }
}

fn both(criterion: &mut Criterion) {
    measure::<f64>(criterion, "f64");
    measure::<f32>(criterion, "f32");
    factorize::<f64>(criterion, "f64");
    factorize::<f32>(criterion, "f32");
}

criterion_group!(benches, both);
criterion_main!(benches);
