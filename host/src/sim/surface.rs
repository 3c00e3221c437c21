//! Baked covers: reflectance times light, at several resolutions.
//!
//! # Model
//! The light on a point of a matt surface is what lamps, windows and the room around send it:
//! ```text
//! E = a · open + Σ_lamps  Φ cos θ / r² · visible + Σ_windows Φ A cos θ cos θ' / r² · visible
//! ```
//! `open` is the share of the hemisphere without anything near (ambient occlusion). The light is smooth: it is computed on a grid
//! of decimetres and interpolated; the radiance `ρ E` is stored for every texel in levels of halved resolution (box filter).

use nalgebra::Vector3;

use super::random::{Random, mix};
use super::scene::{Material, Quad, Scene};
use super::texture::{CHECKERBOARD_SQUARES, Paint};

/// Radiance 1.0 as stored; 16 is the brightest that can be told.
const UNIT: f32 = 4096.0;

/// One resolution of a cover. One row and column more than it has texels repeat the last, for interpolation.
#[derive(Debug, Clone)]
struct Level {
    start: usize,
    stride: usize,
    /// Greatest coordinate that still has a neighbour.
    last: [f32; 2],
}

/// The baked cover of one rectangle.
#[derive(Debug, Clone)]
pub(super) struct Surface {
    texels: Vec<u16>,
    levels: Vec<Level>,
    /// Texels per metre at the finest level, along u and v.
    pub density: [f32; 2],
}

impl Surface {
    /// Radiance at a place (in texels of the finest level) at a level, bilinear.
    #[inline]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    pub(super) fn radiance(&self, u: f32, v: f32, level: u32) -> f32 {
        let index = (level as usize).min(self.levels.len() - 1);
        let level = &self.levels[index];
        // Texel i covers [i, i + 1): its value belongs to i + 1/2.
        let scale = f32::from_bits((127 - index as u32) << 23);
        let x = (u * scale - 0.5).clamp(0.0, level.last[0]);
        let y = (v * scale - 0.5).clamp(0.0, level.last[1]);
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f32, y - row as f32);
        let start = level.start + row * level.stride + column;
        let (Some(&[a, b]), Some(&[c, d])) = (
            self.texels.get(start..start + 2).and_then(|pair| pair.first_chunk::<2>()),
            self.texels.get(start + level.stride..start + level.stride + 2).and_then(|pair| pair.first_chunk::<2>()),
        ) else {
            return 0.0;
        };
        let (a, b, c, d) = (f32::from(a), f32::from(b), f32::from(c), f32::from(d));
        let (near, far) = (a + (b - a) * fx, c + (d - c) * fx);
        near + (far - near) * fy
    }

    /// Radiance 1.0 in the units of [`radiance`](Self::radiance).
    pub(super) const UNIT: f32 = UNIT;

    /// Evaluates a cover under a light and builds the levels.
    fn bake(scene: &Scene, quad: &Quad, index: usize, lamps: &[Lamp], seed: u64, coarseness: f64) -> Self {
        // Things in a hall of 11 times a room's floor are seen from three times as far.
        let largest = scene.quads.iter().map(|quad| quad.size_m[0] * quad.size_m[1]).fold(64.0, f64::max);
        let counts = texel_counts(quad, (64.0 / largest).sqrt(), coarseness);
        let paint = Paint::new(quad, seed, index as u64, (quad.size_m[0] / counts[0] as f64) as f32);
        let light = LightGrid::new(scene, quad, index, lamps, seed);
        let glow = quad.material.glow();
        let step = [0, 1].map(|k| quad.size_m[k] as f32 / counts[k] as f32);
        let mut finest = Vec::with_capacity(counts[0] * counts[1]);
        for row in 0..counts[1] {
            for column in 0..counts[0] {
                let albedo = paint.albedo((column as f32 + 0.5) * step[0], (row as f32 + 0.5) * step[1]);
                let light = light.at((column as f32 + 0.5) / counts[0] as f32, (row as f32 + 0.5) / counts[1] as f32);
                finest.push(albedo * (light + glow));
            }
        }
        Self::pyramid(finest, counts, [1.0 / step[0], 1.0 / step[1]])
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn pyramid(finest: Vec<f32>, counts: [usize; 2], density: [f32; 2]) -> Self {
        let mut texels = Vec::new();
        let mut levels = Vec::new();
        let (mut values, mut size) = (finest, counts);
        loop {
            let [width, height] = size;
            levels.push(Level { start: texels.len(), stride: width + 1, last: [(width - 1) as f32, (height - 1) as f32] });
            for row in (0..height).chain([height - 1]) {
                let line = &values[row * width..(row + 1) * width];
                texels.extend(line.iter().chain(line.last()).map(|value| (value * UNIT + 0.5).clamp(0.0, 65535.0) as u16));
            }
            if width.min(height) < 2 {
                break;
            }
            let half = [width.div_ceil(2), height.div_ceil(2)];
            let mut next = Vec::with_capacity(half[0] * half[1]);
            for row in 0..half[1] {
                let rows = [2 * row, (2 * row + 1).min(height - 1)];
                for column in 0..half[0] {
                    let columns = [2 * column, (2 * column + 1).min(width - 1)];
                    let sum: f32 = rows.iter().map(|r| columns.iter().map(|c| values[r * width + c]).sum::<f32>()).sum();
                    next.push(0.25 * sum);
                }
            }
            values = next;
            size = half;
        }
        Self { texels, levels, density }
    }
}

