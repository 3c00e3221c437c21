//! Sample consensus: one driver for every model.
//!
//! # Model
//! Draw `n` items, fit a model, count who agrees, keep the best. With the share `w` of inliers, `k` draws contain with probability `p` at
//! least one sample free of outliers:
//! ```text
//! k = ln(1 − p) / ln(1 − wⁿ)              p = 0.99, w = 0.2:  574, 113, 21 draws for n = 3, 2, 1
//! ```
//! `w` starts at the smallest share worth finding and rises with the best model so far. Models are compared by the truncated cost
//! `Σ weight (1 − d²)` over inliers (`d < 1`, in units of the threshold), which unlike a bare count prefers the better centred of two.
//!
//! # Degeneracy
//! Whether a sample determines a model is the model's own judgement: [`SampleModel::fit`] returns `None` where not.
//!
//! # Reference
//! M. Fischler, R. Bolles, "Random Sample Consensus", 1981; P. Torr, A. Zisserman, "MLESAC", 2000 (the truncated cost).

use crate::real::Real;

/// Items among which a model is sought, the model determined by `N` of them.
pub trait SampleModel<T: Real, const N: usize> {
    /// What is fitted.
    type Model;

    /// How many items there are.
    fn count(&self) -> usize;
    /// The model through a sample of different items, or `None` where they do not determine one.
    fn fit(&self, sample: &[usize; N]) -> Option<Self::Model>;
    /// The squared distance of an item from a model in units of the squared threshold: below 1 is an inlier.
    fn squared_distance(&self, model: &Self::Model, item: usize) -> T;
    /// How much an item's consent counts, positive.
    fn weight(&self, _item: usize) -> T {
        T::one()
    }
    /// Draws an item, below [`Self::count`]; uniformly unless the items know better.
    fn draw(&self, generator: &mut Generator) -> usize {
        generator.below(self.count())
    }
    /// What all items weigh.
    fn total_weight(&self) -> T {
        (0..self.count()).fold(T::ZERO, |sum, item| sum + self.weight(item))
    }
    /// How the items agree with a model, `None` if its score is not above `to_beat`: items that lie in memory as a scan likes
    /// them can stop early.
    fn agreement(&self, model: &Self::Model, to_beat: T) -> Option<Agreement<T>> {
        let mut sum = Agreement { score: T::ZERO, weight: T::ZERO, inliers: 0 };
        for item in 0..self.count() {
            let distance = self.squared_distance(model, item);
            if distance < T::one() {
                let weight = self.weight(item);
                sum.score += weight * (T::one() - distance);
                sum.weight += weight;
                sum.inliers += 1;
            }
        }
        (sum.score > to_beat).then_some(sum)
    }
}

/// How all items agree with one model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement<T: Real> {
    /// The truncated cost `Σ weight (1 − d²)` over inliers, by which models are compared.
    pub score: T,
    /// What the inliers weigh.
    pub weight: T,
    /// How many inliers there are.
    pub inliers: usize,
}

/// When to stop drawing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ransac<T: Real> {
    /// `p`, the probability of having drawn a clean sample, below 1.
    pub confidence: T,
    /// The smallest share `w` of inliers worth finding, in (0, 1]; a model with less is not returned.
    pub least_inlier_ratio: T,
    /// Draws at most, whatever the formula says.
    pub max_draws: usize,
}

/// The best model and who agrees with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Consensus<T: Real, M> {
    /// The model as fitted to its sample; refine it on its inliers.
    pub model: M,
    /// How many items are inliers.
    pub inliers: usize,
    /// The share of the total weight that the inliers have.
    pub inlier_ratio: T,
    /// The truncated cost by which models are compared.
    pub score: T,
    /// How many samples were drawn.
    pub draws: usize,
}

impl<T: Real> Default for Ransac<T> {
    /// 99 % confidence, a fifth of inliers, at most 574 draws: those of three-point samples.
    fn default() -> Self {
        Self { confidence: T::of(0.99), least_inlier_ratio: T::of(0.2), max_draws: 574 }
    }
}

