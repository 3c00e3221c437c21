//! Things that move through a room.
//!
//! # Model
//! A mover is a box, fixed in a frame `M` of its own, whose pose is a smooth function of time. With the angle `θ = ω t + φ` and a
//! pivot frame `P` (z up) that stays where it is:
//! ```text
//! cart       T_WM = T_WP · (I, a sin θ e_x)                rolls to and fro
//! board      T_WM = T_WP · (R_y(a sin θ), 0)               hangs below a horizontal axis, swings as a pendulum does
//! turntable  T_WM = T_WP · (R_z(θ), 0)                     turns on the spot
//! ```

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::block::Block;
use super::quad::{Hidden, box_sides};
use super::{Material, Quad};

/// How a mover moves about its pivot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Swing {
    /// Slides along the pivot's x by so many metres to either side.
    Cart {
        /// `a`, m.
        reach_m: f64,
    },
    /// Swings about the pivot's y by so many radians to either side.
    Board {
        /// `a`, rad.
        reach_rad: f64,
        /// From the axis to the upper edge, m.
        cord_m: f64,
    },
    /// Turns about the pivot's z.
    Turntable,
}

/// A box that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Mover {
    /// Its six sides, in its own frame.
    pub sides: Vec<Quad>,
    /// Half its size, m.
    pub half_m: Vector3<f64>,
    /// `T_WP`.
    pub world_from_pivot: Isometry3<f64>,
    /// How it moves.
    pub swing: Swing,
    /// `ω`, rad/s.
    pub rate_rad_s: f64,
    /// `φ`, rad.
    pub phase_rad: f64,
}

impl Mover {
    /// A box of half sizes (m) about its pivot; a board hangs below it.
    #[must_use]
    pub fn new(
        half_m: Vector3<f64>,
        material: Material,
        world_from_pivot: Isometry3<f64>,
        swing: Swing,
        rate_rad_s: f64,
        phase_rad: f64,
    ) -> Self {
        let mut mover = Self { sides: Vec::new(), half_m, world_from_pivot, swing, rate_rad_s, phase_rad };
        mover.sides = box_sides(mover.middle(), half_m, &Rotation3::identity(), material, Hidden::Nothing);
        mover
    }

    /// The middle of the box in its own frame, m.
    fn middle(&self) -> Vector3<f64> {
        match self.swing {
            Swing::Board { cord_m, .. } => Vector3::new(0.0, 0.0, -cord_m - self.half_m.z),
            Swing::Cart { .. } | Swing::Turntable => Vector3::zeros(),
        }
    }

    /// `T_WM` at a time of the flight, s.
    #[must_use]
    pub fn world_from_mover(&self, seconds: f64) -> Isometry3<f64> {
        let angle = self.rate_rad_s * seconds + self.phase_rad;
        self.world_from_pivot
            * match self.swing {
                Swing::Cart { reach_m } => Translation3::new(reach_m * angle.sin(), 0.0, 0.0).into(),
                Swing::Board { reach_rad, .. } => turn(Vector3::y(), reach_rad * angle.sin()),
                Swing::Turntable => turn(Vector3::z(), angle),
            }
    }

    /// A box that holds it at all times.
    pub(super) fn swept(&self) -> Block {
        let half = self.half_m;
        let (low, high) = match self.swing {
            Swing::Cart { reach_m } => {
                let half = half + Vector3::x() * reach_m;
                (-half, half)
            }
            Swing::Board { reach_rad, cord_m } => {
                let (sine, cosine) = reach_rad.sin_cos();
                let length = cord_m + 2.0 * half.z;
                let aside = length * sine + half.x;
                (Vector3::new(-aside, -half.y, -length.hypot(half.x)), Vector3::new(aside, half.y, half.x * sine - cord_m * cosine))
            }
            Swing::Turntable => {
                let radius = half.x.hypot(half.y);
                (Vector3::new(-radius, -radius, -half.z), Vector3::new(radius, radius, half.z))
            }
        };
        let pivot = &self.world_from_pivot;
        Block {
            center: pivot.transform_point(&((low + high) * 0.5).into()).coords,
            rotation: pivot.rotation.to_rotation_matrix(),
            half: (high - low) * 0.5,
        }
    }
}

fn turn(axis: Vector3<f64>, angle_rad: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_scaled_axis(axis * angle_rad))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn movers() -> [Mover; 3] {
        let half = Vector3::new(0.1, 0.3, 0.4);
        let pivot = Isometry3::new(Vector3::new(1.0, -2.0, 1.5), Vector3::z() * 0.7);
        [Swing::Cart { reach_m: 0.8 }, Swing::Board { reach_rad: 0.4, cord_m: 0.2 }, Swing::Turntable]
            .map(|swing| Mover::new(half, Material::Wood, pivot, swing, 1.3, 0.4))
    }

    #[test]
    fn a_mover_stays_within_what_it_sweeps_and_reaches_its_sides() {
        for mover in movers() {
            let swept = mover.swept();
            let (mut out, mut reach) = (0.0_f64, Vector3::<f64>::zeros());
            for k in 0..500 {
                let pose = mover.world_from_mover(f64::from(k) * 0.01);
                for corner in mover.sides.iter().flat_map(Quad::polygon) {
                    let point = pose.transform_point(&corner.into()).coords;
                    out = out.max(swept.distance_m(&point));
                    reach = reach.sup(&swept.rotation.inverse_transform_vector(&(point - swept.center)).abs());
                }
            }
            assert!(out < 1e-9, "{:?} {out}", mover.swing);
            // Not more than a fifth of it is never reached.
            assert!((0..3).all(|k| reach[k] > 0.8 * swept.half[k]), "{:?} {reach} {}", mover.swing, swept.half);
        }
    }

    #[test]
    fn a_cart_and_a_board_are_where_the_formulas_say() {
        let [cart, board, turntable] = movers();
        let pivot = cart.world_from_pivot;
        let angle: f64 = 1.3 * 2.0 + 0.4;
        let moved = cart.world_from_mover(2.0).translation.vector - pivot.translation.vector;
        let along = Vector3::new(0.7_f64.cos(), 0.7_f64.sin(), 0.0);
        assert!((moved - along * (0.8 * angle.sin())).norm() < 1e-12);
        // The middle of the board hangs 0.6 m below its axis.
        let middle = board.world_from_mover(2.0).transform_point(&nalgebra::Point3::new(0.0, 0.0, -0.6)).coords - pivot.translation.vector;
        let swing = 0.4 * angle.sin();
        assert!((middle + (along * swing.sin() + Vector3::z() * swing.cos()) * 0.6).norm() < 1e-12, "{middle}");
        assert!((turntable.world_from_mover(2.0).rotation.angle_to(&pivot.rotation) - angle).abs() < 1e-12);
    }
}
