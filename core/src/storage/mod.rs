//! Containers of fixed capacity: nothing here allocates, and a full container gives back what it cannot take.

pub(crate) mod blank;
pub mod blocks;
pub mod ring;
pub mod slots;
