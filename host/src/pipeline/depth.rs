//! Depth maps for the images of a recording, made ahead of the estimator.
//!
//! # Which images
//! A depth is most useful where an image becomes a keyframe, but whether it does is known only after it has been worked on. Instead
//! an image gets a depth when the last one that did is long enough ago ([`DepthSection::rate_hz`]): a rule that depends on stamps alone.
//!
//! # Order
//! Events are read ahead until [`AHEAD`] images are with the network, which works in a thread of its own while the estimator is
//! busy with the events before. An image and its map leave together, the reader waits where the map is not ready: what the estimator
//! gets hangs on the recording alone, never on who was faster.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Instant;

use libella_core::depth::Verdict;
use libella_core::time::Timestamp;

use super::estimate::milliseconds_since;
use crate::config::DepthSection;
use crate::dataset::{Event, Events};
use crate::fault::{Fault, FaultKind};
use crate::network::{DepthKind, DepthMap, DepthNetwork, DepthWorker};

/// Images that the network has while the estimator works on those before: one in work, one waiting.
const AHEAD: usize = 2;
/// Share of the time between two images with depth that is enough: stamps are not exact.
const ENOUGH: f64 = 0.9;

/// What became of the depth of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthResult {
    /// How long it took.
    pub times: DepthTimes,
    /// What the map did, or why there was none.
    pub used: Result<DepthUse, String>,
}

/// How long the depth of one image took.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DepthTimes {
    /// Time that the network took, by the clock on the wall, ms.
    pub network_ms: f64,
    /// Time that the estimator waited for it, ms.
    pub wait_ms: f64,
    /// Time in `push_depth`, ms.
    pub push_ms: f64,
}

/// What a map did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthUse {
    /// Landmarks of the image that it gave a depth.
    pub given: usize,
    /// Factor from the source's depths to metric ones.
    pub scale: f64,
    /// Standard deviation of its logarithm.
    pub sigma_log_scale: f64,
    /// Whether it agreed with what motion tells.
    pub verdict: Verdict,
}

/// What the network said of the image that comes with it.
pub(super) struct Told {
    pub map: Result<DepthMap, String>,
    pub times: DepthTimes,
}

/// Refuses sources that the estimator cannot use.
pub(super) fn check(network: &dyn DepthNetwork, has_images: bool) -> Result<(), Fault> {
    let refused = |what: String, remedy: &str| Err(Fault::new(FaultKind::Configuration, what, remedy));
    if !has_images {
        return refused(
            "a recording of corners has no images for a source of depth".into(),
            "give a recording with images, or --depth none",
        );
    }
    let known = match network.kind() {
        DepthKind::Metric => return Ok(()),
        DepthKind::UpToScale => "a factor that differs by image",
        DepthKind::Affine => "scale and shift",
    };
    refused(format!("{} gives depth up to {known}, and a run needs metres", network.describe()), "give a network whose depth is metric")
}

/// The events of a recording, images with what the network said of them.
pub(super) struct EventsWithDepth<'a> {
    events: Events<'a>,
    worker: Option<DepthWorker>,
    period_s: f64,
    last: Option<Timestamp>,
    queue: VecDeque<(Event, bool)>,
    images: usize,
    most_images: usize,
}

impl<'a> EventsWithDepth<'a> {
    /// `most_images` are held at most.
    pub fn new(
        events: Events<'a>,
        network: Option<Box<dyn DepthNetwork>>,
        config: &DepthSection,
        most_images: usize,
    ) -> Result<Self, Fault> {
        let worker = network.map(|network| DepthWorker::start(network, AHEAD)).transpose()?;
        Ok(Self { events, worker, period_s: config.rate_hz.recip(), last: None, queue: VecDeque::new(), images: 0, most_images })
    }

    /// The event, and whether it is an image that the network was given.
    fn read(&mut self) -> Option<(Event, bool)> {
        let event = self.events.next()?;
        let (Some(worker), Event::Image { stamp, image: Ok(image) }) = (&mut self.worker, &event) else { return Some((event, false)) };
        let due = self.last.is_none_or(|last| (*stamp - last).as_seconds::<f64>() >= ENOUGH * self.period_s);
        let submitted = due && worker.submit(*stamp, Arc::new(image.clone())).is_ok();
        if submitted {
            self.last = Some(*stamp);
        }
        Some((event, submitted))
    }
}

impl Iterator for EventsWithDepth<'_> {
    type Item = (Event, Option<Told>);

    fn next(&mut self) -> Option<Self::Item> {
        // At least one, or the image that the queue begins with could not be followed by the next.
        while self.queue.is_empty()
            || (self.images < self.most_images && self.worker.as_ref().is_some_and(|worker| worker.under_way() < AHEAD))
        {
            let Some((event, submitted)) = self.read() else { break };
            self.images += usize::from(matches!(event, Event::Image { .. }));
            self.queue.push_back((event, submitted));
        }
        let (event, submitted) = self.queue.pop_front()?;
        self.images -= usize::from(matches!(event, Event::Image { .. }));
        let begun = Instant::now();
        let answer = self.worker.as_mut().filter(|_| submitted).and_then(DepthWorker::receive);
        let told = answer.map(|answer| {
            let (map, network_ms) = match answer {
                Ok(answer) => (answer.depth, answer.ms),
                Err(error) => (Err(error), 0.0),
            };
            let times = DepthTimes { network_ms, wait_ms: milliseconds_since(begun), ..DepthTimes::default() };
            Told { map: map.map_err(|error| error.to_string()), times }
        });
        Some((event, told))
    }
}
