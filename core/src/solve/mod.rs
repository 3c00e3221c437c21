//! Levenberg-Marquardt over the window, the Schur complement of its landmarks, and marginalisation.

// Indices as in the equations; and a comparison that NaN must fail is written so.
#![allow(clippy::needless_range_loop, clippy::neg_cmp_op_on_partial_ord)]

mod assemble;
mod biases;
pub mod chain;
pub mod cholesky;
mod levenberg;
mod marginalize;
pub mod normal;
mod point;
pub mod triangle;
mod workspace;

pub use assemble::{assemble, back_substitute, cost};
pub use biases::newest_bias_variances;
pub use levenberg::{SolveReport, optimize};
pub use marginalize::{add_initial, marginalize_oldest};
pub use workspace::{Geometry, Settings, Workspace};

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
