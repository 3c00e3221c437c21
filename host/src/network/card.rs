//! `model.toml`: what an ONNX file takes and gives.
//!
//! ```toml
//! sigma_per_u = 0.837                # standard deviation of the log depth over u; without [uncertainty]: sigma_log instead
//!
//! [input]
//! name = "image"                     # 1 x 1 x height x width, f32, grey 0 to 1
//! normalised_intrinsics = [0.609912, 0.952700, 0.488983, 0.518490]  # fx/width, fy/height, (cx + 1/2)/width, (cy + 1/2)/height
//! distortion = [-0.283, 0.074, 0.0002, 0.00002]
//! distortion_model = "radial-tangential"      # the default; or "equidistant"
//!
//! [depth]
//! name = "inverse_depth"             # 1 x 1 x rows x columns, f32, spread evenly over the input
//! kind = "inverse"                   # 1/m; "depth": m; "relative": inverse depth up to scale and shift
//! metric = true                      # the default; false: up to a factor of each image
//!
//! [uncertainty]                      # may be left out
//! name = "uncertainty"               # of the depth's shape, u in (0, 1)
//! ```

use std::path::Path;

use libella_core::camera::{CameraModel, KannalaBrandt, PinholeRadTan};
use serde::Deserialize;

use super::DepthKind;
use crate::fault::{Fault, read_text};

/// What an ONNX file takes and gives.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelCard {
    /// Name of the ONNX file in the same folder; if not given, that of the card with `.onnx`.
    pub file: Option<String>,
    /// Standard deviation of the log depth over u.
    pub sigma_per_u: Option<f64>,
    /// Standard deviation of the log depth of a model without uncertainty.
    pub sigma_log: Option<f64>,
    /// The image.
    pub input: ModelCamera,
    /// The depth.
    pub depth: DepthOutput,
    /// The uncertainty, if it has one.
    pub uncertainty: Option<UncertaintyOutput>,
}

/// The input of a model and the camera that its depths hold for.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelCamera {
    /// Name of the input.
    pub name: String,
    /// `fx/width, fy/height, (cx + ½)/width, (cy + ½)/height`: edges of the image at 0 and 1.
    pub normalised_intrinsics: [f64; 4],
    /// Four coefficients; zeros for none.
    #[serde(default)]
    pub distortion: [f64; 4],
    /// What the coefficients are those of.
    #[serde(default)]
    pub distortion_model: DistortionModel,
}

/// Distortions of [`CameraModel`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DistortionModel {
    /// `k1 k2 p1 p2`.
    #[default]
    RadialTangential,
    /// Equidistant fisheye, `k1 k2 k3 k4`.
    Equidistant,
}

/// The depth that a model gives.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthOutput {
    /// Name of the output.
    pub name: String,
    /// What its numbers are.
    pub kind: OutputKind,
    /// Whether they are in metres; otherwise they hold up to a factor that differs by image.
    #[serde(default = "yes")]
    pub metric: bool,
}

/// What the numbers of a depth output are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutputKind {
    /// Inverse depth along the optical axis.
    Inverse,
    /// Depth along the optical axis.
    Depth,
    /// Inverse depth up to scale and shift.
    Relative,
}

/// The uncertainty that a model gives.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UncertaintyOutput {
    /// Name of the output.
    pub name: String,
}

fn yes() -> bool {
    true
}

impl ModelCard {
    /// Reads a card.
    ///
    /// # Errors
    /// When it is absent or damaged, or its numbers describe no model.
    pub fn read(path: &Path) -> Result<Self, Fault> {
        Self::parse(
            &read_text(path, "every ONNX file needs a .toml of the same name beside it: compare it with host/models/indoor.toml")?,
            path,
        )
    }

    /// Reads a card from text; `path` is what messages name.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, Fault> {
        let card: Self = toml::from_str(text).map_err(|error| {
            let fault = Fault::malformed(
                path,
                format!("is no description of a network ({})", error.message().replace('\n', " ")),
                "compare it with host/models/indoor.toml",
            );
            match error.span() {
                Some(span) => fault.line(1 + text.bytes().take(span.start).filter(|byte| *byte == b'\n').count() as u64),
                None => fault,
            }
        })?;
        card.check(path)?;
        Ok(card)
    }

    fn check(&self, path: &Path) -> Result<(), Fault> {
        let wrong = |what: String, remedy: &str| Err(Fault::malformed(path, what, remedy));
        if let Some(file) = &self.file
            && (Path::new(file).file_name().is_none_or(|name| name != file.as_str()) || file.contains(['/', '\\']))
        {
            return wrong(
                format!("file = \"{file}\" leads out of the folder of this file"),
                "give the bare name of an ONNX file beside it",
            );
        }
        let (needed, value, other) = match self.uncertainty {
            Some(_) => ("sigma_per_u", self.sigma_per_u, self.sigma_log),
            None => ("sigma_log", self.sigma_log, self.sigma_per_u),
        };
        match value {
            Some(value) if value.is_finite() && value > 0.0 && value <= 100.0 => {}
            Some(value) => return wrong(format!("{needed} = {value} is not between 0 and 100"), "fit it with training/evaluate.py"),
            None => return wrong(format!("has no `{needed}`"), "with [uncertainty] give sigma_per_u, without it sigma_log"),
        }
        if other.is_some() {
            return wrong("has both sigma_per_u and sigma_log".into(), "with [uncertainty] give sigma_per_u, without it sigma_log");
        }
        let [fx, fy, cx, cy] = self.input.normalised_intrinsics;
        let plausible =
            [fx, fy].iter().all(|focal| (0.05..=50.0).contains(focal)) && [cx, cy].iter().all(|center| (-1.0..=2.0).contains(center));
        if !plausible || self.input.camera([1000, 1000]).validate().is_err() {
            let what =
                format!("normalised_intrinsics [{fx}, {fy}, {cx}, {cy}] with distortion {:?} are no camera's", self.input.distortion);
            return wrong(what, "divide focal lengths and centre by width and height of the image");
        }
        Ok(())
    }

    /// What the numbers of the map will mean.
    #[must_use]
    pub fn map_kind(&self) -> DepthKind {
        match (self.depth.kind, self.depth.metric) {
            (OutputKind::Relative, _) => DepthKind::Affine,
            (_, true) => DepthKind::Metric,
            (_, false) => DepthKind::UpToScale,
        }
    }
}

