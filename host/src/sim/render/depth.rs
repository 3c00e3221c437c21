//! What lies behind every pixel, exactly.

use nalgebra::{Isometry3, Vector3};

use super::face::{Face, nearest};
use super::world::Moment;
use super::{Renderer, TILE};

/// What lies behind every pixel centre.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Depth along the optical axis, m; 0 where there is nothing.
    pub depth_m: Vec<f64>,
    /// Number of the rectangle, those that move after those of the scene; `u16::MAX` where there is none.
    pub quad: Vec<u16>,
    /// Normals of the rectangles in world, by number.
    normals: Vec<Vector3<f32>>,
}

impl DepthMap {
    /// The normal of the surface behind every pixel, in world; zero where there is nothing.
    #[must_use]
    pub fn normals_in_world(&self) -> Vec<Vector3<f32>> {
        self.quad.iter().map(|quad| self.normals.get(usize::from(*quad)).copied().unwrap_or_default()).collect()
    }
}

impl Renderer<'_> {
    /// Exact depths and rectangles of the pixel centres from a pose of the camera at a time of the flight, s. Where nothing moves,
    /// the time does not matter.
    #[must_use]
    pub fn depth(&self, world_from_camera: &Isometry3<f64>, seconds: f64) -> DepthMap {
        let moment = Moment { seconds, world_from_camera: *world_from_camera };
        let faces = self.world.faces(std::slice::from_ref(&moment));
        let columns = self.width.div_ceil(TILE);
        // Which face is decided in f32; how far it is, in f64.
        let planes: Vec<Vector3<f64>> = self
            .world
            .rectangles(&moment)
            .map(|(quad, camera_from_frame)| {
                let corner = camera_from_frame.transform_point(&quad.corner.into()).coords;
                let normal = camera_from_frame.rotation * quad.normal;
                normal / normal.dot(&corner)
            })
            .collect();
        let mut cells = vec![(0.0_f64, u16::MAX); self.width * self.height];
        let all: Vec<usize> = (0..faces.first().map_or(0, Vec::len)).collect();
        self.in_bands(&mut cells, |band, rows| {
            for column in 0..columns {
                let candidates = self.candidates(&faces, &all, &self.tiles[band * columns + column]);
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
        DepthMap { width: self.width, height: self.height, depth_m, quad, normals: self.world.normals(seconds) }
    }
}
