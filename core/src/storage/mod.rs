//! Containers of fixed capacity: what does not fit is handed back.

pub mod ring;
pub mod slots;
