//! A network that tells depths from some of the images.

use libella_core::depth::DepthView;
use libella_core::time::Timestamp;

use crate::fault::Fault;
use crate::replay::{MOST_DEPTHS, Replay};

/// Standard deviation of the logarithm that the network claims, of every value: a tenth each of the map and of the region.
const SIGMA_LOG: f32 = 0.14;

/// Where the values of a map lie while they are read: inverse depths, and what the network says of each.
#[derive(Debug)]
pub struct DepthMemory {
    inverse_depth: [f32; MOST_DEPTHS],
    sigma_log: [f32; MOST_DEPTHS],
}

impl Default for DepthMemory {
    fn default() -> Self {
        Self { inverse_depth: [0.0; MOST_DEPTHS], sigma_log: [SIGMA_LOG; MOST_DEPTHS] }
    }
}

/// Gives the depth maps of a recording with their images.
#[derive(Debug)]
pub struct Depth<'a> {
    replay: &'a Replay<'a>,
    fault: Fault,
    began: Timestamp,
    next: usize,
}

impl<'a> Depth<'a> {
    /// A network that was switched on at `began`.
    #[must_use]
    pub fn new(replay: &'a Replay<'a>, fault: Fault, began: Timestamp) -> Self {
        Self { replay, fault, began, next: 0 }
    }

    /// Whether the image taken at `image` has a map; those of images before it are left out.
    pub fn is_due(&mut self, image: Timestamp) -> bool {
        loop {
            match self.replay.depth(self.next) {
                Some((taken, _)) if taken < image => self.next += 1,
                Some((taken, _)) => return taken == image,
                None => return false,
            }
        }
    }

    /// The map of the image that [`Self::is_due`] said has one.
    pub fn read<'m>(&mut self, memory: &'m mut DepthMemory) -> Option<DepthView<'m>> {
        let (taken, depths) = self.replay.depth(self.next)?;
        self.next += 1;
        let fault = if self.fault.is_on(taken - self.began) { self.fault } else { Fault::None };
        for (value, millimetres) in memory.inverse_depth.iter_mut().zip(depths) {
            *value = match (fault, f32::from(millimetres)) {
                (Fault::NanDepth, _) => f32::NAN,
                (Fault::ZeroDepth, _) => 0.0,
                (_, 0.0) => 0.0,
                // As far as the other is near, about 2.5 m.
                (Fault::InvertedDepth, depth) => depth / 6_250.0,
                (_, depth) => 1_000.0 / depth,
            };
        }
        let header = self.replay.header();
        let ((width, height), (columns, rows)) = (header.size_px, header.depth_size);
        let step = [width as f32 / columns as f32, height as f32 / rows as f32];
        let values = columns * rows;
        let (inverse_depth, sigma) = (memory.inverse_depth.get(..values)?, memory.sigma_log.get(..values)?);
        // What the network is unsure of is no more than what it claims.
        DepthView::new(header.depth_size, step, step.map(|step| 0.5 * step - 0.5), inverse_depth, sigma, sigma).ok()
    }
}
