//! libella for C. The header is `include/libella.h`, an example `example/flight.c`.
//!
//! The caller owns the memory: [`libella_size`] bytes aligned to [`libella_alignment`], static or from anywhere, never moved while in
//! use and never freed by this library. Nothing is allocated. A handle may be used by one thread at a time.
//!
//! Planes are read as the pose is, where the configuration asks for them.
#![cfg_attr(not(feature = "std"), no_std)]

mod convert;
mod instance;
mod types;

pub use types::{
    LIBELLA_PLANE_CORNERS, LibellaConfig, LibellaHealth, LibellaLens, LibellaOutcome, LibellaPlane, LibellaPlaneClass, LibellaPose,
    LibellaProfile, LibellaStatus, LibellaTrack,
};

use core::ffi::c_char;
use core::num::NonZeroU32;
use core::ptr::addr_of_mut;

use libella_core::estimator::{Estimator, EstimatorConfig, KeeperConfig, Place, PlaneKeeper, StepBudget};
use libella_core::image::{ImageView, PyramidPair};
use libella_core::imu::{ImuNoise, ImuSample};
use libella_core::time::Timestamp;
use nalgebra::Vector3;

use instance::{ALIGNMENT, DesktopInstance, Header, Instance, MAGIC, MicroInstance, MobileInstance, Operate};

/// An estimator in memory of the caller.
#[derive(Debug)]
pub struct Libella {
    _opaque: [u8; 0],
}

#[cfg(all(not(feature = "std"), target_os = "none"))]
mod bare {
    unsafe extern "C" {
        /// Defined by the program: what to do when this library has found a mistake in itself. Must not return.
        fn libella_panicked() -> !;
    }

    #[panic_handler]
    fn panicked(_: &core::panic::PanicInfo<'_>) -> ! {
        // SAFETY: the program that links this library promises what the declaration says.
        unsafe { libella_panicked() }
    }
}

/// Bytes of memory that an estimator of a profile (a `LibellaProfile`) needs, its images included; 0 for an unknown profile.
#[unsafe(no_mangle)]
pub extern "C" fn libella_size(profile: u32) -> usize {
    instance::profile(profile).map_or(0, instance::bytes)
}

/// Alignment of that memory, bytes.
#[unsafe(no_mangle)]
pub extern "C" fn libella_alignment() -> usize {
    ALIGNMENT
}

/// A configuration with the defaults of the profile (a `LibellaProfile`): noise of an ADIS16448, gravity 9.81 m/s^2, a camera with the
/// axes of the body. Image size, focal lengths, principal point and extrinsics are the caller's to fill in.
#[unsafe(no_mangle)]
pub extern "C" fn libella_config(profile: u32) -> LibellaConfig {
    let noise = ImuNoise::<f32>::adis16448();
    let usual = EstimatorConfig::<f32>::default();
    // Those of the firmware, where they were measured.
    let is_micro = profile == LibellaProfile::Micro as u32;
    let (sigma_px, keyframe_parallax_px) = if is_micro { (0.15, 4.6) } else { (usual.sigma_px, usual.keyframe_parallax_px) };
    LibellaConfig {
        profile,
        lens: LibellaLens::PinholeRadTan as u32,
        width_px: 0,
        height_px: 0,
        focal_px: [0.0; 2],
        center_px: [0.0; 2],
        distortion: [0.0; 4],
        body_from_camera_wxyz: [1.0, 0.0, 0.0, 0.0],
        camera_in_body_m: [0.0; 3],
        gyro_noise_density: noise.gyro_noise_density,
        accel_noise_density: noise.accel_noise_density,
        gyro_random_walk: noise.gyro_random_walk,
        accel_random_walk: noise.accel_random_walk,
        gravity_m_s2: usual.gravity_m_s2,
        sigma_px,
        keyframe_parallax_px,
        planes_every: 0,
    }
}

/// Makes an estimator in `length` bytes at `memory` and writes its handle to `handle`. The handle is valid as long as the memory is.
///
/// # Safety
/// `memory` is null or `length` bytes that nothing else uses; `config` and `handle` are null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_init(
    memory: *mut core::ffi::c_void,
    length: usize,
    config: *const LibellaConfig,
    handle: *mut *mut Libella,
) -> LibellaStatus {
    if memory.is_null() || config.is_null() || handle.is_null() {
        return LibellaStatus::Null;
    }
    // SAFETY: not null, hence valid, as the caller promised.
    let config = unsafe { &*config };
    let Some(profile) = instance::profile(config.profile) else { return LibellaStatus::BadConfig };
    if length < instance::bytes(profile) {
        return LibellaStatus::MemoryTooSmall;
    }
    if !(memory as usize).is_multiple_of(ALIGNMENT) {
        return LibellaStatus::Misaligned;
    }
    // SAFETY: the memory is aligned and large enough for the instance of this profile, and the caller's own.
    let made = unsafe {
        match profile {
            LibellaProfile::Micro => make(memory.cast::<MicroInstance>(), config),
            LibellaProfile::Mobile => make(memory.cast::<MobileInstance>(), config),
            LibellaProfile::Desktop => make(memory.cast::<DesktopInstance>(), config),
        }
    };
    if made.is_none() {
        return LibellaStatus::BadConfig;
    }
    // SAFETY: not null, hence valid, as the caller promised.
    unsafe { *handle = memory.cast() };
    LibellaStatus::Ok
}

