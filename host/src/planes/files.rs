//! What a run leaves of its planes: `planes.json` and `points.ply`.

use std::fmt::Write as _;
use std::path::Path;

use libella_core::plane::PlaneClass;
use serde::Serialize;

use super::finder::{FoundPlane, Planes};
use crate::fault::{Fault, FaultKind};

/// One entry of `planes.json`. The names of the fields are an interface: they stay.
#[derive(Serialize)]
struct Entry {
    id: usize,
    class: &'static str,
    normal_in_world: [f64; 3],
    offset_m: f64,
    polygon_in_world_m: Vec<[f64; 3]>,
    support: u32,
    hits: u16,
    first_seen_ns: i64,
    last_seen_ns: i64,
    #[serde(skip_serializing_if = "Option::is_none")]
    gone_into: Option<usize>,
}

pub(crate) fn name_of(class: PlaneClass) -> &'static str {
    match class {
        PlaneClass::Floor => "floor",
        PlaneClass::Ceiling => "ceiling",
        PlaneClass::Wall => "wall",
        PlaneClass::Table => "table",
        _ => "other",
    }
}

/// Floor blue, walls red, as in Ji et al.
pub(crate) fn color_of(class: PlaneClass) -> [u8; 3] {
    match class {
        PlaneClass::Floor => [0x1f, 0x5f, 0xbf],
        PlaneClass::Wall => [0xc0, 0x39, 0x2b],
        PlaneClass::Ceiling => [0x7d, 0x5b, 0xa6],
        PlaneClass::Table => [0xd3, 0x8b, 0x1d],
        _ => [0x2e, 0x8b, 0x57],
    }
}

/// The same lighter, to lie over a grey image.
pub(crate) fn light_color_of(class: PlaneClass) -> [u8; 3] {
    match class {
        PlaneClass::Floor => [0x4f, 0x97, 0xff],
        PlaneClass::Wall => [0xff, 0x5b, 0x4a],
        PlaneClass::Ceiling => [0xc0, 0x8c, 0xff],
        PlaneClass::Table => [0xff, 0xae, 0x2e],
        _ => [0x4f, 0xd0, 0x8c],
    }
}

impl From<&FoundPlane> for Entry {
    fn from(plane: &FoundPlane) -> Self {
        Self {
            id: plane.id,
            class: name_of(plane.class),
            normal_in_world: plane.normal_in_world.into(),
            offset_m: plane.offset_m,
            polygon_in_world_m: plane.polygon_in_world.iter().map(|corner| (*corner).into()).collect(),
            support: plane.support,
            hits: plane.hits,
            first_seen_ns: plane.first_seen.as_nanos(),
            last_seen_ns: plane.last_seen.as_nanos(),
            gone_into: plane.gone_into,
        }
    }
}

/// Writes both files into a folder.
///
/// # Errors
/// When one cannot be written.
pub fn write(folder: &Path, planes: &Planes) -> Result<(), Fault> {
    let entries: Vec<Entry> = planes.planes.iter().map(Entry::from).collect();
    let json = serde_json::to_string_pretty(&entries)
        .map_err(|error| Fault::new(FaultKind::Output, format!("the planes cannot be written ({error})"), "report this as an error"))?;
    for (name, text) in [("planes.json", json + "\n"), ("points.ply", ply(planes))] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|error| Fault::unwritable(&path, &error))?;
    }
    Ok(())
}

/// The points in the colours of their planes; grey on none.
fn ply(planes: &Planes) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment world z up, m\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        planes.points.len()
    );
    for (point, plane) in &planes.points {
        let class = plane.and_then(|name| planes.planes.iter().find(|plane| plane.id == name)).map(|plane| plane.class);
        let [red, green, blue] = class.map_or([0x9a; 3], color_of);
        let (x, y, z) = (point.x, point.y, point.z);
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{x:.4} {y:.4} {z:.4} {red} {green} {blue}");
    }
    text
}
