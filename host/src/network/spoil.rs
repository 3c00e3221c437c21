//! What networks get wrong, on purpose: noise with a known distribution, and depth that is nonsense and sure of itself.
//!
//! # Model
//! Noise: the log of a depth errs by `ε_image + ε_pixel`, normal, `ε_image` once per image and `ε_pixel` per block of
//! [`DepthNoise::block`]² map pixels (a network's errors are not independent from pixel to pixel), with a standard deviation that
//! is `pixel_sigma_log · exp(N(0, sigma_spread²))` in each block and which the map reports.
//! `u = sigma_log / √2`, as of a Laplace distribution of that standard deviation. Everything is drawn from the seed and the stamp
//! of the image: the order in which images are asked for does not matter.

use std::f32::consts::FRAC_1_SQRT_2;
use std::str::FromStr;

use libella_core::image::ImageView;
use libella_core::time::Timestamp;

use super::{DepthKind, DepthMap, DepthNetwork, NetworkError};
use crate::sim::random::{Random, mix};

/// Noise of depth maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthNoise {
    /// Standard deviation of the log of one factor for the whole image.
    pub image_sigma_log: f64,
    /// Standard deviation of the log of the factor of a block, its median over the image.
    pub pixel_sigma_log: f64,
    /// Standard deviation of the log of that standard deviation: 0 for the same everywhere.
    pub sigma_spread: f64,
    /// Share of blocks without depth.
    pub hole_share: f64,
    /// Map pixels along a side of a block, at least 1.
    pub block: usize,
}

impl Default for DepthNoise {
    /// Like the shipped networks on what they were trained for: AbsRel .10, errors of a factor of 7 % for a whole image.
    fn default() -> Self {
        Self { image_sigma_log: 0.07, pixel_sigma_log: 0.1, sigma_spread: 0.5, hole_share: 0.02, block: 6 }
    }
}

/// What is done to a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Spoil {
    /// Noise that the map knows about.
    Noise(DepthNoise),
    /// All depths times two.
    Doubled,
    /// Three metres everywhere.
    Constant,
    /// Near is far and far is near.
    Inverted,
    /// Nothing is a number, the uncertainties included.
    NotANumber,
    /// Depths between 0.3 and 10 m, drawn anew for each map pixel.
    Random,
    /// The first map for ever.
    Frozen,
}

impl Spoil {
    /// Those that are nonsense, with the names that [`Spoil::from_str`] takes.
    pub const HOSTILE: [(&'static str, Self); 6] = [
        ("doubled", Self::Doubled),
        ("constant", Self::Constant),
        ("inverted", Self::Inverted),
        ("nan", Self::NotANumber),
        ("random", Self::Random),
        ("frozen", Self::Frozen),
    ];
}

impl FromStr for Spoil {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        if name == "noise" {
            return Ok(Self::Noise(DepthNoise::default()));
        }
        let known = Self::HOSTILE.iter().find(|(known, _)| *known == name);
        known.map(|(_, spoil)| *spoil).ok_or_else(|| {
            let names: Vec<&str> = Self::HOSTILE.iter().map(|(known, _)| *known).collect();
            format!("`{name}` is no way to spoil depth; there are noise, {}", names.join(", "))
        })
    }
}

/// A network whose maps are spoilt.
pub struct Spoiled<N> {
    network: N,
    spoil: Spoil,
    seed: u64,
    first: Option<DepthMap>,
}

impl<N: DepthNetwork> Spoiled<N> {
    /// Spoils what a network gives.
    pub fn new(network: N, spoil: Spoil, seed: u64) -> Self {
        Self { network, spoil, seed, first: None }
    }
}

impl<N: DepthNetwork> DepthNetwork for Spoiled<N> {
    fn predict(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        if let (Spoil::Frozen, Some(first)) = (self.spoil, &self.first) {
            return Ok(first.clone());
        }
        let mut map = self.network.predict(stamp, image)?;
        let mut random = Random::new(mix(self.seed) ^ stamp.as_nanos().cast_unsigned(), "depth");
        match self.spoil {
            Spoil::Noise(noise) => add_noise(&mut map, &noise, &mut random),
            Spoil::Doubled => map.inverse_depth_1_m.iter_mut().for_each(|value| *value *= 0.5),
            Spoil::Constant => confident(&mut map, |_| 1.0 / 3.0),
            Spoil::Inverted => invert(&mut map),
            Spoil::NotANumber => {
                for values in [&mut map.inverse_depth_1_m, &mut map.sigma_log, &mut map.uncertainty] {
                    values.fill(f32::NAN);
                }
            }
            Spoil::Random => confident(&mut map, |_| (-random.between(0.3_f64.ln(), 10.0_f64.ln())).exp() as f32),
            Spoil::Frozen => self.first = Some(map.clone()),
        }
        Ok(map)
    }

