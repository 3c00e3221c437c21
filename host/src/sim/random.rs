//! Reproducible random numbers: the same seed gives the same numbers on every machine and any number of threads.
//!
//! SplitMix64 (Steele, Lea, Flood: "Fast splittable pseudorandom number generators", OOPSLA 2014): a counter that is
//! hashed. Independent streams come from hashing the seed with a label, so that adding a consumer leaves the others alone.

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// The finaliser of SplitMix64: a bijection of 64 bits whose output passes for random.
#[inline]
#[must_use]
pub fn mix(value: u64) -> u64 {
    let value = (value ^ (value >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let value = (value ^ (value >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    value ^ (value >> 31)
}

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Random {
    state: u64,
    spare: Option<f64>,
}

impl Random {
    /// The stream `label` of `seed`.
    #[must_use]
    pub fn new(seed: u64, label: &str) -> Self {
        let label =
            label.bytes().fold(0xCBF2_9CE4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3));
        Self { state: mix(seed.wrapping_add(GOLDEN)) ^ mix(label), spare: None }
    }

    /// The next 64 bits.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// Uniform in `[0, 1)`.
    #[inline]
    #[allow(clippy::cast_precision_loss)]
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform in `[low, high)`.
    #[inline]
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform among `0..count`; 0 for an empty range.
    #[inline]
    #[allow(clippy::cast_possible_truncation)]
    pub fn below(&mut self, count: usize) -> usize {
        ((u128::from(self.bits()) * count as u128) >> 64) as usize
    }

    /// Normally distributed, zero mean, unit variance (polar method of Marsaglia).
    pub fn normal(&mut self) -> f64 {
        if let Some(value) = self.spare.take() {
            return value;
        }
        loop {
            let (x, y) = (self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            let square = x * x + y * y;
            if square > 0.0 && square < 1.0 {
                let scale = (-2.0 * square.ln() / square).sqrt();
                self.spare = Some(y * scale);
                return x * scale;
            }
        }
    }

    /// Three independent normal numbers.
    pub fn normal3(&mut self) -> nalgebra::Vector3<f64> {
        nalgebra::Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// Exponentially distributed with the given mean.
    pub fn exponential(&mut self, mean: f64) -> f64 {
        -mean * (1.0 - self.unit()).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn moments_of_the_distributions() {
        let mut random = Random::new(7, "moments");
        let count = 200_000;
        let (mut sum, mut squares, mut fourth, mut uniform, mut waiting) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for _ in 0..count {
            let value = random.normal();
            sum += value;
            squares += value * value;
            fourth += value.powi(4);
            uniform += random.between(2.0, 4.0);
            waiting += random.exponential(2.5);
        }
        let n = f64::from(count);
        // Four standard errors of each mean.
        assert!((sum / n).abs() < 4.0 / n.sqrt());
        assert!((squares / n - 1.0).abs() < 4.0 * (2.0 / n).sqrt());
        assert!((fourth / n - 3.0).abs() < 4.0 * (96.0 / n).sqrt());
        assert!((uniform / n - 3.0).abs() < 4.0 * (1.0 / 3.0 / n).sqrt());
        assert!((waiting / n - 2.5).abs() < 4.0 * 2.5 / n.sqrt());
    }

    #[test]
    fn streams_are_reproducible_and_apart() {
        let draw = |seed, label: &str| {
            let mut random = Random::new(seed, label);
            [random.bits(), random.bits()]
        };
        assert_eq!(draw(1, "imu"), draw(1, "imu"));
        assert_ne!(draw(1, "imu"), draw(2, "imu"));
        assert_ne!(draw(1, "imu"), draw(1, "features"));
    }
}
