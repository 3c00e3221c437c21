//! Many recordings, several variants of the estimator, several runs of each: the table of a paper as one command.
//!
//! ```text
//! suite.toml or a EuRoC folder ─▶ plan ─▶ prepare ─▶ pool ─▶ run ─▶ table ─▶ table.md, runs.csv, suite.json
//!                                         (renders   (a few         │
//!                                          once)     at a time)     └─ one JSON per run, found again by its key
//! ```
//!
//! # Why runs
//! The same recording and configuration give the same trajectory, bit for bit, so that one run says nothing of how much a figure
//! hangs on decisions that could have fallen otherwise. Run `k` of a suite begins `k − 1` images later, as though the camera had been
//! switched on so much later: other keyframes, other corners, another moment of the start. Its seed and, by `k − 1` times 1e-9 m/s²,
//! its gravity differ too; those alone give the same trajectory to nine digits, since no decision hangs on rounding.

mod fingerprint; // what determines a result, as a number
mod median;
mod outputs; // table.md, runs.csv, suite.json
mod plan; // the file of a suite, or a folder of EuRoC
mod pool; // runs at the same time
mod prepare; // recordings that are there, with their truths
mod published; // what others report
mod run; // one run
mod stored; // depth maps that several runs share
mod table; // rows, columns, the best in bold
mod tables; // the tables of a suite
mod truths; // several truths of one recording
mod variant;

pub use outputs::write_outputs;
pub use plan::{Plan, Sequence, Simulation, Source};
pub use pool::{Outcome, Step, execute};
pub use prepare::{PreparedSequence, prepare};
pub use published::{EUROC, PAPER, Published, SYSTEMS, euroc_name};
pub use run::{OtherAte, RelativeFigure, RunResult};
pub use table::{Cell, Row, Style, Table};
pub use tables::{Exceeding, Summary};
pub use variant::Variant;
