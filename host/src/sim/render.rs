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

use libella_core::camera::{Camera, CameraModel};
use nalgebra::{Isometry3, Vector2, Vector3};

use super::SimError;
use super::photometry::{Photometry, PhotometryConfig};
use super::scene::Scene;
use super::surface::{self, Surface};
use super::trajectory::Trajectory;
use crate::dataset::GrayImage;

/// What lies behind every pixel centre.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Depth along the optical axis, m; 0 where there is nothing.
    pub depth_m: Vec<f64>,
    /// Index of the rectangle; `u16::MAX` where there is none.
    pub quad: Vec<u16>,
}

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

/// A scene with baked light.
#[derive(Debug, Clone)]
pub struct World {
    /// What it is made of.
    pub scene: Scene,
    surfaces: Vec<Surface>,
}

impl World {
    /// Paints and lights a scene. Takes a second or so for a room; `threads` do not change the result.
    #[must_use]
    pub fn bake(scene: Scene, seed: u64, threads: usize) -> Self {
        Self::bake_coarsely(scene, seed, threads, 1.0)
    }

    /// [`bake`](Self::bake) with texels `coarseness` (1 or more) times as wide: for small pictures, in a fraction of the time.
    #[must_use]
    pub fn bake_coarsely(scene: Scene, seed: u64, threads: usize, coarseness: f64) -> Self {
        let surfaces = surface::bake(&scene, seed, threads, coarseness.max(1.0));
        Self { scene, surfaces }
    }
}

/// Pixels per side of a tile.
const TILE: usize = 16;
/// Sub-pixels: a rotated grid whose mean is the pixel centre.
const SUB_PIXELS: [[f64; 2]; 4] = [[-0.375, -0.125], [0.125, -0.375], [0.375, 0.125], [-0.125, 0.375]];

/// A rectangle as a camera sees it at one instant; see the module's model. Lengths along u and v in texels.
#[derive(Debug, Clone, Copy)]
struct Face {
    w: [f32; 3],
    a: [f32; 3],
    b: [f32; 3],
    corner: [f32; 2],
    size: [f32; 2],
    quad: u32,
}

#[inline(always)]
fn linear(row: &[f32; 3], x: f32, y: f32) -> f32 {
    row[0] * x + row[1] * y + row[2]
}

impl Face {
    /// `None` for a rectangle that turns its back.
    #[allow(clippy::cast_possible_truncation)]
    fn new(world: &World, quad: usize, camera_from_world: &Isometry3<f64>) -> Option<Self> {
        let rectangle = &world.scene.quads[quad];
        let corner = camera_from_world.transform_point(&rectangle.corner.into()).coords;
        let turn = |v: &Vector3<f64>| camera_from_world.rotation * v;
        let (normal, a, b) = (turn(&rectangle.normal), turn(&rectangle.axis_u), turn(&rectangle.axis_v));
        let offset = normal.dot(&corner);
        if offset > -1e-6 {
            return None;
        }
        let density = world.surfaces[quad].density.map(f64::from);
        let row = |v: Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
        Some(Self {
            w: row(normal / offset),
            a: row(a * density[0]),
            b: row(b * density[1]),
            corner: [(a.dot(&corner) * density[0]) as f32, (b.dot(&corner) * density[1]) as f32],
            size: [(rectangle.size_m[0] * density[0]) as f32, (rectangle.size_m[1] * density[1]) as f32],
            quad: quad as u32,
        })
    }

    /// The five conditions at a ray; all positive means hit.
    #[inline(always)]
    fn conditions(&self, x: f32, y: f32) -> [f32; 5] {
        let w = linear(&self.w, x, y);
        let (u, v) = (linear(&self.a, x, y) - self.corner[0] * w, linear(&self.b, x, y) - self.corner[1] * w);
        [w, u, self.size[0] * w - u, v, self.size[1] * w - v]
    }

    /// Whether no ray of a tile can meet it.
    fn misses(&self, tile: &[f32; 4]) -> bool {
        let [left, top, right, bottom] = *tile;
        let corners = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| self.conditions(x, y));
        (0..5).any(|k| corners.iter().all(|conditions| conditions[k] < 0.0))
    }
}

