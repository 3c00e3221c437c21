//! What rectangles are covered with: seeded, procedural reflectance.
//!
//! Everything is built from three things: value noise on a hashed lattice, spots (at most one per cell, inside of it), and flat
//! shapes drawn one over the other. Reflectance lies between 0 and 1; coordinates are metres on the rectangle.

use super::random::{Random, mix};
use super::scene::{Material, Quad};

/// Noise of a hashed lattice in `[-1, 1]`, one lattice point per unit.
#[derive(Debug, Clone, Copy)]
struct Noise {
    seed: u32,
}

impl Noise {
    #[inline]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, clippy::cast_precision_loss)]
    fn hash(self, x: i32, y: i32) -> u32 {
        let mut hash = (x as u32).wrapping_mul(0x8DA6_B343) ^ (y as u32).wrapping_mul(0xD816_3841) ^ self.seed;
        hash = (hash ^ (hash >> 15)).wrapping_mul(0x2C1B_3C6D);
        hash = (hash ^ (hash >> 12)).wrapping_mul(0x297A_2D39);
        hash ^ (hash >> 15)
    }

    /// Uniform in `[0, 1)` for a lattice cell.
    #[inline]
    #[allow(clippy::cast_precision_loss)]
    fn cell(self, x: i32, y: i32) -> f32 {
        (self.hash(x, y) >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// Interpolated with zero slope at the lattice points.
    #[inline]
    fn at(self, x: f32, y: f32) -> f32 {
        let ((column, fx), (row, fy)) = (split(x), split(y));
        let (sx, sy) = (fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy));
        let mix = |a: f32, b: f32, s: f32| a + (b - a) * s;
        let below = mix(self.cell(column, row), self.cell(column + 1, row), sx);
        let above = mix(self.cell(column, row + 1), self.cell(column + 1, row + 1), sx);
        2.0 * mix(below, above, sy) - 1.0
    }

    /// Octaves of half the size and 0.6 of the strength each, about unit range.
    #[inline]
    fn fractal(self, x: f32, y: f32, octaves: u32) -> f32 {
        let (mut sum, mut strength, mut scale) = (0.0, 0.5, 1.0);
        for octave in 0..octaves {
            sum += strength * Self { seed: self.seed.wrapping_add(octave.wrapping_mul(0x9E37_79B9)) }.at(x * scale, y * scale);
            strength *= 0.6;
            scale *= 2.03;
        }
        sum
    }

    /// Depth inside the spot of this cell from 0 (outside) to 1 (a fifth of the radius inside), and a random tone of the spot.
    #[inline]
    fn spot(self, x: f32, y: f32, share: f32) -> (f32, f32) {
        let ((column, fx), (row, fy)) = (split(x), split(y));
        if self.cell(column, row) > share {
            return (0.0, 0.0);
        }
        let other = |k: u32| Self { seed: self.seed.wrapping_add(k) }.cell(column, row);
        let radius = 0.1 + 0.35 * other(1) * other(1);
        let (cx, cy) = (radius + (1.0 - 2.0 * radius) * other(2), radius + (1.0 - 2.0 * radius) * other(3));
        // Oval and turned: corners, not only discs.
        let (dx, dy) = ((fx - cx).abs(), (fy - cy).abs());
        let distance = if other(4) < 0.5 { dx.max(dy * 1.7) } else { (dx * dx + dy * dy * 1.5).sqrt() };
        (((radius - distance) / (0.2 * radius)).clamp(0.0, 1.0), other(5))
    }
}

#[inline]
#[allow(clippy::cast_possible_truncation, clippy::cast_precision_loss)]
fn split(x: f32) -> (i32, f32) {
    // The cast truncates towards zero; a call of `floor` costs more than the rest.
    let cut = x as i32;
    let whole = if (cut as f32) > x { cut - 1 } else { cut };
    (whole, x - whole as f32)
}

/// Where `x` lies in a period, and which period it is.
#[inline]
fn repeat(x: f32, period: f32) -> (i32, f32) {
    let (index, part) = split(x / period);
    (index, part * period)
}

/// A line as a texel of width `texel` (m) sees it: 1 within `half_width` of zero, falling to 0 over a texel.
#[derive(Debug, Clone, Copy)]
struct Pen {
    texel: f32,
}

impl Pen {
    #[inline]
    fn line(self, distance: f32, half_width: f32) -> f32 {
        ((half_width - distance.abs()) / self.texel + 0.5).clamp(0.0, 1.0)
    }
}

#[inline]
fn blend(under: f32, over: f32, cover: f32) -> f32 {
    under + (over - under) * cover
}

/// A flat shape of a printed picture.
#[derive(Debug, Clone, Copy)]
enum Shape {
    Disc { center: [f32; 2], radius: f32, inner: f32 },
    Bar { center: [f32; 2], half: [f32; 2], turn: [f32; 2] },
    Road { from: [f32; 2], to: [f32; 2], width: f32 },
    Text { corner: [f32; 2], size: [f32; 2], row: f32 },
}

impl Shape {
    /// How much the shape covers a point, and the change of its tone there.
    fn cover(&self, u: f32, v: f32, noise: Noise, pen: Pen) -> (f32, f32) {
        match *self {
            Self::Disc { center, radius, inner } => {
                let distance = (u - center[0]).hypot(v - center[1]);
                (pen.line(distance - 0.5 * (radius + inner), 0.5 * (radius - inner)), 0.0)
            }
            Self::Bar { center, half, turn } => {
                let (x, y) = (u - center[0], v - center[1]);
                (pen.line(x * turn[0] + y * turn[1], half[0]) * pen.line(y * turn[0] - x * turn[1], half[1]), 0.0)
            }
            Self::Road { from, to, width } => {
                let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
                let length = dx.hypot(dy).max(1e-6);
                let along = ((u - from[0]) * dx + (v - from[1]) * dy) / length;
                let across = ((u - from[0]) * dy - (v - from[1]) * dx) / length;
                let bend = across + 0.25 * length * (along / length * 5.0).sin() * 0.3;
                let dash = pen.line(bend, 0.06 * width) * pen.line(repeat(along, 1.2 * width).1 - 0.6 * width, 0.3 * width);
                (pen.line(along - 0.5 * length, 0.5 * length) * pen.line(bend, 0.5 * width), 0.6 * dash)
            }
            Self::Text { corner, size, row } => {
                let (x, y) = (u - corner[0], v - corner[1]);
                if x < 0.0 || y < 0.0 || x > size[0] || y > size[1] {
                    return (0.0, 0.0);
                }
                let ((line_index, in_row), (letter, in_letter)) = (repeat(y, row), repeat(x, 0.7 * row));
                // A letter is 3 x 4 cells that are inked or not; every fifth place or so is a gap.
                let (cell_u, cell_v) = (split(in_letter / (0.18 * row)), split(in_row / (0.17 * row)));
                let inked = noise.cell(letter * 7 + cell_u.0, line_index * 11 + cell_v.0) < 0.55;
                let gap = noise.cell(letter, line_index + 1000) < 0.2;
                let shown = inked && !gap && cell_u.0 < 3 && cell_v.0 < 4;
                (if shown { 1.0 } else { 0.0 }, 0.0)
            }
        }
    }
}

/// The cover of one rectangle.
#[derive(Debug, Clone)]
pub(super) struct Paint {
    material: Material,
    noise: Noise,
    pen: Pen,
    size_m: [f32; 2],
    tone: f32,
    shapes: Vec<(Shape, f32)>,
}

/// Inner squares of a checkerboard along its sides: seven by five, and half a square of white around.
pub(super) const CHECKERBOARD_SQUARES: [usize; 2] = [7, 5];

impl Paint {
    /// The cover of a rectangle as texels of a width (m) see it; `label` tells rectangles apart.
    #[allow(clippy::cast_possible_truncation)]
    pub(super) fn new(quad: &Quad, seed: u64, label: u64, texel_m: f32) -> Self {
        let seed = mix(seed ^ mix(label.wrapping_add(77)));
        let mut random = Random::new(seed, "paint");
        let size_m = quad.size_m.map(|side| side as f32);
        let shapes = match quad.material {
            Material::PlayMat => picture(&mut random, size_m, 46),
            Material::Poster => picture(&mut random, size_m, 16),
            Material::Cardboard => label_of(&mut random, size_m),
            _ => Vec::new(),
        };
        Self {
            material: quad.material,
            noise: Noise { seed: random.bits() as u32 },
            pen: Pen { texel: texel_m },
            size_m,
            tone: random.between(-1.0, 1.0) as f32,
            shapes,
        }
    }

