//! Links the estimator for a target without operating system or allocator. See `Cargo.toml`.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use libella_core::camera::{CameraModel, PinholeRadTan};
use libella_core::estimator::{EstimatorConfig, StepBudget};
use libella_core::image::{ImageView, PyramidPair};
use libella_core::imu::ImuSample;
use libella_core::profile::Desktop;
use libella_core::time::Timestamp;
use libella_core::track::{Observation, TrackId};
use nalgebra::{Isometry3, Vector2, Vector3};

/// Width, height (px) and the bytes of the pyramid of that image.
const WIDTH: usize = 160;
const HEIGHT: usize = 120;
const PYRAMID_BYTES: usize = WIDTH * HEIGHT * 4 / 3;

#[panic_handler]
fn halt(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[unsafe(no_mangle)]
extern "C" fn _start() -> ! {
    let camera = CameraModel::PinholeRadTan(PinholeRadTan {
        size_px: (WIDTH as u32, HEIGHT as u32),
        focal_px: black_box([100.0_f32; 2]),
        center_px: black_box([80.0, 60.0]),
        distortion: black_box([0.0; 4]),
    });
    let mut estimator = Desktop::<f32>::new(EstimatorConfig::default(), camera, black_box(Isometry3::identity()));
    let mut pyramids = PyramidPair::<PYRAMID_BYTES>::default();
    let pixels = black_box([0_u8; WIDTH * HEIGHT]);
    loop {
        let stamp = Timestamp::from_nanos(black_box(0));
        let sample = ImuSample { stamp, gyro_rad_s: black_box(Vector3::zeros()), accel_m_s2: black_box(Vector3::new(0.0, 0.0, 9.81)) };
        black_box(estimator.push_imu(sample)).ok();
        if let Ok(image) = ImageView::new(&pixels, WIDTH, HEIGHT, WIDTH) {
            black_box(estimator.push_image(stamp, &image, &mut pyramids)).ok();
        }
        let corners = black_box([Observation { track: TrackId(1), pixel: Vector2::new(1.0, 2.0) }]);
        black_box(estimator.push_tracks(stamp, &corners)).ok();
        black_box(estimator.step(StepBudget::default()));
        black_box((estimator.state(), estimator.health()));
    }
}
