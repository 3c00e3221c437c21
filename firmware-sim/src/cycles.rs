//! What a stage costs, in the unit of the machine's clock.

/// A counter that runs upwards, and from its end to zero.
pub trait Clock {
    /// What it shows.
    fn now(&mut self) -> u32;
    /// All about one image has been done.
    fn end_of_image(&mut self) {}
}

/// The cost of one image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cost {
    /// `push_imu` of all samples since the image before.
    pub imu: u32,
    /// `push_image`.
    pub image: u32,
    /// `push_depth`.
    pub depth: u32,
    /// `step`.
    pub step: u32,
    /// Planes: those that landmarks are attached to and, now and then, seeking them.
    pub planes: u32,
}

impl Cost {
    /// All of it.
    #[must_use]
    pub fn total(&self) -> u32 {
        [self.image, self.depth, self.step, self.planes].into_iter().fold(self.imu, u32::saturating_add)
    }
}
