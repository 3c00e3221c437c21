//! What the firmware does, apart from the machine it does it on: the same code runs on the microcontroller and on the host.
//!
//! ```text
//! Replay ─▶ driver::{Imu, Camera, Depth} ─▶ schedule ─▶ Micro ⇄ Planes ─▶ telemetry
//!                  ▲ Fault                     │ Clock ─▶ cycles
//! ```
#![cfg_attr(target_os = "none", no_std)]
#![forbid(unsafe_code)]

pub mod cycles;
pub mod driver;
pub mod fault;
pub mod memory;
pub mod planes;
pub mod replay;
pub mod schedule;
pub mod telemetry;