impl<T: Real> Ransac<T> {
    /// The best model, or `None` where there are fewer than `N` items or no model reaches the least share of inliers.
    pub fn run<P: SampleModel<T, N>, const N: usize>(&self, items: &P, generator: &mut Generator) -> Option<Consensus<T, P::Model>> {
        let count = items.count();
        if count < N {
            return None;
        }
        let total = items.total_weight();
        let mut best: Option<Consensus<T, P::Model>> = None;
        let mut needed = draws(self.confidence, self.least_inlier_ratio, N).min(self.max_draws);
        let mut drawn = 0;
        while drawn < needed {
            drawn += 1;
            let Some(model) = sample(items, generator).and_then(|sample| items.fit(&sample)) else { continue };
            let to_beat = best.as_ref().map_or(-T::one(), |best| best.score);
            let Some(Agreement { score, weight, inliers }) = items.agreement(&model, to_beat) else { continue };
            let inlier_ratio = weight / total;
            if inlier_ratio >= self.least_inlier_ratio {
                needed = needed.min(draws(self.confidence, inlier_ratio, N));
                best = Some(Consensus { model, inliers, inlier_ratio, score, draws: drawn });
            }
        }
        best.map(|consensus| Consensus { draws: drawn, ..consensus })
    }
}

/// How many samples of `n` items to draw so that, with a share `inlier_ratio` of inliers, one is clean with probability `confidence`.
///
/// At least 1; saturates where no number of draws would do.
#[must_use]
pub fn draws<T: Real>(confidence: T, inlier_ratio: T, n: usize) -> usize {
    let clean = (0..n).fold(T::one(), |product, _| product * inlier_ratio);
    if clean >= T::one() {
        return 1;
    }
    let needed = (-confidence).ln_1p() / (-clean).ln_1p();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let needed = needed.ceil().as_f64() as usize; // saturates; NaN becomes 0
    needed.max(1)
}

/// `N` different items, or `None` where drawing keeps repeating itself.
fn sample<T: Real, P: SampleModel<T, N>, const N: usize>(items: &P, generator: &mut Generator) -> Option<[usize; N]> {
    let mut sample = [usize::MAX; N];
    for position in 0..N {
        let fresh = (0..32).map(|_| items.draw(generator)).find(|item| !sample.contains(item))?;
        *sample.get_mut(position)? = fresh;
    }
    Some(sample)
}

/// Reproducible pseudo-random numbers: xorshift64* (S. Vigna, "An experimental exploration of Marsaglia's xorshift generators", 2016).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Generator(u64);

