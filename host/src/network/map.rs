//! Depth of an image in its raw pixels.
//!
//! # Model
//! Map pixel `(i, j)` lies at raw pixel `origin + (i, j) ∘ step`; in between, values are interpolated bilinearly. Depth is along the
//! optical axis. What is stored is inverse depth `w` (1/m), because it is that which a network knows evenly and which is linear
//! in the image for a plane. The log of the depth that is meant is normally distributed about `−ln w` with `sigma_log`.

use libella_core::depth::{DepthView, DepthViewError};

/// What a map's numbers are compared with the truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DepthKind {
    /// Inverse depth in 1/m, as well as the network knows it.
    Metric,
    /// The truth is a positive multiple of the inverse depth, the same over an image.
    UpToScale,
    /// The truth is `a·w + b`, a > 0, with the same a and b over an image; values of any sign mean something.
    Affine,
}

/// Depth and its uncertainty over an image, in raw (distorted) pixels of the camera that took it.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// Width in map pixels.
    pub width: usize,
    /// Height in map pixels.
    pub height: usize,
    /// Raw pixels from one map pixel to the next, along x and y.
    pub step_px: [f64; 2],
    /// The raw pixel at the centre of map pixel (0, 0).
    pub origin_px: [f64; 2],
    /// Inverse depth along the optical axis, 1/m, row by row. Not finite: unknown. Not positive: unknown, unless the kind is
    /// [`DepthKind::Affine`].
    pub inverse_depth_1_m: Vec<f32>,
    /// Standard deviation of the log depth, calibrated on images that trained nothing. Not finite where the depth is unknown.
    pub sigma_log: Vec<f32>,
    /// u in (0, 1), which the paper's `(I − U)` takes. Not finite where the depth is unknown.
    pub uncertainty: Vec<f32>,
    /// What the numbers mean.
    pub kind: DepthKind,
}

/// What a map says of one raw pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthSample {
    /// Inverse depth, 1/m.
    pub inverse_depth_1_m: f32,
    /// Standard deviation of the log depth.
    pub sigma_log: f32,
    /// u in (0, 1).
    pub uncertainty: f32,
}

impl DepthMap {
    /// A map that knows nothing yet.
    pub(super) fn unknown([width, height]: [usize; 2], step_px: [f64; 2], origin_px: [f64; 2], kind: DepthKind) -> Self {
        let nothing = vec![f32::NAN; width * height];
        Self {
            width,
            height,
            step_px,
            origin_px,
            inverse_depth_1_m: nothing.clone(),
            sigma_log: nothing.clone(),
            uncertainty: nothing,
            kind,
        }
    }