/// Writes an instance, part by part; `None` when the configuration is impossible.
///
/// # Safety
/// `place` is aligned memory of the size of the instance.
unsafe fn make<
    const FRAMES: usize,
    const PAIRS: usize,
    const POINTS: usize,
    const SAMPLES: usize,
    const BYTES: usize,
    const PLANES: usize,
    const CORNERS: usize,
    const SEEN: usize,
>(
    place: *mut Instance<Estimator<f32, FRAMES, PAIRS, POINTS, SAMPLES>, PyramidPair<BYTES>, PlaneKeeper<f32, PLANES, CORNERS, SEEN>>,
    config: &LibellaConfig,
) -> Option<()> {
    let (settings, camera, body_from_camera) = convert::settings(config)?;
    if config.width_px as usize * config.height_px as usize > BYTES {
        return None;
    }
    // SAFETY: the fields lie within the memory that the caller vouches for; nothing is read.
    unsafe {
        addr_of_mut!((*place).pyramids).write(const { PyramidPair::new() });
        // A place has the layout of the estimator that is made there; a constant is written without a copy on the stack.
        let estimator = addr_of_mut!((*place).estimator).cast::<Place<Estimator<f32, FRAMES, PAIRS, POINTS, SAMPLES>>>();
        estimator.write(const { Place::new() });
        (*estimator).make(settings, camera, body_from_camera);
        let small = config.profile == LibellaProfile::Micro as u32;
        let keeper = if small { KeeperConfig::small_images() } else { KeeperConfig::default() };
        let keeper = NonZeroU32::new(config.planes_every).map(|every| PlaneKeeper::new(KeeperConfig { every, ..keeper }));
        addr_of_mut!((*place).planes).write(keeper);
        addr_of_mut!((*place).newest).write(Timestamp::from_nanos(0));
        addr_of_mut!((*place).header).write(Header { magic: MAGIC, profile: config.profile });
    }
    Some(())
}

/// The instance behind a handle, whatever its profile.
///
/// # Safety
/// The handle is null, or at least the size of a header can be read behind it; behind one of `libella_init` the memory is unchanged.
unsafe fn open<'a>(handle: *mut Libella) -> Result<&'a mut dyn Operate, LibellaStatus> {
    if handle.is_null() {
        return Err(LibellaStatus::Null);
    }
    if !(handle as usize).is_multiple_of(ALIGNMENT) {
        return Err(LibellaStatus::NotAHandle);
    }
    // SAFETY: aligned, and readable as the caller promised.
    let header = unsafe { *handle.cast::<Header>() };
    if header.magic != MAGIC {
        return Err(LibellaStatus::NotAHandle);
    }
    // SAFETY: `libella_init` wrote an instance of this profile there, and one thread at a time uses it.
    unsafe {
        match instance::profile(header.profile) {
            Some(LibellaProfile::Micro) => Ok(&mut *handle.cast::<MicroInstance>()),
            Some(LibellaProfile::Mobile) => Ok(&mut *handle.cast::<MobileInstance>()),
            Some(LibellaProfile::Desktop) => Ok(&mut *handle.cast::<DesktopInstance>()),
            None => Err(LibellaStatus::NotAHandle),
        }
    }
}

/// `open`, or return why not.
macro_rules! opened {
    ($handle:expr) => {
        // SAFETY: the caller's promise is the same.
        match unsafe { open($handle) } {
            Ok(instance) => instance,
            Err(status) => return status,
        }
    };
}

/// Takes one inertial sample: angular rate (rad/s) and specific force (m/s^2) in body axes. Push samples past an image first.
///
/// # Safety
/// `handle` is null or of `libella_init`; the arrays are null or have three numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_push_imu(
    handle: *mut Libella,
    stamp_ns: i64,
    gyro_rad_s: *const f32,
    accel_m_s2: *const f32,
) -> LibellaStatus {
    let instance = opened!(handle);
    if gyro_rad_s.is_null() || accel_m_s2.is_null() {
        return LibellaStatus::Null;
    }
    // SAFETY: not null, hence three numbers each, as the caller promised; unaligned ones are read all the same.
    let (gyro, accel) = unsafe { (gyro_rad_s.cast::<[f32; 3]>().read_unaligned(), accel_m_s2.cast::<[f32; 3]>().read_unaligned()) };
    let stamp = Timestamp::from_nanos(stamp_ns);
    convert::status(instance.push_imu(ImuSample { stamp, gyro_rad_s: Vector3::from(gyro), accel_m_s2: Vector3::from(accel) }))
}

