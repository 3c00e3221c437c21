//! The median of a stream in fixed memory.

use crate::real::Real;

const BINS: usize = 256;
/// Three bits of mantissa: bins are 12.5 % of an octave's start wide.
const SHIFT: u32 = 20;
/// Bin of 2⁻²⁴ and below.
const FIRST: u32 = (127 - 24) << 3;

/// Counts positive values in bins of equal relative width, 2⁻²⁴ to 2⁸, eight to the octave.
pub(super) struct Histogram {
    counts: [u16; BINS],
    total: u32,
}

impl Histogram {
    pub(super) fn new() -> Self {
        Self { counts: [0; BINS], total: 0 }
    }

    pub(super) fn add<T: Real>(&mut self, value: T) {
        let bin = (value.as_f32().abs().to_bits() >> SHIFT).saturating_sub(FIRST) as usize;
        if let Some(count) = self.counts.get_mut(bin.min(BINS - 1)) {
            *count = count.saturating_add(1);
            self.total += 1;
        }
    }

    /// The value below which `part` of the counted values lie, to within 6 %; `None` when nothing was counted.
    pub(super) fn quantile<T: Real>(&self, part: f32) -> Option<T> {
        #[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_sign_loss)]
        let rank = (self.total as f32 * part) as u32;
        let mut below = 0;
        for (bin, count) in (0_u32..).zip(&self.counts) {
            below += u32::from(*count);
            if below > rank {
                let middle = ((bin + FIRST) << SHIFT) + (1 << (SHIFT - 1));
                return Some(T::of(f64::from(f32::from_bits(middle))));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::Histogram;

    #[test]
    fn median_of_a_geometric_row_is_its_middle() {
        let mut histogram = Histogram::new();
        (0..1001).for_each(|i| histogram.add(1e-5_f64 * 1.01_f64.powi(i)));
        let median: f64 = histogram.quantile(0.5).unwrap_or(0.0);
        let expected = 1e-5 * 1.01_f64.powi(500);
        assert!((median / expected).ln().abs() < 0.07, "{median} for {expected}");
        assert_eq!(Histogram::new().quantile::<f64>(0.5), None);
    }
}