    fn describe(&self) -> String {
        let name = Spoil::HOSTILE.iter().find(|(_, spoil)| *spoil == self.spoil).map_or("noise", |(name, _)| *name);
        format!("{}, spoilt: {name}", self.network.describe())
    }

    fn kind(&self) -> DepthKind {
        self.network.kind()
    }
}

/// Metric nonsense that is sure of itself.
fn confident(map: &mut DepthMap, mut inverse_depth: impl FnMut(usize) -> f32) {
    map.inverse_depth_1_m.iter_mut().enumerate().for_each(|(index, value)| *value = inverse_depth(index));
    map.sigma_log.fill(0.05);
    map.uncertainty.fill(0.05);
}

/// Inverse depths mirrored within the range that the map has.
fn invert(map: &mut DepthMap) {
    let known: Vec<usize> = (0..map.inverse_depth_1_m.len()).filter(|index| map.is_known(*index)).collect();
    let values = || known.iter().filter_map(|index| map.inverse_depth_1_m.get(*index).copied());
    let (low, high) = (values().fold(f32::INFINITY, f32::min), values().fold(f32::NEG_INFINITY, f32::max));
    for index in known {
        map.inverse_depth_1_m[index] = low + high - map.inverse_depth_1_m[index];
    }
}

#[allow(clippy::cast_possible_truncation)]
fn add_noise(map: &mut DepthMap, noise: &DepthNoise, random: &mut Random) {
    let block = noise.block.max(1);
    let columns = map.width.div_ceil(block);
    let image = noise.image_sigma_log * random.normal();
    // All four numbers of a block are drawn whatever they are needed for, so that maps with and without holes agree elsewhere.
    let blocks: Vec<(f64, f64, bool)> = (0..columns * map.height.div_ceil(block))
        .map(|_| {
            let sigma = noise.pixel_sigma_log * (noise.sigma_spread * random.normal()).exp();
            (sigma * random.normal(), sigma, random.unit() < noise.hole_share)
        })
        .collect();
    for index in 0..map.inverse_depth_1_m.len() {
        let (x, y) = (index % map.width, index / map.width);
        let Some((error, sigma, hole)) = blocks.get(y / block * columns + x / block) else { continue };
        if *hole || !map.is_known(index) {
            map.inverse_depth_1_m[index] = f32::NAN;
            (map.sigma_log[index], map.uncertainty[index]) = (f32::NAN, f32::NAN);
            continue;
        }
        map.inverse_depth_1_m[index] *= (-(image + error)).exp() as f32;
        let sigma = map.sigma_log[index].hypot(sigma.hypot(noise.image_sigma_log) as f32);
        map.sigma_log[index] = sigma;
        map.uncertainty[index] = (sigma * FRAC_1_SQRT_2).clamp(1e-3, 0.999);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A ramp of inverse depths from 0.2 to 2 1/m.
    struct Ramp;

    impl DepthNetwork for Ramp {
        fn predict(&mut self, stamp: Timestamp, _: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
            let mut map = DepthMap::unknown([120, 80], [4.0; 2], [1.5; 2], DepthKind::Metric);
            for index in 0..120 * 80 {
                map.inverse_depth_1_m[index] = 0.2 + 1.8 * (index % 120) as f32 / 119.0 + 1e-9 * stamp.as_nanos() as f32;
                (map.sigma_log[index], map.uncertainty[index]) = (0.01, 0.01);
            }
            Ok(map)
        }

        fn describe(&self) -> String {
            "ramp".into()
        }
    }

    fn maps(spoil: Spoil, seed: u64, stamps: &[i64]) -> Vec<DepthMap> {
        let mut network = Spoiled::new(Ramp, spoil, seed);
        let image = ImageView::new(&[0], 1, 1, 1).unwrap();
        stamps.iter().map(|stamp| network.predict(Timestamp::from_nanos(*stamp), &image).unwrap()).collect()
    }

    fn exact(stamp: i64) -> DepthMap {
        Ramp.predict(Timestamp::from_nanos(stamp), &ImageView::new(&[0], 1, 1, 1).unwrap()).unwrap()
    }

    #[test]
    fn noise_has_the_distribution_that_it_reports() {
        let noise = DepthNoise { image_sigma_log: 0.0, pixel_sigma_log: 0.15, sigma_spread: 0.6, hole_share: 0.1, block: 1 };
        let truth = exact(7);
        let noisy = maps(Spoil::Noise(noise), 3, &[7]).remove(0);
        let scaled: Vec<f64> = (0..truth.inverse_depth_1_m.len())
            .filter(|index| noisy.is_known(*index))
            .map(|index| f64::from((truth.inverse_depth_1_m[index] / noisy.inverse_depth_1_m[index]).ln() / noisy.sigma_log[index]))
            .collect();
        let count = scaled.len() as f64;
        // 10 % holes of 9600: a standard deviation of 29.
        assert!((count - 8640.0).abs() < 4.0 * 29.4, "{count}");
        let mean = scaled.iter().sum::<f64>() / count;
        let variance = scaled.iter().map(|value| value * value).sum::<f64>() / count;
        // Of 8640 normal numbers: mean within 4/√n, variance within 4·√(2/n); the map's own 0.01 adds at most 1 % of it.
        assert!(mean.abs() < 4.0 / count.sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 4.0 * (2.0 / count).sqrt() + 0.02, "{variance}");
        let covered = scaled.iter().filter(|value| value.abs() < 1.0).count() as f64 / count;
        assert!((covered - 0.6827).abs() < 4.0 * (0.6827_f64 * 0.3173 / count).sqrt() + 0.01, "{covered}");
    }

    #[test]
    fn the_factor_of_an_image_is_the_same_all_over_it() {
        let noise = DepthNoise { image_sigma_log: 0.2, pixel_sigma_log: 0.0, sigma_spread: 0.0, hole_share: 0.0, block: 4 };
        let stamps: Vec<i64> = (1..200).collect();
        let factors: Vec<f64> = maps(Spoil::Noise(noise), 5, &stamps)
            .iter()
            .zip(&stamps)
            .map(|(map, stamp)| {
                let ratios: Vec<f32> = map.inverse_depth_1_m.iter().zip(&exact(*stamp).inverse_depth_1_m).map(|(a, b)| a / b).collect();
                assert!(ratios.iter().all(|ratio| (ratio / ratios[0] - 1.0).abs() < 1e-5));
                f64::from(ratios[0].ln())
            })
            .collect();
        let spread = (factors.iter().map(|value| value * value).sum::<f64>() / factors.len() as f64).sqrt();
        // The standard deviation of a standard deviation from n is σ/√(2n).
        assert!((spread - 0.2).abs() < 4.0 * 0.2 / (2.0 * factors.len() as f64).sqrt(), "{spread}");
    }

    #[test]
    fn neither_order_nor_repetition_changes_a_map() {
        let spoil = Spoil::Noise(DepthNoise::default());
        let (forth, back) = (maps(spoil, 1, &[10, 20, 30]), maps(spoil, 1, &[30, 10, 20, 10]));
        let same =
            |a: &DepthMap, b: &DepthMap| a.inverse_depth_1_m.iter().zip(&b.inverse_depth_1_m).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same(&forth[0], &back[1]) && same(&forth[1], &back[2]) && same(&forth[2], &back[0]) && same(&back[1], &back[3]));
        assert!(!same(&forth[0], &maps(spoil, 2, &[10])[0]) && !same(&forth[0], &forth[1]));
    }

    #[test]
    fn hostile_maps_are_what_their_names_say() {
        let truth = exact(1);
        let spoilt = |spoil| maps(spoil, 1, &[1]).remove(0);
        let pairs = |map: &DepthMap| map.inverse_depth_1_m.iter().copied().zip(truth.inverse_depth_1_m.iter().copied()).collect::<Vec<_>>();
        assert!(pairs(&spoilt(Spoil::Doubled)).iter().all(|(a, b)| (a * 2.0 - b).abs() < 1e-6));
        assert!(pairs(&spoilt(Spoil::Constant)).iter().all(|(a, _)| (a - 1.0 / 3.0).abs() < 1e-6));
        assert!(pairs(&spoilt(Spoil::Inverted)).iter().all(|(a, b)| (a + b - 2.2).abs() < 1e-5));
        assert!(pairs(&spoilt(Spoil::NotANumber)).iter().all(|(a, _)| a.is_nan()));
        let random = spoilt(Spoil::Random);
        assert!(pairs(&random).iter().all(|(a, _)| (0.1..=1.0 / 0.3).contains(a)));
        let frozen = maps(Spoil::Frozen, 1, &[1, 500_000_000]);
        assert_eq!(frozen[0], frozen[1]);
        assert_eq!(frozen[0], truth);
        for (name, spoil) in Spoil::HOSTILE {
            assert_eq!(name.parse::<Spoil>().unwrap(), spoil);
        }
        assert!("x".parse::<Spoil>().unwrap_err().contains("doubled"));
    }
}
