//! Finds a way for every mover: clear of walls, furniture, the other movers and the path of the camera.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::block::Block;
use super::mover::{Mover, Swing};
use super::{Material, RoomConfig, Scene};
use crate::sim::SimError;
use crate::sim::random::Random;

/// Places tried for one mover. It shrinks from one to the next.
const TRIES: u32 = 600;
/// Most movers in a room.
pub const MOST_MOVERS: usize = 20;

impl Scene {
    /// Carts, swinging boards and turntables in turn, drawn from a stream of their own: the room is the same without them.
    ///
    /// # Errors
    /// More than 20, or more than there is room for.
    pub fn movers(&self, config: &RoomConfig, path: &[Vector3<f64>], count: usize, seed: u64) -> Result<Vec<Mover>, SimError> {
        SimError::check("dynamic", count as f64, 0.0, MOST_MOVERS as f64)?;
        let mut random = Random::new(seed, "movers");
        let mut taken: Vec<Block> = self.quads.iter().map(Block::of).collect();
        let half_room = config.size_m * 0.5;
        let middle = config.floor_center_m + Vector3::z() * half_room.z;
        let mut movers = Vec::new();
        for wanted in 0..count {
            let found = (0..TRIES).find_map(|attempt| {
                let mover = draw(config, &mut random, wanted, 1.0 - 0.7 * f64::from(attempt) / f64::from(TRIES));
                let swept = mover.swept();
                let is_inside = swept.corners().all(|corner| ((corner.coords - middle).abs() - half_room).max() < 0.0);
                let is_free = is_inside
                    && path.iter().all(|point| swept.distance_m(point) > config.clearance_m)
                    && !taken.iter().any(|block| block.touches(&swept));
                is_free.then_some((mover, swept))
            });
            let Some((mover, swept)) = found else { return Err(SimError::Crowded { placed: movers.len(), wanted: count }) };
            taken.push(swept);
            movers.push(mover);
        }
        Ok(movers)
    }
}

/// The `index`-th mover somewhere in the room; `share` of the usual size.
fn draw(config: &RoomConfig, random: &mut Random, index: usize, share: f64) -> Mover {
    // A hall holds larger things.
    let scale = share * (config.size_m.x.min(config.size_m.y) / 8.0).clamp(0.5, 3.0);
    let along_wall = std::f64::consts::FRAC_PI_2 * random.below(4) as f64;
    let heading = if random.unit() < 0.6 { along_wall } else { random.between(-3.1, 3.1) };
    let spot = Vector3::new(random.between(-0.5, 0.5) * config.size_m.x, random.between(-0.5, 0.5) * config.size_m.y, 0.0);
    let phase_rad = random.between(0.0, std::f64::consts::TAU);
    let materials = [Material::Cardboard, Material::Poster, Material::Wood, Material::Metal, Material::Checkerboard, Material::Pallet];
    let material = materials[index % materials.len()];
    let (half, height, swing, rate) = match index % 3 {
        0 => {
            let half = Vector3::new(random.between(0.2, 0.4), random.between(0.15, 0.3), random.between(0.2, 0.5)) * scale;
            let reach_m = random.between(0.5, 1.2) * scale;
            // It rolls over what lies flat on the floor, at the speed of a walker at most.
            (half, half.z + 0.03, Swing::Cart { reach_m }, random.between(0.3, 0.9) / reach_m)
        }
        1 => {
            let half = Vector3::new(0.008, random.between(0.2, 0.35) * scale, random.between(0.2, 0.35) * scale);
            let cord_m = random.between(0.1, 0.3) * scale;
            let height = config.size_m.z - 0.02;
            (half, height, Swing::Board { reach_rad: random.between(0.15, 0.35), cord_m }, (9.81 / (cord_m + half.z)).sqrt())
        }
        _ => {
            let half = Vector3::new(random.between(0.15, 0.3), random.between(0.15, 0.3), random.between(0.2, 0.6)) * scale;
            (half, half.z + 0.03, Swing::Turntable, random.between(0.4, 1.2) * if random.unit() < 0.5 { -1.0 } else { 1.0 })
        }
    };
    let pivot = config.floor_center_m + spot + Vector3::z() * height;
    let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * heading);
    Mover::new(half, material, Isometry3::from_parts(Translation3::from(pivot), turn), swing, rate, phase_rad)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn movers_keep_clear_of_everything_at_all_times() {
        let path: Vec<_> =
            (0..50).map(|k| Vector3::new((f64::from(k) * 0.2).sin() * 2.0, (f64::from(k) * 0.13).cos() * 2.0, 1.2)).collect();
        for seed in 0..5 {
            let config = RoomConfig::vicon(&path);
            let scene = Scene::room(&config, &path, seed).unwrap();
            let movers = scene.movers(&config, &path, 9, seed).unwrap();
            assert_eq!(movers.len(), 9);
            assert_eq!(movers, scene.movers(&config, &path, 9, seed).unwrap());
            let furniture: Vec<Block> = scene.quads.iter().map(Block::of).collect();
            for seconds in (0..40).map(|k| f64::from(k) * 0.21) {
                let blocks: Vec<Block> = movers
                    .iter()
                    .map(|mover| {
                        let pose = mover.world_from_mover(seconds);
                        let middle = mover.sides.iter().map(|side| Block::of(side).center).sum::<Vector3<f64>>() / 6.0;
                        Block {
                            center: pose.transform_point(&middle.into()).coords,
                            rotation: pose.rotation.to_rotation_matrix(),
                            half: mover.half_m,
                        }
                    })
                    .collect();
                for (index, block) in blocks.iter().enumerate() {
                    assert!(!furniture.iter().any(|other| other.touches(block)), "seed {seed}: mover {index} at {seconds} s");
                    assert!(!blocks[..index].iter().any(|other| other.touches(block)));
                    assert!(path.iter().all(|point| block.distance_m(point) > config.clearance_m));
                }
            }
        }
    }

    #[test]
    fn refuses_more_movers_than_allowed_and_more_than_fit() {
        let config = RoomConfig { size_m: Vector3::new(3.0, 3.0, 2.0), ..RoomConfig::vicon(&[]) };
        let scene = Scene::room(&config, &[], 1).unwrap();
        let message = scene.movers(&config, &[], 21, 1).unwrap_err().to_string();
        assert!(message.contains("dynamic = 21") && message.contains("0 to 20"), "{message}");
        let everywhere: Vec<_> = (0..1000)
            .map(|k| Vector3::new(f64::from(k % 10) * 0.3 - 1.35, f64::from(k / 10 % 10) * 0.3 - 1.35, f64::from(k / 100) * 0.2))
            .collect();
        let error = scene.movers(&config, &everywhere, 3, 1).unwrap_err();
        assert_eq!(error, SimError::Crowded { placed: 0, wanted: 3 });
    }
}
