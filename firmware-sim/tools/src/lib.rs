//! Images as a small camera would have taken them, depth maps as a small network would have told them, and recordings for the firmware.

pub mod coarse;
pub mod recording;
pub mod small;
