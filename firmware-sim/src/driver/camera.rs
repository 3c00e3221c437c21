//! The camera. Its images lie in memory of its own until the next one, as those of a camera with a frame buffer do.

use libella_core::image::ImageView;
use libella_core::time::Timestamp;

use crate::fault::Fault;
use crate::replay::Replay;

/// Gives the images of a recording when they are due.
#[derive(Debug)]
pub struct Camera<'a> {
    replay: &'a Replay<'a>,
    fault: Fault,
    began: Timestamp,
    next: usize,
    stuck: Option<ImageView<'a>>,
}

impl<'a> Camera<'a> {
    /// A camera that was switched on at `began`.
    #[must_use]
    pub fn new(replay: &'a Replay<'a>, fault: Fault, began: Timestamp) -> Self {
        let next = (0..).take_while(|index| replay.image(*index).is_some_and(|(taken, _)| taken < began)).count();
        Self { replay, fault, began, next, stuck: None }
    }

    /// The next image taken until `now`.
    pub fn poll(&mut self, now: Timestamp) -> Option<(Timestamp, ImageView<'a>)> {
        loop {
            let (taken, image) = self.replay.image(self.next).filter(|(taken, _)| *taken <= now)?;
            self.next += 1;
            let elapsed = taken - self.began;
            let stamp = self.fault.stamped(elapsed, taken);
            if !self.fault.is_on(elapsed) {
                return Some((stamp, image));
            }
            match self.fault {
                Fault::Gap => {}
                Fault::StuckCamera => return Some((stamp, *self.stuck.get_or_insert(image))),
                _ => return Some((stamp, image)),
            }
        }
    }
}
