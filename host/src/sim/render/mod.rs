//! Pictures of a scene through a real lens.
//!
//! # Model
//! A rectangle seen from a camera at the origin, with corner `c`, sides `a`, `b` and normal `n` in camera coordinates, meets the ray
//! `d = (x, y, 1)` at depth `1/w` with everything linear in `d`:
//! ```text
//! w = nᵀd / nᵀc        u = aᵀd / w − aᵀc        v = bᵀd / w − bᵀc
//! hit ⇔ w > 0,  aᵀd − (aᵀc) w ≥ 0,  (|a| + aᵀc) w − aᵀd ≥ 0,  the same for b
//! ```
//! The greatest `w` wins. Because the five conditions are linear, a tile of pixels that fails one of them at all four corners
//! cannot see the rectangle: each tile tries only what is left. The rays of all sub-pixels are unprojected once per camera, so
//! the distortion is exact. Sub-pixels share the exposure: each is taken at another instant, which is the motion blur.

mod depth;
mod face;
#[cfg(test)]
mod mover_tests;
#[cfg(test)]
mod tests;
mod world;

pub use depth::DepthMap;
pub use world::World;

use libella_core::camera::{Camera, CameraModel};
use nalgebra::{Isometry3, Vector2};

use super::SimError;
use super::photometry::{Photometry, PhotometryConfig};
use super::surface::Surface;
use super::trajectory::Trajectory;
use crate::dataset::GrayImage;
use face::{Face, linear, nearest};
use world::Moment;

/// How pictures are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderConfig {
    /// How long the shutter is open, s; 0 to 0.03. The stamp is the middle of the exposure.
    pub exposure_s: f64,
    /// Lens and sensor.
    pub photometry: PhotometryConfig,
    /// Threads; 1 to 256. The picture does not depend on it.
    pub threads: usize,
}

impl Default for RenderConfig {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from).min(256);
        Self { exposure_s: 0.004, photometry: PhotometryConfig::default(), threads }
    }
}

/// Pixels per side of a tile.
const TILE: usize = 16;
/// Sub-pixels: a rotated grid whose mean is the pixel centre.
const SUB_PIXELS: [[f64; 2]; 4] = [[-0.375, -0.125], [0.125, -0.375], [0.375, 0.125], [-0.125, 0.375]];

/// A camera in a world.
#[derive(Debug, Clone)]
pub struct Renderer<'a> {
    world: &'a World,
    body_from_camera: Isometry3<f64>,
    config: RenderConfig,
    photometry: Photometry,
    width: usize,
    height: usize,
    focal_px: f64,
    /// Per pixel the rays `(x, y, 1)` of its sub-pixels.
    rays: Vec<[[f32; 2]; 4]>,
    /// Per pixel the ray of its centre.
    centers: Vec<[f64; 2]>,
    /// Left, top, right, bottom of the rays of each tile.
    tiles: Vec<[f32; 4]>,
}

