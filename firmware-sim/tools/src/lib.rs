//! Images as a small camera would have taken them, and recordings for the firmware.

pub mod recording;
pub mod small;
