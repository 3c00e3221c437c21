//! Boxes in any pose: do they touch, how far is a point.

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use super::Quad;

/// A box in world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::sim) struct Block {
    /// Its middle, m.
    pub center: Vector3<f64>,
    /// Its axes as columns.
    pub rotation: Rotation3<f64>,
    /// Half its sides, m.
    pub half: Vector3<f64>,
}

impl Block {
    /// A rectangle as a box without thickness.
    pub fn of(quad: &Quad) -> Self {
        let [u, v] = quad.size_m;
        let axes = Matrix3::from_columns(&[quad.axis_u, quad.axis_v, quad.normal]);
        Self {
            center: quad.point(0.5 * u, 0.5 * v),
            rotation: Rotation3::from_matrix_unchecked(axes),
            half: Vector3::new(0.5 * u, 0.5 * v, 0.0),
        }
    }

    /// Distance of a point, m; 0 within.
    pub fn distance_m(&self, point: &Vector3<f64>) -> f64 {
        let local = self.rotation.inverse_transform_vector(&(point - self.center));
        (local.abs() - self.half).sup(&Vector3::zeros()).norm()
    }

    /// Whether two boxes share a point: they do unless one of the 15 axes (normals, and products of edges) tells them apart.
    pub fn touches(&self, other: &Self) -> bool {
        let way = other.center - self.center;
        let axes = |block: &Self| [0, 1, 2].map(|k| block.rotation.matrix().column(k).into_owned());
        let (own, others) = (axes(self), axes(other));
        let edges = own.iter().flat_map(|a| others.iter().map(move |b| a.cross(b)));
        !own.iter().chain(&others).copied().chain(edges).any(|axis| {
            let reach = |block: &Self, axes: &[Vector3<f64>; 3]| (0..3).map(|k| block.half[k] * axes[k].dot(&axis).abs()).sum::<f64>();
            // Parallel edges have no product; the normals tell enough then.
            axis.norm_squared() > 1e-12 && way.dot(&axis).abs() > reach(self, &own) + reach(other, &others)
        })
    }

    /// The eight corners, m.
    pub fn corners(&self) -> impl Iterator<Item = Point3<f64>> {
        (0..8).map(|k| {
            let sign = |bit: usize| if k >> bit & 1 == 0 { -1.0 } else { 1.0 };
            let local = Vector3::new(sign(0), sign(1), sign(2)).component_mul(&self.half);
            Point3::from(self.center + self.rotation * local)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::random::Random;

    fn draw(random: &mut Random) -> Block {
        let mut between = |low, high| random.between(low, high);
        Block {
            center: Vector3::new(between(-1.0, 1.0), between(-1.0, 1.0), between(-1.0, 1.0)),
            rotation: Rotation3::from_euler_angles(between(-3.0, 3.0), between(-3.0, 3.0), between(-3.0, 3.0)),
            half: Vector3::new(between(0.05, 0.6), between(0.05, 0.6), between(0.0, 0.6)),
        }
    }

    /// The least distance between two boxes by walking from one to the other and back: projections onto convex sets converge.
    fn gap_m(one: &Block, two: &Block) -> f64 {
        let nearest = |block: &Block, point: &Vector3<f64>| {
            let local = block.rotation.inverse_transform_vector(&(point - block.center));
            block.center + block.rotation * local.sup(&-block.half).inf(&block.half)
        };
        let mut point = two.center;
        for _ in 0..4000 {
            point = nearest(two, &nearest(one, &point));
        }
        one.distance_m(&point)
    }

    #[test]
    fn boxes_touch_where_the_distance_between_them_is_zero() {
        let mut random = Random::new(3, "blocks");
        let (mut touching, mut apart) = (0, 0);
        for _ in 0..600 {
            let (one, two) = (draw(&mut random), draw(&mut random));
            let gap = gap_m(&one, &two);
            assert_eq!(one.touches(&two), two.touches(&one));
            if gap > 2e-3 {
                assert!(!one.touches(&two), "{gap} m apart");
                apart += 1;
            } else if gap < 1e-6 {
                assert!(one.touches(&two), "{gap} m apart");
                touching += 1;
            }
        }
        assert!(touching > 80 && apart > 80, "{touching} {apart}");
    }

    #[test]
    fn distances_to_a_box_without_rotation() {
        let block = Block { center: Vector3::new(1.0, 0.0, 0.0), rotation: Rotation3::identity(), half: Vector3::new(0.5, 1.0, 2.0) };
        assert!(block.distance_m(&Vector3::new(1.2, 0.5, -1.0)).abs() < 1e-15);
        assert!((block.distance_m(&Vector3::new(1.0 + 0.5 + 0.3, 1.4, 0.0)) - 0.5).abs() < 1e-15);
        assert!(block.corners().all(|corner| block.distance_m(&(corner.coords * 1.0)) < 1e-12));
    }
}