impl<'a> Renderer<'a> {
    /// Prepares the rays of a camera.
    ///
    /// # Errors
    /// A parameter out of range, or a camera whose pixels cannot all be unprojected to the front.
    pub fn new(
        world: &'a World,
        camera: &CameraModel<f64>,
        body_from_camera: &Isometry3<f64>,
        config: &RenderConfig,
        seed: u64,
    ) -> Result<Self, SimError> {
        SimError::check("render.exposure_s", config.exposure_s, 0.0, 0.03)?;
        SimError::check("render.threads", config.threads as f64, 1.0, 256.0)?;
        let (width, height) = camera.size_px();
        SimError::check("camera.width_px", f64::from(width), 16.0, 8192.0)?;
        SimError::check("camera.height_px", f64::from(height), 16.0, 8192.0)?;
        let (width, height) = (width as usize, height as usize);
        let ray = |x: f64, y: f64| {
            camera
                .unproject(&Vector2::new(x, y))
                .filter(|bearing| bearing.z > 0.02)
                .map(|bearing| [bearing.x / bearing.z, bearing.y / bearing.z])
                .ok_or(SimError::NoRay { x, y })
        };
        let mut rays = Vec::with_capacity(width * height);
        let mut centers = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                let (x, y) = (column as f64, row as f64);
                let mut subs = [[0.0_f32; 2]; 4];
                for (sub, offset) in subs.iter_mut().zip(&SUB_PIXELS) {
                    *sub = ray(x + offset[0], y + offset[1])?.map(|value| value as f32);
                }
                rays.push(subs);
                centers.push(ray(x, y)?);
            }
        }
        let focal_px = camera.focal_px();
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut tiles = vec![[f32::MAX, f32::MAX, f32::MIN, f32::MIN]; columns * rows];
        // Between the first and the last instant of an exposure edges stray from straight by less than a pixel.
        let margin = (1.5 / focal_px) as f32;
        for (index, subs) in rays.iter().enumerate() {
            let tile = &mut tiles[(index / width / TILE) * columns + index % width / TILE];
            for [x, y] in subs {
                *tile = [tile[0].min(x - margin), tile[1].min(y - margin), tile[2].max(x + margin), tile[3].max(y + margin)];
            }
        }
        let photometry = Photometry::new(&config.photometry, width, height, seed)?;
        Ok(Self { world, body_from_camera: *body_from_camera, config: *config, photometry, width, height, focal_px, rays, centers, tiles })
    }

    /// The picture at a time of a trajectory; `index` tells the noise of pictures apart.
    #[must_use]
    pub fn image(&self, trajectory: &dyn Trajectory, seconds: f64, index: u64) -> GrayImage {
        let pose = |time: f64| {
            let motion = trajectory.at(time);
            Isometry3::from_parts(motion.position_in_world.into(), motion.world_from_body) * self.body_from_camera
        };
        // Enough instants that an edge moves by a pixel or less between them; four at least, one per sub-pixel.
        let half = 0.5 * self.config.exposure_s;
        let (before, after) = (pose(seconds - half), pose(seconds + half));
        let turned_px = before.rotation.angle_to(&after.rotation) * self.focal_px;
        let moved_px = (after.translation.vector - before.translation.vector).norm() * self.focal_px / 1.5;
        let instants = if turned_px + moved_px > 12.0 {
            16
        } else if turned_px + moved_px > 5.0 {
            8
        } else {
            4
        };
        let moment = |seconds: f64| Moment { seconds, world_from_camera: pose(seconds) };
        let moments: Vec<Moment> =
            (0..instants).map(|k| moment(seconds + self.config.exposure_s * ((f64::from(k) + 0.5) / f64::from(instants) - 0.5))).collect();
        let gain = self.photometry.gain(|time| self.mean_radiance(&moment(time)), seconds);
        self.expose(&moments, gain, index)
    }

    /// The picture of moments that share the exposure.
    fn expose(&self, moments: &[Moment], gain: f32, index: u64) -> GrayImage {
        let faces = self.world.faces(moments);
        let mut pixels = vec![0_u8; self.width * self.height];
        self.in_bands(&mut pixels, |band, rows| self.shade_band(&faces, band, rows, gain, index));
        GrayImage { width: self.width, height: self.height, pixels }
    }

    /// Runs `work` on bands of tile height; bands are dealt to the threads like cards.
    fn in_bands<P: Send>(&self, pixels: &mut [P], work: impl Fn(usize, &mut [P]) + Sync) {
        let threads = self.config.threads.max(1);
        let mut hands: Vec<Vec<(usize, &mut [P])>> = (0..threads).map(|_| Vec::new()).collect();
        for (band, rows) in pixels.chunks_mut(self.width * TILE).enumerate() {
            hands[band % threads].push((band, rows));
        }
        let work = &work;
        std::thread::scope(|scope| {
            let mut hands = hands.into_iter();
            let own = hands.next();
            for hand in hands {
                scope.spawn(move || hand.into_iter().for_each(|(band, rows)| work(band, rows)));
            }
            own.into_iter().flatten().for_each(|(band, rows)| work(band, rows));
        });
    }

    /// Which of the faces a tile may see at the first or the last instant, or, of what moves by itself, at any.
    fn candidates(&self, faces: &[Vec<Face>], among: &[usize], tile: &[f32; 4]) -> Vec<usize> {
        let (Some(first), Some(last)) = (faces.first(), faces.last()) else { return Vec::new() };
        let may_see = |k: usize| {
            !(first[k].misses(tile) && last[k].misses(tile))
                || self.world.moves(first[k].quad as usize) && faces.iter().any(|faces| !faces[k].misses(tile))
        };
        among.iter().copied().filter(|k| may_see(*k)).collect()
    }

    fn shade_band(&self, faces: &[Vec<Face>], band: usize, rows: &mut [u8], gain: f32, index: u64) {
        let columns = self.width.div_ceil(TILE);
        let tiles = &self.tiles[band * columns..(band + 1) * columns];
        let whole = tiles.iter().fold([f32::MAX, f32::MAX, f32::MIN, f32::MIN], |sum, tile| {
            [sum[0].min(tile[0]), sum[1].min(tile[1]), sum[2].max(tile[2]), sum[3].max(tile[3])]
        });
        let all: Vec<usize> = (0..faces.first().map_or(0, Vec::len)).collect();
        let in_band = self.candidates(faces, &all, &whole);
        let share = gain / (faces.len() as f32 * Surface::UNIT);
        let mut near: Vec<Face> = Vec::new();
        for (column, tile) in tiles.iter().enumerate() {
            // Side by side in memory, instant after instant.
            let candidates = self.candidates(faces, &in_band, tile);
            near.clear();
            faces.iter().for_each(|faces| near.extend(candidates.iter().map(|k| faces[*k])));
            for (line, row) in rows.chunks_mut(self.width).enumerate() {
                let y = band * TILE + line;
                for (x, grey) in row.iter_mut().enumerate().skip(column * TILE).take(TILE) {
                    let pixel = y * self.width + x;
                    let Some(rays) = self.rays.get(pixel) else { continue };
                    let mut sum = 0.0;
                    for (instant, faces) in near.chunks(candidates.len().max(1)).enumerate() {
                        let [ray_x, ray_y] = rays[instant & 3];
                        if let Some((face, w)) = nearest(faces, ray_x, ray_y) {
                            sum += self.shade(face, w, ray_x, ray_y, instant);
                        }
                    }
                    *grey = self.photometry.digitise(sum * share, pixel, index);
                }
            }
        }
    }

    /// Radiance of a face at a ray that meets it at inverse depth `w`.
    #[inline(always)]
    #[allow(clippy::cast_sign_loss, clippy::cast_possible_truncation)]
    fn shade(&self, face: &Face, w: f32, x: f32, y: f32, instant: usize) -> f32 {
        let depth = 1.0 / w;
        let u = linear(&face.a, x, y) * depth - face.corner[0];
        let v = linear(&face.b, x, y) * depth - face.corner[1];
        let surface = &self.world.surfaces[face.quad as usize];
        // A pixel covers depth/f across and 1/cos θ times that along the slope, where cos θ = |w|/(|∇w| |d|); a sub-pixel half.
        let slope = (face.w[0] * face.w[0] + face.w[1] * face.w[1] + face.w[2] * face.w[2]) * (x * x + y * y + 1.0);
        let density = surface.density[0].min(surface.density[1]);
        let squared = depth * density / self.focal_px as f32;
        let squared = squared * squared * depth * slope.sqrt();
        // log₂ of the footprint by its exponent; the four sub-pixels round at different places, which blends the levels.
        let footprint = 0.5 * squared * [0.7, 1.0, 1.4, 2.0][instant & 3];
        let exponent = (footprint.to_bits() >> 23) as i32 - 127;
        surface.radiance(u, v, (exponent >> 1).max(0) as u32)
    }

    /// Mean radiance of a coarse picture of what stands still, for the exposure control; bright spots count as just white.
    fn mean_radiance(&self, moment: &Moment) -> f32 {
        let faces = self.world.faces(std::slice::from_ref(moment));
        let Some(faces) = faces.first() else { return 0.5 };
        let still = faces.partition_point(|face| !self.world.moves(face.quad as usize));
        let faces = &faces[..still];
        let (mut sum, mut count) = (0.0, 0.0);
        for y in (self.height / 24..self.height).step_by(self.height / 12) {
            for x in (self.width / 36..self.width).step_by(self.width / 18) {
                let [ray_x, ray_y] = self.rays[y * self.width + x][0];
                if let Some((face, w)) = nearest(faces, ray_x, ray_y) {
                    let surface = &self.world.surfaces[face.quad as usize];
                    let (u, v) = (linear(&face.a, ray_x, ray_y) / w - face.corner[0], linear(&face.b, ray_x, ray_y) / w - face.corner[1]);
                    sum += (surface.radiance(u, v, 4) / Surface::UNIT).min(1.0);
                }
                count += 1.0;
            }
        }
        sum / f32::max(count, 1.0)
    }

    /// The world the camera is in.
    #[must_use]
    pub fn world(&self) -> &World {
        self.world
    }

    /// `T_BC`.
    #[must_use]
    pub fn body_from_camera(&self) -> &Isometry3<f64> {
        &self.body_from_camera
    }
}
