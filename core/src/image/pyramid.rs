//! Halved images.

/// The pyramids of the previous and the current image, `BYTES` each, owned by the caller.
pub struct PyramidPair<const BYTES: usize> {
    levels: [[u8; BYTES]; 2],
}

impl<const BYTES: usize> Default for PyramidPair<BYTES> {
    fn default() -> Self {
        Self { levels: [[0; BYTES]; 2] }
    }
}
impl<const BYTES: usize> PyramidPair<BYTES> {
    /// Bytes per image.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.levels[0].len()
    }
}
