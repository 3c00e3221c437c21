//! Tests of the whole system in one program: each instance of the estimator is compiled once.
//!
//! cargo test --test system                                     all
//! cargo test --test system golden::                            those of one file
//! cargo test --release --test system golden:: -- --ignored     its long ones
//!
//! Tests that count allocations need a program of their own: `no_alloc`, `constant_memory`.
#![allow(clippy::unwrap_used)]

mod support;

mod bad_input; // inputs that cannot be used end in one clear sentence
mod budget; // memory of the profiles
mod check; // planted faults are found, clean recordings are not accused
mod consistency; // stated uncertainty against errors
mod degenerate; // motions and inputs that tell nothing
mod depth; // depth that a network tells, in the estimator
mod equivalence; // two roads to one answer
mod euroc; // real recordings, end to end
mod evaluation; // errors as evo computes them
mod fixtures; // the tests’ own room
mod formats; // every format gives the same trajectory
mod found_planes; // planes found in simulated flights
mod golden; // the table of accuracy
mod keyframe_planes; // planes of a real room from a network and from stereo
mod network; // the shipped networks, and files that are none
mod plane_scenes; // stairs, boards, spheres: nothing false
mod planes; // planes in core
mod profiles; // small windows and single precision
mod real_motion; // real motion, simulated tracks
mod rendered; // real motion, rendered images
mod report; // the page for people
mod room_planes; // planes of rendered rooms
mod run_depth; // runs with depth
