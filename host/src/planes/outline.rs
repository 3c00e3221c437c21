//! Where a polygon in space lies in an image, in raw, distorted pixels.
//!
//! # Model
//! ```text
//! world ─▶ camera ─ z ≥ 2 cm ─▶ (x/z, y/z) ─ rectangle around the undistorted image ─▶ distorted pixels ─ image ─▶ outline
//! ```
//! Straight edges are bent by the lens: they are halved until a chord is off by less than [`BENT_PX`].
//!
//! # Degeneracy
//! What lies 85° and more off the axis, sideways or up and down, is left out. Points outside of the image where the lens model does not
//! hold are drawn towards the axis until it does, which keeps them outside.

use libella_core::camera::Camera;
use nalgebra::{Isometry3, Vector2, Vector3};

/// Nearer to the plane of the camera's centre nothing is drawn, m.
const NEAR_M: f64 = 0.02;
/// The tangent of 85 degrees.
const WIDEST: f64 = 11.4;
/// Points of a side of the image that are looked at to find what the image holds.
const BORDER_POINTS: u32 = 16;
/// How far an outline may be from the bent edge, px.
const BENT_PX: f64 = 0.5;
/// Halvings of an edge: some are made whatever they find, since an S crosses its chord in the middle.
const HALVINGS: std::ops::Range<u32> = 2..9;
/// An outline smaller than this is none, px².
const LEAST_AREA_PX2: f64 = 4.0;

/// The outline in an image of a convex polygon in world, m, or `None` where none of it is in the image.
#[must_use]
pub fn outline_in_image(
    polygon_in_world: &[Vector3<f64>],
    camera_from_world: &Isometry3<f64>,
    camera: &impl Camera<f64>,
) -> Option<Vec<[f64; 2]>> {
    let in_camera: Vec<Vector3<f64>> =
        polygon_in_world.iter().map(|corner| (camera_from_world * nalgebra::Point3::from(*corner)).coords).collect();
    let in_front = cut(&in_camera, |point| point.z - NEAR_M, |a, b, along| a.lerp(b, along));
    let mut flat: Vec<Vector2<f64>> = in_front.iter().map(|point| point.xy() / point.z).collect();
    let [low, high] = rectangle(camera);
    for axis in 0..2 {
        flat = cut(&flat, |point| point[axis] - low[axis], |a, b, along| a.lerp(b, along));
        flat = cut(&flat, |point| high[axis] - point[axis], |a, b, along| a.lerp(b, along));
    }
    let mut bent: Vec<Vector2<f64>> = Vec::new();
    for (from, to) in edges(&flat) {
        let (start, end) = (pixel(camera, from)?, pixel(camera, to)?);
        bent.push(start);
        bend(camera, (from, start), (to, end), 0, &mut bent);
    }
    let (width, height) = camera.size_px();
    for (axis, side) in [(0, width), (1, height)] {
        bent = cut(&bent, |point| point[axis] + 0.5, |a, b, along| a.lerp(b, along));
        bent = cut(&bent, |point| f64::from(side) - 0.5 - point[axis], |a, b, along| a.lerp(b, along));
    }
    let area = edges(&bent).map(|(a, b)| a.perp(b)).sum::<f64>().abs() / 2.0;
    (area >= LEAST_AREA_PX2).then(|| bent.iter().map(|point| [point.x, point.y]).collect())
}

/// The part of a polygon where `inside` is not negative (Sutherland and Hodgman, CACM 1974).
fn cut<P: Copy>(polygon: &[P], inside: impl Fn(&P) -> f64, between: impl Fn(&P, &P, f64) -> P) -> Vec<P> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (from, to) in edges(polygon) {
        let (here, there) = (inside(from), inside(to));
        if here >= 0.0 {
            kept.push(*from);
        }
        if (here < 0.0) != (there < 0.0) {
            kept.push(between(from, to, here / (here - there)));
        }
    }
    kept
}

/// Each corner with the next, around.
fn edges<P>(polygon: &[P]) -> impl Iterator<Item = (&P, &P)> {
    polygon.iter().zip(polygon.iter().cycle().skip(1))
}

/// The smallest and largest `(x/z, y/z)` of the image, a little widened.
fn rectangle(camera: &impl Camera<f64>) -> [Vector2<f64>; 2] {
    let (width, height) = camera.size_px();
    let (mut low, mut high) = (Vector2::zeros(), Vector2::zeros());
    for step in 0..=BORDER_POINTS {
        let along = f64::from(step) / f64::from(BORDER_POINTS);
        let (x, y) = (along * f64::from(width) - 0.5, along * f64::from(height) - 0.5);
        for border in [[x, -0.5], [x, f64::from(height) - 0.5], [-0.5, y], [f64::from(width) - 0.5, y]] {
            let bearing = camera.unproject(&Vector2::from(border)).filter(|bearing| bearing.z > 0.0);
            // Where there is no such point the image reaches further than can be drawn.
            let center = Vector2::new(f64::from(width), f64::from(height)) / 2.0;
            let flat = bearing
                .map_or_else(|| (Vector2::from(border) - center).map(|side| side.signum() * WIDEST), |bearing| bearing.xy() / bearing.z);
            let flat = flat.map(|value| (1.05 * value).clamp(-WIDEST, WIDEST));
            (low, high) = (low.inf(&flat), high.sup(&flat));
        }
    }
    [low, high]
}

/// The pixel of `(x/z, y/z)`.
fn pixel(camera: &impl Camera<f64>, flat: &Vector2<f64>) -> Option<Vector2<f64>> {
    let at = |share: f64| camera.project(&(flat * share).push(1.0));
    at(1.0).or_else(|| {
        let (mut holds, mut fails) = (0.0, 1.0);
        for _ in 0..30 {
            let middle = 0.5 * (holds + fails);
            if at(middle).is_some() {
                holds = middle;
            } else {
                fails = middle;
            }
        }
        at(holds)
    })
}

