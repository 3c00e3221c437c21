//! Halved images.
//!
//! # Model
//! Level 0 is a copy of the caller's image, every further level the mean of 2×2 pixels of the one below, rounded to the
//! nearest grey level. The centre of pixel 0 of every level is at coordinate 0 of that level, hence
//! ```text
//! x₀ + ½ = 2ˡ (xₗ + ½)
//! ```
//! A level of odd width or height drops the last column or row of the level below.
//!
//! Where the buffer ends, one more level is there without memory of its own: its pixels are computed from the level below when they
//! are read, and are the same.

use core::fmt;

use super::ImageView;

/// Most levels of a pyramid, level 0 included.
pub const MAX_LEVELS: usize = 5;

/// A level narrower or lower than this (px) tells a tracker nothing and is left out.
pub const MIN_LEVEL_PX: usize = 24;

/// Why an image has no pyramid. The pyramids are unchanged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PyramidError {
    /// Level 0 alone is larger than the buffer.
    TooLarge {
        /// Bytes that level 0 needs.
        needed: usize,
        /// Bytes per image.
        available: usize,
    },
}

impl fmt::Display for PyramidError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLarge { needed, available } => write!(f, "image of {needed} pixels in a pyramid buffer of {available} bytes"),
        }
    }
}

impl core::error::Error for PyramidError {}

/// Bytes per image of a pyramid of `levels` levels (level 0 included): the `BYTES` of [`PyramidPair`].
#[must_use]
pub const fn pyramid_bytes(width: usize, height: usize, levels: usize) -> usize {
    let (mut width, mut height, mut sum, mut level) = (width, height, 0, 0);
    while level < levels && level < MAX_LEVELS {
        sum += width * height;
        width /= 2;
        height /= 2;
        level += 1;
    }
    sum
}

/// One level of a pyramid: `width × height` pixels without gaps between the rows.
#[derive(Debug, Clone, Copy)]
pub struct Level<'a> {
    /// Its own pixels, or those of the level below.
    pixels: &'a [u8],
    width: usize,
    height: usize,
    /// Width of the level below, where the pixels are its.
    below: Option<usize>,
}

impl<'a> Level<'a> {
    /// All pixels, row by row; the stride is the width. `None` for a level without memory of its own.
    #[inline]
    #[must_use]
    pub fn pixels(&self) -> Option<&'a [u8]> {
        if self.below.is_none() { Some(self.pixels) } else { None }
    }

    /// Copies the block of `side × side` pixels whose first is at (`x`, `y`) to the first `side` columns and rows of `block`;
    /// outside of the level the border is repeated. `None` when `block` is smaller, or the level empty.
    pub fn copy_block<const N: usize>(&self, x: i32, y: i32, side: usize, block: &mut [[u8; N]; N]) -> Option<()> {
        // Not `clamp`, which panics where it cannot tell that a level has pixels.
        let within = |place: i32, size: usize| place.max(0).min(size as i32 - 1) as usize;
        for (j, out) in block.get_mut(..side)?.iter_mut().enumerate() {
            let row = within(y + j as i32, self.height);
            let out = out.get_mut(..side)?;
            if let Some(width) = self.below {
                let upper = self.pixels.get(2 * row * width..)?;
                let (upper, lower) = (upper.get(..width)?, upper.get(width..2 * width)?);
                for (i, out) in out.iter_mut().enumerate() {
                    let column = 2 * within(x + i as i32, self.width);
                    let (upper, lower) = (upper.get(column..column + 2)?, lower.get(column..column + 2)?);
                    *out = mean_of_four(upper, lower);
                }
            } else {
                let row = self.row(row);
                for (i, out) in out.iter_mut().enumerate() {
                    *out = *row.get(within(x + i as i32, self.width))?;
                }
            }
        }
        Some(())
    }

    /// Width, px.
    #[inline]
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    #[inline]
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The pixels of row `y`; empty outside the level, and for a level without memory of its own.
    #[inline]
    #[must_use]
    pub fn row(&self, y: usize) -> &'a [u8] {
        if self.below.is_some() {
            return &[];
        }
        let start = y.saturating_mul(self.width);
        self.pixels.get(start..start.saturating_add(self.width)).unwrap_or(&[])
    }
}

/// Where a level lies in its buffer.
#[derive(Debug, Clone, Copy)]
struct Extent {
    start: usize,
    width: usize,
    height: usize,
}

impl Extent {
    const EMPTY: Self = Self { start: 0, width: 0, height: 0 };

    const fn area(&self) -> usize {
        self.width * self.height
    }
}

/// The levels of one image.
#[derive(Debug, Clone)]
struct Pyramid<const BYTES: usize> {
    pixels: [u8; BYTES],
    extents: [Extent; MAX_LEVELS],
    levels: usize,
}

impl<const BYTES: usize> Pyramid<BYTES> {
    const EMPTY: Self = Self { pixels: [0; BYTES], extents: [Extent::EMPTY; MAX_LEVELS], levels: 0 };