    /// Reflectance at a place, 0 to 1.
    pub(super) fn albedo(&self, u: f32, v: f32) -> f32 {
        let n = self.noise;
        let other = Noise { seed: n.seed ^ 0x5555_1234 };
        let value = match self.material {
            Material::Plaster => {
                let (mark, tone) = other.spot(u * 3.1, v * 3.1, 0.06);
                let (dent, _) = n.spot(u * 17.0, v * 17.0, 0.008);
                let base = 0.8 + 0.05 * n.fractal(u * 0.9, v * 0.9, 3) + 0.02 * n.at(u * 60.0, v * 60.0);
                blend(blend(base, 0.45 + 0.25 * tone, 0.35 * mark), 0.25, dent * 0.8)
            }
            Material::Floor => {
                let (stain, tone) = other.spot(u * 2.3, v * 2.3, 0.15);
                let (chip, chip_tone) = n.spot(u * 13.0, v * 13.0, 0.015);
                let joint = self.pen.line(repeat(u, 2.0).1 - 1.0, 0.004).max(self.pen.line(repeat(v, 2.0).1 - 1.0, 0.004));
                let base = 0.27 + 0.07 * n.fractal(u * 1.3, v * 1.3, 4) + 0.018 * n.fractal(u * 70.0, v * 70.0, 2);
                let base = blend(base, 0.18 + 0.3 * tone, 0.3 * stain);
                blend(blend(base, if chip_tone > 0.6 { 0.7 } else { 0.1 }, chip * 0.8), 0.1, 0.7 * joint)
            }
            Material::Ceiling => {
                let ((_, x), (_, y)) = (repeat(u, 0.6), repeat(v, 0.6));
                let rail = self.pen.line(x - 0.3, 0.012).max(self.pen.line(y - 0.3, 0.012));
                let (hole, _) = n.spot(u * 25.0, v * 25.0, 0.25);
                blend(0.62 + 0.04 * n.at(u * 2.0, v * 2.0) - 0.2 * hole, 0.4, rail)
            }
            Material::Blocks => {
                let (row, y) = repeat(v, 0.22);
                let shift = if row % 2 == 0 { 0.0 } else { 0.22 };
                let (column, x) = repeat(u + shift, 0.44);
                let mortar = self
                    .pen
                    .line(x, 0.007)
                    .max(self.pen.line(x - 0.44, 0.007))
                    .max(self.pen.line(y, 0.007))
                    .max(self.pen.line(y - 0.22, 0.007));
                let (hole, _) = other.spot(u * 21.0, v * 21.0, 0.08);
                let base = 0.5 + 0.12 * (n.cell(column, row) - 0.5) + 0.06 * n.fractal(u * 12.0, v * 12.0, 4);
                blend(base - 0.15 * hole, 0.33, 0.4 * mortar)
            }
            Material::Curtain => {
                let warp = 0.35 * n.at(u * 1.5, v * 0.4) + 0.1 * n.at(u * 5.0, v * 0.8);
                let fold = (u * 38.0 + 6.0 * warp).sin() * 0.5 + (u * 15.0 + 9.0 * warp).sin() * 0.5;
                0.55 + 0.2 * fold + 0.03 * n.at(u * 200.0, v * 200.0)
            }
            Material::Wood => self.plank(u, v, 0.14, 0.004),
            Material::Pallet => self.plank(u, v, 0.145, 0.022),
            Material::Mat => {
                let border = u.min(v).min(self.size_m[0] - u).min(self.size_m[1] - v);
                let seam = self.pen.line(border - 0.03, 0.004).max(self.pen.line(v - 0.5 * self.size_m[1], 0.006));
                let warp = n.fractal(u * 2.0, v * 2.0, 2);
                // Wrinkles run across, thicker in some places.
                let wrinkle = (v * 42.0 + 5.0 * warp + 2.0 * n.at(u * 3.0, v * 9.0)).sin();
                let strength = (0.5 + other.fractal(u * 1.2, v * 1.8, 2)).clamp(0.0, 1.0);
                let base = 0.21 + 0.03 * self.tone + 0.07 * wrinkle.powi(3) * strength + 0.03 * n.fractal(u * 90.0, v * 90.0, 2);
                let (mark, tone) = other.spot(u * 5.0, v * 5.0, 0.06);
                blend(blend(base, 0.08, 0.7 * seam), 0.5 * tone, 0.6 * mark)
            }
            Material::PlayMat | Material::Poster => {
                let base = 0.6 + 0.15 * self.tone + 0.08 * n.fractal(u * 4.0, v * 4.0, 3);
                let edge = u.min(v).min(self.size_m[0] - u).min(self.size_m[1] - v);
                blend(self.draw(u, v, base), 0.8, self.pen.line(edge, 0.018))
            }
            Material::Cardboard => {
                let base = 0.42 + 0.05 * self.tone + 0.05 * n.fractal(u * 7.0, v * 30.0, 3);
                let tape = self.pen.line(u - 0.5 * self.size_m[0], 0.026);
                self.draw(u, v, blend(base, 0.62, 0.6 * tape))
            }
            Material::Metal => {
                let ((_, x), (_, y)) = (repeat(u, 0.31), repeat(v, 0.43));
                let rivet = ((0.012 - (x - 0.03).hypot(y - 0.03)) / 0.002).clamp(0.0, 1.0);
                let joint = self.pen.line(x, 0.003).max(self.pen.line(y, 0.003));
                let scratch = (n.at(u * 7.0 + v * 11.0, v * 160.0 - u * 90.0) - 0.75).max(0.0);
                let (dirt, tone) = other.spot(u * 4.0, v * 4.0, 0.25);
                let base = 0.4 + 0.12 * self.tone + 0.05 * n.fractal(u * 3.0, v * 3.0, 4) + 1.5 * scratch;
                blend(blend(blend(base, 0.8 * tone, 0.35 * dirt), 0.12, joint), 0.75, rivet)
            }
            Material::Tape => {
                // Black strip with torn white patches, as marks for motion capture.
                let (patch, tone) = n.spot(u * 17.0, v * 17.0, 0.75);
                blend(0.06, 0.55 + 0.4 * tone, if patch > 0.3 { 1.0 } else { 0.0 })
            }
            Material::Window => {
                let frame = u.min(v).min(self.size_m[0] - u).min(self.size_m[1] - v);
                let bar = self
                    .pen
                    .line(u - 0.5 * self.size_m[0], 0.03)
                    .max(self.pen.line(v - 0.6 * self.size_m[1], 0.025))
                    .max(self.pen.line(frame, 0.05));
                blend(0.9 + 0.1 * n.fractal(u * 2.0, v * 2.0, 3), 0.12, bar)
            }
            Material::Radiator => {
                let (_, x) = repeat(u, 0.055);
                let rib = (x / 0.055 * std::f32::consts::PI).sin();
                let rail = self.pen.line(v - 0.06, 0.012).max(self.pen.line(v - self.size_m[1] + 0.06, 0.012));
                blend(0.12 + 0.62 * rib * rib, 0.7, rail)
            }
            Material::Checkerboard => self.checker(u, v),
        };
        value.clamp(0.02, 0.98)
    }

