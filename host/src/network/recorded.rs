//! Replays stored depth maps: 16-bit PNG files in millimetres along the optical axis, 0 where nothing is known, named by time stamp.
//!
//! `libella simulate` writes them exact (`mav0/cam0/depth`), up to the rounding to a millimetre; [`super::Spoiled`] adds what networks
//! get wrong.

use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageReader};
use libella_core::image::ImageView;
use libella_core::time::Timestamp;

use super::{DepthKind, DepthMap, DepthNetwork, NetworkError};
use crate::fault::Fault;

/// What an exact map says of itself: depths are rounded to a millimetre, and pixels of an edge belong to either side.
const SIGMA_LOG: f32 = 0.01;

/// Stored maps, read when they are asked for.
#[derive(Debug, Clone)]
pub struct RecordedDepth {
    folder: PathBuf,
    stride: usize,
}

impl RecordedDepth {
    /// The usual number of raw pixels from one value of the map to the next.
    pub const STRIDE: usize = 4;

    /// Maps of a recording (`mav0/cam0/depth` in it) or of the folder itself; every `stride`-th pixel is kept, along rows and columns.
    ///
    /// # Errors
    /// When there are no such files.
    pub fn open(folder: &Path, stride: usize) -> Result<Self, Fault> {
        let places = ["mav0/cam0/depth", "cam0/depth", "depth", ""].map(|below| folder.join(below));
        let holds_maps = |place: &PathBuf| {
            let files = std::fs::read_dir(place).ok()?;
            let mut names = files.flatten().map(|file| PathBuf::from(file.file_name()));
            names.any(|name| name.extension().is_some_and(|end| end == "png") && stamped(&name)).then_some(())
        };
        let found = places.iter().find(|place| holds_maps(place).is_some());
        let found = found.ok_or_else(|| {
            Fault::missing(folder, "holds no depth maps", "write some with `libella simulate`: mav0/cam0/depth/<stamp>.png")
        })?;
        Ok(Self { folder: found.clone(), stride: stride.max(1) })
    }

    /// The map of a stamp.
    ///
    /// # Errors
    /// When it is absent or no 16-bit PNG.
    #[allow(clippy::cast_precision_loss)]
    pub fn read(&self, stamp: Timestamp) -> Result<DepthMap, Fault> {
        let path = self.folder.join(format!("{}.png", stamp.as_nanos()));
        let bytes = std::fs::read(&path).map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => {
                Fault::missing(&path, "there is no depth map of this image", "write the recording again with its depth maps")
            }
            _ => Fault::malformed(&path, format!("cannot be read ({error})"), "check its permissions and the disk"),
        })?;
        let decoded = ImageReader::with_format(std::io::Cursor::new(bytes), image::ImageFormat::Png).decode();
        let decoded = decoded.map_err(|error| {
            Fault::malformed(&path, format!("cannot be decoded ({})", error.to_string().replace('\n', " ")), "copy it again")
        })?;
        let DynamicImage::ImageLuma16(image) = decoded else {
            return Err(Fault::malformed(&path, "is no 16-bit grey image", "depth maps hold millimetres in 16 bits"));
        };
        let [width, height] = [image.width(), image.height()].map(|side| side as usize);
        // The pixel in the middle of each block, so that the map is not shifted against the image.
        let step = self.stride.min(width).min(height);
        let (columns, rows) = (width / step, height / step);
        let first = step / 2;
        let mut map = DepthMap::unknown([columns, rows], [step as f64; 2], [first as f64; 2], DepthKind::Metric);
        let millimetres = image.as_raw();
        for (index, value) in map.inverse_depth_1_m.iter_mut().enumerate() {
            let pixel = (first + index / columns * step) * width + first + index % columns * step;
            let depth = millimetres.get(pixel).copied().unwrap_or(0);
            if depth > 0 {
                *value = 1000.0 / f32::from(depth);
                map.sigma_log[index] = SIGMA_LOG;
                map.uncertainty[index] = SIGMA_LOG;
            }
        }
        Ok(map)
    }
}

fn stamped(name: &Path) -> bool {
    name.file_stem().and_then(|stem| stem.to_str()).is_some_and(|stem| stem.parse::<u64>().is_ok())
}

impl DepthNetwork for RecordedDepth {
    fn predict(&mut self, stamp: Timestamp, image: &ImageView<'_>) -> Result<DepthMap, NetworkError> {
        let map = self.read(stamp)?;
        let (given, step) = ([image.width(), image.height()], map.step_px[0]);
        let fits = |side: usize, maps: usize| (side as f64 / step).floor() as usize == maps;
        if fits(given[0], map.width) && fits(given[1], map.height) {
            return Ok(map);
        }
        Err(NetworkError::ImageSize { given, expected: [map.width, map.height].map(|side| side * self.stride) })
    }

    fn describe(&self) -> String {
        format!("stored maps, every {}. pixel", self.stride)
    }
}
