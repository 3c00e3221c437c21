//! The firmware: static memory, the machine's clock, telemetry over semihosting.
//!
//! The command line that the emulator hands over is `ADDRESS PLAN`: where the recording lies (hexadecimal), as if in the frame
//! memory of the sensors, and how it is flown.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod machine;

/// The host has `cargo test` instead.
#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this is firmware: build it for thumbv7em-none-eabihf, see firmware-sim/run");
}
