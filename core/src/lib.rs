#![no_std]
#![forbid(unsafe_code)]
#![doc = include_str!("../README.md")]

#[cfg(test)]
extern crate std;

pub mod camera; // pixels <-> bearings
pub mod depth; // what a network says of distances
pub mod estimator; // the one place that knows the order of events
pub mod factor; // residuals and their Jacobians
pub mod image; // borrowed pixels -> pyramid
pub mod imu; // samples -> preintegration
pub mod init; // the first states
pub mod lie; // rotations, poses, directions
pub mod plane; // gravity-aligned planes: found, kept, named
pub mod profile;
pub mod real; // the scalar: f32 on target, f64 on the host
pub mod robust; // kernels, sample consensus, order statistics
pub mod solve; // Levenberg-Marquardt, Schur complement, marginalisation
pub mod storage; // containers of fixed capacity
pub mod time; // integer nanoseconds
pub mod track; // pyramid -> observations with stable ids
pub mod window; // the states and landmarks being estimated // named capacities and their byte budgets

#[cfg(test)]
pub(crate) mod testing;
