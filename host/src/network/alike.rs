//! A source whose uncertainty nobody listens to: all its depths count alike.

use libella_core::image::ImageView;
use libella_core::time::Timestamp;

use super::{DepthKind, DepthMap, DepthNetwork, NetworkError};

/// Any source without what it says of its uncertainty: every known depth has the same standard deviation of its logarithm, and `u = 0`.
#[derive(Debug)]
pub struct Alike<N> {
    network: N,
    sigma_log: f32,
}

impl<N: DepthNetwork> Alike<N> {
    /// `sigma_log`: the standard deviation of ln depth that all depths then have.
    #[allow(clippy::cast_possible_truncation)]
    pub fn new(network: N, sigma_log: f64) -> Self {
        Self { network, sigma_log: sigma_log as f32 }
    }
}

impl<N: DepthNetwork> DepthNetwork for Alike<N> {
    fn predict(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        let mut map = self.network.predict(stamp, image)?;
        // What is unknown stays unknown: that is told by the depth.
        map.sigma_log.fill(self.sigma_log);
        map.uncertainty.fill(0.0);
        Ok(map)
    }

    fn describe(&self) -> String {
        format!("{}, its uncertainty ignored", self.network.describe())
    }

    fn kind(&self) -> DepthKind {
        self.network.kind()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    struct Two;

    impl DepthNetwork for Two {
        fn predict(&mut self, _: Timestamp, _: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
            Ok(DepthMap {
                width: 2,
                height: 1,
                step_px: [1.0; 2],
                origin_px: [0.0; 2],
                inverse_depth_1_m: vec![0.5, f32::NAN],
                sigma_log: vec![0.1, f32::NAN],
                uncertainty: vec![0.3, f32::NAN],
                kind: DepthKind::Metric,
            })
        }

        fn describe(&self) -> String {
            "two".into()
        }
    }

    #[test]
    fn depths_stay_and_what_is_said_of_them_does_not() {
        let pixels = [0; 16];
        let image = ImageView::new(&pixels, 4, 4, 4).unwrap();
        let map = Alike::new(Two, 0.25).predict(Timestamp::from_nanos(1), &image).unwrap();
        assert_eq!((map.inverse_depth_1_m[0], map.sigma_log[0], map.uncertainty[0]), (0.5, 0.25, 0.0));
        assert!(map.is_known(0) && !map.is_known(1), "what is unknown became known");
    }
}
