#![allow(clippy::unwrap_used)]

use super::*;
use crate::calibration::Rig;
use crate::network::ModelCard;
use libella_core::camera::{KannalaBrandt, PinholeRadTan};
use std::path::Path;

const INPUT: [usize; 2] = [320, 192];
const OUTPUT: [usize; 2] = [80, 48];

fn model() -> ModelCamera {
    ModelCard::parse(include_str!("../../../models/indoor.toml"), Path::new("indoor.toml")).unwrap().input
}

/// Unlike EuRoC's left camera: its right one, a longer lens of another shape, a wide one, a fisheye, a large image.
fn others() -> Vec<(&'static str, CameraModel<f64>)> {
    let pinhole = |size, focal, center, distortion| CameraModel::from(PinholeRadTan::new(size, focal, center, distortion).unwrap());
    vec![
        ("right", pinhole((752, 480), [457.587, 456.134], [379.999, 255.238], [-0.28368365, 0.07451284, -0.00010473, -3.5559e-5])),
        ("long", pinhole((640, 480), [615.0, 615.0], [321.0, 239.0], [0.0; 4])),
        ("wide", pinhole((640, 400), [300.0, 300.0], [318.0, 203.0], [0.0; 4])),
        ("fisheye", KannalaBrandt::new((848, 800), [285.0, 286.0], [424.0, 399.0], [-0.007, 0.04, -0.04, 0.006]).unwrap().into()),
        ("large", pinhole((960, 540), [550.0, 550.0], [477.5, 270.5], [-0.1, 0.02, 0.0, 0.0])),
    ]
}

fn ray(camera: &CameraModel<f64>, pixel: [f64; 2]) -> Option<[f64; 2]> {
    let bearing = camera.unproject(&Vector2::from(pixel)).filter(|bearing| bearing.z > 0.1)?;
    Some([bearing.x / bearing.z, bearing.y / bearing.z])
}

#[test]
fn only_the_models_own_camera_is_the_same() {
    let new = |camera: &CameraModel<f64>| Resampling::new(camera, &model(), INPUT, OUTPUT).unwrap();
    let own = new(&Rig::euroc().camera);
    assert!(own.is_same_camera());
    assert_eq!((own.step_px, own.zoom()), ([9.4, 10.0], 1.0));
    assert!(new(&model().camera(INPUT)).is_same_camera() && new(&model().camera([1504, 960])).is_same_camera());
    for (name, camera) in others() {
        assert!(!new(&camera).is_same_camera(), "{name}");
    }
    // 0.25 pixels of the input are 0.59 of the image's width: a centre that is 0.5 off is near enough, 1 is not.
    for (shift, same) in [(0.5, true), (1.0, false)] {
        let CameraModel::PinholeRadTan(mut camera) = Rig::euroc().camera else { unreachable!() };
        camera.center_px[0] += shift;
        assert_eq!(new(&camera.into()).is_same_camera(), same);
    }
}

/// The image is a pattern of the ray alone, with a period of 80 pixels of the input: whatever camera takes it, the model's camera
/// must see the same pattern where its own rays put it, to a small part of a pixel.
#[test]
fn the_image_comes_to_the_ray_it_belongs_to() {
    let model = model();
    let own = model.camera(INPUT);
    let rate = std::f64::consts::TAU / 80.0 * own.focal_px();
    for (name, camera) in others() {
        let resampling = Resampling::new(&camera, &model, INPUT, OUTPUT).unwrap();
        let zoom = resampling.zoom();
        let pattern = |[x, y]: [f64; 2]| 127.5 + 60.0 * (rate * zoom * x).sin() + 60.0 * (rate * zoom * y).sin();
        let (width, height) = camera.size_px();
        let pixels: Vec<u8> = (0..height)
            .flat_map(|y| (0..width).map(move |x| [f64::from(x), f64::from(y)]))
            .map(|pixel| ray(&camera, pixel).map_or(0, |ray| pattern(ray).round() as u8))
            .collect();
        let image = ImageView::new(&pixels, width as usize, height as usize, width as usize).unwrap();
        let seen = resampling.to_model(&image).unwrap();
        let mut checked = 0;
        for (index, value) in seen.iter().enumerate() {
            let [x, y] = [(index % INPUT[0]) as f64, (index / INPUT[0]) as f64];
            // The whole pixel and its neighbours lie within the image.
            let around = [[-1.5, -1.5], [1.5, -1.5], [-1.5, 1.5], [1.5, 1.5]].map(|d| {
                let at = ray(&own, [x + d[0], y + d[1]]).map(|ray| Vector3::new(ray[0] / zoom, ray[1] / zoom, 1.0));
                at.and_then(|point| camera.project(&point))
                    .is_some_and(|raw| raw.x > 0.0 && raw.y > 0.0 && raw.x < f64::from(width) - 1.0 && raw.y < f64::from(height) - 1.0)
            });
            let Some(at) = ray(&own, [x, y]).filter(|_| around.iter().all(|inside| *inside)) else { continue };
            let off = f64::from(*value) * 255.0 - pattern(at.map(|value| value / zoom));
            // The steepest slope along x near the axis is 60 · 2π/80 = 4.7 levels per pixel; bilinear samples of the
            // fisheye flatten the crests by up to 0.3 of a level.
            assert!(off.abs() < 0.2 * 4.7, "{name}: {off} levels off at {x} {y}, zoom {zoom}");
            checked += 1;
        }
        assert!(checked as f64 > 0.8 * (INPUT[0] * INPUT[1]) as f64 || name == "right", "{name}: only {checked}");
        assert!(checked > 40_000, "{name}: only {checked}");
    }
}

