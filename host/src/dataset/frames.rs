//! What the camera gave: files, parts of a file, images made on demand, or corners.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Receiver;

use libella_core::time::Timestamp;

use super::{Decoded, GrayImage, TrackFrame};
use crate::fault::Fault;

/// What the camera gave.
#[derive(Debug)]
pub enum Frames {
    /// Image files, not yet read.
    Images(Vec<ImageFile>),
    /// Images within an archive or a bag, not yet read.
    Packed(PackedImages),
    /// Images that are made when they are asked for.
    Live(LiveImages),
    /// Corners found by somebody else.
    Tracks(Vec<TrackFrame>),
}

/// An image file and its time.
#[derive(Debug, Clone)]
pub struct ImageFile {
    /// When it was taken.
    pub stamp: Timestamp,
    /// Where it lies.
    pub path: PathBuf,
}

/// Images within an archive or a bag.
#[derive(Debug)]
pub struct PackedImages {
    /// When they were taken and where they lie, in the order of time.
    pub images: Vec<PackedImage>,
    /// Where they are read from.
    pub store: Arc<dyn ImageStore>,
}

/// An image within a larger file and its time.
#[derive(Debug, Clone, Copy)]
pub struct PackedImage {
    /// When it was taken.
    pub stamp: Timestamp,
    /// Where it lies.
    pub place: Place,
}

/// Where something lies within the files of a store. What the numbers count is the store's affair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Which of the files.
    pub file: u32,
    /// Where in the file: an offset in bytes, or the number of an entry.
    pub position: u64,
    /// Which of the things there.
    pub index: u32,
}

/// A file, or several, with images in it.
pub trait ImageStore: std::fmt::Debug + Send + Sync {
    /// Opens it for one thread.
    ///
    /// # Errors
    /// When it is not there any more.
    fn reader(&self) -> Result<Box<dyn ImageReader>, Fault>;
}

/// Reads images, one after the other.
pub trait ImageReader: Send {
    /// The image at a place; nearly no effort is lost where places rise.
    ///
    /// # Errors
    /// When what lies there is no image.
    fn read(&mut self, place: Place) -> Result<GrayImage, Fault>;
}

/// Images that are made when they are asked for.
#[derive(Debug)]
pub struct LiveImages {
    /// When they are taken.
    pub stamps: Vec<Timestamp>,
    /// Who makes them.
    pub source: Box<dyn ImageSource>,
}

/// Makes images.
pub trait ImageSource: std::fmt::Debug + Send + Sync {
    /// Starts from the first image; at most `ahead` are made before they are asked for.
    ///
    /// # Errors
    /// When nothing can be made.
    fn start(&self, ahead: usize) -> Result<Receiver<Decoded>, Fault>;
}

impl Frames {
    /// Number of frames.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Images(images) => images.len(),
            Self::Packed(packed) => packed.images.len(),
            Self::Live(live) => live.stamps.len(),
            Self::Tracks(frames) => frames.len(),
        }
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Time of a frame.
    #[must_use]
    pub fn stamp(&self, index: usize) -> Option<Timestamp> {
        match self {
            Self::Images(images) => images.get(index).map(|image| image.stamp),
            Self::Packed(packed) => packed.images.get(index).map(|image| image.stamp),
            Self::Live(live) => live.stamps.get(index).copied(),
            Self::Tracks(frames) => frames.get(index).map(|frame| frame.stamp),
        }
    }

    pub(super) fn retain(&mut self, keep: impl Fn(Timestamp) -> bool) {
        match self {
            Self::Images(images) => images.retain(|image| keep(image.stamp)),
            Self::Packed(packed) => packed.images.retain(|image| keep(image.stamp)),
            Self::Live(live) => live.stamps.retain(|stamp| keep(*stamp)),
            Self::Tracks(frames) => frames.retain(|frame| keep(frame.stamp)),
        }
    }
}
