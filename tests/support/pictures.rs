//! Pictures that are there already, as a camera gives them.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};

use libella_core::time::Timestamp;
use libella_host::dataset::{Decoded, Frames, GrayImage, ImageSource, LiveImages};
use libella_host::fault::Fault;

/// Each with its stamp, in order.
pub type Stamped = Arc<Vec<(Timestamp, GrayImage)>>;

struct Pictures(Stamped);

impl std::fmt::Debug for Pictures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} pictures", self.0.len())
    }
}

impl ImageSource for Pictures {
    fn start(&self, ahead: usize) -> Result<Receiver<Decoded>, Fault> {
        let (sender, receiver) = sync_channel(ahead);
        let images = Arc::clone(&self.0);
        // Whoever has had enough hangs up.
        std::thread::spawn(move || images.iter().all(|(stamp, image)| sender.send((*stamp, Ok(image.clone()))).is_ok()));
        Ok(receiver)
    }
}

/// As the frames of a recording.
pub fn frames(images: &Stamped) -> Frames {
    let stamps = images.iter().map(|(stamp, _)| *stamp).collect();
    Frames::Live(LiveImages { stamps, source: Box::new(Pictures(Arc::clone(images))) })
}
