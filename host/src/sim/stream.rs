//! The pictures of a flight, one after the other, without files.

use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::JoinHandle;

use libella_core::imu::ImuNoise;
use libella_core::time::Timestamp;
use nalgebra::Vector3;

use super::features::FeatureConfig;
use super::flight::{Flight, RealMotionConfig};
use super::render::{RenderConfig, Renderer, World};
use super::scene::{RoomConfig, Scene};
use super::trajectory::AnalyticConfig;
use super::{ImuConfig, MotionKind, SimError, euroc};
use crate::dataset::GrayImage;

/// A flight through a rendered room.
#[derive(Clone)]
pub struct RenderedFlight {
    /// Motion, clock, inertial samples, truth.
    pub flight: Flight,
    /// The room.
    pub world: World,
    /// How pictures are taken.
    pub render: RenderConfig,
    /// Seed of the noise of the pictures.
    pub seed: u64,
}

/// What a room has beside its usual things, or has not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Furnishing {
    /// Moving objects, at most [`MOST_MOVERS`](super::MOST_MOVERS). The room and the flight are the same without them.
    pub movers: usize,
    /// Poor in texture: see [`RoomConfig::is_bare`].
    pub is_bare: bool,
}

/// Where the motion of a rendered flight comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum MotionSource {
    /// An analytic motion with simulated inertial samples.
    Analytic(AnalyticConfig, ImuConfig),
    /// The recorded motion of a EuRoC folder.
    Recorded(std::path::PathBuf, RealMotionConfig),
}

impl MotionSource {
    /// What the command line says: `easy`, `medium`, `difficult`, `still`, `pure-rotation`, `fast-yaw`, or else a EuRoC folder.
    /// A recorded motion ends with its recording, if it is shorter than `duration_s`.
    ///
    /// # Errors
    /// A duration out of range.
    pub fn parse(name: &str, duration_s: f64) -> Result<Self, SimError> {
        SimError::check("duration_s", duration_s, 1.0, 3600.0)?;
        Ok(match MotionKind::from_name(name) {
            Some(kind) => {
                let usual = AnalyticConfig::default();
                // A flight shorter than its rest would not fly.
                let rest_s = usual.rest_s.min(0.5 * duration_s);
                Self::Analytic(AnalyticConfig { kind, duration_s, rest_s, ..usual }, ImuConfig::default())
            }
            None => Self::Recorded(
                name.into(),
                RealMotionConfig {
                    duration_s,
                    imu_noise: ImuNoise::adis16448(),
                    features: FeatureConfig::default(),
                    ..RealMotionConfig::default()
                },
            ),
        })
    }
}

impl RenderedFlight {
    /// Flies, furnishes a room around the way, and paints it. `scene_seed` draws the room; `seed` the motion and all noise.
    ///
    /// # Errors
    /// A parameter out of range, or a recording that cannot be read.
    pub fn new(source: &MotionSource, render: &RenderConfig, scene_seed: u64, seed: u64) -> Result<Self, SimError> {
        Self::furnished(source, render, scene_seed, seed, Furnishing::default())
    }

    /// [`new`](Self::new) in a room with other than the usual things.
    ///
    /// # Errors
    /// As [`new`](Self::new), or more moving objects than the room has space for.
    pub fn furnished(
        source: &MotionSource,
        render: &RenderConfig,
        scene_seed: u64,
        seed: u64,
        Furnishing { movers, is_bare }: Furnishing,
    ) -> Result<Self, SimError> {
        SimError::check("render.threads", render.threads as f64, 1.0, 256.0)?;
        let flight = match source {
            MotionSource::Analytic(motion, imu) => Flight::analytic(motion, imu, 20.0, seed)?,
            MotionSource::Recorded(folder, config) => Flight::recorded(folder, config, seed)?,
        };
        let path: Vec<Vector3<f64>> = flight.path();
        let room = RoomConfig { is_bare, ..flight.fitting_room() };
        let scene = Scene::room(&room, &path, scene_seed)?;
        let movers = scene.movers(&room, &path, movers, scene_seed)?;
        let world = World::bake_with(scene, movers, scene_seed, render.threads);
        Ok(Self { flight, world, render: *render, seed })
    }

    /// A renderer of EuRoC's left (0) or right camera.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn renderer(&self, camera: usize) -> Result<Renderer<'_>, SimError> {
        let seed = self.seed.wrapping_mul(2).wrapping_add(camera as u64);
        Renderer::new(&self.world, &euroc::camera(camera), &euroc::body_from_camera(camera), &self.render, seed)
    }

    /// The picture number `index` of a renderer of this flight; `None` beyond the last.
    #[must_use]
    pub fn image(&self, renderer: &Renderer<'_>, index: usize) -> Option<GrayImage> {
        let stamp = *self.flight.frame_stamps.get(index)?;
        let seconds = (stamp - self.flight.epoch).as_seconds();
        Some(renderer.image(self.flight.trajectory.as_ref(), seconds, index as u64))
    }

    /// The pictures of the left camera in order, rendered up to three ahead of the reader by a thread of their own.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn stream(self: &std::sync::Arc<Self>) -> Result<ImageStream, SimError> {
        // Refuse here, not in the thread.
        self.renderer(0)?;
        let (sender, receiver) = sync_channel(3);
        let shared = std::sync::Arc::clone(self);
        let worker = std::thread::spawn(move || {
            let Ok(renderer) = shared.renderer(0) else { return };
            for (index, stamp) in shared.flight.frame_stamps.iter().enumerate() {
                let Some(image) = shared.image(&renderer, index) else { return };
                // The reader may have had enough.
                if sender.send((*stamp, image)).is_err() {
                    return;
                }
            }
        });
        Ok(ImageStream { receiver: Some(receiver), worker: Some(worker) })
    }
}

/// Pictures with their stamps, in order. Dropping it ends the rendering.
pub struct ImageStream {
    receiver: Option<Receiver<(Timestamp, GrayImage)>>,
    worker: Option<JoinHandle<()>>,
}

impl Iterator for ImageStream {
    type Item = (Timestamp, GrayImage);

    fn next(&mut self) -> Option<Self::Item> {
        self.receiver.as_ref()?.recv().ok()
    }
}

impl Drop for ImageStream {
    fn drop(&mut self) {
        self.receiver = None;
        if let Some(worker) = self.worker.take() {
            // A worker that panicked has nothing left to say.
            let _ = worker.join();
        }
    }
}
