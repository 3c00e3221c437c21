//! A network in an ONNX file, run by tract.
//!
//! The file is checked against its card before anything runs: size, operator set, names, shapes and types of input and outputs,
//! and that all of it lies within the file. tract optimises it once. It is written to fail with a message on bad files, and does
//! so mostly; where it panics instead, that is caught here and becomes a message too.

mod check;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use libella_core::camera::CameraModel;
use libella_core::image::ImageView;
use libella_core::time::Timestamp;
use tract_onnx::prelude::*;

use super::card::OutputKind;
use super::quiet::quietly;
use super::{DepthKind, DepthMap, DepthNetwork, ModelCard, NetworkError, Resampling};
use crate::fault::Fault;

/// Larger files are refused.
pub const LARGEST_FILE_BYTES: u64 = 64 << 20;
/// Operator sets that tract is tested with.
pub const OPERATOR_SETS: std::ops::RangeInclusive<i64> = 9..=18;
/// u stays away from 0 and 1 by this.
const U_MARGIN: f32 = 1e-3;

/// A network that is ready for the images of one camera.
#[derive(Debug)]
pub struct OnnxNetwork {
    plan: Arc<TypedRunnableModel>,
    card: ModelCard,
    name: String,
    input: [usize; 2],
    output: [usize; 2],
    resampling: Resampling,
}

impl OnnxNetwork {
    /// Reads an ONNX file with the card of the same name beside it, or a card with its ONNX file.
    ///
    /// # Errors
    /// When either is absent, damaged, too large, or they do not fit each other.
    pub fn open(path: &Path, camera: &CameraModel<f64>) -> Result<Self, Fault> {
        let is_card = path.extension().is_some_and(|extension| extension == "toml");
        let card_path = path.with_extension("toml");
        if !is_card {
            // Whoever mistypes the name shall not hear about a card.
            size_of(path)?;
        }
        let card = ModelCard::read(&card_path)?;
        let model = match (&card.file, is_card) {
            (Some(name), true) => card_path.with_file_name(name),
            (None, true) => path.with_extension("onnx"),
            (_, false) => path.to_path_buf(),
        };
        let size = size_of(&model)?;
        if size > LARGEST_FILE_BYTES {
            let what = format!("has {:.1} MiB, more than {} MiB", size as f64 / f64::from(1 << 20), LARGEST_FILE_BYTES >> 20);
            return Err(Fault::malformed(&model, what, "give a smaller network: this one would be too slow as well"));
        }
        let bytes = std::fs::read(&model)
            .map_err(|error| Fault::malformed(&model, format!("cannot be read ({error})"), "check its permissions and the disk"))?;
        Self::from_bytes(&bytes, &model, &card, camera)
    }

    /// Takes the content of an ONNX file; `path` is what messages name.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn from_bytes(bytes: &[u8], path: &Path, card: &ModelCard, camera: &CameraModel<f64>) -> Result<Self, Fault> {
        if bytes.len() as u64 > LARGEST_FILE_BYTES {
            return Err(Fault::malformed(path, format!("has more than {} MiB", LARGEST_FILE_BYTES >> 20), "give a smaller network"));
        }
        let made = quietly(|| catch_unwind(AssertUnwindSafe(|| check::prepare(bytes, path, card))));
        let (plan, input, output) = made.unwrap_or_else(|_| Err(damaged(path, "tract gave up on it"))).map_err(tidy)?;
        let resampling = Resampling::new(camera, &card.input, input, output)?;
        let name = path.file_name().map_or_else(|| "network".into(), |name| name.to_string_lossy().into_owned());
        Ok(Self { plan, card: card.clone(), name, input, output, resampling })
    }

    /// How images of the camera come to the model's.
    #[must_use]
    pub fn resampling(&self) -> &Resampling {
        &self.resampling
    }

    fn run(&self, pixels: Vec<f32>) -> Result<Vec<Vec<f32>>, NetworkError> {
        let failed = |error: TractError| NetworkError::Failed(one_line(&error));
        let image = Tensor::from_shape(&[1, 1, self.input[1], self.input[0]], &pixels).map_err(failed)?;
        let done = quietly(|| catch_unwind(AssertUnwindSafe(|| self.plan.run(tvec!(image.into())))));
        let outputs = done.unwrap_or_else(|_| Err(TractError::msg("tract gave up"))).map_err(failed)?;
        let values = |tensor: &TValue| Ok(tensor.to_plain_array_view::<f32>().map_err(failed)?.iter().copied().collect());
        outputs.iter().map(values).collect()
    }
}

