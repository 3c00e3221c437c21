//! `libella depth`

use std::path::{Path, PathBuf};

use libella_core::camera::CameraModel;
use libella_core::time::Timestamp;
use libella_host::calibration::read_camera;
use libella_host::dataset::GrayImage;
use libella_host::fault::{Fault, FaultKind};
use libella_host::network::{DepthKind, DepthMap, DepthNetwork as _, ModelChoice, draw_depth};

use super::{Exit, say};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// A PNG or JPEG image as the camera gives it, not rectified.
    image: PathBuf,
    /// indoor (part of this program), euroc (for non-commercial use; looked for in $LIBELLA_MODELS), an ONNX file with its .toml, or
    /// recorded:FOLDER for the stored map of an image that is named by its stamp.
    #[arg(long, default_value = "indoor")]
    model: ModelChoice,
    /// The camera's sensor.yaml. If not given: that of the recording which the image lies in, otherwise EuRoC's left camera.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// The picture; if not given, `<name of the image>.depth.png` in the working directory.
    #[arg(long, value_name = "FILE.png")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Exit, Fault> {
    let image = read(&arguments.image)?;
    let (camera, origin) = camera(arguments, &image)?;
    let network = arguments.model.open(&camera, None)?;
    let mut network =
        network.ok_or_else(|| Fault::new(FaultKind::Configuration, "--model none gives no depth", "give indoor, euroc or an ONNX file"))?;
    let view = image.view().map_err(|error| Fault::malformed(&arguments.image, error.to_string(), "copy it again"))?;
    let begun = std::time::Instant::now();
    let map = network
        .predict(stamp(&arguments.image), &view)
        .map_err(|error| Fault::malformed(&arguments.image, error.to_string(), "give another --calibration or --model"))?;
    let ms = begun.elapsed().as_secs_f64() * 1e3;
    let name = arguments.image.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let out = arguments.out.clone().unwrap_or_else(|| Path::new(&name).with_extension("depth.png"));
    if same_file(&out, &arguments.image) {
        return Err(Fault::new(FaultKind::Configuration, "--out is the image itself", "give another file").at(&out));
    }
    draw_depth(&out, &image, &map, &name, &format!("{}   camera: {origin}", network.describe()))?;
    say(&format!(
        "picture         {}\nnetwork         {}, {ms:.0} ms\ncamera          {origin}\n{}",
        out.display(),
        network.describe(),
        figures(&map)
    ));
    Ok(Exit::Done)
}

/// Images of a recording are named by their stamps.
fn stamp(image: &Path) -> Timestamp {
    let name = image.file_stem().and_then(|stem| stem.to_str()?.parse().ok());
    Timestamp::from_nanos(name.unwrap_or(0))
}

/// Colours become grey, as in a run.
fn read(path: &Path) -> Result<GrayImage, Fault> {
    let remedy = "give a PNG or JPEG image";
    let bytes = std::fs::read(path).map_err(|error| Fault::missing(path, format!("image cannot be read ({error})"), remedy))?;
    let image = image::load_from_memory(&bytes)
        .map_err(|error| Fault::malformed(path, format!("image cannot be decoded ({})", error.to_string().replace('\n', " ")), remedy))?
        .into_luma8();
    Ok(GrayImage { width: image.width() as usize, height: image.height() as usize, pixels: image.into_raw() })
}

/// The camera that took the image, and where its numbers come from.
fn camera(arguments: &Arguments, image: &GrayImage) -> Result<(CameraModel<f64>, String), Fault> {
    let beside = || {
        let folder = std::path::absolute(&arguments.image).ok()?.parent()?.to_path_buf();
        [folder.join("../sensor.yaml"), folder.join("sensor.yaml")].into_iter().find(|path| path.is_file())
    };
    let Some(path) = arguments.calibration.clone().or_else(beside) else {
        // EuRoC's camera at the size of this image: what the shipped networks take it for.
        let CameraModel::PinholeRadTan(mut camera) = libella_host::calibration::Rig::euroc().camera else {
            return Err(Fault::new(FaultKind::Configuration, "no calibration", "give one with --calibration"));
        };
        let size = [image.width, image.height].map(|side| u32::try_from(side).unwrap_or(u32::MAX));
        let scale = [f64::from(size[0]) / f64::from(camera.size_px.0), f64::from(size[1]) / f64::from(camera.size_px.1)];
        camera.size_px = (size[0], size[1]);
        for ((focal, center), scale) in camera.focal_px.iter_mut().zip(&mut camera.center_px).zip(scale) {
            *focal *= scale;
            *center = (*center + 0.5) * scale - 0.5;
        }
        return Ok((camera.into(), "unknown, taken for EuRoC's".into()));
    };
    let camera = read_camera(&path)?.camera;
    let origin = path.canonicalize().unwrap_or(path);
    Ok((camera, origin.display().to_string()))
}

