//! What an estimator weighs: each profile's size against its budget, at compile time, and in print.
//!
//! `cargo test --test system budget:: -- --nocapture` prints the table.

use libella_core::image::PyramidPair;
use libella_core::profile::{Desktop, Micro, MicroPyramids, Mobile};

const KIB: usize = 1024;
const MIB: usize = 1024 * KIB;

/// Two pyramids of a 752×480 image, down to the last level.
type Pyramids = PyramidPair<{ 752 * 480 * 4 / 3 }>;

/// Checks a type's size at compile time and lists it for the printed table.
macro_rules! budgets {
    ($($name:literal $kind:ty, $budget:expr;)+) => {
        $(const _: () = assert!(size_of::<$kind>() <= $budget, concat!($name, " is over its budget"));)+
        const TABLE: &[(&str, usize, usize)] = &[$(($name, size_of::<$kind>(), $budget)),+];
    };
}

budgets! {
    "Desktop<f64>" Desktop<f64>, MIB;
    "Desktop<f32>" Desktop<f32>, MIB;
    "Mobile" Mobile, 128 * KIB;
    // Half a kilobyte of it for depths that are given, 8 bytes a landmark, and 1.3 for planes, 20 bytes; the whole below stays at 96.
    "Micro" Micro, 51 * KIB;
    "pyramids 752x480" Pyramids, MIB;
    "pyramids 160x120" MicroPyramids, 48 * KIB;
    "Micro and its images" (Micro, MicroPyramids), 96 * KIB;
}

#[test]
fn every_profile_keeps_its_budget() {
    println!("{:<22} {:>12} {:>12} {:>6}", "", "bytes", "budget", "used");
    for &(name, bytes, budget) in TABLE {
        println!("{name:<22} {bytes:>12} {budget:>12} {:>5.1}%", 100.0 * bytes as f64 / budget as f64);
        assert!(bytes <= budget, "{name}");
    }
}

/// Halving the scalar halves the matrices, which is where the memory should be.
#[test]
fn single_precision_saves_memory() {
    assert!(size_of::<Desktop<f32>>() < size_of::<Desktop<f64>>());
}
