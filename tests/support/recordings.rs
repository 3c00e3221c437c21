//! Recordings that are not part of the repository.

use std::path::PathBuf;
use std::process::Command;

use libella_host::config::Config;
use libella_host::dataset::{self, Recording};
use tempfile::TempDir;

/// Where recordings are looked for: `LIBELLA_DATA`, or beside the sources.
pub fn root() -> PathBuf {
    std::env::var_os("LIBELLA_DATA").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from)
}

/// A file or folder below [`root`], or `None` with a word about it.
pub fn data(below: &str) -> Option<PathBuf> {
    let path = root().join(below);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: LIBELLA_DATA has no {below}");
    None
}

/// The shared minute of another renderer, decoded into a folder that is gone with its handle, or `None` with a word about it.
pub fn of_another_renderer(sequence: &str) -> Option<(TempDir, Recording)> {
    data(&format!("semi_real/{sequence}"))?;
    let script = data("semi_real/unpack.sh")?;
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        println!("skipped: no ffmpeg to decode semi_real/{sequence}");
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    assert!(Command::new("sh").arg(script).arg(folder.path()).arg(sequence).status().unwrap().success());
    let recording = dataset::open(&folder.path().join(sequence), &Config::default().dataset).unwrap();
    Some((folder, recording))
}
