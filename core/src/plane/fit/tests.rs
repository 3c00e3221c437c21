//! A scan gives what looking at one sample after the other gives, and leaving early never hides a better plane.

#![allow(clippy::unwrap_used)]

use super::*;
use crate::plane::samples::{Sample, Source};
use proptest::prelude::*;
use std::boxed::Box;

const CAPACITY: usize = 1200;

/// Points in a cube of 1 m, a third each without normal, with one along an axis, and with any; half of them from a depth map.
fn cloud<T: Real>(seed: u64, count: usize) -> Box<Samples<T, CAPACITY>> {
    let mut generator = Generator::new(seed);
    let mut samples = Box::new(Samples::new(&Vector3::z_axis(), T::of(0.25)));
    for _ in 0..count {
        let vector = |generator: &mut Generator| Vector3::from_fn(|_, _| generator.unit::<T>() - T::of(0.5));
        let normal_in_world = match generator.below(3) {
            0 => None,
            1 => Some(Vector3::ith(generator.below(3), T::one()) + vector(&mut generator) * T::of(0.2)),
            _ => Some(vector(&mut generator)),
        };
        let source = if generator.below(2) == 0 { Source::MapPoint } else { Source::Depth { uncertainty: generator.unit() } };
        let sample = Sample { point_in_world: vector(&mut generator), normal_in_world, source };
        assert_eq!(samples.push(&sample), Ok(()));
    }
    samples.arrange();
    samples
}

/// Scores of all guesses from `draws` samples, by both roads.
fn agrees<T: Real, P: SampleModel<T, K>, const K: usize>(items: &P, draws: u64, seed: u64) {
    let mut generator = Generator::new(seed);
    let tolerance = T::default_epsilon().as_f64() * items.count() as f64 * 4.0 + 1e-12;
    let total = (0..items.count()).fold(T::ZERO, |sum, item| sum + items.weight(item));
    assert!((total - items.total_weight()).as_f64().abs() < tolerance);
    for _ in 0..draws {
        let sample = core::array::from_fn(|_| items.draw(&mut generator));
        let Some(model) = items.fit(&sample) else { continue };
        let (mut score, mut weight, mut inliers) = (0.0, 0.0, 0);
        for item in 0..items.count() {
            let distance = items.squared_distance(&model, item).as_f64();
            if distance < 1.0 {
                score += items.weight(item).as_f64() * (1.0 - distance);
                weight += items.weight(item).as_f64();
                inliers += 1;
            }
        }
        assert!(sample.iter().all(|item| items.squared_distance(&model, *item) < T::one()), "a sample lies on its own plane");
        let found = items.agreement(&model, -T::one()).unwrap(); // any score beats −1
        assert!((found.score.as_f64() - score).abs() < tolerance, "{} {score}", found.score);
        // A sample at the very threshold may fall on either side.
        assert!(found.inliers.abs_diff(inliers) <= 1 && (found.weight.as_f64() - weight).abs() <= 1.0 + tolerance);
        for (to_beat, beats) in [(score - 2.0 * tolerance, true), (score + 2.0 * tolerance, false)] {
            assert_eq!(items.agreement(&model, T::of(to_beat)).is_some(), beats, "{score} {to_beat}");
        }
    }
}

fn all_models<T: Real>(seed: u64, count: usize) {
    let samples = cloud::<T>(seed, count);
    let view = samples.view();
    let (limits, least_separation_m) = (Limits::new(&view, T::of(0.1)), T::of(0.05));
    agrees(&OnePoint { view, limits }, 10, seed);
    agrees(&OnePointOnWall { view, limits, normal: [T::of(0.6), T::of(-0.8)] }, 10, seed);
    agrees(&TwoPoints { view, limits, least_separation_m }, 20, seed);
    agrees(&ThreePoints { view, limits, least_separation_m }, 40, seed);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn scanning_is_looking_at_each(seed in any::<u64>(), count in 1usize..CAPACITY) {
        all_models::<f64>(seed, count);
        all_models::<f32>(seed, count);
    }

    #[test]
    fn certain_depth_is_drawn_more_often(seed in any::<u64>()) {
        // Two samples, certain with u = 0 and doubtful with u = 3/4: drawn 4 times to 1.
        let mut samples = Box::new(Samples::<f64, 2>::new(&Vector3::z_axis(), 0.2));
        for (x, uncertainty) in [(1.0, 0.0), (2.0, 0.75)] {
            let sample = Sample { point_in_world: Vector3::new(x, 0.0, 0.0), normal_in_world: None, source: Source::Depth { uncertainty } };
            prop_assert_eq!(samples.push(&sample), Ok(()));
        }
        samples.arrange();
        let view = samples.view();
        let items = OnePoint { view, limits: Limits::new(&view, 0.05) };
        let mut generator = Generator::new(seed);
        let certain = (0..2000).filter(|_| view.point(items.draw(&mut generator)).x == 1.0).count() as f64;
        // 1600 of 2000 with a binomial deviation of 18; the chance is kept in steps of 1/255.
        prop_assert!((certain - 1600.0).abs() < 5.0 * 18.0, "{}", certain);
    }
}

#[test]
fn arranging_loses_no_sample() {
    let mut samples = cloud::<f64>(7, 1000);
    let sums = |samples: &Samples<f64, CAPACITY>| {
        let view = samples.view();
        view.range(Candidates::Any).map(|place| view.row(place)).fold([0.0; 6], |sum, row| core::array::from_fn(|c| sum[c] + row[c]))
    };
    let before = sums(&samples);
    let horizontal = samples.view().range(Candidates::Horizontal).len();
    let above = |row: [f64; 6]| row[2] > 0.0;
    let taken = samples.take(Candidates::Horizontal, Some(3), above);
    samples.arrange();
    assert_eq!(samples.view().range(Candidates::Horizontal).len(), horizontal - taken);
    assert!(samples.view().range(Candidates::Horizontal).all(|place| samples.view().point(place).z <= 0.0));
    assert_eq!((0..1000).filter(|arrival| samples.plane_of(*arrival) == Some(3)).count(), taken);
    samples.release();
    samples.arrange();
    let after = sums(&samples);
    assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-9), "{before:?} {after:?}");
    assert_eq!(samples.view().range(Candidates::Horizontal).len(), horizontal);
    assert!((0..1000).all(|arrival| samples.plane_of(arrival).is_none()));
}
