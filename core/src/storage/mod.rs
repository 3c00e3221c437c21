//! Containers of fixed capacity.

pub mod blocks;
