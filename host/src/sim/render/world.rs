//! A scene with baked light, and what moves in it.

use nalgebra::{Isometry3, Vector3};

use super::face::Face;
use crate::sim::scene::{Mover, Quad, Scene};
use crate::sim::surface::{self, Surface};

/// A camera and the time at which it looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    pub seconds: f64,
    /// `T_WC`.
    pub world_from_camera: Isometry3<f64>,
}

/// A scene with baked light, and what moves in it.
///
/// Movers are painted in the light of the place they swing about. They hide what is behind them, and cast no shadow: what stands
/// still looks the same with and without them.
#[derive(Debug, Clone)]
pub struct World {
    /// What stands still.
    pub scene: Scene,
    /// What moves.
    pub movers: Vec<Mover>,
    /// Covers of the rectangles of the scene, then of the sides of the movers, one mover after the other.
    pub(super) surfaces: Vec<Surface>,
}

impl World {
    /// Paints and lights a scene in which nothing moves. Takes a second or so for a room; `threads` do not change the result.
    #[must_use]
    pub fn bake(scene: Scene, seed: u64, threads: usize) -> Self {
        Self::bake_with(scene, Vec::new(), seed, threads)
    }

    /// Paints and lights a scene and what moves in it.
    #[must_use]
    pub fn bake_with(scene: Scene, movers: Vec<Mover>, seed: u64, threads: usize) -> Self {
        Self::bake_coarsely(scene, movers, seed, threads, 1.0)
    }

    /// [`bake_with`](Self::bake_with) with texels `coarseness` (1 or more) times as wide: for small pictures, in a fraction of the
    /// time.
    #[must_use]
    pub fn bake_coarsely(scene: Scene, movers: Vec<Mover>, seed: u64, threads: usize, coarseness: f64) -> Self {
        let sides: Vec<Quad> = movers.iter().flat_map(|mover| mover.sides.iter().map(|side| side.moved(&mover.world_from_pivot))).collect();
        let surfaces = surface::bake(&scene, &sides, seed, threads, coarseness.max(1.0));
        Self { scene, movers, surfaces }
    }

    /// Whether the rectangle of this number moves.
    #[must_use]
    pub fn moves(&self, quad: usize) -> bool {
        quad >= self.scene.quads.len() && quad < self.surfaces.len()
    }

    /// All rectangles in the order of their numbers, each with `T_CF` of the frame that it is given in: the world, or its mover's.
    pub(super) fn rectangles(&self, moment: &Moment) -> impl Iterator<Item = (&Quad, Isometry3<f64>)> {
        let camera_from_world = moment.world_from_camera.inverse();
        let seconds = moment.seconds;
        let moving = self.movers.iter().flat_map(move |mover| {
            let camera_from_mover = camera_from_world * mover.world_from_mover(seconds);
            mover.sides.iter().map(move |side| (side, camera_from_mover))
        });
        self.scene.quads.iter().map(move |quad| (quad, camera_from_world)).chain(moving)
    }

    /// The normals of all rectangles in world at a time, in the order of their numbers.
    pub(super) fn normals(&self, seconds: f64) -> Vec<Vector3<f32>> {
        let moving = self.movers.iter().flat_map(|mover| {
            let rotation = mover.world_from_mover(seconds).rotation;
            mover.sides.iter().map(move |side| rotation * side.normal)
        });
        self.scene.quads.iter().map(|quad| quad.normal).chain(moving).map(|normal| normal.cast()).collect()
    }

    /// Per moment the faces that all moments can see, in the order of their numbers.
    pub(super) fn faces(&self, moments: &[Moment]) -> Vec<Vec<Face>> {
        let all: Vec<Vec<Option<Face>>> = moments
            .iter()
            .map(|moment| {
                let seen = self.rectangles(moment).zip(&self.surfaces).enumerate();
                seen.map(|(number, ((quad, pose), surface))| Face::new(quad, surface.density, number, &pose)).collect()
            })
            .collect();
        let is_seen = |number: usize| all.iter().all(|faces| faces[number].is_some());
        let seen: Vec<usize> = (0..self.surfaces.len()).filter(|number| is_seen(*number)).collect();
        all.iter().map(|faces| seen.iter().filter_map(|number| faces[*number]).collect()).collect()
    }
}
