//! Levenberg-Marquardt over the window, the Schur complement of its landmarks, and marginalisation.

mod assemble;
pub mod cholesky;
mod levenberg;
mod marginalize;
pub mod triangle;
mod workspace;

pub use assemble::{assemble, back_substitute, cost};
pub use levenberg::{SolveReport, optimize};
pub use marginalize::{MarginalizationWorkspace, add_initial, marginalize_oldest};
pub use workspace::{Settings, Workspace};

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
