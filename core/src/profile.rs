//! Named capacities, each with its budget of bytes, checked by the compiler.
//!
//! `Estimator<T, FRAMES, PAIRS, POINTS, SAMPLES>` in figures; the pyramids of the images belong to the caller and come on top where
//! nothing else is said.
//!
//! | profile | scalar | frames | points | samples | image | budget |
//! |---|---|---|---|---|---|---|
//! | [`Desktop`] | `f64` or `f32` | 16 | 640 | 4096 | 752×480 | 2 MiB |
//! | [`Mobile`] | `f32` | 8 | 150 | 512 | 640×480 | 128 KiB |
//! | [`Micro`] | `f32` | 6 | 54 | 128 | 160×120 | 96 KiB with [`MicroPyramids`] |

use crate::estimator::Estimator;
use crate::image::{PyramidPair, pyramid_bytes};

/// Workstation: 752×480.
pub type Desktop<T> = Estimator<T, 16, 136, 640, 4096>;

/// Telephone or single-board computer: 640×480 in single precision.
pub type Mobile = Estimator<f32, 8, 36, 150, 512>;

/// Microcontroller: 160×120 in single precision. Half a second of inertial samples at 200 Hz has to fit, or rest is never found.
pub type Micro = Estimator<f32, 6, 21, 54, 128>;

/// Two pyramid levels of two images for [`Micro`]: at this size a patch of the second level sees a fifth of the width.
pub type MicroPyramids = PyramidPair<{ pyramid_bytes(160, 120, 2) }>;

const KIB: usize = 1024;
const _: () = assert!(size_of::<Desktop<f64>>() <= 2048 * KIB);
const _: () = assert!(size_of::<Mobile>() <= 128 * KIB);
const _: () = assert!(size_of::<Micro>() + size_of::<MicroPyramids>() <= 96 * KIB);