fn figures(map: &DepthMap) -> String {
    let mut depths: Vec<f32> = (0..map.inverse_depth_1_m.len())
        .filter(|index| map.is_known(*index))
        .filter_map(|index| map.inverse_depth_1_m.get(index))
        .map(|value| value.recip())
        .collect();
    let mut sigmas: Vec<f32> = map.sigma_log.iter().copied().filter(|sigma| sigma.is_finite()).collect();
    depths.sort_by(f32::total_cmp);
    sigmas.sort_by(f32::total_cmp);
    let at = |values: &[f32], percent: usize| values.get(values.len() * percent / 100).copied().unwrap_or(f32::NAN);
    let known = 100.0 * map.known_share();
    let depth = match map.kind {
        DepthKind::Metric => format!("{:.2} m (5 to 95 %: {:.2} to {:.2} m)", at(&depths, 50), at(&depths, 5), at(&depths, 95)),
        DepthKind::UpToScale => {
            format!("{:.2} (5 to 95 %: {:.2} to {:.2}) in a unit that is not known", at(&depths, 50), at(&depths, 5), at(&depths, 95))
        }
        DepthKind::Affine => "up to scale and shift".into(),
    };
    format!("median depth    {depth}, known in {known:.0} % of the image\nmedian sigma    {:.0} % of the depth\n", 100.0 * at(&sigmas, 50))
}

fn same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

#[cfg(all(test, feature = "network"))]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn arguments(image: &Path, out: &Path, model: &str, calibration: Option<&Path>) -> Arguments {
        let [image, out] = [image, out].map(Path::to_path_buf);
        Arguments { image, model: model.parse().unwrap(), calibration: calibration.map(Path::to_path_buf), out: Some(out) }
    }

    #[test]
    fn a_picture_is_drawn_or_one_sentence_said() {
        let folder = tempfile::tempdir().unwrap();
        let [image, out, yaml, text] = ["a.png", "b.png", "sensor.yaml", "c.png"].map(|name| folder.path().join(name));
        image::GrayImage::from_fn(376, 240, |x, y| image::Luma([(x / 2 + y / 4) as u8])).save(&image).unwrap();
        std::fs::write(&text, "no image").unwrap();
        assert!(matches!(run(&arguments(&image, &out, "indoor", None)), Ok(Exit::Done)));
        assert!(image::open(&out).unwrap().width() > 1500);
        let camera = "T_BS: {data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}\nresolution: [752, 480]\nintrinsics: [458, 457, 367, 248]\n\
                      distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n";
        let said = |arguments: &Arguments| run(arguments).err().unwrap().to_string();
        assert!(said(&arguments(&image, &image, "indoor", None)).contains("is the image itself"));
        assert!(said(&arguments(&image, &out, "none", None)).contains("--model none"));
        assert!(said(&arguments(&image, &out, "absent.onnx", None)).contains("there is no such file"));
        assert!(said(&arguments(&text, &out, "indoor", None)).contains("cannot be decoded"));
        assert!(said(&arguments(&folder.path().join("absent.png"), &out, "indoor", None)).contains("cannot be read"));
        // A calibration beside the image is taken; it is one of another size here.
        std::fs::write(&yaml, camera).unwrap();
        assert!(said(&arguments(&image, &out, "indoor", None)).contains("the image has 376x240 pixels and the camera 752x480"));
        std::fs::write(&yaml, camera.replace("752, 480", "376, 240").replace("458, 457, 367, 248", "229, 228.5, 183.5, 124")).unwrap();
        assert!(matches!(run(&arguments(&image, &out, "indoor", None)), Ok(Exit::Done)));
    }
}
