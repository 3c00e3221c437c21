//! What a run left in its output folder, as far as it is there.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use serde_json::Value;

use super::frames::{self, Frame};
use super::html::data_uri;
use super::snapshots::Snapshot;
use crate::dataset::table::{Row, rows};
use crate::fault::{Fault, read_text};

/// A pose of `trajectory.csv`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    pub stamp_ns: i64,
    pub position: [f64; 3],
    pub gyro_bias: [f64; 3],
    pub accel_bias: [f64; 3],
}

/// A plane of `planes.json`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(super) struct PlaneEntry {
    pub id: usize,
    pub class: String,
    pub normal_in_world: [f64; 3],
    pub polygon_in_world_m: Vec<[f64; 3]>,
    pub support: u32,
    pub first_seen_ns: i64,
    pub last_seen_ns: i64,
    pub gone_into: Option<usize>,
}

/// A row of `depth_scale.csv`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Scale {
    pub stamp_ns: i64,
    /// Factor and standard deviation of its logarithm.
    pub factor: Option<(f64, f64)>,
    pub verdict: String,
}

/// A snapshot with its pictures as data URIs.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picture {
    pub taken: Snapshot,
    pub image: String,
    pub depth: Option<String>,
    pub sigma: Option<String>,
}

/// Everything.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Output {
    /// Name of the folder.
    pub name: String,
    /// `report.json`.
    pub report: Value,
    pub poses: Vec<Pose>,
    /// Empty for a folder of an older version.
    pub frames: Vec<Frame>,
    pub planes: Vec<PlaneEntry>,
    /// Points of the map and the colours of their planes.
    pub points: Vec<([f64; 3], [u8; 3])>,
    pub scales: Vec<Scale>,
    pub pictures: Vec<Picture>,
}

impl Output {
    /// Reads a folder. Only `report.json` and `trajectory.csv` have to be there.
    pub fn read(folder: &Path) -> Result<Self, Fault> {
        let remedy = "give the output folder of `libella run`";
        let path = folder.join("report.json");
        let report: Value = serde_json::from_str(&read_text(&path, remedy)?)
            .map_err(|error| Fault::malformed(&path, format!("is no JSON ({error})"), "run `libella run` again"))?;
        if report.get("frames").and_then(Value::as_u64).is_none() {
            return Err(Fault::malformed(&path, "holds no figures: the run did not come to its end", "run `libella run` again"));
        }
        let full = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
        let there = |name: &str| Some(folder.join(name)).filter(|path| path.is_file());
        let json = |path: &Path, error: serde_json::Error| {
            Fault::malformed(path, format!("is not what a run writes ({error})"), "run `libella run` again")
        };
        let mut planes: Vec<PlaneEntry> = match there("planes.json") {
            Some(path) => serde_json::from_str(&read_text(&path, remedy)?).map_err(|error| json(&path, error))?,
            None => Vec::new(),
        };
        for plane in &mut planes {
            plane.class = known_class(&plane.class).to_owned();
        }
        Ok(Self {
            name: full.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
            report,
            poses: poses(&folder.join("trajectory.csv"))?,
            frames: there("frames.csv").map(|path| frames::read(&path)).transpose()?.unwrap_or_default(),
            planes,
            points: there("points.ply").map(|path| points(&path)).transpose()?.unwrap_or_default(),
            scales: there("depth_scale.csv").map(|path| scales(&path)).transpose()?.unwrap_or_default(),
            pictures: there("views/views.json").map(|path| pictures(&path)).transpose()?.unwrap_or_default(),
        })
    }

    /// A number of `report.json`, by its JSON pointer.
    pub fn number(&self, pointer: &str) -> Option<f64> {
        self.report.pointer(pointer)?.as_f64()
    }

    /// A text of `report.json`.
    pub fn text(&self, pointer: &str) -> Option<&str> {
        self.report.pointer(pointer)?.as_str()
    }

    /// Name of the recording.
    pub fn dataset(&self) -> &str {
        self.text("/dataset").unwrap_or("a recording")
    }

    /// Time of the first image, ns: zero of all axes.
    pub fn begin_ns(&self) -> i64 {
        let pose = || self.poses.first().map(|pose| pose.stamp_ns);
        self.frames.first().map(|frame| frame.stamp_ns).or_else(pose).unwrap_or_default()
    }