/// Takes an image of eight-bit grey pixels, `stride` bytes from row to row. The pixels are read during the call only.
///
/// # Safety
/// `handle` is null or of `libella_init`; `pixels` is null or has `stride * height_px` bytes, of which the last row may lack its end.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_push_image(
    handle: *mut Libella,
    stamp_ns: i64,
    pixels: *const u8,
    width_px: u32,
    height_px: u32,
    stride: usize,
) -> LibellaStatus {
    let instance = opened!(handle);
    if pixels.is_null() {
        return LibellaStatus::Null;
    }
    let (width, height) = (width_px as usize, height_px as usize);
    let length = height.checked_sub(1).and_then(|rows| rows.checked_mul(stride)).and_then(|bytes| bytes.checked_add(width));
    let Some(length) = length.filter(|length| *length <= isize::MAX as usize) else { return LibellaStatus::BadImage };
    // SAFETY: not null, hence that many bytes, as the caller promised.
    let pixels = unsafe { core::slice::from_raw_parts(pixels, length) };
    let Ok(image) = ImageView::new(pixels, width, height, stride) else { return LibellaStatus::BadImage };
    convert::status(instance.push_image(Timestamp::from_nanos(stamp_ns), &image))
}

/// Takes the corners of an image from a front end of the caller's own, at most as many as the profile has landmarks.
///
/// # Safety
/// `handle` is null or of `libella_init`; `tracks` is null (then `count` is taken for 0) or has `count` corners.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_push_tracks(
    handle: *mut Libella,
    stamp_ns: i64,
    tracks: *const LibellaTrack,
    count: usize,
) -> LibellaStatus {
    let instance = opened!(handle);
    if count > isize::MAX as usize / size_of::<LibellaTrack>() {
        return LibellaStatus::Full;
    }
    // SAFETY: not null, hence that many corners, as the caller promised.
    let tracks = if tracks.is_null() { &[][..] } else { unsafe { core::slice::from_raw_parts(tracks, count) } };
    instance.push_tracks(Timestamp::from_nanos(stamp_ns), tracks).map_or(LibellaStatus::Full, convert::status)
}

/// Works on the newest image, with at most `iterations` of the solver (4 is usual), and tells what became of it.
/// A start in motion is spread over three to nine images, so that none takes much longer than one in flight.
///
/// # Safety
/// `handle` is null or of `libella_init`; `outcome` is null, when nobody wants to know, or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_step(handle: *mut Libella, iterations: u8, outcome: *mut LibellaOutcome) -> LibellaStatus {
    let instance = opened!(handle);
    let found = convert::outcome(instance.step(StepBudget { iterations, ..StepBudget::even() }));
    if !outcome.is_null() {
        // SAFETY: not null, hence valid, as the caller promised.
        unsafe { *outcome = found };
    }
    LibellaStatus::Ok
}

/// Writes the newest state to `pose`, once there is one.
///
/// # Safety
/// `handle` is null or of `libella_init`; `pose` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_pose(handle: *mut Libella, pose: *mut LibellaPose) -> LibellaStatus {
    let instance = opened!(handle);
    if pose.is_null() {
        return LibellaStatus::Null;
    }
    let Some(estimate) = instance.state() else { return LibellaStatus::NoPose };
    // SAFETY: not null, hence valid, as the caller promised.
    unsafe { *pose = convert::pose(&estimate) };
    LibellaStatus::Ok
}

/// Writes the planes that are fit for use to `planes`, `capacity` of them at most, and their number, which may be larger, to `count`.
///
/// # Safety
/// `handle` is null or of `libella_init`; `planes` is null, or has room for `capacity`; `count` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_planes(
    handle: *mut Libella,
    planes: *mut LibellaPlane,
    capacity: usize,
    count: *mut usize,
) -> LibellaStatus {
    let instance = opened!(handle);
    if count.is_null() || (planes.is_null() && capacity > 0) {
        return LibellaStatus::Null;
    }
    let mut known = 0;
    instance.planes(&mut |plane| {
        if known < capacity {
            // SAFETY: within the room that the caller promised.
            unsafe { planes.add(known).write(plane) };
        }
        known += 1;
    });
    // SAFETY: not null, hence valid, as the caller promised.
    unsafe { *count = known };
    LibellaStatus::Ok
}

/// Writes how the estimator is to `health`.
///
/// # Safety
/// `handle` is null or of `libella_init`; `health` is null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_health(handle: *mut Libella, health: *mut LibellaHealth) -> LibellaStatus {
    let instance = opened!(handle);
    if health.is_null() {
        return LibellaStatus::Null;
    }
    // SAFETY: not null, hence valid, as the caller promised.
    unsafe { *health = convert::health(instance.health()) };
    LibellaStatus::Ok
}

/// Forgets every image and landmark and initialises anew with the next data.
///
/// # Safety
/// `handle` is null or of `libella_init`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn libella_reset(handle: *mut Libella) -> LibellaStatus {
    opened!(handle).reset();
    LibellaStatus::Ok
}

/// What a `LibellaStatus` means, in English.
#[unsafe(no_mangle)]
pub extern "C" fn libella_status_text(status: u32) -> *const c_char {
    convert::status_text(status).as_ptr()
}