    /// Planks along u with grain, knots, nails and gaps.
    fn plank(&self, u: f32, v: f32, pitch_m: f32, gap_m: f32) -> f32 {
        let n = self.noise;
        let (plank, y) = repeat(v, pitch_m);
        let offset = 17.3 * n.cell(plank, 5);
        let (knot, _) = Noise { seed: n.seed ^ 99 }.spot(u * 2.4 + offset, y / pitch_m, 0.25);
        let grain = n.fractal(u * 2.5 + offset, v * 55.0 + 2.0 * n.at(u * 3.0, v * 8.0), 4);
        let board = 0.48 + 0.1 * self.tone + 0.22 * (n.cell(plank, 1) - 0.5) + 0.16 * grain - 0.25 * knot;
        let nail = ((0.006 - (repeat(u, 0.6).1 - 0.05).hypot(y - 0.5 * pitch_m)) / 0.002).clamp(0.0, 1.0);
        // Boards end somewhere, each elsewhere.
        let butt = self.pen.line(repeat(u + offset, 1.9).1 - 0.95, 0.003);
        let gap = self.pen.line(y, 0.5 * gap_m).max(self.pen.line(y - pitch_m, 0.5 * gap_m));
        blend(blend(board, 0.1, nail.max(0.8 * butt)), 0.05, gap)
    }