impl ModelCamera {
    /// The camera of images of some width and height.
    #[must_use]
    #[allow(clippy::cast_precision_loss)]
    pub fn camera(&self, [width, height]: [usize; 2]) -> CameraModel<f64> {
        let [fx, fy, cx, cy] = self.normalised_intrinsics;
        let (w, h) = (width as f64, height as f64);
        let size_px = (u32::try_from(width).unwrap_or(u32::MAX), u32::try_from(height).unwrap_or(u32::MAX));
        let (focal_px, center_px, distortion) = ([fx * w, fy * h], [cx * w - 0.5, cy * h - 0.5], self.distortion);
        match self.distortion_model {
            DistortionModel::RadialTangential => PinholeRadTan { size_px, focal_px, center_px, distortion }.into(),
            DistortionModel::Equidistant => KannalaBrandt { size_px, focal_px, center_px, distortion }.into(),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::calibration::Rig;

    const SHIPPED: [&str; 2] = [include_str!("../../models/indoor.toml"), include_str!("../../models/euroc.toml")];

    #[test]
    fn the_shipped_cards_describe_the_left_camera_of_euroc() {
        let CameraModel::PinholeRadTan(euroc) = Rig::euroc().camera else { unreachable!() };
        for text in SHIPPED {
            let card = ModelCard::parse(text, Path::new("x.toml")).unwrap();
            assert_eq!((card.map_kind(), card.depth.kind), (DepthKind::Metric, OutputKind::Inverse));
            let CameraModel::PinholeRadTan(camera) = card.input.camera([752, 480]) else { unreachable!() };
            // Six digits of a ratio are 4e-4 px of 752.
            for (given, known) in [(camera.focal_px, euroc.focal_px), (camera.center_px, euroc.center_px)] {
                assert!((given[0] - known[0]).abs() < 4e-4 && (given[1] - known[1]).abs() < 4e-4, "{given:?} {known:?}");
            }
            assert!(camera.distortion.iter().zip(euroc.distortion).all(|(a, b)| (a - b).abs() < 1e-8));
        }
    }

    #[test]
    fn what_is_wrong_is_said_in_one_sentence() {
        let good = SHIPPED[0];
        let sigma = good.lines().find(|line| line.starts_with("sigma_per_u = ")).unwrap();
        for (from, to, said) in [
            ("kind = \"inverse\"", "kind = \"disparity\"", "line 13: is no description of a network"),
            ("[depth]", "[deep]", "unknown field"),
            ("name = \"image\"", "title = \"image\"", "unknown field"),
            (sigma, "sigma_per_u = -1", "sigma_per_u = -1 is not between"),
            (sigma, "sigma_per_u = nan", "sigma_per_u = NaN is not between"),
            (sigma, "sigma_log = 0.3", "has no `sigma_per_u`"),
            (sigma, "sigma_per_u = 1\nsigma_log = 0.3", "both"),
            ("[0.609912,", "[458.0,", "are no camera's"),
            ("[0.609912,", "[nan,", "are no camera's"),
            ("[0.609912,", "[", "is no description of a network"),
            (sigma, "sigma_per_u = 1\nfile = \"../../etc/passwd\"", "leads out of the folder"),
            (sigma, "sigma_per_u = 1\nfile = \"/etc/passwd\"", "leads out of the folder"),
            (sigma, "sigma_per_u = 1\nfile = \"..\"", "leads out of the folder"),
            (sigma, "sigma_per_u = 1\nfile = 'c:\\x.onnx'", "leads out of the folder"),
        ] {
            let text = good.replace(from, to);
            assert_ne!(text, good, "{from}");
            let fault = ModelCard::parse(&text, Path::new("x.toml")).unwrap_err().to_string();
            assert!(fault.starts_with("x.toml") && fault.contains(said) && fault.lines().count() == 1, "{fault}");
        }
    }
}
