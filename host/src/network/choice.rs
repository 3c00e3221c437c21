//! `--depth none|indoor|euroc|FILE.onnx|recorded[:FOLDER]`.
//!
//! `indoor` is part of the program: an installed binary has it, and it cannot be damaged or go missing; 5.7 MB are little beside
//! tract. `euroc` is for non-commercial use only and therefore no part of a program whose licence is another: it is looked for
//! in the folder that [`MODELS_VARIABLE`] names, in `models` beside the program, in `../share/libella/models` as packages
//! lay files out, and in the sources that the program was built from.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use libella_core::camera::CameraModel;

use super::{DepthNetwork, RecordedDepth};
use crate::fault::{Fault, FaultKind};

/// The environment variable that names the folder of the models.
pub const MODELS_VARIABLE: &str = "LIBELLA_MODELS";

/// What gives depth.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ModelChoice {
    /// None.
    None,
    /// Trained on rendered rooms; part of the program.
    Indoor,
    /// Fine-tuned on EuRoC, for non-commercial use; a file.
    Euroc,
    /// An ONNX file with its card beside it, or the card.
    File(PathBuf),
    /// Stored maps: those of the recording, or of a folder.
    Recorded(Option<PathBuf>),
}

impl FromStr for ModelChoice {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "none" => Self::None,
            "indoor" => Self::Indoor,
            "euroc" => Self::Euroc,
            "recorded" => Self::Recorded(None),
            other => match other.strip_prefix("recorded:") {
                Some(folder) => Self::Recorded(Some(folder.into())),
                None => Self::File(other.into()),
            },
        })
    }
}

impl ModelChoice {
    /// Makes the source ready for images of a camera; `None` where none is wanted. `recording` is the folder that `recorded` alone means.
    ///
    /// # Errors
    /// When a file is absent, damaged or unfit, or the program was built without networks.
    pub fn open(&self, camera: &CameraModel<f64>, recording: Option<&Path>) -> Result<Option<Box<dyn DepthNetwork>>, Fault> {
        match self {
            Self::None => Ok(None),
            Self::Indoor => shipped(camera).map(Some),
            Self::Euroc => file(&found("euroc.onnx")?, camera).map(Some),
            Self::File(path) => file(path, camera).map(Some),
            Self::Recorded(folder) => {
                let folder = folder
                    .as_deref()
                    .or(recording)
                    .ok_or_else(|| Fault::new(FaultKind::Configuration, "`recorded` alone needs a recording", "give recorded:FOLDER"))?;
                Ok(Some(Box::new(RecordedDepth::open(folder, RecordedDepth::STRIDE)?)))
            }
        }
    }
}

impl ModelChoice {
    /// The ONNX file that is read, where one is; what is part of the program or stored beside a recording has none.
    ///
    /// # Errors
    /// When a model of the project is not there.
    pub fn file(&self) -> Result<Option<PathBuf>, Fault> {
        match self {
            Self::Euroc => found("euroc.onnx").map(Some),
            Self::File(path) => Ok(Some(path.with_extension("onnx"))),
            Self::None | Self::Indoor | Self::Recorded(_) => Ok(None),
        }
    }
}

#[cfg(feature = "network")]
fn shipped(camera: &CameraModel<f64>) -> Result<Box<dyn DepthNetwork>, Fault> {
    let card = super::ModelCard::parse(include_str!("../../models/indoor.toml"), Path::new("indoor.toml"))?;
    let bytes = include_bytes!("../../models/indoor.onnx");
    Ok(Box::new(super::OnnxNetwork::from_bytes(bytes, Path::new("indoor.onnx"), &card, camera)?))
}

#[cfg(feature = "network")]
fn file(path: &Path, camera: &CameraModel<f64>) -> Result<Box<dyn DepthNetwork>, Fault> {
    Ok(Box::new(super::OnnxNetwork::open(path, camera)?))
}

#[cfg(not(feature = "network"))]
fn shipped(_: &CameraModel<f64>) -> Result<Box<dyn DepthNetwork>, Fault> {
    Err(left_out())
}

#[cfg(not(feature = "network"))]
fn file(_: &Path, _: &CameraModel<f64>) -> Result<Box<dyn DepthNetwork>, Fault> {
    Err(left_out())
}

#[cfg(not(feature = "network"))]
fn left_out() -> Fault {
    Fault::new(FaultKind::Configuration, "this program was built without networks", "build it with the feature `network`, or give none")
}

/// A model that comes with the project but not within the program.
fn found(name: &str) -> Result<PathBuf, Fault> {
    let beside = std::env::current_exe().ok().and_then(|program| program.parent().map(Path::to_path_buf));
    let folders = [
        std::env::var_os(MODELS_VARIABLE).map(PathBuf::from),
        beside.as_ref().map(|folder| folder.join("models")),
        beside.as_ref().map(|folder| folder.join("../share/libella/models")),
        Some(Path::new(env!("CARGO_MANIFEST_DIR")).join("models")),
    ];
    folders.iter().flatten().map(|folder| folder.join(name)).find(|path| path.is_file()).ok_or_else(|| {
        let what = format!("there is no {name} beside this program or where it was built");
        let remedy = format!("set {MODELS_VARIABLE} to the folder host/models of the sources, or give the file itself");
        Fault::new(FaultKind::Missing, what, remedy)
    })
}