    /// Since the first image, s.
    pub fn seconds(&self, stamp_ns: i64) -> f64 {
        (stamp_ns - self.begin_ns()) as f64 * 1e-9
    }

    /// From the first to the last image, s.
    pub fn duration_s(&self) -> f64 {
        let last = self.frames.last().map(|frame| frame.stamp_ns).or_else(|| self.poses.last().map(|pose| pose.stamp_ns));
        last.map_or(0.0, |last| self.seconds(last))
    }

    /// Median time from one image to the next, ms.
    pub fn image_interval_ms(&self) -> Option<f64> {
        let mut steps: Vec<i64> =
            self.frames.iter().zip(self.frames.iter().skip(1)).map(|(earlier, later)| later.stamp_ns - earlier.stamp_ns).collect();
        steps.sort_unstable();
        steps.get(steps.len() / 2).map(|step| *step as f64 * 1e-6)
    }

    /// Whether the run was compared with a truth.
    pub fn has_truth(&self) -> bool {
        self.number("/ate_rmse_m").is_some()
    }
}

/// The class of a plane as a word that may stand in a page.
pub(super) fn known_class(class: &str) -> &'static str {
    ["floor", "ceiling", "wall", "table"].into_iter().find(|known| *known == class).unwrap_or("other")
}

fn poses(path: &Path) -> Result<Vec<Pose>, Fault> {
    let text = read_text(path, "give the output folder of `libella run`")?;
    let pose = |row: Row<'_>| {
        Ok(Pose { stamp_ns: row.stamp()?.as_nanos(), position: row.numbers(1)?, gyro_bias: row.numbers(11)?, accel_bias: row.numbers(14)? })
    };
    rows(path, &text, true).map(pose).collect()
}

/// Where a point is, m, and its colour.
type ColouredPoint = ([f64; 3], [u8; 3]);

fn points(path: &Path) -> Result<Vec<ColouredPoint>, Fault> {
    let text = read_text(path, "run `libella run` again")?;
    let body = text.split_once("end_header\n").map_or("", |(_, body)| body);
    let point = |line: &str| {
        let fields: Vec<f64> = line.split_ascii_whitespace().map_while(|field| field.parse().ok()).collect();
        let [x, y, z, red, green, blue] = *fields.as_slice() else { return None };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        Some(([x, y, z], [red as u8, green as u8, blue as u8]))
    };
    Ok(body.lines().filter_map(point).collect())
}

fn scales(path: &Path) -> Result<Vec<Scale>, Fault> {
    let text = read_text(path, "run `libella run` again")?;
    let scale = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |place: usize| fields.get(place).and_then(|field| field.trim().parse::<f64>().ok());
        Some(Scale {
            stamp_ns: fields.first()?.trim().parse().ok()?,
            factor: number(1).zip(number(2)),
            verdict: (*fields.get(4)?).trim().to_owned(),
        })
    };
    Ok(text.lines().filter(|line| !line.starts_with('#')).filter_map(scale).collect())
}

fn pictures(path: &Path) -> Result<Vec<Picture>, Fault> {
    let remedy = "run `libella run` again";
    let taken: Vec<Snapshot> = serde_json::from_str(&read_text(path, remedy)?)
        .map_err(|error| Fault::malformed(path, format!("is not what a run writes ({error})"), remedy))?;
    let mut known = BTreeMap::new();
    let mut uri = |name: &str| -> Result<String, Fault> {
        // A name, and no way out of the folder.
        if name.contains(['/', '\\']) || !name.ends_with(".jpg") {
            return Err(Fault::malformed(path, format!("names `{name}`, which is no picture beside it"), remedy));
        }
        let file = path.with_file_name(name);
        let bytes = std::fs::read(&file).map_err(|error| Fault::missing(&file, format!("cannot be read ({error})"), remedy))?;
        Ok(known.entry(name.to_owned()).or_insert_with(|| data_uri("image/jpeg", &bytes)).clone())
    };
    let mut pictures = Vec::new();
    for taken in taken {
        let image = uri(&taken.image)?;
        let depth = taken.depth.as_ref().map(|map| uri(&map.picture)).transpose()?;
        let sigma = taken.sigma.as_ref().map(|map| uri(&map.picture)).transpose()?;
        pictures.push(Picture { taken, image, depth, sigma });
    }
    Ok(pictures)
}
