//! Planes that gravity tells apart: found fast, kept steadily.
//!
//! ```text
//! points with normals ─▶ Samples ─▶ detect ─ Detection ─▶ associate ─ PlaneMap ─▶ TrackedPlane, PlaneEvent
//! ```
//!
//! # Time
//! One solver with its refinement on 5,000 points of which a fifth lie on the plane, `f32`, one x86-64 core at 2.6 GHz shared with other work:
//! 1 point 28 µs, 2 points 142 µs, 3 points 668 µs (0.40, 2.25 and 9.6 million instructions); built for x86-64-v3 15, 85 and 365 µs. All planes of
//! 1,000 points: 113 µs with normals, 181 µs without. `cargo bench --bench planes` prints these.
//!
//! # Memory
//! The map is what is kept; the samples and what a detection finds are scratch that the caller lends for the time
//! of a detection.
//!
//! | profile | scalar | planes | corners | map | samples | scratch |
//! |---|---|---|---|---|---|---|
//! | [`MicroPlanes`] | `f32` | 4 | 8 | < 1 KiB | 48 | < 2 KiB with the map |
//! | [`MobilePlanes`] | `f32` | 8 | 12 | < 2 KiB | 400 | < 12 KiB |
//! | [`DesktopPlanes`] | `f64` | 16 | 16 | < 8 KiB | 5000 | < 272 KiB |
//!
//! # Example
//! ```
//! use libella_core::plane::associate::AssociateConfig;
//! use libella_core::plane::fit::FitConfig;
//! use libella_core::plane::{Detections, PlaneClass, PlaneMap, Sample, Samples, Source};
//! use libella_core::robust::ransac::Generator;
//! use libella_core::time::Timestamp;
//! use nalgebra::Vector3;
//!
//! let config = FitConfig::<f64>::default();
//! let mut samples = Samples::<f64, 128>::new(&Vector3::z_axis(), config.normal_tolerance_rad);
//! for k in 0..100 {
//!     let point_in_world = Vector3::new(f64::from(k % 10) * 0.3, f64::from(k / 10) * 0.3, -1.2); // a floor
//!     samples.push(&Sample { point_in_world, normal_in_world: None, source: Source::MapPoint })?;
//! }
//! let mut detections = Detections::<f64, 4, 8>::default();
//! let mut map = PlaneMap::<f64, 4, 8>::new();
//! for look in 0..3 {
//!     detections.detect(&mut samples, None, &config, &mut Generator::new(look));
//!     let now = Timestamp::from_nanos(1_000_000_000 * look as i64);
//!     map.update(&detections, now, &Vector3::zeros(), &AssociateConfig::default(), |_| true, |event| println!("{event:?}"));
//! }
//! let (_, floor) = map.steady().next().ok_or("steady after three looks")?;
//! assert_eq!(floor.class, PlaneClass::Floor);
//! assert!((floor.plane.offset_m - 1.2).abs() < 1e-12 && (floor.polygon.area_m2() - 2.7 * 2.7).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod associate;
pub mod detect;
pub mod fit;
pub mod geometry;
pub mod polygon;
pub mod samples;
pub mod tracked;

pub use associate::{PlaneEvent, PlaneMap};
pub use detect::{Detection, Detections};
pub use geometry::{Orientation, Plane};
pub use polygon::Polygon;
pub use samples::{Sample, SampleError, Samples, Source};
pub use tracked::{PlaneClass, PlaneId, TrackedPlane};

/// Microcontroller.
pub type MicroPlanes = PlaneMap<f32, 4, 8>;
/// Telephone or single-board computer.
pub type MobilePlanes = PlaneMap<f32, 8, 12>;
/// Workstation.
pub type DesktopPlanes = PlaneMap<f64, 16, 16>;

const KIB: usize = 1024;
const _: () = assert!(size_of::<MicroPlanes>() <= KIB && size_of::<MicroPlanes>() + size_of::<Samples<f32, 48>>() <= 2 * KIB);
const _: () = assert!(size_of::<MobilePlanes>() <= 2 * KIB && size_of::<Samples<f32, 400>>() <= 12 * KIB);
const _: () = assert!(size_of::<DesktopPlanes>() <= 8 * KIB && size_of::<Samples<f64, 5000>>() <= 272 * KIB);