    fn level(&self, level: usize) -> Option<Level<'_>> {
        let extents = self.extents.get(..self.levels)?;
        let extent = extents.get(level)?;
        if let Some(pixels) = self.pixels.get(extent.start..extent.start + extent.area()) {
            return Some(Level { pixels, width: extent.width, height: extent.height, below: None });
        }
        let below = extents.get(level.checked_sub(1)?)?;
        let pixels = self.pixels.get(below.start..below.start + below.area())?;
        Some(Level { pixels, width: extent.width, height: extent.height, below: Some(below.width) })
    }

    fn fill(&mut self, image: &ImageView<'_>, max_levels: usize) {
        let (width, height) = (image.width(), image.height());
        for (y, row) in self.pixels.chunks_exact_mut(width.max(1)).take(height).enumerate() {
            for (pixel, given) in row.iter_mut().zip(image.row(y)) {
                *pixel = *given;
            }
        }
        self.extents[0] = Extent { start: 0, width, height };
        self.levels = 1;
        for next in 1..max_levels.min(MAX_LEVELS) {
            let below = self.extents[next - 1];
            let start = below.start + below.area();
            let extent = Extent { start, width: below.width / 2, height: below.height / 2 };
            if extent.width < MIN_LEVEL_PX || extent.height < MIN_LEVEL_PX {
                break;
            }
            if start + extent.area() > BYTES {
                // Computed when read, from the level below.
                self.extents[next] = extent;
                self.levels = next + 1;
                break;
            }
            let Some((source, target)) = self.pixels.split_at_mut_checked(start) else { break };
            let source = source.get(below.start..).unwrap_or_default();
            for (row, pair) in target.chunks_exact_mut(extent.width).take(extent.height).zip(source.chunks_exact((2 * below.width).max(1)))
            {
                let (upper, lower) = pair.split_at(below.width);
                halve_rows(upper, lower, row);
            }
            self.extents[next] = extent;
            self.levels = next + 1;
        }
    }
}

/// `out[x]` = rounded mean of the 2×2 block at `2x`.
#[inline]
fn halve_rows(upper: &[u8], lower: &[u8], out: &mut [u8]) {
    for ((out, upper), lower) in out.iter_mut().zip(upper.chunks_exact(2)).zip(lower.chunks_exact(2)) {
        *out = mean_of_four(upper, lower);
    }
}

/// The rounded mean of the first two pixels of two rows.
#[inline(always)]
fn mean_of_four(upper: &[u8], lower: &[u8]) -> u8 {
    let (Some(upper), Some(lower)) = (upper.first_chunk(), lower.first_chunk()) else { return 0 };
    // Two pixels as one 16-bit lane: a shift and a mask part them without a shuffle.
    let (upper, lower) = (u16::from_le_bytes(*upper), u16::from_le_bytes(*lower));
    let sum = (upper & 0xff) + (upper >> 8) + (lower & 0xff) + (lower >> 8);
    ((sum + 2) >> 2) as u8
}

/// The pyramids of the previous and the current image, `BYTES` each, owned by the caller.
///
/// [`pyramid_bytes`] tells the `BYTES` of an image size. A smaller buffer means fewer levels; the first that does not fit is computed
/// when it is read, the others are left out.
#[derive(Debug, Clone)]
pub struct PyramidPair<const BYTES: usize> {
    pyramids: [Pyramid<BYTES>; 2],
    current_is_second: bool,
}

impl<const BYTES: usize> Default for PyramidPair<BYTES> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const BYTES: usize> PyramidPair<BYTES> {
    /// Two empty pyramids; fit for a `static`.
    #[must_use]
    pub const fn new() -> Self {
        Self { pyramids: [Pyramid::EMPTY, Pyramid::EMPTY], current_is_second: false }
    }

