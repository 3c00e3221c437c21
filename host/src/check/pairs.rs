//! Corners that two images share.

use libella_core::robust::stats;
use nalgebra::{Vector2, Vector3};

use super::lens::Lens;
use super::sightings::Shot;

/// Corners of a pair at least, and at most: more add work and little else.
const LEAST_SHARED: usize = 20;
const MOST_SHARED: usize = 80;
/// Pairs of one length at most.
const MOST_PAIRS: usize = 600;

/// Two images and the corners in both.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    /// Times of the images, s since the first inertial sample, by the camera's clock.
    pub seconds: [f64; 2],
    /// Pixels in both.
    pub pixels: Vec<[Vector2<f64>; 2]>,
    /// Places of the same corners in the table of all corners.
    pub places: Vec<[usize; 2]>,
}

/// The pixels of all corners, in the order of windows, images and tracks.
pub(super) fn table(windows: &[Vec<Shot>]) -> Vec<Vector2<f64>> {
    windows.iter().flatten().flat_map(|shot| shot.corners.iter().map(|(_, pixel)| *pixel)).collect()
}

impl Pair {
    /// Bearings in both, left out where the lens has none.
    pub fn bearings(&self, lens: &Lens) -> Vec<[Vector3<f64>; 2]> {
        self.pixels.iter().filter_map(|[a, b]| Some([lens.bearing(a)?, lens.bearing(b)?])).collect()
    }

    /// Median displacement, px.
    pub fn displacement_px(&self) -> f64 {
        stats::median(&mut self.pixels.iter().map(|[a, b]| (b - a).norm()).collect::<Vec<f64>>()).unwrap_or(0.0)
    }

    /// Time between the images, s.
    pub fn span_s(&self) -> f64 {
        self.seconds[1] - self.seconds[0]
    }
}

/// Pairs about `span_s` apart, evenly over all windows. `seconds` gives the time of an image.
pub(super) fn pairs(windows: &[Vec<Shot>], span_s: f64, seconds: impl Fn(&Shot) -> f64) -> Vec<Pair> {
    let mut found = Vec::new();
    let mut base = 0;
    for shots in windows {
        // Where the corners of each image begin in the table.
        let begins: Vec<usize> = shots
            .iter()
            .map(|shot| {
                base += shot.corners.len();
                base - shot.corners.len()
            })
            .collect();
        // Half overlapping at most: what lies closer together repeats itself.
        let mut next_start = f64::NEG_INFINITY;
        for (index, first) in shots.iter().enumerate() {
            let start = seconds(first);
            if start < next_start {
                continue;
            }
            let after = shots.get(index + 1..).unwrap_or_default();
            let Some(ahead) = after.iter().position(|shot| seconds(shot) - start > 0.9 * span_s) else { break };
            let (Some(second), Some(begin), Some(second_begin)) = (after.get(ahead), begins.get(index), begins.get(index + 1 + ahead))
            else {
                break;
            };
            let end = seconds(second);
            // A pause is no pair.
            if end - start > 2.0 * span_s + 0.1 {
                continue;
            }
            next_start = start + 0.3 * span_s;
            let shared = shared(first, second);
            if shared.len() >= LEAST_SHARED {
                let step = shared.len().div_ceil(MOST_SHARED);
                let (pixels, places) =
                    shared.into_iter().step_by(step).map(|([i, j], pixels)| (pixels, [begin + i, second_begin + j])).unzip();
                found.push(Pair { seconds: [start, end], pixels, places });
            }
        }
    }
    let step = found.len().div_ceil(MOST_PAIRS).max(1);
    found.into_iter().step_by(step).collect()
}

/// Corners of the same track: where they are in either list, and their pixels.
fn shared(first: &Shot, second: &Shot) -> Vec<([usize; 2], [Vector2<f64>; 2])> {
    let mut others = second.corners.iter().enumerate().peekable();
    let mut shared = Vec::new();
    for (index, (track, pixel)) in first.corners.iter().enumerate() {
        while others.next_if(|(_, (other, _))| other < track).is_some() {}
        if let Some((place, (_, other))) = others.next_if(|(_, (other, _))| other == track) {
            shared.push(([index, place], [*pixel, *other]));
        }
    }
    shared
}