/// Adds the points between the ends of an edge, without these.
fn bend(
    camera: &impl Camera<f64>,
    (from, start): (&Vector2<f64>, Vector2<f64>),
    (to, end): (&Vector2<f64>, Vector2<f64>),
    halvings: u32,
    bent: &mut Vec<Vector2<f64>>,
) {
    let middle = from.lerp(to, 0.5);
    let Some(found) = pixel(camera, &middle) else { return };
    let off = (found - start.lerp(&end, 0.5)).norm();
    if halvings >= HALVINGS.end || (halvings >= HALVINGS.start && off < BENT_PX) {
        return;
    }
    bend(camera, (from, start), (&middle, found), halvings + 1, bent);
    bent.push(found);
    bend(camera, (&middle, found), (to, end), halvings + 1, bent);
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use libella_core::camera::{KannalaBrandt, PinholeRadTan};
    use nalgebra::Translation3;

    use super::*;

    fn euroc() -> PinholeRadTan<f64> {
        PinholeRadTan::new((752, 480), [458.654, 457.296], [367.215, 248.375], [-0.283, 0.0739, 0.0002, 1.8e-5]).unwrap()
    }

    fn fisheye() -> KannalaBrandt<f64> {
        KannalaBrandt::new((512, 512), [191.0, 191.0], [255.0, 257.0], [0.0034, 0.0007, -0.002, 0.0002]).unwrap()
    }

    /// Corners of a rectangle at a depth, m.
    fn board(center: [f64; 3], half: [f64; 2]) -> Vec<Vector3<f64>> {
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| Vector3::new(center[0] + x * half[0], center[1] + y * half[1], center[2]))
            .into()
    }

    fn contains(outline: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
        let crossings = edges(outline).filter(|(a, b)| (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
        crossings.count() % 2 == 1
    }

    fn edge_distance_px(outline: &[[f64; 2]], pixel: [f64; 2]) -> f64 {
        let pixel = Vector2::from(pixel);
        let distances = edges(outline).map(|(a, b)| {
            let (a, b) = (Vector2::from(*a), Vector2::from(*b));
            let along = ((pixel - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
            (pixel - a.lerp(&b, along)).norm()
        });
        distances.fold(f64::INFINITY, f64::min)
    }

    fn assert_agrees(camera: &impl Camera<f64>, polygon: &[Vector3<f64>], camera_from_world: &Isometry3<f64>) -> usize {
        let outline = outline_in_image(polygon, camera_from_world, camera).unwrap_or_default();
        let normal = (polygon[1] - polygon[0]).cross(&(polygon[2] - polygon[0]));
        let world_from_camera = camera_from_world.inverse();
        let (width, height) = camera.size_px();
        let (mut inside, mut wrong) = (0, 0);
        for y in (0..height).step_by(8) {
            for x in (0..width).step_by(8) {
                let pixel = [f64::from(x) + 0.3, f64::from(y) + 0.3];
                let Some(bearing) = camera.unproject(&Vector2::from(pixel)) else { continue };
                let (eye, ray) = (world_from_camera.translation.vector, world_from_camera.rotation * bearing);
                let along = normal.dot(&(polygon[0] - eye)) / normal.dot(&ray);
                let point = eye + ray * along;
                let is_in = along * bearing.z > NEAR_M
                    && bearing.xy().amax() < WIDEST * bearing.z
                    && edges(polygon).all(|(a, b)| (b - a).cross(&(point - a)).dot(&normal) >= 0.0);
                inside += usize::from(is_in);
                // A pixel within the tolerance of the edge, by which chord and arc may differ to either side, may fall on either side.
                wrong += usize::from(is_in != contains(&outline, pixel) && edge_distance_px(&outline, pixel) > 2.0 * BENT_PX);
            }
        }
        assert!(wrong == 0, "{wrong} of {inside} pixels on the wrong side");
        inside
    }

    #[test]
    fn the_outline_holds_the_pixels_whose_rays_meet_the_polygon() {
        let turned = Isometry3::new(Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.2, -0.4, 0.3));
        let floor: Vec<Vector3<f64>> = [[-3.0, -4.0], [3.0, -4.0], [3.0, 6.0], [-3.0, 6.0]].map(|[x, z]| Vector3::new(x, 1.2, z)).into();
        for pose in [Isometry3::identity(), turned] {
            // In the middle, over the rim, all around the image, partly behind the camera.
            for polygon in
                [board([0.2, 0.1, 2.0], [0.5, 0.3]), board([1.5, 0.6, 2.0], [0.9, 0.8]), board([0.0, 0.0, 2.0], [9.0, 9.0]), floor.clone()]
            {
                assert!(assert_agrees(&euroc(), &polygon, &pose) > 100);
                assert!(assert_agrees(&fisheye(), &polygon, &pose) > 50);
            }
        }
    }

    #[test]
    fn what_is_not_in_the_image_has_no_outline() {
        let ahead = board([0.0, 0.0, 2.0], [0.3, 0.3]);
        let of = |shift: [f64; 3]| outline_in_image(&ahead, &Translation3::from(shift).into(), &euroc());
        assert!(of([0.0; 3]).is_some());
        assert!(of([0.0, 0.0, -4.0]).is_none() && of([6.0, 0.0, 0.0]).is_none() && of([0.0, -5.0, 0.0]).is_none());
        assert!(outline_in_image(&ahead[..2], &Isometry3::identity(), &euroc()).is_none());
    }
}
