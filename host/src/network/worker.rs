//! A network in a thread of its own, ahead of the estimator.
//!
//! Images go in and answers come out in the same order. Nothing that the caller gets depends on timing: there is no way to ask
//! whether an answer is ready, [`DepthWorker::receive`] waits for the oldest one, and the queue is full when the caller has
//! submitted [`DepthWorker::ahead`] images more than it has received, however far the thread is.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;

use libella_core::time::Timestamp;

use super::{DepthMap, DepthNetwork, NetworkError};
use crate::dataset::GrayImage;
use crate::fault::{Fault, FaultKind};

/// What the network said of one image.
#[derive(Debug, Clone)]
pub struct DepthAnswer {
    /// When the image was taken.
    pub stamp: Timestamp,
    /// Its depth, or why there is none.
    pub depth: Result<DepthMap, NetworkError>,
    /// Milliseconds that the network took, by the clock on the wall.
    pub ms: f64,
}

/// How long the network took.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Timings {
    /// Images so far.
    pub images: usize,
    /// Median, ms.
    pub median_ms: f64,
    /// 95 % are not above, ms.
    pub p95_ms: f64,
    /// The longest, ms.
    pub most_ms: f64,
}

/// A network in a thread of its own. The thread ends with it.
#[derive(Debug)]
pub struct DepthWorker {
    description: String,
    ahead: usize,
    under_way: usize,
    ms: Vec<f64>,
    // Dropped in this order: without requests the thread ends, and only then it can be joined.
    requests: Option<SyncSender<(Timestamp, Arc<GrayImage>)>>,
    answers: Receiver<DepthAnswer>,
    thread: Option<JoinHandle<()>>,
}

impl DepthWorker {
    /// Starts the thread; up to `ahead` images (at least 1) may be under way.
    ///
    /// # Errors
    /// When there is no thread to be had.
    pub fn start(mut network: Box<dyn DepthNetwork>, ahead: usize) -> Result<Self, Fault> {
        let ahead = ahead.max(1);
        let description = network.describe();
        // Both hold all that may be under way, so that neither side ever waits for room.
        let (requests, incoming) = sync_channel::<(Timestamp, Arc<GrayImage>)>(ahead);
        let (outgoing, answers) = sync_channel(ahead);
        let work = move || {
            for (stamp, image) in incoming {
                let begun = Instant::now();
                let view = image.view().map_err(|error| NetworkError::Failed(error.to_string()));
                let depth = view.and_then(|view| network.predict(stamp, &view));
                let ms = begun.elapsed().as_secs_f64() * 1e3;
                if outgoing.send(DepthAnswer { stamp, depth, ms }).is_err() {
                    break;
                }
            }
        };
        let thread = std::thread::Builder::new().name("network".into()).spawn(work);
        let thread = thread.map_err(|error| {
            Fault::new(FaultKind::Output, format!("no thread for the network ({error})"), "free memory or raise the limit")
        })?;
        Ok(Self { description, ahead, under_way: 0, ms: Vec::new(), requests: Some(requests), answers, thread: Some(thread) })
    }

    /// What the network is.
    #[must_use]
    pub fn describe(&self) -> &str {
        &self.description
    }

    /// How many images may be under way.
    #[must_use]
    pub fn ahead(&self) -> usize {
        self.ahead
    }

    /// How many images have been submitted and not received.
    #[must_use]
    pub fn under_way(&self) -> usize {
        self.under_way
    }

    /// Hands an image to the network and returns at once.
    ///
    /// # Errors
    /// Gives the image back when as many as may be are under way: receive one first.
    pub fn submit(&mut self, stamp: Timestamp, image: Arc<GrayImage>) -> Result<(), Arc<GrayImage>> {
        let Some(requests) = self.requests.as_ref().filter(|_| self.under_way < self.ahead) else { return Err(image) };
        // A thread that ended is told by `receive`.
        let _ = requests.send((stamp, image));
        self.under_way += 1;
        Ok(())
    }

    /// Waits for the answer to the oldest image under way; `None` if there is none.
    pub fn receive(&mut self) -> Option<Result<DepthAnswer, NetworkError>> {
        self.under_way = self.under_way.checked_sub(1)?;
        let Ok(answer) = self.answers.recv() else { return Some(Err(NetworkError::Ended)) };
        self.ms.push(answer.ms);
        Some(Ok(answer))
    }

