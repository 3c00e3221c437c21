//! The planes of the room, as many as a microcontroller has room for.

use libella_core::estimator::{KeeperConfig, PlaneKeeper};

/// When planes are sought and believed.
pub type Settings = KeeperConfig<f32>;

/// Four planes with polygons of eight corners, sought among 48 landmarks.
pub type Planes = PlaneKeeper<f32, 4, 8, 48>;
