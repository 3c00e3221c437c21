//! A coarse depth map such as a small network tells from a small image.

use libella_host::sim::DepthMap;
use libella_host::sim::random::Random;

use crate::recording::DEPTH_SIZE;

/// Standard deviation of the logarithm that all depths of a map have in common, and that those of a region have.
const SIGMA: f64 = 0.1;
/// Regions that err by themselves, across and down; between their middles the error goes over smoothly.
const REGIONS: (usize, usize) = (4, 3);

/// The mean inverse depth of the area of every value, as a depth in m, off by a tenth; `index` seeds the noise with `seed`.
#[must_use]
pub fn network(exact: &DepthMap, seed: u64, index: u64) -> Vec<f64> {
    let (columns, rows) = DEPTH_SIZE;
    let mut random = Random::new(seed ^ index << 32, "coarse depth");
    let whole = SIGMA * random.normal();
    let regions: Vec<f64> = (0..REGIONS.0 * REGIONS.1).map(|_| SIGMA * random.normal()).collect();
    let mut depths = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        for column in 0..columns {
            let error = whole + between(&regions, (column as f64 + 0.5) / columns as f64, (row as f64 + 0.5) / rows as f64);
            let inverse = mean_inverse(exact, column, row);
            depths.push(if inverse > 0.0 { (error.exp() / inverse).min(65.0) } else { 0.0 });
        }
    }
    depths
}

/// The mean inverse depth behind the pixels of one value; 0 where there is nothing.
fn mean_inverse(exact: &DepthMap, column: usize, row: usize) -> f64 {
    let (columns, rows) = DEPTH_SIZE;
    let xs = column * exact.width / columns..(column + 1) * exact.width / columns;
    let ys = row * exact.height / rows..(row + 1) * exact.height / rows;
    let behind = ys.flat_map(|y| xs.clone().map(move |x| exact.depth_m[y * exact.width + x])).filter(|depth| *depth > 0.0);
    let (sum, count) = behind.fold((0.0, 0.0), |(sum, count), depth| (sum + 1.0 / depth, count + 1.0));
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Bilinear between the middles of the regions, at a place of the image between 0 and 1.
fn between(regions: &[f64], x: f64, y: f64) -> f64 {
    let place = |at: f64, count: usize| {
        let at = (at * count as f64 - 0.5).clamp(0.0, (count - 1) as f64);
        let before = (at as usize).min(count - 2);
        (before, at - before as f64)
    };
    let ((i, right), (j, below)) = (place(x, REGIONS.0), place(y, REGIONS.1));
    let at = |i: usize, j: usize| regions[j * REGIONS.0 + i];
    (at(i, j) * (1.0 - right) + at(i + 1, j) * right) * (1.0 - below) + (at(i, j + 1) * (1.0 - right) + at(i + 1, j + 1) * right) * below
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_goes_over_smoothly_and_is_the_regions_own_in_its_middle() {
        let regions: Vec<f64> = (0..12).map(f64::from).collect();
        assert_eq!(between(&regions, 0.125, 1.0 / 6.0), 0.0);
        assert!((between(&regions, 0.875, 5.0 / 6.0) - 11.0).abs() < 1e-12);
        assert!((between(&regions, 0.25, 1.0 / 6.0) - 0.5).abs() < 1e-12);
        assert_eq!(between(&regions, 0.0, 0.0), 0.0);
    }
}