    /// The map as the core reads it.
    ///
    /// # Errors
    /// When its parts do not fit each other.
    #[allow(clippy::cast_possible_truncation)]
    pub fn view(&self) -> Result<DepthView<'_>, DepthViewError> {
        let [step, origin] = [self.step_px, self.origin_px].map(|both| both.map(|value| value as f32));
        DepthView::new((self.width, self.height), step, origin, &self.inverse_depth_1_m, &self.sigma_log, &self.uncertainty)
    }

    /// Whether a value of the map is a depth.
    #[must_use]
    pub fn is_known(&self, index: usize) -> bool {
        let value = self.inverse_depth_1_m.get(index).copied().unwrap_or(f32::NAN);
        value.is_finite() && (value > 0.0 || self.kind == DepthKind::Affine)
    }

    /// Share of the map that is known, 0 to 1.
    #[must_use]
    #[allow(clippy::cast_precision_loss)]
    pub fn known_share(&self) -> f64 {
        let all = self.inverse_depth_1_m.len();
        (0..all).filter(|index| self.is_known(*index)).count() as f64 / all.max(1) as f64
    }

    /// The values at a raw pixel, bilinearly between the four map pixels around it; at the rim, within half a step, those of the rim.
    ///
    /// `None` outside of the map and where one of the four is unknown.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss, clippy::cast_sign_loss)]
    pub fn sample(&self, pixel: [f64; 2]) -> Option<DepthSample> {
        let along = |axis: usize, side: usize| {
            let last = side.checked_sub(1)?;
            let at = (pixel[axis] - self.origin_px[axis]) / self.step_px[axis];
            // NaN lies nowhere.
            (-0.5..=last as f64 + 0.5).contains(&at).then(|| {
                let at = at.clamp(0.0, last as f64);
                let low = at as usize;
                (low, (low + 1).min(last), (at - low as f64) as f32)
            })
        };
        let ((left, right, across), (top, bottom, down)) = (along(0, self.width)?, along(1, self.height)?);
        let corners = [[left, top], [right, top], [left, bottom], [right, bottom]].map(|[x, y]| y * self.width + x);
        if !corners.iter().all(|corner| self.is_known(*corner)) {
            return None;
        }
        let between = |values: &[f32]| {
            let [a, b, c, d] = corners.map(|corner| values.get(corner).copied().unwrap_or(f32::NAN));
            let (above, below) = (a + (b - a) * across, c + (d - c) * across);
            above + (below - above) * down
        };
        Some(DepthSample {
            inverse_depth_1_m: between(&self.inverse_depth_1_m),
            sigma_log: between(&self.sigma_log),
            uncertainty: between(&self.uncertainty),
        })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn ramp() -> DepthMap {
        let mut map = DepthMap::unknown([5, 4], [2.0, 3.0], [0.5, 1.0], DepthKind::Metric);
        for j in 0..4_u8 {
            for i in 0..5_u8 {
                let index = usize::from(j) * 5 + usize::from(i);
                map.inverse_depth_1_m[index] = 1.0 + 0.1 * f32::from(i) + 0.01 * f32::from(j);
                (map.sigma_log[index], map.uncertainty[index]) = (0.2, 0.1 * f32::from(i));
            }
        }
        map
    }

    #[test]
    fn bilinear_is_exact_on_a_ramp() {
        let map = ramp();
        for (x, y) in [(0.5, 1.0), (3.7, 4.2), (8.5, 10.0), (8.4, 9.9), (5.0, 1.0)] {
            let sample = map.sample([x, y]).unwrap();
            let (i, j) = ((x - 0.5) / 2.0, (y - 1.0) / 3.0);
            assert!((f64::from(sample.inverse_depth_1_m) - (1.0 + 0.1 * i + 0.01 * j)).abs() < 1e-6, "{x} {y}: {sample:?}");
            assert!((f64::from(sample.uncertainty) - 0.1 * i).abs() < 1e-6 && (sample.sigma_log - 0.2).abs() < 1e-6);
        }
    }

    #[test]
    fn half_a_step_around_the_map_belongs_to_it_and_no_more() {
        let map = ramp();
        assert!((map.sample([-0.5, -0.5]).unwrap().inverse_depth_1_m - 1.0).abs() < 1e-6);
        assert!((map.sample([9.5, 11.5]).unwrap().inverse_depth_1_m - 1.43).abs() < 1e-6);
        for outside in [[-0.51, 1.0], [9.51, 1.0], [1.0, -0.51], [1.0, 11.51], [f64::NAN, 1.0], [f64::INFINITY, 1.0]] {
            assert_eq!(map.sample(outside), None);
        }
    }

    #[test]
    fn an_unknown_corner_makes_a_sample_unknown() {
        for nothing in [f32::NAN, 0.0, -1.0, f32::INFINITY] {
            let mut map = ramp();
            map.inverse_depth_1_m[6] = nothing;
            assert_eq!(map.sample([3.0, 4.5]), None);
            assert!(map.sample([6.6, 4.5]).is_some());
            assert!((map.known_share() - 0.95).abs() < 1e-9);
        }
        let mut map = ramp();
        (map.inverse_depth_1_m[6], map.kind) = (-1.0, DepthKind::Affine);
        assert!(map.sample([3.0, 4.5]).is_some(), "a negative value of an affine map means something");
    }
}
