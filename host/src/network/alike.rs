//! A source whose uncertainty nobody listens to: all its depths count alike.

use libella_core::image::ImageView;
use libella_core::time::Timestamp;

use super::{DepthKind, DepthMap, DepthNetwork, NetworkError};

/// An uncertainty that takes nothing from any weight; zero is no uncertainty, but a depth that is unknown.
const ALMOST_NONE: f32 = 1e-6;

/// Any source without what it says of its uncertainty: every known depth has the same standard deviation of its logarithm, and `u`
/// almost zero.
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
        map.uncertainty.fill(ALMOST_NONE);
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
    use libella_core::depth::DepthView;

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
        assert!(map.is_known(0) && !map.is_known(1), "what is unknown became known");
        // As the estimator reads it.
        let [depth, sigma, u] = [&map.inverse_depth_1_m, &map.sigma_log, &map.uncertainty].map(|values| [values.as_slice(); 2].concat());
        let view = DepthView::new((2, 2), [1.0; 2], [0.0; 2], &depth, &sigma, &u).unwrap();
        let found = view.value::<f64>(0, 0).unwrap();
        assert!(found.inverse_depth == 0.5 && found.sigma_log == 0.25 && found.uncertainty < 1e-5);
        assert_eq!(view.value::<f64>(1, 0), None);
    }
}