/// The nearest face on a ray, and its inverse depth there.
#[inline(always)]
fn nearest(faces: &[Face], x: f32, y: f32) -> Option<(&Face, f32)> {
    let mut best = 0.0_f32;
    let mut found = None;
    for face in faces {
        let [w, u0, u1, v0, v1] = face.conditions(x, y);
        if w > best && u0 >= 0.0 && u1 >= 0.0 && v0 >= 0.0 && v1 >= 0.0 {
            best = w;
            found = Some(face);
        }
    }
    found.map(|face| (face, best))
}

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
        let poses: Vec<Isometry3<f64>> =
            (0..instants).map(|k| pose(seconds + self.config.exposure_s * ((f64::from(k) + 0.5) / f64::from(instants) - 0.5))).collect();
        let gain = self.photometry.gain(|time| self.mean_radiance(&pose(time)), seconds);
        self.expose(&poses, gain, index)
    }

    /// The picture of poses that share the exposure.
    fn expose(&self, world_from_camera: &[Isometry3<f64>], gain: f32, index: u64) -> GrayImage {
        let faces = self.faces(world_from_camera);
        let mut pixels = vec![0_u8; self.width * self.height];
        self.in_bands(&mut pixels, |band, rows| self.shade_band(&faces, band, rows, gain, index));
        GrayImage { width: self.width, height: self.height, pixels }
    }

    /// Per instant the faces that any instant can see, in the same order.
    fn faces(&self, world_from_camera: &[Isometry3<f64>]) -> Vec<Vec<Face>> {
        let inverses: Vec<_> = world_from_camera.iter().map(Isometry3::inverse).collect();
        let visible: Vec<usize> = (0..self.world.scene.quads.len())
            .filter(|quad| inverses.iter().all(|pose| Face::new(self.world, *quad, pose).is_some()))
            .collect();
        inverses.iter().map(|pose| visible.iter().filter_map(|quad| Face::new(self.world, *quad, pose)).collect()).collect()
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

    /// Which of the faces a tile may see at the first or the last instant.
    fn candidates(faces: &[Vec<Face>], among: &[usize], tile: &[f32; 4]) -> Vec<usize> {
        let (Some(first), Some(last)) = (faces.first(), faces.last()) else { return Vec::new() };
        among.iter().copied().filter(|k| !(first[*k].misses(tile) && last[*k].misses(tile))).collect()
    }

    fn shade_band(&self, faces: &[Vec<Face>], band: usize, rows: &mut [u8], gain: f32, index: u64) {
        let columns = self.width.div_ceil(TILE);
        let tiles = &self.tiles[band * columns..(band + 1) * columns];
        let whole = tiles.iter().fold([f32::MAX, f32::MAX, f32::MIN, f32::MIN], |sum, tile| {
            [sum[0].min(tile[0]), sum[1].min(tile[1]), sum[2].max(tile[2]), sum[3].max(tile[3])]
        });
        let all: Vec<usize> = (0..faces.first().map_or(0, Vec::len)).collect();
        let in_band = Self::candidates(faces, &all, &whole);
        let share = gain / (faces.len() as f32 * Surface::UNIT);
        let mut near: Vec<Face> = Vec::new();
        for (column, tile) in tiles.iter().enumerate() {
            // Side by side in memory, instant after instant.
            let candidates = Self::candidates(faces, &in_band, tile);
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

    /// Mean radiance of a coarse picture, for the exposure control; bright spots count as just white.
    fn mean_radiance(&self, world_from_camera: &Isometry3<f64>) -> f32 {
        let faces = self.faces(std::slice::from_ref(world_from_camera));
        let Some(faces) = faces.first() else { return 0.5 };
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

    /// Exact depths and rectangles of the pixel centres from a pose of the camera.
    #[must_use]
    pub fn depth(&self, world_from_camera: &Isometry3<f64>) -> DepthMap {
        let faces = self.faces(std::slice::from_ref(world_from_camera));
        let columns = self.width.div_ceil(TILE);
        let camera_from_world = world_from_camera.inverse();
        // Which face is decided in f32; how far it is, in f64.
        let planes: Vec<Vector3<f64>> = self
            .world
            .scene
            .quads
            .iter()
            .map(|quad| {
                let corner = camera_from_world.transform_point(&quad.corner.into()).coords;
                let normal = camera_from_world.rotation * quad.normal;
                normal / normal.dot(&corner)
            })
            .collect();
        let mut cells = vec![(0.0_f64, u16::MAX); self.width * self.height];
        let all: Vec<usize> = (0..faces.first().map_or(0, Vec::len)).collect();
        self.in_bands(&mut cells, |band, rows| {
            for column in 0..columns {
                let candidates = Self::candidates(&faces, &all, &self.tiles[band * columns + column]);
                let near: Vec<Face> = candidates.iter().map(|k| faces[0][*k]).collect();
                for (line, row) in rows.chunks_mut(self.width).enumerate() {
                    for (x, cell) in row.iter_mut().enumerate().skip(column * TILE).take(TILE) {
                        let Some([ray_x, ray_y]) = self.centers.get((band * TILE + line) * self.width + x) else { continue };
                        if let Some((face, _)) = nearest(&near, *ray_x as f32, *ray_y as f32) {
                            let w = planes[face.quad as usize].dot(&Vector3::new(*ray_x, *ray_y, 1.0));
                            *cell = (1.0 / w, u16::try_from(face.quad).unwrap_or(u16::MAX));
                        }
                    }
                }
            }
        });
        let (depth_m, quad) = cells.into_iter().unzip();
        DepthMap { width: self.width, height: self.height, depth_m, quad }
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

impl DepthMap {
    /// The normal of the surface behind every pixel, in world; zero where there is nothing.
    #[must_use]
    pub fn normals_in_world(&self, scene: &Scene) -> Vec<Vector3<f32>> {
        self.quad.iter().map(|quad| scene.quads.get(usize::from(*quad)).map_or(Vector3::zeros(), |quad| quad.normal.cast())).collect()
    }
}

#[cfg(test)]
#[path = "render_tests.rs"]
mod tests;
