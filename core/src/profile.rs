//! Named capacities, each with its budget of bytes, checked by the compiler.
//!
//! `Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>` in figures; the pyramids of the images belong to the caller and come on top where
//! nothing else is said.
//!
//! | profile | scalar | frames | points | samples | image | budget |
//! |---|---|---|---|---|---|---|
//! | [`Desktop`] | `f64` or `f32` | 16 | 640 | 4096 | 752×480 | 8 MiB |
//! | [`Mobile`] | `f32` | 8 | 150 | 512 | 640×480 | 512 KiB |
//! | [`Micro`] | `f32` | 6 | 64 | 64 | 160×120 | 128 KiB with [`MicroPyramids`] |

use crate::estimator::Estimator;
use crate::image::{PyramidPair, pyramid_bytes};

/// Workstation: 752×480.
pub type Desktop<T> = Estimator<T, 16, 136, 640, 4096>;

/// Telephone or single-board computer: 640×480 in single precision.
pub type Mobile = Estimator<f32, 8, 36, 150, 512>;

/// Microcontroller: 160×120 in single precision.
pub type Micro = Estimator<f32, 6, 21, 64, 64>;

/// Three pyramid levels of two images for [`Micro`].
pub type MicroPyramids = PyramidPair<{ pyramid_bytes(160, 120, 3) }>;

const KIB: usize = 1024;
const _: () = assert!(size_of::<Desktop<f64>>() <= 8 * 1024 * KIB);
const _: () = assert!(size_of::<Mobile>() <= 512 * KIB);
const _: () = assert!(size_of::<Micro>() + size_of::<MicroPyramids>() <= 128 * KIB);
