//! Everything of libella with a file, a thread or a model in it.

pub mod calibration; // sensor.yaml -> cameras, extrinsics and noise in SI units
pub mod check; // what is wrong with a recording, found before the run
pub mod config; // every number that may be tuned, as one file
pub mod dataset; // folders -> one time-ordered stream of events
pub mod eval; // trajectories against truth
pub mod fault; // what went wrong, where, and what to do
pub mod map; // a whole flight, once it is over
pub mod network; // depth and uncertainty of images
mod paint; // inks, font and colours of all pictures
pub mod pipeline; // events -> estimator -> poses, timings, files
pub mod planes; // points of the map -> planes with names
pub mod report; // output folders -> one HTML page for people
pub mod sim; // worlds with known truth
pub mod suite; // many recordings, variants and runs -> one table
pub mod viewer; // a run -> rerun, live or recorded
