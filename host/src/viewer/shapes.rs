//! What stands in space and in the image, in the viewer's types.

use libella_core::camera::{Camera as _, CameraModel};
use libella_core::plane::PlaneClass;
use nalgebra::{Isometry3, Vector3};
use re_types::archetypes::{DepthImage, LineStrips2D, LineStrips3D, Mesh3D, Pinhole, Points2D, Points3D, Transform3D};
use re_types::components::Color;
use re_types::datatypes::{ChannelDatatype, Quaternion, Rgba32};

use crate::network::DepthMap;
use crate::pipeline::{Corner, PlaneInView, Trails, View};
use crate::planes::{color_of, light_color_of};

/// As in the report.
pub(super) const WAY: [u8; 3] = [0x6e, 0xa8, 0xff];
pub(super) const TRUTH: [u8; 3] = [0x98, 0xa0, 0xaa];
const KNOWN: [u8; 3] = [0xf5, 0xe6, 0x63];
const UNKNOWN: [u8; 3] = [0xff, 0xff, 0xff];
/// How much of what is behind a plane is hidden by it, of 255.
const PLANE_ALPHA: u8 = 96;
/// Distance from the centre of the camera at which its image is shown, m.
const FRUSTUM_M: f32 = 0.5;

pub(super) fn color([red, green, blue]: [u8; 3]) -> Color {
    Color::from_rgb(red, green, blue)
}

/// The viewer computes in single precision.
#[allow(clippy::cast_possible_truncation)]
pub(super) fn narrow<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|value| value as f32)
}

pub(super) fn position(point: &Vector3<f64>) -> [f32; 3] {
    narrow([point.x, point.y, point.z])
}

/// The pose of the camera.
pub(super) fn pose(world_from_camera: &Isometry3<f64>) -> Transform3D {
    let q = world_from_camera.rotation.quaternion();
    Transform3D::from_translation(position(&world_from_camera.translation.vector))
        .with_quaternion(Quaternion::from_xyzw(narrow([q.i, q.j, q.k, q.w])))
}

/// The camera without its distortion, of an image every `step` raw pixels from `origin` on.
pub(super) fn pinhole(camera: &CameraModel<f64>, size_px: [usize; 2], step: [f64; 2], origin: [f64; 2]) -> Pinhole {
    let (focal, center) = match camera {
        CameraModel::PinholeRadTan(camera) => (camera.focal_px, camera.center_px),
        CameraModel::KannalaBrandt(camera) => (camera.focal_px, camera.center_px),
    };
    // The viewer's pixels begin at their corner, ours at their centre.
    let [fx, fy, cx, cy] =
        narrow([focal[0] / step[0], focal[1] / step[1], (center[0] - origin[0]) / step[0] + 0.5, (center[1] - origin[1]) / step[1] + 0.5]);
    let resolution = narrow(size_px.map(|side| side as f64));
    Pinhole::new([[fx, 0.0, 0.0], [0.0, fy, 0.0], [cx, cy, 1.0]])
        .with_resolution(resolution)
        .with_image_plane_distance(FRUSTUM_M)
        .with_color(color(WAY))
}

/// The pinhole of whole images.
pub(super) fn pinhole_of_images(camera: &CameraModel<f64>) -> Pinhole {
    let (width, height) = camera.size_px();
    pinhole(camera, [width as usize, height as usize], [1.0; 2], [0.0; 2])
}

/// The colour of a corner: that of its plane, or whether its depth is known.
fn color_of_corner(corner: &Corner) -> Color {
    color(match (corner.plane, corner.depth_m) {
        (Some(class), _) => light_color_of(class),
        (None, Some(_)) => KNOWN,
        (None, None) => UNKNOWN,
    })
}

/// A raw pixel in the viewer's coordinates, which begin at the corner of the first pixel.
fn pixel(raw: &[f64; 2]) -> [f32; 2] {
    narrow(raw.map(|value| value + 0.5))
}

/// Where the corners are.
pub(super) fn corners(view: &View) -> Points2D {
    let (places, colors): (Vec<_>, Vec<_>) = view.corners.iter().map(|corner| (pixel(&corner.pixel), color_of_corner(corner))).unzip();
    Points2D::new(places).with_colors(colors).with_radii([2.5])
}

