//! Simulated flights as recordings, without a file in between.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

use crate::calibration::Rig;
use crate::dataset::{Decoded, Frames, ImageSource, Layout, LiveImages, Recording, TrackFrame};
use crate::eval::{StampedPose, Trajectory};
use crate::fault::{Fault, FaultKind};
use crate::sim::{self, RenderedFlight, TruthState, euroc};

/// Renders a flight for the estimator, some images ahead of it.
#[derive(Clone)]
struct RenderedImages {
    flight: Arc<RenderedFlight>,
    spent: RenderClock,
}

/// Wall time spent on pictures and their number, readable while they are being made.
#[derive(Debug, Clone, Default)]
pub struct RenderClock {
    nanoseconds: Arc<AtomicU64>,
    images: Arc<AtomicU64>,
}

impl RenderClock {
    fn add(&self, time: Duration) {
        self.nanoseconds.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
        self.images.fetch_add(1, Ordering::Relaxed);
    }

    /// Mean wall time per picture, ms; nothing before the first.
    #[must_use]
    pub fn mean_ms(&self) -> Option<f64> {
        let images = self.images.load(Ordering::Relaxed);
        (images > 0).then(|| self.nanoseconds.load(Ordering::Relaxed) as f64 / images as f64 * 1e-6)
    }
}

impl fmt::Debug for RenderedImages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} rendered images", self.flight.flight.frame_stamps.len())
    }
}

impl ImageSource for RenderedImages {
    fn start(&self, ahead: usize) -> Result<Receiver<Decoded>, Fault> {
        let refused = |reason: String| Fault::new(FaultKind::Configuration, reason, "choose other parameters");
        // Refuse here, not in the thread.
        self.flight.renderer(0).map_err(|error| refused(error.to_string()))?;
        let (sender, receiver) = sync_channel(ahead.max(1));
        let Self { flight, spent } = self.clone();
        let work = move || {
            let Ok(renderer) = flight.renderer(0) else { return };
            for (index, stamp) in flight.flight.frame_stamps.iter().enumerate() {
                let begun = Instant::now();
                let Some(image) = flight.image(&renderer, index) else { return };
                spent.add(begun.elapsed());
                // The reader may have had enough.
                if sender.send((*stamp, Ok(image))).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("render".into()).spawn(work).map_err(|error| {
            Fault::new(FaultKind::Output, format!("no thread for rendering ({error})"), "free memory or raise the limit")
        })?;
        Ok(receiver)
    }
}

/// A rendered flight as a recording whose images are made while it runs, and the clock of their making.
#[must_use]
pub fn rendered_recording(name: &str, flight: &Arc<RenderedFlight>) -> (Recording, RenderClock) {
    let spent = RenderClock::default();
    let source = RenderedImages { flight: Arc::clone(flight), spent: spent.clone() };
    let stamps = flight.flight.frame_stamps.clone();
    let recording = Recording {
        name: name.to_owned(),
        layout: Layout::Simulated,
        rig: Rig { camera: euroc::camera(0), body_from_camera: euroc::body_from_camera(0), imu_noise: flight.flight.imu_noise },
        imu: flight.flight.imu.clone(),
        listed_frames: stamps.len(),
        frames: Frames::Live(LiveImages { stamps, source: Box::new(source) }),
        truth: Some(trajectory_of(&flight.flight.truth)),
        truth_is_level: true,
        remarks: Vec::new(),
    };
    (recording, spent)
}

/// A flight of point features as a recording.
#[must_use]
pub fn tracked_recording(name: &str, flight: sim::Recording) -> Recording {
    let frames: Vec<_> =
        flight.frames.into_iter().map(|frame| TrackFrame { stamp: frame.stamp, observations: frame.observations }).collect();
    Recording {
        name: name.to_owned(),
        layout: Layout::Simulated,
        rig: Rig { camera: flight.camera, body_from_camera: flight.body_from_camera, imu_noise: flight.imu_noise },
        imu: flight.imu,
        listed_frames: frames.len(),
        frames: Frames::Tracks(frames),
        truth: Some(trajectory_of(&flight.truth)),
        truth_is_level: true,
        remarks: Vec::new(),
    }
}

fn trajectory_of(truth: &[TruthState]) -> Trajectory {
    Trajectory::new(truth.iter().map(|truth| StampedPose {
        stamp: truth.stamp,
        world_from_body: nalgebra::Isometry3::from_parts(truth.state.position_in_world.into(), truth.state.world_from_body),
    }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::dataset::Event;
    use crate::sim::{AnalyticConfig, ImuConfig, MotionKind, MotionSource, RenderConfig};

    #[test]
    fn events_of_a_rendered_flight_are_those_of_its_stream() {
        let motion = AnalyticConfig { kind: MotionKind::Easy, duration_s: 1.0, rest_s: 0.0, ..AnalyticConfig::default() };
        let source = MotionSource::Analytic(motion, ImuConfig::default());
        let flight = Arc::new(RenderedFlight::new(&source, &RenderConfig::default(), 3, 3).unwrap());
        let (mut recording, spent) = rendered_recording("short", &flight);
        // An image that was taken out of the recording is passed over.
        let Frames::Live(live) = &mut recording.frames else { unreachable!() };
        live.stamps.remove(1);
        assert_eq!(spent.mean_ms(), None);
        let (mut samples, mut images) = (Vec::new(), Vec::new());
        for event in recording.events(2).unwrap().take(60) {
            match event {
                Event::Imu(sample) => samples.push(sample),
                Event::Image { stamp, image } => {
                    assert!(samples.last().unwrap().stamp >= stamp, "an image came before its inertial samples");
                    images.push((stamp, image.unwrap()));
                }
                Event::Tracks(_) => unreachable!(),
            }
        }
        assert_eq!(samples, flight.flight.imu[..samples.len()]);
        assert_eq!(images.len(), 5);
        let streamed: Vec<_> = flight.stream().unwrap().take(6).collect();
        let kept = streamed.iter().enumerate().filter(|(index, _)| *index != 1).map(|(_, image)| image);
        assert!(images.iter().eq(kept));
        assert!(spent.mean_ms().unwrap() > 0.0);
    }
}