impl DepthNetwork for OnnxNetwork {
    fn predict(&mut self, _: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        let mut outputs = self.run(self.resampling.to_model(image)?)?.into_iter();
        let count = self.output[0] * self.output[1];
        let mut next = |name: &str| {
            let values = outputs.next().filter(|values| values.len() == count);
            let values = values.ok_or_else(|| NetworkError::Failed(format!("its output `{name}` changed its shape")))?;
            match values.iter().filter(|value| !value.is_finite()).count() {
                0 => Ok(values),
                bad => Err(NetworkError::NotFinite { output: name.into(), count: bad, of: count }),
            }
        };
        let mut inverse = next(&self.card.depth.name)?;
        if self.card.depth.kind == OutputKind::Depth {
            inverse.iter_mut().for_each(|depth| *depth = if *depth > 0.0 { depth.recip() } else { 0.0 });
        }
        let (sigma, u) = match &self.card.uncertainty {
            Some(output) => {
                let mut u = next(&output.name)?;
                if let Some(value) = u.iter().find(|value| !(0.0..=1.0).contains(*value)) {
                    return Err(NetworkError::Uncertainty { output: output.name.clone(), value: *value });
                }
                u.iter_mut().for_each(|value| *value = value.clamp(U_MARGIN, 1.0 - U_MARGIN));
                let factor = self.card.sigma_per_u.unwrap_or(1.0) as f32;
                (u.iter().map(|value| factor * value).collect(), u)
            }
            None => {
                let sigma = self.card.sigma_log.unwrap_or(1.0) as f32;
                // u is the scale of a Laplace distribution, whose standard deviation is √2 times that.
                let u = (sigma * std::f32::consts::FRAC_1_SQRT_2).clamp(U_MARGIN, 1.0 - U_MARGIN);
                (vec![sigma; count], vec![u; count])
            }
        };
        Ok(self.resampling.to_raw(&inverse, &sigma, &u, self.card.map_kind()))
    }

    fn describe(&self) -> String {
        let ([w, h], [columns, rows]) = (self.input, self.output);
        format!("{}, {w}x{h} to {columns}x{rows}, tract", self.name)
    }

    fn kind(&self) -> DepthKind {
        self.card.map_kind()
    }
}

fn size_of(path: &Path) -> Result<u64, Fault> {
    match std::fs::metadata(path) {
        Ok(data) if data.is_file() => Ok(data.len()),
        Ok(_) => Err(Fault::malformed(path, "is no file", "give an ONNX file, or one of indoor, euroc, none")),
        Err(_) => Err(Fault::missing(path, "there is no such file", "give an ONNX file, or one of indoor, euroc, none")),
    }
}

fn damaged(path: &Path, reason: &str) -> Fault {
    Fault::malformed(
        path,
        format!("is no ONNX file that can be used ({reason})"),
        "copy it again, or export it again as training/export.py does",
    )
}

/// Names within a file may hold anything.
fn tidy(mut fault: Fault) -> Fault {
    fault.what = shortened(&fault.what);
    fault
}

/// One line of bounded length.
fn shortened(text: &str) -> String {
    let plain: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    let line = plain.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(300) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line,
    }
}

/// An error with its causes.
fn one_line(error: &TractError) -> String {
    shortened(&format!("{error:#}"))
}
