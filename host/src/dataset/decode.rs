//! Image files to grey pixels, a few images ahead of their reader.

use std::io::Cursor;
use std::path::Path;
use std::sync::mpsc::{Receiver, sync_channel};

use image::{DynamicImage, ImageReader};
use libella_core::image::{ImageView, ImageViewError};
use libella_core::time::Timestamp;

use super::frames::{ImageFile, ImageReader as PackedReader, PackedImage};
use crate::fault::{Fault, FaultKind};

/// An image with its time, or why there is none.
pub type Decoded = (Timestamp, Result<GrayImage, Fault>);

/// Eight-bit grey pixels, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GrayImage {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// `width × height` bytes.
    pub pixels: Vec<u8>,
}

impl GrayImage {
    /// What the estimator reads.
    ///
    /// # Errors
    /// When the pixels do not fill the stated size.
    pub fn view(&self) -> Result<ImageView<'_>, ImageViewError> {
        ImageView::new(&self.pixels, self.width, self.height, self.width)
    }
}

/// Decodes a PNG or JPEG file; colours become grey.
///
/// # Errors
/// When the file is absent, cut off, or no such image.
pub(super) fn read(path: &Path) -> Result<GrayImage, Fault> {
    let bytes = std::fs::read(path).map_err(|error| Fault::missing(path, format!("image cannot be read ({error})"), "copy it again"))?;
    gray(&bytes).map_err(|reason| Fault::malformed(path, format!("image cannot be decoded ({reason})"), "copy it again"))
}

/// Decodes the bytes of a PNG or JPEG file; colours become grey. The decoder's own limits bound the memory that an image may claim.
///
/// # Errors
/// What is wrong with it.
pub(super) fn gray(bytes: &[u8]) -> Result<GrayImage, String> {
    ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|error| error.to_string())
        .and_then(|reader| reader.decode().map_err(|error| error.to_string()))
        .map(GrayImage::from)
        .map_err(|reason| reason.replace('\n', " "))
}

impl From<DynamicImage> for GrayImage {
    fn from(image: DynamicImage) -> Self {
        let gray = image.into_luma8();
        Self { width: gray.width() as usize, height: gray.height() as usize, pixels: gray.into_raw() }
    }
}

/// Width and height from the head of a file, or `None` where it cannot be read.
pub(super) fn size(path: &Path) -> Option<(u32, u32)> {
    ImageReader::open(path).ok()?.with_guessed_format().ok()?.into_dimensions().ok()
}

/// Starts the thread that decodes; it ends when all is read or the receiver is dropped.
pub(super) fn start(images: Vec<ImageFile>, ahead: usize) -> Result<Receiver<Decoded>, Fault> {
    spawn(images.into_iter().map(|image| (image.stamp, read(&image.path))), ahead)
}

/// The same for images within a larger file.
pub(super) fn start_packed(mut reader: Box<dyn PackedReader>, images: Vec<PackedImage>, ahead: usize) -> Result<Receiver<Decoded>, Fault> {
    spawn(images.into_iter().map(move |image| (image.stamp, reader.read(image.place))), ahead)
}

fn spawn(images: impl Iterator<Item = Decoded> + Send + 'static, ahead: usize) -> Result<Receiver<Decoded>, Fault> {
    let (sender, receiver) = sync_channel(ahead.max(1));
    std::thread::Builder::new()
        .name("decode".into())
        .spawn(move || {
            for image in images {
                if sender.send(image).is_err() {
                    break;
                }
            }
        })
        .map_err(|error| Fault::new(FaultKind::Output, format!("no thread for decoding ({error})"), "free memory or raise the limit"))?;
    Ok(receiver)
}