    fn draw(&self, u: f32, v: f32, base: f32) -> f32 {
        self.shapes.iter().fold(base, |under, (shape, tone)| {
            let (cover, change) = shape.cover(u, v, self.noise, self.pen);
            if cover > 0.0 { blend(under, tone + change, cover) } else { under }
        })
    }

    fn checker(&self, u: f32, v: f32) -> f32 {
        let [columns, rows] = CHECKERBOARD_SQUARES.map(|count| f32::from(u8::try_from(count).unwrap_or(1)));
        // Half a square of white on every side.
        let x = u / self.size_m[0] * (columns + 1.0) - 0.5;
        let y = v / self.size_m[1] * (rows + 1.0) - 0.5;
        if x < 0.0 || y < 0.0 || x >= columns || y >= rows {
            return 0.85;
        }
        if (split(x).0 + split(y).0) % 2 == 0 { 0.06 } else { 0.85 }
    }
}

/// Shapes of a printed picture: roads and large areas first, small things over them, lettering last.
#[allow(clippy::cast_possible_truncation)]
fn picture(random: &mut Random, [width, height]: [f32; 2], count: usize) -> Vec<(Shape, f32)> {
    let small = width.min(height);
    let mut between = |low: f32, high: f32| random.between(f64::from(low), f64::from(high)) as f32;
    let mut shapes = Vec::new();
    for k in 0..count {
        let center = [between(0.0, width), between(0.0, height)];
        let size = small * if k < count / 4 { between(0.12, 0.3) } else { between(0.015, 0.08) };
        // Tones keep away from the mean of the ground, so that shapes stand out.
        let tone = if between(0.0, 1.0) < 0.5 { between(0.1, 0.4) } else { between(0.7, 0.95) };
        let angle = between(0.0, std::f32::consts::TAU);
        let shape = match (k * 7 + 3) % 5 {
            0 => Shape::Disc { center, radius: size, inner: 0.0 },
            1 => Shape::Disc { center, radius: size, inner: 0.6 * size },
            2 if k < count / 2 => Shape::Road { from: center, to: [between(0.0, width), between(0.0, height)], width: 0.11 * small },
            _ => Shape::Bar { center, half: [size, size * between(0.3, 1.0)], turn: [angle.cos(), angle.sin()] },
        };
        shapes.push((shape, tone));
    }
    let row = 0.055 * small;
    shapes.push((Shape::Text { corner: [0.1 * width, 0.08 * height], size: [0.7 * width, 3.0 * row], row }, 0.08));
    shapes
}

/// A printed label and a mark on a box.
#[allow(clippy::cast_possible_truncation)]
fn label_of(random: &mut Random, [width, height]: [f32; 2]) -> Vec<(Shape, f32)> {
    let mut between = |low: f32, high: f32| random.between(f64::from(low), f64::from(high)) as f32;
    let corner = [between(0.05, 0.4) * width, between(0.1, 0.5) * height];
    let size = [0.35 * width, 0.3 * height];
    let center = [corner[0] + 0.5 * size[0], corner[1] + 0.5 * size[1]];
    let stamp = [between(0.6, 0.85) * width, between(0.2, 0.8) * height];
    vec![
        (Shape::Bar { center, half: [0.55 * size[0], 0.55 * size[1]], turn: [1.0, 0.0] }, 0.85),
        (Shape::Text { corner, size, row: 0.25 * size[1] }, 0.1),
        (Shape::Disc { center: stamp, radius: 0.12 * width.min(height), inner: 0.08 * width.min(height) }, 0.12),
        (Shape::Bar { center: stamp, half: [0.03 * width, 0.05 * height], turn: [0.8, 0.6] }, 0.15),
    ]
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn paint(material: Material, seed: u64) -> Paint {
        Paint::new(&Quad::new(Vector3::zeros(), Vector3::x() * 1.6, Vector3::y() * 1.2, material), seed, 0, 0.002)
    }

    #[test]
    fn reflectance_is_physical_and_each_material_has_its_contrast() {
        for material in Material::ALL {
            let paint = paint(material, 5);
            let values: Vec<f32> = (0..10_000_i16).map(|k| paint.albedo(f32::from(k % 100) * 0.016, f32::from(k / 100) * 0.012)).collect();
            assert!(values.iter().all(|value| (0.02..=0.98).contains(value)), "{material:?}");
            let mean = values.iter().sum::<f32>() / 1e4;
            let sigma = (values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / 1e4).sqrt();
            // Plaster is poor in texture, a printed picture is not.
            match material {
                Material::Plaster => assert!((0.01..0.12).contains(&sigma), "{material:?} {sigma}"),
                Material::PlayMat | Material::Checkerboard => assert!(sigma > 0.15, "{material:?} {sigma}"),
                _ => assert!(sigma > 0.02, "{material:?} {sigma}"),
            }
        }
    }

    #[test]
    fn seeds_change_the_cover() {
        for material in Material::ALL.into_iter().filter(|material| !matches!(material, Material::Checkerboard | Material::Radiator)) {
            let (one, two) = (paint(material, 1), paint(material, 2));
            assert!((0..1000_i16).any(|k| {
                let (u, v) = (f32::from(k) * 0.0013, f32::from(k % 37) * 0.03);
                (one.albedo(u, v) - two.albedo(u, v)).abs() > 1e-3
            }));
        }
    }
}