/// Where they have been.
pub(super) fn tracks(view: &View, trails: &Trails) -> LineStrips2D {
    let followed = view.corners.iter().filter_map(|corner| {
        let trail: Vec<_> = trails.of(corner.track).iter().map(pixel).collect();
        (trail.len() > 1).then(|| (trail, color_of_corner(corner)))
    });
    let (strips, colors): (Vec<_>, Vec<_>) = followed.unzip();
    LineStrips2D::new(strips).with_colors(colors).with_radii([0.6])
}

/// The outlines of planes in the image.
pub(super) fn outlines(planes: &[PlaneInView]) -> LineStrips2D {
    let (strips, colors): (Vec<_>, Vec<_>) = planes
        .iter()
        .filter(|plane| !plane.outline_px.is_empty())
        .map(|plane| {
            let closed = plane.outline_px.iter().chain(plane.outline_px.first());
            (closed.map(pixel).collect::<Vec<_>>(), color(light_color_of(plane.class)))
        })
        .unzip();
    LineStrips2D::new(strips).with_colors(colors).with_radii([1.2])
}

/// The landmarks that the image sees.
pub(super) fn landmarks(view: &View) -> Points3D {
    let known = view.corners.iter().filter_map(|corner| Some((position(&corner.point_in_world?), color_of_corner(corner))));
    let (points, colors): (Vec<_>, Vec<_>) = known.unzip();
    Points3D::new(points).with_colors(colors).with_radii([0.015])
}

/// Points of the map and the planes that they lie on.
pub(super) fn map(points: impl Iterator<Item = (Vector3<f64>, Option<PlaneClass>)>) -> Points3D {
    let (points, colors): (Vec<_>, Vec<_>) = points.map(|(point, class)| (position(&point), color(class.map_or(TRUTH, color_of)))).unzip();
    Points3D::new(points).with_colors(colors).with_radii([0.01])
}

/// A plane as a surface that is seen from both sides, and its edge.
pub(super) fn surface(class: PlaneClass, polygon_in_world: &[Vector3<f64>]) -> Option<(Mesh3D, LineStrips3D)> {
    let corners: Vec<[f32; 3]> = polygon_in_world.iter().map(position).collect();
    let count = u32::try_from(corners.len()).ok().filter(|count| *count > 2)?;
    // A convex polygon is a fan.
    let triangles = (1..count - 1).flat_map(|second| [[0, second, second + 1], [0, second + 1, second]]);
    let [red, green, blue] = light_color_of(class);
    let mesh = Mesh3D::new(corners.clone()).with_triangle_indices(triangles).with_albedo_factor(Rgba32::from_unmultiplied_rgba(
        red,
        green,
        blue,
        PLANE_ALPHA,
    ));
    let closed: Vec<[f32; 3]> = corners.iter().chain(corners.first()).copied().collect();
    Some((mesh, LineStrips3D::new([closed]).with_colors([color(light_color_of(class))]).with_radii([0.01])))
}

/// A way.
pub(super) fn way(points: impl IntoIterator<Item = Vector3<f64>>, ink: [u8; 3]) -> LineStrips3D {
    let points: Vec<[f32; 3]> = points.into_iter().map(|point| position(&point)).collect();
    LineStrips3D::new([points]).with_colors([color(ink)]).with_radii([0.008])
}

/// A map of depths, m, and the pinhole of its pixels; zero where nothing is known.
pub(super) fn depth(camera: &CameraModel<f64>, map: &DepthMap) -> Option<(Pinhole, DepthImage)> {
    let size = [u32::try_from(map.width).ok()?, u32::try_from(map.height).ok()?];
    let depth = |index: usize| map.inverse_depth_1_m.get(index).filter(|inverse| map.is_known(index) && **inverse > 0.0);
    let bytes: Vec<u8> =
        (0..map.width * map.height).flat_map(|index| depth(index).map_or(0.0, |inverse| inverse.recip()).to_le_bytes()).collect();
    let image = DepthImage::from_data_type_and_bytes(bytes, size, ChannelDatatype::F32).with_meter(1.0);
    Some((pinhole(camera, [map.width, map.height], map.step_px, map.origin_px), image))
}