/// The inverse depth of a plane is linear in the ray. What a perfect network would say of it must come back, at raw pixels, as the
/// plane: in the right place and, through a longer lens, in the right metres.
#[test]
fn depth_comes_back_to_the_pixel_it_belongs_to() {
    let model = model();
    let own = model.camera(INPUT);
    let plane = |[x, y]: [f64; 2]| 0.8 + 0.35 * x + 0.2 * y;
    for (name, camera) in others().into_iter().chain([("left", Rig::euroc().camera)]) {
        let resampling = Resampling::new(&camera, &model, INPUT, OUTPUT).unwrap();
        let zoom = resampling.zoom();
        assert!((zoom > 1.2) == (name == "long"), "{name}: zoom {zoom}");
        let said: Vec<f32> = (0..OUTPUT[0] * OUTPUT[1])
            .map(|index| {
                let at = [4.0 * (index % OUTPUT[0]) as f64 + 1.5, 4.0 * (index / OUTPUT[0]) as f64 + 1.5];
                // Depths look 1/zoom as large to the network.
                (zoom * plane(ray(&own, at).unwrap().map(|value| value / zoom))) as f32
            })
            .collect();
        let sigma: Vec<f32> = (0..said.len()).map(|index| 0.1 + 0.001 * (index % OUTPUT[0]) as f32).collect();
        let map = resampling.to_raw(&said, &sigma, &sigma, DepthKind::Metric);
        let (width, height) = camera.size_px();
        let (mut known, mut tried) = (0, 0);
        for y in (0..height).step_by(7) {
            for x in (0..width).step_by(7) {
                let raw = [f64::from(x), f64::from(y)];
                let at = ray(&camera, raw).and_then(|ray| own.project(&Vector3::new(zoom * ray[0], zoom * ray[1], 1.0)));
                // Away from the rims, where the outermost values are repeated.
                let inside = at.is_some_and(|p| p.x > 10.0 && p.y > 10.0 && p.x < INPUT[0] as f64 - 11.0 && p.y < INPUT[1] as f64 - 11.0);
                let margin = map.step_px.map(|step| 0.5 * step);
                let rim = raw[0] < margin[0]
                    || raw[1] < margin[1]
                    || raw[0] > f64::from(width) - 1.0 - margin[0]
                    || raw[1] > f64::from(height) - 1.0 - margin[1];
                if !inside || rim {
                    continue;
                }
                tried += 1;
                let Some(sample) = map.sample(raw) else { continue };
                known += 1;
                let off = f64::from(sample.inverse_depth_1_m) - plane(ray(&camera, raw).unwrap());
                // One pixel of the input along x changes the plane by 0.35/195 near the axis.
                let pixels = off.abs() / (0.35 / (own.focal_px() * zoom));
                assert!(pixels < 0.25, "{name}: {pixels} pixels of the input off at {raw:?}");
                let column = (at.unwrap().x + 0.5) / 4.0 - 0.5;
                assert!((f64::from(sample.sigma_log) - 0.1 - 0.001 * column).abs() < 2e-4, "{name}");
            }
        }
        assert!(known > 1000 && known * 100 > tried * 95, "{name}: {known} of {tried}");
    }
}

#[test]
fn nothing_is_known_where_the_model_cannot_look() {
    let (name, fisheye) = others().remove(3);
    let resampling = Resampling::new(&fisheye, &model(), INPUT, OUTPUT).unwrap();
    let ones = vec![1.0; OUTPUT[0] * OUTPUT[1]];
    let map = resampling.to_raw(&ones, &ones, &ones, DepthKind::Metric);
    assert!(map.sample([10.0, 10.0]).is_none() && map.sample([424.0, 400.0]).is_some(), "{name}");
    // An unknown value of the model is unknown around it, and nowhere else.
    for nothing in [0.0, f32::NAN] {
        let mut hole = ones.clone();
        hole[24 * OUTPUT[0] + 40] = nothing;
        let holed = resampling.to_raw(&hole, &ones, &ones, DepthKind::Metric);
        let lost = (map.known_share() - holed.known_share()) * (map.width * map.height) as f64;
        assert!((1.0..=16.0).contains(&lost.round()), "{lost}");
    }
}

#[test]
fn cameras_and_images_that_do_not_fit_are_refused() {
    let CameraModel::PinholeRadTan(mut camera) = Rig::euroc().camera else { unreachable!() };
    let resampling = Resampling::new(&camera.into(), &model(), INPUT, OUTPUT).unwrap();
    let pixels = vec![0; 640 * 480];
    let error = resampling.to_model(&ImageView::new(&pixels, 640, 480, 640).unwrap()).unwrap_err();
    assert_eq!(error.to_string(), "the image has 640x480 pixels and the camera 752x480");
    camera.center_px = [1e5, 1e5];
    let fault = Resampling::new(&camera.into(), &model(), INPUT, OUTPUT).unwrap_err().to_string();
    assert!(fault.contains("sees nothing"), "{fault}");
    camera.focal_px = [f64::NAN; 2];
    assert!(Resampling::new(&camera.into(), &model(), INPUT, OUTPUT).unwrap_err().to_string().contains("cannot be used"));
}