    /// How long the network took for what was received; `None` before the first.
    #[must_use]
    pub fn timings(&self) -> Option<Timings> {
        let mut sorted = self.ms.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |share: usize| sorted.get((sorted.len() * share / 100).min(sorted.len().saturating_sub(1))).copied();
        Some(Timings { images: sorted.len(), median_ms: at(50)?, p95_ms: at(95)?, most_ms: at(100)? })
    }
}

impl Drop for DepthWorker {
    fn drop(&mut self) {
        self.requests = None;
        // What is under way is finished and thrown away; there is room for all of it.
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::network::DepthKind;
    use libella_core::image::ImageView;
    use std::time::Duration;

    /// Takes its time for early images, none for later ones, and fails on every third.
    struct Slow(u64);

    impl DepthNetwork for Slow {
        fn predict(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
            std::thread::sleep(Duration::from_millis(self.0.saturating_sub(stamp.as_nanos().cast_unsigned())));
            if stamp.as_nanos() % 3 == 2 {
                return Err(NetworkError::Failed("on purpose".into()));
            }
            let mut map = DepthMap::unknown([1, 1], [1.0; 2], [0.0; 2], DepthKind::Metric);
            map.inverse_depth_1_m[0] = f32::from(image.row(0)[0]);
            Ok(map)
        }

        fn describe(&self) -> String {
            "slow".into()
        }
    }

    fn image(value: u8) -> Arc<GrayImage> {
        Arc::new(GrayImage { width: 1, height: 1, pixels: vec![value] })
    }

    fn run(ahead: usize, slowness: u64) -> Vec<(i64, Result<u32, NetworkError>)> {
        let mut worker = DepthWorker::start(Box::new(Slow(slowness)), ahead).unwrap();
        let mut heard = Vec::new();
        let mut hear = |worker: &mut DepthWorker| {
            let answer = worker.receive().unwrap().unwrap();
            heard.push((answer.stamp.as_nanos(), answer.depth.map(|map| map.inverse_depth_1_m[0].to_bits())));
        };
        for k in 0..12_u8 {
            while worker.submit(Timestamp::from_nanos(i64::from(k)), image(k)).is_err() {
                hear(&mut worker);
            }
        }
        while worker.under_way() > 0 {
            hear(&mut worker);
        }
        assert!(worker.receive().is_none());
        assert_eq!(worker.timings().unwrap().images, 12);
        heard
    }

    #[test]
    fn answers_come_in_the_order_of_the_images_however_long_they_take() {
        let expected = run(1, 0);
        assert_eq!(expected.iter().map(|(stamp, _)| *stamp).collect::<Vec<_>>(), (0..12).collect::<Vec<_>>());
        assert_eq!(expected.iter().filter(|(_, depth)| depth.is_err()).count(), 4);
        for (ahead, slowness) in [(1, 4), (3, 4), (12, 4), (20, 0)] {
            assert_eq!(run(ahead, slowness), expected);
        }
    }

    #[test]
    fn the_queue_is_full_by_count_and_gives_the_image_back() {
        let mut worker = DepthWorker::start(Box::new(Slow(0)), 2).unwrap();
        assert!(worker.timings().is_none());
        for k in 0..2 {
            worker.submit(Timestamp::from_nanos(k), image(7)).unwrap();
        }
        // Long after both are done there is still no room, because neither was received.
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(worker.submit(Timestamp::from_nanos(2), image(9)).unwrap_err().pixels, [9]);
        worker.receive().unwrap().unwrap();
        worker.submit(Timestamp::from_nanos(2), image(9)).unwrap();
        // Dropped with two under way.
    }

    #[test]
    fn a_network_that_dies_is_told() {
        struct Dies;
        impl DepthNetwork for Dies {
            fn predict(&mut self, _: Timestamp, _: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
                std::panic::resume_unwind(Box::new(()))
            }
            fn describe(&self) -> String {
                "dies".into()
            }
        }
        let mut worker = DepthWorker::start(Box::new(Dies), 4).unwrap();
        for k in 0..4 {
            worker.submit(Timestamp::from_nanos(k), image(0)).unwrap();
        }
        for _ in 0..4 {
            assert_eq!(worker.receive().unwrap().unwrap_err(), NetworkError::Ended);
        }
        assert!(worker.receive().is_none());
    }
}