/// How finely a rectangle is sampled: 2 mm on pictures, 3 mm on things, 4 mm on walls, 8 mm overhead, coarser on what is large;
/// things get a `share` of the usual number; all but checkerboards `coarseness` times as coarse.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn texel_counts(quad: &Quad, share: f64, coarseness: f64) -> [usize; 2] {
    if quad.material == Material::Checkerboard {
        // A whole number of texels per half square, so that the pattern's corners are corners of texels.
        return CHECKERBOARD_SQUARES.map(|squares| (squares + 1) * 40);
    }
    let area = quad.size_m[0] * quad.size_m[1];
    // The finest texel and the most of them: a hall is seen from further away than a room.
    let (base, most) = match quad.material {
        Material::PlayMat | Material::Poster | Material::Tape => (0.002, 6e5 * share),
        Material::Ceiling => (0.008, 1e6),
        _ if area > 25.0 => (0.004, 4e6),
        _ if area > 8.0 => (0.004, 4e5 * share),
        _ => (0.003, 2.5e5 * share),
    };
    let texel_m = coarseness * f64::max(base, (area / most).sqrt());
    quad.size_m.map(|side| ((side / texel_m).ceil() as usize).max(2))
}

/// A lamp: a small bright body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lamp {
    position: Vector3<f64>,
    power: f64,
    /// Direction and cosine law of a window; `None` for a lamp that shines everywhere.
    facing: Option<Vector3<f64>>,
}

/// Four lamps under the ceiling of different strength, and the windows.
fn lamps(scene: &Scene, seed: u64) -> Vec<Lamp> {
    let mut random = Random::new(seed, "lamps");
    let mut lamps = Vec::new();
    if let Some(ceiling) = scene.quads.iter().find(|quad| quad.material == Material::Ceiling) {
        let [length, width] = ceiling.size_m;
        let reach_squared = length * width / 16.0;
        for (u, v) in [(0.27, 0.3), (0.72, 0.25), (0.3, 0.74), (0.75, 0.7)] {
            let position = ceiling.point(length * (u + random.between(-0.05, 0.05)), width * (v + random.between(-0.05, 0.05)));
            lamps.push(Lamp { position: position + ceiling.normal * 0.25, power: random.between(0.2, 0.95) * reach_squared, facing: None });
        }
    }
    for window in scene.quads.iter().filter(|quad| quad.material == Material::Window && quad.size_m[0] * quad.size_m[1] > 0.5) {
        for (u, v) in [(0.3, 0.3), (0.7, 0.7)] {
            let position = window.point(window.size_m[0] * u, window.size_m[1] * v) + window.normal * 0.02;
            lamps.push(Lamp { position, power: 0.5 * window.size_m[0] * window.size_m[1], facing: Some(window.normal) });
        }
    }
    lamps
}

/// The light on a rectangle, on a grid of about a decimetre.
struct LightGrid {
    values: Vec<f32>,
    size: [usize; 2],
}

impl LightGrid {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn new(scene: &Scene, quad: &Quad, index: usize, lamps: &[Lamp], seed: u64) -> Self {
        let cell = (quad.size_m[0] * quad.size_m[1] / 4000.0).sqrt().clamp(0.14, 0.5);
        let size = quad.size_m.map(|side| ((side / cell).ceil() as usize + 1).clamp(2, 200));
        let mut random = Random::new(mix(seed ^ (index as u64)), "light");
        let mut values = Vec::with_capacity(size[0] * size[1]);
        for row in 0..size[1] {
            for column in 0..size[0] {
                // A hair inside of the rim, where neighbours in a corner would hide everything.
                let place = [column as f64 / (size[0] - 1) as f64, row as f64 / (size[1] - 1) as f64].map(|part| 0.002 + 0.996 * part);
                let point = quad.point(place[0] * quad.size_m[0], place[1] * quad.size_m[1]) + quad.normal * 1e-3;
                values.push(light_on(scene, &point, quad, lamps, &mut random) as f32);
            }
        }
        Self { values, size }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn at(&self, u: f32, v: f32) -> f32 {
        let x = (u * (self.size[0] - 1) as f32).clamp(0.0, (self.size[0] - 1) as f32 - 1e-3);
        let y = (v * (self.size[1] - 1) as f32).clamp(0.0, (self.size[1] - 1) as f32 - 1e-3);
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x - column as f32, y - row as f32);
        let value = |c: usize, r: usize| self.values[r * self.size[0] + c];
        let near = value(column, row) * (1.0 - fx) + value(column + 1, row) * fx;
        let far = value(column, row + 1) * (1.0 - fx) + value(column + 1, row + 1) * fx;
        near * (1.0 - fy) + far * fy
    }
}

