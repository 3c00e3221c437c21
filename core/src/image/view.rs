//! A borrowed grey image.

use core::fmt;

/// Eight-bit grey pixels lent by the caller, row by row.
#[derive(Debug, Clone, Copy)]
pub struct ImageView<'a> {
    pixels: &'a [u8],
    width: usize,
    height: usize,
    stride: usize,
}

/// Why a buffer is no image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ImageViewError {
    /// Width, height or stride is zero, or the stride is below the width.
    BadShape,
    /// The buffer holds fewer bytes than the shape needs.
    TooShort {
        /// Bytes that the shape needs.
        needed: usize,
        /// Bytes that were given.
        given: usize,
    },
}

impl fmt::Display for ImageViewError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadShape => write!(f, "image width, height and stride must be positive and the stride at least the width"),
            Self::TooShort { needed, given } => write!(f, "image buffer has {given} bytes where its shape needs {needed}"),
        }
    }
}

impl core::error::Error for ImageViewError {}

impl<'a> ImageView<'a> {
    /// A view of `width × height` pixels whose rows start `stride` bytes apart.
    ///
    /// # Errors
    /// When the shape is empty or the buffer too short for it.
    pub fn new(pixels: &'a [u8], width: usize, height: usize, stride: usize) -> Result<Self, ImageViewError> {
        if width == 0 || height == 0 || stride < width {
            return Err(ImageViewError::BadShape);
        }
        let needed = (height - 1).saturating_mul(stride).saturating_add(width);
        if pixels.len() < needed {
            return Err(ImageViewError::TooShort { needed, given: pixels.len() });
        }
        Ok(Self { pixels, width, height, stride })
    }

    /// Width, px.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels of row `y`; empty outside the image.
    #[inline]
    #[must_use]
    pub fn row(&self, y: usize) -> &'a [u8] {
        let start = y.saturating_mul(self.stride);
        if y < self.height { self.pixels.get(start..start + self.width).unwrap_or(&[]) } else { &[] }
    }
}