    /// Bytes per image.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        BYTES
    }

    /// Makes the current image the previous one (without copying) and `image` the current one, with at most `max_levels` levels.
    ///
    /// # Errors
    /// When level 0 does not fit; nothing has changed then.
    #[inline(never)]
    pub fn push(&mut self, image: &ImageView<'_>, max_levels: usize) -> Result<(), PyramidError> {
        let needed = image.width().saturating_mul(image.height());
        if needed > BYTES {
            return Err(PyramidError::TooLarge { needed, available: BYTES });
        }
        self.current_is_second = !self.current_is_second;
        let [first, second] = &mut self.pyramids;
        let current = if self.current_is_second { second } else { first };
        current.fill(image, max_levels);
        Ok(())
    }

    /// Forgets both images.
    pub fn clear(&mut self) {
        for pyramid in &mut self.pyramids {
            pyramid.levels = 0;
        }
    }

    /// A level of the current image, `None` beyond the last.
    #[must_use]
    pub fn current(&self, level: usize) -> Option<Level<'_>> {
        let [first, second] = &self.pyramids;
        if self.current_is_second { second.level(level) } else { first.level(level) }
    }

    /// A level of the previous image, `None` beyond the last.
    #[must_use]
    pub fn previous(&self, level: usize) -> Option<Level<'_>> {
        let [first, second] = &self.pyramids;
        if self.current_is_second { first.level(level) } else { second.level(level) }
    }

    /// Levels that both images have; zero when there is no previous image or its size was another.
    #[must_use]
    pub fn common_levels(&self) -> usize {
        let [a, b] = &self.pyramids;
        let same_size = a.extents[0].width == b.extents[0].width && a.extents[0].height == b.extents[0].height;
        if same_size { a.levels.min(b.levels) } else { 0 }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::boxed::Box;
    use std::vec::Vec;

    #[test]
    fn bytes_are_the_sum_of_the_levels() {
        assert_eq!(pyramid_bytes(752, 480, 1), 752 * 480);
        assert_eq!(pyramid_bytes(752, 480, 4), 752 * 480 + 376 * 240 + 188 * 120 + 94 * 60);
        assert_eq!(pyramid_bytes(161, 121, 2), 161 * 121 + 80 * 60);
    }

    #[test]
    fn a_level_is_the_rounded_mean_of_four() {
        const BYTES: usize = pyramid_bytes(101, 67, 2);
        let pixels: Vec<u8> = (0..120 * 67_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let view = ImageView::new(&pixels, 101, 67, 120).unwrap();
        let mut pair = Box::new(PyramidPair::<BYTES>::new());
        pair.push(&view, MAX_LEVELS).unwrap();
        let (level, half) = (pair.current(0).unwrap(), pair.current(1).unwrap());
        assert_eq!((half.width(), half.height()), (50, 33));
        assert!(pair.current(2).is_none(), "16 px of height tell nothing");
        for y in 0..67 {
            assert_eq!(level.row(y), &pixels[y * 120..y * 120 + 101]);
        }
        for y in 0..33 {
            for x in 0..50 {
                let sum: u32 = [(0, 0), (1, 0), (0, 1), (1, 1)].iter().map(|&(i, j)| u32::from(level.row(2 * y + j)[2 * x + i])).sum();
                assert_eq!(u32::from(half.row(y)[x]), (sum + 2) / 4);
            }
        }
    }

    #[test]
    fn a_level_without_memory_is_the_same_as_one_with() {
        let pixels: Vec<u8> = (0..101 * 67_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let view = ImageView::new(&pixels, 101, 67, 101).unwrap();
        let mut stored = Box::new(PyramidPair::<{ pyramid_bytes(101, 67, 2) }>::new());
        let mut computed = Box::new(PyramidPair::<{ pyramid_bytes(101, 67, 1) }>::new());
        stored.push(&view, MAX_LEVELS).unwrap();
        computed.push(&view, MAX_LEVELS).unwrap();
        let (stored, computed) = (stored.current(1).unwrap(), computed.current(1).unwrap());
        assert_eq!((computed.width(), computed.height()), (stored.width(), stored.height()));
        assert!(stored.pixels().is_some() && computed.pixels().is_none() && computed.row(0).is_empty());
        for (x, y) in [(0, 0), (3, 5), (38, 21), (-4, -7), (45, 30), (-3, 28), (60, 40)] {
            let mut blocks = [[[0_u8; 12]; 12]; 2];
            stored.copy_block(x, y, 12, &mut blocks[0]).unwrap();
            computed.copy_block(x, y, 12, &mut blocks[1]).unwrap();
            assert_eq!(blocks[0], blocks[1], "block at {x}, {y}");
            // Against the definition, where the block is inside.
            if x >= 0 && y >= 0 && x + 12 <= 50 && y + 12 <= 33 {
                assert_eq!(blocks[0][7][4], stored.row(y as usize + 7)[x as usize + 4]);
            }
        }
        assert!(stored.copy_block(0, 0, 13, &mut [[0_u8; 12]; 12]).is_none(), "a block larger than its memory");
    }

    #[test]
    fn pushing_swaps_and_refusing_changes_nothing() {
        let (a, b) = ([7_u8; 30 * 30], [9_u8; 30 * 30]);
        let mut pair = PyramidPair::<900>::new();
        assert_eq!(pair.common_levels(), 0);
        pair.push(&ImageView::new(&a, 30, 30, 30).unwrap(), 3).unwrap();
        assert_eq!(pair.common_levels(), 0);
        pair.push(&ImageView::new(&b, 30, 30, 30).unwrap(), 3).unwrap();
        assert_eq!(pair.common_levels(), 1);
        assert_eq!((pair.previous(0).unwrap().row(3)[3], pair.current(0).unwrap().row(3)[3]), (7, 9));
        let large = [0_u8; 31 * 30];
        assert_eq!(pair.push(&ImageView::new(&large, 31, 30, 31).unwrap(), 3), Err(PyramidError::TooLarge { needed: 930, available: 900 }));
        assert_eq!((pair.previous(0).unwrap().row(3)[3], pair.current(0).unwrap().row(3)[3]), (7, 9));
        pair.push(&ImageView::new(&a, 25, 30, 30).unwrap(), 3).unwrap();
        assert_eq!(pair.common_levels(), 0, "another size has nothing in common");
    }
}