fn light_on(scene: &Scene, point: &Vector3<f64>, quad: &Quad, lamps: &[Lamp], random: &mut Random) -> f64 {
    // Ambient: rays by the cosine law, each open from a metre on.
    let rays = 12;
    let turn = random.unit();
    let mut open = 0.0;
    for k in 0..rays {
        let radius = ((f64::from(k) + 0.5) / f64::from(rays)).sqrt();
        let angle = std::f64::consts::TAU * (f64::from(k) * 0.618_034 + turn);
        let up = (1.0 - radius * radius).sqrt();
        let direction = quad.axis_u * (radius * angle.cos()) + quad.axis_v * (radius * angle.sin()) + quad.normal * up;
        let distance = scene.cast(point, &direction).map_or(1.0, |hit| hit.distance.min(1.0));
        open += (0.3 + 0.7 * distance) / f64::from(rays);
    }
    let mut light = 0.22 * open;
    for lamp in lamps {
        let way = lamp.position - point;
        let distance_squared = way.norm_squared().max(0.04);
        let cosine = quad.normal.dot(&way) / distance_squared.sqrt();
        let law = lamp.facing.map_or(1.0, |facing| (-facing.dot(&way) / distance_squared.sqrt()).max(0.0));
        if cosine <= 0.0 || law <= 0.0 {
            continue;
        }
        // Lamps are 30 cm wide: four rays make their shadows soft. Windows are several lamps already.
        let corners = [
            Vector3::new(0.15, 0.1, 0.05),
            Vector3::new(-0.1, 0.15, -0.05),
            Vector3::new(0.1, -0.15, 0.05),
            Vector3::new(-0.15, -0.1, -0.05),
        ];
        let clear = |target: &Vector3<f64>| if scene.is_clear(point, target, 1e-3) { 1.0 } else { 0.0 };
        let visible = if lamp.facing.is_some() {
            clear(&lamp.position)
        } else {
            corners.iter().map(|corner| 0.25 * clear(&(lamp.position + corner))).sum()
        };
        light += lamp.power * cosine * law / (distance_squared + 0.25) * visible;
    }
    light
}

/// Bakes all rectangles of a scene, and `more` in it that neither shade nor hide it, on a number of threads. The result does not
/// depend on that number, nor that of the scene's own rectangles on the others.
pub(super) fn bake(scene: &Scene, more: &[Quad], seed: u64, threads: usize, coarseness: f64) -> Vec<Surface> {
    let lamps = lamps(scene, seed);
    let quads: Vec<&Quad> = scene.quads.iter().chain(more).collect();
    let next = std::sync::atomic::AtomicUsize::new(0);
    let mut parts: Vec<(usize, Surface)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.max(1))
            .map(|_| {
                scope.spawn(|| {
                    let mut done = Vec::new();
                    loop {
                        let index = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                        let Some(quad) = quads.get(index) else { break done };
                        done.push((index, Surface::bake(scene, quad, index, &lamps, seed, coarseness)));
                    }
                })
            })
            .collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap_or_default()).collect()
    });
    parts.sort_by_key(|(index, _)| *index);
    parts.into_iter().map(|(_, surface)| surface).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn levels_keep_the_mean_and_the_place() {
        // A ramp: every level of a box filter says the same at the same place, away from the rim.
        let (width, height) = (64, 32);
        let values = (0..width * height).map(|k| 0.01 + (k % width) as f32 * 0.01).collect();
        let surface = Surface::pyramid(values, [width, height], [1.0, 1.0]);
        for level in 0..4 {
            for u in [20.0, 31.5, 40.25] {
                let expected = 0.01 + (u - 0.5) * 0.01;
                let measured = surface.radiance(u, 16.0, level) / Surface::UNIT;
                assert!((measured - expected).abs() < 2.0 / Surface::UNIT, "level {level} at {u}: {measured} {expected}");
            }
        }
    }

    #[test]
    fn light_falls_into_the_open_and_not_into_corners() {
        let config = crate::sim::RoomConfig { boxes: 0, ..crate::sim::RoomConfig::vicon(&[]) };
        let scene = Scene::room(&config, &[], 1).unwrap();
        let lamps = lamps(&scene, 1);
        let floor = &scene.quads[0];
        let mut random = Random::new(1, "test");
        let mut at = |u: f64, v: f64| light_on(&scene, &(floor.point(u, v) + floor.normal * 1e-3), floor, &lamps, &mut random);
        let (corner, middle) = (at(0.02, 0.02), at(4.0, 4.0));
        assert!(middle > 1.2 * corner && corner > 0.05, "{middle} {corner}");
    }
}
