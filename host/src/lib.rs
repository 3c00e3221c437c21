//! Everything of libella with a file, a thread or a model in it.

pub mod dataset;
pub mod eval;
pub mod sim;