impl Generator {
    /// A generator whose numbers depend on the seed alone.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        // Spread the bits, so that neighbouring seeds part company; zero would stay zero.
        let mixed = (seed ^ 0x9E37_79B9_7F4A_7C15).wrapping_mul(0xD134_2543_DE82_EF95);
        Self(if mixed == 0 { 1 } else { mixed })
    }

    /// The next 32 bits.
    #[allow(clippy::cast_possible_truncation)]
    pub const fn next_u32(&mut self) -> u32 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32) as u32
    }

    /// A number below `bound`, uniform to 2⁻³² `bound`; 0 if `bound` is 0. Bounds beyond 2³² are not reached.
    #[allow(clippy::cast_possible_truncation)]
    pub const fn below(&mut self, bound: usize) -> usize {
        ((self.next_u32() as u64).wrapping_mul(bound as u64) >> 32) as usize
    }

    /// A number in [0, 1), of 24 random bits.
    pub fn unit<T: Real>(&mut self) -> T {
        T::of(f64::from(self.next_u32() >> 8) / 16_777_216.0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[test]
    fn draws_for_one_clean_sample_in_a_fifth_of_inliers() {
        assert_eq!([3, 2, 1].map(|n| draws(0.99_f64, 0.2, n)), [574, 113, 21]);
        assert_eq!([3, 2, 1].map(|n| draws(0.99_f32, 0.2, n)), [574, 113, 21]);
        assert_eq!(draws(0.99, 1.0, 3), 1);
        assert_eq!(draws(0.99, 0.0, 3), usize::MAX);
        assert_eq!(draws(0.99, f64::NAN, 3), 1);
    }

    /// Points of the plane, of which some lie on a line `y = a x + b`.
    struct Line {
        points: Vec<(f64, f64)>,
        threshold: f64,
    }

    impl SampleModel<f64, 2> for Line {
        type Model = (f64, f64);
        fn count(&self) -> usize {
            self.points.len()
        }
        fn fit(&self, &[first, second]: &[usize; 2]) -> Option<(f64, f64)> {
            assert_ne!(first, second);
            let ((x0, y0), (x1, y1)) = (self.points[first], self.points[second]);
            let slope = (y1 - y0) / (x1 - x0);
            ((x1 - x0).abs() > 1e-6).then_some((slope, y0 - slope * x0))
        }
        fn squared_distance(&self, &(slope, offset): &(f64, f64), item: usize) -> f64 {
            let (x, y) = self.points[item];
            ((y - slope * x - offset) / self.threshold).powi(2)
        }
    }

    fn line(seed: u64, on_line: usize, off_line: usize) -> Line {
        let mut generator = Generator::new(seed);
        let mut number = || generator.unit::<f64>() * 2.0 - 1.0;
        let points = (0..on_line + off_line)
            .map(|i| {
                let x = number();
                (x, if i < on_line { 0.5 * x + 0.2 + 1e-3 * number() } else { number() })
            })
            .collect();
        Line { points, threshold: 5e-3 }
    }

    #[test]
    fn the_clean_sample_is_found_as_often_as_promised() {
        // 40 % inliers; the chance of a random pair of outliers to gather as many is negligible.
        let found = (0..1000_u64).filter(|&seed| {
            let consensus = Ransac::default().run(&line(seed, 40, 60), &mut Generator::new(seed + 7777));
            consensus.is_some_and(|c| (c.model.0 - 0.5).abs() < 0.05 && (c.model.1 - 0.2).abs() < 0.02 && c.inliers >= 30)
        });
        let found = found.count();
        // 99 % of 1000 with a binomial deviation of 3.1, three of them.
        assert!(found >= 980, "{found}");
    }

    #[test]
    fn many_inliers_end_the_search_early() {
        let consensus = Ransac::default().run(&line(3, 95, 5), &mut Generator::new(1)).unwrap();
        assert!(consensus.inlier_ratio >= 0.9 && consensus.draws <= draws(0.99, 0.2, 2) / 5, "{consensus:?}");
    }

    #[test]
    fn no_line_no_consensus() {
        assert_eq!(Ransac::default().run(&line(3, 0, 200), &mut Generator::new(1)), None);
        assert_eq!(Ransac::default().run(&line(3, 1, 0), &mut Generator::new(1)), None);
        let vertical = Line { points: (0..9).map(|i| (0.0, f64::from(i))).collect(), threshold: 1.0 };
        assert_eq!(Ransac::default().run(&vertical, &mut Generator::new(1)), None);
        // Two copies of one item are no sample, so two items still make one.
        assert!(Ransac::default().run(&line(3, 2, 0), &mut Generator::new(1)).is_some());
    }

    /// Numbers with weights; a model is one of them, and inliers lie within 1 of it.
    struct Centers<'a>(&'a [(f64, f64)]);

    impl SampleModel<f64, 1> for Centers<'_> {
        type Model = f64;
        fn count(&self) -> usize {
            self.0.len()
        }
        fn fit(&self, &[item]: &[usize; 1]) -> Option<f64> {
            Some(self.0[item].0)
        }
        fn squared_distance(&self, center: &f64, item: usize) -> f64 {
            (self.0[item].0 - center).powi(2)
        }
        fn weight(&self, item: usize) -> f64 {
            self.0[item].1
        }
    }

    #[test]
    fn weights_decide_over_numbers() {
        let items = [(0.0, 0.5), (0.1, 0.5), (0.2, 0.5), (10.0, 1.0), (10.1, 1.0)];
        let consensus = Ransac::default().run(&Centers(&items), &mut Generator::new(5)).unwrap();
        assert_eq!(consensus.inliers, 2);
        assert!((consensus.inlier_ratio - 2.0 / 3.5).abs() < 1e-15);
    }

    #[test]
    fn of_two_models_with_equal_counts_the_centred_one_wins() {
        let items = [(0.0, 1.0), (0.5, 1.0), (0.9, 1.0), (5.0, 1.0), (6.5, 1.0), (9.0, 1.0)];
        let consensus = Ransac { confidence: 0.999_999, ..Ransac::default() }.run(&Centers(&items), &mut Generator::new(5)).unwrap();
        assert_eq!(consensus.model, 0.5);
    }

    proptest! {
        #[test]
        fn the_same_seed_gives_the_same_answer(seed in any::<u64>()) {
            let items = line(seed, 30, 70);
            let run = || Ransac::default().run(&items, &mut Generator::new(seed));
            prop_assert_eq!(run(), run());
        }

        #[test]
        fn numbers_stay_below_their_bound(seed in any::<u64>(), bound in 1usize..1000) {
            let mut generator = Generator::new(seed);
            for _ in 0..100 {
                prop_assert!(generator.below(bound) < bound);
                let unit: f32 = generator.unit();
                prop_assert!((0.0..1.0).contains(&unit));
            }
        }
    }

    #[test]
    fn numbers_are_uniform() {
        // χ² of 16 cells with 15 degrees of freedom: 99.9 % lies below 37.7.
        for seed in 0..8 {
            let mut generator = Generator::new(seed);
            let mut cells = [0.0_f64; 16];
            for _ in 0..16_000 {
                cells[generator.below(16)] += 1.0;
            }
            let chi2: f64 = cells.iter().map(|cell| (cell - 1000.0).powi(2) / 1000.0).sum();
            assert!(chi2 < 37.7, "seed {seed}: {chi2}");
        }
    }
}
